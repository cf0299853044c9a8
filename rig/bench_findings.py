"""Examine a bench: open every instrument, read it, look at the clock and the disk, and tell all of it at once.

An examination is a list of findings, device -> what it says, or device -> cause -> remedy. The stage is opened as for a
run, which homes it where its bench file says so.
"""

from __future__ import annotations

import os
import secrets
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

from shockrig.files.disk import shown
from shockrig.files.numbers import counted
from shockrig.rig.bench import Bench
from shockrig.rig.bench_errors import BenchError, ConnectionFaults
from shockrig.rig.chambers.limits import UNITS
from shockrig.rig.clock import VirtualClock
from shockrig.rig.listening import SHORTEST_WAIT_S
from shockrig.rig.planning import check_plan, demand_room
from shockrig.rig.protocol import Protocol
from shockrig.rig.recorder.campaign_folder import check_folder
from shockrig.rig.seams import Air, Move, Outcome, Reading
from shockrig.rig.sensors.imet_lines import PROBES

SETTLE_S = 0.5  # what had gathered while the other instruments were opened is old
LISTEN_S = 6.0  # an XQ2 speaks once in a second
ENOUGH_READINGS = 5
FAILED_PERCENT_AT_MOST = 5.0  # what a protocol allows where it does not say otherwise
CLOCK_STEP_S = 1e-3
SLEEP_LATE_S = 0.05  # half a period at 10 Hz
JUMP_S = 0.2
OLDEST_TIME_OF_DAY_S = 1735689600.0  # 2025-01-01 UTC: a computer without a battery clock wakes up long before
SYNC_S = 0.5
BLOCK_BYTES = 4096
BLOCKS_WRITTEN = 64

REMEDIES = {
    Outcome.STALE: "they come too late: end what else reads it or keeps this host busy; of a film, raise conversion_s",
    Outcome.COMMAND_MODE: "it listens for commands since a brown-out: switch its supply off and on",
    Outcome.NOT_ACKNOWLEDGED: "check supply, wiring, pull-ups and address",
    Outcome.TIMED_OUT: "it is silent: check supply, cable and baud rate, and that no other program reads it",
    Outcome.IMPLAUSIBLE: "the values cannot be: check that the lines are not shorted, and the kind in the bench file",
    Outcome.REJECTED: "its lines cannot be read: check kind and baud in the bench file",
}


@dataclass(frozen=True)
class DeviceFinding:
    """What is known of one device. It is well where `cause` is empty; `says` is what it said either way."""

    device: str
    says: str = ""
    cause: str = ""
    remedy: str = ""

    @property
    def well(self) -> bool:
        return not self.cause


class LeftAlone:
    """Stands in for a stage that must not move; nothing is sent to it."""

    def open(self) -> None:
        pass

    def prepare(self, source: Air, destination: Air, airflow_m_s: float | None) -> None:
        raise BenchError("this stage must not move")

    def demand_transfer(self, duration_s: float) -> None:
        raise BenchError("this stage must not move")

    def begin_transfer(self, duration_s: float | None = None) -> None:
        raise BenchError("this stage must not move")

    def due_s(self) -> float:
        return float("inf")

    def poll(self) -> Move | None:
        return None

    def make_safe(self) -> None:
        pass

    def close(self) -> None:
        pass


def examine(
    bench: Bench, protocol: Protocol, folder: Path, *, wall: Callable[[], float], may_move: bool = True
) -> list[DeviceFinding]:
    """Examine a bench that is not opened yet; the caller closes it.

    Parameters
    ----------
    protocol : Protocol
        What the disk must have room for.
    folder : Path
        Campaign folder that is meant to be recorded to; it need not exist.
    wall : callable
        Time of day in s since 1970.
    may_move : bool
        False leaves the stage unopened.

    Returns
    -------
    list of Finding
        Sensors, chambers, reference and stage in the bench's order, then clock, plan and disk.
    """
    if not may_move:
        bench = replace(bench, stage=LeftAlone())
    faults = {}
    try:
        bench.open()
    except ConnectionFaults as error:
        faults = {fault.device: fault for fault in error.faults}
    label = {name: bench.devices.get(name, name) for name in bench.parts()}
    opened = {name: part for name, part in bench.parts().items() if label[name] not in faults}
    real = not isinstance(bench.clock, VirtualClock)
    wall_before_s, bench_before_s = wall(), bench.clock.now()
    silent = ("stage", *bench.climate)
    heard = _listen(bench, {name: part for name, part in opened.items() if name not in silent})
    jump_s = (wall() - wall_before_s) - (bench.clock.now() - bench_before_s) if real else 0.0
    findings = []
    for name, part in bench.parts().items():
        if label[name] in faults:
            findings.append(DeviceFinding(label[name], "", faults[label[name]].cause, faults[label[name]].remedy))
        elif name == "stage":
            findings.append(DeviceFinding(label[name], "answers" if may_move else "left alone, as asked"))
        elif name in bench.climate:
            findings.append(_climate(label[name], part))
        elif name in bench.describe() or heard[name]:
            findings.append(_judged(label[name], part, heard[name], bench.describe().get(name, {})))
        else:
            findings.append(DeviceFinding(label[name], "nothing to read before a run"))
    findings.append(_serials(bench))
    findings.append(clock_finding(bench.clock, wall, jump_s) if real else DeviceFinding("clock", "virtual"))
    findings.append(_plan(folder, bench, protocol))
    findings.append(_disk(folder, protocol, bench.clock.now if real else None))
    return findings


