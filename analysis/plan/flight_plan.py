"""A flight of a multicopter in legs (straight up or down, hover, level out and back) over one place, as words for the
pilot, minutes, and the commands of a mission.

Altitudes are above home. The drone takes off, flies the legs one after the other over home, and comes back to land.
Speeds are set by MAV_CMD_DO_CHANGE_SPEED before the leg that needs them, as ArduCopter takes them: of climb (type 2),
of descent (type 3), over the ground (type 1), of which only calm air makes the airspeed. PX4 and others may leave out
types 2 and 3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from shockrig.files.mission import Command, Item, Mission, Speed

EARTH_RADIUS_M = 6_371_000.0
TAKEOFF_TO_M = 10.0  # altitude to which the drone rises by itself before the first leg
# What ArduCopter does by itself: WPNAV_SPEED_UP at takeoff, WPNAV_SPEED until it is set, and for the landing
# WPNAV_SPEED_DN, below LAND_ALT_LOW LAND_SPEED.
TAKEOFF_M_S, LEVEL_USUAL_M_S, DESCENT_USUAL_M_S, LANDING_M_S, LANDING_FROM_M = 2.5, 10.0, 1.5, 0.5, 10.0


@dataclass(frozen=True)
class Straight:
    """Straight up or down to `to_m` at `speed_m_s`."""

    to_m: float
    speed_m_s: float


@dataclass(frozen=True)
class Hover:
    """Stay where the drone is for `seconds`."""

    seconds: float


@dataclass(frozen=True)
class OutAndBack:
    """North for half of `metres` and back, at the altitude where the drone is."""

    metres: float
    speed_m_s: float


Leg = Straight | Hover | OutAndBack
Home = tuple[float, float, float]


def end_m(leg: Leg, at_m: float) -> float:
    """Altitude at which a leg ends that begins at `at_m`."""
    return leg.to_m if isinstance(leg, Straight) else at_m


def seconds_of(leg: Leg, at_m: float) -> float:
    """How long a leg takes that begins at `at_m`, speeding up and slowing down left out [s]."""
    match leg:
        case Straight(to_m, speed):
            return abs(to_m - at_m) / speed
        case Hover(seconds):
            return seconds
        case OutAndBack(metres, speed):
            return metres / speed


def whole(legs: Sequence[Leg]) -> tuple[Leg, ...]:
    """A flight's legs with takeoff and landing, as ArduCopter flies these by itself."""
    landing = (Straight(LANDING_FROM_M, DESCENT_USUAL_M_S), Straight(0.0, LANDING_M_S))
    return (Straight(TAKEOFF_TO_M, TAKEOFF_M_S), *legs, *landing)


def flown(legs: Sequence[Leg], at_m: float = 0.0) -> Iterator[tuple[Leg, float]]:
    """Each leg with the altitude at which it begins, the first at `at_m`."""
    for leg in legs:
        yield leg, at_m
        at_m = end_m(leg, at_m)


def minutes(legs: Sequence[Leg]) -> float:
    """How long a flight takes from takeoff to landing [min]."""
    return sum(seconds_of(leg, at_m) for leg, at_m in flown(whole(legs))) / 60.0


def words(legs: Sequence[Leg]) -> list[str]:
    """A sentence for the pilot for each part of the flight; altitudes are above home."""
    sentences = [f"Take off and rise to {TAKEOFF_TO_M:g} m above home."]
    for leg, at_m in flown(legs, TAKEOFF_TO_M):
        took = f"({seconds_of(leg, at_m) / 60.0:.1f} min)"
        match leg:
            case Straight(to_m, speed):
                way = "Climb straight up" if to_m > at_m else "Descend straight down"
                sentences.append(f"{way} from {at_m:g} to {to_m:g} m at {speed:g} m/s {took}.")
            case Hover(seconds):
                sentences.append(f"Hover at {at_m:g} m for {seconds:g} s.")
            case OutAndBack(metres, speed):
                sentences.append(
                    f"Fly level at {at_m:g} m, {metres / 2:g} m out towards north and back, at {speed:g} m/s over the "
                    f"ground {took}."
                )
    return [*sentences, "Return to launch and land.", f"The flight takes {minutes(legs):.1f} minutes."]


def mission_of(home: Home, legs: Sequence[Leg]) -> Mission:
    """The commands of a flight over home: latitude, longitude [deg], altitude above the sea [m]."""
    return Mission(home, tuple(_items(home, legs)), LEVEL_USUAL_M_S)


def _items(home: Home, legs: Sequence[Leg]) -> Iterator[Item]:
    """Commands from takeoff to landing; a speed is set where it is not what it was."""
    latitude, longitude, _ = home
    set_m_s: dict[Speed, float] = {}

    def speed(kind: Speed, value: float) -> Iterator[Item]:
        if set_m_s.get(kind) != value:
            set_m_s[kind] = value
            yield Item(Command.CHANGE_SPEED, (float(kind), value, -1.0, 0.0))  # -1: the throttle as it is

    def place(altitude_m: float, north_m: float = 0.0) -> Home:
        return latitude + math.degrees(north_m / EARTH_RADIUS_M), longitude, altitude_m

    yield Item(Command.TAKEOFF, position=place(TAKEOFF_TO_M))
    for leg, at_m in flown(legs, TAKEOFF_TO_M):
        match leg:
            case Straight(to_m, value):
                yield from speed(Speed.CLIMB if to_m > at_m else Speed.DESCENT, value)
                yield Item(Command.WAYPOINT, position=place(to_m))
            case Hover(seconds):
                yield Item(Command.LOITER_TIME, (seconds, 0.0, 0.0, 0.0), place(at_m))
            case OutAndBack(metres, value):
                yield from speed(Speed.GROUND, value)
                yield Item(Command.WAYPOINT, position=place(at_m, metres / 2))
                yield Item(Command.WAYPOINT, position=place(at_m))
    yield Item(Command.RETURN_TO_LAUNCH)
