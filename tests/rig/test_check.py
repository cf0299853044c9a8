"""What must hold for whoever types `shockrig check`: everything that is wrong in one tree, nothing touched."""

import itertools
import re
import time
from dataclasses import replace
from pathlib import Path

import pytest
from fake_bench import fake_bench, plan

from shockrig.protocols.cli import main
from shockrig.protocols.commands.check import ready
from shockrig.rig.bench import default_bench, open_bench, virtual_bench
from shockrig.rig.bench_findings import clock_finding, examine, tree
from shockrig.rig.protocol import PlannedRun, Protocol, Record, Soak, Transfer, load_protocol
from shockrig.rig.seams import Air
from shockrig.rig.virtual.faults import Fault


def examined(tmp_path, faults=None, clock="virtual", wall=time.time, protocol=None, may_move=True):
    with virtual_bench(clock=clock, faults=faults) as bench:
        protocol = protocol or load_protocol("quick")
        found = examine(bench, protocol, tmp_path / "out", wall=wall, may_move=may_move)
        return bench, {finding.device.partition(" ")[0]: finding for finding in found}


def test_a_bench_that_is_well(tmp_path, capsys):
    assert main(["check", "--out", str(tmp_path / "new")]) == 0
    text = capsys.readouterr().out
    assert text.endswith(f"ready: shockrig run standard --out {tmp_path / 'new'}\n") and "FAULT" not in text
    # The emulated world rests at 20 degC and 50 %RH.
    assert "temperature 20.0" in text or "temperature 19.9" in text
    assert "humidity 50." in text or "humidity 49.9" in text
    assert "10 readings/s" in text
    assert list(tmp_path.iterdir()) == []


def test_everything_that_is_unplugged_is_told_at_once(tmp_path):
    unplugged = [Fault("unplug", 0.0)]
    _, found = examined(tmp_path, {"imet": unplugged, "hyt": unplugged, "stage": unplugged})
    assert [name for name, finding in found.items() if not finding.well] == ["imet", "hyt", "stage"]
    text = tree("the bench", list(found.values()))
    rows = text.splitlines()
    for device in ("imet (imet-xf on virtual)", "hyt (hyt-271 on virtual at 0x28)", "stage (grbl on virtual)"):
        at = rows.index(f"  FAULT  {device}")
        cause, remedy = rows[at + 1], rows[at + 2]  # each indented below the one before
        assert len(cause) - len(cause.lstrip()) < len(remedy) - len(remedy.lstrip())
        assert "nobody answers" in remedy or "no such bus" in remedy
    assert found["disk"].well and found["reference"].well


@pytest.mark.parametrize(
    ("part", "kind", "cause", "remedy"),
    [
        ("imet", "silence", "timed_out", "it is silent: check supply"),
        ("imet", "glued", "no good reading in 6 s", ""),
        ("imet", "garbage", "rejected", "check kind and baud"),
        ("hyt", "stuck_low", "implausible", "not shorted"),
        ("hyt", "stuck_high", "implausible", "not shorted"),
        ("hyt", "slow", "stale", "raise conversion_s"),
        ("hyt", "lost_request", "stale", "raise conversion_s"),
    ],
)
def test_a_sensor_that_opens_but_does_not_read_well(tmp_path, part, kind, cause, remedy):
    _, found = examined(tmp_path, {part: [Fault(kind, 0.0)]})
    assert cause in found[part].cause and remedy in found[part].remedy
    assert [name for name, finding in found.items() if not finding.well] == [part]


def test_a_sensor_that_fails_now_and_then_is_not_well(tmp_path):
    _, found = examined(tmp_path, {"hyt": [Fault("stuck_low", 0.0, probability=0.4)]})
    assert "implausible" in found["hyt"].cause and "10 readings/s" not in found["hyt"].cause
    assert "temperature" in found["hyt"].says  # what it did say is told too


