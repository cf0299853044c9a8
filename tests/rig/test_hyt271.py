"""The HYT-271 driver against the emulated chip, both under the real smbus2 and its ctypes structures."""

from __future__ import annotations

import ctypes
import errno
import sys
from collections import Counter

import pytest
import smbus2
from emulated import hyt_bench, ramp_percent, steady_c, watch
from hypothesis import given
from hypothesis import strategies as st
from processes import ended, heard

from shockrig.protocols.cli import main
from shockrig.rig.bench_errors import BenchError, BusError
from shockrig.rig.buses.i2c import LEASE_S, SmbusBus
from shockrig.rig.buses.mux import MuxedBus
from shockrig.rig.clock import RealClock, VirtualClock
from shockrig.rig.seams import Outcome
from shockrig.rig.sensors.hyt271 import Hyt271, Hyt271Settings, decode_frame
from shockrig.rig.sensors.hyt271_commands import answering, change_address, read_address, wait_for_answer
from shockrig.rig.virtual.chips.hyt271 import Hyt271Chip, encode_frame
from shockrig.rig.virtual.chips.tca9548a import MuxedWire
from shockrig.rig.virtual.faults import Fault
from shockrig.rig.virtual.i2c_dev import I2cWire, plug_in, pull_out


def test_frame_of_the_application_note():
    outcome, values = decode_frame(bytes.fromhex("1F 6D 60 48"))
    assert outcome is Outcome.OK
    assert values["humidity_percent"] == pytest.approx(49.1, abs=0.05)
    assert values["temperature_c"] == pytest.approx(22.06, abs=0.005)


@pytest.mark.parametrize(
    ("frame", "outcome"),
    [
        ("5F6D6048", Outcome.STALE),
        ("9F6D6048", Outcome.COMMAND_MODE),
        ("DF6D6048", Outcome.COMMAND_MODE),
        ("FFFFFFFF", Outcome.IMPLAUSIBLE),
        ("00000000", Outcome.IMPLAUSIBLE),
        ("1F6D", Outcome.IMPLAUSIBLE),
        ("", Outcome.IMPLAUSIBLE),
    ],
)
def test_flags_are_never_read_as_humidity(frame, outcome):
    got, values = decode_frame(bytes.fromhex(frame))
    assert got is outcome
    assert bool(values) == (outcome is Outcome.STALE)


@given(st.binary(min_size=4, max_size=4))
def test_low_two_bits_of_the_temperature_are_masked(frame):
    first, second = decode_frame(frame), decode_frame(frame[:3] + bytes((frame[3] & 0xFC,)))
    if frame[3] & 0xFC or any(frame[:3]):
        assert frame == b"\xff" * 4 or first == second


@given(st.floats(0, 100), st.floats(-40, 125))
def test_the_chip_says_what_the_driver_reads(humidity_percent, temperature_c):
    frame = encode_frame(humidity_percent, temperature_c)
    outcome, values = decode_frame(frame)
    if frame != bytes(4):
        assert outcome is Outcome.OK
        assert values["humidity_percent"] == pytest.approx(humidity_percent, abs=0.0031)
        assert values["temperature_c"] == pytest.approx(temperature_c, abs=0.0051)


def test_request_is_an_empty_write_and_the_fetch_a_transaction_of_its_own():
    with hyt_bench() as (sensor, _, spy, clock):
        sensor.open()
        del spy.log[:]
        watch(sensor, clock, 0.7)
        assert spy.log[0] == ("write", 0x28, b"")
        assert [entry[0] for entry in spy.log[:8]] == ["write", "read", "read", "read"] * 2  # two reads confirm
    with hyt_bench(settings={"confirm": False}) as (sensor, _, spy, clock):
        sensor.open()
        del spy.log[:]
        watch(sensor, clock, 0.7)
        assert [entry[0] for entry in spy.log[:4]] == ["write", "read", "write", "read"]


def test_every_reading_is_fresh_and_dated_when_the_film_was_read():
    """The classic bias: requesting after the read makes every value one poll old. The ramp tells the time."""
    with hyt_bench() as (sensor, _, _, clock):
        sensor.open()
        readings = watch(sensor, clock, 5.0)
    assert {reading.outcome for reading in readings} == {Outcome.OK}
    assert len(readings) == pytest.approx(47, abs=1)
    for reading in readings:
        assert reading.requested_s < reading.sampled_s < reading.time_s
        assert reading.values["humidity_percent"] == pytest.approx(ramp_percent(reading.sampled_s), abs=0.005)
        assert len(reading.raw) == 4


