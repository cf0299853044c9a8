"""Records a campaign on another lab's bench into a campaign folder (shock-campaign/1), with what that lab writes down.

The truth is returned and never written.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foreign_lab.air import AirCourse, ideal_step, one_approach, ramp, two_stage
from foreign_lab.bodies import SHARE_63, make_body
from foreign_lab.lab import Lab, LabLogger, LabRun
from shockrig.files.campaign_write import campaign_document, run_document, table_text, write_campaign, write_run
from shockrig.rig.bench_errors import BenchError

Array = NDArray[np.float64]

AIR_ERROR = {"temperature": 0.02, "humidity": 0.1}
LENGTH_M = {"temperature": 4e-4, "humidity": 1e-5}
DIE_NOISE_K = 0.02
FASTEST_REFERENCE_S = 1e-4  # a reference faster than this shows the air itself


@dataclass(frozen=True)
class LabTruth:
    """What is true of a recorded bench, by the world's own integration.

    Attributes
    ----------
    kind : str
        The body's shape.
    rate_per_s : float
        alpha / R^2, D / L^2 or 1 / tau of the body alone.
    diffusivity_m2_s : float
        The same times the square of the length that the campaign quotes.
    t63_s, t90_s, t98_s : float
        Of the whole sensor, to an ideal step, where its pace is 1.
    start_s : tuple of float
        When the air at the probes begins to change, run by run, on the run's clock.
    """

    kind: str
    rate_per_s: float
    diffusivity_m2_s: float
    t63_s: float
    t90_s: float
    t98_s: float
    start_s: tuple[float, ...]


def record(bench: Lab, seed: int, out: str | Path) -> LabTruth:
    """Record the bench's plan into the campaign folder `out`, which must not exist yet; return the truth.

    Raises
    ------
    BenchError
        Where `out` exists or the plan is empty.
    """
    out = Path(out)
    if out.exists():
        raise BenchError(f"{out}: exists already; name a new folder")
    if not bench.plan:
        raise BenchError("the plan has no runs; give at least one transfer")
    common, *own = np.random.default_rng(seed).spawn(1 + len(bench.plan))
    calibration = bench.reference.standard_uncertainty * common.standard_normal() if bench.reference else 0.0
    partial = out.with_name(f".{out.name}.partial-{os.getpid()}")
    try:
        (partial / "runs").mkdir(parents=True)
        write_campaign(partial, _campaign_json(bench))
        for i, transfer in enumerate(bench.plan):
            folder = partial / "runs" / f"{i + 1:04d}"
            folder.mkdir()
            _record_run(bench, transfer, float(calibration), own[i], folder)
        partial.rename(out)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    body = bench.body
    return LabTruth(
        kind=body.kind,
        rate_per_s=body.rate_per_s,
        diffusivity_m2_s=body.rate_per_s * (bench.length_m or LENGTH_M[bench.channel]) ** 2,
        t63_s=body.time_to_s(SHARE_63),
        t90_s=body.time_to_s(0.90),
        t98_s=body.time_to_s(0.98),
        start_s=tuple(transfer.start_s for transfer in bench.plan),
    )


def course_of(bench: Lab, transfer: LabRun) -> AirCourse:
    """The air of one transfer."""
    how, ends = bench.approach, (transfer.start_s, transfer.source, transfer.destination)
    if how.kind == "ramp":
        return ramp(*ends, how.first_s)
    if how.kind == "one":
        return one_approach(*ends, how.first_s)
    if how.kind == "two":
        return two_stage(*ends, how.first_s, how.second_s, how.second_share)
    return ideal_step(*ends)


def _record_run(bench: Lab, transfer: LabRun, calibration: float, rng: np.random.Generator, folder: Path) -> None:
    stated, sensor_rng, air_rng, die_rng, hand_rng = rng.spawn(5)
    body = bench.body.faster(transfer.pace * float(np.exp(bench.rate_scatter * hand_rng.standard_normal())))
    course = course_of(bench, transfer)
    time = _stamps(bench.logger, transfer.length_s, sensor_rng)
    shown = _logged(bench.logger, time, course.shown_by(body, time), sensor_rng)
    tables: dict[str, str] = {}
    if bench.channel == "temperature":
        tables["imet"] = _table(time_s=time, temperature_c=shown)
    else:
        die = np.round(bench.other_c + DIE_NOISE_K * die_rng.standard_normal(time.size), 2)
        film = np.clip(shown, 0.0, 100.0)
        tables["hyt"] = _table(time_s=time, humidity_percent=film, temperature_c=die, stale=np.zeros(time.size))
    if bench.reference is not None:
        beside = _stamps(bench.reference.logger, transfer.length_s, air_rng)
        late = bench.reference.time_constant_s
        seen = course.at(beside) if late < FASTEST_REFERENCE_S else course.shown_by(make_body("lumped", late), beside)
        traced = _logged(bench.reference.logger, beside, seen + calibration, air_rng)
        if bench.channel == "temperature":
            tables["air"] = _table(time_s=beside, temperature_c=traced)
        else:
            steady = np.full(beside.size, bench.other_c)
            tables["air"] = _table(time_s=beside, humidity_percent=traced, temperature_c=steady)
    write_run(folder, _run_json(bench, transfer, folder.name, stated), tables)


def _stamps(logger: LabLogger, length_s: float, rng: np.random.Generator) -> Array:
    """Times of the readings that were not lost, on a phase of their own."""
    time = np.arange(rng.uniform(0.0, logger.period_s), length_s, logger.period_s)
    return np.asarray(np.round(time[rng.random(time.size) >= logger.lost], 4))


def _logged(logger: LabLogger, time_s: Array, exact: Array, rng: np.random.Generator) -> Array:
    """Readings (n,) as they are logged, with noise and rounding."""
    noisy = exact + logger.white * rng.standard_normal(time_s.size)
    if logger.correlated > 0.0 and time_s.size:
        kept = np.exp(-np.diff(time_s) / logger.correlation_time_s)
        draws = rng.standard_normal(time_s.size)
        wander = np.empty(time_s.size)
        wander[0] = draws[0]
        for i, keep in enumerate(kept, start=1):
            wander[i] = keep * wander[i - 1] + np.sqrt(1.0 - keep * keep) * draws[i]
        noisy = noisy + logger.correlated * wander
    return np.asarray(np.round(noisy / logger.rounding) * logger.rounding if logger.rounding > 0.0 else noisy)


def _campaign_json(bench: Lab) -> dict[str, Any]:
    temperature = bench.channel == "temperature"
    sensor: dict[str, Any] = {"kind": "somebody's thermometer" if temperature else "somebody's hygrometer"}
    if bench.written.body is not None:
        sensor["body"] = bench.written.body
    if bench.length_m is not None:
        sensor["bead_radius_m" if temperature else "film_thickness_m"] = bench.length_m
    sensors = {"imet" if temperature else "hyt": sensor}
    return campaign_document(bench.name, sensors)


def _run_json(bench: Lab, transfer: LabRun, name: str, rng: np.random.Generator) -> dict[str, Any]:
    written = bench.written
    scatter = AIR_ERROR[bench.channel] if written.air_error is None else written.air_error
    of_source, of_destination, of_start = rng.standard_normal(3)
    airs: dict[str, dict[str, float]] = {}
    if written.airs:
        for key, value, error in (
            ("source", transfer.source, of_source),
            ("destination", transfer.destination, of_destination),
        ):
            stated = round(float(value + scatter * error), 4)
            if bench.channel == "temperature":
                airs[key] = {"temperature_c": stated}
            else:
                airs[key] = {"temperature_c": bench.other_c, "humidity_percent": stated}
    start_s = round(float(transfer.start_s + written.start_error_s * of_start), 4)
    reference = None
    if bench.reference is not None and bench.reference.stated:
        key, unit = ("temperature", "k") if bench.channel == "temperature" else ("humidity", "percent")
        reference = {
            f"{key}_time_constant_s": bench.reference.time_constant_s,
            f"{key}_standard_uncertainty_{unit}": bench.reference.standard_uncertainty,
        }
    return run_document(
        name,
        source=airs.get("source"),
        destination=airs.get("destination"),
        airflow_m_s=bench.airflow_m_s if written.airflow else None,
        start_s=start_s if written.start else None,
        reference=reference,
    )


def _table(**columns: Array) -> str:
    """A CSV file, each number with the digits that it has."""
    return table_text({name: values.tolist() for name, values in columns.items()}, dict.fromkeys(columns, "%.10g"))
