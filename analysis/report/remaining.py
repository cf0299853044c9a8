"""What a model leaves, without any form: its course in time with a band, condition by condition; its spectrum of
relaxation times; what it varies with and what it does not; how far off it is on runs that it was not fitted to.

The course is that of the residuals over each run's own step, so that runs of all sizes and both directions lie upon one
another where what is left goes with the step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.optimize import nnls

from shockrig.analysis.diagnose.gain import HeldOut
from shockrig.analysis.diagnose.grammar import varied
from shockrig.analysis.estimate.channel import FIRST_LOG_BIN_S, Channel, log_bins
from shockrig.analysis.estimate.fit import Fit, left_at_common_rates

Array = NDArray[np.float64]

BINS_PER_DECADE = 6
TAUS_PER_DECADE = 8
SMOOTHING_WEIGHT = 0.15  # weight of the spectrum's own size, beside residuals of unit size
BOOTSTRAP_DRAWS = 24  # draws of the runs for the spectrum's band
SEED = 11
PARTS_BELOW = 1e-3  # chance below which a condition parts the courses
LAGS_SHOWN = 20
AIRFLOWS_APART = 0.06  # relative, of airflows that are one


@dataclass(frozen=True)
class MeanCourse:
    """Mean of what is left over the runs of one condition, as a share of the step, and its standard uncertainty."""

    condition: str
    time_s: Array
    mean: Array
    uncertainty: Array
    runs: int


@dataclass(frozen=True)
class Remaining:
    """What is left.

    Attributes
    ----------
    courses : tuple of MeanCourse
        One for each level of the condition that parts them best; of all runs together where nothing does.
    time_constants_s, amplitude, uncertainty : ndarray (K,)
        Spectrum of relaxation times: the course is the sum of amplitude exp(-t / time constant), shares of the step.
    varies_with, does_not_vary_with : tuple of str
        Conditions that part it, the best first, and conditions that were varied and do not.
    """

    courses: tuple[MeanCourse, ...]
    time_constants_s: Array
    amplitude: Array
    uncertainty: Array
    varies_with: tuple[str, ...]
    does_not_vary_with: tuple[str, ...]


def remaining(channel: Channel, found: Fit) -> Remaining | None:
    """What a fit leaves in a channel; None where no run has a step of its own to measure it by."""
    step = channel.quantity.step(channel.conditions)
    usable = (np.abs(step) >= channel.quantity.least_step) & ~channel.measured
    if usable.sum() < 3:
        return None
    edges = _edges(channel)
    # A run's own rate hides in the fit what is left of it.
    residual = np.where(channel.count > 0, left_at_common_rates(channel, found), 0.0)
    inside = np.digitize(channel.time_s, edges)[usable, :, None] == np.arange(1, edges.size)
    count = channel.count[usable, :, None] * inside
    total = count.sum(axis=1)
    if not total.any():
        return None
    shares = (count * residual[usable, :, None]).sum(axis=1) / np.maximum(total, 1) / step[usable, None]
    weight = total * step[usable, None] ** 2
    middle = np.sqrt(edges[:-1] * edges[1:])
    parted = {name: level[usable] for name, level in levels(channel).items() if np.unique(level[usable]).size > 1}
    chances = {name: _chance(shares, weight, level) for name, level in parted.items()}
    varies = sorted((name for name, p in chances.items() if p < PARTS_BELOW), key=chances.__getitem__)
    courses = [_course("all runs", middle, shares, weight)]
    if varies:
        level = parted[varies[0]]
        runs_of = {_words(varies[0], value): level == value for value in np.unique(level)}
        courses = [_course(words, middle, shares[own], weight[own]) for words, own in runs_of.items()]
    spaced = [name.replace("_", " ") for name in varies]
    others = [name.replace("_", " ") for name in chances if name not in varies]
    return Remaining(tuple(courses), *spectrum(middle, shares, weight), tuple(spaced), tuple(others))


def levels(channel: Channel) -> dict[str, Array]:
    """Level (R,) of each condition that the runs vary: those that share one had it alike."""
    c, there = channel.conditions, varied(channel)
    step = channel.quantity.step(c)
    found = {
        "airflow": np.exp(np.round(np.log(np.maximum(c.airflow_m_s, 0.05)) / AIRFLOWS_APART) * AIRFLOWS_APART),
        "ambient": np.round(c.destination_c / 2.0) * 2.0,
        "direction": np.sign(step),
        "step": (np.abs(step) > 0.6 * np.abs(step).max()).astype(float),
        "pressure": np.round(c.pressure_hpa / 20.0) * 20.0,
        "run_order": (c.order > np.median(c.order)).astype(float),
    }
    return {name: level for name, level in found.items() if name in there and np.unique(level).size > 1}


def spectrum(time_s: Array, shares: Array, weight: Array) -> tuple[Array, Array, Array]:
    """Spectrum of relaxation times of courses (R, n) with weights: times (K,), amplitudes and their uncertainty.

    Non-negative least squares over ln tau, rises and falls apart, with a small weight on their size so that noise is
    not told as pairs that cancel; the band is that of runs drawn again and again.
    """
    known = (weight.sum(axis=0) > 0) & (time_s > 0)
    decades = np.log10(time_s[known][-1] / time_s[known][0])
    taus = np.geomspace(time_s[known][0], time_s[known][-1], max(int(TAUS_PER_DECADE * decades), 4))
    basis = np.exp(-time_s[known][:, None] / taus)
    basis = np.concatenate([basis, np.ones((basis.shape[0], 1))], axis=1)  # what stays at the end has no time constant

    def solved(runs: NDArray[np.int64]) -> Array:
        total = weight[runs][:, known].sum(axis=0)
        mean = (weight[runs] * shares[runs])[:, known].sum(axis=0) / np.maximum(total, 1e-300)
        root = np.sqrt(total / max(float(total.max()), 1e-300))
        size = max(float(np.abs(mean).max()), 1e-12)
        both = root[:, None] * np.concatenate([basis, -basis], axis=1)
        held = SMOOTHING_WEIGHT * np.eye(both.shape[1])
        amplitude, _ = nnls(np.concatenate([both, held]), np.concatenate([root * mean / size, np.zeros(both.shape[1])]))
        count = basis.shape[1]
        return np.asarray(size * (amplitude[:count] - amplitude[count:])[:-1])

    every = np.arange(shares.shape[0])
    rng = np.random.default_rng(SEED)
    drawn = [solved(rng.choice(every, every.size)) for _ in range(BOOTSTRAP_DRAWS)]
    return taus, solved(every), np.asarray(np.std(drawn, axis=0))


def _edges(channel: Channel) -> Array:
    """Edges of bins of log time, from the first readings after the transfer to the last of them."""
    late = channel.time_s[(channel.count > 0) & (channel.time_s > 0)]
    first, last = max(float(late.min()), channel.sampling_period_s), float(late.max())
    count = max(int(BINS_PER_DECADE * np.log10(last / first)), 4)
    return np.geomspace(0.9 * first, 1.001 * last, count + 1)


def _course(condition: str, time_s: Array, shares: Array, weight: Array) -> MeanCourse:
    known = weight.sum(axis=0) > 0
    share, own = shares[:, known], weight[:, known] / weight[:, known].sum(axis=0)
    mean, effective = (own * share).sum(axis=0), 1.0 / (own**2).sum(axis=0)
    spread = np.sqrt((own * (share - mean) ** 2).sum(axis=0) / np.maximum(effective - 1.0, 1.0))
    alone = (own > 0).sum(axis=0) < 2
    return MeanCourse(condition, time_s[known], mean, np.where(alone, np.nan, spread), shares.shape[0])


def _words(factor: str, value: float) -> str:
    return {
        "airflow": f"{value:.2g} m/s",
        "ambient": f"{value + 0.0:.0f} °C",
        "direction": "upwards" if value > 0 else "downwards",
        "step": "large steps" if value else "small steps",
        "pressure": f"{value:.0f} hPa",
        "run_order": "later runs" if value else "earlier runs",
    }[factor]


def _chance(shares: Array, weight: Array, level: Array) -> float:
    """Probability that a condition parts the courses (R, n) so much by chance: an F-ratio over all bins."""

    def mean_of(runs: NDArray[np.bool_]) -> Array:
        return (weight * shares)[runs].sum(axis=0) / np.maximum(weight[runs].sum(axis=0), 1e-300)

    groups = [level == value for value in np.unique(level)]
    whole, means = mean_of(np.ones(level.size, dtype=bool)), [mean_of(own) for own in groups]
    between = sum((weight[own] * (mean - whole) ** 2).sum() for own, mean in zip(groups, means, strict=True))
    within = sum((weight[own] * (shares[own] - mean) ** 2).sum() for own, mean in zip(groups, means, strict=True))
    # Bins of a run go together: each run counts as one.
    degrees, left = len(groups) - 1, level.size - len(groups)
    return 1.0 if left < 1 or within <= 0 else float(special.fdtrc(degrees, left, between / degrees / (within / left)))


# How far off a model is on runs that it was not fitted to, sample by sample.


@dataclass(frozen=True)
class MisfitSize:
    """How far off a model is from FIRST_LOG_BIN_S after the transfer on: rms, and the largest mean in a bin of log
    time, with its run."""

    rms: float
    peak: float
    peak_time_s: float
    peak_run: str


def size(held: HeldOut, residuals: tuple[Array, ...]) -> MisfitSize:
    """Size of held-out residuals [channel's unit]."""
    # A reading amid the air's jump is off by the whole step where the run's start is off by milliseconds.
    after = [r[t >= FIRST_LOG_BIN_S] for t, r in zip(held.time_s, residuals, strict=True)]
    peaks = [(0.0, 0.0, "")]
    for run, time, residual in zip(held.run_ids, held.time_s, residuals, strict=True):
        where, mean = log_bins(time, residual)
        peaks += [(float(m), float(t), run) for t, m in zip(where, mean, strict=True)]
    return MisfitSize(float(np.sqrt(np.mean(np.concatenate(after) ** 2))), *max(peaks, key=lambda one: abs(one[0])))


def autocorrelation(
    held: HeldOut, residuals: tuple[Array, ...], period_s: float, lags: int = LAGS_SHOWN
) -> tuple[Array, int]:
    """Autocorrelation at lags 1 .. `lags` samples over all runs after the transfer, and the number of samples."""
    products, count = np.zeros(lags + 1), np.zeros(lags + 1)
    for time, residual in zip(held.time_s, residuals, strict=True):
        later = time > 0
        if not later.any():
            continue
        index = np.rint((time[later] - time[later][0]) / period_s).astype(int)
        grid = np.full(index.max() + 1, np.nan)
        grid[index] = residual[later]
        for lag in range(min(lags + 1, grid.size)):
            pairs = grid[lag:] * grid[: grid.size - lag]
            products[lag] += np.nansum(pairs)
            count[lag] += np.isfinite(pairs).sum()
    means = products / np.maximum(count, 1)
    return means[1:] / max(means[0], 1e-300), int(count[0])
