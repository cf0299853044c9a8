"""A flight read from netCDF: variables over one dimension, by their CF standard names or by names that logs use."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import shown
from shockrig.files.errors import InputError
from shockrig.files.flight import NAMES, squeeze

Array = NDArray[np.float64]
STANDARD_NAMES = {
    "air_temperature": "temperature",
    "relative_humidity": "humidity",
    "air_pressure": "pressure",
    "altitude": "altitude",
    "height": "altitude",
    "latitude": "latitude",
    "longitude": "longitude",
    "platform_speed_wrt_air": "airspeed",
}
FACTORS = {"pa": 0.01, "pascal": 0.01, "pascals": 0.01, "kpa": 10.0, "km": 1000.0, "cm/s": 0.01}


def read_netcdf(path: Path, chosen: Mapping[str, str]) -> dict[str, tuple[Array, Array]]:
    """Time [s] and value of each quantity; `chosen`: quantity -> the variable's name.

    Raises
    ------
    InputError
        No netCDF file, no time, or a chosen variable that is not there.
    """
    import netCDF4

    try:
        data = netCDF4.Dataset(path)
    except (OSError, RuntimeError) as error:
        raise InputError(f"{shown(path)}: cannot be read as netCDF ({error}); name a flight's file") from error
    with data:
        for quantity, name in chosen.items():
            if name not in data.variables:
                has = ", ".join(data.variables)
                raise InputError(f"{shown(path)}: no variable {name!r} for {quantity}; it has {has[:300]}")
        lines = {name: v for name, v in data.variables.items() if v.ndim == 1 and v.dtype != str}
        time_name = chosen.get("time") or _time_name(lines)
        if time_name is None:
            raise InputError(f"{shown(path)}: no variable of time; name it with --column time=NAME")
        time_s = _seconds(data.variables[time_name], path)
        found = {}
        for quantity in NAMES:
            place = chosen.get(quantity) or _named(lines, quantity)
            if quantity != "time" and place is not None and lines[place].shape == time_s.shape:
                found[quantity] = (time_s, _values(lines[place]))
    return found


def _named(lines: Mapping[str, Any], quantity: str) -> str | None:
    """The variable of a quantity; a corrected one, or its uncertainty, is no reading."""
    for name, variable in lines.items():
        if STANDARD_NAMES.get(getattr(variable, "standard_name", "")) == quantity and "corrected" not in name:
            return name
    squeezed = {squeeze(name): name for name in lines}
    return next((squeezed[name] for name in NAMES[quantity] if name in squeezed), None)


def _time_name(lines: Mapping[str, Any]) -> str | None:
    for name, variable in lines.items():
        if getattr(variable, "standard_name", "") == "time" or " since " in str(getattr(variable, "units", "")):
            return name
    return _named(lines, "time")


def _seconds(variable: Any, path: Path) -> Array:
    import netCDF4

    units = str(getattr(variable, "units", "s"))
    if " since " not in units:
        return _values(variable)
    values: Array = np.ma.filled(np.ma.asarray(variable[:], dtype=float), np.nan)
    try:
        ends = netCDF4.num2date(np.array([0.0, 1.0]), units, only_use_cftime_datetimes=True)
        origin, one = np.asarray(netCDF4.date2num(ends, "seconds since 1970-01-01 00:00:00"), dtype=float).tolist()
    except ValueError as error:
        raise InputError(f"{shown(path)}: time: {error}; give units such as seconds since 1970-01-01") from error
    return np.asarray(origin + values * (one - origin), dtype=float)


def _values(variable: Any) -> Array:
    values: Array = np.ma.filled(np.ma.asarray(variable[:], dtype=float), np.nan)
    unit = str(getattr(variable, "units", "")).strip()
    if unit.lower() in ("k", "kelvin"):
        return values - 273.15
    if unit == "1" and getattr(variable, "standard_name", "") == "relative_humidity":
        return 100.0 * values
    return values * FACTORS.get(unit.lower(), 1.0)
