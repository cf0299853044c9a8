"""Is anything left? Tests without physics of what a fitted model leaves.

The mean response: a smooth basis in log time, crossed with step, direction, ambient and airflow, after the model's own
parameters and each run's random effects are projected out. And these: rates that scatter more than sensors' do, starts
and airs that are off by more than is stated of them. What single readings do all along is `hums`'s.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.quantity import RUN_EFFECT_NAMES, RunEffect

Array = NDArray[np.float64]

WINDOWS_S = (0.0, 0.15, 0.6, 2.5, 10.0, 30.0, 1e9)
VARIES_SHARE, VARIES_LEAST = 0.2, 15.0  # of what says most, and of chi-square beyond its mean: less is not said
KNOTS_S = (0.0, 0.15, 0.4, 1.0, 2.5, 6.0, 15.0, 40.0, 120.0)


@dataclass(frozen=True)
class Check:
    """One test: what it looked at, and its probability under the model."""

    name: str
    p: float


@dataclass(frozen=True)
class Adequacy:
    """All tests of one fit."""

    checks: tuple[Check, ...]

    @property
    def p(self) -> float:
        """Their combined probability (Bonferroni)."""
        return min(1.0, self.worst.p * len(self.checks))

    @property
    def passed(self) -> bool:
        return self.p > level("adequacy")

    @property
    def worst(self) -> Check:
        return min(self.checks, key=lambda c: c.p)


def judge(problem: Problem, found: Fit) -> Adequacy:
    """Test what `found` leaves of a problem's data."""
    return Adequacy((_response(problem, found), *_deviations(problem, found)))


def time_basis(time: Array, tempo: float = 1.0) -> Array:
    """Hat functions in log time since the transfer, and one for the plateau before it: (..., K)."""
    knots = np.log(np.array(KNOTS_S[1:]) * tempo)
    late = np.log(np.maximum(time, 0.02 * tempo))
    hats = [np.interp(late, knots, row) for row in np.eye(knots.size)]
    columns = [np.where(time <= 0, 1.0, 0.0)] + [np.where(time > 0, h, 0.0) for h in hats]
    return np.stack(columns, axis=-1)


def _factor_rows(channel: Channel) -> dict[str, Array]:
    """What a residual may vary with, and how much of it each run has (R,): centred and scaled."""
    c = channel.conditions
    step, thermal = channel.quantity.air_step(c), c.thermal_step_k

    def scaled(x: Array) -> Array:
        spread = x.std()
        return (x - x.mean()) / spread if spread > 1e-9 else np.zeros_like(x)

    step = step / max(np.abs(step).max(), 1e-9)
    ambient, airflow = scaled(c.destination_c), scaled(np.log(np.maximum(c.airflow_m_s, 0.1)))
    rows = {
        "nothing: the same in every run": np.ones(channel.runs),
        "the step": step,
        "the step times the ambient": step * ambient,
        "the step times the airflow": step * airflow,
        "the size of the step": np.abs(step),
    }
    if channel.jumps_with_air:
        return rows | {"the change of temperature": thermal / max(np.abs(thermal).max(), 1.0)}
    return rows | {"the ambient": ambient, "the airflow": airflow}


def _factor_scores(problem: Problem, found: Fit) -> tuple[dict[str, NDArray[np.int64]], Array, Array]:
    """Scores of the basis in time times each factor, and their covariance; and which of them are each factor's."""
    rows = _factor_rows(problem.channel)
    basis = time_basis(problem.channel.time_s, problem.channel.tempo)
    columns = np.concatenate([basis * row[:, None, None] for row in rows.values()], axis=-1)
    right, normal = found.scores(problem, problem.whiten(columns))
    return dict(zip(rows, np.arange(right.size).reshape(len(rows), -1), strict=True)), right, normal


def _response(problem: Problem, found: Fit) -> Check:
    _, right, normal = _factor_scores(problem, found)
    statistic, degrees = _score(right, normal)
    return Check("mean response", float(special.chdtrc(degrees, statistic)))


def _score(right: Array, normal: Array) -> tuple[float, int]:
    """Chi-square of scores with their covariance, and its rank."""
    scale = np.sqrt(np.maximum(np.diag(normal), 0))
    use = scale > 1e-6 * max(scale.max(), 1e-300)
    normal, right, scale = normal[np.ix_(use, use)], right[use], scale[use]
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    keep = values > 1e-3
    score = vectors[:, keep].T @ (right / scale)
    return float((score**2 / values[keep]).sum()), int(keep.sum())


