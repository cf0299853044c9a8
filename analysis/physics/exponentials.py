"""Linear responses that are sums of exponentials: S(t) = 1 + sum_k a_k exp(-lambda_k t) to a unit step of the air.

What air that steps, ramps or decays makes of them, also where a logger writes the mean of its last readings: the sum
over equally spaced readings of exp(-lambda t) is a geometric series, so a mean of 24 costs two to five evaluations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shockrig.files.compiled import demand_current

try:
    from shockrig.analysis.physics import _sums

    demand_current(_sums)
except ImportError:  # not built: the same in NumPy
    _sums = None  # type: ignore[assignment]

Array = NDArray[np.float64]

DIED_OUT = 20.0  # exp(-20) of a mode is nothing
SHORTEST_S = 1e-6  # a ramp shorter than this is a step
ALIKE_S = 1e-9  # times nearer than this are one


@dataclass(frozen=True)
class Modes:
    """A response to a unit step of the air: S(t) = 1 + sum_k amplitude_k exp(-rate_k t) for t > 0, and 0 before.

    Every response takes `samples` and `period_s`: the mean of the readings at t, t - period_s, ... is then given, as
    a logger writes it that averages its last `samples` readings.

    Attributes
    ----------
    amplitude, rate : ndarray, shape (..., K)
        Amplitudes [1] and rates [1/s]; leading axes broadcast (candidates, runs).
    """

    amplitude: Array
    rate: Array

    def scaled(self, per_second: ArrayLike) -> Modes:
        """Modes with dimensionless rates multiplied by alpha/R^2 or D/L^2 [1/s] (shape of the leading axes)."""
        return Modes(self.amplitude, self.rate * np.asarray(per_second, dtype=float)[..., None])

    def ascending(self) -> Modes:
        """The same modes with rates ascending in k."""
        amplitude, rate = np.broadcast_arrays(self.amplitude, self.rate)
        if (rate[..., 1:] >= rate[..., :-1]).all():
            return Modes(amplitude, rate)
        order = np.argsort(rate, axis=-1, kind="stable")
        return Modes(np.take_along_axis(amplitude, order, -1), np.take_along_axis(rate, order, -1))

    def step(self, t: Array, *, samples: int = 1, period_s: float = 1.0) -> Array:
        """Response at times t [s] (shape (..., n)) to a unit step at 0."""
        risen = _after(t, samples, period_s)
        total = self._sum(risen)
        total += risen.count
        return risen.mean(total)

    def integral(self, t: Array, *, samples: int = 1, period_s: float = 1.0) -> Array:
        """Integral of the step response from 0 to t [s]: the response to a unit ramp."""
        risen = _after(t, samples, period_s)
        return risen.mean(self._rising(risen))

    def ramp(self, t: Array, duration_s: ArrayLike, *, samples: int = 1, period_s: float = 1.0) -> Array:
        """Response to air that goes straight from 0 to 1 in `duration_s` (broadcast with t[..., 0]); zero is a step."""
        duration = np.maximum(np.asarray(duration_s, dtype=float), SHORTEST_S)[..., None]
        # After the ramp each mode has been driven for its whole length; while it lasts the response is the integral.
        turns = self.rate * duration
        late = _after(t - duration, samples, period_s)
        total = self._sum(late, -np.expm1(-turns) / turns)
        total += late.count
        during, columns = _between(_after(t, samples, period_s), late)
        if columns.size:
            total[..., columns] += self._rising(during) / duration
        return late.mean(total)

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
        risen = _after(t, samples, period_s)
        if duration_s is None:
            return risen.mean(self._sum(risen, -weight) + constant * risen.decay(kappa))
        duration = np.maximum(np.asarray(duration_s, dtype=float), SHORTEST_S)[..., None]
        late = _after(t - duration, samples, period_s)
        let_in = np.exp(-kappa * duration) * np.expm1(-gap * duration) / (gap * duration)
        total = self._sum(late, weight * let_in) + constant * np.exp(-kappa * duration) * late.decay(kappa)
        during, columns = _between(risen, late)
        if columns.size:
            squared = np.sum(self.amplitude * weight / gap, axis=-1)[..., None]
            part = self._sum(during, weight / gap)
            for i in range(int(during.count.max())):
                at = np.where(during.count > i, during.first + i * period_s, 0.0)
                part += np.where(during.count > i, np.exp(-kappa * at) * (constant * at - squared), 0.0)
            total[..., columns] += part / duration
        return risen.mean(total)

    def _rising(self, readings: _Readings) -> Array:
        """Sum over the readings of the step response's integral."""
        rest = (self.amplitude / self.rate).sum(axis=-1)[..., None]
        count = readings.count
        middle = np.where(count > 0, readings.first, 0.0) + 0.5 * readings.period_s * (count - 1.0)
        return count * (middle + rest) - self._sum(readings, 1.0 / self.rate)

    def _sum(self, readings: _Readings, weight: Array | float = 1.0) -> Array:
        """Sum over the readings of sum_k a_k w_k exp(-lambda_k t), leaving out the modes that have died out by then."""
        amplitude = np.asarray(self.amplitude * weight)
        first, samples = readings.first, readings.samples
        lead = np.broadcast_shapes(first.shape[:-1], self.rate.shape[:-1], amplitude.shape[:-1])
        total = np.empty((*lead, first.shape[-1]))
        series = amplitude if samples == 1 else amplitude * _geometric(-self.rate * readings.period_s, samples)
        ends_early = readings.partial()
        partial = np.flatnonzero(ends_early)
        whole = np.where(ends_early, np.inf, first) if partial.size else first
        (plain if _sums is None else compiled)(whole, self.rate, series, total)
        if partial.size:
            steps = -self.rate * readings.period_s
            fast = _slowest(self.rate) * readings.period_s > 2 * DIED_OUT  # these see one reading only
            first, count = first[..., partial], readings.count[..., partial, None]
            # Evenly sampled columns begin equally long after the instant: each such time is evaluated once.
            other = ~np.isclose(first[..., 1:], first[..., :-1], rtol=0.0, atol=ALIKE_S)
            begins = np.append(True, other.any(axis=tuple(range(other.ndim - 1))))
            which = np.cumsum(begins) - 1
            decay = np.exp(-first[..., begins, None] * self.rate[..., None, :])
            lasting = np.expm1(count * steps[..., None, ~fast])
            lasting *= decay[..., ~fast][..., which, :]
            total[..., partial] = _weighted(decay[..., fast], amplitude[..., fast])[..., which]
            total[..., partial] += _weighted(lasting, (amplitude / np.expm1(steps))[..., ~fast])
        return total


