"""A typical pair of sensors for demonstrations: bead with t98 = 1 s, film with t98 = 15 s at 20 degC, plain model.

The bead's t98 is the order that its makers state in moving air; the film's diffusivity follows an Arrhenius law of 25
kJ/mol.
"""

from __future__ import annotations

import math

from shockrig.analysis.physics.modes import film_mean, response_times, sphere_core
from shockrig.files.profile import (
    DiffusivityRow,
    HumidityProfile,
    Profile,
    ResponseTime,
    TemperatureProfile,
    Uncertain,
)
from shockrig.files.profile_data import BEAD_RADIUS_M, FILM_THICKNESS_M, NOISE_K, NOISE_PERCENT

AMBIENTS_C = (-10.0, 0.0, 10.0, 20.0, 30.0, 40.0)
ACTIVATION_K = 3000.0
RELATIVE_UNCERTAINTY = 0.01  # of D, and so of the times of a plain film
BEAD_RELATIVE_UNCERTAINTY = 0.005


def typical_profile(bead_t98_s: float = 1.0, film_t98_s: float = 15.0) -> Profile:
    """Profile of such a pair; `film_t98_s` holds at 20 degC."""
    alpha = response_times(sphere_core())[2] / bead_t98_s * BEAD_RADIUS_M**2
    film = response_times(film_mean())
    at_20 = film[2] / film_t98_s * FILM_THICKNESS_M**2
    rows = []
    for ambient_c in AMBIENTS_C:
        diffusivity = at_20 * math.exp(-ACTIVATION_K * (1 / (ambient_c + 273.15) - 1 / 293.15))
        t63, t90, t98 = (t * FILM_THICKNESS_M**2 / diffusivity for t in film)
        times = _times((t63, t90, t98), RELATIVE_UNCERTAINTY)
        rows.append(DiffusivityRow(ambient_c, diffusivity, RELATIVE_UNCERTAINTY * diffusivity, None, times))
    t63, t90, t98 = (t * BEAD_RADIUS_M**2 / alpha for t in response_times(sphere_core()))
    bead = _times((t63, t90, t98), BEAD_RELATIVE_UNCERTAINTY)
    return Profile(
        TemperatureProfile(
            Uncertain(alpha, BEAD_RELATIVE_UNCERTAINTY * alpha),
            response_time_s=bead,
            noise_k=NOISE_K,
            sampling_period_s=0.1,
        ),
        HumidityProfile(tuple(rows), noise_percent=NOISE_PERCENT, sampling_period_s=0.1),
        provenance={"kind": "typical values for demonstrations, not measured"},
    )


def _times(seconds: tuple[float, float, float], relative: float) -> ResponseTime:
    """Times of a plain body, which go with the inverse of its rate and are as uncertain."""
    t63, t90, t98 = (relative * one for one in seconds)
    return ResponseTime(*seconds, (t63, t90, t98))
