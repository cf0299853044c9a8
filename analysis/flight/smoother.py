"""Optimal smoother: the air's most probable course given every reading before and after, with its uncertainty.

Kalman filter and modified Bryson-Frazier smoother (Bierman 1973, doi 10.1016/0005-1098(73)90088-5) on the air's
states and the sensor's lags, the sensor exact for air that is straight between samples. kernel.c is the same recursion
compiled, some fifty times as fast; where it was not built, the one here is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.air_prior import (
    AIR,
    AIR_STATES,
    OU_VARIANCES,
    RATES_PER_S,
    TREND_STATES,
    Passing,
    Prior,
    innovation,
    passing_step,
    transition,
)
from shockrig.analysis.flight.response import LagResponse, stepped
from shockrig.files.compiled import demand_current

try:
    from shockrig.analysis.flight import _kernel

    demand_current(_kernel)
except ImportError:  # built where there is a compiler
    _kernel = None  # type: ignore[assignment]

Array = NDArray[np.float64]
TINY_VARIANCE = 1e-300


@dataclass(frozen=True)
class Jumps:
    """Breaks in the air's course in the step before each sample.

    Attributes
    ----------
    variance : ndarray (..., 2)
        Of a jump of the air [unit^2] and of one of its slope [unit^2/s^2].
    place : ndarray (...)
        At which share of the step they fall.
    """

    variance: Array
    place: Array


@dataclass(frozen=True)
class Smoothed:
    """Arrays (windows, n).

    Attributes
    ----------
    air, variance : ndarray
        The air and its variance.
    clean, clean_variance : ndarray
        The reading without noise, and its variance.
    surprise : ndarray
        Innovation over its sigma, NaN without reading.
    jump, jump_score : ndarray (windows, n, 2)
        Size that a jump of the air, or of its slope, in the step before each sample would have, and that size over its
        sigma (the auxiliary residuals of de Jong and Penzer 1998, doi 10.1080/01621459.1998.10473757).
    cost : ndarray
        What each reading adds to minus the log-likelihood, without its constant.
    """

    air: Array
    variance: Array
    clean: Array
    clean_variance: Array
    surprise: Array
    jump: Array
    jump_score: Array
    cost: Array


def smooth(
    step_s: Array,
    reading: Array,
    noise_variance: Array,
    response: LagResponse,
    lags: Array,
    prior: Prior,
    spread: Array,
    passing: Passing | None = None,
    lag_spread: Array | None = None,
    jumps: Jumps | None = None,
    only_cost: bool = False,
    scored: bool = True,
) -> Smoothed:
    """Smooth windows of readings.

    Parameters
    ----------
    step_s : (w, n)
        Time to each sample from the one before (the first of each row is not used).
    reading, noise_variance : (w, n)
        Readings; a variance of infinity marks one that is missing.
    response : Response
        weight and rate of shape (w, n, K).
    lags : (w, K)
        Where the sensor's lags stand at each window's start, as the readings before tell.
    prior : Prior
        Shape (w, n).
    spread : (w,)
        How far the air (and the lags, unless `lag_spread` (w, K) says it of them) may be from there, one sigma.
    passing : Passing, optional
        With `sigma` of shape (w, n); it is part of `air` and of `clean`.
    jumps : Jumps, optional
        Of shape (w, n); what the air may do beside what the prior expects.
    only_cost : bool
        Nothing but `cost` and `surprise` are asked for: the rest is left undone.
    scored : bool
        Without it `jump` and `jump_score` are left undone, where there are no jumps.
    """
    own = spread[:, None] * np.ones(lags.shape) if lag_spread is None else lag_spread
    mean, p = _start(lags, np.nan_to_num(reading[:, 0]), prior, spread, own, passing)
    leaps = Jumps(np.zeros((*reading.shape, 2)), np.full(reading.shape, 0.5)) if jumps is None else jumps
    if _kernel is None:
        return plain(step_s, reading, noise_variance, response, prior, passing, leaps, mean, p)
    return compiled(step_s, reading, noise_variance, response, prior, passing, leaps, mean, p, only_cost, scored)


def compiled(
    step_s: Array,
    reading: Array,
    noise_variance: Array,
    response: LagResponse,
    prior: Prior,
    passing: Passing | None,
    jumps: Jumps,
    mean: Array,
    p: Array,
    only_cost: bool = False,
    scored: bool = True,
) -> Smoothed:
    """`plain` by kernel.c."""
    lag_step = stepped(response.rate, step_s, response.cap, response.inside)
    leaps = bool(jumps.variance.any()) or (scored and not only_cost)
    rest = level = slope = variance = np.zeros(0)
    if leaps:
        rest, variance = step_s * (1.0 - jumps.place), jumps.variance
        level, slope = _answers(response, rest)
    through = np.zeros(0) if passing is None else passing.sigma
    nodes = reading.shape
    shapes = [(*nodes, 2) if name.startswith("jump") else nodes for name in Smoothed.__annotations__]
    out = Smoothed(*(np.full(shape, np.nan) for shape in shapes))
    given = (step_s, reading, noise_variance, response.weight, lag_step.old, lag_step.new, lag_step.decay, lag_step.fed)
    beside = (level, slope, rest, prior.turbulence, prior.bend, through, variance, mean, p)
    of_jumps = (out.jump, out.jump_score) if leaps else (np.zeros(0), np.zeros(0))
    answer = (out.air, out.variance, out.clean, out.clean_variance, out.surprise, *of_jumps, out.cost)
    _kernel.smooth(
        (*nodes, response.rate.shape[-1], len(response.cap), response.inside)
        + (prior.smooth, passing is not None, not only_cost, leaps),
        (0.0, 0.0) if passing is None else (passing.rate, passing.coupling),
        np.concatenate([RATES_PER_S, OU_VARIANCES]),
        (*(np.ascontiguousarray(one, dtype=float) for one in (*given, *beside)), *answer),
    )
    return out


def followed(values: Array, decay: float, start: float) -> Array:
    """A lag of first order behind values (n,) that are held over each step, from `start`."""
    if _kernel is None:
        from scipy.signal import lfilter  # takes longer to import than all the rest

        return np.asarray(lfilter([1 - decay], [1.0, -decay], values, zi=[decay * start])[0])
    out = np.empty(values.size)
    _kernel.follow(np.ascontiguousarray(values, dtype=float), decay, start, out)
    return out


def plain(
    step_s: Array,
    reading: Array,
    noise_variance: Array,
    response: LagResponse,
    prior: Prior,
    passing: Passing | None,
    jumps: Jumps,
    mean: Array,
    p: Array,
) -> Smoothed:
    """The recursions: forward from `mean` (w, size) and covariance `p` (w, size, size), and back."""
    modes = response.rate.shape[-1]
    phi, q, leap = _model(step_s, response, prior, passing, jumps)
    size = phi.shape[-1]
    c = np.zeros((reading.shape[1], reading.shape[0], size))
    c[..., AIR_STATES : AIR_STATES + modes] = np.moveaxis(response.weight, 1, 0)
    h = np.concatenate([AIR, np.zeros(size - AIR_STATES)])
    if passing is not None:
        c[..., -1] = 1.0
        h[-1] = 1.0 + passing.coupling
    forward = _forward(reading, noise_variance, phi, q, c, h, mean, p)
    return _back(forward, phi, c, h, leap)


@dataclass(frozen=True)
class _Forward:
    """What goes back from a filter: arrays (n, windows) of which readings are `seen`, their surprise and its variance
    and the variance of the air before them; (n, windows, size) of means before each reading, its gains, and covariances
    of the states with the air and with the reading."""

    seen: NDArray[np.bool_]
    surprise: Array
    variance: Array
    air_variance: Array
    mean: Array
    gain: Array
    with_air: Array
    with_reading: Array


def _forward(
    reading: Array, noise_variance: Array, phi: Array, q: Array, c: Array, h: Array, mean: Array, p: Array
) -> _Forward:
    """The filter, from `mean` and covariance `p`: steps by `phi` and `q`, a reading of `c`, the air being `h`."""
    count, windows, _ = c.shape
    kept_mean, ph, pc, gains = (np.empty(c.shape) for _ in range(4))
    surprise, variance, air_variance = (np.empty((count, windows)) for _ in range(3))
    noise = np.ascontiguousarray(noise_variance.T)
    seen = np.isfinite(noise)
    y = np.where(seen, reading.T, 0.0)
    for k in range(count):
        if k:
            mean = (phi[k] @ mean[..., None])[..., 0]
            p = phi[k] @ p @ phi[k].swapaxes(-1, -2)
            # what is not symmetric is rounding, which no reading takes out
            p = 0.5 * (p + p.swapaxes(-1, -2)) + q[k]
        ck = c[k]
        kept_mean[k] = mean
        pc[k] = pck = (p @ ck[..., None])[..., 0]
        ph[k] = phk = p @ h
        air_variance[k] = phk @ h
        variance[k] = s = np.where(seen[k], np.maximum((ck * pck).sum(-1), 0.0) + noise[k], np.inf)
        surprise[k] = v = np.where(seen[k], y[k] - (ck * mean).sum(-1), 0.0)
        gains[k] = gain = pck / s[:, None]
        mean = mean + gain * v[:, None]
        p = p - gain[:, :, None] * pck[:, None, :]
    return _Forward(seen, surprise, variance, air_variance, kept_mean, gains, ph, pc)


def _back(forward: _Forward, phi: Array, c: Array, h: Array, leap: Array) -> Smoothed:
    """The smoother, from the last reading to the first; `leap` is what a jump does to the states."""
    count, windows, size = c.shape
    air, clean, variance, clean_variance = (np.empty((count, windows)) for _ in range(4))
    pull, hold_on = (np.zeros((count, windows, 2)) for _ in range(2))
    small = np.zeros((windows, size))
    big = np.zeros((windows, size, size))
    for k in range(count - 1, -1, -1):
        if k < count - 1:
            back = phi[k + 1].swapaxes(-1, -2)
            small = (back @ small[..., None])[..., 0]
            big = back @ big @ phi[k + 1]
        ck, gain, mean, with_reading = c[k], forward.gain[k], forward.mean[k], forward.with_reading[k]
        v = (big @ gain[..., None])[..., 0]
        both = (gain * v).sum(-1) + 1.0 / forward.variance[k]
        big = (
            big
            - ck[:, :, None] * (v - 0.5 * both[:, None] * ck)[:, None, :]
            - (v - 0.5 * both[:, None] * ck)[:, :, None] * ck[:, None, :]
        )
        small = small - ck * ((gain * small).sum(-1) + forward.surprise[k] / forward.variance[k])[:, None]
        air[k] = mean @ h - (forward.with_air[k] * small).sum(-1)
        clean[k] = (ck * mean).sum(-1) - (with_reading * small).sum(-1)
        asked = np.concatenate([forward.with_air[k, ..., None], with_reading[..., None], leap[k]], axis=-1)
        of_them = (asked * (big @ asked)).sum(axis=1)
        variance[k] = forward.air_variance[k] - of_them[:, 0]
        clean_variance[k] = (ck * with_reading).sum(-1) - of_them[:, 1]
        pull[k], hold_on[k] = (small[:, None] @ leap[k])[:, 0], of_them[:, 2:]
    seen = forward.seen
    surprise = np.where(seen, forward.surprise / np.sqrt(forward.variance), np.nan)
    cost = 0.5 * (np.log(np.where(seen, forward.variance, 1.0)) + np.nan_to_num(surprise) ** 2)
    pull[0] = 0.0
    hold_on = np.maximum(hold_on, TINY_VARIANCE)
    return Smoothed(
        air.T,
        np.maximum(variance, 0.0).T,
        clean.T,
        np.maximum(clean_variance, 0.0).T,
        surprise.T,
        -(pull / hold_on).swapaxes(0, 1),
        -(pull / np.sqrt(hold_on)).swapaxes(0, 1),
        np.where(seen, cost, 0.0).T,
    )


def _model(
    step_s: Array, response: LagResponse, prior: Prior, passing: Passing | None, jumps: Jumps
) -> tuple[Array, Array, Array]:
    """Transition and its noise for each step (n, w, size, size), and what a jump by 1 in it does to the states."""
    step = np.ascontiguousarray(step_s.T)
    rate, modes = np.moveaxis(response.rate, 1, 0), response.rate.shape[-1]
    lag_step = stepped(rate, step, response.cap, response.inside)
    old, new = lag_step.old, lag_step.new
    lags = slice(AIR_STATES, AIR_STATES + modes)
    size = lags.stop + 2 * (passing is not None)
    a = transition(step)
    phi = np.zeros((*step.shape, size, size))
    phi[..., :AIR_STATES, :AIR_STATES] = a
    phi[..., lags, :AIR_STATES] = old[..., None] * AIR + new[..., None] * (AIR @ a)[..., None, :]
    index = np.arange(lags.start, lags.stop)
    phi[..., index, index] = lag_step.decay
    if count := len(response.cap):
        phi[..., lags, lags][..., response.within, :count] = lag_step.fed
    qa = innovation(step, prior.each(np.transpose))
    to_air = qa @ AIR
    q = np.zeros(phi.shape)
    q[..., :AIR_STATES, :AIR_STATES] = qa
    q[..., lags, :AIR_STATES] = new[..., None] * to_air[..., None, :]
    q[..., :AIR_STATES, lags] = q[..., lags, :AIR_STATES].swapaxes(-1, -2)
    q[..., lags, lags] = new[..., :, None] * new[..., None, :] * (to_air @ AIR)[..., None, None]
    if passing is not None:
        across = Passing(passing.sigma.T, passing.rate)
        swing, added = passing_step(across, step)
        phi[..., -2:, -2:], q[..., -2:, -2:] = swing, added
        if passing.coupling:
            drive = passing.coupling * new
            phi[..., lags, -2:] = drive[..., None] * swing[..., None, 1, :]
            phi[..., lags, -1] += passing.coupling * old
            q[..., lags, -2:] = drive[..., None] * added[..., None, 1, :]
            q[..., -2:, lags] = q[..., lags, -2:].swapaxes(-1, -2)
            q[..., lags, lags] += drive[..., :, None] * drive[..., None, :] * added[..., 1, 1, None, None]
    rest = step * (1.0 - jumps.place.T)
    leap = np.zeros((*step.shape, size, 2))
    leap[..., 0, 0], leap[..., 0, 1], leap[..., 1, 1] = 1.0, rest, 1.0
    leap[..., lags, 0], leap[..., lags, 1] = (np.moveaxis(a, 1, 0) for a in _answers(response, rest.T))
    if jumps.variance.any():
        q += (jumps.variance.swapaxes(0, 1)[..., None, :] * leap) @ leap.swapaxes(-1, -2)
    return phi, q, leap


def _answers(response: LagResponse, rest_s: Array) -> tuple[Array, Array]:
    """Where lags (..., K) stand `rest_s` (...) after a jump by one of the air, and of its slope."""
    after = stepped(response.rate, rest_s, response.cap, response.inside)
    level, slope = np.subtract(1.0, after.decay, out=after.decay), after.new
    level[..., response.within] -= after.fed.sum(axis=-1)
    slope *= rest_s[..., None]
    return level, slope


def _start(
    lags: Array, first: Array, prior: Prior, spread: Array, lag_spread: Array, passing: Passing | None
) -> tuple[Array, Array]:
    """Air near the first reading, lags near where the readings before leave them; turbulence as it is on the long
    run."""
    windows, modes = lags.shape
    size = AIR_STATES + modes + 2 * (passing is not None)
    mean = np.zeros((windows, size))
    mean[:, 0], mean[:, AIR_STATES : AIR_STATES + modes] = first, lags
    p = np.zeros((windows, size, size))
    p[:, 0, 0] = p[:, 1, 1] = spread**2
    if prior.smooth:
        p[:, 2, 2] = spread**2
    index = np.arange(TREND_STATES, AIR_STATES)
    p[:, index, index] = prior.turbulence[:, :1] ** 2 * OU_VARIANCES
    index = np.arange(AIR_STATES, AIR_STATES + modes)
    p[:, index, index] = lag_spread**2
    if passing is not None:
        p[:, -1, -1] = passing.sigma[:, 0] ** 2
        p[:, -2, -2] = p[:, -1, -1] / passing.rate**2
    return mean, p
