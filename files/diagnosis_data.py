"""What a diagnosis says, channel by channel: verdict, causes, effects that nobody listed, gain, what is left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from shockrig.files.causes import StatedEffect, Uncertain

CHANNELS = ("temperature", "humidity")
VERDICTS = ("adequate", "explained", "described", "unexplained")
BEHAVIOURS = (
    "lag_in_series",  # the body or the readout follows late
    "parallel_lag",  # a share of the response follows slowly
    "added_response",  # something leaks in, proportional to a driver, with its own time constant
    "added_rate",  # proportional to a driver's rate of change
    "gain",
    "offset",
    "rate_change",  # alpha or D moves with a factor
    "delay",
    "periodic",
    "bursts",
)
DRIVERS = (*("air_temperature", "air_humidity", "own_response", "die_temperature", "other_sensor", "airflow", "none"),)
FACTORS = (
    *("airflow", "ambient", "direction", "step", "humidity", "pressure", "run_order", "time_of_campaign", "history"),
)


@dataclass(frozen=True)
class StatedCause(StatedEffect):
    """A named cause: an effect of the catalogue, the parameters that stand at a bound, and the evidence in words."""

    at_bound: tuple[str, ...] = ()
    evidence: str = ""

    def as_effect(self) -> StatedEffect:
        """The same as a profile states it, without what belongs to the diagnosis."""
        return StatedEffect(self.effect, self.parameters, self.probability, self.indistinguishable_from)


@dataclass(frozen=True)
class StatedGain:
    """Root-mean-square error on unseen runs before and after the extension, in K or %RH; None where it is unknown.

    `explained_fraction` is (before^2 - after^2) / (before^2 - noise^2), `interval_95` its 95 % interval.
    """

    held_out_rmse_before: float | None = None
    held_out_rmse_after: float | None = None
    noise_floor: float | None = None
    explained_fraction: float | None = None
    interval_95: tuple[float, float] | None = None


@dataclass(frozen=True)
class StatedRemainder:
    """What the model with all its causes leaves on unseen runs above the noise, in `unit`.

    `significant` is a matter of statistics, `material` of use (as large as `tolerance`); from `from_s` until `until_s`
    after the transfer it is largest.
    """

    rms: float
    peak: float
    unit: str
    significant: bool
    material: bool
    tolerance: float
    from_s: float | None = None
    until_s: float | None = None
    varies_with: tuple[str, ...] = ()


@dataclass(frozen=True)
class EffectSize:
    """How strong a discovered effect is, with the unit ("1" for a share)."""

    value: float
    standard_uncertainty: float
    unit: str


@dataclass(frozen=True)
class Dependence:
    """How a discovered effect changes with a factor: `form` such as "power", its number and that one's uncertainty."""

    factor: str
    form: str
    value: float | None = None
    standard_uncertainty: float | None = None


@dataclass(frozen=True)
class Likeness:
    """The effect of the catalogue that behaves most alike, from 0 to 1, and why it is not that one."""

    effect: str
    likeness: float
    why_not: str = ""


@dataclass(frozen=True)
class Discovered:
    """An effect that nobody listed, described by how it behaves.

    `phase_rad` is a swing's at the transfer. `seen_over` maps a quantity with its unit ("airflow_m_s") to the lowest
    and highest value at which it was seen; nothing is known beyond.
    """

    behaves_as: str
    driver: str
    time_constant_s: Uncertain | None = None
    period_s: Uncertain | None = None
    phase_rad: Uncertain | None = None
    size: EffectSize | None = None
    depends_on: tuple[Dependence, ...] = ()
    does_not_depend_on: tuple[str, ...] = ()
    alternatives: tuple[Discovered, ...] = ()
    nearest_catalogued: Likeness | None = None
    probability: float | None = None
    explained_fraction: float | None = None
    seen_over: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class StatedChannel:
    """One channel of a diagnosis; `extra` holds what a file says besides, as it stands there."""

    verdict: str | None
    causes: tuple[StatedCause, ...] = ()
    discovered: tuple[Discovered, ...] = ()
    gain: StatedGain | None = None
    remainder: StatedRemainder | None = None
    discrepancy: Mapping[str, Any] | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class StatedDiagnosis:
    """A diagnosis as its file says it: "temperature" and/or "humidity" -> channel; runs that would tell more."""

    campaign: str
    channels: Mapping[str, StatedChannel]
    next_experiments: tuple[Mapping[str, Any], ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)
