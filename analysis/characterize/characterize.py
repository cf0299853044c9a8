"""Characterization of a pair of sensors from one campaign: alpha of the bead, D(T) of the film, noise, response times.

Per channel: two searches for the rate with the least RMSE of Eq. (17) for each ambient (doi
10.5194/amt-15-2607-2022), then generalised least squares from the better one, which counts the noise's autocorrelation
and each run's own random effects.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

from shockrig.analysis.characterize.part_fit import (
    Extension,
    fit_parts,
    fitted_discovered,
    fitted_effects,
    joint_rows,
    make_part,
)
from shockrig.analysis.characterize.result import ChannelResult, Characterization, Part, channel_result
from shockrig.analysis.checks.campaign_checks import checked
from shockrig.analysis.estimate.effect import SingleReadings
from shockrig.analysis.estimate.fit import fit
from shockrig.analysis.estimate.gather import build_channel, usable_runs, why_none
from shockrig.analysis.estimate.noise import COARSE_IN_NOISE, estimate_noise
from shockrig.analysis.estimate.problem import posterior_scatter
from shockrig.analysis.estimate.quantity import QUANTITIES, ChannelName, looked_for
from shockrig.analysis.estimate.without_model import rounding_step
from shockrig.files.campaign import Campaign
from shockrig.files.errors import InputError
from shockrig.files.numbers import counted


def characterize(
    campaign: Campaign,
    seed: int = 0,
    extensions: Mapping[ChannelName, Extension] | None = None,
    progress: Callable[[str], None] | None = None,
    quickly: bool = False,
    channels: Collection[ChannelName] = tuple(QUANTITIES),
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
    quickly : bool
        Whether generalised least squares begin from a rough scan and the two optimisers are not asked: for a look at
        a campaign that is still being recorded.
    channels : collection of channel names
        Which ones to look at; nothing is said of the others.

    Raises
    ------
    InputError
        Where neither sensor has a run that can be used; the reasons are named.
    """
    say = progress or (lambda text: None)
    input_ = checked(campaign)
    campaign = input_.campaign
    found: dict[ChannelName, ChannelResult] = {}
    missing: dict[ChannelName, str] = {}
    for name in (name for name in looked_for(campaign) if name in channels):
        try:
            extension = (extensions or {}).get(name, Extension())
            found[name] = characterize_channel(campaign, name, seed, extension, say, quickly)
        except _Unusable as reason:
            missing[name] = str(reason)
    if not found:
        for finding in input_.findings:
            say(f"input: {finding.sentence}")
        reasons = "; ".join(f"{name}: {reason}" for name, reason in missing.items())
        raise InputError(f"{campaign.path}: no sensor can be characterized ({reasons}); record or import usable runs")
    temperature, humidity = found.get("temperature"), found.get("humidity")
    return _with_shared_scatter(Characterization(campaign, seed, temperature, humidity, missing, input_.findings))


def _with_shared_scatter(result: Characterization) -> Characterization:
    """The same with the scatter of the runs that both channels together show."""
    parts = result.explained_parts
    if not parts:
        return result
    limit = max(part.problem.rate_scatter_limit for part in parts)
    return with_run_scatter(result, posterior_scatter([part.fit.own_rates() for part in parts], limit))


def with_run_scatter(result: Characterization, scatter: float) -> Characterization:
    """The channels that are explained fitted again from where they are, with another scatter of their runs in rate."""
    fitted = {name: _with_scatter(one, scatter) for name, one in result.channels().items() if one.explained}
    return replace(
        result,
        temperature=fitted.get("temperature", result.temperature),
        humidity=fitted.get("humidity", result.humidity),
    )


def _with_scatter(result: ChannelResult, scatter: float) -> ChannelResult:
    parts: list[Part] = []
    rows = {row.runs: row for row in result.rows}
    for part in result.parts:
        problem = part.problem.with_rate_scatter(scatter)
        found = fit(problem, part.fit.structure, part.fit.theta, part.fit.deviations, adapt_scatter=False)
        parts.append(make_part(problem, found, result.noise))
        for row in joint_rows(parts[-1], result.noise, "")[0]:
            searched = rows[row.runs]
            rows[row.runs] = replace(row, basis=searched.basis, evolution=searched.evolution, check=searched.check)
    carried = Extension(causes=result.effects, discovered=result.discovered)
    return replace(
        result,
        parts=tuple(parts),
        rows=tuple(rows.values()),
        effects=fitted_effects(carried, parts[0]),
        discovered=fitted_discovered(carried, parts[0]),
    )


class _Unusable(Exception):
    """A channel without a run to fit; the text says why."""


def characterize_channel(
    campaign: Campaign,
    name: ChannelName,
    seed: int,
    extension: Extension,
    say: Callable[[str], None],
    quickly: bool = False,
) -> ChannelResult:
    """One channel of `characterize`; raises where no run can be used."""
    whole = build_channel(campaign, name)
    if whole is None:
        raise _Unusable(why_none(usable_runs(campaign, name)[1]))
    for effect in extension.structure.effects:
        if effect.readout.dated and effect.readout.in_readings:
            whole = effect.readout.in_readings(SingleReadings(whole))[0].channel
    say(f"{name}: {counted(whole.runs, 'run')}, noise from the plateaus")
    noise, rounding = estimate_noise(whole), 0.0
    if (step := rounding_step(whole)) > COARSE_IN_NOISE * noise.standard_deviation:
        noise, rounding = estimate_noise(whole, step, coarse=True), step
    for effect in extension.structure.effects:
        if effect.readout.rounded_to:
            rounding = effect.readout.rounded_to(extension.structure.held_values(effect.id))
            noise = noise.with_rounding(rounding)
    parts, rows, set_aside = fit_parts(whole, noise, extension, seed, rounding, say, quickly)
    if not rows:
        raise _Unusable(why_none(set_aside))
    effects, described = fitted_effects(extension, parts[0]), fitted_discovered(extension, parts[0])
    return channel_result(rows, noise, effects, parts, set_aside, described)
