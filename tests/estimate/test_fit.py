"""Fitting: known rates come back from exact and noisy data, uncertainties are honest, optimisers agree."""

from dataclasses import replace

import numpy as np
import pytest

from shockrig.analysis.estimate.fit import fit, model_at_samples, rmse_over_samples
from shockrig.analysis.estimate.fit_starts import Misfit, descend, evolve, half_way
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import PLAIN, Model, Point
from shockrig.analysis.estimate.noise import estimate_noise, whiteners
from shockrig.analysis.estimate.problem import Problem, make_problem
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import ROUGH, draw_truth


@pytest.fixture(scope="module")
def channel(tmp_path_factory):
    rng = np.random.default_rng(21)
    folder = simulate_campaign(draw_truth(rng, ROUGH), standard_plan(), rng, tmp_path_factory.mktemp("fit") / "c")
    return build_channel(read_campaign(folder), "humidity")


@pytest.fixture(scope="module")
def whitener(channel):
    return whiteners(channel, estimate_noise(channel))


def made(channel, whitener, seed, rate, scatter=0.004):
    """The channel with readings made from known rates, deviations and noise (binned as the real ones were)."""
    rng = np.random.default_rng(seed)
    problem = make_problem(channel, whitener, rate_scatter=scatter)
    airs_known = np.arange(problem.scatter.shape[1]) != RunEffect.DRIFT
    deviations = channel.at_rest()
    deviations[:, airs_known] = problem.scatter[:, airs_known] * rng.standard_normal((channel.runs, airs_known.sum()))
    value = Model(channel).predict(Point(rate, deviations))[0].copy()
    for run in range(channel.runs):
        filled = channel.count[run] > 0
        colouring = np.linalg.inv(whitener[run][np.ix_(filled, filled)])
        value[run, filled] += colouring @ rng.standard_normal(filled.sum())
    return Problem(replace(channel, value=np.where(channel.count > 0, value, 0.0)), problem.whitener, problem.scatter)


def test_exact_data_give_the_exact_rates(channel, whitener):
    true = np.log(np.geomspace(0.03, 0.3, channel.rates))
    exact = replace(channel, value=Model(channel).predict(Point(true, channel.at_rest()))[0])
    problem = make_problem(exact, whitener)
    found = fit(problem, PLAIN, true + 0.7)
    assert found.theta == pytest.approx(true, abs=2e-3)
    assert found.converged
    assert np.abs(found.residual).max() < 0.05


def test_uncertainties_are_those_that_repeated_data_show(channel, whitener):
    """z over 40 repeats and all ambients: mean 0, standard deviation 1 (its own error is 4 %)."""
    true = np.log(np.geomspace(0.03, 0.3, channel.rates))
    z = []
    for seed in range(40):
        found = fit(made(channel, whitener, seed, true), PLAIN, true + 0.1)
        z.append((found.theta - true) / np.sqrt(np.diag(found.covariance)))
    z = np.array(z)
    assert z.std() == pytest.approx(1.0, abs=0.15)
    assert abs(z.mean()) < 4 / np.sqrt(z.size)
    assert 0.90 <= np.mean(np.abs(z) < 2) <= 0.99


def test_the_answer_does_not_hang_on_the_start_or_the_order_of_runs(channel, whitener):
    true = np.log(np.geomspace(0.03, 0.3, channel.rates))
    problem = made(channel, whitener, 1, true)
    first = fit(problem, PLAIN, true - 0.8)
    second = fit(problem, PLAIN, true + 0.8)
    sd = np.sqrt(np.diag(first.covariance))
    assert np.all(np.abs(first.theta - second.theta) < 0.6 * sd)
    shuffled = np.random.default_rng(0).permutation(channel.runs)
    third = fit(problem.select(shuffled), PLAIN, true - 0.8)
    assert third.theta == pytest.approx(first.theta, abs=1e-6)
    assert third.covariance == pytest.approx(first.covariance, rel=1e-4, abs=1e-12)


def test_runs_that_scatter_more_widen_the_uncertainty(channel, whitener):
    true = np.log(np.geomspace(0.03, 0.3, channel.rates))
    calm = fit(made(channel, whitener, 2, true, scatter=0.002), PLAIN, true)
    rough = fit(made(channel, whitener, 2, true, scatter=0.02), PLAIN, true)
    assert rough.rate_scatter > 2 * calm.rate_scatter
    assert np.sqrt(np.diag(rough.covariance))[2] > 1.5 * np.sqrt(np.diag(calm.covariance))[2]


def test_evolution_and_descent_end_at_the_same_minimum(channel):
    """And it is the minimum of the RMSE: a fine scan finds nothing lower."""
    c = channel.conditions
    sub = channel.select((channel.ambient == 2) & (np.abs(c.destination_c - c.source_c) < 1.0))
    misfit = Misfit(sub)
    first = evolve(misfit, np.random.default_rng(0))
    second = descend(misfit)
    assert first.log_rate == pytest.approx(second.log_rate, abs=3e-3)
    scan = np.linspace(np.log(2e-4), np.log(30.0), 600)
    assert first.rmse <= misfit(scan).min() + 1e-9 and second.rmse <= misfit(scan).min() + 1e-9
    assert first == evolve(misfit, np.random.default_rng(0))
    assert half_way(sub) == pytest.approx(first.log_rate, abs=0.15)


def test_a_population_at_once_is_its_members_one_by_one(channel):
    misfit = Misfit(channel.select(channel.ambient == 1))
    rates = np.log(np.geomspace(0.01, 1.0, 7))
    assert misfit(rates) == pytest.approx([float(misfit(rates[i : i + 1])[0]) for i in range(7)])


def test_rmse_over_samples_is_the_definition(channel, whitener):
    """sqrt(mean (reading - model)^2) over the single samples, and the model there is that of the bins in between."""
    theta = np.log(np.full(channel.rates, 0.2))
    found = fit(make_problem(channel, whitener), PLAIN, theta)
    models = model_at_samples(channel, found)
    off = np.concatenate(
        [(v - m)[p >= 0] for (_, v), m, p in zip(channel.samples, models, channel.bin_of, strict=True)]
    )
    assert rmse_over_samples(channel, found) == pytest.approx(float(np.sqrt(np.mean(off**2))))
    run, narrow = 0, channel.count[0] == 1
    binned = Model(channel).predict(found.point)[0, run]
    place = channel.bin_of[run]
    single = [i for i in range(place.size) if place[i] >= 0 and narrow[place[i]]]
    assert models[run][single] == pytest.approx(binned[place[single]], abs=1e-9)
