"""Runs placed within what is stated of them: nowhere within the limits does a run fit better."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize

from shockrig.analysis.diagnose.held_out import PLACED_WITHIN, placed, run_errors, within_limits
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import Point
from shockrig.analysis.estimate.noise import estimate_noise, whiteners
from shockrig.analysis.estimate.problem import make_problem
from shockrig.analysis.estimate.refitting import plain_fit
from shockrig.files.campaign import Campaign, Run, RunAir, Trace, read_campaign


@pytest.mark.parametrize("memory", [None, 0.995])
@pytest.mark.parametrize("off", [0.15, -0.2])
def test_what_stands_at_a_limit_leaves_the_rest_where_it_fits_best(off, memory):
    """A model too fast, or too slow, for its runs: their rates stand at the limit, their starts beside it.

    Also where the noise has a long memory, so that only the increments of readings are trusted.
    """
    channel = build_channel(read_campaign("data/examples/plain-rough"), "temperature")
    channel = channel.select(np.flatnonzero(np.abs(channel.conditions.thermal_step_k) > 5.0)[:4])
    noise = estimate_noise(channel, channel.quantity.resolution)
    if memory:
        noise = replace(noise, white=0.0005, correlated=0.005, memory=memory)
    problem = make_problem(channel, whiteners(channel, noise))
    plain = plain_fit(problem)
    wrong = replace(plain, theta=plain.theta + off)
    found = placed(problem, wrong)
    limit = PLACED_WITHIN * problem.with_rate_scatter(0.004).scatter
    assert (np.abs(found) <= limit * (1 + 1e-9)).all()
    assert (np.abs(found[:, 1]) > 0.99 * limit[:, 1]).all()

    def cost(x, run):
        point = Point(wrong.theta[None], np.where(np.arange(channel.runs)[:, None] == run, x, 0.0)[None])
        left = (channel.value - plain.model.predict(point)[0])[run]
        return 1e4 * float((channel.count[run] * left**2).sum() / channel.count[run].sum())

    for run in range(channel.runs):
        bounds = list(zip(-limit[run], limit[run], strict=True))
        best = minimize(cost, found[run], (run,), "Nelder-Mead", bounds=bounds, options={"xatol": 1e-6, "fatol": 1e-4})
        assert cost(found[run], run) <= best.fun * 1.01


@pytest.mark.parametrize(("log_rate", "most"), [(-8.6, 0.75), (-8.5, 0.6)])
def test_a_start_long_before_the_record_keeps_to_the_limits_where_it_fits_best(log_rate, most):
    """A tank that runs empty, for a sphere too slow for it: without limits start and source go far away together, to
    where within them it fits badly. Before: it stayed there, 2.0 and 1.0 K off where 0.69 and 0.57 are."""
    random, nobody = np.random.default_rng(3), RunAir(None, None)
    time = 10.0 * np.arange(1.0, 100.0)
    value = 51.0 + 26.0 * np.maximum(1.0 - time / 900.0, 0.0) ** 2 + 0.05 * random.standard_normal(time.size)
    run = Run("0001", nobody, nobody, None, 1000.0, None, None, Trace(time, {"temperature_c": value}), None)
    channel = build_channel(Campaign("tank", None, {}, 4e-4, 1e-5, (run,)), "temperature")
    problem = make_problem(channel, whiteners(channel, estimate_noise(channel)))
    plain = plain_fit(problem)
    slow = replace(plain, theta=np.array([log_rate]))
    assert np.sqrt(run_errors(channel, problem, slow)[0]) < most


def test_what_is_least_within_limits_is_found_for_all_runs_at_once():
    """Where columns differ by orders of size and some nearly coincide, block pivoting alone goes round now and then."""
    rng, (runs, readings, numbers) = np.random.default_rng(1), (600, 30, 6)
    columns = rng.standard_normal((runs, readings, numbers)) * np.exp(2.0 * rng.standard_normal((runs, 1, numbers)))
    columns[..., 1] += 3.0 * columns[..., 0] * rng.random((runs, 1))
    values = 3.0 * rng.standard_normal((runs, readings))
    least, most = (sign * np.exp(rng.standard_normal((runs, numbers)) - 1.0) for sign in (-1.0, 1.0))
    turned = np.swapaxes(columns, 1, 2)
    found = within_limits(turned @ columns, (turned @ values[..., None])[..., 0], least, most)
    each = zip(columns, values, least, most, strict=True)
    one_by_one = np.array([lsq_linear(j, r, limits, method="bvls", tol=1e-14).x for j, r, *limits in each])
    assert found == pytest.approx(one_by_one, rel=1e-6, abs=1e-8)
