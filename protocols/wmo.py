"""A corrected flight put into the format of WMO's drone demonstration campaign: units, mixing ratio, dew point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.physics.humidity import dew_point_c, saturation_pressure_hpa
from shockrig.files.errors import InputError
from shockrig.files.flight import Corrected, Flight, read_layout
from shockrig.files.flight_wmo import write_wmo

Array = NDArray[np.float64]
LARGEST_DEGREES = {"lat": 90.0, "lon": 360.0}
# of a1 (in units of geophysics), b1 (checked) and c1 (derived from other variables): values are those of the air, with
# an uncertainty, derived from readings, profile and position
PROCESSING_LEVEL = "c1"
EPSILON = 0.62198  # molar masses of water and dry air
DRIEST_PERCENT = 0.1  # below, a dew point says nothing


class WmoFlight:
    """Gathers a flight block by block; `write` makes its one file."""

    def __init__(self, operator: str, airframe: str, written_at: datetime) -> None:
        self.operator, self.airframe, self.written_at = operator, airframe, written_at
        self._blocks: list[dict[str, Array]] = []

    def add(self, flight: Flight, found: Corrected) -> None:
        """Add a block.

        Raises
        ------
        InputError
            The log does not say where the drone was.
        """
        where = {"lat": flight.latitude_deg, "lon": flight.longitude_deg, "altitude": flight.altitude_m}
        lacking = [name for name, values in where.items() if values is None or not np.isfinite(values).any()]
        names = {"lat": "latitude", "lon": "longitude", "altitude": "altitude"}
        if lacking and not self._blocks:
            raise _no_position([names[n] for n in lacking])
        for name, most in LARGEST_DEGREES.items():
            values = where[name]
            if values is not None and np.isfinite(values).any() and np.nanmedian(np.abs(values)) > most:
                raise InputError(
                    f"--wmo: {names[name]} {np.nanmedian(values):.7g}: expected decimal degrees, within {most:g} "
                    "(as a GPS receiver writes it, 4032.06 is 40 degrees 32.06 minutes)"
                )
        nothing = np.full(flight.time_s.shape, np.nan)
        pressure = nothing if flight.pressure_hpa is None else _bridged(flight.time_s, flight.pressure_hpa)
        self._blocks.append(
            {"time": flight.time_s}
            | {name: nothing if v is None else _bridged(flight.time_s, v) for name, v in where.items()}
            | moist_air(found, pressure)
        )

    def write(self, folder: Path, source: str) -> Path:
        """Write the file into a folder; its path."""
        columns = {name: np.concatenate([b[name] for b in self._blocks]) for name in self._blocks[0]}
        attributes = {
            "title": f"Flight {Path(source).stem} of airframe {self.airframe}, corrected for sensor lag",
            "platform_name": self.airframe,
            "flight_id": Path(source).stem,
            "site_terrain_elevation_height": _elevation(columns["altitude"]),
            "processing_level": PROCESSING_LEVEL,
            "source": f"thermo-hygrometer log {Path(source).name}",
            "history": f"{self.written_at:%Y-%m-%dT%H:%M:%SZ} shockrig correct {Path(source).name}",
        }
        return write_wmo(folder, self.operator, self.airframe, columns, attributes)


def _elevation(altitude_m: Array) -> str:
    """Of the site: the first altitude that the log has, where the drone stood."""
    known = altitude_m[np.isfinite(altitude_m)]
    return f"{known[0]:.0f}m" if known.size else "not applicable"


def demand_position(log: Path, columns: Mapping[str, str] | None = None) -> None:
    """Look for columns of position before anything is computed.

    Raises
    ------
    InputError
        The log has no column of latitude, longitude or altitude.
    """
    place = read_layout(log, columns).place
    if lacking := [name for name in ("latitude", "longitude", "altitude") if name not in place]:
        raise _no_position(lacking)


def _no_position(lacking: Sequence[str]) -> InputError:
    return InputError(f"--wmo: the log has no {', '.join(lacking)}; name the columns (--column {lacking[0]}=NAME)")


def moist_air(found: Corrected, pressure_hpa: Array) -> dict[str, Array]:
    """Corrected columns in the format's units: w = 0.62198 e / (p - e), e = RH P_s(T)."""
    temperature, humidity = found.temperature_c, found.humidity_percent
    vapour = 0.01 * humidity * saturation_pressure_hpa(temperature)
    with np.errstate(invalid="ignore"):
        dew = np.where(
            humidity > DRIEST_PERCENT, dew_point_c(np.maximum(humidity, DRIEST_PERCENT), temperature), np.nan
        )
    return {
        "air_temperature": temperature + 273.15,
        "dew_point_temperature": dew + 273.15,
        "relative_humidity": humidity,
        "humidity_mixing_ratio": EPSILON * vapour / (pressure_hpa - vapour),
        "air_pressure": 100.0 * pressure_hpa,
        "air_temperature_uncertainty": found.temperature_uncertainty_k,
        "air_temperature_uncertainty_common": found.common["temperature"],
        "relative_humidity_uncertainty": found.humidity_uncertainty_percent,
        "relative_humidity_uncertainty_common": found.common["humidity"],
    }


def of_argument(text: str, written_at: datetime) -> WmoFlight:
    """From OPERATOR:AIRFRAME; `written_at` goes into the file's history.

    Raises
    ------
    InputError
        The text is not two ids with a colon between them.
    """
    from shockrig.files.flight_wmo import file_name

    operator, colon, airframe = text.partition(":")
    if not colon:
        raise InputError(f"--wmo {text}: expected OPERATOR:AIRFRAME, such as 007:ABC12")
    file_name(operator, airframe, 0.0)
    return WmoFlight(operator, airframe, written_at)


def _bridged(time_s: Array, values: Array) -> Array:
    """Where the drone was between fixes."""
    known = np.isfinite(values) & np.isfinite(time_s)
    if not known.any():
        return np.full(values.shape, np.nan)
    return np.interp(time_s, time_s[known], values[known], left=np.nan, right=np.nan)
