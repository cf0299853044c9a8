"""From the bytes of a log to lines of cells: encoding, separator, decimal sign, header, and what is none of the data.

Nothing is presumed but that most lines are rows of the same number of cells: whatever stands above them is metadata,
the last lines of it that have as many cells are the header (names, perhaps units), and whatever else stands between
rows is counted.
"""

from __future__ import annotations

import csv
import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import shown
from shockrig.files.named_readings import SAMPLE_LINES
from shockrig.files.sentinels import NO_VALUE_WORDS
from shockrig.files.spelling import did_you_mean
from shockrig.files.unit_names import (
    UNITS,
    is_called_time,
    is_unit,
    known_unit,
    quantity_of,
    unique_names,
    unit_among,
    unit_by_letter,
)
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.logs.behind_names import unfolded
from shockrig.rig.logs.lines import Index, Lines, read_lines

SEPARATORS = {"tab": "\t", "semicolon": ";", "comma": ",", "bar": "|", "space": " "}
COMMENTS = ("#", "//", "%", "!", "*")
NO_NUMBER = (*NO_VALUE_WORDS, "nan", "nil", "inf", "-inf", "+inf", "err", "error", "ol")
BEHIND = re.compile(r"[,;]+(?=\s|$)")  # "17:58:47 22.4, 50.1": blanks part the cells, and commas stand behind some
# "# name 0 = t: Time [s]"
LISTED = re.compile(r"\W*(?:name|field|column|channel)\s*\d+\s*[:=]\s*(?:\S+: )?(.+?)\s*$", re.I)
PROCESSING = {"", "ts", "rn", "smp", "avg", "max", "min", "std", "tot", "med"}  # under names, of Campbell's loggers

NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
DATE = re.compile(
    r"(?=.*\d)[\d:/.,\-+ T]+(Z|[ap]\.?\s?m\.?)?|.*(jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)[a-z]*[ /.-].*\d",
    re.I,
)


@dataclass(frozen=True)
class Layout:
    """How a log is laid out; None is found out. `header_line` counts from 1; 0 says that there is no header. `only` are
    columns and what must stand in them: other rows are another sensor's. `may_be_one`: times are told otherwise, and a
    column of readings is enough."""

    separator: str | None = None
    decimal: str | None = None
    header_line: int | None = None
    comment: str | None = None
    missing: tuple[str, ...] = ()
    only: tuple[tuple[str, str], ...] = ()
    may_be_one: bool = False


@dataclass(frozen=True)
class Scan:
    """A log as lines: where its rows are and what its columns are called.

    `names` are unique: of columns that share a name the later ones are "name #2" and so on; `units` are what stands
    in a row of its own under the names. `rows` are the lines of the data, and `unheld` the names behind those, of which
    no row holds a cell. `behind` are the names where they stand in the lines themselves, before each reading.
    """

    path: Path
    separator: str
    decimal: str
    header_line: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    metadata: tuple[str, ...]
    rows: Lines
    odd: dict[str, tuple[int, int]]  # reason -> (how many lines, the first one's number)
    unheld: tuple[str, ...] = ()
    behind: tuple[str, ...] = ()

    def cells(self, rows: Iterable[str]) -> list[list[str]]:
        """Lines of the data as stripped cells."""
        width = len(self.names)
        return [[cell.strip() for cell in _split(row, self.separator)[:width]] for row in rows]

    @property
    def numbers(self) -> Index:
        """The rows' numbers in the file, from 1."""
        return self.rows.numbers

    def cell(self, row: int, name: str) -> str:
        """What stands in one row of a column."""
        return self.cells([self.rows[row]])[0][self.names.index(name)]

    def sample(self) -> list[list[str]]:
        """Some rows as cells: the first ones, the last ones, and some between."""
        return self.cells(_some(self.rows))


def scan(path: Path, layout: Layout) -> Scan:
    """Find the rows and the header of a log.

    Raises
    ------
    BenchError
        There are no rows with a time and a value in it, or it is not text: names the file, the line, the remedy.
    """
    try:
        return _scan(path, layout)
    except csv.Error as error:
        raise BenchError(f"{shown(path)}: {error}; is it a text file of readings? Export it as CSV") from None


