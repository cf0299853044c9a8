"""What each quantity can be, in one table: the reader, the import, bench and protocol files and the command line ask
here.

The ranges are wide enough for any chamber, any sensor and any aircraft that a user of this project has: what lies
outside is a slip of the pen or of the unit, not a measurement. What one instrument can say stands with its driver.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Range:
    """From `low` to `high`, both included, in the unit that the quantity's name carries.

    `slip` is what a value outside most likely is, as the end of a sentence; empty where nothing is likely, as it is for
    values above `slip_to`.
    """

    low: float
    high: float
    slip: str = ""
    slip_to: float = math.inf

    def holds(self, value: float) -> bool:
        """Whether a value can be; never where it is NaN."""
        return self.low <= value <= self.high

    def farthest(self, value: float) -> float:
        """How far a value is from the farther end: nothing that can be is farther away."""
        return max(value - self.low, self.high - value)

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}"

    def refusal(self, value: float) -> str:
        """The middle of a message: what came, what can be, and what the slip may be."""
        slip = self.slip if value <= self.slip_to else ""
        return f"{value:g} cannot be; expected {self}{f' ({slip}?)' if slip else ''}"


_KELVIN, _MILLIMETRES, _FRACTION = "is it in kelvin or fahrenheit", "is it in millimetres", "is it in another unit"
RANGES: Mapping[str, Range] = MappingProxyType(
    {
        # of an air, a sensor's body or its die
        "temperature_c": Range(-100.0, 150.0, _KELVIN, 150.0 + 273.15),
        # as thermometers read it that are no air's, in an oven or in liquid nitrogen: of thermocouples, types K and B
        # (IEC 60584-1)
        "temperature_reading_c": Range(-270.0, 1820.0, _KELVIN),
        # of an air, as instruments report it: a little below 0, and above 100 where it is supersaturated or they err
        "humidity_percent": Range(-5.0, 130.0, _FRACTION),
        # as a polymer film reads it: one that is cold or condensed on reads further out than any air is
        "humidity_reading_percent": Range(-10.0, 130.0, _FRACTION),
        # of an air itself: a set point, a simulation, a corrected value
        "humidity_set_percent": Range(0.0, 100.0, _FRACTION),
        "airflow_m_s": Range(0.0, 150.0, "is it in km/h"),
        "pressure_hpa": Range(1.0, 2000.0, "is it in pascal"),
        "irradiance_w_m2": Range(0.0, 3000.0, "is it in lux"),
        "bead_radius_m": Range(1e-6, 0.03, _MILLIMETRES),
        "film_thickness_m": Range(1e-9, 0.003, "is it in millimetres or micrometres"),
        "time_s": Range(-1e7, 1e7, "is it in milliseconds, or since 1970"),  # on a run's own clock
        "transfer_s": Range(0.0, 3600.0, "is it in milliseconds"),
        # of a protocol: how long a step takes, and how still things must be by then
        "step_s": Range(0.0, 86400.0),
        "tolerance_k": Range(0.0, 50.0),
        "tolerance_percent": Range(0.0, 100.0),
        "rate_hz": Range(0.01, 1000.0),  # at which a sensor is read
        # of a profile: a rate as it was fitted, effective or not, the readings' noise, and how often they come
        "fitted_m2_s": Range(1e-25, 1.0, _FRACTION),
        "noise_k": Range(0.0, 50.0),
        "noise_percent": Range(0.0, 100.0),
        "sampling_period_s": Range(1e-4, 86400.0, "is it in milliseconds"),
        # of the instrument that measures the airs
        "reference_time_constant_s": Range(0.0, 3600.0, "is it in milliseconds"),
        "reference_uncertainty_k": Range(0.0, 50.0),
        "reference_uncertainty_percent": Range(0.0, 50.0),
        # standard uncertainties of what all runs of a campaign share
        "common_air_temperature_k": Range(0.0, 50.0),
        "common_air_humidity_percent": Range(0.0, 50.0),
        "common_airflow_percent": Range(0.0, 100.0),
        "common_pressure_hpa": Range(0.0, 500.0, "is it in pascal"),
        "common_trigger_offset_s": Range(0.0, 60.0, "is it in milliseconds"),
        "common_clock_ppm": Range(0.0, 1e5),
    }
)

# What a flight's log and a profile are likely to hold. What lies outside is missing, or said, and not refused.
LIKELY_RANGES: Mapping[str, Range] = MappingProxyType(
    {
        "altitude_m": Range(-12e3, 60e3, "is it in feet"),  # of a sensor in the sea, or under a balloon
        "latitude_deg": Range(-90.0, 90.0, "is it in degrees and minutes"),
        "longitude_deg": Range(-360.0, 360.0, "is it in degrees and minutes"),
        # how far an air goes and comes back between rows, in doors and plumes
        "swing_k": Range(0.0, 15.0),
        "swing_percent": Range(0.0, 50.0),
        # time to 63 %: from a bare wire in a jet to a housing in still air
        "response_s": Range(0.005, 1800.0, "is it in milliseconds"),
        # by which D rises with temperature: of water in polymers 10 to 60 kJ/mol (Crank and Park 1968, Diffusion in
        # Polymers); of IST's capacitive film up to 75 by its response times; behind an air film nearly none
        "activation_j_mol": Range(-5e3, 1e5),
    }
)

# What is known of materials. An effective diffusivity (of a housing, behind an air film, or with a length that was
# guessed) may lie outside and is no error: it is said.
MATERIALS: Mapping[str, Range] = MappingProxyType(
    {
        # of solids: from polymers, 1e-7, to diamond, 1.2e-3 (Carslaw and Jaeger 1959, appendix VI); a factor ten less,
        # because a bead's is seldom its glass's alone
        "thermal_diffusivity_m2_s": Range(1e-8, 2e-3, "is the bead's radius in metres"),
        # of water vapour: from dense polymers (Crank 1975, The Mathematics of Diffusion, chapter 11) to free air,
        # 2.5e-5 at 20 degC (Massman 1998, doi 10.1016/S1352-2310(97)00391-9)
        "diffusivity_m2_s": Range(1e-17, 3e-5, "is the film's thickness in metres"),
    }
)
