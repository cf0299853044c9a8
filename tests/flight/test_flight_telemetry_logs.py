"""Logs of telemetry as small teams decode it: signs that were lost, names of structures, lines without a name."""

import numpy as np
import pandas
import pytest

from shockrig.analysis.flight.screen import without_codes
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.files import sentinels
from shockrig.files.flight import Flight
from shockrig.files.profile import write_profile
from shockrig.files.ranges import RANGES
from shockrig.files.unit_names import is_called_time, quantity_of
from shockrig.protocols.cli import main

ROW = np.arange(300)
COOLING = np.round(12.0 - 0.1 * ROW, 2)


def run(tmp_path, capsys, text, *arguments):
    write_profile(typical_profile(), tmp_path / "profile.json")
    (tmp_path / "log.csv").write_text(text)
    command = ["correct", str(tmp_path / "log.csv"), "--profile", str(tmp_path / "profile.json"), "--no-report"]
    status = main([*command, "--out", str(tmp_path / "out.csv"), *arguments])
    return status, capsys.readouterr().err


def log(names, *columns):
    return "\n".join([names, *(",".join(map(str, row)) for row in zip(*columns, strict=True))]) + "\n"


def corrected(tmp_path):
    return pandas.read_csv(tmp_path / "out.csv")


def flight(**columns):
    unknown = dict.fromkeys(("airspeed_m_s", "die_temperature_c", "pressure_hpa"), np.full(ROW.size, np.nan))
    first = {"time_s": 1.0 * ROW, "temperature_c": COOLING, "humidity_percent": 40.0 + 0.01 * ROW}
    return Flight(**first | unknown | columns)


@pytest.mark.parametrize("span", [256.0, 655.36, 4096.0, 6553.6])
def test_temperatures_below_zero_that_lost_their_sign_have_it_again(span):
    """Before: 642.52 degC for -12.84, absurd from the first frost on, and beside it humidities were temperatures."""
    changed, found = without_codes(flight(temperature_c=np.where(COOLING < 0.0, COOLING + span, COOLING)))
    known = np.abs(COOLING) > 0.15  # of tenths a reading of -0.1 has all bits set, as a bus that is dead
    np.testing.assert_allclose(changed.temperature_c[known], COOLING[known])
    assert f"temperature below 0 without a sign {span:g}" in found


def test_an_oven_has_its_sign():
    oven = np.linspace(20.0, 250.0, 300)
    assert not sentinels.without_sign(oven, RANGES["temperature_c"])[1].any()
    stuck = np.where(ROW > 200, 655.35, COOLING)  # a bus that nothing answers on
    assert not sentinels.without_sign(stuck, RANGES["temperature_c"])[1].any()


def test_the_sign_is_said_of_a_log_that_is_read_by_a_guess(tmp_path, capsys):
    unsigned = np.where(COOLING < 0.0, np.round(COOLING + 655.36, 2), COOLING)
    status, said = run(
        tmp_path,
        capsys,
        log("reported_at;temperature;rh", [f"{1664268295066 + 30000 * k};{t};40.{k}" for k, t in enumerate(unsigned)]),
    )
    assert status == 0 and "readings of 'temperature' below 0 without a sign: 655.36 are taken off" in said
    assert np.nanmin(corrected(tmp_path).temperature_corrected_c) < -15.0


