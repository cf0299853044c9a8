"""Readings that leap away and back, as no sensor can that is as slow as its steps show: broken frames of a bus."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shockrig.rig.logs.changes import noise_of, spike_size, without_spikes

Array = NDArray[np.float64]

LEAST_LEFT = 0.5  # one reading later: where less is, an air that went as far to the other side takes it back
MISSING_SHARE = 0.5  # of what must be left of an excursion one reading later is not there


def leaps(time_s: Array, value: Array, t63_s: float, least: float) -> NDArray[np.bool_]:
    """Which readings (n,) are no response of a sensor that takes `t63_s` to 63 % of a step.

    Whatever the air did, a lag that came so far has to come back: of an excursion exp(-t/t63) is left after t, where
    the air was at once what it had been. A sensor that is faster than its readings may leap.

    Parameters
    ----------
    time_s, value : array (n,)
        Readings in order of time; NaN where there is none.
    t63_s : float
        The least that any step of the log shows.
    least : float
        The smallest step that counts, in the quantity's unit.
    """
    found = np.zeros(value.size, dtype=bool)
    there = np.flatnonzero(np.isfinite(value))
    moments, values = time_s[there], value[there]
    noise = noise_of(values)
    odd = ~np.isin(moments, without_spikes(moments, values, noise, least)[0])
    for k in np.flatnonzero(odd):
        before, after = (_beside(values, odd, int(k), way) for way in (-1, 1))
        if not 0 <= before <= after < values.size:
            continue
        last = after - 1  # of two that leapt together both go, or none
        share = np.exp((moments[last] - moments[after]) / t63_s)
        must, is_left = share * abs(values[last] - values[before]), abs(values[after] - values[before])
        found[there[k]] = (
            share > LEAST_LEFT and must > spike_size(noise, least) and is_left < (1.0 - MISSING_SHARE) * must
        )
    return found


def _beside(values: Array, odd: NDArray[np.bool_], place: int, way: int) -> int:
    """The reading before (`way` -1) or after (1) an odd one, or before or after both of two that leapt together."""
    k = place + way
    farther = k + way
    if (
        0 <= farther < values.size
        and odd[k]
        and 2.0 * abs(values[k] - values[place]) < abs(values[k] - values[farther])
    ):
        return farther
    return k
