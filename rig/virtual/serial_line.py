"""Emulated serial devices and the two ways to reach them: in memory (any clock) and through a pseudo-terminal (real
time).

In memory the object has the part of pyserial's interface that a port uses (in_waiting, read, write, close). On the
pseudo-terminal the real pyserial, or any other program, opens the far end while a thread moves the bytes.
"""

from __future__ import annotations

import errno
import math
import os
import select
import threading
import tty
from typing import Protocol

from shockrig.rig.seams import Clock


class Device(Protocol):
    """A serial device: bytes out at their times, bytes in."""

    @property
    def byte_s(self) -> float: ...

    def output(self, until_s: float) -> bytes:
        """The bytes that have left the device since the last call, up to `until_s`."""
        ...

    def next_output_s(self) -> float:
        """When more will have left it; infinity where it has nothing to say."""
        ...

    def receive(self, data: bytes, at_s: float) -> None: ...


class OutputQueue:
    """Bytes on their way out, one byte time apart."""

    def __init__(self, byte_s: float) -> None:
        self.byte_s = byte_s
        self._bursts: list[tuple[float, bytes]] = []
        self._free_s = -math.inf

    def send(self, data: bytes, at_s: float) -> None:
        """Queue `data`; its first byte leaves at `at_s` or when the line is free."""
        start_s = max(at_s, self._free_s)
        self._bursts.append((start_s, data))
        self._free_s = start_s + len(data) * self.byte_s

    def output(self, until_s: float) -> bytes:
        gone = b""
        while self._bursts:
            start_s, data = self._bursts[0]
            n = min(len(data), math.floor((until_s - start_s) / self.byte_s + 1e-3))
            if n <= 0:
                break
            gone += data[:n]
            if n < len(data):
                self._bursts[0] = (start_s + n * self.byte_s, data[n:])
                break
            del self._bursts[0]
        return gone

    def next_output_s(self) -> float:
        """When the first burst will have left in full."""
        if not self._bursts:
            return math.inf
        start_s, data = self._bursts[0]
        return start_s + len(data) * self.byte_s


class MemorySerial:
    """pyserial's face on an emulated device, without any file: time is whatever the clock says."""

    def __init__(self, device: Device, clock: Clock) -> None:
        self._device = device
        self._clock = clock
        self._waiting = b""
        self.is_open = True
        self._device.output(clock.now())  # what was sent before the port was opened is lost, as on a real one

    @property
    def in_waiting(self) -> int:
        self._fill()
        return len(self._waiting)

    def _fill(self) -> None:
        if not self.is_open:
            raise OSError(errno.EBADF, "the port is closed")
        self._waiting += self._device.output(self._clock.now())

    def next_arrival_s(self) -> float:
        return self._device.next_output_s()

    def read(self, size: int = 1) -> bytes:
        self._fill()
        data, self._waiting = self._waiting[:size], self._waiting[size:]
        return data

    def write(self, data: bytes) -> int:
        self._fill()
        self._device.receive(bytes(data), self._clock.now() + len(data) * self._device.byte_s)
        return len(data)

    def close(self) -> None:
        self.is_open = False


class PtyDevice:
    """A device on a pseudo-terminal in real time; `path` is what a program opens. Close it when done.

    What the device says while nobody has the port open is lost, as on a real one. Our own far end is closed therefore:
    the kernel then tells a hang-up until somebody opens it.
    """

    def __init__(self, device: Device, clock: Clock, tick_s: float = 0.002) -> None:
        self._device = device
        self._clock = clock
        self._tick_s = tick_s
        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(slave)
        os.close(slave)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._pump, name=f"pty {self.path}", daemon=True)
        self._thread.start()

    def _pump(self) -> None:
        poller = select.poll()
        poller.register(self._master, select.POLLIN)
        while not self._stop.is_set():
            events = sum(event for _, event in poller.poll(1000 * self._tick_s))
            try:
                if events & select.POLLIN:
                    self._device.receive(os.read(self._master, 4096), self._clock.now())
                data = self._device.output(self._clock.now())
            except OSError:
                self._hang_up()  # an injected unplug: the far end reads EIO from now on
                return
            if events & select.POLLHUP:
                self._stop.wait(self._tick_s)  # nobody has the port open; poll does not wait then
            elif data:
                try:
                    os.write(self._master, data)
                except BlockingIOError:
                    pass  # nobody reads: a real UART loses its bytes too

    def _hang_up(self) -> None:
        os.close(self._master)
        self._master = -1

    def close(self) -> None:
        self._stop.set()
        self._thread.join(timeout=2)
        if self._master >= 0:
            self._hang_up()
