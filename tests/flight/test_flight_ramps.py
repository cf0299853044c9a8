"""Changes of the air that are over within a few rows: a jump, or a ramp that a reading shows half way."""

import numpy as np
import pytest

from shockrig.analysis.flight.response import LagResponse
from shockrig.analysis.flight.smooth_channel import estimate

LAG_S, NOISE, HEIGHT = 0.2, 0.02, 5.0


def flown(lasting_s, every_s, begins_s, seed=0):
    """Rows `every_s` apart of a sensor with one lag, in air that goes up by `HEIGHT` in `lasting_s`."""
    fine_s = 0.01
    time = np.arange(0.0, 240.0, fine_s)
    air = np.interp(time, [begins_s, begins_s + max(lasting_s, fine_s)], [0.0, HEIGHT])
    air += 0.01 * np.cumsum(np.random.default_rng(seed).standard_normal(time.size)) * np.sqrt(fine_s)
    reading, keep = np.empty(time.size), np.exp(-fine_s / LAG_S)
    reading[0] = air[0]
    for k in range(1, time.size):
        reading[k] = keep * reading[k - 1] + (1.0 - keep) * air[k - 1]
    rows = slice(0, None, round(every_s / fine_s))
    read = reading[rows] + NOISE * np.random.default_rng(seed + 1).standard_normal(reading[rows].size)
    return time[rows], air[rows], read


def smoothed(time, reading):
    still = np.ones((time.size, 1))
    sensor = LagResponse(still, still / LAG_S, np.zeros(time.size))
    return estimate(time, reading, np.ones(time.size, dtype=bool), sensor, np.full(time.size, NOISE**2))


@pytest.mark.parametrize("begins_s", [101.1, 101.3, 101.5])
def test_a_ramp_that_two_readings_show_is_no_jump_before_the_second(begins_s):
    """4 s in rows 2 s apart: a jump just before a reading explains any value half way, so it was one."""
    time, air, reading = flown(4.0, 2.0, begins_s)
    off = smoothed(time, reading).air - air
    about = np.abs(time - begins_s - 2.0) < 6.0
    assert np.sqrt(np.mean(off[about] ** 2)) < 0.5 * np.sqrt(np.mean((reading - air)[about] ** 2))


@pytest.mark.parametrize("begins_s", [101.0, 101.3, 101.6])
def test_one_reading_half_way_leaves_open_what_the_air_did(begins_s):
    """4 s in rows 2.5 s apart: a jump and a ramp explain it, and neither is sure."""
    time, air, reading = flown(4.0, 2.5, begins_s)
    found = smoothed(time, reading)
    about = np.abs(time - begins_s - 2.0) < 6.0
    assert np.all(np.abs(found.air - air)[about] < 3.0 * np.sqrt(found.variance)[about] + 0.1)


@pytest.mark.parametrize("begins_s", [100.5, 100.95, 101.3])
def test_a_jump_between_two_readings_is_one(begins_s):
    """Nothing is read on the way: no ramp of one step takes its place."""
    time, air, reading = flown(0.0, 2.0, begins_s)
    found = smoothed(time, reading)
    assert np.sqrt(np.mean((found.air - air) ** 2)) < 0.03
