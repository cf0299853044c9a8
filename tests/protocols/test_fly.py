"""Sensors read in flight: rows, logs that survive, what is said while a sensor is away, and the service around it."""

import csv
import json
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from urllib.request import urlopen

import numpy as np
import pytest
from browser import CHROMIUM, page_at
from emulated import emulating, with_bus
from processes import ended, heard, wait_for

from shockrig.analysis.flight.causal import Corrector, rows_of
from shockrig.analysis.flight.causal_design import design_of
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.physics.standard_atmosphere import pressure_altitude_m
from shockrig.files.flight_rows import whole_flight
from shockrig.files.profile import StatedEffect, Uncertain, write_profile
from shockrig.protocols.cli import main
from shockrig.protocols.fly import COLUMNS, LOG, FlightLog, Watchdog
from shockrig.protocols.fly_page import FlightFollower, serve_beside
from shockrig.rig.clock import VirtualClock
from shockrig.rig.flying import PeriodFinder, RowMaker, SensorHub
from shockrig.rig.links.said import SaidAir
from shockrig.rig.recorder.run_journal import read_run
from shockrig.rig.seams import Outcome, Reading

NAN = math.nan


def bead(at_s, value=20.0, outcome=Outcome.OK):
    return Reading("imet", outcome, at_s, at_s + 0.004, {"temperature_c": value}, sampled_s=at_s)


def film(at_s, value=50.0):
    return Reading("hyt", Outcome.OK, at_s - 0.05, at_s + 0.02, {"humidity_percent": value, "temperature_c": 21.0},
                   sampled_s=at_s)  # fmt: skip


def rows_made(readings, until_s, period_s=0.1, began_s=0.9):
    """What a maker makes of readings that come one by one, looked at every 10 ms."""
    maker, found, waiting = RowMaker(period_s, began_s), [], sorted(readings, key=lambda one: one.time_s)
    for now_s in np.arange(began_s, until_s, 0.01).tolist():
        while waiting and waiting[0].time_s <= now_s:
            maker.take(waiting.pop(0))
        found += maker.rows(now_s)
    return found


def test_a_row_has_the_bead_s_time_and_the_film_s_newest_reading():
    rows = rows_made([*(bead(t / 10) for t in range(10, 40)), *(film(t / 10 + 0.03, t) for t in range(10, 40))], 3.9)
    assert [row.time_s for row in rows[:3]] == [1.0, 1.1, 1.2]
    assert not any(math.isnan(row.humidity_percent) for row in rows[1:])
    assert all(abs(row.humidity_s - row.time_s) < 0.1 for row in rows[1:])


def test_readings_that_come_together_share_a_row_whichever_is_first():
    """Two instruments of one rate whose readings come at nearly the same time: none is left out."""
    rng = np.random.default_rng(1)
    beads = [bead(t / 10) for t in range(10, 110)]
    films = [film(t / 10 - 0.016 + 0.01 * rng.uniform(-1, 1), t) for t in range(10, 110)]
    rows = rows_made([*beads, *films], 10.9)
    told = [row.humidity_percent for row in rows[2:-2]]
    assert told == sorted(told) and len(set(told)) == len(told) and not np.isnan(told).any()


def test_without_the_bead_rows_go_on_and_say_so():
    """And when it comes back the rows are its own again."""
    beads = [bead(t / 10) for t in [*range(10, 30), *range(60, 80)]]
    rows = rows_made([*beads, *(film(t / 10 + 0.03) for t in range(10, 80))], 7.9)
    times = [row.time_s for row in rows]
    assert np.all(np.diff(times) > 0.0) and np.max(np.diff(times)) < 0.25
    away = [row for row in rows if 3.05 < row.time_s < 5.9]
    assert len(away) >= 27 and all(math.isnan(row.temperature_c) for row in away)
    assert not any(math.isnan(row.humidity_percent) for row in away)


def test_what_is_stale_or_broken_makes_no_row():
    rows = rows_made([bead(1.0), bead(1.1, 99.0, Outcome.STALE), bead(1.2)], 1.35)
    assert [row.temperature_c for row in rows if row.temperature_c == row.temperature_c] == [20.0, 20.0]


def test_the_period_is_that_of_the_slower_sensor():
    finder = PeriodFinder(0.0)
    for k in range(8):
        finder.take(bead(0.2 * k))
        finder.take(film(0.1 * k))
    assert finder.found(1.5) == 0.2
    alone = PeriodFinder(0.0)
    for k in range(8):
        alone.take(bead(0.1 * k))
    assert alone.found(1.0) is None and alone.found(4.0) == 0.1  # nobody waits for the film for ever


