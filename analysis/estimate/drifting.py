"""Whether airs that nobody recorded moved on behind their steps."""

from __future__ import annotations

from shockrig.analysis.estimate.fit import Fit, fit, run_misfit
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.quantity import RunEffect

NOISE_ALONE = 1.5  # mean square of whitened residuals up to which nothing else is left: noise is known to a tenth


def where_airs_drift(problem: Problem, steady: Fit) -> tuple[Problem, Fit]:
    """The problem with airs that drift, and the same model fitted to it, where that model then leaves noise alone and
    in steady air does not; else both as they are.

    What a model is wrong by looks like a drift as well, and is as large as that likes. Beside a drift by which nothing
    is left it need not be asked for. A single run does not tell a drift from a slow part of the sensor.
    """
    channel = problem.channel
    if channel.runs == 1 or channel.conditions.airs_known.all() or _leaves(problem, steady) <= NOISE_ALONE:
        return problem, steady
    moving = problem.with_drifting_airs()
    found = fit(moving, steady.structure, steady.theta, steady.deviations)
    if _leaves(moving, found) > NOISE_ALONE:
        return problem, steady
    return moving.with_scatter_of(RunEffect.DRIFT, found.drift_scatter), found


def _leaves(problem: Problem, found: Fit) -> float:
    return float(run_misfit(problem, found).mean())
