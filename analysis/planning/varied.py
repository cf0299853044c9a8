"""What a campaign's runs have varied and what not, and recorded runs as ones that could be made again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.quantity import ChannelName
from shockrig.analysis.planning.judged import Look
from shockrig.analysis.planning.minutes import airs_of_run
from shockrig.analysis.planning.shock import SHORTEST_S, Shock
from shockrig.files.campaign import Run

Array = NDArray[np.float64]
VARIETY = 0.5  # worth of a run in another direction or airflow, where ties are to be decided
ENOUGH = 1.8  # runs of one kind, a smaller step than the largest counting as much less
OTHER_FLOW = 1.5  # times as much airflow is another one


def variety(looks: Mapping[ChannelName, Look], shocks: Sequence[Shock]) -> Array:
    """Worth of the runs that vary what fewer than two of a channel's runs have: direction, airflow.

    One run says nothing: runs differ. A step that is smaller than the largest so far says as much less.
    """
    bonus = np.zeros(len(shocks))
    for look in looks.values():
        if look.problem is None:
            continue
        channel = look.problem.channel
        step = channel.quantity.step(channel.conditions)
        largest = max(float(np.abs(step).max()), channel.quantity.least_step)
        share, flow = np.abs(step) / largest, channel.conditions.airflow_m_s
        for i, shock in enumerate(shocks):
            own = _step_of(channel, shock)
            if abs(own) > channel.quantity.least_step:
                other_way = share[np.sign(step) == np.sign(own)].sum() < ENOUGH
                other_flow = _other_flow(flow, share, shock.airflow_m_s)
                bonus[i] += VARIETY * min(abs(own) / largest, 1.0) * (int(other_way) + int(other_flow))
    return bonus


def _other_flow(flows: Array, share: Array, flow: float) -> bool:
    """Whether an airflow is one that less than two runs of the largest step have had something like."""
    low, high = float(flows.min()), float(flows.max())
    if high < OTHER_FLOW * low:
        return max(high, flow) > OTHER_FLOW * min(low, flow)
    slow = flows < np.sqrt(low * high)
    few = [float(share[slow].sum()) < ENOUGH, float(share[~slow].sum()) < ENOUGH]
    return few[0] and flow <= OTHER_FLOW * low or few[1] and flow >= high / OTHER_FLOW


def _step_of(channel: Channel, shock: Shock) -> float:
    if channel.quantity.pooled:
        return shock.destination_c - shock.source_c
    return shock.destination_percent - shock.source_percent if shock.isothermal else 0.0


def shock_of(run: Run) -> Shock | None:
    """A recorded run as one that could be made again, its set points rounded; None where its airs are not known."""
    airs = airs_of_run(run)
    if airs is None:
        return None
    last_s = max((float(t.time_s[-1]) for t in (run.imet, run.hyt) if t is not None and t.time_s.size), default=0.0)
    return Shock(
        float(round(airs[0])),
        float(round(airs[1])),
        float(round(airs[2])),
        float(round(airs[3])),
        Shock.airflow_m_s if run.airflow_m_s is None else round(run.airflow_m_s, 2),
        float(round(max(last_s - (run.start_s or 0.0), SHORTEST_S))),
        None,
        round(run.pressure_hpa, 2),
        float(run.extra.get("irradiance_w_m2") or 0.0),
    )


def farthest(menu: Sequence[Shock], runs: Sequence[Run]) -> Shock:
    """The run of a menu that is least like any that was recorded."""
    there = np.array([_place(s) for run in runs if (s := shock_of(run)) is not None])
    places = np.array([_place(shock) for shock in menu])
    apart = ((places[:, None, :] - there[None, :, :]) ** 2).sum(axis=-1).min(axis=1)
    return menu[int(np.argmax(apart))]


def _place(shock: Shock) -> tuple[float, ...]:
    """Conditions scaled so that differences that matter alike are alike."""
    kelvin = (shock.source_c / 15.0, shock.destination_c / 15.0)
    percent = (shock.source_percent / 25.0, shock.destination_percent / 25.0)
    return (*kelvin, *percent, np.log(shock.airflow_m_s) / 0.7, 2.0 * (shock.transfer_s is not None))
