"""The chain against closed forms and other integrations; the mean of readings that a logger writes against the plain
mean."""

from dataclasses import replace

import numpy as np
import pytest
from small_worlds import record

from shockrig.analysis.effects import CATALOGUE, structure_of
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import Model, Point
from shockrig.analysis.estimate.quantity import QUANTITIES, RunEffect
from shockrig.analysis.physics import readings as concentration
from shockrig.analysis.physics.chain import JUMP_K, at_jump, discrete_gauss, evaluate
from shockrig.analysis.physics.humidity import (
    dew_point_c,
    humidity_from_ppmv,
    ppmv_from_humidity,
    saturation_pressure_hpa,
)
from shockrig.analysis.physics.modes import film_mean, sphere_core


@pytest.fixture(scope="module")
def channels(tmp_path_factory):
    campaign = record(tmp_path_factory.mktemp("chain") / "c", 5)
    return {name: build_channel(campaign, name) for name in QUANTITIES}


def plain(channel, rate):
    return Model(channel).predict(Point(np.full(channel.rates, np.log(rate)), channel.at_rest()))[0]


def test_plain_chain_is_the_closed_form(channels):
    channel = channels["temperature"]
    found = plain(channel, 0.5)
    c = channel.conditions
    rise = sphere_core().step(0.5 * channel.time_s)
    expected = c.source_c[:, None] + (c.destination_c - c.source_c)[:, None] * rise
    assert found == pytest.approx(expected, abs=1e-6)

    channel = channels["humidity"]
    found = plain(channel, 0.05)
    c = channel.conditions
    before, after = (
        ppmv_from_humidity(c.source_percent, c.source_c),
        ppmv_from_humidity(c.destination_percent, c.destination_c),
    )
    held = before[:, None] + (after - before)[:, None] * film_mean().step(0.05 * channel.time_s)
    air = np.where(channel.time_s > 0, c.destination_c[:, None], c.source_c[:, None])
    assert found == pytest.approx(humidity_from_ppmv(held, air), abs=1e-5)


LAGGING = {
    "convective_film": {"biot_at_5_m_s": 8.0},
    "sheath": {"time_constant_s": 2.0, "capacity": 0.3},
    "series_lag": {"time_constant_s": 0.7},
    "parallel_lag": {"fraction": 0.05, "time_constant_s": 9.0},
}


def test_candidates_at_once_read_as_each_by_itself(channels):
    """Those that differ only in what a response is multiplied with, or in nothing, share one response."""
    channel = channels["temperature"]
    model = Model(channel, structure_of(LAGGING))
    theta = model.start(np.array([np.log(0.3)]), {f"{e}.{p}": v for e, own in LAGGING.items() for p, v in own.items()})
    count = 1 + theta.size + channel.at_rest().shape[-1]
    thetas, deviations = np.tile(theta, (count, 1)), np.tile(channel.at_rest(), (count, 1, 1))
    for k in range(theta.size):
        thetas[1 + k, k] += 0.01
    for k in range(deviations.shape[-1]):
        deviations[-1 - k, :, k] += 0.01
    alone = [model.predict(Point(thetas[i], deviations[i]))[0] for i in range(count)]
    np.testing.assert_allclose(model.predict(Point(thetas, deviations)), alone, rtol=0, atol=1e-12)


def test_which_readings_say_nothing_is_told_by_what_was_recorded(channels):
    """RH jumps where the air's temperature does. A model that takes another temperature for an air mutes no reading by
    that: else one that misses the first readings would choose not to be asked."""
    channel = channels["humidity"]
    jumps = np.abs(channel.conditions.thermal_step_k) > JUMP_K
    muted = []
    for warmer_k in (0.0, 2.0):
        deviations = channel.at_rest()[None].copy()
        deviations[..., RunEffect.DESTINATION_C] = warmer_k
        muted.append(at_jump(Model(channel).chain(Point(np.full((1, channel.rates), -3.0), deviations))))
    np.testing.assert_array_equal(*muted)
    assert 0 < jumps.sum() < channel.runs
    assert muted[0][jumps].any() and not muted[0][~jumps].any()


def test_saturation_pressure_known_values():
    """Boiling point by definition; Murphy and Koop (2005) over water at 0, 20 and 40 degC; dew point is its inverse."""
    assert saturation_pressure_hpa(100.0) == pytest.approx(1013.25)
    assert saturation_pressure_hpa([0.0, 20.0, 40.0]) == pytest.approx([6.1115, 23.393, 73.849], rel=2.2e-3)
    assert dew_point_c([100.0, 37.0], [12.0, -5.0])[0] == pytest.approx(12.0)
    dew = dew_point_c(37.0, -5.0)
    assert saturation_pressure_hpa(dew) == pytest.approx(0.37 * saturation_pressure_hpa(-5.0), rel=1e-9)


