"""Flights from and to files: CSV in (columns recognised, cells kept as they came), CSV or CF netCDF out, in bounded
memory.

A file is read in blocks of rows; each block is corrected with a margin of rows on both sides that the smoother's memory
needs, and only its own rows are written. CF conventions 1.11, discrete sampling geometry "trajectory" without
positions.
"""

from __future__ import annotations

import contextlib
import csv
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shockrig.files.errors import InputError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
FLAGS = ("gap", "repeated", "implausible", "outside_profile", "not_corrected")
BLOCK_ROWS = 20_000
ESSENTIAL = ("time", "temperature", "humidity")
MISSING = frozenset(("", "na", "n/a", "null", "none", "-", "--", "---"))  # what loggers write for no value
OUTPUT_COLUMNS = (
    "temperature_corrected_c",
    "temperature_uncertainty_k",
    "humidity_corrected_percent",
    "humidity_uncertainty_percent",
    "flags",
)
# quantity -> names that logs give it, squeezed to letters and digits; the first that is there is taken
NAMES: dict[str, tuple[str, ...]] = {
    "time": (
        "times", "time", "elapsedtimes", "elapsed", "seconds", "timesec", "timeseconds", "timestamp", "unixtime", "t",
        "timeus", "timems", "timestampms", "datetime", "datetimeutc", "utctime", "timeutc", "xqimetxqtime",
    ),
    "temperature": (
        "temperaturec", "airtemperaturec", "temperature", "airtemperature", "xqimetxqairtemperature", "tdry", "temp",
        "tempc", "airtemp", "beadtemperaturec", "imettemperature", "temperaturedegc", "temperaturek", "tempk", "t1",
    ),
    "humidity": (
        "humiditypercent", "relativehumiditypercent", "humidity", "relativehumidity", "xqimetxqhumidity", "rh",
        "rhpercent", "relhum", "rhum", "hum", "h1",
    ),
    "die": (
        "humiditysensortemperaturec", "humiditytemperaturec", "humiditytemp", "xqimetxqhumiditytemp", "dietemperaturec",
        "rhtemperature", "rhtemp", "rht", "rhsensortemperature", "humiditysensortemp",
    ),
    "airspeed": ("airspeedms", "airspeed", "tas", "trueairspeed", "arsp", "airspeedmps"),
    "pressure": ("pressurehpa", "pressure", "xqimetxqpressure", "pres", "press", "pressurepa", "p", "airpressure"),
    "altitude": ("altitudem", "altitude", "xqimetxqaltitude", "alt", "height", "altagl", "altmsl", "z", "gpsaltitude"),
}  # fmt: skip
XQ2_FIELDS = (
    "device", "pressure", "temperature", "humidity", "humidity_temp", "date", "time", "longitude", "latitude",
    "altitude", "satellites",
)  # fmt: skip

EARLIEST_DATE_S = 5e8  # a clock that says more counts from 1970 (this is 1985)


@dataclass(frozen=True)
class Flight:
    """Rows of a log: arrays (n,), NaN where a value is missing; `temperature_c` the bead's, `humidity_percent` the
    film's."""

    time_s: Array
    temperature_c: Array
    humidity_percent: Array
    airspeed_m_s: Array
    die_temperature_c: Array


@dataclass(frozen=True)
class Corrected:
    """Rows as they came; NaN where a value cannot be given; uncertainties are one standard uncertainty.

    `cutoff_hz`: low-pass of each corrected channel, None where the method has none.
    """

    temperature_c: Array
    temperature_uncertainty_k: Array
    humidity_percent: Array
    humidity_uncertainty_percent: Array
    flags: dict[str, Mask]
    notes: tuple[str, ...] = field(default=())
    cutoff_hz: dict[str, float | None] = field(default_factory=dict)

    def flag_texts(self) -> list[str]:
        """For each row its flags joined by "|", empty where there is none."""
        names = [name for name in FLAGS if self.flags[name].any()]
        stacked = zip(*(self.flags[name] for name in names), strict=True) if names else ()
        texts = ["|".join(n for n, on in zip(names, row, strict=True) if on) for row in stacked]
        return texts or [""] * self.temperature_c.size


@dataclass(frozen=True)
class Layout:
    """Columns of a log: `header`, for each quantity the place of its column, and the factor of its clock to seconds."""

    header: tuple[str, ...]
    place: Mapping[str, int]
    source: str
    date_place: int | None = None
    raw_xq2: bool = False