def test_a_clock_that_counts_minutes_goes_behind_one_that_goes_on(tmp_path, capsys):
    """Before: the uptime in minutes was read as seconds, and its rows came "every 0.5 s"."""
    names = "uptime,reported_at,temperature,rh"
    status, said = run(tmp_path, capsys, log(names, ROW // 2, 1664268295066 + 30_000 * ROW, COOLING, 40 + 0.01 * ROW))
    assert status == 0 and "time 'reported_at'" in said
    np.testing.assert_allclose(np.diff(corrected(tmp_path).time_s), 30.0)


def test_a_pressure_of_a_balloon_is_told_where_it_was_high(tmp_path, capsys):
    """Before: by its median, 26 hPa in Pa, so in hPa, and most of it was none."""
    pressure = np.round(99_930 * np.exp(-ROW / 40.0) + 1500).astype(int)
    text = log("reported_at,temperature,pressure", 1664268295 + 30 * ROW, COOLING, pressure)
    status, said = run(tmp_path, capsys, text)
    assert status == 0 and "pressure 'pressure' in Pa" in said and "impossible" not in said
    assert corrected(tmp_path).pressure_hpa.iloc[0] == pytest.approx(1014.3, abs=0.1)


def test_a_height_of_nothing_where_no_position_is_known_is_none():
    lost = ROW > 150
    height = np.where(lost, 0.0, 100.0 * ROW)
    place = np.where(lost, np.nan, 51.0)
    changed, found = without_codes(flight(altitude_m=height, latitude_deg=place, longitude_deg=place))
    np.testing.assert_array_equal(found["altitude 0"], lost)
    assert np.nanmax(changed.altitude_m) == 15_000.0
    changed, found = without_codes(flight(altitude_m=height))
    assert "altitude 0" not in found


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("barometer_data.temperature", "temperature"),
        ("barometer_temperature", "temperature"),
        ("baro.pressure", "pressure"),
        ("temperature_compensated_pressure", "pressure"),
        ("battery.temperature", None),
        ("rel. humidity", "humidity"),
    ],
)
def test_what_a_structure_is_called_says_who_read_it(name, quantity):
    """Before: what a barometer's temperature is called was a pressure."""
    assert quantity_of(name, None) == quantity
    assert not is_called_time(name)


@pytest.mark.parametrize("name", ["barometer_data.timeStamp_barometer", "gps.time"])
def test_times_of_structures_are_times(name):
    assert is_called_time(name)


def test_columns_of_a_structure_are_read(tmp_path, capsys):
    names = "baro.timeStamp_baro,has_baro,baro.temperature,baro.altitude,baro.pressure"
    text = log(names, 2 * ROW, ROW // ROW.clip(1), COOLING, 7.0 * ROW, np.round(1000.0 * np.exp(-ROW / 1100.0), 2))
    status, said = run(tmp_path, capsys, text)
    assert status == 0 and "temperature 'baro.temperature', pressure 'baro.pressure', altitude 'baro.altitude'" in said


def test_a_blank_line_above_the_names_makes_no_file_empty(tmp_path, capsys):
    """Before: "the file is empty", of a log of 3000 lines."""
    status, said = run(tmp_path, capsys, "\n" + log("time,temperature,humidity", ROW, COOLING, 40 + 0.01 * ROW))
    assert status == 0 and "read as shockrig import reads it" in said
    status, said = run(tmp_path, capsys, "\n" + "\n".join(f"T{20.0 + k}P983.8" for k in range(50)))
    assert status == 2 and "line 1: is blank" in said and "empty" not in said


def test_columns_behind_the_last_name_have_none(tmp_path, capsys):
    """A thermistor beside the pixels of a camera under one name: no line of names was found."""
    pixels = [",".join(["17.5"] * 20)] * ROW.size
    names = "Example of a log.\ndate,time,latitude,longitude,thermistor_c,camera"
    clock = [f"15:{40 + s // 60}:{s % 60:02d}:000" for s in ROW]
    text = log(names, ["6/17/23"] * ROW.size, clock, 39.5 + 1e-5 * ROW, -121.0 - 1e-5 * ROW, COOLING, pixels)
    status, said = run(tmp_path, capsys, text)
    assert status == 0 and "time 'date' and 'time', temperature 'thermistor_c'" in said
    np.testing.assert_allclose(np.diff(corrected(tmp_path).time_s), 1.0)


def test_a_unit_that_the_readings_tell_is_said(tmp_path, capsys):
    text = log("t;NTC", [f"{k};{round(285.15 - 0.01 * k, 2)}" for k in ROW])
    status, said = run(tmp_path, capsys, text)
    assert status == 0 and "temperature 'NTC' in K" in said


def test_columns_that_a_person_names_are_what_they_are_called(tmp_path, capsys):
    """A hot box on the ground for most of a log. Before: "name them with --column", and it was refused as before."""
    box = np.interp(ROW, [0, 40, 110, 130], [50.0, 20.0, 20.0, 60.0]) + 0.05 * np.sin(ROW)
    text = log("time,temp,rh", ROW, np.round(box, 2), np.round(14.0 + 0.3 * np.sin(ROW / 9.0), 1))
    status, said = run(tmp_path, capsys, text)
    assert status == 0 and "seem to stand in one another's place" in said
    status, said = run(tmp_path, capsys, text, "--column", "temperature=temp", "--column", "humidity=rh")
    assert status == 0 and "given as it came" not in said
    assert np.isfinite(corrected(tmp_path).temperature_corrected_c).all()
