"""Quantities and units as loggers write them: "Time [ms]", "temperature(°C)", "Temp, °F", "RH_percent", "mBar"."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

# quantity -> unit as maps write it -> (factor, offset) to the unit of the campaign: degC, percent, hPa, m/s
UNITS: Mapping[str, Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        "temperature": {
            "degC": (1.0, 0.0), "K": (1.0, -273.15), "degF": (5.0 / 9.0, -160.0 / 9.0), "cdegC": (0.01, 0.0),
        },
        "humidity": {"percent": (1.0, 0.0), "fraction": (100.0, 0.0)},
        "pressure": {
            "hPa": (1.0, 0.0), "Pa": (0.01, 0.0), "kPa": (10.0, 0.0), "bar": (1000.0, 0.0),
            "mmHg": (1.333224, 0.0), "inHg": (33.863886, 0.0), "psi": (68.947573, 0.0),
        },
        "airflow": {
            "m/s": (1.0, 0.0), "km/h": (1.0 / 3.6, 0.0), "knots": (0.514444, 0.0), "mph": (0.44704, 0.0),
            "ft/min": (0.00508, 0.0),
        },
        "time": {
            "s": (1.0, 0.0), "ms": (1e-3, 0.0), "us": (1e-6, 0.0), "ns": (1e-9, 0.0), "min": (60.0, 0.0),
            "h": (3600.0, 0.0), "days": (86400.0, 0.0),
        },
        "altitude": {"m": (1.0, 0.0), "km": (1000.0, 0.0), "ft": (0.3048, 0.0), "cm": (0.01, 0.0), "mm": (0.001, 0.0)},
        "position": {"deg": (1.0, 0.0)},
    }
)  # fmt: skip
# 1985 to 2128, as counted since 1970
EPOCH = {"s": (5e8, 5e9), "ms": (5e11, 5e12), "us": (5e14, 5e15), "ns": (5e17, 5e18)}
# what 1970-01-01 is in days, as spreadsheets, Matlab and astronomers count them
DAY_1970 = {"a spreadsheet's": 25569.0, "Matlab's": 719529.0, "Julian": 2440587.5}
_ALIASES = {
    "degC": ("c", "°c", "degc", "deg c", "deg_c", "℃", "celsius", "degrees c", "degree c", "º c", "ºc", "grad c", "�c"),
    "cdegC": (
        "centidegc",
        "centidegrees",
        "degc/100",
        "0.01 degc",
        "0.01degc",
        "0.01°c",
        "0.01 °c",
    ),  # of MAVLink, MS5611
    "K": ("k", "kelvin", "degk"),
    "degF": ("f", "°f", "degf", "deg f", "deg_f", "℉", "fahrenheit", "ºf", "�f"),
    "percent": (
        "%",
        "%rh",
        "percent",
        "pct",
        "% rh",
        "rh%",
        "%r.h.",
        "percent rh",
        "perc",
        "rh %",
        "% r.f.",
        "% rf",
        "%rf",
    ),
    "fraction": ("fraction", "0-1", "frac", "0..1"),
    "hPa": ("hpa", "mbar", "mb", "millibar", "hectopascal"),
    "Pa": ("pa", "pascal"),
    "kPa": ("kpa",),
    "bar": ("bar",),
    "mmHg": ("mmhg", "torr"),
    "inHg": ("inhg", "in hg"),
    "psi": ("psi",),
    "m/s": ("m/s", "m s-1", "ms-1", "m_s", "mps", "m s^-1"),
    "km/h": ("km/h", "kmh", "kph", "km/hr"),
    "knots": ("knots", "kt", "kts", "kn"),
    "mph": ("mph",),
    "ft/min": ("ft/min", "fpm"),
    "s": ("s", "sec", "secs", "second", "seconds", "sek", "sekunden", "seg", "segundo", "segundos", "secondi"),
    "ms": ("ms", "msec", "msecs", "millis", "millisec", "milliseconds", "millisecond"),
    "us": ("us", "µs", "μs", "usec", "usecs", "micros", "microsec", "microseconds"),
    "ns": ("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanoseconds"),
    "min": ("min", "mins", "minute", "minutes", "minuten", "minuto", "minutos", "minuti"),
    "h": ("h", "hr", "hrs", "hour", "hours", "std", "stunde", "stunden", "horas", "heures"),
    "days": ("d", "day", "days", "tage", "dias", "jours"),
    "km": ("km",),
    "ft": ("ft", "feet"),
    "cm": ("cm",),
    "mm": ("mm",),
}  # a letter "m" behind a name is seldom a metre
_UNIT_OF = {alias: unit for unit, aliases in _ALIASES.items() for alias in (*aliases, unit.lower())}
_QUANTITY_OF = {unit: quantity for quantity, units in UNITS.items() for unit in units}
_WORDS = {  # in Latin letters, Russian, Chinese, Japanese and Korean
    "humidity": ("umid", "feucht", "humedad", "rh", "hum", "relh", "hr", "влажн", "湿度", "濕度", "습도"),
    "pressure": ("press", "pres", "druck", "baro", "pstat", "давлен", "气压", "氣壓", "気圧", "기압"),
    "airflow": (
        "wind speed",
        "windspeed",
        "wind_speed",
        "airflow",
        "air_flow",
        "airspeed",
        "air speed",
        "air_speed",
        "anemom",
    ),
    "temperature": (
        "temp",
        "tmp",
        "tair",
        "therm",
        "rtd",
        "ntc",
        "pt100",
        "pt1000",
        "bead",
        "t_air",
        "celsius",
        "темпер",
        "温度",
        "溫度",
        "気温",
        "气温",
        "氣溫",
        "온도",
    ),
}
_OTHER = (
    "dew", "frost", "batt", "volt", "heat index", "wind chill", "wet bulb", "wet-bulb", "potential", "setpoint",
    "set point", "set_point", "set temp", "set_temp", "setting", "target", "anomaly", "direction", "velocity", "ascent",
    "climb", "over ground", "efficien", "duty", "throttle", "error", "g/m", "vpd", "vapo", "humidifier",
)  # fmt: skip
# of several columns of one quantity the first that is there: the air's own pressure goes before one that is reduced to
# the sea, as weather meters have both, and the speed of the air past the sensor before that of the wind
_OWN_AIR = re.compile(r"station|absolute|static|air[ _-]?(speed|flow)|anemom|pitot|(?<![a-z])tas(?![a-z])", re.I)
_OF_THE_SEA = re.compile(r"baro|sea|(?<![a-z])(slp|mslp?|qnh|qff)(?![a-z])|altimeter", re.I)
_TIMES = (
    "time", "timestamp", "datetime", "date_time", "date time", "date-time", "t", "date", "datum", "zeit", "uhrzeit",
    "elapsed", "elapsed time", "seconds", "millis", "milliseconds", "micros", "microseconds", "minutes", "hours",
    "epoch", "unixtime", "unix", "ms", "fecha", "hora", "heure", "tempo", "tiempo", "clock",
    "tms", "x_value",  # of LabVIEW's measurement files
    "время", "дата", "дата и время", "дата/время", "日期", "日付", "시간", "날짜", "일시",
)  # fmt: skip
# what tables in other scripts name their columns by
FOREIGN_WORDS = ("℃", *(word for words in (*_WORDS.values(), _TIMES) for word in words if not word.isascii()))
OUTSIDE = ("external", "outside", "outdoor", "ambient", "ext", "air", "out")
INSIDE = ("internal", "inside", "indoor", "box", "board", "case", "housing", "enclosure", "cpu", "pcb", "mcu")
# humidities that are no relative one
_NOT_RELATIVE = re.compile(r"absolut|specific|(?<![a-z])abs(?![a-z])")
# "km/hr", "mm/hr": an hour, and not the "hr" that is a humidity in French and Spanish
_PER_HOUR = re.compile(r"(?<![a-z])(km|mi|nmi?|mm?|cm|ft|in|l)\s*/\s*(h|hrs?|hours?)(?![a-z])")
# before a field of a structure, whose name says who read it: barometer_data.temperature
_FIELD = re.compile(r"(?<=\w)\.(?=[A-Za-z_])")
# words that hold others: a compressor is no pressure, an attempt no temperature, and an evaporator has one
_HOLD_OTHERS = re.compile(r"(compress|suppress|express|impress|evaporat|attempt|templat|tempora|thermostat)[a-z]*")
_BRACKETS = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]")


def known_unit(text: str) -> str | None:
    """The unit as maps write it that a text means; None where it means none."""
    # An asterisk stands for the degree sign in what many small loggers print: 23.8*C.
    return _UNIT_OF.get(" ".join(text.strip().lower().strip("[]()").replace("*", "°").split()))


def is_unit(text: str) -> bool:
    """Whether a cell is nothing but a unit, as in a row of units under the names."""
    return known_unit(text) is not None


def unit_in_name(name: str) -> str | None:
    """The unit that a column's name carries in brackets, behind a comma or at its end; None where it carries none."""
    for inside in _BRACKETS.findall(name):
        if (unit := known_unit(inside)) is not None:
            return unit
    if "," in name and (unit := known_unit(name.split(",", 1)[1].split("(")[0])) is not None:
        return unit
    words = re.split(r"[ _]", name.strip())
    for n in (2, 1):  # "temp_deg_c" before "temp_c"
        if len(words) > n and (unit := known_unit("_".join(words[-n:]))) is not None:
            # A letter behind a name is as often a sensor's as a unit's: TempC, T K; told only by an underscore.
            if len(unit) > 1 or "_" in name:
                return unit
    # Nothing but a unit: "°C", "hPa"; a letter may be anybody's, and "hr" is a humidity in French and Spanish.
    unit = known_unit(name) if len(name.strip()) > 1 else None
    return None if unit in UNITS["time"] else unit


