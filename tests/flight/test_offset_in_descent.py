"""What a carrier adds to the air in descent: taken off with its uncertainty, and left in where nobody knows the climb.

The sensors' readings are made here, by their own equations: lags of first order, a film that holds vapour.
"""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.undo_readout import vertical_speed
from shockrig.files.flight import Flight
from shockrig.files.profile import (
    DiffusivityRow,
    HumidityProfile,
    Profile,
    StatedEffect,
    TemperatureProfile,
    Uncertain,
)
from shockrig.files.profile_data import BEAD_RADIUS_M, FILM_THICKNESS_M

PERIOD_S, CLIMB_M_S, BEAD_S, FILM_S = 0.5, 4.0, 5.0, 9.0
COLDER_K, MOISTER_PERCENT, SIGMA = -1.3, 2.0, 0.1
TIME_S = np.arange(0.0, 600.0, PERIOD_S)
ALTITUDE_M = 5.0 + CLIMB_M_S * np.minimum(TIME_S, 600.0 - TIME_S)
SINKS = TIME_S >= 300.0
SETTLED = (TIME_S > 40.0) & (np.abs(TIME_S - 300.0) > 40.0)


def magnus_hpa(temperature_c):
    return 6.112 * np.exp(17.62 * temperature_c / (243.12 + temperature_c))


def lagged(values, tau_s):
    """A lag of first order on a grid that is 50 times as fine."""
    fine = np.interp(np.arange(0.0, TIME_S[-1] + 1e-9, PERIOD_S / 50), TIME_S, values)
    keep = np.exp(-PERIOD_S / 50 / tau_s)
    return lfilter([1 - keep], [1, -keep], fine, zi=[keep * values[0]])[0][::50]


def flown(moister=0.0):
    """Air that gets colder with height and holds one vapour pressure, and what sensors under rotors read of it."""
    air = 22.0 - 0.0098 * ALTITUDE_M
    vapour = 11.0 * np.exp(-ALTITUDE_M / 4000.0)
    around = air + COLDER_K * SINKS
    noise = np.random.default_rng(1).standard_normal((2, TIME_S.size))
    bead = lagged(around, BEAD_S) + 0.01 * noise[0]
    film = 100.0 * lagged(vapour, FILM_S) / magnus_hpa(around) + moister * SINKS + 0.05 * noise[1]
    nothing = np.full(TIME_S.size, np.nan)
    flight = Flight(TIME_S, bead, film, np.full(TIME_S.size, 8.0), nothing, nothing, ALTITUDE_M)
    return flight, air, 100.0 * vapour / magnus_hpa(air)


def profile(of_bead=COLDER_K, of_film=0.0, film_effects=()):
    def effects(offset):
        numbers = {"offset": Uncertain(offset, SIGMA), "from_m_s": Uncertain(1.5)}
        return (StatedEffect("offset_in_descent", numbers),) if offset else ()

    d = FILM_THICKNESS_M**2 / FILM_S
    rows = tuple(DiffusivityRow(ambient, d, 0.01 * d) for ambient in (-10.0, 40.0))
    return Profile(
        TemperatureProfile(Uncertain(BEAD_RADIUS_M**2 / BEAD_S), noise_k=0.01, effects=effects(of_bead)),
        HumidityProfile(rows, noise_percent=0.05, effects=(*effects(of_film), *film_effects)),
        {name: {"body": "lumped"} for name in ("imet", "hyt")},
    )


def off(found, air, rows):
    return float(np.sqrt(np.nanmean((found - air)[rows] ** 2)))


@pytest.mark.parametrize("method", ["smoother", "inverse"])
def test_it_is_taken_off_both_sensors(method):
    """Bead and film are of the colder air; vapour is the same, so that the film needs no offset of its own."""
    flight, air, humidity = flown()
    found, unaware = (correct(flight, one, method) for one in (profile(), profile(of_bead=0.0)))
    assert off(found.temperature_c, air, SETTLED) < 0.05 and off(unaware.temperature_c, air, SETTLED) > 0.8
    if method == "smoother":  # the inverse gives such a film as it was read
        assert off(found.humidity_percent, humidity, SETTLED) < 0.5 < off(unaware.humidity_percent, humidity, SETTLED)


def test_a_films_own_offset_is_taken_off_in_percent():
    flight, _, humidity = flown(MOISTER_PERCENT)
    found, left = (correct(flight, profile(of_film=own)) for own in (MOISTER_PERCENT, 0.0))
    assert off(found.humidity_percent, humidity, SETTLED & SINKS) < 0.6
    assert off(left.humidity_percent, humidity, SETTLED & SINKS) > 1.5


