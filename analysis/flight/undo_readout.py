"""The readout undone: from what was logged to what the sensing body showed, each effect by its catalogue entry's
`undo`.

The last link of the chain is taken off first. Delays, noise and ceilings of the readout and the logger are added up
here; what they are is said by the catalogue.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solveh_banded

from shockrig.analysis.effects import CATALOGUE, OF_FLIGHT
from shockrig.analysis.effects.described import entry_of, of_readings, stated_values
from shockrig.analysis.estimate.effect import Effect, InFlight
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.analysis.physics.standard_atmosphere import pressure_altitude_m
from shockrig.files.diagnosis_data import Discovered
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight
from shockrig.files.profile import StatedEffect
from shockrig.files.profile_data import AMBIENT_TOLERANCE_K
from shockrig.files.ranges import Range

Array = NDArray[np.float64]

# A profile's effects as a flight takes them: what each means stands in the catalogue, and is asked for here.
#
# An effect that the catalogue does not have, or not for that channel, is left alone and said to be.

PARAMETER_STEP = 1e-4  # of a parameter, relative, in finite differences: right to 1e-8
ROUNDED_SHARE = 1e-6  # of a parameter's range
LARGEST_UNCERTAINTY = 100.0  # times a parameter's range
AIRSPEED_MARGIN = 0.1  # relative, within which an airspeed counts as seen
SLOW_M_S, FAST_M_S = 2.0, 20.0  # m/s
LOW_HPA, HIGH_HPA = 700.0, 1000.0  # hPa


class Stated(dict[str, float]):
    """Values of an effect's parameters; one that is asked for and was not stated is an InputError."""

    def __init__(self, effect: str, values: Mapping[str, float]) -> None:
        super().__init__(values)
        self.effect = effect

    def __missing__(self, name: str) -> float:
        raise InputError(
            f"profile: effect {self.effect} lacks the parameter {name!r}; add it or take the effect out of the profile"
        )

    def with_value(self, name: str, value: float) -> Stated:
        """The same with another value of one parameter."""
        return Stated(self.effect, {**self, name: value})


@dataclass(frozen=True)
class Acting:
    """One effect of a profile that takes part in a flight: its entry, its values, their standard uncertainties."""

    entry: Effect
    meaning: InFlight
    values: Stated
    uncertainties: Mapping[str, float] = field(default_factory=dict)

    @property
    def id(self) -> str:
        """Its id in the catalogue."""
        return self.entry.id


def acting(effects: Iterable[StatedEffect], channel: str, discovered: Iterable[Discovered] = ()) -> tuple[Acting, ...]:
    """Those of a profile's effects that a correction has to do with, in the order of the measurement chain.

    `discovered` are those that nobody listed: what they mean follows from how they behave.
    """
    found = []
    for one in discovered:
        described = entry_of(one, channel)
        if described is None or described.in_flight is None:
            continue
        stated = stated_values(one)
        values = Stated(behaviour(one), {name: p.value for name, p in stated.items()})
        uncertainties = {name: p.standard_uncertainty for name, p in stated.items()}
        _demand_possible(described, values, uncertainties)
        found.append(Acting(described, described.in_flight, values, uncertainties))
    for effect in effects:
        entry = CATALOGUE.get(effect.effect) or OF_FLIGHT.get(effect.effect)
        if entry is None or entry.in_flight is None or channel not in entry.channels:
            continue
        values = Stated(effect.effect, {name: p.value for name, p in effect.parameters.items()})
        uncertainties = {name: p.standard_uncertainty for name, p in effect.parameters.items()}
        _demand_possible(entry, values, uncertainties)
        found.append(Acting(entry, entry.in_flight, values, uncertainties))
    return tuple(sorted(found, key=lambda one: one.entry.order))


