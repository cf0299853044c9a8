"""A channel made ready to be searched: what its single readings show is taken care of, its noise known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnose.candidates import log_prior
from shockrig.analysis.diagnose.grammar import seen_over
from shockrig.analysis.diagnose.pool import Search
from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import described, discovered_of
from shockrig.analysis.effects.forms import MEAN
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.coarse_codes import with_errors_of_codes
from shockrig.analysis.estimate.driven_air import with_reference_noise
from shockrig.analysis.estimate.effect import Effect, Finding, SingleReadings
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.model import Held, Structure
from shockrig.analysis.estimate.noise import (
    AVERAGED_KNOWN_TO,
    COARSE_IN_NOISE,
    MAX_AVERAGED,
    Noise,
    airs_open,
    estimate_noise,
    longest_average,
    whiteners,
)
from shockrig.analysis.estimate.predictive import bumps, score
from shockrig.analysis.estimate.problem import Problem, make_problem
from shockrig.analysis.estimate.refitting import refit
from shockrig.analysis.estimate.without_model import coarser_than_the_sensor, known_to, rounding_step
from shockrig.files.diagnosis_data import Discovered, EffectSize

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Prepared:
    """A channel ready to be searched. `step` is what its readings are rounded to, and `rounds_coarsely` whether that is
    coarse beside the noise; `shown` is what single readings show and no cause of the catalogue accounts for."""

    problem: Problem
    noise: Noise
    structure: Structure
    findings: tuple[Finding, ...]
    step: float
    rounds_coarsely: bool
    shown: tuple[Discovered, ...] = ()


def prepare(channel: Channel, averaged: int | None = None) -> Prepared:
    """Precheck of the readings. `averaged` takes the logger to average over so many, whatever its noise says."""
    known, findings = SingleReadings(channel, rounding_step(channel)), []
    # From the log back to the air: what the logger did last is undone first.
    for effect in reversed(CATALOGUE.values()):
        if effect.readout.in_readings and channel.name in effect.channels:
            known, finding = effect.readout.in_readings(known)
            findings += [finding] if finding else []
    lengths = () if averaged is None else (averaged,)
    noise = estimate_noise(known.channel, known.step or channel.quantity.resolution, lengths, averaged)
    known = replace(known, noise=noise)
    for effect in CATALOGUE.values():
        if effect.readout.in_noise and channel.name in effect.channels and (finding := effect.readout.in_noise(known)):
            findings.append(finding)
    coarsely = known.step > COARSE_IN_NOISE * noise.standard_deviation
    if coarsely:
        noise = estimate_noise(known.channel, known.step, averaged=averaged, coarse=True)
    problem = make_problem(known.channel, whiteners(known.channel, noise), rounding=known.step if coarsely else 0.0)
    if channel.measured.any():
        # What the reference's noise does to a prediction is noise to whoever compares it with a reading.
        noise = with_reference_noise(noise, problem)
        problem = make_problem(known.channel, whiteners(known.channel, noise), rounding=known.step if coarsely else 0.0)
    held = tuple(Held(f.effect, name, value) for f in findings for name, (value, _) in f.parameters.items())
    structure = Structure(tuple(CATALOGUE[f.effect] for f in findings), held)
    # Readings that hang together as those of a mean do, or are rounded, and come of nothing that the catalogue has.
    shown, entries = [], [CATALOGUE[f.effect] for f in findings]
    if noise.averaged > 1 and not any(entry.readout.averages for entry in entries):
        mean, period_s = described(MEAN.key, known.channel.jumps_with_air), known.channel.reading_period_s
        over_s = noise.averaged * period_s
        structure = structure.adding(mean, Held(mean.id, mean.parameters[0].name, over_s))
        shown.append(discovered_of(mean, {mean.parameters[0].name: (over_s, AVERAGED_KNOWN_TO * period_s)}))
    if coarser_than_the_sensor(known.channel, known.step) and not any(entry.readout.rounded_to for entry in entries):
        size = EffectSize(known.step, known_to(known.step), known.channel.quantity.unit)
        shown.append(Discovered("offset", "own_response", size=size))
    stated = tuple(replace(one, probability=1.0, seen_over=seen_over(problem.channel)) for one in shown)
    return Prepared(problem, noise, structure, tuple(findings), known.step, coarsely, stated)


def with_rounding(ready: Prepared, rough: Fit | None) -> Prepared:
    """The same with what a coarse rounding does to errors, where something like the signal is known: that of the fit
    `rough`."""
    if rough is None:
        return ready
    problem, noise = with_errors_of_codes(ready.problem, ready.noise, rough)
    return replace(ready, problem=problem, noise=noise)


def _averaging(channel: Channel) -> tuple[Effect, float]:
    """The entry of the catalogue that is a running mean, a plain one where it holds none; and the size of its number
    for one reading."""
    for entry in CATALOGUE.values():
        if entry.readout.averages:
            return entry, 1.0
    return described(MEAN.key, channel.jumps_with_air), channel.reading_period_s


def likelier_average(before: Prepared, found: Search, adequate: bool) -> int | None:
    """Length of a running mean that, by response and noise together, explains a channel better than `found`; or None.

    Where rounding hides the noise, only the response shows that a logger averages; a ramp of the air looks much alike.
    Nor does the noise tell how long a mean is where few of its readings are shown.
    """
    problem, channel, now = before.problem, before.problem.channel, before.noise.averaged
    # Air that nobody recorded may have changed as slowly as any mean would show it.
    if airs_open(channel) or channel.measured.any() or (now > 1 and channel.readings_per_sample == 1):
        return None
    whole, own = found.best.fit.structure, set(before.structure.ids)
    lengths, alike = set(), set()
    for id_, parameters in found.best.fit.values().items():
        if id_ in CATALOGUE and (looks := CATALOGUE[id_].readout.like_average) is not None:
            lengths |= looks({name: value for name, (value, _) in parameters.items()}, channel.reading_period_s)
            alike.add(id_)
    if not lengths and adequate:
        return None
    likely, rounding = before.noise.log_likelihood_by_average, before.step or channel.quantity.resolution
    near = likely > likely[now - 1] - level("average_unlikely")
    lengths |= {int(n) + 1 for n in np.flatnonzero(near | (now > 1))}
    lengths = {n for n in lengths if 2 <= n <= longest_average(channel)} - {now}
    if not lengths:
        return None
    if before.noise.increment < level("hidden_noise") * rounding:
        # Readings that mostly repeat the one before: what rounding leaves of the noise is not that of any model.
        likely = np.zeros(MAX_AVERAGED)
    else:
        likely = estimate_noise(channel, rounding, (now, *lengths)).log_likelihood_by_average
    average, of_one = _averaging(channel)
    added = {effect.id: _price(effect, channel) for effect in whole.effects if effect.id not in own}
    best, cost, bump = None, -2.0 * found.best.score.total + sum(added.values()), bumps(problem)
    # What stands beside what looks like a mean may itself be there for want of one.
    for ids in dict.fromkeys((frozenset(whole.ids) - alike - {average.id}, frozenset(own - {average.id}))):
        kept, nearest = whole.keeping(ids), found.plain if ids == own - {average.id} else found.best
        start = refit(problem, kept, nearest.fit, iterations=4)
        paid = sum(added.get(e, 0.0) for e in ids) + (_price(average, channel) if now == 1 else 0.0)
        for n in sorted(lengths):
            # What a wrong model gains by a mean says nothing against noise that is plainly that of single readings.
            if (unlikelier := likely[now - 1] - likely[n - 1]) >= level("average_unlikely"):
                continue
            held = Held(average.id, average.parameters[0].name, n * of_one)
            trial = refit(problem, kept.adding(average, held), start)
            # On unseen runs, as everything: what a wrong model is likelier by on its own is thousands of nats.
            total = -2.0 * score(problem, trial, bump).total + 2.0 * unlikelier + paid
            if total < cost - level("average_gain"):
                cost, best = total, n
    return best


def _price(effect: Effect, channel: Channel) -> float:
    """Twice the nats that an effect must gain, from its log prior."""
    return -2.0 * log_prior(effect, channel, 1)
