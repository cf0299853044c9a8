"""The diagnosis of a campaign, channel by channel: search, judge what is left, measure the gain on runs not seen.

Everything below is a function of the campaign's files alone. A cause is named only where unseen runs are predicted
better with it: what is tried and does not help there is dropped, and said to have been tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import special

from shockrig.analysis.characterization.response_times import response_time
from shockrig.analysis.characterization.shifts import widened
from shockrig.analysis.checks.checked import Checked, checked
from shockrig.analysis.diagnosis.adequacy import Adequacy, describe, judge
from shockrig.analysis.diagnosis.describing import MOST_FITS, Description, alternatives, describe_rest
from shockrig.analysis.diagnosis.experiments import propose, unseen
from shockrig.analysis.diagnosis.gain import Gain, measure_gain, plainly, run_errors, worse_without
from shockrig.analysis.diagnosis.limits import air_of_a_film_unknown, cannot_tell, ended, own_temperature_unknown
from shockrig.analysis.diagnosis.naming import Doubt, doubts, from_rivals
from shockrig.analysis.diagnosis.placing import weighed_alike
from shockrig.analysis.diagnosis.prepare import Prepared, likelier_average, prepare, with_rounding
from shockrig.analysis.diagnosis.refitting import refit
from shockrig.analysis.diagnosis.remainder import Remainder, Tolerance, measure_remainder, predicted_badly
from shockrig.analysis.diagnosis.restless import nothing_else, restless
from shockrig.analysis.diagnosis.search import (
    Earlier,
    Search,
    at_bound,
    refused,
    says_nothing,
    search,
    search_twice,
)
from shockrig.analysis.diagnosis.thresholds import TIE, level, penalty
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.effect import Finding, unchanged
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.gather import build_channel, usable_runs, why_none
from shockrig.analysis.inference.noise import Noise
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.quantity import QUANTITIES, ChannelName
from shockrig.analysis.inference.work import Work, cost_of_a_fit
from shockrig.files.campaign import Campaign
from shockrig.files.diagnosis import StatedDiagnosis
from shockrig.files.diagnosis_data import Discovered
from shockrig.files.errors import InputError

NO_STEP = "no usable run with a step of the air"
MOST_CERTAIN = 0.995
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Cause:
    """One named cause: parameters as (value, standard uncertainty), its probability, and who could stand in its
    place."""

    effect: str
    parameters: dict[str, tuple[float, float]]
    probability: float
    indistinguishable_from: tuple[str, ...]
    evidence: float
    at_bound: tuple[str, ...] = ()
    why: str = ""


@dataclass(frozen=True)
class Tried:
    """An effect that lowers the misfit and is not named, and why."""

    effect: str
    why: str


@dataclass(frozen=True)
class ChannelDiagnosis:
    """The verdict on one channel with everything it rests on."""

    name: ChannelName
    verdict: str
    causes: tuple[Cause, ...]
    gain: Gain
    search: Search
    adequacy: Adequacy
    plain_adequacy: Adequacy
    remainder: Remainder
    problem: Problem
    noise: Noise
    plain: Fit
    final: Fit
    untestable: tuple[str, ...]
    cannot_tell: tuple[str, ...] = ()
    tried: tuple[Tried, ...] = ()
    discrepancy: dict[str, object] | None = None
    described: Description | None = None
    humming: tuple[Discovered, ...] = ()
    work: Work = field(default_factory=Work)

    @property
    def discovered(self) -> tuple[Discovered, ...]:
        """Effects that nobody listed, as the diagnosis states them."""
        return (*(() if self.described is None else self.described.discovered), *self.humming)


@dataclass(frozen=True)
class Diagnosis:
    """The diagnosis of a campaign."""

    campaign: str
    channels: tuple[ChannelDiagnosis, ...]
    next_experiments: tuple[dict[str, object], ...] = ()
    missing: tuple[ChannelName, ...] = ()
    input_findings: tuple[str, ...] = ()


def diagnose_channel(
    channel: Channel,
    progress: Progress = lambda _: None,
    tolerance: Tolerance | None = None,
    earlier: Earlier | None = None,
    describing: bool = True,
    anew: bool = True,
    twice: bool = False,
    ready: Prepared | None = None,
) -> ChannelDiagnosis:
    """Diagnose one channel; `earlier` is what an earlier diagnosis of its runs named, where the search then begins.
    Where it shall begin from nothing too (`twice`) the likelier outcome counts. `ready` is the channel prepared, where
    that has been done.

    What no catalogued effect explains is described only where `describing`: that takes longer than all the rest. Where
    a form of the grammar that does well there is the law of a catalogued effect, the search begins again from that
    effect (`anew`), once.
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
    kept = _kept(channel, ready, found, adequacy)
    if kept.final is not found.final:
        adequacy = judge(ready.problem, kept.final, ready.noise)
    remainder = measure_remainder(ready.problem, kept.final, ready.noise, adequacy, kept.gain, tolerance or Tolerance())
    spoilt = remainder.significant and remainder.material
    left = spoilt or not adequacy.passed
    # What no other run has borne out tells of a shape and does not explain.
    untried = any(CATALOGUE[c.effect].shape for c in kept.causes) and not kept.gain.measured
    verdict = "unexplained" if spoilt or untried else "explained" if kept.causes else "adequate"
    described, work = None, Work(MOST_FITS / cost_of_a_fit(ready.problem, ready.structure))
    told = _doubts(ready, kept, work) if describing else []
    doubted = [one.cause for one in told if one.outdone]

    def from_the_law(missed: Earlier | None, reached: Fit, descriptions: int) -> ChannelDiagnosis | None:
        if missed is None or not anew:
            return None
        progress(f"{channel.name}: searching the catalogue again, from the law of an effect that it had missed")
        again = diagnose_channel(channel, progress, tolerance, missed, describing, anew=False)
        more = 0 if again.described is None else len(again.described.discovered)
        fewer = more < descriptions or not descriptions
        new = set(missed) - set(kept.final.structure.ids)
        return again if fewer and _does_as_well(again, ready, new, reached) else None

    if (again := from_the_law(from_rivals(told), kept.final, 0)) is not None:
        return again
    kept = _tied(kept, told)
    if (spoilt or doubted) and describing:
        progress(f"{channel.name}: describing what no catalogued effect explains")
        less = _without(channel, ready, found, kept, doubted)
        described = describe_rest(
            channel, ready.problem, ready.noise, found.plain, less.final, less.gain, tolerance or Tolerance(), work
        )
        if described is not None:
            again = from_the_law(described.listed, described.fit, len(described.discovered))
            if again is not None:
                return again
        kept = kept if described is None else _beside(less, described)
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
        + ended(found, work)
        + tuple(d.sentence for d in told if d.form is not None and d.cause in {c.effect for c in kept.causes}),
        tried=kept.tried,
        discrepancy=describe(ready.problem, kept.final, ready.noise, adequacy) if left else None,
        described=described,
        humming=(*ready.shown, *humming),
        work=work,
    )


