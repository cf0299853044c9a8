"""A bench of first-order sensors in memory, behind the seams, and short campaigns recorded on it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field

from shockrig.rig.bench import Bench
from shockrig.rig.clock import VirtualClock
from shockrig.rig.protocol import Faults, PlannedRun, Protocol, Record, Soak, Transfer
from shockrig.rig.runner import record_campaign
from shockrig.rig.seams import Air, Move, Outcome, Reading

TAU_S = {"imet": 1.0, "hyt": 4.0}


@dataclass
class FakeWorld:
    """Air at the probes since the last change, and first-order sensors behind it."""

    clock: VirtualClock
    airs: tuple[Air, Air] = (Air(20.0, 50.0), Air(20.0, 50.0))
    here: int = 0
    states: dict = field(default_factory=lambda: {"imet": [20.0, 50.0, 0.0], "hyt": [20.0, 50.0, 0.0]})

    def follow(self, name: str, to_s: float) -> None:
        state, air = self.states[name], self.airs[self.here]
        share = 1.0 - math.exp(-(to_s - state[2]) / TAU_S[name])
        state[0] += share * (air.temperature_c - state[0])
        state[1] += share * (air.humidity_percent - state[1])
        state[2] = to_s

    def change(self, airs: tuple[Air, Air], here: int) -> None:
        for name in self.states:
            self.follow(name, self.clock.now())
        self.airs, self.here = airs, here


class FakeSensor:
    """Gives a reading every 0.1 s on its own phase; `fault(time_s)` may turn it into another outcome, or "silent"."""

    def __init__(self, name, world, phase_s, fault=None):
        self.name, self._world, self._fault = name, world, fault
        self._next_s, self.opened = phase_s, 0

    def open(self):
        self.opened += 1

    def due_s(self):
        return self._next_s

    def poll(self):
        now = self._world.clock.now()
        asked_s, self._next_s = self._next_s, self._next_s + 0.1
        outcome = (self._fault(now) if self._fault else None) or Outcome.OK
        if outcome == "silent":
            return []
        if isinstance(outcome, BaseException):
            raise outcome
        self._world.follow(self.name, asked_s)
        temperature_c, humidity_percent, _ = self._world.states[self.name]
        values = {"temperature_c": temperature_c}
        if self.name == "hyt":
            values["humidity_percent"] = humidity_percent
        values = values if outcome is Outcome.OK else {}
        return [Reading(self.name, outcome, asked_s, now, values, b"\x1f\x6d", asked_s)]

    def close(self):
        pass


class FakeStage:
    def __init__(self, world, fault=None):
        self._world, self._fault, self._end_s = world, fault, math.inf
        self.log = []

    def open(self):
        self.log.append("open")

    def prepare(self, source, destination, airflow_m_s):
        self.log.append("prepare")
        self._world.change((source, destination), 0)

    def demand_transfer(self, duration_s):
        pass

    def begin_transfer(self, duration_s=None):
        self.log.append("begin")
        now = self._world.clock.now()
        if self._fault and (error := self._fault(now)):
            raise error
        self._world.change(self._world.airs, 1)
        self._start_s, self._end_s = now, now + 0.35

    def due_s(self):
        return self._end_s

    def poll(self):
        if self._world.clock.now() < self._end_s:
            return None
        move, self._end_s = Move(self._start_s, self._end_s), math.inf
        return move

    def make_safe(self):
        self.log.append("safe")

    def close(self):
        self.log.append("close")


class FakeReference:
    origins = ("measured", "measured")

    def __init__(self, world):
        self._world = world

    def open(self):
        pass

    def due_s(self):
        return math.inf

    def poll(self):
        return []

    def source(self):
        return self._world.airs[0]

    def destination(self):
        return self._world.airs[1]

    def close(self):
        pass


def fake_bench(hyt_fault=None, imet_fault=None, stage_fault=None, clock=None, sensors=("imet", "hyt")) -> Bench:
    clock = clock or VirtualClock()
    world = FakeWorld(clock)
    phases = {"imet": (0.031, imet_fault), "hyt": (0.074, hyt_fault)}
    return Bench(
        name="fake",
        clock=clock,
        sensors=[FakeSensor(name, world, *phases[name]) for name in sensors],
        stage=FakeStage(world, stage_fault),
        reference=FakeReference(world),
        pressure_hpa=950.0,
        description={name: {"kind": "fake", "serial": f"F-{name}"} for name in sensors},
    )


STEPS = (Soak(over_s=6.0, at_most_s=120.0), Record(5.0), Transfer(10.0), Record(20.0))


def plan(count=2, steps=STEPS, faults=None) -> Protocol:
    airs = (Air(20.0, 20.0), Air(30.0, 70.0))
    runs = [PlannedRun(f"{i + 1:04d}", airs[i % 2], airs[1 - i % 2], 6.0, steps) for i in range(count)]
    return Protocol("test", "", tuple(runs), faults or Faults())


def utc():
    return "2026-05-01T00:00:00Z"


def run(bench, path, protocol=None, observer=None):
    return record_campaign(bench, protocol or plan(), path, utc=utc, observer=observer, sync_every_s=None)


def csv(path):
    names, *rows = [line.split(",") for line in path.read_text().splitlines()]
    return {name: [float(row[i]) for row in rows] for i, name in enumerate(names)}


def run_json(path, id_="0001"):
    return json.loads((path / "runs" / id_ / "run.json").read_text())


def between(low_s, high_s, outcome):
    return lambda now: outcome if low_s <= now < high_s else None
