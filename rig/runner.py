"""Runs a protocol on a bench, run by run and step by step.

A run is soak, record, transfer, record (rig.protocol); an attempt ends as complete, spoilt (faults: repeated up to the
protocol's limit) or interrupted (Ctrl-C or failure: kept aside, run again from its soak when the campaign goes on).
"""

from __future__ import annotations

import math
import signal
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shockrig.rig.bench import Bench
from shockrig.rig.bench_errors import (
    CampaignPaused,
    RunDecision,
    RunRepeated,
    RunSkipped,
)
from shockrig.rig.listening import Listener
from shockrig.rig.observer import Observer, SilentObserver
from shockrig.rig.planning import off_plan
from shockrig.rig.protocol import PlannedRun, Protocol, Record, Soak, Transfer
from shockrig.rig.recorder import CampaignFolder, Recorder, RecordingError, RunRecord
from shockrig.rig.recorder.run_journal import COMPLETE, INTERRUPTED, SPOILT
from shockrig.rig.requests import Inbox, decided
from shockrig.rig.seams import Air
from shockrig.rig.soak import unsettled

REPEAT_AFTER_S = 5.0  # times the attempt: what spoilt a run may pass by itself (a plug, a reset), but not at once
AIR_EVERY_S = 1.0
PHASE_S = (5.0 + 5.0**0.5) / 20.0  # from run to run: modulo 0.1 s the golden ratio of it, which spreads most evenly
AIR_MEAN_S = 10.0  # the airs are averaged over the last seconds before the transfer and before the end
More = Callable[[str | None, float], Protocol | None]
INVENTED = "emulated instruments: what is recorded now is invented by the virtual bench, not measured"


class _Spoilt(Exception):
    """This attempt will not become a run; the reason goes into its journal."""


def record_campaign(
    bench: Bench,
    protocol: Protocol,
    path: Path,
    *,
    utc: Callable[[], str],
    observer: Observer | None = None,
    sync_every_s: float | None = 1.0,
    session: Mapping[str, Any] | None = None,
    more: More | None = None,
) -> list[str]:
    """Record the runs of a protocol that a campaign folder does not hold yet.

    On any way out, Ctrl-C and failure included, the bench is made safe first and the attempt's recording is kept.

    Parameters
    ----------
    bench : Bench
        Not yet opened; it is closed by its own context manager, not here.
    path : Path
        Campaign folder: new, or begun by the same protocol on the same sensors.
    utc : callable
        Time of day as ISO 8601 text.
    sync_every_s : float or None
        How often the journal is forced to the disk, in s; None for a virtual clock.
    session : mapping, optional
        Who records with what, for campaign.json; its "bench" is held against that of the campaign's last session.
    more : callable, optional
        Asked once all runs are recorded, and again after these: given the id of a run that the operator wants left out
        (else None) and the bench's time [s], the protocol with further runs, or None where the campaign is done.

    Returns
    -------
    list of str
        Ids of the runs recorded now.

    Raises
    ------
    BenchError, BusError, StageError
        The plan cannot be run, or an instrument cannot be opened.
    CampaignPaused, CampaignAborted
        A run was spoilt more often than the protocol allows; nobody answered a prompt; the operator wants it.
    RecordingError
        The disk does not take the recording.
    """
    watcher = observer or SilentObserver()
    folder = CampaignFolder(
        path,
        protocol,
        bench.describe(),
        bench=bench.name,
        sync_every_s=sync_every_s,
        emulated=bench.emulated,
        common=bench.common,
    )
    try:
        for text in folder.recover():
            watcher.say(text)
        missing = folder.missing()
        if not missing and more is None:
            return []
        for text in folder.changed(session) if session is not None else ():
            watcher.say(f"another setting than in this campaign's last session: {text}")
        runner = _Runner(bench, protocol, folder, watcher, utc)
        try:
            runner.open()
            if bench.emulated:
                watcher.say(INVENTED)
            if session is not None:
                runner.session = folder.add_session(session)
            return runner.record_all(missing, more)
        except RecordingError:
            raise  # its message says where the journal is: that stays there until there is room again
        except BaseException:
            runner.make_safe()
            folder.recover()
            raise
        finally:
            runner.make_safe()
    except BaseException:
        folder.abandon()
        raise
    finally:
        folder.close()


