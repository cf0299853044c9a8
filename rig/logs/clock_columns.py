"""Which columns of a log tell the time, and how, found out from their names and some of their cells."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from shockrig.files.flight import NAMES
from shockrig.files.named_readings import SAMPLE_LINES
from shockrig.files.unit_names import (
    DAY_1970,
    EPOCH,
    UNITS,
    bare_name,
    is_called_time,
    known_unit,
    quantity_of,
    rest_of_second,
    squeeze,
    unit_in_name,
    within_second,
)
from shockrig.rig.logs.stamps import ISO, NUMBERS, OF_DAY, TimeColumns, half_day, newest_first
from shockrig.rig.logs.text import NUMBER, unit_in_cells

_DATES = (
    "%Y/%m/%d", "%d/%m/%Y", "%m/%d/%Y", "%d.%m.%Y", "%d-%m-%Y", "%m-%d-%Y", "%d/%m/%y", "%m/%d/%y", "%d.%m.%y",
    "%Y.%m.%d", "%d-%b-%Y", "%d.%b.%Y", "%d %b %Y", "%b %d %Y", "%b %d, %Y", "%d-%b-%y", "%Y%m%d", "%Y-%m-%d",
    "%Y_%m_%d", "%Y %m %d",
)  # fmt: skip
_BETWEEN = (" ", "T", ", ", "-", "_", ",", "")
_TIMES = (
    "%H:%M:%S.%f", "%H:%M:%S", "%H:%M:%S:%f", "%I:%M:%S %p", "%I:%M:%S.%f %p", "%H:%M", "%I:%M %p", "%H.%M.%S",
    "%H_%M_%S", "%H%M%S", "%H %M %S", "%H %M",
)  # fmt: skip
_YEAR_LAST = ("%b %d %H:%M:%S %Y", "%d %b %H:%M:%S %Y")  # "Mon Sep 28 16:18:02 EDT 2020": of C's ctime, Unix's date
_WEEKDAY = re.compile("(?:Mon|Tue|Wed|Thu|Fri|Sat|Sun)([a-z]*)(,? )")
_ZONE = re.compile(r":\d\d(?:\.\d+)?(?: ?[AP]M)?( [A-Z]{3,5})(?: \d{4})?$")  # a format has it as it stands

# A date whose parts stand in a column each; a month and a minute may both be called mm, and are then told by capitals.
_PARTS = {
    "%Y": ("year", "yyyy"), "%m": ("month", "mon", "MM"), "%d": ("day", "dd"), "%H": ("hour", "hh"),
    "%M": ("minute", "min", "mm"), "%S": ("second", "sec", "ss"),
}  # fmt: skip
_OF_A_DAY = ("%H", "%M", "%S")
_COUNTERS = {
    "#", "scan", "scans", "sample", "samples", "record", "records", "rec", "row", "rows", "line", "lines", "reading",
    "readings", "packet", "packets", "frame", "frames", "count", "counts", "counter", "number", "num", "no", "nr", "n",
    "index", "idx", "id", "seq", "sequence", "sweep", "sweeps",
}  # fmt: skip
_DATED = re.compile("date|datum|fecha|дата|日")
_STAMPED = re.compile("ed_?[Aa]t$")  # reported_at, createdAt
LEAST_STEP_S = 1e-3  # no log of air has a thousand rows a second; a minute is 7e-4 days
_COUNT = re.compile(f"({'|'.join(sorted(_COUNTERS, key=len, reverse=True))})+")  # packetnr, recno: two words in one
RISING = "rising"
MOST_STAND = 0.25  # of a clock's rows, that bear the stamp of the row before
_READ = {name for quantity, names in NAMES.items() if quantity != "time" for name in names}


def guess_clock(names: Sequence[str], rows: Sequence[Sequence[str]], units: Sequence[str]) -> TimeColumns | None:
    """The clock of a log from its columns' names and some rows of cells; None where there is none to be seen."""
    if not rows:
        return None
    columns = {name: [row[k] for row in rows] for k, name in enumerate(names)}
    if (by_parts := _in_parts(columns)) is not None:
        return by_parts
    unit_of = {name: unit_of_clock(name, units[k]) for k, name in enumerate(names)}
    called = [name for name in names if is_called_time(name)]
    for k, name in enumerate(names):
        if (rest := rest_of_second(names, k)) is None:
            continue
        parts = name, names[rest[0]]
        seen = counted_clock(name, columns[name], "s", named=True)
        if seen is not None and within_second(_numbers(columns[name]), _numbers(columns[parts[1]]), rest[1]):
            return replace(seen, columns=parts)
    for name, seconds in pairwise(names):
        if name in called and (unit_of[name], unit_of[seconds]) == ("min", "s") and _below_sixty(columns[seconds]):
            return TimeColumns((name, seconds), NUMBERS)
    for name in [*called, *names[:3]]:
        format_, doubt = guess_format(columns[name])
        if format_ is None:
            continue
        if _has_hours(format_, columns[name]):
            return TimeColumns((name,), format_, doubt=doubt)
        if format_ != OF_DAY:  # a date alone: the time of day stands in another column, most often in the next one
            behind = names.index(name) + 1
            for other in sorted([*names[behind:], *names[: behind - 1]], key=lambda other: other not in called):
                if (clock := _joined(name, other, columns, doubt)) is not None:
                    return clock
            return TimeColumns((name,), format_, doubt=doubt)
    for name in [*called, *names[:3]]:  # by its cells too: it may be called "TimeElapsed" or "when"
        if guess_format(columns[name])[0] != OF_DAY:
            continue
        if (doubt := _may_be_minutes(columns[name])) and (in_unit := _in_unit(called, columns, unit_of)) is not None:
            return in_unit
        return TimeColumns((name,), OF_DAY, doubt=doubt)
    in_parts = _in_parts(columns, dated=False)
    stamps = [name for name in names if name not in called and _STAMPED.search(name) is not None]
    whole = [name for name in [*called, *stamps] if in_parts is None or name not in in_parts.columns]
    counted = [counted_clock(name, columns[name], unit_of[name], named=True) for name in whole]
    if clocks := [clock for clock in counted if clock is not None]:
        # one that counts minutes goes behind one that goes on from row to row
        return min(clocks, key=lambda clock: _stands(columns[clock.columns[0]]))
    if in_parts is not None:
        return in_parts
    for name in names[3:]:  # whatever it is called; where it stands still it is when something was made
        format_, doubt = guess_format(columns[name])
        if format_ is not None and _has_hours(format_, columns[name]) and len(set(columns[name])) > 1:
            return TimeColumns((name,), format_, doubt=doubt)
    if not_read(columns):
        return None  # the log has its times, and what merely rises beside them would be another's
    for name in (name for name in names if name not in called and not _is_other(name, unit_of[name])):
        if (clock := counted_clock(name, columns[name], unit_of[name], named=False)) is not None:
            return clock
    return None


