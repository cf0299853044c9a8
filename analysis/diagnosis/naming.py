"""Names against plain behaviours: a cause in whose place a form of the grammar does as well or better.

A form that is the law of another catalogued effect speaks for that effect, which the search then begins with, or which
is tied with the cause; one that nobody listed speaks against the name.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import special

from shockrig.analysis.diagnosis.search import Earlier, refused, says_nothing
from shockrig.analysis.diagnosis.thresholds import TIE
from shockrig.analysis.discovery.discover import Discovery, says_something
from shockrig.analysis.discovery.likeness import FAR_BEHIND, Alike, in_its_place, in_place_of, price_of
from shockrig.analysis.discovery.listed import Placed, available, same_law
from shockrig.analysis.discovery.race import Candidate, price
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.work import Work

PLAINLY = 12.0  # of deviance by which a form has to do better than a name: odds of four hundred


@dataclass(frozen=True)
class Doubt:
    """What speaks against a named cause.

    Attributes
    ----------
    cause : str
    form : Candidate or None
        The best form in its place that is no catalogued effect's law, where that does plainly better than the name: by
        odds of 20.
    outdone : bool
        Whether it does so much better that the name falls: by odds of 400, or by 20 where real benches hardly ever have
        what is named.
    rivals : {effect: rise in deviance with it in the cause's place}
        Catalogued effects, by their law in the grammar, that do as well or better.
    better : Placed or None
        That of them which does plainly better.
    """

    cause: str
    form: Candidate | None
    outdone: bool
    rivals: dict[str, float]
    better: Placed | None

    def share(self, of: Iterable[str]) -> float:
        """The cause's odds beside some of its rivals, as the share that is left of its probability."""
        return float(special.softmax([0.0, *(-0.5 * self.rivals[rival] for rival in of)])[0])

    @property
    def sentence(self) -> str:
        """What the runs do not tell, where a form that nobody listed does as well."""
        assert self.form is not None
        behaviour = self.form.form.behaves_as.replace("_", " ")
        return (
            f"{self.cause.replace('_', ' ').capitalize()} is named, and a plain behaviour ({behaviour}) that claims no "
            "cause explains these runs as well: it has even odds at most."
        )


def doubts(problem: Problem, final: Fit, causes: Iterable[str], work: Work) -> list[Doubt]:
    """Those of the causes of a model that plain forms speak against."""
    found = [_doubt(problem, final, cause, work) for cause in causes]
    return [one for one in found if one.form is not None or one.rivals or one.better is not None]


def _doubt(problem: Problem, final: Fit, cause: str, work: Work) -> Doubt:
    rare = CATALOGUE[cause].rarity(problem.channel)
    candidates = list(in_place_of(problem, final, cause, work))
    # A fit may have ended before a step of its objective: the name is worth what its own law reaches.
    own = [one.fit.deviance for one in candidates if any(effect == cause for effect, _ in same_law(one))]
    level = min([final.deviance, *own]) + price_of(final, cause) + rare
    others = {effect.id for effect in available(problem.channel, final.structure.dropping(cause))}
    form, placed = None, list[Placed]()
    for one in candidates:
        laws = [(effect, values) for effect, values in same_law(one) if effect in others]
        if laws:
            if one.cost < level + 2.0 * TIE:
                placed += _placed(problem, final, cause, [law for law in laws if law[0] != cause])
        elif form is None and says_something(one):
            form = one
    best = min(placed, key=lambda one: one.cost, default=None)
    if form is not None and best is not None and form.cost > best.cost - TIE:
        form = None  # one more number beside a catalogued law is no behaviour that nobody listed
    margin = -np.inf if form is None else level - form.cost
    if form is not None and best is not None and form.cost < best.cost - FAR_BEHIND:
        best = None  # nor is it the rival that the search had missed
    return Doubt(
        cause,
        form if margin > TIE else None,
        bool(margin > (TIE if rare else PLAINLY)),
        {one.effect.id: one.cost - level for one in placed if one.cost < level + TIE},
        best if best is not None and best.cost < level - TIE else None,
    )


def _placed(problem: Problem, final: Fit, cause: str, laws: list[tuple[str, dict[str, float]]]) -> list[Placed]:
    """Catalogued effects in a cause's place from values that are known; those that are no finding are left out."""
    found = []
    for name, values in laws:
        entry = CATALOGUE[name]
        fitted = in_its_place(problem, final, cause, Alike(entry, values, 1.0))
        if fitted is None or says_nothing(entry, fitted.values()[name]) or refused(fitted, entry):
            continue
        found.append(Placed(entry, fitted, 1.0))
    return found


def from_rivals(told: Iterable[Doubt]) -> Earlier | None:
    """Where a search that missed a catalogued effect begins again; None where none was missed."""
    missed = [one.better for one in told if one.better is not None]
    return _values(missed[0].fit) if missed else None


def from_description(found: Discovery, nearest: dict[str, list[Placed]]) -> Earlier | None:
    """Likewise where what is described is the law of a catalogued effect, which does as well in its place."""
    for one in found.effects:
        own = Candidate(one.effect, found.fit)
        level = found.fit.deviance + price(own.form, len(one.effect.parameters))
        for placed in sorted(nearest[one.effect.id], key=lambda p: p.cost):
            values = placed.fit.values()[placed.effect.id]
            sound = not says_nothing(placed.effect, values) and not refused(placed.fit, placed.effect)
            if sound and placed.cost < level + TIE:
                return _values(placed.fit)
    return None


def _values(of: Fit) -> Earlier:
    """Catalogued effects of a fit with their values."""
    values = of.values()
    return {e: {name: value for name, (value, _) in values[e].items()} for e in of.structure.ids if e in CATALOGUE}
