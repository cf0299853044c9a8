"""The effects of a model as a diagnosis states them: causes of the catalogue, forms of the grammar, and what was tried
beside them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from shockrig.analysis.diagnose.candidates import at_bound
from shockrig.analysis.diagnose.diagnosed import Cause
from shockrig.analysis.diagnose.grammar import scaling_factors, seen_over
from shockrig.analysis.diagnose.pool import Rated, Search
from shockrig.analysis.diagnose.prepare import Prepared
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import described, discovered_of, is_described
from shockrig.analysis.effects.forms import form_of
from shockrig.analysis.estimate.effect import Effect
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.model import Model, Point
from shockrig.analysis.estimate.problem import Problem
from shockrig.files.causes import Uncertain
from shockrig.files.diagnosis_data import Discovered, Likeness

LEAST_TRIED = 0.01  # weight of a model that is not stated, from which on its effect is said to have been tried
DEPENDENCE_SIGMAS = 3.0  # beyond which a dependence is one
# A dependence of this size is worth knowing; what is known better than this is excluded.
WORTH_KNOWING = {"power": 0.15, "exponential": 0.01, "ratio": 0.1, "trend": 0.01}
WORTH_KNOWING_HUMIDITY = 0.4
FACTOR_STEP = 1e-3  # of a factor's number, in finite differences
MOST_ALTERNATIVES = 5


def causes_in(ready: Prepared, found: Search, final: Fit) -> tuple[Cause, ...]:
    """The effects of the catalogue in the best model: what the readings showed, and what the search found."""
    shown = {finding.effect: finding for finding in ready.findings}
    causes, values = [], final.values()
    tied = [one.ids for one in found.tied()]
    for effect, own in values.items():
        if is_described(effect):
            continue
        if effect in shown:
            finding = shown[effect]
            causes.append(Cause(effect, _uncertain(finding.parameters), 1.0, evidence=finding.evidence))
            continue
        instead = dict.fromkeys(
            new
            for one, _ in found.instead(effect)
            if one.ids in tied
            for new in sorted(one.ids - found.best.ids)
            if not is_described(new)
        )
        without = max((one.value for one in found.pool if effect not in one.ids), default=found.plain.value)
        ends = at_bound(CATALOGUE[effect], own)
        probability = round(found.probability(effect), 4)
        gained = found.best.value - without
        causes.append(Cause(effect, _uncertain(own), probability, tuple(instead), ends, nats=gained))
    return tuple(causes)


def _uncertain(values: Mapping[str, tuple[float, float]]) -> dict[str, Uncertain]:
    return {name: Uncertain(value, spread) for name, (value, spread) in values.items()}


def tried_beside(found: Search) -> dict[str, str]:
    """Effects that come next to the best model and are not in it, and why not."""
    said: dict[str, str] = {}
    for one, weight in zip(found.pool, found.weights, strict=True):
        more = {id_ for id_ in one.ids - found.best.ids if not is_described(id_)}
        if one.ids > found.best.ids and len(one.ids) == len(found.best.ids) + 1 and weight > LEAST_TRIED:
            said |= {e: f"unseen runs bear it out with a probability of {found.probability(e):.2f}" for e in more}
    return said


def forms_in(problem: Problem, found: Search, final: Fit) -> tuple[Discovered, ...]:
    """The forms of the best model as a diagnosis's file states them, most certain first."""
    own = found.plain.fit.structure.ids  # what the readings showed is stated with them
    ids = [effect for effect in final.structure.effects if is_described(effect.id) and effect.id not in own]
    told = [_stated(problem, found, final, effect) for effect in ids]
    return tuple(sorted(told, key=lambda one: -(one.probability or 0.0)))


def _stated(problem: Problem, found: Search, final: Fit, effect: Effect) -> Discovered:
    instead = found.instead(effect.id)
    tied = {id(one) for one in found.tied()}
    alternatives = []
    for one, _ in instead:
        new = [e for e in one.fit.structure.effects if e.id not in found.best.ids]
        if id(one) in tied and len(new) == 1 and is_described(new[0].id):
            alternatives.append(replace(discovered_of(new[0], one.fit.values_of(new[0])), seen_over={}))
    return replace(
        discovered_of(effect, final.values_of(effect)),
        does_not_depend_on=_independent(problem, final, effect),
        alternatives=tuple(alternatives[:MOST_ALTERNATIVES]),
        nearest_catalogued=_nearest(problem, found, effect, instead),
        probability=round(found.probability(effect.id), 3),
        seen_over=seen_over(problem.channel),
    )


def _independent(problem: Problem, final: Fit, effect: Effect) -> tuple[str, ...]:
    """Factors that were varied, on which the effect depends so little that it would have been seen."""
    form, channel = form_of(effect.id), problem.channel
    factors = scaling_factors(form, channel)
    if not factors:
        return ()
    base = final.model.predict(final.point)[0]
    columns = []
    for factor, how in factors:
        more = described(form.with_factor(factor, how).key, channel.jumps_with_air)
        neutral = 1.0 if how == "ratio" else 0.0
        own = {f"{more.id}.{p.name}": final.choice[f"{effect.id}.{p.name}"] for p in effect.parameters}
        own[f"{more.id}.{factor}"] = neutral + FACTOR_STEP
        model = Model(channel, final.structure.dropping(effect.id).adding(more))
        theta = model.start(final.log_rates, final.choice | own)
        columns.append((model.predict(Point(theta, final.deviations))[0] - base) / FACTOR_STEP)
    right, normal = final.scores(problem, problem.whiten(np.stack(columns, axis=-1)))
    free = []
    for (factor, how), score, information in zip(factors, right, np.diag(normal), strict=True):
        if information <= 0:
            continue
        value, spread = score / information, 1.0 / np.sqrt(information)
        sharp = WORTH_KNOWING_HUMIDITY if factor == "humidity" else WORTH_KNOWING[how]
        if abs(value) < DEPENDENCE_SIGMAS * spread and spread < sharp:
            free.append(factor)
    return tuple(free)


def _nearest(problem: Problem, found: Search, effect: Effect, instead: list[tuple[Rated, float]]) -> Likeness | None:
    """The entry of the catalogue that does best in the place of a form; None where none was tried there."""
    for one, behind in instead:
        new = [e.id for e in one.fit.structure.effects if e.id not in found.best.ids]
        if len(new) == 1 and not is_described(new[0]):
            without = next((r for r in found.pool if r.ids == found.best.ids - {effect.id}), found.plain)
            likeness = _alike(problem, without.fit, found.best.fit, one.fit)
            if likeness <= 0.0:
                return None
            if one in found.tied():
                return Likeness(new[0], round(likeness, 3))  # nothing says that it is not this one
            return Likeness(new[0], round(likeness, 3), f"with it unseen runs are e^{behind:.0f} times less likely")
    return None


def _alike(problem: Problem, without: Fit, first: Fit, second: Fit) -> float:
    """Cosine between what two models take off the whitened residuals of a third."""
    base = problem.whiten(without.residual)
    one, other = (base - problem.whiten(fit.residual) for fit in (first, second))
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float((one * other).sum()) / size if size > 0 else 0.0
