"""Recordings killed with SIGKILL at random moments: every whole record is there, and every campaign goes on.

    python benchmarks/kill_recordings.py [--count 200] [--seed 0]

A child process records on the virtual bench, through the real drivers, as fast as it can, and notes in shared memory
how many records it has handed to the journal. The parent kills it at a seeded moment, reads what is there, and records
the rest.
"""

from __future__ import annotations

import argparse
import mmap
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import shockrig.rig.journal
from shockrig.rig.bench import virtual_bench
from shockrig.rig.journal import read_journal
from shockrig.rig.protocol import PlannedRun, Protocol, Record, Soak, Transfer
from shockrig.rig.recorder import read_run, read_state
from shockrig.rig.recorder.run_journal import JOURNAL
from shockrig.rig.runner import record_campaign
from shockrig.rig.seams import Air

STEPS = (
    Soak(over_s=3, at_most_s=60, probes_within_k=1.0, probes_within_percent=2.0),
    Record(3),
    Transfer(5),
    Record(8),
)
AIRS = Air(20.0, 40.0), Air(25.0, 50.0)
PLAN = Protocol(
    "kill", "", tuple(PlannedRun(f"{i + 1:04d}", AIRS[i % 2], AIRS[1 - i % 2], 6.0, STEPS) for i in range(3))
)
COUNT_BYTES = 8


def record(path: Path, seed: int) -> list[str]:
    with virtual_bench(seed=seed) as bench:
        return record_campaign(bench, PLAN, path, utc=lambda: "2026-01-01T00:00:00Z", sync_every_s=None)


def record_counted(path: Path, seed: int, book: mmap.mmap) -> None:
    """Record, and count in shared memory each record that the journal has taken."""
    append = shockrig.rig.journal.JournalWriter.append

    def counted(self, entry, now_s):
        append(self, entry, now_s)
        book[:COUNT_BYTES] = (int.from_bytes(book[:COUNT_BYTES], "little") + 1).to_bytes(COUNT_BYTES, "little")

    shockrig.rig.journal.JournalWriter.append = counted
    record(path, seed)


def kill_one(path: Path, seed: int, longest_s: float) -> tuple[Counter, list[str]]:
    """Record, kill, look, resume; what was seen, and what was wrong."""
    book = mmap.mmap(-1, COUNT_BYTES)
    child = os.fork()
    if child == 0:
        code = 1
        try:
            record_counted(path, seed, book)
            code = 0
        finally:
            os._exit(code)
    time.sleep(random.Random(seed).uniform(0.0, longest_s))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    handed = int.from_bytes(book[:COUNT_BYTES], "little")
    seen, wrong = Counter(), []
    found = 0
    for journal in path.glob("*/*/" + JOURNAL):
        whole = read_journal(journal)
        found += len(whole.records)
        seen["torn"] += whole.torn_bytes > 0
        if whole.damaged_lines or len(whole.records) != journal.read_bytes().count(b"\n"):
            wrong.append(f"{journal}: {whole.damaged_lines} damaged records")
    # the one that was taken but not counted yet, where the kill fell between the two
    if not handed <= found <= handed + 1:
        wrong.append(f"{handed} records handed over, {found} found")
    seen["records"] += found
    seen["before the campaign"] += not (path / "campaign.json").exists()
    seen["in a run"] += any(path.glob("recording/*/" + JOURNAL))
    before = set(read_state(path).recorded) if (path / "campaign.json").exists() else set()
    seen["at the end"] += len(before) == len(PLAN.runs)
    kept = {id_: (path / "runs" / id_ / JOURNAL).read_bytes() for id_ in before}
    record(path, seed + 1)
    state = read_state(path)
    if state.missing or state.in_progress or len(state.recorded) != len(PLAN.runs):
        wrong.append(f"not resumed: {state}")
    if any(read_run(path / "runs" / id_).status != "complete" for id_ in state.recorded):
        wrong.append("a run that counts is not complete")
    if any((path / "runs" / id_ / JOURNAL).read_bytes() != content for id_, content in kept.items()):
        wrong.append("a run that was whole was touched")
    if any(aside.status != "interrupted" for aside in state.set_aside) or len(state.set_aside) > 1:
        wrong.append("the interrupted attempt is not marked")
    seen["set aside"] += len(state.set_aside)
    return seen, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        began_s = time.monotonic()
        record(Path(folder) / "whole", args.seed)
        longest_s = time.monotonic() - began_s
        began_s = time.monotonic()
        record(Path(folder) / "again", args.seed)  # the first one has imported everything
        longest_s = min(longest_s, time.monotonic() - began_s)
        total, broken = Counter(), 0
        for number in range(args.count):
            seen, wrong = kill_one(Path(folder) / str(number), args.seed + number, 1.1 * longest_s)
            total += seen
            if wrong:
                broken += 1
                print(f"seed {args.seed + number}: {'; '.join(wrong)}", flush=True)
    print(
        f"{args.count} recordings killed at 0 to {1.1 * longest_s:.2f} s, "
        f"seeds {args.seed} to {args.seed + args.count - 1}"
    )
    print(f"  killed in a run            {total['in a run']}")
    print(f"  killed before the campaign {total['before the campaign']}")
    print(f"  killed after its end       {total['at the end']}")
    print(f"  journals with a torn tail  {total['torn']}")
    print(f"  records on disk            {total['records']}, every one that was handed over")
    print(f"  attempts set aside, marked {total['set aside']}")
    print(f"  resumed, whole             {args.count - broken} of {args.count}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
