"""One channel of a TCA9548A multiplexer as an I2C bus: sensors of one address on one adapter.

The multiplexer has one register, written and read without an address: bit N connects channel N. It is written before
every transaction, because a dip of the supply or another program forgets it. Source: Texas Instruments SCPS207.
"""

from __future__ import annotations

from shockrig.rig.seams import I2cBus

ADDRESSES = range(0x70, 0x78)
CHANNELS = range(8)


class MuxedBus:
    """The bus behind one channel; whoever has it has the whole adapter, as the other channels' sensors know."""

    def __init__(self, bus: I2cBus, mux_address: int, channel: int) -> None:
        self._bus = bus
        self._mux_address = mux_address
        self._select = bytes([1 << channel])

    def open(self) -> None:
        self._bus.open()

    def acquire(self, owner: object) -> bool:
        return self._bus.acquire(owner)

    def release(self, owner: object) -> None:
        self._bus.release(owner)

    def write(self, address: int, data: bytes) -> None:
        self._bus.write(self._mux_address, self._select)
        self._bus.write(address, data)

    def read(self, address: int, length: int) -> bytes:
        self._bus.write(self._mux_address, self._select)
        return self._bus.read(address, length)

    def close(self) -> None:
        self._bus.close()
