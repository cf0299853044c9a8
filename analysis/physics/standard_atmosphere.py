"""Altitude by pressure in the standard atmosphere (ISO 2533:1975), from the ground to 32 km."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shockrig.analysis.physics.humidity import STANDARD_PRESSURE_HPA

GRAVITY_M_S2 = 9.80665
GRADIENT_K = GRAVITY_M_S2 / 287.05287  # by R of dry air [K/m]: a change of temperature at this rate is of even density
# Bottom of each layer [m], temperature there [K] and its change with altitude [K/m].
LAYERS = ((0.0, 288.15, -0.0065), (11_000.0, 216.65, 0.0), (20_000.0, 216.65, 0.001))


def pressure_altitude_m(pressure_hpa: ArrayLike) -> NDArray[np.float64]:
    """Geopotential altitude [m] at which the standard atmosphere has a pressure [hPa], of any shape."""
    pressure = np.asarray(pressure_hpa, dtype=float)
    bottom_hpa = STANDARD_PRESSURE_HPA
    found = np.full(pressure.shape, np.nan)
    for k, (bottom_m, bottom_k, lapse) in enumerate(LAYERS):
        here = pressure <= bottom_hpa if k else np.isfinite(pressure)
        ratio = np.where(pressure > 0.0, pressure, np.nan)[here] / bottom_hpa
        if lapse:
            found[here] = bottom_m + bottom_k / lapse * (ratio ** (-lapse / GRADIENT_K) - 1.0)
        else:
            found[here] = bottom_m - bottom_k / GRADIENT_K * np.log(ratio)
        if k + 1 < len(LAYERS):
            thick = LAYERS[k + 1][0] - bottom_m
            bottom_hpa *= (
                (1.0 + lapse * thick / bottom_k) ** (-GRADIENT_K / lapse)
                if lapse
                else float(np.exp(-GRADIENT_K * thick / bottom_k))
            )
    return found
