"""An effect as a profile and a diagnosis state it: id, parameters, probability, and what explains the data as well.

{"effect": ID, "probability": 0.99, "parameters": {NAME: {"value": V, "standard_uncertainty": U}},
 "indistinguishable_from": [ID, ...]}; names of parameters carry their units.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from shockrig.files.errors import InputError
from shockrig.files.file_table import FileTable, is_number
from shockrig.files.json_files import known
from shockrig.files.ranges import Range

PROBABILITY = Range(0.0, 1.0)


@dataclass(frozen=True)
class Uncertain:
    """A value and its standard uncertainty (one sigma), in the unit that the name of its key carries."""

    value: float
    standard_uncertainty: float = 0.0


@dataclass(frozen=True)
class StatedEffect:
    """An effect as a file states it: an id of the catalogue with its parameters (names carry units)."""

    effect: str
    parameters: Mapping[str, Uncertain] = field(default_factory=dict)
    probability: float | None = None
    indistinguishable_from: tuple[str, ...] = ()

    def value(self, name: str, default: float | None = None) -> float:
        """Value of a parameter; InputError when the profile lacks it and there is no default."""
        if name in self.parameters:
            return self.parameters[name].value
        if default is None:
            raise InputError(
                f"profile: effect {self.effect} lacks the parameter {name!r}; add it or take the effect out"
            )
        return default


def read_effect(
    item: FileTable, catalogue: Mapping[str, Collection[str]] | None = None, channel: str | None = None
) -> StatedEffect:
    """An effect from one object of a file.

    Parameters
    ----------
    item : FileTable
    catalogue : mapping, optional
        Ids that are known -> the channels in which each acts. With it the id must be one of them, and every parameter
        that is stated must have a value; without it any id will do, and a parameter without a value is unknown.
    channel : str, optional
        "temperature" or "humidity": where the effect is said to act, checked against `catalogue`.

    Raises
    ------
    InputError
        Names the file, the key, and the remedy.
    """
    name = item.get("effect")
    if not isinstance(name, str) or not name:
        raise item.error("effect", "the id of an effect", name, "name one")
    if catalogue is not None:
        if name not in catalogue:
            raise item.refuse("effect", f"{name!r} is not in the catalogue ({', '.join(catalogue)})", "take it out")
        if channel is not None and channel not in catalogue[name]:
            raise item.refuse("effect", f"{name} does not act on the {channel} channel", "take it out")
    parameters = {}
    stated = item.mapping("parameters")
    for key in stated.content:
        parameter = read_uncertain(stated, key)
        if parameter is not None:
            parameters[key] = parameter
        elif catalogue is not None:
            raise stated.error(key, "a number as value", stated.get(key), "add it or take the parameter out")
    return StatedEffect(
        name,
        MappingProxyType(parameters),
        item.number("probability", PROBABILITY),
        item.texts("indistinguishable_from", "a list of effect ids"),
    )


def read_uncertain(parent: FileTable, key: str) -> Uncertain | None:
    """A value with its uncertainty (0 where none is stated), or a bare number; None where there is no value."""
    if is_number(parent.get(key)):
        return Uncertain(float(parent.get(key)))
    part = parent.child(key)
    value = None if part is None else part.number("value")
    if part is None or value is None:
        return None
    return Uncertain(value, part.number("standard_uncertainty", at_least=0.0) or 0.0)


def effect_document(effect: StatedEffect) -> dict[str, Any]:
    """An effect as in a profile's `effects` and a diagnosis's `causes`."""
    return known(
        effect=effect.effect,
        probability=effect.probability,
        parameters={name: uncertain_document(value) for name, value in effect.parameters.items()},
        indistinguishable_from=list(effect.indistinguishable_from),
    )


def uncertain_document(value: Uncertain) -> dict[str, float]:
    """A value and its standard uncertainty as in a file."""
    return {"value": value.value, "standard_uncertainty": value.standard_uncertainty}
