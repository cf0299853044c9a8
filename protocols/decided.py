"""Decisions as protocols that a bench runs, and as lines that a person reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.protocol import PlannedRun, Protocol, Record, Soak, Transfer, run_id
from shockrig.rig.seams import Air

if TYPE_CHECKING:
    from shockrig.analysis.design.menu import PlannedShock, Surroundings
    from shockrig.analysis.plan.decision import Decision
    from shockrig.rig.bench import Bench

TRANSFER_AT_MOST_S = 60.0  # a person may carry the probes; a stage has deadlines of its own
SOAK_AT_MOST_S = 3600.0
SOAK_SHARE = 6.0  # a record lasts some nine response times: a soak is looked at over one and a half of them
SOAK_OVER_S = (12.0, 40.0)


def soak_over_s(dwell_s: float) -> float:
    """Over how long a soak must be steady for a run that is recorded so long after its transfer [s]."""
    least, most = SOAK_OVER_S
    return min(max(round(dwell_s / SOAK_SHARE), least), most)


def as_protocol(
    shocks: Sequence[PlannedShock], continues: int, name: str, goals: str, pressures_hpa: Sequence[float] = ()
) -> Protocol:
    """A protocol of some shocks, to follow `continues` runs of a campaign.

    A pressure is set where it is one of `pressures_hpa`; any other is the laboratory's.
    """
    runs = []
    for number, shock in enumerate(shocks, continues + 1):
        soak = Soak(over_s=soak_over_s(shock.dwell_s), at_most_s=SOAK_AT_MOST_S)
        carry = Transfer(TRANSFER_AT_MOST_S + (shock.transfer_s or 0.0))
        runs.append(
            PlannedRun(
                run_id(number),
                Air(shock.source_c, shock.source_percent),
                Air(shock.destination_c, shock.destination_percent),
                shock.airflow_m_s,
                (soak, Record(shock.lead_s), carry, Record(shock.dwell_s)),
                shock.why,
                shock.transfer_s,
                shock.pressure_hpa if shock.pressure_hpa in pressures_hpa else None,
                shock.irradiance_w_m2 or None,
            )
        )
    return Protocol(name, f"chosen for: {goals}", tuple(runs), continues=continues)


def feasible_on(bench: Bench) -> Callable[[PlannedShock], bool]:
    """Whether a bench can make a shock: its airs, transfer, pressure and light."""

    from shockrig.analysis.design.recorded_so_far import OTHER_PRESSURE

    def feasible(shock: PlannedShock) -> bool:
        airs = Air(shock.source_c, shock.source_percent), Air(shock.destination_c, shock.destination_percent)
        try:
            if bench.chambers is not None:
                bench.chambers.demand(*airs, shock.airflow_m_s)
            if shock.transfer_s is not None:
                bench.stage.demand_transfer(shock.transfer_s)
            bench.demand_surroundings(None, shock.irradiance_w_m2)
        except BenchError:
            return False
        usual = abs(shock.pressure_hpa / bench.pressure_hpa - 1.0) <= OTHER_PRESSURE
        return usual or shock.pressure_hpa in bench.pressures_hpa

    return feasible


def surroundings_of(bench: Bench) -> Surroundings:
    """The pressures and lights that a bench can make besides the laboratory's."""
    from shockrig.analysis.design.menu import Surroundings

    return Surroundings(bench.pressures_hpa, bench.irradiances_w_m2)


def in_words(shock: PlannedShock) -> str:
    """A run in words: its airs, airflow, how long it is recorded, and in how long it is carried where that is set."""
    from shockrig.protocols.run_progress import words

    source = words(Air(shock.source_c, shock.source_percent))
    destination = words(Air(shock.destination_c, shock.destination_percent))
    more = f", the transfer in {shock.transfer_s:g} s" if shock.transfer_s is not None else ""
    return f"{source} -> {destination}, {shock.airflow_m_s:g} m/s, {shock.dwell_s:g} s{more}"


def lines(decision: Decision, document: Mapping[str, Any]) -> list[str]:
    """What a person reads of a decision: goals, ties, what is next and why."""
    from shockrig.files.plan_file import where_it_stands

    said = []
    for goal in document["goals"]:
        met, now = where_it_stands(goal)
        said.append(f"  {met:7}  {goal['goal']:28} {now}")
    said += [f"  tied, {place}: {' or '.join(tied)}" for place, tied in decision.tied.items()]
    said.append(f"{decision.status}: {decision.reason}")
    for choice in decision.choices:
        shock = choice.shock
        brings = [f"{choice.goals:.2f} of a goal"] if choice.goals > 0.005 else []
        brings += [f"ln E {choice.evidence:.1f} between what is tied"] if choice.evidence > 0.05 else []
        brings += [f"ln E {choice.beside:.1f} more with a second probe beside it"] if choice.beside > 0.05 else []
        said.append(
            f"  {in_words(shock)}: {shock.why}; about {choice.minutes:.1f} min"
            + (f", brings {' and '.join(brings)}" if brings else "")
        )
    return said


def minutes_left(decision: Decision) -> float | None:
    """Bench minutes until the goals of precision are met at the rate of the next run; None where that is not known.

    Of a single run nobody can say by how much runs differ, nor whether the model is enough: its uncertainty tells of
    that, and not of how much is still to be recorded.
    """
    from shockrig.analysis.design.targets import FEWEST_RUNS

    if any(t.runs < FEWEST_RUNS for t in decision.targets if not t.met):
        return None
    lacking = sum(1.0 - t.progress for t in decision.targets)
    best = max((c.goals / c.minutes for c in decision.choices), default=0.0)
    return lacking / best if best > 0.0 and lacking > 0.0 else None
