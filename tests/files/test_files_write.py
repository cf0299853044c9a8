"""Campaigns as they are written: read back as they were, kept to the schemas by every writer, whole or not at all."""

import json
import math
from dataclasses import asdict, replace
from importlib import resources

import jsonschema
import numpy as np
import pytest
from fake_bench import fake_bench
from hypothesis import given, settings
from hypothesis import strategies as st

from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.files.campaign import BODIES, ReferenceResponse, RunAir, read_campaign
from shockrig.files.campaign_write import campaign_document, run_document, table_text, write_campaign, write_run
from shockrig.files.profile import write_profile
from shockrig.protocols.cli import main
from shockrig.rig.protocol import PlannedRun, Protocol, Record, Soak, Transfer
from shockrig.rig.runner import record_campaign
from shockrig.rig.seams import Air as SeamAir
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import draw_truth


def schema(name):
    return json.loads((resources.files("shockrig.data") / "schemas" / f"{name}.json").read_text())


def test_the_files_of_a_run_are_what_the_format_says_to_the_byte(tmp_path):
    document = run_document(
        "0007",
        source={"temperature_c": 40.0, "humidity_percent": 20.0},
        destination={},
        airflow_m_s=6.0,
        start_s=10.53,
        reference=ReferenceResponse(0.05),
        note="ü",
    )
    tables = {
        "hyt": table_text(
            {
                "time_s": [0.05, 0.15],
                "humidity_percent": [20.1, None],
                "temperature_c": [math.nan, 40.0],
                "stale": [0, 1],
            },
            {"stale": "%d", "temperature_c": "%.2f"},
        ),
        "air": table_text({"time_s": [-1.0, 0.0], "temperature_c": [40.0, 39.5]}),
    }
    write_run(tmp_path, document, tables, sync=True)
    assert (tmp_path / "run.json").read_bytes().decode() == (
        '{\n "format": "shock-run/1",\n "id": "0007",\n'
        ' "source": {\n  "temperature_c": 40.0,\n  "humidity_percent": 20.0\n },\n "destination": {},\n'
        ' "airflow_m_s": 6.0,\n "transfer": {\n  "start_s": 10.53\n },\n "reference": {\n'
        '  "temperature_time_constant_s": 0.05,\n  "temperature_standard_uncertainty_k": 0.02,\n'
        '  "humidity_time_constant_s": 0.0,\n  "humidity_standard_uncertainty_percent": 0.1\n },\n "note": "ü"\n}\n'
    )
    assert (tmp_path / "hyt.csv").read_text() == (
        "time_s,humidity_percent,temperature_c,stale\n0.0500,20.1000,,0\n0.1500,,40.00,1\n"
    )
    assert (tmp_path / "air.csv").read_text() == "time_s,temperature_c\n-1.0000,40.0000\n0.0000,39.5000\n"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["air.csv", "hyt.csv", "run.json"]


def values(low, high):
    return st.floats(low, high).map(lambda x: round(x, 4) + 0.0)


def columns(**ranges):
    """Tables of 2 to 6 rows, times rising."""
    rows = st.integers(2, 6)
    return rows.flatmap(
        lambda n: st.fixed_dictionaries(
            {"time_s": st.lists(values(-50, 500), min_size=n, max_size=n, unique=True).map(sorted)}
            | {name: st.lists(values(*ends), min_size=n, max_size=n) for name, ends in ranges.items()}
        ).map(lambda table: {name: table[name] for name in ("time_s", *ranges)})
    )


def maybe(strategy):
    return st.none() | strategy


