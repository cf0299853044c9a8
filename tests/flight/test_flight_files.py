"""Flights through files and commands: every cell kept, columns recognised, blocks joined without a seam, bad input
refused.
"""

import csv
import json
import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import shockrig
from shockrig.analysis.flight import screen
from shockrig.analysis.flight.columns import held
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.simulated.scenes import to_flight as frame_to_flight
from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import convective, frontal
from shockrig.analysis.flight.stream import correct_file
from shockrig.files.errors import InputError
from shockrig.files.flight import FLAGS, OUTPUT_COLUMNS, read_layout
from shockrig.files.flight_rows import to_flight
from shockrig.files.profile import write_profile
from shockrig.protocols.cli import main

PROFILE = typical_profile()


@pytest.fixture(scope="module")
def flown():
    return fly(frontal(lead_m=1350.0), PROFILE, 1)


@pytest.fixture
def folder(tmp_path, flown):
    flown.log.to_csv(tmp_path / "flight.csv", index=False)
    write_profile(PROFILE, tmp_path / "profile.json")
    return tmp_path


def cells(path):
    with open(path, newline="") as stream:
        return list(csv.reader(stream))


def run(folder, *arguments, out="out.csv", page=False):
    arguments = arguments if page else ("--no-report", *arguments)
    files = [str(folder / "flight.csv"), "--profile", str(folder / "profile.json"), "--out", str(folder / out)]
    return main(["correct", *files, *arguments])


def test_console_page_and_notebook_state_one_uncertainty(folder, capsys):
    """The first seconds know least and would make up a mean: all three state the median."""
    assert run(folder, page=True) == 0
    said = re.findall(r"standard uncertainty ([\d.]+ (?:K|%RH))", capsys.readouterr().out)
    page = (folder / "out.html").read_text(encoding="utf-8")
    assert re.findall(r"<small>standard uncertainty ([\d.]+ (?:K|%RH))<", page) == said and len(said) == 2
    result = repr(shockrig.correct(folder / "flight.csv", folder / "profile.json"))
    assert all(f"standard uncertainty {one}" in result for one in said)


