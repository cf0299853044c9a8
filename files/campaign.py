"""Reads a campaign folder (`shock-campaign/1`: campaign.json, runs/ID/run.json, imet.csv, hyt.csv, air.csv).

Unknown keys and columns are ignored; every error names the file, the line or key, and the mend.
"""

from __future__ import annotations

import json
import sys
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from shockrig.files.errors import InputError

Array = NDArray[np.float64]

DEFAULT_BEAD_RADIUS_M = 4e-4
DEFAULT_FILM_THICKNESS_M = 1e-5
DEFAULT_PRESSURE_HPA = 1013.25
LONGEST_RUN_S = 1e7
LONGEST_ID = 100
# What can be, from the least to the most, both included. Wide enough for any chamber and any sensor: what lies outside
# is a slip of the pen or of the unit (pascal for hectopascal, kelvin for degrees Celsius), not a measurement.
LENGTHS_M = (1e-8, 1.0)  # of a bead or a film
TEMPERATURES_C = (-100.0, 150.0)
AIR_HUMIDITIES_PERCENT = (-5.0, 130.0)
READ_HUMIDITIES_PERCENT = (-10.0, 130.0)
AIRFLOWS_M_S = (0.0, 150.0)
PRESSURES_HPA = (1.0, 2000.0)
AIR_LIMITS = {
    "temperature_c": TEMPERATURES_C,
    "humidity_percent": AIR_HUMIDITIES_PERCENT,
    "airflow_m_s": AIRFLOWS_M_S,
    "pressure_hpa": PRESSURES_HPA,
}
STARTS_S = (-LONGEST_RUN_S, LONGEST_RUN_S)
DURATIONS_S = (0.0, 3600.0)  # of a transfer
TIME_CONSTANTS_S = (0.0, 3600.0)  # of a reference
UNCERTAINTIES = (0.0, 50.0)  # of a reference, in K or %RH
BODIES = ("sphere", "film", "sphere_mean", "cylinder", "cylinder_mean", "plate", "lumped")
DEFAULT_BODIES = {"imet": "sphere", "hyt": "film"}


@dataclass(frozen=True)
class Air:
    """One air of a run; None where it is not known."""

    temperature_c: float | None
    humidity_percent: float | None


@dataclass(frozen=True)
class Trace:
    """What one instrument recorded in one run: arrays of shape (n,), in order of time.

    `values` maps "temperature_c", "humidity_percent" (of air.csv also "airflow_m_s", "pressure_hpa") to arrays; rows
    without a finite value, rows that the sensor flagged as stale and readings beyond what can be are dropped and
    counted in `dropped`. In the trace of an air a cell that is empty or cannot be is NaN; the rest of its row stays.
    """

    time_s: Array
    values: dict[str, Array]
    dropped: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Reference:
    """What is known of the instrument that measured the airs: its lag and its standard uncertainty (one sigma)."""

    temperature_time_constant_s: float = 0.0
    temperature_standard_uncertainty_k: float = 0.02
    humidity_time_constant_s: float = 0.0
    humidity_standard_uncertainty_percent: float = 0.1


@dataclass(frozen=True)
class Run:
    """One fast transfer of the probes from `source` to `destination`, or what they saw in an air that was measured.

    `air` is the air beside the probes where it was measured (air.csv): then it is the input, not a step.
    """

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
    air: Trace | None = None
    reference: Reference = Reference()


