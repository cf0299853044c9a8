"""HYT-271 humidity and temperature sensor (I2C).

Measurement request: address+W without data. Data fetch: 4 bytes, CMode(7) Stale(6) RH[13:0] T[13:0] xx, big endian;
RH = 100 raw / 16383 %, T = 165 raw / 16383 - 40 degC. No checksum; a fetch that comes too early returns the previous
reading with Stale set. Source: IST application note AHHYTM_E2.2.1, HYT-221 data sheet.
"""

from __future__ import annotations

import errno
from collections import Counter
from dataclasses import dataclass
from typing import Any

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.buses.mux import ADDRESSES, CHANNELS, MuxedBus
from shockrig.rig.seams import Clock, I2cBus, Outcome, Parts, Reading

FULL_SCALE = 16383
COMMAND_MODE_BIT, STALE_BIT = 0x80, 0x40
LEAVE_COMMAND_MODE = bytes((0x80, 0x00, 0x00))
GONE = {errno.ENODEV, errno.ENOENT, errno.EBADF, errno.ESHUTDOWN}  # the adapter was unplugged
COPIES, DOUBTFUL_COPIES, DOUBT_READINGS = 3, 5, 50  # of a frame that must agree; more for a while after a damaged one
LATE = {errno.ETIMEDOUT, errno.EAGAIN}  # clock stretched too long, or another master won


@dataclass(frozen=True)
class Hyt271Settings:
    """Settings of one HYT-271; all but `bus` may be left out.

    `conversion_s` is the wait between request and first fetch (public drivers use 0.06 to 0.1 s; the maker's figure
    is not known): too early a fetch does no harm, too late a one costs the next reading its place at 10 Hz. From
    then on the fetch is repeated every `retry_s` until it is fresh, or until `deadline_s` after the request was
    first tried. `sampled_after_s` says how long after the request the humidity is taken: it is converted after the
    temperature, so late in the conversion. Measure it where tens of milliseconds matter. `confirm` fetches every
    reading three times (five for a while after a damaged one): a frame has no checksum, and the repeats (the same
    bits, Stale set) are the only sign of a bit that was flipped on the way. `mux_channel` is the channel of a TCA9548A
    multiplexer at `mux_address` behind which the sensor is.
    """

    bus: int | str
    address: int = 0x28
    serial: str | None = None
    film_thickness_m: float = 1e-5
    period_s: float = 0.1
    conversion_s: float = 0.06
    sampled_after_s: float = 0.05
    retry_s: float = 0.005
    deadline_s: float = 0.25
    retries: int = 3
    confirm: bool = True
    plausible_temperature_c: tuple[float, float] = (-60.0, 125.0)
    leave_command_mode: bool = True
    mux_channel: int = -1
    mux_address: int = 0x70

    def __post_init__(self) -> None:
        if self.mux_channel != -1 and self.mux_channel not in CHANNELS:
            raise BenchError(
                f"mux_channel = {self.mux_channel} must be from 0 to 7, or -1 where there is no multiplexer"
            )
        if self.mux_address not in ADDRESSES:
            raise BenchError(f"mux_address = {self.mux_address:#04x} must be from 0x70 to 0x77")


def decode_frame(frame: bytes) -> tuple[Outcome, dict[str, float]]:
    """What a 4-byte data fetch says.

    Returns
    -------
    outcome : Outcome
        OK, STALE, COMMAND_MODE, or IMPLAUSIBLE for a short frame and for a bus stuck low (all zeros, which would decode
        to a clean 0 %RH and -40 degC) or high (all ones).
    values : dict
        "humidity_percent" and "temperature_c" (the die's); empty unless OK or STALE.
    """
    if len(frame) != 4 or frame in (b"\x00\x00\x00\x00", b"\xff\xff\xff\xff"):
        return Outcome.IMPLAUSIBLE, {}
    if frame[0] & COMMAND_MODE_BIT:
        return Outcome.COMMAND_MODE, {}
    humidity_raw = (frame[0] & 0x3F) << 8 | frame[1]
    temperature_raw = frame[2] << 6 | frame[3] >> 2
    values = {
        "humidity_percent": 100.0 * humidity_raw / FULL_SCALE,
        "temperature_c": 165.0 * temperature_raw / FULL_SCALE - 40.0,
    }
    return (Outcome.STALE if frame[0] & STALE_BIT else Outcome.OK), values


