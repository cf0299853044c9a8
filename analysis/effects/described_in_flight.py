"""What a described effect means in a flight: what can be undone is, what cannot is left and said to be.

A flight knows its airspeed, and the temperature at which the sensor is; a direction, a step or a run it has not.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects.behaviours import MEAN, USUAL_C, Form
from shockrig.analysis.effects.laws import laws_of
from shockrig.analysis.inference.effect import InFlight, Values
from shockrig.analysis.physics.exchange import REFERENCE_AIRFLOW_M_S
from shockrig.files.causes import StatedEffect, Uncertain
from shockrig.files.diagnosis_data import Discovered

Array = NDArray[np.float64]
KNOWN = {("airflow", "power"), ("ambient", "exponential")}


def along(form: Form, p: Values, airspeed: Array, temperature_c: Array) -> Array:
    """By what a strength is multiplied along a flight (n,)."""
    out = np.ones(airspeed.shape)
    for factor, how in form.depends_on:
        if (factor, how) == ("airflow", "power"):
            out = out * (np.maximum(airspeed, 0.05) / REFERENCE_AIRFLOW_M_S) ** p[factor]
        elif (factor, how) == ("ambient", "exponential"):
            out = out * np.exp(p[factor] * (temperature_c - USUAL_C))
    return out


def as_listed(one: Discovered) -> StatedEffect | None:
    """The catalogued effect with the same closed form as a described one, for who has equations of those alone."""
    if one.depends_on or one.driver in ("airflow", "die_temperature"):
        return None
    size = None if one.size is None else Uncertain(one.size.value, one.size.standard_uncertainty)
    numbers = {"size": size, "time_constant_s": one.time_constant_s}
    for effect, named in laws_of(Form(one.behaves_as, one.driver)):
        known = {name: value for name, of in named.items() if (value := numbers[of]) is not None}
        if len(known) < len(named):
            continue
        nothing = (
            {"gain": Uncertain(0.0, 0.0), "offset": Uncertain(0.0, 0.0)} if set(named) <= {"gain", "offset"} else {}
        )
        return StatedEffect(effect, {**nothing, **known})
    return None


def flown(form: Form) -> InFlight:
    """How a correction treats a form that belongs to the sensor."""
    if form.depends_on == (("ambient", "zero_at"),) and form.behaves_as == "gain":
        return InFlight(undo=lambda p, y, stream, length: (y + p["size"] * p["ambient"]) / (1 + p["size"]))
    if form.depends_on == (("ambient", "linear"),) and form.behaves_as == "gain":
        return InFlight(undo=lambda p, y, stream, length: y / (1.0 + p["size"] * (stream.temperature_c - USUAL_C)))
    if form == MEAN:
        return InFlight(delay_s=lambda p, period_s: 0.5 * max(p["time_constant_s"] - period_s, 0.0))
    if any(pair not in KNOWN for pair in form.depends_on):
        return InFlight(left=True)
    scale: Callable[[Values, Array, Array], Array] = partial(along, form)
    only_airflow = set(form.depends_on) <= {("airflow", "power")}
    still = np.full(1, USUAL_C)
    if form.behaves_as == "lag_in_series" and form.driver == "airflow":
        if not only_airflow:
            return InFlight(left=True)
        return InFlight(biot=lambda p, stream, length: 1.0 / (p["size"] * scale(p, stream.airflow_m_s, still)))
    if form.behaves_as == "lag_in_series":
        return InFlight(
            series_s=lambda p: p["time_constant_s"],
            series_along=scale if form.depends_on else None,
        )
    if form.behaves_as == "rate_change":
        return InFlight(rate=scale)
    if not form.depends_on and form.behaves_as == "parallel_lag":
        return InFlight(lag=lambda p: (p["size"], p["time_constant_s"]))
    if not form.depends_on and form.behaves_as == "delay":
        return InFlight(delay_s=lambda p, period_s: max(p["size"], 0.0))
    if form.driver == "die_temperature" and form.behaves_as == "gain" and not form.depends_on:
        return InFlight(at_die=True, die_share=lambda p: -p["size"])
    if form.driver == "own_response" and form.behaves_as == "gain" and only_airflow:
        return InFlight(undo=lambda p, y, stream, length: y / (1.0 + p["size"] * scale(p, stream.airflow_m_s, still)))
    if form.behaves_as == "offset" and only_airflow:
        return InFlight(undo=lambda p, y, stream, length: y - p["size"] * scale(p, stream.airflow_m_s, still))
    return InFlight(left=True)
