"""A sealed truth beside a diagnosis: what was named, missed or made up, and how far the parameters are off.

Per channel an effect at work there is `named`, `listed` (only among a named cause's look-alikes) or `missed`; a cause
that is not at work and has no such look-alike is `wrong`. Errors are in units of the stated standard uncertainty.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shockrig.files.campaign_names import FIRST_PROBE, sensor_name, serial_numbers
from shockrig.files.diagnosis import REMEDY, StatedChannel, StatedDiagnosis, diagnosis_from_document, read_diagnosis
from shockrig.files.errors import InputError
from shockrig.protocols.made_before import KEY
from shockrig.rig.virtual.effects import OUTSIDE
from shockrig.rig.virtual.hide import open_seal
from shockrig.rig.virtual.truth import EMULATED_SERIAL, Truth, of_probe, serial_number


@dataclass(frozen=True)
class ParameterError:
    """How far one parameter of a named effect is off; `sigmas` is None where no uncertainty is stated."""

    effect: str
    parameter: str
    true: float
    value: float
    sigmas: float | None


@dataclass(frozen=True)
class ChannelScore:
    """One channel's diagnosis against the truth. `probabilities` holds (effect, stated probability, whether it is at
    work).
    """

    channel: str
    hidden: tuple[str, ...]
    expected_verdict: str
    verdict: str
    named: tuple[str, ...] = ()
    listed: tuple[str, ...] = ()
    missed: tuple[str, ...] = ()
    wrong: tuple[str, ...] = ()
    errors: tuple[ParameterError, ...] = ()
    probabilities: tuple[tuple[str, float, bool], ...] = ()

    @property
    def verdict_right(self) -> bool:
        # What has no name may be described all the same.
        described = self.expected_verdict == "unexplained" and self.verdict == "described"
        return described or self.verdict == self.expected_verdict

    @property
    def exact(self) -> bool:
        """The verdict is right, all that has a name is named, and nothing else is."""
        return self.verdict_right and not (self.listed or self.missed or self.wrong)


@dataclass(frozen=True)
class RevealScore:
    """Both channels; a channel that the diagnosis does not hold is not judged."""

    truth: Truth
    seed: int
    channels: Mapping[str, ChannelScore] = field(default_factory=dict)

    @property
    def exact(self) -> bool:
        return all(channel.exact for channel in self.channels.values())


def score(sealed: Path, diagnosis: Path | Mapping[str, Any], probe: str = FIRST_PROBE) -> RevealScore:
    """Score a diagnosis (diagnosis.json's path or content) of a probe against a sealed truth.

    Raises InputError where the diagnosis cannot be read or is of other sensors, BenchError where the seal cannot be.
    """
    truth, seed = open_seal(Path(sealed))
    stated = diagnosis_from_document(dict(diagnosis)) if isinstance(diagnosis, Mapping) else read_diagnosis(diagnosis)
    where = "diagnosis" if isinstance(diagnosis, Mapping) else str(diagnosis)
    _demand_these_sensors(truth, stated, probe, sealed, where)
    truth = of_probe(truth, probe)
    judged = {name: _score_channel(truth, name, channel, where) for name, channel in stated.channels.items()}
    return RevealScore(truth, seed, judged)


def _demand_these_sensors(truth: Truth, stated: StatedDiagnosis, probe: str, sealed: Path, where: str) -> None:
    """Raise InputError for a diagnosis of another probe, or of emulated sensors that another seal belongs to, as far as
    it says what it is of."""
    made, sensors = (one if isinstance(one := stated.extra.get(key), dict) else {} for key in (KEY, "sensors"))
    if (its := made.get("probe", probe)) != probe:
        raise InputError(
            f"{where}: is a diagnosis of probe {its}; give --probe {its}, or the diagnosis of probe {probe}"
        )
    for name, serial in serial_numbers(sensors, emulated=True).items():
        own = serial_number(truth, sensor_name(name, probe))
        if re.fullmatch(EMULATED_SERIAL, serial) and serial != own:
            raise InputError(
                f"{where}: is a diagnosis of {name} {serial}, and {sealed} is the truth of {own}; give what belongs "
                "together"
            )


def _score_channel(truth: Truth, channel: str, found: StatedChannel, where: str) -> ChannelScore:
    if found.verdict is None:
        raise InputError(f"{where}: key channels.{channel}.verdict: expected text, found nothing; {REMEDY}")
    causes = {cause.effect: cause for cause in found.causes}
    at_work = {h.effect: h.parameters for h in truth.effects if channel in h.channels}
    nameable = [effect for effect in at_work if effect not in OUTSIDE]
    alike = {effect: set(cause.indistinguishable_from) for effect, cause in causes.items()}
    named = [effect for effect in nameable if effect in causes]
    listed = [e for e in nameable if e not in causes and any(e in others for others in alike.values())]
    missed = [e for e in nameable if e not in named and e not in listed]
    wrong = [e for e in causes if e not in at_work and not alike[e] & set(listed)]
    errors = []
    for effect in named:
        for name, true in at_work[effect].items():
            stated = causes[effect].parameters.get(name)
            if stated is not None:
                sigma = stated.standard_uncertainty
                sigmas = (stated.value - true) / sigma if sigma else None
                errors.append(ParameterError(effect, name, true, stated.value, sigmas))
    return ChannelScore(
        channel=channel,
        hidden=tuple(at_work),
        expected_verdict="unexplained" if len(nameable) < len(at_work) else "explained" if at_work else "adequate",
        verdict=found.verdict,
        named=tuple(named),
        listed=tuple(listed),
        missed=tuple(missed),
        wrong=tuple(wrong),
        errors=tuple(errors),
        probabilities=tuple((e, c.probability, e in at_work) for e, c in causes.items() if c.probability is not None),
    )


def table(result: RevealScore) -> str:
    """The score as text for people."""
    truth = result.truth
    lines = [
        f"sealed with seed {result.seed}: alpha {truth.thermal_diffusivity_m2_s:.4g} m2/s, "
        f"D(20 degC) {float(truth.diffusivity_m2_s(20.0)):.4g} m2/s"
    ]
    for c in result.channels.values():
        right = "right" if c.verdict_right else f"should be {c.expected_verdict}"
        lines += ["", f"{c.channel}: {c.verdict} ({right})"]
        rows = [("named", e) for e in c.named] + [("listed", e) for e in c.listed] + [("missed", e) for e in c.missed]
        rows += [("no name", e) for e in c.hidden if e in OUTSIDE] + [("wrong", e) for e in c.wrong]
        for outcome, effect in rows or [("nothing", "was hidden, nothing was named")]:
            lines.append(f"  {outcome:8} {effect}")
            hidden = next((h.parameters for h in truth.effects if h.effect == effect and c.channel in h.channels), {})
            for name, true in hidden.items():
                error = next((e for e in c.errors if (e.effect, e.parameter) == (effect, name)), None)
                if error is None:
                    lines.append(f"           {name:26} hidden {true:<10.4g}")
                else:
                    sigmas = (
                        "no uncertainty stated"
                        if error.sigmas is None
                        else f"off by {error.sigmas:+.1f} standard uncertainties"
                    )
                    lines.append(f"           {name:26} hidden {true:<10.4g} found {error.value:<10.4g} {sigmas}")
    lines += ["", "all named and nothing else" if result.exact else "not all as it is"]
    return "\n".join(lines)