def test_a_log_of_a_row_in_minutes_has_its_page(folder):
    """A spectrum of two minutes would have one row in it, and no frequency."""
    rows = [f"{100 * i},{20 + 3 * np.sin(i / 9):.2f},{50 + 5 * np.cos(i / 7):.1f}" for i in range(300)]
    (folder / "flight.csv").write_text("\n".join(["time_s,temperature_c,humidity_percent", *rows]))
    assert run(folder, page=True) == 0
    assert "−5/3" in (folder / "out.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("rows", [2, 3, 4, 5])
def test_a_log_that_ends_after_a_few_rows_is_given_as_it_came(folder, flown, capsys, rows):
    """Two or three are too few for the differences by which noise is judged, and were a traceback."""
    flown.log[:rows].to_csv(folder / "flight.csv", index=False)
    assert run(folder, page=True) == 0
    assert "too few usable samples" in capsys.readouterr().err
    given, read = pd.read_csv(folder / "out.csv"), flown.log[:rows]
    assert np.allclose(given["temperature_corrected_c"], read["temperature_c"], atol=1e-4)
    assert given["flags"].str.contains("not_corrected").all()


def test_every_column_and_row_is_kept_as_it_came_and_the_new_ones_follow(folder, flown):
    rows = cells(folder / "flight.csv")
    rows[0] += ["remark", "battery_v"]
    for i, row in enumerate(rows[1:]):
        row += ['a "quoted", remark' if i == 3 else "", f"{11.1 - 0.001 * i:.3f}0"]
    rows[5][1] = ""
    rows[9][2] = "n/a"
    with open(folder / "flight.csv", "w", newline="") as stream:
        csv.writer(stream).writerows(rows)
    assert run(folder, page=True) == 0
    out = cells(folder / "out.csv")
    assert [row[:-5] for row in out] == rows
    assert tuple(out[0][-5:]) == OUTPUT_COLUMNS
    assert all("gap" in out[row][-1].split("|") for row in (5, 9))
    assert not any("gap" in row[-1] for i, row in enumerate(out) if i not in (5, 9))
    assert all(set(filter(None, row[-1].split("|"))) <= set(FLAGS) for row in out[1:])
    result = correct(frame_to_flight(pd.read_csv(folder / "flight.csv").replace("n/a", np.nan)), PROFILE)
    given = np.array([float(row[-5]) for row in out[1:]])
    np.testing.assert_allclose(given, result.temperature_c, atol=1e-4)
    assert sorted(p.name for p in folder.iterdir()) == ["flight.csv", "out.csv", "out.html", "profile.json"]


def test_netcdf_says_the_same_with_its_units(folder):
    import netCDF4

    assert run(folder) == 0
    assert run(folder, out="out.nc") == 0
    table = pd.read_csv(folder / "out.csv", keep_default_na=True)
    with netCDF4.Dataset(folder / "out.nc") as data:
        assert data.Conventions.startswith("CF-") and data["time"].units == "s"
        assert (data["pressure_hpa"].units, data["altitude_m"].units, data["altitude_m"].positive) == ("hPa", "m", "up")
        for name in (*OUTPUT_COLUMNS[:4], "temperature_c", "humidity_percent", "airspeed_m_s", "time_s"):
            np.testing.assert_allclose(data[name][:], table[name], atol=1e-4)
        corrected = data["temperature_corrected_c"]
        assert (corrected.units, corrected.standard_name) == ("degC", "air_temperature")
        assert set(corrected.ancillary_variables.split()) <= set(data.variables)
        assert data["humidity_corrected_percent"].standard_name == "relative_humidity"
        flags = data["flags"]
        masks = dict(zip(flags.flag_meanings.split(), flags.flag_masks, strict=True))
        repeated = table["flags"].fillna("").str.contains("repeated").to_numpy()
        assert np.array_equal((flags[:] & masks["repeated"]) > 0, repeated)
        assert repeated.any()


def test_rows_of_one_whole_second_are_spread_over_it(folder):
    """A logger of 10 Hz whose clock writes seconds: nine readings in ten are not repeats."""
    log = pd.read_csv(folder / "flight.csv")
    log["time_s"] = np.floor(log["time_s"])
    log.to_csv(folder / "seconds.csv", index=False)
    sigma = []
    for name in ("flight.csv", "seconds.csv"):
        command = ["correct", str(folder / name), "--profile", str(folder / "profile.json")]
        assert main([*command, "--out", str(folder / "out.csv")]) == 0
        sigma.append(float(np.nanmedian(pd.read_csv(folder / "out.csv")["temperature_uncertainty_k"])))
    assert sigma[1] == pytest.approx(sigma[0], rel=0.1)


def test_stamps_are_read_as_pandas_reads_them_and_need_no_pandas(folder):
    """Nor half of SciPy: their import takes longer than the correction."""
    log = pd.read_csv(folder / "flight.csv")[:300]
    stamps = pd.Timestamp("2026-05-05T06:30:00Z") + pd.to_timedelta(log.pop("time_s"), unit="s")
    log.insert(0, "time", stamps.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ"))
    log.loc[7, "time"] = ""
    log.to_csv(folder / "stamps.csv", index=False)
    read = to_flight([row for row in cells(folder / "stamps.csv")[1:]], read_layout(folder / "stamps.csv"))
    expected = (pd.to_datetime(log["time"], utc=True) - pd.Timestamp(0, tz="UTC")).dt.total_seconds()
    assert np.allclose(read.time_s, expected, rtol=0.0, atol=1e-6, equal_nan=True)
    assert np.isnan(read.time_s[7])
    arguments = ["correct", "stamps.csv", "--profile", "profile.json", "--no-report", "--out", "out.csv"]
    code = (
        "import sys; from shockrig.protocols.cli import main; "
        f"assert main({arguments!r}) == 0; assert not {{'pandas', 'scipy.signal', 'scipy.stats'}} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], cwd=folder, check=True, capture_output=True)


@pytest.mark.parametrize("method", ["smoother", "inverse", "paper"])
def test_every_method_runs_from_the_command_line(folder, flown, method, capsys):
    assert run(folder, "--method", method, page=True) == 0
    assert method in capsys.readouterr().out
    corrected = pd.read_csv(folder / "out.csv")["temperature_corrected_c"]
    signals = (corrected, flown.log["temperature_c"])
    error, raw_error = (np.sqrt(np.mean((v - flown.truth["temperature_c"]) ** 2)) for v in signals)
    assert error < 0.4 * raw_error


def test_blocks_join_without_a_seam(tmp_path):
    flown = fly(convective(np.random.default_rng(2), duration_s=600.0), PROFILE, 2)
    flown.log.to_csv(tmp_path / "flight.csv", index=False)
    for name, rows in (("whole.csv", 20_000), ("blocks.csv", 2000)):
        correct_file(tmp_path / "flight.csv", PROFILE, tmp_path / name, block_rows=rows)
    whole, blocks = (pd.read_csv(tmp_path / name) for name in ("whole.csv", "blocks.csv"))
    assert len(whole) == len(blocks) == len(flown.log)
    for channel, unit in (("temperature", "k"), ("humidity", "percent")):
        column = f"{channel}_corrected_{'c' if unit == 'k' else unit}"
        away = np.abs(whole[column] - blocks[column]) / whole[f"{channel}_uncertainty_{unit}"]
        assert away.quantile(0.99) < 0.2
        assert away.max() < 1.0


def test_what_is_doubted_in_a_long_log_is_said_once(tmp_path):
    """Before: once in every 30,000 rows of it, each time with other numbers."""
    time_s = np.arange(9000.0)
    hot = 60.0 + 0.002 * time_s + 0.02 * np.random.default_rng(1).standard_normal(9000)
    pd.DataFrame({"time_s": time_s, "temperature_c": hot}).to_csv(tmp_path / "log.csv", index=False)
    done = correct_file(tmp_path / "log.csv", PROFILE, tmp_path / "out.csv", block_rows=3000)
    assert len([note for note in done.notes if note.startswith("temperature_c: half of the readings")]) == 1


def test_what_a_file_holds_is_told_once_and_said_as_of_arrays(tmp_path, monkeypatch):
    flown = fly(convective(np.random.default_rng(2), duration_s=120.0), PROFILE, 2)
    flown.log.loc[50:60, "temperature_c"] = -999.0
    flown.log.to_csv(tmp_path / "flight.csv", index=False)
    told = []
    monkeypatch.setattr(screen, "held", lambda *given: told.append(given) or held(*given))
    said = correct_file(tmp_path / "flight.csv", PROFILE, tmp_path / "out.csv").notes
    assert len(told) == 1
    of_arrays = correct(frame_to_flight(flown.log), PROFILE)
    assert any("-999" in note for note in said) and set(of_arrays.notes) <= set(said)
    written = pd.read_csv(tmp_path / "out.csv")["temperature_corrected_c"]
    assert np.allclose(written, of_arrays.temperature_c, atol=1e-3, equal_nan=True)


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("Time,Temp,RH", {}),
        ("time_us,tdry,rh,pres,alt", {}),
        ("XQ-iMet-XQ Time,XQ-iMet-XQ Air Temperature,XQ-iMet-XQ Humidity,XQ-iMet-XQ Humidity Temp", {}),
        ("Elapsed Time (s),Air Temperature (°C),Relative Humidity (%),Airspeed (m/s)", {}),
        ("wann,warm,feucht", {"time": "wann", "temperature": "warm", "humidity": "feucht"}),
    ],
)
def test_columns_are_recognised_or_named(tmp_path, header, columns):
    path = tmp_path / "log.csv"
    path.write_text(header + "\n" + ",".join(["1"] * (header.count(",") + 1)) + "\n")
    place = read_layout(path, columns).place
    assert (place["time"], place["temperature"], place["humidity"]) == (0, 1, 2)


def test_raw_xq2_lines_are_read(tmp_path):
    path = tmp_path / "log.csv"
    line = "XQ,+095188,+2407,+0294,+2553,2015/10/18,00:38:{:02d},+0000000000,+0000000000,-00017000,00\r\n"
    path.write_bytes(b"\0\0" + "".join(line.format(s) for s in range(40, 45)).encode())
    layout = read_layout(path)
    flight = to_flight(cells_of(path), layout)
    np.testing.assert_allclose(np.diff(flight.time_s), 1.0)
    assert flight.temperature_c[0] == pytest.approx(24.07)
    assert flight.humidity_percent[0] == pytest.approx(29.4)
    assert flight.die_temperature_c[0] == pytest.approx(25.53)


def cells_of(path):
    return list(csv.reader(path.read_text().replace("\0", "").splitlines()))


def test_clocks_in_other_units_become_seconds(tmp_path):
    clocks = (
        ("time_us", "1000000", "1100000"),
        ("time_ms", "1000", "1100"),
        ("time", "2026-05-01T00:00:01Z", "2026-05-01T00:00:01.100Z"),
        ("time", "2026_5_1_0_0_1", "2026_5_1_0_0_1.1"),
        ("time", "1777593601000", "1777593601100"),
    )
    for header, first, second in clocks:
        path = tmp_path / "log.csv"
        path.write_text(f"{header},temperature_c\n{first},20\n{second},20\n")
        flight = to_flight(cells(path)[1:], read_layout(path))
        assert np.diff(flight.time_s) == pytest.approx([0.1], abs=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("a,b\n1,2\n", "time"),
        ("time_s,b\n1,2\n", "temperature"),
        ("time_s,temperature_c\n", "no rows"),
        ("time_s,temperature_c\n1,20,30\n", "line 2"),
        ("time_s,temperature_c,flags\n1,20,\n", "already"),
        ("time_s,temperature_c\nx,20\ny,21\n", "time_s"),
        ("time,temperature_c\n2_0,20\n2_1,21\n", "line 2: time is '2_0'"),
        ("time,temperature_c\n3e11,20\n4e11,21\n", "line 2: column 'time': '3e11' is no time"),
    ],
)
def test_bad_flights_are_refused_in_one_line_and_leave_nothing(folder, capsys, text, said):
    (folder / "flight.csv").write_text(text)
    before = sorted(p.name for p in folder.iterdir())
    assert run(folder) == 2
    message = capsys.readouterr().err.strip()
    assert said in message and "flight.csv" in message and "\n" not in message
    assert sorted(p.name for p in folder.iterdir()) == before


