"""Figures that are no straight function of what is uncertain: distributions of the inputs propagated (JCGM 101).

Behind an air film alpha is known to a fifth or worse, and along the ridge on which alpha and the film do nearly the
same the readings bend. The ridge is followed through points theta_j with readings z_j, sensitivities J_j and U_j to
theta and to each run's random effects u; for readings that are off by e a fit would end on it where
    S_j(e) = min over u, and theta across the ridge, of |z_j + J_j (theta - theta_j) + U_j u - e|^2 + |u|^2 / scatter^2
is least, with what is known of theta beforehand as further readings. An input's sensitivity is then the slope of the
best straight line over many draws of all inputs; what no straight line explains is a line of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from shockrig.analysis.estimate.arrow import Arrow
from shockrig.analysis.estimate.fit import Fit, linearise
from shockrig.analysis.estimate.model import Point
from shockrig.analysis.estimate.problem import Problem

Array = NDArray[np.float64]
LogFigure = Callable[[Array], tuple[float, Array]]  # of theta (P,): logarithm of a figure, and its slopes (P,)

LEAST_SPREAD = 0.05  # of ln theta along an axis: below, exp is straight to a tenth of a percent of u
TOLERANCE_OF_U = 0.05  # of u, within which a straight response will do (JCGM 101, 8.1: half a digit of a two-digit u)
MONTE_CARLO_DRAWS = 10_000
RIDGE_STEP, RIDGE_GROWTH = 0.2, 1.12  # standard deviations between points of the ridge, and how the distance grows
FARTHEST_MISFIT = 30.0  # misfit of a ridge's ends: nothing drawn is beyond
MOST_POINTS = 40
RIDGE_LOOKS = 2
UNSEEN_SIGMAS = 0.02  # standard deviations of the noise
TINY_SPREAD = 1e-9


@dataclass(frozen=True)
class Ridge:
    """A fit's ridge, for n points; a run's readings are given in the k directions in which any of it moves.

    Attributes
    ----------
    at : ndarray (n,)
        Coordinates of the points, in standard deviations of the first order; rising, 0 is the fit.
    theta : ndarray (n, P)
    across : ndarray (P, P - 1)
        Directions that leave the coordinate as it is.
    basis : ndarray (R, bins, k)
        Of whitened readings.
    z, jacobian : ndarray (n, R, k), (n, R, k, P - 1)
    metric : ndarray (n, R, k, k)
        What the runs' random effects leave of a squared length.
    effects : ndarray (R, k, U)
        What each random effect does to the readings when it is off by its standard deviation.
    known : ndarray (P,)
        1 / standard deviation of what is known of theta beforehand.
    disturbances : tuple of (ndarray (R, k), ndarray (P,))
        What one standard uncertainty of each input that no parameter stands for does to the readings, and to theta
        whatever the readings.
    """

    at: Array
    theta: Array
    across: Array
    basis: Array
    z: Array
    jacobian: Array
    metric: Array
    effects: Array
    known: Array
    disturbances: tuple[tuple[Array, Array], ...]

    @property
    def fit(self) -> int:
        """Which point is the fit."""
        return int(np.flatnonzero(self.at == 0.0)[0])


@dataclass(frozen=True)
class Drawn:
    """A figure's logarithm over many draws of all inputs.

    `error` (MONTE_CARLO_DRAWS,) is by how much it is off, `contributions` of each input what the best straight line
    gives it, with a sign where it is one number for all runs.
    """

    error: Array
    contributions: tuple[float, ...]

    @property
    def beyond(self) -> float:
        """Standard deviation of what no straight line explains."""
        straight = sum(one**2 for one in self.contributions)
        return float(np.sqrt(max(float(np.var(self.error)) - straight, 0.0)))

    def interval(self, rest: float, coverage_factor: float) -> tuple[float, float]:
        """Ends of the coverage interval, relative to the value, as much beyond one as beyond the other.

        `rest` is the relative standard uncertainty of what was not drawn; a coverage factor above 2 (few degrees of
        freedom) takes the ends as much further out as a normal distribution's.
        """
        more = rest * np.random.default_rng(102).standard_normal(self.error.size)
        low, high = np.quantile(self.error + more, [ndtr(-coverage_factor), ndtr(coverage_factor)])
        return float(np.expm1(low)), float(np.expm1(high))


def straight(relative_u: float, expanded: float, ends: tuple[float, float]) -> bool:
    """Whether y +- U, from the first order, is the interval to within the tolerance (JCGM 101, 8.1)."""
    return max(abs(ends[0] + expanded), abs(ends[1] - expanded)) < TOLERANCE_OF_U * relative_u


def ridge(problem: Problem, found: Fit, disturbances: Sequence[tuple[Array, Array]]) -> Ridge | None:
    """The ridge of a fit along the widest axis of its logarithms; None where that is too narrow to bend.

    `disturbances` are as a Ridge has them, of whitened readings (R, bins).
    """
    direction, spread = _widest(found)
    if spread < LEAST_SPREAD:
        return None
    problem, model = problem.with_rate_scatter(found.rate_scatter), found.model
    start = found.theta.copy()
    start[model.behind] = 0.0  # what all runs share is drawn about zero, as what each run does of its own
    across = np.linalg.svd(direction[None])[2][1:].T
    at_rest, known = problem.channel.at_rest(), np.sqrt(model.priors()[1])
    predicted, base = linearise(problem, found.structure, Point(start, at_rest))
    low, high = model.bounds()

    def looked(theta: Array) -> tuple[Array, Arrow]:
        there, arrow = linearise(problem, found.structure, Point(theta, at_rest))
        return problem.whiten(there - predicted), arrow

    def to_the_bottom(theta: Array) -> Array:
        """The lowest place across the ridge."""
        for _ in range(RIDGE_LOOKS):
            z, arrow = looked(theta)
            right, _ = arrow.right_sides(-z, arrow.run_sides(-z, at_rest), known**2 * (start - theta))
            normal = across.T @ arrow.normal @ across
            theta = np.clip(theta + across @ np.linalg.lstsq(normal, across.T @ right, rcond=None)[0], low, high)
        return theta

    points = [(start, *looked(start))]
    for sign in (-1.0, 1.0):
        points += _along(start, sign * RIDGE_STEP * spread * direction, looked, to_the_bottom, (low, high))
    points.sort(key=lambda point: float(direction @ point[0]))
    effects = base.run_jacobian / np.sqrt(base.weight)[:, None, :]
    basis = _basis(
        [z[..., None] for _, z, _ in points]
        + [arrow.jacobian * np.sqrt(np.diag(found.covariance)) for *_, arrow in points]
        + [arrow.run_jacobian / np.sqrt(base.weight)[:, None, :] for *_, arrow in points]
    )
    turned = basis.transpose(0, 2, 1)
    return Ridge(
        at=np.array([float(direction @ (theta - start)) / spread for theta, *_ in points]),
        theta=np.array([theta for theta, *_ in points]),
        across=across,
        basis=basis,
        z=np.array([(turned @ z[..., None])[..., 0] for _, z, _ in points]),
        jacobian=np.array([turned @ (arrow.jacobian @ across) for *_, arrow in points]),
        metric=np.array([_metric(turned @ arrow.run_jacobian, arrow.blocks) for *_, arrow in points]),
        effects=turned @ effects,
        known=known,
        disturbances=tuple(((turned @ change[..., None])[..., 0], own) for change, own in disturbances),
    )


def _along(
    start: Array,
    ahead: Array,
    looked: Callable[[Array], tuple[Array, Arrow]],
    to_the_bottom: Callable[[Array], Array],
    bounds: tuple[Array, Array],
) -> list[tuple[Array, Array, Arrow]]:
    """The ridge's points on one side of the fit, with steps that grow, up to a bound or the farthest misfit."""
    points, theta = [], start
    low, high = bounds
    for number in range(MOST_POINTS):
        before, theta = theta, to_the_bottom(np.clip(theta + ahead, low, high))
        if np.any((theta <= low) | (theta >= high)):
            break
        z, arrow = looked(theta)
        points.append((theta, z, arrow))
        if arrow.hidden(z) > FARTHEST_MISFIT:
            break
        ahead = (theta - before) * (RIDGE_GROWTH if number else 1.0)
    return points


