"""Change points of one channel: where it leaves what it was doing, at whatever time scale that shows.

A sensor that settles goes on in its direction with lessening speed. So, from a straight line through the readings
before a moment, those after it may lie anywhere between "stay where it was" and "go on as it did"; what lies outside
that cone by more than the noise, the least step and the channel's usual wandering is a change. Windows of a few blocks
are laid over the readings, over means of two, of four and so on, and the narrowest window that shows a change has it
(narrowest over threshold: Baranowski, Chen and Fryzlewicz 2019, doi 10.1111/rssb.12322), so that each is found as
sharply as it can be timed, whether the sensor takes a tenth of a second or an hour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

Array = NDArray[np.float64]

BLOCKS_BESIDE = 5  # blocks on either side
CHANGE_SIGMAS = 6.0  # of the noise: over a million readings and all scales less than one false change is expected
WANDERING_TIMES = 10.0  # times what three in five departures from the cone at that scale keep below
GOES_ON = 0.1  # of a departure, passed in the window before it, shows that the way had begun
GRID_AT_MOST = 4_000_000
EDGES_AT_ONCE = 100_000  # edges that are looked at together


@dataclass(frozen=True)
class ChangePoint:
    """A change point: about when, and the width of the window that showed it (s on one side).

    `goes_on`: the channel was on its way in that direction already, and only went faster.
    """

    time_s: float
    width_s: float
    goes_on: bool = False


@dataclass(frozen=True)
class LogPiece:
    """Readings of one sensor and quantity in one piece of a log, without spikes: arrays (n,), in order of time.

    `noise` is the standard deviation of one reading, `least` the smallest step that counts, in the quantity's unit.
    """

    name: str
    quantity: str
    time_s: Array
    value: Array
    noise: float
    least: float

    @property
    def period_s(self) -> float:
        return float(np.median(np.diff(self.time_s)))


def noise_of(value: Array) -> float:
    """Standard deviation of one reading, from second differences; at least what the readings' rounding makes of it."""
    if value.size < 4:
        return 0.0
    second = np.diff(value, 2)
    second -= np.median(second)
    scatter = 1.4826 * float(np.median(np.abs(second, out=second), overwrite_input=True)) / np.sqrt(6.0)
    del second
    return max(scatter, code_of(value, 0.2) / np.sqrt(12.0))


def code_of(value: Array, equal: float = 0.5) -> float:
    """How far apart the codes of a rounded channel are; 0 where less than a share `equal` of its readings are as the
    one before: what noise carries to and fro between codes is known more finely than these."""
    steps = np.abs(np.diff(value))
    differ = steps > 1e-9 * max(1.0, float(np.abs(value).max()))
    if not 0.0 < differ.mean() <= 1.0 - equal:
        return 0.0
    return float(np.quantile(steps[differ], 0.05))


def spike_size(noise: float, least: float) -> float:
    """How far off its neighbours a reading is no noise; `least` is the smallest step that counts."""
    return max(8.0 * noise, 0.5 * least)


def without_spikes(time_s: Array, value: Array, noise: float, least: float) -> tuple[Array, Array]:
    """Times and readings without single or double readings far off their neighbours: absurd ones are no steps."""
    if value.size < 5:
        return time_s, value
    off = np.asarray(median_filter(value, 5, mode="mirror"))
    np.subtract(value, off, out=off)
    calm = np.abs(off, out=off) <= spike_size(noise, least)
    return (time_s, value) if calm.all() else (time_s[calm], value[calm])


