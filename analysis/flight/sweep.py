"""One sweep of the smoother over a channel: overlapping windows side by side, put together again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from shockrig.analysis.flight.prior import UNSEEN_VARIANCE, Passing, Prior
from shockrig.analysis.flight.response import Response
from shockrig.analysis.flight.smoother import Jumps, Smoothed, smooth

Array = NDArray[np.float64]
CORE = 250  # samples of a window that are kept
CUT_SHORT = 0.1  # of a jump: what modes that are left out do to the first reading after it
SIDE_BY_SIDE = 64  # windows at once
REACH = 2.0  # times how far the lags were behind at a gap's start


@dataclass(frozen=True)
class Track:
    """A channel's nodes (m,): samples with the gaps filled, and the windows that they are smoothed in.

    Attributes
    ----------
    time_s : ndarray (m,)
    period_s : float
    along : Response
        With a row for each node.
    passing : Passing or None
    index, owner : ndarray (w, n)
        Nodes of each window, -1 for padding, and which of them it owns.
    broken : ndarray (m,)
        Where a stretch begins that nothing before it tells about.
    """

    time_s: Array
    period_s: float
    along: Response
    passing: Passing | None
    index: NDArray[np.int64]
    owner: NDArray[np.bool_]
    broken: NDArray[np.bool_]


@dataclass(frozen=True)
class Sweep:
    """What a sweep gives at each node (m,): as `Smoothed`, with the variance of the air widened where it surprises."""

    air: Array
    variance: Array
    clean: Array
    clean_variance: Array
    jump: Array
    jump_score: Array
    cost: Array


def swept(
    track: Track,
    values: Array,
    variance: Array,
    local: Prior,
    jumps: Jumps,
    before: Sweep | None = None,
    around: NDArray[np.bool_] | None = None,
) -> Sweep:
    """Smooth all windows, or those with a node in `around` where the others stay as they were `before`.

    `values` (m,) are readings with gaps bridged, `variance` (m,) theirs, infinite where there is none.
    """
    safe = np.maximum(track.index, 0)
    wanted = np.arange(len(safe))
    if around is not None:
        wanted = np.flatnonzero((around[safe] & (track.index >= 0)).any(axis=1))
    shapes = {"jump": (values.size, 2), "jump_score": (values.size, 2)}
    names = [f.name for f in fields(Sweep)]
    out = {name: np.full(shapes.get(name, values.size), np.nan) for name in names}
    if before is not None:
        out = {name: getattr(before, name).copy() for name in names}
    guess = lags_behind(values, track.along, track.period_s, track.broken)
    for start in range(0, wanted.size, SIDE_BY_SIDE):
        part = wanted[start : start + SIDE_BY_SIDE]
        at, keep = safe[part], track.owner[part]
        breaks = Jumps(jumps.variance[at], jumps.place[at])
        found = _smoothed(track, values, variance, local, breaks, track.index[part], guess)
        wider = _inflation(found.surprise, keep)
        unseen = UNSEEN_VARIANCE * local.turbulence[at] ** 2
        for name in names:
            value = getattr(found, name)
            if name == "variance":
                value = value * wider[:, None] + unseen
            out[name][at[keep]] = value[keep]
    return Sweep(**out)


def costs(
    track: Track, values: Array, variance: Array, local: Prior, tried: Sequence[Jumps], nodes: NDArray[np.int64]
) -> Array:
    """Minus the log-likelihood (t,) of the readings at some neighbouring nodes under each of the jumps."""
    at = np.tile(nodes, (len(tried), 1))
    jumps = Jumps(np.stack([one.variance[nodes] for one in tried]), np.stack([one.place[nodes] for one in tried]))
    guess = lags_behind(values, track.along, track.period_s, track.broken)
    return _smoothed(track, values, variance, local, jumps, at, guess).cost.sum(axis=1)


def _smoothed(
    track: Track,
    values: Array,
    variance: Array,
    local: Prior,
    jumps: Jumps,
    index: NDArray[np.int64],
    guess: tuple[Array, Array],
) -> Smoothed:
    """Windows of nodes `index` (w, n) with jumps (w, n) in them; `guess` is where the lags stand (`lags_behind`)."""
    at, padded = np.maximum(index, 0), index < 0
    step = np.diff(track.time_s[at], axis=1, prepend=track.time_s[at[:, :1]])
    step = np.where(padded, track.period_s, step)
    prior = local.each(lambda strength: strength[at])
    leap = Jumps(np.where(padded[..., None], 0.0, jumps.variance), jumps.place)
    noise = np.where(padded, np.inf, variance[at]) + CUT_SHORT**2 * leap.variance[..., 0]
    lags, apart = guess
    first = at[:, 0]
    spread = 2.0 * np.std(values[at], axis=1)
    # over a gap the air went from where it was to about where the reading is, and what lags is in between
    before = np.maximum(first - 1, 0)
    gone = np.abs(values[first] - values[before]) + REACH * apart[before].max(axis=1) + np.sqrt(np.mean(apart**2))
    spread = np.where(track.broken[first] & (first > 0), np.minimum(gone, spread), spread) + 5.0 * prior.noise[:, 0]
    here = None if track.passing is None else replace(track.passing, sigma=track.passing.sigma[at])
    # what came before a flight is not known; later the readings tell how far the lags may be from their guess
    lag_spread = np.where(track.broken[first][:, None], spread[:, None], apart[first] + 5.0 * prior.noise[:, :1])
    return smooth(step, values[at], noise, track.along.at(at), lags[first], prior, spread, here, lag_spread, leap)


def lags_behind(
    values: Array, along: Response, period: float, broken: NDArray[np.bool_] | None = None
) -> tuple[Array, Array]:
    """Each lag behind evenly spaced `values` (n, K) from rest, and how far the two were apart in the lag's memory, rms.

    Behind the readings it is a guess of where the sensor stands: the air is about as far from the reading as that.
    Where values are `broken` (n,) nothing before tells, and lags start from rest again.
    """
    starts = [] if broken is None else [k for k in np.flatnonzero(broken).tolist() if k]
    if starts:
        parts = [lags_behind(one, along, period) for one in np.split(values, starts)]
        behind, far = zip(*parts, strict=True)
        return np.concatenate(behind), np.concatenate(far)
    decay = np.exp(-np.mean(along.rate, axis=0) * period)
    lags, apart = (np.empty((values.size, decay.size)) for _ in range(2))
    inside = range(decay.size)[along.within]
    for k, d in enumerate(decay):
        drive = lags[:, : len(along.cap)] @ np.asarray(along.cap) if k in inside else values
        lags[:, k] = lfilter([1 - d], [1.0, -d], drive, zi=[d * drive[0]])[0]
        apart[:, k] = np.sqrt(lfilter([1 - d], [1.0, -d], (drive - lags[:, k]) ** 2))
    return lags, apart


def windows(starts: NDArray[np.int64], size: int, overlap: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Windows (w, n) of the nodes of each stretch, -1 for padding, and which of them each window owns."""
    stops = np.append(starts[1:], size)
    index, owner = [], []
    longest = int((stops - starts).max())
    core = min(CORE, longest)
    width = min(core + 2 * overlap, longest)
    for start, stop in zip(starts, stops, strict=True):
        for low in range(start, stop, core):
            high = min(low + core, stop)
            first = max(min(low - overlap, stop - width), start)
            row = np.arange(first, first + width)
            owner.append((row >= low) & (row < high))
            index.append(np.where(row < stop, row, -1))
    return np.array(index), np.array(owner)


def _inflation(surprise: Array, keep: NDArray[np.bool_]) -> Array:
    """Factor on each window's variance: mean square surprise where it is larger than chance makes it, else 1."""
    seen = keep & ~np.isnan(surprise)
    count = np.maximum(seen.sum(axis=1), 1)
    mean_square = (np.where(seen, surprise, 0.0) ** 2).sum(axis=1) / count
    return np.where(mean_square > 1.0 + 3.0 * np.sqrt(2.0 / count), mean_square, 1.0)
