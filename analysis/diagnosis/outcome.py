"""What a diagnosis leaves standing, as whoever plans takes it: the models that come near the stated one, with values.

It is said in diagnosis.json (`explanations` of a channel), so that the same campaign is not diagnosed once more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from shockrig.analysis.diagnosis.diagnosed import ChannelDiagnosis
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.behaviours import form_of
from shockrig.analysis.effects.described import described, is_described
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.quantity import QUANTITIES, ChannelName
from shockrig.files.discovered import plain

FARTHEST_NATS = 12.0  # behind the stated model: what a planner calls tied at its thirtieth look, as it spends its error

Explanation = Mapping[str, Mapping[str, float]]  # effect -> parameter -> value that a fit begins from


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
    """What is left of a channel's diagnosis once its fits are forgotten.

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


def explained_by(found: Fit) -> Explanation:
    """A fit's effects with their values."""
    return {e: {p: value for p, (value, _) in own.items()} for e, own in found.values().items()}


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


def outcome_document(outcome: ChannelOutcome) -> dict[str, Any]:
    """It as diagnosis.json has it."""
    return dict(plain({key: value for key, value in vars(outcome).items() if key != "verdict"}))


def read_outcome(verdict: str | None, said: object, name: ChannelName) -> ChannelOutcome | None:
    """It from diagnosis.json; None where the file does not have it, or has effects that this version has not."""
    try:
        assert isinstance(said, Mapping)
        near = [Near(_explanation(n["explanation"], name), float(n["nats"]), bool(n["tied"]), bool(n["lacks"]))
                for n in said["near"]]  # fmt: skip
        return ChannelOutcome(
            str(verdict),
            tuple(map(str, said["runs"])),
            bool(said["passed"]),
            float(said["weight"]),
            _explanation(said["best"], name),
            _explanation(said["stated"], name),
            tuple(near),
        )
    except (AssertionError, AttributeError, KeyError, TypeError, ValueError):
        return None


def _explanation(said: Mapping[str, Mapping[str, float]], name: ChannelName) -> Explanation:
    """An explanation whose effects and parameters are this version's; raises ValueError where one is not."""
    jumps = QUANTITIES[name].name == "humidity"
    for id_, values in said.items():
        effect = described(form_of(id_).key, jumps) if is_described(id_) else CATALOGUE[id_]
        if set(values) != {parameter.name for parameter in effect.parameters}:
            raise ValueError(f"{id_}: other parameters")
    return {id_: {p: float(value) for p, value in values.items()} for id_, values in said.items()}
