"""How much runs of a type's campaigns differ from one another in rate: what the few runs of a new sensor say badly.

sigma^2 of a bench ~ nu s^2 / chi^2_nu. Of ten runs sigma is known to a quarter, and two standard uncertainties of a
number that rests on it cover less than 95 %.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import digamma, polygamma

from shockrig.analysis.characterize.characterize import with_run_scatter
from shockrig.analysis.characterize.result import Characterization, Part
from shockrig.analysis.estimate.problem import (
    RATE_SCATTER_LIMIT,
    posterior_scatter,
    prior_cost,
    restricted,
    scatters_tried,
)
from shockrig.files.fleet_file import RunScatter

Array = NDArray[np.float64]

TRIALS = scatters_tried()
# Of ln sigma from bench to bench, that are tried; at the last one nothing is shared.
BENCH_SPREADS = np.linspace(0.02, 0.5, 25)
MOST_DEGREES = 0.5 / BENCH_SPREADS[0] ** 2


def scatter_cost(result: Characterization) -> tuple[float, ...]:
    """-2 log restricted likelihood of the trial scatters, from the runs that the model explains; none where nobody
    recorded the airflow, by which runs then differ too."""
    parts = _ventilated(result)
    return tuple(restricted(TRIALS, [part.fit.own_rates() for part in parts]).tolist()) if parts else ()


def _ventilated(result: Characterization) -> list[Part]:
    return [part for part in result.explained_parts if part.problem.rate_scatter_limit <= RATE_SCATTER_LIMIT]


def scatter_of_benches(costs: Sequence[Array]) -> RunScatter | None:
    """The scatter on a bench like some (each with its -2 log likelihood of the trials), and how sure that is."""
    if not costs:
        return None
    likelihood = np.exp(-0.5 * np.array([one - one.min() for one in costs]))
    logs = np.empty((BENCH_SPREADS.size, TRIALS.size))
    foretold = np.empty((BENCH_SPREADS.size, TRIALS.size, TRIALS.size))
    for k, degrees in enumerate(0.5 / BENCH_SPREADS**2):
        foretold[k] = np.array([_of_one(TRIALS, s, degrees) for s in TRIALS])
        logs[k] = np.log(np.maximum(likelihood @ foretold[k].T, 1e-300)).sum(axis=0) - 0.5 * prior_cost(TRIALS)
    weight = np.exp(logs - logs.max())
    of_next = np.einsum("ks,kst->t", weight, foretold) / weight.sum()
    mean = float(of_next @ np.log(TRIALS))
    variance = float(of_next @ (np.log(TRIALS) - mean) ** 2)
    degrees = _degrees(variance)
    return RunScatter(math.exp(mean + 0.5 * (float(digamma(0.5 * degrees)) - math.log(0.5 * degrees))), degrees)


def _of_one(trials: Array, s: float, degrees: float) -> Array:
    """Probability of trial scatters, evenly spaced in their logarithm."""
    logs = -0.5 * _cost(trials, s, degrees)
    weight = np.exp(logs - logs.max())
    return np.asarray(weight / weight.sum())


def _cost(trials: Array, s: float, degrees: float) -> Array:
    """-2 log of the density of ln sigma."""
    return np.asarray(degrees * (2.0 * np.log(trials / s) + (s / trials) ** 2))


def _degrees(variance: float) -> float:
    """nu of a scaled inverse chi-squared whose ln sigma has such a variance: trigamma(nu / 2) / 4."""

    def off(degrees: float) -> float:
        return 0.25 * float(polygamma(1, 0.5 * degrees)) - variance

    low = 1.0
    return low if off(low) < 0.0 else MOST_DEGREES if off(MOST_DEGREES) > 0.0 else float(brentq(off, low, MOST_DEGREES))


def with_scatter_of_type(result: Characterization, known: RunScatter | None) -> Characterization:
    """The characterization with the scatter that its runs show and a fleet's benches had."""
    parts = _ventilated(result)
    if known is None or not parts:
        return result
    rates = [part.fit.own_rates() for part in parts]
    of_type = partial(_cost, s=known.standard_deviation, degrees=known.degrees)
    return with_run_scatter(result, posterior_scatter(rates, prior=of_type))
