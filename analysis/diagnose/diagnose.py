"""The diagnosis of a campaign, channel by channel: search, weigh, judge what is left, measure the gain on unseen runs.

Everything below is a function of the campaign's files alone. What is stated is the model with the largest weight, and
how probable an effect is, the weight of all models that hold it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from shockrig.analysis.characterize.shifts import widened
from shockrig.analysis.checks.campaign_checks import Checked, checked
from shockrig.analysis.checks.finding import InputFinding
from shockrig.analysis.diagnose.adequacy import judge
from shockrig.analysis.diagnose.candidates import says_nothing_at_all
from shockrig.analysis.diagnose.cannot_tell import cannot_tell, left_open, mostly_unsettled
from shockrig.analysis.diagnose.diagnosed import ChannelDiagnosis, Diagnosis, Predicting
from shockrig.analysis.diagnose.gain import Gain, HeldOutPart, held_out_parts, measure_gain
from shockrig.analysis.diagnose.hums import bursts, without_hums
from shockrig.analysis.diagnose.next_experiments import next_experiments
from shockrig.analysis.diagnose.pool import Search
from shockrig.analysis.diagnose.predicting import outdone, predicting_model
from shockrig.analysis.diagnose.prepare import Prepared, likelier_average, prepare, with_rounding
from shockrig.analysis.diagnose.remainder import Tolerance, describe, measure_remainder
from shockrig.analysis.diagnose.search import Earlier, first_look, search
from shockrig.analysis.diagnose.stated_effects import causes_in, forms_in, tried_beside
from shockrig.analysis.diagnose.verdict import Standing, verdict
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.drifting import where_airs_drift
from shockrig.analysis.estimate.gather import build_channel, usable_runs, why_none
from shockrig.analysis.estimate.predictive import as_stated, bumps
from shockrig.analysis.estimate.quantity import QUANTITIES, ChannelName, looked_for
from shockrig.analysis.estimate.refitting import plain_fit
from shockrig.files.campaign import Campaign
from shockrig.files.diagnosis import StatedDiagnosis
from shockrig.files.errors import InputError
from shockrig.files.numbers import counted

Progress = Callable[[str], None]

MOST_IN_PLACE = 3  # models that are tried, one after another, in the place of one that runs held out refute
OPEN = ("described", "unexplained")  # verdicts beside which another model may predict
NO_STEP = "no usable run with a step of the air"
PARTED = "another_sensor"  # kind of the input's finding that runs fall into groups


def diagnose_channel(
    channel: Channel,
    progress: Progress = lambda _: None,
    tolerance: Tolerance | None = None,
    earlier: Earlier | None = None,
    describing: bool = True,
    ready: Prepared | None = None,
    findings: Iterable[InputFinding] = (),
) -> ChannelDiagnosis:
    """Diagnose one channel.

    Parameters
    ----------
    channel : Channel
    progress : function of a sentence, optional
    tolerance : Tolerance, optional
        From which size on something that is left spoils a verdict.
    earlier : {effect: {parameter: value}}, optional
        What an earlier diagnosis of its runs named: a place to begin from as well.
    describing : bool
        Whether forms of the grammar are candidates as well: that takes longer than the catalogue alone.
    ready : Prepared, optional
        The channel prepared, where that has been done.
    findings : iterable of InputFinding
        What the checks of the input say: a verdict of `adequate` cannot stand against one that parts the runs.
    """
    channel, hums = without_hums(channel)
    ready = prepare(channel) if ready is None or hums else ready
    progress(f"{channel.name}: searching for what explains it")
    ready, found = _searched(channel, ready, earlier, describing)
    problem = ready.problem
    channel = replace(channel, drifts=problem.channel.drifts)
    progress(f"{channel.name}: measuring the gain on unseen runs")
    tolerance = tolerance or Tolerance()
    parts = held_out_parts(channel, problem, found.plain)
    found, gain, unborne = _borne_out(channel, ready, found, parts, tolerance.of(channel.quantity.unit))
    while True:
        sigma = found.best.score.discrepancy
        adequacy, plain_adequacy = (judge(problem, one.fit) for one in (found.best, found.plain))
        remainder = measure_remainder(problem, found.best.fit, ready.noise, adequacy, gain, tolerance, sigma)
        # As uncertain as what the model is wrong by, and what it does not carry, make it.
        final = widened(problem, as_stated(problem, found.best.fit, bumps(problem), sigma, remainder.significant))
        own = [one for one in final.structure.effects if one.id not in found.plain.ids]
        empty = frozenset(one.id for one in own if says_nothing_at_all(one, final.values()[one.id]))
        if not empty:
            break
        # What was sound to within the noise may be anything, as far as runs agree on it.
        found = found.without(empty)
        gain = measure_gain(channel, parts, found.best, ready.noise)
    causes, forms = causes_in(ready, found, final), forms_in(problem, found, final)
    at_rest = (bursts(problem.channel, ready.noise, remainder.tolerance), *hums)
    shown = (*ready.shown, *(one for one in at_rest if one is not None))
    parted = [f for f in findings if f.kind == PARTED and f.channel in (None, channel.name)]
    unsettled = mostly_unsettled(channel)
    standing = Standing(
        named=len(causes),
        forms=len(forms),
        shown=len(shown),
        left_over=remainder.significant and remainder.material,
        parted=bool(parted),
        left_open=found.leaves_open,
        unsettled=bool(unsettled),
        borne_out=gain.measured,
        claims=any(not CATALOGUE[c.effect].candidacy.shape for c in causes),
    )
    said = verdict(standing)
    predicting = Predicting(found.best, final, causes, (*forms, *shown))
    # What is adequate leaves no more than chance: what leaves less of these runs may be anything in others.
    if said in OPEN or (said == "explained" and outdone(problem, found)):
        predicting = predicting_model(ready, found, predicting, shown, whole=said not in OPEN)
    return ChannelDiagnosis(
        name=channel.name,
        verdict=said,
        causes=causes,
        discovered=(*forms, *shown),
        gain=gain,
        search=found,
        adequacy=adequacy,
        plain_adequacy=plain_adequacy,
        remainder=remainder,
        problem=problem,
        noise=ready.noise,
        final=final,
        predicting=predicting,
        untestable=tuple(
            id_ for id_, effect in CATALOGUE.items() if channel.name in effect.channels and not effect.acts_in(channel)
        ),
        cannot_tell=(
            *cannot_tell(channel),
            *unborne,
            *left_open(found, final),
            *(f.sentence for f in parted),
            *unsettled,
        ),
        tried=tried_beside(found),
        discrepancy=describe(problem, found.best.fit, ready.noise, adequacy, remainder)
        if said == "unexplained"
        else None,
    )


def _searched(channel: Channel, ready: Prepared, earlier: Earlier | None, describing: bool) -> tuple[Prepared, Search]:
    """The search, with what coarse codes do to errors; anew where a running mean of another length is likelier."""
    rough = first_look(ready.problem, ready.structure) if ready.rounds_coarsely else None
    ready = with_rounding(ready, rough)
    ready, found = _search_of(ready, earlier, describing)
    averaged = likelier_average(ready, found, judge(ready.problem, found.best.fit).passed)
    if averaged is None:
        return ready, found
    return _search_of(with_rounding(prepare(channel, averaged), rough), earlier, describing)


def _search_of(ready: Prepared, earlier: Earlier | None, describing: bool) -> tuple[Prepared, Search]:
    """A search, in airs that drift where these explain the runs."""
    problem, plain = where_airs_drift(ready.problem, plain_fit(ready.problem, ready.structure))
    return replace(ready, problem=problem), search(problem, ready.structure, earlier, describing, plain)


def refuted(gain: Gain, tolerance: float) -> bool:
    """Whether a model predicts runs held out worse than the plain one, by a size that matters [unit].

    So must the mean over runs of the logarithm of their errors say: with a few runs held out, a single one for which
    the others had to be extrapolated makes a mean square.
    """
    if not gain.after**2 - gain.before**2 > tolerance**2:
        return False
    told = np.isfinite(gain.run_before)
    return bool(np.log(gain.run_after[told]).mean() > np.log(gain.run_before[told]).mean())


def _borne_out(
    channel: Channel, ready: Prepared, found: Search, parts: Sequence[HeldOutPart], tolerance: float
) -> tuple[Search, Gain, tuple[str, ...]]:
    """The search without the likeliest models that runs held out refute, weighed anew, in the end with the plain one;
    what it gains on them, and a sentence on the likeliest where it is refuted."""
    unborne, unit, in_place = tuple[str, ...](), channel.quantity.unit, 0
    gain = measure_gain(channel, parts, found.best, ready.noise)
    while found.best is not found.plain and refuted(gain, tolerance):
        unborne = unborne or (
            "How single readings go speaks for more than the plain model. But with the rate that other runs give it, "
            f"such a model misses runs held out by {gain.after:.2g} {unit}, and the plain one by {gain.before:.2g} "
            f"{unit}: it is not stated. See that all runs are of one sensor in one airflow, and record more of them.",
        )
        found = found.without_best() if in_place < MOST_IN_PLACE else replace(found, best=found.plain)
        gain, in_place = measure_gain(channel, parts, found.best, ready.noise), in_place + 1
    return found, gain, unborne


def enough(channel: Channel) -> bool:
    """Whether a channel's runs can be diagnosed at all: at least one with a step of the air, or a measured air."""
    step = np.abs(channel.quantity.step(channel.conditions))
    return bool((step >= channel.quantity.least_step).any() or channel.measured.any())


