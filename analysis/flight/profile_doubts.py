"""What in a profile cannot be, or contradicts itself, said before a flight is corrected with it.

Three questions: does a sensor with these rates take the times that the profile states; does D rise with temperature as
sorption does (an activation energy within its range); does a row of the table stand out from those beside it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.response import LagResponse, bead_response, film_response
from shockrig.analysis.physics.exchange import REFERENCE_AIRFLOW_M_S, REFERENCE_C, Stream
from shockrig.files.profile import HumidityProfile, Profile, ResponseTime
from shockrig.files.ranges import LIKELY

Array = NDArray[np.float64]
GAS_CONSTANT = 8.314462618  # J/(mol K)
DOUBT_SIGMAS = 3.0
TIME_RATIO = 2.0  # that a stated time to 63 % may differ from the model's: at what airspeed it holds is not stated
STANDS_OUT = np.log(
    2.0
)  # of a row from the straight line of its neighbours, in ln D over 1/T; IST's film bends by 1.65


def profile_doubts(profile: Profile) -> list[str]:
    """A sentence for each; empty where all may be right."""
    found = []
    bodies = profile.bodies
    if (part := profile.temperature) is not None:
        response = bead_response(part, _stream(REFERENCE_C), bodies["imet"])
        found += _time_doubts("temperature", "alpha", response, part.response_time_s)
    if (film := profile.humidity) is not None:
        for row in film.diffusivity_table:
            at_c = row.ambient_temperature_c
            response = film_response(film, np.array([at_c]), _stream(at_c), bodies["hyt"])
            found += _time_doubts("humidity", f"D at {at_c:g} degC", response, row.response_time_s)
        found += _table_doubts(film)
    remedy = "; look at the profile before anything that is corrected with it is used"
    return [f"profile: {one}{remedy if one is found[-1] else ''}" for one in found]


def _stream(at_c: float) -> Stream:
    return Stream(np.array([REFERENCE_AIRFLOW_M_S]), temperature_c=np.array([at_c]))


def _time_doubts(channel: str, of: str, response: LagResponse, stated: ResponseTime | None) -> list[str]:
    modes = response.modes()
    since = np.geomspace(1e-3, 1e2, 2000) * float(-np.sum(modes.amplitude / modes.rate))
    shown = 1.0 + np.exp(-np.outer(since, modes.rate)) @ modes.amplitude
    t63_s = float(since[np.argmax(shown >= 1.0 - np.exp(-1.0))])
    possible = LIKELY["response_s"]
    if not possible.holds(t63_s):
        return [f"{channel}: {of} makes a sensor with 63 % in {t63_s:.2g} s; expected {possible} s"]
    if stated is not None and abs(np.log(t63_s / stated.t63_s)) > np.log(TIME_RATIO):
        return [f"{channel}: {of} means 63 % in {t63_s:.2g} s, and {stated.t63_s:.2g} s is stated beside it"]
    return []


def _table_doubts(film: HumidityProfile) -> list[str]:
    rows = film.diffusivity_table
    at_c = np.array([row.ambient_temperature_c for row in rows])
    x = 1.0 / (at_c + 273.15)
    ln_d = np.log([row.diffusivity_m2_s for row in rows])
    sigma = np.array([row.standard_uncertainty / row.diffusivity_m2_s for row in rows])
    found = []
    for k in range(1, len(rows) - 1):
        share = (x[k] - x[k - 1]) / (x[k + 1] - x[k - 1])
        off = float(ln_d[k] - (1 - share) * ln_d[k - 1] - share * ln_d[k + 1])
        if abs(off) > STANDS_OUT + DOUBT_SIGMAS * sigma[k - 1 : k + 2].max():
            found.append(
                f"humidity: D at {at_c[k]:g} degC is {np.exp(abs(off)):.2g} times {'more' if off > 0 else 'less'} than "
                "the rows beside it let expect"
            )
    possible = LIKELY["activation_j_mol"]
    energy = -GAS_CONSTANT * np.diff(ln_d) / np.diff(x)
    unsure = DOUBT_SIGMAS * GAS_CONSTANT * np.hypot(sigma[1:], sigma[:-1]) / np.abs(np.diff(x))
    wrong = (energy + unsure < possible.low) | (energy - unsure > possible.high)
    if wrong.any() and not found:
        k = int(np.argmax(wrong))
        how = "falls" if energy[k] < 0 else "rises"
        found.append(
            f"humidity: D {how} from {at_c[k]:g} to {at_c[k + 1]:g} degC by {np.exp(abs(ln_d[k + 1] - ln_d[k])):.2g} "
            f"times, an activation energy of {energy[k] / 1e3:.0f} kJ/mol; expected {possible.low / 1e3:g} to "
            f"{possible.high / 1e3:g}: is the table reversed, or a row of it wrong?"
        )
    return found
