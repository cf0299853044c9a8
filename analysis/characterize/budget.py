"""Uncertainty budget of a figure (JCGM 100:2008): what its uncertainty is made of, line by line, and what to multiply.

A figure is a function of a fit's parameters, so its variance is a sum over independent inputs: noise of the readings
and what differs from run to run (type A), what references, triggers and anemometers are good to (type B).
    nu = u^4 / sum(u_i^4 / nu_i)     (Welch and Satterthwaite, JCGM 100 G.4.1),     U = k u, k for 95.45 %.
Where the figure is no straight function of the inputs, their distributions are propagated (JCGM 101): see `curvature`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from shockrig.analysis.characterize import curvature
from shockrig.analysis.characterize.response_times import USUAL_AIR, ResponseAir, response_slopes
from shockrig.analysis.characterize.result import ChannelResult, Part, TableRow
from shockrig.analysis.characterize.shifts import (
    airflow_exponent,
    disturbances,
    knows_airflow,
    shifts,
    temperature_slopes,
    widened,
)
from shockrig.analysis.estimate.channel import AMBIENT_WIDTH_K, Channel
from shockrig.analysis.estimate.model import LEAST_TRIGGER_OFFSET_S, TRIGGER
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.problem import RATE_SCATTER_WEIGHT
from shockrig.analysis.estimate.quantity import RunEffect

Array = NDArray[np.float64]

# What the uncertainty of a fit comes from: its inputs, each with what it does to theta, and its line in a budget.

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
            repeats = max(channel.runs - channel.rates, 0)
            kind = "A" if repeats else "B"  # without a repeat it is what sensors usually do
            degrees = repeats + RATE_SCATTER_WEIGHT
            line = Component("rate, run by run", kind, "normal", found.rate_scatter, "1", degrees=degrees)
            made.append(Source(line, moves))
            continue
        if effect is RunEffect.STRENGTH:
            line = Component("strength of an effect, run by run", "A", "normal", found.strength_scatter, "1")
            made.append(Source(line, moves))
            continue
        if effect is RunEffect.DRIFT:
            line = Component("drift of airs that nobody recorded, run by run", "A", "normal", found.drift_scatter, "1")
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


@dataclass(frozen=True)
class Inputs:
    """What a part's figures are uncertain by: its sources, and the covariance (P, P) of what its model is wrong by."""

    sources: list[Source]
    misfit: Array


def _inputs(part: Part, noise: Noise) -> Inputs:
    formal = replace(part.fit, covariance=part.fit.arrow.covariance())
    return Inputs(sources(part, noise), part.fit.covariance - widened(part.problem, formal).covariance)


COVERAGE = 0.9545  # two standard deviations of a normal distribution
LEAST_SHARE = 1e-9  # of the variance: a smaller line is none
WORST_RELATIVE = 0.5  # a figure known no better than this is none
TIMES = ("t63", "t90")
NO_DIFFERENCE = 1e-6  # of a variance, between two ways to the same number


