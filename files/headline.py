"""What a profile is said to know, in a line each: of a lumped sensor its time constant, of others their diffusivity.

tau = R^2 / alpha = L^2 / D of one first-order lag: the lengths of a lumped sensor are nobody's measurement, tau is.
"""

from __future__ import annotations

from shockrig.files.numbers import measured
from shockrig.files.profile_data import DiffusivityRow, ProfileData, ResponseTime

LUMPED = "lumped"
SAME_TIME = 1e-2  # relative, within which a time to 63 % is tau again
NEAREST_C = 20.0  # of a film's table the row that a headline shows


def time_text(times: ResponseTime, place: int) -> str:
    """The time to 63, 90 or 98 % (`place` 0, 1, 2) with its standard uncertainty where that is known."""
    seconds = (times.t63_s, times.t90_s, times.t98_s)[place]
    spread = times.standard_uncertainties_s
    return measured(seconds, None if spread is None else spread[place], "s")


def first_order(length_m: float, rate_m2_s: float, standard_uncertainty: float) -> tuple[float, float]:
    """Time constant [s] of a lumped sensor and its standard uncertainty, from the rate that its profile states."""
    tau_s = length_m**2 / rate_m2_s
    return tau_s, tau_s * standard_uncertainty / rate_m2_s


def tau_text(length_m: float, rate_m2_s: float, standard_uncertainty: float) -> str:
    """The time constant as text."""
    return measured(*first_order(length_m, rate_m2_s, standard_uncertainty), "s")


def headlines(profile: ProfileData) -> list[tuple[str, str]]:
    """Name and value of what is known of each sensor, the most telling first."""
    said: list[tuple[str, str]] = []
    bodies = profile.bodies
    if (t := profile.temperature) is not None:
        alpha = t.thermal_diffusivity_m2_s
        if bodies["imet"] == LUMPED:
            tau = tau_text(t.bead_radius_m, alpha.value, alpha.standard_uncertainty)
            said.append(("tau of the thermometer", tau))
        else:
            said.append(("alpha of the bead", measured(alpha.value, alpha.standard_uncertainty, "m²/s")))
        rate = first_order(t.bead_radius_m, alpha.value, 0.0)[0] if bodies["imet"] == LUMPED else None
        if t.response_time_s is not None and is_more(t.response_time_s, rate):
            said.append(("time to 63 % of the thermometer", time_text(t.response_time_s, 0)))
    if (h := profile.humidity) is not None:
        row = min(h.diffusivity_table, key=lambda one: abs(one.ambient_temperature_c - NEAREST_C))
        said += _film(row, h.film_thickness_m, bodies["hyt"] == LUMPED)
    return said


def is_more(times: ResponseTime, tau_s: float | None) -> bool:
    """Whether a time to 63 % says more than the time constant does: of a lumped sensor without effects they are one."""
    return tau_s is None or abs(times.t63_s / tau_s - 1.0) > SAME_TIME


def _film(row: DiffusivityRow, length_m: float, lumped: bool) -> list[tuple[str, str]]:
    where = f"at {round(row.ambient_temperature_c)} °C"
    if lumped:
        said = [(f"tau of the hygrometer {where}", tau_text(length_m, row.diffusivity_m2_s, row.standard_uncertainty))]
    else:
        said = [(f"D of the film {where}", measured(row.diffusivity_m2_s, row.standard_uncertainty, "m²/s"))]
    tau_s = first_order(length_m, row.diffusivity_m2_s, 0.0)[0] if lumped else None
    if row.response_time_s is not None and is_more(row.response_time_s, tau_s):
        said.append((f"time to 63 % of the hygrometer {where}", time_text(row.response_time_s, 0)))
    return said