class Moody:
    """A sensor that cannot be opened at first."""

    name = "imet"

    def __init__(self, clock, there_from_s):
        self.clock, self.there_from_s, self.opened = clock, there_from_s, Counter()

    def open(self):
        self.opened[self.clock.now() >= self.there_from_s] += 1
        if self.clock.now() < self.there_from_s:
            raise FileNotFoundError(2, "No such file or directory")

    def due_s(self):
        return self.clock.now() + 0.1

    def poll(self):
        return [bead(self.clock.now())]

    def close(self):
        pass


def test_a_sensor_that_is_missing_at_first_is_used_when_it_comes():
    clock, said = VirtualClock(), []
    sensor = Moody(clock, 5.0)
    sensor.due_s = lambda: clock.now()
    hub = SensorHub([sensor], clock, said.append)
    found = []
    while clock.now() < 8.0:
        found += hub.poll()
        hub.watch(0.1)
        clock.sleep_until(clock.now() + 0.1)
    assert said == ["imet cannot be opened: No such file or directory", "imet speaks again"]
    assert sensor.opened[False] <= 6 and found[0].time_s == pytest.approx(5.0, abs=1.1)


def test_a_disk_that_fails_is_told_once_and_no_error(tmp_path, monkeypatch):
    told = []
    log = FlightLog(tmp_path, {}, 0.0, None, told.append)
    monkeypatch.setattr(os, "write", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    for at_s in range(5):
        log.row([NAN] * (len(COLUMNS) - 1), "", float(at_s))
    assert told == ["the log is written no further: No space left on device"]


def test_flights_are_numbered_and_none_is_written_over(tmp_path):
    logs = [FlightLog(tmp_path, {}, 0.0, None, print) for _ in range(3)]
    assert [log.folder.name for log in logs] == ["0001", "0002", "0003"]


def test_systemd_hears_that_the_loop_goes_round(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        watchdog = Watchdog({"NOTIFY_SOCKET": str(tmp_path / "notify")})
        watchdog.say("WATCHDOG=1")
        assert manager.recv(100) == b"WATCHDOG=1"
        watchdog.close()
    Watchdog({}).say("nobody hears it")


def test_the_page_shows_the_profile_over_altitude():
    follower = FlightFollower()
    for k in range(5000):
        around = {"altitude_m": NAN, "pressure_hpa": 1000.0 - k / 100}
        follower.take(SaidAir(k / 2, (20.0, NAN), (0.1, NAN), (20.5, NAN)), around)
    follower.say(3.0, "imet is silent")
    server = serve_beside(follower, "127.0.0.1", 0)
    with urlopen(f"{server.url}view.json", timeout=30) as answer:
        view = json.load(answer)
    with urlopen(server.url, timeout=30) as answer:
        assert b"<title>shockrig fly</title>" in answer.read()
    server.shutdown()
    server.server_close()
    assert (
        view["rows"] == 5000 and view["over"] == "pressure altitude" and view["messages"] == ["3.0 s: imet is silent"]
    )
    assert 600 <= len(view["profile"]) <= 1201 and view["now"]["humidity_percent"] is None
    assert view["now"]["altitude_m"] == pytest.approx(pressure_altitude_m(950.01))


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: the page is not looked at in a browser")
def test_in_a_hover_the_page_shows_a_course_over_time(tmp_path):
    """Which of both charts are there on the ground, in a climb, in the hover after it, and without any altitude."""
    follower, time_s = FlightFollower(), iter(range(10_000))

    def flown(altitudes):
        for altitude_m in altitudes:
            said = SaidAir(float(next(time_s)), (20.0, 50.0), (0.1, 1.0), (20.5, 51.0))
            follower.take(said, {"altitude_m": altitude_m, "pressure_hpa": NAN})

    server = serve_beside(follower, "127.0.0.1", 0)
    with page_at(server.url, tmp_path / "profile") as run:
        titles = "[...document.querySelectorAll('section:not([hidden]) svg title')].map((t) => t.textContent).join()"
        over = {way: f"Temperature over {way},Relative humidity over {way}" for way in ("altitude", "time")}
        shown = over | {"both": f"{over['altitude']},{over['time']}"}
        for altitudes, charts in (
            ([NAN] * 20, "time"), ([3.0, 4.0] * 10, "time"), (range(4, 104), "altitude"), ([104.0] * 400, "both")
        ):  # fmt: skip
            flown(altitudes)
            wait_for(lambda charts=charts: run(titles) == shown[charts])
    server.shutdown()
    server.server_close()


@pytest.fixture
def profile(tmp_path):
    path = tmp_path / "profile.json"
    write_profile(typical_profile(), path)
    return path


def test_the_unit_starts_the_same_flight_at_boot(profile, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["fly", "--bench", "drone", "--profile", "profile.json", "--out", "a b", "--lag-s", "2",
                 "--dronecan", "mcast:", "--unit"]) == 0  # fmt: skip
    unit = capsys.readouterr().out
    assert f"fly --bench drone --profile {profile} --out '{tmp_path / 'a b'}' --dronecan mcast: --lag-s 2.0\n" in unit
    assert "WatchdogSec=10" in unit and "Restart=always" in unit and "Type=notify" in unit
    assert not (tmp_path / "a b").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--bench", "virtual"], "shockrig hil flies emulated ones"),
        (["--bench", "drone", "--lag-s", "-1"], "--lag-s -1: expected 0 to 60 s"),
        (["--bench", "drone", "--dronecan", "mcast:", "--node", "0"], "--node 0: expected 1 to 125"),
        (["--bench", "drone", "--mavlink", "tcp:a:1"], "tcp:a:1: expected udpout:HOST:PORT"),
    ],
)
def test_what_cannot_be_flown_is_refused(profile, tmp_path, capsys, arguments, words):
    assert main(["fly", "--profile", str(profile), "--out", str(tmp_path / "out"), *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_port_that_is_taken_or_a_profile_that_lacks_a_number_begins_no_flight(profile, tmp_path, capsys):
    lacking, plain = tmp_path / "lacking.json", typical_profile()
    effect = StatedEffect("dead_time", {"other": Uncertain(0.1, 0.1)})
    write_profile(replace(plain, humidity=replace(plain.humidity, effects=(effect,))), lacking)
    out = ["--out", str(tmp_path / "out")]
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        arguments = ["--bench", "drone", "--profile", str(profile), "--for-s", "1", "--web", "--port", port]
        assert main(["fly", *arguments, *out]) == 2
    assert "Address already in use; give another" in capsys.readouterr().err
    assert main(["fly", "--bench", "drone", "--profile", str(lacking), "--for-s", "1", *out]) == 2
    assert "lacks the parameter 'delay_s'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) to build the preload library with")


@needs_cc
def test_a_killed_flight_loses_nothing_and_the_next_one_goes_on(tmp_path, profile):
    """Unmodified drivers on emulated instruments in real time, killed in the middle of a row, and started again."""
    port = tmp_path / "ttyXF"
    bench = tmp_path / "bench.toml"
    text = subprocess.run(
        [sys.executable, "-m", "shockrig", "bench", "drone"], capture_output=True, text=True, check=True
    ).stdout
    bench.write_text(text.replace("/dev/ttyUSB0", str(port)))
    ground = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    ground.bind(("127.0.0.1", 0))
    ground.settimeout(60)
    address = f"udpout:127.0.0.1:{ground.getsockname()[1]}"
    command = [sys.executable, "-m", "shockrig", "fly", "--bench", str(bench), "--profile", str(profile),
               "--out", str(tmp_path / "flights"), "--mavlink", address]  # fmt: skip
    with ground, emulating(tmp_path, "imet-xf", "hyt-271", "--link", str(port)):
        for number, name in enumerate(("0001", "0002")):
            log = tmp_path / "flights" / name / LOG
            with subprocess.Popen(
                command, env=with_bus(tmp_path), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            ) as process:
                heard(process, process.stdout, "Ctrl-C")
                wait_for(lambda log=log: log.read_bytes().count(b"\n") > 15, process)
                assert ground.recv(2048)[0] == 0xFD  # MAVLink 2
                ended(process, (signal.SIGKILL, signal.SIGTERM)[number])
    for name, status in (("0001", "interrupted"), ("0002", "complete")):
        folder = tmp_path / "flights" / name
        text = (folder / LOG).read_text()
        rows = list(csv.DictReader(text.splitlines()))
        assert text.endswith("\n") and all(None not in row.values() for row in rows) and len(rows) >= 15
        run = read_run(folder)
        assert run.status == status and not run.damage
        said = np.array([reading.sampled_s for reading in run.readings["imet"] if reading.sampled_s])
        used = np.array([float(row["time_s"]) for row in rows if row["temperature_c"]])
        assert np.abs(used[:, np.newaxis] - said).min(axis=1).max() < 2e-6
        late = [float(row["sent_s"]) - float(row["came_s"]) for row in rows if row["came_s"]]
        assert min(late) >= 0.0
        flight = whole_flight(folder / LOG)
        assert np.isfinite(flight.temperature_c).mean() > 0.5 and np.isfinite(flight.pressure_hpa).any()
        period_s = float(run.notes[0][1].split()[1])
        corrector = Corrector(design_of(typical_profile(), period_s))
        for row, (log_row, _) in zip(rows_of(flight), zip(rows, rows, strict=True), strict=True):
            ((warm, _),) = corrector.step(row)
            onboard = log_row["onboard_temperature_c"]
            assert onboard == "" or float(onboard) == pytest.approx(warm.value, abs=1e-3)
