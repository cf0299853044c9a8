"""The models that one would fit without this project, as modes: a unit step shows 1 - sum(weights exp(-rates t)).

Parameters are logarithms of time constants [s], the first of them of the slowest or only one, and what shapes the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Modes = tuple[Array, Array]  # weights with sum 1, rates [1/s]

TERMS = 60  # of an ideal body's series


def _one_lag(p: Array) -> Modes:
    return np.ones(1), np.exp(-p[:1])


def _two_lags(p: Array) -> Modes:
    slow, fast = np.exp(p[0]), np.exp(p[0]) / (1.0 + 1e-3 + np.exp(p[1]))
    return np.array([slow, -fast]) / (slow - fast), 1.0 / np.array([slow, fast])


def _two_exponentials(p: Array) -> Modes:
    share = 1.0 / (1.0 + np.exp(-p[2]))
    return np.array([1.0 - share, share]), np.exp(-np.array([p[0], p[0] + np.exp(min(p[1], 2.0))]))


def _sphere(p: Array) -> Modes:
    n = np.arange(1, TERMS + 1)
    return -2.0 * (-1.0) ** n, (n * np.pi) ** 2 * np.exp(-p[0])


def _film(p: Array) -> Modes:
    k = (np.arange(TERMS) + 0.5) * np.pi
    return 2.0 / k**2, k**2 * np.exp(-p[0])


@dataclass(frozen=True)
class Model:
    """A rival: its modes from its parameters, and the starts to try, given a first guess of ln t63 [s]."""

    name: str
    modes: Callable[[Array], Modes]
    starts: tuple[tuple[float, ...], ...]  # relative to ln t63 in the first parameter

    def guesses(self, log_t63: float) -> list[Array]:
        return [np.array([log_t63 + s[0], *s[1:]]) for s in self.starts]


MODELS = {
    "one lag": Model("one lag", _one_lag, ((0.0,), (-1.0,))),
    "two lags": Model("two lags", _two_lags, ((-0.2, 1.0), (-0.5, 0.0), (0.0, 3.0))),
    "two exponentials": Model(
        "two exponentials",
        _two_exponentials,
        ((-0.3, 0.5, -1.0), (-0.2, 1.0, -2.5), (-1.0, 0.0, 0.0), (-0.1, -0.5, 0.5)),
    ),
    "ideal body": Model("ideal body", _sphere, ((1.77,), (0.8,))),
}


def models(channel: str) -> dict[str, Model]:
    """The rivals of a channel: the ideal body is a sphere read at its core, or a film read as its mean."""
    if channel == "temperature":
        return MODELS
    return MODELS | {"ideal body": Model("ideal body", _film, ((1.14,), (0.2,)))}
