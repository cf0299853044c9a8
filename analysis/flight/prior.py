"""What the air may do between samples: turbulence with a -5/3 spectrum on a trend that bends.

air = trend + sum_i u_i: trend an integrated random walk (power f^-4; f^-6, integrated once more, where the air's course
is smooth: waves), u_i Ornstein-Uhlenbeck with variances r_i^(-2/3) at rates r_i a factor apart, which together fall as
f^(-5/3). How strong they are, and which trend it is, a flight says itself (`strengths`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import factorial

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.response import LagResponse, stepped

Array = NDArray[np.float64]
RATES_PER_S = np.array([0.03, 0.5, 8.0])
TREND_STATES = 3  # level, slope, curvature
AIR_STATES = TREND_STATES + RATES_PER_S.size
AIR = np.array([1.0, 0.0, 0.0] + [1.0] * RATES_PER_S.size)  # the air as a sum of its states
OU_VARIANCES = RATES_PER_S ** (-2.0 / 3.0)
# Turbulence goes on where samples and sensor no longer see it: two more rungs of the same ladder, as plain variance.
UNSEEN_VARIANCE = float(np.sum(np.array([128.0, 2048.0]) ** (-2.0 / 3.0)))


@dataclass(frozen=True)
class Passing:
    """Something that reaches the reading and the air alike, without lag: `sigma` (...) [unit], about `rate` [1/s].

    In humidity it is what the air's temperature leaves open: the reading and the corrected value are divided by the
    same saturation pressure, while the film between them never felt it. That is the part of turbulence beyond the
    bead's resolution, so its power is rate^3 w^2 / (w^2 + rate^2)^2: the speed of a critically damped swing. Vapour
    is carried by the same eddies: `coupling` times it is in the air besides, and that share does lag.
    """

    sigma: Array
    rate: float
    coupling: float = 0.0


@dataclass(frozen=True)
class Prior:
    """Strengths, arrays of one shape: `turbulence` [unit], `bend` [unit / s^1.5], `noise` [unit], one sigma each.

    Where the air's course is `smooth`, it is the trend's curvature that walks and not its slope: power f^-6 and not
    f^-4, and `bend` is in unit / s^2.5.
    """

    turbulence: Array
    bend: Array
    noise: Array
    smooth: bool = field(default=False, kw_only=True)

    def each(self, of: Callable[[Array], Array]) -> Prior:
        """The same with a function taken of each strength."""
        return Prior(of(self.turbulence), of(self.bend), of(self.noise), smooth=self.smooth)


def transition(step_s: Array) -> Array:
    """Transition of the air's states over each step, shape (..., 6, 6)."""
    step_s = np.asarray(step_s, dtype=float)
    a = np.zeros((*step_s.shape, AIR_STATES, AIR_STATES))
    a[..., 0, 0] = a[..., 1, 1] = a[..., 2, 2] = 1.0
    a[..., 0, 1] = a[..., 1, 2] = step_s
    a[..., 0, 2] = step_s**2 / 2
    for i, rate in enumerate(RATES_PER_S):
        a[..., TREND_STATES + i, TREND_STATES + i] = np.exp(-rate * step_s)
    return a


def innovation(step_s: Array, prior: Prior) -> Array:
    """Covariance that each step adds to the air's states, shape (..., 6, 6); `prior` broadcasts with `step_s`."""
    step_s = np.asarray(step_s, dtype=float)
    bend, turbulence = prior.bend**2, prior.turbulence**2
    q = np.zeros((*np.broadcast_shapes(step_s.shape, bend.shape), AIR_STATES, AIR_STATES))
    last = 2 if prior.smooth else 1  # the walk's steps are of this derivative
    for i in range(last + 1):
        for j in range(last + 1):
            power = 2 * last - i - j + 1
            of_each = factorial(last - i) * factorial(last - j)
            q[..., i, j] = bend * step_s**power / (power * of_each)
    for i, (rate, variance) in enumerate(zip(RATES_PER_S, OU_VARIANCES, strict=True)):
        q[..., TREND_STATES + i, TREND_STATES + i] = -turbulence * variance * np.expm1(-2 * rate * step_s)
    return q


def spectra(frequency_hz: Array, period_s: float, smooth: bool = False) -> tuple[Array, Array]:
    """One-sided power of sampled turbulence and of the sampled trend at unit strength [1/Hz], shapes of
    `frequency_hz`."""
    z = np.exp(2j * np.pi * frequency_hz * period_s)
    turbulence = np.zeros(np.shape(frequency_hz))
    for rate, variance in zip(RATES_PER_S, OU_VARIANCES, strict=True):
        decay = np.exp(-rate * period_s)
        turbulence += variance * (1 - decay**2) / np.abs(z - decay) ** 2
    bend = period_s**3 * (2 + z.real) / 3 / np.abs(z - 1) ** 4
    if smooth:
        bend = period_s**5 * (33 + 26 * z.real + (z**2).real) / 60 / np.abs(z - 1) ** 6
    return 2 * period_s * turbulence, 2 * period_s * bend


def passing_spectrum(passing: Passing, frequency_hz: Array, period_s: float) -> Array:
    """One-sided power of a sampled Passing, shape (..., f); what lies beyond half the sampling rate folds back."""
    total = np.zeros(np.shape(frequency_hz))
    for fold in range(5):
        for f in {0: (frequency_hz,)}.get(fold, (fold / period_s - frequency_hz, fold / period_s + frequency_hz)):
            w = (2 * np.pi * f) ** 2
            total += 8 * passing.rate * w / (w + passing.rate**2) ** 2
    return passing.sigma[..., None] ** 2 * total


def passing_step(passing: Passing, step_s: Array) -> tuple[Array, Array]:
    """Transition of (place, speed) over each step and the covariance it adds, (..., 2, 2); the speed is what passes."""
    r, x = passing.rate, passing.rate * np.asarray(step_s, dtype=float)
    phi = np.empty((*x.shape, 2, 2))
    phi[..., 0, 0], phi[..., 0, 1] = 1 + x, x / r
    phi[..., 1, 0], phi[..., 1, 1] = -r * x, 1 - x
    phi *= np.exp(-x)[..., None, None]
    rest = np.diag([1 / r**2, 1.0])
    return phi, passing.sigma[..., None, None] ** 2 * (rest - phi @ rest @ phi.swapaxes(-1, -2))


def gain_squared(response: LagResponse, frequency_hz: Array, period_s: float) -> Array:
    """|H|^2 from the sampled air, straight between samples, to the reading: (n, f) for n instants."""
    z = np.exp(2j * np.pi * frequency_hz * period_s)
    step = stepped(response.rate, np.array(period_s), response.cap, response.inside)
    driven = step.old[..., None] + step.new[..., None] * z
    if count := len(response.cap):
        outer = driven[:, :count] / (z - step.decay[:, :count, None])
        driven[:, response.within] += np.einsum("nmj,njf->nmf", step.fed, outer)
    h = np.einsum("nk,nkf->nf", response.weight, driven / (z - step.decay[..., None]))
    return np.abs(h) ** 2
