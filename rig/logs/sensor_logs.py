"""From a log to its sensors' readings: which rows are a sensor's, and the channels that steps are sought in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import shown
from shockrig.files.numbers import counted
from shockrig.files.spelling import did_you_mean
from shockrig.files.unit_names import EPOCH, UNITS, quantity_of, unit_in_name
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.logs.changes import LogPiece, code_of, noise_of, without_spikes
from shockrig.rig.logs.clock_columns import counted_clock, guess_clock, guess_format, unit_of_clock
from shockrig.rig.logs.log import Column, Log, over_time, read_rows
from shockrig.rig.logs.mapping import LogMap, SensorMap, columns_of
from shockrig.rig.logs.stamps import NUMBERS, TimeColumns
from shockrig.rig.logs.text import Scan, scan, unit_said

Array = NDArray[np.float64]
Index = NDArray[np.intp]

LEAST_STEP = {"temperature": 0.5, "humidity": 2.0}  # K and %RH: below that, rooms do it by themselves
LEAST_SHARE = 0.02  # of the channel's range
LEAST_CODES = 1.5  # of a coarse channel: one code more may be any drift, however slow and small
COARSEST = 2.5  # least steps: what lies farther apart are levels of the air, and no codes
HELD_SHARE = 0.6  # of a channel's changes come at one distance where each reading is repeated that often
HELD_CHANGES = 30


@dataclass(frozen=True)
class LogReadings:
    """What one sensor read in a log: rows of the log, in order of time within each piece, and the columns by key.

    `held` is how often the log repeats each reading (1: not at all); the repeats are left out of `rows`.
    """

    sensor: str
    rows: Index
    values: Mapping[str, Array]  # key of the map -> (n,) for `rows`
    held: int
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class SensorLog:
    """A log read by a map: the log, its sensors' readings, references that are columns included."""

    log: Log
    readings: Mapping[str, LogReadings]

    def channels(self, piece: int, least: Mapping[str, float]) -> list[LogPiece]:
        """The channels of one piece (from 0) in which steps are sought, named SENSOR.KEY."""
        rows = self.log.pieces[piece]
        channels = []
        for name, readings in self.readings.items():
            inside = (readings.rows >= rows.start) & (readings.rows < rows.stop)
            for key in ("temperature", "humidity"):
                if key not in readings.values:
                    continue
                there = np.flatnonzero(inside & np.isfinite(readings.values[key]))
                is_all = there.size == self.log.time_s.size  # not copied then
                value = readings.values[key] if is_all else readings.values[key][there]
                time_s = self.log.time_s if is_all else self.log.time_s[readings.rows[there]]
                if value.size < 4:
                    continue
                # Of the whole range but its outermost readings: one absurd reading must not hide every step.
                low, high = np.quantile(value, [0.002, 0.998])
                threshold = least.get(key, max(least_step(key, value), LEAST_SHARE * float(high - low)))
                noise = noise_of(value)
                time_s, value = without_spikes(time_s, value, noise, threshold)
                channels.append(LogPiece(f"{name}.{key}", key, time_s, value, noise, threshold))
        return channels


def least_step(key: str, value: Array) -> float:
    """The smallest step that readings of a quantity show as one: more than a code of theirs."""
    code = code_of(value)
    return max(LEAST_STEP[key], LEAST_CODES * code if code <= COARSEST * LEAST_STEP[key] else 0.0)