@dataclass(frozen=True)
class Campaign:
    """A campaign: several runs on one pair of sensors.

    `bodies` maps "imet" and "hyt" to the shape that the plain model has, one of `BODIES`.
    """

    name: str
    path: Path
    sensors: dict[str, Any]
    bead_radius_m: float
    film_thickness_m: float
    runs: tuple[Run, ...]
    bodies: dict[str, str] = field(default_factory=lambda: dict(DEFAULT_BODIES))

    def to_frame(self) -> pd.DataFrame:
        """One row a run: the two airs, airflow, pressure, start and duration of the transfer, whether the air
        was measured, samples of each sensor."""
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
                    "air_measured": run.air is not None,
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
    file = folder / "campaign.json"
    head = _read_json(file, "shock-campaign/1")
    given = _mapping(head, "sensors", file)
    sensors = {name: _mapping(given, name, file, "sensors.") for name, sensor in given.items() if sensor is not None}
    radius = _number(sensors.get("imet", {}), "bead_radius_m", LENGTHS_M, file, "sensors.imet.")
    thickness = _number(sensors.get("hyt", {}), "film_thickness_m", LENGTHS_M, file, "sensors.hyt.")
    runs_folder = folder / "runs"
    names = sorted(p.name for p in runs_folder.iterdir() if (p / "run.json").is_file()) if runs_folder.is_dir() else []
    if not names:
        raise InputError(f"{runs_folder}: no runs/ID/run.json in it; record or import at least one run")
    runs = tuple(_read_run(runs_folder / name) for name in names)
    first: dict[str, str] = {}
    for name, run in zip(names, runs, strict=True):
        if first.setdefault(run.id, name) != name:
            raise InputError(
                f"{runs_folder / name / 'run.json'}: key id: {run.id!r} is the id of runs/{first[run.id]} already; "
                "give each run its folder's name"
            )
    return Campaign(
        name=str(head.get("name") or folder.name),
        path=folder,
        sensors=sensors,
        bead_radius_m=DEFAULT_BEAD_RADIUS_M if radius is None else radius,
        film_thickness_m=DEFAULT_FILM_THICKNESS_M if thickness is None else thickness,
        runs=runs,
        bodies={name: _read_body(sensors.get(name, {}), name, file) for name in DEFAULT_BODIES},
    )


def _read_body(sensor: dict[str, Any], name: str, file: Path) -> str:
    """The shape of a sensor's plain model; its usual one where none is given."""
    body = sensor.get("body")
    if body is None:
        return DEFAULT_BODIES[name]
    if not isinstance(body, str) or body not in BODIES:
        raise InputError(
            f"{file}: key sensors.{name}.body: expected one of {', '.join(BODIES)}, found {repr(body)[:40]}; "
            f"name one of them or leave it out ({DEFAULT_BODIES[name]})"
        )
    return body


_KNOWN_RUN_KEYS = {
    *("format", "id", "started_at", "source", "destination", "airflow_m_s", "pressure_hpa", "transfer", "reference")
}


def _read_run(folder: Path) -> Run:
    file = folder / "run.json"
    head = _read_json(file, "shock-run/1")
    transfer = _mapping(head, "transfer", file)
    pressure = _number(head, "pressure_hpa", PRESSURES_HPA, file)
    return Run(
        id=_read_id(head, file),
        source=_read_air(head, "source", file),
        destination=_read_air(head, "destination", file),
        airflow_m_s=_number(head, "airflow_m_s", AIRFLOWS_M_S, file),
        pressure_hpa=DEFAULT_PRESSURE_HPA if pressure is None else pressure,
        start_s=_number(transfer, "start_s", STARTS_S, file, "transfer."),
        duration_s=_number(transfer, "duration_s", DURATIONS_S, file, "transfer."),
        imet=_read_trace(folder / "imet.csv", {"temperature_c": TEMPERATURES_C}),
        hyt=_read_trace(
            folder / "hyt.csv",
            {"humidity_percent": READ_HUMIDITIES_PERCENT, "temperature_c": TEMPERATURES_C},
            ("temperature_c",),
        ),
        extra={key: value for key, value in head.items() if key not in _KNOWN_RUN_KEYS},
        air=_read_measured_air(folder / "air.csv"),
        reference=_read_reference(head, file),
    )


def _read_reference(head: dict[str, Any], file: Path) -> Reference:
    given = _mapping(head, "reference", file)
    values = {}
    for name in Reference.__dataclass_fields__:
        limits = TIME_CONSTANTS_S if name.endswith("_time_constant_s") else UNCERTAINTIES
        value = _number(given, name, limits, file, "reference.")
        if value is not None:
            values[name] = value
    return Reference(**values)


def _read_id(head: dict[str, Any], file: Path) -> str:
    """The run's id, which becomes a word of reports and a part of file names; its folder's name where none is given."""
    given = head.get("id")
    if given is None:
        return file.parent.name
    id_ = str(given) if isinstance(given, int) and not isinstance(given, bool) else given
    if (
        not isinstance(id_, str)
        or not 0 < len(id_) <= LONGEST_ID
        or not id_.isprintable()
        or id_.startswith(".")
        or set(id_) & {"/", "\\"}
    ):
        raise InputError(
            f"{file}: key id: expected a plain name, such as that of its folder ({file.parent.name}), "
            f"found {repr(given)[:40]}; mend it or leave it out"
        )
    return id_


