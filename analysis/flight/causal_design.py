"""What a causal corrector needs of a profile, as small tables: lags, readout and their uncertainty along the air.

The physics is that of the smoother (`response`, `readout`); here it is taken at the nodes of a grid over temperature,
airspeed and pressure, and between them it is interpolated linearly (rates, airspeed and pressure in their logarithms).
A quantity on which nothing depends has one node. The same tables go into generated programs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.air_prior import Prior
from shockrig.analysis.flight.doubts import NO_SPEED
from shockrig.analysis.flight.response import LagResponse, bead_response, film_response, unsure_of_airspeed
from shockrig.analysis.flight.smooth_channel import MOST_PARTS, PER_LAG, resolved_rate
from shockrig.analysis.flight.stretches import largest_share
from shockrig.analysis.flight.undo_readout import (
    Acting,
    acting,
    ceiling,
    noise_floor,
    not_known,
    of_airspeed,
    of_pressure,
    undone,
    uptake,
)
from shockrig.analysis.physics.air_exchange import REFERENCE_AIRFLOW_M_S, Stream
from shockrig.analysis.physics.humidity import STANDARD_PRESSURE_HPA
from shockrig.analysis.physics.modes import Modes, slowest
from shockrig.files.errors import InputError
from shockrig.files.profile import HumidityProfile, Profile, TemperatureProfile
from shockrig.files.profile_data import NOISE_K, NOISE_PERCENT
from shockrig.files.ranges import LIKELY_RANGES, RANGES

Array = NDArray[np.float64]
MOST_MODES = 4  # of the body: faster ones follow within a row at 10 Hz, and the last carries their weight
TEMPERATURE_STEP_K = 5.0  # between nodes: a straight line through ln D over 1/T is off by less than 0.1 % there
AIRSPEEDS_M_S = (0.05, 0.2, 0.5, 1.0, 2.0, 3.5, 6.0, 10.0, 17.0, 30.0, 60.0)
PRESSURES_HPA = (150.0, 300.0, 500.0, 750.0, 1100.0)
BEAD_RANGE_C = (-60.0, 60.0)  # of a bead's table, which states no range of its own
BENT_PERCENT = 0.02  # %RH by which a readout may differ from its straight line
STRENGTH_COUNT = 5  # at which the resolved rate is tabulated


@dataclass(frozen=True)
class Ladder:
    """Strengths of the air's turbulence [unit of `prior`].

    Two filters stand a factor on either side of one between `lowest` and `highest`; `door` is that of a filter for
    which the air may be another at once, and a share of it the bend of the filter that bends.
    """

    lowest: float
    highest: float
    door: float

    @property
    def middle(self) -> float:
        """Between the lowest and the highest."""
        return sqrt(self.lowest * self.highest)


# What the smoother finds in the segments of the flights of benchmarks/flight_harm.py, and a factor beyond.
TEMPERATURE_LADDER = Ladder(0.003, 0.4, 1.0)
HUMIDITY_LADDER = Ladder(0.002, 2.0, 5.0)  # in the cold little vapour is much humidity


@dataclass(frozen=True)
class DesignTable:
    """Values (t, v, p, c) at the nodes of a grid over temperature, ln of the airspeed and ln of the pressure.

    An axis of one node stands for a quantity on which nothing depends.
    """

    temperature_c: Array
    ln_airspeed: Array
    ln_pressure: Array
    values: Array

    def at(self, temperature_c: float, airspeed_m_s: float, pressure_hpa: float) -> Array:
        """Interpolated values (c,); beyond the grid those at its edge."""
        values = self.values
        axes = (self.temperature_c, self.ln_airspeed, self.ln_pressure)
        place_in = (temperature_c, log(max(airspeed_m_s, AIRSPEEDS_M_S[0])), log(pressure_hpa))
        for axis, wanted in zip(axes, place_in, strict=True):
            if axis.size == 1:
                values = values[0]
                continue
            left = min(max(int(np.searchsorted(axis, wanted, side="right")) - 1, 0), axis.size - 2)
            place = min(max((wanted - axis[left]) / (axis[left + 1] - axis[left]), 0.0), 1.0)
            values = values[left] + place * (values[left + 1] - values[left])
        return np.asarray(values)


@dataclass(frozen=True)
class ChannelDesign:
    """One sensor.

    Attributes
    ----------
    modes, slow : int
        Lags K, of which the last so many are slow shares beside the body.
    response : Table
        Weights (K), ln of the rates [1/s] (K), relative standard uncertainty of the time scale.
    readout : Table
        Offset and gain that turn a reading into what the body showed, and the standard uncertainty that is left.
    slow_uncertainty : tuple of float
        Of the slow shares.
    noise : float
        Of single readings [unit].
    share : float
        Most of a step of the air that the sensor shows in one period.
    possible : tuple of float
        What a reading can be.
    swing : float
        Most that the air goes and comes back within two rows.
    ceiling : float
        Reading at which the sensor stops; infinite where it does not.
    left : float
        Standard uncertainty of what cannot be undone.
    delay_s : float
        How late readings are.
    ladder : Ladder
    resolved_rate : tuple of float
        Angular frequency above which the air is not resolved [1/s], at STRENGTH_COUNT strengths in equal ratios.
    covers_c : tuple of float
        Temperatures that the profile speaks for.
    straight_s : float
        How long the air is taken as straight between two readings; over longer steps it is cut.
    unsure_of_airspeed : float
        Relative standard uncertainty of the time scale where no airspeed is known.
    """

    modes: int
    slow: int
    response: DesignTable
    readout: DesignTable
    slow_uncertainty: tuple[float, ...]
    noise: float
    share: float
    possible: tuple[float, float]
    swing: float
    ceiling: float
    left: float
    delay_s: float
    ladder: Ladder
    resolved_rate: tuple[float, ...]
    covers_c: tuple[float, float]
    straight_s: float
    unsure_of_airspeed: float

    def parts(self, step_s: float) -> int:
        """Straight pieces that the air of a step is cut into."""
        return int(min(max(step_s / self.straight_s + 0.5, 1.0), MOST_PARTS))


@dataclass(frozen=True)
class Design:
    """Both sensors, either of which may be missing; `period_s` between rows; `die_share` of the way from the air's
    temperature to the die's that vapour is turned into humidity at (0: at the air's); `beside_bead`: the bead's reading
    is the die's temperature; `by_activity`: the film takes up by humidity and not by vapour; `notes` on what is left
    alone."""

    temperature: ChannelDesign | None
    humidity: ChannelDesign | None
    period_s: float
    die_share: float = 0.0
    beside_bead: bool = False
    by_activity: bool = False
    notes: tuple[str, ...] = ()


def design_of(
    profile: Profile,
    period_s: float | None = None,
    temperature_noise_k: float | None = None,
    humidity_noise_percent: float | None = None,
    most_modes: int = MOST_MODES,
) -> Design:
    """Tables of a profile for rows `period_s` apart (the profile's own sampling period, or 0.1 s).

    Raises
    ------
    InputError
        A readout is bent more than a line can say, or an effect lacks a parameter.
    """
    t, h = profile.temperature, profile.humidity
    stated = [part.sampling_period_s for part in (t, h) if part is not None and part.sampling_period_s]
    period = period_s or (stated[0] if stated else 0.1)
    bead = None if t is None else _bead(t, profile.bodies["imet"], period, temperature_noise_k, most_modes)
    film, share, beside_bead, by_activity = None, 0.0, False, False
    if h is not None:
        film = _film(h, profile.bodies["hyt"], period, humidity_noise_percent, most_modes)
        effects = acting(h.effects, "humidity", h.discovered)
        asking = [one for one in effects if one.meaning.at_die]
        shares = [1.0 if one.meaning.die_share is None else one.meaning.die_share(one.values) for one in asking]
        beside_bead = bead is not None and any(one.meaning.film_c is not None for one in effects)
        share = 1.0 if beside_bead else max(shares, default=0.0)
        by_activity = uptake(effects)[0] >= 0.5
    return Design(bead, film, period, share, beside_bead, by_activity)


def _bead(part: TemperatureProfile, body: str, period: float, given: float | None, most_modes: int) -> ChannelDesign:
    effects = acting(part.effects, "temperature", part.discovered)
    noise = noise_floor(effects, given or (NOISE_K if part.noise_k is None else part.noise_k))

    def readings(stream: Stream) -> tuple[Array, Array, Array]:
        # what a bead reads is about the temperature around it, which is the table's own axis
        found = undone(effects, stream.temperature_c, stream, part.bead_radius_m, period)
        return found.reading - stream.temperature_c, np.ones(found.reading.size), found.uncertainty

    return _channel(
        effects,
        partial(bead_response, part, body=body),
        readings,
        part.bead_radius_m,
        period,
        noise,
        most_modes,
        np.array(BEAD_RANGE_C),
        (-np.inf, np.inf),
        "temperature_c",
        LIKELY_RANGES["swing_k"].high,
        TEMPERATURE_LADDER,
    )


def _film(part: HumidityProfile, body: str, period: float, given: float | None, most_modes: int) -> ChannelDesign:
    effects = acting(part.effects, "humidity", part.discovered)
    own = NOISE_PERCENT if part.noise_percent is None else part.noise_percent
    noise = noise_floor(effects, given or own)
    low, high = part.temperature_range_c

    def readings(stream: Stream) -> tuple[Array, Array, Array]:
        ends, middle = (20.0, 80.0), 50.0
        first, last, between = (
            undone(effects, np.full(stream.temperature_c.shape, at), stream, part.film_thickness_m, period)
            for at in (*ends, middle)
        )
        gain = (last.reading - first.reading) / (ends[1] - ends[0])
        offset = first.reading - gain * ends[0]
        if np.any(np.abs(offset + gain * middle - between.reading) > BENT_PERCENT):
            raise InputError(
                "profile: the hygrometer's readout is bent; a causal corrector takes a line; take that effect out of "
                "the profile, or correct with the smoother"
            )
        return offset, gain, between.uncertainty

    return _channel(
        effects,
        lambda stream: film_response(part, stream.temperature_c, stream, body),
        readings,
        part.film_thickness_m,
        period,
        noise,
        most_modes,
        np.array([low, *(row.ambient_temperature_c for row in part.diffusivity_table), high]),
        (low, high),
        "humidity_reading_percent",
        LIKELY_RANGES["swing_percent"].high,
        HUMIDITY_LADDER,
    )


def _channel(
    effects: tuple[Acting, ...],
    respond: Callable[[Stream], LagResponse],
    readings: Callable[[Stream], tuple[Array, Array, Array]],
    length_m: float,
    period: float,
    noise: float,
    most_modes: int,
    corners_c: Array,
    covers_c: tuple[float, float],
    possible: str,
    swing: float,
    ladder: Ladder,
) -> ChannelDesign:
    temperature = np.unique(
        np.concatenate(
            [
                np.linspace(low, high, int(np.ceil((high - low) / TEMPERATURE_STEP_K)) + 1)
                for low, high in zip(corners_c[:-1], corners_c[1:], strict=True)
            ]
        )
    )
    speed = np.array(AIRSPEEDS_M_S if of_airspeed(effects, length_m) else [REFERENCE_AIRFLOW_M_S])
    pressure = np.array(PRESSURES_HPA if of_pressure(effects, length_m) else [STANDARD_PRESSURE_HPA])
    nodes = np.array(list(product(temperature, speed, pressure)))
    stream = Stream(nodes[:, 1], nodes[:, 2], nodes[:, 0])
    weight, rate, relative, slow = _parallel(respond(stream), most_modes)
    shape = (temperature.size, speed.size, pressure.size, -1)
    lags = np.concatenate([weight, np.log(rate), relative[:, None]], axis=1).reshape(shape)
    readout = np.stack(readings(stream), axis=1).reshape(shape)
    axes = (temperature, speed, pressure)
    delay = sum(one.meaning.delay_s(one.values, period) for one in effects if one.meaning.delay_s is not None)
    limit = ceiling(effects)
    there = Stream(
        np.array([REFERENCE_AIRFLOW_M_S]), np.array([STANDARD_PRESSURE_HPA]), np.median(corners_c, keepdims=True)
    )
    middle, strengths = respond(there), np.geomspace(ladder.lowest, ladder.highest, STRENGTH_COUNT)
    return ChannelDesign(
        weight.shape[1],
        slow.size,
        _collapsed(*axes, lags),
        _collapsed(*axes, readout),
        tuple(slow.tolist()),
        noise,
        largest_share(respond(stream), period),
        (RANGES[possible].low, RANGES[possible].high),
        swing,
        np.inf if limit is None else limit,
        not_known(effects),
        delay,
        ladder,
        tuple(resolved_rate(Prior(one, one, np.array([noise])), middle, period) for one in strengths[:, None]),
        covers_c,
        PER_LAG * middle.slowest_s,
        unsure_of_airspeed(respond, there, NO_SPEED) if speed.size > 1 else 0.0,
    )


def _parallel(response: LagResponse, most: int) -> tuple[Array, Array, Array, Array]:
    """Weights and rates (n, K) of lags that all follow the air itself, relative uncertainty (n,), and that of the slow
    shares, which are the last."""
    slow = response.slow_uncertainty
    weight, rate = response.weight, response.rate
    if response.cap:
        both = [response.modes(row) for row in range(len(rate))]
        count = min(one.rate.size for one in both)
        weight = np.stack([-one.amplitude[:count] for one in both])
        rate = np.stack([one.rate[:count] for one in both])
        # slow shares are among them, and their uncertainty is taken with the time scale's
        relative = np.hypot(response.relative_uncertainty, float(np.sqrt(np.sum(slow**2))))
        return (*_merged(weight, rate, 0, most + 2), relative, np.zeros(0))
    return (*_merged(weight, rate, slow.size, most), response.relative_uncertainty, slow)


def _merged(weight: Array, rate: Array, slow: int, most: int) -> tuple[Array, Array]:
    """The body's slowest lags, of which the last stands for the faster, and the slow shares."""
    own = weight.shape[1] - slow
    body = slowest(Modes(-weight[:, :own], rate[:, :own]), most)
    parts = (-body.amplitude, weight[:, own:]), (body.rate, rate[:, own:])
    return np.concatenate(parts[0], axis=1), np.concatenate(parts[1], axis=1)


def _collapsed(temperature: Array, speed: Array, pressure: Array, values: Array) -> DesignTable:
    """A table without the axes on which nothing depends."""
    axes = [temperature, speed, pressure]
    for i, axis in enumerate(axes):
        if np.allclose(values, np.take(values, [0], axis=i), rtol=1e-9, atol=1e-12):
            axes[i], values = axis[:1], np.take(values, [0], axis=i)
    return DesignTable(axes[0], np.log(axes[1]), np.log(axes[2]), values)
