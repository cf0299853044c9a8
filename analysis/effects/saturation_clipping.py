"""The reading is never above `limit_percent`: a flat top."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import (
    Candidacy,
    Effect,
    Finding,
    InFlight,
    Needs,
    Parameter,
    Readout,
    SingleReadings,
    Start,
    Values,
    Words,
)

LEAST_CUT_PERCENT = 0.35  # less than this below the highest air is within what the airs are known to
DEEP_SIGMAS = 3.5  # standard uncertainties of an air
LEAST_PILE = 12  # readings at one ceiling that make a flat top
LEAST_ROW = 6  # of them in a row
TOLERANCE_PERCENT = 1e-4


def highest_air_percent(channel: Channel) -> float:
    """The most humid air of a channel's runs [%RH]."""
    air = channel.conditions
    return max(float(air.source_percent.max()), float(air.destination_percent.max()))


def _within_the_airs(channel: Channel, values: Values, bare: Callable[[], NDArray[np.float64]]) -> bool:
    """Whether a ceiling cuts no deeper than the airs are known to.

    Where plateaus are more alike than the airs that were stated, a limit in their middle makes them so, and half of
    their readings stand above it.
    """
    limit, air = values["limit_percent"], channel.conditions
    known = float(np.median(np.concatenate([air.source_percent_scatter, air.destination_percent_scatter])))
    tops = np.where(channel.count > 0, bare(), -np.inf).max(axis=1)
    reach_it = tops > limit - DEEP_SIGMAS * known
    return not reach_it.any() or float(np.mean(tops[reach_it]) - limit) < max(LEAST_CUT_PERCENT, DEEP_SIGMAS * known)


def _within_reach(channel: Channel) -> dict[str, float]:
    """A limit that cuts into the readings: from above all of them no gradient leads down."""
    high = float(np.quantile(channel.value[channel.count > 0], 0.97))
    return {"limit_percent": min(high, highest_air_percent(channel) - 2.0 * LEAST_CUT_PERCENT)}


def flat_top(known: SingleReadings) -> tuple[SingleReadings, Finding | None]:
    """A ceiling at which readings pile up, above which none lies."""
    channel, step = known.channel, known.step
    everything = np.concatenate([y for _, y in channel.samples])
    top = float(everything.max())
    at_top = np.abs(everything - top) < TOLERANCE_PERCENT
    # Without a ceiling the highest readings thin out: as many just below it as at it is what rounding does.
    width = max(step, 2 * TOLERANCE_PERCENT)
    below = ((everything < top - TOLERANCE_PERCENT) & (everything > top - 3.5 * width)).sum() / 3.0
    longest = max((_longest_row(np.abs(y - top) < TOLERANCE_PERCENT) for _, y in channel.samples), default=0)
    if at_top.sum() < LEAST_PILE or longest < LEAST_ROW or at_top.sum() < 8 * max(below, 1.0):
        return known, None
    if abs(top - highest_air_percent(channel)) < LEAST_CUT_PERCENT + 0.5 * step:
        return known, None  # the plateaus in the most humid air stand at one code
    if not channel.conditions.airs_known.any():
        return known, None  # the highest plateau itself is all that is known of the most humid air
    return known, Finding(
        "saturation_clipping",
        {"limit_percent": (top, max(step / np.sqrt(12.0), 1e-3))},
        f"{int(at_top.sum())} readings stand at exactly {top:.2f} %RH, {longest} in a row, and none above",
    )


def _longest_row(mask: NDArray[np.bool_]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return int((edges[1::2] - edges[::2]).max()) if edges.size else 0


EFFECT = Effect(
    id="saturation_clipping",
    link="readout",
    channels=("humidity",),
    equation="reading = min(reading, limit)",
    source="a firmware or converter limit",
    parameters=(Parameter("limit_percent", "%RH", 20.0, 130.0, (95.0,), none=None),),
    apply=lambda chain, p: replace(
        chain,
        readouts=(*chain.readouts, lambda reading, time, die_c: np.minimum(reading, p["limit_percent"][..., None])),
    ),
    words=Words(
        "The reading stops at {limit_percent} %RH, whatever the air.",
        "Raise the limit in firmware; until then values at it are lower bounds.",
    ),
    needs=Needs("needs runs whose airs were recorded", lambda channel: bool(channel.conditions.airs_known.any())),
    start=Start(from_data=_within_reach),
    candidacy=Candidacy(refused=_within_the_airs),
    readout=Readout(in_readings=flat_top),
    in_flight=InFlight(ceiling=lambda p: p["limit_percent"]),
)
