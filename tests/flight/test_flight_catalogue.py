"""Every effect of the catalogue in a flight: simulated, undone or said to be left, and in the words that it needs."""

import dataclasses
import functools

import numpy as np
import pytest

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.response import bead_response
from shockrig.analysis.flight.simulated.scenes import to_flight
from shockrig.analysis.flight.simulated.sensor import FLOWN_EFFECTS, fly, flyable
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import frontal
from shockrig.analysis.flight.undo_readout import (
    acting,
    ceiling,
    noise_floor,
    not_known,
    not_undone,
    of_airspeed,
    propagated,
    undone,
)
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.report.crossing import cross_inversion
from shockrig.files.errors import InputError
from shockrig.files.profile import Profile, StatedEffect, Uncertain

TYPICAL = typical_profile()
QUIET = Profile(
    dataclasses.replace(TYPICAL.temperature, noise_k=0.004),
    dataclasses.replace(TYPICAL.humidity, noise_percent=0.02),
)
COLUMN = {"temperature": "temperature_c", "humidity": "humidity_percent"}
# A front after which it is colder, and a sharp one into warm and moist air, which wets a sensor.
COOLER = {"airspeed_m_s": 15.0, "lead_m": 360.0, "width_m": 150.0, "humidity_percent": 45.0, "irradiance_w_m2": 700.0}
MOISTER = COOLER | {
    "temperature_c": 12.0,
    "temperature_change_k": 14.0,
    "humidity_after_percent": 85.0,
    "width_m": 8.0,
    "corner_m": 4.0,
}
# Of each effect: parameters that show, and the air in which they do. An effect that is missing here fails the test.
CASES = {
    "finite_transfer": ({"duration_s": 0.5}, COOLER),
    "air_relaxation": ({"fraction": 0.1, "time_constant_s": 9.0}, COOLER),
    "clock_drift": ({"ppm": 1e4}, COOLER),
    "direction_dependent_exchange": ({"ratio": 2.0}, COOLER),
    "other_medium": ({"ratio": 2.0}, COOLER),
    "slow_air_in_cooling": ({"time_constant_s": 9.0}, COOLER),
    "slow_air_in_warming": ({"time_constant_s": 9.0}, COOLER),
    "convective_film": ({"biot_at_5_m_s": 0.4}, COOLER),
    "exchange_temperature": ({}, COOLER),
    "vapour_boundary_layer": ({"biot_at_5_m_s": 3.0}, COOLER),
    "series_lag": ({"time_constant_s": 2.0}, COOLER),
    "sheath": ({"time_constant_s": 1.5, "capacity": 0.8}, COOLER),
    "condensation": ({"drying_time_s": 5.0}, MOISTER),
    "direction_dependent_diffusivity": ({"ratio_drying_to_wetting": 0.7}, COOLER | {"humidity_after_percent": 20.0}),
    "concentration_dependent_diffusivity": ({"slope_per_unit_activity": 1.2}, COOLER),
    "slow_relaxation": ({"fraction": 0.2, "time_constant_s": 20.0}, COOLER),
    "stem_conduction": ({"fraction": 0.2, "time_constant_s": 12.0}, COOLER),
    "parallel_lag": ({"fraction": 0.2, "time_constant_s": 15.0}, COOLER),
    "evaporative_cooling": ({"depression_k": 1.0, "time_constant_s": 20.0}, MOISTER),
    "self_heating": ({"rise_k_at_5_m_s": 0.5}, COOLER),
    "radiative_heating": ({"kelvin_per_w_m2_at_5_m_s": 5e-4}, COOLER),
    "wall_radiation": ({"rise_k_at_10_k": 0.5, "wall_temperature_c": 30.0}, COOLER),
    "calibration_temperature": ({"percent_per_k": 0.3}, COOLER),
    "die_thermal_lag": ({}, COOLER),
    "uptake_by_activity": ({}, COOLER),
    "hysteresis": ({"rh_percent": 1.0}, COOLER),
    "calibration_error": ({"gain": 0.02, "offset": 1.5}, COOLER),
    "saturation_clipping": ({"limit_percent": 70.0}, COOLER),
    "dead_time": ({"delay_s": 0.8}, COOLER),
    "moving_average": ({"samples": 12.0}, COOLER),
    "stale_samples": ({"hold_samples": 5.0}, COOLER),
    "quantization": ({"step": 0.1}, COOLER),
} | {f"body_{name}": ({}, COOLER) for name in BODIES}
# What acts on another effect alone, and that effect.
BESIDE = {"exchange_temperature": ("convective_film", {"biot_at_5_m_s": 0.1})}
IN_NOISE_ALONE = {"stale_samples", "quantization", "saturation_clipping"}  # screening finds what they do
PAIRS = [(effect, channel) for effect, entry in CATALOGUE.items() for channel in entry.channels if effect not in BESIDE]