def unit_among(name: str, names: Collection[str]) -> str | None:
    """The unit that one of some columns' `names` carries, as in `unit_in_name`; None where it is a letter in whose
    place another column has one that is no unit: igniter_a to igniter_d are four of a kind, and the third in no degC.
    """
    before, _, letter = name.rpartition("_")
    if len(letter) == 1:
        alike = (other for other in names if len(other) == len(name) and other.startswith(f"{before}_"))
        if any(known_unit(other[-1]) is None for other in alike):
            return None
    return unit_in_name(name)


# "tempF", "temp_f_probe1", "Temp 1 F": the word for a temperature, a number or none, and a letter by itself
_LETTERED = re.compile(r"(?:temperature|temperatur|temp)(?:[ _-]?\d+)?[ _-]?([a-z])(?![a-z])", re.I)


def unit_by_letter(name: str, names: Sequence[str]) -> tuple[str | None, str]:
    """The unit, degC or degF, that a letter behind the word for a temperature means, and the name without it; None and
    the name where there is none, or another of a log's `names` has another letter in its place: TempA to TempF are
    sensors."""
    found = _LETTERED.search(name)
    if found is None or found[1].upper() not in "CF":
        return None, name
    before, behind = name[: found.start(1)], name[found.end(1) :]
    letters = {
        other[len(before)].upper()
        for other in names
        if len(other) == len(name) and other.startswith(before) and other.endswith(behind)
    }
    if any(letter.isalpha() for letter in letters - {"C", "F"}):
        return None, name
    return ("degF" if found[1].upper() == "F" else "degC"), before.rstrip(" _-") + behind


