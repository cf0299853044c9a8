"""Emulated instruments under programs that know nothing of them: i2c-tools, smbus2, cat, a terminal, a logger."""

import csv
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from emulated import emulating, with_bus
from processes import in_background

from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.physics.modes import response_times, sphere_core
from shockrig.files.errors import InputError
from shockrig.protocols.flight_world import flight_world, read_flown_air
from shockrig.rig.virtual.emulate.i2c_socket import answer
from shockrig.rig.virtual.emulate.live_session import FastClock, Session

pytestmark = pytest.mark.elsewhere

needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) to build the preload library with")


def needs(*programs):
    missing = [program for program in programs if shutil.which(program) is None]
    return pytest.mark.skipif(bool(missing), reason=f"no {', '.join(missing)} (apt install i2c-tools picocom)")


def rows_of(path, quantity):
    with path.open() as file:
        return [row for row in csv.DictReader(file) if row["quantity"] == quantity]


def humidity_percent(frame):
    return ((frame[0] & 0x3F) << 8 | frame[1]) / 16383 * 100


@needs_cc
@needs("i2ctransfer")
def test_unmodified_i2c_tools_read_the_sensor(tmp_path):
    """The dialogue of the application note through i2ctransfer: request, fetch; fetched again it is stale."""
    with emulating(tmp_path, "hyt-271", "--source", "25,60", "--truth", str(tmp_path / "truth.csv")):

        def run(*command):
            return subprocess.run(command, env=with_bus(tmp_path), capture_output=True, text=True, timeout=300)

        grid = run("i2cdetect", "-y", "1").stdout
        assert re.findall(r"\b28\b", grid) and grid.count("--") > 100
        assert run("i2ctransfer", "-y", "1", "w0@0x28").returncode == 0
        time.sleep(0.1)
        frames = [run("i2ctransfer", "-y", "1", "r4@0x28").stdout.split() for _ in range(2)]
        fresh, again = (bytes(int(cell, 16) for cell in frame) for frame in frames)
        assert fresh[0] & 0xC0 == 0 and again == bytes((fresh[0] | 0x40,)) + fresh[1:]
        assert humidity_percent(fresh) == pytest.approx(60.0, abs=1.0)
        nobody = run("i2ctransfer", "-y", "1", "r4@0x29")
        assert nobody.returncode != 0 and "Remote I/O error" in nobody.stderr
        other_bus = run("i2ctransfer", "-y", "250", "r4@0x28")
        assert other_bus.returncode != 0 and "No such file" in other_bus.stderr
    said = rows_of(tmp_path / "truth.csv", "humidity_percent")
    assert said and float(said[-1]["said"]) == pytest.approx(humidity_percent(fresh), abs=0.0001)
    assert float(said[-1]["air"]) == pytest.approx(60.0, abs=0.001)
    assert not (tmp_path / "i2c-1.socket").exists()


@needs_cc
def test_a_script_on_smbus2_reads_the_sensor_and_other_files_are_untouched(tmp_path):
    script = """
import smbus2, sys, time
open(sys.argv[1], "w").write("kept")
bus = smbus2.SMBus(1)
bus.i2c_rdwr(smbus2.i2c_msg.write(0x28, []))
time.sleep(0.1)
message = smbus2.i2c_msg.read(0x28, 4)
bus.i2c_rdwr(message)
again = bus.read_i2c_block_data(0x28, 0, 4)  # writes a byte first, which requests, then reads too early
print(bytes(message).hex(), bytes(again).hex(), bus.read_byte(0x28) >> 7, open(sys.argv[1]).read())
try:
    bus.read_byte(0x40)
except OSError as error:
    print(error.errno)
bus.close()
"""
    with emulating(tmp_path, "hyt-271"):
        done = subprocess.run(
            [sys.executable, "-c", script, str(tmp_path / "note")],
            env=with_bus(tmp_path),
            capture_output=True,
            text=True,
            timeout=300,
        )
    first, number = done.stdout.splitlines()
    fresh, again, mode, note = first.split()
    assert int(again, 16) == int(fresh, 16) | 0x40 << 24
    assert (mode, note, number) == ("0", "kept", "121")


