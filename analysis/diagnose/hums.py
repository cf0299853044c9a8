"""What single readings do all along, with no part in the response: a hum and bursts, described from the plateaus.

A hum has one frequency, and a phase and a size of its own in each run. A slow one is in phase before and
after a transfer: the end of a response, or what wanders, is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.optimize import minimize_scalar

from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.estimate.channel import Channel, rebin
from shockrig.analysis.estimate.noise import Noise, estimate_noise
from shockrig.analysis.estimate.without_model import MAD_TO_SIGMA, rounding_step
from shockrig.files.causes import Uncertain
from shockrig.files.diagnosis_data import Discovered, EffectSize

Array = NDArray[np.float64]

LEAST_P_VALUE = 1e-3  # of so much by accident, above which a finding is none
LEAST_PLATEAU = 64  # samples of a plateau that tells anything of single readings
LONGEST_S = 60.0  # of a plateau, in one spectrum
PER_WIDTH = 4  # frequencies in the width of a line
LINE_TURNS = 4.0  # of a hum in a plateau, from which on it is no slow wandering
SEEN_SQUARE = 4.6  # times the mean square that noise alone leaves: one run in a hundred shows that by chance
FINE_FACTOR = 12  # times as many around the one that stands out
BESIDE_WIDTHS = 3  # widths of a line, which are not taken for the noise beside it
AROUND_WIDTHS = 40  # widths of a line, which are
LEFT_OUT_SIGMAS = 3.0  # robust standard deviations of a burst: no sine goes there
LEAST_LEFT = 1e-9  # what is rounding [unit]
BURST_SIGMAS = 5.5  # standard deviations from which on a reading belongs to a burst
A_HANDFUL, EXPECTED_SHARE = 1.5, 3e-4  # readings that are absurd in real logs, and their share
NEAR_TURN, FEWEST_TURNS = 0.3, 2.0  # over a run: of a turn, within which swings keep step; turns that tell a swing
TURN_CELLS = 32  # of a turn, within one of which readings are taken together where many frequencies are tried
LEAST_READINGS = 8  # of a plateau that tells a swing
FEWEST_PLATEAUS = 8  # that tell a hum


@dataclass(frozen=True)
class _Plateau:
    time_s: Array
    value: Array


@dataclass(frozen=True)
class _Hum:
    """A hum: how likely noise alone is one, its frequency [Hz], a channel without it, and what is stated of it."""

    chance: float
    frequency_hz: float
    quiet: Channel
    stated: Discovered


def without_hums(channel: Channel) -> tuple[Channel, tuple[Discovered, ...]]:
    """A channel with each hum that is certain taken out of its readings, one after the other, and these hums.

    What shows a line beside another has no one frequency: it is noise of a narrow band, of which more and more lines
    would be found, that fit the plateaus and nothing between them.
    """
    found: list[_Hum] = []
    stated: list[_Hum] = []
    codes = rounding_step(channel) or channel.quantity.resolution
    while (one := _certain_hum(channel, codes)) is not None:
        if not any(_is_overtone(channel, one, of) for of in found):
            if any(_is_beside(channel, one, of) for of in stated):
                break
            stated.append(one)
        channel = one.quiet
        found.append(one)
    return channel, tuple(one.stated for one in stated)


def _is_beside(channel: Channel, one: _Hum, of: _Hum) -> bool:
    """Whether a hum is so near another one that a plateau tells one line from the noise beside the other."""
    return abs(one.frequency_hz - of.frequency_hz) < BESIDE_WIDTHS * _width(list(plateaus(channel)))


def _is_overtone(channel: Channel, one: _Hum, of: _Hum) -> bool:
    """Whether a hum is another one's overtone, as a swing that is no sine has some, also as the sampling folds it."""
    seen = np.array([one.frequency_hz, 1.0 / channel.sampling_period_s - one.frequency_hz])
    times = np.round(seen / of.frequency_hz)
    return bool((np.abs(seen - times * of.frequency_hz) < _in_turn(channel, NEAR_TURN))[times > 1.0].any())


def _certain_hum(channel: Channel, codes: float) -> _Hum | None:
    """The hum in a channel's readings that is most certain; None where none is.

    A hum is looked for from the lowest frequency that a run shows: as the line that stands out most beside the spectrum
    around it, or, where it is slower than a plateau tells, as the swing that fits both plateaus of all runs best; and
    then out of the noise as it is estimated once the line is gone, which cannot imitate it.
    """
    pieces = [p for p in plateaus(channel) if _spread(p.value) > 0.0]  # one that mostly repeats a value has no spectrum
    if len(pieces) < FEWEST_PLATEAUS:
        return None
    ends = [_ends_of(time, value, parts) for time, value, parts in _at_rest(channel)]
    looks = float(np.mean([piece.value.size for piece in pieces]))
    line_hz, swing_hz = _highest_line(channel, pieces), _best_swing(channel, ends, pieces)
    found = [_taken_out(channel, ends, hz, looks, codes) for hz in (line_hz, swing_hz) if hz is not None]
    best = min((one for one in found if one is not None), key=lambda one: one.chance, default=None)
    return best if best is not None and best.chance <= LEAST_P_VALUE**2 else None


