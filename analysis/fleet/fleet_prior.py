"""A population as what is known of a sensor before its own runs: its profile with both, if it belongs.

z ~ N(mu, Sigma + Cov mu),   x = H z + table scatter + C eps + e;   everything is linear in logarithms, so that the
posterior is one conditioning. What the runs say nothing of follows from what they do, by the population's correlations:
a few shocks at 20 degC make D at 0 and 40 degC known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from shockrig.analysis.characterize.response_times import response_time
from shockrig.analysis.characterize.result import ChannelResult, Characterization, to_profile
from shockrig.analysis.estimate.channel import AMBIENT_WIDTH_K
from shockrig.analysis.estimate.quantity import QUANTITIES
from shockrig.analysis.fleet.population import FALSE_DISCOVERIES, distance
from shockrig.analysis.fleet.scatter import with_scatter_of_type
from shockrig.analysis.fleet.statistics import film, stated, statistics_of
from shockrig.files.causes import StatedEffect
from shockrig.files.fleet_file import ALPHA, Coordinate, FleetFigure, Population, demand_of_type
from shockrig.files.numbers import plain
from shockrig.files.profile import DiffusivityRow, HumidityProfile, Profile, ResponseTime, TemperatureProfile, Uncertain

Array = NDArray[np.float64]
Found = tuple[Array, Array]  # means (m,) and their covariance (m, m)

_NOUNS: dict[str, str] = {name: quantity.noun for name, quantity in QUANTITIES.items()}


@dataclass(frozen=True)
class WithFleet:
    """A characterization with a fleet as its prior.

    Attributes
    ----------
    profile : Profile
        Of channels that belong, the sensor's own data and the fleet together; of others its own data alone.
    probability : mapping
        Channel -> of one as far off by accident.
    figures : mapping
        Channel that belongs -> its numbers, alone and with the fleet; those that no run showed have no own value (NaN).
    given : function of coordinates
        Any numbers of the sensor with all that is known of it: means and covariance.
    """

    profile: Profile
    probability: Mapping[str, float]
    figures: Mapping[str, tuple[FleetFigure, ...]]
    given: Callable[[Sequence[Coordinate]], Found] = field(repr=False, compare=False)

    def relative(self, channel: str, temperature_c: float | None) -> float | None:
        """Relative standard uncertainty of alpha (no temperature), or of D at a temperature, with the fleet; None where
        the sensor does not belong."""
        if not self.belongs(channel):
            return None
        asked = Coordinate(channel, ALPHA) if temperature_c is None else film(temperature_c)
        return math.sqrt(max(float(self.given([asked])[1][0, 0]), 0.0))

    def belongs(self, channel: str) -> bool:
        return channel in self.figures

    def outside(self, channel: str) -> bool:
        """Whether runs showed the channel, and that it does not belong."""
        return channel in self.probability and not self.belongs(channel)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What there is to say of each channel."""
        said = []
        for channel, probability in self.probability.items():
            noun = _NOUNS[channel]
            if not self.belongs(channel):
                said.append(
                    f"The {noun} does not belong to the fleet (one as far off by accident: {plain(probability, 2)}): "
                    "its profile is its own data's alone."
                )
                continue
            low, *_, high = sorted(round(100.0 * (1.0 - f.share)) for f in (*self.figures[channel],) * 2)
            brings = f"{low} to {high} %" if high > low else f"{low} %"
            said.append(f"The {noun} belongs to the fleet, which brings {brings} of what is known of its numbers.")
        return tuple(said)


