"""What a slip or limit of the paper is: measured cases beside the series."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SlipRow:
    """One measured case. None where a column does not apply; `exact` is the series, or what the right way gives."""

    case: str
    printed: float | int | None = None
    corrected: float | int | None = None
    high_order: float | None = None
    exact: float | None = None


@dataclass(frozen=True)
class Slip:
    """One slip or limit of the paper: what is taken as printed or by habit, the fix, the quantity, the measured rows.

    `relative` says that the columns are to be read as errors relative to `exact`, which `reference` names.
    """

    id: str
    title: str
    printed: str  # what is taken, as printed or by habit
    fix: str
    quantity: str
    rows: tuple[SlipRow, ...]
    relative: bool = False
    reference: str = "series"
