"""How likely a flight's readings are under a model of the sensor, whatever the air was: closed form, with its slopes.

The air is a random function of altitude and time, a(z, t) = g(z) + c(z, t). g is a straight line with unknown ends and
a random walk along z; layers move up or down meanwhile, z -> z + m(z) t; c is what else changed, and grows with the
time between two passes: as a whole, in layers, and by turbulence that is forgotten in minutes. The readings y of a
channel are linear in g and c, so that they are Gaussian with covariance

    S = H G W G' H' + sum_j exp(h_j) B_j,

H the sensor's response along the moved track, G the walk, B_j the change's and the noise's covariances of unit size,
h_j their logarithms. h and m are a flight's own, found by restricted maximum likelihood with average information
(Gilmour, Thompson and Cullis 1995, doi 10.2307/2533274). Inversions are no steps of a Gaussian walk that is the same at
all heights: W has the variance of a step where it is, from how steep the readings are around it. With equal ones a
sharp inversion would be taken for a slow one, seen by a faster sensor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from shockrig.analysis.learn.bins import SUB_SAMPLES, FlightBins
from shockrig.analysis.learn.laws import Law, Values, drawn_back, response
from shockrig.files.learned import SIZES

Array = NDArray[np.float64]

KNOTS_PER_BIN = 0.5  # of the shared air
LAYER_SHARE, LEAST_LAYER_M = 0.1, 30.0  # of the range of altitudes: how far a change of the air reaches
EDDY_M, EDDY_S = 40.0, 60.0  # how far turbulence reaches, and how long it lasts
AROUND_SHARE, AROUND_M = 0.05, 50.0  # of the range of altitudes, and at least: over which a profile is as steep
LEAST_STEEPNESS = 0.05  # of the usual, where the readings are as flat as can be
UNKNOWN = 30.0  # times a channel's own spread: what is known of the ends of the air's profile before any reading
SIZE_SPREAD = 3.0  # of a size's logarithm, before any reading
# Usual sizes, as a share of the channel's spread along the flight (standard deviations): the walk over the whole range
# of altitudes, the change of all of the air and of layers by the flight's end, eddies, noise.
USUAL = dict(zip(SIZES, (0.5, 0.1, 0.1, 0.03, 0.01), strict=True))
BEGIN = dict(zip(SIZES, (0.2, 0.03, 0.01, 0.01, 0.01), strict=True))  # where a fit begins: air that stays
MOVING_LAYERS = 4  # heights at which layers move by themselves, straight between them
MOVES = 1 + MOVING_LAYERS  # all of the air at once, and each of them
MOVE_STEP = 0.01  # over which slopes are taken
MOVED_M, MOVED_M_PER_H = 10.0, 60.0  # that layers move: by waves, and as a boundary layer grows (standard deviations)


@dataclass(frozen=True)
class FlightChannelData:
    """One channel of a flight, ready: what of its likelihood no law changes.

    Attributes
    ----------
    bins : FlightBins
    channel : str
    rows : ndarray (m,)
        Bins in which it was read.
    reading : ndarray (m,)
        Less their mean, over `unit`.
    mean, unit : float
        Of the channel along the flight, and its spread [degC, K or %RH].
    knots, steps : ndarray (k,), (k - 1,)
        Altitudes of the shared air [m], and the variances of its steps between them, over what is usual.
    changes : ndarray (j, m, m)
        Covariances of the air's change, of unit size; behind them the noise's, the unit matrix.
    usual, spread : ndarray (2 + j + MOVES,)
        What is known of the flight's own numbers before any reading: logarithms of sizes (variances) of the walk, the
        changes and the noise, then the moves of layers in units of `moved_m`.
    moved_m : float
    """

    bins: FlightBins
    channel: str
    rows: NDArray[np.int64]
    reading: Array
    mean: float
    unit: float
    knots: Array
    steps: Array
    changes: Array
    usual: Array
    spread: Array
    moved_m: float


def prepared(bins: FlightBins, channel: str) -> FlightChannelData:
    """A channel of a flight, ready to be weighed."""
    rows = np.flatnonzero(bins.seen(channel))
    value = bins.values[channel][rows]
    unit = max(float(value.std()), 1e-6)
    altitude, time = bins.altitude_m[rows], bins.time_s[rows]
    low, high = float(bins.within_altitudes.min()), float(bins.within_altitudes.max())
    knots = np.linspace(low, high, max(int(KNOTS_PER_BIN * bins.time_s.size), 8))
    layer = max(LAYER_SHARE * (high - low), LEAST_LAYER_M)
    since = (time - time[0]) / max(float(np.ptp(time)), 1e-9)
    meanwhile = np.minimum(since[:, None], since[None, :])  # the covariance of what grows as a random walk
    apart_m = np.abs(altitude[:, None] - altitude[None, :])
    apart_s = np.abs(time[:, None] - time[None, :])
    near = np.exp(-apart_m / layer)
    changes = np.stack(
        [
            meanwhile,
            meanwhile * near,
            np.exp(-apart_m / EDDY_M - apart_s / EDDY_S),
        ]
    )
    sizes = 2.0 * np.log(list(USUAL.values()))
    usual = np.r_[sizes, np.zeros(MOVES)]
    spread = np.r_[np.full(sizes.size, SIZE_SPREAD), np.ones(MOVES)]
    moved_m = float(np.hypot(MOVED_M, MOVED_M_PER_H * bins.minutes / 60.0))
    return FlightChannelData(
        bins,
        channel,
        rows,
        (value - value.mean()) / unit,
        float(value.mean()),
        unit,
        knots,
        _steepness(bins, channel, knots),
        changes,
        usual,
        spread,
        moved_m,
    )


def _steepness(bins: FlightBins, channel: str, knots: Array) -> Array:
    """How steep the profile is around each step (k - 1,), squared, over what is usual along the flight."""
    value, altitude = bins.values[channel], bins.altitude_m
    reach = max(AROUND_SHARE * float(np.ptp(knots)), AROUND_M)
    squares, weights = np.zeros(knots.size - 1), np.zeros(knots.size - 1)
    middle = 0.5 * (knots[1:] + knots[:-1])
    for one in bins.passes:
        rows = one.first + np.flatnonzero(np.isfinite(value[one.rows]))
        rise, step = np.diff(altitude[rows]), np.diff(value[rows])
        at = 0.5 * (altitude[rows][1:] + altitude[rows][:-1])
        near = np.exp(-0.5 * ((middle[:, None] - at) / (0.5 * reach)) ** 2)
        squares += near @ step**2
        weights += near @ np.abs(rise)
    steep = squares / np.maximum(weights, 1e-9)
    usual = float(steep.mean())
    return np.maximum(steep / usual, LEAST_STEEPNESS) if usual > 0 else np.ones(steep.size)


@dataclass(frozen=True)
class SensorModel:
    """A model of the sensor on one channel: laws, and the values of their parameters."""

    laws: tuple[Law, ...]
    values: Values

    def seen_air(self, data: FlightChannelData, moves: Array) -> Array:
        """What the sensor reads of the shared air's columns (m, 2 + k), layers moved (MOVES,)."""
        return self.seen(data, _columns(data.knots, moved_track(data, self.shift_s, moves)[0]))

    @property
    def shift_s(self) -> float:
        """By how much the track's time is behind the sensor's."""
        return sum(law.shift_s(self.values) for law in self.laws if law.shift_s is not None)

    def lags(self, data: FlightChannelData) -> tuple[tuple[Array, Array], ...]:
        """Shares and time constants of the response, over bins."""
        return next((law.lags(self.values, data.bins) for law in self.laws if law.lags is not None), ())

    def seen(self, data: FlightChannelData, air: Array) -> Array:
        """What it reads of columns of air that are given within bins, (n, SUB_SAMPLES, q): (m, q)."""
        return response(self.lags(data), data.bins, air)[data.rows]

    def offset(self, data: FlightChannelData) -> Array:
        """What the readings are off by (m,), over the channel's unit."""
        total = np.zeros(data.rows.size)
        for law in self.laws:
            if law.offset is not None and data.channel == (law.channel or "temperature"):
                total = total + self._held(data, law.offset(self.values, data.bins)) / data.unit
        if not self._factors(data):
            return total
        level = data.mean / data.unit
        return data.reading + level - (data.reading + level - total) * np.exp(-self.log_factor(data))

    def log_factor(self, data: FlightChannelData) -> Array:
        """Logarithm of what readings are multiplied by (m,)."""
        none = np.zeros(data.rows.size)
        factors = (factor(self.values, data.bins) for factor in self._factors(data))
        return sum((np.log(self._held(data, factor)) for factor in factors), none)

    def _held(self, data: FlightChannelData, given: Array) -> Array:
        """What the sensor reads (m,) of what is given over bins (n,): an offset comes as late as the air does."""
        return self.seen(data, np.repeat(given[:, None, None], SUB_SAMPLES, axis=1))[:, 0]

    def offsets(self, data: FlightChannelData) -> bool:
        """Whether a law gives the channel an offset or a factor."""
        own = any(law.offset is not None and data.channel == (law.channel or "temperature") for law in self.laws)
        return own or bool(self._factors(data))

    def _factors(self, data: FlightChannelData) -> list[Callable[[Values, FlightBins], Array]]:
        return [law.factor for law in self.laws if law.factor is not None and data.channel == "humidity"]

    def settling(self, data: FlightChannelData) -> Array:
        """What the sensor still shows of what it was before the first bin (m,)."""
        before = np.zeros((*data.bins.within_s.shape, 1))
        before[0, 0] = 1.0
        return self.seen(data, before)[:, 0]


