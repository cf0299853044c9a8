"""Every run at a glance: small multiples of reading and model, with the residual under each.

All panels are drawn on one pair of axes, whose unit is the inch: seventy pairs of their own, with ticks of five artists
each, took ten times as long as what they show.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.figures import BLUE, GREY, INK, LIGHT, RED, literal, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# Panels at fixed places and few strokes in them: fitting a layout to the labels costs as much as drawing it twice.

LABEL_BELOW_IN, LABEL_LEFT_IN = 0.27, 0.58  # from a panel's edge, clear of the tick labels
TICKS = 5  # intervals of an axis at most


def panels(
    shape: tuple[int, int],
    size_in: tuple[float, float],
    *,
    left_in: float = 0.74,
    right_in: float = 0.16,
    bottom_in: float = 0.48,
    top_in: float = 0.28,
    across_in: float = 0.14,
    down_in: float = 0.2,
    heights: Sequence[float] | None = None,
    **shared: Any,
) -> tuple[Figure, Any]:
    """A figure of rows and columns of axes at fixed places.

    Parameters
    ----------
    shape : (rows, columns)
    size_in : (width, height) of the figure [inch]
    left_in, right_in, bottom_in, top_in : margins [inch]
    across_in, down_in : gaps between panels [inch]
    heights : of the rows, relative
    shared : `sharex` and `sharey` as for `Figure.subplots`

    Returns
    -------
    (Figure, ndarray of Axes)
        As `Figure.subplots` gives them, never squeezed.
    """
    from matplotlib.figure import Figure

    (rows, columns), (width, height) = shape, size_in
    wide = (width - left_in - right_in - (columns - 1) * across_in) / columns
    high = (height - bottom_in - top_in - (rows - 1) * down_in) / rows
    figure = Figure(figsize=size_in, layout="none")  # type: ignore[arg-type] # known, and not annotated
    places = {
        "left": left_in / width,
        "right": 1 - right_in / width,
        "bottom": bottom_in / height,
        "top": 1 - top_in / height,
        "wspace": across_in / wide,
        "hspace": down_in / high,
    }
    drawn = figure.subplots(rows, columns, squeeze=False, gridspec_kw=places, height_ratios=heights, **shared)
    tall = [high] * rows if heights is None else [rows * high * h / sum(heights) for h in heights]
    for row, own_in in zip(drawn, tall, strict=True):
        for axes in row:
            # Where a label stands is otherwise found by measuring all tick labels.
            axes.xaxis.set_label_coords(0.5, -LABEL_BELOW_IN / own_in)
            axes.yaxis.set_label_coords(-LABEL_LEFT_IN / wide, 0.5)
            axes.locator_params(nbins=TICKS)  # each is five artists; labels of more would touch
    return figure, drawn


def log_time(all_axes: Iterable[Axes], times_s: Sequence[Array]) -> None:
    """Let time go with its logarithm, from the first to the last of `times_s`, with plain numbers at the decades."""
    from matplotlib.markers import TICKDOWN
    from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

    positive = [t[t > 0] for t in times_s]
    known = np.concatenate([*positive, [0.3, 3.0]] if not any(t.size for t in positive) else positive)
    low, high = 0.85 * float(known.min()), float(known.max()) / 0.85
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    between = np.outer(decades, np.arange(2, 10)).ravel()
    named = decades if ((decades >= low) & (decades <= high)).sum() > 1 else np.outer(decades, [1, 2, 5]).ravel()
    ticks, small = (x[(x >= low) & (x <= high)] for x in (named, between))
    for axes in all_axes:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(FixedLocator(ticks.tolist()))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlim(low, high)
        # The ticks between decades as one stroke: each tick of its own is five artists.
        axes.plot(
            small, np.zeros(small.size), linestyle="none", marker=TICKDOWN, markersize=2, markeredgewidth=0.6,
            color=INK, transform=axes.get_xaxis_transform(), scaley=False, clip_on=False,
        )  # fmt: skip


def strokes(axes: Axes, curves: Iterable[tuple[Array, Array]], **look: Any) -> None:
    """Draw many curves (x, y) of one look as one line that is interrupted between them."""
    parts = [(np.append(x, np.nan), np.append(y, np.nan)) for x, y in curves]
    if parts:
        axes.plot(*(np.concatenate(side) for side in zip(*parts, strict=True)), **look)


LEAST_WIDTH_IN = 6.4
LETTERS_PER_IN = 12.5  # of a title
CELL_IN = (2.45, 2.35)  # of a run: width and height, with what is between it and the next
LEFT_IN, RIGHT_IN, BOTTOM_IN, TOP_IN = 0.6, 0.1, 0.45, 0.6  # margins of the figure
ACROSS_IN, DOWN_IN, BETWEEN_IN = 0.42, 0.5, 0.08  # between two runs, and between readings and residuals
LOW_SHARE = 0.27  # of a run's height that is the residuals'
EARLIEST_S = -10.0  # what is shown before a transfer
TIMES_S = (-5, 0, 0.01, 0.05, 0.2, 0.5, 1, 5, 20, 60, 150, 400, 1000, 3000, 10_000, 30_000, 100_000)  # named
TIME_AXIS = "s since transfer (its square root)"
NAMED_APART = 0.08  # of the axis, that two of them are apart
MARGIN = 0.05  # of the range of readings, above and below


@dataclass(frozen=True)
class RunPanel:
    """One run of one channel. Times (n,) count from the start of the transfer; `reading` and `model` (n,) share a unit.

    `title` says which run, `condition` what it was (runs of one condition stand together in the order of first
    appearance); `model` is None for a run that was not fitted, and `note` then says why. `curve` is the model as it is
    drawn (time, value), between the readings too; left out, it goes from reading to reading.
    """

    title: str
    condition: str
    time_s: np.ndarray
    reading: np.ndarray
    model: np.ndarray | None = None
    note: str = ""
    curve: tuple[np.ndarray, np.ndarray] | None = None


@dataclass(frozen=True)
class _Box:
    """A panel's place [inch], and the range of what it shows; time goes with its square root."""

    left: float
    bottom: float
    width: float
    height: float
    times_s: tuple[float, float]
    values: tuple[float, float]

    def x(self, time_s: Array) -> Array:
        """Where times are [inch]."""
        first, last = root_of(np.array(self.times_s))
        return np.asarray(self.left + self.width * (root_of(np.asarray(time_s)) - first) / (last - first))

    def y(self, value: Array) -> Array:
        """Where values are [inch]."""
        low, high = self.values
        return np.asarray(self.bottom + self.height * (np.asarray(value) - low) / (high - low))

    def shown(self, time_s: Array, value: Array) -> tuple[Array, Array]:
        """The places of those points that lie in the panel."""
        (first, last), (low, high) = self.times_s, self.values
        inside = (time_s >= first) & (time_s <= last) & (value >= low) & (value <= high)
        return self.x(time_s[inside]), self.y(value[inside])

    def across(self, values: Array) -> Iterator[tuple[Array, Array]]:
        """A level line at each value."""
        for y in self.y(values):
            yield np.array([self.left, self.left + self.width]), np.array([y, y])

    def upright(self, times_s: Array) -> Iterator[tuple[Array, Array]]:
        """An upright line at each time."""
        for x in self.x(times_s):
            yield np.array([x, x]), np.array([self.bottom, self.bottom + self.height])

    def frame(self) -> tuple[Array, Array]:
        """Its left and lower edge."""
        right, top = self.left + self.width, self.bottom + self.height
        return np.array([self.left, self.left, right]), np.array([top, self.bottom, self.bottom])


