"""How much runs differ from one another in their rate, pooled over both sensors: from what each run alone says.

Restricted likelihood of the scatter s, with the prior of analysis.gls; its posterior mean of s^2 is used, so that a
scatter known from a dozen runs does not make the uncertainties too small.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.gls import RATE_SCATTER, RATE_SCATTER_LIMIT, RATE_SCATTER_WEIGHT, Fit, Problem

Array = NDArray[np.float64]


def alone(problem: Problem, found: Fit) -> tuple[Array, Array]:
    """Each run's ln rate less the joint one, and its standard uncertainty, by that run's readings alone (R,)."""
    prior = 1.0 / problem.scatter**2
    normal = np.einsum("rna,rnb->rab", found.run_jacobian, found.run_jacobian)
    diagonal = np.arange(normal.shape[1])
    # The scatter that the joint fit settled on, which its deviations were held by.
    prior[:, 1] = 1.0 / found.rate_scatter**2
    normal[:, diagonal, diagonal] += prior
    information = np.maximum(1.0 / np.linalg.inv(normal)[:, 1, 1] - prior[:, 1], 1e-9)
    own = found.deviations[:, 1] * (information + prior[:, 1]) / information
    return own, 1.0 / np.sqrt(information)


def pooled_scatter(parts: Iterable[tuple[Problem, Fit]]) -> float:
    """Standard deviation of ln rate from run to run within an ambient, from all parts together."""
    trials = np.geomspace(0.1 * RATE_SCATTER, RATE_SCATTER_LIMIT, 80)
    cost = RATE_SCATTER_WEIGHT * (2 * np.log(trials / RATE_SCATTER) + (RATE_SCATTER / trials) ** 2)
    for problem, found in parts:
        own, spread = alone(problem, found)
        weight = 1.0 / (trials[:, None] ** 2 + spread**2)
        for g in np.unique(problem.channel.ambient):
            here = problem.channel.ambient == g
            w, x = weight[:, here], own[here]
            mean = (w * x).sum(axis=1) / w.sum(axis=1)
            cost += np.log(w.sum(axis=1)) - np.log(w).sum(axis=1) + (w * (x - mean[:, None]) ** 2).sum(axis=1)
    posterior = np.exp(-0.5 * (cost - cost.min()))
    return float(np.sqrt((posterior * trials**2).sum() / posterior.sum()))
