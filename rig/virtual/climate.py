"""Emulated chambers and fans behind their real protocols, on TCP ports of this machine: SCPI lines, and Modbus TCP.

What a device is asked for and what it reads is a `Climate`; it may be a model of its own (`Approach`) or the virtual
world's chambers. Neither server shares code with the drivers: pyvisa and pymodbus talk to them unmodified.
"""

from __future__ import annotations

import contextlib
import math
import re
import socket
import socketserver
import struct
import threading
from collections.abc import Callable
from typing import Protocol

from shockrig.rig.seams import Air, Clock, known

SCPI = {"TEMP": "temperature", "HUM": "humidity", "FLOW": "airflow"}
# Modbus: registers of set points (holding) and of readings (input), and what one count of each is
REGISTERS = ("temperature", "humidity", "airflow")
REGISTER_COUNTS = {"temperature": 0.1, "humidity": 0.1, "airflow": 0.01}
RUN_REGISTER = 3
FIRST_AIR = Air(20.0, 50.0)
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
_SET = re.compile(r"SOUR:(TEMP|HUM|FLOW) ([-+]?\d+(?:\.\d+)?)")
_READ = re.compile(r"(MEAS|SOUR):(TEMP|HUM|FLOW)\?")


class Climate(Protocol):
    """What stands behind a device: set points, readings, on or off; one thread at a time."""

    def set(self, quantity: str, value: float) -> None:
        """Take a set point; ValueError where it cannot be."""
        ...

    def asked(self, quantity: str) -> float: ...

    def read(self, quantity: str) -> float: ...

    def switch(self, on: bool) -> None: ...


class Approach:
    """A chamber or fan that closes in on its set points exponentially while it is on.

    `limits` are what it takes; by `clips` it takes more in silence and makes the limit of it, as some devices do.
    """

    def __init__(
        self,
        clock: Clock,
        settling_s: float,
        limits: dict[str, tuple[float, float]] | None = None,
        clips: bool = False,
        **begins: float,
    ) -> None:
        self._clock, self._settling_s, self._limits, self._clips = clock, settling_s, limits or {}, clips
        self._from = {"temperature": 20.0, "humidity": 50.0, "airflow": 0.0, **begins}
        self._asked = dict(self._from)
        self._since_s = clock.now()
        self.on = False

    def set(self, quantity: str, value: float) -> None:
        low, high = self._limits.get(quantity, (-math.inf, math.inf))
        if not low <= value <= high:
            if not self._clips:
                raise ValueError(f"{quantity} {value:g}")
            value = min(max(value, low), high)
        self._begin_anew()
        self._asked[quantity] = value

    def asked(self, quantity: str) -> float:
        return self._asked[quantity]

    def read(self, quantity: str) -> float:
        if not self.on:
            return self._from[quantity]
        left = math.exp(-(self._clock.now() - self._since_s) / self._settling_s)
        return self._asked[quantity] + left * (self._from[quantity] - self._asked[quantity])

    def switch(self, on: bool) -> None:
        self._begin_anew()
        self.on = on

    def _begin_anew(self) -> None:
        self._from = {quantity: self.read(quantity) for quantity in self._from}
        self._since_s = self._clock.now()


class Room:
    """Two airs and an airflow as single set points, each of which a device of its own may change.

    `make` has the world make all of them: (source, destination, airflow in m/s).
    """

    def __init__(
        self,
        make: Callable[[Air, Air, float], None],
        source: Air = FIRST_AIR,
        destination: Air = FIRST_AIR,
        airflow_m_s: float = 5.0,
    ) -> None:
        self._make = make
        self.values = {
            ("source", "temperature"): known(source.temperature_c),
            ("source", "humidity"): known(source.humidity_percent),
            ("destination", "temperature"): known(destination.temperature_c),
            ("destination", "humidity"): known(destination.humidity_percent),
            ("fan", "airflow"): airflow_m_s,
        }

    def change(self, place: str, quantity: str, value: float) -> None:
        """Have the world make it, with the rest as it was; ValueError where this place does not make that."""
        if (place, quantity) not in self.values:
            raise ValueError(f"the {place} makes no {quantity}")
        self.values[place, quantity] = value
        source, destination = (
            Air(self.values[place, "temperature"], self.values[place, "humidity"])
            for place in ("source", "destination")
        )
        self._make(source, destination, self.values["fan", "airflow"])


class RoomPart:
    """One chamber or the fan of a room, as the device in front of it sees it: at its set point at once."""

    def __init__(self, room: Room, place: str) -> None:
        self._room, self._place = room, place

    def set(self, quantity: str, value: float) -> None:
        self._room.change(self._place, quantity, value)

    def asked(self, quantity: str) -> float:
        return self._room.values[self._place, quantity]

    def read(self, quantity: str) -> float:
        return self._room.values[self._place, quantity]

    def switch(self, on: bool) -> None:
        """It holds its air either way."""


