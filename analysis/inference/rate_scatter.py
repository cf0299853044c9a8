"""How much runs differ from one another in their rate: one restricted likelihood, from what each run alone says.

Each run i says x_i, known to s_i, of its ln rate; within an ambient these scatter by sigma about a mean of their own:
-2 log L = sum_g [log sum w - sum log w + sum w (x - mean)^2], w = 1 / (sigma^2 + s_i^2), plus the prior below.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Runs differ a little: relative scatter of the rate from run to run, before the data say otherwise.
RATE_SCATTER = 0.004
RATE_SCATTER_WEIGHT = 2.0  # in runs: how strongly the data must contradict it
RATE_SCATTER_LIMIT = 0.03  # beyond this, runs do not differ a little: the model is wrong
UNVENTILATED_LIMIT = 0.5  # where nobody recorded the airflow, runs may differ as much as airflows do


@dataclass(frozen=True)
class OwnRates:
    """What each run alone says of its ln rate, less the joint one: value and standard uncertainty (R,), its ambient."""

    own: Array
    spread: Array
    ambient: NDArray[np.int64]


def prior_cost(scatter: Array) -> Array:
    """-2 log prior of the scatter, 0 at `RATE_SCATTER`."""
    ratio = scatter / RATE_SCATTER
    return np.asarray(RATE_SCATTER_WEIGHT * (2 * np.log(ratio) + 1 / ratio**2 - 1))


def cost(trials: Array, parts: Iterable[OwnRates]) -> Array:
    """-2 log posterior of trial scatters (T,), up to a constant, from all parts together."""
    total = prior_cost(trials)
    for part in parts:
        weight = 1.0 / (trials[:, None] ** 2 + part.spread**2)
        for g in np.unique(part.ambient):
            here = part.ambient == g
            w, x = weight[:, here], part.own[here]
            mean = (w * x).sum(axis=1) / w.sum(axis=1)
            total = total + np.log(w.sum(axis=1)) - np.log(w).sum(axis=1) + (w * (x - mean[:, None]) ** 2).sum(axis=1)
    return total


def restriction(scatter: float, part: OwnRates) -> float:
    """What -2 log L lacks where the ambients' means are fitted along as if they cost nothing, less that at
    `RATE_SCATTER`: without it the few runs of each ambient would make a scatter likelier the smaller it is."""
    total = 0.0
    for g in np.unique(part.ambient):
        spread = part.spread[part.ambient == g]
        now, before = ((1.0 / (s**2 + spread**2)).sum() for s in (scatter, RATE_SCATTER))
        total += float(np.log(now / before))
    return total


def likeliest(part: OwnRates, limit: float = RATE_SCATTER_LIMIT) -> float:
    """The scatter, up to a limit, that one part's runs make most likely."""
    trials = np.geomspace(0.2 * RATE_SCATTER, limit, 41)
    return float(trials[np.argmin(cost(trials, [part]))])


def posterior_scatter(parts: Iterable[OwnRates], limit: float = RATE_SCATTER_LIMIT) -> float:
    """Root of the posterior mean of sigma^2, up to a limit, over all parts together.

    The mean and not the mode, so that a scatter known from a dozen runs does not make the uncertainties too small.
    """
    trials = np.geomspace(0.1 * RATE_SCATTER, limit, 80)
    total = cost(trials, parts)
    posterior = np.exp(-0.5 * (total - total.min()))
    return float(np.sqrt((posterior * trials**2).sum() / posterior.sum()))
