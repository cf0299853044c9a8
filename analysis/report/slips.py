"""The paper's layered schemes, as printed and corrected, drawn against the series."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.report.style import BLUE, GREEN, GREY, INK, RED, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOOKS = {"printed": (RED, "o"), "corrected": (BLUE, "s"), "collocation": (GREEN, "^")}
NAMES = {"printed": "as printed", "corrected": "corrected", "collocation": "collocation"}


@styled
def step_responses(
    time: np.ndarray, series: dict[str, np.ndarray], schemes: dict[str, dict[str, np.ndarray]], layers: int
) -> Figure:
    """Step response of each sensor, and under it what each scheme gets wrong.

    Parameters
    ----------
    time : (n,), in units of length^2 / diffusivity
    series : sensor -> exact response (n,)
    schemes : sensor -> scheme -> response (n,) with `layers` layers
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 4.6))
    panels = figure.subplots(2, len(series), sharex=True, squeeze=False, gridspec_kw={"height_ratios": [2, 1]})
    for column, (sensor, exact) in enumerate(series.items()):
        top, low = panels[:, column]
        for name, response in schemes[sensor].items():
            top.plot(time, response, color=LOOKS[name][0], label=f"{NAMES[name]}, N = {layers}")
            low.plot(time, 100 * (response - exact), color=LOOKS[name][0])
        top.plot(time, exact, color=INK, linestyle=(0, (1, 2)), linewidth=1.8, label="series")
        top.axhline(1 - np.exp(-1), color=GREY, linewidth=0.6)
        top.set_title(sensor)
        low.set_xlabel("time × diffusivity / length²")
    panels[0, 0].set_ylabel("share of the step")
    panels[1, 0].set_ylabel("error, % of the step")
    panels[0, 0].legend(loc="lower right")
    return figure


@styled
def grid_errors(layers: np.ndarray, errors: dict[str, dict[str, np.ndarray]]) -> Figure:
    """Relative error of t63 over the number of layers: sensor -> scheme -> error (n,)."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, NullFormatter, ScalarFormatter

    figure = Figure(figsize=(9.6, 3.4))
    panels = figure.subplots(1, len(errors), sharey=True, squeeze=False)[0]
    for axes, (sensor, schemes) in zip(panels, errors.items(), strict=True):
        for name, error in schemes.items():
            colour, marker = LOOKS[name]
            # below rounding there is nothing to see
            axes.loglog(layers, np.maximum(np.abs(error), 1e-9), marker + "-", color=colour, label=NAMES[name])
        axes.axhline(1e-3, color=GREY, linewidth=0.8, linestyle="--")
        axes.set_title(sensor)
        axes.set_xlabel("layers N")
        axes.set_xticks([2, 5, 10, 20, 50], minor=False)
        axes.xaxis.set_major_formatter(ScalarFormatter())
        axes.xaxis.set_minor_formatter(NullFormatter())
    panels[0].annotate(
        "0.1 %", (layers[-1], 1e-3), (0, 3), textcoords="offset points", ha="right", color=GREY, fontsize=8
    )
    panels[0].yaxis.set_major_formatter(
        FuncFormatter(lambda share, _: f"{100 * share:.0e} %" if share < 1e-5 else f"{100 * share:g} %")
    )
    panels[0].set_ylabel("error of t63")
    panels[-1].legend(loc="center right", bbox_to_anchor=(1.0, 0.35))
    return figure


@styled
def zero_map(panels: dict[str, dict[str, np.ndarray]]) -> Figure:
    """Zeros (complex, any shape) in the z plane with the unit circle: panel title -> scheme -> zeros."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 2.9))
    grid = figure.subplots(1, len(panels), squeeze=False)[0]
    angle = np.linspace(0, 2 * np.pi, 361)
    for axes, (title, schemes) in zip(grid, panels.items(), strict=True):
        axes.plot(np.cos(angle), np.sin(angle), color=GREY, linewidth=0.9)
        for name, zeros in schemes.items():
            colour, marker = LOOKS[name]
            axes.plot(zeros.real, zeros.imag, marker, color=colour, markerfacecolor="none", label=NAMES[name])
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(title)
        axes.set_xlabel("real part of z")
    grid[0].set_ylabel("imaginary part of z")
    grid[0].legend(loc="upper left")
    return figure
