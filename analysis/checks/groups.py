"""Do numbers fall into two groups that no condition explains? Labels are free, so chance is counted.

y = conditions @ b + z (d0 + d1 u) + scatter with a label z (0 or 1) for each run. Either the runs before some moment
are one group and those after it the other, or the labels that leave the least are sought by flipping one at a time
from many starts. The best of m labellings leaves, where there is nothing, about m^(-2 / dof) of the squares (the
nearest of m random directions in dof dimensions): m is the number of moments, or 2^(n-1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RANDOM_STARTS = 60
FEWEST_LEFT = 5  # degrees of freedom
SEPARATE_SHARE = 0.15  # share of the labels' squares that the conditions must leave unexplained
LEAST_SEPARATE = 0.05  # the same as a length, without one run


@dataclass(frozen=True)
class Grouping:
    """The best two groups of n runs.

    Attributes
    ----------
    second : ndarray (n,) of bool
        Who is in the second group.
    difference : float
        Root mean square of the difference between the groups, at the second one's conditions.
    scatter : float
        What is left within them (one sigma).
    chance : float
        Squares that are left, relative to what the best labels leave by chance.
    least_alone : float
        What the groups explain when any one run is taken out, at the least, in units of the scatter.
    """

    second: NDArray[np.bool_]
    difference: float
    scatter: float
    chance: float
    least_alone: float


def two_groups(
    y: Array, conditions: Sequence[Array], slope: Array | None = None, smallest_share: float = 0.2, seed: int = 0
) -> Grouping | None:
    """The two groups that explain most of `y` beyond `conditions`; None where too few runs remain.

    Parameters
    ----------
    y : ndarray (n,)
        In the order of the campaign.
    conditions : sequence of ndarray (n,)
        What `y` may depend on, a constant among them.
    slope : ndarray (n,), optional
        Along what the groups may also differ; without it they differ by a constant.
    smallest_share : float
        Of the runs in either group; at least three runs.
    seed : int
        Of the starts of the search.
    """
    n = y.size
    basis = _basis(conditions)
    left = n - basis.shape[1] - (1 if slope is None else 2)
    least = max(3, int(np.ceil(smallest_share * n)))
    if left < FEWEST_LEFT or 2 * least > n:
        return None
    away = np.eye(n) - basis @ basis.T  # takes the conditions out
    rest = away @ y
    total = float(rest @ y)
    if total <= 0.0:
        return None
    everyone = np.ones(n, dtype=bool)
    moments = [(np.arange(n) < i).astype(float) for i in range(least, n - least + 1)]
    gains = [_explained(y, conditions, slope, labels, everyone)[0] for labels in moments]
    candidates = [(moments[int(np.argmax(gains))], max(gains), np.log2(len(moments)))]
    best, gain = _search(rest, away, slope, least, np.random.default_rng(seed))
    if best is not None:
        candidates.append((best, gain, n - 1.0))
    found = []
    for labels, gain, bits in candidates:
        remaining = max(total - gain, 1e-12 * total)
        scatter = float(np.sqrt(remaining / left))
        alone = min(_explained(y, conditions, slope, labels, np.arange(n) != i)[0] for i in range(n))
        found.append(
            Grouping(
                second=labels > 0.0,
                difference=_explained(y, conditions, slope, labels, everyone)[1],
                scatter=scatter,
                chance=float(remaining / total * 2.0 ** (2.0 * bits / left)),
                least_alone=float(np.sqrt(alone)) / scatter,
            )
        )
    return min(found, key=lambda grouping: grouping.chance)


def _basis(columns: Sequence[Array]) -> Array:
    """Orthonormal columns that span the conditions; nearly dependent ones count once."""
    scaled = np.array([column / max(float(np.linalg.norm(column)), 1e-12) for column in columns]).T
    vectors, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    return vectors[:, sizes > 0.05 * sizes[0]]


def _gains(first: Array, own: Array, share: Array, n: int, tilted: tuple[Array, Array, Array] | None) -> Array:
    """Squares that labellings explain, each entry one of them; 0 where the conditions already explain its labels.

    `first` is z' rest, `own` z' away z, `tilted` the same of z u: (zu)' rest, (zu)' away (zu), z' away (zu).
    """
    usable = own > SEPARATE_SHARE * n * share * (1.0 - share) + 1e-9
    own = np.maximum(own, 1e-9)
    gains = first**2 / own
    if tilted is not None:
        second, full, cross = tilted
        alone = full - cross**2 / own
        seen = alone > 0.05 * full + 1e-9
        gains = gains + np.where(seen, (second - cross / own * first) ** 2 / np.maximum(alone, 1e-9), 0.0)
    return np.asarray(np.where(usable, gains, 0.0))


def _search(
    rest: Array, away: Array, slope: Array | None, least: int, rng: np.random.Generator
) -> tuple[Array | None, float]:
    """Labels that explain most, from every start flipped one by one while that helps."""
    n = rest.size
    order = np.argsort(rest)
    cuts = np.unique(np.linspace(least, n - least, RANDOM_STARTS).astype(int))
    starts = [(np.arange(n) < i).astype(float) for i in cuts]  # exchanged in mid-campaign
    starts += [np.isin(np.arange(n), order[:i]).astype(float) for i in cuts]
    starts += list((rng.random((RANDOM_STARTS, n)) < 0.5).astype(float))
    u = np.zeros(n) if slope is None else slope
    diagonal = np.diag(away)
    best, most = None, 0.0
    for labels in starts:
        gain = 0.0
        while True:
            turn = 1.0 - 2.0 * labels  # what a flip of each label adds to it
            seen, leaning = away @ labels, away @ (labels * u)
            share = (labels.sum() + turn) / n
            tilted = None
            if slope is not None:
                tilted = (
                    labels * u @ rest + turn * u * rest,
                    labels * u @ leaning + 2.0 * turn * u * leaning + u**2 * diagonal,
                    labels @ leaning + turn * (leaning + u * seen) + u * diagonal,
                )
            gains = _gains(labels @ rest + turn * rest, labels @ seen + 2.0 * turn * seen + diagonal, share, n, tilted)
            gains[(share * n < least - 0.5) | (share * n > n - least + 0.5)] = 0.0
            i = int(gains.argmax())
            if gains[i] <= gain * (1.0 + 1e-9):
                break
            gain = float(gains[i])
            labels = labels.copy()
            labels[i] += turn[i]
        if gain > most * (1.0 + 1e-9):  # the same groups with their labels exchanged explain as much
            best, most = labels, gain
    return best, most


def _explained(
    y: Array, conditions: Sequence[Array], slope: Array | None, labels: Array, keep: NDArray[np.bool_]
) -> tuple[float, float]:
    """From the runs `keep`: the squares that the groups explain beyond the conditions, and their root mean square
    difference at the second group's conditions."""
    basis = _basis([column[keep] for column in conditions])
    away = np.eye(int(keep.sum())) - basis @ basis.T
    label = labels[keep]
    group = np.column_stack([label] if slope is None else [label, label * slope[keep]])
    beyond = away @ group
    scale = np.maximum(np.linalg.norm(group, axis=0), 1e-12)
    vectors, sizes, turned = np.linalg.svd(beyond / scale, full_matrices=False)
    informative = sizes > LEAST_SEPARATE
    along = np.where(informative, vectors.T @ y[keep], 0.0)
    found = (turned.T @ (along / np.where(informative, sizes, 1.0))) / scale
    return float(along @ along), float(np.sqrt(np.mean(np.square(group[label > 0.0] @ found))))
