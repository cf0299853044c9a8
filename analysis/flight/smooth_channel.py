"""One channel through the smoother: nodes for samples and gaps, overlapping windows, a prior for each, put together
again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from shockrig.analysis.flight.prior import (
    UNSEEN_VARIANCE,
    Passing,
    Prior,
    fit_prior,
    fit_windows,
    gain_squared,
    spectra,
)
from shockrig.analysis.flight.response import Response
from shockrig.analysis.flight.smoother import smooth

Array = NDArray[np.float64]
CORE = 250  # samples of a window that are kept
LONGEST_BRIDGE_S = 60.0  # beyond, a gap parts the flight
SEGMENT = 250  # samples over which the air's turbulence intensity is taken as one, at least
SEGMENT_LAGS = 12.0  # and so many of the sensor's time constants, or a slow sensor cannot tell it
LONGEST_SEGMENT = 500
SPARSE = 0.75  # share of nodes with a sample, below which the bridges are left out of the judgement
SIDE_BY_SIDE = 64  # windows at once


@dataclass(frozen=True)
class Estimate:
    """Arrays (n,): the air, its variance (of the smoother alone) and the clean reading; NaN where too little was
    measured.

    `noise_factor`: fitted over expected noise, one sigma; `cutoff_hz`: of the low-pass, where the method has one;
    `resolved_rate`: angular frequency [1/s] above which the air is not resolved; `amplified`: variance of the reading's
    noise in an inverse's air.
    """

    air: Array
    variance: Array
    clean: Array
    noise_factor: float
    cutoff_hz: float | None = None
    resolved_rate: float = 30.0
    amplified: float = 0.0


def estimate(
    time_s: Array,
    reading: Array,
    usable: NDArray[np.bool_],
    response: Response,
    noise_variance: Array,
    delay_s: float = 0.0,
    passing: Passing | None = None,
) -> Estimate:
    """Smooth one channel.

    Parameters
    ----------
    time_s, reading : (n,)
        Rows in order of time; readings that are not `usable` are not looked at.
    response : Response
        For each row.
    noise_variance : (n,)
        Expected of each reading; all are multiplied by one factor, fitted, that is seldom far from 1.
    delay_s : float
        The reading tells of the air so much earlier.
    passing : Passing, optional
        With `sigma` for each row.
    """
    period = typical_period(time_s)
    node_time, node_row = _nodes(time_s - delay_s, period, delay_s)
    measured = (node_row >= 0) & usable[node_row]
    rows = np.flatnonzero(measured)
    if rows.size < 8:
        nothing = np.full(time_s.shape, np.nan)
        return Estimate(nothing, nothing, nothing, 1.0)
    nearest = _carried(node_row)
    bridged = np.interp(node_time, node_time[rows], reading[node_row[rows]])
    along = response.at(nearest)
    overlap = int(np.clip(3.0 * response.slowest_s, 8.0, 60.0) / period)
    index, owner = _windows(node_time, period, overlap)
    index_safe = np.maximum(index, 0)

    expected = float(np.sqrt(np.mean(noise_variance[node_row[rows]])))
    through = None if passing is None else replace(passing, sigma=passing.sigma[nearest])
    if rows.size > SPARSE * node_time.size:
        local = _local_priors(bridged, along, period, expected, through)
    else:
        # bridges would pass for calm air: the samples alone, as if they were evenly spaced
        steps = np.diff(node_time[rows])
        spacing = float(np.mean(steps[steps <= 5 * np.median(steps)]))
        some = None if through is None else replace(through, sigma=through.sigma[rows])
        own = _local_priors(bridged[rows], along.at(rows), spacing, expected, some)
        local = Prior(
            *(np.interp(node_time, node_time[rows], value) for value in (own.turbulence, own.bend, own.noise))
        )
    noise_factor = float(local.noise[0]) / expected
    variance = np.where(measured, noise_variance[nearest] * noise_factor**2, np.inf)
    lags, apart = lags_behind(bridged, along, period)
    out = np.full((3, node_time.size), np.nan)
    for start in range(0, len(index), SIDE_BY_SIDE):
        part = slice(start, start + SIDE_BY_SIDE)
        at = index_safe[part]
        step = np.diff(node_time[at], axis=1, prepend=node_time[at[:, :1]])
        padded = index[part] < 0
        step = np.where(padded, period, step)
        prior = Prior(local.turbulence[at], local.bend[at], local.noise[at])
        noise_variance = np.where(padded, np.inf, variance[at])
        spread = 2.0 * np.std(bridged[at], axis=1) + 5.0 * prior.noise[:, 0]
        window = along.at(at)
        here = None if through is None else replace(through, sigma=through.sigma[at])
        first = at[:, 0]
        # what came before a flight is not known; later the readings tell how far the lags may be from their guess
        fresh = (first == 0) | (np.diff(node_time, prepend=-np.inf)[first] > LONGEST_BRIDGE_S)
        lag_spread = np.where(fresh[:, None], spread[:, None], apart[first] + 5.0 * prior.noise[:, :1])
        smoothed = smooth(step, bridged[at], noise_variance, window, lags[first], prior, spread, here, lag_spread)
        keep = owner[part]
        wider = _inflation(smoothed.surprise, keep)
        unseen = UNSEEN_VARIANCE * prior.turbulence**2
        for slot, values in enumerate((smoothed.air, smoothed.variance * wider[:, None] + unseen, smoothed.clean)):
            out[slot, at[keep]] = values[keep]
    air, node_variance, clean = (np.interp(time_s, node_time, row) for row in out)
    typical = Prior(*np.median([local.turbulence, local.bend, local.noise], axis=1)[:, None])
    rate = _resolved_rate(typical, along.at(slice(len(along.rate) // 2, len(along.rate) // 2 + 1)), period)
    return Estimate(air, node_variance, clean, noise_factor, resolved_rate=rate)


def _inflation(surprise: Array, keep: NDArray[np.bool_]) -> Array:
    """Factor on each window's variance: mean square surprise where it is larger than chance makes it, else 1."""
    seen = keep & ~np.isnan(surprise)
    count = np.maximum(seen.sum(axis=1), 1)
    mean_square = (np.where(seen, surprise, 0.0) ** 2).sum(axis=1) / count
    return np.where(mean_square > 1.0 + 3.0 * np.sqrt(2.0 / count), mean_square, 1.0)


