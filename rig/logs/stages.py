"""A step that came in stages, with rests between them: how many, and when the first began."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from shockrig.rig.logs.changes import ChangePoint, LogPiece
from shockrig.rig.logs.onset import StepOnset

LEAST_STAGE = 0.05  # of the whole way


def count_stages(channel: LogPiece, move: StepOnset, until_s: float) -> tuple[int, float]:
    """How many stages a move came in (it stood still between them), and when the last one ended."""
    time_s, value = channel.time_s, channel.value
    inside = (time_s >= move.at_s - channel.period_s) & (time_s <= until_s)
    share = (value[inside] - move.before) / move.size if move.size else np.zeros(int(inside.sum()))
    there = np.flatnonzero(share >= 0.95)
    if there.size == 0 or there[0] < 6:
        return 1, move.at_s
    end = int(there[0]) + 1
    moments, share = time_s[inside][:end], share[:end]
    blocks = min(60, end - 1)
    # From reading to reading: where one was left out, blocks of time would lie half in a rest and half beside it.
    way = np.diff(np.interp(np.linspace(0.0, end - 1.0, blocks + 1), np.arange(end), share))
    noise = np.sqrt(2.0) * channel.noise / abs(move.size)
    moving = np.abs(way) > max(0.5 / blocks, 6.0 * noise)
    still = np.abs(way) < max(0.15 / blocks, 3.0 * noise)
    stages, going, gone = 0, False, 0.0
    for k in range(blocks + 1):
        if k == blocks or (going and still[k]):
            stages += going and abs(gone) >= LEAST_STAGE
            going, gone = False, 0.0
        elif moving[k] or going:
            going, gone = True, gone + float(way[k])
    return max(stages, 1), float(moments[-1])


def first_stage(channel: LogPiece, move: StepOnset, change: ChangePoint) -> StepOnset:
    """The move timed by its first stage alone, which two lags behind one step cannot follow: the first two readings
    that are off the level before."""
    time_s, value = channel.time_s, channel.value
    begin_s = min(move.at_s - 2.0 * move.uncertainty_s, change.time_s - change.width_s)
    before = np.flatnonzero(time_s < begin_s)[-10:]
    if before.size < 3:
        return move
    off = np.abs(value - np.median(value[before])) > max(6.0 * channel.noise, LEAST_STAGE * abs(move.size))
    both = np.flatnonzero(off[:-1] & off[1:] & (time_s[:-1] >= begin_s))
    if both.size == 0 or both[0] == 0:
        return move
    last_s, first_s = float(time_s[both[0] - 1]), float(time_s[both[0]])
    return replace(move, at_s=0.5 * (last_s + first_s), uncertainty_s=first_s - last_s)
