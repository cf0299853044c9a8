"""The logger's link: noise, running mean, resolution, repeated readings, interference, late and fast clocks.

A reading taken at stamp t shows the sensor at (t - origin) / (1 + ppm 1e-6) + origin - delay; then noise, then the
mean of the last readings, then rounding, then repetition. Noise is white plus first-order autoregressive, e' = e
exp(-dt / tau) + sqrt(1 - exp(-2 dt / tau)) w.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from shockrig.rig.virtual.effects import T
from shockrig.rig.virtual.truth import TrueNoise, Truth

N = TypeVar("N", float, NDArray[Any])  # one time, or several


def seen_at_s(truth: Truth, channel: str, time_s: N, origin_s: float = 0.0) -> N:
    """True time at which the sensor shows what is stamped `time_s`; the stamps' clock agreed with the true one at
    `origin_s`.
    """
    if p := truth.effect("clock_drift", channel):
        time_s = origin_s + (time_s - origin_s) / (1.0 + p["ppm"] * 1e-6)
    if p := truth.effect("dead_time", channel):
        time_s = time_s - p["delay_s"]
    return time_s


class Logger:
    """One channel's logger, fed in the order of time; it remembers its last readings."""

    def __init__(self, truth: Truth, channel: str, rng: np.random.Generator):
        self._rng = rng
        self._noise: TrueNoise = truth.temperature_noise if channel == T else truth.humidity_noise
        step = truth.temperature_step_k if channel == T else truth.humidity_step_percent
        self._step = (truth.effect("quantization", channel) or {"step": step})["step"]
        self._hold = int(round((truth.effect("stale_samples", channel) or {"hold_samples": 1})["hold_samples"]))
        width = (truth.effect("moving_average", channel) or {"samples": 1})["samples"]
        self._last: deque[float] = deque(maxlen=max(1, int(round(width))))
        self._hum = truth.effect("unknown_interference", channel)
        self._phase = rng.uniform(0.0, 2.0 * np.pi)
        self._correlated: float | None = None
        self._time_s = 0.0
        self._burst_until_s = -np.inf
        self._count = int(rng.integers(self._hold)) if self._hold > 1 else 0
        self._held: float | None = None

    def log(self, time_s: np.ndarray, exact: np.ndarray) -> np.ndarray:
        """What is logged where the exact readings would be `exact` (n,) at `time_s` (n,)."""
        noisy = exact + self._noise.white * self._rng.standard_normal(time_s.size) + self._autocorrelated(time_s)
        if self._hum:
            noisy = noisy + self._interference(self._hum, time_s)
        if self._last.maxlen == 1 and self._hold == 1:
            return self._round(noisy)
        logged = np.empty_like(noisy)
        for i, reading in enumerate(noisy):
            self._last.append(reading)
            if self._held is None or self._count % self._hold == 0:
                self._held = float(self._round(np.asarray(np.mean(self._last))))
            self._count += 1
            logged[i] = self._held
        return logged

    def _round(self, reading: np.ndarray) -> np.ndarray:
        return np.round(reading / self._step) * self._step if self._step > 0.0 else reading

    def _autocorrelated(self, time_s: np.ndarray) -> np.ndarray:
        out = np.zeros(time_s.size)
        if self._noise.correlated == 0.0:
            return out
        for i, (time, draw) in enumerate(zip(time_s, self._rng.standard_normal(time_s.size), strict=True)):
            if self._correlated is None:
                self._correlated = draw
            else:
                kept = np.exp(-(time - self._time_s) / self._noise.correlation_time_s)
                self._correlated = kept * self._correlated + np.sqrt(1.0 - kept * kept) * draw
            self._time_s = time
            out[i] = self._correlated
        return self._noise.correlated * out

    def _interference(self, p: Mapping[str, float], time_s: np.ndarray) -> np.ndarray:
        """Mains hum, aliased by the sampling, and bursts of a second or so in which it is ten times stronger."""
        hum = p["amplitude"] * np.sin(2.0 * np.pi * p["hum_hz"] * time_s + self._phase)
        for i, (time, draw) in enumerate(zip(time_s, self._rng.random(time_s.size), strict=True)):
            if draw < p["burst_share"] / 10.0:  # at 10 Hz a burst of a second spans ten readings
                self._burst_until_s = time + 1.0
            if time < self._burst_until_s:
                hum[i] *= 10.0
        return hum
