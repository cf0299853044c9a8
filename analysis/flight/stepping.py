"""A sensor's lags stepped exactly from sample to sample: q' = decay q + fed cap + old air + new air'.

The air is straight (or held) over a step. Lags follow the air, or the inside of a cap: a mix v of lags x_j behind
the air. Behind those a lag of rate lambda gains v_j E_j x_j in a step h, with
E_j = lambda (exp(-mu_j h) - exp(-lambda h)) / (lambda - mu_j), which has no pole where the rates are equal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LagStep:
    """Coefficients of one step of K lags, of which the first J are a cap's and the next M follow its inside.

    Attributes
    ----------
    old, new, decay : ndarray (..., K)
        What the air before and after the step, and the lag itself, add to the lag.
    fed : ndarray (..., M, J)
        What each of the cap's lags adds to each lag inside.
    """

    old: Array
    new: Array
    decay: Array
    fed: Array


def hold(rate: Array, step_s: Array) -> tuple[Array, Array, Array]:
    """(old, new, decay) of lags behind air that is straight over the step; shapes broadcast."""
    x = np.maximum(rate * step_s, 1e-12)
    decay = np.expm1(-x)
    gone = -decay
    new = 1.0 - gone / x
    small = x < 1e-4  # the difference loses its digits there
    if small.any():
        new = np.where(small, x / 2 - x**2 / 6, new)
    decay += 1.0
    gone -= new
    return gone, new, decay


def stepped(rate: Array, step_s: Array, cap: tuple[float, ...] = (), inside: int = 0) -> LagStep:
    """One step of lags `rate` (..., K) over `step_s` (...), air straight; `cap` is the mix v of the first lags."""
    h = np.asarray(step_s, dtype=float)[..., None]
    old, new, decay = hold(rate, h)
    count = len(cap)
    if not count:
        return LagStep(old, new, decay, np.zeros((*old.shape[:-1], 0, 0)))
    within = slice(count, count + inside)
    fed = np.asarray(cap) * handed_on(rate[..., within], rate[..., :count], h)
    # Inside, the drive is v_j (x_j's straight line, 1/mu_j late, and its decaying rest): x_j's own share is `fed`.
    shares = np.asarray(cap)[None, :] * -np.expm1(-rate[..., within, None] * h[..., None])
    late = ((fed - shares) / np.maximum(rate[..., None, :count] * h[..., None], 1e-12)).sum(axis=-1)
    old[..., within] -= fed.sum(axis=-1) + late
    new[..., within] += late
    return LagStep(old, new, decay, fed)


def handed_on(inner: Array, outer: Array, step_s: Array) -> Array:
    """E (..., M, J): what a lag of rate `outer` (..., J) hands on in a step to one of rate `inner` (..., M) behind it.

    `step_s` is (..., 1).
    """
    first, second, h = inner[..., :, None], outer[..., None, :], step_s[..., None]
    apart = np.maximum(np.abs(first - second) * h, 1e-12)
    return first * h * np.exp(-np.minimum(first, second) * h) * -np.expm1(-apart) / apart


def held_matrix(rate: Array, period_s: float, cap: tuple[float, ...] = (), inside: int = 0) -> Array:
    """Transition (K, K) of one instant's lags `rate` (K,) over a period; air that is held adds 1 - its row sums."""
    step = stepped(rate, np.array(period_s), cap, inside)
    matrix = np.diag(step.decay)
    count = len(cap)
    matrix[count : count + inside, :count] = step.fed
    return matrix
