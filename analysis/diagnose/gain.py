"""What an extension gains on runs that took part neither in fitting nor in choosing it, and where such runs are
placed.

A run's own start, rate and airs are placed where they fit best within two of their stated uncertainties, the same way
for every model; errors are over single samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from shockrig.analysis.diagnose.search import Rated
from shockrig.analysis.estimate.arrow import Arrow
from shockrig.analysis.estimate.channel import Channel, as_single_samples
from shockrig.analysis.estimate.effect import TINY_STRENGTH
from shockrig.analysis.estimate.fit import Fit, fit, linearise, with_airs
from shockrig.analysis.estimate.fit_starts import begun_starts_s, rough_point, scanned_starts
from shockrig.analysis.estimate.model import PLAIN, Model, Point, Structure
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.predictive import as_stated, bumps, score
from shockrig.analysis.estimate.problem import RATE_SCATTER, Problem
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.physics.chain import at_jump, evaluate

Array = NDArray[np.float64]

# Where runs that a model was not fitted to began, and their airs: as fits best within what is stated of them.

PLACED_WITHIN = 2.0  # standard uncertainties
ALIKE = 1e-7  # scatter of ln rate that is none
LEAST_SQUARE = 1e-30  # mean square that may be divided by
FREE_LIMIT = 10.0  # likewise, of what nobody recorded
STARTS_TRIED = 61  # within the limits
NEWTON_STEPS = 8  # of Gauss and Newton within the limits
SETTLED_STEP = 1e-3  # of the limits: a smaller step is none


def placed(bins: Problem, found: Fit) -> Array:
    """Random effects (R, U) of runs that a model was not fitted to: where these fit best within what is stated of them.

    Every reading counts alike, as it is judged. Noise with a long memory would weigh increments, and place a run that a
    model misses far from its level.
    """
    # How much stronger an effect is in a run by chance, no other run tells.
    problem = bins.with_rate_scatter(RATE_SCATTER).with_strength_scatter(TINY_STRENGTH)
    count = problem.channel.count
    of_one = np.einsum("rii->ri", problem.whitener) ** 2 / np.maximum(count, 1)  # precision of a reading
    weight = np.sqrt(count * of_one.mean(axis=1, where=count > 0, keepdims=True))
    problem = _weighed(problem, weight)
    at = problem.channel.at_rest()
    reached = fit(problem, found.structure, found.theta, at, adapt_scatter=False, hold_theta=True)
    moved = scanned_starts(problem, reached)
    if moved is not None:
        again = fit(problem, found.structure, found.theta, moved, adapt_scatter=False, hold_theta=True)
        reached = min((reached, again), key=lambda f: f.objective)
    # What nobody recorded is free: it is placed where it fits best, for every model alike.
    limit = np.where(problem.stated, PLACED_WITHIN, FREE_LIMIT) * problem.scatter
    return _within(problem, found, reached.deviations, limit)


def _weighed(problem: Problem, weight: Array) -> Problem:
    """A problem whose bins (R, n) have independent errors, and those weights."""
    return replace(problem, whitener=weight[:, :, None] * np.eye(weight.shape[1]))


def as_judged(problem: Problem, found: Fit) -> Fit | None:
    """A model's parameters as they are judged where it predicts: fitted at one rate for all runs, each reading counting
    alike, and each run. None for a fit that led to no number.

    A fit knows of nothing that a model is wrong by. Where that is more than the noise, runs take rates of their own,
    however little these may scatter, which no other run has; and readings that noise says less of count for more.
    """
    channel, structure = problem.channel, found.structure
    readings = channel.count.sum(axis=1, keepdims=True)
    alike = problem.with_rate_scatter(ALIKE).with_strength_scatter(TINY_STRENGTH)
    deviations = found.deviations.copy()
    deviations[:, [RunEffect.RATE, RunEffect.STRENGTH]] = 0.0

    def beside(left_by: Fit) -> Problem | None:
        """The problem whose noise is what a fit leaves; None where that is no number."""
        square = float(squares_of_bins(channel, left_by.residual).mean())
        if not np.isfinite(square):
            return None
        share = channel.count * readings.mean() / np.maximum(readings, 1)
        return _weighed(alike, np.sqrt(share / max(square, LEAST_SQUARE)))

    def best_from(part: Problem, *begins: Point) -> Fit:
        ends = [fit(part, structure, at.theta, at.deviations, 40, adapt_scatter=False) for at in begins]
        return min(ends, key=lambda f: f.objective)

    if (part := beside(found)) is None:
        return None
    first = best_from(part, Point(found.theta, deviations), rough_point(part, structure, found.choice))
    # Priors of starts and airs bind by what is left at the end, and not by what the search's fit left.
    return None if (part := beside(first)) is None else best_from(part, first.point)


def carried(problem: Problem, found: Fit, judged: Fit) -> Fit:
    """A model with parameters that were fitted as they are judged, as a fit to the problem: its runs' deviations, and
    its uncertainties, are those under the scatters that the search found."""
    own = found.on_its_scatters(problem)
    held = fit(own, found.structure, judged.theta, found.deviations, adapt_scatter=False, hold_theta=True)
    return fit(own, found.structure, judged.theta, held.deviations, 0, adapt_scatter=False)


def squares_of_bins(channel: Channel, left: Array) -> Array:
    """Mean square [unit^2] of what is left of each run's bins (R, n), each by its readings (R,)."""
    return np.asarray((channel.count * left**2).sum(axis=1) / np.maximum(channel.count.sum(axis=1), 1))


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
        moved = _bounded_step(arrow, left, here, -limit, limit)
        if (np.abs(moved - here) <= SETTLED_STEP * limit).all():
            break
        here = moved
    return kept, best