def _taken_out(channel: Channel, ends: Sequence[_Ends], near_hz: float, looks: float, codes: float) -> _Hum | None:
    """What swings with a frequency near one; None where nothing is, or what rounding to `codes` [unit] may make."""
    frequency = _in_step(channel, ends, near_hz)
    swings = [_swing(one, frequency) for one in ends]
    both, left = np.array([one for one, _ in swings]), np.array([left for _, left in swings])
    square, readings = (both**2).sum(axis=1), np.array([one.value.size for one in ends])
    by_noise = 4.0 * left / np.maximum(readings, 1) ** 2
    seen, told = square > SEEN_SQUARE * by_noise, readings > 0
    if not seen.any():
        return None
    size = float(np.sqrt(np.median((square - by_noise)[seen])))
    runs = zip(channel.samples, both, strict=True)
    samples = [(time, value - _columns(time, frequency) @ one) for (time, value), one in runs]
    quiet = rebin(channel, samples, channel.bin_of, channel.die_samples, 1)
    noise = estimate_noise(quiet, rounding_step(quiet) or channel.quantity.resolution)
    if max(size, noise.increment) < level("hidden_noise") * codes:
        return None  # codes that repeat have lines of their own
    gamma = noise.autocovariance(int(np.median(readings[told])))
    lag = np.arange(gamma.size)
    usual = gamma * np.where(lag == 0, 1.0, 2.0) * (1.0 - lag / gamma.size)
    density = float((usual * np.cos(2.0 * np.pi * frequency * lag * channel.sampling_period_s)).sum())
    taken = sum(one.square - rest for one, rest in zip(ends, left, strict=True))
    chance = looks * float(special.gammaincc(told.sum(), 0.5 * taken / max(density, np.finfo(float).tiny)))
    # Cramer and Rao over the length of whole runs (Rife and Boorstyn 1974, doi 10.1109/TIT.1974.1055282).
    span_s = float(np.median([time[-1] - time[0] for time, _ in channel.samples]))
    u = np.sqrt(1.5 / (1.0 / by_noise[seen]).sum()) / (np.pi * size * span_s)
    hum = Discovered(
        behaves_as="periodic",
        driver="none",
        period_s=Uncertain(1.0 / frequency, float(u) / frequency**2),
        size=EffectSize(size, float(np.sqrt(square[told]).std(ddof=1) / np.sqrt(told.sum())), channel.quantity.unit),
        probability=1.0,
    )
    return _Hum(chance, frequency, quiet, hum)


def _in_phase_by_chance(channel: Channel, frequency_hz: float) -> float:
    """How likely the plateaus before and after the transfers swing so much in phase where they are not one swing: what
    wanders, or is the end of a response, has phases of its own on either side."""
    turned = []
    for time, value, parts in _at_rest(channel):
        swings = [_swing(_ends_of(time, value, (part,)), frequency_hz)[0] @ (1.0, 1j) for part in parts]
        before, after = swings or (0.0, 0.0)
        turned.append(np.cos(np.angle(before * np.conj(after))) if before * after != 0.0 else 0.0)
    return float(special.ndtr(-np.sqrt(2.0 * len(turned)) * np.mean(turned)))


