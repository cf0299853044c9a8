"""Bins, averaged traces and initial states of runs whose air was measured, against closed forms of a lag."""

import json

import numpy as np
import pytest

from shockrig.analysis.diagnose.prepare import prepare
from shockrig.analysis.estimate.channel import bin_means, place
from shockrig.analysis.estimate.driven_air import averaged_over, begun_unsettled, edges_of_driven, follow, without_noise
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.refitting import plain_fit
from shockrig.analysis.physics.chain import MeasuredAir
from shockrig.analysis.physics.driven import respond
from shockrig.analysis.physics.modes import first_order
from shockrig.files.campaign import read_campaign

TAU_S, PERIOD_S, NOISE_K = 200.0, 3.0, 0.01
STEP_AT_S, FROM_C, TO_C = 900.0, 16.0, 25.0


def lagged(time, off_k):
    """A lag of TAU_S, `off_k` from the air when the record began, in air that steps once: closed form [degC]."""
    late = np.maximum(time - STEP_AT_S, 0.0)
    return FROM_C + off_k * np.exp(-time / TAU_S) + (TO_C - FROM_C) * -np.expm1(-late / TAU_S)


def stepping_air(time):
    return np.where(time > STEP_AT_S, TO_C, FROM_C)


def measured(time, value):
    return MeasuredAir(time, value, np.full(time.size, np.nan))


@pytest.mark.parametrize("off_k", [2.7, -1.5])
def test_a_sensor_that_had_not_settled_is_seen_with_its_excess(off_k):
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 4000.0, PERIOD_S)
    reading = lagged(time, off_k) + 0.2 + rng.normal(0.0, NOISE_K, time.size)  # with a calibration of its own
    air = stepping_air(time) + rng.normal(0.0, NOISE_K, time.size)
    (found,) = follow([(time, reading, time, air)], 0.01)
    assert found.excess == pytest.approx(off_k, abs=0.03 * abs(off_k) + 0.02)
    assert found.time_constant_s == pytest.approx(TAU_S, rel=0.15)


@pytest.mark.parametrize("seed", range(5))
def test_two_calibrations_that_differ_are_no_initial_state(seed):
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 4000.0, PERIOD_S)
    offset, gain = rng.uniform(-0.4, 0.4), rng.uniform(0.97, 1.03)
    reading = 20.0 + offset + gain * (lagged(time, 0.0) - 20.0) + rng.normal(0.0, NOISE_K, time.size)
    air = stepping_air(time) + rng.normal(0.0, NOISE_K, time.size)
    assert follow([(time, reading, time, air)], 0.01)[0].excess == 0.0


def test_a_reading_that_begins_far_from_the_air_may_have_settled_to_another():
    """A third of it follows the air and the rest a room: it loses nothing at first, and a model that ends in the air
    has to be free to begin where the readings do."""
    time = np.arange(0.0, 4000.0, PERIOD_S)
    reading = 22.0 + (lagged(time, 0.0) - FROM_C) / 3.0
    (found,) = follow([(time, reading, time, stepping_air(time) + 50.0 * (time < STEP_AT_S))], 0.01)
    assert found.excess == 0.0
    assert found.excess_uncertainty == pytest.approx(FROM_C + 50.0 - 22.0, rel=0.02)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("directions", [(1,), (1, 1, -1)])
def test_on_a_ramp_a_bent_calibration_is_no_slow_lag_that_had_not_settled(directions, seed):
    """On a ramp a lag is as good as an offset: a bend by 0.03 K passed for a lag of hours, with 7 K at its begin."""
    tau_s, rng, time, runs = 70.0, np.random.default_rng(seed), np.arange(0.0, 13000.0, 30.0), []
    for direction in directions:
        slope = direction * 20.0 / time[-1]
        settled = slope * (time - tau_s * -np.expm1(-time / tau_s))
        reading = 25.08 + settled + 0.12 * settled / 20.0 * (1.0 - np.abs(settled) / 20.0)
        air = 25.0 + slope * time
        noise = rng.normal(0.0, NOISE_K, (2, time.size))
        runs.append((time, reading + noise[0], time, air + noise[1]))
    for one in follow(runs, 0.001):
        assert one.excess == 0.0
        assert one.excess_uncertainty < 0.5
        assert one.time_constant_s == pytest.approx(tau_s, rel=0.4)


def test_an_initial_state_drives_the_body_as_the_air_before_the_record():
    time = np.arange(0.0, 4000.0, PERIOD_S)
    air = begun_unsettled(
        measured(np.array([0.0, STEP_AT_S, STEP_AT_S, 4000.0]), np.array([16, 16, 25, 25.0])), 0.0, 2.7, 0
    )
    shown = respond(first_order(np.array(TAU_S)), air.time_s, air.temperature_c, time)
    assert shown == pytest.approx(lagged(time, 2.7), abs=1e-6)


