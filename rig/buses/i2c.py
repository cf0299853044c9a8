"""One I2C bus over smbus2 (Linux i2c-dev, I2C_RDWR), and who may talk on it.

A write and a read are separate transactions (START .. STOP each): a HYT-271 converts between them. Neither smbus2 nor
the kernel locks across that pause, so this bus does: an owner among the sensors of this process, flock between
processes.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import TYPE_CHECKING

from shockrig.rig.seams import Clock

if TYPE_CHECKING:
    from smbus2 import SMBus

LEASE_S = 1.0  # an owner that is no longer polled loses the bus after this


class SmbusBus:
    """I2C bus at `path` ("/dev/i2c-1").

    Parameters
    ----------
    path : str
        Device file.
    clock : Clock
        For leases.
    lock_directory : Path or None
        Where the lock file that other processes see is put; None where no other process can reach the bus.
    """

    def __init__(self, path: str, clock: Clock, lock_directory: Path | None = None) -> None:
        self.path = path
        self._clock = clock
        self._lock_path = lock_directory and lock_directory / f"shockrig-{Path(path).name}.lock"
        self._lock_fd: int | None = None
        self._bus: SMBus | None = None
        self._owner: object | None = None
        self._since_s = 0.0
        self._waiting: dict[int, float] = {}  # id of a refused owner -> when it last asked, oldest first

    def open(self) -> None:
        """Open the device file; again after an unplug. Raises OSError."""
        import smbus2

        self._close_device()
        self._bus = smbus2.SMBus(self.path)
        if self._lock_path is not None and self._lock_fd is None:
            self._lock_fd = _open_lock(self._lock_path)

    def acquire(self, owner: object) -> bool:
        """Take the bus, first come first served; False at once where somebody else has it."""
        now = self._clock.now()
        if self._owner is owner:
            return True
        if self._owner is not None and now - self._since_s > LEASE_S:
            self.release(self._owner)
        self._waiting = {who: at for who, at in self._waiting.items() if now - at < LEASE_S}
        first = next(iter(self._waiting), id(owner))
        if self._owner is not None or first != id(owner) or not self._lock_others_out():
            self._waiting[id(owner)] = now
            return False
        self._waiting.pop(id(owner), None)
        self._owner, self._since_s = owner, now
        return True

    def release(self, owner: object) -> None:
        """Give the bus up; harmless where `owner` does not have it."""
        self._waiting.pop(id(owner), None)
        if self._owner is owner:
            self._owner = None
            if self._lock_fd is not None:
                fcntl.flock(self._lock_fd, fcntl.LOCK_UN)

    def _lock_others_out(self) -> bool:
        if self._lock_fd is None:
            return True
        try:
            fcntl.flock(self._lock_fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def write(self, address: int, data: bytes) -> None:
        """One write transaction; `data` may be empty (address only)."""
        from smbus2 import i2c_msg

        self._device().i2c_rdwr(i2c_msg.write(address, data))

    def read(self, address: int, length: int) -> bytes:
        """One read transaction."""
        from smbus2 import i2c_msg

        message = i2c_msg.read(address, length)
        self._device().i2c_rdwr(message)
        return bytes(message)

    def _device(self) -> SMBus:
        if self._bus is None:
            raise OSError(19, f"{self.path} is not open")
        return self._bus

    def _close_device(self) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            try:
                bus.close()
            except OSError:
                pass  # the adapter is gone, and its descriptor with it

    def close(self) -> None:
        self._close_device()
        self._owner = None
        self._waiting = {}
        if self._lock_fd is not None:
            os.close(self._lock_fd)  # gives the lock up too
            self._lock_fd = None


def _open_lock(path: Path) -> int:
    """A lock file that all users share: one who did not make it may still read it, which is enough for flock."""
    try:
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return os.open(path, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
