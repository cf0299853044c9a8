"""The iMet driver: recorded lines, everything that serial lines do to them, the real pyserial."""

from __future__ import annotations

import os
import tty
from collections import Counter

import pytest
from emulated import Replay, memory_port, ramp_percent, steady_c, watch
from hypothesis import given, settings
from hypothesis import strategies as st

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.buses.serial_port import PyserialPort, pyserial_opener
from shockrig.rig.clock import RealClock, VirtualClock
from shockrig.rig.seams import Outcome
from shockrig.rig.sensors.imet import Imet, ImetSettings
from shockrig.rig.sensors.imet_lines import LONGEST_LINE, XF, XQ, XQ2, LineAssembler, LineTable, UnknownLine
from shockrig.rig.sensors.imet_parts import ImetBead, ImetBeadSettings, ImetHumidity, ImetHumiditySettings
from shockrig.rig.virtual.chips.imet import ImetUnit, bead_resistance_ohm
from shockrig.rig.virtual.faults import Fault, FaultySerial
from shockrig.rig.virtual.serial_line import PtyDevice

XQ2_LINE = b"XQ,+095188,+2407,+0294,+2553,2015/10/18,00:38:44,+0000000000,+0000000000,-00017000,00"


def imet_over(device, kind="imet-xf", **values):
    clock = VirtualClock()
    sensor = Imet("imet", ImetSettings(port="memory", **values), memory_port(device, clock), clock, kind)
    sensor.open()
    return sensor, clock


def xf_unit(**values):
    return ImetUnit(lambda at_s: at_s, lambda at_s: 950.0, phase_s=0.0432, **values)


def faulty(*faults):
    """An iMet driver on an emulated XF whose temperature is the time, with faults on the line."""
    clock = VirtualClock()
    device = FaultySerial(xf_unit(), faults, clock)
    sensor = Imet("imet", ImetSettings(port="memory"), memory_port(device, clock), clock)
    sensor.open()
    return sensor, clock


def test_recorded_xq2_line():
    key, values = LineTable.of(XQ2).parse(XQ2_LINE)
    assert key == "XQ"
    assert values == pytest.approx(
        {
            "pressure_hpa": 951.88,
            "temperature_c": 24.07,
            "humidity_percent": 29.4,
            "die_temperature_c": 25.53,
            "satellites": 0,
        }
    )  # satellites 00: the zeros of the position are no measurement


def test_xq_line_is_an_xq2_line_without_the_die():
    line = XQ2_LINE.replace(b"+2553,", b"")
    assert LineTable.of(XQ).parse(line)[1]["humidity_percent"] == pytest.approx(29.4)
    with pytest.raises(ValueError, match="9 fields"):
        LineTable.of(XQ2).parse(line)


@pytest.mark.parametrize("prefix", [b"", b"XF,", b"XF", b"XF2,"])
def test_xf_lines_with_and_without_letters_before_the_id(prefix):
    key, values = LineTable.of(XF).parse(prefix + b"5,2512,5376")
    assert key == "5" and values == {"temperature_c": 25.12, "resistance_ohm": 5376}


def test_xf_gps_and_board_lines():
    table = LineTable.of(XF)
    board = table.parse(b"0,95188,2407,2940,2553")[1]
    assert board["pressure_hpa"] == pytest.approx(951.88)
    gps = table.parse(b"3,2026/05/01,10:00:00,352200000,-974400000,357000,9")[1]
    assert (gps["latitude_deg"], gps["longitude_deg"], gps["altitude_m"]) == pytest.approx((35.22, -97.44, 357.0))


def test_widths_do_not_matter_and_empty_fields_are_missing():
    assert LineTable.of(XF).parse(b"5,+0002512,005376")[1]["temperature_c"] == pytest.approx(25.12)
    assert LineTable.of(XF).parse(b"0,95188,,2940,2553")[1].keys() >= {"pressure_hpa", "board_humidity_percent"}


@pytest.mark.parametrize(
    "line",
    [
        b"5,2512",
        b"5,2512,5376,1",
        b"5,25x2,5376",
        b"5,--2512,5376",
        b"5,25 12,5376",
        b"5,\xb22,5376",
        b"5,1e3,5376",
        b"5,nan,1",
    ],
)
def test_lines_of_the_wrong_shape_are_rejected(line):
    with pytest.raises(ValueError):
        LineTable.of(XF).parse(line)


