"""The reading is never above `limit_percent`: a flat top."""

from dataclasses import replace

import numpy as np

from shockrig.analysis.effects.effect import Effect, Parameter

LEAST_CUT_PERCENT = 0.35  # less than this below the highest air is within what the airs are known to


def highest_air_percent(channel) -> float:
    """The most humid air of a channel's runs [%RH]."""
    air = channel.conditions
    return max(float(air.source_percent.max()), float(air.destination_percent.max()))


def _within_the_airs(channel, values) -> bool:
    return values["limit_percent"] > highest_air_percent(channel) - LEAST_CUT_PERCENT


EFFECT = Effect(
    id="saturation_clipping",
    link="readout",
    channels=("humidity",),
    parameters=(Parameter("limit_percent", "%RH", 20.0, 130.0, (95.0,), none=None),),
    apply=lambda chain, p: replace(
        chain, readouts=(*chain.readouts, lambda reading: np.minimum(reading, p["limit_percent"][..., None]))
    ),
    sentence="The reading stops at {limit_percent} %RH, whatever the air.",
    equation="reading = min(reading, limit)",
    source="a firmware or converter limit",
    advice="Raise the limit in firmware; until then values at it are lower bounds.",
    refused=_within_the_airs,
    start_from=lambda channel: {"limit_percent": float(np.quantile(channel.value[channel.count > 0], 0.97))},
)
