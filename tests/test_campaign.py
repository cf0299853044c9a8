"""Campaigns from files: bad input is named by file, line or key; another program's campaign is read as well as ours."""

import json
import shutil

import numpy as np
import pytest

from shockrig.analysis.characterization.characterize import characterize
from shockrig.analysis.inference.channel import build_channel, usable_runs
from shockrig.files.campaign import Air, Reference, read_campaign
from shockrig.files.errors import InputError

ALPHA, DIFFUSIVITY = 9e-8, {5.0: 5e-12, 25.0: 9e-12}
RADIUS, THICKNESS = 5e-4, 8e-6


def write_json(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content), encoding="utf-8")


@pytest.fixture
def small(tmp_path):
    """A campaign of one run with everything in it; tests break one thing each."""
    write_json(
        tmp_path / "campaign.json", {"format": "shock-campaign/1", "name": "small", "sensors": {"imet": {}, "hyt": {}}}
    )
    write_json(
        tmp_path / "runs/0001/run.json",
        {
            "format": "shock-run/1",
            "id": "0001",
            "source": {"temperature_c": 40.0, "humidity_percent": 20.0},
            "destination": {"temperature_c": 20.0, "humidity_percent": 55.0},
            "airflow_m_s": 6.0,
            "pressure_hpa": 1013.25,
            "transfer": {"start_s": 10.53, "duration_s": 0.4},
        },
    )
    (tmp_path / "runs/0001/imet.csv").write_text("time_s,temperature_c\n0.0,40.0\n0.1,40.01\n0.2,39.99\n")
    (tmp_path / "runs/0001/hyt.csv").write_text(
        "time_s,humidity_percent,temperature_c,stale\n0.05,20.1,40.0,0\n0.15,20.1,40.0,1\n0.25,20.0,40.0,0\n"
    )
    return tmp_path


def edit_run(folder, **changes):
    file = folder / "runs/0001/run.json"
    head = json.loads(file.read_text())
    for key, value in changes.items():
        *above, last = key.split("__")
        place = head
        for name in above:
            place = place[name]
        place[last] = value
    file.write_text(json.dumps(head))


def write_air(folder, text):
    (folder / "runs/0001/air.csv").write_text(text)


def set_body(folder, sensor, body):
    file = folder / "campaign.json"
    head = json.loads(file.read_text())
    head["sensors"][sensor]["body"] = body
    file.write_text(json.dumps(head))


def test_a_whole_campaign_is_read_as_it_stands(small):
    campaign = read_campaign(small)
    run = campaign.runs[0]
    assert (campaign.name, campaign.bead_radius_m, campaign.film_thickness_m) == ("small", 4e-4, 1e-5)
    assert (run.start_s, run.duration_s, run.airflow_m_s) == (10.53, 0.4, 6.0)
    assert run.hyt.time_s.tolist() == [0.05, 0.25]
    assert run.hyt.dropped == {"stale": 1}
    frame = campaign.to_frame()
    assert frame.loc["0001", "destination_humidity_percent"] == 55.0
    assert frame.loc["0001", "imet_samples"] == 3


