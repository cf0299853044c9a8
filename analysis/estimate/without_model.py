"""What readings show without any model: their noise, the step that a log is rounded to, when a run began that nobody
triggered, and whether some runs were in another medium.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel

SAME_READING = 1e-9  # of a unit
LEAST_CHANGES = 50
STEPS_APART = 3.0  # rounding steps by which readings of which most repeat differ, where it is not rounding
COARSE_STEPS = 1.5  # times the sensor's own step, from which on rounding says something
ON_STEP = 0.04  # of a step by which readings may miss it
LEAST_EVEN = 6  # distinct readings, from which on those that stand evenly, but not on multiples, are told from chance
LEAST_PRINTED = 16  # distinct readings, from which on a step with fewer digits than it has is told from chance
LEAST_DIGITS = 3.0  # last digits in such a step
MAD_TO_SIGMA = 1.4826  # standard deviations in the median of a normal variable's absolute value


def white_noise(value: NDArray[np.float64]) -> float:
    """Standard deviation of independent noise, from the differences of readings in a row; a few jumps do not count."""
    return MAD_TO_SIGMA * float(np.median(np.abs(np.diff(value)))) / float(np.sqrt(2.0))


def missed_by_line(time_s: NDArray[np.float64], value: NDArray[np.float64]) -> NDArray[np.float64]:
    """What each reading (..., n) at times (n,) misses the line between its neighbours by (..., n - 2), scaled to the
    readings' noise: on a slow curve, however far apart they stand, nothing else is in it (Gasser, Sroka and
    Jennen-Steinmetz 1986, 10.1093/biomet/73.3.625)."""
    width = time_s[2:] - time_s[:-2]
    share = np.divide(time_s[1:-1] - time_s[:-2], width, out=np.full(width.size, 0.5), where=width > 0.0)
    missed = value[..., 1:-1] - (1.0 - share) * value[..., :-2] - share * value[..., 2:]
    return np.asarray(missed / np.sqrt(1.0 + (1.0 - share) ** 2 + share**2))


def curved_noise(time_s: NDArray[np.float64], value: NDArray[np.float64]) -> float:
    """Standard deviation of independent noise about a slow curve; a few jumps do not count."""
    return MAD_TO_SIGMA * float(np.median(np.abs(missed_by_line(time_s, value))))


def mostly_repeats(channel: Channel, step: float) -> bool:
    """Whether most readings are the one before over again, by more than rounding to `step` makes them."""
    moved = np.abs(np.concatenate([np.diff(value) for _, value in channel.samples]))
    changed = moved[moved > SAME_READING]
    if changed.size < LEAST_CHANGES or changed.size > 0.5 * moved.size:
        return False
    return float(np.median(changed)) > STEPS_APART * step


def rounding_step(channel: Channel) -> float:
    """Step to which all readings are rounded [channel's unit]; 0 where none is found.

    They need not be its multiples: a calibration or a converter's zero comes after the rounding. Readings that are no
    codes at all stand evenly with a probability of (2 `ON_STEP`)^(n - 2).
    """
    values = np.unique(np.round(np.concatenate([y for _, y in channel.samples]), 6))
    gaps = np.diff(values)
    gaps = gaps[gaps > 2e-4]
    if gaps.size < 3:
        return 0.0
    # Counted from gap to gap, so that the digits that a file leaves out do not add up over thousands of steps.
    near = gaps[gaps < 1.3 * np.quantile(gaps, 0.02)]
    smallest = float(near.mean())
    for step in smallest / np.arange(1, 4):
        whole = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(values) / step))])
        if np.ptp(whole) < 3:
            continue
        step, zero = (float(x) for x in np.polyfit(whole, values, 1))
        off = np.quantile(np.abs(values - step * np.rint(values / step)), 0.97)
        if values.size >= LEAST_EVEN:
            off = min(off, np.quantile(np.abs(values - zero - step * whole), 0.97))
        if off < max(ON_STEP * step, 1.2e-4) and step > 3e-4:
            return step
    return _step_in_few_digits(values)


def _step_in_few_digits(values: NDArray[np.float64]) -> float:
    """Step of readings printed with fewer digits than it has, sixteenths of a degree as 25.06, 25.13; 0 where none is.

    `values` (n,) are distinct and sorted [unit]. Readings that are no multiples of anything all lie within half of the
    last digit of one with a probability of (digit / step)^n.
    """
    digit = next((d for d in (0.1, 0.01, 0.001) if np.allclose(values, d * np.rint(values / d), 0.0, 1e-6)), 0.0)
    if not digit or values.size < LEAST_PRINTED:
        return 0.0
    gaps = np.diff(values)
    # One step is printed as two lengths, a digit apart. The more steps have been counted the longer a gap can be told.
    step = float(gaps[gaps < gaps.min() + 1.5 * digit].mean())
    if step < LEAST_DIGITS * digit:
        return 0.0
    steps = span = 0.0
    for gap in np.sort(gaps):
        steps, span = steps + np.rint(gap / step), span + gap
        step = span / steps
    whole = np.cumsum(np.rint(np.append(values[0], gaps) / step))
    unsure = int(abs(values[0]) * digit / (span * step)) + 1
    found = (0.6 * digit, 0.0)  # half a digit, and what the fit lacks
    for codes in (whole + shift for shift in range(-unsure, unsure + 1)):
        step = float(values @ codes / (codes @ codes))
        found = min(found, (float(np.abs(values - step * codes).max()), step))
    return found[1]


def coarser_than_the_sensor(channel: Channel, step: float) -> bool:
    """Whether readings rounded to `step` are coarser than what the sensor resolves, where that is known."""
    return channel.known_sensor and step >= COARSE_STEPS * channel.quantity.resolution


def known_to(step: float) -> float:
    """Standard uncertainty of a rounding step that all readings share."""
    return max(0.002 * step, 1e-5)


Array = NDArray[np.float64]

# When a run that nobody triggered began, and how fast its sensor is: from the shape of the readings alone.
#
# A start is looked for over the whole record: the plateau before it is level, what follows is a sum of relaxations
# that begin at it, and the start that leaves least is taken.

STARTS_TRIED = 160  # starts that are tried over a record, before the search narrows
SCAN_NARROWINGS = 3
SCAN_POINTS = 700  # of a record, beyond which it is averaged for the scan
RELAXATION_ROUNDS = 5
STEP_IN_NOISE = 10.0  # a smaller change is no step to time
EXACT_MISFIT = 1e-30  # sum of squares of what fits exactly
FEWEST_READINGS = 8  # of a run: its own start and airs, a rate, and as many again to tell them from noise


def estimate_start(time_s: Array, value: Array) -> float | None:
    """Start of the transient in one trace (n,) [s]; None where no step stands out of the noise.

    It is the first reading's time where the record begins in the transient: where no later start fits better than by
    chance (Schwarz 1978, 10.1214/aos/1176344136).
    """
    if time_s.size < FEWEST_READINGS:
        return None
    noise = curved_noise(time_s, value)
    tail = max(value.size // 20, 3)  # a response may be over soon after the first readings
    lowest, highest = np.quantile(value, [0.01, 0.99])
    step = max(abs(float(np.median(value[-tail:]) - np.median(value[:tail]))), 0.0)
    if step < max(STEP_IN_NOISE * noise, 0.3 * (highest - lowest), 1e-9):
        return None
    low, high = first, last = float(time_s[0]), float(time_s[-4])
    best = low
    for _ in range(1 + SCAN_NARROWINGS):
        starts = np.linspace(low, high, STARTS_TRIED)
        # Near the start single samples count; far from it their averages do.
        time, level, count = _thinned(time_s, value, 0.5 * (low + high), 2.0 * (high - low))
        costs = _misfits(time, level, count, starts)
        best = float(starts[int(np.argmin(costs))])
        reach = 3.0 * (high - low) / STARTS_TRIED
        low, high = max(best - reach, first), min(best + reach, last)
    if best <= time_s[1]:  # a level that one reading gives is no plateau
        return first
    # How well so few relaxations meet one of another speed depends on where they begin, by as much as the readings do.
    beside = time_s[np.searchsorted(time_s, best) + np.array([-1, 0])]
    at_once, *later = _misfits(time_s, value, np.ones(time_s.size), np.array([first, best, *beside]))
    gained = np.log(max(at_once, EXACT_MISFIT) / max(min(later), EXACT_MISFIT))
    return best if time_s.size * gained > np.log(time_s.size) else first


def _thinned(time: Array, value: Array, middle: float, reach: float) -> tuple[Array, Array, Array]:
    """The record with what is far from the middle averaged, (time, value, samples in each)."""
    if time.size <= SCAN_POINTS:
        return time, value, np.ones(time.size)
    near = np.abs(time - middle) < reach
    group = np.arange(time.size) // (1 + time.size // (SCAN_POINTS // 2))
    if near.sum() < SCAN_POINTS:
        group = np.where(near, group.max() + 1 + np.arange(time.size), group)
    _, group = np.unique(group, return_inverse=True)
    count = np.bincount(group).astype(float)
    order = np.argsort(np.bincount(group, time) / count, kind="stable")
    return tuple((x / count)[order] for x in (np.bincount(group, time), np.bincount(group, value))) + (count[order],)


def _misfits(time: Array, value: Array, count: Array, starts: Array) -> Array:
    """Weighted sums of squares (S,) of a level and, from each start on, relaxations of all speeds."""
    first = np.searchsorted(time, starts, side="right")  # of the times after each start
    enough = time.size - first >= 3
    out = np.full(starts.size, np.inf)
    starts, first = starts[enough], first[enough]
    longest = time[-1] - starts
    shortest = np.maximum(time[first + 2] - starts, 1e-4 * longest)
    taus = np.geomspace(shortest, np.maximum(longest, 1.1 * shortest), RELAXATION_ROUNDS, axis=1)
    root = np.sqrt(count)
    late = np.maximum(time - starts[:, None], 0.0)
    basis = np.empty((starts.size, time.size, 1 + RELAXATION_ROUNDS))
    basis[..., 0] = 1.0
    basis[..., 1:] = -np.expm1(-late[..., None] / taus[:, None])
    basis *= root[:, None]
    weighted = value * root
    left = []
    for one in basis:
        coefficients, *_ = np.linalg.lstsq(one, weighted, rcond=1e-9)
        left.append(float(((weighted - one @ coefficients) ** 2).sum()))
    out[enough] = left
    return out


def since_seen(time_s: Array) -> Array:
    """Times [s] since the change is seen to begin: at 0, the start, or a reading before the first of a record that
    begins in the response."""
    begun_s = float(time_s[0] - np.median(np.diff(time_s))) if time_s.size > 1 else 0.0
    return time_s - max(begun_s, 0.0)


def half_way_s(time_s: Array, value: Array) -> float:
    """Time since the change is seen to begin to half of the way between the plateau before it and the last readings
    [s]."""
    time_s = since_seen(time_s)
    before, after = value[time_s < 0], time_s >= 0
    if not before.size and time_s.size:  # the record begins in the transient
        before = value[:1]
    if not before.size or after.sum() < 5:
        return float("nan")
    level, end = float(np.median(before)), float(np.median(value[-max(value.size // 20, 3) :]))
    share = (value[after] - level) * np.sign(end - level)
    # The median of a few readings in a row, so that one spike is no crossing.
    smooth = np.concatenate([[share[:2].mean()], np.median(sliding_window_view(share, 3), axis=1), [share[-2:].mean()]])
    beyond = smooth > 0.5 * abs(end - level)
    return float(time_s[after][np.argmax(beyond)]) if beyond.any() else float("nan")


def resolved_half_way_s(time_s: Array, value: Array) -> float:
    """The same, and at least half of the time between readings."""
    return float(np.maximum(half_way_s(time_s, value), 0.5 * np.median(np.diff(time_s))))


MEDIA_FACTOR = 3.0  # between the two kinds of runs: more than airflows of one bench make
SPREAD_WITHIN = 0.5  # of that gap, as a ratio: what either kind may spread over
FEWEST_RUNS = 2  # runs of either kind


def runs_elsewhere(half_s: Array, conditions: Sequence[Array | NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """Runs (R,) that are not of the kind that most are; none where all are alike, or a condition tells them apart.

    Parameters
    ----------
    half_s : ndarray (R,)
        Time to half of each run's step [s]; NaN where it has none.
    conditions : sequence of ndarray (R,) of float or bool
        What was recorded of the runs and may make them faster: where the two kinds lie on either side of a value of
        one, that explains them. NaN is not recorded.
    """
    none = np.zeros(half_s.size, dtype=bool)
    told = np.flatnonzero(np.isfinite(half_s) & (half_s > 0.0))
    if told.size < 2 * FEWEST_RUNS:
        return none
    order = told[np.argsort(half_s[told])]
    logs = np.log(half_s[order])
    cut = int(np.argmax(np.diff(logs))) + 1
    fast, slow = order[:cut], order[cut:]
    gap = logs[cut] - logs[cut - 1]
    widest = max(np.ptp(logs[:cut]), np.ptp(logs[cut:]))
    if min(fast.size, slow.size) < FEWEST_RUNS or gap < np.log(MEDIA_FACTOR) or widest > SPREAD_WITHIN * gap:
        return none
    for condition in conditions:
        here, there = np.asarray(condition, dtype=float)[fast], np.asarray(condition, dtype=float)[slow]
        if here.min() > there.max() or here.max() < there.min():
            return none
    found = none.copy()
    found[slow if slow.size < fast.size else fast] = True
    return found


def as_fast_as_seen(
    name: str, those: Callable[[Channel], NDArray[np.bool_]], lowest: float, highest: float
) -> Callable[[Channel], dict[str, float]]:
    """A start for a fit, from the channel: {name: how many times as fast `those` runs are as the rest, by their times
    to half of their steps}, within bounds; empty where these tell nothing."""

    def start(channel: Channel) -> dict[str, float]:
        half = np.array([resolved_half_way_s(time, value) for time, value in channel.samples])
        told, apart = np.isfinite(half), those(channel)
        if not (told & apart).any() or not (told & ~apart).any():
            return {}
        ratio = np.median(half[told & ~apart]) / np.median(half[told & apart])
        return {name: float(np.clip(ratio, lowest, highest))}

    return start
