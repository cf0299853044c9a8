"""Fitted parameters: D over temperature with its interpolation, and a parameter run by run against the conditions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.report.panels import panels
from shockrig.analysis.report.style import BLUE, GREEN, GREY, INK, LIGHT, RED, SKY, literal, styled
from shockrig.files.numbers import power_of_ten

if TYPE_CHECKING:
    from matplotlib.figure import Figure


ONE_VALUE = 0.02  # relative, within which a condition was the same in all runs


@dataclass(frozen=True)
class Curve:
    """Points with standard uncertainties over temperature, arrays (n,)."""

    temperature_c: np.ndarray
    value: np.ndarray
    standard_uncertainty: np.ndarray


@styled
def diffusivity(
    table: Curve, interpolation: Curve, runs: Curve | None = None, truth: tuple[np.ndarray, np.ndarray] | None = None
) -> Figure:
    """D(T): the table with two standard uncertainties, and ln D over 1/T as it is read between its rows.

    Parameters
    ----------
    table : the fitted rows [m^2/s]
    interpolation : the same, read on a fine grid, drawn as a line with a band of two standard uncertainties
    runs : fits of single runs, drawn faintly
    truth : (temperature_c, diffusivity) where a sealed truth is known
    """
    from matplotlib.ticker import LogLocator, NullLocator

    figure, ((left, right),) = panels((1, 2), (9.6, 3.7), across_in=0.82)
    scale, power = power_of_ten(float(np.max(table.value)))
    positions: list[Callable[[np.ndarray], np.ndarray]] = [np.asarray, lambda t: 1000.0 / (np.asarray(t) + 273.15)]
    for axes, place in zip((left, right), positions, strict=True):
        low = interpolation.value - 2 * interpolation.standard_uncertainty
        high = interpolation.value + 2 * interpolation.standard_uncertainty
        x = place(interpolation.temperature_c)
        axes.fill_between(
            x, np.maximum(low, 1e-3 * interpolation.value) / scale, high / scale, color=SKY, alpha=0.35, linewidth=0
        )
        axes.plot(x, interpolation.value / scale, color=BLUE, linewidth=1.2, label="interpolated, ±2σ")
        if runs is not None:
            axes.errorbar(
                place(runs.temperature_c), runs.value / scale, 2 * runs.standard_uncertainty / scale, fmt=".",
                color=GREY, alpha=0.6, elinewidth=0.6, markersize=3, label="single runs, ±2σ",
            )  # fmt: skip
        axes.errorbar(
            place(table.temperature_c), table.value / scale, 2 * table.standard_uncertainty / scale, fmt="o", color=INK,
            elinewidth=1.2, capsize=3, label="table, ±2σ",
        )  # fmt: skip
        if truth is not None:
            axes.plot(place(truth[0]), np.asarray(truth[1]) / scale, "x", color=RED, markersize=7, label="sealed truth")
    left.set_xlabel("ambient temperature, °C")
    left.set_ylabel(f"diffusivity D, {power}m²/s")
    left.set_ylim(bottom=0.0)
    left.legend(loc="upper left")
    right.set_xlabel("1000 / T, 1/K")
    right.set_yscale("log")
    right.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    right.yaxis.set_major_formatter("{x:g}")
    right.yaxis.set_minor_locator(NullLocator())
    right.set_ylabel(left.get_ylabel())
    right.set_title("ln D over 1/T, as it is interpolated")
    left.set_title("lookup table")
    return figure


@dataclass(frozen=True)
class RunParameter:
    """A parameter fitted to one run alone, with its standard uncertainty and what the run was."""

    run: str
    value: float
    standard_uncertainty: float
    direction: str
    ambient_c: float
    airflow_m_s: float | None
    amplitude: float


@styled
def parameter_by_condition(
    runs: Sequence[RunParameter],
    name: str,
    unit: str,
    joint: tuple[float, float] | None = None,
    amplitude_unit: str = "",
) -> Figure:
    """A parameter of each run against ambient, airflow, direction and amplitude.

    Parameters
    ----------
    runs : fits of single runs, drawn with two standard uncertainties; runs up are red triangles, down blue ones. Of a
        parameter that depends on the ambient by nature, give its ratio to the table
    name, unit : of the parameter
    joint : value and standard uncertainty of the fit to all runs, drawn as a line with its band of two
    amplitude_unit : of the amplitudes
    """
    if not runs:
        raise ValueError("there are no runs to draw")
    figure, (axes_of,) = panels((1, 4), (9.6, 3.0), top_in=0.08, sharey=True)
    scale, power = power_of_ten(float(np.max([abs(r.value) for r in runs])))
    places: list[tuple[str, Callable[[RunParameter], float]]] = [
        ("ambient, °C", lambda r: r.ambient_c),
        ("airflow, m/s", lambda r: np.nan if r.airflow_m_s is None else r.airflow_m_s),
        ("direction", lambda r: {"down": 0.0, "up": 1.0}[r.direction]),
        (f"step, {amplitude_unit}".rstrip(", "), lambda r: abs(r.amplitude)),
    ]
    values, spreads = (np.array([getattr(r, k) for r in runs]) / scale for k in ("value", "standard_uncertainty"))
    up = np.array([r.direction == "up" for r in runs])
    for axes, (label, place) in zip(axes_of, places, strict=True):
        if joint is not None:
            middle, spread = joint[0] / scale, 2 * joint[1] / scale
            axes.axhspan(middle - spread, middle + spread, color=LIGHT, linewidth=0)
            axes.axhline(middle, color=GREEN, linewidth=1.2)
        x = np.array([place(r) for r in runs], dtype=float)
        known = x[np.isfinite(x)]
        # runs of one condition lie side by side
        width = 0.012 * (np.ptp(known) if known.size and np.ptp(known) > 0 else 1.0)
        offset = {
            v: np.linspace(-1, 1, max(2, int(np.sum(x == v)))) * width * min(4, np.sum(x == v)) for v in set(known)
        }
        seen: dict[float, int] = {}
        for i, position in enumerate(x.tolist()):
            turn = seen[position] = seen.get(position, -1) + 1
            x[i] += offset[position][turn] if np.isfinite(position) else 0.0
        for side, colour, marker in ((up, RED, "^"), (~up, BLUE, "v")):
            there = side & np.isfinite(x)
            axes.errorbar(
                x[there], values[there], 2 * spreads[there], fmt=marker, color=colour, elinewidth=0.8, markersize=3.5,
                alpha=0.8,
            )  # fmt: skip
        axes.set_xlabel(label)
        if not known.size:
            axes.text(0.5, 0.55, "unknown", transform=axes.transAxes, ha="center", color=GREY)
            axes.set_xticks([])
        elif np.ptp(known) < ONE_VALUE * max(abs(float(np.mean(known))), 1.0):
            middle = round(float(np.mean(known)), 1)  # the runs' own small differences are no axis
            axes.set_xlim(middle - 1.0, middle + 1.0)
            axes.set_xticks([middle], [f"{middle:g}"])
    axes_of[2].set_xticks([0.0, 1.0], ["down", "up"])
    axes_of[2].set_xlim(-0.5, 1.5)
    # one run that says nothing must not flatten the others
    trusted = spreads <= 5 * np.median(spreads)
    low, high = (values - 2 * spreads)[trusted].min(), (values + 2 * spreads)[trusted].max()
    axes_of[0].set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    axes_of[0].set_ylabel(f"{literal(name)}, {power}{unit}".rstrip(", "))
    return figure
