"""A whole campaign simulated at once, straight to a campaign folder (shock-campaign/1), without emulated chips and
without waiting.

All runs are integrated together as arrays and read at each sensor's own sampling instants. The truth is never written
into the folder.
"""

from __future__ import annotations

import datetime
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from shockrig.files.campaign_write import campaign_document, run_document, table_text, write_campaign, write_run
from shockrig.files.common_uncertainty import NOTHING_COMMON
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.virtual.effects import RH, T
from shockrig.rig.virtual.logger_link import Logger, seen_at_s
from shockrig.rig.virtual.physics.converters import humidity_reading, temperature_reading
from shockrig.rig.virtual.physics.exposure import Exposure, air_after
from shockrig.rig.virtual.physics.moist import concentration_ppmv
from shockrig.rig.virtual.physics.probes import Bodies, Probes
from shockrig.rig.virtual.plans import Shock
from shockrig.rig.virtual.truth import Truth

SAMPLING_PERIOD_S = 0.1
FIRST_RUN_AT = datetime.datetime(2026, 5, 1, tzinfo=datetime.UTC)


def simulate_campaign(
    truth: Truth,
    plan: Sequence[Shock],
    rng_or_seed: np.random.Generator | int,
    out: Path,
    name: str = "virtual",
    write_duration: bool = False,
) -> Path:
    """Simulate `plan` on sensors that are as `truth` says and write the campaign folder `out` (which must not exist
    yet).

    `write_duration`: run.json states the measured duration of each transfer; runs whose plan sets a duration always
    state it.
    Returns `out`. Raises BenchError where `out` exists or the plan is empty.
    """
    out = Path(out)
    if out.exists():
        raise BenchError(f"{out}: exists already; name a new folder")
    if not plan:
        raise BenchError("the plan has no runs")
    # streams of their own: what one effect draws changes nothing else, and campaigns of one seed can be compared
    rng, *own = np.random.default_rng(rng_or_seed).spawn(1 + len(plan))
    airs = _true_airs(truth, plan, rng)
    exposure = _exposure(truth, plan, airs)
    start_s = np.array([10.0 + rng.random() if run.lead_s is None else run.lead_s for run in plan])
    scatter = np.exp(truth.rate_scatter * rng.standard_normal((2, len(plan))))
    after_s = max(run.duration_s - start for run, start in zip(plan, start_s, strict=True))
    history = _integrate(truth, exposure, scatter, after_s)

    partial = out.with_name(f".{out.name}.partial-{os.getpid()}")
    try:
        (partial / "runs").mkdir(parents=True)
        sensors = {
            "imet": {"kind": "imet-xf", "serial": "virtual", "bead_radius_m": truth.bead_radius_m},
            "hyt": {"kind": "hyt-271", "serial": "virtual", "film_thickness_m": truth.film_thickness_m},
        }
        write_campaign(
            partial, campaign_document(name, sensors, emulated=True, common_uncertainty=NOTHING_COMMON.document())
        )
        for i, run in enumerate(plan):
            folder = partial / "runs" / run.id
            folder.mkdir()
            document = _run_json(truth, run, i, airs[i], exposure, start_s[i], write_duration, rng)
            one = _Run(truth, exposure, history, i, start_s[i])
            write_run(folder, document, _logged(truth, run, one, own[i]))
        os.rename(partial, out)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return out


def _logged(truth: Truth, run: Shock, felt: _Run, rng: np.random.Generator) -> dict[str, str]:
    """The tables that both sensors' loggers write of a run, {sensor: text}."""
    phases, bead_rng, film_rng, die_rng, lost = rng.spawn(5)
    bead, film = _sampling(run, phases), _sampling(run, phases)
    imet = Logger(truth, T, bead_rng).log(bead, felt.temperature(bead))
    hyt = Logger(truth, RH, film_rng).log(film, felt.humidity(film))
    die = np.round((felt.die(film) + truth.die_noise_k * die_rng.standard_normal(film.size)) / 0.01) * 0.01
    bead_columns = {"time_s": bead, "temperature_c": imet}
    film_columns = {"time_s": film, "humidity_percent": hyt, "temperature_c": die, "stale": np.zeros(film.size)}
    return {
        "imet": table_text(_survivors(truth, lost, bead_columns)),
        "hyt": table_text(_survivors(truth, lost, film_columns), {"temperature_c": "%.3f", "stale": "%d"}),
    }


def _true_airs(truth: Truth, plan: Sequence[Shock], rng: np.random.Generator) -> np.ndarray:
    """True source and destination airs, (runs, 2, 2): degC and %RH. A chamber never hits its set point quite."""
    wanted = np.array(
        [[(air.temperature_c, air.humidity_percent) for air in (run.source, run.destination)] for run in plan],
        dtype=float,
    )
    return wanted + rng.standard_normal(wanted.shape) * (truth.chamber_scatter_k, truth.chamber_scatter_percent)


