"""Whether a soak has come to rest: the reference's airs and the probes' own readings over its window."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from shockrig.rig.protocol import Soak
from shockrig.rig.seams import Air

SATURATED_PERCENT = 99.0


def unsettled(
    step: Soak, airs: Sequence[Air], good: Mapping[str, deque[tuple[float, float, float]]], now_s: float
) -> str:
    """What is still moving at the end of a soak's window; empty where nothing is.

    `airs` are the reference's over the window; `good` each sensor's readings as (time_s, temperature_c,
    humidity_percent), NaN for what it does not give.
    """
    for name, unit, limit in (
        ("temperature_c", "K", step.reference_within_k),
        ("humidity_percent", "%RH", step.reference_within_percent),
    ):
        known = [value for air in airs if (value := getattr(air, name)) is not None]
        if known and max(known) - min(known) > limit:
            return f"the reference moved by {max(known) - min(known):.3g} {unit} in {step.over_s:g} s"
    middle_s = now_s - 0.5 * step.over_s
    for sensor, readings in good.items():
        first = [reading for reading in readings if reading[0] < middle_s]
        second = [reading for reading in readings if reading[0] >= middle_s]
        if not first or not second:
            return f"{sensor} gives no good readings"
        for column, unit, limit in ((1, "K", step.probes_within_k), (2, "%RH", step.probes_within_percent)):
            early, late = (sum(reading[column] for reading in half) / len(half) for half in (first, second))
            if abs(late - early) > limit:  # never where the sensor does not give that quantity (nan)
                return f"{sensor} still moves by {abs(late - early):.3g} {unit} in {0.5 * step.over_s:g} s"
            expected = airs[-1].humidity_percent
            if unit == "%RH" and late > SATURATED_PERCENT and expected is not None and expected < SATURATED_PERCENT:
                return f"{sensor} is saturated"  # which is as steady as settled
    return ""
