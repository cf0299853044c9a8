"""A log read by a layout: seconds and values in the campaign's units, in order, in pieces; everything else is counted.

A piece is a stretch without a gap that could hide a step, and without the clock starting anew.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import shown
from shockrig.files.flight_cells import plain_numbers
from shockrig.files.numbers import counted, in_line, one_or_many
from shockrig.files.ranges import RANGES, Range
from shockrig.files.sentinels import CODES, momentary, unread, without_sign
from shockrig.files.spelling import did_you_mean
from shockrig.files.unit_names import UNITS
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.logs.apart import demand_one_sensor
from shockrig.rig.logs.clock_columns import guess_clock
from shockrig.rig.logs.lines import Index, Lines
from shockrig.rig.logs.order import in_order
from shockrig.rig.logs.stamps import NUMBERS, TimeColumns, in_seconds, parsed
from shockrig.rig.logs.text import BEHIND, NO_NUMBER, Layout, Scan, scan, unit_said

Array = NDArray[np.float64]

BLOCK_ROWS = 5_000  # that are read at a time
PLAIN_ROWS = 50_000  # the same, of a log of nothing but numbers
LIMITS = {
    "temperature": RANGES["temperature_c"],
    "humidity": RANGES["humidity_reading_percent"],
    "pressure": RANGES["pressure_hpa"],
    "airflow": RANGES["airflow_m_s"],
    "altitude": Range(-1000.0, 60_000.0, "is it in feet or millimetres"),
    "position": Range(-180.0, 360.0, "is it in degrees and minutes"),
}


class ImpossibleError(BenchError):
    """A column of which hardly any number can be what it is read as; `column` is its name in the log."""

    def __init__(self, message: str, column: str) -> None:
        super().__init__(message)
        self.column = column


@dataclass(frozen=True)
class Column:
    """One column that is wanted: its name in the log, what it measures (a key of `UNITS`), in which unit; `is_stated`
    where a person says which."""

    name: str
    quantity: str
    unit: str
    is_stated: bool = field(default=False, compare=False)


@dataclass(frozen=True)
class Log:
    """A log as recorded: arrays of shape (n,), in order of time.

    `time_s` is on the log's own clock: as the log counts where it counts numbers, from its first stamp
    (`origin_s` since 1970) where it writes dates. `values` are in degC, percent, hPa, m/s; NaN where there is none.
    `pieces` are slices of the rows. `remarks` say what was found odd and what was done, one sentence each. `named` are
    the columns whose unit, as they were read, stands in the log itself.
    """

    path: Path
    clock: TimeColumns
    origin_s: float
    time_s: Array
    values: Mapping[str, Array]
    pieces: tuple[slice, ...]
    remarks: tuple[str, ...]
    named: frozenset[str]

    @property
    def period_s(self) -> float:
        """The usual time between rows."""
        steps = np.diff(self.time_s)
        steps = steps[steps > 0]
        return float(np.median(steps)) if steps.size else 1.0


@dataclass(frozen=True)
class LogRows:
    """A log's rows as they stand in it: as `Log`, and their lines' `numbers` in the file, from 1."""

    path: Path
    clock: TimeColumns
    origin_s: float
    time_s: Array
    values: Mapping[str, Array]
    numbers: Index
    remarks: tuple[str, ...]
    named: frozenset[str]


def read_rows(
    path: Path,
    layout: Layout,
    columns: Sequence[Column],
    *,
    clock: TimeColumns | None = None,
    scanned: Scan | None = None,
) -> LogRows:
    """Read columns of a log.

    Parameters
    ----------
    path : Path
    layout : Layout
        How it is laid out; what is None is found out.
    columns : sequence of Column
    clock : Clock, optional
        Which columns tell the time and how; found out where it is not given.
    scanned : Scan, optional
        The log's lines, where they have been read already.

    Raises
    ------
    BenchError
        A column is not there or holds no values that can be, there is no time, or the rows are of several sensors:
        names file, column, remedy.
    """
    lines = scanned or scan(path, layout)
    clock = clock or guess_clock(lines.names, lines.sample(), lines.units)
    if clock is None:
        has = ", ".join(lines.names)
        raise BenchError(
            f'{shown(path)}: no column of times found (it has: {has}); name it in the map, [log] time = "...", or '
            "where none tells the time, the seconds from row to row, every_s = 1.0"
        )
    if clock.is_of_day or any(_names_unit(lines, name) for name in clock.columns):
        clock = replace(clock, known="named")
    for name in (*clock.columns, *(column.name for column in columns)):
        if name not in lines.names:
            at = f", line {lines.header_line}" if lines.header_line else ""
            raise BenchError(f"{shown(path)}{at}: no column {name!r}{did_you_mean(name, lines.names)}")
    columns = list({column.name: column for column in columns}.values())
    stamps_read, read = _read_plain(lines, layout, columns, clock) or _read_columns(lines, layout, columns, clock)
    remarks = [
        _sentence(count, f"line {reason.replace('that repeat ', 'that repeats ')}", f"lines {reason}", where)
        for reason, (count, where) in lines.odd.items()
    ]
    if lines.behind:
        remarks.append(f"readings that stand behind their names are read as columns: {', '.join(lines.behind)}")
    if lines.unheld:
        remarks.append(
            f"rows hold {len(lines.names)} cells, too few for the line of names: the first of these are taken for "
            f"them, without {', '.join(map(repr, lines.unheld))}; if others lack, a map with header_line = 0 numbers "
            "the columns"
        )
    where = f"{shown(path)}, column {', '.join(clock.columns)}"

    def stamp(row: int) -> str:
        return " ".join(lines.cell(row, name) for name in clock.columns)

    time_s, origin_s = in_seconds(clock, stamps_read, stamp, len(lines.rows), where)
    values: dict[str, Array] = {}
    some = lines.sample()
    places = {name: place for place, name in enumerate(lines.names)}
    named = frozenset(one.name for one in columns if unit_said(lines, places[one.name], some) == one.unit)
    for column in columns:
        values[column.name], said = _checked(read.pop(column.name), column, lines, column.name in named)
        remarks += said
    demand_one_sensor(lines, clock, time_s, values)
    return LogRows(path, clock, origin_s, time_s, values, lines.numbers, tuple(remarks), named)


def over_time(rows: LogRows, stamps: str = "auto") -> Log:
    """A log's rows in order of time.

    `stamps` is what is done with readings that differ and bear the same stamp: "spread" over the time to the next
    stamp, "first" (keep the first), or "auto": spread where the stamps are coarser than the readings. Where they are
    merely too coarse for how evenly rows come, "auto" takes times on a line, and the others the stamps.
    """
    ordered = in_order(rows.time_s, rows.values, rows.numbers, stamps)
    remarks = (*rows.remarks, *ordered.remarks)
    time_s, values, pieces = ordered.time_s, ordered.values, ordered.pieces
    return Log(rows.path, rows.clock, rows.origin_s, time_s, values, pieces, remarks, rows.named)


@dataclass
class _Read:
    """A column as far as it is read: numbers in the campaign's unit by blocks, NaN where there is none, of the cells
    that hold something else how many there are and which row has the first."""

    blocks: list[Array] = field(default_factory=list)
    wrong: int = 0
    first_wrong: int = 0


def _read_plain(
    lines: Scan, layout: Layout, columns: Sequence[Column], clock: TimeColumns
) -> tuple[list[NDArray[Any]], dict[str, _Read]] | None:
    """As `_read_columns`, of a log of nothing but numbers between commas; None of any other."""
    if lines.separator != "," or lines.decimal != "." or clock.format != NUMBERS or len(clock.columns) > 1:
        return None
    read = {column.name: _Read() for column in columns}
    stamps: list[NDArray[Any]] = []
    places = [lines.names.index(name) for name in (*clock.columns, *(column.name for column in columns))]
    for first in range(0, len(lines.rows), PLAIN_ROWS):
        rows = lines.rows[first : first + PLAIN_ROWS]
        text = rows.text()
        cells = None if text is None else plain_numbers(text, len(lines.names), places, len(rows))
        if cells is None:
            return None
        if clock.columns:
            stamps.append(cells[0].copy())
        for column, numbers in zip(columns, cells[len(clock.columns) :], strict=True):
            read[column.name].blocks.append(_numbers(numbers, column, layout, lines.decimal)[0])
    return stamps, read


def _read_columns(
    lines: Scan, layout: Layout, columns: Sequence[Column], clock: TimeColumns
) -> tuple[list[NDArray[Any]], dict[str, _Read]]:
    """Stamps and numbers of all rows, a block of them at a time: their text takes many times the room."""
    wanted = list(dict.fromkeys([*clock.columns, *(column.name for column in columns)]))
    read = {column.name: _Read() for column in columns}
    stamps: list[NDArray[Any]] = []
    for first in range(0, len(lines.rows), BLOCK_ROWS):
        cells = _read_cells(lines, lines.rows[first : first + BLOCK_ROWS], layout, wanted, clock)
        stamps.append(parsed(clock, cells))
        for column in columns:
            numbers, wrong = _numbers(cells[column.name], column, layout, lines.decimal)
            mine = read[column.name]
            mine.blocks.append(numbers)
            if wrong.size and not mine.wrong:
                mine.first_wrong = first + int(wrong[0])
            mine.wrong += wrong.size
    return stamps, read


def _read_cells(
    lines: Scan, rows: Lines, layout: Layout, wanted: Sequence[str], clock: TimeColumns
) -> dict[str, NDArray[np.object_]]:
    """The wanted columns of some rows; times that are not plain numbers stay text (a date such as 20240523 is no
    number)."""
    import pandas as pd

    places = {lines.names.index(name): name for name in wanted}
    textual = [lines.names.index(name) for name in clock.columns if clock.format != NUMBERS]
    words = [form for word in (*NO_NUMBER, *layout.missing) for form in (word, word.upper(), word.title())]
    text = "\n".join(rows)
    frame = pd.DataFrame()
    with suppress(pd.errors.ParserError):
        frame = pd.read_csv(
            io.StringIO(BEHIND.sub("", text) if lines.separator == " " else text),
            header=None,
            names=list(range(len(lines.names))),
            sep=r"\s+" if lines.separator == " " else lines.separator,
            decimal=lines.decimal,
            usecols=list(places),
            index_col=False,
            skipinitialspace=True,
            skip_blank_lines=False,
            keep_default_na=False,
            na_values=list(dict.fromkeys(words)),
            dtype=dict.fromkeys(textual, "str"),
            low_memory=False,
        )
    if len(frame) != len(rows):  # a quotation mark that nobody closed: line by line
        table = np.array(lines.cells(rows), dtype=object)
        return {name: table[:, place] for place, name in places.items()}
    return {name: frame[place].to_numpy() for place, name in places.items()}


def _numbers(
    cells: NDArray[np.object_], column: Column, layout: Layout, decimal: str
) -> tuple[Array, NDArray[np.intp]]:
    """Cells of a column in the campaign's unit, NaN where they hold none, and which of them hold anything else."""
    wrong = np.zeros(0, dtype=np.intp)
    if cells.dtype.kind in "fiu":
        numbers = cells.astype(float)
    else:
        import pandas as pd

        texts = pd.Series(cells, dtype="str").str.strip()
        empty = texts.isna() | texts.str.lower().isin(NO_NUMBER)
        # Some loggers write the unit into every cell.
        bare = texts.str.extract(r"^([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*(?:[°º*%a-zA-Z/]{0,6})$")[0]
        if decimal == ",":
            bare = bare.str.replace(",", ".", regex=False)
        numbers = pd.to_numeric(bare, errors="coerce").to_numpy(dtype=float, copy=True)
        wrong = np.flatnonzero(np.isnan(numbers) & ~empty.to_numpy())
    for word in layout.missing:
        if re.fullmatch(r"[+-]?[\d.]+([eE][+-]?\d+)?", word):
            numbers[numbers == float(word)] = np.nan
    scale, offset = UNITS[column.quantity][column.unit]
    return (scale * numbers + offset if (scale, offset) != (1.0, 0.0) else numbers), wrong