def find_changes(channel: LogPiece) -> tuple[ChangePoint, ...]:
    """All change points of a channel, in order of time."""
    time_s, value = channel.time_s, channel.value
    if value.size < 2 * BLOCKS_BESIDE + 2 or np.ptp(value) < channel.least:
        return ()
    from scipy.signal import find_peaks  # takes longer to import than all the rest

    period = max(channel.period_s, float(time_s[-1] - time_s[0]) / GRID_AT_MOST)
    blocks = np.interp(np.arange(time_s[0], time_s[-1] + 0.5 * period, period), time_s, value)
    width = period

    def edge_s(place: NDArray[np.intp], width: float) -> Array:
        # Around an edge i are blocks i-BLOCKS_BESIDE to i+BLOCKS_BESIDE-1; its edge lies between two blocks.
        return np.asarray(time_s[0] + width * (place + BLOCKS_BESIDE) - 0.5 * period)

    found: list[ChangePoint] = []
    taken = np.zeros(0)
    while blocks.size >= 2 * BLOCKS_BESIDE + 1:
        departure, run_up = _departures(blocks)
        score = np.abs(departure)
        noisy = CHANGE_SIGMAS * channel.noise * np.sqrt(14.0 / (BLOCKS_BESIDE * width / period))
        score /= max(channel.least, noisy, WANDERING_TIMES * float(np.quantile(score, 0.6)))
        if taken.size:
            high = np.flatnonzero(score >= 1.0)
            score[high[_nearest(edge_s(high, width), taken) < (BLOCKS_BESIDE + 1) * width]] = 0.0
        peaks, _ = find_peaks(np.concatenate([[0.0], score, [0.0]]), height=1.0, distance=BLOCKS_BESIDE)
        edges = edge_s(peaks - 1, width)
        goes_on = run_up[peaks - 1] * np.sign(departure[peaks - 1]) > GOES_ON * np.abs(departure[peaks - 1])
        found += [
            ChangePoint(float(at_s), BLOCKS_BESIDE * width, bool(on)) for at_s, on in zip(edges, goes_on, strict=True)
        ]
        taken = np.sort(np.concatenate([taken, edges]))
        if blocks.size % 2:
            blocks = blocks[:-1]
        blocks = 0.5 * (blocks[0::2] + blocks[1::2])
        width *= 2.0
    kept: list[ChangePoint] = []
    for change in sorted(found, key=lambda one: one.time_s):
        # A response that gathers speed (a core, two lags) has begun once, whatever windows see of it.
        if kept and change.goes_on and change.time_s - kept[-1].time_s <= 4.0 * change.width_s:
            continue
        kept.append(change)
    return tuple(kept)


def _departures(blocks: Array) -> tuple[Array, Array]:
    """`_departure` over all blocks, a part of them at a time: of a million each of its steps takes 8 MB."""
    edges = blocks.size - 2 * BLOCKS_BESIDE + 1
    departure, run_up = np.empty(edges), np.empty(edges)
    for first in range(0, edges, EDGES_AT_ONCE):
        last = min(first + EDGES_AT_ONCE, edges)
        departure[first:last], run_up[first:last] = _departure(blocks[first : last + 2 * BLOCKS_BESIDE - 1])
    return departure, run_up


def _departure(blocks: Array) -> tuple[Array, Array]:
    """How far the mean after each edge lies outside the cone that the line before it leaves open, and how far that line
    runs over its window."""
    m = BLOCKS_BESIDE
    place = np.arange(m) - (m - 1) / 2.0
    level = np.correlate(blocks, np.full(m, 1.0 / m), "valid")
    slope = np.correlate(blocks, place / (place @ place), "valid")[:-m]
    level, after = level[:-m], level[m:]
    stay = level + slope * (m - 1) / 2.0
    go_on = level + slope * m
    # Where a response has just ended, the line through it ends beyond the level that it came to.
    last = blocks[m - 1 : m - 1 + level.size]
    low, high = np.minimum(np.minimum(stay, go_on), last), np.maximum(np.maximum(stay, go_on), last)
    return np.asarray(after - np.clip(after, low, high)), slope * m


def _nearest(moments: Array, taken: Array) -> Array:
    """How far each moment is from the nearest of `taken`, which are in order."""
    place = np.searchsorted(taken, moments)
    before, after = taken[np.maximum(place - 1, 0)], taken[np.minimum(place, taken.size - 1)]
    return np.asarray(np.minimum(np.abs(moments - before), np.abs(moments - after)))