def moved_track(data: FlightChannelData, shift_s: float, moves: Array) -> tuple[Array, Array]:
    """Altitudes within bins (n, SUB_SAMPLES) once layers have moved, and their slopes over moves, (MOVES, ...) [m]."""
    bins, knots = data.bins, data.knots
    altitude = np.interp(bins.within_s + shift_s, bins.track_s, bins.track_m)
    since = (bins.time_s - bins.time_s[0]) / max(float(np.ptp(bins.time_s)), 1e-9)
    place = (altitude - knots[0]) / (knots[-1] - knots[0]) * (MOVING_LAYERS - 1)
    heights = np.arange(MOVING_LAYERS)[:, None, None]
    near = np.maximum(1.0 - np.abs(np.clip(place, 0.0, MOVING_LAYERS - 1.0) - heights), 0.0)
    slopes = data.moved_m * since[:, None] * np.concatenate([np.ones_like(near[:1]), near])
    return altitude + np.tensordot(moves, slopes, axes=1), slopes


def _columns(knots: Array, altitude: Array) -> Array:
    """A constant, a slope, and ramps from knot to knot at altitudes of any shape (..., 2 + k - 1)."""
    place = np.clip((altitude - knots[0]) / (knots[1] - knots[0]), 0.0, knots.size - 1.0)
    columns = np.empty((*place.shape, knots.size + 1))
    columns[..., 0] = UNKNOWN
    columns[..., 1] = UNKNOWN * (2.0 * place / (knots.size - 1.0) - 1.0)
    np.clip(place[..., None] - np.arange(knots.size - 1), 0.0, 1.0, out=columns[..., 2:])
    columns[..., 2:] /= np.sqrt(knots.size - 1.0)
    return columns


