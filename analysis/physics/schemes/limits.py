"""What the plain model leaves out, whatever its numerics: the ramp in the step, the air film, D along a flight, ppmv.

Each function measures one limit and returns it as a Slip. Sources: Segales et al. (2022), doi 10.5194/amt-15-2607-2022;
Ranz and Marshall (1952); Murphy and Koop (2005), doi 10.1256/qj.04.94.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from shockrig.analysis.physics.exchange import Stream, ventilation
from shockrig.analysis.physics.humidity import saturation_pressure_hpa
from shockrig.analysis.physics.modes import Modes, film_mean, first_order, response_times, sphere_core, sphere_core_biot
from shockrig.analysis.physics.schemes.measured import Slip, SlipRow

# A glass bead of 0.8 mm in air at 20 degC and 1013 hPa (round handbook values)
BEAD_RADIUS_M = 4e-4
GLASS_HEAT_CAPACITY_J_M3_K = 2.0e6
GLASS_CONDUCTIVITY_W_M_K = 1.1
AIR_CONDUCTIVITY_W_M_K = 0.0257

# IST's capacitive sensor, temperature [degC] -> t63 [s]: measured steps, published by its maker
FILM_T63_S = {25.0: 0.6, 5.0: 5.2, -10.0: 11.0}


def response_time_names() -> Slip:
    """t63 and t98 are not one number apart."""
    rows = tuple(
        SlipRow(name, printed=ratio(first_order(1.0)), exact=ratio(modes))
        for name, modes in (("sphere, core", sphere_core()), ("film, mean", film_mean()))
    )
    return Slip(
        "response_time_names",
        "Which response time",
        "data sheets quote t63, the paper t98; between them stands the shape of the response, not first order's 3.912",
        "state which; compare t63 with t63",
        "t98 / t63 (printed: first order)",
        rows,
        relative=True,
    )


def ratio(modes: Modes) -> float:
    """t98 / t63 of a response."""
    t63, _, t98 = response_times(modes)
    return t98 / t63


def transfer_as_step(share: float = 0.1) -> Slip:
    """A transfer that takes `share` of t98, fitted as a step at its start."""
    rows = []
    for name, modes in (("sphere", sphere_core()), ("film", film_mean())):
        duration = share * response_times(modes)[2]

        def ramp(t: np.ndarray, modes: Modes = modes, duration: float = duration) -> np.ndarray:
            return modes.ramp(t, duration)

        rows.append(SlipRow(f"{name}, start fixed", printed=refit(modes, ramp, free_start=False), exact=1.0))
        rows.append(SlipRow(f"{name}, start free", corrected=refit(modes, ramp, free_start=True), exact=1.0))
    return Slip(
        "transfer_as_step",
        "A transfer is not a step",
        f"the shock is a step, and a transfer of {share:g} t98 is fitted as one at its start",
        "fit the transfer's own time, or leave the start free within what the trigger and the plateaus allow",
        "fitted / true time constant",
        tuple(rows),
        relative=True,
        reference="true",
    )


def start_at_sample(t98_s: float = 1.0) -> Slip:
    """A start put at the nearest of 10 Hz samples."""
    modes = sphere_core().scaled(response_times(sphere_core())[2] / t98_s)
    rows = [
        SlipRow(
            f"true start {1e3 * late:+.0f} ms from the sample",
            printed=refit(modes, _late(modes, late), free_start=False),
            exact=1.0,
        )
        for late in (-0.05, -0.025, 0.025, 0.05)
    ]
    return Slip(
        "start_at_sample",
        "A start between samples",
        "the step is put at the nearest 10 Hz sample",
        "the model is evaluated at the instant itself",
        f"fitted / true time constant of a bead with t98 = {t98_s:g} s",
        tuple(rows),
        relative=True,
        reference="true",
    )


def _late(modes: Modes, late_s: float) -> Callable[[np.ndarray], np.ndarray]:
    """The response of `modes` to a step that comes `late_s` after zero."""
    return lambda time_s: modes.step(time_s - late_s)


def refit(modes: Modes, response: Callable[[np.ndarray], np.ndarray], free_start: bool) -> float:
    """Fitted over true time constant: a step of `modes` fitted to another `response` (10 t98, dense samples)."""
    t98 = response_times(modes)[2]
    time = np.arange(-t98, 10 * t98, t98 / 200)
    reading = response(time)

    def residual(p: np.ndarray) -> np.ndarray:
        start = p[1] * t98 if free_start else 0.0
        return modes.step((time - start) * np.exp(-p[0])) - reading

    from scipy.optimize import least_squares

    fit = least_squares(residual, [0.0, 0.03] if free_start else [0.0], xtol=1e-10, diff_step=np.array(1e-4))
    return float(np.exp(fit.x[0]))


def biot_number(airflow_m_s: float) -> float:
    """h R / k of the glass bead in a stream of air."""
    exchange = (
        AIR_CONDUCTIVITY_W_M_K * float(ventilation(Stream(np.array(airflow_m_s)), BEAD_RADIUS_M)) / (2 * BEAD_RADIUS_M)
    )
    return exchange * BEAD_RADIUS_M / GLASS_CONDUCTIVITY_W_M_K


def one_alpha() -> Slip:
    """The lag of a glass bead is its air film's."""
    alpha = GLASS_CONDUCTIVITY_W_M_K / GLASS_HEAT_CAPACITY_J_M3_K
    rows = [SlipRow(f"Biot number at {v:g} m/s", printed=float("inf"), exact=biot_number(v)) for v in (2.0, 5.0, 12.0)]
    # the printed model puts the whole lag into the glass
    glass = BEAD_RADIUS_M**2 / (10 * alpha)
    for v in (5.0, 0.0):
        lag = BEAD_RADIUS_M**2 / (3 * alpha * biot_number(v))
        rows.append(SlipRow(f"lag of the air film at {v:g} m/s, s (printed: the glass's)", printed=glass, exact=lag))
    misfit = 100 * sphere_misfit(biot_number(5.0))
    rows.append(SlipRow("rms misfit of the ideal sphere at 5 m/s, % of the step", printed=misfit, exact=0.0))
    return Slip(
        "one_alpha",
        "One alpha for all conditions",
        "the bead's surface has the air's temperature, so that one alpha of the glass says it all",
        "a film of air around the bead (Biot number): the fitted alpha is an effective number that moves with "
        "airflow and density",
        "as said in each row",
        tuple(rows),
        reference="with air film",
    )


