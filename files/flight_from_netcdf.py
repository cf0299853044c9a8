"""A flight read from netCDF: variables over one dimension, by their CF standard names or by names that logs use."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import demand_text_name, open_regular, shown
from shockrig.files.errors import InputError
from shockrig.files.flight import NAMES
from shockrig.files.unit_names import squeeze

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
# What a value is multiplied by, and what is added then, by unit; nothing said is taken as the first.
_CELSIUS = dict.fromkeys(("degc", "c", "celsius", "degreec", "degreecelsius", "degreescelsius"), (1.0, 0.0))
_KELVIN = dict.fromkeys(("k", "kelvin", "degk"), (1.0, -273.15))
_FAHRENHEIT = dict.fromkeys(("degf", "f", "fahrenheit", "degreefahrenheit", "degreesfahrenheit"), (5 / 9, -160 / 9))
_PERCENT = {"%": (1.0, 0.0), "percent": (1.0, 0.0), "%rh": (1.0, 0.0), "1": (100.0, 0.0)}
_METRES = dict.fromkeys(("m", "meter", "meters", "metre", "metres"), (1.0, 0.0))
_SECONDS = dict.fromkeys(("s", "sec", "second", "seconds"), (1.0, 0.0))
UNITS: Mapping[str, dict[str, tuple[float, float]]] = {
    "time": _SECONDS
    | {"ms": (1e-3, 0.0), "us": (1e-6, 0.0), "ns": (1e-9, 0.0), "min": (60.0, 0.0), "h": (3600.0, 0.0)},
    "temperature": _CELSIUS | _KELVIN | _FAHRENHEIT,
    "die": _CELSIUS | _KELVIN | _FAHRENHEIT,
    "humidity": _PERCENT,
    "pressure": dict.fromkeys(("hpa", "mbar", "mb", "millibar"), (1.0, 0.0))
    | dict.fromkeys(("pa", "pascal", "pascals"), (0.01, 0.0))
    | {"kpa": (10.0, 0.0), "bar": (1000.0, 0.0)},
    "airspeed": dict.fromkeys(("m/s", "ms-1", "m s-1", "m.s-1"), (1.0, 0.0))
    | {"cm/s": (0.01, 0.0), "km/h": (1 / 3.6, 0.0), "knot": (0.514444, 0.0), "knots": (0.514444, 0.0)},
    "altitude": _METRES | {"km": (1000.0, 0.0), "ft": (0.3048, 0.0), "feet": (0.3048, 0.0)},
}


def read_netcdf(path: Path, chosen: Mapping[str, str]) -> dict[str, tuple[Array, Array]]:
    """Time [s] and value of each quantity; `chosen`: quantity -> the variable's name.

    Raises
    ------
    InputError
        No netCDF file, no time, or a chosen variable that is not there.
    """
    import netCDF4

    demand_text_name(path, "rename it")
    with open_regular(path, "name a netCDF file"):  # a pipe would hang in the library, deaf to every signal
        pass
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
                found[quantity] = (time_s, _values(lines[place], quantity, path))
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
        return _values(variable, "time", path)
    values: Array = np.ma.filled(np.ma.asarray(variable[:], dtype=float), np.nan)
    try:
        ends = netCDF4.num2date(np.array([0.0, 1.0]), units, only_use_cftime_datetimes=True)
        origin, one = np.asarray(netCDF4.date2num(ends, "seconds since 1970-01-01 00:00:00"), dtype=float).tolist()
    except ValueError as error:
        raise InputError(f"{shown(path)}: time: {error}; give units such as seconds since 1970-01-01") from error
    return np.asarray(origin + values * (one - origin), dtype=float)


def _values(variable: Any, quantity: str, path: Path) -> Array:
    values: Array = np.ma.filled(np.ma.asarray(variable[:], dtype=float), np.nan)
    known, unit = UNITS.get(quantity, {}), str(getattr(variable, "units", "")).strip()
    if not known or not unit:
        return values
    plain = unit.lower().replace("°", "deg").replace("_", "")
    if plain not in known:
        one_of_each = {scale: name for name, scale in reversed(known.items())}
        said = f"{variable.name} is in {unit!r}, which is not known; give one of"
        raise InputError(f"{shown(path)}: {said} {', '.join(name for name in known if name in one_of_each.values())}")
    factor, added = known[plain]
    return factor * values + added
