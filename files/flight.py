"""A flight as its files hold it: rows of a log, the same rows corrected, and the columns of a log, recognised by name.

flight_rows reads the rows, flight_csv and flight_netcdf write them corrected.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from itertools import islice
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import open_text, shown
from shockrig.files.errors import InputError
from shockrig.files.flight_intermet import clock_of
from shockrig.files.flight_known import KnownLog, day_of, known_log
from shockrig.files.numbers import first_of
from shockrig.files.readings_figure import Against, plot_readings
from shockrig.files.sentinels import NO_VALUE_WORDS
from shockrig.files.unit_names import (
    UNITS,
    UnitError,
    bare_name,
    outside_name,
    quantity_of,
    rest_of_second,
    squeeze,
    unique_names,
    unit_among,
    unit_of_column,
)
from shockrig.files.views import card, require_xarray

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
REMEDY = "name a flight's CSV file"
FLAGS = (
    "gap", "repeated", "implausible", "outside_profile", "not_corrected", "temperature_not_corrected",
    "humidity_not_corrected",
)  # fmt: skip
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
        "times", "time", "elapsedtimes", "elapsed", "seconds", "timesec", "timeseconds", "timestamp", "unixtime",
        "timeus", "timems", "timestampms", "datetime", "datetimeutc", "utctime", "timeutc", "xqimetxqtime", "t",
    ),
    "temperature": (
        "temperaturec", "airtemperaturec", "temperature", "airtemperature", "xqimetxqairtemperature", "tdry", "temp",
        "tempc", "airtemp", "beadtemperaturec", "imettemperature", "temperaturedegc", "temperaturek", "tempk", "t1",
        "t",
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
    "latitude": ("latitudedeg", "latitude", "lat", "xqimetxqlatitude", "gpslatitude", "gpslat", "latgps"),
    "longitude": (
        "longitudedeg", "longitude", "lon", "lng", "long", "xqimetxqlongitude", "gpslongitude", "gpslon", "gpslng",
        "gpslong", "longps",
    ),
    "altitude": (
        "altitudem", "altitude", "xqimetxqaltitude", "alt", "height", "altagl", "altmsl", "altitudeasl", "altitudeagl",
        "altitudemsl", "z", "gpsaltitude", "gpsalt", "altgps", "hght", "hgt", "gph", "geopotentialheight", "heightmsl",
        "heightasl", "heightagl", "altitudegps", "baroaltitude", "altitudebaro", "barometricaltitude", "baroalt",
        "barometeraltitude", "barometeralt", "pressurealtitude", "hgtmsl",
    ),
    "vertical_speed": (
        "verticalspeedms", "verticalspeed", "risespeedms", "risespeed", "climbratems", "climbrate", "vspeed",
    ),
}  # fmt: skip
OF_AIR = ("temperature", "humidity", "pressure")  # of which a logger may have its own
FURTHEST_HEADER = 60  # lines of metadata above the names
INTERMET = "COM Elapse"  # a column that only the log of InterMet's application has
XQ2_FIELDS = (
    "device", "pressure", "temperature", "humidity", "humidity_temp", "date", "time", "longitude", "latitude",
    "altitude", "satellites",
)  # fmt: skip


# quantity -> the key of UNITS that its units are those of
KIND_OF = {
    "time": "time", "temperature": "temperature", "humidity": "humidity", "die": "temperature", "airspeed": "airflow",
    "pressure": "pressure", "altitude": "altitude", "vertical_speed": "airflow",
}  # fmt: skip
SHORTEST_NAME = 2  # letters, that a unit behind tells from another word


UNIT_OF = {  # of each quantity of a flight
    "temperature_c": "degC", "humidity_percent": "%", "airspeed_m_s": "m s-1", "die_temperature_c": "degC",
    "pressure_hpa": "hPa", "altitude_m": "m", "latitude_deg": "degrees_north", "longitude_deg": "degrees_east",
    "vertical_speed_m_s": "m s-1",
}  # fmt: skip


@dataclass(frozen=True, repr=False)
class Flight:
    """Rows of a log: arrays (n,), NaN where a value is missing; `temperature_c` the bead's, `humidity_percent` the
    film's. What says where the drone was, and how fast it rose, is None in a log without it."""

    time_s: Array
    temperature_c: Array
    humidity_percent: Array
    airspeed_m_s: Array
    die_temperature_c: Array
    pressure_hpa: Array
    altitude_m: Array | None = None
    latitude_deg: Array | None = None
    longitude_deg: Array | None = None
    vertical_speed_m_s: Array | None = None

    def at(self, rows: slice | NDArray[np.int64]) -> Flight:
        """Some of the rows."""
        cut: dict[str, Any] = {}
        for one in fields(self):
            values = getattr(self, one.name)
            cut[one.name] = None if values is None else values[rows]
        return Flight(**cut)

    def to_frame(self) -> pd.DataFrame:
        """One row for each of the log's, a column for each quantity that it has."""
        import pandas as pd

        return pd.DataFrame({name: getattr(self, name) for name in ("time_s", *self._known())})

    def to_xarray(self) -> xr.Dataset:
        """The same as labelled arrays over time [s], with units."""
        arrays = {name: ("time", getattr(self, name), {"units": UNIT_OF[name]}) for name in self._known()}
        return require_xarray().Dataset(arrays, {"time": ("time", self.time_s, {"units": "s"})})

    def plot(self, against: Against = "time") -> Figure:
        """The readings against "time" or "altitude"."""
        return plot_readings(self.time_s, self.temperature_c, self.humidity_percent, self.altitude_m, against)

    def _known(self) -> list[str]:
        """Quantities of which the log has any value."""
        return [name for name in UNIT_OF if (v := getattr(self, name)) is not None and np.isfinite(v).any()]

    def _facts(self) -> list[tuple[str, str]]:
        return [("rows", str(self.time_s.size)), ("has", ", ".join(self._known()) or "nothing")]

    def __repr__(self) -> str:
        return f"<Flight: {'; '.join(f'{name} {value}' for name, value in self._facts())}>"

    def _repr_html_(self) -> str:
        return card("Flight", self._facts(), self.to_frame(), rows=5)


