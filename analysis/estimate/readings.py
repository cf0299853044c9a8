"""What single readings show without any model: their noise, and the step that a log is rounded to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel

SAME_READING = 1e-9  # of a unit
LEAST_CHANGES = 50
STEPS_APART = 3.0  # rounding steps by which readings of which most repeat differ, where it is not rounding
COARSE_STEPS = 1.5  # times the sensor's own step, from which on rounding says something
ON_STEP = 0.04  # of a step by which readings may miss it
LEAST_EVEN = 6  # distinct readings, from which on those that stand evenly, but not on multiples, are told from chance
LEAST_PRINTED = 16  # distinct readings, from which on a step with fewer digits than it has is told from chance
LEAST_DIGITS = 3.0  # last digits in such a step
MAD_TO_SIGMA = 1.4826  # standard deviations in the median of a normal variable's absolute value


def white_noise(value: NDArray[np.float64]) -> float:
    """Standard deviation of independent noise, from the differences of readings in a row; a few jumps do not count."""
    return MAD_TO_SIGMA * float(np.median(np.abs(np.diff(value)))) / float(np.sqrt(2.0))


def mostly_repeats(channel: Channel, step: float) -> bool:
    """Whether most readings are the one before over again, by more than rounding to `step` makes them."""
    moved = np.abs(np.concatenate([np.diff(value) for _, value in channel.samples]))
    changed = moved[moved > SAME_READING]
    if changed.size < LEAST_CHANGES or changed.size > 0.5 * moved.size:
        return False
    return float(np.median(changed)) > STEPS_APART * step


def rounding_step(channel: Channel) -> float:
    """Step to which all readings are rounded [channel's unit]; 0 where none is found.

    They need not be its multiples: a calibration or a converter's zero comes after the rounding. Readings that are no
    codes at all stand evenly with a probability of (2 `ON_STEP`)^(n - 2).
    """
    values = np.unique(np.round(np.concatenate([y for _, y in channel.samples]), 6))
    gaps = np.diff(values)
    gaps = gaps[gaps > 2e-4]
    if gaps.size < 3:
        return 0.0
    # Counted from gap to gap, so that the digits that a file leaves out do not add up over thousands of steps.
    near = gaps[gaps < 1.3 * np.quantile(gaps, 0.02)]
    smallest = float(near.mean())
    for step in smallest / np.arange(1, 4):
        whole = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(values) / step))])
        if np.ptp(whole) < 3:
            continue
        step, zero = (float(x) for x in np.polyfit(whole, values, 1))
        off = np.quantile(np.abs(values - step * np.rint(values / step)), 0.97)
        if values.size >= LEAST_EVEN:
            off = min(off, np.quantile(np.abs(values - zero - step * whole), 0.97))
        if off < max(ON_STEP * step, 1.2e-4) and step > 3e-4:
            return step
    return _step_in_few_digits(values)


def _step_in_few_digits(values: NDArray[np.float64]) -> float:
    """Step of readings printed with fewer digits than it has, sixteenths of a degree as 25.06, 25.13; 0 where none is.

    `values` (n,) are distinct and sorted [unit]. Readings that are no multiples of anything all lie within half of the
    last digit of one with a probability of (digit / step)^n.
    """
    digit = next((d for d in (0.1, 0.01, 0.001) if np.allclose(values, d * np.rint(values / d), 0.0, 1e-6)), 0.0)
    if not digit or values.size < LEAST_PRINTED:
        return 0.0
    gaps = np.diff(values)
    # One step is printed as two lengths, a digit apart. The more steps have been counted the longer a gap can be told.
    step = float(gaps[gaps < gaps.min() + 1.5 * digit].mean())
    if step < LEAST_DIGITS * digit:
        return 0.0
    steps = span = 0.0
    for gap in np.sort(gaps):
        steps, span = steps + np.rint(gap / step), span + gap
        step = span / steps
    whole = np.cumsum(np.rint(np.append(values[0], gaps) / step))
    unsure = int(abs(values[0]) * digit / (span * step)) + 1
    found = (0.6 * digit, 0.0)  # half a digit, and what the fit lacks
    for codes in (whole + shift for shift in range(-unsure, unsure + 1)):
        step = float(values @ codes / (codes @ codes))
        found = min(found, (float(np.abs(values - step * codes).max()), step))
    return found[1]


def coarser_than_the_sensor(channel: Channel, step: float) -> bool:
    """Whether readings rounded to `step` are coarser than what the sensor resolves, where that is known."""
    return channel.known_sensor and step >= COARSE_STEPS * channel.quantity.resolution


def known_to(step: float) -> float:
    """Standard uncertainty of a rounding step that all readings share."""
    return max(0.002 * step, 1e-5)
