"""What must hold of importing other loggers' files: the same recording comes out however it was written."""

import json
from datetime import UTC, datetime, timedelta

import pytest

from shockrig.files.campaign_lock import held
from shockrig.protocols.cli import main

ROWS = [(0.05 + 0.1 * i, round(20 + 0.03 * i, 2), round(40 - 0.02 * i, 2)) for i in range(200)]


def write(path, rows, header="time_s,temperature_c,humidity_percent", delimiter=",", decimal=".", when=str):
    lines = [header] if header else []
    for time_s, *values in rows:
        lines.append(delimiter.join([when(time_s), *(str(v).replace(".", decimal) for v in values)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def run(*arguments):
    return main(["import", *map(str, arguments)])


def columns(path):
    names, *rows = [line.split(",") for line in path.read_text().splitlines()]
    return {name: [float(row[i]) for row in rows] for i, name in enumerate(names)}


DAY = datetime(2026, 5, 1, 12, 0, tzinfo=UTC)
WAYS = {
    "plain": (dict(), (), "10.05"),
    "milliseconds, semicolons, decimal commas, own names": (
        dict(header="Zeit;Temp;Feuchte", delimiter=";", decimal=",", when=lambda t: f"{1000 * t:.0f}"),
        ("--time-unit", "ms", "--imet-time", "Zeit", "--imet-temperature", "Temp", "--hyt-humidity", "Feuchte"),
        "10050",
    ),
    "units in the names": (
        dict(header="Time [ms],Temp [C],RH (%)", when=lambda t: f"{1000 * t:.0f}"),
        (),
        "10050",
    ),
    "ISO times and tabs": (
        dict(header="timestamp\ttemp\trh", delimiter="\t", when=lambda t: (DAY + timedelta(seconds=t)).isoformat()),
        (),
        (DAY + timedelta(seconds=10.05)).isoformat(),
    ),
    "no header, columns by number": (
        dict(header=""),
        ("--imet-time", "1", "--imet-temperature", "2", "--hyt-humidity", "3"),
        "10.05",
    ),
    "a byte-order mark and a comment": (
        dict(header="\ufeff# logger 7\ntime_s,temperature_c,humidity_percent"),
        (),
        "10.05",
    ),
    "German dates": (
        dict(header="time;temp;rh", delimiter=";", when=lambda t: f"{DAY + timedelta(seconds=t):%d.%m.%Y %H:%M:%S.%f}"),
        ("--time-format", "%d.%m.%Y %H:%M:%S.%f"),
        "01.05.2026 12:00:10.050000",
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_every_way_of_writing_gives_the_same_run(tmp_path, way):
    layout, options, start = WAYS[way]
    log = write(tmp_path / "log.csv", ROWS, **layout)
    out = tmp_path / "campaign"
    assert run("--imet", log, "--hyt", log, *options, "--start", start, "--airflow", 5, "--out", out) == 0
    head = json.loads((out / "runs/0001/run.json").read_text())
    assert head["transfer"]["start_s"] == pytest.approx(10.0, abs=1e-6)
    imet, hyt = columns(out / "runs/0001/imet.csv"), columns(out / "runs/0001/hyt.csv")
    assert imet["time_s"] == pytest.approx([t - ROWS[0][0] for t, _, _ in ROWS], abs=1e-4)
    assert imet["temperature_c"] == pytest.approx([row[1] for row in ROWS])
    assert hyt["humidity_percent"] == pytest.approx([row[2] for row in ROWS]) and set(hyt["stale"]) == {0.0}
    assert "temperature_c" not in hyt  # the thermometer's temperature is not the hygrometer's die


def test_what_is_written_can_be_read_by_the_analysis(tmp_path):
    from shockrig.files.campaign import read_campaign

    log = write(tmp_path / "log.csv", ROWS)
    out = tmp_path / "campaign"
    run("--imet", log, "--source-temperature", 20, "--destination-temperature", 26, "--out", out, "--imet-serial", "B7")
    run("--hyt", log, "--out", out)
    campaign = read_campaign(out)
    assert [r.id for r in campaign.runs] == ["0001", "0002"]
    first, second = campaign.runs
    assert first.hyt is None and second.imet is None
    assert first.start_s is None and first.airflow_m_s is None
    assert first.source.temperature_c == 20 and first.source.humidity_percent is None
    assert campaign.sensors["imet"]["serial"] == "B7"
    assert len(second.hyt.time_s) == len(ROWS)


def test_units_are_turned(tmp_path):
    """32 degF is 0 degC, 212 degF is 100 degC; a fraction of 0.4 is 40 %RH."""
    log = write(tmp_path / "log.csv", [(0, 32.0, 0.4), (1, 212.0, 0.5), (2, 50, 0.6)])
    options = ("--temperature-unit", "f", "--humidity-unit", "fraction")
    run("--imet", log, "--hyt", log, *options, "--out", tmp_path / "c")
    assert columns(tmp_path / "c/runs/0001/imet.csv")["temperature_c"] == pytest.approx([0, 100, 10])
    assert columns(tmp_path / "c/runs/0001/hyt.csv")["humidity_percent"] == pytest.approx([40, 50, 60])


def test_units_in_the_names_are_turned(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("Time (min),Temp (F),Humidity (fraction)\n0,32,0.4\n1,212,0.5\n2,50,0.6\n")
    run("--imet", log, "--hyt", log, "--out", tmp_path / "c")
    imet = columns(tmp_path / "c/runs/0001/imet.csv")
    assert imet["temperature_c"] == pytest.approx([0, 100, 10]) and imet["time_s"] == [0, 60, 120]
    assert columns(tmp_path / "c/runs/0001/hyt.csv")["humidity_percent"] == pytest.approx([40, 50, 60])


def test_absurd_and_missing_values_are_left_out_and_counted(tmp_path, capsys):
    rows = [*ROWS[:50], (ROWS[50][0], 20.0, 6526.9), (ROWS[51][0], 20.0, "NaN"), *ROWS[52:]]
    log = write(tmp_path / "log.csv", rows)
    run("--hyt", log, "--out", tmp_path / "c")
    said = capsys.readouterr().err
    assert "1 impossible reading of 'humidity_percent' left out (in line 52)" in said
    assert len(columns(tmp_path / "c/runs/0001/hyt.csv")["time_s"]) == len(ROWS) - 2
    head = json.loads((tmp_path / "c/runs/0001/run.json").read_text())
    assert all(f"hyt: {remark}\n" in said for remark in head["imported"]["hyt"]["remarks"])
    assert len(head["imported"]["hyt"]["remarks"]) == 2


GOOD = ["time_s,temperature_c", *(f"{t:.2f},{v}" for t, v, _ in ROWS)]
ODD = {
    "not a number": (
        [*GOOD[:5], "0.45,2O.1", *GOOD[6:]],
        r"1 cell of .temperature_c. that is no number left out \(in line 6\)",
    ),
    "time goes back": ([*GOOD, GOOD[3]], r"1 row was out of order"),
    "row cut short": ([*GOOD, "99.0"], r"1 line of another number of cells left out \(in line 202\)"),
    "no time": ([*GOOD[:9], ",21", *GOOD[10:]], r"1 row without a time left out \(in line 10\)"),
    "lost power": (
        [*GOOD[:5], "0.45,2\0.1", *GOOD[6:]],
        r"1 cell of .temperature_c. that is no number left out \(in line 6\)",
    ),
    "power on": (
        [*GOOD[:5], "0.45,85.0", *GOOD[6:]],
        r"1 reading of .temperature_c. that is 85 \(DS18B20 before its first conversion .* left out \(in line 6\)",
    ),
}


@pytest.mark.parametrize("fault", ODD)
def test_an_odd_row_is_said_and_costs_no_other(tmp_path, capsys, fault):
    lines, expected = ODD[fault]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(lines))
    assert run("--imet", log, "--out", tmp_path / "campaign") == 0
    message = capsys.readouterr().err
    assert __import__("re").search(expected, message), message
    table = columns(tmp_path / "campaign/runs/0001/imet.csv")
    assert len(table["time_s"]) in (len(ROWS) - 1, len(ROWS))
    assert table["time_s"] == sorted(set(table["time_s"]))


def test_units_under_the_header_are_the_readings(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("time,temperature\ns,degF\n0,32\n1,212\n2,50\n3,32\n")
    assert run("--imet", log, "--out", tmp_path / "c") == 0
    assert columns(tmp_path / "c/runs/0001/imet.csv")["temperature_c"] == pytest.approx([0, 100, 10, 0])


BAD = {
    "the clock is set back": ([*GOOD, *GOOD[1:]], (), r"log.csv: its clock goes back; .* by a map: --look writes one"),
    "column misspelt": (GOOD, ("--imet-temperature", "temperatur_c"), r"did you mean 'temperature_c'"),
    "two temperatures": (
        ["t,temp_a,temp_b", *(f"{t},{v},{v}" for t, v, _ in ROWS)],
        (),
        r"several columns of temperature; name one by --imet-temperature: temp_a, temp_b",
    ),
    "no temperature": (
        ["t,b", "1,2", "2,3"],
        (),
        r"no column of temperature found; name it by --imet-temp",
    ),
    "start outside": (GOOD, ("--start", "50"), r"--start 50 is not within the recording"),
    "start is a date": (GOOD, ("--start", "2026-05-01"), r"--start: '2026-05-01' is no time on this log's clock"),
    "empty": ([], (), r"log.csv: is empty"),
    "header only": (GOOD[:1], (), r"no rows of numbers"),
    "NUL": ([*GOOD[:3], "0.2\0\1,20"], (), r"line 4: holds a NUL"),
    "airflow": (GOOD, ("--airflow", "nan"), r"--airflow nan: expected a number from 0 to 150"),
    "id": (GOOD, ("--id", "../x"), r"--id '../x'"),
    "id of two lines": (GOOD, ("--id", "a\nb"), r"--id 'a\\nb': expected a name"),
}


@pytest.mark.parametrize("fault", BAD)
def test_bad_input_names_the_place_and_leaves_nothing_behind(tmp_path, capsys, fault):
    lines, options, expected = BAD[fault]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(lines))
    assert run("--imet", log, *options, "--out", tmp_path / "campaign") == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert __import__("re").search(expected, message), message
    assert not (tmp_path / "campaign").exists()


def test_a_hygrometers_columns_are_named_by_its_own_options(tmp_path, capsys):
    for first, option in (("x", "--hyt-time"), ("2026-05-01T12:00", "--hyt-humidity")):
        log = write(tmp_path / "log.csv", [(first, 1 + i % 2) for i in range(9)], header="a,b")
        assert run("--hyt", log, "--out", tmp_path / "c") == 2
        assert f"name it by {option} COLUMN" in capsys.readouterr().err
    assert run("--hyt", tmp_path / "none.csv", "--out", tmp_path / "c") == 2
    assert "none.csv: No such file or directory; name a text file" in capsys.readouterr().err


def test_a_campaign_has_one_pair_of_sensors(tmp_path, capsys):
    log, out = write(tmp_path / "log.csv", ROWS), tmp_path / "campaign"
    assert run("--imet", log, "--out", out, "--imet-serial", "A") == 0
    assert run("--imet", log, "--out", out, "--imet-serial", "B") == 2
    assert "sensors.imet.serial is 'A', not 'B'" in capsys.readouterr().err
    assert [p.name for p in (out / "runs").iterdir()] == ["0001"]


def test_two_clocks_are_refused(tmp_path, capsys):
    early = write(tmp_path / "a.csv", ROWS)
    late = write(tmp_path / "b.csv", [(t + 1000, *v) for t, *v in ROWS])
    assert run("--imet", early, "--hyt", late, "--out", tmp_path / "c") == 2
    assert "do not overlap in time" in capsys.readouterr().err


def recorded(path):
    """A campaign of three planned runs of which the second was interrupted."""
    path.mkdir()
    airs = {place: {"temperature_c": 20.0, "humidity_percent": 50.0} for place in ("source", "destination")}
    plan = [{"id": f"{n:04d}", **airs} for n in (1, 2, 3)]
    head = {"format": "shock-campaign/1", "name": "c", "sensors": {"imet": {"kind": "imet-xf"}}, "plan": plan}
    (path / "campaign.json").write_text(json.dumps(head))
    return path


def test_an_imported_run_stands_in_for_no_planned_one(tmp_path, capsys):
    """It has a name that no plan gives; and the campaign keeps the sensors that its recording goes on with."""
    log, campaign = write(tmp_path / "log.csv", ROWS), recorded(tmp_path / "c")
    head = (campaign / "campaign.json").read_bytes()
    for number in (1, 2):
        assert run("--imet", log, "--out", campaign) == 0
        assert (campaign / f"runs/imported-{number:04d}/run.json").is_file()
    assert run("--imet", log, "--id", "0002", "--out", campaign) == 2
    assert "is the place of a run of this campaign's plan" in capsys.readouterr().err
    assert run("--hyt", log, "--out", campaign) == 2
    assert "was recorded without hyt" in capsys.readouterr().err
    assert (campaign / "campaign.json").read_bytes() == head
    assert sorted(p.name for p in (campaign / "runs").iterdir()) == ["imported-0001", "imported-0002"]


def test_a_folder_that_a_recording_holds_takes_no_run(tmp_path, capsys):
    log, campaign = write(tmp_path / "log.csv", ROWS), recorded(tmp_path / "c")
    with held(campaign):
        assert run("--imet", log, "--out", campaign) == 2
    assert "another recording or import is writing to this campaign; wait for it" in capsys.readouterr().err
    assert [p.name for p in campaign.iterdir()] == ["campaign.json"]
    assert run("--imet", tmp_path / "none.csv", "--out", tmp_path / "new") == 2 and not (tmp_path / "new").exists()
