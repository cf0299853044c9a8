"""Linear responses that are sums of exponentials: S(t) = 1 + sum_k a_k exp(-lambda_k t) to a unit step of the air.

What air that steps, ramps or decays makes of them, also where a logger writes the mean of its last readings (the sum of
exp(-lambda t) over equally spaced readings is a geometric series, so a mean costs one evaluation), and first-order lags
beside them or in series with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

DIED_OUT = 20.0  # exp(-20) of a mode is nothing
SHORTEST_S = 1e-6  # a ramp shorter than this is a step
APART = 3e-5  # relative distance of two rates from which partial fractions keep ten digits


@dataclass(frozen=True)
class Modes:
    """A response to a unit step of the air: S(t) = 1 + sum_k amplitude_k exp(-rate_k t) for t > 0, and 0 before.

    Every response takes `samples` and `period_s`: the mean of the readings at t, t - period_s, ... is then given, as
    a logger writes it that averages its last `samples` readings.

    Attributes
    ----------
    amplitude, rate : ndarray, shape (..., K)
        Amplitudes [1] and rates [1/s], ascending in k; leading axes broadcast (candidates, runs).
    """

    amplitude: Array
    rate: Array

    def scaled(self, per_second: ArrayLike) -> Modes:
        """Modes with dimensionless rates multiplied by alpha/R^2 or D/L^2 [1/s] (shape of the leading axes)."""
        return Modes(self.amplitude, self.rate * np.asarray(per_second, dtype=float)[..., None])

    def step(self, t: Array, *, samples: int = 1, period_s: float = 1.0) -> Array:
        """Response at times t [s] (shape (..., n)) to a unit step at 0."""
        risen, first = _readings_after(t, samples, period_s)
        return (risen + self._sum(first, risen, samples, period_s)) / samples

    def integral(self, t: Array, *, samples: int = 1, period_s: float = 1.0) -> Array:
        """Integral of the step response from 0 to t [s]: the response to a unit ramp."""
        risen, first = _readings_after(t, samples, period_s)
        return self._rising(first, risen, samples, period_s) / samples

    def ramp(self, t: Array, duration_s: ArrayLike, *, samples: int = 1, period_s: float = 1.0) -> Array:
        """Response to air that goes straight from 0 to 1 in `duration_s` (broadcast with t[..., 0]); zero is a step."""
        duration = np.maximum(np.asarray(duration_s, dtype=float), SHORTEST_S)[..., None]
        # After the ramp each mode has been driven for its whole length; while it lasts the response is the integral.
        turns = self.rate * duration
        late, since = _readings_after(t - duration, samples, period_s)
        risen, first = _readings_after(t, samples, period_s)
        after = late + self._sum(since, late, samples, period_s, -np.expm1(-turns) / turns)
        return (after + self._rising(first, risen - late, samples, period_s) / duration) / samples

    def exponential(
        self,
        t: Array,
        time_constant_s: ArrayLike,
        duration_s: ArrayLike | None = None,
        *,
        samples: int = 1,
        period_s: float = 1.0,
    ) -> Array:
        """Response to air exp(-t / time_constant) for t > 0, 0 before; with `duration_s` let in by a ramp from 0 to 1.

        With g = lambda - kappa, a mode's share after the ramp T is (exp(-lambda T) - exp(-kappa T)) / (T g^2)
        exp(-lambda (t - T)) + exp(-kappa t) / g, and while it lasts (exp(-kappa t) (t / g - 1 / g^2) + exp(-lambda t)
        / g^2) / T.
        """
        kappa = 1.0 / np.asarray(time_constant_s, dtype=float)[..., None]
        gap = self.rate - kappa
        gap = np.where(np.abs(gap) < 1e-5 * self.rate, 1e-5 * self.rate, gap)
        weight = -self.rate / gap
        constant = np.sum(self.amplitude * weight, axis=-1)[..., None]
        risen, first = _readings_after(t, samples, period_s)
        if duration_s is None:
            own = constant * np.exp(-kappa * first) * _geometric(-kappa * period_s, risen)
            return (own + self._sum(first, risen, samples, period_s, -weight)) / samples
        duration = np.maximum(np.asarray(duration_s, dtype=float), SHORTEST_S)[..., None]
        late, since = _readings_after(t - duration, samples, period_s)
        let_in = np.exp(-kappa * duration) * np.expm1(-gap * duration) / (gap * duration)
        own = constant * np.exp(-kappa * (since + duration)) * _geometric(-kappa * period_s, late)
        after = own + self._sum(since, late, samples, period_s, weight * let_in)
        squared = np.sum(self.amplitude * weight / gap, axis=-1)[..., None]
        count = np.asarray(risen - late)
        during = self._sum(first, count, samples, period_s, weight / gap)
        for i in range(int(count.max(initial=0))):
            s = first + i * period_s
            during = during + np.where(i < count, np.exp(-kappa * s) * (constant * s - squared), 0.0)
        return (after + during / duration) / samples

    def _rising(self, first: Array, count: Array, samples: int, period_s: float) -> Array:
        """Sum of the step response's integral over `count` readings, the earliest at `first`."""
        rest = (self.amplitude / self.rate).sum(axis=-1)[..., None]
        line = count * (first + rest + 0.5 * period_s * (count - 1.0))
        return line - self._sum(first, count, samples, period_s, 1.0 / self.rate)

    def _sum(self, first: Array, count: Array, samples: int, period_s: float, weight: Array | float = 1.0) -> Array:
        """Sum over `count` readings, the earliest at `first` [s], of sum_k a_k w_k exp(-lambda_k t).

        `count` is 0 to `samples`, of the shape of `first`. Where it is all or nothing in a column, as it nearly always
        is, the geometric series is a weight of the modes.
        """
        amplitude = np.asarray(self.amplitude * weight)
        lead = np.broadcast_shapes(first.shape[:-1], count.shape[:-1], self.rate.shape[:-1], amplitude.shape[:-1])
        total = np.zeros((*lead, first.shape[-1]))
        counts, times = count.reshape(-1, count.shape[-1]), first.reshape(-1, first.shape[-1])
        some = (counts > 0).any(axis=0)
        whole = some & ((counts == 0) | (counts == samples)).all(axis=0)
        steps = -self.rate * period_s
        series = amplitude if samples == 1 else amplitude * _geometric(steps, np.asarray(samples))
        # Columns are cut into blocks of similar need, so that late times cost a few exponentials and early ones many.
        slowest = self.rate.reshape(-1, self.rate.shape[-1]).min(axis=0)
        died_out = DIED_OUT + np.log(max(np.abs(amplitude).max(initial=0.0), 1.0))  # lags in series have large ones
        needed = np.searchsorted(slowest, died_out / np.maximum(times.min(axis=0), 1e-9), side="right")
        need = 2 ** np.ceil(np.log2(needed.clip(1, slowest.size))).astype(int)
        for kept in np.unique(need[whole]):
            columns = _slice(whole & (need == kept))
            decay = np.exp(-first[..., columns, None] * self.rate[..., None, :kept])
            part = series[..., :kept]
            found = decay @ part if part.ndim == 1 else np.matmul(decay, part[..., None])[..., 0]
            total[..., columns] = np.where(count[..., columns] > 0, found, 0.0)
        if np.any(some & ~whole):
            columns = _slice(some & ~whole)
            decay = np.exp(-first[..., columns, None] * self.rate[..., None, :])
            decay *= _geometric(steps[..., None, :], count[..., columns, None])
            total[..., columns] = np.matmul(decay, amplitude[..., None])[..., 0]
        return total


