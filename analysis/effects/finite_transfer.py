"""The transfer takes time: the air at the probes changes linearly over `duration_s` from the transfer's start.

Where all runs state a measured duration, each run's ramp is in proportion to its own and `duration_s` is the median
run's; those that were slowed on purpose, or alone state one, have just that duration, in the plain model too.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import Arrays, Effect, Needs, Parameter, Readout, Words
from shockrig.analysis.physics.chain import Chain


def _ramp(chain: Chain, p: Arrays) -> NDArray[np.float64]:
    air = chain.channel.conditions
    return np.where(np.isfinite(air.ramp_own_s), air.ramp_own_s, p["duration_s"] * air.ramp_ratio)


def _triggered(channel: Channel) -> bool:
    return bool((channel.conditions.start_known & ~channel.measured).any())


EFFECT = Effect(
    id="finite_transfer",
    link="air",
    channels=("temperature", "humidity"),
    equation="air(t) = source + (destination - source) min(t / duration, 1)",
    source="ramp response: integral of the step response over the duration",
    parameters=(Parameter("duration_s", "s", 0.02, 8.0, (0.06, 0.3, 1.0)),),
    apply=lambda chain, p: replace(chain, ramp_s=_ramp(chain, p)),
    words=Words(
        "The air does not change in an instant: the transfer takes {duration_s} s.",
        "Move the probes faster, or log both ends of the transfer so that its duration is known.",
    ),
    needs=Needs("needs runs whose start was recorded: a slow transfer and a late start look alike", _triggered),
    readout=Readout(like_average=lambda p, period_s: {int(p["duration_s"] / period_s) + k for k in (0, 1, 2)}),
)
