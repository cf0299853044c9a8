"""What the model leaves: residuals over time since the transfer, before and after correction, noise, causes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.analysis.estimate.bins import log_bins
from shockrig.analysis.report.panels import log_time, panels, strokes
from shockrig.analysis.report.style import BLUE, GREY, INK, LIGHT, ORANGE, RED, literal, styled
from shockrig.files.numbers import plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
