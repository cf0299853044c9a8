"""Where messages go: bytes over UDP or a serial port, CAN frames over UDP multicast or a CAN interface; none waits.

    udpout:HOST:PORT   udpin:HOST:PORT   /dev/serial0   /dev/serial0,57600        bytes (MAVLink)
    mcast:   mcast:1   can0                                                       frames (DroneCAN)

A multicast packet is u16 0x2934, u16 CRC, u16 flags, u32 id with bit 31 for 29-bit ids, data; little endian,
CRC-16-CCITT over all behind it, group 239.65.82.BUS, port 57732 (python-dronecan, ArduPilot). A frame of SocketCAN:
linux/can.h.
"""

from __future__ import annotations

import binascii
import contextlib
import os
import socket
import struct
from typing import TYPE_CHECKING, Protocol

from shockrig.rig.bench_errors import BenchError

if TYPE_CHECKING:
    import serial

GROUP, CAN_UDP_PORT, MAGIC = "239.65.82", 57732, 0x2934
EXTENDED = 1 << 31
LONGEST_PACKET = 2048
WAITING_BYTES = 4096  # that a serial port has not taken: what comes on top is dropped, whole messages of it
DEFAULT_BAUD = 57600


class BytesPort(Protocol):
    """Bytes out and in."""

    @property
    def dropped(self) -> int:
        """Messages that could not be sent at once."""
        ...

    def send(self, data: bytes) -> None: ...

    def receive(self) -> bytes:
        """What has arrived, b"" where nothing has."""
        ...

    def close(self) -> None: ...


class FramePort(Protocol):
    """CAN frames with 29-bit ids, out and in."""

    @property
    def dropped(self) -> int:
        """Frames that could not be sent at once."""
        ...

    def send(self, identifier: int, data: bytes) -> None: ...

    def receive(self) -> list[tuple[int, bytes]]: ...

    def close(self) -> None: ...


class UdpPort:
    """Datagrams to a fixed address (`udpout`), or from anybody and back to whom was heard last (`udpin`)."""

    def __init__(self, host: str, port: int, listens: bool) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.dropped = 0
        self._peer: tuple[str, int] | None = None if listens else (socket.gethostbyname(host), port)
        self._listens = listens
        if listens:
            try:
                self._socket.bind((host, port))
            except OSError:
                self._socket.close()
                raise

    @property
    def number(self) -> int:
        """The port that it listens at."""
        return int(self._socket.getsockname()[1])

    def send(self, data: bytes) -> None:
        try:
            if self._peer is not None:
                self._socket.sendto(data, self._peer)
        except OSError:  # no route, nobody there, or a full buffer: the flight goes on
            self.dropped += 1

    def receive(self) -> bytes:
        found = b""
        with contextlib.suppress(OSError):
            while True:
                data, peer = self._socket.recvfrom(LONGEST_PACKET)
                found += data
                if self._listens:
                    self._peer = peer
        return found

    def close(self) -> None:
        self._socket.close()


class SerialBytes:
    """A serial port that is written without waiting and opened again where it went away; raises OSError at first."""

    def __init__(self, path: str, baud: int) -> None:
        self._path, self._baud = path, baud
        self._waiting = b""
        self.dropped = 0
        self._port: serial.Serial | None = self._opened()

    def _opened(self) -> serial.Serial:
        import serial

        return serial.Serial(self._path, self._baud, timeout=0, write_timeout=0)

    def send(self, data: bytes) -> None:
        if len(self._waiting) + len(data) > WAITING_BYTES:
            self.dropped += 1
        else:
            self._waiting += data
        try:
            if self._port is None:
                self._port = self._opened()
            # pyserial's own write goes round and round where nobody takes the bytes, whatever its timeout
            self._waiting = self._waiting[os.write(self._port.fileno(), self._waiting) :]
        except BlockingIOError:
            pass
        except OSError:
            self._hang_up()

    def receive(self) -> bytes:
        try:
            return b"" if self._port is None else bytes(self._port.read(self._port.in_waiting or 1))
        except OSError:
            self._hang_up()
            return b""

    def _hang_up(self) -> None:
        self.close()
        self._port, self._waiting = None, b""

    def close(self) -> None:
        if self._port is not None:
            with contextlib.suppress(OSError):
                self._port.close()


