"""Moist air and exchange: McRae's saturation pressure (1980, doi 10.1080/00022470.1980.10464362), ppmv, Ranz-Marshall
(1952).

c = 1e4 H Ps(T) / Pa ;  Ps = 1013.25 exp(13.3185 t - 1.9760 t^2 - 0.6445 t^3 - 0.1299 t^4), t = 1 - 373.15 / T ;
F = 2 + 0.6 Re^(1/2) Pr^(1/3), Re = v 2R / nu.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Numbers = float | NDArray[np.float64]
ZERO_C_K = 273.15
KINEMATIC_VISCOSITY_M2_S = 1.5e-5  # dry air at 20 degC and 1013 hPa
PRANDTL = 0.71


def saturation_pressure_hpa(temperature_c: Numbers) -> np.ndarray:
    """Saturation vapour pressure over water, hPa, at `temperature_c` (any shape)."""
    t = 1.0 - 373.15 / (np.asarray(temperature_c) + ZERO_C_K)
    return 1013.25 * np.exp(t * (13.3185 + t * (-1.9760 + t * (-0.6445 - 0.1299 * t))))


def concentration_ppmv(humidity_percent: Numbers, temperature_c: Numbers, pressure_hpa: Numbers) -> np.ndarray:
    """Volume mixing ratio of vapour, ppmv."""
    return 1e4 * humidity_percent * saturation_pressure_hpa(temperature_c) / pressure_hpa


def humidity_percent(ppmv: Numbers, temperature_c: Numbers, pressure_hpa: Numbers) -> np.ndarray:
    """Relative humidity, %, of a mixing ratio in ppmv at `temperature_c`."""
    return ppmv * pressure_hpa / (1e4 * saturation_pressure_hpa(temperature_c))


def dew_point_c(ppmv: Numbers, pressure_hpa: Numbers) -> np.ndarray:
    """Temperature at which a mixing ratio in ppmv is saturated, degC, from -45 to 95 degC, by interpolation to 1 mK."""
    grid = np.linspace(-45.0, 95.0, 2801)
    return np.interp(np.log(np.maximum(ppmv * pressure_hpa, 1e-6)), np.log(concentration_ppmv(100.0, grid, 1.0)), grid)


def ventilation(
    airflow_m_s: Numbers, radius_m: float, viscosity_m2_s: Numbers = KINEMATIC_VISCOSITY_M2_S
) -> np.ndarray:
    """Nusselt number F of a sphere (Ranz and Marshall 1952), dimensionless."""
    reynolds = airflow_m_s * 2.0 * radius_m / viscosity_m2_s
    return 2.0 + 0.6 * np.sqrt(reynolds) * PRANDTL ** (1.0 / 3.0)


def heat_carried_off(airflow_m_s: Numbers, radius_m: float, pressure_hpa: Numbers) -> np.ndarray:
    """Heat that a sphere gives to air, relative to air of 5 m/s at 1013.25 hPa: thin air carries off less."""
    viscosity = KINEMATIC_VISCOSITY_M2_S * 1013.25 / pressure_hpa
    return ventilation(airflow_m_s, radius_m, viscosity) / ventilation(5.0, radius_m)


def warm_air(temperature_c: Numbers, airflow_m_s: Numbers, radius_m: float, pressure_hpa: Numbers) -> np.ndarray:
    """Heat that a sphere gives to air at its own temperature, relative to the same stream at 20 degC.

    Conductivity as (T / 300 K)^0.8646; viscosity by White's constants of Sutherland's law, 1.716e-5 Pa s at 0 degC.
    """

    def viscosity(at_c: Numbers) -> np.ndarray:
        kelvin = np.asarray(at_c) + ZERO_C_K
        dynamic = 1.716e-5 * (kelvin / ZERO_C_K) ** 1.5 * (ZERO_C_K + 110.4) / (kelvin + 110.4)
        return np.asarray(dynamic * 287.05 * kelvin / (100.0 * np.asarray(pressure_hpa)))

    conductivity = ((np.asarray(temperature_c) + ZERO_C_K) / (20.0 + ZERO_C_K)) ** 0.8646
    own, usual = (ventilation(airflow_m_s, radius_m, viscosity(at_c)) for at_c in (temperature_c, 20.0))
    return np.asarray(conductivity * own / usual)
