"""The page of `shockrig slips`: what the paper's schemes get wrong as printed, by how much, and the fix."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.physics.modes import film_mean, response_times, sphere_core
from shockrig.analysis.physics.schemes.slips import COLUMNS, PERIOD_S, Slip, SlipRow, share_time
from shockrig.analysis.physics.schemes.state_space import film_layers, sample, sphere_layers, step_response, zeros
from shockrig.analysis.report.html import Figure, HtmlPage, KeyNumber, Section, Table, Text
from shockrig.files.figures import BLUE, GREEN, GREY, INK, RED, save_figure, styled
from shockrig.files.numbers import plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

SENSORS = {"bead (sphere, core)": (sphere_layers, sphere_core()), "film (mean)": (film_layers, film_mean())}
SOURCE = "Segales, Chilson and Salazar-Cerreno (2022), doi 10.5194/amt-15-2607-2022"


def as_table(slip: Slip) -> Table:
    """A slip's rows as text, without empty columns; relative slips carry their error in per cent."""
    columns = ("case", "as printed", "corrected", "high order", slip.reference)
    rows = []
    for row in slip.rows:
        shown = (_cell(slip, row, value) for value in (row.printed, row.corrected, row.high_order))
        rows.append((row.case, *shown, plain(row.exact)))
    keep = [i for i in range(len(columns)) if any(row[i] != plain(None) for row in rows)]
    return Table([columns[i] for i in keep], [[row[i] for i in keep] for row in rows], slip.quantity)


def write_slips_report(slips: tuple[Slip, ...], directory: str | os.PathLike[str]) -> Path:
    """Write DIRECTORY/report.html and its plots; returns the page's path."""
    folder = Path(directory)
    drawn = {"step_responses": _responses(5), "grid_errors": _errors(), "zeros": _zeros(5)}
    figures = {name: save_figure(figure, folder, name) for name, figure in drawn.items()}
    by_id = {slip.id: slip for slip in slips}
    fitted = by_id["fitted_diffusivity"].rows
    printed = {name: 100 * (_told(row.printed) - 1) for name, row in zip(_FITTED, fitted, strict=True)}
    verdict = (
        "Taken as printed, the paper's grids make a fitted diffusivity depend on the number of layers: with 8 layers "
        f"alpha comes out {printed['alpha, 8']:.0f} % and D {printed['D, 8']:.0f} % too large, with 64 layers "
        f"{printed['alpha, 64']:.0f} % and {printed['D, 64']:.0f} %. The fixes are a line each."
    )
    alpha_8, alpha_64, d_8, d_64 = (_told(row.high_order) for row in fitted)
    spread = max(abs(alpha_8 / alpha_64 - 1), abs(d_8 / d_64 - 1))
    zero = next(row for row in by_id["core_zeros"].rows if row.case == "N = 3")
    numbers = (
        KeyNumber("alpha, 8 layers, as printed", f"{printed['alpha, 8']:+.1f} %", "of the true value"),
        KeyNumber("D, 8 layers, as printed", f"{printed['D, 8']:+.1f} %", "of the true value"),
        KeyNumber("8 against 64 layers, high order", f"{plain(100 * spread, 2)} %", "largest difference, alpha and D"),
        KeyNumber("outermost zero of the core, N = 3", plain(zero.corrected, 3), "beyond −1: the inverse is unstable"),
    )
    details = [
        Section(slip.title, (Text(f"Taken: {slip.printed}."), Text(f"Fix: {slip.fix}."), as_table(slip)))
        for slip in slips
    ]
    report = HtmlPage(
        "The paper's schemes as printed and corrected",
        verdict,
        numbers,
        (_against_the_series(figures), *details),
        {"paper": SOURCE, "numbers": "measured when this page was written, against the series of the plain model"},
        tone="warning",
    )
    return report.write(folder / "report.html")


def _against_the_series(figures: dict[str, Path]) -> Section:
    return Section(
        "The schemes against the series",
        (
            Figure(
                figures["step_responses"],
                "Unit step with five layers, and the error in per cent of the step.",
                "Step responses of bead and film: the printed schemes lag behind the series, collocation covers it.",
            ),
            Figure(
                figures["grid_errors"],
                "Error of t63 over the number of layers, drawn down to 1e-9; dashed: the 0.1 % that a fit should keep.",
                "The printed error falls as 1/N, the simple fix as 1/N², collocation is below 0.02 % from N = 3 on.",
            ),
            Figure(
                figures["zeros"],
                "Zeros that sampling at 0.1 s creates, with the unit circle: outside it, the inverse is unstable.",
                "Zeros of bead and film in the z plane; the bead's core has one left of −1 in each scheme.",
            ),
        ),
    )


