"""What the air may do between samples: turbulence with a -5/3 spectrum on a trend that bends, fitted to the flight
itself.

air = trend + sum_i u_i: trend an integrated random walk (power f^-4), u_i Ornstein-Uhlenbeck with variances
r_i^(-2/3) at rates r_i a factor apart, which together fall as f^(-5/3). Strengths by Whittle's likelihood of tapered
periodograms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.response import Response
from shockrig.analysis.flight.stepping import stepped

Array = NDArray[np.float64]
RATES_PER_S = np.array([0.03, 0.5, 8.0])
AIR_STATES = 2 + RATES_PER_S.size
AIR = np.array([1.0, 0.0] + [1.0] * RATES_PER_S.size)  # the air as a sum of its states
OU_VARIANCES = RATES_PER_S ** (-2.0 / 3.0)
# Turbulence goes on where samples and sensor no longer see it: two more rungs of the same ladder, as plain variance.
UNSEEN_VARIANCE = float(np.sum(np.array([128.0, 2048.0]) ** (-2.0 / 3.0)))
SHRINKAGE = 0.25  # ln of how far one segment's strengths lie from the typical one's
ROUNDS = 5
HANN_DEPENDENCE = 1.5  # a likelihood of tapered ordinates counts each as so much less than one


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
    """Strengths, arrays of one shape: `turbulence` [unit], `bend` [unit / s^1.5], `noise` [unit], one sigma
    each."""

    turbulence: Array
    bend: Array
    noise: Array


def transition(step_s: Array) -> Array:
    """Transition of the air's states over each step, shape (..., 5, 5)."""
    step_s = np.asarray(step_s, dtype=float)
    a = np.zeros((*step_s.shape, AIR_STATES, AIR_STATES))
    a[..., 0, 0] = a[..., 1, 1] = 1.0
    a[..., 0, 1] = step_s
    for i, rate in enumerate(RATES_PER_S):
        a[..., 2 + i, 2 + i] = np.exp(-rate * step_s)
    return a


def innovation(step_s: Array, prior: Prior) -> Array:
    """Covariance that each step adds to the air's states, shape (..., 5, 5); `prior` broadcasts with `step_s`."""
    step_s = np.asarray(step_s, dtype=float)
    bend, turbulence = prior.bend**2, prior.turbulence**2
    q = np.zeros((*np.broadcast_shapes(step_s.shape, bend.shape), AIR_STATES, AIR_STATES))
    q[..., 0, 0] = bend * step_s**3 / 3
    q[..., 0, 1] = q[..., 1, 0] = bend * step_s**2 / 2
    q[..., 1, 1] = bend * step_s
    for i, (rate, variance) in enumerate(zip(RATES_PER_S, OU_VARIANCES, strict=True)):
        q[..., 2 + i, 2 + i] = -turbulence * variance * np.expm1(-2 * rate * step_s)
    return q


def spectra(frequency_hz: Array, period_s: float) -> tuple[Array, Array]:
    """One-sided power of sampled turbulence and of the sampled trend at unit strength [1/Hz], shapes of
    `frequency_hz`."""
    z = np.exp(2j * np.pi * frequency_hz * period_s)
    turbulence = np.zeros(np.shape(frequency_hz))
    for rate, variance in zip(RATES_PER_S, OU_VARIANCES, strict=True):
        decay = np.exp(-rate * period_s)
        turbulence += variance * (1 - decay**2) / np.abs(z - decay) ** 2
    bend = period_s**3 * (2 + z.real) / 3 / np.abs(z - 1) ** 4
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


def gain_squared(response: Response, frequency_hz: Array, period_s: float) -> Array:
    """|H|^2 from the sampled air, straight between samples, to the reading: (n, f) for n instants."""
    z = np.exp(2j * np.pi * frequency_hz * period_s)
    step = stepped(response.rate, np.array(period_s), response.cap, response.inside)
    driven = step.old[..., None] + step.new[..., None] * z
    if count := len(response.cap):
        outer = driven[:, :count] / (z - step.decay[:, :count, None])
        driven[:, response.within] += np.einsum("nmj,njf->nmf", step.fed, outer)
    h = np.einsum("nk,nkf->nf", response.weight, driven / (z - step.decay[..., None]))
    return np.abs(h) ** 2