def test_a_slow_conversion_is_polled_until_fresh():
    with hyt_bench(conversion_s=0.13, settings={"conversion_s": 0.06}) as (sensor, _, _, clock):
        sensor.open()
        readings = watch(sensor, clock, 3.0)
    assert {reading.outcome for reading in readings} == {Outcome.OK}
    assert sensor.counts["stale_fetches"] > 2 * len(readings)
    assert all(0.13 <= reading.time_s - reading.requested_s < 0.14 for reading in readings)


def test_stale_until_the_deadline_is_said_so():
    with hyt_bench(faults=[Fault("lost_request", 1.0, 2.0)]) as (sensor, _, _, clock):
        sensor.open()
        readings = watch(sensor, clock, 3.0)
        stale = [reading for reading in readings if reading.outcome is Outcome.STALE]
        assert 3 <= len(stale) <= 6
        assert all(0.24 < reading.time_s - reading.requested_s < 0.27 for reading in stale[:-1])
        assert all(reading.sampled_s is None for reading in stale)
        assert readings[-1].outcome is Outcome.OK


def test_a_result_that_may_belong_to_an_earlier_request_is_never_dated():
    """A conversion that outlasts the deadline ends during the next exchange, and would be dated a request too late."""
    with hyt_bench(conversion_s=0.3) as (sensor, _, _, clock):
        sensor.open()
        readings = watch(sensor, clock, 5.0)
    for reading in readings:
        if reading.outcome is Outcome.OK:
            assert reading.values["humidity_percent"] == pytest.approx(ramp_percent(reading.sampled_s), abs=0.06)
    assert Outcome.STALE in {reading.outcome for reading in readings}


def test_an_adapter_without_empty_writes_gets_one_byte_from_then_on():
    with hyt_bench(accepts_empty_writes=False) as (sensor, _, spy, clock):
        sensor.open()
        readings = watch(sensor, clock, 1.0)
        writes = [data for kind, _, data in spy.log if kind == "write"]
        assert writes.count(b"") == 1 and writes[0] == b""
        assert set(writes[1:]) == {b"\x00"}
        assert sensor.counts["fallback"] == 1
        assert {reading.outcome for reading in readings} == {Outcome.OK}


@pytest.mark.parametrize(
    ("kind", "outcome"),
    [
        ("nack", Outcome.NOT_ACKNOWLEDGED),
        ("nack_enxio", Outcome.NOT_ACKNOWLEDGED),
        ("nack_eio", Outcome.NOT_ACKNOWLEDGED),
        ("timeout", Outcome.TIMED_OUT),
        ("busy", Outcome.TIMED_OUT),
        ("unplug", Outcome.NOT_ACKNOWLEDGED),
        ("stuck_low", Outcome.IMPLAUSIBLE),
        ("stuck_high", Outcome.IMPLAUSIBLE),
        ("slow", Outcome.STALE),
    ],
)
def test_a_fault_is_an_outcome_without_values_and_passes(kind, outcome):
    with hyt_bench(faults=[Fault(kind, 1.0, 2.0)]) as (sensor, _, _, clock):
        sensor.open()
        readings = watch(sensor, clock, 3.0)
        during = [reading for reading in readings if 1.3 < reading.time_s < 1.99]
        after = [reading for reading in readings if reading.requested_s > 2.3]
        assert during and {reading.outcome for reading in during} == {outcome}
        assert all(not reading.values for reading in during if outcome is not Outcome.STALE)
        assert len(after) >= 5 and {reading.outcome for reading in after} == {Outcome.OK}
        gaps = [late.time_s - early.time_s for early, late in zip(readings, readings[1:], strict=False)]
        assert max(gaps) < 0.4  # whatever happens, something is said about it


def test_single_lost_acknowledgements_are_retried_and_counted():
    with hyt_bench(faults=[Fault("nack", 0.5, probability=0.2)]) as (sensor, _, _, clock):
        sensor.open()
        readings = watch(sensor, clock, 20.0)
        outcomes = Counter(reading.outcome for reading in readings)
        assert outcomes[Outcome.OK] / len(readings) > 0.97
        assert sensor.counts["retries"] > 30
        assert sensor.counts["errno_121"] >= sensor.counts["retries"]


def test_flipped_bits_never_end_the_recording():
    with hyt_bench(faults=[Fault("flip", 0.0)]) as (sensor, _, _, clock):
        sensor.open()
        readings = watch(sensor, clock, 20.0)
        assert len(readings) > 100
        assert all(not r.values for r in readings if r.outcome in (Outcome.IMPLAUSIBLE, Outcome.COMMAND_MODE))


