"""The world behind the emulated chips: it must say what the batch says, whenever and however seldom it is asked."""

import dataclasses
import json

import numpy as np
import pytest
from small_worlds import QUIET

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.clock import VirtualClock
from shockrig.rig.seams import Air
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.effects import KINDS
from shockrig.rig.virtual.hide import draw_effect, draw_hidden
from shockrig.rig.virtual.physics import chains, course
from shockrig.rig.virtual.plans import Shock
from shockrig.rig.virtual.truth import ROUGH, Hidden, TrueNoise, draw_truth, with_effects
from shockrig.rig.virtual.world import RECORDED_BEFORE_S, ROOM, World

SOURCE, DESTINATION = Air(12.0, 55.0), Air(27.0, 78.0)
SOAK_S, START_S = 1800.0, RECORDED_BEFORE_S


def world(truth=QUIET, **keys):
    clock = VirtualClock()
    made = World(truth, clock, 1, **keys)
    made.set_airs(SOURCE, DESTINATION, 6.0, 1013.25)
    return made, clock


def batch(truth, tmp_path, duration_s=30.0):
    run = Shock("1", SOURCE, DESTINATION, 6.0, duration_s=duration_s, lead_s=START_S)
    folder = simulate_campaign(truth, [run], 1, tmp_path / "campaign") / "runs" / "1"
    assert json.loads((folder / "run.json").read_text())["transfer"]["start_s"] == START_S
    return tuple(np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1) for name in ("imet", "hyt"))


def record(live, imet, hyt, begin):
    """Readings at the batch's instants, after a long soak, asked in the order of time."""
    asked = sorted([(t, "bead") for t in imet[:, 0]] + [(t, "film") for t in hyt[:, 0]] + [(START_S, "go")])
    bead, film, die = [], [], []
    for time_s, who in asked:
        if who == "go":
            begin(SOAK_S + time_s)
        elif who == "bead":
            bead.append(live.bead_temperature_c(SOAK_S + time_s))
        else:
            film.append(live.film_humidity_percent(SOAK_S + time_s))
            die.append(live.die_temperature_c(SOAK_S + time_s))
    return np.array(bead), np.array(film), np.array(die)


@pytest.fixture
def fine_steps(monkeypatch):
    """Steps of a quarter: the batch's own error becomes a sixteenth, and what it stands in for is left."""
    monkeypatch.setattr(chains, "STEPS_PER_AGE", 4 * chains.STEPS_PER_AGE)
    monkeypatch.setattr(chains, "LONGEST_STEP_S", chains.LONGEST_STEP_S / 4.0)


STEPPED = "concentration_dependent_diffusivity"
# noise of its own, and steps that are taken at another sample
SAME_IN_BOTH = [name for name in KINDS if name not in (STEPPED, "stale_samples", "unknown_interference")]
GROUPS = [*(SAME_IN_BOTH[i::6] for i in range(6)), [STEPPED, *SAME_IN_BOTH[1::4]], [STEPPED, "condensation"]]
COARSE_PERCENT = {"condensation": 0.03, "unknown_sorption_heat": 4e-3}  # what the batch knows to a step only


@pytest.mark.parametrize("names", GROUPS, ids=lambda names: "+".join(names)[:60])
def test_live_world_agrees_with_the_batch(names, tmp_path, fine_steps):
    rng = np.random.default_rng(3)
    effects = tuple(draw_effect(rng, name) for name in names)
    truth = dataclasses.replace(QUIET, effects=effects)
    live, _ = world(truth)
    imet, hyt = batch(truth, tmp_path)
    bead, film, die = record(live, imet, hyt, live.begin_transfer)
    first = max([0, *(int(h.parameters["samples"]) for h in effects if h.effect == "moving_average")])
    resolution = max([1e-4, *(1.01 * h.parameters["step"] for h in effects if h.effect == "quantization")])
    assert np.abs(bead - imet[:, 1])[first:].max() < resolution
    assert np.abs(film - hyt[:, 1])[first:].max() < max([resolution, *(COARSE_PERCENT.get(n, 0.0) for n in names)])
    assert np.abs(die - hyt[:, 2]).max() < 0.0051


