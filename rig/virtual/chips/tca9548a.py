"""Emulated TCA9548A: an adapter's wire with chips behind the eight channels of a multiplexer."""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping, Sequence

from shockrig.rig.seams import Clock
from shockrig.rig.virtual.i2c_dev import Chip, I2cWire


class Mux:
    """Its one register: the last byte written, bit N connects channel N; a read returns it."""

    powered = True

    def __init__(self, address: int) -> None:
        self.address = address
        self.register = 0

    def write(self, data: bytes, at_s: float) -> None:
        self.register = data[-1] if data else self.register

    def read(self, length: int, at_s: float) -> bytes:
        return bytes([self.register] * length)


class MuxedWire(I2cWire):
    """A wire on which the multiplexer always answers, and the chips of the channels that it connects.

    Two chips that answer at once garble each other: EIO.
    """

    def __init__(self, channels: Mapping[int, Sequence[Chip]], clock: Clock, address: int = 0x70) -> None:
        super().__init__([], clock)
        self.mux = Mux(address)
        self.channels = channels

    def _chip(self, address: int) -> Chip:
        connected = [
            chip for channel, chips in self.channels.items() if self.mux.register >> channel & 1 for chip in chips
        ]
        self.chips = [self.mux, *connected]
        if sum(chip.powered and chip.address == address for chip in self.chips) > 1:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return super()._chip(address)
