"""Readings that stand behind their names, as APRS comments and debug ports have them: "t=15.2C h=83.8%",
"Time:184|Press:841|Temp:23", or a line each, "Temperature: 23.1" and "Humidity: 41", until one is there again.

Each name becomes a column, with the unit behind its numbers; the columns of a table that has such a text in it stay.
What a terminal puts before each line, "1351 - t:23.41" or "12:04:33.120 -> t:23.41", is its time.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, islice
from pathlib import Path

from shockrig.files.disk import open_text
from shockrig.files.flight import REMEDY, without_nul
from shockrig.files.unit_names import known_unit, quantity_of

NAMED = re.compile(
    r"(?<![A-Za-z0-9_.])([A-Za-z]\w{0,24})\s?[=:]\s?([-+]?\d+(?:\.\d+)?)\s?((?:[°*]?[A-Za-z]|%)[A-Za-z/]{0,6})?(?![\w.:])"
)
BEFORE = re.compile(r"\s*(\d[\d:.]*)\s*->?\s")
SAMPLE_LINES = 200  # that tell which names there are
MOST = 0.5  # of the lines, that hold a name
FEWEST_NAMES = 2  # on a line: one by itself may be a remark
SEPARATORS = ";,\t"


def unfold(source: Path, target: Path) -> tuple[str, ...] | None:
    """Write a log whose readings stand behind their names as a CSV file; the names that were found, None of any other.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    with open_text(source, REMEDY, errors="replace") as stream:
        lines = list(islice(without_nul(stream), SAMPLE_LINES))
    units: dict[str, Counter[str]] = {}
    count: Counter[str] = Counter()
    _, rows = _table(iter(lines))
    texts = [text for _, text in rows]
    for text in texts:
        found = {name: unit for name, _, unit in NAMED.findall(text)}
        count.update(found.keys())
        for name, unit in found.items():
            units.setdefault(name, Counter())[unit] += 1
    names = [name for name, rows_with in count.items() if rows_with > MOST * len(texts)]
    if len(names) < FEWEST_NAMES:
        return None
    timed = sum(BEFORE.match(text) is not None for text in texts) > MOST * len(texts)
    columns = [_column(name, units[name].most_common(1)[0][0]) for name in names]
    with (
        open_text(source, REMEDY, errors="replace") as stream,
        target.open("w", newline="", encoding="utf-8") as written,
    ):
        writer = csv.writer(written, lineterminator="\n")
        kept, rows = _table(without_nul(stream))
        writer.writerow([*kept, *(["time"] * timed), *columns])
        for cells, text in rows:
            number = {name: value for name, value, _ in NAMED.findall(text)}
            if number.keys() & set(names):
                before = [said[1] if (said := BEFORE.match(text)) else ""] * timed
                writer.writerow([*cells, *before, *(number.get(name, "") for name in names)])
    return ("time", *columns) if timed else tuple(columns)


def _column(name: str, unit: str) -> str:
    """The name of a column with its unit; a letter by itself ("t", "h") is what its unit measures."""
    meant = quantity_of("1", known_unit(unit)) if len(name) == 1 else None
    return f"{meant or name} ({unit})" if unit else name


def _table(lines: Iterator[str]) -> tuple[list[str], Iterator[tuple[Sequence[str], str]]]:
    """The other columns' names of a table whose first line has no such readings, and of each row its other cells and
    all of its text; no names and cells of lines that are nothing but readings, which are one row until a name is there
    again."""
    first = next(lines, "")
    separator = max(SEPARATORS, key=first.count)
    if NAMED.search(first) or not first.count(separator):
        return [], (((), text) for text in _together(chain([first], lines)))
    header = next(csv.reader([first], delimiter=separator))
    width = len(header)

    def rows() -> Iterator[tuple[Sequence[str], str]]:
        for cells in csv.reader(lines, delimiter=separator):
            yield [*cells, *[""] * width][:width], separator.join(cells)

    return header, rows()


def _together(lines: Iterable[str]) -> Iterator[str]:
    """Lines with names joined up to the next that has one of theirs again; what has none stays by itself."""
    row, names = "", set[str]()
    for line in lines:
        own = {name for name, _, _ in NAMED.findall(line)}
        if row and (own & names or not own):
            yield row
            row, names = "", set()
        if own:
            row, names = f"{row} {line.strip()}" if row else line.rstrip("\n"), names | own
        else:
            yield line
    if row:
        yield row
