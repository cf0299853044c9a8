"""The figure of a corrected flight: reading and corrected value, and below, large enough to be seen, the 95 % band;
against time or against altitude. matplotlib is imported to draw.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shockrig.files.errors import InputError
from shockrig.files.figures import BLUE, GREY, ORANGE, notebook_figure, styled
from shockrig.files.flight import Corrected, Flight
from shockrig.files.legs import ways
from shockrig.files.ranges import RANGES, Range
from shockrig.files.readings_figure import Against, at, draw_line, has_altitude, lone, rows_shown, time_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
LAST_DIGITS = 1e-12  # of a value converted to and fro: a double's are at 2e-16, a log's own at 1e-7
COVERAGE = 1.96  # standard uncertainties of a 95 % band
SHOWN_SHARE = 0.97  # of the rows whose band is within the panel


class Shown:
    """One channel as it is drawn: rows that have a time, thinned where there are more than can be seen."""

    def __init__(
        self, name: str, unit: str, label: str, possible: Range, reading: Array, value: Array, sigma: Array
    ) -> None:
        self.name, self.unit, self.label, self.possible = name, unit, label, possible
        self.reading, self.value, self.sigma = reading, value, sigma

    @property
    def band(self) -> tuple[Array, Array]:
        """Ends of the 95 % band, as far as there is air with them; a reading that is given beyond that is an end."""
        reach = COVERAGE * self.sigma
        low = np.clip(self.value - reach, self.possible.low, self.possible.high)
        high = np.clip(self.value + reach, self.possible.low, self.possible.high)
        return np.minimum(low, self.value), np.maximum(high, self.value)


def channels_of(flight: Flight, corrected: Corrected) -> list[Shown]:
    """The channels that have any reading."""
    both = [
        Shown(
            "temperature",
            "K",
            "temperature, °C",
            RANGES["temperature_c"],
            flight.temperature_c,
            corrected.temperature_c,
            corrected.temperature_uncertainty_k,
        ),
        Shown(
            "humidity",
            "%RH",
            "relative humidity, %",
            RANGES["humidity_set_percent"],
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
            value, reading = (v[known & np.isfinite(one.reading)] for v in (one.value, one.reading))
            # what a double's last digits are off by is no change
            change = np.where(np.isclose(value, reading, rtol=LAST_DIGITS, atol=0.0), 0.0, value - reading)
            size = (float(np.sqrt(np.mean(change**2))), float(np.max(np.abs(change)))) if change.size else (0.0, 0.0)
            changes.append(ChannelChange(one.name, one.unit, *size, float(np.median(one.sigma[known]))))
    return changes


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
        if not has_altitude(flight.altitude_m):
            raise InputError("against='altitude': the log has no altitude that changes; leave it out for time")
        return _profiles(flight, shown)
    along, label = time_axis(flight.time_s)
    figure = notebook_figure(9.2, 1.0 + 3.2 * len(shown))
    rows = figure.subplots(2 * len(shown), 1, sharex=True, squeeze=False, height_ratios=[2.4, 1.0] * len(shown))[:, 0]
    few = rows_shown(flight.time_s)
    along = at(along, few)
    for one, above, below in zip(shown, rows[::2], rows[1::2], strict=True):
        reading, value, low, high = (at(v, few) for v in (one.reading, one.value, *one.band))
        draw_line(above, along, reading, color=ORANGE, label="as read")
        draw_line(above, along, value, color=BLUE, label="corrected, 95 % band")
        above.set_ylabel(one.label)
        draw_band(above, along, low, high)
        band(below, along, low - value, high - value, one.unit)
    rows[0].legend(loc="best")
    rows[-1].set_xlabel(label)
    return figure


def draw_band(axes: Axes, along: Array, low: Array, high: Array, alpha: float = 0.25, across: bool = False) -> None:
    """A band along x, or along y where it goes `across`; a line where one value stands alone."""
    fill, lines = (axes.fill_betweenx, axes.hlines) if across else (axes.fill_between, axes.vlines)
    fill(along, low, high, color=BLUE, alpha=alpha, lw=0)
    if (alone := lone(along, low, high)).any():
        lines(along[alone], low[alone], high[alone], color=BLUE, alpha=alpha)


def band(axes: Axes, along: Array, below: Array, above: Array, unit: str) -> None:
    """The 95 % band by itself, on a scale on which it can be seen; where far less is known than usual it is cut."""
    reach = np.maximum(-below, above)
    known = reach[np.isfinite(reach)]
    draw_band(axes, along, below, above, alpha=0.35)
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
    """A channel over altitude, as read and corrected with its band, ways up drawn full and ways down dashed."""
    up, down = ways(altitude_m)
    few = rows_shown(time_s)
    height = at(altitude_m, few)
    for way, style, words in ((up, "-", "ascent"), (down, "--", "descent")):
        if np.count_nonzero(way) < 2:
            continue
        # each way is a line of its own
        reading, value, low, high = (at(np.where(way, v, np.nan), few) for v in (one.reading, one.value, *one.band))
        draw_line(axes, reading, height, color=ORANGE, ls=style, label=f"as read, {words}")
        draw_band(axes, height, low, high, across=True)
        draw_line(axes, value, height, color=BLUE, ls=style, label=f"corrected, {words}")
    axes.set_xlabel(one.label)