def diagnose(
    campaign: Campaign,
    progress: Progress = lambda _: None,
    tolerance: Tolerance | None = None,
) -> Diagnosis:
    """Diagnose every channel of a campaign that has usable runs.

    Parameters
    ----------
    campaign : Campaign
    progress : function of a sentence, optional
    tolerance : Tolerance, optional
        From which size on something that is left spoils a verdict.

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
            found.append(diagnose_channel(channel, progress, tolerance, findings=input_.findings))
    return gathered(input_, found)


def named_earlier(earlier: StatedDiagnosis, name: ChannelName) -> Earlier:
    """What an earlier diagnosis named in a channel, as a search begins with it."""
    if name not in earlier.channels:
        return {}
    return {c.effect: {k: v.value for k, v in c.parameters.items()} for c in earlier.channels[name].causes}


def gathered(input_: Checked, channels: list[ChannelDiagnosis]) -> Diagnosis:
    """The diagnosis of a campaign from those of its channels.

    Raises
    ------
    InputError
        Where there are none.
    """
    names = {channel.name for channel in channels}
    missing = {name: _why_not(input_.campaign, name) for name in looked_for(input_.campaign) if name not in names}
    if not channels:
        reasons = [f"{name}: {why}" for name, why in missing.items()]
        raise InputError(f"{input_.campaign.path}: {'; '.join(reasons)}; record or import usable runs")
    experiments = [run for channel in channels for run in next_experiments(channel)]
    sentences = tuple(finding.sentence for finding in input_.findings)
    return Diagnosis(input_.campaign.name, tuple(channels), tuple(experiments), missing, sentences)


def _why_not(campaign: Campaign, name: ChannelName) -> str:
    """Why a channel cannot be diagnosed."""
    usable, left_out = usable_runs(campaign, name)
    if left_out and not usable:
        return why_none(left_out)
    # The runs with a step may be those that were left out, as where the sensor was at its rail.
    reasons = Counter(entry.reason for entry in left_out).most_common(1)
    return "; ".join([NO_STEP, *(f"{counted(len(left_out), 'run')} left out: {reason}" for reason, _ in reasons)])