@dataclass(frozen=True)
class Budget:
    """A figure with its budget.

    `figure` is "alpha", "D", "t63" or "t90"; `air` is what it is stated for, with every value known; `lines` are by
    falling contribution. `interval` are the ends that hold 95.45 % where distributions were propagated (JCGM 101);
    the standard uncertainty is then the value times the standard deviation of its logarithm.
    """

    figure: str
    channel: str
    unit: str
    value: float
    air: ResponseAir
    lines: tuple[Component, ...]
    interval: tuple[float, float] | None = None

    @property
    def standard_uncertainty(self) -> float:
        """Root of the sum of squares of the contributions (JCGM 100, equation 10)."""
        return math.sqrt(sum(line.contribution**2 for line in self.lines))

    @property
    def degrees(self) -> float:
        """Effective degrees of freedom (JCGM 100, equation G.2b)."""
        below = sum(line.contribution**4 / line.degrees for line in self.lines)
        return self.standard_uncertainty**4 / below if below > 0 else math.inf

    @property
    def coverage_factor(self) -> float:
        """Student's t that holds 95.45 %, for degrees of freedom cut to a whole number, as JCGM 100 G.4.1 asks; where
        distributions were propagated, half the interval over the standard uncertainty."""
        if self.interval is not None:
            return (self.interval[1] - self.interval[0]) / (2.0 * self.standard_uncertainty)
        whole = math.floor(self.degrees) if self.degrees < 1e6 else 1e9
        return float(stdtrit(max(whole, 1), 0.5 + 0.5 * COVERAGE))

    @property
    def expanded_uncertainty(self) -> float:
        """U = k u: half the interval that holds 95.45 %."""
        return self.coverage_factor * self.standard_uncertainty

    def share(self, line: Component) -> float:
        """Of the variance, from 0 to 1."""
        return (line.contribution / self.standard_uncertainty) ** 2 if self.standard_uncertainty > 0 else 0.0

    @property
    def determined(self) -> bool:
        """Whether it is known better than to a half, and its interval does not reach 0."""
        known = self.standard_uncertainty < WORST_RELATIVE * self.value
        return known and (self.interval is not None or self.expanded_uncertainty < self.value)

    @property
    def random(self) -> float:
        """Standard uncertainty without what all runs share: what differs from one campaign to the next on one bench."""
        return math.sqrt(sum(line.contribution**2 for line in self.lines if not line.key))


def budgets(result: ChannelResult, air: ResponseAir | None = None) -> list[Budget]:
    """Budgets of alpha or of each D, and of t63 and t90 in an air; a film's are at each row's own temperature."""
    found: list[Budget] = []
    ridges = [curvature.ridge(p.problem, p.fit, list(disturbances(p.problem, p.fit).values())) for p in result.parts]
    inputs = [_inputs(part, result.noise) for part in result.parts]
    for row in result.rows:
        place = next(i for i, part in enumerate(result.parts) if row.runs[0] in part.channel.run_ids)
        part = result.parts[place]
        ambient = int(np.argmin(np.abs(part.channel.ambients_c - row.ambient_c)))
        found += _of_ambient(part, inputs[place], ambient, row, air or ResponseAir(), ridges[place])
    return found


def diffusivity_at(result: ChannelResult, temperature_c: float) -> Budget | None:
    """Budget of D at one temperature, ln D linear in 1/T between the ambients around it; None more than 1 K beyond."""
    for part in result.parts:
        channel, found = part.channel, part.fit
        ambients = channel.ambients_c
        low, high = float(ambients.min()) - AMBIENT_WIDTH_K, float(ambients.max()) + AMBIENT_WIDTH_K
        stated = {run for row in result.rows for run in row.runs}
        if not (low <= temperature_c <= high and set(channel.run_ids) <= stated):
            continue
        order = np.argsort(ambients)
        x, at = 1.0 / (ambients[order] + 273.15), 1.0 / (temperature_c + 273.15)
        weights = np.zeros(found.theta.size)
        if ambients.size == 1:
            weights[0] = 1.0
        else:
            left = int(np.clip(np.searchsorted(ambients[order], temperature_c) - 1, 0, ambients.size - 2))
            share = float((at - x[left]) / (x[left + 1] - x[left]))
            weights[order[left]], weights[order[left + 1]] = 1.0 - share, share
        value = float(np.exp(weights @ found.theta) * channel.length_m**2)
        stated_air = replace(_stated(channel, 0, ResponseAir()), temperature_c=temperature_c)
        figures = [(channel.quantity.symbol, "m²/s", value, value * weights)]
        inputs = _inputs(part, result.noise)
        return _budgets(part, inputs, figures, stated_air, [_apart_at_most(result, part)])[0]
    return None


