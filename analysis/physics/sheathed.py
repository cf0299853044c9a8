"""Closed forms of the bodies within a well-mixed sheath that they load: a layer between air and body, with heat of its
own, that gives to the body what it takes from the air.

The sheath (capacity c times the body's, time constant tau behind the air when alone) obeys C_s dTs/dt = (C_s / tau)
(T_air - Ts) - (what goes into the body). With rates b^2 in units of alpha/R^2 or D/L^2, g the body's surface over
volume times that length, chi = c / g and Bi = c / (tau g) with tau in units of R^2/alpha or L^2/D, its modes are the
roots of

    Y(b) + chi b^2 = Bi,    Y = 1 - b cot b (sphere), b J1(b) / J0(b) (cylinder), b tan b (plate, film),

one between each two poles of Y, as Y rises all the way; amplitudes are -2 Bi rho / (2 chi b^2 + b Y'(b)), with rho
what is read over what the surface has. Without capacity (chi = 0) this is the body behind a resistance. Source: the
boundary condition of Carslaw and Jaeger (1959), section 1.9, contact with a well-stirred fluid; residues of the
transfer function Bi rho / (Bi - chi b^2 - Y) at s = -b^2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import j0, j1

from shockrig.analysis.physics.exponentials import Modes
from shockrig.analysis.physics.modes import alternating, bessel_zeros, closed, roots_between

__all__ = ["cylinder_core", "cylinder_mean", "film_mean", "lump", "plate_middle", "sphere_core", "sphere_mean"]

Array = NDArray[np.float64]
CORE_MODES = 32
MEAN_MODES = 64
Solve = Callable[[Array, Array], Modes]


def sphere_core(time_constant: ArrayLike, capacity: ArrayLike, count: int = CORE_MODES) -> Modes:
    """Core of a sphere in a sheath: rho = b / sin b."""

    def solve(tau: Array, c: Array) -> Modes:
        bi, b, y, slope = _sphere(tau, c, count)
        return alternating(-2.0 * bi * _signs(count) * np.hypot(b, 1.0 - y) / slope, b**2)

    return _by_value(time_constant, capacity, solve)


def sphere_mean(time_constant: ArrayLike, capacity: ArrayLike, count: int = MEAN_MODES) -> Modes:
    """Mean of a sphere in a sheath: rho = 3 Y / b^2."""

    def solve(tau: Array, c: Array) -> Modes:
        bi, b, y, slope = _sphere(tau, c, count)
        return closed(-6.0 * bi * y / (b**2 * slope), b**2)

    return _by_value(time_constant, capacity, solve)


def cylinder_core(time_constant: ArrayLike, capacity: ArrayLike, count: int = CORE_MODES) -> Modes:
    """Axis of a cylinder in a sheath: rho = 1 / J0(b)."""

    def solve(tau: Array, c: Array) -> Modes:
        bi, b, y, slope = _cylinder(tau, c, count)
        # 1 / J0 = Y / (b J1); of the two Bessel functions the larger keeps its digits.
        rho = np.where(np.abs(j0(b)) > np.abs(j1(b)), 1.0 / j0(b), y / (b * j1(b)))
        return alternating(-2.0 * bi * rho / slope, b**2)

    return _by_value(time_constant, capacity, solve)


def cylinder_mean(time_constant: ArrayLike, capacity: ArrayLike, count: int = MEAN_MODES) -> Modes:
    """Mean of a cylinder in a sheath: rho = 2 Y / b^2."""

    def solve(tau: Array, c: Array) -> Modes:
        bi, b, y, slope = _cylinder(tau, c, count)
        return closed(-4.0 * bi * y / (b**2 * slope), b**2)

    return _by_value(time_constant, capacity, solve)


def plate_middle(time_constant: ArrayLike, capacity: ArrayLike, count: int = CORE_MODES) -> Modes:
    """Middle of a plate in a sheath: rho = 1 / cos b."""

    def solve(tau: Array, c: Array) -> Modes:
        bi, b, y, slope = _plate(tau, c, count)
        return alternating(-2.0 * bi * _signs(count) * np.hypot(b, y) / (b * slope), b**2)

    return _by_value(time_constant, capacity, solve)


def film_mean(time_constant: ArrayLike, capacity: ArrayLike, count: int = MEAN_MODES) -> Modes:
    """Mean of a film under a sheath: rho = Y / b^2."""

    def solve(tau: Array, c: Array) -> Modes:
        bi, b, y, slope = _plate(tau, c, count)
        return closed(-2.0 * bi * y / (b**2 * slope), b**2)

    return _by_value(time_constant, capacity, solve)


def lump(time_constant: ArrayLike, capacity: ArrayLike) -> Modes:
    """A lump in a sheath is two nodes: lambda^2 - (1 + k + 1/c) lambda + k = 0 with k = 1 / tau, both roots real."""
    k, c = np.broadcast_arrays(1.0 / np.asarray(time_constant, dtype=float), np.asarray(capacity, dtype=float))
    apart = np.sqrt((1.0 - k) ** 2 + (2.0 * (1.0 + k) + 1.0 / c) / c)
    fast = 0.5 * (1.0 + k + 1.0 / c + apart)
    rate = np.stack([k / fast, fast], axis=-1)
    return Modes(np.stack([-fast / apart, k / fast / apart], axis=-1), rate)


def _sphere(tau: Array, c: Array, count: int) -> tuple[Array, Array, Array, Array]:
    """Bi, and the roots b with Y and 2 chi b^2 + b Y' there; b cot b is taken from the equation."""
    edges = np.arange(count + 1.0) * np.pi
    bi, chi = c / (3.0 * tau), c / 3.0

    def function(x: Array) -> Array:
        return x * np.cos(x) - (1.0 - bi + chi * x**2) * np.sin(x)

    def derivative(x: Array) -> Array:
        return (bi - chi * x**2) * np.cos(x) - (1.0 + 2.0 * chi) * x * np.sin(x)

    b = _roots(function, derivative, edges, (1.0 / 6.0) + tau * (1.0 + 1.0 / c), tau * (1.0 + 1.0 / c))
    y = bi - chi * b**2
    return bi, b, y, (1.0 + 2.0 * chi) * b**2 + y**2 - y


