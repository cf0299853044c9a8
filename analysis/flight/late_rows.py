"""Rows of a log that stand later than their times say: packets that came late, and not a clock that was set back; or
all of them, in a log that begins with its last row.

A late row fills a hole: no other row is near it in time, and few rows that follow one another in the log do so in time
as well. After a clock was set back the times of before come once more, or many rows go on from there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shockrig.files.flight import Flight

Array = NDArray[np.float64]
Index = NDArray[np.int64]
NEAR = 0.5  # of the usual time between rows: a row that is nearer to another fills no hole
FEW_TOGETHER = 12  # rows that follow one another in the log and in time; more go on from where a clock was set to
NEARLY_ALL = 0.9  # of the late rows, or of all steps
OFTEN = 10  # that rows go back in time: a clock is seldom set so often
SORTED = (
    "rows stand out of order by their times, as packets that came late: they are taken by time, and written where they "
    "stood"
)
BACKWARDS = "the rows run backwards in time: they are taken by time, and written where they stood"
UNSURE_ORDER = (
    "time_s: rows go back in time in many places, and nothing tells whether they are out of order or the clock was "
    "set: if they are, sort the log by its times"
)


def taken_by_time(flight: Flight) -> tuple[Flight, Index | None, list[str]]:
    """A flight with its rows in the order of their times, that order (n,) where some came late, and what is said."""
    order, said = by_time(flight.time_s)
    return flight if order is None else flight.at(order), order, said


def by_time(time_s: Array) -> tuple[Index | None, list[str]]:
    """The rows (n,) of a log in the order of their times, where some came late, else None; and what is to be said."""
    known = np.flatnonzero(np.isfinite(time_s))
    times = time_s[known]
    back = int(np.count_nonzero(np.diff(times) < 0.0))
    if not back:
        return None, []
    if back > NEARLY_ALL * np.count_nonzero(np.diff(times)):  # as a dropsonde's, from the ground up
        order, said = by_time(time_s[::-1])
        turned = np.arange(time_s.size)[::-1]
        return turned if order is None else turned[order], [BACKWARDS, *said]
    late, ahead = times < np.maximum.accumulate(times), np.diff(times)
    stamps, first, stamp = np.unique(times, return_index=True, return_inverse=True)
    again = np.ones(times.size, dtype=bool)  # a packet that was heard twice, or a time that a clock shows once more
    again[first] = False
    apart = np.diff(stamps, prepend=-np.inf, append=np.inf)
    usual = float(np.quantile(ahead[ahead > 0.0], 0.25)) if (ahead > 0.0).any() else np.inf
    alone = (np.minimum(apart[:-1], apart[1:]) >= NEAR * usual)[stamp]
    order = np.argsort(times, kind="stable")
    parts = np.cumsum(np.diff(np.argsort(order), prepend=-2) != 1) - 1  # rows that follow one another in time as well
    few = (np.bincount(parts) < FEW_TOGETHER)[parts]
    fills = np.count_nonzero(late & alone & few & ~again)
    if fills < NEARLY_ALL * np.count_nonzero(late & ~again) or 2 * fills < np.count_nonzero(late):
        return None, [UNSURE_ORDER] if back >= OFTEN else []
    rows = np.arange(time_s.size)
    rows[known] = known[order]
    return rows, [SORTED]
