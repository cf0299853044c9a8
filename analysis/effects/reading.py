"""From the body to a reading: the film's own temperature, calibration, hysteresis, a ceiling."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import (
    Arrays,
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
from shockrig.analysis.estimate.model import air_known_to
from shockrig.analysis.physics.air_exchange import REFERENCE_C
from shockrig.analysis.physics.chain import Chain

Array = NDArray[np.float64]

# The film is read at its own temperature: ppmv is turned into RH at the die's temperature (hyt.csv), not the air's.

DIE_THERMAL_LAG = Effect(
    id="die_thermal_lag",
    link="readout",
    channels=("humidity",),
    equation="H = c P_a / (1e4 P_s(T_die))",
    source="sorption follows activity at the film's own temperature",
    parameters=(),
    apply=lambda chain, p: replace(chain, at_die_temperature=True),
    words=Words(
        "The humidity sensor reads the air at its own die's temperature, and the die lags the air.",
        "Use isothermal shocks for D(T); in flight convert with the die's temperature, which the sensor reports.",
    ),
    needs=Needs(
        "needs runs whose temperature changes, and the die's own temperature in hyt.csv",
        lambda channel: bool(
            np.isfinite(channel.die_c).any() and (np.abs(channel.conditions.thermal_step_k) > 1.0).any()
        ),
    ),
    start=Start(own_rates=True),
    candidacy=Candidacy(excludes=frozenset({"uptake_by_activity"})),
    readout=Readout(thermal="thermal shocks, read at the die's temperature"),
    in_flight=InFlight(at_die=True),
)


# The film takes up by the relative humidity at its own temperature, while that still follows the air's.

UPTAKE_BY_ACTIVITY = Effect(
    id="uptake_by_activity",
    link="readout",
    channels=("humidity",),
    equation="the film is driven by a = e / P_s(T_own), and shows what it has taken up; not by e, read at P_s(T)",
    source="a polymer's sorption isotherm: the activity of water sets what it takes up, and not its pressure",
    parameters=(),
    apply=lambda chain, p: replace(chain, by_activity=True),
    words=Words(
        (
            "The film takes up by the relative humidity at its own temperature: a sensor that is still warmer than the "
            "air dries first."
        ),
        "Use isothermal shocks for D(T), and log the sensor's own temperature: a thermometer on its chip has it.",
    ),
    needs=Needs(
        "is looked for in sensors whose films are not known, in runs whose temperature changes",
        lambda channel: not channel.known_sensor and bool((~channel.isothermal).any()),
    ),
    start=Start(own_rates=True, always=True),  # far from the plain film, whose rate then means little
    candidacy=Candidacy(excludes=frozenset({"die_thermal_lag", "concentration_dependent_diffusivity"}), shape=True),
    readout=Readout(thermal="thermal shocks, the film driven by the humidity at its own temperature"),
    in_flight=InFlight(at_die=True, activity=lambda p: 1.0),
)


# The calibration of RH moves with temperature: reading = H + percent_per_k (T_sensor - 20 degC).

LEAST_RANGE_K = 10.0  # of the ambients

CALIBRATION_TEMPERATURE = Effect(
    id="calibration_temperature",
    link="readout",
    channels=("humidity",),
    equation="H = H_film + percent_per_k (T_die - 20 degC), at the air's temperature where the die's was not logged",
    source="data sheets of capacitive hygrometers: 0.05 %RH/K",
    parameters=(Parameter("percent_per_k", "%RH/K", -1.0, 1.0, (0.05,)),),
    apply=lambda chain, p: replace(chain, percent_per_k=p["percent_per_k"]),
    words=Words(
        "The calibration moves with temperature: {percent_per_k} %RH per kelvin away from 20 °C.",
        "Calibrate at two temperatures, and enter the result.",
    ),
    needs=Needs(
        "needs runs whose airs were recorded, at ambients 10 K apart",
        lambda channel: bool(
            channel.conditions.airs_known.all() and np.ptp(channel.conditions.destination_c) > LEAST_RANGE_K
        ),
    ),
    in_flight=InFlight(
        undo=lambda p, reading, stream, length: reading - p["percent_per_k"] * (stream.temperature_c - REFERENCE_C)
    ),
)


# Reading low by `rh_percent` after a rise and high by it after a fall; it sets in over some 5 %RH of change.

SET_IN_PERCENT = 5.0


def _held_back(chain: Chain, p: Arrays) -> Chain:
    def held_back(reading: Array, time: Array, die_c: Array) -> Array:
        change = reading - chain.source_percent[..., None]
        return reading - p["rh_percent"][..., None] * np.tanh(change / SET_IN_PERCENT)

    return chain.with_readout(held_back)


HYSTERESIS = Effect(
    id="hysteresis",
    link="readout",
    channels=("humidity",),
    equation="H = H_film - rh tanh(change / 5 %RH)",
    source="sorption hysteresis; data sheets allow 1 %RH",
    parameters=(Parameter("rh_percent", "%RH", 0.0, 10.0, (0.5,)),),
    apply=_held_back,
    words=Words(
        "The reading remembers where it came from: low by {rh_percent} %RH after a rise, high by it after a fall.",
        "Approach calibration points from both sides and state both.",
    ),
    needs=Needs("needs runs whose airs were recorded", lambda channel: bool(channel.conditions.airs_known.all())),
    in_flight=InFlight(uncertainty=lambda p: p["rh_percent"], left=True),
)


# Gain and offset: reading = true (1 + gain) + offset, in the channel's unit (degC or %RH).


def _miscalibrated(chain: Chain, p: Arrays) -> Chain:
    gain, offset = p["gain"][..., None], p["offset"][..., None]
    return chain.with_readout(lambda reading, time, die_c: reading * (1 + gain) + offset)


REFERENCE_SIGMAS = 3.0  # standard uncertainties of the references' own calibration: less may be theirs


def _no_more_than_the_references(channel: Channel, values: Values) -> bool:
    """Whether a reading is nowhere in the campaign's airs further off than the references may be themselves."""
    source, destination = (getattr(channel.conditions, name) for name in channel.quantity.air_fields)
    traces = [channel.trace_of(air) for air in channel.air if air is not None]
    airs = np.concatenate([source[~channel.measured], destination[~channel.measured], *traces])
    off = float(np.abs(values["gain"] * airs + values["offset"]).max())
    return off < REFERENCE_SIGMAS * air_known_to(channel)