def _bounded_step(arrow: Arrow, left: Array, here: Array, low: Array, high: Array) -> Array:
    """Random effects (R, U) that leave least within their limits, to first order."""
    return here + within_limits(arrow.blocks, arrow.run_sides(left, here), low - here, high - here)


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


FOLDS = 3
USUAL_SPREAD, USUAL_DEGREES = 0.5, 3  # of gains from run to run, relative, before any run has told
USUAL_LOSS = 5.0  # by how much fewer runs tell less than all
UNTOLD_SIGMA = 0.2  # standard uncertainty of ln rate from which a training part predicts nothing


@dataclass(frozen=True)
class HeldOut:
    """Residuals [channel's unit] of runs held out at their samples, but for those amid the air's jump: time since the
    transfer, and what the plain model leaves, and the one with the causes found."""

    runs: tuple[int, ...] = ()
    run_ids: tuple[str, ...] = ()
    time_s: tuple[Array, ...] = ()
    before: tuple[Array, ...] = ()
    after: tuple[Array, ...] = ()


@dataclass(frozen=True)
class Gain:
    """Held-out errors [K or %RH] over the samples after the transfer, before and after, and what share is explained.

    Attributes
    ----------
    before, after, noise_floor : float
    explained_fraction : float
        (before^2 - after^2) / (before^2 - floor^2), from 0 to 1.
    interval_95 : (float, float)
        Of that share in the next campaign of the same plan.
    run_before, run_after : ndarray (R,)
        Mean squares of single runs; NaN where a run could not be held out.
    held : HeldOut
        What they are the errors of.
    """

    before: float
    after: float
    noise_floor: float
    explained_fraction: float
    interval_95: tuple[float, float]
    run_before: Array
    run_after: Array
    held: HeldOut = HeldOut()

    @property
    def measured(self) -> bool:
        """Whether any run could be held out."""
        return bool(np.isfinite(self.run_before).any())


def folds(channel: Channel) -> NDArray[np.int64]:
    """Fold of each run (R,): runs of one ambient are spread over the folds, so that each training part knows its D.

    So are those of either medium, and, where nobody recorded the airflow, of either direction: places may differ.
    """
    air, fold = channel.conditions, np.zeros(channel.runs, dtype=int)
    up = (channel.quantity.step(air) > 0) & ~air.airflow_known.any()
    fold[np.lexsort((up, air.elsewhere, channel.ambient))] = np.arange(channel.runs) % min(FOLDS, channel.runs)
    return fold


