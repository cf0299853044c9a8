"""The forms that score best, fitted: a few steps each from their best starts, the leaders to the end, and then with one
factor more where that is worth its number."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from shockrig.analysis.discovery.grammar import SCALING, forms, scaling_factors
from shockrig.analysis.discovery.scores import Scored, first_order
from shockrig.analysis.effects.behaviours import Form, form_of
from shockrig.analysis.effects.described import described
from shockrig.analysis.inference.effect import Effect, by_name
from shockrig.analysis.inference.fit import Fit, fit, go_on
from shockrig.analysis.inference.model import Model
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.rate_scatter import RATE_SCATTER
from shockrig.analysis.inference.scan import rough_rates, scanned_starts
from shockrig.analysis.inference.work import Work

NUMBER = 6.0  # of deviance that each further number of a form must bring: odds of twenty
FACTOR = 14.0  # of a number that says what a form depends on: the best of seven looks by chance
QUICK, FURTHER, WHOLE = 3, 4, 25  # steps of Gauss and Newton
EACH, LEADERS, REFINED = 3, 10, 4  # forms of a behaviour, forms that are fitted to the end, forms that get a factor
ROUNDS, STAY = 2, 18  # rounds of further steps, and forms that take part in them
SCATTERED = 3.0  # times what runs usually differ by in their rates
ANY_RUN = 0.0  # misfit from which on a run's start is looked for anew: one alone may part two rules of a delay
WRONG = 3.0  # objective per bin from which the runs' deviations mean nothing


def price(form: Form, numbers: int) -> float:
    """What a form with so many numbers must bring: more for what it depends on, of which several were looked at."""
    return NUMBER * numbers + (FACTOR - NUMBER) * sum(pair in SCALING for pair in form.depends_on)


@dataclass(frozen=True)
class Candidate:
    """A form fitted on top of a model: its entry, the fit, and the deviance with what its numbers must bring."""

    effect: Effect
    fit: Fit

    @property
    def form(self) -> Form:
        """What it is."""
        return form_of(self.effect.id)

    @property
    def cost(self) -> float:
        """Deviance, and what each of its numbers must bring."""
        return self.fit.deviance + price(self.form, len(self.effect.parameters))


def candidates(
    problem: Problem, near: Fit, work: Work | None = None, known: Iterable[Candidate] = ()
) -> tuple[list[Candidate], float]:
    """Forms fitted on top of `near`, the best first, and the drop in deviance that the best of all reaches by chance.

    None but those `known` to do well in the same place where no form scores more than that. At the limit of `work` no
    further form is begun: those that score best were begun first, and the one ahead is fitted to its end in any case.
    """
    work = Work() if work is None else work
    scored, null = first_order(problem, near, forms(problem.channel))
    running = [one for one in known if set(one.fit.structure.ids) == {*near.structure.ids, one.effect.id}]
    entered = _entered(scored, null, near.rate_scatter > SCATTERED * RATE_SCATTER)
    if not running and not entered:
        return [], null
    for entry in entered:
        if running and work.ended:
            break
        begun = _begun(problem, near, entry)
        work.count(len(begun))
        running += begun
    if plainly_wrong(problem, near):
        # The way is long: whoever is ahead after a few steps need not be at its end.
        running = [_further(problem, one, work) for one in _ahead(running, 2)]
    for _ in range(ROUNDS):
        running = [_further(problem, one, work) for one in _ahead(running, 1)]
    leaders = _distinct(running)[:LEADERS]
    ended = _distinct([to_its_end(problem, one, work) for i, one in enumerate(leaders) if i == 0 or not work.ended])
    fewer = [less for one in ended[:REFINED] for less in simpler(problem, one, work)]
    refined = [more for one in _distinct([*ended, *fewer])[:REFINED] for more in _refined(problem, one, work)]
    return _distinct([*ended, *fewer, *refined]), null


def _entered(scored: Sequence[Scored], null: float, scattered: bool) -> list[Scored]:
    """Of each behaviour with its driver, the forms that score best and all whose strength nothing scales.

    Where rates are `scattered` from run to run, what would explain them scores little: they are taken for chance.
    """
    taken: dict[tuple[str, str], list[Scored]] = {}
    for entry in scored:
        form = form_of(entry.effect.id)
        group = taken.setdefault((form.behaves_as, form.driver), [])
        scores = entry.gain > (NUMBER if scattered and form.behaves_as == "rate_change" else null)
        if scores and (len(group) < EACH or not set(form.depends_on) & set(SCALING)):
            group.append(entry)
    return sorted((entry for group in taken.values() for entry in group), key=lambda entry: -entry.gain)


def plainly_wrong(problem: Problem, found: Fit) -> bool:
    """Whether a fit is so far off that its runs' deviations mean nothing."""
    return found.objective > WRONG * problem.channel.count.size


def _ahead(running: Sequence[Candidate], starts: int) -> list[Candidate]:
    """The forms ahead, and the best of every behaviour with its driver, each from so many of its starts."""
    ranked = _distinct(running)
    groups: dict[tuple[str, str], str] = {}
    for one in ranked:
        groups.setdefault((one.form.behaves_as, one.form.driver), one.effect.id)
    stay = {one.effect.id for one in ranked[:STAY]} | set(groups.values())
    found = []
    for key in stay:
        own = sorted((one for one in running if one.effect.id == key), key=lambda c: c.cost)
        found += own[:starts]
    return found


