"""How much faster some runs are than the rest, and whether that is another medium (water and air)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.starts import resolved_half_way_s

Array = NDArray[np.float64]

MEDIA_FACTOR = 3.0  # between the two kinds of runs: more than airflows of one bench make
SPREAD_WITHIN = 0.5  # of that gap, as a ratio: what either kind may spread over
FEWEST_RUNS = 2  # runs of either kind


def runs_elsewhere(half_s: Array, conditions: Sequence[Array | NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """Runs (R,) that are not of the kind that most are; none where all are alike, or a condition tells them apart.

    Parameters
    ----------
    half_s : ndarray (R,)
        Time to half of each run's step [s]; NaN where it has none.
    conditions : sequence of ndarray (R,) of float or bool
        What was recorded of the runs and may make them faster: where the two kinds lie on either side of a value of
        one, that explains them. NaN is not recorded.
    """
    none = np.zeros(half_s.size, dtype=bool)
    told = np.flatnonzero(np.isfinite(half_s) & (half_s > 0.0))
    if told.size < 2 * FEWEST_RUNS:
        return none
    order = told[np.argsort(half_s[told])]
    logs = np.log(half_s[order])
    cut = int(np.argmax(np.diff(logs))) + 1
    fast, slow = order[:cut], order[cut:]
    gap = logs[cut] - logs[cut - 1]
    widest = max(np.ptp(logs[:cut]), np.ptp(logs[cut:]))
    if min(fast.size, slow.size) < FEWEST_RUNS or gap < np.log(MEDIA_FACTOR) or widest > SPREAD_WITHIN * gap:
        return none
    for condition in conditions:
        here, there = np.asarray(condition, dtype=float)[fast], np.asarray(condition, dtype=float)[slow]
        if here.min() > there.max() or here.max() < there.min():
            return none
    found = none.copy()
    found[slow if slow.size < fast.size else fast] = True
    return found


def as_fast_as_seen(
    name: str, those: Callable[[Channel], NDArray[np.bool_]], lowest: float, highest: float
) -> Callable[[Channel], dict[str, float]]:
    """A start for a fit, from the channel: {name: how many times as fast `those` runs are as the rest, by their times
    to half of their steps}, within bounds; empty where these tell nothing."""

    def start(channel: Channel) -> dict[str, float]:
        half = np.array([resolved_half_way_s(time, value) for time, value in channel.samples])
        told, apart = np.isfinite(half), those(channel)
        if not (told & apart).any() or not (told & ~apart).any():
            return {}
        ratio = np.median(half[told & ~apart]) / np.median(half[told & apart])
        return {name: float(np.clip(ratio, lowest, highest))}

    return start
