"""A log read by a layout: seconds and values in the campaign's units, in order, in pieces; everything else is counted.

A piece is a stretch without a gap that could hide a step, and without the clock starting anew.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import shown
from shockrig.files.ranges import RANGES, Range
from shockrig.rig.errors import BenchError
from shockrig.rig.keys import nearest
from shockrig.rig.logs.clocks import guess_clock
from shockrig.rig.logs.order import in_order
from shockrig.rig.logs.stamps import NUMBERS, Clock, read_stamps
from shockrig.rig.logs.text import BEHIND, MISSING, Layout, Scan, scan
from shockrig.rig.logs.units import UNITS

Array = NDArray[np.float64]

LIMITS = {
    "temperature": RANGES["temperature_c"],
    "humidity": RANGES["humidity_reading_percent"],
    "pressure": RANGES["pressure_hpa"],
    "airflow": RANGES["airflow_m_s"],
    "altitude": Range(-1000.0, 60_000.0, "is it in feet or millimetres"),
    "position": Range(-180.0, 360.0, "is it in degrees and minutes"),
}


@dataclass(frozen=True)
class Column:
    """One column that is wanted: its name in the log, what it measures (a key of `UNITS`), in which unit."""

    name: str
    quantity: str
    unit: str


@dataclass(frozen=True)
class Log:
    """A log as recorded: arrays of shape (n,), in order of time.

    `time_s` is on the log's own clock: as the log counts where it counts numbers, from its first stamp
    (`origin_s` since 1970) where it writes dates. `values` are in degC, percent, hPa, m/s; NaN where there is none.
    `pieces` are slices of the rows. `remarks` say what was found odd and what was done, one sentence each.
    """

    path: Path
    clock: Clock
    origin_s: float
    time_s: Array
    values: Mapping[str, Array]
    pieces: tuple[slice, ...]
    remarks: tuple[str, ...]
    scan: Scan

    @property
    def period_s(self) -> float:
        """The usual time between rows."""
        steps = np.diff(self.time_s)
        steps = steps[steps > 0]
        return float(np.median(steps)) if steps.size else 1.0


def read_log(
    path: Path,
    layout: Layout,
    columns: Sequence[Column],
    *,
    clock: Clock | None = None,
    scanned: Scan | None = None,
    stamps: str = "auto",
) -> Log:
    """Read columns of a log over time.

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
    stamps : str
        What is done with readings that differ and bear the same stamp: "spread" over the time to the next stamp,
        "first" (keep the first), or "auto": spread where the stamps are coarser than the readings. Where they are
        merely too coarse for how evenly rows come, "auto" takes times on a line, and the others the stamps.

    Raises
    ------
    BenchError
        A column is not there or holds no values that can be, or there is no time: names file, column, remedy.
    """
    lines = scanned or scan(path, layout)
    clock = clock or guess_clock(lines.names, lines.sample(), lines.units)
    if clock is None:
        has = ", ".join(lines.names)
        raise BenchError(
            f'{shown(path)}: no column of times found (it has: {has}); name it in the map, [log] time = "...", or '
            "where none tells the time, the seconds from row to row, every_s = 1.0"
        )
    for name in (*clock.columns, *(column.name for column in columns)):
        if name not in lines.names:
            at = f", line {lines.header_line}" if lines.header_line else ""
            raise BenchError(f"{shown(path)}{at}: no column {name!r}{nearest(name, lines.names)}")
    wanted = list(dict.fromkeys([*clock.columns, *(column.name for column in columns)]))
    cells = _read_cells(lines, layout, wanted, clock)
    remarks = [_sentence(count, f"lines {reason}", where) for reason, (count, where) in lines.odd.items()]
    where = f"{shown(path)}, column {', '.join(clock.columns)}"
    time_s, origin_s = read_stamps(clock, cells, len(lines.rows), where)
    values: dict[str, Array] = {}
    for column in columns:
        values[column.name], said = _numbers(cells[column.name], column, layout, lines)
        remarks += said
    ordered = in_order(time_s, values, lines.numbers, stamps)
    return Log(
        path, clock, origin_s, ordered.time_s, ordered.values, ordered.pieces, (*remarks, *ordered.remarks), lines
    )


def _read_cells(lines: Scan, layout: Layout, wanted: Sequence[str], clock: Clock) -> dict[str, NDArray[np.object_]]:
    """The wanted columns; times that are not plain numbers stay text (a date such as 20240523 is no number)."""
    import pandas as pd

    places = {lines.names.index(name): name for name in wanted}
    textual = [lines.names.index(name) for name in clock.columns if clock.format != NUMBERS]
    words = [form for word in (*MISSING, *layout.missing) for form in (word, word.upper(), word.title())]
    text = "\n".join(lines.rows)
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
    return {name: frame[place].to_numpy() for place, name in places.items()}


def _numbers(cells: NDArray[np.object_], column: Column, layout: Layout, lines: Scan) -> tuple[Array, list[str]]:
    """A column in the campaign's unit; NaN where it holds no value or one that cannot be, and what was left out."""
    import pandas as pd

    where = f"{shown(lines.path)}, column {column.name!r}"
    said: list[str] = []
    unread = 0
    if cells.dtype.kind in "fiu":
        numbers = cells.astype(float)
    else:
        texts = pd.Series(cells, dtype="str").str.strip()
        empty = texts.isna() | texts.str.lower().isin(MISSING)
        # Some loggers write the unit into every cell.
        bare = texts.str.extract(r"^([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*(?:[°º*%a-zA-Z/]{0,6})$")[0]
        if lines.decimal == ",":
            bare = bare.str.replace(",", ".", regex=False)
        numbers = pd.to_numeric(bare, errors="coerce").to_numpy(dtype=float, copy=True)
        wrong = np.flatnonzero(np.isnan(numbers) & ~empty.to_numpy())
        if wrong.size > 0.5 * numbers.size:
            raise BenchError(
                f"{shown(lines.path)}, line {lines.numbers[wrong[0]]}, column {column.name!r}: "
                f"{str(cells[wrong[0]])!r} is not a number, nor are most; name another column in the map"
            )
        if wrong.size:
            unread = wrong.size
            count = _sentence(wrong.size, f"cells of {column.name!r} that are no numbers", lines.numbers[wrong[0]])
            said.append(count)
    for word in layout.missing:
        if re.fullmatch(r"[+-]?[\d.]+([eE][+-]?\d+)?", word):
            numbers[numbers == float(word)] = np.nan
    scale, offset = UNITS[column.quantity][column.unit]
    numbers = scale * numbers + offset if (scale, offset) != (1.0, 0.0) else numbers
    missing = int(np.isnan(numbers).sum()) - unread
    if missing:
        said.append(f"{missing} values of {column.name!r} are missing")
    limits = LIMITS[column.quantity]
    absurd = np.flatnonzero((numbers < limits.low) | (numbers > limits.high))
    if absurd.size and absurd.size >= 0.9 * np.isfinite(numbers).sum():
        key = f"{column.quantity}_unit"
        raise BenchError(
            f"{where}: {limits.refusal(float(numbers[absurd[0]]))} read in {column.unit}, like most of it; "
            f"state the right {key} in the map ({', '.join(UNITS[column.quantity])})"
        )
    if absurd.size:
        said.append(_sentence(absurd.size, f"impossible readings of {column.name!r}", lines.numbers[absurd[0]]))
        numbers[absurd] = np.nan
    if np.isfinite(numbers).sum() < 2:
        raise BenchError(f"{where}: holds no readings; name another column in the map, or leave this one out")
    return numbers, said


def _sentence(count: int, what: str, line: int) -> str:
    return f"{count} {what} left out (the first in line {line})"
