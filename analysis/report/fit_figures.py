"""What a fit says and what it leaves, drawn.

D over temperature, a parameter run by run against the conditions; residuals over time since the transfer, before and
after correction, noise, causes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import log_bins
from shockrig.analysis.report.panels import log_time, panels, strokes
from shockrig.files.figures import BLUE, GREEN, GREY, INK, LIGHT, ORANGE, RED, SKY, literal, styled
from shockrig.files.numbers import plain, power_of_ten

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BETWEEN_RUNS, WIDEST_RUNS = 0.012, 4  # of the axis, between runs of one condition; of so many at most
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


def _side_by_side(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places of runs on an axis: those of one condition beside one another, not over one another."""
    known, moved = x[np.isfinite(x)], x.copy()
    width = BETWEEN_RUNS * (np.ptp(known) if known.size and np.ptp(known) > 0 else 1.0)
    for place in set(known.tolist()):
        alike = np.flatnonzero(x == place)
        moved[alike] += np.linspace(-1, 1, max(2, alike.size))[: alike.size] * width * min(WIDEST_RUNS, alike.size)
    return moved


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
        at = np.array([place(r) for r in runs], dtype=float)
        known, x = at[np.isfinite(at)], _side_by_side(at)
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


FACTORS = ("direction", "ambient", "airflow", "amplitude")


@dataclass(frozen=True)
class ResidualRun:
    """Residuals of one run, reading less model, over time since the transfer (n,), and what the run was.

    `direction` is "up" or "down"; `airflow_m_s` is None where unknown; `amplitude` is the size of the step.
    """

    run: str
    time_s: np.ndarray
    residual: np.ndarray
    direction: str
    ambient_c: float
    airflow_m_s: float | None
    amplitude: float


@styled
def residual_overview(
    runs: Sequence[ResidualRun], unit: str, noise: float, amplitude_unit: str | None = None
) -> Figure:
    """Four panels of the same residuals, coloured by direction, ambient, airflow and amplitude.

    Parameters
    ----------
    runs : residuals of each run; averaged into 24 bins of equal width in log time
    unit : of the residuals
    noise : standard deviation of one reading's noise, drawn as a band of two of them (`unit`)
    amplitude_unit : unit of the amplitudes; that of the residuals if left out
    """
    if not runs:
        raise ValueError("there are no residuals to draw")
    figure, axes_of = panels((2, 2), (9.6, 6.2), top_in=0.42, down_in=0.5, sharex=True, sharey=True)
    binned = [log_bins(run.time_s, run.residual) for run in runs]
    labels: dict[str, tuple[str, Sequence[str | float | None]]] = {
        "direction": ("direction", [run.direction for run in runs]),
        "ambient": ("ambient, °C", [round(run.ambient_c) for run in runs]),
        "airflow": ("airflow, m/s", [run.airflow_m_s for run in runs]),
        "amplitude": (f"step, {amplitude_unit or unit}", _amplitude_groups([run.amplitude for run in runs])),
    }
    for axes, factor in zip(axes_of.flat, FACTORS, strict=True):
        title, values = labels[factor]
        colours = _colours(values)
        axes.axhspan(-2 * noise, 2 * noise, color=LIGHT, linewidth=0)
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        for value, colour in colours.items():
            name = "unknown" if value is None else literal(f"{value:g}" if isinstance(value, int | float) else value)
            curves = [curve for curve, own in zip(binned, values, strict=True) if own == value]
            strokes(axes, curves, color=colour, linewidth=0.9, alpha=0.75, label=name)
        axes.set_title(f"by {title}", pad=18)
        legend = axes.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(colours), handlelength=1.2, columnspacing=1.2,
            borderaxespad=0.0, borderpad=0.2,
        )  # fmt: skip
        for handle in legend.legend_handles:
            handle.set(linewidth=2, alpha=1)
    log_time(axes_of.flat, [time for time, _ in binned])
    for axes in axes_of[-1]:
        axes.set_xlabel("time since the transfer, s")
    for axes in axes_of[:, 0]:
        axes.set_ylabel(f"residual, {unit}")
    return figure


