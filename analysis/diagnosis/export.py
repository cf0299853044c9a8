"""A diagnosis in the terms of its file, `shock-diagnosis/1`: what was found as what is stated of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnosis.diagnosed import Cause, ChannelDiagnosis, Diagnosis
from shockrig.analysis.diagnosis.outcome import outcome_document, outcome_of
from shockrig.files.diagnosis import (
    StatedCause,
    StatedChannel,
    StatedDiagnosis,
    StatedGain,
    StatedRemainder,
    Uncertain,
    diagnosis_document,
)

LEAST_WEIGHT = 0.005  # of a model that is told


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of diagnosis.json; every number is finite, unknown ones are left out."""
    return diagnosis_document(stated(diagnosis))


def stated(diagnosis: Diagnosis) -> StatedDiagnosis:
    """What a diagnosis states of its campaign."""
    return StatedDiagnosis(
        campaign=diagnosis.campaign,
        channels={channel.name: _channel(channel) for channel in diagnosis.channels},
        next_experiments=diagnosis.next_experiments,
        extra={"input_findings": diagnosis.input_findings},
    )


def _channel(channel: ChannelDiagnosis) -> StatedChannel:
    gain, left = channel.gain, channel.remainder
    names, matrix = correlations(channel)
    return StatedChannel(
        verdict=channel.verdict,
        causes=tuple(stated_cause(cause) for cause in channel.causes),
        discovered=channel.discovered,
        gain=StatedGain(gain.before, gain.after, gain.noise_floor, gain.explained_fraction, gain.interval_95),
        remainder=StatedRemainder(
            rms=left.rms,
            peak=left.peak,
            unit=left.unit,
            significant=left.significant,
            material=left.material,
            tolerance=left.tolerance,
            from_s=left.from_s,
            until_s=left.until_s,
            varies_with=left.varies_with,
        ),
        discrepancy=(channel.discrepancy or {}) if channel.verdict == "unexplained" else None,
        extra={
            "untestable": channel.untestable,
            "correlations": {"parameters": names, "matrix": np.round(matrix, 4)},
            "cannot_tell": channel.cannot_tell,
            "work": {"fits": channel.search.fits, "ended_early": channel.search.ended_early},
            "models": weighed(channel),
            "explanations": outcome_document(outcome_of(channel)),
            "discrepancy_of_step": channel.search.best.score.discrepancy,
            "tried": [{"effect": tried.effect, "why_not": tried.why} for tried in channel.tried],
        },
    )


def weighed(channel: ChannelDiagnosis) -> list[dict[str, Any]]:
    """The models with a weight worth telling: their effects, weight, and nats behind the one that is stated."""
    found = channel.search
    return [
        {"effects": sorted(one.ids), "weight": round(float(w), 4), "nats": round(one.value - found.best.value, 2)}
        for one, w in zip(found.pool, found.weights, strict=True)
        if w >= LEAST_WEIGHT
    ]


def stated_cause(cause: Cause) -> StatedCause:
    """A cause in the terms of the file."""
    return StatedCause(
        cause.effect,
        {name: Uncertain(value, spread) for name, (value, spread) in cause.parameters.items()},
        round(cause.probability, 4),
        cause.indistinguishable_from,
        at_bound=cause.at_bound,
        evidence=cause.why,
    )


def correlations(channel: ChannelDiagnosis) -> tuple[list[str], NDArray[np.float64]]:
    """Names of the final model's parameters (alpha, or D at each ambient; then the effects') and their correlations."""
    data = channel.problem.channel
    of = data.quantity
    ambients = [f"{of.symbol} at {round(float(t), 1) + 0.0:.1f} degC" for t in data.ambients_c]
    names = [*([of.symbol] if of.pooled else ambients), *channel.final.structure.names]
    covariance = channel.final.covariance
    # A parameter that the data do not see has no finite uncertainty, and none of its correlations means anything.
    deviation = np.sqrt(np.clip(np.nan_to_num(np.diag(covariance), posinf=0.0), 0.0, None))
    known = np.outer(deviation > 0, deviation > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        matrix = np.where(known, covariance / np.outer(deviation, deviation), 0.0)
    np.fill_diagonal(matrix, 1.0)
    return names, np.clip(np.nan_to_num(matrix), -1.0, 1.0)
