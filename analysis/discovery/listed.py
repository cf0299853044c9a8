"""Catalogued effects in the place of a form of the grammar: those with its very law, from its own numbers, and the few
that are most like it. What does as well under its own name needs no description."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from shockrig.analysis.discovery.likeness import Alike, Start, alike, closest, in_its_place, price_of, signature
from shockrig.analysis.discovery.race import Candidate
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.laws import laws_of
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.effect import Effect
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.model import Structure
from shockrig.analysis.inference.problem import Problem

MOVED = 0.01  # of a parameter's range
FEW = 3  # of those most alike that are fitted


@dataclass(frozen=True)
class Placed:
    """A catalogued effect fitted in the place of a form, and how alike the two were."""

    effect: Effect
    fit: Fit
    likeness: float

    @property
    def cost(self) -> float:
        """Deviance, what its numbers must bring, and what it must besides where benches hardly ever have it."""
        return self.fit.deviance + price_of(self.fit, self.effect.id) + self.effect.rarity(self.fit.model.channel)


def available(channel: Channel, taken: Structure) -> list[Effect]:
    """Catalogued effects that could stand in a channel beside those of a model."""
    ids = set(taken.ids)
    return [
        effect
        for effect in CATALOGUE.values()
        if effect.fitted
        and effect.acts_in(channel)
        and effect.id not in ids
        and not effect.excludes & ids
        and (not effect.beside or effect.beside & ids)
    ]


def same_law(one: Candidate) -> list[tuple[str, dict[str, float]]]:
    """Effects whose law a fitted form is, with the values that they have by its numbers."""
    own = {name: value for name, (value, _) in one.fit.values()[one.effect.id].items()}
    return [(effect, {name: own[of] for name, of in named.items()}) for effect, named in laws_of(one.form)]


def listed_instead(problem: Problem, final: Fit, id_: str) -> list[Placed]:
    """Catalogued effects in the place of the form `id_` of a model, the best fit first."""
    channel, entries = problem.channel, available(problem.channel, final.structure)
    laws: dict[str, Start] = {}
    for name, known in same_law(Candidate(next(e for e in final.structure.effects if e.id == id_), final)):
        for effect in entries:
            if effect.id == name:
                laws[name] = effect, _whole(effect, known)
    starts = [(effect, start) for effect in entries for start in _unequal(effect, effect.starts(channel))]
    of_form = signature(problem, final, id_)
    looks = alike(of_form, [*starts, *laws.values()])
    tried = [one for one in looks if one.effect.id in laws] + [one for one in looks if one.effect.id not in laws][:FEW]
    found = []
    for one in tried:
        own = laws.get(one.effect.id)
        begin = closest(of_form, one) if own is None else Alike(one.effect, own[1], one.likeness)
        placed = in_its_place(problem, final, id_, begin)
        assert placed is not None  # without a limit nothing is given up
        found.append(Placed(one.effect, placed, one.likeness))
    return sorted(found, key=lambda one: one.fit.deviance)


def _whole(effect: Effect, known: Mapping[str, float]) -> dict[str, float]:
    """Values of all an effect's parameters: those that are not known as where it does nothing, within their ranges."""
    missing = {p.name: p.starts[0] if p.none is None else p.none for p in effect.parameters}
    return {p.name: min(max((missing | dict(known))[p.name], p.low), p.high) for p in effect.parameters}


def _unequal(effect: Effect, starts: list[dict[str, float]]) -> list[dict[str, float]]:
    """Starts at which an effect does something: where it begins from nothing, each of its numbers moved by itself."""
    found = []
    for start in starts:
        if any(start[p.name] != p.none for p in effect.parameters) or not effect.parameters:
            found.append(start)
        else:
            found += [start | {p.name: start[p.name] + MOVED * (p.high - p.low)} for p in effect.parameters]
    return found
