"""Runs that have not been made, as a channel and a problem: their conditions, sampling, bins and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.bins import bin_means, edges_after_transfer, place
from shockrig.analysis.inference.channel import AMBIENT_WIDTH_K
from shockrig.analysis.inference.gather import TRIGGER_SCATTER_S
from shockrig.analysis.inference.noise import Noise, whiteners
from shockrig.analysis.inference.problem import Problem, make_problem
from shockrig.analysis.inference.quantity import HUMIDITY, TEMPERATURE
from shockrig.analysis.physics.conditions import Conditions
from shockrig.analysis.planning.shock import LEAD_S, PHASE_S, PlannedShock

Array = NDArray[np.float64]
DIE_S = 10.0  # time constant with which a HYT-271's die follows the air, about


def imagined(problem: Problem, noise: Noise, shocks: Sequence[PlannedShock], ambients_c: Array) -> Problem:
    """A problem of one run for each shock, on the ambients `ambients_c` (G,) of the rates that are fitted.

    Readings are place-holders: what such runs would say does not depend on them.
    """
    like = problem.channel
    longest_s = max(shock.dwell_s + (shock.transfer_s or 0.0) for shock in shocks)
    edges = edges_after_transfer(-LEAD_S, longest_s, like.sampling_period_s, like.tempo)
    kinds: dict[float, int] = {}
    samples: list[tuple[Array, Array]] = []
    for shock in shocks:
        last_s = shock.dwell_s + (shock.transfer_s or 0.0)
        if last_s not in kinds:
            kinds[last_s] = len(samples)
            time = np.arange(-LEAD_S + 0.5 * like.sampling_period_s, last_s, like.sampling_period_s)
            samples.append((time, np.zeros(time.size)))
    of_kind = np.array([kinds[shock.dwell_s + (shock.transfer_s or 0.0)] for shock in shocks])
    bin_of = place(samples, edges, np.full(len(samples), TRIGGER_SCATTER_S))
    time, value, count = bin_means([t for t, _ in samples], [y for _, y in samples], bin_of)
    conditions = _conditions(like.conditions, shocks)
    ambient = np.array(
        [0 if like.quantity.pooled else int(np.argmin(np.abs(ambients_c - s.destination_c))) for s in shocks]
    )
    weights = np.zeros((len(shocks), ambients_c.size))
    weights[np.arange(len(shocks)), ambient] = 1.0
    forms = replace(
        like,
        run_ids=tuple(f"kind {i}" for i in range(len(samples))),
        time_s=time,
        value=value,
        count=count,
        samples=tuple(samples),
        bin_of=bin_of,
        die_c=np.zeros_like(time),
        die_samples=(),
        air=(None,) * len(samples),
        conditions=conditions.select(np.array([int(np.argmax(of_kind == i)) for i in range(len(samples))])),
        ambient=np.zeros(len(samples), dtype=int),
        interpolation=weights[: len(samples)],
        wet_until_s=np.full(len(samples), np.nan),
    )
    whitener = whiteners(forms, noise)[of_kind]
    since = np.maximum(time[of_kind], 0.0)
    left = np.where(time[of_kind] > 0, np.exp(-since / DIE_S), 1.0)
    die = conditions.destination_c[:, None] - conditions.thermal_step_k[:, None] * left
    channel = replace(
        forms,
        run_ids=tuple(f"imagined {i}" for i in range(len(shocks))),
        time_s=time[of_kind],
        value=value[of_kind],
        count=count[of_kind],
        samples=tuple(samples[k] for k in of_kind),
        bin_of=tuple(bin_of[k] for k in of_kind),
        die_c=die if like.quantity is HUMIDITY else np.full_like(die, np.nan),
        air=(None,) * len(shocks),
        conditions=conditions,
        ambient=ambient,
        ambients_c=ambients_c,
        interpolation=weights,
        wet_until_s=np.full(len(shocks), np.nan),
    )
    return make_problem(channel, whitener, problem.rate_scatter)


def _conditions(like: Conditions, shocks: Sequence[PlannedShock]) -> Conditions:
    def each(name: str) -> Array:
        return np.array([getattr(shock, name) for shock in shocks], dtype=float)

    many = np.ones(len(shocks))
    slowed = np.array([np.nan if shock.transfer_s is None else shock.transfer_s for shock in shocks])
    return Conditions(
        source_c=each("source_c"),
        destination_c=each("destination_c"),
        source_percent=each("source_percent"),
        destination_percent=each("destination_percent"),
        airflow_m_s=each("airflow_m_s"),
        pressure_hpa=each("pressure_hpa"),
        start_s=each("lead_s") + PHASE_S,
        start_scatter_s=TRIGGER_SCATTER_S * many,
        source_c_scatter=TEMPERATURE.air_scatter * many,
        destination_c_scatter=TEMPERATURE.air_scatter * many,
        source_percent_scatter=HUMIDITY.air_scatter * many,
        destination_percent_scatter=HUMIDITY.air_scatter * many,
        airflow_known=many.astype(bool),
        start_known=many.astype(bool),
        airs_known=many.astype(bool),
        irradiance_w_m2=each("irradiance_w_m2"),
        duration_s=slowed,
        ramp_ratio=many,
        ramp_own_s=slowed,
        elsewhere=~many.astype(bool),
        order=(float(like.order.max()) + 1.0) * many,
        hours=float(like.hours.max()) * many,
    )


def joined_ambients(known_c: Array, wanted_c: Sequence[float]) -> Array:
    """Ambients (G,) of a fit followed by those wanted that it does not have."""
    new = [t for t in wanted_c if not (np.abs(known_c - t) <= AMBIENT_WIDTH_K).any()]
    return np.concatenate([known_c, new])


def rates_at(known_c: Array, log_rates: Array, wanted_c: Array) -> Array:
    """ln rates at `wanted_c`, straight in 1/T through those known; beyond them with a film's usual slope.

    The slope, 2500 K, is that of a rate that doubles in 25 K; one that is wrong by half of it is wrong by 12 % in 10 K,
    which an expected amount of information does not feel.
    """
    order = np.argsort(known_c)
    inverse, rates = -1.0 / (known_c[order] + 273.15), log_rates[order]
    at = -1.0 / (wanted_c + 273.15)
    inside = np.interp(at, inverse, rates)
    return np.asarray(inside + 2500.0 * (at - np.clip(at, inverse[0], inverse[-1])))
