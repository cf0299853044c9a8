"""What the uncertainty of a fit comes from: its inputs, each with what it does to theta, and its line in a budget."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.characterization.result import Part
from shockrig.analysis.characterization.shifts import shifts
from shockrig.analysis.inference.common import LEAST_TRIGGER_OFFSET_S, TRIGGER
from shockrig.analysis.inference.noise import Noise
from shockrig.analysis.inference.quantity import RunEffect
from shockrig.analysis.inference.rate_scatter import RATE_SCATTER_WEIGHT

Array = NDArray[np.float64]

COMMON_LINES = {
    "air_temperature_k": ("reference thermometer, all runs alike", "K"),
    "air_humidity_percent": ("reference hygrometer, all runs alike", "%RH"),
    "airflow_percent": ("anemometer, all runs alike", "%"),
    "pressure_hpa": ("barometer, all runs alike", "hPa"),
    TRIGGER: ("trigger, all runs alike", "s"),
    "clock_ppm": ("clock, all runs alike", "1e-6"),
}


@dataclass(frozen=True)
class Component:
    """One component of a budget.

    Attributes
    ----------
    component : str
    kind : str
        "A" (evaluated from the readings) or "B" (from what is stated of an input).
    distribution : str
    standard_uncertainty, unit : float, str
        Of the input.
    sensitivity : float
        Change of the figure by one unit of the input; of what differs from run to run (or from reading to reading),
        the root of the sum of squares over the runs, without a sign.
    degrees : float
        Degrees of freedom; infinite where the uncertainty is taken as it was stated.
    key : str
        Of what all runs share: its key in campaign.json; empty for the rest.
    """

    component: str
    kind: str
    distribution: str
    standard_uncertainty: float
    unit: str
    sensitivity: float = 0.0
    degrees: float = math.inf
    key: str = ""

    @property
    def contribution(self) -> float:
        """In the figure's unit, not negative."""
        return abs(self.sensitivity) * self.standard_uncertainty


@dataclass(frozen=True)
class Source:
    """One input: its line without a sensitivity, and what it moves theta by, columns (P, m) of unit variance."""

    of: Component
    moves: Array

    def line(self, slope: Array) -> Component:
        """The line of a figure that theta moves by `slope` (P,)."""
        along = slope @ self.moves
        return self.giving(float(along[0]) if along.size == 1 else float(np.sqrt((along**2).sum())))

    def giving(self, contribution: float) -> Component:
        """The line of a figure that it moves by so much, one standard uncertainty."""
        return replace(self.of, sensitivity=contribution / self.of.standard_uncertainty)


def sources(part: Part, noise: Noise) -> list[Source]:
    """The readings' noise, each random effect of the runs, what is known beforehand, what all runs share."""
    channel, found = part.channel, part.fit
    model, arrow, unit = found.model, found.arrow, part.channel.quantity.unit
    from_runs, from_readings = arrow.shares()
    used = int((channel.count > 0).sum())
    of_noise = Component("noise of the readings", "A", "normal", noise.standard_deviation, unit, degrees=max(used, 1))
    made = [Source(of_noise, from_readings)]
    air_unit = {RunEffect.SOURCE: unit, RunEffect.DESTINATION: unit, RunEffect.DESTINATION_C: "K"}
    start = "trigger, run by run" if channel.conditions.start_known.any() else "start, which nobody recorded"
    airs = "run by run" if channel.conditions.airs_known.any() else "taken from the plateaus"
    names = {
        RunEffect.START: start,
        RunEffect.SOURCE: f"source air, {airs}",
        RunEffect.DESTINATION: f"destination air, {airs}",
        RunEffect.DESTINATION_C: "difference of the airs' temperatures, run by run",
    }
    for effect, moves in zip(RunEffect, from_runs, strict=False):
        if effect is RunEffect.RATE:
            degrees = max(channel.runs - channel.rates, 0) + RATE_SCATTER_WEIGHT
            line = Component("rate, run by run", "A", "normal", found.rate_scatter, "1", degrees=degrees)
            made.append(Source(line, moves))
            continue
        size = float(np.sqrt((1.0 / arrow.weight[:, effect]).mean()))
        its_unit = "s" if effect is RunEffect.START else air_unit[effect]
        made.append(Source(Component(names[effect], "B", "normal", size, its_unit), moves))
    covariance, prior = arrow.covariance(), model.priors()[1]
    for k in np.flatnonzero(prior):
        name, size = model.names[k], float(1.0 / np.sqrt(prior[k]))
        component, its_unit = COMMON_LINES.get(name, (f"what is known of {name} beforehand", "1"))
        moves = -(covariance[:, k] / size)[:, None]  # the prior holds the estimate back from where the error is
        line = Component(component, "B", "normal", size, its_unit, key=name if name in COMMON_LINES else "")
        made.append(Source(line, moves))
    for name, moved in shifts(part.problem, found).items():
        component, its_unit = COMMON_LINES[name]
        least = channel.common is None or channel.common.trigger_offset_s < LEAST_TRIGGER_OFFSET_S
        size = LEAST_TRIGGER_OFFSET_S if name == TRIGGER and least else float(getattr(channel.common, name))
        made.append(Source(Component(component, "B", "normal", size, its_unit, key=name), moved[:, None]))
    return made
