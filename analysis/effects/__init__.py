"""The catalogue: every effect that the diagnosis can name, in one file for each family along the measurement chain.

To add an effect, write its entry into its family's file and name it in `EFFECTS` there; the contract tests then run
over it.
"""

from __future__ import annotations

import copyreg
from collections.abc import Iterable
from dataclasses import replace

from shockrig.analysis.effects import air, body, exchange, heat, logger, of_flight, reading
from shockrig.analysis.effects.described import described, is_described
from shockrig.analysis.effects.forms import form_of
from shockrig.analysis.estimate.effect import Effect, Parameter
from shockrig.analysis.estimate.model import Held, Structure

__all__ = ["CATALOGUE", "OF_FLIGHT", "Effect", "Parameter", "by_id", "in_channel", "structure_of"]

# In the order of the chain, as the entries within each family are.
_FAMILIES = (air, exchange, body, heat, reading, logger)

CATALOGUE: dict[str, Effect] = {
    effect.id: replace(effect, order=i)
    for i, effect in enumerate(one for family in _FAMILIES for one in family.EFFECTS)
}
OF_FLIGHT: dict[str, Effect] = {effect.id: effect for effect in of_flight.EFFECTS}


def by_id(id_: str) -> Effect:
    """An entry of the catalogue."""
    return CATALOGUE[id_]


def in_channel(id_: str, channel: str) -> Effect:
    """An effect of a channel by its id: an entry of the catalogue, or a form.

    Raises
    ------
    KeyError, ValueError
        There is none.
    """
    return described(form_of(id_).key, channel == "humidity") if is_described(id_) else CATALOGUE[id_]


def _reduced(effect: Effect) -> tuple[object, ...]:
    if is_described(effect.id):
        return described, (effect.id, "humidity" in effect.channels)
    return by_id, (effect.id,)


# Effects are pickled by name, as functions are.
copyreg.pickle(Effect, _reduced)  # type: ignore[arg-type]


def structure_of(ids: Iterable[str], held: Iterable[tuple[str, str, float]] = ()) -> Structure:
    """A model's structure from ids, and (effect, parameter, value) of what is held."""
    return Structure(tuple(CATALOGUE[id_] for id_ in ids), tuple(Held(*one) for one in held))
