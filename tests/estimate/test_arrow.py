"""The arrow matrix against the dense formulae that it stands for, on random blocks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from shockrig.analysis.estimate.arrow import Arrow
from shockrig.analysis.estimate.quantity import RunEffect

R, N, P, U, C = 6, 9, 3, 4, 2


@pytest.fixture(params=range(4))
def case(request):
    rng = np.random.default_rng(request.param)
    prior = np.array([0.0, 2.5, 0.0]) if request.param % 2 else np.zeros(P)
    arrow = Arrow(
        jacobian=rng.standard_normal((R, N, P)) * [1.0, 30.0, 1e-3],
        run_jacobian=rng.standard_normal((R, N, U)),
        weight=np.exp(rng.normal(0.0, 2.0, (R, U))),
        prior_weight=prior,
    )
    residual, deviations = rng.standard_normal((R, N)), 0.3 * rng.standard_normal((R, U))
    return arrow, residual, deviations, rng


def dense(arrow):
    """Sensitivities (R N, P) and (R N, R U), and the whole normal matrix (P + R U square)."""
    jacobian, runs = arrow.jacobian.reshape(R * N, P), block_diag(*arrow.run_jacobian)
    both = np.hstack([jacobian, runs])
    return jacobian, runs, both.T @ both + np.diag(np.concatenate([arrow.prior_weight, arrow.weight.ravel()]))


def marginal(arrow):
    """Inverse covariance (R N square) of whitened data whose runs scatter: noise and random effects together."""
    _, runs, _ = dense(arrow)
    return np.linalg.inv(np.eye(R * N) + runs @ np.diag(1.0 / arrow.weight.ravel()) @ runs.T)


def test_the_normal_matrix_is_the_schur_complement_and_the_covariance_its_inverse(case):
    arrow, *_ = case
    _, _, whole = dense(arrow)
    inverse = np.linalg.inv(whole)[:P, :P]
    assert arrow.normal == pytest.approx(np.linalg.inv(inverse), rel=1e-6)
    assert arrow.covariance() == pytest.approx(inverse, rel=1e-6)
    jacobian, *_ = dense(arrow)
    gls = jacobian.T @ marginal(arrow) @ jacobian + np.diag(arrow.prior_weight)
    assert arrow.normal == pytest.approx(gls, rel=1e-6)


def test_one_step_solves_the_whole_system(case):
    arrow, residual, deviations, rng = case
    jacobian, runs, whole = dense(arrow)
    pull = arrow.prior_weight * rng.standard_normal(P)
    below = runs.T @ residual.ravel() - (arrow.weight * deviations).ravel()
    expected = np.linalg.solve(whole, np.concatenate([jacobian.T @ residual.ravel() + pull, below]))
    own = arrow.run_sides(residual, deviations)
    right, steps = arrow.right_sides(residual, own, pull)
    move = np.linalg.solve(arrow.normal, right)
    assert move == pytest.approx(expected[:P], rel=1e-7)
    assert arrow.run_steps(steps, move) == pytest.approx(expected[P:].reshape(R, U), rel=1e-6, abs=1e-9)
    # At an unmoved theta each run's step is that of its own block.
    alone = np.linalg.solve(whole[P:, P:], below).reshape(R, U)
    assert steps == pytest.approx(alone, rel=1e-7, abs=1e-10)


@pytest.mark.parametrize("damping", [1e-2, 1.0, 1e6])
def test_damping_holds_every_unknown_back_by_its_own_weight(case, damping):
    arrow, residual, deviations, rng = case
    jacobian, runs, whole = dense(arrow)
    pull = arrow.prior_weight * rng.standard_normal(P)
    own = arrow.run_sides(residual, deviations)
    downhill = np.concatenate([jacobian.T @ residual.ravel() + pull, own.ravel()])
    expected = np.linalg.solve(whole + damping * np.diag(np.diag(whole)), downhill)
    damped = arrow.damped(damping)
    right, steps = damped.right_sides(residual, own, pull)
    move = np.linalg.solve(damped.normal, right)
    assert move == pytest.approx(expected[:P], rel=1e-4)
    assert damped.run_steps(steps, move) == pytest.approx(expected[P:].reshape(R, U), rel=1e-4, abs=1e-9)


def test_variances_and_determinant_of_the_runs_random_effects(case):
    arrow, *_ = case
    own = dense(arrow)[2][P:, P:]
    assert arrow.run_variances() == pytest.approx(np.diag(np.linalg.inv(own)).reshape(R, U), rel=1e-9)
    assert arrow.log_determinant() == pytest.approx(np.linalg.slogdet(own)[1], rel=1e-12)


def test_scores_are_those_of_the_marginal_model_with_theta_projected_out(case):
    arrow, residual, deviations, rng = case
    columns = rng.standard_normal((R, N, C))
    jacobian, runs, _ = dense(arrow)
    precision, directions = marginal(arrow), columns.reshape(R * N, C)
    at_zero = residual.ravel() + runs @ deviations.ravel()
    known = jacobian.T @ precision @ jacobian + np.diag(arrow.prior_weight)
    seen = precision - precision @ jacobian @ np.linalg.solve(known, jacobian.T @ precision)
    pull = arrow.prior_weight * rng.standard_normal(P)
    right, normal = arrow.scores(columns, residual, deviations, pull)
    pulled = directions.T @ precision @ jacobian @ np.linalg.solve(known, pull)
    assert right == pytest.approx(directions.T @ seen @ at_zero - pulled, rel=1e-6)
    assert normal == pytest.approx(directions.T @ seen @ directions, rel=1e-6)
    alone, variances = arrow.score_variances(columns, residual, deviations, pull)
    assert alone == pytest.approx(right, rel=1e-6) and variances == pytest.approx(np.diag(normal), rel=1e-6)
    # In a group of runs a column is what it is there, and nothing elsewhere.
    groups = np.array([np.arange(R) >= 2, np.arange(R) < 1]).astype(float)
    scores, sizes = arrow.score_variances(columns, residual, deviations, pull, groups)
    for group, score, size in zip(groups, scores, sizes, strict=True):
        own, variance = arrow.scores(group[:, None, None] * columns, residual, deviations, pull)
        assert score == pytest.approx(own, rel=1e-6) and size == pytest.approx(np.diag(variance), rel=1e-6)


def test_scores_beside_a_model_whose_parameters_are_all_at_their_bounds(case):
    """Nothing of theta is free then: what is left is what the runs' random effects leave."""
    arrow, residual, deviations, rng = case
    held = replace(arrow, jacobian=arrow.jacobian[..., :0], prior_weight=np.zeros(0))
    columns = rng.standard_normal((R, N, C))
    alone, variances = held.score_variances(columns, residual, deviations)
    right, normal = held.scores(columns, residual, deviations)
    assert alone == pytest.approx(right, rel=1e-9) and variances == pytest.approx(np.diag(normal), rel=1e-9)


