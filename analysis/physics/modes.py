"""Closed forms of the sensors' diffusion as sums of modes: unit-step response S(t) = 1 + sum_k a_k exp(-lambda_k t).

Sphere (bead, read at the core) and film (read as its mean), with the surface held at the air or behind a transfer
resistance (Biot number). Source: Carslaw and Jaeger (1959), sections 3.3, 3.5 and 9.3, 9.4; Segales et al. 2022, Eqs.
1 and 8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

DIED_OUT = 20.0  # exp(-20) of a mode is nothing


@dataclass(frozen=True)
class Modes:
    """A response to a unit step of the air: S(t) = 1 + sum_k amplitude_k exp(-rate_k t) for t > 0, and 0 before.

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

    def _sum(self, t: Array, weight: Array | None = None) -> Array:
        """sum_k a_k w_k exp(-lambda_k t), leaving out at each block of times the modes that have died out there."""
        amplitude = self.amplitude if weight is None else self.amplitude * weight
        shape = np.broadcast_shapes(t.shape[:-1], self.rate.shape[:-1])
        total = np.zeros((*shape, t.shape[-1]))
        slowest = self.rate.reshape(-1, self.rate.shape[-1]).min(axis=0)
        times = t.reshape(-1, t.shape[-1])
        before = times.max(axis=0) <= 0.0  # half of a run's columns lie before its transfer
        total[..., before] = amplitude.sum(axis=-1)[..., None]
        # Columns are cut into blocks of similar need, so that late times cost a few exponentials and early ones many.
        needed = np.searchsorted(slowest, DIED_OUT / np.maximum(times.min(axis=0), 1e-9), side="right")
        need = 2 ** np.ceil(np.log2(needed.clip(1, slowest.size))).astype(int)
        need[before] = 0
        for count in np.unique(need[need > 0]):
            columns = np.flatnonzero(need == count)
            if columns.size == columns[-1] - columns[0] + 1:
                columns = slice(columns[0], columns[-1] + 1)
            decay = np.exp(-t[..., columns, None] * self.rate[..., None, :count])
            part = amplitude[..., :count]
            total[..., columns] = decay @ part if part.ndim == 1 else np.matmul(decay, part[..., None])[..., 0]
        return total

    def step(self, t: Array) -> Array:
        """Response at times t [s] (shape (..., n)) to a unit step at 0."""
        late = np.maximum(t, 0.0)
        return np.where(t > 0, 1.0 + self._sum(late), 0.0)

    def integral(self, t: Array) -> Array:
        """Integral of the step response from 0 to t [s]: the response to a unit ramp."""
        late = np.maximum(t, 0.0)
        rest = (self.amplitude / self.rate).sum(axis=-1)[..., None]
        return np.where(t > 0, late + rest - self._sum(late, 1.0 / self.rate), 0.0)

    def ramp(self, t: Array, duration_s: ArrayLike) -> Array:
        """Response to air that changes linearly from 0 to 1 over `duration_s` (broadcast with t[..., 0]); zero is a
        step."""
        duration = np.maximum(np.asarray(duration_s, dtype=float), 1e-6)[..., None]
        # After the ramp each mode has been driven for its whole length; while it lasts the response is the integral.
        turns = self.rate * duration
        late = self._sum(np.maximum(t - duration, 0.0), -np.expm1(-turns) / turns)
        out = np.broadcast_to(np.where(t > 0, 1.0 + late, 0.0), late.shape).copy()
        during = (t > 0) & (t < duration)
        columns = np.flatnonzero(during.reshape(-1, t.shape[-1]).any(axis=0))
        if columns.size:
            rising = self.integral(t[..., columns]) / duration
            out[..., columns] = np.where(during[..., columns], rising, out[..., columns])
        return out

    def exponential(self, t: Array, time_constant_s: ArrayLike, duration_s: ArrayLike | None = None) -> Array:
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
        if duration_s is None:
            late = np.maximum(t, 0.0)
            return np.where(t > 0, self._sum(late, -weight) + constant * np.exp(-late * kappa), 0.0)
        duration = np.maximum(np.asarray(duration_s, dtype=float), 1e-6)[..., None]
        late = np.maximum(t - duration, 0.0)
        let_in = np.exp(-kappa * duration) * np.expm1(-gap * duration) / (gap * duration)
        out = self._sum(late, weight * let_in) + constant * np.exp(-np.maximum(t, duration) * kappa)
        rising, shape = np.maximum(t, 0.0), np.broadcast_shapes(t.shape, out.shape)
        squared = np.sum(self.amplitude * weight / gap, axis=-1)[..., None]
        during = np.exp(-rising * kappa) * (constant * rising - squared) + self._sum(rising, weight / gap)
        return np.where(np.broadcast_to(t < duration, shape), np.where(t > 0, during / duration, 0.0), out)