@dataclass(frozen=True)
class Corrected:
    """Rows as they came; NaN where a value cannot be given; uncertainties are one standard uncertainty.

    `cutoff_hz`: low-pass of each corrected channel, None where the method has none. `common`: of each channel, the part
    of its uncertainty that is common to the flight, which no mean takes out; the rest is independent after
    `independent_after_s`. `widened`: by how much a channel's time scale turned out to be less certain than the profile
    says, relative; `slower`: by how much a channel's sensor turned out to be slower than that, and was corrected with.
    """

    temperature_c: Array
    temperature_uncertainty_k: Array
    humidity_percent: Array
    humidity_uncertainty_percent: Array
    flags: dict[str, Mask]
    notes: tuple[str, ...] = field(default=())
    cutoff_hz: dict[str, float | None] = field(default_factory=dict)
    common: dict[str, Array] = field(default_factory=dict)
    independent_after_s: dict[str, float] = field(default_factory=dict)
    widened: dict[str, float] = field(default_factory=dict)
    slower: dict[str, float] = field(default_factory=dict)

    def at(self, rows: slice | NDArray[np.int64]) -> Corrected:
        """Some of the rows, or all of them in another order."""
        cut: dict[str, Any] = {
            name: getattr(self, name)[rows]
            for name in (
                "temperature_c", "temperature_uncertainty_k", "humidity_percent", "humidity_uncertainty_percent"
            )
        }  # fmt: skip
        cut["flags"] = {name: mask[rows] for name, mask in self.flags.items()}
        return replace(self, **cut, common={name: values[rows] for name, values in self.common.items()})

    def flag_texts(self) -> list[str]:
        """For each row its flags joined by "|", empty where there is none."""
        code = np.zeros(self.temperature_c.size, dtype=np.int64)
        for place, name in enumerate(FLAGS):
            code |= self.flags[name].astype(np.int64) << place
        said, row = np.unique(code, return_inverse=True)
        texts = ["|".join(name for place, name in enumerate(FLAGS) if one >> place & 1) for one in said.tolist()]
        return [texts[one] for one in row.tolist()]


@dataclass(frozen=True)
class FlightColumns:
    """Columns of a log: `header` and for each quantity the place of its column; "rest" is what is left of the seconds
    that the time counts.

    `zero_is_missing`: it is InterMet's application's, which writes zeros where nothing is connected. `known`: it is a
    log whose columns are known. `begins_s`: when its first row was read [s since 1970], of times of day without a date.
    `said`: what was read as what, a sentence. `units`: of a quantity, as its column's name states it, where it is not
    the project's own.
    """

    header: tuple[str, ...]
    place: Mapping[str, int]
    source: str
    date_place: int | None = None
    raw_xq2: bool = False
    zero_is_missing: bool = False
    known: KnownLog | None = None
    begins_s: float | None = None
    said: str = ""
    units: Mapping[str, str] = field(default_factory=dict)


class LayoutError(InputError):
    """A log that is no CSV file whose columns are recognised; it may be one of another layout."""