def squeeze(name: str) -> str:
    """A column's name without case, blanks, signs and units' brackets: "Air Temperature (degC)" ->
    "airtemperaturedegc".
    """
    return re.sub(r"[^a-z0-9]", "", name.lower().replace("°", "").replace("%", "percent"))


def _listed(header: list[str]) -> str:
    """The header's names, as far as they can be shown on a line."""
    names = ", ".join(name if name.isprintable() else repr(name) for name in header)
    return f"columns: {names[:200]}{'...' if len(names) > 200 else ''}"


def read_layout(path: Path, chosen: Mapping[str, str] | None = None) -> Layout:
    """Find the columns of a log.

    Parameters
    ----------
    path : Path
    chosen : mapping, optional
        quantity (a key of NAMES) -> the column's name as in the file, where it cannot be recognised.

    Raises
    ------
    InputError
        No header, no time, neither temperature nor humidity, a chosen column that is not there.
    """
    chosen = dict(chosen or {})
    try:
        with open(path, newline="", encoding="utf-8-sig", errors="replace") as stream:
            header = next(csv.reader(_clean(stream)), None)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; name a flight's CSV file") from error
    except csv.Error as error:
        raise InputError(f"{path}: line 1: {error}; give a CSV file") from error
    if not header:
        raise InputError(f"{path}: the file is empty; give a CSV file with a header line")
    if header[0].strip().upper() == "XQ" and len(header) == len(XQ2_FIELDS):
        place = {"time": 6, "temperature": 2, "humidity": 3, "die": 4, "pressure": 1, "altitude": 9}
        return Layout(XQ2_FIELDS, place, str(path), date_place=5, raw_xq2=True)
    header = [name.strip() for name in header]
    taken = sorted(set(header) & set(OUTPUT_COLUMNS))
    if taken:
        raise InputError(
            f"{path}: line 1: column {taken[0]!r} is there already; give the log as it was before correction"
        )
    place = {}
    for quantity, names in NAMES.items():
        if quantity in chosen:
            if chosen[quantity] not in header:
                raise InputError(
                    f"{path}: line 1: no column {chosen[quantity]!r} for {quantity}; there are {', '.join(header)}"
                )
            place[quantity] = header.index(chosen[quantity])
            continue
        squeezed = [re.sub(r"(degc|celsius)$", "c", squeeze(name)) for name in header]
        found = next((squeezed.index(name) for name in names if name in squeezed), None)
        if found is not None:
            place[quantity] = found
    if "time" not in place:
        raise InputError(
            f"{path}: line 1: no column of time recognised ({_listed(header)}); name it with --column time=NAME"
        )
    if "temperature" not in place and "humidity" not in place:
        raise InputError(
            f"{path}: line 1: neither temperature nor humidity recognised ({_listed(header)}); "
            "name them with --column temperature=NAME --column humidity=NAME"
        )
    squeezed = [squeeze(name) for name in header]
    date = next((squeezed.index(n) for n in ("xqimetxqdate", "date", "dateutc") if n in squeezed), None)
    return Layout(tuple(header), place, str(path), date if "time" in squeezed[place["time"]] else None)


def read_blocks(path: Path, layout: Layout, rows: int = BLOCK_ROWS) -> Iterator[list[list[str]]]:
    """The file's rows as text, `rows` at a time; short rows are filled with empty cells."""
    found = (_filled(row, layout) for _, row in _numbered_rows(path, layout))
    while block := list(islice(found, rows)):
        yield block


def _numbered_rows(path: Path, layout: Layout) -> Iterator[tuple[int, list[str]]]:
    """Number of the line and cells of every row under the header that is not empty."""
    width = len(layout.header)
    with open(path, newline="", encoding="utf-8-sig", errors="replace") as stream:
        reader = csv.reader(_clean(stream))
        try:
            if not layout.raw_xq2:
                next(reader)
            for row in reader:
                if len(row) > width:
                    raise InputError(
                        f"{path}: line {reader.line_num}: {len(row)} cells under {width} columns; "
                        "mend or delete the line"
                    )
                if row:
                    yield reader.line_num, row
        except csv.Error as error:
            raise InputError(f"{path}: line {reader.line_num}: {error}; mend or delete the line") from error


def _filled(row: list[str], layout: Layout) -> list[str]:
    return row + [""] * (len(layout.header) - len(row))