def with_population(result: Characterization, population: Population) -> WithFleet:
    """A characterization with a population as its prior.

    Raises
    ------
    InputError
        The sensors are of another type: another body, or another length is stated.
    """
    itself, result = result, with_scatter_of_type(result, population.run_scatter)
    own_values = {name: c.value for name, c in statistics_of(itself, "").channels.items()}
    known = statistics_of(result, "")
    size = len(population.coordinates)
    values, ours_alone, channels, rows, covariances, commons = [], [], [], [], [], []
    keys = sorted({key for c in known.channels.values() for key in c.shared})
    probability: dict[str, float] = {}
    for name, c in known.channels.items():
        if name not in population.sensors:
            continue
        demand_of_type(population, name, c.body, c.length_m, str(result.campaign.path))
        H = population.design(c.coordinates)
        keep = (H != 0).any(axis=1)
        if not keep.any():
            continue
        asked = [one for one, k in zip(c.coordinates, keep, strict=True) if k]
        C = np.column_stack([c.shared.get(key, np.zeros(keep.size)) for key in keys] or [np.zeros((keep.size, 0))])
        R = c.covariance[np.ix_(keep, keep)] + np.diag(_scatter(population, asked))
        beta = np.concatenate([population.mean, np.zeros(len(keys))])
        both = np.eye(size + len(keys))
        both[:size, :size] = population.mean_covariance
        probability[name] = distance(
            c.value[keep], R, H[keep], C[keep], population.covariance, population.degrees, beta, both
        )
        if probability[name] < FALSE_DISCOVERIES:
            continue
        channels += [name] * len(asked)
        values += list(c.value[keep])
        ours_alone += list(own_values[name][keep])
        rows += asked
        covariances.append(R)
        commons.append(C[keep])
    profile = to_profile(result)
    if not rows:
        return WithFleet(profile, probability, {}, partial(_given, population, rows, np.zeros(0), np.zeros((0, 0))))
    shared = np.concatenate(commons)
    V = block_diag(*covariances) + shared @ shared.T
    given = partial(_given, population, rows, np.array(values), V)
    figures: dict[str, tuple[FleetFigure, ...]] = {}
    temperature, humidity = profile.temperature, profile.humidity
    for name in dict.fromkeys(channels):
        own = [i for i, channel in enumerate(channels) if channel == name]
        ours = [rows[i] for i in own]
        new = [c for c in _nodes(population, name) if all(_apart(c, one) for one in ours)]
        found = given([*ours, *new])
        alone = np.concatenate([np.array(ours_alone)[own], np.full(len(new), np.nan)])
        figures[name] = _figures(population, itself, name, [*ours, *new], alone, found)
        if name == "temperature" and temperature is not None:
            temperature = _bead(result, temperature, figures[name])
        if name == "humidity" and humidity is not None:
            humidity = _table(result, humidity, figures[name])
    return WithFleet(replace(profile, temperature=temperature, humidity=humidity), probability, figures, given)


def relative_of_type(population: Population, channel: str, temperature_c: float | None) -> float | None:
    """Relative standard uncertainty of alpha (no temperature), or of D at a temperature, of a sensor of the type that
    nobody has measured; None where the fleet says nothing of it."""
    asked = [Coordinate(channel, ALPHA) if temperature_c is None else film(temperature_c)]
    if not population.design(asked).any():
        return None
    nothing = np.zeros((0, 0))
    return math.sqrt(float(_given(population, [], np.zeros(0), nothing, asked)[1][0, 0]))


def _given(
    population: Population, rows: Sequence[Coordinate], value: Array, V: Array, asked: Sequence[Coordinate]
) -> Found:
    """Numbers of a sensor given those that its runs show (`rows`, with the covariance V): mean and covariance."""
    H, G, prior = population.design(rows), population.design(asked), population.predictive
    # What an ambient has beside the polynomial is the same number, wherever it stands.
    same = np.array([[float(a == b and a.temperature_c is not None) for b in rows] for a in asked])
    cross = G @ prior @ H.T + _scatter(population, asked)[:, None] * same
    gain = np.linalg.solve(H @ prior @ H.T + V, cross.T).T
    mean = G @ population.mean + gain @ (value - H @ population.mean)
    return mean, G @ prior @ G.T + np.diag(_scatter(population, asked)) - gain @ cross.T


def _scatter(population: Population, asked: Sequence[Coordinate]) -> Array:
    """Variance of a sensor's numbers beside the polynomial (m,)."""
    own = np.array([population.table_scatter**2 if c.temperature_c is not None else 0.0 for c in asked])
    return np.asarray(own + population.beyond(asked))


def _nodes(population: Population, channel: str) -> list[Coordinate]:
    return [c for c in population.coordinates if c.channel == channel and c.temperature_c is not None]


def _apart(one: Coordinate, other: Coordinate) -> bool:
    if one.temperature_c is None or other.temperature_c is None:
        return True
    return abs(one.temperature_c - other.temperature_c) > AMBIENT_WIDTH_K


def _channel(result: Characterization, name: str) -> ChannelResult:
    return {str(channel): found for channel, found in result.channels().items()}[name]


def _figures(
    population: Population, result: Characterization, name: str, asked: Sequence[Coordinate], alone: Array, found: Found
) -> tuple[FleetFigure, ...]:
    mean, covariance = found
    H = population.design(asked)
    prior = np.diag(H @ population.predictive @ H.T) + _scatter(population, asked)
    rows = _channel(result, name).rows
    spread = {row.ambient_c: row.standard_uncertainty / row.diffusivity_m2_s for row in rows}
    figures = []
    for k, one in enumerate(asked):
        variance = max(float(covariance[k, k]), 0.0)
        own = Uncertain(math.nan, math.nan)
        if np.isfinite(alone[k]):
            at = spread[one.temperature_c] if one.temperature_c is not None else next(iter(spread.values()))
            own = one.natural(float(alone[k]), at if one.unit else math.nan)
        shrunk = one.natural(float(mean[k]), math.sqrt(variance))
        figures.append(FleetFigure(one, own, shrunk, min(max(1.0 - variance / float(prior[k]), 0.0), 1.0)))
    return tuple(sorted(figures, key=lambda f: (f.coordinate.temperature_c is None, f.coordinate.temperature_c or 0.0)))


