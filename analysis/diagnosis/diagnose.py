"""The diagnosis of a campaign, channel by channel: search, judge what is left, measure the gain on runs not seen.

Everything below is a function of the campaign's files alone. A cause is named only where unseen runs are predicted
better with it: what is tried and does not help there is dropped, and said to have been tried.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from shockrig.analysis.checks.checked import Checked, checked
from shockrig.analysis.diagnosis.adequacy import describe, judge
from shockrig.analysis.diagnosis.describing import MOST_FITS, alternatives, describe_rest
from shockrig.analysis.diagnosis.diagnosed import NO_STEP, Cause, ChannelDiagnosis, Diagnosis
from shockrig.analysis.diagnosis.experiments import propose, unseen
from shockrig.analysis.diagnosis.kept import (
    Kept,
    beside_described,
    in_doubt,
    kept_of,
    no_surer_than_runs,
    tied,
    without_doubted,
)
from shockrig.analysis.diagnosis.limits import cannot_tell, ended, rates_apart
from shockrig.analysis.diagnosis.naming import Doubt, doubts, from_rivals
from shockrig.analysis.diagnosis.prepare import Prepared, likelier_average, prepare, with_rounding
from shockrig.analysis.diagnosis.remainder import Tolerance, measure_remainder, predicted_badly
from shockrig.analysis.diagnosis.restless import nothing_else, restless
from shockrig.analysis.diagnosis.search import (
    Earlier,
    search,
    search_twice,
)
from shockrig.analysis.diagnosis.thresholds import TIE
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.gather import build_channel, usable_runs, why_none
from shockrig.analysis.inference.noise import Noise
from shockrig.analysis.inference.quantity import QUANTITIES, ChannelName
from shockrig.analysis.inference.work import Work, cost_of_a_fit
from shockrig.files.campaign import Campaign
from shockrig.files.diagnosis import StatedDiagnosis
from shockrig.files.errors import InputError

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Missed:
    """Effects that a search had missed, the deviance that their law had reached, and the readings that a mean had."""

    effects: frozenset[str]
    deviance: float
    averaged: int

    def found(self, causes: Iterable[Cause], final: Fit, noise: Noise) -> bool:
        """Whether a search that began with them names them, with nothing more left than that left."""
        named = {cause.effect for cause in causes}
        as_well = final.deviance < self.deviance + TIE
        return noise.averaged == self.averaged and self.effects <= named and as_well


def diagnose_channel(
    channel: Channel,
    progress: Progress = lambda _: None,
    tolerance: Tolerance | None = None,
    earlier: Earlier | None = None,
    describing: bool = True,
    seeking: Missed | None = None,
    twice: bool = False,
    ready: Prepared | None = None,
) -> ChannelDiagnosis:
    """Diagnose one channel; `earlier` is what an earlier diagnosis of its runs named, where the search then begins.
    Where it shall begin from nothing too (`twice`) the likelier outcome counts. `ready` is the channel prepared, where
    that has been done.

    What no catalogued effect explains is described only where `describing`: that takes longer than all the rest. Where
    a form of the grammar that does well there is the law of a catalogued effect, the search begins again from that
    effect, once (`seeking`; nothing is described there unless that effect is named).
    """
    ready = prepare(channel) if ready is None else ready
    progress(f"{channel.name}: searching the catalogue")
    rough = search(ready.problem, ready.structure, thorough=False).final if ready.rounds_coarsely else None
    ready = with_rounding(ready, rough)
    searched = search_twice if twice else search
    found = searched(ready.problem, ready.structure, earlier=earlier or {})
    adequacy = judge(ready.problem, found.final, ready.noise)
    averaged = likelier_average(ready, found, adequacy.passed)
    if averaged is not None:
        ready = with_rounding(prepare(channel, averaged), rough)
        found = searched(ready.problem, ready.structure, earlier=earlier or {})
        adequacy = judge(ready.problem, found.final, ready.noise)
    plain_adequacy = judge(ready.problem, found.plain, ready.noise)
    progress(f"{channel.name}: measuring the gain on unseen runs")
    kept = kept_of(channel, ready, found, adequacy)
    if kept.final is not found.final:
        adequacy = judge(ready.problem, kept.final, ready.noise)
    remainder = measure_remainder(ready.problem, kept.final, ready.noise, adequacy, kept.gain, tolerance or Tolerance())
    spoilt = remainder.significant and remainder.material
    left, kept = spoilt or not adequacy.passed, in_doubt(kept) if spoilt else kept
    # What no other run has borne out tells of a shape and does not explain.
    untried = any(CATALOGUE[c.effect].shape for c in kept.causes) and not kept.gain.measured
    verdict = "unexplained" if spoilt or untried else "explained" if kept.causes else "adequate"
    described, work = None, Work(MOST_FITS / cost_of_a_fit(ready.problem, ready.structure))
    told = _doubts(ready, kept, work) if describing else []
    doubted = [one.cause for one in told if one.outdone]
    if seeking is not None:  # what does not find that counts for nothing, whatever else it would describe
        describing &= seeking.found((c for c in kept.causes if c.effect not in doubted), kept.final, ready.noise)

    def from_the_law(missed: Earlier | None, reached: Fit, descriptions: int) -> ChannelDiagnosis | None:
        if missed is None or seeking is not None:
            return None
        new = Missed(frozenset(missed) - set(kept.final.structure.ids), reached.deviance, ready.noise.averaged)
        progress(f"{channel.name}: searching the catalogue again, from the law of an effect that it had missed")
        again = diagnose_channel(channel, progress, tolerance, missed, describing, seeking=new)
        more = 0 if again.described is None else len(again.described.discovered)
        fewer = more < descriptions or not descriptions
        return again if fewer and new.found(again.causes, again.final, again.noise) else None

    if (again := from_the_law(from_rivals(told), kept.final, 0)) is not None:
        return again
    kept = tied(kept, told)
    if (spoilt or doubted) and describing:
        progress(f"{channel.name}: describing what no catalogued effect explains")
        less = without_doubted(channel, ready, found, kept, doubted)
        known = [one.form for one in told if one.outdone and one.form is not None]
        described = describe_rest(
            channel,
            ready.problem,
            ready.noise,
            found.plain,
            less.final,
            less.gain,
            tolerance or Tolerance(),
            work,
            known,
        )
        if described is not None:
            again = from_the_law(described.listed, described.fit, len(described.discovered))
            if again is not None:
                return again
        kept = kept if described is None else beside_described(less, described)
    if described is not None:
        adequacy, remainder = described.adequacy, described.remainder
        spoilt = remainder.significant and remainder.material
        left, verdict = spoilt or not adequacy.passed, "unexplained" if spoilt else "described"
    humming = restless(ready.problem.channel, adequacy) if spoilt and describing else ()
    # What only single readings show is no part of the response, and is told with that.
    if nothing_else(adequacy, humming) and not predicted_badly(kept.gain):
        verdict = "described"
    if ready.shown and verdict in ("adequate", "explained"):
        verdict = "described"
    if verdict == "unexplained":
        kept = no_surer_than_runs(ready.problem, kept)
    return ChannelDiagnosis(
        name=channel.name,
        verdict=verdict,
        causes=kept.causes,
        gain=kept.gain,
        search=found,
        adequacy=adequacy,
        plain_adequacy=plain_adequacy,
        remainder=remainder,
        problem=ready.problem,
        noise=ready.noise,
        plain=found.plain,
        final=kept.final,
        untestable=tuple(
            id_ for id_, effect in CATALOGUE.items() if channel.name in effect.channels and not effect.acts_in(channel)
        ),
        cannot_tell=cannot_tell(channel)
        + rates_apart(kept.final)
        + ended(found, work)
        + tuple(d.sentence for d in told if d.form is not None and d.cause in {c.effect for c in kept.causes}),
        tried=kept.tried,
        discrepancy=describe(ready.problem, kept.final, ready.noise, adequacy) if left else None,
        described=described,
        humming=(*ready.shown, *humming),
        work=work,
    )


def _doubts(ready: Prepared, kept: Kept, work: Work) -> list[Doubt]:
    """What plain behaviours, which claim no cause, say against those that are named."""
    shown = {finding.effect for finding in ready.findings}
    claims = (c.effect for c in kept.causes if c.effect not in shown and not CATALOGUE[c.effect].shape)
    return doubts(ready.problem, kept.final, claims, work)


def enough(channel: Channel) -> bool:
    """Whether a channel's runs can be diagnosed at all: at least one with a step of the air, or a measured air."""
    step = np.abs(channel.quantity.step(channel.conditions))
    return bool((step >= channel.quantity.least_step).any() or channel.measured.any())


