"""One run from files of one sensor each: options become a map, and the run is added to a campaign, new or there."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.campaign import read_campaign
from shockrig.files.campaign_lock import held
from shockrig.files.campaign_names import CAMPAIGN_FORMAT, is_run_id
from shockrig.files.campaign_write import campaign_document, run_document, table_text, write_campaign, write_run
from shockrig.files.disk import is_there, read_bytes, real_path, shown, write_whole
from shockrig.files.errors import InputError
from shockrig.files.json_files import read_json
from shockrig.files.spelling import did_you_mean
from shockrig.rig.bench_errors import BenchError, as_bench_errors
from shockrig.rig.logs.guess import Guess, guess_log
from shockrig.rig.logs.mapping import LogMap, SensorMap
from shockrig.rig.logs.sensor_logs import read_sensors
from shockrig.rig.logs.stamps import ISO, TimeColumns, to_seconds
from shockrig.rig.logs.text import Layout, Scan, scan

Array = NDArray[np.float64]

PLAN = "plan"  # of a campaign that shockrig run has recorded
MAIN = {"imet": "temperature", "hyt": "humidity"}  # what a row of the sensor's file must have
UNITS_ASKED = {"c": "degC", "k": "K", "f": "degF"}
DIE = "die_temperature"
WRITTEN = {"temperature": "temperature_c", "humidity": "humidity_percent", DIE: "temperature_c"}


@dataclass(frozen=True)
class LogOptions:
    """How a logger writes, as a user says it in options. What is None is found out.

    `columns` maps "time", "temperature", "humidity" and "die_temperature" to a name or a number from 1. `time_unit` is
    "s", "ms", "us", "min", "h" or "iso"; `time_format` is a strptime format and overrides it. `temperature_unit` is
    "c", "k" or "f", `humidity_unit` "percent" or "fraction".
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    layout: Layout = Layout()
    time_unit: str | None = None
    time_format: str | None = None
    temperature_unit: str | None = None
    humidity_unit: str | None = None


@dataclass(frozen=True)
class SensorSeries:
    """One sensor's readings: `time_s` (n,) on the clock of its file, since 1970 for dates, `values` (n,) by the columns
    of a run's table, NaN where there is none, and what was found odd, a sentence each."""

    path: Path
    clock: TimeColumns
    time_s: Array
    values: Mapping[str, Array]
    remarks: tuple[str, ...]


def read_sensor(path: Path, sensor: str, options: LogOptions, *, die: bool = True) -> SensorSeries:
    """Read the file of one sensor, "imet" or "hyt"; `die` False: a temperature that no option names is not the die's.

    Raises
    ------
    BenchError
        Naming the file, the line or the column, and the option that mends it.
    """
    lines = scan(path, options.layout)
    guess = guess_log(lines)
    main = MAIN[sensor]
    time = options.columns.get("time")
    if time is None and guess.clock is None:
        raise _no_column(lines, "times", f"--{sensor}-time")
    if time is not None:
        _place(lines, time)
    columns = {main: _main_column(lines, guess, sensor, options)}
    found = _die_column(lines, guess, options) if sensor == "hyt" and (die or DIE in options.columns) else None
    if found is not None:
        columns[DIE] = found
    asked = {
        "temperature": UNITS_ASKED.get(options.temperature_unit or ""),
        "humidity": options.humidity_unit,
        DIE: UNITS_ASKED.get(options.temperature_unit or ""),
    }
    recognised = {name: unit for one in guess.sensors for name, unit, _ in one.columns.values()}
    is_iso = options.time_unit == "iso"
    map_ = LogMap(
        path,
        None,
        options.layout,
        (time,) if time is not None else (),
        options.time_format or (ISO if is_iso else None),
        None if is_iso or options.time_format else options.time_unit,
        None,
        "auto",
        {sensor: SensorMap(sensor, {key: (name, asked[key] or recognised.get(name)) for key, name in columns.items()})},
        (),
        {},
        None,
        None,
        None,
        {},
    )
    read = read_sensors(path, map_, lines, guessed=asked[main] is None)
    log, readings = read.log, read.readings[sensor]
    there = np.isfinite(readings.values[main])
    time_s = log.time_s[readings.rows][there]
    if time_s.size < 2 or (np.diff(time_s) <= 0).any():
        why = "fewer than two readings" if time_s.size < 2 else "its clock goes back"
        raise BenchError(f"{shown(path)}: {why}; expected one recording, or import it by a map: --look writes one")
    values = {WRITTEN[key]: column[there] for key, column in readings.values.items() if key in WRITTEN}
    return SensorSeries(path, log.clock, log.origin_s + time_s, values, (*log.remarks, *readings.remarks))


