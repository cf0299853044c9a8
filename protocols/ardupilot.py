"""ArduPilot's dataflash log (.bin), read with pymavlink: sensors, position, airspeed, and the time of day from GPS.

Messages: HYGR (hygrometers, since 4.3), TEMP, IMET and RHUM (CopterSonde), BARO, GPS, POS, ARSP. Stamps count
microseconds since boot; the first GPS fix says when that was.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import shown
from shockrig.files.errors import InputError
from shockrig.files.gps_time import GPS_EPOCH_S, LEAP_S, WEEK_S

Array = NDArray[np.float64]
# quantity -> MESSAGE.FIELD in the order of preference
FIELDS: dict[str, tuple[str, ...]] = {
    "temperature": ("IMET.T1", "IMET.Temp1", "TEMP.Temp", "RHUM.T1", "HYGR.Temp", "HYGR.Temperature"),
    "humidity": ("HYGR.Humidity", "HYGR.Hum", "RHUM.H1", "RHUM.RH1", "RHUM.Humi1"),
    "die": ("HYGR.Temp", "HYGR.Temperature", "RHUM.T1"),
    "airspeed": ("ARSP.Airspeed",),
    "pressure": ("BARO.Press",),
    "altitude": ("POS.Alt", "GPS.Alt", "BARO.Alt"),
    "latitude": ("POS.Lat", "GPS.Lat"),
    "longitude": ("POS.Lng", "GPS.Lng"),
}
HEAD = b"\xa3\x95"  # every message begins so
KELVIN_FROM = 150.0
PASCAL_FROM = 2000.0
FIRST_INSTANCE = ("I", "Id", "Inst", "Instance")


def read_bin(path: Path, chosen: Mapping[str, str]) -> dict[str, tuple[Array, Array]]:
    """Time [s since 1970, or since boot without GPS] and value of each quantity that the log has.

    `chosen`: quantity -> MESSAGE.FIELD (or MESSAGE[2].FIELD for another instance than the first).

    Raises
    ------
    InputError
        pymavlink is not installed, the file is no such log, or it has no such field.
    """
    try:
        from pymavlink import DFReader  # type: ignore[import-untyped]
    except ImportError as error:
        raise InputError(f"{shown(path)}: ArduPilot logs need pymavlink; pip install 'shockrig[ardupilot]'") from error
    if not path.is_file():
        raise InputError(f"{shown(path)}: no such file; name an ArduPilot .bin log")
    wanted = {q: (chosen[q],) if q in chosen else names for q, names in FIELDS.items()}
    messages = {_parts(name)[0] for names in wanted.values() for name in names} | {"GPS"}
    with path.open("rb") as stream:
        if stream.read(2) != HEAD:
            raise InputError(f"{shown(path)}: is no ArduPilot dataflash log; name a .bin file")
    try:
        with redirect_stdout(io.StringIO()):  # it prints what it stumbles over
            log: Any = object.__new__(DFReader.DFReader_binary)  # to be closed, also where it cannot be begun
            try:
                log.__init__(str(path), zero_time_base=True)
                rows = _collect(log, messages)
            finally:
                if "filehandle" in vars(log):
                    log.filehandle.close()
    except Exception as error:  # of a format that it does not know it raises a bare Exception
        raise InputError(f"{shown(path)}: no readable ArduPilot log ({error}); name a .bin file") from error
    if not rows:
        raise InputError(
            f"{shown(path)}: holds no messages of {', '.join(sorted(messages))}; name an ArduPilot .bin log"
        )
    boot_s = _boot(rows.get(("GPS", 0), []))
    found = {}
    for quantity, names in wanted.items():
        for name in names:
            message, instance, field = _parts(name)
            values = [(m["TimeUS"], m[field]) for m in rows.get((message, instance), []) if field in m]
            if values:
                time_us, value = np.array(values, dtype=float).T
                found[quantity] = (boot_s + 1e-6 * time_us, _in_unit(quantity, value))
                break
        else:
            if quantity in chosen:
                has = ", ".join(sorted({f"{m}.{f}" for (m, _), some in rows.items() for f in some[0]}))
                raise InputError(f"{shown(path)}: no {chosen[quantity]} for {quantity}; it has {has[:300]}")
    if found.get("die", (None,))[0] is not None and "temperature" in found:
        same = np.array_equal(found["die"][1], found["temperature"][1])
        if same:  # the only thermometer is the hygrometer's own
            del found["die"]
    return found


def _collect(log: Any, messages: set[str]) -> dict[tuple[str, int], list[dict[str, float]]]:
    """Fields of every message, by its name and instance."""
    rows: dict[tuple[str, int], list[dict[str, float]]] = {}
    first: dict[str, float] = {}
    while (message := log.recv_match(type=sorted(messages))) is not None:
        fields = message.to_dict()
        name = fields.pop("mavpackettype")
        numbers = {key: float(v) for key, v in fields.items() if isinstance(v, int | float)}
        if "TimeUS" not in numbers:
            continue
        instance = next((numbers[key] for key in FIRST_INSTANCE if key in numbers), 0.0)
        number = int(instance - first.setdefault(name, instance))
        rows.setdefault((name, number), []).append(numbers)
    return rows


def _parts(name: str) -> tuple[str, int, str]:
    """MESSAGE, instance counted from 0, FIELD of "MESSAGE.FIELD" or "MESSAGE[2].FIELD"."""
    message, dot, field = name.partition(".")
    message, bracket, number = message.partition("[")
    if not dot or not field or (bracket and not number.rstrip("]").isdecimal()):
        raise InputError(f"--column ...={name}: expected MESSAGE.FIELD of the log, such as HYGR.Humidity")
    return message, int(number.rstrip("]")) - 1 if bracket else 0, field


def _boot(fixes: list[dict[str, float]]) -> float:
    """When the autopilot was started [s since 1970], by the first fix with a week; 0 without one."""
    for fix in fixes:
        if fix.get("GWk", 0.0) > 1000.0 and "GMS" in fix:
            return GPS_EPOCH_S + fix["GWk"] * WEEK_S + 1e-3 * fix["GMS"] - LEAP_S - 1e-6 * fix["TimeUS"]
    return 0.0


def _in_unit(quantity: str, value: Array) -> Array:
    typical = float(np.nanmedian(np.abs(value)))
    if quantity in ("temperature", "die") and typical > KELVIN_FROM:
        return value - 273.15
    if quantity == "pressure" and typical > PASCAL_FROM:
        return value / 100.0
    return value
