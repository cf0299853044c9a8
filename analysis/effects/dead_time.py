"""The channel is late by `delay_s`: nothing else changes."""

from dataclasses import replace

from shockrig.analysis.effects.behaviours import NUDGES_S, when_it_jumps_s
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import (
    Candidacy,
    Effect,
    InFlight,
    Needs,
    Parameter,
    Readout,
    Start,
    Values,
    Words,
)
from shockrig.analysis.estimate.model import LEAST_TRIGGER_OFFSET_S

LEAST_SIGMAS = 3.5  # standard uncertainties of a trigger that is off alike in all runs: less is no delay of the channel


def _no_more_than_the_trigger(channel: Channel, values: Values) -> bool:
    stated_s = 0.0 if channel.common is None else channel.common.trigger_offset_s
    return abs(values["delay_s"]) < LEAST_SIGMAS * max(stated_s, LEAST_TRIGGER_OFFSET_S)


EFFECT = Effect(
    id="dead_time",
    link="logger",
    channels=("temperature", "humidity"),
    equation="reading(t) = true(t - delay)",
    source="a polling loop or a buffer that hands out the previous reading",
    parameters=(Parameter("delay_s", "s", -0.02, 5.0, (0.01, 0.06, 0.15, 0.3, 0.6)),),
    apply=lambda chain, p: replace(chain, time_s=chain.time_s - p["delay_s"][..., None]),
    words=Words(
        "This channel is logged late by {delay_s} s.",
        "Time-stamp at the measurement and not at the read-out; request a conversion before every fetch.",
    ),
    needs=Needs(
        "needs runs whose start was recorded on the clock of the readings",
        lambda channel: bool(channel.conditions.start_known.any()),
    ),
    start=Start(
        from_data=lambda channel: {} if (late := when_it_jumps_s(channel)) is None else {"delay_s": late},
        nudges=lambda channel: [{"delay_s": s} for s in NUDGES_S] if channel.jumps_with_air else [],
    ),
    candidacy=Candidacy(refused=lambda channel, values, bare: _no_more_than_the_trigger(channel, values)),
    readout=Readout(like_average=lambda p, period_s: {int(2 * p["delay_s"] / period_s) + k for k in (0, 1, 2)}),
    in_flight=InFlight(delay_s=lambda p, period_s: max(p["delay_s"], 0.0)),
)
