"""The paper's layered state-space sensors as printed and corrected, sampled and inverted, and what its slips cost."""

from shockrig.analysis.physics.schemes.layers import (
    FILM_SCHEMES,
    SPHERE_SCHEMES,
    StateSpace,
    film_layers,
    sphere_layers,
    step_response,
)
from shockrig.analysis.physics.schemes.sampling import (
    METHODS,
    delay_samples,
    inverse_noise_gain,
    is_minimum_phase,
    poles,
    sample,
    stable_period_s,
    zeros,
)
from shockrig.analysis.physics.schemes.slips import Slip, SlipRow, slips_table

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
