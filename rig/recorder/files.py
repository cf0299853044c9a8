"""run.json, imet.csv and hyt.csv (shock-run/1) made from a recorded run; every file appears whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from shockrig.rig.recorder.run import COLUMNS, COMPLETE, RunRecord, sample_time_s
from shockrig.rig.seams import Air, Outcome, Reading


def write_text(path: Path, text: str, sync: bool = False) -> None:
    """Write a file beside its name, then rename: no reader sees half of it. `sync` guards against a power cut too."""
    beside = path.with_name(path.name + ".part")
    try:
        with beside.open("w", encoding="utf-8", newline="\n") as file:
            file.write(text)
            if sync:
                file.flush()
                os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError:
        beside.unlink(missing_ok=True)
        raise


def write_json(path: Path, content: Mapping[str, Any], sync: bool = False) -> None:
    """As `write_text`; numbers must be finite."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n", sync)


def write_run_files(folder: Path, record: RunRecord, sync: bool = False) -> None:
    """Make the files of a run in its folder; a sensor without readings gets no file."""
    for sensor, columns in COLUMNS.items():
        text = _csv(record, sensor, columns)
        if text is not None:
            write_text(folder / f"{sensor}.csv", text, sync)
    write_json(folder / "run.json", run_json(record), sync)


def run_json(record: RunRecord) -> dict[str, Any]:
    """Content of run.json: the airs as the reference saw them, the transfer on the clock of the CSV files."""
    header = record.header
    content: dict[str, Any] = {"format": "shock-run/1", "id": record.id}
    if record.started_at or header.get("started_at"):
        content["started_at"] = record.started_at or header["started_at"]
    content["source"] = _mean_air(record.airs["source"])
    content["destination"] = _mean_air(record.airs["destination"])
    measured_hpa = [r.values["pressure_hpa"] for r in record.recorded("imet") if "pressure_hpa" in r.values]
    pressure_hpa = round(sum(measured_hpa) / len(measured_hpa), 2) if measured_hpa else header.get("pressure_hpa")
    for key, value in (("airflow_m_s", header.get("airflow_m_s")), ("pressure_hpa", pressure_hpa)):
        if value is not None:
            content[key] = value
    if record.move is not None and record.zero_s is not None:
        content["transfer"] = {"start_s": round(record.move.start_s - record.zero_s, 6)}
        if record.move.end_s is not None:
            content["transfer"]["duration_s"] = round(record.move.end_s - record.move.start_s, 6)
    content["status"] = record.status
    for key, value in (("reason", record.reason), ("damage", record.damage), ("note", header.get("note"))):
        if value and not (key == "reason" and record.status == COMPLETE):
            content[key] = value
    content["planned"] = {key: header.get(key) for key in ("source", "destination")}
    content["outcomes"] = {sensor: dict(counts) for sensor, counts in record.counts.items()}
    return content


def _csv(record: RunRecord, sensor: str, columns: Sequence[str]) -> str | None:
    flagged = sensor == "hyt"
    kept = (Outcome.OK, Outcome.STALE) if flagged else (Outcome.OK,)
    rows = [r for r in record.recorded(sensor) if r.outcome in kept and columns[0] in r.values]
    if not rows:
        return None
    names = ["time_s", *columns, *(["stale"] if flagged else [])]
    lines = [",".join(names)]
    for reading in rows:
        lines.append(_row(reading, record.zero_s or 0.0, columns, flagged))
    return "\n".join(lines) + "\n"


def _row(reading: Reading, zero_s: float, columns: Sequence[str], flagged: bool) -> str:
    cells = [f"{sample_time_s(reading) - zero_s:.4f}"]
    for name in columns:  # four decimals are finer than either sensor's own step
        value = reading.values.get(name)
        cells.append("" if value is None else f"{value:.4f}")
    if flagged:
        cells.append("1" if reading.outcome is Outcome.STALE else "0")
    return ",".join(cells)


def _mean_air(airs: Sequence[Air]) -> dict[str, float]:
    """Mean of what the reference said; a quantity that it never knew is left out."""
    content = {}
    for name in ("temperature_c", "humidity_percent"):
        known = [value for air in airs if (value := getattr(air, name)) is not None]
        if known:
            content[name] = round(sum(known) / len(known), 4)
    return content
