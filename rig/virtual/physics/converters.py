"""From what the probes have come to, to what their converters would read without noise.

Temperature: core, stem, self-heating, calibration. Humidity: H = c Pa / (1e4 Ps(T)) at the air's or the die's
temperature, hysteresis, calibration, clipping, in this order.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shockrig.rig.virtual.effects import RH, T
from shockrig.rig.virtual.physics.exposure import Exposure
from shockrig.rig.virtual.physics.moist import ZERO_C_K, Numbers, dew_point_c, heat_carried_off, humidity_percent
from shockrig.rig.virtual.physics.probes import SORPTION_HEAT_S, Bodies
from shockrig.rig.virtual.truth import Truth

HYSTERESIS_WIDTH_PERCENT = 5.0
DEW_MARGIN_K = 0.5  # dew wets a bead that comes from air colder than the destination's dew point by this much


def temperature_reading(truth: Truth, exposure: Exposure[Any], bodies: Bodies[Any], since_s: Numbers) -> np.ndarray:
    """Reading of the bead, degC; `since_s` (n, r) is the time since the transfer, `bodies` the same shape."""
    reading = bodies.core_c
    if p := truth.effect("stem_conduction"):
        reading = reading + p["fraction"] * (bodies.stem_c - reading)
    if p := truth.effect("self_heating"):
        reading = reading + p["rise_k_at_5_m_s"] * _stagnation(truth, exposure)
    if p := truth.effect("radiative_heating"):
        rise = p["kelvin_per_w_m2_at_5_m_s"] * exposure.irradiance_w_m2
        reading = reading + rise * _stagnation(truth, exposure)
    if (p := truth.effect("evaporative_cooling")) and exposure.shock:
        wet = dew_point_c(exposure.destination_ppmv, exposure.pressure_hpa) > exposure.source_c + DEW_MARGIN_K
        dryness = (100.0 - exposure.destination_percent) / 50.0
        cooling = (
            p["depression_k"]
            * wet
            * np.maximum(dryness, 0.0)
            * np.exp(-np.maximum(since_s, 0.0) / p["time_constant_s"])
        )
        reading = reading - cooling * (since_s > 0.0)
    if p := truth.effect("wall_radiation"):
        wall, bead = p["wall_temperature_c"] + ZERO_C_K, reading + ZERO_C_K
        rise = p["rise_k_at_10_k"] * (wall**4 - bead**4) / (4.0 * 293.15**3 * 10.0)
        reading = reading + rise * _stagnation(truth, exposure)
    return _common(truth, T, exposure, reading, since_s)


def _stagnation(truth: Truth, exposure: Exposure[Any]) -> np.ndarray:
    """How much less heat the air carries off than at 5 m/s."""
    return 1.0 / heat_carried_off(exposure.airflow_m_s, truth.bead_radius_m, exposure.pressure_hpa)


def humidity_reading(
    truth: Truth, exposure: Exposure[Any], bodies: Bodies[Any], air_c: Numbers, since_s: Numbers
) -> np.ndarray:
    """Reading of the film, %RH; arrays (n, r)."""
    e = exposure
    vapour = bodies.film_ppmv
    if p := truth.effect("slow_relaxation"):
        vapour = vapour + p["fraction"] * (bodies.slow_ppmv - vapour)
    at_c = bodies.die_c if truth.effect("die_thermal_lag") is not None else air_c
    if p := truth.effect("unknown_sorption_heat"):
        uptake_ppmv_s = (bodies.film_ppmv - bodies.warming_ppmv) / SORPTION_HEAT_S
        at_c = at_c + p["kelvin_s_per_percent"] * humidity_percent(uptake_ppmv_s, e.destination_c, e.pressure_hpa)
    reading = humidity_percent(vapour, at_c, e.pressure_hpa)
    if p := truth.effect("hysteresis"):
        change = np.tanh((reading - e.source_percent) / HYSTERESIS_WIDTH_PERCENT)
        reading = reading - exposure.shock * p["rh_percent"] * change
    if p := truth.effect("calibration_temperature"):
        reading = reading + p["percent_per_k"] * (bodies.die_c - 20.0)
    reading = _common(truth, RH, exposure, reading, since_s)
    if p := truth.effect("saturation_clipping"):
        reading = np.minimum(reading, p["limit_percent"])
    return reading


def _common(truth: Truth, channel: str, exposure: Exposure[Any], reading: np.ndarray, since_s: Numbers) -> np.ndarray:
    """What can befall the readout of either channel."""
    since = np.maximum(since_s, 0.0) * exposure.shock
    if p := truth.effect("unknown_log_creep", channel):
        e = exposure
        step = e.destination_c - e.source_c if channel == T else e.destination_percent - e.source_percent
        reading = reading + p["fraction"] * step * np.log1p(since / p["onset_s"])
    if p := truth.effect("unknown_gain_drift", channel):
        reading = reading * (1.0 + p["per_minute"] * since / 60.0)
    if p := truth.effect("unknown_run_drift", channel):
        reading = reading + p["per_run"] * exposure.order
    if p := truth.effect("calibration_error", channel):
        reading = reading * (1.0 + p["gain"]) + p["offset"]
    return reading
