"""What a campaign's runs usually have, what they have varied and what not, and runs that could be made once more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.design.goals import Goals
from shockrig.analysis.design.menu import ORDINARY, SHORTEST_S, USUAL_C, PlannedShock, Surroundings, Usual
from shockrig.analysis.design.minutes import airs_of_run, recorded_s
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.quantity import QUANTITIES
from shockrig.files.campaign import Campaign, Run

Array = NDArray[np.float64]
VARIETY_WORTH = 0.5  # worth of a run in another direction or airflow, where ties are to be decided
ENOUGH_RUNS = 1.8  # runs of one kind, a smaller step than the largest counting as much less
OTHER_PRESSURE = 0.03  # relative difference from which on a pressure is another one, and no weather
VARIED_RATIO = 1.5  # times as much airflow is another one, and times as large a step


def variety(channels: Sequence[Channel], shocks: Sequence[PlannedShock], planned: Sequence[PlannedShock] = ()) -> Array:
    """Worth (M, 2) of the runs that vary what fewer than two of a channel's runs have: direction, airflow.

    Of each made once, and of the second of two. One run says nothing: runs differ. A step that is smaller than the
    largest so far says as much less. Runs that are `planned` count as recorded.
    """
    bonus = np.zeros((len(shocks), 2))
    for channel in channels:
        least = channel.quantity.least_step
        steps = np.array([*channel.quantity.step(channel.conditions), *(_step_of(channel, s) for s in planned)])
        flows = np.array([*channel.conditions.airflow_m_s, *(s.airflow_m_s for s in planned)])
        largest = max(float(np.abs(steps).max()), least)
        for i, shock in enumerate(shocks):
            own = _step_of(channel, shock)
            for time in range(2) if abs(own) > least else ():
                size = np.abs([*steps, *time * [own]]) / largest
                other_way = size[np.sign([*steps, *time * [own]]) == np.sign(own)].sum() < ENOUGH_RUNS
                other_flow = _other_flow(np.array([*flows, *time * [shock.airflow_m_s]]), size, shock.airflow_m_s)
                bonus[i, time] += VARIETY_WORTH * min(abs(own) / largest, 1.0) * (int(other_way) + int(other_flow))
    bonus[:, 1] *= bonus[:, 0] > 0.0
    return bonus


def _other_flow(flows: Array, share: Array, flow: float) -> bool:
    """Whether an airflow is one that less than two runs of the largest step have had something like."""
    low, high = float(flows.min()), float(flows.max())
    if high < VARIED_RATIO * low:
        return max(high, flow) > VARIED_RATIO * min(low, flow)
    slow = flows < np.sqrt(low * high)
    few = [float(share[slow].sum()) < ENOUGH_RUNS, float(share[~slow].sum()) < ENOUGH_RUNS]
    return few[0] and flow <= VARIED_RATIO * low or few[1] and flow >= high / VARIED_RATIO


def _step_of(channel: Channel, shock: PlannedShock) -> float:
    if channel.quantity.pooled:
        return shock.destination_c - shock.source_c
    return shock.destination_percent - shock.source_percent if shock.isothermal else 0.0


def is_again(run: Run, first: Run) -> bool:
    """Whether a run is another one once more: the same airs, as far as they make no step, airflow and pressure."""
    airs, others = airs_of_run(run), airs_of_run(first)
    if airs is None or others is None:
        return False
    least = [QUANTITIES[name].least_step for name in ("temperature", "humidity")]
    apart = np.abs(np.subtract(airs, others)) < [*least, *least]
    slow, fast = sorted(one.airflow_m_s or PlannedShock.airflow_m_s for one in (run, first))
    same_pressure = abs(run.pressure_hpa / first.pressure_hpa - 1.0) <= OTHER_PRESSURE
    return bool(apart.all()) and fast < VARIED_RATIO * slow and same_pressure


def shock_of(run: Run) -> PlannedShock | None:
    """A recorded run as one that could be made again, its set points rounded; None where its airs are not known."""
    airs = airs_of_run(run)
    if airs is None:
        return None
    return PlannedShock(
        float(round(airs[0])),
        float(round(airs[1])),
        float(round(airs[2])),
        float(round(airs[3])),
        PlannedShock.airflow_m_s if run.airflow_m_s is None else round(run.airflow_m_s, 2),
        float(round(max(recorded_s(run) - (run.start_s or 0.0), SHORTEST_S))),
        None,
        round(run.pressure_hpa, 2),
        float(run.extra.get("irradiance_w_m2") or 0.0),
    )


def usual_of(campaign: Campaign | None, goals: Goals, surroundings: Surroundings) -> Usual:
    """What runs of a campaign have that nothing is said of, and what else they can have."""
    runs = () if campaign is None else campaign.runs
    return usual(
        [a.temperature_c for r in runs for a in (r.source, r.destination) if a.temperature_c is not None],
        [run.airflow_m_s for run in runs if run.airflow_m_s is not None],
        [run.pressure_hpa for run in runs],
        [x for run in runs if isinstance(x := run.extra.get("irradiance_w_m2"), int | float)],
        goals.ambients_c,
        surroundings,
    )


def usual(
    airs_c: Sequence[float] | Array,
    flows_m_s: Sequence[float] | Array,
    pressures_hpa: Sequence[float] | Array,
    lights_w_m2: Sequence[float] | Array,
    wanted_c: Sequence[float] = (),
    surroundings: Surroundings = ORDINARY,
) -> Usual:
    """The same from what runs had, and the ambients that are wanted."""
    flows = [flow for flow in flows_m_s if flow > 0.0]
    pressure = round(float(np.median(pressures_hpa)), 2) if len(pressures_hpa) else Usual.pressure_hpa
    every = [*(round(float(p), -1) for p in pressures_hpa), *surroundings.pressures_hpa]
    others = {p for p in every if abs(p / pressure - 1.0) > OTHER_PRESSURE}
    lights = {float(x) for x in (*lights_w_m2, *surroundings.irradiances_w_m2) if x > 0.0}
    airs = [*wanted_c, *airs_c]
    return Usual(
        airflow_m_s=round(float(np.median(flows)), 2) if flows else Usual.airflow_m_s,
        pressure_hpa=pressure,
        other=Surroundings(tuple(sorted(others)), tuple(sorted(lights))),
        coldest_c=round(min([*airs, USUAL_C])),
        warmest_c=round(max([*airs, 2 * USUAL_C])),
    )


def farthest(menu: Sequence[PlannedShock], runs: Sequence[Run]) -> PlannedShock:
    """The run of a menu that is least like any that was recorded; the first where the airs of none are known."""
    places = np.array([_place(shock) for shock in menu])
    there = np.reshape([_place(s) for run in runs if (s := shock_of(run)) is not None], (-1, places.shape[1]))
    apart = ((places[:, None, :] - there[None, :, :]) ** 2).sum(axis=-1).min(axis=1, initial=np.inf)
    return menu[int(np.argmax(apart))]


def _place(shock: PlannedShock) -> tuple[float, ...]:
    """Conditions scaled so that differences that matter alike are alike."""
    kelvin = (shock.source_c / 15.0, shock.destination_c / 15.0)
    percent = (shock.source_percent / 25.0, shock.destination_percent / 25.0)
    return (*kelvin, *percent, np.log(shock.airflow_m_s) / 0.7, 2.0 * (shock.transfer_s is not None))
