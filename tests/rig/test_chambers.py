"""Chambers and fans as devices: the drivers on emulated ones over their real protocols, and a campaign unattended."""

import json
import os
import struct
import threading
import time

import pytest

from shockrig.files.campaign import read_campaign
from shockrig.protocols.cli import main
from shockrig.rig.bench import open_bench
from shockrig.rig.bench_errors import BenchError, BusError, ConnectionFaults
from shockrig.rig.bench_file import load_bench
from shockrig.rig.chambers.devices import DeviceChambers
from shockrig.rig.chambers.modbus import ModbusDevice, ModbusSettings
from shockrig.rig.chambers.scpi import ScpiDevice, ScpiSettings
from shockrig.rig.clock import VirtualClock
from shockrig.rig.recorder import read_state
from shockrig.rig.seams import Air
from shockrig.rig.virtual.climate import Approach, ModbusServer, ScpiServer

REGISTERS = {
    **{f"set_{quantity}": register for register, quantity in enumerate(("temperature", "humidity", "airflow"))},
    **{f"read_{quantity}": register for register, quantity in enumerate(("temperature", "humidity", "airflow"))},
    "run": 3,
}


class Rig:
    """A driver on an emulated device that takes 100 s to come near what it is asked for."""

    def __init__(self, protocol, **settings):
        self.clock = VirtualClock()
        limits = {"temperature": (-40.0, 90.0), "humidity": (10.0, 98.0), "airflow": (0.0, 15.0)}
        self.climate = Approach(self.clock, 20.0, limits, clips=settings.pop("clips", False))
        self.server = (ScpiServer if protocol == "scpi" else ModbusServer)(self.climate)
        if protocol == "scpi":
            self.device = ScpiDevice("chamber", ScpiSettings(port=self.server.port, reply_s=1.0, **settings))
        else:
            of = ModbusSettings(port=self.server.port, reply_s=1.0, **(REGISTERS | settings))
            self.device = ModbusDevice("chamber", of)

    def close(self):
        self.device.close()
        self.server.close()


@pytest.fixture
def rig():
    made = []

    def make(*arguments, **settings):
        made.append(Rig(*arguments, **settings))
        return made[-1]

    yield make
    for one in made:
        one.close()


BOTH = pytest.mark.parametrize("protocol", ["scpi", "modbus"])


@BOTH
def test_a_set_point_is_taken_approached_and_read(rig, protocol):
    one = rig(protocol)
    one.device.open()
    for quantity, value in (("temperature", -20.5), ("humidity", 33.0), ("airflow", 6.25)):
        assert one.device.has(quantity)
        one.device.set(quantity, value)
        assert one.climate.asked(quantity) == pytest.approx(value)
    one.device.start()
    assert one.climate.on and one.device.get("temperature") == pytest.approx(20.0, abs=0.05)
    one.clock.sleep_until(20.0)
    assert one.device.get("temperature") == pytest.approx(-20.5 + 40.5 * 0.36788, abs=0.06)  # one time constant
    one.clock.sleep_until(400.0)
    found = {quantity: one.device.get(quantity) for quantity in ("temperature", "humidity", "airflow")}
    assert found == {
        "temperature": pytest.approx(-20.5, abs=0.06),
        "humidity": pytest.approx(33.0, abs=0.06),
        "airflow": pytest.approx(6.25, abs=0.006),
    }
    one.device.close()
    deadline_s = time.monotonic() + 120.0
    while one.climate.on and time.monotonic() < deadline_s:  # its server takes the last message when it comes to it
        time.sleep(0.01)
    assert not one.climate.on  # nobody is there to look after it


def test_the_bytes_are_those_of_the_protocols(rig):
    scpi, modbus = rig("scpi"), rig("modbus")
    for one in (scpi, modbus):
        one.device.open()
        one.device.set("temperature", -20.5)
        one.device.start()
    assert scpi.server.heard == ["SYST:ERR?", "SOUR:TEMP -20.50", "SYST:ERR?", "OUTP ON", "SYST:ERR?"]
    # Modbus application protocol 1.1b3: 04 reads input registers, 06 writes one, 03 reads holding registers.
    assert modbus.server.heard == [
        bytes.fromhex("04 0000 0001"),
        bytes.fromhex("06 0000 ff33"),  # -205 as two's complement
        bytes.fromhex("03 0000 0001"),
        bytes.fromhex("06 0003 0001"),
    ]


