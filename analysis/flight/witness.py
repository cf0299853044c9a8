"""Where the film did not see what the thermometer says: a temperature that moved by itself, in the sun or under ice.

A film shows little of what the vapour does at once, while its relative humidity follows the air's temperature without
lag. Let dx be what the temperature's change, over a time in which the film shows a share of at most `SHOWN_SHARE` of a
step, makes of the humidity, and dr what its reading did beside its drift. If the air went as the temperature says,
the film's vapour dr + dx is that share of what the air's did, which may be anything of dx's size (Cauchy); if the
thermometer alone moved, dr is noise (Gauss). Changes that share readings are judged together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.signal import lfilter

from shockrig.analysis.flight.response import LagResponse
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.flight.stretches import largest_share
from shockrig.analysis.physics.humidity import saturation_pressure_hpa

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SHOWN_SHARE = 1 / 3  # of a step of the vapour: a change that the film did not lag would need three times as much vapour
MOST_ROWS = 256
FEWEST_WINDOWS = 20
LEAST_TIMES = 3.0  # the usual change: smaller ones matter little, and nobody can tell whose they are
MISSHAPEN_SHARE = 0.1  # of what the corrected temperature moves, that it is off by on the way
BELIEVED_LOG_ODDS = 3.0  # of log-odds: one in twenty
FORGOTTEN_LAGS = 50.0  # of the film
ENDS_NOISE = np.sqrt(5.0)  # of white noise, of a change less half of those before and after
THIRDS_NOISE = 6.0 / np.sqrt(np.pi)  # and what three of them go in all
TO_SIGMA = 1.4826  # of the median of absolute values
LEAST_PERCENT = 1.0  # drier air says nothing


def unseen(
    time_s: Array,
    humidity: Array,
    temperature_c: Array,
    sigma_k: Array,
    believed: Mask,
    response: LagResponse,
    noise_percent: float,
) -> Array:
    """How far (n,) the temperature moved by itself, in K, 0 where the film agrees with it.

    Parameters
    ----------
    humidity, temperature_c : ndarray (n,)
        Readings of the film [%RH] and the corrected temperature of the air.
    sigma_k : ndarray (n,)
        Its standard uncertainty: of a thermometer in a burst of noise a film says nothing.
    believed : ndarray (n,)
        Rows where both were read.
    response : Response
        Of the film, a row for each.
    noise_percent : float
        Of its readings.

    Notes
    -----
    Changes are summed, so a constant is left open behind them, which divides reading and result alike. It is forgotten
    so slowly that a film hardly lags behind it, or what many changes leave open would add up.
    """
    nothing = np.zeros(temperature_c.shape)
    period = typical_period(time_s)
    rows = _rows(response, period)
    first = np.arange(rows, time_s.size - 2 * rows)
    if not rows or first.size < FEWEST_WINDOWS:
        return nothing
    ends = first[:, None] + rows * np.array([-1, 0, 1, 2])
    lasting = time_s[ends[:, -1]] - time_s[ends[:, 0]]
    known = believed[ends].all(axis=1) & (lasting < 1.5 * 3 * rows * period)
    if np.count_nonzero(known) < FEWEST_WINDOWS:
        return nothing
    first, ends = first[known], ends[known]
    level = np.maximum(humidity[first], LEAST_PERCENT)
    log_saturation = np.log(saturation_pressure_hpa(temperature_c))
    size = level * np.abs(np.diff(log_saturation[ends], axis=1)).sum(axis=1)
    moved, read = level * _beside(log_saturation, ends), _beside(humidity, ends)
    per_k = np.log(saturation_pressure_hpa(temperature_c[first] + 1.0)) - log_saturation[first]
    unsure = level * per_k * np.median(sigma_k[ends], axis=1)
    own = _own(first, moved, read, size, unsure, ENDS_NOISE * noise_percent, rows)
    if not own.any():
        return nothing
    within = np.zeros(time_s.shape, dtype=bool)
    within[first[own] + rows // 2] = True
    within = maximum_filter1d(within, rows + 1)  # a window is judged as a whole
    moves = np.concatenate([[0.0], np.diff(temperature_c) * within[:-1]])
    keep = float(np.exp(-period / (FORGOTTEN_LAGS * response.slowest_s)))
    return np.asarray(lfilter([1.0], [1.0, -keep], moves))


def _rows(response: LagResponse, period: float) -> int:
    """The most rows within which the film shows no more than `SHOWN_SHARE` of a step; 0 where it shows more in one."""
    rows, more = 0, 1
    while more <= MOST_ROWS and largest_share(response, more * period) <= SHOWN_SHARE:
        rows, more = more, more + max(more // 4, 1)
    return rows


def _beside(values: Array, ends: NDArray[np.int64]) -> Array:
    """Changes over the middle third of each window, beside half of those over the thirds before and after."""
    before, first, last, after = values[ends].T
    return np.asarray((last - first) - 0.5 * ((first - before) + (after - last)))


def _own(
    first: NDArray[np.int64], moved: Array, read: Array, size: Array, unsure: Array, least: float, rows: int
) -> Mask:
    """Changes (w,) of the temperature, in %RH, that are likelier its own than the air's.

    They begin at row `first` and go `size` to and fro, `unsure` by so much; `least` is a reading's noise in one.
    """
    usual = np.hypot(max(_spread(moved), least), MISSHAPEN_SHARE * size)
    unsure = THIRDS_NOISE * np.maximum(unsure - np.median(unsure), 0.0)  # what is usual is in what is usually moved
    large = np.flatnonzero((np.abs(moved) > LEAST_TIMES * usual) & (size > LEAST_TIMES * unsure))
    own = np.zeros(moved.shape, dtype=bool)
    if not large.size:
        return own
    vapour = read + moved
    by_itself = np.hypot(max(_spread(read), least), MISSHAPEN_SHARE * size)[large]
    of_air = np.hypot(max(_spread(vapour), least), SHOWN_SHARE * size)[large]
    odds = np.log1p((vapour[large] / of_air) ** 2) + np.log(np.pi * of_air)
    odds -= 0.5 * (read[large] / by_itself) ** 2 + np.log(np.sqrt(2.0 * np.pi) * by_itself)
    # windows that share readings say the same thing
    before, after = (np.searchsorted(first[large], first[large] + beside) for beside in (-2 * rows, 2 * rows + 1))
    total = np.concatenate([[0.0], np.cumsum(odds)])
    own[large] = total[after] - total[before] > BELIEVED_LOG_ODDS * rows
    return own


def _spread(values: Array) -> float:
    """Standard deviation of most of the values."""
    return TO_SIGMA * float(np.median(np.abs(values - np.median(values))))