def read_sensors(path: Path, map_: LogMap, scanned: Scan | None = None, guessed: bool = False) -> SensorLog:
    """Read a log by a map; of one that is `guessed` nobody has seen the units.

    Raises
    ------
    BenchError
        Names the file, the column or the key, and the remedy.
    """
    lines = scanned or scan(path, map_.layout)
    sensors = {name: _by_name(columns_of(sensor), lines) for name, sensor in map_.sensors.items()}
    sensors |= _reference_columns(map_, lines)
    columns: dict[str, Column] = {}
    sample = lines.sample()
    for name, of_sensor in sensors.items():
        for key, column in of_sensor.items():
            # A unit that only the header or the cells name is taken from there.
            if name not in map_.sensors or map_.sensors[name].columns[key][1] is None:
                there = column.name in lines.names
                unit = unit_said(lines, lines.names.index(column.name), sample) if there else None
                if unit in UNITS[column.quantity]:
                    column = Column(column.name, column.quantity, str(unit))
            column = replace(column, is_stated=column.is_stated and not guessed)
            of_sensor[key] = column
            if columns.setdefault(column.name, column) != column:
                raise BenchError(
                    f"{shown(map_.path)}: column {column.name!r} is named twice with different quantities or units; "
                    "state one unit for it"
                )
    rows = read_rows(path, map_.layout, list(columns.values()), clock=_clock(map_, lines), scanned=lines)
    del lines, scanned  # the text, which is most of what is held
    log = over_time(rows, map_.stamps)
    del rows
    readings = {}
    for name, of_sensor in sensors.items():
        sensor = map_.sensors.get(name, SensorMap(name, {}))
        readings[name] = _readings(log, sensor, {key: column.name for key, column in of_sensor.items()})
    return SensorLog(log, readings)


def _by_name(columns: Mapping[str, Column], lines: Scan) -> dict[str, Column]:
    """Columns that the map numbers from 1 by their names."""
    named = {}
    for key, column in columns.items():
        name = column.name
        if name not in lines.names and name.isdecimal() and 1 <= int(name) <= len(lines.names):
            name = lines.names[int(name) - 1]
        named[key] = replace(column, name=name)
    return named


def _reference_columns(map_: LogMap, lines: Scan) -> dict[str, dict[str, Column]]:
    """References that are a column's name and not a sensor's, as sensors of that one column."""
    found: dict[str, dict[str, Column]] = {}
    for sensor in map_.sensors.values():
        for name in sensor.reference:
            if name in map_.sensors or name in found:
                continue
            where = f"{shown(map_.path)}: key sensor.{sensor.name}.reference"
            if name not in lines.names:
                meant = did_you_mean(name, [*map_.sensors, *lines.names])
                raise BenchError(f"{where}: no sensor or column {name!r}{meant}")
            unit = unit_in_name(name)
            quantity = quantity_of(name, unit)
            if quantity not in ("temperature", "humidity"):
                raise BenchError(
                    f"{where}: what the column {name!r} measures is not to be seen from its name; give it a "
                    "[sensor.NAME] table and name that"
                )
            found[name] = {quantity: Column(name, quantity, unit or next(iter(UNITS[quantity])))}
    return found


def _clock(map_: LogMap, lines: Scan) -> TimeColumns | None:
    """The clock as far as the map states it; None where it says nothing."""
    if map_.every_s is not None:
        return TimeColumns((), NUMBERS, every_s=map_.every_s)
    if not map_.time and map_.time_format is None and map_.time_unit is None:
        return None
    names = []
    for name in map_.time:
        if name not in lines.names and name.isdecimal() and 1 <= int(name) <= len(lines.names):
            name = lines.names[int(name) - 1]
        if name not in lines.names:
            raise BenchError(f"{shown(map_.path)}: key log.time: no column {name!r}{did_you_mean(name, lines.names)}")
        names.append(name)
    rows = lines.sample()
    guessed = guess_clock(lines.names, rows, lines.units)
    if not names and guessed is None:
        raise BenchError(
            f"{shown(map_.path)}: key log.time: is missing, and {shown(lines.path)} does not show it; add it, or "
            "where no column tells the time, the seconds from row to row, every_s = 1.0"
        )
    columns = tuple(names) or (guessed.columns if guessed else ())
    cells = [
        " ".join(parts) for parts in zip(*([row[lines.names.index(n)] for row in rows] for n in columns), strict=True)
    ]
    format_ = map_.time_format or (NUMBERS if map_.time_unit is not None else None)
    if format_ is None and len(columns) == 1:
        place = lines.names.index(columns[0])
        unit = unit_of_clock(columns[0], lines.units[place])
        if (counted := counted_clock(columns[0], cells, unit, named=True)) is not None:
            return counted
    if format_ is None and guessed is not None and guessed.columns == columns:
        return guessed
    format_ = format_ or guess_format(cells)[0] or NUMBERS
    unit = map_.time_unit
    if format_ == NUMBERS and unit is None:
        said = unit_in_name(columns[0])
        unit = said if said in UNITS["time"] else "s"
    unit = unit or "s"
    first = (cell.split(" ")[0] for cell in cells)
    numbers = [float(cell) for cell in first if cell.replace(".", "", 1).isdecimal()]
    low, high = EPOCH.get(unit, (np.inf, np.inf))
    since_1970 = format_ == NUMBERS and bool(numbers) and bool(low < float(np.median(numbers)) < high)
    return TimeColumns(columns, format_, unit, since_1970)