@BOTH
def test_what_a_device_refuses_is_said_with_its_words(rig, protocol):
    one = rig(protocol)
    one.device.open()
    with pytest.raises(BusError, match="chamber refuses .*(out of range|register 0)"):
        one.device.set("temperature", 95.0)
    one.device.set("temperature", 25.0)
    assert one.climate.asked("temperature") == pytest.approx(25.0)


def test_a_device_that_clips_in_silence_is_found_out(rig):
    one = rig("modbus", clips=True)
    one.device.open()
    with pytest.raises(BusError, match="was asked for temperature 95 and took 90; check its own limits"):
        one.device.set("temperature", 95.0)


@BOTH
def test_a_device_that_goes_away_is_an_error_with_its_port_and_a_remedy(rig, protocol):
    one = rig(protocol)
    one.device.open()
    one.server.close()
    with pytest.raises(BusError, match="chamber does not answer at .*127.0.0.1.*check its cable, supply and port"):
        for _ in range(3):  # what was under way may still arrive
            one.device.get("temperature")
    one.device.close()
    with pytest.raises(BusError, match="does not answer"):
        one.device.open()


def test_commands_of_another_manual_are_settings(rig):
    one = rig("scpi", read_temperature="TEMP?", read_humidity="", set_humidity="", error="")
    one.device.open()
    one.device.set("temperature", 30.0)
    assert not one.device.has("humidity") and one.device.get("humidity") is None
    silent = rig("scpi", read_temperature="OUTP ON")
    silent.device.open()
    with pytest.raises(BusError, match="does not answer"):
        silent.device.get("temperature")
    words = rig("scpi", read_humidity="SYST:ERR?")
    words.server.answer = lambda line: "no idea" if line == "MEAS:TEMP?" else '0,"No error"'
    words.device.open()
    with pytest.raises(BusError, match="answers 'no idea' to 'MEAS:TEMP.', which is no number; check read_temperature"):
        words.device.get("temperature")


def rtu_slave(master, server, frames):
    """A Modbus RTU device, unit 1, on a pseudo-terminal: the same registers, framed with a checksum."""

    def checksum(data):
        crc = 0xFFFF
        for byte in data:
            crc ^= byte
            for _ in range(8):
                crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
        return struct.pack("<H", crc)

    assert checksum(bytes.fromhex("010402ffff")) == bytes.fromhex("b880")  # Modbus over serial line 1.02, appendix B
    held = b""
    while frames:
        try:
            held += os.read(master, 256)
        except OSError:
            return
        while len(held) >= 8:
            frame, held = held[:8], held[8:]
            assert checksum(frame[:-2]) == frame[-2:]
            answer = frame[:1] + server.answer(frame[1:-2])
            os.write(master, answer + checksum(answer))
            frames.append(frame)


def test_the_same_registers_over_a_serial_line():
    master, slave = os.openpty()
    server, frames = ModbusServer(Approach(VirtualClock(), 20.0)), [b""]
    thread = threading.Thread(target=rtu_slave, args=(master, server, frames), daemon=True)
    thread.start()
    settings = ModbusSettings(port=os.ttyname(slave), parity="N", reply_s=5.0, **REGISTERS)
    device = ModbusDevice("chamber", settings)
    try:
        device.open()
        device.set("humidity", 33.0)
        assert frames[-2][:6] == bytes.fromhex("01 06 0001 014a")
        assert device.get("temperature") == pytest.approx(20.0)
    finally:
        device.close()
        frames.clear()
        os.close(slave)
        os.close(master)
        server.close()
        thread.join(5)


class Person:
    def __init__(self):
        self.asked = []

    def ask(self, message, check=None):
        self.asked.append(message)
        return ""


