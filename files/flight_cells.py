"""The rows of a log as text with the numbers of its columns, read in blocks: memory does not grow with the flight.

Plain lines (no quotes, all their cells) stay the lines they are, and cells.c reads their numbers; every other line, and
every line where that was not built, is the csv module's.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from shockrig.files.compiled import demand_current
from shockrig.files.disk import open_regular, open_text, shown
from shockrig.files.errors import InputError
from shockrig.files.flight import REMEDY, FlightColumns, without_nul

try:
    from shockrig.files import _cells

    demand_current(_cells)
except ImportError:  # built where there is a compiler
    _cells = None  # type: ignore[assignment]

Array = NDArray[np.float64]
CHUNK = 1 << 20  # bytes that are read at a time
LONGEST_LINE = 100_000  # bytes; the csv module takes no longer cell than 131072
MORE, OTHER, QUOTED = range(3)  # why cells.c stops: for more text, at a line for the csv module, at one where a row of
# several lines may begin


@dataclass(frozen=True)
class Rows:
    """Rows of a log.

    Attributes
    ----------
    text : list
        Of each row its line, where that holds its cells between commas, else its cells.
    line, size : ndarray (n,)
        Number of its line, and how many cells it has there; those that lack are empty in `text`.
    numbers : dict
        Place of each quantity's column -> its numbers (n,), NaN where there is none.
    strange : frozenset
        Places of those columns that may hold anything but numbers and empty cells.
    """

    text: list[str | list[str]]
    line: NDArray[np.int64]
    size: NDArray[np.int64]
    numbers: dict[int, Array]
    strange: frozenset[int]

    def __len__(self) -> int:
        return len(self.text)

    def __getitem__(self, part: slice) -> Rows:
        numbers = {place: values[part] for place, values in self.numbers.items()}
        return Rows(self.text[part], self.line[part], self.size[part], numbers, self.strange)

    def cell(self, row: int, place: int) -> str:
        """One of the cells."""
        text = self.text[row]
        return text.split(",")[place] if isinstance(text, str) else text[place]

    def cells(self, place: int) -> list[str]:
        """A column."""
        return [(one.split(",") if isinstance(one, str) else one)[place] for one in self.text]

    def table(self) -> list[list[str]]:
        """All cells, row by row."""
        return [one.split(",") if isinstance(one, str) else one for one in self.text]


def joined(parts: Sequence[Rows]) -> Rows:
    """Rows one after another."""
    if len(parts) == 1:
        return parts[0]
    text = [one for part in parts for one in part.text]
    line, size = (np.concatenate([getattr(part, name) for part in parts]) for name in ("line", "size"))
    numbers = {place: np.concatenate([part.numbers[place] for part in parts]) for place in parts[0].numbers}
    return Rows(text, line, size, numbers, frozenset().union(*(part.strange for part in parts)))


def of_cells(rows: Sequence[list[str]], layout: FlightColumns, line: Sequence[int] | None = None) -> Rows:
    """Rows that are cells already; those that lack at the end are empty."""
    size = np.array([len(row) for row in rows], dtype=np.int64)
    width = len(layout.header)
    filled = [row if len(row) == width else row + [""] * (width - len(row)) for row in rows]
    places = frozenset(layout.place.values())
    numbers = {place: numbers_of(row[place] for row in filled) for place in places}
    number = np.arange(len(rows)) if line is None else np.asarray(line, dtype=np.int64)
    return Rows(list(filled), number, size, numbers, places)


def read_blocks(path: Path, layout: FlightColumns, rows: int) -> Iterator[Rows]:
    """The file's rows under its header that are not empty, `rows` at a time.

    Raises
    ------
    InputError
        It cannot be read, or a row has more cells than the header.
    """
    waiting: list[Rows] = []
    count = 0
    pieces = _by_csv(path, layout) if _cells is None else _pieces(path, layout, rows)
    for piece in pieces:
        waiting.append(piece)
        count += len(piece)
        while count >= rows:
            whole = joined(waiting)
            yield whole[:rows]
            waiting, count = [whole[rows:]], count - rows
    if count:
        yield joined(waiting)


def _pieces(path: Path, layout: FlightColumns, most: int) -> Iterator[Rows]:
    """The file's rows, in pieces of at most `most`, as they come."""
    assert _cells is not None
    places = np.array(sorted(set(layout.place.values())), dtype=np.int64)
    width = len(layout.header)
    with open_regular(path, REMEDY) as file:
        data = file.read(CHUNK)
        header = 0 if layout.raw_xq2 else _plain_header(data)
        if header is None or width < 2:
            yield from _by_csv(path, layout)
            return
        at, line, position = header, 1 if layout.raw_xq2 else 2, 0
        ended = False
        while True:
            out = np.empty((places.size, most))
            strange = np.zeros(places.size, dtype=np.int8)
            count, stop, kind = _cells.read(data, at, LONGEST_LINE, width, places, out, strange)
            if count:
                yield _read(data[at:stop], line, count, layout, places, out, strange)
                at, line = stop, line + count
            if kind == QUOTED:
                yield from _rest(file, position + at, path, layout, line)
                return
            if kind == OTHER:
                end = data.index(b"\n", at) + 1
                text = data[at:end].decode("utf-8-sig" if position + at == 0 else "utf-8", errors="replace")
                yield from _of_lines([text], path, layout, line - 1)
                at, line = end, line + 1
            elif count < most:
                if ended:
                    return
                more = file.read(CHUNK)
                ended = not more
                if ended and at < len(data):
                    more = b"\n"
                position, data, at = position + at, data[at:] + more, 0


