"""Where runs that a model was not fitted to began, and their airs, and what the model then leaves of them.

A run's own start, rate and airs are placed where they fit best within two of their stated uncertainties, the same way
for every model; errors are over single samples.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel, as_single_samples
from shockrig.analysis.estimate.effect import TINY_STRENGTH
from shockrig.analysis.estimate.fit import Fit, fit, linearise, with_airs
from shockrig.analysis.estimate.fit_starts import begun_starts_s, scanned_starts
from shockrig.analysis.estimate.model import PLAIN, Model, Point, Structure
from shockrig.analysis.estimate.problem import RATE_SCATTER, Problem
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.physics.chain import at_jump, evaluate

Array = NDArray[np.float64]

PLACED_WITHIN = 2.0  # standard uncertainties
FREE_LIMIT = 10.0  # likewise, of what nobody recorded
STARTS_TRIED = 61  # within the limits
NEWTON_STEPS = 8  # of Gauss and Newton within the limits
SETTLED_STEP = 1e-3  # of the limits: a smaller step is none


def run_errors(held: Channel, bins: Problem, found: Fit) -> Array:
    """Mean square error of each held run [unit^2], sample by sample."""
    return mean_squares(held_out_residuals(held, bins, found))


def mean_squares(residuals: Array) -> Array:
    """Of each run's residuals (R, n) that are known."""
    return np.asarray(np.nansum(residuals**2, axis=1) / np.maximum(np.isfinite(residuals).sum(axis=1), 1))


def held_out_residuals(held: Channel, bins: Problem, found: Fit) -> Array:
    """What a fit to other runs leaves of each held run at its samples (R, n) [unit]; NaN amid the air's jump and beyond
    a run's last sample.

    The model's parameters are those of `found`; a run's own start and airs are placed where they fit best within what
    is stated of them (`bins` holds the run's data for that).
    """
    deviations = placed(bins, found)
    samples = as_single_samples(held, _dated(held, found.structure))
    chain = found.model.on(samples).chain(Point(found.theta[None], deviations[None]))
    told = (samples.count > 0) & ~at_jump(chain)
    # A model that has no value misses by more than any.
    predicted = np.nan_to_num(evaluate(chain, held.quantity.reading)[0], nan=np.inf, posinf=np.inf, neginf=-np.inf)
    return np.where(told, samples.value - predicted, np.nan)


def _dated(channel: Channel, structure: Structure) -> list[Array]:
    """Times at which the readings were fresh."""
    times = [t for t, _ in channel.samples]
    for effect in structure.effects:
        if (fresh := effect.readout.dated) is not None:
            values, period_s = structure.held_values(effect.id), channel.sampling_period_s
            times = [fresh(t, y, period_s, values) for t, (_, y) in zip(times, channel.samples, strict=True)]
    return times


def plainly(found: Fit) -> Fit:
    """The same rates under the plain chain, without even what single readings have shown."""
    model = Model(found.model.channel, PLAIN)
    return replace(found, model=model, theta=np.concatenate([found.log_rates, found.theta[found.model.behind]]))


def placed(bins: Problem, found: Fit) -> Array:
    """Random effects (R, U) of runs that a model was not fitted to: where these fit best within what is stated of them.

    Every reading counts alike, as it is judged. Noise with a long memory would weigh increments, and place a run that a
    model misses far from its level.
    """
    # How much stronger an effect is in a run by chance, no other run tells; an air that nobody recorded may drift in a
    # run as it did in others.
    problem = bins.with_rate_scatter(RATE_SCATTER).with_scatter_of(RunEffect.STRENGTH, TINY_STRENGTH)
    problem = problem.with_scatter_of(RunEffect.DRIFT, found.drift_scatter)
    count = problem.channel.count
    of_one = np.einsum("rii->ri", problem.whitener) ** 2 / np.maximum(count, 1)  # precision of a reading
    weight = np.sqrt(count * of_one.mean(axis=1, where=count > 0, keepdims=True))
    problem = problem.with_weights(weight)
    at = problem.channel.at_rest()
    reached = fit(problem, found.structure, found.theta, at, adapt_scatter=False, hold_theta=True)
    moved = scanned_starts(problem, reached)
    if moved is not None:
        again = fit(problem, found.structure, found.theta, moved, adapt_scatter=False, hold_theta=True)
        reached = min((reached, again), key=lambda f: f.objective)
    # What nobody recorded is free: it is placed where it fits best, for every model alike.
    limit = np.where(problem.stated, PLACED_WITHIN, FREE_LIMIT) * problem.scatter
    return _within(problem, found, reached.deviations, limit)