@styled
def run_panels(
    panels: Sequence[RunPanel],
    quantity: str,
    unit: str,
    noise: float | None = None,
    columns: int = 5,
    residual_unit: str = "",
) -> Figure:
    """Draw all runs of one channel.

    Parameters
    ----------
    panels : the runs
    quantity, unit : what the axes show, e.g. "temperature", "°C"
    noise : standard deviation of the noise in `unit`, drawn as a band of two of them under the residuals
    columns : panels side by side
    residual_unit : of the residuals where it is another one (a difference of °C is K)

    Returns
    -------
    Figure
        Time axes go with the square root of time, so that the rise and the plateau can both be read. All residuals
        share one scale, cut at the 99.5th percentile of their size.
    """
    from matplotlib.figure import Figure

    if not panels:
        raise ValueError("there are no runs to draw")
    order = {name: i for i, name in enumerate(dict.fromkeys(p.condition for p in panels))}
    panels = sorted(panels, key=lambda p: order[p.condition])
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    # one run or two get wider panels, so that what stands above them has its place
    width, height = max(CELL_IN[0] * columns + 0.3, LEAST_WIDTH_IN), CELL_IN[1] * rows + 0.75
    residuals = [np.abs(p.reading - p.model) for p in panels if p.model is not None]
    reach = float(np.nanpercentile(np.concatenate(residuals), 99.5)) if residuals else 1.0
    reach = 1.25 * max(reach, 2.0 * (noise or 0.0)) or 1.0
    figure = Figure(figsize=(width, height), layout="none")  # type: ignore[arg-type] # known, and not annotated
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, width), ylim=(0.0, height))
    axes.set_axis_off()
    wide = (width - LEFT_IN - RIGHT_IN - (columns - 1) * ACROSS_IN) / columns
    high = (height - BOTTOM_IN - TOP_IN - (rows - 1) * DOWN_IN) / rows
    boxes = []
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        left, bottom = LEFT_IN + column * (wide + ACROSS_IN), BOTTOM_IN + (rows - 1 - row) * (high + DOWN_IN)
        times_s, low = _times_s(panel), LOW_SHARE * high
        top = _Box(left, bottom + low + BETWEEN_IN, wide, high - low - BETWEEN_IN, times_s, _range(panel))
        boxes.append((panel, top, _Box(left, bottom, wide, low, times_s, (-reach, reach))))
        last = index + columns >= len(panels)
        _letters(axes, panel, *boxes[-1][1:], unit if column == 0 else "", TIME_AXIS if last else "")
    _lines(axes, boxes, noise)
    title = f"{quantity[:1].upper()}{quantity[1:]}: readings (dots) and model (line); residuals"
    title += f" in {residual_unit or unit}, ±{reach:.2g}"
    figure.suptitle(
        "\n".join(textwrap.wrap(title, int(LETTERS_PER_IN * width))),
        x=0.1 / width, y=1 - 0.1 / height, va="top", ha="left", fontsize=10,
    )  # fmt: skip
    return figure


