"""What single readings do all along, with no part in the response: a hum and bursts, described from the plateaus.

A hum has one frequency, and a phase and a size of its own in each run. A slow one has to be seen in every condition.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.optimize import minimize_scalar

from shockrig.analysis.diagnose.grammar import levels
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
CLIPPED_SIGMAS = 2.0  # robust standard deviations: no sine goes there, and a burst is not to hide where it is
LEFT_OUT_SIGMAS, LEAST_LEFT = 3.0, 1e-9  # robust standard deviations of a burst, and what is rounding [unit]
BURST_SIGMAS = 5.5  # standard deviations from which on a reading belongs to a burst
A_HANDFUL, EXPECTED_SHARE = 1.5, 3e-4  # readings that are absurd in real logs, and their share
NEAR_TURN, LEAST_READINGS = 0.3, 8  # of a turn over a run; of a plateau that tells a swing
FEWEST_PLATEAUS = 4  # plateaus of a condition that is held out; twice as many tell a hum


@dataclass(frozen=True)
class _Plateau:
    run: int
    time_s: Array
    value: Array


def whole_conditions(channel: Channel) -> Iterator[NDArray[np.bool_]]:
    """The runs (R,) of each condition that a finding may be tried on."""
    for own in levels(channel).values():
        yield from (own == one for one in np.unique(own))
    if channel.jumps_with_air and channel.isothermal.any() and (~channel.isothermal).any():
        yield from (~channel.isothermal, channel.isothermal)


def without_hum(channel: Channel) -> tuple[Channel, Discovered | None]:
    """A channel with a hum taken out of its readings, and the hum; the channel as it is where none is certain.

    A hum is looked for from the lowest frequency that a plateau shows: as the line that stands out most beside the
    spectrum around it, and then out of the noise as it is estimated once the line is gone, which cannot imitate it.
    """
    pieces = [p for p in plateaus(channel) if _spread(p.value) > 0.0]  # one that mostly repeats a value has no spectrum
    line_hz = _highest_line(channel, pieces) if len(pieces) >= 2 * FEWEST_PLATEAUS else None
    if line_hz is None:
        return channel, None
    frequency = _in_step(channel, line_hz)
    swings, *sizes = zip(*(_swing(*run, channel.sampling_period_s, frequency) for run in channel.samples), strict=True)
    square, by_noise, _ = np.array(sizes)
    seen = square > SEEN_SQUARE * by_noise
    if not seen.any():
        return channel, None
    size = float(np.sqrt(np.median((square - by_noise)[seen])))
    samples = [(time, value - swing) for (time, value), swing in zip(channel.samples, swings, strict=True)]
    quiet = rebin(channel, samples, channel.bin_of, channel.die_samples, 1)
    noise = estimate_noise(quiet, rounding_step(quiet) or channel.quantity.resolution)
    power, expected = float(_amplitudes(pieces, np.array([frequency]))[0].sum()), 0.0
    for piece in pieces:
        gamma = noise.autocovariance(piece.value.size)
        lag = np.arange(gamma.size)
        weight = np.where(lag == 0, 1.0, 2.0) * (gamma.size - lag)
        usual = float((weight * gamma * np.cos(2.0 * np.pi * frequency * lag * channel.sampling_period_s)).sum())
        expected += 4.0 * max(usual, 1e-300) / piece.value.size**2
    looks = sum(piece.value.size for piece in pieces) / len(pieces)
    chance = float(special.gammaincc(len(pieces), power / expected * len(pieces))) * looks
    # Cramer and Rao over the length of whole runs (Rife and Boorstyn 1974, doi 10.1109/TIT.1974.1055282).
    span_s = float(np.median([time[-1] - time[0] for time, _ in channel.samples]))
    u = np.sqrt(1.5 / (1.0 / by_noise[seen]).sum()) / (np.pi * size * span_s)
    hum = Discovered(
        behaves_as="periodic",
        driver="none",
        period_s=Uncertain(1.0 / frequency, float(u) / frequency**2),
        size=EffectSize(size, float(np.sqrt(square).std(ddof=1) / np.sqrt(square.size)), channel.quantity.unit),
        probability=1.0,
    )
    return (channel, None) if chance > LEAST_P_VALUE**2 else (quiet, hum)


def plateaus_of(time: Array, period_s: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The readings of a run (n,) before the transfer and at its end."""
    return time < -2 * period_s, time > 0.67 * time[-1]


def plateaus(channel: Channel) -> Iterator[_Plateau]:
    """Each plateau of a channel, a slow bend taken off, as far as it is looked at."""
    period = channel.sampling_period_s
    for run, ((time, value), air) in enumerate(zip(channel.samples, channel.air, strict=True)):
        if air is not None:
            continue  # there is no plateau in a record that was driven all along
        for part in plateaus_of(time, period):
            t, y = time[part], value[part]
            if y.size >= LEAST_PLATEAU and np.ptp(y) > 0:
                early = t - t[0] < LONGEST_S
                yield _Plateau(run, t[early], (y - np.polyval(np.polyfit(t, y, 2), t))[early])


def _in_step(channel: Channel, frequency_hz: float) -> float:
    """The frequency [Hz] near one for which the two plateaus of each run fit one swing best."""
    spans = [time[-1] - time[0] for time, _ in channel.samples]

    def left(trial_hz: float) -> float:
        return sum(_swing(*run, channel.sampling_period_s, trial_hz)[3] for run in channel.samples)

    around = NEAR_TURN / float(np.median(spans))  # where the two plateaus of a run keep step
    ends = (frequency_hz - around, frequency_hz + around)
    return float(minimize_scalar(left, bounds=ends, method="bounded", options={"xatol": 1e-7}).x)