def test_readings_are_held_as_in_the_batch(tmp_path):
    """Each humidity comes `hold_samples` times and is one that the sensor showed then; the unflagged repeats may begin
    anywhere.
    """
    truth = dataclasses.replace(QUIET, effects=(Hidden("stale_samples", {"hold_samples": 4.0}),))
    live, _ = world(truth)
    imet, hyt = batch(truth, tmp_path)
    bead, film, _ = record(live, imet, hyt, live.begin_transfer)
    plain, _ = world()
    _, exact, _ = record(plain, imet, hyt, plain.begin_transfer)
    moving = exact > SOURCE.humidity_percent + 1.0
    for readings in (film, hyt[:, 1]):
        news = 1 + np.flatnonzero(np.abs(np.diff(readings)) > 1e-5)
        news = news[moving[news]][:20]
        assert (np.diff(news) == 4).all() and readings[news] == pytest.approx(exact[news], abs=1e-3)
    assert np.abs(bead - imet[:, 1]).max() < 5e-4


def test_interference_is_as_strong_as_in_the_batch(tmp_path):
    hum = Hidden("unknown_interference", {"amplitude": 0.2, "hum_hz": 1.3, "burst_share": 0.05}, ("humidity",))
    truth = dataclasses.replace(QUIET, effects=(hum,))
    live, _ = world(truth)
    imet, hyt = batch(truth, tmp_path, 300.0)
    _, film, _ = record(live, imet, hyt, live.begin_transfer)
    plain, _ = world()
    _, exact, _ = record(plain, imet, hyt, plain.begin_transfer)
    strengths = []
    for readings in (film, hyt[:, 1]):
        size = np.abs(readings - exact)
        quiet, bursts = size < 0.21, size > 0.21
        assert 0.01 < bursts.mean() < 0.2 and size.max() == pytest.approx(2.0, rel=0.05)
        strengths.append(np.sqrt(np.mean(size[quiet] ** 2)))
    assert strengths[0] == pytest.approx(strengths[1], rel=0.1) == pytest.approx(0.2 / np.sqrt(2.0), rel=0.1)


def test_a_drifting_clock_agrees_when_the_recording_begins():
    """A clock that is fast by 2 % shows 10.5 s into a recording what was true 0.206 s earlier."""
    late_s = RECORDED_BEFORE_S * (1.0 - 1.0 / 1.02)
    plain, _ = world()
    fast, _ = world(dataclasses.replace(QUIET, effects=(Hidden("clock_drift", {"ppm": 20000.0}, ("humidity",)),)))
    for live in (plain, fast):
        live.begin_transfer(SOAK_S)
    for since_s in (0.5, 3.0, 20.0):
        true = plain.film_humidity_percent(SOAK_S + since_s / 1.02 - late_s)
        assert fast.film_humidity_percent(SOAK_S + since_s) == pytest.approx(true, abs=1e-5)


def test_a_start_that_is_told_late_is_honoured(tmp_path, fine_steps):
    """A unit may have been read past the start before the stage tells it: what comes next is as if it had been told
    in time.
    """
    imet, hyt = batch(QUIET, tmp_path)
    live, _ = world()
    live.bead_temperature_c(SOAK_S + START_S + 0.05)
    live.begin_transfer(SOAK_S + START_S)
    late = imet[:, 0] > START_S + 0.05
    told = [live.bead_temperature_c(SOAK_S + t) for t in imet[late, 0]]
    assert np.abs(np.array(told) - imet[late, 1]).max() < 1e-4


def test_seldom_or_often_gives_the_same(tmp_path):
    live, _ = world()
    live.begin_transfer(SOAK_S + START_S)
    seldom = live.film_humidity_percent(SOAK_S + START_S + 3.0)
    other, _ = world()
    other.begin_transfer(SOAK_S + START_S)
    for t in np.arange(0.0, 3.0, 0.0137):
        often = other.film_humidity_percent(SOAK_S + START_S + t)
    often = other.film_humidity_percent(SOAK_S + START_S + 3.0)
    assert seldom == pytest.approx(often, abs=2e-6)


def test_probes_feel_their_own_chamber_and_come_back():
    live, clock = world()
    assert live.air(0.0).temperature_c == SOURCE.temperature_c
    assert live.bead_temperature_c(0.0) == pytest.approx(ROOM.temperature_c)
    live.begin_transfer(600.0)
    assert live.air(599.9).temperature_c == pytest.approx(SOURCE.temperature_c)
    assert live.air(600.1).humidity_percent == pytest.approx(DESTINATION.humidity_percent)
    live.begin_return(700.0)
    assert live.bead_temperature_c(699.0) == pytest.approx(DESTINATION.temperature_c, abs=1e-3)
    clock.sleep_until(900.0)
    live.set_airs(Air(5.0, 40.0), DESTINATION, 6.0, 1013.25)
    assert live.bead_temperature_c(899.0) == pytest.approx(SOURCE.temperature_c, abs=1e-3)
    assert live.film_humidity_percent(2000.0) == pytest.approx(40.0, abs=1e-3)


