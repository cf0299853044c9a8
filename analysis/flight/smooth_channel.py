"""One channel through the smoother: nodes for samples and gaps, a prior for each, and back to the rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_opening, maximum_filter1d, median_filter, uniform_filter1d

from shockrig.analysis.estimate.without_model import MAD_TO_SIGMA
from shockrig.analysis.flight.air_prior import (
    Passing,
    Prior,
    fit_prior,
    fit_windows,
    gain_squared,
    seen,
    spectra,
    without_wave,
)
from shockrig.analysis.flight.likeliest import likeliest
from shockrig.analysis.flight.ramps import LONGEST_RAMP, NEIGHBOURS, Break, told_of_breaks
from shockrig.analysis.flight.response import LagResponse
from shockrig.analysis.flight.smoother import Jumps
from shockrig.analysis.flight.stretches import MOST_SHARE, largest_beside, largest_share
from shockrig.analysis.flight.sweep import (
    AT_REST,
    Neighbourhood,
    Sweep,
    Track,
    lags_behind,
    log_likelihood,
    propagated,
    swept,
    within_a_step,
)

Array = NDArray[np.float64]

# Jumps of the air and of its slope: through a door, into a layer. Turbulence and bending trends cannot make them.
#
# At a sample where one would explain far more than chance (its size over its sigma, from the smoother's own auxiliary
# residuals), the air is let jump by as much, where between its neighbours the readings like it best; again until none
# is left.

JUMP_SIGMAS = 6.0
SEARCH_ROUNDS = 4
MOST_JUMPS = 12  # in a block of a flight; what has more of them is not calm air with doors in it
LOOK_BACK, LOOK_AHEAD = 60, 150  # samples that a jump's place is judged by
APART_SAMPLES = 5  # samples
TINY_SHARE = 1e-3  # of a reading's variance, that the others leave of it at least
COMPARABLE_SHARE = 0.5  # of the largest score within LOOK_BACK
WIDEST_IN_NOISE = 1e4  # times the noise: beyond, a double's digits do not reach from one to the other
BETWEEN_SAMPLES = (-0.075, -0.05, -0.025, 0.0, 0.025, 0.05, 0.075)  # about the best of them
SETTLED_LAGS = 4.0  # time constants after which a jump's place no longer shows
LONGEST_HIDDEN = 10  # samples
PLACES_IN_STEP = (0.1, 0.3, 0.5, 0.7, 0.9)  # shares of the step
KNOWN_SIGMAS = 2.0
KNOWN_APART = 3.0  # samples within which a jump that another sensor saw is the same one
PLACES_IN_GAP, ALIKE_NATS = 12, 2.0  # that are tried; of log-likelihood, within which none is better: two sigmas
BELIEVED_NATS = 4.5  # of log-likelihood that it may cost: three sigmas
OWN_NEIGHBOURS = (-2, -1, 0, 1, 2)  # samples about the one found, that a sensor's own step is looked for at
MOST_SURPRISE = 3.0  # mean square, of the readings about such a step: where nothing explains them it is none


def none(count: int) -> Jumps:
    """No jumps at `count` nodes."""
    return Jumps(np.zeros((count, 2)), np.full(count, 0.5))


def when(track: Track, jumps: Jumps) -> Array:
    """Times [s] of the jumps of the air itself, of none that is somewhere in a gap, or likelier a ramp; of one just
    before or behind a reading that is between both."""
    level, bend = jumps.variance.T
    first, behind = np.flatnonzero(np.diff(level > 0.0, prepend=False, append=False)).reshape(-1, 2).T
    bends = np.flatnonzero(bend > 0.0)
    found = []
    for a, b in zip(first.tolist(), behind.tolist(), strict=True):
        if b - a > 2 or bend[a:b].any():  # what a bend may be misplaced by is no jump
            continue
        before, after = bends[bends < a][:, None], bends[bends >= b]
        lasting = track.time_s[after] - track.time_s[before]
        gone = np.where(lasting <= LONGEST_RAMP * track.period_s, lasting, 0.0) ** 2
        if level[a:b].sum() >= np.max(gone * np.minimum(bend[before], bend[after]), initial=0.0):
            found.append((a, b - 1))
    nodes = np.array(found, dtype=np.int64).reshape(-1, 2).T
    return np.asarray((track.time_s[nodes] - (1.0 - jumps.place[nodes]) * track.period_s).mean(axis=0))


def breaks(track: Track, jumps: Jumps, found: Sweep) -> Array:
    """Times [s] of the jumps and bends that are in, and of what else looks like a jump of the air, each with the sigmas
    that it is of, by the way that the air goes there (b, 2): of one that is in at least `JUMP_SIGMAS`."""
    score = np.nan_to_num(found.jump_score[:, 0])
    # where the air is stronger than it was taken most scores are
    parts = np.split(np.abs(score), np.arange(SEGMENT_SAMPLES, score.size, SEGMENT_SAMPLES))
    usual = [max(MAD_TO_SIGMA * float(np.median(part)), 1.0) for part in parts]
    score = score / np.repeat(usual, [part.size for part in parts])
    near = maximum_filter1d((jumps.variance > 0.0).any(axis=1).astype(int), 2 * APART_SAMPLES + 1) > 0
    largest = maximum_filter1d(np.abs(score), 2 * APART_SAMPLES + 1, mode="nearest")
    seems = np.flatnonzero((np.abs(score) > KNOWN_SIGMAS) & (np.abs(score) >= largest) & ~near)
    # one that is anywhere in a gap or a burst is none that another sensor would show
    anywhere = binary_opening(jumps.variance[:, 0] > 0.0, np.ones(3, dtype=bool))
    put = np.flatnonzero((jumps.variance > 0.0).any(axis=1) & ~anywhere)
    # several close together make one that none of them is; what bends and soon bends back goes one way
    starts: list[int] = []
    for k in put.tolist():
        starts += [k] if not starts or k > starts[-1] + LONGEST_HIDDEN else []
    begin = np.array(starts, dtype=np.int64)
    end = put[np.searchsorted(put, begin + LONGEST_HIDDEN, side="right") - 1]
    before = np.maximum(np.append(0, end)[:-1], np.maximum(begin - LONGEST_RAMP // 2, 0))
    behind = np.minimum(np.append(begin, score.size)[1:] - 1, end + LONGEST_RAMP // 2)
    way = np.sign(found.air[behind] - found.air[before])
    times = track.time_s[begin] - (1.0 - jumps.place[begin]) * track.period_s
    both = np.append(times, track.time_s[seems]), np.append(JUMP_SIGMAS * way, score[seems])
    return np.stack(both, axis=1)[np.argsort(both[0], kind="stable")]


def with_jumps(
    track: Track,
    values: Array,
    variance: Array,
    local: Prior,
    refit: Callable[[Array], Prior],
    known_s: Array,
    loud: NDArray[np.bool_],
    stepped: NDArray[np.bool_],
    jumps: Jumps | None = None,
) -> tuple[Sweep, Prior, Jumps, Array]:
    """Sweep, strengths (fitted anew by `refit` to the readings without the jumps), the jumps beside those that are
    known by now, and the steps (n,) of the sensor itself, without which the readings are swept.

    `known_s` (j, 2) are times between which another sensor saw the air jump: there, if anywhere near. `loud` (n,) are
    readings in bursts of noise, and `stepped` (n,) those where the sensor's own steps are known: about neither is one
    looked for.
    """
    jumps, own = none(values.size) if jumps is None else jumps, np.zeros(values.size)
    found = swept(track, values, variance, local, jumps)
    typical = as_usual(local)
    guess = lags_behind(values, track.along, track.period_s, track.broken)
    for number in range(SEARCH_ROUNDS):
        places = _places(track, variance, found.jump_score, known_s if number == 0 else np.zeros((0, 2)))
        # one that another sensor saw comes first: about it others only seem to be
        beside = _beside(track, places[:, None], known_s).min(axis=1, initial=np.inf)
        if number == 0 and (seen_too := beside <= KNOWN_APART * track.period_s).any():
            places = places[seen_too]
        # one that is somewhere in a gap is one
        known = _stretches(jumps.variance.any(axis=1))
        if known + places.size > MOST_JUMPS:
            # about a large one many seem to be, until it is in
            places = _standing_out(places, found.jump_score)
        places = places[np.argsort(-np.abs(np.nan_to_num(found.jump_score[places])).max(axis=1), kind="stable")]
        # beside a jump of the air that is not in yet all residuals are off
        also = places if places.size else _own_places(track, values, variance, found, stepped | loud | (own != 0.0))
        if not also.size or known + places.size > MOST_JUMPS:
            break
        before = own.copy()
        for k in also.tolist():
            # before air as calm as it is elsewhere, a jump has its place most sharply
            best = _best(track, values, variance, typical, jumps, k, found.jump[k], known_s, guess, loud)
            if isinstance(best, OwnStep):
                own[best.node] += best.size
                values = values - np.where(np.arange(values.size) >= best.node, best.size, 0.0)
                guess = lags_behind(values, track.along, track.period_s, track.broken)
            elif k in places:
                jumps = best
        if not places.size and np.array_equal(own, before):
            break
        found = swept(track, values, variance, local, jumps, None if own.any() else found)
        if number == 0:
            local = refit(without(track, values, found, jumps))
            found = swept(track, values, variance, local, jumps)
    return found, local, jumps, own


def as_usual(local: Prior) -> Prior:
    """Strengths (n,) as they usually are beside the readings' own noise, at each node."""
    return local.each(lambda strength: np.median(strength / local.noise) * local.noise)