class MulticastCan:
    """CAN frames over UDP multicast, as autopilots and their simulators take them."""

    def __init__(self, bus: int) -> None:
        group = f"{GROUP}.{bus}"
        self.dropped = 0
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._out.connect((group, CAN_UDP_PORT))
            for one in (self._in, self._out):
                one.setblocking(False)
            self._in.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._in.bind((group, CAN_UDP_PORT))
            member = struct.pack("4s4s", socket.inet_aton(group), bytes(4))
            self._in.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        except OSError:
            self.close()
            raise

    def send(self, identifier: int, data: bytes) -> None:
        body = struct.pack("<HI", 0, identifier | EXTENDED) + data
        try:
            self._out.send(struct.pack("<HH", MAGIC, binascii.crc_hqx(body, 0xFFFF)) + body)
        except OSError:
            self.dropped += 1

    def receive(self) -> list[tuple[int, bytes]]:
        found = []
        with contextlib.suppress(OSError):
            while True:
                packet, sender = self._in.recvfrom(LONGEST_PACKET)
                if sender[1] == self._out.getsockname()[1] or len(packet) < 10:
                    continue
                magic, crc, _, identifier = struct.unpack_from("<HHHI", packet)
                if magic == MAGIC and crc == binascii.crc_hqx(packet[4:], 0xFFFF) and identifier & EXTENDED:
                    found.append((identifier & ~EXTENDED, packet[10:]))
        return found

    def close(self) -> None:
        self._out.close()
        self._in.close()


class SocketCan:
    """A CAN interface of Linux ("can0"), set up by `ip link set can0 up type can bitrate 1000000`."""

    FRAME = struct.Struct("=IB3x8s")

    def __init__(self, interface: str) -> None:
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.dropped = 0
        try:
            self._socket.setblocking(False)
            self._socket.bind((interface,))
        except OSError:
            self._socket.close()
            raise

    def send(self, identifier: int, data: bytes) -> None:
        try:
            self._socket.send(self.FRAME.pack(identifier | EXTENDED, len(data), data))
        except OSError:
            self.dropped += 1

    def receive(self) -> list[tuple[int, bytes]]:
        found = []
        with contextlib.suppress(OSError):
            while True:
                identifier, length, data = self.FRAME.unpack(self._socket.recv(self.FRAME.size))
                if identifier & EXTENDED:
                    found.append((identifier & 0x1FFFFFFF, data[:length]))
        return found

    def close(self) -> None:
        self._socket.close()


def open_bytes(address: str) -> BytesPort:
    """The port at an address. Raises BenchError."""
    kind, _, where = address.partition(":")
    try:
        if kind in ("udpout", "udpin"):
            host, _, port = where.rpartition(":")
            if not host or not port.isdecimal() or not 0 <= int(port) < 65536:
                raise BenchError(f"{address}: expected {kind}:HOST:PORT, such as {kind}:127.0.0.1:14550")
            return UdpPort(host, int(port), kind == "udpin")
        path, _, baud = address.partition(",")
        if not path.startswith("/") or (baud and not baud.isdecimal()):
            raise BenchError(f"{address}: expected udpout:HOST:PORT, udpin:HOST:PORT or /dev/NAME[,BAUD]")
        return SerialBytes(path, int(baud or DEFAULT_BAUD))
    except BenchError:
        raise
    except OSError as error:
        raise BenchError(f"{address}: {error.strerror or error}; give another address") from None


def open_frames(address: str) -> FramePort:
    """The CAN bus at an address. Raises BenchError."""
    kind, colon, bus = address.partition(":")
    try:
        if kind == "mcast" and colon:
            if not (bus or "0").isdecimal() or not 0 <= int(bus or 0) < 256:
                raise BenchError(f"{address}: expected mcast: or mcast:BUS")
            return MulticastCan(int(bus or 0))
        return SocketCan(address)
    except OSError as error:
        raise BenchError(
            f"{address}: {error.strerror or error}; expected mcast: (CAN over UDP) or a CAN interface such as can0"
        ) from None