def _doubts(ready: Prepared, kept: _Kept, work: Work) -> list[Doubt]:
    """What plain behaviours, which claim no cause, say against those that are named."""
    shown = {finding.effect for finding in ready.findings}
    claims = (c.effect for c in kept.causes if c.effect not in shown and not CATALOGUE[c.effect].shape)
    return doubts(ready.problem, kept.final, claims, work)


def _does_as_well(again: ChannelDiagnosis, ready: Prepared, missed: set[str], reached: Fit) -> bool:
    """Whether a search that began with what the first had missed names it, with nothing more left than that left."""
    same = again.noise.averaged == ready.noise.averaged
    named = {cause.effect for cause in again.causes}
    return same and missed <= named and again.final.deviance < reached.deviance + TIE


def _without(channel: Channel, ready: Prepared, found: Search, kept: _Kept, doubted: list[str]) -> _Kept:
    """What is kept without the causes `doubted`."""
    if not doubted:
        return kept
    final = _reduced(ready.problem, found, kept.final, set(kept.final.structure.ids) - set(doubted))
    gain = measure_gain(channel, ready.problem, ready.structure, found.plain, final, ready.noise, choose=False)
    tried = (*kept.tried, *(Tried(e, "a behaviour that nobody listed does better in its place") for e in doubted))
    return _Kept(tuple(c for c in kept.causes if c.effect not in doubted), final, gain, tried)