airs = st.builds(RunAir, maybe(values(-100, 150)), maybe(values(-5, 130)))
runs = st.fixed_dictionaries(
    {
        "source": airs,
        "destination": airs,
        "airflow_m_s": maybe(values(0, 150)),
        "pressure_hpa": maybe(values(1, 2000)),
        "start_s": maybe(values(-100, 100)),
        "duration_s": maybe(values(0, 3600)),
        "reference": maybe(
            st.builds(ReferenceResponse, values(0, 3600), values(0, 50), values(0, 3600), values(0, 50))
        ),
        "imet": maybe(columns(temperature_c=(-100, 150))),
        "hyt": maybe(columns(humidity_percent=(-10, 130), temperature_c=(-100, 150))),
        "air": maybe(columns(temperature_c=(-100, 150), airflow_m_s=(0, 150)))
        | columns(humidity_percent=(-5, 130), pressure_hpa=(1, 2000)),
    }
)
sensors = st.fixed_dictionaries(
    {},
    optional={
        "imet": st.fixed_dictionaries({"body": st.sampled_from(BODIES), "bead_radius_m": st.floats(1e-6, 0.03)}),
        "hyt": st.fixed_dictionaries({"body": st.sampled_from(BODIES), "film_thickness_m": st.floats(1e-9, 0.003)}),
    },
)


def known_air(air):
    return {name: value for name, value in asdict(air).items() if value is not None}


@settings(max_examples=40, deadline=None)
@given(
    name=st.text(st.characters(exclude_categories=("C", "Z")), min_size=1),  # what cannot be printed is read escaped
    sensors=sensors,
    runs=st.lists(runs, min_size=1, max_size=2),
)
def test_whatever_is_written_is_read_back_and_keeps_to_the_schemas(tmp_path_factory, name, sensors, runs):
    path = tmp_path_factory.mktemp("written")
    document = campaign_document(name, sensors, made_by="hand")
    jsonschema.validate(document, schema("shock-campaign-1"))
    write_campaign(path, document)
    for number, one in enumerate(runs, start=1):
        folder = path / "runs" / f"{number:04d}"
        folder.mkdir(parents=True)
        tables = {key: table_text(one[key]) for key in ("imet", "hyt", "air") if one[key] is not None}
        facts = {key: value for key, value in one.items() if key not in ("imet", "hyt", "air", "source", "destination")}
        content = run_document(
            folder.name,
            source=known_air(one["source"]),
            destination=known_air(one["destination"]),
            **facts,
            weather="dry",
        )
        jsonschema.validate(content, schema("shock-run-1"))
        write_run(folder, content, tables)
    campaign = read_campaign(path)
    assert campaign.name == name and campaign.sensors == sensors
    assert campaign.bodies["imet"] == sensors.get("imet", {}).get("body", "sphere")
    assert campaign.film_thickness_m == sensors.get("hyt", {}).get("film_thickness_m", 1e-5)
    for one, found in zip(runs, campaign.runs, strict=True):
        assert (found.source, found.destination) == (one["source"], one["destination"])
        assert (found.airflow_m_s, found.start_s, found.duration_s) == tuple(
            one[key] for key in ("airflow_m_s", "start_s", "duration_s")
        )
        assert found.pressure_hpa == (1013.25 if one["pressure_hpa"] is None else one["pressure_hpa"])
        assert found.reference == (one["reference"] or ReferenceResponse())
        assert found.extra == {"weather": "dry"}
        for key in ("imet", "hyt", "air"):
            trace = getattr(found, key)
            assert (trace is None) == (one[key] is None)
            if trace is not None:
                assert {"time_s": trace.time_s.tolist()} | {k: v.tolist() for k, v in trace.values.items()} == one[key]


def by_the_recorder(path):
    steps = (Soak(over_s=2.0), Record(2.0), Transfer(5.0), Record(4.0))
    shock = PlannedRun("0001", SeamAir(20.0, 20.0), SeamAir(30.0, 70.0), 6.0, steps)
    protocol = Protocol("two", "", (shock, replace(shock, id="0002")))
    record_campaign(fake_bench(), protocol, path, utc=lambda: "2026-05-01T00:00:00Z", observer=None, sync_every_s=None)


def by_the_import(path):
    log = path.with_name("log.csv")
    log.write_text(
        "time_s,temperature_c,rh\n" + "".join(f"{i / 10},{20 + i / 9:.2f},{40 - i / 7:.2f}\n" for i in range(99))
    )
    arguments = ["import", "--imet", str(log), "--hyt", str(log), "--out", str(path), "--start", "3.05"]
    assert main([*arguments, "--source-temperature", "20", "--airflow", "5", "--bead-radius", "3e-4"]) == 0
    assert main(arguments) == 0


def by_the_virtual_bench(path):
    simulate_campaign(draw_truth(np.random.default_rng(3), "rough"), standard_plan()[:3], 3, path, write_duration=True)


