"""What the air may do between samples: turbulence with a -5/3 spectrum on a trend that bends.

air = trend + sum_i u_i: trend an integrated random walk (power f^-4; f^-6, integrated once more, where the air's course
is smooth: waves), u_i Ornstein-Uhlenbeck with variances r_i^(-2/3) at rates r_i a factor apart, which together fall as
f^(-5/3). How strong they are, and which trend it is, a flight says itself (`fit_prior`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from math import factorial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.special import expit, logit

from shockrig.analysis.flight.response import LagResponse, stepped

Array = NDArray[np.float64]
RATES_PER_S = np.array([0.03, 0.5, 8.0])
TREND_STATES = 3  # level, slope, curvature
AIR_STATES = TREND_STATES + RATES_PER_S.size
AIR = np.array([1.0, 0.0, 0.0] + [1.0] * RATES_PER_S.size)  # the air as a sum of its states
OU_VARIANCES = RATES_PER_S ** (-2.0 / 3.0)
# Turbulence goes on where samples and sensor no longer see it: two more rungs of the same ladder, as plain variance.
UNSEEN_VARIANCE = float(np.sum(np.array([128.0, 2048.0]) ** (-2.0 / 3.0)))


@dataclass(frozen=True)
class Passing:
    """Something that reaches the reading and the air alike, without lag: `sigma` (...) [unit], about `rate` [1/s].

    In humidity it is what the air's temperature leaves open: the reading and the corrected value are divided by the
    same saturation pressure, while the film between them never felt it. That is the part of turbulence beyond the
    bead's resolution, so its power is rate^3 w^2 / (w^2 + rate^2)^2: the speed of a critically damped swing. Vapour
    is carried by the same eddies: `coupling` times it is in the air besides, and that share does lag.
    """

    sigma: Array
    rate: float
    coupling: float = 0.0


@dataclass(frozen=True)
class Prior:
    """Strengths, arrays of one shape: `turbulence` [unit], `bend` [unit / s^1.5], `noise` [unit], one sigma each.

    Where the air's course is `smooth`, it is the trend's curvature that walks and not its slope: power f^-6 and not
    f^-4, and `bend` is in unit / s^2.5. Where it may be, `instead` are the strengths under that trend, and `share` is
    how likely it is.
    """

    turbulence: Array
    bend: Array
    noise: Array
    smooth: bool = field(default=False, kw_only=True)
    instead: Prior | None = field(default=None, kw_only=True)
    share: float = field(default=0.0, kw_only=True)

    def each(self, of: Callable[[Array], Array]) -> Prior:
        """The same with a function taken of each strength."""
        return Prior(of(self.turbulence), of(self.bend), of(self.noise), smooth=self.smooth)


def transition(step_s: Array) -> Array:
    """Transition of the air's states over each step, shape (..., 6, 6)."""
    step_s = np.asarray(step_s, dtype=float)
    a = np.zeros((*step_s.shape, AIR_STATES, AIR_STATES))
    a[..., 0, 0] = a[..., 1, 1] = a[..., 2, 2] = 1.0
    a[..., 0, 1] = a[..., 1, 2] = step_s
    a[..., 0, 2] = step_s**2 / 2
    for i, rate in enumerate(RATES_PER_S):
        a[..., TREND_STATES + i, TREND_STATES + i] = np.exp(-rate * step_s)
    return a


def innovation(step_s: Array, prior: Prior) -> Array:
    """Covariance that each step adds to the air's states, shape (..., 6, 6); `prior` broadcasts with `step_s`."""
    step_s = np.asarray(step_s, dtype=float)
    bend, turbulence = prior.bend**2, prior.turbulence**2
    q = np.zeros((*np.broadcast_shapes(step_s.shape, bend.shape), AIR_STATES, AIR_STATES))
    last = 2 if prior.smooth else 1  # the walk's steps are of this derivative
    for i in range(last + 1):
        for j in range(last + 1):
            power = 2 * last - i - j + 1
            of_each = factorial(last - i) * factorial(last - j)
            q[..., i, j] = bend * step_s**power / (power * of_each)
    for i, (rate, variance) in enumerate(zip(RATES_PER_S, OU_VARIANCES, strict=True)):
        q[..., TREND_STATES + i, TREND_STATES + i] = -turbulence * variance * np.expm1(-2 * rate * step_s)
    return q


