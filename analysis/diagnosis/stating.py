"""What is said of a form that a model holds: what it does not depend on, over what it was seen, the entry of the
catalogue that comes nearest and why it is not that one, and its alternatives."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.discovery.grammar import scaling_factors, varied
from shockrig.analysis.effects.behaviours import form_of
from shockrig.analysis.effects.described import described, discovered_of, is_described
from shockrig.analysis.inference.effect import Effect
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.model import Model, Point
from shockrig.analysis.inference.problem import Problem
from shockrig.files.diagnosis_data import Discovered, Likeness

if TYPE_CHECKING:
    from shockrig.analysis.diagnosis.search import Rated, Search

Array = NDArray[np.float64]

DEPENDENCE_SIGMAS = 3.0  # beyond which a dependence is one
# A dependence of this size is worth knowing; what is known better than this is excluded.
SHARP = {"power": 0.15, "exponential": 0.01, "ratio": 0.1}
SHARP_HUMIDITY, SHARP_ORDER = 0.4, 0.01
FACTOR_STEP = 1e-3  # of a factor's number, in finite differences
MOST_ALTERNATIVES = 5


def stated(problem: Problem, found: Search, final: Fit) -> tuple[Discovered, ...]:
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
            alternatives.append(replace(discovered_of(new[0], one.fit.values()[new[0].id]), seen_over={}))
    return replace(
        discovered_of(effect, final.values()[effect.id]),
        does_not_depend_on=_independent(problem, final, effect),
        alternatives=tuple(alternatives[:MOST_ALTERNATIVES]),
        nearest_catalogued=_nearest(problem, found, effect, instead),
        probability=round(found.probability(effect.id), 3),
        seen_over=seen_over(problem),
    )


def seen_over(problem: Problem) -> dict[str, tuple[float, float]]:
    """Lowest and highest of the conditions under which the runs were made."""
    c = problem.channel.conditions
    over = {"ambient_temperature_c": (float(c.destination_c.min()), float(c.destination_c.max()))}
    if c.airflow_known.all():
        over["airflow_m_s"] = (float(c.airflow_m_s.min()), float(c.airflow_m_s.max()))
    if "pressure" in varied(problem.channel):
        over["pressure_hpa"] = (float(c.pressure_hpa.min()), float(c.pressure_hpa.max()))
    return over


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
        sharp = {"humidity": SHARP_HUMIDITY, "run_order": SHARP_ORDER}.get(factor, SHARP[how])
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
                return None  # it is told among what the runs do not tell apart
            return Likeness(new[0], round(likeness, 3), f"with it unseen runs are e^{behind:.3g} times less likely")
    return None


def _alike(problem: Problem, without: Fit, first: Fit, second: Fit) -> float:
    """Cosine between what two models take off the whitened residuals of a third."""
    base = problem.whiten(without.residual)
    one, other = (base - problem.whiten(fit.residual) for fit in (first, second))
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float((one * other).sum()) / size if size > 0 else 0.0
