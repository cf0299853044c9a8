"""How alike two effects are in a channel's runs: the cosine of their signatures once the model's own parameters and the
runs' random effects are taken out; and the plain forms in the place of a named cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.discovery.grammar import SCALING, forms, plain_forms
from shockrig.analysis.discovery.race import NUMBER, WHOLE, Candidate, to_its_end
from shockrig.analysis.effects.behaviours import form_of
from shockrig.analysis.effects.described import described
from shockrig.analysis.effects.laws import kin
from shockrig.analysis.inference.arrow import Arrow
from shockrig.analysis.inference.effect import Effect, Parameter, by_name
from shockrig.analysis.inference.fit import Fit, fit, go_on, linearise
from shockrig.analysis.inference.model import Model, Point, Structure
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.work import Work

Array = NDArray[np.float64]

TOLD_OF_PRIOR = 0.5  # of what was known of a number beforehand, to which it is known where the runs tell it
TOLD = 1e-3  # share of a signature that must be left of it to have a direction
ALIKE = 0.4  # from which on a form is tried in a cause's place: far from its end a signature points only roughly
TRIED = 6  # forms that are
GLANCE = 5  # steps of a fit after which a form is given up that is still
FAR_BEHIND = 100.0  # of deviance from doing better: near the end steps bring tenths
TIED = 12.0  # of deviance within which one does as well, and is tried with what it may depend on
LEAST, SPREAD = 1e-4, 24  # share of a range from which on a single number is looked for, and at how many places
POINTS, NEARER = 8, 3  # places between its neighbours that are looked at then, and how often

Start = tuple[Effect, Mapping[str, float]]


@dataclass(frozen=True)
class Alike:
    """An effect, the start at which its signature is most like another's, and the cosine of the two."""

    effect: Effect
    start: Mapping[str, float]
    likeness: float


@dataclass(frozen=True)
class Signature:
    """A model without one of its effects, and that effect's signature beside it, whitened (R, n)."""

    problem: Problem
    final: Fit
    less: Structure
    theta: Array
    base: Array
    arrow: Arrow
    own: Array

    def beside(self, others: Sequence[Start]) -> tuple[Array, Array]:
        """Cosine of each effect's signature at its start with the own one, and their squared distance as a share of the
        own one's square, the model's freedom taken out."""
        channel, final = self.problem.channel, self.final
        columns, bare = [self.own], Model(channel, self.less)
        for effect, start in others:
            model = Model(channel, self.less.adding(effect))
            shift = float(np.log(effect.rate_factor(channel))) if effect.rate_factor else 0.0
            at = model.start(final.log_rates + shift, final.choice | by_name(effect, start))
            at[model.behind] = self.theta[bare.behind]
            columns.append(self.problem.whiten(model.predict(Point(at, final.deviations))[0] - self.base))
        stacked = np.stack(columns, axis=-1)
        _, normal = self.arrow.scores(stacked, np.zeros(stacked.shape[:2]), np.zeros_like(final.deviations))
        square = np.maximum(np.diag(normal), 0.0)
        length, shared = np.sqrt(square), normal[0, 1:]
        cosine = np.abs(shared) / np.maximum(length[0] * length[1:], 1e-12)
        # What is all but taken up by the model's own freedom has no direction left.
        whole = np.sqrt((stacked**2).sum(axis=(0, 1)))
        told = (length > TOLD * whole) & (whole > 0)
        apart = (square[0] + square[1:] - 2.0 * shared) / max(square[0], 1e-12)
        return np.where(told[1:] & told[0], np.minimum(cosine, 1.0), 0.0), apart


def signature(problem: Problem, final: Fit, id_: str) -> Signature:
    """That of the effect `id_` of a fit."""
    less = final.structure.dropping(id_)
    bare = Model(problem.channel, less)
    theta = bare.start(final.log_rates, final.choice)
    theta[bare.behind] = final.theta[final.model.behind]
    # The freedom that counts is that of the model without it: its own size would take all of it away.
    base, arrow = linearise(problem.with_rate_scatter(final.rate_scatter), less, Point(theta, final.deviations))
    own = problem.whiten(final.model.predict(final.point)[0] - base)
    return Signature(problem, final, less, theta, base, arrow, own)


def alike(of: Signature, others: Sequence[Start]) -> list[Alike]:
    """Effects by their likeness to one of a fit, the most alike first; each at its own best start."""
    if not others:
        return []
    cosine, _ = of.beside(others)
    best: dict[str, Alike] = {}
    for (effect, start), value in zip(others, cosine, strict=True):
        if effect.id not in best or value > best[effect.id].likeness:
            best[effect.id] = Alike(effect, start, float(value))
    return sorted(best.values(), key=lambda one: -one.likeness)


