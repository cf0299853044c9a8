"""A temperature that swings by itself, again and again: in the sun once in each circle, say.

Relative humidity follows the air's temperature at once. What the air's does again and again with one period shows in
the humidity, in whatever way the vapour goes with it: but for one vapour in very many, whose size and phase undo just
that. At a frequency that stands out of the temperature's spectrum let H be the humidity, in its logarithm, over the
saturation pressure in its own. In air H is about -1, give or take as much, since vapour goes as it likes; of a
thermometer that swings by itself it is 0, to within the scatter of H along the flight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.special import ndtr

from shockrig.analysis.estimate.without_model import MAD_TO_SIGMA
from shockrig.analysis.flight.air_prior import LINE_BINS, OUT_OF_BINS, SHORTEST_S, TOLD_LOG_ODDS
from shockrig.analysis.flight.unread import OF_MEDIAN
from shockrig.analysis.physics.humidity import saturation_pressure_hpa, saturation_slope

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
FEWEST_SWINGS = 6
MEANS_IN_SWING = 8  # at least: its course is told by so many means of rows


def swings(humidity: Array, temperature_c: Array, read: Mask, period_s: float, noise: float = 0.0) -> Array:
    """How far (n,) the temperature is moved by swings of its own, in K above where they leave it lowest.

    Parameters
    ----------
    humidity, temperature_c : ndarray (n,)
        Readings of the film [%RH], none of them 0, and the corrected temperature of the air.
    read : ndarray of bool (n,)
        Rows in which the film was read: what is put between others follows nothing.
    period_s : float
        Between rows.
    noise : float
        Of the film's readings, with what they are rounded to [%RH]: what air that swings by less does to them is lost
        in their steps, and that it does not show there says nothing.

    """
    rows = max(int(SHORTEST_S / MEANS_IN_SWING / period_s), 1)
    count = temperature_c.size // rows
    shown = np.asarray(read[: count * rows].reshape(count, rows).any(axis=1))
    if count < FEWEST_SWINGS or not shown.any():
        return np.zeros(temperature_c.shape)
    logarithms = np.stack([np.log(saturation_pressure_hpa(temperature_c)), np.log(humidity)])
    means = np.stack([_beside_a_line(one.reshape(count, rows).mean(axis=1)) for one in logarithms[:, : count * rows]])
    both = np.fft.fft(means, 2 * count)  # beyond the ends there is nothing
    own, level = np.zeros(count), float(np.median(humidity[read]))
    told: list[float] = []
    for line in _lines(means[0], rows * period_s):
        swing, odds = _apart(both, shown, line)
        if odds < TOLD_LOG_ODDS or level * float(np.abs(swing).max()) < noise:
            continue
        # what comes once in a circle has overtones, and may be one
        parts = [(line, swing)]
        for other in (0.5 * line, 2.0 * line):
            swing, odds = _apart(both, shown, other)
            parts += [(other, swing)] if odds > 0.0 else []
        for at, swing in parts:
            if all(abs(at - one) * own.size > LINE_BINS for one in told):
                told.append(at)
                own += swing
    own = np.interp(np.arange(temperature_c.size), (np.arange(count) + 0.5) * rows - 0.5, own)
    own /= saturation_slope(temperature_c)
    return np.asarray(own - own.min())


def _beside_a_line(values: Array) -> Array:
    """Values (n,) without the straight line that fits them best."""
    along = np.arange(values.size) - 0.5 * (values.size - 1)
    square = float(along @ along)
    return values - values.mean() - (along * (along @ values) / square if square else 0.0)


def _lines(values: Array, period_s: float) -> list[float]:
    """Frequencies [1/row] at which the spectrum of values (n,) stands out of what it is beside them."""
    power = np.abs(np.fft.rfft(values * np.hanning(values.size))) ** 2
    bins = np.arange(FEWEST_SWINGS, min(int(values.size * period_s / SHORTEST_S), power.size - OUT_OF_BINS))
    if not bins.size:
        return []
    away = np.arange(LINE_BINS, OUT_OF_BINS + 1)
    beside = bins[:, None, None] + np.stack([-away, away])
    powers = np.where(beside >= LINE_BINS, power[np.maximum(beside, 0)], np.nan)
    # where a course bends the spectrum falls steeply: on a line through the middles of both sides, in logarithms
    middles = np.log(np.nanmedian(np.where(beside >= LINE_BINS, beside, np.nan), axis=2))
    sides = np.log(np.maximum(np.nanmedian(powers, axis=2), np.finfo(float).tiny))
    along = (np.log(bins) - middles[:, 0]) / (middles[:, 1] - middles[:, 0])
    between = np.exp(sides[:, 0] + along * (sides[:, 1] - sides[:, 0]))
    # of an exponential distribution the mean is the median over ln 2
    usual = np.maximum(np.nanmedian(powers.reshape(bins.size, -1), axis=1), between) / np.log(2.0)
    out = power[bins] > (np.log(bins.size) + TOLD_LOG_ODDS) * usual
    found = bins[out & (power[bins] >= maximum_filter1d(power, 2 * LINE_BINS - 1)[bins])]
    # between bins a line lies about where their amplitudes have their centre
    size = np.sqrt(power[found[:, None] + np.array([-1, 0, 1])])
    return list(((found + (size[:, 2] - size[:, 0]) / size.sum(axis=1)) / values.size).tolist())


def _apart(both: NDArray[np.complex128], read: Mask, line: float) -> tuple[Array, float]:
    """What of the first of two series (n,) swings with a frequency, and the log-odds that the second follows none of
    it where it was `read` (n,); `both` (2, 2 n) are their Fourier transforms, with as much of nothing behind them."""
    count, width = both.shape[1] // 2, 1.0 / line
    # what turns with that frequency, as a mean under a bell as wide as a swing, as far as there is something under it
    bell = np.exp(-2.0 * (np.pi * width * (np.fft.fftfreq(2 * count) - line)) ** 2)
    there = np.diff(ndtr((np.array([[-0.5], [count - 0.5]]) - np.arange(count)) / width), axis=0)
    moved, shown = np.fft.ifft(both * bell)[:, :count] / there
    size = np.maximum(np.abs(moved), np.finfo(float).tiny)
    ratio = (shown * np.conj(moved) / size**2)[read]
    # medians: where a layer is passed both say something else for a while
    middle = complex(np.median(ratio.real), np.median(ratio.imag))
    off = np.concatenate([ratio.real - middle.real, ratio.imag - middle.imag])
    error = (OF_MEDIAN * MAD_TO_SIGMA * float(np.median(np.abs(off)))) ** 2
    error = max(error * 2.0 * np.sqrt(np.pi) * width / ratio.size, np.finfo(float).tiny)
    wide = 1.0 + error
    odds = np.log(wide / error) - 0.5 * abs(middle) ** 2 / error + 0.5 * abs(middle + 1.0) ** 2 / wide
    steady = moved * np.minimum(np.median(size) / size, 1.0)
    return 2.0 * steady.real, float(odds)
