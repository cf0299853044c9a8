"""What a campaign holds: its sensors, its runs, what it states of both; as data alone.

campaign.py reads it from its folder, campaign_views.py shows it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.files.campaign_names import DEFAULT_BODIES, FIRST_PROBE, ReferenceResponse
from shockrig.files.common_uncertainty import CommonUncertainty
from shockrig.files.traces import Trace

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class RunAir:
    """One air of a run; None where it is not known."""

    temperature_c: float | None
    humidity_percent: float | None


@dataclass(frozen=True)
class Run:
    """One fast transfer of the probes from `source` to `destination`, or what they saw in an air that was measured.

    `air` is the air beside the probes where it was measured (air.csv): then it is the input, not a step. `set_aside`
    maps a channel to the sentence of the check that keeps its readings from being fitted. `started_at` is the time of
    day at time_s = 0 as the file has it (ISO 8601). `misspelt` are keys that mean nothing, with the ones that they are
    nearly. Where `pressure_known` is false nobody stated the pressure, and `pressure_hpa` is the standard one.
    """

    id: str
    source: RunAir
    destination: RunAir
    airflow_m_s: float | None
    pressure_hpa: float
    start_s: float | None
    duration_s: float | None
    imet: Trace | None
    hyt: Trace | None
    extra: dict[str, Any] = field(default_factory=dict)
    air: Trace | None = None
    reference: ReferenceResponse = ReferenceResponse()
    set_aside: Mapping[str, str] = field(default_factory=dict)
    started_at: str | None = None
    misspelt: tuple[str, ...] = ()
    pressure_known: bool = True

    @property
    def step_seen(self) -> tuple[float, float] | None:
        """When an import saw the step of a log that states no start, and the standard uncertainty of that [s]; None of
        other runs."""
        seen = tuple(self.extra.get(key) for key in ("step_seen_s", "step_seen_standard_uncertainty_s"))
        told = [float(one) for one in seen if isinstance(one, int | float) and not isinstance(one, bool)]
        return (told[0], told[1]) if len(told) == 2 and all(map(math.isfinite, told)) and told[1] > 0.0 else None


@dataclass(frozen=True)
class CampaignData:
    """What a `Campaign` (campaign.py, which describes the fields) holds."""

    name: str
    path: Path
    sensors: dict[str, Any]
    bead_radius_m: float
    film_thickness_m: float
    runs: tuple[Run, ...]
    bodies: dict[str, str] = field(default_factory=lambda: dict(DEFAULT_BODIES))
    emulated: bool = False
    probe: str = FIRST_PROBE
    common: CommonUncertainty | None = None
    sessions: tuple[Mapping[str, Any], ...] = ()
    misspelt: tuple[str, ...] = ()
    planned: tuple[str, ...] = ()

    def to_frame(self) -> pd.DataFrame:
        """One row a run: the two airs, airflow, pressure, transfer, whether the air was measured, samples."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "id": run.id,
                    "source_temperature_c": run.source.temperature_c,
                    "source_humidity_percent": run.source.humidity_percent,
                    "destination_temperature_c": run.destination.temperature_c,
                    "destination_humidity_percent": run.destination.humidity_percent,
                    "airflow_m_s": run.airflow_m_s,
                    "pressure_hpa": run.pressure_hpa if run.pressure_known else None,
                    "start_s": run.start_s,
                    "duration_s": run.duration_s,
                    "air_measured": run.air is not None,
                    "imet_samples": 0 if run.imet is None else run.imet.time_s.size,
                    "hyt_samples": 0 if run.hyt is None else run.hyt.time_s.size,
                }
                for run in self.runs
            ]
        ).set_index("id")
