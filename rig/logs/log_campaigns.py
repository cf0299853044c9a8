"""Logs and a map made into campaigns, one for each sensor, and written."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shockrig.files.campaign_names import KNOWN_KINDS
from shockrig.files.campaign_write import campaign_document, write_run
from shockrig.files.disk import TABLE_AT_MOST, read_bytes, shown
from shockrig.files.spelling import did_you_mean
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.logs.found import LogStep, steps_of
from shockrig.rig.logs.mapping import LogMap
from shockrig.rig.logs.runs import ImportedRun, StepLeftOut, runs_of
from shockrig.rig.logs.sensor_logs import SensorLog, read_sensors
from shockrig.rig.logs.steps import READINGS_BEFORE

UNKNOWN_BODY = "lumped"


@dataclass(frozen=True)
class SensorCampaign:
    """What one sensor's campaign will hold, and what was left out of it and why."""

    sensor: str
    runs: tuple[ImportedRun, ...]
    left_out: tuple[StepLeftOut, ...]

    @property
    def left_out_said(self) -> list[str]:
        """The steps that make no run, those of one log and one reason in a line."""
        steps: dict[tuple[str, str], list[str]] = {}
        for one in self.left_out:
            steps.setdefault((one.log, one.why), []).append(str(one.step.number))
        return [f"{log} step{'s'[: len(of) > 1]} {', '.join(of)}: {why}" for (log, why), of in steps.items()]


@dataclass(frozen=True)
class Imported:
    """Logs as read by a map, their steps, and a campaign for each sensor that has runs."""

    map: LogMap
    logs: tuple[SensorLog, ...]
    steps: tuple[tuple[LogStep, ...], ...]
    campaigns: tuple[SensorCampaign, ...]


def import_logs(paths: Sequence[Path], map_: LogMap, sensor: str | None = None) -> Imported:
    """Read logs by a map and cut them into runs.

    Parameters
    ----------
    paths : sequence of Path
    map_ : LogMap
    sensor : str, optional
        The one sensor to make a campaign of; all that the map wants where it is not given.

    Raises
    ------
    BenchError
        A log cannot be read by the map, or nothing in it makes a run: names file or key, and the remedy.
    """
    where = shown(map_.path)
    if sensor is not None and sensor not in map_.sensors:
        raise BenchError(f"--sensor {sensor}: {where} has no [sensor.{sensor}]{did_you_mean(sensor, map_.sensors)}")
    _demand_each_once(paths, map_, where)
    logs = tuple(read_sensors(path, map_) for path in paths)
    steps = tuple(steps_of(one, map_, len(paths) > 1) for one in logs)
    campaigns = []
    for name in (sensor,) if sensor is not None else map_.wanted:
        runs: list[ImportedRun] = []
        left_out: list[StepLeftOut] = []
        for one, those in zip(logs, steps, strict=True):
            made, not_made = runs_of(one, those, map_, name)
            runs += made
            left_out += not_made
        campaigns.append(SensorCampaign(name, tuple(runs), tuple(left_out)))
    if not any(campaign.runs for campaign in campaigns):
        raise BenchError(_why_no_run(campaigns, paths, where))
    return Imported(map_, logs, steps, tuple(campaigns))


def _demand_each_once(paths: Sequence[Path], map_: LogMap, where: str) -> None:
    """Raise BenchError where a log is given twice, by name or by content, or where the map speaks of others alone."""
    names = [path.name for path in paths]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise BenchError(f"{twice}: is given twice; give every log once, and logs of one name other names")
    unknown = next((step for step in map_.steps if step.log is not None and step.log not in names), None)
    if unknown is not None and not any(step.log in (None, *names) for step in map_.steps):
        raise BenchError(
            f"{where}: key step[{unknown.number}].log: {unknown.log!r} is not among the logs given "
            f"({', '.join(names)}); correct it there"
        )
    digests: dict[str, Path] = {}
    for path in paths:
        first = digests.setdefault(_digest(path), path)
        if first is not path:
            raise BenchError(
                f"{shown(path)}: holds the same bytes as {shown(first)}, which are no second measurement; leave it out"
            )


def _why_no_run(campaigns: Sequence[SensorCampaign], paths: Sequence[Path], where: str) -> str:
    reasons: dict[str, str] = {}  # why -> the first step it holds for
    for out in (out for campaign in campaigns for out in campaign.left_out):
        reasons.setdefault(out.why, f"{out.log}: step {out.step.number}")
    if not reasons:
        return (
            f"{', '.join(map(shown, paths))}: no step is seen in it; look at it (--look --map {where}), then state "
            "[[step]] at = ... or a smaller [steps] least_temperature_k, least_humidity_percent in the map (a step "
            f"needs {READINGS_BEFORE} readings before it; a record that begins in its response is one run, imported as "
            "docs/importing.md shows)"
        )
    each = "; ".join(f"{step} {why}" for why, step in reasons.items())
    return f"no step makes a run: {each}; look at it (--look --map {where}) and correct the map"


def describe(campaign: SensorCampaign, imported: Imported, name: str, software: str) -> dict[str, Any]:
    """Content of campaign.json of one sensor's campaign. One whose body nobody states is a single lag."""
    map_ = imported.map
    sensor = map_.sensors[campaign.sensor]
    described: dict[str, Mapping[str, Any]] = {}
    for key, instrument in (("imet", sensor.thermometer), ("hyt", sensor.hygrometer)):
        if any(key in run.tables for run in campaign.runs):
            described[key] = instrument if _has_body(instrument) else {**instrument, "body": UNKNOWN_BODY}
    return campaign_document(
        name,
        described,
        imported={
            "map": map_.path.name,
            "sensor": campaign.sensor,
            "reference": list(sensor.reference),
            "logs": [
                {"file": one.log.path.name, "sha256": _digest(one.log.path), "rows": int(one.log.time_s.size)}
                for one in imported.logs
            ],
            "software": software,
        },
    )


def _has_body(instrument: Mapping[str, Any]) -> bool:
    """Whether a map says of a sensor what shape it has, by itself, by a kind that is known or by a length of it."""
    lengths = ("bead_radius_m", "film_thickness_m")
    return instrument.get("kind") in KNOWN_KINDS or any(key in instrument for key in ("body", *lengths))


def write_runs(folder: Path, runs: Sequence[ImportedRun], first: int = 1) -> None:
    """Write runs into an empty folder, numbered from `first`. Raises OSError where the disk does not take them."""
    for number, run in enumerate(runs, start=first):
        id_ = f"{number:04d}"
        (folder / id_).mkdir(parents=True)
        write_run(folder / id_, {**run.document, "id": id_}, run.tables)


def _digest(path: Path) -> str:
    return hashlib.sha256(read_bytes(path, "restore it", TABLE_AT_MOST)).hexdigest()
