"""A flight of a multicopter in legs (climb, descend, hover, level out and back, turn, spiral) over one place, as words
for the pilot, minutes, and the commands of a mission.

Altitudes are above home. The drone takes off, flies the legs one after the other over home, and comes back to land.
Speeds are set by MAV_CMD_DO_CHANGE_SPEED before the leg that needs them, as ArduCopter takes them: of climb (type 2),
of descent (type 3), over the ground (type 1), of which only calm air makes the airspeed. PX4 and others may leave out
types 2 and 3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from shockrig.analysis.plan.legs import (
    CORNERS,
    Climb,
    Descend,
    Hover,
    Leg,
    OutAndBack,
    Spiral,
    Turn,
    circles,
    circles_of,
    end_m,
    seconds_of,
)
from shockrig.files.errors import InputError
from shockrig.files.mission import Command, Item, Mission
from shockrig.files.ranges import LIKELY_RANGES, Range

EARTH_RADIUS_M = 6_371_000.0
# ArduCopter's WPNAV_SPEED_UP, WPNAV_SPEED_DN and WPNAV_SPEED take 0 to 10, 0 to 5 and 0 to 20 m/s; it ignores what is
# slower than a few cm/s.
CLIMB_M_S, DESCENT_M_S, LEVEL_M_S = (Range(0.1, fastest, "is it in km/h") for fastest in (10.0, 5.0, 20.0))
RADIUS_M = Range(5.0, 1000.0, "is it in kilometres")  # ArduCopter rounds the corners within 2 m
# What ArduCopter does by itself: WPNAV_SPEED_UP at takeoff, WPNAV_SPEED until it is set, and for the landing
# WPNAV_SPEED_DN, below LAND_ALT_LOW LAND_SPEED.
TAKEOFF_M_S, LEVEL_USUAL_M_S, DESCENT_USUAL_M_S, LANDING_M_S, LANDING_FROM_M = 2.5, 10.0, 1.5, 0.5, 10.0
LEGAL_CEILING_M = 120.0  # above ground without a permission in most countries (EU 2019/947; FAA part 107: 400 ft)
LONGEST_HOVER_S = 3600.0
MOST_ITEMS = 700  # that the smaller autopilots have room for
ALTITUDE_APART_M = 0.5  # altitudes that are nearer are one
GROUND_SPEED, CLIMB_SPEED, DESCENT_SPEED = 1, 2, 3  # SPEED_TYPE


@dataclass(frozen=True)
class FlightPlan:
    """Legs over one place.

    Attributes
    ----------
    home : tuple
        Latitude [deg], longitude [deg], altitude above the sea [m].
    legs : tuple of Leg
    takeoff_m : float
        Altitude to which the drone rises by itself before the first leg.
    heading_deg : float
        Where `OutAndBack` goes out to, and on which side circles lie, clockwise from north.
    end : {"return", "land"}
        At last: return to launch, or land where the legs ended.
    ceiling_m : float
        What no leg may be above.
    endurance_minutes : float, optional
        How long the drone can fly; a plan that needs more is refused.

    Raises
    ------
    InputError
        A leg cannot be flown: says which, what is expected, and the remedy.
    """

    home: tuple[float, float, float]
    legs: tuple[Leg, ...]
    takeoff_m: float = 10.0
    heading_deg: float = 0.0
    end: str = "return"
    ceiling_m: float = LEGAL_CEILING_M
    endurance_minutes: float | None = None

    def __post_init__(self) -> None:
        latitude, longitude, altitude = self.home
        for name, value, possible in (
            ("latitude", latitude, Range(-89.0, 89.0)),
            ("longitude", longitude, Range(-180.0, 180.0)),
            ("altitude", altitude, LIKELY_RANGES["altitude_m"]),
        ):
            if not possible.holds(value):
                raise InputError(f"home: {name} {possible.refusal(value)}; give latitude, longitude, altitude")
        if not LIKELY_RANGES["altitude_m"].holds(self.ceiling_m):
            raise InputError(f"ceiling_m {LIKELY_RANGES['altitude_m'].refusal(self.ceiling_m)}")
        if self.end not in {"return", "land"}:
            raise InputError(f"end {self.end!r}: expected 'return' or 'land'")
        if not math.isfinite(self.heading_deg):
            raise InputError("heading_deg: expected degrees clockwise from north")
        if not self.legs:
            raise InputError("a flight plan without legs; give at least one")
        _demand_altitude("takeoff", self.takeoff_m, self)
        at_m = self.takeoff_m
        for number, leg in enumerate(self.legs, start=1):
            at_m = _demand_flown(f"leg {number}", leg, at_m, self)
        if (count := len(list(_items(self)))) > MOST_ITEMS:
            raise InputError(f"{count} mission items; autopilots hold about {MOST_ITEMS}: fewer circles, or wider ones")
        needed = minutes(self)
        if self.endurance_minutes is not None and not needed <= self.endurance_minutes:
            raise InputError(
                f"the flight takes {needed:.1f} minutes and the drone flies {self.endurance_minutes:g}; "
                "leave out legs, fly them faster, or make two flights of them"
            )


def _demand_flown(where: str, leg: Leg, at_m: float, plan: FlightPlan) -> float:
    """Check a leg that begins at `at_m`; the altitude at which it ends."""
    match leg:
        case Climb(to_m, speed):
            _demand(where, "speed_m_s", speed, CLIMB_M_S)
            _demand_higher(where, to_m, at_m, plan)
        case Descend(to_m, speed):
            _demand(where, "speed_m_s", speed, DESCENT_M_S)
            _demand_lower(where, to_m, at_m, plan)
        case Hover(to_m, seconds):
            _demand(where, "seconds", seconds, Range(1.0, LONGEST_HOVER_S, "is it in minutes"))
            if not abs(to_m - at_m) <= ALTITUDE_APART_M:
                raise InputError(
                    f"{where}: a hover at {to_m:g} m, and the drone is at {at_m:g} m; climb or descend before it"
                )
        case OutAndBack(metres, speed):
            _demand(where, "metres", metres, Range(10.0, 20_000.0, "is it in kilometres"))
            _demand(where, "airspeed_m_s", speed, LEVEL_M_S)
        case Turn(turns, radius, speed):
            _demand(where, "turns", turns, Range(1, MOST_ITEMS // CORNERS))
            if turns != int(turns):
                raise InputError(f"{where}: {turns:g} turns; give whole circles, which end where they began")
            _demand(where, "radius_m", radius, RADIUS_M)
            _demand(where, "airspeed_m_s", speed, LEVEL_M_S)
        case Spiral(to_m, speed, radius, airspeed):
            up = to_m > at_m
            _demand(where, "speed_m_s", speed, CLIMB_M_S if up else DESCENT_M_S)
            _demand(where, "radius_m", radius, RADIUS_M)
            _demand(where, "airspeed_m_s", airspeed, LEVEL_M_S)
            (_demand_higher if up else _demand_lower)(where, to_m, at_m, plan)
            _demand(where, "airspeed_m_s on whole circles", circles_of(leg, at_m)[1], LEVEL_M_S)
    return end_m(leg, at_m)


def _demand(where: str, name: str, value: float, possible: Range) -> None:
    if not possible.holds(value):
        raise InputError(f"{where}: {name} {possible.refusal(value)}")


def _demand_altitude(where: str, altitude_m: float, plan: FlightPlan) -> None:
    if not 2.0 <= altitude_m <= plan.ceiling_m:
        raise InputError(
            f"{where}: {altitude_m:g} m above home; expected 2 m to the ceiling of {plan.ceiling_m:g} m "
            "(ceiling_m says what you are permitted)"
        )


def _demand_higher(where: str, to_m: float, at_m: float, plan: FlightPlan) -> None:
    _demand_altitude(where, to_m, plan)
    if not to_m > at_m + ALTITUDE_APART_M:
        raise InputError(f"{where}: a climb to {to_m:g} m, and the drone is at {at_m:g} m; give a higher altitude")


def _demand_lower(where: str, to_m: float, at_m: float, plan: FlightPlan) -> None:
    _demand_altitude(where, to_m, plan)
    if not to_m < at_m - ALTITUDE_APART_M:
        raise InputError(f"{where}: a descent to {to_m:g} m, and the drone is at {at_m:g} m; give a lower altitude")


def _flown(plan: FlightPlan) -> Iterator[tuple[Leg, float]]:
    """Each leg with the altitude at which it begins."""
    at_m = plan.takeoff_m
    for leg in plan.legs:
        yield leg, at_m
        at_m = end_m(leg, at_m)


def minutes(plan: FlightPlan) -> float:
    """How long a flight takes from takeoff to landing, with ArduCopter's own speeds where the plan sets none [min]."""
    seconds = plan.takeoff_m / TAKEOFF_M_S + sum(seconds_of(leg, at_m) for leg, at_m in _flown(plan))
    last_m = [end_m(leg, at_m) for leg, at_m in _flown(plan)][-1]
    above_m = max(last_m - LANDING_FROM_M, 0.0)
    return (seconds + above_m / DESCENT_USUAL_M_S + (last_m - above_m) / LANDING_M_S) / 60.0


