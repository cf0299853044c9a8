"""A plan against what it is planned for: bench and disk before anything moves, airs once they were measured."""

from __future__ import annotations

import math

from shockrig.rig.bench import Bench
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.protocol import PlannedRun, Protocol
from shockrig.rig.recorder import RunRecord
from shockrig.rig.recorder.run_quality import mean_of
from shockrig.rig.seams import Air

BYTES_PER_S = 4000.0  # what a journal grows by at 10 Hz and two sensors, rounded up
OFF_PLAN_K, OFF_PLAN_PERCENT = 2.0, 5.0  # an air is what it is measured to be, but whoever set it wants to know


def check_plan(protocol: Protocol, bench: Bench, free_bytes: int | None = None) -> list[str]:
    """What speaks against a plan, before anything moves.

    Returns
    -------
    list of str
        Warnings: a person may know better.

    Raises
    ------
    BenchError
        The plan cannot be run on this bench.
    """
    if not bench.sensors:
        raise BenchError(f"bench {bench.name}: has no sensor to record; add [sensors.imet] or [sensors.hyt]")
    if free_bytes is not None:
        demand_room(protocol, free_bytes)
    warnings = []
    for run in protocol.runs:
        if bench.chambers is not None:
            try:
                bench.chambers.demand(run.source, run.destination, run.airflow_m_s)
            except BenchError as error:
                raise BenchError(f"run {run.id}: {error}") from None
        try:
            if run.transfer_s is not None:
                bench.stage.demand_transfer(run.transfer_s)
            bench.demand_surroundings(run.pressure_hpa, run.irradiance_w_m2)
        except BenchError as error:
            raise BenchError(f"run {run.id}: {error}") from None
        dew_point_c = _dew_point_c(run.destination)
        if dew_point_c is not None and run.source.temperature_c is not None and dew_point_c > run.source.temperature_c:
            warnings.append(
                f"run {run.id}: water will condense on the probes: they come from {run.source.temperature_c:g} degC "
                f"into air with a dew point of {dew_point_c:.1f} degC"
            )
    return warnings


def demand_room(protocol: Protocol, free_bytes: int) -> None:
    """Raise BenchError where a disk has no room for a campaign."""
    need_bytes = 2.0 * sum(run.shortest_s() for run in protocol.runs) * BYTES_PER_S
    if free_bytes < need_bytes:
        raise BenchError(f"the disk has {free_bytes / 1e6:.0f} MB free, the campaign needs {need_bytes / 1e6:.0f} MB")


def off_plan(run: PlannedRun, record: RunRecord) -> list[str]:
    """One sentence for each air of a run that was measured and is not what the protocol asked for."""
    said = []
    for place in ("source", "destination"):
        for name, unit, far in (("temperature_c", "degC", OFF_PLAN_K), ("humidity_percent", "%RH", OFF_PLAN_PERCENT)):
            planned, found = getattr(getattr(run, place), name), mean_of(record.airs[place], name)
            if planned is not None and found is not None and abs(found - planned) > far:
                said.append(f"run {run.id}: the {place} air has {found:.1f} {unit}; {planned:g} {unit} was planned")
    return said


def _dew_point_c(air: Air) -> float | None:
    """Dew point in degC (Magnus form, Sonntag 1990), good to 0.1 K, which is enough for a warning."""
    if air.temperature_c is None or not air.humidity_percent:
        return None
    gamma = math.log(air.humidity_percent / 100.0) + 17.62 * air.temperature_c / (243.12 + air.temperature_c)
    return 243.12 * gamma / (17.62 - gamma)