@dataclass(frozen=True)
class Damage:
    """How much of a log can be read: `rows` in all, those that are `damaged` (too short, or text where a number
    belongs), and those that are `lost` (their time, temperature or humidity is what is damaged); where each begins.
    """

    rows: int
    damaged: int
    first_damaged: str
    lost: int
    first_lost: str


def look_over(path: Path, layout: Layout) -> Damage:
    """Count the rows that cannot be read as numbers. An empty cell and what loggers write for one is no damage."""
    named = 1 + max((place for place, name in enumerate(layout.header) if name), default=0)
    count, firsts, total = [0, 0], ["", ""], 0
    found = _numbered_rows(path, layout)
    while block := list(islice(found, BLOCK_ROWS)):
        columns = list(zip(*(_filled(row, layout) for _, row in block), strict=True))
        lengths = np.array([len(row) for _, row in block])
        texts = {quantity: _text_cells(columns, layout, quantity) for quantity in layout.place}
        damaged = np.logical_or.reduce([lengths < named, *texts.values()])
        lost = np.logical_or.reduce(
            [texts[quantity] | (lengths <= layout.place[quantity]) for quantity in ESSENTIAL if quantity in texts]
        )
        for i, mask in enumerate((damaged, lost)):
            if mask.any() and not count[i]:
                row = int(np.argmax(mask))
                place = next((layout.place[quantity] for quantity, text in texts.items() if text[row]), None)
                cells = f"{lengths[row]} of {named} cells"
                what = cells if place is None else f"{layout.header[place]} is {repr(columns[place][row])[:40]}"
                firsts[i] = f"line {block[row][0]}: {what}"
            count[i] += int(np.count_nonzero(mask))
        total += len(block)
    return Damage(total, count[0], firsts[0], count[1], firsts[1])


def _text_cells(columns: list[tuple[str, ...]], layout: Layout, quantity: str) -> NDArray[np.bool_]:
    """True where a cell is neither a number (of the time: nor a date) nor empty."""
    cells = columns[layout.place[quantity]]
    unread = np.isnan(_times(columns, layout) if quantity == "time" else _numbers(cells))
    for row in np.flatnonzero(unread).tolist():
        unread[row] = cells[row].strip().lower() not in MISSING and not _is_float(cells[row])
    return unread


def _clean(stream: Iterable[str]) -> Iterator[str]:
    """Lines without the NUL bytes that loggers leave when power fails."""
    return (line.replace("\0", "") for line in stream)


def to_flight(rows: list[list[str]], layout: Layout) -> Flight:
    """Numbers of some rows; what is no number is missing. Units are brought to s, degC, %RH, m/s by name and by
    size.
    """
    columns = list(zip(*rows, strict=True)) if rows else [()] * len(layout.header)

    def numbers(quantity: str) -> Array:
        if quantity not in layout.place:
            return np.full(len(rows), np.nan)
        return _numbers(columns[layout.place[quantity]])

    temperature, humidity, die = numbers("temperature"), numbers("humidity"), numbers("die")
    if layout.raw_xq2:
        temperature, humidity, die = temperature / 100, humidity / 10, die / 100
    else:
        for quantity, values in (("temperature", temperature), ("die", die)):
            name = squeeze(layout.header[layout.place[quantity]]) if quantity in layout.place else ""
            if name.endswith(("kelvin", "temperaturek", "tempk")):
                values -= 273.15
    return Flight(_times(columns, layout), temperature, humidity, numbers("airspeed"), die)


def numeric_places(path: Path, layout: Layout) -> frozenset[int]:
    """Columns of a log in which every cell is a number or empty, and not all are empty."""
    places, filled = set(range(len(layout.header))), set()
    for rows in read_blocks(path, layout):
        for place, cells in enumerate(zip(*rows, strict=True)):
            told = [cell for cell in cells if cell.strip()]
            if told:
                filled.add(place)
            if place in places and np.isnan(_numbers(told)).any():
                places.discard(place)
    return frozenset(places & filled)


def _numbers(cells: Iterable[str]) -> Array:
    cells = list(cells)
    try:
        values = np.array(cells, dtype=float)
    except ValueError:
        values = np.array([_number(cell) for cell in cells])
    values[~np.isfinite(values)] = np.nan
    return values


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _is_float(cell: str) -> bool:
    """Also "nan" and what is beyond every number: absurd, but not damaged."""
    try:
        float(cell)
        return True
    except ValueError:
        return False


