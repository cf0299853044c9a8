"""Runs that have not been made as a channel and a problem, how far apart two explanations are in them, and those that
would best tell apart what these data cannot.

separation = least over the rival's theta, as far as the campaign leaves it open, of |f_true - f_rival|^2

in the metric of the fit: the expected chi-square between them, less what the new run's own deviations could still hide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnose.shock import LEAD_S, PHASE_S, USUAL_C, PlannedShock, Usual, deciding_menu
from shockrig.analysis.estimate.channel import AMBIENT_WIDTH_K, Channel, bin_means, edges_after_transfer, place
from shockrig.analysis.estimate.fit import Fit, apart
from shockrig.analysis.estimate.gather import TRIGGER_SCATTER_S
from shockrig.analysis.estimate.model import Point, common_beside
from shockrig.analysis.estimate.noise import Noise, whiteners
from shockrig.analysis.estimate.problem import Problem, make_problem
from shockrig.analysis.estimate.quantity import HUMIDITY, TEMPERATURE
from shockrig.analysis.physics.air_exchange import Conditions

Array = NDArray[np.float64]

RUN_REPEATS = 2  # of each proposed run
DECIDED_DEVIANCE = 12.0  # expected drop in deviance from which on a choice is safe
MOST_KINDS = 2
STEADY_M_S = 0.7  # slowest airflow that a fan keeps steady
DIE_S = 10.0  # time constant with which a HYT-271's die follows the air, about


def imagined(problem: Problem, noise: Noise, shocks: Sequence[PlannedShock], ambients_c: Array) -> Problem:
    """A problem of one run for each shock, on the ambients `ambients_c` (G,) of the rates that are fitted.

    Readings are place-holders: what such runs would say does not depend on them.
    """
    like = problem.channel
    lasts_s = [shock.dwell_s + (shock.transfer_s or 0.0) for shock in shocks]
    period_s = like.sampling_period_s
    edges = edges_after_transfer(-LEAD_S, max(lasts_s), period_s, like.tempo)
    times = [np.arange(-LEAD_S + 0.5 * period_s, last_s, period_s) for last_s in lasts_s]
    samples = tuple((time, np.zeros(time.size)) for time in times)
    bin_of = place(samples, edges, np.full(len(samples), TRIGGER_SCATTER_S))
    time, value, count = bin_means(times, [y for _, y in samples], bin_of)
    conditions = _conditions(like.conditions, shocks)
    ambient = np.array(
        [0 if like.quantity.pooled else int(np.argmin(np.abs(ambients_c - s.destination_c))) for s in shocks]
    )
    weights = np.zeros((len(shocks), ambients_c.size))
    weights[np.arange(len(shocks)), ambient] = 1.0
    left = np.exp(-np.maximum(time, 0.0) / DIE_S)
    die = conditions.destination_c[:, None] - conditions.thermal_step_k[:, None] * left
    channel = replace(
        like,
        run_ids=tuple(f"imagined {i}" for i in range(len(shocks))),
        time_s=time,
        value=value,
        count=count,
        samples=samples,
        bin_of=bin_of,
        die_c=die if like.quantity is HUMIDITY else np.full_like(die, np.nan),
        die_samples=(),
        air=(None,) * len(shocks),
        conditions=conditions,
        common=common_beside(like),
        ambient=ambient,
        ambients_c=ambients_c,
        interpolation=weights,
        wet_until_s=np.full(len(shocks), np.nan),
    )
    _, first, kind = np.unique(lasts_s, return_index=True, return_inverse=True)  # runs as long have the same bins
    return make_problem(channel, whiteners(channel.select(first), noise)[kind], problem.rate_scatter)


def _conditions(like: Conditions, shocks: Sequence[PlannedShock]) -> Conditions:
    """What each run will be: all of it known, as far as a bench knows it."""
    stated = {field.name for field in fields(Conditions)} & {field.name for field in fields(PlannedShock)}
    many = np.ones(len(shocks))
    slowed = np.array([np.nan if shock.transfer_s is None else shock.transfer_s for shock in shocks])
    return Conditions(
        **{name: np.array([getattr(shock, name) for shock in shocks], dtype=float) for name in stated},
        start_s=np.array([shock.lead_s for shock in shocks]) + PHASE_S,
        start_scatter_s=TRIGGER_SCATTER_S * many,
        source_c_scatter=TEMPERATURE.air_scatter * many,
        destination_c_scatter=TEMPERATURE.air_scatter * many,
        source_percent_scatter=HUMIDITY.air_scatter * many,
        destination_percent_scatter=HUMIDITY.air_scatter * many,
        airflow_known=many.astype(bool),
        start_known=many.astype(bool),
        airs_known=many.astype(bool),
        humidity_known=many.astype(bool),
        duration_s=slowed,
        ramp_ratio=many,
        ramp_own_s=slowed,
        elsewhere=~many.astype(bool),
        order=(float(like.order.max()) + 1.0) * many,
        hours=float(like.hours.max()) * many,
    )


def separations(
    problem: Problem, noise: Noise, true: Fit, rival: Fit, shocks: Sequence[PlannedShock], times: int = 1
) -> Array:
    """Expected drop in deviance (M,) by which each run, made so many times, speaks for `true` against `rival`.

    The rival is free to move as far as the campaign leaves it open. A run that goes where no rate is known yet says
    nothing of either.
    """
    new = imagined(rival.on_its_scatters(problem), noise, shocks, problem.channel.ambients_c)
    truth = true.model.on(new.channel).predict(Point(true.theta, new.channel.at_rest()))[0]
    found, _ = apart(new, truth, rival.structure, rival.theta, rival.arrow.told / times)
    return times * found * rates_known(problem.channel, shocks)


def rates_known(channel: Channel, shocks: Sequence[PlannedShock]) -> NDArray[np.bool_]:
    """Whether runs (M,) go to where the rates of a channel's fit hold."""
    away = np.abs(np.array([shock.destination_c for shock in shocks])[:, None] - channel.ambients_c)
    return np.asarray((away <= AMBIENT_WIDTH_K).any(axis=1) | channel.quantity.pooled)


