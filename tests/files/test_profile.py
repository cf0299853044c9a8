"""The profile: what the format allows is read, what it does not is refused, ln D is linear in 1/T."""

import json
import math

import numpy as np
import pytest

from shockrig.files.errors import InputError
from shockrig.files.profile import (
    DiffusivityRow,
    HumidityProfile,
    Profile,
    ResponseTime,
    StatedEffect,
    TemperatureProfile,
    Uncertain,
    read_profile,
    write_profile,
)

DOCUMENT = {
    "format": "sensor-profile/1",
    "sensors": {"imet": {"kind": "imet-xf", "serial": "7"}},
    "temperature": {
        "bead_radius_m": 0.0004,
        "thermal_diffusivity_m2_s": {"value": 7.5e-08, "standard_uncertainty": 2e-10},
        "response_time_s": {"t63": 0.3, "t90": 0.6, "t98": 1.0},
        "noise_k": 0.02,
        "sampling_period_s": 0.1,
        "effects": [
            {
                "effect": "stem_conduction",
                "probability": 0.99,
                "parameters": {"fraction": {"value": 0.03, "standard_uncertainty": 0.001}},
                "indistinguishable_from": ["air_relaxation"],
            }
        ],
    },
    "humidity": {
        "film_thickness_m": 1e-05,
        "diffusivity_table": [
            {"ambient_temperature_c": 0.0, "diffusivity_m2_s": 2.8e-12, "standard_uncertainty": 1e-14, "runs": 5},
            {"ambient_temperature_c": 20.0, "diffusivity_m2_s": 9e-12, "standard_uncertainty": 9e-14, "runs": 5},
        ],
        "response_time_s": [{"ambient_temperature_c": 0.0, "t63": 9.0, "t90": 20.0, "t98": 36.0}],
        "noise_percent": 0.06,
        "sampling_period_s": 0.1,
        "effects": [],
    },
    "provenance": {"campaign": "x"},
}


def written(tmp_path, document):
    path = tmp_path / "profile.json"
    path.write_text(json.dumps(document))
    return path


def changed(**changes):
    """A copy of DOCUMENT with `a__b` -> value; ... deletes."""
    document = json.loads(json.dumps(DOCUMENT))
    for key, value in changes.items():
        *parents, last = key.split("__")
        place = document
        for parent in parents:
            place = place[int(parent) if parent.isdigit() else parent]
        if value is ...:
            del place[last]
        else:
            place[last] = value
    return document


def arrhenius(celsius, slope=3000.0):
    return 9e-12 * math.exp(-slope * (1 / (celsius + 273.15) - 1 / 293.15))


def table(temperatures, law=arrhenius, relative=0.01):
    return HumidityProfile(tuple(DiffusivityRow(t, law(t), relative * law(t)) for t in temperatures))


def test_reads_every_key_of_the_format(tmp_path):
    profile = read_profile(written(tmp_path, DOCUMENT))
    assert profile.temperature.thermal_diffusivity_m2_s == Uncertain(7.5e-8, 2e-10)
    assert profile.temperature.response_time_s == ResponseTime(0.3, 0.6, 1.0)
    assert profile.temperature.effects[0].value("fraction") == 0.03
    assert profile.temperature.effects[0].indistinguishable_from == ("air_relaxation",)
    assert profile.humidity.diffusivity_table[0].response_time_s == ResponseTime(9, 20, 36)
    assert list(profile.humidity.to_frame()["runs"]) == [5, 5]


def test_what_is_written_is_read_back_and_written_alike(tmp_path):
    profile = read_profile(written(tmp_path, DOCUMENT))
    write_profile(profile, tmp_path / "again.json")
    assert json.loads((tmp_path / "again.json").read_text()) == DOCUMENT
    assert read_profile(tmp_path / "again.json") == profile
    assert sorted(p.name for p in tmp_path.iterdir()) == ["again.json", "profile.json"]


