"""One sweep of the smoother over a channel: each stretch from its first node to its last.

A stretch is never cut: where a window begins anew, nothing but a guess says where the lags stand, and a sensor slower
than the window never gets over it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from shockrig.analysis.flight.air_prior import UNSEEN_VARIANCE, Passing, Prior
from shockrig.analysis.flight.response import LagResponse
from shockrig.analysis.flight.smoother import Jumps, Smoothed, followed, smooth

Array = NDArray[np.float64]
JUDGED_NODES = (250, 25)  # nodes over which surprises are counted together
SURPRISE_SIGMAS = 3.0  # of chance, that their mean square is beyond 1
GAP_NODES = 5  # fewer may lie between two readings of a slow log
CUT_SHORT = 0.1  # of a jump: what modes that are left out do to the first reading after it
GAP_REACH = 2.0  # times how far the lags were behind at a gap's start


@dataclass(frozen=True)
class Track:
    """A channel's nodes (m,): samples with the gaps filled.

    Attributes
    ----------
    time_s : ndarray (m,)
    period_s : float
    along : Response
        With a row for each node.
    passing : Passing or None
    broken : ndarray (m,)
        Where a stretch begins that nothing before it tells about; the first node is one.
    memory : int
        Nodes that the sensor remembers.
    """

    time_s: Array
    period_s: float
    along: LagResponse
    passing: Passing | None
    broken: NDArray[np.bool_]
    memory: int

    @property
    def stretches(self) -> list[slice]:
        """Nodes of each stretch."""
        ends = [*np.flatnonzero(self.broken).tolist(), self.time_s.size]
        return [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]


@dataclass(frozen=True)
class Sweep:
    """What a sweep gives at each node (m,): as `Smoothed`, with the variance of the air widened where it surprises."""

    air: Array
    variance: Array
    clean: Array
    clean_variance: Array
    jump: Array
    jump_score: Array
    cost: Array


def swept(
    track: Track,
    values: Array,
    variance: Array,
    local: Prior,
    jumps: Jumps,
    before: Sweep | None = None,
    scored: bool = True,
) -> Sweep:
    """Smooth all stretches, or where one was `before` those with jumps in them.

    `values` (m,) are readings with gaps bridged, `variance` (m,) theirs, infinite where there is none. Unless it is to
    be `scored`, no jumps are looked for where there are none yet.
    """
    guess = lags_behind(values, track.along, track.period_s, track.broken)
    parts: list[Sweep] = []
    for stretch in track.stretches:
        if before is not None and not jumps.variance[stretch].any():
            parts.append(Sweep(*(getattr(before, f.name)[stretch] for f in fields(Sweep))))
            continue
        nodes = np.arange(stretch.start, stretch.stop)[None]
        here = Jumps(jumps.variance[None, stretch], jumps.place[None, stretch])
        found = _smoothed(track, values, variance, local, here, nodes, guess, scored=scored)
        part = Sweep(*(getattr(found, f.name)[0] for f in fields(Sweep)))
        wider = inflation(found.surprise[0]) * part.variance + UNSEEN_VARIANCE * local.turbulence[stretch] ** 2
        parts.append(replace(part, variance=wider))
    return Sweep(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Sweep)))


@dataclass(frozen=True)
class Neighbourhood:
    """Some neighbouring `nodes` (m,) of a track, with all readings and their variances (n,), and the air's prior there;
    `guess` is where the lags stand (`lags_behind`)."""

    track: Track
    values: Array
    variance: Array
    local: Prior
    guess: tuple[Array, Array]
    nodes: NDArray[np.int64]

    def costs(self, tried: Sequence[Jumps], off: Array | float = 0.0) -> Array:
        """Minus the log-likelihood (t,) of the readings under each of the jumps, which are of those nodes, and with the
        sensor `off` (t, m) by so much."""
        jumps = Jumps(np.stack([one.variance for one in tried]), np.stack([one.place for one in tried]))
        at = np.tile(self.nodes, (len(tried), 1))
        given = self.track, self.values, self.variance, self.local
        return _smoothed(*given, jumps, at, self.guess, True, off=off).cost.sum(axis=1)

    def surprises(self, jumps: Jumps, off: Array) -> tuple[float, Array]:
        """Minus the log-likelihood of the readings with those jumps, and how much each of them surprises (t, m), in
        its sigmas, with the sensor `off` (t, m) by so much; the former is of the first."""
        here = Jumps(*(np.broadcast_to(one, (len(off), *one.shape)) for one in (jumps.variance, jumps.place)))
        given = self.track, self.values, self.variance, self.local
        found = _smoothed(*given, here, np.tile(self.nodes, (len(off), 1)), self.guess, True, off=off)
        return float(found.cost[0].sum()), np.nan_to_num(found.surprise)

    def misfit(self, jumps: Jumps, off: Array) -> float:
        """Mean square of how much the readings surprise, in their sigmas, with those jumps and with the sensor `off`
        (1, m) by so much."""
        given = self.track, self.values, self.variance, self.local
        here = Jumps(jumps.variance[None], jumps.place[None])
        found = _smoothed(*given, here, self.nodes[None], self.guess, off=off)
        return float(np.nanmean(found.surprise**2))


def _smoothed(
    track: Track,
    values: Array,
    variance: Array,
    local: Prior,
    jumps: Jumps,
    at: NDArray[np.int64],
    guess: tuple[Array, Array],
    only_cost: bool = False,
    scored: bool = True,
    off: Array | float = 0.0,
) -> Smoothed:
    """Rows of neighbouring nodes `at` (w, n) with jumps (w, n) in them, their readings `off` (w, n) by so much; `guess`
    is where the lags stand (`lags_behind`)."""
    # neighbours: of one row a part of the arrays does, which copies nothing
    rows = (None, slice(int(at[0, 0]), int(at[0, -1]) + 1)) if len(at) == 1 else at
    step = np.diff(track.time_s[rows], axis=1, prepend=track.time_s[at[:, :1]])
    prior = local.each(lambda strength: strength[rows])
    along = track.along.at(rows)
    noise = variance[rows]
    if jumps.variance[..., 0].any():
        # what modes that are left out do is over faster than what any that is taken does
        over = np.exp(-2.0 * along.rate.max(axis=-1) * step * (1.0 - jumps.place))
        noise = noise + CUT_SHORT**2 * over * jumps.variance[..., 0]
    lags, apart = guess
    first = at[:, 0]
    spread = 2.0 * np.std(values[at[:, : track.memory]], axis=1)
    # over a gap the air went from where it was to about where the reading is, and what lags is in between
    before = np.maximum(first - 1, 0)
    gone = np.abs(values[first] - values[before]) + GAP_REACH * apart[before].max(axis=1) + np.sqrt(np.mean(apart**2))
    spread = np.where(track.broken[first] & (first > 0), np.minimum(gone, spread), spread) + 5.0 * prior.noise[:, 0]
    here = None if track.passing is None else replace(track.passing, sigma=track.passing.sigma[rows])
    # what came before a flight is not known; later the readings tell how far the lags may be from their guess
    lag_spread = np.where(track.broken[first][:, None], spread[:, None], apart[first] + 5.0 * prior.noise[:, :1])
    return smooth(
        step, values[rows] - off, noise, along, lags[first], prior, spread, here, lag_spread, jumps, only_cost, scored
    )


def lags_behind(
    values: Array, along: LagResponse, period: float, broken: NDArray[np.bool_] | None = None
) -> tuple[Array, Array]:
    """Each lag behind evenly spaced `values` (n, K) from rest, and how far the two were apart in the lag's memory, rms.

    Behind the readings it is a guess of where the sensor stands: the air is about as far from the reading as that.
    Where values are `broken` (n,) nothing before tells, and lags start from rest again.
    """
    starts = [] if broken is None else [k for k in np.flatnonzero(broken).tolist() if k]
    if starts:
        parts = [lags_behind(one, along, period) for one in np.split(values, starts)]
        behind, far = zip(*parts, strict=True)
        return np.concatenate(behind), np.concatenate(far)
    decay = np.exp(-np.mean(along.rate, axis=0) * period)
    lags, apart = (np.empty((values.size, decay.size)) for _ in range(2))
    inside = range(decay.size)[along.within]
    for k, d in enumerate(decay.tolist()):
        drive = lags[:, : len(along.cap)] @ np.asarray(along.cap) if k in inside else values
        lags[:, k] = lag = followed(drive, d, float(drive[0]))
        apart[:, k] = np.sqrt(followed((drive - lag) ** 2, d, 0.0))
    return lags, apart


def as_lagged(values: Array, along: LagResponse, period: float) -> Array:
    """What a sensor shows (n,) of evenly spaced `values` (n,) that it lags behind from rest."""
    lags, _ = lags_behind(values, along, period)
    return np.asarray((lags * along.weight).sum(axis=1))


def forgotten(moves: Array, lag_s: float, period: float) -> Array:
    """Values (n,) whose `moves` (n,), each since the one before, are forgotten with a time constant of `lag_s`."""
    keep = float(np.exp(-period / lag_s))
    return followed(moves, keep, 0.0) / (1.0 - keep)


def inflation(surprise: Array) -> Array:
    """Factor on each node's variance (n,): mean square surprise around it where it is larger than chance makes it, else
    1; over few nodes or many, whichever is more, and in a gap that of the reading behind it."""
    seen, factor = ~np.isnan(surprise), np.ones(surprise.size)
    square = np.where(seen, surprise, 0.0) ** 2
    for nodes in JUDGED_NODES:
        place = np.arange(surprise.size) // nodes
        count = np.maximum(np.bincount(place, seen), 1)
        mean_square = np.bincount(place, square) / count
        sure = mean_square > 1.0 + SURPRISE_SIGMAS * np.sqrt(2.0 / count)
        factor = np.maximum(factor, np.where(sure, mean_square, 1.0)[place])
    ends = np.flatnonzero(np.diff(seen.astype(int), prepend=1, append=1))
    first, behind = ends[::2], ends[1::2]
    told = behind < surprise.size
    told[told] &= (square[behind[told]] > 1.0 + SURPRISE_SIGMAS * np.sqrt(2.0)) & ((behind - first)[told] > GAP_NODES)
    for a, b in zip(first[told].tolist(), behind[told].tolist(), strict=True):
        factor[a:b] = np.maximum(factor[a:b], square[b])
    return factor


# Readings coarser than their noise: each says that the sensor was within half a step of it, and no more.
#
# The likelihood of a reading y of step q is Phi((y + q/2 - z) / s) - Phi((y - q/2 - z) / s) of the sensor's z under
# noise s. Expectation propagation (Minka 2001, arXiv 1301.2294) makes it the Gaussian with the same moments beside all
# other readings, so that the smoother stays what it is.

COARSE_IN_NOISE = 2.0  # times the noise: finer steps are noise like any other
MOST_ROUNDS = 30
NEWTON_DAMPING = 0.7  # of each round's step, halved where the rounds do not come to rest: neighbours say the same thing
SETTLING_FACTOR = 0.7  # of what the round before moved it by: more is no coming to rest
AT_REST = 0.02  # of a step, that a round moves the sensor by
SHARPEST_SIGMA = 0.1  # of a step
REACH_IN_NOISE = 2.0  # times the noise
VAGUE_VARIANCE = 1e4  # a reading's variance is at most so many times its step's square


def propagated(
    sweep: Callable[[Array, Array], Sweep],
    values: Array,
    variance: Array,
    step: Array,
    noise: Array,
    begin: tuple[Array, Array] | None = None,
    at_rest: float = AT_REST,
) -> tuple[Sweep, tuple[Array, Array]]:
    """Readings (m,) and variances as the Gaussians that stand for their intervals, variance infinite where none is;
    and, before them, the sweep that they give.

    `sweep` smooths such readings, `step` and `noise` (m,) are of each; `begin` are Gaussians near the ones looked for,
    which are `at_rest` where they move the sensor by less of a step.
    """
    seen = np.isfinite(variance)
    site, site_variance = (one.copy() for one in begin or (values, variance))
    damping, before, moved = NEWTON_DAMPING, values, np.inf
    for _ in range(MOST_ROUNDS):
        found = sweep(site, site_variance)
        last, moved = moved, float(np.max(np.abs(found.clean - before)[seen] / step[seen], initial=0.0))
        before = found.clean
        if moved < at_rest:
            return found, (site, site_variance)
        site[~seen] = found.clean[~seen]
        if moved > SETTLING_FACTOR * last:
            damping *= 0.5
        precision, shift = 1.0 / site_variance[seen], site[seen] / site_variance[seen]
        mean, of_others = _by_the_others(found, site, site_variance, step, seen)
        others = 1.0 / of_others
        tilted, tilted_variance = within(values[seen], step[seen], noise[seen], mean, of_others)
        # no reading says more than its noise lets it
        finest = 1.0 / (noise[seen] ** 2 + (SHARPEST_SIGMA * step[seen]) ** 2)
        new = np.clip(1.0 / tilted_variance - others, 1.0 / (VAGUE_VARIANCE * step[seen] ** 2), finest)
        # nor does it pull from farther than where it could have come from, however far the others are
        reach = 0.5 * step[seen] + REACH_IN_NOISE * noise[seen]
        centre = tilted + others / new * (tilted - mean)
        new_shift = new * np.clip(centre, values[seen] - reach, values[seen] + reach)
        precision = (1 - damping) * precision + damping * new
        shift = (1 - damping) * shift + damping * new_shift
        site_variance[seen], site[seen] = 1.0 / precision, shift / precision
    return sweep(site, site_variance), (site, site_variance)


def log_likelihood(found: Sweep, site: Array, site_variance: Array, values: Array, step: Array, noise: Array) -> Array:
    """What each (m,) of the rounded readings `values` (m,) adds to the log-likelihood, 0 where there is none; for their
    intervals the Gaussians `site` (m,) stand, which gave `found`."""
    seen = np.isfinite(site_variance)
    mean, of_others = _by_the_others(found, site, site_variance, step, seen)
    # each interval over its Gaussian, as all others put the sensor there; and all of the Gaussians
    wide = of_others + site_variance[seen]
    of_gaussian = -0.5 * (np.log(wide) + (site[seen] - mean) ** 2 / wide)
    of_interval = _tails(values[seen], step[seen], noise[seen], mean, of_others)[-1]
    told = -found.cost
    told[seen] += of_interval - of_gaussian
    return told


def _by_the_others(
    found: Sweep, site: Array, site_variance: Array, step: Array, seen: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Mean and variance of what the sensor shows where it was `seen` (m,), by all Gaussians but the one there."""
    own = np.maximum(found.clean_variance[seen], 1e-12 * step[seen] ** 2)
    others = np.maximum(1.0 / own - 1.0 / site_variance[seen], 1e-6 / step[seen] ** 2)
    return (found.clean[seen] / own - site[seen] / site_variance[seen]) / others, 1.0 / others