def kinds(channel: Channel) -> NDArray[np.int64]:
    """What kind of shock each run is (R,): up or down, isothermal or not. An effect acts in some kinds alone."""
    up = channel.quantity.step(channel.conditions) > 0
    return 2 * channel.isothermal.astype(int) + up.astype(int)


@dataclass(frozen=True)
class HeldOutPart:
    """One fold: which runs the models are fitted to, `train`, and which of the others, `test`, they predict.

    `held` and `bins` are the latter's readings. `plain` is the plain model fitted to the former, `value` its value
    there [nats]; `residuals` (R, n) are those of the latter under it, without what single readings have shown.
    """

    train: NDArray[np.bool_]
    test: NDArray[np.int64]
    part: Problem
    plain: Fit
    value: float
    residuals: Array
    held: Channel
    bins: Problem

    def residuals_under(self, model: Rated) -> Array:
        """Residuals (R, n) of the runs held out under what the others choose of a model, by the search's own score:
        itself, itself less one effect, or the plain one."""
        if not model.ids:
            return self.residuals
        whole = _acting(self.part, model, self.train)
        added = [e for e in whole.ids if e not in self.plain.structure.ids]
        tried = [whole, *(whole.dropping(e) for e in added if len(added) > 1)]
        found = [(self.value, self.plain), *(_fitted(self.part, model, one, self.train) for one in tried)]
        return held_out_residuals(self.held, self.bins, max(found, key=lambda one: one[0])[1])


def held_out_parts(channel: Channel, problem: Problem, plain: Rated) -> list[HeldOutPart]:
    """The folds in which runs can be held out; none where no model can be tried on any.

    `channel` is the channel as recorded, `problem` the one that was searched (repeats taken out).
    """
    fold, found = folds(problem.channel), []
    for k in range(int(fold.max()) + 1):
        train = fold != k
        # The rate at an ambient that the training part never saw is not the extension's business.
        test = np.flatnonzero((fold == k) & np.isin(channel.ambient, channel.ambient[train]))
        if not train.any() or not test.size:
            continue
        part = problem.select(train)
        value, simple = _fitted(part, plain, plain.fit.structure, train)
        # Nor is one that the training part has runs of and does not tell, while all runs together do.
        told, known = (np.sqrt(np.diag(f.covariance))[: channel.rates] for f in (simple, plain.fit))
        told = told < np.maximum(UNTOLD_SIGMA, USUAL_LOSS * known)
        test = test[told[channel.ambient[test]]]
        if test.size:
            held, bins = channel.select(test), problem.select(test)
            residuals = held_out_residuals(held, bins, plainly(simple))
            found.append(HeldOutPart(train, test, part, simple, value, residuals, held, bins))
    return found


def measure_gain(channel: Channel, parts: Sequence[HeldOutPart], model: Rated, noise: Noise) -> Gain:
    """Held-out gain of a model over the plain one, each fitted anew and chosen without the runs held out."""
    before, after = np.full(channel.runs, np.nan), np.full(channel.runs, np.nan)
    left: dict[int, tuple[Any, ...]] = {}
    for one in parts:
        under = one.residuals_under(model)
        before[one.test], after[one.test] = mean_squares(one.residuals), mean_squares(under)
        for run, both in zip(one.test.tolist(), np.stack([one.residuals, under], axis=1), strict=True):
            time, _ = channel.samples[run]
            known = np.isfinite(both).all(axis=0)[: time.size]
            left[run] = run, channel.run_ids[run], time[known], *both[:, : time.size][:, known]
    held = HeldOut(*zip(*(left[run] for run in sorted(left)), strict=True))
    return replace(summarise(before, after, noise.while_moving, kinds(channel)), held=held)


def _fitted(part: Problem, whole: Rated, structure: Structure, train: NDArray[np.bool_]) -> tuple[float, Fit]:
    """A structure fitted to the runs `train`, from where it was with all, and its value there [nats]."""
    near, bump = whole.fit, bumps(part)
    begin = Model(part.channel, structure).start(near.log_rates, near.choice)
    found = fit(part, structure, begin, near.deviations[train])
    rated = score(part, found, bump)
    # What is held against each effect is about the same for all of them.
    prior = whole.log_prior * len(structure.ids) / max(len(near.structure.ids), 1)
    return rated.total + prior, as_stated(part, found, bump, rated.discrepancy, False)


