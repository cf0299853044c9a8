"""The problem that a fit solves: runs, start, noise, how far rates scatter from run to run, and what is uncertain."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel, run_indices
from shockrig.analysis.estimate.quantity import RunEffect

Array = NDArray[np.float64]

# How much runs differ from one another in their rate: one restricted likelihood, from what each run alone says.
#
# Each run i says x_i, known to s_i, of its ln rate; within an ambient these scatter by sigma about a mean of their
# own: -2 log L = sum_g [log sum w - sum log w + sum w (x - mean)^2], w = 1 / (sigma^2 + s_i^2), plus the prior below.

# Runs differ a little: relative scatter of the rate from run to run, before the data say otherwise.
RATE_SCATTER = 0.004
RATE_SCATTER_WEIGHT = 2.0  # in runs: how strongly the data must contradict it
STRENGTHS_TRIED = np.geomspace(0.02, 5.0, 41)  # relative scatters of an effect's strength from run to run
# Of air that nobody recorded, what it changes by in a record behind its step, relative to that: before the data say
# otherwise, and at most. What changes by more is no step of the air.
DRIFT_SCATTER, DRIFT_SCATTER_LIMIT = 3e-4, 0.3
RATE_SCATTER_LIMIT = 0.03  # beyond this, runs do not differ a little: the model is wrong
BLOCK_ROWS, NOTHING = 24, 1e-12  # of a whitener: rows taken at once, and what of its largest number is none
UNVENTILATED_LIMIT = 0.5  # where nobody recorded the airflow, runs may differ as much as airflows do


@dataclass(frozen=True)
class OwnRates:
    """What each run alone says of a random effect, mostly its ln rate, less the joint one: value and standard
    uncertainty (R,), its ambient."""

    own: Array
    spread: Array
    ambient: NDArray[np.int64]


def prior_cost(scatter: Array) -> Array:
    """-2 log prior of the scatter, 0 at `RATE_SCATTER`."""
    ratio = scatter / RATE_SCATTER
    return np.asarray(RATE_SCATTER_WEIGHT * (2 * np.log(ratio) + 1 / ratio**2 - 1))


def cost(trials: Array, parts: Iterable[OwnRates]) -> Array:
    """-2 log posterior of trial scatters (T,), up to a constant, from all parts together."""
    return prior_cost(trials) + restricted(trials, parts)


def restricted(trials: Array, parts: Iterable[OwnRates]) -> Array:
    """-2 log restricted likelihood of trial scatters (T,), up to a constant, from all parts together."""
    total = np.zeros(trials.shape)
    for part in parts:
        weight = 1.0 / (trials[:, None] ** 2 + part.spread**2)
        for g in np.unique(part.ambient):
            here = part.ambient == g
            w, x = weight[:, here], part.own[here]
            mean = (w * x).sum(axis=1) / w.sum(axis=1)
            total = total + np.log(w.sum(axis=1)) - np.log(w).sum(axis=1) + (w * (x - mean[:, None]) ** 2).sum(axis=1)
    return total


def restriction(scatter: float, part: OwnRates) -> float:
    """What restricting the likelihood adds to -2 log L for ambients' means fitted along, less that at `RATE_SCATTER`.

    Without it the few runs of each ambient make a smaller scatter likelier.
    """
    total = 0.0
    for g in np.unique(part.ambient):
        spread = part.spread[part.ambient == g]
        now, before = ((1.0 / (s**2 + spread**2)).sum() for s in (scatter, RATE_SCATTER))
        total += float(np.log(now / before))
    return total


def likeliest(part: OwnRates, limit: float = RATE_SCATTER_LIMIT) -> float:
    """The scatter, up to a limit, that one part's runs make most likely."""
    trials = np.geomspace(0.2 * RATE_SCATTER, limit, 41)
    return float(trials[np.argmin(cost(trials, [part]))])


def likeliest_strength(part: OwnRates, usual: float) -> float:
    """The scatter of an effect's strength about what it is usually that its runs make most likely."""
    trials = usual * STRENGTHS_TRIED
    return float(trials[np.argmin(restricted(trials, [part]))])


def likeliest_drift(own: Array, spread: Array) -> float:
    """The scatter of drifts about none at all that those which runs show by themselves (R,) make most likely."""
    trials = np.geomspace(DRIFT_SCATTER, DRIFT_SCATTER_LIMIT, 41)
    variance = trials[:, None] ** 2 + spread**2
    return float(trials[np.argmin((np.log(variance) + own**2 / variance).sum(axis=1))])


def scatters_tried(limit: float = RATE_SCATTER_LIMIT) -> Array:
    """Trial scatters up to a limit, evenly spaced in their logarithm."""
    return np.geomspace(0.1 * RATE_SCATTER, limit, 80)


