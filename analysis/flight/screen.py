"""Which samples of a flight to believe: times that run forward, readings that are new and possible.

A reading is implausible outside what its quantity can be, or where it stands alone against the median around it;
it is repeated where it equals the one before although the noise is wider than the resolution; a repeat is used all
the same where the resolution explains it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from shockrig.files.ranges import Range

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MEDIAN_WIDTH = 11  # a burst of up to 5 absurd samples in a row is seen
LONE_SIGMAS = 10.0
LONGEST_GAP_S = 10.0  # without any row: more may be a step of the clock
GAP_PERIODS = 10.0  # or so many periods, in a slow log
FEWEST_ROWS = 6  # that go on from a step of the clock; fewer are out of place
LATEST_S = 1e13  # since 1970 it is 2e9 s; beyond this a double's steps are no longer milliseconds


@dataclass(frozen=True)
class Screened:
    """Masks (n,): readings to use, missing ones, repeats, absurd ones; `resolution` of the log in the channel's
    unit."""

    usable: Mask
    missing: Mask
    repeated: Mask
    implausible: Mask
    resolution: float


@dataclass(frozen=True)
class Clock:
    """A log's time put in order.

    Attributes
    ----------
    good : ndarray (n,)
        Rows whose time can be believed.
    time_s : ndarray (m,)
        Of those rows, running forward: a step of the clock has become a gap across which nothing is known.
    steps : tuple of (row, seconds)
        Where the clock steps back, or ahead by more than a gap that readings are bridged over, and how far.
    """

    good: Mask
    time_s: Array
    steps: tuple[tuple[int, float], ...]


def clock(time_s: Array, part_s: float) -> Clock:
    """Put a log's time (n,) in order; stretches that a step parts are set `part_s` apart.

    A few rows out of place (a lone jump and back) are left out; where the clock steps and goes on from there, the rows
    after it are as good as those before, but how much time lies between is not known.
    """
    good = np.abs(time_s) < LATEST_S
    while True:
        rows = np.flatnonzero(good)
        if rows.size < 2:
            return Clock(good, time_s[rows], ())
        ahead = np.diff(time_s[rows])
        usual = ahead[ahead > 0]
        longest = max(LONGEST_GAP_S, GAP_PERIODS * float(np.median(usual))) if usual.size else LONGEST_GAP_S
        if (stray := _out_of_place(time_s[rows], longest)).size:
            good[rows[stray]] = False
            continue
        parting = (ahead < 0) | (ahead > longest)
        bounds = np.concatenate([[0], np.flatnonzero(parting) + 1, [rows.size]])
        sizes = np.diff(bounds)
        short = np.flatnonzero(sizes < FEWEST_ROWS)
        # rows out of place go one stretch at a time: what is left may then run on
        astray = [i for i in short.tolist() if sizes.size > 1 and not _fits(time_s[rows], bounds, i)]
        if not astray:
            break
        i = min(astray, key=lambda i: sizes[i])
        good[rows[bounds[i] : bounds[i + 1]]] = False
    steps = tuple((int(rows[k]), float(ahead[k - 1])) for k in bounds[1:-1])
    even = np.concatenate([[0.0], np.where(parting, part_s, ahead)])
    return Clock(good, time_s[rows[0]] + np.cumsum(even) if steps else time_s[rows], steps)


def _out_of_place(time_s: Array, longest: float) -> NDArray[np.int64]:
    """Rows, a few in a row, without which time does not run back: ahead of what follows, or behind what came before."""
    stray: list[int] = []
    for i in (np.flatnonzero(np.diff(time_s) < 0) + 1).tolist():
        if stray and i <= stray[-1] + FEWEST_ROWS:
            continue  # looked at again when those are out
        for m in range(1, FEWEST_ROWS):
            if i + m < time_s.size and 0 <= time_s[i + m] - time_s[i - 1] <= longest:
                stray.extend(range(i, i + m))
                break
            if i - m > 0 and 0 <= time_s[i] - time_s[i - m - 1] <= longest:
                stray.extend(range(i - m, i))
                break
    return np.array(stray, dtype=np.int64)


def _fits(time_s: Array, bounds: NDArray[np.int64], i: int) -> bool:
    """Whether a short stretch lies in time between its neighbours."""
    before = time_s[bounds[i] - 1] if i else -np.inf
    after = time_s[bounds[i + 1]] if bounds[i + 1] < time_s.size else np.inf
    return bool(before <= time_s[bounds[i]] and time_s[bounds[i + 1] - 1] <= after)


def screen(
    time_s: Array,
    reading: Array,
    possible: Range,
    noise: float,
    *,
    limit: float | None = None,
    stale: Mask | None = None,
) -> Screened:
    """Judge one channel's readings, rows in order.

    `possible` is what a reading can be; `limit` is a ceiling at which the sensor clips; `stale` marks rows (n,)
    that are known to repeat the one before.
    """
    missing = ~np.isfinite(reading)
    implausible = ~missing & ((reading < possible.low) | (reading > possible.high))
    believed = ~(missing | implausible)
    rows = np.flatnonzero(believed)
    resolution = _resolution(reading[rows])
    if rows.size >= 3:
        around = reading[rows]
        off = around - median_filter(around, min(MEDIAN_WIDTH, rows.size), mode="nearest")
        usual = 1.4826 * float(np.median(np.abs(off)))
        lone = np.abs(off) > LONE_SIGMAS * np.hypot(max(noise, usual), resolution)
        # the turning point of a fast change is off the median too, but its neighbours share it
        step = np.abs(np.diff(around, prepend=around[0]))
        jump = np.maximum(step, np.append(step[1:], 0.0))
        lone &= jump > 0.5 * np.abs(off)
        implausible[rows[lone]] = True
    believed &= ~implausible
    repeated = np.zeros(reading.shape, dtype=bool)
    rows = np.flatnonzero(believed)
    same_time = np.diff(time_s[rows], prepend=-np.inf) <= 0
    same_value = np.diff(reading[rows], prepend=np.inf) == 0
    # where the resolution is coarser than the noise, equal neighbours are the rule and each tells something
    repeated[rows] = same_time | (same_value & (resolution < 1.5 * noise))
    usable = believed & ~(repeated & ~_by_chance(reading, rows, same_time, same_value, resolution))
    if stale is not None:
        repeated |= stale & believed
        usable &= ~stale
    if limit is not None:
        usable &= reading < limit - 0.5 * resolution
    return Screened(usable, missing, repeated, implausible, resolution)


def _by_chance(reading: Array, rows: NDArray[np.int64], same_time: Mask, same_value: Mask, resolution: float) -> Mask:
    """Single repeats that the resolution explains: two different readings fall on one step as often as there are
    repeats.

    Such a reading tells as much as any other; leaving it out would throw away a tenth of an honest log.
    """
    allowed = np.zeros(reading.shape, dtype=bool)
    changes = np.diff(reading[rows])[~same_value[1:]]
    if changes.size < 8 or resolution == 0.0:
        return allowed
    width = 1.4826 * float(np.median(np.abs(changes)))
    expected = min(resolution / (np.sqrt(2 * np.pi) * width), 1.0) if width > 0 else 1.0
    if expected >= 0.5 * np.mean(same_value):
        again = same_value & np.append(False, same_value[:-1])
        allowed[rows[same_value & ~again & ~same_time]] = True
    return allowed


def _resolution(values: Array) -> float:
    """Smallest step between the values that occur; 0 where there is but one."""
    steps = np.diff(np.unique(np.round(values[:20000], 9)))
    return float(np.quantile(steps, 0.05)) if steps.size else 0.0
