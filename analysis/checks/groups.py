"""Do numbers fall into two groups that no condition explains? Labels are free, so chance is counted.

y = conditions @ b + z (d0 + d1 u) + scatter with a label z (0 or 1) for each run: the labels that leave the least are
sought by flipping one at a time from many starts. The best of 2^(n-1) labels leaves, where there is nothing, about
2^(-2 (n-1) / dof) of the squares (the nearest of so many random directions in dof dimensions).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STARTS = 60
FEWEST_LEFT = 3  # degrees of freedom
SEPARATE = 0.15  # share of the labels that the conditions must leave unexplained


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
        Smallest difference that is left when any one run is taken out.
    """

    second: NDArray[np.bool_]
    difference: float
    scatter: float
    chance: float
    least_alone: float


def two_groups(
    y: Array, conditions: Sequence[Array], slope: Array | None = None, smallest_share: float = 0.2, seed: int = 0
) -> Grouping | None:
    """The two groups that explain most of `y` (n,) beyond `conditions` (columns (n,)); None where too few runs remain.

    `slope` (n,): along what the groups may also differ; None: they differ by a constant.
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
    best, gain = _search(rest, away, slope, least, np.random.default_rng(seed))
    if best is None or total <= 0.0:
        return None
    kept = np.ones(n, dtype=bool)
    alone = [_difference(y, conditions, slope, best, kept & (np.arange(n) != i)) for i in range(n)]
    remaining = max(total - gain, 0.0)
    return Grouping(
        second=best > 0.0,
        difference=_difference(y, conditions, slope, best, kept),
        scatter=float(np.sqrt(remaining / left)),
        chance=float(remaining / total * 2.0 ** (2.0 * (n - 1) / left)),
        least_alone=min(alone),
    )


def _basis(columns: Sequence[Array]) -> Array:
    """Orthonormal columns that span the conditions; nearly dependent ones count once."""
    scaled = np.array([column / max(float(np.linalg.norm(column)), 1e-12) for column in columns]).T
    vectors, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    return vectors[:, sizes > 0.05 * sizes[0]]


def _gains(labels: Array, rest: Array, away: Array, slope: Array | None) -> Array:
    """Squares that each row of `labels` (m, n) explains; 0 where the conditions already explain the labels."""
    seen = labels @ away
    share = labels.mean(axis=1)
    own = np.einsum("ij,ij->i", seen, labels)
    usable = own > SEPARATE * rest.size * share * (1.0 - share) + 1e-9
    own = np.maximum(own, 1e-9)
    first = labels @ rest
    gains = first**2 / own
    if slope is not None:
        tilted = labels * slope
        cross = np.einsum("ij,ij->i", seen, tilted)
        full = np.einsum("ij,ij->i", tilted @ away, tilted)
        alone = full - cross**2 / own
        second = tilted @ rest - cross / own * first
        gains = gains + np.where(alone > 0.05 * full + 1e-9, second**2 / np.maximum(alone, 1e-9), 0.0)
    return np.where(usable, gains, 0.0)


def _search(
    rest: Array, away: Array, slope: Array | None, least: int, rng: np.random.Generator
) -> tuple[Array | None, float]:
    n = rest.size
    order = np.argsort(rest)
    starts = [(np.arange(n) < i).astype(float) for i in range(least, n - least + 1)]  # exchanged in mid-campaign
    starts += [np.isin(np.arange(n), order[:i]).astype(float) for i in range(least, n - least + 1)]
    starts += list((rng.random((STARTS, n)) < 0.5).astype(float))
    flips = np.eye(n)
    best, most = None, 0.0
    for labels in starts:
        gain = float(_gains(labels[None], rest, away, slope)[0])
        while True:
            tried = np.abs(flips - labels)
            members = tried.sum(axis=1)
            tried = tried[(members >= least) & (members <= n - least)]
            if not len(tried):
                break
            gains = _gains(tried, rest, away, slope)
            i = int(gains.argmax())
            if gains[i] <= gain * (1.0 + 1e-9):
                break
            gain, labels = float(gains[i]), tried[i]
        if gain > most and least <= labels.sum() <= n - least:
            best, most = labels, gain
    return best, most


def _difference(
    y: Array, conditions: Sequence[Array], slope: Array | None, labels: Array, keep: NDArray[np.bool_]
) -> float:
    """Root mean square difference of the groups at the second one's conditions, from the runs `keep`; 0 where the
    conditions of those runs already tell the groups apart."""
    basis = _basis([column[keep] for column in conditions])
    away = np.eye(int(keep.sum())) - basis @ basis.T
    label, share = labels[keep], float(labels[keep].mean())
    columns = [label] if slope is None else [label, label * slope[keep]]
    group = np.column_stack(columns)
    if label @ away @ label <= SEPARATE * label.size * share * (1.0 - share):
        return 0.0
    found = np.linalg.lstsq(away @ group, away @ y[keep], rcond=SEPARATE)[0]
    return float(np.sqrt(np.mean(np.square(group[label > 0.0] @ found))))
