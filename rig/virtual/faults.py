"""Faults to order, at the bus: a schedule of what goes wrong when, wrapped around an I2C wire or a serial device.

Each fault is a kind and a window on the bench clock; what the drivers then see is what a cable, an adapter or a chip
would do to them. The kinds are listed in I2C_KINDS, SERIAL_KINDS and, of
messages on a link (rig/virtual/vehicle.py), LINK_KINDS.
"""

from __future__ import annotations

import errno
import math
import os
import random
from collections.abc import Iterable
from dataclasses import dataclass

from shockrig.rig.seams import Clock
from shockrig.rig.virtual.chips.grbl import GrblController
from shockrig.rig.virtual.chips.hyt271 import Hyt271Chip
from shockrig.rig.virtual.i2c_dev import Wire
from shockrig.rig.virtual.serial_line import Device

ERRNO = {
    "nack": errno.EREMOTEIO,
    "nack_enxio": errno.ENXIO,
    "nack_eio": errno.EIO,
    "timeout": errno.ETIMEDOUT,
    "busy": errno.EAGAIN,
    "unplug": errno.ENODEV,
}
I2C_KINDS = {
    **{kind: f"every transaction fails with {errno.errorcode[number]}" for kind, number in ERRNO.items()},
    "stuck_high": "reads are all ones",
    "stuck_low": "everything is acknowledged and reads are all zeros",
    "flip": "one bit of every read is flipped",
    "lost_request": "measurement requests never reach the chip, so that fetches are stale",
    "slow": "the chip converts five times slower",
    "command_mode": "a brown-out at the start of the window leaves the chip in command mode",
}
SERIAL_KINDS = {
    "silence": "nothing arrives",
    "unplug": "every access fails with EIO",
    "flip": "one bit of one byte in every burst is flipped",
    "half_line": "the tail of every burst is lost",
    "headless": "the head of every burst is lost",
    "glued": "line ends are lost",
    "doubled": "every burst comes twice",
    "nul": "NUL bytes before every burst",
    "garbage": "random bytes before every burst",
    "endless": "printable bytes without a line end before every burst, more than a line holds",
    "alarm": "a stage hits a hard limit at the start of the window, stops and locks itself",
    "stall": "a stage's carriage jams while its controller believes that it steps",
}
LINK_KINDS = {
    "loss": "half of the messages never arrive",
    "delay": "messages arrive half a second late",
    "units": "hundredths are sent as whole units (MAVLink), degC as kelvin (DroneCAN)",
    "stamps": "every stamp is said twice",
    "one_old": "values are those of one poll ago, under the stamp of this one",
}


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong from `start_s` to `end_s`, at each chance with `probability`."""

    kind: str
    start_s: float
    end_s: float = math.inf
    probability: float = 1.0


class Schedule:
    """Which faults are active when."""

    def __init__(self, faults: Iterable[Fault], known: dict[str, str], clock: Clock, seed: int) -> None:
        self.faults = list(faults)
        for fault in self.faults:
            if fault.kind not in known:
                raise ValueError(f"no fault {fault.kind!r} here; there are {', '.join(known)}")
        self._clock = clock
        self.random = random.Random(seed)
        self._begun: set[int] = set()

    def active(self) -> set[str]:
        now = self._clock.now()
        return {
            fault.kind
            for fault in self.faults
            if fault.start_s <= now < fault.end_s and self.random.random() < fault.probability
        }

    def begins(self, kind: str) -> bool:
        """True once for each fault of a kind, when its time has come."""
        now = self._clock.now()
        due = {i for i, fault in enumerate(self.faults) if fault.kind == kind and fault.start_s <= now} - self._begun
        self._begun |= due
        return bool(due)

    def flip(self, data: bytes) -> bytes:
        at, bit = self.random.randrange(len(data)), self.random.randrange(8)
        return data[:at] + bytes((data[at] ^ 1 << bit,)) + data[at + 1 :]


class FaultyI2c:
    """An I2C wire with a fault schedule before it; `chip` is the one that browns out and slows down."""

    def __init__(
        self, wire: Wire, faults: Iterable[Fault], clock: Clock, chip: Hyt271Chip | None = None, seed: int = 0
    ) -> None:
        self._wire = wire
        self._schedule = Schedule(faults, I2C_KINDS, clock, seed)
        self._clock = clock
        self._chip = chip
        self._conversion_s = chip.conversion_s if chip else 0.0

    def _strike(self) -> set[str]:
        active = self._schedule.active()
        for kind in active & ERRNO.keys():
            raise OSError(ERRNO[kind], os.strerror(ERRNO[kind]))
        if self._chip is not None:
            self._chip.conversion_s = self._conversion_s * (5 if "slow" in active else 1)
            if self._schedule.begins("command_mode"):
                self._chip.brown_out(self._clock.now())
        return active

    def open(self) -> None:
        if "unplug" in self._schedule.active():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        self._wire.open()

    def write(self, address: int, data: bytes) -> None:
        active = self._strike()
        if not active & {"stuck_low", "lost_request"}:
            self._wire.write(address, data)

    def read(self, address: int, length: int) -> bytes:
        active = self._strike()
        if "stuck_low" in active:
            return bytes(length)
        answer = self._wire.read(address, length)
        if "stuck_high" in active:
            return b"\xff" * length
        return self._schedule.flip(answer) if "flip" in active else answer


class FaultySerial:
    """A serial device with a fault schedule between it and the host."""

    def __init__(self, device: Device, faults: Iterable[Fault], clock: Clock, seed: int = 0) -> None:
        self._device = device
        self._clock = clock
        self._schedule = Schedule(faults, SERIAL_KINDS, clock, seed)

    @property
    def byte_s(self) -> float:
        return self._device.byte_s

    def next_output_s(self) -> float:
        return self._device.next_output_s()

    def _strike(self) -> set[str]:
        active = self._schedule.active()
        self._raise_if_unplugged(active)
        if isinstance(self._device, GrblController):
            if self._schedule.begins("alarm"):
                self._device.alarm(1, self._clock.now())
            self._device.jam("stall" in active, self._clock.now())
        return active

    def receive(self, data: bytes, at_s: float) -> None:
        active = self._strike()
        if "silence" not in active:
            self._device.receive(data, at_s)

    def output(self, until_s: float) -> bytes:
        active = self._strike()
        data = self._device.output(until_s)
        if not data:
            return data
        pick = self._schedule.random
        if "flip" in active:
            data = self._schedule.flip(data)
        if "half_line" in active:
            data = data[: pick.randrange(len(data))]
        if "headless" in active:
            data = data[pick.randrange(len(data)) :]
        if "glued" in active:
            data = data.replace(b"\r", b"").replace(b"\n", b"")
        if "doubled" in active:
            data = data * 2
        if "nul" in active:
            data = bytes(pick.randrange(1, 4)) + data
        if "garbage" in active:
            data = pick.randbytes(pick.randrange(1, 8)) + data
        if "endless" in active:
            data = b"7" * 1000 + data
        return b"" if "silence" in active else data

    def _raise_if_unplugged(self, active: set[str]) -> None:
        if "unplug" in active:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
