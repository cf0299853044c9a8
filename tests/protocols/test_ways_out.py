"""Ways out of a campaign: netCDF, Parquet and event documents hold what it does; the catalogue knows them all."""

import json
import shutil
from pathlib import Path

import event_model
import netCDF4
import numpy as np
import pandas as pd
import pytest

from shockrig.files.campaign import read_campaign
from shockrig.files.exports import documents
from shockrig.protocols.cli import main

EXAMPLE = Path(__file__).parents[2] / "data" / "examples" / "plain-rough"


def made(path, **run):
    """Two runs, the second without a hygrometer and with a cell missing."""
    for number, sensors in (("0001", ("imet", "hyt")), ("0002", ("imet",))):
        folder = path / "runs" / number
        folder.mkdir(parents=True)
        head = {"format": "shock-run/1", "id": number, "started_at": "2026-05-01T00:00:10Z", "airflow_m_s": 6.0, **run}
        (folder / "run.json").write_text(json.dumps(head))
        (folder / "imet.csv").write_text("time_s,temperature_c\n0.1,20\n0.2,21\n0.3,22\n")
        if "hyt" in sensors:
            text = "time_s,humidity_percent,temperature_c,stale\n0.15,50,20,0\n0.25,51,,0\n"
            (folder / "hyt.csv").write_text(text)
    sensors = {"imet": {"kind": "imet-xf", "serial": "X1"}, "hyt": {"kind": "hyt-271"}}
    (path / "campaign.json").write_text(json.dumps({"format": "shock-campaign/1", "name": "c", "sensors": sensors}))
    return path


def test_netcdf_holds_every_reading_of_every_run(tmp_path, capsys):
    out = tmp_path / "c.nc"
    assert main(["export", str(EXAMPLE), "--out", str(out)]) == 0
    campaign = read_campaign(EXAMPLE)
    assert f"{len(campaign.runs)} runs" in capsys.readouterr().out
    with netCDF4.Dataset(out) as data:
        assert data.Conventions == "CF-1.11" and data.featureType == "timeSeries"
        assert data["run_id"].cf_role == "timeseries_id" and data["imet_run"].instance_dimension == "run"
        assert list(data["run_id"][:]) == [run.id for run in campaign.runs]
        assert data["source_temperature_c"].standard_name == "air_temperature"
        for place, run in enumerate(campaign.runs):
            own = data["hyt_run"][:] == place
            assert np.array_equal(data["hyt_humidity_percent"][:][own], run.hyt.values["humidity_percent"])
            assert np.array_equal(data["hyt_time"][:][own], run.hyt.time_s)
            assert data["start_s"][place] == run.start_s


def test_a_file_of_one_probe_of_several_says_so(tmp_path, capsys):
    campaign = made(tmp_path / "c")
    head = json.loads((campaign / "campaign.json").read_text())
    head["sensors"]["imet-2"] = {"kind": "imet-xf"}
    (campaign / "campaign.json").write_text(json.dumps(head))
    assert main(["export", str(campaign), "--out", str(tmp_path / "c.jsonl")]) == 0
    assert "2 runs, 8 readings of probe 1 alone: --probe takes one of 1, 2" in capsys.readouterr().out


def test_what_is_not_known_is_missing_in_netcdf(tmp_path):
    assert main(["export", str(made(tmp_path / "c")), "--out", str(tmp_path / "c.nc")]) == 0
    with netCDF4.Dataset(tmp_path / "c.nc") as data:
        assert data["start_s"][:].mask.all() and data["source_temperature_c"][:].mask.all()
        assert data["began"][:].tolist() == [1777593610.0] * 2  # 2026-05-01 00:00:10 UTC
        assert data["hyt_temperature_c"][:].tolist() == [20.0, None] and data["hyt_run"][:].tolist() == [0, 0]


def test_parquet_holds_the_same_rows(tmp_path):
    assert main(["export", str(made(tmp_path / "c")), "--out", str(tmp_path / "c.parquet")]) == 0
    table = pd.read_parquet(tmp_path / "c.parquet")
    assert table.groupby(["run", "sensor"]).size().to_dict() == {
        ("0001", "hyt"): 2,
        ("0001", "imet"): 3,
        ("0002", "imet"): 3,
    }
    assert table.query("sensor == 'imet' and run == '0002'")["temperature_c"].tolist() == [20, 21, 22]
    assert table.attrs["campaign"] == "c" and table.attrs["runs"][0]["airflow_m_s"] == 6.0