def _readings(log: Log, sensor: SensorMap, names: Mapping[str, str]) -> LogReadings:
    """Rows of a log that are readings of one sensor."""
    columns = {key: log.values[name] for key, name in names.items()}
    main = [key for key in ("temperature", "humidity") if key in columns]
    there = np.zeros(log.time_s.size, dtype=bool)
    for key in main:
        there |= np.isfinite(columns[key])
    remarks = []
    if sensor.zero_is_missing:
        absent = there & np.all([columns[key] == 0.0 for key in main], axis=0)
        if absent.any():
            what = f"in which {sensor.name} reads nothing but zeros left out"
            remarks.append(f"{counted(int(absent.sum()), 'row')} {what}")
            there &= ~absent
    rows = np.flatnonzero(there)
    values = columns if there.all() else {key: column[rows] for key, column in columns.items()}
    held = sensor.held or held_for(log.time_s[rows], [values[key] for key in main])
    if held > 1:
        keep = _first_of_held([values[key] for key in main], held)
        remarks.append(
            f"{sensor.name}: each reading stands in about {held} rows; the {int((~keep).sum())} repeats are left out"
        )
        rows, values = rows[keep], {key: value[keep] for key, value in values.items()}
    return LogReadings(sensor.name, rows, values, held, tuple(remarks))


def held_for(time_s: Array, columns: list[Array]) -> int:
    """How many rows each reading stands in: 1, or the distance at which nearly all changes follow one another.

    Of rows at the log's usual distance: between rows that were thinned out everything changes.
    """
    size = columns[0].size if columns else 0
    if size < 2:
        return 1
    changed = np.zeros(size - 1, dtype=bool)
    for column in columns:
        changed |= (column[1:] != column[:-1]) & ~(np.isnan(column[1:]) & np.isnan(column[:-1]))
    places = np.flatnonzero(changed)
    distances, off_s = np.diff(places), np.diff(time_s[places + 1])
    period_s = float(np.median(np.diff(time_s), overwrite_input=True))
    off_s -= distances * period_s
    distances = distances[np.abs(off_s, out=off_s) < 0.5 * period_s]
    if distances.size < HELD_CHANGES:
        return 1
    usual = int(np.bincount(distances).argmax())
    # One row more or less: the two clocks are not in step. Twice as far, and so on: a reading was as the one before.
    near = (np.abs(distances - usual * np.maximum(np.rint(distances / usual), 1)) <= 1).mean()
    return usual if usual > 1 and (distances == usual).mean() >= HELD_SHARE and near >= 0.8 else 1


def _first_of_held(columns: list[Array], held: int) -> NDArray[np.bool_]:
    """The rows in which a reading is new: it changed, or it has stood for as long as readings do."""
    size = columns[0].size
    changed = np.ones(size, dtype=bool)
    changed[1:] = np.any([np.diff(column) != 0 for column in columns], axis=0)
    starts = np.flatnonzero(changed)
    since = np.arange(size) - np.repeat(starts, np.diff(np.append(starts, size)))
    return np.asarray(since % held == 0) & (changed | (since >= held))
