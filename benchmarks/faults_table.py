"""Every fault at every stage of a run, on the virtual clock: nothing lost, nothing invented, never hung, as promised.

    python benchmarks/faults_table.py [--seed N] [--only KIND]

A campaign of two short runs is recorded through the real drivers with one fault in it (a blink, a spell of 4 s, or for
good), at one of four stages of its first run. Then the fault is taken away and the same command is given again. The
world's own book of what it gave to the chips is the truth that recorded values are held against.
"""

from __future__ import annotations

import argparse
import bisect
import contextlib
import errno
import math
import os
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

import numpy as np

import shockrig.files.campaign_write
import shockrig.rig.journal
import shockrig.rig.recorder.run_journal
import shockrig.rig.virtual.world
from shockrig.rig.bench import virtual_bench
from shockrig.rig.bench_errors import RigError
from shockrig.rig.observer import SilentObserver
from shockrig.rig.protocol import PlannedRun, Protocol, Record, Soak, Transfer
from shockrig.rig.recorder import read_run, read_state
from shockrig.rig.recorder.run_journal import JOURNAL
from shockrig.rig.runner import record_campaign
from shockrig.rig.seams import Air
from shockrig.rig.virtual.faults import I2C_KINDS, SERIAL_KINDS, Fault
from shockrig.rig.virtual.truth import Hidden, draw_truth, with_effects

STAGES = ("soak", "transfer", "transient", "end")
LENGTHS_S = {"blink": 0.15, "spell": 4.0, "for good": math.inf}
HUNG_S = 60  # of the host: a campaign takes one second or less
STEPS = (
    Soak(over_s=3, at_most_s=40, probes_within_k=1.0, probes_within_percent=2.0),
    Record(4),
    Transfer(5),
    Record(8),
)
PLAN = Protocol(
    "faults",
    "",
    tuple(
        PlannedRun(f"{i:04d}", source, destination, 6.0, STEPS)
        for i, (source, destination) in enumerate(
            ((Air(20.0, 40.0), Air(25.0, 50.0)), (Air(25.0, 50.0), Air(20.0, 40.0))), 1
        )
    ),
)
LONGEST_BENCH_S = 1000.0  # the plan with all its repeats and every deadline reached

SURVIVED, REPEATED, PAUSED, INTERRUPTED = "survived", "repeated", "paused", "interrupted"
FINE = (SURVIVED,)
SPOILS = (REPEATED,)
MAY_SPOIL = (SURVIVED, REPEATED)
STOPS = (PAUSED,)
MAY_STOP = (SURVIVED, REPEATED, PAUSED)
# A fault -> what a blink, a spell and a lasting one must lead to, at each stage. A soak just takes longer by a spell,
# and of one at the end of a run hardly anything falls into the run.
SPELL = {"soak": FINE, "transfer": SPOILS, "transient": SPOILS, "end": FINE}
SENSOR = {"blink": FINE, "spell": SPELL, "for good": STOPS}
HARMLESS = {"blink": FINE, "spell": FINE, "for good": FINE}
LOSSY = ("half_line", "headless", "garbage")
I2C = {
    **{kind: SENSOR for kind in I2C_KINDS},
    "command_mode": {"blink": FINE},  # left again by the driver
}
IMET = {
    **{kind: SENSOR for kind in SERIAL_KINDS if kind not in ("alarm", "stall")},
    # some lines get through whole, so that the soak may end, and the run may hold enough of them
    **{kind: {"blink": FINE, "spell": {**SPELL, "soak": MAY_SPOIL}, "for good": MAY_STOP} for kind in LOSSY},
    "doubled": HARMLESS,  # the repeat is rejected
    "nul": HARMLESS,  # dropped
    "flip": {
        "blink": FINE,
        "spell": MAY_SPOIL,
        "for good": MAY_STOP,
    },  # half of the lines break, half pass (no checksum)
}
# The stage is only listened to while it moves: elsewhere a passing fault of its line is never noticed.
PASSES = {"blink": MAY_SPOIL, "spell": MAY_SPOIL, "for good": MAY_STOP}
STAGE = {
    **{kind: PASSES for kind in SERIAL_KINDS},
    "silence": {"blink": MAY_SPOIL, "spell": MAY_SPOIL, "for good": STOPS},
    "unplug": {"blink": MAY_SPOIL, "spell": MAY_SPOIL, "for good": STOPS},
    "stall": {"blink": MAY_SPOIL, "spell": MAY_SPOIL, "for good": STOPS},
    "alarm": {"blink": STOPS},  # a person must look, then start again, which homes it
}
HOST = {
    "clock_step": HARMLESS,
    "suspend": {"spell": MAY_SPOIL},
    "slow_disk": {"blink": FINE, "spell": FINE, "for good": FINE},
    "disk_hangs": {"spell": MAY_SPOIL},
    "disk_full": {"blink": (PAUSED,), "for good": (PAUSED,)},
    "sigint": {"blink": (INTERRUPTED,)},
    "sigint_twice": {"blink": (INTERRUPTED,)},
    "sigterm": {"blink": (INTERRUPTED,)},
    "sigkill": {"blink": (INTERRUPTED,)},
}
PROMISES = {"hyt": I2C, "imet": IMET, "stage": STAGE, "host": HOST}


