"""The paper's layered sensors in state space, sampled, with their poles and zeros and what their inverses do to noise.

x' = A x + B u, y = C x + D u, with u the air and y the reading. Sphere (Eqs. 5-7, reading = core) and film (Eqs. 11-13,
reading = mean), each as printed, with the simple fix, and by collocation on Legendre points, whose error is gone at 8
layers. Sampled: x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k]. The inverse turns zeros into poles, so a zero outside
the unit circle makes it unstable; sampling creates such zeros (Astrom, Hagander and Sternby 1984, doi
10.1016/0005-1098(84)90062-1). Source: Segales, Chilson and Salazar-Cerreno (2022), doi 10.5194/amt-15-2607-2022;
collocation: Villadsen and Stewart (1967), doi 10.1016/0009-2509(67)80074-5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import expm

SPHERE_SCHEMES = ("printed", "centre_3_beta", "corrected", "collocation")
FILM_SCHEMES = ("printed", "corrected", "collocation")


@dataclass(frozen=True)
class StateSpace:
    """A linear sensor with one input and one output.

    `a` (n, n), `b` (n,), `c` (n,), `d`; per second if `period_s` is None, else per step of `period_s`.
    """

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: float = 0.0
    period_s: float | None = None


def sphere_layers(scheme: str, layers: int, rate_per_s: float = 1.0, skew: float | None = None) -> StateSpace:
    """Sphere with its surface at the air's temperature, read at its core.

    Parameters
    ----------
    scheme : one of SPHERE_SCHEMES
        "printed": dr = R/N, coefficients (i+1)/i and (i-1)/i of r = i dr while node 1 is the centre, 3 beta there.
        "centre_3_beta": r = (i-1) dr, but still 3 beta at the centre.
        "corrected": r = (i-1) dr and 6 beta: mirrored about the centre, 3 T_rr = 6 (T2 - T1) / dr^2.
        "collocation": the polynomial in r^2 through the points meets the equation at each of them.
    layers : N, at least 2
    rate_per_s : alpha / R^2
    skew : exponent p of the paper's "C skewed towards the core", weights (N - i + 1)^p; None reads the core alone.

    Returns
    -------
    StateSpace
        States are temperatures from the core outwards.
    """
    _check(scheme, SPHERE_SCHEMES, layers, rate_per_s)
    if scheme == "collocation":
        a, b = _collocation(2 * layers - 1, dimensions=3)
    else:
        a, b = _difference_sphere(scheme, layers)
    c = np.zeros(layers)
    c[0] = 1.0
    if skew is not None:
        c = np.arange(layers, 0, -1.0) ** skew
        c /= c.sum()
    return StateSpace(rate_per_s * a, rate_per_s * b, c)


def film_layers(scheme: str, layers: int, rate_per_s: float = 1.0) -> StateSpace:
    """Film sealed on one side, its surface at the air's concentration, read as its mean.

    Parameters
    ----------
    scheme : one of FILM_SCHEMES
        "printed": a full cell between the last node and the surface. "corrected": half a cell, so that the last row is
        -3, +1 and the input 2. "collocation": as for the sphere, the mean by Gauss's rule.
    layers : N, at least 2
    rate_per_s : D / L^2

    Returns
    -------
    StateSpace
        States are concentrations from the sealed side outwards.
    """
    _check(scheme, FILM_SCHEMES, layers, rate_per_s)
    if scheme == "collocation":
        a, b = _collocation(2 * layers, dimensions=1)
        c = np.polynomial.legendre.leggauss(2 * layers)[1][layers:]
        return StateSpace(rate_per_s * a, rate_per_s * b, c)
    a = np.diag(np.full(layers, -2.0)) + np.diag(np.ones(layers - 1), 1) + np.diag(np.ones(layers - 1), -1)
    a[0, 0] = -1.0
    b = np.zeros(layers)
    b[-1] = 1.0
    if scheme == "corrected":
        a[-1, -1] = -3.0
        b[-1] = 2.0
    cells = rate_per_s * layers**2
    return StateSpace(cells * a, cells * b, np.full(layers, 1.0 / layers))


def step_response(system: StateSpace, time_s: np.ndarray) -> np.ndarray:
    """Reading at `time_s` (n,) after the air rose by one at time 0, from rest: exact in time, 0 before the step."""
    time_s = np.asarray(time_s, dtype=float)
    rates, vectors = np.linalg.eig(system.a)
    away = np.linalg.solve(system.a, system.b)
    if np.linalg.cond(vectors) < 1e10:
        weights = (system.c @ vectors) * np.linalg.solve(vectors, away)
        transient = (np.exp(np.multiply.outer(np.maximum(time_s, 0.0), rates)) @ weights).real
    else:  # two rates coincide (3 beta at the centre of three layers), and there is no basis of modes
        transient = np.array([system.c @ expm(system.a * max(t, 0.0)) @ away for t in time_s])
    settled = system.d - system.c @ away
    return np.where(time_s > 0, settled + transient, 0.0)


def _check(scheme: str, schemes: tuple[str, ...], layers: int, rate_per_s: float) -> None:
    if scheme not in schemes:
        raise ValueError(f"scheme {scheme!r} is not one of {', '.join(schemes)}")
    if layers < 2:
        raise ValueError(f"layers is {layers}; a layered scheme needs at least 2")
    if not rate_per_s > 0:
        raise ValueError(f"rate_per_s is {rate_per_s}; diffusivity / length^2 must be positive")


def _difference_sphere(scheme: str, layers: int) -> tuple[np.ndarray, np.ndarray]:
    beta = float(layers**2)
    # place of each node in units of dr, as its coefficients understand it
    j = np.arange(1.0, layers + 1) if scheme == "printed" else np.arange(0.0, layers)
    outwards, inwards = np.ones(layers), np.zeros(layers)
    outwards[1:], inwards[1:] = (j[1:] + 1) / j[1:], (j[1:] - 1) / j[1:]
    a = np.diag(np.full(layers, -2.0)) + np.diag(outwards[:-1], 1) + np.diag(inwards[1:], -1)
    centre = 6.0 if scheme == "corrected" else 3.0
    a[0, :2] = -centre, centre
    b = np.zeros(layers)
    b[-1] = outwards[-1]
    return beta * a, beta * b


def _collocation(points: int, dimensions: int) -> tuple[np.ndarray, np.ndarray]:
    """A and B for alpha / R^2 = 1 on the Legendre points of [-1, 1] and both ends, folded on their symmetry."""
    x = np.concatenate([[-1.0], np.polynomial.legendre.leggauss(points)[0], [1.0]])
    if points % 2:
        x[points // 2 + 1] = 0.0
    gaps = x[:, None] - x[None, :]
    np.fill_diagonal(gaps, 1.0)
    # log of the barycentric weights: their product underflows for many points
    log_weight, sign = -np.log(np.abs(gaps)).sum(axis=1), np.prod(np.sign(gaps), axis=1)
    ratio = np.exp(log_weight[None, :] - log_weight[:, None]) * sign[None, :] * sign[:, None]
    first = ratio / gaps
    np.fill_diagonal(first, 0.0)
    np.fill_diagonal(first, -first.sum(axis=1))
    second = 2 * first * (np.diag(first)[:, None] - 1 / gaps)
    np.fill_diagonal(second, 0.0)
    np.fill_diagonal(second, -second.sum(axis=1))
    operator = second
    if dimensions == 3:
        with np.errstate(divide="ignore", invalid="ignore"):
            curvature = np.where(x[:, None] == 0, second, first / x[:, None])
        operator = second + 2 * curvature
    inner = slice(points // 2 + 1, points + 1)
    outer = operator[inner, points // 2 + 1 :]
    mirrored = operator[inner, : points // 2 + 1][:, ::-1]
    if points % 2:
        outer = outer.copy()
        outer[:, 1:] += mirrored
    else:
        outer = outer + mirrored
    return outer[:, :-1], outer[:, -1]


# name -> scipy's name. "zero_order_hold" is exact for an air that is constant over each step.
METHODS: dict[str, Literal["zoh", "euler", "bilinear", "backward_diff"]] = {
    "zero_order_hold": "zoh",
    "explicit_euler": "euler",
    "trapezoidal": "bilinear",
    "backward_euler": "backward_diff",
}


def sample(system: StateSpace, period_s: float, method: str = "zero_order_hold") -> StateSpace:
    """Discrete form of a continuous system at `period_s`; `method` is one of METHODS."""
    if system.period_s is not None:
        raise ValueError(f"the system is already sampled at {system.period_s} s")
    if method not in METHODS:
        raise ValueError(f"method {method!r} is not one of {', '.join(METHODS)}")
    matrices = (system.a, system.b[:, None], system.c[None, :], np.array([[system.d]]))
    from scipy.signal import cont2discrete  # takes longer to import than all the rest

    a, b, c, d, _ = cont2discrete(matrices, period_s, METHODS[method])
    return StateSpace(a, b[:, 0], c[0], float(d[0, 0]), period_s)


def poles(system: StateSpace) -> np.ndarray:
    """Eigenvalues of A, sorted by real part."""
    return np.sort_complex(np.linalg.eigvals(system.a))


def zeros(system: StateSpace) -> np.ndarray:
    """Finite zeros of the transfer function, sorted by real part: the poles of the inverse, its delay apart."""
    delay, a, _ = _inverse_dynamics(system)
    values = np.linalg.eigvals(a)
    return np.sort_complex(values[np.argsort(np.abs(values))[delay:]])


def delay_samples(system: StateSpace) -> int:
    """Samples from a change of the air to the first change of the reading (the relative degree)."""
    return _inverse_dynamics(system)[0]


def is_minimum_phase(system: StateSpace) -> bool:
    """True if every zero of a sampled system lies inside the unit circle, so that its inverse is stable.

    A zero within rounding of the circle (the trapezoidal rule's at -1) counts as on it.
    """
    return bool(np.all(np.abs(zeros(system)) < 1.0 - 1e-6))


def inverse_noise_gain(system: StateSpace) -> float:
    """Standard deviation of the inverse's output per that of white noise in the reading; infinite if it is unstable."""
    if not is_minimum_phase(system):
        return float("inf")
    delay, power, reaction = _inverse_dynamics(system)
    # u[k] = (y[k + delay] - row x[k]) / reaction, x[k + 1] = A x[k] + B u[k]; the spread of x by doubling the sum of
    # A^k b b' A'^k, which stays well conditioned where a Lyapunov solver does not
    row = system.c @ np.linalg.matrix_power(system.a, delay)
    b = system.b / reaction
    spread = np.outer(b, b)
    for _ in range(40):
        spread = spread + power @ spread @ power.T
        power = power @ power
    return float(np.sqrt(row @ spread @ row + 1.0) / abs(reaction))


def stable_period_s(system: StateSpace) -> float:
    """Longest step of explicit Euler that does not grow: |1 + period * eigenvalue| <= 1 for every eigenvalue."""
    rates = np.linalg.eigvals(system.a)
    return float(np.min(-2.0 * rates.real / np.abs(rates) ** 2))


def _inverse_dynamics(system: StateSpace) -> tuple[int, np.ndarray, float]:
    """Delay, the inverse's A, and the first reaction (Markov parameter) of the reading to the air."""
    if system.d != 0.0:
        return 0, system.a - np.outer(system.b, system.c) / system.d, system.d
    row, scale = system.c, np.abs(system.c)
    for delay in range(1, len(system.b) + 1):
        reaction, possible = row @ system.b, scale @ np.abs(system.b)
        row, scale = row @ system.a, scale @ np.abs(system.a)
        # below rounding of its own sum a reaction counts as none
        if abs(reaction) > 1e-13 * possible:
            return delay, system.a - np.outer(system.b, row) / reaction, float(reaction)
    raise ValueError("the reading does not depend on the air")