def posterior_scatter(
    parts: Iterable[OwnRates],
    limit: float = RATE_SCATTER_LIMIT,
    prior: Callable[[Array], Array] = prior_cost,
) -> float:
    """Root of the posterior mean of sigma^2, up to a limit, over all parts together; `prior` is -2 log of what was
    known before.

    The mean and not the mode, so that a scatter known from a dozen runs does not make the uncertainties too small.
    """
    trials = scatters_tried(limit)
    total = prior(trials) + restricted(trials, parts)
    posterior = np.exp(-0.5 * (total - total.min()))
    return float(np.sqrt((posterior * trials**2).sum() / posterior.sum()))


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
        known[:, [RunEffect.STRENGTH, RunEffect.DRIFT]] = False
        known[:, RunEffect.START] = c.start_known
        known[:, RunEffect.SOURCE] = known[:, RunEffect.DESTINATION] = c.airs_known
        return known

    def scatter_of(self, effect: RunEffect) -> float:
        """One of the scatters that are estimated: of ln rate, of an effect's strength where one differs so, of the
        drifts of airs that nobody recorded; 1 where there are none of these."""
        return float(self.scatter[:, effect].min())

    def with_scatter_of(self, effect: RunEffect, value: float) -> Problem:
        """With another one of these scatters."""
        scatter = self.scatter.copy()
        scatter[:, effect] = value if effect is not RunEffect.DRIFT else np.where(self.channel.may_drift, value, 1.0)
        new = replace(self, scatter=scatter)
        # The whitener is the same one: what was read off it takes longer than many of its products.
        new.__dict__.update({name: self.__dict__[name] for name in ("_weights", "_blocks") if name in self.__dict__})
        return new

    def with_drifting_airs(self) -> Problem:
        """With airs that drift behind their steps where nobody recorded them."""
        moving = replace(self, channel=replace(self.channel, drifts=True))
        return moving.with_scatter_of(RunEffect.DRIFT, DRIFT_SCATTER)

    @property
    def rate_scatter(self) -> float:
        """Scatter of ln rate from run to run."""
        return self.scatter_of(RunEffect.RATE)

    def with_rate_scatter(self, rate_scatter: float) -> Problem:
        """With another scatter of ln rate."""
        return self.with_scatter_of(RunEffect.RATE, rate_scatter)

    @property
    def rate_scatter_limit(self) -> float:
        """The largest scatter of ln rate from run to run that is none of the model's faults."""
        return RATE_SCATTER_LIMIT if self.channel.conditions.airflow_known.all() else UNVENTILATED_LIMIT

    def with_weights(self, weight: Array) -> Problem:
        """With independent errors of its bins (R, n), of these weights."""
        return replace(self, whitener=weight[:, :, None] * np.eye(weight.shape[1]))

    @cached_property
    def _weights(self) -> Array | None:
        """The whitener's diagonal (R, n), where it has nothing else."""
        diagonal = np.einsum("rii->ri", self.whitener)
        return diagonal if np.count_nonzero(self.whitener) == np.count_nonzero(diagonal) else None

    @cached_property
    def _blocks(self) -> list[tuple[slice, slice, Array]]:
        """The whitener in blocks of rows with the columns that have anything in them: noise is soon forgotten."""
        size = np.abs(self.whitener)
        filled = (size > NOTHING * size.max(initial=0.0)).any(axis=0)
        blocks = []
        for begin in range(0, filled.shape[0], BLOCK_ROWS):
            rows = slice(begin, begin + BLOCK_ROWS)
            there = np.flatnonzero(filled[rows].any(axis=0))
            columns = slice(int(there[0]), int(there[-1]) + 1) if there.size else slice(0, 0)
            blocks.append((rows, columns, np.ascontiguousarray(self.whitener[:, rows, columns])))
        return blocks

    def whiten(self, values: Array) -> Array:
        """Whitened values (R, n) or columns (R, n, C)."""
        if self._weights is not None:  # independent noise: a factor for each bin, where a product of matrices is slow
            return np.asarray(self._weights[..., *[None] * (values.ndim - 2)] * values)
        columns = values if values.ndim == 3 else values[..., None]
        out = np.empty(columns.shape)
        for rows, among, block in self._blocks:
            np.matmul(block, columns[:, among], out=out[:, rows])
        return out if values.ndim == 3 else out[..., 0]


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
    scatter[:, RunEffect.STRENGTH] = 1.0
    scatter[:, RunEffect.DRIFT] = np.where(channel.may_drift, DRIFT_SCATTER, 1.0)
    scatter[:, RunEffect.SOURCE] = np.hypot(source, extra)
    scatter[:, RunEffect.DESTINATION] = np.hypot(destination, extra)
    if quantity.run_effects > RunEffect.DESTINATION_C:
        # An isothermal run has one temperature; what matters is the difference between the two airs.
        scatter[:, RunEffect.DESTINATION_C] = np.hypot(c.source_c_scatter, c.destination_c_scatter)
    return Problem(channel, whitener, scatter)
