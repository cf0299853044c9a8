"""What must hold of watching: it shows what is there, survives whatever is there, and the run never knows of it."""

import io
import json
import os
import random
import re
import select
import signal
import subprocess
import sys
import termios
import threading
import time
import zlib
from dataclasses import asdict
from importlib import resources
from pathlib import Path

import pytest
from fake_bench import fake_bench, plan
from fake_bench import run as record
from made_recordings import STATUS, made_campaign, reading
from processes import ended, heard, wait_for

from shockrig.protocols.cli import main
from shockrig.protocols.watch.terminal import plot, render
from shockrig.protocols.watch.web import WatchServer
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.journal import JournalWriter
from shockrig.rig.observer import SilentObserver
from shockrig.rig.watch.follow import Follower
from shockrig.rig.watch.run_so_far import thinned
from shockrig.rig.watch.status_file import StatusFile
from shockrig.rig.watch.view import clean

ROOT = Path(__file__).parents[2]
TINY = """
format = "shock-protocol/1"
name = "</title><script>document.title='ran'</script>"
airflow_m_s = 6.0
faults = { largest_gap_s = 4, missing_percent_at_most = 60 } # a busy test machine is none
[steps]
usual = [
  { do = "soak", over_s = 2, at_most_s = 60, probes_within_k = 1, probes_within_percent = 2 },
  { do = "record", for_s = 1 },
  { do = "transfer" },
  { do = "record", for_s = 4 },
]
[[run]]
note = "<img src=x onerror=document.title='ran'>"
source = { temperature_c = 20, humidity_percent = 50 }
destination = { temperature_c = 30, humidity_percent = 30 }
"""


def shockrig(*arguments, stdout=subprocess.PIPE):
    command = [sys.executable, "-m", "shockrig", *map(str, arguments)]
    return subprocess.Popen(command, cwd=ROOT, text=True, stderr=subprocess.PIPE, stdout=stdout)


class Terminal:
    """A pseudo-terminal for a command to write to; `text` is all that it has shown."""

    def __init__(self):
        self._master, self.slave = os.openpty()
        termios.tcsetwinsize(self.slave, (40, 100))
        self._seen, self._stop = b"", threading.Event()
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self):
        while not self._stop.is_set():
            if select.select([self._master], [], [], 0.05)[0]:
                self._seen += os.read(self._master, 1 << 16)

    def text(self):
        return self._seen.decode("utf-8", "replace")

    def close(self):
        self._stop.set()
        self._thread.join()
        os.close(self._master)
        os.close(self.slave)


@pytest.fixture
def terminal():
    made = Terminal()
    yield made
    made.close()


def in_real_time(tmp_path, last_s=4):
    """Arguments of `run` for one run on the emulated bench that ends `last_s` after its transfer, and its folder, of
    hostile names."""
    bench = (resources.files("shockrig.data") / "benches" / "virtual.toml").read_text(encoding="utf-8")
    (tmp_path / "bench.toml").write_text(bench.replace('clock = "virtual"', 'clock = "real"'))
    (tmp_path / "tiny.toml").write_text(TINY.replace("for_s = 4", f"for_s = {last_s}"))
    out = tmp_path / "<script>document.title='ran'<"
    return ["run", tmp_path / "tiny.toml", "--bench", tmp_path / "bench.toml", "--out", out], out


def in_full_swing(view):
    """A view in which the transfer is over and both sensors are heard; None where it is not that far."""
    heard = [health.state in ("good", "failing") for health in view.health]
    far = view.state == "recording" and view.transfer_s and len(heard) == 2 and all(heard)
    return view if far and len(view.traces[0].points) > 15 else None


@pytest.fixture
def live(tmp_path):
    """(process, folder) of a recording in real time, whose last step is longer than any test looks at it."""
    arguments, out = in_real_time(tmp_path, 600)
    process = shockrig(*arguments)
    try:
        wait_for(lambda: list(out.glob("recording/*/journal.log")), process)
        yield process, out
    finally:
        process.kill()
        process.communicate()


