"""Writes a corrected flight as CSV: the log's own rows as they came, with the corrected columns after them."""

from __future__ import annotations

import contextlib
import csv
import io
import os
from pathlib import Path

import numpy as np

from shockrig.files.disk import beside
from shockrig.files.flight import OUTPUT_COLUMNS, Corrected, Flight, FlightColumns
from shockrig.files.flight_cells import Rows


class CsvWriter:
    """Writes rows as they come; `close` puts the whole file in its place, `discard` leaves none."""

    def __init__(self, path: Path, layout: FlightColumns) -> None:
        self.path, self._temporary = path, beside(path)
        self._stream = open(self._temporary, "w", newline="", encoding="utf-8")
        self._row = io.StringIO(newline="")
        self._writer = csv.writer(self._row, lineterminator="")
        self._stream.write(self._quoted([*layout.header, *OUTPUT_COLUMNS]) + "\n")

    def write(self, rows: Rows, flight: Flight, corrected: Corrected) -> None:
        """Append rows; a value that cannot be given is empty."""
        values = (
            corrected.temperature_c,
            corrected.temperature_uncertainty_k,
            corrected.humidity_percent,
            corrected.humidity_uncertainty_percent,
        )
        known = np.isfinite(values).all(axis=0).tolist()
        columns = (rows.text, known, *(one.tolist() for one in values), corrected.flag_texts())
        write = self._stream.write
        lines: list[str] = []
        for text, whole, a, b, c, d, flags in zip(*columns, strict=True):
            line = text if isinstance(text, str) else self._quoted(text)
            if whole:
                lines.append(f"{line},{a:.4f},{b:.4f},{c:.4f},{d:.4f},{flags}\n")
            else:
                lines.append(f"{line},{','.join('' if v != v else f'{v:.4f}' for v in (a, b, c, d))},{flags}\n")
        write("".join(lines))

    def _quoted(self, cells: list[str]) -> str:
        """A row of CSV, with quotes where a cell needs them."""
        self._row.seek(0)
        self._row.truncate()
        self._writer.writerow(cells)
        return self._row.getvalue()

    def close(self) -> None:
        self._stream.close()
        os.replace(self._temporary, self.path)

    def discard(self) -> None:
        # On a full disk closing fails as well; what was begun goes all the same.
        with contextlib.suppress(OSError):
            self._stream.close()
        self._temporary.unlink(missing_ok=True)
