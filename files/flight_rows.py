"""The rows of a flight's log as numbers.

What is no number is missing. A row is damaged where it is cut short or has text where a number belongs.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shockrig.files.errors import InputError
from shockrig.files.flight import KIND_OF, Flight, FlightColumns, read_layout
from shockrig.files.flight_cells import Rows, joined, number_of, numbers_of, of_cells, read_blocks
from shockrig.files.flight_intermet import day_first
from shockrig.files.ranges import RANGES
from shockrig.files.sentinels import NO_VALUE_WORDS, coded
from shockrig.files.unit_names import EPOCH, UNITS, squeeze, within_second

Array = NDArray[np.float64]
BLOCK_ROWS = 20_000
ESSENTIAL = ("time", "temperature", "humidity")
DAY_S = 86400.0
DATED = r"\d[-/.]\d{1,2}[-/.]\d"  # a stamp with its date
# 2024_3_27_11_34_7, 2022-5-7--11-24-56-316: thousandths behind the seconds
JOINED = r"^(\d{4})[_-](\d\d?)[_-](\d\d?)[_-]{1,2}(\d\d?)[_-](\d\d?)[_-](\d\d?)(\.\d+)?(?:[_-](\d{1,3}))?$"
TIME_OF_DAY = r"\d{1,2}:\d\d(:\d\d([.,]\d+)?)?( ?[AaPp][Mm])?"
DISORDER_S = 3600.0  # by which a row may be earlier than a log's first: 23 hours on, its day is the next
ISO_UTC = re.compile(r"(\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d{1,6})?)?Z?)?")
LATEST_S = 253402300800.0  # the year 10000, from 1970 on
SLOWEST_PACKED_S = 20.0  # a step from one reading to the next, or minutes could be passed over


@dataclass(frozen=True)
class Damage:
    """How much of a log can be read.

    `rows` in all; those that are `damaged` (too short, or text where a number belongs); those that are `lost` (their
    time, temperature or humidity is what is damaged); where each of the two begins; and the names of the columns that
    hold text in rows which have all their cells, where nothing else is damaged.
    """

    rows: int
    damaged: int
    first_damaged: str
    lost: int
    first_lost: str
    columns: tuple[str, ...]


def look_over(path: Path, layout: FlightColumns) -> Damage:
    """Count the rows that cannot be read as numbers. An empty cell and what loggers write for one is no damage."""
    named = 1 + max((place for place, name in enumerate(layout.header) if name), default=0)
    count, firsts, total, short = [0, 0], ["", ""], 0, False
    of_text: dict[str, None] = {}
    for rows in read_blocks(path, layout, BLOCK_ROWS):
        texts = {quantity: _text_cells(rows, layout, quantity) for quantity in layout.place}
        damaged = np.logical_or.reduce([rows.size < named, *texts.values()])
        short |= bool((rows.size < named).any())
        of_text |= {layout.header[layout.place[quantity]]: None for quantity, text in texts.items() if text.any()}
        lost = np.logical_or.reduce(
            [texts[quantity] | (rows.size <= layout.place[quantity]) for quantity in ESSENTIAL if quantity in texts]
        )
        for i, mask in enumerate((damaged, lost)):
            if mask.any() and not count[i]:
                row = int(np.argmax(mask))
                place = next((layout.place[quantity] for quantity, text in texts.items() if text[row]), None)
                cells = f"{rows.size[row]} of {named} cells"
                what = cells if place is None else f"{layout.header[place]} is {repr(rows.cell(row, place))[:40]}"
                firsts[i] = f"line {rows.line[row]}: {what}"
            count[i] += int(np.count_nonzero(mask))
        total += len(rows)
    return Damage(total, count[0], firsts[0], count[1], firsts[1], () if short else tuple(of_text))


def damage_notes(path: Path, layout: FlightColumns) -> list[str]:
    """What is to be said of a log's damaged rows before its rows are used.

    Raises
    ------
    InputError
        Most of its rows are no numbers.
    """
    damage = look_over(path, layout)
    if damage.lost > damage.rows / 2:
        raise InputError(
            f"{path}: {damage.lost} of {damage.rows} rows could not be read as numbers (first: {damage.first_lost}); "
            "fix the log, or name the columns that hold numbers with --column QUANTITY=NAME"
        )
    if not damage.damaged:
        return []
    how_many, where = f"{damage.damaged} of {damage.rows} rows could not be read as numbers", "throughout"
    if not damage.lost and damage.columns:  # of no reading: nothing but what stands in these is amiss
        where = f"in {', '.join(map(repr, damage.columns))}"
    return [f"{how_many} {where} and are treated as missing there (first: {damage.first_damaged})"]


def unrecognised(quantity: str, maybe: Sequence[str] = ()) -> str:
    """A sentence on a quantity that a log seems to lack; `maybe` names columns that may be its."""
    those = f" ({', '.join(map(repr, maybe))}?)" if maybe else ""
    return f"{quantity}: no column of it recognised; if there is one{those}, --column {quantity}=NAME"


def _text_cells(rows: Rows, layout: FlightColumns, quantity: str) -> NDArray[np.bool_]:
    """True where a cell is neither a number (of the time: nor a date) nor empty."""
    place = layout.place[quantity]
    if place not in rows.strange:
        return np.zeros(len(rows), dtype=bool)
    unread = np.isnan(_times(rows, layout) if quantity == "time" else rows.numbers[place])
    for row in np.flatnonzero(unread).tolist():
        cell = rows.cell(row, place)
        # what is beyond every number is absurd, but not damaged
        unread[row] = cell.strip().lower() not in NO_VALUE_WORDS and number_of(cell) is None
    return unread


def to_flight(rows: Rows | list[list[str]], layout: FlightColumns) -> Flight:
    """Numbers of some rows; what is no number is missing.

    Units are brought to s, degC, %RH and m/s by the columns' names.
    """
    if not isinstance(rows, Rows):
        rows = of_cells(rows, layout)

    def numbers(quantity: str) -> Array:
        if quantity not in layout.place:
            return np.full(len(rows), np.nan)
        values = rows.numbers[layout.place[quantity]]
        return _scaled(quantity, values, layout) if layout.known is None else layout.known.values(quantity, values)

    temperature, humidity, die = numbers("temperature"), numbers("humidity"), numbers("die")
    pressure, altitude = numbers("pressure"), numbers("altitude")
    latitude, longitude = numbers("latitude"), numbers("longitude")
    no_fix = (latitude == 0.0) & (longitude == 0.0)
    if layout.raw_xq2:
        temperature, humidity, die = temperature / 100, humidity / 10, die / 100
        altitude = altitude / 1000
        latitude, longitude = latitude * 1e-7, longitude * 1e-7
    time_s = _times(rows, layout)
    if layout.zero_is_missing:
        block = (temperature, humidity, die, pressure)
        nothing = np.logical_and.reduce([np.isnan(values) | (values == 0.0) for values in block])
        for values in block:
            values[nothing] = np.nan
    if layout.zero_is_missing or layout.raw_xq2:
        for values in (latitude, longitude, altitude):
            values[no_fix] = np.nan
        time_s = _since_fix(time_s, no_fix)
    pressure = _possible(pressure, layout)
    time_s = _apart(time_s, np.stack([temperature, humidity, die]))
    vertical = numbers("vertical_speed") if "vertical_speed" in layout.place else None
    return Flight(
        time_s, temperature, humidity, numbers("airspeed"), die, pressure, altitude, latitude, longitude, vertical
    )


def _scaled(quantity: str, values: Array, layout: FlightColumns) -> Array:
    """Numbers of a column (n,) in the project's unit. Codes for no value stay what they are."""
    if quantity not in layout.units:
        return values.copy()
    factor, offset = UNITS[KIND_OF[quantity]][layout.units[quantity]]
    codes = coded(quantity, values)
    return np.where(np.logical_or.reduce([np.isnan(values), *codes.values()]), values, factor * values + offset)


