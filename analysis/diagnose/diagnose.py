"""The diagnosis of a campaign, channel by channel: search, weigh, judge what is left, measure the gain on unseen runs.

Everything below is a function of the campaign's files alone. What is stated is the model with the largest weight, and
how probable an effect is, the weight of all models that hold it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.characterize.shifts import widened
from shockrig.analysis.checks.campaign_checks import Checked, checked
from shockrig.analysis.checks.finding import InputFinding
from shockrig.analysis.diagnose.adequacy import judge
from shockrig.analysis.diagnose.candidates import at_bound
from shockrig.analysis.diagnose.diagnosed import (
    NO_STEP,
    Cause,
    ChannelDiagnosis,
    Diagnosis,
    Predicting,
)
from shockrig.analysis.diagnose.experiments import propose, unseen
from shockrig.analysis.diagnose.gain import (
    LEAST_SQUARE,
    Gain,
    HeldOutPart,
    as_judged,
    carried,
    held_out_parts,
    measure_gain,
    run_errors,
    squares_of_bins,
)
from shockrig.analysis.diagnose.grammar import stated
from shockrig.analysis.diagnose.prepare import Prepared, likelier_average, prepare, with_rounding
from shockrig.analysis.diagnose.remainder import Tolerance, describe, measure_remainder
from shockrig.analysis.diagnose.restless import bursts, without_hums
from shockrig.analysis.diagnose.search import Earlier, Rated, Search, first_look, search
from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.diagnose.verdict import Standing, verdict
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import is_described
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.gather import UNSETTLED, build_channel, usable_runs, why_none
from shockrig.analysis.estimate.predictive import BUMP_COUNT, as_stated, bumps, no_surer, score
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.quantity import QUANTITIES, ChannelName, looked_for
from shockrig.analysis.estimate.seen import FEW_RUNS
from shockrig.files.campaign import Campaign
from shockrig.files.causes import Uncertain
from shockrig.files.diagnosis import StatedDiagnosis
from shockrig.files.diagnosis_data import Discovered
from shockrig.files.errors import InputError
from shockrig.files.numbers import counted

Array = NDArray[np.float64]

MOST_PREDICTING = 12  # models that are tried beside the stated and the plain one
# Nats that are not worth more than a bare mention (Kass and Raftery 1995, doi 10.1080/01621459.1995.10476572): models
# that far apart predict alike.
AS_GOOD = 1.0
LEAST_TRIED = 0.01  # weight of a model that is not stated, from which on its effect is said to have been tried

# What a channel's runs cannot tell, whatever is in them: said before anything is fitted.

MOST_IN_PLACE = 3  # models tied with one that runs held out refute, that are tried in its place
SAME_AIRFLOW = 1.2  # ratio between airflows below which they are one


def refuted(gain: Gain, tolerance: float) -> bool:
    """Whether a model predicts runs held out worse than the plain one, by a size that matters [unit].

    So must the mean over runs of the logarithm of their errors say: with a few runs held out, a single one for which
    the others had to be extrapolated makes a mean square.
    """
    if not gain.after**2 - gain.before**2 > tolerance**2:
        return False
    told = np.isfinite(gain.run_before)
    return bool(np.log(gain.run_after[told]).mean() > np.log(gain.run_before[told]).mean())


def left_open(found: Search, final: Fit) -> tuple[str, ...]:
    """Sentences on what the search and its model leave open."""
    said = {
        f"The runs differ in how fast they are by some {final.rate_scatter:.0%}, and nothing that was named says why: "
        "see that all are of one sensor, in one airflow.": final.rate_scatter > level("rate_scatter"),
        f"The search ended at its limit of work, after {found.fits} fits: what it had reached by then is judged, and "
        "more may be there. Diagnose again with --from this diagnosis to go on from there.": found.ended_early,
    }
    return tuple(sentence for sentence, holds in said.items() if holds)


def mostly_unsettled(channel: Channel) -> tuple[str, ...]:
    """A sentence where more runs were left out for readings that drift at rest than are judged."""
    drifting = sum(one.reason.startswith(UNSETTLED) for one in channel.left_out)
    if drifting <= channel.runs:
        return ()
    return (
        f"In {drifting} of {drifting + channel.runs} runs the {channel.sensor} was not settled before the transfer: "
        f"what is judged is the other {channel.runs} alone. Where it had time to settle, what moves it at rest is "
        "unexplained.",
    )


def cannot_tell(channel: Channel) -> tuple[str, ...]:
    """Sentences, each on one thing that the campaign leaves open and what it would have needed."""
    c, sensor = channel.conditions, channel.sensor
    several, step, driven = channel.runs > 1, channel.quantity.step(c), bool(channel.measured.any())
    alike = c.airflow_m_s.max() < SAME_AIRFLOW * max(c.airflow_m_s.min(), 1e-9)
    one_airflow = several and c.airflow_known.all() and alike
    one_way = several and not driven and (np.all(step > 0) or np.all(step < 0))
    own_unknown = channel.name == "humidity" and not np.isfinite(channel.die_c).any() and not channel.isothermal.all()
    few, alone = 1 < channel.runs <= FEW_RUNS, several and not has_repeats(channel)
    lag_unknown = driven and not any(air is not None and air.lag_s > 0.0 for air in channel.air)
    said = {
        "One run: nothing can be tried on a run that was not fitted. What is named says how the response goes; what "
        "makes it go so is not borne out by one run.": not several,
        f"{counted(channel.runs, 'run')}: only what is plain in each can be told, and uncertainties are wide.": few,
        "No condition was repeated: how much runs differ by chance is taken from what sensors usually do.": alone,
        "The start of the transfer was not recorded: it is estimated from the readings, so a delay, a slow transfer "
        f"and a lag before the {sensor} cannot be told apart. Log the trigger.": not c.start_known.all(),
        "The airs were not recorded: plateaus are taken for them, so errors of the calibration cannot be seen, nor an "
        "air that still moves. Log a reference beside the probes.": not c.airs_known.all(),
        f"The airflow was not recorded: what an exchange with the air does to the {sensor} cannot be told from its own "
        "body or a housing. Log the airflow, and vary it.": not c.airflow_known.all(),
        "All runs have one airflow: what depends on it cannot be told from what does not. Vary it.": one_airflow,
        f"The {sensor}'s own temperature was not recorded: where the temperature changes, its lag and the {sensor}'s "
        "cannot be told apart. Log it (temperature_c in hyt.csv, die_temperature in a map).": own_unknown,
        "All steps go one way: what depends on the direction cannot be told from what does not.": one_way,
        "The air was measured: slow transfers and room air are in the trace, and are not looked for.": driven,
        "The reference's own lag was not stated: it is taken for none, and the times are those behind what it shows. "
        f"State {channel.quantity.reference_lag} of the reference (run.json, or the map).": lag_unknown,
    }
    return tuple(sentence for sentence, holds in said.items() if holds)


def has_repeats(channel: Channel) -> bool:
    """Whether any two runs had the same airs and airflow, within what chambers reach."""
    c = channel.conditions
    flow = np.log(np.maximum(c.airflow_m_s, 0.05)) / 0.2
    airs = (c.source_c, c.destination_c, c.source_percent / 3.0, c.destination_percent / 3.0)
    keys = np.round(np.column_stack([*airs, flow]))
    return np.unique(keys, axis=0).shape[0] < channel.runs


Progress = Callable[[str], None]
SETTLED = ("adequate", "explained")  # verdicts of a model that leaves nothing which another could predict
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
    progress(f"{channel.name}: measuring the gain on unseen runs")
    tolerance = tolerance or Tolerance()
    parts = held_out_parts(channel, problem, found.plain)
    found, gain, unborne = _borne_out(channel, ready, found, parts, tolerance.of(channel.quantity.unit))
    sigma = found.best.score.discrepancy
    adequacy, plain_adequacy = (judge(problem, one.fit) for one in (found.best, found.plain))
    remainder = measure_remainder(problem, found.best.fit, ready.noise, adequacy, gain, tolerance, sigma)
    final = _final(problem, found.best, remainder.significant)
    causes = _causes(ready, found, final)
    forms = stated(problem, found, final)
    restless = (bursts(problem.channel, ready.noise, remainder.tolerance), *hums)
    shown = (*ready.shown, *(one for one in restless if one is not None))
    parted = [f for f in findings if f.kind == PARTED and f.channel in (None, channel.name)]
    unsettled = mostly_unsettled(channel)
    standing = Standing(
        named=len(causes),
        forms=len(forms),
        shown=len(shown),
        left_over=remainder.significant and remainder.material,
        parted=bool(parted),
        unsettled=bool(unsettled),
        borne_out=gain.measured,
        claims=any(not CATALOGUE[c.effect].candidacy.shape for c in causes),
    )
    said = verdict(standing)
    stands = Predicting(found.best, final, causes, (*forms, *shown))
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
        predicting=stands if said in SETTLED else _predicting(ready, found, stands, shown),
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
        tried=_tried(found),
        discrepancy=describe(problem, found.best.fit, ready.noise, adequacy, remainder)
        if said == "unexplained"
        else None,
    )


def _searched(channel: Channel, ready: Prepared, earlier: Earlier | None, describing: bool) -> tuple[Prepared, Search]:
    """The search, with what coarse codes do to errors; anew where a running mean of another length is likelier."""
    rough = first_look(ready.problem, ready.structure) if ready.rounds_coarsely else None
    ready = with_rounding(ready, rough)
    found = search(ready.problem, ready.structure, earlier, describing)
    averaged = likelier_average(ready, found, judge(ready.problem, found.best.fit).passed)
    if averaged is None:
        return ready, found
    ready = with_rounding(prepare(channel, averaged), rough)
    return ready, search(ready.problem, ready.structure, earlier, describing)


def _final(problem: Problem, model: Rated, than_runs: bool) -> Fit:
    """A model's fit as it is stated: as uncertain as what it is wrong by, and what it does not carry, make it."""
    return widened(problem, as_stated(problem, model.fit, bumps(problem), model.score.discrepancy, than_runs))


