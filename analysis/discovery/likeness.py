"""How alike two effects are in a channel's runs: the cosine of their signatures once the model's own parameters and the
runs' random effects are taken out; and whether a plain form does better in the place of a named cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from shockrig.analysis.discovery.grammar import SCALING, forms, plain_forms
from shockrig.analysis.discovery.race import NUMBER, WHOLE, Candidate, to_its_end
from shockrig.analysis.effects.described import described
from shockrig.analysis.inference.effect import Effect
from shockrig.analysis.inference.fit import Fit, fit, go_on, linearise
from shockrig.analysis.inference.model import Model, Point
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.work import Work

TOLD = 1e-3  # share of a signature that must be left of it to have a direction
ALIKE = 0.4  # from which on a form is tried in a cause's place: far from its end a signature points only roughly
TRIED = 6  # forms that are
GLANCE = 5  # steps of a fit after which a form is given up that is still
FAR_BEHIND = 100.0  # of deviance from doing better: near the end steps bring tenths
TIED = 12.0  # of deviance within which one does as well, and is tried with what it may depend on
PLAINLY = 12.0  # of deviance by which one has to do better: odds of four hundred

Start = tuple[Effect, Mapping[str, float]]


@dataclass(frozen=True)
class Alike:
    """An effect, the start at which its signature is most like another's, and the cosine of the two."""

    effect: Effect
    start: Mapping[str, float]
    likeness: float


def alike(problem: Problem, final: Fit, id_: str, others: Sequence[Start]) -> list[Alike]:
    """Effects by their likeness to the effect `id_` of a fit, the most alike first; each at its own best start."""
    if not others:
        return []
    channel, less = problem.channel, final.structure.dropping(id_)
    bare = Model(channel, less)
    theta = bare.start(final.log_rates, final.choice)
    theta[bare.behind] = final.theta[final.model.behind]
    # The freedom that counts is that of the model without it: its own size would take all of it away.
    base, arrow = linearise(problem.with_rate_scatter(final.rate_scatter), less, Point(theta, final.deviations))
    columns = [problem.whiten(final.model.predict(final.point)[0] - base)]
    for effect, start in others:
        model = Model(channel, less.adding(effect))
        shift = float(np.log(effect.rate_factor(channel))) if effect.rate_factor else 0.0
        named = {f"{effect.id}.{name}": value for name, value in start.items()}
        at = model.start(final.log_rates + shift, final.choice | named)
        at[model.behind] = theta[bare.behind]
        columns.append(problem.whiten(model.predict(Point(at, final.deviations))[0] - base))
    stacked = np.stack(columns, axis=-1)
    _, normal = arrow.scores(stacked, np.zeros(stacked.shape[:2]), np.zeros_like(final.deviations))
    length = np.sqrt(np.maximum(np.diag(normal), 0.0))
    cosine = np.abs(normal[0, 1:]) / np.maximum(length[0] * length[1:], 1e-12)
    # What is all but taken up by the model's own freedom has no direction left.
    whole = np.sqrt((stacked**2).sum(axis=(0, 1)))
    told = (length > TOLD * whole) & (whole > 0)
    cosine = np.where(told[1:] & told[0], np.minimum(cosine, 1.0), 0.0)
    best: dict[str, Alike] = {}
    for (effect, start), value in zip(others, cosine, strict=True):
        if effect.id not in best or value > best[effect.id].likeness:
            best[effect.id] = Alike(effect, start, float(value))
    return sorted(best.values(), key=lambda one: -one.likeness)


def in_its_place(problem: Problem, final: Fit, id_: str, one: Alike, most: float = np.inf) -> Fit | None:
    """The model with another effect in the place of one, fitted from both starts of the deviations; None where both
    stay far above a deviance of `most`."""
    structure = final.structure.dropping(id_).adding(one.effect)
    named = {f"{one.effect.id}.{name}": value for name, value in one.start.items()}
    theta = Model(problem.channel, structure).start(final.log_rates, final.choice | named)
    begun = [fit(problem, structure, theta, at, GLANCE) for at in (final.deviations, problem.channel.at_rest())]
    hopeful = [f for f in begun if f.deviance < most + FAR_BEHIND]
    return min((go_on(problem, f, WHOLE) for f in hopeful), key=lambda f: f.deviance, default=None)


def outdone(problem: Problem, final: Fit, id_: str, work: Work) -> Candidate | None:
    """The form that does plainly better in the place of a cause; None where none does.

    A catalogue names what comes nearest, and with nothing left to see. Where what is really there has no entry, a plain
    behaviour fits better than the name.
    """
    others = []
    for form in plain_forms(problem.channel):
        if form.behaves_as != "periodic":  # a swing is like nothing that the catalogue has
            effect = described(form.key, problem.channel.jumps_with_air)
            others += [(effect, start) for start in effect.starts(problem.channel)]
    own = next(effect for effect in final.structure.effects if effect.id == id_)
    level = final.deviance + NUMBER * len(own.parameters)
    best: Candidate | None = None
    for one in alike(problem, final, id_, others)[:TRIED]:
        if one.likeness < ALIKE:
            break
        work.count(2)
        reached = in_its_place(problem, final, id_, one, level)
        if reached is None:
            continue
        placed = to_its_end(problem, Candidate(one.effect, reached), work)
        if best is None or placed.cost < best.cost:
            best = placed
    # What does all that the name does may depend on what the name does not.
    if best is not None and best.cost < level + TIED:
        best = min((best, *_depending(problem, best, work)), key=lambda c: c.cost)
    return best if best is not None and best.cost < level - PLAINLY else None


def _depending(problem: Problem, one: Candidate, work: Work) -> list[Candidate]:
    """The same form depending on one thing more."""
    found, without = [], one.fit.structure.dropping(one.effect.id)
    for form in forms(problem.channel):
        more = set(form.depends_on) - set(one.form.depends_on)
        same = (form.behaves_as, form.driver) == (one.form.behaves_as, one.form.driver)
        if not same or len(more) != 1 or len(form.depends_on) != len(one.form.depends_on) + 1:
            continue
        ((factor, how),) = more
        if (factor, how) not in SCALING:
            continue
        effect = described(form.key, problem.channel.jumps_with_air)
        named = {f"{effect.id}.{p.name}": one.fit.choice[f"{one.effect.id}.{p.name}"] for p in one.effect.parameters}
        named[f"{effect.id}.{factor}"] = 1.0 if how == "ratio" else 0.0
        structure = without.adding(effect)
        theta = Model(problem.channel, structure).start(one.fit.log_rates, one.fit.choice | named)
        work.count()
        found.append(Candidate(effect, fit(problem, structure, theta, one.fit.deviations, WHOLE)))
    return found
