"""Bins in time since the transfer: narrow at first, then wider and wider; and a channel laid out anew in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Samples = Sequence[tuple[Array, Array]]

# (until s after the transfer, width s) for sensors of the tempo that this was laid out for.
BIN_PLAN = ((2.5, 0.1), (6.0, 0.2), (12.0, 0.4), (24.0, 0.8), (48.0, 1.6), (100.0, 3.2), (1e9, 10.0))
BEFORE_S = 1.2  # width of a bin of the plateau before the transfer
NEAR_S = 0.3  # before the transfer within which samples stand singly
FINE_BIN_WIDTHS = (
    0.015,
    0.08,
)  # widest bin, in times to half of the step and since the transfer, as noise and step allow


def fine_width(samples: Samples, resolution: float) -> float:
    """Widest bin, as a share of the response's own time, in which readings (times, values) of runs may be averaged.

    A response of time tau bends by step w^2 / (24 tau^2) within a bin of width w, in all R runs alike: that is to stay
    at a fifth of what the noise of the runs together leaves.
    """
    # A mean square, not a median: rounded readings mostly repeat the one before.
    spread = [np.sqrt(0.5 * np.mean(np.square(np.diff(y[t > 0.6 * t[-1]])))) for t, y in samples]
    noise = max(float(np.median(spread)), resolution / np.sqrt(12.0))
    step = max(float(np.median([np.ptp(y) for _, y in samples])), noise)
    return float(np.clip(1.44 * np.sqrt(4.8 * noise / (step * np.sqrt(len(samples)))), *FINE_BIN_WIDTHS))


def edges_after_transfer(
    first_s: float,
    last_s: float,
    period_s: float,
    tempo: float,
    half_s: float = np.inf,
    fine: float = FINE_BIN_WIDTHS[1],
) -> Array:
    """Edges of the bins of runs whose air changes once, from `first_s` (negative) to `last_s`.

    `half_s` is the time to half of the step, infinite or NaN where no run tells it; `fine` as from `fine_width`.
    """
    half = half_s if np.isfinite(half_s) else np.inf
    # Half a period before zero, so that with one sample a period each narrow bin holds one sample.
    wide, near = BEFORE_S * tempo, NEAR_S * tempo
    before = -np.arange(near, max(-first_s, near + 0.1 * tempo) + wide, wide)[::-1]
    close = np.arange(-near + period_s, 0.0, max(0.1 * tempo, period_s))
    after = [0.0]
    for until, width in BIN_PLAN:
        while after[-1] < min(until * tempo, last_s) - 1e-9:
            after.append(after[-1] + max(min(width * tempo, fine * (half + after[-1])), period_s))
    return np.concatenate([before, close, after])


def place(samples: Samples, edges: Array, start_scatter_s: Array) -> tuple[Index, ...]:
    """Bin of each sample, empty bins left out of the numbering; -1 within four sigma of a known start."""
    places = []
    for (time, _), scatter in zip(samples, start_scatter_s, strict=True):
        at = np.searchsorted(edges, time + 1e-6, side="right") - 1
        open_side = (np.abs(time) < 4 * scatter) & (scatter < 0.1)
        places.append(np.where((at >= 0) & (at < edges.size - 1) & ~open_side, at, -1))
    return _renumbered(places)


def _renumbered(places: Sequence[Index]) -> tuple[Index, ...]:
    filled = np.unique(np.concatenate(places))
    filled = filled[filled >= 0]
    number = np.full(int(filled.max(initial=-1)) + 2, -1)
    number[filled] = np.arange(filled.size)
    return tuple(np.where(at >= 0, number[at], -1) for at in places)


def bin_means(times: Sequence[Array], values: Sequence[Array], bin_of: Sequence[Index]) -> tuple[Array, Array, Index]:
    """Mean time, mean value and count of each bin (R, n); an empty bin borrows the mean time of the other runs."""
    bins = max(int(at.max()) for at in bin_of) + 1
    time, value = np.zeros((len(times), bins)), np.zeros((len(times), bins))
    count = np.zeros((len(times), bins), dtype=np.int64)
    for i, (t, y, at) in enumerate(zip(times, values, bin_of, strict=True)):
        ok = at >= 0
        n = np.bincount(at[ok], minlength=bins)
        time[i] = np.bincount(at[ok], t[ok], bins) / np.maximum(n, 1)
        value[i] = np.bincount(at[ok], y[ok], bins) / np.maximum(n, 1)
        count[i] = n
    typical = (time * count).sum(axis=0) / np.maximum(count.sum(axis=0), 1)
    return np.where(count > 0, time, typical), value, count


def rebin(channel: Channel, samples: Samples, bins: Sequence[Index], die: tuple[Array, ...], each: int) -> Channel:
    """The channel on one sample in `each`; bins that no run fills any longer are left out."""
    bin_of = _renumbered(bins)
    time, value, count = bin_means([t for t, _ in samples], [y for _, y in samples], bin_of)
    die_c = np.full(time.shape, np.nan)
    if die:
        die_c = np.where(count > 0, bin_means([t for t, _ in samples], list(die), bin_of)[1], np.nan)
    return replace(
        channel,
        time_s=time,
        value=value,
        count=count,
        die_c=die_c,
        samples=tuple(samples),
        bin_of=bin_of,
        die_samples=die,
        sampling_period_s=round(each * channel.sampling_period_s, 4),
        readings_per_sample=each * channel.readings_per_sample,
    )


def as_single_samples(channel: Channel, times: Sequence[Array] | None = None) -> Channel:
    """The channel with every sample a bin of its own, dated `times` where that is not when it was logged."""
    dated = [t for t, _ in channel.samples] if times is None else times
    width = max(t.size for t in dated)
    shape = (channel.runs, width)
    time, value, count = np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=np.int64)
    die = np.full(shape, np.nan)
    for i, (t, (_, y), at) in enumerate(zip(dated, channel.samples, channel.bin_of, strict=True)):
        time[i, : t.size], value[i, : t.size], count[i, : t.size] = t, y, at >= 0
        time[i, t.size :] = t[-1]
        if channel.die_samples:
            die[i, : t.size] = channel.die_samples[i]
    return replace(channel, time_s=time, value=value, count=count, die_c=die)


def log_bins(time_s: Array, values: Array, bins: int = 24) -> tuple[Array, Array]:
    """Means of `values` (n,) in bins of equal width in log time from 0.05 s on; empty bins are left out."""
    time_s, values = np.asarray(time_s, dtype=float), np.asarray(values, dtype=float)
    keep = (time_s >= 0.05) & np.isfinite(values)
    time_s, values = time_s[keep], values[keep]
    if time_s.size == 0:
        return np.empty(0), np.empty(0)
    edges = np.geomspace(0.05, max(time_s.max(), 0.1) * 1.0001, bins + 1)
    where = np.digitize(time_s, edges) - 1
    count = np.bincount(where, minlength=bins)[:bins]
    filled = count > 0
    mean_time = np.bincount(where, time_s, minlength=bins)[:bins][filled] / count[filled]
    mean = np.bincount(where, values, minlength=bins)[:bins][filled] / count[filled]
    return mean_time, mean
