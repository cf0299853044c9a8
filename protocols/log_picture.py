"""A picture of a log with the steps that are seen in it: all of it above, and each step close up below."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.figures import BLUE, CYCLE, GREY, LIGHT, literal, styled
from shockrig.files.numbers import counted, short
from shockrig.files.unit_names import UNITS
from shockrig.rig.logs.found import LogStep
from shockrig.rig.logs.sensor_logs import SensorLog
from shockrig.rig.logs.stamps import to_map, unit_shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

LABELS = {"temperature": "temperature, °C", "humidity": "humidity, %RH"}
CLOSE_UPS, IN_A_ROW = 12, 4
LINE_POINTS = 4000  # that a line of the whole log is drawn with


@styled
def draw_log(sensors: SensorLog, steps: Sequence[LogStep], used: Sequence[bool]) -> Figure:
    """The log over its own clock, steps numbered; each close up as the share of its way that every channel has gone.

    Parameters
    ----------
    sensors : SensorLog
    steps : sequence of LogStep
    used : sequence of bool
        Whether each step makes a run; those that do not are drawn grey and dashed.
    """
    from matplotlib.figure import Figure

    keys = [key for key in LABELS if any(key in readings.values for readings in sensors.readings.values())]
    shown = list(zip(steps, used, strict=True))[:CLOSE_UPS]
    rows = -(-len(shown) // IN_A_ROW)
    figure = Figure(figsize=(11.0, 2.4 * len(keys) + 2.3 * rows + 0.3))
    grid = figure.add_gridspec(len(keys) + rows, IN_A_ROW, height_ratios=[1.15] * len(keys) + [1.0] * rows)
    first: Axes | None = None
    for row, key in enumerate(keys):
        axes = figure.add_subplot(grid[row, :], sharex=first)
        first = first or axes
        _draw_whole(axes, sensors, key)
        for one, is_used in zip(steps, used, strict=True):
            _mark(axes, sensors, one, is_used, numbered=row == 0)
        axes.set_ylabel(LABELS[key])
        axes.legend(loc="best", ncols=4)
    if first is not None:
        many = f"; close up the first {CLOSE_UPS} of them" if len(steps) > CLOSE_UPS else ""
        count = f"{counted(len(steps), 'step')} seen{many}"
        first.set_title(literal(f"{sensors.log.path.name}: {count}"), pad=14)
    for k, (one, is_used) in enumerate(shown):
        axes = figure.add_subplot(grid[len(keys) + k // IN_A_ROW, k % IN_A_ROW])
        _draw_close(axes, sensors, one, is_used)
        if k % IN_A_ROW == 0:
            axes.set_ylabel("share of the step" + (", humidity dotted" if len(keys) > 1 else ""))
    return figure


def _colour(sensors: SensorLog, name: str) -> Any:
    """A sensor's own: of more sensors than there are colours told apart by all eyes, along a scale."""
    place, count = list(sensors.readings).index(name), len(sensors.readings)
    if count <= len(CYCLE):
        return CYCLE[place]
    from matplotlib import colormaps

    return colormaps["turbo"]((place + 0.5) / count)


def _clock(sensors: SensorLog, seconds: Array) -> Any:
    """Times as the log itself counts, for an axis."""
    log = sensors.log
    if log.clock.is_dated or log.clock.is_of_day:
        return np.asarray((log.origin_s + seconds) * 1e6, dtype="datetime64[us]")
    return seconds / UNITS["time"][log.clock.unit][0]


def _draw_whole(axes: Axes, sensors: SensorLog, key: str) -> None:
    log = sensors.log
    for name, readings in sensors.readings.items():
        if key not in readings.values:
            continue
        for k, rows in enumerate(log.pieces):
            inside = (readings.rows >= rows.start) & (readings.rows < rows.stop) & np.isfinite(readings.values[key])
            time_s, value = _envelope(log.time_s[readings.rows[inside]], readings.values[key][inside])
            label = literal(name) if k == 0 else None
            axes.plot(_clock(sensors, time_s), value, color=_colour(sensors, name), lw=1.0, label=label)
    if log.clock.is_dated or log.clock.is_of_day:
        from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

        locator = AutoDateLocator()  # type: ignore[no-untyped-call]
        form = ConciseDateFormatter(locator, show_offset=log.clock.is_dated)  # type: ignore[no-untyped-call]
        if log.clock.is_of_day:  # of no day: midnight is 00:00
            form.zero_formats[1:] = 5 * ["%H:%M"]
        axes.xaxis.set_major_locator(locator)
        axes.xaxis.set_major_formatter(form)
        axes.set_xlabel("time as the log has it")
    else:
        axes.set_xlabel(f"time of the log, {log.clock.unit}")


