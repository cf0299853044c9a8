"""The CSV files of a run: imet.csv and hyt.csv (what a sensor read), air.csv (the air beside the probes as measured).

`time_s` in seconds on the run's one clock, then the columns of the file; unknown columns are ignored.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import TABLE_AT_MOST, is_there, open_text, shown
from shockrig.files.errors import InputError
from shockrig.files.ranges import RANGES, Range
from shockrig.files.sentinels import unread

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REMEDY = "restore the file or take it away"
# What each file has after time_s; of imet.csv and hyt.csv the first is what the sensor is there for.
SENSOR_COLUMNS: Mapping[str, Mapping[str, Range]] = {
    "imet": {"temperature_c": RANGES["temperature_c"]},
    "hyt": {"humidity_percent": RANGES["humidity_reading_percent"], "temperature_c": RANGES["temperature_c"]},
}
AIR_COLUMNS: Mapping[str, Range] = {
    name: RANGES[name] for name in ("temperature_c", "humidity_percent", "airflow_m_s", "pressure_hpa")
}


@dataclass(frozen=True, eq=False)  # arrays have no plain equality: a trace is itself
class Trace:
    """What one instrument recorded in one run: arrays of shape (n,), in order of time.

    `values` maps "temperature_c", "humidity_percent" (of air.csv also "airflow_m_s", "pressure_hpa") to arrays; rows
    without a finite value, rows that the sensor flagged as stale and readings beyond what can be are dropped and
    counted in `dropped`; `impossible` maps a column to the median of its readings that cannot be, which tells a wrong
    unit. In the trace of an air a cell that is empty or cannot be is NaN; the rest of its row stays.
    """

    time_s: Array
    values: dict[str, Array]
    dropped: dict[str, int] = field(default_factory=dict)
    impossible: dict[str, float] = field(default_factory=dict)


def read_sensor(folder: Path, sensor: str) -> Trace | None:
    """Read runs/ID/`sensor`.csv ("imet", "hyt", "imet-2"); None where the sensor has no file.

    Raises
    ------
    InputError
        Names file, line and column, and the remedy.
    """
    file = folder / f"{sensor}.csv"
    if not is_there(file):
        return None
    limits = SENSOR_COLUMNS[sensor.partition("-")[0]]
    main, *others = limits
    table = _read_table(file)
    for column in ("time_s", main):
        if column not in table:
            expected = f"expected the columns time_s, {main}; name them so"
            raise InputError(f"{shown(file)}, line 1: no column {column}; {expected}")
    time_s = _numbers(table, "time_s", file)
    values = {
        name: _numbers(table, name, file) if name in table else np.full(time_s.size, np.nan) for name in (main, *others)
    }
    keep = np.isfinite(time_s)
    dropped = {"empty": int((~keep).sum()), "stale": 0, "implausible": 0}
    if "stale" in table:
        stale = _numbers(table, "stale", file) > 0
        dropped["stale"] = int((stale & keep).sum())
        keep &= ~stale
    impossible = {}
    for name, readings in values.items():
        wrong = _impossible(np.where(keep, readings, np.nan), name, limits[name])
        dropped["implausible"] += int(wrong.sum())
        if wrong.any():
            impossible[name] = float(np.median(readings[wrong]))
        keep &= ~wrong
    dropped["empty"] += int((keep & np.isnan(values[main])).sum())
    keep &= ~np.isnan(values[main])
    return replace(_in_order(file, time_s, values, keep, dropped), impossible=impossible)


def read_air(folder: Path) -> Trace | None:
    """Read runs/ID/air.csv: the columns of `AIR_COLUMNS` that have a value; None where the air was not measured.

    Raises
    ------
    InputError
        Names file, line and column, and the remedy; also where fewer than two rows hold a value.
    """
    file = folder / "air.csv"
    if not is_there(file):
        return None
    table = _read_table(file)
    if "time_s" not in table or not set(AIR_COLUMNS) & set(table):
        expected = f"expected the column time_s and at least one of {', '.join(AIR_COLUMNS)}; name them so"
        raise InputError(f"{shown(file)}, line 1: {expected}")
    time_s = _numbers(table, "time_s", file)
    keep = np.isfinite(time_s)
    known = np.zeros(time_s.size, dtype=bool)
    dropped = {"empty": int((~keep).sum()), "implausible": 0}
    values = {}
    for name, limits in AIR_COLUMNS.items():
        if name not in table:
            continue
        column = _numbers(table, name, file)
        possible = ~np.isnan(column) & ~_impossible(column, name, limits)
        dropped["implausible"] += int((~possible & ~np.isnan(column) & keep).sum())
        if (possible & keep).any():
            values[name] = np.where(possible, column, np.nan)
            known |= possible
    dropped["empty"] += int((keep & ~known).sum())
    trace = _in_order(file, time_s, _merged(time_s, values, keep & known), keep & known, dropped)
    if trace.time_s.size < 2:
        raise InputError(f"{shown(file)}: fewer than two rows with a time and a value that can be; {REMEDY}")
    return trace


def _merged(time_s: Array, values: dict[str, Array], keep: Mask) -> dict[str, Array]:
    """The same columns where rows of one time are one row: of each column the first value, where the first row stands.

    Two instruments beside the probes may have been logged to one file, each in rows of its own.
    """
    rows = np.flatnonzero(keep)
    begins = np.diff(time_s[rows], prepend=-np.inf) != 0
    if begins.all():
        return values
    first = rows[begins][np.cumsum(begins) - 1]  # for each kept row the first one of its time
    merged = {}
    for name, column in values.items():
        there = np.isfinite(column[rows])
        merged[name] = column.copy()
        merged[name][first[there][::-1]] = column[rows[there]][::-1]
    return merged


def _read_table(file: Path) -> Mapping[str, Any]:
    """The columns of a CSV file, whose first line names them: arrays where all is numbers, else as pandas reads it."""
    plain = _all_numbers(file)
    if plain is not None:
        return plain
    import pandas as pd

    try:
        with open_text(file, REMEDY, TABLE_AT_MOST) as stream, warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header would be cut short
            text = stream.read()
            frame = pd.read_csv(io.StringIO(text), skipinitialspace=True, index_col=False, low_memory=False)
    except InputError:
        raise
    except (ValueError, OSError, pd.errors.ParserError, pd.errors.ParserWarning) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{shown(file)}: cannot be read as CSV ({reason}); the first line names the columns") from None
    # Some programs leave out empty cells at the end of a line; where a line breaks off, its last number may be cut.
    last = text[text.rfind("\n") + 1 :]
    if last.strip() and last.count(",") + 1 < len(frame.columns):
        where = f"{shown(file)}, line {len(text.splitlines())}"
        raise InputError(f"{where}: the file breaks off there; copy it anew, or take that line out")
    frame.columns = [str(column).strip() for column in frame.columns]
    return {name: frame[name] for name in frame.columns}


def _all_numbers(file: Path) -> dict[str, Array] | None:
    """The columns of a CSV file of nothing but numbers; None for any other.

    What a logger writes is such a file, and pandas takes longer to import than a campaign of them to read.
    """
    with open_text(file, REMEDY, TABLE_AT_MOST) as stream, warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)  # a file without rows
        try:
            names = [name.strip() for name in stream.readline().split(",")]
            cells = np.loadtxt(stream, delimiter=",", comments=None, ndmin=2)
        except (ValueError, OSError, UserWarning):
            return None
    simple = len(set(names)) == cells.shape[1] == len(names) and '"' not in "".join(names)
    return dict(zip(names, cells.T, strict=True)) if simple else None


def _in_order(file: Path, time_s: Array, values: dict[str, Array], keep: Mask, dropped: dict[str, int]) -> Trace:
    """The rows `keep` (n,) as a trace; an error where their clock goes back or far away."""
    far = np.flatnonzero(keep & ~_possible(time_s, RANGES["time_s"]))
    if far.size:
        row = int(far[0])
        raise InputError(
            f"{shown(file)}, line {row + 2}: time_s {RANGES['time_s'].refusal(time_s[row])}; "
            "a run's clock counts seconds from near its start"
        )
    kept = np.flatnonzero(keep)
    back = np.flatnonzero(np.diff(time_s[kept]) < 0)
    if back.size:
        line = int(kept[back[0] + 1]) + 2
        raise InputError(
            f"{shown(file)}, line {line}: time_s goes back; rows must be in order of time on one monotonic clock"
        )
    fresh = kept[np.diff(time_s[kept], prepend=-np.inf) > 0]
    dropped["repeated_time"] = kept.size - fresh.size
    counted = {why: count for why, count in dropped.items() if count}
    return Trace(time_s[fresh], {name: column[fresh] for name, column in values.items()}, counted)


def _impossible(values: Array, column: str, limits: Range) -> Mask:
    """Which readings of a column (n,) are none; a thermometer may be in an oven, where no air is."""
    if column == "temperature_c":
        return unread(values, limits, RANGES["temperature_reading_c"])
    return ~np.isnan(values) & ~_possible(values, limits)


def _possible(values: Array, limits: Range) -> Mask:
    """Which of some values can be (n,); never those that are NaN."""
    with np.errstate(invalid="ignore"):
        return (values >= limits.low) & (values <= limits.high)


def _numbers(table: Mapping[str, Any], column: str, file: Path) -> Array:
    """A column as floats; empty cells are NaN, anything else that is not a number is an error with its line."""
    values = table[column]
    if isinstance(values, np.ndarray):
        return np.where(np.isfinite(values), values, np.nan)
    import pandas as pd

    if isinstance(values, pd.DataFrame):
        raise InputError(f"{shown(file)}, line 1: column {column} is there twice; name one of them otherwise")
    if values.dtype.kind in "fiu":
        numbers = values.to_numpy(dtype=float)
    else:
        try:
            numbers = pd.to_numeric(values, errors="coerce").to_numpy(dtype=float)
        except OverflowError:
            raise InputError(f"{shown(file)}: column {column}: too many digits; fix it or leave it empty") from None
        empty = values.isna() | (values.astype(str).str.strip() == "")
        wrong = np.flatnonzero(np.isnan(numbers) & ~empty.to_numpy())
        if wrong.size:
            found = repr(str(values.iloc[int(wrong[0])]))[:40]
            raise InputError(
                f"{shown(file)}, line {int(wrong[0]) + 2}: column {column}: {found} is not a number; "
                "fix it or leave it empty"
            )
    return np.where(np.isfinite(numbers), numbers, np.nan)
