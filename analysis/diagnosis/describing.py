"""From a verdict that would be `unexplained` to a description, where one holds: the search for it, its gain, what it
leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from shockrig.analysis.diagnosis.adequacy import Adequacy, judge
from shockrig.analysis.diagnosis.beside import alone, cost, without_idle
from shockrig.analysis.diagnosis.gain import Gain, measure_gain, worse_without
from shockrig.analysis.diagnosis.naming import from_description
from shockrig.analysis.diagnosis.remainder import Remainder, Tolerance, measure_remainder
from shockrig.analysis.diagnosis.search import Earlier
from shockrig.analysis.discovery.discover import TIE, Discovery, discover
from shockrig.analysis.discovery.race import Candidate
from shockrig.analysis.discovery.stating import nearest_of, stated
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.noise import Noise
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.work import Work
from shockrig.files.diagnosis_data import Discovered

# Of the search for a description, beside named causes and without them together; an ordinary campaign takes a third.
MOST_FITS = 1200
MOST = 0.9  # of what unseen runs show above the noise: what a description that does not end it must account for


@dataclass(frozen=True)
class Description:
    """What was described, as it is stated, with the tests, the gain and the remainder of the model that carries it.

    `listed` is where the search of the catalogue begins again, where a description is the law of an effect in it.
    """

    discovery: Discovery
    discovered: tuple[Discovered, ...]
    adequacy: Adequacy
    gain: Gain
    remainder: Remainder
    listed: Earlier | None = None

    @property
    def fit(self) -> Fit:
        """Of the model with the described effects."""
        return self.discovery.fit


def describe_rest(
    channel: Channel,
    problem: Problem,
    noise: Noise,
    plain: Fit,
    named: Fit,
    gain: Gain,
    tolerance: Tolerance,
    work: Work | None = None,
    known: Sequence[Candidate] = (),
) -> Description | None:
    """Describe what the model `named` leaves, or what the plain one does where that takes less; None where nothing
    holds on conditions and runs that it was not fitted to.

    `channel` is the channel as recorded, `gain` that of `named`; `work` says how many fits may be made; `known` are
    forms that did better than a name which `named` has no more.
    """

    def left(found: Fit) -> Adequacy:
        return judge(problem, found, noise)

    found = discover(problem, named, left, work, known)
    if named.structure.ids != plain.structure.ids:
        if found is None or not found.passed or len(found.effects) > 1 or alone(problem, plain, found):
            other = discover(problem, plain, left, work, known)
            found = other if other is not None and _plainer(problem, plain, found, other) else found
        found = None if found is None else without_idle(problem, plain, found)
    if found is None:
        return None
    # A description stands in the structure that the folds begin from: they fit it again and try each without it.
    reached = measure_gain(channel, problem, found.fit.structure, plain, found.fit, noise, choose=False)
    if reached.measured and (
        reached.after >= gain.after or not all(worse_without(reached, one.effect.id) for one in found.effects)
    ):
        return None
    adequacy = left(found.fit)
    remainder = measure_remainder(problem, found.fit, noise, adequacy, reached, tolerance)
    before, after, floor = (x**2 for x in (gain.after, reached.after, reached.noise_floor))
    if remainder.significant and remainder.material and before - after < MOST * (before - floor):
        return None  # what leaves most of it describes something else
    share = reached.explained_fraction if len(found.effects) == 1 and not named.structure.ids else None
    nearest = nearest_of(problem, found)
    discovered = stated(problem, found, nearest)
    if share is not None:
        discovered = tuple(replace(one, explained_fraction=round(share, 4)) for one in discovered)
    return Description(found, discovered, adequacy, reached, remainder, from_description(found, nearest))


def alternatives(described: Description) -> list[tuple[Fit, Fit]]:
    """Pairs of fits that further runs should tell apart: the description, and each that does as well."""
    return [(described.fit, other.fit) for one in described.discovery.effects for other in one.instead]


def _plainer(problem: Problem, plain: Fit, found: Discovery | None, other: Discovery) -> bool:
    """Whether a description without the named causes does better than one beside them."""
    if found is None:
        return other.passed
    if other.passed != found.passed:
        return other.passed
    return cost(problem, plain, other.fit) < cost(problem, plain, found.fit) - TIE
