"""Closed forms of diffusion in sphere, cylinder and plate as sums of modes, surface at the air or behind a resistance.

Rates are in units of alpha/R^2 or D/L^2 (R radius; L half thickness of a plate, or thickness of a film sealed below).
The Biot number is h R / k or h L / k. Source: Carslaw and Jaeger (1959), sections 3.3, 3.5, 3.11, 7.6, 7.7 and 9.3,
9.4; Crank (1975), sections 4.3, 5.3 and 6.3; Segales et al. 2022, Eqs. 1 and 8.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import j0, j1, jn_zeros

from shockrig.analysis.physics.exponentials import Modes, response_times

__all__ = [
    "Modes",
    "cylinder_core",
    "cylinder_core_biot",
    "cylinder_mean",
    "cylinder_mean_biot",
    "film_mean",
    "film_mean_biot",
    "first_order",
    "in_series",
    "mix",
    "plate_middle",
    "plate_middle_biot",
    "response_times",
    "slowest",
    "sphere_core",
    "sphere_core_biot",
    "sphere_mean",
    "sphere_mean_biot",
    "two_lags",
]

Array = NDArray[np.float64]

# First-order lags, alone, beside a response and in series with it: a lump, a support, a sheath, a housing, a vent.
#
# All are sums of exponentials again; in series by partial fractions, safe where rates are equal.

NEAR_RATES = 3e-5  # relative distance of two rates from which partial fractions keep ten digits
NEAR_RATES_LIMIT = 0.99 * NEAR_RATES


def first_order(time_constant_s: ArrayLike) -> Modes:
    """First-order lag: S(t) = 1 - exp(-t / time_constant)."""
    rate = 1.0 / np.asarray(time_constant_s, dtype=float)[..., None]
    return Modes(-np.ones_like(rate), rate)


def first_orders(time_constants_s: ArrayLike) -> Modes:
    """Lags of time constants (..., J), each of an equal share: S(t) = 1 - mean over them of exp(-t / time_constant)."""
    rate = np.sort(1.0 / np.asarray(time_constants_s, dtype=float), axis=-1)
    return Modes(np.full(rate.shape, -1.0 / rate.shape[-1]), rate)


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
    return behind_each(first, np.asarray(time_constant_s, dtype=float)[..., None])


def behind_each(first: Modes, time_constants_s: Array) -> Modes:
    """The response behind lags beside one another, of time constants (..., J) and equal shares: K + 2 J modes."""
    each = [_behind(first, 1.0 / time_constants_s[..., j, None]) for j in range(time_constants_s.shape[-1])]
    passed = np.mean(np.broadcast_arrays(*(kept for kept, _, _ in each)), axis=0)
    return _joined((passed, first.rate), *((own / len(each), mu) for _, own, mu in each))


def _behind(first: Modes, mu: Array) -> tuple[Array, Array, Array]:
    """Amplitudes of the modes behind a lag of rate `mu` (..., 1); amplitudes and rates of the two of the lag itself."""
    mu = _clear_of(first.rate, mu)  # (..., 2)
    apart = mu[..., :1] if (mu[..., 0] == mu[..., 1]).all() else mu  # they are equal nearly always: one serves for both
    passed = first.amplitude[..., None, :] / (1.0 - first.rate[..., None, :] / apart[..., None])  # (..., 1 or 2, K)
    own = -0.5 * (1.0 + passed.sum(axis=-1))
    return passed.mean(axis=-2), np.broadcast_to(own, (*own.shape[:-1], 2)), mu


def _clear_of(rate: Array, mu: Array) -> Array:
    """Two rates (..., 2) in the place of a lag's `mu` (..., 1): equal, or as far apart as keeps both off all `rate`."""
    alone = np.abs(mu / rate - 1.0).min(axis=-1) >= NEAR_RATES_LIMIT
    pair = np.repeat(np.broadcast_to(mu, (*alone.shape, 1)), 2, axis=-1)
    if alone.all():
        return pair
    near = np.broadcast_to(rate, (*alone.shape, rate.shape[-1]))[~alone]
    spread = NEAR_RATES * np.arange(0.0, 24.0, 2.0)[:, None]
    tried = pair[~alone][:, None, :] * np.concatenate([1.0 - spread, 1.0 + spread], axis=-1)  # (..., spreads, 2)
    off = np.abs(tried[..., None] / near[:, None, None, :] - 1.0).min(axis=(-2, -1))
    chosen = np.argmax(off >= NEAR_RATES_LIMIT, axis=-1)
    pair[~alone] = tried[np.arange(chosen.size), chosen]
    return pair


def two_lags(first_s: ArrayLike, second_s: ArrayLike) -> Modes:
    """Two first-order lags in series (a lump in a sheath); for equal ones S(t) = 1 - (1 + t/tau) exp(-t/tau)."""
    return in_series(first_order(first_s), second_s)


def _joined(*parts: tuple[Array, Array]) -> Modes:
    """Amplitudes and rates of several sums as one."""
    lead = np.broadcast_shapes(*(array.shape[:-1] for part in parts for array in part))
    amplitude = np.concatenate([np.broadcast_to(a, (*lead, a.shape[-1])) for a, _ in parts], axis=-1)
    rate = np.concatenate([np.broadcast_to(r, (*lead, r.shape[-1])) for _, r in parts], axis=-1)
    return Modes(amplitude, rate)


