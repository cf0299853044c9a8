"""How strong effects are in real sensors: one range for each, with its source; for trials at realistic strengths.

Where nobody has published a figure the range is an estimate, and says so. What cannot act in a plan is not here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.virtual.effects import KINDS, RH, T


@dataclass(frozen=True)
class Real:
    """The range of one parameter that is an effect's strength, the values of its others, and where they come from.

    `signed`: either sign. `inverse`: the larger the number, the weaker the effect.
    """

    strength: str
    low: float
    high: float
    source: str
    others: tuple[tuple[str, float, float], ...] = ()
    signed: bool = False
    inverse: bool = False


CALCULATED = "calculated for a bead of 0.8 mm, Ranz and Marshall 1952"
DATA_SHEET = "data sheets: HYT-271 1.8 %RH, iMet-XF 0.3 K"
ESTIMATE = "an estimate: no published figure"
ROOM_RANGES = (("room_temperature_c", 18.0, 28.0), ("room_humidity_percent", 30.0, 60.0))
REAL_SENSORS: dict[tuple[str, str], Real] = {
    ("convective_film", T): Real("biot_at_5_m_s", 0.09, 0.18, CALCULATED, inverse=True),
    ("self_heating", T): Real("rise_k_at_5_m_s", 0.04, 0.085, "excitation of the bead's data sheet over h A"),
    ("radiative_heating", T): Real("kelvin_per_w_m2_at_5_m_s", 9e-5, 1.3e-4, "0.11 K in 1000 W/m2, aspirated"),
    ("wall_radiation", T): Real(
        "rise_k_at_10_k", 0.07, 0.15, "4 emissivity sigma T^3 / h at 5 m/s", (("wall_temperature_c", 18.0, 26.0),)
    ),
    ("evaporative_cooling", T): Real(
        "depression_k",
        0.16,
        0.46,
        "a wet thermistor below its bath, for less than 50 s",
        (("time_constant_s", 10, 50),),
    ),
    ("stem_conduction", T): Real("fraction", 0.005, 0.03, ESTIMATE, (("time_constant_s", 5.0, 15.0),)),
    ("vapour_boundary_layer", RH): Real("biot_at_5_m_s", 18.0, 1900.0, "open die, calculated", inverse=True),
    ("series_lag", RH): Real("time_constant_s", 1.0, 6.0, "filter caps: t63 from 4 s without to some 10 s with one"),
    ("slow_relaxation", RH): Real(
        "fraction", 0.01, 0.1, "RS41 needs two time constants (doi 10.1002/met.70097)", (("time_constant_s", 15, 40),)
    ),
    ("direction_dependent_diffusivity", RH): Real(
        "ratio_drying_to_wetting", 1.02, 1.2, "RS41: sorption and desorption apart (doi 10.1002/met.70097)"
    ),
    ("concentration_dependent_diffusivity", RH): Real("slope_per_unit_activity", 0.05, 0.5, ESTIMATE, signed=True),
    ("hysteresis", RH): Real("rh_percent", 0.2, 1.0, "data sheet: below 1 %RH"),
    ("calibration_temperature", RH): Real("percent_per_k", 0.02, 0.05, "data sheets: 0.05 %RH/K", signed=True),
    ("calibration_error", T): Real("offset", 0.05, 0.3, DATA_SHEET, (("gain", 0.0, 0.003),), signed=True),
    ("calibration_error", RH): Real("offset", 0.3, 1.8, DATA_SHEET, (("gain", 0.0, 0.01),), signed=True),
    ("finite_transfer", T): Real("duration_s", 0.1, 0.6, "0.3 m at 0.5 to 3 m/s"),
    ("air_relaxation", T): Real("fraction", 0.005, 0.05, ESTIMATE, (("time_constant_s", 3.0, 15.0), *ROOM_RANGES)),
    ("dead_time", T): Real("delay_s", 0.07, 0.2, "conversion and polling in autopilots' firmware"),
    ("dead_time", RH): Real("delay_s", 0.07, 0.2, "conversion and polling in autopilots' firmware"),
    ("clock_drift", T): Real("ppm", 20.0, 100.0, "quartz and ceramic resonators"),
    ("clock_drift", RH): Real("ppm", 20.0, 100.0, "quartz and ceramic resonators"),
    ("quantization", T): Real("step", 0.02, 0.1, "logs of drones and balloons"),
    ("quantization", RH): Real("step", 0.1, 1.0, "logs of drones and balloons"),
    ("stale_samples", RH): Real("hold_samples", 2.0, 3.0, "iMet-XQ2 flights repeat 17 to 19 % of humidities"),
    ("condensation", RH): Real("drying_time_s", 2.0, 12.0, ESTIMATE),
}
WHOLE = {"hold_samples"}
WITHOUT_STRENGTH = ("die_thermal_lag",)


def real(effect: str, channel: str | None = None) -> Real:
    """The entry of an effect, of the first channel that has one where none is named.

    Raises BenchError where real sensors do not show it in a campaign: a logger's average of 62.5 ms lies within one
    reading at 10 Hz, and no plan reaches 100 %RH, where readings stop.
    """
    for (name, of), entry in REAL_SENSORS.items():
        if name == effect and channel in (None, of):
            return entry
    # What acts in the air reaches both channels.
    shared = [entry for (name, _), entry in REAL_SENSORS.items() if name == effect and len(KINDS[effect].channels) > 1]
    if shared:
        return shared[0]
    raise BenchError(f"effect {effect} has no realistic strength: it is known of {', '.join(sorted(drawable()))}")


def drawable() -> tuple[str, ...]:
    """Effects that can be drawn at realistic strengths."""
    return (*dict.fromkeys(name for name, _ in REAL_SENSORS), *WITHOUT_STRENGTH)


def draw_real(rng: np.random.Generator, effect: str, channel: str | None = None, size: float = 1.0) -> dict[str, float]:
    """Parameters of an effect at a strength drawn evenly in its logarithm from what is real, times `size`."""
    if effect in WITHOUT_STRENGTH:
        return {}
    entry = real(effect, channel)
    others = {name: float(rng.uniform(low, high)) for name, low, high in entry.others}
    strength = float(np.exp(rng.uniform(np.log(entry.low), np.log(entry.high))))
    sign = float(rng.choice((-1.0, 1.0))) if entry.signed else 1.0
    if entry.strength.startswith("ratio"):
        strength = strength**size
    else:
        strength = sign * (strength / size if entry.inverse else strength * size)
    if entry.strength in WHOLE:
        strength = float(max(2, round(strength)))
    if "gain" in others:
        others["gain"] *= sign * size
    return {entry.strength: strength, **others}