_METRES = ("m", "metre", "metres", "meter", "meters")  # in brackets, where a letter by itself can be no minute
# What in brackets can only be a unit: a letter or two, or what has a line, a power or a degree sign in it.
_UNIT_LIKE = re.compile(r"[°º]?[a-zµμ]{1,2}|(?=[^:]{1,9}$)[^:]*([/^°º²³]|-\d).*", re.I)


def unit_of_column(quantity: str, name: str, called: Sequence[str] = ()) -> str | None:
    """The unit of a quantity (a key of `UNITS`) that a column's name states: as in `unit_in_name`, or behind one of the
    names that it may be `called` by (letters and digits alone), as in "tempF"; None where it states none.

    Raises
    ------
    UnitError
        What stands in brackets can only be a unit, and is none of this quantity.
    """
    unit = unit_in_name(name)
    if unit in UNITS[quantity]:
        return unit
    inside = _BRACKETS.findall(name)
    if quantity == "altitude" and any(set(one.lower().split()) & set(_METRES) for one in inside):
        return "m"
    for word in (word for one in inside for word in one.split()):
        if known_unit(word) in UNITS[quantity]:  # "ft AGL"
            return known_unit(word)
    if unread := next((one for one in inside if known_unit(one) or _UNIT_LIKE.fullmatch(one)), None):
        raise UnitError(unread)
    squeezed = squeeze(name)
    for alias, meant in _UNIT_OF.items():
        end = squeeze(alias)
        if meant in UNITS[quantity] and end and squeezed.endswith(end) and squeezed[: -len(end)] in called:
            return meant
    return None


def squeeze(name: str) -> str:
    """A column's name as letters and digits alone: "Air Temperature (degC)" -> "airtemperaturedegc"."""
    return re.sub(r"[^a-z0-9]", "", name.lower().replace("°", "").replace("%", "percent"))


def outside_name(squeezed: str, words: Sequence[str] = OUTSIDE) -> str | None:
    """What is left of a column's name as `squeeze` gives it without a word that says that it is of the air outside of
    the logger ("exttemperature", "tempambient"), or without one of other `words`; None where it has none."""
    for word in words:
        if squeezed != (rest := squeezed.removeprefix(word)) or squeezed != (rest := squeezed.removesuffix(word)):
            return rest
    return None


class UnitError(ValueError):
    """A text in a column's name that can only be a unit, and is none of its quantity."""