def _may_be_minutes(cells: Sequence[str]) -> str:
    """What is in doubt of a time of day in two parts that counts from 0:00, as an elapsed time of minutes and seconds
    does too; nothing of any other."""
    parts = [found for cell in cells if (found := re.fullmatch(r"(\d+):(\d\d)", cell.strip())) is not None]
    if len(parts) < 0.9 * len(cells) or not parts or int(parts[0][1]) > 0:
        return ""
    return 'taken as hours and minutes; if they are minutes and seconds, say time_format = "%M:%S"'


def _in_unit(
    called: Sequence[str], columns: Mapping[str, Sequence[str]], unit_of: Mapping[str, str | None]
) -> TimeColumns | None:
    """The first column that is called a time and counts in a unit of time by its name; None where there is none."""
    counted = (counted_clock(name, columns[name], unit_of[name], named=True) for name in called)
    return next((clock for clock in counted if clock is not None and not clock.doubt), None)


def _below_sixty(cells: Sequence[str]) -> bool:
    """Whether a column's numbers are seconds of a minute that another column counts."""
    return all(NUMBER.fullmatch(cell) is not None and 0.0 <= float(cell) < 60.0 for cell in cells)


def _numbers(cells: Sequence[str]) -> NDArray[np.float64]:
    """Cells (n,) as numbers, NaN where they are none."""
    return np.array([float(text) if NUMBER.fullmatch(text := cell.strip()) else np.nan for cell in cells])


