"""Runs a protocol on a bench: one loop over what is due next, so that a virtual clock runs an hour in a second.

A run is soak, record, transfer, record (rig.protocol); an attempt ends as complete, spoilt (faults: repeated up to the
protocol's limit) or interrupted (Ctrl-C or failure: kept aside, run again from its soak when the campaign goes on).
"""

from __future__ import annotations

import math
import signal
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shockrig.rig.bench import Bench
from shockrig.rig.errors import (
    BenchError,
    CampaignPaused,
    ConnectionFault,
    ConnectionFaults,
    RunDecision,
    RunRepeated,
    RunSkipped,
)
from shockrig.rig.observer import Observer, SilentObserver
from shockrig.rig.protocol import PlannedRun, Protocol, Record, Soak, Transfer
from shockrig.rig.recorder import CampaignFolder, Recorder, RecordingError, RunRecord, is_good
from shockrig.rig.recorder.judging import mean_of
from shockrig.rig.recorder.run import COMPLETE, INTERRUPTED, SPOILT
from shockrig.rig.seams import Air, Move, Reading, Reference, Sensor
from shockrig.rig.soak import unsettled

FIRST_READING_WITHIN_S = 10.0
REPEAT_AFTER_S = 5.0  # times the attempt: what spoilt a run may pass by itself (a plug, a reset), but not at once
AIR_EVERY_S = 1.0
PHASE_S = (5.0 + 5.0**0.5) / 20.0  # from run to run: modulo 0.1 s the golden ratio of it, which spreads most evenly
AIR_MEAN_S = 10.0  # the airs are averaged over the last seconds before the transfer and before the end
OFF_PLAN_K, OFF_PLAN_PERCENT = 2.0, 5.0  # an air is what it is measured to be, but whoever set it wants to know
SHORTEST_WAIT_S = 1e-4  # a part that is always due must not stop a virtual clock
INVENTED = "emulated instruments: what is recorded now is invented by the virtual bench, not measured"
BYTES_PER_S = 4000.0  # what a journal grows by at 10 Hz and two sensors, rounded up


class _Spoilt(Exception):
    """This attempt will not become a run; the reason goes into its journal."""


def check_plan(protocol: Protocol, bench: Bench, free_bytes: int | None = None) -> list[str]:
    """What speaks against a plan, before anything moves.

    Returns
    -------
    list of str
        Warnings: a person may know better.

    Raises
    ------
    BenchError
        The plan cannot be run on this bench.
    """
    if not bench.sensors:
        raise BenchError(f"bench {bench.name}: has no sensor to record; add [sensors.imet] or [sensors.hyt]")
    if free_bytes is not None:
        demand_room(protocol, free_bytes)
    warnings = []
    for run in protocol.runs:
        if bench.chambers is not None:
            try:
                bench.chambers.demand(run.source, run.destination, run.airflow_m_s)
            except BenchError as error:
                raise BenchError(f"run {run.id}: {error}") from None
        dew_point_c = _dew_point_c(run.destination)
        if dew_point_c is not None and run.source.temperature_c is not None and dew_point_c > run.source.temperature_c:
            warnings.append(
                f"run {run.id}: water will condense on the probes: they come from {run.source.temperature_c:g} degC "
                f"into air with a dew point of {dew_point_c:.1f} degC"
            )
    return warnings


def demand_room(protocol: Protocol, free_bytes: int) -> None:
    """Raise BenchError where a disk has no room for a campaign."""
    need_bytes = 2.0 * sum(run.shortest_s() for run in protocol.runs) * BYTES_PER_S
    if free_bytes < need_bytes:
        raise BenchError(f"the disk has {free_bytes / 1e6:.0f} MB free, the campaign needs {need_bytes / 1e6:.0f} MB")


