"""Saturation vapour pressure (McRae 1980, as quoted by Segales et al. 2022, doi 10.5194/amt-15-2607-2022) and RH <->
ppmv."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

ZERO_CELSIUS_K = 273.15
STANDARD_PRESSURE_HPA = 1013.25


def saturation_pressure_hpa(temperature_c: ArrayLike) -> NDArray[np.float64]:
    """Saturation vapour pressure over liquid water.

    Parameters
    ----------
    temperature_c : array_like, any shape
        Temperature [degC]; within 0.22 % of Murphy and Koop (2005) from -45 to 50 degC.

    Returns
    -------
    ndarray, same shape
        Pressure [hPa]: 1013.25 exp(13.3185 t - 1.9760 t^2 - 0.6445 t^3 - 0.1299 t^4), t = 1 - 373.15 K / T.
    """
    t = 1.0 - 373.15 / (np.asarray(temperature_c, dtype=float) + ZERO_CELSIUS_K)
    return STANDARD_PRESSURE_HPA * np.exp(t * (13.3185 + t * (-1.9760 + t * (-0.6445 - 0.1299 * t))))


def saturation_slope(temperature_c: ArrayLike) -> NDArray[np.float64]:
    """Relative change d ln P_s / dT [1/K] of the saturation pressure, over the kelvin around `temperature_c` [degC]."""
    temperature = np.asarray(temperature_c, dtype=float)
    above, below = (saturation_pressure_hpa(temperature + half) for half in (0.5, -0.5))
    return np.asarray(np.log(above) - np.log(below))


def ppmv_from_humidity(
    humidity_percent: ArrayLike, temperature_c: ArrayLike, pressure_hpa: ArrayLike = STANDARD_PRESSURE_HPA
) -> NDArray[np.float64]:
    """Water vapour concentration c = 1e4 H P_s(T) / P_a [ppmv] of air at `humidity_percent` (arrays broadcast)."""
    humidity, pressure = np.asarray(humidity_percent, dtype=float), np.asarray(pressure_hpa, dtype=float)
    return 1e4 * humidity * saturation_pressure_hpa(temperature_c) / pressure


def humidity_from_ppmv(
    ppmv: ArrayLike, temperature_c: ArrayLike, pressure_hpa: ArrayLike = STANDARD_PRESSURE_HPA
) -> NDArray[np.float64]:
    """Relative humidity H = c P_a / (1e4 P_s(T)) [%] of air that holds `ppmv` (arrays broadcast)."""
    vapour, pressure = np.asarray(ppmv, dtype=float), np.asarray(pressure_hpa, dtype=float)
    return vapour * pressure / (1e4 * saturation_pressure_hpa(temperature_c))


def dew_point_c(humidity_percent: ArrayLike, temperature_c: ArrayLike) -> NDArray[np.float64]:
    """Dew point [degC] by Newton steps on the same saturation formula, so that it is exactly its inverse."""
    temperature = np.asarray(temperature_c, dtype=float)
    target = np.log(np.asarray(humidity_percent, dtype=float) / 100.0 * saturation_pressure_hpa(temperature))
    dew = np.array(np.broadcast_to(temperature, np.broadcast_shapes(temperature.shape, target.shape)), dtype=float)
    for _ in range(8):
        value = np.log(saturation_pressure_hpa(dew))
        slope = (np.log(saturation_pressure_hpa(dew + 1e-3)) - value) / 1e-3
        dew = dew - (value - target) / slope
    return dew
