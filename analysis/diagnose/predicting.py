"""Which model predicts, and goes into the profile: the one that is stated, or one that leaves less of the runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from shockrig.analysis.characterize.shifts import widened
from shockrig.analysis.diagnose.diagnosed import Predicting
from shockrig.analysis.diagnose.held_out import run_errors
from shockrig.analysis.diagnose.pool import Rated, Search
from shockrig.analysis.diagnose.prepare import Prepared
from shockrig.analysis.diagnose.stated_effects import causes_in, forms_in
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import drifts, is_described
from shockrig.analysis.effects.forms import form_of
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.predictive import BUMP_COUNT, bumps, no_surer, score
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.refitting import LEAST_SQUARE, as_judged, carried, squares_of_bins
from shockrig.files.diagnosis_data import Discovered

# What one would fit without a catalogue.
SIMPLE = frozenset(effect.id for effect in CATALOGUE.values() if effect.candidacy.simple)
MOST_PREDICTING = 12  # models of each of two orders that are tried beside the stated and the plain one
# Nats that are not worth more than a bare mention (Kass and Raftery 1995, doi 10.1080/01621459.1995.10476572): models
# that far apart predict alike.
AS_GOOD = 1.0


def predicting_model(
    ready: Prepared, found: Search, stands: Predicting, shown: tuple[Discovered, ...], whole: bool
) -> Predicting:
    """The model that predicts best: of the heaviest, of those that leave least of their runs for what they take, of
    what one would fit without a catalogue, and the stated and the plain one, each fitted as it is judged, the one that
    then leaves least, and of those that leave as little the likeliest; the stated one as it stands where no reading is
    left to it (`whole`) and runs tell no more of any, or where none leaves less.

    A name has to be sure, a prediction only good: models whose effects say nothing may predict as well. And no name
    asks what a run would do that nobody has seen: it has none of the rates that runs have of their own. At those,
    every model leaves as little that says of what rates depend on; beside noise that is small, weight tells nothing of
    what a model is wrong by. So both orders are asked. What goes with the order of these runs says nothing of others,
    unless it is stated.
    """
    problem, channel = ready.problem, ready.problem.channel
    heaviest = found.predictors
    least_left = sorted(heaviest, key=lambda one: _criterion(channel, one.fit))
    simple = (one for one in heaviest if one.ids - found.plain.ids <= SIMPLE)
    firsts = *heaviest[:MOST_PREDICTING], *least_left[:MOST_PREDICTING], *simple
    models = {id(one): one for one in (found.best, found.plain, *firsts) if not _drifts(one, beside=found.best)}
    tried = [(one, judged) for one in models.values() if (judged := as_judged(problem, one.fit)) is not None]
    left = [float(run_errors(channel, problem, judged).mean()) for _, judged in tried]
    before = float(run_errors(channel, problem, found.best.fit).mean())
    gained = [_loss(channel, before) - _loss(channel, one) for one in left]
    most = max((one for one in gained if one > 0.0), default=0.0)
    if most <= (AS_GOOD if whole else 0.0):
        return stands
    as_good = [i for i, one in enumerate(gained) if one > 0.0 and most - one <= AS_GOOD]
    chosen = max(as_good, key=lambda i: tried[i][0].value)
    model, judged = tried[chosen]
    fit = carried(problem, model.fit, judged)
    bump = bumps(problem)
    sure = no_surer(problem, fit, bump, score(problem, fit, bump).discrepancy, than_runs=True)
    final, stated_so = widened(problem, sure), replace(found, best=model)
    return Predicting(
        model,
        final,
        causes_in(ready, stated_so, final),
        (*forms_in(problem, stated_so, final), *shown),
        (float(np.sqrt(before)), float(np.sqrt(left[chosen]))),
    )


def _drifts(one: Rated, beside: Rated) -> bool:
    """Whether a model holds a form that another does not and that goes with the order of the runs or their hours."""
    return any(is_described(id_) and drifts(form_of(id_)) for id_ in one.ids - beside.ids)


def outdone(problem: Problem, found: Search) -> bool:
    """Whether another model that was weighed leaves less of the runs than the stated one where each has a rate of its
    own: beside what is a whole explanation, none does."""
    least = min((_left(problem.channel, one.fit) for one in found.predictors), default=np.inf)
    return _left(problem.channel, found.best.fit) - least > AS_GOOD


def _loss(channel: Channel, square: float) -> float:
    """Nats against a model that leaves a mean square of the runs: each counts as as many independent errors of unknown
    size as a discrepancy has bumps, since what a model is wrong by is no noise: it is there again in the next run."""
    return 0.5 * BUMP_COUNT * channel.runs * float(np.log(max(square, LEAST_SQUARE)))


def _left(channel: Channel, found: Fit) -> float:
    """Nats against a fit by what it leaves at its runs' own rates; endless for one that led to no number."""
    loss = _loss(channel, float(squares_of_bins(channel, found.residual).mean()))
    return float("inf") if np.isnan(loss) else loss


def _criterion(channel: Channel, found: Fit) -> float:
    """Schwarz's criterion, halved [nats], of the same (doi 10.1214/aos/1176344136)."""
    return _left(channel, found) + 0.5 * found.theta.size * float(np.log(BUMP_COUNT * channel.runs))
