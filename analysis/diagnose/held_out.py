"""Residuals on runs that a model was not fitted to, sample by sample, and what can be read off them.

In each fold the model is fitted anew to the other runs; a run's own start and airs are then placed within their stated
uncertainties, the same way for every model, as in the measure of the gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.characterize.result import ChannelResult
from shockrig.analysis.diagnose.diagnosed import ChannelDiagnosis
from shockrig.analysis.diagnose.gain import folds, placed, plainly
from shockrig.analysis.estimate.channel import FIRST_LOG_BIN_S, log_bins
from shockrig.analysis.estimate.fit import Fit, fit, model_at_samples
from shockrig.analysis.estimate.model import PLAIN, Model, Structure
from shockrig.analysis.estimate.problem import Problem

Array = NDArray[np.float64]
LAGS_SHOWN = 20


@dataclass(frozen=True)
class HeldOut:
    """Held-out residuals [channel's unit] of each run at its samples: time since the transfer, before and after.

    `before` is the plain model's, `after` that of the model with the causes found.
    """

    runs: tuple[int, ...]
    run_ids: tuple[str, ...]
    time_s: tuple[Array, ...]
    before: tuple[Array, ...]
    after: tuple[Array, ...]


def held_out(found: ChannelDiagnosis) -> HeldOut:
    """Residuals of a channel's runs, each under models that never saw it; runs alone at their ambient have none."""
    channel, problem = found.problem.channel, found.problem
    fold = folds(channel)
    before: dict[int, Array] = {}
    after: dict[int, Array] = {}
    for k in range(fold.max() + 1):
        train = fold != k
        test = np.flatnonzero((fold == k) & np.isin(channel.ambient, channel.ambient[train]))
        if not train.any() or not test.size:
            continue
        before |= _residuals(problem, train, test, found.plain, PLAIN)
        if found.final.structure.effects:
            after |= _residuals(problem, train, test, found.final, found.final.structure)
    after = after or before
    told = sorted(before)
    return HeldOut(
        runs=tuple(told),
        run_ids=tuple(channel.run_ids[i] for i in told),
        time_s=tuple(channel.samples[i][0] for i in told),
        before=tuple(before[i] for i in told),
        after=tuple(after[i] for i in told),
    )


def _residuals(
    problem: Problem, train: NDArray[np.bool_], test: NDArray[np.int64], whole: Fit, structure: Structure
) -> dict[int, Array]:
    """`structure` is what predicts: the plain model goes without what the single readings have shown."""
    own = fit(problem.select(train), whole.structure, whole.theta, whole.deviations[train])
    bins = problem.select(test)
    predicting = own if structure.ids else plainly(own)
    predicting = replace(predicting, model=Model(bins.channel, structure))
    models = model_at_samples(bins.channel, replace(predicting, deviations=placed(bins, predicting)))
    return {int(i): problem.channel.samples[i][1] - model for i, model in zip(test, models, strict=True)}


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
    peak = (0.0, 0.0, "")
    for run, time, residual in zip(held.run_ids, held.time_s, residuals, strict=True):
        where, mean = log_bins(time, residual)
        if mean.size and np.abs(mean).max() > abs(peak[0]):
            i = int(np.argmax(np.abs(mean)))
            peak = (float(mean[i]), float(where[i]), run)
    return MisfitSize(float(np.sqrt(np.mean(np.concatenate(after) ** 2))), *peak)


def autocorrelation(
    held: HeldOut, residuals: tuple[Array, ...], period_s: float, lags: int = LAGS_SHOWN
) -> tuple[Array, int]:
    """Autocorrelation at lags 1 .. `lags` samples over all runs after the transfer, and the number of samples."""
    products, count, square = np.zeros(lags), np.zeros(lags), 0.0
    total = 0
    for time, residual in zip(held.time_s, residuals, strict=True):
        later = time > 0
        if not later.any():
            continue
        index = np.rint((time[later] - time[later][0]) / period_s).astype(int)
        grid = np.full(index.max() + 1, np.nan)
        grid[index] = residual[later]
        square += float(np.nansum(grid**2))
        total += int(np.isfinite(grid).sum())
        for lag in range(1, min(lags + 1, grid.size)):
            pairs = grid[lag:] * grid[:-lag]
            products[lag - 1] += np.nansum(pairs)
            count[lag - 1] += np.isfinite(pairs).sum()
    return products / np.maximum(count, 1) / max(square / max(total, 1), 1e-300), total


class SingleRun(Protocol):
    """What one run alone says of the diffusivity, as a ratio to the joint fit, and what the run was."""

    @property
    def value(self) -> float: ...
    @property
    def standard_uncertainty(self) -> float: ...
    @property
    def direction(self) -> str: ...
    @property
    def ambient_c(self) -> float: ...
    @property
    def airflow_m_s(self) -> float | None: ...
    @property
    def amplitude(self) -> float: ...


@dataclass(frozen=True)
class Drift:
    """How a single run's diffusivity moves with a condition that it should not depend on.

    `change` is relative, from the lowest to the highest value in the campaign, the other conditions held; `sigmas` is
    that over its standard uncertainty, the scatter of the runs counted.
    """

    condition: str
    change: float
    sigmas: float

    @property
    def moves(self) -> bool:
        return abs(self.sigmas) > 4.0


def drifts(runs: Sequence[SingleRun], result: ChannelResult) -> list[Drift]:
    """Regression of the single runs' ln D on airflow, direction, amplitude and ambient, all at once.

    Conditions that did not vary, or that the campaign varied only together with others, are left out.
    """
    columns = {
        "airflow": np.array([np.log(r.airflow_m_s) if r.airflow_m_s else np.nan for r in runs]),
        "direction": np.array([1.0 if r.direction == "up" else 0.0 for r in runs]),
        "amplitude": np.array([r.amplitude for r in runs], dtype=float),
    }
    if result.channel.quantity.pooled:
        columns["ambient"] = np.array([r.ambient_c for r in runs], dtype=float)
    columns = {k: (x - x.min()) / np.ptp(x) for k, x in columns.items() if np.isfinite(x).all() and np.ptp(x) > 1e-6}
    values = np.log([r.value for r in runs])
    if len(runs) < len(columns) + 4 or not columns:
        return []
    spread = np.array([r.standard_uncertainty / r.value for r in runs])
    design = np.column_stack([np.ones(len(runs)), *columns.values()])
    extra = 0.0
    for _ in range(20):  # the runs' own scatter, so that the weights are those of the runs as they are
        weight = 1.0 / (spread**2 + extra)
        normal = design.T @ (weight[:, None] * design)
        covariance = np.linalg.pinv(normal, hermitian=True)
        coefficient = covariance @ (design.T @ (weight * values))
        left = values - design @ coefficient
        freedom = len(runs) - design.shape[1]
        excess = float((weight * left**2).sum()) / freedom
        if excess <= 1.0:
            break
        extra = max(extra, 1e-9) + (excess - 1.0) / float(np.mean(weight))
    found = []
    for i, name in enumerate(columns, start=1):
        others = np.delete(design, i, axis=1)
        own = design[:, i] - others @ np.linalg.lstsq(others, design[:, i], rcond=None)[0]
        if own.std() < 0.3 * design[:, i].std():
            continue
        change, sigma = float(np.expm1(coefficient[i])), float(np.sqrt(covariance[i, i]))
        found.append(Drift(name, change, float(coefficient[i]) / sigma))
    return found
