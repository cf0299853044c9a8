"""Ordinary CSV files of other loggers, a time column and value columns, read as one sensor's series.

Times in s, ms, us, ISO 8601 or a strptime format; comma, semicolon or tab; decimal point or comma; header or none.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from shockrig.files.disk import decoded, read_bytes
from shockrig.files.ranges import RANGES
from shockrig.rig.errors import BenchError, as_bench_errors
from shockrig.rig.keys import nearest
from shockrig.rig.logs.units import UNITS, bare_name, unit_in_name

TEMPERATURE_UNITS = {"c": "degC", "k": "K", "f": "degF"}
PLAUSIBLE = {"temperature_c": RANGES["temperature_c"], "humidity_percent": RANGES["humidity_reading_percent"]}
USUAL_NAMES = {
    "time": ("time_s", "time", "t", "timestamp", "datetime", "date_time", "time_ms", "seconds"),
    "temperature_c": ("temperature_c", "temperature", "temp", "temp_c", "t_c", "tair"),
    "humidity_percent": ("humidity_percent", "humidity", "rh", "rh_percent", "rel_humidity", "hum"),
}


@dataclass(frozen=True)
class CsvLayout:
    """How a logger writes. None and "auto" are found out from the file.

    `time_unit` is "s", "ms", "us", "iso" or "auto" (ISO where it is not a number, else the unit in the column's name,
    else s); `time_format` is a strptime format and overrides it. `columns` maps "time", "temperature_c" and
    "humidity_percent" to a name or a number from 1. A unit of values that is None is that in their column's name.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    time_unit: str = "auto"
    time_format: str | None = None
    delimiter: str | None = None
    decimal: str | None = None
    skip_lines: int = 0
    temperature_unit: str | None = None
    humidity_unit: str | None = None


@dataclass(frozen=True)
class Series:
    """One sensor's readings: times in s (since 1970 for dates), values by column, and what was left out and why.

    `unit_s` is the unit of times that are numbers, in s: that of `--start`, too.
    """

    time_s: tuple[float, ...]
    values: Mapping[str, tuple[float | None, ...]]
    left_out: Mapping[str, int]
    dated: bool
    unit_s: float = 1.0


def read_series(path: Path, wanted: Sequence[str], layout: CsvLayout) -> Series:
    """Read the columns `wanted` (the first must have a value in each row that counts) over time from a CSV file.

    Raises
    ------
    BenchError
        Naming the file, the line, the column and the remedy.
    """
    rows = _rows(path, layout)
    if not rows:
        raise BenchError(f"{path}: is empty; expected a time column and value columns")
    first_line, first = rows[0]
    headed = not all(_is_value(cell, layout) for cell in first if cell.strip())
    header = [cell.strip() for cell in first] if headed else [str(i + 1) for i in range(len(first))]
    body = rows[1:] if headed else rows
    # Which sensor's file it is shows in what every row must have, and so do the options that name its columns.
    sensor, main = ("hyt", "humidity") if wanted[0] == "humidity_percent" else ("imet", "temperature")
    options = {"time": f"--{sensor}-time", wanted[0]: f"--{sensor}-{main}"}
    places = {"time": _place(path, first_line, header, "time", layout, options)}
    for quantity in wanted:
        if quantity == wanted[0] or quantity in layout.columns or _usual(header, quantity) is not None:
            places[quantity] = _place(path, first_line, header, quantity, layout, options)
    asked = {
        "time": None if layout.time_unit == "auto" else layout.time_unit,
        "temperature_c": TEMPERATURE_UNITS.get(layout.temperature_unit or ""),
        "humidity_percent": layout.humidity_unit,
    }
    units = {column: _conversion(column, header[place], asked[column]) for column, place in places.items()}
    unit_s, _ = units["time"]
    times: list[float] = []
    values: dict[str, list[float | None]] = {quantity: [] for quantity in places if quantity != "time"}
    left_out: dict[str, int] = {}
    dated = False
    for line, row in body:
        if not any(cell.strip() for cell in row):
            continue
        if len(row) <= max(places.values()):
            raise BenchError(f"{path}, line {line}: has {len(row)} columns, expected {max(places.values()) + 1}+")
        here = f"{path}, line {line}"
        time_s, dated = time_of(row[places["time"]], layout, f"{here}, column {header[places['time']]!r}", unit_s)
        new: dict[str, float | None] = {}
        for quantity in values:
            value = _number(row[places[quantity]], layout, f"{here}, column {header[places[quantity]]!r}")
            if value is not None:
                scale, offset = units[quantity]
                value = scale * value + offset
                if not PLAUSIBLE[quantity].holds(value):
                    left_out["implausible"] = left_out.get("implausible", 0) + 1
                    value = None
            elif quantity == wanted[0]:
                left_out["empty"] = left_out.get("empty", 0) + 1
            new[quantity] = value
        if new[wanted[0]] is None:
            continue
        if times and time_s <= times[-1]:
            if time_s == times[-1] and all(values[quantity][-1] == value for quantity, value in new.items()):
                left_out["repeated"] = left_out.get("repeated", 0) + 1
                continue
            raise BenchError(
                f"{here}, column {header[places['time']]!r}: time {row[places['time']].strip()} is not later than the "
                "row before; sort the file, or give a time column fine enough to tell the rows apart"
            )
        times.append(time_s)
        for quantity, value in new.items():
            values[quantity].append(value)
    if len(times) < 2:
        raise BenchError(f"{path}: fewer than two usable rows; expected a recording")
    return Series(
        tuple(times), {quantity: tuple(column) for quantity, column in values.items()}, left_out, dated, unit_s
    )


