"""What the paper's equations, taken as printed, cost: every number measured here and now, beside the series.

Layered grids (Eqs. 5-7, 11-13), their stepping and their inverses, and what the plain model leaves out whatever its
numerics. Source of what is examined: doi 10.5194/amt-15-2607-2022.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from shockrig.analysis.physics.air_exchange import Stream, ventilation
from shockrig.analysis.physics.humidity import saturation_pressure_hpa
from shockrig.analysis.physics.modes import Modes, film_mean, first_order, response_times, sphere_core, sphere_core_biot
from shockrig.analysis.physics.schemes.state_space import (
    StateSpace,
    delay_samples,
    film_layers,
    inverse_noise_gain,
    sample,
    sphere_layers,
    stable_period_s,
    step_response,
    zeros,
)

# What a slip or limit of the paper is: measured cases beside the series.


@dataclass(frozen=True)
class SlipRow:
    """One measured case. None where a column does not apply; `exact` is the series, or what the right way gives."""

    case: str
    printed: float | int | None = None
    corrected: float | int | None = None
    high_order: float | None = None
    exact: float | None = None


@dataclass(frozen=True)
class Slip:
    """One slip or limit of the paper: what is taken as printed or by habit, the fix, the quantity, the measured rows.

    `relative` says that the columns are to be read as errors relative to `exact`, which `reference` names.
    """

    id: str
    title: str
    printed: str  # what is taken, as printed or by habit
    fix: str
    quantity: str
    rows: tuple[SlipRow, ...]
    relative: bool = False
    reference: str = "series"


# What the plain model leaves out, whatever its numerics: the ramp in the step, the air film, D along a flight, ppmv.
#
# Each function measures one limit and returns it as a Slip. Sources: Segales et al. (2022), doi
# 10.5194/amt-15-2607-2022; Ranz and Marshall (1952); Murphy and Koop (2005), doi 10.1256/qj.04.94.

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


pass


PERIOD_S = 0.1
COLUMNS = ("printed", "corrected", "collocation")
SHARE_63 = 1.0 - np.exp(-1.0)


def slips_table() -> tuple[Slip, ...]:
    """Every slip and limit of the paper, measured now (about two seconds)."""
    return (
        sphere_grid(),
        sphere_centre(),
        film_grid(),
        fitted_diffusivity(),
        explicit_step(),
        core_zeros(),
        other_zeros(),
        skewed_output(),
        noise_gain(),
        response_time_names(),
        transfer_as_step(),
        start_at_sample(),
        one_alpha(),
        mean_temperature(),
        air_temperature_ppmv(),
        saturation_formula(),
    )


def share_time(system: StateSpace, share: float = SHARE_63) -> float:
    """Time at which the step response reaches `share`, to 1e-10."""
    slowest = 1.0 / np.min(np.abs(np.linalg.eigvals(system.a)))

    def lack(time: float) -> float:
        return float(step_response(system, np.array([time]))[0]) - share

    from scipy.optimize import brentq

    return brentq(lack, 1e-6 * slowest, 20 * slowest, xtol=1e-12)


def sphere_grid(layers: tuple[int, ...] = (3, 5, 10, 20, 50)) -> Slip:
    """Eqs. (5)-(7): coefficients of one grid, nodes of another."""
    return Slip(
        "sphere_grid",
        "Grid of the sphere, Eqs. (5)-(7)",
        "the coefficients (i+1)/i and (i-1)/i belong to r = i dr, yet node 1 is said to sit at r = 0",
        "j = r/dr in the coefficients and 6 beta at the centre",
        "t63 of the core, alpha t / R^2",
        _t63_rows(sphere_layers, "printed", layers, sphere_core()),
        relative=True,
    )


def sphere_centre(layers: tuple[int, ...] = (3, 5, 10)) -> Slip:
    """The right grid with the printed factor at the centre."""
    return Slip(
        "sphere_centre",
        "Factor at the centre of the sphere, Eq. (5)",
        "3 beta at the centre, even with the coefficients corrected",
        "6 beta: the temperature is mirrored about the centre, 3 T_rr = 6 (T2 - T1) / dr^2",
        "t63 of the core, alpha t / R^2",
        _t63_rows(sphere_layers, "centre_3_beta", layers, sphere_core()),
        relative=True,
    )


def film_grid(layers: tuple[int, ...] = (5, 10, 20)) -> Slip:
    """Eqs. (11)-(13): a film that is half a cell too thick."""
    return Slip(
        "film_grid",
        "Grid of the film, Eqs. (11)-(13)",
        "a full cell between the last node and the surface: every time constant is too long by ((2N+1)/2N)^2",
        "half a cell: last row -3, +1 and input 2 (and lambda is D / dx^2)",
        "t63 of the mean, D t / L^2",
        _t63_rows(film_layers, "printed", layers, film_mean()),
        relative=True,
    )


def fitted_diffusivity(layers: tuple[int, ...] = (8, 64)) -> Slip:
    """What each scheme makes of readings whose diffusivity is known."""
    rows = []
    sensors = (("alpha", sphere_layers, sphere_core(), 1.0), ("D", film_layers, film_mean(), 20.0))
    for name, build, modes, t98_s in sensors:
        for count in layers:
            printed, corrected, collocation = (fitted_ratio(build(scheme, count), modes, t98_s) for scheme in COLUMNS)
            rows.append(SlipRow(f"{name}, N = {count}, t98 = {t98_s:g} s", printed, corrected, collocation, exact=1.0))
    return Slip(
        "fitted_diffusivity",
        "A diffusivity that depends on the number of layers",
        "alpha and D are fitted with the printed grids",
        "a scheme whose error is gone at 8 layers (collocation on Legendre points), or the series itself",
        "fitted / true, from 10 Hz readings of one step without noise",
        tuple(rows),
        relative=True,
    )


def fitted_ratio(system: StateSpace, modes: Modes, t98_s: float) -> float:
    """Fitted over true diffusivity where `system` (per unit of D/L^2) meets 10 Hz readings made from `modes`.

    Least squares over six t98, the start known exactly.
    """
    rate = response_times(modes)[2] / t98_s
    time_s = np.arange(0.037, 6 * t98_s, PERIOD_S)
    reading = modes.scaled(rate).step(time_s)

    def residual(p: np.ndarray) -> np.ndarray:
        return step_response(system, np.exp(p[0]) * rate * time_s) - reading

    from scipy.optimize import least_squares

    fit = least_squares(residual, [0.0], xtol=1e-12)
    return float(np.exp(fit.x[0]))


def explicit_step(layers: tuple[int, ...] = (3, 5, 10)) -> Slip:
    """Largest explicit Euler step."""
    rows = [
        SlipRow(
            f"N = {n}",
            stable_period_s(sphere_layers("printed", n)) * n**2,
            stable_period_s(sphere_layers("corrected", n)) * n**2,
        )
        for n in layers
    ]
    rate = response_times(sphere_core())[2] / 1.0
    allowed = [
        max(n for n in range(2, 64) if stable_period_s(sphere_layers(scheme, n, rate)) >= PERIOD_S)
        for scheme in ("printed", "corrected")
    ]
    rows.append(SlipRow("layers allowed at 0.1 s, t98 = 1 s", *allowed))
    return Slip(
        "explicit_step",
        "Stability of the explicit step",
        "phi < 0.5, which is the limit of the interior nodes",
        "phi <= 1/3 with 6 beta; an exact discretisation (matrix exponential or modes) has no limit",
        "largest stable phi = alpha dt / dr^2 of the sphere",
        tuple(rows),
    )


def core_zeros(layers: tuple[int, ...] = (2, 3, 5, 10)) -> Slip:
    """Zeros that sampling creates in the sphere read at its core."""
    rate = response_times(sphere_core())[2] / 1.0
    rows = tuple(
        SlipRow(f"N = {n}", *(_outermost(sphere_layers(s, n, rate), "zero_order_hold") for s in COLUMNS))
        for n in layers
    )
    return Slip(
        "core_zeros",
        "Zeros of the sampled core",
        "the number of layers is chosen so that the inverse is stable",
        "it is the zeros that sampling creates: from N = 3 on one lies outside the unit circle, in "
        "the exact sphere too, so the inverse needs a delay or a smoother",
        "outermost zero under zero-order hold at 0.1 s, t98 = 1 s",
        rows,
    )


def other_zeros(layers: int = 5) -> Slip:
    """Zeros by discretisation, and the film's."""
    sphere_rate = response_times(sphere_core())[2] / 1.0
    film_rate = response_times(film_mean())[2] / 4.0
    spheres = [sphere_layers(s, layers, sphere_rate) for s in COLUMNS]
    films = [film_layers(s, layers, film_rate) for s in COLUMNS]
    rows = (
        SlipRow("core, explicit step: delay in samples (no zeros)", *(_explicit_delay(s) for s in spheres[:2])),
        SlipRow("core, trapezoidal: mean of the zeros", *(_mean_zero(s, "trapezoidal") for s in spheres[:2])),
        SlipRow("core, backward Euler: outermost zero", *(_magnitude(s, "backward_euler") for s in spheres)),
        SlipRow("film mean, zero-order hold: outermost zero", *(_magnitude(s, "zero_order_hold") for s in films)),
        SlipRow("film mean, backward Euler: outermost zero", *(_magnitude(s, "backward_euler") for s in films)),
    )
    return Slip(
        "other_zeros",
        "Zeros of the other sampled forms",
        "a form is inverted whatever its discretisation",
        "the film's mean under zero-order hold and every backward-Euler form can be inverted; the explicit step is "
        "a pure delay of N samples, the trapezoidal rule puts zeros at -1",
        f"N = {layers} at 0.1 s; sphere t98 = 1 s, film t98 = 4 s (size of the zero unless said)",
        rows,
    )


