"""The figure of a corrected flight: reading and corrected value, and below, large enough to be seen, the 95 % band;
against time or against altitude. matplotlib is imported to draw.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from shockrig.files.errors import InputError
from shockrig.files.figures import BLUE, GREY, ORANGE, notebook_figure, styled
from shockrig.files.flight import Corrected, Flight

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Against = Literal["time", "altitude"]
COVERAGE = 1.96  # standard uncertainties of a 95 % band
SINCE_1970_S = 5e8  # a clock that says more counts from 1970
IN_MINUTES_S = 900.0  # a flight that lasts longer is drawn over minutes
LEAST_CLIMB_M = 10.0  # of an altitude that says more than its own noise
SHOWN_SHARE = 0.97  # of the rows whose band is within the panel
ENOUGH_ROWS = 4000  # that a figure can show; more only make it heavy


class Shown:
    """One channel as it is drawn: rows that have a time, thinned where there are more than can be seen."""

    def __init__(self, name: str, unit: str, label: str, reading: Array, value: Array, sigma: Array) -> None:
        self.name, self.unit, self.label = name, unit, label
        self.reading, self.value, self.sigma = reading, value, sigma


def channels_of(flight: Flight, corrected: Corrected) -> list[Shown]:
    """The channels that have any reading."""
    both = [
        Shown(
            "temperature",
            "K",
            "temperature, °C",
            flight.temperature_c,
            corrected.temperature_c,
            corrected.temperature_uncertainty_k,
        ),
        Shown(
            "humidity",
            "%RH",
            "relative humidity, %",
            flight.humidity_percent,
            corrected.humidity_percent,
            corrected.humidity_uncertainty_percent,
        ),
    ]
    return [one for one in both if np.isfinite(one.reading).any()]


@dataclass(frozen=True)
class ChannelChange:
    """By how much a channel was changed, and the median of its standard uncertainty afterwards, in `unit`."""

    name: str
    unit: str
    rms: float
    most: float
    standard_uncertainty: float


def changes_of(flight: Flight, corrected: Corrected) -> list[ChannelChange]:
    """The change of each channel that was corrected, implausible rows left out: one of them would be all that counts.

    The uncertainty is a median, since the first seconds of a flight, which know least, would make up a mean.
    """
    changes = []
    for one in channels_of(flight, corrected):
        known = np.isfinite(one.value) & np.isfinite(one.sigma) & ~corrected.flags["implausible"]
        if known.any():
            change = (one.value - one.reading)[known & np.isfinite(one.reading)]
            size = (float(np.sqrt(np.mean(change**2))), float(np.max(np.abs(change)))) if change.size else (0.0, 0.0)
            changes.append(ChannelChange(one.name, one.unit, *size, float(np.median(one.sigma[known]))))
    return changes


def time_axis(time_s: Array) -> tuple[Array, str]:
    """Time as a flight's figures have it, and the axis's label: since the log's first row, in s or min."""
    known = time_s[np.isfinite(time_s)]
    first_s = float(known[0]) if known.size else 0.0
    lasts_s = float(np.ptp(known)) if known.size else 0.0
    scale, unit = (60.0, "min") if lasts_s > IN_MINUTES_S else (1.0, "s")
    if first_s > SINCE_1970_S:
        began = datetime.fromtimestamp(first_s, UTC)
        return (time_s - first_s) / scale, f"time since {began:%Y-%m-%d %H:%M:%S} UTC, {unit}"
    return time_s / scale, f"time, {unit}"


def has_altitude(flight: Flight) -> bool:
    """Whether a log has an altitude that changes."""
    altitude = flight.altitude_m
    if altitude is None or not np.isfinite(altitude).any():
        return False
    return float(np.nanmax(altitude) - np.nanmin(altitude)) > LEAST_CLIMB_M


@styled
def plot_flight(flight: Flight, corrected: Corrected, against: Against = "time") -> Figure:
    """Reading and corrected value with its 95 % band, for each channel.

    Raises
    ------
    InputError
        `against` is neither "time" nor "altitude", or the log has no altitude.
    """
    if against not in ("time", "altitude"):
        raise InputError(f"against={against!r}: expected 'time' or 'altitude'")
    shown = channels_of(flight, corrected)
    if not shown:
        raise InputError("the flight has no readings to draw; give a log with temperature or humidity")
    if against == "altitude":
        if not has_altitude(flight):
            raise InputError("against='altitude': the log has no altitude that changes; leave it out for time")
        return _profiles(flight, shown)
    along, label = time_axis(flight.time_s)
    figure = notebook_figure(9.2, 1.0 + 3.2 * len(shown))
    rows = figure.subplots(2 * len(shown), 1, sharex=True, squeeze=False, height_ratios=[2.4, 1.0] * len(shown))[:, 0]
    few = thinned(flight.time_s.size)
    for one, above, below in zip(shown, rows[::2], rows[1::2], strict=True):
        above.plot(along[few], one.reading[few], color=ORANGE, lw=0.9, label="as read")
        above.plot(along[few], one.value[few], color=BLUE, lw=0.9, label="corrected, 95 % band")
        above.set_ylabel(one.label)
        reach = COVERAGE * one.sigma[few]
        above.fill_between(along[few], one.value[few] - reach, one.value[few] + reach, color=BLUE, alpha=0.25, lw=0)
        band(below, along[few], one.sigma[few], one.unit)
    rows[0].legend(loc="best")
    rows[-1].set_xlabel(label)
    return figure


