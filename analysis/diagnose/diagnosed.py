"""What a diagnosis says of a channel and of a campaign, what it leaves standing for whoever plans, and its file's
terms.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.design.explanation import Explanation, explained_by
from shockrig.analysis.diagnose.adequacy import Adequacy
from shockrig.analysis.diagnose.gain import Gain
from shockrig.analysis.diagnose.pool import Rated, Search
from shockrig.analysis.effects import in_channel
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.quantity import ChannelName
from shockrig.files.diagnosis import (
    StatedCause,
    StatedChannel,
    StatedDiagnosis,
    StatedGain,
    StatedRemainder,
    diagnosis_document,
)
from shockrig.files.diagnosis_data import Discovered
from shockrig.files.discovered import plain
from shockrig.files.json_files import made_of

FARTHEST_NATS = 12.0  # behind the stated model: what a planner calls tied at its thirtieth look, as it spends its error
LEAST_WEIGHT = 0.005  # of a model that is told


@dataclass(frozen=True)
class Near:
    """A model that comes near the stated one.

    `nats` is its value above that one's, `tied` whether its weight is not small beside that one's, `lacks` whether it
    has not all of that one's laws.
    """

    explanation: Explanation
    nats: float
    tied: bool
    lacks: bool


@dataclass(frozen=True)
class ChannelOutcome:
    """What is left of a channel's diagnosis once its fits are forgotten, as whoever plans takes it: it is said in
    diagnosis.json (`explanations` of a channel), so that the same campaign is not diagnosed once more.

    `runs` were fitted; `passed` says that the stated model leaves nothing but noise; `best` is the heaviest model,
    `weight` its weight, and `stated` the same as it is stated; `near` has the heaviest first.
    """

    verdict: str
    runs: tuple[str, ...]
    passed: bool
    weight: float
    best: Explanation
    stated: Explanation
    near: tuple[Near, ...]


def outcome_of(found: ChannelDiagnosis) -> ChannelOutcome:
    """What a diagnosis of a channel leaves standing."""
    search = found.search
    even = {id(one) for one in search.tied()}
    near = tuple(
        Near(explained_by(one.fit), one.value - search.best.value, id(one) in even, not one.laws >= search.best.laws)
        for one in search.pool
        if one is not search.best and (id(one) in even or one.value > search.best.value - FARTHEST_NATS)
    )
    return ChannelOutcome(
        found.verdict,
        found.problem.channel.run_ids,
        found.adequacy.passed,
        search.weight(search.best),
        explained_by(search.best.fit),
        explained_by(found.final),
        near,
    )


def read_outcome(verdict: str | None, said: Any, name: ChannelName) -> ChannelOutcome | None:
    """It from diagnosis.json; None where the file does not have it, or has effects that this version has not."""
    try:
        found: ChannelOutcome = made_of(ChannelOutcome, {**said, "verdict": verdict})
        effects = [
            (in_channel(id_, name), values)
            for one in (found.best, found.stated, *(near.explanation for near in found.near))
            for id_, values in one.items()
        ]
    except (AttributeError, KeyError, TypeError, ValueError):
        return None
    alike = all(set(values) == {parameter.name for parameter in effect.parameters} for effect, values in effects)
    return found if alike else None


@dataclass(frozen=True)
class Cause(StatedCause):
    """One named cause, and by how much unseen runs are predicted worse without it [nats]."""

    probability: float = 1.0
    nats: float = np.inf


@dataclass(frozen=True)
class Predicting:
    """The model that predicts, and that the profile carries: the stated one, the plain one, or one whose effects
    are not sure enough to be stated or say nothing of causes. It leaves least of its runs.

    `fit` need not be that which the search ended with: it may be as it is judged. `causes` and `discovered`
    are its effects; `errors` [unit] are the rms that the stated model and this one leave of the runs at the rate that
    they have in common, None where what is stated predicts.
    """

    model: Rated
    fit: Fit
    causes: tuple[Cause, ...]
    discovered: tuple[Discovered, ...]
    errors: tuple[float, float] | None = None


@dataclass(frozen=True)
class ChannelDiagnosis:
    """The verdict on one channel with everything it rests on.

    `final` is the fit of the model that is stated; `tried` are effects that are not named, and why; `discrepancy`
    describes what is left where it matters.
    """

    name: ChannelName
    verdict: str
    causes: tuple[Cause, ...]
    discovered: tuple[Discovered, ...]
    gain: Gain
    search: Search
    adequacy: Adequacy
    plain_adequacy: Adequacy
    remainder: StatedRemainder
    problem: Problem
    noise: Noise
    final: Fit
    predicting: Predicting
    untestable: tuple[str, ...]
    cannot_tell: tuple[str, ...] = ()
    tried: Mapping[str, str] = field(default_factory=dict)
    discrepancy: dict[str, object] | None = None

    @property
    def plain(self) -> Fit:
        """The fit of the plain model."""
        return self.search.plain.fit


@dataclass(frozen=True)
class Diagnosis:
    """The diagnosis of a campaign; `missing` says why a channel has none."""

    campaign: str
    channels: tuple[ChannelDiagnosis, ...]
    next_experiments: tuple[dict[str, object], ...] = ()
    missing: Mapping[ChannelName, str] = field(default_factory=dict)
    input_findings: tuple[str, ...] = ()


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
    gain = channel.gain
    names, matrix = correlations(channel)
    return StatedChannel(
        verdict=channel.verdict,
        causes=channel.causes,
        discovered=channel.discovered,
        gain=StatedGain(gain.before, gain.after, gain.noise_floor, gain.explained_fraction, gain.interval_95),
        remainder=channel.remainder,
        discrepancy=channel.discrepancy,
        extra={
            "untestable": channel.untestable,
            "correlations": {"parameters": names, "matrix": np.round(matrix, 4)},
            "cannot_tell": channel.cannot_tell,
            "work": {"fits": channel.search.fits, "ended_early": channel.search.ended_early},
            "models": weighed(channel),
            "predicting": sorted(channel.predicting.model.ids),
            "explanations": plain({k: value for k, value in vars(outcome_of(channel)).items() if k != "verdict"}),
            "discrepancy_of_step": channel.search.best.score.discrepancy,
            "tried": [{"effect": effect, "why_not": why} for effect, why in channel.tried.items()],
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
