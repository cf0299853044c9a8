"""What is off in all runs alike: parameters of the fit with a prior where readings can tell, shifts where they cannot.

A common late trigger, or an air that its reference always gives too high, moves every run's random effect by the same
amount c. With c in theta, under its prior N(0, u^2), no effect can gain by explaining what such an error explains, and
its share of every uncertainty is counted. An airflow, a pressure or a clock that is always off is not to be seen: its
share is the estimate's shift, -H^-1 d2/dtheta dq, with the input perturbed and the prediction looked at again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.physics.chain import MeasuredAir

Array = NDArray[np.float64]

# A trigger is good to 10 ms from run to run; this much of it may be the same in every run, whatever is stated: it is
# no more than the sensors' own lines and buses are late, and no fit can see it.
LEAST_TRIGGER_OFFSET_S = 0.004
TRIGGER = "trigger_offset_s"
OWN_AIR = {"temperature": "air_temperature_k", "humidity": "air_humidity_percent"}
# Standard uncertainties that a common error may be fitted from none. What is off by more is no error of the bench: it
# is left to the effects, which unseen runs could else not bear out.
MOST_SIGMAS = 3.0


@dataclass(frozen=True)
class Shared:
    """A common error that is fitted along: its key in campaign.json, its standard uncertainty, what it moves."""

    name: str
    standard_uncertainty: float
    moves: tuple[RunEffect, ...]

    def acts(self, channel: Channel) -> Array:
        """1 for runs (R,) that it moves, 0 for others: one that nobody triggered, one whose airs nobody recorded."""
        air = channel.conditions
        known = air.start_known & ~channel.measured if self.name == TRIGGER else air.airs_known
        return np.asarray(known, dtype=float)


def shared(channel: Channel) -> tuple[Shared, ...]:
    """The common errors that a model of the channel has in theta; none where the campaign states none."""
    stated = channel.common
    if stated is None:
        return ()
    air = OWN_AIR[channel.name]
    both = (RunEffect.SOURCE, RunEffect.DESTINATION)
    found = [Shared(air, getattr(stated, air), both)]
    if stated.trigger_offset_s > LEAST_TRIGGER_OFFSET_S:
        found.insert(0, Shared(TRIGGER, stated.trigger_offset_s, (RunEffect.START,)))
    return tuple(one for one in found if one.standard_uncertainty > 0)


def _warmer(channel: Channel, by_k: float) -> Channel:
    air = channel.conditions
    moved = replace(air, source_c=air.source_c + by_k, destination_c=air.destination_c + by_k)
    traces = tuple(None if a is None else replace(a, temperature_c=a.temperature_c + by_k) for a in channel.air)
    return replace(channel, conditions=moved, air=traces)


def _moister(channel: Channel, by_percent: float) -> Channel:
    air = channel.conditions
    source, destination = air.source_percent + by_percent, air.destination_percent + by_percent
    moved = replace(air, source_percent=source, destination_percent=destination)
    traces = tuple(
        None if a is None else replace(a, humidity_percent=a.humidity_percent + by_percent) for a in channel.air
    )
    return replace(channel, conditions=moved, air=traces)


def _windier(channel: Channel, by_percent: float) -> Channel:
    air = channel.conditions
    factor = np.where(air.airflow_known, 1.0 + by_percent / 100.0, 1.0)
    return replace(channel, conditions=replace(air, airflow_m_s=air.airflow_m_s * factor))


def _denser(channel: Channel, by_hpa: float) -> Channel:
    air = channel.conditions
    return replace(channel, conditions=replace(air, pressure_hpa=air.pressure_hpa + by_hpa))


def _later(channel: Channel, by_s: float) -> Channel:
    triggered = channel.conditions.start_known & ~channel.measured
    return replace(channel, time_s=channel.time_s - by_s * triggered[:, None])


def _slower(channel: Channel, by_ppm: float) -> Channel:
    """True times where the clock's own are too many by so many millionths."""
    keep = 1.0 - 1e-6 * by_ppm

    def trace(air: MeasuredAir | None) -> MeasuredAir | None:
        return None if air is None else replace(air, time_s=air.time_s * keep)

    return replace(channel, time_s=channel.time_s * keep, air=tuple(trace(a) for a in channel.air))


# Key in campaign.json: (the channel as it is where the input is truly that much higher, step of the finite difference).
PERTURBED: dict[str, tuple[Callable[[Channel, float], Channel], float]] = {
    "air_temperature_k": (_warmer, 0.01),
    "air_humidity_percent": (_moister, 0.1),
    "airflow_percent": (_windier, 0.1),
    "pressure_hpa": (_denser, 1.0),
    TRIGGER: (_later, 1e-4),
    "clock_ppm": (_slower, 100.0),
}