def skewed_output(exponents: tuple[float, ...] = (0.0, 1.0, 1.5, 2.0, 3.0), layers: int = 10) -> Slip:
    """The paper's cure: C skewed towards the core."""
    rate = response_times(sphere_core())[2] / 1.0
    rows = tuple(
        SlipRow(
            f"p = {p:g}", *(_magnitude(sphere_layers(s, layers, rate, skew=p), "zero_order_hold") for s in COLUMNS[:2])
        )
        for p in exponents
    )
    return Slip(
        "skewed_output",
        "C skewed towards the core",
        "a C skewed towards the core makes the inverse stable",
        "only when mild: weights (N - i + 1)^p with p <= 1, which is nearly the mean and no longer the core",
        f"size of the outermost zero, N = {layers}, zero-order hold at 0.1 s, t98 = 1 s",
        rows,
    )


def noise_gain(layers: tuple[int, ...] = (5, 10, 40)) -> Slip:
    """Noise through the inverse of the film."""
    rows = []
    for t98_s in (4.0, 18.7):
        rate = response_times(film_mean())[2] / t98_s
        for n in layers:
            gains = [inverse_noise_gain(sample(film_layers(s, n, rate), PERIOD_S)) for s in COLUMNS]
            rows.append(SlipRow(f"t98 = {t98_s:g} s, N = {n}", *gains))
    return Slip(
        "noise_gain",
        "Noise through the inverse of the film",
        "a stable inverse is applied as it is",
        "count what it does to noise, and with a scheme that has converged: coarse grids overstate it",
        "factor on white noise, zero-order hold at 0.1 s",
        tuple(rows),
    )


def _t63_rows(
    build: Callable[[str, int], StateSpace], slipped: str, layers: tuple[int, ...], modes: Modes
) -> tuple[SlipRow, ...]:
    exact = response_times(modes)[0]
    rows = []
    for n in layers:
        printed, corrected, collocation = (
            share_time(build(scheme, n)) for scheme in (slipped, "corrected", "collocation")
        )
        rows.append(SlipRow(f"N = {n}", printed, corrected, collocation, exact=exact))
    return tuple(rows)


def _outermost(system: StateSpace, method: str) -> float:
    """The real zero of largest magnitude, with its sign."""
    found = zeros(sample(system, PERIOD_S, method))
    return float(found[np.argmax(np.abs(found))].real)


def _magnitude(system: StateSpace, method: str) -> float:
    return float(np.max(np.abs(zeros(sample(system, PERIOD_S, method)))))


def _mean_zero(system: StateSpace, method: str) -> float:
    # N zeros in one place scatter by rounding; their mean does not
    return float(np.mean(zeros(sample(system, PERIOD_S, method))).real)


def _explicit_delay(system: StateSpace) -> int:
    return delay_samples(sample(system, PERIOD_S, "explicit_euler"))
