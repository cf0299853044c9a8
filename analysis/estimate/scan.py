"""Rough scans that a fit begins from: the rates of the ambients, and starts that nobody recorded."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.fit import Fit, fit, run_misfit
from shockrig.analysis.estimate.model import LOG_RATE_BOUNDS, PLAIN, Model, Point, Structure
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.physics.chain import JUMP_K

Array = NDArray[np.float64]

RATE_BOUNDS_PER_S = (2e-4, 30.0)  # t63 of a bead from 6 ms to 14 min, of a film from 11 ms to 27 min
RATES_TRIED = 60
USUAL_SCATTER_S = 0.5  # of a start that was estimated
LATE_S = np.arange(-0.8, 0.81, 0.04)  # starts that are tried beside it
STUCK_MEAN_SQUARE = 1.7  # mean square of a run's whitened residuals from which its start is looked for anew
START_GRID = np.linspace(-3.0, 3.0, 25)  # in standard deviations of a start


def rough_rates(
    problem: Problem,
    structure: Structure = PLAIN,
    deviations: Array | None = None,
    choice: Mapping[str, float] | None = None,
) -> Array:
    """Rough ln rates (G,) from a scan, all ambients and all trial rates at once; `choice` as in `Model.start`."""
    channel = problem.channel
    low, high = np.log(RATE_BOUNDS_PER_S)
    trials = np.linspace(max(low, LOG_RATE_BOUNDS[0]), high, RATES_TRIED)
    model = Model(channel, structure)
    theta = np.stack([model.start(np.full(channel.rates, trial), choice) for trial in trials])
    f = model.predict(Point(theta, channel.at_rest() if deviations is None else deviations))
    squares = (channel.count * (channel.value - f) ** 2).sum(axis=-1)
    by_group = np.stack([squares[:, channel.ambient == g].sum(axis=1) for g in range(channel.rates)], axis=1)
    return np.asarray(trials[np.argmin(by_group, axis=0)])


def open_starts(problem: Problem) -> NDArray[np.bool_]:
    """True for the random effects (R, U) that are start times which nobody recorded."""
    mask = ~problem.stated
    mask[:, RunEffect.START + 1 :] = False
    return np.asarray(mask)


def late_starts_s(problem: Problem) -> Array:
    """How much later than estimated a start is tried [s]."""
    conditions = problem.channel.conditions
    return LATE_S * float(conditions.start_scatter_s[~conditions.start_known].max()) / USUAL_SCATTER_S


def rough_point(problem: Problem, structure: Structure, choice: Mapping[str, float] | None = None) -> Point:
    """Rough rates, and each unrecorded start where the model at them leaves least; `choice` as in `Model.start`."""
    channel, model = problem.channel, Model(problem.channel, structure)
    deviations = channel.at_rest()
    theta = model.start(rough_rates(problem, structure, choice=choice), choice)
    if channel.conditions.start_known.all():
        return Point(theta, deviations)
    late_s = late_starts_s(problem)
    for _ in range(2):
        tried = np.tile(deviations, (late_s.size, 1, 1))
        tried[:, ~channel.conditions.start_known, RunEffect.START] = late_s[:, None]
        prediction = model.predict(Point(np.tile(theta, (late_s.size, 1)), tried))
        squares = (channel.count * (channel.value - prediction) ** 2).sum(axis=-1)
        best = late_s[np.argmin(squares, axis=0)]
        deviations[:, RunEffect.START] = np.where(channel.conditions.start_known, 0.0, best)
        theta[model.rates] = fit(problem, structure, theta, deviations, iterations=10).log_rates
    return Point(theta, deviations)


def scanned_starts(problem: Problem, found: Fit, stuck: float = STUCK_MEAN_SQUARE) -> Array | None:
    """Deviations with the start of each run whose misfit is beyond `stuck` where it fits best, looked for on a grid;
    None where all fit.

    A film's response begins like sqrt(t): no gradient leads a start across a sample that lies at the very transfer.
    """
    channel = problem.channel
    misfits = run_misfit(problem, found) > stuck
    if channel.jumps_with_air:
        misfits &= np.abs(channel.conditions.thermal_step_k) <= JUMP_K  # elsewhere samples at the jump are muted
    if not misfits.any():
        return None
    index = np.flatnonzero(misfits)
    part, late = problem.select(index), found.deviations[index]
    tried = np.tile(late, (START_GRID.size, 1, 1))
    tried[:, :, RunEffect.START] = START_GRID[:, None] * part.scatter[:, RunEffect.START]
    prediction = found.model.on(part.channel).predict(Point(found.theta, tried))
    left = np.matmul(part.whitener, (part.channel.value - prediction)[..., None])[..., 0]
    cost = (left**2).sum(axis=-1) + START_GRID[:, None] ** 2
    moved = found.deviations.copy()
    moved[index, RunEffect.START] = tried[np.argmin(cost, axis=0), np.arange(index.size), RunEffect.START]
    return np.asarray(moved)