def _metric(effects: Array, blocks: Array) -> Array:
    """What of readings in a basis stays once the runs' random effects have taken their part (R, k, k)."""
    return np.asarray(np.eye(effects.shape[1]) - effects @ np.linalg.solve(blocks, effects.transpose(0, 2, 1)))


def drawn(of: Ridge, log_figures: Sequence[LogFigure]) -> list[Drawn]:
    """Figures over the ridge under draws of all inputs.

    In this order: the readings' noise, each random effect of the runs, each parameter of which something is known
    beforehand, and the disturbances.
    """
    rng = np.random.default_rng(101)
    runs, size = of.z.shape[1:]
    noise = np.empty((MONTE_CARLO_DRAWS, runs, size))
    for run, basis in enumerate(of.basis):  # drawn for the readings: directions have the sign that the processor gives
        noise[:, run] = rng.standard_normal((MONTE_CARLO_DRAWS, len(basis))) @ basis
    own = rng.standard_normal((MONTE_CARLO_DRAWS, runs, of.effects.shape[2]))
    before = np.where(of.known > 0, rng.standard_normal((MONTE_CARLO_DRAWS, of.known.size)), 0.0)
    others = rng.standard_normal((MONTE_CARLO_DRAWS, len(of.disturbances)))
    readings = noise + np.einsum("rku,dru->drk", of.effects, own)
    for z, (change, _) in zip(others.T, of.disturbances, strict=True):
        readings += z[:, None, None] * change
    ended = fits(of, readings, before)
    inputs = [noise.reshape(MONTE_CARLO_DRAWS, -1), *own.transpose(2, 0, 1), *before.T[of.known > 0], *others.T]
    made = []
    for log_figure in log_figures:
        error = reached(of, log_figure, ended)
        slope = log_figure(of.theta[of.fit])[1]
        for z, (_, of_theta) in zip(others.T, of.disturbances, strict=True):
            error += z * float(slope @ of_theta)
        made.append(Drawn(error, tuple(_contribution(error, one) for one in inputs)))
    return made


