"""Damaged input for what reads results: profiles, diagnoses, campaigns, flights, sealed truths."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from fuzz_damage import damage, demand, finite


def profiles(rng: random.Random, folder: Path) -> Callable[[], bool]:
    from shockrig.analysis.flight.simulated.typical import typical_profile
    from shockrig.files.profile import profile_document, read_profile

    document = profile_document(typical_profile())
    document["temperature"]["effects"] = [
        {"effect": "stem_conduction", "probability": 0.99, "parameters": {"fraction": {"value": 0.03}}}
    ]
    text = json.dumps(document, indent=1).encode()
    file = folder / "profile.json"

    def one() -> bool:
        file.write_bytes(damage(rng, text))
        profile = read_profile(file)
        demand(profile.temperature is not None or profile.humidity is not None, "neither part")
        _all_finite(profile.temperature)
        if profile.temperature is not None:
            alpha = profile.temperature.thermal_diffusivity_m2_s
            demand(
                alpha.value > 0 and alpha.standard_uncertainty >= 0 and profile.temperature.bead_radius_m > 0, "alpha"
            )
        if profile.humidity is not None:
            rows = profile.humidity.diffusivity_table
            demand(bool(rows) and profile.humidity.film_thickness_m > 0, "table")
            ambients = [row.ambient_temperature_c for row in rows]
            demand(ambients == sorted(set(ambients)) and finite(*ambients), f"ambients {ambients}")
            demand(all(finite(row.diffusivity_m2_s) and row.diffusivity_m2_s > 0 for row in rows), "D")
            demand(all(row.standard_uncertainty >= 0 for row in rows), "uncertainty")
        return True

    return one


def diagnoses(rng: random.Random, folder: Path) -> Callable[[], bool]:
    from shockrig.files.diagnosis import read_diagnosis

    estimate = {"value": 1.4, "standard_uncertainty": 0.1}
    cause = {"effect": "stem_conduction", "probability": 0.99, "parameters": {"time_constant_s": estimate}}
    unlisted = {
        "behaves_as": "lag_in_series", "driver": "air_humidity", "time_constant_s": estimate,
        "size": {**estimate, "unit": "1"}, "depends_on": [{"factor": "airflow", "form": "power", **estimate}],
        "nearest_catalogued": {"effect": "stem_conduction", "likeness": 0.9}, "probability": 0.97,
        "seen_over": {"airflow_m_s": [2.5, 12.0]},
    }  # fmt: skip
    gain = {"held_out_rmse_before": 0.21, "held_out_rmse_after": 0.02, "interval_95": [0.98, 1.0]}
    left = {"rms": 0.1, "peak": 0.2, "unit": "K", "significant": True, "material": False, "tolerance": 0.03}
    channels = {
        "temperature": {"verdict": "explained", "causes": [cause], "gain": gain, "remainder": left},
        "humidity": {"verdict": "described", "causes": [], "discovered": [unlisted | {"alternatives": [unlisted]}]},
    }
    text = json.dumps({"format": "shock-diagnosis/1", "campaign": "x", "channels": channels}, indent=1).encode()
    file = folder / "diagnosis.json"

    def one() -> bool:
        file.write_bytes(damage(rng, text))
        found = read_diagnosis(file)
        demand(bool(found.channels) and set(found.channels) <= {"temperature", "humidity"}, "channels")
        for channel in found.channels.values():
            demand(channel.verdict in (None, "adequate", "explained", "described", "unexplained"), "verdict")
            _all_finite((channel.causes, channel.discovered, channel.gain, channel.remainder))
            for effect in (*channel.causes, *channel.discovered):
                demand(effect.probability is None or 0 <= effect.probability <= 1, "probability")
            for stated in (value for effect in channel.causes for value in effect.parameters.values()):
                demand(stated.standard_uncertainty >= 0, "uncertainty")
            if channel.gain is not None and channel.gain.interval_95 is not None:
                demand(channel.gain.interval_95[0] <= channel.gain.interval_95[1], "interval")
        return True

    return one


def _all_finite(part: Any) -> None:
    if is_dataclass(part):
        for entry in fields(part):
            _all_finite(getattr(part, entry.name))
    elif isinstance(part, tuple | list):
        for entry in part:
            _all_finite(entry)
    elif isinstance(part, Mapping):
        for entry in part.values():
            _all_finite(entry)
    elif isinstance(part, float):
        demand(math.isfinite(part), f"{part}")


def campaigns(rng: random.Random, folder: Path) -> Callable[[], bool]:
    import numpy as np

    from shockrig.files.campaign import read_campaign

    path = folder / "campaign"
    (path / "runs" / "0001").mkdir(parents=True, exist_ok=True)
    run = {
        "format": "shock-run/1", "id": "0001", "started_at": "2026-05-01T00:00:00Z",
        "source": {"temperature_c": 40.0, "humidity_percent": 20.0},
        "destination": {"temperature_c": 20.0, "humidity_percent": 55.0},
        "airflow_m_s": 6.0, "pressure_hpa": 1013.25, "transfer": {"start_s": 1.53, "duration_s": 0.4},
        "reference": {"temperature_time_constant_s": 0.05, "humidity_standard_uncertainty_percent": 0.3},
    }  # fmt: skip
    sensors = {
        "imet": {"kind": "imet-xf", "bead_radius_m": 4e-4, "body": "cylinder_mean"},
        "hyt": {"kind": "hyt-271", "film_thickness_m": 1e-5},
    }
    sound = {
        "campaign.json": json.dumps({"format": "shock-campaign/1", "name": "x", "sensors": sensors}).encode(),
        "runs/0001/run.json": json.dumps(run, indent=1).encode(),
        "runs/0001/imet.csv": b"time_s,temperature_c\n"
        + b"".join(b"%.4f,%.2f\n" % (i / 10, 40 - i) for i in range(20)),
        "runs/0001/hyt.csv": b"time_s,humidity_percent,temperature_c,stale\n"
        + b"".join(b"%.4f,%.4f,20.1,%d\n" % (i / 10, 20 + i, i % 7 == 0) for i in range(20)),
        "runs/0001/air.csv": b"time_s,temperature_c,airflow_m_s\n"
        + b"".join(b"%.4f,%.4f,%s\n" % (i / 10, 40 - i, b"6.0" if i % 3 else b"") for i in range(20)),
    }

    def one() -> bool:
        hit = rng.choice(list(sound))
        for name, content in sound.items():
            (path / name).write_bytes(damage(rng, content) if name == hit else content)
        campaign = read_campaign(path)
        demand(finite(campaign.bead_radius_m, campaign.film_thickness_m), "lengths")
        demand(campaign.bead_radius_m > 0 and campaign.film_thickness_m > 0, "lengths")
        bodies = {"sphere", "film", "sphere_mean", "cylinder", "cylinder_mean", "plate", "lumped"}
        demand(set(campaign.bodies) == {"imet", "hyt"} and set(campaign.bodies.values()) <= bodies, "bodies")
        for one_run in campaign.runs:
            for air in (one_run.source, one_run.destination):
                demand(
                    air.temperature_c is None or (finite(air.temperature_c) and air.temperature_c > -273.15), f"{air}"
                )
                demand(air.humidity_percent is None or -1 <= air.humidity_percent <= 120, f"{air}")
            for value in (one_run.airflow_m_s, one_run.start_s, one_run.duration_s, one_run.pressure_hpa):
                demand(value is None or finite(value), f"{value}")
            demand(one_run.pressure_hpa > 0, "pressure")
            for trace in (one_run.imet, one_run.hyt):
                if trace is not None:
                    demand(bool(np.all(np.isfinite(trace.time_s)) and np.all(np.diff(trace.time_s) > 0)), "times")
                    main = "humidity_percent" if trace is one_run.hyt else "temperature_c"
                    demand(bool(np.all(np.isfinite(trace.values[main]))), "values")
                    demand(all(v.shape == trace.time_s.shape for v in trace.values.values()), "shapes")
            reference = vars(one_run.reference).values()
            demand(finite(*reference) and min(reference) >= 0, f"{one_run.reference}")
            if one_run.air is not None:
                air = np.array(list(one_run.air.values.values()))
                demand(one_run.air.time_s.size >= 2 and bool(np.all(np.diff(one_run.air.time_s) > 0)), "air's times")
                demand(air.size > 0 and not np.any(np.isinf(air)), "air's values")
                demand(bool(np.all(np.isfinite(air).any(axis=0)) and np.all(np.isfinite(air).any(axis=1))), "empty air")
        return True

    return one


def flights(rng: random.Random, folder: Path) -> Callable[[], bool]:
    import numpy as np

    from shockrig.files.flight import read_layout
    from shockrig.files.flight_cells import read_blocks
    from shockrig.files.flight_rows import to_flight
    from shockrig.protocols.flight_world import read_flown_air

    xq2 = b"XQ,095188,2407,0294,2553,2015/10/18,00:38:44,+0000000000,+0000000000,-00017000,00\r\n"
    rows = b"".join(b"%.1f,%.2f,%.3f,6.0,1013.2,%d\n" % (i / 10, 20 - i / 9, 40 + i, i) for i in range(15))
    sound = (
        b"time_s,temperature_c,humidity_percent,airspeed_m_s,pressure_hpa,altitude_m\n" + rows,
        b"Timestamp,Temp,RH,ARSP,P,note\n" + rows,
        xq2 * 5,
    )
    file = folder / "flight.csv"

    def one() -> bool:
        file.write_bytes(damage(rng, rng.choice(sound), sound))
        if rng.random() < 0.5:
            air = read_flown_air(file)
            values = (air.time_s, air.temperature_c, air.humidity_percent, air.airspeed_m_s, air.pressure_hpa)
            demand(all(np.all(np.isfinite(v)) for v in values), "air that is no number")
            demand(bool(np.all((air.humidity_percent >= 0) & (air.humidity_percent <= 100))), "humidity")
            demand(air.time_s.size >= 2, "rows")
            return True
        layout = read_layout(file)
        for block in read_blocks(file, layout, 7):
            demand(all(len(row) == len(layout.header) for row in block.table()), "a row of another width")
            flight = to_flight(block, layout)
            for values in (flight.time_s, flight.temperature_c, flight.humidity_percent, flight.airspeed_m_s):
                demand(values.shape == (len(block),) and not np.any(np.isinf(values)), "values")
        return True

    return one


def truths(rng: random.Random, folder: Path) -> Callable[[], bool]:
    import numpy as np

    from shockrig.rig.virtual.truth import Truth, draw_truth

    text = draw_truth(np.random.default_rng(1)).to_json().encode()

    def one() -> bool:
        truth = Truth.from_json(damage(rng, text).decode("utf-8", "replace"))
        demand(finite(truth.bead_radius_m, truth.film_thickness_m), "lengths")
        return True

    return one
