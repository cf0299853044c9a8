"""The least squares problem of one channel: whitened data, and what is known of how its runs scatter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.channel import Channel, run_indices
from shockrig.analysis.inference.quantity import RunEffect
from shockrig.analysis.inference.rate_scatter import RATE_SCATTER, RATE_SCATTER_LIMIT, UNVENTILATED_LIMIT

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """Data of one channel, whitened, with what is known of each run's scatter.

    Attributes
    ----------
    channel : Channel
    whitener : ndarray (R, n, n)
    scatter : ndarray (R, U)
        Standard deviations of the runs' random effects, columns as in `RunEffect`.
    """

    channel: Channel
    whitener: Array
    scatter: Array

    def select(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> Problem:
        """With only the runs `keep` (mask or indices)."""
        index = run_indices(keep)
        return Problem(self.channel.select(index), self.whitener[index], self.scatter[index])

    @property
    def stated(self) -> NDArray[np.bool_]:
        """Random effects (R, U) whose size was stated: nobody can be off from what nobody recorded."""
        c = self.channel.conditions
        known = np.ones(self.scatter.shape, dtype=bool)
        known[:, RunEffect.START] = c.start_known
        known[:, RunEffect.SOURCE] = known[:, RunEffect.DESTINATION] = c.airs_known
        return known

    @property
    def rate_scatter(self) -> float:
        """Scatter of ln rate from run to run."""
        return float(self.scatter[0, RunEffect.RATE])

    @property
    def rate_scatter_limit(self) -> float:
        """The largest scatter of ln rate from run to run that is none of the model's faults."""
        return RATE_SCATTER_LIMIT if self.channel.conditions.airflow_known.all() else UNVENTILATED_LIMIT

    def with_rate_scatter(self, rate_scatter: float) -> Problem:
        """With another scatter of ln rate."""
        scatter = self.scatter.copy()
        scatter[:, RunEffect.RATE] = rate_scatter
        return replace(self, scatter=scatter)

    def whiten(self, values: Array) -> Array:
        """Whitened values (R, n) or columns (R, n, C)."""
        if values.ndim == 2:
            return np.asarray(np.matmul(self.whitener, values[..., None])[..., 0])
        return np.asarray(np.matmul(self.whitener, values))


def make_problem(
    channel: Channel, whitener: Array, rate_scatter: float = RATE_SCATTER, rounding: float = 0.0
) -> Problem:
    """Problem with the stated scatter of triggers and airs; `rounding` adds that of plateaus rounded to a coarse
    step."""
    c, quantity = channel.conditions, channel.quantity
    extra = rounding / np.sqrt(12.0)
    source, destination = quantity.air_scatters(c)
    scatter = np.empty((channel.runs, quantity.run_effects))
    scatter[:, RunEffect.START] = c.start_scatter_s
    scatter[:, RunEffect.RATE] = rate_scatter
    scatter[:, RunEffect.SOURCE] = np.hypot(source, extra)
    scatter[:, RunEffect.DESTINATION] = np.hypot(destination, extra)
    if quantity.run_effects > RunEffect.DESTINATION_C:
        # An isothermal run has one temperature; what matters is the difference between the two airs.
        scatter[:, RunEffect.DESTINATION_C] = np.hypot(c.source_c_scatter, c.destination_c_scatter)
    return Problem(channel, whitener, scatter)