def test_unknown_ids_are_told_apart():
    for line in (b"7,1,2", b"hello", b"XQ,1,2"):
        with pytest.raises(UnknownLine):
            LineTable.of(XF).parse(line)


def test_a_table_from_a_bench_file_is_checked():
    table = LineTable.of({**XF, "7": ["temperature_c/1000", "note:text"]})
    assert table.parse(b"7,21500,ok")[1] == {"temperature_c": 21.5}
    for field in ("temperature_c/0", "temperature_c/ten", "a b", "/3"):
        with pytest.raises(BenchError, match="7"):
            LineTable.of({"7": [field]})


@given(st.lists(st.sampled_from([b"5,2512,5376", b"5,-1,9", XQ2_LINE]), max_size=8), st.data())
def test_lines_do_not_depend_on_how_they_are_cut(lines, data):
    stream = b"".join(line + data.draw(st.sampled_from([b"\r\n", b"\n", b"\r"])) for line in lines)
    assembler, got, at = LineAssembler(), [], 0
    while at < len(stream):
        n = data.draw(st.integers(1, 40))
        piece = stream[at : at + n]
        at += len(piece)
        got += assembler.feed(piece, at * 1e-3, 1e-3)
    assert [line.raw for line in got] == lines
    starts = [stream.index(line.raw, round(line.start_s * 1e3)) for line in got]
    assert [line.start_s for line in got] == pytest.approx([start * 1e-3 for start in starts])


@given(st.lists(st.binary(max_size=600), max_size=20))
@settings(max_examples=200)
def test_no_bytes_break_assembler_or_parser(chunks):
    assembler, tables = LineAssembler(LineTable.of(XQ2).begins()), [LineTable.of(t) for t in (XF, XQ2)]
    kept = b""
    for chunk in chunks:
        for line in assembler.feed(chunk, 0.0, 1e-4):
            kept += line.raw
            assert len(line.raw) <= LONGEST_LINE + 600
            for table in tables:
                try:
                    table.parse(line.raw.replace(b"\0", b""))
                except ValueError:
                    pass
    ended = b"".join(chunks)
    assert len(kept) <= len(ended)


def test_nuls_at_port_open_and_a_glued_start():
    """What XQ2 logs show: NULs alone, NULs glued to the first line, and a line cut off by the next one's start."""
    sensor, clock = imet_over(
        Replay([(0.1, b"\0\r\n\0\0" + XQ2_LINE + b"\r\n"), (0.2, XQ2_LINE[:30] + XQ2_LINE + b"\r\n")]), "imet-xq2"
    )
    readings = watch(sensor, clock, 1.0)
    assert [reading.outcome for reading in readings] == [Outcome.OK, Outcome.REJECTED, Outcome.OK]
    assert readings[0].raw == b"\0\0" + XQ2_LINE
    assert readings[1].raw == XQ2_LINE[:30]
    assert readings[2].values["temperature_c"] == pytest.approx(24.07)


def test_every_byte_is_kept_in_some_reading():
    stream = b"12,99\r\n5,2512,5376\r\n7,1\r\n\xff\xfe5,2\r\n5,9999999,1\r\n" + b"5" * 700 + b"\r\n5,2512,5376\r\n"
    sensor, clock = imet_over(Replay([(0.1, stream)]))
    readings = watch(sensor, clock, 1.0)
    assert b"".join(reading.raw for reading in readings) == stream.replace(b"\r\n", b"")
    outcomes = Counter(reading.outcome for reading in readings)
    assert outcomes == {Outcome.OK: 2, Outcome.IMPLAUSIBLE: 1, Outcome.REJECTED: outcomes[Outcome.REJECTED]}
    assert sensor.counts["rejected"] == outcomes[Outcome.REJECTED] >= 4
    assert sensor.unknown_ids == {"12": 1, "7": 1}
    assert all(not reading.values for reading in readings if reading.outcome is not Outcome.OK)


def test_readings_are_dated_when_the_line_began():
    """The emulated temperature is the time itself, so a date is wrong by as much as its value."""
    sensor, clock = imet_over(xf_unit())
    readings = [reading for reading in watch(sensor, clock, 20.0) if reading.sensor == "imet"]
    assert len(readings) == 200
    for reading in readings:
        assert reading.outcome is Outcome.OK
        assert reading.sampled_s == pytest.approx(reading.values["temperature_c"], abs=0.0055)
        assert reading.time_s > reading.requested_s
    phases = [reading.sampled_s % 0.1 for reading in readings]
    assert phases == pytest.approx([0.0432] * 200, abs=1e-4)


