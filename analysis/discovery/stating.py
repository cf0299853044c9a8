"""What is said of a described effect: what it does not depend on, over what it was seen, the catalogued effect that
behaves most alike and why it is not that one, and its alternatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from shockrig.analysis.discovery.discover import Described, Discovery
from shockrig.analysis.discovery.grammar import scaling_factors, varied
from shockrig.analysis.discovery.listed import Placed, listed_instead
from shockrig.analysis.effects.behaviours import form_of
from shockrig.analysis.effects.described import described, discovered_of
from shockrig.analysis.inference.effect import Effect
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.model import Model, Point
from shockrig.analysis.inference.problem import Problem
from shockrig.files.diagnosis_data import Discovered, Likeness

SIGMAS = 3.0  # beyond which a dependence is one
# Half of these would be a dependence worth knowing; what is known better than this is excluded.
SHARP = {"power": 0.15, "exponential": 0.01, "ratio": 0.1}
SHARP_HUMIDITY, SHARP_ORDER = 0.4, 0.01
STEP = 1e-3  # of a factor's number, in finite differences


def nearest_of(problem: Problem, found: Discovery) -> dict[str, list[Placed]]:
    """Catalogued effects in the place of each described one, the best fit first."""
    return {one.effect.id: listed_instead(problem, found.fit, one.effect.id) for one in found.effects}


def stated(problem: Problem, found: Discovery, nearest: dict[str, list[Placed]]) -> tuple[Discovered, ...]:
    """The described effects of a discovery as a diagnosis's file states them."""
    return tuple(_stated(problem, found, one, nearest[one.effect.id]) for one in found.effects)


def _stated(problem: Problem, found: Discovery, one: Described, nearest: list[Placed]) -> Discovered:
    return replace(
        discovered_of(one.effect, one.values),
        does_not_depend_on=_independent(problem, found.fit, one.effect),
        alternatives=tuple(
            replace(discovered_of(other.effect, other.fit.values()[other.effect.id]), seen_over={})
            for other in one.instead
        ),
        nearest_catalogued=_nearest(problem, found.fit, one, nearest),
        probability=round(one.probability, 3),
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
        own[f"{more.id}.{factor}"] = neutral + STEP
        model = Model(channel, final.structure.dropping(effect.id).adding(more))
        theta = model.start(final.log_rates, final.choice | own)
        columns.append((model.predict(Point(theta, final.deviations))[0] - base) / STEP)
    right, normal = final.scores(problem, problem.whiten(np.stack(columns, axis=-1)))
    free = []
    for (factor, how), score, information in zip(factors, right, np.diag(normal), strict=True):
        if information <= 0:
            continue
        value, spread = score / information, 1.0 / np.sqrt(information)
        sharp = {"humidity": SHARP_HUMIDITY, "run_order": SHARP_ORDER}.get(factor, SHARP[how])
        if abs(value) < SIGMAS * spread and spread < sharp:
            free.append(factor)
    return tuple(free)


def _nearest(problem: Problem, final: Fit, one: Described, alike: list[Placed]) -> Likeness | None:
    """Of the catalogued effects whose signature is most like this one's, that which fits best in its place."""
    if not alike:
        return None
    return Likeness(alike[0].effect.id, round(alike[0].likeness, 3), _why_not(problem, final, alike[0].fit, one))


def _why_not(problem: Problem, final: Fit, placed: Fit, one: Described) -> str:
    """Why the catalogued effect that is most alike is not the one: how much worse it does, and where."""
    rise = placed.deviance - final.deviance
    if rise < 1.0:
        return "it explains these runs as well, and was not certain beside the rest"
    if rise > one.necessity:
        return "fitted in its place it explains nothing of what this does"
    worse = (problem.whiten(placed.residual) ** 2).sum(axis=1) - (problem.whiten(final.residual) ** 2).sum(axis=1)
    said = f"in its place the misfit rises by {rise:.3g} (deviance)"
    where = _where(problem, worse)
    return f"{said}, most {where}" if where else said


def _where(problem: Problem, worse: np.ndarray) -> str:
    """The condition by which a misfit (R,) is parted best; empty where none parts it."""
    c, there = problem.channel.conditions, varied(problem.channel)
    up = problem.channel.quantity.step(c) > 0
    groups = {
        "airflow": ("at {:.2g} m/s", np.round(c.airflow_m_s, 1) + 0.0),
        "ambient": ("at {:.0f} degC", np.round(c.destination_c) + 0.0),
        "direction": ("in steps {}", np.where(up, 1.0, 0.0)),
    }
    total = float(((worse - worse.mean()) ** 2).sum())
    best, said = 0.3, ""
    for name, (words, level) in groups.items():
        if name not in there or total <= 0:
            continue
        means = {value: worse[level == value].mean() for value in np.unique(level)}
        between = sum((level == value).sum() * (mean - worse.mean()) ** 2 for value, mean in means.items()) / total
        if between > best:
            most = max(means, key=means.__getitem__)
            shown = ("upwards" if most else "downwards") if name == "direction" else most
            best, said = between, words.format(shown)
    return said