def _scan(path: Path, layout: Layout) -> Scan:
    lines = read_lines(path)
    stated = layout.separator is not None or layout.header_line is not None
    behind = None if stated else unfolded(lines)
    if behind is not None:
        lines, layout = behind.lines, replace(layout, separator="comma")
    prefixes = (layout.comment,) if layout.comment else COMMENTS
    is_kept = np.fromiter((bool(line) and not line.isspace() for line in lines), dtype=bool, count=len(lines))
    kept = lines.where(is_kept)
    if not len(kept):
        raise BenchError(f"{shown(path)}: is empty; expected a header and rows of a time and values")
    is_plain = (not line.lstrip(' "').startswith(prefixes) for line in kept)
    plain = kept.where(np.fromiter(is_plain, dtype=bool, count=len(kept)))
    separator = _separator(plain, layout)
    counts = np.fromiter((_count(line, separator) for line in plain), dtype=np.int32, count=len(plain))
    width = _usual(_some(plain), separator) or int(layout.may_be_one)
    if not width:
        raise BenchError(
            f"{shown(path)}: no rows of two cells or more (times and readings); give its separator in the map, [log] "
            f"separator = one of {', '.join(SEPARATORS)}, or, where it holds readings alone, the seconds from one to "
            "the next, every_s = 1.0"
        )
    first = _first_row(plain, np.flatnonzero(counts == width), separator, layout)
    if first is None:
        raise BenchError(f"{shown(path)}: no rows of numbers in it; expected a time and values, one row a reading")
    if behind is not None:
        names, units, header_line, header = behind.names, ("",) * width, plain.number(first), None
    else:
        names, units, header_line = _header(lines, kept, plain, first, separator, width, layout)
        header = _split(lines[header_line - 1], separator) if header_line else None
    fuller = _fuller_rows(plain, counts, first, separator, width, header, header_line)
    first = min([first, *fuller])
    good = np.ones(len(plain), dtype=bool)
    good[:first] = False
    odd: dict[str, tuple[int, int]] = {}
    between = [i for i in range(first) if header_line and plain.number(i) > header_line]
    values = [i for i in between if sum(map(is_value, _split(plain[i], separator))) > counts[i] / 2]
    for i, line in ((i, plain[i]) for i in (*values, *range(first, len(plain)))):
        if counts[i] != width and i not in fuller:
            reason = "of another number of cells"
        elif header is not None and header[0] in line and _split(line, separator) == header:
            reason = "that repeat the header"
        else:
            continue
        good[i] = False
        count, where = odd.get(reason, (0, plain.number(i)))
        odd[reason] = (count + 1, where)
    for only in layout.only:
        good &= _of_one(plain, good, separator, names, only, odd, path)
    rows = plain.where(good)
    above = int(np.searchsorted(kept.places, plain.places[first]))
    metadata = tuple(kept[i].strip() for i in range(above) if kept.number(i) != header_line)
    decimal = layout.decimal or _decimal(_some(rows), separator)
    named = [cell.strip() for cell in header or ()]
    unheld = tuple(filter(None, named[width:])) if sum(map(bool, named)) > width else ()
    said = () if behind is None else behind.said
    return Scan(path, separator, decimal, header_line, names, units, metadata, rows, odd, unheld, said)


def _of_one(
    plain: Lines,
    good: NDArray[np.bool_],
    separator: str,
    names: Sequence[str],
    only: tuple[str, str],
    odd: dict[str, tuple[int, int]],
    path: Path,
) -> NDArray[np.bool_]:
    """Which lines are of the one sensor that a map wants; the others are counted in `odd`."""
    column, wanted = only
    if column not in names:
        raise BenchError(f"{shown(path)}: no column {column!r}{did_you_mean(column, names)} to tell sensors apart by")
    place = names.index(column)
    mine = good.copy()
    for i in map(int, np.flatnonzero(good)):
        mine[i] = _split(plain[i], separator)[place].strip() == wanted
    others = np.flatnonzero(good & ~mine)
    if not mine.any():
        raise BenchError(f"{shown(path)}: no row has {wanted!r} in the column {column!r}; fix [log] only in the map")
    if others.size:
        odd[f"of another {column} than {wanted}"] = others.size, plain.number(int(others[0]))
    return mine


