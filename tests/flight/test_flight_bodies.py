"""Bodies and sheaths in a flight: simulated as their closed forms, stepped exactly, undone, with honest uncertainty."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import expm

from shockrig.analysis.flight.air_prior import gain_squared
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.inverse import RefusedError, paper_layers, response_time_s, sampled, transfer_function
from shockrig.analysis.flight.response import (
    LagResponse,
    bead_response,
    film_response,
    held_matrix,
    hold,
    slowest,
    stepped,
)
from shockrig.analysis.flight.simulated.scenes import to_flight
from shockrig.analysis.flight.simulated.sensor import SHAPES, cells, fly, march
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import FINE_STEP_S, frontal, inversion
from shockrig.analysis.flight.sweep import lags_behind
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.modes import first_order, in_series, mix, response_times
from shockrig.files.diagnosis_data import Dependence, Discovered, EffectSize
from shockrig.files.profile import DiffusivityRow, Profile, StatedEffect, Uncertain

PROFILE = typical_profile()
QUIET = Profile(
    dataclasses.replace(PROFILE.temperature, noise_k=0.004),
    dataclasses.replace(PROFILE.humidity, noise_percent=0.02),
)
SPEED = Stream(np.array([5.0]))


def effect(id_, **values):
    return StatedEffect(id_, {k: Uncertain(*v) if isinstance(v, tuple) else Uncertain(v) for k, v in values.items()})


def bead(*effects, body="sphere"):
    return bead_response(dataclasses.replace(PROFILE.temperature, effects=effects), SPEED, body)


def film(*effects, body="film"):
    return film_response(dataclasses.replace(PROFILE.humidity, effects=effects), np.array([20.0]), SPEED, body)


def rms(error):
    return float(np.sqrt(np.nanmean(np.square(error))))


# -- the simulator against the closed forms --------------------------------------------------


def test_the_simulator_has_every_body():
    assert set(SHAPES) == set(BODIES)


@pytest.mark.parametrize("biot", [np.inf, 0.7, 8.0])
@pytest.mark.parametrize("name", BODIES)
def test_cells_follow_the_closed_form_of_their_body(name, biot):
    """Two programs, one physics: a ramp of one second, so that neither is at its weakest."""
    rate, time = 0.3, np.arange(3001.0) * FINE_STEP_S
    air = np.clip(time - 1.0, 0.0, 1.0)
    found = march(cells(name), np.array(rate), np.array(biot), air[None])[0]
    body = BODIES[name].held() if np.isinf(biot) else BODIES[name].behind(biot)
    expected = body.scaled(rate).ramp(time - 1.0, 1.0)
    np.testing.assert_allclose(found, expected, atol=1.5e-3)


@pytest.mark.parametrize("name", BODIES)
def test_the_modes_of_cells_do_as_the_cells(name):
    """Both ways to step two bodies whose rates change: a factor of one in every cell asks for the system."""
    drive = np.cumsum(np.random.default_rng(1).normal(0.0, 0.01, (2, 900)), axis=1)
    rate, biot = 0.3 * np.exp(drive), np.array([[np.inf], [0.7]])
    by_cells = march(cells(name), rate, biot, drive, lambda step, state: np.ones(state.shape))
    np.testing.assert_allclose(march(cells(name), rate, biot, drive), by_cells, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", BODIES)
def test_bodies_that_a_campaign_states_are_corrected_as_such(name):
    profile = dataclasses.replace(QUIET, sensors={"imet": {"body": name}, "hyt": {"body": name}})
    flown = fly(frontal(airspeed_m_s=15.0, lead_m=600.0, width_m=150.0), profile, 2)
    done = correct(to_flight(flown.log), profile)
    for column in ("temperature_c", "humidity_percent"):
        truth, reading = flown.truth[column].to_numpy(), flown.log[column].to_numpy()
        assert rms(getattr(done, column) - truth) < 0.12 * rms(reading - truth), column
    # named by an effect of the profile instead, it is the same body
    named = Profile(
        *(dataclasses.replace(part, effects=(effect(f"body_{name}"),)) for part in (QUIET.temperature, QUIET.humidity))
    )
    again = correct(to_flight(flown.log), named)
    assert np.array_equal(done.temperature_c, again.temperature_c)
    assert np.array_equal(done.humidity_percent, again.humidity_percent)


# -- the response --------------------------------------------------


@pytest.mark.parametrize("name", BODIES)
def test_a_few_modes_keep_the_start_the_end_and_the_lag(name):
    for full in (BODIES[name].held(), BODIES[name].behind(1.5)):
        few = slowest(full, 6 if np.all(full.amplitude <= 0) else 4)
        assert few.rate.size <= 6
        assert few.amplitude.sum() == pytest.approx(-1.0)
        lags = [float(np.sum(modes.amplitude / modes.rate)) for modes in (few, full)]
        assert lags[0] == pytest.approx(lags[1], rel=1e-9)
        early = np.geomspace(0.01, 0.3, 20) / float(full.rate[0])
        np.testing.assert_allclose(few.step(early), full.step(early), atol=0.03)  # alternating signs: not the wrong way
        late = np.array([0.5, 1.0, 2.0]) / float(full.rate[0])
        np.testing.assert_allclose(few.step(late), full.step(late), atol=0.01)


def test_effects_stand_in_the_response_where_the_chain_has_them():
    """Body behind its air film, a sheath around both, a slow share beside: the closed forms of the chain."""
    found = bead(
        effect("parallel_lag", fraction=0.1, time_constant_s=20.0),
        effect("series_lag", time_constant_s=2.0),
        effect("convective_film", biot_at_5_m_s=0.8),
        effect("body_cylinder"),
    )
    alpha = PROFILE.temperature.thermal_diffusivity_m2_s.value
    body = slowest(BODIES["cylinder"].behind(0.8), 4).scaled(alpha / PROFILE.temperature.bead_radius_m**2)
    expected = mix(in_series(body, 2.0), first_order(20.0), 0.1)
    time = np.geomspace(0.05, 80.0, 50)
    np.testing.assert_allclose(found.modes().step(time), expected.step(time), atol=1e-3)  # Biot in steps of 1 %
    frequency = np.geomspace(1e-3, 2.0, 30)
    s = 2j * np.pi * frequency[:, None]
    gain = np.sum(-expected.amplitude * expected.rate / (expected.rate + s), axis=1)
    np.testing.assert_allclose(found.clean(frequency), gain, atol=2e-3)
    assert response_time_s(found) == pytest.approx(response_times(expected)[0], rel=2e-3)
    assert found.slowest_s == pytest.approx(2.0, rel=0.2)  # the slow share carries too little to count


def test_a_slow_share_with_many_time_constants_is_the_mean_of_as_many_lags():
    many = Discovered(
        "parallel_lag",
        "air_temperature",
        size=EffectSize(0.1, 0.01, "1"),
        time_constant_s=Uncertain(6.0, 0.5),
        depends_on=(Dependence("history", "spread", 1.0, 0.1),),
    )
    profile = dataclasses.replace(PROFILE.temperature, discovered=(many,))
    found = bead_response(profile, SPEED, "sphere")
    alone = [bead(effect("parallel_lag", fraction=0.1, time_constant_s=6.0 * np.exp(x))) for x in np.linspace(-1, 1, 7)]
    time = np.geomspace(0.05, 80.0, 50)
    expected = np.mean([one.modes().step(time) for one in alone], axis=0)
    np.testing.assert_allclose(found.modes().step(time), expected, atol=1e-12)
    one = bead_response(
        dataclasses.replace(profile, discovered=(dataclasses.replace(many, depends_on=()),)), SPEED, "sphere"
    )
    assert one.weight.shape == alone[3].weight.shape  # and without a spread it is one


def test_a_slow_sheath_counts_as_the_slowest_lag():
    assert film(effect("series_lag", time_constant_s=300.0)).slowest_s == pytest.approx(300.0)


def test_layers_and_sheaths_widen_the_time_scale_by_their_part_of_the_mean_lag():
    alpha = PROFILE.temperature.thermal_diffusivity_m2_s
    own = alpha.standard_uncertainty / alpha.value
    assert bead().relative_uncertainty[0] == pytest.approx(own)
    # R^2 / alpha (1/6 + 1 / (3 Bi)): at Bi = 2 half of the lag is the air film's
    layer = bead(effect("convective_film", biot_at_5_m_s=(2.0, 0.2)))
    assert layer.relative_uncertainty[0] == pytest.approx(np.hypot(own, 0.05), rel=1e-6)
    # a sheath whose lag is that of the bead: half of the whole is its, and half of alpha's uncertainty is left
    bead_s = PROFILE.temperature.bead_radius_m**2 / alpha.value / 6
    sheath = bead(effect("series_lag", time_constant_s=(bead_s, 0.1 * bead_s)))
    assert sheath.relative_uncertainty[0] == pytest.approx(np.hypot(0.5 * own, 0.05), rel=1e-4)


def test_layers_one_upon_another_add_their_resistances():
    two = (effect("convective_film", biot_at_5_m_s=2.0), effect("convective_film", biot_at_5_m_s=6.0))
    one = bead(effect("convective_film", biot_at_5_m_s=1.5))
    np.testing.assert_allclose(bead(*two).rate, one.rate, rtol=0.01)


# -- a sheath, stepped --------------------------------------------------

SHEATHED = [
    ((1.0,), [0.8, 0.3, 2.0, 0.05], 2),  # one lag, two inside, one beside
    ((1.0,), [0.5, 0.5, 0.5 * (1 + 1e-9), 3.0], 3),  # rates that are equal
    ((2.0, -1.0), [0.4, 0.9, 0.4, 30.0, 1e-4], 2),  # two lags in series, as a mix
]


def continuous(sheath, rate, inside):
    """dq/dt = A q + b u, written out."""
    count, size = len(sheath), len(rate)
    a, b = -np.diag(rate), np.array(rate, dtype=float)
    for k in range(count, count + inside):
        a[k, :count], b[k] = rate[k] * np.array(sheath), 0.0
    return a, b, size


@pytest.mark.parametrize("step_s", [0.01, 0.1, 2.0])
@pytest.mark.parametrize(("sheath", "rate", "inside"), SHEATHED)
def test_steps_are_those_of_the_matrix_exponential(sheath, rate, inside, step_s):
    """Van Loan's block matrix for air that is straight: d/dt (q, u, u') = (A q + b u, u', 0)."""
    a, b, size = continuous(sheath, rate, inside)
    block = np.zeros((size + 2, size + 2))
    block[:size, :size], block[:size, size], block[size, size + 1] = a, b, 1.0
    exact = expm(block * step_s)
    found = stepped(np.array(rate), np.array(step_s), sheath, inside)
    count = len(sheath)
    matrix = np.diag(found.decay)
    matrix[count : count + inside, :count] = found.fed
    np.testing.assert_allclose(matrix, exact[:size, :size], atol=1e-9)
    # u(t) = old + (new - old) t / h
    np.testing.assert_allclose(found.new, exact[:size, size + 1] / step_s, atol=1e-9)
    np.testing.assert_allclose(found.old, exact[:size, size] - exact[:size, size + 1] / step_s, atol=1e-9)
    np.testing.assert_allclose(held_matrix(np.array(rate), step_s, sheath, inside), exact[:size, :size], atol=1e-9)


def test_without_a_sheath_steps_are_those_of_parallel_lags():
    rate, step = np.array([[0.2, 1.5], [0.3, 2.0]]), np.array([0.1, 0.3])
    found = stepped(rate, step)
    for one, other in zip((found.old, found.new, found.decay), hold(rate, step[:, None]), strict=True):
        assert np.array_equal(one, other)


def test_sampled_gains_tend_to_the_continuous_ones():
    response = film(
        effect("series_lag", time_constant_s=4.0), effect("slow_relaxation", fraction=0.1, time_constant_s=30)
    )
    frequency = np.geomspace(1e-3, 0.3, 20)
    clean = response.clean(frequency)
    np.testing.assert_allclose(gain_squared(response, frequency, 0.01)[0], np.abs(clean) ** 2, rtol=2e-3)
    held = transfer_function(sampled(response, 0.01, 0), frequency * 0.01)
    np.testing.assert_allclose(np.abs(held), np.abs(clean), rtol=2e-3)


def test_a_transfer_function_does_not_mind_equal_rates():
    equal = LagResponse(np.array([[0.0, 1.0]]), np.array([[0.5, 0.5]]), np.zeros(1), cap=(1.0,), inside=1)
    frequency = np.array([0.01, 0.1, 0.4])
    z, system = np.exp(2j * np.pi * frequency), sampled(equal, 0.1, 0)
    d = np.exp(-0.05)
    assert system.a == pytest.approx(np.array([[d, 0.0], [0.05 * d, d]]))
    by_hand = system.b[1] / (z - d) + system.a[1, 0] * system.b[0] / (z - d) ** 2
    np.testing.assert_allclose(transfer_function(system, frequency), by_hand, rtol=1e-9)


def test_lags_behind_a_series_pass_through_the_sheath():
    response = LagResponse(np.array([[0.0, 1.0]]), np.array([[0.25, 0.5]]), np.zeros(1), cap=(1.0,), inside=1)
    ramp = np.arange(4000) * 0.1
    lags, _ = lags_behind(ramp, response, 0.1)
    assert ramp[-1] - lags[-1] == pytest.approx([4.0, 6.0], abs=0.11)  # a sample early, as readings are held


# -- flown --------------------------------------------------


def test_a_cap_before_a_film_whose_d_passes_the_caps_own_rate_is_undone():
    """Rates in parallel would have a pole where the film's is the cap's, and D moves through it here."""
    rows = tuple(DiffusivityRow(t, 6e-12 * np.exp((t - 10) / 12), 1e-14) for t in (-10.0, 0.0, 10.0, 20.0, 30.0))
    slow_at = np.pi**2 / 4 * np.array([r.diffusivity_m2_s for r in rows]) / PROFILE.humidity.film_thickness_m**2
    time_constant_s = float(1 / slow_at[1:3].mean())
    assert 1 / slow_at[2] < time_constant_s < 1 / slow_at[1]
    part = dataclasses.replace(
        QUIET.humidity, diffusivity_table=rows, effects=(effect("series_lag", time_constant_s=time_constant_s),)
    )
    profile = Profile(QUIET.temperature, part)
    flown = fly(inversion(strength_k=12.0, surface_temperature_c=5.0, top_m=500.0), profile, 1)
    assert flown.truth["temperature_c"].min() < 3.0 and flown.truth["temperature_c"].max() > 10.0
    truth, reading = flown.truth["humidity_percent"].to_numpy(), flown.log["humidity_percent"].to_numpy()
    inner = slice(None, -50)  # an inverse of two lags does not know how the log goes on
    for method, share in (("smoother", 0.07), ("inverse", 0.2)):
        done = correct(to_flight(flown.log), profile, method).humidity_percent
        assert rms((done - truth)[inner]) < share * rms((reading - truth)[inner]), method


def test_the_stated_uncertainty_of_a_sheath_holds_the_truth():
    """Sheaths drawn about the stated one."""
    stated_s, sigma_s = 3.0, 0.15
    held = []
    for seed in range(4):
        rng = np.random.default_rng([seed, 9])
        drawn = effect("series_lag", time_constant_s=stated_s + sigma_s * rng.standard_normal())
        known = effect("series_lag", time_constant_s=(stated_s, sigma_s))
        true, profile = (
            Profile(dataclasses.replace(PROFILE.temperature, effects=(e,)), PROFILE.humidity) for e in (drawn, known)
        )
        flown = fly(frontal(airspeed_m_s=15.0, lead_m=400.0, width_m=300.0), true, seed)
        done = correct(to_flight(flown.log), profile)
        error = np.abs(done.temperature_c - flown.truth["temperature_c"].to_numpy())
        held.append(np.mean(error < 1.96 * done.temperature_uncertainty_k))
    assert 0.9 < np.mean(held), held


def test_the_paper_knows_two_bodies_and_says_so():
    assert paper_layers("humidity", film(body="sphere"), 0.1)[1] >= 2
    with pytest.raises(
        RefusedError, match="humidity.*a sphere read at its core and a film.*a cylinder read as its mean"
    ):
        paper_layers("humidity", film(body="cylinder_mean"), 0.1)
