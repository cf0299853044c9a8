"""Lines of a log whose readings stand behind their names, made rows of a table in the places where they stood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from shockrig.files.named_readings import SAMPLE_LINES, named_readings
from shockrig.rig.logs.lines import Index, Lines


@dataclass(frozen=True)
class Unfolded:
    """Lines as rows of a table, in the places where they stood, with commas between cells; its columns' `names`, and
    those that are `said` in the lines: the first column may be the stamps beside them."""

    lines: Lines
    names: tuple[str, ...]
    said: tuple[str, ...]


def unfolded(lines: Lines) -> Unfolded | None:
    """The readings of a log that stand behind their names; None of a log whose columns have them."""
    middle = len(lines) // 2
    seen = named_readings((lines[:SAMPLE_LINES], lines[middle : middle + SAMPLE_LINES], lines[-SAMPLE_LINES:]))
    if seen is None:
        return None
    rows = (",".join(row) if row is not None else "" for row in seen.rows(lines))
    # a line between those of a record is a part of it; by itself it is one that could not be read
    content = "\n".join(row or ("" if seen.by_lines else line) for row, line in zip(rows, lines, strict=True)).encode()
    ends = np.flatnonzero(np.frombuffer(content, np.uint8) == ord("\n")) + 1
    begins: Index = np.concatenate([[0], ends, [len(content) + 1]]).astype(np.uint32)
    return Unfolded(Lines(content, begins, lines.places), (*["1"] * seen.stamped, *seen.columns), seen.columns)
