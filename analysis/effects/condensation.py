"""Dew on the film: while the die is below the destination's dew point, and `drying_time_s` after, it sees saturated
air."""

from dataclasses import replace

import numpy as np

from shockrig.analysis.estimate.effect import Arrays, Effect, InFlight, Needs, Parameter, Words
from shockrig.analysis.physics.chain import Chain


def _apply(chain: Chain, p: Arrays) -> Chain:
    warm = chain.channel.wet_until_s
    return replace(chain, wet_until_s=np.where(np.isfinite(warm), np.nan_to_num(warm) + p["drying_time_s"], 0.0))


EFFECT = Effect(
    id="condensation",
    link="exchange",
    channels=("humidity",),
    equation="c(L, t) = saturation until the die passes the dew point, and drying_time longer",
    source="psychrometry; the die is the coldest part in the destination air",
    parameters=(Parameter("drying_time_s", "s", 0.2, 120.0, (5.0,), log=True, none=None),),
    apply=_apply,
    words=Words(
        (
            "Dew forms on the cold film: it sees saturated air until {drying_time_s} s after the die has passed the "
            "dew point."
        ),
        "Keep the sensor above the destination's dew point before the transfer.",
    ),
    needs=Needs(
        "needs runs from cold air into air whose dew point lies above the film's own temperature",
        lambda channel: bool((np.isfinite(channel.wet_until_s)).any()),
    ),
    in_flight=InFlight(left=True),
)