def _envelope(time_s: Array, value: Array) -> tuple[Array, Array]:
    """Least and greatest of every stretch: a spike of one reading is still there."""
    group = int(np.ceil(time_s.size / (LINE_POINTS / 2)))
    if group <= 2:
        return time_s, value
    whole = time_s.size // group * group
    blocks = value[:whole].reshape(-1, group)
    both = np.sort(np.stack([blocks.argmin(axis=1), blocks.argmax(axis=1)], axis=1), axis=1)
    places = (both + np.arange(blocks.shape[0])[:, None] * group).ravel()
    places = np.concatenate([places, np.arange(whole, time_s.size)])
    return time_s[places], value[places]


def _mark(axes: Axes, sensors: SensorLog, one: LogStep, is_used: bool, numbered: bool) -> None:
    step = one.step
    colour, style = (BLUE, "-") if is_used else (GREY, "--")
    low, at, high = _clock(
        sensors, np.array([step.at_s - 2 * step.uncertainty_s, step.at_s, step.at_s + 2 * step.uncertainty_s])
    )
    axes.axvspan(low, high, color=colour, alpha=0.15, lw=0)
    axes.axvline(at, color=colour, ls=style, lw=0.8)
    if numbered:
        axes.annotate(
            str(one.number), (at, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2), textcoords="offset points",
            ha="center", va="bottom", color=colour, fontsize=8, annotation_clip=False,
        )  # fmt: skip


def _draw_close(axes: Axes, sensors: SensorLog, one: LogStep, is_used: bool) -> None:
    """One step: every channel that moved, from 0 before to 1 after, over the seconds from when it was seen."""
    step, log = one.step, sensors.log
    rows = log.pieces[step.piece]
    quickest = min((move.t63_s for move in step.moves), default=0.0)
    slowest = max((move.t63_s for move in step.moves), default=0.0)
    after_s = max(3.0 * quickest, min(2.0 * slowest, 6.0 * quickest), 6.0 * step.uncertainty_s, 12.0 * log.period_s)
    before_s = max(0.35 * after_s, 4.0 * step.uncertainty_s, 6.0 * log.period_s)
    for move in step.moves:
        name, key = move.channel.rsplit(".", 1)
        readings = sensors.readings[name]
        moments = log.time_s[readings.rows] - step.at_s
        inside = (readings.rows >= rows.start) & (readings.rows < rows.stop)
        inside &= (moments >= -before_s) & (moments <= after_s) & np.isfinite(readings.values[key])
        share = (readings.values[key][inside] - move.before) / move.size if move.size else np.zeros(int(inside.sum()))
        few = inside.sum() <= 60
        axes.plot(
            moments[inside], share, color=_colour(sensors, name), ls="-" if key == "temperature" else ":", lw=1.0,
            marker="." if few else "", ms=3.0,
        )  # fmt: skip
    colour = BLUE if is_used else GREY
    axes.axvspan(-2 * step.uncertainty_s, 2 * step.uncertainty_s, color=colour, alpha=0.15, lw=0)
    axes.axvline(0.0, color=colour, lw=0.8, ls="-" if is_used else "--")
    axes.axhline(0.0, color=LIGHT, lw=0.6)
    axes.axhline(1.0, color=LIGHT, lw=0.6)
    axes.set_xlim(-before_s, after_s)
    axes.set_ylim(-0.3, 1.4)
    digits = int(np.clip(np.ceil(-np.log10(max(step.uncertainty_s, 1e-3))), 0, 3))
    at = to_map(log.clock, log.origin_s, step.at_s, digits).strip('"').rpartition("T")[2]
    unsure = f"{at}{unit_shown(log.clock)} ± {short(step.uncertainty_s, 2)} s"
    axes.set_title(f"{one.number}: {unsure}{'' if is_used else ', not used'}", fontsize=8.5)
    axes.set_xlabel("s from there")
