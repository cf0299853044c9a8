"""Reads a campaign folder (`shock-campaign/1`: campaign.json, runs/ID/run.json, imet.csv, hyt.csv) and validates it
all.

Unknown keys and columns are ignored; every error names the file, the line or key, and the mend.
"""

from __future__ import annotations

import json
import math
import sys
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.errors import InputError

Array = NDArray[np.float64]

DEFAULT_BEAD_RADIUS_M = 4e-4
DEFAULT_FILM_THICKNESS_M = 1e-5
DEFAULT_PRESSURE_HPA = 1013.25
LENGTHS_M = (1e-8, 1.0)  # of a bead or a film
LONGEST_RUN_S = 1e7
AT_LEAST_ZERO = -1e-300  # as a lower limit that is itself not allowed


@dataclass(frozen=True)
class Air:
    """One air of a run; None where it is not known."""

    temperature_c: float | None
    humidity_percent: float | None


@dataclass(frozen=True)
class Trace:
    """What one sensor recorded in one run: arrays of shape (n,), in order of time.

    `values` maps "temperature_c", "humidity_percent" to arrays; rows without a finite value, rows that the sensor
    flagged as stale and readings beyond what the sensor can give are dropped and counted in `dropped`.
    """

    time_s: Array
    values: dict[str, Array]
    dropped: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Run:
    """One fast transfer of the probes from `source` to `destination`."""

    id: str
    source: Air
    destination: Air
    airflow_m_s: float | None
    pressure_hpa: float
    start_s: float | None
    duration_s: float | None
    imet: Trace | None
    hyt: Trace | None
    extra: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Campaign:
    """A campaign: several runs on one pair of sensors."""

    name: str
    path: Path
    sensors: dict[str, Any]
    bead_radius_m: float
    film_thickness_m: float
    runs: tuple[Run, ...]

    def to_frame(self) -> pd.DataFrame:
        """One row a run: the two airs, airflow, pressure, start and duration of the transfer, samples of each
        sensor."""
        return pd.DataFrame(
            [
                {
                    "id": run.id,
                    "source_temperature_c": run.source.temperature_c,
                    "source_humidity_percent": run.source.humidity_percent,
                    "destination_temperature_c": run.destination.temperature_c,
                    "destination_humidity_percent": run.destination.humidity_percent,
                    "airflow_m_s": run.airflow_m_s,
                    "pressure_hpa": run.pressure_hpa,
                    "start_s": run.start_s,
                    "duration_s": run.duration_s,
                    "imet_samples": 0 if run.imet is None else run.imet.time_s.size,
                    "hyt_samples": 0 if run.hyt is None else run.hyt.time_s.size,
                }
                for run in self.runs
            ]
        ).set_index("id")


