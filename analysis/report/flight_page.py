"""The page of `shockrig demo-flights`: three scenes, three corrections side by side, the spectra to judge them by."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.correct import METHODS
from shockrig.analysis.flight.inverse import RefusedError, mean_response, paper_layers, sampled
from shockrig.analysis.flight.judging import (
    SPECTRAL_SLOPE,
    STRUCTURE_SLOPE,
    Bode,
    bode,
    gathered,
    power_spectrum,
    slope,
    structure_function,
)
from shockrig.analysis.flight.response import LagResponse, bead_response, film_response
from shockrig.analysis.flight.simulated.scenes import CHANNELS, UNCERTAINTY, SceneScore, Trial, scores
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.analysis.physics.schemes.state_space import StateSpace, inverse_noise_gain, poles, zeros
from shockrig.analysis.report.html import Figure, HtmlPage, KeyNumber, Section, Table, Text
from shockrig.files.figures import BLUE, GREEN, GREY, INK, ORANGE, RED, save_figure, styled
from shockrig.files.profile import Profile

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

PERIOD_S = 0.1
SLOPES_UP_TO_HZ = {"temperature": 1.0, "humidity": 0.2}  # above it the sensor's noise is what is seen
SOURCE = "Segales, Chilson and Salazar-Cerreno (2022), doi 10.5194/amt-15-2607-2022"
TITLES = {
    "convective": "Convective boundary layer",
    "frontal": "Airmass boundary at 45 m/s",
    "inversion": "Inversion at 5 m/s of ascent",
}
METHOD_WORDS = {
    "smoother": "optimal smoother, D followed along the flight",
    "inverse": "exact inverse between low-passes, D followed",
    "paper": "low-pass, inverse of the stepped layers, low-pass",
}


def write_flights_report(
    trials: Mapping[str, Trial], profile: Profile, directory: str | os.PathLike[str], provenance: Mapping[str, str]
) -> Path:
    """Write DIRECTORY/report.html and its plots; returns the page's path."""
    folder = Path(directory)
    table = [score for trial in trials.values() for score in scores(trial)]
    best = [s for s in table if s.method == "smoother"]
    worst = min(best, key=lambda s: s.raw / s.rmse)
    most = max(best, key=lambda s: s.raw / s.rmse)
    lowest, highest = min(s.coverage for s in best), max(s.coverage for s in best)
    verdict = (
        f"The sensors' lag is undone in all scenes: the smoother's error is {worst.raw / worst.rmse:.1f} times "
        f"({worst.scene}, {worst.channel}) to {most.raw / most.rmse:.0f} times ({most.scene}, {most.channel}) smaller "
        f"than the reading's, and its 95 % interval holds the truth in {100 * lowest:.0f} to {100 * highest:.0f} % "
        "of the samples."
    )
    numbers = [
        KeyNumber(
            f"{s.scene}, {s.channel}",
            f"{s.raw:.2g} → {s.rmse:.2g} {CHANNELS[s.channel][1]}",
            f"reading → smoother, rms; 95 % interval holds {100 * s.coverage:.1f} %",
        )
        for s in best
    ]
    sections = [_scene(trial, folder) for trial in trials.values()]
    sections.insert(0, Section("Errors, side by side", (_table(table, trials),)))
    if "convective" in trials:
        sections.append(_turbulence(trials["convective"], folder))
    sections.append(_systems(trials, profile, folder))
    report = HtmlPage(
        "Flights corrected for sensor lag",
        verdict,
        numbers,
        sections,
        {"scenes and figures after": SOURCE} | dict(provenance),
        "good",
    )
    return report.write(folder / "report.html")


def _table(table: list[SceneScore], trials: Mapping[str, Trial]) -> Table:
    rows: list[tuple[str | float | None, ...]] = []
    for s in table:
        rows.append((s.scene, s.channel, s.method, s.raw, s.rmse, s.stated, f"{100 * s.coverage:.1f} %"))
    for trial in trials.values():
        rows += [
            (trial.scene, "", method, None, None, None, f"refused: {why}") for method, why in trial.refused.items()
        ]
    return Table(
        (
            "scene",
            "channel",
            "method",
            "reading, rms error",
            "corrected, rms error",
            "stated uncertainty",
            "95 % interval holds",
        ),
        rows,
        "Root-mean-square errors against the truth, in K and %RH. "
        + "; ".join(f"{name}: {words}" for name, words in METHOD_WORDS.items())
        + ".",
    )


def _scene(trial: Trial, folder: Path) -> Section:
    time = trial.flown.truth["time_s"].to_numpy()
    temperature = trial.flown.truth["temperature_c"].to_numpy()
    centre = {
        "convective": 0.5 * time[-1],
        "frontal": time[np.argmax(np.abs(np.gradient(temperature)))],
        "inversion": time[-1] / 2,
    }
    half = {"convective": 30.0, "frontal": 20.0, "inversion": 30.0}[trial.scene]
    window = (centre[trial.scene] - half, centre[trial.scene] + half)
    path = save_figure(signals_figure(trial, window), folder, f"signals_{trial.scene}")
    return Section(
        TITLES[trial.scene],
        (
            Figure(
                path,
                "Above: the air, the reading behind it, and the three corrections. "
                "Below: errors, with the smoother's own 95 % band.",
                f"time series of {TITLES[trial.scene]}",
            ),
        ),
    )


