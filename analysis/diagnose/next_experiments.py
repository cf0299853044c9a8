"""The runs that a diagnosis asks for: those that best tell apart what its campaign cannot, as a plan chooses them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from shockrig.analysis.design.choose import LEAST_GAIN, choose_runs
from shockrig.analysis.design.evidence import OpenDispute
from shockrig.analysis.design.menu import SLOWEST_M_S, USUAL_C, PlannedShock, Usual, deciding_menu, opening
from shockrig.analysis.design.minutes import learn
from shockrig.analysis.design.prospects import Prospects, deciding_ambients
from shockrig.analysis.design.recorded_so_far import usual
from shockrig.analysis.design.targets import FEWEST_RUNS
from shockrig.analysis.diagnose.diagnosed import ChannelDiagnosis
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.problem import Problem

MOST_ASKED = 2  # kinds of runs


def next_experiments(found: ChannelDiagnosis) -> list[dict[str, Any]]:
    """Runs that would tell a channel's tied explanations apart; empty where nothing is tied."""
    tied = [one.fit for one in (found.search.best, *found.search.rivals())]
    described = found.verdict == "described" and found.final.structure.effects
    return [*propose(found.problem, found.noise, tied), *(unseen(found.problem.channel) if described else [])]


def propose(problem: Problem, noise: Noise, tied: Sequence[Fit]) -> list[dict[str, Any]]:
    """Runs, in the terms of run.json, that tell models apart which explain a problem equally well; empty for one."""
    if len(tied) < 2:
        return []
    dispute = OpenDispute.begun(problem, noise, tied)
    lasts_s = float(np.median([time[-1] for time, _ in problem.channel.samples]))  # what a slow sensor was given
    menu = deciding_menu(deciding_ambients([dispute]), _usual(problem.channel), lambda *_: lasts_s)
    chosen, _ = choose_runs(Prospects.of(menu, [dispute]), learn(None), (), MOST_ASKED)
    asked = {
        one.shock: _asked_for(one.shock) | {"expected_evidence": round(one.evidence, 1)}
        for one in chosen
        if one.worth >= LEAST_GAIN
    }
    return [run for run in asked.values() for _ in range(FEWEST_RUNS)]


def unseen(channel: Channel) -> list[dict[str, Any]]:
    """A run at an airflow next to those that were recorded, if they are known: a description says nothing of it."""
    c = channel.conditions
    if not c.airflow_known.all():
        return []
    flows = (float(c.airflow_m_s.min()), float(c.airflow_m_s.max()))
    beyond = 0.5 * flows[0] if flows[0] > 2.0 * SLOWEST_M_S else max(1.5 * flows[1], SLOWEST_M_S)
    words = "at an airflow that was not seen: what was described is known at the recorded ones alone"
    shock = next(one for one in opening(USUAL_C, _usual(channel)) if one.shows == channel.name)
    return [_asked_for(replace(shock, airflow_m_s=round(beyond, 2), why=words))]


def _usual(channel: Channel) -> Usual:
    """What the campaign's runs usually have."""
    c = channel.conditions
    airs = (Usual.coldest_c, Usual.warmest_c, *c.source_c, *c.destination_c)
    return usual(airs, c.airflow_m_s, c.pressure_hpa, c.irradiance_w_m2)


def _asked_for(shock: PlannedShock) -> dict[str, Any]:
    """A run in the terms of run.json, with the reason for it."""
    run = shock.as_run()
    return run | {"reason": run.pop("why")}
