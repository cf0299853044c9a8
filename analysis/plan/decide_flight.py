"""The flight that would decide between models of a sensor: expected information of candidate flights, per minute.

Under model i the readings of a flight are Gaussian with covariance S_i and offset d_i, as `analysis.learn.density` has
them. It leaves the line through the air's profile open (a wide prior); a flight to come meets air of the usual slope,
under which the readings' covariance is A_i. What it is expected to say for i where i is right, against j, is

    D(i, j) = E_i[ln p_i - ln p_j] = 1/2 (tr(S_j^-1 (A_i + d d') - S_i^-1 A_i) + ln|S_j| - ln|S_i|),   d = d_i - d_j

nats, a difference of two Kullback-Leibler divergences, and one where A is S (Kullback 1959, ch. 9); at its least over
what j may say of the air instead: its sizes and the moves of its layers, each with the prior that a fit gives it. So
nothing counts that a change of the air would explain as well. The information of a flight is the mean of D over
ordered pairs of candidates, by their weights, added over channels.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from shockrig.analysis.effects.forms import USUAL_PERCENT
from shockrig.analysis.learn.bins import LEAST_PASS_M, REFERENCE_TEMPERATURE_C, FlightBins, binned
from shockrig.analysis.learn.density import MOVE_STEP, MOVES, UNKNOWN, WALKS, FlightChannelData, SensorModel, prepared
from shockrig.analysis.learn.laws import LAWS, Law
from shockrig.analysis.learn.learn import NAMED_FROM
from shockrig.analysis.physics.standard_atmosphere import LAYERS
from shockrig.analysis.plan.flight_plan import (
    LEVEL_USUAL_M_S,
    TAKEOFF_M_S,
    TAKEOFF_TO_M,
    Hover,
    Leg,
    OutAndBack,
    Straight,
    end_m,
    flown,
    minutes,
    seconds_of,
    whole,
)
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight
from shockrig.files.learned import REMEDY, LearnedChannel, LearnedFile
from shockrig.files.ranges import LIKELY_RANGES
from shockrig.files.spelling import did_you_mean

Array = NDArray[np.float64]

CANDIDATE_BINS = 64  # of a candidate flight: as fine as two models of a sensor differ
RANGE_OVER_SIGMA = math.sqrt(12.0)  # range of what is spread evenly, over its standard deviation
MOST_CANDIDATES = 3  # of a channel: the most probable, each against each
LEGAL_CEILING_M = 120.0  # above ground without a permission in most countries (EU 2019/947; FAA part 107: 400 ft)
ENDURANCE_MINUTES = 20.0  # of a usual multicopter
FAST_UP_M_S, FAST_DOWN_M_S = 5.0, 3.0
SLOW_M_S, SLOW_LEVEL_M_S = 1.0, 2.0
SLOWEST_SHARE = 0.4  # of the endurance that a slow climb takes at most
HOVER_S = 120.0  # twice the time that a stem or a housing usually takes
LEVEL_S = 60.0  # out and back at one airspeed
BOUND_ROUNDING = 1e-6
DECISIVE_NATS = -math.log(1.0 - NAMED_FROM)  # 20 to 1
LEAST_NATS = 0.05  # of a flight that says anything
SUNLIT = ("ventilated_warmth", "warm_die")
AT_NIGHT = (
    "Fly the same once more at night or under a closed cloud. Warmth that stays is the sensor's own; warmth that goes "
    "is the sun's."
)


@dataclass(frozen=True)
class FlightLimits:
    """What a drone may and can do: ceiling above home [m], endurance [min]."""

    ceiling_m: float = LEGAL_CEILING_M
    endurance_minutes: float = ENDURANCE_MINUTES


@dataclass(frozen=True)
class DecidingFlight:
    """A flight that could be flown: in a word what it is, its legs, and the nats expected of each channel."""

    what: str
    legs: tuple[Leg, ...]
    nats_of: Mapping[str, float]

    @property
    def nats(self) -> float:
        """Of all channels."""
        return sum(self.nats_of.values())

    @property
    def minutes(self) -> float:
        """From takeoff to landing."""
        return minutes(self.legs)

    @property
    def nats_per_minute(self) -> float:
        """What it is ranked by."""
        return self.nats / self.minutes


def ranked(learned: LearnedFile, limits: FlightLimits) -> list[DecidingFlight]:
    """Flights within limits by the information that a minute brings, most first.

    Raises
    ------
    InputError
        No flight is within the limits, or a model is none that is known.
    """
    candidates = {channel: candidates_of(channel, one) for channel, one in learned.channels.items()}
    found = []
    for what, legs in menu(limits).items():
        bins = planned_bins(legs, learned)
        nats = {channel: expected_nats(bins, channel, learned, models) for channel, models in candidates.items()}
        found.append(DecidingFlight(what, legs, nats))
    return sorted(found, key=lambda one: -one.nats_per_minute)


def candidates_of(channel: str, learned: LearnedChannel) -> list[tuple[SensorModel, float]]:
    """The most probable models of a channel with their weights; raises InputError where one is not known."""
    found = []
    for i, one in enumerate(learned.rivals[:MOST_CANDIDATES]):
        where = f"channels.{channel}.rivals[{i}]"
        laws = tuple(_law(f"{where}.laws", channel, key) for key in one.laws)
        for parameter in (parameter for law in laws for parameter in law.parameters):
            value = one.values.get(parameter.name, math.nan)
            slack = BOUND_ROUNDING * (1.0 + abs(value))  # a fit ends at a bound, and is rounded
            if not parameter.low - slack <= value <= parameter.high + slack:
                raise InputError(
                    f"{where}.values: {parameter.name} {value:g}; expected {parameter.low:g} to {parameter.high:g} "
                    f"{parameter.unit}; {REMEDY}"
                )
        found.append((SensorModel(laws, one.values), one.probability))
    return found


def _law(where: str, channel: str, key: str) -> Law:
    known = {law.key: law for law in LAWS.values() if law.channel in ("", channel)}
    if key not in known:
        raise InputError(f"{where}: no law {key!r}{did_you_mean(key, list(known))}; {REMEDY}")
    return known[key]


def by_night(learned: LearnedFile) -> bool:
    """Whether a flight without sun would say more: radiation and a sensor's own warmth are one law by day."""
    return any(key in SUNLIT for one in learned.channels.values() for model in one.rivals for key in model.laws)


