"""Predictive densities of unseen runs: against conditional densities of the joint distribution, written out in full."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_t

from shockrig.analysis.estimate.fit import fit, rmse_over_samples
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.noise import estimate_noise, whiteners
from shockrig.analysis.estimate.predictive import (
    DISCREPANCIES,
    NOISE_DEGREES,
    Gram,
    allowing,
    as_stated,
    bumps,
    densities,
    gram,
    no_surer,
    score,
    stated_beside,
    weights,
)
from shockrig.analysis.estimate.problem import make_problem
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.estimate.refitting import plain_fit
from shockrig.files.campaign import read_campaign

RUNS, READINGS, PARAMETERS, OWN, BUMPS = 5, 9, 3, 2, 4


@pytest.fixture(scope="module")
def linear():
    """Whitened columns of a linear model (J, U, B), residuals r, variances of random effects, a prior, and their
    products."""
    rng = np.random.default_rng(1)
    j, u, b = (rng.normal(size=(RUNS, READINGS, k)) for k in (PARAMETERS, OWN, BUMPS))
    r, own = 2.0 * rng.normal(size=(RUNS, READINGS)), rng.uniform(0.1, 3.0, (RUNS, OWN))
    prior, pull = rng.uniform(0.1, 2.0, PARAMETERS), rng.normal(size=PARAMETERS)
    both = np.concatenate([j, u, b, r[..., None]], axis=-1)
    products = both.transpose(0, 2, 1) @ both
    p = PARAMETERS
    g = Gram(
        jj=products[:, :p, :p],
        jv=products[:, :p, p:-1],
        jr=products[:, :p, -1],
        vv=products[:, p:-1, p:-1],
        vr=products[:, p:-1, -1],
        rr=products[:, -1, -1],
        own=own,
        prior=prior,
        pull=pull,
        count=np.full(RUNS, float(READINGS)),
    )
    return g, (j, u, b, r)


def conditional(g, columns, discrepancy, blocks, misfit=1.0):
    """Log density of each block of runs given all others, from the joint distribution of all readings: Student's, with
    the slope of Gauss's where a run is as far off as its noise is large."""
    j, u, b, r = columns
    runs, readings = r.shape
    joint, mean = np.zeros((r.size, r.size)), j.reshape(r.size, -1) @ (g.pull / g.prior)
    for i in range(runs):
        own = slice(i * readings, (i + 1) * readings)
        joint[own, own] = misfit**2 * np.eye(readings) + u[i] * g.own[i] @ u[i].T + discrepancy**2 * b[i] @ b[i].T
    joint += j.reshape(r.size, -1) / g.prior @ j.reshape(r.size, -1).T
    said = []
    for block in np.unique(blocks):
        here = np.repeat(blocks == block, readings)
        y, centred = r.ravel()[here], (r.ravel() - mean)[~here]
        gain = np.linalg.solve(joint[np.ix_(~here, ~here)], joint[np.ix_(~here, here)]).T
        expected = mean[here] + gain @ centred
        left = joint[np.ix_(here, here)] - gain @ joint[np.ix_(~here, here)]
        n = int(g.count[blocks == block].sum())  # an empty bin has no reading, and its column is nought
        student = multivariate_t(expected[:n], np.eye(n), df=NOISE_DEGREES)
        # The same distance from the centre along one axis, in units of the density's own covariance.
        away = np.zeros(n)
        square = (y - expected) @ np.linalg.solve(left, y - expected)
        away[0] = np.sqrt(max(square, n))  # nearer than noise leaves it the density is Gauss's
        typical = np.zeros(n)
        typical[0] = np.sqrt(n)
        density = student.logpdf(expected[:n] + away) - student.logpdf(expected[:n] + typical)
        density += 0.5 * max(n - square, 0.0)
        said.append(density - 0.5 * n - 0.5 * np.linalg.slogdet(left)[1])
    return np.array(said)


@pytest.mark.parametrize("blocks", [None, [0, 0, 1, 2, 1]])
@pytest.mark.parametrize(("discrepancy", "misfit"), [(0.0, 1.0), (0.7, 1.0), (0.0, 4.0), (0.7, 0.5)])
def test_a_density_is_that_of_a_run_given_all_others(linear, discrepancy, misfit, blocks):
    g, columns = linear
    blocks = None if blocks is None else np.array(blocks)
    exact = conditional(g, columns, discrepancy, np.arange(RUNS) if blocks is None else blocks, misfit)
    found = densities(g, np.array([discrepancy]), blocks, misfit)[0]
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-8)