def plateaus_of(time: Array, rests_until_s: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The readings of a run (n,) before the transfer and at its end."""
    return time < rests_until_s, time > 0.67 * time[-1]


def _at_rest(channel: Channel) -> Iterator[tuple[Array, Array, Sequence[NDArray[np.bool_]]]]:
    """Each run's times and readings (n,) and its plateaus; a record that was driven all along has none."""
    for (time, value), rests_until_s, air in zip(channel.samples, channel.rests_until_s, channel.air, strict=True):
        yield time, value, plateaus_of(time, rests_until_s) if air is None else ()


def plateaus(channel: Channel) -> Iterator[_Plateau]:
    """Each plateau of a channel, a slow bend taken off, as far as it is looked at."""
    for time, value, parts in _at_rest(channel):
        for part in parts:
            t, y = time[part], value[part]
            if y.size >= LEAST_PLATEAU and np.ptp(y) > 0:
                early = t - t[0] < LONGEST_S
                yield _Plateau(t[early], (y - np.polyval(np.polyfit(t, y, 2), t))[early])


@dataclass(frozen=True)
class _Ends:
    """A run's plateaus: their times (m,) [s], a bend of each as columns (m, K), what these leave of the readings (m,),
    and the square of that; without bursts."""

    time_s: Array
    bends: Array
    value: Array

    @property
    def square(self) -> float:
        return float(self.value @ self.value) + self.value.size * LEAST_LEFT**2


def _ends_of(time: Array, value: Array, plateaus: Sequence[NDArray[np.bool_]]) -> _Ends:
    parts = [np.flatnonzero(part) for part in plateaus if part.sum() > LEAST_READINGS]
    bends, left = np.zeros((time.size, 3 * len(parts))), np.zeros(time.size)
    calm = []
    for place, part in enumerate(parts):
        for _ in range(2):  # a burst is not to bend what is left beside it
            own = np.linalg.qr(np.vander(time[part] - time[part].mean(), 3))[0]
            left[part] = value[part] - own @ (own.T @ value[part])
            near = np.abs(left[part] - np.median(left[part])) <= LEFT_OUT_SIGMAS * _spread(left[part]) + LEAST_LEFT
            bends[part, 3 * place : 3 * place + 3], last, part = own, part, part[near]
        calm.append(last)
    rows = np.concatenate(calm) if calm else np.zeros(0, dtype=int)
    return _Ends(time[rows], bends[rows], left[rows])


def _columns(time: Array, frequency_hz: float) -> Array:
    turn = 2.0 * np.pi * frequency_hz * time
    return np.stack([np.sin(turn), np.cos(turn)], axis=1)


def _swing(ends: _Ends, frequency_hz: float) -> tuple[Array, float]:
    """The sine and cosine (2,) of a frequency that fit a run's plateaus best beside their bends, and the square of what
    they leave."""
    swing = _columns(ends.time_s, frequency_hz)
    beside = swing - ends.bends @ (ends.bends.T @ swing)
    both = np.linalg.pinv(beside.T @ beside) @ (beside.T @ ends.value)
    rest = ends.value - beside @ both
    return np.asarray(both), float(rest @ rest) + rest.size * LEAST_LEFT**2


def _in_step(channel: Channel, ends: Sequence[_Ends], frequency_hz: float) -> float:
    """The frequency [Hz] near one for which the two plateaus of each run fit one swing best."""
    around = _in_turn(channel, NEAR_TURN)  # where the two plateaus of a run keep step
    within = (frequency_hz - around, frequency_hz + around)

    def left(trial_hz: float) -> float:
        return sum(_swing(one, trial_hz)[1] for one in ends)

    found = minimize_scalar(left, bounds=within, method="bounded", options={"xatol": 1e-7})
    return float(found.x)


def _in_turn(channel: Channel, turns: float) -> float:
    """The frequency [Hz] of so many turns in a run."""
    return turns / float(np.median([time[-1] - time[0] for time, _ in channel.samples]))


def _best_swing(channel: Channel, ends: Sequence[_Ends], pieces: Sequence[_Plateau]) -> float | None:
    """Frequency [Hz] of the swing that fits the runs' plateaus best, of those too slow for one plateau to tell; None
    where there is none, or the plateaus before and after a transfer do not show it in phase."""
    apart_hz = _in_turn(channel, NEAR_TURN)
    first, end = round(FEWEST_TURNS / NEAR_TURN), int(LINE_TURNS * _width(pieces) / apart_hz) + 1
    if end <= first:
        return None
    gained = np.sum([_gained(one, apart_hz, end) for one in ends], axis=0)
    best = first + int(np.argmax(gained[first:]))
    best_hz = _in_step(channel, ends, best * apart_hz)
    return best_hz if (end - first) * _in_phase_by_chance(channel, best_hz) < LEAST_P_VALUE else None


def _gained(ends: _Ends, apart_hz: float, end: int) -> Array:
    """By how much less the swings of multiples of a frequency, from 0 to before `end`, leave of a run's plateaus than
    none does (end,): about, since readings within a 32nd of the fastest one's turn count as made at once, so that
    a Fourier transform tells all of them."""
    cells = TURN_CELLS * end
    cell = np.round(ends.time_s * apart_hz * cells).astype(int) % cells
    columns = (np.ones(cell.size), ends.value, *ends.bends.T)
    every = np.fft.rfft([np.bincount(cell, one, cells) for one in columns])
    double, swing = every[0, : 2 * end : 2], np.stack([-every[1:, :end].imag, every[1:, :end].real])
    value, bends = swing[:, 0], swing[:, 1:]
    sines = 0.5 * np.array([[cell.size - double.real, -double.imag], [-double.imag, cell.size + double.real]])
    beside = np.moveaxis(sines - np.einsum("ikf,jkf->ijf", bends, bends), -1, 0)
    return np.asarray(np.einsum("if,fij,jf->f", value, np.linalg.pinv(beside), value))


def _spread(values: Array) -> float:
    """Robust standard deviation, by the quartiles: readings that go to and fro between two levels are half apart, where
    the larger half of them differs by noise alone."""
    return MAD_TO_SIGMA * 0.5 * float(np.subtract(*np.quantile(values, (0.75, 0.25))))


def _amplitudes(pieces: Sequence[_Plateau], frequency_hz: Array) -> Array:
    """Squared amplitudes (K, F) of sinusoids fitted to each plateau.

    The frequencies (F,) are evenly spaced: the first few, and leaps over as many, make all of them by a product.
    """
    few = int(np.ceil(np.sqrt(frequency_hz.size)))
    apart_hz = (frequency_hz[-1] - frequency_hz[0]) / max(frequency_hz.size - 1, 1)
    leaps_hz = apart_hz * few * np.arange(-(-frequency_hz.size // few))
    squares = []
    for piece in pieces:
        early, leaps = (
            np.exp(-2j * np.pi * np.outer(f, piece.time_s - piece.time_s[0])) for f in (frequency_hz[:few], leaps_hz)
        )
        sums = ((leaps * piece.value) @ early.T).ravel()[: frequency_hz.size]
        squares.append(np.abs(sums / (0.5 * piece.value.size)) ** 2)
    return np.array(squares)


def _width(pieces: Sequence[_Plateau]) -> float:
    """Of a line in the plateaus' spectrum [Hz]."""
    return 1.0 / float(np.median([p.time_s[-1] - p.time_s[0] for p in pieces]))


def _highest_line(channel: Channel, pieces: Sequence[_Plateau]) -> float | None:
    """Frequency [Hz] that stands out most in the plateaus' mean spectrum; None where they are too short for one."""
    width = _width(pieces)
    grid = np.arange(LINE_TURNS * width, 0.5 / channel.sampling_period_s, width / PER_WIDTH)
    if not grid.size:
        return None
    squares = _amplitudes(pieces, grid)
    mean = (squares / np.median(squares, axis=1, keepdims=True)).mean(axis=0)
    highest = grid[int(np.argmax(mean / _beside(mean)))]
    near = np.arange(-PER_WIDTH * FINE_FACTOR, PER_WIDTH * FINE_FACTOR + 1) * width / (PER_WIDTH * FINE_FACTOR)
    variance = np.array([piece.value.var() for piece in pieces])
    own = _amplitudes(pieces, highest + near) / variance[:, None]
    return float((highest + near)[int(np.argmax(own.sum(axis=0)))])


def _beside(power: Array) -> Array:
    """Median of a spectrum (F,) around each frequency, without those of the same line."""
    reach, gap = AROUND_WIDTHS * PER_WIDTH // 2, BESIDE_WIDTHS * PER_WIDTH
    padded = np.pad(power, reach, mode="reflect" if power.size > reach else "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    keep = np.abs(np.arange(-reach, reach + 1)) > gap
    return np.asarray(np.median(windows[:, keep], axis=-1))


def bursts(channel: Channel, noise: Noise, least: float) -> Discovered | None:
    """Bursts by the size of their readings [unit]; None where there are no more than what real logs hold by accident,
    or they are smaller than `least`."""
    pieces = list(plateaus(channel))
    # A plateau that stands at one code has no spread of its own.
    far = [np.abs(p.value) > BURST_SIGMAS * max(_spread(p.value), noise.standard_deviation) for p in pieces]
    count, outside = sum(p.value.size for p in pieces), sum(int(f.sum()) for f in far)
    if not outside or special.pdtrc(outside - 1, A_HANDFUL + EXPECTED_SHARE * count) > level("adequacy"):
        return None
    values = np.concatenate([p.value[f] for p, f in zip(pieces, far, strict=True)])
    size = float(np.sqrt((values**2).mean()))
    if size < least:
        return None
    # Readings of one burst go together: they count as one.
    times = sum(int((np.diff(f.astype(int)) == 1).sum() + f[0]) for f in far)
    return Discovered(
        behaves_as="bursts",
        driver="none",
        size=EffectSize(size, size / np.sqrt(2.0 * max(times, 1)), channel.quantity.unit),
        probability=1.0,
    )