def _plain(name: str) -> str:
    """A column's name without its unit's spelling, and without the port that InterMet's application puts before it."""
    return re.sub(r"(degc|celsius)$", "c", squeeze(re.sub(r"^\S+-iMet-XQ2? ", "XQ-iMet-XQ ", name)))


def _listed(header: Sequence[str]) -> str:
    """The header's names, as far as they can be shown on a line."""
    names = ", ".join(name if name.isprintable() else repr(name) for name in header)
    return f"columns: {names[:200]}{'...' if len(names) > 200 else ''}"


def _remedy(path: Path) -> str:
    """What helps a log whose first line names no time: it may be metadata, or a row already."""
    lines: list[list[str]] = []
    with open_text(path, REMEDY, errors="replace") as stream, suppress(csv.Error):  # a cell without an end
        lines += islice(csv.reader(without_nul(stream)), FURTHEST_HEADER)
    by_map = "read it by a map: shockrig import FILE --look writes one, --map takes it"
    for number, cells in enumerate(lines, start=1):
        if len({quantity for quantity, names in NAMES.items() if any(_plain(cell) in names for cell in cells)}) > 2:
            return f"the names seem to stand in line {number}: {by_map}"
    words = [cell for cell in lines[0] if cell.strip().lower() not in (*NO_VALUE_WORDS, "nan")] if lines else []
    if words and re.search(r"\d", words[0]) and not any(re.search(r"[A-Za-z]{2}", cell) for cell in words):
        return (
            "it seems to have no line of names: read it by a map with header_line = 0, which numbers its columns "
            "(docs/importing.md shows one); --map takes it"
        )
    return "name it with --column time=NAME"


def read_layout(path: Path, chosen: Mapping[str, str] | None = None) -> FlightColumns:
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
    header = _header(path)
    if header[0].strip().upper() == "XQ" and len(header) == len(XQ2_FIELDS):
        place = {
            "time": 6,
            "temperature": 2,
            "humidity": 3,
            "die": 4,
            "pressure": 1,
            "altitude": 9,
            "latitude": 8,
            "longitude": 7,
        }
        return FlightColumns(XQ2_FIELDS, place, str(path), date_place=5, raw_xq2=True)
    header = [name.strip() for name in header]
    if len(header) == 1 and re.search(r"[;\t|]", header[0]):
        raise LayoutError(
            f"{shown(path)}, line 1: its columns are not parted by commas ({_listed(header)}); read it by a map: "
            "shockrig import FILE --look writes one, --map takes it"
        )
    taken = sorted(set(header) & set(OUTPUT_COLUMNS))
    if taken:
        raise InputError(
            f"{shown(path)}, line 1: column {taken[0]!r} is there already; give the log as it was before correction"
        )
    log = known_log(header)
    place, emptied = _filled_places(path, header, chosen, log)
    if log is not None:
        begins_s, dated = _first_row(path, place["time"])
        return FlightColumns(
            tuple(header), place, str(path), known=log, begins_s=begins_s, said=log.sentence(place, header) + dated
        )
    squeezed = [_plain(name) for name in header]
    own = {
        quantity: squeezed.index(f"xqimetxq{quantity}")
        for quantity in ("date", "time")
        if f"xqimetxq{quantity}" in squeezed
    }
    place["time"], date = _clock(path, squeezed, place["time"], own, "time" in chosen)
    intermet = INTERMET in header or any("-iMet-" in name for name in header)
    said = ""
    if intermet:
        whose = "the sensor's own" if place["time"] == own.get("time") else "the application's"
        said = f"read as a log of InterMet's application: the clock is {whose}, {header[place['time']]!r}"
    units = _units(path, header, place, chosen)
    if (rest := rest_of_second(header, place["time"])) is not None:
        place["rest"], units["rest"] = rest
    named = [(quantity, unit) for quantity, unit in units.items() if quantity not in ("time", "rest")]
    if converted := [f"{quantity} {header[place[quantity]]!r} is in {unit}" for quantity, unit in named]:
        said = "; ".join([*([said] if said else []), f"{', '.join(converted)}, and converted"])
    several = [one for one in ("temperature", "humidity") if one in place and one not in chosen]
    said = "; ".join(filter(None, [said, *emptied, *(_one_of(one, header, place) for one in several)]))
    return FlightColumns(tuple(header), place, str(path), date, zero_is_missing=intermet, said=said, units=units)


def also_called(quantity: str, header: Sequence[str], place: Mapping[str, int]) -> list[str]:
    """Columns that may be a quantity's by their names, and are not taken for anything."""
    taken, named = set(place.values()), unique_names(header)
    others = [k for k, name in enumerate(header) if quantity_of(name, unit_among(name, header)) == quantity]
    return [named[k] for k in others if k not in taken]