def test_what_is_off_in_every_run_alike_and_what_random_effects_cannot_hide(case):
    arrow, residual, *_ = case
    jacobian, *_ = dense(arrow)
    precision = marginal(arrow)
    for effect in (RunEffect.START, RunEffect.DESTINATION):
        column = arrow.run_jacobian[..., effect]
        assert arrow.pull(column) == pytest.approx(jacobian.T @ precision @ column.ravel(), rel=1e-7, abs=1e-9)
    assert arrow.hidden(residual) == pytest.approx(residual.ravel() @ precision @ residual.ravel(), rel=1e-9)


def test_the_covariance_is_the_sum_of_what_readings_runs_and_the_prior_give_to_it(case):
    arrow, *_ = case
    from_runs, from_readings = arrow.shares()
    covariance = arrow.covariance()
    from_prior = covariance @ np.diag(np.sqrt(arrow.prior_weight))
    total = sum(x @ x.T for x in (*from_runs, from_readings, from_prior))
    assert total == pytest.approx(covariance, rel=1e-6, abs=1e-12)
    # One run's random effect, off by its standard deviation, moves theta by what the dense equations say.
    whole = dense(arrow)[2]
    run, effect = 2, int(RunEffect.SOURCE)
    inverse = np.linalg.inv(whole)
    moved = -inverse[:P, P + run * U + effect] * np.sqrt(arrow.weight[run, effect])
    assert np.abs(from_runs[effect, :, run]) == pytest.approx(np.abs(moved), rel=1e-6, abs=1e-12)


def test_a_parameter_that_nothing_sees_is_unknown_and_leaves_the_others_alone(case):
    arrow, *_ = case
    blind = np.concatenate([arrow.jacobian, np.zeros((R, N, 1))], axis=-1)
    wider = Arrow(blind, arrow.run_jacobian, arrow.weight, np.append(arrow.prior_weight, 0.0))
    covariance = wider.covariance()
    assert covariance[:P, :P] == pytest.approx(arrow.covariance(), rel=1e-6)
    assert covariance[P, P] > 1e11


def test_what_the_data_see_only_together_is_uncertain_alone():
    """Two columns that rounding alone tells apart: the sum of their parameters is known, neither of them is."""
    rng = np.random.default_rng(2)
    column = rng.standard_normal((R, N, 1))
    for rounding in (0.0, 1e-9, -3e-9):
        jacobian = np.concatenate([column, column * (1.0 + rounding * rng.standard_normal(column.shape))], axis=-1)
        covariance = Arrow(jacobian, np.zeros((R, N, 1)), np.ones((R, 1)), np.zeros(2)).covariance()
        assert covariance.diagonal().min() > 1e6
        assert covariance.sum() == pytest.approx(1.0 / float((column**2).sum()), rel=1e-3)
