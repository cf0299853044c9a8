"""Which named causes stand beside a description: those that are still worth their penalty once it is there.

A cause that was found while something unknown was left may only have soaked up part of it.
"""

from __future__ import annotations

from dataclasses import replace

from shockrig.analysis.diagnosis.refitting import refit
from shockrig.analysis.diagnosis.thresholds import penalty
from shockrig.analysis.discovery.discover import Discovery
from shockrig.analysis.discovery.race import NUMBER
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.fit import Fit, fit
from shockrig.analysis.inference.model import Model
from shockrig.analysis.inference.problem import Problem


def cost(problem: Problem, plain: Fit, found: Fit) -> float:
    """Deviance of a model, and what its causes and the numbers of its descriptions must bring."""
    added = [effect for effect in found.structure.effects if effect.id not in plain.structure.ids]
    return found.deviance + sum(
        penalty(effect, problem.channel) if effect.id in CATALOGUE else NUMBER * len(effect.parameters)
        for effect in added
    )


def alone(problem: Problem, plain: Fit, found: Discovery) -> bool:
    """Whether the described effects do without all causes that were named beside the plain model."""
    structure, rest = plain.structure, problem.channel.at_rest()
    for one in found.effects:
        structure = structure.adding(one.effect)
    model = Model(problem.channel, structure)
    starts = {tuple(f.log_rates): model.start(f.log_rates, f.choice | found.fit.choice) for f in (plain, found.fit)}
    fits = [fit(problem, structure, theta, rest) for theta in starts.values()]
    return min(cost(problem, plain, f) for f in fits) < cost(problem, plain, found.fit)


def without_idle(problem: Problem, plain: Fit, found: Discovery) -> Discovery:
    """A description without the causes beside it that are not worth their penalty there, one after the other."""
    while True:
        named = [e for e in found.fit.structure.ids if e in CATALOGUE and e not in plain.structure.ids]
        trials = {e: refit(problem, found.fit.structure.dropping(e), found.fit) for e in named}
        idle = {e: f.deviance for e, f in trials.items() if cost(problem, plain, f) < cost(problem, plain, found.fit)}
        if not idle:
            return found
        least = min(idle, key=idle.__getitem__)
        values = trials[least].values()
        found = replace(
            found,
            fit=trials[least],
            without=refit(problem, found.without.structure.dropping(least), found.without),
            effects=tuple(replace(one, values=values[one.effect.id]) for one in found.effects),
        )