def advice(flight: DecidingFlight) -> str:
    """How often a flight has to be flown before it decides, in a sentence."""
    if flight.nats < LEAST_NATS:
        return "nothing that a flight of this menu would decide is left open"
    times = math.ceil(DECISIVE_NATS / flight.nats)
    odds = f"{flight.nats:.1f} nats are expected of it, 3 of which are 20 to 1"
    return f"{odds}: once should decide" if times == 1 else f"{odds}: about {times} such flights decide"


def menu(limits: FlightLimits) -> dict[str, tuple[Leg, ...]]:
    """Candidate flights within limits, each with what it is in a word.

    Raises
    ------
    InputError
        There is none: the ceiling cannot be, or the drone cannot fly so long.
    """
    low, top = TAKEOFF_TO_M, limits.ceiling_m
    if not top >= low + 2.0 * LEAST_PASS_M:
        raise InputError(
            f"a ceiling of {top:g} m above home leaves no air to pass twice; expected {low + 2.0 * LEAST_PASS_M:g} m "
            "or more"
        )
    if not LIKELY_RANGES["altitude_m"].holds(top):
        raise InputError(f"a ceiling {LIKELY_RANGES['altitude_m'].refusal(top)}")
    middle = round(0.5 * (low + top))
    slowest = (top - low) / max(SLOWEST_SHARE * 60.0 * limits.endurance_minutes, 1.0)
    slow = min(max(SLOW_M_S, slowest), FAST_UP_M_S)
    up, down, hover = Straight(top, FAST_UP_M_S), Straight(low, FAST_DOWN_M_S), Hover(HOVER_S)
    flights: dict[str, tuple[Leg, ...]] = {
        "up and down at one speed": (Straight(top, TAKEOFF_M_S), Straight(low, TAKEOFF_M_S)),
        "up and down fast": (up, down),
        "slow up, fast down": (Straight(top, slow), down),
        "fast up, a hover at the top, fast down": (up, hover, down),
        "slow up, a hover at the top, fast down": (Straight(top, slow), hover, down),
        "fast up and down with a hover halfway": (Straight(middle, FAST_UP_M_S), hover, up, down),
        "up and down twice in a row": (up, down, up, down),
        "up and down, slow and then fast": (Straight(top, slow), down, up, Straight(low, min(slow, FAST_DOWN_M_S))),
        "level out and back at two airspeeds": (
            Straight(middle, TAKEOFF_M_S),
            *(OutAndBack(LEVEL_S * airspeed, airspeed) for airspeed in (SLOW_LEVEL_M_S, LEVEL_USUAL_M_S)),
            Straight(low, TAKEOFF_M_S),
        ),
    }
    found = {what: legs for what, legs in flights.items() if minutes(legs) <= limits.endurance_minutes}
    if not found:
        raise InputError(
            f"no flight to {top:g} m takes less than {limits.endurance_minutes:g} minutes; give a lower ceiling or a "
            "longer endurance"
        )
    return found