def test_a_ramp_carries_the_air_linearly():
    live, _ = world(dataclasses.replace(QUIET, effects=(Hidden("finite_transfer", {"duration_s": 0.4}),)))
    live.begin_transfer(100.0)
    assert live.air(100.1).temperature_c == pytest.approx(12 + 15 / 4)
    live.begin_return(200.0, duration_s=2.0)
    assert live.air(201.0).temperature_c == pytest.approx(19.5)


def test_chambers_that_take_their_time():
    live, clock = world(settling_s=60.0)
    assert live.air(60.0).temperature_c == pytest.approx(12 + 8 * np.exp(-1.0))
    live.begin_transfer(120.0)
    assert live.air(180.0).temperature_c == pytest.approx(27 - 7 * np.exp(-3.0))


def test_long_soaks_are_cheap(monkeypatch):
    """An hour of waiting takes some hundred steps, not 360 000, and none where there is a closed form."""
    steps = []
    step = chains.Stepper.step
    monkeypatch.setattr(chains.Stepper, "step", lambda self, step_s: (steps.append(step_s), step(self, step_s))[1])
    live, _ = world()
    assert live.film_humidity_percent(3600.0) == pytest.approx(55.0, abs=1e-4)
    assert not steps
    live, _ = world(dataclasses.replace(QUIET, effects=(Hidden(STEPPED, {"slope_per_unit_activity": 0.4}),)))
    assert live.film_humidity_percent(3600.0) == pytest.approx(55.0, abs=1e-4)
    assert 50 < len(steps) < 3500


class _Never(Exception):
    """The world goes on and on."""


@pytest.mark.parametrize("first_seed", range(0, 20, 10))
def test_looking_always_comes_to_an_end(first_seed, monkeypatch):
    """Campaigns at awkward instants (soaks of any length, looks a rounding error apart and again) with whatever is
    hidden: the work stays in proportion to the time that passes.
    """
    work = []

    def count(method):
        def counted(*arguments):
            work.append(1)
            if len(work) > 60_000:
                raise _Never
            return method(*arguments)

        return counted

    monkeypatch.setattr(chains.Stepper, "step", count(chains.Stepper.step))
    monkeypatch.setattr(course.ModalCourse, "_piece", count(course.ModalCourse._piece))
    for seed in range(first_seed, first_seed + 10):
        work.clear()
        rng = np.random.default_rng(seed)
        names = [str(name) for name in rng.choice([*KINDS], 3, replace=False)]
        truth = with_effects(draw_truth(rng, ROUGH), draw_hidden(rng, ["finite_transfer", *set(names)]))
        clock = VirtualClock()
        live = World(truth, clock, seed)
        for _ in range(2):
            live.set_airs(SOURCE, DESTINATION, 6.0, 1013.25)
            now_s = clock.now()
            for move in (live.begin_transfer, live.begin_return):
                now_s += float(rng.choice([0.1, 1 / 3, 7.0])) * rng.integers(1, 40) + rng.random()
                live.film_humidity_percent(now_s)
                move(now_s + rng.random())
                for _ in range(12):
                    now_s = np.nextafter(now_s + rng.choice([0.0, 0.1, 1 / 3]), np.inf)
                    readings = live.film_humidity_percent(now_s), live.bead_temperature_c(now_s)
                    assert np.isfinite(readings).all()
                now_s += 2.0
            clock.sleep_until(now_s)


def test_noise_is_there_and_is_seeded():
    noisy = dataclasses.replace(
        QUIET, temperature_noise=TrueNoise(0.02), humidity_noise=TrueNoise(0.1), die_noise_k=0.02
    )
    readings = []
    for _ in range(2):
        live, _ = world(noisy)
        readings.append([live.bead_temperature_c(1000 + 0.1 * i) for i in range(300)])
    assert readings[0] == readings[1]
    assert np.std(readings[0]) == pytest.approx(0.02, rel=0.2)
    assert np.std([live.die_temperature_c(1100 + 0.1 * i) for i in range(300)]) == pytest.approx(0.02, rel=0.2)


def test_what_cannot_be_is_refused():
    live, _ = world()
    live.begin_transfer(100.0)
    live.air(130.0)
    with pytest.raises(BenchError, match="cannot be moved"):
        live.begin_return(99.0)
    with pytest.raises(BenchError, match="both airs"):
        live.set_airs(Air(None, 50.0), DESTINATION, 5.0, 1013.25)
