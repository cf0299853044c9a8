"""Panels at fixed places and few strokes in them: fitting a layout to the labels costs as much as drawing it twice."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.report.style import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
LABEL_BELOW_IN, LABEL_LEFT_IN = 0.27, 0.58  # from a panel's edge, clear of the tick labels
TICKS = 5  # intervals of an axis at most


def panels(
    shape: tuple[int, int],
    size_in: tuple[float, float],
    *,
    left_in: float = 0.74,
    right_in: float = 0.08,
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