def _demand_possible(entry: Effect, values: Stated, uncertainties: Mapping[str, float]) -> None:
    """Raise InputError where a parameter lies outside of the catalogue's range: no fit of ours gives such a value, and
    the correction's arithmetic would not survive it. A bound that was rounded on its way to the file is inside.
    """
    for parameter in entry.parameters:
        value, width = values.get(parameter.name), parameter.high - parameter.low
        below = ROUNDED_SHARE * (parameter.low if parameter.log else width)  # a positive scale is rounded by its size
        possible = Range(parameter.low - below, parameter.high + ROUNDED_SHARE * width)
        where = f"profile: effect {entry.id}: {parameter.name}"
        if value is not None and not possible.holds(value):
            raise InputError(
                f"{where} {value:g} cannot be; expected {parameter.low:g} to {parameter.high:g}; "
                "correct it or take the effect out of the profile"
            )
        sigma = uncertainties.get(parameter.name, 0.0)
        if sigma > LARGEST_UNCERTAINTY * width:
            raise InputError(f"{where}: a standard uncertainty of {sigma:g} says nothing; correct it in the profile")


def behaviour(one: Discovered) -> str:
    """How a described effect behaves, in a few words."""
    factors = " and ".join(dict.fromkeys(on.factor.replace("_", " ") for on in one.depends_on))
    words = f"a described {one.behaves_as.replace('_', ' ')}"
    return f"{words} that depends on {factors}" if factors else words


def unseen(discovered: Iterable[Discovered], airspeed: Array, temperature_c: Array) -> NDArray[np.bool_]:
    """Rows (n,) outside of the conditions that a described effect was seen under: nothing is known of it there."""
    outside = np.zeros(airspeed.shape, dtype=bool)
    for one in discovered:
        for name, values, margin in (
            ("airflow_m_s", airspeed, AIRSPEED_MARGIN),
            ("ambient_temperature_c", temperature_c, 0.0),
        ):
            if name in one.seen_over:
                low, high = one.seen_over[name]
                low, high = (1.0 - margin) * low, (1.0 + margin) * high
                if not margin:
                    low, high = low - AMBIENT_TOLERANCE_K, high + AMBIENT_TOLERANCE_K
                outside |= (values < low) | (values > high)
    return outside


def not_undone(
    effects: Iterable[StatedEffect],
    channel: str,
    discovered: Iterable[Discovered] = (),
    why_left: Callable[[InFlight], str] = lambda meaning: "",
) -> list[str]:
    """One sentence for each of a profile's effects that a flight's correction leaves alone; `why_left` says, in a
    phrase, why this one leaves in what another takes off."""
    said = []
    for one in discovered:
        described = entry_of(one, channel)
        if of_readings(one):
            said.append(f"{channel}: {behaviour(one)} is of single readings and has no part in a flight")
        elif described is None:
            why = "is in the profile and unknown to this version, so it is not undone"
            said.append(f"{channel}: {behaviour(one)} {why}")
        elif described.in_flight is None:
            said.append(f"{channel}: {behaviour(one)} is taken for the bench's and has no part in a flight")
        elif described.in_flight.left:
            said.append(f"{channel}: {behaviour(one)} is in the profile and is not undone in a flight")
    for effect in effects:
        entry = CATALOGUE.get(effect.effect) or OF_FLIGHT.get(effect.effect)
        if entry is None:
            why = "is in the profile and unknown to this version, so it is not undone in a flight"
        elif channel not in entry.channels:
            why = f"is in the profile and has no meaning for {channel}, so it is not undone in a flight"
        elif entry.in_flight is None:
            why = "belongs to the bench and not to the sensor, and has no part in a flight"
        elif entry.in_flight.left:
            why = "is in the profile and is not undone in a flight"
        elif said_why := why_left(entry.in_flight):
            why = f"is in the profile and is left in: {said_why}"
        else:
            continue
        said.append(f"{channel}: {effect.effect} {why}")
    return said


def of_airspeed(effects: Iterable[Acting], length_m: float) -> list[str]:
    """Ids of the effects whose part in a flight depends on the airspeed; `length_m` is the body's."""
    return _depending(effects, length_m, Stream(np.array([SLOW_M_S, FAST_M_S])))


