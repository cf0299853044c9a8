"""Where ascent and descent disagree by more than the correction states: by how much, and what would explain it.

Turbulence on the two ways is not the same, and what it does from one layer to the next says how far it drives them
apart in the end (structure function as distance^(2/3)). What lies beyond that and beyond the stated uncertainty is the
sensor's, or the air's that moved on: it is not known which, and counts as error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.flight.channel import FlightChannel, bridged
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.flight.smoother import followed
from shockrig.analysis.flight.sweep import lags_behind
from shockrig.analysis.inference.effect import InFlight
from shockrig.analysis.physics.humidity import saturation_pressure_hpa
from shockrig.files.flight import Flight

Array = NDArray[np.float64]
BY_CHANCE = 4.3  # one in 200 mean squares with three degrees of freedom is larger: so few large scales a flight has
NEIGHBOUR_MEDIAN = 0.455 * 2.0  # median of the squared difference of two layers, over the variance of one
PLAYS_PERCENT = (0.5, 1.0, 2.0)  # to either side, of hysteresis
DIE_S = 17.0  # by which a humidity chip in flight follows the air (iMet-XQ2 flights: 17 to 19 s)
SECOND_LAG_RATIOS = (3.0, 10.0)  # times the sensor's slowest lag, of a second one
LEAST_EXPLAINED = 0.5  # of the difference's mean square, at least
LEAST_OF_ITS_SIZE, MOST_OF_ITS_SIZE = 0.4, 2.0  # of what the cause does where nothing of it has a size of its own
ALIKE_SHARE, MOST_NAMED = 0.85, 3  # causes that explain so much of what the best one does are named beside it


@dataclass(frozen=True)
class Difference:
    """Descent less ascent in each layer (n,): of the corrected values, and the stated variance of that."""

    corrected: Array
    variance: Array


def excess(difference: Difference) -> float:
    """Mean square by which the two ways differ beyond turbulence and what is stated; 0 where chance explains it."""
    d = difference.corrected
    of_turbulence = float(np.median(np.diff(d) ** 2)) / NEIGHBOUR_MEDIAN * d.size ** (2.0 / 3.0)
    allowed = of_turbulence + float(difference.variance.mean())
    seen = float(np.mean(d**2))
    return seen - allowed if seen > BY_CHANCE * allowed else 0.0


@dataclass(frozen=True)
class LikelyCause:
    """What may be wrong: how far it moves a corrected value (n,), the sentence, and whether it comes in any size (and
    then the other way)."""

    moves: Array
    any_size: bool
    sentence: str


def causes(flight: Flight, bead: FlightChannel, channel: FlightChannel) -> list[LikelyCause]:
    """What a channel's profile may lack, and what it would do in this flight."""
    period = typical_period(flight.time_s)
    value, air, response = bridged(flight.time_s, channel.value), bridged(flight.time_s, bead.value), channel.response
    if value is None or air is None or response is None:
        return []

    def behind(values: Array, time_constant_s: float) -> Array:
        return followed(values, float(np.exp(-period / time_constant_s)), float(values[0]))

    def seen(values: Array) -> Array:
        lags, _ = lags_behind(values, response, period)
        return np.asarray((lags * response.weight).sum(axis=1))

    reading, slowest = value - np.nan_to_num(channel.lag), response.slowest_s
    shortest_s, longest_s = SECOND_LAG_RATIOS[0] * slowest, SECOND_LAG_RATIOS[1] * slowest
    found = [
        LikelyCause(
            value - behind(value, times * slowest),
            True,
            f"a second lag of some {shortest_s:.2g} to {longest_s:.2g} s beside the profile's: "
            "characterize with a longer dwell and diagnose "
            f"({named_effects(channel.name, lambda flown: flown.lag is not None)})",
        )
        for times in SECOND_LAG_RATIOS
    ]
    found.append(
        LikelyCause(
            np.gradient(value) / period,
            True,
            "readings that are late or averaged by the logger: log single readings, or diagnose "
            f"({named_effects(channel.name, lambda flown: flown.delay_s is not None)})",
        )
    )
    if channel.name == "humidity":
        found.extend(
            LikelyCause(
                reading - _played(reading, half),
                True,
                "hysteresis: shock the film up and down at one temperature and diagnose "
                f"({named_effects(channel.name, lambda flown: flown.uncertainty is not None)})",
            )
            for half in PLAYS_PERCENT
        )
        saturated = saturation_pressure_hpa(air)
        steep = np.log(saturation_pressure_hpa(air + 0.5)) - np.log(saturation_pressure_hpa(air - 0.5))
        found.append(
            LikelyCause(
                seen(value) - seen(value * saturated) / saturated,
                False,
                "a film that takes up relative humidity and not vapour: diagnose the campaign "
                f"({named_effects(channel.name, lambda flown: flown.by_activity)})",
            )
        )
        die = bridged(flight.time_s, flight.die_temperature_c)
        own = behind(air, DIE_S) if die is None else die
        found.append(
            LikelyCause(
                value * steep * (air - own),
                False,
                "a die that is slower than the air: "
                + ("log the humidity chip's own temperature, and " if die is None else "")
                + f"diagnose ({late_die()})",
            )
        )
    return found


def _played(values: Array, half: float) -> Array:
    """Values (n,) through a play of `half` to either side: what stays behind wherever they turn."""
    out, state = np.empty(values.size), float(values[0])
    for i, value in enumerate(values.tolist()):
        out[i] = state = min(max(state, value - half), value + half)
    return out


def late_die() -> str:
    """Names of the effects that make the hygrometer's own temperature late."""
    return named_effects("humidity", lambda flown: flown.at_die and not flown.by_activity)


def named_effects(channel: str, means: Callable[[InFlight], bool]) -> str:
    """Names of the effects of a channel that mean that in a flight."""
    known = ((e.id, e.in_flight) for e in CATALOGUE.values() if channel in e.channels)
    return ", ".join(name for name, flown in known if flown is not None and means(flown))


def explained(difference: Array, moved: list[Array], found: list[LikelyCause]) -> str:
    """The sentences of the causes that explain most of a difference (n,) with hardly a difference between them, as each
    of them `moved` it; empty where none explains much."""
    total = float(np.sum(difference**2))
    ranked = []
    for by, cause in zip(moved, found, strict=True):
        own = float(by @ by)
        size = float(by @ difference) / own if own > 0 else 0.0
        if size < 0.0 if cause.any_size else LEAST_OF_ITS_SIZE < size < MOST_OF_ITS_SIZE:
            ranked.append((size * float(by @ difference) / total, cause.sentence))
    ranked = [
        one for one in sorted(ranked, reverse=True) if one[0] > max(LEAST_EXPLAINED, ALIKE_SHARE * max(ranked)[0])
    ]
    said = list(dict.fromkeys(sentence for _, sentence in ranked))
    return ", or ".join(said[:MOST_NAMED])
