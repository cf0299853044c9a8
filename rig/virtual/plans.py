"""Plans of shock campaigns for the virtual bench: the shipped protocols, a wide one, and poorer ones that cannot decide
everything.

The wide one, as other laboratories record it: isothermal humidity shocks up, down and small, and thermal shocks down
and up at nearly constant vapour pressure, at five ambients; three airflows, a small thermal shock and a repeat at 20
degC; destinations up to 60 degC.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.protocol import Protocol, Record, Transfer, load_protocol
from shockrig.rig.seams import Air, known
from shockrig.rig.virtual.physics.moist import saturation_pressure_hpa

AMBIENTS_C = (0.0, 10.0, 20.0, 30.0, 40.0)
AIRFLOW_M_S = 6.0
GOLDEN_RATIO = (5.0**0.5 - 1.0) / 2.0


@dataclass(frozen=True)
class Shock:
    """One shock. `lead_s` None: drawn from 10 to 11 s. `transfer_duration_s` None: as fast as the stage goes; given:
    slowed on purpose, and measured. `extra` is written into run.json as it is (`irradiance_w_m2` is felt by the
    bead)."""

    id: str
    source: Air
    destination: Air
    airflow_m_s: float = AIRFLOW_M_S
    pressure_hpa: float = 1013.25
    duration_s: float = 80.0
    lead_s: float | None = None
    transfer_duration_s: float | None = None
    extra: Mapping[str, float] = field(default_factory=dict)


def _thermal(source: Air, destination_c: float) -> tuple[Air, Air]:
    """A thermal shock towards a vapour pressure higher by 17 %: nearly constant, and no chamber is asked for very dry
    air.
    """
    source_c, percent = known(source.temperature_c), known(source.humidity_percent)
    ratio = float(saturation_pressure_hpa(source_c) / saturation_pressure_hpa(destination_c))
    return source, Air(destination_c, round(1.17 * percent * ratio))


def _reverse(shock: tuple[Air, Air]) -> tuple[Air, Air]:
    return shock[1], shock[0]


def _number(shocks: Iterable[tuple[Air, Air, float]]) -> list[Shock]:
    return [Shock(f"{i:04d}", s, d, v) for i, (s, d, v) in enumerate(shocks, 1)]


def plan_from_protocol(protocol: Protocol) -> list[Shock]:
    """What a bench records by a protocol: its runs, each from its first record step to its last.

    The transfers come up to a second after the plateau's end, at ever other phases of the sampling.
    """
    plan = []
    for i, run in enumerate(protocol.runs):
        if None in (run.source.temperature_c, run.source.humidity_percent) or None in (
            run.destination.temperature_c,
            run.destination.humidity_percent,
        ):
            raise BenchError(f"{protocol.name}, run {run.id}: both airs need temperature_c and humidity_percent")
        moved = [isinstance(step, Transfer) for step in run.steps].index(True)
        before_s, after_s = (
            sum(step.for_s for step in part if isinstance(step, Record))
            for part in (run.steps[:moved], run.steps[moved:])
        )
        lead_s = round(before_s + (i * GOLDEN_RATIO) % 1.0, 4)
        airflow_m_s = AIRFLOW_M_S if run.airflow_m_s is None else run.airflow_m_s
        plan.append(
            Shock(
                run.id,
                run.source,
                run.destination,
                airflow_m_s,
                duration_s=lead_s + after_s,
                lead_s=lead_s,
                transfer_duration_s=run.transfer_s,
            )
        )
    return plan


def standard_plan() -> list[Shock]:
    """The campaign of the shipped standard protocol: 36 runs of 80 to 160 s, 0 to 40 degC."""
    return plan_from_protocol(load_protocol("standard"))


def extended_plan() -> list[Shock]:
    """The standard campaign and the protocol that goes on with it: slow and fast air at 0 and 40 degC as well."""
    return [*standard_plan(), *plan_from_protocol(load_protocol("extended"))]


def wide_plan() -> list[Shock]:
    """A campaign of 33 runs of 80 s, with destinations from 0 to 60 degC."""
    shocks = []
    for t in AMBIENTS_C:
        shocks += [
            (Air(t, 20.0), Air(t, 80.0), AIRFLOW_M_S),
            (Air(t, 80.0), Air(t, 20.0), AIRFLOW_M_S),
            (Air(t, 40.0), Air(t, 55.0), AIRFLOW_M_S),
            (*_reverse(_thermal(Air(t, 60.0), t + 20.0)), AIRFLOW_M_S),
            (*_thermal(Air(t, 50.0), t + 20.0), AIRFLOW_M_S),
        ]
    for airflow in (2.5, 12.0):
        shocks += [
            (Air(20.0, 25.0), Air(20.0, 75.0), airflow),
            (*_reverse(_thermal(Air(20.0, 55.0), 40.0)), airflow),
            (*_thermal(Air(20.0, 50.0), 40.0), airflow),
        ]
    shocks += [
        (Air(27.0, 40.0), Air(20.0, 50.0), AIRFLOW_M_S),
        (*_reverse(_thermal(Air(20.0, 55.0), 40.0)), AIRFLOW_M_S),
    ]
    return _number(shocks)


def single_direction_plan() -> list[Shock]:
    """The shocks of the wide campaign that go up in humidity or down in temperature: directions cannot be
    compared.
    """

    def kept(run: Shock) -> bool:
        cooling_k = known(run.source.temperature_c) - known(run.destination.temperature_c)
        wetting = known(run.destination.humidity_percent) - known(run.source.humidity_percent)
        return cooling_k > 0.0 or (cooling_k == 0.0 and wetting > 0.0)

    return _number((r.source, r.destination, r.airflow_m_s) for r in wide_plan() if kept(r))


def single_airflow_plan() -> list[Shock]:
    """The wide campaign at one airflow: what depends on the airflow cannot be told from what does not."""
    return _number((r.source, r.destination, AIRFLOW_M_S) for r in wide_plan())


def plan_from_runs(runs: Iterable[Mapping[str, Any]], first: int = 1) -> list[Shock]:
    """A plan from runs in the terms of run.json (such as a diagnosis's `next_experiments`); ids are numbered from
    `first`.
    """
    plan = []
    for i, run in enumerate(runs, first):
        try:
            source, destination = (
                Air(float(run[k]["temperature_c"]), float(run[k]["humidity_percent"]))
                for k in ("source", "destination")
            )
        except (KeyError, TypeError, ValueError) as error:
            raise BenchError(
                f"run {i}: source and destination need temperature_c and humidity_percent ({error!r})"
            ) from error
        duration = (run.get("transfer") or {}).get("duration_s")
        extra = {k: run[k] for k in ("irradiance_w_m2",) if k in run}
        plan.append(
            Shock(
                f"{i:04d}",
                source,
                destination,
                float(run.get("airflow_m_s") or AIRFLOW_M_S),
                float(run.get("pressure_hpa") or 1013.25),
                transfer_duration_s=None if duration is None else float(duration),
                extra=extra,
            )
        )
    return plan