def _readings_after(t: Array, samples: int, period_s: float) -> tuple[Array, Array]:
    """How many of the readings at t, t - period_s, ... lie after 0, and when the earliest of those was (0 if none)."""
    if samples == 1:
        return (t > 0).astype(float), np.maximum(t, 0.0)
    count = np.clip(np.ceil(t / period_s), 0.0, samples)
    return count, np.maximum(t - period_s * np.maximum(count - 1.0, 0.0), 0.0)


def _geometric(exponent: Array, count: Array) -> Array:
    """Sum over i = 0 ... count - 1 of exp(i exponent), for exponent < 0, without cancellation."""
    return np.expm1(count * exponent) / np.expm1(exponent)


def _slice(mask: NDArray[np.bool_]) -> slice | NDArray[np.int64]:
    """Columns of a mask, as a slice where they stand together: no copies then."""
    columns = np.flatnonzero(mask)
    if columns.size == columns[-1] - columns[0] + 1:
        return slice(int(columns[0]), int(columns[-1]) + 1)
    return columns


def first_order(time_constant_s: ArrayLike) -> Modes:
    """First-order lag: S(t) = 1 - exp(-t / time_constant)."""
    rate = 1.0 / np.asarray(time_constant_s, dtype=float)[..., None]
    return Modes(-np.ones_like(rate), rate)