def _further(problem: Problem, one: Candidate, work: Work) -> Candidate:
    if one.fit.converged or work.ended:
        return one
    work.count()
    return Candidate(one.effect, go_on(problem, one.fit, FURTHER))


def _begun(problem: Problem, near: Fit, entry: Scored) -> list[Candidate]:
    structure = near.structure.adding(entry.effect)
    model, far = Model(problem.channel, structure), plainly_wrong(problem, near)
    # From the deviations of `near` where these mean anything.
    deviations = problem.channel.at_rest() if far else near.deviations
    found, form = [], form_of(entry.effect.id)
    begins = [(near.log_rates, start) for start in entry.starts]
    if far and form.behaves_as == "lag_in_series":
        # What takes most of the time may be the lag, and the body itself faster than it was alone.
        slow = list(entry.starts) if form.driver == "airflow" else [_all_of_it(near, entry.starts[0])]
        scanned = [rough_rates(problem, structure, choice=near.choice | by_name(entry.effect, start)) for start in slow]
        begins += zip(scanned, slow, strict=True)
    for rates, start in begins:
        theta = model.start(rates, near.choice | by_name(entry.effect, start))
        found.append(Candidate(entry.effect, fit(problem, structure, theta, deviations, QUICK)))
    return found


def _all_of_it(near: Fit, start: Mapping[str, float]) -> dict[str, float]:
    """A form's start with the time that the body alone was given."""
    return dict(start) | {"time_constant_s": float(np.exp(-near.log_rates.mean())) / 3.0}  # a film's mean lag


def to_its_end(problem: Problem, one: Candidate, work: Work) -> Candidate:
    """A form fitted to its end: from its deviations and from none, and across the steps of its objective."""
    structure, at_rest = one.fit.structure, problem.channel.at_rest()
    work.count(2)
    ends = [fit(problem, structure, one.fit.theta, start, WHOLE) for start in (one.fit.deviations, at_rest)]
    best = min(ends, key=lambda f: f.deviance)
    for offsets in one.effect.nudges(problem.channel) if one.effect.nudges else ():
        theta = best.theta.copy()
        for name, offset in offsets.items():
            theta[best.model.place(f"{one.effect.id}.{name}")] += offset
        # A run that is stuck on one side of a step may be so in the deviations alone.
        work.count(2)
        ends += [fit(problem, structure, theta, start, WHOLE) for start in (best.deviations, at_rest)]
    best = min(ends, key=lambda f: f.deviance)
    if one.effect.nudges and (moved := scanned_starts(problem, best, ANY_RUN)) is not None:
        work.count()
        best = min((best, fit(problem, structure, best.theta, moved, WHOLE)), key=lambda f: f.deviance)
    return Candidate(one.effect, best)


def _refined(problem: Problem, one: Candidate, work: Work) -> list[Candidate]:
    """The same form depending on one factor more, where that is worth its number."""
    if len(one.form.depends_on) > 1 or work.ended:
        return []
    values, found = one.fit.choice, []
    without = one.fit.structure.dropping(one.effect.id)
    for factor, how in scaling_factors(one.form, problem.channel):
        effect = described(one.form.with_factor(factor, how).key, problem.channel.jumps_with_air)
        named = {f"{effect.id}.{p.name}": values[f"{one.effect.id}.{p.name}"] for p in one.effect.parameters}
        neutral = 1.0 if how == "ratio" else 0.0
        structure = without.adding(effect)
        theta = Model(problem.channel, structure).start(
            one.fit.log_rates, values | named | {f"{effect.id}.{factor}": neutral}
        )
        work.count()
        found.append(Candidate(effect, fit(problem, structure, theta, one.fit.deviations, WHOLE)))
    return [better for better in found if better.cost < one.cost]


def simpler(problem: Problem, one: Candidate, work: Work) -> list[Candidate]:
    """The same form without one of the factors that only scale it."""
    values, found = one.fit.choice, []
    without = one.fit.structure.dropping(one.effect.id)
    for factor, how in one.form.depends_on:
        form = Form(one.form.behaves_as, one.form.driver, tuple(f for f in one.form.depends_on if f[0] != factor))
        if (factor, how) not in SCALING or (form.behaves_as == "rate_change" and not form.depends_on):
            continue
        effect = described(form.key, problem.channel.jumps_with_air)
        named = {f"{effect.id}.{p.name}": values[f"{one.effect.id}.{p.name}"] for p in effect.parameters}
        structure = without.adding(effect)
        theta = Model(problem.channel, structure).start(one.fit.log_rates, values | named)
        work.count()
        found.append(Candidate(effect, fit(problem, structure, theta, one.fit.deviations, WHOLE)))
    return found


def _distinct(found: Iterable[Candidate]) -> list[Candidate]:
    """The best fit of each form, the best form first; fits that lead nowhere are left out."""
    best: dict[str, Candidate] = {}
    for one in found:
        if not np.isfinite(one.fit.deviance):
            continue
        if one.effect.id not in best or one.cost < best[one.effect.id].cost:
            best[one.effect.id] = one
    return sorted(best.values(), key=lambda c: c.cost)
