"""A sheath that the body loads, in a flight: simulated as its closed form, undone, with honest uncertainty."""

import dataclasses

import numpy as np
import pytest
from test_flight_bodies import PROFILE, QUIET, bead, effect, rms

from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.response import bead_response
from shockrig.analysis.flight.simulated.scenes import to_flight
from shockrig.analysis.flight.simulated.sensor import cells, fly, march, sheathed
from shockrig.analysis.flight.simulated.weather import FINE_STEP_S, frontal, inversion
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.modes import in_series
from shockrig.files.profile import DiffusivityRow, Profile

ALPHA = PROFILE.temperature.thermal_diffusivity_m2_s
BEAD_RATE = ALPHA.value / PROFILE.temperature.bead_radius_m**2
SHEATH = effect("sheath", time_constant_s=2.0, capacity=0.7)
WITH_FILM = dataclasses.replace(PROFILE.temperature, effects=(SHEATH, effect("convective_film", biot_at_5_m_s=0.5)))


@pytest.mark.parametrize(("time_constant_s", "capacity"), [(0.5, 0.3), (4.0, 2.0)])
@pytest.mark.parametrize("name", BODIES)
def test_cells_in_a_sheath_follow_the_closed_form(name, time_constant_s, capacity):
    rate, time = 0.3, np.arange(3001.0) * FINE_STEP_S
    air = np.clip(time - 1.0, 0.0, 1.0)
    element = sheathed(cells(name), time_constant_s, capacity)
    found = march(element, np.array(rate), np.array(np.inf), air[None])[0]
    expected = BODIES[name].sheathed(rate * time_constant_s, capacity).scaled(rate).ramp(time - 1.0, 1.0)
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_a_sheaths_own_pace_is_not_the_bodys():
    """What doubles the body's rate leaves the pace at which the sheath alone follows the air."""
    time = np.arange(2001.0) * FINE_STEP_S
    air = np.clip(time - 1.0, 0.0, 1.0)
    element = sheathed(cells("film"), 2.0, 1e4)  # which the body does not load

    def doubled(k, state):
        return np.full(state.shape, 2.0)

    twice = march(element, np.array(0.3), np.array(np.inf), air[None], doubled)
    expected = in_series(BODIES["film"].held().scaled(0.6), 2.0).ramp(time - 1.0, 1.0)
    np.testing.assert_allclose(twice[0], expected, atol=1e-3)


@pytest.mark.parametrize("name", BODIES)
def test_the_response_is_the_bodys_in_its_sheath(name):
    found = bead(SHEATH, body=name).modes()
    exact = BODIES[name].sheathed(2.0 * BEAD_RATE, 0.7).scaled(BEAD_RATE)
    late = np.geomspace(0.3, 12.0, 40) / float(exact.rate[0])
    np.testing.assert_allclose(found.step(late), exact.step(late), atol=4e-3)
    assert found.amplitude.sum() == pytest.approx(-1.0)
    lags = [-np.sum(modes.amplitude / modes.rate) for modes in (found, exact)]
    assert lags[0] == pytest.approx(lags[1], rel=2e-3)


def test_a_cap_may_stand_before_a_sheath():
    found = bead(SHEATH, effect("series_lag", time_constant_s=5.0)).modes()
    body = BODIES["sphere"].sheathed(2.0 * BEAD_RATE, 0.7).scaled(BEAD_RATE)
    time = np.geomspace(0.5, 60.0, 40)
    np.testing.assert_allclose(found.step(time), in_series(body, 5.0).step(time), atol=2e-3)


@pytest.mark.parametrize("biot", [0.2, 3.0])
@pytest.mark.parametrize("name", ["sphere", "cylinder_mean", "film", "lumped"])
def test_cells_in_a_sheath_within_a_film_follow_the_closed_form(name, biot):
    """The film's resistance and the sheath's own add."""
    rate, time = 0.3, np.arange(3001.0) * FINE_STEP_S
    air = np.clip(time - 1.0, 0.0, 1.0)
    found = march(sheathed(cells(name), 2.0, 0.7), np.array(rate), np.array(biot), air[None])[0]
    time_constant = rate * 2.0 + 0.7 / (BODIES[name].surface_to_volume * biot)
    expected = BODIES[name].sheathed(time_constant, 0.7).scaled(rate).ramp(time - 1.0, 1.0)
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_an_air_film_outside_of_a_sheath_slows_it_with_the_airspeed():
    found = bead(SHEATH, effect("convective_film", biot_at_5_m_s=0.5)).modes()
    exact = BODIES["sphere"].sheathed(2.0 * BEAD_RATE + 0.7 / (3.0 * 0.5), 0.7).scaled(BEAD_RATE)
    time = np.geomspace(0.5, 60.0, 40)
    np.testing.assert_allclose(found.step(time), exact.step(time), atol=2e-3)
    fast, slow = (bead_response(WITH_FILM, Stream(np.array([speed]))).slowest_s for speed in (20.0, 1.0))
    assert slow > 1.2 * fast


