"""The search: all candidates in one race, judged by how well they predict runs that they were not fitted to.

A model grows by the candidate that gains most on unseen runs beyond what is held against it before any data; what then
gains no longer is taken away, and each effect is tried against the others in its place. All sound models stand in one
pool, and the weights of that pool are all that a diagnosis rests on.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, reduce

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnose.candidates import (
    Candidate,
    bare_forms,
    by_chance_of,
    candidates,
    in_group_of,
    kin_of,
    sound,
)
from shockrig.analysis.diagnose.grammar import splits
from shockrig.analysis.diagnose.refitting import begun_anew, plain_fit, rate_shift, refit
from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import is_described
from shockrig.analysis.effects.forms import (
    ONLY_BEFORE,
    ONLY_FROM,
    STEP,
    form_of,
    forms_of,
    laws_of,
)
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import Effect, by_name
from shockrig.analysis.estimate.fit import MOST_STEPS, Fit, fit, go_on
from shockrig.analysis.estimate.fit_starts import plainly_wrong, rough_point, rough_rates
from shockrig.analysis.estimate.model import PLAIN, Model, Point, Structure
from shockrig.analysis.estimate.predictive import DISCREPANCIES, Score, bumps, score, weights
from shockrig.analysis.estimate.problem import RATE_SCATTER, Problem
from shockrig.analysis.estimate.quantity import RunEffect

Array = NDArray[np.float64]
Starts = Sequence[Mapping[str, float]]
Screened = tuple[Candidate, Starts, float]  # with what the best start promises [nats]
Earlier = Mapping[str, Mapping[str, float]]  # effects that an earlier search of the same runs ended with: parameters

# How many candidates are begun, go on, and are fitted to their ends at each step: what a campaign may cost.
BEGUN_COUNT, RUNNING_COUNT, FINISHED_COUNT = 12, 5, 2
STARTS_EACH = 2  # of a candidate, the best to first order
QUICK_STEPS, FURTHER_STEPS = 3, 5  # steps of Gauss and Newton, before a fit to its end
LEAST_VARIANCE = 1e-9  # of the score of a column that may say something
FAR_DISCREPANCY = 0.005  # discrepancy, as a share of the step, from which the runs' deviations mean little
WITHIN_REACH = 3.0  # nats that a candidate's promise to first order may lack and that its fit may bring
MOST_FITS = 600
SIMPLE = frozenset(effect.id for effect in CATALOGUE.values() if effect.candidacy.simple)


@dataclass(frozen=True)
class Rated:
    """A fitted model with its score on unseen runs, and the log prior of its effects [nats]."""

    fit: Fit
    score: Score
    log_prior: float

    @property
    def ids(self) -> frozenset[str]:
        """Of its effects."""
        return frozenset(self.fit.structure.ids)

    @property
    def laws(self) -> frozenset[str]:
        """Of its effects: at which run a change begins does not make another law."""
        return frozenset(law_of(id_) for id_ in self.fit.structure.ids)

    @property
    def dependences(self) -> int:
        """How many conditions the strengths of its forms depend on, more time constants than one among them."""
        return sum(len(form_of(id_).more) for id_ in self.ids if is_described(id_))

    def holds(self, effect: str) -> bool:
        """Whether it has an effect, or a form that is its law with a strength that depends on something more."""
        return any(law_of(effect) in _laws_within(id_) for id_ in self.ids)

    @property
    def value(self) -> float:
        """Log predictive density and log prior [nats]."""
        return self.score.total + self.log_prior


def law_of(effect: str) -> str:
    """An effect's id without the run at which a change begins."""
    return re.sub(rf"({STEP}|{ONLY_BEFORE})\d+", r"\1n", effect)


@cache
def _laws_within(effect: str) -> frozenset[str]:
    """An effect's law, and those that a form is with a strength that depends on something more, or with more time
    constants."""
    if not is_described(effect):
        return frozenset({effect})
    form = form_of(effect)
    found: set[str] = set()
    for size in range(len(form.more) + 1):
        for without in itertools.combinations(form.more, size):
            less = replace(form, depends_on=tuple(on for on in form.depends_on if on not in without))
            found |= {law_of(less.key), *(name for name, _ in laws_of(less))}
    return frozenset(found)


