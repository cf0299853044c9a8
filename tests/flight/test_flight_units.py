"""Units in the names of a log's columns: understood, or named and refused, by `correct` and `learn` alike."""

import csv

import numpy as np
import pytest

import shockrig
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.files.errors import InputError
from shockrig.files.flight import read_layout
from shockrig.files.flight_rows import whole_flight
from shockrig.files.profile import write_profile
from shockrig.protocols import learning
from shockrig.protocols.cli import main

EXAMPLE = shockrig.read_flight(shockrig.example("flight.csv"))
HEADS = ("time_s", "temperature_c", "humidity_percent", "pressure_hpa", "altitude_m")


def pressure_hpa(altitude_m):
    return 1013.25 * (1.0 - 0.0065 * altitude_m / 288.15) ** 5.255877


def log(tmp_path, heads=HEADS, change=None, name="log.csv"):
    """The example flight with its pressure, as a file with other names, and columns changed."""
    metres = EXAMPLE.altitude_m
    columns = dict(
        time=EXAMPLE.time_s - EXAMPLE.time_s[0],
        temperature=EXAMPLE.temperature_c,
        humidity=EXAMPLE.humidity_percent,
        pressure=pressure_hpa(metres),
        altitude=metres,
    )
    for quantity, how in (change or {}).items():
        columns[quantity] = how(columns[quantity])
    path = tmp_path / name
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(heads)
        writer.writerows([f"{v:.7g}" for v in row] for row in zip(*columns.values(), strict=True))
    return path


def to_f(values):
    return 1.8 * values + 32.0


def to_ft(values):
    return values / 0.3048


@pytest.fixture(autouse=True)
def nothing_is_learned(monkeypatch):
    """`learn` reads its logs, says what it has to say of them, and ends."""

    def read(*arguments):
        raise InputError("all was read")

    monkeypatch.setattr(learning, "learned_from", read)


def commands(tmp_path, path):
    """Both commands that take a flight."""
    write_profile(typical_profile(), tmp_path / "p.json")
    yield ["correct", str(path), "--profile", str(tmp_path / "p.json"), "--out", str(tmp_path / "o.csv")]
    yield ["learn", str(path), "--out", str(tmp_path / "learned")]


@pytest.mark.parametrize(
    ("heads", "change"),
    [
        (("time_s", "Temp (F)", "RH (%)", "Press (kPa)", "Alt (ft)"),
         dict(temperature=to_f, pressure=lambda p: p / 10, altitude=to_ft)),
        (("Time (ms)", "temp_f", "rh_percent", "pressure_inhg", "altitude_ft"),
         dict(time=lambda s: 1e3 * s, temperature=to_f, pressure=lambda p: p / 33.863886, altitude=to_ft)),
        (("time_min", "Air Temperature, °F", "humidity (fraction)", "Pressure [Pa]", "Altitude (ft AGL)"),
         dict(time=lambda s: s / 60, temperature=to_f, humidity=lambda h: h / 100, pressure=lambda p: 100 * p,
              altitude=to_ft)),
        (("TimeUS", "tempF", "RH", "press_mb", "altft"),
         dict(time=lambda s: 1e6 * s, temperature=to_f, altitude=to_ft)),
        (("Elapsed Time (s)", "Temperature (K)", "Relative Humidity (%)", "Pressure (mbar)", "Altitude (m MSL)"),
         dict(temperature=lambda t: t + 273.15)),
        (("time_s", "temperature_k", "humidity", "pressurepa", "alt_km"),
         dict(temperature=lambda t: t + 273.15, pressure=lambda p: 100 * p, altitude=lambda m: m / 1000)),
    ],
)  # fmt: skip
def test_a_unit_in_a_name_is_understood(tmp_path, heads, change):
    """Every quantity comes in the project's unit, and what was converted is said."""
    expected = whole_flight(log(tmp_path))
    path = log(tmp_path, heads, change, "other.csv")
    flight = whole_flight(path)
    for name in HEADS:
        size = np.nanmax(np.abs(getattr(expected, name)))
        np.testing.assert_allclose(getattr(flight, name), getattr(expected, name), atol=1e-5 * size)
    said = read_layout(path).said
    assert all(f"{quantity} " in said for quantity in change if quantity != "time")


@pytest.mark.parametrize(
    ("head", "place", "unit"),
    [
        ("Temperature (Pa)", 1, "Pa"),
        ("Temp (R)", 1, "R"),
        ("Humidity (g/m3)", 2, "g/m3"),
        ("Altitude (yd)", 4, "yd"),
        ("Pressure (at)", 3, "at"),
    ],
)
def test_a_unit_that_is_not_known_is_named_and_refused(tmp_path, capsys, head, place, unit):
    heads = [*HEADS[:place], head, *HEADS[place + 1 :]]
    path = log(tmp_path, heads)
    for command in commands(tmp_path, path):
        capsys.readouterr()
        assert main(command) == 2
        said = capsys.readouterr().err
        assert repr(head) in said and repr(unit) in said and len(said.splitlines()) == 1
        quantity = HEADS[place].split("_")[0]
        status = main([*command, "--column", f"{quantity}={head}"])  # a column that is chosen so is read
        assert status == 0 or "all was read" in capsys.readouterr().err
    with pytest.raises(InputError, match="columns="):
        shockrig.read_flight(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (dict(temperature=lambda t: to_f(t) + 20.0), "degF"),
        (dict(temperature=lambda t: t + 273.15), "be in K"),
        (dict(altitude=to_ft), "feet"),
        (dict(altitude=lambda m: m / 1000), "another unit"),
        (dict(humidity=lambda h: h / 100), "fractions of 1"),
        (dict(pressure=lambda p: p / 10), "kPa"),
    ],
)
def test_a_unit_that_no_name_states_is_doubted_by_both_commands(tmp_path, capsys, change, said):
    for command in commands(tmp_path, log(tmp_path, change=change)):
        main(command)
        assert said in capsys.readouterr().err


def test_times_in_minutes_and_exchanged_columns_are_refused_where_all_is_learned_from_them(tmp_path, capsys):
    for change, words in (
        (dict(time=lambda s: s / 60), "convert times to seconds"),
        (dict(temperature=lambda t: np.abs(t) * 0 + 60.0 + t, humidity=lambda h: 20.0 + h / 10), "another's place"),
    ):
        path = log(tmp_path, change=change)
        assert main(["learn", str(path), "--out", str(tmp_path / "learned")]) == 2
        assert words in capsys.readouterr().err


def test_a_channel_that_is_not_recognised_is_said_to_be_by_learn_too(tmp_path, capsys):
    path = log(tmp_path, ("time_s", "outside", "humidity_percent", "pressure_hpa", "altitude_m"))
    main(["learn", str(path), "--out", str(tmp_path / "learned")])
    assert "--column temperature=NAME" in capsys.readouterr().err


def test_a_code_for_no_value_is_none_of_fahrenheit(tmp_path):
    def coded(values):
        values = to_f(values)
        values[100:103] = -9999.0
        return values

    path = log(tmp_path, ("time_s", "Temp (F)", *HEADS[2:]), dict(temperature=coded))
    done = shockrig.correct(path, typical_profile())
    assert any("-9999 in 3 rows" in note for note in done.notes)


def test_what_is_no_unit_stays_a_name(tmp_path):
    """A word in brackets is none, and neither is what a known name ends with."""
    for head in ("Altitude (ASL)", "altitude_agl", "Pressure", "pres"):
        heads = [*HEADS[:4], head] if "lt" in head else [*HEADS[:3], head, HEADS[4]]
        assert read_layout(log(tmp_path, heads)).units == {}