class ScpiServer:
    """A device of SCPI lines on a free port of this machine; `port` is its VISA resource."""

    def __init__(self, climate: Climate) -> None:
        self._climate = climate
        self._errors: list[str] = []
        self.heard: list[str] = []
        self._server = _Server(self._serve)
        self.port = f"TCPIP::127.0.0.1::{self._server.number}::SOCKET"

    def answer(self, line: str) -> str | None:
        """What one line is answered with; None where it is a command."""
        self.heard.append(line)
        if line == "*IDN?":
            return "shockrig,emulated climate,0,1"
        if line == "SYST:ERR?":
            return self._errors.pop(0) if self._errors else '0,"No error"'
        if line in ("OUTP ON", "OUTP OFF"):
            self._climate.switch(line == "OUTP ON")
        elif found := _SET.fullmatch(line):
            try:
                self._climate.set(SCPI[found[1]], float(found[2]))
            except ValueError:
                self._errors.append('-222,"Data out of range"')
        elif found := _READ.fullmatch(line):
            try:
                value = (self._climate.read if found[1] == "MEAS" else self._climate.asked)(SCPI[found[2]])
            except LookupError:
                value = 9.91e37  # what SCPI says where there is no number
            return f"{value:.3f}"
        else:
            self._errors.append('-113,"Undefined header"')
        return None

    def _serve(self, handler: socketserver.StreamRequestHandler, lock: threading.Lock) -> None:
        for line in handler.rfile:
            with lock:
                answer = self.answer(line.decode("ascii", "replace").strip())
            if answer is not None:
                handler.wfile.write(answer.encode() + b"\n")

    def close(self) -> None:
        """Let go of the port; connections are cut."""
        self._server.stop()


class ModbusServer:
    """A device of Modbus registers, unit 1, on a free port of this machine; `port` is tcp://HOST:PORT."""

    def __init__(self, climate: Climate) -> None:
        self._climate = climate
        self.heard: list[bytes] = []
        self._server = _Server(self._serve)
        self.port = f"tcp://127.0.0.1:{self._server.number}"

    def answer(self, request: bytes) -> bytes:
        """The answer to one protocol data unit: function code and what follows it."""
        self.heard.append(request)
        function = request[0]
        try:
            if function in (3, 4):
                first, count = struct.unpack(">HH", request[1:5])
                numbers = [self._register(function, register) & 0xFFFF for register in range(first, first + count)]
                return struct.pack(f">BB{count}H", function, 2 * count, *numbers)
            if function == 6:
                register, number = struct.unpack(">Hh", request[1:5])
                self._write(register, number)
                return request
            return bytes([function | 0x80, ILLEGAL_FUNCTION])
        except (LookupError, struct.error):
            return bytes([function | 0x80, ILLEGAL_ADDRESS])
        except ValueError:
            return bytes([function | 0x80, ILLEGAL_VALUE])

    def _register(self, function: int, register: int) -> int:
        quantity = REGISTERS[register]
        value = self._climate.asked(quantity) if function == 3 else self._climate.read(quantity)
        return round(value / REGISTER_COUNTS[quantity])

    def _write(self, register: int, number: int) -> None:
        if register == RUN_REGISTER:
            self._climate.switch(bool(number))
        else:
            self._climate.set(REGISTERS[register], number * REGISTER_COUNTS[REGISTERS[register]])

    def _serve(self, handler: socketserver.StreamRequestHandler, lock: threading.Lock) -> None:
        while len(head := handler.rfile.read(7)) == 7:
            transaction, protocol, length, unit = struct.unpack(">HHHB", head)
            request = handler.rfile.read(length - 1)
            if protocol or not request:
                return
            with lock:
                answer = self.answer(request)
            handler.wfile.write(struct.pack(">HHHB", transaction, 0, len(answer) + 1, unit) + answer)

    def close(self) -> None:
        """Let go of the port; connections are cut."""
        self._server.stop()


class _Server(socketserver.ThreadingTCPServer):
    """One device on a port of its own; requests of all connections are answered one at a time."""

    daemon_threads = True
    allow_reuse_address = True
    block_on_close = False

    def __init__(self, serve: Callable[[socketserver.StreamRequestHandler, threading.Lock], None]) -> None:
        lock = threading.Lock()
        connections: set[socket.socket] = set()
        self._connections = connections

        class Handler(socketserver.StreamRequestHandler):
            disable_nagle_algorithm = True

            def handle(self) -> None:
                connections.add(self.connection)
                with contextlib.suppress(OSError):  # cut off, by either side
                    serve(self, lock)
                connections.discard(self.connection)

        super().__init__(("127.0.0.1", 0), Handler)
        self.number = self.server_address[1]
        self._thread = threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self.shutdown()
        self._thread.join()
        self.server_close()
        for connection in list(self._connections):
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
