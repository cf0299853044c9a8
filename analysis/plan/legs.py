"""The legs of a multicopter's flight over one place, and how long each takes; altitudes are above home."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

CORNERS = 12  # of a circle that is flown as waypoints: 1 % shorter than it


@dataclass(frozen=True)
class Climb:
    """Straight up to `to_m` at `speed_m_s`."""

    to_m: float
    speed_m_s: float


@dataclass(frozen=True)
class Descend:
    """Straight down to `to_m` at `speed_m_s`."""

    to_m: float
    speed_m_s: float


@dataclass(frozen=True)
class Hover:
    """Stay at `altitude_m`, where the drone is by then, for `seconds`."""

    altitude_m: float
    seconds: float


@dataclass(frozen=True)
class OutAndBack:
    """Out for half of `metres` along the plan's heading and back, at the altitude where the drone is."""

    metres: float
    airspeed_m_s: float


@dataclass(frozen=True)
class Turn:
    """Whole circles at the altitude where the drone is."""

    turns: int
    radius_m: float
    airspeed_m_s: float


@dataclass(frozen=True)
class Spiral:
    """Up or down to `to_m` at `speed_m_s` in circles of `radius_m`, flown at about `airspeed_m_s`: at the airspeed that
    ends on a whole circle."""

    to_m: float
    speed_m_s: float
    radius_m: float
    airspeed_m_s: float


Leg = Climb | Descend | Hover | OutAndBack | Turn | Spiral


def end_m(leg: Leg, at_m: float) -> float:
    """Altitude at which a leg ends that begins at `at_m`."""
    return leg.to_m if isinstance(leg, Climb | Descend | Spiral) else at_m


def seconds_of(leg: Leg, at_m: float) -> float:
    """How long a leg takes that begins at `at_m`, speeding up and slowing down left out [s]."""
    match leg:
        case Climb(to_m, speed) | Descend(to_m, speed) | Spiral(to_m, speed, _, _):
            return abs(to_m - at_m) / speed
        case Hover(_, seconds):
            return seconds
        case OutAndBack(metres, speed):
            return metres / speed
        case Turn(turns, radius, speed):
            return turns * _circle_m(radius) / speed


def circles_of(leg: Spiral, at_m: float) -> tuple[int, float]:
    """Whole circles of a spiral, and the airspeed [m/s] that makes them so."""
    seconds, circle_m = abs(leg.to_m - at_m) / leg.speed_m_s, _circle_m(leg.radius_m)
    turns = max(round(leg.airspeed_m_s * seconds / circle_m), 1)
    return turns, turns * circle_m / seconds


def _circle_m(radius_m: float) -> float:
    """Length of a circle as it is flown, from corner to corner."""
    return 2.0 * CORNERS * radius_m * math.sin(math.pi / CORNERS)


def circles(turns: int, radius_m: float) -> Iterator[tuple[float, float]]:
    """Corners of circles from home and back to it: how far away along the heading, and aside [m]."""
    for number in range(1, int(turns) * CORNERS + 1):
        angle = 2.0 * math.pi * (number % CORNERS) / CORNERS
        yield radius_m * (1.0 - math.cos(angle)), radius_m * math.sin(angle)
