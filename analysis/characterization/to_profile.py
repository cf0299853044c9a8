"""A characterization as the sensor profile that flights are corrected with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from shockrig.analysis.characterization.result import Characterization
from shockrig.files.profile import DiffusivityRow, HumidityProfile, Profile, TemperatureProfile, Uncertain


def to_profile(result: Characterization, provenance: Mapping[str, Any] | None = None) -> Profile:
    """The sensor profile of a characterization; `provenance` is added to what the result itself knows."""
    temperature = humidity = None
    if (t := result.temperature) is not None:
        row = t.rows[0]
        temperature = TemperatureProfile(
            thermal_diffusivity_m2_s=Uncertain(row.diffusivity_m2_s, row.standard_uncertainty),
            bead_radius_m=t.channel.length_m,
            response_time_s=row.response,
            noise_k=t.noise.standard_deviation,
            sampling_period_s=t.channel.sampling_period_s,
            effects=t.effects,
            discovered=t.discovered,
        )
    if (h := result.humidity) is not None:
        humidity = HumidityProfile(
            diffusivity_table=tuple(
                DiffusivityRow(r.ambient_c, r.diffusivity_m2_s, r.standard_uncertainty, len(r.runs), r.response)
                for r in h.rows
            ),
            film_thickness_m=h.channel.length_m,
            noise_percent=h.noise.standard_deviation,
            sampling_period_s=h.channel.sampling_period_s,
            effects=h.effects,
            discovered=h.discovered,
        )
    known = {
        "campaign": result.campaign.name,
        "runs_used": {name: list(found.runs) for name, found in result.channels().items()},
        "left_out": [
            {"run": entry.run, "channel": entry.channel, "reason": entry.reason}
            for found in result.channels().values()
            for entry in found.set_aside
        ],
        "missing": dict(result.missing),
        "seed": result.seed,
        "basis": {str(row.ambient_c): row.basis for row in (result.humidity.rows if result.humidity else ())},
        "rmse": {name: found.rmse for name, found in result.channels().items()},
        "optimisers_differ_by": {
            name: found.disagreement for name, found in result.channels().items() if found.disagreement is not None
        },
    }
    return Profile(temperature, humidity, result.campaign.sensors, known | dict(provenance or {}))
