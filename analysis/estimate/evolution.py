"""Global search for the rates: differential evolution on the RMSE of Eq. (17), and another optimiser as cross-check.

RMSE = sqrt(mean over samples of (reading - model)^2) (Segales et al. 2022, doi 10.5194/amt-15-2607-2022). A generation
of candidates is one array operation over all runs of an ambient; start times and airs are taken as recorded, and where
nobody triggered, each run takes the start that suits the candidate best.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, differential_evolution

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.model import PLAIN, Model, Point, Structure
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.estimate.scan import RATE_BOUNDS_PER_S, USUAL_SCATTER_S
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.modes import response_times

Array = NDArray[np.float64]

POPULATION = 15
GENERATIONS = 60
LATE_S = np.arange(-0.8, 0.8001, 0.04)  # starts that are tried where none is recorded


@dataclass(frozen=True)
class Optimum:
    """Where one optimiser ended for one ambient: ln rate [1/s], RMSE [channel's unit], evaluations of a candidate."""

    log_rate: float
    rmse: float
    evaluations: int


class Misfit:
    """RMSE over the samples of one ambient's runs, for many candidate rates at once.

    `parameters` are an extended model's effect parameters by "effect.parameter"; they stay as they are.
    """

    def __init__(self, channel: Channel, structure: Structure = PLAIN, parameters: dict[str, float] | None = None):
        self.channel, self.model = channel, Model(channel, structure)
        self._template = self.model.start(np.zeros(channel.rates), parameters)
        known = channel.conditions.start_known
        scatter = channel.conditions.start_scatter_s[~known].max(initial=0.0)
        self._late_s = np.zeros(1) if known.all() else LATE_S * scatter / USUAL_SCATTER_S
        self._fixed = np.where(known, int(np.argmin(np.abs(self._late_s))), -1)
        self._within, self._samples = _scatter_within_bins(channel)

    def _squares(self, log_rates: Array) -> Array:
        """Sum of squares (S, K, R) for ln rates (S,) and the starts tried (K,)."""
        tried, runs = self._late_s.size, self.channel.runs
        theta = np.tile(self._template, (len(log_rates) * tried, 1))
        theta[:, self.model.rates] = np.repeat(np.asarray(log_rates), tried)[:, None]
        deviations = np.zeros((tried, *self.channel.at_rest().shape))
        deviations[..., RunEffect.START] = self._late_s[:, None]
        deviations = deviations if tried == 1 else np.tile(deviations, (len(log_rates), 1, 1))
        off = self.channel.value - self.model.predict(Point(theta, deviations))
        return np.einsum("brn,brn,rn->br", off, off, self.channel.count).reshape(-1, tried, runs)

    def __call__(self, log_rates: Array) -> Array:
        """RMSE (S,) for ln rates (S,) that all the channel's runs share."""
        squares = self._squares(log_rates)
        if self._late_s.size > 1:
            recorded = np.take_along_axis(squares, np.maximum(self._fixed, 0)[None, None, :], axis=1)[:, 0]
            total = np.where(self._fixed < 0, squares.min(axis=1), recorded).sum(axis=-1)
        else:
            total = squares[:, 0].sum(axis=-1)
        return np.sqrt((total + self._within) / self._samples)

    def late_s(self, log_rate: float) -> Array:
        """How much later than estimated each run starts [s] (R,), at this rate; zero where the start is recorded."""
        best = np.argmin(self._squares(np.array([log_rate]))[0], axis=0)
        return np.where(self._fixed < 0, self._late_s[best], 0.0)


def _scatter_within_bins(channel: Channel) -> tuple[float, int]:
    """Sum of squares of the samples about the trend through their bins' means, and the number of samples in bins."""
    total, number = 0.0, 0
    for run, ((time, value), place) in enumerate(zip(channel.samples, channel.bin_of, strict=True)):
        used, filled = place >= 0, channel.count[run] > 0
        trend = np.interp(time[used], channel.time_s[run, filled], channel.value[run, filled])
        trend_of_bin = np.bincount(place[used], trend, channel.count.shape[1]) / np.maximum(channel.count[run], 1)
        about = value[used] - channel.value[run, place[used]] - (trend - trend_of_bin[place[used]])
        total += float((about**2).sum())
        number += int(used.sum())
    return total, number


def evolve(misfit: Misfit, rng: np.random.Generator) -> Optimum:
    """Best rate by differential evolution (scipy), each population evaluated as one array."""
    low, high = (float(bound) for bound in np.log(RATE_BOUNDS_PER_S))

    def population(x: Array) -> Any:  # scipy's annotations know of one candidate at a time only
        return misfit(x[0])

    result = differential_evolution(
        population,
        Bounds([low], [high]),
        popsize=POPULATION,
        maxiter=GENERATIONS,
        tol=1e-4,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=rng,
    )
    return Optimum(float(result.x[0]), float(result.fun), POPULATION * (int(result.nit) + 1))


def cross_check(misfit: Misfit) -> Optimum:
    """Best rate by nlopt's SBPLX, started from when the readings are half-way: it shares nothing with `evolve`."""
    import nlopt  # type: ignore[import-untyped]

    low, high = np.log(RATE_BOUNDS_PER_S)
    optimiser = nlopt.opt(nlopt.LN_SBPLX, 1)
    optimiser.set_lower_bounds([low])
    optimiser.set_upper_bounds([high])
    optimiser.set_initial_step(0.3)
    optimiser.set_xtol_abs(1e-6)
    optimiser.set_maxeval(300)
    optimiser.set_min_objective(lambda x, _: float(misfit(x)[0]))
    best = optimiser.optimize([float(np.clip(half_way(misfit.channel), low + 1e-6, high - 1e-6))])
    return Optimum(float(best[0]), float(optimiser.last_optimum_value()), int(optimiser.get_numevals()))


def half_way(channel: Channel) -> float:
    """ln rate [1/s] from the time to half of the way between first and last reading: the median over the runs."""
    times = []
    for run, (time, value, count) in enumerate(zip(channel.time_s, channel.value, channel.count, strict=True)):
        after = (count > 0) & (time > 0)
        before = (count > 0) & (time < 0)
        if channel.air[run] is not None or not before.any():
            times.append(float(np.ptp(time)) / 30.0)  # driven all along: only the order of magnitude is known
            continue
        level, end = np.mean(value[before]), np.mean(value[after][-3:])
        beyond = np.abs(value[after] - level) > 0.5 * abs(end - level)
        times.append(float(time[after][np.argmax(beyond)]))
    return float(np.log(response_times(BODIES[channel.body].held(), (0.5,))[0] / max(np.median(times), 1e-3)))
