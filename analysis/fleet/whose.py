"""Whose a cause is that diagnoses name: the bench's, the type's, or one sensor's; and which of its look-alikes it is.

What one bench does, it does to all that it carries: most probes of a campaign show it, with one value. What belongs to
a type is in most sensors too, and differs from one to the next. Values are one where that is likelier than that they
scatter as a type's do, by a share of themselves that has a half-Cauchy prior: a test of homogeneity alone would call
some benches types however little their values differ.

Effects that one diagnosis cannot tell apart are one cause here, whichever of them each probe's diagnosis names. Whose
it is then tells which: all probes feel the air and the walls around them, so that what a single one shows is not of
these, and what all of them show with one value is, before it is a fault that each of them has.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.fleet.population import LEAST_SENSORS, SPREAD_SCALE, FleetMember
from shockrig.files.causes import StatedEffect, Uncertain
from shockrig.files.fleet_file import BENCH, SENSOR, SEVERAL, TYPE, FleetCause, SharedParameter

Array = NDArray[np.float64]

MAJORITY = 0.5  # of the sensors: more than so many
SPREAD_QUANTILES = (np.arange(200) + 0.5) / 200.0  # quantiles of a type's spread that are tried


@dataclass(frozen=True)
class DiagnosedProbe:
    """One probe of one campaign whose channel was diagnosed: the sensor, where it was, and the causes named."""

    sensor: str
    campaign: str
    bench: str
    causes: tuple[StatedEffect, ...]


def causes_of(sensors: Sequence[FleetMember]) -> tuple[FleetCause, ...]:
    """Every cause that a diagnosis names, by channel and effect; none where fewer than three sensors were diagnosed."""
    found: list[FleetCause] = []
    diagnosed = [(one.name, s) for one in sensors for s in one.campaigns]
    for channel in sorted({name for _, s in diagnosed for name in s.causes}, reverse=True):
        there = [(name, s) for name, s in diagnosed if channel in s.causes]
        found += judged_causes(channel, [DiagnosedProbe(name, s.path, s.bench, s.causes[channel]) for name, s in there])
    return tuple(found)


def judged_causes(channel: str, probes: Sequence[DiagnosedProbe]) -> tuple[FleetCause, ...]:
    """Likewise of one channel's diagnoses."""
    if len({one.sensor for one in probes}) < LEAST_SENSORS:
        return ()
    found = []
    for alike in look_alikes(cause for one in probes for cause in one.causes):
        seen = [replace(one, causes=tuple(c for c in one.causes if c.effect in alike)) for one in probes]
        found.append(_judged(channel, alike, seen))
    return tuple(found)


def look_alikes(causes: Iterable[StatedEffect]) -> list[frozenset[str]]:
    """The named effects with those that some diagnosis cannot tell from them, in sets that share none."""
    sets: list[frozenset[str]] = []
    for cause in causes:
        one = frozenset({cause.effect, *cause.indistinguishable_from})
        sets = [frozenset.union(one, *(s for s in sets if s & one)), *(s for s in sets if not s & one)]
    return sorted(sets, key=min)


def _judged(channel: str, alike: frozenset[str], seen: Sequence[DiagnosedProbe]) -> FleetCause:
    having = [one for one in seen if one.causes]
    carriers, all_ = (list(dict.fromkeys(one.sensor for one in of)) for of in (having, seen))
    campaigns = list(dict.fromkeys(one.campaign for one in having))
    named = Counter(cause.effect for one in having for cause in one.causes)
    most = min(named, key=lambda effect: (-named[effect], effect))
    parameters = _parameters(having, most)
    known = bool(parameters)  # nobody can say of two values without uncertainties whether they are one
    common = known and all(one.common for one in parameters.values())
    if len(carriers) == 1:
        whose = SENSOR
    elif len(carriers) > MAJORITY * len(all_):
        # One bench with one value may be what it does; other benches do not do the same by accident.
        one_bench = len({one.bench or one.campaign for one in seen}) == 1
        whose = BENCH if one_bench and common else TYPE if known or not one_bench else SEVERAL
    else:
        beside = [one for one in seen if one.campaign in campaigns]
        together = len(campaigns) == 1 and len(beside) >= LEAST_SENSORS and len(having) > MAJORITY * len(beside)
        whose = BENCH if together and common else SEVERAL
    fits = [effect for effect in alike if whose == SEVERAL or _of_surroundings(effect) == (whose == BENCH)] or list(
        alike
    )
    effect = min(fits, key=lambda one: (-named[one], one))
    parameters = parameters if effect == most else _parameters(having, effect)
    open_, out = (tuple(sorted(alike & set(fits) - {effect})), tuple(sorted(alike - set(fits))))
    return FleetCause(channel, effect, whose, tuple(carriers), len(all_), tuple(campaigns), parameters, open_, out)


def _of_surroundings(effect: str) -> bool:
    return effect in CATALOGUE and CATALOGUE[effect].of_surroundings


def _parameters(having: Sequence[DiagnosedProbe], effect: str) -> dict[str, SharedParameter]:
    """Mean and scatter of each parameter of an effect that is stated with its uncertainty."""
    stated: dict[str, list[Uncertain]] = {}
    for cause in (cause for one in having for cause in one.causes if cause.effect == effect):
        for name, value in cause.parameters.items():
            if value.standard_uncertainty > 0.0:
                stated.setdefault(name, []).append(value)
    return {name: _shared(values) for name, values in stated.items()}


def _shared(values: Sequence[Uncertain]) -> SharedParameter:
    """The mean, and what values scatter by beyond their uncertainties (DerSimonian and Laird 1986,
    doi 10.1016/0197-2456(86)90046-2)."""
    x, u = (np.array([getattr(v, key) for v in values]) for key in ("value", "standard_uncertainty"))
    weight = 1.0 / u**2
    mean = weight @ x / weight.sum()
    Q, n = float(weight @ (x - mean) ** 2), x.size
    if n == 1:
        return SharedParameter(Uncertain(float(x[0]), float(u[0])), 0.0, True)
    variance = max((Q - (n - 1)) / (weight.sum() - (weight @ weight) / weight.sum()), 0.0)
    weight = 1.0 / (u**2 + variance)
    of_mean = Uncertain(float(weight @ x / weight.sum()), float(weight.sum() ** -0.5))
    type_has = SPREAD_SCALE * math.sqrt(float(np.mean(x**2))) * np.tan(0.5 * np.pi * SPREAD_QUANTILES)
    scattering = np.logaddexp.reduce([_restricted(x, u, spread) for spread in type_has]) - math.log(type_has.size)
    return SharedParameter(of_mean, math.sqrt(variance), bool(_restricted(x, u, 0.0) >= scattering))


def _restricted(x: Array, u: Array, spread: float) -> float:
    """ln of the restricted likelihood, but for a constant, where values scatter by so much about an unknown mean."""
    weight = 1.0 / (u**2 + spread**2)
    mean = weight @ x / weight.sum()
    return 0.5 * float(np.log(weight).sum() - np.log(weight.sum()) - weight @ (x - mean) ** 2)