def of_pressure(effects: Iterable[Acting], length_m: float) -> list[str]:
    """Ids of the effects whose part in a flight depends on the air's pressure."""
    return _depending(effects, length_m, Stream(np.full(2, SLOW_M_S), np.array([LOW_HPA, HIGH_HPA])))


def _depending(effects: Iterable[Acting], length_m: float, streams: Stream) -> list[str]:
    """Ids of the effects that do not do the same in two streams."""
    reading, found = np.zeros(2), []
    for one in effects:
        seen = []
        if one.meaning.biot is not None:
            seen.append(one.meaning.biot(one.values, streams, length_m))
        if one.meaning.undo is not None:
            seen.append(one.meaning.undo(one.values, reading, streams, length_m))
        for moved in (one.meaning.rate, one.meaning.series_along):
            if moved is not None:
                seen.append(moved(one.values, streams.airflow_m_s, reading))
        if any(np.ptp(np.broadcast_to(values, reading.shape)) > 0 for values in seen):
            found.append(one.id)
    return found


def propagated(one: Acting, of: Callable[[Stated], ArrayLike]) -> Array:
    """Standard uncertainty of a function of an effect's values, from those of its parameters, to first order."""
    variance = np.zeros(np.shape(of(one.values)))
    for name, sigma in one.uncertainties.items():
        if sigma > 0:
            value = one.values[name]
            step = PARAMETER_STEP * (abs(value) or sigma)
            ends = [np.asarray(of(one.values.with_value(name, value + sign * step))) for sign in (1.0, -1.0)]
            variance = variance + (sigma * (ends[0] - ends[1]) / (2.0 * step)) ** 2
    return np.sqrt(variance)


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


def climb_unknown(meaning: InFlight) -> str:
    """Why an effect is left in where nobody knows how fast a flight climbs."""
    return "the log has no altitude and no pressure" if meaning.carried is not None else ""


def not_causal(meaning: InFlight) -> str:
    """Why an effect is left in by the causal corrector."""
    return "the causal corrector does not take it off" if meaning.carried is not None else ""


def uptake(effects: Iterable[Acting]) -> tuple[float, float]:
    """From 0, where a film takes up vapour, to 1, where by the humidity at its own temperature; and its uncertainty."""
    found = [
        (share(one.values), float(propagated(one, share)))
        for one in effects
        if (share := one.meaning.activity) is not None
    ]
    return max(found, default=(0.0, 0.0))


@dataclass(frozen=True)
class Carried:
    """What the carrier adds to the air around a sensor (n,), and its standard uncertainty, common to the flight."""

    value: Array
    uncertainty: Array


def carried(effects: Iterable[Acting], climb_m_s: Array | None, airspeed_m_s: Array) -> Carried | None:
    """What it adds along a flight of such a vertical speed and airspeed (n,); None where nothing, or nobody knows the
    vertical speed. An airspeed may be NaN."""
    adding = [(one, one.meaning.carried) for one in effects if one.meaning.carried is not None]
    if climb_m_s is None or not adding:
        return None
    value, variance = np.zeros(climb_m_s.shape), np.zeros(climb_m_s.shape)
    for one, adds in adding:

        def at(values: Stated, adds: Callable[[Mapping[str, float], Array, Array], Array] = adds) -> Array:
            return adds(values, climb_m_s, airspeed_m_s)

        value, variance = value + at(one.values), variance + propagated(one, at) ** 2
    return Carried(value, np.sqrt(variance))


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


# The track of a flight: how fast it climbs.


TRACK_SMOOTHED_S = 5.0  # over which a track's own noise is no way that was flown
CLIMB_STEP_S = 1.0  # between vertical speeds, where the altitude is new as often
BEND_WEIGHTS = tuple(4.0**k for k in range(-4, 9))  # weights of bends against noise, between which a track decides
TURN_ROUNDS = 15  # rounds of weights, after which turns stand where they are
NO_BEND = 1e-3  # of the usual bend: what counts as none
FEWEST_SPEEDS = 5