def planned_bins(legs: Sequence[Leg], learned: LearnedFile) -> FlightBins:
    """Bins of a flight as they will be, read once a second in calm air."""
    legs = whole(legs)
    times = np.cumsum([0.0, *(seconds_of(leg, at_m) for leg, at_m in flown(legs))])
    heights = [0.0, *(end_m(leg, at_m) for leg, at_m in flown(legs))]
    airspeed_of = np.array([0.0 if isinstance(leg, Hover) else leg.speed_m_s for leg in legs])
    time = np.arange(0.0, times[-1], 1.0)
    airspeed = airspeed_of[np.searchsorted(times, time, side="right") - 1]
    return bins_along(time, np.interp(time, times, heights), airspeed, learned)


def bins_along(time_s: Array, altitude_m: Array, airspeed_m_s: Array, learned: LearnedFile) -> FlightBins:
    """Bins of a track (n,) through air that changes evenly with altitude, by as much as the flights showed."""
    temperature, humidity = learned.channels.get("temperature"), learned.channels.get("humidity")
    mean_c = temperature.mean if temperature and temperature.mean is not None else REFERENCE_TEMPERATURE_C
    percent = humidity.mean if humidity and humidity.mean is not None else USUAL_PERCENT
    lapse = -LAYERS[0][2]  # where flights said nothing of temperature
    if temperature:
        lapse = temperature.unit * RANGE_OVER_SIGMA / float(np.ptp(learned.altitude_m))
    unknown = np.full(time_s.size, np.nan)
    flight = Flight(
        time_s=time_s,
        temperature_c=mean_c - lapse * (altitude_m - altitude_m.mean()),
        humidity_percent=np.full(time_s.size, percent),
        airspeed_m_s=airspeed_m_s,
        die_temperature_c=unknown,
        pressure_hpa=unknown,
        altitude_m=altitude_m,
    )
    return binned(flight, "the next flight", CANDIDATE_BINS)


