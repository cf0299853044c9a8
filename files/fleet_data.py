"""What many sensors of one type say together, as data: their population, and each sensor beside it.

Coordinates are ln alpha, ln D at a few temperatures (the nodes), and what effects the models carry. Between the nodes
ln D is the polynomial in 1/T through them. fleet.py reads and writes it, fleet_views.py shows it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.causes import StatedEffect, Uncertain
from shockrig.files.errors import InputError
from shockrig.files.headline import LUMPED, first_order
from shockrig.files.numbers import measured as in_words
from shockrig.files.profile import Profile
from shockrig.files.profile_data import GROWTH_PER_KELVIN, DiffusivityRow, HumidityProfile, TemperatureProfile

Array = NDArray[np.float64]

ALPHA, D = "alpha", "D"
CHANNELS = ("temperature", "humidity")
SENSOR_OF = {"temperature": "imet", "humidity": "hyt"}
BENCH, TYPE, SENSOR, SEVERAL = "bench", "type", "sensor", "several"
WHOSE = (BENCH, TYPE, SENSOR, SEVERAL)
KELVIN = 273.15


@dataclass(frozen=True)
class Coordinate:
    """One number of a sensor: ln alpha, ln D at a temperature, or a parameter `effect.parameter` of its model (its
    logarithm where `log` says so)."""

    channel: str
    figure: str
    temperature_c: float | None = None
    log: bool = True

    @property
    def label(self) -> str:
        """For people: "alpha", "D(20 °C)"."""
        if self.temperature_c is None:
            return self.figure
        return f"{self.figure}({round(self.temperature_c, 1) + 0.0:g} °C)"

    @property
    def unit(self) -> str:
        return "m²/s" if self.figure in (ALPHA, D) else ""

    def natural(self, value: float, spread: float) -> Uncertain:
        """The number itself with its standard uncertainty."""
        if not self.log:
            return Uncertain(value, spread)
        return Uncertain(math.exp(value), math.exp(value) * spread)


@dataclass(frozen=True)
class RunScatter:
    """How much runs on a bench differ from one another in ln rate: sigma^2 ~ nu s^2 / chi^2_nu from bench to bench, s
    the standard deviation, nu the degrees of freedom."""

    standard_deviation: float
    degrees: float


@dataclass(frozen=True)
class Population:
    """The sensors of one type.

    Attributes
    ----------
    coordinates : tuple of Coordinate
    mean : ndarray (K,)
    mean_covariance : ndarray (K, K)
        How well the mean is known, errors that a bench shares included.
    covariance : ndarray (K, K)
        From sensor to sensor.
    degrees : ndarray (K,)
        Of freedom, of the covariance's diagonal.
    table_scatter : float
        Of ln D from ambient to ambient of one sensor, beside the polynomial.
    sensors : mapping
        Channel -> how many sensors it rests on.
    bodies, lengths_m, noise, sampling_period_s : mapping
        Channel -> what its sensors have: the last two are medians.
    run_scatter : RunScatter or None
        How much runs of a sensor differ in rate, on benches such as these; None where no campaign tells.
    """

    coordinates: tuple[Coordinate, ...]
    mean: Array
    mean_covariance: Array
    covariance: Array
    degrees: Array
    table_scatter: float
    sensors: Mapping[str, int]
    bodies: Mapping[str, str]
    lengths_m: Mapping[str, float]
    noise: Mapping[str, float]
    sampling_period_s: Mapping[str, float]
    run_scatter: RunScatter | None = None

    @property
    def predictive(self) -> Array:
        """Covariance of a sensor that nobody has measured yet (K, K)."""
        return self.covariance + self.mean_covariance

    @property
    def nodes_c(self) -> tuple[float, ...]:
        """Temperatures at which ln D is a coordinate."""
        return tuple(c.temperature_c for c in self.coordinates if c.temperature_c is not None)

    def places(self, channel: str) -> list[int]:
        """Where a channel's coordinates stand."""
        return [k for k, one in enumerate(self.coordinates) if one.channel == channel]

    def design(self, asked: Sequence[Coordinate]) -> Array:
        """What the coordinates contribute to others of the same sensor (m, K), ln D at any temperature among them."""
        return design(self.coordinates, asked)

    def beyond(self, asked: Sequence[Coordinate]) -> Array:
        """Variance (m,) that is added to what lies beyond the nodes, where the polynomial is held to nothing."""
        if not self.nodes_c:
            return np.zeros(len(asked))
        low, high = min(self.nodes_c), max(self.nodes_c)
        away = [0.0 if c.temperature_c is None else max(low - c.temperature_c, c.temperature_c - high) for c in asked]
        reach = np.maximum(np.array(away) - 1.0, 0.0)  # within 1 K two ambients are one
        return np.asarray((GROWTH_PER_KELVIN * reach) ** 2)

    def label(self, one: Coordinate) -> str:
        """What a number is called for people: of a sensor that is one lag its time constant."""
        return one.label.replace(one.figure, "tau", 1) if self._lumped(one) else one.label

    def unit(self, one: Coordinate) -> str:
        """Of the number that people are shown."""
        return "s" if self._lumped(one) else one.unit

    def shown(self, one: Coordinate, value: Uncertain) -> Uncertain:
        """A number as people are shown it: tau = R^2/alpha or L^2/D of a sensor that is one lag."""
        if not self._lumped(one):
            return value
        return Uncertain(*first_order(self.lengths_m[one.channel], value.value, value.standard_uncertainty))

    def text(self, one: Coordinate, value: Uncertain) -> str:
        """The same with its uncertainty and unit."""
        number = self.shown(one, value)
        return in_words(number.value, number.standard_uncertainty, self.unit(one))

    def _lumped(self, one: Coordinate) -> bool:
        return bool(one.unit) and self.bodies.get(one.channel) == LUMPED

    def typical(self, provenance: Mapping[str, Any] | None = None) -> Profile:
        """Profile of a sensor of the type that nobody has characterized."""
        spread = np.sqrt(np.diag(self.predictive))
        temperature = humidity = None
        for k, one in enumerate(self.coordinates):
            if one.figure == ALPHA:
                temperature = TemperatureProfile(
                    one.natural(float(self.mean[k]), float(spread[k])),
                    bead_radius_m=self.lengths_m["temperature"],
                    noise_k=self.noise.get("temperature"),
                    sampling_period_s=self.sampling_period_s.get("temperature"),
                    effects=self._effects("temperature"),
                )
        rows = []
        for k, one in sorted(enumerate(self.coordinates), key=lambda item: item[1].temperature_c or 0.0):
            if one.temperature_c is not None:
                d = one.natural(float(self.mean[k]), float(np.hypot(spread[k], self.table_scatter)))
                rows.append(DiffusivityRow(one.temperature_c, d.value, d.standard_uncertainty))
        if rows:
            humidity = HumidityProfile(
                tuple(rows),
                film_thickness_m=self.lengths_m["humidity"],
                noise_percent=self.noise.get("humidity"),
                sampling_period_s=self.sampling_period_s.get("humidity"),
                effects=self._effects("humidity"),
            )
        sensors = {SENSOR_OF[name]: {"body": body} for name, body in self.bodies.items()}
        return Profile(temperature, humidity, sensors, dict(provenance or {}))

    def _effects(self, channel: str) -> tuple[StatedEffect, ...]:
        """What the type's sensors have beside the plain body."""
        found: dict[str, dict[str, Uncertain]] = {}
        for k in self.places(channel):
            one = self.coordinates[k]
            effect, dot, parameter = one.figure.partition(".")
            if dot:
                spread = math.sqrt(self.predictive[k, k])
                found.setdefault(effect, {})[parameter] = one.natural(float(self.mean[k]), spread)
        return tuple(StatedEffect(effect, parameters) for effect, parameters in found.items())