def test_what_is_slower_than_its_record_has_its_time_constant(tmp_path):
    """Warm water in a room whose air was measured, each run ended long before it had cooled."""
    tau_s, room_c, rng = 1200.0, 23.0, np.random.default_rng(6)
    sensors = {"imet": {"kind": "as logged", "body": "lumped"}}
    (tmp_path / "campaign.json").write_text(
        json.dumps({"format": "shock-campaign/1", "name": "water", "sensors": sensors})
    )
    time = np.arange(0.0, 780.0)
    for number, begins_c in enumerate((45.0, 48.0, 40.0), start=1):
        folder = tmp_path / "runs" / f"{number:04d}"
        folder.mkdir(parents=True)
        (folder / "run.json").write_text(json.dumps({"format": "shock-run/1", "id": folder.name}))
        water = room_c + (begins_c - room_c) * np.exp(-time / tau_s)
        for name, values in (("imet", water), ("air", np.full(time.size, room_c))):
            noisy = np.round(values + rng.normal(0.0, 0.05, time.size), 1)
            rows = "".join(f"{t:g},{v:.1f}\n" for t, v in zip(time, noisy, strict=True))
            (folder / f"{name}.csv").write_text("time_s,temperature_c\n" + rows)
    ready = prepare(build_channel(read_campaign(tmp_path), "temperature"))
    found = plain_fit(ready.problem)
    assert np.exp(-found.log_rates[0]) == pytest.approx(tau_s, rel=0.03)
    assert ready.problem.channel.tempo > 50.0  # what is as slow begins with parts that are


def test_no_bin_bends_by_more_than_its_own_noise_and_few_are_needed():
    rng = np.random.default_rng(2)
    time = np.arange(0.0, 26000.0, PERIOD_S)
    exact = lagged(time, 0.0)
    reading = exact + rng.normal(0.0, NOISE_K, time.size)
    edges = edges_of_driven(0.0, time[-1], PERIOD_S, follow([(time, reading, time, stepping_air(time))], 0.0))
    bins = place([(time, reading)], edges, np.array([0.01]))
    middle, mean, count = (x[0] for x in bin_means([time], [exact], bins))
    assert middle.size < 260
    assert np.all(np.abs(mean - lagged(middle, 0.0))[middle > 0] < 1.5 * NOISE_K / np.sqrt(count[middle > 0]))


def test_an_air_averaged_over_the_bins_drives_alike():
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 26000.0, PERIOD_S)
    air = FROM_C + (TO_C - FROM_C) * -np.expm1(-np.maximum(time - STEP_AT_S, 0.0) / 60.0)  # a chamber, no step
    noisy = measured(time, air + rng.normal(0.0, NOISE_K, time.size))
    followed = follow([(time, lagged(time, 0.0), time, noisy.temperature_c)], 0.01)
    edges = edges_of_driven(0.0, time[-1], PERIOD_S, followed)
    thin = without_noise(*averaged_over(noisy, edges))
    modes = first_order(np.array(TAU_S))
    exact, found = (respond(modes, a.time_s, a.temperature_c, time) for a in (measured(time, air), thin))
    assert thin.time_s.size < 0.1 * time.size
    assert np.sqrt(np.mean((found - exact) ** 2)) < 0.3 * NOISE_K


def test_a_noisy_air_is_as_smooth_as_the_air_was_and_a_jump_stays_one():
    rng = np.random.default_rng(4)
    time = np.arange(0.0, 200.0, 0.5)
    edges = np.arange(-0.25, 200.5, 0.5)
    ramp = FROM_C + 5.0 * np.clip((time - 60.0) / 50.0, 0.0, 1.0)
    noisy = averaged_over(measured(time, ramp + rng.normal(0.0, NOISE_K, time.size)), edges)
    found = without_noise(*noisy).temperature_c
    assert np.sqrt(np.mean((found - ramp) ** 2)) < 0.5 * NOISE_K
    jump = np.where(time < 60.0, FROM_C, FROM_C + 5.0)
    noisy = averaged_over(measured(time, jump + rng.normal(0.0, NOISE_K, time.size)), edges)
    found = without_noise(*noisy).temperature_c
    assert np.abs(found - jump).max() < 4.0 * NOISE_K
    still = np.full(time.size, FROM_C)
    assert np.array_equal(without_noise(*averaged_over(measured(time, still), edges)).temperature_c, still)