def test_a_profile_that_cannot_be_written_leaves_the_old_one(tmp_path):
    path = written(tmp_path, DOCUMENT)
    with pytest.raises(ValueError):
        write_profile(Profile(temperature=TemperatureProfile(Uncertain(math.nan))), path)
    assert json.loads(path.read_text()) == DOCUMENT
    assert [p.name for p in tmp_path.iterdir()] == ["profile.json"]


@pytest.mark.parametrize(
    "changes",
    [
        {"temperature": ...},
        {"humidity": ...},
        {"humidity": None},
        {"temperature__noise_k": None},
        {"temperature__response_time_s": ...},
        {"humidity__response_time_s": ...},
        {"humidity__effects": ...},
        {"humidity__diffusivity_table": [{"ambient_temperature_c": 20, "diffusivity_m2_s": 9e-12, "colour": "red"}]},
        {"novelty": {"a": [1, 2]}, "temperature__novelty": 3},
        {"provenance": ..., "sensors": ...},
    ],
)
def test_what_may_be_left_out_or_added(tmp_path, changes):
    profile = read_profile(written(tmp_path, changed(**changes)))
    assert profile.temperature or profile.humidity
    write_profile(profile, tmp_path / "again.json")
    assert "novelty" not in (tmp_path / "again.json").read_text()


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"format": "sensor-profile/2"}, "format"),
        ({"temperature": ..., "humidity": ...}, "neither"),
        ({"temperature": []}, "temperature"),
        ({"temperature__thermal_diffusivity_m2_s": 7.5e-8}, "temperature.thermal_diffusivity_m2_s"),
        ({"temperature__thermal_diffusivity_m2_s": ...}, "temperature.thermal_diffusivity_m2_s"),
        ({"temperature__thermal_diffusivity_m2_s__value": -1}, "temperature.thermal_diffusivity_m2_s.value"),
        ({"temperature__thermal_diffusivity_m2_s__value": 10**400}, "temperature.thermal_diffusivity_m2_s.value"),
        ({"temperature__bead_radius_m": "0.4 mm"}, "temperature.bead_radius_m"),
        ({"temperature__noise_k": True}, "temperature.noise_k"),
        ({"temperature__effects__0__effect": 5}, "temperature.effects[0].effect"),
        ({"temperature__effects__0__probability": 1.5}, "temperature.effects[0].probability"),
        (
            {"temperature__effects__0__parameters__fraction__value": "x"},
            "temperature.effects[0].parameters.fraction.value",
        ),
        ({"humidity__diffusivity_table": []}, "humidity.diffusivity_table"),
        (
            {"humidity__diffusivity_table__1__ambient_temperature_c": 0},
            "humidity.diffusivity_table[1].ambient_temperature_c",
        ),
        ({"humidity__diffusivity_table__1__diffusivity_m2_s": 0}, "humidity.diffusivity_table[1].diffusivity_m2_s"),
        ({"humidity__effects": {}}, "humidity.effects"),
    ],
)
def test_errors_name_file_and_key(tmp_path, changes, named):
    with pytest.raises(InputError) as error:
        read_profile(written(tmp_path, changed(**changes)))
    assert named in str(error.value)
    assert "profile.json" in str(error.value)