def seen(response: Response, frequency_hz: Array, period_s: float, parts: int = 1) -> tuple[Array, Array]:
    """One-sided power (n, f) of the readings of turbulence and of the trend at unit strength, n instants.

    The air is straight over each of the `parts` of a period; what is faster than the readings folds back into them.
    """
    turbulence, bend = np.zeros((2, len(response.rate), np.size(frequency_hz)))
    for fold in range(parts):
        at = frequency_hz + fold / period_s
        gain = gain_squared(response, at, period_s / parts)
        one, other = spectra(at, period_s / parts)
        turbulence, bend = turbulence + gain * one, bend + gain * other
    return turbulence, bend


def fit_prior(
    reading: Array,
    response: Response,
    period_s: float,
    noise: float,
    passing: Passing | None = None,
    *,
    spread: float,
    relative_noise: Array | float = 1.0,
    parts: int = 1,
) -> Prior:
    """Strengths of the typical stretch of a flight: Whittle's likelihood of the median over segments of their power.

    Parameters
    ----------
    reading : (s, n)
        Segments of readings, gaps bridged.
    response : Response
        With a row for each segment.
    noise : float
        The noise floor expected, known within a factor exp(`spread`).
    passing : Passing, optional
        With `sigma` for each segment.
    relative_noise : (s,), optional
        Noise of each segment over the flight's.
    parts : int
        Into how many straight pieces the air between two readings is cut.
    """
    from scipy.optimize import minimize

    frequency, power, weight = _periodograms(reading, period_s)
    turbulence, bend = seen(response, frequency, period_s, parts)
    white = 2 * period_s
    known = np.zeros((1, frequency.size)) if passing is None else passing_spectrum(passing, frequency, period_s)
    # in units of each segment's noise, so that all have the same
    own = np.broadcast_to(np.square(relative_noise), len(reading))[:, None]
    power, turbulence, bend, known = (each / own for each in (power, turbulence, bend, known))
    if len(power) >= 3:
        # one front does not speak for the whole flight; the median of a mean of squares lies below its mean
        power = np.median(power, axis=0, keepdims=True) / (1 - 1 / (9 * _independent(weight))) ** 3
        turbulence, bend, known = (np.median(s, axis=0, keepdims=True) for s in (turbulence, bend, known))
        weight = weight * len(reading) / 2
    low_t, low_b = _weakest(turbulence, bend, noise**2 * white)

    shapes = np.stack([turbulence, bend, np.full_like(bend, white)])

    def cost(p: Array) -> tuple[float, Array]:
        each = np.exp(2 * p)[:, None, None] * shapes
        model = each.sum(axis=0) + known
        off = (p[2] - np.log(noise)) / spread
        slope = 2 * np.sum(weight * (1 - power / model) / model * each, axis=(1, 2))
        slope[2] += off / spread
        return float(np.sum(weight * (np.log(model) + power / model))) + 0.5 * off**2, slope

    mean_power = np.average(power, axis=1, weights=weight).mean()
    high_t, high_b = (0.5 * np.log(mean_power / np.median(s)) + 3.0 for s in (turbulence, bend))
    bounds = [(low_t, max(high_t, low_t + 1)), (low_b, max(high_b, low_b + 1)), np.log(noise) + np.array([-2.0, 2.0])]
    lowest, found = np.inf, np.zeros(3)
    for share_t in (0.1, 0.7):
        for share_b in (0.1, 0.5, 0.8):
            x0 = [b[0] + share * (b[1] - b[0]) for b, share in zip(bounds, (share_t, share_b, 0.5), strict=True)]
            end = minimize(cost, x0, method="L-BFGS-B", jac=True, bounds=bounds)
            if end.fun < lowest - 1e-3:
                lowest, found = float(end.fun), end.x
    turbulent, bent, noisy = np.exp(found)
    return Prior(turbulent, bent, noisy)


