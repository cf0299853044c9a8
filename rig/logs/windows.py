"""The stretch of a log that makes a run: settled before its step, until the next is near or all has long settled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shockrig.rig.logs.found import LogStep
from shockrig.rig.logs.mapping import LogMap
from shockrig.rig.logs.sensor_logs import SensorLog

LEAD_READINGS, LEAD_T63 = 100, 2.0  # what a run has before its step, where the log has it
LEAD_T63_MEASURED = 6.0  # beside a measured air: the sensor has forgotten what was before that
TAIL_READINGS, TAIL_T63 = 100, 20.0  # and after it
SETTLED_SHARE = 0.05  # of the step may pass in the stretch before it ...
FEWEST_LINE = 5  # readings that tell a rate
FEWEST_SETTLED = 20  # ... which has so many readings at least


def window(sensors: SensorLog, steps: Sequence[LogStep], one: LogStep, map_: LogMap, name: str) -> tuple[float, float]:
    """From where to where a run goes, on the log's clock.

    From a settled stretch before the step (of the time since the step before only the second half) until the next step
    is near, or the sensor has long settled. So it is of changes that are no steps, but where the air was measured.
    """
    log = sensors.log
    rows = log.pieces[one.step.piece]
    at_s = one.step.at_s
    here = [other.step for other in steps if other.step.piece == one.step.piece]
    begins_s, ends_s = float(log.time_s[rows.start]), float(log.time_s[rows.stop - 1])
    since_s, until_s = (-np.inf, np.inf) if map_.sensors[name].reference else one.quiet.get(name, (-np.inf, np.inf))
    last_s = max((other.at_s for other in here if other.at_s < at_s), default=-np.inf)
    last_s = max(last_s, since_s)
    following = min((other for other in here if other.at_s > at_s), key=lambda other: other.at_s, default=None)
    readings = sensors.readings[name]
    moments = log.time_s[readings.rows]
    period_s = float(np.median(np.diff(moments))) if moments.size > 1 else log.period_s
    t63_s = max((move.t63_s for move in one.step.moves if move.channel.rsplit(".", 1)[0] == name), default=0.0)
    lead = LEAD_T63_MEASURED if map_.sensors[name].reference else LEAD_T63
    lead_s = map_.before_s if map_.before_s is not None else max(LEAD_READINGS * period_s, lead * t63_s)
    tail_s = map_.after_s if map_.after_s is not None else max(TAIL_READINGS * period_s, TAIL_T63 * t63_s)
    begin_s = max(at_s - lead_s, begins_s if np.isinf(last_s) else last_s + 0.5 * (at_s - last_s))
    end_s = min(at_s + tail_s, ends_s, until_s)
    if following is not None:
        # A slow change whose start nobody can tell leaves the run before it half of the way at least.
        near_s = following.at_s - max(2.0 * following.uncertainty_s, 2.0 * period_s)
        end_s = min(end_s, max(near_s, at_s + 0.5 * (following.at_s - at_s)))
    return (
        one.begin_s if one.begin_s is not None else begin_s,
        one.end_s if one.end_s is not None else end_s,
    )


def settled_since(sensors: SensorLog, one: LogStep, name: str, begin_s: float) -> float:
    """A later begin, where the sensor had not settled at `begin_s`: the latest halves of the stretch are tried."""
    at_s = one.step.at_s - 2.0 * one.step.uncertainty_s
    for _ in range(4):
        inside = inside_run(sensors, name, one.step.piece, begin_s, at_s)
        if inside.sum() < 2 * FEWEST_SETTLED or not drifts(one, sensors, name, inside):
            break
        begin_s += 0.5 * (at_s - begin_s)
    return begin_s


def drifts(one: LogStep, sensors: SensorLog, name: str, inside: NDArray[np.bool_]) -> dict[str, float]:
    """Key -> by how much a channel that steps drifts over the readings `inside`, where that is much of the step."""
    found = {}
    readings = sensors.readings[name]
    for move in one.step.moves:
        of, key = move.channel.rsplit(".", 1)
        if of != name:
            continue
        value = readings.values[key][inside]
        value = value[np.isfinite(value)]
        quarter = value.size // 4
        if quarter < 2:
            continue
        drift = float(np.median(value[-quarter:]) - np.median(value[:quarter]))
        if abs(drift) > SETTLED_SHARE * abs(move.size):
            found[key] = drift
    return found


def on_the_way(sensors: SensorLog, before: LogStep, one: LogStep, name: str) -> bool:
    """Whether all that a sensor showed at the step `before` was still under way at the next one: at the rate of its
    last readings more than `SETTLED_SHARE` of it would have followed within its time to 63 %."""
    if before.step.piece != one.step.piece:
        return False
    readings = sensors.readings[name]
    moves = [move for move in before.step.moves if move.channel.rsplit(".", 1)[0] == name]
    for move in moves:
        half_s = 0.5 * (before.step.at_s + one.step.at_s)
        until_s = max(one.step.at_s - 2.0 * one.step.uncertainty_s, half_s)
        begin_s = max(0.5 * (before.step.at_s + until_s), until_s - move.t63_s)
        inside = inside_run(sensors, name, one.step.piece, begin_s, until_s)
        moments = sensors.log.time_s[readings.rows[inside]] - until_s
        value = readings.values[move.channel.rsplit(".", 1)[1]][inside]
        there = np.isfinite(value)
        if there.sum() < FEWEST_LINE:
            return before.step.at_s + move.t63_s > until_s
        line, covariance = np.polyfit(moments[there], value[there], 1, cov=True)
        ahead = line[0] * move.t63_s / move.size
        if ahead < max(SETTLED_SHARE, 2.0 * np.sqrt(covariance[0, 0]) * move.t63_s / abs(move.size)):
            return False
    return bool(moves)


def inside_run(sensors: SensorLog, name: str, piece: int, begin_s: float, end_s: float) -> NDArray[np.bool_]:
    rows = sensors.log.pieces[piece]
    readings = sensors.readings[name]
    moments = sensors.log.time_s[readings.rows]
    return (readings.rows >= rows.start) & (readings.rows < rows.stop) & (moments >= begin_s) & (moments <= end_s)