def _turbulence(trial: Trial, folder: Path) -> Section:
    rows = []
    for channel, (column, _) in CHANNELS.items():
        series = {"air (truth)": trial.flown.truth[column].to_numpy(), "reading": trial.flown.log[column].to_numpy()}
        series |= {m: getattr(trial.corrected[m], column) for m in METHODS if m in trial.corrected}
        top = SLOPES_UP_TO_HZ[channel]
        for label, values in series.items():
            lag, structure = structure_function(values, PERIOD_S)
            rows.append(
                (
                    channel,
                    label,
                    f"0.02 to {top:g}",
                    slope(*power_spectrum(values, PERIOD_S, 120.0), 0.02, top),
                    f"{0.5 / top:g} to 20",
                    slope(lag, structure, 0.5 / top, 20.0),
                )
            )
    spectra = save_figure(spectra_figure(trial), folder, "spectra")
    structures = save_figure(structures_figure(trial), folder, "structure_functions")
    return Section(
        "Turbulence: −5/3 and 2/3",
        (
            Figure(
                spectra,
                "Power spectra. The lag steepens the reading's; its noise is the flat end. "
                "A correction follows the air's up to where the noise hides it.",
                "power spectra",
            ),
            Figure(structures, "Second-order structure functions.", "structure functions"),
            Table(
                ("channel", "signal", "frequencies, Hz", "spectral slope", "lags, s", "structure slope"),
                rows,
                f"Fitted slopes; turbulence has {SPECTRAL_SLOPE:.3f} and {STRUCTURE_SLOPE:.3f}.",
            ),
        ),
    )


def _systems(trials: Mapping[str, Trial], profile: Profile, folder: Path) -> Section:
    trial = next(iter(trials.values()))
    log = trial.flown.log
    airs = np.array([float(trial.flown.truth["temperature_c"].mean())])
    speed, pressure = (np.array([float(log[name].mean())]) for name in ("airspeed_m_s", "pressure_hpa"))
    stream = Stream(speed, pressure, airs)
    responses: dict[str, LagResponse] = {}
    if profile.temperature is not None:
        responses["temperature"] = bead_response(profile.temperature, stream, profile.bodies["imet"])
    if profile.humidity is not None:
        responses["humidity"] = film_response(profile.humidity, airs, stream, profile.bodies["hyt"])
    diagrams, systems, rows, said = {}, {}, [], []
    for channel, response in responses.items():
        cutoff = trial.corrected["inverse"].cutoff_hz[channel] or 0.5 / PERIOD_S
        diagrams[f"{channel}, cut-off {cutoff:.2g} Hz"] = bode(response, PERIOD_S, cutoff)
        exact = sampled(mean_response(response), PERIOD_S, 0)
        systems[f"{channel}, exact"] = exact
        rows.append((channel, "exact, zero-order hold", len(exact.b), _gain(inverse_noise_gain(exact)), cutoff))
        try:
            printed, layers = paper_layers(channel, mean_response(response), PERIOD_S)
            systems[f"{channel}, paper N = {layers}"] = printed
            rows.append((channel, "paper, explicit step", layers, _gain(inverse_noise_gain(printed)), cutoff))
        except RefusedError as reason:
            said.append(Text(str(reason), "warning"))
    return Section(
        "Sensors and inverses as systems",
        (
            Figure(
                save_figure(bode_figure(diagrams), folder, "bode"),
                "Bode diagrams of sensor and inverse.",
                "Bode diagrams",
            ),
            Figure(
                save_figure(pole_zero_figure(systems), folder, "poles_zeros"),
                "Poles (×) and zeros (○) of the sampled sensors: "
                "a zero outside the circle makes the causal inverse unstable.",
                "poles and zeros",
            ),
            Table(
                ("channel", "sampled model", "states", "noise gain of the bare inverse", "cut-off, Hz"),
                rows,
                "A bead read at its core has zeros outside the circle; there the exact inverse runs both ways in time.",
            ),
            *said,
        ),
    )


def _gain(value: float) -> float | str:
    return value if np.isfinite(value) else "no stable causal inverse"


Array = NDArray[np.float64]
COLOURS = {"smoother": BLUE, "inverse": GREEN, "paper": RED}
LABELS = {"temperature": "Temperature, °C", "humidity": "Relative humidity, %"}
UNITS = {"temperature": "K²/Hz", "humidity": "%RH²/Hz"}


@styled
def signals_figure(trial: Trial, window_s: tuple[float, float] | None = None) -> Drawing:
    """Truth, reading and every correction against time, and the corrections' errors with the smoother's 95 % band."""
    from matplotlib.figure import Figure as Drawing

    figure = Drawing(figsize=(9.2, 5.4))
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
def spectra_figure(trial: Trial) -> Drawing:
    """Power spectra of truth, reading and corrections with the -5/3 line."""
    from matplotlib.figure import Figure as Drawing

    figure = Drawing(figsize=(9.2, 3.9))
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
def structures_figure(trial: Trial) -> Drawing:
    """Second-order structure functions with the 2/3 line."""
    from matplotlib.figure import Figure as Drawing

    figure = Drawing(figsize=(9.2, 3.9))
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
def bode_figure(diagrams: dict[str, Bode]) -> Drawing:
    """Gain and phase of each sensor, its sampled form, the inverse, and the inverse behind its low-pass."""
    from matplotlib.figure import Figure as Drawing

    figure = Drawing(figsize=(9.2, 5.2))
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
def pole_zero_figure(systems: dict[str, StateSpace]) -> Drawing:
    """Poles and zeros of sampled sensors on the unit circle: an inverse is stable where all zeros lie inside."""
    from matplotlib.figure import Figure as Drawing

    figure = Drawing(figsize=(9.2, 2.9))
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
