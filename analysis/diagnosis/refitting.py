"""A model fitted again: from where another led, with an effect added, without one; and races between those that may be.

An effect can hide in the runs' own deviations, and these in an effect, so that one start is seldom enough.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.effect import Effect, by_name
from shockrig.analysis.inference.fit import Fit, fit, go_on, objective_at
from shockrig.analysis.inference.model import PLAIN, Model, Point, Structure
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.rate_scatter import RATE_SCATTER_LIMIT
from shockrig.analysis.inference.scan import open_starts, rough_point, rough_rates, scanned_starts
from shockrig.analysis.physics.bodies import BODIES

Array = NDArray[np.float64]
Starts = Sequence[Mapping[str, float]]

QUICK_STEPS = 2  # of Gauss and Newton at a time, to rank candidates
NEAR_ROUNDS = 1  # of as many steps again
FAR_ROUNDS = 5  # likewise, where the model so far is plainly wrong
STILL_RUNNING = 0.5  # share of the leader's lead by which another may be behind it and is followed on
LEAST_LEAD = 20.0  # of deviance by which it may be behind in any case
SHARE_OF_RANGE = 0.98  # from which a share stands at the end of its range
PLAINLY_WRONG = 3.0  # objective per bin from which a fit's deviations mean nothing
NUDGED_FITS = 3  # from beside where one ended


def plainly_wrong(problem: Problem, found: Fit) -> bool:
    """Whether a fit is so far off that the runs' deviations, and the last digits of its misfit, mean nothing."""
    return found.objective > PLAINLY_WRONG * problem.channel.count.size


def refit(
    problem: Problem,
    structure: Structure,
    near: Fit,
    iterations: int = 30,
) -> Fit:
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
    best = _unstuck(problem, best, iterations)
    if plainly_wrong(problem, best) and not problem.channel.conditions.start_known.all():
        # Starts that were found under a model that is wrong need not be those of this one.
        anew = rough_point(problem, structure, near.choice)
        best = min((best, fit(problem, structure, anew.theta, anew.deviations, iterations)), key=lambda f: f.deviance)
    mirrored = mirror(problem, best)
    best = best if mirrored is None else min((best, mirrored), key=lambda f: f.deviance)
    return min((best, *_nudged(problem, best)), key=lambda f: f.deviance)


def mirror(problem: Problem, found: Fit) -> Fit | None:
    """The fit from where a share at the end of its range and the body have changed places; None where none is."""
    slowest = BODIES[problem.channel.body].held().rate[0]
    middle = found.log_rates.mean()
    for effect in found.structure.effects:
        if not effect.mirrors:
            continue
        share, tau = (found.choice[f"{effect.id}.{name}"] for name in ("fraction", "time_constant_s"))
        if share > SHARE_OF_RANGE * effect.parameter("fraction").high:
            swapped = {"fraction": 1.0 - share, "time_constant_s": float(np.exp(-middle) / slowest)}
            rates = found.log_rates - middle - np.log(tau * slowest)
            theta = found.model.start(rates, found.choice | by_name(effect, swapped))
            return fit(problem, found.structure, theta, found.deviations)
    return None


def far_apart(effect: Effect) -> bool:
    """Whether an effect's starts are so far apart that scores, and a few steps, do not tell them apart."""
    return any(p.weakest is not None for p in effect.parameters)


@dataclass(frozen=True)
class _Runner:
    """A candidate's fit so far, and by how much its deviance fell in its last round."""

    fit: Fit
    fall: float

    def after(self, problem: Problem, steps: int) -> _Runner:
        """So many steps on."""
        later = go_on(problem, self.fit, steps)
        return _Runner(later, self.fit.deviance - later.deviance)


def _begun(problem: Problem, near: Fit, effect: Effect, starts: Starts) -> list[_Runner]:
    """A few steps of `near` with one more effect from each of its starts, the best first.

    That one goes on in any case, and from starts far apart all do: the best so far tells little there.
    """
    channel, structure, far = problem.channel, near.structure.adding(effect), plainly_wrong(problem, near)
    model, log_rates = Model(channel, structure), near.log_rates + rate_shift(effect, channel)
    # From the deviations of `near` where these mean anything.
    deviations = begun_anew(problem, near) if far else near.deviations
    fits = []
    for start in starts:
        choice = near.choice | by_name(effect, start)
        begins = [(log_rates, deviations)]
        # Rates that runs have of their own may hide it as well.
        if effect.own_rates and (far or near.rate_scatter > RATE_SCATTER_LIMIT):
            anew = rough_point(problem, structure, choice)
            begins.append((anew.theta[: channel.rates], anew.deviations))
            placed = begun_anew(problem, near)
            begins.append((rough_rates(problem, structure, placed, choice), placed))
        tried = [fit(problem, structure, model.start(rates, choice), own, QUICK_STEPS) for rates, own in begins]
        if far and min(f.deviance for f in tried) > near.deviance:
            # With more to choose from no fit leaves more: its way back from no deviations is too long.
            tried.append(fit(problem, structure, model.start(log_rates, choice), near.deviations, QUICK_STEPS))
        fits += tried
    fits.sort(key=lambda f: f.deviance)
    return [_Runner(f, np.inf if i == 0 or far_apart(effect) else 0.0) for i, f in enumerate(fits)]


