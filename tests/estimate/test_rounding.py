"""Rounded readings against a Monte Carlo: random places between two codes, noise, and what rounding makes of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from shockrig.analysis.estimate.noise import Noise, noise_before_rounding, rounded_autocovariance, rounding_covariance
from shockrig.analysis.estimate.without_model import rounding_step

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
    one_each = np.ones(40, dtype=int)
    own = rounding_covariance(signal, np.arange(40), one_each, gamma, STEP) + gamma[lag]
    assert own == pytest.approx(errors.T @ errors / 40_000, abs=1e-3)
    assert np.linalg.eigvalsh(own).min() > 0.0


def test_covariance_of_means_is_that_of_their_samples():
    signal, index = 3.0 * (1.0 - np.exp(-np.arange(40) / 12.0)), np.cumsum(np.resize([1, 1, 3], 40))
    gamma = unrounded(0.05, 0.03, 0.9, index[-1] + 3)
    count = np.array([1, 2, 4, 7, 11, 15])
    each = rounding_covariance(signal, index, np.ones(40, dtype=int), gamma, STEP)
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])
    summed = np.add.reduceat(np.add.reduceat(each, starts, axis=0), starts, axis=1)
    own = rounding_covariance(signal, index, count, gamma, STEP)
    assert own == pytest.approx(summed / np.multiply.outer(count, count), abs=1e-12)


def plunge(noise, low=2.4, high=25.1):
    """Readings every second of a sensor put into ice water."""
    time = np.arange(400.0)
    clean = low + (high - low) * np.exp(-np.clip(time - 200.0, 0.0, None) / 9.0)
    return clean + noise * np.random.default_rng(5).standard_normal(time.size)


def step_of(values):
    return rounding_step(SimpleNamespace(samples=((np.arange(len(values)), np.asarray(values)),)))


@pytest.mark.parametrize("ends", [(2.4, 25.1), (-10.0, 24.0), (38.0, 41.0)])
@pytest.mark.parametrize(("step", "digits"), [(1 / 16, 2), (1 / 8, 2), (1 / 128, 3)])
def test_a_step_printed_with_fewer_digits_than_it_has(step, digits, ends):
    shown = np.round(step * np.rint(plunge(step, *ends) / step), digits)
    assert step_of(shown) == pytest.approx(step, rel=2e-3)


def test_a_ds18b20_that_was_plunged():
    """Readings of TSENSOR_KiS.LOG, https://github.com/QuentinRauschenbach/Temperature_Logger, each once."""
    shown = """
    25.00 24.88 24.94 25.06 25.13 24.81 24.75 24.69 24.63 24.56 24.50 24.44 24.38 24.31 24.25 24.19 24.13 24.06
    24.00 23.94 23.88 23.81 23.75 22.88 20.38 18.13 16.31 14.88 13.69 12.69 11.81 11.00 10.25 9.63 9.06 8.63 8.19
    7.81 7.44 7.06 6.69 6.38 6.13 5.88 5.63 5.44 5.19 5.06 4.81 4.69 4.50 4.38 4.25 4.13 4.00 3.88 3.75 3.69 3.63
    3.56 3.50 3.44 3.38 3.31 3.25 3.19 3.13 3.06 3.00 2.94 2.88 2.81 2.69 2.63 2.56 2.50 2.44
    """
    assert step_of([float(value) for value in shown.split()]) == pytest.approx(1 / 16, rel=2e-3)


@pytest.mark.parametrize("noise", [0.001, 0.02, 0.3])
def test_no_step_is_seen_in_readings_with_few_digits(noise):
    assert step_of(np.round(plunge(noise), 2)) in (0.0, pytest.approx(0.01))
    assert step_of(plunge(noise)) == 0.0


@pytest.mark.parametrize(("scale", "zero"), [(1.017, -0.37), (500.0 / 1023.0 / 0.5, -50.0)])
def test_readings_calibrated_after_they_were_rounded(scale, zero):
    """Half degrees behind a calibration, and codes of a converter behind a sensor whose 0 V are -50 degC, stand
    evenly, but are no multiples of their step."""
    codes = 0.5 * np.rint(plunge(0.1) / 0.5)
    assert step_of(np.round(scale * codes + zero, 4)) == pytest.approx(0.5 * scale, rel=1e-3)
    assert step_of(scale * plunge(0.1) + zero) == 0.0  # never rounded
    assert step_of(np.array([20.0, 20.113, 20.29, 21.4, 22.37, 23.01, 24.67])) == 0.0  # few readings, by chance