def _exposure(truth: Truth, plan: Sequence[Shock], airs: np.ndarray) -> Exposure[np.ndarray]:
    pressure = np.array([run.pressure_hpa for run in plan], dtype=float)
    hidden = (truth.effect("finite_transfer") or {"duration_s": 0.0})["duration_s"]
    return Exposure(
        source_c=airs[:, 0, 0],
        source_ppmv=concentration_ppmv(airs[:, 0, 1], airs[:, 0, 0], pressure),
        destination_c=airs[:, 1, 0],
        destination_ppmv=concentration_ppmv(airs[:, 1, 1], airs[:, 1, 0], pressure),
        airflow_m_s=np.array([run.airflow_m_s for run in plan], dtype=float),
        pressure_hpa=pressure,
        duration_s=np.array([hidden if run.transfer_duration_s is None else run.transfer_duration_s for run in plan]),
        irradiance_w_m2=np.array([run.extra.get("irradiance_w_m2", 0.0) for run in plan], dtype=float),
        order=np.arange(len(plan), dtype=float),
    )


def _integrate(
    truth: Truth, exposure: Exposure[np.ndarray], scatter: np.ndarray, after_s: float
) -> dict[str, np.ndarray]:
    """History of the bodies: `since_s` (n,) and each field of Bodies (n, runs)."""
    probes = Probes(truth, exposure, scatter)
    stepper = probes.stepper
    times, rows = [np.zeros(1)], [probes.bodies()]
    while stepper.time_s < after_s:
        even = stepper.even_times_s(after_s)
        if even.size:
            rows.append(probes.advance(even))
        else:
            stepper.step(stepper.longest_step_s())
            even = np.array([stepper.time_s])
            rows.append(probes.bodies())
        times.append(even)
    parts = {name: [np.atleast_2d(getattr(row, name)) for row in rows] for name in Bodies.__dataclass_fields__}
    return {"since_s": np.concatenate(times), **{name: np.concatenate(part) for name, part in parts.items()}}


class _Run:
    """One run of the history, read at any times on the run's clock."""

    def __init__(
        self, truth: Truth, exposure: Exposure[np.ndarray], history: dict[str, np.ndarray], index: int, start_s: float
    ):
        self._truth, self._start_s = truth, start_s
        fields: dict[str, Any] = {k: getattr(exposure, k) for k in Exposure.__dataclass_fields__}
        own: dict[str, Any] = {k: v[index : index + 1] if isinstance(v, np.ndarray) else v for k, v in fields.items()}
        self._exposure: Exposure[np.ndarray] = Exposure(**own)
        self._since = history["since_s"]
        self._columns = {k: v[:, index] for k, v in history.items() if k != "since_s"}

    def _bodies(self, since: np.ndarray) -> Bodies[np.ndarray]:
        return Bodies(**{k: np.interp(since, self._since, column)[:, None] for k, column in self._columns.items()})

    def temperature(self, time_s: np.ndarray) -> np.ndarray:
        since = seen_at_s(self._truth, T, time_s) - self._start_s
        return temperature_reading(self._truth, self._exposure, self._bodies(since), since[:, None])[:, 0]

    def humidity(self, time_s: np.ndarray) -> np.ndarray:
        since = seen_at_s(self._truth, RH, time_s) - self._start_s
        air_c, _ = air_after(self._truth, self._exposure, since[:, None])
        return humidity_reading(self._truth, self._exposure, self._bodies(since), air_c, since[:, None])[:, 0]

    def die(self, time_s: np.ndarray) -> np.ndarray:
        return np.interp(seen_at_s(self._truth, RH, time_s) - self._start_s, self._since, self._columns["die_c"])


def _sampling(run: Shock, rng: np.random.Generator) -> np.ndarray:
    phase = rng.uniform(0.0, SAMPLING_PERIOD_S)
    return np.round(np.arange(phase, run.duration_s, SAMPLING_PERIOD_S), 4)


def _survivors(
    truth: Truth, rng: np.random.Generator, columns: Mapping[str, np.ndarray]
) -> dict[str, list[float | None]]:
    """The rows of a table that are not lost."""
    kept = rng.random(columns["time_s"].size) >= truth.missing_fraction
    return {name: values[kept].tolist() for name, values in columns.items()}


def _run_json(
    truth: Truth,
    run: Shock,
    index: int,
    airs: np.ndarray,
    exposure: Exposure[np.ndarray],
    start_s: float,
    write_duration: bool,
    rng: np.random.Generator,
) -> dict[str, Any]:
    reported = airs + rng.standard_normal((2, 2)) * (truth.reference_scatter_k, truth.reference_scatter_percent)
    noted_s = round(float(start_s + truth.trigger_jitter_s * rng.standard_normal()), 4)
    stated = write_duration or run.transfer_duration_s is not None
    source, destination = (
        {"temperature_c": round(float(t), 4), "humidity_percent": round(float(h), 4)} for t, h in reported
    )
    extra: dict[str, Any] = dict(run.extra)
    return run_document(
        run.id,
        started_at=(FIRST_RUN_AT + datetime.timedelta(hours=index)).strftime("%Y-%m-%dT%H:%M:%SZ"),
        source=source,
        destination=destination,
        airflow_m_s=run.airflow_m_s,
        pressure_hpa=run.pressure_hpa,
        start_s=noted_s,
        duration_s=round(float(exposure.duration_s[index]), 4) if stated else None,
        **extra,
    )
