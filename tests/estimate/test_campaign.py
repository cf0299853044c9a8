"""Campaigns by another program, from the format's page alone, are characterized as well as ours."""

import json

import numpy as np
import pytest

from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.estimate.gather import build_channel, usable_runs
from shockrig.files.campaign import read_campaign
from shockrig.files.errors import InputError

ALPHA, DIFFUSIVITY = 9e-8, {5.0: 5e-12, 25.0: 9e-12}
RADIUS, THICKNESS = 5e-4, 8e-6


def write_json(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content), encoding="utf-8")


# Series summed here: nothing of the project is in these campaigns.


def core(fourier):
    n = np.arange(1, 400)[:, None]
    x = np.maximum(fourier, 0.0)
    return np.where(x > 2e-3, 1 + 2 * np.sum((-1.0) ** n * np.exp(-((n * np.pi) ** 2) * x), axis=0), 0.0)


def mean_uptake(fourier):
    n = 2 * np.arange(400)[:, None] + 1
    x = np.maximum(fourier, 0.0)
    return np.where(fourier > 0, 1 - 8 / np.pi**2 * np.sum(np.exp(-((n * np.pi / 2) ** 2) * x) / n**2, axis=0), 0.0)


def write_foreign(folder, rng, rate_hz=10.0, knows_start=True, knows_airs=True, knows_airflow=True, noise=(0.02, 0.06)):
    """Two ambients, humidity and temperature shocks, as a lab's own script might write them."""
    write_json(
        folder / "campaign.json",
        {
            "format": "shock-campaign/1",
            "operator": "N. N.",
            "sensors": {
                "imet": {"kind": "pt1000", "bead_radius_m": RADIUS, "lot": 7},
                "hyt": {"kind": "sht45", "film_thickness_m": THICKNESS},
            },
        },
    )
    shocks = []
    for t in DIFFUSIVITY:
        shocks += [(t, 30.0, t, 75.0), (t, 75.0, t, 30.0), (t, 35.0, t, 55.0), (t + 18.0, 30.0, t, 50.0)]
    for k, (t0, h0, t1, h1) in enumerate(shocks):
        start = 12.0 + rng.random()
        end = start + 60.0
        run = {"format": "shock-run/1", "transfer": {}, "comment": "ü", "source": {}, "destination": {}}
        if knows_start:
            run["transfer"]["start_s"] = start
        if knows_airs:
            run["source"] = {"temperature_c": t0, "humidity_percent": h0}
            run["destination"] = {"temperature_c": t1, "humidity_percent": h1}
        if knows_airflow:
            run["airflow_m_s"] = 4.0
        name = f"run-{k:02d}"
        write_json(folder / "runs" / name / "run.json", run)
        times = [np.arange(rng.random() / rate_hz, end, 1 / rate_hz) for _ in range(2)]
        times = [t[rng.random(t.size) > 0.02] for t in times]
        bead = (
            t0
            + (t1 - t0) * core((times[0] - start) * ALPHA / RADIUS**2)
            + noise[0] * rng.standard_normal(times[0].size)
        )
        # ppmv of the air held by the film, read at the air's temperature; saturation by Magnus, not by our formula.
        magnus = {t: 6.112 * np.exp(17.62 * t / (243.12 + t)) for t in (t0, t1)}
        rise = mean_uptake((times[1] - start) * DIFFUSIVITY[t1] / THICKNESS**2)
        held = h0 * magnus[t0] + (h1 * magnus[t1] - h0 * magnus[t0]) * rise
        humidity = held / np.where(times[1] > start, magnus[t1], magnus[t0]) + noise[1] * rng.standard_normal(
            times[1].size
        )
        if k != 3:  # a file may be absent
            rows = "".join(f"{t:.4f};{v:.3f}\n" for t, v in zip(times[0], bead, strict=True)).replace(";", ",")
            (folder / "runs" / name / "imet.csv").write_text("time_s,temperature_c\n" + rows)
        if k != 7:
            rows = "".join(f"x,{t:.4f},{v:.4f}\n" for t, v in zip(times[1], humidity, strict=True))
            (folder / "runs" / name / "hyt.csv").write_text("flag,time_s,humidity_percent\n" + rows)
    return folder


@pytest.mark.parametrize(
    ("options", "alpha_within", "d_within"),
    [
        ({}, 0.01, 0.01),
        ({"rate_hz": 20.0}, 0.01, 0.01),
        ({"rate_hz": 1.0}, 0.05, 0.02),
        ({"knows_start": False}, 0.05, 0.03),
        ({"knows_airs": False}, 0.02, 0.02),
        ({"knows_airflow": False}, 0.01, 0.01),
    ],
    ids=["10 Hz", "20 Hz", "1 Hz", "no start", "no airs", "no airflow"],
)
def test_another_programs_campaign_is_characterized_as_well(tmp_path, options, alpha_within, d_within):
    campaign = read_campaign(write_foreign(tmp_path / "lab", np.random.default_rng(8), **options))
    result = characterize(campaign)
    assert campaign.name == "lab"
    (bead,) = result.temperature.rows
    assert bead.diffusivity_m2_s == pytest.approx(ALPHA, rel=alpha_within)
    assert abs(bead.diffusivity_m2_s - ALPHA) < 3.5 * bead.standard_uncertainty
    assert [round(row.ambient_c) for row in result.humidity.rows] == [5, 25]
    for row in result.humidity.rows:
        true = DIFFUSIVITY[round(row.ambient_c)]
        assert row.diffusivity_m2_s == pytest.approx(true, rel=d_within)
        assert abs(row.diffusivity_m2_s - true) < 3.5 * row.standard_uncertainty
    assert result.temperature.explained and result.humidity.explained
    assert {entry.run for entry in result.temperature.set_aside} >= {"run-03", "run-00"}


def test_one_sensor_alone_is_characterized_and_the_other_is_explained(tmp_path):
    folder = write_foreign(tmp_path / "lab", np.random.default_rng(9))
    for file in folder.glob("runs/*/hyt.csv"):
        file.unlink()
    result = characterize(read_campaign(folder))
    assert result.humidity is None
    assert "no hyt.csv" in result.missing["humidity"]
    assert result.temperature.rows[0].diffusivity_m2_s == pytest.approx(ALPHA, rel=0.01)


def test_runs_that_cannot_be_used_say_why(tmp_path):
    write_json(tmp_path / "campaign.json", {"format": "shock-campaign/1", "sensors": {"imet": {}, "hyt": {}}})
    airs = {"source": {"temperature_c": 40.0}, "destination": {"temperature_c": 20.0}}
    write_json(tmp_path / "runs/0001/run.json", {"format": "shock-run/1", **airs, "transfer": {"start_s": 10.5}})
    (tmp_path / "runs/0001/imet.csv").write_text("time_s,temperature_c\n0.0,40.0\n0.1,40.01\n0.2,39.99\n")
    campaign = read_campaign(tmp_path)
    (reason,) = (entry.reason for entry in usable_runs(campaign, "humidity")[1])
    assert reason == "no hyt.csv"
    (reason,) = (entry.reason for entry in usable_runs(campaign, "temperature")[1])
    assert "only 3 usable samples" in reason
    assert build_channel(campaign, "temperature") is None
    with pytest.raises(InputError, match="temperature: the only run cannot.*humidity: the only run cannot"):
        characterize(campaign)