@dataclass(frozen=True)
class _Readings:
    """Readings of which a logger writes the mean: `count` of its last `samples`, `period_s` apart, which lie after an
    instant, the earliest at `first` [s] after it (infinity where there is none); both (..., n).
    """

    count: Array | NDArray[np.bool_]
    first: Array
    samples: int
    period_s: float

    def mean(self, total: Array) -> Array:
        return total if self.samples == 1 else total / self.samples

    def partial(self) -> NDArray[np.bool_]:
        """Columns in which some row has neither none nor all of its readings: there the series ends early."""
        if self.samples == 1:
            return np.zeros(self.first.shape[-1], dtype=bool)
        ends = (self.count > 0) & (self.count < self.samples)
        return np.asarray(ends.reshape(-1, ends.shape[-1]).any(axis=0))

    def decay(self, rate: Array) -> Array:
        """Sum of exp(-rate t), for one rate (..., 1)."""
        one = np.exp(-rate * self.first)
        return one if self.samples == 1 else one * _geometric(-rate * self.period_s, self.count)


def _after(t: Array, samples: int, period_s: float) -> _Readings:
    """Those of the readings at t, t - period_s, ... that lie after 0."""
    if samples == 1:
        count = t > 0
        return _Readings(count, np.where(count, t, np.inf), samples, period_s)
    count = np.clip(np.ceil(t / period_s), 0.0, samples)
    return _Readings(count, np.where(count > 0, t - period_s * (count - 1.0), np.inf), samples, period_s)


