"""A sensing body in finite volumes, for flights whose truth shares no code with the closed forms that correct them.

V dx/dt = -K x + g (u(t) - x) in units of the body's length and rate, backward differences of second order;
conductances are refreshed as the rate follows the air's temperature and the Biot number the airspeed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.signal import lfilter, lfiltic

from shockrig.analysis.flight.weather import FINE_STEP_S

Array = NDArray[np.float64]
VOLUMES = 48
SKIN_REFINEMENT = 2.0  # how much finer cells are towards the open face of a body that is read as its mean
# name -> dimension (1 slab, 2 cylinder, 3 sphere), read at the core
SHAPES = {
    "sphere": (3, True),
    "sphere_mean": (3, False),
    "cylinder": (2, True),
    "cylinder_mean": (2, False),
    "plate": (1, True),
    "film": (1, False),
    "lumped": (0, False),
}
Follow = Callable[[int, Array], Array]


@dataclass(frozen=True)
class Cells:
    """N cells from the core (or the sealed face) to the open face.

    Attributes
    ----------
    capacity : ndarray (N,)
    link : ndarray (N - 1,)
        Conductances between neighbours.
    to_surface : float
        Resistance from the last cell's centre to the surface.
    weight : ndarray (N,)
        Of each cell in the reading; sums to 1.
    sheath_s : float
        Time constant with which the last cell follows the air when alone, where it is a sheath; else 0.
    """

    capacity: Array
    link: Array
    to_surface: float
    weight: Array
    sheath_s: float = 0.0


def cells(shape: str) -> Cells:
    """A body of one of SHAPES cut into cells; a lump is one cell with one resistance."""
    dimension, core = SHAPES[shape]
    if dimension == 0:
        return Cells(np.ones(1), np.zeros(0), 1.0, np.ones(1))
    edges = np.linspace(0.0, 1.0, VOLUMES + 1)
    if not core:
        edges = -np.expm1(-SKIN_REFINEMENT * edges) / -np.expm1(-SKIN_REFINEMENT)
    centres = 0.5 * (edges[1:] + edges[:-1])
    capacity = np.diff(edges**dimension) / dimension
    # resistance between two radii: the integral of dr / r^(dimension - 1)
    radii = np.append(centres, 1.0)
    resistance = {1: np.diff(radii), 2: np.diff(np.log(radii)), 3: 1.0 / radii[:-1] - 1.0 / radii[1:]}[dimension]
    weight = capacity / capacity.sum()
    if core:
        # cell means that give the value at the centre exactly for a + b r^2 + c r^4
        powers = [dimension + p for p in (0, 2, 4)]
        moments = np.stack([np.diff(edges[:4] ** p) / (p * capacity[:3]) for p in powers])
        weight = np.concatenate([np.linalg.solve(moments, [1.0, 0.0, 0.0]), np.zeros(VOLUMES - 3)])
    return Cells(capacity, 1.0 / resistance[:-1], float(resistance[-1]), weight)


def sheathed(body: Cells, time_constant_s: float, capacity: float) -> Cells:
    """A body with one more cell around it, which holds `capacity` times what the body holds and is not read."""
    return Cells(
        np.append(body.capacity, capacity * body.capacity.sum()),
        np.append(body.link, 1.0 / body.to_surface),
        body.to_surface,
        np.append(body.weight, 0.0),
        time_constant_s,
    )


def march(body: Cells, rate: Array, biot: Array, drive: Array, follow: Follow | None = None) -> Array:
    """Reading (r, n) of r bodies driven at their surface by `drive` (r, n), from rest.

    Parameters
    ----------
    body : Cells
    rate, biot : ndarray, broadcasting with `drive`
        Rate [1/s] that all conductances are multiplied by, and Biot number of the exchange, infinite where the
        surface is held at the air.
    drive : ndarray (r, n)
        The air, every FINE_STEP_S.
    follow : (step, states (r, N)) -> ndarray (r, N), optional
        A further factor of the rate in each cell.

    Notes
    -----
    Chains of cells lie one after another in one symmetric tridiagonal system. A sheath has no rate of its own: it
    follows the air at its time constant, through the film of `biot` where there is one, and what the body takes from it
    goes at the rate of the body's last cell.
    """
    runs, count = drive.shape
    size = body.capacity.size
    scale = np.broadcast_to(rate, drive.shape)
    film = np.broadcast_to(1.0 / biot, drive.shape)
    surface = 1.0 / (body.to_surface + film)
    steady = follow is None and bool(np.all(scale == scale[:, :1]) and np.all(surface == surface[:, :1]))
    heavy = np.tile(body.capacity, runs) * 1.5 / FINE_STEP_S
    state = np.repeat(drive[:, 0], size)
    before = state.copy()
    ends = np.arange(1, runs + 1) * size - 1
    reading = np.empty(drive.shape)
    reading[:, 0] = drive[:, 0]
    per_step = np.tile(body.capacity, runs) / FINE_STEP_S
    factor, opening = None, np.zeros(runs)
    for k in range(1, count):
        if factor is None or not steady:
            own_factor = np.ones((runs, size))
            if follow is not None:
                own_factor = follow(k, (2 * state - before).reshape(runs, size))
            local = scale[:, k, None] * own_factor
            if body.sheath_s:
                local[:, -1] = local[:, -2]
            between = np.zeros((runs, size + 1))
            between[:, 1:-1] = body.link * 0.5 * (local[:, 1:] + local[:, :-1])
            opening = surface[:, k] * local[:, -1]
            if body.sheath_s:
                opening = 1.0 / (body.sheath_s / body.capacity[-1] + film[:, k] / local[:, -1])
            own = between[:, 1:] + between[:, :-1]
            own[:, -1] += opening
            beside = -between[:, 1:].ravel()[:-1]
            factor = lapack.dpttrf(heavy + own.ravel(), beside if beside.size else np.zeros(1))  # a lump has none
        right = per_step * (2.0 * state - 0.5 * before)
        right[ends] += opening * drive[:, k]
        before = state
        state = lapack.dpttrs(factor[0], factor[1], right)[0]
        reading[:, k] = state.reshape(runs, size) @ body.weight
    return reading


def lag(drive: Array, time_constant_s: float) -> Array:
    """First-order lag behind (r, n), from rest, exact for air that is straight over each step."""
    x = FINE_STEP_S / time_constant_s
    decay = np.exp(-x)
    new = 1.0 - (1.0 - decay) / x
    b, a = [new, 1.0 - decay - new], [1.0, -decay]
    return np.stack([lfilter(b, a, row, zi=lfiltic(b, a, [row[0]], [row[0]]))[0] for row in drive])


def held_back(values: Array, height: float, span: float) -> Array:
    """Play (r, n): low by `height` after a rise, high by it after a fall, setting in over `span` of change."""
    slope = 2.0 * height / span
    offset = np.zeros(values.shape)
    for k in range(1, values.shape[1]):
        offset[:, k] = np.clip(offset[:, k - 1] - slope * (values[:, k] - values[:, k - 1]), -height, height)
    return offset


def since(mask: NDArray[np.bool_]) -> Array:
    """Time [s] since `mask` (r, n) was last true, 0 where it is, infinite where it never was."""
    time = np.arange(float(mask.shape[1])) * FINE_STEP_S
    return time - np.maximum.accumulate(np.where(mask, time, -np.inf), axis=1)