@dataclass(frozen=True)
class Trial:
    """One fault: where, what, when and for how long."""

    part: str
    kind: str
    stage: str
    length: str


@dataclass
class Result:
    """What came of one trial."""

    outcome: str = ""
    message: str = ""
    lost: int = 0
    invented: int = 0
    readings: int = 0
    hung: bool = False
    safe: bool = True
    resumed: bool = False
    notes: list[str] = field(default_factory=list)


def trials(only: str = "") -> list[Trial]:
    return [
        Trial(part, kind, stage, length)
        for part, kinds in PROMISES.items()
        for kind, promises in kinds.items()
        if only in ("", kind, part)
        for length in promises
        for stage in STAGES
    ]


def bad(trial: Trial, result: Result) -> list[str]:
    """What of the promise was not kept; empty where all was."""
    allowed = PROMISES[trial.part][trial.kind][trial.length]
    if isinstance(allowed, dict):
        allowed = allowed[trial.stage]
    wrong = [] if result.outcome in allowed else [f"{result.outcome}, promised {' or '.join(allowed)}"]
    # A line has no checksum: what a damaged digit says cannot be told from a measurement.
    may_lie = trial.part == "imet" and trial.kind in ("flip", "headless", "half_line", "garbage")
    if result.invented and not may_lie:
        wrong.append(f"{result.invented} invented")
    for name in ("lost", "hung"):
        if getattr(result, name):
            wrong.append(f"{name} {getattr(result, name)}")
    if not result.safe:
        wrong.append("not safe, and not said")
    if not result.resumed:
        wrong.append("not resumed")
    if result.outcome == PAUSED and len(result.message) < 30:
        wrong.append(f"no clear message: {result.message!r}")
    return wrong + result.notes


class Book:
    """What the world gave to the chips, by quantity, in order of time."""

    def __init__(self) -> None:
        self.given: dict[str, list[tuple[float, float]]] = {"bead": [], "film": [], "die": []}

    def world(self) -> type:
        book = self

        class Seen(shockrig.rig.virtual.world.World):
            def bead_temperature_c(self, at_s: float) -> float:
                return book.note("bead", at_s, super().bead_temperature_c(at_s))

            def film_humidity_percent(self, at_s: float) -> float:
                return book.note("film", at_s, super().film_humidity_percent(at_s))

            def die_temperature_c(self, at_s: float) -> float:
                return book.note("die", at_s, super().die_temperature_c(at_s))

        return Seen

    def note(self, quantity: str, at_s: float, value: float) -> float:
        bisect.insort(self.given[quantity], (at_s, value))
        return value

    def has(self, quantity: str, at_s: float, value: float, half_step: float, within_s: float) -> bool:
        """Whether the chip was given such a value at about that time."""
        given = self.given[quantity]
        first = bisect.bisect_left(given, (at_s - within_s,))
        for time_s, true in given[first:]:
            if time_s > at_s + within_s:
                return False
            if abs(value - true) <= half_step:
                return True
        return False


def check_files(path: Path, book: Book, handed: Counter, result: Result) -> None:
    """Hold every journal and CSV row against the world's book; count what was handed over and is not there."""
    found: Counter = Counter()
    for journal in sorted(path.glob("*/*/" + JOURNAL)):
        record = read_run(journal.parent)
        for readings in record.readings.values():
            found.update((r.sensor, r.requested_s, r.outcome.value) for r in readings)
        for name, quantity, column, half_step in (
            ("imet.csv", "bead", 1, 0.0051),
            ("hyt.csv", "film", 1, 0.0032),
            ("hyt.csv", "die", 2, 0.0052),
        ):
            file = journal.parent / name
            if not file.exists():
                continue
            times_s = []
            for line in file.read_text().splitlines()[1:]:
                cells = line.split(",")
                result.readings += 1
                times_s.append(float(cells[0]))
                late = cells[-1] == "1" and name == "hyt.csv"  # a stale value is true, but of any time before
                at_s = times_s[-1] + record.zero_s
                if not book.has(quantity, at_s, float(cells[column]), half_step, math.inf if late else 0.04):
                    result.invented += 1
            if times_s != sorted(times_s):
                result.notes.append(f"{file.parent.name}/{name}: time goes back")
    result.lost = sum((handed - found).values())


