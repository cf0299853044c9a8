"""What the noise of a measured air does to the prediction of a sensor that is driven by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.noise import Noise
from shockrig.analysis.inference.problem import Problem
from shockrig.analysis.inference.scan import rough_rates
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.chain import MeasuredAir
from shockrig.analysis.physics.driven import beside_lagging_reference, noise_passed
from shockrig.analysis.physics.modes import Modes, slowest

Array = NDArray[np.float64]
COSINE_MODES = 12


def trace_noise(trace: Array) -> float:
    """White noise of a trace (m,), from its second differences, which straight lines leave at zero."""
    bends = trace[2:] - 2 * trace[1:-1] + trace[:-2]
    return float(1.4826 * np.median(np.abs(bends)) / np.sqrt(6.0)) if bends.size > 5 else 0.0


def with_reference_noise(noise: Noise, problem: Problem) -> Noise:
    """The readings' noise, and beside it what the references' noise makes of a prediction by the plain model.

    Through modes of rate lambda a sample's noise becomes that of a first-order process of about their slowest rate
    (`shockrig.analysis.physics.driven.noise_passed`).
    """
    channel = problem.channel
    rate = float(np.exp(np.median(rough_rates(problem))))
    body = slowest(BODIES[channel.body].held().scaled(rate), COSINE_MODES)
    passed = []
    for air in channel.air:
        if air is not None:
            passed.append(_passed(air, channel.quantity.of_air(air), body))
    decay = float(np.exp(-float(np.min(body.rate)) * channel.sampling_period_s))
    return replace(noise, passed=float(np.median(passed)), passed_memory=min(decay, 0.999))


def _passed(air: MeasuredAir, trace: Array, body: Modes) -> float:
    period = float(np.median(np.diff(air.time_s)))
    modes = beside_lagging_reference(body, air.lag_s) if air.lag_s > 0 else body
    return trace_noise(trace) * float(np.max(noise_passed(modes, period)))
