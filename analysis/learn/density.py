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

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.linalg import lapack

from shockrig.analysis.learn.bins import SUB_SAMPLES, FlightBins
from shockrig.analysis.learn.laws import Law, Values, drawn_back, response
from shockrig.analysis.physics.humidity import saturation_pressure_hpa
from shockrig.files.learned import SIZES

Array = NDArray[np.float64]

KNOTS_PER_BIN = 0.5  # of the shared air
PROFILE_DEGREE = 4  # of a flight's usual temperature over altitude
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
AIR_KEPT_BY = ("time_constant_s", "fraction", "second_time_constant_s", "growth_per_k")  # what it takes up as well
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
        Less `level`, over `unit`.
    mean, unit : float
        Of the shared air along the flight, and its spread [degC, K or %RH].
    level : ndarray (m,)
        What a sensor without lag would read of air that is `mean` everywhere.
    read_c : ndarray (n, SUB_SAMPLES), or None
        Of humidity where temperature was read: the bead's reading, which is the film's temperature where no law says
        otherwise [degC].
    usual_c : Polynomial
        The flight's temperature over altitude [m]: shared humidity is vapour over saturation there.
    usual_es : float
        Saturation pressure at the flight's mean temperature [hPa]: the unit of vapour.
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
    level: Array
    read_c: Array | None
    usual_c: Polynomial
    usual_es: float
    knots: Array
    steps: Array
    changes: Array
    usual: Array
    spread: Array
    moved_m: float


def prepared(bins: FlightBins, channel: str) -> FlightChannelData:
    """A channel of a flight, ready to be weighed."""
    rows = np.flatnonzero(bins.seen(channel))
    read_c, usual_c, usual_es, film = None, Polynomial([0.0]), 1.0, np.ones(bins.time_s.size)
    if channel == "humidity" and bins.has("temperature"):
        read = bins.bead_c
        read_c = np.interp(bins.within_s, bins.time_s, read)
        usual_c = Polynomial.fit(bins.altitude_m, read, PROFILE_DEGREE)
        usual_es = float(saturation_pressure_hpa(read.mean()))
        film = saturation_pressure_hpa(usual_c(bins.altitude_m)) / saturation_pressure_hpa(read)
    film = film[rows]
    value = bins.values[channel][rows] / film
    mean, unit = float(value.mean()), max(float(value.std()), 1e-6)
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
        film * (value - mean) / unit,
        mean,
        unit,
        film * mean,
        read_c,
        usual_c,
        usual_es,
        knots,
        _steepness(bins, rows, value, knots),
        changes * np.outer(film, film),
        usual,
        spread,
        moved_m,
    )


