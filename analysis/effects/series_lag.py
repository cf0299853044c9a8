"""A first-order lag in series with the body: a sheath, a housing, a vent or a filter cap that the air has to cross."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import Candidacy, Effect, InFlight, Parameter, Values, Words

EARLY_LAGS, SETTLED_SHARE = 0.1, 0.95  # a body that is there so soon, in time constants of the lag, is none


def _before_nothing(channel: Channel, values: Values, bare: Callable[[], NDArray[np.float64]]) -> bool:
    """Whether the body behind the lag follows at once: such a sensor is a lump, and has one time constant."""
    if channel.measured.any():
        return False
    reading = bare()
    first, last = reading[:, :1], reading[:, -1:]
    late = (channel.time_s > EARLY_LAGS * values["time_constant_s"]) & (channel.count > 0)
    moved = np.abs(last - first) > channel.quantity.least_step
    share = (reading - first) / np.where(moved, last - first, 1.0)
    return bool((late & moved).any() and (share[late & moved] > SETTLED_SHARE).all())


EFFECT = Effect(
    id="series_lag",
    link="exchange",
    channels=("temperature", "humidity"),
    equation="time_constant dT_inside/dt = T_air - T_inside, and the body follows T_inside",
    source="two lags in series; housings and caps of thermometers and hygrometers",
    parameters=(Parameter("time_constant_s", "s", 0.02, 1000.0, (0.3, 3.0, 30.0), log=True, none=None, weakest=0.3),),
    apply=lambda chain, p: replace(chain, series=(*chain.series, p["time_constant_s"])),
    words=Words(
        (
            "Something stands between the air and the body and follows it with a lag of {time_constant_s} s (a sheath, "
            "a housing, a vent, a cap), the same at every airflow."
        ),
        "Take off cap or sheath for a comparison, or fly with it on: the profile has it in.",
    ),
    candidacy=Candidacy(
        rare=lambda channel: channel.known_sensor, limit_of="sheath", shape=True, refused=_before_nothing
    ),
    in_flight=InFlight(series_s=lambda p: p["time_constant_s"]),
)
