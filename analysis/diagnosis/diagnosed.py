"""What a diagnosis says of a channel and of a campaign: data, without how it came about."""

from __future__ import annotations

from dataclasses import dataclass, field

from shockrig.analysis.diagnosis.adequacy import Adequacy
from shockrig.analysis.diagnosis.describing import Description
from shockrig.analysis.diagnosis.gain import Gain
from shockrig.analysis.diagnosis.remainder import Remainder
from shockrig.analysis.diagnosis.search import (
    Search,
)
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.noise import Noise
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.quantity import ChannelName
from shockrig.analysis.inference.work import Work
from shockrig.files.diagnosis_data import Discovered

NO_STEP = "no usable run with a step of the air"
MOST_CERTAIN = 0.995


@dataclass(frozen=True)
class Cause:
    """One named cause: parameters as (value, standard uncertainty), its probability, and who could stand in its
    place."""

    effect: str
    parameters: dict[str, tuple[float, float]]
    probability: float
    indistinguishable_from: tuple[str, ...]
    evidence: float
    at_bound: tuple[str, ...] = ()
    why: str = ""


@dataclass(frozen=True)
class Tried:
    """An effect that lowers the misfit and is not named, and why."""

    effect: str
    why: str


@dataclass(frozen=True)
class ChannelDiagnosis:
    """The verdict on one channel with everything it rests on."""

    name: ChannelName
    verdict: str
    causes: tuple[Cause, ...]
    gain: Gain
    search: Search
    adequacy: Adequacy
    plain_adequacy: Adequacy
    remainder: Remainder
    problem: Problem
    noise: Noise
    plain: Fit
    final: Fit
    untestable: tuple[str, ...]
    cannot_tell: tuple[str, ...] = ()
    tried: tuple[Tried, ...] = ()
    discrepancy: dict[str, object] | None = None
    described: Description | None = None
    humming: tuple[Discovered, ...] = ()
    work: Work = field(default_factory=Work)

    @property
    def discovered(self) -> tuple[Discovered, ...]:
        """Effects that nobody listed, as the diagnosis states them."""
        return (*(() if self.described is None else self.described.discovered), *self.humming)


@dataclass(frozen=True)
class Diagnosis:
    """The diagnosis of a campaign."""

    campaign: str
    channels: tuple[ChannelDiagnosis, ...]
    next_experiments: tuple[dict[str, object], ...] = ()
    missing: tuple[ChannelName, ...] = ()
    input_findings: tuple[str, ...] = ()
