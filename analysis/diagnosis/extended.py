"""A diagnosis as characterizations: the sensor under the plain model, and under the one that carries the named causes.

With the causes in the model alpha and D are the material's; without them they are effective numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from shockrig.analysis.characterization.chosen_runs import choose_runs
from shockrig.analysis.characterization.extension import Extension
from shockrig.analysis.characterization.part_fit import joint_rows
from shockrig.analysis.characterization.result import ChannelResult, Characterization, Part, Row, channel_result
from shockrig.analysis.characterization.to_profile import to_profile
from shockrig.analysis.diagnosis.diagnose import ChannelDiagnosis
from shockrig.analysis.diagnosis.export import stated_cause
from shockrig.analysis.diagnosis.search import plain_fit
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.noise import whiteners
from shockrig.analysis.inference.problem import Problem, make_problem
from shockrig.analysis.inference.quantity import ChannelName
from shockrig.analysis.inference.samples import rmse_over_samples
from shockrig.files.campaign import Campaign
from shockrig.files.profile import Profile


def plain_result(found: ChannelDiagnosis) -> ChannelResult | None:
    """The channel as a characterization without any effect finds it; None where that determines nothing.

    As there, a film is read from its isothermal shocks where an ambient has them.
    """
    parts: list[Part] = []
    rows: list[Row] = []
    groups, set_aside = choose_runs(found.problem.channel, found.noise, Extension())
    for channel, models in groups:
        problem = make_problem(channel, whiteners(channel, found.noise))
        tried = {basis: _part(problem, plain_fit(problem, model.structure)) for basis, model in models.items()}
        basis = min(tried, key=lambda name: tried[name].rmse)
        determined, undetermined = joint_rows(tried[basis], found.noise, basis)
        set_aside += undetermined
        if determined:
            rows += determined
            parts.append(tried[basis])
    return channel_result(rows, found.noise, (), parts, set_aside) if rows else None


def extended_result(found: ChannelDiagnosis) -> ChannelResult | None:
    """The channel under the model that carries the named causes (none: the plain one, on all runs)."""
    part = _part(found.problem, found.final)
    rows, undetermined = joint_rows(part, found.noise, "all runs")
    if not rows:
        return None
    effects = tuple(stated_cause(cause).as_effect() for cause in found.causes)
    return channel_result(rows, found.noise, effects, [part], [*found.problem.channel.left_out, *undetermined])


def extended_profile(
    campaign: Campaign,
    seed: int,
    results: Mapping[ChannelName, ChannelResult | None],
    missing: Mapping[ChannelName, str],
    provenance: Mapping[str, Any] | None = None,
) -> Profile:
    """The sensor profile of such characterizations; a channel that is None is left out."""
    known = {name: results.get(name) for name in ("temperature", "humidity")}
    return to_profile(Characterization(campaign, seed, known["temperature"], known["humidity"], missing), provenance)


def _part(problem: Problem, fit: Fit) -> Part:
    return Part(problem, fit, rmse_over_samples(problem.channel, fit))
