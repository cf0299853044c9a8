"""A campaign in other formats: netCDF (CF), Parquet, and bluesky event documents (JSON lines). Ways out, none back in.

What a campaign does not know is missing or NaN; times are seconds on each run's own clock, and where the run's time of
day is known also since 1970.
"""

from __future__ import annotations

import importlib.util
import json
import os
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from shockrig.files.campaign import Campaign, Run
from shockrig.files.disk import beside, demand_text_name
from shockrig.files.errors import InputError
from shockrig.files.json_files import known
from shockrig.files.traces import Trace

UNITS = {"temperature_c": "degC", "humidity_percent": "%", "airflow_m_s": "m s-1", "pressure_hpa": "hPa"}
CF_NAMES = {"temperature_c": "air_temperature", "humidity_percent": "relative_humidity"}  # of the air, not of a sensor
TRACES = ("imet", "hyt", "air")
NAMESPACE = uuid.UUID(
    "6d1cfe0b-5d31-5a43-9a2b-8a3f4d8f7c11"
)  # of the documents' uids: the same campaign, the same uids


def write_netcdf(campaign: Campaign, path: Path, history: str) -> None:
    """CF-1.11, discrete sampling geometry "timeSeries" as an indexed ragged array: a run is an instance.

    For each sensor the readings of all runs one after another, with the run of each in `SENSOR_run`; for each run its
    airs, airflow, pressure and transfer. Raises OSError where the disk does not take it.
    """
    import netCDF4

    def write(part: Path) -> None:
        with netCDF4.Dataset(part, "w", format="NETCDF4") as data:
            data.Conventions, data.featureType = "CF-1.11", "timeSeries"
            data.title, data.history, data.source = f"Shock campaign {campaign.name}", history, _kinds(campaign)
            data.createDimension("run", len(campaign.runs))
            ids = data.createVariable("run_id", str, ("run",))
            ids.cf_role, ids.long_name = "timeseries_id", "id of the run"
            ids[:] = np.array([run.id for run in campaign.runs], dtype=object)
            began = _number(data, "began", "run", "seconds since 1970-01-01 00:00:00", "time of day at time_s = 0")
            began.calendar = "standard"
            began[:] = [_missing(_began_s(run)) for run in campaign.runs]
            for place in ("source", "destination"):
                for quantity in ("temperature_c", "humidity_percent"):
                    name, words = f"{place}_{quantity}", f"{quantity.partition('_')[0]} of the {place} air"
                    variable = _number(data, name, "run", UNITS[quantity], words)
                    variable.standard_name = CF_NAMES[quantity]
                    variable[:] = [_missing(getattr(getattr(run, place), quantity)) for run in campaign.runs]
            for name, unit, words in (
                ("airflow_m_s", "m s-1", "speed of the destination air past the probes"),
                ("pressure_hpa", "hPa", "air pressure"),
                ("start_s", "s", "when the probes left the source air, on the run's clock"),
                ("duration_s", "s", "how long the transfer took"),
            ):
                _number(data, name, "run", unit, words)[:] = [_missing(getattr(run, name)) for run in campaign.runs]
            for sensor in TRACES:
                _sensor(data, campaign, sensor)

    replace_whole(path, write)


def _sensor(data: Any, campaign: Campaign, sensor: str) -> None:
    traces = [(i, trace) for i, run in enumerate(campaign.runs) if (trace := getattr(run, sensor)) is not None]
    if not traces:
        return
    data.createDimension(sensor, sum(trace.time_s.size for _, trace in traces))
    index = data.createVariable(f"{sensor}_run", "i4", (sensor,), zlib=True)
    index.instance_dimension, index.long_name = "run", "place of the reading's run among the runs"
    index[:] = np.concatenate([np.full(trace.time_s.size, i) for i, trace in traces])
    time = _number(data, f"{sensor}_time", sensor, "s", "time on the run's own clock")
    time[:] = np.concatenate([trace.time_s for _, trace in traces])
    for quantity in dict.fromkeys(name for _, trace in traces for name in trace.values):
        words = f"{quantity.partition('_')[0]} as {sensor} read it"
        variable = _number(data, f"{sensor}_{quantity}", sensor, UNITS[quantity], words)
        variable.coordinates = f"{sensor}_time"
        variable[:] = np.concatenate([_column(trace, quantity) for _, trace in traces])


def _number(data: Any, name: str, dimension: str, unit: str, words: str) -> Any:
    variable = data.createVariable(name, "f8", (dimension,), fill_value=np.nan, zlib=True)
    variable.units, variable.long_name = unit, words
    return variable


def write_parquet(campaign: Campaign, path: Path) -> None:
    """One row for each reading: run, sensor, time_s and what it read; the runs' table is in the file's metadata.

    Raises InputError where pyarrow is not installed, OSError where the disk does not take it.
    """
    import pandas as pd

    if importlib.util.find_spec("pyarrow") is None:  # what pandas writes with
        raise InputError(f"{path}: Parquet needs pyarrow; pip install 'shockrig[parquet]', or export to .nc")
    parts = []
    for run in campaign.runs:
        for sensor in TRACES:
            trace = getattr(run, sensor)
            if trace is not None:
                columns = {quantity: _column(trace, quantity) for quantity in UNITS}
                parts.append(pd.DataFrame({"run": run.id, "sensor": sensor, "time_s": trace.time_s, **columns}))
    if not parts:
        raise InputError(f"{campaign.path}: holds no readings; there is nothing to export")
    table = pd.concat(parts, ignore_index=True).dropna(axis="columns", how="all")
    table.attrs = {"campaign": campaign.name, "runs": [_facts(run) for run in campaign.runs]}
    replace_whole(path, lambda part: table.to_parquet(part, index=False))