def read_campaign(path: str | Path) -> Campaign:
    """Read and validate a campaign folder.

    Raises
    ------
    InputError
        Where a file is missing, is not of its format, or holds a value that cannot be: names file, line or key, mend.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such campaign folder; give the folder that holds campaign.json")
    head = _read_json(folder / "campaign.json", "shock-campaign/1")
    sensors = _mapping(head.get("sensors", {}), folder / "campaign.json", "sensors")
    for name, sensor in sensors.items():
        _mapping(sensor, folder / "campaign.json", f"sensors.{name}")
    radius = _number(sensors.get("imet") or {}, "bead_radius_m", folder / "campaign.json", "sensors.imet.", *LENGTHS_M)
    head_file = folder / "campaign.json"
    thickness = _number(sensors.get("hyt") or {}, "film_thickness_m", head_file, "sensors.hyt.", *LENGTHS_M)
    runs_folder = folder / "runs"
    names = sorted(p.name for p in runs_folder.iterdir() if (p / "run.json").is_file()) if runs_folder.is_dir() else []
    if not names:
        raise InputError(f"{runs_folder}: no runs/ID/run.json in it; record or import at least one run")
    return Campaign(
        name=str(head.get("name") or folder.name),
        path=folder,
        sensors=sensors,
        bead_radius_m=DEFAULT_BEAD_RADIUS_M if radius is None else radius,
        film_thickness_m=DEFAULT_FILM_THICKNESS_M if thickness is None else thickness,
        runs=tuple(_read_run(runs_folder / name) for name in names),
    )


_KNOWN_RUN_KEYS = {"format", "id", "started_at", "source", "destination", "airflow_m_s", "pressure_hpa", "transfer"}


def _read_run(folder: Path) -> Run:
    file = folder / "run.json"
    head = _read_json(file, "shock-run/1")
    transfer = _mapping(head.get("transfer") or {}, file, "transfer")
    pressure = _number(head, "pressure_hpa", file, low=0.0)
    return Run(
        id=str(head.get("id") or folder.name),
        source=_read_air(head, "source", file),
        destination=_read_air(head, "destination", file),
        airflow_m_s=_number(head, "airflow_m_s", file, low=AT_LEAST_ZERO),
        pressure_hpa=DEFAULT_PRESSURE_HPA if pressure is None else pressure,
        start_s=_number(transfer, "start_s", file, "transfer."),
        duration_s=_number(transfer, "duration_s", file, "transfer.", low=AT_LEAST_ZERO),
        imet=_read_trace(folder / "imet.csv", {"temperature_c": (-100.0, 150.0)}),
        hyt=_read_trace(
            folder / "hyt.csv",
            {"humidity_percent": (-10.0, 130.0), "temperature_c": (-100.0, 150.0)},
            ("temperature_c",),
        ),
        extra={key: value for key, value in head.items() if key not in _KNOWN_RUN_KEYS},
    )


def _read_air(head: dict[str, Any], key: str, file: Path) -> Air:
    air = _mapping(head.get(key) or {}, file, key)
    return Air(
        _number(air, "temperature_c", file, f"{key}.", low=-273.15),
        _number(air, "humidity_percent", file, f"{key}.", low=-1.0, high=120.0),
    )


def _read_json(file: Path, expected: str) -> dict[str, Any]:
    try:
        text = file.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{file}: no such file; give the folder that holds it") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: cannot be read as UTF-8 text ({error}); restore the file") from None
    try:
        head = json.loads(text)
    except (ValueError, RecursionError) as error:  # also numbers of too many digits
        line = getattr(error, "lineno", 1)
        raise InputError(f"{file}, line {line}: is not JSON ({error}); mend the line or restore the file") from None
    if not isinstance(head, dict):
        raise InputError(f'{file}: expected an object with "format": "{expected}", found {type(head).__name__}')
    if head.get("format") != expected:
        raise InputError(
            f'{file}: key format: expected "{expected}", found {head.get("format")!r}; use a file of that format'
        )
    return head


def _mapping(value: Any, file: Path, key: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{file}: key {key}: expected an object, found {type(value).__name__}; write it as {{...}}")
    return value


def _number(
    head: dict[str, Any], key: str, file: Path, prefix: str = "", low: float = -math.inf, high: float = math.inf
) -> float | None:
    value = head.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        found = repr(value)[:40]
        raise InputError(
            f"{file}: key {prefix}{key}: expected a finite number, found {found}; give a number or leave it out"
        )
    if low == AT_LEAST_ZERO and value < 0:
        raise InputError(f"{file}: key {prefix}{key}: {value} cannot be; expected 0 or more")
    if not low < value < high:
        raise InputError(
            f"{file}: key {prefix}{key}: {value} cannot be; expected a number above {low:g} and below {high:g}"
        )
    return float(value)


def _read_trace(file: Path, limits: dict[str, tuple[float, float]], optional: tuple[str, ...] = ()) -> Trace | None:
    if not file.exists():
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header would be cut short
            frame = pd.read_csv(file, skipinitialspace=True, encoding="utf-8-sig", index_col=False, low_memory=False)
    except (ValueError, OSError, pd.errors.ParserError, pd.errors.ParserWarning, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{file}: cannot be read as CSV ({reason}); the first line names the columns") from None
    frame.columns = [str(column).strip() for column in frame.columns]
    needed = ["time_s", *(name for name in limits if name not in optional)]
    for column in needed:
        if column not in frame.columns:
            raise InputError(f"{file}, line 1: no column {column}; expected the columns {', '.join(needed)}")
    columns = {name: _numbers(frame, name, file) for name in ("time_s", *limits) if name in frame.columns}
    for name in optional:
        columns.setdefault(name, np.full(len(frame), np.nan))
    time = columns.pop("time_s")
    keep = np.isfinite(time)
    dropped = {"empty": int((~keep).sum())}
    if "stale" in frame.columns:
        stale = _numbers(frame, "stale", file) > 0
        dropped["stale"] = int((stale & keep).sum())
        keep &= ~stale
    for name, (low, high) in limits.items():
        with np.errstate(invalid="ignore"):
            wrong = (columns[name] < low) | (columns[name] > high)
        dropped["implausible"] = dropped.get("implausible", 0) + int((wrong & keep).sum())
        keep &= ~wrong
        if name not in optional:
            dropped["empty"] += int((keep & ~np.isfinite(columns[name])).sum())
            keep &= np.isfinite(columns[name])
    far = np.flatnonzero(keep & (np.abs(time) > LONGEST_RUN_S))
    if far.size:
        raise InputError(
            f"{file}, line {int(far[0]) + 2}: time_s is {time[far[0]]:g}; "
            "a run's clock counts seconds from near its start"
        )
    back = np.flatnonzero(np.diff(time[keep]) < 0)
    if back.size:
        line = int(np.flatnonzero(keep)[back[0] + 1]) + 2
        raise InputError(f"{file}, line {line}: time_s goes back; rows must be in order of time on one monotonic clock")
    fresh = np.flatnonzero(keep)
    again = np.diff(time[fresh], prepend=-np.inf) <= 0
    dropped["repeated_time"] = int(again.sum())
    fresh = fresh[~again]
    return Trace(
        time[fresh], {name: value[fresh] for name, value in columns.items()}, {k: v for k, v in dropped.items() if v}
    )


def _numbers(frame: pd.DataFrame, column: str, file: Path) -> Array:
    """A column as floats; empty cells are NaN, anything else that is not a number is an error with its line."""
    values = frame[column]
    if values.dtype.kind in "fiu":
        numbers = values.to_numpy(dtype=float)
    else:
        try:
            numbers = pd.to_numeric(values, errors="coerce").to_numpy(dtype=float)
        except OverflowError:
            raise InputError(
                f"{file}: column {column}: too many digits; mend it or leave it empty"
            ) from None
        empty = values.isna() | (values.astype(str).str.strip() == "")
        wrong = np.flatnonzero(np.isnan(numbers) & ~empty.to_numpy())
        if wrong.size:
            found = str(values.iloc[int(wrong[0])])[:40]
            raise InputError(
                f"{file}, line {int(wrong[0]) + 2}: column {column}: {found!r} is not a number; "
                "mend it or leave it empty"
            )
    return np.where(np.isfinite(numbers), numbers, np.nan)
