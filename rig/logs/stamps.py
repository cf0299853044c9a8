"""Times of a log in seconds: dates in one column or several, seconds since 1970, seconds, milliseconds, hours:minutes.

A log's own clock is kept: numbers stay as they are but for their unit, dates count from the log's first stamp.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime, time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.unit_names import UNITS, rest_of_second
from shockrig.rig.bench_errors import BenchError

Array = NDArray[np.float64]

ISO, NUMBERS, OF_DAY = "iso", "number", "time of day"
_A_DATE = re.compile("%[yYmbBdjcxDFsGgUVWuwaAeh]")  # what strptime has of years, months, weeks and days
STILL_ROWS = 10  # that bear one stamp or two are not timed by it


@dataclass(frozen=True)
class TimeColumns:
    """Which columns tell the time and how.

    `format` is "iso", "number" (of `unit`; of several columns each counts sixty of the next, minutes and seconds, or
    the last is what is left of whole seconds, in the unit that its name has),
    "time of day" or a strptime format for the columns joined by a blank.
    `since_1970`: the numbers are dates. `doubt` says what was taken for granted, for the user to check. `every_s`: no
    column tells the time, and rows come so many seconds apart. `known` is "named" where the log itself names the
    unit of its times, "rising" where nothing but that its numbers rise speaks for a column, else "stated": by a map,
    or taken for granted.
    """

    columns: tuple[str, ...]
    format: str
    unit: str = "s"
    since_1970: bool = False
    doubt: str = ""
    every_s: float | None = None
    known: str = "stated"

    @property
    def is_of_day(self) -> bool:
        """Whether times of day are told and no date: a format without one would put them into 1900."""
        return self.format == OF_DAY or self.format not in (ISO, NUMBERS) and _A_DATE.search(self.format) is None

    @property
    def is_dated(self) -> bool:
        return self.since_1970 or self.format != NUMBERS and not self.is_of_day


def parsed(clock: TimeColumns, columns: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    """Stamps of some rows, each by itself: numbers of the clock's unit, seconds of the day, or dates (UTC).

    Parameters
    ----------
    clock : Clock
    columns : mapping
        Name -> cells (text) or numbers, shape (n,).
    """
    import pandas as pd

    if clock.every_s is not None:
        return np.zeros(0)
    if clock.format == NUMBERS:
        total = np.zeros(len(columns[clock.columns[0]]))
        rest = rest_of_second(clock.columns, 0)
        for name in clock.columns:
            counts = pd.Series(columns[name])
            if counts.dtype.kind not in "fiu":  # some loggers write the unit into every cell
                counts = counts.astype("str").str.replace(r"(?<=[\d.])\s*[a-zA-Zµμ]{1,6}$", "", regex=True)
            numbers = pd.to_numeric(counts, errors="coerce").to_numpy(dtype=float)
            is_rest = rest is not None and name == clock.columns[rest[0]]
            total = total + UNITS["time"][rest[1]][0] * numbers if rest and is_rest else 60.0 * total + numbers
        return total
    joined = pd.Series(columns[clock.columns[0]], dtype="str").str.strip()
    for name in clock.columns[1:]:
        joined = joined + " " + pd.Series(columns[name], dtype="str").str.strip()
    if clock.format == OF_DAY:
        return _clock_s(joined)
    if "%p" in clock.format:
        joined = joined.map(half_day)
    kind = "ISO8601" if clock.format == ISO else clock.format
    moments = pd.to_datetime(joined, format=kind, errors="coerce", utc=True)
    if clock.is_of_day:
        return (moments - moments.dt.normalize()).dt.total_seconds().to_numpy()
    return moments.dt.tz_localize(None).to_numpy(dtype="datetime64[ns]")


def half_day(text: str) -> str:
    """A time with its half of the day as strptime reads it: 02:04:00 p. m. is what Spanish has for 02:04:00 pm."""
    return re.sub(r"\s*([ap])\.?\s?m\.?$", r" \1m", text, flags=re.I)


def in_seconds(
    clock: TimeColumns, blocks: list[NDArray[Any]], stamp: Callable[[int], str], rows: int, where: str
) -> tuple[Array, float]:
    """Seconds of every row, NaN where a stamp cannot be read, and the seconds since 1970 from which they count.

    Parameters
    ----------
    clock : Clock
    blocks : list of arrays
        Of all rows in their order, as `parsed` gives them; it is empty afterwards.
    stamp : callable
        What stands in a row, for messages.
    rows : int
        n.
    where : str
        File and column for messages.

    Raises
    ------
    BenchError
        Hardly any of the stamps fits the clock, or they do not go on.
    """
    if clock.every_s is not None:
        return clock.every_s * np.arange(rows, dtype=np.float64), 0.0
    values = np.concatenate(blocks)
    blocks.clear()
    origin, seconds = 0.0, values
    if clock.format == NUMBERS:
        seconds = values * UNITS["time"][clock.unit][0]
        if clock.since_1970 and np.isfinite(values).any():
            # Subtracted before the unit is taken: a double of 1.7e15 microseconds still holds every one of them.
            first = float(values[np.isfinite(values)][0])
            origin = first * UNITS["time"][clock.unit][0]
            seconds = (values - first) * UNITS["time"][clock.unit][0]
    elif clock.is_of_day:
        seconds = _past_midnight(values)
    else:
        known = ~np.isnat(values)
        seconds = np.full(values.size, np.nan)
        if known.any():
            begins = values[known][0]
            origin = float(begins.astype(np.int64)) / 1e9
            seconds[known] = (values[known] - begins).astype(np.int64) / 1e9
    if np.isfinite(seconds).sum() < max(2, 0.5 * seconds.size):
        bad = np.flatnonzero(~np.isfinite(seconds))
        example = stamp(int(bad[0])) if bad.size else "nothing"
        raise BenchError(
            f"{where}: {example!r} does not fit {clock.format!r}; state [log] time_format (a strptime format, "
            f'"{ISO}" or "{OF_DAY}") or time_unit in the map'
        )
    if rows >= STILL_ROWS and np.unique(seconds[np.isfinite(seconds)]).size < 3:
        raise BenchError(
            f"{where}: holds the same over and over and tells no time; name another in the map, [log] "
            f'time = "...", or where none does, the seconds from row to row, every_s = 1.0'
        )
    return seconds, origin


def to_seconds(clock: TimeColumns, origin_s: float, value: object, where: str) -> float:
    """A time that a user wrote into a map, on the log's clock in s; `where` names the key for messages.

    A number is one of the log's own unit; a date may be one of TOML or text, ISO 8601 or in the log's format.
    """
    if isinstance(value, time):
        value = value.isoformat()
    if isinstance(value, datetime):
        if clock.is_dated:
            return _epoch_s(value) - origin_s
    elif isinstance(value, date):
        raise BenchError(f"{where}: {value} has no time of day; write as 2024-05-23T14:45:20.5")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        if not clock.is_dated or clock.since_1970:
            return float(value) * UNITS["time"][clock.unit][0] - origin_s
    elif isinstance(value, str):
        if clock.is_of_day:
            for format_ in (OF_DAY, clock.format):
                said = TimeColumns(("said",), format_)
                seconds = float(parsed(said, {"said": np.array([value], dtype=object)})[0])
                if np.isfinite(seconds):
                    return seconds
        elif clock.is_dated:
            for read in (datetime.fromisoformat, lambda text: datetime.strptime(text, clock.format)):
                try:
                    return _epoch_s(read(value)) - origin_s
                except ValueError:
                    continue
    wanted = "a date and time such as 2024-05-23T14:45:20.5" if clock.is_dated else f"a number, in {clock.unit}"
    if clock.is_of_day:
        wanted = 'text such as "14:45:20.5"'
    raise BenchError(f"{where}: {value!r} is no time on this log's clock; expected {wanted}, as the log itself counts")


def to_map(clock: TimeColumns, origin_s: float, seconds: float, digits: int = 2) -> str:
    """A time of the log as a TOML value in the log's own terms, to `digits` decimals of a second."""
    if clock.is_of_day:
        hours, rest = divmod(round(seconds, digits), 3600.0)
        return f'"{int(hours):02d}:{int(rest // 60):02d}:{rest % 60:0{3 + digits if digits else 2}.{digits}f}"'
    if clock.is_dated and not clock.since_1970:
        moment = datetime.fromtimestamp(round(origin_s + seconds, digits), UTC)
        return moment.strftime("%Y-%m-%dT%H:%M:%S") + (f".{moment.microsecond:06d}"[: digits + 1] if digits else "")
    factor = UNITS["time"][clock.unit][0]
    places = max(0, digits + round(np.log10(factor)))
    return f"{(origin_s + seconds) / factor:.{places}f}"