def _steepness(bins: FlightBins, rows: NDArray[np.int64], value: Array, knots: Array) -> Array:
    """How steep the profile is around each step (k - 1,), squared, over what is usual along the flight."""
    altitude = bins.altitude_m[rows]
    reach = max(AROUND_SHARE * float(np.ptp(knots)), AROUND_M)
    squares, weights = np.zeros(knots.size - 1), np.zeros(knots.size - 1)
    middle = 0.5 * (knots[1:] + knots[:-1])
    for one in bins.passes:
        mine = (rows >= one.first) & (rows <= one.last)
        rise, step = np.diff(altitude[mine]), np.diff(value[mine])
        at = 0.5 * (altitude[mine][1:] + altitude[mine][:-1])
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
        return self.seen(data, _air(data, self, moves)[0][..., :-1])

    @property
    def shift_s(self) -> float:
        """By how much the track's time is behind the sensor's."""
        return sum(law.shift_s(self.values) for law in self.laws if law.shift_s is not None)

    def lags(self, data: FlightChannelData) -> tuple[tuple[Array, Array], ...]:
        """Shares and time constants of the response, over bins."""
        return next((law.lags(self.values, data.bins) for law in self.laws if law.lags is not None), ())

    def seen(self, data: FlightChannelData, air: Array) -> Array:
        """What it reads of columns of what it takes up, given within bins, (n, SUB_SAMPLES, q): (m, q)."""
        return (self.given_back(data)[:, None] * response(self.lags(data), data.bins, air))[data.rows]

    @property
    def activity(self) -> float:
        """From 0, where the film takes up vapour, to 1, where it takes up relative humidity at its own temperature."""
        return sum(law.activity(self.values) for law in self.laws if law.activity is not None)

    def film_es(self, data: FlightChannelData) -> Array:
        """Saturation pressure at the film's temperature (n, SUB_SAMPLES), over that of the flight's usual one."""
        if data.read_c is None:
            return np.ones(data.bins.within_s.shape)
        warmer = sum((law.warmer(self.values, data.bins) for law in self.laws if law.warmer is not None), 0.0)
        return saturation_pressure_hpa(data.read_c + np.asarray(warmer).reshape(-1, 1)) / data.usual_es

    def taken_up(self, data: FlightChannelData) -> Array:
        """What it takes up over what the shared air is (n, SUB_SAMPLES)."""
        if data.read_c is None:
            return np.ones(data.bins.within_s.shape)
        altitude = np.interp(data.bins.within_s + self.shift_s, data.bins.track_s, data.bins.track_m)
        vapour = saturation_pressure_hpa(data.usual_c(altitude)) / data.usual_es
        return vapour * self.film_es(data) ** -self.activity

    def given_back(self, data: FlightChannelData) -> Array:
        """What it reads over what it has taken up (n,)."""
        return np.asarray((self.film_es(data) ** (self.activity - 1.0)).mean(axis=1))

    def offset(self, data: FlightChannelData) -> Array:
        """What the readings are off by (m,), over the channel's unit: by an offset of the air, and by how the film
        meets its mean."""
        found = (data.mean * self.seen(data, self.taken_up(data)[..., None])[:, 0] - data.level) / data.unit
        for law in self.laws:
            if law.offset is not None and law.channel == data.channel:
                given = np.repeat(law.offset(self.values, data.bins)[:, None, None], SUB_SAMPLES, axis=1)
                late = response(self.lags(data), data.bins, given)  # as late as the air
                found += late[data.rows, 0] / data.unit
        return found

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
    air, taken_up, altitude, track_slopes = _air(data, sensor, moves)
    seen = sensor.seen(data, air)
    offset = sensor.offset(data)
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
    inverse = lapack.dpotri(lower, lower=1)[0]
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    # Of each number: S_j v and tr(S^-1 S_j), which give the slope, and how the readings would move, which gives the
    # information. Of the sensor's numbers and the moves of layers that is how readings of the air move that these
    # readings leave likeliest: the line's ends are unknown, and with air as steep as they may be before any reading
    # (average information of S alone) a lag would be known many times too well.
    moved, traces = np.zeros((first + own.size, count)), np.zeros(first + own.size)
    expected, pulled = np.zeros_like(moved), np.zeros(first)
    solved, drawn = inverse @ scaled, scaled.T @ v
    for i, (name, step, log) in enumerate(parameters):
        at = sensor.values[name]
        ahead = SensorModel(sensor.laws, {**sensor.values, name: at * np.exp(step) if log else at + step})
        there = air if name in AIR_KEPT_BY else _air(data, ahead, moves)[0]
        d_seen = (ahead.seen(data, there) - seen) / step
        d_offset = (ahead.offset(data) - offset) / step
        onto = d_seen @ drawn
        moved[i] = onto + scaled @ (d_seen.T @ v)
        traces[i] = 2.0 * float(np.vdot(solved, d_seen))
        expected[i], pulled[i] = onto + d_offset, float(d_offset @ v)
    of_walk, of_sizes = slice(2, -1), slice(first, first + sizes.size)
    moved[first] = scaled[:, of_walk] @ (seen[:, of_walk].T @ v)
    traces[first] = np.vdot(solved[:, of_walk], seen[:, of_walk])
    moved[first + 1 : of_sizes.stop - 1] = np.exp(sizes[1:-1])[:, None] * (data.changes @ v)
    traces[first + 1 : of_sizes.stop - 1] = np.exp(sizes[1:-1]) * (changes @ inverse.ravel())
    moved[of_sizes.stop - 1] = np.exp(sizes[-1]) * v
    traces[of_sizes.stop - 1] = np.exp(sizes[-1]) * float(inverse.trace())
    through = moved[of_sizes] @ v
    grown = np.log(np.maximum(through, 1e-12) / np.maximum(traces[of_sizes], 1e-12))
    expected[of_sizes] = np.sqrt(0.5) * moved[of_sizes]
    last = slice(of_sizes.stop, None)
    moved[last], traces[last], expected[last] = _of_moves(
        data, sensor, taken_up, altitude, track_slopes, scaled, np.column_stack([solved, v]), drawn
    )
    slope = 0.5 * (moved @ v - traces)
    slope[:first] += pulled
    information = expected @ inverse @ expected.T
    return Density(value, slope, information, grown, np.maximum(traces[of_sizes], 1.0))