def design(coordinates: Sequence[Coordinate], asked: Sequence[Coordinate]) -> Array:
    """How numbers of a sensor (m) follow from its coordinates (K): Lagrange's polynomial in 1/T between the nodes."""
    found = np.zeros((len(asked), len(coordinates)))
    nodes = [k for k, one in enumerate(coordinates) if one.temperature_c is not None]
    at = [1.0 / (float(coordinates[k].temperature_c or 0.0) + KELVIN) for k in nodes]
    for row, one in zip(found, asked, strict=True):
        if one.temperature_c is None:
            for k, other in enumerate(coordinates):
                row[k] = (one.channel, one.figure) == (other.channel, other.figure) and other.temperature_c is None
            continue
        x = 1.0 / (one.temperature_c + KELVIN)
        for place, k in enumerate(nodes):
            row[k] = math.prod((x - other) / (at[place] - other) for i, other in enumerate(at) if i != place)
    return found


@dataclass(frozen=True)
class FleetFigure:
    """A number of one sensor: as its own data have it, and as it is with what the others say.

    `share` is that of its own data in the latter, from 0 to 1. Of alpha and D `own_t63_s` and `t63_s` are the times to
    63 % of a step of the air that go with the two, the sensor's effects included.
    """

    coordinate: Coordinate
    own: Uncertain
    shrunk: Uncertain
    share: float
    own_t63_s: Uncertain | None = None
    t63_s: Uncertain | None = None