def within_a_step(time_s: Array, level: Array, step: Array, noise: Array, memory_s: float) -> Array:
    """Variance (m,) that the air keeps at least, where no change of level is nearer than `memory_s`.

    Steady air may lie anywhere within a step where no noise would carry the reading over its edge, and many readings
    alike say no more of it than one. Levels are NaN where nothing was read.
    """
    rows = np.flatnonzero(np.isfinite(level))
    changed = time_s[rows[np.flatnonzero(np.diff(level[rows]))]]
    bounds = np.concatenate([[-np.inf], changed, [np.inf]])
    after = np.searchsorted(bounds, time_s)
    apart = np.minimum(bounds[after] - time_s, time_s - bounds[after - 1])
    return np.where(apart > memory_s, np.maximum(0.5 * step - REACH_IN_NOISE * noise, 0.0) ** 2 / 3.0, 0.0)


def within(reading: Array, step: Array, noise: Array, mean: Array, variance: Array) -> tuple[Array, Array]:
    """Mean and variance of z ~ N(mean, variance), given that z + noise was rounded to `reading`; shapes kept."""
    wide, flip, low, high, mass = _tails(reading, step, noise, mean, variance)
    at_low, at_high = (np.exp(-0.5 * x**2 - 0.5 * np.log(2 * np.pi) - mass) for x in (low, high))
    first = (at_low - at_high) * np.where(flip, -1.0, 1.0)
    second = low * at_low - high * at_high
    share = variance / wide
    return mean + share * first, np.maximum(variance + share**2 * (second - first**2), 1e-9 * variance)


def _tails(
    reading: Array, step: Array, noise: Array, mean: Array, variance: Array
) -> tuple[Array, NDArray[np.bool_], Array, Array, Array]:
    """Sigma of z + noise; whether its interval is flipped to the lower tail, which keeps its digits; the ends of that
    in sigmas; and the logarithm of its probability."""
    wide = np.sqrt(variance + noise**2)
    low, high = ((reading + sign * 0.5 * step - mean) / wide for sign in (-1.0, 1.0))
    flip = low > 0
    low, high = np.where(flip, -high, low), np.where(flip, -low, high)
    top, bottom = log_ndtr(high), log_ndtr(low)
    return wide, flip, low, high, top + np.log1p(-np.exp(np.minimum(bottom - top, -1e-300)))