def _stands(cells: Sequence[str]) -> bool:
    """Whether a column stays what it is over many rows."""
    return sum(a == b for a, b in pairwise(cells)) > MOST_STAND * len(cells)


def unit_of_clock(name: str, under: str) -> str | None:
    """The unit of a column of times by its name, or by what a line of units says `under` it."""
    return unit_in_name(name) or unit_in_name(f"x [{under}]")


def not_read(columns: Mapping[str, Sequence[str]]) -> tuple[str, str] | None:
    """A column that is called a time and says when in a way that is not known, and a cell of it; None where none is."""
    for name in filter(is_called_time, columns):
        cells = [cell.strip() for cell in columns[name] if re.search(r"\d\D+\d", cell)]
        own = [cell for cell in cells if NUMBER.fullmatch(cell.replace(",", ".")) is None]
        if len(own) > len(columns[name]) / 2 and len(set(own)) > 1 and guess_format(own)[0] is None:
            return name, own[0]
    return None


def _has_hours(format_: str, cells: Sequence[str]) -> bool:
    """Whether a column of dates says the time of day as well."""
    return "%H" in format_ or "%I" in format_ or (format_ == ISO and any(":" in cell for cell in cells))


def _in_parts(columns: Mapping[str, Sequence[str]], dated: bool = True) -> TimeColumns | None:
    """A clock whose year, month, day, hour and whatever follows stand in a column each, or, of one that is not `dated`,
    the hour, minute and second; None where one of these is not there."""

    def column(called: Sequence[str]) -> str | None:
        return next((name for name in columns if name.strip("#") in called or name.lower() in called[:2]), None)

    found = {part: column(called) for part, called in _PARTS.items() if dated or part in _OF_A_DAY}
    there = [(name, part) for part, name in found.items() if name is not None]
    if any(found[part] is None for part in (("%Y", "%m", "%d", "%H") if dated else _OF_A_DAY)):
        return None
    if any(_share(lambda text: NUMBER.fullmatch(text) is not None, columns[name]) < 0.9 for name, _ in there):
        return None
    last, part = there[-1]
    if part == "%S" and _share(lambda text: "." in text, columns[last]) > 0.9:
        there[-1] = last, "%S.%f"
    return TimeColumns(tuple(name for name, _ in there), " ".join(part for _, part in there))


def counters(names: Iterable[str]) -> list[str]:
    """Names of columns that count rows: nothing says how many seconds pass from one to the next."""
    words = {name: {word.lower() for word in re.findall("[A-Z]?[a-z]+|[A-Z]+|#", name)} for name in names}
    return [name for name, said in words.items() if said and all(map(_COUNT.fullmatch, said))]


def _is_other(name: str, unit: str | None) -> bool:
    """Whether a column is none of times by its name, however steadily it rises: it counts rows, or is called a
    pressure, an altitude or whatever else is read."""
    if unit in UNITS["time"] or is_called_time(name):
        return False
    if re.search(r"[\[(]", name):  # a unit, that is none of time
        return True
    return bool(counters([name])) or squeeze(bare_name(name)) in _READ or quantity_of(name, unit) is not None


