"""The channel's time stamps run fast by `ppm` millionths, counted from the run's first sample."""

from dataclasses import replace

import numpy as np

from shockrig.analysis.effects.behaviours import NUDGES_S, when_it_jumps_s
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import Arrays, Candidacy, Effect, Needs, Parameter, Start, Values, Words
from shockrig.analysis.physics.chain import Chain


def _apply(chain: Chain, p: Arrays) -> Chain:
    elapsed = chain.time_s + chain.channel.conditions.start_s[:, None]
    return replace(chain, time_s=chain.time_s - 1e-6 * p["ppm"][..., None] * np.maximum(elapsed, 0.0))


LEAST_SIGMAS = 3.5  # standard uncertainties of a clock that is off alike in all runs


def _no_more_than_the_clock(channel: Channel, values: Values) -> bool:
    return channel.common is not None and abs(values["ppm"]) < LEAST_SIGMAS * channel.common.clock_ppm


def _from_the_jumps(channel: Channel) -> dict[str, float]:
    """The share by which the jumps of a film's reading are late, where they are late by more than readings tell."""
    lead_s = channel.conditions.start_s
    share = when_it_jumps_s(channel, lead_s)
    if share is None or abs(share) * np.nanmean(lead_s) < 0.5 * channel.sampling_period_s:
        return {}
    return {"ppm": 1e6 * share}


def _nudges(channel: Channel) -> list[dict[str, float]]:
    """By how much later a transfer is in its stamps: where a film's response begins with a kink, the objective has a
    step wherever a sample passes it."""
    lead_s = float(np.nanmean(channel.conditions.start_s))
    return [{"ppm": 1e6 * late_s / max(lead_s, 1.0)} for late_s in NUDGES_S]


EFFECT = Effect(
    id="clock_drift",
    link="logger",
    channels=("temperature", "humidity"),
    equation="t_stamp = t (1 + ppm 1e-6)",
    source="a logger with its own oscillator; a crystal is good to 100 ppm, what acts on a transient needs far more",
    parameters=(Parameter("ppm", "1e-6", -200000.0, 200000.0, (20000.0, -20000.0), weakest=1000.0),),
    apply=_apply,
    words=Words(
        "This channel's clock runs fast by {ppm} parts per million.",
        "Stamp all channels with one clock, or log a time mark at both ends of every run.",
    ),
    needs=Needs(
        "needs runs whose start was recorded on the clock of the readings",
        lambda channel: bool((channel.conditions.start_known & ~channel.measured).any()),
    ),
    start=Start(from_data=_from_the_jumps, nudges=_nudges),
    candidacy=Candidacy(
        rare=lambda channel: True, refused=lambda channel, values, bare: _no_more_than_the_clock(channel, values)
    ),
)