def record_campaign(
    bench: Bench,
    protocol: Protocol,
    path: Path,
    *,
    utc: Callable[[], str],
    observer: Observer | None = None,
    sync_every_s: float | None = 1.0,
    session: Mapping[str, Any] | None = None,
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
        path, protocol, bench.describe(), bench=bench.name, sync_every_s=sync_every_s, emulated=bench.emulated
    )
    try:
        for text in folder.recover():
            watcher.say(text)
        missing = folder.missing()
        if not missing:
            return []
        for text in folder.changed(session) if session is not None else ():
            watcher.say(f"another setting than in this campaign's last session: {text}")
        runner = _Runner(bench, protocol, folder, watcher, utc)
        total = len(protocol.runs)
        recorded = []
        try:
            runner.open()
            if bench.emulated:
                watcher.say(INVENTED)
            if session is not None:
                runner.session = folder.add_session(session)
            for run in missing:
                watcher.run_began(run, protocol.runs.index(run) + 1, total, bench.clock.now())
                try:
                    runner.record(run)
                except RunSkipped as decision:
                    watcher.say(f"run {run.id} is {decision}; running the same command again records it")
                else:
                    recorded.append(run.id)
        except RecordingError:
            raise  # its message says where the journal is: that stays there until there is room again
        except BaseException:
            runner.make_safe()
            folder.recover()
            raise
        finally:
            runner.make_safe()
        return recorded
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
    recorder: Recorder | None = None
    move: Move | None = None
    good: dict[str, deque[tuple[float, float, float]]] = field(default_factory=dict)  # sensor -> (time, degC, %RH)
    outcomes: dict[str, Counter[str]] = field(default_factory=dict)  # sensor -> what came since the last listening

    def open(self) -> None:
        """Open every instrument and hear of each sensor once."""
        if self.bench.operator is not None:
            watcher = self.watcher
            self.bench.operator.attend(self._poll_sensors, watcher.asked, self._note, watcher.say)
        self.bench.open()
        self._listen()

    def make_safe(self) -> None:
        """Stop all motion; a stage that cannot even be told is said loudly, and hides no other error."""
        try:
            self.bench.make_safe()
        except OSError as error:
            self.watcher.say(f"THE BENCH MAY NOT BE SAFE: the stage could not be stopped ({error})")

    def _listen(self) -> None:
        self.good = {name: deque() for name in self.bench.describe()}
        self.outcomes = {name: Counter() for name in self.good}
        heard_all = self._poll_until(self.bench.clock.now() + FIRST_READING_WITHIN_S, lambda: all(self.good.values()))
        if not heard_all:
            raise ConnectionFaults(
                [
                    ConnectionFault(
                        self.bench.devices.get(name, name),
                        f"no good reading in {FIRST_READING_WITHIN_S:g} s ({self._heard_of(name)})",
                        "shockrig check says more; run the same command again to go on",
                    )
                    for name, readings in self.good.items()
                    if not readings
                ]
            )

    def _heard_of(self, name: str) -> str:
        """What a sensor answered instead of a good reading, most often first."""
        counts = self.outcomes[name].most_common()
        return ", ".join(f"{count} times {outcome.replace('_', ' ')}" for outcome, count in counts) or "silence"

    def record(self, run: PlannedRun) -> None:
        """Record one run, repeating it while faults spoil it."""
        limit, wished = self.protocol.faults.repeat_at_most, 0
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
                self._poll_until(self.bench.clock.now() + attempt * REPEAT_AFTER_S)
                self._listen()
        raise CampaignPaused(
            f"run {run.id} was spoilt {limit + 1} times, the last time because {record.reason}; "
            "fix the bench and run the same command again to go on"
        )

    def _attempt(self, run: PlannedRun, attempt: int) -> RunRecord:
        clock = self.bench.clock
        header: dict[str, Any] = {
            "attempt": attempt,
            "started_at": self.utc(),
            "pressure_hpa": self.bench.pressure_hpa,
            "sensors": list(self.bench.describe()),
            "airs_from": dict(zip(("source", "destination"), self.bench.reference.origins, strict=True)),
        }
        if self.session is not None:
            header["session"] = self.session
        self.move = None
        self.recorder = recorder = self.folder.begin(run, header, clock.now())
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
                self.recorder = None
                self.watcher.run_ended(self.folder.finish(recorder.folder), clock.now())
            raise
        finally:
            self.recorder = None
        return self.folder.finish(recorder.folder)

    def _walk(self, run: PlannedRun) -> None:
        clock, recorder = self.bench.clock, self.recorder
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
                    phase_s = PHASE_S * self.protocol.runs.index(run)
                    self._poll_until(math.ceil(clock.now() - phase_s) + phase_s)
                    self._transfer(step, recorder)

    def _soak(self, step: Soak) -> None:
        """Wait until the reference is stable and the probes have settled in it."""
        airs: deque[tuple[float, Air]] = deque()
        began_s = self.bench.clock.now()
        for readings in self.good.values():
            readings.clear()
        while (now := self.bench.clock.now()) < began_s + step.at_most_s:
            airs.append((now, self.bench.reference.source()))
            began_s += self.bench.clock.now() - now  # the time in which a person types an air is none of the soak's
            while airs[0][0] < now - step.over_s - 0.5 * AIR_EVERY_S:
                airs.popleft()
            for readings in self.good.values():
                while readings and readings[0][0] < now - step.over_s:
                    readings.popleft()
            waiting = "" if now - began_s >= step.over_s else "soaking"
            waiting = waiting or (self.bench.chambers.waiting() if self.bench.chambers is not None else "")
            if not waiting and not (waiting := unsettled(step, [air for _, air in airs], self.good, now)):
                return
            self._poll_until(now + AIR_EVERY_S)
        raise _Spoilt(f"the soak was not stable after {step.at_most_s:g} s: {waiting}")

    def _record(self, step: Record, recorder: Recorder) -> None:
        """Record; the last seconds note the air too: the source's before the transfer, the destination's after it."""
        end_s = self.bench.clock.now() + step.for_s
        reference = self.bench.reference
        place, ask = ("source", reference.source) if self.move is None else ("destination", reference.destination)
        self._poll_until(end_s - AIR_MEAN_S)
        while True:
            now = self.bench.clock.now()
            recorder.air(now, place, ask())
            if now >= end_s:
                return
            self._poll_until(min(end_s, now + AIR_EVERY_S))

    def _transfer(self, step: Transfer, recorder: Recorder) -> None:
        self.bench.stage.begin_transfer()
        self._poll_until(self.bench.clock.now() + step.at_most_s, lambda: self.move is not None)
        if self.move is None:
            raise _Spoilt(f"the transfer did not end within {step.at_most_s:g} s")
        recorder.move(self.move)

    def _poll_until(self, until_s: float, done: Callable[[], bool] = lambda: False) -> bool:
        """Poll what is due until a time, or until `done` says so; returns whether it did."""
        clock, stage, reference = self.bench.clock, self.bench.stage, self.bench.reference
        sensors = self.bench.sensors
        asked: Sequence[Sensor | Reference] = (*sensors, reference)
        while True:
            if done():
                return True
            now = clock.now()
            if now >= until_s:
                return False
            due_s = min(stage.due_s(), *(part.due_s() for part in asked))
            clock.sleep_until(min(until_s, max(due_s, now + SHORTEST_WAIT_S)))
            self._poll_sensors()
            if stage.due_s() <= clock.now() and (move := stage.poll()) is not None:
                self.move = move

    def _poll_sensors(self) -> None:
        """Take what the sensors and the reference have by now."""
        now = self.bench.clock.now()
        asked: Sequence[Sensor | Reference] = (*self.bench.sensors, self.bench.reference)
        for part in asked:
            if part.due_s() <= now:
                for reading in part.poll():
                    self._take(reading)

    def _note(self, text: str) -> None:
        if self.recorder is not None:
            self.recorder.note(self.bench.clock.now(), text)
        self.watcher.say(f"note: {text}")

    def _take(self, reading: Reading) -> None:
        if self.recorder is not None:
            self.recorder.reading(reading)
        self.watcher.reading(reading)
        if reading.sensor in self.outcomes:
            self.outcomes[reading.sensor][reading.outcome.value] += 1
        if reading.sensor in self.good and is_good(reading):
            values = reading.values
            temperature_c = values.get("temperature_c", math.nan)
            self.good[reading.sensor].append((reading.time_s, temperature_c, values.get("humidity_percent", math.nan)))


def off_plan(run: PlannedRun, record: RunRecord) -> list[str]:
    """One sentence for each air of a run that was measured and is not what the protocol asked for."""
    said = []
    for place in ("source", "destination"):
        for name, unit, far in (("temperature_c", "degC", OFF_PLAN_K), ("humidity_percent", "%RH", OFF_PLAN_PERCENT)):
            planned, found = getattr(getattr(run, place), name), mean_of(record.airs[place], name)
            if planned is not None and found is not None and abs(found - planned) > far:
                said.append(f"run {run.id}: the {place} air has {found:.1f} {unit}; {planned:g} {unit} was planned")
    return said


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


def _dew_point_c(air: Air) -> float | None:
    """Dew point in degC (Magnus form, Sonntag 1990), good to 0.1 K, which is enough for a warning."""
    if air.temperature_c is None or not air.humidity_percent:
        return None
    gamma = math.log(air.humidity_percent / 100.0) + 17.62 * air.temperature_c / (243.12 + air.temperature_c)
    return 243.12 * gamma / (17.62 - gamma)
