"""The shapes that a sensing body may have in the plain model, each with its closed form held at the air, behind a
resistance and within a sheath that it loads.

`BODIES` is the table that `sensors.imet.body` and `sensors.hyt.body` of campaign.json name; a new shape is one entry.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import j0, j1

from shockrig.analysis.physics import modes
from shockrig.analysis.physics.exponentials import Modes, response_times
from shockrig.analysis.physics.modes import alternating, bessel_zeros, closed, first_order, roots_between

__all__ = [
    "cylinder_core",
    "cylinder_mean",
    "film_mean",
    "lump",
    "plate_middle",
    "sphere_core",
    "sphere_mean",
    "BODIES",
    "Body",
]

Array = NDArray[np.float64]

# Closed forms of the bodies within a well-mixed sheath that they load: a layer between air and body, with heat of its
# own, that gives to the body what it takes from the air.
#
# The sheath (capacity c times the body's, time constant tau behind the air when alone) obeys C_s dTs/dt = (C_s / tau)
# (T_air - Ts) - (what goes into the body). With rates b^2 in units of alpha/R^2 or D/L^2, g the body's surface over
# volume times that length, chi = c / g and Bi = c / (tau g) with tau in units of R^2/alpha or L^2/D, its modes are
# the roots of
#
#     Y(b) + chi b^2 = Bi,    Y = 1 - b cot b (sphere), b J1(b) / J0(b) (cylinder), b tan b (plate, film),
#
# one between each two poles of Y, as Y rises all the way; amplitudes are -2 Bi rho / (2 chi b^2 + b Y'(b)), with rho
# what is read over what the surface has. Without capacity (chi = 0) this is the body behind a resistance. Source: the
# boundary condition of Carslaw and Jaeger (1959), section 1.9, contact with a well-stirred fluid; residues of the
# transfer function Bi rho / (Bi - chi b^2 - Y) at s = -b^2.

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


@dataclass(frozen=True)
class Body:
    """One shape: what is known of it and its responses to a unit step of the air, rates in units of `symbol`.

    Attributes
    ----------
    name : str
        As campaign.json has it.
    sentence : str
        For people: "a sphere read at its core".
    diffusivity, length : str
        Symbols of the diffusivity, "alpha" (heat) or "D" (vapour), and of the length that it is quoted for: "R", a
        radius, or "L", a film's thickness or half a plate's. `length` is empty for a lump, which has neither.
    surface_to_volume : float
        Surface over volume times that length; behind a large resistance the rate is this times the Biot number.
    held : () -> Modes
        Surface at the air; one set of modes (K,). A shape takes the number of modes as an argument.
    behind : (Biot numbers, any shape, positive) -> Modes
        Surface behind a transfer resistance; modes of shape (..., K). A shape takes the number of modes as well.
    sheathed : (time constants, capacities, positive, broadcasting) -> Modes
        Within a well-mixed layer: what it would follow the air with when alone, times the body's rate, and its capacity
        relative to the body's; modes of shape (..., K).
    """

    name: str
    sentence: str
    diffusivity: str
    length: str
    surface_to_volume: float
    held: Callable[..., Modes]
    behind: Callable[..., Modes]
    sheathed: Callable[..., Modes]

    @property
    def symbol(self) -> str:
        """Symbol of the rate that is fitted: "alpha/R^2", "D/L^2" or "1/tau"."""
        return self.symbol_with(self.diffusivity)

    def symbol_with(self, diffusivity: str) -> str:
        """Symbol of the fitted rate where the body takes up something else: "D/R^2" for a sphere of polymer."""
        return f"{diffusivity}/{self.length}^2" if self.length else "1/tau"

    @cached_property
    def landmarks(self) -> tuple[float, float, float]:
        """Dimensionless times (times `symbol`) to 1 - 1/e, 90 and 98 % of a step, surface at the air."""
        t63, t90, t98 = response_times(self.held())
        return t63, t90, t98

    def sheath_time(self, time_constant: ArrayLike, capacity: ArrayLike, biot: ArrayLike | None) -> Array:
        """Time constant of a sheath (times the body's rate) with a film outside of it: their resistances add.

        `biot` is the film's number for this body's surface, None where there is none; the sheath's own would be
        capacity / (surface_to_volume time_constant).
        """
        own = np.asarray(time_constant, dtype=float)
        return own if biot is None else own + np.asarray(capacity) / (self.surface_to_volume * np.asarray(biot))


def _lump_behind(biot: ArrayLike) -> Modes:
    """A lump has no profile inside, so two conductances in series are all there is: rate Bi / (1 + Bi), one mode.

    At one airflow this cannot be told from a lump with a longer time constant; over several airflows it can.
    """
    biot = np.asarray(biot, dtype=float)
    return first_order((1.0 + biot) / biot)


def _lump() -> Modes:
    return first_order(1.0)


_SHAPES = (
    Body(
        name="sphere",
        sentence="a sphere read at its core",
        diffusivity="alpha",
        length="R",
        surface_to_volume=3.0,
        held=modes.sphere_core,
        behind=modes.sphere_core_biot,
        sheathed=sphere_core,
    ),
    Body(
        name="film",
        sentence="a film sealed on one face, read as its mean",
        diffusivity="D",
        length="L",
        surface_to_volume=1.0,
        held=modes.film_mean,
        behind=modes.film_mean_biot,
        sheathed=film_mean,
    ),
    Body(
        name="sphere_mean",
        sentence="a sphere read as its mean",
        diffusivity="alpha",
        length="R",
        surface_to_volume=3.0,
        held=modes.sphere_mean,
        behind=modes.sphere_mean_biot,
        sheathed=sphere_mean,
    ),
    Body(
        name="cylinder",
        sentence="a cylinder read at its axis",
        diffusivity="alpha",
        length="R",
        surface_to_volume=2.0,
        held=modes.cylinder_core,
        behind=modes.cylinder_core_biot,
        sheathed=cylinder_core,
    ),
    Body(
        name="cylinder_mean",
        sentence="a cylinder read as its mean",
        diffusivity="alpha",
        length="R",
        surface_to_volume=2.0,
        held=modes.cylinder_mean,
        behind=modes.cylinder_mean_biot,
        sheathed=cylinder_mean,
    ),
    Body(
        name="plate",
        sentence="a plate read at its middle",
        diffusivity="alpha",
        length="L",
        surface_to_volume=1.0,
        held=modes.plate_middle,
        behind=modes.plate_middle_biot,
        sheathed=plate_middle,
    ),
    Body(
        name="lumped",
        sentence="a lump with one time constant",
        diffusivity="",
        length="",
        surface_to_volume=1.0,
        held=_lump,
        behind=_lump_behind,
        sheathed=lump,
    ),
)

BODIES: dict[str, Body] = {body.name: body for body in _SHAPES}
