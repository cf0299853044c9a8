"""`fly`: sensors read in flight, corrected row by row, logged and told to others.

A flight is a folder OUT/NNNN: journal.log has every answer of every sensor as it came (see rig.recorder.run_journal),
flight.csv the rows with what was known of them on board (`shockrig correct` reads it). Both survive a power cut up to
what the disk had taken, a second before it at most; both survive the process's end whole.
"""

from __future__ import annotations

import math
import os
import socket
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shockrig.analysis.flight.causal import Corrector, Row, Value
from shockrig.analysis.flight.causal_design import Design, design_of
from shockrig.files.disk import sync_folder
from shockrig.files.profile import Profile
from shockrig.protocols.fly_page import FlightFollower
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.flying import FlownRow, PeriodFinder, RowMaker, SensorHub
from shockrig.rig.journal import AppendedFile
from shockrig.rig.links.mavlink import AutopilotListener
from shockrig.rig.links.said import SaidAir, Speaker
from shockrig.rig.recorder import Recorder, RecordingError
from shockrig.rig.recorder.run_journal import COMPLETE
from shockrig.rig.seams import Clock, Outcome, Reading, Sensor

LOG = "flight.csv"
SURROUNDINGS = ("airspeed_m_s", "pressure_hpa", "altitude_m", "latitude_deg", "longitude_deg")
COLUMNS = (
    "time_s", "unix_s", "temperature_c", "humidity_percent", "humidity_sensor_temperature_c", *SURROUNDINGS,
    "humidity_read_s", "came_s", "sent_s", "onboard_temperature_c", "onboard_temperature_uncertainty_k",
    "onboard_humidity_percent", "onboard_humidity_uncertainty_percent", "onboard_flags",
)  # fmt: skip
SYNC_EVERY_S = 1.0
BEAT_EVERY_S = 1.0
SHORTEST_WAIT_S = 1e-4  # a sensor that is always due must not stop a virtual clock
LONGEST_WAIT_S = 0.5
FRESH_S = 3.0  # an iMet says pressure and position once a second
MOST_FLIGHTS = 9999


@dataclass(frozen=True)
class FlySettings:
    """How a flight is corrected: what waits `lag_s`, rows `period_s` apart (None: as the sensors turn out to be)."""

    lag_s: float = 0.0
    period_s: float | None = None
    sync_every_s: float | None = SYNC_EVERY_S
    about: Mapping[str, Any] = field(default_factory=dict)


class Watchdog:
    """Tells systemd that the loop goes round, by the socket that NOTIFY_SOCKET names; silent where there is none."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if self._address else None

    def say(self, text: str) -> None:
        """READY=1, WATCHDOG=1, STATUS=..., STOPPING=1."""
        if self._socket is not None:
            address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
            with suppress(OSError):
                self._socket.sendto(text.encode(), address)

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()


class FlightLog:
    """The files of one flight, in a new folder of `out`. A disk that fails is told once; the flight goes on."""

    def __init__(
        self,
        out: Path,
        about: Mapping[str, Any],
        now_s: float,
        sync_every_s: float | None,
        tell: Callable[[str], None],
    ) -> None:
        self.folder = _next_folder(out)
        self._tell, self._broken = tell, False
        self._recorder = Recorder(self.folder, {"id": self.folder.name, **about}, now_s, sync_every_s)
        self._rows = AppendedFile(self.folder / LOG, sync_every_s)
        self._rows.write((",".join(COLUMNS) + "\n").encode(), now_s)
        for folder in (self.folder, out):
            sync_folder(folder)  # or a power cut takes the names of the new files away

    def reading(self, reading: Reading) -> None:
        self._try(lambda: self._recorder.reading(reading))

    def note(self, now_s: float, text: str) -> None:
        self._try(lambda: self._recorder.note(now_s, text))

    def row(self, cells: Sequence[float], flags: str, now_s: float) -> None:
        """Write a row, a cell that is no number empty."""
        line = ",".join("" if cell != cell else f"{cell:.7f}".rstrip("0").rstrip(".") for cell in cells)
        self._try(lambda: self._rows.write(f"{line},{flags}\n".encode(), now_s))

    def _try(self, what: Callable[[], None]) -> None:
        try:
            if not self._broken:
                what()
        except OSError as error:
            self._broken = True
            cause = str(error) if isinstance(error, RecordingError) else error.strerror or str(error)
            self._tell(f"the log is written no further: {cause}")

    def close(self, now_s: float) -> None:
        self._try(lambda: self._recorder.end(now_s, COMPLETE))
        self._try(self._rows.close)


def _next_folder(out: Path) -> Path:
    """The next number's folder: a flight that was cut off stays as it is."""
    out.mkdir(parents=True, exist_ok=True)
    taken = [int(one.name) for one in out.iterdir() if one.name.isdecimal()]
    for number in range(max(taken, default=0) + 1, MOST_FLIGHTS):
        with suppress(FileExistsError):
            (out / f"{number:04d}").mkdir()
            return out / f"{number:04d}"
    raise BenchError(f"{out}: holds {MOST_FLIGHTS} flights; give another --out")


