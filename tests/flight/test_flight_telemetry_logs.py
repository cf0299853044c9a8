"""Logs of telemetry as small teams decode it: signs that were lost, names of structures, lines without a name."""

import numpy as np
import pandas
import pytest

from shockrig.analysis.flight.columns import held
from shockrig.analysis.flight.doubts import slips
from shockrig.analysis.flight.screen import without_codes
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.files import sentinels
from shockrig.files.flight import Flight
from shockrig.files.profile import write_profile
from shockrig.files.ranges import RANGES
from shockrig.files.unit_names import is_called_time, quantity_of
from shockrig.protocols.cli import main
from shockrig.protocols.flight_logs import read_log

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


SECONDS = 1656909104 + (3 + ROW) // 10
TENTHS = (3 + ROW) % 10


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        ("header.stamp.secs,header.stamp.nsecs", 10**9),
        ("stamp_sec,stamp_nanosec", 10**9),
        ("tv_sec,tv_usec", 10**6),
        ("time_s,time_us", 10**6),
        ("time_s,time_ms", 10**3),
    ],
)
def test_what_is_left_of_a_second_in_another_column_is_of_the_time(tmp_path, capsys, names, unit):
    """Before: no column of times was recognised, or whole seconds were spread evenly."""
    status, said = run(tmp_path, capsys, log(f"{names},temp", SECONDS, TENTHS * unit // 10, COOLING))
    assert status == 0
    time_s = read_log(tmp_path / "log.csv")[0].time_s
    np.testing.assert_allclose(time_s - time_s[0], 0.1 * ROW, atol=1e-6)


def test_a_second_clock_in_another_unit_is_nothing_of_the_seconds(tmp_path, capsys):
    status, _ = run(tmp_path, capsys, log("time_s,time_ms,temp", ROW, 1000 * ROW + 7, COOLING))
    assert status == 0
    np.testing.assert_allclose(read_log(tmp_path / "log.csv")[0].time_s, ROW)


def test_rows_above_the_first_whole_one_are_counted(tmp_path, capsys):
    """A logger's program lost a column, and its first 40 rows were taken for metadata, in silence."""
    rows = [f"{k},{t},{40 + 0.01 * k:.2f},7" for k, t in zip(ROW, COOLING, strict=True)]
    first = [f"{row},9" for row in rows[:40]]
    status, said = run(
        tmp_path, capsys, "\n".join(["time;temp;rh;n", *(r.replace(",", ";") for r in first + rows[40:])])
    )
    assert status == 0 and "40 lines of another number of cells left out (the first in line 2)" in said


def test_a_barometer_at_the_end_of_what_it_measures_is_said_to_be(tmp_path, capsys):
    """A BME280 reads 300 hPa and no less. Before: nothing was said, 20 km up."""
    pressure = np.maximum(np.round(1000.0 * np.exp(-ROW / 60.0), 2), 300.0)
    status, said = run(tmp_path, capsys, log("time,temp,pressure", ROW, COOLING, pressure))
    assert status == 0 and "the lowest reading, 300 hPa, stands in 227 rows" in said
    coarse = np.round(1012.0 + 0.6 * np.sin(ROW / 40.0))
    status, said = run(tmp_path, capsys, log("time,temp,pressure", ROW, COOLING, coarse))
    assert status == 0 and "pressure_hpa" not in said


def glitches(count, seed=0):
    """A balloon's temperature that goes to and fro by 0.7 K at once, beside a humidity without noise."""
    row, rng = np.arange(count), np.random.default_rng(seed)
    warm = np.cumsum(rng.random(count) < 0.25) % 2
    course = np.interp(row, count * np.array([0.0, 0.05, 0.3, 0.4, 0.6, 0.75, 1.0]), [40, 40, 3, -1, 8, -21, 24])
    humidity = np.interp(row, count * np.array([0.0, 0.25, 0.6, 0.72, 0.87, 1.0]), [33.5, 37, 27, 38, 29, 29])
    temperature = course + 0.7 * warm + 0.01 * rng.standard_normal(count)
    return np.stack([temperature, humidity + 0.012 * rng.standard_normal(count)])


@pytest.mark.parametrize("seed", range(3))
def test_what_the_airs_temperature_explains_by_chance_exchanges_nothing(seed):
    """Each of 1000 jumps was a little likelier as the humidity's, which the better one of two models had to explain.
    Before: 3127 of a balloon's 4996 rows had changed place."""
    told = held(glitches(4000, seed), (0.001, 0.0001))
    assert not told.exchanged.any() and np.count_nonzero(told.unsure) < 40


def test_what_is_below_every_humidity_in_a_sixth_of_a_log_is_the_temperature():
    """Before: it was refused, as the noise of each column was like that of the other's sensor."""
    columns = glitches(1200)
    unknown = dict.fromkeys(("airspeed_m_s", "die_temperature_c", "pressure_hpa"), np.full(1200, np.nan))
    of_columns = dict(zip(("temperature_c", "humidity_percent"), columns, strict=True))
    assert not slips(Flight(time_s=np.arange(1200.0), **of_columns, **unknown), typical_profile())


def test_fewer_names_than_cells_in_a_comment_are_names(tmp_path, capsys):
    """As an altimeter of a rocket exports them, a comma short and without the satellites. Before: they were none."""
    head = (
        "# Serial number: 1372\n# Main deploy: 244\n#version,serial,time,state_name,pressure,altitude,temperature,volt"
    )
    rows = [
        f"5, 1372, {0.1 * k:.2f}, boost, {101325 - k}.0, {0.1 * k:.1f}, {t}, 3.9,, 1, 4, 43.79"
        for k, t in zip(ROW, COOLING, strict=True)
    ]
    status, said = run(tmp_path, capsys, "\n".join([head, *rows]))
    assert status == 0 and "temperature 'temperature', pressure 'pressure' in Pa, altitude 'altitude'" in said