@styled
def plot_readings(flight: Flight, against: Against = "time") -> Figure:
    """A log's readings as they came, a panel for each channel that has any; errors as of `plot_flight`."""
    if against not in ("time", "altitude"):
        raise InputError(f"against={against!r}: expected 'time' or 'altitude'")
    both = (("temperature, °C", flight.temperature_c), ("relative humidity, %", flight.humidity_percent))
    shown = [(label, values) for label, values in both if np.isfinite(values).any()]
    if not shown:
        raise InputError("the flight has no readings to draw; give a log with temperature or humidity")
    few = thinned(flight.time_s.size)
    if against == "time":
        along, words = time_axis(flight.time_s)
        figure = notebook_figure(9.2, 1.0 + 2.2 * len(shown))
        rows = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (label, values) in zip(rows, shown, strict=True):
            axes.plot(along[few], values[few], color=ORANGE, lw=0.9)
            axes.set_ylabel(label)
        rows[-1].set_xlabel(words)
        return figure
    altitude = flight.altitude_m
    if altitude is None or not has_altitude(flight):
        raise InputError("against='altitude': the log has no altitude that changes; leave it out for time")
    figure = notebook_figure(4.6 * max(len(shown), 1.4), 5.2)
    for axes, (label, values) in zip(figure.subplots(1, len(shown), sharey=True, squeeze=False)[0], shown, strict=True):
        for way, style, words in zip(ways(altitude), ("-", "--"), ("ascent", "descent"), strict=True):
            if way.sum() > 1:
                axes.plot(values[way], altitude[way], color=ORANGE, lw=0.9, ls=style, label=words)
        axes.set_xlabel(label)
    figure.axes[0].set_ylabel("altitude, m")
    figure.axes[0].legend(loc="best")
    return figure


def band(axes: Axes, along: Array, sigma: Array, unit: str) -> None:
    """The 95 % band by itself, on a scale on which it can be seen; where far less is known than usual it is cut."""
    reach = COVERAGE * sigma
    known = reach[np.isfinite(reach)]
    axes.fill_between(along, -reach, reach, color=BLUE, alpha=0.35, lw=0)
    axes.axhline(0.0, color=GREY, lw=0.6)
    if known.size:
        most = 1.3 * float(np.quantile(known, SHOWN_SHARE))
        if most > 0.0:
            axes.set_ylim(-most, most)
    axes.set_ylabel(f"95 % band, {unit}")


@styled
def _profiles(flight: Flight, shown: list[Shown]) -> Figure:
    """Each channel over altitude; ascent and descent are told apart where the flight has both."""
    altitude = flight.altitude_m
    assert altitude is not None
    figure = notebook_figure(4.6 * max(len(shown), 1.4), 5.2)
    for axes, one in zip(figure.subplots(1, len(shown), sharey=True, squeeze=False)[0], shown, strict=True):
        draw_profile(axes, flight.time_s, altitude, one)
    figure.axes[0].set_ylabel("altitude, m")
    figure.axes[0].legend(loc="best")
    return figure


def draw_profile(axes: Axes, time_s: Array, altitude_m: Array, one: Shown) -> None:
    """A channel over altitude, as read and corrected with its band, the way up drawn full and the way down dashed."""
    up, down = ways(altitude_m)
    for way, style, words in ((up, "-", "ascent"), (down, "--", "descent")):
        rows = np.flatnonzero(way)
        if rows.size < 2:
            continue
        rows = rows[thinned(rows.size)]
        look: dict[str, Any] = {"lw": 0.9, "ls": style}
        axes.plot(one.reading[rows], altitude_m[rows], color=ORANGE, label=f"as read, {words}", **look)
        reach = COVERAGE * one.sigma[rows]
        value = one.value[rows]
        axes.fill_betweenx(altitude_m[rows], value - reach, value + reach, color=BLUE, alpha=0.25, lw=0)
        axes.plot(value, altitude_m[rows], color=BLUE, label=f"corrected, {words}", **look)
    axes.set_xlabel(one.label)


def ways(altitude_m: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Rows of the ascent, up to the highest altitude, and of the descent after it."""
    known = np.isfinite(altitude_m)
    top = int(np.nanargmax(altitude_m)) if known.any() else 0
    before = np.arange(altitude_m.size) <= top
    return before & known, ~before & known


def thinned(rows: int) -> slice:
    """Rows that a figure needs."""
    return slice(None, None, max(1, rows // ENOUGH_ROWS))
