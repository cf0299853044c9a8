"""Which forms of the grammar are the law of a catalogued effect: the same closed form by another door."""

from __future__ import annotations

from collections.abc import Mapping

from shockrig.analysis.effects.behaviours import Factor, Form

# (behaviour, driver, what it depends on) -> effects with that law, each with its parameters by the form's. Either
# quantity of the air is "air" as a driver. A parameter that the form has not is at its value for nothing.
Law = tuple[str, Mapping[str, str]]
LAWS: dict[tuple[str, str, tuple[Factor, ...]], tuple[Law, ...]] = {
    ("delay", "none", ()): (("dead_time", {"delay_s": "size"}),),
    ("delay", "none", (("history", "linear"),)): (("clock_drift", {"ppm": "size"}),),
    ("lag_in_series", "air", ()): (("series_lag", {"time_constant_s": "time_constant_s"}),),
    ("lag_in_series", "air", (("history", "linear"),)): (("finite_transfer", {"duration_s": "time_constant_s"}),),
    ("parallel_lag", "air", ()): tuple(
        (effect, {"fraction": "size", "time_constant_s": "time_constant_s"})
        for effect in ("parallel_lag", "stem_conduction", "slow_relaxation")
    ),
    ("gain", "own_response", ()): (("calibration_error", {"gain": "size"}),),
    ("offset", "none", ()): (("calibration_error", {"offset": "size"}),),
    ("rate_change", "own_response", (("humidity", "linear"),)): (
        ("concentration_dependent_diffusivity", {"slope_per_unit_activity": "humidity"}),
    ),
    ("added_response", "die_temperature", ()): (("calibration_temperature", {"percent_per_k": "size"}),),
}


def _driver(form: Form) -> str:
    return "air" if form.driver in ("air_temperature", "air_humidity") else form.driver


def laws_of(form: Form) -> tuple[Law, ...]:
    """The effects whose law a form is, whether the catalogue at hand holds them or not."""
    return LAWS.get((form.behaves_as, _driver(form), form.depends_on), ())


def kin(effect: str, form: Form) -> bool:
    """Whether a form is the behaviour of an effect's law, by another rule or by the same."""
    return any(
        (form.behaves_as, _driver(form)) == key[:2]
        for key, laws in LAWS.items()
        if any(name == effect for name, _ in laws)
    )
