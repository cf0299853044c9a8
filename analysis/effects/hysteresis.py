"""Reading low by `rh_percent` after a rise and high by it after a fall; it sets in over some 5 %RH of change."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.effect import Arrays, Effect, InFlight, Needs, Parameter, Words
from shockrig.analysis.physics.chain import Chain

SET_IN_PERCENT = 5.0


def _apply(chain: Chain, p: Arrays) -> Chain:
    def held_back(
        reading: NDArray[np.float64], time: NDArray[np.float64], die_c: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        change = reading - chain.source_percent[..., None]
        return reading - p["rh_percent"][..., None] * np.tanh(change / SET_IN_PERCENT)

    return replace(chain, readouts=(*chain.readouts, held_back))


EFFECT = Effect(
    id="hysteresis",
    link="readout",
    channels=("humidity",),
    equation="H = H_film - rh tanh(change / 5 %RH)",
    source="sorption hysteresis; data sheets allow 1 %RH",
    parameters=(Parameter("rh_percent", "%RH", 0.0, 10.0, (0.5,)),),
    apply=_apply,
    words=Words(
        "The reading remembers where it came from: low by {rh_percent} %RH after a rise, high by it after a fall.",
        "Approach calibration points from both sides and state both.",
    ),
    needs=Needs("needs runs whose airs were recorded", lambda channel: bool(channel.conditions.airs_known.all())),
    in_flight=InFlight(uncertainty=lambda p: p["rh_percent"], left=True),
)
