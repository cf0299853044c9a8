"""Bodies of other people's sensors as chains of finite volumes, solved by the modes of their grid.

V dx/dt = -K x + g (u(t) - x); the reading of a unit step is 1 - sum_k w_k exp(-r_k t), sum w = 1.
A sheath is one more cell between the body and the air; a slow share is a first-order lag beside the body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from shockrig.rig.virtual.physics.chains import CellChain, core_weights, film, film_edges, lag, sphere, sphere_edges
from shockrig.rig.virtual.physics.course import modes

Array = NDArray[np.float64]

CELLS = 240  # the grid's own error is below 5e-5 of a step from t63 / 20 on
KINDS = ("sphere", "sphere_mean", "cylinder", "cylinder_mean", "plate", "film", "lumped")
SHARE_63 = 1.0 - np.exp(-1.0)


@dataclass(frozen=True)
class ForeignBody:
    """A linear sensor as modes: its reading follows a unit step of the air as 1 - sum(weights exp(-rates t)).

    Attributes
    ----------
    kind : str
        One of `KINDS`: the shape of the body within whatever is around it.
    weights : ndarray (n,)
        Shares of the modes, with sum 1.
    rates_per_s : ndarray (n,)
    rate_per_s : float
        alpha / R^2, D / L^2 or 1 / tau of the body itself, without its sheath and its slow share.
    """

    kind: str
    weights: Array
    rates_per_s: Array
    rate_per_s: float

    def step(self, since_s: Array) -> Array:
        """Share of a unit step that is shown at `since_s` (any shape); zero before it."""
        since = np.asarray(since_s, dtype=float)
        shown = 1.0 - np.exp(-np.maximum(since, 0.0)[..., None] * self.rates_per_s) @ self.weights
        return np.where(since > 0.0, shown, 0.0)

    def time_to_s(self, share: float) -> float:
        """Time at which `share` (0 to 1) of a unit step is shown."""
        longest = 40.0 / float(self.rates_per_s.min())
        return float(brentq(lambda t: float(self.step(np.array(t))) - share, 0.0, longest, xtol=1e-13 * longest))

    def faster(self, factor: float) -> ForeignBody:
        """The same with every process `factor` times as fast."""
        return ForeignBody(self.kind, self.weights, self.rates_per_s * factor, self.rate_per_s * factor)


def make_body(
    kind: str, t63_s: float, sheath: tuple[float, float] | None = None, slow: tuple[float, float] | None = None
) -> ForeignBody:
    """A body of `kind` that takes `t63_s` to show 1 - 1/e of a step, whatever is around it.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    t63_s : float
        Of the whole sensor, sheath and slow share included [s].
    sheath : (time constant, heat capacity), optional
        A well-mixed layer between body and air: its time constant behind the air and its capacity, relative to the
        body's t63 and to the body's capacity.
    slow : (fraction, time constant), optional
        A share of the reading that follows as a lag of its own, its time constant relative to the t63 of the rest.

    Raises
    ------
    ValueError
        Where `kind` is not known.
    """
    if kind not in KINDS:
        raise ValueError(f"{kind!r} is no body; expected one of {', '.join(KINDS)}")
    chain, readout = _chain(kind)
    bare = _solve(kind, chain, readout)
    one = bare.time_to_s(SHARE_63)
    body = bare if sheath is None else _solve(kind, *_sheathed(chain, readout, sheath[0] * one, sheath[1]))
    if slow is not None:
        fraction, ratio = slow
        lag_rate = 1.0 / (ratio * body.time_to_s(SHARE_63))
        weights = np.append((1.0 - fraction) * body.weights, fraction)
        body = ForeignBody(kind, weights, np.append(body.rates_per_s, lag_rate), 1.0)
    return body.faster(body.time_to_s(SHARE_63) / t63_s)


def _solve(kind: str, chain: CellChain, readout: Array) -> ForeignBody:
    """Modes of a chain whose cells are read with the weights `readout` (cells,)."""
    rates, cells_from_modes, modes_from_cells = modes(chain)
    return ForeignBody(kind, (readout @ cells_from_modes) * modes_from_cells.sum(axis=1), rates, 1.0)


def _chain(kind: str) -> tuple[CellChain, Array]:
    """The chain of a body of unit rate with its surface held at the air, and the weights of its reading."""
    one, held = np.ones(1), np.array([np.inf])
    if kind == "lumped":
        return lag(1.0, 1), np.ones(1)
    if kind in ("sphere", "sphere_mean"):
        edges = sphere_edges(CELLS)
        volumes = np.diff(edges**3)
        weights = np.zeros(CELLS)
        weights[:3] = core_weights(edges)
        return sphere(one, held, edges), volumes if kind == "sphere_mean" else weights
    if kind in ("cylinder", "cylinder_mean"):
        edges = np.linspace(0.0, 1.0, CELLS + 1)
        weights = np.zeros(CELLS)
        weights[:3] = _axis_weights(edges, 1)
        return _cylinder(edges), np.diff(edges**2) if kind == "cylinder_mean" else weights
    edges = film_edges(CELLS)
    weights = np.zeros(CELLS)
    weights[:3] = _axis_weights(edges, 0)
    return film(one, held, edges), np.diff(edges) if kind == "film" else weights


def _cylinder(edges: Array) -> CellChain:
    """Heat in a long cylinder, cells in r / R, surface held at the air."""
    centres = 0.5 * (edges[1:] + edges[:-1])
    capacity = 0.5 * np.diff(edges**2)
    link = edges[1:-1] / np.diff(centres)
    return CellChain(capacity[None], link[None], np.array([1.0 / (1.0 - centres[-1])]))


def _axis_weights(edges: Array, power: int) -> Array:
    """Weights of the first three cell means that give the value at x = 0 exactly for a + b x^2 + c x^4.

    `power` is that of x in the volume element: 0 in a plate, 1 in a cylinder.
    """
    outer, inner = edges[1:4], edges[:3]

    def moment(p: int) -> Array:
        return (outer ** (power + 1 + p) - inner ** (power + 1 + p)) / (power + 1 + p)

    return np.asarray(np.linalg.solve(np.stack([moment(p) / moment(0) for p in (0, 2, 4)]), [1.0, 0.0, 0.0]))


def _sheathed(chain: CellChain, readout: Array, time_constant: float, capacity: float) -> tuple[CellChain, Array]:
    """One more cell at the open end: it follows the air with `time_constant` and holds `capacity` times the body."""
    own = capacity * float(chain.capacity.sum())
    return (
        CellChain(
            np.append(chain.capacity, [[own]], axis=1),
            np.append(chain.link, chain.open_end[:, None], axis=1),
            np.array([own / time_constant]),
        ),
        np.append(readout, 0.0),
    )
