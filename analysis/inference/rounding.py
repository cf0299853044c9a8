"""The error of readings rounded to a step that is coarse beside their noise: no white noise, but a sawtooth of the
signal.

A run's plateau stands at one code for all its length, and a slow creep crosses codes one after the other, so that the
error of one reading says much about the next. With each run's place between two codes unknown (uniform), and Gaussian
noise of autocovariance gamma before rounding, readings i and j of a signal y, l apart, have the covariance (after
Widrow and Kollar 2008, Quantization Noise, 10.1017/CBO9780511754661)

    gamma_l + sum_k q^2 / (2 pi^2 k^2) exp(-(2 pi k / q)^2 (gamma_0 - gamma_l)) cos(2 pi k (y_i - y_j) / q).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HARMONICS = 24
COARSE_IN_NOISE = 2.0  # below this step in units of the noise the error is as good as white


def rounding_covariance(signal: Array, lag: NDArray[np.int64], gamma: Array, step: float) -> Array:
    """Covariance (n, n) [unit^2] of what rounding to `step` adds to the errors of a run's samples.

    `signal` (n,) is the reading without noise and rounding [channel's unit], known to a fraction of a step; the samples
    are `lag` (n, n) apart, their noise has the autocovariance `gamma` (lags,) before it is rounded.
    """
    decays = _decays(gamma, step)
    phase = 2.0 * np.pi / step * signal
    at = np.minimum(lag, gamma.size - 1)
    total = np.zeros(lag.shape)
    told = decays[:, 1:].max(axis=1) > 1e-4 * step**2  # the others are as good as white
    for k in np.flatnonzero(told) + 1:
        decay = decays[k - 1]
        wave = np.stack([np.cos(k * phase), np.sin(k * phase)], axis=-1)
        total += decay[at] * (wave @ wave.T)
    total[np.diag_indices_from(total)] += step**2 / 12.0 - decays[told, 0].sum()
    return total


def rounded_autocovariance(gamma: Array, step: float) -> Array:
    """Autocovariance [unit^2] of rounded readings of a signal that rests, over all its places between two codes."""
    decays = _decays(gamma, step)
    out = gamma + decays.sum(axis=0)
    out[0] += step**2 / 12.0 - decays[:, 0].sum()
    return out


def _decays(gamma: Array, step: float) -> Array:
    """Covariance of each harmonic by lag (K, lags) [unit^2]."""
    k = np.arange(1, HARMONICS + 1)[:, np.newaxis]
    return step**2 / (2.0 * np.pi**2 * k**2) * np.exp(-((2.0 * np.pi * k / step) ** 2) * (gamma[0] - gamma))


def noise_before_rounding(variance: float, step: float) -> float:
    """White noise [unit] that, rounded to `step`, varies by `variance` [unit^2] about a plateau's mean, over all its
    places between two codes.

    Solves sigma^2 + sum_k q^2 / (2 pi^2 k^2) (1 - exp(-(2 pi k sigma / q)^2)) = variance, which for little noise is
    q sigma / sqrt(pi).
    """
    from scipy.optimize import brentq  # a fifth of a second, which no correction of a flight needs

    k = np.arange(1, 400)

    def excess(sigma: float) -> float:
        shown = -np.expm1(-((2.0 * np.pi * k * sigma / step) ** 2)) / (2.0 * np.pi**2 * k**2)
        return sigma**2 + step**2 * float(shown.sum()) - variance

    low, high = 1e-4 * step, np.sqrt(variance) + 1e-3 * step
    return low if excess(low) >= 0 else float(brentq(excess, low, high))
