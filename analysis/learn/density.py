"""How likely a flight's readings are under a model of the sensor, whatever the air was: closed form, with its slopes.

The air is a random function of altitude and time, a(z, t) = g(z) + c(z, t). g is a straight line with unknown ends and
two random walks along z; layers move up or down meanwhile, z -> z + m(z) t; c is what else changed, and grows with the
time between two passes: as a whole, in layers, and by turbulence that is forgotten in minutes. The readings y of a
channel are linear in g and c, so that they are Gaussian with covariance

    S = H G W G' H' + sum_j exp(h_j) B_j,

H the sensor's response along the moved track, G the walks, B_j the change's and the noise's covariances of unit size,
h_j their logarithms. h and m are a flight's own, found by restricted maximum likelihood with average information
(Gilmour, Thompson and Cullis 1995, doi 10.2307/2533274). Inversions are no steps of a Gaussian walk that is the same at
all heights: W has the variance of a step where it is, from how steep the readings are around it. With equal ones a
sharp inversion would be taken for a slow one, seen by a faster sensor. One walk's steps know nothing of one another, as
in turbulence that stays; the other's go on as those beside them, as in inversions, which are smooth. With the first
alone a thick inversion would be taken for a sharp one, seen by a slower sensor:

    W = D^1/2 (exp(h_0) + exp(h_1) R) D^1/2,

D the variances, R the correlation of steps that are so far apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from shockrig.analysis.learn.bins import SUB_SAMPLES, FlightBins
from shockrig.analysis.learn.laws import SECOND, USUAL_PATH_S, Law, Values, drawn_back, response
from shockrig.analysis.physics.humidity import saturation_pressure_hpa
from shockrig.files.learned import SIZES

Array = NDArray[np.float64]

KNOTS_PER_BIN = 0.5  # of the shared air
PROFILE_DEGREE = 4  # of a flight's usual temperature over altitude
LAYER_SHARE = 0.1  # of the range of altitudes: how far a change of the air reaches, and lengths below do at most
WALKS = 2  # of the shared air
EDDY_M, EDDY_S = 40.0, 60.0  # how far turbulence reaches, and how long it lasts
OWN_S = USUAL_PATH_S  # how long what a sensor does by itself lasts: as its housing takes to follow
AROUND_SHARE, AROUND_M = 0.05, 50.0  # of the range of altitudes, and at least: over which a profile is as steep
LEAST_STEEPNESS = 0.05  # of the usual, where the readings are as flat as can be
ROUNDED = 1e-9  # of the largest variance along a change of the air: what is smaller is rounding
UNKNOWN = 30.0  # times a channel's own spread: what is known of the ends of the air's profile before any reading
SIZE_SPREAD = 3.0  # of a size's logarithm, before any reading
# Usual sizes, as a share of the channel's spread along the flight (standard deviations): the walks over the whole range
# of altitudes, the change of all of the air and of layers by the flight's end, eddies, noise.
USUAL = dict(zip(SIZES, (0.5, 0.5, 0.1, 0.1, 0.03, 0.01), strict=True))
BEGIN = dict(zip(SIZES, (0.2, 0.2, 0.03, 0.01, 0.01, 0.01), strict=True))  # where a fit begins: air that stays
MOVING_LAYERS = 4  # heights at which layers move by themselves, straight between them
MOVES = 1 + MOVING_LAYERS  # all of the air at once, and each of them
MOVE_STEP = 0.01  # over which slopes are taken
OF_RESPONSE = (
    "time_constant_s",
    "fraction",
    "second_time_constant_s",
    "growth_per_k",
)  # parameters; others: of the air
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
    usual, spread : ndarray (WALKS + j + 1 + MOVES,)
        What is known of the flight's own numbers before any reading: logarithms of sizes (variances) of the walks, the
        changes and the noise, then the moves of layers in units of `moved_m`.
    moved_m : float
    met : tuple of ndarray (n, q)
        Of sensors side by side, columns of the changes that each meets as it lags; the last of `changes`.
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
    met: tuple[Array, ...] = ()

    @property
    def air_columns(self) -> int:
        """Columns of the shared air: a constant, a slope, and a ramp for each step."""
        return int(self.knots.size) + 1

    @property
    def of_met(self) -> tuple[tuple[int, slice], ...]:
        """Of each of `met`: the place of its size, and its columns, behind those of the air and of what was before."""
        begin = self.air_columns + len(self.bins.begins)
        ends = np.cumsum([begin, *(one.shape[1] for one in self.met)]).tolist()
        return tuple((len(SIZES) - 1 - len(self.met) + i, slice(ends[i], ends[i + 1])) for i in range(len(self.met)))

    @cached_property
    def part_s(self) -> float:
        """How long a part of a bin is, over which the air is held, where readings vary: mean over their variation."""
        apart = np.abs(np.diff(self.reading))
        apart[np.searchsorted(self.rows, self.bins.begins[1:]) - 1] = 0.0  # from one sensor to the next
        length = self.bins.length_s[self.rows]
        between = 0.5 * (length[1:] + length[:-1])
        return float(np.average(between, weights=apart + 1e-12)) / SUB_SAMPLES

    @cached_property
    def walks(self) -> Array:
        """Covariances of the shared air's steps (WALKS, k - 1, k - 1), over what is usual: of the walk whose steps know
        nothing of one another, and of the one whose steps go on; over all altitudes, both lead as far."""
        middle, size = 0.5 * (self.knots[1:] + self.knots[:-1]), np.sqrt(self.steps)
        alike = _smooth(np.abs(middle[:, None] - middle) / _around_m(self.knots))
        return np.stack([np.diag(self.steps), size[:, None] * size * (alike * alike.shape[0] / alike.sum())])

    def weighed(self, columns: Array, sizes: Array) -> Array:
        """Columns (m, q) of the air, of what was before, and of changes that several sensors meet, times their
        covariance."""
        found, walk = columns.copy(), slice(2, self.air_columns)
        found[:, walk] = columns[:, walk] @ np.tensordot(np.exp(sizes[:WALKS]), self.walks, axes=1)
        for j, place in self.of_met:
            found[:, place] *= np.exp(sizes[j])
        return found

    @cached_property
    def upper_changes(self) -> Array:
        """Upper triangles of `changes` (j, m m), all but the diagonal twice: their products with a symmetric matrix's
        upper triangle are those of the whole."""
        twice = np.triu(np.full(self.changes.shape[1:], 2.0), 1) + np.eye(self.changes.shape[1])
        return np.asarray((self.changes * twice).reshape(len(self.changes), -1))


def prepared(bins: FlightBins, channel: str) -> FlightChannelData:
    """A channel of a flight, ready to be weighed."""
    rows = np.flatnonzero(bins.seen(channel))
    read_c, usual_c, usual_es, film = None, Polynomial([0.0]), 1.0, np.ones(bins.time_s.size)
    if channel == "humidity" and bins.has("temperature"):
        read = bins.bead_c
        read_c = bins.bead_within_c
        usual_c = Polynomial.fit(bins.altitude_m, read, PROFILE_DEGREE)
        usual_es = float(saturation_pressure_hpa(read.mean()))
        film = saturation_pressure_hpa(usual_c(bins.altitude_m)) / saturation_pressure_hpa(read)
    film = film[rows]
    value = bins.values[channel][rows] / film
    mean, unit = float(value.mean()), max(float(value.std()), 1e-6)
    altitude, time = bins.altitude_m[rows], bins.time_s[rows]
    low, high = float(bins.within_altitudes.min()), float(bins.within_altitudes.max())
    longest = int(np.diff([*bins.begins, bins.time_s.size]).max())  # of the sensors that are side by side
    knots = np.linspace(low, high, max(int(KNOTS_PER_BIN * longest), 8))
    layer = LAYER_SHARE * (high - low)
    since = (time - time[0]) / max(float(np.ptp(time)), 1e-9)
    meanwhile = np.minimum(since[:, None], since[None, :])  # the covariance of what grows as a random walk
    apart_m = np.abs(altitude[:, None] - altitude[None, :])
    apart_s = np.abs(time[:, None] - time[None, :])
    alike = _smooth if bins.sensors else _rough
    eddies = alike(apart_m / min(EDDY_M, layer)) * alike(apart_s / EDDY_S)
    changes = np.stack([meanwhile, meanwhile * alike(apart_m / layer), eddies])
    changes *= np.outer(film, film)
    changes, met = _met_by_several(bins, rows, changes)
    sizes = _with_own(2.0 * np.log(list(USUAL.values())), bins)
    usual = np.r_[sizes, np.zeros(MOVES)]
    both = np.sqrt(0.5)  # a layer moves by its own move and by that of all of the air, equal parts of one variance
    spread = np.r_[np.full(sizes.size, SIZE_SPREAD), np.full(MOVES, both)]
    moved_m = min(float(np.hypot(MOVED_M, MOVED_M_PER_H * bins.minutes / 60.0)), layer)
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
        changes,
        usual,
        spread,
        moved_m,
        met,
    )


def _rough(apart: Array) -> Array:
    """Correlation of what is so many lengths apart."""
    return np.exp(-apart)


def _smooth(apart: Array) -> Array:
    """The same as sensors read it, which lag: without jumps (Matérn's of order 3/2).

    One sensor's noise hides whether what it reads is smooth. Two that read the same know their noise, and rough air
    would be refuted: what changed would then be taken for a law of both.
    """
    return (1.0 + 2.0 * apart) * np.exp(-2.0 * apart)


def _with_own(sizes: Array, bins: FlightBins) -> Array:
    """Sizes with that of each sensor's own change before the noise's, where several are side by side: as eddies'."""
    return np.r_[sizes[:-1], sizes[-2], sizes[-1]] if bins.sensors else sizes


def sizes_of_one(own: Array) -> Array:
    """One sensor's numbers of a flight, of those of several side by side: its own change is eddies to it."""
    eddies = SIZES.index("eddies")
    return np.r_[own[:eddies], np.logaddexp(own[eddies], own[eddies + 1]), own[eddies + 2 :]]


def _met_by_several(bins: FlightBins, rows: NDArray[np.int64], changes: Array) -> tuple[Array, tuple[Array, ...]]:
    """Changes (j, m, m), and columns (n, q) of what changes in layers and in eddies, where several sensors meet it.

    What one sensor reads of a change is free, since nobody knows how rough the air is. What two sensors of unlike lags
    read of one change tells their lags (`SensorModel.beside_fastest`), so that it is no covariance of readings any
    more. In its place each sensor has a change of its own: what no law holds of one of two sensors would else be taken
    for a law of both. It is a function of time, since what a sensor does by itself knows no altitude. Of one sensor
    alone, nothing differs.
    """
    if not bins.sensors:
        return changes, ()
    found = []
    for covariance in changes[1:]:
        sizes, vectors = np.linalg.eigh(covariance)
        kept = sizes > ROUNDED * sizes[-1]
        columns = np.zeros((bins.time_s.size, int(kept.sum())))
        columns[rows] = vectors[:, kept] * np.sqrt(sizes[kept])
        found.append(columns)
    sensor = np.searchsorted(bins.begins, rows, side="right")
    time = bins.time_s[rows]
    own = _smooth(np.abs(time[:, None] - time) / OWN_S) * (sensor[:, None] == sensor)
    changes[1:] = 0.0
    return np.concatenate([changes, own[None]]), tuple(found)


def _around_m(knots: Array) -> float:
    """How far a profile goes on as steep [m], of knots over a flight's altitudes."""
    over = float(np.ptp(knots))
    return max(AROUND_SHARE * over, min(AROUND_M, LAYER_SHARE * over))


def _steepness(bins: FlightBins, rows: NDArray[np.int64], value: Array, knots: Array) -> Array:
    """How steep the profile is around each step (k - 1,), squared, over what is usual along the flight."""
    altitude, reach = bins.altitude_m[rows], 0.5 * _around_m(knots)
    squares, weights = np.zeros(knots.size - 1), np.zeros(knots.size - 1)
    middle = 0.5 * (knots[1:] + knots[:-1])
    for one in bins.passes:
        mine = (rows >= one.first) & (rows <= one.last)
        rise, step = np.diff(altitude[mine]), np.diff(value[mine])
        at = 0.5 * (altitude[mine][1:] + altitude[mine][:-1])
        near = np.exp(-0.5 * ((middle[:, None] - at) / reach) ** 2)
        squares += near @ step**2
        weights += near @ np.abs(rise)
    steep = squares / np.maximum(weights, 1e-9)
    usual = float(steep.mean())
    return np.maximum(steep / usual, LEAST_STEEPNESS) if usual > 0 else np.ones(steep.size)


@dataclass(frozen=True)
class MetAir:
    """What a sensor meets along a flight, before any air is known.

    Attributes
    ----------
    altitude : ndarray (n, SUB_SAMPLES)
        Of the sensor, before layers move [m].
    taken_up : ndarray (n, SUB_SAMPLES)
        What it takes up over what the shared air is.
    given_back : ndarray (n,)
        What it reads over what it has taken up.
    offset : ndarray (m,)
        What the readings are off by, over the channel's unit: by offsets of the air, and by how the film meets its
        mean.
    """

    altitude: Array
    taken_up: Array
    given_back: Array
    offset: Array


@dataclass(frozen=True)
class SensorModel:
    """A model of the sensor on one channel: laws, and the values of their parameters."""

    laws: tuple[Law, ...]
    values: Values

    def seen_air(self, data: FlightChannelData, moves: Array) -> Array:
        """What the sensor reads of the shared air's columns (m, 2 + k), layers moved (MOVES,)."""
        met = self.meets(data)
        altitude = moved_track(data, met.altitude, moves)[0]
        return self.seen(data, met.taken_up[..., None] * _columns(data.knots, altitude))

    @property
    def shift_s(self) -> float:
        """By how much the track's time is behind the sensor's."""
        return sum(law.shift_s(self.values) for law in self.laws if law.shift_s is not None)

    def lags(self, data: FlightChannelData) -> tuple[tuple[Array, Array], ...]:
        """Shares and time constants of the response, over bins."""
        return next((law.lags(self.values, data.bins) for law in self.laws if law.lags is not None), ())

    def beside_fastest(self, data: FlightChannelData) -> tuple[tuple[Array, Array], ...]:
        """Responses to what the fastest of several sensors reads of a change: (1 + tau0 s) H(s), tau0 its lag.

        Of a path 1 / (1 + tau s) that is tau0 / tau at once, and the rest of it late. The fastest reads the change as
        one sensor alone does: how smooth its readings are says nothing of its lag.
        """
        lags, begins = self.lags(data), data.bins.begins
        if not lags:
            return ()
        share, tau = lags[0]
        fastest = min(float(tau[first]) if share[first] > 0.0 else 0.0 for first in begins)
        return tuple((share * (1.0 - fastest / tau), tau) for share, tau in lags)

    def seen(self, data: FlightChannelData, air: Array) -> Array:
        """What it reads of columns of what it takes up, given within bins, (n, SUB_SAMPLES, q): (m, q)."""
        return (self.meets(data).given_back[:, None] * response(self.lags(data), data.bins, air))[data.rows]

    def meets(self, data: FlightChannelData) -> MetAir:
        """What it meets along a flight."""
        bins = data.bins
        altitude = np.interp(bins.within_s + self.shift_s, bins.track_s, bins.track_m)
        taken_up, given_back = np.ones(altitude.shape), np.ones(altitude.shape[0])
        if data.read_c is not None:
            warmer = sum((law.warmer(self.values, bins) for law in self.laws if law.warmer is not None), 0.0)
            film = saturation_pressure_hpa(data.read_c + warmer) / data.usual_es
            usual = saturation_pressure_hpa(data.usual_c(altitude)) / data.usual_es
            activity = sum((law.activity(self.values, bins) for law in self.laws if law.activity is not None), 0.0)
            taken_up = usual * film**-activity
            given_back = np.asarray((film ** (activity - 1.0)).mean(axis=1))
        own = [law for law in self.laws if law.offset is not None and law.channel == data.channel]
        late = np.zeros(altitude.shape)
        for law in own:
            assert law.offset is not None
            late += law.offset(self.values, bins)
        both = np.stack([taken_up, late], axis=-1)
        mean, off = response(self.lags(data), bins, both)[data.rows].T  # offsets are met as late as the air
        offset = (data.mean * given_back[data.rows] * mean - data.level + off) / data.unit
        return MetAir(altitude, taken_up, given_back, offset)

    def offset(self, data: FlightChannelData) -> Array:
        """What the readings are off by (m,), over the channel's unit."""
        return self.meets(data).offset

    def settling(self, data: FlightChannelData) -> Array:
        """What the sensor still shows of what it was before the first bin (m,)."""
        before = np.zeros((*data.bins.within_s.shape, 1))
        before[0, 0] = 1.0
        return self.seen(data, before)[:, 0]


def moved_track(data: FlightChannelData, altitude: Array, moves: Array) -> tuple[Array, Array]:
    """Altitudes within bins (n, SUB_SAMPLES) once layers have moved, and their slopes over moves, (MOVES, ...) [m]."""
    bins, knots = data.bins, data.knots
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
    """The log density of a flight's channel [nats], under a sensor and the flight's own numbers.

    Attributes
    ----------
    data : FlightChannelData
    sensor : SensorModel
    own : ndarray (s,)
        The flight's own numbers: sizes, then moves.
    value : float
    lower : ndarray (m, m)
        The readings' covariance S as L L' (lower triangle).
    solved : ndarray (m,)
        S^-1 r, r the readings less their offset.
    met : MetAir
    air : ndarray (n, SUB_SAMPLES, q)
        Columns of the shared air within bins, and behind them what it was before the first of each sensor.
    altitude, track_slopes : ndarray (n, SUB_SAMPLES), (MOVES, n, SUB_SAMPLES)
        Of the sensor once layers have moved, and its slopes over moves [m].
    seen, scaled : ndarray (m, q)
        What the sensor reads of the columns and of changes that several sensors meet, and that times their variances.
    """

    data: FlightChannelData
    sensor: SensorModel
    own: Array
    value: float
    lower: Array
    solved: Array
    met: MetAir
    air: Array
    altitude: Array
    track_slopes: Array
    seen: Array
    scaled: Array

    @property
    def misfit(self) -> float:
        """Mean square of what the readings are off by, over what the covariance expects."""
        return float((self.data.reading - self.met.offset) @ self.solved) / self.solved.size


def begun(data: FlightChannelData, misfit: float = 1.0) -> Array:
    """The flight's own numbers where a fit begins: what air that stays cannot explain is then the change's, and larger
    by a `misfit` that is known."""
    sizes = _with_own(2.0 * np.log(list(BEGIN.values())), data.bins)
    sizes[WALKS:] += np.log(max(misfit, 1.0))
    return np.r_[sizes, np.zeros(MOVES)]


def density(data: FlightChannelData, sensor: SensorModel, own: Array) -> Density:
    """The density under a sensor and a flight's own numbers."""
    sizes = own[:-MOVES]
    met = sensor.meets(data)
    altitude, track_slopes = moved_track(data, met.altitude, own[-MOVES:])
    begins = data.bins.begins
    air = np.empty((*altitude.shape, data.air_columns + len(begins)))
    np.multiply(met.taken_up[..., None], _columns(data.knots, altitude), out=air[..., : data.air_columns])
    air[..., data.air_columns :] = 0.0
    air[begins, 0, range(data.air_columns, air.shape[-1])] = UNKNOWN
    seen = _seen_all(data, sensor, met, air)
    residual = data.reading - met.offset
    scaled = data.weighed(seen, sizes)
    count = residual.size
    covariance = scaled @ seen.T
    covariance += (np.exp(sizes[WALKS:-1]) @ data.changes.reshape(len(data.changes), -1)).reshape(count, count)
    covariance.flat[:: count + 1] += np.exp(sizes[-1])
    # (symmetric: its transpose is what LAPACK takes without a copy)
    lower, failed = lapack.dpotrf(covariance.T, lower=1, clean=0, overwrite_a=1)
    value, solved = -np.inf, residual
    if not failed:
        solved = lapack.dpotrs(lower, residual, lower=1)[0]
        value = -0.5 * float(residual @ solved) - float(np.log(lower.diagonal()).sum()) - count * np.log(data.unit)
    return Density(data, sensor, own, value, lower, solved, met, air, altitude, track_slopes, seen, scaled)


def _seen(data: FlightChannelData, sensor: SensorModel, met: MetAir, air: Array) -> Array:
    return (met.given_back[:, None] * response(sensor.lags(data), data.bins, air))[data.rows]


def _seen_all(data: FlightChannelData, sensor: SensorModel, met: MetAir, air: Array) -> Array:
    """What it reads of the air's columns, and behind them of the changes that several sensors meet (m, q)."""
    seen = _seen(data, sensor, met, air)
    if not data.met:
        return seen
    changes = np.hstack(data.met)[:, None]  # held over whole bins
    return np.hstack([seen, response(sensor.beside_fastest(data), data.bins, changes)[data.rows]])


def slopes(found: Density, parameters: tuple[tuple[str, float, bool], ...] = ()) -> tuple[Array, Array]:
    """Slope (p + s,) and information (p + s, p + s) of a density over `parameters` (name, step, log) and the flight's
    own numbers behind them; without what is known before any reading.

    Of each number j: S_j v and tr(S^-1 S_j), which give the slope, v = S^-1 r, and how the readings would move, which
    gives the information. Of the sensor's numbers and the moves of layers that is how readings of the air move that
    these readings leave likeliest: the line's ends are unknown, and with air as steep as they may be before any reading
    (average information of S alone) a lag would be known many times too well.
    """
    data, sensor, own, v, seen, scaled = found.data, found.sensor, found.own, found.solved, found.seen, found.scaled
    first, sizes = len(parameters), own[:-MOVES]
    every, of_sizes, last = first + own.size, slice(first, first + sizes.size), slice(first + sizes.size, None)
    inverse = lapack.dpotri(found.lower, lower=1)[0]  # its lower triangle
    solved_seen, drawn = blas.dsymm(1.0, inverse, seen, lower=1), scaled.T @ v
    solved = data.weighed(solved_seen, sizes)
    moved, traces, expected = np.zeros((every, v.size)), np.zeros(every), np.zeros((every, v.size))
    steps, solved_steps = (columns[:, 2 : data.air_columns] for columns in (seen, solved_seen))
    moved[of_sizes] = np.vstack([data.walks @ (steps.T @ v) @ steps.T, data.changes @ v, v])
    traces[of_sizes] = np.r_[
        data.walks.reshape(WALKS, -1) @ (steps.T @ solved_steps).ravel(),
        data.upper_changes @ inverse.T.ravel(),
        inverse.trace(),
    ]
    moved[of_sizes] *= np.exp(sizes[:, None])
    traces[of_sizes] *= np.exp(sizes)
    for j, place in data.of_met:
        moved[first + j] = scaled[:, place] @ (seen[:, place].T @ v)
        traces[first + j] = np.vdot(solved[:, place], seen[:, place])
    expected[of_sizes] = np.sqrt(0.5) * moved[of_sizes]
    # What else moves changes the response, or the air that is met: as layers that move do, or as a factor of it.
    pulled = np.zeros(every)
    metres = np.zeros((every, *found.altitude.shape))
    metres[last] = found.track_slopes
    taken, given = np.zeros_like(metres), np.zeros((every, found.altitude.shape[0]))
    of_air = (
        np.r_[
            [name.removesuffix(SECOND) not in OF_RESPONSE for name, _, _ in parameters],
            np.zeros(sizes.size),
            np.ones(MOVES),
        ]
        > 0
    )
    for i, (name, step, log) in enumerate(parameters):
        at = sensor.values[name]
        ahead = SensorModel(sensor.laws, {**sensor.values, name: at * np.exp(step) if log else at + step})
        met = ahead.meets(data)
        expected[i] = (met.offset - found.met.offset) / step
        pulled[i] = expected[i] @ v
        if not of_air[i]:
            change = (_seen_all(data, ahead, met, found.air) - seen) / step
            through = change @ drawn
            expected[i] += through
            moved[i] = through + scaled @ (change.T @ v)
            traces[i] = 2.0 * np.vdot(solved, change)
            continue
        if ahead.shift_s != sensor.shift_s:
            metres[i] = (moved_track(data, met.altitude, own[-MOVES:])[0] - found.altitude) / step
        if data.read_c is not None:
            taken[i] = np.log(met.taken_up / found.met.taken_up) / step
            given[i] = np.log(met.given_back / found.met.given_back) / step
    through, tr, moved_by = _of_air(found, metres[of_air], taken[of_air], given[of_air], solved, drawn)
    expected[of_air] += through
    moved[of_air], traces[of_air] = moved_by, tr
    return 0.5 * (moved @ v - traces) + pulled, expected @ blas.dsymm(1.0, inverse, expected.T, lower=1)


def _of_air(
    found: Density, metres: Array, taken: Array, given: Array, solved: Array, drawn: Array
) -> tuple[Array, Array, Array]:
    """How the readings move (r, m), tr(S^-1 S_j) (r,) and S_j v (r, m), where the air that is met moves.

    By metres of the track and by factors of what is taken up (r, n, SUB_SAMPLES), and of what is given back (r, n).
    Metres change two columns of the air, where the sensor is: the line's, and the step's in which it is.
    """
    data, sensor, v, own, of_air = found.data, found.sensor, found.solved, found.data.air_columns, found.air.shape[-1]
    seen = found.seen[:, :of_air]
    columns_of = found.air[..., :own]
    knots, rows = data.knots, data.rows
    last = knots.size - 1.0
    place = (found.altitude - knots[0]) / (knots[1] - knots[0])
    step = np.clip(place, 0.0, last - 1.0).astype(int)
    inside = found.met.taken_up * ((place > 0.0) & (place < last)) / (knots[1] - knots[0])
    line, ramp = UNKNOWN * 2.0 / last * inside, inside / np.sqrt(last)
    every = np.zeros((data.bins.time_s.size, solved.shape[1] + 1))
    every[rows] = np.column_stack([solved, v])
    every *= found.met.given_back[:, None]
    back = drawn_back(sensor.lags(data), data.bins, every)
    of_metres = line * back[..., 1] + ramp * np.take_along_axis(back, step[..., None] + 2, axis=-1)[..., 0]
    onto = metres * (line * drawn[1] + ramp * drawn[step + 2])
    traces = metres.reshape(len(metres), -1) @ of_metres.ravel()
    of_v = metres * back[..., -1]
    columns = np.zeros((len(metres), drawn.size))
    columns[:, 1] = of_v.reshape(len(metres), -1) @ line.ravel()
    for i, one in enumerate(of_v):
        columns[i, 2:own] = np.bincount(step.ravel(), weights=(one * ramp).ravel(), minlength=knots.size - 1)
    if data.read_c is not None:
        onto += taken * (columns_of @ drawn[:own])
        traces += taken.reshape(len(taken), -1) @ np.einsum("ikq,ikq->ik", back[..., :own], columns_of).ravel()
        traces += given[:, rows] @ np.einsum("iq,iq->i", solved[:, :of_air], seen)
        of_v = (taken * back[..., -1]).reshape(len(taken), -1)
        columns[:, :own] += of_v @ columns_of.reshape(of_v.shape[1], -1)
        columns[:, :of_air] += (given[:, rows] * v) @ seen
    through = _seen(data, sensor, found.met, np.moveaxis(onto, 0, -1)).T + given[:, rows] * (seen @ drawn[:of_air])
    return through, 2.0 * traces, through + columns @ found.scaled.T


def air_of(data: FlightChannelData, sensor: SensorModel, own: Array, rows: NDArray[np.int64], at: Array) -> Array:
    """The air at altitudes `at` (q,) that some readings alone leave, over the channel's unit: its expected value."""
    sizes, moves = own[:-MOVES], own[-MOVES:]
    seen = sensor.seen_air(data, moves)[rows]
    scaled = data.weighed(seen, sizes)
    covariance = scaled @ seen.T + np.exp(sizes[-1]) * np.eye(rows.size)
    covariance += np.exp(sizes[-2]) * data.changes[-1][np.ix_(rows, rows)]
    start = sensor.settling(data)[rows]
    covariance += UNKNOWN**2 * np.outer(start, start)
    residual = (data.reading - sensor.offset(data))[rows]
    return np.asarray(_columns(data.knots, at) @ (scaled.T @ np.linalg.solve(covariance, residual)))
