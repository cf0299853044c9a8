"""Airs that somebody wrote down, against readings at rest in them."""

import numpy as np
import pytest

from shockrig.analysis.estimate.gather import scatter_of_stated

PROMISED_K = 0.02


@pytest.mark.parametrize("seed", range(10))
def test_airs_that_are_off_are_found_to_be_and_good_ones_are_believed(seed):
    rng = np.random.default_rng(seed)
    true = rng.uniform(0.0, 40.0, 12)
    reading = 0.3 + 1.02 * true + rng.normal(0.0, 0.01, true.size)  # a calibration of its own
    good = scatter_of_stated(reading, true + rng.normal(0.0, PROMISED_K, true.size), PROMISED_K)
    assert good == PROMISED_K
    off = scatter_of_stated(reading, true + rng.normal(0.0, 0.4, true.size), PROMISED_K)
    assert 0.5 < off / 0.4 < 1.7


def test_three_runs_contradict_nobody():
    assert scatter_of_stated(np.array([20.0, 21.0, 22.0]), np.array([23.0, 20.0, 19.0]), PROMISED_K) == PROMISED_K
