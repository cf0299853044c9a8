"""Emulated HYT-271 at the byte level: conversion time, stale bit, command mode with EEPROM.

An address-only write starts a conversion (temperature first, then humidity); a fetch returns the last finished reading,
Stale where it was fetched before. Source: IST application note AHHYTM_E2.2.1; timing as seen in public drivers.
"""

from __future__ import annotations

from collections.abc import Callable

FULL_SCALE = 16383
COMMAND_WINDOW_S = 0.010  # after power-on
EEPROM_WRITE_S = 0.012
ADDRESS_WORD = 0x1C


def encode_frame(humidity_percent: float, temperature_c: float, stale: bool = False) -> bytes:
    """The four bytes of a reading; both quantities are clipped to the 14-bit range."""
    humidity_raw = min(max(round(humidity_percent / 100 * FULL_SCALE), 0), FULL_SCALE)
    temperature_raw = min(max(round((temperature_c + 40) / 165 * FULL_SCALE), 0), FULL_SCALE)
    word = stale << 30 | humidity_raw << 16 | temperature_raw << 2
    return word.to_bytes(4, "big")


class Hyt271Chip:
    """One emulated sensor.

    Parameters
    ----------
    humidity_percent, temperature_c : callable
        What the film and the die are at a time in seconds on the bench clock.
    conversion_s : float
        From request to result; the die is read after a quarter of it, the film after five sixths.
    """

    def __init__(
        self,
        humidity_percent: Callable[[float], float],
        temperature_c: Callable[[float], float],
        address: int = 0x28,
        conversion_s: float = 0.06,
        powered_at_s: float = -1.0,
    ) -> None:
        self._humidity_percent = humidity_percent
        self._temperature_c = temperature_c
        self.conversion_s = conversion_s
        self.eeprom = [0] * 32
        self.eeprom[ADDRESS_WORD] = address
        self.power_on(powered_at_s)

    def power_on(self, at_s: float) -> None:
        """Supply comes up: the stored address takes hold, and the command window opens."""
        self.powered = True
        self.command_mode = False
        self.address = self.eeprom[ADDRESS_WORD] & 0x7F
        self._powered_at_s = at_s
        self._requested_s: float | None = None
        self._ready_s = at_s
        self._frame = encode_frame(0.0, -40.0)
        self._reply = b""

    def power_off(self) -> None:
        """Supply goes down: nothing is acknowledged any more."""
        self.powered = False

    def brown_out(self, at_s: float) -> None:
        """A dip of the supply that leaves the sensor in command mode."""
        self.power_on(at_s)
        self.command_mode = True
        self._reply = bytes((0x81, 0, 0))

    def write(self, data: bytes, at_s: float) -> None:
        if self.command_mode:
            self._command(data, at_s)
        elif data[:1] == b"\xa0" and at_s - self._powered_at_s <= COMMAND_WINDOW_S:
            self.command_mode, self._reply = True, bytes((0x81, 0, 0))
        else:
            self._finish_conversion(at_s)
            if self._requested_s is None:
                self._requested_s, self._ready_s = at_s, at_s + self.conversion_s

    def _command(self, data: bytes, at_s: float) -> None:
        if at_s < self._ready_s or len(data) != 3:
            self._reply = bytes((0x82, 0, 0))  # busy, or no such command: anything but 0x81 is a refusal
            return
        code, word = data[0], data[0] & 0x1F
        if code < 0x20:
            self._reply = bytes((0x81, *self.eeprom[word].to_bytes(2, "big")))
        elif 0x40 <= code < 0x60:
            self.eeprom[word] = data[1] << 8 | data[2]
            self._ready_s = at_s + EEPROM_WRITE_S
            self._reply = bytes((0x81, 0, 0))
        elif code == 0x80:
            self.command_mode, self._reply = False, b""
        else:
            self._reply = bytes((0x82, 0, 0))

    def _finish_conversion(self, at_s: float) -> bool:
        """Whether a conversion has ended by `at_s` whose result was not fetched yet."""
        if self._requested_s is None or at_s < self._ready_s:
            return False
        length_s = self._ready_s - self._requested_s
        temperature_c = self._temperature_c(self._requested_s + length_s / 4)
        humidity_percent = self._humidity_percent(self._requested_s + length_s * 5 / 6)
        self._frame = encode_frame(humidity_percent, temperature_c)
        self._requested_s = None
        return True

    def read(self, length: int, at_s: float) -> bytes:
        if self.command_mode:
            reply = self._reply if at_s >= self._ready_s else bytes((0x82, 0, 0))
            return (reply + bytes(length))[:length]
        fresh = self._finish_conversion(at_s)
        frame = self._frame if fresh else bytes((self._frame[0] | 0x40,)) + self._frame[1:]
        return frame[:length].ljust(length, b"\xff")
