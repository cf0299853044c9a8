"""What can be read off residuals on runs that a model was not fitted to, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnose.gain import HeldOut
from shockrig.analysis.estimate.channel import FIRST_LOG_BIN_S, log_bins

Array = NDArray[np.float64]
LAGS_SHOWN = 20


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
