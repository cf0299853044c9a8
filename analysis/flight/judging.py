"""How to judge a flight's signal: power spectrum and its -5/3 line, structure function and its 2/3 line, Bode, RMSE.

D(tau) = mean (x(t + tau) - x(t))^2 ~ tau^(2/3) and S(f) ~ f^(-5/3) in the inertial range
(Kolmogorov 1941, Obukhov 1949).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.inverse import fir_taps, power_density, sampled, transfer_function
from shockrig.analysis.flight.response import LagResponse

Array = NDArray[np.float64]
SPECTRAL_SLOPE, STRUCTURE_SLOPE = -5.0 / 3.0, 2.0 / 3.0


def power_spectrum(values: Array, period_s: float, segment_s: float | None = None) -> tuple[Array, Array]:
    """One-sided power spectral density by Welch's method: frequency [Hz] (without 0) and power [unit^2/Hz]."""
    size = values.size if segment_s is None else min(values.size, round(segment_s / period_s))
    frequency, power = power_density(values, period_s, size)
    return frequency[1:], power[1:]


def gathered(x: Array, y: Array, per_decade: int = 12) -> tuple[Array, Array]:
    """Means of y in bins of equal width in log x, at the bins' mean log x."""
    bins = np.floor(np.log10(x) * per_decade).astype(int)
    _, place = np.unique(bins, return_inverse=True)
    count = np.bincount(place)
    return np.exp(np.bincount(place, np.log(x)) / count), np.bincount(place, y) / count


def slope(x: Array, y: Array, low: float, high: float) -> float:
    """Exponent of y ~ x^slope between `low` and `high`, each decade counting alike; NaN with fewer than three bins."""
    x, y = gathered(x, y)
    inside = (x >= low) & (x <= high) & (y > 0)
    if np.count_nonzero(inside) < 3:
        return float("nan")
    return float(np.polyfit(np.log(x[inside]), np.log(y[inside]), 1)[0])


def structure_function(values: Array, period_s: float, count: int = 40) -> tuple[Array, Array]:
    """Second-order structure function at lags [s] spread evenly in their logarithm, up to a quarter of the series."""
    lags = np.unique(np.geomspace(1, max(values.size // 4, 2), count).astype(int))
    return lags * period_s, np.array([np.mean((values[lag:] - values[:-lag]) ** 2) for lag in lags])


@dataclass(frozen=True)
class Bode:
    """Gains (complex) at `frequency_hz`: the sensor, its sampled form, the sampled inverse, the inverse behind its
    low-pass.
    """

    frequency_hz: Array
    continuous: NDArray[np.complex128]
    sampled: NDArray[np.complex128]
    inverse: NDArray[np.complex128]
    corrected: NDArray[np.complex128]


def bode(response: LagResponse, period_s: float, cutoff_hz: float, row: int = 0, count: int = 400) -> Bode:
    """Bode diagram of one instant's response, up to half the sampling rate."""
    frequency = np.geomspace(1e-3, 0.4999 / period_s, count)
    # an advance of half a sample, since held air acts so much later
    advance = np.exp(1j * np.pi * frequency * period_s)
    held = transfer_function(sampled(response, period_s, row), frequency * period_s) * advance
    taps = fir_taps(100_000, period_s, cutoff_hz)
    place = np.arange(taps.size) - taps.size // 2
    filtered = np.real(np.exp(-2j * np.pi * np.outer(frequency * period_s, place)) @ taps)
    return Bode(frequency, response.clean(frequency, row), held, 1 / held, filtered**2 / held)


def rmse(estimate: Array, truth: Array) -> float:
    """Root-mean-square error over the rows where both are known."""
    return float(np.sqrt(np.nanmean((estimate - truth) ** 2)))


def coverage(estimate: Array, uncertainty: Array, truth: Array, sigmas: float = 1.96) -> float:
    """Share of the known rows whose interval holds the truth."""
    known = np.isfinite(estimate) & np.isfinite(uncertainty)
    return float(np.mean(np.abs(estimate - truth)[known] <= sigmas * uncertainty[known]))


def mean_of(values: Sequence[float]) -> float:
    """Mean without NaN."""
    known = [v for v in values if v == v]
    return float(np.mean(known)) if known else float("nan")
