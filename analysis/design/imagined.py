"""Runs that have not been made, as a problem: what they would say is told by the sensitivities of a fit there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.design.shock import LEAD_S, PHASE_S, PlannedShock
from shockrig.analysis.estimate.channel import AMBIENT_WIDTH_K, Channel, bin_means, edges_after_transfer, place
from shockrig.analysis.estimate.gather import TRIGGER_SCATTER_S
from shockrig.analysis.estimate.model import common_beside
from shockrig.analysis.estimate.noise import Noise, whiteners
from shockrig.analysis.estimate.problem import Problem, make_problem
from shockrig.analysis.estimate.quantity import HUMIDITY, TEMPERATURE
from shockrig.analysis.physics.air_exchange import Conditions

Array = NDArray[np.float64]

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


def rates_known(channel: Channel, shocks: Sequence[PlannedShock]) -> NDArray[np.bool_]:
    """Whether runs (M,) go to where the rates of a channel's fit hold."""
    away = np.abs(np.array([shock.destination_c for shock in shocks])[:, None] - channel.ambients_c)
    return np.asarray((away <= AMBIENT_WIDTH_K).any(axis=1) | channel.quantity.pooled)