def _times(columns: list[tuple[str, ...]], layout: Layout) -> Array:
    """Seconds, from a number (s, ms or us by the column's name) or a date and time."""
    place = layout.place["time"]
    cells = columns[place]
    values = _numbers(cells)
    if len(cells) and np.isnan(values).mean() > 0.5:
        import pandas as pd

        text = pd.Series(cells, dtype=str)
        if layout.date_place is not None and layout.date_place != place:
            text = pd.Series(columns[layout.date_place], dtype=str).str.strip() + " " + text.str.strip()
        try:
            stamps = pd.to_datetime(text, errors="coerce", utc=True, format="mixed")
            return (stamps - pd.Timestamp(0, tz="UTC")).dt.total_seconds().to_numpy(dtype=float)
        except (ValueError, OverflowError) as error:  # a year that cannot be is not always made a missing time
            raise InputError(f"{layout.source}: times cannot be read as dates ({error}); mend that row") from error
    name = squeeze(layout.header[place])
    scale = 1e-6 if name.endswith("us") and name != "status" else 1e-3 if name.endswith(("timems", "stampms")) else 1.0
    return values * scale


def text_columns(corrected: Corrected) -> list[list[str]]:
    """OUTPUT_COLUMNS as text, a value that cannot be given empty."""
    numbers = (
        (corrected.temperature_c, "%.4f"),
        (corrected.temperature_uncertainty_k, "%.4f"),
        (corrected.humidity_percent, "%.4f"),
        (corrected.humidity_uncertainty_percent, "%.4f"),
    )
    columns = [["" if value != value else form % value for value in values.tolist()] for values, form in numbers]
    return [*columns, corrected.flag_texts()]


