"""The paper's layered state-space sensors as printed and corrected, sampled and inverted, and what its slips cost."""

from shockrig.analysis.physics.schemes.slips import Slip, SlipRow, slips_table
from shockrig.analysis.physics.schemes.state_space import (
    FILM_SCHEMES,
    METHODS,
    SPHERE_SCHEMES,
    StateSpace,
    delay_samples,
    film_layers,
    inverse_noise_gain,
    is_minimum_phase,
    poles,
    sample,
    sphere_layers,
    stable_period_s,
    step_response,
    zeros,
)

__all__ = [
    "FILM_SCHEMES",
    "METHODS",
    "SPHERE_SCHEMES",
    "Slip",
    "SlipRow",
    "StateSpace",
    "delay_samples",
    "film_layers",
    "inverse_noise_gain",
    "is_minimum_phase",
    "poles",
    "sample",
    "slips_table",
    "sphere_layers",
    "stable_period_s",
    "step_response",
    "zeros",
]