def test_a_broken_packet_is_an_error_and_no_harm():
    for packet in (b"", b"\x01", b"\x01\x00\x28", b"\x01\x00\x28\x00\x00\x00\x09\x00abc"):
        assert answer(None, packet) == (71).to_bytes(4, sys.byteorder)  # EPROTO


@needs("stty", "cat")
def test_unmodified_cat_reads_lines_and_nothing_from_before_it_opened(tmp_path):
    link = tmp_path / "tty"
    with emulating(tmp_path, "imet-xf", "--link", str(link), "--rate-hz", "20", "--humidity") as process:
        assert str(link) in process.hello
        speed = subprocess.run(["stty", "-F", str(link), "speed"], capture_output=True, text=True, timeout=300)
        assert speed.returncode == 0
        time.sleep(1.0)  # what is said now, nobody hears
        before_s, heard = time.monotonic(), b""
        with subprocess.Popen(["cat", str(link)], stdout=subprocess.PIPE) as cat:
            while heard.count(b"\r\n8,") < 15 and time.monotonic() < before_s + 60:
                heard += os.read(cat.stdout.fileno(), 4096)
            cat.kill()
        lines = heard.decode("ascii").split("\r\n")
        beads = [line for line in lines if re.fullmatch(r"5,\d{4},\d+", line)]
        # whoever opens between a bead's line and its film's hears one bead less
        assert 14 <= len(beads) <= 20 * (time.monotonic() - before_s) + 3
        assert sum(bool(re.fullmatch(r"8,\d+,\d+", line)) for line in lines) >= 14
    assert not link.exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_in_the_background_too_an_emulator_is_told_to_end(tmp_path, number):
    link = tmp_path / "tty"
    with emulating(tmp_path, "grbl", "--link", str(link), begin=in_background, number=number) as process:
        assert link.exists()
    assert process.returncode == 0 and process.last_words == ("", "") and not link.exists()


@needs("picocom")
def test_an_unmodified_terminal_reads_the_unit(tmp_path):
    link, line = tmp_path / "tty", rb"XQ,\+\d{6},\+\d{4},\+\d{4},\+\d{4},2015/10/18,"
    with emulating(tmp_path, "imet-xq2", "--link", str(link), "--rate-hz", "10"):
        screen, keyboard = os.openpty()
        ends = dict.fromkeys(("stdin", "stdout", "stderr"), keyboard)
        # A session of its own: job control of the terminal that runs the tests must not stop it.
        with subprocess.Popen(["picocom", "-q", "-b", "57600", link], **ends, start_new_session=True) as run:
            heard, deadline_s = b"", time.monotonic() + 30
            while len(re.findall(line, heard)) < 5 and time.monotonic() < deadline_s:
                if select.select([screen], [], [], 0.2)[0]:
                    heard += os.read(screen, 4096)
            run.kill()
        os.close(screen)
        os.close(keyboard)
    assert len(re.findall(line, heard)) >= 5, heard


def test_a_grbl_sender_moves_the_emulated_carriage(tmp_path):
    serial = pytest.importorskip("serial")
    link = tmp_path / "tty"
    with emulating(tmp_path, "grbl", "--link", str(link)):
        with serial.Serial(str(link), 115200, timeout=30) as port:
            port.write(b"$H\n")
            assert port.readline() == b"ok\r\n"
            port.write(b"G90 G53 G1 X300 F30000\n")
            assert port.readline() == b"ok\r\n"
            port.write(b"?")
            deadline_s = time.monotonic() + 60
            while (report := port.readline()).startswith(b"<Run|") and time.monotonic() < deadline_s:
                port.write(b"?")
            assert report.startswith(b"<Idle|MPos:300.000,")