def _tied(kept: _Kept, told: list[Doubt]) -> _Kept:
    """What is kept, with the odds of each cause beside catalogued effects of like law and beside plain behaviours."""
    by, causes = {one.cause: one for one in told}, []
    for cause in kept.causes:
        doubt = by.get(cause.effect)
        if doubt is not None:
            most = cause.probability if doubt.form is None else min(cause.probability, level("outdone"))
            rivals = sorted(doubt.rivals.keys() - set(cause.indistinguishable_from), key=doubt.rivals.__getitem__)
            alike = (*cause.indistinguishable_from, *rivals)
            cause = replace(cause, probability=most * doubt.share(rivals), indistinguishable_from=alike)
        causes.append(cause)
    return replace(kept, causes=tuple(causes))


def _beside(kept: _Kept, described: Description) -> _Kept:
    """What may be named beside a description: the causes that its model carries too, with its parameters."""
    values = described.fit.values()
    causes = tuple(replace(c, parameters=values[c.effect]) for c in kept.causes if c.effect in values)
    lost = [c.effect for c in kept.causes if c.effect not in values]
    tried = (*kept.tried, *(Tried(e, "one described behaviour explains what it did, and the rest") for e in lost))
    return _Kept(causes, described.fit, described.gain, tried)


@dataclass(frozen=True)
class _Kept:
    """What of a search may be named: the causes, the model that carries them, its gain, and what was dropped."""

    causes: tuple[Cause, ...]
    final: Fit
    gain: Gain
    tried: tuple[Tried, ...]


def _kept(channel: Channel, ready: Prepared, found: Search, adequacy: Adequacy) -> _Kept:
    """The causes that unseen runs bear out."""
    problem, base, final = ready.problem, ready.structure, found.final
    tried: list[Tried] = []
    from_readings = {f.effect: _from_readings(f) for f in ready.findings}
    choose, described = adequacy.passed, dict[str, Cause]()
    named = _named(problem, found, adequacy)
    while not adequacy.passed:
        # Without an effect more is left, beside which others may no longer be certain.
        doubtful = [e for e, c in named.items() if e in final.structure.ids and not _certain(c, adequacy, channel)]
        if not doubtful:
            break
        tried += [Tried(e, "it helps, and is not certain beside what is left unexplained") for e in doubtful]
        final, shapes = _with_shapes(problem, found, final, named, doubtful)
        described |= shapes
        adequacy = judge(problem, final, ready.noise)
        named = _named(problem, found, adequacy) | described
    plain_case = adequacy.passed and problem.channel.runs >= level("many_runs")
    while True:
        gain = measure_gain(channel, problem, base, found.plain, final, ready.noise, choose)
        dropped = _dropped(problem, final, gain, from_readings, plain_case)
        unproven = [] if dropped or gain.measured else _unproven(channel, problem, found.plain, final)
        if not (dropped or unproven):
            break
        tried += dropped + unproven
        if unproven:
            final, shapes = _with_shapes(problem, found, final, named, [t.effect for t in unproven])
            named |= shapes
        else:
            final = _reduced(problem, found, final, set(final.structure.ids) - {t.effect for t in dropped})
        choose = False
    if not choose and final.structure.effects:
        # Without what unseen runs do not bear out more is left, beside which explanations are told apart less well.
        beside = judge(problem, final, ready.noise)
        now = _named(problem, found, beside)
        named = {e: _no_surer(c, now[e]) if e in now else c for e, c in named.items()}
    final = weighed_alike(problem, final)
    values = widened(problem, final).values()
    causes = [
        replace(from_readings.get(e) or named[e], parameters=from_readings[e].parameters if e in from_readings else v)
        for e, v in values.items()
        if e in CATALOGUE
    ]
    if not gain.measured:
        causes = _at_most("shape_in_doubt", causes, lambda c: c.effect not in from_readings)
    if not adequacy.passed and own_temperature_unknown(channel):
        # What a film's own temperature does to its response is not known: no shape is likelier than that.
        causes = _at_most("outdone", causes, lambda c: CATALOGUE[c.effect].shape)
    if not adequacy.passed and air_of_a_film_unknown(channel):
        # Dew that nothing explains, and an air that warms and cools, bend a response as another body would.
        bodies = {e for e, effect in CATALOGUE.items() if effect.shape and not effect.thermal_reading}
        causes = _at_most("outdone", causes, lambda c: c.effect in bodies)
    return _Kept(tuple(causes), final, gain, tuple(tried))


