"""The effects that the virtual world can hide: id, link of the chain, channels in which they can be seen, parameters.

Ids without prefix have a name that a diagnosis may give. Those prefixed `unknown_` have none: the right verdict on
them is `unexplained`.
The equations are in physics/ (exposure.py, probes.py, converters.py) and, for the logger's, in logger_link.py.
"""

from __future__ import annotations

from dataclasses import dataclass

T, RH = "temperature", "humidity"
AIR = "air"  # the link that all probes of a bench share


@dataclass(frozen=True)
class Kind:
    """One kind of effect. `single`: a fault of one channel's own electronics, hidden in one channel at a time."""

    link: str
    channels: tuple[str, ...]
    parameters: tuple[str, ...]
    single: bool = False


KINDS: dict[str, Kind] = {
    "finite_transfer": Kind(AIR, (T, RH), ("duration_s",)),
    "air_relaxation": Kind(
        AIR, (T, RH), ("fraction", "time_constant_s", "room_temperature_c", "room_humidity_percent")
    ),
    "convective_film": Kind("exchange", (T,), ("biot_at_5_m_s",)),
    "vapour_boundary_layer": Kind("exchange", (RH,), ("biot_at_5_m_s",)),
    "direction_dependent_diffusivity": Kind("body", (RH,), ("ratio_drying_to_wetting",)),
    "concentration_dependent_diffusivity": Kind("body", (RH,), ("slope_per_unit_activity",)),
    "slow_relaxation": Kind("body", (RH,), ("fraction", "time_constant_s")),
    "stem_conduction": Kind("body", (T,), ("fraction", "time_constant_s")),
    "self_heating": Kind("readout", (T,), ("rise_k_at_5_m_s",)),
    "die_thermal_lag": Kind("readout", (RH,), ()),
    "hysteresis": Kind("readout", (RH,), ("rh_percent",)),
    "calibration_error": Kind("readout", (T, RH), ("gain", "offset"), single=True),
    "saturation_clipping": Kind("readout", (RH,), ("limit_percent",)),
    "dead_time": Kind("logger", (T, RH), ("delay_s",), single=True),
    "moving_average": Kind("logger", (T, RH), ("samples",), single=True),
    "stale_samples": Kind("logger", (RH,), ("hold_samples",)),
    "quantization": Kind("logger", (T, RH), ("step",), single=True),
    # as those above, and in EXTRA below: blind trials drew before they were there
    "radiative_heating": Kind("readout", (T,), ("kelvin_per_w_m2_at_5_m_s",)),
    "evaporative_cooling": Kind("readout", (T,), ("depression_k", "time_constant_s")),
    "clock_drift": Kind("logger", (T, RH), ("ppm",), single=True),
    "condensation": Kind("exchange", (RH,), ("drying_time_s",)),
    "exchange_temperature": Kind("exchange", (T,), ()),
    "wall_radiation": Kind("readout", (T,), ("rise_k_at_10_k", "wall_temperature_c")),
    "calibration_temperature": Kind("readout", (RH,), ("percent_per_k",)),
    "series_lag": Kind("exchange", (RH,), ("time_constant_s",)),
    # from outside any catalogue
    "unknown_air_cycling": Kind(AIR, (T, RH), ("amplitude_k", "period_s")),
    "unknown_chamber_overshoot": Kind(AIR, (T, RH), ("fraction", "decay_s", "period_s")),
    "unknown_rate_with_temperature": Kind("body", (T,), ("per_kelvin",)),
    "unknown_log_creep": Kind("readout", (T, RH), ("fraction", "onset_s"), single=True),
    "unknown_sorption_heat": Kind("readout", (RH,), ("kelvin_s_per_percent",)),
    "unknown_run_drift": Kind("readout", (T, RH), ("per_run",), single=True),
    "unknown_gain_drift": Kind("readout", (T, RH), ("per_minute",), single=True),
    "unknown_interference": Kind("logger", (T, RH), ("amplitude", "hum_hz", "burst_share"), single=True),
}
EXTRA = (
    *("radiative_heating", "evaporative_cooling", "clock_drift", "condensation"),
    *("exchange_temperature", "wall_radiation", "calibration_temperature", "series_lag"),
)
OUTSIDE = tuple(name for name in KINDS if name.startswith("unknown_"))
CATALOGUED = tuple(name for name in KINDS if name not in OUTSIDE and name not in EXTRA)
