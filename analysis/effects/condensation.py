"""Dew on the film: while the die is below the destination's dew point, and `drying_time_s` after, it sees saturated
air."""

from dataclasses import replace

import numpy as np

from shockrig.analysis.effects.effect import Effect, Parameter
from shockrig.analysis.physics.humidity import dew_point_c


def warm_after_s(channel) -> np.ndarray:
    """When each run's die passes the dew point of the destination [s] (R,); NaN where it never was below it."""
    air = channel.conditions
    dew = dew_point_c(np.clip(air.destination_percent, 1.0, 100.0), air.destination_c)
    warm = np.full(channel.runs, np.nan)
    for run, (time, _) in enumerate(channel.samples):
        die = channel.die_samples[run] if channel.die_samples else np.full(time.size, np.nan)
        below = (time > 0) & (die < dew[run])
        if air.source_c[run] < dew[run] and below.any():
            last = int(np.flatnonzero(below)[-1])
            ahead = min(last + 1, time.size - 1)
            rise = die[ahead] - die[last]
            share = np.clip((dew[run] - die[last]) / rise, 0.0, 1.0) if rise > 0 else 0.0
            warm[run] = time[last] + share * (time[ahead] - time[last])
    return warm


def _apply(chain, p):
    warm = warm_after_s(chain.channel)
    return replace(chain, wet_until_s=np.where(np.isfinite(warm), np.nan_to_num(warm) + p["drying_time_s"], 0.0))


EFFECT = Effect(
    id="condensation",
    link="exchange",
    channels=("humidity",),
    parameters=(Parameter("drying_time_s", "s", 0.2, 120.0, (5.0,), log=True, none=None),),
    apply=_apply,
    sentence=(
        "Dew forms on the cold film: it sees saturated air until {drying_time_s} s after the die has passed the "
        "dew point."
    ),
    equation="c(L, t) = saturation until the die passes the dew point, and drying_time longer",
    source="psychrometry; the die is the coldest part in the destination air",
    advice="Keep the sensor above the destination's dew point before the transfer.",
    testable=lambda channel: bool(np.isfinite(warm_after_s(channel)).any()),
)