@pytest.fixture(scope="module")
def fitted():
    """Six runs of an example, its plain fit, and what it may be wrong by."""
    channel = build_channel(read_campaign("data/examples/plain-rough"), "temperature")
    channel = channel.select(np.arange(channel.runs) < 6)
    problem = make_problem(channel, whiteners(channel, estimate_noise(channel)))
    return problem, plain_fit(problem), bumps(problem)


def test_the_products_of_a_fit_are_those_of_its_whitened_columns(fitted):
    """Residuals are taken at random effects of zero; what stands at no bound has a density of its own before data."""
    problem, found, bump = fitted
    g, j, u = gram(problem, found, bump), found.arrow.jacobian, found.arrow.run_jacobian
    r = problem.whiten(found.residual) + np.einsum("rnu,ru->rn", u, found.deviations)
    np.testing.assert_allclose(g.own, problem.with_rate_scatter(found.rate_scatter).scatter ** 2)
    for discrepancy in (0.0, 0.003):
        exact = conditional(g, (j, u, bump, r), discrepancy, np.arange(problem.channel.runs))
        np.testing.assert_allclose(densities(g, np.array([discrepancy]))[0], exact, atol=1e-5)


def test_a_score_is_the_best_over_what_a_model_may_be_wrong_by(fitted):
    problem, found, bump = fitted
    g, rated = gram(problem, found, bump), score(problem, found, bump)
    tried = [float(densities(g, np.array([sigma])).sum()) for sigma in DISCREPANCIES]
    assert rated.total == pytest.approx(max(tried)) and rated.discrepancy == DISCREPANCIES[np.argmax(tried)]
    assert rated.runs.shape == (6,)


def test_readings_far_from_a_model_make_no_start_less_well_known(fitted):
    """Of two models that leave much, one by a hundredth less but with every start off by six of its sigmas."""
    problem, found, bump = fitted
    random = np.random.default_rng(5).normal(size=found.residual.shape)
    left = 20.0 * random * (problem.channel.count > 0) * np.abs(found.residual).mean()
    deviations = found.deviations.copy()
    deviations[:, RunEffect.START] += 6.0 / np.sqrt(found.arrow.weight[:, RunEffect.START])
    started, near = replace(found, residual=left, deviations=deviations), replace(found, residual=1.01 * left)
    g = gram(problem, started, bump)
    assert (
        densities(g, DISCREPANCIES).sum(axis=1).max()
        > densities(gram(problem, near, bump), DISCREPANCIES).sum(axis=1).max()
    )
    assert score(problem, near, bump).total > score(problem, started, bump).total + 3.0


def test_a_fit_that_lets_rates_scatter_is_scored_by_the_usual_scatter_as_well(fitted):
    """Runs that do not differ are predicted worse where rates may differ by a tenth: that is no part of the model."""
    problem, found, bump = fitted

    def spread(by):
        weight = found.arrow.weight.copy()
        weight[:, RunEffect.RATE] = 1.0 / by**2
        return replace(found, arrow=replace(found.arrow, weight=weight))

    wide, usual = spread(0.1), score(problem, spread(problem.rate_scatter), bump)
    assert densities(gram(problem, wide, bump), DISCREPANCIES).sum(axis=1).max() < usual.total - 3.0
    assert score(problem, wide, bump).total == pytest.approx(usual.total)


def test_parameters_are_as_uncertain_as_what_the_model_is_wrong_by_moves_them(fitted):
    """Against the joint least squares of parameters and random effects, solved for many draws of a discrepancy."""
    problem, found, bump = fitted
    sigma, draws = 0.02, 400
    g, j, u = gram(problem, found, bump), found.arrow.jacobian, found.arrow.run_jacobian
    runs, own, parameters = j.shape[0], u.shape[-1], j.shape[-1]
    columns = np.zeros((*j.shape[:2], parameters + runs * own))
    columns[..., :parameters] = j
    for run in range(runs):
        columns[run, :, parameters + run * own : parameters + (run + 1) * own] = u[run]
    columns = columns.reshape(-1, columns.shape[-1])
    normal = columns.T @ columns + np.diag(np.concatenate([g.prior, (1.0 / g.own).ravel()]))
    wrong = np.einsum("rnk,drk->drn", bump, np.random.default_rng(3).normal(0.0, sigma, (draws, runs, bump.shape[-1])))
    moved = np.linalg.solve(normal, columns.T @ wrong.reshape(draws, -1).T)[:parameters]
    wider = no_surer(problem, found, bump, sigma, False).covariance
    np.testing.assert_allclose(wider - found.covariance, np.cov(moved), rtol=0.25)
    assert wider[0, 0] > 4.0 * found.covariance[0, 0]
    assert no_surer(problem, found, bump, 0.0, False) is found


