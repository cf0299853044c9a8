"""What the air did while one sensor was not read, told by the other.

Vapour went with the temperature as it does in the rest of the flight, the temperature as the film felt it at once. In
plumes and across gusts the two go together, and a film that is stuck, or in a gap, leaves the temperature as the only
witness. How many units of vapour go with a kelvin is what the film's readings say of it, lagged as the film lags, in
each tenth of the flight by itself: one front does not speak for all of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from shockrig.analysis.estimate.without_model import MAD_TO_SIGMA
from shockrig.analysis.flight.flight_channel import LONGEST_FILL_S, FlightReadings
from shockrig.analysis.flight.smooth_channel import Estimate, typical_period
from shockrig.analysis.flight.stretches import WINDOW_ROWS, Felt
from shockrig.analysis.flight.sweep import as_lagged

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SLOPE_BLOCKS = 10  # of the flight, each with a slope of its own
APART_S = 3.0  # over which changes of vapour and temperature are compared
FEWEST_BLOCKS = 4  # that tell of it
MOVED_SIGMAS = 2.0  # of what the temperature is unsure by, that it moves at least in a block that tells
SURE_SIGMAS = 2.0
OF_MEDIAN = 1.25  # times the standard error of a mean is that of a median


def where_unread(
    readings: FlightReadings, air_c: Array, sigma_k: Array, found: Estimate, solve: Callable[[FlightReadings], Estimate]
) -> tuple[FlightReadings, Estimate]:
    """The estimate, in rows that lie far from any reading with the vapour that goes with the temperature `air_c` (n,)
    of the air, which is unsure by `sigma_k` (n,); and the readings with what is told there."""
    rows = far(readings)
    if not rows.any():
        return readings, found
    lagged = as_lagged(air_c, readings.response, typical_period(readings.time_s))
    slope, error = goes_with(readings, lagged, float(np.median(sigma_k)))
    if slope == 0.0:
        return readings, found
    rest = solve(replace(readings, reading=readings.reading - slope * lagged))
    # of the temperature's moves since the last reading, as much as the slope is unsure by
    known = np.flatnonzero(~rows)
    moved = air_c - np.interp(np.arange(rows.size), known, air_c[known])
    clean = rest.clean + slope * lagged
    return replace(readings, told=np.where(rows, clean, np.nan)), replace(
        found,
        air=np.where(rows, rest.air + slope * air_c, found.air),
        clean=np.where(rows, clean, found.clean),
        variance=np.where(rows, rest.variance + (error * moved) ** 2, found.variance),
    )


def where_felt(
    readings: FlightReadings, felt: Felt | None, found: Estimate, solve: Callable[[FlightReadings], Estimate]
) -> Estimate:
    """The estimate, in stretches far from any reading, or any but noise, along what another sensor `felt` of the same
    air there, if that explains the readings better.

    What the air did from one end of a stretch to the other is b times what was felt, beside what it does anyhow
    (`found`, with the variance of air that did not jump unseen). Before that is looked at b is about 1 to either side,
    as of a film whose vapour stays.
    """
    rows = far(readings if readings.loud is None else replace(readings, usable=readings.usable & ~readings.loud))
    known = np.zeros(0) if felt is None else np.flatnonzero(np.isfinite(felt.reading))
    if felt is None or known.size < WINDOW_ROWS or not rows.any() or np.isnan(found.cost):
        return found
    calm = median_filter(felt.reading[known], WINDOW_ROWS, mode="nearest")
    seen = np.interp(np.arange(rows.size), known, calm)
    along, unsure, chance = np.zeros(rows.size), np.zeros(rows.size), 0.0
    rows[: np.argmin(rows)] = rows[rows.size - np.argmin(rows[::-1]) :] = False  # of these one end is known
    for first, behind in np.flatnonzero(np.diff(rows, prepend=False, append=False)).reshape(-1, 2).tolist():
        went, air = seen[first - 1 : behind + 1] - seen[first - 1], found.air[behind] - found.air[first - 1]
        anyhow = float(np.max(found.steady[first:behind]))
        total = went[-1] ** 2 + anyhow
        share = air * went[-1] / total
        along[first:behind] += share * went[1:-1]
        along[behind:] += share * went[-1]
        # of what was felt a part is the vapour's, which comes later
        open_to = anyhow / total + (share * (1.0 - share)) ** 2 / 3.0
        unsure[first:behind] = open_to * (went - np.linspace(0.0, went[-1], went.size))[1:-1] ** 2
        chance += 0.5 * (share**2 + np.log(total / anyhow))
    if not along.any():
        return found
    lagged = as_lagged(along, readings.response, typical_period(readings.time_s))
    rest = solve(replace(readings, reading=readings.reading - lagged))
    if rest.cost + chance > found.cost:
        return found
    return replace(
        found,
        air=np.where(rows, rest.air + along, found.air),
        clean=np.where(rows, rest.clean + lagged, found.clean),
        variance=np.where(rows, rest.variance + unsure, found.variance),
    )


def far(readings: FlightReadings) -> Mask:
    """Rows (n,) that lie in a stretch without a reading which is longer than values are filled in over."""
    time_s, known = readings.time_s, np.flatnonzero(readings.usable)
    if known.size < 2:
        return np.zeros(time_s.shape, dtype=bool)
    after = np.clip(np.searchsorted(known, np.arange(time_s.size)), 1, known.size - 1)
    lasting = time_s[known[after]] - time_s[known[after - 1]]
    return np.asarray(~readings.usable & (lasting > LONGEST_FILL_S))


def goes_with(readings: FlightReadings, lagged: Array, sigma_k: float) -> tuple[float, float]:
    """Slope of the readings against the temperature as the film lags behind it (n,), which is unsure by `sigma_k`, and
    its standard error; the less of it the more chance explains it."""
    time_s, period = readings.time_s, typical_period(readings.time_s)
    lag = max(int(round(APART_S / period)), 1)
    known = readings.usable[lag:] & readings.usable[:-lag] & (time_s[lag:] - time_s[:-lag] < 2.0 * lag * period)
    y, x = ((values[lag:] - values[:-lag])[known] for values in (readings.reading, lagged))
    block = (np.arange(known.size) * SLOPE_BLOCKS // known.size)[known]
    along, square, count = (np.bincount(block, values, SLOPE_BLOCKS) for values in (x * y, x * x, np.ones(x.size)))
    moved = np.sqrt(square / np.maximum(count, 1.0))
    some = (count > 0) & (moved > MOVED_SIGMAS * sigma_k)
    if np.count_nonzero(some) < FEWEST_BLOCKS:
        return 0.0, 0.0
    each = along[some] / square[some]
    slope = float(np.median(each))
    error = OF_MEDIAN * MAD_TO_SIGMA * float(np.median(np.abs(each - slope))) / np.sqrt(each.size)
    kept = max(1.0 - (SURE_SIGMAS * error / slope) ** 2, 0.0) if slope else 0.0
    return kept * slope, error