@pytest.mark.parametrize("ratio", [0.3, 3.0])
def test_concentration_warp_against_an_independent_integration(ratio):
    """Method of lines on a uniform grid with scipy's stiff solver; u is 1 at the surface, D falls from `ratio` to 1."""
    from scipy.integrate import solve_ivp

    cells = 300
    h, kappa = 1.0 / cells, ratio - 1.0

    def rhs(_, u):
        d = 1.0 + kappa * (1.0 - u)
        face = 0.5 * (d[1:] + d[:-1]) * np.diff(u) / h
        last = 0.5 * (d[-1] + 1.0) * (1.0 - u[-1]) / (h / 2)
        flux = np.concatenate([[0.0], face, [last]])
        return np.diff(flux) / h

    times = np.array([0.03, 0.1, 0.3, 0.8, 1.6])
    band = solve_ivp(rhs, (0, 1.6), np.zeros(cells), "LSODA", t_eval=times, rtol=1e-7, atol=1e-9, lband=1, uband=1)
    uptake = band.y.mean(axis=0)
    warped = film_mean().step(times * concentration.time_warp(times, np.full(times.size, ratio)))
    assert warped == pytest.approx(uptake, abs=2e-3)


ALONE = [(effect, name) for effect, entry in CATALOGUE.items() for name in entry.channels if not entry.readout.averages]
TOGETHER = [
    ({"finite_transfer.duration_s": 2.0}, "humidity"),
    ({"finite_transfer.duration_s": 6.0, "air_relaxation.fraction": 0.1}, "humidity"),
    (
        {"finite_transfer.duration_s": 4.0, "concentration_dependent_diffusivity.slope_per_unit_activity": 1.2},
        "humidity",
    ),
    ({"condensation.drying_time_s": 0.3, "hysteresis.rh_percent": 2.0}, "humidity"),
    ({"condensation.drying_time_s": 20.0, "finite_transfer.duration_s": 4.0}, "humidity"),
    (
        {"evaporative_cooling.depression_k": 0.5, "calibration_error.gain": 0.02, "dead_time.delay_s": 0.2},
        "temperature",
    ),
    ({"finite_transfer.duration_s": 0.5, "convective_film.biot_at_5_m_s": 0.1}, "temperature"),
]


@pytest.mark.parametrize("count", [2, 6, 11, 24])
@pytest.mark.parametrize(
    ("values", "name"),
    [({}, "temperature"), ({}, "humidity"), *(({effect: None}, name) for effect, name in ALONE), *TOGETHER],
)
def test_a_mean_of_readings_is_the_mean_of_readings(channels, values, name, count):
    """Closed forms and Gauss nodes against all of the readings, each by itself, to 1e-5 of the step; jumps included.

    The die's own trace is known at its samples alone and straight between them, which Gauss nodes are no better than:
    0.1 K for a calibration that moves with it. What walls radiate is taken at the mean reading, which bends little. The
    humidity at a film's own temperature is straight between knots, which lie elsewhere for a shorter record.
    """
    within = {"calibration_temperature": 6e-3, "wall_radiation": 3e-4, "uptake_by_activity": 4e-4}
    channel = channels[name]
    given = {key: value for key, value in values.items() if value is not None}
    structure = structure_of({key.partition(".")[0] for key in values})
    model, period = Model(channel, structure), channel.sampling_period_s
    theta = model.start(np.full(channel.rates, np.log(0.3)), given)
    chain = model.chain(Point(theta[None], channel.at_rest()[None]))
    dies = [channel.die_earlier_c(j * period) for j in range(count)]
    earlier = [replace(channel, time_s=channel.time_s - j * period) for j in range(count)]
    single = [replace(chain, channel=earlier[j], time_s=chain.time_s - j * period, die_c=dies[j]) for j in range(count)]
    expected = np.mean([evaluate(one, channel.quantity.reading) for one in single], axis=0)
    found = evaluate(replace(chain, averaged=count), channel.quantity.reading)
    step = np.maximum(np.ptp(expected, axis=-1, keepdims=True), 1.0)
    usual = 5e-5 if chain.at_die_temperature else 1e-5
    assert (np.abs(found - expected) / step).max() < max([usual, *(within.get(id_, 0.0) for id_ in structure.ids)])


def test_a_clip_has_its_corner_anywhere_and_the_mean_across_it_is_good_to_a_thousandth(channels):
    channel = channels["humidity"]
    structure = structure_of(["saturation_clipping"], [("saturation_clipping", "limit_percent", 70.0)])
    rates = np.full((1, channel.rates), np.log(0.3))
    chain = Model(channel, structure).chain(Point(rates, channel.at_rest()[None]))
    single = [replace(chain, time_s=chain.time_s - 0.1 * j) for j in range(11)]
    expected = np.mean([evaluate(one, channel.quantity.reading) for one in single], axis=0)
    found = evaluate(replace(chain, averaged=11), channel.quantity.reading)
    assert found == pytest.approx(expected, abs=0.06)


@pytest.mark.parametrize("count", [6, 11, 24, 600])
def test_discrete_gauss_is_exact_for_polynomials(count):
    """To degree 2 nodes - 1, scaled to -1 .. 1; and no further."""
    nodes, weights = discrete_gauss(count, 5)
    middle = 0.5 * (count - 1)
    assert weights.sum() == pytest.approx(1.0) and np.all(weights > 0)
    assert nodes.min() > -1e-9 and nodes.max() < count - 1 + 1e-9
    readings = (np.arange(count) - middle) / middle
    for degree in range(10):
        assert weights @ ((nodes - middle) / middle) ** degree == pytest.approx((readings**degree).mean(), abs=1e-12)
    assert abs(weights @ ((nodes - middle) / middle) ** 10 - (readings**10).mean()) > 1e-6