def with_effects(profile, channel, *effects):
    part = dataclasses.replace(getattr(profile, channel), effects=effects)
    return dataclasses.replace(profile, **{channel: part})


def stated(effect, uncertainty=0.0, **values):
    return StatedEffect(effect, {name: Uncertain(value, uncertainty * abs(value)) for name, value in values.items()})


def rms(error):
    return float(np.sqrt(np.nanmean(np.square(error))))


def like(effect):
    """What of an effect the plain profile depends on: a body that is another than the one that the effect puts in its
    place, or none; and whether its readings are as coarse as usual."""
    other = "sphere" if effect == "body_lumped" else "lumped"
    return other if effect.startswith("body_") else None, effect in IN_NOISE_ALONE


@functools.cache
def plain_for(body, coarse):
    sensors = {} if body is None else {name: {"body": body} for name in ("imet", "hyt")}
    return dataclasses.replace(TYPICAL if coarse else QUIET, sensors=sensors)


@functools.cache
def plain_log(body, coarse, air):
    """What that profile's sensors log in a front, flown once for all effects."""
    return fly(frontal(**dict(air)), plain_for(body, coarse), 7).log


@pytest.mark.parametrize(("effect", "channel"), PAIRS)
def test_every_effect_of_the_catalogue_flies_as_its_entry_says(effect, channel):
    values, air = CASES[effect]
    plain = plain_for(*like(effect))
    extended = with_effects(plain, channel, stated(effect, **values))
    flown, bare = fly(frontal(**air), extended, 7), plain_log(*like(effect), tuple(air.items()))
    column, meaning = COLUMN[channel], CATALOGUE[effect].in_flight
    assert flyable(effect, channel)
    truth, reading = flown.truth[column].to_numpy(), flown.log[column].to_numpy()
    done, unaware = (correct(to_flight(flown.log), profile) for profile in (extended, plain))
    errors = {
        name: rms(series - truth)
        for name, series in (
            ("reading", reading),
            ("done", getattr(done, column)),
            ("unaware", getattr(unaware, column)),
        )
    }
    said = [note for note in done.notes if effect in note]
    if meaning is None:  # of the bench: it stays there
        assert flown.log.equals(bare)
        assert np.array_equal(getattr(done, column), getattr(unaware, column), equal_nan=True)
        assert len(said) == 1 and "belongs to the bench" in said[0]
        return
    assert effect in FLOWN_EFFECTS[channel]
    assert rms(reading - bare[column].to_numpy()) > 0.01, "the simulation leaves the effect out"
    if meaning.left:
        assert len(said) == 1 and "is not undone" in said[0]
        assert errors["done"] < 1.02 * errors["reading"]
        return
    assert not said
    # a front of 8 K and 45 %RH, of which one sample in a hundred is lost at a ceiling or between coarse steps
    assert errors["done"] < 0.35 * errors["reading"], errors
    if effect not in IN_NOISE_ALONE:
        assert errors["done"] < 0.5 * errors["unaware"], errors


def lag_of_bead(stream, *effects):
    """Mean lag [s] behind an air film, most of which is the film's."""
    part = dataclasses.replace(TYPICAL.temperature, effects=(stated("convective_film", biot_at_5_m_s=0.1), *effects))
    response = bead_response(part, stream)
    return (response.weight / response.rate).sum(axis=1)


