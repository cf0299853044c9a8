"""The track of a flight: how fast it climbs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.physics.standard_atmosphere import pressure_altitude_m
from shockrig.files.flight import Flight

Array = NDArray[np.float64]

CLIMB_SMOOTHED_S = 5.0  # over which the track's vertical speed is taken


def coarse_track(time_s: Array, values: Array) -> tuple[Array, Array]:
    """Means over a few seconds, so that a track's own noise is no way that was flown."""
    number = np.floor((time_s - time_s[0]) / CLIMB_SMOOTHED_S).astype(int)
    count = np.bincount(number)
    filled = count > 0
    return (
        np.bincount(number, weights=time_s)[filled] / count[filled],
        np.bincount(number, weights=values)[filled] / count[filled],
    )


def vertical_speed(time_s: Array, altitude_m: Array) -> tuple[Array, Array]:
    """Times and the vertical speed [m/s] there, of a track whose times run forward."""
    at, metres = coarse_track(time_s, altitude_m)
    return at, np.gradient(metres, at) if at.size > 1 else np.zeros_like(at)


def climb_m_s(flight: Flight) -> Array | None:
    """Vertical speed (n,) of a flight's rows, by its altitude or else its pressure; None where it has neither."""
    for altitude in (flight.altitude_m, pressure_altitude_m(flight.pressure_hpa)):
        known = None if altitude is None else np.isfinite(altitude) & np.isfinite(flight.time_s)
        if altitude is not None and known is not None and np.count_nonzero(known) > 1:
            return np.interp(flight.time_s, *vertical_speed(flight.time_s[known], altitude[known]))
    return None
