"""The low-pass of the two inverses: it stops where a reading sinks into its noise, and has no phase."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def power_density(values: Array, period_s: float, size: int) -> tuple[Array, Array]:
    """One-sided power spectral density by Welch's method, trends taken off: frequency [Hz], power [unit^2/Hz]."""
    from scipy.signal import detrend, welch  # takes longer to import than the smoother takes for a flight

    frequency, power = welch(values, 1 / period_s, nperseg=size, detrend=detrend)
    return np.asarray(frequency), np.asarray(power)


def suggest_cutoff_hz(reading: Array, period_s: float, noise: float) -> float:
    """Frequency above which the reading's power spectrum lies on its noise floor.

    The floor is the median of the highest 30 % of frequencies, if that is no more than four times the power of the
    noise expected; else the noise expected. The cut-off is where the smoothed spectrum first falls below twice the
    floor.
    """
    size = min(reading.size, max(256, reading.size // 4))
    frequency, power = power_density(reading, period_s, size)
    expected = 2 * period_s * noise**2
    seen = float(np.median(power[frequency > 0.7 * frequency[-1]])) / 0.97
    floor = seen if seen < 4 * expected else expected
    width = np.maximum(1, np.arange(power.size) // 8)
    total = np.concatenate([[0.0], np.cumsum(power)])
    low, high = np.maximum(np.arange(power.size) - width, 0), np.minimum(np.arange(power.size) + width + 1, power.size)
    smoothed = (total[high] - total[low]) / (high - low)
    below = np.flatnonzero((smoothed < 2 * floor) & (frequency > 0))
    cutoff = frequency[below[0]] if below.size else frequency[-1]
    return float(np.clip(cutoff, 4.0 / (reading.size * period_s), 0.8 * frequency[-1]))


def low_pass(values: Array, period_s: float, cutoff_hz: float) -> Array:
    """Zero-phase FIR low-pass (windowed sinc, symmetric), the ends continued by point reflection."""
    taps = fir_taps(values.size, period_s, cutoff_hz)
    half = taps.size // 2
    padded = np.pad(values, half, mode="reflect", reflect_type="odd")
    return np.convolve(padded, taps, mode="valid")


def fir_taps(count: int, period_s: float, cutoff_hz: float) -> Array:
    """Taps of the low-pass for a series of `count` values: four periods of the cut-off long, odd, of unit sum."""
    from scipy.signal import firwin

    length = min(int(4.0 / (cutoff_hz * period_s)), (count - 1) // 2) // 2 * 2 + 1
    return firwin(max(length, 3), cutoff_hz, fs=1 / period_s)