def _predicting(ready: Prepared, found: Search, stands: Predicting, shown: tuple[Discovered, ...]) -> Predicting:
    """The model that predicts best: of those that leave least of their runs for what they take, and the stated and the
    plain one, each fitted as it is judged, the one that then leaves least; the stated one as it stands where runs tell
    no more of any.

    A name has to be sure, a prediction only good: models whose effects say nothing may predict as well. And no name
    asks what a run would do that nobody has seen: it has none of the rates that runs have of their own.
    """
    problem, channel = ready.problem, ready.problem.channel
    first = sorted((one for one, _ in found.predictors), key=lambda one: _criterion(channel, one.fit))
    models = {id(one): one for one in (found.best, found.plain, *first[:MOST_PREDICTING])}
    tried = [(one, judged) for one in models.values() if (judged := as_judged(problem, one.fit)) is not None]
    left = [float(run_errors(channel, problem, judged).mean()) for _, judged in tried]
    before, least = float(run_errors(channel, problem, found.best.fit).mean()), min(left, default=np.inf)
    if not _loss(channel, before) - _loss(channel, least) > AS_GOOD:
        return stands
    model, judged = tried[left.index(least)]
    fit = carried(problem, model.fit, judged)
    bump = bumps(problem)
    sure = no_surer(problem, fit, bump, score(problem, fit, bump).discrepancy, than_runs=True)
    final, stated_so = widened(problem, sure), replace(found, best=model)
    return Predicting(
        model,
        final,
        _causes(ready, stated_so, final),
        (*stated(problem, stated_so, final), *shown),
        (float(np.sqrt(before)), float(np.sqrt(least))),
    )