def reference_times(seed: int) -> dict[str, float]:
    """When the stages of the first run are, on the bench clock, where nothing goes wrong."""
    with tempfile.TemporaryDirectory() as folder, _bench(seed, Book(), None) as bench:
        path = Path(folder) / "c"
        record_campaign(bench, PLAN, path, utc=_utc, sync_every_s=None)
        record = read_run(path / "runs" / "0001")
    assert record.move is not None and record.zero_s is not None
    return {
        "soak": record.zero_s - 2.0,
        "transfer": record.move.start_s + 0.1,
        "transient": record.move.end_s + 0.5,
        "end": record.last_s - 0.2,
    }


def _utc() -> str:
    return "2026-01-01T00:00:00Z"


def _bench(seed: int, book: Book, faults: dict | None):
    truth = draw_truth(np.random.default_rng(seed))
    truth = with_effects(truth, [Hidden("finite_transfer", {"duration_s": 0.4})])
    with mock.patch("shockrig.rig.virtual.world.World", book.world()):
        return virtual_bench(truth, seed, faults=faults)


class _Disk:
    """Stands in for `os` in the journal: the disk as the fault wants it."""

    def __init__(self, write: Callable[[int, bytes], int]) -> None:
        self.write = write

    def __getattr__(self, name: str):
        return getattr(os, name)


@contextlib.contextmanager
def _host_fault(kind: str, bench, start_s: float, end_s: float) -> Iterator[Callable[[], str]]:
    """Inject a fault of the host; yields the time of day that the recording is to use."""
    clock = bench.clock
    plain = type(clock).sleep_until
    actions: list[tuple[float, Callable[[], None]]] = []
    during = lambda: start_s <= clock.now() < end_s  # noqa: E731
    patches = contextlib.ExitStack()
    utc = _utc

    def advance(by_s: float) -> None:
        plain(clock, clock.now() + by_s)

    def send(number: int) -> Callable[[], None]:
        return lambda: os.kill(os.getpid(), number)

    if kind == "clock_step":
        utc = lambda: "2025-12-31T23:00:00Z" if during() else _utc()  # noqa: E731
        step = lambda: 1e9 if during() else 2e9  # noqa: E731
        patches.enter_context(mock.patch("time.time", step))
    elif kind == "suspend":
        actions.append((start_s, lambda: advance(end_s - start_s)))
    elif kind == "slow_disk":
        patches.enter_context(
            mock.patch.object(shockrig.rig.journal, "os", _Disk(lambda f, d: _slow(f, d, during, advance)))
        )
    elif kind == "disk_hangs":
        hangs = [end_s - start_s]
        write = lambda f, d: (advance(hangs.pop()) if hangs and during() else None, os.write(f, d))[1]  # noqa: E731
        patches.enter_context(mock.patch.object(shockrig.rig.journal, "os", _Disk(write)))
    elif kind == "disk_full":
        write_whole = shockrig.files.campaign_write.write_whole

        def full(*arguments, **options):
            if during():
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return write_whole(*arguments, **options)

        def write(file: int, data: bytes) -> int:
            if during():
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return os.write(file, data)

        patches.enter_context(mock.patch.object(shockrig.rig.journal, "os", _Disk(write)))
        patches.enter_context(mock.patch.object(shockrig.files.campaign_write, "write_whole", full))
    elif kind.startswith("sig"):
        number = getattr(signal, kind.split("_")[0].upper())
        actions.append((start_s, send(number)))
        if kind.endswith("twice"):
            actions.append((start_s + 1e-6, send(number)))

    def sleep_until(time_s: float) -> None:
        plain(clock, time_s)
        while actions and clock.now() >= actions[0][0]:
            actions.pop(0)[1]()

    clock.sleep_until = sleep_until
    with patches:
        yield utc


def _slow(file: int, data: bytes, during: Callable[[], bool], advance: Callable[[float], None]) -> int:
    if during():
        advance(0.005)  # each record
    return os.write(file, data)