def test_its_uncertainty_is_common_to_the_descent_and_the_turn_is_unsure():
    flight, air, _ = flown()
    found = correct(flight, profile())
    up, down, turn = (SETTLED & ~SINKS), (SETTLED & SINKS), np.abs(TIME_S - 300.0) < 3.0
    assert np.median(found.common["temperature"][down]) == pytest.approx(SIGMA, rel=0.2)
    assert np.median(found.common["temperature"][up]) < 0.3 * SIGMA
    assert np.all(found.temperature_uncertainty_k[turn] > 0.4 * abs(COLDER_K))
    assert np.nanmax(np.abs(found.temperature_c - air) / found.temperature_uncertainty_k) < 4.5


def test_pressure_tells_the_climb_too_and_without_both_it_is_left_in():
    flight, air, _ = flown()
    pressure = 1013.25 * (1.0 - 2.25577e-5 * ALTITUDE_M) ** 5.25588
    by_pressure = correct(dataclasses.replace(flight, altitude_m=None, pressure_hpa=pressure), profile())
    assert off(by_pressure.temperature_c, air, SETTLED) < 0.05
    blind = correct(dataclasses.replace(flight, altitude_m=None), profile())
    assert off(blind.temperature_c, air, SETTLED & SINKS) > 1.0
    (note,) = [note for note in blind.notes if "left in" in note]
    assert note.startswith("temperature: offset_in_descent")


def test_the_causal_corrector_says_that_it_leaves_it_in():
    flight, air, _ = flown()
    found = correct(flight, profile(), "causal")
    assert off(found.temperature_c, air, SETTLED & SINKS) > 1.0
    assert any("offset_in_descent" in note and "left in" in note for note in found.notes)


@pytest.mark.parametrize("logged", [True, False])
def test_warmth_that_airflow_carries_off_is_taken_off(logged):
    """A sensor warmer by 0.8 K at 5 m/s, and by the root of 5 m/s over the airflow elsewhere: by the airspeed in the
    log, else by the climb; and its uncertainty is that of the rise there."""
    flight, air, _ = flown()
    rise, sigma = 0.8, 0.05
    flow = np.where(SINKS, 9.0, 2.0) if logged else np.full(TIME_S.size, CLIMB_M_S)
    met = air + rise * np.sqrt(5.0 / flow)
    speed = flow if logged else np.full(TIME_S.size, np.nan)
    flight = dataclasses.replace(flight, temperature_c=lagged(met, BEAD_S), airspeed_m_s=speed)
    warm = StatedEffect("ventilated_warmth", {"rise_k_at_5_m_s": Uncertain(rise, sigma)})
    bead = dataclasses.replace(profile(of_bead=0.0).temperature, effects=(warm,))
    found = correct(flight, dataclasses.replace(profile(of_bead=0.0), temperature=bead))
    assert off(found.temperature_c, air, SETTLED) < 0.03
    steady = SETTLED & SINKS
    assert np.median(found.common["temperature"][steady]) == pytest.approx(sigma * np.sqrt(5.0 / flow[-1]), rel=0.3)


@pytest.mark.parametrize(("noise_m", "period_s", "held"), [(0.3, 1.0, 1), (1.0, 0.5, 1), (0.3, 0.2, 5), (0.0, 2.0, 1)])
def test_the_climb_is_steady_between_turns_and_turns_are_where_they_are(noise_m, period_s, held):
    """4 m/s up, a hover of 20 s, 6 m/s down: speeds to 0.15 m/s a few seconds off the turns, and each turn, where the
    speed is half of its change, to a second; with noise, between samples and where each altitude is held for some."""
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 580.0, period_s)
    turns = np.array([30.0, 330.0, 350.0, 550.0])
    track = np.interp(time, turns, [0.0, 1200.0, 1200.0, 0.0]) + rng.normal(0.0, noise_m, time.size)
    at, speed = vertical_speed(time, track[np.arange(time.size) // held * held])
    true = np.select([at < 30.0, at < 330.0, at < 350.0, at < 550.0], [0.0, 4.0, 0.0, -6.0], 0.0)
    settled = np.min(np.abs(at[:, None] - turns), axis=1) > 4.0
    assert np.sqrt(np.mean((speed - true)[settled] ** 2)) < 0.15
    for turn, half in zip(turns[1:], (2.0, -3.0, -3.0), strict=True):
        near = np.abs(at - turn) < 8.0
        falls = -1.0 if turn < 400.0 else 1.0
        crossed = np.interp(half * falls, falls * speed[near], at[near])
        assert crossed == pytest.approx(turn, abs=1.0)