def bus_of(settings: Hyt271Settings, parts: Parts) -> I2cBus:
    """The adapter's bus, or the one behind a channel of its multiplexer."""
    bus = parts.i2c(settings.bus)
    return bus if settings.mux_channel < 0 else MuxedBus(bus, settings.mux_address, settings.mux_channel)


class Hyt271:
    """A HYT-271 read on a regular grid: request, wait, fetch; never more than one transaction in a poll.

    `counts` keeps the book: outcomes by name, "retries", "stale_fetches", "lock_waits", "reopened", "fallback",
    "unconfirmed" and "errno_N".
    """

    Settings = Hyt271Settings
    KIND = "hyt-271"

    def __init__(self, name: str, settings: Hyt271Settings, bus: I2cBus, clock: Clock) -> None:
        self.name = name
        self.settings = settings
        self.counts: Counter[str] = Counter()
        self._bus = bus
        self._clock = clock
        self._request = b""  # becomes one zero byte for good where the adapter refuses empty writes
        self._requested_s: float | None = None
        self._began_s: float | None = None
        self._attempts = 0
        self._slot_s = 0.0
        self._next_s = 0.0
        self._gone = False
        self._unconfirmed: bytes | None = None
        self._old = b""  # the stale frame seen last
        self._copies = 0
        self._doubt = 0
        self._overdue = False  # a request was never answered afresh: its result may still come

    @classmethod
    def build(cls, name: str, settings: Hyt271Settings, parts: Parts) -> Hyt271:
        return cls(name, settings, bus_of(settings, parts), parts.clock)

    def describe(self) -> dict[str, Any]:
        return {"kind": self.KIND, "serial": self.settings.serial, "film_thickness_m": self.settings.film_thickness_m}

    def open(self) -> None:
        """Open the bus and have one request acknowledged as proof that somebody is there; raises OSError."""
        self._bus.open()
        self._measurement_request()
        self._requested_s = self._began_s = None
        # its conversion must have ended before the first one that counts, whose result would be dated too late else
        self._slot_s = self._next_s = self._clock.now() + self.settings.deadline_s

    def due_s(self) -> float:
        return self._next_s

    def poll(self) -> list[Reading]:
        """The reading that has become ready, if any."""
        if self._clock.now() < self._next_s:
            return []
        return self._try_request() if self._requested_s is None else self._try_fetch()

    def _try_request(self) -> list[Reading]:
        now = self._clock.now()
        if self._began_s is None:
            self._began_s, self._attempts = now, 0
        try:
            if self._gone:
                self._bus.open()
                self._gone = False
                self.counts["reopened"] += 1
            if not self._bus.acquire(self):
                self.counts["lock_waits"] += 1
                return self._again_or(Outcome.TIMED_OUT)
            self._measurement_request()
        except OSError as error:
            return self._failed(error)
        self._requested_s = self._clock.now()  # the conversion starts with the STOP of the request
        self._next_s = self._requested_s + self.settings.conversion_s
        return []

    def _measurement_request(self) -> None:
        try:
            self._bus.write(self.settings.address, self._request)
        except OSError as error:
            if error.errno != errno.EOPNOTSUPP or self._request:
                raise
            self._request = b"\x00"
            self.counts["fallback"] += 1
            self._bus.write(self.settings.address, self._request)

    def _try_fetch(self) -> list[Reading]:
        try:
            frame = self._bus.read(self.settings.address, 4)
        except OSError as error:
            return self._failed(error)
        self._attempts = 0
        if self._unconfirmed is not None:
            return self._compare(self._unconfirmed, frame)
        outcome, values = decode_frame(frame)
        if outcome is Outcome.OK:
            self._unconfirmed, self._copies, self._next_s = frame, 1, self._clock.now()
            if self.settings.confirm:
                return []
        return self._judge(outcome, values, frame)

    def _compare(self, frame: bytes, again: bytes) -> list[Reading]:
        if again[1:] != frame[1:] or (again[0] ^ frame[0]) & ~STALE_BIT:
            self.counts["unconfirmed"] += 1
            self._doubt = DOUBT_READINGS
            return self._finish(Outcome.IMPLAUSIBLE, frame + again)
        self._copies += 1
        if self._copies < (DOUBTFUL_COPIES if self._doubt else COPIES):
            self._next_s = self._clock.now()
            return []
        return self._judge(*decode_frame(frame), frame=frame)

    def _judge(self, outcome: Outcome, values: dict[str, float], frame: bytes) -> list[Reading]:
        if outcome is Outcome.STALE:
            self.counts["stale_fetches"] += 1
            self._copies = self._copies + 1 if frame == self._old else 1
            self._old = frame
            if self.settings.confirm and self._copies < COPIES:
                outcome, values = Outcome.IMPLAUSIBLE, {}
            return self._again_or(outcome, frame, values)
        low, high = self.settings.plausible_temperature_c
        if outcome is Outcome.OK and not low <= values["temperature_c"] <= high:
            outcome, values = Outcome.IMPLAUSIBLE, {}
        if outcome is Outcome.COMMAND_MODE and self.settings.leave_command_mode:
            self._leave_command_mode()
        if outcome is Outcome.OK and self._overdue:
            outcome = Outcome.STALE  # of this request or of the one before? A wrong date is worse than none
        return self._finish(outcome, frame, values)

    def _leave_command_mode(self) -> None:
        """After a brown-out the sensor may wake up listening for commands, and would answer nothing else for ever."""
        try:
            self._bus.write(self.settings.address, LEAVE_COMMAND_MODE)
        except OSError as error:
            self.counts[f"errno_{error.errno}"] += 1

    def _failed(self, error: OSError) -> list[Reading]:
        self.counts[f"errno_{error.errno}"] += 1
        if error.errno in GONE:
            self._gone = True
            return self._finish(Outcome.NOT_ACKNOWLEDGED)
        outcome = Outcome.TIMED_OUT if error.errno in LATE else Outcome.NOT_ACKNOWLEDGED
        self._attempts += 1
        if self._attempts > self.settings.retries:
            return self._finish(outcome)
        self.counts["retries"] += 1
        return self._again_or(outcome)

    def _again_or(self, outcome: Outcome, frame: bytes = b"", values: dict[str, float] | None = None) -> list[Reading]:
        """Try once more in a moment, unless the deadline would pass: then that was the outcome."""
        again_s = self._clock.now() + self.settings.retry_s
        if self._began_s is not None and again_s - self._began_s > self.settings.deadline_s:
            return self._finish(outcome, frame, values)
        self._next_s = again_s
        return []

    def _finish(self, outcome: Outcome, frame: bytes = b"", values: dict[str, float] | None = None) -> list[Reading]:
        now = self._clock.now()
        self._bus.release(self)
        if self._requested_s is not None:
            self._overdue = self._unconfirmed is None
        self._doubt = max(self._doubt - 1, 0)
        requested_s = next((at_s for at_s in (self._requested_s, self._began_s) if at_s is not None), now)
        sampled_s = requested_s + self.settings.sampled_after_s if outcome is Outcome.OK else None
        self.counts[str(outcome)] += 1
        self._requested_s = self._began_s = self._unconfirmed = None
        self._old = b""
        self._slot_s += self.settings.period_s
        if self._slot_s < now - self.settings.period_s:  # far behind: stay on the grid, leave the missed slots out
            self._slot_s += (now - self._slot_s) // self.settings.period_s * self.settings.period_s
        self._next_s = max(self._slot_s, now)
        return [Reading(self.name, outcome, requested_s, now, values or {}, frame, sampled_s)]

    def close(self) -> None:
        self._bus.release(self)
        self._bus.close()
