"""What the runs of a channel were, and the exchange between their air and a small body: how the coefficients follow
airflow, pressure and temperature of the air.

Heat (sphere): h = k F / 2R, F = 2 + 0.6 Re^1/2 Pr^1/3, Re = 2 R v rho / mu (Ranz and Marshall 1952). Vapour (open
film): h_m ~ D_v (v / nu)^1/2 Sc^1/3, and D_v, nu ~ 1 / pressure, so h_m ~ (v / pressure)^1/2.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.physics.humidity import STANDARD_PRESSURE_HPA, ZERO_CELSIUS_K, dew_point_c


@dataclass(frozen=True)
class Conditions:
    """What each run was: arrays of shape (R,), SI or degC as named; `*_scatter` are one sigma of what is known.

    `duration_s` is NaN where the transfer was not timed. Where all runs state it, `ramp_ratio` is each run's in units
    of the typical one. `ramp_own_s` is the duration of those that alone state one, or state a far longer one (slowed on
    purpose), and NaN elsewhere: the plain model has these ramps.
    `airs_known` is of the channel's own quantity; `humidity_known` is false where the airs' humidity is the usual one.
    `elsewhere` marks runs that respond so much faster or slower than the rest that they end in another medium.
    `order` is each run's place in the campaign, from 0; `hours` is when it began, NaN where nobody wrote that down.
    """

    source_c: Array
    destination_c: Array
    source_percent: Array
    destination_percent: Array
    airflow_m_s: Array
    pressure_hpa: Array
    start_s: Array
    start_scatter_s: Array
    source_c_scatter: Array
    destination_c_scatter: Array
    source_percent_scatter: Array
    destination_percent_scatter: Array
    airflow_known: NDArray[np.bool_]
    start_known: NDArray[np.bool_]
    airs_known: NDArray[np.bool_]
    humidity_known: NDArray[np.bool_]
    irradiance_w_m2: Array
    duration_s: Array
    ramp_ratio: Array
    ramp_own_s: Array
    elsewhere: NDArray[np.bool_]
    order: Array
    hours: Array

    def select(self, index: NDArray[np.int64]) -> Conditions:
        """The same for the runs `index` alone."""
        return Conditions(**{field.name: getattr(self, field.name)[index] for field in fields(self)})

    @property
    def thermal_step_k(self) -> Array:
        """Change of the air's temperature in each run (R,) [K]."""
        return self.destination_c - self.source_c

    def ramps_s(self, usual_s: Array) -> Array:
        """How long each run's air takes to change (B, R) [s], where that of a usual run takes `usual_s` (B, 1)."""
        return np.where(np.isfinite(self.ramp_own_s), self.ramp_own_s, usual_s * self.ramp_ratio)


Array = NDArray[np.float64]

KINEMATIC_VISCOSITY_M2_S = 1.5e-5  # dry air at 20 degC and 1013 hPa
PRANDTL = 0.71
REFERENCE_AIRFLOW_M_S = 5.0  # at which Biot numbers and warmings are stated, at 1013.25 hPa and 20 degC
REFERENCE_C = 20.0
LEAST_AIRFLOW_M_S = 0.05  # of a boundary layer, which no flow at all would make endless


@dataclass(frozen=True)
class Stream:
    """The air that flows past a body: arrays of one shape, or numbers that hold for all."""

    airflow_m_s: Array
    pressure_hpa: Array = field(default_factory=lambda: np.array(STANDARD_PRESSURE_HPA))
    temperature_c: Array = field(default_factory=lambda: np.array(REFERENCE_C))

    @classmethod
    def of_runs(cls, conditions: Conditions) -> Stream:
        """The destination air of each run (R,)."""
        return cls(conditions.airflow_m_s, conditions.pressure_hpa, conditions.destination_c)

    def at(self, airflow_m_s: float) -> Stream:
        """The same air at another airflow."""
        return Stream(np.array(airflow_m_s), self.pressure_hpa, self.temperature_c)

    @property
    def density(self) -> Array:
        """Of air at this pressure and the reference temperature, relative to that at 1013.25 hPa."""
        return np.asarray(self.pressure_hpa / STANDARD_PRESSURE_HPA)


DEW_FALLS_K = 0.5  # margin from which on dew falls for certain


def dew_margin_k(conditions: Conditions) -> Array:
    """How far the destination's dew point lies above the air that each run (R,) comes from; 0 where no dew falls, or
    nobody knows."""
    c = conditions
    margin = np.maximum(dew_point_c(np.maximum(c.destination_percent, 1.0), c.destination_c) - c.source_c, 0.0)
    return np.asarray(np.where(c.humidity_known, margin, 0.0))


REFERENCE = Stream(np.array(REFERENCE_AIRFLOW_M_S))


def ventilation(stream: Stream, radius_m: float) -> Array:
    """Nusselt number F = 2 + 0.6 Re^1/2 Pr^1/3 of a sphere (Ranz and Marshall 1952), at the air's own density."""
    reynolds = np.maximum(stream.airflow_m_s, 0.0) * 2 * radius_m / KINEMATIC_VISCOSITY_M2_S * stream.density
    return np.asarray(2.0 + 0.6 * np.sqrt(reynolds) * PRANDTL ** (1 / 3))


def ventilation_ratio(stream: Stream, radius_m: float) -> Array:
    """Heat exchange relative to that at 5 m/s and 1013.25 hPa: 0.86 at 700 hPa for a bead of 0.8 mm."""
    return ventilation(stream, radius_m) / ventilation(REFERENCE, radius_m)


def vapour_ratio(stream: Stream) -> Array:
    """Vapour exchange through a laminar boundary layer relative to that at 5 m/s and 1013.25 hPa: 1.20 at 700 hPa."""
    airflow = np.maximum(stream.airflow_m_s, LEAST_AIRFLOW_M_S)
    return np.asarray(np.sqrt(airflow / REFERENCE_AIRFLOW_M_S / stream.density))


def conductivity_ratio(temperature_c: Array) -> Array:
    """Thermal conductivity of air relative to that at 20 degC (U.S. Standard Atmosphere 1976, Eq. 53)."""

    def conductivity(kelvin: Any) -> Any:
        return kelvin**1.5 / (kelvin + 245.4 * 10.0 ** (-12.0 / kelvin))

    kelvin = np.asarray(temperature_c) + ZERO_CELSIUS_K
    return np.asarray(conductivity(kelvin) / conductivity(REFERENCE_C + ZERO_CELSIUS_K))


def viscosity_ratio(temperature_c: Array) -> Array:
    """Kinematic viscosity of air at one pressure relative to that at 20 degC (Sutherland: mu ~ T^1.5 / (T + 110.4))."""

    def viscosity(kelvin: Any) -> Any:
        return kelvin**2.5 / (kelvin + 110.4)

    kelvin = np.asarray(temperature_c) + ZERO_CELSIUS_K
    return np.asarray(viscosity(kelvin) / viscosity(REFERENCE_C + ZERO_CELSIUS_K))


def temperature_ratio(stream: Stream, radius_m: float) -> Array:
    """Heat exchange at the air's own temperature relative to that at 20 degC, at the same airflow and pressure."""
    slower = Stream(stream.airflow_m_s / viscosity_ratio(stream.temperature_c), stream.pressure_hpa)
    return conductivity_ratio(stream.temperature_c) * ventilation(slower, radius_m) / ventilation(stream, radius_m)
