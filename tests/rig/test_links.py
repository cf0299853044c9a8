"""Messages to autopilots and ground stations, read by the libraries of other people: python-dronecan and pymavlink."""

import math
import os
import socket
import struct
import time
import tty

import numpy as np
import pytest

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.links.dronecan import DronecanNode, HygrometerFrame, TemperatureFrame, decoded, this_machine
from shockrig.rig.links.mavlink import AutopilotListener, MavlinkEnd, MavlinkSpeaker, vehicle_messages
from shockrig.rig.links.ports import MulticastCan, SocketCan, UdpPort, open_bytes, open_frames
from shockrig.rig.links.said import SaidAir

HERE = "127.0.0.1"
AIR = SaidAir(12.345, (25.1234, 60.02), (0.1, 1.5), (24.0, math.nan))


class Frames:
    """A bus in memory with two ends."""

    def __init__(self):
        self.there, self.back, self.dropped = [], [], 0

    def send(self, identifier, data):
        self.there.append((identifier, data))

    def receive(self):
        found, self.back = self.back, []
        return found

    def close(self):
        pass


def python_dronecan(bus):
    """python-dronecan's node on the other end of a bus."""
    dronecan = pytest.importorskip("dronecan")
    from dronecan.driver.common import AbstractDriver, CANFrame

    class Driver(AbstractDriver):
        def send_frame(self, frame):
            bus.back.append((frame.id, bytes(frame.data)))

        def receive(self, timeout=None):
            return CANFrame(*bus.there.pop(0), True) if bus.there else None

        def close(self):
            pass

    return dronecan, dronecan.node.Node(Driver(), node_id=100)


def heard_by(dronecan, node, bus, kinds):
    """What it understands of the frames on the bus."""
    said = []
    for kind in kinds:
        node.add_handler(kind, lambda event: said.append((event.message, event.transfer)))
    while bus.there:
        node.spin(0)
    return said


def test_python_dronecan_reads_a_hygrometer_node():
    bus = Frames()
    dronecan, node = python_dronecan(bus)
    ours = DronecanNode(bus, 44, this_machine())
    kinds = dronecan.dronecan.sensors.hygrometer.Hygrometer, dronecan.uavcan.equipment.device.Temperature
    ours.send(AIR)
    said = heard_by(dronecan, node, bus, kinds)
    (air, first), (kelvin, _), (read, second), (read_kelvin, _) = said
    assert (air.temperature, air.humidity, air.id) == (float(np.float16(25.1234)), float(np.float16(60.02)), 0)
    assert kelvin.temperature == float(np.float16(25.1234 + 273.15)) and kelvin.device_id == 0
    assert read.temperature == 24.0 and math.isnan(read.humidity) and read.id == 1 and read_kelvin.device_id == 1
    assert first.source_node_id == 44 and (first.transfer_id, second.transfer_id) == (0, 1)


def test_python_dronecan_asks_the_node_what_it_is():
    """The answer is a transfer of several frames, whose checksum its reader verifies."""
    bus = Frames()
    dronecan, node = python_dronecan(bus)
    ours, answers = DronecanNode(bus, 44, this_machine()), []
    node.request(dronecan.uavcan.protocol.GetNodeInfo.Request(), 44, answers.append)
    ours.beat(77.0)
    while bus.there:
        node.spin(0)
    (answer,) = answers
    assert bytes(answer.response.name).decode() == "org.shockrig.fly"
    assert (
        answer.response.status.uptime_sec == 77 and bytes(answer.response.hardware_version.unique_id) == this_machine()
    )


def test_values_beyond_sixteen_bits_are_the_largest_ones():
    bus = Frames()
    DronecanNode(bus, 44, this_machine()).send(SaidAir(0.0, (1e9, -1e9)))
    said = [decoded(*frame) for frame in bus.there]
    assert said == [HygrometerFrame(44, 0, 65504.0, -65504.0, 0), TemperatureFrame(44, 0, 65504.0, 0)]


