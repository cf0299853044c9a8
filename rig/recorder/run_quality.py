"""Whether a run counts: the readings that came, and whether its probes stood in the airs that it states.

From the journal alone, so that a run that is recovered later is judged alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median

from shockrig.rig.protocol import Faults
from shockrig.rig.recorder.run_journal import RunRecord, columns_of, count_outcomes, is_good, sample_time_s
from shockrig.rig.seams import Air, Outcome

PLATEAU_S = 5.0  # the last seconds in an air, over which a probe's readings are averaged
SETTLED_SHARE = 0.25  # of what is allowed: a probe that moves by more from one such mean to the next is on its way


def judge(record: RunRecord, faults: Faults) -> str | None:
    """Why a run that ran to its end is spoilt (faults of its sensors, airs that cannot be); None where it is good."""
    zero_s, end_s = record.zero_s, record.last_s
    if zero_s is None or record.move is None:
        return "the transfer was not recorded"
    for sensor in record.header.get("sensors", ()):
        tried = record.recorded(sensor)
        good_s = [sample_time_s(r) for r in tried if is_good(r)]
        outcomes = ", ".join(f"{n} {outcome}" for outcome, n in sorted(count_outcomes(tried).items()))
        if len(good_s) < 2:
            return f"{sensor} gave no readings ({outcomes or 'silence'})"
        edges = [zero_s, *good_s, end_s]
        gaps = [(late - early, early) for early, late in zip(edges, edges[1:], strict=False)]
        gap_s, at_s = max(gaps)
        period_s = _period_s([gap for gap, _ in gaps[1:-1]])  # a slow sensor is not a broken one
        if gap_s > max(faults.largest_gap_s, 2.5 * period_s):
            return f"{sensor} gave no good reading for {gap_s:.1f} s at {at_s - zero_s:.1f} s ({outcomes})"
        failed = sum(r.outcome not in (Outcome.OK, Outcome.REJECTED) for r in tried)
        # Lines that are lost or rejected leave no failed reading: they show in the number that came.
        lost = max(failed, (end_s - zero_s) / period_s - len(good_s))
        missing_percent = 100.0 * lost / (lost + len(good_s))
        if missing_percent > faults.missing_percent_at_most:
            return f"{sensor}: {missing_percent:.1f} % of the readings are missing ({outcomes})"
    return _airs_denied(record, faults)


def _airs_denied(record: RunRecord, faults: Faults) -> str | None:
    """Why the airs that the run states cannot be those in which its probes stood; None where they can.

    A probe is compared with the source air where it stood before the transfer, and with the destination air at the end,
    where it has settled; a part of it that follows late may leave it half of the way short.
    """
    limits = {
        "temperature_c": ("degC", faults.airs_within_k),
        "humidity_percent": ("%RH", faults.airs_within_percent),
    }
    for sensor in record.header.get("sensors", ()):
        name = columns_of(sensor)[0]
        unit, allowed = limits[name]
        stated = [mean_of(record.airs[place], name) for place in ("source", "destination")]
        source, destination = stated
        for place, air in zip(("source", "destination"), stated, strict=True):
            stood = _stood(record, sensor, name, place, allowed)
            if air is None or stood is None:
                continue
            on_the_way = 0.5 * abs(air - source) if place == "destination" and source is not None else 0.0
            if abs(stood - air) > allowed + on_the_way:
                origins = record.header.get("airs_from")
                how = f" ({origins.get(place)})" if isinstance(origins, dict) else ""
                said = f"which is said to have {air:.1f} {unit}{how}"
                return f"{sensor} stood at {stood:.1f} {unit} in the {place} air, {said}"
    return None


def _stood(record: RunRecord, sensor: str, name: str, place: str, allowed: float) -> float | None:
    """What a sensor read at the end of its time in an air; None where it read nothing then, or was still on its way."""
    assert record.move is not None
    until_s = record.move.start_s if place == "source" else record.last_s
    since_s = -math.inf if place == "source" else record.move.end_s or record.move.start_s
    halves: tuple[list[float], list[float]] = ([], [])
    for reading in record.recorded(sensor):
        ago_s = until_s - sample_time_s(reading)
        if is_good(reading) and name in reading.values and 0.0 <= ago_s < min(2 * PLATEAU_S, until_s - since_s):
            halves[ago_s < PLATEAU_S].append(reading.values[name])
    before, last = (sum(half) / len(half) if half else None for half in halves)
    if place == "destination" and (last is None or before is None or abs(last - before) > SETTLED_SHARE * allowed):
        return None
    return last


def mean_of(airs: Sequence[Air], name: str) -> float | None:
    """Mean of a quantity over what the reference said; None where it never knew it."""
    known = [value for air in airs if (value := getattr(air, name)) is not None]
    return sum(known) / len(known) if known else None


def _period_s(gaps_s: list[float]) -> float:
    """A sensor's own period: the median gap, unless many are much shorter: then most of its readings are missing."""
    gaps_s = sorted(gaps_s)
    short_s = gaps_s[len(gaps_s) // 10]
    return median(gaps_s) if short_s > 0.7 * median(gaps_s) else short_s