def chambers_of(rig, person=None, **limits):
    """Both airs by SCPI, the fan by Modbus, all open."""
    rigs = {"source": rig("scpi", **limits), "destination": rig("scpi", **limits), "airflow": rig("modbus")}
    for one in rigs.values():
        one.device.open()
        one.clock = rigs["source"].clock
        one.climate._clock = one.clock
    return rigs, DeviceChambers({k: one.device for k, one in rigs.items()}, rigs["source"].clock, person or Person())


def test_the_soak_waits_for_every_device_and_the_airs_are_what_they_read(rig):
    rigs, chambers = chambers_of(rig)
    chambers.set_airs(Air(40.0, 20.0), Air(20.0, 55.0), 6.0)
    assert chambers.waiting() == "the source's temperature is 20 degC, 40 degC is asked of it"
    rigs["source"].clock.sleep_until(70.0)  # 40 - 20 exp(-3.5) = 39.4
    assert chambers.waiting() == "" and chambers.origins == ("measured", "measured")
    source, destination = chambers.airs()
    assert source.temperature_c == pytest.approx(39.396, abs=0.01)
    assert destination.humidity_percent == pytest.approx(54.85, abs=0.01)


def test_what_is_beyond_a_limit_is_refused_and_nothing_is_set(rig):
    rigs, chambers = chambers_of(rig, highest_c=60.0, lowest_percent=15.0)
    for airs, flow, words in (
        ((Air(61.0, 20.0), Air(20.0, 50.0)), 6.0, "temperature 61 degC is beyond the source's limits .-40 to 60."),
        ((Air(20.0, 50.0), Air(20.0, 10.0)), 6.0, "humidity 10 %RH is beyond the destination's limits .15 to 95."),
        ((Air(20.0, 50.0), Air(20.0, 50.0)), 21.0, "airflow 21 m/s is beyond the airflow's limits .0 to 20."),
    ):
        with pytest.raises(BenchError, match=words):
            chambers.set_airs(*airs, flow)
    assert not any("SOUR" in line for line in rigs["source"].server.heard + rigs["destination"].server.heard)


def test_what_has_no_device_is_asked_of_a_person(rig):
    one, person = rig("scpi", set_humidity="", read_humidity=""), Person()
    one.device.open()
    chambers = DeviceChambers({"source": one.device}, one.clock, person)
    chambers.set_airs(Air(40.0, 20.0), Air(20.0, None), 3.0)
    assert person.asked == [
        "Set the source air's humidity to 20 %RH, the destination air's temperature to 20 degC, the airflow to 3 m/s; "
        "press Enter when all is steady."
    ]
    assert chambers.origins == ("measured", "set point")
    assert chambers.airs() == (Air(20.0, 20.0), Air(20.0, None))  # what is read where it can be, else what was asked


BENCH = """
[bench]
name = "climate"
clock = "virtual"
[sensors.imet]
kind = "imet-xf"
port = "virtual"
[sensors.hyt]
kind = "hyt-271"
bus = "virtual"
conversion_s = 0.07
[chambers.source]
kind = "scpi"
port = "virtual"
{more}
[chambers.destination]
kind = "modbus"
port = "virtual"
set_temperature = 0
set_humidity = 1
read_temperature = 0
read_humidity = 1
run = 3
[chambers.airflow]
kind = "modbus"
port = "virtual"
set_airflow = 2
read_airflow = 2
[stage]
kind = "grbl"
port = "virtual"
source_mm = 0.0
destination_mm = 300.0
feed_mm_min = 30000.0
[reference]
kind = "set-points"
"""


def bench_file(tmp_path, more="", **changes):
    text = BENCH.format(more=more)
    for old, new in changes.values():
        text = text.replace(old, new)
    path = tmp_path / "bench.toml"
    path.write_text(text)
    return path


