"""Where runs that a model was not fitted to began, and their airs: as fits best within what is stated of them.

What stands at a limit stays there, and the rest of the run is placed anew beside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.arrow import Arrow
from shockrig.analysis.inference.fit import Fit, fit, linearise, run_misfit
from shockrig.analysis.inference.model import Point
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.rate_scatter import RATE_SCATTER
from shockrig.analysis.inference.scan import STUCK_MEAN_SQUARE, scanned_starts

Array = NDArray[np.float64]

PLACED_WITHIN = 2.0  # standard uncertainties
FREE_LIMIT = 10.0  # likewise, of what nobody recorded
NEWTON_STEPS = 8  # of Gauss and Newton within the limits
TINY_SIZE = 1e-12
TRUSTED_FACTOR = 10.0  # times what they leave: readings are weighted so that what is stated only limits
SETTLED_STEP = 1e-3  # of the limits: a smaller step is none


def placed(bins: Problem, found: Fit) -> Array:
    """Random effects (R, U) of runs that a model was not fitted to."""
    problem = bins.with_rate_scatter(RATE_SCATTER)
    at, astray = _placed(problem, found)
    if not astray.any():
        return at
    # Readings are weighted by their noise, and a wrong model's errors are none: where noise has a long memory such a
    # run is placed by its increments, far from its level. Whatever leaves less of the readings is its place.
    part = problem.select(astray)
    before = _squares(part, found, at[astray])
    evenly, _ = _placed(_by_count(part, before / TRUSTED_FACTOR**2), found)
    at[astray] = np.where((_squares(part, found, evenly) < before)[:, None], evenly, at[astray])
    return at


def _by_count(problem: Problem, variance: Array) -> Problem:
    """The problem with every reading of a run weighed alike, as if what is left of it (R,) were independent noise."""
    level = np.sqrt(problem.channel.count / np.maximum(variance, TINY_SIZE)[:, None])
    return replace(problem, whitener=level[:, :, None] * np.eye(level.shape[1]))


def _placed(problem: Problem, found: Fit) -> tuple[Array, NDArray[np.bool_]]:
    """Where runs fit best within what is stated of them (R, U), and which of them a model misses (R,)."""
    at = problem.channel.at_rest()
    reached = fit(problem, found.structure, found.theta, at, adapt_scatter=False, hold_theta=True)
    moved = scanned_starts(problem, reached)
    if moved is not None:
        again = fit(problem, found.structure, found.theta, moved, adapt_scatter=False, hold_theta=True)
        reached = min((reached, again), key=lambda f: f.objective)
    # What nobody recorded is free: it is placed where it fits best, for every model alike.
    limit = np.where(problem.stated, PLACED_WITHIN, FREE_LIMIT) * problem.scatter
    return _within(problem, found, reached.deviations, limit), run_misfit(problem, reached) > STUCK_MEAN_SQUARE


def _squares(problem: Problem, found: Fit, deviations: Array) -> Array:
    """Mean square error of each run's readings (R,)."""
    channel = problem.channel
    prediction, _ = linearise(problem, found.structure, Point(found.theta, deviations))
    squares = (channel.count * (channel.value - prediction) ** 2).sum(axis=1)
    return np.asarray(squares / np.maximum(channel.count.sum(axis=1), 1))


def _within(problem: Problem, found: Fit, deviations: Array, limit: Array) -> Array:
    """The random effects (R, U) within `limit` under which each run fits best, from those that fit best without.

    A run that is off by more in its rate, say, than it may be would else keep the start that went with that rate.
    """
    at = np.clip(deviations, -limit, limit)
    beyond = np.flatnonzero((at != deviations).any(axis=1))
    if not beyond.size:
        return at
    part, low, high = problem.select(beyond), -limit[beyond], limit[beyond]
    here, best = at[beyond], np.full(beyond.size, np.inf)
    kept = here
    for _ in range(NEWTON_STEPS):
        prediction, arrow = linearise(part, found.structure, Point(found.theta, here))
        left = part.whiten(part.channel.value - prediction)
        cost = (left**2).sum(axis=1) + (here**2 * arrow.weight).sum(axis=1)
        kept = np.where((cost < best)[:, None], here, kept)
        best = np.minimum(cost, best)
        moved = _bounded_step(arrow, left, here, low, high)
        if (np.abs(moved - here) <= SETTLED_STEP * high).all():
            break
        here = moved
    at[beyond] = kept
    return at


def _bounded_step(arrow: Arrow, left: Array, here: Array, low: Array, high: Array) -> Array:
    """Random effects (R, U) that leave least within their limits, to first order: what would leave them is held there
    and the rest solved again, until nothing more does.
    """
    pull = (arrow.run_jacobian.transpose(0, 2, 1) @ left[..., None])[..., 0] - arrow.weight * here
    step, held = np.zeros_like(here), np.zeros(here.shape, dtype=bool)
    for _ in range(here.shape[1] + 1):
        free = ~held
        among = arrow.blocks * (free[:, :, None] & free[:, None, :]) + np.eye(here.shape[1]) * held[:, :, None]
        right = np.where(held, step, pull - (arrow.blocks @ np.where(held, step, 0.0)[..., None])[..., 0])
        step = np.asarray(np.linalg.solve(among, right[..., None])[..., 0])
        beyond = free & ((here + step < low) | (here + step > high))
        if not beyond.any():
            break
        held |= beyond
        step = np.clip(here + step, low, high) - here
    return np.clip(here + step, low, high)
