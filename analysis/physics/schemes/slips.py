"""What the paper's equations, taken as printed, cost: every number measured here and now, beside the series.

Layered grids (Eqs. 5-7, 11-13), their stepping and their inverses. What the plain model leaves out, whatever its
numerics, is in limits.py. Source of what is examined: doi 10.5194/amt-15-2607-2022.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from shockrig.analysis.physics.modes import Modes, film_mean, response_times, sphere_core
from shockrig.analysis.physics.schemes import limits
from shockrig.analysis.physics.schemes.layers import StateSpace, film_layers, sphere_layers, step_response
from shockrig.analysis.physics.schemes.measured import Slip, SlipRow
from shockrig.analysis.physics.schemes.sampling import delay_samples, inverse_noise_gain, sample, stable_period_s, zeros

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
        limits.response_time_names(),
        limits.transfer_as_step(),
        limits.start_at_sample(),
        limits.one_alpha(),
        limits.mean_temperature(),
        limits.air_temperature_ppmv(),
        limits.saturation_formula(),
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