def _at_most(name: str, causes: list[Cause], those: Callable[[Cause], bool]) -> list[Cause]:
    """Causes, `those` of them no likelier than a level by its name."""
    return [replace(c, probability=min(c.probability, level(name))) if those(c) else c for c in causes]


def _no_surer(cause: Cause, now: Cause) -> Cause:
    """A cause as it stood, no likelier than it is now and tied to what it is now tied to."""
    tied = dict.fromkeys((*cause.indistinguishable_from, *now.indistinguishable_from))
    return replace(cause, probability=min(cause.probability, now.probability), indistinguishable_from=tuple(tied))


def _with_shapes(
    problem: Problem, found: Search, now: Fit, named: dict[str, Cause], doubtful: list[str]
) -> tuple[Fit, dict[str, Cause]]:
    """The fit without doubtful causes, with the shapes that stand for them: how the response behaves can be said where
    what makes it behave so cannot."""
    keep, shapes, final = set(now.structure.ids) - set(doubtful), dict[str, Cause](), now
    for effect in doubtful:
        if effect not in found.standing:
            continue
        instead = found.standing[effect].instead
        others = (e for e in named[effect].indistinguishable_from if e not in keep)
        shape = next((e for e in others if _plain_shape(e, problem.channel)), "")
        if shape in instead and keep <= set(instead[shape].structure.ids):
            final, keep = instead[shape], {*keep, shape}
            shapes[shape] = _described(named[effect], shape, final)
    return _reduced(problem, found, final, keep), shapes


def _reduced(problem: Problem, found: Search, now: Fit, ids: set[str]) -> Fit:
    """The fit with only the effects `ids`."""
    structure = now.structure.keeping(ids)
    if structure.ids == now.structure.ids:
        return now
    # From where an effect led, no descent need lead back: without any, the fit is the one that the search began with.
    return found.plain if structure.ids == found.plain.structure.ids else refit(problem, structure, now)


def _dropped(
    problem: Problem, final: Fit, gain: Gain, from_readings: dict[str, Cause], plain_case: bool
) -> list[Tried]:
    """Effects of a model that may not be named, and why; one that unseen runs speak against goes alone."""
    values = final.values()
    # What leaves the mean response alone is told by the readings and has no part in a prediction.
    tested = [e for e in final.structure.ids if e in CATALOGUE and CATALOGUE[e].apply is not unchanged]
    if not tested:
        return []
    for effect in tested:
        if effect not in from_readings and (why := says_nothing(CATALOGUE[effect], values[effect])):
            return [Tried(effect, why)]
        if effect not in from_readings and refused(final, CATALOGUE[effect]):
            return [Tried(effect, "beside the others it is no more than what these runs are known to")]
    if not gain.measured:
        return []
    worst = [e for e in tested if not worse_without(gain, e)]
    if worst:
        least = min(worst, key=lambda e: float(np.nanmean(gain.without[e] - gain.run_kept)))
        return [Tried(least, "without it unseen runs are predicted no worse")]
    # Runs that were not fitted are half as sensitive as the fit. Where many were recorded and nothing is left, the
    # fit's evidence holds as long as they do not speak against it.
    if not (gain.real or (plain_case and gain.likely)):
        return [Tried(e, "unseen runs are not predicted better by more than runs differ") for e in tested]
    return []