def _fuller_rows(
    plain: Lines,
    counts: NDArray[np.int32],
    first: int,
    separator: str,
    width: int,
    header: list[str] | None,
    header_line: int,
) -> set[int]:
    """Indices of rows that fill all of a header which most rows, `width` cells wide, fill a part of: where the first of
    these has numbers they have values. The columns behind are of few rows, such as where and when a session was."""
    if header is None or len(header) <= width:
        return set()
    numbers = [k for k, cell in enumerate(_split(plain[first], separator)) if _is_number(cell.strip())]
    there = (i for i in np.flatnonzero(counts == len(header)).tolist() if plain.number(i) > header_line)
    cells = ((i, _split(plain[i], separator)) for i in there)
    return {i for i, row in cells if all(is_value(row[k]) for k in numbers)}


def is_value(cell: str) -> bool:
    """Whether a cell may hold a value: a number (its unit may follow), a date, a time, or a word for a missing one."""
    text = cell.strip().strip('"')
    return text.lower() in NO_NUMBER or DATE.fullmatch(text) is not None or _is_number(text)


def _is_number(text: str) -> bool:
    """Whether a text is a number, or one with its unit, as some loggers write into every cell."""
    number = NUMBER.match(text)
    return number is not None and (number.end() == len(text) or is_unit(text[number.end() :]))


def unit_said(lines: Scan, place: int, rows: Sequence[Sequence[str]] = ()) -> str | None:
    """The unit that a log names of a column: under its name, in it, in the cells of some rows or in a column of units
    beside it."""
    under, name = known_unit(lines.units[place]), lines.names[place]
    by_letter, _ = unit_by_letter(name, lines.names)
    said = under or unit_among(name, lines.names) or unit_in_cells([row[place] for row in rows]) or by_letter
    if said is None and (beside := units_of(lines.names, place)) is not None:
        cells = {row[beside] for row in rows}
        said = known_unit(*cells) if len(cells) == 1 else None
    return said


def units_of(names: Sequence[str], place: int) -> int | None:
    """The place of the column that holds the units of another: "Temp_Unit" behind "Temp", "unit" on either side of it,
    where both sides have one behind it if the last column is one; None where there is none."""
    before, behind = (0 <= k < len(names) and is_of_units(names[k]) for k in (place - 1, place + 1))
    if is_of_units(names[place]) or not (before or behind):
        return None
    named_after = behind and not names[place + 1].lower().startswith("unit")
    return place + 1 if named_after or behind and (not before or is_of_units(names[-1])) else place - 1


def is_of_units(name: str) -> bool:
    """Whether a column is called by the word for units: "Unit", "units", "Temp_Unit"."""
    return re.match(r"unit|.*[ _]units?( #\d+)?$", name, re.I) is not None


def unit_in_cells(cells: Sequence[str]) -> str | None:
    """The unit that most of a column's cells carry behind their number; None where they carry none.

    A k behind a number is as often a thousand ohm as a kelvin, and kelvin are told by the readings.
    """
    texts = [cell.strip() for cell in cells]
    found = Counter(known_unit(text[m.end() :]) for text in texts if (m := NUMBER.match(text)) is not None)
    unit, count = found.most_common(1)[0] if found else (None, 0)
    return None if unit == "K" or count <= len(texts) / 2 else unit