@dataclass(frozen=True)
class Density:
    """The log density of a flight's channel [nats], with its slopes over laws' parameters and the flight's sizes.

    Attributes
    ----------
    value : float
    slope, information : ndarray (p + s,), (p + s, p + s)
        The parameters first; without what is known before any reading.
    grown : ndarray (s - MOVES,)
        How far the next step of the minorisation of Zhou and others (2019, doi 10.1080/10618600.2018.1529601) takes
        the sizes' logarithms.
    effective : ndarray (s - MOVES,)
        How many readings each size is known from, by what the others leave.
    """

    value: float
    slope: Array
    information: Array
    grown: Array
    effective: Array


def begun(data: FlightChannelData) -> Array:
    """The flight's own numbers where a fit begins: what air that stays cannot explain is then the change's."""
    return np.r_[2.0 * np.log(list(BEGIN.values())), np.zeros(MOVES)]


def density(
    data: FlightChannelData, sensor: SensorModel, own: Array, parameters: tuple[tuple[str, float, bool], ...] = ()
) -> Density:
    """The density under a sensor and a flight's own numbers; slopes over `parameters` (name, step, log)."""
    sizes, moves = own[:-MOVES], own[-MOVES:]
    first = len(parameters)
    altitude, track_slopes = moved_track(data, sensor.shift_s, moves)
    air = _with_start(_columns(data.knots, altitude))
    lags = sensor.lags(data)
    seen = response(lags, data.bins, air)[data.rows]
    offset, log_factor = sensor.offset(data), sensor.log_factor(data)
    residual = data.reading - offset
    weight = np.r_[1.0, 1.0, np.exp(sizes[0]) * data.steps, 1.0]
    scaled = seen * weight
    count = residual.size
    changes = data.changes.reshape(len(data.changes), -1)
    covariance = scaled @ seen.T
    covariance += (np.exp(sizes[1:-1]) @ changes).reshape(count, count)
    covariance.flat[:: count + 1] += np.exp(sizes[-1])
    lower, failed = lapack.dpotrf(covariance, lower=1, clean=0)
    if failed:
        none, every = np.zeros(first + own.size), np.eye(first + own.size)
        return Density(-np.inf, none, every, np.zeros(sizes.size), np.ones(sizes.size))
    v = lapack.dpotrs(lower, residual, lower=1)[0]
    value = -0.5 * float(residual @ v) - float(np.log(lower.diagonal()).sum()) - count * np.log(data.unit)
    value -= float(log_factor.sum())  # readings that are multiplied are as much farther apart
    inverse = lapack.dpotri(lower, lower=1)[0]
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    # S_j v of each slope, tr(S^-1 S_j), and what the offset adds: its slope is offset'v, its information
    # offset'S^-1 offset, where a covariance's are half as large.
    moved, traces = np.empty((first + own.size, count)), np.empty(first + own.size)
    pulled, scales = np.zeros(first), np.zeros(first)
    solved, drawn = inverse @ scaled, scaled.T @ v
    for i, (name, step, log) in enumerate(parameters):
        at = sensor.values[name]
        ahead = SensorModel(sensor.laws, {**sensor.values, name: at * np.exp(step) if log else at + step})
        acts = [law for law in sensor.laws if any(one.name == name for one in law.parameters)]
        moved[i], traces[i] = 0.0, 0.0
        if any(law.lags is not None or law.shift_s is not None for law in acts):
            there = air
            if ahead.shift_s != sensor.shift_s:
                there = _with_start(_columns(data.knots, moved_track(data, ahead.shift_s, moves)[0]))
            d_seen = (response(ahead.lags(data), data.bins, there)[data.rows] - seen) / step
            moved[i] = d_seen @ drawn + scaled @ (d_seen.T @ v)
            traces[i] = 2.0 * float(np.vdot(solved, d_seen))
        if sensor.offsets(data):
            d_offset = (ahead.offset(data) - offset) / step
            d_factor = (ahead.log_factor(data) - log_factor) / step
            moved[i] += np.sqrt(2.0) * d_offset
            pulled[i] = (1.0 - np.sqrt(0.5)) * float(d_offset @ v) - float(d_factor.sum())
            scales[i] = float(d_factor @ d_factor)
    of_walk, of_sizes = slice(2, -1), slice(first, first + sizes.size)
    moved[first] = scaled[:, of_walk] @ (seen[:, of_walk].T @ v)
    traces[first] = np.vdot(solved[:, of_walk], seen[:, of_walk])
    moved[first + 1 : of_sizes.stop - 1] = np.exp(sizes[1:-1])[:, None] * (data.changes @ v)
    traces[first + 1 : of_sizes.stop - 1] = np.exp(sizes[1:-1]) * (changes @ inverse.ravel())
    moved[of_sizes.stop - 1] = np.exp(sizes[-1]) * v
    traces[of_sizes.stop - 1] = np.exp(sizes[-1]) * float(inverse.trace())
    through = moved[of_sizes] @ v
    grown = np.log(np.maximum(through, 1e-12) / np.maximum(traces[of_sizes], 1e-12))
    moved[of_sizes.stop :], traces[of_sizes.stop :] = _of_moves(
        data, lags, altitude, track_slopes, scaled, np.column_stack([solved, v]), drawn
    )
    slope = 0.5 * (moved @ v - traces)
    slope[:first] += pulled
    information = 0.5 * moved @ inverse @ moved.T
    information.flat[: first * (len(information) + 1) : len(information) + 1] += scales
    return Density(value, slope, information, grown, np.maximum(traces[of_sizes], 1.0))


