"""A flight read from netCDF: variables over one dimension that is longer than 1, by their CF standard names or by names
that logs use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import demand_text_name, open_regular, shown
from shockrig.files.errors import InputError
from shockrig.files.flight import NAMES, others_said
from shockrig.files.ranges import RANGES
from shockrig.files.unit_names import quantity_of, squeeze

Array = NDArray[np.float64]
STANDARD_NAMES = {
    "air_temperature": "temperature",
    "sea_water_temperature": "temperature",
    "relative_humidity": "humidity",
    "air_pressure": "pressure",
    "altitude": "altitude",
    "height": "altitude",
    "depth": "altitude",
    "latitude": "latitude",
    "longitude": "longitude",
    "platform_speed_wrt_air": "airspeed",
}
NEEDED = ("temperature", "humidity")  # whatever else is there may be left out
DOWNWARDS = " (a depth: its sign is turned)"
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
    | {"kpa": (10.0, 0.0), "dbar": (100.0, 0.0), "decibar": (100.0, 0.0), "bar": (1000.0, 0.0)},
    "airspeed": dict.fromkeys(("m/s", "ms-1", "m s-1", "m.s-1"), (1.0, 0.0))
    | {"cm/s": (0.01, 0.0), "km/h": (1 / 3.6, 0.0), "knot": (0.514444, 0.0), "knots": (0.514444, 0.0)},
    "altitude": _METRES | {"cm": (0.01, 0.0), "km": (1000.0, 0.0), "ft": (0.3048, 0.0), "feet": (0.3048, 0.0)},
}


def read_netcdf(path: Path, chosen: Mapping[str, str]) -> tuple[dict[str, tuple[Array, Array]], tuple[str, ...]]:
    """Time [s] and value of each quantity, and what was read as what; `chosen`: quantity -> the variable's name.

    Raises
    ------
    InputError
        No netCDF file, no time, a chosen variable that is not there or has no times, or a temperature or a humidity in
        a unit that is not known.
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
        return _read(data, chosen, path)


def _read(data: Any, chosen: Mapping[str, str], path: Path) -> tuple[dict[str, tuple[Array, Array]], tuple[str, ...]]:
    lines = {name: v for name, v in data.variables.items() if _is_line(v)}
    for quantity, name in chosen.items():
        if name not in data.variables:
            has = ", ".join(data.variables)
            raise InputError(f"{shown(path)}: no variable {name!r} for {quantity}; it has {has[:300]}")
        if name not in lines:
            raise InputError(f"{shown(path)}: {name!r} for {quantity} is no row of numbers; name another variable")
    clocks = _clocks(lines, chosen.get("time"))
    if not clocks:
        raise InputError(f"{shown(path)}: no variable of time; name it with --column time=NAME")
    clock_of = {name: _clock_of(variable, lines, clocks) for name, variable in lines.items()}
    seconds, found, read, said = dict[str, Array](), dict[str, tuple[Array, Array]](), list[str](), list[str]()
    for quantity in (*NEEDED, *(one for one in NAMES if one not in ("time", *NEEDED))):
        main = next(iter(seconds), None)
        called = [one for one in _called(lines, quantity) if clock_of[one] is not None]
        taken = chosen.get(quantity) or min(called, key=lambda one: clock_of[one] != main, default=None)
        if taken is None:
            continue
        if (clock := clock_of[taken]) is None:
            raise InputError(
                f"{shown(path)}: {taken!r} for {quantity} has no times: no variable of time lies over "
                f"({', '.join(lines[taken].dimensions)}); name one that does with --column time=NAME, or another one"
            )
        try:
            values = _values(lines[taken], quantity, path)
        except InputError as error:
            if quantity in (*NEEDED, *chosen):
                raise
            said.append(f"{quantity} is left out: {error}")
            continue
        known = values[np.isfinite(values)]
        if quantity == "pressure" and known.size and np.median(known) > RANGES["pressure_hpa"].high:
            said.append(f"pressure {taken!r} is left out: no air has as much; it may be that of water")
            continue
        if clock not in seconds:
            seconds[clock] = _seconds(lines[clock], path)
        found[quantity] = (seconds[clock], values)
        if quantity in NEEDED and quantity not in chosen and (others := _others(lines, quantity, taken)):
            said.append(f"{quantity} {taken!r} is taken, {others_said(quantity, others)}")
        read.append(f"{quantity.replace('_', ' ')} {taken!r}{DOWNWARDS if _down(lines[taken], quantity) else ''}")
    return found, (f"read as netCDF: {', '.join(read)}; times {', '.join(map(repr, seconds))}", *said)


def _is_line(variable: Any) -> bool:
    """Whether a variable is a row of numbers: over one dimension, or of one flight of those there is room for."""
    numbers = variable.dtype != str and variable.dtype.kind in "iuf"
    return numbers and variable.ndim > 0 and variable.size == max(variable.shape)