def _rows(path: Path, layout: CsvLayout) -> list[tuple[int, list[str]]]:
    """(line number, cells) of every line that is not a comment."""
    with as_bench_errors():
        text = decoded(read_bytes(path, "name a CSV file that can be read"))
    if "\0" in text:
        line = text.partition("\0")[0].count("\n") + 1
        raise BenchError(f"{path}, line {line}: holds a NUL byte; is it a CSV file?")
    lines = text.splitlines()
    kept = [(n, line) for n, line in enumerate(lines, start=1) if n > layout.skip_lines and not line.startswith("#")]
    kept = [(n, line) for n, line in kept if line.strip()]
    delimiter = layout.delimiter or _delimiter([line for _, line in kept[:20]])
    try:
        return [(n, next(csv.reader(io.StringIO(line), delimiter=delimiter))) for n, line in kept]
    except csv.Error as error:
        raise BenchError(f"{path}: {error}") from None


def _delimiter(lines: Sequence[str]) -> str:
    """The separator that all lines have: tab before semicolon before comma, which may be a decimal one."""
    for candidate in "\t;":
        if lines and all(candidate in line for line in lines):
            return candidate
    return ","


def _place(
    path: Path, line: int, header: list[str], quantity: str, layout: CsvLayout, options: Mapping[str, str]
) -> int:
    """The column of a quantity; `options` name the option by which it can be chosen."""
    asked = layout.columns.get(quantity)
    if asked is None:
        found = _usual(header, quantity)
        if found is not None:
            return found
        had = ", ".join(header)
        option = f"{options[quantity]} COLUMN"
        raise BenchError(f"{path}, line {line}: no column for {quantity}; name it by {option} (it has: {had})")
    if asked in header:
        if header.count(asked) > 1:
            raise BenchError(f"{path}, line {line}: column {asked!r} is there twice; give its number")
        return header.index(asked)
    if asked.isdecimal() and 1 <= int(asked) <= len(header):
        return int(asked) - 1
    raise BenchError(f"{path}, line {line}: no column {asked!r}{nearest(asked, header)}")


def _conversion(column: str, name: str, asked: str | None) -> tuple[float, float]:
    """Factor and offset to the campaign's unit: of the unit asked for, else of that in the column's name, else none."""
    return UNITS[column.partition("_")[0]].get(asked or unit_in_name(name) or "", (1.0, 0.0))


def _usual(header: Sequence[str], quantity: str) -> int | None:
    # "Time [ms]" and "Temp (C)" are a time and a temperature; a name as it stands comes first.
    names = [name.lower() for name in (*header, *map(bare_name, header))]
    place = next((names.index(name) for name in USUAL_NAMES[quantity] if name in names), None)
    return None if place is None else place % len(header)


def _is_value(cell: str, layout: CsvLayout) -> bool:
    try:
        _number(cell, layout, "")
        return True
    except BenchError:
        pass
    try:
        time_of(cell, layout, "", 1.0)
        return True
    except BenchError:
        return False


def _number(cell: str, layout: CsvLayout, where: str) -> float | None:
    """A number; None where the cell is empty or says that there is none."""
    text = cell.strip()
    if text.lower() in ("", "nan", "na", "n/a", "null", "none", "-", "--"):
        return None
    comma = layout.decimal == "," or (layout.decimal is None and "." not in text)
    if comma and "." not in text:
        text = text.replace(",", ".")
    elif comma:
        text = ""  # a point in a file with decimal commas could be anything
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or "_" in text:
        raise BenchError(f"{where}: {cell.strip()!r} is not a number; fix the cell, or skip lines before the header")
    return value


def time_of(cell: str, layout: CsvLayout, where: str, unit_s: float) -> tuple[float, bool]:
    """Time in s (since 1970 where it is a date), and whether it is a date; `where` names the cell in errors, `unit_s`
    is the unit of one that is a number."""
    text = cell.strip()
    if layout.time_format is not None:
        try:
            return _epoch_s(datetime.strptime(text, layout.time_format)), True
        except ValueError:
            raise BenchError(f"{where}: {text!r} does not fit the time format {layout.time_format!r}") from None
    if layout.time_unit != "iso":
        try:
            value = _number(text, layout, where)
        except BenchError:
            if layout.time_unit != "auto":
                raise
        else:
            if value is None:
                raise BenchError(f"{where}: the time is missing; every row needs one")
            return value * unit_s, False
    try:
        return _epoch_s(datetime.fromisoformat(text)), True
    except ValueError:
        expected = "an ISO 8601 time" if layout.time_unit == "iso" else "a number or an ISO 8601 time"
        raise BenchError(f"{where}: {text!r} is not {expected}; give --time-unit or --time-format") from None


def _epoch_s(moment: datetime) -> float:
    """Seconds since 1970; a time without a zone is taken as UTC, which only shifts started_at."""
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