def _some(lines: Sequence[str]) -> Sequence[str]:
    if len(lines) <= 3 * SAMPLE_LINES:
        return lines
    middle = range(SAMPLE_LINES, len(lines) - SAMPLE_LINES, max(1, len(lines) // SAMPLE_LINES))
    return [*lines[:SAMPLE_LINES], *(lines[i] for i in middle), *lines[-SAMPLE_LINES:]]


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        return BEHIND.sub("", line).split()
    if '"' in line:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return line.split(separator)


def _count(line: str, separator: str) -> int:
    return len(_split(line, separator)) if '"' in line or separator == " " else line.count(separator) + 1


def _usual(lines: Sequence[str], separator: str) -> int:
    """How many cells most rows have; a line of one is none, as the notes that some loggers print between them."""
    counts = Counter(cells for line in lines if (cells := _count(line, separator)) > 1)
    return counts.most_common(1)[0][0] if counts else 0


def _separator(lines: Sequence[str], layout: Layout) -> str:
    """The separator by which most lines have the same number of cells and most cells are values, some of them numbers:
    blanks part a date from its time of day, and leave none."""
    if layout.separator is not None:
        return SEPARATORS[layout.separator]
    some = _some(lines)
    best, best_score, best_width = ",", 0.0, 0
    for separator in SEPARATORS.values():
        width = _usual(some, separator)
        if width < 2 or separator == " " and best == "\t" and width == best_width:  # tabs are blanks too
            continue
        cells = [_split(line, separator) for line in some if _count(line, separator) == width]
        if sum(any(_is_number(cell.strip()) for cell in row) for row in cells) < 0.5 * len(cells):
            continue
        good = sum(map(is_value, (cell for row in cells for cell in row))) / (width * len(cells))
        score = good * len(cells) / len(some)
        if score > best_score + 1e-9:
            best, best_score, best_width = separator, score, width
    return best


def _first_row(plain: Lines, whole: NDArray[np.intp], separator: str, layout: Layout) -> int | None:
    """Index of the first row of data: the columns that hold values nearly everywhere hold values in it.

    Rows before it that bear a stamp and words for missing values, from a sensor that did not answer yet, are data too:
    they would be taken for the header.
    """
    some = [_split(plain[i], separator) for i in whole[:: max(1, whole.size // (3 * SAMPLE_LINES))]]
    width = len(some[0])
    value_columns = [k for k in range(width) if sum(is_value(row[k]) for row in some) >= 0.8 * len(some) - 1]
    silent_since: int | None = None
    for i in map(int, whole):
        if layout.header_line is not None and plain.number(i) <= layout.header_line:
            continue
        row = _split(plain[i], separator)
        texts = [row[k].strip().strip('"') for k in value_columns]
        if not texts or not all(map(is_value, texts)):
            silent_since = None
        elif any(map(_is_number, texts)):
            return i if silent_since is None else silent_since
        elif all(text.lower() in NO_NUMBER for text in texts):
            silent_since = None
        elif silent_since is None:
            silent_since = i
    return None


def _header(
    lines: Lines,
    kept: Lines,
    plain: Lines,
    first: int,
    separator: str,
    width: int,
    layout: Layout,
) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    """Names, units and the line of the names (0 where there are none, and the columns have numbers)."""
    units = nothing = ("",) * width
    ends_at = _ends(plain[first : first + SAMPLE_LINES], width) if separator == " " else None

    def cells(line: str) -> list[str]:
        """Names may be parted otherwise than rows: by commas above tabs."""
        found = _split(line, separator)
        if len(found) == 1:
            others = (_split(line, other) for other in SEPARATORS.values())
            found = next((other for other in others if len(other) == width), found)
        if separator == " " and len(found) != width and ends_at is not None:
            found = _by_place(line, ends_at) or found
        if len(found) > width and sum(map(bool, map(str.strip, found))) == width:  # moved to the right by tabs
            found = list(filter(str.strip, found))
        return [cell.strip() for cell in found]

    def aligned(names: list[str]) -> list[str]:
        """One name too few: it stands above two columns that blanks part, a date and its time of day or minutes and
        seconds; else, where no separator ends the rows, the first column, row names or stamps, has none."""
        rows = [cells(line) for line in plain[first : first + SAMPLE_LINES]]
        if separator == " " and len(names) == width - 1:
            for k in (k for k, name in enumerate(names) if is_called_time(name)):
                dated = _share_with(":", rows, k) < 0.5 < _share_with(":", rows, k + 1)
                if dated or all(known_unit(unit) in UNITS["time"] for unit in units[k : k + 2]):
                    return [*names[: k + 1], *names[k:]]
        ends = any(len(row) == width and row[-1] for row in rows)
        short = len(names) == width - 1 and ends and not is_called_time(names[0])
        return ["", *names] if short else names

    if layout.header_line == 0:
        return tuple(str(k + 1) for k in range(width)), nothing, 0
    if layout.header_line is not None:
        line = lines[layout.header_line - 1] if layout.header_line <= len(lines) else ""
        return unique_names(aligned(cells(line)), width), nothing, layout.header_line
    over = kept[: int(np.searchsorted(kept.places, plain.places[first]))]
    named = [(match[1], over.number(i)) for i, line in enumerate(over) if (match := LISTED.match(line))]
    if len(named) == width:  # a line each, as Sea-Bird and Lockheed Martin write them
        return unique_names([name for name, _ in named], width), nothing, named[-1][1]
    for i in range(first - 1, -1, -1):
        found = cells(plain[i])
        if len(found) not in (width, width - 1):
            # The last columns may have none, as of sensors that somebody added to a logger's program, or the pixels of
            # a camera; but blanks also part a date from its time of day, under one name.
            are_names = separator != " " and all(found) and not any(map(is_value, found))
            if i == first - 1 and are_names and len(found) < width and (_tell(found) or len(found) > width / 2):
                return unique_names(found, width), units, plain.number(i)
            break
        above = i > 0 and len(cells(plain[i - 1])) in (width, width - 1)
        said = sum(is_unit(cell) for cell in found)
        # "MM/DD/YY" and "deg" are no units here, but stand among such
        if above and (said > len(found) / 3 or all(cell.strip("[]()").lower() in PROCESSING for cell in found)):
            if said:
                units = tuple((found + [""])[:width])
            continue
        if said > len(found) / 2 or _is_a_row(found, [cells(line) for line in plain[first : first + SAMPLE_LINES]]):
            break
        return unique_names(aligned(found), width), units, plain.number(i)
    # The names may stand in a comment: "# time temperature humidity".
    for i in reversed(range(len(over))):
        found = cells(over[i].lstrip("".join(COMMENTS) + " "))
        if sum(map(is_unit, found)) > len(found) / 2:  # under more names than a row has cells
            units = tuple((found + [""] * width)[:width])
            continue
        # Whoever writes names and rows apart may name more than a row holds, or than all but the first one do.
        whole = len(found) == width or (len(found) > width and any(map(is_called_time, found)))
        whole |= separator != " " and all(found) and _tell(found)
        if whole and not any(cell[:1].isdecimal() and is_value(cell) for cell in found):
            return unique_names(found, width), units, over.number(i)
    return tuple(str(k + 1) for k in range(width)), nothing, 0


def _tell(names: Sequence[str]) -> bool:
    """Whether some texts are names, since one is of a time and one of something that is read."""
    return any(map(is_called_time, names)) and any(quantity_of(name, None) for name in names)


def _is_a_row(found: Sequence[str], rows: Sequence[Sequence[str]]) -> bool:
    """Whether a line holds a reading with its unit where rows hold readings of that unit: it is none of names."""
    columns = zip(*(row for row in rows if len(row) == len(rows[0])), strict=True)
    pairs = ((unit_in_cells([cell]), column) for cell, column in zip(found, columns, strict=False))
    return any(unit is not None and unit == unit_in_cells(column) for unit, column in pairs)


def _share_with(mark: str, rows: Sequence[Sequence[str]], place: int) -> float:
    """Of the rows that reach a place, the share whose cell there has a mark in it."""
    cells = [row[place] for row in rows if len(row) > place]
    return sum(mark in cell for cell in cells) / max(len(cells), 1)


def _ends(rows: Sequence[str], width: int) -> tuple[int, ...] | None:
    """Where the columns of rows that blanks part end; None where they do not so in the same places in all rows."""
    ends = {tuple(word.end() for word in re.finditer(r"\S+", row)) for row in rows}
    whole = [one for one in ends if len(one) == width]
    return whole[0] if len(whole) == 1 else None


def _by_place(line: str, ends_at: Sequence[int]) -> list[str] | None:
    """Names or units above columns, which end as these do: one may be of several words, and some may lack. None where
    they do not end there."""
    cells, ends = [""] * len(ends_at), list(ends_at)
    for word in re.finditer(r"\S+", line):
        place = bisect_left(ends_at, word.end())
        if place == len(ends_at):
            return None
        cells[place], ends[place] = f"{cells[place]} {word.group()}".strip(), word.end()
    return cells if ends == list(ends_at) and sum(map(bool, cells)) > len(cells) / 2 else None


def _decimal(rows: Sequence[str], separator: str) -> str:
    """A comma where cells such as 21,5 are and cells such as 21.5 are not."""
    cells = [cell.strip() for row in rows for cell in _split(row, separator)]
    commas = sum(re.fullmatch(r"[+-]?\d+,\d+", cell) is not None for cell in cells)
    points = sum(re.fullmatch(r"[+-]?\d+\.\d+", cell) is not None for cell in cells)
    return "," if commas > points else "."
