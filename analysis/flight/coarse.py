"""Readings coarser than their noise: each says that the sensor was within half a step of it, and no more.

The likelihood of a reading y of step q is Phi((y + q/2 - z) / s) - Phi((y - q/2 - z) / s) of the sensor's z under noise
s. Expectation propagation (Minka 2001, arXiv 1301.2294) makes it the Gaussian that has the same moments beside all
other readings, so that the smoother stays what it is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from shockrig.analysis.flight.sweep import Sweep

Array = NDArray[np.float64]
COARSE_IN_NOISE = 2.0  # times the noise: finer steps are noise like any other
MOST_ROUNDS = 30
NEWTON_DAMPING = 0.7  # of each round's step, halved where the rounds do not come to rest: neighbours say the same thing
SLOWER = 0.7  # of what the round before moved it by: more is no coming to rest
AT_REST = 0.02  # of a step, that a round moves the sensor by
SHARPEST_SIGMA = 0.1  # of a step
REACH_IN_NOISE = 2.0  # times the noise
VAGUE_VARIANCE = 1e4  # a reading's variance is at most so many times its step's square


def propagated(
    sweep: Callable[[Array, Array], Sweep], values: Array, variance: Array, step: Array, noise: Array
) -> tuple[Array, Array]:
    """Readings (m,) and variances as the Gaussians that stand for their intervals; variance infinite where none is.

    `sweep` smooths such readings, `step` and `noise` (m,) are of each.
    """
    seen = np.isfinite(variance)
    site, site_variance = values.copy(), variance.copy()
    damping, before, moved = NEWTON_DAMPING, values, np.inf
    for _ in range(MOST_ROUNDS):
        found = sweep(site, site_variance)
        last, moved = moved, float(np.max(np.abs(found.clean - before)[seen] / step[seen], initial=0.0))
        before = found.clean
        if moved < AT_REST:
            break
        if moved > SLOWER * last:
            damping *= 0.5
        precision, shift = 1.0 / site_variance[seen], site[seen] / site_variance[seen]
        own = np.maximum(found.clean_variance[seen], 1e-12 * step[seen] ** 2)
        others = np.maximum(1.0 / own - precision, 1e-6 / step[seen] ** 2)
        mean = (found.clean[seen] / own - shift) / others
        tilted, tilted_variance = within(values[seen], step[seen], noise[seen], mean, 1.0 / others)
        # no reading says more than its noise lets it
        finest = 1.0 / (noise[seen] ** 2 + (SHARPEST_SIGMA * step[seen]) ** 2)
        new = np.clip(1.0 / tilted_variance - others, 1.0 / (VAGUE_VARIANCE * step[seen] ** 2), finest)
        # nor does it pull from farther than where it could have come from, however far the others are
        reach = 0.5 * step[seen] + REACH_IN_NOISE * noise[seen]
        centre = tilted + others / new * (tilted - mean)
        new_shift = new * np.clip(centre, values[seen] - reach, values[seen] + reach)
        precision = (1 - damping) * precision + damping * new
        shift = (1 - damping) * shift + damping * new_shift
        site_variance[seen], site[seen] = 1.0 / precision, shift / precision
    return np.where(seen, site, found.clean), site_variance


def within_a_step(time_s: Array, level: Array, step: Array, noise: Array, memory_s: float) -> Array:
    """Variance (m,) that the air keeps at least, where no change of level is nearer than `memory_s`.

    Steady air may lie anywhere within a step where no noise would carry the reading over its edge, and many readings
    alike say no more of it than one. Levels are NaN where nothing was read.
    """
    rows = np.flatnonzero(np.isfinite(level))
    changed = time_s[rows[np.flatnonzero(np.diff(level[rows]))]]
    bounds = np.concatenate([[-np.inf], changed, [np.inf]])
    after = np.searchsorted(bounds, time_s)
    apart = np.minimum(bounds[after] - time_s, time_s - bounds[after - 1])
    return np.where(apart > memory_s, np.maximum(0.5 * step - REACH_IN_NOISE * noise, 0.0) ** 2 / 3.0, 0.0)


def within(reading: Array, step: Array, noise: Array, mean: Array, variance: Array) -> tuple[Array, Array]:
    """Mean and variance of z ~ N(mean, variance), given that z + noise was rounded to `reading`; shapes kept."""
    wide = np.sqrt(variance + noise**2)
    low, high = ((reading + sign * 0.5 * step - mean) / wide for sign in (-1.0, 1.0))
    flip = low > 0  # the lower tail keeps its digits
    low, high = np.where(flip, -high, low), np.where(flip, -low, high)
    top, bottom = log_ndtr(high), log_ndtr(low)
    mass = top + np.log1p(-np.exp(np.minimum(bottom - top, -1e-300)))
    at_low, at_high = (np.exp(-0.5 * x**2 - 0.5 * np.log(2 * np.pi) - mass) for x in (low, high))
    first = (at_low - at_high) * np.where(flip, -1.0, 1.0)
    second = low * at_low - high * at_high
    share = variance / wide
    return mean + share * first, np.maximum(variance + share**2 * (second - first**2), 1e-9 * variance)