def _one_of(quantity: str, header: Sequence[str], place: Mapping[str, int]) -> str:
    """A sentence on which of several columns is taken; empty where there is no other."""
    others = also_called(quantity, header, place)
    return f"{quantity} {header[place[quantity]]!r} is taken, {others_said(quantity, others)}" if others else ""


def others_said(quantity: str, others: Sequence[str]) -> str:
    """The end of a sentence that names what else may be a quantity, and how to take it."""
    return f"and not {first_of([repr(one) for one in others])}: --column {quantity}=NAME takes another"


def _units(path: Path, header: list[str], place: Mapping[str, int], chosen: Mapping[str, str]) -> dict[str, str]:
    """Of each quantity whose column names another unit than the project's, that unit; InputError where it names one
    that is not known and nobody chose it."""
    units = {}
    for quantity, kind in KIND_OF.items():
        if quantity not in place:
            _demand_none(path, header, set(place.values()), quantity)
            continue
        try:
            unit = unit_of_column(kind, header[place[quantity]], NAMES[quantity])
        except UnitError as error:
            if quantity not in chosen and quantity != "time":
                raise InputError(_unread(path, quantity, header[place[quantity]], str(error))) from None
            continue
        if unit is not None and UNITS[kind][unit] != (1.0, 0.0):
            units[quantity] = unit
    return units


def _demand_none(path: Path, header: list[str], taken: set[int], quantity: str) -> None:
    """InputError where a column would be a quantity's but for a unit in its name that is not known."""
    for k, name in enumerate(header):
        if k not in taken and (bare := squeeze(bare_name(name))) in NAMES[quantity] and len(bare) >= SHORTEST_NAME:
            if unit := unread_unit(quantity, name):
                raise InputError(_unread(path, quantity, name, unit))


def _unread(path: Path, quantity: str, name: str, unit: str) -> str:
    known = tuple(UNITS[KIND_OF[quantity]])
    return (
        f"{shown(path)}, line 1: column {name!r}: {unit!r} is no unit of {quantity} that is known "
        f"({', '.join(known)}); convert the column and rename it, or say with --column {quantity}=NAME that it is in "
        f"{known[0]}"
    )


def unread_unit(quantity: str, name: str) -> str | None:
    """What stands in a column's name as a unit and is none of a quantity's; None where nothing does."""
    try:
        unit_of_column(KIND_OF[quantity], name)
    except UnitError as error:
        return str(error)
    return None


def _clock(path: Path, names: list[str], time: int, own: Mapping[str, int], chosen: bool) -> tuple[int, int | None]:
    """Columns of the time and its date: of a log of InterMet's application, the clock (its own or the sensor's) that
    goes with the readings, unless the time was chosen."""
    date = next((names.index(n) for n in ("date", "dateutc", "utcdate") if n in names), None)
    if time == own.get("time"):
        date = own.get("date", date)
    elif "time" in own and not chosen:
        with open_text(path, REMEDY, errors="replace") as stream:
            time, of_own = clock_of(islice(without_nul(stream), 1, None), time, own["time"], own.get("date"))
        date = date if of_own is None else of_own
    return time, date if "time" in names[time] else None


def _header(path: Path) -> list[str]:
    """The first row of a log; InputError where there is none, or nothing in it."""
    try:
        with open_text(path, REMEDY, errors="replace") as stream:
            header = next(csv.reader(without_nul(stream)), None)
    except csv.Error as error:
        raise InputError(f"{shown(path)}, line 1: {error}; give a CSV file") from error
    if header is None:
        raise InputError(f"{shown(path)}: the file is empty; give a CSV file with a header line")
    if not header:
        raise LayoutError(f"{shown(path)}, line 1: is blank, where the names belong; give a CSV file with names")
    return header


def _filled_places(
    path: Path, header: list[str], chosen: Mapping[str, str], log: KnownLog | None
) -> tuple[dict[str, int], list[str]]:
    """Which column holds which quantity (`_places`), of several by name the first that holds anything at all; and a
    sentence for each that does not."""
    place = _places(path, header, chosen, log)
    said: list[str] = []
    for quantity, first in list(place.items()) if log is None else []:
        if quantity == "time" or not _is_empty(path, first):
            continue
        others = [] if quantity in chosen else _others(path, header, chosen, quantity, place)
        at = next((other for other in others if not _is_empty(path, other)), first)
        place[quantity] = at
        taken = f", and {header[at]!r} is taken" if at != first else ""
        said.append(f"{quantity} {header[first]!r} is empty{taken}")
    return place, said