def slowest(modes: Modes, count: int) -> Modes:
    """The slowest modes; the last of them stands for all the faster ones.

    It carries what they carry, so that steps start at zero, with their mean lag, so that straight lines are as late as
    they were. At its own rate it would answer too early or, where signs alternate, the wrong way at first.
    """
    if modes.rate.shape[-1] <= count:
        return modes
    modes = modes.ascending()
    amplitude, rate = modes.amplitude, modes.rate
    last = amplitude[..., count - 1 :].sum(axis=-1)
    lag = (amplitude[..., count - 1 :] / rate[..., count - 1 :]).sum(axis=-1)
    slow_amplitude, slow_rate = amplitude[..., :count].copy(), rate[..., :count].copy()
    slow_amplitude[..., -1] = last
    slow_rate[..., -1] = np.where(last * lag > 0.0, last / np.where(lag == 0.0, 1.0, lag), slow_rate[..., -1])
    return Modes(slow_amplitude, slow_rate)


AVERAGED_TERMS = 8  # last partial sums of an alternating series that are averaged


def sphere_core(count: int = 24) -> Modes:
    """Core of a sphere whose surface follows the air: a_n = 2 (-1)^n, lambda_n = n^2 pi^2, per alpha/R^2."""
    n = np.arange(1.0, count + 1.0)
    return alternating(2.0 * (-1.0) ** n, (n * np.pi) ** 2)


def sphere_mean(count: int = 96) -> Modes:
    """Mean of a sphere whose surface follows the air: a_n = -6 / (n pi)^2, lambda_n = n^2 pi^2, per D/R^2."""
    n = np.arange(1.0, count + 1.0)
    return closed(-6.0 / (n * np.pi) ** 2, (n * np.pi) ** 2)


def cylinder_core(count: int = 24) -> Modes:
    """Axis of a long cylinder whose surface follows the air: J0(b) = 0, a = -2 / (b J1(b)), rates b^2 per alpha/R^2."""
    b = bessel_zeros(0, count)
    return alternating(-2.0 / (b * j1(b)), b**2)


def cylinder_mean(count: int = 96) -> Modes:
    """Mean of a long cylinder whose surface follows the air: J0(b) = 0, a = -4 / b^2, rates b^2 per D/R^2."""
    b = bessel_zeros(0, count)
    return closed(-4.0 / b**2, b**2)


def plate_middle(count: int = 24) -> Modes:
    """Middle of a plate, both faces at the air: b = (n + 1/2) pi, a_n = -2 (-1)^n / b, rates b^2 per alpha/L^2."""
    n = np.arange(float(count))
    b = (n + 0.5) * np.pi
    return alternating(-2.0 * (-1.0) ** n / b, b**2)


def film_mean(count: int = 96) -> Modes:
    """Mean of a film sealed below, surface at the air: b = (n + 1/2) pi, a_n = -2 / b^2, rates b^2 per D/L^2."""
    b = (np.arange(float(count)) + 0.5) * np.pi
    return closed(-2.0 / b**2, b**2)


def sphere_core_biot(biot: ArrayLike, count: int = 24) -> Modes:
    """Core of a sphere behind an air film: 1 - b cot b = Bi, a = -4 (sin b - b cos b) / (2 b - sin 2b), rates b^2."""

    def solve(bi: Array) -> Modes:
        b = _sphere_roots(bi, count)
        return alternating(-4.0 * (np.sin(b) - b * np.cos(b)) / (2 * b - np.sin(2 * b)), b**2)

    return _by_value(biot, solve)


def sphere_mean_biot(biot: ArrayLike, count: int = 96) -> Modes:
    """Mean of a sphere behind an air film: 1 - b cot b = Bi, a = -6 Bi^2 / (b^2 (b^2 + Bi^2 - Bi)), rates b^2."""

    def solve(bi: Array) -> Modes:
        b = _sphere_roots(bi, count)
        return closed(-6.0 * bi**2 / (b**2 * (b**2 + bi**2 - bi)), b**2)

    return _by_value(biot, solve)


def cylinder_core_biot(biot: ArrayLike, count: int = 24) -> Modes:
    """Axis of a cylinder behind an air film: b J1(b) = Bi J0(b), a = -2 Bi / ((b^2 + Bi^2) J0(b)), rates b^2."""

    def solve(bi: Array) -> Modes:
        b = _cylinder_roots(bi, count)
        # 1 / J0 = Bi / (b J1) by the condition; of the two Bessel functions the larger keeps its digits.
        over = np.where(np.abs(j0(b)) > np.abs(j1(b)), 1.0 / j0(b), bi / (b * j1(b)))
        return alternating(-2.0 * bi * over / (b**2 + bi**2), b**2)

    return _by_value(biot, solve)


