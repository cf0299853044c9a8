"""The air in other people's chambers as straight lines between knots, and what a body shows of it, exactly in time.

Between knots u = u0 + s h, and each mode of a body, z' = r (u - z), is z = u - s / r + (z0 - u0 + s / r) exp(-r h).
Two knots at one time are a jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foreign_lab.bodies import ForeignBody

Array = NDArray[np.float64]

KNOTS_PER_TIME_CONSTANT = 250  # an exponential is missed by less than 2e-6 of itself
DIED_AWAY = 20.0  # time constants


@dataclass(frozen=True)
class AirCourse:
    """An air over time: `value` (n,) at the knots `time_s` (n,), straight between them, steady outside."""

    time_s: Array
    value: Array

    def at(self, time_s: Array) -> Array:
        """The air at any times; at a jump, what it has jumped to."""
        after = np.searchsorted(self.time_s, time_s, side="right")
        early, late = np.maximum(after - 1, 0), np.minimum(after, self.time_s.size - 1)
        span = self.time_s[late] - self.time_s[early]
        share = np.where(span > 0.0, (time_s - self.time_s[early]) / np.where(span > 0.0, span, 1.0), 0.0)
        return np.asarray(self.value[early] + np.clip(share, 0.0, 1.0) * (self.value[late] - self.value[early]))

    def shown_by(self, body: ForeignBody, time_s: Array) -> Array:
        """What `body`, settled in the air before the first knot, shows at `time_s` (n,) in rising order."""
        rates = body.rates_per_s
        z = np.full(rates.size, self.value[0])
        out = np.full(time_s.size, self.value[0])
        place = np.searchsorted(self.time_s, time_s, side="right")
        for k in range(self.time_s.size):
            last = k == self.time_s.size - 1
            width = np.inf if last else self.time_s[k + 1] - self.time_s[k]
            slope = 0.0 if last or width == 0.0 else (self.value[k + 1] - self.value[k]) / width
            rest = self.value[k] - slope / rates
            inside = np.flatnonzero(place == k + 1)
            if inside.size:
                since = time_s[inside] - self.time_s[k]
                fading = np.exp(-since[:, None] * rates) @ (body.weights * (z - rest))
                out[inside] = float(body.weights @ rest) + slope * since * float(body.weights.sum()) + fading
            if width > 0.0 and not last:
                z = rest + slope * width + (z - rest) * np.exp(-rates * width)
        return out


def _course(time_s: list[float], value: list[float]) -> AirCourse:
    return AirCourse(np.array(time_s, dtype=float), np.array(value, dtype=float))


def ideal_step(start_s: float, source: float, destination: float) -> AirCourse:
    """The air changes at once."""
    return _course([start_s, start_s], [source, destination])


def ramp(start_s: float, source: float, destination: float, duration_s: float) -> AirCourse:
    """The air changes evenly over `duration_s`."""
    return _course([start_s, start_s + duration_s], [source, destination])


def one_approach(start_s: float, source: float, destination: float, time_constant_s: float) -> AirCourse:
    """A chamber that approaches its new state with one time constant."""
    return two_stage(start_s, source, destination, time_constant_s, time_constant_s, 0.0)


def two_stage(
    start_s: float, source: float, destination: float, fast_s: float, slow_s: float, slow_share: float
) -> AirCourse:
    """A chamber whose air comes soon and whose walls follow: two exponentials, `slow_share` of them slow."""
    knots = [np.arange(0.0, DIED_AWAY, 1.0 / KNOTS_PER_TIME_CONSTANT) * tau for tau in (fast_s, slow_s)]
    since = np.unique(np.concatenate(knots if slow_share else knots[:1]))
    left = (1.0 - slow_share) * np.exp(-since / fast_s) + slow_share * np.exp(-since / slow_s)
    left[0] = 1.0
    return AirCourse(start_s + since, destination + (source - destination) * left)


def steps_of(courses: Sequence[AirCourse]) -> AirCourse:
    """Courses of one record, one after the other; each must begin where the one before has come to."""
    return AirCourse(np.concatenate([c.time_s for c in courses]), np.concatenate([c.value for c in courses]))
