"""What a few runs show by themselves, before any model: how long each reading took for most of its way.

Said first where little is known of how a campaign was made: these times hold whatever body the sensor is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.driven_air import follow
from shockrig.analysis.physics.chain import MeasuredAir
from shockrig.analysis.report.numbers import plain
from shockrig.analysis.report.panels import panels
from shockrig.analysis.report.style import CYCLE, GREY, INK, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

FEW_RUNS = 6
SHARES = (0.632, 0.90)
FEW_POINTS = 40  # of a curve, to be drawn as dots that can be seen singly
STEP_IN_NOISE = 20.0  # a smaller step has no times worth saying
MOST_BETWEEN = 0.3  # of the way between two readings: from here on a line between them is invented
SHOWN_S, SHOWN_PERIODS = 3.0, 8.0  # times to 90 %, and periods of the logger, that are drawn


@dataclass(frozen=True)
class Seen:
    """One run: readings at rest before and at the end, and seconds to 63 % and 90 % of the way from its found start.

    Where two readings hold most of the way between them, the times are those of the later, and `at_most` is true.
    `behind_s` is the first-order lag behind a measured air that leaves least; the times are then not given.
    """

    run: str
    begin: float
    end: float
    times_s: tuple[float, float] | None
    behind_s: float | None
    at_most: bool = False


def little_known(channel: Channel) -> bool:
    """Whether a campaign is one of a few runs, or of runs whose start, airs or airflow nobody recorded."""
    c = channel.conditions
    known = c.start_known.all() and c.airs_known.all() and c.airflow_known.all()
    return channel.runs <= FEW_RUNS or not bool(known)


def seen(channel: Channel) -> tuple[Seen, ...]:
    """What each run shows by itself; runs without a step worth the name are left out."""
    found = []
    for run, (time, value), air in zip(channel.run_ids, channel.samples, channel.air, strict=True):
        tail = max(value.size // 20, 3)
        before = value[time < 0] if (time < 0).sum() >= 3 else value[:3]
        begin, end = float(np.median(before)), float(np.median(value[-tail:]))
        noise = 1.4826 * float(np.median(np.abs(np.diff(value)))) / np.sqrt(2.0)
        if abs(end - begin) < max(STEP_IN_NOISE * noise, channel.quantity.least_step):
            continue
        if air is None:
            times_s, at_most = _crossings(time, (value - begin) / (end - begin))
            found.append(Seen(run, begin, end, times_s, None, at_most))
        else:
            lag = follow(time, value, air.time_s, trace_of(channel, air), channel.quantity.resolution).time_constant_s
            found.append(Seen(run, begin, end, None, lag))
    return tuple(found)


def trace_of(channel: Channel, air: MeasuredAir) -> Array:
    """What a measured air was in the channel's own quantity (m,)."""
    return air.temperature_c if channel.quantity.pooled else air.humidity_percent


def _crossings(time: Array, share: Array) -> tuple[tuple[float, float], bool]:
    """Times at which a share of the way is passed for good [s]: straight between the two readings around it, or that
    of the later where the first of them lies too far back.
    """
    times, later, apart = [], [], []
    for wanted in SHARES:
        after = int(np.argmax(share >= max(wanted, 0.5)))
        below = np.flatnonzero(share[: after + 1] < wanted)
        i = int(below[-1]) if below.size else after - 1
        part = (wanted - share[i]) / (share[i + 1] - share[i])
        times.append(float(time[i] + part * (time[i + 1] - time[i])))
        later.append(float(time[i + 1]))
        apart.append(float(share[i + 1] - share[i]))
    at_most = max(apart) > MOST_BETWEEN
    return ((later[0], later[1]) if at_most else (times[0], times[1])), at_most


def seen_sentence(channel: Channel) -> str:
    """These times in words; empty where there are none, or where enough is known to say more by a model."""
    runs = seen(channel) if little_known(channel) else ()
    stepped = [one for one in runs if one.times_s is not None]
    driven = [one for one in runs if one.behind_s is not None]
    said = []
    if stepped:
        t63, t90 = (_range([one.times_s[i] for one in stepped if one.times_s is not None]) for i in (0, 1))
        after = "within" if any(one.at_most for one in stepped) else "after"
        said.append(f"63 % of the way {after} {t63} s, 90 % {after} {t90} s{_of(stepped, channel)}")
    if driven:
        lag = _range([one.behind_s for one in driven if one.behind_s is not None])
        said.append(f"follows the measured air like a lag of {lag} s{_of(driven, channel)}")
    return f"Seen in the readings, by no model: {'; '.join(said)}." if said else ""


def _of(runs: Sequence[Seen], channel: Channel) -> str:
    return f" (run {runs[0].run})" if len(runs) == 1 < channel.runs else ""


def _range(values: Sequence[float]) -> str:
    low, high = plain(min(values), 3), plain(max(values), 3)
    return low if low == high else f"{low} to {high}"


@styled
def seen_figure(channel: Channel, steps: Sequence[Seen]) -> Figure:
    """Each run's readings over the way that they went, with the times to 63 % and 90 %, for runs that have them."""
    runs = {one.run: one for one in steps if one.times_s is not None}
    figure, axes = panels((1, 1), (6.4, 3.0), top_in=0.06)
    panel = axes[0, 0]
    last = SHOWN_S * max(one.times_s[1] for one in runs.values() if one.times_s is not None)
    last = max(last, SHOWN_PERIODS * channel.sampling_period_s)
    for i, (run, (time, value)) in enumerate(zip(channel.run_ids, channel.samples, strict=True)):
        if (one := runs.get(run)) is None or one.times_s is None:
            continue
        shown = (time > -0.3 * last) & (time < last)
        share = 100.0 * (value - one.begin) / (one.end - one.begin)
        size = 2.5 if shown.sum() > FEW_POINTS else 6.0
        panel.plot(time[shown], share[shown], ".", markersize=size, color=CYCLE[i % len(CYCLE)], label=f"run {run}")
        if not one.at_most:
            panel.plot(one.times_s, [100.0 * s for s in SHARES], "o", color=INK, markerfacecolor="none")
    for level in SHARES:
        panel.axhline(100.0 * level, color=GREY, linewidth=0.7, linestyle=":")
    panel.set_xlabel("time since the change is seen to begin, s")
    panel.set_ylabel("share of the way, %")
    panel.legend(loc="lower right")
    return figure