class CsvWriter:
    """The log's own rows with OUTPUT_COLUMNS after them; `close` puts the whole file in its place, `discard` leaves
    none.
    """

    def __init__(self, path: Path, layout: Layout) -> None:
        self.path, self._temporary = path, path.with_name(f".{path.name}.{os.getpid()}.part")
        self._stream = open(self._temporary, "w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._stream, lineterminator="\n")
        self._writer.writerow([*layout.header, *OUTPUT_COLUMNS])

    def write(self, rows: list[list[str]], flight: Flight, corrected: Corrected) -> None:
        columns = text_columns(corrected)
        self._writer.writerows([*row, *new] for row, new in zip(rows, zip(*columns, strict=True), strict=True))

    def close(self) -> None:
        self._stream.close()
        os.replace(self._temporary, self.path)

    def discard(self) -> None:
        # On a full disk closing fails as well; what was begun goes all the same.
        with contextlib.suppress(OSError):
            self._stream.close()
        self._temporary.unlink(missing_ok=True)


class NetcdfWriter:
    """The same content as CF netCDF: numbers as numbers, text columns as strings, flags as bits."""

    STANDARD = {
        "temperature": ("temperature_c", "degC", "temperature of the bead as read"),
        "humidity": ("humidity_percent", "%", "relative humidity of the film as read"),
        "airspeed": ("airspeed_m_s", "m s-1", "speed of the air past the probes"),
        "pressure": ("pressure_hpa", None, "air pressure"),  # units as the column's name says
        "altitude": ("altitude_m", None, "altitude"),
        "die": ("humidity_sensor_temperature_c", "degC", "temperature of the humidity sensor's die"),
    }
    STANDARD_NAMES = {"pressure": "air_pressure", "altitude": "altitude", "airspeed": "platform_speed_wrt_air"}
    ENDINGS = {"pressure": {"hpa": "hPa", "mbar": "hPa", "pa": "Pa"}, "altitude": {"m": "m"}}
    CORRECTED = (
        ("temperature_corrected_c", "temperature_c", "air_temperature", "degC", "air temperature, sensor lag undone"),
        (
            "temperature_uncertainty_k",
            "temperature_uncertainty_k",
            "air_temperature standard_error",
            "K",
            "standard uncertainty",
        ),
        (
            "humidity_corrected_percent",
            "humidity_percent",
            "relative_humidity",
            "%",
            "relative humidity, sensor lag undone",
        ),
        (
            "humidity_uncertainty_percent",
            "humidity_uncertainty_percent",
            "relative_humidity standard_error",
            "%",
            "standard uncertainty",
        ),
    )

    def __init__(self, path: Path, layout: Layout, history: str) -> None:
        import netCDF4

        self.path, self._temporary = path, path.with_name(f".{path.name}.{os.getpid()}.part")
        self._layout = layout
        self._set = netCDF4.Dataset(self._temporary, "w", format="NETCDF4")
        data = self._set
        data.Conventions, data.title, data.history = "CF-1.11", "Flight corrected for sensor lag", history
        data.source = f"thermo-hygrometer log {Path(layout.source).name}"
        data.createDimension("row", None)
        self._names: list[str] = []
        self._text: list[bool] = []
        data.createVariable("time", "f8", ("row",), zlib=True).long_name = "time of the sample"
        by_place = {place: quantity for quantity, place in layout.place.items()}
        numeric = numeric_places(Path(layout.source), layout)
        for place, column in enumerate(layout.header):
            name = self._free_name(column)
            self._names.append(name)
            quantity = by_place.get(place)
            known = quantity in self.STANDARD and not layout.raw_xq2
            self._text.append(not known and place not in numeric)
            if self._text[-1]:
                variable = data.createVariable(name, str, ("row",))
                variable.long_name = f"column {column} of the log, as it came"
            elif known:
                _, unit, words = self.STANDARD[quantity]
                unit = unit or self._unit_in_name(quantity, column)
                variable = self._number(name, unit, words)
                if unit and quantity == "altitude":
                    variable.positive = "up"
                if unit and quantity in self.STANDARD_NAMES:
                    variable.standard_name = self.STANDARD_NAMES[quantity]
            else:
                self._number(name, None, f"column {column} of the log, as it came")
        for name, _, standard, unit, words in self.CORRECTED:
            variable = self._number(name, unit, words)
            variable.standard_name = standard
        data["temperature_corrected_c"].ancillary_variables = "temperature_uncertainty_k flags"
        data["humidity_corrected_percent"].ancillary_variables = "humidity_uncertainty_percent flags"
        flags = data.createVariable("flags", "i1", ("row",))
        flags.long_name, flags.standard_name = "what is special about a row", "quality_flag"
        flags.flag_masks = np.array([1 << i for i in range(len(FLAGS))], dtype="i1")
        flags.flag_meanings = " ".join(FLAGS)

    def _number(self, name: str, unit: str | None, words: str):
        variable = self._set.createVariable(name, "f8", ("row",), fill_value=np.nan, zlib=True)
        variable.long_name = words
        if unit:
            variable.units = unit
        return variable

    def _unit_in_name(self, quantity: str, column: str) -> str | None:
        endings = self.ENDINGS.get(quantity, {})
        return next((unit for ending, unit in endings.items() if squeeze(column).endswith(ending)), None)

    def _date(self, first_s: float) -> None:
        """Time since 1970 is a time coordinate; a clock that starts at the flight has no date to count from."""
        time = self._set["time"]
        if first_s < EARLIEST_DATE_S:
            time.units = "s"
            return
        time.units, time.standard_name, time.calendar = "seconds since 1970-01-01 00:00:00", "time", "standard"
        for variable in self._set.variables.values():
            if variable.name != "time":
                variable.coordinates = "time"

    def _free_name(self, column: str) -> str:
        base = re.sub(r"[^A-Za-z0-9_]", "_", column) or "column"
        base = base if base[0].isalpha() else f"c_{base}"
        own = {"time", "flags", *(entry[0] for entry in self.CORRECTED)}
        name, count = base if base not in own else f"{base}_log", 1
        while name in self._names:
            name, count = f"{base}_{count + 1}", count + 1
        return name

    def write(self, rows: list[list[str]], flight: Flight, corrected: Corrected) -> None:
        data, start = self._set, len(self._set.dimensions["row"])
        if start == 0:
            self._date(float(np.nanmin(flight.time_s)))
        part = slice(start, start + len(rows))
        data["time"][part] = flight.time_s
        for name, is_text, cells in zip(self._names, self._text, zip(*rows, strict=True), strict=True):
            data[name][part] = np.array(cells, dtype=object) if is_text else _numbers(cells)
        for name, attribute, *_ in self.CORRECTED:
            data[name][part] = getattr(corrected, attribute)
        data["flags"][part] = sum(
            (corrected.flags[name].astype("i1") << i for i, name in enumerate(FLAGS)), np.zeros(len(rows), "i1")
        )

    def close(self) -> None:
        self._set.close()
        os.replace(self._temporary, self.path)

    def discard(self) -> None:
        with contextlib.suppress(OSError, RuntimeError):
            self._set.close()
        self._temporary.unlink(missing_ok=True)
