"""Work that a search may do, counted in fits and not in seconds, so that it ends at the same place on every machine."""

from __future__ import annotations

import numpy as np

from shockrig.analysis.inference.model import Model, Point, Structure
from shockrig.analysis.inference.problem import Problem

DRIVEN_COST = 6.0  # a record that is driven all along, beside one that jumps


class Work:
    """How many fits a search has made, and how many it may make."""

    def __init__(self, at_most: float = float("inf")) -> None:
        self.at_most = at_most
        self.fits = 0

    def count(self, fits: int = 1) -> None:
        """So many more fits were made."""
        self.fits += fits

    @property
    def ended(self) -> bool:
        """Whether no further fit may begin."""
        return self.fits >= self.at_most


def cost_of_a_fit(problem: Problem, base: Structure) -> float:
    """What a fit costs beside one of a record that jumps and is not averaged."""
    if problem.channel.measured.any():
        return DRIVEN_COST
    return _averaged(problem, base)


def _averaged(problem: Problem, base: Structure) -> float:
    """Length of a running mean that has to be summed reading by reading."""
    if not problem.channel.jumps_with_air:
        return 1.0
    model, at_rest = Model(problem.channel, base), problem.channel.at_rest()
    start = model.start(np.zeros(problem.channel.rates))
    return float(model.chain(Point(start[None], at_rest[None])).averaged)
