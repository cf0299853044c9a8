"""run.json, imet.csv, hyt.csv, imet-2.csv ... of a recorded run (shock-run/1); each appears whole or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from shockrig.files.campaign_write import run_document, table_text, write_run
from shockrig.rig.recorder.run_journal import COMPLETE, RunRecord, columns_of, sample_time_s
from shockrig.rig.recorder.run_quality import mean_of
from shockrig.rig.seams import Air, Outcome


def write_run_files(folder: Path, record: RunRecord, sync: bool = False) -> None:
    """Make the files of a run in its folder; a sensor without readings gets no file."""
    tables = {sensor: table for sensor in record.readings if (table := _table(record, sensor, columns_of(sensor)))}
    write_run(folder, run_json(record), tables, sync=sync)


def run_json(record: RunRecord) -> dict[str, Any]:
    """Content of run.json: the airs as the reference saw them, the transfer on the clock of the CSV files."""
    header, move = record.header, record.move
    measured_hpa = [r.values["pressure_hpa"] for r in record.recorded("imet") if "pressure_hpa" in r.values]
    start_s = duration_s = None
    if move is not None and record.zero_s is not None:
        start_s = round(move.start_s - record.zero_s, 6)
        duration_s = None if move.end_s is None else round(move.end_s - move.start_s, 6)
    return run_document(
        record.id,
        started_at=record.started_at or header.get("started_at") or None,
        source=_mean_air(record.airs["source"]),
        destination=_mean_air(record.airs["destination"]),
        airflow_m_s=header.get("airflow_m_s"),
        pressure_hpa=round(sum(measured_hpa) / len(measured_hpa), 2) if measured_hpa else header.get("pressure_hpa"),
        irradiance_w_m2=header.get("irradiance_w_m2"),
        start_s=start_s,
        duration_s=duration_s,
        status=record.status,
        reason=record.reason if record.reason and record.status != COMPLETE else None,
        damage=record.damage or None,
        note=header.get("note") or None,
        notes=[{"time_s": round(at_s - (record.zero_s or at_s), 3), "text": text} for at_s, text in record.notes]
        or None,
        session=header.get("session"),
        airs_from=header.get("airs_from") or None,
        planned={key: header.get(key) for key in ("source", "destination")},
        outcomes={sensor: dict(counts) for sensor, counts in record.counts.items()},
    )


def _table(record: RunRecord, sensor: str, columns: Sequence[str]) -> str | None:
    """The sensor's CSV file; None where it has no readings, and for what is no probe's sensor."""
    flagged = "humidity_percent" in columns
    kept = (Outcome.OK, Outcome.STALE) if flagged else (Outcome.OK,)
    rows = [r for r in record.recorded(sensor) if r.outcome in kept and columns and columns[0] in r.values]
    if not rows:
        return None
    zero_s = record.zero_s or 0.0
    table: dict[str, list[float | None]] = {"time_s": [sample_time_s(reading) - zero_s for reading in rows]}
    table |= {name: [reading.values.get(name) for reading in rows] for name in columns}
    if flagged:
        table["stale"] = [float(reading.outcome is Outcome.STALE) for reading in rows]
    return table_text(table, {"stale": "%d"})


def _mean_air(airs: Sequence[Air]) -> dict[str, float]:
    """Mean of what the reference said; a quantity that it never knew is left out."""
    means = {name: mean_of(airs, name) for name in ("temperature_c", "humidity_percent")}
    return {name: round(value, 4) for name, value in means.items() if value is not None}
