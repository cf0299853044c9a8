"""What a log's header and first values show: which columns are a sensor's, what they measure, in which units."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.files.flight import NAMES
from shockrig.files.unit_names import (
    UNITS,
    bare_name,
    how_near,
    is_called_time,
    known_unit,
    quantity_of,
    squeeze,
    unit_by_letter,
)
from shockrig.rig.logs.clock_columns import guess_clock
from shockrig.rig.logs.known import SensorGuess, adjust
from shockrig.rig.logs.mapping import COLUMNS
from shockrig.rig.logs.stamps import NUMBERS, TimeColumns
from shockrig.rig.logs.text import NUMBER, Scan, is_of_units, is_value, unit_said, units_of

Array = NDArray[np.float64]

_WORDS = re.compile(
    r"(air[ _-]*)?(temperatur(as?|es|en)(?![a-z])|temperature|temperatur|temps(?![a-z])|temp|tmp|thermistor|tair)"
    r"|(rel(ative)?[ _.-]*)?(h?umid(ity|ade|it[àa])?|humedad|luftfeuchte|feuchte|rh|hum)"
    r"|(baro(metric)?[ _-]*)?(pressure|press|pres|druck)",
    re.I,
)
POSITION = ("altitude", "latitude", "longitude")
AIRS_OWN = ("pressure", "airflow")  # of which a log has others beside that at the sensor
STAMPS_APART = 0.05  # of the time from row to row: stamps that are less off the clock are the clock's
IMPOSSIBLE = "hardly any of it can be what its name says (a raw count? if not, state it and its unit in the map)"
NOTHING, ZEROS = "holds nothing", "holds nothing but zeros (not connected?)"
MAY_BE_F = "if it is fahrenheit, say degF"
VALUES = ("state", "value", "val", "reading", "measurement")  # of whatever the row says
REFERENCE_WORDS = ("ctrl", "control", "ref", "standard", "chilled", "mirror")


@dataclass(frozen=True)
class Guess:
    """A first reading of a log: its clock, its sensors, the format it is known by, and what was not used and why."""

    clock: TimeColumns | None
    sensors: tuple[SensorGuess, ...]
    known_as: str | None
    unused: tuple[tuple[str, str], ...]


def guess_log(lines: Scan, impossible: Collection[str] = ()) -> Guess:
    """Group the columns of a log into sensors, by what their names have in common beside the quantity.

    Columns that are `impossible` are none of what their names say: what was read of them cannot be.
    """
    rows = lines.sample()
    clock = guess_clock(lines.names, rows, lines.units)
    times = clock.columns if clock is not None else ()
    sensors: dict[str, SensorGuess] = {}
    shared: list[tuple[str, str, str, str]] = []
    unused: list[tuple[str, str]] = []
    read: list[tuple[str, str, str, list[str]]] = []
    for k, name in enumerate(lines.names):
        if name in times or is_of_units(name) and not any(is_value(row[k]) for row in rows):
            continue
        if name in impossible:
            unused.append((name, IMPOSSIBLE))
            continue
        values = _numbers([row[k] for row in rows], lines.decimal)
        named = unit_said(lines, k, rows)
        quantity = _position(name) or quantity_of(name, named) or _of_a_pair(name, lines.names)
        quantity = quantity or _of_its_sensor(name, lines.names, rows)
        if quantity is None or quantity == "time":
            unused.append((name, _why_no_reading(clock, name, k, lines, rows)))
            continue
        if values.size < 2 or (values == 0.0).all():
            unused.append((name, NOTHING if values.size < 2 else ZEROS))
            continue
        unit, how = guess_unit(COLUMNS.get(quantity, quantity), named, values)
        own = [row[k] for row in rows]
        twins = (one for one, what, its, those in read if what == quantity and _says_again(what, its, those, unit, own))
        if twin := next(twins, None):
            unused.append((name, f"the same as {twin} in another unit"))
            continue
        read.append((name, quantity, unit, own))
        _, lettered = unit_by_letter(name, lines.names) if quantity == "temperature" else (None, name)
        lettered = _beside_humidity(name, lines.names) or lettered
        key = sensor_key(re.sub(r" #\d+$", "", lettered))
        if quantity in POSITION or (quantity in ("pressure", "airflow") and not key):
            shared.append((quantity, name, unit, how))
            continue
        sensor = sensors.setdefault(key, SensorGuess(key))
        place = quantity
        if quantity in sensor.columns and " #" in name:
            # A name that is there again is most often a slip for the sensor whose columns come last.
            last = list(sensors.values())[-1]
            if quantity not in last.columns:
                last.notes.append(f"{name} is taken for this one's: its name is there twice")
                sensor = last
        if quantity in sensor.columns:
            place = "die_temperature" if quantity == "temperature" and "die_temperature" not in sensor.columns else ""
            if not place or "humidity" not in sensor.columns and not re.search(r"hum|die|board|intern", name, re.I):
                key = f"{key}-{sum(other.startswith(key) for other in sensors) + 1}".strip("-")
                sensor = sensors.setdefault(key, SensorGuess(key))
                place = quantity
        sensor.columns[place] = (name, unit, how)
    sensors = _one_pair(sensors)
    known_as = adjust(lines.names, list(sensors.values()))
    useful = [sensor for sensor in sensors.values() if {"temperature", "humidity"} & set(sensor.columns)]
    for sensor in sensors.values():
        if sensor not in useful:  # a barometer by itself serves all
            shared += [(key, *column) for key, column in sensor.columns.items()]
    for quantity, name, unit, how in sorted(shared, key=lambda one: one[0] in AIRS_OWN and how_near(one[1])):
        if quantity in COLUMNS and quantity not in ("temperature", "humidity"):
            for sensor in useful:
                sensor.columns.setdefault(quantity, (name, unit, how))
    for sensor in useful:
        if not sensor.name or sensor.name.isdecimal():
            main = [column for key, (column, _, _) in sensor.columns.items() if key in ("temperature", "humidity")]
            bare = re.sub(r"[^A-Za-z0-9]+", "-", bare_name(main[0])).strip("-")
            sensor.name = (bare if len(main) == 1 and bare else "sensor") + (sensor.name if len(main) > 1 else "")
        again = sum(other.name == sensor.name for other in useful[: useful.index(sensor)])
        sensor.name += f"-{again + 1}" if again else ""  # two columns may differ by nothing but their unit
    return Guess(clock, tuple(useful), known_as, tuple(unused))


def _says_again(quantity: str, unit: str, cells: Sequence[str], other_unit: str, other_cells: Sequence[str]) -> bool:
    """Whether two columns of a quantity say the same in two units, to half of the last digits that they are written
    with: a sensor that is logged in degC and in degF is one."""
    if unit == other_unit or COLUMNS.get(quantity, quantity) not in UNITS:
        return False
    values, rounding = [], 0.0
    for scale_of, texts in ((unit, cells), (other_unit, other_cells)):
        scale, offset = UNITS[COLUMNS.get(quantity, quantity)][scale_of]
        found = [NUMBER.match(text.strip()) for text in texts]
        digits = max((len(m[0].replace(",", ".").partition(".")[2]) for m in found if m), default=0)
        rounding += 0.5 * abs(scale) * 10.0**-digits
        values.append(np.array([scale * float(m[0].replace(",", ".")) + offset if m else np.nan for m in found]))
    apart = np.abs(values[0] - values[1])
    apart = apart[np.isfinite(apart)]
    return apart.size > 1 and bool(np.quantile(apart, 0.95) <= 1.001 * rounding)


def _why_no_reading(
    clock: TimeColumns | None, name: str, place: int, lines: Scan, rows: Sequence[Sequence[str]]
) -> str:
    """Why a column, by its name, holds nothing that is looked for."""
    if clock is not None:
        first = clock.columns[0]
        own, shared_by_all = ([row[k] for row in rows] for k in (place, lines.names.index(first)))
        again = re.sub(r" #\d+$", "", name) == first
        if again:
            other = any(a and a != b for a, b in zip(own, shared_by_all, strict=True))
        else:
            other = is_called_time(name) and _times_of_others(clock, name, own, shared_by_all)
        if other:
            return f"other times than {first}, by which all readings are timed; state it as time for its own"
        if again:
            return f"the same as {first}"
    return "by its name no temperature, humidity, pressure or airflow"


def _times_of_others(clock: TimeColumns, name: str, own: Sequence[str], shared: Sequence[str]) -> bool:
    """Whether a column counts as the clock does and is off it by what matters: a sensor that is read after another."""
    if clock.format != NUMBERS or len(clock.columns) > 1:
        return False
    kind = guess_clock([name], [[cell] for cell in own], [""])
    if kind is None or (kind.format, kind.unit, kind.since_1970) != (NUMBERS, clock.unit, clock.since_1970):
        return False
    rows = [row for row in zip(own, shared, strict=True) if all(map(NUMBER.fullmatch, row))]
    there, time = np.array([[float(cell.replace(",", ".")) for cell in row] for row in rows]).reshape(-1, 2).T
    return time.size > 1 and bool(np.median(np.abs(there - time)) > STAMPS_APART * np.median(np.abs(np.diff(time))))


def _position(name: str) -> str | None:
    """Which of `POSITION` a column is, by the names that flights' logs give it."""
    names = (squeeze(name), squeeze(bare_name(name)), squeeze(name.rpartition(".")[2]))  # a structure's field
    return next((place for place in POSITION if any(one in NAMES[place] for one in names)), None)


