"""What a model leaves, without any form: its course in time with a band, condition by condition; its spectrum of
relaxation times; what it varies with and what it does not.

The course is that of the residuals over each run's own step, so that runs of all sizes and both directions lie upon one
another where what is left goes with the step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.optimize import nnls

from shockrig.analysis.diagnose.grammar import varied
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.fit import Fit, left_at_common_rates

Array = NDArray[np.float64]

BINS_PER_DECADE = 6
TAUS_PER_DECADE = 8
SMOOTHING_WEIGHT = 0.15  # weight of the spectrum's own size, beside residuals of unit size
BOOTSTRAP_DRAWS = 24  # draws of the runs for the spectrum's band
SEED = 11
LEVELS_APART = 0.06  # relative, of levels of a condition that are one
LEAST_P_VALUE = 1e-3  # above which a condition parts nothing


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
    whole : Course
        Of all runs together.
    by_condition : tuple of Course
        Of the condition that parts it best; none where nothing does.
    factor : str
        That condition; empty where there is none.
    time_constants_s, amplitude, uncertainty : ndarray (K,)
        Spectrum of relaxation times: the course is the sum of amplitude exp(-t / time constant), shares of the step.
    varies_with, does_not_vary_with : tuple of str
        Conditions that part it, the best first, and conditions that were varied and do not.
    """

    whole: MeanCourse
    by_condition: tuple[MeanCourse, ...]
    factor: str
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
    shares, weight = _shares(channel, left_at_common_rates(channel, found), step, usable, edges)
    if not (weight.sum(axis=0) > 0).any():
        return None
    middle = np.sqrt(edges[:-1] * edges[1:])
    levels = {name: level[usable] for name, level in _levels(channel).items()}
    parted = {name: _chance(shares, weight, level) for name, level in levels.items()}
    varies = sorted((name for name, p in parted.items() if p < LEAST_P_VALUE), key=parted.__getitem__)
    factor = varies[0] if varies else ""
    by_condition = []
    if factor:
        for value in np.unique(levels[factor]):
            own = levels[factor] == value
            by_condition.append(_course(_words(factor, value), middle, shares[own], weight[own]))
    whole = _course("all runs", middle, shares, weight)
    taus, amplitude, uncertainty = spectrum(middle, shares, weight)
    return Remaining(
        whole,
        tuple(by_condition),
        factor,
        taus,
        amplitude,
        uncertainty,
        tuple(varies),
        tuple(name for name in parted if name not in varies),
    )


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


def _shares(
    channel: Channel, residual: Array, step: Array, usable: NDArray[np.bool_], edges: Array
) -> tuple[Array, Array]:
    """Residuals over the step (R, n) in bins of log time, and their weights."""
    runs = np.flatnonzero(usable)
    shares, weight = np.zeros((runs.size, edges.size - 1)), np.zeros((runs.size, edges.size - 1))
    for place, run in enumerate(runs):
        time, count = channel.time_s[run], channel.count[run]
        inside = np.digitize(time, edges) - 1
        for k in range(edges.size - 1):
            here = (inside == k) & (count > 0)
            if here.any():
                shares[place, k] = np.average(residual[run, here], weights=count[here]) / step[run]
                weight[place, k] = count[here].sum() * step[run] ** 2
    return shares, weight


def _course(condition: str, time_s: Array, shares: Array, weight: Array) -> MeanCourse:
    total = weight.sum(axis=0)
    known = total > 0
    mean = (weight * shares).sum(axis=0)[known] / total[known]
    runs = (weight > 0).sum(axis=0)[known]
    scatter = (weight[:, known] * (shares[:, known] - mean) ** 2).sum(axis=0) / total[known]
    effective = np.maximum(total[known] ** 2 / np.maximum((weight[:, known] ** 2).sum(axis=0), 1e-300), 1.0)
    spread = np.sqrt(scatter / np.maximum(effective - 1.0, 1.0))
    return MeanCourse(condition, time_s[known], mean, np.where(runs > 1, spread, np.nan), shares.shape[0])


def _levels(channel: Channel) -> dict[str, Array]:
    """Levels (R,) of the conditions that were varied."""
    c, there = channel.conditions, varied(channel)
    step = channel.quantity.step(c)
    levels = {}
    if "airflow" in there:
        levels["airflow"] = np.exp(np.round(np.log(np.maximum(c.airflow_m_s, 0.05)) / LEVELS_APART) * LEVELS_APART)
    if "ambient" in there:
        levels["ambient"] = np.round(c.destination_c / 2.0) * 2.0
    if "direction" in there:
        levels["direction"] = np.sign(step)
    if "step" in there:
        levels["step"] = np.where(np.abs(step) > 0.6 * np.abs(step).max(), 1.0, 0.0)
    if "pressure" in there:
        levels["pressure"] = np.round(c.pressure_hpa / 20.0) * 20.0
    if "run_order" in there:
        levels["run order"] = np.where(c.order > np.median(c.order), 1.0, 0.0)
    return {name: level for name, level in levels.items() if np.unique(level).size > 1}


def _words(factor: str, value: float) -> str:
    return {
        "airflow": f"{value:.2g} m/s",
        "ambient": f"{value + 0.0:.0f} °C",
        "direction": "upwards" if value > 0 else "downwards",
        "step": "large steps" if value else "small steps",
        "pressure": f"{value:.0f} hPa",
        "run order": "later runs" if value else "earlier runs",
    }[factor]


def _chance(shares: Array, weight: Array, level: Array) -> float:
    """Probability that a condition parts the courses (R, n) so much by chance: an F-ratio over all bins."""
    groups = [level == value for value in np.unique(level)]
    between = within = 0.0
    degrees, left = 0, 0
    whole = (weight * shares).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-300)
    for own in groups:
        total = weight[own].sum(axis=0)
        mean = (weight[own] * shares[own]).sum(axis=0) / np.maximum(total, 1e-300)
        between += float((total * (mean - whole) ** 2).sum())
        within += float((weight[own] * (shares[own] - mean) ** 2).sum())
        left += max(int(own.sum()) - 1, 0)
    degrees = len(groups) - 1
    if left < 1 or within <= 0:
        return 1.0
    # Bins of a run go together: each run counts as one.
    return float(special.fdtrc(degrees, left, between / degrees / (within / left)))
