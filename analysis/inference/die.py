"""The hygrometer's own temperature without its noise, and when it leaves the dew behind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from shockrig.analysis.physics.conditions import Conditions
from shockrig.analysis.physics.humidity import dew_point_c

Array = NDArray[np.float64]
RAMPS_S = np.array([0.0, 0.2, 0.4, 0.7, 1.1, 1.8, 3.0])
LATE_S = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0])
EARLY_S = 5.0  # after the transfer, in which every reading counts
MOST_SHARE = 0.05  # of the time that a run has lasted, by which a clock may be late
SHORTEST_S = 1e-3  # of a ramp: below, it is a step
LAGS_S = np.geomspace(0.5, 120.0, 12)


def smooth_dies(times: Sequence[Array], dies: Sequence[Array], tempo: float) -> tuple[Array, ...]:
    """Die temperatures without their noise: constant before the transfer, a smooth relaxation after it.

    The relaxation is a sum of first-order lags behind a ramp that begins late. How long the ramp is, and how late, is
    what for all runs together leaves least: a transfer that takes time shows in the die as a start without a kink, a
    sensor that is logged late as a kink behind the transfer, a clock that runs fast as one that is the later the longer
    the run has lasted.
    """
    filled = [_fill(t, d) for t, d in zip(times, dies, strict=True)]
    levels = [float(np.mean(d[t <= 0])) if (t <= 0).any() else float(d[0]) for t, d in zip(times, filled, strict=True)]
    moved = [i for i, d in enumerate(filled) if np.isfinite(d).all() and abs(d[-20:].mean() - levels[i]) > 1.0]
    begun = _begun([times[i] for i in moved], [filled[i] - levels[i] for i in moved], tempo)

    def smooth(i: int) -> Array:
        basis = _lags(times[i] - _late_s(begun, -times[i][0]), float(begun[0]), tempo)
        return levels[i] + (basis @ _amounts(basis, filled[i] - levels[i]))[:, 0]

    return tuple(smooth(i) if np.isfinite(d).all() else d for i, d in enumerate(filled))


def _begun(times: Sequence[Array], rises: Sequence[Array], tempo: float) -> Array:
    """How all relaxations begin: length of the ramp [s], how late it begins [s], and by what share of the time that the
    run has lasted it is later."""
    if not times:
        return np.zeros(3)
    # What is before the transfer says nothing of it, and what is long after it little: one reading in ten.
    near = [np.flatnonzero((t > -0.2 * tempo) & ((t < EARLY_S * tempo) | (np.arange(t.size) % 10 == 0))) for t in times]
    time = np.full((len(times), max(k.size for k in near)), -np.inf)
    rise, lead_s = np.zeros(time.shape), np.array([-t[0] for t in times])
    for i, k in enumerate(near):
        time[i, : k.size], rise[i, : k.size] = times[i][k], rises[i][k]

    def left(begun: Array) -> float:
        basis = _lags(time - _late_s(begun, lead_s)[:, None], float(begun[0]), tempo)
        return float(((basis @ _amounts(basis, rise) - rise[..., None]) ** 2).sum())

    begun = min((np.array([ramp_s, late_s, 0.0]) for ramp_s in RAMPS_S * tempo for late_s in LATE_S * tempo), key=left)
    bounds = [(0.0, RAMPS_S[-1] * tempo), (0.0, LATE_S[-1] * tempo), (-MOST_SHARE, MOST_SHARE)]
    for _ in range(2):  # a simplex may shrink before it is there
        simplex = begun + np.vstack([np.zeros(3), np.diag([0.1 * tempo, 0.05 * tempo, 0.1 * MOST_SHARE])])
        begun = optimize.minimize(
            left,
            begun,
            method="Nelder-Mead",
            bounds=bounds,
            options={"initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-4 * left(begun)},
        ).x
    return np.asarray(begun)


def _late_s(begun: Array, lead_s: Array) -> Array:
    return np.asarray(begun[1] + begun[2] * np.maximum(lead_s, 0.0))


def _amounts(basis: Array, rise: Array) -> Array:
    """How much of each lag dies show (..., 12, 1), by least squares that keeps the sizes small."""
    turned = np.swapaxes(basis, -1, -2)
    size = 1e-6 * (basis[..., 0] > 0).sum(axis=-1) + 1e-12
    return np.asarray(
        np.linalg.solve(turned @ basis + size[..., None, None] * np.eye(LAGS_S.size), turned @ rise[..., None])
    )


def _fill(time: Array, die: Array) -> Array:
    good = np.isfinite(die)
    if good.all():
        return die
    return np.interp(time, time[good], die[good]) if good.sum() >= 20 else np.full(time.size, np.nan)


def _lags(time: Array, ramp_s: float, tempo: float) -> Array:
    """Responses of first-order lags of 0.5 to 120 s to a ramp from 0 to 1 over `ramp_s`, (..., 12)."""
    tau = LAGS_S * tempo
    begun, ended = np.maximum(time, 0.0), np.maximum(time - ramp_s, 0.0)

    def behind(since: Array) -> Array:
        return np.asarray(1.0 - np.exp(-since[..., None] / tau))

    if ramp_s < SHORTEST_S:
        return behind(begun)
    return np.asarray(((begun - ended)[..., None] - tau * (behind(begun) - behind(ended))) / ramp_s)


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