def test_lines_that_lay_in_the_buffer_are_not_dated():
    sensor, clock = imet_over(xf_unit())
    watch(sensor, clock, 1.0)
    clock.sleep_until(3.0)  # somebody else kept the bench busy
    readings = sensor.poll()
    assert {reading.outcome for reading in readings} == {Outcome.STALE}
    assert all(reading.sampled_s is None for reading in readings)
    assert {reading.outcome for reading in watch(sensor, clock, 1.0) if reading.sensor == "imet"} == {Outcome.OK}


def test_board_and_gps_lines_are_readings_of_their_own():
    sensor, clock = imet_over(xf_unit())
    readings = watch(sensor, clock, 2.0)
    assert {reading.sensor for reading in readings} == {"imet", "imet.0", "imet.3"}
    assert all("temperature_c" in reading.values for reading in readings if reading.sensor == "imet")


def test_humidity_of_an_imet_is_a_sensor_of_its_own():
    sensor, clock = imet_over(xf_unit(humidity_percent=ramp_percent, die_temperature_c=steady_c))
    film = ImetHumidity("hyt", ImetHumiditySettings(), sensor)
    film.open()
    watch(sensor, clock, 1.0)
    readings = film.poll()
    assert len(readings) == 10 and film.poll() == []
    assert readings[0].sensor == "hyt" and readings[0].values["temperature_c"] == 22.0


def test_a_second_bead_and_film_are_sensors_of_their_own():
    """Ids 13 and 17, in the same burst as 5 and 8: neither is mixed with the first one's."""
    second = {"second_bead_c": lambda t: 40.0 - t, "second_film": (lambda t: 80.0, lambda t: 39.0)}
    sensor, clock = imet_over(xf_unit(humidity_percent=ramp_percent, die_temperature_c=steady_c, **second))
    parts = [
        ImetHumidity("hyt", ImetHumiditySettings(), sensor),
        ImetBead("imet-2", ImetBeadSettings(), sensor),
        ImetHumidity("hyt-2", ImetHumiditySettings(line="17"), sensor),
    ]
    for part in parts:
        part.open()
    own = [reading for reading in watch(sensor, clock, 1.0) if reading.sensor == "imet"]
    first, bead, film = (part.poll() for part in parts)
    assert len(own) == len(first) == len(bead) == len(film) == 10
    assert {reading.sensor for reading in bead} == {"imet-2"}
    assert all(set(reading.values) == {"temperature_c"} for reading in bead)
    assert all(r.values["temperature_c"] == pytest.approx(40.0 - r.sampled_s, abs=0.02) for r in bead)
    assert all(reading.values["temperature_c"] < 30.0 for reading in own)
    assert {tuple(reading.values.values()) for reading in film} == {(80.0, 39.0)}
    assert all(reading.values["humidity_percent"] < 80.0 for reading in first)
    assert parts[1].describe()["kind"] == "imet-xf" and parts[2].describe()["kind"] == "hyt-271"


@pytest.mark.parametrize("kind", ["flip", "half_line", "headless", "glued", "doubled", "nul", "garbage", "endless"])
def test_damaged_lines_are_rejected_or_right_and_the_next_one_is_heard(kind):
    """Without a checksum a flipped digit may pass; whatever else is damaged must never become a wrong value."""
    sensor, clock = faulty(Fault(kind, 1.0, 3.0))
    readings = [reading for reading in watch(sensor, clock, 5.0) if reading.sensor == "imet"]
    ok = [reading for reading in readings if reading.outcome is Outcome.OK]
    if kind != "flip":
        wrong = [
            r for r in ok if abs(r.values["temperature_c"] - r.sampled_s) > 0.02 and r.values["resistance_ohm"] > 999
        ]
        assert len(wrong) <= (0 if kind in ("nul", "endless") else 4)
    assert sum(reading.sampled_s > 3.1 for reading in ok) >= 18
    assert all(reading.raw for reading in readings)


def test_silence_is_said_and_ends():
    sensor, clock = faulty(Fault("silence", 1.0, 8.0))
    readings = watch(sensor, clock, 10.0)
    silent = [reading for reading in readings if reading.outcome is Outcome.TIMED_OUT]
    assert len(silent) == 3
    assert all(reading.time_s - reading.requested_s == pytest.approx(2.0, abs=0.2) for reading in silent)
    assert readings[-1].outcome is Outcome.OK


