"""The diagnosis of a campaign, channel by channel: search, judge what is left, measure the gain on runs not seen.

Everything below is a function of the campaign's files alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.characterization.characterize import LEAST_STEP, step_size
from shockrig.analysis.diagnosis import readings
from shockrig.analysis.diagnosis.adequacy import Adequacy, describe, judge
from shockrig.analysis.diagnosis.experiments import propose
from shockrig.analysis.diagnosis.gain import Gain, measure_gain
from shockrig.analysis.diagnosis.search import Search, at_bound, evidence, price, refit, search
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import Channel, ChannelName, build_channel
from shockrig.analysis.inference.gls import Fit, Layout, Problem, make_problem, run_misfit
from shockrig.analysis.inference.noise import MAX_AVERAGED, Noise, estimate_noise, whiteners
from shockrig.analysis.inference.rounding import COARSE_IN_NOISE
from shockrig.analysis.inference.samples import model_at_samples
from shockrig.files.campaign import Campaign
from shockrig.files.errors import InputError

Array = NDArray[np.float64]
STEADY = ("calibration_error", "self_heating", "hysteresis", "radiative_heating")
NOT_GAUSSIAN = 1.5  # codes are less certain evidence than their variance says
HIDDEN_BY_ROUNDING = 0.5  # of the step: less noise than this from reading to reading cannot be told from rounding
LEAST_RUNS = 3
TOO_FEW = "fewer than three usable runs with a step of the air"
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
class Prepared:
    """A channel ready to be searched: what its readings show is taken care of. `step` is what they are rounded to, and
    `rounds_coarsely` whether that is coarse beside the noise.
    """

    problem: Problem
    noise: Noise
    layout: Layout
    findings: tuple[readings.Finding, ...]
    step: float
    rounds_coarsely: bool


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
    problem: Problem
    noise: Noise
    plain: Fit
    final: Fit
    untestable: tuple[str, ...]
    discrepancy: dict[str, object] | None = None


@dataclass(frozen=True)
class Diagnosis:
    """The diagnosis of a campaign."""

    campaign: str
    channels: tuple[ChannelDiagnosis, ...]
    next_experiments: tuple[dict[str, object], ...] = ()
    missing: tuple[str, ...] = ()


def prepare(channel: Channel, averaged: int | None = None) -> Prepared:
    """Precheck of the readings. `averaged` takes the logger to average over so many, whatever its noise says."""
    step, coarse = readings.find_rounding(channel)
    mended, repeats = readings.find_repeats(channel)
    flat = readings.find_flat_top(mended, step)
    lengths = () if averaged is None else (averaged,)
    noise = estimate_noise(mended, step or readings.NORMAL_STEP[channel.name], lengths, averaged)
    average = readings.find_average(mended, noise)
    findings = tuple(f for f in (flat, average, repeats, coarse) if f is not None)
    fixed = tuple((f.effect, name, value) for f in findings for name, (value, _) in f.parameters.items())
    coarsely = coarse is not None and step > COARSE_IN_NOISE * noise.standard_deviation
    if coarsely:
        noise = estimate_noise(mended, step, averaged=averaged, coarse=True)
    problem = make_problem(mended, whiteners(mended, noise), rounding=step if coarsely else 0.0)
    return Prepared(problem, noise, Layout(tuple(f.effect for f in findings), fixed), findings, step, coarsely)


def _rounded(ready: Prepared, rough: Fit | None) -> Prepared:
    """The same with what a coarse rounding does to errors: which codes a run crosses, and when, is known once something
    like its signal is, that of the fit `rough`.
    """
    if rough is None:
        return ready
    channel = ready.problem.channel
    for _ in range(2):
        signals = model_at_samples(channel, rough)
        problem = make_problem(channel, whiteners(channel, ready.noise, signals))
        rough = refit(problem, rough.layout, rough)
    # The covariance is that of runs at any place between two codes. One that rests at the edge of a code, where noise
    # throws it from one to the other, scatters more, and by how much only the run itself tells.
    excess = np.maximum(run_misfit(problem, rough), 1.0)
    whitener = problem.whitener / np.sqrt(NOT_GAUSSIAN * excess)[:, None, None]
    return replace(ready, problem=replace(problem, whitener=whitener))


def likelier_average(before: Prepared, found: Search, adequate: bool) -> int | None:
    """Length of a running mean that, by response and noise together, explains a channel better than `found`; or None.

    Where rounding hides the noise, only the response shows that a logger averages; a ramp of the air looks much alike.
    """
    if before.noise.averaged > 1:
        return None
    problem, period = before.problem, before.problem.channel.sampling_period_s
    values = found.final.values(problem.channel.interpolation.shape[1])
    lengths = set()
    if "finite_transfer" in values:
        ramp = values["finite_transfer"]["duration_s"][0] / period
        lengths |= {int(ramp), int(ramp) + 1, int(ramp) + 2}
    if "dead_time" in values:
        lengths |= {int(2 * values["dead_time"]["delay_s"][0] / period) + k for k in (0, 1, 2)}
    if not lengths and adequate:
        return None
    likely = before.noise.log_likelihood_by_average
    lengths |= {int(n) + 1 for n in np.flatnonzero(likely > likely[0] - 40)}
    lengths = {n for n in lengths if 2 <= n <= MAX_AVERAGED}
    if not lengths:
        return None
    rounding = before.step or readings.NORMAL_STEP[problem.channel.name]
    if before.noise.increment < HIDDEN_BY_ROUNDING * rounding:
        # Readings that mostly repeat the one before: what rounding leaves of the noise is not that of any model.
        likely = np.zeros(MAX_AVERAGED)
    else:
        likely = estimate_noise(problem.channel, rounding, tuple(lengths)).log_likelihood_by_average
    kept = tuple(e for e in found.final.layout.effects if e not in ("finite_transfer", "dead_time"))
    cost = found.final.deviance + sum(price(e) for e in found.necessity)
    best = None
    for n in sorted(lengths):
        layout = Layout((*kept, "moving_average"), (*before.layout.fixed, ("moving_average", "samples", float(n))))
        trial = refit(problem, layout, replace(found.final, layout=Layout(kept, before.layout.fixed)))
        total = trial.deviance + 2 * (likely[0] - likely[n - 1]) + price("moving_average")
        total += sum(price(e) for e in kept if e in found.necessity)
        if total < cost - 6.0:
            cost, best = total, n
    return best


def diagnose_channel(channel: Channel, seed: int = 0, progress: Progress = lambda _: None) -> ChannelDiagnosis:
    """Diagnose one channel."""
    ready = prepare(channel)
    progress(f"{channel.name}: searching the catalogue")
    rough = search(ready.problem, ready.layout, thorough=False).final if ready.rounds_coarsely else None
    ready = _rounded(ready, rough)
    found = search(ready.problem, ready.layout)
    adequacy = judge(ready.problem, found.final, ready.noise)
    averaged = likelier_average(ready, found, adequacy.passed)
    if averaged is not None:
        ready = _rounded(prepare(channel, averaged), rough)
        found = search(ready.problem, ready.layout)
        adequacy = judge(ready.problem, found.final, ready.noise)
    problem, noise, base, findings = ready.problem, ready.noise, ready.layout, ready.findings
    plain_adequacy = judge(problem, found.plain, noise)
    causes = [_from_readings(f) for f in findings] + _named(problem, found)
    verdict = "explained" if causes else "adequate"
    final = found.final
    if not adequacy.passed:
        verdict = "unexplained"
        causes = _certain(causes, adequacy)
        named = tuple(e for e in final.layout.effects if e in {c.effect for c in causes})
        if named != final.layout.effects:
            # What is not named is not carried either.
            final = refit(problem, Layout(named, base.fixed), found.plain)
    progress(f"{channel.name}: measuring the gain on unseen runs")
    gain = measure_gain(channel, problem, base, final, noise, seed, choose=verdict == "explained")
    return ChannelDiagnosis(
        name=channel.name,
        verdict=verdict,
        causes=tuple(causes),
        gain=gain,
        search=found,
        adequacy=adequacy,
        plain_adequacy=plain_adequacy,
        problem=problem,
        noise=noise,
        plain=found.plain,
        final=final,
        untestable=tuple(
            e for e, effect in CATALOGUE.items() if channel.name in effect.channels and not effect.testable(channel)
        ),
        discrepancy=None if adequacy.passed else describe(problem, found.final, noise, adequacy),
    )


def _from_readings(finding: readings.Finding) -> Cause:
    return Cause(finding.effect, finding.parameters, 0.995, (), np.inf, (), finding.evidence)


def _named(problem: Problem, found: Search) -> list[Cause]:
    groups = problem.channel.interpolation.shape[1]
    values = found.final.values(groups)
    causes = []
    for effect in found.final.layout.effects:
        if effect not in found.necessity:
            continue
        rivals = found.rivals.get(effect, {})
        ties = {e: rivals[e] for e in found.ties.get(effect, {})}
        weights = np.exp(-0.5 * np.clip(np.array([0.0, *rivals.values()]), 0, 200))
        worth = evidence(problem, found.necessity[effect])
        real = 1.0 / (1.0 + np.exp(-0.5 * (worth - price(effect)) - 2.0))
        causes.append(
            Cause(
                effect=effect,
                parameters=values[effect],
                probability=float(np.clip(real * weights[0] / weights.sum(), 0.01, 0.995)),
                indistinguishable_from=tuple(sorted(ties, key=ties.__getitem__)),
                evidence=found.necessity[effect],
                at_bound=at_bound(effect, {name: value for name, (value, _) in values[effect].items()}),
            )
        )
    return causes


def _certain(causes: list[Cause], adequacy: Adequacy) -> list[Cause]:
    """Of a model that does not explain everything, only the causes that dwarf what is left keep their name.

    A steady error is never certain beside an unknown remainder, a straight line soaks up part of anything; nor is an
    average, which is told from noise that the remainder may be part of.
    """
    return [
        c
        for c in causes
        if not c.indistinguishable_from
        and c.effect not in (*STEADY, "moving_average")
        and c.evidence > 20.0 * adequacy.excess + 200.0
    ]


def enough(channel: Channel) -> bool:
    """Whether a channel's runs can be diagnosed at all: at least three with a step of the air."""
    return int((step_size(channel) >= LEAST_STEP[channel.name]).sum()) >= LEAST_RUNS


def diagnose(campaign: Campaign, seed: int = 0, progress: Progress = lambda _: None) -> Diagnosis:
    """Diagnose every channel of a campaign that has usable runs.

    Raises
    ------
    InputError
        Where no run of either sensor can be used.
    """
    found, missing = [], []
    for name in ("temperature", "humidity"):
        channel = build_channel(campaign, name)
        if channel is None or not enough(channel):
            missing.append(name)
            continue
        found.append(diagnose_channel(channel, seed, progress))
    if not found:
        raise InputError(f"{campaign.path}: {TOO_FEW} in either sensor; record more, or see shockrig status")
    experiments = [run for channel in found for run in next_experiments(channel)]
    return Diagnosis(campaign.name, tuple(found), tuple(experiments), tuple(missing))


def next_experiments(channel: ChannelDiagnosis) -> list[dict[str, object]]:
    """Runs that would tell the channel's tied explanations apart; empty where nothing is tied."""
    named = {cause.effect for cause in channel.causes}
    pairs = [
        (channel.final, rival)
        for effect, ties in channel.search.ties.items()
        if effect in named
        for rival in ties.values()
    ]
    return propose(channel.problem, pairs)