def coarse_track(time_s: Array, values: Array, step_s: float = TRACK_SMOOTHED_S) -> tuple[Array, Array]:
    """Means over a few seconds, so that a track's own noise is no way that was flown."""
    number = np.floor((time_s - time_s[0]) / step_s).astype(int)
    count = np.bincount(number)
    filled = count > 0
    return (
        np.bincount(number, weights=time_s)[filled] / count[filled],
        np.bincount(number, weights=values)[filled] / count[filled],
    )


def vertical_speed(time_s: Array, altitude_m: Array) -> tuple[Array, Array]:
    """Times and the vertical speed [m/s] there, of a track whose times run forward.

    A carrier climbs steadily and turns within a second. A mean over more moves where the turn is, one over less takes
    noise for way. So the track is as straight as its noise lets it be, with as few bends as do (l1 trend filtering: Kim
    and others 2009, doi 10.1137/070690274, by weights that are renewed). How large its noise is, a spline says that
    predicts readings best which are left out (generalised cross-validation: Craven and Wahba 1978, doi
    10.1007/BF01404567).
    """
    new = np.flatnonzero(np.diff(altitude_m, prepend=np.nan) != 0)  # a held altitude is known where it begins
    step_s = max(CLIMB_STEP_S, float(np.median(np.diff(time_s[new])))) if new.size > 1 else CLIMB_STEP_S
    at, metres = coarse_track(time_s, altitude_m, step_s)
    count = int(np.ptp(at) / step_s) + 1
    if count < FEWEST_SPEEDS:
        return at, np.gradient(metres, at) if at.size > 1 else np.zeros_like(at)
    even = at[0] + step_s * np.arange(count)
    track = _straight(np.interp(even, at, metres))
    return even[:-1] + 0.5 * step_s, np.diff(track) / step_s


def _straight(values: Array) -> Array:
    """An even series (n,) without its noise: straight between bends."""
    waves = (2.0 - 2.0 * np.cos(np.pi * np.arange(values.size) / values.size)) ** 2  # what a spline damps
    tried = []
    for weight in BEND_WEIGHTS:
        smooth = _bent(values, np.full(values.size - 2, weight))
        left = 1.0 - float(np.mean(1.0 / (1.0 + weight * waves)))
        square = float(np.mean((values - smooth) ** 2))
        tried.append((square / left**2, square / left, smooth))
    _, noise, smooth = min(tried, key=lambda one: one[0])
    bends = np.abs(np.diff(smooth, 2))
    usual = float(bends.mean())
    if noise <= 0.0 or usual <= 0.0:
        return values
    for _ in range(TURN_ROUNDS):
        smooth = _bent(values, noise / (usual * np.maximum(bends, NO_BEND * usual)))
        bends = np.abs(np.diff(smooth, 2))
    return smooth


def _bent(values: Array, weights: Array) -> Array:
    """The even series z (n,) that has the least |values - z|^2 + sum of weights (n - 2,) times second differences^2."""
    band = np.zeros((3, values.size))
    for i, by in enumerate((1.0, -2.0, 1.0)):
        for j, other in enumerate((1.0, -2.0, 1.0)[i:], i):
            band[j - i, i : i + weights.size] += by * other * weights
    band[0] += 1.0
    return np.asarray(solveh_banded(band, values, lower=True))


def climb_m_s(flight: Flight) -> Array | None:
    """Vertical speed (n,) of a flight's rows, by its altitude or else its pressure; None where it has neither."""
    for altitude in (flight.altitude_m, pressure_altitude_m(flight.pressure_hpa)):
        known = None if altitude is None else np.isfinite(altitude) & np.isfinite(flight.time_s)
        if altitude is not None and known is not None and np.count_nonzero(known) > 1:
            return np.interp(flight.time_s, *vertical_speed(flight.time_s[known], altitude[known]))
    return None