def mean_diffusivity(result: ChannelResult) -> tuple[Budget, tuple[float, ...]] | None:
    """Budget of the geometric mean of D over the ambients that were fitted together, each brought to its whole degree,
    and these; None where there is one ambient alone. What all of a film's D share shows in it most clearly."""
    part = max(result.parts, key=lambda one: one.channel.rates)
    channel, found = part.channel, part.fit
    if channel.quantity.pooled or channel.rates < 2:
        return None
    wholes = np.rint(channel.ambients_c)
    logs = found.log_rates + temperature_slopes(found) * (wholes - channel.ambients_c)
    value = float(np.exp(logs.mean()) * channel.length_m**2)
    slope = np.zeros(found.theta.size)
    slope[found.model.rates] = value / channel.rates
    air = replace(_stated(channel, 0, ResponseAir()), temperature_c=float(wholes.mean()))
    figure = (channel.quantity.symbol, "m²/s", value, slope)
    inputs = _inputs(part, result.noise)
    whole = _budgets(part, inputs, [figure], air, [_apart_at_most(result, part)])[0]
    return whole, tuple(sorted(float(t) for t in wholes))


def _of_ambient(
    part: Part,
    inputs: Inputs,
    ambient: int,
    row: TableRow,
    air: ResponseAir,
    ridge: curvature.Ridge | None,
) -> list[Budget]:
    channel, theta = part.channel, part.fit.theta
    stated = _stated(channel, ambient, air)
    times, slopes = response_slopes(channel, part.fit, ambient, stated)
    of_rate = np.zeros(theta.size)
    of_rate[ambient] = row.diffusivity_m2_s
    figures = [(channel.quantity.symbol, "m²/s", row.diffusivity_m2_s, of_rate)]
    figures += [(name, "s", float(times[i]), slopes[i]) for i, name in enumerate(TIMES)]
    made = _budgets(part, inputs, figures, stated, [_apart(part, ambient, row), *_times_apart(part, ambient, row)])
    if ridge is None:
        return made
    drawn = curvature.drawn(ridge, [log_figure(part, ambient, one) for one in made])
    return [_propagated(one, inputs.sources, over) for one, over in zip(made, drawn, strict=True)]


def log_figure(part: Part, ambient: int, budget: Budget) -> curvature.LogFigure:
    """The logarithm of a budget's figure as a function of theta, up to a constant, with its slopes."""
    if budget.figure in TIMES:
        place = TIMES.index(budget.figure)

        def of(theta: Array) -> tuple[float, Array]:
            times, slopes = response_slopes(part.channel, replace(part.fit, theta=theta), ambient, budget.air)
            return math.log(times[place]), slopes[place] / times[place]

        return of
    slope = np.zeros(part.fit.theta.size)
    slope[ambient] = 1.0
    return lambda theta: (float(theta[ambient]), slope)


def _propagated(budget: Budget, inputs: list[Source], drawn: curvature.Drawn) -> Budget:
    """The budget with the distributions of its inputs propagated; as it is where its figure is straight."""
    named = {source.of.component for source in inputs}
    others = [line for line in budget.lines if line.component not in named]
    rest = math.sqrt(sum(line.contribution**2 for line in others)) / budget.value
    low, high = drawn.interval(rest, budget.coverage_factor)
    if curvature.straight(
        budget.standard_uncertainty / budget.value, budget.expanded_uncertainty / budget.value, (low, high)
    ):
        return budget
    lines = [source.giving(budget.value * given) for source, given in zip(inputs, drawn.contributions, strict=True)]
    lines.append(Component("curvature of the response", "A", "propagated", drawn.beyond, "1", budget.value))
    ends = budget.value * (1.0 + low), budget.value * (1.0 + high)
    return replace(budget, lines=_kept(lines + others), interval=ends)


def _kept(lines: list[Component]) -> tuple[Component, ...]:
    """Lines that are any part of the whole, by falling contribution."""
    variance = sum(line.contribution**2 for line in lines)
    kept = [line for line in lines if line.contribution**2 > LEAST_SHARE * variance]
    return tuple(sorted(kept, key=lambda line: -line.contribution))


