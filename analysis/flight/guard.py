"""How far the air can be from the readings around it, whatever a method makes of them.

What the air did for as long as the method resolves shows in the readings by at least the share g of its size that the
sensor shows in that time. So the air is farther from the reading by no more than (spread of the readings around) / g:
around is as long as the sensor remembers, and as far as the nearest readings.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from shockrig.analysis.flight.channel import FlightChannel, FlightReadings
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.flight.stretches import largest_share
from shockrig.files.numbers import counted

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
REMEMBERED_LAGS = 5.0  # of the slowest time constant: what is left of a step is less than its hundredth
READING_SIGMAS = 4.0  # of a reading's noise at either end
LEAST_SHARE = 0.05
MOST_SHARE = 0.8  # readings are noisy, and a sensor is seldom what its profile says to a fifth
USUAL_TIMES = 2.0  # the median uncertainty, up to which a method is as certain as usual
SURE_SIGMAS = 2.0  # standard uncertainties
USUAL_NOISES = 3.0  # and up to so many times the reading's noise


def held(
    channel: FlightChannel,
    readings: FlightReadings,
    raw: Array,
    unit: Array,
    notes: list[str],
    possible: tuple[float, float] = (-np.inf, np.inf),
    left_open: Array | float = 0.0,
) -> FlightChannel:
    """The channel no farther from its readings than the air can be; by how much it was counts as uncertainty.

    `unit` turns the readings' unit into that of `raw`, the log's; `possible` is what no air is beyond; `left_open` (n,)
    is the uncertainty of what lags, in the log's unit, that reading and result have in common and their difference not.
    """
    low, high = (bound * unit for bound in reach(readings, channel.resolved_rate))
    # where the sensor was read, if not anew, the air may be as it says
    own = np.where(channel.screened.usable | channel.screened.repeated, readings.reading * unit, np.nan)
    value = np.clip(channel.value, np.fmin(low, own), np.fmax(high, own))
    # what is out by less than is stated is that, and what is far out was no estimate
    out = np.abs(np.clip(value, *possible) - value) > READING_SIGMAS * channel.uncertainty
    value = np.where(out, np.clip(value, *possible), value)
    sigma = channel.uncertainty
    if (capped := _capped(channel, np.full(raw.shape, -np.inf)) & ~channel.raw).any():
        value = _above_ceiling(value, raw, capped, channel, notes)
        beyond = np.where(capped & np.isfinite(value), value - raw, 0.0)
        wider = np.hypot(channel.uncertainty, beyond)
        channel = replace(channel, value=np.where(capped, value, channel.value), uncertainty=wider)
    away = np.where(channel.raw | ~np.isfinite(channel.value), 0.0, np.abs(value - channel.value))
    if (moved := away > 0.0).any():
        notes.append(
            f"{channel.name}: {counted(int(np.count_nonzero(moved)), 'row')} came out farther from the readings around "
            "than the sensor's lag allows, and are given at the farthest that it does, with as much more uncertainty"
        )
        value = np.where(moved, value, channel.value)
        channel = replace(channel, value=value, uncertainty=np.hypot(channel.uncertainty, away))
    # how far beyond a ceiling the air is counts as uncertainty, and is what is asked for
    unsure = np.hypot(np.where(capped, sigma, channel.uncertainty), left_open)
    return _nearer(channel, readings, unit, unsure)


def _capped(channel: FlightChannel, beyond: Array) -> Mask:
    """Rows (n,) at the ceiling where the sensor stops, but where that is what no air is `beyond` (n,)."""
    capped = channel.screened.capped
    return np.zeros(channel.value.shape, dtype=bool) if capped is None else capped & (beyond < 0.0)


def _nearer(channel: FlightChannel, readings: FlightReadings, unit: Array, sigma: Array) -> FlightChannel:
    """The channel nearer to its readings where it is far less certain than elsewhere in the flight.

    That the reading is right is one of the explanations: of a difference d that is unsure by s, d^4 / (d^4 + s^4) is
    kept, all of one that is sure and nothing of one that is not. s is two sigmas of what exceeds the usual uncertainty;
    what is stated stays.
    """
    seen = np.isfinite(readings.reading) & (channel.screened.usable | channel.screened.repeated)
    if not seen.any():
        return channel
    # in a gap, what lies between the readings on either side
    rows = np.arange(seen.size)
    reading = np.interp(rows, rows[seen], readings.reading[seen]) * unit
    known = np.isfinite(channel.value) & np.isfinite(sigma) & ~channel.raw
    if not known.any():
        return channel
    # of rows that were read: of a flight that hardly was, a gap's is no usual one
    read = known & readings.usable
    noise = np.interp(rows, rows[seen], np.sqrt(readings.noise_variance)[seen]) * unit
    usual = np.maximum(USUAL_TIMES * np.median(sigma[read if read.any() else known]), USUAL_NOISES * noise)
    off = np.where(known, channel.value - reading, 0.0)
    extra = np.where(known, SURE_SIGMAS**2 * np.maximum(sigma**2 - usual**2, 0.0), 0.0)
    vague = extra > 0.0
    if not vague.any():
        return channel
    fourth = np.square(np.square(off))
    kept = np.divide(fourth, fourth + extra**2, out=np.ones(off.shape), where=vague)
    return replace(channel, value=np.where(vague, reading + kept * off, channel.value))


def _above_ceiling(value: Array, raw: Array, capped: Mask, channel: FlightChannel, notes: list[str]) -> Array:
    """Values where the sensor stopped: it was there or above."""
    limit = float(np.max(raw[capped]))
    notes.append(
        f"{channel.name}: {counted(int(np.count_nonzero(capped)), 'row')} are held at {limit:.6g}, the largest there "
        "is: they say that the sensor was there or above"
    )
    # the sensor, not the air: that lies as far from it as it does without the ceiling
    shown = value - channel.lag
    return np.where(capped & np.isfinite(value), value + np.maximum(limit - shown, 0.0), value)


def _remembered(readings: FlightReadings) -> int:
    """Rows for which a reading tells of the air before."""
    response = readings.response
    slowest_s = float(np.max(np.where(np.abs(response.weight) > LEAST_SHARE, 1.0 / response.rate, 0.0)))
    lasting_s = REMEMBERED_LAGS * max(slowest_s, response.slowest_s) + abs(readings.delay_s)
    return int(np.ceil(lasting_s / typical_period(readings.time_s)))


def reach(readings: FlightReadings, resolved_rate: float) -> tuple[Array, Array]:
    """Least and largest air (n,) that the readings around each row allow, in the readings' own unit; in a gap those on
    either side."""
    noise = np.sqrt(readings.noise_variance)
    rows = np.arange(readings.reading.size)
    ends = np.flatnonzero(readings.usable if readings.loud is None else readings.usable & ~readings.loud)
    if not ends.size:
        ends = np.flatnonzero(readings.usable)
    # gaps bridged by straight lines: what lies between two readings is no farther than they are
    around = np.interp(rows, ends, readings.reading[ends])
    period = typical_period(readings.time_s)
    response = readings.response
    size = min(2 * _remembered(readings) + 1, 2 * rows.size + 1)
    margin = READING_SIGMAS * float(np.median(noise[ends]))
    low = minimum_filter1d(around, size, mode="nearest") - margin
    high = maximum_filter1d(around, size, mode="nearest") + margin
    resolved = max(np.pi / resolved_rate, period)
    spread = (high - low) / float(np.clip(largest_share(response, resolved), LEAST_SHARE, MOST_SHARE))
    return around - spread, around + spread
