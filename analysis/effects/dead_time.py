"""The channel is late by `delay_s`: nothing else changes."""

from dataclasses import replace

from analysis.effects.effect import Effect, Parameter

EFFECT = Effect(
    id="dead_time",
    link="logger",
    channels=("temperature", "humidity"),
    parameters=(Parameter("delay_s", "s", -0.02, 5.0, (0.06, 0.15, 0.3, 0.6)),),
    apply=lambda chain, p: replace(chain, time_s=chain.time_s - p["delay_s"][..., None]),
    sentence="This channel is logged late by {delay_s} s.",
    equation="reading(t) = true(t - delay)",
    source="a polling loop or a buffer that hands out the previous reading",
    testable=lambda channel: bool(channel.conditions.start_known.any()),
    advice="Time-stamp at the measurement and not at the read-out; request a conversion before every fetch.",
)