def _plain_header(data: bytes) -> int | None:
    """Where the line after the header begins; None where the header may go on."""
    end = data.find(b"\n") + 1
    line = data[:end]
    return None if not end or b'"' in line or b"\0" in line or b"\r" in line[:-2] else end


def _read(
    data: bytes,
    line: int,
    count: int,
    layout: FlightColumns,
    places: NDArray[np.int64],
    out: Array,
    strange: NDArray[np.int8],
) -> Rows:
    text = data.decode("ascii").replace("\r\n", "\n").split("\n")
    text.pop()
    numbers, odd = {}, frozenset(places[strange != 0].tolist())
    for k, place in enumerate(places.tolist()):
        numbers[place] = numbers_of(one.split(",")[place] for one in text) if place in odd else out[k, :count]
    size = np.full(count, len(layout.header))
    return Rows(list(text), np.arange(line, line + count), size, numbers, odd)


def _rest(file: BinaryIO, position: int, path: Path, layout: FlightColumns, line: int) -> Iterator[Rows]:
    """The rows from a position of the file on, the first of which is in a line of that number."""
    file.seek(position)
    encoding = "utf-8" if position else "utf-8-sig"
    stream = io.TextIOWrapper(file, encoding=encoding, errors="replace", newline="")
    try:
        yield from _of_lines(stream, path, layout, line - 1)
    finally:
        stream.detach()


def _by_csv(path: Path, layout: FlightColumns) -> Iterator[Rows]:
    with open_text(path, REMEDY, errors="replace") as stream:
        yield from _of_lines(stream, path, layout, 0, not layout.raw_xq2)


def _of_lines(
    lines: Iterable[str], path: Path, layout: FlightColumns, before: int, header: bool = False, most: int = 5000
) -> Iterator[Rows]:
    """Rows of lines, `before` which there were so many in the file, perhaps under a `header`."""
    width = len(layout.header)
    reader = csv.reader(without_nul(lines))

    def numbered() -> Iterator[tuple[int, list[str]]]:
        try:
            if header:
                next(reader)
            for row in reader:
                if len(row) > width:
                    raise InputError(
                        f"{shown(path)}, line {before + reader.line_num}: {len(row)} cells under {width} columns; "
                        "fix or delete the line"
                    )
                if row:
                    yield before + reader.line_num, row
        except csv.Error as error:
            where = f"{shown(path)}, line {before + reader.line_num}"
            raise InputError(f"{where}: {error}; fix or delete the line") from error

    found = numbered()
    while block := list(islice(found, most)):
        yield of_cells([row for _, row in block], layout, [line for line, _ in block])


def plain_numbers(data: bytes, width: int, columns: Sequence[int], rows: int) -> Array | None:
    """Columns (c, n) of so many lines of `width` cells, NaN where a cell is empty.

    None where any of the lines is not plain, or one of the cells neither a number nor empty, or nothing was compiled.
    """
    places, where = np.unique(np.array(columns, dtype=np.int64), return_inverse=True)
    if _cells is None or width < 2 or not places.size:
        return None
    out, strange = np.empty((places.size, rows)), np.zeros(places.size, dtype=np.int8)
    count, _, _ = _cells.read(data, 0, LONGEST_LINE, width, places, out, strange)
    return out[where] if count == rows and not strange.any() else None


def numbers_of(cells: Iterable[str]) -> Array:
    """Numbers of cells as `number_of` reads them, NaN where there is none or it is beyond every number."""
    cells = list(cells)
    try:
        read = number_of if "_" in "".join(cells) else float
        values = np.array(list(map(read, cells)), dtype=np.float64)  # three times as fast as NumPy from text
    except ValueError:
        values = np.array([np.nan if (number := number_of(cell)) is None else number for cell in cells])
    values[~np.isfinite(values)] = np.nan
    return values


def number_of(cell: str) -> float | None:
    """The number of a cell as `float` reads it, also "nan" and what is beyond every number; None where it is none, such
    as 2024_3_27, that Python takes for twenty million."""
    try:
        return None if "_" in cell else float(cell)
    except ValueError:
        return None