def _of_a_pair(name: str, names: Sequence[str]) -> str | None:
    """A column whose name goes on as the other one's of a sensor does: RHsamp beside TEMPsamp and h1 beside t1 are
    humidities, T_SHT4x beside RH_SHT4x a temperature."""
    if _beside_humidity(name, names) is not None:
        return "humidity"
    if re.match("rh[a-z]", name, re.I) is not None:
        temperatures = {sensor_key(other) for other in names if quantity_of(other, None) == "temperature"}
        return "humidity" if sensor_key(name) in temperatures else None
    return "temperature" if name[:2] in ("T_", "T ") and f"RH{name[1:]}" in names else None


def _beside_humidity(name: str, names: Sequence[str]) -> str | None:
    """The temperature t1 of a humidity h1, by their names; None of any other column."""
    if re.match(r"h[ _]?\d", name, re.I) is None:
        return None
    same = (other for other in names if other.lower() == f"t{name[1:].lower()}")
    return next((other for other in same if quantity_of(other, None) == "temperature"), None)


def _of_its_sensor(name: str, names: Sequence[str], rows: Sequence[Sequence[str]]) -> str | None:
    """What a column that is called a value of whatever kind holds, where another column says so in its rows:
    sensor.attic_temperature. Of several sensors the first one that says it."""
    if bare_name(name).lower() not in VALUES:
        return None
    beside = units_of(names, names.index(name))
    if beside is not None and any(row[beside] and known_unit(row[beside]) is None for row in rows):
        return None  # by its unit it is of another quantity
    said = (cell for k in range(len(names)) for cell in dict.fromkeys(row[k] for row in rows))
    return next(
        (quantity for cell in said if (quantity := quantity_of(cell, None)) in ("temperature", "humidity")), None
    )


