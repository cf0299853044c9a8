"""Readings that stand behind their names, as boards, debug ports and APRS comments have them, made rows of a table:
"[12:00:01] Temperature: 23.5 C, Humidity: 41 %", "t=15.2C h=83.8%", "Time:184|Temp:23", JSON, or a line for each.

What a terminal or a logger puts beside them, "12:04:33.120 -> t:23.41" or "1351 - t:23.41", is their time.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from shockrig.files.unit_names import known_unit, quantity_of, unique_names

_DAY = r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}"
# 9:05, and with seconds also 9:5:3, as sketches print it
_HOUR = r"\d{1,2}:(?:\d{2}(?!:)|\d{1,2}:\d{1,2}(?:[.,]\d+)?)(?:\s?[AaPp][Mm]\b)?(?:Z|[+-]\d{2}:?\d{2})?"
STAMP = re.compile(rf"(?<![\d.:/-]){_DAY}(?:(?:T|,?\s+){_HOUR})?(?![\d:])|(?<![\d:]){_HOUR}(?![\d:])")
_NAME = r"[A-Za-z]\w{0,24}(?: [A-Za-z]\w{0,24}){0,2}(?: \d{1,2})?(?:\s?[\[(][^\])]{1,9}[\])])?"  # and its unit
# no unit: "Soil" of "Soil Humidity: 122" behind a number, but "C" of "C Humidity: 41"
_NEXT = r"(?!(?!Celsius|Kelvin|Fahrenheit|Percent)[A-Z][a-z]+(?: [A-Za-z]\w{0,24}){1,2}(?: \d{1,2})?\s?[=:])"
# a name, what it is told apart by, a time or a number, and a unit
NAMED = re.compile(
    rf"(?<![\w.°*])(?:(?:and|und|y|et) )?({_NAME})"
    r"[\"']{0,2}(?:\s{0,3}[=:]\s{0,3}|\.\s)\[?[\"']{0,2}"  # "Temp. 18.46" too
    rf"(?:({STAMP.pattern})|([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)(?!\d|[.:,]\d)"
    rf"\s?((?:[°º*]\s?)?{_NEXT}[A-Za-z]{{1,10}}(?:/[A-Za-z]{{1,4}})?\b(?!\s?[=:])|%)?)"
)
LONGEST = 4000  # characters of a line: no board prints more, and a whole file of JSON may stand in one
SAMPLE_LINES = 200  # that tell which names there are
MOST = 0.5  # of the lines, that hold a name; of the records, that hold each name, or go on in a further line


@dataclass(frozen=True)
class _Held:
    """What a line holds: name -> value and unit, and the rest of its text."""

    values: dict[str, tuple[str, str]]
    rest: str


@dataclass(frozen=True)
class NamedReadings:
    """How a log holds readings behind their `names`: what the columns made of these are called (and their units),
    whether a time is `stamped` beside them, and whether a record stands on several lines."""

    names: tuple[str, ...]
    columns: tuple[str, ...]
    stamped: bool
    by_lines: bool

    def rows(self, lines: Iterable[str]) -> Iterator[list[str] | None]:
        """For each line the cells of the record that begins there, its stamp first where there is one; None where none
        begins."""
        held = map(_held, lines)
        mine = (_Held({name: one.values[name] for name in self.names if name in one.values}, one.rest) for one in held)
        for record in _records(mine) if self.by_lines else mine:
            if record is None or not record.values:
                yield None
                continue
            cells = [record.values.get(name, ("", ""))[0] for name in self.names]
            yield [(_stamp(record.rest) or "").replace(",", " "), *cells] if self.stamped else cells


def named_readings(stretches: Iterable[Iterable[str]]) -> NamedReadings | None:
    """How some stretches of a log's lines hold readings; None of a log that has no temperature or humidity so, and of
    one record, as settings are.

    A record ends where a name comes again. Names are those that most records have.
    """
    held = [[_held(line) for line in stretch if line.strip()] for stretch in stretches]
    some = [one for stretch in held for one in stretch]
    speaking = sum(bool(one.values) for one in some)
    if speaking <= MOST * len(some):
        return None
    stamped = sum(_stamp(one.rest) is not None for one in some) > MOST * speaking
    by_stretch = [[one for one in _records(stretch) if one is not None and one.values] for stretch in held]
    if max(map(len, by_stretch)) < 2:  # settings
        return None
    records = [one for those in by_stretch for one in those]
    count = Counter(name for one in records for name in one.values)
    names = tuple(name for name, n in count.items() if n > MOST * len(records))
    columns = [_column(name, [one.values[name][1] for one in records if name in one.values]) for name in names]
    if not {"temperature", "humidity"} & {quantity_of(name, known_unit(unit)) for name, unit in columns}:
        return None
    called = unique_names([f"{name} ({unit})" if unit else name for name, unit in columns])
    return NamedReadings(names, called, stamped, by_lines=speaking - len(records) > MOST * len(records))


def _held(line: str) -> _Held:
    values: dict[str, tuple[str, str]] = {}
    if len(line) > LONGEST:
        return _Held(values, "")
    again: Counter[str] = Counter()
    for name, stamp, number, unit in (match.groups() for match in NAMED.finditer(line)):
        again[name] += 1
        values[name if again[name] == 1 else f"{name} #{again[name]}"] = stamp or number.replace(",", "."), unit or ""
    return _Held(values, NAMED.sub(" ", line))


def _stamp(rest: str) -> str | None:
    """The time that stands beside the readings of a line: a date, a time of day, or the one number; None if none."""
    if found := STAMP.findall(rest):
        return " ".join(found[:2])
    numbers = re.findall(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?![\w.])", rest)
    return numbers[0] if len(numbers) == 1 else None


def _column(name: str, units: Sequence[str]) -> tuple[str, str]:
    """A column's name and unit; a letter by itself ("t", "h") is what its unit measures."""
    unit = Counter(units).most_common(1)[0][0]
    unit = unit if known_unit(unit) else ""
    meant = quantity_of("1", known_unit(unit)) if len(name) == 1 else None
    return meant or name, unit


def _records(held: Iterable[_Held]) -> Iterator[_Held | None]:
    """For each line the record that begins there, up to the next line that has a name of it again; None where none
    begins. What the line itself holds stays as it is."""
    record: _Held | None = None
    waiting = 0
    for one in held:
        if one.values and (record is None or one.values.keys() & record.values.keys()):
            if record is not None:
                yield record
            yield from [None] * (waiting - (record is not None))
            record, waiting = _Held(dict(one.values), one.rest), 0
        elif record is not None:
            record.values.update(one.values)
        waiting += 1
    if record is not None:
        yield record
    yield from [None] * (waiting - (record is not None))
