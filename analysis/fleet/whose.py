"""Whose a cause is that diagnoses name: the bench's, the type's, or one sensor's.

What one bench does, it does to all that it carries: most probes of a campaign show it, with one value. What belongs to
a type is in most sensors too, and differs from one to the next. Whether values are one is Cochran's test of
homogeneity, Q = sum (x_i - mean)^2 / u_i^2 ~ chi2(n - 1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from shockrig.analysis.fleet.population import LEAST_SENSORS, FleetMember
from shockrig.files.causes import StatedEffect, Uncertain
from shockrig.files.fleet import BENCH, SENSOR, SEVERAL, TYPE, FleetCause, SharedParameter

Array = NDArray[np.float64]

MOST = 0.5  # of the sensors: more than so many
APART = 0.05  # of values that are one, the share of which it is denied


@dataclass(frozen=True)
class _Diagnosed:
    """One probe of one campaign whose channel was diagnosed, and the effect where it was named."""

    sensor: str
    campaign: str
    bench: str
    cause: StatedEffect | None


def causes_of(sensors: Sequence[FleetMember]) -> tuple[FleetCause, ...]:
    """Every cause that a diagnosis names, by channel and effect; none where fewer than three sensors were diagnosed."""
    found = []
    diagnosed = [(one.name, s) for one in sensors for s in one.campaigns]
    for channel in sorted({name for _, s in diagnosed for name in s.causes}, reverse=True):
        there = [(name, s) for name, s in diagnosed if channel in s.causes]
        if len({name for name, _ in there}) < LEAST_SENSORS:
            continue
        for effect in sorted({cause.effect for _, s in there for cause in s.causes[channel]}):
            seen = [
                _Diagnosed(name, s.path, s.bench, next((c for c in s.causes[channel] if c.effect == effect), None))
                for name, s in there
            ]
            found.append(_judged(channel, effect, seen))
    return tuple(found)


def _judged(channel: str, effect: str, seen: Sequence[_Diagnosed]) -> FleetCause:
    having = [one for one in seen if one.cause is not None]
    carriers, all_ = (list(dict.fromkeys(one.sensor for one in of)) for of in (having, seen))
    campaigns = list(dict.fromkeys(one.campaign for one in having))
    parameters = _parameters(having)
    known = bool(parameters)  # nobody can say of two values without uncertainties whether they are one
    common = known and all(one.common for one in parameters.values())
    if len(carriers) == 1:
        whose = SENSOR
    elif len(carriers) > MOST * len(all_):
        # One bench with one value may be what it does; other benches do not do the same by accident.
        one_bench = len({one.bench or one.campaign for one in seen}) == 1
        whose = BENCH if one_bench and common else TYPE if known or not one_bench else SEVERAL
    else:
        beside = [one for one in seen if one.campaign in campaigns]
        together = len(campaigns) == 1 and len(beside) >= LEAST_SENSORS and len(having) > MOST * len(beside)
        whose = BENCH if together and common else SEVERAL
    return FleetCause(channel, effect, whose, tuple(carriers), len(all_), tuple(campaigns), parameters)


def _parameters(having: Sequence[_Diagnosed]) -> dict[str, SharedParameter]:
    """Mean and scatter of each parameter that is stated with its uncertainty."""
    stated: dict[str, list[Uncertain]] = {}
    for one in having:
        for name, value in one.cause.parameters.items() if one.cause is not None else ():
            if value.standard_uncertainty > 0.0:
                stated.setdefault(name, []).append(value)
    return {name: _shared(values, APART / len(stated)) for name, values in stated.items()}


def _shared(values: Sequence[Uncertain], level: float) -> SharedParameter:
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
    return SharedParameter(of_mean, math.sqrt(variance), bool(chdtrc(n - 1, Q) >= level))
