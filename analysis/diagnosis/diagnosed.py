"""What a diagnosis says of a channel and of a campaign: data, without how it came about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from shockrig.analysis.diagnosis.adequacy import Adequacy
from shockrig.analysis.diagnosis.gain import Gain
from shockrig.analysis.diagnosis.remainder import Remainder
from shockrig.analysis.diagnosis.search import Search
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.noise import Noise
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.quantity import ChannelName
from shockrig.files.diagnosis_data import Discovered

NO_STEP = "no usable run with a step of the air"


@dataclass(frozen=True)
class Cause:
    """One named cause: parameters as (value, standard uncertainty), its probability, what is tied with it, and by how
    much unseen runs are predicted worse without it [nats]."""

    effect: str
    parameters: dict[str, tuple[float, float]]
    probability: float
    indistinguishable_from: tuple[str, ...]
    evidence: float
    at_bound: tuple[str, ...] = ()
    why: str = ""


@dataclass(frozen=True)
class Tried:
    """An effect that was tried and is not named, and why."""

    effect: str
    why: str


@dataclass(frozen=True)
class ChannelDiagnosis:
    """The verdict on one channel with everything it rests on.

    `plain` and `final` are the fits of the plain model and of the one that is stated; `discrepancy` describes what is
    left where it matters.
    """

    name: ChannelName
    verdict: str
    causes: tuple[Cause, ...]
    discovered: tuple[Discovered, ...]
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


@dataclass(frozen=True)
class Diagnosis:
    """The diagnosis of a campaign; `missing` says why a channel has none."""

    campaign: str
    channels: tuple[ChannelDiagnosis, ...]
    next_experiments: tuple[dict[str, object], ...] = ()
    missing: Mapping[ChannelName, str] = field(default_factory=dict)
    input_findings: tuple[str, ...] = ()
