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


def ordered(time_s: Array) -> Mask:
    """True for the rows whose time is finite and runs forward; single jumps ahead and rows out of order are left
    out."""
    good = np.abs(time_s) < LATEST_S
    while True:
        rows = np.flatnonzero(good)
        time = time_s[rows]
        if rows.size < 2 or np.all(np.diff(time) >= 0):
            return good
        # a row is out of place on the side that fewer rows agree with: ahead of later ones or behind earlier ones
        ahead = time > _smallest_after(time)
        behind = time < np.maximum.accumulate(time)
        lone_ahead = ahead & (_later_below(time) >= 3)
        good[rows[lone_ahead if lone_ahead.any() else behind]] = False


def _smallest_after(time: Array) -> Array:
    rest = np.append(time[1:], np.inf)
    return np.minimum.accumulate(rest[::-1])[::-1]


def _later_below(time: Array, reach: int = 6) -> Array:
    """How many of the next `reach` rows are earlier than each row."""
    padded = np.concatenate([time, np.full(reach, np.inf)])
    return np.sum([padded[i : i + time.size] < time for i in range(1, reach + 1)], axis=0, dtype=float)


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
    """Smallest step between the values that occur; 0 where there are too few."""
    steps = np.diff(np.unique(np.round(values[:20000], 9)))
    return float(np.quantile(steps, 0.05)) if steps.size > 3 else 0.0