@dataclass(frozen=True)
class BeforeAfter:
    """Held-out residuals of one run, before and after the model was extended, over time since the transfer (n,)."""

    run: str
    time_s: np.ndarray
    before: np.ndarray
    after: np.ndarray


@styled
def before_after(
    runs: Sequence[BeforeAfter], unit: str, noise: float, rms: tuple[float, float] | None = None
) -> Figure:
    """Residuals before and after, on one scale and on that of the noise.

    `noise` is the standard deviation of one reading (`unit`), drawn as a band of two; `rms` are the errors to write
    into the titles, else those of the residuals given.
    """
    if not runs:
        raise ValueError("there are no residuals to draw")
    if rms is None:
        rms = _root_mean_square([r.before for r in runs]), _root_mean_square([r.after for r in runs])
    figure, axes_of = panels((1, 3), (9.6, 3.6), across_in=0.56)
    sides = [("before", RED, rms[0]), ("after", BLUE, rms[1]), ("after", BLUE, rms[1])]
    binned = {
        "before": [log_bins(run.time_s, run.before) for run in runs],
        "after": [log_bins(run.time_s, run.after) for run in runs],
    }
    largest = max(float(np.nanmax(np.abs(mean), initial=0.0)) for _, mean in binned["before"])
    reach = max(1.1 * largest, 3 * noise)
    for axes, (side, colour, error), close in zip(axes_of[0], sides, (False, False, True), strict=True):
        axes.axhspan(-2 * noise, 2 * noise, color=LIGHT, linewidth=0, label="noise, ±2σ")
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        strokes(axes, binned[side], color=colour, linewidth=0.8, alpha=0.8)
        axes.set_ylim(*((-4 * noise, 4 * noise) if close else (-reach, reach)))
        axes.set_title(f"{side}, enlarged" if close else f"{side}: {error:.3g} {unit} rms")
        axes.set_xlabel("time since the transfer, s")
    log_time(axes_of[0], [time for time, _ in binned["before"]])
    axes_of[0, 0].set_ylabel(f"residual, {unit}")
    axes_of[0, 0].legend(loc="lower right")
    return figure


def _root_mean_square(residuals: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.nanmean(np.square(np.concatenate(residuals)))))


@styled
def autocorrelation(channels: Mapping[str, tuple[np.ndarray, int]], period_s: float | None = None) -> Figure:
    """Autocorrelation of the noise of each channel with the band of white noise.

    Parameters
    ----------
    channels : name -> (autocorrelation at lags 1..m, number of samples it was taken from)
    period_s : sampling period; the lags are then also given in seconds
    """
    figure, axes_of = panels((1, len(channels)), (max(4.8, 4.4 * len(channels)), 2.8), sharey=True)
    for axes, (name, (values, samples)), colour in zip(axes_of[0], channels.items(), (BLUE, RED, ORANGE), strict=False):
        lags = np.arange(1, len(values) + 1)
        band = 1.96 / np.sqrt(samples)
        axes.axhspan(-band, band, color=LIGHT, linewidth=0, label="white noise, 95 %")
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        axes.vlines(lags, 0.0, values, color=colour, linewidth=1.2)
        axes.plot(lags, values, "o", color=colour, markersize=3)
        axes.set_title(literal(name))
        axes.set_xlabel("lag, samples" + (f" of {period_s:.3g} s" if period_s else ""))
    axes_of[0, -1].legend(loc="upper right")
    axes_of[0, 0].set_ylabel("autocorrelation")
    low = min(-0.3, *(1.2 * float(np.min(v)) for v, _ in channels.values()))
    axes_of[0, 0].set_ylim(low, 1.05)
    return figure


