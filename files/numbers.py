"""Numbers as a person writes them: as many digits as the uncertainty allows, powers of ten apart, a true minus sign; a
time as a date where it is one.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def plain(value: float | int | str | None, digits: int = 4) -> str:
    """`value` to `digits` significant digits; an en dash for None or what is not a number."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return str(value).replace("-", "−")
    value = float(value)
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    # rounded first, so that 9.9999 is 10.00 and not 10.000
    mantissa, exponent_text = f"{value:.{digits - 1}e}".split("e")
    exponent = int(exponent_text)
    if not -4 <= exponent < 6:
        return f"{mantissa} × 10{str(exponent).translate(_SUPERSCRIPT)}".replace("-", "−")
    return _number(value, max(0, digits - 1 - exponent))


def short(value: float, digits: int) -> str:
    """`value` to at least `digits` significant digits, and to whole ones where it has more before the point."""
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e+" in text else text


def measured(value: float, standard_uncertainty: float | None, unit: str = "") -> str:
    """Value ± one standard uncertainty (two digits of it) and the unit, e.g. "(7.500 ± 0.020) × 10⁻⁸ m²/s"."""
    tail = f" {unit}" if unit else ""
    if standard_uncertainty is None or not (standard_uncertainty > 0 and math.isfinite(standard_uncertainty)):
        return plain(value) + tail
    largest = max(abs(value), standard_uncertainty)
    exponent = 0 if 1e-3 <= largest < 1e5 else math.floor(math.log10(largest))
    scaled, spread = value / 10.0**exponent, standard_uncertainty / 10.0**exponent
    decimals = max(0, 1 - math.floor(math.log10(spread)))
    text = f"{_number(scaled, decimals)} ± {_number(spread, decimals)}"
    if exponent:
        text = f"({text}) × 10{str(exponent).translate(_SUPERSCRIPT)}"
    elif unit:
        text = f"({text})"
    return text + tail


def between(value: float, low: float, high: float, unit: str = "") -> str:
    """Value with the ends of its interval (two digits of the shorter side) and the unit, e.g. "7.5 (6.9 to 9.4) s"."""
    tail = f" {unit}" if unit else ""
    largest = max(abs(value), abs(low), abs(high))
    exponent = 0 if 1e-3 <= largest < 1e5 else math.floor(math.log10(largest))
    ends = [x / 10.0**exponent for x in (value, low, high)]
    shorter = min(ends[0] - ends[1], ends[2] - ends[0])
    decimals = max(0, 1 - math.floor(math.log10(shorter))) if shorter > 0 else 3
    middle, below, above = (_number(x, decimals) for x in ends)
    power = f" × 10{str(exponent).translate(_SUPERSCRIPT)}" if exponent else ""
    return f"{middle} ({below} to {above}){power}{tail}"


def power_of_ten(value: float) -> tuple[float, str]:
    """Scale of an axis that reaches `value`, and its power for the label ("10⁻¹² "; empty where none is needed)."""
    if value == 0 or 1e-2 <= abs(value) < 1e4:
        return 1.0, ""
    exponent = math.floor(math.log10(abs(value)))
    return 10.0**exponent, f"10{str(exponent).translate(_SUPERSCRIPT)} "


def _number(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}".replace("-", "−")


SINCE_1970_S = 5e8  # a clock that says more counts from 1970: it is of dates


def moment(time_s: float) -> str:
    """A time of a log: its date and time of day to the millisecond where it has one, else seconds."""
    if not SINCE_1970_S < time_s < math.inf:
        return f"{time_s:.10g} s"
    at = datetime.fromtimestamp(0, UTC) + timedelta(milliseconds=round(1e3 * time_s))
    return f"{at:%Y-%m-%d %H:%M:%S}{f'.{at.microsecond // 1000:03}'.rstrip('0').rstrip('.')} UTC"


def one_or_many(count: int, one: str, many: str) -> str:
    """A count with what is said of one and of several: "1 line is", "3 lines are"."""
    return f"{count} {one if count == 1 else many}"


def in_line(count: int, first: int) -> str:
    """Where one thing or the first of several is: "in line 7", "the first in line 7"."""
    return f"{'' if count == 1 else 'the first '}in line {first}"


def counted(count: int, noun: str) -> str:
    """A count with its noun: "1 run", "35 runs"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


MOST_NAMED = 6  # in one sentence


def first_of(names: Sequence[str]) -> str:
    """As many names as a sentence holds, with dots where there are more."""
    return ", ".join(names[:MOST_NAMED]) + (", ..." if len(names) > MOST_NAMED else "")
