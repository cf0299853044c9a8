"""What must hold of recordings: whatever kills them, every whole record is there, nothing is invented, they go on."""

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fake_bench import csv, fake_bench, plan, run, run_json
from hypothesis import given, settings
from hypothesis import strategies as st
from processes import ended, wait_for

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.journal import JournalWriter, read_journal
from shockrig.rig.recorder import read_run, read_state
from shockrig.rig.recorder.run_journal import JOURNAL

values = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text()
records = st.lists(st.lists(values, min_size=1, max_size=5), min_size=1, max_size=8)


def written(path: Path, content) -> bytes:
    path.unlink(missing_ok=True)
    journal = JournalWriter(path, sync_every_s=None)
    for record in content:
        journal.append(record, 0.0)
    journal.close()
    return path.read_bytes()


@settings(max_examples=50, deadline=None)
@given(content=records, share=st.floats(0, 1))
def test_a_journal_cut_at_any_byte_gives_every_whole_record(tmp_path_factory, content, share):
    path = tmp_path_factory.getbasetemp() / "cut.log"
    whole = written(path, content)
    cut = int(share * len(whole))
    path.write_bytes(whole[:cut])
    journal = read_journal(path)
    complete = whole[:cut].count(b"\n")
    assert list(journal.records) == content[:complete]
    assert journal.damaged_lines == 0
    assert journal.torn_bytes == cut - (whole[:cut].rfind(b"\n") + 1)


@settings(max_examples=50, deadline=None)
@given(content=records, at=st.integers(0, 10**6), flip=st.integers(1, 255))
def test_a_flipped_byte_loses_its_own_record_and_no_other(tmp_path_factory, content, at, flip):
    path = tmp_path_factory.getbasetemp() / "flipped.log"
    content = [[number, *record] for number, record in enumerate(content)]
    whole = bytearray(written(path, content))
    at %= len(whole)
    hit = bytes(whole[:at]).count(b"\n")
    whole[at] ^= flip
    path.write_bytes(whole)
    found = list(read_journal(path).records)
    # A flipped line feed joins two lines, so that the next record may go as well; nothing new may come.
    lost = {hit, hit + 1} if whole[at] ^ flip == 0x0A else {hit}
    assert [record for record in found if record[0] not in lost] == [r for r in content if r[0] not in lost]
    assert all(record in content for record in found)


def test_a_journal_is_never_overwritten(tmp_path):
    written(tmp_path / "j.log", [["one"]])
    with pytest.raises(FileExistsError):
        JournalWriter(tmp_path / "j.log")


def test_raw_bytes_and_every_outcome_are_kept(tmp_path):
    from shockrig.rig.seams import Outcome

    every = [o for o in Outcome if o is not Outcome.OK]
    fault = lambda now: every[int(now * 10) // 37 % len(every)] if int(now * 10) % 37 == 0 else None  # noqa: E731
    run(fake_bench(hyt_fault=fault), tmp_path / "c", plan(2))
    record = read_run(tmp_path / "c" / "runs" / "0001")
    assert {reading.outcome for reading in record.readings["hyt"]} == set(Outcome)
    assert all(reading.raw == b"\x1f\x6d" for reading in record.readings["hyt"])


def test_a_recovered_run_is_the_run_up_to_the_cut(tmp_path):
    """The journal of a whole run, cut anywhere, gives CSV rows that are a prefix of the whole run's, byte for byte."""
    run(fake_bench(), tmp_path / "whole", plan(1))
    journal = (tmp_path / "whole/runs/0001" / JOURNAL).read_bytes()
    rng = random.Random(7)
    for number, cut in enumerate(sorted(rng.randrange(len(journal)) for _ in range(12))):
        path = tmp_path / f"cut{number}"
        (path / "recording/0001").mkdir(parents=True)
        (path / "campaign.json").write_bytes((tmp_path / "whole/campaign.json").read_bytes())
        (path / "recording/0001" / JOURNAL).write_bytes(journal[:cut])
        assert run(fake_bench(), path, plan(1)) == ["0001"]
        (aside,) = read_state(path).set_aside
        assert aside.status == "interrupted"
        for name in ("imet.csv", "hyt.csv"):
            whole = (tmp_path / "whole/runs/0001" / name).read_bytes()
            part = aside.folder / name
            assert not part.exists() or whole.startswith(part.read_bytes())


def test_a_run_cut_off_after_its_last_record_counts(tmp_path):
    """Killed between the journal's end and the rename: the run is whole, and is not recorded twice."""
    run(fake_bench(), tmp_path / "whole", plan(2))
    path = tmp_path / "whole"
    before = run_json(path, "0002")
    (path / "recording").mkdir()
    (path / "runs/0002").rename(path / "recording/0002")
    for name in ("run.json", "imet.csv"):
        (path / "recording/0002" / name).unlink()
    bench = fake_bench()
    assert run(bench, path, plan(2)) == [] and bench.stage.log == []
    assert run_json(path, "0002") == before and len(csv(path / "runs/0002/imet.csv")["time_s"]) > 200


@pytest.mark.parametrize("torn", [None, b"", b'0badc0de ["run",'])
def test_a_run_killed_before_its_first_record_leaves_no_trace(tmp_path, torn):
    path = tmp_path / "campaign"
    run(fake_bench(), path, plan(1))
    (path / "recording/0002").mkdir(parents=True)
    if torn is not None:
        (path / "recording/0002" / JOURNAL).write_bytes(torn)
    assert run(fake_bench(), path, plan(2)) == ["0002"]
    assert not read_state(path).set_aside


def test_a_journal_that_is_something_else_is_refused(tmp_path):
    (tmp_path / JOURNAL).write_bytes(b"hello\n\xff\x00\n")
    with pytest.raises(BenchError, match="nothing can be recovered"):
        read_run(tmp_path)


def start(path: Path, **options) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, str(Path(__file__).parents[1] / "recording_process.py"), str(path)],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def wait_for_recording(path: Path, process: subprocess.Popen) -> None:
    wait_for(lambda: list(path.glob("recording/*/journal.log")), process)