def test_parameters_are_no_surer_than_runs_agree_on_them(fitted):
    """Runs whose rates differ by far more than each says of its own: the spread of the runs' own estimates."""
    problem, found, bump = fitted
    apart = 0.2 * np.resize([1.0, -1.0], problem.channel.runs)
    faster = np.linalg.pinv(problem.whitener) @ found.arrow.jacobian[..., :1]
    residual = found.residual + apart[:, None] * faster[..., 0]
    again = no_surer(problem, replace(found, residual=residual), bump, 0.0, True)
    assert np.sqrt(again.covariance[0, 0]) > 5.0 * np.sqrt(found.covariance[0, 0])
    assert no_surer(problem, found, bump, 0.0, True).covariance[0, 0] < 4.0 * found.covariance[0, 0]


def test_a_whitener_that_allows_for_a_discrepancy_is_the_root_of_both(fitted):
    """|W' e|^2 is e' (K + s^2 H H')^-1 e for any e, with K the noise and H the bumps in the readings' unit."""
    problem, _, bump = fitted
    again = allowing(problem, bump, 0.02).whitener
    for run in range(2):
        inverse = np.linalg.inv(problem.whitener[run])
        bumps_in_kelvin = inverse @ bump[run]
        covariance = inverse @ inverse.T + 0.02**2 * bumps_in_kelvin @ bumps_in_kelvin.T
        np.testing.assert_allclose(again[run] @ covariance @ again[run].T, np.eye(len(inverse)), atol=1e-8)
        # In whitened units it is the symmetric root.
        turned = again[run] @ inverse
        np.testing.assert_allclose(turned, turned.T, atol=1e-10)
    assert allowing(problem, bump, 0.0) is problem


def test_beside_a_discrepancy_parameters_are_less_certain(fitted):
    problem, found, bump = fitted
    wrong = stated_beside(problem, found, bump, 0.02)
    assert stated_beside(problem, found, bump, 0.0) is found
    assert wrong.covariance[0, 0] > 4.0 * found.covariance[0, 0]
    assert abs(wrong.theta[0] - found.theta[0]) < 4.0 * np.sqrt(wrong.covariance[0, 0])


def test_of_two_fits_of_a_single_run_the_one_that_leaves_less_of_its_readings_is_stated(fitted):
    problem, found, bump = fitted
    far = replace(found, theta=found.theta + np.eye(found.theta.size)[0])
    assert as_stated(problem, far, bump, 0.02, False).theta is far.theta
    run = np.abs(problem.channel.conditions.thermal_step_k).argmax(keepdims=True)
    one = problem.select(run)
    found = fit(one, found.structure, found.theta, found.deviations[run])
    far = replace(found, theta=found.theta + np.eye(found.theta.size)[0])
    left = rmse_over_samples(one.channel, as_stated(one, far, bump[run], 0.02, False))
    assert left < 0.5 * rmse_over_samples(one.channel, far)


def test_models_that_predict_alike_share_and_one_far_behind_has_nothing():
    runs = np.random.default_rng(2).normal(size=30)
    own = weights([runs, runs, runs - 2.0], [0.0, 0.0, 0.0])
    assert own == pytest.approx([0.5, 0.5, 0.0], abs=1e-6) and own.sum() == pytest.approx(1.0)
    odds = weights([runs, runs], [0.0, -np.log(3.0)])
    assert odds == pytest.approx([0.75, 0.25])


def test_what_one_run_says_alone_is_not_certain():
    """Better by ten in a single run of thirty, by nothing in the others: drawn again, many sets lack it."""
    runs = np.zeros(30)
    one = runs.copy()
    one[7] = 10.0
    every = runs + 10.0 / 30.0
    assert weights([one, runs], [0.0, 0.0])[0] < 0.98
    assert weights([every, runs], [0.0, 0.0])[0] > 0.999


def test_a_fit_so_far_off_that_its_squares_are_rounding_says_nothing(fitted):
    problem, found, bump = fitted
    below = replace(gram(problem, found, bump), rr=np.full(problem.channel.runs, -1e9))
    assert np.isnan(densities(below, np.zeros(1))).all()
