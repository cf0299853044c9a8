"""Flights in other forms than a CSV file: ArduPilot's .bin, netCDF, FlySight 2, a dropsonde's file of AVAPS,
radiosonde_auto_rx's JSON, and any text log by a map. All become one CSV file.

It has the columns that `correct` knows (time_s, temperature_c, humidity_percent, ...), a row for each reading of the
sensor that is read most often; what is read more seldom stands in the nearest row.
"""

from __future__ import annotations

import csv
import shutil
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import open_text, shown
from shockrig.files.errors import InputError
from shockrig.files.flight import REMEDY, Flight, FlightColumns, LayoutError, read_layout, unread_unit
from shockrig.files.flight_cells import read_blocks
from shockrig.files.flight_rows import damage_notes, whole_flight
from shockrig.files.unit_names import INSIDE, OUTSIDE, UNITS, how_near, outside_name, squeeze

if TYPE_CHECKING:
    from shockrig.rig.logs.mapping import LogMap, SensorMap

Array = NDArray[np.float64]
COLUMNS = {
    "temperature": "temperature_c",
    "humidity": "humidity_percent",
    "die": "humidity_sensor_temperature_c",
    "airspeed": "airspeed_m_s",
    "pressure": "pressure_hpa",
    "altitude": "altitude_m",
    "latitude": "latitude_deg",
    "longitude": "longitude_deg",
    "vertical_speed": "vertical_speed_m_s",
}
FIRST_LINE = 200  # characters that tell a log
FIRST_ROWS = 2000  # that tell whether rows are of several sensors
BACK_S = 1.0  # that the clock steps back: less is rows out of order
QUANTITY_OF = {"temperature": "temperature", "humidity": "humidity", "die_temperature": "die", "pressure": "pressure"}
MAIN = ("temperature", "humidity")
READINGS = ("temperature", "humidity", "die")  # are not made up between readings; where the drone is, is
Series = tuple[Array, Array]  # time [s], value


@dataclass(frozen=True)
class AsCsv:
    """A log that was written as a CSV file: `said` are sentences on what was read as what."""

    said: tuple[str, ...]


def to_csv(
    source: Path, target: Path, *, columns: Mapping[str, str] | None = None, map_path: Path | None = None
) -> AsCsv | None:
    """Write a flight that is no CSV file (or one that is read by a map) as one; None where it is one already.

    Parameters
    ----------
    source, target : Path
    columns : mapping, optional
        quantity -> MESSAGE.FIELD of a .bin log, or the name of a netCDF variable, where it cannot be recognised.
    map_path : Path, optional
        A map as `shockrig import` takes it (shock-map/1), or the name of one that ships.

    Raises
    ------
    InputError
        Names the file, what is missing, and the remedy; BenchError for a map that does not fit.
    """
    said: tuple[str, ...] = ()
    if map_path is not None:
        from shockrig.rig.logs.map_file import read_map

        found, said = _by_map(source, read_map(map_path))
    elif source.suffix.lower() == ".bin":
        from shockrig.protocols.ardupilot import read_bin

        found = read_bin(source, columns or {})
    elif source.suffix.lower() in (".nc", ".nc4", ".cdf"):
        from shockrig.files.flight_from_netcdf import read_netcdf

        found, said = read_netcdf(source, columns or {})
    elif (read := _by_content(source)) is not None:
        found, said = read
    elif not columns and (unfolded := _unfolded(source, target)) is not None:
        return unfolded
    elif (read := _by_guess(source, columns)) is not None:
        found, said = read
    else:
        return None
    _write(source, found, target)
    return AsCsv(said)


def named_both(columns: Mapping[str, str] | None, map_path: Path | None) -> bool:
    """Whether a person says which column of a log is the temperature and which the humidity."""
    return map_path is not None or set(MAIN) <= set(columns or ())


