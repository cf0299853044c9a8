"""Emulated SHT3x and SHT4x (Sensirion) at the byte level: commands, measuring times, words with their CRC.

    word        u16 big endian, then its CRC-8 (x^8 + x^5 + x^4 + 1, begins at 0xFF; of 0xBEEF it is 0x92)
    SHT3x       command of two bytes; T = -45 + 175 S / 65535 degC, RH = 100 S / 65535 %
    SHT4x       command of one byte;  T = -45 + 175 S / 65535 degC, RH = -6 + 125 S / 65535 %, clipped by the driver

A read before the end of a measurement, or with nothing asked for, is not acknowledged. Sources: Sensirion, data sheets
SHT3x-DIS (version 7) and SHT4x (version 6.6); times are their largest. Heaters, alerts and clock stretching are not
emulated: a read that the chip would stretch is not acknowledged, and drivers of Linux wait anyway.
"""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Callable, Mapping

FULL_SCALE = 65535
SERIAL = (0x0F1E, 0x2D3C)
SHT3X_SINGLE = {  # command -> how long it takes [s]
    0x2400: 0.0155, 0x240B: 0.0065, 0x2416: 0.0045, 0x2C06: 0.0155, 0x2C0D: 0.0065, 0x2C10: 0.0045,
}  # fmt: skip
SHT3X_PERIODIC = {  # command -> time between measurements [s]
    0x2032: 2.0, 0x2024: 2.0, 0x202F: 2.0, 0x2130: 1.0, 0x2126: 1.0, 0x212D: 1.0, 0x2236: 0.5, 0x2220: 0.5,
    0x222B: 0.5, 0x2334: 0.25, 0x2322: 0.25, 0x2329: 0.25, 0x2737: 0.1, 0x2721: 0.1, 0x272A: 0.1,
}  # fmt: skip
FETCH, BREAK, RESET, STATUS, CLEAR_STATUS = 0xE000, 0x3093, 0x30A2, 0xF32D, 0x3041
SHT3X_SERIAL = (0x3780, 0x3682)
AFTER_RESET = 0x8010  # status: an alert is pending, a reset was seen
SHT4X_MEASURE = {0xFD: 0.0083, 0xF6: 0.0045, 0xE0: 0.0016}
SHT4X_SERIAL, SHT4X_RESET = 0x89, 0x94
RESET_S = 0.001
LONGEST_MEASURE_S = max(SHT3X_SINGLE.values())

Sampler = Callable[[float], float]


def crc8(data: bytes) -> int:
    """Checksum of a word."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x31 if crc & 0x80 else crc << 1) & 0xFF
    return crc


def words(*values: int) -> bytes:
    """Words as they go over the bus, each with its checksum."""
    return b"".join(word + bytes((crc8(word),)) for word in (struct.pack(">H", value) for value in values))


def _raw(value: float, low: float, span: float) -> int:
    return min(max(round((value - low) / span * FULL_SCALE), 0), FULL_SCALE)


class _ShtChip:
    """What both families share: one answer at a time, ready after a while.

    Parameters
    ----------
    humidity_percent, temperature_c : callable
        What the film and the die are at a time in seconds on the bench clock.
    """

    humidity_scale = 0.0, 100.0  # of S = 0, and of the whole range [%RH]

    def __init__(self, humidity_percent: Sampler, temperature_c: Sampler, address: int = 0x44) -> None:
        self._humidity_percent, self._temperature_c = humidity_percent, temperature_c
        self.address, self.powered = address, True
        self._answer: bytes | None = None
        self._ready_s = 0.0

    def _measured(self, at_s: float) -> bytes:
        temperature = _raw(self._temperature_c(at_s), -45.0, 175.0)
        return words(temperature, _raw(self._humidity_percent(at_s), *self.humidity_scale))

    def _measure(self, at_s: float, takes_s: float) -> None:
        self._answer, self._ready_s = self._measured(at_s + takes_s / 2), at_s + takes_s

    def read(self, length: int, at_s: float) -> bytes:
        if self._answer is None or at_s < self._ready_s:
            raise OSError(errno.EREMOTEIO, os.strerror(errno.EREMOTEIO))
        answer, self._answer = self._answer, None
        return answer[:length].ljust(length, b"\xff")


class Sht3xChip(_ShtChip):
    """An SHT30, SHT31 or SHT35."""

    def __init__(self, humidity_percent: Sampler, temperature_c: Sampler, address: int = 0x44) -> None:
        super().__init__(humidity_percent, temperature_c, address)
        self._status = AFTER_RESET
        self._periodic: tuple[float, float] | None = None  # when it began, time between
        self._fetched = -1

    def write(self, data: bytes, at_s: float) -> None:
        if len(data) < 2:
            return  # an address alone asks for nothing
        command = int.from_bytes(data[:2], "big")
        if command in SHT3X_SINGLE and self._periodic is None:
            self._measure(at_s, SHT3X_SINGLE[command])
        elif command in SHT3X_PERIODIC:
            self._periodic, self._fetched = (at_s, SHT3X_PERIODIC[command]), -1
        elif command == FETCH:
            self._fetch(at_s)
        elif command == BREAK:
            self._periodic = self._answer = None
        elif command == RESET:
            self._periodic, self._answer, self._status = None, None, AFTER_RESET
        elif command in (STATUS, *SHT3X_SERIAL):
            self._answer, self._ready_s = words(*((self._status,) if command == STATUS else SERIAL)), at_s
        elif command == CLEAR_STATUS:
            self._status = 0

    def _fetch(self, at_s: float) -> None:
        """The last measurement of the periodic mode, which is there once."""
        self._answer = None
        if self._periodic is not None:
            began_s, period_s = self._periodic
            number = int((at_s - began_s - LONGEST_MEASURE_S) // period_s)
            if number > self._fetched:
                self._answer, self._ready_s = self._measured(began_s + number * period_s), at_s
                self._fetched = number


class Sht4xChip(_ShtChip):
    """An SHT40, SHT41 or SHT45."""

    humidity_scale = -6.0, 125.0
    commands: Mapping[int, float] = SHT4X_MEASURE

    def write(self, data: bytes, at_s: float) -> None:
        command = data[0] if data else -1
        if command in self.commands:
            self._measure(at_s, self.commands[command])
        elif command == SHT4X_SERIAL:
            self._answer, self._ready_s = words(*SERIAL), at_s
        elif command == SHT4X_RESET:
            self._answer, self._ready_s = None, at_s + RESET_S
