"""D depends on water activity in the film: D = D0 (1 + slope (a - 0.5)), a = c / saturation at the destination."""

from dataclasses import replace

import numpy as np

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import Candidacy, Effect, InFlight, Needs, Parameter, Words

LEAST_PERCENT = 10.0  # between the middles of two runs' steps


def _levels_differ(channel: Channel) -> bool:
    air = channel.conditions
    middle, up = 0.5 * (air.source_percent + air.destination_percent), air.destination_percent > air.source_percent
    return bool(np.ptp(middle) > LEAST_PERCENT or (up.any() and (~up).any()))


EFFECT = Effect(
    id="concentration_dependent_diffusivity",
    link="body",
    channels=("humidity",),
    equation="D = D0 (1 + slope (a - 1/2)), a = c / c_sat(destination)",
    source="Crank 1975, chapter 9",
    parameters=(Parameter("slope_per_unit_activity", "1", -1.6, 1.9, (-0.3, 0.3)),),
    apply=lambda chain, p: replace(chain, activity_slope=p["slope_per_unit_activity"]),
    words=Words(
        (
            "The film's diffusivity depends on how wet it is: it changes by {slope_per_unit_activity} (relative) from "
            "dry to saturated."
        ),
        "Take small steps at several levels, up and down, and quote D at half saturation.",
    ),
    needs=Needs("needs runs at different levels of humidity, or both up and down", _levels_differ),
    candidacy=Candidacy(excludes=frozenset({"uptake_by_activity"})),
    in_flight=InFlight(left=True),
)