def whole_flight(path: Path, columns: Mapping[str, str] | None = None) -> Flight:
    """All rows of a flight's CSV file; `columns` as `chosen` of `read_layout`.

    Raises
    ------
    InputError
        The columns cannot be told, or there is no row.
    """
    layout = read_layout(path, columns)
    blocks = list(read_blocks(path, layout, BLOCK_ROWS))
    if not blocks:
        raise InputError(f"{path}: no rows under the header; give a log with samples")
    return to_flight(joined(blocks), layout)


def _since_fix(time_s: Array, no_fix: NDArray[np.bool_]) -> Array:
    """Times (n,) of an InterMet sensor, missing before its clock is set: until the first fix it counts from the day on
    which its receiver's firmware was made, years ago."""
    fixed = np.isfinite(time_s) & ~no_fix
    if not fixed.any():
        return time_s
    return np.where(no_fix & (time_s < np.min(time_s[fixed]) - DAY_S), np.nan, time_s)


def _apart(time_s: Array, readings: Array) -> Array:
    """Times (n,) of rows that bear the stamp of the row before with other `readings` (c, n), spread until the next.

    A row that repeats its readings as well keeps the stamp.
    """
    same = np.append(False, np.diff(time_s) == 0.0)
    again = same & np.append(False, (np.nan_to_num(np.diff(readings, axis=1)) == 0.0).all(axis=0))
    rows = np.flatnonzero(~again)
    new = np.flatnonzero(~same[rows])
    if new.size in (0, rows.size):
        return time_s
    stamp, count = time_s[rows[new]], np.diff(np.append(new, rows.size))
    ahead = np.append(np.diff(stamp), np.inf)
    usual = float(np.nanmedian((ahead / count)[:-1])) if new.size > 1 else 0.0
    # across a gap, or where the clock steps, rows follow each other as they usually do
    step = np.where((ahead > 0) & (ahead <= 5.0 * count * usual), ahead / count, usual)
    apart = np.repeat(stamp, count) + (np.arange(rows.size) - np.repeat(new, count)) * np.repeat(step, count)
    return apart[np.maximum(np.cumsum(~again) - 1, 0)]


