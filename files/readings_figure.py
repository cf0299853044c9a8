"""The figure of a log's readings, against time or altitude, and what that of a corrected flight shares with it.

matplotlib is imported to draw.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from shockrig.files.errors import InputError
from shockrig.files.figures import ORANGE, notebook_figure, styled
from shockrig.files.legs import ways
from shockrig.files.numbers import SINCE_1970_S, moment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Against = Literal["time", "altitude"]
IN_MINUTES_S = 900.0  # a flight that lasts longer is drawn over minutes
LEAST_CLIMB_M = 10.0  # of an altitude that says more than its own noise
ENOUGH_ROWS = 4000  # that a figure can show; more only make it heavy


def time_axis(time_s: Array) -> tuple[Array, str]:
    """Time as a flight's figures have it, and the axis's label: since the log's first row, in s or min."""
    known = time_s[np.isfinite(time_s)]
    first_s = float(known[0]) if known.size else 0.0
    lasts_s = float(np.ptp(known)) if known.size else 0.0
    scale, unit = (60.0, "min") if lasts_s > IN_MINUTES_S else (1.0, "s")
    if first_s > SINCE_1970_S:
        return (time_s - first_s) / scale, f"time since {moment(first_s)}, {unit}"
    return time_s / scale, f"time, {unit}"


def has_altitude(altitude_m: Array | None) -> bool:
    """Whether a log has an altitude that changes."""
    if altitude_m is None or not np.isfinite(altitude_m).any():
        return False
    return float(np.nanmax(altitude_m) - np.nanmin(altitude_m)) > LEAST_CLIMB_M


@styled
def plot_readings(
    time_s: Array, temperature_c: Array, humidity_percent: Array, altitude_m: Array | None, against: Against = "time"
) -> Figure:
    """A log's readings as they came, a panel for each channel that has any.

    Raises
    ------
    InputError
        `against` is neither "time" nor "altitude", the log has no altitude, or nothing to draw.
    """
    if against not in ("time", "altitude"):
        raise InputError(f"against={against!r}: expected 'time' or 'altitude'")
    both = (("temperature, °C", temperature_c), ("relative humidity, %", humidity_percent))
    shown = [(label, values) for label, values in both if np.isfinite(values).any()]
    if not shown:
        raise InputError("the flight has no readings to draw; give a log with temperature or humidity")
    few = thinned(time_s.size)
    if against == "time":
        along, words = time_axis(time_s)
        figure = notebook_figure(9.2, 1.0 + 2.2 * len(shown))
        rows = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (label, values) in zip(rows, shown, strict=True):
            axes.plot(along[few], values[few], color=ORANGE, lw=0.9)
            axes.set_ylabel(label)
        rows[-1].set_xlabel(words)
        return figure
    if altitude_m is None or not has_altitude(altitude_m):
        raise InputError("against='altitude': the log has no altitude that changes; leave it out for time")
    figure = notebook_figure(4.6 * max(len(shown), 1.4), 5.2)
    for axes, (label, values) in zip(figure.subplots(1, len(shown), sharey=True, squeeze=False)[0], shown, strict=True):
        for way, style, words in zip(ways(altitude_m), ("-", "--"), ("ascent", "descent"), strict=True):
            if way.sum() > 1:  # each way is a line of its own
                axes.plot(np.where(way, values, np.nan), altitude_m, color=ORANGE, lw=0.9, ls=style, label=words)
        axes.set_xlabel(label)
    figure.axes[0].set_ylabel("altitude, m")
    figure.axes[0].legend(loc="best")
    return figure


def thinned(rows: int) -> slice:
    """Rows that a figure needs."""
    return slice(None, None, max(1, rows // ENOUGH_ROWS))
