"""The emulated instruments as a bench has them: what is lost, what the references say, and who may look when."""

import dataclasses

import numpy as np
import pytest

from shockrig.rig.bench import virtual_bench
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.clock import VirtualClock
from shockrig.rig.seams import Air, Outcome
from shockrig.rig.stages.grbl import GrblSettings
from shockrig.rig.virtual.instruments import VirtualInstruments, WorldChambers
from shockrig.rig.virtual.truth import Truth

PLAIN = Truth(thermal_diffusivity_m2_s=7.5e-8, diffusivity_20c_m2_s=8e-12)


def poll(bench, until_s):
    clock, readings = bench.clock, []
    while clock.now() < until_s:
        clock.sleep_until(max(min(sensor.due_s() for sensor in bench.sensors), clock.now() + 1e-4))
        for sensor in bench.sensors:
            if sensor.due_s() <= clock.now():
                readings += sensor.poll()
    return readings


@pytest.mark.parametrize("missing_fraction", [0.0, 0.02, 0.1])
def test_readings_are_missing_as_often_as_the_truth_says(missing_fraction):
    seconds = 400.0
    with virtual_bench(dataclasses.replace(PLAIN, missing_fraction=missing_fraction), seed=3) as bench:
        bench.open()
        readings = poll(bench, seconds)
    for name in ("imet", "hyt"):
        good = sum(r.sensor == name and r.outcome is Outcome.OK for r in readings)
        spread = 4.0 * (missing_fraction / (10.0 * seconds)) ** 0.5  # of the draws; and the start
        assert 1.0 - good / (10.0 * seconds) == pytest.approx(missing_fraction, abs=0.003 + spread)


class Recording:
    """A world that notes what it is asked for."""

    def __init__(self):
        self.asked = []

    def __getattr__(self, name):
        return lambda *arguments: self.asked.append((name, arguments))


def test_airs_scatter_about_their_set_points_and_their_reports_about_the_airs():
    world, source, destination = Recording(), Air(20.0, 50.0), Air(40.0, 99.98)
    chambers = WorldChambers(world, 1000.0, (0.02, 0.1), (0.3, 0.5), seed=1)
    reports = []
    for _ in range(400):
        chambers.set_airs(source, destination, None)
        reports.append(chambers.airs())
    made = [arguments for _, arguments in world.asked]
    assert {arguments[2:] for arguments in made} == {(5.0, 1000.0, 0.0)}
    true_c, said_c = (np.array([airs[0].temperature_c for airs in both]) for both in (made, reports))
    true_percent, said_percent = (np.array([airs[0].humidity_percent for airs in both]) for both in (made, reports))
    for spread, sigma in (
        (true_c - 20.0, 0.02),
        (said_c - true_c, 0.3),
        (true_percent - 50.0, 0.1),
        (said_percent - true_percent, 0.5),
    ):
        assert spread.std() == pytest.approx(sigma, rel=0.15) and abs(spread.mean()) < 4.0 * sigma / 20.0
    assert max(airs[1].humidity_percent for airs in made) == 100.0  # and no more


def test_in_real_time_nobody_looks_at_the_world_while_it_is_moved():
    """Each pseudo-terminal has a thread of its own: moves and looks take turns."""

    class Watched(Recording):
        def __getattr__(self, name):
            return lambda *arguments: self.asked.append((name, instruments.world._lock.locked()))

    world = Watched()
    instruments = VirtualInstruments(world, VirtualClock(), 1013.25, in_real_time=True)
    settings = GrblSettings(port="virtual", source_mm=0.0, destination_mm=100.0, feed_mm_min=60_000.0)
    stage = instruments._device("stage", "grbl", settings)
    for at_s, line in enumerate((b"$H\n", b"G1 X100 F6000\n", b"G1 X0 F6000\n")):
        stage.receive(line, 10.0 * at_s)
    instruments.world.bead_temperature_c(31.0)
    instruments.chambers(PLAIN).set_airs(Air(20.0, 50.0), Air(30.0, 50.0), None)
    asked = ("begin_transfer", "begin_return", "bead_temperature_c", "set_airs")
    assert world.asked == [(name, True) for name in asked]


def test_a_kind_that_nobody_emulates_is_refused_by_its_name():
    """Another distribution's sensor behind `port = "virtual"`: not the lines of an iMet, which it could not read."""
    instruments = VirtualInstruments(Recording(), VirtualClock(), 1013.25)
    with pytest.raises(BenchError, match='imet: port = "virtual": no plain-line is emulated .*imet-xq2'):
        instruments.serial_opener("imet", "plain-line", None)