def _main_column(lines: Scan, guess: Guess, sensor: str, options: LogOptions) -> str:
    """The column that a sensor is recorded for: that which an option names, else the only one that is recognised."""
    key = MAIN[sensor]
    if key in options.columns:
        return _place(lines, options.columns[key])
    names = [one.columns[key][0] for one in guess.sensors if key in one.columns]
    if not names:
        raise _no_column(lines, key, f"--{sensor}-{key}")
    if len(names) > 1:
        several = f"has several columns of {key}; name one by --{sensor}-{key}"
        raise BenchError(f"{shown(lines.path)}: {several}: {', '.join(names)}")
    return names[0]


def _die_column(lines: Scan, guess: Guess, options: LogOptions) -> str | None:
    """The die's temperature: that which an option names, else the only one beside a humidity; None where none is."""
    if DIE in options.columns:
        return _place(lines, options.columns[DIE])
    beside = [one.columns for one in guess.sensors if "humidity" in one.columns]
    names = [(one.get(DIE) or one["temperature"])[0] for one in beside if {DIE, "temperature"} & set(one)]
    return names[0] if len(names) == 1 else None


def _no_column(lines: Scan, what: str, option: str) -> BenchError:
    at = f", line {lines.header_line}" if lines.header_line else ""
    has = ", ".join(lines.names)
    return BenchError(f"{shown(lines.path)}{at}: no column of {what} found; name it by {option} COLUMN (it has: {has})")


def _place(lines: Scan, asked: str) -> str:
    if asked not in lines.names and not (asked.isdecimal() and 1 <= int(asked) <= len(lines.names)):
        at = f", line {lines.header_line}" if lines.header_line else ""
        raise BenchError(f"{shown(lines.path)}{at}: no column {asked!r}{did_you_mean(asked, lines.names)}")
    return asked


@dataclass(frozen=True)
class RunFacts:
    """What is known of a run beside its files; None where it is not known."""

    source_temperature_c: float | None = None
    source_humidity_percent: float | None = None
    destination_temperature_c: float | None = None
    destination_humidity_percent: float | None = None
    airflow_m_s: float | None = None
    pressure_hpa: float | None = None
    start: str | None = None
    duration_s: float | None = None


def import_run(
    campaign: Path,
    series: Mapping[str, SensorSeries],
    facts: RunFacts,
    *,
    id_: str | None = None,
    name: str | None = None,
    sensors: Mapping[str, Mapping[str, Any]] | None = None,
) -> str:
    """Add a run to a campaign, which is made where there is none; returns the run's id. Nothing is left half-written.

    Parameters
    ----------
    series : mapping
        "imet" and/or "hyt" -> readings on one common clock.
    sensors : mapping, optional
        What is known of the sensors, as in campaign.json.

    Raises
    ------
    BenchError
        The campaign, the id or the start do not fit, or another process is writing to the campaign.
    """
    if len({one.clock.is_dated for one in series.values()}) > 1:
        raise BenchError("one file's times are dates and the other's are numbers; both must be on one clock")
    begins_s = min(float(one.time_s[0]) for one in series.values())
    ends_s = max(float(one.time_s[-1]) for one in series.values())
    if max(one.time_s[0] for one in series.values()) >= min(one.time_s[-1] for one in series.values()):
        raise BenchError("the two files do not overlap in time; both must be on one clock")
    clock = next(iter(series.values())).clock
    airs: dict[str, dict[str, float]] = {}
    for place in ("source", "destination"):
        said = {key: getattr(facts, f"{place}_{key}") for key in ("temperature_c", "humidity_percent")}
        airs[place] = {key: value for key, value in said.items() if value is not None}
    start_s = None if facts.start is None else _start_s(facts.start, clock, begins_s, ends_s)
    tables = {key: _table(key, one, begins_s) for key, one in series.items()}
    times = "dates" if clock.is_dated else clock.known
    imported = {
        key: {"log": one.path.name, "times": times, "remarks": list(one.remarks)} for key, one in series.items()
    }

    fresh = not is_there(campaign)
    with as_bench_errors(), held(campaign):
        head, changed = _campaign_head(campaign, name, sensors or {}, series)
        id_ = _free_id(campaign, id_, head)
        began = datetime.fromtimestamp(round(begins_s, 6), UTC).isoformat().replace("+00:00", "Z")
        run = run_document(
            id_,
            started_at=began if clock.is_dated else None,
            source=airs["source"],
            destination=airs["destination"],
            airflow_m_s=facts.airflow_m_s,
            pressure_hpa=facts.pressure_hpa,
            start_s=start_s,
            duration_s=facts.duration_s,
            imported=imported,
        )
        _put(campaign, id_, run, tables, head if changed else None, fresh)
    return id_


def _start_s(start: str, clock: TimeColumns, begins_s: float, ends_s: float) -> float:
    """The transfer's start within a recording [s], from what was stated on the files' clock."""
    start_s = round(to_seconds(clock, 0.0, _as_written(start), "--start") - begins_s, 6)
    if not 0 < start_s < ends_s - begins_s:
        raise BenchError(
            f"--start {start} is not within the recording, which is {ends_s - begins_s:.1f} s long; "
            "give it on the clock of the files"
        )
    return start_s


def _as_written(start: str) -> object:
    """A time as a map would hold it: a number where it is one."""
    try:
        return float(start)
    except ValueError:
        return start


def _put(
    campaign: Path,
    id_: str,
    run: dict[str, Any],
    tables: Mapping[str, str],
    head: dict[str, Any] | None,
    fresh: bool,
) -> None:
    """Write a run into a campaign, and its campaign.json where `head` is a new one; raises BenchError, and then leaves
    the campaign as it was."""
    file = campaign / "campaign.json"
    before = read_bytes(file, "give another --out") if is_there(file) else None
    part = campaign / "runs" / f".{id_}.part"
    try:
        shutil.rmtree(part, ignore_errors=True)  # of an import that was killed
        part.mkdir(parents=True)
        write_run(part, run, tables)
        if head is not None:
            write_campaign(campaign, head)
        os.rename(part, campaign / "runs" / id_)
    except OSError as error:
        shutil.rmtree(campaign if fresh else part, ignore_errors=True)
        raise BenchError(f"{campaign}: {error.strerror or error}; give another --out or free some space") from None
    try:
        read_campaign(campaign)
    except InputError as error:  # a run that no reader takes is none
        _take_back(campaign, id_, before, fresh)
        raise BenchError(f"{error} (nothing was imported)") from None


def _take_back(campaign: Path, id_: str, before: bytes | None, fresh: bool) -> None:
    """A campaign as it was before a run came into it; `before` is what its campaign.json held."""
    if fresh:
        shutil.rmtree(campaign, ignore_errors=True)
        return
    shutil.rmtree(campaign / "runs" / id_, ignore_errors=True)
    if before is not None:
        write_whole(campaign / "campaign.json", before)
    else:  # a folder that was empty
        (campaign / "campaign.json").unlink(missing_ok=True)
        with suppress(OSError):
            (campaign / "runs").rmdir()


