"""How likely a jump of the air, a bend or a ramp is, wherever it may be: the mean of its likelihood over its places.

A Kalman filter is linear: by how much a reading surprises one with a break in the air is what it does without, less
what the break shows. So one filter for each place tells all that may begin or end there. A break between two places is
both of these in shares, of which the likelihood's mean is that of Gaussians; a ramp is a bend and the one that undoes
it, so that it goes from one level to another and leaves the slope as it was.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.smoother import Jumps
from shockrig.analysis.flight.sweep import Neighbourhood

Array = NDArray[np.float64]
NEIGHBOURS = 1  # samples to either side of the one found, where a jump or a bend is tried
PLACES = 5  # in a step, between which a jump is tried
CORNER_SHARE = 0.2  # of how far away they are: so far apart are the places where a ramp's corner is tried
SHORTEST_RAMP, LONGEST_RAMP = 1, 40  # samples; as likely so long as twice as long, and below a sample it is a jump
EVEN_SIGMA = 1.0 / np.sqrt(12.0)  # of what is as likely anywhere between 0 and 1
LEVEL, SLOPE = 0, 1  # kinds of breaks


@dataclass(frozen=True)
class Break:
    """A jump of the air, a bend, or the two bends of a ramp.

    Attributes
    ----------
    kind : int
        LEVEL or SLOPE.
    time_s : ndarray (c,)
        When each of its corners most likely was.
    size : float
        Of each of them, one sigma of what is thought possible [unit or unit/s].
    off : ndarray (c,)
        How far the air may be off at a corner, since nothing tells more closely where that is [unit].
    cost : float
        Minus the logarithm of its mean likelihood.
    within : float
        Samples within which it may be.
    """

    kind: int
    time_s: Array
    size: float
    off: Array
    cost: float
    within: float


@dataclass(frozen=True)
class ToldBreaks:
    """What the readings tell of jumps and bends at some places.

    Attributes
    ----------
    jump_s, bend_s : ndarray
        When jumps (j,) and bends (b,) are tried, in order of time.
    near_s : ndarray
        When what is looked for seems to have been, at the latest.
    period_s : float
        Of samples.
    base : float
        Minus the log-likelihood without any.
    of_size : ndarray (p,)
        What the readings tell of the size of each, jumps before bends: the slope of the log-likelihood.
    precision : ndarray (p, p)
        How precisely they tell of any two.
    """

    jump_s: Array
    bend_s: Array
    near_s: Array
    period_s: float
    base: float
    of_size: Array
    precision: Array

    def jumps(self, size: float) -> list[Break]:
        """Jumps of about a size, between any two places."""
        return self._of_one_corner(LEVEL, self.jump_s, size)

    def bends(self, size: float) -> list[Break]:
        """Bends of about a size, about where they are looked for."""
        return self._of_one_corner(SLOPE, self.bend_s, size)

    def _of_one_corner(self, kind: int, place_s: Array, size: float) -> list[Break]:
        width = np.diff(place_s)
        apart_s = np.abs(place_s[:-1] + 0.5 * width - self.near_s[0] + 0.5 * self.period_s)
        between = np.flatnonzero((width > 0.0) & (apart_s < (NEIGHBOURS + 0.5) * self.period_s))
        if size == 0.0 or not between.size:
            return []
        rows, at = np.arange(between.size), between + (self.jump_s.size if kind == SLOPE else 0)
        ways = np.zeros((between.size, 2, self.of_size.size))
        for behind in (0, 1):
            ways[rows, 0, at + behind] = 0.5
            ways[rows, 1, at + behind] = 2.0 * behind - 1.0
        cost, best, sigma = self._mean(ways, np.tile([size, size * EVEN_SIGMA], (between.size, 1)))
        when = place_s[between] + _share(best[:, 1], best[:, 0]) * width[between]
        off = sigma[:, 1] * width[between] if kind == SLOPE else np.zeros(between.size)
        within = width[between] / self.period_s
        return [Break(kind, when[[k]], size, off[[k]], float(cost[k]), float(within[k])) for k in rows.tolist()]

    def ramps(self, size: float) -> list[Break]:
        """One ramp for all of about a size that go on where they are looked for: half of them last longer."""
        time_s, width, begin = self.bend_s, np.diff(self.bend_s), self.jump_s.size
        middle = time_s[:-1] + 0.5 * width
        first, last = np.triu_indices(width.size, 1)
        lasting = middle[last] - middle[first]
        goes_on = ((time_s[first][:, None] < self.near_s) & (time_s[last + 1][:, None] >= self.near_s)).any(axis=1)
        some = goes_on & (lasting <= LONGEST_RAMP * self.period_s)
        first, last, lasting = first[some], last[some], lasting[some]
        if size == 0.0 or not first.size:
            return []
        rows, slope = np.arange(first.size), size / lasting
        ways = np.zeros((first.size, 3, self.of_size.size))
        for behind in (0, 1):
            ways[rows, 0, begin + first + behind] += 0.5 / lasting
            ways[rows, 0, begin + last + behind] -= 0.5 / lasting
            ways[rows, 1, begin + first + behind] = 2.0 * behind - 1.0
            ways[rows, 2, begin + last + behind] = 1.0 - 2.0 * behind
        prior = np.stack([np.full(slope.shape, size), slope * EVEN_SIGMA, slope * EVEN_SIGMA], axis=1)
        cost, best, sigma = self._mean(ways, prior)
        within = width[first] * width[last] / lasting / np.log(LONGEST_RAMP / SHORTEST_RAMP) / self.period_s
        likely = np.log(within) - cost
        together = float(np.logaddexp.reduce(likely))
        by_length = np.argsort(lasting, kind="stable")
        half = int(np.searchsorted(np.cumsum(np.exp(likely[by_length] - together)), 0.5))
        as_long = lasting == lasting[by_length[min(half, rows[-1])]]
        k = int(np.argmax(np.where(as_long, likely, -np.inf)))
        of_corners = width[[first[k], last[k]]]
        when = time_s[[first[k], last[k]]] + _share(best[k, 1:], best[k, 0] / lasting[k]) * of_corners
        room = float(np.exp(together + cost[k]))
        return [Break(SLOPE, when, float(slope[k]), sigma[k, 1:] * of_corners, float(cost[k]), room)]

    def _mean(self, ways: Array, prior: Array) -> tuple[Array, Array, Array]:
        """Minus the logarithm of the mean likelihood of each of the ways (n, d, p) to put breaks together, of which the
        sizes have the sigmas `prior` (n, d) before the readings are looked at; and the mean and sigma (n, d) behind."""
        ways = ways * prior[..., None]
        pull = ways @ self.of_size
        covariance = np.linalg.inv(np.eye(ways.shape[1]) + ways @ self.precision @ ways.swapaxes(1, 2))
        best = (covariance @ pull[..., None])[..., 0]
        cost = self.base - 0.5 * np.linalg.slogdet(covariance)[1] - 0.5 * (pull * best).sum(axis=1)
        sigma = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
        return cost, best * prior, sigma * prior


def told_of_breaks(around: Neighbourhood, known: Jumps, near: int, last: int) -> ToldBreaks:
    """What the readings tell of breaks in the step before a node, beside the jumps that are `known` (at the nodes of
    the neighbourhood), and of ramps that go on there or before the node `last`."""
    time_s, nodes, period_s = around.track.time_s, around.nodes, around.track.period_s
    steps = near + np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    steps = steps[(steps > nodes[0]) & (steps <= nodes[-1])]
    each = time_s[steps - 1][:, None] + np.diff(time_s)[steps - 1][:, None] * np.arange(PLACES) / PLACES
    jump_s = np.append(each.ravel(), time_s[steps[-1:]])
    away = [0]
    while away[-1] < LONGEST_RAMP:
        away.append(away[-1] + max(round(CORNER_SHARE * away[-1]), 1))
    beside = np.array([*(-one for one in away[:-1]), *away[:-1]])
    corners = np.unique(np.concatenate([near + beside, last + beside]))
    bend_s = np.unique(time_s[corners[(corners >= nodes[0]) & (corners <= nodes[-1])]])
    modes = around.track.along.modes(near)

    def since(begin_s: Array) -> tuple[Array, Array]:
        after = np.maximum(time_s[nodes] - begin_s[:, None], 0.0)
        return after, np.expm1(-after[..., None] * modes.rate)

    # a step of one of the air, and a slope of one sample's time
    after, gone = since(jump_s)
    of_jumps = np.where(after > 0.0, 1.0 + (gone + 1.0) @ modes.amplitude, 0.0)
    after, gone = since(bend_s)
    of_bends = after - gone @ (modes.amplitude / modes.rate)
    unit = float(around.local.noise[near])
    off = unit * np.concatenate([np.zeros((1, nodes.size)), of_jumps, of_bends / period_s])
    base, surprise = around.surprises(known, off)
    own = (surprise[0] - surprise[1:]) / unit
    own[jump_s.size :] *= period_s
    return ToldBreaks(jump_s, bend_s, time_s[[near, last]], period_s, base, own @ surprise[0], own @ own.T)


def _share(moved: Array, gone: Array) -> Array:
    """Where between two places a break is that is `moved` by so much from their middle, of what it is as a whole."""
    share = np.divide(moved, gone, out=np.zeros(moved.shape), where=np.broadcast_to(gone != 0.0, moved.shape))
    return np.clip(0.5 + share, 0.0, 1.0)
