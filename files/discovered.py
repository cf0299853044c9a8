"""An effect that nobody listed as files state it (`discovered`): read and written, in diagnoses and profiles alike."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from shockrig.files.causes import PROBABILITY, read_uncertain
from shockrig.files.diagnosis_data import BEHAVIOURS, DRIVERS, FACTORS, Dependence, Discovered, EffectSize, Likeness
from shockrig.files.file_table import FileTable, is_number
from shockrig.files.json_files import measured


def plain(value: Any) -> Any:
    """The same for a JSON file: dataclasses as objects, numbers to seven digits, what is unknown left out."""
    if hasattr(value, "tolist"):  # numpy's arrays and numbers
        return plain(value.tolist())
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return plain({field.name: getattr(value, field.name) for field in dataclasses.fields(value)})
    if isinstance(value, Mapping):
        items = {str(key): plain(item) for key, item in value.items()}
        return {key: item for key, item in items.items() if item is not None}
    if isinstance(value, list | tuple):
        if any(isinstance(item, float) and not math.isfinite(item) for item in value):
            return None  # a list whose places mean something cannot lose one of them
        return [plain(item) for item in value]
    return measured(value) if isinstance(value, float) else value


def read_discovered(item: FileTable) -> Discovered:
    """A described effect from one object of a file.

    Raises
    ------
    InputError
        Names the file, the key, what was expected, and the remedy.
    """
    size, nearest = item.child("size"), item.child("nearest_catalogued")
    return Discovered(
        behaves_as=item.word("behaves_as", BEHAVIOURS),
        driver=item.word("driver", DRIVERS),
        time_constant_s=read_uncertain(item, "time_constant_s"),
        period_s=read_uncertain(item, "period_s"),
        phase_rad=read_uncertain(item, "phase_rad"),
        size=None
        if size is None
        else EffectSize(
            size.demand("value", size.number("value")),
            size.number("standard_uncertainty", at_least=0.0) or 0.0,
            size.text("unit") or "1",
        ),
        depends_on=tuple(
            Dependence(
                on.word("factor", FACTORS),
                on.text("form") or "",
                on.number("value"),
                on.number("standard_uncertainty", at_least=0.0),
            )
            for on in item.items("depends_on")
        ),
        does_not_depend_on=item.texts("does_not_depend_on"),
        alternatives=tuple(read_discovered(other) for other in item.items("alternatives")),
        nearest_catalogued=None
        if nearest is None
        else Likeness(
            nearest.text("effect") or "", nearest.number("likeness", PROBABILITY) or 0.0, nearest.text("why_not") or ""
        ),
        probability=item.number("probability", PROBABILITY),
        explained_fraction=item.number("explained_fraction"),
        seen_over={
            name: ends
            for name in item.mapping("seen_over").content
            if (ends := interval(item.mapping("seen_over"), name)) is not None
        },
    )


def interval(item: FileTable, key: str) -> tuple[float, float] | None:
    """Two numbers, the lower one first; None where there are none."""
    ends = item.get(key)
    if ends is None:
        return None
    if not isinstance(ends, list) or len(ends) != 2 or not all(map(is_number, ends)) or ends[0] > ends[1]:
        raise item.error(key, "two numbers, the lower one first", ends)
    return float(ends[0]), float(ends[1])
