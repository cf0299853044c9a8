"""What single readings show without any model: coarse rounding, repeats without the stale flag, flat tops, averages.

Each finding brings its parameters and, where the rest of the diagnosis must know, a channel mended for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects.saturation_clipping import LEAST_CUT_PERCENT, highest_air_percent
from shockrig.analysis.inference.channel import Channel, bin_means
from shockrig.analysis.inference.noise import Noise

Array = NDArray[np.float64]

NORMAL_STEP = {"temperature": 0.01, "humidity": 100.0 / 16383.0}  # the sensors' own resolution
COARSE = 1.5  # rounding is named from this many times the normal step on
LEAST_PILE = 12  # readings at one ceiling that make a flat top


@dataclass(frozen=True)
class Finding:
    """An effect that the readings themselves show: its id, its parameters as (value, standard uncertainty),
    evidence."""

    effect: str
    parameters: dict[str, tuple[float, float]]
    evidence: str


def find_rounding(channel: Channel) -> tuple[float, Finding | None]:
    """Step to which all readings are rounded [channel's unit] (0 if none is found), and the finding if it is coarse."""
    values = np.unique(np.round(np.concatenate([y for _, y in channel.samples]), 6))
    gaps = np.diff(values)
    gaps = gaps[gaps > 2e-4]
    if gaps.size < 3:
        return 0.0, None
    # Counted from gap to gap, so that the digits that a file leaves out do not add up over thousands of steps.
    near = gaps[gaps < 1.3 * np.quantile(gaps, 0.02)]
    smallest = float(near.mean())
    for step in smallest / np.arange(1, 4):
        whole = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(values) / step))])
        if np.ptp(whole) < 3:
            continue
        step = float(np.polyfit(whole, values, 1)[0])
        off = np.abs(values - step * np.rint(values / step))
        if np.quantile(off, 0.97) < max(0.04 * step, 1.2e-4) and step > 3e-4:
            break
    else:
        return 0.0, None
    normal = NORMAL_STEP[channel.name]
    if step < COARSE * normal:
        return step, None
    unit = "K" if channel.name == "temperature" else "%RH"
    return step, Finding(
        "quantization",
        {"step": (step, max(0.002 * step, 1e-5))},
        f"all readings are multiples of {step:.4g} {unit}, the sensor resolves {normal:.3g} {unit}",
    )


def find_repeats(channel: Channel) -> tuple[Channel, Finding | None]:
    """Readings that stand several times without the flag; the channel returned keeps the first of each."""
    period = channel.sampling_period_s
    grids = []
    for time, value in channel.samples:
        index = np.rint((time - time[0]) / period).astype(int)
        changed = np.flatnonzero(np.abs(np.diff(value)) > 1e-9) + 1
        grids.append((index, index[changed], changed))
    changes = sum(c.size for _, c, _ in grids)
    samples = sum(i.size for i, _, _ in grids)
    if changes < 50 or changes > 0.7 * samples:
        return channel, None
    best = 1
    for hold in range(2, 41):
        at_phase = [np.bincount(c % hold, minlength=hold).max() if c.size else 0 for _, c, _ in grids]
        if sum(at_phase) >= 0.96 * changes:
            best = hold
    if best == 1:
        return channel, None
    kept_samples, kept_die, kept_bins = [], [], []
    for run, (time, value) in enumerate(channel.samples):
        index, changed, _ = grids[run]
        phase = int(np.argmax(np.bincount(changed % best, minlength=best))) if changed.size else 0
        block = (index - phase) // best
        # Only a row that stands where its block begins is known to be fresh.
        fresh = (index - phase) % best == 0
        fresh &= np.diff(block, prepend=block[0] - 1) > 0
        kept_samples.append((time[fresh], value[fresh]))
        kept_bins.append(channel.bin_of[run][fresh])
        if channel.die_samples:
            kept_die.append(channel.die_samples[run][fresh])
    mended = rebin(channel, tuple(kept_samples), tuple(kept_bins), tuple(kept_die), best * period)
    return mended, Finding(
        "stale_samples",
        {"hold_samples": (float(best), 0.05)},
        f"readings change only every {best} rows, always at the same phase, and the stale flag is not set",
    )


def rebin(channel: Channel, samples, bins, die, period: float) -> Channel:
    """The channel on fewer samples; bins that no run fills any longer are left out."""
    filled = np.unique(np.concatenate(bins))
    filled = filled[filled >= 0]
    renumber = np.full(int(filled.max()) + 2, -1)
    renumber[filled] = np.arange(filled.size)
    bin_of = tuple(renumber[b] for b in bins)
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
        samples=samples,
        bin_of=bin_of,
        die_samples=die,
        sampling_period_s=round(period, 4),
    )


def find_flat_top(channel: Channel, step: float) -> Finding | None:
    """A ceiling at which readings pile up, above which none lies."""
    if channel.name != "humidity":
        return None
    everything = np.concatenate([y for _, y in channel.samples])
    top = float(everything.max())
    tolerance = 1e-4
    at_top = np.abs(everything - top) < tolerance
    # Without a ceiling the highest readings thin out: as many just below it as at it is what rounding does.
    width = max(step, 2 * tolerance)
    below = ((everything < top - tolerance) & (everything > top - 3.5 * width)).sum() / 3.0
    longest = max((_longest_run(np.abs(y - top) < tolerance) for _, y in channel.samples), default=0)
    if at_top.sum() < LEAST_PILE or longest < 6 or at_top.sum() < 8 * max(below, 1.0):
        return None
    if abs(top - highest_air_percent(channel)) < LEAST_CUT_PERCENT + 0.5 * step:
        return None  # the plateaus in the most humid air stand at one code
    return Finding(
        "saturation_clipping",
        {"limit_percent": (top, max(step / np.sqrt(12.0), 1e-3))},
        f"{int(at_top.sum())} readings stand at exactly {top:.2f} %RH, {longest} in a row, and none above",
    )


def _longest_run(mask: NDArray[np.bool_]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return int((edges[1::2] - edges[::2]).max()) if edges.size else 0


def find_average(channel: Channel, noise: Noise) -> Finding | None:
    """A running mean in the logger, from the correlation of the noise."""
    if noise.averaged == 1:
        return None
    likelihood = noise.log_likelihood_by_average
    gain = float(likelihood[noise.averaged - 1] - likelihood[0])
    return Finding(
        "moving_average",
        {"samples": (float(noise.averaged), 0.1)},
        f"the plateaus' noise is that of a mean over {noise.averaged} readings "
        f"(log likelihood {gain:+.0f} against plain noise)",
    )