def spectra(frequency_hz: Array, period_s: float, smooth: bool = False) -> tuple[Array, Array]:
    """One-sided power of sampled turbulence and of the sampled trend at unit strength [1/Hz], shapes of
    `frequency_hz`."""
    z = np.exp(2j * np.pi * frequency_hz * period_s)
    turbulence = np.zeros(np.shape(frequency_hz))
    for rate, variance in zip(RATES_PER_S, OU_VARIANCES, strict=True):
        decay = np.exp(-rate * period_s)
        turbulence += variance * (1 - decay**2) / np.abs(z - decay) ** 2
    bend = period_s**3 * (2 + z.real) / 3 / np.abs(z - 1) ** 4
    if smooth:
        bend = period_s**5 * (33 + 26 * z.real + (z**2).real) / 60 / np.abs(z - 1) ** 6
    return 2 * period_s * turbulence, 2 * period_s * bend


def passing_spectrum(passing: Passing, frequency_hz: Array, period_s: float) -> Array:
    """One-sided power of a sampled Passing, shape (..., f); what lies beyond half the sampling rate folds back."""
    total = np.zeros(np.shape(frequency_hz))
    for fold in range(5):
        for f in {0: (frequency_hz,)}.get(fold, (fold / period_s - frequency_hz, fold / period_s + frequency_hz)):
            w = (2 * np.pi * f) ** 2
            total += 8 * passing.rate * w / (w + passing.rate**2) ** 2
    return passing.sigma[..., None] ** 2 * total


def passing_step(passing: Passing, step_s: Array) -> tuple[Array, Array]:
    """Transition of (place, speed) over each step and the covariance it adds, (..., 2, 2); the speed is what passes."""
    r, x = passing.rate, passing.rate * np.asarray(step_s, dtype=float)
    phi = np.empty((*x.shape, 2, 2))
    phi[..., 0, 0], phi[..., 0, 1] = 1 + x, x / r
    phi[..., 1, 0], phi[..., 1, 1] = -r * x, 1 - x
    phi *= np.exp(-x)[..., None, None]
    rest = np.diag([1 / r**2, 1.0])
    return phi, passing.sigma[..., None, None] ** 2 * (rest - phi @ rest @ phi.swapaxes(-1, -2))


def gain_squared(response: LagResponse, frequency_hz: Array, period_s: float) -> Array:
    """|H|^2 from the sampled air, straight between samples, to the reading: (n, f) for n instants."""
    z = np.exp(2j * np.pi * frequency_hz * period_s)
    step = stepped(response.rate, np.array(period_s), response.cap, response.inside)
    driven = step.old[..., None] + step.new[..., None] * z
    if count := len(response.cap):
        outer = driven[:, :count] / (z - step.decay[:, :count, None])
        driven[:, response.within] += np.einsum("nmj,njf->nmf", step.fed, outer)
    h = np.einsum("nk,nkf->nf", response.weight, driven / (z - step.decay[..., None]))
    return np.abs(h) ** 2


# How strong a flight's trend and turbulence are, from its own readings: Whittle's likelihood of tapered periodograms.
#
# Strengths are those of segments that overlap by half: most of them are alike, fronts are not.

