"""A sensor's lags as a sampled system: exact for air that is held over each period, with its transfer function."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.response import LagResponse
from shockrig.analysis.flight.stepping import held_matrix
from shockrig.analysis.physics.modes import response_times
from shockrig.analysis.physics.schemes.layers import StateSpace

Array = NDArray[np.float64]
T63 = 0.63212055882855767
WELL_CONDITIONED = 1e8  # eigenvectors beyond that are not trusted: two lags in series may have equal rates


def response_time_s(response: LagResponse, share: float = T63, row: int = 0) -> float:
    """Time to `share` of a step at one instant of the flight."""
    return response_times(response.modes(row), (share,))[0]


def mean_response(response: LagResponse) -> LagResponse:
    """One response for a whole flight: weights and logs of the rates averaged."""
    return replace(
        response,
        weight=response.weight.mean(axis=0, keepdims=True),
        rate=np.exp(np.log(response.rate).mean(axis=0, keepdims=True)),
        relative_uncertainty=response.relative_uncertainty.mean(keepdims=True),
    )


def sampled(response: LagResponse, period_s: float, row: int) -> StateSpace:
    """Exact zero-order hold of the response at one row, in lags."""
    a = held_matrix(response.rate[row], period_s, response.cap, response.inside)
    # at rest in unit air every lag stands at one
    return StateSpace(a, 1.0 - a.sum(axis=1), response.weight[row], 0.0, period_s)


def transfer_function(system: StateSpace, frequency: Array) -> NDArray[np.complex128]:
    """Transfer function of a sampled system at frequencies in cycles per sample."""
    z = np.exp(2j * np.pi * np.asarray(frequency))
    poles, vectors = np.linalg.eig(system.a)
    if np.linalg.cond(vectors) > WELL_CONDITIONED:
        away = z[..., None, None] * np.eye(len(system.b)) - system.a
        return np.asarray(system.d + np.linalg.solve(away, system.b[:, None].astype(complex))[..., 0] @ system.c)
    weight = (system.c @ vectors) * np.linalg.solve(vectors, system.b.astype(complex))
    return np.asarray(system.d + np.sum(weight / (z[..., None] - poles), axis=-1))