def fits(of: Ridge, readings: Array, beforehand: Array) -> tuple[Array, Array]:
    """Fit readings that are off by (d, R, k), under priors that are off by (d, P) standard deviations.

    Returns the least misfit at each point of the ridge (d, n), and how far across the ridge it lies (d, n, P - 1).
    """
    count, points, across = len(readings), len(of.at), of.across.shape[1]
    misfit, moved = np.empty((count, points)), np.empty((count, points, across))
    by_run, own = readings.transpose(1, 0, 2), of.known[:, None] * of.across
    for n in range(points):
        off = by_run - of.z[n][:, None]
        seen = off @ of.metric[n]
        prior = beforehand - of.known * (of.theta[n] - of.theta[of.fit])
        right = np.einsum("rdk,rkp->dp", seen, of.jacobian[n]) + prior @ own
        flat = of.jacobian[n].reshape(off.shape[0] * off.shape[2], across)
        bend = flat.T @ (of.metric[n] @ of.jacobian[n]).reshape(flat.shape) + own.T @ own
        moved[:, n] = right @ np.linalg.pinv(bend, hermitian=True)
        misfit[:, n] = (off * seen).sum(axis=(0, 2)) + (prior**2).sum(axis=1) - (moved[:, n] * right).sum(axis=1)
    return misfit, moved


def reached(of: Ridge, log_figure: LogFigure, ended: tuple[Array, Array]) -> Array:
    """By how much (d,) a figure's logarithm is off in `fits`."""
    misfit, moved = ended
    figures = [log_figure(theta) for theta in of.theta]
    level = np.array([value for value, _ in figures]) - figures[of.fit][0]
    slopes = np.array([slope @ of.across for _, slope in figures])
    return _at_least(of.at, misfit, level + np.einsum("dnp,np->dn", moved, slopes))


def _contribution(error: Array, inputs: Array) -> float:
    """Standard deviation that the best straight line over inputs (d,) or (d, m) of unit variance gives an error (d,).

    Chance correlates each of many with it a little; as much as that makes on average is taken off.
    """
    slopes = (error - error.mean()) @ inputs / error.size
    if inputs.ndim == 1:
        return float(slopes)
    by_chance = inputs.shape[1] * float(np.var(error)) / error.size
    return float(np.sqrt(max(float(slopes @ slopes) - by_chance, 0.0)))


def _at_least(at: Array, misfit: Array, value: Array) -> Array:
    """Values (d, n) where a misfit (d, n) is least: by parabolas through the lowest point and its neighbours."""
    middle = np.clip(np.argmin(misfit, axis=1), 1, at.size - 2)[:, None] + np.array([-1, 0, 1])
    x, m, v = at[middle], np.take_along_axis(misfit, middle, 1), np.take_along_axis(value, middle, 1)
    before, after = x[:, 1] - x[:, 0], x[:, 2] - x[:, 1]

    def parabola(y: Array) -> tuple[Array, Array]:
        first, second = (y[:, 1] - y[:, 0]) / before, (y[:, 2] - y[:, 1]) / after
        return (first * after + second * before) / (before + after), (second - first) / (before + after)

    slope, bend = parabola(m)
    downhill = np.where(slope > 0, -before, after)
    t = np.where(bend > TINY_SPREAD, -slope / (2.0 * np.maximum(bend, TINY_SPREAD)), downhill)
    t = np.clip(t, -before, after)
    rise, curve = parabola(v)
    return np.asarray(v[:, 1] + t * rise + t**2 * curve)


def _widest(found: Fit) -> tuple[Array, float]:
    """Direction (P,) of the widest axis of the logarithms in theta, and its standard deviation."""
    own = [parameter.log for _, parameter in found.structure.parameters]
    logarithms = np.flatnonzero([True] * found.model.channel.rates + own + [False] * len(found.model.shared))
    variances, directions = np.linalg.eigh(found.covariance[np.ix_(logarithms, logarithms)])
    direction = np.zeros(found.theta.size)
    direction[logarithms] = directions[:, -1]
    return direction, float(np.sqrt(max(variances[-1], 0.0)))


def _basis(columns: Sequence[Array]) -> Array:
    """Orthonormal directions (R, bins, k) that hold all columns (R, bins, any) to within what nobody sees."""
    u, s, _ = np.linalg.svd(np.concatenate(columns, axis=-1), full_matrices=False)
    most = int((s > UNSEEN_SIGMAS).sum(axis=1).max())
    return np.asarray(u[..., :most])