def cylinder_mean_biot(biot: ArrayLike, count: int = 96) -> Modes:
    """Mean of a cylinder behind an air film: b J1(b) = Bi J0(b), a = -4 Bi^2 / (b^2 (b^2 + Bi^2)), rates b^2."""

    def solve(bi: Array) -> Modes:
        b = _cylinder_roots(bi, count)
        return closed(-4.0 * bi**2 / (b**2 * (b**2 + bi**2)), b**2)

    return _by_value(biot, solve)


def plate_middle_biot(biot: ArrayLike, count: int = 24) -> Modes:
    """Middle of a plate behind air films: b tan b = Bi, a = -4 sin b / (2 b + sin 2b), rates b^2."""

    def solve(bi: Array) -> Modes:
        b = _plate_roots(bi, count)
        return alternating(-4.0 * np.sin(b) / (2 * b + np.sin(2 * b)), b**2)

    return _by_value(biot, solve)


def film_mean_biot(biot: ArrayLike, count: int = 64) -> Modes:
    """Mean of a film behind a boundary layer: b tan b = Bi, a = -2 Bi^2 / (b^2 (b^2 + Bi^2 + Bi)), rates b^2."""

    def solve(bi: Array) -> Modes:
        b = _plate_roots(bi, count)
        return closed(-2.0 * bi**2 / (b**2 * (b**2 + bi**2 + bi)), b**2)

    return _by_value(biot, solve)


def closed(amplitude: Array, rate: Array) -> Modes:
    """Modes whose last amplitude carries the truncated tail, so that the response starts at exactly zero."""
    amplitude = np.array(np.broadcast_to(amplitude, rate.shape), dtype=float)
    amplitude[..., -1] = -1.0 - amplitude[..., :-1].sum(axis=-1)
    return Modes(amplitude, rate)


def alternating(amplitude: Array, rate: Array) -> Modes:
    """Modes of a core, whose signs alternate: the last partial sums are averaged with binomial weights.

    This is Euler's transformation (Hardy 1949, Divergent Series, chapter VIII): a series that does not converge at
    t = 0 then holds at every t, to 1e-7 with 24 modes, where the plain sum is off by 2 % at first.
    """
    count = amplitude.shape[-1]
    terms = min(AVERAGED_TERMS, max(1, count // 3))
    chosen = np.array([comb(terms, i) for i in range(1, terms + 1)]) / 2.0**terms
    weight = np.concatenate([np.ones(count - terms), np.cumsum(chosen[::-1])[::-1]])
    return closed(amplitude * weight, rate)


@cache
def bessel_zeros(order: int, count: int) -> Array:
    """First zeros of the Bessel function J0 or J1."""
    return jn_zeros(order, count)


def _sphere_roots(bi: Array, count: int) -> Array:
    """Roots of 1 - b cot b = Bi, one between each two poles of the cotangent."""
    k = np.arange(1, count + 1)
    low = np.broadcast_to((k - 1) * np.pi, (bi.size, count)) + 1e-7
    high = np.broadcast_to(k * np.pi, low.shape) - 1e-9
    return roots_between(
        lambda x: x * np.cos(x) - (1 - bi) * np.sin(x), lambda x: bi * np.cos(x) - x * np.sin(x), low, high
    )


def _cylinder_roots(bi: Array, count: int) -> Array:
    """Roots of b J1(b) = Bi J0(b), one between each zero of J1 and the next of J0."""
    low = np.broadcast_to(np.concatenate([[1e-9], bessel_zeros(1, count)[:-1]]), (bi.size, count))
    high = np.broadcast_to(bessel_zeros(0, count), low.shape)
    return roots_between(lambda x: x * j1(x) - bi * j0(x), lambda x: x * j0(x) + bi * j1(x), low, high)


def _plate_roots(bi: Array, count: int) -> Array:
    """Roots of b tan b = Bi, one below each pole of the tangent."""
    k = np.arange(count)
    low = np.broadcast_to(k * np.pi, (bi.size, count)) + 1e-9
    high = np.broadcast_to((k + 0.5) * np.pi, low.shape)
    return roots_between(
        lambda x: x * np.sin(x) - bi * np.cos(x), lambda x: (1 + bi) * np.sin(x) + x * np.cos(x), low, high
    )


def roots_between(
    function: Callable[[Array], Array], derivative: Callable[[Array], Array], low: Array, high: Array
) -> Array:
    """Roots of a function that changes sign once in each bracket: bisection, then Newton kept inside the bracket."""
    sign = np.sign(function(low))
    for _ in range(12):
        middle = 0.5 * (low + high)
        left = np.sign(function(middle)) == sign
        low, high = np.where(left, middle, low), np.where(left, high, middle)
    root = 0.5 * (low + high)
    for _ in range(6):
        root = np.clip(root - function(root) / derivative(root), low, high)
    return root


def _by_value(biot: ArrayLike, solve: Callable[[Array], Modes]) -> Modes:
    """Modes for an array of Biot numbers, each different value solved once: runs share a few airflows."""
    biot = np.asarray(biot, dtype=float)
    different, place = np.unique(biot, return_inverse=True)
    modes = solve(different[:, None])
    place = place.reshape(biot.shape)
    return Modes(modes.amplitude[place], modes.rate[place])