def bare_name(name: str) -> str:
    """A column's name without the unit in it."""
    bare = _BRACKETS.sub("", name)
    if "," in bare and known_unit(bare.split(",", 1)[1].split("(")[0]) is not None:
        bare = bare.split(",", 1)[0]
    bare = bare.strip(" _,:")
    if unit_in_name(bare) is not None and known_unit(bare) is not None:
        return ""
    words = bare.split("_")
    for n in (2, 1):
        if len(words) > n and known_unit("_".join(words[-n:])) is not None:
            return "_".join(words[:-n])
    return bare


def unique_names(names: Sequence[str], width: int | None = None) -> tuple[str, ...]:
    """One name for each column: numbers where there is none, "#2" and so on where one is there again."""
    seen: Counter[str] = Counter()
    unique = []
    for k in range(len(names) if width is None else width):
        name = names[k].strip() if k < len(names) and names[k].strip() else str(k + 1)
        seen[name] += 1
        unique.append(name if seen[name] == 1 else f"{name} #{seen[name]}")
    return tuple(unique)


def how_near(name: str) -> int:
    """0 of a pressure or an airflow that by its name is the sensor's own, 2 of a pressure that may be reduced to the
    sea, 1 of any other."""
    return 0 if _OWN_AIR.search(name) else 1 + bool(_OF_THE_SEA.search(name))


def is_called_time(name: str) -> bool:
    """Whether a column is called by a word for time or date."""
    name = _FIELD.split(name)[-1]
    low = bare_name(name).lower()
    return (
        low in _TIMES
        or re.match(r"([Tt]ime|[Ee]lapsed)[A-Z]", name) is not None
        or re.match(r"(time|date|zeit|datum)(\b|_|stamp)", low) is not None
        or low.endswith(("time", "_ms", "时间", "時間", "日時", "時刻"))
    )


def rest_of_second(names: Sequence[str], place: int) -> tuple[int, str] | None:
    """The column that by its name holds what is left of the seconds that the one in a place counts (secs and nsecs of
    a stamp, tv_sec and tv_usec), and its unit; None where there is none."""
    parted = [re.fullmatch(r"(.*?)([a-zµμ]+)", name.strip().lower()) for name in names]
    called = [(found[1], known_unit(found[2])) if found else ("", None) for found in parted]
    before, unit = called[place]
    of_same = (k for k, (stem, part) in enumerate(called) if stem == before and part in ("ms", "us", "ns"))
    return next(((k, str(called[k][1])) for k in of_same), None) if unit == "s" else None


def within_second(whole: NDArray[np.float64], rest: NDArray[np.float64], unit: str) -> bool:
    """Whether numbers (n,) of such a column are no more than that, and the others (n,) whole seconds."""
    known = np.isfinite(whole) & np.isfinite(rest)
    part = rest[known] * UNITS["time"][unit][0]
    seconds = whole[known]
    return bool(known.any() and (seconds == np.floor(seconds)).all() and (part >= 0.0).all() and (part < 1.0).all())


def quantity_of(name: str, unit: str | None) -> str | None:
    """What a column measures, by its name and unit: a key of `UNITS` but time, or None."""
    low = _HOLD_OTHERS.sub("", _PER_HOUR.sub("", name.lower()))
    of_others = ("dp", "dpt", "ror")  # dew points, a rate of rise
    if re.search("(?<!dis)charge", low) or any(word in low for word in _OTHER):
        return None
    if any(_has_word(low, word) for word in of_others):
        return None
    *whole, field = _FIELD.split(name)
    if whole and (quantity := quantity_of(field, unit)) is not None:
        return quantity
    by_unit = _QUANTITY_OF.get(unit) if unit else None
    for quantity, words in _WORDS.items():
        # "Humidity Temp" is the temperature of a hygrometer, "Air Temperature RH" hardly the other way round.
        if any(_has_word(low, word) for word in words):
            if quantity == "humidity" and (by_unit == "temperature" or _has_word(low, "temp")):
                return "temperature"
            if quantity == "pressure" and any("temp" in low.partition(word)[2] for word in words):  # a barometer's own
                return "temperature"
            if quantity == "humidity" and by_unit is None and _NOT_RELATIVE.search(low):
                return None
            if by_unit in (None, quantity):
                return quantity
    if by_unit in ("temperature", "humidity", "pressure", "airflow"):
        return by_unit
    bare = bare_name(name).lower()
    if re.fullmatch(r"t([ _]?\d+|_?[abc])?", bare) and bare != "t":
        return "temperature"
    return None


def _has_word(name: str, word: str) -> bool:
    """Whether a name has a word in it; short ones must stand at a border of letters."""
    if len(word) > 3:
        return word in name
    return re.search(rf"(^|[^a-z]){re.escape(word)}([^a-z]|$|[a-z]?$|ctrl|ref)", name) is not None