def test_thin_air_slows_a_bead_and_quickens_a_film_behind_a_layer():
    """Known answers: F(5 m/s) at 700 hPa is 14 % less for a bead of 0.8 mm; a vapour layer goes as pressure^-1/2."""
    high, low = (Stream(np.array([5.0]), np.array([pressure])) for pressure in (700.0, 1013.25))
    reynolds = 5.0 * 8e-4 / 1.5e-5
    numbers = [2.0 + 0.6 * np.sqrt(reynolds * p / 1013.25) * 0.71 ** (1 / 3) for p in (700.0, 1013.25)]
    assert numbers[1] / numbers[0] == pytest.approx(1.16, abs=0.002)
    assert lag_of_bead(high) / lag_of_bead(low) == pytest.approx(numbers[1] / numbers[0], abs=0.01)
    layer = CATALOGUE["vapour_boundary_layer"].in_flight.biot
    ratio = layer({"biot_at_5_m_s": 6.0}, high, 1e-5) / layer({"biot_at_5_m_s": 6.0}, low, 1e-5)
    assert ratio == pytest.approx(np.sqrt(1013.25 / 700.0))


def test_warm_air_carries_heat_a_little_better():
    """Tables of air: k 24.4 mW/m/K at 0 degC, 27.4 at 40; nu 13.3 and 17.0 mm2/s (VDI Heat Atlas, D2.2)."""
    cold, warm = (Stream(np.array([5.0]), temperature_c=np.array([t])) for t in (0.0, 40.0))
    slower, faster = (lag_of_bead(air, stated("exchange_temperature")) for air in (cold, warm))
    assert lag_of_bead(cold) == pytest.approx(lag_of_bead(warm))
    heat = [k * (2 + 0.6 * np.sqrt(5.0 * 8e-4 / nu) * 0.71 ** (1 / 3)) for k, nu in ((24.4, 13.3e-6), (27.4, 17.0e-6))]
    assert slower / faster == pytest.approx(heat[1] / heat[0], abs=0.008) and slower > 1.01 * faster


@pytest.mark.parametrize("channel", ["temperature", "humidity"])
def test_a_flight_through_thin_air_is_corrected_at_its_own_pressure(channel):
    effect = {
        "temperature": stated("convective_film", biot_at_5_m_s=0.1),
        "humidity": stated("vapour_boundary_layer", biot_at_5_m_s=1.5),
    }[channel]
    profile = with_effects(QUIET, channel, effect)
    weather = frontal(**COOLER)
    thin = dataclasses.replace(weather, pressure_hpa=np.full(weather.time_s.size, 500.0))
    flown = fly(thin, profile, 3)
    column = COLUMN[channel]
    truth = flown.truth[column].to_numpy()
    own = correct(to_flight(flown.log), profile)
    unaware = correct(to_flight(flown.log.drop(columns=["pressure_hpa"])), profile)
    assert rms(getattr(own, column) - truth) < 0.6 * rms(getattr(unaware, column) - truth)
    assert any(f"no pressure in the log: {effect.effect} taken at 1013 hPa" in note for note in unaware.notes)
    assert not any("pressure" in note for note in own.notes)


def test_the_simulator_knows_what_leaves_the_bench_and_nothing_else():
    for channel, flown in FLOWN_EFFECTS.items():
        leaving = {id_ for id_, entry in CATALOGUE.items() if channel in entry.channels and entry.in_flight is not None}
        assert flown == leaving
    assert set(CASES) == set(CATALOGUE), "each effect has a line in CASES"


