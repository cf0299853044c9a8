"""One serial port over pyserial, read without ever waiting: pyserial's own readline() times out byte by byte."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from shockrig.rig.seams import Clock

BITS_PER_BYTE = 10  # 8N1: start bit, eight data bits, stop bit
WRITE_TIMEOUT_S = 0.5


def pyserial_opener(path: str, baud: int) -> Callable[[], OpenPort]:
    """Opens the real port, for this process alone."""

    def opener() -> OpenPort:
        import serial

        port: OpenPort = serial.Serial(path, baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
        return port

    return opener


class OpenPort(Protocol):
    """What is used of pyserial's Serial."""

    @property
    def in_waiting(self) -> int: ...

    def read(self, size: int = 1) -> bytes: ...

    def write(self, data: bytes) -> Any: ...

    def close(self) -> None: ...


class PyserialPort:
    """A port with pyserial's interface, opened by `opener` and opened anew by the same after an unplug.

    Parameters
    ----------
    opener : callable
        Returns an open serial.Serial (timeout 0) or anything with its in_waiting, read, write and close.
    poll_s : float
        How soon a real port is looked at again. An object that knows when bytes will come (next_arrival_s) is asked.
    """

    def __init__(self, opener: Callable[[], OpenPort], clock: Clock, baud: int, poll_s: float = 0.002) -> None:
        self._opener = opener
        self._clock = clock
        self._poll_s = poll_s
        self._serial: OpenPort | None = None
        self._looked_s = 0.0
        self.byte_s = BITS_PER_BYTE / baud

    def open(self) -> None:
        """Raises OSError (pyserial's SerialException is one)."""
        self.close()
        self._serial = self._opener()
        self._looked_s = self._clock.now()

    def due_s(self) -> float:
        known = getattr(self._serial, "next_arrival_s", None)
        return known() if known else self._looked_s + self._poll_s

    def read_waiting(self) -> bytes:
        """What has arrived. Raises OSError after an unplug (read: SerialException, in_waiting: OSError 5)."""
        port = self._port()
        self._looked_s = self._clock.now()
        return port.read(port.in_waiting or 1)

    def write(self, data: bytes) -> None:
        self._port().write(data)

    def _port(self) -> OpenPort:
        if self._serial is None:
            raise OSError(19, "the serial port is not open")
        return self._serial

    def close(self) -> None:
        port, self._serial = self._serial, None
        if port is not None:
            try:
                port.close()
            except OSError:
                pass  # it is gone already
