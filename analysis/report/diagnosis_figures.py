"""Drawings that only a diagnosis needs: an inversion crossed, corrected with the plain and the extended profile."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.report.crossing import Crossing
from shockrig.analysis.report.fitted import UNIT
from shockrig.analysis.report.numbers import plain
from shockrig.analysis.report.panels import panels
from shockrig.analysis.report.style import BLUE, GREY, INK, ORANGE, RED, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXIS = {"temperature": "temperature, °C", "humidity": "relative humidity, %"}
WINDOW_S = (-10.0, 40.0)  # about the instant at which the air changes fastest


@styled
def crossing_figure(crossings: Sequence[Crossing]) -> Figure:
    """The air, the reading and both corrections about the inversion, and the corrections' errors below."""
    size_in = 4.9 * len(crossings), 4.8
    figure, axes_of = panels((2, len(crossings)), size_in, top_in=0.06, across_in=0.78, heights=(1.5, 1), sharex=True)
    for (above, below), c in zip(axes_of.T, crossings, strict=True):
        smooth = np.convolve(c.air, np.ones(21) / 21, mode="same")
        inner = slice(30, -30)
        middle = c.time_s[inner][int(np.argmax(np.abs(np.gradient(smooth)[inner])))]
        shown = (c.time_s > middle + WINDOW_S[0]) & (c.time_s < middle + WINDOW_S[1])
        time = c.time_s[shown]
        above.plot(time, c.reading[shown], color=ORANGE, linewidth=1.0, label="reading")
        above.plot(time, c.plain[shown], color=RED, linewidth=1.1, label="corrected, plain profile")
        above.plot(time, c.extended[shown], color=BLUE, linewidth=1.3, label="corrected, extended profile")
        above.plot(time, c.air[shown], color=INK, linewidth=0.8, linestyle="--", label="air")
        below.axhline(0.0, color=GREY, linewidth=0.7)
        sides = (("plain", RED, c.rms_plain), ("extended", BLUE, c.rms_extended))
        for side, colour, rms in sides:
            error = getattr(c, side) - c.air
            label = f"{side}: {plain(rms, 2)} {UNIT[c.channel]} rms"
            below.plot(time, error[shown], color=colour, linewidth=0.9, label=label)
        above.set_ylabel(AXIS[c.channel])
        below.set_ylabel(f"error, {UNIT[c.channel]}")
        below.set_xlabel("time of the flight, s")
        below.legend(loc="upper right")
    axes_of[0, 0].legend(loc="best")
    return figure
