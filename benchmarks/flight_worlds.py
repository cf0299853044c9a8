"""Kinds of flights on which a correction may do harm, and the sensors that fly them: no code of the correction in it.

Bodies are Chebyshev collocations advanced by matrix exponentials; where D follows the temperature, on a clock that
runs with D, on which the film does not change. Air on a grid of 0.01 s; steps fall at any instant between samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

Array = np.ndarray
FINE_S = 0.01
LENGTH_S = 240.0
POINTS = 34  # of the collocation; even, so that none lies at a sphere's centre
BEAD_RATE = 0.46660  # core of a sphere: rate x t98
FILM_RATE = 1.50037  # mean of a film


@dataclass(frozen=True)
class World:
    """One flight: the air on a fine clock, the sensors that fly, and the log that is kept of them.

    `film_t98_s` is a function of the air's temperature; `stated` multiplies the D that the profile states, and
    `stated_relative` is the relative standard uncertainty that it states. `rows` may take rows out or damage them.
    """

    temperature_c: Array
    vapour_hpa: Array
    altitude_m: Array
    period_s: float = 0.1
    step_k: float = 0.01
    step_percent: float = 100 / 16383
    noise: float = 1.0
    film_t98_s: Callable[[Array], Array] = field(default=lambda t: 15.0 * arrhenius(t))
    stated: float = 1.0
    stated_relative: float = 0.01
    ambients_c: tuple[float, ...] = (-10.0, 0.0, 10.0, 20.0, 30.0, 40.0)
    rows: Callable[[dict[str, Array], np.random.Generator], None] | None = None
    # (world, bead and humidity on the fine clock as the profile has them, the film's rate, rng) -> as they are
    sensors: Callable[[World, Array, Array, Array, np.random.Generator], tuple[Array, Array]] | None = None


@dataclass(frozen=True)
class Flown:
    """Columns of the log and of the truth at its rows; `film_rate` and `bead_rate` are the sensors' true rates."""

    log: dict[str, Array]
    truth: dict[str, Array]
    bead_rate: float
    film_rate: Array


def saturation_hpa(temperature_c: Array) -> Array:
    """McRae (1980), in hPa."""
    t = 1.0 - 373.15 / (np.asarray(temperature_c) + 273.15)
    return 1013.25 * np.exp(13.3185 * t - 1.9760 * t**2 - 0.6445 * t**3 - 0.1299 * t**4)


def arrhenius(temperature_c: Array, kelvin: float = 3000.0) -> Array:
    """How much slower than at 20 degC."""
    return np.exp(kelvin * (1.0 / (np.asarray(temperature_c) + 273.15) - 1.0 / 293.15))


def steep(temperature_c: Array) -> Array:
    """t98 of IST's film: 0.6, 5.2, 11 s at 25, 5 and -10 degC are its t63, and it goes on so below."""
    at, t63 = np.array([-45.0, -25.0, -10.0, 5.0, 25.0, 45.0]), np.array([60.0, 25.0, 11.0, 5.2, 0.6, 0.2])
    return 4.685 * np.exp(np.interp(temperature_c, at, np.log(t63)))


def collocation(kind: str) -> tuple[Array, Array, Array]:
    """(A, b, weight): inner points of a film or a sphere in units of its length and rate, and how it is read."""
    n = POINTS - 1
    k = np.arange(n + 1)
    x = np.cos(np.pi * k / n)
    c = np.where((k == 0) | (k == n), 2.0, 1.0) * (-1.0) ** k
    gap = x[:, None] - x[None, :] + np.eye(n + 1)
    d = np.outer(c, 1.0 / c) / gap
    d -= np.diag(d.sum(axis=1))
    operator = d @ d
    if kind == "film":
        moments = np.zeros(n + 1)
        moments[::2] = 2.0 / (1.0 - np.arange(0, n + 1, 2) ** 2)
        weight = np.linalg.solve(np.cos(np.outer(k, np.arccos(x))), moments) / 2.0  # mean over -1..1
    else:
        operator = operator + 2.0 / x[:, None] * d
        near = (-1.0) ** k * np.where((k == 0) | (k == n), 0.5, 1.0) / -x
        weight = near / near.sum()  # barycentric, at the centre
    inner, ends = slice(1, n), [0, n]
    b = operator[inner][:, ends].sum(axis=1)
    return operator[inner, inner], b, np.concatenate([weight[inner], [weight[ends].sum()]])