def _acting(part: Problem, model: Rated, train: NDArray[np.bool_]) -> Structure:
    """A model without what does nothing in the runs `train`: its numbers would be those of the runs held out."""
    near, structure = model.fit, model.fit.structure
    whole = Model(part.channel, structure)
    begin = Point(whole.start(near.log_rates, near.choice), near.deviations[train])
    _, arrow = linearise(part, structure, begin)
    does = np.any(arrow.jacobian[..., part.channel.rates : whole.behind.start], axis=(0, 1)).tolist()
    silent = {effect.id for effect, _ in structure.parameters}
    silent -= {effect.id for (effect, _), some in zip(structure.parameters, does, strict=True) if some}
    return structure.keeping(set(structure.ids) - silent)


def plainly(found: Fit) -> Fit:
    """The same rates under the plain chain, without even what single readings have shown."""
    model = Model(found.model.channel, PLAIN)
    return replace(found, model=model, theta=np.concatenate([found.log_rates, found.theta[found.model.behind]]))


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


def summarise(
    before: Array,
    after: Array,
    floor: float,
    kind: NDArray[np.int64],
) -> Gain:
    """Errors over all held runs and the share explained."""
    told = np.isfinite(before)
    if not told.any():
        return Gain(floor, floor, floor, 0.0, (0.0, 0.0), before, after)
    run_before, run_after = before[told], after[told]
    # A model cannot do better than the noise; where it seems to, the noise was stated too high.
    floor = min(floor, float(np.sqrt(min(run_after.mean(), run_before.mean()))))
    gained, spread, degrees = _mean_and_spread(run_before - run_after, kind[told])
    share, interval = _share(gained, spread, degrees, run_after, floor)
    return Gain(
        before=float(np.sqrt(run_before.mean())),
        after=float(np.sqrt(run_after.mean())),
        noise_floor=floor,
        explained_fraction=share,
        interval_95=interval,
        run_before=before,
        run_after=after,
    )


def _mean_and_spread(gains: Array, kind: NDArray[np.int64]) -> tuple[float, float, int]:
    """Mean gain over runs, its standard uncertainty and degrees of freedom; runs are compared with their own kind.

    What a campaign records is a design, not a draw: an effect that acts in a quarter of the runs does so in the next
    campaign too.
    """
    mean, size = float(gains.mean()), gains.size
    if size < 2:
        return mean, float("inf"), 1
    _, own = np.unique(kind, return_inverse=True)
    usual = np.bincount(own, gains) / np.bincount(own)
    # A few runs say little of how gains scatter; before them it is taken that they do by half of their mean.
    degrees = size - usual.size + USUAL_DEGREES
    squares = float(((gains - usual[own]) ** 2).sum()) + USUAL_DEGREES * (USUAL_SPREAD * mean) ** 2
    return mean, float(np.sqrt(squares / degrees / size)), degrees


def _share(
    gained: float, spread: float, degrees: int, run_after: Array, floor: float
) -> tuple[float, tuple[float, float]]:
    """Share explained with a 95 % interval for the next campaign, which is a draw of runs as much as this one is."""
    if gained <= 0:
        return 0.0, (0.0, 0.0)
    least = 0.02 * floor**2
    left = max(float(run_after.mean()) - floor**2, 0.0)
    share = gained / max(gained + left, least)
    # Twice the variance; on a logarithmic scale, since neither gain nor remainder can be less than nothing.
    wide = float(stdtrit(degrees, 0.975)) * np.sqrt(2.0)
    relative = min(wide * spread / gained, 8.0)
    low, high = gained * np.exp(-relative), gained * np.exp(relative)
    own = float(run_after.std(ddof=1) / np.sqrt(run_after.size)) if run_after.size > 1 else float(run_after.mean())
    most = max(float(run_after.mean()) + wide * own - floor**2, least)
    least_left = max(float(run_after.mean()) - wide * own - floor**2, 0.0)
    return min(share, 1.0), (float(min(low / (low + most), share)), float(max(high / (high + least_left), share)))
