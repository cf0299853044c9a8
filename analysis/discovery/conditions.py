"""A description judged on whole conditions that it has not seen: all runs of one airflow, ambient, direction or kind.

It is fitted without them and predicts them, their own starts and airs as uncertain as stated; so does the model without
it. The squares that it saves there, beside those that it leaves, are an F-ratio.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from shockrig.analysis.discovery.grammar import varied
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.fit import Fit, fit
from shockrig.analysis.inference.problem import Problem

ALIKE = 0.1  # of the logarithm of two airflows that are one condition
LEAST_TRAINED = 6  # runs that a description is fitted to
LEAST_TOLD = 0.3  # share of the squares of all steps that they have
STEPS = 12
CHANCE = 1e-3  # of so much saved by accident, above which a description is none
HARM = 0.05  # share of all that is saved, by which a single condition may be predicted worse
TIE = 6.0


@dataclass(frozen=True)
class Condition:
    """One condition held out: its name, what the description saved there (deviance), and before and after squares."""

    name: str
    saved: float
    before: float
    after: float
    bins: int


@dataclass(frozen=True)
class Judged:
    """What all conditions together say of a description."""

    conditions: tuple[Condition, ...]
    numbers: int

    @property
    def saved(self) -> float:
        """Drop in deviance over all conditions."""
        return sum(c.saved for c in self.conditions)

    @property
    def p(self) -> float:
        """Probability of an F-ratio as large by accident: of the squares saved, or of the deviance where that is more:
        what is wrong with the rates the runs' own deviations take up, which leave no squares."""
        before, after = sum(c.before for c in self.conditions), sum(c.after for c in self.conditions)
        degrees = sum(c.bins for c in self.conditions) - self.numbers
        if degrees < 1 or after <= 0:
            return 1.0
        ratio = max(before - after, self.saved) / max(self.numbers, 1) / (after / degrees)
        return float(special.fdtrc(max(self.numbers, 1), degrees, ratio)) if ratio > 0 else 1.0

    @property
    def harmed(self) -> tuple[str, ...]:
        """Conditions that are predicted worse with the description."""
        return tuple(c.name for c in self.conditions if c.saved < -(TIE + HARM * max(self.saved, 0.0)))

    @property
    def holds(self) -> bool:
        """Whether the description predicts conditions that it has not seen."""
        return len(self.conditions) > 1 and self.saved > 0 and self.p < CHANCE and not self.harmed


def judged_by_condition(problem: Problem, without: Fit, found: Fit, factors: set[str]) -> Judged:
    """Hold out each condition in turn; `factors` are those that the description depends on.

    A factor with two values is not held out where the description depends on it: one value says nothing of the other;
    nor is a condition without which a factor that the description depends on does not vary.
    """
    conditions, needed = [], factors & varied(problem.channel)
    told = problem.channel.quantity.step(problem.channel.conditions) ** 2
    for name, test in held_out(problem.channel, factors):
        train = ~test
        known = np.isin(problem.channel.ambient, problem.channel.ambient[train])
        test = test & known
        # Runs that hardly step do not tell the rates that the others are to be predicted with.
        if train.sum() < LEAST_TRAINED or not test.any() or told[train].sum() < LEAST_TOLD * told.sum():
            continue
        if not needed <= varied(problem.channel.select(train)):
            continue
        scored = [_scored(problem, f, train, test) for f in (without, found)]
        (deviance, before), (lower, after) = scored
        conditions.append(
            Condition(name, deviance - lower, before, after, int((problem.channel.count[test] > 0).sum()))
        )
    numbers = len(found.structure.parameters) - len(without.structure.parameters)
    return Judged(tuple(conditions), numbers)


def _scored(problem: Problem, whole: Fit, train: NDArray[np.bool_], test: NDArray[np.bool_]) -> tuple[float, float]:
    """Deviance and squares of the runs `test` under a model fitted to the runs `train`."""
    part, bins = problem.select(train), problem.select(test)
    own = fit(part, whole.structure, whole.theta, whole.deviations[train], STEPS)
    bins = bins.with_rate_scatter(own.rate_scatter)
    there = fit(bins, whole.structure, own.theta, bins.channel.at_rest(), STEPS, adapt_scatter=False, hold_theta=True)
    return there.deviance, there.objective


def held_out(channel: Channel, factors: set[str]) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Names and runs (R,) of the conditions that a description may be tried on."""
    c, there = channel.conditions, varied(channel)
    if "airflow" in there:
        levels = np.round(np.log(np.maximum(c.airflow_m_s, 0.05)) / ALIKE)
        if np.unique(levels).size > 2 or "airflow" not in factors:
            for level in np.unique(levels):
                runs = levels == level
                if runs.sum() < channel.runs - LEAST_TRAINED:
                    yield f"airflow {c.airflow_m_s[runs].mean():.2g} m/s", runs
    if "ambient" in there and channel.quantity.pooled:
        ambient = np.round(c.destination_c / 2.0)
        if np.unique(ambient).size > 2 or "ambient" not in factors:
            for level in np.unique(ambient):
                yield f"ambient {c.destination_c[ambient == level].mean():.0f} degC", ambient == level
    if "direction" in there and not factors & {"direction", "humidity"}:
        up = channel.quantity.step(c) > 0
        yield "steps upwards", up
        yield "steps downwards", ~up
    if "step" in there and "step" not in factors:
        size = np.abs(channel.quantity.step(c))
        yield "small steps", size < 0.5 * size.max()
    if channel.jumps_with_air and channel.isothermal.any() and (~channel.isothermal).any():
        yield "thermal shocks", ~channel.isothermal
        yield "isothermal shocks", channel.isothermal