def mix(first: Modes, second: Modes, share: ArrayLike) -> Modes:
    """(1 - share) first + share second; `share` has the shape of the leading axes."""
    share = np.asarray(share, dtype=float)[..., None]
    lead = np.broadcast_shapes(first.rate.shape[:-1], second.rate.shape[:-1], share.shape[:-1])
    count = first.rate.shape[-1], second.rate.shape[-1]
    amplitude = np.concatenate(
        [
            np.broadcast_to((1 - share) * first.amplitude, (*lead, count[0])),
            np.broadcast_to(share * second.amplitude, (*lead, count[1])),
        ],
        axis=-1,
    )
    rate = np.concatenate(
        [np.broadcast_to(first.rate, (*lead, count[0])), np.broadcast_to(second.rate, (*lead, count[1]))], axis=-1
    )
    order = np.argsort(rate, axis=-1)
    return Modes(np.take_along_axis(amplitude, order, -1), np.take_along_axis(rate, order, -1))


def first_order(time_constant_s: ArrayLike) -> Modes:
    """First-order lag: S(t) = 1 - exp(-t / time_constant)."""
    rate = 1.0 / np.asarray(time_constant_s, dtype=float)[..., None]
    return Modes(-np.ones_like(rate), rate)


def _closed(amplitude: Array, rate: Array) -> Modes:
    """Modes whose last amplitude carries the truncated tail, so that the response starts at exactly zero."""
    amplitude = np.array(np.broadcast_to(amplitude, rate.shape), dtype=float)
    amplitude[..., -1] = -1.0 - amplitude[..., :-1].sum(axis=-1)
    return Modes(amplitude, rate)


def sphere_core(count: int = 24) -> Modes:
    """Core of a sphere whose surface follows the air; rates in units of alpha/R^2: a_n = 2 (-1)^n, lambda_n = n^2
    pi^2."""
    n = np.arange(1, count + 1)
    return _closed(2.0 * (-1.0) ** n, (n * np.pi) ** 2)


def film_mean(count: int = 96) -> Modes:
    """Mean of a film sealed below, surface at the air; rates in D/L^2: a_n = -8 / ((2n+1) pi)^2, ((2n+1) pi / 2)^2."""
    odd = 2 * np.arange(count) + 1
    return _closed(-8.0 / (odd * np.pi) ** 2, (odd * np.pi / 2) ** 2)


def _roots(function, derivative, low: Array, high: Array) -> Array:
    """Roots of a function that changes sign once in each bracket: bisection, then Newton kept inside the bracket."""
    sign = np.sign(function(low))
    for _ in range(12):
        middle = 0.5 * (low + high)
        left = np.sign(function(middle)) == sign
        low, high = np.where(left, middle, low), np.where(left, high, middle)
    root = 0.5 * (low + high)
    for _ in range(4):
        root = np.clip(root - function(root) / derivative(root), low, high)
    return root


def sphere_core_biot(biot: ArrayLike, count: int = 24) -> Modes:
    """Core of a sphere behind an air film: 1 - b cot b = Bi, a = -4 (sin b - b cos b) / (2 b - sin 2b), rates b^2."""

    def solve(bi: Array) -> Modes:
        k = np.arange(1, count + 1)
        low = np.broadcast_to((k - 1) * np.pi, (bi.size, count)) + 1e-7
        high = np.broadcast_to(k * np.pi, low.shape) - 1e-9
        bi = bi[:, None]
        b = _roots(lambda x: x * np.cos(x) - (1 - bi) * np.sin(x), lambda x: bi * np.cos(x) - x * np.sin(x), low, high)
        return _closed(-4.0 * (np.sin(b) - b * np.cos(b)) / (2 * b - np.sin(2 * b)), b**2)

    return _by_value(biot, solve)


def film_mean_biot(biot: ArrayLike, count: int = 64) -> Modes:
    """Mean of a film behind a boundary layer: b tan b = Bi, a = -2 Bi^2 / (b^2 (b^2 + Bi^2 + Bi)), rates b^2."""

    def solve(bi: Array) -> Modes:
        k = np.arange(count)
        low = np.broadcast_to(k * np.pi, (bi.size, count)) + 1e-9
        high = np.broadcast_to((k + 0.5) * np.pi, low.shape)
        bi = bi[:, None]
        b = _roots(lambda x: x * np.sin(x) - bi * np.cos(x), lambda x: (1 + bi) * np.sin(x) + x * np.cos(x), low, high)
        return _closed(-2.0 * bi**2 / (b**2 * (b**2 + bi**2 + bi)), b**2)

    return _by_value(biot, solve)


def _by_value(biot: ArrayLike, solve) -> Modes:
    """Modes for an array of Biot numbers, each different value solved once: runs share a few airflows."""
    biot = np.asarray(biot, dtype=float)
    different, place = np.unique(biot, return_inverse=True)
    modes = solve(different)
    place = place.reshape(biot.shape)
    return Modes(modes.amplitude[place], modes.rate[place])


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