def test_an_unplugged_unit_is_said_and_opened_again():
    sensor, clock = faulty(Fault("unplug", 1.0, 4.5))
    readings = watch(sensor, clock, 7.0)
    assert Outcome.NOT_ACKNOWLEDGED in {reading.outcome for reading in readings}
    assert sensor.counts["errno_5"] >= 2
    assert readings[-1].outcome is Outcome.OK


def test_the_bead_of_the_emulator_has_the_published_resistance():
    assert bead_resistance_ohm(25.0) == pytest.approx(5376, rel=2e-3)


@pytest.mark.parametrize("kind", ["imet-xf", "imet-xq2", "imet-xq"])
def test_emulated_units_speak_their_format_through_the_real_pyserial(kind):
    clock = RealClock()
    unit = ImetUnit(lambda at_s: -20.0 + at_s, lambda at_s: 950.0, kind, ramp_percent, steady_c, period_s=0.05)
    pty = PtyDevice(unit, clock)
    port = PyserialPort(pyserial_opener(pty.path, 57600), clock, 57600)
    sensor = Imet("imet", ImetSettings(port=pty.path), port, clock, kind)
    try:
        sensor.open()
        readings = [reading for reading in watch(sensor, clock, 0.7) if reading.sensor == "imet"]
    finally:
        sensor.close()
        pty.close()
    ok = [reading for reading in readings if reading.outcome is Outcome.OK]
    assert len(ok) >= 8
    errors_s = sorted(reading.sampled_s - (reading.values["temperature_c"] + 20.0) for reading in ok)
    assert abs(errors_s[len(errors_s) // 2]) < 0.02


def test_a_hung_up_terminal_is_an_outcome_under_the_real_pyserial():
    master, slave = os.openpty()
    tty.setraw(slave)
    clock = RealClock()
    path = os.ttyname(slave)
    sensor = Imet("imet", ImetSettings(port=path), PyserialPort(pyserial_opener(path, 57600), clock, 57600), clock)
    sensor.open()
    os.write(master, b"5,2512,5376\r\n5,25")
    first = watch(sensor, clock, 0.05)
    assert [reading.values["temperature_c"] for reading in first] == [25.12]
    os.close(slave)
    os.close(master)
    assert [reading.outcome for reading in watch(sensor, clock, 0.05)] == [Outcome.NOT_ACKNOWLEDGED]
    clock_end = sensor.due_s()
    clock.sleep_until(clock_end)
    assert [reading.outcome for reading in sensor.poll()] == [Outcome.NOT_ACKNOWLEDGED]  # not replugged yet
    sensor.close()


ANALOG = b"0012, 0345,1023,0,0,7,88,1000,"


def test_analog_inputs_before_the_xq_and_spaces_around_fields_change_nothing():
    table, plain = LineTable.of(XQ2), LineTable.of(XQ2).parse(XQ2_LINE)
    spaced = XQ2_LINE.replace(b",", b" , ")
    for line in (ANALOG + XQ2_LINE, spaced, ANALOG + spaced):
        assert table.parse(line) == plain
    for line in (ANALOG[6:] + XQ2_LINE, b"7," + ANALOG + XQ2_LINE, ANALOG.replace(b"88", b"xy") + XQ2_LINE):
        with pytest.raises(UnknownLine):
            table.parse(line)


def test_a_line_that_begins_with_analog_inputs_is_one_line_and_dated_by_its_first_byte():
    assembler = LineAssembler(LineTable.of(XQ2).begins())
    whole = ANALOG + XQ2_LINE
    (line,) = assembler.feed(b"\0\0" + whole + b"\r\n", 2.0, 0.001)
    assert line.raw.strip(b"\0") == whole and line.whole
    assert line.start_s == pytest.approx(2.0 - 0.001 * (len(whole) + 2))
    broken, good = assembler.feed(b"XQ,+0951" + XQ2_LINE + b"\n", 3.0, 0.001)  # a glued start is one as before
    assert not broken.whole and good.raw == XQ2_LINE


def test_a_units_second_bead_is_not_taken_for_its_first():
    sensor, clock = imet_over(Replay([(0.1 * i, b"5,2000,6600\r\n13,4000,2700\r\n") for i in range(1, 20)]))
    readings = watch(sensor, clock, 2.0)
    assert {reading.outcome for reading in readings} == {Outcome.OK}
    for name, temperature_c in (("imet", 20.0), ("imet.13", 40.0)):
        own = [reading.values["temperature_c"] for reading in readings if reading.sensor == name]
        assert len(own) > 15 and set(own) == {temperature_c}
