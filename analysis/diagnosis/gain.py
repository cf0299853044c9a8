"""What an extension gains, on runs that took part neither in fitting nor in choosing it (nested folds by condition)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnosis.search import plain_fit, refit, search
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.gls import RATE_SCATTER, Fit, Layout, Problem, build_chain, fit
from shockrig.analysis.inference.noise import Noise
from shockrig.analysis.physics.chain import at_jump, evaluate

Array = NDArray[np.float64]

FOLDS = 3
DRAWS = 2000
PLACED_WITHIN = 2.0  # standard uncertainties


@dataclass(frozen=True)
class Gain:
    """Held-out errors [K or %RH] over the samples after the transfer, before and after, and what share is explained.

    `explained_fraction` = (before^2 - after^2) / (before^2 - floor^2), with a 95 % interval from a bootstrap over runs.
    """

    before: float
    after: float
    noise_floor: float
    explained_fraction: float
    interval_95: tuple[float, float]
    run_before: Array
    run_after: Array


def folds(channel: Channel, count: int = FOLDS) -> NDArray[np.int64]:
    """Fold of each run (R,): runs of one ambient are spread over the folds, so that each training part knows its D."""
    fold = np.zeros(channel.runs, dtype=int)
    place = 0
    for ambient in np.unique(channel.ambient):
        index = np.flatnonzero(channel.ambient == ambient)
        for i in index:
            fold[i] = place % count
            place += 1
    return fold


def measure_gain(
    channel: Channel, problem: Problem, base: Layout, final: Fit, noise: Noise, seed: int, choose: bool
) -> Gain:
    """Held-out gain of the extension `final`: in each fold it is chosen again without the runs held out.

    `channel` is the channel as recorded, `problem` the one that was searched (repeats taken out). Without `choose` the
    effects of `final` are only fitted again, not chosen (where the search ended in none that explain the data).
    """
    fold = folds(problem.channel)
    before, after = np.full(channel.runs, np.nan), np.full(channel.runs, np.nan)
    for k in range(fold.max() + 1):
        train = fold != k
        # The rate at an ambient that the training part never saw is not the extension's business.
        test = np.flatnonzero((fold == k) & np.isin(channel.ambient, channel.ambient[train]))
        if train.sum() < 3 or not test.size:
            continue
        part = problem.select(train)
        if choose:
            chosen = search(part, base, thorough=False, most=len(final.layout.effects) - len(base.effects) + 1)
            plain, extended = chosen.plain, chosen.final
        else:
            plain = extended = plain_fit(part, base)
        if not choose and final.layout.effects != base.effects:
            extended = refit(part, final.layout, replace(final, deviations=final.deviations[train]))
        held, bins = channel.select(test), problem.select(test)
        before[test] = run_errors(held, bins, replace(plain, layout=Layout(())))
        after[test] = run_errors(held, bins, extended) if extended.layout.effects else before[test]
    return summarise(before, after, noise.standard_deviation, seed)


def run_errors(held: Channel, bins: Problem, found: Fit) -> Array:
    """Mean square error of each held run [unit^2], sample by sample.

    The model's parameters are those of `found`; a run's own start and airs are placed where they fit best within
    `PLACED_WITHIN` of their stated uncertainties (`bins` holds the run's data for that), the same way for every model.
    """
    scatter = bins.scatter.copy()
    scatter[:, 1] = RATE_SCATTER
    placed = fit(replace(bins, scatter=scatter), found.layout, found.theta, adapt_scatter=False, hold_theta=True)
    samples = single_samples(held, found.layout)
    deviations = np.clip(placed.deviations, -PLACED_WITHIN * scatter, PLACED_WITHIN * scatter)
    chain = build_chain(samples, found.layout, found.theta[None], deviations[None])
    counted = samples.count * ~at_jump(chain)
    return (counted * (samples.value - evaluate(chain)[0]) ** 2).sum(axis=1) / counted.sum(axis=1)


def single_samples(channel: Channel, layout: Layout) -> Channel:
    """The channel with every sample a bin of its own; under held repeats each is dated when it was fresh."""
    hold = next((int(v) for e, _, v in layout.fixed if e == "stale_samples"), 1)
    width = max(t.size for t, _ in channel.samples)
    shape = (channel.runs, width)
    time, value, count = np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=int)
    die = np.full(shape, np.nan)
    for i, (t, y) in enumerate(channel.samples):
        dated = _fresh_times(t, y, hold, channel.sampling_period_s) if hold > 1 else t
        time[i, : t.size], value[i, : t.size] = dated, y
        time[i, t.size :] = dated[-1]
        count[i, : t.size] = channel.bin_of[i] >= 0
        if channel.die_samples:
            die[i, : t.size] = channel.die_samples[i]
    return replace(channel, time_s=time, value=value, count=count, die_c=die)


def _fresh_times(time: Array, value: Array, hold: int, period: float) -> Array:
    index = np.rint((time - time[0]) / period).astype(int)
    changed = index[np.flatnonzero(np.abs(np.diff(value)) > 1e-9) + 1]
    phase = int(np.argmax(np.bincount(changed % hold, minlength=hold))) if changed.size else 0
    return time - ((index - phase) % hold) * period


def summarise(before: Array, after: Array, floor: float, seed: int) -> Gain:
    """Errors over all held runs and the share explained, with a bootstrap over runs."""
    told = np.isfinite(before)
    run_before, run_after = before[told], after[told]
    if not told.any():
        return Gain(floor, floor, floor, 0.0, (0.0, 0.0), before, after)

    # A model cannot do better than the noise; where it seems to, the noise was stated too high.
    floor = min(floor, float(np.sqrt(run_after.mean())))

    def share(mean_before: Array, mean_after: Array) -> Array:
        return (mean_before - mean_after) / np.maximum(mean_before - floor**2, 0.02 * floor**2)

    value = float(share(run_before.mean(), run_after.mean()))
    rng = np.random.default_rng(seed)
    # What is stated must hold for the next campaign, which is a draw of runs as much as this one is: two draws count.
    pick = rng.integers(0, run_before.size, (2, DRAWS, run_before.size))
    drawn_before, drawn_after = (x[pick].mean(axis=-1).sum(axis=0) - x.mean() for x in (run_before, run_after))
    low, high = np.quantile(share(drawn_before, drawn_after), [0.02, 0.98])
    high = max(min(high, 1.0), value)
    return Gain(
        before=float(np.sqrt(run_before.mean())),
        after=float(np.sqrt(run_after.mean())),
        noise_floor=floor,
        explained_fraction=value,
        interval_95=(float(min(low, value)), float(max(high, value))),
        run_before=before,
        run_after=after,
    )