def broken(folder, **cells_by_row):
    """Rewrite lines of flight.csv: `line_17="x,y"` is what stands there; the rest stays."""
    lines = (folder / "flight.csv").read_text().splitlines()
    for line, text in cells_by_row.items():
        lines[int(line.removeprefix("line_")) - 1] = text
    (folder / "flight.csv").write_text("\n".join(lines) + "\n")
    return len(lines) - 1


def test_damaged_rows_are_treated_as_missing_and_counted(folder, capsys):
    rows = cells(folder / "flight.csv")
    text, short, clock = list(rows[16]), rows[20][:2], list(rows[30])
    text[1], clock[0] = "2O.1", "1.2.3"
    count = broken(folder, line_17=",".join(text), line_21=",".join(short), line_31=",".join(clock))
    assert run(folder, page=True) == 0
    error = capsys.readouterr().err
    assert f"3 of {count} rows could not be read as numbers throughout and are treated as missing there" in error
    assert "(first: line 17: temperature_c is '2O.1')" in error
    out = cells(folder / "out.csv")
    assert len(out) == count + 1 and out[16][:3] == text[:3]
    assert "gap" in out[16][-1].split("|") and "gap" in out[20][-1].split("|")
    assert run(folder, out="out.nc") == 0 and f"3 of {count} rows" in capsys.readouterr().err


