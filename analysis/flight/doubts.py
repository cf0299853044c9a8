"""What in a flight's log looks like a slip of whoever wrote or mapped it, each with what would mend it."""

from __future__ import annotations

import numpy as np

from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.files.flight import Flight

LONGEST_FLIGHT_S = 86400.0
SLOWEST_PERIOD_S = 10.0
HOTTEST_C = 45.0  # of the air, for half of a flight
LEAST_HPA = 110.0  # of a whole log, where half of it is above freezing: 16 km up, where air is far colder


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
