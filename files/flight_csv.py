"""Writes a corrected flight as CSV: the log's own rows as they came, with the corrected columns after them."""

from __future__ import annotations

import contextlib
import csv
import os
from pathlib import Path

from shockrig.files.disk import beside
from shockrig.files.flight import OUTPUT_COLUMNS, Corrected, Flight, FlightColumns


def text_columns(corrected: Corrected) -> list[list[str]]:
    """OUTPUT_COLUMNS as text, a value that cannot be given empty."""
    numbers = (
        (corrected.temperature_c, "%.4f"),
        (corrected.temperature_uncertainty_k, "%.4f"),
        (corrected.humidity_percent, "%.4f"),
        (corrected.humidity_uncertainty_percent, "%.4f"),
    )
    columns = [["" if value != value else form % value for value in values.tolist()] for values, form in numbers]
    return [*columns, corrected.flag_texts()]


class CsvWriter:
    """Writes rows as they come; `close` puts the whole file in its place, `discard` leaves none."""

    def __init__(self, path: Path, layout: FlightColumns) -> None:
        self.path, self._temporary = path, beside(path)
        self._stream = open(self._temporary, "w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._stream, lineterminator="\n")
        self._writer.writerow([*layout.header, *OUTPUT_COLUMNS])

    def write(self, rows: list[list[str]], flight: Flight, corrected: Corrected) -> None:
        columns = text_columns(corrected)
        self._writer.writerows([*row, *new] for row, new in zip(rows, zip(*columns, strict=True), strict=True))

    def close(self) -> None:
        self._stream.close()
        os.replace(self._temporary, self.path)

    def discard(self) -> None:
        # On a full disk closing fails as well; what was begun goes all the same.
        with contextlib.suppress(OSError):
            self._stream.close()
        self._temporary.unlink(missing_ok=True)
