"""The ways up and down of a carrier: what lies between the turns of its altitude.

Whether it climbs is a matter of how far it gets and not of how fast: a glider in the sea sinks by 0.15 m/s, a drone by
3 m/s. It turns where it comes back by a share of all that it rose and sank.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
LEG_SHARE = 0.15  # of the range of altitudes, that lies between two turns at least
# From the middle of one way to that of another. A boundary layer that warms by 1 to 2 K an hour, as on a clear morning,
# has changed by then by as much as seconds of lag show where one climbs through 0.1 K/m.
AIR_STAYS_S = 1800.0


def least_leg_m(altitude_m: Array, least_m: float = 0.0) -> float:
    """How far apart two turns of a track (n,) are at least, of at least so many metres."""
    return max(LEG_SHARE * float(np.ptp(altitude_m)), least_m)


def legs(altitude_m: Array, least_m: float = 0.0) -> list[tuple[int, int]]:
    """First and last row of each way up or down of a track (n,) without gaps, from its first row to its last turn; two
    of these are `least_leg_m` apart."""
    if not altitude_m.size:
        return []
    least = least_leg_m(altitude_m, least_m)
    turns = [0]
    extreme, way = 0, 0  # last extreme, and which way the track goes since
    heights = altitude_m.tolist()
    for i, height in enumerate(heights):
        off = height - heights[extreme]
        if way * off >= 0 and way != 0:
            extreme = i
        elif abs(off) >= least and i:
            if way != 0 and extreme != turns[-1]:
                turns.append(extreme)
            way, extreme = (1 if off > 0 else -1), i
    turns.append(extreme if extreme > turns[-1] else altitude_m.size - 1)
    return list(zip(turns[:-1], turns[1:], strict=True))


def too_far_apart(apart_s: float) -> str:
    """Why two ways with so much time from the middle of one to that of the other tell nothing of a lag; empty where
    they may."""
    if abs(apart_s) <= AIR_STAYS_S:
        return ""
    return f"{abs(apart_s) / 60.0:.0f} minutes apart, in which the air changes by more than a lag does"


def longest_pair(middle_s: Array, metres: Array) -> tuple[int, int] | None:
    """Which way up and which way down, of ways in order (n,) with their middles in time and how far each climbs, are
    held beside one another: the longest two of those that may tell of a lag, or of all where none do."""
    up, down = np.flatnonzero(metres > 0.0), np.flatnonzero(metres < 0.0)
    if not (up.size and down.size):
        return None
    begin = np.searchsorted(middle_s[down], middle_s[up] - AIR_STAYS_S)
    end = np.searchsorted(middle_s[down], middle_s[up] + AIR_STAYS_S, side="right")
    best, pair = 0.0, (int(up[np.argmax(metres[up])]), int(down[np.argmin(metres[down])]))
    for one, first, last in zip(up.tolist(), begin.tolist(), end.tolist(), strict=True):
        if first < last:
            other = int(down[first + np.argmin(metres[down[first:last]])])
            if metres[one] - metres[other] > best:
                best, pair = float(metres[one] - metres[other]), (one, other)
    return pair


def ways(altitude_m: Array) -> tuple[Mask, Mask]:
    """Rows (n,) of all ways up, and of all ways down, of a track that may have gaps; none is in both."""
    up, down = np.zeros(altitude_m.shape, dtype=bool), np.zeros(altitude_m.shape, dtype=bool)
    rows = np.flatnonzero(np.isfinite(altitude_m))
    found = legs(altitude_m[rows])
    for number, (first, last) in enumerate(found, 1):
        # what is behind the last turn does not get far enough to be a way of its own
        behind = rows.size if number == len(found) else last
        way = up if altitude_m[rows[last]] >= altitude_m[rows[first]] else down
        way[rows[first:behind]] = True
    return up, down