def rate_shift(effect: Effect, channel: Channel) -> float:
    return float(np.log(effect.rate_factor(channel))) if effect.rate_factor else 0.0


def race(problem: Problem, current: Fit, starts: Mapping[str, Starts]) -> dict[str, Fit]:
    """Best fit of the current model with each of some effects added, far enough to rank them.

    All begin from each of their starts and go a few steps at a time. One that is behind the leader, and does not fall
    fast enough to reach it in the steps that remain, is not followed on. Where the current model is nearly right that
    soon tells; where it is plainly wrong the way is long.
    """
    runners = {id_: _begun(problem, current, CATALOGUE[id_], tried) for id_, tried in starts.items()}
    far = plainly_wrong(problem, current)
    for left in range(FAR_ROUNDS if far else NEAR_ROUNDS, 0, -1):
        best = min((own[0].fit.deviance for own in runners.values()), default=0.0)
        for own in runners.values():
            leader = best if far else own[0].fit.deviance
            within = leader + max(STILL_RUNNING * (current.deviance - leader), LEAST_LEAD)
            for i, runner in enumerate(own):
                if runner.fit.deviance <= within or runner.fit.deviance - left * runner.fall <= leader:
                    own[i] = runner.after(problem, QUICK_STEPS)
            own.sort(key=lambda r: r.fit.deviance)
    for id_, own in runners.items():
        if not far and far_apart(CATALOGUE[id_]):
            # From starts this far apart a few steps rank by luck: the two best are followed on.
            own[:2] = [runner.after(problem, 2 * QUICK_STEPS) for runner in own[:2]]
            own.sort(key=lambda r: r.fit.deviance)
    return {id_: own[0].fit for id_, own in runners.items()}


def finish(problem: Problem, found: Fit) -> Fit:
    """The fit carried to its end, where it was left early; from several values where the objective has steps."""
    stepped = has_steps(problem, found.structure)
    if found.converged and not stepped:
        return found
    # From the scatter of rates that is usual: one that has grown may hide what the model now explains.
    again = fit(problem, found.structure, found.theta, found.deviations)
    best = min((found, again, *_nudged(problem, found)), key=lambda f: f.deviance)
    return _unstuck(problem, best) if stepped else best


def has_steps(problem: Problem, structure: Structure) -> bool:
    """Whether a model's objective has steps or ridges, before which a fit may end."""
    return any(effect.nudges and effect.nudges(problem.channel) for effect in structure.effects)


def _nudged(problem: Problem, found: Fit) -> list[Fit]:
    """Fits from beside where one ended, where the objective has steps or ridges: from those that begin best."""
    deviations, begun = begun_anew(problem, found), list[tuple[float, Array]]()
    for effect in found.structure.effects:
        for offsets in effect.nudges(problem.channel) if effect.nudges else ():
            theta = found.theta.copy()
            for name, offset in offsets.items():
                theta[found.model.place(f"{effect.id}.{name}")] += offset
            theta = np.clip(theta, *found.model.bounds())
            begun.append((objective_at(problem, found.model, Point(theta, deviations)), theta))
    begun.sort(key=lambda one: one[0])
    return [fit(problem, found.structure, theta, deviations) for _, theta in begun[:NUDGED_FITS]]


def drop(problem: Problem, current: Fit, effect: str) -> Fit:
    """Best fit of the current model without one of its effects."""
    return refit(problem, current.structure.dropping(effect), current)


def plain_fit(problem: Problem, structure: Structure = PLAIN) -> Fit:
    """Fit of the plain model (with the effects of the readings that `structure` holds fixed)."""
    start = rough_point(problem, structure)
    return _unstuck(problem, fit(problem, structure, start.theta, start.deviations, iterations=40))


def _unstuck(problem: Problem, found: Fit, iterations: int = 40) -> Fit:
    """The fit with the runs moved that are stuck on one side of a step: one of them may pass for an effect."""
    if not found.converged or plainly_wrong(problem, found):
        return found
    moved = scanned_starts(problem, found)
    if moved is None:
        return found
    return min((found, fit(problem, found.structure, found.theta, moved, iterations)), key=lambda f: f.deviance)


def begun_anew(problem: Problem, near: Fit) -> Array:
    """Deviations to begin from: none, but for the starts that nobody recorded, which stay where they were found."""
    return np.where(open_starts(problem), near.deviations, 0.0)