def write_bluesky(campaign: Campaign, path: Path) -> None:
    """Event documents of bluesky's event model, one JSON list [name, document] a line: each run a run of its own.

    Raises OSError where the disk does not take it.
    """

    def write(part: Path) -> None:
        with part.open("w", encoding="utf-8") as file:
            for document in documents(campaign):
                file.write(json.dumps(document, allow_nan=False, ensure_ascii=False) + "\n")

    replace_whole(path, write)


def _described(sensor: str, trace: Trace, source: str) -> dict[str, Any]:
    """What a descriptor says of a sensor's quantities."""
    keys = [f"{sensor}_{quantity}" for quantity in trace.values]
    known = {"source": source, "dtype": "number", "shape": [], "object_name": sensor}
    return {
        "name": sensor,
        "data_keys": {key: {**known, "units": UNITS[one]} for key, one in zip(keys, trace.values, strict=True)},
        "object_keys": {sensor: keys},
        "configuration": {},
        "hints": {sensor: {"fields": keys}},
    }


def documents(campaign: Campaign) -> Iterator[tuple[str, dict[str, Any]]]:
    """Start, descriptors, events and stop of every run, as bluesky's event model has them.

    Times are seconds since 1970 where the run's time of day is known, else on its own clock.
    """
    for number, run in enumerate(campaign.runs, start=1):
        began_s = _began_s(run) or 0.0
        key = f"{campaign.name}/{run.id}"
        start = str(uuid.uuid5(NAMESPACE, key))
        end_s = began_s
        facts = {name: value for name, value in _facts(run).items() if name != "id"}
        yield (
            "start",
            {"uid": start, "time": began_s, "scan_id": number, "plan_name": "shock", "run_id": run.id, **facts},
        )
        counts = {}
        for sensor in TRACES:
            trace = getattr(run, sensor)
            if trace is None or not trace.time_s.size:
                continue
            descriptor = str(uuid.uuid5(NAMESPACE, f"{key}/{sensor}"))
            about = {"uid": descriptor, "run_start": start, "time": began_s}
            yield "descriptor", {**about, **_described(sensor, trace, _kind(campaign, sensor))}
            counts[sensor] = int(trace.time_s.size)
            end_s = max(end_s, began_s + float(trace.time_s[-1]))
            columns = {f"{sensor}_{quantity}": values for quantity, values in trace.values.items()}
            for i, time_s in enumerate((began_s + trace.time_s).tolist()):
                # an event holds every key of its descriptor, and JSON no NaN: what is missing is null
                data = {name: _plain(values[i]) for name, values in columns.items()}
                yield (
                    "event",
                    {
                        "uid": str(uuid.uuid5(NAMESPACE, f"{key}/{sensor}/{i}")),
                        "descriptor": descriptor,
                        "time": time_s,
                        "seq_num": i + 1,
                        "data": data,
                        "timestamps": dict.fromkeys(data, time_s),
                        "filled": {},
                    },
                )
        stop = str(uuid.uuid5(NAMESPACE, f"{key}/stop"))
        yield (
            "stop",
            {"uid": stop, "run_start": start, "time": end_s, "exit_status": "success", "num_events": counts},
        )


def _facts(run: Run) -> dict[str, Any]:
    """What a run is, without its readings."""

    def air(place: str) -> dict[str, float]:
        found = getattr(run, place)
        return known(temperature_c=found.temperature_c, humidity_percent=found.humidity_percent)

    return known(
        id=run.id,
        source=air("source"),
        destination=air("destination"),
        airflow_m_s=run.airflow_m_s,
        pressure_hpa=run.pressure_hpa if run.pressure_known else None,
        transfer=known(start_s=run.start_s, duration_s=run.duration_s) or None,
    )


def _began_s(run: Run) -> float | None:
    """Seconds since 1970 at the run's time_s = 0; None where its time of day is not known."""
    try:
        began = datetime.fromisoformat(str(run.started_at).replace("Z", "+00:00"))
        return began.timestamp() if began.tzinfo is not None else None
    except (ValueError, OverflowError):
        return None


def _column(trace: Trace, quantity: str) -> np.ndarray:
    values = trace.values.get(quantity)
    return np.full(trace.time_s.size, np.nan) if values is None else values


def _missing(value: float | None) -> float:
    return np.nan if value is None else value


def _plain(value: float) -> float | None:
    return None if value != value else float(value)


def _kind(campaign: Campaign, sensor: str) -> str:
    stated: Mapping[str, Any] = campaign.sensors.get(sensor, {})
    return " ".join(str(stated[key]) for key in ("kind", "serial") if stated.get(key)) or sensor


def _kinds(campaign: Campaign) -> str:
    invented = "; emulated: invented, not measured" if campaign.emulated else ""
    return ", ".join(f"{name}: {_kind(campaign, name)}" for name in campaign.sensors) + invented


def replace_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Have a file written beside its name, then rename it: it is there whole or not at all."""
    demand_text_name(path, "give another --out")
    part = beside(path)
    try:
        write(part)
        os.replace(part, path)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise
