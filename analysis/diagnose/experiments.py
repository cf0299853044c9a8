"""The experiment that decides: which further runs would best tell two explanations apart that these data cannot.

Expected chi-square between them, in the metric of the fit: the difference of their predictions for a new run, less what
the rival's own parameters (as far as the campaign has not fixed them) and the new run's deviations could still hide.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.fit import Fit, apart
from shockrig.analysis.estimate.gather import TRIGGER_SCATTER_S
from shockrig.analysis.estimate.model import Point, common_beside
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.physics.air_exchange import Conditions

Array = NDArray[np.float64]
Planned = dict[str, Any]  # a run to be made, in the terms of run.json
AirOf = tuple[float, float]  # degC and %RH

RUN_REPEATS = 2  # of each proposed run
DECIDED_DEVIANCE = 12.0  # expected drop in deviance from which on a choice is safe
MOST_KINDS = 2
SLOWEST_M_S = 0.7  # that a fan keeps steady
USUAL_C = 20.0  # about which runs are proposed
DIE_S = 10.0  # time constant with which a HYT-271's die follows the air, about


def propose(problem: Problem, ties: list[tuple[Fit, Fit]]) -> list[Planned]:
    """Runs, in the terms of run.json, that best separate each pair of explanations; empty without pairs.

    Parameters
    ----------
    problem : Problem
    ties : list of (Fit, Fit)
        The model chosen and a rival that explains the data equally well.
    """
    if not ties:
        return []
    menu = _menu(problem.channel)
    expected = np.array([[_separation(problem, chosen, rival, run) for run in menu] for chosen, rival in ties])
    chosen_runs: list[int] = []
    reached = np.zeros(len(ties))
    while len(chosen_runs) < MOST_KINDS and (reached < DECIDED_DEVIANCE).any():
        # The run that helps the pair most in need of help.
        gain = np.minimum(reached[:, None] + expected, 3 * DECIDED_DEVIANCE).min(axis=0) + 1e-3 * expected.mean(axis=0)
        best = int(np.argmax(gain))
        if best in chosen_runs or expected[:, best].max() < 0.5:
            break
        chosen_runs.append(best)
        reached = reached + expected[:, best]
    runs = []
    for index in chosen_runs:
        run = dict(menu[index])
        reason = run.pop("reason")
        for _ in range(RUN_REPEATS):
            runs.append(run | {"reason": reason, "expected_evidence": round(float(expected[:, index].min()), 1)})
    return runs


def unseen(problem: Problem) -> list[Planned]:
    """A run at an airflow next to those that were recorded, if they are known: a description says nothing of it."""
    c = problem.channel.conditions
    if not c.airflow_known.all():
        return []
    flows = (float(c.airflow_m_s.min()), float(c.airflow_m_s.max()))
    shock = ((USUAL_C + 20.0, 18.0), (USUAL_C, 55.0))
    if problem.channel.jumps_with_air:
        shock = ((USUAL_C, 20.0), (USUAL_C, 80.0))
    words = "at an airflow that was not seen: what was described is known at the recorded ones alone"
    beyond = 0.5 * flows[0] if flows[0] > 2.0 * SLOWEST_M_S else 1.5 * flows[1]
    return [_planned(problem.channel, words, *shock, beyond)]


def _menu(channel: Channel) -> list[Planned]:
    """Runs that a bench can do: both directions, more and less airflow, larger and smaller steps, a slowed transfer."""
    c = channel.conditions
    ambients = np.array([USUAL_C]) if channel.quantity.pooled else channel.ambients_c
    middle = float(ambients[np.argmin(np.abs(ambients - USUAL_C))])
    flow = float(np.median(c.airflow_m_s))

    def run(
        reason: str, source: AirOf, destination: AirOf, airflow: float = flow, duration: float | None = None
    ) -> Planned:
        return _planned(channel, reason, source, destination, airflow, duration)

    warm = (round(middle + 20.0, 1), 18.0)
    here = (round(middle, 1), 55.0)
    shocks = {
        "a thermal shock downwards": (warm, here),
        "a thermal shock upwards": (here, warm),
        "a large thermal shock": ((round(middle + 40.0, 1), 8.0), here),
        "a humidity shock upwards": ((here[0], 20.0), (here[0], 80.0)),
        "a humidity shock downwards": ((here[0], 80.0), (here[0], 20.0)),
        "a small humidity step at high humidity": ((here[0], 65.0), (here[0], 80.0)),
        "a small humidity step at low humidity": ((here[0], 35.0), (here[0], 20.0)),
    }
    menu = []
    for reason, (source, destination) in shocks.items():
        menu.append(run(reason, source, destination))
        menu.append(run(f"{reason}, little airflow", source, destination, max(1.5, 0.3 * flow)))
        menu.append(run(f"{reason}, much airflow", source, destination, 2.5 * flow))
        menu.append(run(f"{reason}, the transfer slowed", source, destination, flow, 2.0))
    return menu


def _planned(
    channel: Channel, reason: str, source: AirOf, destination: AirOf, airflow: float, duration: float | None = None
) -> Planned:
    """A run in the terms of run.json."""
    names = ("temperature_c", "humidity_percent")
    return {
        "source": dict(zip(names, source, strict=True)),
        "destination": dict(zip(names, destination, strict=True)),
        "airflow_m_s": round(airflow, 2),
        "pressure_hpa": round(float(np.median(channel.conditions.pressure_hpa)), 2),
        "transfer": {} if duration is None else {"duration_s": duration},
        "reason": reason,
    }


def _separation(problem: Problem, chosen: Fit, rival: Fit, run: Planned) -> float:
    """Expected drop in deviance for `RUN_REPEATS` such runs, were `chosen` true and `rival` fitted anew."""
    new = hypothetical(problem, run)
    truth = chosen.model.on(new.channel).predict(Point(chosen.theta, new.channel.at_rest()))[0]
    known = np.linalg.pinv(rival.covariance, hermitian=True) / RUN_REPEATS  # by each of them
    (found,), _ = apart(new, truth, rival.structure, rival.theta, known)
    return RUN_REPEATS * float(found)


def hypothetical(problem: Problem, run: Planned) -> Problem:
    """A problem of one run that has not been made: its conditions, with the bins and noise of a typical run."""
    channel = problem.channel
    template = int(np.argmax((channel.count > 0).sum(axis=1)))
    one = problem.select(np.array([template]))
    source, destination = run["source"], run["destination"]
    fields = {name: getattr(one.channel.conditions, name).copy() for name in Conditions.__dataclass_fields__}
    fields["source_c"][:] = source["temperature_c"]
    fields["destination_c"][:] = destination["temperature_c"]
    fields["source_percent"][:] = source["humidity_percent"]
    fields["destination_percent"][:] = destination["humidity_percent"]
    fields["airflow_m_s"][:] = run["airflow_m_s"]
    fields["start_scatter_s"][:] = TRIGGER_SCATTER_S
    fields["ramp_own_s"][:] = run["transfer"].get("duration_s", np.nan)
    fields["ramp_ratio"][:] = 1.0
    fields["elsewhere"][:] = False
    fields["humidity_known"][:] = True
    conditions = Conditions(**fields)
    nearest = int(np.argmin(np.abs(channel.ambients_c - destination["temperature_c"])))
    weights = np.zeros((1, channel.rates))
    weights[0, 0 if channel.quantity.pooled else nearest] = 1.0
    time = one.channel.time_s
    colder_k = source["temperature_c"] - destination["temperature_c"]
    die = destination["temperature_c"] + colder_k * np.exp(-np.maximum(time, 0.0) / DIE_S)
    new = replace(
        one.channel,
        conditions=conditions,
        common=common_beside(channel),
        air=(None,),
        interpolation=weights,
        die_c=die if np.isfinite(channel.die_c).any() else one.channel.die_c,
        ambient=np.array([0 if channel.quantity.pooled else nearest]),
    )
    return replace(one, channel=new)
