"""The shapes that a sensing body may have in the plain model, each with its closed form held at the air, behind a
resistance and within a sheath that it loads.

`BODIES` is the table that `sensors.imet.body` and `sensors.hyt.body` of campaign.json name; a new shape is one entry.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shockrig.analysis.physics import modes, sheathed
from shockrig.analysis.physics.exponentials import Modes, response_times
from shockrig.analysis.physics.lags import first_order

__all__ = ["BODIES", "Body"]

Array = NDArray[np.float64]


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

    @property
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
        sheathed=sheathed.sphere_core,
    ),
    Body(
        name="film",
        sentence="a film sealed on one face, read as its mean",
        diffusivity="D",
        length="L",
        surface_to_volume=1.0,
        held=modes.film_mean,
        behind=modes.film_mean_biot,
        sheathed=sheathed.film_mean,
    ),
    Body(
        name="sphere_mean",
        sentence="a sphere read as its mean",
        diffusivity="alpha",
        length="R",
        surface_to_volume=3.0,
        held=modes.sphere_mean,
        behind=modes.sphere_mean_biot,
        sheathed=sheathed.sphere_mean,
    ),
    Body(
        name="cylinder",
        sentence="a cylinder read at its axis",
        diffusivity="alpha",
        length="R",
        surface_to_volume=2.0,
        held=modes.cylinder_core,
        behind=modes.cylinder_core_biot,
        sheathed=sheathed.cylinder_core,
    ),
    Body(
        name="cylinder_mean",
        sentence="a cylinder read as its mean",
        diffusivity="alpha",
        length="R",
        surface_to_volume=2.0,
        held=modes.cylinder_mean,
        behind=modes.cylinder_mean_biot,
        sheathed=sheathed.cylinder_mean,
    ),
    Body(
        name="plate",
        sentence="a plate read at its middle",
        diffusivity="alpha",
        length="L",
        surface_to_volume=1.0,
        held=modes.plate_middle,
        behind=modes.plate_middle_biot,
        sheathed=sheathed.plate_middle,
    ),
    Body(
        name="lumped",
        sentence="a lump with one time constant",
        diffusivity="",
        length="",
        surface_to_volume=1.0,
        held=_lump,
        behind=_lump_behind,
        sheathed=sheathed.lump,
    ),
)

BODIES: dict[str, Body] = {body.name: body for body in _SHAPES}