def sound(path: Path, ids: list[str]) -> None:
    """Every run that counts is whole, and whatever does not count is marked."""
    state = read_state(path)
    assert not state.in_progress
    for id_ in state.recorded:
        record = read_run(path / "runs" / id_)
        assert record.status == "complete" and record.damage == ""
        assert run_json(path, id_)["status"] == "complete"
        assert len(csv(path / "runs" / id_ / "hyt.csv")["time_s"]) > 200
    assert all(aside.status == "interrupted" for aside in state.set_aside)
    assert list(state.recorded) == ids


@pytest.mark.parametrize("seed", range(3))
def test_kill_9_at_any_moment_loses_no_whole_record_and_the_campaign_goes_on(tmp_path, seed):
    path, rng = tmp_path / "campaign", random.Random(seed)
    process = start(path)
    wait_for_recording(path, process)
    time.sleep(rng.uniform(0.0, 0.8))
    process.kill()
    process.communicate()
    unfinished = list(path.glob("recording/*"))
    assert len(unfinished) <= 1
    for folder in unfinished:
        if not (folder / JOURNAL).exists():
            continue  # killed before the first record
        journal = read_journal(folder / JOURNAL)
        assert journal.damaged_lines == 0  # at most the record being written is torn, and that at the end
        content = (folder / JOURNAL).read_bytes()
        assert len(journal.records) == content.count(b"\n")
    done = len(read_state(path).recorded)
    some = plan(min(done + 2, 40))
    more = some.runs[done:]
    head = json.loads((path / "campaign.json").read_text())
    head["plan"] = head["plan"][: len(some.runs)]  # the rest of the forty would only take time
    (path / "campaign.json").write_text(json.dumps(head))
    recovered = run(fake_bench(), path, some)
    assert recovered == [r.id for r in more][len(more) - len(recovered) :] and len(more) - len(recovered) <= 1
    sound(path, [r.id for r in some.runs])


def test_a_recording_killed_while_it_made_its_campaign_goes_on(tmp_path):
    path = tmp_path / "campaign"
    path.mkdir()
    (path / "campaign.json.part").write_text('{"format": "shock-ca')
    some = plan(1)
    assert run(fake_bench(), path, some) == [r.id for r in some.runs]
    assert sorted(p.name for p in path.iterdir() if p.name.endswith(".part")) == []


@pytest.mark.elsewhere
def test_an_interrupted_process_leaves_everything_in_order(tmp_path):
    path = tmp_path / "campaign"
    process = start(path)
    wait_for_recording(path, process)
    time.sleep(0.3)
    ended(process, signal.SIGINT)
    state = read_state(path)
    assert process.returncode != 0 and not state.in_progress
    assert len(state.set_aside) <= 1
    sound(path, list(state.recorded))


def test_a_disk_quota_ends_with_a_clear_message_and_a_readable_journal(tmp_path):
    """A real limit on file size (EFBIG is what a quota within a file looks like) instead of a full disk."""
    path = tmp_path / "campaign"
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))  # noqa: E731
    process = start(path, preexec_fn=limit)
    _, errors = ended(process)
    assert process.returncode != 0
    assert "RecordingError" in errors and "the disk is full" in errors and "free some space" in errors
    (folder,) = path.glob("recording/*")
    journal = read_journal(folder / JOURNAL)
    assert len(journal.records) > 100 and (folder / JOURNAL).stat().st_size == 20_000


@pytest.mark.parametrize("share", [1.0, 0.7])
def test_a_journal_copied_behind_itself_is_the_run_once(tmp_path, share):
    """`cat journal journal`, of a run that was whole and of one cut off: times would go back."""
    run(fake_bench(), tmp_path / "c", plan(1))
    journal = tmp_path / "c/runs/0001" / JOURNAL
    lines = journal.read_bytes().splitlines(keepends=True)
    content = b"".join(lines[: int(share * len(lines))])
    journal.write_bytes(content)
    once = read_run(journal.parent)
    journal.write_bytes(2 * content)
    assert read_run(journal.parent) == once