def attempt(trial: Trial, seed: int, times_s: dict[str, float]) -> Result:
    """Record with the fault, judge, take the fault away, go on."""
    result, book, handed, said = Result(), Book(), Counter(), []
    start_s = times_s[trial.stage]
    end_s = start_s + LENGTHS_S[trial.length]
    faults = {} if trial.part == "host" else {trial.part: [Fault(trial.kind, start_s, end_s)]}
    plain_reading = shockrig.rig.recorder.run_journal.Recorder.reading

    def reading(recorder, one) -> None:
        plain_reading(recorder, one)
        handed[one.sensor, round(one.requested_s, 6), one.outcome.value] += 1

    observer = SilentObserver()
    observer.say = said.append
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "c"
        if trial.kind == "sigkill":
            _killed(trial, seed, start_s, path, result)
        else:
            with (
                _bench(seed, book, faults) as bench,
                mock.patch.object(shockrig.rig.recorder.run_journal.Recorder, "reading", reading),
            ):
                fault = trial.kind if trial.part == "host" else ""
                with _host_fault(fault, bench, start_s, end_s) as utc, _time_limit(result):
                    _record(bench, path, utc, observer, result)
                carriage = bench.instruments.parts["stage"]
                moving = carriage._state_at(bench.clock.now()) == "Run"
                result.safe = not moving or any("MAY NOT BE SAFE" in text for text in said)
                if bench.clock.now() > LONGEST_BENCH_S:
                    result.hung = True
            check_files(path, book, handed, result)
        result.outcome = result.outcome or (REPEATED if read_state(path).set_aside else SURVIVED)
        if result.outcome == REPEATED and not all(
            a.status == "spoilt" and a.reason for a in read_state(path).set_aside
        ):
            result.notes.append("a spoilt attempt is not marked")
        with _bench(seed + 1, Book(), None) as bench:
            record_campaign(bench, PLAN, path, utc=_utc, sync_every_s=None)
        state = read_state(path)
        result.resumed = state.missing == () and not state.in_progress and len(state.recorded) == len(PLAN.runs)
    return result


def _record(bench, path: Path, utc, observer, result: Result) -> None:
    try:
        record_campaign(bench, PLAN, path, utc=utc, observer=observer, sync_every_s=None)
    except RigError as error:
        result.outcome, result.message = PAUSED, str(error)
    except (KeyboardInterrupt, SystemExit):
        result.outcome = INTERRUPTED
    except _Hung:
        result.hung, result.outcome = True, "hung"


def _killed(trial: Trial, seed: int, start_s: float, path: Path, result: Result) -> None:
    """A child process records and is killed; every whole record must be there."""
    child = os.fork()
    if child == 0:
        try:
            with _bench(seed, Book(), None) as bench, _host_fault("sigkill", bench, start_s, math.inf):
                record_campaign(bench, PLAN, path, utc=_utc, sync_every_s=None)
        finally:
            os._exit(0)
    _, status = os.waitpid(child, 0)
    result.outcome = INTERRUPTED if os.WTERMSIG(status) == signal.SIGKILL else f"status {status}"
    for journal in path.glob("recording/*/" + JOURNAL):
        whole = shockrig.rig.journal.read_journal(journal)
        result.lost += journal.read_bytes().count(b"\n") - len(whole.records)
        result.readings += len(whole.records)


class _Hung(Exception):
    pass


@contextlib.contextmanager
def _time_limit(result: Result) -> Iterator[None]:
    def ring(number, frame):
        raise _Hung

    def end(number, frame):
        raise SystemExit(128 + number)  # as protocols/commands/run.py has it

    before = signal.signal(signal.SIGALRM, ring), signal.signal(signal.SIGTERM, end)
    signal.alarm(HUNG_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before[0])
        signal.signal(signal.SIGTERM, before[1])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="a part or a kind")
    args = parser.parse_args()
    times_s = reference_times(args.seed)
    rows: dict[tuple[str, str, str], list[tuple[Trial, Result]]] = {}
    broken = 0
    for trial in trials(args.only):
        result = attempt(trial, args.seed, times_s)
        rows.setdefault((trial.part, trial.kind, trial.length), []).append((trial, result))
        if wrong := bad(trial, result):
            broken += 1
            print(f"BROKEN {trial}: {'; '.join(wrong)} [{result.message}]", flush=True)
    print(f"{'part':6} {'fault':13} {'for':9} " + " ".join(f"{stage:11}" for stage in STAGES) + " lost altered hung")
    for (part, kind, length), tried in rows.items():
        cells = " ".join(f"{result.outcome:11}" for _, result in tried)
        lost, altered = sum(r.lost for _, r in tried), sum(r.invented for _, r in tried)
        print(f"{part:6} {kind:13} {length:9} {cells} {lost:4} {altered:7} {sum(r.hung for _, r in tried):4}")
    count = sum(len(tried) for tried in rows.values())
    total = sum(r.readings for tried in rows.values() for _, r in tried)
    print(
        f"{count} trials, seed {args.seed}: {count - broken} as promised, {broken} not; {total} recorded values checked"
    )
    messages = Counter(r.message[:150] for tried in rows.values() for _, r in tried if r.message)
    print("\nWhat a paused campaign says:")
    for message, times in messages.most_common():
        print(f"{times:4} {message}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