def _standard_name(variable: Any) -> str:
    return str(getattr(variable, "standard_name", ""))


def _called(lines: Mapping[str, Any], quantity: str) -> list[str]:
    """Variables that are a quantity's, by standard name (the longest first) and then by name; a corrected one, or its
    uncertainty, is no reading, and water's is none of the air's but the temperature."""
    wanted = [standard for standard, named in STANDARD_NAMES.items() if named == quantity]
    found = [
        name
        for standard in wanted
        for name, variable in sorted(lines.items(), key=lambda item: -item[1].size)
        if _standard_name(variable) == standard and "corrected" not in name
    ]
    squeezed = {squeeze(name): name for name in lines if not _standard_name(lines[name]).startswith("sea_water")}
    return list(dict.fromkeys([*found, *(squeezed[name] for name in NAMES[quantity] if name in squeezed)]))


def _others(lines: Mapping[str, Any], quantity: str, taken: str) -> list[str]:
    """Variables that may be a quantity as well, by their names and units."""
    called = set(_called(lines, quantity))
    for name, variable in lines.items():
        if quantity_of(name, None) == quantity and _plain_unit(variable) in UNITS[quantity]:
            called.add(name)
    return [name for name in lines if name in called and name != taken]


def _plain_unit(variable: Any) -> str:
    return str(getattr(variable, "units", "")).strip().lower().replace("°", "deg").replace("_", "")


def _is_dated(variable: Any) -> bool:
    since = str(getattr(variable, "units", "")).partition(" since ")[2]
    return any(map(str.isdigit, since))  # "seconds since launch" counts from no date


def _clocks(lines: Mapping[str, Any], chosen: str | None) -> list[str]:
    """Variables of time, the one that is `chosen` first, all of them dates where one is."""
    named = [name for name, variable in lines.items() if _standard_name(variable) == "time" or _is_dated(variable)]
    named = [name for name in ([chosen] if chosen else []) + named + _called(lines, "time") if lines[name].size > 1]
    dated = any(_is_dated(lines[name]) for name in (named[:1] if chosen in lines else named))
    return [name for name in dict.fromkeys(named) if _is_dated(lines[name]) == dated]


def _clock_of(variable: Any, lines: Mapping[str, Any], clocks: Sequence[str]) -> str | None:
    """The time of a variable: one over its own dimension, of several that which its `coordinates` name; None where
    there is none."""
    own = str(getattr(variable, "coordinates", "")).split()
    same = [clock for clock in clocks if lines[clock].dimensions == variable.dimensions]
    alike = same or [clock for clock in clocks if lines[clock].shape == variable.shape]
    return min(alike, key=lambda clock: clock not in own, default=None)


def _down(variable: Any, quantity: str) -> bool:
    """Whether an altitude is a depth."""
    way = str(getattr(variable, "positive", "down" if _standard_name(variable) == "depth" else "up")).lower()
    return quantity == "altitude" and way == "down"


def _numbers(variable: Any) -> Array:
    return np.asarray(np.ma.filled(np.ma.asarray(variable[:], dtype=float), np.nan)).ravel()


def _seconds(variable: Any, path: Path) -> Array:
    import netCDF4

    units = str(getattr(variable, "units", "s"))
    if not _is_dated(variable):
        return _values(variable, "time", path)
    unit, _, since = units.partition(" since ")
    nano = 1.0
    if unit.strip().lower() in ("ns", "nanosecond", "nanoseconds"):  # which the library does not know
        nano, units = 1e-9, f"seconds since {since}"
    values = _numbers(variable)
    try:
        ends = netCDF4.num2date(np.array([0.0, 1.0]), units, only_use_cftime_datetimes=True)
        origin, one = np.asarray(netCDF4.date2num(ends, "seconds since 1970-01-01 00:00:00"), dtype=float).tolist()
    except ValueError as error:
        raise InputError(f"{shown(path)}: time: {error}; give units such as seconds since 1970-01-01") from error
    return np.asarray(origin + values * nano * (one - origin), dtype=float)


def _values(variable: Any, quantity: str, path: Path) -> Array:
    values = _numbers(variable)
    if _down(variable, quantity):
        values = -values
    known, unit = UNITS.get(quantity, {}), str(getattr(variable, "units", "")).strip()
    if not known or not unit:
        return values
    plain = _plain_unit(variable)
    if quantity in ("altitude", "time") and plain not in known:
        plain = plain.partition(" ")[0]  # "meters above Mean Sea Level", "seconds since launch"
    if plain not in known:
        one_of_each = {scale: name for name, scale in reversed(known.items())}
        said = f"{variable.name} is in {unit!r}, which is not known; give one of"
        raise InputError(f"{shown(path)}: {said} {', '.join(name for name in known if name in one_of_each.values())}")
    factor, added = known[plain]
    return factor * values + added