def test_a_sheath_within_an_air_film_is_undone():
    profile = Profile(dataclasses.replace(QUIET.temperature, effects=WITH_FILM.effects), QUIET.humidity)
    flown = fly(frontal(airspeed_m_s=15.0, lead_m=600.0, width_m=150.0), profile, 2)
    done = correct(to_flight(flown.log), profile).temperature_c
    truth, reading = flown.truth["temperature_c"].to_numpy(), flown.log["temperature_c"].to_numpy()
    assert rms(done - truth) < 0.12 * rms(reading - truth)


def test_its_parameters_widen_the_time_scale_by_their_part_of_the_mean_lag():
    own, lag_s = ALPHA.standard_uncertainty / ALPHA.value, 1.0 / (6.0 * BEAD_RATE)
    # capacity 1: of 2 tau half is the body's filling. With tau half the bead's lag, the whole is twice the bead's.
    found = bead(effect("sheath", time_constant_s=(0.5 * lag_s, 0.05 * lag_s), capacity=(1.0, 0.2)))
    # d ln(whole) = 0.5 d ln(tau) = 0.05, and -tau d(capacity) / whole = 0.05
    assert found.relative_uncertainty[0] == pytest.approx(np.sqrt((0.5 * own) ** 2 + 2 * 0.05**2), rel=1e-3)
    # an air film outside that both fill: 2 / (3 Bi) = 2/6 of R^2 / alpha, as much again as all the rest
    layered = bead(
        effect("sheath", time_constant_s=0.5 * lag_s, capacity=1.0),
        effect("convective_film", biot_at_5_m_s=(2.0, 0.2)),
    )
    by_hand = np.hypot(0.75 * own, 0.5 * 0.1)  # the film's lag goes with 1 / alpha as the bead's own does
    assert layered.relative_uncertainty[0] == pytest.approx(by_hand, rel=1e-3)


def test_a_film_whose_d_moves_in_a_sheath_is_undone():
    rows = tuple(DiffusivityRow(t, 6e-12 * np.exp((t - 10) / 12), 1e-14) for t in (-10.0, 0.0, 10.0, 20.0, 30.0))
    part = dataclasses.replace(
        QUIET.humidity, diffusivity_table=rows, effects=(effect("sheath", time_constant_s=4.0, capacity=0.6),)
    )
    profile = Profile(QUIET.temperature, part)
    lag = effect("series_lag", time_constant_s=4.0)
    unaware = Profile(QUIET.temperature, dataclasses.replace(part, effects=(lag,)))
    flown = fly(inversion(strength_k=12.0, surface_temperature_c=5.0, top_m=500.0), profile, 1)
    truth, reading = flown.truth["humidity_percent"].to_numpy(), flown.log["humidity_percent"].to_numpy()
    inner = slice(None, -50)  # an inverse of two lags does not know how the log goes on
    errors = {}
    for method, share in (("smoother", 0.07), ("inverse", 0.2)):
        done = correct(to_flight(flown.log), profile, method).humidity_percent
        errors[method] = rms((done - truth)[inner])
        assert errors[method] < share * rms((reading - truth)[inner]), method
    without_loading = correct(to_flight(flown.log), unaware).humidity_percent
    assert errors["smoother"] < 0.3 * rms((without_loading - truth)[inner])


def test_its_stated_uncertainty_holds_the_truth():
    """Sheaths drawn about the stated one."""
    stated_s, sigma_s, stated, sigma = 3.0, 0.15, 0.8, 0.08
    held = []
    for seed in range(4):
        first, second = np.random.default_rng([seed, 11]).standard_normal(2)
        drawn = effect("sheath", time_constant_s=stated_s + sigma_s * first, capacity=stated + sigma * second)
        known = effect("sheath", time_constant_s=(stated_s, sigma_s), capacity=(stated, sigma))
        true, profile = (
            Profile(dataclasses.replace(PROFILE.temperature, effects=(e,)), PROFILE.humidity) for e in (drawn, known)
        )
        flown = fly(frontal(airspeed_m_s=15.0, lead_m=400.0, width_m=300.0), true, seed)
        done = correct(to_flight(flown.log), profile)
        error = np.abs(done.temperature_c - flown.truth["temperature_c"].to_numpy())
        held.append(np.mean(error < 1.96 * done.temperature_uncertainty_k))
    assert 0.9 < np.mean(held), held
