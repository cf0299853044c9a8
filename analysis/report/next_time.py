"""What a few runs show by themselves, before any model, in words and drawn; and what to record next time.

What runs show is said first where little is known of how a campaign was made: these times hold whatever body the sensor
is. What a campaign leaves open is told as plain sentences with numbers in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.driven_air import follow
from shockrig.analysis.estimate.seen import FEW_RUNS, SHARES_OF_STEP, RunSeen, little_known, seen
from shockrig.analysis.estimate.without_model import since_seen
from shockrig.analysis.report.panels import panels
from shockrig.files.figures import BLUE, CYCLE, GREY, INK, styled
from shockrig.files.numbers import plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

ENOUGH_READINGS = 8.0  # in the time to 63 %
REST_T63, RECORD_T63 = 3.0, 8.0  # times to 63 % to wait before a transfer, and to record after it
TRIGGER_SHARE = 0.03  # of the time to 63 %: how well a start should be known
AIRS_OFF = 2.0  # times what is promised of stated airs


def next_time(channels: Sequence[Channel]) -> list[str]:
    """Sentences on what the next campaign should record, the most telling first; none where little is open."""
    told = [channel for channel in channels if little_known(channel)]
    return [sentence for sentence in (say(told) for say in _SENTENCES) if sentence] if told else []


def _more_runs(channels: Sequence[Channel]) -> str:
    fewest = min(channel.runs for channel in channels)
    if fewest >= FEW_RUNS:
        return ""
    return (
        f"Record at least {FEW_RUNS} transfers, three of them alike (now {fewest}): only a run that was not fitted "
        "shows whether an explanation holds, and only repeats show by how much runs differ."
    )


def _both_ways(channels: Sequence[Channel]) -> str:
    one_way = [
        channel
        for channel in channels
        if not channel.measured.all() and abs(np.sign(channel.quantity.step(channel.conditions)).sum()) == channel.runs
    ]
    return "Carry the probes both ways: what depends on the direction is then told from what does not." * bool(one_way)


def _airs(channels: Sequence[Channel]) -> str:
    if not all(channel.conditions.airs_known.all() for channel in channels):
        return (
            "Log the air beside the probes with a faster sensor (air.csv, or reference = in the map), or write down "
            "both airs once they stand still: the sensor's own plateau hides its calibration and an air that moves."
        )
    off = [
        float(channel.conditions.source_c_scatter.max())
        for channel in channels
        if channel.quantity.pooled and not channel.measured.any()
    ]
    if off and max(off) > AIRS_OFF * channels[0].quantity.air_scatter:
        return (
            f"Read the reference when the probes have settled: the airs written down scatter by {_about(max(off))} K."
        )
    return ""


def _starts(channels: Sequence[Channel]) -> str:
    if all(channel.conditions.start_known.all() for channel in channels):
        return ""
    times = [t for channel in channels if (t := _t63_s(channel)) is not None]
    within = f", to {_about(TRIGGER_SHARE * min(times))} s or better" if times else ""
    return f"Mark when each transfer begins (a switch, a key, a column of the log){within}."


def _airflow(channels: Sequence[Channel]) -> str:
    if all(channel.conditions.airflow_known.all() for channel in channels):
        return ""
    return "Measure the airflow, and record some transfers at half and at twice of it."


def _sampling(channels: Sequence[Channel]) -> str:
    for channel in channels:
        t63_s = _t63_s(channel)
        # What passes between two readings is not known any better than to the time between them.
        if t63_s is not None and t63_s < (ENOUGH_READINGS - 1.0) * channel.sampling_period_s:
            t63_s = max(t63_s, channel.sampling_period_s)
            wanted, now = _about(t63_s / ENOUGH_READINGS), _about(channel.sampling_period_s)
            within = f"63 % of the way takes {_about(t63_s)} s or less"
            return f"Log every {wanted} s or faster, not every {now} s: {within}."
    return ""


def _length(channels: Sequence[Channel]) -> str:
    short = []
    for channel in channels:
        t63_s = _t63_s(channel)
        if t63_s is not None and any(
            t[0] > -REST_T63 * t63_s or t[-1] < RECORD_T63 * t63_s for t, _ in channel.samples
        ):
            short.append(t63_s)
    if not short:
        return ""
    rest, whole = _about(REST_T63 * max(short)), _about(RECORD_T63 * max(short))
    return (
        f"Begin each record {rest} s before the transfer, with the sensor at rest in an air that stands still, and go "
        f"on for {whole} s after it."
    )


def _settled(channels: Sequence[Channel]) -> str:
    for channel in channels:
        pairs = zip(channel.samples, channel.air, strict=True)
        runs = [(*one, air.time_s, channel.trace_of(air)) for one, air in pairs if air is not None]
        if runs and any(run.excess for run in follow(runs, channel.quantity.resolution)):
            return "Let the sensor settle before the record begins: it was still on its way from another air."
    return ""


_SENTENCES = (_more_runs, _airs, _starts, _airflow, _both_ways, _sampling, _length, _settled)


def _t63_s(channel: Channel) -> float | None:
    """Shortest time to 63 % that a channel's runs show, or lag behind a measured air [s]; None without a step."""
    runs = seen(channel)
    times = [one.times_s[0] for one in runs if one.times_s] + [one.behind_s for one in runs if one.behind_s]
    return min(times, default=None)


def _about(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


FEW_POINTS = 40  # of a curve, to be drawn as dots that can be seen singly
SHOWN_S, SHOWN_PERIODS = 3.0, 8.0  # times to 90 %, and periods of the logger, that are drawn


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


def _of(runs: Sequence[RunSeen], channel: Channel) -> str:
    return f" (run {runs[0].run})" if len(runs) == 1 < channel.runs else ""


def _range(values: Sequence[float]) -> str:
    low, high = plain(min(values), 3), plain(max(values), 3)
    return low if low == high else f"{low} to {high}"


@styled
def seen_figure(channel: Channel, steps: Sequence[RunSeen]) -> Figure:
    """Each run's readings over the way that they went, with the times to 63 % and 90 %, for runs that have them."""
    runs = {one.run: one for one in steps if one.times_s is not None}
    told_apart = len(runs) <= len(CYCLE)  # more runs than colours are drawn in one
    figure, axes = panels((1, 1), (6.4, 3.0), top_in=0.06)
    panel = axes[0, 0]
    last = SHOWN_S * max(one.times_s[1] for one in runs.values() if one.times_s is not None)
    last = max(last, SHOWN_PERIODS * channel.sampling_period_s)
    drawn: list[Line2D] = []
    for run, (time, value) in zip(channel.run_ids, channel.samples, strict=True):
        if (one := runs.get(run)) is None or one.times_s is None:
            continue
        time = since_seen(time)
        shown = (time > -0.3 * last) & (time < last)
        share = 100.0 * (value - one.begin) / (one.end - one.begin)
        size = 2.5 if shown.sum() > FEW_POINTS else 6.0
        colour = CYCLE[len(drawn) % len(CYCLE)] if told_apart else BLUE
        drawn += panel.plot(time[shown], share[shown], ".", markersize=size, color=colour, label=f"run {run}")
        if not one.at_most:
            panel.plot(one.times_s, [100.0 * s for s in SHARES_OF_STEP], "o", color=INK, markerfacecolor="none")
    for level in SHARES_OF_STEP:
        panel.axhline(100.0 * level, color=GREY, linewidth=0.7, linestyle=":")
    panel.set_xlabel("time since the change is seen to begin, s")
    panel.set_ylabel("share of the way, %")
    if told_apart:
        panel.legend(loc="lower right")
    return figure
