"""Rows brought into order of time: disordered and repeated stamps, clocks that start anew, gaps.

Nothing is done silently: every change is counted in a remark.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from shockrig.files.numbers import counted, in_line, one_or_many
from shockrig.rig.logs.stamps import newest_first

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]

GAP_PERIODS = 60.0  # a hole of so many sampling periods may hide a step and what followed
FEW_ROWS = 5  # of which one or two may bear an absurd stamp
HOLE_PERIODS = 1.5  # and one unit of the stamps: beyond are rows that are missing, not stamps that are rounded
COARSE_STAMPS = 0.2  # of the time between rows: stamps as coarse as that are worth a line
LEAST_UNEVEN = 20  # steps between rows that are longer or shorter than most: fewer may be rows that were lost
LOCAL = 100  # a row that belongs so many rows away arrived late; farther away the clock was set


@dataclass(frozen=True)
class Ordered:
    """Rows in order of time, and the pieces of them that hang together."""

    time_s: Array
    values: Mapping[str, Array]
    pieces: tuple[slice, ...]
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class Even:
    """A stretch of rows that come evenly and bear rounded stamps."""

    rows: int
    period_s: float
    unit_s: float


def _pieces(sessions: Sequence[Array]) -> tuple[list[slice], list[float]]:
    """Rows without a gap between them, and how long the gaps are [s]; of sessions one after the other."""
    pieces: list[slice] = []
    begin = 0
    holes: list[float] = []
    for moments in sessions:
        steps = np.diff(moments)
        period = float(np.median(steps)) if steps.size else 1.0
        cuts = np.flatnonzero(steps > GAP_PERIODS * period) + 1
        holes += list(steps[cuts - 1])
        edges = [0, *map(int, cuts), moments.size]
        pieces += [slice(begin + a, begin + b) for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a]
        begin += moments.size
    return pieces, holes


def in_order(time_s: Array, values: Mapping[str, Array], lines: Sequence[int] | NDArray[Any], stamps: str) -> Ordered:
    """Sort, drop, spread and divide; arguments as `over_time` has them, arrays of shape (n,).

    Where the clock goes back for good (the logger started anew, or was set), the rows after it are a piece of their
    own; `time_s` is in order within each piece only.
    """
    remarks: list[str] = []
    number = np.asarray(lines)
    keep = np.isfinite(time_s)
    if not keep.all():
        absent = np.flatnonzero(~keep)
        remarks.append(
            f"{counted(absent.size, 'row')} without a time left out ({in_line(absent.size, int(number[absent[0]]))})"
        )
    rows = np.flatnonzero(keep)
    if newest_first(time_s[rows]):
        remarks.append("the newest row stands on top: the rows are read from the last to the first")
        rows = rows[::-1]
    absurd = rows[_absurd(time_s[rows])]
    if absurd.size:
        said = one_or_many(absurd.size, "row with an absurd stamp", "rows with absurd stamps")
        remarks.append(f"{said} left out ({in_line(absurd.size, int(number[absurd[0]]))})")
        rows = rows[~np.isin(rows, absurd)]
    sessions = _sessions(time_s, rows)
    parts: list[Index] = []
    spread: list[Array] = []
    late = same = differing = spread_rows = 0
    even: list[Even] = []
    for session in sessions:
        order = session[np.argsort(time_s[session], kind="stable")]
        late += int((np.diff(time_s[session]) < 0).sum())
        part, again = _without_repeats(time_s, values, order)
        same += again
        moments, found = _evenly(time_s[part]) if stamps == "auto" else (time_s[part], [])
        even += [one for one, _ in found]
        moments, n_spread, part, n_differing = _spread_beside(moments, part, [those for _, those in found], stamps)
        spread_rows += n_spread
        differing += n_differing
        parts.append(part)
        spread.append(moments)
    remarks += _said_of_stamps(late, same, differing, spread_rows, even)
    pieces, holes = _pieces(spread)
    if len(sessions) > 1:
        times = "once" if len(sessions) == 2 else f"{len(sessions) - 1} times"
        first = int(number[sessions[1][0]])
        remarks.append(f"the clock starts anew {times} (first in line {first}): what follows is a piece of its own")
    if holes:
        count = "a gap of" if len(holes) == 1 else f"{len(holes)} gaps, the longest of"
        remarks.append(f"{count} {max(holes):.6g} s: a step within one cannot be timed")
    index = parts[0] if len(parts) == 1 else np.concatenate(parts)
    is_all = index.size == time_s.size and bool((index[1:] > index[:-1]).all())
    return Ordered(
        spread[0] if len(spread) == 1 else np.concatenate(spread),
        dict(values) if is_all else {name: column[index] for name, column in values.items()},
        tuple(pieces),
        tuple(remarks),
    )


def _said_of_stamps(late: int, same: int, differing: int, spread_rows: int, even: Sequence[Even]) -> Iterator[str]:
    """What was done to rows whose stamps were out of order, there already, or coarser than the rows."""
    if late:
        was, were = "row was out of order and is", "rows were out of order and are"
        yield f"{one_or_many(late, was, were)} sorted by the stamps"
    if same:
        again = "a stamp and its readings and"
        yield one_or_many(same, f"row repeats {again} is left out", f"rows repeat {again} are left out")
    if differing:
        again = "the stamp of the row before with other readings and"
        yield one_or_many(differing, f"row bears {again} is left out", f"rows bear {again} are left out")
    if spread_rows:
        yield (
            f"{spread_rows} rows share coarse stamps and are spread evenly between them: times are good to half a stamp"
        )
    if even:
        longest = max(even, key=lambda one: one.rows)
        yield (
            f"{sum(one.rows for one in even)} rows bear stamps in steps of {longest.unit_s:.4g} s and come every "
            f'{longest.period_s:.4g} s: times are taken evenly (repeated_stamps = "first" keeps the stamps)'
        )


@np.errstate(over="ignore")  # a stamp may be the largest number there is: its step is then infinite, and absurd
def _absurd(moments: Array) -> Mask:
    """Stamps of one or two rows that lie far from those before and after them, which agree."""
    steps = np.abs(np.diff(moments))
    steps = steps[steps > 0]
    if moments.size < FEW_ROWS or not steps.size:
        return np.zeros(moments.size, dtype=bool)
    usual, widest = np.median(steps, overwrite_input=True), steps.max()
    del steps
    if widest * FEW_ROWS < LOCAL * usual:
        return np.zeros(moments.size, dtype=bool)
    off = median_filter(moments, FEW_ROWS, mode="nearest")
    np.subtract(moments, off, out=off)
    return np.asarray(np.abs(off, out=off) > LOCAL * usual)


def _sessions(time_s: Array, rows: Index) -> list[Index]:
    """Rows divided where the clock goes back and stays back for longer than rows that merely came late explain."""
    moments = time_s[rows]
    back = np.flatnonzero(moments[1:] < moments[:-1]) + 1
    if not back.size:
        return [rows]
    highest = np.maximum.accumulate(moments)
    edges = [0]
    for k in map(int, back):
        so_far = highest[k - 1] if edges[-1] == 0 else moments[edges[-1] : k].max()
        following = moments[k : k + LOCAL]
        if following.size > FEW_ROWS and _goes_over_again(following, so_far):
            edges.append(k)
    return [rows[a:b] for a, b in zip(edges, [*edges[1:], rows.size], strict=True)]


def _goes_over_again(following: Array, so_far: float) -> bool:
    """Whether rows behind a stamp that went back stay before `so_far`, or come to it as they go on: rows that came late
    leap to what follows it."""
    beyond = np.flatnonzero(following > so_far)
    if not beyond.size:
        return True
    first = int(beyond[0])
    steps = np.diff(following[: first + 1])
    return first > FEW_ROWS and bool(steps[-1] <= 2.0 * np.median(steps))


def _without_repeats(time_s: Array, values: Mapping[str, Array], order: Index) -> tuple[Index, int]:
    """Rows that repeat stamp and readings of the one before left out.

    None where rows usually share a stamp and differ in it: it is then coarser than the rows, and a reading that comes
    again under it is one more reading. What is left would be spread over the stamp as if it had come evenly.
    """
    moments = time_s[order]
    shared = moments[1:] == moments[:-1]
    if not shared.any():
        return order, 0
    same = shared.copy()
    for column in values.values():
        ordered = column[order]
        same &= (ordered[1:] == ordered[:-1]) | (np.isnan(ordered[1:]) & np.isnan(ordered[:-1]))
    if (shared & ~same).any() and _usual_rows(np.unique(moments, return_counts=True)[1]) > 1:
        return order, 0
    return order[np.concatenate([[True], ~same])], int(same.sum())


def _usual_rows(count: Index) -> int:
    """How many rows a stamp usually has, of those of each; the first and the last one may be cut off."""
    return int(np.median(count[1:-1])) if count.size > 2 else int(count.max())


def _evenly(moments: Array) -> tuple[Array, list[tuple[Even, slice]]]:
    """Times of rows whose stamps are too coarse for how evenly they come: 0, 1, 2, 3, 5 s of rows every 1.14 s.

    In each stretch without a hole a straight line through (row, stamp) is taken where no stamp is farther from it than
    its unit, and where so many steps differ that rows lost by chance would not follow one.
    """
    steps = np.round(np.diff(moments), 6)
    lengths = np.unique(steps)
    if lengths.size < 2 or np.median(steps) <= 0.0:
        return moments, []
    unit, usual = float(np.diff(lengths).min()), float(np.median(steps))
    whole = np.abs(steps - unit * np.rint(steps / unit)).max() < 1e-6
    if unit < COARSE_STAMPS * usual or not whole:
        return moments, []
    cuts = np.flatnonzero(steps > HOLE_PERIODS * usual + unit) + 1
    times, found = moments.copy(), []
    for begin, end in zip([0, *cuts], [*cuts, moments.size], strict=True):
        if (steps[begin : end - 1] != usual).sum() < LEAST_UNEVEN:
            continue
        row = np.arange(end - begin)
        slope, first = np.polyfit(row, moments[begin:end] - moments[begin], 1)
        line = moments[begin] + first + slope * row
        if np.abs(line - moments[begin:end]).max() <= unit:
            times[begin:end] = line
            found.append((Even(end - begin, float(slope), unit), slice(begin, end)))
    return times, found


def _spread_beside(moments: Array, rows: Index, even: Sequence[slice], stamps: str) -> tuple[Array, int, Index, int]:
    """As `_spread`, of the rows that are in none of the stretches that were taken evenly: what their stamps have of
    rows says nothing of the others'."""
    if not even:
        return _spread(moments, rows, stamps)
    rest = np.ones(moments.size, dtype=bool)
    for stretch in even:
        rest[stretch] = False
    if not rest.any():
        return moments, 0, rows, 0
    spread, n_spread, kept, n_differing = _spread(moments[rest], rows[rest], stamps)
    times, index = np.concatenate([moments[~rest], spread]), np.concatenate([rows[~rest], kept])
    order = np.argsort(times, kind="stable")
    return times[order], n_spread, index[order], n_differing


def _spread(moments: Array, rows: Index, stamps: str) -> tuple[Array, int, Index, int]:
    """Times of rows, how many were spread, the rows that stay, and how many were left out for their stamp."""
    if (moments[1:] > moments[:-1]).all():
        return moments, 0, rows, 0
    distinct, first, count = np.unique(moments, return_index=True, return_counts=True)
    usual = _usual_rows(count)
    if stamps == "first" or (stamps == "auto" and usual < 2):
        return distinct, 0, rows[first], moments.size - distinct.size
    steps = np.diff(distinct)
    width = float(np.median(steps)) if steps.size else 1.0
    span = np.minimum(np.append(steps, width), 1.5 * width)
    share = np.maximum(count, 1)
    place = np.arange(moments.size) - np.repeat(first, count)
    if usual > 1:  # the first stamp is that of a second under way, the last of one cut off
        share[[0, -1]] = np.maximum(share[[0, -1]], usual)
        place[: count[0]] += share[0] - count[0]
    spread = np.repeat(distinct, count) + (place + 0.5) / np.repeat(share, count) * np.repeat(span, count)
    return spread, int((np.repeat(count, count) > 1).sum()), rows, 0
