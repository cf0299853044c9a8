"""A campaign's files as they are read: all that the format allows is, bad input is named by file, line or key."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from shockrig.files.campaign import ReferenceResponse, RunAir, read_campaign
from shockrig.files.errors import InputError


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
        (lambda f: (f / "campaign.json").unlink(), ["campaign.json", "No such file"]),
        (lambda f: (f / "campaign.json").write_text('{"format":\n oops}'), ["campaign.json", "line 2", "JSON"]),
        (lambda f: (f / "campaign.json").write_text("[]"), ["campaign.json", "shock-campaign/1"]),
        (lambda f: (f / "campaign.json").write_bytes(b"\xff\xfe\x00"), ["campaign.json", "UTF-8"]),
        (lambda f: write_json(f / "campaign.json", {"format": "shock-campaign/9"}), ["campaign.json", "key format"]),
        (
            lambda f: write_json(
                f / "campaign.json", {"format": "shock-campaign/1", "sensors": {"imet": {"bead_radius_m": -1}}}
            ),
            ["campaign.json", "sensors.imet.bead_radius_m", "expected 1e-06 to 0.03 (is it in millimetres?)"],
        ),
        (lambda f: (f / "runs/0001/run.json").unlink(), ["runs", "at least one run"]),
        (lambda f: edit_run(f, source=[1, 2]), ["run.json", "key source", "object"]),
        (lambda f: edit_run(f, source__temperature_c="warm"), ["run.json", "source.temperature_c", "'warm'"]),
        (lambda f: edit_run(f, destination=[]), ["run.json", "key destination", "object, found a list"]),
        (lambda f: edit_run(f, transfer=0), ["run.json", "key transfer", "object, found 0"]),
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
        (
            lambda f: (f / "runs/0001/hyt.csv").write_text(
                "time_s,humidity_percent,temperature_c,stale\n0,80,20,0\n0.1,80,20\n0.2,8"  # of 80.05
            ),
            ["hyt.csv", "line 4", "breaks off", "copy it anew"],
        ),
        (lambda f: write_air(f, "time_s,note\n0,1\n1,2\n"), ["air.csv", "line 1", "time_s", "airflow_m_s"]),
        (lambda f: write_air(f, "temperature_c\n20\n20\n"), ["air.csv", "line 1", "time_s"]),
        (lambda f: write_air(f, "time_s,temperature_c\n0,20\n1,warm\n"), ["air.csv", "line 3", "'warm'"]),
        (lambda f: write_air(f, "time_s,temperature_c\n0,20\n1,20\n0.5,20\n"), ["air.csv", "line 4", "goes back"]),
        (lambda f: write_air(f, "time_s,temperature_c\n0,20\n1,\n2,900\n"), ["air.csv", "fewer than two rows"]),
        (lambda f: edit_run(f, reference=5), ["run.json", "key reference", "object, found 5"]),
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
    assert run.reference == ReferenceResponse(0.05, 0.02, 0.0, 0.3)
    assert run.source == run.destination == RunAir(None, None) and run.start_s is None
    assert campaign.to_frame().air_measured.tolist() == [True]
    (small / "runs/0001/air.csv").unlink()
    assert read_campaign(small).to_frame().air_measured.tolist() == [False]


def test_two_instruments_that_wrote_into_one_file_in_turn_are_one_air(small):
    """Rows of one time are one row: of each quantity what came first."""
    write_air(
        small,
        "time_s,temperature_c,humidity_percent\n"
        "0,,30\n0,20,\n0,21,31\n1,,33\n2,22,\n2,,34\n3,,\n3,23,\n4,,900\n4,24,\n5,,\n5,25,\n5,,35\n",
    )
    air = read_campaign(small).runs[0].air
    assert air.time_s.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    np.testing.assert_array_equal(air.values["temperature_c"], [20.0, np.nan, 22.0, 23.0, 24.0, 25.0])
    np.testing.assert_array_equal(air.values["humidity_percent"], [30.0, 33.0, 34.0, np.nan, np.nan, 35.0])
    assert air.dropped == {"empty": 3, "implausible": 1, "repeated_time": 4}


def test_the_body_of_each_sensor_is_read_and_has_its_usual_shape_where_none_is_named(small):
    assert read_campaign(small).bodies == {"imet": "sphere", "hyt": "film"}
    set_body(small, "imet", "cylinder_mean")
    set_body(small, "hyt", "lumped")
    assert read_campaign(small).bodies == {"imet": "cylinder_mean", "hyt": "lumped"}
    assert read_campaign(small).runs[0].reference == ReferenceResponse(0.0, 0.02, 0.0, 0.1)


def test_no_folder_says_what_to_give(tmp_path):
    with pytest.raises(InputError, match="no such campaign folder"):
        read_campaign(tmp_path / "nowhere")
    (tmp_path / "report.html").write_text("")
    with pytest.raises(InputError, match="report.html: is a file; give the folder that holds"):
        read_campaign(tmp_path / "report.html")


def test_a_run_of_a_campaign_names_the_campaign(small):
    with pytest.raises(InputError, match=f"0001: is only a part of a campaign; give {small}$"):
        read_campaign(small / "runs/0001")


def test_absurd_empty_and_repeated_rows_are_dropped_and_counted(small):
    (small / "runs/0001/imet.csv").write_text(
        "time_s,temperature_c,note\n0.0,40.0,a\n0.1,6526.9,b\n0.2,,c\n0.3,40.0,d\n0.3,40.1,e\n,40.0,f\n"
    )
    trace = read_campaign(small).runs[0].imet
    assert trace.time_s.tolist() == [0.0, 0.3]
    assert trace.dropped == {"implausible": 1, "empty": 2, "repeated_time": 1}


def test_a_thermometer_in_an_oven_is_read_and_an_open_contact_is_not(small):
    """By how it gets there: an oven that hovers about 150 degC and goes on to 250, a spike, and a number that stays."""
    oven = [20.0 + 130.0 * (1.0 - 0.9**k) for k in range(60)] + [150.4, 149.8, 150.2, 149.9]
    oven += [250.0 - 100.0 * 0.8**k for k in range(30)]
    readings = [*oven[:30], 700.0, *oven[30:80], *[988.79] * 12, *oven[80:]]
    rows = "".join(f"{k},{one!r}\n" for k, one in enumerate(readings))
    (small / "runs/0001/imet.csv").write_text(f"time_s,temperature_c\n{rows}")
    trace = read_campaign(small).runs[0].imet
    assert trace.values["temperature_c"].tolist() == oven and trace.dropped == {"implausible": 13}


@pytest.mark.parametrize(
    "text",
    [
        "time_s,temperature_c\n0.0,40.0\n0.1,40.01\n0.2,39.99\n",
        "\ufefftime_s , temperature_c\r\n0.0, 40.0\r\n\r\n0.1, 40.01\r\n0.2, 39.99\r\n",
        '"time_s","temperature_c"\n0.0,40.0\n"0.1",40.01\n0.2,39.99\n',
        "time_s,temperature_c,note\n0.0,40.0,\n0.1,40.01,late\n0.2,39.99,\n",
        "time_s,temperature_c\n0.0,40.0\n0.05,\n0.1,40.01\n0.15,nan\n0.2,39.99\n0.25,inf\n",
    ],
    ids=["bare", "blanks and line ends", "quoted", "with words", "with gaps"],
)
def test_a_table_is_the_same_however_it_is_written(small, text):
    """Files of bare numbers are read by another reader than those with words, quotes or gaps."""
    (small / "runs/0001/imet.csv").write_text(text, encoding="utf-8", newline="")
    trace = read_campaign(small).runs[0].imet
    assert trace.time_s.tolist() == [0.0, 0.1, 0.2] and trace.values["temperature_c"].tolist() == [40.0, 40.01, 39.99]


def test_numbers_alone_are_read_without_pandas():
    """Whose import takes longer than a campaign to read."""
    code = (
        "import sys, shockrig; shockrig.read_campaign(shockrig.example('plain-rough')); print('pandas' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.split() == ["False"]


def test_a_folder_of_campaigns_names_those_that_it_holds(small, tmp_path_factory):
    """Several sensors of a log are imported into a campaign each."""
    folder = tmp_path_factory.mktemp("log")
    for sensor in ("inside", "outside"):
        shutil.copytree(small, folder / sensor)
    with pytest.raises(InputError) as raised:
        read_campaign(folder)
    assert str(raised.value).endswith(f"whole campaign.json: {folder / 'inside'}, {folder / 'outside'}")