def driven(kind: str, rate: Array, air: Array) -> Array:
    """Reading on the fine clock of a body whose rate [1/s] may change with time, from rest."""
    a, b, weight = collocation(kind)
    rate = np.broadcast_to(rate, air.shape)
    own = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) * FINE_S
    step = float(np.median(rate)) * FINE_S
    clock = np.arange(0.0, own[-1] + step, step)
    drive = np.interp(clock, own, air)
    size = len(b)
    block = np.zeros((size + 2, size + 2))
    block[:size, :size], block[:size, size], block[size, size + 1] = a * step, b * step, 1.0
    move = expm(block)
    decay, level, slope = move[:size, :size], move[:size, size], move[:size, size + 1]
    # Each mode goes its own way from one step to the next: lfilter, where a loop over the steps takes 50 times as long.
    factor, vectors = np.linalg.eig(decay)
    rest, level, slope = np.linalg.solve(vectors, np.column_stack([np.full(size, drive[0]), level, slope])).T
    out = np.full(clock.size, drive[0])
    reading = np.zeros(clock.size - 1, dtype=complex)
    for one, seen, begun, held, ramped in zip(factor, weight[:-1] @ vectors, rest, level, slope, strict=True):
        fed = drive[:-1] * held + np.diff(drive) * ramped
        reading += seen * lfilter([1.0], [1.0, -one], fed, zi=[one * begun])[0]
    out[1:] = reading.real
    out[1:] += weight[-1] * drive[1:]
    return np.interp(own, clock, out)


def fly(world: World, seed: int) -> Flown:
    """The log of one flight and the truth at its rows; parameters lie about the stated ones as far as is stated."""
    rng = np.random.default_rng([seed, 77])
    time = np.arange(world.temperature_c.size) * FINE_S
    bead_rate = BEAD_RATE / 1.0 * (1.0 + 0.005 * rng.standard_normal())
    film_rate = FILM_RATE / world.film_t98_s(world.temperature_c) * (1.0 + 0.01 * rng.standard_normal())
    bead = driven("sphere", np.array(bead_rate), world.temperature_c)
    film = driven("film", film_rate, world.vapour_hpa)
    humidity = 100.0 * film / saturation_hpa(world.temperature_c)
    if world.sensors is not None:
        bead, humidity = world.sensors(world, bead, humidity, film_rate, rng)
    every = round(world.period_s / FINE_S)
    at = slice(int(rng.integers(every)), None, every)
    count = time[at].size

    def read(values: Array, noise: float, step: float) -> Array:
        return np.round((values[at] + world.noise * noise * rng.standard_normal(count)) / step) * step

    log = {
        "time_s": time[at].copy(),
        "temperature_c": read(bead, 0.02, world.step_k),
        "humidity_percent": read(humidity, 0.06, world.step_percent),
        "altitude_m": world.altitude_m[at].copy(),
    }
    truth = {
        "temperature_c": world.temperature_c[at].copy(),
        "humidity_percent": 100.0 * world.vapour_hpa[at] / saturation_hpa(world.temperature_c[at]),
    }
    if world.rows is not None:
        world.rows(log, rng)
    return Flown(log, truth, bead_rate, film_rate[at])


def clock(length_s: float = LENGTH_S) -> Array:
    """The fine clock."""
    return np.arange(round(length_s / FINE_S)) * FINE_S


def turbulence(rng: np.random.Generator, std: float, count: int) -> Array:
    """Power falls as f^(-5/3)."""
    size = 2 * count
    spectrum = np.fft.rfft(rng.standard_normal(size))
    spectrum[1:] *= np.arange(1, spectrum.size) ** (-5.0 / 6.0)
    spectrum[0] = 0.0
    series = np.fft.irfft(spectrum, size)[:count]
    return std * (series - series.mean()) / series.std()


def through(time: Array, at: list[float], values: list[float], round_s: float = 0.3) -> Array:
    """Straight lines with corners rounded over about `round_s`; steps where two times are equal and it is 0."""
    out = np.interp(time, at, values)
    if not round_s:
        return out
    width = max(int(round_s / FINE_S), 1)
    kernel = np.hanning(2 * width + 1)
    return np.convolve(np.pad(out, width, mode="edge"), kernel / kernel.sum(), mode="valid")


def air(
    rng: np.random.Generator,
    temperature_c: Array,
    humidity_percent: Array | float,
    *,
    at_c: Array | float | None = None,
    k: float = 0.0,
    percent: float = 0.0,
    altitude_m: Array | None = None,
) -> World:
    """Vapour as a relative humidity at the temperature `at_c` (the air's own if none), and turbulence on both."""
    count = temperature_c.size
    own = temperature_c if at_c is None else at_c
    vapour = np.broadcast_to(humidity_percent, count) / 100.0 * saturation_hpa(own)
    eddies = turbulence(rng, 1.0, count) if k or percent else np.zeros(count)
    others = turbulence(rng, 1.0, count) if k or percent else np.zeros(count)
    temperature = temperature_c + k * eddies
    moist = -0.5 * eddies + 0.866 * others
    vapour = vapour * np.maximum(1.0 + percent * moist / np.maximum(np.mean(humidity_percent), 1.0), 0.02)
    vapour = np.minimum(vapour, saturation_hpa(temperature))
    return World(temperature, vapour, np.full(count, 100.0) if altitude_m is None else altitude_m)


def changed(world: World, **settings: object) -> World:
    """The same with other settings."""
    return replace(world, **settings)