def _apart(part: Part, ambient: int, row: TableRow) -> float:
    """What of a row's uncertainty its fit does not know, relatively: how far runs by themselves are from the model."""
    told = float(part.fit.covariance[ambient, ambient])
    return _beyond((row.standard_uncertainty / row.diffusivity_m2_s) ** 2, told)


def _times_apart(part: Part, ambient: int, row: TableRow) -> list[float]:
    """The same of a row's times."""
    times, slopes = response_slopes(part.channel, part.fit, ambient)
    told = np.einsum("ki,ij,kj->k", slopes, part.fit.covariance, slopes) / times**2
    whole = (np.array(row.response.standard_uncertainties_s or (0.0, 0.0, 0.0)) / times) ** 2
    return [_beyond(float(whole[i]), float(told[i])) for i in range(len(TIMES))]


def _beyond(whole: float, told: float) -> float:
    return math.sqrt(whole - told) if whole - told > NO_DIFFERENCE * whole else 0.0


def _apart_at_most(result: ChannelResult, part: Part) -> float:
    """The largest of the part's ambients."""
    rows = [row for row in result.rows if row.runs[0] in part.channel.run_ids]
    places = [int(np.argmin(np.abs(part.channel.ambients_c - row.ambient_c))) for row in rows]
    return max((_apart(part, g, row) for g, row in zip(places, rows, strict=True)), default=0.0)


def _budgets(
    part: Part,
    inputs: Inputs,
    figures: list[tuple[str, str, float, Array]],
    stated: ResponseAir,
    apart: Sequence[float],
) -> list[Budget]:
    """Budgets of figures, each as its name, unit, value, and by how much theta moves it (P,); `apart` is how far runs
    by themselves are from each."""
    channel, made = part.channel, []
    for (figure, unit, value, slope), far in zip(figures, apart, strict=True):
        lines = [source.line(slope) for source in inputs.sources]
        if beyond := _other_airflow(part, stated):
            lines.append(Component("airflow other than the runs'", "B", "normal", beyond, "1", value))
        misfit = math.sqrt(max(float(slope @ inputs.misfit @ slope), 0.0)) / value
        lines.append(Component("misfit of the model", "A", "normal", misfit, "1", value, max(channel.runs - 1, 1)))
        if far > 0.0:
            lines.append(
                Component("runs that the model misses", "A", "normal", far, "1", value, max(channel.runs - 1, 1))
            )
        made.append(Budget(figure, channel.name, unit, value, stated, _kept(lines)))
    return made


def _other_airflow(part: Part, air: ResponseAir) -> float:
    """How far an effective figure may be off, relatively, in another airflow than the runs'.

    0 where the model knows what airflow does, or where the airflow is theirs.
    """
    conditions = part.channel.conditions
    if air.airflow_m_s is None or not conditions.airflow_known.any() or knows_airflow(part.problem, part.fit):
        return 0.0
    apart = abs(math.log(max(air.airflow_m_s, 0.05) / max(float(np.median(conditions.airflow_m_s)), 0.05)))
    return airflow_exponent(part.fit) * apart


def _stated(channel: Channel, ambient: int, air: ResponseAir) -> ResponseAir:
    """The air that figures are stated for, nothing left open but an airflow that nobody recorded."""
    conditions = channel.conditions
    airflow, temperature, pressure = air.airflow_m_s, air.temperature_c, air.pressure_hpa
    if airflow is None and conditions.airflow_known.any():
        airflow = float(np.median(conditions.airflow_m_s))
    if not channel.quantity.pooled:
        temperature = float(channel.ambients_c[ambient])
    elif temperature is None:
        temperature = USUAL_AIR["temperature_c"]
    return ResponseAir(
        airflow, temperature, float(np.median(conditions.pressure_hpa)) if pressure is None else pressure
    )
