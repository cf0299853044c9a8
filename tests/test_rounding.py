"""Rounded readings against a Monte Carlo: random places between two codes, noise, and what rounding makes of it."""

import numpy as np
import pytest

from shockrig.analysis.inference.noise import Noise
from shockrig.analysis.inference.rounding import noise_before_rounding, rounded_autocovariance, rounding_covariance

STEP = 0.5


def rounded(signal, sigma_white, sigma_slow, memory, draws, seed):
    """Errors (draws, n) of `signal` (n,) at random places between two codes, with white and AR(1) noise, rounded."""
    rng = np.random.default_rng(seed)
    n = signal.size
    slow = np.empty((draws, n))
    slow[:, 0] = rng.standard_normal(draws)
    for i in range(1, n):
        slow[:, i] = memory * slow[:, i - 1] + np.sqrt(1 - memory**2) * rng.standard_normal(draws)
    exact = signal + rng.uniform(0.0, STEP, (draws, 1))
    noisy = exact + sigma_white * rng.standard_normal((draws, n)) + sigma_slow * slow
    return STEP * np.rint(noisy / STEP) - exact


def unrounded(sigma_white, sigma_slow, memory, lags):
    return Noise(sigma_white, sigma_slow, memory, 1, 0.0, 1, np.zeros(1)).autocovariance(lags)


@pytest.mark.parametrize("sigma", [0.01, 0.05, 0.2])
def test_noise_is_found_from_what_flips(sigma):
    errors = rounded(np.zeros(40), sigma, 0.0, 0.0, 60_000, 1)
    variance = errors.var(axis=1, ddof=1).mean()
    assert noise_before_rounding(variance, STEP) == pytest.approx(sigma, rel=0.04)
    if sigma == 0.01:
        assert variance == pytest.approx(STEP * sigma / np.sqrt(np.pi), rel=0.04)  # little noise: q sigma / sqrt(pi)


def test_autocovariance_of_a_rounded_plateau():
    errors = rounded(np.zeros(60), 0.04, 0.04, 0.95, 30_000, 2)
    gamma = unrounded(0.04, 0.04, 0.95, 60)
    shown = [np.mean(errors[:, 0] * errors[:, lag]) for lag in (0, 1, 5, 20, 59)]
    expected = rounded_autocovariance(gamma, STEP)[[0, 1, 5, 20, 59]]
    assert expected == pytest.approx(shown, abs=5e-4)
    assert gamma[20] < 0.1 * expected[3]  # the place between two codes is remembered when the noise is forgotten


def test_covariance_of_a_rounded_transient():
    signal = 3.0 * (1.0 - np.exp(-np.arange(40) / 12.0))
    errors = rounded(signal, 0.05, 0.03, 0.9, 40_000, 3)
    gamma = unrounded(0.05, 0.03, 0.9, 40)
    lag = np.abs(np.subtract.outer(np.arange(40), np.arange(40)))
    own = rounding_covariance(signal, lag, gamma, STEP) + gamma[lag]
    assert own == pytest.approx(errors.T @ errors / 40_000, abs=1e-3)
    assert np.linalg.eigvalsh(own).min() > 0.0