def tree(bench_name: str, findings: list[DeviceFinding]) -> str:
    """The findings as text: device, then what it says, then the cause and below it the remedy."""
    lines = [bench_name]
    for finding in findings:
        lines.append(f"  {'ok   ' if finding.well else 'FAULT'}  {finding.device}")
        lines += [f"             {finding.says}"] if finding.says else []
        lines += [f"             {finding.cause}"] if finding.cause else []
        lines += [f"                 {finding.remedy}"] if finding.remedy else []
    return "\n".join(lines)


def lacking(findings: list[DeviceFinding]) -> str:
    """What is missing before anything can be recorded, in a line; empty where nothing is."""
    faults = [finding for finding in findings if not finding.well]
    if not faults:
        return ""
    listed = "; ".join(f"{finding.device} ({finding.cause})" for finding in faults)
    return f"not ready, {counted(len(faults), 'fault')}: {listed}"


def _serials(bench: Bench) -> DeviceFinding:
    """Which sensors can be told from others of their kind in a campaign that is looked at years later."""
    stated = {name: entry.get("serial") for name, entry in bench.describe().items()}
    known = ", ".join(f"{name} {serial}" for name, serial in stated.items() if serial)
    silent = [name for name, serial in stated.items() if not serial]
    if bench.emulated or not silent:
        return DeviceFinding("serial numbers", known or "of emulated sensors")
    said = f"none stated for {', '.join(silent)}; histories need one: serial = ... in the bench file"
    return DeviceFinding("serial numbers", f"{known}; {said}" if known else said)


def _listen(bench: Bench, parts: Mapping[str, Any]) -> dict[str, list[Reading]]:
    """Readings of the parts that have any, until each has given a few good ones or the time is over.

    Who fails once is listened to for the whole time: one of six readings says nothing of a share of 5 %.
    """
    clock, begin_s = bench.clock, bench.clock.now() + SETTLE_S
    until_s = begin_s + LISTEN_S
    heard: dict[str, list[Reading]] = {name: [] for name in parts}
    waiting = {name for name in parts if name in bench.describe() or parts[name].due_s() < until_s}
    while waiting and (now := clock.now()) < until_s:
        due_s = min(part.due_s() for part in parts.values())
        clock.sleep_until(min(until_s, max(due_s, now + SHORTEST_WAIT_S)))
        for name, part in parts.items():
            if part.due_s() <= clock.now():
                readings = [reading for reading in part.poll() if reading.sensor == name]
                heard[name] += readings if now >= begin_s else []
        waiting = {name for name in waiting if len(_good(heard[name])) < ENOUGH_READINGS or _lost(heard[name])}
    return heard


def _good(readings: list[Reading]) -> list[Reading]:
    return [reading for reading in readings if reading.outcome is Outcome.OK]


def _lost(readings: list[Reading]) -> int:
    """How many failed; the first line after opening may be the tail of one that had begun before."""
    return len(readings) - len(_good(readings)) - (readings[:1] != [] and readings[0].outcome is Outcome.REJECTED)


def _judged(device: str, part: Any, readings: list[Reading], entry: Mapping[str, Any]) -> DeviceFinding:
    good = _good(readings)
    outcomes = Counter(reading.outcome for reading in readings)
    failed = {outcome: n for outcome, n in outcomes.items() if outcome is not Outcome.OK}
    counted = ", ".join(f"{n} {outcome}" for outcome, n in sorted(failed.items()))
    if not good:
        worst = max(failed, key=failed.__getitem__, default=Outcome.TIMED_OUT)
        return DeviceFinding(device, "", f"no good reading in {LISTEN_S:g} s ({counted or 'silence'})", REMEDIES[worst])
    says = [f"serial {entry['serial']}"] if entry.get("serial") else []
    says.append(", ".join(_words(name, value) for name, value in good[-1].values.items()))
    if len(good) > 1:
        span_s = good[-1].time_s - good[0].time_s
        says.append(f"{(len(good) - 1) / span_s:.3g} readings/s" if span_s > 0 else f"{len(good)} readings")
    # The first line after opening is the tail of one that had begun before: what it begins with is no id.
    unknown = [id_ for id_, times in getattr(part, "unknown_ids", {}).items() if times > 1]
    if unknown:
        named = ", ".join(f"{id_!r} ({PROBES[id_]})" if id_ in PROBES else repr(id_) for id_ in unknown)
        says.append(f"lines of unknown id {named} (add them to lines)")
    lost, failing = _lost(readings), f"{counted} of {len(readings)} readings"
    if lost > 1 and 100.0 * lost / len(readings) > FAILED_PERCENT_AT_MOST:
        worst = max(failed, key=failed.__getitem__)
        return DeviceFinding(device, "; ".join(says), failing, REMEDIES[worst])
    says += [failing] if lost else []
    return DeviceFinding(device, "; ".join(says))


