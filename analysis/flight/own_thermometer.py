"""The hygrometer's own thermometer, slow as it is: it follows the air, and tells whose moves were the air's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.channel import FlightChannel, bridged
from shockrig.analysis.flight.comparisons import DIE_S, late_die
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.flight.smoother import followed
from shockrig.analysis.physics.humidity import saturation_pressure_hpa
from shockrig.files.flight import Flight

Array = NDArray[np.float64]
SHORTEST_S, LONGEST_S = 0.1, 120.0  # of a lag
SETTLED_LAGS, SETTLED_SHARE = 3.0, 0.3  # that the first rows are left out for: of the lag, and of the flight at most


@dataclass(frozen=True)
class Following:
    """One first-order lag behind the air, and the rms that it leaves beside a constant [K]."""

    lag_s: float
    left_k: float


def following(flight: Flight, air_c: Array) -> Following | None:
    """How the hygrometer's own thermometer follows an air (n,) without gaps; None where it was not logged."""
    die = bridged(flight.time_s, flight.die_temperature_c)
    if die is None or np.ptp(die) == 0.0:
        return None
    from scipy.optimize import minimize_scalar

    period = typical_period(flight.time_s)

    def left(log_s: float) -> float:
        lagged = followed(air_c - air_c[0], float(np.exp(-period / np.exp(log_s))), 0.0)
        off = die - lagged
        lasting = min(SETTLED_LAGS * np.exp(log_s), SETTLED_SHARE * np.ptp(flight.time_s))
        return float(np.std(off[flight.time_s - flight.time_s[0] > lasting]))

    best = minimize_scalar(left, bounds=(np.log(SHORTEST_S), np.log(LONGEST_S)), method="bounded")
    return Following(float(np.exp(best.x)), float(best.fun))


def slow_against_fast(flight: Flight, bead: FlightChannel, notes: list[str]) -> None:
    """The humidity sensor's own thermometer is slow: the corrected air, lagged, should be what it read."""
    air = bridged(flight.time_s, bead.value)
    if air is None or bead.raw.all() or (found := following(flight, air)) is None:
        return
    notes.append(
        f"temperature: the humidity sensor's own thermometer follows the corrected air {found.lag_s:.2g} s behind, "
        f"to within {found.left_k:.2g} K rms beside a constant"
    )


def seen_by_film(
    flight: Flight, bead: FlightChannel, film: FlightChannel, notes: list[str]
) -> tuple[FlightChannel, FlightChannel]:
    """Both channels, as unsure as the temperature moved without the humidity.

    Either the thermometer moved by itself, or the air did and the hygrometer's own temperature is late: what it then
    says of the air is off by as much. Its own thermometer tells which, where it was logged.
    """
    alone, air = film.temperature_alone, bridged(flight.time_s, bead.value)
    if alone is None or air is None or not alone.any():
        return bead, film
    moved = np.flatnonzero(np.diff(alone))
    first, last = flight.time_s[moved[[0, -1]]]
    # it was right before the first of these moves, or is behind the last: nothing tells which
    off = np.maximum(np.abs(alone), np.abs(alone - alone[-1]))
    said = (
        f"temperature: between {first:.10g} and {last:.10g} s it moves by up to {off.max():.2g} K without the "
        "humidity, which follows the air's at once: "
    )
    with_them, without = following(flight, air), following(flight, air - alone)
    # what the humidity is off by if the air did move
    keep = float(np.exp(-typical_period(flight.time_s) / DIE_S))
    late = followed(np.diff(alone, prepend=0.0), keep, 0.0) / (1.0 - keep)
    of_film = film.value * np.abs(np.log(saturation_pressure_hpa(air) / saturation_pressure_hpa(air - late)))
    if with_them is None or without is None:
        said += (
            f"sun, ice or a wake was at the thermometer, or the hygrometer's own temperature is late ({late_die()}); "
            "a log with the temperature of its own would tell"
        )
        bead, film = bead.doubted(off), film.doubted(of_film)
    elif with_them.left_k < without.left_k:
        said += (
            f"the hygrometer's own thermometer follows {with_them.lag_s:.2g} s later, so its temperature is late and "
            f"not the air's ({late_die()})"
        )
        film = film.doubted(of_film)
    else:
        said += "the sun, ice or a wake was at the thermometer, since the hygrometer's own does not follow them either"
        bead = bead.doubted(off)
    notes.append(f"{said}; humidity is corrected without these moves, and uncertainties are widened by them")
    return bead, film