def test_a_sensor_with_everything_at_once_is_undone():
    bead = (
        stated("convective_film", biot_at_5_m_s=0.8),
        stated("series_lag", time_constant_s=1.5),
        stated("body_cylinder"),
        stated("stem_conduction", fraction=0.08, time_constant_s=15.0),
        stated("self_heating", rise_k_at_5_m_s=0.3),
        stated("calibration_error", gain=0.01, offset=-0.4),
        stated("dead_time", delay_s=0.3),
    )
    film = (
        stated("vapour_boundary_layer", biot_at_5_m_s=6.0),
        stated("series_lag", time_constant_s=3.0),
        stated("slow_relaxation", fraction=0.06, time_constant_s=30.0),
        stated("die_thermal_lag"),
        stated("calibration_error", gain=-0.01, offset=1.0),
        stated("dead_time", delay_s=0.5),
    )
    profile = with_effects(with_effects(QUIET, "temperature", *bead), "humidity", *film)
    flown = fly(frontal(**COOLER), profile, 3)
    done = correct(to_flight(flown.log), profile)
    for channel, column in COLUMN.items():
        truth, reading = flown.truth[column].to_numpy(), flown.log[column].to_numpy()
        assert rms(getattr(done, column) - truth) < 0.06 * rms(reading - truth), channel


# -- what a flight asks of an entry --------------------------------------------------


def test_profiles_of_other_programs_are_corrected_and_what_is_unknown_is_said():
    foreign = StatedEffect("frost_on_the_lid", {"thickness_mm": Uncertain(1.0)})
    misplaced = stated("stem_conduction", fraction=0.1, time_constant_s=9.0)
    profile = with_effects(QUIET, "humidity", foreign, misplaced, stated("dead_time", delay_s=0.2))
    said = not_undone(profile.humidity.effects, "humidity")
    assert [note.split()[1] for note in said] == ["frost_on_the_lid", "stem_conduction"]
    assert "unknown to this version" in said[0] and "no meaning for humidity" in said[1]
    assert [one.id for one in acting(profile.humidity.effects, "humidity")] == ["dead_time"]
    flown = fly(frontal(**COOLER), QUIET, 1)
    notes = correct(to_flight(flown.log), profile).notes
    assert set(said) <= set(notes)
    with pytest.raises(InputError, match="frost_on_the_lid cannot be simulated"):
        fly(frontal(**COOLER), profile, 1)


def test_a_missing_or_impossible_parameter_is_one_clear_line():
    flight = to_flight(fly(frontal(**COOLER), QUIET, 1).log)
    for effect, match in (
        (stated("stem_conduction", fraction=0.1), "stem_conduction lacks the parameter 'time_constant_s'"),
        (stated("series_lag", time_constant_s=0.0), "series_lag: time_constant_s 0 cannot be"),
        (stated("sheath", time_constant_s=2.0, capacity=-1.0), "sheath: capacity -1 cannot be"),
        (stated("self_heating"), "self_heating lacks the parameter 'rise_k_at_5_m_s'"),
    ):
        with pytest.raises(InputError, match=match):
            correct(flight, with_effects(QUIET, "temperature", effect))


def test_no_airspeed_is_said_of_the_effects_that_need_it_alone():
    bead = (
        stated("calibration_error", gain=0.01),
        stated("self_heating", rise_k_at_5_m_s=0.2),
        stated("convective_film", biot_at_5_m_s=2.0),
    )
    assert of_airspeed(acting(bead, "temperature"), 4e-4) == ["convective_film", "self_heating"]
    log = fly(frontal(**COOLER), QUIET, 1).log.drop(columns=["airspeed_m_s"])
    notes = correct(to_flight(log), with_effects(QUIET, "temperature", *bead)).notes
    assert "no airspeed in the log: convective_film, self_heating taken at 5 m/s" in notes
    assert not any("airspeed" in note for note in correct(to_flight(log), QUIET).notes)


