"""Logs whose rows are not evenly spaced: packets that were lost, a log of two paces. The air went on meanwhile."""

import numpy as np
import pytest

from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.simulated.scenes import to_flight
from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import FINE_STEP_S, Weather

PROFILE = typical_profile()
DURATION_S = 240.0


def layers(seed):
    """Calm layers one above another, two minutes of them."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(DURATION_S / FINE_STEP_S) + 1) * FINE_STEP_S
    ends = np.repeat(np.arange(30.0, DURATION_S, 30.0), 2) + np.tile([0.0, 4.0], 7)
    temperature = np.interp(time, ends, np.repeat(rng.uniform(15.0, 22.0, 8), 2)[1:-1])
    humidity = np.interp(time, ends, np.repeat(rng.uniform(35.0, 65.0, 8), 2)[1:-1])
    still = np.ones(time.size)
    return Weather("layers", time, temperature, humidity, 5.0 * still, 1013.25 * still, 2.0 * time)


def some(flown, kept):
    log = flown.log[kept].reset_index(drop=True)
    truth = flown.truth[kept].reset_index(drop=True)
    return to_flight(log), truth


def lost(size, share, seed=5):
    return np.random.default_rng(seed).random(size) > share


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_lies_between_rows_that_are_apart_is_no_change_of_the_sensor(seed):
    """Three rows in five lost: a layer's edge went by in one step, which was the sensor's own; up to 1.7 %RH unsure."""
    flown = fly(layers(seed), PROFILE, 3)
    done = correct(some(flown, lost(len(flown.log), 0.6))[0], PROFILE)
    assert not any("the sensor changed" in note for note in done.notes)
    assert np.median(done.temperature_uncertainty_k) < 0.03


@pytest.mark.parametrize("seed", [2, 3])
def test_a_steady_change_over_rows_that_are_apart_is_none_of_the_thermometer_alone(seed):
    """Four rows in five lost: up to 4 K of sun or ice, without which the humidity was corrected."""
    flown = fly(layers(seed), PROFILE, 3)
    done = correct(some(flown, lost(len(flown.log), 0.8))[0], PROFILE)
    assert not any("without the humidity" in note for note in done.notes)