def test_a_pressure_in_pascal_is_said_and_taken_as_such(folder, flown, capsys):
    log = flown.log.assign(pressure_hpa=1000.0)
    log.to_csv(folder / "flight.csv", index=False)
    assert run(folder) == 0
    right = pd.read_csv(folder / "out.csv")
    log.assign(pressure_hpa=100000.0).to_csv(folder / "flight.csv", index=False)
    assert run(folder, out="pascal.csv") == 0
    assert "pressure_hpa: no air has so much; taken as Pa" in capsys.readouterr().err
    found = pd.read_csv(folder / "pascal.csv")
    for name in OUTPUT_COLUMNS[:2]:
        assert np.allclose(found[name], right[name], equal_nan=True)


def test_empty_cells_are_no_damage(folder, capsys):
    rows = cells(folder / "flight.csv")
    for line, cell in enumerate(("", " ", "NaN", "N/A", "--", "inf", "1e999"), start=5):
        rows[line][2] = cell
    with open(folder / "flight.csv", "w", newline="") as stream:
        csv.writer(stream).writerows([[*row, ""] for row in rows])  # a comma at the end of every line, header and all
    assert run(folder, page=True) == 0
    assert "could not be read" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "first"),
    [
        (lambda row: [row[0], "ERR", *row[2:]], "line 2: temperature_c is 'ERR'"),
        (lambda row: row[:1], "line 2: 1 of"),
        (lambda row: [row[0], *(cell.replace(".", ",") for cell in row[1:])], "line 2: temperature_c is"),
    ],
    ids=["text", "short", "decimal commas"],
)
def test_a_log_of_which_more_than_half_cannot_be_read_is_refused(folder, capsys, change, first):
    header, *rows = cells(folder / "flight.csv")
    bad = len(rows) // 2 + 1
    with open(folder / "flight.csv", "w", newline="") as stream:
        csv.writer(stream).writerows([header, *map(change, rows[:bad]), *rows[bad:]])
    assert run(folder) == 2
    error = capsys.readouterr().err
    assert f"flight.csv: {bad} of {len(rows)} rows could not be read as numbers (first: {first}" in error
    assert "--column QUANTITY=NAME" in error and error.count("\n") == 1
    assert sorted(p.name for p in folder.iterdir()) == ["flight.csv", "profile.json"]


