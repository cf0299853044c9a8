"""What many sensors of one type say together (`shock-fleet/1`): their population, and each sensor beside it.

Coordinates are ln alpha, ln D at a few temperatures (the nodes), and what effects the models carry. Between the nodes
ln D is the polynomial in 1/T through them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.causes import StatedEffect, Uncertain, read_uncertain, uncertain_document
from shockrig.files.errors import InputError
from shockrig.files.file_table import FileTable, is_number
from shockrig.files.headline import LUMPED, first_order
from shockrig.files.json_files import known, measured, read_json, write_json
from shockrig.files.numbers import measured as in_words
from shockrig.files.profile_data import (
    GROWTH_PER_KELVIN,
    DiffusivityRow,
    HumidityProfile,
    Profile,
    TemperatureProfile,
)

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

FLEET_FORMAT = "shock-fleet/1"
REMEDY = "give the fleet.json that shockrig fleet wrote"
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
    at = np.array([1.0 / (float(coordinates[k].temperature_c or 0.0) + KELVIN) for k in nodes])
    for row, one in zip(found, asked, strict=True):
        if one.temperature_c is None:
            for k, other in enumerate(coordinates):
                row[k] = (one.channel, one.figure) == (other.channel, other.figure) and other.temperature_c is None
            continue
        x = 1.0 / (one.temperature_c + KELVIN)
        for place, k in enumerate(nodes):
            others = np.delete(at, place)
            row[k] = np.prod((x - others) / (at[place] - others))
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


@dataclass(frozen=True, repr=False)
class Fleet:
    """What `shockrig fleet` found: the population, its sensors, what differs along it, campaigns left out, whose the
    causes are that diagnoses name, and of campaigns with several probes the share, by channel, of what runs differ by
    that is the same in all of them."""

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

    def to_frame(self) -> pd.DataFrame:
        """One row for each number of each sensor: its own value, the value with what the others say, belonging."""
        from shockrig.files.fleet_views import fleet_frame

        return fleet_frame(self)

    def to_xarray(self) -> xr.Dataset:
        """The population over its coordinates, and the sensors' numbers one below the other; needs xarray."""
        from shockrig.files.fleet_views import fleet_dataset

        return fleet_dataset(self)

    def plot(self) -> Figure:
        """Each sensor beside the population, a panel for each coordinate."""
        from shockrig.files.fleet_views import plot_fleet

        return plot_fleet(self)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the fleet to a file, whole or not at all."""
        write_fleet(self, path)

    def __repr__(self) -> str:
        from shockrig.files.fleet_views import fleet_facts

        return f"<Fleet: {'; '.join(f'{name} {value}' for name, value in fleet_facts(self))}>"

    def _repr_html_(self) -> str:
        from shockrig.files.fleet_views import fleet_card

        return fleet_card(self)


def write_fleet(fleet: Fleet, path: str | os.PathLike[str]) -> None:
    """Write fleet.json; the file appears whole or not at all.

    Raises
    ------
    ValueError
        A number is not finite.
    OSError
        The disk does not take it.
    """
    write_json(Path(path), fleet_document(fleet))


def fleet_document(fleet: Fleet) -> dict[str, Any]:
    """The fleet as the JSON document of `shock-fleet/1`."""
    one = fleet.population
    return {
        "format": FLEET_FORMAT,
        "population": {
            "coordinates": [_coordinate_document(c) for c in one.coordinates],
            "mean": one.mean.tolist(),
            "mean_covariance": one.mean_covariance.tolist(),
            "covariance": one.covariance.tolist(),
            "degrees_of_freedom": one.degrees.tolist(),
            "table_scatter": one.table_scatter,
            **_scatter_document(one.run_scatter),
            "channels": {
                name: known(
                    sensors=one.sensors[name],
                    body=one.bodies[name],
                    length_m=one.lengths_m[name],
                    noise=one.noise.get(name),
                    sampling_period_s=one.sampling_period_s.get(name),
                )
                for name in one.sensors
            },
        },
        "sensors": [_sensor_document(sensor) for sensor in fleet.sensors],
        "trends": [
            {
                "channel": t.channel,
                "per": t.per,
                "since": t.since,
                "relative_change": uncertain_document(t.change),
                "probability_by_accident": t.probability,
            }
            for t in fleet.trends
        ],
        "causes": [_cause_document(one) for one in fleet.causes],
        "runs_in_common": {path: dict(shares) for path, shares in fleet.runs_in_common.items()},
        "left_out": dict(fleet.left_out),
        "provenance": dict(fleet.provenance),
    }


def _scatter_document(one: RunScatter | None) -> dict[str, Any]:
    if one is None:
        return {}
    return {"run_scatter": {"standard_deviation": one.standard_deviation, "degrees_of_freedom": one.degrees}}


def _cause_document(one: FleetCause) -> dict[str, Any]:
    return {
        "channel": one.channel,
        "effect": one.effect,
        "whose": one.whose,
        "sensors": list(one.sensors),
        "diagnosed": one.diagnosed,
        "campaigns": list(one.campaigns),
        "parameters": {
            name: {**uncertain_document(p.mean), "spread": p.spread, "common": p.common}
            for name, p in one.parameters.items()
        },
        "look_alikes": list(one.look_alikes),
        "ruled_out": list(one.ruled_out),
    }


def _coordinate_document(one: Coordinate) -> dict[str, Any]:
    return known(channel=one.channel, figure=one.figure, temperature_c=one.temperature_c, logarithm=one.log)


def _rounded(value: Uncertain) -> dict[str, float]:
    return {name: measured(x) or 0.0 for name, x in uncertain_document(value).items()}


def _sensor_document(sensor: FleetSensor) -> dict[str, Any]:
    return {
        "name": sensor.name,
        "campaigns": list(sensor.campaigns),
        "began_at": sensor.began_at,
        "serials": dict(sensor.serials),
        "channels": {
            name: {
                "belongs": found.belongs,
                "probability": found.probability,
                "adjusted_probability": found.adjusted,
                "runs": found.runs,
                "explained": found.explained,
                "figures": [
                    {
                        **_coordinate_document(f.coordinate),
                        "own": _rounded(f.own),
                        "shrunk": _rounded(f.shrunk),
                        "share_of_own_data": measured(f.share),
                        **{
                            key: _rounded(time)
                            for key, time in (("own_t63_s", f.own_t63_s), ("t63_s", f.t63_s))
                            if time is not None
                        },
                    }
                    for f in found.figures
                ],
            }
            for name, found in sensor.channels.items()
        },
        "missing": dict(sensor.missing),
    }


def read_fleet(path: str | os.PathLike[str]) -> Fleet:
    """Read what `shockrig fleet` wrote; keys that the format does not know are ignored.

    Raises
    ------
    InputError
        Names the file, the key, what was expected and the remedy.

    See Also
    --------
    fleet : which makes one.
    """
    whole = read_json(path, FLEET_FORMAT, REMEDY)
    whole = FileTable(whole.content, whole.source, remedy=REMEDY)
    return Fleet(
        _population(whole.mapping("population")),
        tuple(_sensor(item) for item in whole.items("sensors")),
        tuple(_trend(item) for item in whole.items("trends")),
        {str(k): str(v) for k, v in whole.mapping("left_out").content.items()},
        MappingProxyType(dict(whole.mapping("provenance").content)),
        tuple(_cause(item) for item in whole.items("causes")),
        _in_common(whole),
    )


def _in_common(table: FileTable) -> dict[str, dict[str, float]]:
    shares: dict[str, dict[str, float]] = {}
    for path, one in table.children("runs_in_common"):
        there = {name: one.number(name, at_least=0.0) for name in CHANNELS}
        shares[path] = {name: share for name, share in there.items() if share is not None}
    return shares


def _coordinate(item: FileTable) -> Coordinate:
    log = item.get("logarithm")
    return Coordinate(
        item.word("channel", CHANNELS),
        item.text("figure") or "",
        item.number("temperature_c"),
        True if log is None else bool(log),
    )


def _population(stated: FileTable) -> Population:
    coordinates = tuple(_coordinate(item) for item in stated.items("coordinates"))
    size = len(coordinates)
    if not size:
        raise stated.error("coordinates", "a list of at least one", None)
    channels = dict(stated.children("channels"))
    for one in coordinates:
        if one.channel not in channels:
            raise stated.error("channels", f"an entry {one.channel}", sorted(channels))

    def per(key: str) -> dict[str, float]:
        numbers = {name: item.number(key, positive=True) for name, item in channels.items()}
        return {name: value for name, value in numbers.items() if value is not None}

    covariance = _covariance(stated, "covariance", size)
    lengths = per("length_m")
    for name, item in channels.items():
        if name not in lengths:
            raise item.error("length_m", "a positive number", None)
    return Population(
        coordinates=coordinates,
        mean=_numbers(stated, "mean", (size,)),
        mean_covariance=_covariance(stated, "mean_covariance", size),
        covariance=covariance,
        degrees=_numbers(stated, "degrees_of_freedom", (size,)),
        table_scatter=stated.number("table_scatter", at_least=0.0) or 0.0,
        sensors={name: int(item.number("sensors", at_least=0.0) or 0) for name, item in channels.items()},
        bodies={name: item.text("body") or "" for name, item in channels.items()},
        lengths_m=lengths,
        noise=per("noise"),
        sampling_period_s=per("sampling_period_s"),
        run_scatter=_run_scatter(stated),
    )


def _run_scatter(stated: FileTable) -> RunScatter | None:
    if stated.get("run_scatter") is None:
        return None
    one = stated.mapping("run_scatter")
    keys = ("standard_deviation", "degrees_of_freedom")
    return RunScatter(*(one.demand(key, one.number(key, positive=True)) for key in keys))


def _numbers(stated: FileTable, key: str, shape: tuple[int, ...]) -> Array:
    rows = stated.sequence(key)
    flat = [x for row in rows for x in (row if isinstance(row, list) else [row])]
    if not all(map(is_number, flat)) or len(flat) != math.prod(shape) or len(rows) != shape[0]:
        raise stated.error(key, f"{' by '.join(map(str, shape))} numbers", rows)
    return np.array(flat, dtype=float).reshape(shape)


def _covariance(stated: FileTable, key: str, size: int) -> Array:
    found = _numbers(stated, key, (size, size))
    if not np.allclose(found, found.T) or np.linalg.eigvalsh(found).min() < -1e-9 * max(np.trace(found), 1e-300):
        raise stated.refuse(key, "is no covariance (symmetric, no negative variance)")
    return found


def _sensor(item: FileTable) -> FleetSensor:
    channels = {}
    for name, stated in item.children("channels"):
        figures = []
        for one in stated.items("figures"):
            own, shrunk = read_uncertain(one, "own"), read_uncertain(one, "shrunk")
            if own is None or shrunk is None:
                raise one.error("own" if own is None else "shrunk", "a value with its standard uncertainty", None)
            share = one.number("share_of_own_data") or 0.0
            times = read_uncertain(one, "own_t63_s"), read_uncertain(one, "t63_s")
            figures.append(FleetFigure(_coordinate(one), own, shrunk, share, *times))
        channels[name] = FleetChannel(
            stated.yes_or_no("belongs"),
            stated.number("probability") or 0.0,
            stated.number("adjusted_probability") or 0.0,
            int(stated.number("runs") or 0),
            stated.yes_or_no("explained"),
            tuple(figures),
        )
    return FleetSensor(
        item.text("name") or "",
        item.texts("campaigns"),
        item.text("began_at") or "",
        {str(k): str(v) for k, v in item.mapping("serials").content.items()},
        channels,
        {str(k): str(v) for k, v in item.mapping("missing").content.items()},
    )


def _cause(item: FileTable) -> FleetCause:
    parameters = {}
    stated = item.mapping("parameters")
    for name, one in item.children("parameters"):
        mean = read_uncertain(stated, name)
        if mean is None:
            raise one.error("value", "a number", None)
        parameters[name] = SharedParameter(mean, one.number("spread", at_least=0.0) or 0.0, one.yes_or_no("common"))
    return FleetCause(
        item.word("channel", CHANNELS),
        item.text("effect") or "",
        item.word("whose", WHOSE),
        item.texts("sensors"),
        int(item.number("diagnosed", at_least=0.0) or 0),
        item.texts("campaigns"),
        parameters,
        item.texts("look_alikes"),
        item.texts("ruled_out"),
    )


def _trend(item: FileTable) -> FleetTrend:
    change = read_uncertain(item, "relative_change")
    if change is None:
        raise item.error("relative_change", "a value with its standard uncertainty", None)
    return FleetTrend(
        item.word("channel", CHANNELS),
        item.text("per") or "",
        item.text("since") or "",
        change,
        item.number("probability_by_accident") or 0.0,
    )


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