@pytest.mark.elsewhere
def test_a_recording_is_seen_and_its_watchers_can_be_killed(live, terminal):
    process, out = live
    shown = shockrig("watch", out, stdout=terminal.slave)
    web = shockrig("watch", out, "--web")
    follower = Follower(out, time.monotonic)
    try:
        # On a busy machine a sensor may be late for some seconds, and all of them together: that passes.
        view = wait_for(lambda: in_full_swing(follower.look()), process)
        assert view.run == "0001"
        assert view.bench == "virtual bench (EMULATED: invented, not measured)"
        assert [step.state for step in view.steps] == ["done", "done", "done", "now"]
        assert 0.0 < view.step_left_s <= 600.0 and view.left_s == pytest.approx(view.step_left_s)
        by_name = {health.sensor: health for health in view.health}
        assert 0.0 < by_name["imet"].per_s < 12.0
        assert 19.5 <= by_name["imet"].values["temperature_c"] <= 30.5  # between the airs, and their noise
        before = [value for time_s, value in view.traces[0].points if time_s < view.transfer_s[0]]
        assert sum(before) / len(before) == pytest.approx(20.0, abs=0.05)
        heard(web, web.stdout, "http://127.0.0.1:")
        wait_for(lambda: "record 600 s" in terminal.text() and "degC" in terminal.text())
        for watcher in (shown, web):
            assert watcher.poll() is None
            watcher.kill()
        seen = len(follower.look().traces[0].points)
        wait_for(lambda: len(follower.look().traces[0].points) > seen + 20)  # it goes on as if nothing had been
        _, errors = ended(process, signal.SIGINT)
        assert process.returncode == 130, errors
        head = json.loads((out / "set_aside/0001-1/run.json").read_text())
        assert head["reason"] == "stopped by the operator" and head["outcomes"]["imet"]["ok"] > seen
        assert follower.look().state == "ended" and "stopped by Ctrl-C" in follower.look().summary()
    finally:
        follower.close()
        for watcher in (shown, web):
            watcher.kill()
            watcher.communicate()