def test_a_column_beside_the_readings_that_cannot_be_read_is_said_and_the_flight_corrected(folder, capsys):
    header, *rows = cells(folder / "flight.csv")
    at = header.index("airspeed_m_s")
    for row in rows:
        row[at] = "none seen"
    with open(folder / "flight.csv", "w", newline="") as stream:
        csv.writer(stream).writerows([header, *rows])
    assert run(folder, page=True) == 0
    # which column that is: it had been said of the rows "throughout"
    said = f"{len(rows)} of {len(rows)} rows could not be read as numbers in 'airspeed_m_s' and are treated as missing"
    assert said in capsys.readouterr().err


def test_bad_arguments_are_refused(folder, capsys):
    assert run(folder, "--column", "colour=red") == 2
    assert run(folder, "--column", "temperature=nothing") == 2
    assert run(folder, "--cutoff-hz", "-1") == 2
    assert run(folder, out="flight.csv") == 2
    assert run(folder, out="missing/out.csv") == 2
    (folder / "profile.json").write_text("{}")
    assert run(folder) == 2
    assert sorted(p.name for p in folder.iterdir()) == ["flight.csv", "profile.json"]


def test_the_log_is_never_touched(folder):
    before = (folder / "flight.csv").read_bytes()
    assert run(folder) == 0
    assert (folder / "flight.csv").read_bytes() == before
    with pytest.raises(InputError):
        correct_file(folder / "flight.csv", PROFILE, folder / "flight.csv")


def test_simulate_then_correct_from_the_command_line(tmp_path, capsys):
    arguments = [
        "simulate",
        "inversion",
        "--out",
        str(tmp_path),
        "--seed",
        "3",
        "--set",
        "top_m=300",
        "--set",
        "base_m=130",
    ]
    assert main(arguments) == 0
    flight, truth = (pd.read_csv(tmp_path / name) for name in ("flight.csv", "truth.csv"))
    assert len(flight) == len(truth) == 601
    assert json.loads((tmp_path / "profile.json").read_text())["format"] == "sensor-profile/1"
    out = tmp_path / "corrected.csv"
    assert (
        main(["correct", str(tmp_path / "flight.csv"), "--profile", str(tmp_path / "profile.json"), "--out", str(out)])
        == 0
    )
    corrected = pd.read_csv(out)["humidity_corrected_percent"]
    assert np.std(corrected - truth["humidity_percent"]) < 0.2 * np.std(
        flight["humidity_percent"] - truth["humidity_percent"]
    )
    for bad in (["--set", "colour=1"], ["--set", "top_m=x"], ["--set", "ascent_m_s=0"], ["--seed", "-1"]):
        assert main(["simulate", "inversion", "--out", str(tmp_path / "no"), *bad]) == 2
    assert "expected" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


@pytest.mark.parametrize("command", [["simulate", "inversion"], ["demo-flights"], ["slips"]])
def test_an_out_that_is_a_file_is_refused_before_the_work(tmp_path, capsys, command):
    (tmp_path / "afile").write_text("mine")
    assert main([*command, "--out", str(tmp_path / "afile")]) == 2
    said = capsys.readouterr()
    assert "afile: is a file; name a folder" in said.err and said.err.count("\n") == 1 and not said.out
    assert (tmp_path / "afile").read_text() == "mine"


@pytest.mark.parametrize("out", ["new/folder", "there"])
def test_a_simulation_that_the_disk_has_no_room_for_leaves_nothing(tmp_path, out):
    """A limit on file size instead of a full disk."""
    (tmp_path / "there").mkdir()
    (tmp_path / "there/flight.csv").write_text("an older one")
    before = sorted(tmp_path.rglob("*"))
    words = ["simulate", "inversion", "--out", str(tmp_path / out), "--set", "top_m=150"]
    done = subprocess.run(
        [sys.executable, "-m", "shockrig", *words],
        cwd=Path(__file__).parents[2],
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (5_000, 5_000)),
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 2 and "File too large" in done.stderr and done.stderr.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before and (tmp_path / "there/flight.csv").read_text() == "an older one"


def test_a_simulation_keeps_what_else_is_in_its_folder(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert main(["simulate", "inversion", "--out", str(tmp_path), "--set", "top_m=150"]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["flight.csv", "notes.txt", "profile.json", "truth.csv"]


def test_demo_flights_writes_one_page(tmp_path, capsys):
    assert main(["demo-flights", "--out", str(tmp_path)]) == 0
    page = (tmp_path / "report.html").read_text()
    assert "smoother" in page and "−5/3" in page and "<script" not in page
    assert capsys.readouterr().out.count("smoother") == 6