@pytest.mark.parametrize(
    ("breaking", "words"),
    [
        (lambda f: (f / "campaign.json").unlink(), ["campaign.json", "no such file"]),
        (lambda f: (f / "campaign.json").write_text('{"format":\n oops}'), ["campaign.json", "line 2", "JSON"]),
        (lambda f: (f / "campaign.json").write_text("[]"), ["campaign.json", "shock-campaign/1"]),
        (lambda f: (f / "campaign.json").write_bytes(b"\xff\xfe\x00"), ["campaign.json", "UTF-8"]),
        (lambda f: write_json(f / "campaign.json", {"format": "shock-campaign/9"}), ["campaign.json", "key format"]),
        (
            lambda f: write_json(
                f / "campaign.json", {"format": "shock-campaign/1", "sensors": {"imet": {"bead_radius_m": -1}}}
            ),
            ["campaign.json", "sensors.imet.bead_radius_m", "expected 1e-08 to 1"],
        ),
        (lambda f: (f / "runs/0001/run.json").unlink(), ["runs", "at least one run"]),
        (lambda f: edit_run(f, source=[1, 2]), ["run.json", "key source", "object"]),
        (lambda f: edit_run(f, source__temperature_c="warm"), ["run.json", "source.temperature_c", "'warm'"]),
        (lambda f: edit_run(f, destination=[]), ["run.json", "key destination", "object, found list"]),
        (lambda f: edit_run(f, transfer=0), ["run.json", "key transfer", "object, found int"]),
        (lambda f: edit_run(f, destination__temperature_c=293.15), ["run.json", "destination.temperature_c", "150"]),
        (lambda f: edit_run(f, source__temperature_c=-101), ["run.json", "source.temperature_c", "-100 to 150"]),
        (lambda f: edit_run(f, destination__humidity_percent=400.0), ["run.json", "destination.humidity_percent"]),
        (lambda f: edit_run(f, source__humidity_percent=-5.1), ["run.json", "source.humidity_percent", "-5 to 130"]),
        (lambda f: edit_run(f, airflow_m_s=-2.0), ["run.json", "airflow_m_s"]),
        (lambda f: edit_run(f, airflow_m_s=1e30), ["run.json", "airflow_m_s", "1e+30", "0 to 150"]),
        (lambda f: edit_run(f, pressure_hpa=0), ["run.json", "pressure_hpa"]),
        (lambda f: edit_run(f, pressure_hpa=101325), ["run.json", "pressure_hpa", "1 to 2000"]),
        (lambda f: edit_run(f, transfer__start_s=1e30), ["run.json", "transfer.start_s"]),
        (lambda f: edit_run(f, transfer__duration_s=1e30), ["run.json", "transfer.duration_s", "0 to 3600"]),
        (lambda f: edit_run(f, id="../../x"), ["run.json", "key id", "'../../x'", "0001"]),
        (lambda f: edit_run(f, id="a\nb"), ["run.json", "key id"]),
        (lambda f: edit_run(f, id=["0001"]), ["run.json", "key id"]),
        (lambda f: edit_run(f, id="x" * 101), ["run.json", "key id"]),
        (
            lambda f: shutil.copytree(f / "runs/0001", f / "runs/0002"),
            ["0002/run.json", "key id", "'0001'", "runs/0001"],
        ),
        (lambda f: edit_run(f, transfer__start_s=True), ["run.json", "transfer.start_s", "True"]),
        (lambda f: edit_run(f, transfer__duration_s=-0.1), ["run.json", "transfer.duration_s"]),
        (lambda f: (f / "runs/0001/imet.csv").write_text(""), ["imet.csv", "CSV"]),
        (lambda f: (f / "runs/0001/imet.csv").write_text("time,temp\n1,2\n"), ["imet.csv", "line 1", "time_s"]),
        (
            lambda f: (f / "runs/0001/imet.csv").write_text("time_s,temperature_c\n0,20\n0.1,hot\n"),
            ["imet.csv", "line 3", "temperature_c", "'hot'"],
        ),
        (
            lambda f: (f / "runs/0001/imet.csv").write_text("time_s,temperature_c\n0,20\n0.2,20\n0.1,20\n"),
            ["imet.csv", "line 4", "goes back"],
        ),
        (
            lambda f: (f / "runs/0001/hyt.csv").write_text("time_s,temperature_c\n0,20\n"),
            ["hyt.csv", "line 1", "humidity_percent"],
        ),
        (lambda f: write_air(f, "time_s,note\n0,1\n1,2\n"), ["air.csv", "line 1", "time_s", "airflow_m_s"]),
        (lambda f: write_air(f, "temperature_c\n20\n20\n"), ["air.csv", "line 1", "time_s"]),
        (lambda f: write_air(f, "time_s,temperature_c\n0,20\n1,warm\n"), ["air.csv", "line 3", "'warm'"]),
        (lambda f: write_air(f, "time_s,temperature_c\n0,20\n1,20\n0.5,20\n"), ["air.csv", "line 4", "goes back"]),
        (lambda f: write_air(f, "time_s,temperature_c\n0,20\n1,\n2,900\n"), ["air.csv", "fewer than two rows"]),
        (lambda f: edit_run(f, reference=5), ["run.json", "key reference", "object, found int"]),
        (
            lambda f: edit_run(f, reference={"temperature_time_constant_s": -1}),
            ["run.json", "key reference.temperature_time_constant_s", "0 to 3600"],
        ),
        (
            lambda f: edit_run(f, reference={"humidity_standard_uncertainty_percent": "good"}),
            ["run.json", "key reference.humidity_standard_uncertainty_percent", "'good'"],
        ),
        (lambda f: set_body(f, "imet", "cube"), ["campaign.json", "key sensors.imet.body", "lumped", "'cube'"]),
        (lambda f: set_body(f, "hyt", ["film"]), ["campaign.json", "key sensors.hyt.body", "sphere_mean"]),
    ],
)
def test_bad_input_is_named_with_its_file_and_its_line_or_key(small, breaking, words):
    breaking(small)
    with pytest.raises(InputError) as raised:
        read_campaign(small)
    message = str(raised.value)
    assert "\n" not in message
    assert all(word in message for word in words), message


