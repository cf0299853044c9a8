"""A wetted bead: after the transfer it reads low by `depression_k` exp(-t / `time_constant_s`) while the water
leaves."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.effect import Arrays, Effect, InFlight, Needs, Parameter, Words
from shockrig.analysis.physics.chain import Chain, Recorded
from shockrig.analysis.physics.humidity import dew_point_c


def wetted(channel: Recorded) -> NDArray[np.float64]:
    """1 for the runs (R,) whose destination is below saturation and so lets a wet bead dry, scaled by (100 - RH) /
    50."""
    air = channel.conditions
    wet_before = dew_point_c(np.maximum(air.destination_percent, 1.0), air.destination_c) > air.source_c + 0.5
    return np.where(wet_before, np.clip((100.0 - air.destination_percent) / 50.0, 0.0, 2.0), 0.0)


def _apply(chain: Chain, p: Arrays) -> Chain:
    def cooled(
        reading: NDArray[np.float64], late: NDArray[np.float64], die_c: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        decay = np.exp(-np.maximum(late, 0) / p["time_constant_s"][..., None]) * (late > 0)
        return reading - (p["depression_k"] * wetted(chain.channel))[..., None] * decay

    return replace(chain, readouts=(*chain.readouts, cooled))


EFFECT = Effect(
    id="evaporative_cooling",
    link="body",
    channels=("temperature",),
    equation=(
        "T = T_bead - depression (100 - RH) / 50 exp(-t / time_constant), where the source is below the "
        "destination's dew point"
    ),
    source="a wet thermistor cools below its bath by 0.2 to 0.5 K for up to a minute",
    parameters=(
        Parameter("depression_k", "K", 0.0, 5.0, (0.3,)),
        Parameter("time_constant_s", "s", 1.0, 200.0, (20.0,), log=True, none=None),
    ),
    apply=_apply,
    words=Words(
        (
            "Dew on the bead evaporates after the transfer: it reads low by {depression_k} K at first, for "
            "{time_constant_s} s."
        ),
        "Keep the probes above the destination's dew point before the transfer.",
    ),
    needs=Needs(
        "needs a source air so moist that dew forms in the destination air",
        lambda channel: bool(((wetted(channel) > 0) & channel.conditions.airs_known).any()),
    ),
    in_flight=InFlight(left=True),
)