SHRINKAGE_LN = 0.25  # ln of how far one segment's strengths lie from the typical one's
GRID_STEP = 0.3  # of ln strength
LOUDER_STEP = 0.15  # of ln noise, in which a segment's is looked for above the flight's
COARSER_FACTOR = 4  # times: steps that a segment's likelihood is first looked for at
UNLIKELY_NATS = (
    100.0  # of log-likelihood: more than lies between one such point and what is best beside it, and what counts
)
SURELY_SMOOTH = 10.0  # of log-likelihood: what makes the air's course a smooth one (waves) beyond doubt
SMOOTH_SHARE = 0.1  # of flights that are as smooth, before they are looked at
TINY_POWER = 1e-300
NEWTON_DAMPING, MOST_STEPS = 1e-3, 100
LARGEST_MOVE, SETTLED = 2.0, 1e-3  # of ln strength
LITTLE_NATS = 1e-4  # of log-likelihood
FAINT_SHARE = 1e-3  # times the noise's power: nobody sees that
WAVES = np.arange(0.5, 6.1, 0.125)  # cycles in a segment that a wave is looked for at
BINS_PER_OCTAVE = 4  # of frequencies, whose spectra fall as powers
SHORTEST_S = 4.0  # of what swings again and again in the air, or by what the sun does once in a circle
OUT_OF_BINS = 12  # to either side, that say what a spectrum is beside a line
LINE_BINS = 3  # that a line takes of them
TOLD_LOG_ODDS = 3.0  # one in twenty
HANN_DEPENDENCE = 1.5  # a likelihood of tapered ordinates counts each as so much less than one


def seen(
    response: LagResponse, frequency_hz: Array, period_s: float, parts: int = 1, smooth: bool = False
) -> tuple[Array, Array]:
    """One-sided power (n, f) of the readings of turbulence and of the trend at unit strength, n instants.

    The air is straight over each of the `parts` of a period; what is faster than the readings folds back into them.
    """
    turbulence, bend = np.zeros((2, len(response.rate), np.size(frequency_hz)))
    for fold in range(parts):
        at = frequency_hz + fold / period_s
        gain = gain_squared(response, at, period_s / parts)
        one, other = spectra(at, period_s / parts, smooth)
        turbulence, bend = turbulence + gain * one, bend + gain * other
    return turbulence, bend


def fit_prior(
    reading: Array,
    response: LagResponse,
    period_s: float,
    noise: float,
    passing: Passing | None = None,
    *,
    spread: float,
    parts: int = 1,
) -> Prior:
    """Strengths of the typical stretch of a flight: Whittle's likelihood of the median over segments of their power.

    Parameters
    ----------
    reading : (s, n)
        Segments of readings, gaps bridged.
    response : Response
        With a row for each segment.
    noise : float
        The noise floor expected, known within a factor exp(`spread`).
    passing : Passing, optional
        With `sigma` for each segment.
    parts : int
        Into how many straight pieces the air between two readings is cut.
    """
    frequency, power, weight = _periodograms(reading, period_s)
    white = 2 * period_s
    known = np.zeros((1, frequency.size)) if passing is None else passing_spectrum(passing, frequency, period_s)
    # one front does not speak for the whole flight; the median of a mean of squares lies below its mean
    several = len(power) >= 3
    power, known = _usual(power, several), _usual(known, several)
    if several:
        power = power / (1 - 1 / (9 * _independent(weight))) ** 3
        weight = weight * len(reading) / 2
    found = []
    for smooth in (False, True):
        shapes = [_usual(s, several) for s in seen(response, frequency, period_s, parts, smooth)]
        found.append(_most_likely(power, known, np.stack(shapes), white, weight, noise, spread))
    (rough_cost, rough), (smooth_cost, smooth_strengths) = found
    as_smooth = Prior(*np.exp(smooth_strengths), smooth=True)
    if smooth_cost < rough_cost - SURELY_SMOOTH:
        return as_smooth
    share = float(expit(logit(SMOOTH_SHARE) + rough_cost - smooth_cost))
    return Prior(*np.exp(rough), instead=as_smooth, share=share)


def _usual(segments: Array, several: bool) -> Array:
    """The median over segments (s, f), as one of them."""
    return np.median(segments, axis=0, keepdims=True) if several else segments


