"""A search under way: candidates begun beside a model, carried on and ended, and the moves that a search makes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnose.candidates import Candidate, bare_forms, kin_of, refused, sound
from shockrig.analysis.diagnose.first_order import FAR_DISCREPANCY, Screened, Starts, best_group, promises
from shockrig.analysis.diagnose.pool import Rated, Search, heaviest_first, keep_best, stated, stuck, value_of
from shockrig.analysis.effects.described import is_described
from shockrig.analysis.effects.forms import forms_of
from shockrig.analysis.estimate.effect import Effect, by_name
from shockrig.analysis.estimate.fit import MOST_STEPS, Fit, fit, go_on
from shockrig.analysis.estimate.fit_starts import plainly_wrong, rough_point, rough_rates
from shockrig.analysis.estimate.model import Model, Structure
from shockrig.analysis.estimate.predictive import bumps, score
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.refitting import begun_anew, labelled, rate_shift, refit

Array = NDArray[np.float64]

# How many candidates are begun, go on, and are fitted to their ends at each step: what a campaign may cost.
BEGUN_COUNT, RUNNING_COUNT, FINISHED_COUNT = 12, 5, 2
STARTS_EACH = 2  # of a candidate, the best to first order
QUICK_STEPS, FURTHER_STEPS = 3, 5  # steps of Gauss and Newton, before a fit to its end
WITHIN_REACH = 3.0  # nats that a candidate's promise to first order may lack and that its fit may bring
MOST_FITS = 600


@dataclass(frozen=True)
class BesideModel:
    """What is known of candidates beside one model, by effect: the same whatever else is tried there.

    `far` is whether the model leaves so much that the runs' own deviations mean little, `promised` what each promises
    to first order, `groups` are forms in the group of runs in which they promise most; `fits` are their fits so far,
    the best first; `ended` are those whose best has been fitted to its end.
    """

    near: Rated
    far: bool
    promised: dict[str, Screened] = field(default_factory=dict)
    groups: list[Candidate] = field(default_factory=list)
    fits: dict[str, list[Rated]] = field(default_factory=dict)
    ended: set[str] = field(default_factory=set)

    def ordered(self, effects: Sequence[str]) -> list[str]:
        """Candidates by the best of their fits."""
        return sorted(effects, key=lambda effect: -self.fits[effect][0].value)


class Race:
    """A search under way: its problem, the candidates, and the pool of models so far."""

    def __init__(self, problem: Problem, base: Structure, among: Sequence[Candidate]) -> None:
        self.problem, self.fixed = problem, frozenset(base.ids)
        self.among = tuple(among)
        self.bare = bare_forms(problem.channel) if any(one.form for one in among) else ()
        self.bump = bumps(problem)
        self.priors = {one.effect.id: one.log_prior for one in self.among}
        self.pool: dict[frozenset[str], Rated] = {}
        self.unsound: dict[frozenset[str], Rated] = {}  # models whose effects say nothing: they may predict
        self.done: dict[tuple[frozenset[str], frozenset[str]], Rated | None] = {}
        self.places: dict[int, BesideModel] = {}  # by the identity of the fit, which they keep alive
        self.fits = 0

    def rated(self, found: Fit) -> Rated:
        """A fit with its score."""
        prior = sum(self.priors.get(id_, 0.0) for id_ in found.structure.ids)
        return Rated(found, score(self.problem, found, self.bump), prior)

    def fitted(self, structure: Structure, theta: Array, deviations: Array, steps: int = MOST_STEPS) -> Rated:
        """A structure fitted from a start."""
        self.fits += 1
        return self.rated(fit(self.problem, structure, theta, deviations, steps))

    def keep(self, one: Rated) -> Rated:
        """The best fit so far of a model, which goes into the pool, with time constants labelled as everywhere."""
        as_usual = labelled(self.problem, one.fit)
        return keep_best(self.pool, one if as_usual is one.fit else self.rated(as_usual))

    def is_sound(self, one: Rated) -> bool:
        """Whether a model's effects say something where it ended; one whose do not is kept for predictions."""
        if sound(one.fit, one.ids - self.fixed):
            return True
        keep_best(self.unsound, one)
        return False

    def beside(self, near: Rated) -> BesideModel:
        """What is known so far of candidates beside a model."""
        if id(near.fit) not in self.places:
            far = near.score.discrepancy > FAR_DISCREPANCY or plainly_wrong(self.problem, near.fit)
            self.places[id(near.fit)] = BesideModel(near, far)
        return self.places[id(near.fit)]

    def screened(self, near: Rated, among: Sequence[Candidate]) -> list[Screened]:
        """Candidates with their starts and what the best of these promises to first order [nats], best first."""
        promised = self.beside(near).promised
        new = [one for one in among if one.effect.id not in promised]
        promised |= {found[0].effect.id: found for found in promises(self.problem, near, self.bump, new)}
        return sorted((promised[one.effect.id] for one in among), key=lambda item: -(item[2] + item[0].log_prior))

    def groups(self, near: Rated) -> list[Candidate]:
        """Each bare form in that group of runs, before one or from it on, in which it promises most."""
        place = self.beside(near)
        if not place.groups:
            found = (best_group(self.problem, near, self.bump, one) for one in self.bare)
            place.groups.extend(one for one in found if one is not None)
            self.priors |= {one.effect.id: one.log_prior for one in place.groups}
        return place.groups

    def _entered(self, screened: Sequence[Screened], far: bool) -> list[tuple[Candidate, Starts]]:
        """Those whose fits are begun: of each family the best, then by promise."""
        first: list[tuple[Candidate, Starts]] = []
        rest: list[tuple[Candidate, Starts]] = []
        seen: set[tuple[str, ...]] = set()
        for one, starts, gain in screened:
            effect = one.effect
            # A start that the data give may be the whole answer, whatever its first order says; another body, or where
            # a steady error is tried, is no small change.
            told = effect.start.always or (effect.start.from_data is not None and len(starts) == 1)
            told |= effect.start.rate_factor is not None and (far or not effect.rarity(self.problem.channel))
            reach = -0.7 * one.log_prior if far else WITHIN_REACH
            if gain + one.log_prior + reach <= 0 and not told:
                continue
            several = any(p.weakest is not None for p in effect.parameters)
            (rest if one.family in seen and not told else first).append(
                (one, starts[: STARTS_EACH + 1 if several else STARTS_EACH])
            )
            seen.add(one.family)
        entered = [*first[:BEGUN_COUNT], *rest[: max(BEGUN_COUNT - len(first), BEGUN_COUNT // 4)]]
        # A look-alike that is never fitted can never be tied: places that are left go to the next of the catalogue.
        ids = {one.effect.id for one, _ in entered}
        others = (
            (one, starts[:STARTS_EACH]) for one, starts, _ in screened if one.form is None and one.effect.id not in ids
        )
        return [*entered, *itertools.islice(others, max(RUNNING_COUNT - len(entered), 0))]

    def _beside_part(self, near: Rated, effect: str) -> BesideModel | None:
        """The largest part of a model beside which a candidate has been fitted, the best of those as large; none that
        is far from the runs, since a candidate takes there what others explain."""
        parts = (one for one in self.places.values() if one.near.ids < near.ids and effect in one.fits and not one.far)
        return max(parts, key=lambda place: (len(place.near.ids), place.near.value), default=None)

    def _begun(self, near: Rated, one: Candidate, starts: Starts, far: bool) -> list[Rated]:
        """A few steps of a model with a candidate more, the best first: from where that came to beside a part of the
        model, or else from each of the candidate's starts."""
        problem, found, channel = self.problem, near.fit, self.problem.channel
        structure = found.structure.adding(one.effect)
        part = self._beside_part(near, one.effect.id)
        if part is not None:
            there = part.fits[one.effect.id][0].fit
            values = {p.name: there.choice[f"{one.effect.id}.{p.name}"] for p in one.effect.parameters}
            rates = found.log_rates + there.log_rates - part.near.fit.log_rates
            theta = Model(channel, structure).start(rates, found.choice | by_name(one.effect, values))
            return [self.fitted(structure, theta, found.deviations, QUICK_STEPS)]
        model, anew = Model(channel, structure), begun_anew(problem, found)
        begins = []
        for start in starts:
            choice = found.choice | by_name(one.effect, start)
            rates = found.log_rates + rate_shift(one.effect, channel)
            begins.append((rates, choice, anew if far else found.deviations))
        lags = one.form is not None and one.form.behaves_as == "lag_in_series"
        if one.effect.start.own_rates or (far and lags):  # the body may be faster than it was taken to be alone
            own = [choice for _, choice, _ in begins[: None if far else 1]]
            begins += [(rough_rates(problem, structure, anew, choice), choice, anew) for choice in own]
        if not far:  # what it does may hide in the runs' own deviations
            begins.append((begins[0][0], begins[0][1], anew))
        own_rates = one.effect.start.own_rates or one.effect.start.rate_factor is not None
        if own_rates and not channel.conditions.start_known.all():
            point = rough_point(problem, structure, begins[0][1])
            begins.append((point.theta[: channel.rates], begins[0][1], point.deviations))
        tried = [self.fitted(structure, model.start(r, choice), own, QUICK_STEPS) for r, choice, own in begins]
        return sorted(tried, key=lambda r: -r.value)

    def _further(self, one: Rated, steps: int = MOST_STEPS) -> Rated:
        if one.fit.converged:
            return one
        self.fits += 1
        return self.rated(go_on(self.problem, one.fit, steps))

    def finished(self, one: Rated) -> Rated:
        """A model fitted to its end: from its own deviations, and as `refit` does from none and over ridges."""
        ends = [self._further(one)]
        self.fits += 2
        ends.append(self.rated(refit(self.problem, one.fit.structure, ends[0].fit)))
        return min(ends, key=lambda r: r.fit.deviance)

    def forward(self, near: Rated, among: Sequence[Candidate], barred: frozenset[str] = frozenset()) -> Rated | None:
        """The best sound model with one candidate more, whether or not it is better than `near`; None without any, or
        where the search is at its end."""
        if any(one.form is not None for one in among) and not self.ended:
            among = (*among, *self.groups(near))
        open_to = [c for c in among if c.effect.id not in barred and c.fits(near.fit.structure)]
        key = (near.ids, frozenset(c.effect.id for c in open_to))
        if key in self.done or self.ended or not open_to:
            return self.done.get(key)
        place = self.beside(near)
        far, entered = place.far, self._entered(self.screened(near, open_to), place.far)
        for one, starts in entered:
            if one.effect.id not in place.fits:
                place.fits[one.effect.id] = self._begun(near, one, starts, far)
        runners = [one.effect.id for one, _ in entered]
        for left in range(3 if far else 2, 0, -1):
            runners = place.ordered(runners)[: RUNNING_COUNT + 2 * (left - 1)]
            for effect in runners:
                further = [self._further(begun, FURTHER_STEPS) for begun in place.fits[effect][:left]]
                place.fits[effect] = sorted(further, key=lambda r: -r.value)
        runners = place.ordered(runners)
        for effect in runners[:FINISHED_COUNT]:
            if effect not in place.ended:
                place.fits[effect] = [self.finished(place.fits[effect][0])]
                place.ended.add(effect)
        firsts = [place.fits[effect][0] for effect in runners]
        ends = [one for one, effect in zip(firsts, runners, strict=True) if effect in place.ended or one.fit.converged]
        ends = [kept for end in ends if (kept := self._sound_part(near, end)) is not None]
        self.done[key] = max(ends, key=lambda r: r.value) if ends else None
        return self.done[key]

    def _sound_part(self, near: Rated, one: Rated) -> Rated | None:
        """A model as it is kept, if it is sound; where what it gains leaves nothing to an effect that was there before,
        without that one."""
        if self.is_sound(one):
            return self.keep(one)
        idle = [id_ for id_ in sorted(near.ids - self.fixed) if not sound(one.fit, {id_})]
        if one.value <= near.value or len(idle) != 1:
            return None
        less = self.without(one, idle[0])
        return less if self.is_sound(less) else None

    def with_one(self, near: Rated, among: Sequence[Candidate]) -> Rated:
        """The better of a model and the best sound one with a candidate more."""
        found = self.forward(near, among)
        return near if found is None else max(near, found, key=value_of)

    def without(self, current: Rated, effect: str) -> Rated:
        """A model with one of its effects taken away."""
        structure = current.fit.structure.dropping(effect)
        known = self.pool.get(frozenset(structure.ids))
        if known is not None:
            return known
        self.fits += 2
        return self.keep(self.rated(refit(self.problem, structure, current.fit)))

    def pruned(self, current: Rated) -> Rated:
        """A model without what, beside the rest, gains nothing on unseen runs."""
        while len(current.ids - self.fixed) > 1:
            less = max((self.without(current, e) for e in sorted(current.ids - self.fixed)), key=lambda r: r.value)
            if less.value <= current.value:
                break
            current = less
        return current

    def grown(self, current: Rated, among: Sequence[Candidate]) -> Rated:
        """A model with all that gains on unseen runs, one after another."""
        while (found := self.forward(current, among)) is not None and found.value > current.value:
            current = self.pruned(found)
        return current

    def exchanged(self, current: Rated, among: Sequence[Candidate]) -> Rated:
        """A model with each of its effects tried against the others in its place, until none is better there."""
        done: set[frozenset[str]] = set()
        while current.ids not in done:
            done.add(current.ids)
            best, own = current, sorted(current.ids - self.fixed)
            # Two that each do half of it may stand in the place of one.
            for size in (1, 2):
                for gone in itertools.combinations(own, size) if best is current else ():
                    other = self.forward(reduce(self.without, gone, current), among, frozenset(gone))
                    best = best if other is None else max(best, other, key=value_of)
            if best is not current:
                current = self.grown(self.pruned(best), among)
        return current

    def simplest(self, current: Rated) -> Rated:
        """A model with its forms' dependences taken away, or others added, where unseen runs are no worse for it; a
        catalogued effect may differ from run to run by chance."""
        channel = self.problem.channel
        for effect in current.fit.structure.effects:
            if effect.id in self.fixed:
                continue
            best = current
            for other in kin_of(effect, channel):
                without = current.fit.structure.dropping(effect.id)
                if not other.fits(without):
                    continue
                self.priors[other.effect.id] = other.log_prior
                structure = without.adding(other.effect)
                if frozenset(structure.ids) in self.pool:
                    trial = self.pool[frozenset(structure.ids)]
                else:
                    theta = _carried(current.fit, structure, effect, other)
                    trial = self.fitted(structure, theta, current.fit.deviations)
                    if not self.is_sound(trial):
                        continue
                    trial = self.keep(trial)
                best = max(best, trial, key=value_of)
            current = best
        return current

    @property
    def ended(self) -> bool:
        """Whether no further step may begin."""
        return self.fits >= MOST_FITS

    def weighed(self, plain: Rated) -> Search:
        """The pool weighed by its models' predictive densities."""
        fitted = [one for one in self.pool.values() if not stuck(one, self.pool.values())]
        among = [one for one in fitted if one.ids == plain.ids or self.is_sound(one)]
        pool, weight = heaviest_first(among)
        known = {one.ids for one in among}
        unsound = (one for one in self.unsound.values() if one.ids not in known and not stuck(one, fitted))
        predictors, _ = heaviest_first([*among, *unsound])
        likeliest = next(one for one in predictors if one.ids == plain.ids or not self._within_the_bench(one))
        return stated(Search(plain, pool[0], pool, weight, self.fits, predictors, likeliest, self.ended))

    def _within_the_bench(self, one: Rated) -> bool:
        """Whether an effect of a model does no more than airs, triggers or references may be off by."""
        return any(refused(one.fit, effect) for effect in one.fit.structure.effects if effect.id not in self.fixed)


def _carried(found: Fit, structure: Structure, effect: Effect, other: Candidate) -> Array:
    """theta of a structure with another form in the place of one: its values where both have any."""
    own = {p.name: found.choice[f"{effect.id}.{p.name}"] for p in effect.parameters}
    if other.form is not None and not is_described(effect.id):
        (names,) = (
            names for law, names in forms_of(effect.id, other.form.driver) if law.behaves_as == other.form.behaves_as
        )
        own = {name: own[of] for of, name in names.items()}
    begin = {
        p.name: own.get(p.name, other.starts[0][p.name] if p.none is None else p.none) for p in other.effect.parameters
    }
    return Model(found.model.channel, structure).start(found.log_rates, found.choice | by_name(other.effect, begin))
