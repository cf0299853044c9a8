"""From steps to runs: the stretch of the log around each step, the files of the run, and what became of the rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.campaign_write import run_document, table_text
from shockrig.files.json_files import known
from shockrig.files.numbers import one_or_many, short
from shockrig.rig.logs.found import LogStep
from shockrig.rig.logs.leaps import leaps
from shockrig.rig.logs.mapping import LogMap, SensorMap
from shockrig.rig.logs.sensor_logs import SensorLog, least_step
from shockrig.rig.logs.stamps import to_map
from shockrig.rig.logs.steps import READINGS_AFTER, READINGS_BEFORE
from shockrig.rig.logs.windows import drifts, inside_run, on_the_way, settled_since, window

Array = NDArray[np.float64]

AIR_COLUMNS = {
    "temperature": "temperature_c",
    "humidity": "humidity_percent",
    "airflow": "airflow_m_s",
    "pressure": "pressure_hpa",
}


@dataclass(frozen=True)
class ImportedRun:
    """A run ready to be written: content of run.json but for its id, its tables, and what a user should know of it."""

    log: str
    step: LogStep
    begin_s: float
    end_s: float
    document: Mapping[str, Any]
    tables: Mapping[str, str]
    readings: Mapping[str, int]
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class StepLeftOut:
    """A step that made no run, and why."""

    log: str
    step: LogStep
    why: str


def runs_of(
    sensors: SensorLog, steps: Sequence[LogStep], map_: LogMap, name: str
) -> tuple[list[ImportedRun], list[StepLeftOut]]:
    """Runs of the sensor `name` from one log, in order of time, and the steps that made none."""
    reasons, windows = _decided(sensors, steps, map_, name)
    log, sensor = sensors.log.path.name, map_.sensors[name]
    used = [one for one in steps if one.number in windows]
    least_s = _least_t63(used, name)
    runs = [_run(sensors, one, map_, sensor, *windows[one.number], least_s) for one in used]
    return runs, [StepLeftOut(log, one, reasons[one.number]) for one in steps if one.number not in windows]


def unused(sensors: SensorLog, steps: Sequence[LogStep], map_: LogMap) -> dict[int, str]:
    """Number of a step that makes no run of any sensor that the map wants -> why."""
    decided = {name: _decided(sensors, steps, map_, name) for name in map_.wanted}
    found = {}
    for one in steps:
        if any(one.number in windows for _, windows in decided.values()):
            continue
        theirs = [name for name in decided if name in one.moved()] or list(decided)
        if one.said is not None and not one.said.is_used:
            found[one.number] = one.said.note or "the map says so"
        else:
            found[one.number] = decided[theirs[0]][0][one.number]
    return found


def _decided(
    sensors: SensorLog, steps: Sequence[LogStep], map_: LogMap, name: str
) -> tuple[dict[int, str], dict[int, tuple[float, float]]]:
    """Number of a step -> why it makes no run of a sensor, and of each that does, from when to when the run goes."""
    is_measured = bool(map_.sensors[name].reference)
    reasons = _reasons(sensors, steps, map_, name)
    apart = _apart(steps, reasons, name, is_measured)
    for one in steps:
        reasons[one.number] = reasons[one.number] or _too_few(sensors, apart, one, map_, name)
    apart = _apart(steps, reasons, name, is_measured)
    windows = {one.number: _window(sensors, apart, one, map_, name) for one in steps if not reasons[one.number]}
    return reasons, windows


def _apart(steps: Sequence[LogStep], reasons: Mapping[int, str], name: str, is_measured: bool) -> Sequence[LogStep]:
    """The steps that a run does not reach into: those in which the sensor moved, or a person says so, and beside a
    measured air of these only what makes a run of its own."""
    return [
        other
        for other in steps
        if (name in other.moved() if not is_measured else not reasons[other.number])
        or (other.said is not None and (not other.said.sensors or name in other.said.sensors))
    ]


def _window(sensors: SensorLog, apart: Sequence[LogStep], one: LogStep, map_: LogMap, name: str) -> tuple[float, float]:
    begin_s, end_s = window(sensors, apart, one, map_, name)
    return (settled_since(sensors, one, name, begin_s) if one.begin_s is None else begin_s), end_s


def _too_few(sensors: SensorLog, apart: Sequence[LogStep], one: LogStep, map_: LogMap, name: str) -> str:
    """Why a step leaves too few readings to a run of a sensor; empty where it does not."""
    inside = inside_run(sensors, name, one.step.piece, *_window(sensors, apart, one, map_, name))
    moments = sensors.log.time_s[sensors.readings[name].rows[inside]]
    before, after = int((moments < one.step.at_s).sum()), int((moments >= one.step.at_s).sum())
    if before >= READINGS_BEFORE and after >= READINGS_AFTER:
        return ""
    least = f"{READINGS_BEFORE} and {READINGS_AFTER} are needed"
    return f"{name} has {before} readings before it and {after} after it; {least}"


def _reasons(sensors: SensorLog, steps: Sequence[LogStep], map_: LogMap, name: str) -> dict[int, str]:
    """Number of a step -> why it makes no run of a sensor, whatever readings it has; empty where it does.

    What its reference did while the sensor was still on its way is in the run before, where the air was measured.
    """
    reasons: dict[int, str] = {}
    before: LogStep | None = None
    for one in steps:
        if one.said is not None and not one.said.is_used:
            reasons[one.number] = "the map says use = false" + (f": {one.said.note}" if one.said.note else "")
            continue
        reasons[one.number] = why = _why_not(one, name, bool(map_.sensors[name].reference))
        if why:
            continue
        if name in one.step.beside and before is not None and on_the_way(sensors, before, one, name):
            reasons[one.number] = f"{name} was still on its way from step {before.number}: it is in that run"
        else:
            before = one
    return reasons


def _why_not(one: LogStep, name: str, is_measured: bool) -> str:
    """Why a step makes no run of a sensor; empty where it does."""
    if name not in one.moved():
        if one.said is not None and one.said.sensors:
            whose = ", ".join(one.said.sensors)
            return (
                f"the map gives it to {whose} alone: name {name} in its sensors too, or delete the map's steps to have "
                "them found anew"
            )
        return f"{name} shows no step there"
    # Stages and ramps do no harm where the air was measured: it is then the input as it was.
    return "" if is_measured and one.step.is_slow_air else one.step.why_not


def _least_t63(steps: Sequence[LogStep], name: str) -> dict[str, float]:
    """Quantity -> the least time to 63 % that a sensor shows in any of its steps."""
    least: dict[str, float] = {}
    for move in (move for one in steps for move in one.step.moves):
        of, key = move.channel.rsplit(".", 1)
        if of == name:
            least[key] = min(move.t63_s, least.get(key, np.inf))
    return least


def _run(
    sensors: SensorLog,
    one: LogStep,
    map_: LogMap,
    sensor: SensorMap,
    begin_s: float,
    end_s: float,
    least_s: Mapping[str, float],
) -> ImportedRun:
    log, readings = sensors.log, sensors.readings[sensor.name]
    inside = inside_run(sensors, sensor.name, one.step.piece, begin_s, end_s)
    moments = log.time_s[readings.rows[inside]]
    zero_s = float(moments[0])
    values = {key: value[inside] for key, value in readings.values.items()}
    values, leapt = _without_leaps(values, moments, sensor, least_s)
    columns = _columns(values, moments - zero_s)
    air = air_columns(sensors, sensor, one.step.piece, begin_s, end_s)
    if air:
        columns["air"] = {**air, "time_s": air["time_s"] - zero_s}
    facts = {**map_.facts, **(one.said.facts if one.said is not None else {})}
    for key in ("pressure", "airflow"):
        measured = values.get(key, np.zeros(0))
        if np.isfinite(measured).any() and (one.said is None or AIR_COLUMNS[key] not in one.said.facts):
            facts[AIR_COLUMNS[key]] = round(float(np.nanmedian(measured)), 2)
    started_at = None
    if log.clock.is_dated:
        started_at = datetime.fromtimestamp(round(log.origin_s + zero_s, 6), UTC).isoformat().replace("+00:00", "Z")
    degrees = {sensor.columns[key][0] for key in ("temperature", "die_temperature") if key in sensor.columns}
    stated = {key: value for name in _references(sensor, map_) for key, value in name.as_reference.items()}
    document = run_document(
        "",
        started_at=started_at,
        source=facts.get("source"),
        destination=facts.get("destination"),
        airflow_m_s=facts.get("airflow_m_s"),
        pressure_hpa=facts.get("pressure_hpa"),
        start_s=None if one.start_s is None else round(one.start_s - zero_s, 6),
        duration_s=facts.get("duration_s"),
        **known(
            step_seen_s=round(one.step.at_s - zero_s, 4),
            step_seen_standard_uncertainty_s=round(one.step.uncertainty_s, 4),
        ),
        imported={
            "log": log.path.name,
            "step": one.number,
            "at": to_map(log.clock, log.origin_s, one.step.at_s).strip('"'),
            "sensor": sensor.name,
            # A check that doubts the unit of times need not, where the log says it.
            "times": "dates" if log.clock.is_dated else log.clock.known,
            **({"temperatures": "named"} if degrees and degrees <= log.named else {}),
        },
    )
    if stated and air:
        document["reference"] = stated
    tables = {file: _table(table) for file, table in columns.items()}
    counts = {file: int(table["time_s"].size) for file, table in columns.items()}
    remarks = (*leapt, *_remarks(sensors, one, sensor.name, begin_s))
    return ImportedRun(log.path.name, one, begin_s, end_s, document, tables, counts, remarks)


def _without_leaps(
    values: Mapping[str, Array], time_s: Array, sensor: SensorMap, least_s: Mapping[str, float]
) -> tuple[dict[str, Array], list[str]]:
    """A run's readings without those that the sensor cannot have made, and a sentence for each quantity on these; a
    column that is the temperature's too loses the same."""
    kept, said = dict(values), []
    for key, t63_s in least_s.items():
        value = values[key]
        leapt = leaps(time_s, value, max(t63_s, 1e-9), least_step(key, value[np.isfinite(value)]))
        if leapt.any():
            same = [other for other in values if sensor.columns[other][0] == sensor.columns[key][0]]
            kept |= {other: np.where(leapt, np.nan, values[other]) for other in same}
            said.append(
                f"{one_or_many(int(leapt.sum()), f'reading of {key}', f'readings of {key}')} left out: away and back "
                f"from one to the next, as nothing can that takes {short(t63_s, 3)} s to 63 %"
            )
    return kept, said