def _most_likely(
    power: Array, known: Array, shapes: Array, white: float, weight: Array, noise: float, spread: float
) -> tuple[float, Array]:
    """Minus the log-likelihood of the power (s, f), and ln of the strengths of turbulence, trend and noise there."""
    low = _weakest(shapes[0], shapes[1], noise**2 * white)
    mean_power = max(np.average(power, axis=1, weights=weight).mean(), FAINT_SHARE * noise**2 * white)
    high = [0.5 * np.log(mean_power / np.median(s)) + 3.0 for s in shapes]
    every = np.concatenate([shapes, np.full((1, *shapes.shape[1:]), white)])
    expected = np.log(noise)
    least = np.array([*low, expected - 2.0])
    most = np.array([*(max(m, at_least + 1) for at_least, m in zip(low, high, strict=True)), expected + 2.0])

    def cost(p: Array) -> tuple[Array, Array, Array]:
        """Of points (t, 3), with its slope (t, 3) and expected curvature (t, 3, 3)."""
        each = np.exp(2 * p)[..., None, None] * every
        model = each.sum(axis=1) + known
        ratio = power / model
        value = np.sum(weight * (np.log(model) + ratio), axis=(1, 2))
        scaled = 2.0 * each / model[:, None]
        slope = np.einsum("f,tsf,tisf->ti", weight, 1.0 - ratio, scaled)
        curvature = np.einsum("f,tisf,tjsf->tij", weight, scaled, scaled)
        off = (p[:, 2] - expected) / spread
        slope[:, 2] += off / spread
        curvature[:, 2, 2] += spread**-2.0
        return value + 0.5 * off**2, slope, curvature

    starts = [(t, b, 0.5) for t in (0.1, 0.7) for b in (0.1, 0.5, 0.8)]
    lowest, found = _scored(cost, least + np.array(starts) * (most - least), least, most)
    best = int(np.argmin(lowest))
    return float(lowest[best]), found[best]


def _scored(
    cost: Callable[[Array], tuple[Array, Array, Array]], point: Array, least: Array, most: Array
) -> tuple[Array, Array]:
    """Minima (t,) of a cost within bounds, and where (t, i), from several starts side by side: Fisher scoring, damped
    (Levenberg and Marquardt) where a step goes wrong.

    Of a few numbers this takes a twentieth of a library's time, and waits for no thread.
    """
    value, slope, curvature = cost(point)
    damping = np.full(len(point), NEWTON_DAMPING)
    for _ in range(MOST_STEPS):
        held = ((point <= least) & (slope > 0)) | ((point >= most) & (slope < 0))
        free = ~held[:, :, None] & ~held[:, None, :]
        size = np.einsum("tii->ti", curvature)
        floor = 1e-9 * size.max(axis=1, keepdims=True)
        matrix = np.where(free, curvature, 0.0)
        matrix += np.eye(point.shape[1]) * np.where(held, 1.0, damping[:, None] * size + floor)[:, None]
        step = -np.linalg.solve(matrix, np.where(held, 0.0, slope)[..., None])[..., 0]
        new = np.clip(point + np.clip(step, -LARGEST_MOVE, LARGEST_MOVE), least, most)
        new_value, new_slope, new_curvature = cost(new)
        better = new_value < value
        little = value - new_value < LITTLE_NATS
        moved = np.abs(new - point).max(axis=1)
        point = np.where(better[:, None], new, point)
        slope = np.where(better[:, None], new_slope, slope)
        curvature = np.where(better[:, None, None], new_curvature, curvature)
        value = np.where(better, new_value, value)
        damping = np.where(better, damping / 5.0, np.maximum(damping, 1e-6) * 5.0)
        if np.all(np.where(better, little, damping > 1e6) | (moved < SETTLED)):
            break
    return value, point