def _checked(read: _Read, column: Column, lines: Scan, named: bool) -> tuple[Array, list[str]]:
    """A column's numbers, NaN also for those that cannot be, and what was left out; where the log has `named` their
    unit they are no slip of it."""
    where = f"{shown(lines.path)}, column {column.name!r}"
    said: list[str] = []
    numbers = np.concatenate(read.blocks)
    read.blocks.clear()
    if read.wrong > 0.5 * numbers.size:
        raise BenchError(
            f"{shown(lines.path)}, line {lines.numbers[read.first_wrong]}, column {column.name!r}: "
            f"{lines.cell(read.first_wrong, column.name)!r} is not a number, nor are most; name another column in the "
            "map"
        )
    if read.wrong:
        one, many = f"cell of {column.name!r} that is no number", f"cells of {column.name!r} that are no numbers"
        said.append(_sentence(read.wrong, one, many, lines.numbers[read.first_wrong]))
    missing = int(np.isnan(numbers).sum()) - read.wrong
    if missing:
        of = f"of {column.name!r}"
        said.append(one_or_many(missing, f"value {of} is missing", f"values {of} are missing"))
    limits = LIMITS[column.quantity]
    if column.quantity == "temperature" and column.unit == "degC":
        span, rows = without_sign(numbers, limits)
        if rows.any():
            numbers[rows] -= span
            readings = counted(int(np.count_nonzero(rows)), "reading")
            said.append(f"{readings} of {column.name!r} below 0 without a sign: {span:g} are taken off")
    absurd = np.flatnonzero((numbers < limits.low) | (numbers > limits.high))
    # Who states degC may have an oven; nobody states kelvin for what is colder than any air.
    named |= column.is_stated and not (numbers < limits.low).any()
    if column.quantity == "temperature" and (named or absurd.size < 0.9 * np.isfinite(numbers).sum()):
        absurd = np.flatnonzero(unread(numbers, limits, RANGES["temperature_reading_c"]))
    if absurd.size and absurd.size >= 0.9 * np.isfinite(numbers).sum():
        key = f"{column.quantity}_unit"
        raise ImpossibleError(
            f"{where}: {limits.refusal(float(numbers[absurd[0]]))} read in {column.unit}, like most of it; "
            f"state the right {key} in the map ({', '.join(UNITS[column.quantity])})",
            column.name,
        )
    if absurd.size:
        what = f"of {column.name!r}"
        one, many = f"impossible reading {what}", f"impossible readings {what}"
        said.append(_sentence(absurd.size, one, many, lines.numbers[absurd[0]]))
        numbers[absurd] = np.nan
    if column.quantity in ("temperature", "humidity"):
        for code, rows in momentary(column.quantity, numbers, limits.low, limits.high).items():
            what = f"of {column.name!r} that {{}} {code:g} ({CODES[column.quantity][code]})"
            one, many = f"reading {what.format('is')}", f"readings {what.format('are')}"
            said.append(_sentence(int(rows.sum()), one, many, lines.numbers[np.flatnonzero(rows)[0]]))
            numbers[rows] = np.nan
    if np.isfinite(numbers).sum() < 2:
        raise BenchError(f"{where}: holds no readings; name another column in the map, or leave this one out")
    return numbers, said


def _names_unit(lines: Scan, name: str) -> bool:
    """Whether a log names the unit of a column of times, in its name or under it."""
    return name in lines.names and unit_said(lines, lines.names.index(name)) in UNITS["time"]


def _sentence(count: int, one: str, many: str, line: int) -> str:
    return f"{one_or_many(count, one, many)} left out ({in_line(count, line)})"
