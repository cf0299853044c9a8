"""What in a flight's log looks like a slip of whoever wrote or mapped it, each with what would help.

`doubts` may be right all the same; after `slips` nothing that a correction could say would hold: readings are given.
"""

from __future__ import annotations

import numpy as np

from shockrig.analysis.flight.screen import resolution_of, stairs
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.flight.stretches import scatter
from shockrig.files.flight import Flight
from shockrig.files.numbers import counted
from shockrig.files.profile import Profile
from shockrig.files.ranges import RANGES

LONGEST_FLIGHT_S = 86400.0
SLOWEST_PERIOD_S = 10.0
FEWEST_READINGS = 100  # readings that a noise is told from
HOTTEST_C = 45.0  # of the air, for half of a flight
# times a sensor's own period on the bench that a log's is, and what its times then are
UNITS = {1 / 60: "minutes", 1 / 3600: "hours", 1 / 86400: "days", 1e3: "milliseconds", 1e6: "microseconds"}
SAME_SPEED, NO_SPEED = 0.2, 0.7  # ln of how far the airspeed may be off where it never changes, and where there is none
CLOSE_PERIOD = 0.05  # relative, that a period is of one of these
FASTEST_S = 0.004  # between rows of a thermometer or a hygrometer
LIKELIER_LN = 1.5  # by so much in ln of the noise, over both columns, where each has the other's noise
HALF_STILL = 0.2  # of a flight's rows, that a reading stands for in one stretch
LEAST_HPA = 110.0  # of a whole log, where half of it is above freezing: 16 km up, where air is far colder


def slips(flight: Flight, profile: Profile) -> list[str]:
    """Sentences on a clock that is not in seconds and on columns that stand in one another's place."""
    found = []
    period = typical_period(flight.time_s)
    stated = [one.sampling_period_s for one in (profile.temperature, profile.humidity) if one is not None]
    usual = min((one for one in stated if one is not None), default=None)
    ratio = next((r for r in UNITS if usual is not None and abs(period / usual / r - 1.0) < CLOSE_PERIOD), None)
    if ratio is not None:
        found.append(
            f"time_s: a row every {period:.3g} s of sensors that the profile reads every {usual:.3g} s: times seem to "
            f"be in {UNITS[ratio]}; convert them to seconds, or read the log by a map with its time_unit"
        )
    elif period < FASTEST_S:
        found.append(f"time_s: a row every {period:.3g} s, faster than such sensors are read; convert times to seconds")
    if _swapped(flight, profile):
        found.append(
            "temperature_c and humidity_percent seem to stand in one another's place; name them with "
            "--column temperature=NAME --column humidity=NAME"
        )
    return found


def _swapped(flight: Flight, profile: Profile) -> bool:
    """Whether the columns' values can only be, or their noises are far more likely to be, the other's."""
    temperature, humidity = (v[np.isfinite(v)] for v in (flight.temperature_c, flight.humidity_percent))
    if min(temperature.size, humidity.size) < FEWEST_READINGS:
        return False
    percent = RANGES["humidity_percent"]
    if not all(percent.holds(v) for v in np.quantile(temperature, (0.02, 0.98)).tolist()):
        return False
    if np.median(temperature) > HOTTEST_C and np.median(humidity) < HOTTEST_C:
        return True
    bead, film = profile.temperature, profile.humidity
    if bead is None or film is None or not bead.noise_k or not film.noise_percent:
        return False
    read = [float(np.log(max(np.median(scatter(v)), 1e-9))) for v in (temperature, humidity)]
    own = [float(np.log(v)) for v in (bead.noise_k, film.noise_percent)]
    straight, crossed = abs(read[0] - own[0]) + abs(read[1] - own[1]), abs(read[0] - own[1]) + abs(read[1] - own[0])
    return straight > crossed + LIKELIER_LN


def doubts(flight: Flight) -> list[str]:
    """Sentences on times that are no seconds, temperatures that are none of air in degC and pressures that are none of
    air in hPa; empty where all may be right."""
    found = []
    lasts, period = float(np.ptp(flight.time_s)), typical_period(flight.time_s)
    if lasts > LONGEST_FLIGHT_S and period > SLOWEST_PERIOD_S:
        found.append(
            f"time_s: the log lasts {lasts / 3600:.3g} h with a row every {period:.3g} s: if these are milliseconds, "
            'divide by 1000, or read the log by a map with time_unit = "ms"'
        )
    for name, values, unit in (
        ("temperature_c", flight.temperature_c, "degC"), ("humidity_percent", flight.humidity_percent, "%RH")
    ):  # fmt: skip
        first, rows = _stands(values)
        known = values[np.isfinite(values)]
        if rows > HALF_STILL * values.size and not stairs(known, resolution_of(known)):
            lasting = float(flight.time_s[first + rows - 1] - flight.time_s[first])
            found.append(
                f"{name}: the reading stands at {values[first]:.6g} {unit} for {lasting:.3g} s of {lasts:.3g} s: the "
                "sensor or the logger was stuck, and what is given there is told from the readings before and after"
            )
    speed = flight.airspeed_m_s[np.isfinite(flight.airspeed_m_s)]
    possible = RANGES["airflow_m_s"]
    if wrong := int(np.count_nonzero((speed < possible.low) | (speed > possible.high))):
        found.append(
            f"airspeed_m_s: {counted(wrong, 'row')} of {speed.size} cannot be (median {np.median(speed):.3g}, expected "
            f"{possible}), and are taken as unknown; is it in cm/s, or does a wind from ahead count as negative?"
        )
    if airspeed_doubt(flight) == SAME_SPEED:
        found.append(
            f"airspeed_m_s: {speed[0]:.4g} m/s in every row: a set point, or a sensor that is stuck; it is taken as "
            f"good to {100 * SAME_SPEED:.0f} %"
        )
    known = flight.temperature_c[np.isfinite(flight.temperature_c)]
    if known.size and (usual := float(np.median(known))) > HOTTEST_C:
        found.append(
            f"temperature_c: half of the readings lie above {usual:.3g} degC, where hardly any air is flown: they may "
            "be in degF or K, or be the humidity: read the log by a map that names its columns and temperature_unit"
        )
    pressure = flight.pressure_hpa[np.isfinite(flight.pressure_hpa)]
    if pressure.size and known.size and pressure.max() < LEAST_HPA and np.median(known) > 0.0:
        found.append(
            f"pressure_hpa: no reading is above {LEAST_HPA:.0f} hPa, as in the stratosphere, where no air is as "
            "warm: it may be in kPa, or above that of the air, or of water: convert it, or leave it out by "
            "renaming its column"
        )
    return found


def airspeed_doubt(flight: Flight) -> float:
    """Ln of how far the airspeed that is taken may be off, one standard uncertainty; 0 where it was measured."""
    possible, speed = RANGES["airflow_m_s"], flight.airspeed_m_s
    flown = speed[(speed >= possible.low) & (speed <= possible.high)]
    if flown.size == 0:
        return NO_SPEED
    return SAME_SPEED if flown.size >= FEWEST_READINGS and np.ptp(flown) == 0.0 else 0.0


def _stands(values: np.ndarray) -> tuple[int, int]:
    """First row and length of the longest stretch over which a reading does not change."""
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size == 0:
        return 0, 0
    new = np.flatnonzero(np.diff(values[rows], prepend=np.inf) != 0)
    lasting = np.diff(np.append(new, rows.size))
    longest = int(np.argmax(lasting))
    return int(rows[new[longest]]), int(lasting[longest])