def test_a_flipped_bit_is_found_by_fetching_again():
    """Frames have no checksum: with one fetch in twenty damaged, no wrong value may pass as good."""
    with hyt_bench(faults=[Fault("flip", 0.5, probability=0.05)]) as (sensor, _, _, clock):
        sensor.open()
        readings = watch(sensor, clock, 200.0)
    good = [reading for reading in readings if reading.outcome is Outcome.OK]
    assert len(good) > 0.7 * len(readings) and sensor.counts["unconfirmed"] > 50
    for reading in good:
        assert reading.values["humidity_percent"] == pytest.approx(min(ramp_percent(reading.sampled_s), 100), abs=0.005)
        assert reading.values["temperature_c"] == pytest.approx(22.0, abs=0.006)


def test_command_mode_after_a_brown_out_is_left_again():
    with hyt_bench(faults=[Fault("command_mode", 1.0, 1.1)]) as (sensor, chip, spy, clock):
        sensor.open()
        readings = watch(sensor, clock, 2.0)
        outcomes = [reading.outcome for reading in readings]
        assert outcomes.count(Outcome.COMMAND_MODE) == 1
        assert ("write", 0x28, b"\x80\x00\x00") in spy.log
        assert outcomes[-3:] == [Outcome.OK] * 3 and not chip.command_mode


def test_temperature_beyond_the_sensor_is_implausible():
    with hyt_bench(temperature=lambda at_s: 124.9, settings={"plausible_temperature_c": (-60.0, 100.0)}) as (
        sensor,
        _,
        _,
        clock,
    ):
        sensor.open()
        assert {reading.outcome for reading in watch(sensor, clock, 1.0)} == {Outcome.IMPLAUSIBLE}


def test_nobody_there_is_an_error_when_opening():
    with hyt_bench() as (sensor, chip, _, _):
        chip.power_off()
        with pytest.raises(OSError) as caught:
            sensor.open()
        assert caught.value.errno == errno.EREMOTEIO


def test_a_replugged_adapter_is_opened_anew():
    with hyt_bench(faults=[Fault("unplug", 1.0, 5.0)]) as (sensor, _, _, clock):
        sensor.open()
        readings = watch(sensor, clock, 6.0)
        assert sensor.counts["reopened"] == 1
        assert readings[-1].outcome is Outcome.OK


def test_two_sensors_share_a_bus_and_are_never_interleaved():
    clock = VirtualClock()
    from emulated import Spy

    chips = [
        Hyt271Chip(ramp_percent, lambda at_s: 20.0, address=0x28),
        Hyt271Chip(ramp_percent, lambda at_s: 25.0, address=0x29),
    ]
    spy = Spy(I2cWire(chips, clock))
    plug_in("/dev/i2c-shared", spy)
    bus = SmbusBus("/dev/i2c-shared", clock)
    sensors = [
        Hyt271(f"hyt{a:x}", Hyt271Settings(bus="x", address=a, conversion_s=0.065), bus, clock) for a in (0x28, 0x29)
    ]
    try:
        for sensor in sensors:
            sensor.open()
        del spy.log[:]
        readings = []
        while clock.now() < 5.0:
            clock.sleep_until(max(min(s.due_s() for s in sensors), clock.now() + 1e-4))
            readings += [reading for s in sensors if s.due_s() <= clock.now() for reading in s.poll()]
        assert {reading.outcome for reading in readings} == {Outcome.OK}
        shares = Counter(reading.sensor for reading in readings)
        assert min(shares.values()) > 0.45 * len(readings)
        for exchange in zip(*(spy.log[i::4] for i in range(4)), strict=False):
            assert [entry[0] for entry in exchange] == ["write", "read", "read", "read"]
            assert len({entry[1] for entry in exchange}) == 1
    finally:
        bus.close()
        pull_out("/dev/i2c-shared")


def test_a_lost_owner_does_not_keep_the_bus():
    clock = VirtualClock()
    bus = SmbusBus("/dev/i2c-none", clock)
    first, second = object(), object()
    assert bus.acquire(first) and not bus.acquire(second)
    clock.sleep_until(LEASE_S * 1.1)
    assert bus.acquire(second) and not bus.acquire(first)