def typical_period(time_s: Array) -> float:
    """Median time between rows that differ in time."""
    steps = np.diff(time_s)
    steps = steps[steps > 0]
    return float(np.median(steps)) if steps.size else 0.1


def _nodes(time_s: Array, period: float, delay_s: float) -> tuple[Array, NDArray[np.int64]]:
    """Times of the samples with the gaps filled, and after the last one as far as the delay; row of each, -1 for a
    filling."""
    ahead = np.diff(time_s, append=time_s[-1] + delay_s + period * (1 if delay_s else 0))
    fill = np.where((ahead > 1.6 * period) & (ahead <= LONGEST_BRIDGE_S), np.round(ahead / period) - 1, 0).astype(int)
    if delay_s:
        fill[-1] = int(np.ceil(delay_s / period)) + 1
        ahead[-1] = period * (fill[-1] + 1)
    start = np.repeat(np.arange(time_s.size), fill + 1)
    place = np.arange(start.size) - np.repeat(np.cumsum(fill + 1) - (fill + 1), fill + 1)
    node_time = time_s[start] + place * (ahead / (fill + 1))[start]
    return node_time, np.where(place == 0, start, -1)


def _carried(node_row: NDArray[np.int64]) -> NDArray[np.int64]:
    """Row of each node, fillings taking the row before them."""
    return np.maximum.accumulate(np.maximum(node_row, 0))


def _windows(node_time: Array, period: float, overlap: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Windows (w, n) of node indices, -1 for padding, and which of them each window owns."""
    breaks = np.flatnonzero(np.diff(node_time) > LONGEST_BRIDGE_S) + 1
    starts, stops = np.concatenate([[0], breaks]), np.concatenate([breaks, [node_time.size]])
    index, owner = [], []
    longest = int((stops - starts).max())
    core = min(CORE, longest)
    width = min(core + 2 * overlap, longest)
    for start, stop in zip(starts, stops, strict=True):
        for low in range(start, stop, core):
            high = min(low + core, stop)
            first = max(min(low - overlap, stop - width), start)
            row = np.arange(first, first + width)
            owner.append((row >= low) & (row < high))
            index.append(np.where(row < stop, row, -1))
    return np.array(index), np.array(owner)


def _resolved_rate(prior: Prior, response: Response, period: float) -> float:
    """Angular frequency at which the reading's signal sinks into its noise."""
    frequency = np.geomspace(0.01, 0.5 / period, 60)
    turbulence, bend = spectra(frequency, period)
    signal = gain_squared(response, frequency, period)[0] * (prior.turbulence**2 * turbulence + prior.bend**2 * bend)
    below = np.flatnonzero(signal < 2 * period * prior.noise**2)
    return float(2 * np.pi * frequency[below[0] if below.size else -1])


def _local_priors(bridged: Array, along: Response, period: float, noise: float, passing: Passing | None) -> Prior:
    """Strengths at each node: of segments that overlap by half, each judged by itself, joined in their logarithm."""
    size = int(np.clip(SEGMENT_LAGS * along.slowest_s / period, SEGMENT, LONGEST_SEGMENT))
    size = min(size, bridged.size)
    if size < 24:
        sigma = max(float(np.std(bridged)), noise)
        return Prior(*(value * np.ones(bridged.size) for value in (sigma, sigma, noise)))
    starts = np.unique(np.append(np.arange(0, bridged.size - size + 1, max(size // 2, 1)), bridged.size - size))
    segments = bridged[starts[:, None] + np.arange(size)]
    middle = starts + size // 2
    some = slice(None, None, max(starts.size // 60, 1))
    through = few = None
    if passing is not None:
        sigma = np.sqrt((passing.sigma[starts[:, None] + np.arange(size)] ** 2).mean(axis=1))
        through, few = Passing(sigma, passing.rate), Passing(sigma[some], passing.rate)
    common = fit_prior(segments[some], along.at(middle[some]), period, noise, few)
    local = fit_windows(segments, along.at(middle), period, common, through)
    nodes = np.arange(bridged.size)
    turbulence, bend = (np.exp(np.interp(nodes, middle, np.log(value))) for value in (local.turbulence, local.bend))
    return Prior(turbulence, bend, common.noise * np.ones(bridged.size))


def lags_behind(values: Array, along: Response, period: float) -> tuple[Array, Array]:
    """Each lag behind evenly spaced `values` (n, K) from rest, and how far the two were apart in the lag's memory, rms.

    Behind the readings it is a guess of where the sensor stands: the air is about as far from the reading as that.
    """
    decay = np.exp(-np.mean(along.rate, axis=0) * period)
    lags, apart = (np.empty((values.size, decay.size)) for _ in range(2))
    inside = range(decay.size)[along.within]
    for k, d in enumerate(decay):
        drive = lags[:, : len(along.cap)] @ np.asarray(along.cap) if k in inside else values
        lags[:, k] = lfilter([1 - d], [1.0, -d], drive, zi=[d * drive[0]])[0]
        apart[:, k] = np.sqrt(lfilter([1 - d], [1.0, -d], (drive - lags[:, k]) ** 2))
    return lags, apart