def _response(
    result: Characterization, name: str, ambient_c: float, values: Mapping[Coordinate, Uncertain]
) -> ResponseTime | None:
    """Response times of an ambient's row with its part's theta, and the covariance of it, moved to new values."""
    found = _channel(result, name)
    for part in found.parts:
        places, coordinates = stated(found, part, effects=part is found.parts[0])
        at = [p for p, c in zip(places, coordinates, strict=True) if c.unit and c.temperature_c in (None, ambient_c)]
        here = [k for k, c in enumerate(coordinates) if c in values]
        if not at or not here:
            continue
        theta, covariance = part.fit.theta, part.fit.covariance
        block = [places[k] for k in here]
        new, spread = np.empty(len(here)), np.empty(len(here))
        for row, k in enumerate(here):
            c, value = coordinates[k], values[coordinates[k]]
            length = 2.0 * math.log(part.channel.length_m) if c.unit else 0.0
            new[row] = (math.log(value.value) if c.log else value.value) - length
            spread[row] = value.standard_uncertainty / (value.value if c.log else 1.0)
        gain = np.linalg.solve(covariance[np.ix_(block, block)], covariance[block]).T
        moved = theta + gain @ (new - theta[block])
        narrower = np.minimum(spread / np.sqrt(np.diag(covariance)[block]), 1.0)
        scaled = covariance.copy()
        scale = np.ones(theta.size)
        scale[block] = narrower
        scaled *= np.outer(scale, scale)
        return response_time(part.channel, replace(part.fit, theta=moved, covariance=scaled), at[0])
    return None


def _bead(result: Characterization, own: TemperatureProfile, figures: Sequence[FleetFigure]) -> TemperatureProfile:
    values = {f.coordinate: f.shrunk for f in figures}
    alpha = values.get(Coordinate("temperature", ALPHA), own.thermal_diffusivity_m2_s)
    response = _response(result, "temperature", math.nan, values)
    return replace(
        own,
        thermal_diffusivity_m2_s=alpha,
        response_time_s=response or own.response_time_s,
        effects=_effects(own.effects, values),
    )


def _table(result: Characterization, own: HumidityProfile, figures: Sequence[FleetFigure]) -> HumidityProfile:
    values = {f.coordinate: f.shrunk for f in figures}
    rows = []
    for row in own.diffusivity_table:
        d = values[film(row.ambient_temperature_c)]
        response = _response(result, "humidity", row.ambient_temperature_c, values) or row.response_time_s
        rows.append(
            replace(
                row, diffusivity_m2_s=d.value, standard_uncertainty=d.standard_uncertainty, response_time_s=response
            )
        )
    for figure in figures:
        at, d = figure.coordinate.temperature_c, figure.shrunk
        if at is None or not math.isnan(figure.own.value):
            continue
        nearest = min(rows, key=lambda row: abs(row.ambient_temperature_c - at))
        rows.append(
            DiffusivityRow(at, d.value, d.standard_uncertainty, 0, None if own.effects else _scaled(nearest, d))
        )
    return replace(
        own,
        diffusivity_table=tuple(sorted(rows, key=lambda row: row.ambient_temperature_c)),
        effects=_effects(own.effects, values),
    )


def _scaled(row: DiffusivityRow, d: Uncertain) -> ResponseTime | None:
    """Response times at another D of the plain film: inverse to it."""
    if row.response_time_s is None:
        return None
    factor, relative = row.diffusivity_m2_s / d.value, d.standard_uncertainty / d.value
    t = row.response_time_s
    times = (factor * t.t63_s, factor * t.t90_s, factor * t.t98_s)
    return ResponseTime(*times, (relative * times[0], relative * times[1], relative * times[2]))


def _effects(effects: Sequence[StatedEffect], values: Mapping[Coordinate, Uncertain]) -> tuple[StatedEffect, ...]:
    named = {c.figure: value for c, value in values.items()}
    return tuple(
        replace(
            effect,
            parameters={name: named.get(f"{effect.effect}.{name}", value) for name, value in effect.parameters.items()},
        )
        for effect in effects
    )