@dataclass(frozen=True)
class Search:
    """Outcome of a search.

    Attributes
    ----------
    plain, best : Rated
        The model that it began from, and the heaviest of as many effects as are there with some certainty.
    pool : tuple of Rated
        All models that were weighed, the heaviest first.
    weights : ndarray (M,)
    fits : int
        How many fits it took.
    predictors : tuple of (Rated, float)
        Models with their weights where those count as well whose effects say nothing where they ended: no name follows
        from such a model, a prediction may. The heaviest first.
    """

    plain: Rated
    best: Rated
    pool: tuple[Rated, ...]
    weights: Array
    fits: int
    predictors: tuple[tuple[Rated, float], ...]

    @property
    def ended_early(self) -> bool:
        """Whether it made as many fits as it may, so that more may be there."""
        return self.fits >= MOST_FITS

    def probability(self, effect: str) -> float:
        """Of an effect's being there: the weight of all models that hold its law, however that may depend on things."""
        held = (w for one, w in zip(self.pool, self.weights, strict=True) if one.holds(effect))
        return float(min(sum(held), 1.0))

    def may_state(self, one: Rated) -> bool:
        """Whether a model is one of the pool; others may predict."""
        return any(other is one for other in self.pool)

    def weight(self, one: Rated) -> float:
        """Of one model."""
        return float(sum(w for other, w in zip(self.pool, self.weights, strict=True) if other is one))

    def instead(self, effect: str) -> list[tuple[Rated, float]]:
        """The models without an effect of the best one that are as large, by what stands in its place, with how many
        nats they are behind (the closest first)."""
        found = []
        for one in self.pool:
            new = one.laws - self.best.laws
            if not one.holds(effect) and new and len(self.best.laws - one.laws) <= len(new):
                found.append((one, self.best.value - one.value))
        return sorted(found, key=lambda item: item[1])

    def rivals(self) -> list[Rated]:
        """Models tied with the best one that hold something else in the place of something that it has."""
        own = self.best.laws
        return [one for one in self.tied() if one.laws - own and own - one.laws]

    def without_best(self) -> Search:
        """The search where the best model is out: the others, weighed anew."""
        pool, weight = _heaviest_first(one for one in self.pool if one is not self.best)
        return _stated(replace(self, pool=pool, weights=weight))

    def tied(self) -> list[Rated]:
        """Models whose weight is not small beside the best one's, the best first."""
        least = level("tie") * self.weight(self.best)
        return [one for one, w in zip(self.pool, self.weights, strict=True) if w >= least]