def unit_shown(clock: TimeColumns) -> str:
    """What stands behind a time of the log as `to_map` writes it: its unit, where it counts in another than seconds."""
    return f" {clock.unit}" if clock.format == NUMBERS and clock.unit != "s" else ""


def _clock_s(texts: Any) -> Array:
    """Hours:minutes:seconds to s of a day; thousandths may stand behind a colon."""
    texts = texts.str.replace(r"[,:](?=\d{3}$)|,", ".", regex=True)
    parts = texts.str.extract(r"^(\d{1,3}):(\d{1,2})(?::(\d{1,2}(?:\.\d+)?))?$")
    numbers = parts.astype(float).to_numpy()
    return np.asarray(3600.0 * numbers[:, 0] + 60.0 * numbers[:, 1] + np.nan_to_num(numbers[:, 2]), dtype=float)


def newest_first(stamps: Array) -> bool:
    """Whether stamps go back from row to row more often than on: many services write the newest reading on top."""
    steps = np.diff(stamps)
    return bool((steps < 0).sum() > (steps > 0).sum())


def _past_midnight(seconds: Array) -> Array:
    """Seconds of a day that go on where the next one begins."""
    known = np.flatnonzero(np.isfinite(seconds))
    if newest_first(seconds[known]):
        known = known[::-1]
    back = np.diff(seconds[known], prepend=seconds[known][0] if known.size else 0.0) < -43200.0
    seconds[known] += 86400.0 * np.cumsum(back)
    return seconds


def _epoch_s(moment: datetime) -> float:
    """Seconds since 1970; a time without a zone is taken as UTC, which only shifts started_at."""
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
