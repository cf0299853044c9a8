"""The reading is never above `limit_percent`: a flat top."""

from dataclasses import replace

import numpy as np

from analysis.effects.effect import Effect, Parameter

LEAST_CUT_PERCENT = 0.35  # less than this below the highest air is within what the airs are known to


def _within_the_airs(channel, values) -> bool:
    air = channel.conditions
    highest = max(float(air.source_percent.max()), float(air.destination_percent.max()))
    return values["limit_percent"] > highest - LEAST_CUT_PERCENT


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
