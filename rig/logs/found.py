"""The steps of a log read by a map: those that the map states, or those that are found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from shockrig.files.disk import shown
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.logs.between import Stretch, changes_of, loose, quiet_around
from shockrig.rig.logs.changes import ChangePoint, LogPiece
from shockrig.rig.logs.mapping import LogMap, StepMap
from shockrig.rig.logs.onset import StepOnset, fit_onset
from shockrig.rig.logs.sensor_logs import SensorLog
from shockrig.rig.logs.stamps import to_map, to_seconds
from shockrig.rig.logs.steps import Cluster, StepInLog, find_steps, groups_of, sensor_of


@dataclass(frozen=True)
class LogStep:
    """A step of a log and what the map says of it (None where it was found); `number` counts the log's from 1.

    `begin_s`, `end_s` and `start_s` are what the map states of the run and its trigger, on the log's clock. `quiet` is,
    of each sensor that moved, from when to when it shows no other change that is large beside this step and is none.
    """

    number: int
    step: StepInLog
    said: StepMap | None = None
    begin_s: float | None = None
    end_s: float | None = None
    start_s: float | None = None
    quiet: Mapping[str, Stretch] = field(default_factory=dict)

    def moved(self) -> tuple[str, ...]:
        """The sensors that moved; of a step that the map gives to some sensors, these."""
        if self.said is not None and self.said.sensors:
            return self.said.sensors
        return tuple(dict.fromkeys(sensor_of(move.channel) for move in self.step.moves))


def steps_of(sensors: SensorLog, map_: LogMap, several: bool = False) -> tuple[LogStep, ...]:
    """Steps of a log in order of time.

    Parameters
    ----------
    sensors : SensorLog
    map_ : LogMap
        Its `[[step]]` tables for this log are the steps; where it has none they are found.
    several : bool
        Whether other logs are read by the same map: then each step must name its log.

    Raises
    ------
    BenchError
        A step of the map is not on this log's clock: names the key and the remedy.
    """
    said = _of_this_log(sensors.log.path, map_, several)
    pieces = [sensors.channels(k, map_.least) for k in range(len(sensors.log.pieces))]
    groups = [groups_of(channels, map_.merge_s) for channels in pieces]
    found = [
        step
        for k, channels in enumerate(pieces)
        for step in _beside(find_steps(channels, k, groups[k]), channels, map_)
    ]
    if not said:
        return _with_quiet([LogStep(n, step) for n, step in enumerate(found, start=1)], pieces, groups)
    placed = sorted((_place(sensors, map_, step) for step in said), key=lambda item: (item[1], item[2]))
    unsure_s = [
        sensors.log.period_s / np.sqrt(12.0) if one.uncertainty_s is None else one.uncertainty_s for one, _, _ in placed
    ]
    bare = [StepInLog(piece, at_s, float(s), ()) for (_, piece, at_s), s in zip(placed, unsure_s, strict=True)]
    # Where steps are found, a change ends the one before it, though it makes none: so it does here.
    others = [loose([step for step in bare if step.piece == k], those) for k, those in enumerate(groups)]
    steps = []
    for n, ((one, piece, at_s), step) in enumerate(zip(placed, bare, strict=True)):
        where = f"{shown(map_.path)}: key step[{one.number}]"
        beside = [(s, other.sensors) for other, k, s in placed if k == piece]
        moves = _as_found(step, beside, found)
        timed = {sensor_of(move.channel) for move in moves}
        moves = [move for move in moves if not one.sensors or sensor_of(move.channel) in one.sensors]
        for place, channel in enumerate(pieces[piece]):
            # What others did meanwhile is no answer to a step that a person gives to some sensors.
            if sensor_of(channel.name) in timed or one.sensors and sensor_of(channel.name) not in one.sensors:
                continue
            seen_s = [
                *_of_sensor(beside, channel.name),
                *(change.time_s for change in changes_of(others[piece], place)),
            ]
            since_s = max((s for s in seen_s if s < at_s), default=-np.inf)
            until_s = min((s for s in seen_s if s > at_s), default=np.inf)
            moves += _moves([channel], at_s, one.uncertainty_s, since_s, until_s)
        times = [
            None if value is None else _on_clock(sensors, value, f"{where}.{key}")
            for key, value in (("from", one.begin), ("until", one.end), ("start", one.start))
        ]
        if times[0] is not None and times[0] >= at_s or times[1] is not None and times[1] <= at_s:
            raise BenchError(
                f"{where}: from, at and until must follow one another; fix them or leave from and until out"
            )
        steps.append(LogStep(n + 1, replace(step, moves=tuple(moves)), one, times[0], times[1], times[2]))
    return _with_quiet(steps, pieces, groups)


def _with_quiet(
    steps: Sequence[LogStep], pieces: Sequence[Sequence[LogPiece]], groups: Sequence[Sequence[Sequence[Cluster]]]
) -> tuple[LogStep, ...]:
    """Steps, in order of their pieces, with the stretches in which no other change was seen."""
    quiet = [
        stretch
        for k, (channels, seen) in enumerate(zip(pieces, groups, strict=True))
        for stretch in quiet_around([one.step for one in steps if one.step.piece == k], channels, seen)
    ]
    return tuple(replace(one, quiet=stretch) for one, stretch in zip(steps, quiet, strict=True))


def _beside(steps: Sequence[StepInLog], channels: Sequence[LogPiece], map_: LogMap) -> list[StepInLog]:
    """Steps with what each sensor did whose reference moved and that is too slow to show a change of its own."""
    whole = []
    for k, step in enumerate(steps):
        moved = {sensor_of(move.channel) for move in step.moves}
        slow = {name for name, one in map_.sensors.items() if moved & set(one.reference)} - moved
        since_s = steps[k - 1].at_s if k else -np.inf
        until_s = steps[k + 1].at_s if k + 1 < len(steps) else np.inf
        theirs = [channel for channel in channels if sensor_of(channel.name) in slow]
        moves = _moves(theirs, step.at_s, step.uncertainty_s, since_s, until_s)
        names = tuple(dict.fromkeys(sensor_of(move.channel) for move in moves))
        whole.append(replace(step, moves=(*step.moves, *moves), beside=names))
    return whole


def _of_this_log(path: Path, map_: LogMap, several: bool) -> list[StepMap]:
    nameless = next((step for step in map_.steps if step.log is None), None)
    if several and nameless is not None:
        raise BenchError(
            f"{shown(map_.path)}: key step[{nameless.number}].log: is missing; with several logs say "
            f'log = "{path.name}"'
        )
    return [step for step in map_.steps if step.log in (None, path.name)]


def _on_clock(sensors: SensorLog, value: object, where: str) -> float:
    return to_seconds(sensors.log.clock, sensors.log.origin_s, value, where)


def _place(sensors: SensorLog, map_: LogMap, step: StepMap) -> tuple[StepMap, int, float]:
    """The piece of the log in which a step lies, and its time."""
    log = sensors.log
    where = f"{shown(map_.path)}: key step[{step.number}]"
    at_s = _on_clock(sensors, step.at, f"{where}.at")
    spans = [(float(log.time_s[rows.start]), float(log.time_s[rows.stop - 1])) for rows in log.pieces]
    if step.piece is not None:
        if step.piece > len(spans):
            raise BenchError(
                f"{where}.piece: {step.piece}, but {shown(log.path)} has {len(spans)}; fix it or leave it out"
            )
        candidates = [step.piece - 1]
    else:
        candidates = [k for k, (begin, end) in enumerate(spans) if begin <= at_s <= end]
    if len(candidates) > 1:
        raise BenchError(
            f"{where}.at: {step.at} is there {len(candidates)} times, the clock starts anew; add piece = N"
        )
    if not candidates or not spans[candidates[0]][0] <= at_s <= spans[candidates[0]][1]:
        first, last = (to_map(log.clock, log.origin_s, s) for s in (spans[0][0], spans[-1][1]))
        raise BenchError(f"{where}.at: {step.at} is not within the readings of {shown(log.path)} ({first} to {last})")
    return step, candidates[0], at_s


def _of_sensor(beside: Sequence[tuple[float, Sequence[str]]], channel: str) -> list[float]:
    """When the stated steps were that are given to a channel's sensor, or to all."""
    return [at_s for at_s, sensors in beside if not sensors or sensor_of(channel) in sensors]


