"""Figures of the flight demonstration: signals, spectra, structure functions, Bode, poles and zeros."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.correct import METHODS
from shockrig.analysis.flight.judging import Bode, gathered, power_spectrum, structure_function
from shockrig.analysis.flight.simulated.scenes import CHANNELS, UNCERTAINTY, Trial
from shockrig.analysis.physics.schemes.layers import StateSpace
from shockrig.analysis.physics.schemes.sampling import poles, zeros
from shockrig.analysis.report.style import BLUE, GREEN, GREY, INK, ORANGE, RED, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
COLOURS = {"smoother": BLUE, "inverse": GREEN, "paper": RED}
LABELS = {"temperature": "Temperature, °C", "humidity": "Relative humidity, %"}
UNITS = {"temperature": "K²/Hz", "humidity": "%RH²/Hz"}


@styled
def signals(trial: Trial, window_s: tuple[float, float] | None = None) -> Figure:
    """Truth, reading and every correction against time, and the corrections' errors with the smoother's 95 % band."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 5.4))
    axes = figure.subplots(2, 2, sharex=True, height_ratios=(2, 1))
    time = trial.flown.truth["time_s"].to_numpy()
    shown = np.ones(time.size, dtype=bool) if window_s is None else (time >= window_s[0]) & (time <= window_s[1])
    for (above, below), (channel, (column, unit)) in zip(axes.T, CHANNELS.items(), strict=True):
        truth, raw = trial.flown.truth[column].to_numpy(), trial.flown.log[column].to_numpy()
        above.plot(time[shown], raw[shown], color=ORANGE, lw=1.0, label="reading")
        above.plot(time[shown], truth[shown], color=INK, lw=0.8, label="air (truth)")
        below.plot(time[shown], (raw - truth)[shown], color=ORANGE, lw=0.6)
        for method in reversed(METHODS):
            if method in trial.corrected:
                value = getattr(trial.corrected[method], column)
                above.plot(time[shown], value[shown], color=COLOURS[method], lw=0.9, label=method)
                below.plot(time[shown], (value - truth)[shown], color=COLOURS[method], lw=0.6)
        best = trial.corrected["smoother"]
        sigma = getattr(best, UNCERTAINTY[channel])
        below.fill_between(time[shown], -1.96 * sigma[shown], 1.96 * sigma[shown], color=BLUE, alpha=0.2, lw=0)
        errors = np.abs(getattr(best, column) - truth)[shown]
        reach = max(
            4 * float(np.nanstd(errors)),
            float(np.nanmax(1.96 * sigma[shown])),
            0.4 * float(np.abs(raw - truth)[shown].max()),
        )
        below.set_ylim(-1.1 * reach, 1.1 * reach)
        above.set_ylabel(LABELS[channel])
        below.set_ylabel(f"error, {unit}")
        below.set_xlabel("time, s")
    axes[0, 0].legend(loc="best")
    return figure


@styled
def spectra(trial: Trial) -> Figure:
    """Power spectra of truth, reading and corrections with the -5/3 line."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 3.9))
    for ax, (channel, (column, _)) in zip(figure.subplots(1, 2), CHANNELS.items(), strict=True):
        for label, colour, values in _series(trial, column):
            f, p = gathered(*power_spectrum(values, 0.1, 120.0))
            ax.loglog(f, p, color=colour, label=label)
            if label == "air (truth)":
                ax.loglog(f, p[len(p) // 3] * (f / f[len(p) // 3]) ** (-5 / 3), color=GREY, ls="--", label="−5/3")
                ax.set_ylim(p.min() / 300, 3 * p.max())
        ax.set_xlabel("frequency, Hz")
        ax.set_ylabel(f"{channel} power, {UNITS[channel]}")
    ax.legend(loc="lower left")
    return figure


@styled
def structures(trial: Trial) -> Figure:
    """Second-order structure functions with the 2/3 line."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 3.9))
    for ax, (channel, (column, unit)) in zip(figure.subplots(1, 2), CHANNELS.items(), strict=True):
        for label, colour, values in _series(trial, column):
            lag, d = structure_function(values, 0.1)
            ax.loglog(lag, d, color=colour, label=label)
            if label == "air (truth)":
                ax.loglog(lag, d[len(d) // 3] * (lag / lag[len(d) // 3]) ** (2 / 3), color=GREY, ls="--", label="2/3")
        ax.set_xlabel("lag, s")
        ax.set_ylabel(f"{channel} structure function, {unit}²")
    ax.legend(loc="upper left")
    return figure


@styled
def bode_figure(diagrams: dict[str, Bode]) -> Figure:
    """Gain and phase of each sensor, its sampled form, the inverse, and the inverse behind its low-pass."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 5.2))
    axes = figure.subplots(2, len(diagrams), sharex=True, squeeze=False)
    curves = (
        ("continuous", INK, "sensor"),
        ("sampled", ORANGE, "sampled at 10 Hz"),
        ("inverse", RED, "inverse"),
        ("corrected", BLUE, "inverse and low-pass"),
    )
    for (gain, phase), (name, diagram) in zip(axes.T, diagrams.items(), strict=True):
        for attribute, colour, label in curves:
            values = getattr(diagram, attribute)
            style = "--" if attribute == "sampled" else "-"
            gain.loglog(diagram.frequency_hz, np.maximum(np.abs(values), 1e-4), style, color=colour, label=label)
            angle = np.degrees(np.unwrap(np.angle(values)))
            visible = np.abs(values) > 1e-3
            phase.semilogx(diagram.frequency_hz[visible], angle[visible], style, color=colour)
        gain.set_title(name)
        gain.set_ylabel("gain")
        gain.set_ylim(1e-3, 1e3)
        phase.set_ylabel("phase, degrees")
        phase.set_xlabel("frequency, Hz")
    axes[0, 0].legend(loc="upper left")
    return figure


@styled
def pole_zero(systems: dict[str, StateSpace]) -> Figure:
    """Poles and zeros of sampled sensors on the unit circle: an inverse is stable where all zeros lie inside."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 2.9))
    turn = np.linspace(0, 2 * np.pi, 200)
    for ax, (name, system) in zip(figure.subplots(1, len(systems), squeeze=False)[0], systems.items(), strict=True):
        ax.plot(np.cos(turn), np.sin(turn), color=GREY, lw=0.8)
        p, z = poles(system), zeros(system)
        ax.plot(p.real, p.imag, "x", color=INK, label="poles")
        ax.plot(z.real, z.imag, "o", mfc="none", color=RED, label="zeros")
        reach = max(1.3, 1.1 * float(np.max(np.abs(z), initial=1.0)))
        ax.set_xlim(-reach, 1.3)
        ax.set_ylim(-0.5 * (reach + 1.3), 0.5 * (reach + 1.3))
        ax.set_aspect("equal")
        ax.set_title(name)
    ax.legend(loc="lower left")
    return figure


def _series(trial: Trial, column: str) -> Iterator[tuple[str, str, Array]]:
    """Label, colour and values of the air, the reading and every correction."""
    yield "air (truth)", INK, trial.flown.truth[column].to_numpy()
    yield "reading", ORANGE, trial.flown.log[column].to_numpy()
    for method in reversed(METHODS):
        if method in trial.corrected:
            yield method, COLOURS[method], getattr(trial.corrected[method], column)