def _swing(time: Array, value: Array, period_s: float, frequency_hz: float) -> tuple[Array, float, float, float]:
    """The sinusoid of a frequency in a run's readings (n,), of one size and phase, from its two plateaus, with a bend
    of each; the square of its amplitude, the mean of that in noise alone, and the square of what it leaves of them."""
    parts = [part for part in plateaus_of(time, period_s) if part.sum() > LEAST_READINGS]
    if not parts:
        return np.zeros(time.size), 0.0, np.inf, 0.0
    turn = 2.0 * np.pi * frequency_hz * time
    swing = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    columns, rows = [], np.concatenate([value[part] for part in parts])
    for place, part in enumerate(parts):
        t = time[part] - time[part].mean()
        bend = np.zeros((t.size, 3 * len(parts)))
        bend[:, 3 * place : 3 * place + 3] = np.stack([np.ones(t.size), t, t**2], axis=1)
        columns.append(np.hstack([swing[part], bend]))
    design = np.vstack(columns)
    both, *_ = np.linalg.lstsq(design, rows, rcond=None)
    rest = rows - design @ both
    calm = np.abs(rest) <= LEFT_OUT_SIGMAS * _spread(rest) + LEAST_LEFT  # bursts are not its size
    both, *_ = np.linalg.lstsq(design[calm], rows[calm], rcond=None)
    left = float((rest**2).sum()) + rest.size * LEAST_LEFT**2
    return np.asarray(swing @ both[:2]), float(both[:2] @ both[:2]), 4.0 * left / rest.size**2, left


def _spread(values: Array) -> float:
    """Robust standard deviation."""
    return MAD_TO_SIGMA * float(np.median(np.abs(values - np.median(values))))


def _amplitudes(pieces: list[_Plateau], frequency_hz: Array) -> tuple[Array, Array]:
    """Squared amplitudes (K, F) of sinusoids fitted to each plateau, and each one's variance (K,).

    The frequencies (F,) are evenly spaced: the first few, and leaps over as many, make all of them by a product.
    """
    few = int(np.ceil(np.sqrt(frequency_hz.size)))
    apart_hz = (frequency_hz[-1] - frequency_hz[0]) / max(frequency_hz.size - 1, 1)
    leaps_hz = apart_hz * few * np.arange(-(-frequency_hz.size // few))
    squares, noise = [], []
    for piece in pieces:
        size = CLIPPED_SIGMAS * _spread(piece.value)
        y = np.clip(piece.value, -size, size)
        early, leaps = (
            np.exp(-2j * np.pi * np.outer(f, piece.time_s - piece.time_s[0])) for f in (frequency_hz[:few], leaps_hz)
        )
        sums = ((leaps * y) @ early.T).ravel()[: frequency_hz.size]
        squares.append(np.abs(sums / (0.5 * y.size)) ** 2)
        noise.append(float(y.var()))
    return np.array(squares), np.array(noise)


def _highest_line(channel: Channel, pieces: list[_Plateau]) -> float | None:
    """Frequency [Hz] that stands out most in the plateaus' mean spectrum; None where they are too short for one, or it
    is so slow that wandering looks alike, and not every condition shows the line that the others tell."""
    width = 1.0 / float(np.median([p.time_s[-1] - p.time_s[0] for p in pieces]))
    grid = np.arange(2.0 * width, 0.5 / channel.sampling_period_s, width / PER_WIDTH)
    if not grid.size:
        return None
    squares, _ = _amplitudes(pieces, grid)
    power = squares / np.median(squares, axis=1, keepdims=True)
    mean, run = power.mean(axis=0), np.array([p.run for p in pieces])
    highest = grid[int(np.argmax(mean / _beside(mean)))]
    parts = [runs[run] for runs in whole_conditions(channel)] if highest < LINE_TURNS * width else []
    for test in parts:
        both = min(test.sum(), (~test).sum()) >= FEWEST_PLATEAUS
        if both and not _stands_out(power[~test], power[test]):
            return None
    near = np.arange(-PER_WIDTH * FINE_FACTOR, PER_WIDTH * FINE_FACTOR + 1) * width / (PER_WIDTH * FINE_FACTOR)
    own, variance = _amplitudes(pieces, highest + near)
    moves = variance > 0.0  # a plateau of which clipping leaves a single value says nothing
    return float((highest + near)[int(np.argmax((own[moves] / variance[moves, None]).sum(axis=0)))])


def _beside(power: Array) -> Array:
    """Median of a spectrum (F,) around each frequency, without those of the same line."""
    reach, gap = AROUND_WIDTHS * PER_WIDTH // 2, BESIDE_WIDTHS * PER_WIDTH
    padded = np.pad(power, reach, mode="reflect" if power.size > reach else "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    keep = np.abs(np.arange(-reach, reach + 1)) > gap
    return np.asarray(np.median(windows[:, keep], axis=-1))


def _stands_out(train: Array, test: Array) -> bool:
    """Whether the line that is highest in some spectra (K, F) is one in others."""
    mean = train.mean(axis=0)
    at = int(np.argmax(mean / _beside(mean)))
    of = test.mean(axis=0)
    ratio = of[at] / _beside(of)[at]
    # A mean of K spectra of noise is a chi-square of 2 K degrees; its median is a little below its mean.
    count = test.shape[0]
    return bool(special.gammaincc(count, ratio * special.gammaincinv(count, 0.5)) < LEAST_P_VALUE)


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
