"""A sensor whose film nobody knows and that takes up by the activity at its own temperature, recorded by any plan.

    f' = (e / P_s(T_chip) - f) / film_s, T_chip' = (T_air - T_chip) / chip_s; the reading is f

Saturation after Magnus (Sonntag 1990). The virtual bench's own film is another: it takes up by the vapour pressure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from shockrig.rig.virtual.plans import Shock

EFFECT = "uptake_by_activity"
PERIOD_S, FINE_S = 0.1, 0.01
NOISE_PERCENT, CHIP_NOISE_K = 0.05, 0.01
SCATTER_K, SCATTER_PERCENT, JITTER_S = 0.02, 0.1, 0.01  # of what is stated of airs and starts


@dataclass(frozen=True)
class Act:
    """What is hidden, as the virtual bench's truth has it."""

    effect: str = EFFECT
    parameters: dict[str, float] = field(default_factory=dict)
    channels: tuple[str, ...] = ("humidity",)


@dataclass(frozen=True)
class FilmTruth:
    """Time constants of the film and of the chip that it is on [s]."""

    film_s: float
    chip_s: float
    effects: tuple[Act, ...] = (Act(),)


def draw_film(rng: np.random.Generator) -> FilmTruth:
    """A film and a chip of a small sensor in moving air."""
    return FilmTruth(film_s=float(rng.uniform(4.0, 12.0)), chip_s=float(rng.uniform(5.0, 15.0)))


def saturation_hpa(temperature_c: NDArray[np.float64] | float) -> NDArray[np.float64]:
    return np.asarray(6.112 * np.exp(17.62 * temperature_c / (243.12 + temperature_c)))


def record_film(truth: FilmTruth, plan: Sequence[Shock], rng_or_seed: np.random.Generator | int, out: Path) -> Path:
    """Record a plan with such a sensor into the campaign folder `out`."""
    from shockrig.files.campaign_write import campaign_document, run_document, table_text, write_campaign, write_run

    rng = np.random.default_rng(rng_or_seed)
    (out / "runs").mkdir(parents=True)
    sensors = {"hyt": {"kind": "film on a chip", "body": "lumped"}}
    write_campaign(out, campaign_document("film on a chip", sensors, emulated=True))
    for i, run in enumerate(plan):
        start_s = 10.0 + rng.random() if run.lead_s is None else run.lead_s
        time_s = np.arange(rng.uniform(0.0, PERIOD_S), run.duration_s, PERIOD_S)
        airs = [(air.temperature_c, air.humidity_percent) for air in (run.source, run.destination)]
        since_s = np.arange(0.0, run.duration_s - start_s + FINE_S, FINE_S)
        film, chip_c = responded(truth, *airs, since_s)
        columns = {
            "time_s": time_s,
            "humidity_percent": np.interp(time_s - start_s, since_s, film)
            + NOISE_PERCENT * rng.standard_normal(time_s.size),
            "temperature_c": np.interp(time_s - start_s, since_s, chip_c)
            + CHIP_NOISE_K * rng.standard_normal(time_s.size),
        }
        stated = [
            {
                "temperature_c": round(c + SCATTER_K * rng.standard_normal(), 4),
                "humidity_percent": round(percent + SCATTER_PERCENT * rng.standard_normal(), 4),
            }
            for c, percent in airs
        ]
        document = run_document(
            run.id,
            started_at=f"2026-05-{1 + i // 24:02d}T{i % 24:02d}:00:00Z",
            source=stated[0],
            destination=stated[1],
            airflow_m_s=run.airflow_m_s,
            pressure_hpa=run.pressure_hpa,
            start_s=round(start_s + JITTER_S * rng.standard_normal(), 4),
        )
        (out / "runs" / run.id).mkdir()
        write_run(out / "runs" / run.id, document, {"hyt": table_text({k: v.tolist() for k, v in columns.items()})})
    return out


def responded(
    truth: FilmTruth, source: tuple[float, float], there: tuple[float, float], since_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Film [%RH] and chip [degC] at times after the transfer, equally far apart."""
    (from_c, from_percent), (air_c, percent) = source, there
    chip_c = air_c + (from_c - air_c) * np.exp(-since_s / truth.chip_s)
    drive = np.minimum(percent * saturation_hpa(air_c) / saturation_hpa(chip_c), 100.0)
    film, share = np.full(since_s.size, from_percent), -np.expm1(-FINE_S / truth.film_s)
    for k in range(1, since_s.size):
        film[k] = film[k - 1] + share * (0.5 * (drive[k - 1] + drive[k]) - film[k - 1])
    return film, chip_c
