"""Dead and saturated sensors: readings that stay while the air moves, or stop at a rail short of it."""

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
    mostly_impossible,
    stated,
)
from shockrig.analysis.checks.units import in_kelvin
from shockrig.files.campaign import Run


def impossible_readings(view: CampaignView) -> Iterator[InputFinding]:
    """Columns most of whose readings were dropped as beyond what a sensor can give (kelvin is named as such)."""
    for sensor, column in (("imet", TEMPERATURE), ("hyt", HUMIDITY)):
        lost, kelvin = {}, in_kelvin(view, sensor)
        for run in view.campaign.runs:
            trace = getattr(run, sensor)
            if trace is None or not mostly_impossible(trace):
                continue
            odd = [(n, x) for n, x in trace.impossible.items() if not (n == "temperature_c" and run.id in kelvin)]
            if odd:
                lost[run.id] = odd[0]
        if lost:
            name, value = next(iter(lost.values()))
            yield InputFinding(
                "dead_sensor",
                CHANNEL_OF[column],
                tuple(lost),
                "stop",
                f"Most readings of {FILES[column]} in {view.words(lost)} cannot be ({name} is {value:.6g}, say) and "
                "are dropped: the sensor is dead or not connected, or the column is another quantity.",
            )


def dead_sensors(view: CampaignView) -> Iterator[InputFinding]:
    """Readings that stay the same, or hardly move, although the air stepped or the sensor's other runs show noise.

    Where both thermometers show noise and neither a step it is the air that did not step.
    """
    calm = {column: {seen.run.id for seen in view.column(column) if _is_calm(view, seen)} for column in COLUMNS}
    for column in COLUMNS:
        columns = view.column(column)
        lively = [seen for seen in columns if _share_of_mode(seen) < 0.5]
        unmoved = calm[column] - (calm[TEMPERATURE] & calm[DIE])
        dead = []
        for seen in columns:
            stepped = abs(_air_step(view, seen)) >= _large(column)
            if _is_stuck(seen) and (stepped or (column != DIE and len(lively) > 0.5 * len(columns))):
                dead.append(seen)
            elif stepped and seen.run.id in unmoved:
                dead.append(seen)
        if not dead and len(columns) > 1 and all(map(_is_stuck, columns)):
            dead = columns if column != DIE and _others_move(view, column) else []
        if dead:
            yield _dead(view, column, dead)


def saturated_sensors(view: CampaignView) -> Iterator[InputFinding]:
    """Readings that end at one extreme value, without noise, well short of the air: the end of the sensor's range.

    A flat top of the humidity a few %RH short is left to the diagnosis, which knows clipped readings.
    """
    for column in (TEMPERATURE, HUMIDITY):
        columns = view.column(column)
        flat = {seen.run.id: found for seen in columns if (found := _rail(view, seen)) is not None}
        rails = {rail for rail, _ in flat.values()}
        runs = [s.run.id for s in columns if s.run.id in flat or (_is_constant(s) and s.value[0] in rails)]
        if flat:
            first, (rail, air) = next(iter(flat.items()))
            yield InputFinding(
                "saturated_sensor",
                CHANNEL_OF[column],
                tuple(runs),
                "stop",
                f"{FILES[column]} of {view.words(runs)} stops at exactly {rail:.4g} {UNITS[column]}, where the air is "
                f"at {air:.4g} in run {first}: the sensor or its logger is at the end of its range; leave these runs "
                "out, or record them within it.",
            )


def _dead(view: CampaignView, column: str, dead: list[ColumnSeen]) -> InputFinding:
    runs = tuple(seen.run.id for seen in dead)
    first = dead[0]
    name = COLUMNS[column][1]
    step = _air_step(view, first)
    moved = (
        f"while the air moves by {step:+.1f} {'%RH' if column == HUMIDITY else 'K'}" if step else "without any noise"
    )
    return InputFinding(
        "dead_sensor",
        CHANNEL_OF[column],
        runs,
        "warn" if column == DIE else "stop",
        f"{name} in {FILES[column]} stays at {first.before:.4g} {UNITS[column]} in {view.words(runs)}, {moved}: the "
        "sensor is dead, stuck at the end of its range, or was not in the air; leave these runs out.",
    )


def _share_of_mode(seen: ColumnSeen) -> float:
    return float(np.unique(seen.value, return_counts=True)[1].max() / seen.value.size)


def _watched_s(seen: ColumnSeen) -> float:
    start = seen.run.start_s
    return float(seen.time_s[-1] - (seen.time_s[0] if start is None else start))


def _moves_by(seen: ColumnSeen) -> float:
    """How far the readings ever go from where they begin, noise left out (95 %)."""
    return max(float(np.percentile(np.abs(seen.value - seen.before), 95)) - 3.0 * seen.noise, 0.0)


def _air_step(view: CampaignView, seen: ColumnSeen) -> float:
    """The step of the air in a run, stated or shown by the other temperature; 0 where it is not known."""
    if seen.run.air is not None:
        return 0.0
    source, destination = stated(seen.run, seen.column)
    if source is not None and destination is not None:
        return destination - source
    other = _other_thermometer(view, seen.run, seen.column)
    return other.step if other is not None and other.moves else 0.0


def _other_thermometer(view: CampaignView, run: Run, column: str) -> ColumnSeen | None:
    return view.get(run, {TEMPERATURE: DIE, DIE: TEMPERATURE}.get(column, ""))


def _others_move(view: CampaignView, column: str) -> bool:
    return any(seen.moves for other in COLUMNS if other != column for seen in view.column(other))


def _large(column: str) -> float:
    """A step of the air that every live sensor shows."""
    return limit("dead_air_step_percent" if column == HUMIDITY else "dead_air_step_k")


def _is_stuck(seen: ColumnSeen) -> bool:
    return bool(_share_of_mode(seen) >= limit("dead_share"))


def _is_calm(view: CampaignView, seen: ColumnSeen) -> bool:
    """Noise, and of the stated step hardly anything in all the time it was watched."""
    hardly = limit("dead_follows") * abs(_air_step(view, seen))
    return not _is_stuck(seen) and _watched_s(seen) > limit("dead_after_s") and bool(_moves_by(seen) < hardly)


def _is_constant(seen: ColumnSeen) -> bool:
    return bool(seen.value.min() == seen.value.max())


def _rail(view: CampaignView, seen: ColumnSeen) -> tuple[float, float] | None:
    """The extreme value at which a plateau stands, and the air that lies beyond it; None where there is none."""
    short = limit("flat_short_percent" if seen.column == HUMIDITY else "flat_short_k")
    airs = stated(seen.run, seen.column)
    other = _other_thermometer(view, seen.run, seen.column)
    if other is not None and None in airs:
        airs = other.before, other.after
    if seen.run.air is not None or _is_constant(seen):
        return None
    few = max(int(0.05 * seen.value.size), 5)
    ends = seen.value[:few], seen.value[-few:]
    for rail, side in ((float(seen.value.max()), 1.0), (float(seen.value.min()), -1.0)):
        for air, end in zip(airs, ends, strict=True):
            flat = (end == rail).mean() >= limit("flat_share")
            beyond = 0.0 if air is None else side * (air - rail)
            if seen.column == HUMIDITY and rail in (0.0, 100.0):
                beyond = abs(beyond)  # what no sensor reads beyond, it may also read by mistake
            if flat and air is not None and beyond > short:
                return rail, air
    return None