def test_the_readout_is_undone_from_its_end_and_its_uncertainty_by_hand():
    effects = acting(
        (
            StatedEffect("calibration_error", {"gain": Uncertain(0.25, 0.01), "offset": Uncertain(2.0, 0.3)}),
            StatedEffect("self_heating", {"rise_k_at_5_m_s": Uncertain(0.5, 0.2)}),
            StatedEffect("dead_time", {"delay_s": Uncertain(0.4, 0.02)}),
            StatedEffect("moving_average", {"samples": Uncertain(5.0)}),
        ),
        "temperature",
    )
    element = np.array([10.0, 20.0])
    logged = 1.25 * (element + 0.5) + 2.0
    found = undone(effects, logged, Stream(np.array([5.0, 5.0])), 4e-4, 0.1)
    assert found.reading == pytest.approx(element)
    assert found.gain == pytest.approx(1.25)
    assert found.delay_s == pytest.approx(0.4 + 0.2)
    assert found.delay_uncertainty_s == pytest.approx(0.02)
    by_hand = np.sqrt((0.3 / 1.25) ** 2 + (0.01 * (element + 0.5) / 1.25) ** 2 + 0.2**2)
    assert found.uncertainty == pytest.approx(by_hand, rel=1e-6)
    gap = undone(effects, np.array([np.nan, logged[1]]), Stream(np.array([5.0, 5.0])), 4e-4, 0.1)
    assert np.isnan(gap.reading[0]) and np.isfinite(gap.uncertainty).all() and np.isfinite(gap.gain).all()


def test_noise_ceiling_and_what_is_left_are_added_up():
    effects = acting(
        (
            stated("quantization", step=0.12),
            stated("saturation_clipping", limit_percent=93.0),
            stated("hysteresis", rh_percent=0.7),
        ),
        "humidity",
    )
    assert noise_floor(effects, 0.05) == pytest.approx(np.hypot(0.05, 0.12 / np.sqrt(12)))
    assert ceiling(effects) == 93.0 and ceiling(()) is None
    assert not_known(effects) == pytest.approx(0.7) and not_known(()) == 0.0


def test_a_readout_known_badly_widens_what_is_stated_and_moves_no_value():
    exact, loose = (
        with_effects(
            QUIET,
            "temperature",
            StatedEffect("calibration_error", {"gain": Uncertain(0.0, 0.0), "offset": Uncertain(0.5, sigma)}),
            StatedEffect("dead_time", {"delay_s": Uncertain(0.3, sigma / 5)}),
        )
        for sigma in (0.0, 0.1)
    )
    flown = fly(frontal(**COOLER), exact, 2)
    sure, unsure = (correct(to_flight(flown.log), profile) for profile in (exact, loose))
    assert np.array_equal(sure.temperature_c, unsure.temperature_c)
    assert np.array_equal(sure.humidity_percent, unsure.humidity_percent)
    added = np.sqrt(unsure.temperature_uncertainty_k**2 - sure.temperature_uncertainty_k**2)
    assert np.median(added) == pytest.approx(0.1, rel=0.02)  # steady air: the offset alone
    slope = np.abs(np.gradient(flown.truth["temperature_c"], 0.1)).max()
    assert added.max() == pytest.approx(np.hypot(0.1, 0.02 * slope), rel=0.1)


def test_uncertainty_is_carried_to_first_order():
    (one,) = acting(
        (StatedEffect("parallel_lag", {"fraction": Uncertain(0.2, 0.01), "time_constant_s": Uncertain(9.0, 0.9)}),),
        "temperature",
    )
    found = propagated(one, lambda v: v["fraction"] * np.array([1.0, 3.0]) + np.log(v["time_constant_s"]))
    assert found == pytest.approx(np.hypot([0.01, 0.03], 0.1), rel=1e-6)


def test_the_crossing_leaves_on_the_bench_what_the_catalogue_leaves_there():
    extended = with_effects(
        TYPICAL,
        "temperature",
        stated("clock_drift", ppm=2e4),
        stated("convective_film", biot_at_5_m_s=0.5),
        StatedEffect("frost_on_the_lid", {}),
    )
    extended = dataclasses.replace(extended, humidity=None)
    (crossing,), notes = cross_inversion(dataclasses.replace(TYPICAL, humidity=None), extended)
    assert notes == ["Left on the bench: clock_drift, frost_on_the_lid (temperature)."]
    assert crossing.rms_extended < 0.5 * crossing.rms_plain