def _read_air(head: dict[str, Any], key: str, file: Path) -> Air:
    air = _mapping(head, key, file)
    return Air(
        _number(air, "temperature_c", TEMPERATURES_C, file, f"{key}."),
        _number(air, "humidity_percent", AIR_HUMIDITIES_PERCENT, file, f"{key}."),
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


def _mapping(head: dict[str, Any], key: str, file: Path, prefix: str = "") -> dict[str, Any]:
    """An object; an empty one where the key is left out or null."""
    value = head.get(key)
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise InputError(
            f"{file}: key {prefix}{key}: expected an object, found {type(value).__name__}; write it as {{...}}"
        )
    return value


def _number(head: dict[str, Any], key: str, limits: tuple[float, float], file: Path, prefix: str = "") -> float | None:
    """A number within `limits`; None where the key is left out or null."""
    value = head.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        found = repr(value)[:40]
        raise InputError(
            f"{file}: key {prefix}{key}: expected a finite number, found {found}; give a number or leave it out"
        )
    low, high = limits
    if not low <= value <= high:
        raise InputError(
            f"{file}: key {prefix}{key}: {value:g} cannot be; expected {low:g} to {high:g}: mend it or leave it out"
        )
    return float(value)


def _read_trace(file: Path, limits: dict[str, tuple[float, float]], optional: tuple[str, ...] = ()) -> Trace | None:
    if not file.exists():
        return None
    frame = _read_table(file)
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
    return _in_order(file, time, columns, keep, dropped)


def _read_measured_air(file: Path) -> Trace | None:
    """The air beside the probes: the columns of `AIR_LIMITS` that have a value; a cell without one is NaN."""
    if not file.exists():
        return None
    frame = _read_table(file)
    if "time_s" not in frame.columns or not set(AIR_LIMITS) & set(frame.columns):
        raise InputError(
            f"{file}, line 1: expected the column time_s and at least one of {', '.join(AIR_LIMITS)}; "
            "name the columns so"
        )
    time = _numbers(frame, "time_s", file)
    keep = np.isfinite(time)
    dropped = {"empty": int((~keep).sum()), "implausible": 0}
    columns = {}
    for name, (low, high) in AIR_LIMITS.items():
        if name not in frame.columns:
            continue
        values = _numbers(frame, name, file)
        with np.errstate(invalid="ignore"):
            wrong = (values < low) | (values > high)
        dropped["implausible"] += int((wrong & keep).sum())
        values = np.where(wrong, np.nan, values)
        if np.isfinite(values[keep]).any():
            columns[name] = values
    known = np.zeros(time.size, dtype=bool)
    for values in columns.values():
        known |= np.isfinite(values)
    dropped["empty"] += int((keep & ~known).sum())
    trace = _in_order(file, time, columns, keep & known, dropped)
    if trace.time_s.size < 2:
        raise InputError(
            f"{file}: fewer than two rows with a time and a value that can be; restore the file or take it away"
        )
    return trace


def _read_table(file: Path) -> pd.DataFrame:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header would be cut short
            frame = pd.read_csv(file, skipinitialspace=True, encoding="utf-8-sig", index_col=False, low_memory=False)
    except (ValueError, OSError, pd.errors.ParserError, pd.errors.ParserWarning, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{file}: cannot be read as CSV ({reason}); the first line names the columns") from None
    frame.columns = [str(column).strip() for column in frame.columns]
    return frame


def _in_order(file: Path, time: Array, columns: dict[str, Array], keep: Array, dropped: dict[str, int]) -> Trace:
    """The rows `keep` (bool, shape (n,)) as a trace; an error where their clock goes back or far away."""
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
            raise InputError(f"{file}: column {column}: too many digits; mend it or leave it empty") from None
        empty = values.isna() | (values.astype(str).str.strip() == "")
        wrong = np.flatnonzero(np.isnan(numbers) & ~empty.to_numpy())
        if wrong.size:
            found = str(values.iloc[int(wrong[0])])[:40]
            raise InputError(
                f"{file}, line {int(wrong[0]) + 2}: column {column}: {found!r} is not a number; "
                "mend it or leave it empty"
            )
    return np.where(np.isfinite(numbers), numbers, np.nan)
