"""An explanation of a channel as it is handed on, without a fit: the effects of a model with their values; what sets it
apart from others, and the fit that begins from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce

from shockrig.analysis.effects import in_channel
from shockrig.analysis.effects.described import is_described
from shockrig.analysis.effects.forms import form_of
from shockrig.analysis.estimate.fit import Fit, fit
from shockrig.analysis.estimate.fit_starts import rough_point
from shockrig.analysis.estimate.model import Structure
from shockrig.analysis.estimate.problem import Problem

Explanation = Mapping[str, Mapping[str, float]]  # effect -> parameter -> value that a fit begins from


def explained_by(found: Fit) -> Explanation:
    """A fit's effects with their values."""
    return {e: {p: value for p, (value, _) in own.items()} for e, own in found.values().items()}


def label_of(explanation: Explanation, among: Sequence[Explanation]) -> str:
    """An explanation's effects that not all others have too; "nothing" where it has none beyond these."""
    common = set.intersection(*(set(other) for other in among))
    return " + ".join(_words(e) for e in explanation if e not in common) or "nothing"


def _words(effect: str) -> str:
    """A catalogued effect's id; of one that nobody listed how it behaves, on what, and what it depends on."""
    if not is_described(effect):
        return effect
    form = form_of(effect)
    parts = [form.behaves_as, *([] if form.driver == "none" else [f"of {form.driver}"])]
    return " ".join([*parts, *(f"by {factor}" for factor in form.factors)]).replace("_", " ")


def structure_of(explanation: Explanation, base: Structure, channel: str) -> Structure:
    """The model of an explanation of a channel, with what the readings themselves show in `base`."""
    effects = (in_channel(id_, channel) for id_ in explanation if id_ not in base.ids)
    return reduce(Structure.adding, (effect for effect in effects if effect.fitted), base)


def fitted(problem: Problem, explanation: Explanation, base: Structure) -> Fit:
    """An explanation fitted to a channel, from the values that it came with."""
    structure = structure_of(explanation, base, problem.channel.name)
    choice = {f"{effect}.{name}": value for effect, own in explanation.items() for name, value in own.items()}
    start = rough_point(problem, structure, {name: choice[name] for name in structure.names if name in choice})
    return fit(problem, structure, start.theta, start.deviations)
