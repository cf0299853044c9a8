"""Jumps of the air and of its slope: through a door, into a layer. Turbulence and bending trends cannot make them.

At a sample where one would explain far more than chance (its size over its sigma, from the smoother's own auxiliary
residuals), the air is let jump by as much, where between its neighbours the readings like it best; again until none is
left.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from shockrig.analysis.flight.prior import Prior
from shockrig.analysis.flight.smoother import Jumps
from shockrig.analysis.flight.sweep import Sweep, Track, costs, lags_behind, swept

Array = NDArray[np.float64]
JUMP_SIGMAS = 6.0
SEARCH_ROUNDS = 4
MOST_JUMPS = 12  # in a block of a flight; what has more of them is not calm air with doors in it
LOOK_BACK, LOOK_AHEAD = 60, 150  # samples that a jump's place is judged by
APART_SAMPLES = 5  # samples
STEPS = (-1, 0, 1)  # samples about the one found
WIDEST_IN_NOISE = 1e4  # times the noise: beyond, a double's digits do not reach from one to the other
FINER = (-0.075, -0.05, -0.025, 0.0, 0.025, 0.05, 0.075)  # about the best of them
SETTLED_LAGS = 4.0  # time constants after which a jump's place no longer shows
LONGEST_HIDDEN = 10  # samples
RAMP_SAMPLES = (2, 4, 7, 12, 20)  # samples: half of what a change may take that looks like a jump
PLACES_IN_STEP = (0.1, 0.3, 0.5, 0.7, 0.9)  # shares of the step
KNOWN_SIGMAS = 2.0
KNOWN_APART = 3.0  # samples within which a jump that another sensor saw is the same one
BELIEVED_NATS = 4.5  # of log-likelihood that it may cost: three sigmas


def none(count: int) -> Jumps:
    """No jumps at `count` nodes."""
    return Jumps(np.zeros((count, 2)), np.full(count, 0.5))


def when(track: Track, jumps: Jumps) -> Array:
    """Times [s] of the jumps of the air itself, not of its slope."""
    nodes = np.flatnonzero(jumps.variance[:, 0])
    return track.time_s[nodes] - (1.0 - jumps.place[nodes]) * track.period_s


def with_jumps(
    track: Track,
    values: Array,
    variance: Array,
    local: Prior,
    refit: Callable[[Array], Prior],
    known_s: Array,
) -> tuple[Sweep, Prior, Jumps]:
    """Sweep, strengths (fitted anew by `refit` to the readings without the jumps) and the jumps.

    `known_s` (j,) are times at which a faster sensor saw the air jump: there, if anywhere near.
    """
    jumps = none(values.size)
    found = swept(track, values, variance, local, jumps)
    typical = local.each(lambda strength: np.full(values.size, np.median(strength)))
    guess = lags_behind(values, track.along, track.period_s, track.broken)
    for number in range(SEARCH_ROUNDS):
        places = _places(track, variance, found.jump_score, known_s if number == 0 else np.zeros(0))
        if not places.size or np.count_nonzero(jumps.variance) + places.size > MOST_JUMPS:
            break
        for k in places:
            # before air as calm as it is elsewhere, a jump has its place most sharply
            jumps = _best(track, values, variance, typical, jumps, int(k), found.jump[k], known_s, guess)
        found = swept(track, values, variance, local, jumps, found)
        if number == 0:
            local = refit(without(track, values, found, jumps))
            found = swept(track, values, variance, local, jumps)
    return found, local, jumps


def _places(track: Track, variance: Array, score: Array, known_s: Array) -> NDArray[np.int64]:
    """Nodes whose score is beyond chance and the largest around; less will do where the air is known to have jumped. In
    a gap there is one at most."""
    size = np.abs(np.nan_to_num(score)).max(axis=1)
    at = np.unique(np.minimum(np.searchsorted(track.time_s, known_s), size.size - 1))
    places = [int(k) for k in at if size[max(k - 1, 0) : k + 2].max() > KNOWN_SIGMAS]
    largest = maximum_filter1d(size, 2 * APART_SAMPLES + 1, mode="nearest")
    reading = np.cumsum(np.append(False, np.isfinite(variance)))  # how many came before each node
    for k in np.flatnonzero((size > JUMP_SIGMAS) & (size >= largest)).tolist():
        if all(abs(k - other) > APART_SAMPLES and reading[k] != reading[other] for other in places):
            places.append(k)
    return np.array(places, dtype=np.int64)


def _best(
    track: Track,
    values: Array,
    variance: Array,
    local: Prior,
    jumps: Jumps,
    near: int,
    size: Array,
    known_s: Array,
    guess: tuple[Array, Array],
) -> Jumps:
    """The jumps with one more near a node: of the air, of its slope, or a ramp; `size` (2,) as found, placed where it
    makes the readings most likely."""
    most = min(float(np.ptp(values)), WIDEST_IN_NOISE * float(local.noise[near]))
    size = np.clip(np.abs(size), 0.0, [most, most / track.period_s])
    ends = np.append(np.flatnonzero(track.broken), values.size)
    stretch = int(np.searchsorted(ends, near, side="right"))
    nodes = np.arange(max(near - LOOK_BACK, ends[stretch - 1]), min(near + LOOK_AHEAD, ends[stretch]))
    here = Jumps(jumps.variance[nodes], jumps.place[nodes])
    tried = []

    def try_with(*added: tuple[int, int, float, float]) -> None:
        """One more candidate; each of its jumps is (node, kind, size, place)."""
        if any(not nodes[0] < k <= nodes[-1] or jumps.variance[k].any() for k, *_ in added):
            return
        one = Jumps(here.variance.copy(), here.place.copy())
        for k, kind, height, place in added:
            one.variance[k - nodes[0], kind], one.place[k - nodes[0]] = height**2, place
        tried.append(one)

    def chosen(one: Jumps) -> Jumps:
        all_of_them = Jumps(jumps.variance.copy(), jumps.place.copy())
        all_of_them.variance[nodes], all_of_them.place[nodes] = one.variance, one.place
        return all_of_them

    apart = np.abs(known_s - track.time_s[near]) / track.period_s
    for at_s in known_s[apart <= KNOWN_APART]:
        k = min(int(np.searchsorted(track.time_s, at_s)), values.size - 1)
        try_with((k, 0, size[0], float(np.clip(1.0 - (track.time_s[k] - at_s) / track.period_s, 0.0, 1.0))))
    known = len(tried)
    for beside in STEPS:
        for place in PLACES_IN_STEP:
            try_with((near + beside, 0, size[0], place))
        try_with((near + beside, 1, size[1], 0.5))
    for half in RAMP_SAMPLES:
        slope = size[0] / (2 * half * track.period_s)
        for beside in (0, half // 2, -(half // 2)):
            try_with((near + beside - half, 1, slope, 0.5), (near + beside + half, 1, slope, 0.5))
    if not tried:
        return jumps
    cost = costs(track, values, variance, local, tried, nodes, guess)
    if known and cost[:known].min() <= cost.min() + BELIEVED_NATS:
        return chosen(tried[int(np.argmin(cost[:known]))])
    best = tried[int(np.argmin(cost))]
    added = np.flatnonzero((best.variance != here.variance).any(axis=1))
    if added.size > 1 or not best.variance[added[0], 0]:
        return chosen(best)
    tried = []
    for place in best.place[added[0]] + np.array(FINER):
        one = Jumps(best.variance, best.place.copy())
        one.place[added[0]] = place
        tried.append(one)
    return chosen(tried[int(np.argmin(costs(track, values, variance, local, tried, nodes, guess)))])


def without(track: Track, values: Array, found: Sweep, jumps: Jumps) -> Array:
    """Readings without what the sensor shows of the jumps, bridged where it shows most how roughly they are placed."""
    rest, shown = values.copy(), np.ones(values.size, dtype=bool)
    ends = np.append(np.flatnonzero(track.broken)[1:], values.size)
    for k, kind in zip(*np.nonzero(jumps.variance), strict=True):
        if not np.isfinite(found.jump_score[k, kind]) or found.jump[k, kind] == 0.0:
            continue
        # variance times what the readings after it ask for
        size = jumps.variance[k, kind] * found.jump_score[k, kind] ** 2 / found.jump[k, kind]
        modes = track.along.modes(int(k))
        until = int(ends[np.searchsorted(ends, k, side="right")])
        since = track.time_s[k:until] - track.time_s[k] + (1.0 - jumps.place[k]) * track.period_s
        decay = np.exp(-np.outer(since, modes.rate))
        if kind == 0:
            rest[k:until] -= size * (1.0 + decay @ modes.amplitude)
        else:
            rest[k:until] -= size * (since + (1.0 - decay) @ (modes.amplitude / modes.rate))
        lasting = int(np.ceil(SETTLED_LAGS / (modes.rate.min() * track.period_s)))
        shown[k : k + min(lasting, LONGEST_HIDDEN)] = False
    nodes = np.arange(values.size)
    return np.interp(nodes, nodes[shown], rest[shown])
