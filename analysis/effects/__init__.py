"""The catalogue: every effect that the diagnosis can name, one file each on one link of the measurement chain.

To add an effect, add its file and its line here; the contract tests then run over it.
"""

from __future__ import annotations

import importlib

from shockrig.analysis.effects.effect import Effect, Parameter

__all__ = ["CATALOGUE", "Effect", "Parameter"]

_IDS = (
    "finite_transfer",
    "air_relaxation",
    "convective_film",
    "vapour_boundary_layer",
    "condensation",
    "direction_dependent_diffusivity",
    "concentration_dependent_diffusivity",
    "slow_relaxation",
    "stem_conduction",
    "evaporative_cooling",
    "self_heating",
    "radiative_heating",
    "die_thermal_lag",
    "hysteresis",
    "calibration_error",
    "saturation_clipping",
    "dead_time",
    "clock_drift",
    "moving_average",
    "stale_samples",
    "quantization",
)

CATALOGUE: dict[str, Effect] = {name: importlib.import_module(f"{__name__}.{name}").EFFECT for name in _IDS}