def fit_windows(
    reading: Array,
    response: LagResponse,
    period_s: float,
    common: Prior,
    passing: Passing | None = None,
    parts: int = 1,
    *,
    spread: float,
) -> Prior:
    """Strengths of each segment (s, n), most of which are alike, fronts are not; the noise is the flight's or louder.

    A segment's is known within a factor exp(`spread`) of the flight's. What is louder than that at frequencies which
    the lag takes away would else be air, of as many times the strength as the lag takes of it.

    ln strength lies about the typical one as Cauchy's distribution of width `SHRINKAGE_LN`. Of the typical bend the
    logarithm may be anything, of the typical turbulence the strength itself: no air is still, and where readings cannot
    tell a bending trend from weak turbulence, it is turbulence as well. Both by Whittle's likelihood on a grid, and the
    mean of the strength's square over all that they may be: a calm segment alone cannot tell, all of them together can.
    """
    frequency, power, weight = _periodograms(reading, period_s)
    turbulence, bend = seen(response, frequency, period_s, parts, common.smooth)
    white = 2 * period_s * float(common.noise) ** 2
    known, low = np.full((1, 1), white), _weakest(turbulence, bend, white)
    if passing is not None:
        known = known + passing_spectrum(passing, frequency, period_s)
    grids = []
    for shape, least in zip((turbulence, bend), low, strict=True):
        most = 0.5 * float(np.log((np.maximum(power, FAINT_SHARE * known) / shape).max(axis=1).max())) + GRID_STEP
        grids.append(np.arange(least, max(most, least + 2.0) + GRID_STEP, GRID_STEP))
    strengths = [np.exp(2 * grid) for grid in grids]
    # in units of the noise, single precision has digits to spare, and its range as well where both are near one
    shapes, squares, weight = [], [], weight.astype(np.float32)
    for shape, strength in zip((turbulence / known, bend / known), strengths, strict=True):
        size = 2.0 ** np.floor(np.log2(shape.max()))
        shapes.append((shape / size).astype(np.float32))
        squares.append((strength * size).astype(np.float32))
    power = (power / known).astype(np.float32)

    def cost(k: int, rows: slice, columns: slice, ln_louder: float) -> NDArray[np.float32]:
        model = squares[0][rows, None, None] * shapes[0][k] + squares[1][columns, None] * shapes[1][k]
        model += np.float32(np.exp(2.0 * ln_louder))
        ratio = power[k] / model
        ratio += np.log(model, out=model)
        return ratio @ weight

    likely = np.zeros((len(reading), grids[0].size, grids[1].size), dtype=np.float32)
    every = slice(None, None, COARSER_FACTOR)
    louder = np.zeros(len(reading))
    for k in range(len(reading)):
        least = np.inf
        for step in count():
            ln_factor = LOUDER_STEP * step
            tried = cost(k, every, every, ln_factor)
            about, beside = (_around(tried.min(axis=1 - i) == tried.min(), grids[i].size) for i in (0, 1))
            lowest = float(cost(k, about, beside, ln_factor).min()) + 0.5 * (ln_factor / spread) ** 2
            if lowest >= least:
                break
            coarse, least, louder[k] = tried, lowest, ln_factor
        near = coarse < coarse.min() + UNLIKELY_NATS
        where = _around(near.any(axis=1), grids[0].size), _around(near.any(axis=0), grids[1].size)
        fine = cost(k, *where, louder[k])
        likely[k][where] = np.exp(fine.min() - fine)
    prior = [1.0 / (1.0 + ((grid[:, None] - grid) / SHRINKAGE_LN) ** 2) for grid in grids]
    prior = [(k / k.sum(axis=1, keepdims=True)).astype(np.float32) for k in prior]
    told = np.log((prior[0] @ likely @ prior[1].T).astype(float) + TINY_POWER)
    # segments overlap by half
    typical = 0.5 * told.sum(axis=0) + grids[0][:, None]
    others = typical - 0.5 * told
    others = np.exp(others - others.max(axis=(1, 2), keepdims=True))
    share = likely * (prior[0].T @ others.astype(np.float32) @ prior[1])
    share /= share.sum(axis=(1, 2), keepdims=True)
    turbulent, bent = np.sqrt(share.sum(axis=2) @ strengths[0]), np.sqrt(share.sum(axis=1) @ strengths[1])
    if common.instead is not None:
        # a trend that falls less steeply than the air's takes the part of its turbulence
        other = fit_windows(reading, response, period_s, common.instead, passing, parts, spread=spread).turbulence
        turbulent = np.sqrt((1.0 - common.share) * turbulent**2 + common.share * other**2)
    return Prior(turbulent, bent, common.noise * np.exp(louder), smooth=common.smooth)


def _around(near: NDArray[np.bool_], size: int) -> slice:
    """Points of a grid of `size` about those of the coarser one that are `near` the best."""
    rows = np.flatnonzero(near) * COARSER_FACTOR
    return slice(max(int(rows[0]) - COARSER_FACTOR, 0), min(int(rows[-1]) + COARSER_FACTOR + 1, size))


