"""One run from other loggers' CSV files (rig.csv_series), added to a campaign, which is made where there is none."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Any

from shockrig.files.campaign import read_campaign
from shockrig.files.campaign_lock import held
from shockrig.files.campaign_names import CAMPAIGN_FORMAT, is_run_id
from shockrig.files.campaign_write import campaign_document, run_document, table_text, write_campaign, write_run
from shockrig.files.disk import is_there, read_bytes, real_path, write_whole
from shockrig.files.errors import InputError
from shockrig.files.json_files import read_json
from shockrig.rig.csv_series import CsvLayout, Series, time_of
from shockrig.rig.errors import BenchError, as_bench_errors

PLAN = "plan"  # of a campaign that shockrig run has recorded


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
    series: Mapping[str, Series],
    facts: RunFacts,
    layout: CsvLayout,
    *,
    id_: str | None = None,
    name: str | None = None,
    sensors: Mapping[str, Mapping[str, Any]] | None = None,
    sources: Mapping[str, str] | None = None,
) -> str:
    """Add a run to a campaign, which is made where there is none; returns the run's id. Nothing is left half-written.

    Parameters
    ----------
    series : mapping
        "imet" and/or "hyt" -> readings on one common clock.
    sensors : mapping, optional
        What is known of the sensors, as in campaign.json.
    sources : mapping, optional
        Where each series came from, for the record.

    Raises
    ------
    BenchError
        The campaign, the id or the start do not fit, or another process is writing to the campaign.
    """
    if len({one.dated for one in series.values()}) > 1:
        raise BenchError("one file's times are dates and the other's are numbers; both must be on one clock")
    begins_s = min(one.time_s[0] for one in series.values())
    ends_s = max(one.time_s[-1] for one in series.values())
    late_s = max(one.time_s[0] for one in series.values())
    if late_s >= min(one.time_s[-1] for one in series.values()):
        raise BenchError("the two files do not overlap in time; both must be on one clock")
    first = next(iter(series.values()))
    dated = first.dated
    airs: dict[str, dict[str, float]] = {}
    for place in ("source", "destination"):
        said = {key: getattr(facts, f"{place}_{key}") for key in ("temperature_c", "humidity_percent")}
        airs[place] = {key: value for key, value in said.items() if value is not None}
    start_s = None
    if facts.start is not None:
        start_s, start_dated = time_of(facts.start, layout, "--start", first.unit_s)
        if start_dated != dated or not begins_s < start_s < ends_s:
            raise BenchError(
                f"--start {facts.start} is not within the recording, which is {ends_s - begins_s:.1f} s long; "
                "give it on the clock of the files"
            )
        start_s = round(start_s - begins_s, 6)
    names = sources or {}
    tables = {key: _table(key, one, begins_s) for key, one in series.items()}

    fresh = not is_there(campaign)
    with as_bench_errors(), held(campaign):
        head, changed = _campaign_head(campaign, name, sensors or {}, series)
        id_ = _free_id(campaign, id_, head)
        run = run_document(
            id_,
            started_at=datetime.fromtimestamp(begins_s, UTC).isoformat().replace("+00:00", "Z") if dated else None,
            source=airs["source"],
            destination=airs["destination"],
            airflow_m_s=facts.airflow_m_s,
            pressure_hpa=facts.pressure_hpa,
            start_s=start_s,
            duration_s=facts.duration_s,
            imported={key: {"file": names.get(key, ""), "left_out": dict(one.left_out)} for key, one in series.items()},
        )
        _put(campaign, id_, run, tables, head if changed else None, fresh)
    return id_


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
    campaign: Path, name: str | None, sensors: Mapping[str, Mapping[str, Any]], series: Mapping[str, Series]
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


def _table(sensor: str, series: Series, begins_s: float) -> str:
    """The sensor's CSV file, with the digits that came."""
    columns: dict[str, Sequence[float | None]] = {"time_s": [time_s - begins_s for time_s in series.time_s]}
    for name in ("humidity_percent", "temperature_c") if sensor == "hyt" else ("temperature_c",):
        if name in series.values:
            columns[name] = [None if value is None else value + 0.0 for value in series.values[name]]  # no -0
    forms = dict.fromkeys(columns, "%.6g") | {"time_s": "%.4f", "stale": "%d"}
    if sensor == "hyt":
        columns["stale"] = [0.0] * len(series.time_s)
    return table_text(columns, forms)