def _unproven(channel: Channel, problem: Problem, plain: Fit, final: Fit) -> list[Tried]:
    """What may not stay in a model that could be tried on no other run: of a single one only the shape of its response
    can be told, where that is plain."""
    tested = [e for e in final.structure.ids if e in CATALOGUE and CATALOGUE[e].apply is not unchanged]
    claims = [e for e in tested if not _plain_shape(e, channel)]
    if claims:
        return [Tried(e, "it could not be tried on a run that was not fitted") for e in claims]
    if tested and _unsettled(problem.channel, final):
        return [
            Tried(e, "the one run ends before its response settles, where shape and plateau are one") for e in tested
        ]
    before, after = (run_errors(channel, problem, f).mean() for f in (plainly(plain), final))
    if tested and before < level("plain_to_see") * after:
        return [
            Tried(e, "it lowers the error of the one run little, and there is no other to try it on") for e in tested
        ]
    return []


def _unsettled(channel: Channel, final: Fit) -> bool:
    """Whether runs whose airs nobody recorded end while their response is still under way."""
    last = max(float(time[-1]) for time, _ in channel.samples)
    unknown = not (channel.conditions.airs_known.any() or channel.measured.any())
    return unknown and last < min(response_time(channel, final, int(g)).t98_s for g in np.unique(channel.ambient))


def _from_readings(finding: Finding) -> Cause:
    return Cause(finding.effect, finding.parameters, MOST_CERTAIN, (), np.inf, (), finding.evidence)


def _named(problem: Problem, found: Search, adequacy: Adequacy) -> dict[str, Cause]:
    values, channel = found.final.values(), problem.channel
    causes = {}
    # Beside a misfit that is no accident, what tells explanations apart must be more than what all of them leave.
    alike = TIE if adequacy.passed else max(TIE * adequacy.inflation, adequacy.excess)
    for effect, standing in found.standing.items():
        weights = np.exp(-0.5 * np.clip(np.array([0.0, *standing.rivals.values()]) * TIE / alike, 0, 200))
        in_doubt = not adequacy.passed and (CATALOGUE[effect].shape or _one_of_two_readings(effect, channel))
        most = level("shape_in_doubt") if in_doubt else MOST_CERTAIN
        real = float(special.expit(0.5 * (standing.worth - penalty(CATALOGUE[effect], channel)) + 2.0))
        causes[effect] = Cause(
            effect=effect,
            parameters=values[effect],
            probability=float(np.clip(real * weights[0] / weights.sum(), 0.01, most)),
            indistinguishable_from=tuple(standing.alike(alike)),
            evidence=standing.necessity,
            at_bound=at_bound(CATALOGUE[effect], {name: value for name, (value, _) in values[effect].items()}),
        )
    return causes


def _one_of_two_readings(effect: str, channel: Channel) -> bool:
    """Whether an effect says how a film that is not known reads while its temperature changes: there are other ways."""
    return bool(CATALOGUE[effect].thermal_reading) and not channel.known_sensor


def _plain_shape(effect: str, channel: Channel) -> bool:
    """Whether an effect only says how the response behaves, in a sensor where that is as likely as anything."""
    return CATALOGUE[effect].shape and not CATALOGUE[effect].rarity(channel)


def _described(cause: Cause, shape: str, fitted: Fit) -> Cause:
    """The shape that stands for a cause that is not certain."""
    others = (cause.effect, *(e for e in cause.indistinguishable_from if e != shape))
    probability = min(cause.probability, level("shape_in_doubt"))
    return replace(
        cause, effect=shape, indistinguishable_from=others, probability=probability, parameters=fitted.values()[shape]
    )


def _certain(cause: Cause, adequacy: Adequacy, channel: Channel) -> bool:
    """Whether a cause keeps its name beside something unexplained: only what dwarfs it does.

    A steady error is never certain beside an unknown remainder, a straight line soaks up part of anything; nor is an
    average, which is told from noise that the remainder may be part of. What only says how the response behaves does
    not claim a cause, where the body is not known.
    """
    effect = CATALOGUE[cause.effect]
    if _plain_shape(cause.effect, channel):
        return True
    if effect.steady or effect.averages or cause.indistinguishable_from:
        return False
    return cause.evidence > level("certain_excess") * adequacy.excess + level("certain_least")


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
