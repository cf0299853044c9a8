"""Gain and offset: reading = true (1 + gain) + offset, in the channel's unit (degC or %RH)."""

from dataclasses import replace

import numpy as np

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import (
    Arrays,
    Candidacy,
    Effect,
    InFlight,
    Needs,
    Parameter,
    Start,
    Values,
    Words,
)
from shockrig.analysis.estimate.model import OWN_AIR
from shockrig.analysis.physics.chain import Chain


def _apply(chain: Chain, p: Arrays) -> Chain:
    gain, offset = p["gain"][..., None], p["offset"][..., None]
    return replace(chain, readouts=(*chain.readouts, lambda reading, time, die_c: reading * (1 + gain) + offset))


LEAST_SIGMAS = 3.0  # standard uncertainties of the references' own calibration: less may be theirs


def _no_more_than_the_references(channel: Channel, values: Values) -> bool:
    """Whether a reading is nowhere in the campaign's airs further off than the references may be themselves."""
    if channel.common is None:
        return False
    source, destination = (getattr(channel.conditions, name) for name in channel.quantity.air_fields)
    traces = [channel.trace_of(air) for air in channel.air if air is not None]
    airs = np.concatenate([source[~channel.measured], destination[~channel.measured], *traces])
    off = float(np.abs(values["gain"] * airs + values["offset"]).max())
    return off < LEAST_SIGMAS * float(getattr(channel.common, OWN_AIR[channel.name]))


EFFECT = Effect(
    id="calibration_error",
    link="readout",
    channels=("temperature", "humidity"),
    equation="reading = true (1 + gain) + offset",
    source="two-point calibration",
    parameters=(
        Parameter("gain", "1", -0.3, 0.3, (0.0,), percent=True),
        Parameter("offset", "channel's unit", -15.0, 15.0, (0.0,)),
    ),
    apply=_apply,
    words=Words(
        "The calibration is off: gain {gain}, offset {offset}, the same at every airflow and direction.",
        "Calibrate at two points against the reference, and enter the result.",
    ),
    needs=Needs(
        "needs runs whose airs were recorded",
        lambda channel: bool((channel.conditions.airs_known | channel.measured).all()),
    ),
    start=Start(always=True),
    candidacy=Candidacy(refused=lambda channel, values, bare: _no_more_than_the_references(channel, values)),
    in_flight=InFlight(
        undo=lambda p, reading, stream, length: (reading - p.get("offset", 0.0)) / (1.0 + p.get("gain", 0.0))
    ),
)
