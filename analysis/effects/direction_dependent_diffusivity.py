"""Drying runs diffuse `ratio_drying_to_wetting` times as fast as wetting ones; the table is that of wetting."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.effect import Effect, InFlight, Needs, Parameter, Start, Words
from shockrig.analysis.estimate.readings import as_fast_as_seen
from shockrig.analysis.physics.chain import Recorded
from shockrig.analysis.physics.humidity import saturation_pressure_hpa


def dries(channel: Recorded) -> NDArray[np.bool_]:
    """True for the runs (R,) in which the vapour concentration falls."""
    air = channel.conditions
    return air.destination_percent * saturation_pressure_hpa(
        air.destination_c
    ) < air.source_percent * saturation_pressure_hpa(air.source_c)


_seen = as_fast_as_seen("ratio_drying_to_wetting", dries, 0.25, 4.0)
EFFECT = Effect(
    id="direction_dependent_diffusivity",
    link="body",
    channels=("humidity",),
    equation="D(drying) = ratio D(wetting)",
    source="sorption hysteresis of polymers; Crank 1975, chapter 9",
    parameters=(Parameter("ratio_drying_to_wetting", "1", 0.2, 5.0, (0.85, 1.2), log=True, none=1.0),),
    apply=lambda chain, p: replace(
        chain, rate=chain.rate * np.where(dries(chain.channel), p["ratio_drying_to_wetting"], 1.0)
    ),
    words=Words(
        "The film does not dry as fast as it wets: D is {ratio_drying_to_wetting} times as large in drying.",
        "Report rising and falling response times apart.",
    ),
    needs=Needs(
        "needs runs that wet the film and runs that dry it",
        lambda channel: bool(dries(channel).any() and (~dries(channel)).any()),
    ),
    start=Start(from_data=lambda channel: {} if channel.known_sensor else _seen(channel), own_rates=True),
    in_flight=InFlight(left=True),
)
