"""Causes of a diagnosis as an extended model: `characterize --extend DIAGNOSIS.json` fits it, not the plain one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.behaviours import MEAN
from shockrig.analysis.effects.described import entry_of, stated_values
from shockrig.analysis.estimate.model import PLAIN, Held, Structure
from shockrig.analysis.estimate.quantity import QUANTITIES, ChannelName
from shockrig.files.causes import StatedEffect
from shockrig.files.diagnosis import read_diagnosis
from shockrig.files.diagnosis_data import Discovered


@dataclass(frozen=True)
class Extension:
    """Extended model of one channel: its structure, starts by "effect.parameter", the causes as they were named, and
    the effects that nobody listed as they were described."""

    structure: Structure = PLAIN
    starts: Mapping[str, float] | None = None
    causes: tuple[StatedEffect, ...] = ()
    discovered: tuple[Discovered, ...] = ()


def read_extension(path: str | Path) -> dict[ChannelName, Extension]:
    """Extended models of the channels that a diagnosis holds.

    Raises
    ------
    InputError
        Where the file is no diagnosis or names what the catalogue does not know: names file, key and remedy.
    """
    stated = read_diagnosis(path, {name: effect.channels for name, effect in CATALOGUE.items()})
    return {
        name: extension_of(
            [cause.as_effect() for cause in stated.channels[name].causes], stated.channels[name].discovered, name
        )
        for name in QUANTITIES
        if name in stated.channels
    }


def extension_of(
    causes: Sequence[StatedEffect], discovered: Sequence[Discovered] = (), channel: ChannelName = "temperature"
) -> Extension:
    """The model that carries `causes`, and what was described beside them in `channel`; what single readings show
    (rounding, repeats, averages) is held, not fitted."""
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
    entries = [CATALOGUE[c.effect] for c in causes]
    carried = []
    for one in discovered:
        described = entry_of(one, channel)
        if described is None:
            continue
        values = stated_values(one)
        for parameter in described.parameters:
            value = values[parameter.name].value if parameter.name in values else parameter.starts[0]
            value = float(min(max(value, parameter.low), parameter.high))
            if described.id == MEAN.key:
                held.append(Held(described.id, parameter.name, value))
            else:
                starts[f"{described.id}.{parameter.name}"] = value
        entries.append(described)
        carried.append(one)
    return Extension(Structure(tuple(entries), tuple(held)), starts, causes, tuple(carried))
