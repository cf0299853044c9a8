"""What the runs of a channel were: airs, airflow, start and transfer of each, with how well each is known."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Conditions:
    """What each run was: arrays of shape (R,), SI or degC as named; `*_scatter` are one sigma of what is known.

    `duration_s` is NaN where the transfer was not timed. Where all runs state it, `ramp_ratio` is each run's in units
    of the typical one. `ramp_own_s` is the duration of those that alone state one, or state a far longer one (slowed on
    purpose), and NaN elsewhere: the plain model has these ramps.
    `elsewhere` marks runs that respond so much faster or slower than the rest that they end in another medium.
    `order` is each run's place in the campaign, from 0; `hours` is when it began, NaN where nobody wrote that down.
    """

    source_c: Array
    destination_c: Array
    source_percent: Array
    destination_percent: Array
    airflow_m_s: Array
    pressure_hpa: Array
    start_s: Array
    start_scatter_s: Array
    source_c_scatter: Array
    destination_c_scatter: Array
    source_percent_scatter: Array
    destination_percent_scatter: Array
    airflow_known: NDArray[np.bool_]
    start_known: NDArray[np.bool_]
    airs_known: NDArray[np.bool_]
    irradiance_w_m2: Array
    duration_s: Array
    ramp_ratio: Array
    ramp_own_s: Array
    elsewhere: NDArray[np.bool_]
    order: Array
    hours: Array

    def select(self, index: NDArray[np.int64]) -> Conditions:
        """The same for the runs `index` alone."""
        return Conditions(**{field.name: getattr(self, field.name)[index] for field in fields(self)})

    @property
    def thermal_step_k(self) -> Array:
        """Change of the air's temperature in each run (R,) [K]."""
        return self.destination_c - self.source_c