def _between(risen: _Readings, late: _Readings) -> tuple[_Readings, NDArray[np.int64]]:
    """Those of the readings `risen` that are not yet `late`, in the columns that have any."""
    several = np.asarray(risen.count > late.count)
    columns = np.flatnonzero(several.reshape(-1, several.shape[-1]).any(axis=0))
    count = risen.count[..., columns] * 1.0 - late.count[..., columns]
    first = np.where(count > 0, risen.first[..., columns], np.inf)
    return _Readings(count, first, risen.samples, risen.period_s), columns


def plain(first: Array, rate: Array, amplitude: Array, total: Array) -> None:
    """Sums over k of amplitude_k exp(-rate_k first), put into `total` (..., n): what `compiled` does, in NumPy.

    `first` is (..., n), rates and amplitudes are (..., K); leading axes broadcast to those of `total`. Modes that have
    died out by then are left out.
    """
    # Columns are cut into blocks of similar need, so that late times cost a few exponentials and early ones many.
    slowest, earliest = _slowest(rate), first.reshape(-1, first.shape[-1]).min(axis=0)
    slowest = np.nan_to_num(slowest, nan=0.0)  # what is no number is not left out
    order = np.argsort(slowest)
    slowest, rate, amplitude = slowest[order], rate[..., order], amplitude[..., order]
    died_out = DIED_OUT + np.log(max(np.abs(amplitude).max(initial=0.0), 1.0))  # lags in series have large ones
    need = np.searchsorted(slowest, died_out / np.maximum(earliest, 1e-9), side="right")
    need = 2 ** np.ceil(np.log2(need.clip(1, slowest.size))).astype(int)
    need[np.isinf(earliest)] = 0  # half of a run's columns lie before its transfer
    total[...] = 0.0
    for kept in np.unique(need[need > 0]):
        columns = _slice(np.flatnonzero(need == kept))
        decay = first[..., columns, None] * -rate[..., None, :kept]
        total[..., columns] = _weighted(np.exp(decay, out=decay), amplitude[..., :kept])


def compiled(first: Array, rate: Array, amplitude: Array, total: Array) -> None:
    """The same by sums.c."""
    times, rates, amplitudes = (np.ascontiguousarray(x, dtype=float) for x in (first, rate, amplitude))
    begins = (np.arange(x.size // x.shape[-1]).reshape(x.shape[:-1]) * x.shape[-1] for x in (times, rates, amplitudes))
    places = np.stack([np.broadcast_to(one, total.shape[:-1]) for one in begins]).reshape(-1)
    _sums.add_up(first.shape[-1], rate.shape[-1], places, times, rates, amplitudes, DIED_OUT, total)


def _slowest(rate: Array) -> Array:
    """Of each mode (K,), over candidates and runs."""
    return np.asarray(rate.reshape(-1, rate.shape[-1]).min(axis=0))


def _weighted(decay: Array, amplitude: Array) -> Array:
    """Sum over the last axis of `decay` (..., n, K), weighted with `amplitude` (..., K)."""
    return decay @ amplitude if amplitude.ndim == 1 else np.matmul(decay, amplitude[..., None])[..., 0]


def _geometric(exponent: Array, count: ArrayLike) -> Array:
    """Sum over i = 0 ... count - 1 of exp(i exponent), for exponent < 0, without cancellation."""
    return np.expm1(np.asarray(count) * exponent) / np.expm1(exponent)


def _slice(columns: NDArray[np.int64]) -> slice | NDArray[np.int64]:
    """Columns, as a slice where they stand together: no copies then."""
    if columns.size == columns[-1] - columns[0] + 1:
        return slice(int(columns[0]), int(columns[-1]) + 1)
    return columns


def response_times(modes: Modes, shares: tuple[float, ...] = (0.63212055882855767, 0.90, 0.98)) -> tuple[float, ...]:
    """Times [s] to reach each share of a step, for one set of modes (shape (K,)), to 1e-6 of the value.

    t63 is taken at 1 - 1/e = 63.2 %, as data sheets and the landmarks of the plain model do.
    """
    from scipy.optimize import brentq

    slowest = float(modes.rate.min())
    return tuple(
        brentq(lambda t, s=share: float(modes.step(np.array([t]))[0]) - s, 1e-9 / slowest, 40.0 / slowest, rtol=1e-10)
        for share in shares
    )
