"""The catalogue: every effect that the diagnosis can name, one file each on one link of the measurement chain.

To add an effect, add its file and its line here; the contract tests then run over it.
"""

from __future__ import annotations

import copyreg
import importlib
from collections.abc import Iterable
from dataclasses import replace

from shockrig.analysis.effects import film_beside_bead, offset_in_descent, ventilated_warmth
from shockrig.analysis.effects.described import described, is_described
from shockrig.analysis.estimate.effect import Effect, Parameter
from shockrig.analysis.estimate.model import Held, Structure

__all__ = ["CATALOGUE", "OF_FLIGHT", "Effect", "Parameter", "by_id", "structure_of"]

# In the order of the chain.
_FILES = (
    "finite_transfer",
    "air_relaxation",
    "two_places",
    "convective_film",
    "exchange_temperature",
    "vapour_boundary_layer",
    "series_lag",
    "sheath",
    "condensation",
    "other_body",
    "direction_dependent_diffusivity",
    "concentration_dependent_diffusivity",
    "slow_relaxation",
    "stem_conduction",
    "parallel_lag",
    "evaporative_cooling",
    "self_heating",
    "radiative_heating",
    "wall_radiation",
    "die_thermal_lag",
    "uptake_by_activity",
    "calibration_temperature",
    "hysteresis",
    "calibration_error",
    "saturation_clipping",
    "dead_time",
    "clock_drift",
    "moving_average",
    "stale_samples",
    "quantization",
)


def _entries() -> Iterable[Effect]:
    for name in _FILES:
        module = importlib.import_module(f"{__name__}.{name}")
        yield from getattr(module, "EFFECTS", None) or (module.EFFECT,)


CATALOGUE: dict[str, Effect] = {effect.id: replace(effect, order=i) for i, effect in enumerate(_entries())}
# What no bench shows: flights alone find it, and a correction takes it off as it does the catalogue's.
OF_FLIGHT: dict[str, Effect] = {
    one.EFFECT.id: one.EFFECT for one in (offset_in_descent, ventilated_warmth, film_beside_bead)
}


def by_id(id_: str) -> Effect:
    """An entry of the catalogue."""
    return CATALOGUE[id_]


def _reduced(effect: Effect) -> tuple[object, ...]:
    if is_described(effect.id):
        return described, (effect.id, "humidity" in effect.channels)
    return by_id, (effect.id,)


# Effects are pickled by name, as functions are.
copyreg.pickle(Effect, _reduced)  # type: ignore[arg-type]


def structure_of(ids: Iterable[str], held: Iterable[tuple[str, str, float]] = ()) -> Structure:
    """A model's structure from ids, and (effect, parameter, value) of what is held."""
    return Structure(tuple(CATALOGUE[id_] for id_ in ids), tuple(Held(*one) for one in held))