class _Surroundings:
    """Airspeed, pressure and position: the autopilot's, else what an iMet says beside its bead."""

    def __init__(self, autopilot: AutopilotListener | None) -> None:
        self._autopilot = autopilot
        self._said: dict[str, tuple[float, float]] = {}

    def take(self, reading: Reading) -> None:
        if reading.outcome is Outcome.OK:
            self._said |= {name: (reading.values[name], reading.time_s) for name in SURROUNDINGS
                           if name in reading.values}  # fmt: skip

    def at(self, now_s: float) -> dict[str, float]:
        own = {name: value for name, (value, heard_s) in self._said.items() if now_s - heard_s <= FRESH_S}
        if self._autopilot is not None:
            self._autopilot.poll(now_s)
            own |= self._autopilot.at(now_s)
        return {name: own.get(name, math.nan) for name in SURROUNDINGS}


class OnboardFlight:
    """A flight from the first reading to the last: `step` takes what is due, and is called until somebody has enough.

    Parameters
    ----------
    sensors : sequence of Sensor
        Not opened yet.
    speakers : sequence of Speaker
        Who is told.
    say : callable
        Words for the terminal.
    """

    def __init__(
        self,
        sensors: Sequence[Sensor],
        clock: Clock,
        profile: Profile,
        out: Path,
        speakers: Sequence[Speaker],
        settings: FlySettings,
        *,
        autopilot: AutopilotListener | None = None,
        say: Callable[[str], None] = print,
        unix_s: Callable[[], float] = time.time,
        watchdog: Watchdog | None = None,
        follower: FlightFollower | None = None,
    ) -> None:
        self.clock, self._profile, self._settings = clock, profile, settings
        self._speakers, self._say, self._unix_s = speakers, say, unix_s
        self._watchdog, self._follower = watchdog, follower
        self._surroundings, self._autopilot = _Surroundings(autopilot), autopilot
        design_of(profile, settings.period_s)  # what cannot fly is refused before anything is written
        now = clock.now()
        self.log = FlightLog(out, settings.about, now, settings.sync_every_s, self._tell)
        self.hub = SensorHub(sensors, clock, self._tell)
        self._finder: PeriodFinder | None = PeriodFinder(now) if settings.period_s is None else None
        self._waiting: deque[tuple[FlownRow, dict[str, float]]] = deque()
        self.rows = 0
        self._beat_s = now
        if settings.period_s is not None:
            self._begin(settings.period_s)

    def _begin(self, period_s: float) -> None:
        """The rows' distance is known."""
        self.design: Design = design_of(self._profile, period_s)
        self._corrector = Corrector(self.design, self._settings.lag_s)
        self._maker = RowMaker(period_s, self.clock.now())
        self._finder = None
        self.log.note(self.clock.now(), f"rows {period_s:g} s apart")

    def _tell(self, text: str) -> None:
        now = self.clock.now()
        self._say(f"{now:.1f} s: {text}")
        self.log.note(now, text)
        for speaker in self._speakers:
            speaker.tell(text, now)
        if self._follower is not None:
            self._follower.say(now, text)

    def step(self, until_s: float = math.inf) -> None:
        """Wait for what is due next, and do it."""
        due_s = self.hub.due_s() if self._finder is not None else min(self.hub.due_s(), self._maker.due_s())
        now = self.clock.now()
        self.clock.sleep_until(min(until_s, now + LONGEST_WAIT_S, max(due_s, now + SHORTEST_WAIT_S)))
        for reading in self.hub.poll():
            self.log.reading(reading)
            self._surroundings.take(reading)
            if self._finder is not None:
                self._finder.take(reading)
            else:
                self._maker.take(reading)
        now = self.clock.now()
        if self._finder is not None:
            if (period_s := self._finder.found(now)) is not None:
                self._begin(period_s)
        else:
            for row in self._maker.rows(now):
                self._take(row, now)
        if now >= self._beat_s:
            self._beat(now)

    def _beat(self, now: float) -> None:
        """Once a second: signs of life, and who is silent."""
        self._beat_s = now + BEAT_EVERY_S
        self.hub.watch(0.0 if self._finder is not None else self.design.period_s)
        for speaker in self._speakers:
            speaker.beat(now)
        if self._watchdog is not None:
            silent = ", ".join(sorted(self.hub.silent))
            self._watchdog.say(f"WATCHDOG=1\nSTATUS={self.rows} rows" + (f"; silent: {silent}" if silent else ""))

    def _take(self, row: FlownRow, now: float) -> None:
        """Correct a row, tell and log what is given now."""
        around = self._surroundings.at(now)
        self._waiting.append((row, around))
        taken = Row(
            row.time_s, row.temperature_c, row.humidity_percent,
            around["airspeed_m_s"], around["pressure_hpa"], row.die_temperature_c,
        )  # fmt: skip
        for values in self._corrector.step(taken):
            self._give(*self._waiting.popleft(), values)

    def _give(self, row: FlownRow, around: dict[str, float], values: tuple[Value, Value]) -> None:
        bead, film = values
        said = SaidAir(
            row.time_s,
            (bead.value, film.value),
            (bead.uncertainty, film.uncertainty),
            (row.temperature_c, row.humidity_percent),
        )
        for speaker in self._speakers:
            speaker.send(said)
        sent_s = self.clock.now()
        cells = (
            row.time_s, self._unix_s() - (sent_s - row.time_s),
            row.temperature_c, row.humidity_percent, row.die_temperature_c,
            *around.values(), row.humidity_s, row.came_s, sent_s,
            bead.value, bead.uncertainty, film.value, film.uncertainty,
        )  # fmt: skip
        self.log.row(cells, flag_text(values), sent_s)
        self.rows += 1
        if self._follower is not None:
            self._follower.take(said, around)

    def close(self) -> None:
        """Give what still waits, and end the log."""
        if self._finder is None:
            for values in self._corrector.flush():
                self._give(*self._waiting.popleft(), values)
        if self._watchdog is not None:
            self._watchdog.say("STOPPING=1")
        if dropped := sum(speaker.dropped for speaker in self._speakers):
            self._tell(f"{dropped} messages could not be sent")
        self.log.close(self.clock.now())
        self.hub.close()
        for speaker in self._speakers:
            speaker.close()
        if self._autopilot is not None:
            self._autopilot.end.close()


def flag_text(values: tuple[Value, Value]) -> str:
    """What was found of a row, in the words of `correct`."""
    judged = [value.judged for value in values]
    as_read = [value.as_read and value.value == value.value for value in values]
    found = {
        "gap": any(one.missing for one in judged),
        "repeated": any(one.repeated for one in judged),
        "implausible": any(one.implausible for one in judged),
        "outside_profile": any(value.outside for value in values),
        "not_corrected": all(as_read),
        "temperature_not_corrected": as_read[0] and not as_read[1],
        "humidity_not_corrected": as_read[1] and not as_read[0],
    }
    return "|".join(name for name, true in found.items() if true)