def fit_windows(
    reading: Array,
    response: Response,
    period_s: float,
    common: Prior,
    passing: Passing | None = None,
    relative_noise: Array | float = 1.0,
    parts: int = 1,
) -> Prior:
    """Strengths of each segment (s, n) on its own, drawn towards the typical one; the noise is the flight's.

    The mean of ln strength over a grid, weighted by Whittle's likelihood and a Cauchy distribution of width
    SHRINKAGE about the segments' median, which starts at `common`: most stretches are alike, fronts are not.
    """
    frequency, power, weight = _periodograms(reading, period_s)
    turbulence, bend = seen(response, frequency, period_s, parts)
    known = 2 * period_s * common.noise**2 * np.broadcast_to(np.square(relative_noise), len(reading))[:, None]
    if passing is not None:
        known = known + passing_spectrum(passing, frequency, period_s)
    steps = np.linspace(-3.2, 10.4, 18)
    strength = np.exp(2 * steps)[:, None, None]
    centre = np.log([common.turbulence, common.bend])
    # the flight's strengths are those of its liveliest stretch; segments are drawn to the typical one instead
    for _ in range(ROUNDS):
        typical = np.exp(2 * centre)
        model = (typical[0] * turbulence * strength)[:, None] + (typical[1] * bend * strength)[None]
        model += known
        cost = np.einsum("ijsf,f->ijs", np.log(model) + power / model, weight)
        cost += np.log1p((steps[:, None, None] / SHRINKAGE) ** 2) + np.log1p((steps[:, None] / SHRINKAGE) ** 2)
        share = np.exp(-(cost - cost.min(axis=(0, 1))))
        share /= share.sum(axis=(0, 1))
        own = centre[:, None] + np.stack([np.einsum("ijs,i->s", share, steps), np.einsum("ijs,j->s", share, steps)])
        centre = np.median(own, axis=1)
    turbulent, bent = np.exp(own)
    return Prior(turbulent, bent, common.noise * np.ones(len(reading)))


def _independent(weight: Array) -> Array:
    """Independent ordinates that a bin's mean is worth; neighbours under a Hann taper correlate by 4/9, the next by
    1/36."""
    count = HANN_DEPENDENCE * weight
    return count**2 / (count + 2 * (count - 1) * 4 / 9 + 2 * np.maximum(count - 2, 0.0) / 36)


def _weakest(turbulence: Array, bend: Array, white: float) -> tuple[float, float]:
    """Logs of strengths so weak that their power stays a thousand times below the noise at every frequency."""
    first, second = (0.5 * float(np.log(1e-3 * white / s.max())) for s in (turbulence, bend))
    return first, second


def _periodograms(reading: Array, period_s: float) -> tuple[Array, Array, Array]:
    """Frequencies (b,), power (s, b) and weight (b,) of Hann-tapered periodograms gathered into bins a tenth of an
    octave wide."""
    from scipy.signal import detrend
    from scipy.signal.windows import hann

    size = reading.shape[-1]
    taper = hann(size, sym=False)
    spectrum = np.fft.rfft(detrend(reading, axis=-1) * taper, axis=-1)
    raw = 2 * period_s * np.abs(spectrum) ** 2 / np.sum(taper**2)
    first, last = 2, raw.shape[-1] - 1  # below, the taper and the detrending change the spectrum
    index = np.arange(first, last)
    bins = np.unique(np.floor(np.log2(index) * 8).astype(int), return_inverse=True)[1]
    weight = np.bincount(bins).astype(float)
    frequency = np.exp(np.bincount(bins, np.log(index / (size * period_s))) / weight)
    power = np.stack([np.bincount(bins, row[first:last]) / weight for row in raw])
    return frequency, power, weight / HANN_DEPENDENCE
