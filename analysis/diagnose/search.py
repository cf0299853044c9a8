"""The search: all candidates in one race, judged by how well they predict runs that they were not fitted to.

A model grows by the candidate that gains most on unseen runs beyond what is held against it before any data; what then
gains no longer is taken away, and each effect is tried against the others in its place. All sound models stand in one
pool, and the weights of that pool are all that a diagnosis rests on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from shockrig.analysis.diagnose.candidates import Candidate, candidates
from shockrig.analysis.diagnose.first_order import FAR_DISCREPANCY
from shockrig.analysis.diagnose.pool import Rated, Search, value_of
from shockrig.analysis.diagnose.race import Race
from shockrig.analysis.estimate.effect import by_name
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.fit_starts import rough_rates
from shockrig.analysis.estimate.model import PLAIN, Model, Structure
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.refitting import begun_anew, plain_fit

Earlier = Mapping[str, Mapping[str, float]]  # effects that an earlier search of the same runs ended with: parameters


def first_look(problem: Problem, base: Structure = PLAIN) -> Fit:
    """The plain model with the one effect of the catalogue that gains most, if one does: about what a channel does."""
    entries = [one for one in candidates(problem.channel) if one.form is None]
    race = Race(problem, base, entries)
    plain = race.keep(race.rated(plain_fit(problem, base)))
    found = race.forward(plain, entries)
    return (plain if found is None else max(plain, found, key=value_of)).fit


def search(
    problem: Problem,
    base: Structure = PLAIN,
    earlier: Earlier | None = None,
    describing: bool = True,
    plain_at: Fit | None = None,
) -> Search:
    """Search for what explains a channel.

    Parameters
    ----------
    problem : Problem
    base : Structure
        Effects that the readings themselves have shown; they are never taken away.
    earlier : {effect: {parameter: value}}, optional
        What an earlier search of the same runs, or of some of them, ended with: a place to begin from as well.
    describing : bool
        Whether forms of the grammar are candidates as well.
    plain_at : Fit, optional
        The fit of the plain model, where it has been made.
    """
    among = [one for one in candidates(problem.channel) if describing or one.form is None]
    race = Race(problem, base, among)
    plain = race.keep(race.rated(plain_at or plain_fit(problem, base)))
    entries = [one for one in among if one.form is None]
    forms = [one for one in among if one.form is not None]
    # First, so that where a search came to its limit, one that begins from its end leads further.
    resumed = race.grown(_resumed(race, plain, earlier), entries) if earlier else plain
    _try_simple(race, plain, entries)
    # What takes several effects may be the law of a single one that nobody listed. One beside which nothing gains is
    # the whole of it, unless two that are listed are better.
    law = race.with_one(plain, forms)
    whole = law.value > race.with_one(plain, entries).value and race.with_one(law, among) is law
    named = race.grown(plain, entries)
    if not whole:
        named = max(named, _from_runner_up(race, named, entries), key=value_of)
    named = max(named, resumed, key=value_of)
    best = law if whole and law.value > named.value else max(law, race.with_one(named, forms), key=value_of)
    if best.value <= named.value or best.score.discrepancy > FAR_DISCREPANCY:
        named = race.exchanged(race.grown(named, entries), entries)
        best = max(best, race.with_one(named, forms), key=value_of)
    if best.value > named.value:
        grown = race.grown(race.pruned(race.simplest(best)), among)
        race.exchanged(race.simplest(grown), among)
    else:
        race.simplest(named)
        for effect in sorted(named.ids - race.fixed):
            race.forward(race.without(named, effect), forms)
    return race.weighed(plain)


def _try_simple(race: Race, plain: Rated, entries: Sequence[Candidate]) -> None:
    """Try what one would fit without a catalogue, as far as it is a candidate: one lag, two in series or in parallel,
    and beside a reference each with a calibration line."""
    own = {role: [one for one in entries if one.effect.candidacy.simple == role] for role in ("body", "lag", "line")}
    lumps = [plain] if race.problem.channel.body == "lumped" else [race.forward(plain, [one]) for one in own["body"]]
    lags = [race.forward(lump, [one]) for lump in lumps if lump is not None for one in own["lag"]]
    for response in (plain, *lumps, *lags) if race.problem.channel.measured.any() else ():
        for line in own["line"] if response is not None else ():
            race.forward(response, [line])


def _from_runner_up(race: Race, named: Rated, entries: Sequence[Candidate]) -> Rated:
    """A model grown from the best single effect that another one has not: what gains most alone need not be one of two
    that gain most together."""
    alone = [race.pool.get(race.fixed | {one.effect.id}) for one in entries if one.effect.id not in named.ids]
    begins = [one for one in alone if one is not None]
    return race.grown(max(begins, key=value_of), entries) if begins and named.ids > race.fixed else named


def _resumed(race: Race, plain: Rated, earlier: Earlier) -> Rated:
    """The plain model with the effects that an earlier search ended with, as far as they gain."""
    structure, choice = plain.fit.structure, dict[str, float]()
    for one in race.among:
        values = earlier.get(one.effect.id)
        if values is None or not one.fits(structure):
            continue
        structure = structure.adding(one.effect)
        known = {
            p.name: float(np.clip(values[p.name], p.low, p.high)) for p in one.effect.parameters if p.name in values
        }
        choice |= by_name(one.effect, known)
    if structure.ids == plain.fit.structure.ids:
        return plain
    anew = begun_anew(race.problem, plain.fit)
    rates = rough_rates(race.problem, structure, anew, choice)
    begun = race.fitted(structure, Model(race.problem.channel, structure).start(rates, choice), anew)
    if not race.is_sound(begun):
        return plain
    return max(plain, race.pruned(race.keep(race.finished(begun))), key=value_of)
