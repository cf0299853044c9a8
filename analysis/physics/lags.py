"""First-order lags, alone, beside a response and in series with it: a lump, a support, a sheath, a housing, a vent.

All are sums of exponentials again; in series by partial fractions, safe where rates are equal.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shockrig.analysis.physics.exponentials import Modes

Array = NDArray[np.float64]

NEAR_RATES = 3e-5  # relative distance of two rates from which partial fractions keep ten digits
NEAR_RATES_LIMIT = 0.99 * NEAR_RATES


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
    mu = _clear_of(first.rate, mu)  # (..., 2)
    passed = first.amplitude[..., None, :] / (1.0 - first.rate[..., None, :] / mu[..., None])  # (..., 2, K)
    return _joined((passed.mean(axis=-2), first.rate), (-0.5 * (1.0 + passed.sum(axis=-1)), mu))


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
    """Amplitudes and rates of several sums as one, rates ascending."""
    lead = np.broadcast_shapes(*(array.shape[:-1] for part in parts for array in part))
    amplitude = np.concatenate([np.broadcast_to(a, (*lead, a.shape[-1])) for a, _ in parts], axis=-1)
    rate = np.concatenate([np.broadcast_to(r, (*lead, r.shape[-1])) for _, r in parts], axis=-1)
    order = np.argsort(rate, axis=-1, kind="stable")
    return Modes(np.take_along_axis(amplitude, order, -1), np.take_along_axis(rate, order, -1))


def slowest(modes: Modes, count: int) -> Modes:
    """The slowest modes alone; what the others carry follows with the last of them, so that steps start at zero."""
    if modes.rate.shape[-1] <= count:
        return modes
    lead = np.broadcast_shapes(modes.amplitude.shape[:-1], modes.rate.shape[:-1])
    amplitude = np.array(np.broadcast_to(modes.amplitude, (*lead, modes.amplitude.shape[-1]))[..., :count])
    amplitude[..., -1] += np.broadcast_to(modes.amplitude, (*lead, modes.amplitude.shape[-1]))[..., count:].sum(axis=-1)
    return Modes(amplitude, modes.rate[..., :count])
