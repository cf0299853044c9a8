"""Emulated GRBL 1.1 controller with one axis and a limit switch at each end: motion, holds, alarms, homing, reset.

Real-time bytes ? ! ~ 0x18 act at once, lines are answered ok / error:N. Source: GRBL wiki, "Grbl v1.1 Interface".
"""

from __future__ import annotations

import re
from collections.abc import Callable

from shockrig.rig.virtual.serial_line import OutputQueue

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
AS_FAST = 0.99  # of the highest rate, from which a move is as fast as the carriage goes
WORD = re.compile(r"([A-Z])(-?\d+(?:\.\d+)?)")


class GrblController:
    """A serial Device that moves a carriage.

    Parameters
    ----------
    source_mm, destination_mm : float
        Where the switches are.
    left_source, left_destination : callable
        Told the time at which the carriage leaves a switch: the probes begin to leave that air.
    max_rate_mm_min : float
        Moves are never faster.
    slowed : callable, optional
        Told the time and the duration of a move from the source that is slower than that, in place of `left_source`.
    """

    BOOT_S = 0.3

    def __init__(
        self,
        source_mm: float,
        destination_mm: float,
        left_source: Callable[[float], None] = lambda at_s: None,
        left_destination: Callable[[float], None] = lambda at_s: None,
        max_rate_mm_min: float = 1e9,
        baud: int = 115200,
        needs_homing: bool = True,
        slowed: Callable[[float, float], None] | None = None,
    ) -> None:
        self.source_mm, self.destination_mm = source_mm, destination_mm
        self._left = {source_mm: left_source, destination_mm: left_destination}
        self._max_rate = max_rate_mm_min
        self._slowed = slowed
        self.byte_s = 10 / baud
        self._queue = OutputQueue(self.byte_s)
        self._line = b""
        self._needs_homing = needs_homing
        self._state = "Alarm" if needs_homing else "Idle"
        self._from_mm = self._to_mm = source_mm
        self._start_s = self._end_s = 0.0
        self.stalled = False  # a fault to order: the carriage jams while the controller believes that it steps
        self._deaf_until_s = 0.0

    def position_mm(self, at_s: float) -> float:
        """Where the carriage is."""
        if at_s >= self._end_s or self._end_s <= self._start_s:
            return self._to_mm
        share = max(0.0, at_s - self._start_s) / (self._end_s - self._start_s)
        return self._from_mm + share * (self._to_mm - self._from_mm)

    def alarm(self, code: int, at_s: float) -> None:
        """A fault to order: stop where it is and raise an alarm."""
        self._stop(at_s)
        self._state = "Alarm"
        self._queue.send(b"ALARM:%d\r\n" % code, at_s)

    def jam(self, stalled: bool, at_s: float) -> None:
        """A fault to order: the carriage stays where it is, or comes free and finds the controller's steps done."""
        if stalled and not self.stalled and self._state_at(at_s) == "Run":
            self._stop(at_s)
        self.stalled = stalled

    def _stop(self, at_s: float) -> None:
        self._from_mm = self._to_mm = self.position_mm(at_s)
        self._start_s = self._end_s = at_s

    def _state_at(self, at_s: float) -> str:
        if self._state == "Run" and at_s >= self._end_s and not self.stalled:
            self._state = "Idle"
        return self._state

    def output(self, until_s: float) -> bytes:
        return self._queue.output(until_s)

    def next_output_s(self) -> float:
        return self._queue.next_output_s()

    def receive(self, data: bytes, at_s: float) -> None:
        for code in data:
            byte = bytes((code,))
            if at_s < self._deaf_until_s:
                continue  # it boots
            if byte == b"?":
                self._queue.send(self._report(at_s), at_s)
            elif byte == b"!":
                if self._state_at(at_s) == "Run":
                    self._stop(at_s)
                    self._state = "Hold"
            elif byte == b"\x18":
                self._reset(at_s)
            elif byte in b"\r\n":
                line, self._line = self._line.decode("ascii", "replace").strip().upper(), b""
                if line:
                    self._execute(line, at_s)
            elif byte != b"~":
                self._line += byte

    def _reset(self, at_s: float) -> None:
        moving = self._state_at(at_s) == "Run"
        self._stop(at_s)
        self._line = b""
        if moving:
            self._queue.send(b"ALARM:3\r\n", at_s)
        if moving or self._needs_homing:
            self._state = "Alarm"
        elif self._state != "Alarm":
            self._state = "Idle"
        self._deaf_until_s = at_s + self.BOOT_S
        self._queue.send(BANNER, self._deaf_until_s)

    def _report(self, at_s: float) -> bytes:
        state, position_mm = self._state_at(at_s), self.position_mm(at_s)
        pins = b"|Pn:X" if self._on_switch(position_mm) else b""
        name = b"Hold:0" if state == "Hold" else state.encode()
        return b"<%s|MPos:%.3f,0.000,0.000|FS:0,0%s>\r\n" % (name, position_mm, pins)

    def _on_switch(self, position_mm: float) -> bool:
        return min(abs(position_mm - self.source_mm), abs(position_mm - self.destination_mm)) < 1e-6

    def _execute(self, line: str, at_s: float) -> None:
        if line == "$H":
            self._state = "Idle"
            self._go(self.source_mm, 60 * abs(self.destination_mm - self.source_mm), at_s)
            self._needs_homing = False
            self._queue.send(b"ok\r\n", self._end_s)
        elif line == "$X":
            self._state = "Idle" if self._state == "Alarm" else self._state
            self._queue.send(b"[MSG:Caution: Unlocked]\r\nok\r\n", at_s)
        elif self._state_at(at_s) == "Alarm":
            self._queue.send(b"error:9\r\n", at_s)
        else:
            words = dict(WORD.findall(line))
            if "X" not in words or float(words.get("F", 0)) <= 0:
                self._queue.send(b"error:22\r\n", at_s)
                return
            self._go(float(words["X"]), float(words["F"]), at_s)
            self._queue.send(b"ok\r\n", at_s)

    def _go(self, to_mm: float, rate_mm_min: float, at_s: float) -> None:
        self._stop(at_s)
        if abs(to_mm - self._from_mm) < 1e-9:
            return
        if self.stalled:
            self._state = "Run"
            return
        duration_s = 60 * abs(to_mm - self._from_mm) / min(rate_mm_min, self._max_rate)
        departed = self._left.get(self._from_mm)
        if self._slowed is not None and self._from_mm == self.source_mm and rate_mm_min < AS_FAST * self._max_rate:
            self._slowed(at_s, duration_s)
        elif departed is not None:
            departed(at_s)
        self._to_mm = to_mm
        self._end_s = at_s + duration_s
        self._state = "Run"
