"""A fake /dev/i2c-N under the real smbus2: its ioctl, os.open and os.close are replaced in this process.

smbus2 fills its true ctypes structures (I2C_RDWR: i2c_rdwr_ioctl_data -> i2c_msg[]) and gets OSErrors as from the
kernel. Linux uapi: i2c-dev.h, i2c.h.
"""

from __future__ import annotations

import ctypes
import errno
import importlib
import os
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any, Protocol

from shockrig.rig.seams import Clock

I2C_FUNCS, I2C_RDWR, I2C_M_RD = 0x0705, 0x0707, 0x0001
FUNCTIONALITY = 0x0EFF0009  # I2C and the SMBus emulation, as bcm2835 and designware advertise it
FIRST_DESCRIPTOR = 1 << 24  # beyond anything the kernel hands out


class Chip(Protocol):
    """An I2C chip: answers to `address` while `powered`."""

    address: int
    powered: bool

    def write(self, data: bytes, at_s: float) -> None: ...

    def read(self, length: int, at_s: float) -> bytes: ...


class Wire(Protocol):
    """What the fake device file passes transactions to; a fault injector is one that wraps another."""

    def open(self) -> None: ...

    def write(self, address: int, data: bytes) -> None: ...

    def read(self, address: int, length: int) -> bytes: ...


class I2cWire:
    """An adapter with chips on it; a transaction takes its nine bit times for each byte.

    `accepts_empty_writes` False is a Raspberry Pi 5 (designware); `nack_errno` differs by adapter (121, 6 or 5).
    """

    def __init__(
        self,
        chips: Iterable[Chip],
        clock: Clock,
        bit_rate_hz: float = 100_000.0,
        accepts_empty_writes: bool = True,
        nack_errno: int = errno.EREMOTEIO,
    ) -> None:
        self.chips = list(chips)
        self._clock = clock
        self._byte_s = 9 / bit_rate_hz
        self._accepts_empty_writes = accepts_empty_writes
        self._nack_errno = nack_errno

    def open(self) -> None:
        pass

    def _chip(self, address: int) -> Chip:
        for chip in self.chips:
            if chip.powered and chip.address == address:
                return chip
        self._spend(1)
        raise OSError(self._nack_errno, os.strerror(self._nack_errno))

    def _spend(self, n_bytes: int) -> None:
        self._clock.sleep_until(self._clock.now() + n_bytes * self._byte_s)

    def write(self, address: int, data: bytes) -> None:
        if not data and not self._accepts_empty_writes:
            raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))
        chip = self._chip(address)
        self._spend(1 + len(data))
        chip.write(data, self._clock.now())

    def read(self, address: int, length: int) -> bytes:
        chip = self._chip(address)
        answer = chip.read(length, self._clock.now())
        self._spend(1 + length)
        return answer


class _Router:
    """Stands in for `ioctl` and `os` inside smbus2; whatever is not a fake device goes to the kernel as before."""

    def __init__(self) -> None:
        self.wires: dict[str, Wire] = {}
        self._open: dict[int, str] = {}
        self._next = FIRST_DESCRIPTOR
        self._kept: tuple[Any, Any] | None = None

    def install(self) -> None:
        module: Any = importlib.import_module("smbus2.smbus2")  # smbus2's stubs do not tell its own imports
        if self._kept is None:
            self._kept = module.ioctl, module.os
            module.ioctl = self.ioctl
            module.os = SimpleNamespace(open=self.open, close=self.close, O_RDWR=os.O_RDWR)

    def uninstall(self) -> None:
        if self._kept is not None:
            module: Any = importlib.import_module("smbus2.smbus2")
            module.ioctl, module.os = self._kept
            self._kept = None

    def open(self, path: str, flags: int) -> int:
        if path not in self.wires:
            return os.open(path, flags)
        self.wires[path].open()
        self._next += 1
        self._open[self._next] = path
        return self._next

    def close(self, descriptor: int) -> None:
        if self._open.pop(descriptor, None) is None:
            os.close(descriptor)

    def ioctl(self, descriptor: int, request: int, argument: Any) -> Any:
        if descriptor not in self._open:
            import fcntl

            return fcntl.ioctl(descriptor, request, argument)
        wire = self.wires.get(self._open[descriptor])
        if wire is None:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        if request == I2C_FUNCS:
            argument.value = FUNCTIONALITY
        elif request == I2C_RDWR:
            for message in argument.msgs[: argument.nmsgs]:
                if message.flags & I2C_M_RD:
                    answer = wire.read(message.addr, message.len)
                    ctypes.memmove(message.buf, answer, message.len)
                else:
                    wire.write(message.addr, ctypes.string_at(message.buf, message.len))
        else:
            raise OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
        return 0


_router = _Router()


def plug_in(path: str, wire: Wire) -> None:
    """Make `path` a device file for smbus2, with `wire` behind it."""
    _router.wires[path] = wire
    _router.install()


def pull_out(path: str) -> None:
    """Take the device file away; descriptors that are open on it get ENODEV."""
    _router.wires.pop(path, None)
    if not _router.wires:
        _router.uninstall()