def propose(problem: Problem, noise: Noise, ties: Sequence[tuple[Fit, Fit]]) -> list[dict[str, Any]]:
    """Runs, in the terms of run.json, that best separate each pair of explanations; empty without pairs.

    Parameters
    ----------
    problem : Problem
    noise : Noise
    ties : sequence of (Fit, Fit)
        The model chosen and a rival that explains the data equally well.
    """
    if not ties:
        return []
    channel = problem.channel
    ambients = np.array([USUAL_C]) if channel.quantity.pooled else channel.ambients_c
    menu = deciding_menu([round(float(ambients[np.argmin(np.abs(ambients - USUAL_C))]), 1)], _usual(channel))
    lasts_s = float(np.median([time[-1] for time, _ in channel.samples]))  # a slow sensor needs what it was given
    menu = [replace(shock, dwell_s=max(shock.dwell_s, round(lasts_s, 1))) for shock in menu]
    expected = np.array([separations(problem, noise, chosen, rival, menu, RUN_REPEATS) for chosen, rival in ties])
    recorded_s = np.array([shock.recorded_s for shock in menu])
    chosen_runs: list[int] = []
    reached = np.zeros(len(ties))
    while len(chosen_runs) < MOST_KINDS and (reached < DECIDED_DEVIANCE).any():
        # The run that helps the pair most in need of help, by how long it is recorded.
        gain = np.minimum(reached[:, None] + expected, 3 * DECIDED_DEVIANCE).min(axis=0) + 1e-3 * expected.mean(axis=0)
        best = int(np.argmax(gain / recorded_s))
        if best in chosen_runs or expected[:, best].max() < 0.5:
            break
        chosen_runs.append(best)
        reached = reached + expected[:, best]
    return [
        _asked_for(menu[k]) | {"expected_evidence": round(float(expected[:, k].min()), 1)}
        for k in chosen_runs
        for _ in range(RUN_REPEATS)
    ]


def unseen(channel: Channel) -> list[dict[str, Any]]:
    """A run at an airflow next to those that were recorded, if they are known: a description says nothing of it."""
    c, usual = channel.conditions, _usual(channel)
    if not c.airflow_known.all():
        return []
    flows = (float(c.airflow_m_s.min()), float(c.airflow_m_s.max()))
    beyond = 0.5 * flows[0] if flows[0] > 2.0 * STEADY_M_S else max(1.5 * flows[1], STEADY_M_S)
    airs = (USUAL_C, 20.0, USUAL_C, 80.0) if channel.jumps_with_air else (USUAL_C + 20.0, 18.0, USUAL_C, 55.0)
    words = "at an airflow that was not seen: what was described is known at the recorded ones alone"
    return [_asked_for(PlannedShock(*airs, round(beyond, 2), pressure_hpa=usual.pressure_hpa, why=words))]


def _usual(channel: Channel) -> Usual:
    """What the campaign's runs usually have."""
    c = channel.conditions
    airs = np.round([*c.source_c, *c.destination_c], 1)  # as those of the menu are
    return Usual(
        airflow_m_s=round(float(np.median(c.airflow_m_s)), 2),
        pressure_hpa=round(float(np.median(c.pressure_hpa)), 2),
        coldest_c=min(Usual.coldest_c, *airs),
        warmest_c=max(Usual.warmest_c, *airs),
    )


def _asked_for(shock: PlannedShock) -> dict[str, Any]:
    """A run in the terms of run.json, with the reason for it."""
    run = shock.as_run()
    return run | {"reason": run.pop("why")}