def guess_format(cells: Sequence[str], may_be_iso: bool = True) -> tuple[str | None, str]:
    """Format of a column of dates or times of day, and what is in doubt; None where they are neither."""
    texts = [half_day(cell.strip()) for cell in cells if cell.strip()]
    if not texts or sum(NUMBER.fullmatch(text) is not None for text in texts) > len(texts) / 2:
        return None, ""
    some = texts[:: max(1, len(texts) // 40)]
    zones = Counter(found[1] for text in some if (found := _ZONE.search(text)))
    zone, count = zones.most_common(1)[0] if zones else ("", 0)
    if count > 0.9 * len(some):
        format_, doubt = guess_format([text.replace(zone, "", 1) for text in some], may_be_iso=False)
        return (None if format_ in (None, OF_DAY) else re.sub("( %Y)?$", rf"{zone}\1", format_, count=1)), doubt
    days = [found for text in some if (found := _WEEKDAY.match(text))]
    if len(days) > 0.9 * len(some):
        format_, doubt = guess_format([_WEEKDAY.sub("", text) for text in some], may_be_iso=False)
        before = ("%A" if days[0][1] else "%a") + days[0][2]
        return (None if format_ in (None, OF_DAY) else before + format_), doubt
    if may_be_iso and _share(_is_iso, some) > 0.9:
        return ISO, ""
    if _share(lambda text: re.fullmatch(r"\d{1,3}:\d{1,2}(:\d{1,2}([.,]\d+|:\d{3})?)?", text) is not None, some) > 0.9:
        return OF_DAY, ""
    every = [day + (between + hour if hour else "") for day, between, hour in product(_DATES, _BETWEEN, (*_TIMES, ""))]
    few = some[0], some[len(some) // 2], some[-1]  # the first one may be of a clock that was not set yet
    fitting = [
        f
        for f in dict.fromkeys([*every, *_YEAR_LAST])
        if any(_like(t, f) and _fits(t, f) for t in few) and sum(_fits(t, f) for t in some) > 0.9 * len(some)
    ]
    if not fitting:
        return None, ""
    # Day and month the wrong way round make a log of hours last for months, or go back.
    spans = {format_: _span_s(some, format_) for format_ in fitting}
    least = min(spans.values())
    best = [format_ for format_ in spans if spans[format_] <= least * 1.01 + 1.0]
    doubt = ""
    if len({format_.find("%d") < format_.find("%m") for format_ in best if "%m" in format_}) > 1:
        american = "%p" in best[0]
        best.sort(key=lambda format_: (format_.find("%d") < format_.find("%m")) == american)
        first, second = ("month", "day") if american else ("day", "month")
        doubt = f"the {first} is taken to stand before the {second}; nothing in the log tells"
    return best[0], doubt


def two_ways(rows: Sequence[Sequence[str]]) -> tuple[str, str] | None:
    """A date of the first and one of the last of some rows that are written in two ways, as where a table was edited
    in part; None where there are none."""
    ends = rows[: max(1, len(rows) // 4)], rows[-max(1, len(rows) // 4) :]
    for place in range(len(rows[0]) if rows else 0):
        first, last = (guess_format([row[place] for row in part])[0] for part in ends)
        if None not in (first, last) and first != last:
            return ends[0][0][place], ends[1][-1][place]
    return None


def _joined(date_: str, time_: str, columns: Mapping[str, Sequence[str]], doubt: str) -> TimeColumns | None:
    """The clock of a date and a time of day in a column each; None where the second is none."""
    if _share(lambda text: ":" in text, columns[time_]) < 0.5:
        return None
    both = [f"{a.strip()} {b.strip()}" for a, b in zip(columns[date_], columns[time_], strict=True)]
    format_, doubt_both = guess_format(both)
    if format_ is None and guess_format(columns[time_])[0] != OF_DAY:
        return None
    return TimeColumns((date_, time_), format_ or ISO, doubt=doubt or doubt_both)


def counted_clock(name: str, cells: Sequence[str], unit: str | None, named: bool) -> TimeColumns | None:
    """A clock of plain numbers: `named` a time by what it is called or by a person, or ever rising; None where there is
    none in these cells."""
    texts = [cell.strip().replace(",", ".") for cell in cells]
    in_cells = unit_in_cells(texts)
    if in_cells in UNITS["time"]:
        unit, texts = unit or in_cells, [m.group() if (m := NUMBER.match(text)) else text for text in texts]
    if _share(lambda text: NUMBER.fullmatch(text) is not None, texts) < 0.9:
        return None
    values = np.array([float(text) for text in texts if NUMBER.fullmatch(text)])
    if values.size < 2:
        return None
    called = bare_name(name).lower()
    # What merely falls is no clock, unless its name says so: a t in degC, or a t alone, is as soon a temperature.
    if named and len(called) > 1 and (unit is None or unit in UNITS["time"]) and newest_first(values):
        values = values[::-1]
    steps = np.diff(values)
    if not (steps >= 0).mean() > 0.95 or values[-1] <= values[0] or (not named and not (steps > 0).mean() > 0.95):
        return None
    if not named and (steps < 0).any() and values.min() >= 0 and values.max() < 60:
        return None  # seconds of a minute that another column has
    for epoch_unit, (low, high) in EPOCH.items():
        if low < np.median(values) < high:
            return TimeColumns((name,), NUMBERS, epoch_unit, since_1970=True)
    if unit not in UNITS["time"] and len(called) > 1:  # called by nothing but its unit; a letter may be any quantity's
        unit = known_unit("ms" if called == "tms" else called)
    time_unit = unit if unit in UNITS["time"] else None
    if time_unit is not None:
        return TimeColumns((name,), NUMBERS, time_unit)
    doubt = (
        "no unit is named; taken as seconds" if named else "its name is none of times, but it rises; taken as seconds"
    )
    near = steps[: SAMPLE_LINES - 1]  # from row to row: those between were picked at wider distances
    step = float(np.median(near[near > 0] if (near > 0).any() else steps[steps > 0]))
    if step >= 20 and (values == np.round(values)).all():
        doubt += f', of which {step:g} pass between readings: if they are ms, say time_unit = "ms"'
    if (whose := _days_of(values)) is not None and named:
        if _DATED.search(called) is not None or step < LEAST_STEP_S:
            return TimeColumns((name,), NUMBERS, "days", doubt=f"no unit is named; taken as {whose} days")
        doubt += f'; if they are {whose} days, say time_unit = "days"'
    return TimeColumns((name,), NUMBERS, "s", doubt=doubt, known="stated" if named else RISING)


def _days_of(values: NDArray[np.float64]) -> str | None:
    """Whose days numbers may be that count dates with the time of day behind the point; None where they cannot be."""
    if (values == np.round(values)).all():
        return None
    low, high = (limit * UNITS["time"]["s"][0] / UNITS["time"]["days"][0] for limit in EPOCH["s"])
    return next((whose for whose, day in DAY_1970.items() if low < np.median(values) - day < high), None)


def _share(test: Callable[[str], bool], texts: Sequence[str]) -> float:
    return sum(map(bool, map(test, texts))) / len(texts) if texts else 0.0


def _is_iso(text: str) -> bool:
    if not re.match(r"\d{4}-\d{2}-\d{2}", text):
        return False
    try:
        datetime.fromisoformat(text)
    except ValueError:
        return False
    return True


def _like(text: str, format_: str) -> bool:
    """Whether a text without blanks at its ends has the letters and marks of a format; strptime, which compiles a
    pattern for each format anew, is then asked."""
    if ("%p" in format_) != (re.search(" [ap]m$", text, re.I) is not None):
        return False
    worded = "%b" in format_ or "%p" in format_
    if any(map(str.isalpha, text)) != (worded or "T" in format_):
        return False
    without = "." if worded else ""  # a language may shorten its words by points
    return _marks(text, without) == _marks(re.sub("%[A-Za-z]", "", format_), without)


def _marks(text: str, without: str) -> str:
    return "".join(c for c in text if not (c.isalnum() or c.isspace() or c in without))


def _fits(text: str, format_: str) -> bool:
    try:
        _moment(text, format_)
    except ValueError:
        return False
    return True


def _moment(text: str, format_: str) -> datetime:
    return datetime.strptime(re.sub(r"(\.\d{6})\d+", r"\1", text), format_).replace(tzinfo=UTC)


def _span_s(texts: Sequence[str], format_: str) -> float:
    moments = [_moment(text, format_).timestamp() for text in texts if _fits(text, format_)]
    pairs = list(zip(moments, moments[1:], strict=False))
    turns = min(sum(b < a for a, b in pairs), sum(b > a for a, b in pairs))  # the newest row may stand on top
    return max(moments) - min(moments) + 1e9 * (turns > len(moments) / 4)