def test_documents_are_those_of_the_event_model(tmp_path):
    """Held against bluesky's own schemas."""
    out = tmp_path / "c.jsonl"
    campaign = made(tmp_path / "c", source={"temperature_c": 20.0}, transfer={"start_s": 0.2})
    assert main(["export", str(campaign), "--out", str(out)]) == 0
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    names = [name for name, _ in lines]
    assert names.count("start") == names.count("stop") == 2
    assert [len([n for n in names if n == kind]) for kind in ("descriptor", "event")] == [3, 8]
    for name, document in lines:
        event_model.schema_validators[event_model.DocumentNames[name]].validate(document)
    start, first = lines[0][1], next(document for name, document in lines if name == "event")
    assert start["time"] == 1777593610.0 and start["source"] == {"temperature_c": 20.0}
    assert start["transfer"] == {"start_s": 0.2} and start["run_id"] == "0001"
    assert first["data"] == {"imet_temperature_c": 20.0} and first["time"] == pytest.approx(1777593610.1)
    assert lines == [list(document) for document in documents(read_campaign(campaign))]  # the same uids each time


def test_an_ending_that_is_no_format_and_a_place_that_cannot_be_are_refused(tmp_path, capsys):
    campaign = str(made(tmp_path / "c"))
    for out, words in (
        (tmp_path / "c.csv", "end it in .nc, .parquet or .jsonl"),
        (tmp_path / "none" / "c.nc", "name a file in a folder that can be written"),
        (tmp_path / "none" / "c.jsonl", "No such file"),
        (tmp_path / "none" / "c.parquet", "name a file in a folder that can be written"),
    ):
        assert main(["export", campaign, "--out", str(out)]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and words in error
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["c"]


def profile(path, campaign, alpha, body="sphere"):
    path.mkdir()
    content = {
        "format": "sensor-profile/1",
        "temperature": {"thermal_diffusivity_m2_s": {"value": alpha, "standard_uncertainty": 1e-10}},
        "sensors": {"imet": {"serial": "X1", "body": body}},
        "provenance": {"campaign_path": str(campaign)},
    }
    (path / "profile.json").write_text(json.dumps(content))


def test_the_catalogue_lists_campaigns_results_and_changes_of_a_sensor(tmp_path, capsys):
    first = made(tmp_path / "spring", started_at="2026-03-01T10:00:00Z")
    second = made(tmp_path / "deep" / "autumn", started_at="2026-09-01T10:00:00Z")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken/campaign.json").write_text("{")
    profile(tmp_path / "p1", first, 7.5e-8)
    profile(tmp_path / "p2", second, 7.65e-8)
    diagnosis = {"format": "shock-diagnosis/1", "campaign": "c", "channels": {"temperature": {"verdict": "adequate"}}}
    (tmp_path / "p2/diagnosis.json").write_text(json.dumps(diagnosis))
    assert main(["list", str(tmp_path)]) == 0
    said = capsys.readouterr()
    assert "broken/campaign.json, line 1: not JSON" in said.err and said.err.count("\n") == 1
    lines = said.out.splitlines()
    assert lines[0].endswith("spring  2026-03-01T10:00  2 runs") and "autumn  2026-09-01T10:00" in said.out
    assert "alpha of the bead (7.500 ± 0.010) × 10⁻⁸ m²/s" in said.out
    assert said.out.count("temperature: adequate") == 1  # both are called c: the one that it lies beside
    assert lines[-1] == "imet X1: alpha +2.00 % (+10.6 sigma) from spring to autumn"
    # Of a sensor that is one lag, and has no length, the time constant is what changed: tau = R^2 / alpha.
    for name, campaign, alpha in (("p1", first, 7.5e-8), ("p2", second, 7.65e-8)):
        shutil.rmtree(tmp_path / name)
        profile(tmp_path / name, campaign, alpha, "lumped")
    assert main(["list", str(tmp_path)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "imet X1: tau -1.96 % (-10.6 sigma) from spring to autumn"
    shutil.rmtree(first), shutil.rmtree(second)
    assert main(["list", str(tmp_path)]) == 2
    assert "holds no campaign" in capsys.readouterr().err
