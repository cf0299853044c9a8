"""The channel is late by `delay_s`: nothing else changes."""

from dataclasses import replace

import numpy as np

from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.common import LEAST_TRIGGER_OFFSET_S
from shockrig.analysis.inference.effect import Effect, InFlight, Parameter, Values

LEAST = 3.5  # standard uncertainties of a trigger that is off alike in all runs: less is no delay of the channel
SPREAD_S = 0.06  # of the jumps' times from run to run, sampling and trigger together
NUDGES_S = (-0.02, -0.01, 0.01, 0.02)  # the objective has steps where a sample crosses the jump
LEAST_CHANGE_K = 3.0  # of the air, for its jump to stand out in the RH read at its temperature


def _when_it_jumps(channel: Channel) -> dict[str, float]:
    """A delay moves the jump that RH makes with the air's temperature, and no fit finds its way over a jump."""
    if not channel.jumps_with_air:
        return {}
    air, period = channel.conditions, channel.sampling_period_s
    steepest_s = []
    for run in np.flatnonzero((np.abs(air.destination_c - air.source_c) > LEAST_CHANGE_K) & air.start_known):
        time, value = channel.samples[run]
        near = np.flatnonzero((time[1:] > -3 * period) & (time[:-1] < 2.0) & (np.diff(time) < 1.5 * period))
        if near.size > 3:
            steps = np.abs(np.diff(value))[near]
            steepest_s.append(0.5 * (time[near] + time[near + 1])[np.argmax(steps)])
    middle = float(np.median(steepest_s)) if len(steepest_s) >= 3 else 0.0
    agree = len(steepest_s) >= 3 and np.median(np.abs(np.array(steepest_s) - middle)) < SPREAD_S
    return {"delay_s": middle} if agree else {}


def _no_more_than_the_trigger(channel: Channel, values: Values) -> bool:
    stated_s = 0.0 if channel.common is None else channel.common.trigger_offset_s
    return abs(values["delay_s"]) < LEAST * max(stated_s, LEAST_TRIGGER_OFFSET_S)


EFFECT = Effect(
    id="dead_time",
    link="logger",
    channels=("temperature", "humidity"),
    parameters=(Parameter("delay_s", "s", -0.02, 5.0, (0.01, 0.06, 0.15, 0.3, 0.6)),),
    apply=lambda chain, p: replace(chain, time_s=chain.time_s - p["delay_s"][..., None]),
    sentence="This channel is logged late by {delay_s} s.",
    equation="reading(t) = true(t - delay)",
    source="a polling loop or a buffer that hands out the previous reading",
    start_from=_when_it_jumps,
    nudges=lambda channel: [{"delay_s": s} for s in NUDGES_S] if channel.jumps_with_air else [],
    like_average=lambda p, period_s: {int(2 * p["delay_s"] / period_s) + k for k in (0, 1, 2)},
    needs="needs runs whose start was recorded on the clock of the readings",
    in_flight=InFlight(delay_s=lambda p, period_s: max(p["delay_s"], 0.0)),
    refused=lambda channel, values, bare: _no_more_than_the_trigger(channel, values),
    testable=lambda channel: bool(channel.conditions.start_known.any()),
    advice="Time-stamp at the measurement and not at the read-out; request a conversion before every fetch.",
)
