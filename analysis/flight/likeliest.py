"""Factors under which readings are likeliest, where each likelihood costs a sweep of the smoother and has no slope.

Points of a lattice in the logarithms of the factors, from 1 uphill to the neighbour that is likeliest; about the best,
the vertex of a parabola along each factor. Segments of a flight overlap by half and lie about the typical one as their
strengths do (`fit_windows`): Cauchy's distribution, so that a front or a burst does not speak for all of it and has its
own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.air_prior import SHRINKAGE_LN

Array = NDArray[np.float64]
State = TypeVar("State")
STRIDE_LN = 0.7  # of ln factor, between neighbours
SPREAD_LN = 1.0  # of a typical ln factor, about 0, before readings are looked at


def likeliest(told: Callable[[Array, State], tuple[Array, State]], begin: State, count: int) -> tuple[Array, Array]:
    """Logarithms of the typical factors (count,), and of each segment's own (s, count), as the mean of their square.

    `told` gives the log-likelihood (s,) of each segment under logarithms (count,) of factors, and what it came to on
    the way, from which it `begin`s at a neighbour. The first two of the factors may stand for one another.
    """
    own = np.eye(count, dtype=int)
    ways = np.concatenate([own, -own, [own[0] - own[1], own[1] - own[0]]])
    known: dict[tuple[int, ...], tuple[Array, State]] = {}

    def of_segments(place: Array) -> tuple[Array, Array]:
        """Places (k, count) that were tried, from a typical one, and the log-likelihood (k, s) that a segment is
        there."""
        off = np.array(list(known)) - place
        apart = np.log1p((STRIDE_LN / SHRINKAGE_LN * off) ** 2).sum(axis=1)
        return off, np.array([of_each for of_each, _ in known.values()]) - apart[:, None]

    def at(place: Array) -> float:
        of_all = 0.5 * of_segments(place)[1].max(axis=0).sum()  # each reading is in two
        return float(of_all - 0.5 * np.sum((STRIDE_LN / SPREAD_LN * place) ** 2))

    place = np.zeros(count, dtype=int)
    known[tuple(place.tolist())] = told(STRIDE_LN * place, begin)
    while True:
        for one in place + ways:
            if (key := tuple(one.tolist())) not in known:
                known[key] = told(STRIDE_LN * one, known[tuple(place.tolist())][1])
        highest, values = at(place), np.array([at(one) for one in place + ways])
        if values.max() <= highest:
            break
        place = place + ways[np.argmax(values)]
    more, less = values[:count] - highest, values[count : 2 * count] - highest
    typical = STRIDE_LN * (place + 0.5 * (less - more) / np.minimum(more + less, -np.finfo(float).tiny))
    off, likely = of_segments(place)
    share = np.exp(likely - likely.max(axis=0))
    mean_square = (share / share.sum(axis=0)).T @ np.exp(2.0 * STRIDE_LN * off)
    return typical, np.asarray(typical + 0.5 * np.log(mean_square))
