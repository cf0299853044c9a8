"""A linear stage on a GRBL 1.1 controller (serial ASCII, 115200 8N1) that carries the probes between the two airs.

Lines end with LF and are answered `ok`, `error:N` or `ALARM:N`; the bytes `?` (status), `!` (hold) and 0x18 (reset) act
at once. Status: `<Run|MPos:12.000,0.000,0.000|FS:600,0|Pn:X>`; Pn lists the switches that are pressed. With hard limits
off ($21=0) the switch at each end says when the probes left the one air and reached the other. Source: GRBL wiki,
"Grbl v1.1 Interface".
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

from shockrig.rig.bench_errors import BenchError, StageError
from shockrig.rig.seams import Air, Chambers, Clock, Move, Parts, SerialPort

HOLD, RESET, STATUS = b"!", b"\x18", b"?"
REPORT = re.compile(rb"<([A-Z][a-z]*)(?::\d)?\|MPos:(-?\d{1,9}(?:\.\d{1,9})?)[^>]*>")
PRESSED = re.compile(rb"\|Pn:([A-Z]+)")
LONGEST_LINE = 256
SWITCH_MM = 5.0  # a switch is that near to the end that it stands for
ASK_AGAIN_S = 0.05  # a report that was damaged on the way is asked for once more
ALARMS = {
    1: "a hard limit was hit: position is lost, find out why and home again",
    2: "the move would leave the machine's travel: check source_mm and destination_mm against $130",
    3: "it was reset while moving: position is lost, home again",
    6: "homing was reset",
    7: "the safety door opened while homing",
    8: "homing could not pull off the switch: check the switch and $27",
    9: "homing found no switch: check the switch and $130",
}
ERRORS = {
    "error:9": " (locked since an alarm: see to its cause and start again, which homes it)",
    "error:15": " (beyond the machine's travel: check source_mm and destination_mm against $130)",
    "error:5": " (homing is switched off: set $22=1, or home = false)",
}


@dataclass(frozen=True)
class GrblSettings:
    """Settings of a GRBL stage; positions are machine positions of the first axis.

    `limit_pin` is the letter that a status report shows for the switches at both ends ("" where there are none: then
    the positions in the reports say when the move began and ended). `poll_s` is the time between reports during the
    move and bounds how well its start and end are known.
    """

    port: str
    source_mm: float
    destination_mm: float
    feed_mm_min: float
    baud: int = 115200
    limit_pin: str = "X"
    home: bool = True
    tolerance_mm: float = 0.05
    poll_s: float = 0.01
    reply_s: float = 0.5
    boot_s: float = 4.0
    home_s: float = 60.0
    margin_s: float = 2.0


@dataclass(frozen=True)
class StatusReport:
    """One status report; `time_s` is when it was asked for, which GRBL answers from that very instant."""

    time_s: float
    state: str
    position_mm: float
    pressed: bool


@dataclass(frozen=True)
class _Transfer:
    deadline_s: float
    before: StatusReport  # the last report from the source, dated when the controller had the command
    left_s: float | None = None
    latest: StatusReport | None = None


def why_late(report: StatusReport, left_s: float | None, settings: GrblSettings) -> str:
    """What kept a transfer from ending in time, as far as the controller's last report tells, and the remedy.

    `left_s` is when the carriage left the source, None where it was not seen to. GRBL counts its own steps: a carriage
    that hangs is reported where it should be, and only a switch knows.
    """
    pin = settings.limit_pin
    if pin and left_s is None and report.pressed:
        return f"switch {pin} has stayed pressed since the source end: it sticks, or limit_pin is another's"
    if pin and abs(report.position_mm - settings.destination_mm) <= SWITCH_MM:
        return f'switch {pin} is not pressed: the carriage hangs, or the switch is unplugged (limit_pin = "": none)'
    if report.state == "Run":
        return f"slower than feed_mm_min = {settings.feed_mm_min:g}; see $110 and $120, and state the feed that it has"
    return f"stopped before {settings.destination_mm:g} mm; find out what took the move from it, and home it"


class GrblStage:
    """The stage. Every wait has a deadline; whatever is not a finished move in time is a StageError."""

    Settings = GrblSettings

    def __init__(self, settings: GrblSettings, port: SerialPort, clock: Clock, chambers: Chambers) -> None:
        self.settings = settings
        self._port = port
        self._clock = clock
        self._chambers = chambers
        self._partial = b""
        self._asked_s: float | None = None  # when the report that is under way was asked for
        self._next_ask_s = 0.0
        self._give_up_s = 0.0
        self._transfer: _Transfer | None = None
        self._gone = False  # the port died under us: what the controller has gone through since is not known
        self._may_move = False

    @classmethod
    def build(cls, name: str, settings: GrblSettings, parts: Parts) -> GrblStage:
        return cls(settings, parts.serial(settings.port, settings.baud), parts.clock, parts.chambers)

    def open(self) -> None:
        """Reset the controller, wait until it has booted, home it. Raises OSError or StageError."""
        self._port.open()
        self._partial, self._gone = b"", False
        self._reset()
        if self.settings.home:
            self._may_move = True
            self._command(b"$H", self.settings.home_s)
            self._may_move = False
        report = self._status()
        if report.state == "Alarm":
            raise StageError("the stage is locked and its position unknown: set home = true, or home it by hand")

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except OSError as error:
            raise self._lost(error) from error

    def _lost(self, error: OSError) -> StageError:
        self._gone = True
        return StageError(f"the stage on {self.settings.port} is gone ({error}): check its cable and supply")

    def _reset(self) -> None:
        self._write(RESET)
        self._wait_for(lambda line: line.startswith(b"Grbl"), self.settings.boot_s, "did not boot")

    def prepare(self, source: Air, destination: Air, airflow_m_s: float | None) -> None:
        """Carry the probes to the source end, then have the airs made."""
        self._transfer = None
        if self._gone:
            self._come_back()
        self._drive(self.settings.source_mm)
        deadline_s = self._clock.now() + self._travel_s() + self.settings.margin_s
        while True:
            report = self._status()
            self._check(report)
            if report.state == "Idle" and self._is_at(report, self.settings.source_mm):
                break
            if self._clock.now() > deadline_s:
                raise StageError(f"the stage did not reach its source end in time; {self._where(report)}")
            self._clock.sleep_until(self._clock.now() + self.settings.poll_s)
        self._may_move = False
        self._chambers.set_airs(source, destination, airflow_m_s)

    def _come_back(self) -> None:
        """After an unplug: open the port anew, and home, because the position is not known any more."""
        try:
            self.open()
        except StageError:
            raise
        except OSError as error:
            raise self._lost(error) from error

    def demand_transfer(self, duration_s: float) -> None:
        """A move takes as long as wanted, but for less than the feed allows."""
        if duration_s < self._travel_s():
            raise BenchError(
                f"transfer.duration_s is {duration_s:g} and the stage takes {self._travel_s():.2g} s at "
                f"feed_mm_min = {self.settings.feed_mm_min:g}; give more, or leave it out"
            )

    def begin_transfer(self, duration_s: float | None = None) -> None:
        """Start the move and return; `poll` follows it."""
        before = self._status()
        if not self._is_at(before, self.settings.source_mm):
            raise StageError(f"the probes are not at the source end; {self._where(before)}; prepare the run again")
        travel_s = self._travel_s() if duration_s is None else duration_s
        taken_s = self._drive(self.settings.destination_mm, travel_s)
        now = self._clock.now()
        deadline_s = now + travel_s + self.settings.margin_s
        self._transfer = _Transfer(deadline_s, replace(before, time_s=taken_s))
        self._next_ask_s = now

    def due_s(self) -> float:
        if self._transfer is None:
            return float("inf")
        if self._asked_s is None:
            return self._next_ask_s
        return min(self._port.due_s(), self._asked_s + ASK_AGAIN_S)

    def poll(self) -> Move | None:
        if self._transfer is None:
            return None
        if self._asked_s is None:
            if self._clock.now() >= self._next_ask_s:
                self._ask()
            return None
        for line in self._lines():
            report = self._report(line)
            if report is not None:
                return self._follow(self._transfer, report)
        self._persist(self._asked_s)
        return None

    def _follow(self, moving: _Transfer, report: StatusReport) -> Move | None:
        self._check(report)
        previous = moving.latest or moving.before
        left_s = moving.left_s
        if left_s is None and self._has_left(report):
            left_s = (previous.time_s + report.time_s) / 2
        arrived = report.pressed if self.settings.limit_pin else report.state == "Idle"
        if left_s is not None and arrived and self._is_at(report, self.settings.destination_mm, switch_mm=SWITCH_MM):
            if report.state == "Idle" or self.settings.limit_pin:
                self._transfer, self._may_move = None, False
                return Move(left_s, max(left_s, (previous.time_s + report.time_s) / 2))
        if self._clock.now() > moving.deadline_s:
            raise StageError(
                f"the stage did not arrive in time; {self._where(report)}: {why_late(report, left_s, self.settings)}"
            )
        self._transfer = _Transfer(moving.deadline_s, moving.before, left_s, report)
        return None

    def _has_left(self, report: StatusReport) -> bool:
        near = abs(report.position_mm - self.settings.source_mm)
        if self.settings.limit_pin and near < abs(self.settings.destination_mm - self.settings.source_mm) / 2:
            return not report.pressed
        return near > self.settings.tolerance_mm

    def _is_at(self, report: StatusReport, position_mm: float, switch_mm: float = 0.0) -> bool:
        return abs(report.position_mm - position_mm) <= max(self.settings.tolerance_mm, switch_mm)

    def _where(self, report: StatusReport) -> str:
        return f"it is at {report.position_mm:g} mm, state {report.state}"

    def _travel_s(self) -> float:
        return 60 * abs(self.settings.destination_mm - self.settings.source_mm) / self.settings.feed_mm_min

    def _drive(self, position_mm: float, travel_s: float | None = None) -> float:
        """Start a move; returns when the controller had the whole command, before which nothing can have moved."""
        feed_mm_min = self.settings.feed_mm_min * (1.0 if travel_s is None else self._travel_s() / travel_s)
        command = b"G90 G53 G1 X%.3f F%.1f" % (position_mm, feed_mm_min)
        taken_s = self._clock.now() + (len(command) + 1) * self._port.byte_s
        self._may_move = True
        self._command(command, self.settings.reply_s)
        return taken_s

    def _check(self, report: StatusReport) -> None:
        if report.state in ("Hold", "Door"):
            raise StageError(f"the stage was stopped ({report.state.lower()}) in mid-move; {self._where(report)}")
        if report.state in ("Alarm", "Sleep", "Check"):
            raise StageError(f"the stage is in state {report.state}; home it, then resume")

    def _command(self, line: bytes, within_s: float) -> None:
        self._write(line + b"\n")
        self._wait_for(lambda answer: answer == b"ok", within_s, f"did not take {line.decode()!r}")

    def _status(self) -> StatusReport:
        self._asked_s = None
        asked_s = self._ask()
        while True:
            for line in self._lines():
                report = self._report(line)
                if report is not None:
                    return report
            asked_s = self._persist(asked_s)
            self._clock.sleep_until(min(self._port.due_s(), asked_s + ASK_AGAIN_S))

    def _persist(self, asked_s: float) -> float:
        """Ask again for a report that does not come, and give up in the end; returns when it was last asked for."""
        now = self._clock.now()
        if now >= self._give_up_s:
            raise StageError(
                f"the stage controller does not answer on {self.settings.port}: check its cable and supply"
            )
        return self._ask() if now >= asked_s + ASK_AGAIN_S else asked_s

    def _ask(self) -> float:
        """Ask for a report; returns when."""
        if self._asked_s is None:
            self._lines()  # a late answer to an earlier question would be dated too late
            self._give_up_s = self._clock.now() + self.settings.reply_s
        asked_s = self._asked_s = self._clock.now()
        self._write(STATUS)
        self._next_ask_s = asked_s + self.settings.poll_s
        return asked_s

    def _report(self, line: bytes) -> StatusReport | None:
        found = REPORT.fullmatch(line)
        if not found or self._asked_s is None:
            return None
        pins = PRESSED.search(line)
        pin = self.settings.limit_pin
        pressed = bool(pin) and pins is not None and pin.encode() in pins[1]
        report = StatusReport(self._asked_s, found[1].decode(), float(found[2]), pressed)
        self._asked_s = None
        return report

    def _wait_for(self, wanted: Callable[[bytes], bool], within_s: float, complaint: str) -> None:
        deadline_s = self._clock.now() + within_s
        while self._clock.now() <= deadline_s:
            for line in self._lines():
                if line.startswith(b"error:"):
                    text = line.decode("ascii", "replace")
                    raise StageError(f"the stage controller {complaint}: {text}{ERRORS.get(text, '')}")
                if wanted(line):
                    return
            self._clock.sleep_until(min(self._port.due_s(), deadline_s + 1e-6))
        raise StageError(f"the stage controller on {self.settings.port} {complaint} in {within_s:g} s")

    def _lines(self) -> list[bytes]:
        """Whole lines that have arrived. Raises StageError on ALARM, whenever it comes."""
        try:
            arrived = self._port.read_waiting()
        except OSError as error:
            raise self._lost(error) from error
        *lines, rest = (self._partial + arrived).split(b"\n")
        self._partial = rest[-LONGEST_LINE:]
        lines = [line.strip(b"\r \0") for line in lines]
        for line in lines:
            if line.startswith(b"ALARM:"):
                self._may_move = False  # GRBL stops before it says so
                code = line[6:].decode("ascii", "replace")
                meaning = ALARMS.get(int(code) if len(code) <= 3 and code.isdecimal() else 0, "see the GRBL manual")
                raise StageError(f"the stage is in alarm {code}: {meaning}")
        return lines

    def make_safe(self) -> None:
        """Stop all motion: hold, and reset once it stands; the hold itself is sent at once.

        Raises
        ------
        StageError
            The carriage may be moving and the controller does not say that it stopped.
        """
        self._transfer = None
        try:
            self._write(HOLD)
            deadline_s = self._clock.now() + 1.0
            while (report := self._status()).state == "Run":
                if self._clock.now() > deadline_s:
                    raise StageError(f"the stage goes on moving after a hold; {self._where(report)}")
                self._clock.sleep_until(self._clock.now() + self.settings.poll_s)
            self._may_move = False
            if report.state == "Hold":
                self._reset()  # forget the rest of the move; standing still, the position is kept
        except StageError:
            if self._may_move:
                raise

    def close(self) -> None:
        self._port.close()