def _by_content(source: Path) -> tuple[dict[str, Series], tuple[str, ...]] | None:
    """What a log holds that its first line tells, and what was read as what; None of any other."""
    from shockrig.files import flight_avaps as avaps
    from shockrig.files import flight_flysight as flysight
    from shockrig.files.flight_telemetry import read_telemetry

    if source.is_dir() and (source / flysight.SENSORS).is_file():
        return flysight.read_flysight(source)
    with open_text(source, REMEDY, errors="replace") as stream:
        first = stream.readline(FIRST_LINE).lstrip("\0 \t")
    if first.startswith(flysight.BEGINS):
        return flysight.read_flysight(source)
    if first.startswith(avaps.BEGINS):
        return avaps.read_avaps(source)
    if first.startswith(flysight.FIRST_FLYSIGHT):
        raise InputError(
            f"{shown(source)}: a track of FlySight 1, which has positions and no temperature; give the sensor's own log"
        )
    return read_telemetry(source) if first.startswith(("{", "[")) else None


def _unfolded(source: Path, target: Path) -> AsCsv | None:
    """Write a log whose readings stand behind their names ("t=15.2C h=83.8%"); None of one whose columns hold them."""
    from shockrig.files.flight_labelled import unfold

    with suppress(InputError):
        if {"temperature", "humidity"} & read_layout(source).place.keys():
            return None
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / f"{source.stem}.csv"
        if not (names := unfold(source, table)):
            return None
        try:
            done = to_csv(table, target)
        except InputError as error:
            raise InputError(str(error).replace(shown(table), shown(source))) from None
        if done is None:
            shutil.copyfile(table, target)
    said = f"readings that stand behind their names were read as columns: {', '.join(names)}"
    return AsCsv((said, *(done.said if done is not None else ())))


def _by_guess(source: Path, columns: Mapping[str, str] | None) -> tuple[dict[str, Series], tuple[str, ...]] | None:
    """A log of another layout (semicolons, decimal commas, names in other words) by the map that `import --look` would
    write, and what was read as what; None of a CSV file whose columns are recognised."""
    from shockrig.rig.bench_errors import BenchError
    from shockrig.rig.logs.first_map import NoClockError, columns_of

    try:
        layout = read_layout(source, columns)
        if not (layout.known or layout.raw_xq2):
            if len(layout.header) > len(layout.place):
                _demand_one_sensor(source)
            _demand_bare_numbers(source, layout)
    except LayoutError as refused:
        if columns:  # the names are those of a CSV file
            raise
        try:
            seen = columns_of(source)
        except NoClockError as no_clock:
            raise InputError(f"{no_clock}; --map MAP.toml takes it") from None
        except BenchError:
            raise refused from None
        seen, found, remarks = _of_possible(source, seen)
        taken, others = dict[str, str](), dict[str, list[str]]()
        for sensor in seen.sensors.values():
            for key, (name, _) in sensor.columns.items():
                if taken.setdefault(key, name) != name:
                    others.setdefault(key, []).append(name)
        said = list[str]()
        for key, name in taken.items():
            if (quantity := QUANTITY_OF.get(key)) and (unit := unread_unit(quantity, name)):
                if quantity == "pressure":
                    found.pop(quantity, None)
                    said.append(f"pressure {name!r} is left out: {unit!r} is no unit of it that is known")
                    continue
                raise InputError(
                    f"{shown(source)}: column {name!r}: {unit!r} is no unit of {quantity} that is known; convert the "
                    "column and rename it, or read the log by a map that states its unit: shockrig import FILE --look "
                    "writes one, --map takes it"
                ) from None
        wind = taken.get("airflow", "")
        # a meter without positions measures the wind that it stands in; others tell it from how they drift
        if wind and how_near(wind) > 0 and ("latitude" in taken or "wind" not in wind.lower()):
            del taken["airflow"]
            found.pop("airspeed", None)
            said.append(
                f"airflow {wind!r} is not taken: a wind, or a speed over ground, is none of the air past a sensor that "
                "flies; where it is, a map says so"
            )
        if taken.get("die_temperature") == taken.get("temperature"):
            found.pop("die", None)  # that one chip measures both is what a logger's map supposes, and no reading
            taken.pop("die_temperature", None)
        units = {name: unit for sensor in seen.sensors.values() for name, unit in sensor.columns.values()}
        usual = {unit for of in UNITS.values() for unit, scale in of.items() if scale == (1.0, 0.0)}
        as_read = {name: f" in {unit}" for name, unit in units.items() if unit not in usual}
        read = [f"{key.replace('_', ' ')} {name!r}{as_read.get(name, '')}" for key, name in taken.items()]
        listed = ", ".join([f"time {' and '.join(map(repr, seen.time))}", *read])
        said.insert(0, f"the log was read as shockrig import reads it: {listed}; --map MAP.toml says otherwise")
        for key in MAIN:
            if key in others:
                named = ", ".join(map(repr, others[key]))
                said.append(f"{key} {taken[key]!r} is taken, and not {named}: a map with one sensor takes another")
        return found, (*said, *remarks)
    return None


