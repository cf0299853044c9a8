"""Writes a flight in the format of WMO's drone demonstration campaign: one netCDF file, its name says whose it is.

Names, units and the file's name: github.com/synoptic/wmo-uasdc, raw_uas_to_netCDF/README.md; FM 303 is WMO's profile of
CF for trajectories. Files that their converter to BUFR does not take come back to the operator.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import beside, demand_text_name
from shockrig.files.errors import InputError

Array = NDArray[np.float64]
# name -> (units, long name, standard name)
VARIABLES = {
    "time": ("seconds since 1970-01-01T00:00:00", "Time", "time"),
    "lat": ("degrees_north", "Latitude", "latitude"),
    "lon": ("degrees_east", "Longitude", "longitude"),
    "altitude": ("meters", "Altitude", "altitude"),
    "air_temperature": ("Kelvin", "Air Temperature", "air_temperature"),
    "dew_point_temperature": ("Kelvin", "Dew Point Temperature", "dew_point_temperature"),
    "relative_humidity": ("%", "Relative Humidity", "relative_humidity"),
    "humidity_mixing_ratio": ("kg/kg", "Humidity Mixing Ratio", "humidity_mixing_ratio"),
    "air_pressure": ("Pa", "Air Pressure", "air_pressure"),
    "air_temperature_uncertainty": ("Kelvin", "Standard Uncertainty of Air Temperature", ""),
    "air_temperature_uncertainty_common": ("Kelvin", "Part of it that is common to the flight", ""),
    "relative_humidity_uncertainty": ("%", "Standard Uncertainty of Relative Humidity", ""),
    "relative_humidity_uncertainty_common": ("%", "Part of it that is common to the flight", ""),
}
COORDINATES = ("time", "lat", "lon", "altitude")
GLOBAL = {"Conventions": "CF-1.8, WMO-CF-1.0", "wmo__cf_profile": "FM 303-2024", "featureType": "trajectory"}
MOST_ROWS = 60_000  # a BUFR message holds 65535 subsets


def file_name(operator: str, airframe: str, start_s: float) -> str:
    """UASDC_NNN_AAAAA_YYYYMMDDHHMMSSZ.nc of a flight that began at `start_s` since 1970, UTC.

    Raises
    ------
    InputError
        The operator has not three digits, or the airframe not one to five letters and digits.
    """
    if not re.fullmatch(r"[0-9]{3}", operator):
        raise InputError(f"--wmo {operator}:{airframe}: an operator has three digits, as assigned by WMO (007)")
    if not re.fullmatch(r"[A-Za-z0-9]{1,5}", airframe):
        raise InputError(f"--wmo {operator}:{airframe}: an airframe has one to five letters and digits (ABC12)")
    return f"UASDC_{operator}_{airframe}_{datetime.fromtimestamp(int(start_s), UTC):%Y%m%d%H%M%S}Z.nc"


def write_wmo(
    folder: Path, operator: str, airframe: str, columns: Mapping[str, Array], attributes: Mapping[str, str]
) -> Path:
    """Write a flight; the file's path.

    Parameters
    ----------
    folder : Path
    operator, airframe : str
    columns : mapping
        Arrays (n,) by the names of `VARIABLES`; what is missing is NaN or left out, time, position and temperature are
        needed in every row.
    attributes : mapping
        Further global attributes: title, platform_name, flight_id, site_terrain_elevation_height, processing_level,
        source, history.

    Raises
    ------
    InputError
        Bad ids, no date, no rows.
    """
    import netCDF4

    needed = [columns[name] for name in ("time", "lat", "lon", "altitude", "air_temperature")]
    # the converter takes a quantity for all rows or for none
    moist = [columns[name] for name in ("humidity_mixing_ratio", "dew_point_temperature") if name in columns]
    needed += [values for values in moist if np.isfinite(values).any()]
    rows = np.flatnonzero(np.logical_and.reduce([np.isfinite(values) for values in needed]))
    if not rows.size:
        raise InputError(
            "--wmo: no row has time, position, altitude and temperature; name the columns (--column latitude=NAME)"
        )
    if rows.size > MOST_ROWS:
        rows = rows[:: -(-rows.size // MOST_ROWS)]
    start_s = float(columns["time"][rows[0]])
    if start_s < 5e8:
        raise InputError("--wmo: the log's clock has no date; give a log with dates, or with a GPS fix")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / file_name(operator, airframe, start_s)
    demand_text_name(path, "give another folder")
    temporary = beside(path)
    try:
        with netCDF4.Dataset(temporary, "w", format="NETCDF4") as data:
            data.createDimension("obs", rows.size)
            for name, value in {**GLOBAL, **attributes}.items():
                data.setncattr(name, value)
            trajectory = data.createVariable("trajectory", str, ())
            trajectory.long_name, trajectory.cf_role = "flight", "trajectory_id"
            trajectory[0] = attributes["flight_id"]
            for name in VARIABLES:
                if name in columns:
                    _put(data, name, columns[name][rows], attributes["processing_level"])
            for name in ("air_temperature", "relative_humidity"):
                if f"{name}_uncertainty" in data.variables:
                    data[name].ancillary_variables = f"{name}_uncertainty {name}_uncertainty_common"
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def _put(data: Any, name: str, values: Array, level: str) -> None:
    """One variable of a file that is being written, with the attributes that the format wants of it."""
    units, words, standard = VARIABLES[name]
    variable = data.createVariable(name, "f8", ("obs",), fill_value=np.nan, zlib=True)
    variable.units, variable.long_name, variable.processing_level = units, words, level
    if standard:
        variable.standard_name = standard
    if name == "altitude":
        variable.positive, variable.axis = "up", "Z"
    if name not in COORDINATES:
        variable.coordinates = " ".join(COORDINATES)
    variable[:] = values
