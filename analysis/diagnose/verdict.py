"""The verdict on a channel: one pure function of what was weighed, what is left, and what single readings show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

VerdictWord = Literal["adequate", "explained", "described", "unexplained"]


@dataclass(frozen=True)
class Standing:
    """All that a verdict rests on.

    Attributes
    ----------
    named, forms : int
        Effects of the catalogue, and forms of the grammar, in the model with the largest weight.
    shown : int
        What single readings show that no entry of the catalogue accounts for: a hum, bursts, a rounding.
    left_over : bool
        Whether that model leaves more than chance does on unseen runs, and as much as the tolerance.
    parted : bool
        Whether a check of the input says that the runs fall into groups which the model does not part.
    left_open : bool
        Whether another model is likelier than the plain one, though no effect is sure enough to be stated.
    unsettled : bool
        Whether most runs could not be used since their readings did not stand still before the transfer.
    borne_out : bool
        Whether another run than those that were fitted could be tried.
    claims : bool
        Whether anything in the model says more than how one response goes.
    """

    named: int = 0
    forms: int = 0
    shown: int = 0
    left_over: bool = False
    parted: bool = False
    left_open: bool = False
    unsettled: bool = False
    borne_out: bool = True
    claims: bool = True


def verdict(s: Standing) -> VerdictWord:
    """The verdict.

    Something that is left and matters is unexplained. A form or something shown makes a description; effects of the
    catalogue alone, an explanation. A model with nothing added is adequate, where no candidate predicts unseen runs
    better (or it would not have the largest weight, or its effects are not sure enough), no check of the input
    speaks against it, and it has been tried on most of the runs that were made.
    """
    if s.left_over or (s.parted and not s.forms):
        return "unexplained"
    if not s.borne_out and s.named and not s.claims:
        return "unexplained"  # a shape that no other run has borne out explains nothing
    if s.forms or s.shown:
        return "described"
    if s.named:
        return "explained"
    return "unexplained" if s.unsettled or s.left_open else "adequate"
