"""What runs that have not been made would say of rates: Fisher information.

For one run with sensitivities J (to theta) and U (to its own random effects, of variances Lambda), all whitened:
    information = J' (I + U Lambda U')^-1 J

What runs bring to the goals is counted in nats, before they are made and after them alike: half the change of
ln det of the goals' precision matrix, all other parameters eliminated (Bayesian D-optimality, Chaloner and Verdinelli
1995, doi 10.1214/ss/1177009939).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.design.imagined import imagined
from shockrig.analysis.design.shock import PlannedShock
from shockrig.analysis.estimate.channel import AMBIENT_WIDTH_K
from shockrig.analysis.estimate.fit import Fit, linearise
from shockrig.analysis.estimate.model import Point
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.problem import Problem

Array = NDArray[np.float64]


def rates_at(known_c: Array, log_rates: Array, wanted_c: Array) -> Array:
    """ln rates at `wanted_c`, straight in 1/T through those known; beyond them with a film's usual slope.

    The slope, 2500 K, is that of a rate that doubles in 25 K; one that is wrong by half of it is wrong by 12 % in 10 K,
    which an expected amount of information does not feel.
    """
    order = np.argsort(known_c)
    inverse, rates = -1.0 / (known_c[order] + 273.15), log_rates[order]
    at = -1.0 / (wanted_c + 273.15)
    inside = np.interp(at, inverse, rates)
    return np.asarray(inside + 2500.0 * (at - np.clip(at, inverse[0], inverse[-1])))


NOT_KNOWN = 0.5  # standard uncertainty of ln rate at an ambient without runs


@dataclass(frozen=True)
class Information:
    """What a fit knows of its ln rates and what each of M runs would add.

    Attributes
    ----------
    ambients_c : ndarray (G,)
        Of the rates, those without runs last; one value where one rate holds at all.
    known : ndarray (P, P)
        Normal matrix of the rates and the effects' parameters so far.
    added : ndarray (M, P, P)
    floor : ndarray (G,)
        Variance of each ln rate that more runs do not lower: what all triggers have in common.
    """

    ambients_c: Array
    known: Array
    added: Array
    floor: Array

    def variances(self, normal: Array) -> Array:
        """Of the ln rates (..., G), at normal matrices (..., P, P)."""
        scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=-2, axis2=-1), 1e-12))
        inverse = np.linalg.pinv(normal / scale[..., :, None] / scale[..., None, :], rcond=1e-11, hermitian=True)
        rates = np.diagonal(inverse, axis1=-2, axis2=-1) / scale**2
        return np.asarray(rates[..., : self.floor.size] + self.floor)


def nats(before: Array, after: Array, places: Sequence[int]) -> float:
    """Information on the parameters `places` by which one normal matrix (P, P) exceeds another."""
    return 0.5 * (_log_precision(after, places) - _log_precision(before, places))


def _log_precision(normal: Array, places: Sequence[int]) -> float:
    """ln det of the normal matrix of some parameters once the others are eliminated."""
    own = np.isin(np.arange(normal.shape[0]), places)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    scaled = normal / scale[:, None] / scale
    within, across, rest = scaled[np.ix_(own, own)], scaled[np.ix_(own, ~own)], scaled[np.ix_(~own, ~own)]
    left = within - across @ np.linalg.pinv(rest, rcond=1e-11, hermitian=True) @ across.T
    left += 1e-9 * np.eye(left.shape[0])  # for parameters that nothing has told of
    return float(np.linalg.slogdet(left)[1] + 2.0 * np.log(scale[own]).sum())


def gained(problem: Problem, found: Fit, runs: NDArray[np.bool_], places: Sequence[int]) -> float:
    """What some recorded runs of a fit brought to the ln rates `places` [nats].

    From their own readings, noise and random effects, as the fit with all runs has them: it does not scatter as an
    estimate does, and a run that is noisier than the others, or that the model does not describe, brought less.

    Parameters
    ----------
    problem : Problem
    found : Fit
        Of the problem.
    runs : ndarray of bool (R,)
    places : sequence of int
    """
    arrow = found.arrow
    bins = (problem.channel.count > 0).sum(axis=1) - arrow.weight.shape[1]
    own_noise = np.sqrt((problem.whiten(found.residual) ** 2).sum(axis=1) / np.maximum(bins, 1))
    scale = 1.0 / np.maximum(own_noise[runs], 1e-3)[:, None, None]
    stated = arrow.of_runs(runs)
    own = replace(stated, jacobian=scale * stated.jacobian, run_jacobian=scale * stated.run_jacobian)
    known = np.zeros(found.theta.size)
    known[found.model.rates] = 1.0 / NOT_KNOWN**2
    before = arrow.normal - stated.told + np.diag(known)
    return nats(before, before + own.told, places)


def information(
    problem: Problem, found: Fit, noise: Noise, shocks: Sequence[PlannedShock], wanted_c: Sequence[float]
) -> Information:
    """What a fit knows, and what each of some runs would add, at its ambients and those wanted besides."""
    channel, rates = problem.channel, found.model.rates
    pooled = channel.quantity.pooled
    elsewhere = [] if pooled else [t for t in wanted_c if (np.abs(channel.ambients_c - t) > AMBIENT_WIDTH_K).all()]
    ambients = np.concatenate([channel.ambients_c, elsewhere])
    more = ambients.size - channel.rates
    place = np.concatenate([np.arange(channel.rates), np.arange(ambients.size, found.theta.size + more)])
    known = np.zeros((found.theta.size + more,) * 2)
    known[np.ix_(place, place)] = found.arrow.normal
    new = np.arange(channel.rates, ambients.size)
    known[new, new] = 1.0 / NOT_KNOWN**2
    theta = np.zeros(found.theta.size + more)
    theta[place] = found.theta
    if more:
        theta[new] = rates_at(channel.ambients_c, found.theta[rates], ambients[new])
    imaginary = imagined(found.on_its_scatters(problem), noise, shocks, ambients)
    _, arrow = linearise(imaginary, found.structure, Point(theta, imaginary.channel.at_rest()))
    added = np.stack([one.told for one in arrow.each_run()])
    spread = np.diag(found.covariance)[rates] - np.diag(found.arrow.covariance())[rates]
    floor = np.concatenate([np.maximum(spread, 0.0), np.full(more, float(np.median(np.maximum(spread, 0.0))))])
    return Information(ambients, known, added, floor)
