"""The diagnosis (`shock-diagnosis/1`) read and written: the one place for both. What it holds is in diagnosis_data.

Keys that the format does not know are kept as `extra`; every number is finite, unknown ones are left out.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from shockrig.files.causes import Uncertain, effect_document, read_effect
from shockrig.files.diagnosis_data import (
    CHANNELS,
    VERDICTS,
    Dependence,
    Discovered,
    EffectSize,
    Likeness,
    StatedCause,
    StatedChannel,
    StatedDiagnosis,
    StatedGain,
    StatedRemainder,
)
from shockrig.files.discovered import interval, plain, read_discovered
from shockrig.files.file_table import FileTable
from shockrig.files.json_files import as_object, known, read_json, write_json

__all__ = [
    "CHANNELS",
    "FORMAT",
    "REMEDY",
    "VERDICTS",
    "Dependence",
    "Discovered",
    "Likeness",
    "EffectSize",
    "StatedCause",
    "StatedChannel",
    "StatedDiagnosis",
    "StatedGain",
    "StatedRemainder",
    "Uncertain",
    "diagnosis_document",
    "diagnosis_from_document",
    "read_diagnosis",
    "write_diagnosis",
]

FORMAT = "shock-diagnosis/1"
REMEDY = "give the diagnosis.json of shockrig diagnose"
Catalogue = Mapping[str, Collection[str]]


def read_diagnosis(path: str | os.PathLike[str], catalogue: Catalogue | None = None) -> StatedDiagnosis:
    """Read and check a diagnosis.

    Parameters
    ----------
    path : path
    catalogue : mapping, optional
        Ids of effects that can be modelled -> the channels in which each acts; given by those who mean to fit the
        causes. Each must be one of them and act in its channel, and every parameter that is stated must have a value.

    Raises
    ------
    InputError
        Names the file, the key, what was expected, and the remedy.
    """
    return _diagnosis(read_json(path, FORMAT, REMEDY), catalogue)


def diagnosis_from_document(
    document: object, source: str = "diagnosis", catalogue: Catalogue | None = None
) -> StatedDiagnosis:
    """As `read_diagnosis`, from parsed JSON; `source` names it in errors."""
    return _diagnosis(as_object(document, source, FORMAT, REMEDY), catalogue)


def write_diagnosis(diagnosis: StatedDiagnosis, path: str | os.PathLike[str]) -> None:
    """Write diagnosis.json, whole or not at all.

    Raises
    ------
    ValueError
        The verdict is none of the format's, or contradicts the causes.
    OSError
        The disk does not take it.
    """
    write_json(Path(path), diagnosis_document(diagnosis), indent=2)


def diagnosis_document(diagnosis: StatedDiagnosis) -> dict[str, Any]:
    """The diagnosis as the JSON document of `shock-diagnosis/1`; errors as for `write_diagnosis`."""
    return {
        "format": FORMAT,
        "campaign": diagnosis.campaign,
        "channels": {name: _channel_document(name, channel) for name, channel in diagnosis.channels.items()},
        "next_experiments": plain(diagnosis.next_experiments),
        **plain(diagnosis.extra),
    }


def _channel_document(name: str, channel: StatedChannel) -> dict[str, Any]:
    contradictions = {
        "adequate": bool(channel.causes or channel.discovered),
        "explained": not channel.causes or bool(channel.discovered),
        "described": not channel.discovered,
        "unexplained": False,
    }
    if contradictions.get(channel.verdict or "", True):
        named = f"{len(channel.causes)} causes and {len(channel.discovered)} discovered effects"
        raise ValueError(f"channels.{name}: verdict {channel.verdict!r} does not go with {named}")
    return known(
        verdict=channel.verdict,
        causes=[_cause_document(cause) for cause in channel.causes],
        discovered=[plain(one) for one in channel.discovered],
        gain=None if channel.gain is None else plain(channel.gain),
        remainder=None if channel.remainder is None else plain(channel.remainder),
        discrepancy=None if channel.discrepancy is None else plain(channel.discrepancy),
        **plain(channel.extra),
    )


def _cause_document(cause: StatedCause) -> dict[str, Any]:
    content = plain(effect_document(cause))
    content["parameters"] = {name: stated for name, stated in content["parameters"].items() if "value" in stated}
    return {**content, **known(at_bound=list(cause.at_bound) or None, evidence=cause.evidence or None)}


def _diagnosis(head: FileTable, catalogue: Catalogue | None) -> StatedDiagnosis:
    head = dataclasses.replace(head, remedy=REMEDY)
    channels = {
        name: _channel(channel, name, catalogue) for name, channel in head.children("channels") if name in CHANNELS
    }
    if not channels:
        raise head.refuse("channels", "holds neither temperature nor humidity")
    return StatedDiagnosis(
        campaign=head.text("campaign") or "",
        channels=channels,
        next_experiments=tuple(item.content for item in head.items("next_experiments")),
        extra=_rest(head, "format", "campaign", "channels", "next_experiments"),
    )


def _channel(channel: FileTable, name: str, catalogue: Catalogue | None) -> StatedChannel:
    verdict = channel.text("verdict")
    if verdict is not None and verdict not in VERDICTS:
        raise channel.error("verdict", f"one of {', '.join(VERDICTS)}", verdict)
    gain, remainder, discrepancy = (channel.child(key) for key in ("gain", "remainder", "discrepancy"))
    return StatedChannel(
        verdict=verdict,
        causes=tuple(_cause(item, name, catalogue) for item in channel.items("causes")),
        discovered=tuple(read_discovered(item) for item in channel.items("discovered")),
        gain=None if gain is None else _gain(gain),
        remainder=None if remainder is None else _remainder(remainder),
        discrepancy=None if discrepancy is None else discrepancy.content,
        extra=_rest(channel, *(field.name for field in dataclasses.fields(StatedChannel))),
    )


def _cause(item: FileTable, channel: str, catalogue: Catalogue | None) -> StatedCause:
    effect = read_effect(item, catalogue, channel)
    stated = {field.name: getattr(effect, field.name) for field in dataclasses.fields(effect)}
    return StatedCause(**stated, at_bound=item.texts("at_bound"), evidence=item.text("evidence") or "")


def _gain(item: FileTable) -> StatedGain:
    return StatedGain(
        held_out_rmse_before=item.number("held_out_rmse_before", at_least=0.0),
        held_out_rmse_after=item.number("held_out_rmse_after", at_least=0.0),
        noise_floor=item.number("noise_floor", at_least=0.0),
        explained_fraction=item.number("explained_fraction"),
        interval_95=interval(item, "interval_95"),
    )


def _remainder(item: FileTable) -> StatedRemainder:
    rms, peak, tolerance = (item.demand(key, item.number(key, at_least=0.0)) for key in ("rms", "peak", "tolerance"))
    significant, material = (item.yes_or_no(key) for key in ("significant", "material"))
    return StatedRemainder(
        rms=rms,
        peak=peak,
        unit=item.text("unit") or "",
        significant=significant,
        material=material,
        tolerance=tolerance,
        from_s=item.number("from_s"),
        until_s=item.number("until_s"),
        varies_with=item.texts("varies_with"),
    )


def _rest(item: FileTable, *keys: str) -> dict[str, Any]:
    return {key: value for key, value in item.content.items() if key not in keys}