def _demand_one_sensor(source: Path) -> None:
    """Refuse rows that are of several sensors, one a row, as the first of them tell it.

    Raises
    ------
    InputError
        Names the column that says whose a row is, and the remedy.
    """
    from shockrig.rig.bench_errors import BenchError
    from shockrig.rig.logs.apart import SeveralError
    from shockrig.rig.logs.first_map import columns_of
    from shockrig.rig.logs.sensor_logs import read_sensors

    with tempfile.TemporaryDirectory() as folder:
        first = Path(folder) / source.name
        with open_text(source, REMEDY, errors="replace") as stream:
            first.write_text("".join(islice(stream, FIRST_ROWS)), encoding="utf-8")
        try:
            read_sensors(first, columns_of(first))
        except SeveralError as fault:
            raise InputError(f"{shown(source)}{str(fault).removeprefix(shown(first))}, and give it by --map") from None
        except BenchError:
            pass  # whatever else is odd of it is said where it is read


def _demand_bare_numbers(source: Path, layout: FlightColumns) -> None:
    """Refuse a log of which a column's cells carry a unit behind their number ("76.7F"), as its first rows have it.

    Raises
    ------
    LayoutError
        Names the column; a log of another layout may be read all the same.
    """
    from shockrig.rig.logs.text import unit_in_cells

    for first in islice(read_blocks(source, layout, FIRST_ROWS), 1):
        for place in first.strange.intersection(layout.place.values()):
            if unit_in_cells(first.cells(place)):
                raise LayoutError(
                    f"{shown(source)}: column {layout.header[place]!r} holds {first.cell(0, place)[:40]!r}, numbers "
                    "and their unit: leave out --column, or read the log by a map: shockrig import FILE --look writes "
                    "one, --map takes it"
                )


def _of_possible(source: Path, seen: LogMap) -> tuple[LogMap, dict[str, Series], tuple[str, ...]]:
    """What a log holds by the map that is `seen`, or without columns that cannot be what their names say where others
    are the same quantity's: the map, and what was found odd."""
    from shockrig.rig.logs.first_map import columns_of
    from shockrig.rig.logs.log import ImpossibleError

    refused: list[ImpossibleError] = []
    while True:
        seen = replace(seen, sensors=dict(sorted(seen.sensors.items(), key=lambda one: _indoors(one[1]))))
        try:
            found, remarks = _by_map(source, _taken(seen))
        except ImpossibleError as fault:
            refused.append(fault)
            rest = columns_of(source, refused)
            measured = [{key for sensor in one.sensors.values() for key in sensor.columns} for one in (seen, rest)]
            if not (measured[0] & set(MAIN)) <= measured[1]:
                raise
            seen = rest
        else:
            left_out = (
                f"column {one.column!r} is left out: hardly any of it can be what its name says" for one in refused
            )
            return seen, found, (*left_out, *remarks)


def _taken(seen: LogMap) -> LogMap:
    """The map without sensors of which nothing is taken, since others stand before them: what is odd of these is
    nothing to a flight."""
    first: dict[str, str] = {}
    for name, sensor in seen.sensors.items():
        for key in sensor.columns:
            first.setdefault(key, name)
    return replace(seen, sensors={name: seen.sensors[name] for name in seen.sensors if name in first.values()})


def _indoors(sensor: SensorMap) -> int:
    """-1 of a sensor that is outside of the logger by its names, 1 of one that is inside of it, 0 of any other."""
    names = [squeeze(name) for key, (name, _) in sensor.columns.items() if key in MAIN]
    outside, inside = (any(outside_name(name, words) is not None for name in names) for words in (OUTSIDE, INSIDE))
    return -1 if outside else int(inside)