def test_a_campaign_is_recorded_unattended_over_the_devices_own_protocols(tmp_path, capsys):
    out = tmp_path / "c"
    assert main(["run", "quick", "--bench", str(bench_file(tmp_path)), "--out", str(out), "--seed", "5"]) == 0
    assert "warning" not in capsys.readouterr().err
    assert read_state(out).recorded == ("0001", "0002") and not read_state(out).set_aside
    for folder in sorted((out / "runs").iterdir()):
        head = json.loads((folder / "run.json").read_text())
        assert head["airs_from"] == {"source": "measured", "destination": "measured"}
        for place in ("source", "destination"):
            for name, value in head["planned"][place].items():
                assert head[place][name] == pytest.approx(value, abs=0.05)
    # The probes stood in the airs that the devices made.
    run = read_campaign(out).runs[0]
    assert run.imet.values["temperature_c"][:20].mean() == pytest.approx(run.source.temperature_c, abs=0.05)
    assert run.imet.values["temperature_c"][-20:].mean() == pytest.approx(run.destination.temperature_c, abs=0.1)


def test_a_plan_beyond_the_limits_is_refused_before_anything_moves(tmp_path, capsys):
    bench = bench_file(tmp_path, "highest_c = 30.0")
    assert main(["run", "quick", "--bench", str(bench), "--out", str(tmp_path / "c")]) == 2
    assert "run 0002: temperature 40 degC is beyond the source's limits (-40 to 30)" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()


def test_a_device_that_is_missing_is_named_with_everything_else_that_is(tmp_path):
    closed = 'port = "tcp://127.0.0.1:1"'
    change = ('kind = "modbus"\nport = "virtual"', f'kind = "modbus"\n{closed}\nreply_s = 0.3')
    bench = open_bench(load_bench(bench_file(tmp_path, change=change, clock=('clock = "virtual"', 'clock = "real"'))))
    with bench, pytest.raises(ConnectionFaults) as raised:
        bench.open()
    names = [fault.device.partition(" (")[0] for fault in raised.value.faults]
    assert names == ["destination chamber", "fan"]
    assert all("check its cable, supply and port" in fault.cause for fault in raised.value.faults)


WRONG = {
    'set_temperature = "TEMP"': "write {} once where the number goes",
    'set_temperature = "TEMP {} {}"': "write {} once where the number goes",
    "lowest_c = 90.0": "the lowest must be below the highest",
    "lowest_k = 90.0": "unknown key 'lowest_k'; did you mean 'lowest_c'?",
    'kind2 = "x"': "unknown key",
}


@pytest.mark.parametrize("more", WRONG)
def test_wrong_settings_name_the_file_the_section_and_the_key(tmp_path, more):
    with pytest.raises(BenchError) as raised:
        load_bench(bench_file(tmp_path, more))
    assert "bench.toml: [chambers.source]" in str(raised.value) and WRONG[more] in str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[chambers.airflow]", "[chambers.fan]", "unknown key 'fan'"),
        ("run = 3", "run = 3\nread_from = 'coil'", 'must be "input" or "holding"'),
        ("set_airflow = 2", "set_airflow = 70000", "must be a register from 0 to 65535"),
        ("set_airflow = 2", "set_airflow = 2\nscale_airflow = 0.0", "scale_airflow must be positive"),
        ('kind = "scpi"', 'kind = "gpib"', 'kind = "gpib" is not known'),
    ],
)
def test_wrong_sections_too(tmp_path, old, new, words):
    with pytest.raises(BenchError, match=words):
        load_bench(bench_file(tmp_path, change=(old, new)))


def test_anybody_may_add_a_device_by_entry_point(tmp_path, monkeypatch):
    from dataclasses import dataclass

    from shockrig.rig import bench_file as module
    from shockrig.rig.chambers.limits import Limits

    class Oven:
        @dataclass(frozen=True)
        class Settings(Limits):
            door: str = "shut"

        def __init__(self, settings):
            self.settings = settings

        @classmethod
        def build(cls, name, settings, parts):
            return cls(settings)

    class Point:
        name = "chambers.oven"

        def load(self):
            return Oven

    monkeypatch.setattr(module, "entry_points", lambda **wanted: [Point()])
    path = bench_file(tmp_path, change=('kind = "scpi"\nport = "virtual"', 'kind = "oven"\ndoor = "open"'))
    assert load_bench(path).chambers["source"].settings.door == "open"