def _air(data: FlightChannelData, sensor: SensorModel, moves: Array) -> tuple[Array, Array, Array, Array]:
    """Columns of what the sensor takes up within bins, and behind them what it was before the first (n, SUB, q); what
    it takes up over the shared air; the moved track and its slopes (`moved_track`)."""
    altitude, slopes = moved_track(data, sensor.shift_s, moves)
    taken_up = sensor.taken_up(data)
    before = np.zeros((*altitude.shape, 1))
    before[0, 0] = UNKNOWN
    columns = taken_up[..., None] * _columns(data.knots, altitude)
    return np.concatenate([columns, before], axis=-1), taken_up, altitude, slopes


def _of_moves(
    data: FlightChannelData,
    sensor: SensorModel,
    taken_up: Array,
    altitude: Array,
    track_slopes: Array,
    scaled: Array,
    solved: Array,
    drawn: Array,
) -> tuple[Array, Array, Array]:
    """S_j v, tr(S^-1 S_j) and how the readings move by each move of layers: (MOVES, m), (MOVES,), (MOVES, m).

    A move changes two columns of the air, where the sensor is: the line's, and the step's in which it is.
    """
    knots = data.knots
    last = knots.size - 1.0
    place = (altitude - knots[0]) / (knots[1] - knots[0])
    step = np.clip(place, 0.0, last - 1.0).astype(int)
    inside = taken_up * ((place > 0.0) & (place < last)) / (knots[1] - knots[0])
    line, ramp = UNKNOWN * 2.0 / last * inside, inside / np.sqrt(last)
    every = np.zeros((data.bins.time_s.size, solved.shape[1]))
    every[data.rows] = solved
    every *= sensor.given_back(data)[:, None]
    back = drawn_back(sensor.lags(data), data.bins, every)
    slopes = track_slopes.reshape(MOVES, -1)
    both = line * back[..., 1] + ramp * np.take_along_axis(back, step[..., None] + 2, axis=-1)[..., 0]
    traces = 2.0 * slopes @ both.ravel()
    onto = track_slopes * (line * drawn[1] + ramp * drawn[step + 2])
    expected = sensor.seen(data, np.moveaxis(onto, 0, -1)).T
    of_v = slopes * back[..., -1].ravel()
    columns = np.zeros((MOVES, scaled.shape[1]))
    columns[:, 1] = of_v @ line.ravel()
    for i in range(MOVES):
        columns[i, 2:-1] = np.bincount(step.ravel(), weights=of_v[i] * ramp.ravel(), minlength=knots.size - 1)
    return expected + columns @ scaled.T, traces, expected


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
