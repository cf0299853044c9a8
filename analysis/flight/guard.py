"""How far the air can be from the readings around it, whatever a method makes of them.

What the air did for as long as the method resolves shows in the readings by at least the share g of its size that the
sensor shows in that time. So the air is above the least reading around by no more than (spread of the readings) / g,
and below the largest by no more: around is as long as the sensor remembers, and as far as the nearest readings.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from shockrig.analysis.flight.channel import Channel, Readings
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.flight.stretches import largest_share
from shockrig.files.numbers import counted

Array = NDArray[np.float64]
REMEMBERED = 3.0  # of the slowest time constant: what is left of a step is less than its twentieth
SIGMAS = 4.0  # of a reading's noise at either end
LOUD = 2.0  # times the usual noise: such readings are no ends
LEAST_SHARE = 0.05


def held(channel: Channel, readings: Readings, unit: Array, notes: list[str]) -> Channel:
    """The channel no farther from its readings than the air can be; by how much it was counts as uncertainty."""
    low, high = (bound * unit for bound in reach(readings, channel.resolved_rate))
    value = np.clip(channel.value, low, high)
    away = np.where(channel.raw | ~np.isfinite(channel.value), 0.0, np.abs(value - channel.value))
    if not (moved := away > 0.0).any():
        return channel
    notes.append(
        f"{channel.name}: {counted(int(np.count_nonzero(moved)), 'row')} came out farther from the readings around "
        "than the sensor's lag allows, and are given at the farthest that it does, with as much more uncertainty"
    )
    value = np.where(moved, value, channel.value)
    return replace(channel, value=value, uncertainty=np.hypot(channel.uncertainty, away))


def reach(readings: Readings, resolved_rate: float) -> tuple[Array, Array]:
    """Least and largest air (n,) that the readings around each row allow, in their own unit."""
    noise = np.sqrt(readings.noise_variance)
    rows = np.arange(readings.reading.size)
    ends = np.flatnonzero(readings.usable & (noise <= LOUD * np.median(noise[readings.usable])))
    if not ends.size:
        ends = np.flatnonzero(readings.usable)
    # gaps bridged by straight lines: what lies between two readings is no farther than they are
    around = np.interp(rows, ends, readings.reading[ends])
    period = typical_period(readings.time_s)
    size = min(2 * int(np.ceil(REMEMBERED * readings.response.slowest_s / period)) + 1, 2 * rows.size + 1)
    margin = SIGMAS * float(np.median(noise[ends]))
    low = minimum_filter1d(around, size, mode="nearest") - margin
    high = maximum_filter1d(around, size, mode="nearest") + margin
    resolved = max(np.pi / resolved_rate, period)
    share = max(largest_share(readings.response, resolved), LEAST_SHARE)
    spread = (high - low) / share
    return high - spread, low + spread
