"""DroneCAN on CAN frames of 29 bits: a hygrometer's node, and the reading of what such nodes send.

    message id  priority(5) type(16) 0 source(7)
    service id  priority(5) service(8) request(1) to(7) 1 source(7)
    last byte   start(1) end(1) toggle(1) transfer(5); a transfer of several frames begins with its CRC-16-CCITT, which
                is seeded by the type's signature

    dronecan.sensors.hygrometer.Hygrometer (1032)   float16 degC, float16 %, uint8 id; NaN where there is no value
    uavcan.equipment.device.Temperature (1110)      uint16 id, float16 K, uint8 flags
    uavcan.protocol.NodeStatus (341)                uint32 uptime [s], uint8 health and mode, uint16 of the vendor
    uavcan.protocol.GetNodeInfo (1, a service)      status, software, hardware, name

Source: dronecan.github.io, Specification; the DSDL files of its repository. Everything but the node's own description
fits into one frame.
"""

from __future__ import annotations

import binascii
import hashlib
import struct
import uuid
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from shockrig.rig.links.ports import FramePort
from shockrig.rig.links.said import SaidAir

HYGROMETER, DEVICE_TEMPERATURE, NODE_STATUS, GET_NODE_INFO = 1032, 1110, 341, 1
GET_NODE_INFO_SIGNATURE = 0xEE468A8121C46A9E
PRIORITY = 16  # of 0 (highest) to 31
KELVIN = 273.15
LARGEST_HALF = 65504.0
FRAME_BYTES = 7  # of a frame's eight, beside the tail
START, END, TOGGLE = 0x80, 0x40, 0x20
OWN_NUMBERS = range(1, 126)  # 126 and 127 are for tools
VERSION = (0, 1)


@dataclass(frozen=True)
class HygrometerFrame:
    """What a Hygrometer message says."""

    source: int
    transfer: int
    temperature_c: float
    humidity_percent: float
    sensor: int


@dataclass(frozen=True)
class TemperatureFrame:
    """What a device's Temperature message says."""

    source: int
    transfer: int
    temperature_k: float
    device: int


def this_machine() -> bytes:
    """Sixteen bytes that this computer has and no other."""
    machine = Path("/etc/machine-id")
    identity = machine.read_bytes() if machine.is_file() else str(uuid.getnode()).encode()
    return hashlib.sha256(b"shockrig" + identity).digest()[:16]


def _half(value: float) -> float:
    """Within what 16 bits hold; NaN stays."""
    return value if value != value else min(max(value, -LARGEST_HALF), LARGEST_HALF)


def hygrometer(temperature_c: float, humidity_percent: float, sensor: int) -> bytes:
    """Payload of a Hygrometer message."""
    return struct.pack("<eeB", _half(temperature_c), _half(humidity_percent), sensor)


def device_temperature(temperature_c: float, device: int) -> bytes:
    """Payload of a device's Temperature message."""
    return struct.pack("<HeB", device, _half(temperature_c + KELVIN), 0)


def node_status(uptime_s: float) -> bytes:
    """Payload of a NodeStatus message: healthy and operational."""
    return struct.pack("<IBH", int(uptime_s), 0, 0)


def node_info(uptime_s: float, name: str, unique: bytes) -> bytes:
    """Payload of an answer to GetNodeInfo; no CRC of the image, no certificate."""
    software = struct.pack("<BBBIQ", *VERSION, 0, 0, 0)
    hardware = struct.pack("<BB16sB", 0, 0, unique, 0)
    return node_status(uptime_s) + software + hardware + name.encode("ascii")


def frames(payload: bytes, transfer: int, signature: int) -> list[bytes]:
    """The data of a transfer's frames."""
    if len(payload) <= FRAME_BYTES:
        return [payload + bytes((START | END | transfer,))]
    crc = binascii.crc_hqx(payload, binascii.crc_hqx(struct.pack("<Q", signature), 0xFFFF))
    whole = struct.pack("<H", crc) + payload
    pieces = [whole[at : at + FRAME_BYTES] for at in range(0, len(whole), FRAME_BYTES)]
    last = len(pieces) - 1
    return [
        piece + bytes((START * (k == 0) | END * (k == last) | TOGGLE * (k % 2) | transfer,))
        for k, piece in enumerate(pieces)
    ]


def decoded(identifier: int, data: bytes) -> HygrometerFrame | TemperatureFrame | None:
    """What a frame says of an air; None where it is another message, or cut short."""
    if identifier & 0x80 or not data or data[-1] & (START | END | TOGGLE) != START | END:
        return None
    kind, source, transfer, payload = identifier >> 8 & 0xFFFF, identifier & 0x7F, data[-1] & 0x1F, data[:-1]
    if len(payload) == 5 and kind == HYGROMETER:
        return HygrometerFrame(source, transfer, *struct.unpack("<eeB", payload))
    if len(payload) == 5 and kind == DEVICE_TEMPERATURE:
        device, kelvin, _ = struct.unpack("<HeB", payload)
        return TemperatureFrame(source, transfer, kelvin, device)
    return None


class DronecanNode:
    """A node that says an air: sensor 0 is the air (corrected where it can be), sensor 1 what was read.

    `number`, of OWN_NUMBERS, is its own on the bus, `unique` 16 bytes that no other node has.
    """

    def __init__(self, port: FramePort, number: int, unique: bytes, name: str = "org.shockrig.fly") -> None:
        self.port = port
        self._number, self._name, self._unique = number, name, unique[:16].ljust(16, b"\0")
        self._transfers: Counter[int] = Counter()

    def broadcast(self, kind: int, payload: bytes) -> None:
        """Send a message of one frame."""
        (data,) = frames(payload, self._transfers[kind] % 32, 0)
        self._transfers[kind] += 1
        self.port.send(PRIORITY << 24 | kind << 8 | self._number, data)

    @property
    def dropped(self) -> int:
        return self.port.dropped

    def send(self, said: SaidAir) -> None:
        for sensor, (temperature_c, humidity_percent) in enumerate(said.pairs()):
            self.broadcast(HYGROMETER, hygrometer(temperature_c, humidity_percent, sensor))
            self.broadcast(DEVICE_TEMPERATURE, device_temperature(temperature_c, sensor))

    def tell(self, text: str, now_s: float) -> None:
        """Words go by MAVLink; here NaN says it."""

    def beat(self, now_s: float) -> None:
        """Once a second: that the node is there, and what it is to whom asked."""
        self.broadcast(NODE_STATUS, node_status(now_s))
        for identifier, data in self.port.receive():
            if identifier & 0x80 and identifier & 0x8000 and identifier >> 16 & 0xFF == GET_NODE_INFO and data:
                if identifier >> 8 & 0x7F == self._number:
                    self._describe(identifier & 0x7F, data[-1] & 0x1F, now_s)

    def _describe(self, to: int, transfer: int, now_s: float) -> None:
        identifier = PRIORITY << 24 | GET_NODE_INFO << 16 | to << 8 | 0x80 | self._number
        for data in frames(node_info(now_s, self._name, self._unique), transfer, GET_NODE_INFO_SIGNATURE):
            self.port.send(identifier, data)

    def close(self) -> None:
        self.port.close()
