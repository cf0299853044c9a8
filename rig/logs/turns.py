"""A humidity that its own sensor's changing temperature carries along: it runs to one side, turns, and comes back.

Relative humidity at a sensor that is warming or cooling in a new air moves at once and ends where that sensor has taken
the air's temperature: the turn is on the way of one transfer and is none of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from shockrig.rig.logs.changes import BLOCKS_BESIDE, ChangePoint, LogPiece

LEVEL_READINGS = 8  # readings that tell a level
STILL_AHEAD = 0.1  # of a temperature's way: humidity that turns before that is carried along
BACK_SHARE = 0.3  # of the way out, by which a turn has come back


def own_temperature(channels: Sequence[LogPiece], place: int) -> int | None:
    """The place of the temperature of the sensor whose humidity stands at `place`; None where it has none."""
    if channels[place].quantity != "humidity":
        return None
    sensor = channels[place].name.rsplit(".", 1)[0]
    same = (k for k, c in enumerate(channels) if c.name.rsplit(".", 1)[0] == sensor and c.quantity == "temperature")
    return next(same, None)


def on_its_way(channel: LogPiece, since_s: float, now_s: float) -> bool:
    """Whether more than `STILL_AHEAD` of a way begun at `since_s` was ahead at `now_s`: of what the readings then did
    within as long again and four times as long."""
    time_s, value = channel.time_s, channel.value
    rest, here = value[time_s <= since_s][-LEVEL_READINGS:], value[time_s <= now_s][-3:]
    ahead = value[(time_s > now_s) & (time_s <= now_s + 5.0 * (now_s - since_s))]
    if rest.size == 0 or here.size == 0 or ahead.size < 3:
        return False
    start, now = float(np.median(rest)), float(np.median(here))
    furthest = float(ahead[np.argmax(np.abs(ahead - start))])
    return abs(furthest - start) >= channel.least and (furthest - now) / (furthest - start) > STILL_AHEAD


def turn_s(channel: LogPiece, temperature: LogPiece, change: ChangePoint, end_s: float) -> float | None:
    """When a humidity turned that its sensor's temperature, changing with it, carried to one side; None where it did
    not."""
    time_s, value = channel.time_s, channel.value
    rest = value[time_s <= change.time_s - min(change.width_s, BLOCKS_BESIDE * channel.period_s)][-LEVEL_READINGS:]
    inside = (time_s > change.time_s) & (time_s <= end_s)
    if rest.size == 0 or inside.sum() < 2 * LEVEL_READINGS:
        return None
    way = value[inside] - float(np.median(rest))
    for sign in (1.0, -1.0):
        out = np.maximum.accumulate(sign * way)
        back = out - sign * way
        turned = np.flatnonzero((out > channel.least) & (back > max(BACK_SHARE * float(out.max()), channel.least)))
        if turned.size:
            furthest = int(np.argmax(sign * way[: turned[0] + 1]))
            moment = float(time_s[inside][furthest])
            if on_its_way(temperature, change.time_s, moment):
                return moment
    return None
