"""What must hold of `shockrig scan`: it finds what is there, disturbs nothing else, and its bench file passes check."""

import itertools
import tomllib

import pytest
from emulated import Replay, Spy, memory_port, ramp_percent, steady_c

import shockrig.rig.scan
from shockrig.protocols.cli import main
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.bench_file import check_bench
from shockrig.rig.buses.i2c import SmbusBus
from shockrig.rig.clock import RealClock, VirtualClock
from shockrig.rig.scan import FoundGrbl, FoundHyt, FoundImet, bench_toml, scan_i2c, scan_serial
from shockrig.rig.sensors.hyt271_commands import FREE_ADDRESSES
from shockrig.rig.virtual.chips.grbl import BANNER, GrblController
from shockrig.rig.virtual.chips.hyt271 import Hyt271Chip, encode_frame
from shockrig.rig.virtual.chips.imet import ImetUnit
from shockrig.rig.virtual.i2c_dev import I2cWire, plug_in, pull_out
from shockrig.rig.virtual.serial_line import PtyDevice

numbers = itertools.count(1)


class OtherChip:
    """Some other chip: whatever is read from it is `frame`."""

    powered = True

    def __init__(self, address, frame):
        self.address, self.frame = address, frame

    def write(self, data, at_s):
        pass

    def read(self, length, at_s):
        return self.frame[:length].ljust(length, b"\xff")


def on_a_bus(chips, **options):
    """Found sensors, and every transaction, on one emulated bus."""
    clock = VirtualClock()
    spy = Spy(I2cWire(chips, clock, **options))
    path = f"/dev/i2c-scan-{next(numbers)}"
    plug_in(path, spy)
    try:
        found, trouble = scan_i2c(path, SmbusBus(path, clock), clock)
    finally:
        pull_out(path)
    assert trouble == ""
    return found, spy.log


def test_a_sensor_at_the_usual_address_and_one_at_another():
    chips = [Hyt271Chip(lambda t: 62.5, lambda t: -12.0, address) for address in (0x2A, 0x28)]
    found, _ = on_a_bus(chips)
    assert [sensor.address for sensor in found] == [0x28, 0x2A]
    for sensor in found:
        assert sensor.humidity_percent == pytest.approx(62.5, abs=100 / 16383)
        assert sensor.temperature_c == pytest.approx(-12.0, abs=165 / 16383)


def test_an_adapter_that_refuses_empty_writes():
    found, _ = on_a_bus([Hyt271Chip(ramp_percent, steady_c)], accepts_empty_writes=False)
    assert len(found) == 1


@pytest.mark.parametrize(
    "frame",
    [
        b"\x00\x00\x00\x00",
        b"\xff\xff\xff\xff",
        b"\x80\x00\x00\x00",
        encode_frame(50.0, 20.0),  # always fresh: not what a HYT-271 does
        encode_frame(50.0, 20.0, stale=True),  # never fresh
        encode_frame(50.0, 120.0),
    ],
)
@pytest.mark.parametrize("address", [0x28, 0x40])
def test_other_chips_are_not_taken_for_a_sensor(frame, address):
    assert on_a_bus([OtherChip(address, frame)])[0] == []


def test_other_chips_hear_nothing_but_a_read():
    """A chip whose read is no HYT-271's frame is not written to; memories are not even read."""
    chips = [OtherChip(0x40, b"\x80\x12\x34\x56"), OtherChip(0x50, bytes(4)), OtherChip(0x36, bytes(4))]
    _, log = on_a_bus(chips)
    assert {entry[1] for entry in log if entry[0] == "write"} == {0x28}
    assert {entry[1] for entry in log if entry[0] == "read"} == {0x40}