def _as_found(
    step: StepInLog, beside: Sequence[tuple[float, Sequence[str]]], found: Sequence[StepInLog]
) -> list[StepOnset]:
    """The moves of a step that is stated when one is found, as a first map states it: they are timed by the windows
    that show them, and not by `at` anew. None where another stated step lies on their way."""
    same = [one for one in found if one.piece == step.piece and abs(one.at_s - step.at_s) <= one.uncertainty_s]
    nearest = min(same, key=lambda one: abs(one.at_s - step.at_s), default=step)
    return [
        move
        for move in nearest.moves
        if not any(step.at_s < at_s < move.reached_s for at_s in _of_sensor(beside, move.channel))
    ]


def _moves(
    channels: Sequence[LogPiece], at_s: float, unsure_s: float | None, since_s: float, until_s: float
) -> tuple[StepOnset, ...]:
    """What every channel did at a step that was stated."""
    moves = []
    for channel in channels:
        begin_s, end_s = max(since_s, float(channel.time_s[0])), min(until_s, float(channel.time_s[-1]))
        width_s = max(2.0 * (unsure_s or 0.0), 5.0 * channel.period_s)
        if not begin_s < at_s < end_s or ((channel.time_s > at_s) & (channel.time_s <= end_s)).sum() < 3:
            continue
        move = fit_onset(channel, ChangePoint(at_s, width_s), begin_s, end_s)
        if abs(move.size) >= channel.least:
            moves.append(move)
    return tuple(moves)