def test_a_frame_goes_over_multicast_as_python_dronecan_packs_it():
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with listener:
        listener.settimeout(10)
        ours, theirs = MulticastCan(201), MulticastCan(201)
        ours.send(0x10040800 | 44, b"\x01\x02\xc0")
        assert theirs.receive() == [(0x10040800 | 44, b"\x01\x02\xc0")] and ours.receive() == []
        for one in (ours, theirs):
            one.close()
    common = pytest.importorskip("dronecan.dsdl.common")
    body = struct.pack("<HI", 0, 5) + b"abc"
    import binascii

    assert binascii.crc_hqx(body, 0xFFFF) == common.crc16_from_bytes(body)


def test_a_frame_of_socketcan_is_linux_can_frame():
    assert SocketCan.FRAME.pack(0x80000001, 3, b"abc") == struct.pack("=I", 0x80000001) + b"\x03\0\0\0abc\0\0\0\0\0"


@pytest.fixture
def link():
    pytest.importorskip("pymavlink")
    ground = UdpPort(HERE, 0, True)
    ends = MavlinkEnd(UdpPort(HERE, ground.number, False)), MavlinkEnd(ground, 255, 190)
    yield ends
    for end in ends:
        end.close()


def arrived(end, count):
    """Messages over the loopback, which are there as soon as they are sent."""
    found, late_s = [], time.monotonic() + 10
    while len(found) < count and time.monotonic() < late_s:
        found += end.received()
    return found


def test_pymavlink_reads_the_air_with_its_units_and_stamps(link):
    drone, ground = link
    speaker = MavlinkSpeaker(drone)
    speaker.send(AIR)
    speaker.tell("imet is silent", 13.0)
    speaker.beat(13.0)
    air, *named, text, beat = arrived(ground, 9)
    # of sensor 1 the humidity is missing, which this message has no word for
    assert (air.get_type(), air.id, air.temperature, air.humidity) == ("HYGROMETER_SENSOR", 0, 2512, 6002)
    values = {one.name: one.value for one in named}
    assert list(values) == ["T_air", "RH_air", "T_unc", "RH_unc", "T_read", "RH_read"]
    assert values["T_air"] == np.float32(25.1234) and math.isnan(values["RH_read"])
    assert {one.time_boot_ms for one in named} == {12345}
    assert text.text == "imet is silent" and beat.get_type() == "HEARTBEAT"


def test_an_autopilot_is_asked_for_its_stream_and_heard(link):
    autopilot, ours = link
    listener = AutopilotListener(ours)
    autopilot.put("heartbeat", 2, 3, 0, 0, 4, 3)
    arrived_s = time.monotonic() + 10
    asked = []
    while len(asked) < 3 and time.monotonic() < arrived_s:
        listener.poll(1.0)
        asked += [message.param1 for message in autopilot.received()]
    assert sorted(asked) == [29.0, 33.0, 74.0]
    vehicle_messages(autopilot, 2.0, 6.5, 955.0, (47.5, 8.25, 512.0))
    listener.poll(2.0)
    expected = {"airspeed_m_s": 6.5, "pressure_hpa": 955.0, "latitude_deg": 47.5, "longitude_deg": 8.25}
    assert listener.at(3.0) == pytest.approx({**expected, "altitude_m": 512.0})
    assert listener.at(5.0) == {}  # an autopilot that fell silent says nothing


def test_a_serial_port_that_nobody_reads_holds_nothing_up():
    """Its buffer fills, then whole messages are dropped; when somebody reads again they go on."""
    reader, far = os.openpty()
    tty.setraw(far)
    port = open_bytes(f"{os.ttyname(far)},57600")
    for _ in range(5000):
        port.send(bytes(20))
    assert port.dropped > 0 and port.receive() == b""
    while len(os.read(reader, 4096)) == 4096:
        pass
    port.send(b"last")
    assert os.read(reader, 65536)
    for one in (reader, far):
        os.close(one)
    port.send(b"into nothing")
    port.close()


@pytest.mark.parametrize(
    ("opener", "address"),
    [
        (open_bytes, "udpout:14550"), (open_bytes, "tcp:1.2.3.4:5"), (open_bytes, "/dev/ttyNONE,x"),
        (open_bytes, "/dev/ttyNONE"), (open_frames, "mcast:x"), (open_frames, "can99"),
    ],
)  # fmt: skip
def test_an_address_that_cannot_be_is_refused_with_what_is_expected(opener, address):
    with pytest.raises(BenchError, match=address.partition(",")[0]):
        opener(address)
