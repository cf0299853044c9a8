"""Sampled forms of a layered sensor, their poles and zeros, and what their inverses do to noise.

x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k]. The inverse turns zeros into poles, so a zero outside the unit circle
makes it unstable; sampling creates such zeros (Astrom, Hagander and Sternby 1984, doi 10.1016/0005-1098(84)90062-1).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from shockrig.analysis.physics.schemes.layers import StateSpace

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
