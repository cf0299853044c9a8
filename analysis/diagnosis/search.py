"""Stepwise search for the effects that explain a channel: add, take away, and swap, until nothing in the catalogue
helps.

Models are compared by their marginal deviance (each run's deviations integrated out), so that run-to-run scatter
competes with every named cause on equal terms. A gain must pay for its parameters; see `thresholds.penalty`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnosis.refitting import (
    Starts,
    begun_anew,
    drop,
    far_apart,
    finish,
    has_steps,
    mirror,
    plain_fit,
    plainly_wrong,
    race,
    rate_shift,
    refit,
)
from shockrig.analysis.diagnosis.thresholds import TIE, level, penalty
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.effect import Effect, by_name
from shockrig.analysis.inference.fit import Fit, fit, objective_at
from shockrig.analysis.inference.model import PLAIN, Model, Point, Structure
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.rate_scatter import RATE_SCATTER_LIMIT
from shockrig.analysis.inference.scan import rough_rates
from shockrig.analysis.inference.work import cost_of_a_fit

Array = NDArray[np.float64]
Earlier = Mapping[str, Mapping[str, float]]  # effects that an earlier search of the same runs ended with: parameters

MOST_EFFECTS = 6
WORTH_A_FIT = 0.25  # share of its penalty that a candidate must reach to first order
QUICK_STARTS = 2  # of a candidate that are fitted: those that score best to first order
MOST_FITS = 200  # of a search that adds effects: what it has reached by then is judged, the rest called unexplained
IN_ALL = 2  # times as many, until every effect found was held against the others; one that was not is not kept
LEAST_OF_RANGE, SPREAD = 1e-3, 60  # where a rival with steps is looked for: its range, in so many values a side
LESS_SCATTER = 2.0  # of runs' own rates, as a ratio, where an effect has taken the place of these
FINISHED = 3  # candidates that are carried to the end of their fits


@dataclass(frozen=True)
class Move:
    """One step of the search: what was done, and by how much each candidate would have lowered the deviance."""

    kind: str
    effect: str
    gain: float
    candidates: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Standing:
    """How an effect that was found stands among the others.

    Attributes
    ----------
    necessity : float
        How much the deviance rises without it, all else refitted.
    worth : float
        The same as evidence.
    rivals : dict
        {other effect: rise in deviance when it stands in its place} for the close ones.
    instead : dict
        {other effect: the fit with it in its place} for the same.
    """

    necessity: float
    worth: float
    rivals: dict[str, float]
    instead: dict[str, Fit]

    def alike(self, within: float) -> list[str]:
        """Rivals with which the deviance rises by less, the likeliest first."""
        return sorted((e for e, rise in self.rivals.items() if rise < within), key=self.rivals.__getitem__)


@dataclass(frozen=True)
class Search:
    """Outcome of a search: the model that it began from, the one that it ended with, its moves, and how each effect
    found stands.

    `otherwise` is where a search from another start ended, if with other effects; `almost` are the models with one
    effect more that came next, each by its effect.
    """

    plain: Fit
    final: Fit
    moves: tuple[Move, ...]
    standing: dict[str, Standing]
    fits: int = 0
    at_limit: bool = False  # whether it ended because it had made as many fits as it may
    otherwise: Fit | None = None
    almost: Mapping[str, Fit] = field(default_factory=dict)


def evidence(problem: Problem, gain: float) -> float:
    """A drop in deviance as Student's log-likelihood ratio, (nu + 1) ln(1 + gain / nu).

    What limits a weak effect is the scatter of a few dozen runs, known from these runs alone: a drop that would be
    plain against a known scatter counts for less.
    """
    degrees = max(problem.channel.runs - problem.channel.rates, 4)
    return float((degrees + 1) * np.log1p(gain / degrees)) if gain > 0 else float(gain)


def borne_out(problem: Problem, without: Fit, found: Fit) -> float:
    """Evidence for what `found` has and `without` lacks.

    Where rates that runs have of their own had taken its place, and no longer do, the drop in deviance is already the
    logarithm of how much less runs scatter: Student's t of that ratio, with a degree less, and not again of the drop.
    """
    gain, channel = without.deviance - found.deviance, problem.channel
    worth = evidence(problem, gain)
    if gain > 0 and without.rate_scatter > max(RATE_SCATTER_LIMIT, LESS_SCATTER * found.rate_scatter):
        left = max(channel.runs - channel.rates - 1, 1)
        worth = max(worth, gain * left / (left + 1))
    return worth


def candidates_of(channel: Channel) -> tuple[Effect, ...]:
    """Effects of the mean response that this campaign can show in this channel."""
    return tuple(e for e in CATALOGUE.values() if e.fitted and e.acts_in(channel))


def at_bound(effect: Effect, values: Mapping[str, float]) -> tuple[str, ...]:
    """Parameters of an effect that stand at a bound of their range."""
    out = []
    for parameter in effect.parameters:
        value = values[parameter.name]
        width = 1e-3 * (parameter.high - parameter.low)
        above = 1e-6 if parameter.log else min(width, 0.1 * abs(parameter.low) or width)
        if value <= parameter.low + above or value >= parameter.high - width:
            out.append(parameter.name)
    return tuple(out)


def says_nothing(effect: Effect, parameters: Mapping[str, tuple[float, float]]) -> str:
    """Why a fitted effect says nothing: at the end of its range, or anywhere in it. Empty where it says something."""
    ends = at_bound(effect, {name: value for name, (value, _) in parameters.items()})
    if ends:
        return f"its {ends[0]} stands at the end of its range"
    for parameter in effect.parameters:
        value, spread = parameters[parameter.name]
        if parameter.log and spread > level("anything") * abs(value):
            return f"its {parameter.name} may be anything"
    return ""


def refused(found: Fit, effect: Effect) -> bool:
    """Whether an effect of a fit is no finding where it ended, by what its entry says."""
    if effect.refused is None:
        return False
    channel = found.model.channel

    def bare() -> Array:
        model = Model(channel, found.structure.dropping(effect.id))
        theta = model.start(found.log_rates, found.choice)
        theta[model.behind] = found.theta[found.model.behind]
        return np.asarray(model.predict(Point(theta, channel.at_rest()))[0])

    values = {name: value for name, (value, _) in found.values()[effect.id].items()}
    return effect.refused(channel, values, bare)


def _open_to(structure: Structure, effect: Effect) -> bool:
    """Whether an effect may be added to a model."""
    taken = set(structure.ids)
    return effect.id not in taken and not effect.excludes & taken and (not effect.beside or bool(effect.beside & taken))


def _anywhere(effect: Effect) -> list[dict[str, float]]:
    """Values all over the range of an effect of one parameter, equally far apart in ratio on either side of nothing."""
    if len(effect.parameters) != 1:
        return []
    (parameter,) = effect.parameters
    most = max(abs(parameter.low), abs(parameter.high))
    sizes = np.geomspace(LEAST_OF_RANGE * most, most, SPREAD)
    values = [x for x in (*-sizes, *sizes) if parameter.low < x < parameter.high]
    return [{parameter.name: float(x)} for x in values]


class Stepwise:
    """A search under way: its problem, what may be added, and the moves so far."""

    def __init__(self, problem: Problem, base: Structure, candidates: Sequence[Effect], most_fits: float = np.inf):
        self.problem, self.base = problem, frozenset(base.ids)
        self.candidates = tuple(candidates)
        self.moves: list[Move] = []
        self.fits = 0  # about: a start, a fit carried on and a fit from other deviations count as one each
        self.most_fits = most_fits
        self.almost: dict[str, Fit] = {}  # where nothing was added: the trials that were carried to their ends
        self._drops: tuple[Fit | None, dict[str, Fit]] = (None, {})

    def worth(self, without: Fit, found: Fit, effect: str) -> float:
        """By how much the evidence for an effect is more than its penalty."""
        return borne_out(self.problem, without, found) - penalty(CATALOGUE[effect], self.problem.channel)

    def added(self, current: Fit) -> list[str]:
        """Effects of a model that the search itself has added."""
        return [e for e in current.structure.ids if e not in self.base]

    def promising(self, current: Fit, keep: int) -> dict[str, Starts]:
        """The candidates that, to first order, lower the objective most, with their best starts: one prediction each.

        Each is added at its weakest start; what the model's own parameters and the runs' deviations could do is taken
        out.
        """
        channel, base = self.problem.channel, current.model.predict(current.point)[0]
        columns, owners = [], []
        for effect in self.candidates:
            if not _open_to(current.structure, effect):
                continue
            model = Model(channel, current.structure.adding(effect))
            rates = current.log_rates + rate_shift(effect, channel)
            for start in effect.starts(channel):
                weak = {k: v if (w := effect.parameter(k).weakest) is None else w for k, v in start.items()}
                theta = model.start(rates, current.choice | by_name(effect, weak))
                theta[model.behind] = current.theta[current.model.behind]
                columns.append(model.predict(Point(theta, current.deviations))[0] - base)
                owners.append((effect, start))
        if not columns:
            return {}
        right, normal = current.scores(self.problem, self.problem.whiten(np.stack(columns, axis=-1)))
        size = np.diag(normal)
        gain = np.where(size > 1e-12, right**2 / np.maximum(size, 1e-12), 0.0)
        scored: dict[str, list[tuple[float, Mapping[str, float]]]] = {}
        for (effect, start), value in zip(owners, gain, strict=True):
            scored.setdefault(effect.id, []).append((float(value), start))
        reached = {e: max(value for value, _ in values) for e, values in scored.items()}
        ranked = sorted(scored, key=lambda e: -reached[e])
        # A start taken from the data may already be the whole answer, whatever its first order says; and another body
        # is no small change.
        always = [
            e
            for e in ranked
            if CATALOGUE[e].always_tried
            or (CATALOGUE[e].rate_factor and not CATALOGUE[e].rarity(channel))
            or ((told := CATALOGUE[e].start_from) is not None and told(channel))
        ]
        worth = [e for e in ranked if reached[e] > WORTH_A_FIT * penalty(CATALOGUE[e], channel)]
        # The score of another body says little: where bodies are known it takes no other candidate's place.
        bodies = [e for e in worth if CATALOGUE[e].rate_factor] if plainly_wrong(self.problem, current) else []
        small = [e for e in worth if not CATALOGUE[e].rate_factor]
        chosen = dict.fromkeys([*small[:keep], *bodies[:QUICK_STARTS], *always])
        return {e: self._best_starts(CATALOGUE[e], scored[e]) for e in chosen}

    @staticmethod
    def _best_starts(effect: Effect, scored: list[tuple[float, Mapping[str, float]]]) -> Starts:
        if far_apart(effect):
            return [start for _, start in scored]  # scored at one value: the scores do not tell the starts apart
        return [start for _, start in sorted(scored, key=lambda s: -s[0])[:QUICK_STARTS]]

    def trials(self, current: Fit, promising: Mapping[str, Starts]) -> dict[str, Fit]:
        """The current model with each other effect added; fits at a bound, or refused by the effect, are left out."""
        self.fits += sum(len(starts) for starts in promising.values())
        found = {}
        for id_, trial in race(self.problem, current, promising).items():
            trial, effect = mirror(self.problem, trial) or trial, CATALOGUE[id_]
            if effect.nudges and says_nothing(effect, trial.values()[id_]):
                trial = finish(self.problem, trial)  # it may lie on the other side of a ridge
            # A parameter at its bound, or that may be anything, is no finding.
            if self._says_something(trial, id_):
                found[id_] = trial
        return found

    @staticmethod
    def _says_something(trial: Fit, effect: str) -> bool:
        """Whether an effect of a fit is a finding where it ended."""
        return not says_nothing(CATALOGUE[effect], trial.values()[effect]) and not refused(trial, CATALOGUE[effect])

    def forward(self, current: Fit, keep: int) -> tuple[Fit, bool]:
        """With the best candidate, if one is worth its penalty."""
        promising = self.promising(current, keep)
        trials, self.almost = self.trials(current, promising), {}
        if not trials:
            return current, False
        for effect in self._ahead(trials):
            trials[effect] = finish(self.problem, trials[effect])
        self.fits += FINISHED + 1
        # What a better start alone gains is not the candidate's: the current model is fitted again from where it led.
        ahead = min(trials.values(), key=lambda f: f.deviance)
        own = ahead.choice
        theta = current.model.start(ahead.log_rates, {name: own[name] for name in current.structure.names})
        again = fit(self.problem, current.structure, theta, ahead.deviations, iterations=30)
        if again.deviance < current.deviance - 1.0:
            # A better start is worth as much to the candidates.
            current = again
            anew = race(self.problem, current, {e: promising[e] for e in self._ahead(trials)})
            self.fits += FINISHED * QUICK_STARTS
            trials |= {e: min((trials[e], f), key=lambda f: f.deviance) for e, f in anew.items()}
        best, gains = self._likeliest(current, trials)
        if self.worth(current, trials[best], best) <= 0:
            # An effect can hide in the runs' own deviations: before the end, the nearest are fitted from none as well.
            for effect in self._ahead(trials):
                if gains[effect] > WORTH_A_FIT * penalty(CATALOGUE[effect], self.problem.channel):
                    self.fits += 2
                    fresh = refit(self.problem, trials[effect].structure, trials[effect])
                    trials[effect] = min((trials[effect], fresh), key=lambda f: f.deviance)
            best, gains = self._likeliest(current, trials)
        ranked = tuple(sorted(gains.items(), key=lambda item: -item[1]))
        if self.worth(current, trials[best], best) > 0:
            self.moves.append(Move("add", best, gains[best], ranked))
            # An effect can hide in the runs' own deviations: the one that is taken is fitted from none as well.
            self.fits += 2
            taken = refit(self.problem, trials[best].structure, trials[best])
            self._drops = (taken, {best: current})
            return taken, True
        self.moves.append(Move("stop", "", 0.0, ranked))
        self.almost = {effect: trials[effect] for effect in self._ahead(trials)}
        return current, False

    def _likeliest(self, current: Fit, trials: Mapping[str, Fit]) -> tuple[str, dict[str, float]]:
        """The candidate that does best, and by how much each lowers the deviance."""
        gains = {e: current.deviance - f.deviance for e, f in trials.items()}
        # Large drops are all worth nearly the same by Student: candidates are judged by what is between them.
        most, channel = max(gains.values()), self.problem.channel
        best = min(gains, key=lambda e: evidence(self.problem, most - gains[e]) + penalty(CATALOGUE[e], channel))
        return best, gains

    @staticmethod
    def _ahead(trials: Mapping[str, Fit]) -> list[str]:
        return sorted(trials, key=lambda e: trials[e].deviance)[:FINISHED]

    def dropped(self, current: Fit, effect: str) -> Fit:
        """The current model without one of its effects, fitted once."""
        if self._drops[0] is not current:
            self._drops = (current, {})
        known = self._drops[1]
        if effect not in known:
            self.fits += 2
            known[effect] = drop(self.problem, current, effect)
        return known[effect]

    def resumed(self, plain: Fit, earlier: Earlier) -> Fit:
        """The plain model with the effects that an earlier search ended with, as far as they earn their place."""
        structure, choice = plain.structure, dict[str, float]()
        for effect in self.candidates:
            values = earlier.get(effect.id)
            if values is None or effect.id in structure.ids or effect.excludes & set(structure.ids):
                continue
            structure = structure.adding(effect)
            known = [p for p in effect.parameters if p.name in values]
            choice |= by_name(effect, {p.name: float(np.clip(values[p.name], p.low, p.high)) for p in known})
        if structure.ids == plain.structure.ids:
            return plain
        rates = rough_rates(self.problem, structure, begun_anew(self.problem, plain), choice)
        theta = Model(self.problem.channel, structure).start(rates, choice)
        current = self.backward(fit(self.problem, structure, theta, begun_anew(self.problem, plain), iterations=30))
        added = self.added(current)
        if len(added) == 1 and self.worth(plain, current, added[0]) <= 0:
            return plain
        self.moves.append(Move("resume", ", ".join(added), plain.deviance - current.deviance, ()))
        return current

    def backward(self, current: Fit) -> Fit:
        """Without the effects that, now that others are there, no longer earn their place."""
        while True:
            removable = self.added(current)
            if len(removable) < 2:
                return current
            trials = {e: self.dropped(current, e) for e in removable}
            excess = {e: self.worth(f, current, e) for e, f in trials.items()}
            worst = min(excess, key=excess.__getitem__)
            if excess[worst] > 0:
                return current
            self.moves.append(Move("remove", worst, current.deviance - trials[worst].deviance, ()))
            current = trials[worst]

    def _in_place(self, current: Fit, without: Fit, other: Effect) -> Fit:
        """`other` in the place of an effect of `current`, fitted from its rates and from the value that leaves least at
        its deviations: from these, and where starts were marked from none, since an effect can hide in them."""
        structure = without.structure.adding(other)
        model, problem = Model(self.problem.channel, structure), self.problem
        kept = {name: value for name, value in current.choice.items() if name in without.structure.names}
        begun = []
        for start in [*other.starts(problem.channel), *_anywhere(other)]:
            theta = model.start(current.log_rates, kept | by_name(other, start))
            begun.append((objective_at(problem, model, Point(theta, current.deviations)), theta))
        _, theta = min(begun, key=lambda one: one[0])
        begins = [current.deviations]
        if self._transfers_marked:
            begins.append(begun_anew(problem, current))
        self.fits += 1 + len(begins)
        return min((fit(problem, structure, theta, own) for own in begins), key=lambda f: f.deviance)

    @property
    def _transfers_marked(self) -> bool:
        """Whether each run is a transfer that somebody marked."""
        channel = self.problem.channel
        return bool(channel.conditions.start_known.all() and not channel.measured.any())

    def exchange(self, current: Fit, swap: bool = True) -> tuple[Fit, dict[str, Standing], bool]:
        """Each effect found against every other in its place: how it stands, and whether another does better.

        One that the limit leaves no fits for has no standing.
        """
        standing: dict[str, Standing] = {}
        channel = self.problem.channel
        for effect in self.added(current):
            if self.fits >= IN_ALL * self.most_fits:
                break
            without = self.dropped(current, effect)
            necessity = without.deviance - current.deviance
            promising = self.promising(without, 5)
            promising.pop(effect, None)
            others = self.trials(without, {e: s for e, s in promising.items() if e not in current.structure.ids})
            for other in self.candidates:
                # No gradient leads over steps, nor, where starts were marked, from where a model ends that lacks the
                # one found: a rival begins from where that has led as well.
                led = other.nudges or (self._transfers_marked and other.id in others)
                if led and _open_to(without.structure, other) and other.id != effect:
                    begun = self._in_place(current, without, other)
                    if other.id not in others or begun.deviance < others[other.id].deviance:
                        others[other.id] = begun
            for e, f in others.items():
                # Before a step of its objective a rival may be behind by anything.
                stepped = has_steps(self.problem, f.structure)
                if stepped or f.deviance - current.deviance < max(0.1 * necessity, 30.0):
                    others[e] = finish(self.problem, f)
                    self.fits += 1
            rises = {e: f.deviance - current.deviance for e, f in others.items() if self._says_something(f, e)}
            own = CATALOGUE[effect].rarity(channel)
            likely = {e: r + CATALOGUE[e].rarity(channel) - own for e, r in rises.items()}
            rivals = {e: r for e, r in likely.items() if r < max(0.5 * necessity, 2 * TIE)}
            worth = borne_out(self.problem, without, current)
            standing[effect] = Standing(necessity, worth, rivals, {e: others[e] for e in rivals})
            if swap and rises:
                best = min(rises, key=lambda e: rises[e] + penalty(CATALOGUE[e], self.problem.channel))
                better = penalty(CATALOGUE[effect], channel) - penalty(CATALOGUE[best], channel) - rises[best]
                if better > 0.5:
                    self.moves.append(Move("swap", f"{effect} -> {best}", -rises[best], ()))
                    return self.backward(finish(self.problem, others[best])), {}, True
        return current, standing, False


def reconsider(problem: Problem, base: Structure, found: Fit) -> tuple[Fit, dict[str, Fit]]:
    """A model judged again on other runs: without effects that no longer earn their place, with one that does.

    Returns the model, and the fits without each of the effects that `found` has beyond `base`.
    """
    looking = Stepwise(problem, base, candidates_of(problem.channel))
    without = {e: looking.dropped(found, e) for e in looking.added(found)}
    current = found
    if len(without) == 1:  # a search takes no step back from a single effect, a judge does
        ((effect, one_less),) = without.items()
        current = found if looking.worth(one_less, found, effect) > 0 else one_less
    current = looking.backward(current)
    return looking.forward(current, 3)[0], without


def search(
    problem: Problem,
    base: Structure = PLAIN,
    candidates: Sequence[Effect] | None = None,
    thorough: bool = True,
    most: int = MOST_EFFECTS,
    earlier: Earlier | None = None,
) -> Search:
    """Search the catalogue for the effects that explain a channel.

    Parameters
    ----------
    problem : Problem
    base : Structure
        Effects that the readings themselves have shown; they are never taken away.
    candidates : sequence of Effect, optional
        All that can be tested if not given.
    thorough : bool
        Whether each effect found is tried against others in its place, and more candidates are fitted at each step
        than the few that score best to first order: needed for a verdict.
    most : int
        How many effects may be added.
    earlier : {effect: {parameter: value}}, optional
        What an earlier search of the same runs, or of some of them, ended with: this one begins there. Each of its
        effects has to earn its place as any other.
    """
    tried = candidates_of(problem.channel) if candidates is None else candidates
    looking = Stepwise(problem, base, tried, MOST_FITS / cost_of_a_fit(problem, base))
    plain = plain_fit(problem, base)
    current = looking.resumed(plain, earlier or {})
    standing: dict[str, Standing] = {}
    seen: set[frozenset[str]] = set()
    been = {frozenset(current.structure.ids): current.deviance}
    at_limit = False
    while len(looking.added(current)) < most and looking.fits < looking.most_fits:
        before = current
        current, added = looking.forward(current, 7 if thorough else 4)
        if added:
            current = looking.backward(current)
            state = frozenset(current.structure.ids)
            if current.deviance < been.get(state, np.inf) - 1.0:
                been[state] = current.deviance
                continue
            # What was added has been taken away again, and would be for ever.
            current = min((before, current), key=lambda f: penalised(problem, f))
        if not thorough:
            break
        current, standing, swapped = looking.exchange(current)
        state = frozenset(current.structure.ids)
        if not swapped or state in seen:
            break
        seen.add(state)
    else:
        at_limit = len(looking.added(current)) < most
    if thorough and set(standing) != set(looking.added(current)):
        current, standing, _ = looking.exchange(current, swap=False)
        # What was not held against the others cannot be named.
        untried = set(looking.added(current)) - set(standing)
        if untried:
            at_limit = True
            looking.moves.append(Move("stop", ", ".join(sorted(untried)), 0.0, ()))
            structure = current.structure.keeping(set(current.structure.ids) - untried)
            current = plain if structure.ids == base.ids else refit(problem, structure, current)
    almost = {} if at_limit else looking.almost
    return Search(plain, current, tuple(looking.moves), standing, looking.fits, at_limit, almost=almost)


def search_twice(problem: Problem, base: Structure, earlier: Earlier) -> Search:
    """Search from where an earlier search ended and from nothing; the likelier outcome, with the other beside it."""
    outcomes = [search(problem, base, earlier=earlier)]
    if earlier:
        outcomes.append(search(problem, base))
    outcomes.sort(key=lambda one: penalised(problem, one.final))
    best, *others = outcomes
    differs = [o.final for o in others if set(o.final.structure.ids) != set(best.final.structure.ids)]
    return replace(best, fits=sum(o.fits for o in outcomes), otherwise=differs[0] if differs else None)


def penalised(problem: Problem, found: Fit) -> float:
    """Deviance of a model with the penalties of all its effects."""
    return found.deviance + sum(penalty(effect, problem.channel) for effect in found.structure.effects)