@pytest.mark.parametrize(("until_s", "well"), [(0.85, True), (1.25, False)])
def test_one_lost_reading_is_told_and_a_share_of_them_is_a_fault(tmp_path, until_s, well):
    _, found = examined(tmp_path, {"hyt": [Fault("stuck_low", 0.75, until_s)]})
    said = found["hyt"].says if well else found["hyt"].cause
    assert found["hyt"].well is well, said
    *failed, of = map(int, re.findall(r"(\d+)(?= implausible| stale| readings$)", said))
    assert of > 40 and (sum(failed) == 1) is well  # who fails once is listened to for the whole time


def test_a_stage_that_must_not_move_hears_nothing(tmp_path):
    bench, found = examined(tmp_path, may_move=False)
    assert found["stage"].says == "left alone, as asked"
    assert bench.instruments.parts["stage"]._needs_homing  # homing would have cleared it
    bench, found = examined(tmp_path)
    assert found["stage"].says == "answers" and not bench.instruments.parts["stage"]._needs_homing


class SteppedClock:
    """Moves on by what is told at each look."""

    def __init__(self, steps_s, late_s=0.0):
        self._steps_s, self._late_s, self._now_s = itertools.cycle(steps_s), late_s, 0.0

    def now(self):
        self._now_s += next(self._steps_s)
        return self._now_s

    def sleep_until(self, time_s):
        self._now_s = max(self._now_s, time_s) + self._late_s


@pytest.mark.parametrize(
    ("clock", "wall_s", "jump_s", "cause"),
    [
        (SteppedClock([1e-6]), 1.8e9, 0.0, ""),
        (SteppedClock([2e-6, -1e-6]), 1.8e9, 0.0, "it steps back"),
        (SteppedClock([0.0] * 99 + [0.0156]), 1.8e9, 0.0, "coarser than 0.001 s"),
        (SteppedClock([1e-6], late_s=0.3), 1.8e9, 0.0, "wakes up to 0.3 s late"),
        (SteppedClock([1e-6]), 12.0, 0.0, "the time of day is not set"),
        (SteppedClock([1e-6]), 1.8e9, -3600.0, "jumped by -3600.0 s"),
    ],
)
def test_clock(clock, wall_s, jump_s, cause):
    finding = clock_finding(clock, lambda: wall_s, jump_s)
    assert cause in finding.cause and finding.well == (not cause) and bool(finding.remedy) == bool(cause)


def test_in_real_time_a_jump_of_the_time_of_day_is_seen(tmp_path):
    """The host's clock is set forward by an hour while the bench is listened to."""
    began_s = time.time()
    _, found = examined(tmp_path, clock="real", wall=lambda: time.time() + 3600.0 * (time.time() > began_s + 1.0))
    assert "jumped by +3600.0 s" in found["clock"].cause
    # No device is told off for that hour; on a busy machine it may be late for reasons of its own.
    assert not any("3600" in found[name].cause for name in ("imet", "hyt", "stage"))
    assert "kB reach the disk in" in found["disk"].says


def test_disk_without_room_and_disk_that_cannot_be_written(tmp_path):
    steps = (Soak(), Record(1e12), Transfer(), Record(60.0))
    run = PlannedRun("0001", Air(20.0, 50.0), Air(30.0, 50.0), 6.0, steps)
    _, found = examined(tmp_path, protocol=Protocol("endless", "", (run,)))
    assert "MB free, the campaign needs" in found["disk"].cause and "free some space" in found["disk"].remedy
    with open_bench(default_bench()) as bench:
        *_, disk = examine(bench, load_protocol("quick"), Path("/proc/c"), wall=time.time)
    assert disk.device == "disk (/proc)" and not disk.well and "--out" in disk.remedy


