"""Room air let in at the transfer decays: share `fraction` exp(-t / `time_constant_s`) of air at the room's state."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import Effect, Needs, Parameter, Words
from shockrig.analysis.physics.chain import RoomAir


def _recorded(channel: Channel) -> NDArray[np.bool_]:
    air = channel.conditions
    return air.airs_known & air.start_known & ~channel.measured


EFFECT = Effect(
    id="air_relaxation",
    link="air",
    channels=("temperature", "humidity"),
    equation="air(t) = destination + fraction exp(-t / time_constant) (room - destination)",
    source="well-mixed chamber; vapour pressure mixes linearly",
    parameters=(
        Parameter("fraction", "1", 0.001, 0.5, (0.03,), percent=True),
        Parameter("time_constant_s", "s", 0.3, 90.0, (3.0, 12.0), log=True, none=None),
        Parameter("room_temperature_c", "degC", -10.0, 45.0, (22.0,), none=None, prior=(21.0, 8.0)),
        Parameter("room_humidity_percent", "%RH", 0.0, 100.0, (45.0,), none=None, prior=(45.0, 20.0)),
    ),
    apply=lambda chain, p: replace(
        chain,
        rooms=(
            *chain.rooms,
            RoomAir(p["fraction"], p["time_constant_s"], p["room_temperature_c"], p["room_humidity_percent"]),
        ),
    ),
    words=Words(
        (
            "Room air comes in with the probes: {fraction} of the destination air at first, "
            "gone with {time_constant_s} s."
        ),
        "Seal the transfer port, raise the chamber's airflow, or bring the room to the destination's state.",
    ),
    needs=Needs(
        "needs runs whose airs and starts were recorded, and whose air was not measured all along",
        lambda channel: bool(_recorded(channel).any()),
    ),
)
