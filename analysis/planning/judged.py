"""What a look at a channel finds: whether the model so far is enough, what explains it, what is tied, which is out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from shockrig.analysis.diagnosis.adequacy import judge
from shockrig.analysis.diagnosis.describing import alternatives
from shockrig.analysis.diagnosis.diagnose import diagnose_channel, enough
from shockrig.analysis.diagnosis.diagnosed import ChannelDiagnosis
from shockrig.analysis.diagnosis.prepare import prepare
from shockrig.analysis.diagnosis.refitting import finish
from shockrig.analysis.diagnosis.search import candidates_of, evidence, penalised, refused, says_nothing
from shockrig.analysis.diagnosis.thresholds import FALSE_ALARMS, penalty
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.effect import by_name
from shockrig.analysis.inference.fit import Fit, fit
from shockrig.analysis.inference.gather import build_channel
from shockrig.analysis.inference.model import Model, Structure
from shockrig.analysis.inference.noise import Noise
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.quantity import ChannelName
from shockrig.analysis.inference.scan import rough_point
from shockrig.analysis.planning.evidence import REJECTED, Dispute, Explanation, against, structure_of
from shockrig.analysis.planning.verdict import Verdict
from shockrig.files.campaign import Campaign

FEWEST_RUNS = 4  # that are diagnosed
MORE_RUNS = 1.2  # times as many as at the last diagnosis, from which on one that left something is made again


@dataclass(frozen=True)
class Look:
    """A channel at one look: its verdict, and the fits that a design needs (None where it cannot be diagnosed).

    `short` is True where a few runs more would do for that.
    """

    verdict: Verdict
    problem: Problem | None = None
    noise: Noise | None = None
    rivals: tuple[Fit, ...] = ()
    left_over: str = ""  # the run that is explained worst, where something is left
    short: bool = False


def spending(look: int) -> float:
    """The share of the permitted error that look number `look` (from 1) may spend: these add up to 1."""
    return 1.0 / (look * (look + 1.0))


def tie_level(look: int) -> float:
    """Drop in deviance, by Student's measure, above which explanations are not tied at a look.

    The odds of a wrong choice, summed over all looks, stay below the rate of false alarms.
    """
    return 2.0 * float(np.log(1.0 / (FALSE_ALARMS * spending(look))))


def look_at(campaign: Campaign, name: ChannelName, before: Verdict, final: bool = False, later: bool = False) -> Look:
    """Look at one channel of a checked campaign.

    Parameters
    ----------
    campaign : Campaign
    name : channel
    before : Verdict
        Of the last look.
    final : bool
        Whether a verdict on all runs is wanted, come what may.
    later : bool
        Whether a diagnosis is left for later, and only said to be due; not one that is wanted come what may.
    """
    channel = build_channel(campaign, name)
    if channel is None or not enough(channel) or channel.runs < FEWEST_RUNS:
        return Look(before, short=channel is not None and enough(channel))
    ready = prepare(channel)
    now, base = before, ready.structure
    if before.dispute is not None:
        now = replace(before, against=tuple(against(ready.problem, base, before.dispute)))
    anew = final or now.decided or before.runs == 0 and channel.runs >= 2 * FEWEST_RUNS
    if not anew and now.dispute is None:
        current = _fitted(ready.problem, now.causes, base)
        passed = judge(ready.problem, current, ready.noise).passed
        anew = (not passed or before.left) and channel.runs >= max(MORE_RUNS * before.runs, before.runs + 1)
    wanted = channel.runs > before.runs or (final and not before.final)
    if anew and wanted and later and not final:
        now = replace(now, due=True)
    elif anew and wanted:
        found = diagnose_channel(channel, earlier=now.causes, describing=final, twice=final, ready=ready)
        now = _taken(found, now, final)
        ready = replace(ready, problem=found.problem, noise=found.noise)
    rivals = tuple(_fitted(ready.problem, e, base) for e in now.standing) if len(now.standing) > 1 else ()
    worst = ""
    if now.left:
        current = _fitted(ready.problem, now.causes, base)
        squares = (ready.problem.whiten(current.residual) ** 2).sum(axis=1)
        worst = ready.problem.channel.run_ids[int(np.argmax(squares))]
    return Look(now, ready.problem, ready.noise, rivals, worst)


def diagnosed(campaign: Campaign, name: ChannelName, due: Verdict) -> Verdict:
    """The verdict of a diagnosis that was left for later; `campaign` has been checked and holds the runs of then."""
    channel = build_channel(campaign, name)
    assert channel is not None  # or nothing was due
    return _taken(diagnose_channel(channel, earlier=due.causes, describing=False), due, False)


def _fitted(problem: Problem, explanation: Explanation, base: Structure) -> Fit:
    """An explanation fitted to a channel, from the values that it came with."""
    structure = structure_of(explanation, base, problem.channel.name)
    choice = {f"{e}.{p}": v for e, values in explanation.items() for p, v in values.items()}
    point = rough_point(problem, base)
    start = {name: value for name, value in choice.items() if name in structure.names}
    theta = Model(problem.channel, structure).start(point.theta[: problem.channel.rates], start)
    return fit(problem, structure, theta, point.deviations, iterations=40)


def _explained_by(found: Fit) -> Explanation:
    return {e: {p: value for p, (value, _) in own.items()} for e, own in found.values().items()}


def _taken(found: ChannelDiagnosis, before: Verdict, final: bool) -> Verdict:
    """The verdict of a diagnosis, with what it leaves tied at this look; what new runs have ruled out stays out.

    Before the end an ambient may have a single run, without which it cannot be predicted: what is not seen in the fit
    is no remainder then.
    """
    verdict, as_at_the_end = found.verdict, final or found.verdict in ("explained", "adequate")
    if not final and found.adequacy.passed and verdict == "unexplained":
        verdict = "explained" if found.causes else "adequate"
    newly = (tuple(e) for e, x in zip(before.explanations, before.against, strict=True) if x >= REJECTED)
    out = tuple(dict.fromkeys((*before.out, *(tuple(sorted(ids)) for ids in newly))))
    look = before.looks + 1
    over = () if before.dispute is None else ((before.dispute, before.against),)
    settled = (*before.settled, *over)
    kept: dict[tuple[str, ...], Explanation] = {}
    for one in _possible(found, look, final):
        ids = tuple(sorted(one))
        if ids not in out:
            kept.setdefault(ids, one)
    # What stood before and is not out stands where all that the diagnosis thinks of is out, or is not enough.
    survivors = [one for one in before.standing or (before.causes,) if tuple(sorted(one)) not in out]
    if not found.adequacy.passed and (best := _enough(found, survivors)) is not None:
        kept = {tuple(sorted(best)): best}
        verdict, as_at_the_end = "explained" if best else "adequate", True
    runs, explanations = found.problem.channel, tuple(kept.values() or survivors)
    if not explanations:
        return Verdict(
            "unexplained", runs.runs, _explained_by(found.final), None, (), out, look, settled, as_at_the_end
        )
    if tuple(sorted(_explained_by(found.final))) in out:
        # What this look does not think best, new runs have borne out: what is left is judged of the model they leave.
        stands = _enough(found, explanations[:1])
        named = "explained" if stands else "adequate"
        verdict, as_at_the_end = ("unexplained", as_at_the_end) if stands is None else (named, True)
    dispute = Dispute(explanations, runs.run_ids) if len(explanations) > 1 else None
    nothing_yet = (0.0,) * len(explanations) if dispute else ()
    return Verdict(verdict, runs.runs, explanations[0], dispute, nothing_yet, out, look, settled, as_at_the_end)


def _enough(found: ChannelDiagnosis, explanations: Sequence[Explanation]) -> Explanation | None:
    """The first of some explanations that leaves nothing but noise."""
    for one in explanations:
        if judge(found.problem, _fitted(found.problem, one, found.plain.structure), found.noise).passed:
            return one
    return None


def _possible(found: ChannelDiagnosis, look: int, final: bool) -> list[Explanation]:
    """The explanation that a diagnosis ends with, and those that it is tied with at this look."""
    own, level = _explained_by(found.final), tie_level(look)
    explanations = [own]
    if found.described is not None:
        explanations += [_explained_by(other) for _, other in alternatives(found.described)]
    for effect, standing in found.search.standing.items():
        if effect not in found.final.structure.ids:
            continue
        for rival, other in standing.instead.items():
            if evidence(found.problem, standing.rivals[rival]) < level:
                explanations.append(_explained_by(other))
        for rare, rise in _passed_over(found, effect):
            if evidence(found.problem, rise) < level:
                explanations.append(_explained_by(rare))
        # What is barely needed, at one look of many, is tied with nothing.
        if standing.worth < penalty(CATALOGUE[effect], found.problem.channel) + level - tie_level(1):
            explanations.append({e: v for e, v in own.items() if e != effect})
    # Where a search from another start ended elsewhere.
    elsewhere, searched = found.search.otherwise, found.search.final
    if elsewhere is not None:
        behind = penalised(found.problem, elsewhere) - penalised(found.problem, searched)
        if evidence(found.problem, behind) < level:
            explanations.append(_explained_by(elsewhere))
    if final and found.verdict == "adequate" and not judge(found.problem, searched, found.noise).passed:
        # The loop would end, and something is left for sure, if too small to matter: tied is what would all but pay for
        # itself and leaves nothing. Before directions and airflows were varied that could be anything.
        for effect, more in found.search.almost.items():
            gained = evidence(found.problem, searched.deviance - more.deviance)
            pays = gained > max(penalty(CATALOGUE[effect], found.problem.channel) - level, 0.0)
            if pays and judge(found.problem, more, found.noise).passed:
                explanations.append(_explained_by(more))
    # What the search found and unseen runs of this look do not bear out, where the model without it is not enough.
    wider = _explained_by(found.search.final)
    if set(wider) - set(own) and not (found.verdict == "adequate" and found.adequacy.passed):
        explanations.append(wider)
    return explanations


def _passed_over(found: ChannelDiagnosis, effect: str) -> list[tuple[Fit, float]]:
    """The model with what hardly ever happens in the place of an effect, and by how much the deviance rises then.

    A search follows what is likelier. Runs that can be chosen may as well rule it out.
    """
    problem, final = found.problem, found.final
    out = []
    for rare in candidates_of(problem.channel):
        if rare.rare and rare.id not in final.structure.ids:
            structure = final.structure.dropping(effect).adding(rare)
            starts = [by_name(rare, s) for s in rare.starts(problem.channel)]
            thetas = (Model(problem.channel, structure).start(final.log_rates, final.choice | own) for own in starts)
            best = finish(problem, min((fit(problem, structure, t) for t in thetas), key=lambda one: one.deviance))
            if not says_nothing(rare, best.values()[rare.id]) and not refused(best, rare):
                out.append((best, best.deviance - final.deviance + rare.rarity(problem.channel)))
    return out
