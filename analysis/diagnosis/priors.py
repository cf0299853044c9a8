"""What is held against an effect before any data [nats]: one false-alarm rate, and how often benches have it."""

from __future__ import annotations

from math import log

from shockrig.analysis.diagnosis.thresholds import level
from shockrig.analysis.effects.behaviours import SCALES, form_of, is_step
from shockrig.analysis.effects.described import is_described
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.effect import Effect


def log_prior(effect: Effect, channel: Channel, looks: int) -> float:
    """Log prior of an effect's being there, beside that of its absence [nats].

    `looks` are the places in its range at which it is looked for: each is a chance to find something in nothing.
    """
    against = level("effect") + log(max(looks, 1))
    if not is_described(effect.id):
        return -against - 0.5 * effect.rarity(channel)
    on = form_of(effect.id).depends_on
    against += level("form") + level("factor") * sum(how in SCALES for _, how in on)
    # One form for each run that a change may begin at.
    return -against - log(channel.runs) * sum(is_step(how) for _, how in on)
