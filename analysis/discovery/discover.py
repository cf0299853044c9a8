"""The search for a description of what no catalogued effects explain: at most two forms of the grammar on top of them.

A form is kept where it drops the deviance by more than the best of all forms does by chance, none of its numbers stands
at the end of its range, and conditions that were held out whole are predicted better with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from shockrig.analysis.discovery.conditions import Judged, judged_by_condition
from shockrig.analysis.discovery.grammar import SCALING
from shockrig.analysis.discovery.race import NUMBER, Candidate, candidates, price, simpler
from shockrig.analysis.effects.behaviours import form_of, scaling
from shockrig.analysis.effects.described import is_described
from shockrig.analysis.inference.effect import Effect
from shockrig.analysis.inference.fit import Fit, fit
from shockrig.analysis.inference.model import Model, Structure
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.work import Work

MOST = 2  # described effects on top of catalogued ones
TIE = 6.0  # deviance within which descriptions do equally well: odds of twenty
MOST_ALTERNATIVES = 5
TRIED_INSTEAD = 8  # descriptions that are put in another's place
CERTAIN = 10.0  # multiple of what is left that a description must bring, where something is left
CERTAIN_LEAST = 60.0
MOST_CERTAIN = 0.97  # a description is no name: there may be forms that nobody wrote down
UNTRIED = 0.5  # the most that is said of a description where not all others were tried, or where something is left
HARDLY = 0.5  # share of what was there, above which what a first form leaves is not for a second to end
AT_END = 1e-3  # of a range
SWITCH = 50.0  # by which a law may scale a strength from run to run: more picks runs out, and is no law
ANYTHING = 1.0  # uncertainty of a logarithm that says nothing
CANCELS = 0.5  # of a size, from which on two forms only balance one another


class Left(Protocol):
    """What the model-free tests say of a fit."""

    @property
    def passed(self) -> bool: ...
    @property
    def excess(self) -> float: ...
    @property
    def inflation(self) -> float: ...


@dataclass(frozen=True)
class Described:
    """One effect that nobody listed.

    Attributes
    ----------
    effect : Effect
    values : {parameter: (value, standard uncertainty)}
    necessity : float
        Rise in deviance without it.
    probability : float
        Beside its alternatives.
    instead : tuple of Candidate
        Other forms that do as well in its place, the likeliest first.
    judged : Judged
        On conditions held out whole.
    """

    effect: Effect
    values: dict[str, tuple[float, float]]
    necessity: float
    probability: float
    instead: tuple[Candidate, ...]
    judged: Judged


@dataclass(frozen=True)
class Discovery:
    """What was described: the fit that carries it, the one without, the effects, most certain first."""

    fit: Fit
    without: Fit
    effects: tuple[Described, ...]
    passed: bool
    null: float


def discover(
    problem: Problem,
    near: Fit,
    judge: Callable[[Fit], Left],
    work: Work | None = None,
    known: Iterable[Candidate] = (),
) -> Discovery | None:
    """Describe what the fit `near` leaves; None where nothing that can be described is left.

    Parameters
    ----------
    problem : Problem
    near : Fit
        The model with its named causes.
    judge : function
        The model-free tests of a fit.
    work : Work, optional
        How many fits it may make. What it has reached by then is held against its rivals and against conditions that
        it was not fitted to all the same, some hundred fits more at most.
    known : iterable of Candidate, optional
        Forms that did well in the place of a name which `near` has no more: where a fit is far off, none may score.
    """
    work = Work() if work is None else work
    stages: list[tuple[Candidate, list[Candidate]]] = []
    current, left, null = near, judge(near), np.inf
    there = left.excess
    while not left.passed and len(stages) < MOST and not (stages and (work.ended or left.excess > HARDLY * there)):
        found, chance = candidates(problem, current, work, known)
        found = [one for one in found if says_something(one)]
        null = min(null, chance)
        if not found or _worth(current, found[0], chance) <= 0:
            break
        best = _plainest(found, judge(found[0].fit))
        stages.append((best, found))
        current, left = best.fit, judge(best.fit)
    if not stages:
        return None
    if len(stages) > 1:  # beside one another forms may need less than each alone
        stages, current = _less(problem, stages, current, work)
        left = judge(current)
    described = []
    for place, (best, found) in enumerate(stages):
        one = _standing(problem, near, current, best, found, left, alone=len(stages) == 1 and place == 0)
        if one is not None:
            described.append(one)
    kept = {one.effect.id for one in described}
    if not kept:
        return None
    if len(kept) < len(stages):
        lost = [best.effect.id for best, _ in stages if best.effect.id not in kept]
        structure = current.structure.keeping(set(current.structure.ids) - set(lost))
        current = _refitted(problem, structure, current)
        left = judge(current)
        described = [replace(one, values=current.values()[one.effect.id]) for one in described]
    if not left.passed:  # what it leaves says that this form is not the whole of it
        described = [replace(one, probability=min(one.probability, UNTRIED)) for one in described]
    if work.ended:  # forms that were not reached may do as well
        described = [replace(one, probability=min(one.probability, UNTRIED)) for one in described]
    described.sort(key=lambda one: -one.necessity)
    return Discovery(current, near, tuple(described), left.passed, null)


def _less(
    problem: Problem, stages: list[tuple[Candidate, list[Candidate]]], current: Fit, work: Work
) -> tuple[list[tuple[Candidate, list[Candidate]]], Fit]:
    """The forms without factors that, beside one another, are not worth their numbers."""
    out = []
    for best, found in stages:
        now = Candidate(best.effect, current)
        better = min(simpler(problem, now, work), key=lambda c: c.cost, default=now)
        if better.cost < now.cost:
            best, current = better, better.fit
        out.append((best, found))
    return out, current


def _worth(near: Fit, one: Candidate, null: float) -> float:
    """By how much a form drops the deviance beyond what the best of all does by chance, and its further numbers."""
    return near.deviance - one.fit.deviance - null - NUMBER * (len(one.effect.parameters) - 1)


def says_something(one: Candidate) -> bool:
    """Whether a form depends on things by a law, and no number of it stands at an end or may be anything."""
    values = one.fit.values()[one.effect.id]
    channel = one.fit.model.channel
    scale = np.ones(channel.runs)
    for factor, how in one.form.depends_on:
        if (factor, how) in SCALING:
            number = np.array([[values[factor][0]]])
            scale = scale * scaling(factor, how, channel.conditions, channel.jumps_with_air, number)[0]
    if scale.max() > SWITCH * scale.min():
        return False
    for parameter in one.effect.parameters:
        value, spread = values[parameter.name]
        low, high, at = (parameter.encoded(x) for x in (parameter.low, parameter.high, value))
        if not low + AT_END * (high - low) < at < high - AT_END * (high - low):
            return False
        if parameter.log and spread > ANYTHING * abs(value):
            return False
        if parameter.name == "size" and not parameter.log and spread > CANCELS * abs(value):
            return False
    return True


def _plainest(found: list[Candidate], left: Left) -> Candidate:
    """Of the forms that do equally well, one that a flight can use, before those that it cannot."""
    alike = [one for one in found if one.cost - found[0].cost < _alike(left)]
    return next((one for one in alike if one.effect.in_flight is not None and not one.effect.in_flight.left), found[0])


def _alike(left: Left) -> float:
    """Difference in deviance that does not tell descriptions apart: more than a tie where something is left."""
    return TIE if left.passed else max(TIE * left.inflation, left.excess)


def _standing(
    problem: Problem, near: Fit, final: Fit, best: Candidate, found: list[Candidate], left: Left, alone: bool
) -> Described | None:
    """How one described effect stands beside the others; None where it does not hold."""
    id_ = best.effect.id
    if not says_something(Candidate(best.effect, final)):  # beside another it may have gone to an end
        return None
    without = near if alone else _refitted(problem, final.structure.dropping(id_), final)
    necessity = without.deviance - final.deviance
    if not left.passed and necessity < CERTAIN * left.excess + CERTAIN_LEAST:
        return None
    # One value of a factor says nothing of the other, whichever of the forms depends on it.
    factors = {of for e in final.structure.effects if is_described(e.id) for of in form_of(e.id).factors}
    judged = judged_by_condition(problem, without, final, factors)
    if not judged.holds:
        return None
    cost = final.deviance + price(best.form, len(best.effect.parameters))
    tied, rises = [], []
    for other in found[:TRIED_INSTEAD]:
        if other.effect.id == id_ or _only_more(other, best) or other.effect.id in final.structure.ids:
            continue
        placed = other if alone else _placed(problem, final, id_, other)
        rise = placed.cost - cost
        rises.append(max(rise, 0.0))
        if rise < _alike(left) and says_something(placed):
            tied.append((rise, placed))
    tied.sort(key=lambda one: one[0])
    tied = [one for i, one in enumerate(tied) if not any(_only_more(one[1], before) for _, before in tied[:i])]
    weights = np.exp(-0.5 * np.clip(np.array([0.0, *rises]) * TIE / _alike(left), 0.0, 200.0))
    return Described(
        effect=best.effect,
        values=final.values()[id_],
        necessity=necessity,
        probability=float(np.clip(weights[0] / weights.sum(), 0.01, MOST_CERTAIN)),
        instead=tuple(one for _, one in tied[:MOST_ALTERNATIVES]),
        judged=judged,
    )


def _only_more(other: Candidate, best: Candidate) -> bool:
    """Whether a form is the other with factors more, which are not worth their numbers."""
    same = other.form.behaves_as == best.form.behaves_as
    same &= other.form.driver == best.form.driver or best.form.behaves_as == "rate_change"
    return same and set(other.form.depends_on) > set(best.form.depends_on)


def _placed(problem: Problem, final: Fit, id_: str, other: Candidate) -> Candidate:
    """Another form in the place of one, beside all the others."""
    structure = final.structure.dropping(id_).adding(other.effect)
    values = final.choice | {k: v for k, v in other.fit.choice.items() if k.startswith(other.effect.id)}
    theta = Model(problem.channel, structure).start(other.fit.log_rates, values)
    return Candidate(other.effect, fit(problem, structure, theta, other.fit.deviations))


def _refitted(problem: Problem, structure: Structure, near: Fit) -> Fit:
    """A structure fitted from the parameters of a fit, from its deviations and from none."""
    theta = Model(problem.channel, structure).start(near.log_rates, near.choice)
    starts = (near.deviations, problem.channel.at_rest())
    return min((fit(problem, structure, theta, start) for start in starts), key=lambda f: f.deviance)