def test_what_is_not_known_may_be_null_or_left_out(small):
    write_json(small / "campaign.json", {"format": "shock-campaign/1", "sensors": {"imet": None, "hyt": {}}})
    write_json(small / "runs/0002/run.json", {"format": "shock-run/1"})
    unknown = dict.fromkeys(("id", "source", "destination", "airflow_m_s", "pressure_hpa", "transfer"))
    write_json(small / "runs/0003/run.json", {"format": "shock-run/1", **unknown})
    edit_run(small, source=dict.fromkeys(("temperature_c", "humidity_percent")), transfer={"start_s": None})
    campaign = read_campaign(small)
    assert [run.id for run in campaign.runs] == ["0001", "0002", "0003"]
    assert [run.start_s for run in campaign.runs] == [None] * 3
    assert campaign.runs[2].destination.temperature_c is None and campaign.runs[2].pressure_hpa == 1013.25


@pytest.mark.parametrize(
    "possible",
    [
        {"airflow_m_s": 0},
        {"airflow_m_s": 150},
        {"source__temperature_c": -95, "destination__temperature_c": 125},
        {"source__humidity_percent": -0.4, "destination__humidity_percent": 104.5},
        {"pressure_hpa": 10},
        {"transfer__start_s": -1.5, "transfer__duration_s": 0},
        {"id": "run 7, wet_to-dry.2"},
        {"id": 7},
    ],
)
def test_what_can_be_is_read(small, possible):
    edit_run(small, **possible)
    assert len(read_campaign(small).runs) == 1


def test_the_air_as_it_was_measured_is_read_with_what_is_known_of_its_instrument(small):
    for key in ("source", "destination", "transfer"):
        edit_run(small, **{key: None})
    edit_run(small, reference={"temperature_time_constant_s": 0.05, "humidity_standard_uncertainty_percent": 0.3})
    write_air(
        small,
        "time_s,airflow_m_s,temperature_c,pressure_hpa,humidity_percent\n"
        "-1.0,6.0,40.0,,20.0\n0.0,,39.0,,400\n0.5,,,,\n0.5,6.1,,,\n0.7,,38,,21\n0.7,,38,,21\n",
    )
    campaign = read_campaign(small)
    (run,) = campaign.runs
    assert run.air.time_s.tolist() == [-1.0, 0.0, 0.5, 0.7]
    assert list(run.air.values) == ["temperature_c", "humidity_percent", "airflow_m_s"]  # no pressure was ever there
    np.testing.assert_array_equal(run.air.values["temperature_c"], [40.0, 39.0, np.nan, 38.0])
    np.testing.assert_array_equal(run.air.values["humidity_percent"], [20.0, np.nan, np.nan, 21.0])
    np.testing.assert_array_equal(run.air.values["airflow_m_s"], [6.0, np.nan, 6.1, np.nan])
    assert run.air.dropped == {"empty": 1, "implausible": 1, "repeated_time": 1}
    assert run.reference == Reference(0.05, 0.02, 0.0, 0.3)
    assert run.source == run.destination == Air(None, None) and run.start_s is None
    assert campaign.to_frame().air_measured.tolist() == [True]
    (small / "runs/0001/air.csv").unlink()
    assert read_campaign(small).to_frame().air_measured.tolist() == [False]


def test_the_body_of_each_sensor_is_read_and_has_its_usual_shape_where_none_is_named(small):
    assert read_campaign(small).bodies == {"imet": "sphere", "hyt": "film"}
    set_body(small, "imet", "cylinder_mean")
    set_body(small, "hyt", "lumped")
    assert read_campaign(small).bodies == {"imet": "cylinder_mean", "hyt": "lumped"}
    assert read_campaign(small).runs[0].reference == Reference(0.0, 0.02, 0.0, 0.1)


def test_no_folder_says_what_to_give(tmp_path):
    with pytest.raises(InputError, match="no such campaign folder"):
        read_campaign(tmp_path / "nowhere")


def test_absurd_empty_and_repeated_rows_are_dropped_and_counted(small):
    (small / "runs/0001/imet.csv").write_text(
        "time_s,temperature_c,note\n0.0,40.0,a\n0.1,6526.9,b\n0.2,,c\n0.3,40.0,d\n0.3,40.1,e\n,40.0,f\n"
    )
    trace = read_campaign(small).runs[0].imet
    assert trace.time_s.tolist() == [0.0, 0.3]
    assert trace.dropped == {"implausible": 1, "empty": 2, "repeated_time": 1}


def test_runs_that_cannot_be_used_say_why(small):
    (small / "runs/0001/hyt.csv").unlink()
    campaign = read_campaign(small)
    (reason,) = (entry.reason for entry in usable_runs(campaign, "humidity")[1])
    assert reason == "no hyt.csv"
    (reason,) = (entry.reason for entry in usable_runs(campaign, "temperature")[1])
    assert "only 3 usable samples" in reason
    assert build_channel(campaign, "temperature") is None
    with pytest.raises(InputError, match="temperature: none of 1 runs.*humidity: none of 1 runs"):
        characterize(campaign)


# ---- A campaign by another program, from the format's page alone: series summed here, nothing of the project in it.


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
