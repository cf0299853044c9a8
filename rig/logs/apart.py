"""Whether rows of a log are of several sensors, one a row, and which column says whose: as databases export them.

Read as one sensor's, the readings of two that stand in turn are noise, or one that is as fast as neither. A sensor
reads once at a time: rows that bear one stamp, or stamps that were there already, are of another.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import shown
from shockrig.files.named_readings import SAMPLE_LINES
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.logs.stamps import TimeColumns, newest_first
from shockrig.rig.logs.text import Scan, is_value

Array = NDArray[np.float64]

LEAST_ROWS = 5  # of each sensor, in the mean: what differs more often tells rows apart, and not sensors
AGAIN = 0.1  # of the rows bear a stamp that was there, or one before: fewer may have come late
LEFT = 0.02  # of these may still do so among the rows of one sensor, ...
LEFT_DATED = 0.5  # ... and of dates, which no restart takes back: somebody put files together in another order
IN_TURN = 0.5  # of rows are of another sensor than the row before, where every row has a stamp of its own
JUMPS = 3.0  # times what a sensor's readings do from one to the next, that rows of several do
_WHOSE = re.compile(
    r"(^|[^a-z])(sensor|probe|device|dev|node|logger|station|channel|chan|entity|mac|serial|address|addr|location|site)"
    r"([^a-z]|s?$|id|name|no|nr|number)",
    re.I,
)


def says_whose(name: str) -> bool:
    """Whether a column is called by a word for a sensor or its place."""
    return _WHOSE.search(name) is not None


class SeveralError(BenchError):
    """Rows of several sensors: the `column` that says whose, and what stands in it."""

    def __init__(self, message: str, column: str, values: tuple[str, ...]) -> None:
        super().__init__(message)
        self.column, self.values = column, values


def demand_one_sensor(lines: Scan, clock: TimeColumns, time_s: Array, values: Mapping[str, Array]) -> None:
    """Refuse rows that are of several sensors; `values` are the columns that are read, arrays of shape (n,).

    Raises
    ------
    SeveralError
        Names the column that says whose a row is, and the remedy.
    """
    time_s = np.where(_came_twice(time_s, values), np.nan, time_s)
    moments = time_s[np.isfinite(time_s)]
    if clock.every_s is not None or moments.size < 2 * LEAST_ROWS:
        return
    forth = -1.0 if newest_first(moments) else 1.0
    again = int((forth * np.diff(moments) <= 0.0).sum())
    some = lines.sample()
    by_itself: dict[str, int] = {}
    in_part: dict[str, NDArray[np.intp]] = {}
    for place, name in enumerate(lines.names):
        cells = [row[place] for row in some]
        if name in clock.columns or name in values or not 1 < len(set(cells)) <= len(cells) / LEAST_ROWS:
            continue
        is_called, is_word = says_whose(name), not any(map(is_value, cells))
        if not (is_called or is_word or all(map(str.isdecimal, cells))):
            continue
        may_follow = bool(again) and (is_called or is_word)  # one sensor's rows after the other's
        if not may_follow and np.mean([a != b for a, b in pairwise(cells[:SAMPLE_LINES])]) < IN_TURN:
            continue
        whose = _codes(lines, place)
        if again and not _goes_on_apart(whose, forth * time_s, again, clock):
            in_part |= {name: whose} if may_follow else {}
            continue
        if may_follow or _take_turns(whose) and (is_called or _jumps(whose, values)):
            by_itself[name] = _left(whose, forth * time_s)
    if by_itself:
        raise _several(lines, min(by_itself, key=lambda name: by_itself[name]), some)
    for (one, first), (other, second) in combinations(in_part.items(), 2):  # what of which sensor, in two columns
        if _goes_on_apart(first * (second.max() + 1) + second, forth * time_s, again, clock):
            name = min(one, other, key=lambda name: _left(in_part[name], forth * time_s))
            raise _several(lines, name, some)


def _several(lines: Scan, name: str, rows: Sequence[Sequence[str]]) -> SeveralError:
    said = tuple(dict.fromkeys(row[lines.names.index(name)] for row in rows))
    return SeveralError(
        f"{shown(lines.path)}: its rows are of {len(said)} sensors, told apart by the column {name!r} "
        f"({', '.join(said[:5])}{', ...' if len(said) > 5 else ''}); state one in the map, [log] only = "
        f'{{ "{name}" = "{said[0]}" }}',
        name,
        said,
    )


def _came_twice(time_s: Array, values: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Rows with the stamp and the readings of the row before: a message that two stations heard is of one sensor."""
    twice = np.append(False, np.diff(time_s) == 0.0)
    for value in values.values():
        twice[1:] &= (value[1:] == value[:-1]) | np.isnan(value[1:]) & np.isnan(value[:-1])
    return twice


def _codes(lines: Scan, place: int) -> NDArray[np.intp]:
    """Whose each row is, as a number."""
    codes: dict[str, int] = {}
    found = (codes.setdefault(lines.cells([row])[0][place], len(codes)) for row in lines.rows)
    return np.fromiter(found, dtype=np.intp, count=len(lines.rows))


def _take_turns(whose: NDArray[np.intp]) -> bool:
    """Whether most of the others come before a sensor comes again: what wanders, as an output, does not so."""
    order = np.argsort(whose, kind="stable")
    rows_between = np.diff(order)[np.diff(whose[order]) == 0]
    return bool(np.median(rows_between) > IN_TURN * (whose.max() + 1))


def _goes_on_apart(whose: NDArray[np.intp], time_s: Array, again: int, clock: TimeColumns) -> bool:
    """Whether rows whose stamps do not go on are of another sensor than the row before, and those of each go on.

    A clock that counts anew for each says nothing of when that was; dates that were there are another's.
    """
    rows = np.isfinite(time_s).sum()
    left = _left(whose, time_s)
    return left <= LEFT_DATED * again if clock.is_dated else left <= LEFT * again and bool(again >= AGAIN * rows)


def _left(whose: NDArray[np.intp], time_s: Array) -> int:
    """How many rows have a stamp that does not go on from that of the sensor's row before."""
    there = np.isfinite(time_s)
    whose, moments = whose[there], time_s[there]
    order = np.argsort(whose, kind="stable")
    return int((np.diff(moments[order])[np.diff(whose[order]) == 0] <= 0.0).sum())


def _jumps(whose: NDArray[np.intp], values: Mapping[str, Array]) -> bool:
    """Whether a reading goes from row to row by more than from one to the next of the same sensor.

    Where these never differ, the column is what was read, in other words: a resistance.
    """
    order = np.argsort(whose, kind="stable")
    same = np.diff(whose[order]) == 0
    moves = [(np.abs(np.diff(value)), np.abs(np.diff(value[order])[same])) for value in values.values()]
    return any(np.nanmedian(row) > JUMPS * np.nanmedian(own) for row, own in moves if (own > 0.0).any())