@dataclass(frozen=True)
class FleetChannel:
    """One sensor's channel: whether it belongs to the population, the probability of one as far off by accident (alone,
    and adjusted for how many are looked at), its runs, and its figures."""

    belongs: bool
    probability: float
    adjusted: float
    runs: int
    explained: bool
    figures: tuple[FleetFigure, ...]


@dataclass(frozen=True)
class FleetSensor:
    """One sensor of a fleet: its name, the campaigns it was in, when the first began, serial numbers, channels."""

    name: str
    campaigns: tuple[str, ...]
    began_at: str
    serials: Mapping[str, str]
    channels: Mapping[str, FleetChannel]
    missing: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class FleetTrend:
    """What differs along the fleet: with the date (`per` "year") or from one place in the order of serial numbers on
    (`per` "batch", whose first sensor is `since`); the change of a channel's mean with its standard uncertainty, and
    the probability of one as large by accident."""

    channel: str
    per: str
    since: str
    change: Uncertain
    probability: float


@dataclass(frozen=True)
class SharedParameter:
    """A parameter of a cause over the sensors that show it: mean, how far they scatter beyond their uncertainties, and
    whether all may have one value."""

    mean: Uncertain
    spread: float
    common: bool


@dataclass(frozen=True)
class FleetCause:
    """An effect that diagnoses name, and whose it is: "bench", "type", "sensor", or "several" where it is in some
    sensors and nothing tells why; the sensors that show it, how many were diagnosed, the campaigns, its parameters; and
    the effects that single diagnoses could not tell from it: those that are open still, those that the others rule out.
    """

    channel: str
    effect: str
    whose: str
    sensors: tuple[str, ...]
    diagnosed: int
    campaigns: tuple[str, ...]
    parameters: Mapping[str, SharedParameter]
    look_alikes: tuple[str, ...] = ()
    ruled_out: tuple[str, ...] = ()


@dataclass(frozen=True)
class FleetData:
    """What a `Fleet` (fleet.py, which describes it) holds."""

    population: Population
    sensors: tuple[FleetSensor, ...]
    trends: tuple[FleetTrend, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    causes: tuple[FleetCause, ...] = ()
    runs_in_common: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def typical(self) -> Profile:
        """Profile of a sensor of the type that nobody has characterized."""
        emulated = {"data": self.provenance["data"]} if "data" in self.provenance else {}
        return self.population.typical(emulated)

    def outsiders(self, channel: str) -> list[str]:
        """Names of the sensors that do not belong."""
        return [s.name for s in self.sensors if channel in s.channels and not s.channels[channel].belongs]


def demand_of_type(population: Population, channel: str, body: str, length_m: float, source: str) -> None:
    """Raise InputError where a sensor is not of the population's type: another body, or lengths that differ."""
    theirs = population.bodies.get(channel)
    if theirs is None:
        return
    if body != theirs:
        raise InputError(f"{source}: its {channel} sensor is a {body}, the fleet's are of {theirs}; take another fleet")
    if not math.isclose(length_m, population.lengths_m[channel], rel_tol=1e-6):
        raise InputError(
            f"{source}: its {channel} sensor is stated with {length_m:g} m, the fleet's with "
            f"{population.lengths_m[channel]:g} m; state the same length in campaign.json"
        )