def words(plan: FlightPlan) -> list[str]:
    """A sentence for the pilot for each part of the flight; altitudes are above home."""
    sentences = [f"Take off and rise to {plan.takeoff_m:g} m above home."]
    for leg, at_m in _flown(plan):
        took = f"({seconds_of(leg, at_m) / 60.0:.1f} min)"
        match leg:
            case Climb(to_m, speed):
                sentences.append(f"Climb straight up from {at_m:g} to {to_m:g} m at {speed:g} m/s {took}.")
            case Descend(to_m, speed):
                sentences.append(f"Descend straight down from {at_m:g} to {to_m:g} m at {speed:g} m/s {took}.")
            case Hover(_, seconds):
                sentences.append(f"Hover at {at_m:g} m for {seconds:g} s.")
            case OutAndBack(metres, speed):
                sentences.append(
                    f"Fly level at {at_m:g} m, {metres / 2:g} m out towards {plan.heading_deg % 360:g}° and back, at "
                    f"{speed:g} m/s over the ground {took}."
                )
            case Turn(turns, radius, speed):
                rounds = "one circle" if turns == 1 else f"{turns:g} circles"
                sentences.append(
                    f"Fly {rounds} of {radius:g} m radius at {at_m:g} m, at {speed:g} m/s over the ground {took}."
                )
            case Spiral(to_m, speed, radius, _):
                turns, airspeed = circles_of(leg, at_m)
                way = "up" if to_m > at_m else "down"
                rounds = "one circle" if turns == 1 else f"{turns} circles"
                sentences.append(
                    f"Spiral {way} from {at_m:g} to {to_m:g} m at {speed:g} m/s in {rounds} of {radius:g} m radius, at "
                    f"{airspeed:.1f} m/s over the ground {took}."
                )
    sentences.append("Return to launch and land." if plan.end == "return" else "Land.")
    sentences.append(f"The flight takes {minutes(plan):.1f} minutes.")
    return sentences


