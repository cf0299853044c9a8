"""A sample of the table of faults (benchmarks/faults_table.py runs all of it), and single promises of it."""

import os
import threading
import time

import pytest
from benchmark_scripts import benchmark
from fake_bench import between, fake_bench, plan, run, run_json

import shockrig.rig.journal
from shockrig.rig.journal import JournalWriter, read_journal
from shockrig.rig.recorder import read_state
from shockrig.rig.seams import Outcome

table = benchmark("faults_table")
TIMES_S = {}
SAMPLE = [
    ("hyt", "nack", "transfer", "spell"),
    ("hyt", "stuck_low", "transient", "blink"),
    ("hyt", "flip", "transient", "for good"),
    ("hyt", "command_mode", "transient", "blink"),
    ("imet", "doubled", "transient", "for good"),
    ("imet", "headless", "soak", "spell"),
    ("imet", "unplug", "transfer", "spell"),
    ("stage", "silence", "transfer", "spell"),
    ("stage", "unplug", "transfer", "blink"),
    ("stage", "alarm", "transfer", "blink"),
    ("stage", "stall", "transfer", "for good"),
    ("host", "disk_full", "end", "blink"),
    ("host", "disk_hangs", "transient", "spell"),
    ("host", "clock_step", "transient", "spell"),
    ("host", "sigint_twice", "transfer", "blink"),
    ("host", "sigterm", "soak", "blink"),
    ("host", "sigkill", "end", "blink"),
]


@pytest.mark.parametrize("case", SAMPLE, ids="-".join)
def test_a_fault_leads_to_what_is_promised(case):
    trial = table.Trial(*case)
    if not TIMES_S:
        TIMES_S.update(table.reference_times(1))
    result = table.attempt(trial, 1, TIMES_S)
    assert table.bad(trial, result) == [], result


def test_every_fault_that_can_be_ordered_has_a_promise():
    from shockrig.rig.virtual.faults import I2C_KINDS, SERIAL_KINDS

    assert set(table.I2C) == set(I2C_KINDS)
    assert set(table.IMET) | {"alarm", "stall"} == set(SERIAL_KINDS) == set(table.STAGE)


def test_a_value_that_the_world_never_gave_is_found():
    """The table's own measure can fail."""
    book = table.Book()
    book.note("bead", 10.0, 20.0)
    assert book.has("bead", 10.01, 20.004, 0.0051, 0.04)
    assert not book.has("bead", 10.01, 20.02, 0.0051, 0.04)
    assert not book.has("bead", 10.2, 20.0, 0.0051, 0.04)


def test_a_slow_disk_does_not_hold_up_the_sensors(tmp_path, monkeypatch):
    """Forced writes that end only when all lines of five seconds have come in."""
    all_came, waited = threading.Event(), []

    def slow(file):
        waited.append(all_came.wait(60.0))

    monkeypatch.setattr(shockrig.rig.journal.os, "fdatasync", slow)
    journal = JournalWriter(tmp_path / "j.log", sync_every_s=0.1)
    for i in range(50):
        journal.append(["record", i], now_s=0.1 * i)
    all_came.set()
    journal.close()
    assert waited and all(waited)
    assert len(read_journal(tmp_path / "j.log").records) == 50


def test_a_forced_write_that_fails_is_said_by_the_next_record(tmp_path, monkeypatch):

    def broken(file):
        raise OSError(5, os.strerror(5))

    monkeypatch.setattr(shockrig.rig.journal.os, "fdatasync", broken)
    journal = JournalWriter(tmp_path / "j.log", sync_every_s=0.0)
    journal.append(["one"], 0.0)
    with pytest.raises(OSError, match="Input/output error"):
        for i in range(6000):  # the disk has a thread of its own
            journal.append(["two"], 1.0 + i)
            time.sleep(0.01)


def test_a_sensor_that_gives_one_reading_in_ten_is_not_a_slow_sensor(tmp_path):
    """Random survivors of a bad cable: neither their median gap nor their number is the sensor's own rate."""
    path = tmp_path / "campaign"
    bad_cable = lambda now: "silent" if 45.0 < now < 90.0 and hash(round(now * 10) * 7919) % 11 > 1 else None  # noqa: E731
    run(fake_bench(imet_fault=bad_cable), path, plan(2))
    assert any("imet" in aside.reason for aside in read_state(path).set_aside)


def test_status_says_what_was_spoilt_and_why_and_that_it_was_recorded_since(tmp_path, capsys):
    from shockrig.protocols.cli import main

    path = tmp_path / "campaign"
    run(fake_bench(hyt_fault=between(60.0, 63.0, Outcome.NOT_ACKNOWLEDGED)), path)
    assert main(["status", str(path)]) == 0
    said = capsys.readouterr().out
    assert "2 runs recorded of 2 planned" in said and "missing" not in said
    assert "spoilt (hyt gave no good reading for 3." in said and "recorded since" in said
    (aside,) = read_state(path).set_aside
    (path / "runs" / aside.id).rename(tmp_path / "gone")
    main(["status", str(path)])
    said = capsys.readouterr().out
    assert f"missing: {aside.id}" in said and "still missing" in said
    assert run_json(path, "0002" if aside.id == "0001" else "0001")["status"] == "complete"