def _cylinder(tau: Array, c: Array, count: int) -> tuple[Array, Array, Array, Array]:
    edges = np.concatenate([[0.0], bessel_zeros(0, count)])
    bi, chi = c / (2.0 * tau), c / 2.0

    def function(x: Array) -> Array:
        return x * j1(x) - (bi - chi * x**2) * j0(x)

    def derivative(x: Array) -> Array:
        return (1.0 + 2.0 * chi) * x * j0(x) + (bi - chi * x**2) * j1(x)

    b = _roots(function, derivative, edges, 0.25 + tau * (1.0 + 1.0 / c), tau * (1.0 + 1.0 / c))
    y = bi - chi * b**2
    return bi, b, y, (1.0 + 2.0 * chi) * b**2 + y**2


def _plate(tau: Array, c: Array, count: int) -> tuple[Array, Array, Array, Array]:
    edges = np.concatenate([[0.0], (np.arange(count) + 0.5) * np.pi])
    bi, chi = c / tau, c

    def function(x: Array) -> Array:
        return x * np.sin(x) - (bi - chi * x**2) * np.cos(x)

    def derivative(x: Array) -> Array:
        return (1.0 + bi - chi * x**2) * np.sin(x) + (1.0 + 2.0 * chi) * x * np.cos(x)

    b = _roots(function, derivative, edges, 0.5 + tau * (1.0 + 1.0 / c), tau * (1.0 + 1.0 / c))
    y = bi - chi * b**2
    return bi, b, y, (1.0 + 2.0 * chi) * b**2 + y**2 + y


def _roots(
    function: Callable[[Array], Array], derivative: Callable[[Array], Array], edges: Array, longest: Array, mean: Array
) -> Array:
    """Roots (n, K) between the poles `edges` (K + 1,), the first of them between bounds that hold it however small.

    The slowest time constant 1 / b^2 is less than `longest` (n, 1), the sum of all of them (each part's capacity times
    its resistance to the air), and more than `mean`, the lag of sheath and body were they one.
    """
    low = np.repeat(edges[None, :-1], longest.shape[0], axis=0)
    high = np.repeat(edges[None, 1:], longest.shape[0], axis=0)
    low[:, :1] = 1.0 / np.sqrt(longest)
    high[:, :1] = np.minimum(high[:, :1], 1.0 / np.sqrt(mean))
    return roots_between(function, derivative, low, high)


def _signs(count: int) -> Array:
    """Of sin b or cos b between the poles."""
    return np.where(np.arange(count) % 2 == 0, 1.0, -1.0)


def _by_value(time_constant: ArrayLike, capacity: ArrayLike, solve: Solve) -> Modes:
    """Modes for arrays that broadcast, each different pair of values solved once: runs share their rates."""
    tau, c = np.broadcast_arrays(np.asarray(time_constant, dtype=float), np.asarray(capacity, dtype=float))
    different, place = np.unique(tau + 1j * c, return_inverse=True)
    modes = solve(different.real[:, None], different.imag[:, None])
    place = place.reshape(tau.shape)
    return Modes(modes.amplitude[place], modes.rate[place])
