"""A diagnosis as characterizations: the sensor under the plain model, and under the one that carries the named causes.

With the causes in the model alpha and D are the material's; without them they are effective numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from shockrig.analysis.characterize.part_fit import Extension, fit_parts, joint_rows
from shockrig.analysis.characterize.response_times import response_time
from shockrig.analysis.characterize.result import (
    ChannelResult,
    Characterization,
    Part,
    TableRow,
    channel_result,
    to_profile,
)
from shockrig.analysis.diagnose.diagnosed import ChannelDiagnosis
from shockrig.analysis.estimate.fit import rmse_over_samples
from shockrig.analysis.estimate.quantity import ChannelName
from shockrig.files.campaign import Campaign
from shockrig.files.profile import Profile


def plain_result(found: ChannelDiagnosis) -> ChannelResult | None:
    """The channel as a characterization without any effect finds it; None where that determines nothing.

    As there, a film is read from its isothermal shocks where an ambient has them.
    """
    parts, rows, set_aside = fit_parts(found.problem.channel, found.noise, Extension())
    return channel_result(rows, found.noise, (), parts, set_aside) if rows else None


def extended_result(found: ChannelDiagnosis) -> ChannelResult | None:
    """The channel under the model that predicts, on all runs."""
    fit = found.predicting.fit
    part = Part(found.problem, fit, rmse_over_samples(found.problem.channel, fit))
    rows, undetermined = joint_rows(part, found.noise, "all runs")
    if not rows:
        return None
    rows = [_in_doubt(found, row) for row in rows]
    effects = tuple(cause.as_effect() for cause in found.predicting.causes)
    left_out = [*found.problem.channel.left_out, *undetermined]
    return channel_result(rows, found.noise, effects, [part], left_out, found.predicting.discovered)


def _in_doubt(found: ChannelDiagnosis, row: TableRow) -> TableRow:
    """A row as uncertain as the models are apart that are tied with it or stated, each by its weight."""
    channel, search = found.problem.channel, found.search
    ambient = int(np.argmin(np.abs(channel.ambients_c - row.ambient_c)))
    own = found.predicting.model
    rivals = search.rivals() if own is search.best else [one for one in search.tied() if one is not own]
    if not rivals:
        return row
    stated, others = row.response, [response_time(channel, one.fit, ambient) for one in rivals]
    # Moments about what is stated, each number's own: a time to 63 % that is twenty times another's is no share of it.
    told = np.array([[r.t63_s, r.t90_s, r.t98_s, 1.0 / r.t63_s] for r in (stated, *others)])
    weight = np.array([search.weight(one) for one in (own, *rivals)])
    away = np.sqrt(weight[1:] @ (told[1:] - told[0]) ** 2 / weight.sum())
    sure = np.array(stated.standard_uncertainties_s or (0.0, 0.0, 0.0))
    first, second, third = (float(u) for u in np.hypot(sure, away[:3]))
    return replace(
        row,
        standard_uncertainty=float(np.hypot(row.standard_uncertainty, row.diffusivity_m2_s * away[3] * stated.t63_s)),
        response=replace(stated, standard_uncertainties_s=(first, second, third)),
    )


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
