"""The readout undone: from what was logged to what the sensing body showed, each effect by its entry's `undo`.

The last link of the chain is taken off first. Delays, noise and ceilings of the readout and the logger are added up
here; what they are is said by the catalogue.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.profile_effects import Acting, Stated, propagated
from shockrig.analysis.physics.exchange import Stream

Array = NDArray[np.float64]
LEAST_NOISE = 1e-6
HALF_STEP = 0.5  # of the reading, in its unit, for the readout's slope
LEAST_SLOPE = 1e-3


@dataclass(frozen=True)
class Undone:
    """A channel's reading without what the readout did to it.

    Attributes
    ----------
    reading : ndarray (n,)
        Of the sensing body.
    gain : ndarray (n,)
        By how much the readout multiplied it: noise is divided by that.
    uncertainty : ndarray (n,)
        Standard uncertainty of the reading that the readout's own parameters leave, common to the flight.
    delay_s, delay_uncertainty_s : float
        How late the reading is, and how well that is known.
    """

    reading: Array
    gain: Array
    uncertainty: Array
    delay_s: float
    delay_uncertainty_s: float


def undone(effects: Sequence[Acting], reading: Array, stream: Stream, length_m: float, period_s: float) -> Undone:
    """Undo the readout of a channel, (n,) arrays; `effects` stand in the order of the chain."""

    def taken_off(effects: Sequence[Acting], values: Array) -> Array:
        for one in reversed(effects):
            if one.meaning.undo is not None:
                values = one.meaning.undo(one.values, values, stream, length_m)
        return values

    middle = np.where(np.isfinite(reading), reading, 0.0)
    slope = taken_off(effects, middle + HALF_STEP) - taken_off(effects, middle - HALF_STEP)
    variance = np.zeros(reading.shape)
    delay_s = late_variance = 0.0
    for i, one in enumerate(effects):
        if one.meaning.undo is not None:

            def changed(values: Stated, i: int = i, one: Acting = one) -> Array:
                return taken_off([*effects[:i], replace(one, values=values), *effects[i + 1 :]], middle)

            variance = variance + propagated(one, changed) ** 2
        if (late := one.meaning.delay_s) is not None:
            delay_s += late(one.values, period_s)
            late_variance += float(propagated(one, lambda values: late(values, period_s))) ** 2
    return Undone(
        taken_off(effects, reading),
        1.0 / np.maximum(np.abs(slope), LEAST_SLOPE),
        np.sqrt(variance),
        delay_s,
        float(np.sqrt(late_variance)),
    )


def noise_floor(effects: Sequence[Acting], noise: float) -> float:
    """Noise of single readings: the sensor's own, and what the logger adds."""
    added = [one.meaning.noise(one.values) for one in effects if one.meaning.noise is not None]
    return max(float(np.hypot.reduce([noise, *added])), LEAST_NOISE)


def ceiling(effects: Sequence[Acting]) -> float | None:
    """Reading at which the sensor stops, None where it does not."""
    limits = [one.meaning.ceiling(one.values) for one in effects if one.meaning.ceiling is not None]
    return min(limits, default=None)


def stale(effects: Sequence[Acting], time_s: Array, reading: Array, period_s: float) -> NDArray[np.bool_]:
    """Rows (n,) that the logger filled with the reading before: equal to it, and known to be of an earlier time."""
    old = np.zeros(time_s.shape, dtype=bool)
    for one in effects:
        if (dated := one.entry.readout.dated) is not None:
            old |= dated(time_s, reading, period_s, one.values) < time_s - 0.5 * period_s
    return old & (np.diff(reading, prepend=np.nan) == 0)


def not_known(effects: Sequence[Acting]) -> float:
    """Standard uncertainty of what is left in the reading, in its unit."""
    left = [one.meaning.uncertainty(one.values) for one in effects if one.meaning.uncertainty is not None]
    return float(np.hypot.reduce([0.0, *left]))
