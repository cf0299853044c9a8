"""Causes of a diagnosis as an extended model: `characterize --extend DIAGNOSIS.json` fits it, not the plain one."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.model import PLAIN, Held, Structure
from shockrig.analysis.inference.quantity import QUANTITIES, ChannelName
from shockrig.files.errors import InputError
from shockrig.files.profile import StatedEffect, Uncertain

FORMAT = "shock-diagnosis/1"
MEND = "give the diagnosis.json of shockrig diagnose"


@dataclass(frozen=True)
class Extension:
    """Extended model of one channel: its structure, starts by "effect.parameter", and the causes as they were named."""

    structure: Structure = PLAIN
    starts: Mapping[str, float] | None = None
    causes: tuple[StatedEffect, ...] = ()


def read_extension(path: str | Path) -> dict[ChannelName, Extension]:
    """Extended models of the channels that a diagnosis holds.

    Raises
    ------
    InputError
        Where the file is no diagnosis or names what the catalogue does not know: names file, key and mend.
    """
    file = Path(path)
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{file}: {error.strerror}; {MEND}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file}: is not JSON ({error}); {MEND}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = content.get("format") if isinstance(content, dict) else type(content).__name__
        raise InputError(f'{file}: key format: expected "{FORMAT}", found {found!r}; {MEND}')
    channels = _mapping(content.get("channels"), file, "channels")
    extensions: dict[ChannelName, Extension] = {}
    for name in QUANTITIES:
        if name in channels:
            causes = _mapping(channels[name], file, f"channels.{name}").get("causes") or []
            if not isinstance(causes, list):
                raise InputError(f"{file}: key channels.{name}.causes: expected a list, found {type(causes).__name__}")
            extensions[name] = _extension(causes, name, file)
    if not extensions:
        raise InputError(f"{file}: key channels: holds neither temperature nor humidity; diagnose the campaign first")
    return extensions


def _extension(causes: list[Any], name: ChannelName, file: Path) -> Extension:
    effects: list[StatedEffect] = []
    for i, cause in enumerate(causes):
        key = f"channels.{name}.causes[{i}]"
        effect = _mapping(cause, file, key).get("effect")
        if not isinstance(effect, str) or effect not in CATALOGUE:
            raise InputError(f"{file}: key {key}.effect: {effect!r} is not in the catalogue ({', '.join(CATALOGUE)})")
        if name not in CATALOGUE[effect].channels:
            raise InputError(f"{file}: key {key}.effect: {effect} does not act on the {name} channel; take it out")
        parameters = {}
        for parameter, given in _mapping(cause.get("parameters") or {}, file, f"{key}.parameters").items():
            value = given.get("value") if isinstance(given, dict) else given
            spread = given.get("standard_uncertainty") if isinstance(given, dict) else None
            if not _is_number(value):
                where = f"{file}: key {key}.parameters.{parameter}"
                raise InputError(f"{where}: expected a number as value, found {value!r}")
            parameters[parameter] = Uncertain(float(value), float(spread) if _is_number(spread) else 0.0)
        probability = float(cause["probability"]) if _is_number(cause.get("probability")) else None
        alike = tuple(str(a) for a in cause.get("indistinguishable_from") or ())
        effects.append(StatedEffect(effect, parameters, probability, alike))
    return extension_of(effects)


def extension_of(causes: list[StatedEffect] | tuple[StatedEffect, ...]) -> Extension:
    """The model that carries `causes`; what single readings show (rounding, repeats, averages) is held, not fitted."""
    causes = tuple({cause.effect: cause for cause in causes}.values())
    held: list[Held] = []
    starts: dict[str, float] = {}
    for cause in causes:
        entry = CATALOGUE[cause.effect]
        for parameter in entry.parameters:
            if parameter.name in cause.parameters:
                value = float(min(max(cause.parameters[parameter.name].value, parameter.low), parameter.high))
            else:
                value = parameter.starts[0]
            if entry.fitted:
                starts[f"{cause.effect}.{parameter.name}"] = value
            else:
                held.append(Held(cause.effect, parameter.name, value))
    structure = Structure(tuple(CATALOGUE[c.effect] for c in causes), tuple(held))
    return Extension(structure, starts, causes)


def _mapping(value: Any, file: Path, key: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{file}: key {key}: expected an object, found {type(value).__name__}; write it as {{...}}")
    return value


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