def mix(first: Modes, second: Modes, share: ArrayLike) -> Modes:
    """Two responses in parallel: (1 - share) first + share second; `share` has the shape of the leading axes."""
    share = np.asarray(share, dtype=float)[..., None]
    return _joined(((1 - share) * first.amplitude, first.rate), (share * second.amplitude, second.rate))


def in_series(first: Modes, time_constant_s: ArrayLike) -> Modes:
    """The response behind, or followed by, a first-order lag: a sheath, a housing, a vent, a filter of the readout.

    Partial fractions: with mu = 1 / time_constant, a'_k = a_k mu / (mu - lambda_k), and the lag's own amplitude is
    -1 - sum_k a'_k. They have poles where the rates are equal, the response has not: there the lag is replaced with
    the mean of two, a little faster and a little slower, which is exact to second order in their distance.

    Parameters
    ----------
    first : Modes
        Any response, K modes.
    time_constant_s : array_like
        Of the lag [s], positive; shape of the leading axes.

    Returns
    -------
    Modes
        K + 2 modes: rates of the two lags are equal where nothing is near. Off by less than 1e-8 of the step where
        two rates are within 3e-5 of one another, by less than 1e-6 where three are, and by rounding elsewhere.
    """
    mu = 1.0 / np.asarray(time_constant_s, dtype=float)[..., None]
    spread = APART * np.arange(0.0, 24.0, 2.0)[:, None]
    tried = mu[..., None] * np.concatenate([1.0 - spread, 1.0 + spread], axis=-1)  # (..., spreads, 2)
    off = np.abs(tried[..., None] / first.rate[..., None, None, :] - 1.0).min(axis=(-2, -1))
    chosen = np.argmax(off >= 0.99 * APART, axis=-1)[..., None, None]
    mu = np.take_along_axis(tried, chosen, axis=-2)[..., 0, :]  # (..., 2)
    passed = first.amplitude[..., None, :] / (1.0 - first.rate[..., None, :] / mu[..., None])  # (..., 2, K)
    return _joined((passed.mean(axis=-2), first.rate), (-0.5 * (1.0 + passed.sum(axis=-1)), mu))


def two_lags(first_s: ArrayLike, second_s: ArrayLike) -> Modes:
    """Two first-order lags in series (a lump in a sheath); for equal ones S(t) = 1 - (1 + t/tau) exp(-t/tau)."""
    return in_series(first_order(first_s), second_s)


def response_times(modes: Modes, shares: tuple[float, ...] = (0.63212055882855767, 0.90, 0.98)) -> tuple[float, ...]:
    """Times [s] to reach each share of a step, for one set of modes (shape (K,)), to 1e-6 of the value.

    t63 is taken at 1 - 1/e = 63.2 %, as data sheets and the landmarks of the plain model do.
    """
    from scipy.optimize import brentq

    slowest = float(modes.rate[0])
    return tuple(
        brentq(lambda t, s=share: float(modes.step(np.array([t]))[0]) - s, 1e-9 / slowest, 40.0 / slowest, rtol=1e-10)
        for share in shares
    )


def _joined(*parts: tuple[Array, Array]) -> Modes:
    """Amplitudes and rates of several sums as one, rates ascending."""
    lead = np.broadcast_shapes(*(array.shape[:-1] for part in parts for array in part))
    amplitude = np.concatenate([np.broadcast_to(a, (*lead, a.shape[-1])) for a, _ in parts], axis=-1)
    rate = np.concatenate([np.broadcast_to(r, (*lead, r.shape[-1])) for _, r in parts], axis=-1)
    order = np.argsort(rate, axis=-1, kind="stable")
    return Modes(np.take_along_axis(amplitude, order, -1), np.take_along_axis(rate, order, -1))
