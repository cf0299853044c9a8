"""A map's file read and checked, key by key: every error names the file, the key and the remedy."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from shockrig.files.campaign_names import BODIES
from shockrig.files.disk import TOML_AT_MOST, is_there, read_text, shown
from shockrig.files.file_table import FileTable
from shockrig.files.ranges import RANGES, Range
from shockrig.files.unit_names import UNITS, known_unit
from shockrig.rig.bench_errors import BenchError, as_bench_errors
from shockrig.rig.logs.mapping import COLUMNS, FORMAT, LogMap, SensorMap, StepMap
from shockrig.rig.logs.stamps import ISO, NUMBERS, OF_DAY
from shockrig.rig.logs.text import SEPARATORS, Layout
from shockrig.rig.toml_text import read_toml

_INSTRUMENTS = {"thermometer": "bead_radius_m", "hygrometer": "film_thickness_m"}
_AS_REFERENCE = {
    "temperature_time_constant_s": "reference_time_constant_s",
    "temperature_standard_uncertainty_k": "reference_uncertainty_k",
    "humidity_time_constant_s": "reference_time_constant_s",
    "humidity_standard_uncertainty_percent": "reference_uncertainty_percent",
}
STAMPS = ("auto", "spread", "first")
_POSITIVE = Range(0.0, 1e9)
_FACTS: Mapping[str, Range | None] = {
    "source": None,
    "destination": None,
    "airflow_m_s": RANGES["airflow_m_s"],
    "pressure_hpa": RANGES["pressure_hpa"],
    "duration_s": RANGES["transfer_s"],
}


def shipped_maps() -> tuple[str, ...]:
    """Names of the maps that ship (data/maps)."""
    folder = resources.files("shockrig.data") / "maps"
    return tuple(sorted(item.name.removesuffix(".toml") for item in folder.iterdir() if item.name.endswith(".toml")))


def read_map(path: Path) -> LogMap:
    """Read and check a map: a file, or the name of one that ships where there is no such file.

    Raises
    ------
    BenchError, InputError
        Names the file, the line or key, what was expected and the remedy.
    """
    if not is_there(path) and str(path) in shipped_maps():
        shipped = resources.files("shockrig.data") / "maps" / f"{path}.toml"
        return parse_map(shipped.read_text(encoding="utf-8"), Path(f"{path}.toml"))
    remedy = f"name a map, as shockrig import LOG --look writes it, or one that ships: {', '.join(shipped_maps())}"
    return parse_map(read_text(path, remedy, TOML_AT_MOST), path)


@as_bench_errors()
def parse_map(text: str, path: Path) -> LogMap:
    """As `read_map`, from text; `path` names it in errors."""
    where = shown(path)
    content = read_toml(text, where)
    top = FileTable(content, where)
    top.know("format", "name", "log", "sensor", "runs", "steps", "step")
    if content.get("format", FORMAT) != FORMAT:
        raise top.wrong("format", f'"{FORMAT}"')
    log = top.mapping("log")
    log.know(
        *("separator", "decimal", "header_line", "comment", "missing", "time", "time_format", "time_unit"),
        *("every_s", "repeated_stamps", "only"),
    )
    every_s = log.number("every_s", Range(1e-6, 1e6))
    if every_s is not None and "time" in log.content:
        raise BenchError(f"{where}: key log.every_s: is for a log without times, and log.time is stated; leave one out")
    header_line = log.whole("header_line", Range(0, 10**9))
    decimal = log.one_of("decimal", ("point", "comma"))
    layout = Layout(
        separator=log.one_of("separator", tuple(SEPARATORS)),
        decimal=None if decimal is None else {"point": ".", "comma": ","}[decimal],
        header_line=header_line,
        comment=log.name("comment"),
        missing=log.several("missing"),
        only=_only(log),
        may_be_one=every_s is not None,
    )
    time_unit = log.name("time_unit")
    if time_unit is not None and known_unit(time_unit) not in UNITS["time"]:
        raise log.wrong("time_unit", f"one of {', '.join(UNITS['time'])}")
    runs = top.mapping("runs")
    runs.know("before_s", "after_s", *_FACTS)
    steps = top.mapping("steps")
    steps.know("merge_s", "least_temperature_k", "least_humidity_percent")
    least = {
        "temperature": steps.number("least_temperature_k", Range(1e-6, 100.0)),
        "humidity": steps.number("least_humidity_percent", Range(1e-6, 100.0)),
    }
    sensors = {name: _sensor(name, table) for name, table in top.children("sensor")}
    if not sensors:
        raise BenchError(f"{where}: no [sensor.NAME] table; name the columns of one sensor at least, as --look does")
    found = LogMap(
        path=path,
        name=top.name("name"),
        layout=layout,
        time=log.several("time"),
        time_format=_time_format(log),
        time_unit=None if time_unit is None else known_unit(time_unit),
        every_s=every_s,
        stamps=log.one_of("repeated_stamps", STAMPS) or "auto",
        sensors=sensors,
        steps=tuple(_step(number, table, sensors) for number, table in enumerate(top.items("step", first=1), start=1)),
        facts=_facts(runs),
        before_s=runs.number("before_s", _POSITIVE),
        after_s=runs.number("after_s", _POSITIVE),
        merge_s=steps.number("merge_s", _POSITIVE),
        least={quantity: value for quantity, value in least.items() if value is not None},
    )
    if not found.wanted:
        raise BenchError(f"{where}: every sensor is only another's reference; say campaign = true in one [sensor.NAME]")
    return found


def _sensor(name: str, table: FileTable) -> SensorMap:
    units = [f"{key}_unit" for key in COLUMNS]
    table.know(*COLUMNS, *units, "reference", "campaign", "held", "zero_is_missing", *_INSTRUMENTS, *_AS_REFERENCE)
    if not name.isprintable() or set(name) & set('/\\"') or name.startswith("."):
        raise BenchError(
            f"{table.source}: key sensor.{name}: expected a plain name, which becomes a folder's; rename it"
        )
    columns: dict[str, tuple[str, str | None]] = {}
    for key, quantity in COLUMNS.items():
        column = table.content.get(key)
        if column is None:
            continue
        if not isinstance(column, str | int) or isinstance(column, bool):
            raise table.wrong(key, "the name of a column, or its number from 1")
        said = table.name(f"{key}_unit")
        unit = said if said in UNITS[quantity] else None if said is None else known_unit(said)
        if said is not None and unit not in UNITS[quantity]:
            raise table.wrong(f"{key}_unit", f"one of {', '.join(UNITS[quantity])}")
        columns[key] = (str(column), unit)
    if not {"temperature", "humidity"} & set(columns):
        raise BenchError(
            f'{table.source}: [{table.path.rstrip(".")}]: names no column; add temperature = "..." or humidity = "..."'
        )
    instruments = {}
    for kind, length in _INSTRUMENTS.items():
        of_kind = table.mapping(kind)
        of_kind.know("kind", "serial", "body", length)
        said_of = {
            "kind": of_kind.name("kind"),
            "serial": of_kind.name("serial"),
            length: of_kind.number(length, RANGES[length]),
            "body": of_kind.one_of("body", BODIES),
        }
        instruments[kind] = {key: value for key, value in said_of.items() if value is not None}
    stated = {key: table.number(key, RANGES[limits]) for key, limits in _AS_REFERENCE.items()}
    return SensorMap(
        name=name,
        columns=columns,
        reference=table.several("reference"),
        is_campaign=table.flag("campaign"),
        held=table.whole("held", Range(1, 10000)),
        zero_is_missing=bool(table.flag("zero_is_missing")),
        thermometer=instruments["thermometer"],
        hygrometer=instruments["hygrometer"],
        as_reference={key: value for key, value in stated.items() if value is not None},
    )


def _step(number: int, table: FileTable, sensors: Mapping[str, SensorMap]) -> StepMap:
    known = ("log", "piece", "at", "uncertainty_s", "use", "sensors", "from", "until", "start", "note")
    table.know(*known, *_FACTS)
    if "at" not in table.content and "start" not in table.content:
        raise BenchError(f"{table.source}: key {table.path}at: is missing; say when it was, on the log's clock")
    of = table.several("sensors")
    for name in of:
        if name not in sensors:
            raise table.wrong("sensors", f"names of [sensor.NAME] tables ({', '.join(sensors)})")
    used = table.flag("use")
    return StepMap(
        number=number,
        at=table.content.get("at", table.content.get("start")),
        log=table.name("log"),
        piece=table.whole("piece", Range(1, 10**6)),
        uncertainty_s=table.number("uncertainty_s", _POSITIVE),
        is_used=True if used is None else used,
        sensors=of,
        begin=table.content.get("from"),
        end=table.content.get("until"),
        start=table.content.get("start"),
        note=" ".join((table.text("note") or "").split()),
        facts=_facts(table),
    )


def _only(log: FileTable) -> tuple[tuple[str, str], ...]:
    said = log.mapping("only").content
    if any(not isinstance(value, str | int) or isinstance(value, bool) for value in said.values()):
        raise log.wrong("only", 'columns and what stands in them, such as { sensor_id = "A" }')
    return tuple((column, str(value)) for column, value in said.items())


def _facts(table: FileTable) -> dict[str, Any]:
    """What is known of runs: airs, airflow, pressure, duration of the transfer."""
    facts: dict[str, Any] = {}
    for key, limits in _FACTS.items():
        if limits is not None:
            facts[key] = table.number(key, limits)
            continue
        air = table.mapping(key)
        air.know("temperature_c", "humidity_percent")
        numbers = {name: air.number(name, RANGES[name]) for name in ("temperature_c", "humidity_percent")}
        facts[key] = {name: value for name, value in numbers.items() if value is not None} or None
    return {key: value for key, value in facts.items() if value is not None}


def _time_format(log: FileTable) -> str | None:
    said = log.name("time_format")
    if said is not None and said not in (ISO, NUMBERS, OF_DAY) and "%" not in said:
        raise log.wrong(
            "time_format", f'a strptime format such as "%d.%m.%Y %H:%M:%S", "{ISO}", "{NUMBERS}" or "{OF_DAY}"'
        )
    return said