def _possible(pressure: Array, layout: FlightColumns) -> Array:
    """Pressures of a log, missing where none can be. In pascal they stay so: whoever corrects them says so."""
    possible = RANGES["pressure_hpa"]
    if layout.raw_xq2:
        pressure = pressure / 100.0
    known = np.isfinite(pressure)
    unit = 100.0 if known.any() and np.median(pressure[known]) > possible.high else 1.0
    return np.where((pressure >= unit * possible.low) & (pressure <= unit * possible.high), pressure, np.nan)


def numeric_places(path: Path, layout: FlightColumns) -> frozenset[int]:
    """Columns of a log in which every cell is a number or empty, and not all are empty."""
    places, filled = set(range(len(layout.header))), set()
    for rows in read_blocks(path, layout, BLOCK_ROWS):
        for place, cells in enumerate(zip(*rows.table(), strict=True)):
            texts = [cell for cell in cells if cell.strip()]
            if texts:
                filled.add(place)
            if place in places and np.isnan(numbers_of(texts)).any():
                places.discard(place)
    return frozenset(places & filled)


def _times(rows: Rows, layout: FlightColumns) -> Array:
    """Seconds of the rows (n,), as `_stamped` has them; InputError where most are beyond every date."""
    time_s = _stamped(rows, layout)
    absurd = np.flatnonzero(np.abs(time_s) > LATEST_S)
    if absurd.size > np.count_nonzero(np.isfinite(time_s)) / 2:
        row, place = int(absurd[0]), layout.place["time"]
        where = f"{layout.source}, line {rows.line[row]}: column {layout.header[place]!r}"
        raise InputError(
            f"{where}: {rows.cell(row, place)[:40]!r} is no time: {time_s[row]:.3g} s are beyond the year 9999; "
            "put its unit into the column's name (such as time_us), or name another column with --column time=NAME"
        )
    return np.where(np.abs(time_s) > LATEST_S, np.nan, time_s) if absurd.size else time_s