def without_wave(reading: Array) -> Array:
    """Segments of readings (s, n) without their line and, beside it, the one sine with its overtone that explains most
    of each (vapour is humidity times what goes with temperature, and both swing)."""
    place = np.linspace(-1.0, 1.0, reading.shape[1])
    left, least = reading, np.full(len(reading), np.inf)
    for cycles in WAVES:
        wave = np.exp(1j * np.pi * cycles * place)
        twice = wave**2
        columns = np.stack([np.ones(place.size), place, wave.real, wave.imag, twice.real, twice.imag], axis=1)
        rest = reading - reading @ np.linalg.pinv(columns).T @ columns.T
        power = (rest**2).sum(axis=1)
        left = np.where((power < least)[:, None], rest, left)
        least = np.minimum(power, least)
    return left


def _independent(weight: Array) -> Array:
    """Independent ordinates that a bin's mean is worth; neighbours under a Hann taper correlate by 4/9, the next by
    1/36."""
    count = HANN_DEPENDENCE * weight
    return count**2 / (count + 2 * (count - 1) * 4 / 9 + 2 * np.maximum(count - 2, 0.0) / 36)


def _weakest(turbulence: Array, bend: Array, white: float) -> tuple[float, float]:
    """Logs of strengths so weak that their power stays a thousand times below the noise at every frequency."""
    first, second = (0.5 * float(np.log(FAINT_SHARE * white / s.max())) for s in (turbulence, bend))
    return first, second


def _without_lines(power: Array, lasts_s: float) -> Array:
    """Power (s, f) of stretches, with what lies beside it in place of lines that are faster than `SHORTEST_S`: the air
    swings at no single frequency so fast, but a mast does, or the mains."""
    bins = np.arange(max(int(lasts_s / SHORTEST_S), 1), power.shape[-1])
    if bins.size < 2 * OUT_OF_BINS:
        return power
    some = power[..., bins]
    # level, so that at either end what mirrors it is as high
    along = np.log(bins) - np.log(bins).mean()
    slope = np.log(np.maximum(some, TINY_POWER)) @ along / (along @ along)
    level = np.exp(slope[..., None] * along)
    # of an exponential distribution the mean is the median over ln 2, as sure as that of half as many
    usual = median_filter(some / level, (1, 2 * OUT_OF_BINS + 1), mode="reflect") / np.log(2.0)
    usual = np.maximum(usual * level, TINY_POWER)
    beside = 2 * OUT_OF_BINS * np.log(2.0) ** 2
    least = beside * np.expm1((np.log(some.size) + TOLD_LOG_ODDS) / beside)
    line = maximum_filter1d(some / usual, LINE_BINS, axis=-1) > least
    found = power.copy()
    found[..., bins] = np.where(line, usual, some)
    return found


def _periodograms(reading: Array, period_s: float) -> tuple[Array, Array, Array]:
    """Frequencies (b,), power (s, b) and weight (b,) of Hann-tapered periodograms gathered into bins of
    `BINS_PER_OCTAVE`."""
    size = reading.shape[-1]
    place = np.arange(size)
    taper = 0.5 - 0.5 * np.cos(2 * np.pi * place / size)
    line = place - place.mean()
    level = reading.mean(axis=-1, keepdims=True)
    straight = level + (reading @ line / (line @ line))[..., None] * line
    spectrum = np.fft.rfft((reading - straight) * taper, axis=-1)
    raw = _without_lines(2 * period_s * np.abs(spectrum) ** 2 / np.sum(taper**2), size * period_s)
    first, last = 2, raw.shape[-1] - 1  # below, the taper and the detrending change the spectrum
    index = np.arange(first, last)
    bins = np.floor(np.log2(index) * BINS_PER_OCTAVE).astype(int)
    begin = np.flatnonzero(np.diff(bins, prepend=-1))
    weight = np.diff(begin, append=index.size).astype(float)
    frequency = np.exp(np.add.reduceat(np.log(index / (size * period_s)), begin) / weight)
    power = np.add.reduceat(raw[:, first:last], begin, axis=1) / weight
    return frequency, power, weight / HANN_DEPENDENCE
