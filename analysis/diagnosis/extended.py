"""A diagnosis as characterizations: the sensor under the plain model, and under the one that carries the named causes.

With the causes in the model alpha and D are the material's; without them they are effective numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from shockrig.analysis.characterization.characterize import (
    ChannelResult,
    Characterization,
    Part,
    Row,
    choose_runs,
    joint_rows,
    to_profile,
)
from shockrig.analysis.characterization.extension import Extension
from shockrig.analysis.diagnosis.diagnose import Cause, ChannelDiagnosis
from shockrig.analysis.diagnosis.search import plain_fit
from shockrig.analysis.inference.channel import LeftOut
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.noise import whiteners
from shockrig.analysis.inference.problem import Problem, make_problem
from shockrig.analysis.inference.quantity import ChannelName
from shockrig.analysis.inference.samples import rmse_over_samples
from shockrig.files.campaign import Campaign
from shockrig.files.profile import Effect, Profile, Uncertain


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
        told, undetermined = joint_rows(tried[basis], found.noise, basis)
        set_aside += undetermined
        if told:
            rows += told
            parts.append(tried[basis])
    return _result(found, rows, parts, (), set_aside)


def extended_result(found: ChannelDiagnosis) -> ChannelResult | None:
    """The channel under the model that carries the named causes (none: the plain one, on all runs)."""
    part = _part(found.problem, found.final)
    rows, undetermined = joint_rows(part, found.noise, "all runs")
    effects = tuple(_effect(cause) for cause in found.causes)
    return _result(found, rows, [part], effects, [*found.problem.channel.left_out, *undetermined])


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


def _result(
    found: ChannelDiagnosis,
    rows: Sequence[Row],
    parts: Sequence[Part],
    effects: tuple[Effect, ...],
    set_aside: Sequence[LeftOut],
) -> ChannelResult | None:
    if not rows:
        return None
    return ChannelResult(
        rows=tuple(sorted(rows, key=lambda row: row.ambient_c)),
        noise=found.noise,
        effects=effects,
        parts=tuple(parts),
        set_aside=tuple(sorted(set_aside, key=lambda entry: entry.run)),
    )


def _effect(cause: Cause) -> Effect:
    parameters = {name: Uncertain(value, spread) for name, (value, spread) in cause.parameters.items()}
    return Effect(cause.effect, parameters, cause.probability, cause.indistinguishable_from)
