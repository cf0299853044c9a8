"""The air at the probes after they leave one air for another: step, ramp, relaxation of room air, and air that does
not keep still.

Temperature and vapour (ppmv) of the air are functions of the time since the transfer began; before it both are the
source's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from shockrig.rig.virtual.physics.moist import Numbers, concentration_ppmv, humidity_percent
from shockrig.rig.virtual.truth import Truth

N = TypeVar("N", float, np.ndarray)
DIED_AWAY = 25.0  # time constants, after which an exponential is below the last digit that anybody reads


@dataclass(frozen=True)
class Exposure(Generic[N]):
    """What r runs expose the probes to; all arrays (r,), or numbers for one run.

    `duration_s` is the time the change takes. `unsettled_k` and `unsettled_ppmv` is how far the destination chamber
    still is from its set point at the start; it decays with `settling_s`. `shock` is False where the probes are only
    carried back, or wait in a chamber.
    """

    source_c: N
    source_ppmv: N
    destination_c: N
    destination_ppmv: N
    airflow_m_s: N
    pressure_hpa: N
    duration_s: N
    irradiance_w_m2: N
    order: N
    unsettled_k: np.ndarray | float = 0.0
    unsettled_ppmv: np.ndarray | float = 0.0
    settling_s: float = 1.0
    shock: bool = True

    @cached_property
    def source_percent(self) -> np.ndarray:
        """Relative humidity of the source air, %."""
        return humidity_percent(self.source_ppmv, self.source_c, self.pressure_hpa)

    @cached_property
    def destination_percent(self) -> np.ndarray:
        """Relative humidity of the destination air, %."""
        return humidity_percent(self.destination_ppmv, self.destination_c, self.pressure_hpa)


def air_after(truth: Truth, exposure: Exposure[Any], since_s: Numbers) -> tuple[np.ndarray, np.ndarray]:
    """Temperature (degC) and vapour (ppmv) of the air at the probes.

    `since_s`: time since the transfer began, (), (r,) or (n, r); negative is before it.
    """
    since = np.asarray(since_s, dtype=float)
    after = since >= 0.0
    t = np.where(after, since, 0.0)
    settling = np.exp(-t / exposure.settling_s)
    temperature = exposure.destination_c + exposure.unsettled_k * settling
    vapour = exposure.destination_ppmv + exposure.unsettled_ppmv * settling
    if exposure.shock:
        if p := truth.effect("air_relaxation"):
            share = p["fraction"] * np.exp(-t / p["time_constant_s"])
            room = concentration_ppmv(p["room_humidity_percent"], p["room_temperature_c"], exposure.pressure_hpa)
            temperature = temperature + share * (p["room_temperature_c"] - temperature)
            vapour = vapour + share * (room - vapour)
        if p := truth.effect("unknown_chamber_overshoot"):
            swing = p["fraction"] * np.exp(-t / p["decay_s"]) * np.sin(2.0 * np.pi * t / p["period_s"])
            temperature = temperature + swing * (exposure.destination_c - exposure.source_c)
            vapour = vapour + swing * (exposure.destination_ppmv - exposure.source_ppmv)
        if p := truth.effect("unknown_air_cycling"):
            temperature = temperature + p["amplitude_k"] * np.sin(2.0 * np.pi * t / p["period_s"])
    ramp = exposure.duration_s > 0.0
    arrived = np.where(ramp, np.clip(t / np.where(ramp, exposure.duration_s, 1.0), 0.0, 1.0), 1.0) * after
    return (
        exposure.source_c + arrived * (temperature - exposure.source_c),
        exposure.source_ppmv + arrived * (vapour - exposure.source_ppmv),
    )


def shortest_change_s(truth: Truth, exposure: Exposure[Any], since_s: float) -> float:
    """The shortest time constant with which the air changes of itself at `since_s` and later; infinity where it is
    steady but for the transfer.
    """
    changes = []  # time constant, and how long it lasts
    if np.any(exposure.unsettled_k) or np.any(exposure.unsettled_ppmv):
        changes.append((exposure.settling_s, DIED_AWAY * exposure.settling_s))
    if exposure.shock:
        if p := truth.effect("air_relaxation"):
            changes.append((p["time_constant_s"], DIED_AWAY * p["time_constant_s"]))
        if p := truth.effect("unknown_chamber_overshoot"):
            changes.append((min(p["decay_s"], p["period_s"] / (2.0 * np.pi)), DIED_AWAY * p["decay_s"]))
        if p := truth.effect("unknown_air_cycling"):
            changes.append((p["period_s"] / (2.0 * np.pi), np.inf))
    return min((constant_s for constant_s, lasts_s in changes if since_s < lasts_s), default=np.inf)