def _times_s(panel: RunPanel) -> tuple[float, float]:
    """From when to when a run is shown [s]."""
    first, last = float(np.min(panel.time_s)), float(np.max(panel.time_s))
    first = max(first, EARLIEST_S) if last > EARLIEST_S else first
    return (first, last) if last > first else (first - 1.0, first + 1.0)


def _range(panel: RunPanel) -> tuple[float, float]:
    """From where to where its readings and model go."""
    both = panel.reading if panel.model is None else np.concatenate([panel.reading, panel.model])
    known = both[np.isfinite(both)]
    if not known.size:
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    margin = MARGIN * (high - low) or max(1e-3, 1e-3 * abs(high))
    return low - margin, high + margin


def times_named(first_s: float, last_s: float) -> Array:
    """Times of an axis that goes by their square root [s], so far apart that each can be read."""
    apart = NAMED_APART * float(np.ptp(root_of(np.array([first_s, last_s]))))
    named: list[float] = []
    for time in (float(t) for t in TIMES_S if first_s <= t <= last_s):
        if not named or np.ptp(root_of(np.array([named[-1], time]))) > apart:
            named.append(time)
    return np.array(named)


def _values_named(box: _Box) -> tuple[Array, list[str]]:
    """Round values of a panel's range, and how they are written."""
    from matplotlib.ticker import MaxNLocator

    ticks = np.asarray(MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(*box.values), dtype=float)
    ticks = ticks[(ticks >= box.values[0]) & (ticks <= box.values[1])]
    places = next((n for n in range(9) if np.allclose(ticks, np.round(ticks, n), rtol=0.0, atol=1e-9)), 9)
    return ticks, [f"{tick + 0.0:.{places}f}".replace("-", "−") for tick in ticks]