def _loss(channel: Channel, square: float) -> float:
    """Nats against a model that leaves a mean square of the runs: each counts as as many independent errors of unknown
    size as a discrepancy has bumps, since what a model is wrong by is no noise: it is there again in the next run."""
    return 0.5 * BUMP_COUNT * channel.runs * float(np.log(max(square, LEAST_SQUARE)))


def _criterion(channel: Channel, found: Fit) -> float:
    """Schwarz's criterion, halved [nats], of what a fit leaves at its runs' own rates (doi 10.1214/aos/1176344136).
    Endless for a fit that led to no number."""
    price = 0.5 * found.theta.size * np.log(BUMP_COUNT * channel.runs)
    loss = _loss(channel, float(squares_of_bins(channel, found.residual).mean())) + price
    return float("inf") if np.isnan(loss) else float(loss)


def _borne_out(
    channel: Channel, ready: Prepared, found: Search, parts: Sequence[HeldOutPart], tolerance: float
) -> tuple[Search, Gain, tuple[str, ...]]:
    """The search with the likeliest model that runs held out do not refute, in the end the plain one; what it gains on
    them, and a sentence on the likeliest where it is refuted."""
    unborne, unit = tuple[str, ...](), channel.quantity.unit
    tied = [one for one in found.tied() if one is not found.best and one is not found.plain]
    for one in (found.best, *tied[:MOST_IN_PLACE], found.plain):
        gain = measure_gain(channel, parts, one, ready.noise)
        if one is found.plain or not refuted(gain, tolerance):
            break
        unborne = unborne or (
            "How single readings go speaks for more than the plain model. But with the rate that other runs give it, "
            f"such a model misses runs held out by {gain.after:.2g} {unit}, and the plain one by {gain.before:.2g} "
            f"{unit}: it is not stated. See that all runs are of one sensor in one airflow, and record more of them.",
        )
    return replace(found, best=one), gain, unborne


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
            causes.append(Cause(effect, _uncertain(finding.parameters), 1.0, evidence=finding.evidence))
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
        probability = round(found.probability(effect), 4)
        gained = found.best.value - without
        causes.append(Cause(effect, _uncertain(own), probability, tuple(instead), ends, nats=gained))
    return tuple(causes)


def _uncertain(values: Mapping[str, tuple[float, float]]) -> dict[str, Uncertain]:
    return {name: Uncertain(value, spread) for name, (value, spread) in values.items()}


def _tried(found: Search) -> dict[str, str]:
    """Effects that come next to the best model and are not in it, and why not."""
    said: dict[str, str] = {}
    for one, weight in zip(found.pool, found.weights, strict=True):
        more = {id_ for id_ in one.ids - found.best.ids if not is_described(id_)}
        if one.ids > found.best.ids and len(one.ids) == len(found.best.ids) + 1 and weight > LEAST_TRIED:
            said |= {e: f"unseen runs bear it out with a probability of {found.probability(e):.2f}" for e in more}
    return said


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


def next_experiments(channel: ChannelDiagnosis) -> list[dict[str, object]]:
    """Runs that would tell the channel's tied explanations apart; empty where nothing is tied."""
    pairs = [(channel.search.best.fit, rival.fit) for rival in channel.search.rivals()]
    described = channel.verdict == "described" and channel.final.structure.effects
    return [*propose(channel.problem, channel.noise, pairs), *(unseen(channel.problem.channel) if described else [])]