_FITTED = ("alpha, 8", "alpha, 64", "D, 8", "D, 64")  # rows of fitted_diffusivity: what, with how many layers


def _told(value: float | None) -> float:
    if value is None:
        raise ValueError("a row of fitted_diffusivity lacks a value; compute both schemes for it")
    return value


def _cell(slip: Slip, row: SlipRow, value: float | None) -> str:
    if value is None or not slip.relative or not row.exact:
        return plain(value)
    error = 100 * (value / row.exact - 1)
    shown = f"{error:+.1f} %" if abs(error) >= 0.95 else f"{error:+.1g} %" if abs(error) >= 1e-4 else "0 %"
    return f"{plain(value)} ({shown.replace('-', '−')})"


def _responses(layers: int) -> Drawing:
    time = np.linspace(0.0, 1.2, 400)
    return step_responses(
        time,
        {name: modes.step(time) for name, (_, modes) in SENSORS.items()},
        {name: {s: step_response(build(s, layers), time) for s in COLUMNS} for name, (build, _) in SENSORS.items()},
        layers,
    )


def _errors() -> Drawing:
    layers = np.array([2, 3, 4, 5, 6, 8, 10, 14, 20, 32, 50])
    errors = {}
    for name, (build, modes) in SENSORS.items():
        exact = response_times(modes)[0]
        errors[name] = {s: np.array([share_time(build(s, n)) / exact - 1 for n in layers]) for s in COLUMNS}
    return grid_errors(layers, errors)


def _zeros(layers: int) -> Drawing:
    panels = {}
    for (name, (build, modes)), t98_s in zip(SENSORS.items(), (1.0, 4.0), strict=True):
        rate = response_times(modes)[2] / t98_s
        found = {s: zeros(sample(build(s, layers, rate), PERIOD_S)) for s in COLUMNS}
        panels[f"{name}, N = {layers}, t98 = {t98_s:g} s"] = found
    return zero_map(panels)


# The paper's layered schemes, as printed and corrected, drawn against the series.

LOOKS = {"printed": (RED, "o"), "corrected": (BLUE, "s"), "collocation": (GREEN, "^")}
NAMES = {"printed": "as printed", "corrected": "corrected", "collocation": "collocation"}


@styled
def step_responses(
    time: np.ndarray, series: dict[str, np.ndarray], schemes: dict[str, dict[str, np.ndarray]], layers: int
) -> Drawing:
    """Step response of each sensor, and under it what each scheme gets wrong.

    Parameters
    ----------
    time : (n,), in units of length^2 / diffusivity
    series : sensor -> exact response (n,)
    schemes : sensor -> scheme -> response (n,) with `layers` layers
    """
    from matplotlib.figure import Figure as Canvas

    figure = Canvas(figsize=(9.6, 4.6))
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
def grid_errors(layers: np.ndarray, errors: dict[str, dict[str, np.ndarray]]) -> Drawing:
    """Relative error of t63 over the number of layers: sensor -> scheme -> error (n,)."""
    from matplotlib.figure import Figure as Canvas
    from matplotlib.ticker import FuncFormatter, NullFormatter, ScalarFormatter

    figure = Canvas(figsize=(9.6, 3.4))
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
def zero_map(panels: dict[str, dict[str, np.ndarray]]) -> Drawing:
    """Zeros (complex, any shape) in the z plane with the unit circle: panel title -> scheme -> zeros."""
    from matplotlib.figure import Figure as Canvas

    figure = Canvas(figsize=(9.6, 2.9))
    grid = figure.subplots(1, len(panels), squeeze=False)[0]
    angle = np.linspace(0, 2 * np.pi, 361)
    for axes, (title, schemes) in zip(grid, panels.items(), strict=True):
        axes.plot(np.cos(angle), np.sin(angle), color=GREY, linewidth=0.9)
        for name, found in schemes.items():
            colour, marker = LOOKS[name]
            axes.plot(found.real, found.imag, marker, color=colour, markerfacecolor="none", label=NAMES[name])
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(title)
        axes.set_xlabel("real part of z")
    grid[0].set_ylabel("imaginary part of z")
    grid[0].legend(loc="upper left")
    return figure