@dataclass(frozen=True)
class BesideModel:
    """What is known of candidates beside one model, by effect: the same whatever else is tried there.

    `promised` is what each promises to first order, `groups` are forms in the group of runs in which they promise most;
    `fits` are their fits so far, the best first; `ended` are those whose best has been fitted to its end.
    """

    near: Rated
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
        self.problem, self.base, self.fixed = problem, base, frozenset(base.ids)
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
        """The best fit so far of a model, which goes into the pool."""
        return _kept(self.pool, one)

    def is_sound(self, one: Rated) -> bool:
        """Whether a model's effects say something where it ended; one whose do not is kept for predictions."""
        if sound(one.fit, one.ids - self.fixed):
            return True
        _kept(self.unsound, one)
        return False

    def beside(self, near: Rated) -> BesideModel:
        """What is known so far of candidates beside a model."""
        return self.places.setdefault(id(near.fit), BesideModel(near))

    def screened(self, near: Rated, among: Sequence[Candidate]) -> list[Screened]:
        """Candidates with their starts and what the best of these promises to first order [nats], best first."""
        promised = self.beside(near).promised
        new = [one for one in among if one.effect.id not in promised]
        promised |= {found[0].effect.id: found for found in (self._promises(near, new) if new else ())}
        return sorted((promised[one.effect.id] for one in among), key=lambda item: -(item[2] + item[0].log_prior))

    def _columns(self, near: Rated, one: Candidate, starts: Starts) -> Array:
        """What a candidate changes at each of some starts, whitened (R, n, C)."""
        found, channel = near.fit, self.problem.channel
        model = Model(channel, found.structure.adding(one.effect))
        rates = found.log_rates + rate_shift(one.effect, channel)
        thetas = []
        for start in starts:
            theta = model.start(rates, found.choice | by_name(one.effect, start))
            theta[model.behind] = found.theta[found.model.behind]
            thetas.append(theta)
        predicted = model.predict(Point(np.stack(thetas), found.deviations)) - found.at.prediction
        return self.problem.whiten(np.moveaxis(predicted, 0, -1))

    def _promises(self, near: Rated, among: Sequence[Candidate]) -> list[Screened]:
        columns = [self._columns(near, one, (*one.starts, *one.weakest)) for one in among]
        right, size = self._first_order(near, np.concatenate(columns, axis=-1))
        most = np.concatenate([np.full(c.shape[-1], one.furthest) for one, c in zip(among, columns, strict=True)])
        gains = _promised(right, size, most)
        out: list[Screened] = []
        for one, own in zip(among, np.split(gains, np.cumsum([c.shape[-1] for c in columns])[:-1]), strict=True):
            best = np.maximum(own[: len(one.starts)], own[len(one.starts) :].max(initial=0.0))
            order = np.argsort(-own[: len(one.starts)], kind="stable")
            out.append((one, [one.starts[i] for i in order], float(best.max())))
        return out

    def groups(self, near: Rated) -> list[Candidate]:
        """Each bare form in that group of runs, before one or from it on, in which it promises most."""
        place = self.beside(near)
        if not place.groups:
            found = (self._in_group(near, one) for one in self.bare)
            place.groups.extend(one for one in found if one is not None)
            self.priors |= {one.effect.id: one.log_prior for one in place.groups}
        return place.groups

    def _in_group(self, near: Rated, one: Candidate) -> Candidate | None:
        """A bare form in that group of runs in which it promises most; None where no other runs tell as much of it as
        one of all runs does: what it does in them would be anything."""
        hows, sides = _sides(self.problem.channel)
        right, size = self._first_order(near, self._columns(near, one, one.starts), sides)
        tells = size.sum(axis=1)
        others = np.roll(tells, len(hows) // 2)  # of the runs that are not in a group
        told = np.minimum(tells, others) * self.problem.channel.runs > tells + others
        promised = np.where(told, _promised(right, size, one.furthest).max(axis=1), -np.inf)
        side = int(np.argmax(promised))
        return in_group_of(one, hows[side], self.problem.channel) if promised[side] > -np.inf else None

    def _first_order(self, near: Rated, columns: Array, groups: Array | None = None) -> tuple[Array, Array]:
        """Scores of columns and their variances, beside the model's parameters, discrepancy and random effects; with
        groups (K, R) those of each column in each group of runs alone."""
        # A candidate may end what the model so far is wrong by: that is not to hide what it promises.
        # Nor is how much runs differ in their rates, where that is more than sensors usually do.
        found, sigma = near.fit, np.clip(near.score.discrepancy, DISCREPANCIES[1], FAR_DISCREPANCY)
        own = found.arrow.weight.copy()
        own[:, RunEffect.RATE] = np.maximum(own[:, RunEffect.RATE], 1.0 / RATE_SCATTER**2)
        discrepancy = np.full((self.bump.shape[0], self.bump.shape[-1]), 1.0 / sigma**2)
        beside = replace(
            found.arrow,
            run_jacobian=np.concatenate([found.arrow.run_jacobian, self.bump], axis=-1),
            weight=np.concatenate([own, discrepancy], axis=-1),
        )
        return found.score_variances(self.problem, columns, beside, groups)

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

    def _begun(self, near: Rated, one: Candidate, starts: Starts, far: bool) -> list[Rated]:
        """A few steps of a model with a candidate more, from each of its starts, the best first."""
        problem, found, channel = self.problem, near.fit, self.problem.channel
        structure = found.structure.adding(one.effect)
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
        far = near.score.discrepancy > FAR_DISCREPANCY or plainly_wrong(self.problem, near.fit)
        entered, place = self._entered(self.screened(near, open_to), far), self.beside(near)
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
        return near if found is None else max(near, found, key=_value)

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
                    best = best if other is None else max(best, other, key=_value)
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
            described, best = is_described(effect.id), current
            for other in kin_of(form_of(effect.id), channel) if described else by_chance_of(effect, channel):
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
                best = max(best, trial, key=_value)
            current = best
        return current

    @property
    def ended(self) -> bool:
        """Whether no further step may begin."""
        return self.fits >= MOST_FITS


def _sides(channel: Channel) -> tuple[list[str], Array]:
    """The groups of runs, from each run on and before it, as a dependence says them, and 1 for their runs (K, R)."""
    firsts = splits(channel)
    late = channel.conditions.order >= np.array(firsts)[:, None]
    hows = [f"{only}{first}" for only in (ONLY_FROM, ONLY_BEFORE) for first in firsts]
    return hows, np.concatenate([late, ~late]).astype(float)


def _promised(right: Array, size: Array, furthest: Array | float) -> Array:
    """What columns promise [nats] by their scores and variances, each taken no more than so many times."""
    times = np.clip(right / np.maximum(size, LEAST_VARIANCE), -furthest, furthest)
    return np.asarray(np.where(size > LEAST_VARIANCE, times * right - 0.5 * times**2 * size, 0.0))


def first_look(problem: Problem, base: Structure = PLAIN) -> Fit:
    """The plain model with the one effect of the catalogue that gains most, if one does: about what a channel does."""
    entries = [one for one in candidates(problem.channel) if one.form is None]
    race = Race(problem, base, entries)
    plain = race.keep(race.rated(plain_fit(problem, base)))
    found = race.forward(plain, entries)
    return (plain if found is None else max(plain, found, key=_value)).fit


def search(
    problem: Problem, base: Structure = PLAIN, earlier: Earlier | None = None, describing: bool = True
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
    """
    among = [one for one in candidates(problem.channel) if describing or one.form is None]
    race = Race(problem, base, among)
    plain = race.keep(race.rated(plain_fit(problem, base)))
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
        named = max(named, _from_runner_up(race, named, entries), key=_value)
    named = max(named, resumed, key=_value)
    best = law if whole and law.value > named.value else max(law, race.with_one(named, forms), key=_value)
    if best.value <= named.value or best.score.discrepancy > FAR_DISCREPANCY:
        named = race.exchanged(race.grown(named, entries), entries)
        best = max(best, race.with_one(named, forms), key=_value)
    if best.value > named.value:
        grown = race.grown(race.pruned(race.simplest(best)), among)
        race.exchanged(race.simplest(grown), among)
    else:
        race.simplest(named)
        for effect in sorted(named.ids - race.fixed):
            race.forward(race.without(named, effect), forms)
    return _weighed(race, plain)


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
    return race.grown(max(begins, key=_value), entries) if begins and named.ids > race.fixed else named


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


def _value(one: Rated) -> float:
    return one.value


def _kept(models: dict[frozenset[str], Rated], one: Rated) -> Rated:
    """The best fit so far of a model among some."""
    known = models.get(one.ids)
    if known is None or one.fit.deviance < known.fit.deviance:
        models[one.ids] = one
    return models[one.ids]


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
    return max(plain, race.pruned(race.keep(race.finished(begun))), key=_value)


def _heaviest_first(among: Iterable[Rated]) -> tuple[tuple[Rated, ...], Array]:
    """The best of some models with their weights by their predictive densities."""
    best = sorted(among, key=lambda r: -r.value)
    weight = weights([one.score.runs for one in best], [one.log_prior for one in best])
    order = sorted(range(len(best)), key=lambda i: (-weight[i], -best[i].value))
    return tuple(best[i] for i in order), weight[order]


def _stuck(one: Rated, among: Iterable[Rated]) -> bool:
    """Whether a fit leaves more of the runs than a model that it extends, which is a part of it: it ended elsewhere."""
    # A value that leaves the model as it was is in the range of an effect that says so, and of a lag at its weakest.
    nested = {
        e.id
        for e in one.fit.structure.effects
        if any(p.none is not None or p.weakest is not None for p in e.parameters)
    }
    parts = (other for other in among if other.ids < one.ids and one.ids - other.ids <= nested)
    return any(part.fit.deviance < one.fit.deviance for part in parts)


def _weighed(race: Race, plain: Rated) -> Search:
    """The pool weighed by its models' predictive densities."""
    fitted = [one for one in race.pool.values() if not _stuck(one, race.pool.values())]
    among = [one for one in fitted if one.ids == plain.ids or race.is_sound(one)]
    pool, weight = _heaviest_first(among)
    known = {one.ids for one in among}
    unsound = (one for one in race.unsound.values() if one.ids not in known and not _stuck(one, fitted))
    predictors = zip(*_heaviest_first([*among, *unsound]), strict=True)
    return _stated(Search(plain, pool[0], pool, weight, race.fits, tuple((one, float(w)) for one, w in predictors)))


def _stated(found: Search) -> Search:
    """A search with the model that its weights state."""
    # As many effects are stated as are there with that probability, whichever they are: look-alikes that share the
    # weight of one are one effect, tied; weight that is shared for a second one is no evidence for any. Among models
    # with so many, the same holds for what they depend on.
    pool = found.pool
    left = list(range(len(pool)))
    for sizes_of in ([len(one.ids) for one in pool], [one.dependences for one in pool]):
        sizes, own = np.array(sizes_of)[left], found.weights[left]
        enough = level("named") * own.sum()
        most = max(k for k in np.unique(sizes) if own[sizes >= k].sum() >= enough or k == sizes.min())
        left = [i for i, size in zip(left, sizes, strict=True) if size == most]
    return replace(found, best=pool[left[0]])