def _stamped(rows: Rows, layout: FlightColumns) -> Array:
    """Seconds, from a number (by the unit in the column's name, or as a known log has it) or a date and time."""
    place = layout.place["time"]
    values = rows.numbers[place]
    if "rest" in layout.place:
        rest, unit = rows.numbers[layout.place["rest"]], layout.units["rest"]
        values = values + rest * UNITS["time"][unit][0] if within_second(values, rest, unit) else values
    if len(rows) and np.isnan(values).mean() > 0.5:
        if (seconds := _of_iso(rows.cells(place))) is not None:
            return seconds
        import pandas as pd

        text = pd.Series(rows.cells(place), dtype=str).str.strip().str.replace(JOINED, _parted, regex=True)
        of_day = bool(text.str.fullmatch(TIME_OF_DAY).mean() > 0.5)
        if layout.date_place is not None and layout.date_place != place and not text.str.contains(DATED).any():
            dates = pd.Series(rows.cells(layout.date_place), dtype=str).str.strip()
            text, of_day = dates + " " + text, of_day and bool((dates == "").mean() > 0.5)
        try:
            first = day_first(text.tolist())
            stamps = pd.to_datetime(text, errors="coerce", utc=True, format="mixed", dayfirst=first)
            seconds = np.asarray((stamps - pd.Timestamp(0, tz="UTC")).dt.total_seconds(), dtype=np.float64)
            if not of_day:
                return seconds
            if layout.begins_s is None:
                return seconds % DAY_S  # a time of day is none of today
            earliest_s = layout.begins_s - DISORDER_S
            return earliest_s + (seconds - earliest_s) % DAY_S
        except (ValueError, OverflowError) as error:  # a year that cannot be is not always made a missing time
            raise InputError(f"{layout.source}: times cannot be read as dates ({error}); fix that row") from error
    if layout.known is not None and "time" in layout.known.factor:
        return layout.known.values("time", values)
    if "time" in layout.units:
        return values * UNITS["time"][layout.units["time"]][0]
    if squeeze(layout.header[place]).endswith("timeus"):
        return values * 1e-6
    known = values[np.isfinite(values)]
    for unit, (low, high) in EPOCH.items():
        if known.size and low < np.median(known) < high:
            return values * UNITS["time"][unit][0]
    return _of_packed(values)


def _parted(joined: re.Match[str]) -> str:
    """A date and time whose numbers one character joins, as every other log writes it."""
    year, month, day, hour, minute, second, fraction, thousandths = joined.groups("")
    fraction = f".{int(thousandths):03d}" if thousandths else fraction
    return f"{year}-{month}-{day} {hour}:{minute}:{second}{fraction}"


def _of_iso(cells: Sequence[str]) -> Array | None:
    """Seconds since 1970 where every cell is empty or an ISO 8601 date and time of UTC, as most logs write them; else
    None. pandas reads every other form, and takes longer to import than a flight to correct."""
    if not all(map(ISO_UTC.fullmatch, cells)):
        return None
    try:
        stamps = np.array([cell.rstrip("Z") or "NaT" for cell in cells], dtype="datetime64[us]")
    except ValueError:  # the 30th of February
        return None
    return np.where(np.isnat(stamps), np.nan, stamps.astype(np.int64) * 1e-6)


def _of_packed(values: Array) -> Array:
    """Seconds of the day where numbers are clock times, 235959 for 23:59:59: of seconds a log that goes on by the
    second has some from 60 to 99 in every hundred."""
    known = values[np.isfinite(values)]
    minutes, ahead = known // 100, np.diff(known)
    if not (known.size and (known >= 0).all() and (known < 240_000).all() and (minutes % 100 < 60).all()):
        return values
    forward = ahead[ahead > 0]
    if (known % 100 >= 60).any() or not np.diff(minutes).any() or np.median(forward) > SLOWEST_PACKED_S:
        return values
    return values // 10_000 * 3600 + values // 100 % 100 * 60 + values % 100