def by_another_labs_bench(path):
    from foreign_lab.bodies import make_body
    from foreign_lab.lab import Arrival, Lab, LabLogger, LabReference, LabRun, Written
    from foreign_lab.recording import record

    logger = LabLogger(0.5, 0.01, 0.02)
    transfers = (LabRun(30.0, 60.0, 5.3, 30.0), LabRun(60.0, 30.0, 5.1, 30.0))
    reference = LabReference(0.5, 0.3, logger)
    body = make_body("lumped", 4.0)
    record(Lab("humidity", body, Arrival("one", 2.0), logger, transfers, Written(body="lumped"), reference), 3, path)


WRITERS = [by_the_recorder, by_the_import, by_the_virtual_bench, by_another_labs_bench]


@pytest.mark.parametrize("write", WRITERS)
def test_every_writer_keeps_to_the_schemas_and_is_read(tmp_path, write):
    path = tmp_path / "campaign"
    write(path)
    jsonschema.validate(json.loads((path / "campaign.json").read_text()), schema("shock-campaign-1"))
    files = sorted(path.glob("runs/*/run.json"))
    for file in files:
        content = json.loads(file.read_text())
        jsonschema.validate(content, schema("shock-run-1"))
        assert content["id"] == file.parent.name
    campaign = read_campaign(path)
    assert len(campaign.runs) == len(files) >= 2
    assert all(one.imet is not None or one.hyt is not None for one in campaign.runs)
    if write is by_another_labs_bench:
        assert all(one.air is not None and one.reference.humidity_time_constant_s == 0.5 for one in campaign.runs)
        assert campaign.bodies["hyt"] == "lumped"


def test_a_profile_keeps_to_its_schema(tmp_path):
    write_profile(typical_profile(), tmp_path / "p.json")
    jsonschema.validate(json.loads((tmp_path / "p.json").read_text()), schema("sensor-profile-1"))


@pytest.mark.parametrize("name", ["shock-campaign-1", "shock-run-1", "sensor-profile-1", "shock-diagnosis-1"])
def test_the_schemas_are_schemas_and_refuse_what_the_format_does(name):
    content = schema(name)
    jsonschema.Draft202012Validator.check_schema(content)
    validator = jsonschema.Draft202012Validator(content)
    wrong = {
        "shock-campaign-1": {"name": "x", "sensors": {"imet": {"body": "cube"}}},
        "shock-run-1": {"id": "1", "reference": {"humidity_time_constant_s": -1}},
        "sensor-profile-1": {"sensors": {"hyt": {"body": "cube"}}},
        "shock-diagnosis-1": {"campaign": "x", "channels": {"humidity": {"verdict": "described", "causes": []}}},
    }[name]
    right = {"format": content["properties"]["format"]["const"], **wrong}
    assert len(list(validator.iter_errors(right))) == 1


def test_a_run_counts_only_when_all_of_it_is_there(tmp_path):
    (tmp_path / "air.csv.part").mkdir()  # the third table cannot be written
    tables = dict.fromkeys(("imet", "hyt", "air"), table_text({"time_s": [0.0], "temperature_c": [1.0]}))
    with pytest.raises(OSError):
        write_run(tmp_path, run_document("1"), tables)
    assert not (tmp_path / "run.json").exists() and (tmp_path / "hyt.csv").exists()


@pytest.mark.parametrize(
    "wrong",
    [
        lambda path: write_run(path, run_document("1", airflow_m_s=math.nan), {}),
        lambda path: write_run(path, run_document("1"), {"wind": "time_s\n"}),
        lambda path: write_run(path, run_document("1"), {"imet": table_text({"temperature_c": [1.0]})}),
        lambda path: write_run(path, run_document("1"), {"imet": table_text({"time_s": [1.0], "temperature_c": []})}),
        lambda path: write_campaign(path, campaign_document("x", {"imet": {"bead_radius_m": math.inf}})),
    ],
)
def test_what_no_reader_would_take_is_not_written(tmp_path, wrong):
    with pytest.raises(ValueError):
        wrong(tmp_path)
    assert not list(tmp_path.iterdir())
