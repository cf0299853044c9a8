"""The page of `shockrig demo-flights`: three scenes, three corrections side by side, the spectra to judge them by."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from shockrig.analysis.flight.correct import METHODS
from shockrig.analysis.flight.inverse import RefusedError, mean_response, paper_layers, sampled
from shockrig.analysis.flight.judging import (
    SPECTRAL_SLOPE,
    STRUCTURE_SLOPE,
    bode,
    power_spectrum,
    slope,
    structure_function,
)
from shockrig.analysis.flight.response import LagResponse, bead_response, film_response
from shockrig.analysis.flight.simulated.scenes import CHANNELS, SceneScore, Trial, scores
from shockrig.analysis.physics.exchange import Stream
from shockrig.analysis.physics.schemes.sampling import inverse_noise_gain
from shockrig.analysis.report import flight_figures as figures
from shockrig.analysis.report.html import Figure, HtmlPage, KeyNumber, Section, Table, Text
from shockrig.analysis.report.style import save_figure
from shockrig.files.profile import Profile

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
    path = save_figure(figures.signals(trial, window), folder, f"signals_{trial.scene}")
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
    spectra = save_figure(figures.spectra(trial), folder, "spectra")
    structures = save_figure(figures.structures(trial), folder, "structure_functions")
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
                save_figure(figures.bode_figure(diagrams), folder, "bode"),
                "Bode diagrams of sensor and inverse.",
                "Bode diagrams",
            ),
            Figure(
                save_figure(figures.pole_zero(systems), folder, "poles_zeros"),
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