CALIBRATION_ERROR = Effect(
    id="calibration_error",
    link="readout",
    channels=("temperature", "humidity"),
    equation="reading = true (1 + gain) + offset",
    source="two-point calibration",
    parameters=(
        # Wide, as the line of a sensor is that stands further from what changes the air than the reference does.
        Parameter("gain", "1", -0.95, 1.0, (0.0,), percent=True),
        Parameter("offset", "channel's unit", -100.0, 100.0, (0.0,)),
    ),
    apply=_miscalibrated,
    words=Words(
        "The calibration is off: gain {gain}, offset {offset}, the same in every run.",
        "Calibrate at two points against the reference, and enter the result.",
    ),
    needs=Needs(
        "needs runs whose airs were recorded",
        lambda channel: bool((channel.conditions.airs_known | channel.measured).all()),
    ),
    start=Start(always=True),
    candidacy=Candidacy(
        refused=lambda channel, values, bare: _no_more_than_the_references(channel, values), simple="line"
    ),
    in_flight=InFlight(
        undo=lambda p, reading, stream, length: (reading - p.get("offset", 0.0)) / (1.0 + p.get("gain", 0.0))
    ),
)


# The reading is never above `limit_percent`: a flat top.

LEAST_CUT_PERCENT = 0.35  # less than this below the highest air is within what the airs are known to
DEEP_SIGMAS = 3.5  # standard uncertainties of an air
LEAST_PILE = 12  # readings at one ceiling that make a flat top
LEAST_ROW = 6  # of them in a row
TOLERANCE_PERCENT = 1e-4


def highest_air_percent(channel: Channel) -> float:
    """The most humid air of a channel's runs [%RH]."""
    air = channel.conditions
    return max(float(air.source_percent.max()), float(air.destination_percent.max()))


def _within_the_airs(channel: Channel, values: Values, bare: Callable[[], Array]) -> bool:
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


SATURATION_CLIPPING = Effect(
    id="saturation_clipping",
    link="readout",
    channels=("humidity",),
    equation="reading = min(reading, limit)",
    source="a firmware or converter limit",
    parameters=(Parameter("limit_percent", "%RH", 20.0, 130.0, (95.0,), none=None),),
    apply=lambda chain, p: chain.with_readout(
        lambda reading, time, die_c: np.minimum(reading, p["limit_percent"][..., None])
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


EFFECTS = (
    DIE_THERMAL_LAG,
    UPTAKE_BY_ACTIVITY,
    CALIBRATION_TEMPERATURE,
    HYSTERESIS,
    CALIBRATION_ERROR,
    SATURATION_CLIPPING,
)