def _with_start(air: Array) -> Array:
    """Columns of air, and behind them what the sensor was before the first bin."""
    before = np.zeros((*air.shape[:-1], 1))
    before[0, 0] = UNKNOWN
    return np.concatenate([air, before], axis=-1)


def _of_moves(
    data: FlightChannelData,
    lags: tuple[tuple[Array, Array], ...],
    altitude: Array,
    track_slopes: Array,
    scaled: Array,
    solved: Array,
    drawn: Array,
) -> tuple[Array, Array]:
    """S_j v and tr(S^-1 S_j) of each move of layers: (MOVES, m), (MOVES,).

    A move changes two columns of the air, where the sensor is: the line's, and the step's in which it is.
    """
    knots = data.knots
    last = knots.size - 1.0
    place = (altitude - knots[0]) / (knots[1] - knots[0])
    step = np.clip(place, 0.0, last - 1.0).astype(int)
    inside = ((place > 0.0) & (place < last)) / (knots[1] - knots[0])
    line, ramp = UNKNOWN * 2.0 / last * inside, inside / np.sqrt(last)
    every = np.zeros((data.bins.time_s.size, solved.shape[1]))
    every[data.rows] = solved
    back = drawn_back(lags, data.bins, every)
    slopes = track_slopes.reshape(MOVES, -1)
    both = line * back[..., 1] + ramp * np.take_along_axis(back, step[..., None] + 2, axis=-1)[..., 0]
    traces = 2.0 * slopes @ both.ravel()
    onto = track_slopes * (line * drawn[1] + ramp * drawn[step + 2])
    moved = response(lags, data.bins, np.moveaxis(onto, 0, -1))[data.rows].T
    of_v = slopes * back[..., -1].ravel()
    columns = np.zeros((MOVES, scaled.shape[1]))
    columns[:, 1] = of_v @ line.ravel()
    for i in range(MOVES):
        columns[i, 2:-1] = np.bincount(step.ravel(), weights=of_v[i] * ramp.ravel(), minlength=knots.size - 1)
    return moved + columns @ scaled.T, traces


def air_of(data: FlightChannelData, sensor: SensorModel, own: Array, rows: NDArray[np.int64], at: Array) -> Array:
    """The air at altitudes `at` (q,) that some readings alone leave, over the channel's unit: its expected value."""
    sizes, moves = own[:-MOVES], own[-MOVES:]
    seen = sensor.seen_air(data, moves)[rows]
    weight = np.r_[1.0, 1.0, np.exp(sizes[0]) * data.steps]
    covariance = (seen * weight) @ seen.T + np.exp(sizes[-1]) * np.eye(rows.size)
    covariance += np.exp(sizes[-2]) * data.changes[-1][np.ix_(rows, rows)]
    start = sensor.settling(data)[rows]
    covariance += UNKNOWN**2 * np.outer(start, start)
    residual = (data.reading - sensor.offset(data))[rows]
    columns = _columns(data.knots, at)
    return np.asarray((columns * weight) @ (seen.T @ np.linalg.solve(covariance, residual)))