def test_a_bus_that_a_recording_uses_is_left_alone(tmp_path):
    clock = VirtualClock()
    spy = Spy(I2cWire([Hyt271Chip(ramp_percent, steady_c)], clock))
    path = f"/dev/i2c-scan-{next(numbers)}"
    plug_in(path, spy)
    recording = SmbusBus(path, clock, tmp_path)
    try:
        recording.open()
        assert recording.acquire("the recording")
        assert scan_i2c(path, SmbusBus(path, clock, tmp_path), clock) == ([], "a recording is using it")
        assert spy.log == []
    finally:
        recording.close()
        pull_out(path)


class AtBaud:
    """A serial device as it looks through a port at some baud rate: noise, unless it is the device's own."""

    byte_s = 1e-4

    def __init__(self, device, right):
        self.device, self.right = device, right

    def output(self, until_s):
        data = self.device.output(until_s)
        return data if self.right else bytes(0x80 | byte for byte in data)

    def next_output_s(self):
        return self.device.next_output_s()

    def receive(self, data, at_s):
        if self.right:
            self.device.receive(data, at_s)


class Deaf:
    """A device that must not be written to."""

    def __init__(self, device):
        self.device, self.byte_s, self.heard = device, device.byte_s, b""

    def output(self, until_s):
        return self.device.output(until_s)

    def next_output_s(self):
        return self.device.next_output_s()

    def receive(self, data, at_s):
        self.heard += data


def on_ports(**options):
    """Scan ports; each is (device, its baud rate). The listeners by name."""
    may_ask = options.pop("may_ask", True)
    clock = VirtualClock()
    found = scan_serial(
        options,
        lambda path, baud: memory_port(AtBaud(options[path][0], baud == options[path][1]), clock, baud),
        clock,
        may_ask=may_ask,
    )
    return {listener.path: listener for listener in found}


def unit(kind, period_s=0.1, with_film=True, baud=57600):
    film = (lambda t: 41.0, lambda t: 22.5) if with_film else (None, None)
    return Deaf(ImetUnit(lambda t: 21.25, lambda t: 950.0, kind, *film, period_s=period_s, phase_s=0.03, baud=baud))


@pytest.mark.parametrize(
    ("kind", "period_s", "with_film"),
    [("imet-xf", 0.1, False), ("imet-xf", 0.2, True), ("imet-xq2", 1.0, True), ("imet-xq", 1.0, True)],
)
def test_imet_units_are_told_apart_and_never_written_to(kind, period_s, with_film):
    device = unit(kind, period_s, with_film)
    found = on_ports(usb=(device, 57600))["usb"].found
    assert found == FoundImet("usb", kind, 57600, 21.25, with_film)
    assert device.heard == b""


def test_an_imet_set_to_the_other_baud_rate():
    device = unit("imet-xq2", baud=115200)
    assert on_ports(usb=(device, 115200))["usb"].found.baud == 115200 and device.heard == b""


def test_grbl_that_announces_itself_is_asked_for_its_switches_by_one_byte():
    banners = [(at_s, BANNER) for at_s in (0.3, 3.0)]  # opening a port resets such a board
    for report, pins in ((b"<Idle|MPos:0.000,0.000,0.000|FS:0,0|Pn:XZ>\r\n", "XZ"), (b"", "")):
        device = Replay([*banners, (3.2, report)])
        assert on_ports(usb=(device, 115200))["usb"].found == FoundGrbl("usb", "1.1h", pins)
        assert [data for _, data in device.heard] == [b"?"]
    device = Replay(banners)
    assert on_ports(usb=(device, 115200), may_ask=False)["usb"].found == FoundGrbl("usb", "1.1h")
    assert device.heard == []


@pytest.mark.parametrize(("pins", "line"), [("XZ", 'limit_pin = "X" # pressed now'), ("", 'limit_pin = "" # SET: "X"')])
def test_the_bench_file_has_the_switch_that_is_pressed(pins, line):
    text = bench_toml([HYT, FoundGrbl("/dev/ttyACM0", "1.1h", pins)])
    assert line in text and check_bench(tomllib.loads(text), "x").stage.settings.limit_pin == pins[:1]