def _by_map(source: Path, map_: LogMap) -> tuple[dict[str, Series], tuple[str, ...]]:
    """What a log holds by a map, and what was found odd in it."""
    from shockrig.rig.logs.sensor_logs import read_sensors

    log = read_sensors(source, map_)
    keys = {
        "temperature": "temperature",
        "humidity": "humidity",
        "die_temperature": "die",
        "pressure": "pressure",
        "airflow": "airspeed",
        "altitude": "altitude",
        "latitude": "latitude",
        "longitude": "longitude",
    }
    found: dict[str, Series] = {}
    for readings in log.readings.values():
        time_s = log.log.time_s[readings.rows] + log.log.origin_s
        for key, quantity in keys.items():
            if key in readings.values:
                found.setdefault(quantity, (time_s, readings.values[key]))
    remarks = (*log.log.remarks, *(said for one in log.readings.values() for said in one.remarks))
    return found, remarks


def _write(source: Path, found: Mapping[str, Series], target: Path) -> None:
    """Rows at the times of the temperature or the humidity, whichever is read more often."""
    series = {}
    for quantity, (own, value) in found.items():
        known = np.isfinite(own) & np.isfinite(value)
        if known.any():
            series[quantity] = own[known], value[known]
    main = [q for q in ("temperature", "humidity") if q in series]
    if not main:
        raise InputError(
            f"{shown(source)}: neither temperature nor humidity found; name them with --column temperature=NAME"
        )
    first = max(main, key=lambda q: series[q][0].size)
    rows = found[first][0]
    of_rows = {q: value for q, (own, value) in found.items() if np.array_equal(own, rows, equal_nan=True)}
    taken = np.isfinite(rows) & np.any([np.isfinite(v) for q, v in of_rows.items() if q in READINGS], axis=0)
    time_s = rows[taken]
    back = bool((np.diff(time_s) < -BACK_S).any())
    values: dict[str, Array] = {}
    for quantity, (own, value) in series.items():
        if quantity in of_rows:
            # no need to look for its rows, and no way to mistake them where the clock was set back
            values[quantity] = of_rows[quantity][taken]
            continue
        if back:
            raise InputError(
                f"{shown(source)}: the clock steps back, and {quantity} is not on the rows of {first}; "
                "cut the log where it does, and correct its parts"
            )
        order = np.argsort(own, kind="stable")
        own, value = own[order], value[order]
        if quantity not in READINGS:
            values[quantity] = np.interp(time_s, own, value, left=np.nan, right=np.nan)
            continue
        row = np.clip(np.searchsorted(time_s, own), 1, max(time_s.size - 1, 1))
        row = np.where(own - time_s[row - 1] < time_s[np.minimum(row, time_s.size - 1)] - own, row - 1, row)
        column = np.full(time_s.size, np.nan)
        column[np.minimum(row, time_s.size - 1)] = value
        values[quantity] = column
    with target.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["time_s", *(COLUMNS[q] for q in values)])
        formats = {"latitude": "%.7f", "longitude": "%.7f"}
        columns = [[f"{t:.6f}" for t in time_s.tolist()]]
        for quantity, column in values.items():
            form = formats.get(quantity, "%.5g" if quantity == "airspeed" else "%.4f")
            columns.append(["" if v != v else form % v for v in column.tolist()])
        writer.writerows(zip(*columns, strict=True))


def read_flight(path: Path) -> Flight:
    """All rows of a flight, in any form that `correct` takes."""
    return read_log(path)[0]


def read_log(
    path: Path, columns: Mapping[str, str] | None = None, map_path: Path | None = None
) -> tuple[Flight, tuple[str, ...]]:
    """All rows of a flight in any form that `correct` takes, and sentences on what was read as what.

    Parameters and errors as for `to_csv`; `columns` names those of a CSV file too.
    """
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "rows.csv"
        try:
            if read := to_csv(path, made, columns=columns, map_path=map_path):
                return whole_flight(made), (*read.said, *damage_notes(made, read_layout(made)))
        except InputError as error:
            raise type(error)(str(error).replace(str(made), str(path))) from error
    layout = read_layout(path, columns)
    said = [layout.said] if layout.said else []
    return whole_flight(path, columns), (*said, *damage_notes(path, layout))
