"""Sensors driven by air as it was measured: a trace of samples joined by straight lines, through a body's modes.

With u the air, y(t) = u(t) + sum_k a_k z_k(t), z_k' = u' - lambda_k z_k: along a straight piece from u_i to u_{i+1} in
the time D, z_k becomes exp(-lambda_k D) z_k + (u_{i+1} - u_i) phi(lambda_k D), phi(x) = (1 - exp(-x)) / x. Exact, at a
cost linear in samples; a mode far faster than the sampling keeps nothing and follows the slope.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shockrig.analysis.physics.exponentials import Modes
from shockrig.files.compiled import demand_current

try:
    from shockrig.analysis.physics import _sums

    demand_current(_sums)
except ImportError:  # built without a compiler: the same in NumPy, slowly
    _sums = None  # type: ignore[assignment]

__all__ = ["beside_lagging_reference", "noise_passed", "respond", "undo_lag", "undone_uncertainty"]

Array = NDArray[np.float64]

FORGOTTEN_EXPONENT = 36.0  # exp(-36) of a mode is the rounding of what it is added to
EVEN_SPREAD = 1e-9  # relative spread of a trace's distances that is but rounding of its clock
JUMP_S = 1e-150  # a jump is a straight piece of this length
STATES_AT_ONCE = 600_000  # states of modes at the trace's samples, held in memory at a time
READ_AT_ONCE = 60_000  # states of modes between them, of which several arrays should fit a processor's cache


def respond(
    modes: Modes,
    trace_time_s: Array,
    trace_value: Array,
    at_s: Array,
    *,
    settled_to: ArrayLike | None = None,
    samples: int = 1,
    period_s: float = 1.0,
) -> Array:
    """Response to a measured trace at any times, exact for straight lines between its samples.

    Before its first sample the air stood at `settled_to` (its first value unless given) for ever, after its last
    sample it stands at its last value. Two samples at one time are a jump. A diffusivity that changes along the trace
    is another time axis: with dimensionless modes, hand in the integral of alpha/R^2 or D/L^2 for both times.

    Parameters
    ----------
    modes : Modes
        Of shape (..., K), rates [1/s].
    trace_time_s : ndarray (m,)
        Times of the trace's samples [s], never falling.
    trace_value : ndarray (..., m)
        Its values, finite, in any unit in which the body takes it up (degC, vapour pressure).
    at_s : ndarray (..., n)
        When the response is wanted [s], in any order.
    settled_to : array_like, optional
        Value to which the body had settled before the trace; shape of the leading axes.
    samples, period_s : int, float
        Where a logger averages: the mean of the responses at t, t - period_s, ... over `samples` readings.

    Returns
    -------
    ndarray (..., n)
        Leading axes of all arguments broadcast (candidates, runs).

    Raises
    ------
    ValueError
        Fewer than one sample, values that are not finite, times that fall.
    """
    time, value = np.asarray(trace_time_s, dtype=float), np.asarray(trace_value, dtype=float)
    if not (time.ndim == 1 and time.size and value.shape[-1] == time.size and np.isfinite(value).all()):
        raise ValueError("a trace needs one or more times, and a finite value at each of them")
    if not (np.diff(time) >= 0).all():
        raise ValueError("the times of a trace must not fall")
    at, modes = np.asarray(at_s, dtype=float), modes.ascending()
    if samples > 1:
        spread = (at[..., None] - period_s * np.arange(samples)).reshape(*at.shape[:-1], -1)
        found = _respond(modes, time, value, spread, settled_to)
        return found.reshape(*found.shape[:-1], at.shape[-1], samples).mean(axis=-1)
    return _respond(modes, time, value, at, settled_to)


def _respond(modes: Modes, time: Array, value: Array, at: Array, settled_to: ArrayLike | None) -> Array:
    """As `respond`, of single readings and arrays that were looked at."""
    start = np.asarray(value[..., 0] if settled_to is None else settled_to, dtype=float)[..., None]
    lead = np.broadcast_shapes(*(x.shape[:-1] for x in (modes.amplitude, modes.rate, value, at, start)))
    amplitude, rate, values, start = (_rows(x, lead) for x in (modes.amplitude, modes.rate, value, start))
    wanted = at[None] if at.ndim == 1 else _rows(at, lead)  # times that all rows share are looked up once
    found = (plain if _sums is None else compiled)(time, amplitude, rate, values, start, wanted)
    return found.reshape(*lead, at.shape[-1])


def compiled(time: Array, amplitude: Array, rate: Array, values: Array, start: Array, wanted: Array) -> Array:
    """The same as `plain` by sums.c."""
    out = np.empty((len(rate), wanted.shape[1]))
    order = np.broadcast_to(np.argsort(wanted, axis=1, kind="stable"), out.shape)
    amplitude, rate, time, values, start, wanted = (
        np.ascontiguousarray(x) for x in (amplitude, rate, time, values, start, np.broadcast_to(wanted, out.shape))
    )
    order = np.ascontiguousarray(order)
    gone, even, jump = FORGOTTEN_EXPONENT, EVEN_SPREAD, JUMP_S
    _sums.drive(rate.shape[1], amplitude, rate, time, values, start, wanted, order, gone, even, jump, out)
    return out


def plain(time: Array, amplitude: Array, rate: Array, values: Array, start: Array, wanted: Array) -> Array:
    """Response (P, n) at `wanted`, (P, n) or (1, n), of rows of modes (P, K) that ascend to `values` (P, m) at `time`
    (m,), from `start` (P, 1), in NumPy."""
    length = np.append(np.maximum(np.diff(time), JUMP_S), 1.0)
    slope = np.append(np.diff(values) / length[:-1], np.zeros((len(values), 1)), axis=1)
    piece = np.searchsorted(time, wanted, side="left") - 1  # a sample's own time ends the piece before it
    # What each mode and all faster ones add where they follow the slope: sums of a / lambda from the end.
    steady = np.append(np.cumsum((amplitude / rate)[:, ::-1], axis=1)[:, ::-1], np.zeros((len(rate), 1)), axis=1)

    row = np.arange(len(rate))[:, None]
    out = np.array(np.broadcast_to(start, (len(rate), wanted.shape[1])))
    state = np.array(np.broadcast_to(values[:, :1] - start, rate.shape))
    scanned = int(np.sum(rate.min(axis=0) * length.min() < FORGOTTEN_EXPONENT))
    at_once = max(STATES_AT_ONCE // max(len(rate) * scanned, 1), 64)
    for first in range(0, time.size, at_once):
        last = min(first + at_once, time.size)
        slow = int(np.sum(rate.min(axis=0) * length[first:last].min() < FORGOTTEN_EXPONENT))
        states = _scan(rate[:, :slow], length[first:last], slope[:, first:last], state[:, :slow])
        here = (piece >= first) & (piece < last)
        for columns, kept in _alike(rate, np.where(here, wanted - time[piece], np.inf).min(axis=0)):
            index = np.clip(piece[:, columns], first, last - 1)
            since, rising = np.maximum(wanted[:, columns] - time[index], 0.0), slope[row, index]
            held = states[(index - first) % len(states), (index - first) // len(states), row, :kept]
            if kept > slow:  # a mode that has forgotten all but the piece before needs no scan
                before = slope[row, np.maximum(index - 1, 0), None] / rate[:, None, slow:kept]
                begun = np.where((index > first)[..., None], before, state[:, None, slow:kept])
                held = np.concatenate([held, begun], axis=-1)
            following = rising[..., None] * (1.0 / rate)[:, None, :kept]
            z = held + np.expm1(-rate[:, None, :kept] * since[..., None]) * (held - following)
            reading = values[row, index] + rising * (since + steady[:, kept, None])
            reading += np.matmul(z, amplitude[:, :kept, None])[..., 0]
            out[:, columns] = np.where(here[:, columns], reading, out[:, columns])
        after = states[(last - first) % len(states), (last - first) // len(states)]
        state = np.concatenate([after, slope[:, last - 1, None] / rate[:, slow:]], axis=1)
    return out


def _alike(rate: Array, since_s: Array) -> Iterator[tuple[NDArray[np.int64], int]]:
    """Columns that need equally many modes so long after a sample, in blocks, with that number; none for infinity."""
    most = rate.shape[-1]
    need = np.searchsorted(rate.min(axis=0), FORGOTTEN_EXPONENT / np.maximum(since_s, 1e-300), side="right")
    need = np.minimum(-(-np.maximum(need, 1) // 8) * 8, most)
    for kept in np.unique(need).tolist():
        columns = np.flatnonzero((need == kept) & np.isfinite(since_s))
        blocks = 1 + columns.size * len(rate) * kept // READ_AT_ONCE
        yield from ((some, kept) for some in np.array_split(columns, blocks) if some.size)


def _rows(array: Array, lead: tuple[int, ...]) -> Array:
    """An array (..., n) with its leading axes broadcast and made one."""
    if array.shape[:-1] != lead:
        array = np.broadcast_to(array, (*lead, array.shape[-1]))
    return array.reshape(-1, array.shape[-1])


def _scan(rate: Array, length_s: Array, slope: Array, state: Array) -> Array:
    """States z at the start of each piece, and of the one after the last: piece i at [i % L, i // L] of (L, N, P, K).

    The pieces are cut into N blocks of L, about the root of their number, and all blocks take a step at once: first
    from rest, to find what each hands to the next, then from the states at which they begin.
    """
    long = int(np.ceil(np.sqrt(length_s.size)))
    blocks = length_s.size // long + 1
    spare = long * blocks - length_s.size
    even = np.expm1(-rate * length_s[0]) if np.ptp(length_s) < EVEN_SPREAD * length_s[0] else None
    length_s = np.append(length_s, np.ones(spare)).reshape(blocks, long).T[..., None, None]
    slope = np.append(slope, np.zeros((len(slope), spare)), axis=1).T.reshape(blocks, long, -1).swapaxes(0, 1)
    states = np.empty((long, blocks, *rate.shape))
    slowness = 1.0 / rate
    end = np.zeros((blocks, *rate.shape))
    change = np.empty_like(end)
    for i in range(long):  # z changes by (exp(-rate D) - 1) (z - slope / rate)
        forgotten = np.expm1(-rate * length_s[i], out=states[i]) if even is None else even
        np.subtract(end, np.multiply(slope[i, ..., None], slowness, out=change), out=change)
        end += np.multiply(change, forgotten, out=change)
    whole = np.exp(-rate * length_s.sum(axis=0))
    begun = np.empty_like(end)
    for block in range(blocks):
        begun[block] = state
        state = whole[block] * state + end[block]
    for i in range(long):
        forgotten = states[i] if even is None else even
        np.subtract(begun, np.multiply(slope[i, ..., None], slowness, out=change), out=change)
        np.multiply(change, forgotten, out=change)
        states[i] = begun
        begun += change
    return states


def undo_lag(trace_time_s: Array, trace_value: Array, time_constant_s: ArrayLike) -> Array:
    """The air that a reference with a first-order lag saw: its trace plus time constant times slope, at its samples.

    The slope at a sample is that of the straight line through its neighbours, which keeps the integral over time and
    where the trace is straight is exact. Noise grows with it: independent noise of the samples by the factor
    sqrt(1 + (time_constant / period)^2 / 2), so a lag that is long beside the sampling is better left in the trace and
    taken out of the body with `beside_lagging_reference`, where the body smooths what the slope adds.

    Parameters
    ----------
    trace_time_s : ndarray (m,)
        Times [s], rising.
    trace_value : ndarray (..., m)
    time_constant_s : array_like
        Of the reference [s], 0 or more; shape of the leading axes.

    Returns
    -------
    ndarray (..., m)

    Raises
    ------
    ValueError
        Times that do not rise.
    """
    value = np.asarray(trace_value, dtype=float)
    return value + np.asarray(time_constant_s, dtype=float)[..., None] * _slope(trace_time_s, value)


def undone_uncertainty(
    trace_time_s: Array,
    trace_value: Array,
    time_constant_s: float,
    *,
    noise: float,
    offset: float = 0.0,
    time_constant_uncertainty_s: float = 0.0,
) -> Array:
    """Standard uncertainty (..., m) of what `undo_lag` gives, in the trace's unit.

    Parameters
    ----------
    noise, offset : float
        Standard uncertainties of the trace: independent from sample to sample, which the slope amplifies, and common
        to all samples, which has no slope.
    time_constant_uncertainty_s : float
        Of the reference's time constant [s], one sigma; it counts where the air changes.
    """
    slope = _slope(trace_time_s, np.asarray(trace_value, dtype=float))
    count = slope.shape[-1]
    # x_i = v_i + tau (v_j - v_h) / (t_j - t_h), with h and j the neighbours, or the sample itself at an end.
    at = np.arange(count)
    before, after = np.maximum(at - 1, 0), np.minimum(at + 1, count - 1)
    width = np.asarray(trace_time_s, dtype=float)[after] - np.asarray(trace_time_s, dtype=float)[before]
    share = time_constant_s / np.where(width > 0, width, np.inf)
    gain = (1.0 + share * (after == at) - share * (before == at)) ** 2
    gain += share**2 * (1.0 * (after != at) + (before != at))
    return np.sqrt(noise**2 * gain + offset**2 + (time_constant_uncertainty_s * slope) ** 2)


def beside_lagging_reference(modes: Modes, time_constant_s: ArrayLike) -> Modes:
    """The response to what a reference with a first-order lag shows, instead of to the air: S(t) + tau S'(t).

    Driven by the reference's trace as it is, these modes give what the body makes of the air before that lag, exactly
    for straight lines between samples: the body smooths the slope, and the trace need not be differentiated.

    Parameters
    ----------
    modes : Modes
        The body's; its response must start at zero (amplitudes that sum to -1), as all bodies' do.
    time_constant_s : array_like
        Of the reference [s], 0 or more; shape of the leading axes.
    """
    return Modes(modes.amplitude * (1.0 - np.asarray(time_constant_s, dtype=float)[..., None] * modes.rate), modes.rate)


def noise_passed(modes: Modes, period_s: float) -> Array:
    """Standard deviation of the response, at a sample, to independent noise of the trace's samples of deviation 1.

    The response to one sample of 1 among zeros (a triangle) is 1 + sum_k a_k phi(lambda_k D) at its peak, and then the
    sum of modes c_k exp(-lambda_k D (j - 1)), c_k = -a_k phi(lambda_k D) (1 - exp(-lambda_k D)); the squares are added
    as geometric series. Shape: the leading axes of `modes`.
    """
    turns = modes.rate * period_s
    forgotten = -np.expm1(-turns)
    share = modes.amplitude * forgotten / turns
    later = -share * forgotten
    pairs = later[..., :, None] * later[..., None, :] / -np.expm1(-(turns[..., :, None] + turns[..., None, :]))
    return np.sqrt((1.0 + share.sum(axis=-1)) ** 2 + pairs.sum(axis=(-2, -1)))


def _slope(time_s: Array, value: Array) -> Array:
    """Slope at each sample through its neighbours, one-sided at the ends; 0 for a single sample."""
    time = np.asarray(time_s, dtype=float)
    if not (np.diff(time) > 0).all():
        raise ValueError("the times of a trace whose lag is undone must rise")
    if time.size < 2:
        return np.zeros_like(value)
    ends = [(value[..., 1:2] - value[..., :1]) / (time[1] - time[0]), np.diff(value[..., -2:]) / (time[-1] - time[-2])]
    return np.concatenate([ends[0], (value[..., 2:] - value[..., :-2]) / (time[2:] - time[:-2]), ends[1]], axis=-1)