def test_grbl_that_is_silent_is_asked_by_one_byte():
    device = GrblController(0.0, 300.0)
    heard = []
    receive = device.receive
    device.receive = lambda data, at_s: (heard.append(data), receive(data, at_s))
    listener = on_ports(usb=(device, 115200))["usb"]
    assert listener.found == FoundGrbl("usb", "", "X") and heard == [b"?"]
    assert device._needs_homing  # it was not reset, homed or moved
    assert on_ports(usb=(GrblController(0.0, 300.0), 115200), may_ask=False)["usb"].trouble == "silent"


def test_what_speaks_otherwise_is_not_written_to():
    """A GPS, a modem, a boot loader: none of our business."""
    lines = [(0.2 * i, b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n") for i in range(60)]
    devices = {"gps": (Replay(lines), 9600), "modem": (Replay([(1.0, b"RING\r\n")]), 57600), "none": (Replay([]), 9600)}
    found = on_ports(**devices)
    assert all(listener.found is None for listener in found.values())
    assert devices["gps"][0].heard == devices["modem"][0].heard == []
    assert "neither an iMet nor a GRBL" in found["gps"].trouble and found["none"].trouble == "silent"


def test_a_port_that_cannot_be_opened_hides_no_other():
    clock = VirtualClock()

    def make(path, baud):
        if path == "gone":
            return shockrig.rig.buses.serial_port.PyserialPort(lambda: open("/dev/ttyNowhere"), clock, baud)
        return memory_port(unit("imet-xf"), clock, baud)

    gone, there = scan_serial(["gone", "there"], make, clock)
    assert gone.trouble == "No such file or directory" and there.found.kind == "imet-xf"


HYT = FoundHyt("/dev/i2c-1", 0x28, 50.0, 20.0)
SECOND = FoundHyt("/dev/i2c-3", 0x2A, 50.0, 20.0)
XF = FoundImet("/dev/ttyUSB0", "imet-xf", 57600, 20.0, True)
STAGE = FoundGrbl("/dev/ttyACM0", "1.1h")


@pytest.mark.parametrize(
    "found",
    [*itertools.combinations((HYT, XF, STAGE), 1), *itertools.combinations((HYT, SECOND, XF, STAGE), 2)],
)
def test_every_bench_file_is_valid(found):
    if found == (STAGE,):
        with pytest.raises(BenchError, match="found no sensor"):
            bench_toml(found)
        return
    config = check_bench(tomllib.loads(bench_toml(found)), "found.toml")
    assert ("hyt" in config.sensors) == (HYT in found or SECOND in found or XF in found)
    assert ("imet" in config.sensors) == (XF in found)
    assert config.stage.kind == ("grbl" if STAGE in found else "manual")
    assert config.reference.kind == ("hyt-271" if {HYT, SECOND} <= set(found) else "operator")
    if HYT in found:
        assert (config.sensors["hyt"].settings.bus, config.sensors["hyt"].settings.address) == (1, 0x28)


def test_whatever_address_can_be_stored_is_found():
    for address in FREE_ADDRESSES[::17]:
        (found,), _ = on_a_bus([Hyt271Chip(ramp_percent, steady_c, address)])
        assert found.address == address


def test_several_of_a_kind_are_several_probes():
    second = FoundImet("/dev/ttyUSB1", "imet-xf", 57600, 20.0, False)
    third = FoundHyt("/dev/i2c-3", 0x2B, 50.0, 20.0)
    config = check_bench(tomllib.loads(bench_toml([HYT, SECOND, third, XF, second])), "found.toml")
    assert list(config.sensors) == ["imet", "imet-2", "hyt", "hyt-2"]
    assert config.sensors["imet-2"].settings.port == "/dev/ttyUSB1"
    assert config.sensors["hyt-2"].settings.address == 0x2A
    assert config.reference.settings.address == 0x2B  # one more than there are beads


def test_a_second_bead_and_film_of_a_unit_are_a_probe_of_their_own():
    device = Deaf(
        ImetUnit(
            lambda t: 21.25,
            lambda t: 950.0,
            "imet-xf",
            lambda t: 41.0,
            lambda t: 22.5,
            second_bead_c=lambda t: 30.0,
            second_film=(lambda t: 60.0, lambda t: 31.0),
        )  # fmt: skip
    )
    found = on_ports(usb=(device, 57600))["usb"].found
    assert found == FoundImet("usb", "imet-xf", 57600, 21.25, True, ("13", "17"))
    sensors = check_bench(tomllib.loads(bench_toml([found])), "found.toml").sensors
    assert {name: part.kind for name, part in sensors.items()} == {
        "imet": "imet-xf", "imet-2": "imet-bead", "hyt": "imet-humidity", "hyt-2": "imet-humidity",
    }  # fmt: skip
    assert [sensors[name].settings.line for name in ("imet-2", "hyt", "hyt-2")] == ["13", "", "17"]
    # Beside a unit without a hygrometer each other one keeps its own: it had gone to the probe before.
    without = FoundImet("/dev/ttyUSB0", "imet-xf", 57600, 20.0, False)
    several = check_bench(tomllib.loads(bench_toml([without, found, XF])), "found.toml").sensors
    through = {name: (part.settings.through, part.settings.line) for name, part in several.items() if "hyt" in name}
    assert through == {"hyt-2": ("imet-2", ""), "hyt-3": ("imet-2", "17"), "hyt-4": ("imet-4", "")}
    alone = check_bench(tomllib.loads(bench_toml([found, HYT])), "found.toml").sensors
    assert list(alone) == ["imet", "imet-2", "hyt"] and alone["hyt"].kind == "hyt-271"


def test_names_are_quoted():
    port = '/dev/serial/by-id/usb-"x"\\y\n[stage]'
    config = check_bench(tomllib.loads(bench_toml([FoundImet(port, "imet-xf", 57600, 20.0, False)])), "found.toml")
    assert config.sensors["imet"].settings.port == port


def test_what_is_found_passes_check(tmp_path, capsys, monkeypatch):
    """Through pseudo-terminals and the real pyserial, and a fake device file under the real smbus2, in real time."""
    monkeypatch.setattr(shockrig.rig.scan, "LISTEN_S", 0.5)
    clock = RealClock()
    path = f"/dev/i2c-scan-{next(numbers)}"
    plug_in(path, I2cWire([Hyt271Chip(lambda t: 50.0, steady_c)], clock))
    ptys = [PtyDevice(unit("imet-xf"), clock), PtyDevice(GrblController(0.0, -10.0), clock)]
    out = tmp_path / "bench.toml"
    command = ["--i2c", path, "--port", ptys[0].path, "--port", ptys[1].path, "--out", str(out)]
    try:
        assert main(["scan", *command]) == 0
        assert f"wrote {out}" in capsys.readouterr().out
        assert main(["check", "--bench", str(out), "--out", str(tmp_path / "c")]) == 0
        said = capsys.readouterr().out
        assert f"imet (imet-xf on {ptys[0].path})" in said and "temperature 21.25 degC" in said
        assert f"hyt (hyt-271 on {path} at 0x28)" in said and "humidity 50" in said
        assert f"stage (grbl on {ptys[1].path})" in said
        assert main(["scan", *command]) == 2  # an existing file is never written over
        assert "is there already" in capsys.readouterr().err
    finally:
        pull_out(path)
        for pty in ptys:
            pty.close()


def test_nothing_found(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(shockrig.rig.scan, "LISTEN_S", 0.05)
    out = tmp_path / "bench.toml"
    assert main(["scan", "--port", "/dev/ttyNowhere", "--i2c", "/dev/i2c-nowhere", "--out", str(out)]) == 1
    said = capsys.readouterr()
    assert said.out == "" and "found no sensor" in said.err and not out.exists()
    assert "/dev/i2c-nowhere: No such file or directory" in said.err