def sphere_misfit(biot: float) -> float:
    """Residual of the best ideal sphere against a bead behind a film, rms over two t98 as a share of the step."""
    film = sphere_core_biot(biot)
    t98 = response_times(film)[2]
    time = np.linspace(0.0, 2 * t98, 400)[1:]
    reading = film.step(time)
    start = response_times(sphere_core())[0] / response_times(film)[0]

    def residual(p: np.ndarray) -> np.ndarray:
        return sphere_core().scaled(np.exp(p[0])).step(time) - reading

    from scipy.optimize import least_squares

    fit = least_squares(residual, [np.log(start)])
    return float(np.sqrt(np.mean(fit.fun**2)))


def mean_temperature() -> Slip:
    """D at the mean temperature of a flight."""
    inverse_k = np.array([1.0 / (t + 273.15) for t in FILM_T63_S])
    log_t63 = np.log(list(FILM_T63_S.values()))
    slopes = np.diff(log_t63) / np.diff(inverse_k)

    def t63(temperature_c: float) -> float:
        return float(np.exp(np.interp(1.0 / (temperature_c + 273.15), inverse_k, log_t63)))

    warm, middle, cold = FILM_T63_S
    used = t63(0.5 * (warm + cold))
    return Slip(
        "mean_temperature",
        "D from the mean temperature of a flight",
        "one D, that of the flight's mean temperature",
        "ln D interpolated in 1/T and followed along the flight, never extrapolated silently",
        "t63 of the film, s, unless said; two activation energies: not Arrhenius",
        (
            SlipRow(f"flight from {warm:g} to {cold:g} degC, at the warm end", printed=used, exact=t63(warm)),
            SlipRow(f"flight from {warm:g} to {cold:g} degC, at the cold end", printed=used, exact=t63(cold)),
            SlipRow(f"activation energy / gas constant, {warm:g} to {middle:g} degC, K", exact=float(slopes[0])),
            SlipRow(f"activation energy / gas constant, {middle:g} to {cold:g} degC, K", exact=float(slopes[1])),
        ),
        reference="measured",
    )


def air_temperature_ppmv() -> Slip:
    """The film answers to activity at its own temperature."""
    air_c, humidity = 20.0, 50.0
    rows = tuple(
        SlipRow(
            f"die {lag:g} K colder than the air",
            printed=humidity,
            exact=float(humidity * saturation_pressure_hpa(air_c) / saturation_pressure_hpa(air_c - lag)),
        )
        for lag in (1.0, 5.0, 10.0)
    )
    return Slip(
        "air_temperature_ppmv",
        "ppmv with the air's temperature",
        "RH and ppmv are converted with the temperature of the air",
        "sorption follows activity at the film's own temperature: isothermal shocks measure D(T), thermal "
        "ones the die's lag",
        f"%RH at the film in air of {air_c:g} degC and {humidity:g} %RH",
        rows,
        reference="at the die",
    )


def murphy_koop_hpa(temperature_k: np.ndarray) -> np.ndarray:
    """Saturation pressure over liquid water, 123 to 332 K [hPa] (Murphy and Koop 2005, Eq. 10)."""
    t = np.asarray(temperature_k, dtype=float)
    log_pa = (
        54.842763 - 6763.22 / t - 4.210 * np.log(t) + 0.000367 * t
        + np.tanh(0.0415 * (t - 218.8)) * (53.878 - 1331.22 / t - 9.44523 * np.log(t) + 0.014025 * t)
    )  # fmt: skip
    return np.exp(log_pa) / 100.0


def saturation_formula() -> Slip:
    """How far the paper's saturation formula may be trusted."""

    def error_percent(temperature_c: np.ndarray) -> np.ndarray:
        return 100 * (saturation_pressure_hpa(temperature_c) / murphy_koop_hpa(np.asarray(temperature_c) + 273.15) - 1)

    span = np.linspace(-45.0, 50.0, 1901)
    largest = float(np.max(np.abs(error_percent(span))))
    from scipy.optimize import brentq

    limit = brentq(lambda t: abs(float(error_percent(np.array([t]))[0])) - 0.5, -60.0, -45.0)
    return Slip(
        "saturation_formula",
        "The saturation formula",
        "McRae's polynomial, quoted as good to 0.5 %",
        "nothing to fix above the temperature below; colder than that, another formula",
        "as said in each row",
        (
            SlipRow("largest deviation from Murphy-Koop, -45 to 50 degC, %", printed=largest, exact=0.0),
            SlipRow("beyond 0.5 % below, degC", printed=float(limit)),
        ),
    )
