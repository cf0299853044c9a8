"""Lines of a log whose readings stand behind their names, made rows of a table: what a board prints on its serial line
("[12:00:01] Temperature: 23.5 C, Humidity: 41 %"), JSON, key=value.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from shockrig.files.unit_names import known_unit, quantity_of, unique_names
from shockrig.rig.logs.lines import Index, Lines

_DAY = r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}"
_HOUR = r"\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?(?:\s?[AaPp][Mm]\b)?(?:Z|[+-]\d{2}:?\d{2})?"
STAMP = re.compile(rf"(?<![\d.:/-]){_DAY}(?:(?:T|,?\s+){_HOUR})?(?![\d:])|(?<![\d:]){_HOUR}(?![\d:])")
_NAME = r"[A-Za-z]\w{0,24}(?: [A-Za-z]\w{0,24}){0,2}(?: \d{1,2})?(?:\s?[\[(][^\])]{1,9}[\])])?"  # and its unit
# a name, what it is told apart by, a time or a number, and a unit
NAMED = re.compile(
    rf"(?<![\w.°*])(?:(?:and|und|y|et) )?({_NAME})"
    r"[\"']{0,2}\s{0,3}[=:]\s{0,3}\[?[\"']{0,2}"
    rf"(?:({STAMP.pattern})|([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)(?!\d|[.:,]\d)"
    r"\s?((?:[°º*]\s?)?[A-Za-z]{1,10}\b(?!\s?[=:])|%)?)"
)
LONGEST = 4000  # characters of a line: no board prints more, and a whole file of JSON may stand in one
SAMPLE_LINES = 200  # at the beginning, in the middle and at the end
MOST = 0.5  # of the lines, that hold a name
AS_OFTEN = 0.9  # as the commonest, where each name has a line of its own


@dataclass(frozen=True)
class Unfolded:
    """Lines as rows of a table, in the places where they stood, with commas between cells; its columns' `names`, and
    those that are `said` in the lines: the first column may be the stamps beside them."""

    lines: Lines
    names: tuple[str, ...]
    said: tuple[str, ...]


@dataclass(frozen=True)
class _Held:
    """What a line holds: name -> value and unit, and the rest of its text."""

    values: dict[str, tuple[str, str]]
    rest: str


def unfolded(lines: Lines) -> Unfolded | None:
    """The readings of a log that stand behind their names; None of a log whose columns have them.

    Names are those that most lines have, or, where each has a line of its own, those that come as often: a record then
    ends where a name comes again.
    """
    middle = len(lines) // 2  # whole stretches: what has a line of its own comes every so many lines
    stretches = (lines[:SAMPLE_LINES], lines[middle : middle + SAMPLE_LINES], lines[-SAMPLE_LINES:])
    some = [_held(line) for stretch in stretches for line in stretch if line.strip()]
    count = Counter(name for one in some for name in one.values)
    if not count:
        return None
    names = [name for name, n in count.items() if n > MOST * len(some)]
    by_lines = not names
    if by_lines:
        often = max(count.values())
        names = [name for name, n in count.items() if n >= AS_OFTEN * often]
        alone = all(len(one.values) < 2 for one in some)
        if not alone or len(names) < 2 or len(names) * often <= MOST * len(some):
            return None
    columns = [_column(name, [one.values[name][1] for one in some if name in one.values]) for name in names]
    if not {"temperature", "humidity"} & {quantity_of(name, known_unit(unit)) for name, unit in columns}:
        return None
    stamped = sum(_stamp(one.rest) is not None for one in some) > MOST * sum(bool(one.values) for one in some)
    records = _records((_held(line) for line in lines), names, by_lines)
    rows = [_row(record, names, stamped) if record is not None else "" for record in records]
    content = "\n".join(row or ("" if by_lines else line) for row, line in zip(rows, lines, strict=True)).encode()
    ends = np.flatnonzero(np.frombuffer(content, np.uint8) == ord("\n")) + 1
    begins: Index = np.concatenate([[0], ends, [len(content) + 1]]).astype(np.uint32)
    called = unique_names([f"{name} ({unit})" if unit else name for name, unit in columns])
    return Unfolded(Lines(content, begins, lines.places), ("1", *called) if stamped else called, called)


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


def _records(held: Iterable[_Held], names: Sequence[str], by_lines: bool) -> Iterator[_Held | None]:
    """What each line begins: its own readings, or, of names that have a line each, the record up to the next one that
    has a name of it again; None where none begins."""
    if not by_lines:
        yield from (one if one.values.keys() & set(names) else None for one in held)
        return
    record: _Held | None = None
    waiting = 0
    for one in held:
        mine = {name: value for name, value in one.values.items() if name in names}
        if record is None or mine.keys() & record.values.keys():
            if waiting:
                yield record
                yield from [None] * (waiting - 1)
            record, waiting = (_Held(dict(mine), one.rest), 0) if mine else (None, 0)
            if record is None:
                yield None
                continue
        record.values.update(mine)
        waiting += 1
    if waiting:
        yield record
        yield from [None] * (waiting - 1)


def _row(record: _Held, names: Sequence[str], stamped: bool) -> str:
    cells = [record.values.get(name, ("", ""))[0] for name in names]
    return ",".join([*([(_stamp(record.rest) or "").replace(",", " ")] if stamped else []), *cells])