def closest(of: Signature, one: Alike) -> Alike:
    """The same where its signature is as large as well: no fit finds its way over a jump of the reading.

    Only one that has a single number is looked for, first anywhere, then ever nearer to where it came nearest.
    """
    if len(one.effect.parameters) != 1:
        return one
    (parameter,) = one.effect.parameters
    best, grid = one.start, _anywhere(parameter)
    for _ in range(NEARER):
        starts: list[Start] = [(one.effect, best), *((one.effect, {parameter.name: x}) for x in grid)]
        _, apart = of.beside(starts)
        best = starts[int(np.argmin(apart))][1]
        at = parameter.encoded(best[parameter.name])
        scale = np.array([parameter.encoded(x) for x in grid])
        below, above = scale[scale < at - 1e-12], scale[scale > at + 1e-12]
        inside = np.linspace(below.max() if below.size else at, above.min() if above.size else at, POINTS + 2)[1:-1]
        grid = [float(np.exp(x)) if parameter.log else float(x) for x in inside]
    return replace(one, start=best)


def _anywhere(parameter: Parameter) -> list[float]:
    """Values all over a parameter's range, equally far apart in ratio on either side of nothing."""
    most = max(abs(parameter.low), abs(parameter.high))
    sizes = np.geomspace(LEAST * most, most, SPREAD)
    both = [*(-sizes[::-1]), *sizes] if parameter.low < 0 else list(sizes)
    return [float(x) for x in both if parameter.low < x < parameter.high]


def in_its_place(problem: Problem, final: Fit, id_: str, one: Alike, most: float = np.inf) -> Fit | None:
    """The model with another effect in the place of one, fitted from both starts of the deviations; None where both
    stay far above a deviance of `most`."""
    structure = final.structure.dropping(id_).adding(one.effect)
    theta = Model(problem.channel, structure).start(final.log_rates, final.choice | by_name(one.effect, one.start))
    begun = [fit(problem, structure, theta, at, GLANCE) for at in (final.deviations, problem.channel.at_rest())]
    # Where the objective has steps, a fit that is still may be on the wrong side of one.
    hopeful = [f for f in begun if one.effect.nudges or f.deviance < most + FAR_BEHIND]
    return min((go_on(problem, f, WHOLE) for f in hopeful), key=lambda f: f.deviance, default=None)


def in_place_of(problem: Problem, final: Fit, id_: str, work: Work) -> list[Candidate]:
    """Plain forms fitted in the place of a cause, the best first: those whose signature is like its own, and those that
    behave as it does.

    A catalogue names what comes nearest, and with nothing left to see. Where what is really there has no entry, a plain
    behaviour fits better than the name.
    """
    others = []
    for form in plain_forms(problem.channel):
        if form.behaves_as != "periodic":  # a swing is like nothing that the catalogue has
            effect = described(form.key, problem.channel.jumps_with_air)
            others += [(effect, start) for start in effect.starts(problem.channel)]
    level = final.deviance + price_of(final, id_)
    found: list[Candidate] = []
    own = signature(problem, final, id_)
    for place, one in enumerate(alike(own, others)):
        rule = kin(id_, form_of(one.effect.id))
        if not (rule or (place < TRIED and one.likeness >= ALIKE)):
            continue
        work.count(2)
        # Another rule of the same behaviour may have far to go: a delay of the other sign.
        reached = in_its_place(problem, final, id_, closest(own, one), np.inf if rule else level)
        if reached is not None:
            found.append(to_its_end(problem, Candidate(one.effect, reached), work))
    found.sort(key=lambda c: c.cost)
    # What does all that the name does may depend on what the name does not.
    if found and found[0].cost < level + TIED:
        found = sorted((*found, *_depending(problem, found[0], work)), key=lambda c: c.cost)
    return found


def price_of(final: Fit, id_: str) -> float:
    """What the numbers of an effect of a model must bring, as those of a form; one that stays what was known of it
    beforehand (a room's humidity, to a bead) is none."""
    effect, known = next(e for e in final.structure.effects if e.id == id_), final.values()[id_]
    told = [p for p in effect.parameters if p.prior is None or known[p.name][1] < TOLD_OF_PRIOR * p.prior[1]]
    return NUMBER * len(told)


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
