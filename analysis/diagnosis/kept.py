"""What of a search may be named: the causes that unseen runs bear out, and what was tried and dropped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from shockrig.analysis.characterization.response_times import response_time
from shockrig.analysis.characterization.shifts import widened
from shockrig.analysis.diagnosis.adequacy import Adequacy, judge
from shockrig.analysis.diagnosis.describing import Description
from shockrig.analysis.diagnosis.diagnosed import MOST_CERTAIN, Cause, Tried
from shockrig.analysis.diagnosis.gain import Gain, measure_gain, plainly, run_errors, worse_without
from shockrig.analysis.diagnosis.limits import air_of_a_film_unknown, own_temperature_unknown
from shockrig.analysis.diagnosis.naming import Doubt
from shockrig.analysis.diagnosis.placing import weighed_alike
from shockrig.analysis.diagnosis.prepare import Prepared
from shockrig.analysis.diagnosis.refitting import refit
from shockrig.analysis.diagnosis.search import (
    Search,
    at_bound,
    refused,
    says_nothing,
)
from shockrig.analysis.diagnosis.thresholds import TIE, level, penalty
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.effect import Finding, unchanged
from shockrig.analysis.inference.fit import Fit, fit
from shockrig.analysis.inference.problem import Problem

FEWEST_TO_LEAVE_OUT, PARTS_LEFT_OUT = 3, 10  # runs, and parts of them that are left out one after the other


def without_doubted(channel: Channel, ready: Prepared, found: Search, kept: Kept, doubted: list[str]) -> Kept:
    """What is kept without the causes `doubted`."""
    if not doubted:
        return kept
    final = _reduced(ready.problem, found, kept.final, set(kept.final.structure.ids) - set(doubted))
    gain = measure_gain(channel, ready.problem, ready.structure, found.plain, final, ready.noise, choose=False)
    tried = (*kept.tried, *(Tried(e, "a behaviour that nobody listed does better in its place") for e in doubted))
    return Kept(tuple(c for c in kept.causes if c.effect not in doubted), final, gain, tried)


def in_doubt(kept: Kept) -> Kept:
    """What is kept beside a remainder that matters: what only says how the response behaves is certain no longer."""
    most_left = kept.gain.measured and kept.gain.explained_fraction < 0.5
    name = "shape_beside_most" if most_left else "shape_in_doubt"
    return replace(kept, causes=tuple(_at_most(name, kept.causes, lambda c: CATALOGUE[c.effect].shape)))


def tied(kept: Kept, told: list[Doubt]) -> Kept:
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


def beside_described(kept: Kept, described: Description) -> Kept:
    """What may be named beside a description: the causes that its model carries too, with its parameters."""
    values = described.fit.values()
    causes = tuple(replace(c, parameters=values[c.effect]) for c in kept.causes if c.effect in values)
    lost = [c.effect for c in kept.causes if c.effect not in values]
    tried = (*kept.tried, *(Tried(e, "one described behaviour explains what it did, and the rest") for e in lost))
    return Kept(causes, described.fit, described.gain, tried)


def no_surer_than_runs(problem: Problem, kept: Kept) -> Kept:
    """What is kept by a model that misses the runs, its parameters no surer than leaving runs out in turn moves them.

    The fit itself counts the noise alone, as if runs differed by nothing else; of fewer than three runs nothing is left
    to say by how much they do.
    """
    runs, final = problem.channel.runs, kept.final
    if runs < FEWEST_TO_LEAVE_OUT or not kept.causes:
        return kept
    part = np.arange(runs) % min(runs, PARTS_LEFT_OUT)
    parts = [part != left_out for left_out in np.unique(part)]
    fits = [fit(problem.select(some), final.structure, final.theta, final.deviations[some]).values() for some in parts]
    causes = []
    for cause in kept.causes:
        unsure = {}
        for name, (value, u) in cause.parameters.items():
            moved = np.array([f[cause.effect][name][0] for f in fits if cause.effect in f])
            jackknife = np.sqrt((moved.size - 1.0) * moved.var()) if moved.size else 0.0
            unsure[name] = (value, float(max(u, jackknife)))
        causes.append(replace(cause, parameters=unsure))
    return replace(kept, causes=tuple(causes))


@dataclass(frozen=True)
class Kept:
    """What of a search may be named: the causes, the model that carries them, its gain, and what was dropped."""

    causes: tuple[Cause, ...]
    final: Fit
    gain: Gain
    tried: tuple[Tried, ...]


def kept_of(channel: Channel, ready: Prepared, found: Search, adequacy: Adequacy) -> Kept:
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
        dropped = _dropped(problem, final, gain, from_readings, plain_case, adequacy.passed)
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
        # What brings less than all of them leave may be there to make up for that, and no other run says it is not.
        least = 0.0 if adequacy.passed else adequacy.excess
        causes = _at_most("shape_beside_most", causes, lambda c: c.effect not in from_readings and c.evidence < least)
    if not adequacy.passed and own_temperature_unknown(channel):
        # What a film's own temperature does to its response is not known: no shape is likelier than that.
        causes = _at_most("outdone", causes, lambda c: CATALOGUE[c.effect].shape)
    if not adequacy.passed and air_of_a_film_unknown(channel):
        # Dew that nothing explains, and an air that warms and cools, bend a response as another body would.
        bodies = {e for e, effect in CATALOGUE.items() if effect.shape and not effect.thermal_reading}
        causes = _at_most("outdone", causes, lambda c: c.effect in bodies)
    return Kept(tuple(causes), final, gain, tuple(tried))


def _at_most(name: str, causes: Sequence[Cause], those: Callable[[Cause], bool]) -> list[Cause]:
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
    problem: Problem, final: Fit, gain: Gain, from_readings: dict[str, Cause], plain_case: bool, passed: bool
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
    # fit's evidence holds as long as they do not speak against it. Beside a misfit that nothing explains, what it takes
    # off that misfit has to be more than a trace of it.
    if not (gain.real or (plain_case and gain.likely)) or (not passed and gain.trace):
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
