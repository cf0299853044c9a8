"""FlySight 2: its sensors in SENSOR.CSV and its positions in TRACK.CSV, two files that become one flight.

Both begin with `$FLYS`; `$COL,HUM,time,humidity,temperature` names a kind of line and its columns, `$UNIT,HUM,...`
their units; after `$DATA` every line begins with its kind. Times of SENSOR.CSV count from the device's start; its lines
`$TIME,time,tow,week` say when that was (seconds of the week, and weeks since 6 January 1980, in UTC: without the leap
seconds that GPS is ahead by, as a log's pressure shows against its altitude).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import open_text, shown
from shockrig.files.errors import InputError
from shockrig.files.flight import REMEDY
from shockrig.files.flight_cells import numbers_of
from shockrig.files.flight_from_netcdf import UNITS
from shockrig.files.gps_time import GPS_EPOCH_S, WEEK_S
from shockrig.files.numbers import counted

Array = NDArray[np.float64]
BEGINS = "$FLYS"
FIRST_FLYSIGHT = "time,lat,lon,hMSL,velN,velE,velD"  # of FlySight 1, which has no sensors
SENSORS, POSITIONS = "SENSOR.CSV", "TRACK.CSV"
SAME_SECOND_S = 0.1  # by which lines of $TIME that agree may differ


@dataclass
class FlySightFile:
    """What one file holds: of each kind of line its columns' names, their units and its cells; the session it is of."""

    columns: dict[str, list[str]] = field(default_factory=dict)
    units: dict[str, list[str]] = field(default_factory=dict)
    cells: dict[str, list[list[str]]] = field(default_factory=dict)
    session: str = ""
    damaged: int = 0
    first_damaged: int = 0


def read_flysight(path: Path) -> tuple[dict[str, tuple[Array, Array]], tuple[str, ...]]:
    """Time [s since 1970, or since the device's start] and value of each quantity, and what was read as what.

    Parameters
    ----------
    path : Path
        Either of the two files, or their folder; the other is taken from beside it.

    Raises
    ------
    InputError
        No readings of humidity, a unit that is not known, most lines damaged: names file, line and remedy.
    """
    folder = path if path.is_dir() else path.parent
    sensors_path = path if not path.is_dir() and path.name.upper() != POSITIONS else folder / SENSORS
    if not sensors_path.is_file():
        raise InputError(f"{shown(path)}: it has positions alone; put {SENSORS} of the same flight beside it")
    sensors = _read(sensors_path, {"BARO", "HUM", "TIME"})
    if not sensors.cells.get("HUM"):
        raise InputError(f"{shown(sensors_path)}: it has no lines of $HUM; give a log with readings of the hygrometer")
    begin_s, clock = _clock(sensors, sensors_path)
    hum_s = begin_s + _column(sensors, "HUM", "time", sensors_path)
    found = {
        "temperature": (hum_s, _column(sensors, "HUM", "temperature", sensors_path, "temperature")),
        "humidity": (hum_s, _column(sensors, "HUM", "humidity", sensors_path, "humidity")),
    }
    if sensors.cells.get("BARO"):
        baro_s = begin_s + _column(sensors, "BARO", "time", sensors_path)
        found["pressure"] = (baro_s, _column(sensors, "BARO", "pressure", sensors_path, "pressure"))
    said = [
        "read as a log of FlySight 2: temperature and humidity from $HUM (the hygrometer's own thermometer is the only "
        f"one near the air), pressure from $BARO; {clock}"
    ]
    files = {sensors_path.name: sensors}
    positions_path = folder / POSITIONS
    if not positions_path.is_file():
        said.append(f"no {POSITIONS} beside it, so no altitude and no position")
    else:
        track = files[POSITIONS] = _read(positions_path, {"GNSS"})
        if not begin_s:
            said.append(f"{POSITIONS} is left out, since the sensors' clock is not known")
        elif track.session != sensors.session:
            said.append(f"{POSITIONS} is left out, since it is of another session than {sensors_path.name}")
        elif track.cells.get("GNSS"):
            found |= _positions(track, positions_path)
            said.append(f"altitude above the sea, position and vertical speed from {POSITIONS}")
    for name, one in files.items():
        if one.damaged:
            said.append(f"{counted(one.damaged, 'damaged line')} of {name} left out (first: line {one.first_damaged})")
    return found, ("; ".join(said),)