@pytest.mark.parametrize(
    ("place", "meant", "slip"),
    [
        ("", "temperature", "temperatur"),
        ("temperature__", "thermal_diffusivity_m2_s", "thermal_difusivity_m2_s"),
        ("temperature__", "bead_radius_m", "bead_radius_mm"),
        ("temperature__thermal_diffusivity_m2_s__", "standard_uncertainty", "standart_uncertainty"),
        ("humidity__diffusivity_table__1__", "diffusivity_m2_s", "difusivity_m2_s"),
        ("humidity__", "effects", "efects"),
        ("sensors__imet__", "serial", "serail"),
    ],
)
def test_a_misspelt_key_is_told_as_one_and_with_what_was_meant(tmp_path, place, meant, slip):
    document = changed(**{place + meant: ..., place + slip: 1.0})
    with pytest.raises(InputError, match=f"unknown key '{slip}'; did you mean '{meant}'"):
        read_profile(written(tmp_path, document))


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", '{"format": NaN}', "[" * 100_000, "\x00", '"x"'])
def test_what_is_no_profile_is_refused(tmp_path, text):
    path = tmp_path / "profile.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"profile\.json"):
        read_profile(path)


def test_missing_or_binary_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="nothing.json"):
        read_profile(tmp_path / "nothing.json")
    (tmp_path / "b.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="b.json"):
        read_profile(tmp_path / "b.json")


def test_an_arrhenius_law_is_read_back_exactly_between_rows():
    profile = table([0.0, 10.0, 40.0])
    wanted = np.array([0.0, 3.0, 10.0, 25.0, 40.0])
    value, sigma = profile.diffusivity_m2_s(wanted)
    np.testing.assert_allclose(value, [arrhenius(t) for t in wanted], rtol=1e-12)
    assert sigma[0] / value[0] == pytest.approx(0.01)
    # what airs and airflow of the bench leave is common to all rows: between two it is known no better than at either
    assert sigma[3] / value[3] == pytest.approx(0.01)


def test_a_law_that_bends_evenly_is_read_back_exactly_and_one_with_a_kink_stays_within_its_uncertainty():
    # t63 = 0.6, 5.2, 11 s at 25, 5, -10 degC: data sheet of a capacitive sensor
    known_c, t63_s = np.array([-10.0, 5.0, 25.0]), np.array([11.0, 5.2, 0.6])
    parabola = np.polyfit(1 / (known_c + 273.15), np.log(t63_s), 2)
    wanted = np.linspace(-10, 25, 141)

    def even(celsius):
        return 3.2025e-11 / np.exp(np.polyval(parabola, 1 / (np.asarray(celsius) + 273.15)))

    def kinked(celsius):  # two straight lines through the three, in 1/T
        x, at = 1 / (np.asarray(celsius) + 273.15), 1 / (known_c + 273.15)
        slope = np.diff(np.log(t63_s)) / np.diff(at)
        return 3.2025e-11 / (5.2 * np.exp((x - at[1]) * np.where(x > at[1], slope[0], slope[1])))

    value, sigma = table([-10.0, 0.0, 10.0, 20.0, 25.0], even, relative=1e-6).diffusivity_m2_s(wanted)
    np.testing.assert_allclose(value, even(wanted), rtol=1e-6)
    assert sigma.max() > 0.005 * value[sigma.argmax()]  # it cannot know that it bends so evenly
    for first in np.arange(0.0, 10.0, 1.0):  # the kink at 5 degC anywhere between two rows
        at = np.arange(-30.0, 41.0, 10.0) + first
        value, sigma = table(at, kinked, relative=1e-6).diffusivity_m2_s(wanted)
        error = np.abs(np.log(value / kinked(wanted)))
        assert np.all(error <= 2.2 * sigma / value + 1e-5)
        if first in (0.0, 5.0):  # where it is a row of the table, nothing is off
            assert (error.max() > 0.02) == (first == 0.0)


def test_extrapolation_is_never_silent():
    profile = table([0.0, 20.0])
    with pytest.raises(InputError, match="characterize the sensor"):
        profile.diffusivity_m2_s(25.0)
    value, _ = profile.diffusivity_m2_s(np.array([-3.0, 10.0, 20.9, 22.0]), outside="nan")
    assert list(np.isnan(value)) == [True, False, False, True]
    assert list(profile.covers(np.array([-3.0, 10.0, math.nan]))) == [False, True, False]
    value, sigma = profile.diffusivity_m2_s(30.0, outside="hold")
    assert value == pytest.approx(arrhenius(20.0))
    assert sigma / value > 0.4


def test_one_row_speaks_for_its_own_ambient_only():
    profile = table([20.0])
    assert profile.diffusivity_m2_s(20.5)[0] == pytest.approx(arrhenius(20.0))
    with pytest.raises(InputError):
        profile.diffusivity_m2_s(22.0)


def test_a_missing_parameter_is_named():
    with pytest.raises(InputError, match="time_constant_s"):
        StatedEffect("stem_conduction", {"fraction": Uncertain(0.1)}).value("time_constant_s")