@needs_cc
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("grbl", "grbl"), "name grbl once"),
        (("imet-xf",) * 9, "9 beads and 0 films: at most 8 probes"),
        (("hyt-271", "--second"), "name imet-xf"),
        (("hyt-271", "hyt-271", "--address", "0x77"), "give a lower one"),
        (("imet-xf", "imet-xf", "--flight", "none.csv"), "one probe flies"),
        (("hyt-271", "--link", "x"), "--link x: here are 0 serial instruments"),
        (("imet-xf", "--fault", "nack@1"), "no fault 'nack'"),
        (("imet-xf", "--fault", "silence"), "KIND@START"),
        (("imet-xf", "--fault", "silence@20-10"), "--fault silence@20-10: ends before it begins"),
        (("imet-xf", "--profile", "p.json"), "only with --flight"),
        (("imet-xf", "--flight", "none.csv"), "none.csv: No such file"),
        (("imet-xf", "--speed", "0"), "--speed 0"),
        (("imet-xf", "--source", "warm"), "--source warm"),
    ],
)
def test_what_cannot_be_emulated_is_refused(capsys, monkeypatch, tmp_path, arguments, says):
    from shockrig.protocols.cli import main

    monkeypatch.chdir(tmp_path)
    assert main(["emulate", *arguments, "--folder", str(tmp_path)]) == 2
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [(("--link", "there"), "--link there: File exists"), (("--truth", "none/truth.csv"), "none/truth.csv: ")],
)
def test_what_is_refused_leaves_no_folder(capsys, monkeypatch, tmp_path, arguments, says):
    from shockrig.protocols.cli import main

    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").touch()
    assert main(["emulate", "imet-xf", *arguments, "--folder", "made/for/it"]) == 2
    assert says in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["there"]


def test_several_of_a_kind_are_further_probes_side_by_side(tmp_path):
    """Two XFs, each with two beads and two films: eight courses of their own through one transfer."""
    from shockrig.rig.seams import Air
    from shockrig.rig.virtual.emulate.live_session import Options, instruments_of, probes_of
    from shockrig.rig.virtual.emulate.rest import RestingBench

    options = Options(humidity=True, second=True)
    kinds = ["imet-xf", "grbl", "imet-xf"]
    instruments = instruments_of(kinds, options)
    assert [one.name for one in instruments] == ["imet-xf", "grbl", "imet-xf-2"]
    assert [(one.beads, one.films) for one in instruments] == [((1, 2), (1, 2)), ((), ()), ((3, 4), (3, 4))]
    worlds = [
        RestingBench(Air(20.0, 50.0), Air(40.0, 20.0), 6.0, 1013.25, 3, probe + 1)
        for probe in range(probes_of(instruments))
    ]
    session = Session(kinds, worlds, FastClock(), tmp_path, unix_s=time.time, truth=tmp_path / "t.csv", options=options)
    try:
        assert sorted(session.serial) == ["grbl", "imet-xf", "imet-xf-2"]
        session.witness.begin_transfer(1.0)
        for probe in range(1, 5):
            for quantity in ("temperature_c", "humidity_percent"):
                session.witness.sampler("imet-xf", quantity, probe, f"probe {probe}")(1.6)
    finally:
        session.close()
    for quantity in ("temperature_c", "humidity_percent"):
        said = {row["instrument"]: float(row["said"]) for row in rows_of(tmp_path / "t.csv", quantity)}
        assert len({said[f"probe {probe}"] for probe in range(1, 5)}) == 4  # on their way, each at its own pace


def step_flight(path, before_c=20.0, after_c=30.0, at_s=20.0, end_s=40.0):
    path.write_text(
        "time_s,temperature_c,humidity_percent,airspeed_m_s\n"
        + f"0,{before_c},50,6\n{at_s - 0.005},{before_c},50,6\n{at_s + 0.005},{after_c},50,6\n{end_s},{after_c},50,6\n"
    )
    return path


def test_a_step_in_flight_is_felt_as_the_series_says(tmp_path):
    """Known answer: 1 + 2 sum (-1)^n exp(-n^2 pi^2 alpha t / R^2), reached to 63, 90 and 98 % at the tabled times."""
    profile = typical_profile(bead_t98_s=2.0)
    world = flight_world(read_flown_air(step_flight(tmp_path / "flight.csv")), profile, noise=0.0)
    unit_s = profile.temperature.bead_radius_m**2 / profile.temperature.thermal_diffusivity_m2_s.value
    assert unit_s * response_times(sphere_core())[2] == pytest.approx(2.0)
    for dimensionless, share in ((0.17091, 0.63212), (0.30352, 0.9), (0.46660, 0.98)):
        value = world.bead_temperature_c(20.0 + dimensionless * unit_s)
        assert (value - 20.0) / 10.0 == pytest.approx(share, abs=0.005)
    assert world.air(20.1).temperature_c == pytest.approx(30.0)
    assert world.end_s == pytest.approx(40.0)


