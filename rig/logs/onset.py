"""When a change began, as one channel saw it, and how well that is known.

A line (what the channel was doing) plus two lags in series behind a step at t0 is fitted to the readings around the
change, for all t0 and time constants of a grid; what is stated is the mean and the spread of t0 over all of them,
weighted by how well they fit. So a start between two readings is known to the distance of the readings, and a slow
start is known as badly as a dead time can be told from a second lag.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.rig.logs.changes import ChangePoint, LogPiece

Array = NDArray[np.float64]

LINE_READINGS = 10  # that tell how a channel was under way before a change
LEVEL_WIDTHS = 3.5  # of the window that shows a change, before it: the level there; as many blocks as show the change
FITTED_POINTS = 120  # of readings, or means of them, that a fit takes
FEWEST_INDEPENDENT = 8.0  # independent ones that they count for at least
STARTS, LAGS = 41, 13
LAG_RATIOS = (0.0, 0.05, 0.15, 0.4, 0.99)  # of the second time constant to the first
# A body that is warmed from its surface hides the start of it: the core of a sphere shows 1 % of the step only after a
# fifth of its t63 (Carslaw and Jaeger 1959, eq. 9.3(5)), and is timed late by as much. Which body it is is not known.
HIDDEN_SHARE = 0.2
SETTLED_T63 = 3.0  # times to 63 % that a lag takes to 95 %
LEAST_EXPONENT = -700.0  # of an exponent: what is left is nothing, and numbers that underflow take four times as long
GOOD_FIT = 0.015  # rms of what the lags leave, as a share of the readings' range


@dataclass(frozen=True)
class StepOnset:
    """What one channel did at a step: when it began (s on the log's clock, one standard uncertainty), from which level
    to which, and the time to 63 % of that; `row_s` is how far the two readings are apart between which all of it lies,
    0 where others lie on the way. `beyond` is how far readings went beyond both levels until it had settled.
    """

    channel: str
    quantity: str
    at_s: float
    uncertainty_s: float
    before: float
    after: float
    t63_s: float
    row_s: float = 0.0
    beyond: float = 0.0

    @property
    def size(self) -> float:
        return self.after - self.before

    @property
    def reached_s(self) -> float:
        """When 63 % of the way were behind it, on the log's clock."""
        return self.at_s + self.t63_s


def fit_onset(channel: LogPiece, change: ChangePoint, since_s: float, until_s: float) -> StepOnset:
    """Fit the start of a change.

    Parameters
    ----------
    channel : Channel
    change : Change
    since_s, until_s : float
        From the change before (or the channel's first reading) to the next one (or its last), in s of the log.
    """
    time_s, value, period = channel.time_s, channel.value, channel.period_s
    early = change.time_s - 1.5 * change.width_s
    rested_s = since_s + 0.5 * (change.time_s - since_s) if since_s > time_s[0] else since_s
    stretch = (time_s >= max(rested_s, change.time_s - 8.0 * change.width_s)) & (time_s <= max(early, rested_s))
    if stretch.sum() < 3:
        stretch = (time_s >= since_s) & (time_s < change.time_s - 0.5 * period)
    last = stretch & (time_s >= change.time_s - LEVEL_WIDTHS * change.width_s)  # of what drifted: where it began
    rest = value[last if last.sum() >= 3 else stretch]
    last_before = max(int(np.searchsorted(time_s, change.time_s)) - 1, 0)
    before = float(np.median(rest)) if rest.size else float(value[last_before])
    following = (time_s > change.time_s) & (time_s <= until_s)
    later_s, later = time_s[following], value[following]
    after = _settled(later_s - change.time_s, later, before)
    if after is None and stretch.sum() >= LINE_READINGS:
        # What was under way before and goes on hides the level: without the line through the readings before, for as
        # long as that was seen.
        since, line_s = later_s - change.time_s, change.time_s - float(time_s[stretch][0])
        slope, level = np.polyfit(time_s[stretch] - change.time_s, value[stretch], 1)
        flat, seen = later - slope * since, since <= line_s
        settled = _settled(since[seen], flat[seen], level)
        if settled is not None and abs(settled - level) >= channel.least:
            before, after, later_s, later = float(level), settled, later_s[seen], flat[seen]
    if after is None:
        after = (
            float(np.median(later[later_s >= change.time_s + 0.9 * (later_s[-1] - change.time_s)]))
            if later.size
            else before
        )
    most_s = reached(later_s, later, before, after, 0.7, until_s) - change.time_s
    reach_s = min(max(most_s, 0.0) + 2.0 * change.width_s, until_s - change.time_s)
    noise = max(channel.noise, 1e-3 * abs(after - before))
    while True:
        moments, readings = _around(channel, change, since_s, reach_s)
        low = max(change.time_s - 2.0 * change.width_s, float(moments[0]))
        high = min(change.time_s + change.width_s, float(moments[-1]))
        lags_s = np.geomspace(0.1 * period, max(4.0 * reach_s, period), LAGS)
        starts_s = np.linspace(low, high, STARTS)
        at_s, spread_s, left = _posterior(moments, readings, starts_s, lags_s, noise)
        # What two lags cannot follow (stages, an overshoot, air that changes) is not let in to spoil the start.
        if left <= max(2.0 * noise, GOOD_FIT * float(np.ptp(readings))) or reach_s <= 1.5 * change.width_s:
            break
        reach_s *= 0.5
    low, high = max(low, at_s - 4.0 * spread_s - period), min(high, at_s + 4.0 * spread_s + period)
    at_s, spread_s, _ = _posterior(moments, readings, np.linspace(low, high, STARTS), lags_s, noise)
    reached_s = reached(later_s, later, before, after, 1.0 - np.exp(-1.0), until_s)
    t63_s = max(reached_s - at_s, 0.0)
    uncertainty_s = float(np.hypot(np.hypot(spread_s, HIDDEN_SHARE * t63_s), 0.1 * period))
    row_s = row_between(channel, at_s, reached_s)
    way = later[(later_s >= at_s) & (later_s <= at_s + SETTLED_T63 * t63_s)]  # without a drift that was taken off
    beyond = float(np.abs(way - np.clip(way, min(before, after), max(before, after))).max(initial=0.0))
    return StepOnset(channel.name, channel.quantity, at_s, uncertainty_s, before, after, t63_s, row_s, beyond)


def row_between(channel: LogPiece, begin_s: float, end_s: float) -> float:
    """How far the readings before `end_s` and from it on are apart; 0 where one lies between `begin_s` and it."""
    place = int(np.searchsorted(channel.time_s, end_s))
    if not 0 < place < channel.time_s.size or channel.time_s[place - 1] > begin_s:
        return 0.0
    return float(channel.time_s[place] - channel.time_s[place - 1])


def _around(channel: LogPiece, change: ChangePoint, since_s: float, reach_s: float) -> tuple[Array, Array]:
    """Times and readings to fit: as much of them before the change as the rise takes, at most `FITTED_POINTS`."""
    time_s, value = channel.time_s, channel.value
    lead_s = max(4.0 * change.width_s, reach_s)
    if since_s > time_s[0]:
        since_s += 0.3 * (change.time_s - since_s)  # what the change before left behind
    inside = (time_s >= max(change.time_s - lead_s, since_s)) & (time_s <= change.time_s + reach_s)
    if inside.sum() < 6:
        near = int(np.searchsorted(time_s, change.time_s))
        inside = np.zeros(time_s.size, dtype=bool)
        inside[max(0, near - 4) : near + 4] = True
    return _thinned(time_s[inside], value[inside])


def _settled(since_s: Array, value: Array, before: float) -> float | None:
    """The level that a move comes to: from when on it changes by less than a tenth over three times as long as it took.

    A slow drift or ramp that follows is no part of it. None where it never does.
    """
    if value.size < 3:
        return float(np.median(value)) if value.size else before
    if since_s[-1] <= 0:
        return None
    excursion = float(np.abs(value - before).max())
    spacing_s = float(since_s[1] - since_s[0])
    for took_s in np.geomspace(max(since_s[2], since_s[-1] / 1e5), since_s[-1] / 2.0, 120):
        apart_s, near_s = since_s - took_s, max(0.1 * took_s, spacing_s)
        near = value[apart_s.searchsorted(-near_s) : apart_s.searchsorted(near_s, "right")]
        until_s = max(4.0 * took_s, 2.0 * took_s + spacing_s)
        later = value[since_s.searchsorted(1.8 * took_s) : since_s.searchsorted(until_s, "right")]
        if not near.size or not later.size:
            continue
        there = _median(near)
        way = abs(there - before)
        if way < 0.5 * excursion or abs(later[-1] - there) >= 0.2 * way:
            continue
        then = _median(later)
        if abs(then - there) < 0.1 * way:
            return then
    return None


def _median(value: Array) -> float:
    """As numpy's, which on a few readings takes ten times as long."""
    half = value.size // 2
    if value.size % 2:
        return float(np.partition(value, half)[half])
    low, high = np.partition(value, (half - 1, half))[half - 1 : half + 1]
    return float(0.5 * (low + high))


def reached(time_s: Array, value: Array, before: float, after: float, share: float, else_s: float) -> float:
    """When a share of the way is first behind for good (for three readings in a row)."""
    if time_s.size == 0 or after == before:
        return else_s
    done = (value - before) / (after - before) >= share
    held = done.copy()
    for shift in (1, 2):
        held[:-shift] &= done[shift:]
    first = np.flatnonzero(held)
    return float(time_s[first[0]]) if first.size else else_s


def _thinned(time_s: Array, value: Array) -> tuple[Array, Array]:
    """Means of neighbouring readings, so that at most `FITTED_POINTS` are left."""
    group = int(np.ceil(time_s.size / FITTED_POINTS))
    if group <= 1:
        return time_s, value
    whole = time_s.size // group * group
    return time_s[:whole].reshape(-1, group).mean(axis=1), value[:whole].reshape(-1, group).mean(axis=1)


def _posterior(time_s: Array, value: Array, starts_s: Array, lags_s: Array, noise: float) -> tuple[float, float, float]:
    """Mean and standard deviation of t0 over the grid, and the rms of what the best fit leaves."""
    n = time_s.size
    line = np.linalg.qr(np.column_stack([np.ones(n), time_s - time_s.mean()]))[0]
    rest = value - line @ (line.T @ value)
    power = np.empty((starts_s.size, lags_s.size, len(LAG_RATIOS)))
    along = np.empty(power.shape)
    for k, start_s in enumerate(starts_s):  # one by one: all of them together do not fit a processor's cache
        shapes = _shapes(time_s - start_s, lags_s, line)
        power[k] = (shapes**2).sum(axis=-1)
        along[k] = shapes @ rest
    with np.errstate(invalid="ignore", divide="ignore"):
        gained = np.where(power > 1e-12 * n, along**2 / power, 0.0)
    left = np.maximum(rest @ rest - gained, 0.0) + 0.5 * n * noise**2
    left = np.maximum(left, np.finfo(float).tiny)  # a reading that never moves is explained by anything
    best = np.unravel_index(int(np.argmin(left)), left.shape)
    shape = _shapes(time_s - starts_s[best[0]], lags_s, line)[best[1:]]
    residual = rest - along[best] / max(float(power[best]), 1e-300) * shape
    energy = float(residual @ residual)
    together = float(residual[1:] @ residual[:-1]) / energy if energy > 0 else 0.0
    # Residuals that hang together, of noise or of a shape that the lags have not, count for as many fewer readings.
    effective = max(n * (1.0 - max(together, 0.0)) / (1.0 + max(together, 0.0)), 0.25 * n, FEWEST_INDEPENDENT)
    weight = np.exp(-0.5 * effective * (np.log(left) - np.log(left.min()))).sum(axis=(1, 2))
    weight /= weight.sum()
    mean = float(weight @ starts_s)
    width = float(starts_s[1] - starts_s[0]) if starts_s.size > 1 else 0.0
    spread = float(np.sqrt(weight @ (starts_s - mean) ** 2 + width**2 / 12.0))
    return mean, spread, float(np.sqrt(energy / n))


def _shapes(since_s: Array, lags_s: Array, line: Array) -> Array:
    """Step responses of two lags in series, the second `LAG_RATIOS` < 1 times the first, less what a line explains.

    Of n moments since the start: (lags, ratios, n).
    """
    since_s, first_s, ratio = np.maximum(since_s, 0.0), lags_s[:, None, None], np.array(LAG_RATIOS)[:, None]
    slow = np.exp(np.maximum(-since_s / first_s, LEAST_EXPONENT))
    shapes = -since_s / np.maximum(first_s * ratio, 1e-12)
    np.exp(np.maximum(shapes, LEAST_EXPONENT, out=shapes), out=shapes)
    shapes *= ratio
    np.subtract(slow, shapes, out=shapes)
    shapes /= 1.0 - ratio
    np.subtract(1.0, shapes, out=shapes)
    shapes -= (shapes @ line) @ line.T
    return np.asarray(shapes)
