"""The figure of a log's readings, against time or altitude, and what that of a corrected flight shares with it.

matplotlib is imported to draw.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from shockrig.files.errors import InputError
from shockrig.files.figures import ORANGE, notebook_figure, styled
from shockrig.files.legs import ways
from shockrig.files.numbers import SINCE_1970_S, moment

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Against = Literal["time", "altitude"]
IN_MINUTES_S = 900.0  # a flight that lasts longer is drawn over minutes
LEAST_CLIMB_M = 10.0  # of an altitude that says more than its own noise
ENOUGH_ROWS = 4000  # that a figure can show; more only make it heavy
# Rows farther apart than ten times what nine in ten are have nothing drawn between them: nobody measured there. A gap
# that no figure shows parts nothing.
USUAL_SHARE, GAP_PERIODS = 0.9, 10.0


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
    few = rows_shown(time_s)
    if against == "time":
        along, words = time_axis(time_s)
        figure = notebook_figure(9.2, 1.0 + 2.2 * len(shown))
        rows = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (label, values) in zip(rows, shown, strict=True):
            draw_line(axes, at(along, few), at(values, few), color=ORANGE)
            axes.set_ylabel(label)
        rows[-1].set_xlabel(words)
        return figure
    if altitude_m is None or not has_altitude(altitude_m):
        raise InputError("against='altitude': the log has no altitude that changes; leave it out for time")
    figure = notebook_figure(4.6 * max(len(shown), 1.4), 5.2)
    for axes, (label, values) in zip(figure.subplots(1, len(shown), sharey=True, squeeze=False)[0], shown, strict=True):
        for way, style, words in zip(ways(altitude_m), ("-", "--"), ("ascent", "descent"), strict=True):
            if way.sum() > 1:  # each way is a line of its own
                one_way = at(np.where(way, values, np.nan), few)
                draw_line(axes, one_way, at(altitude_m, few), color=ORANGE, ls=style, label=words)
        axes.set_xlabel(label)
    figure.axes[0].set_ylabel("altitude, m")
    figure.axes[0].legend(loc="best")
    return figure


def rows_shown(time_s: Array) -> Rows:
    """Rows (m,) of a log (n,) that a figure needs, and -1 where a gap, or a clock that was set, parts two of them."""
    steps = np.abs(np.diff(time_s))
    few = np.arange(0, time_s.size, max(1, time_s.size // ENOUGH_ROWS))
    moved = steps[steps > 0.0]
    if not moved.size:
        return few
    seen_s = float(np.nanmax(time_s) - np.nanmin(time_s)) / ENOUGH_ROWS
    behind = np.flatnonzero(steps > max(GAP_PERIODS * float(np.quantile(moved, USUAL_SHARE)), seen_s)) + 1
    few = np.union1d(few, np.append(behind - 1, behind))
    return np.insert(few, np.searchsorted(few, behind), -1)


def at(values: Array, rows: Rows) -> Array:
    """Values (n,) at the rows (m,) that are shown; NaN in a gap."""
    return np.where(rows >= 0, values[rows], np.nan)


def lone(*values: Array) -> NDArray[np.bool_]:
    """Which points (m,) of a line have none beside them, so that a line would not show them."""
    known = np.pad(np.isfinite(values).all(axis=0), 1)
    return np.asarray(known[1:-1] & ~known[:-2] & ~known[2:])


def draw_line(axes: Axes, x: Array, y: Array, color: str, **look: Any) -> None:
    """A thin line with nothing drawn across a gap, and a point where one value stands alone."""
    axes.plot(x, y, color=color, lw=0.9, **look)
    if (alone := lone(x, y)).any():
        axes.plot(x[alone], y[alone], ls="", marker=".", ms=2.0, color=color)
