"""What a few runs show by themselves, before any model, in words and drawn.

Said first where little is known of how a campaign was made: these times hold whatever body the sensor is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.seen import SHARES_OF_STEP, RunSeen, little_known, seen
from shockrig.analysis.report.panels import panels
from shockrig.analysis.report.style import BLUE, CYCLE, GREY, INK, styled
from shockrig.files.numbers import plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

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
