"""Flights whose readings stand behind their names, made CSV files: each name becomes a column, and the columns of a
table that has such a text in it, as radiosondy.info exports APRS comments, stay."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from itertools import chain, islice, tee
from pathlib import Path

from shockrig.files.disk import open_text
from shockrig.files.flight import REMEDY, without_nul
from shockrig.files.named_readings import NAMED, SAMPLE_LINES, named_readings

SEPARATORS = ";,\t"


def unfold(source: Path, target: Path) -> tuple[str, ...] | None:
    """Write a log whose readings stand behind their names as a CSV file; the names that were found, None of any other.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    with open_text(source, REMEDY, errors="replace") as stream:
        kept, rows = _table(islice(without_nul(stream), SAMPLE_LINES))
        seen = named_readings([[text for _, text in rows]])
    if seen is None:
        return None
    # the columns of a table have its time
    stamp = ["time"] * (seen.stamped and not kept)
    with (
        open_text(source, REMEDY, errors="replace") as stream,
        target.open("w", newline="", encoding="utf-8") as written,
    ):
        writer = csv.writer(written, lineterminator="\n")
        beside, texts = tee(_table(without_nul(stream))[1])
        writer.writerow([*kept, *stamp, *seen.columns])
        for (cells, _), row in zip(beside, seen.rows(text for _, text in texts), strict=True):
            if row is not None:
                writer.writerow([*cells, *row[seen.stamped - len(stamp) :]])
    return (*stamp, *seen.columns)


def _table(lines: Iterator[str]) -> tuple[list[str], Iterator[tuple[Sequence[str], str]]]:
    """The other columns' names of a table whose first line has no such readings, and of each row its other cells and
    all of its text; no names and no cells of lines that are nothing but readings."""
    first = next(lines, "")
    separator = max(SEPARATORS, key=first.count)
    if NAMED.search(first) or not first.count(separator):
        return [], (((), text) for text in chain([first], lines))
    header = next(csv.reader([first], delimiter=separator))
    width = len(header)

    def rows() -> Iterator[tuple[Sequence[str], str]]:
        for cells in csv.reader(lines, delimiter=separator):
            # a blank behind it: no comma between two cells is a decimal one
            yield [*cells, *[""] * width][:width], f"{separator} ".join(cells)

    return header, rows()