def _one_pair(sensors: dict[str, SensorGuess]) -> dict[str, SensorGuess]:
    """One temperature and one humidity in all are one sensor's, whatever they are called."""
    with_temperature = [sensor for sensor in sensors.values() if "temperature" in sensor.columns]
    with_humidity = [sensor for sensor in sensors.values() if "humidity" in sensor.columns]
    if len(with_temperature) != 1 or len(with_humidity) != 1 or with_temperature == with_humidity:
        return sensors
    (first,), (second,) = with_temperature, with_humidity
    columns = {**second.columns, **first.columns}
    rest = {key: sensor for key, sensor in sensors.items() if sensor not in (first, second)}
    return {"": SensorGuess("", columns, first.extra | second.extra, first.notes + second.notes), **rest}


def guess_unit(quantity: str, named: str | None, values: Array) -> tuple[str, str]:
    """A column's unit and how it is known."""
    if named in UNITS[quantity]:
        return str(named), "named in the log"
    middle = float(np.median(values))
    taken = "not named in the log: taken for granted"
    if quantity == "temperature":
        # No air is so warm in degC; an oven is, and was colder before.
        if 200.0 < middle < 400.0 and np.quantile(values, 0.05) > 150.0:
            return "K", f"not named in the log: half of the readings are above {middle:.4g}"
        return "degC", taken + (f"; {MAY_BE_F}" if middle > 55.0 else "")
    if quantity == "humidity":
        if 0.0 <= values.min() and values.max() <= 1.2:
            return "fraction", f"not named in the log: no reading is above {values.max():.3g}"
        return "percent", taken
    if quantity == "pressure":
        middle = float(np.quantile(values, 0.9))  # near the ground, where units lie apart
        for unit, low, high in (("Pa", 1e4, 1.2e5), ("hPa", 250.0, 1200.0), ("kPa", 40.0, 120.0), ("inHg", 15.0, 33.0)):
            if low < middle < high:
                return unit, f"not named in the log: it reads about {middle:.4g}"
        return "hPa", taken
    return next(iter(UNITS[quantity])), taken


def sensor_key(name: str) -> str:
    """What is left of a column's name without quantity and unit, as a name that TOML takes bare."""
    bare = bare_name(name)
    left = _WORDS.sub(" ", bare) if _WORDS.search(bare) else re.sub(r"^[tT]($|[_ ](?=\w{2}))", "", bare)
    return re.sub(r"[^A-Za-z0-9]+", "-", left).strip("-")


def likely_reference(sensors: Sequence[SensorGuess]) -> str | None:
    """The sensor whose name says that it is the reference, if there is one."""
    for sensor in sensors:
        if len(sensors) > 1 and any(word in sensor.name.lower() for word in REFERENCE_WORDS):
            return sensor.name
    return None


def _numbers(cells: Sequence[str], decimal: str) -> Array:
    texts = [cell.strip() for cell in cells]
    if decimal == ",":
        texts = [text.replace(",", ".") for text in texts]
    found = [NUMBER.match(text) for text in texts]
    numbers = [match[0] for match, text in zip(found, texts, strict=True) if match and is_value(text)]
    return np.array([float(number) for number in numbers if "," not in number])