def _own_places(
    track: Track, values: Array, variance: Array, found: Sweep, stepped: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Nodes from which on the sensor seems to read more or less than it did, by its readings' residuals: what is left
    of all behind a node, over their variance, is how a step there pulls (its auxiliary residual)."""
    read = np.isfinite(variance)
    pull = np.cumsum(np.where(read, values - found.clean, 0.0)[::-1] / variance[::-1])[::-1]
    for stretch in track.stretches:
        # of a stretch that ends within the flight those behind are none of it
        pull[stretch] -= np.median(pull[stretch])
    usual = MAD_TO_SIGMA * float(np.median(np.abs(pull[read])))
    # where nothing pulls all readings are as the air would have them
    size = np.abs(pull) / usual if usual > 0.0 else np.zeros(pull.shape)
    near = maximum_filter1d(stepped.astype(int), 2 * LOOK_BACK + 1) > 0
    largest = maximum_filter1d(size, 2 * LOOK_BACK + 1, mode="nearest")
    largest[0] = np.inf  # before the first node is nothing that it could step from
    places = np.flatnonzero((size > JUMP_SIGMAS) & (size >= largest) & read & ~near)
    return places if places.size <= MOST_JUMPS else places[:0]


@dataclass(frozen=True)
class OwnStep:
    """A sensor that reads `size` more from a node on than it did, and minus the log-likelihood of the readings
    around."""

    node: int
    size: float
    cost: float


def _own_step(around: Neighbourhood, jumps: Jumps, near: int) -> OwnStep | None:
    """The likeliest step of the sensor itself about a node, between two readings; None where there are no such, where
    one reading by itself is likelier to be off, or where the step leaves the readings as they may not be."""
    nodes, read = around.nodes, np.isfinite(around.variance)
    places = near + np.array(OWN_NEIGHBOURS)
    places = places[(places > nodes[0]) & (places <= nodes[-1])]
    places = places[read[places] & read[places - 1]]
    if not places.size:
        return None
    here = Jumps(jumps.variance[nodes], jumps.place[nodes])
    unit = float(around.local.noise[near])
    # the log-likelihood of readings that are off is a parabola of by how much: all behind, or one by itself
    alone = np.union1d(places - 1, places)
    behind = unit * np.concatenate([nodes >= places[:, None], nodes == alone[:, None]])
    off = np.concatenate([np.zeros((1, nodes.size)), behind, -behind])
    cost = around.costs([here] * len(off), off)
    more, less = cost[1:].reshape(2, -1) - cost[0]
    slope, bend = 0.5 * (more - less), more + less
    if not (bend > 0.0).all():  # beside what the temperature leaves open the readings tell nothing of it
        return None
    # under a variance that is as large as it comes out, as those of the air's jumps are
    size = -slope / bend
    square = bend * size**2
    own = cost[0] - 0.5 * square**2 / (square + 1.0) + 0.5 * np.log1p(square)
    best = int(np.argmin(own))
    if best >= places.size:
        return None
    of_best = size[best] * behind[best : best + 1]
    if around.misfit(here, of_best) > MOST_SURPRISE:
        return None
    return OwnStep(int(places[best]), float(size[best] * unit), float(own[best]))


def _places(track: Track, variance: Array, score: Array, known_s: Array) -> NDArray[np.int64]:
    """Nodes whose score is beyond chance and the largest around; less will do where the air is known to have jumped. In
    a gap there is one at most."""
    size = np.abs(np.nan_to_num(score)).max(axis=1)
    places = []
    for first, last in np.minimum(np.searchsorted(track.time_s, known_s), size.size - 1).tolist():
        around = slice(max(first - 1, 0), last + 2)
        # between two readings of its own a sensor tells as well whether it jumped
        told = first < last and np.isfinite(variance[[first, last]]).all()
        if not told and size[around].max() > KNOWN_SIGMAS:
            places.append(int(np.clip(around.start + np.argmax(size[around]), first, last)))
    places = sorted(set(places))
    read = np.isfinite(variance)
    largest = maximum_filter1d(size, 2 * APART_SAMPLES + 1, mode="nearest")
    reading = np.cumsum(np.append(False, read))  # how many came before each node
    # before a gap a jump at the last reading and one in the gap may be alike
    alike = 0.5 * (size[:-1] ** 2 - size[1:] ** 2) < ALIKE_NATS
    into_gap = np.append(read[:-1] & ~read[1:] & alike, False)
    found = np.flatnonzero((size > JUMP_SIGMAS) & (size >= largest))
    for k in (found + into_gap[found]).tolist():
        if all(abs(k - other) > APART_SAMPLES and reading[k] != reading[other] for other in places):
            places.append(k)
    return np.array(places, dtype=np.int64)


def _beside(track: Track, node: NDArray[np.int64] | int, known_s: Array) -> Array:
    """How long before or behind each of the times `known_s` (j, 2) a node is, or nodes (n, 1): (j,) or (n, j)."""
    at_s = track.time_s[node]
    return np.asarray(np.maximum(known_s[:, 0] - at_s, at_s - known_s[:, 1]))


def _standing_out(places: NDArray[np.int64], score: Array) -> NDArray[np.int64]:
    """Of the nodes those whose score is comparable with the largest around."""
    size = np.abs(np.nan_to_num(score)).max(axis=1)
    return places[size[places] >= COMPARABLE_SHARE * maximum_filter1d(size, 2 * LOOK_BACK + 1)[places]]


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
    loud: NDArray[np.bool_],
) -> Jumps | OwnStep:
    """The jumps with one more near a node: of the air, of its slope, or a ramp; `size` (2,) as found, placed where it
    makes the readings most likely. Or a step of the sensor itself, where no air explains the readings as well.

    In a gap it may have been at any place that the readings behind do not refute, or a ramp that they are a part of. A
    jump at one of several places, each as likely, has the mean and the variance of jumps at all of them that share its
    variance. In a burst of noise it may have been anywhere, and the air may have gone there in any way, unless one
    place is likelier by far.
    """
    most = min(float(np.ptp(values)), WIDEST_IN_NOISE * float(local.noise[near]))
    size = np.clip(np.abs(size), 0.0, [most, most / track.period_s])
    ends = np.append(np.flatnonzero(track.broken), values.size)
    stretch = int(np.searchsorted(ends, near, side="right"))
    read = np.isfinite(variance)
    first, last = near - int(np.argmax(read[:near][::-1])), near + int(np.argmax(read[near:]))
    nodes = np.arange(max(first - LOOK_BACK, ends[stretch - 1]), min(last + LOOK_AHEAD, ends[stretch]))
    around, trials = Neighbourhood(track, values, variance, local, guess, nodes), JumpTrials(jumps, nodes)
    for first_s, last_s in known_s[_beside(track, near, known_s) <= KNOWN_APART * track.period_s].tolist():
        trials.add_within(track, size[0], first_s, last_s)
    known = len(trials.tried)
    # of a ramp that is read from its middle on the readings behind a gap tell
    told = told_of_breaks(around, Jumps(jumps.variance[nodes], jumps.place[nodes]), near, last)
    trials.add_breaks(track, [*told.jumps(size[0]), *told.bends(size[1])])
    around_near = len(trials.tried)
    trials.add_breaks(track, told.ramps(size[0]))
    outside = len(trials.tried)
    places = _in_gap(first, last) if last > first else np.zeros(0, dtype=np.int64)
    if not jumps.variance[first : last + 1, 0].any():
        apart = np.diff(np.append(places, last + 1)).tolist()
        for k, room in zip(places.tolist(), apart, strict=True):
            # about the node it was tried already, place by place
            trials.add((k, 0, size[0], 0.5), within=0.0 if abs(k - near) <= NEIGHBOURS else float(room))
    tried = trials.tried
    if not tried:
        return jumps
    cost = np.array(trials.mean_cost)
    if (others := np.flatnonzero(np.isnan(cost))).size:
        cost[others] = around.costs([tried[k] for k in others])
    if not known and (within := _burst_around(near, loud, read)) is not None and not jumps.variance[within].any():
        anywhere = Jumps(jumps.variance.copy(), jumps.place)
        anywhere.variance[within, 0] = size[0] ** 2 / (within.stop - within.start)
        wide = np.arange(min(nodes[0], within.start), max(nodes[-1] + 1, within.stop))
        here = [
            Jumps(one.variance[wide], one.place[wide])
            for one in (anywhere, trials.with_one(tried[int(np.argmin(cost))]))
        ]
        of_all, of_one = replace(around, nodes=wide).costs(here).tolist()
        # of jumps at one place or another the mean likelihood, of which the best is the most
        if of_all <= of_one - np.log(np.mean(np.exp(cost.min() - cost))) + ALIKE_NATS:
            return anywhere
    if known:
        there = trials.finer(int(np.argmin(cost[:known])))
        of_known = np.append(cost[:known], around.costs(there) if there else [])
        if of_known.min() <= cost.min() + BELIEVED_NATS:
            return trials.with_one([*tried[:known], *there][int(np.argmin(of_known))])
    in_gap = cost[outside:]
    if in_gap.size == places.size > 0 and in_gap.min() <= cost.min() + np.log(outside + 1):
        # the likeliest of many is likelier than it is
        alike = np.flatnonzero(in_gap <= in_gap.min() + ALIKE_NATS)
        if alike[-1] > alike[0]:
            # up to the first that was tried and is refuted
            begins, behind = places[alike[0]], np.append(places, last + 1)[alike[-1] + 1]
            anywhere = Jumps(jumps.variance[nodes], jumps.place[nodes])
            anywhere.variance[begins - nodes[0] : behind - nodes[0], 0] = size[0] ** 2 / (behind - begins)
            straddling = slice(around_near, outside)
            every = np.append(cost[straddling], in_gap.min())
            of_every = np.append(trials.within[straddling], float(behind - begins))
            return trials.with_one(_mixed([*tried[straddling], anywhere], every, of_every))
    # a jump is placed as finely as it shows before it is compared with what has no such place
    if (sharp := np.flatnonzero(trials.single)).size:
        finer = trials.finer(int(sharp[np.argmin(cost[sharp])]))
        of_finer = around.costs(finer) if finer else np.zeros(0)
        tried, cost = tried + finer, np.append(cost, of_finer)
    # they have part in the room of the one that they are about
    room = np.append(trials.within, np.zeros(len(tried) - len(trials.within)))
    if not places.size:
        own = _own_step(around, jumps, near)
        # before the flight is looked at it is as likely in every row, and about one in a flight
        if own is not None and own.cost + np.log(values.size) < cost.min():
            return own
        return trials.with_one(tried[_of_likeliest_way(tried, cost, room)])
    return trials.with_one(_mixed(tried, cost, room))


def _ways(tried: list[Jumps], cost: Array, within: Array) -> tuple[list[int], Array]:
    """The likeliest of what was tried at each node, or pair of them, and the logarithm of how likely all that was tried
    there is together: the mean likelihood over where it may be, times how much room that is (`within`)."""
    alike: dict[bytes, list[int]] = {}
    for k in np.argsort(cost).tolist():
        alike.setdefault((tried[k].variance > 0.0).tobytes(), []).append(k)
    found = [some for some in alike.values() if within[some].any()]
    with np.errstate(divide="ignore"):
        together = [np.logaddexp.reduce(np.log(within[some]) - cost[some]) for some in found]
    return [some[0] for some in found], np.array(together)


def _of_likeliest_way(tried: list[Jumps], cost: Array, within: Array) -> int:
    """The likeliest of what is likelier than the others of a jump, a bend and a ramp, wherever it may be."""
    some, together = _ways(tried, cost, within)
    bends = np.array([np.count_nonzero(tried[k].variance[:, 1]) for k in some])
    kinds = np.unique(bends)
    best = kinds[int(np.argmax([np.logaddexp.reduce(together[bends == kind]) for kind in kinds]))]
    return some[int(np.argmax(np.where(bends == best, together, -np.inf)))]


def _mixed(tried: list[Jumps], cost: Array, within: Array) -> Jumps:
    """What was tried at each node, or pair of them, each with its share of the likelihood: nothing tells between a jump
    in a gap and a ramp, and where all were read nothing is won by it."""
    some, together = _ways(tried, cost, within)
    kept = np.flatnonzero(together >= together.max() - ALIKE_NATS)
    some, share = [some[k] for k in kept.tolist()], np.exp(together[kept] - together.max())
    each = np.array([tried[k].variance for k in some]) * (share / share.sum())[:, None, None]
    at = np.average([tried[k].place for k in some], axis=0, weights=each.sum(axis=2) + np.finfo(float).tiny)
    return Jumps(each.sum(axis=0), at)


def _in_gap(first: int, last: int) -> NDArray[np.int64]:
    """Nodes of a gap at which a jump is tried: evenly, and closer towards its end, since the readings behind say until
    when the sensor had time to follow."""
    even = np.linspace(first, last, PLACES_IN_GAP).astype(int)
    closer = last - 2 ** np.arange(int(np.log2(max(last - int(even[-2]), 1))) + 1)
    return np.unique(np.concatenate([even, closer[closer > first]]))


def _burst_around(near: int, loud: NDArray[np.bool_], read: NDArray[np.bool_]) -> slice | None:
    """Nodes from the first that was read in the burst of noise around a node to the first that was read behind it."""
    calm = np.flatnonzero(read & ~loud)
    after = int(np.searchsorted(calm, near))
    if not 0 < after < calm.size or not loud[calm[after - 1] + 1 : calm[after]].any():
        return None
    return slice(int(calm[after - 1]) + 1, int(calm[after]) + 1)


class JumpTrials:
    """What is tried beside the jumps that are known, at some `nodes` (m,): each is those jumps with one more, and
    `single` says whether that is one of the air."""

    def __init__(self, known: Jumps, nodes: NDArray[np.int64]) -> None:
        self.known, self.nodes = known, nodes
        self.tried: list[Jumps] = []
        self.single: list[bool] = []
        self.bounds: list[tuple[float, float]] = []
        self.within: list[float] = []
        self.mean_cost: list[float] = []

    def add(
        self,
        *added: tuple[int, int, float, float],
        bounds: tuple[float, float] = (0.0, 1.0),
        within: float = 0.0,
        cost: float = np.nan,
    ) -> None:
        """One more; each of its jumps is (node, kind, size, place), and may be placed between `bounds` of its step. It
        stands for all that are `within` so many samples, of which minus the log of the mean likelihood is `cost`."""
        nodes = self.nodes
        if any(not nodes[0] < k <= nodes[-1] or self.known.variance[k].any() for k, *_ in added):
            return
        if not all(height**2 for _, _, height, _ in added):  # a jump by nothing has no place to be looked for
            return
        one = Jumps(self.known.variance[nodes], self.known.place[nodes])
        for k, kind, height, place in added:
            one.variance[k - nodes[0], kind], one.place[k - nodes[0]] = height**2, place
        self.within.append(within)
        self.mean_cost.append(cost)
        self.tried.append(one)
        self.single.append(len(added) == 1 and added[0][1] == 0)
        self.bounds.append(bounds)

    def add_within(self, track: Track, size: float, first_s: float, last_s: float) -> None:
        """A jump of the air at some places between two times, or at one."""
        first, last = np.minimum(np.searchsorted(track.time_s, [first_s, last_s]), track.time_s.size - 1).tolist()
        for k in range(first, last + 1):
            begins_s = track.time_s[k] - track.period_s
            low, high = (float(np.clip((at_s - begins_s) / track.period_s, 0.0, 1.0)) for at_s in (first_s, last_s))
            if np.isclose(low, 1.0) and first < last:  # the other sensor read the air before at this node
                continue
            for place in np.unique(np.clip((0.0, *PLACES_IN_STEP, 1.0), low, high)).tolist():
                self.add((k, 0, size, place), bounds=(low, high))

    def finer(self, number: int) -> list[Jumps]:
        """One of those that were tried with its one jump at places about where it is, as far as it may be."""
        one, (low, high) = self.tried[number], self.bounds[number]
        if low == high:
            return []
        there = (one.variance != self.known.variance[self.nodes]).any(axis=1)
        places = np.unique(np.clip(one.place[there] + np.array(BETWEEN_SAMPLES), low, high))
        return [Jumps(one.variance, np.where(there, place, one.place)) for place in places.tolist()]

    def add_breaks(self, track: Track, breaks: Iterable[Break]) -> None:
        """Jumps of the air, of its slope, and ramps, each with its mean likelihood."""
        for one in breaks:
            node = np.clip(np.searchsorted(track.time_s, one.time_s), 1, track.time_s.size - 1)
            before, step_s = track.time_s[node - 1], track.time_s[node] - track.time_s[node - 1]
            place = np.clip((one.time_s - before) / np.maximum(step_s, np.finfo(float).tiny), 0.0, 1.0)
            added = []
            for k, share, off in zip(node.tolist(), place.tolist(), one.off.tolist(), strict=True):
                added += [(k, one.kind, one.size, share), *([(k, 0, off, share)] if off > 0.0 else [])]
            self.add(*added, within=one.within, cost=one.cost)

    def with_one(self, one: Jumps) -> Jumps:
        """All jumps of the flight with one of those that were tried."""
        both = Jumps(self.known.variance.copy(), self.known.place.copy())
        both.variance[self.nodes], both.place[self.nodes] = one.variance, one.place
        return both


def without(track: Track, values: Array, found: Sweep, jumps: Jumps) -> Array:
    """Readings without what the sensor shows of the jumps, bridged where it shows most how roughly they are placed."""
    rest, shown = values.copy(), np.ones(values.size, dtype=bool)
    for k, kind in zip(*np.nonzero(jumps.variance), strict=True):
        if not np.isfinite(found.jump_score[k, kind]) or found.jump[k, kind] == 0.0:
            continue
        # variance times what the readings after it ask for
        size = jumps.variance[k, kind] * found.jump_score[k, kind] ** 2 / found.jump[k, kind]
        modes = track.along.modes(int(k))
        # behind a break as well: what ended there would be one more bend
        since = track.time_s[k:] - track.time_s[k] + (1.0 - jumps.place[k]) * track.period_s
        decay = np.exp(-np.outer(since, modes.rate))
        if kind == 0:
            rest[k:] -= size * (1.0 + decay @ modes.amplitude)
        else:
            rest[k:] -= size * (since + (1.0 - decay) @ (modes.amplitude / modes.rate))
        lasting = int(np.ceil(SETTLED_LAGS / (modes.rate.min() * track.period_s)))
        shown[k : k + min(lasting, LONGEST_HIDDEN)] = False
    nodes = np.arange(values.size)
    return np.interp(nodes, nodes[shown], rest[shown])


def _stretches(rows: ArrayLike) -> int:
    """How many there are of rows (n,) in a row."""
    return int(np.count_nonzero(np.diff(np.asarray(rows, dtype=int), prepend=0) > 0))


def unseen_jumps(
    track: Track, values: Array, read: NDArray[np.bool_], jumps: Jumps, found: Sweep
) -> tuple[Jumps, float]:
    """The jumps with what the air may have jumped in steps to and from nodes (n,) that were not `read`, and what is to
    be added to minus the log-likelihood under them, since nothing says that it did.

    It jumps there as often as elsewhere in the flight, and the readings around say how likely that is at each step
    (Bayes, the variance of a jump being the likeliest); its variance is the one to be expected. Where the air is read a
    jump shows, so what is no surer than chance is none. Where it is not, air that went steadily from one end to the
    other is one of the explanations.
    """
    between = ~read
    between[1:] |= ~read[:-1]
    between &= ~track.broken
    between &= np.arange(read.size) <= np.max(np.flatnonzero(read), initial=0)
    score, jump = (np.abs(np.nan_to_num(one[:, 0])) for one in (found.jump_score, found.jump))
    step_s = np.maximum(np.diff(track.time_s, prepend=track.time_s[0]), np.finfo(float).tiny)
    count = _stretches(jumps.variance.any(axis=1))
    # of a Poisson process, by Jeffreys' prior; of single readings far apart, over all of the flight
    lasting_s = step_s[~between] if (step_s[~between] > 0.5 * track.period_s).any() else step_s
    rate = (count + 0.5) / float(lasting_s.sum())
    variance, added = jumps.variance.copy(), 0.0
    for first, behind in np.flatnonzero(np.diff(between, prepend=False, append=False)).reshape(-1, 2).tolist():
        square = np.minimum(score[first:behind], WIDEST_IN_NOISE) ** 2
        largest = float(square.max())
        if largest <= 1.0 or jumps.variance[first:behind].any():
            continue
        # of each under the likeliest variance, beside the likelihood without one
        gain = 0.5 * np.where(square > 1.0, square - 1.0 - np.log(np.maximum(square, 1.0)), 0.0)
        odds = np.log(rate * step_s[first:behind]) + gain
        together = np.logaddexp.reduce(np.append(odds, 0.0))
        size = np.minimum(jump[first:behind], np.ptp(values))
        variance[first:behind, 0] = size**2 * np.exp(odds - together)
        in_all = largest * (1.0 - np.exp(-together))
        added += 0.5 * (largest * in_all / (1.0 + in_all) - np.log1p(in_all)) - together
    return (jumps, 0.0) if np.array_equal(variance, jumps.variance) else (Jumps(variance, jumps.place), float(added))


Rows = NDArray[np.int64]
Sites = tuple[Array, Array]  # readings and variances of the Gaussians that stand for intervals
NEARLY_AT_REST = 0.1  # of a step: at rest the likelihood has no slope in what stands for the intervals
MISSED_PERIODS = 1.6  # between two readings: beyond, one is missing
LONGEST_BRIDGE_S = 60.0  # beyond, a gap parts the flight
SEGMENT_S = 25.0  # over which the air's turbulence intensity is taken as one, at least
SEGMENT_LAGS = 12.0  # and so many of the sensor's time constants, or a slow sensor cannot tell it
SEGMENT_SAMPLES = 250  # about which scores of jumps are usual; and at least of a segment in which readings say less
LONGEST_SEGMENT = 500
SHORTEST_SEGMENT = 60
LARGEST_SHARE = 0.4  # of a flight: one inversion does not speak for all of it
PER_LAG = 0.5  # of the sensor's lag: over longer steps the air is not straight, and readings are cut into parts
MOST_PARTS = 5
ODD_FACTOR = 8.0  # times the usual
BRIEF_LAGS = 0.3  # of the sensor's slowest lag
NOISE_SPREAD = 0.3  # ln of how far the noise may be from what is expected
STILL_LAGS = 3.0  # of the sensor: so long after a rounded reading last changed, nothing is left of what that told
MEMORY_LAGS, LEAST_MEMORY_S = 3.0, 8.0  # how far back a sensor remembers
JUMPED_FACTOR = 12.0  # times what readings usually differ by: a jump, where those beside it differ by less than
BESIDE_SHARE = 0.25  # of it
ALONG_ROWS = 31  # that a trend is taken over
LEAST_CALM = 0.5  # of the readings, or bursts are what this flight has
FEWEST_READINGS = 8  # that anything is concluded from
SPARSE_SHARE = 0.97  # share of nodes with a sample, below which the bridges are left out of the judgement


@dataclass(frozen=True)
class Estimate:
    """Arrays (n,): the air, its variance (of the smoother alone) and the clean reading; NaN where too little was
    measured.

    `noise_factor` (n,): fitted over expected noise, one sigma; `cutoff_hz`: of the low-pass, where the method has one;
    `resolved_rate`: angular frequency [1/s] above which the air is not resolved; `amplified`: variance of the reading's
    noise in an inverse's air; `jumps_s`: times at which the air jumped, where the method looks for them, and `breaks`
    (b, 2) at which it or its slope did or seems to have, with the sigmas of a jump; `own_steps`: by how much the sensor
    itself reads more from a row on than before it, where the method looks for that; `cost`: minus the log-likelihood of
    the readings, without its constant, of a method that has one; `staying`: variance, of `variance`, of an error that
    stays for as long as a rounded reading does; `steady`: variance without jumps that nobody saw; `apart`: how far the
    air is from a reading as a rule, one sigma, as strongly as it varies about each row, where the method judges that.
    """

    air: Array
    variance: Array
    clean: Array
    noise_factor: Array
    cutoff_hz: float | None = None
    resolved_rate: float = 30.0
    amplified: float = 0.0
    jumps_s: Array = field(default_factory=lambda: np.zeros(0))
    breaks: Array = field(default_factory=lambda: np.zeros((0, 2)))
    own_steps: Array = field(default_factory=lambda: np.zeros(0))
    cost: float = np.nan
    staying: Array = field(default_factory=lambda: np.zeros(1))
    steady: Array = field(default_factory=lambda: np.zeros(1))
    apart: Array = field(default_factory=lambda: np.ones(1))


def estimate(
    time_s: Array,
    reading: Array,
    usable: NDArray[np.bool_],
    response: LagResponse,
    noise_variance: Array,
    delay_s: float = 0.0,
    passing: Passing | None = None,
    rounding: Array | None = None,
    jumped_s: Array | None = None,
    loud: NDArray[np.bool_] | None = None,
    stepped: NDArray[np.bool_] | None = None,
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
    rounding : (n,), optional
        Step of each reading where it is coarser than the noise; `noise_variance` has its variance, step^2 / 12, in it.
    jumped_s : (j, 2), optional
        Times between which another sensor saw the air jump, or at which, twice.
    loud : (n,), optional
        Readings in bursts of noise: they say nothing of how strongly the air varies.
    stepped : (n,), optional
        Rows from which on the sensor is known to read more or less: about them no such step is looked for.
    """
    on = _on_nodes(time_s, reading, usable, response, delay_s, passing)
    if on is None:
        nothing = np.full(time_s.shape, np.nan)
        return Estimate(nothing, nothing, nothing, np.ones(time_s.shape))
    track, along = on.track, on.track.along
    strengths = _strengths(on, usable, noise_variance, rounding, loud)
    local = strengths(on.bridged)
    noise_factor = local.noise / strengths.noise if rounding is None else np.ones(on.row.shape)
    # in a burst the noise was measured
    variance = noise_variance[on.row] * np.where(strengths.loud, 1.0, noise_factor) ** 2
    variance = np.where(on.measured, np.maximum(variance, (strengths.noise * noise_factor) ** 2), np.inf)
    known_s = np.zeros((0, 2)) if jumped_s is None else jumped_s
    known = np.zeros(on.row.shape, dtype=bool) if stepped is None else stepped[on.row] & on.measured
    found, local, jumps, own = with_jumps(track, on.bridged, variance, local, strengths, known_s, strengths.loud, known)
    on, broken = replace(on, bridged=on.bridged - np.cumsum(own)), breaks(track, jumps, found)
    stays, steady = np.zeros(on.row.shape), found.variance
    if rounding is None:
        brief = _brief(track.time_s, on.measured, BRIEF_LAGS * response.slowest_s)
        also, nats = unseen_jumps(track, on.bridged, _shown(on, strengths.loud), jumps, found)
        found, local = _of_samples(on, variance, brief, noise_factor, jumps, also, found, local, strengths)
    else:
        stairs = _of_stairs(on, variance, noise_variance, rounding, jumps, local, strengths, known_s)
        found, local, stays, nats, steady = stairs.found, stairs.local, stairs.stays, stairs.nats, stairs.steady
        if stairs.more is not None:
            jumps, broken = stairs.more[0], breaks(track, *stairs.more)
    every = found.air, found.variance + stays, found.clean, stays, steady, noise_factor
    air, node_variance, clean, staying, steady, factor = (np.interp(time_s, track.time_s, v) for v in every)
    middle = slice(on.row.size // 2, on.row.size // 2 + 1)
    rate = resolved_rate(as_usual(local).each(lambda strength: strength[middle]), along.at(middle), track.period_s)
    if rounding is not None:
        # for as long as a rounded reading stays, so does what it is off by; that it goes to and fro between two steps
        # while the air goes on by none is noise
        gone = float(np.sum(np.abs(np.diff(air)) / rounding[1:]))
        changes = min(gone, float(np.count_nonzero(np.diff(reading[usable]))))
        rate = min(rate, np.pi * (changes + 1.0) / float(np.ptp(time_s[usable])))
    own_steps = np.zeros(time_s.shape)
    np.add.at(own_steps, on.row[own != 0.0], own[own != 0.0])
    return Estimate(
        air,
        node_variance,
        clean,
        factor,
        resolved_rate=rate,
        jumps_s=when(track, jumps),
        breaks=broken,
        own_steps=own_steps,
        cost=float(found.cost.sum()) + nats,
        staying=staying,
        steady=steady,
        apart=np.interp(time_s, track.time_s, _apart(local, along, track.period_s)),
    )


@dataclass(frozen=True)
class OnNodes:
    """A channel's readings on the nodes (n,) of a track, of which there are so many `parts` to a period of the log.

    `row` is each node's own in the log, or the last one before it; `measured` are nodes with a reading to use, and
    `bridged` is that reading, or what lies between those around; `slowest_s` is the sensor's slowest lag.
    """

    track: Track
    parts: int
    row: Rows
    measured: NDArray[np.bool_]
    bridged: Array
    slowest_s: float


def _on_nodes(
    time_s: Array,
    reading: Array,
    usable: NDArray[np.bool_],
    response: LagResponse,
    delay_s: float,
    passing: Passing | None,
) -> OnNodes | None:
    """Nodes for the samples, the gaps between them and the parts of long steps; None where too little was measured."""
    between = typical_period(time_s)
    parts = int(np.clip(round(between / (PER_LAG * response.slowest_s)), 1, MOST_PARTS))
    period = between / parts
    node_time, own_row = _nodes(time_s - delay_s, period, delay_s)
    measured = (own_row >= 0) & usable[own_row]
    rows = np.flatnonzero(measured)
    if rows.size < FEWEST_READINGS:
        return None
    row = _carried(own_row)
    along = response if np.array_equal(row, np.arange(time_s.size)) else response.at(row)
    broken = np.diff(node_time, prepend=-np.inf) > LONGEST_BRIDGE_S
    through = None if passing is None else replace(passing, sigma=passing.sigma[row])
    memory = SEGMENT_SAMPLES + int(2.0 * max(MEMORY_LAGS * response.slowest_s, LEAST_MEMORY_S) / period)
    track = Track(node_time, period, along, through, broken, memory)
    bridged = np.interp(node_time, node_time[rows], reading[row[rows]])
    return OnNodes(track, parts, row, measured, bridged, response.slowest_s)


def _of_samples(
    on: OnNodes,
    variance: Array,
    brief: NDArray[np.bool_],
    noise_factor: Array,
    jumps: Jumps,
    also: Jumps,
    found: Sweep,
    local: Prior,
    strengths: StrengthsOfFlight,
) -> tuple[Sweep, Prior]:
    """The sweep of readings with fine steps, and its strengths, where `brief` gaps (n,) and lone readings part them;
    with jumps that may `also` have been where nothing was read."""
    changed = also is not jumps
    if on.parts == 1 and brief.any():
        # single samples put together over those that lack between them are not evenly spaced: strengths are judged
        # again with what the sensor would have read there
        noise = strengths.noise
        read = found.clean + noise * noise_factor * np.random.default_rng(0).standard_normal(noise.size)
        read = without(on.track, np.where(brief, read, on.bridged), found, jumps)
        calm = np.zeros(brief.shape, dtype=bool)
        calm[strengths.rows] = True
        local = replace(strengths, rows=np.flatnonzero(calm | brief))(read)
        changed = True
    if changed:
        found = swept(on.track, on.bridged, variance, local, also, scored=False)
    if (alone := _lone_readings(on.track, on.bridged, variance, found, jumps)).any():
        variance = np.where(alone, np.inf, variance)
        found = swept(on.track, on.bridged, variance, local, also, scored=False)
    return found, local


def _shown(on: OnNodes, loud: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Nodes (n,) at which the air's moves show: that were read, out of bursts, and between any two of these as near as
    the log's rows, or as the sensor's lag lets the second tell of what was before it."""
    calm = on.measured & ~loud if (on.measured & ~loud).any() else on.measured
    longest_s = max(on.slowest_s, MISSED_PERIODS * on.parts * on.track.period_s)
    return np.asarray(calm | _brief(on.track.time_s, calm, longest_s))


@dataclass(frozen=True)
class Stairs:
    """What readings in steps show: their sweep and its strengths, the variance (n,) that what stays leaves besides, the
    jumps with those that these strengths alone show and the sweep that has their scores, if any, what jumps that nobody
    saw add to minus the log-likelihood, and the variance (n,) without these."""

    found: Sweep
    local: Prior
    stays: Array
    more: tuple[Jumps, Sweep] | None
    nats: float
    steady: Array


def _of_stairs(
    on: OnNodes,
    variance: Array,
    noise_variance: Array,
    rounding: Array,
    jumps: Jumps,
    local: Prior,
    strengths: StrengthsOfFlight,
    known_s: Array,
) -> Stairs:
    """What readings in steps of `rounding` (rows,) show."""
    steps = rounding[on.row]
    own = np.sqrt(np.maximum(noise_variance[on.row] - steps**2 / 12.0, 0.0))
    given = on.track, on.bridged, variance, steps, own
    found, local, sites = _within_steps(*given, jumps, local, strengths)
    if (share := _share_of_noise(np.round((on.bridged / steps)[on.measured]), (own / steps)[on.measured])) < 1.0:
        less = on.track, on.bridged, variance - (1.0 - share**2) * own**2, steps, share * own
        quiet = _within_steps(*less, jumps, local, strengths)
        both = (found, sites, own), (quiet[0], quiet[2], share * own)
        stated, told = (float(log_likelihood(f, *s, on.bridged, steps, n).sum()) for f, s, n in both)
        # either may be so until the flight is looked at
        if told - stated > np.log(own.size):
            (found, local, sites), given, own = quiet, less, share * own
    # stairs pass for turbulence that is as strong as a jump, so these are looked for once more
    everywhere = np.ones(variance.shape, dtype=bool)
    scored, _, more, _ = with_jumps(
        on.track, *sites, local, lambda _: local, known_s, strengths.loud, everywhere, jumps
    )
    new = None
    if added := _stretches((more.variance != jumps.variance).any(axis=1)):
        with_more, of_more, sites_of_more = _within_steps(*given, more, local, strengths)
        before, behind = (
            float(log_likelihood(one, *of_one, on.bridged, steps, own).sum())
            for one, of_one in ((found, sites), (with_more, sites_of_more))
        )
        # before the flight is looked at each is as likely in every row, and about one in a flight
        if behind - before > added * np.log(own.size):
            found, local, sites, new = with_more, of_more, sites_of_more, (more, scored)
    now = jumps if new is None else more
    also, nats = unseen_jumps(on.track, on.bridged, _shown(on, strengths.loud), now, scored)
    steady = found.variance
    if also is not now:
        found = swept(on.track, *sites, local, also, scored=False)
    level = np.where(on.measured, np.round(on.bridged / steps), np.nan)
    least = within_a_step(on.track.time_s, level, steps, own, STILL_LAGS * on.slowest_s)
    return Stairs(found, local, np.maximum(least - found.variance, 0.0), new, nats, steady)


def _strengths(
    on: OnNodes,
    usable: NDArray[np.bool_],
    noise_variance: Array,
    rounding: Array | None,
    loud: NDArray[np.bool_] | None,
) -> StrengthsOfFlight:
    """What judges the air's strengths, by the readings that say something of them: not those in bursts, nor of vapour
    where the air's temperature jumped."""
    track, calm = on.track, on.measured
    ordinary = np.ones(calm.size, dtype=bool)
    if track.passing is not None:
        # in units of the reading's own noise, and beside those around: up high vapour is a thousandth of that below
        unsure = np.hypot(track.passing.sigma, own := np.sqrt(noise_variance[on.row])) / own
        parts = np.array_split(unsure, max(unsure.size // LONGEST_SEGMENT, 1))
        ordinary = unsure <= ODD_FACTOR * np.repeat([np.median(one) for one in parts], [one.size for one in parts])
    if loud is not None and np.count_nonzero(usable & ~loud) > LEAST_CALM * np.count_nonzero(usable):
        calm, ordinary = calm & ~loud[on.row], ordinary & ~(on.measured & loud[on.row])
    noise = np.interp(track.time_s, track.time_s[calm], np.sqrt(noise_variance[on.row][calm]))
    rows = np.flatnonzero(calm)
    expected = float(np.sqrt(np.mean((noise if rows.size > SPARSE_SHARE * calm.size else noise[rows]) ** 2)))
    bursts = np.zeros(calm.size, dtype=bool) if loud is None else on.measured & loud[on.row]
    return StrengthsOfFlight(track, ordinary, rows, noise, bursts, on.parts, rounding is not None, expected)


@dataclass(frozen=True)
class StrengthsOfFlight:
    """What judges how strongly a flight's air varies, from readings (n,) at the nodes of its track.

    Attributes
    ----------
    ordinary : ndarray (n,)
        Nodes whose readings say something of the air.
    rows : ndarray (m,)
        Nodes that were read.
    noise : ndarray (n,)
        Standard deviation expected of each reading.
    loud : ndarray (n,)
        Nodes with a reading in a burst of noise.
    parts : int
        Nodes that there are to a period of the log.
    stairs : bool
        Whether readings are rounded more coarsely than their noise, which then does not show: it is what was expected.
    expected : float
        Noise of the readings, rms.
    """

    track: Track
    ordinary: NDArray[np.bool_]
    rows: Rows
    noise: Array
    loud: NDArray[np.bool_]
    parts: int
    stairs: bool
    expected: float

    def __call__(self, values: Array, largest: float | None = None) -> Prior:
        """Strengths at each node; a segment has the share `largest` of the flight at most. Segments shorter than the
        flight tell an inversion from what is around it, where stairs do not hide the air."""
        track, rows = self.track, self.rows
        spread = 0.1 * NOISE_SPREAD if self.stairs else NOISE_SPREAD
        if largest is None:
            largest = 1.0 if self.stairs else LARGEST_SHARE
        # of readings that hide the air, or that are bridged where they say nothing, more are needed to tell
        fewest = SHORTEST_SEGMENT if largest < 1.0 and self.ordinary.all() else SEGMENT_SAMPLES
        # what lies across a break is not the air's doing, beside its trend: what is left behind a bend near the ground
        # goes on by far more than all vapour far above
        ahead = np.diff(values, prepend=values[0])
        values = values - np.cumsum(np.where(track.broken, ahead - median_filter(ahead, ALONG_ROWS), 0.0))
        node_time = np.cumsum(np.where(track.broken, track.period_s, np.diff(track.time_s, prepend=0.0)))
        if self.ordinary.any():  # under a profile that is not this sensor's no value may be
            values = np.interp(node_time, node_time[self.ordinary], values[self.ordinary])
        if rows.size > SPARSE_SHARE * values.size:
            return _local_priors(
                values, track.along, track.period_s, self.noise, track.passing, 1, spread, largest, fewest
            )
        # bridges would pass for calm air: the samples alone, as if they were evenly spaced
        steps = np.diff(node_time[rows])
        long = steps > 5 * np.median(steps)
        spacing = float(np.mean(steps[~long]))
        # what a trend does in longer steps would pass for noise; of what the air did in a long gap, as much as it does
        # between two samples
        change = np.diff(values[rows])
        trend = uniform_filter1d(change / steps, ALONG_ROWS) * (steps - spacing)
        extra = np.where(long, change * (1.0 - spacing / steps), trend)
        # nor does the air jump as a rule, whatever it did in a gap or before a sensor that is fast beside the rows
        even = change - trend
        usual = max(self.expected, MAD_TO_SIGMA * float(np.median(np.abs(even))))
        halfway = largest_share(track.along, spacing) > MOST_SHARE
        steady = median_filter(change / steps, ALONG_ROWS) * spacing
        extra = np.where(_jumped(even, JUMPED_FACTOR * usual, halfway), change - steady, extra)
        seen = values[rows] - np.concatenate([[0.0], np.cumsum(extra)])
        some = None if track.passing is None else replace(track.passing, sigma=track.passing.sigma[rows])
        own = _local_priors(
            seen, track.along.at(rows), spacing, self.noise[rows], some, self.parts, spread, largest, fewest
        )
        return own.each(lambda strength: np.interp(node_time, node_time[rows], strength))


def _jumped(change: Array, least: float, halfway: bool) -> NDArray[np.bool_]:
    """Which of the steps (n,) between readings belong to a jump of more than `least`, which one of these may have met
    `halfway`: one of a sensor that is fast beside the rows."""
    jumped = np.zeros(change.shape, dtype=bool)
    for steps in (1, 2)[: min(1 + halfway, change.size)]:
        one_way = np.lib.stride_tricks.sliding_window_view(change, steps)
        size = np.where(np.abs(np.sign(one_way).sum(axis=1)) == steps, np.abs(one_way.sum(axis=1)), 0.0)
        found = (size > least) & (largest_beside(np.abs(change), steps) < BESIDE_SHARE * size)
        for k in range(steps):
            jumped[k : k + size.size] |= found
    return jumped


def _within_steps(
    track: Track,
    values: Array,
    variance: Array,
    steps: Array,
    noise: Array,
    jumps: Jumps,
    local: Prior,
    strengths: StrengthsOfFlight,
) -> tuple[Sweep, Prior, Sites]:
    """The sweep for readings that were rounded by `steps` (n,) beside `noise` (n,), its strengths, and the Gaussians
    that stand for the readings in it.

    Rounded readings of slow air are stairs, whose power passes for turbulence: strengths are judged again by what a
    logger with fine steps would have read. That is drawn smoother than the sensor went between two steps, so it tells
    where the air varies more than elsewhere; by how much, each segment's intervals tell themselves, and how fast what
    passes goes.
    """

    def fine(track: Track, local: Prior, begin: Sites | None = None, at_rest: float = AT_REST) -> tuple[Sweep, Sites]:
        def sweep(site: Array, width: Array) -> Sweep:
            return swept(track, site, width, local, jumps, scored=False)

        return propagated(sweep, values, variance, steps, noise, begin, at_rest)

    found, sites = fine(track, local)
    read = found.clean + noise * np.random.default_rng(0).standard_normal(noise.size)
    local = replace(strengths, noise=noise)(without(track, read, found, jumps), LARGEST_SHARE)
    nodes = np.arange(values.size)
    # segments overlap by half, so that a front at the end of one is in the middle of another
    halves = nodes[:: SEGMENT_SAMPLES // 2]
    middle = halves[1:] if halves.size > 1 else halves

    def with_rate(ln_factors: Array) -> Track:
        if track.passing is None:
            return track
        return replace(track, passing=replace(track.passing, rate=track.passing.rate * float(np.exp(ln_factors[2]))))

    def scaled(ln_factors: Array) -> Prior:
        """By factors (2 or more,) of turbulence and bend, or those of each segment."""
        of_each = np.broadcast_to(ln_factors, (middle.size, ln_factors.shape[-1]))
        turbulence, bend = (np.exp(np.interp(nodes, middle, of_each[:, k])) for k in (0, 1))
        return replace(local, turbulence=turbulence * local.turbulence, bend=bend * local.bend)

    def told(ln_factors: Array, begin: Sites) -> tuple[Array, Sites]:
        found, sites = fine(with_rate(ln_factors), scaled(ln_factors), begin, NEARLY_AT_REST)
        of_each = np.add.reduceat(log_likelihood(found, *sites, values, steps, noise), halves)
        return of_each[:-1] + of_each[1:] if halves.size > 1 else of_each, sites

    typical, of_segments = likeliest(told, sites, 2 if track.passing is None else 3)
    local = scaled(of_segments)
    found, sites = fine(with_rate(typical), local, sites)
    return found, local, sites


def _share_of_noise(level: Array, noise: Array) -> float:
    """The share of the stated noise (m,), in steps, that lets a level (m,) change as seldom as it does; 1 at most.

    Over air that goes through a step evenly, noise of sigma makes 2 sigma / sqrt(pi) of the rows differ from the one
    before; where the air goes on, more do.
    """
    usual = float(np.median(noise))
    seldom = 0.5 * float(np.sqrt(np.pi)) * (np.count_nonzero(np.diff(level)) + 1) / level.size
    return min(seldom / usual, 1.0) if usual > 0.0 else 1.0


def _lone_readings(track: Track, values: Array, variance: Array, found: Sweep, jumps: Jumps) -> NDArray[np.bool_]:
    """Readings (n,) far beyond noise from where all others put them, of a sensor whose lag lets no air do that: farther
    in their own sigmas than any jump about them."""
    if largest_share(track.along, track.period_s) > MOST_SHARE:
        return np.zeros(values.size, dtype=bool)
    read = np.isfinite(variance)
    open_to = np.sqrt(np.maximum(np.where(read, variance - found.clean_variance, 1.0), TINY_SHARE * variance))
    score = np.where(read, np.abs(values - found.clean) / open_to, 0.0)
    near = maximum_filter1d(jumps.variance.any(axis=1).astype(int), 2 * APART_SAMPLES + 1) > 0
    jump = np.abs(np.nan_to_num(found.jump_score)).max(axis=1)
    largest = maximum_filter1d(np.maximum(jump, score), 2 * APART_SAMPLES + 1)
    return np.asarray((score > JUMP_SIGMAS) & (score >= largest) & ~near)


def typical_period(time_s: Array) -> float:
    """Median time between rows that differ in time."""
    steps = np.diff(time_s)
    steps = steps[steps > 0]
    return float(np.median(steps)) if steps.size else 0.1


def _nodes(time_s: Array, period: float, delay_s: float) -> tuple[Array, NDArray[np.int64]]:
    """Times of the samples with the gaps filled, and after the last one as far as the delay; row of each, -1 for a
    filling."""
    ahead = np.diff(time_s, append=time_s[-1] + delay_s + period * (1 if delay_s else 0))
    missed = (ahead > MISSED_PERIODS * period) & (ahead <= LONGEST_BRIDGE_S)
    fill = np.where(missed, np.round(ahead / period) - 1, 0).astype(int)
    if delay_s:
        fill[-1] = int(np.ceil(delay_s / period)) + 1
        ahead[-1] = period * (fill[-1] + 1)
    start = np.repeat(np.arange(time_s.size), fill + 1)
    place = np.arange(start.size) - np.repeat(np.cumsum(fill + 1) - (fill + 1), fill + 1)
    node_time = time_s[start] + place * (ahead / (fill + 1))[start]
    return node_time, np.where(place == 0, start, -1)


def _brief(time_s: Array, measured: NDArray[np.bool_], longest_s: float) -> NDArray[np.bool_]:
    """Nodes (n,) in gaps of at most `longest_s`, over which the sensor hardly moves."""
    nodes, known = np.arange(time_s.size), np.flatnonzero(measured)
    after = known[np.minimum(np.searchsorted(known, nodes), known.size - 1)]
    before = known[np.maximum(np.searchsorted(known, nodes, side="right") - 1, 0)]
    apart = (np.diff(time_s, prepend=-np.inf) > 0) & (
        time_s < time_s[after]
    )  # two rows at one time are no two readings
    return (before < nodes) & (nodes < after) & apart & (time_s[after] - time_s[before] <= longest_s)


def _carried(node_row: NDArray[np.int64]) -> NDArray[np.int64]:
    """Row of each node, fillings taking the row before them."""
    return np.maximum.accumulate(np.maximum(node_row, 0))


def _apart(local: Prior, along: LagResponse, period: float) -> Array:
    """How far (n,) the air is from what the sensor shows as a rule, one sigma: what it lags behind of air that varies
    so strongly, faster than a tenth of its own rate."""
    frequency = np.geomspace(min(0.1 / (2.0 * np.pi * along.slowest_s), 0.1 / period), 0.5 / period, 60)
    missed = np.abs(1.0 - along.clean(frequency, len(along.rate) // 2)) ** 2
    turbulence, bend = (
        float(np.trapezoid(missed * power, frequency)) for power in spectra(frequency, period, local.smooth)
    )
    return np.asarray(np.sqrt(turbulence * local.turbulence**2 + bend * local.bend**2))


def resolved_rate(prior: Prior, response: LagResponse, period: float) -> float:
    """Angular frequency at which the reading's signal sinks into its noise."""
    frequency = np.geomspace(0.01, 0.5 / period, 60)
    turbulence, bend = spectra(frequency, period, prior.smooth)
    signal = gain_squared(response, frequency, period)[0] * (prior.turbulence**2 * turbulence + prior.bend**2 * bend)
    below = np.flatnonzero(signal < 2 * period * prior.noise**2)
    return float(2 * np.pi * frequency[below[0] if below.size else -1])


def _local_priors(
    bridged: Array,
    along: LagResponse,
    period: float,
    noise: Array,
    passing: Passing | None,
    parts: int,
    spread: float,
    largest: float,
    fewest: int,
) -> Prior:
    """Strengths at each node: of segments that overlap by half, each judged by itself, joined in their logarithm. Most
    are alike in units of their own noise: up high vapour and its noise are a thousandth of what they are below.

    `noise` is the standard deviation expected at each node, known within a factor exp(`spread`); a segment may have the
    share `largest` of the flight, and has `fewest` nodes where that allows it.
    """
    typical = float(np.sqrt(np.mean(noise**2)))
    lasting = max(SEGMENT_LAGS * along.slowest_s, SEGMENT_S) / period
    size = int(np.clip(lasting, fewest, LONGEST_SEGMENT))
    size = min(size, max(SHORTEST_SEGMENT, int(largest * bridged.size)), bridged.size)
    if size < 24:
        # too few for a spectrum: each between the strengths at which the readings, and the air, would vary as was read
        frequency = np.arange(1, size // 2 + 1) / (size * period)
        shown = seen(along.at(slice(size // 2, size // 2 + 1)), frequency, period, parts)
        of_one = [
            (np.sum(own) * np.sum(left) / (size * period) ** 2) ** 0.25
            for own, left in zip(spectra(frequency, period), shown, strict=True)
        ]
        sigma = max(float(np.std(bridged)), typical)
        turbulence, bend = (np.full(bridged.size, sigma / one) for one in of_one)
        return Prior(turbulence, bend, noise)
    starts = np.unique(np.append(np.arange(0, bridged.size - size + 1, max(size // 2, 1)), bridged.size - size))
    relative = np.sqrt((noise[starts[:, None] + np.arange(size)] ** 2).mean(axis=1)) / typical
    segments = bridged[starts[:, None] + np.arange(size)] / relative[:, None]
    middle = starts + size // 2
    some = slice(None, None, max(starts.size // 60, 1))
    through = few = None
    if passing is not None:
        # the median: where the air jumped, single samples know nothing
        usual = np.median(passing.sigma[starts[:, None] + np.arange(size)], axis=1) / relative
        # what passes is in the readings: it was no more than they varied, whatever is thought possible
        along_line = np.arange(size) - 0.5 * (size - 1)
        level = segments.mean(axis=1, keepdims=True)
        straight = level + np.outer(segments @ along_line / (along_line @ along_line), along_line)
        usual = np.minimum(usual, np.std(segments - straight, axis=1))
        through, few = Passing(usual, passing.rate), Passing(usual[some], passing.rate)

    def judged(segments: Array) -> tuple[Prior, Prior]:
        rows = along.at(middle[some])
        common = fit_prior(segments[some], rows, period, typical, few, spread=spread, parts=parts)
        return common, fit_windows(segments, along.at(middle), period, common, through, parts, spread=spread)

    common, local = judged(segments)
    strongest = local.turbulence
    if common.smooth:
        # a wave is one frequency, and a spectrum that falls from it would take turbulence's part beside it
        strongest = np.maximum(strongest, judged(without_wave(segments))[1].turbulence)
    nodes = np.arange(bridged.size)
    own = (strongest * relative, local.bend * relative, local.noise / typical)
    turbulence, bend, factor = (np.exp(np.interp(nodes, middle, np.log(value))) for value in own)
    return Prior(turbulence, bend, factor * noise, smooth=common.smooth)