def diagnose(
    campaign: Campaign,
    progress: Progress = lambda _: None,
    tolerance: Tolerance | None = None,
    earlier: StatedDiagnosis | None = None,
) -> Diagnosis:
    """Diagnose every channel of a campaign that has usable runs.

    Parameters
    ----------
    campaign : Campaign
    progress : function of a sentence, optional
    tolerance : Tolerance, optional
        From which size on something that is left spoils a verdict.
    earlier : StatedDiagnosis, optional
        An earlier diagnosis of this campaign, read from its file: the search begins with what it named.

    Raises
    ------
    InputError
        Where no run of either sensor can be used.
    """
    input_ = checked(campaign)
    for finding in input_.findings:
        progress(f"input: {finding.sentence}")
    found = []
    for name in QUANTITIES:
        channel = build_channel(input_.campaign, name)
        if channel is not None and enough(channel):
            found.append(diagnose_channel(channel, progress, tolerance, named_earlier(earlier, name)))
    return gathered(input_, found)


def named_earlier(earlier: StatedDiagnosis | None, name: ChannelName) -> Earlier:
    """What an earlier diagnosis named in a channel, as a search begins with it."""
    if earlier is None or name not in earlier.channels:
        return {}
    return {c.effect: {k: v.value for k, v in c.parameters.items()} for c in earlier.channels[name].causes}


