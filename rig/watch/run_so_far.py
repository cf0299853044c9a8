"""A run as its journal tells it up to now: records folded in one by one; traces and each sensor's health from that."""

from __future__ import annotations

import bisect
import math
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from shockrig.rig.recorder.run_journal import columns_of
from shockrig.rig.watch.view import Health, ViewTrace, as_list, clean, finite

HEALTH_OVER_S = 10.0
SILENT_AFTER_S = 3.0
FAILED_SHARE = 0.05
READINGS_KEPT = 20_000
POINTS_SHOWN = 400
TRANSIENT_S = (-2.0, 30.0)  # around the transfer, where no point is left out: a bead's whole response is 1 s
TRANSIENT_POINTS = 4000
PLACES = ("source", "destination")


@dataclass
class RunSoFar:
    """What a journal has said so far."""

    id: str = ""
    attempt: int = 1
    sensors: tuple[str, ...] = ()
    steps: list[tuple[float, str]] = field(default_factory=list)
    planned: tuple[str, ...] = ()
    zero_s: float | None = None
    move: tuple[float, float | None] | None = None
    last_s: float | None = None
    ended: bool = False
    airs: Mapping[str, Any] = field(default_factory=dict)
    notes: list[tuple[float, str]] = field(default_factory=list)
    readings: dict[str, deque[tuple[float, str, Mapping[str, float]]]] = field(default_factory=dict)

    def fold(self, record: Sequence[Any]) -> None:
        """Take one record in."""
        match record:
            case ["run", {"id": str(id_)} as header]:
                self.id = clean(id_)
                self.attempt = header["attempt"] if isinstance(header.get("attempt"), int) else 1
                self.sensors = tuple(clean(name) for name in as_list(header.get("sensors")))
                self.planned = tuple(clean(text) for text in as_list(header.get("steps")))
                self.airs = {place: header[place] for place in PLACES if isinstance(header.get(place), dict)}
            case ["note", at_s, str(text)] if finite(at_s):
                self.last_s = at_s
                self.notes.append((at_s, clean(text)))
            case ["reading", str(sensor), str(outcome), asked, came, sampled, dict(values), *_] if finite(came):
                self.last_s = came
                at_s = next((time_s for time_s in (sampled, asked) if finite(time_s)), came)
                known = {clean(name): float(value) for name, value in values.items() if finite(value)}
                if sensor in self.sensors:
                    kept = self.readings.setdefault(sensor, deque(maxlen=READINGS_KEPT))
                    kept.append((at_s, clean(outcome), known))
            case ["step", at_s, str(text)] if finite(at_s):
                self.last_s = at_s
                self.steps.append((at_s, clean(text)))
            case ["zero", at_s, *_] if finite(at_s):
                self.zero_s = self.last_s = at_s
            case ["move", start_s, end_s] if finite(start_s):
                self.move = (start_s, end_s if finite(end_s) else None)
            case ["end", at_s, *_] if finite(at_s):
                self.last_s, self.ended = at_s, True


def traces(run: RunSoFar, begin_s: float, zero_s: float) -> list[ViewTrace]:
    """Good readings since `begin_s`, on a time scale whose zero is `zero_s`."""
    units = {"temperature_c": ("temperature", "degC"), "humidity_percent": ("humidity", "%RH")}
    found = []
    for sensor in run.sensors:
        for name in columns_of(sensor) or units:
            points = [
                (round(at_s - zero_s, 3), values[name])
                for at_s, outcome, values in run.readings.get(sensor, ())
                if outcome == "ok" and name in values and at_s >= begin_s
            ]
            if points:
                stated = [run.airs.get(place, {}).get(name) for place in PLACES]
                source, destination = (float(value) if finite(value) else None for value in stated)
                kept = _kept(points, None if run.move is None else run.move[0] - zero_s)
                found.append(ViewTrace(sensor, *units[name], tuple(kept), (source, destination)))
    return found


def _kept(points: list[tuple[float, float]], moved_s: float | None) -> list[tuple[float, float]]:
    """The points to show: thinned, but for the seconds around the transfer."""
    if moved_s is None:
        return thinned(points)
    first = bisect.bisect_left(points, (moved_s + TRANSIENT_S[0], -math.inf))
    last = bisect.bisect_right(points, (moved_s + TRANSIENT_S[1], math.inf))
    return [*thinned(points[:first]), *thinned(points[first:last], TRANSIENT_POINTS), *thinned(points[last:])]


def thinned(points: list[tuple[float, float]], at_most: int = POINTS_SHOWN) -> list[tuple[float, float]]:
    """Every k-th point, the last one among them; none of none."""
    every = -(-len(points) // at_most) or 1
    return points[(len(points) - 1) % every :: every]


def health(run: RunSoFar, sensor: str, now_s: float) -> Health:
    """How a sensor did in the seconds before `now_s`."""
    readings = run.readings.get(sensor, ())
    recent = []
    for reading in reversed(readings):
        if reading[0] < now_s - HEALTH_OVER_S:
            break
        recent.append(reading)
    good = [reading for reading in recent if reading[1] == "ok"]
    span_s = min(HEALTH_OVER_S, now_s - readings[0][0]) if readings else 0.0
    age_s = max(0.0, now_s - good[0][0]) if good else None
    if not readings:
        state = "waiting"
    elif age_s is None or age_s > SILENT_AFTER_S:
        state = "silent"
    else:
        state = "failing" if len(recent) - len(good) > FAILED_SHARE * len(recent) else "good"
    outcomes = Counter(reading[1] for reading in recent)
    return Health(
        sensor=sensor,
        state=state,
        values=dict(good[0][2]) if good else {},
        per_s=round(len(good) / span_s, 2) if span_s > 0 else 0.0,
        age_s=age_s,
        outcomes=dict(sorted(outcomes.items())),
    )