@styled
def cause_bars(
    names: Sequence[str],
    evidence: Sequence[float],
    kept: Sequence[bool],
    threshold: float,
    label: str = "log-likelihood gained",
) -> Figure:
    """Candidate causes by the log-likelihood that each gains, the largest on top; those kept are filled.

    The axis is logarithmic above the threshold and linear below, so that weak and strong causes can both be read.
    """
    order = np.argsort(evidence, kind="stable")
    written = [literal(names[i]) for i in order]
    left_in = 0.2 + 0.075 * max(map(len, written), default=0)
    size_in = 7.2, 0.9 + 0.28 * max(len(names), 2)
    figure, ((axes,),) = panels((1, 1), size_in, left_in=left_in, right_in=0.6, top_in=0.2)
    axes.barh(
        range(len(order)),
        [evidence[i] for i in order],
        color=[BLUE if kept[i] else "white" for i in order],
        edgecolor=[BLUE if kept[i] else GREY for i in order],
        height=0.66,
        linewidth=0.8,
    )
    beside = {"xytext": (4, 0), "textcoords": "offset points", "va": "center", "fontsize": 7.5}
    for row, i in enumerate(order):
        axes.annotate(plain(float(evidence[i]), 3), (max(evidence[i], 0.0), row), **beside)
    axes.set_yticks(range(len(names)), written)
    axes.axvline(threshold, color=RED, linewidth=1.0, linestyle="--")
    axes.annotate("needed", (threshold, 1.0), (3, 2), xycoords=("data", "axes fraction"), textcoords="offset points",
                  color=RED, fontsize=7.5)  # fmt: skip
    axes.set_xscale("symlog", linthresh=max(threshold, 1e-9))
    top = max(max(evidence, default=1.0), threshold)
    axes.set_xlim(min(0.0, 1.3 * min(evidence, default=0.0)), 3.0 * top)
    # below the threshold the axis is linear, and powers of ten would stand on top of one another
    powers = 10.0 ** np.arange(np.ceil(np.log10(max(threshold, 1e-9))), 40)
    ticks = [0.0, *powers[powers < 3 * top]]
    axes.set_xticks(ticks, [plain(tick, 1) for tick in ticks])
    axes.set_xticks([], minor=True)
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel(label)
    return figure


def _amplitude_groups(amplitudes: Sequence[float]) -> list[str]:
    """Names of at most four groups of sizes, parted where neighbours differ most (and by more than a sixth)."""
    sizes = np.maximum(np.abs(np.asarray(amplitudes, dtype=float)), 1e-12)
    ordered = np.sort(sizes)
    gaps = np.diff(np.log(ordered))
    wide = [i for i in np.argsort(gaps)[::-1][:3] if gaps[i] > np.log(7 / 6)]
    groups = np.searchsorted([ordered[i + 1] for i in sorted(wide)], sizes, side="right")
    names = []
    for group in range(len(wide) + 1):
        low, high = (f"{size:.2g}" if (size := f(sizes[groups == group])) > 1e-9 else "0" for f in (np.min, np.max))
        names.append(low if low == high else f"{low} to {high}")
    return [names[i] for i in groups]


def _colours(values: Sequence[str | float | None]) -> dict[str | float | None, Any]:
    """A colour for each value: two kinds apart, an ordered scale for numbers; None is grey."""
    import matplotlib

    def key(value: str | float | None) -> float:
        return float(str(value).split(" ")[0]) if value is not None else np.inf

    kinds = set(values)
    if all(isinstance(v, str) for v in kinds) and kinds <= {"up", "down"}:
        return {v: {"up": RED, "down": BLUE}[str(v)] for v in sorted(kinds, key=str, reverse=True)}
    ordered = sorted(kinds, key=key)
    scale = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, max(len(ordered), 2)))
    return {value: (GREY if value is None else tuple(colour)) for value, colour in zip(ordered, scale, strict=False)}
