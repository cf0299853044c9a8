"""Stated airs that are not those in which the probes stood: each end of a run, where a sensor was at rest in it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from shockrig.analysis.checks.finding import InputFinding, limit
from shockrig.analysis.checks.signals import (
    CHANNEL_OF,
    COLUMNS,
    DIE,
    FILES,
    HUMIDITY,
    TEMPERATURE,
    UNITS,
    CampaignView,
    ColumnSeen,
    stated,
)

REST_PARTS = 4  # of a rest, of which the last is what a sensor read there
LEAST_READINGS = 8
LEAST_SHARE_LEFT = 0.75  # share of a sensor's runs with which nothing else is wrong


def airs_disagree(view: CampaignView) -> Iterator[InputFinding]:
    """Runs in which a sensor stood further from its stated air than calibration, heat and water explain.

    Where most runs agree with their airs these are wrong, and stop; where hardly any does it may be the sensor.
    """
    for column in (TEMPERATURE, HUMIDITY):
        off, agree = {}, 0
        recorded = sum(getattr(run, COLUMNS[column][0]) is not None for run in view.campaign.runs)
        if len(view.column(column)) < LEAST_SHARE_LEFT * recorded:
            continue  # what stopped the others is what is wrong with the sensor
        for seen in view.column(column):
            found = [place for place in (_source(seen), _destination(seen)) if place is not None]
            wrong = [said for said, far in found if far]
            if wrong:
                off[seen.run.id] = wrong[0]
            elif found:
                agree += 1
        if off:
            certain = agree >= 2 * len(off)
            first, said = next(iter(off.items()))
            yield InputFinding(
                "airs_disagree",
                CHANNEL_OF[column],
                tuple(off),
                "stop" if certain else "warn",
                f"The airs in run.json of {view.words(off)} are not those in which the probes stood (in run {first} "
                f"{FILES[column]} {said}): correct them, or record these runs again.",
            )


def airs_off_both(view: CampaignView) -> Iterator[InputFinding]:
    """Airs that two thermometers find off by the same amount.

    It is less than a wet or heated thermometer is off by itself. But bead and die are of two makers, so that what both
    read at rest is the air.
    """
    off: dict[str, float] = {}
    compared = 0
    for run in view.campaign.runs:
        both = [seen for column in (TEMPERATURE, DIE) if (seen := view.get(run, column)) is not None]
        start_s, temperatures = run.start_s, stated(run, TEMPERATURE)
        if len(both) < 2 or start_s is None or run.air is not None:
            continue
        alone = [told for told in (_source(both[0]), _destination(both[0])) if told is not None]
        if any(disagrees for _, disagrees in alone):
            continue  # the bead has said so by itself
        for air, late in zip(temperatures, (False, True), strict=True):
            if air is None:
                continue
            half_s = [0.5 * (start_s + float(seen.time_s[-1])) for seen in both]
            there = [s.time_s > h if late else s.time_s < start_s for s, h in zip(both, half_s, strict=True)]
            stood = [_at_rest(seen, inside) for seen, inside in zip(both, there, strict=True)]
            if None in stood:
                continue
            compared += 1
            bead, die = (float(value) - air for value in stood if value is not None)
            mean = 0.5 * (bead + die)
            if abs(mean) >= limit("both_off_k") and abs(bead - die) <= limit("both_alike") * abs(mean):
                off.setdefault(run.id, mean)
    if off and len(off) >= 0.5 * compared / 2:
        typical = float(np.median(list(off.values())))
        yield InputFinding(
            "airs_disagree",
            None,
            tuple(off),
            "warn",
            f"Bead and die at rest read {abs(typical):.2g} K {'more' if typical > 0 else 'less'} than the airs in "
            f"run.json of {view.words(off)}, both of them: the stated temperatures seem to be "
            f"{'too low' if typical > 0 else 'too high'}; check what measured them, D and the response times depend on "
            "it.",
        )


def _source(seen: ColumnSeen) -> tuple[str, bool] | None:
    """What is to be said of the air that a run begins in, and whether it disagrees; None where it tells nothing."""
    source, start_s = stated(seen.run, seen.column)[0], seen.run.start_s
    if source is None or start_s is None or seen.run.air is not None:
        return None
    stood = _at_rest(seen, seen.time_s < start_s)
    return None if stood is None else _judged(seen, "source", stood, source, 0.0)


def _destination(seen: ColumnSeen) -> tuple[str, bool] | None:
    source, destination = stated(seen.run, seen.column)
    if destination is None or seen.run.start_s is None or seen.run.air is not None:
        return None
    half = 0.5 * (seen.run.start_s + float(seen.time_s[-1]))
    stood = _at_rest(seen, seen.time_s > half)
    on_the_way = 0.5 * abs(destination - source) if source is not None else 0.0
    return None if stood is None else _judged(seen, "destination", stood, destination, on_the_way)


def _judged(seen: ColumnSeen, place: str, stood: float, air: float, on_the_way: float) -> tuple[str, bool]:
    unit = UNITS[seen.column]
    far = abs(stood - air) > _allowed(seen) + on_the_way
    return f"stands at {stood:.1f} {unit} in the {place} air, which is said to have {air:.1f} {unit}", far


def _allowed(seen: ColumnSeen) -> float:
    return limit("stood_percent" if seen.column == HUMIDITY else "stood_k")


def _at_rest(seen: ColumnSeen, there: np.ndarray) -> float | None:
    """What a sensor read at the end of a rest; None where it had not come to one, for all that its own pace tells."""
    time, value = seen.time_s[there], seen.value[there]
    if value.size < LEAST_READINGS:
        return None
    parts = [float(np.median(part)) for part in np.array_split(value, REST_PARTS)[-2:]]
    drift = abs(parts[-1] - parts[-2]) / max(float(time[-1] - time[0]) / REST_PARTS, 1e-9)
    rise_s = seen.crossing_s(0.63) - seen.crossing_s(0.1) if seen.moves else 0.0
    window_s = float(time[-1] - time[0])
    # A slow sensor that drifts no faster than noise may still be far from where it goes.
    return parts[-1] if drift * max(3.0 * rise_s, window_s) < 0.25 * _allowed(seen) else None
