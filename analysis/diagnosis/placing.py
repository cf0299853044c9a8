"""Where runs that a model was not fitted to began, and their airs: as fits best within what is stated of them.

What stands at a limit stays there, and the rest of the run is placed anew beside it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.arrow import Arrow
from shockrig.analysis.inference.fit import Fit, fit, linearise
from shockrig.analysis.inference.model import Point
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.rate_scatter import RATE_SCATTER
from shockrig.analysis.inference.scan import scanned_starts

Array = NDArray[np.float64]

PLACED_WITHIN = 2.0  # standard uncertainties
FREE = 10.0  # likewise, of what nobody recorded
STEPS = 8  # of Gauss and Newton within the limits
SETTLED = 1e-3  # of the limits: a smaller step is none


def placed(bins: Problem, found: Fit) -> Array:
    """Random effects (R, U) of runs that a model was not fitted to."""
    problem = bins.with_rate_scatter(RATE_SCATTER)
    at = problem.channel.at_rest()
    reached = fit(problem, found.structure, found.theta, at, adapt_scatter=False, hold_theta=True)
    moved = scanned_starts(problem, reached)
    if moved is not None:
        again = fit(problem, found.structure, found.theta, moved, adapt_scatter=False, hold_theta=True)
        reached = min((reached, again), key=lambda f: f.objective)
    # What nobody recorded is free: it is placed where it fits best, for every model alike.
    limit = np.where(problem.stated, PLACED_WITHIN, FREE) * problem.scatter
    return _within(problem, found, reached.deviations, limit)


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
    for _ in range(STEPS):
        prediction, arrow = linearise(part, found.structure, Point(found.theta, here))
        left = part.whiten(part.channel.value - prediction)
        cost = (left**2).sum(axis=1) + (here**2 * arrow.weight).sum(axis=1)
        kept = np.where((cost < best)[:, None], here, kept)
        best = np.minimum(cost, best)
        moved = _bounded_step(arrow, left, here, low, high)
        if (np.abs(moved - here) <= SETTLED * high).all():
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