def _within(problem: Problem, found: Fit, deviations: Array, limit: Array) -> Array:
    """The random effects (R, U) within `limit` under which each run fits best, from those that fit best without, and
    from the unrecorded start within it that leaves least.

    A run that is off by more in its rate, say, than it may be would else keep the start that went with that rate; and
    one whose record begins amid its response would keep the source far away that goes with a start long before.
    """
    at = np.clip(deviations, -limit, limit)
    beyond = np.flatnonzero((at != deviations).any(axis=1))
    if not beyond.size:
        return at
    part, most = problem.select(beyond), limit[beyond]
    ends = [_descended(part, found, here, most) for here in (at[beyond], _scanned_within(part, found, most))]
    (first, left), (second, less) = ends
    at[beyond] = np.where((less < left)[:, None], second, first)
    return at


def _scanned_within(part: Problem, found: Fit, limit: Array) -> Array:
    """Random effects (R, U) at the unrecorded start within `limit` that leaves least of each run with airs within it
    as well; at rest where there is none."""
    known = part.channel.conditions.start_known
    starts_s = np.linspace(-1.0, 1.0, STARTS_TRIED)[:, None] * limit[:, RunEffect.START]
    starts_s = np.concatenate([starts_s, begun_starts_s(part.channel)])[: 1 if known.all() else None]
    tried = np.tile(part.channel.at_rest(), (len(starts_s), 1, 1))
    tried[..., RunEffect.START] = np.where(known, 0.0, starts_s)
    tried, left = with_airs(part, found.model.on(part.channel), Point(found.theta, tried))
    left = np.where((np.abs(tried) <= limit).all(axis=-1) & np.isfinite(left), left, np.inf)
    best = np.argmin(left, axis=0), np.arange(len(limit))
    return np.where(np.isfinite(left[best])[:, None], tried[best], part.channel.at_rest())


def _descended(part: Problem, found: Fit, here: Array, limit: Array) -> tuple[Array, Array]:
    """Random effects (R, U) within `limit` from a begin, and what they leave of each run (R,)."""
    kept, best = here, np.full(len(here), np.inf)
    for _ in range(NEWTON_STEPS):
        prediction, arrow = linearise(part, found.structure, Point(found.theta, here))
        left = part.whiten(part.channel.value - prediction)
        cost = (left**2).sum(axis=1) + (here**2 * arrow.weight).sum(axis=1)
        kept = np.where((cost < best)[:, None], here, kept)
        best = np.fmin(cost, best)
        if not np.isfinite(cost).all():  # a model that has no value there
            break
        moved = here + within_limits(arrow.blocks, arrow.run_sides(left, here), -limit - here, limit - here)
        if (np.abs(moved - here) <= SETTLED_STEP * limit).all():
            break
        here = moved
    return kept, best


def within_limits(normal: Array, right: Array, least: Array, most: Array) -> Array:
    """The x (R, U) within limits at which x' N x / 2 - b' x is least, for R positive matrices N (U, U) and sides b (U,)
    at once: by block pivoting, and one number at a time where that goes round (Júdice and Pires 1994, doi
    10.1016/0305-0548(94)90106-6)."""
    at = np.zeros(right.shape, dtype=int)  # -1 and 1 where a limit holds a number
    numbers, step = np.arange(right.shape[1]), np.zeros(right.shape)
    for tried in range(3**numbers.size):  # as many as there are sets of limits
        held = at != 0
        limits = np.where(held, np.where(at < 0, least, most), 0.0)
        free = np.where(held[:, :, None] | held[:, None, :], np.eye(numbers.size), normal)
        rest = np.where(held, limits, right - (normal @ limits[..., None])[..., 0])
        step = np.linalg.solve(free, rest[..., None])[..., 0]
        beyond = np.where(held, 0, (step > most).astype(int) - (step < least))
        wrong = (beyond != 0) | (at * (right - (normal @ step[..., None])[..., 0]) < 0)
        if not wrong.any():
            break
        if tried >= numbers.size:
            wrong &= numbers == np.max(np.where(wrong, numbers, -1), axis=1, keepdims=True)
        at = np.where(wrong, beyond, at)
    return np.clip(step, least, most)