@pytest.mark.parametrize("killed", [False, True])
def test_run_with_the_view_beside_it(tmp_path, terminal, killed):
    arguments, out = in_real_time(tmp_path)
    process = shockrig(*arguments, "--watch", stdout=terminal.slave)
    try:
        wait_for(lambda: "good/s" in terminal.text(), process)
        if killed:
            (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
            os.kill(int(child), signal.SIGKILL)
        _, errors = ended(process)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 0, errors
    assert json.loads((out / "runs/0001/run.json").read_text())["status"] == "complete"
    end = terminal.text().rpartition("\x1b[?1049l")[2]  # after the alternate screen, which is left behind either way
    assert "1 run in" in end and "\x1b[?25l" not in end


def test_a_recorder_that_was_killed_is_told_so(live):
    process, out = live
    follower = Follower(out, time.monotonic)
    assert follower.look().state == "recording"
    process.kill()
    process.wait()
    assert follower.look().state == "cut off"
    follower.close()


def test_a_campaign_is_the_same_whether_somebody_watches_or_not(tmp_path):
    """The fake bench is exact, so that watching by many at once may not change a single byte."""
    stop = threading.Event()

    def look(path):
        while not stop.is_set():
            try:
                follower = Follower(path, time.monotonic)
            except BenchError:
                continue
            for _ in range(50):
                follower.look()
            follower.close()

    watchers = [threading.Thread(target=look, args=(tmp_path / "watched",)) for _ in range(2)]
    for watcher in watchers:
        watcher.start()
    try:
        for name in ("watched", "alone"):
            protocol = plan(3)
            with StatusFile(tmp_path / name, protocol, "fake", SilentObserver()) as status:
                record(fake_bench(), tmp_path / name, protocol, status)
    finally:
        stop.set()
        for watcher in watchers:
            watcher.join()
    files = [
        {p.relative_to(tmp_path / name): p.read_bytes() for p in (tmp_path / name / "runs").rglob("*") if p.is_file()}
        for name in ("watched", "alone")
    ]
    assert files[0] == files[1] and len(files[0]) == 3 * 4


def test_a_status_that_cannot_be_written_does_not_harm(tmp_path):
    protocol = plan(1)
    with StatusFile(tmp_path / "no such folder", protocol, "fake", SilentObserver()) as status:
        assert record(fake_bench(), tmp_path / "c", protocol, status) == ["0001"]


def test_time_left_by_hand(tmp_path):
    """3 s into the 20 s record of the first of three runs of 50 s to 620 s each."""
    path = tmp_path / "c"
    records = [["step", 10.0, "soak"], ["step", 100.0, "record 20 s"], ["zero", 100.0, "now"], reading("imet", 102.9)]
    journal = made_campaign(path, records, STATUS)
    follower = Follower(path, time.monotonic)
    view = follower.look()
    assert (view.step_s, view.step_left_s) == (pytest.approx(3.0), pytest.approx(17.0))
    assert view.left_s == pytest.approx(17.0 + 2 * 50.0) and view.left_at_most_s == pytest.approx(17.0 + 2 * 620.0)
    # Two runs recorded in 400 s: the missing ones will not take the 50 s that they could at best.
    (path / "status.json").write_text(json.dumps(STATUS | {"recorded_here": 2, "last_end_s": 400.0}))
    assert follower.look().left_s == pytest.approx(17.0 + 2 * 200.0)
    journal.append(["end", 120.0, "complete", ""], 0.0)
    assert follower.look().left_s == pytest.approx(2 * 200.0)
    follower.close()


def test_health_by_hand(tmp_path):
    times_s = [0.1 * i for i in range(200)]
    records = [reading("imet", t, temperature_c=t) for t in times_s]
    records += [reading("hyt", t, "ok" if i % 2 else "stale", humidity_percent=t) for i, t in enumerate(times_s)]
    journal = made_campaign(tmp_path / "c", sorted(records, key=lambda r: r[3]), STATUS)
    follower = Follower(tmp_path / "c", time.monotonic)
    imet, hyt = follower.look().health
    assert (imet.state, imet.per_s) == ("good", pytest.approx(10.0, abs=0.2)) and imet.outcomes.keys() == {"ok"}
    assert (hyt.state, hyt.per_s) == ("failing", pytest.approx(5.0, abs=0.2)) and hyt.outcomes.keys() == {"ok", "stale"}
    for t in range(200, 240):
        journal.append(reading("imet", 0.1 * t, temperature_c=0.0), 0.0)
    imet, hyt = follower.look().health
    assert (imet.state, hyt.state) == ("good", "silent") and hyt.age_s == pytest.approx(4.1, abs=0.15)
    follower.close()


def test_a_torn_line_is_read_when_it_is_whole(tmp_path):
    path = tmp_path / "c"
    made_campaign(path, [["zero", 0.0, ""]], STATUS)
    file = path / "recording/0001/journal.log"
    whole = file.read_bytes()
    follower = Follower(path, time.monotonic)
    follower.look()
    writer = JournalWriter(tmp_path / "line", None)
    writer.append(reading("imet", 1.0, temperature_c=25.0), 0.0)
    line = (tmp_path / "line").read_bytes()
    file.write_bytes(whole + line[:20])
    assert follower.look().traces == ()
    with file.open("ab") as appended:
        appended.write(line[20:])
    assert follower.look().traces[0].points == ((1.0, 25.0),)
    follower.close()


def test_the_next_attempt_is_followed_though_it_has_the_same_name(tmp_path):
    path = tmp_path / "c"
    made_campaign(path, [["zero", 0.0, ""], reading("imet", 1.0, temperature_c=25.0)], STATUS)
    follower = Follower(path, time.monotonic)
    assert follower.look().attempt == 1
    (path / "set_aside").mkdir()
    (path / "recording/0001").rename(path / "set_aside/0001-1")
    (path / "recording/0001").mkdir()
    again = JournalWriter(path / "recording/0001/journal.log", None)
    again.append(["run", {"id": "0001", "attempt": 2, "sensors": ["imet"], "steps": []}], 0.0)
    view = follower.look()
    assert view.attempt == 2 and view.traces == () and view.runs[0].set_aside == 1
    follower.close()


def test_whatever_is_in_the_files_is_survived(tmp_path):
    """Three hundred damaged campaigns: never an error, and always something that can be sent as JSON and printed."""
    from rich.console import Console

    path = tmp_path / "c"
    records = [["step", 1.0, "soak"], ["zero", 2.0, "x"], ["air", 2.5, "source", 20.0, 50.0], ["move", 3.0, None]]
    records += [reading("imet", 2.0 + 0.1 * i, temperature_c=20.0 + i) for i in range(5)]
    records += [["end", 9.0, "complete", ""]]
    made_campaign(path, records, STATUS)
    files = [path / "campaign.json", path / "status.json", path / "recording/0001/journal.log"]
    whole = {file: file.read_bytes() for file in files}
    pick = random.Random(5)
    hostile = [b"NaN", b"1e999", b"-1", b"null", b"[]", b"{}", b'"\\u202e\\u001b[2J"', b"9" * 400, b"true", b'"/../.."']
    console = Console(file=io.StringIO(), width=80)
    for _ in range(300):
        file = pick.choice(files)
        text = whole[file]
        tokens = list(re.finditer(rb'[-\d.]+|"[^"]*"|null', text))
        at = pick.choice(tokens)
        text = text[: at.start()] + pick.choice(hostile) + text[at.end() :]
        if pick.random() < 0.3:
            text = text[: pick.randrange(len(text))]
        if file.name == "journal.log":
            text = b"".join(b"%08x %b\n" % (zlib.crc32(t := x[9:]), t) for x in text.split(b"\n"))
        file.write_bytes(text)
        follower = Follower(path, time.monotonic)
        view = follower.look()
        follower.close()
        json.dumps(asdict(view), allow_nan=False)
        console.print(render(view, 80, 24))
        file.write_bytes(whole[file])
    assert "\x1b[2J" not in console.file.getvalue() and "\u202e" not in console.file.getvalue()


def test_names_are_shown_as_they_are_and_control_nothing():
    assert clean("a\x1b[31mb\u202ec\nd") == "a\ufffd[31mb\ufffdc\ufffdd"
    assert len(clean("x" * 10_000)) == 500


def test_plot_by_hand():
    """Four points on a diagonal: dots 7, 6 of the first character and 2 up to 1 of the second."""
    diagonal = [(0, 0), (1, 1), (2, 2), (3, 3)]
    assert plot(diagonal, 2, 1) == [chr(0x2800 + 0x40 + 0x20) + chr(0x2800 + 0x02 + 0x08)]
    assert plot(diagonal, 4, 4, ascii_only=True) == ["   *", "  * ", " *  ", "*   "]
    assert plot([(1.0, 5.0)], 3, 1) == ["\u2800\u2800" + chr(0x2800 + 0x20)]
    assert plot([], 3, 2) == ["   ", "   "]


def test_thinning_keeps_the_last_point():
    points = [(float(i), float(i)) for i in range(1234)]
    thin = thinned(points, 100)
    assert 50 <= len(thin) <= 100 and thin[-1] == points[-1] and thin == sorted(thin)
    assert thinned(points[:7], 100) == points[:7]


def test_alarms_tell_what_somebody_should_look_at(tmp_path):
    """A sensor that fell silent, and an attempt that was spoilt; one that the operator set aside is none."""
    from rich.console import Console

    records = [["step", 0.0, "soak"]]
    records += [reading("imet", 0.1 * i, temperature_c=20.0) for i in range(200)]
    records += [reading("hyt", 0.1 * i, "ok" if i < 150 else "stale", humidity_percent=40.0) for i in range(200)]
    made_campaign(tmp_path / "c", records, STATUS)
    for name, status, reason in (("0001-1", "spoilt", "imet gave no readings"), ("0001-2", "interrupted", "a wish")):
        follower = Follower(tmp_path / "c", lambda: 0.0)
        view = follower.look()
        follower.close()
        (tmp_path / "c/set_aside" / name).mkdir(parents=True)
        (tmp_path / "c/set_aside" / name / "run.json").write_text(json.dumps({"status": status, "reason": reason}))
        expected = ["hyt is silent"]
        if name == "0001-2":
            expected += ["run 0001 was spoilt and is recorded again: imet gave no readings"]
        assert list(view.alarms) == expected
        console = Console(width=80, height=24, file=io.StringIO(), highlight=False)
        console.print(render(view, 80, 24))
        assert console.file.getvalue().splitlines()[0].strip() == "hyt is silent"
    follower = Follower(tmp_path / "c", lambda: 0.0)
    assert follower.look().alarms == ("hyt is silent",)
    follower.close()


def test_markup_in_a_name_is_text(tmp_path):
    from rich.console import Console

    path = tmp_path / "[bold red]name[ "
    made_campaign(path, [["zero", 0.0, ""]], STATUS)
    follower = Follower(path, time.monotonic)
    console = Console(file=io.StringIO(), width=100)
    console.print(render(follower.look(), 100, 40))
    assert "[bold red]name[" in console.file.getvalue()
    follower.close()


@pytest.mark.parametrize("size", [(80, 24), (100, 30), (60, 20), (200, 60)])
def test_the_view_fits_the_terminal(tmp_path, size):
    from rich.console import Console

    records = [["step", 0.0, "soak " * 40], ["zero", 0.0, ""]]
    records += [reading("imet", 0.1 * i, temperature_c=20.0 + i) for i in range(50)]
    records += [reading("hyt", 0.1 * i, temperature_c=20.0, humidity_percent=1.0 * i) for i in range(50)]
    made_campaign(tmp_path / "c", records, STATUS, runs=40)
    follower = Follower(tmp_path / "c", time.monotonic)
    console = Console(file=io.StringIO(), width=size[0])
    console.print(render(follower.look(), *size))
    rows = console.file.getvalue().splitlines()
    assert len(rows) <= size[1] or size[1] == 20  # twenty rows are too few for everything: the plan is cut off
    follower.close()


def test_once(tmp_path, capsys):
    journal = made_campaign(tmp_path / "c", [["zero", 0.0, ""], reading("imet", 1.0, temperature_c=21.5)], STATUS)
    assert main(["watch", str(tmp_path / "c"), "--once"]) == 0
    assert "21.50 degC" in capsys.readouterr().out
    journal.close()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "nowhere: no such campaign folder; give"),
        (["c", "--every", "0"], "0.05 to 60"),
        (["c", "--port", "70000"], "0 (any"),
    ],
)
def test_bad_input(tmp_path, capsys, monkeypatch, arguments, message):
    made_campaign(tmp_path / "c", [])
    monkeypatch.chdir(tmp_path)
    assert main(["watch", *arguments, "--once"]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("content", "message"),
    [(b'{"format":\n', "line 2: not JSON"), (b"\xff\xfe", "not UTF-8"), (b"[]", "JSON object"), (b"{}", "key format")],
)
@pytest.mark.parametrize("way", ["--once", "--web"])
def test_a_damaged_campaign_is_refused_before_anything_is_shown(tmp_path, capsys, content, message, way):
    made_campaign(tmp_path / "c", [])
    (tmp_path / "c/campaign.json").write_bytes(content)
    assert main(["watch", str(tmp_path / "c"), way]) == 2
    said = capsys.readouterr()
    assert "campaign.json" in said.err and message in said.err and said.err.count("\n") == 1 and not said.out


def test_the_port_that_is_taken(tmp_path, capsys):
    made_campaign(tmp_path / "c", [])
    follower = Follower(tmp_path / "c", time.monotonic)
    with WatchServer(follower, "127.0.0.1", 0) as server:
        assert main(["watch", str(tmp_path / "c"), "--web", "--port", str(server.server_port)]) == 2
    assert "Address already in use" in capsys.readouterr().err
    follower.close()