def test_another_process_with_the_lock_keeps_us_off_the_bus(tmp_path):
    import subprocess

    with hyt_bench() as (template, _, spy, clock):
        bus = SmbusBus(template.settings.bus, clock, tmp_path)
        sensor = Hyt271("hyt", template.settings, bus, clock)
        sensor.open()
        (lock,) = tmp_path.iterdir()
        holder = subprocess.Popen(
            [
                sys.executable,
                "-c",
                f"import fcntl,sys; f=open({str(lock)!r}); fcntl.flock(f, 2); print(flush=True); sys.stdin.read()",
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        with holder:
            heard(holder, holder.stdout, "\n")
            del spy.log[:]
            readings = watch(sensor, clock, 1.0)
            assert readings and {reading.outcome for reading in readings} == {Outcome.TIMED_OUT}
            assert not spy.log
            ended(holder)
        assert watch(sensor, clock, 1.0)[-1].outcome is Outcome.OK
        sensor.close()


def test_reading_the_address_needs_the_power_on_window():
    with hyt_bench() as (sensor, chip, _, clock):
        bus = SmbusBus(sensor.settings.bus, clock)
        bus.open()
        chip.power_on(clock.now())
        assert read_address(bus, clock, 0x28) == 0x28
        assert not chip.command_mode
        clock.sleep_until(clock.now() + 0.011)
        with pytest.raises(BusError, match="switch the sensor's supply off and on"):
            read_address(bus, clock, 0x28, wait_s=1.0)
        bus.close()


def test_changing_the_address_needs_confirmation_and_holds_after_power_on():
    with hyt_bench() as (sensor, chip, spy, clock):
        bus = SmbusBus(sensor.settings.bus, clock)
        bus.open()
        chip.eeprom[0x1C] |= 0x1280  # the maker's bits
        with pytest.raises(BenchError, match="confirm"):
            change_address(bus, clock, 0x28, 0x3A, confirmed=False)
        for address in (0x03, 0x31, 0x50, 0x78):  # where a scan does not look
            with pytest.raises(BenchError, match="reserved"):
                change_address(bus, clock, 0x28, address, confirmed=True)
        assert not spy.log
        chip.power_on(clock.now())
        change_address(bus, clock, 0x28, 0x3A, confirmed=True)
        assert chip.eeprom[0x1C] == 0x1280 | 0x3A
        assert chip.address == 0x28
        chip.power_on(clock.now())
        assert read_address(bus, clock, 0x3A) == 0x3A
        bus.close()


def test_other_files_go_to_the_kernel_while_a_fake_is_plugged_in(tmp_path):
    before = smbus2.smbus2.os  # itself, unless some other bench of this process is still plugged in
    with hyt_bench():
        with pytest.raises(FileNotFoundError):
            smbus2.SMBus(str(tmp_path / "i2c-9"))
        (tmp_path / "plain").write_bytes(b"")
        with pytest.raises(OSError) as caught:
            smbus2.SMBus(str(tmp_path / "plain"))
        assert caught.value.errno == errno.ENOTTY
    assert smbus2.smbus2.os is before and ctypes.sizeof(smbus2.i2c_msg) >= 8


@pytest.mark.parametrize("conversion_s", [0.06, 0.08, 0.09])
def test_at_its_defaults_a_sensor_makes_ten_readings_a_second(conversion_s):
    with hyt_bench(conversion_s=conversion_s) as (sensor, _, _, clock):
        sensor.open()
        readings = watch(sensor, clock, 10.3)
    assert {reading.outcome for reading in readings} == {Outcome.OK}
    gaps = [late.requested_s - early.requested_s for early, late in zip(readings, readings[1:], strict=False)]
    assert gaps == pytest.approx([0.1] * len(gaps), abs=0.002) and len(readings) == pytest.approx(100, abs=1)


def test_a_dry_run_tells_the_word_and_writes_nothing_and_an_address_in_use_is_refused():
    with hyt_bench() as (sensor, chip, _, clock):
        bus = SmbusBus(sensor.settings.bus, clock)
        bus.open()
        chip.eeprom[0x1C] |= 0x1280  # the maker's bits
        assert answering(bus) == [0x28]
        chip.power_on(clock.now())
        words = change_address(bus, clock, 0x28, 0x2B, confirmed=False, dry_run=True)
        assert (words.old, words.new) == (0x1280 | 0x28, 0x1280 | 0x2B)
        assert chip.eeprom[0x1C] == 0x1280 | 0x28 and not chip.command_mode
        with pytest.raises(BenchError, match="somebody answers at 0x28 already"):
            change_address(bus, clock, 0x2A, 0x28, confirmed=True)
        assert not wait_for_answer(bus, clock, 0x2B, 1.0)
        chip.power_on(clock.now())
        change_address(bus, clock, 0x28, 0x2B, confirmed=True)
        chip.power_on(clock.now())
        assert wait_for_answer(bus, clock, 0x2B, 1.0) and answering(bus) == [0x2B]
        bus.close()


def test_the_command_says_how_it_asks_what_it_found_and_what_it_stored(capsys, monkeypatch):
    """The supply is switched by the emulated chip whenever somebody has knocked in vain for a while."""
    clock = RealClock()
    chip = Hyt271Chip(ramp_percent, steady_c)
    knocked = [0]

    class Switched:
        """The wire, with a hand at the supply."""

        def __init__(self, wire):
            self._wire = wire

        def __getattr__(self, name):
            return getattr(self._wire, name)

        def write(self, address, data):
            if data[:1] == b"\xa0":
                knocked[0] += 1
                if knocked[0] % 5 == 1:
                    chip.power_on(clock.now())
            self._wire.write(address, data)

        def read(self, address, length):
            if address == 0x2B and chip.eeprom[0x1C] & 0x7F == 0x2B and chip.address != 0x2B:
                chip.power_on(clock.now())
            return self._wire.read(address, length)

    path = "/dev/i2c-address-command"
    plug_in(path, Switched(I2cWire([chip], clock)))
    try:
        words = ["hyt-address", "--bus", path, "--wait-s", "20"]
        assert main([*words, "--to", "0x2b", "--dry-run"]) == 0
        said = capsys.readouterr()
        assert f"answering on {path}: 0x28" in said.err and "knocking at 0x28 for 20 s" in said.err
        assert said.out == "word 0x1c was 0x0028, would be 0x002b\n" and chip.eeprom[0x1C] == 0x28
        assert main([*words, "--to", "0x2b"]) == 2
        assert "is permanent: confirm it by --yes-change-it" in capsys.readouterr().err
        assert main([*words, "--to", "0x2b", "--yes-change-it"]) == 0
        assert capsys.readouterr().out == "word 0x1c was 0x0028, is 0x002b\nanswers at 0x2b\n"
    finally:
        pull_out(path)


def test_sensors_of_one_address_behind_a_multiplexer_are_told_apart():
    """Both on one adapter, at 10 readings a second together; a dip of the multiplexer's supply changes nothing."""
    clock = VirtualClock()
    wire = MuxedWire({0: [Hyt271Chip(lambda t: 20.0, steady_c)], 5: [Hyt271Chip(lambda t: 70.0, steady_c)]}, clock)
    path = "/dev/i2c-multiplexed"
    plug_in(path, wire)
    try:
        bus = SmbusBus(path, clock)
        sensors = [
            Hyt271(f"hyt{channel}", Hyt271Settings(bus=path, period_s=0.2), MuxedBus(bus, 0x70, channel), clock)
            for channel in (0, 5)
        ]
        for sensor in sensors:
            sensor.open()
        found = {sensor.name: [] for sensor in sensors}
        while clock.now() < 10.0:
            clock.sleep_until(min(sensor.due_s() for sensor in sensors) + 1e-4)
            for sensor in sensors:
                found[sensor.name] += sensor.poll()
            if 5.0 < clock.now() < 5.1:
                wire.mux.register = 0
        for name, percent in (("hyt0", 20.0), ("hyt5", 70.0)):
            good = [reading for reading in found[name] if reading.outcome is Outcome.OK]
            assert len(good) > 40 and len(good) == len(found[name])
            assert {round(reading.values["humidity_percent"]) for reading in good} == {round(percent)}
        for sensor in sensors:
            sensor.close()
    finally:
        pull_out(path)


def test_without_the_multiplexer_two_of_one_address_garble_each_other():
    clock = VirtualClock()
    wire = MuxedWire({0: [Hyt271Chip(ramp_percent, steady_c)], 1: [Hyt271Chip(ramp_percent, steady_c)]}, clock)
    wire.write(0x70, b"\x03")
    with pytest.raises(OSError):
        wire.read(0x28, 4)


@pytest.mark.parametrize(("setting", "words"), [({"mux_channel": 8}, "from 0 to 7"), ({"mux_address": 0x28}, "0x70")])
def test_a_channel_that_cannot_be_is_refused(setting, words):
    with pytest.raises(BenchError, match=words):
        Hyt271Settings(bus=1, **setting)