def _letters(axes: Axes, panel: RunPanel, top: _Box, low: _Box, unit: str, time: str) -> None:
    """What is written in and around a run's panels."""

    def write(x: float, y: float, text: str, size: float = 7.0, **look: Any) -> None:
        axes.text(x, y, text, fontsize=size, **look)

    ceiling = top.bottom + top.height
    write(top.left, ceiling + 0.05, f"{literal(panel.title)} · {literal(panel.condition)}", 7.5, va="bottom")
    ticks, names = _values_named(top)
    for y, name in zip(top.y(ticks), names, strict=True):
        write(top.left - 0.04, y, name, ha="right", va="center")
    named = times_named(*low.times_s)
    for x, second in zip(low.x(named), named, strict=True):
        write(x, low.bottom - 0.04, f"{second:.6g}".replace("-", "−"), ha="center", va="top")
    if unit:
        write(top.left - 0.47, top.bottom + top.height / 2, unit, 9.0, rotation=90, ha="center", va="center")
        write(low.left - 0.47, low.bottom + low.height / 2, "residual", 7.5, rotation=90, ha="center", va="center")
    if time:
        write(low.left + low.width / 2, low.bottom - 0.19, time, 9.0, ha="center", va="top")
    if panel.model is None:
        note = "\n".join(textwrap.wrap(literal(panel.note or "left out"), 34))
        write(low.left + low.width / 2, low.bottom + low.height / 2, note, 6.5, ha="center", va="center")


def _lines(axes: Axes, boxes: Sequence[tuple[RunPanel, _Box, _Box]], noise: float | None) -> None:
    """What is drawn in all panels: each kind of stroke as one line that is interrupted between the runs."""
    fitted = [(p, p.model, top, low) for p, top, low in boxes if p.model is not None]
    grid = [line for _, top, _ in boxes for line in top.across(_values_named(top)[0])]
    grid += [line for _, _, low in boxes for line in low.across(np.array([-0.56, 0.0, 0.56]) * low.values[1])]
    grid += [line for _, *two in boxes for box in two for line in box.upright(times_named(*box.times_s))]
    strokes(axes, grid, color=LIGHT, linewidth=0.5)
    if noise is not None:
        for _, _, low in boxes:
            edges = np.array([low.left, low.left + low.width])
            axes.fill_between(edges, *low.y(np.array([-2 * noise, 2 * noise])), color=LIGHT, linewidth=0)
    zero = np.zeros(1)
    begins = [one for _, *two in boxes for b in two if b.times_s[0] <= 0 <= b.times_s[1] for one in b.upright(zero)]
    strokes(axes, begins, color=GREY, linewidth=0.6)
    strokes(axes, [box.frame() for _, *two in boxes for box in two], color=GREY, linewidth=0.7)
    dots: dict[str, Any] = {"linestyle": "none", "marker": ".", "alpha": 0.6, "markeredgewidth": 0.0}
    read = [(p.model is None, top.shown(p.time_s, p.reading)) for p, top, _ in boxes]
    strokes(axes, [at for out, at in read if not out], color=BLUE, markersize=2.8, **dots)
    strokes(axes, [at for out, at in read if out], color=GREY, markersize=2.8, **dots)
    curves = [(top, *(p.curve or (p.time_s, model))) for p, model, top, _ in fitted]
    strokes(axes, [_along(*curve) for curve in curves], color=RED, linewidth=1.0)
    left = [low.shown(p.time_s, p.reading - model) for p, model, _, low in fitted]
    strokes(axes, left, color=INK, markersize=2.2, **dots)


def _along(box: _Box, time_s: Array, value: Array) -> tuple[Array, Array]:
    order = np.argsort(time_s)
    return box.shown(time_s[order], value[order])


def root_of(time: Array) -> Array:
    """Times as an axis has them that goes by their square root, before the transfer as well."""
    return np.asarray(np.sign(time) * np.sqrt(np.abs(time)))