def expected_nats(
    bins: FlightBins, channel: str, learned: LearnedFile, candidates: Sequence[tuple[SensorModel, float]]
) -> float:
    """Mean of what a flight says over ordered pairs of candidates, by the product of their weights [nats]; 0 where
    there is one.

    The flight's own numbers, as `density` takes them, are what the flights showed, over its altitudes and its minutes.
    Its air is as steep as readings are that spread evenly over altitudes; nobody knows yet where it is steeper.
    """
    pairs = list(permutations(candidates, 2))
    weights = [one * other for (_, one), (_, other) in pairs]
    if not sum(weights) > 0.0:
        return 0.0
    shown, data = learned.channels[channel], prepared(bins, channel)
    data = replace(data, unit=shown.unit, steps=np.ones(data.steps.size))
    walk, smooth_walk, drift, layers, eddies, noise = shown.sizes
    higher = float(np.ptp(bins.within_altitudes)) / float(np.ptp(learned.altitude_m))
    longer = 0.0 if learned.minutes is None else math.log(bins.minutes / learned.minutes)
    walks, changes = (walk + math.log(higher), smooth_walk + math.log(higher)), (drift + longer, layers + longer)
    own = np.r_[walks, changes, eddies, noise, np.zeros(MOVES)]
    line = (RANGE_OVER_SIGMA / 2.0 * higher / UNKNOWN) ** 2  # variance of the slope's column
    nats = [nats_against(data, own, line, right, other) for (right, _), (other, _) in pairs]
    return float(np.average(nats, weights=weights))


def nats_against(data: FlightChannelData, own: Array, line: float, right: SensorModel, other: SensorModel) -> float:
    """Nats that readings under `right`, with the air's numbers `own` and its `line`, are expected to speak against
    `other`."""
    truth = _covariance(data, own, right, right.seen_air(data, own[-MOVES:]), line)
    off = right.offset(data) - other.offset(data)
    expected = truth + np.outer(off, off)

    def cost(away: Array) -> tuple[float, Array]:
        value, slope = _against(data, own + data.spread * away, other, expected)
        return value + 0.5 * float(away @ away), data.spread * slope + away

    least = minimize(cost, np.zeros(own.size), jac=True, method="L-BFGS-B")
    return max(float(least.fun) - _against(data, own, right, truth)[0], 0.0)


def _covariance(data: FlightChannelData, own: Array, sensor: SensorModel, seen: Array, line: float = 1.0) -> Array:
    """Of a flight's readings (m, m) under a model that sees the air as `seen`; before a flight whose `line` is known,
    the sensor is settled."""
    sizes = np.exp(own[:-MOVES])
    found = (data.weighed(seen, own) * np.r_[1.0, line, np.ones(data.steps.size)]) @ seen.T
    found += np.tensordot(sizes[WALKS:-1], data.changes, axes=1) + sizes[-1] * np.eye(seen.shape[0])
    if line < 1.0:
        return np.asarray(found)
    start = sensor.settling(data)
    return np.asarray(found + UNKNOWN**2 * np.outer(start, start))


def _against(data: FlightChannelData, own: Array, sensor: SensorModel, expected: Array) -> tuple[float, Array]:
    """Mean of minus the log density of readings of second moment `expected`, less n/2 ln 2 pi [nats], and its slope
    over the air's own numbers."""
    sizes, moves = np.exp(own[:-MOVES]), own[-MOVES:]
    seen = sensor.seen_air(data, moves)
    try:
        factor = cho_factor(_covariance(data, own, sensor, seen), lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        return math.inf, np.zeros(own.size)
    scaled = data.weighed(seen, own)
    steps = seen[:, 2:]
    covariance_slopes = [size * steps @ walk @ steps.T for size, walk in zip(sizes[:WALKS], data.walks, strict=True)]
    covariance_slopes += [size * change for size, change in zip(sizes[WALKS:-1], data.changes, strict=True)]
    covariance_slopes.append(sizes[-1] * np.eye(seen.shape[0]))
    for unit in MOVE_STEP * np.eye(MOVES):
        through = ((sensor.seen_air(data, moves + unit) - seen) / MOVE_STEP) @ scaled.T
        covariance_slopes.append(through + through.T)
    weighed = cho_solve(factor, expected, check_finite=False)
    value = 0.5 * float(weighed.trace()) + float(np.log(factor[0].diagonal()).sum())
    unexplained = cho_solve(factor, np.eye(seen.shape[0]) - weighed.T, check_finite=False)
    return value, 0.5 * np.array([np.vdot(unexplained, one) for one in covariance_slopes])
