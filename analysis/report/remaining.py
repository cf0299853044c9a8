"""The picture of what is left without any form: its course over the step by condition, and its relaxation times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from shockrig.analysis.discovery.remaining import MeanCourse, Remaining
from shockrig.analysis.report.diagnosis_words import listed
from shockrig.analysis.report.panels import log_time, panels
from shockrig.analysis.report.style import BLUE, CYCLE, GREY, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BAND_SIGMAS = 2.0
SIZE_IN = (8.4, 3.3)


def parted_by(left: Remaining, seen_elsewhere: Sequence[str]) -> str:
    """What parts the course, in words. Conditions that tests of every reading see it vary with are not denied: they
    see more than the course of a few runs does."""
    varies = f"It varies with {listed(left.varies_with)}." if left.varies_with else "No condition parts this course."
    unseen = [name for name in left.does_not_vary_with if not any(name in one for one in seen_elsewhere)]
    return f"{varies} It is not seen to vary with {listed(unseen, 'or')}." if unseen else varies


@styled
def remaining_figure(left: Remaining) -> Figure:
    """Left: the course as percent of the step, with a band of two standard uncertainties. Right: the spectrum."""
    figure, ((course, spectrum),) = panels((1, 2), SIZE_IN, across_in=0.86)
    course.axhline(0.0, color=GREY, linewidth=0.8)
    if left.by_condition:
        for colour, one in zip(CYCLE, left.by_condition, strict=False):
            _draw(course, one, colour)
    else:
        _draw(course, left.whole, BLUE)
    course.set_ylabel("left, % of the step")
    course.set_xlabel("time since the transfer / s")
    course.set_title(f"what is left, by {left.factor}" if left.factor else "what is left, all runs")
    course.legend(loc="best")
    taus, size = left.time_constants_s, 100.0 * left.amplitude
    spectrum.axhline(0.0, color=GREY, linewidth=0.8)
    band = BAND_SIGMAS * 100.0 * left.uncertainty
    spectrum.fill_between(taus, size - band, size + band, color=BLUE, alpha=0.25, linewidth=0)
    spectrum.plot(taus, size, color=BLUE)
    spectrum.set_ylabel("amplitude, % of the step")
    spectrum.set_xlabel("relaxation time / s")
    spectrum.set_title("its relaxation times, all runs")
    times = [one.time_s for one in (left.by_condition or (left.whole,))]
    log_time([course], times)
    log_time([spectrum], [taus])
    return figure


def _draw(axes: Axes, one: MeanCourse, colour: str) -> None:
    mean, band = 100.0 * one.mean, BAND_SIGMAS * 100.0 * one.uncertainty
    axes.fill_between(one.time_s, mean - band, mean + band, color=colour, alpha=0.2, linewidth=0)
    axes.plot(one.time_s, mean, color=colour, label=f"{one.condition} ({one.runs})")
