"""Batches of candidates of which many are alike: what is the same for several is evaluated once."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def different(keys: Sequence[Array]) -> tuple[int, Index, Index]:
    """How many candidates there are, which of them differ from the first in any key (with the first), and the place of
    each among those; a key is (B, ...), or (1, ...) where it is the same for all."""
    count = max(key.shape[0] if key.ndim > 1 else 1 for key in keys)
    same = np.ones(count, dtype=bool)
    for key in keys if count > 1 else ():
        if key.ndim > 1 and key.shape[0] == count:
            same &= (key == key[:1]).reshape(count, -1).all(axis=1)
    same[0] = True
    own = np.flatnonzero(~same)
    place = np.zeros(count, dtype=int)
    place[own] = np.arange(1, own.size + 1)
    return count, np.concatenate([[0], own]), place


def of_those(key: Array, count: int, pick: Index) -> Array:
    """A key of some of `count` candidates."""
    return key[pick] if key.ndim > 1 and key.shape[0] == count else key


def for_different(form: Callable[..., Array], *keys: Array) -> Array:
    """form(*keys) (B, ...), evaluated once for all candidates that are as the first one is."""
    count, pick, place = different(keys)
    if pick.size == count:
        return form(*keys)
    return np.asarray(form(*(of_those(key, count, pick) for key in keys))[place])
