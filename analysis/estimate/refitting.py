"""A model fitted again from where another led: with an effect more, or without one.

An effect can hide in the runs' own deviations, and these in an effect, so that one start is seldom enough.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import TINY_STRENGTH, Effect
from shockrig.analysis.estimate.fit import MOST_STEPS, Fit, fit, objective_at
from shockrig.analysis.estimate.fit_starts import open_starts, plainly_wrong, rough_point, unstuck
from shockrig.analysis.estimate.model import PLAIN, Model, Point, Structure
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.quantity import RunEffect

Array = NDArray[np.float64]

ALIKE = 1e-7  # scatter of ln rate that is none
SAME_RESPONSE = 1e-9  # of the readings' span, within which two parameter sets are one response
LEAST_SQUARE = 1e-30  # mean square that may be divided by


def refit(problem: Problem, structure: Structure, near: Fit, iterations: int = MOST_STEPS) -> Fit:
    """Fit `structure` from the parameters of `near`; from two starts of the deviations.

    An effect can hide in the runs' own deviations, and the deviations in an effect: hence both starts. Where the
    objective has steps the fit is carried over them: stuck before one, it may need an effect that nobody else does.
    """
    theta = Model(problem.channel, structure).start(near.log_rates, near.choice)
    best = fit(problem, structure, theta, begun_anew(problem, near), iterations)
    # Without an effect that mattered the model is plainly wrong from any start.
    lost = len(structure.effects) < len(near.structure.effects) and plainly_wrong(problem, best)
    if not lost and not plainly_wrong(problem, near):
        best = min((best, fit(problem, structure, theta, near.deviations, iterations)), key=lambda f: f.deviance)
    best = unstuck(problem, best, iterations)
    if plainly_wrong(problem, best) and not problem.channel.conditions.start_known.all():
        # Starts that were found under a model that is wrong need not be those of this one.
        anew = rough_point(problem, structure, near.choice)
        best = min((best, fit(problem, structure, anew.theta, anew.deviations, iterations)), key=lambda f: f.deviance)
    return min((best, *_nudged(problem, best)), key=lambda f: f.deviance)


def rate_shift(effect: Effect, channel: Channel) -> float:
    return float(np.log(effect.start.rate_factor(channel))) if effect.start.rate_factor else 0.0


def _nudged(problem: Problem, found: Fit) -> list[Fit]:
    """A fit from beside where one ended, where the objective has steps or ridges: from the place that begins best."""
    deviations, begun = begun_anew(problem, found), list[Array]()
    for effect in found.structure.effects:
        for offsets in effect.start.nudges(problem.channel) if effect.start.nudges else ():
            theta = found.theta.copy()
            for name, offset in offsets.items():
                theta[found.model.place(f"{effect.id}.{name}")] += offset
            begun.append(np.clip(theta, *found.model.bounds()))
    begun.sort(key=lambda theta: objective_at(problem, found.model, Point(theta, deviations)))
    return [fit(problem, found.structure, theta, deviations) for theta in begun[:1]]


def plain_fit(problem: Problem, structure: Structure = PLAIN) -> Fit:
    """Fit of the plain model (with the effects of the readings that `structure` holds fixed)."""
    start = rough_point(problem, structure)
    return unstuck(problem, fit(problem, structure, start.theta, start.deviations))


def begun_anew(problem: Problem, near: Fit) -> Array:
    """Deviations to begin from: none, but for the starts that nobody recorded, which stay where they were found."""
    return np.where(open_starts(problem), near.deviations, 0.0)


def as_judged(problem: Problem, found: Fit) -> Fit | None:
    """A model's parameters as they are judged where it predicts: fitted at one rate for all runs, each reading counting
    alike, and each run. None for a fit that led to no number.

    A fit knows of nothing that a model is wrong by. Where that is more than the noise, runs take rates of their own,
    however little these may scatter, which no other run has; and readings that noise says less of count for more.
    """
    channel, structure = problem.channel, found.structure
    readings = channel.count.sum(axis=1, keepdims=True)
    alike = problem.with_rate_scatter(ALIKE).with_scatter_of(RunEffect.STRENGTH, TINY_STRENGTH)
    deviations = found.deviations.copy()
    deviations[:, [RunEffect.RATE, RunEffect.STRENGTH]] = 0.0

    def beside(left_by: Fit) -> Problem | None:
        """The problem whose noise is what a fit leaves; None where that is no number."""
        square = float(squares_of_bins(channel, left_by.residual).mean())
        if not np.isfinite(square):
            return None
        share = channel.count * readings.mean() / np.maximum(readings, 1)
        return alike.with_weights(np.sqrt(share / max(square, LEAST_SQUARE)))

    def best_from(part: Problem, *begins: Point) -> Fit:
        ends = [fit(part, structure, at.theta, at.deviations, 40, adapt_scatter=False) for at in begins]
        return min(ends, key=lambda f: f.objective)

    if (part := beside(found)) is None:
        return None
    first = best_from(part, Point(found.theta, deviations), rough_point(part, structure, found.choice))
    # Priors of starts and airs bind by what is left at the end, and not by what the search's fit left.
    return None if (part := beside(first)) is None else best_from(part, first.point)


def carried(problem: Problem, found: Fit, judged: Fit) -> Fit:
    """A model with parameters that were fitted as they are judged, as a fit to the problem: its runs' deviations, and
    its uncertainties, are those under the scatters that the search found."""
    own = found.on_its_scatters(problem)
    held = fit(own, found.structure, judged.theta, found.deviations, adapt_scatter=False, hold_theta=True)
    return fit(own, found.structure, judged.theta, held.deviations, 0, adapt_scatter=False)


def squares_of_bins(channel: Channel, left: Array) -> Array:
    """Mean square [unit^2] of what is left of each run's bins (R, n), each by its readings (R,)."""
    return np.asarray((channel.count * left**2).sum(axis=1) / np.maximum(channel.count.sum(axis=1), 1))


def labelled(problem: Problem, found: Fit) -> Fit:
    """The fit with the slower of two time constants as the lag's, where either could be called the body's.

    Where the body is one exponential, (rate, fraction, time_constant) and (1 / time_constant, 1 - fraction, 1 / rate)
    are one response: without a rule two sensors that are alike would be given different numbers.
    """
    model = found.model
    for effect in found.structure.effects:
        names = [f"{effect.id}.{name}" for name in ("fraction", "time_constant_s")]
        if not effect.start.mirrors or model.channel.rates != 1 or not set(names) <= set(found.structure.names):
            continue
        share, lag = (model.place(name) for name in names)
        if found.theta[lag] >= -found.theta[0]:
            continue
        theta = found.theta.copy()
        theta[[0, share, lag]] = -found.theta[lag], 1.0 - found.theta[share], -found.theta[0]
        low, high = model.bounds()
        if (theta < low).any() or (theta > high).any():
            continue
        rest = model.channel.at_rest()
        before, after = (model.predict(Point(one, rest)) for one in (found.theta, theta))
        if np.allclose(after, before, rtol=0.0, atol=SAME_RESPONSE * np.ptp(before)):
            return fit(problem, found.structure, theta, found.deviations)
    return found