def _read(path: Path, wanted: Iterable[str]) -> FlySightFile:
    """The file's lines of some kinds."""
    found, data, number = FlySightFile(), False, 0
    wanted = set(wanted)
    with open_text(path, REMEDY, errors="replace") as stream:
        for number, line in enumerate(stream, start=1):
            kind, *cells = line.rstrip("\r\n\0").split(",")
            if data:
                name = kind[1:]
                if name in wanted and kind[:1] == "$":
                    if len(cells) == len(found.columns.get(name, ())):
                        found.cells.setdefault(name, []).append(cells)
                        continue
                elif kind[:1] == "$" and name in found.columns:
                    continue
                found.damaged += 1
                found.first_damaged = found.first_damaged or number
            elif kind == "$COL" and cells:
                found.columns[cells[0]] = cells[1:]
            elif kind == "$UNIT" and cells:
                found.units[cells[0]] = cells[1:]
            elif kind == "$VAR" and cells[:1] == ["SESSION_ID"]:
                found.session = ",".join(cells[1:])
            data = data or kind == "$DATA"
    if not data:
        raise InputError(f"{shown(path)}: no line $DATA: it ends in its header; copy the file from the device again")
    if found.damaged > sum(map(len, found.cells.values())):
        raise InputError(
            f"{shown(path)}, line {found.first_damaged}: {found.damaged} lines are not what the header says; copy the "
            "file from the device again"
        )
    return found


def _column(lines: FlySightFile, kind: str, name: str, path: Path, quantity: str = "") -> Array:
    """Numbers of a column, in the unit of a quantity where one is given."""
    columns = lines.columns[kind]
    if name not in columns:
        raise InputError(f"{shown(path)}: $COL,{kind} has no column {name}; give a log of FlySight 2")
    place = columns.index(name)
    values = numbers_of(row[place] for row in lines.cells[kind])
    if not quantity:
        return values
    units = lines.units.get(kind, [])
    unit = units[place] if place < len(units) else ""
    known = UNITS[quantity]
    if unit.replace(" ", "").lower() not in known:
        raise InputError(f"{shown(path)}: $UNIT,{kind}: {name} is in {unit!r}, which is not known; give one that is")
    factor, added = known[unit.replace(" ", "").lower()]
    return factor * values + added


def _clock(lines: FlySightFile, path: Path) -> tuple[float, str]:
    """When the sensors' clock was 0 [s since 1970], 0 where that is not known; and a sentence's end on it."""
    began_s = np.empty(0)
    if lines.cells.get("TIME"):
        of_device, week, of_week = (_column(lines, "TIME", name, path) for name in ("time", "week", "tow"))
        began_s = GPS_EPOCH_S + week * WEEK_S + of_week - of_device
        began_s = began_s[np.isfinite(began_s)]
    if not began_s.size:
        return 0.0, "it has no lines of $TIME: times are since the device's start"
    usual = float(np.median(began_s))
    apart_s = float(np.max(np.abs(began_s - usual)))
    # a pulse's stamp is of that second or of the next
    doubt = f", whose lines disagree by up to {apart_s:.0f} s" if apart_s > SAME_SECOND_S else ""
    return usual, f"times in UTC from $TIME{doubt}"


def _positions(track: FlySightFile, path: Path) -> dict[str, tuple[Array, Array]]:
    import pandas as pd

    place = track.columns["GNSS"].index("time") if "time" in track.columns["GNSS"] else 0
    stamps = pd.to_datetime([row[place] for row in track.cells["GNSS"]], errors="coerce", utc=True, format="ISO8601")
    time_s = np.asarray((stamps - pd.Timestamp(0, tz="UTC")).total_seconds(), dtype=float)
    return {
        "altitude": (time_s, _column(track, "GNSS", "hMSL", path, "altitude")),
        "latitude": (time_s, _column(track, "GNSS", "lat", path)),
        "longitude": (time_s, _column(track, "GNSS", "lon", path)),
        "vertical_speed": (time_s, -_column(track, "GNSS", "velD", path)),
    }