def _others(
    path: Path, header: Sequence[str], chosen: Mapping[str, str], quantity: str, place: Mapping[str, int]
) -> list[int]:
    """The columns that would be a quantity's in turn, if those before had no name, and that are nothing else's."""
    names, found = list(header), list[int]()
    at = place.get(quantity)
    while at is not None:
        names[at] = ""
        try:
            at = _places(path, names, chosen, None).get(quantity)
        except InputError:  # it was the last one that a log cannot be without
            break
        if at in place.values():
            break
        found += [at] if at is not None else []
    return found


def _is_empty(path: Path, place: int) -> bool:
    """Whether a column holds nothing in any row."""
    nothing = (*NO_VALUE_WORDS, "nan")
    with open_text(path, REMEDY, errors="replace") as stream, suppress(csv.Error):  # said where rows are read
        rows = islice(csv.reader(without_nul(stream)), 1, None)
        return all(place >= len(row) or row[place].strip().lower() in nothing for row in rows)
    return False


def _places(path: Path, header: list[str], chosen: Mapping[str, str], log: KnownLog | None) -> dict[str, int]:
    """Which column holds which quantity: as chosen, as a known logger has it, else by name; InputError where a chosen
    one, the time, or both temperature and humidity are not there."""
    place: dict[str, int] = {}
    for quantity, names in NAMES.items():
        if quantity in chosen:
            if chosen[quantity] not in (named := unique_names(header)):
                missing = f"no column {chosen[quantity]!r} for {quantity}"
                raise InputError(f"{shown(path)}, line 1: {missing}; name one of its own ({_listed(named)})")
            place[quantity] = named.index(chosen[quantity])
            continue
        if log is not None:
            if log.columns.get(quantity) in header:
                place[quantity] = header.index(log.columns[quantity])
            continue
        # "T" is a temperature; "t" is one where another column is the time
        other = {"time": "T", "temperature": header[place["time"]] if "time" in place else "t"}.get(quantity)
        squeezed = ["" if name == other else _plain(name) for name in header]
        found = next((squeezed.index(name) for name in names if name in squeezed), None)
        if quantity in OF_AIR and names[0] not in squeezed:
            outside = [outside_name(name) for name in squeezed]
            found = next((outside.index(name) for name in names if len(name) > 1 and name in outside), found)
        if found is None and quantity in KIND_OF:
            found = _with_unit(header, set(place.values()), quantity)
        if found is not None:
            place[quantity] = found
    if "time" not in place:
        raise LayoutError(f"{shown(path)}, line 1: no column of time recognised ({_listed(header)}); {_remedy(path)}")
    if "temperature" not in place and "humidity" not in place:
        raise LayoutError(
            f"{shown(path)}, line 1: neither temperature nor humidity recognised ({_listed(header)}); "
            "name them with --column temperature=NAME --column humidity=NAME"
        )
    return place


def _with_unit(header: list[str], taken: set[int], quantity: str) -> int | None:
    """The column that is a quantity's by its name without the unit in it; None where there is none."""
    for called in NAMES[quantity]:
        for k, name in enumerate(header):
            if k in taken or len(called) < SHORTEST_NAME:
                continue
            bare = squeeze(bare_name(name)) == called
            try:
                if unit_of_column(KIND_OF[quantity], name if bare else squeeze(name), (called,)) is not None:
                    return k
            except UnitError:
                continue
    return None


def _first_row(path: Path, time_place: int) -> tuple[float | None, str]:
    """When the first row of a log with times of day was read [s since 1970; of an unknown day where the file's name has
    none], and the end of a sentence that says whence the day is; nothing where the times have dates."""
    with open_text(path, REMEDY, errors="replace") as stream:
        row = next(islice(csv.reader(without_nul(stream)), 1, None), [])
    found = re.fullmatch(r"\s*(\d{1,2}):(\d\d):(\d\d)\s*", row[time_place] if len(row) > time_place else "")
    if found is None:
        return None, ""
    hours, minutes, seconds = map(int, found.groups())
    of_day_s = 3600.0 * hours + 60.0 * minutes + seconds
    day_s = day_of(path.name, of_day_s)
    if day_s is None:
        return of_day_s, "; times are of a day that neither the log nor its name says"
    return day_s + of_day_s, f"; times are of {datetime.fromtimestamp(day_s, UTC):%Y-%m-%d}, as the file's name says"


def without_nul(stream: Iterable[str]) -> Iterator[str]:
    """Lines without the NUL bytes that loggers leave when power fails."""
    return map(methodcaller("replace", "\0", ""), stream)
