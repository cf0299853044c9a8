"""Sensors in flight: opened and read whatever fails, and their readings put together to rows.

A row is made when the bead was read; the film's newest reading goes with it, which is waited for a part of a period.
Where the bead is silent rows go on at the same pace without it: a correction then knows that time has passed.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median

from shockrig.rig.recorder.run_journal import columns_of, is_good, sample_time_s
from shockrig.rig.seams import Clock, Outcome, Reading, Sensor

BEAD, FILM = "imet", "hyt"
GRACE_PERIODS = 0.4  # that a bead's reading waits for the film's
MISSED_PERIODS = 1.5  # after a row: the bead will not come any more
REOPEN_S = 1.0
SILENT_S, SILENT_PERIODS = 1.0, 5.0  # without a good reading for the longer of both a sensor is called silent
LEARN_READINGS, LEARN_WITHIN_S = 8, 3.0
NAN = math.nan


@dataclass(frozen=True)
class FlownRow:
    """One row: readings, NaN where there is none, at the time [s] when the bead was read. `came_s` is when its
    answer had come (the film's, where the bead said nothing), `humidity_s` when the film was read."""

    time_s: float
    temperature_c: float
    humidity_percent: float
    die_temperature_c: float
    came_s: float
    humidity_s: float


class SensorHub:
    """Sensors of a bench of which any may be missing, fall silent and come back.

    Parameters
    ----------
    sensors : sequence of Sensor
    clock : Clock
    tell : callable
        Is told in words what falls silent and what speaks again.
    """

    def __init__(self, sensors: Sequence[Sensor], clock: Clock, tell: Callable[[str], None]) -> None:
        self.sensors = list(sensors)
        self._clock, self._tell = clock, tell
        self._closed = {sensor.name: -math.inf for sensor in self.sensors}  # name -> when it is opened again
        self.good_s = {sensor.name: clock.now() for sensor in self.sensors}
        self.silent: set[str] = set()

    def due_s(self) -> float:
        """When there is something to do."""
        return min(self._closed[one.name] if one.name in self._closed else one.due_s() for one in self.sensors)

    def poll(self) -> list[Reading]:
        """What has come by now."""
        now, found = self._clock.now(), []
        for sensor in self.sensors:
            name = sensor.name
            try:
                if name in self._closed:
                    if now >= self._closed[name]:
                        self._closed[name] = now + REOPEN_S
                        sensor.open()
                        del self._closed[name]
                elif sensor.due_s() <= now:
                    found += sensor.poll()
            except OSError as error:
                self._closed.setdefault(name, now + REOPEN_S)
                self.good_s[name] = -math.inf
                if name not in self.silent:
                    self.silent.add(name)
                    self._tell(f"{name} cannot be opened: {error.strerror or error}")
        for reading in found:
            if reading.sensor in self.good_s and is_good(reading):
                self.good_s[reading.sensor] = sample_time_s(reading)
        return found

    def watch(self, period_s: float) -> None:
        """Say which sensors have fallen silent and which speak again."""
        now, longest_s = self._clock.now(), max(SILENT_S, SILENT_PERIODS * period_s)
        for name, good_s in self.good_s.items():
            silent = now - good_s > longest_s
            if silent and name not in self.silent:
                self.silent.add(name)
                self._tell(f"{name} is silent")
            elif not silent and name in self.silent:
                self.silent.discard(name)
                self._tell(f"{name} speaks again")

    def close(self) -> None:
        for sensor in self.sensors:
            sensor.close()


class PeriodFinder:
    """How far apart the slower of the two sensors' readings are, from the first ones."""

    def __init__(self, began_s: float) -> None:
        self._began_s = began_s
        self._times: dict[str, list[float]] = {BEAD: [], FILM: []}

    def take(self, reading: Reading) -> None:
        if reading.sensor in self._times and is_good(reading):
            self._times[reading.sensor].append(sample_time_s(reading))

    def found(self, now_s: float) -> float | None:
        """The period [s]; None while too little was heard, 0.1 s where that stays so."""
        late = now_s - self._began_s > LEARN_WITHIN_S
        enough = LEARN_READINGS if not late else 3
        known = [times for times in self._times.values() if len(times) >= enough]
        if not late and len(known) < len(self._times):
            return None
        apart = [median(b - a for a, b in zip(times, times[1:], strict=False)) for times in known]
        return round(max(apart), 3) if apart else (0.1 if late else None)


class RowMaker:
    """Makes rows of readings."""

    def __init__(self, period_s: float, began_s: float) -> None:
        self.period_s = period_s
        self._beads: deque[Reading] = deque()
        self._film: Reading | None = None
        self._last_s = began_s

    def take(self, reading: Reading) -> None:
        """Take a reading in; only good ones make rows."""
        if reading.outcome is not Outcome.OK or not columns_of(reading.sensor) or not is_good(reading):
            return
        if reading.sensor == BEAD and sample_time_s(reading) > self._last_s:
            self._beads.append(reading)
        elif reading.sensor == FILM:
            self._film = reading

    def due_s(self) -> float:
        """When a row is made at the latest."""
        if self._beads:
            return self._beads[0].time_s + GRACE_PERIODS * self.period_s
        return self._last_s + (1.0 + MISSED_PERIODS) * self.period_s

    def rows(self, now_s: float) -> list[FlownRow]:
        """The rows that are ready."""
        found = []
        while self._beads:
            bead = self._beads[0]
            if self._film is None and len(self._beads) == 1 and now_s < self.due_s():
                break
            self._beads.popleft()
            found.append(self._row(sample_time_s(bead), bead))
        while not self._beads and now_s >= self._last_s + (1.0 + MISSED_PERIODS) * self.period_s:
            found.append(self._row(self._last_s + self.period_s, None))
        return found

    def _row(self, time_s: float, bead: Reading | None) -> FlownRow:
        film, self._film = self._film, None
        self._last_s = time_s
        first = bead or film
        values = {} if film is None else film.values
        return FlownRow(
            time_s,
            NAN if bead is None else bead.values["temperature_c"],
            values.get("humidity_percent", NAN),
            values.get("temperature_c", NAN),
            NAN if first is None else first.time_s,
            NAN if film is None else sample_time_s(film),
        )
