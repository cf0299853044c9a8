"""Every run at a glance: small multiples of reading and model, with the residual under each."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.report.style import BLUE, GREY, INK, LIGHT, RED, literal, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


LEAST_WIDTH_IN = 6.4
LETTERS_PER_IN = 12.5  # of a title


@dataclass(frozen=True)
class RunPanel:
    """One run of one channel. Times (n,) count from the start of the transfer; `reading` and `model` (n,) share a unit.

    `title` says which run, `condition` what it was (runs of one condition stand together in the order of first
    appearance); `model` is None for a run that was not fitted, and `note` then says why.
    """

    title: str
    condition: str
    time_s: np.ndarray
    reading: np.ndarray
    model: np.ndarray | None = None
    note: str = ""


@styled
def run_panels(
    panels: Sequence[RunPanel], quantity: str, unit: str, noise: float | None = None, columns: int = 5
) -> Figure:
    """Draw all runs of one channel.

    Parameters
    ----------
    panels : the runs
    quantity, unit : what the axes show, e.g. "temperature", "°C"
    noise : standard deviation of the noise in `unit`, drawn as a band of two of them under the residuals
    columns : panels side by side

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
    width, height = max(2.45 * columns + 0.3, LEAST_WIDTH_IN), 2.35 * rows + 0.75
    # a fixed layout: fitting one to some hundred axes takes longer than drawing them
    figure = Figure(figsize=(width, height), layout="none")  # type: ignore[arg-type] # known, and not annotated
    outer = figure.add_gridspec(
        rows, columns, left=0.55 / width, right=1 - 0.1 / width, bottom=0.45 / height, top=1 - 0.6 / height,
        wspace=0.24, hspace=0.32,
    )  # fmt: skip
    residuals = [np.abs(p.reading - p.model) for p in panels if p.model is not None]
    reach = float(np.nanpercentile(np.concatenate(residuals), 99.5)) if residuals else 1.0
    reach = 1.25 * max(reach, 2.0 * (noise or 0.0)) or 1.0
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        inner = outer[row, column].subgridspec(2, 1, height_ratios=[3.0, 1.1], hspace=0.06)
        top, low = figure.add_subplot(inner[0]), figure.add_subplot(inner[1])
        _draw_run(top, low, panel, reach, noise)
        if column == 0:
            top.set_ylabel(unit)
            low.set_ylabel("residual", fontsize=7.5)
        if index + columns >= len(panels):
            low.set_xlabel("s since transfer")
    title = f"{quantity[:1].upper()}{quantity[1:]}: readings (dots) and model (line); residuals in {unit}, ±{reach:.2g}"
    figure.suptitle(
        "\n".join(textwrap.wrap(title, int(LETTERS_PER_IN * width))),
        x=0.1 / width, y=1 - 0.1 / height, va="top", ha="left", fontsize=10,
    )  # fmt: skip
    return figure


def _draw_run(top: Axes, low: Axes, panel: RunPanel, reach: float, noise: float | None) -> None:
    dots = GREY if panel.model is None else BLUE
    top.plot(panel.time_s, panel.reading, ".", color=dots, markersize=2.2, alpha=0.6, rasterized=True)
    for axes in (top, low):
        axes.set_xscale("function", functions=(_root, _square))
        left, right = float(np.min(panel.time_s)), float(np.max(panel.time_s))
        if right > max(left, -10.0):
            axes.set_xlim(max(left, -10.0), right)
        axes.set_xticks([t for t in (-5, 0, 1, 5, 20, 60, 150, 400, 1000) if max(left, -10.0) <= t <= right])
        axes.axvline(0.0, color=GREY, linewidth=0.6)
        axes.tick_params(labelsize=7, length=2)
    top.tick_params(labelbottom=False)
    low.set_ylim(-reach, reach)
    low.set_yticks([-0.7 * reach, 0.0, 0.7 * reach], [])
    top.set_title(f"{literal(panel.title)} · {literal(panel.condition)}", fontsize=7.5, fontweight="normal")
    if noise is not None:
        low.axhspan(-2 * noise, 2 * noise, color=LIGHT, linewidth=0)
    if panel.model is not None:
        order = np.argsort(panel.time_s)
        top.plot(panel.time_s[order], panel.model[order], color=RED, linewidth=1.0)
        low.plot(panel.time_s, panel.reading - panel.model, ".", color=INK, markersize=1.6, alpha=0.6, rasterized=True)
    else:
        note = "\n".join(textwrap.wrap(literal(panel.note or "left out"), 34))
        low.text(0.5, 0.5, note, transform=low.transAxes, ha="center", va="center", fontsize=6.5)


def _root(time: np.ndarray) -> np.ndarray:
    return np.sign(time) * np.sqrt(np.abs(time))


def _square(root: np.ndarray) -> np.ndarray:
    return np.sign(root) * np.square(root)
