"""The hygrometer's own temperature without its noise, and when it leaves the dew behind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.physics.conditions import Conditions
from shockrig.analysis.physics.humidity import dew_point_c

Array = NDArray[np.float64]
RAMPS_S = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.4, 2.0, 3.0)
LAGS_S = np.geomspace(0.5, 120.0, 12)


def smooth_dies(times: Sequence[Array], dies: Sequence[Array], tempo: float) -> tuple[Array, ...]:
    """Die temperatures without their noise: constant before the transfer, a smooth relaxation after it.

    The relaxation is a sum of first-order lags behind a ramp; the ramp's duration is the one, for all runs together,
    that leaves least (a transfer that takes time shows in the die as a start without a kink).
    """
    filled = [_fill(t, d) for t, d in zip(times, dies, strict=True)]
    levels = [float(np.mean(d[t <= 0])) if (t <= 0).any() else float(d[0]) for t, d in zip(times, filled, strict=True)]
    moved = [i for i, d in enumerate(filled) if np.isfinite(d).all() and abs(d[-20:].mean() - levels[i]) > 1.0]

    def relax(i: int, ramp_s: float) -> tuple[Array, float]:
        after = times[i] > 0
        basis = _lags(times[i][after], ramp_s, tempo)
        rows = np.vstack([basis, 1e-3 * np.sqrt(after.sum()) * np.eye(basis.shape[1])])
        right = np.concatenate([filled[i][after] - levels[i], np.zeros(basis.shape[1])])
        smooth = np.full(times[i].size, levels[i])
        smooth[after] += basis @ np.linalg.lstsq(rows, right, rcond=None)[0]
        return smooth, float(((smooth - filled[i]) ** 2).sum())

    ramp_s = min(RAMPS_S, key=lambda r: sum(relax(i, r)[1] for i in moved[:8])) if moved else 0.0
    return tuple(relax(i, ramp_s)[0] if np.isfinite(d).all() else d for i, d in enumerate(filled))


def _fill(time: Array, die: Array) -> Array:
    good = np.isfinite(die)
    if good.all():
        return die
    return np.interp(time, time[good], die[good]) if good.sum() >= 20 else np.full(time.size, np.nan)


def _lags(time: Array, ramp_s: float, tempo: float) -> Array:
    """Responses of first-order lags of 0.5 to 120 s to a ramp from 0 to 1 over `ramp_s`: (n, 12)."""
    tau = LAGS_S * tempo
    if ramp_s == 0:
        response: Array = 1.0 - np.exp(-time[:, None] / tau)
        return response

    def integral(t: Array) -> Array:
        late = np.maximum(t, 0.0)[:, None]
        return np.asarray(late - tau * (1.0 - np.exp(-late / tau)))

    return (integral(time) - integral(time - ramp_s)) / ramp_s


def past_dew_s(conditions: Conditions, times: Sequence[Array], dies: Sequence[Array]) -> Array:
    """When each run's die passes the dew point of the destination [s] (R,); NaN where it never was below it."""
    dew = dew_point_c(np.clip(conditions.destination_percent, 1.0, 100.0), conditions.destination_c)
    passed = np.full(len(times), np.nan)
    for run, (time, die) in enumerate(zip(times, dies, strict=True)):
        below = (time > 0) & (die < dew[run])
        if conditions.source_c[run] < dew[run] and below.any():
            last = int(np.flatnonzero(below)[-1])
            ahead = min(last + 1, time.size - 1)
            rise = die[ahead] - die[last]
            share = np.clip((dew[run] - die[last]) / rise, 0.0, 1.0) if rise > 0 else 0.0
            passed[run] = time[last] + share * (time[ahead] - time[last])
    return passed