def test_a_flight_is_played_in_time_with_its_truth_beside_it(tmp_path):
    """At ten times the speed: what was said lags the air by the bead's response, and every line is in the book."""
    profile = typical_profile(bead_t98_s=2.0)
    world = flight_world(read_flown_air(step_flight(tmp_path / "flight.csv", at_s=8.0, end_s=16.0)), profile)
    clock = FastClock(10.0)
    session = Session(["imet-xf"], [world], clock, tmp_path, unix_s=time.time, truth=tmp_path / "t.csv")
    try:
        import serial

        with serial.Serial(session.serial["imet-xf"], 57600, timeout=0.2) as port:
            heard = b""
            while clock.now() < 14.0:
                heard += port.read(4096)
    finally:
        session.close()
    book = rows_of(tmp_path / "t.csv", "temperature_c")
    said = {round(100 * float(row["said"])) for row in book}
    lines = re.findall(rb"\r\n5,(\d+),\d+(?=\r\n)", heard)
    assert len(lines) > 60 and all(int(line) in said for line in lines)
    # A line is as old as the unit takes to convert and say it, and this machine may be busy: what was said is what the
    # sphere had reached a little before, at whatever moment that was.
    unit_s = profile.temperature.bead_radius_m**2 / profile.temperature.thermal_diffusivity_m2_s.value
    since = np.arange(0.0, 9.0, 0.001) - 0.5
    n = np.arange(1, 400)[:, np.newaxis]
    share = 1.0 + 2.0 * np.sum((-1.0) ** n * np.exp(-((n * np.pi) ** 2) * np.maximum(since, 1e-4) / unit_s), axis=0)
    share[since <= 0.0] = 0.0
    for row in book:
        t, value = float(row["time_s"]) - 8.0, float(row["said"])
        latest, earliest = (20.0 + 10.0 * np.interp(t - late, since, share, left=0.0) for late in (0.0, 0.2))
        assert earliest - 0.1 < value < latest + 0.1
    assert any(0.0 < float(row["time_s"]) - 8.0 < 2.0 for row in book)
    # Where the machine is busy a line is said late, but never early, and hardly all of a dozen.
    late_s = np.array([float(row["unix_s"]) - float(row["time_s"]) / 10.0 for row in book])
    first, last = late_s[: len(book) // 2].min(), late_s[len(book) // 2 :].min()
    assert last == pytest.approx(first, abs=0.1)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time_s,humidity_percent\n0,50\n2,50\n", "no column temperature_c"),
        ("time_s,temperature_c,humidity_percent\n0,20,50\n", "fewer than two rows"),
        ("time_s,temperature_c,humidity_percent\n0,20,50\n3,20,50\n2,20,50\n", "line 4: time_s"),
        ("time_s,temperature_c,humidity_percent\n0,20,50\n2,20,6526.9\n", "line 3: humidity_percent 6526.9 cannot be"),
        ("time_s,temperature_c,humidity_percent\n0,20,5\n2,hot,50\n", "'hot' is not a number"),
        ("time_s,temperature_c,humidity_percent\n0,20,5,0\n2,20,50,0\n", "cannot be read as CSV"),
    ],
)
def test_a_flight_that_cannot_be_flown_is_refused(tmp_path, text, says):
    (tmp_path / "f.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        read_flown_air(tmp_path / "f.csv")


def test_the_corrected_air_of_a_flight_is_taken_before_its_readings(tmp_path):
    (tmp_path / "f.csv").write_text(
        "time_s,temperature_c,humidity_percent,temperature_corrected_c,humidity_corrected_percent\n"
        "100,20,50,21,51\n101,20,50,,\n102,20,50,23,53\n"
    )
    air = read_flown_air(tmp_path / "f.csv")
    assert air.temperature_c[0] == 21.0 and air.humidity_percent[-1] == 53.0
    assert np.allclose(np.diff(air.temperature_c), 0.01)  # over the gap a straight line