@dataclass
class _Runner:
    """The bench while a campaign is being recorded: polls what is due, and walks through the steps of a run."""

    bench: Bench
    protocol: Protocol
    folder: CampaignFolder
    watcher: Observer
    utc: Callable[[], str]
    session: int | None = None

    def __post_init__(self) -> None:
        self.ear = Listener(self.bench, self.watcher, heed=self._heed)
        self._inbox = Inbox(self.folder.path, self.bench.clock.now)
        self._run_id = ""

    def open(self) -> None:
        """Open every instrument and hear of each sensor once."""
        if self.bench.operator is not None:
            watcher = self.watcher
            self.bench.operator.attend(self.ear.meanwhile, watcher.asked, self.ear.note, watcher.say)
        self.bench.open()
        self.ear.listen()

    def _heed(self) -> None:
        """Do what somebody elsewhere wants of the attempt in progress; between attempts it waits."""
        request = None if self.ear.recorder is None else self._inbox.take()
        if request is None:
            return
        if request.action == "note":
            self.ear.note(request.text)
        elif request.run != self._run_id:
            self.watcher.say(f"a request to {request.action} came from the live page after run {request.run} had ended")
        else:
            decided(request)

    def make_safe(self) -> None:
        """Stop all motion; a stage that cannot even be told is said loudly, and hides no other error."""
        try:
            self.bench.make_safe()
        except OSError as error:
            self.watcher.say(f"THE BENCH MAY NOT BE SAFE: the stage could not be stopped ({error})")

    def record_all(self, missing: Sequence[PlannedRun], more: More | None) -> list[str]:
        """Record what is missing, then what `more` asks for, until it asks for nothing; ids of the runs recorded."""
        done: list[str] = []
        after = "running the same command again records it" if more is None else "another is chosen"
        while True:
            left_out = None
            for run in missing:
                if self.recorded(run, after):
                    done.append(run.id)
                else:
                    left_out = run.id
            further = None if more is None else more(left_out, self.bench.clock.now())
            if further is None:
                return done
            self.protocol = further
            self.folder.extend(further)
            missing = self.folder.missing()

    def recorded(self, run: PlannedRun, after: str) -> bool:
        """Record one run of the protocol; False where the operator wants it left out (`after`: what comes of that)."""
        protocol = self.protocol
        number = protocol.continues + protocol.runs.index(run) + 1
        self.watcher.run_began(run, number, protocol.continues + len(protocol.runs), self.bench.clock.now())
        try:
            self.record(run)
        except RunSkipped as decision:
            self.watcher.say(f"run {run.id} is {decision}; {after}")
            return False
        return True

    def record(self, run: PlannedRun) -> None:
        """Record one run, repeating it while faults spoil it."""
        limit, wished = self.protocol.faults.repeat_at_most, 0
        self._run_id = run.id
        for attempt in range(1, limit + 2):
            while True:
                try:
                    record = self._attempt(run, attempt + wished)
                    break
                except RunRepeated as decision:
                    self.watcher.say(f"run {run.id}: {decision}")
                    wished += 1
            for text in off_plan(run, record):
                self.watcher.say(text)
            self.watcher.run_ended(record, self.bench.clock.now())
            if record.status == COMPLETE:
                return
            if attempt <= limit:
                self.watcher.say(f"run {run.id} is spoilt ({record.reason}) and is repeated ({attempt} of {limit})")
                self.ear.poll_until(self.bench.clock.now() + attempt * REPEAT_AFTER_S)
                self.ear.listen()
        raise CampaignPaused(
            f"run {run.id} was spoilt {limit + 1} times, the last time because {record.reason}; "
            "fix the bench and run the same command again to go on"
        )

    def _attempt(self, run: PlannedRun, attempt: int) -> RunRecord:
        clock = self.bench.clock
        header: dict[str, Any] = {
            "attempt": attempt,
            "started_at": self.utc(),
            **self.bench.surround(run.pressure_hpa, run.irradiance_w_m2),
            "sensors": list(self.bench.describe()),
            "airs_from": dict(zip(("source", "destination"), self.bench.reference.origins, strict=True)),
        }
        if self.session is not None:
            header["session"] = self.session
        self.ear.move = None
        self.ear.recorder = recorder = self.folder.begin(run, header, clock.now())
        try:
            self._walk(run)
            recorder.end(clock.now(), COMPLETE)
        except RecordingError:
            self.make_safe()
            raise
        except (_Spoilt, OSError) as error:
            self.make_safe()
            recorder.end(clock.now(), SPOILT, str(error))
        except BaseException as error:
            self.make_safe()  # before any file work: what moves is more urgent than what is written
            recorder.end(clock.now(), INTERRUPTED, cause(error))
            if isinstance(error, RunDecision):
                self.ear.recorder = None
                self.watcher.run_ended(self.folder.finish(recorder.folder), clock.now())
            raise
        finally:
            self.ear.recorder = None
        return self.folder.finish(recorder.folder)

    def _walk(self, run: PlannedRun) -> None:
        clock, recorder = self.bench.clock, self.ear.recorder
        assert recorder is not None
        began = False
        for step in run.steps:
            recorder.step(clock.now(), str(step))
            self.watcher.step_began(step, clock.now())
            match step:
                case Soak():
                    self.bench.stage.prepare(run.source, run.destination, run.airflow_m_s)
                    self._soak(step)
                case Record():
                    if not began:
                        recorder.zero(clock.now(), self.utc())
                        began = True
                    self._record(step, recorder)
                case Transfer():
                    # Transfers at ever other phases of the sampling show together what one cannot: a fast probe's first
                    # tenths of a second. The sensors keep to the clock's grid, so the phase is set on the clock.
                    phase_s = PHASE_S * (self.protocol.continues + self.protocol.runs.index(run))
                    self.ear.poll_until(math.ceil(clock.now() - phase_s) + phase_s)
                    self._transfer(step, recorder, run.transfer_s)

    def _soak(self, step: Soak) -> None:
        """Wait until the reference is stable and the probes have settled in it."""
        airs: deque[tuple[float, Air]] = deque()
        began_s = self.bench.clock.now()
        for readings in self.ear.good.values():
            readings.clear()
        while (now := self.bench.clock.now()) < began_s + step.at_most_s:
            airs.append((now, self.bench.reference.source()))
            began_s += self.bench.clock.now() - now  # the time in which a person types an air is none of the soak's
            while airs[0][0] < now - step.over_s - 0.5 * AIR_EVERY_S:
                airs.popleft()
            for readings in self.ear.good.values():
                while readings and readings[0][0] < now - step.over_s:
                    readings.popleft()
            waiting = "" if now - began_s >= step.over_s else "soaking"
            waiting = waiting or (self.bench.chambers.waiting() if self.bench.chambers is not None else "")
            if not waiting and not (waiting := unsettled(step, [air for _, air in airs], self.ear.good, now)):
                return
            self.ear.poll_until(now + AIR_EVERY_S)
        raise _Spoilt(f"the soak was not stable after {step.at_most_s:g} s: {waiting}")

    def _record(self, step: Record, recorder: Recorder) -> None:
        """Record; the last seconds note the air too: the source's before the transfer, the destination's after it."""
        end_s = self.bench.clock.now() + step.for_s
        reference = self.bench.reference
        place, ask = ("source", reference.source) if self.ear.move is None else ("destination", reference.destination)
        self.ear.poll_until(end_s - AIR_MEAN_S)
        while True:
            now = self.bench.clock.now()
            recorder.air(now, place, ask())
            if now >= end_s:
                return
            self.ear.poll_until(min(end_s, now + AIR_EVERY_S))

    def _transfer(self, step: Transfer, recorder: Recorder, duration_s: float | None) -> None:
        self.bench.stage.begin_transfer(duration_s)
        self.ear.poll_until(self.bench.clock.now() + step.at_most_s, lambda: self.ear.move is not None)
        if self.ear.move is None:
            raise _Spoilt(f"the transfer did not end within {step.at_most_s:g} s")
        recorder.move(self.ear.move)


def cause(error: BaseException) -> str:
    """Why a recording ended, for its files."""
    match error:
        case KeyboardInterrupt():
            return "stopped by the operator"
        case SystemExit(code=code) if code == 128 + signal.SIGHUP:
            return "the terminal was closed (hang-up)"
        case SystemExit():
            return "the process was told to end"
    return str(error) or type(error).__name__