def gathered(input_: Checked, channels: list[ChannelDiagnosis]) -> Diagnosis:
    """The diagnosis of a campaign from those of its channels.

    Raises
    ------
    InputError
        Where there are none.
    """
    if not channels:
        reasons = [f"{name}: {_why_not(input_.campaign, name)}" for name in QUANTITIES]
        raise InputError(f"{input_.campaign.path}: {'; '.join(reasons)}; record or import usable runs")
    names = {channel.name for channel in channels}
    experiments = [run for channel in channels for run in next_experiments(channel)]
    missing = tuple(name for name in QUANTITIES if name not in names)
    sentences = tuple(finding.sentence for finding in input_.findings)
    return Diagnosis(input_.campaign.name, tuple(channels), tuple(experiments), missing, sentences)


def _why_not(campaign: Campaign, name: ChannelName) -> str:
    """Why a channel cannot be diagnosed."""
    usable, left_out = usable_runs(campaign, name)
    return NO_STEP if usable or not left_out else why_none(left_out)


def next_experiments(channel: ChannelDiagnosis) -> list[dict[str, object]]:
    """Runs that would tell the channel's tied explanations apart; empty where nothing is tied."""
    named = {cause.effect for cause in channel.causes}
    pairs = [
        (channel.final, rival)
        for effect, standing in channel.search.standing.items()
        if effect in named
        for rival in (standing.instead[e] for e in standing.alike(TIE))
    ]
    if channel.described is None:
        return propose(channel.problem, pairs)
    return [*propose(channel.problem, [*pairs, *alternatives(channel.described)]), *unseen(channel.problem)]
