"""What an extension gains on runs that took part neither in fitting nor in choosing it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from shockrig.analysis.diagnose.held_out import held_out_residuals, mean_squares, plainly
from shockrig.analysis.diagnose.pool import Rated
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.fit import Fit, fit, linearise
from shockrig.analysis.estimate.model import Model, Point, Structure
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.predictive import as_stated, bumps, score
from shockrig.analysis.estimate.problem import Problem

Array = NDArray[np.float64]

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
