"""The diagnosis of a campaign, channel by channel: search, weigh, judge what is left, measure the gain on unseen runs.

Everything below is a function of the campaign's files alone. What is stated is the model with the largest weight, and
how probable an effect is, the weight of all models that hold it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable

import numpy as np

from shockrig.analysis.characterization.shifts import widened
from shockrig.analysis.checks.checked import Checked, checked
from shockrig.analysis.checks.finding import InputFinding
from shockrig.analysis.diagnosis.adequacy import describe, judge
from shockrig.analysis.diagnosis.candidates import at_bound
from shockrig.analysis.diagnosis.diagnosed import NO_STEP, Cause, ChannelDiagnosis, Diagnosis, Tried
from shockrig.analysis.diagnosis.experiments import propose, unseen
from shockrig.analysis.diagnosis.gain import measure_gain
from shockrig.analysis.diagnosis.limits import cannot_tell, ended, rates_apart
from shockrig.analysis.diagnosis.prepare import Prepared, likelier_average, prepare, with_rounding
from shockrig.analysis.diagnosis.remainder import Tolerance, measure_remainder, predicted_badly
from shockrig.analysis.diagnosis.restless import nothing_else, restless, without_hum
from shockrig.analysis.diagnosis.search import Earlier, Search, first_look, search
from shockrig.analysis.diagnosis.stating import stated
from shockrig.analysis.diagnosis.verdict import Standing, verdict
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import is_described
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.gather import build_channel, usable_runs, why_none
from shockrig.analysis.inference.predictive import as_stated, bumps
from shockrig.analysis.inference.quantity import QUANTITIES, ChannelName
from shockrig.files.campaign import Campaign
from shockrig.files.diagnosis import StatedDiagnosis
from shockrig.files.errors import InputError
from shockrig.files.numbers import counted

Progress = Callable[[str], None]
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
    channel, hum = without_hum(channel)
    ready = prepare(channel) if ready is None or hum is not None else ready
    progress(f"{channel.name}: searching for what explains it")
    rough = first_look(ready.problem, ready.structure) if ready.rounds_coarsely else None
    ready = with_rounding(ready, rough)
    found = search(ready.problem, ready.structure, earlier, describing)
    averaged = likelier_average(ready, found, judge(ready.problem, found.best.fit, ready.noise).passed)
    if averaged is not None:
        ready = with_rounding(prepare(channel, averaged), rough)
        found = search(ready.problem, ready.structure, earlier, describing)
    problem = ready.problem
    progress(f"{channel.name}: measuring the gain on unseen runs")
    gain = measure_gain(channel, problem, ready.structure, found.plain, found.best, ready.noise)
    sigma = found.best.score.discrepancy
    adequacy, plain_adequacy = (judge(problem, one.fit, ready.noise) for one in (found.best, found.plain))
    remainder = measure_remainder(problem, found.best.fit, ready.noise, adequacy, gain, tolerance or Tolerance(), sigma)
    final = widened(problem, as_stated(problem, found.best.fit, bumps(problem), sigma, remainder.significant))
    matters = remainder.significant and remainder.material
    bursts = restless(problem.channel, adequacy) if matters else ()
    causes = _causes(ready, found, final)
    forms = stated(problem, found, final)
    shown = (*ready.shown, *bursts, *(() if hum is None else (hum,)))
    parted = [f for f in findings if f.kind == PARTED and f.channel in (None, channel.name)]
    standing = Standing(
        named=len(causes),
        forms=len(forms),
        shown=len(shown),
        left_over=remainder.significant,
        matters=remainder.material,
        only_readings=nothing_else(adequacy, bursts) and not predicted_badly(gain),
        parted=bool(parted),
        borne_out=gain.measured,
        claims=any(not CATALOGUE[c.effect].candidacy.shape for c in causes),
    )
    said = verdict(standing)
    told = matters or said == "unexplained"
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
        plain=found.plain.fit,
        final=final,
        untestable=tuple(
            id_ for id_, effect in CATALOGUE.items() if channel.name in effect.channels and not effect.acts_in(channel)
        ),
        cannot_tell=cannot_tell(channel) + rates_apart(final) + ended(found) + tuple(f.sentence for f in parted),
        tried=_tried(found),
        discrepancy=describe(problem, found.best.fit, ready.noise, adequacy) if told else None,
    )


def _causes(ready: Prepared, found: Search, final: Fit) -> tuple[Cause, ...]:
    """The effects of the catalogue in the best model: what the readings showed, and what the search found."""
    shown = {finding.effect: finding for finding in ready.findings}
    causes, values = [], final.values()
    tied = [one.ids for one in found.tied()]
    for effect, own in values.items():
        if is_described(effect):
            continue
        if effect in shown:
            finding = shown[effect]
            causes.append(Cause(effect, finding.parameters, 1.0, (), np.inf, (), finding.evidence))
            continue
        instead = dict.fromkeys(
            new
            for one, _ in found.instead(effect)
            if one.ids in tied
            for new in sorted(one.ids - found.best.ids)
            if not is_described(new)
        )
        without = max((one.value for one in found.pool if effect not in one.ids), default=found.plain.value)
        ends = at_bound(CATALOGUE[effect], {name: value for name, (value, _) in own.items()})
        causes.append(Cause(effect, own, found.probability(effect), tuple(instead), found.best.value - without, ends))
    return tuple(causes)


def _tried(found: Search) -> tuple[Tried, ...]:
    """What comes next to the best model, and is not in it."""
    said: dict[str, Tried] = {}
    for one, weight in zip(found.pool, found.weights, strict=True):
        more = one.ids - found.best.ids
        if len(more) == 1 and one.ids > found.best.ids and weight > 0.01:
            (effect,) = more
            if not is_described(effect):
                said[effect] = Tried(
                    effect, f"unseen runs bear it out with a probability of {found.probability(effect):.2f}"
                )
    return tuple(said.values())


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
            known = named_earlier(earlier, name)
            found.append(diagnose_channel(channel, progress, tolerance, known, findings=input_.findings))
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
    names = {channel.name for channel in channels}
    missing = {name: _why_not(input_.campaign, name) for name in QUANTITIES if name not in names}
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


def next_experiments(channel: ChannelDiagnosis) -> list[dict[str, object]]:
    """Runs that would tell the channel's tied explanations apart; empty where nothing is tied."""
    pairs = [(channel.search.best.fit, rival.fit) for rival in channel.search.rivals()]
    described = channel.verdict == "described" and channel.final.structure.effects
    return [*propose(channel.problem, pairs), *(unseen(channel.problem) if described else [])]
