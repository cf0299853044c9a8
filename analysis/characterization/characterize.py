"""Characterization of a pair of sensors from one campaign: alpha of the bead, D(T) of the film, noise, response times.

Per channel: differential evolution on the RMSE of Eq. (17) for each ambient (doi 10.5194/amt-15-2607-2022), a
cross-check, then generalised least squares, which counts the noise's autocorrelation and each run's own deviations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.characterization.extension import Extension
from shockrig.analysis.characterization.response import response_time
from shockrig.analysis.checks.checked import checked
from shockrig.analysis.checks.finding import InputFinding
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import Channel, LeftOut
from shockrig.analysis.inference.effect import Readings
from shockrig.analysis.inference.evolution import Misfit, Optimum, cross_check, evolve
from shockrig.analysis.inference.fit import Fit, fit
from shockrig.analysis.inference.gather import build_channel, usable_runs, why_none
from shockrig.analysis.inference.model import Model, Structure
from shockrig.analysis.inference.noise import Noise, estimate_noise, whiteners
from shockrig.analysis.inference.problem import Problem, make_problem
from shockrig.analysis.inference.quantity import QUANTITIES, ChannelName, RunEffect
from shockrig.analysis.inference.rate_scatter import posterior_scatter
from shockrig.analysis.inference.samples import rmse_over_samples
from shockrig.analysis.inference.scan import RATE_BOUNDS_PER_S
from shockrig.files.campaign import Campaign
from shockrig.files.errors import InputError
from shockrig.files.profile import (
    DiffusivityRow,
    Effect,
    HumidityProfile,
    Profile,
    ResponseTime,
    TemperatureProfile,
    Uncertain,
)

Array = NDArray[np.float64]

STEP_IN_NOISE = 10.0
LEAST_ISOTHERMAL = 2
FAR_ABOVE_NOISE = 1.15  # residual over noise from which the model is not the whole story
FAR_STRAINED = 2.0  # likewise, for how far start times and airs are bent
WORST_RELATIVE = 0.5  # a diffusivity known no better than this is none

THERMAL_SHOCK = "thermal shock: the film's own temperature lags; the isothermal shocks of this ambient are used"
# Where an ambient has thermal shocks alone, ppmv is turned into RH at the air's temperature or at the die's own.
THERMAL_MODELS = {"thermal shocks, read at the air's temperature": Extension()} | {
    effect.thermal_reading: Extension(Structure((effect,))) for effect in CATALOGUE.values() if effect.thermal_reading
}


@dataclass(frozen=True)
class Row:
    """One ambient of one channel: the diffusivity [m^2/s] with its standard uncertainty, and what it rests on.

    `basis` is "all runs", "isothermal shocks", or how thermal shocks alone were read where there was nothing else.
    `evolution` and `check` are the two optimisers' findings, where they were asked.
    """

    ambient_c: float
    diffusivity_m2_s: float
    standard_uncertainty: float
    response: ResponseTime
    runs: tuple[str, ...]
    basis: str
    evolution: Optimum | None = None
    check: Optimum | None = None


@dataclass(frozen=True)
class Part:
    """Runs fitted together: the least squares problem, its fit, and the RMSE over their samples [channel's unit]."""

    problem: Problem
    fit: Fit
    rmse: float

    @property
    def channel(self) -> Channel:
        return self.problem.channel

    @property
    def strain(self) -> float:
        """Root mean square of the runs' start times and airs, as fitted, in units of what is known of them."""
        counted = self.problem.stated
        counted[:, RunEffect.RATE] = False  # its scatter is fitted
        scaled = (self.fit.deviations / self.problem.scatter)[counted]
        return float(np.sqrt(np.mean(scaled**2))) if scaled.size else 0.0


@dataclass(frozen=True)
class ChannelResult:
    """What a channel's runs say.

    Attributes
    ----------
    rows : tuple of Row
        One for each ambient, by rising temperature; one in all for the bead.
    noise : Noise
    effects : tuple of Effect
        What the model carries beside the plain diffusion, with fitted parameters.
    parts : tuple of Part
        All runs; for a plain film the ambients with isothermal shocks, and those with thermal shocks alone.
    set_aside : tuple of LeftOut
        Runs that take no part, and why.
    """

    rows: tuple[Row, ...]
    noise: Noise
    effects: tuple[Effect, ...]
    parts: tuple[Part, ...]
    set_aside: tuple[LeftOut, ...]

    @property
    def channel(self) -> Channel:
        """The first part's channel, for what all parts share (length, sampling period, name)."""
        return self.parts[0].channel

    @property
    def runs(self) -> tuple[str, ...]:
        """Ids of the runs used."""
        return tuple(sorted(run for part in self.parts for run in part.channel.run_ids))

    @property
    def rmse(self) -> float:
        """Over the samples of all parts, each run's own deviations included [channel's unit]."""
        squares = [(part.rmse**2, int(part.channel.count.sum())) for part in self.parts]
        return float(np.sqrt(sum(r * n for r, n in squares) / sum(n for _, n in squares)))

    @property
    def explained(self) -> bool:
        """Whether the residuals are about as small as the noise, with start times and airs as they were recorded."""
        return self.rmse < FAR_ABOVE_NOISE * self.noise.standard_deviation and self.strain < FAR_STRAINED

    @property
    def strain(self) -> float:
        """Of the part whose start times and airs had to give most."""
        return max(part.strain for part in self.parts)

    @property
    def disagreement(self) -> float | None:
        """Largest relative difference between the two optimisers' rates; None where they were not asked."""
        pairs = [(row.evolution, row.check) for row in self.rows if row.evolution and row.check]
        return max((abs(float(np.expm1(b.log_rate - a.log_rate))) for a, b in pairs), default=None)


@dataclass(frozen=True)
class Characterization:
    """Result of `characterize`; a channel that cannot be had is None and `missing` says why."""

    campaign: Campaign
    seed: int
    temperature: ChannelResult | None
    humidity: ChannelResult | None
    missing: Mapping[ChannelName, str]
    findings: tuple[InputFinding, ...] = ()

    def channels(self) -> dict[ChannelName, ChannelResult]:
        """The channels that are there, by name."""
        return {name: found for name in QUANTITIES if (found := getattr(self, name)) is not None}


def characterize(
    campaign: Campaign,
    seed: int = 0,
    extensions: Mapping[ChannelName, Extension] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Characterization:
    """Fit alpha and D(T) to a campaign.

    Parameters
    ----------
    campaign : Campaign
    seed : int
        Of the differential evolution.
    extensions : mapping of channel name to Extension, optional
        Models to fit instead of the plain one; channels that are not named keep it.
    progress : function of a sentence, optional

    Raises
    ------
    InputError
        Where neither sensor has a run that can be used; the reasons are named.
    """
    say = progress or (lambda text: None)
    input_ = checked(campaign)
    campaign = input_.campaign
    for finding in input_.findings:
        say(f"input: {finding.sentence}")
    found: dict[ChannelName, ChannelResult] = {}
    missing: dict[ChannelName, str] = {}
    for name in QUANTITIES:
        try:
            found[name] = characterize_channel(campaign, name, seed, (extensions or {}).get(name, Extension()), say)
        except _Unusable as reason:
            missing[name] = str(reason)
            say(f"{name}: {reason}")
    if not found:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in missing.items())
        raise InputError(f"{campaign.path}: no sensor can be characterized ({reasons}); record or import usable runs")
    found = _with_shared_scatter(found)
    return Characterization(campaign, seed, found.get("temperature"), found.get("humidity"), missing, input_.findings)


def _with_shared_scatter(found: dict[ChannelName, ChannelResult]) -> dict[ChannelName, ChannelResult]:
    """The channels that are explained, fitted again with the runs' scatter that both of them together show."""
    good = {name: result for name, result in found.items() if result.explained}
    if not good:
        return found
    scatter = posterior_scatter([part.fit.own_rates() for result in good.values() for part in result.parts])
    return found | {name: _with_scatter(result, scatter) for name, result in good.items()}


def _with_scatter(result: ChannelResult, scatter: float) -> ChannelResult:
    parts: list[Part] = []
    rows = {row.runs: row for row in result.rows}
    for part in result.parts:
        problem = part.problem.with_rate_scatter(scatter)
        found = fit(problem, part.fit.structure, part.fit.theta, part.fit.deviations, adapt_scatter=False)
        parts.append(Part(problem, found, rmse_over_samples(part.channel, found)))
        for row in joint_rows(parts[-1], result.noise, "")[0]:
            searched = rows[row.runs]
            rows[row.runs] = replace(row, basis=searched.basis, evolution=searched.evolution, check=searched.check)
    effects = _effects(Extension(causes=result.effects), parts[0])
    return replace(result, parts=tuple(parts), rows=tuple(rows.values()), effects=effects)


class _Unusable(Exception):
    """A channel without a run to fit; the text says why."""


def characterize_channel(
    campaign: Campaign, name: ChannelName, seed: int, extension: Extension, say: Callable[[str], None]
) -> ChannelResult:
    """One channel of `characterize`; raises where no run can be used."""
    whole = build_channel(campaign, name)
    if whole is None:
        raise _Unusable(why_none(usable_runs(campaign, name)[1]))
    for effect in extension.structure.effects:
        if effect.dated and effect.in_readings:
            whole = effect.in_readings(Readings(whole))[0].channel
    say(f"{name}: {whole.runs} runs, noise from the plateaus")
    noise = estimate_noise(whole)
    rounding = 0.0
    for effect in extension.structure.effects:
        if effect.rounded_to:
            rounding = effect.rounded_to(extension.structure.held_values(effect.id))
            noise = noise.with_rounding(rounding)
    groups, set_aside = choose_runs(whole, noise, extension)
    rows: list[Row] = []
    parts: list[Part] = []
    for channel, models in groups:
        part, found, undetermined = _fit_part(channel, noise, models, seed, rounding, say)
        rows += found
        set_aside += undetermined
        if found:
            parts.append(part)
    if not rows:
        raise _Unusable(why_none(set_aside))
    return ChannelResult(
        rows=tuple(sorted(rows, key=lambda row: row.ambient_c)),
        noise=noise,
        effects=_effects(extension, parts[0]),
        parts=tuple(parts),
        set_aside=tuple(sorted(set_aside, key=lambda entry: entry.run)),
    )


def choose_runs(
    whole: Channel, noise: Noise, extension: Extension
) -> tuple[list[tuple[Channel, dict[str, Extension]]], list[LeftOut]]:
    """Runs that are fitted together, each set with the models to try by the name of their basis; and runs set aside."""
    quantity = whole.quantity
    step = np.abs(quantity.step(whole.conditions))
    keep = (step >= max(quantity.least_step, STEP_IN_NOISE * noise.standard_deviation)) | whole.measured
    reasons = {int(i): f"no {quantity.name} step ({step[i]:.2g} {quantity.unit})" for i in np.flatnonzero(~keep)}
    alone = np.zeros(whole.runs, dtype=bool)
    plain_film = whole.jumps_with_air and not extension.structure.effects and not whole.measured.any()
    if plain_film:
        isothermal = whole.isothermal
        for g in range(whole.ambients_c.size):
            here = keep & (whole.ambient == g)
            if (here & isothermal).sum() >= LEAST_ISOTHERMAL:
                reasons |= dict.fromkeys((int(i) for i in np.flatnonzero(here & ~isothermal)), THERMAL_SHOCK)
            elif (here & ~isothermal).any():
                alone |= here
        keep[list(reasons)] = False
    basis = "isothermal shocks" if plain_film else "all runs"
    choices = [(keep & ~alone, {basis: extension}), (keep & alone, THERMAL_MODELS)]
    groups = [(whole.select(mask).without_lost_ambients(), models) for mask, models in choices if mask.any()]
    return groups, [*whole.left_out, *(LeftOut(whole.run_ids[i], whole.name, reasons[i]) for i in sorted(reasons))]


def _fit_part(
    channel: Channel,
    noise: Noise,
    models: Mapping[str, Extension],
    seed: int,
    rounding: float,
    say: Callable[[str], None],
) -> tuple[Part, list[Row], list[LeftOut]]:
    """Fit runs together with the model that leaves the least; rows of what is determined, runs of what is not."""
    searched = {}
    for basis, extension in models.items():
        optima, late_s = [], np.zeros(channel.runs)
        for g, ambient_c in enumerate(channel.ambients_c):
            misfit = Misfit(channel.select(channel.ambient == g), extension.structure, dict(extension.starts or {}))
            where = "" if channel.quantity.pooled else f" at {ambient_c:.0f} degC"
            say(f"{channel.name}: differential evolution over {misfit.channel.runs} runs{where}")
            optima.append((evolve(misfit, np.random.default_rng([seed, g])), cross_check(misfit)))
            late_s[channel.ambient == g] = misfit.late_s(optima[-1][0].log_rate)
        searched[basis] = optima, late_s
    basis = min(searched, key=lambda name: sum(first.rmse**2 for first, _ in searched[name][0]))
    extension, (optima, late_s) = models[basis], searched[basis]
    say(f"{channel.name}: generalised least squares over {channel.runs} runs")
    problem = make_problem(channel, whiteners(channel, noise), rounding=rounding)
    log_rates = np.array([first.log_rate for first, _ in optima])
    start = Model(channel, extension.structure).start(log_rates, dict(extension.starts or {}))
    deviations = channel.at_rest()
    deviations[:, RunEffect.START] = late_s
    found = fit(problem, extension.structure, start, deviations)
    part = Part(problem, found, rmse_over_samples(channel, found))
    rows, undetermined = joint_rows(part, noise, basis, optima)
    return part, rows, undetermined


def joint_rows(
    part: Part, noise: Noise, basis: str, optima: Sequence[tuple[Optimum | None, Optimum | None]] | None = None
) -> tuple[list[Row], list[LeftOut]]:
    """Rows of the ambients whose diffusivity a joint fit determines, and the runs of those that it does not.

    `optima` are each ambient's findings of the two optimisers, where they were asked.
    """
    channel, found = part.channel, part.fit
    # Where the model is wrong its formal uncertainty is too small: enlarged by as much as the residuals, or the runs'
    # start times and airs, are too far off.
    ratio = max(part.rmse / noise.standard_deviation, part.strain)
    enlarged = ratio if ratio > FAR_ABOVE_NOISE else 1.0
    rows: list[Row] = []
    undetermined: list[LeftOut] = []
    for g, (first, check) in enumerate(optima or [(None, None)] * channel.ambients_c.size):
        runs = tuple(channel.run_ids[i] for i in np.flatnonzero(channel.ambient == g))
        relative = enlarged * float(np.sqrt(max(found.covariance[g, g], 0.0)))
        low, high = np.log(RATE_BOUNDS_PER_S)
        if not (0.0 < relative < WORST_RELATIVE and low < found.theta[g] < high):
            ambient = f"{channel.ambients_c[g]:.0f} degC"
            reason = f"does not determine the diffusivity, alone at {ambient}; record isothermal shocks there"
            undetermined += [LeftOut(run, channel.name, reason) for run in runs]
            continue
        value = float(np.exp(found.theta[g]) * channel.length_m**2)
        rows.append(
            Row(
                ambient_c=round(float(channel.ambients_c[g]), 3),
                diffusivity_m2_s=value,
                standard_uncertainty=value * relative,
                response=response_time(channel, found, g, enlarged),
                runs=runs,
                basis=basis,
                evolution=first,
                check=check,
            )
        )
    return rows, undetermined


def _effects(extension: Extension, part: Part) -> tuple[Effect, ...]:
    values = part.fit.values()
    fitted = []
    for cause in extension.causes:
        parameters = dict(cause.parameters)
        for name, (value, spread) in values[cause.effect].items():
            # What the single readings showed is held in this fit and keeps the uncertainty it came with.
            parameters[name] = Uncertain(value, spread) if spread > 0 or name not in parameters else parameters[name]
        fitted.append(replace(cause, parameters=parameters))
    return tuple(fitted)


def to_profile(result: Characterization, provenance: Mapping[str, Any] | None = None) -> Profile:
    """The sensor profile of a characterization; `provenance` is added to what the result itself knows."""
    temperature = humidity = None
    if (t := result.temperature) is not None:
        row = t.rows[0]
        temperature = TemperatureProfile(
            thermal_diffusivity_m2_s=Uncertain(row.diffusivity_m2_s, row.standard_uncertainty),
            bead_radius_m=t.channel.length_m,
            response_time_s=row.response,
            noise_k=t.noise.standard_deviation,
            sampling_period_s=t.channel.sampling_period_s,
            effects=t.effects,
        )
    if (h := result.humidity) is not None:
        humidity = HumidityProfile(
            diffusivity_table=tuple(
                DiffusivityRow(r.ambient_c, r.diffusivity_m2_s, r.standard_uncertainty, len(r.runs), r.response)
                for r in h.rows
            ),
            film_thickness_m=h.channel.length_m,
            noise_percent=h.noise.standard_deviation,
            sampling_period_s=h.channel.sampling_period_s,
            effects=h.effects,
        )
    known = {
        "campaign": result.campaign.name,
        "runs_used": {name: list(found.runs) for name, found in result.channels().items()},
        "left_out": [
            {"run": entry.run, "channel": entry.channel, "reason": entry.reason}
            for found in result.channels().values()
            for entry in found.set_aside
        ],
        "missing": dict(result.missing),
        "seed": result.seed,
        "basis": {str(row.ambient_c): row.basis for row in (result.humidity.rows if result.humidity else ())},
        "rmse": {name: found.rmse for name, found in result.channels().items()},
        "optimisers_differ_by": {
            name: found.disagreement for name, found in result.channels().items() if found.disagreement is not None
        },
    }
    return Profile(temperature, humidity, result.campaign.sensors, known | dict(provenance or {}))