def _is_only_begun(campaign: Path) -> bool:
    """Whether a folder is empty, or holds no more than what an import that was killed has left."""
    entries = [entry for entry in campaign.iterdir() if entry.name != "campaign.json.part"]
    if [entry.name for entry in entries] != ["runs"]:
        return not entries
    return all(run.name.startswith(".") and run.name.endswith(".part") for run in entries[0].iterdir())


def _campaign_head(
    campaign: Path, name: str | None, sensors: Mapping[str, Mapping[str, Any]], series: Mapping[str, SensorSeries]
) -> tuple[dict[str, Any], bool]:
    file = campaign / "campaign.json"
    if not is_there(file):
        if is_there(campaign) and not (campaign.is_dir() and _is_only_begun(campaign)):
            raise BenchError(f"{campaign}: is neither empty nor a campaign; give another --out")
        described = {key: dict(sensors.get(key, {})) for key in series}
        return campaign_document(name or real_path(campaign).name, described), True
    with as_bench_errors():
        content = read_json(file, CAMPAIGN_FORMAT, "give another --out")
        content.mapping("sensors")
    head = dict(content.content)
    if name is not None and head.get("name") != name:
        raise BenchError(f"{file}: is named {head.get('name')!r}, not {name!r}; leave --name out or give another --out")
    known = head["sensors"] = dict(head.get("sensors") or {})
    changed = False
    for key in series:
        here = known.get(key)
        if here is None and PLAN in head:
            raise BenchError(
                f"{file}: was recorded without {key}, and is gone on with as it was planned; give another --out"
            )
        if here is None:
            known[key], changed = dict(sensors.get(key, {})), True
            continue
        for entry, value in sensors.get(key, {}).items():
            if isinstance(here, dict) and entry in here and here[entry] != value:
                raise BenchError(
                    f"{file}: sensors.{key}.{entry} is {here[entry]!r}, not {value!r}; a campaign has one pair"
                )
    return head, changed


def _free_id(campaign: Path, id_: str | None, head: Mapping[str, Any]) -> str:
    """The run's id. In a campaign that was recorded by a plan the numbers are the plan's, also those of runs to come:
    an imported run would stand in for one."""
    runs = campaign / "runs"
    if PLAN in head:
        if id_ is not None and (id_.isdecimal() or id_ in [run.get("id") for run in _planned(head)]):
            raise BenchError(f"--id {id_}: is the place of a run of this campaign's plan; leave --id out")
        names = {p.name for p in runs.iterdir()} if runs.is_dir() else set()
        id_ = id_ or next(name for n in count(1) if (name := f"imported-{n:04d}") not in names)
    if id_ is None:
        taken = [int(p.name) for p in runs.iterdir() if p.name.isdecimal()] if runs.is_dir() else []
        return f"{max(taken, default=0) + 1:04d}"
    if not is_run_id(id_):
        raise BenchError(f"--id {repr(id_)[:40]}: expected a name that can be a folder, such as 0001")
    if (runs / id_).exists():
        raise BenchError(f"--id {id_}: this campaign already has that run; leave --id out for the next free one")
    return id_


def _planned(head: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    plan = head.get(PLAN)
    return [run for run in plan if isinstance(run, Mapping)] if isinstance(plan, list) else []


def _table(sensor: str, series: SensorSeries, begins_s: float) -> str:
    """The sensor's CSV file, with the digits that came."""
    columns: dict[str, Sequence[float | None]] = {"time_s": (series.time_s - begins_s).tolist()}
    columns |= {name: (column + 0.0).tolist() for name, column in series.values.items()}  # no -0
    forms = dict.fromkeys(columns, "%.7g") | {"time_s": "%.10g", "stale": "%d"}
    if sensor == "hyt":
        columns["stale"] = [0.0] * series.time_s.size
    return table_text(columns, forms)