def varies_with(problem: Problem, found: Fit) -> list[str]:
    """What the residuals of a fit vary with, most first: each by what it tells beyond those before it, so that where
    all steps are about as large neither the step nor its size is named. Of those that tell as much, as with two runs,
    the first in their usual order."""
    own, right, normal = _factor_scores(problem, found)

    def told(names: Sequence[str]) -> float:
        at = np.concatenate([own[name] for name in names])
        statistic, degrees = _score(right[at], normal[np.ix_(at, at)])
        return statistic - degrees

    said: list[str] = []
    before = most = 0.0
    while len(said) < len(own):
        more = {name: float(f"{told([*said, name]) - before:.2g}") for name in own if name not in said}
        best = max(more, key=more.__getitem__)
        most = most or more[best]
        if not more[best] > max(VARIES_SHARE * most, VARIES_LEAST):
            break
        said.append(best)
        before = told(said)
    return said


def in_common(channel: Channel, found: Fit, noise: Noise) -> float | None:
    """How much of what a fit leaves its runs have in common, from 0 to 1; None of a single run.

    What one curve in time tells of its squares beyond noise, as a share of what a curve of each run's own tells. Runs
    whose mean is no accident may be far apart all the same.
    """
    if channel.runs < 2:
        return None
    weight = np.sqrt(channel.count)
    basis, left = time_basis(channel.time_s, channel.tempo) * weight[..., None], found.residual * weight

    def told(columns: Array, values: Array) -> float:
        used = columns[:, np.abs(columns).sum(axis=0) > 0.0]
        fitted = used @ np.linalg.lstsq(used, values, rcond=None)[0]
        return float((fitted**2).sum()) - used.shape[1] * noise.standard_deviation**2

    own = sum(told(*run) for run in zip(basis, left, strict=True))
    share = told(basis.reshape(-1, basis.shape[-1]), left.ravel()) / own if own > 0.0 else 0.0
    return float(np.clip(share, 0.0, 1.0))


def when_largest(channel: Channel, found: Fit, noise: Noise) -> tuple[float, float]:
    """The window of time after the transfer [s] in which residuals are largest above what the noise would give; none
    is shorter than the time from reading to reading."""
    late = np.where(channel.time_s > 0, channel.time_s, np.nan)
    ends_s = channel.tempo * np.array(WINDOWS_S[1:])
    windows = list(itertools.pairwise((0.0, *ends_s[ends_s >= channel.sampling_period_s].tolist())))
    excess = []
    for low, high in windows:
        inside = (channel.count > 0) & (late > low) & (late <= high)
        expected = noise.standard_deviation**2 / np.maximum(channel.count[inside], 1)
        excess.append(float((found.residual[inside] ** 2 - expected).mean()) if inside.any() else 0.0)
    begins, ends = windows[int(np.argmax(excess))]
    return begins, min(ends, float(np.nanmax(late)))


def _deviations(problem: Problem, found: Fit) -> list[Check]:
    """Whether runs differ in their rates as no sensor does, or in anything else by more than is stated of it."""
    # Runs that differ a little are no effect; rates that differ by several percent are, whatever makes them differ.
    wide = found.rate_scatter > level("rate_scatter")
    checks = [Check("scatter of the runs' rate", 0.0 if wide else 1.0)]
    prior = 1.0 / found.arrow.weight
    spread = np.maximum(prior - found.arrow.run_variances(), 0.0)
    for k, name in enumerate(RUN_EFFECT_NAMES[: prior.shape[1]]):
        told = (spread[:, k] > 0.2 * prior[:, k]) & problem.stated[:, k]
        if told.sum() < 4 or k in (RunEffect.RATE, RunEffect.STRENGTH, RunEffect.DRIFT):  # their scatter is estimated
            continue
        # Stated uncertainties are good to about a third: the scale of the test is widened by that.
        total = float((found.deviations[told, k] ** 2 / spread[told, k]).sum()) / level("stated_scatter")
        checks.append(Check(f"scatter of the runs' {name}", float(special.chdtrc(float(told.sum()), total))))
    return checks