def test_exit_status(tmp_path, capsys):
    bench = tmp_path / "bench.toml"
    bench.write_text(
        '[bench]\nname = "b"\n[sensors.hyt]\nkind = "hyt-271"\nbus = "/dev/i2c-nowhere"\n'
        '[sensors.imet]\nkind = "imet-xf"\nport = "/dev/ttyNowhere"\n'
        '[stage]\nkind = "manual"\n[reference]\nkind = "operator"\n'
    )
    assert main(["check", "--bench", str(bench), "--out", str(tmp_path / "c")]) == 1
    text = capsys.readouterr().out
    assert "\nnot ready, 2 faults: hyt (" in text and "/dev/i2c-nowhere" in text and "/dev/ttyNowhere" in text
    bench.write_text("[bench]\n")
    assert main(["check", "--bench", str(bench)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_check_finds_what_run_would_stumble_over(tmp_path, capsys):
    """A folder that is another campaign's or somebody's, a file, a plan beyond the chambers' limits."""
    out = tmp_path / "c"
    assert main(["run", "quick", "--out", str(out), "--seed", "1"]) == 0
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis/chapter1.tex").write_text("years of work")
    (tmp_path / "file").write_text("")
    capsys.readouterr()
    for arguments, words in (
        (["--out", str(out)], "was begun with the protocol 'quick' and another plan"),
        (["--out", str(tmp_path / "thesis")], "is neither empty nor a campaign"),
        (["--out", str(tmp_path / "file")], "is a file; give another --out"),
    ):
        assert main(["check", *arguments]) == 1
        said = capsys.readouterr().out
        assert "FAULT  plan (standard into " in said and words in said and "1 fault" in said
    for arguments in (["quick", "--out", str(out)], ["--out", str(tmp_path / "new")]):
        assert main(["check", *arguments]) == 0
        assert "ok     plan (" in capsys.readouterr().out
    assert (tmp_path / "thesis/chapter1.tex").read_text() == "years of work" and not (tmp_path / "new").exists()


def test_a_bench_file_names_the_lines_that_are_still_marked_set(tmp_path):
    bench = tmp_path / "bench.toml"
    bench.write_text('port = "x"\ndestination_mm = -10.0 # SET: its end\n# serial = "H0" # SET\n', encoding="utf-8")
    said = ready("quick", bench, Path("c"))
    assert said.startswith("ready, if destination_mm ") and said.endswith(f"shockrig run quick --bench {bench} --out c")
    bench.write_text("destination_mm = 300.0\n", encoding="utf-8")
    assert ready("quick", bench, Path("c")).startswith("ready: ")
    assert ready("my plan.toml", None, Path("c d")) == "ready: shockrig run 'my plan.toml' --out 'c d'"
    assert ready("quick", Path("manual"), Path()) == "ready: shockrig run quick --bench manual --out CAMPAIGN"


def test_check_reads_chambers_and_fan_and_holds_the_plan_against_their_limits(tmp_path, capsys):
    from test_chambers import bench_file

    assert main(["check", "--bench", str(bench_file(tmp_path)), "quick"]) == 0
    said = capsys.readouterr().out
    assert "source chamber (scpi on virtual)" in said and "temperature 20 degC, humidity 50 %RH" in said
    assert "fan (modbus on virtual)" in said and "airflow 5 m/s" in said
    bench = bench_file(tmp_path, "highest_c = 30.0")
    assert main(["check", "--bench", str(bench), "quick"]) == 1
    said = capsys.readouterr().out
    assert "run 0002: temperature 40 degC is beyond the source's limits (-40 to 30)" in said and "1 fault" in said


def test_a_probe_that_no_table_reads_is_called_by_the_makers_name(tmp_path):
    from emulated import Replay, memory_port

    from shockrig.rig.clock import VirtualClock
    from shockrig.rig.sensors.imet import Imet, ImetSettings

    clock = VirtualClock()
    tail = (0.05, b",6600\r\n")  # of a line that had begun before: of no id
    device = Replay([tail, *((0.1 * i, b"5,2000,6600\r\n2,2150\r\n99,1\r\n") for i in range(1, 200))])
    sensor = Imet("imet", ImetSettings(port="memory"), memory_port(device, clock), clock)
    bench = replace(fake_bench(clock=clock), sensors=[sensor], description={"imet": {}})
    found = examine(bench, plan(), tmp_path / "c", wall=lambda: 1.8e9)
    said = next(finding for finding in found if finding.device == "imet").says
    assert "lines of unknown id '2' (infrared thermometer), '99' (add them to lines)" in said