def mission_of(plan: FlightPlan) -> Mission:
    """The commands of a flight."""
    return Mission(plan.home, tuple(_items(plan)), LEVEL_USUAL_M_S)


def _items(plan: FlightPlan) -> Iterator[Item]:
    """Commands from takeoff to landing; a speed is set where it is not what it was."""
    set_m_s: dict[int, float] = {}

    def speed(kind: int, value: float) -> Iterator[Item]:
        if set_m_s.get(kind) != value:
            set_m_s[kind] = value
            yield Item(Command.CHANGE_SPEED, (float(kind), value, -1.0, 0.0))  # -1: the throttle as it is

    def waypoint(altitude_m: float, away_m: float = 0.0, aside_m: float = 0.0) -> Item:
        return Item(Command.WAYPOINT, position=_place(plan, altitude_m, away_m, aside_m))

    yield Item(Command.TAKEOFF, position=_place(plan, plan.takeoff_m))
    for leg, at_m in _flown(plan):
        match leg:
            case Climb(to_m, value):
                yield from speed(CLIMB_SPEED, value)
                yield waypoint(to_m)
            case Descend(to_m, value):
                yield from speed(DESCENT_SPEED, value)
                yield waypoint(to_m)
            case Hover(_, seconds):
                yield Item(Command.LOITER_TIME, (seconds, 0.0, 0.0, 0.0), _place(plan, at_m))
            case OutAndBack(metres, value):
                yield from speed(GROUND_SPEED, value)
                yield waypoint(at_m, metres / 2)
                yield waypoint(at_m)
            case Turn(turns, radius, value):
                yield from speed(GROUND_SPEED, value)
                yield from (waypoint(at_m, *around) for around in circles(turns, radius))
            case Spiral(to_m, value, radius, _):
                turns, over_ground = circles_of(leg, at_m)
                yield from speed(GROUND_SPEED, over_ground)
                yield from speed(CLIMB_SPEED if to_m > at_m else DESCENT_SPEED, value)
                corners = turns * CORNERS
                for number, around in enumerate(circles(turns, radius), start=1):
                    yield waypoint(at_m + (to_m - at_m) * number / corners, *around)
    yield Item(Command.RETURN_TO_LAUNCH) if plan.end == "return" else Item(Command.LAND, position=_place(plan, 0.0))


def _place(
    plan: FlightPlan, altitude_m: float, away_m: float = 0.0, aside_m: float = 0.0
) -> tuple[float, float, float]:
    """Latitude, longitude [deg] and altitude above home of a point so far from home along the heading, and to its
    right."""
    heading = math.radians(plan.heading_deg)
    north_m = away_m * math.cos(heading) - aside_m * math.sin(heading)
    east_m = away_m * math.sin(heading) + aside_m * math.cos(heading)
    latitude, longitude, _ = plan.home
    around_m = EARTH_RADIUS_M * math.cos(math.radians(latitude))
    east_deg = longitude + math.degrees(east_m / around_m)
    return latitude + math.degrees(north_m / EARTH_RADIUS_M), (east_deg + 180.0) % 360.0 - 180.0, altitude_m