def _columns(values: Mapping[str, Array], time_s: Array) -> dict[str, dict[str, Array]]:
    """The columns of imet.csv and hyt.csv, of each that has two readings."""
    found = {}
    for file, main in (("imet", "temperature"), ("hyt", "humidity")):
        if main not in values or np.isfinite(values[main]).sum() < 2:
            continue
        there = np.isfinite(values[main])
        found[file] = {"time_s": time_s[there], AIR_COLUMNS[main]: values[main][there]}
        if file == "hyt" and "die_temperature" in values:
            found[file]["temperature_c"] = values["die_temperature"][there]
        if file == "hyt":
            found[file]["stale"] = np.zeros(int(there.sum()))
    return found


def air_columns(sensors: SensorLog, sensor: SensorMap, piece: int, begin_s: float, end_s: float) -> dict[str, Array]:
    """Columns of air.csv from the sensor's references, on the log's clock; empty where it has none.

    One reading more on either side, so that the air is known at the run's ends; readings of several references stand in
    rows of their own, with empty cells for one another.
    """
    log = sensors.log
    pieces = log.pieces[piece]
    found: dict[str, tuple[Array, Array]] = {}
    for name in sensor.reference:
        readings = sensors.readings[name]
        mine = (readings.rows >= pieces.start) & (readings.rows < pieces.stop)
        moments = log.time_s[readings.rows[mine]]
        first = max(int(np.searchsorted(moments, begin_s)) - 1, 0)
        last = min(int(np.searchsorted(moments, end_s, side="right")) + 1, moments.size)
        for key, column in AIR_COLUMNS.items():
            if key in readings.values and column not in found:
                value = readings.values[key][mine][first:last]
                there = np.isfinite(value)
                if there.sum() >= 2:
                    found[column] = moments[first:last][there], value[there]
    if not {"temperature_c", "humidity_percent"} & set(found):
        return {}
    time_s = np.unique(np.concatenate([moments for moments, _ in found.values()]))
    columns = {"time_s": time_s}
    for column in AIR_COLUMNS.values():
        if column in found:
            columns[column] = np.full(time_s.size, np.nan)
            columns[column][np.searchsorted(time_s, found[column][0])] = found[column][1]
    return columns


def _references(sensor: SensorMap, map_: LogMap) -> list[SensorMap]:
    return [map_.sensors[name] for name in sensor.reference if name in map_.sensors]


def _table(columns: Mapping[str, Array]) -> str:
    """Values as finely as the log has them, up to seven digits; the flag as 0."""
    forms = {name: "%d" if name == "stale" else "%.7g" for name in columns if name != "time_s"}
    return table_text({name: values.tolist() for name, values in columns.items()}, forms)


def _remarks(sensors: SensorLog, one: LogStep, name: str, begin_s: float) -> tuple[str, ...]:
    """What a user should know of a run: a sensor that had not settled before the step."""
    until_s = one.step.at_s - 2.0 * one.step.uncertainty_s
    found = drifts(one, sensors, name, inside_run(sensors, name, one.step.piece, begin_s, until_s))
    return tuple(
        f"{key} had not settled: {drift:+.2g} in the {short(until_s - begin_s, 3)} s before it"
        for key, drift in found.items()
    )
