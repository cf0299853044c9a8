"""Film whose diffusivity changes linearly with concentration, as a warp of time of the film with constant diffusivity.

u_t = ((1 + kappa (1 - u)) u_x)_x on 0 < x < 1, sealed at 0, u = 1 at the surface, u = 0 at the start: one family of
curves in kappa = D(source) / D(destination) - 1 holds every step of such a film (Crank 1975, chapter 9).
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

if TYPE_CHECKING:
    from scipy.interpolate import RectBivariateSpline

Array = NDArray[np.float64]

GRID_CELLS = 72
POINTS_BETWEEN = 10  # points between two of the table
LOG_RATIO = np.linspace(np.log(0.08), np.log(12.0), 29)
LOG_TIME = np.linspace(np.log(2e-5), np.log(6.0), 120)


def time_warp(fourier: Array, ratio: Array) -> Array:
    """Factor on time that turns the constant film's mean uptake into the concentration-dependent one.

    Parameters
    ----------
    fourier : ndarray
        Dimensionless time D(destination) t / L^2, >= 0.
    ratio : ndarray, broadcast with it
        D(source) / D(destination), within 0.08 to 12 (held at those bounds beyond).
    """
    table = _fine()
    row, right = _between(np.log(ratio), LOG_RATIO, table.shape[0])
    column, late = _between(np.log(np.maximum(fourier, 1e-300)), LOG_TIME, table.shape[1])
    flat, at = table.ravel(), row * table.shape[1] + column
    low, high = flat[at], flat[at + table.shape[1]]
    low += late * (flat[at + 1] - low)
    high += late * (flat[at + table.shape[1] + 1] - high)
    return np.asarray(low + right * (high - low))


def _between(value: Array, grid: Array, size: int) -> tuple[NDArray[np.int64], Array]:
    """Place of values on an even grid of `size` points over the ends of `grid`: the point below, and the rest."""
    place = np.clip((value - grid[0]) * ((size - 1) / (grid[-1] - grid[0])), 0.0, size - 1.0)
    below = np.minimum(place.astype(int), size - 2)
    return below, place - below


@cache
def _fine() -> Array:
    """The factor itself on a grid so fine that straight lines between its points are good to 5e-5."""
    rows, columns = (
        np.linspace(grid[0], grid[-1], POINTS_BETWEEN * (grid.size - 1) + 1) for grid in (LOG_RATIO, LOG_TIME)
    )
    return np.asarray(np.exp(_table()(rows, columns)))


@cache
def _table() -> RectBivariateSpline:
    from scipy.interpolate import RectBivariateSpline

    times = np.geomspace(1e-7, 12.0, 900)
    # The constant film is integrated on the same grid, so that the error of the stepping cancels in the warp.
    uptake = _uptake(np.concatenate([[0.0], np.exp(LOG_RATIO) - 1.0]), times)
    linear, log_time = uptake[0], np.log(times)
    warp = np.empty((LOG_RATIO.size, LOG_TIME.size))
    for i, curve in enumerate(uptake[1:]):
        early = np.interp(curve, linear, log_time)
        # Near the end the remainder is compared, to keep its digits.
        late = np.interp(-np.log(np.maximum(1 - curve, 1e-12)), -np.log(np.maximum(1 - linear, 1e-12)), log_time)
        shift = np.where(curve < 0.5, early, late) - log_time
        settled = (curve > 1 - 1e-7) | (late > log_time[-2])
        last = int(np.argmax(settled)) if settled.any() else times.size
        shift[last:] = shift[last - 1]
        warp[i] = np.interp(LOG_TIME, log_time, shift)
    return RectBivariateSpline(LOG_RATIO, LOG_TIME, warp, kx=3, ky=3)


def _uptake(kappa: Array, times: Array) -> Array:
    """Mean uptake (len(kappa), len(times)) by finite volumes on cells that narrow towards the surface."""
    edge = np.concatenate([[0.0], np.cumsum(np.geomspace(1.0, 3e-3, GRID_CELLS))])
    edge /= edge[-1]
    width = np.diff(edge)
    between = 0.5 * (width[1:] + width[:-1])
    u = np.zeros((kappa.size, GRID_CELLS))
    out = np.empty((kappa.size, times.size))
    now = 0.0
    for j, t in enumerate(times):
        new = u
        for _ in range(2):
            # Flux through a face uses the mean of the diffusivity over the two cells, exact for a linear law.
            d = 1.0 + kappa[:, None] * (1.0 - new)
            face = 0.5 * (d[:, 1:] + d[:, :-1]) / between
            surface = 0.5 * (d[:, -1] + 1.0) / (0.5 * width[-1])
            new = _implicit(u, face, surface, width, t - now)
        u, now = new, t
        out[:, j] = u @ width
    return out


def _implicit(u: Array, face: Array, surface: Array, width: Array, dt: float) -> Array:
    """One backward Euler step, for all kappa at once: their tridiagonal systems in one row, uncoupled."""
    lower, upper = np.zeros_like(u), np.zeros_like(u)
    lower[:, 1:], upper[:, :-1] = -dt * face / width[1:], -dt * face / width[:-1]
    diagonal = 1.0 - lower - upper
    right = u.copy()
    diagonal[:, -1] += dt * surface / width[-1]
    right[:, -1] += dt * surface / width[-1]
    *_, new, failed = lapack.dgtsv(lower.ravel()[1:], diagonal.ravel(), upper.ravel()[:-1], right.ravel())
    if failed:
        raise FloatingPointError("the film's diffusion could not be stepped")
    return new.reshape(u.shape)