def _words(name: str, value: float) -> str:
    for suffix, unit in (("_c", "degC"), ("_percent", "%RH"), ("_hpa", "hPa"), ("_ohm", "ohm")):
        if name.endswith(suffix):
            what = name.removesuffix(suffix).replace("_", " ")
            return f"{what} {value:.5g} {unit}"
    return f"{name} {value:.5g}"


def clock_finding(clock: Any, wall: Callable[[], float], jump_s: float) -> DeviceFinding:
    """Whether a clock never steps back, is fine enough and wakes in time, and the time of day can date a run."""
    times_s = [clock.now() for _ in range(2000)]
    steps_s = [late - early for early, late in zip(times_s, times_s[1:], strict=False)]
    resolution_s = min((step for step in steps_s if step > 0), default=1.0)
    late_s = []
    for _ in range(10):
        due_s = clock.now() + 0.01
        clock.sleep_until(due_s)
        late_s.append(clock.now() - due_s)
    says = f"steps of {resolution_s * 1e6:.2g} us, wakes {1e3 * max(late_s):.2g} ms late at most"
    if min(steps_s) < 0:
        return DeviceFinding("clock", says, "it steps back", "this host's monotonic clock is broken: use another host")
    if resolution_s > CLOCK_STEP_S:
        return DeviceFinding("clock", says, f"it is coarser than {CLOCK_STEP_S:g} s", "use another host or kernel")
    if max(late_s) > SLEEP_LATE_S:
        return DeviceFinding(
            "clock", says, f"it wakes up to {max(late_s):.2g} s late", "end what else keeps this host busy"
        )
    if wall() < OLDEST_TIME_OF_DAY_S:
        return DeviceFinding(
            "clock", says, "the time of day is not set", "set it, or wait for NTP: runs are dated by it"
        )
    if abs(jump_s) > JUMP_S:
        remedy = "wait until NTP has settled: samples are not touched, but runs are dated by it"
        return DeviceFinding("clock", says, f"the time of day jumped by {jump_s:+.1f} s while this listened", remedy)
    return DeviceFinding("clock", says)


def _climate(device: str, part: Any) -> DeviceFinding:
    """What a chamber or fan reads; its set points are left alone."""
    try:
        found = {quantity: part.get(quantity) for quantity in UNITS if part.has(quantity)}
    except OSError as error:
        return DeviceFinding(
            device, "", error.strerror or str(error), "check the commands or registers in the bench file"
        )
    said = [f"{name} {value:.4g} {UNITS[name]}" for name, value in found.items() if value is not None]
    return DeviceFinding(device, ", ".join(said) or f"answers; takes {', '.join(found)}, and reads none of it")


def _plan(folder: Path, bench: Bench, protocol: Protocol) -> DeviceFinding:
    """Whether a run of this protocol into this folder would be begun."""
    device = f"plan ({protocol.name} into {shown(folder)})"
    try:
        warnings = check_plan(protocol, bench)
        if folder != Path():
            check_folder(folder, protocol, bench.describe(), bench=bench.name, emulated=bench.emulated)
    except BenchError as error:
        return DeviceFinding(device, "", str(error), "shockrig run would refuse it")
    return DeviceFinding(device, "; ".join([counted(len(protocol.runs), "run"), *warnings]))


def _disk(folder: Path, protocol: Protocol, now: Callable[[], float] | None) -> DeviceFinding:
    """Room for the protocol, and how fast small writes reach the disk (`now` None: not timed)."""
    home = next(parent for parent in (folder, *Path(os.path.realpath(folder)).parents) if parent.is_dir())
    device = f"disk ({home})"
    try:
        disk = os.statvfs(home)
        free_bytes = disk.f_bavail * disk.f_frsize
        times_s = _timed_writes(home, now or (lambda: 0.0))
    except OSError as error:
        return DeviceFinding(device, "", error.strerror or str(error), "give an --out that can be written to")
    says = f"{free_bytes / 1e9:.1f} GB free"
    if now is not None:
        says += f"; {BLOCK_BYTES // 1024} kB reach the disk in {1e3 * median(times_s):.2g} ms"
        says += f", {1e3 * max(times_s):.2g} ms at most"
    try:
        demand_room(protocol, free_bytes)
    except BenchError as error:
        return DeviceFinding(device, says, str(error), "free some space, or give an --out on another disk")
    if max(times_s) > SYNC_S:
        return DeviceFinding(
            device, says, "it stalls", "record to another disk (worn SD cards and network disks stall)"
        )
    return DeviceFinding(device, says)


def _timed_writes(home: Path, now: Callable[[], float]) -> list[float]:
    path = home / f".shockrig-check-{secrets.token_hex(4)}"
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        times_s = []
        for _ in range(BLOCKS_WRITTEN):
            began_s = now()
            os.write(file, os.urandom(BLOCK_BYTES))
            os.fdatasync(file)
            times_s.append(now() - began_s)
        return times_s
    finally:
        os.close(file)
        os.unlink(path)
