"""iMet-XF, XQ2 and XQ (InterMet; serial ASCII, 57600 8N1): they talk by themselves, this listens.

Time stamps are the host's, worked back from when bytes were read to when the line began; the device's own clock is
never used (without a fix it starts in 2015). The lines' meaning is in rig/sensors/imet_lines.py.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from shockrig.rig.seams import Clock, Outcome, Parts, Reading, SerialPort
from shockrig.rig.sensors.imet_lines import (
    SECOND,
    TABLES,
    LineAssembler,
    LineTable,
    SerialLine,
    UnknownLine,
    implausible,
)

REOPEN_S = 0.25
ECHO_WITHIN_S = 0.03  # the fastest units speak every 50 ms, a burst of an XF takes 14 ms


@dataclass(frozen=True)
class ImetSettings:
    """Settings of one iMet unit; all but `port` may be left out.

    `lines` adds to or replaces the kind's own table: id -> ["name/divisor", "name", "name:text"]. `latency_s` is how
    long before its line the bead was read (an FTDI adapter's latency timer adds up to 16 ms). Where the port is
    looked at more than `late_s` too late, its lines are true but their time is not known: they are STALE.
    """

    port: str
    baud: int = 57600
    serial: str | None = None
    bead_radius_m: float = 4e-4
    lines: Mapping[str, Sequence[str]] = field(default_factory=dict)
    latency_s: float = 0.0
    late_s: float = 0.05
    silence_s: float = 2.0


@dataclass(frozen=True)
class _Kept:
    """What another sensor takes out of this unit's lines, and its readings that nobody has fetched yet."""

    name: str
    line: str
    takes: Mapping[str, str]
    readings: deque[Reading]

    def wants(self, key: str, values: Mapping[str, float]) -> bool:
        """Whether a line brings a reading."""
        return next(iter(self.takes)) in values and (key == self.line if self.line else key not in SECOND)


class Imet:
    """One iMet unit. Raw lines are in every reading, rejected ones too.

    Lines with the bead's temperature are readings of this sensor; other lines (board, GPS, a second bead) are readings
    of "NAME.ID", so that nobody waits for a temperature in them.

    `counts` keeps the book: outcomes by name, "unknown_id", "echo", "reopened"; `unknown_ids` says which.
    """

    Settings = ImetSettings

    def __init__(
        self, name: str, settings: ImetSettings, port: SerialPort, clock: Clock, kind: str = "imet-xf"
    ) -> None:
        self.name = name
        self.settings = settings
        self.kind = kind
        self.counts: Counter[str] = Counter()
        self.unknown_ids: Counter[str] = Counter()
        self._kept: list[_Kept] = []
        self._port = port
        self._clock = clock
        self._table = LineTable.of({**TABLES[kind], **settings.lines})
        self._assembler = LineAssembler(self._table.begins())
        self._look_s = self._heard_s = 0.0
        self._reopen_s: float | None = None
        self._spoken: dict[str, tuple[bytes, float]] = {}  # id -> its last line and when that began

    @classmethod
    def build(cls, name: str, settings: ImetSettings, parts: Parts) -> Imet:
        return cls(name, settings, parts.serial(settings.port, settings.baud), parts.clock, parts.kind)

    def describe(self) -> dict[str, Any]:
        return {"kind": self.kind, "serial": self.settings.serial, "bead_radius_m": self.settings.bead_radius_m}

    def keep(self, name: str, line: str, takes: Mapping[str, str]) -> deque[Reading]:
        """Where readings under `name` are put from now on, for a sensor of its own, out of lines with the id `line`.

        Parameters
        ----------
        name : str
        line : str
            Where empty, any lines but those of a second bead or film.
        takes : {quantity of the lines: quantity of the readings}
            Lines without the first one bring no reading.
        """
        self._kept.append(_Kept(name, line, dict(takes), deque(maxlen=1000)))
        return self._kept[-1].readings

    def lines_with(self, quantity: str) -> list[str]:
        """Ids of the lines that tell a quantity."""
        return [key for key in self._table.lines if quantity in self._table.names(key)]

    def open(self) -> None:
        """Open the port, which drops what waited in it; raises OSError."""
        self._port.open()
        self._assembler = LineAssembler(self._table.begins())
        self._heard_s = self._clock.now()
        self._look_s = self._port.due_s()
        self._reopen_s = None

    def due_s(self) -> float:
        if self._reopen_s is not None:
            return self._reopen_s
        return min(self._port.due_s(), self._heard_s + self.settings.silence_s)

    def poll(self) -> list[Reading]:
        now = self._clock.now()
        try:
            if self._reopen_s is not None:
                return self._reopen(now, self._reopen_s)
            chunk = self._port.read_waiting()
        except OSError as error:
            self.counts[f"errno_{error.errno}"] += 1
            self._reopen_s = now + REOPEN_S
            return [self._say(Outcome.NOT_ACKNOWLEDGED, now, now)]
        late = now > self._look_s + self.settings.late_s
        self._look_s = self._port.due_s()
        if not chunk:
            if now - self._heard_s < self.settings.silence_s:
                return []
            since_s, self._heard_s = self._heard_s, now
            return [self._say(Outcome.TIMED_OUT, since_s, now)]
        self._heard_s = now
        lines = self._assembler.feed(chunk, now, self._port.byte_s)
        return [reading for line in lines for reading in self._read(line, now, late)]

    def _reopen(self, now: float, not_before_s: float) -> list[Reading]:
        if now < not_before_s:
            return []
        self.open()
        self.counts["reopened"] += 1
        return []

    def _read(self, line: SerialLine, now: float, late: bool) -> list[Reading]:
        try:
            if not line.whole:
                raise ValueError("broken line")
            key, values = self._table.parse(line.raw.replace(b"\0", b""))
        except UnknownLine as unknown:
            self.counts["unknown_id"] += 1
            self.unknown_ids[str(unknown)[:20]] += 1
            return [self._say(Outcome.REJECTED, line.start_s, now, raw=line.raw)]
        except ValueError:
            return [self._say(Outcome.REJECTED, line.start_s, now, raw=line.raw)]
        own = "temperature_c" in self._table.names(key) and key not in SECOND
        name = self.name if own else f"{self.name}.{key}"
        if implausible(values) or (name == self.name and "temperature_c" not in values):
            return [self._say(Outcome.IMPLAUSIBLE, line.start_s, now, raw=line.raw, name=name)]
        before, began_s = self._spoken.get(key, (b"", 0.0))
        self._spoken[key] = line.raw, line.start_s
        echo = line.raw == before and line.start_s - began_s < ECHO_WITHIN_S  # not measured again: the line came twice
        if echo:
            self.counts["echo"] += 1
            return [self._say(Outcome.REJECTED, line.start_s, now, raw=line.raw, name=name)]
        outcome = Outcome.STALE if late else Outcome.OK
        reading = self._say(outcome, line.start_s, now, values, line.raw, name)
        for kept in self._kept:
            if kept.wants(key, values):
                taken = {to: values[quantity] for quantity, to in kept.takes.items() if quantity in values}
                kept.readings.append(replace(reading, sensor=kept.name, values=taken))
        return [reading]

    def _say(
        self,
        outcome: Outcome,
        start_s: float,
        now: float,
        values: Mapping[str, float] | None = None,
        raw: bytes = b"",
        name: str | None = None,
    ) -> Reading:
        self.counts[str(outcome)] += 1
        sampled_s = start_s - self.settings.latency_s if outcome is Outcome.OK else None
        return Reading(name or self.name, outcome, start_s, now, values or {}, raw, sampled_s)

    def close(self) -> None:
        self._port.close()
