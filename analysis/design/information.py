"""What runs that have not been made would say of rates: Fisher information.

For one run with sensitivities J (to theta) and U (to its own random effects, of variances Lambda), all whitened:
    information = J' (I + U Lambda U')^-1 J

What runs bring to the goals is counted in nats, before they are made and after them alike: half the change of
ln det of the goals' precision matrix, all other parameters eliminated (Bayesian D-optimality, Chaloner and Verdinelli
1995, doi 10.1214/ss/1177009939).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.design.menu import LEAD_S, PlannedShock
from shockrig.analysis.estimate.arrow import Arrow
from shockrig.analysis.estimate.channel import AMBIENT_WIDTH_K, Channel, bin_means, edges_after_transfer, place
from shockrig.analysis.estimate.fit import Fit, linearise
from shockrig.analysis.estimate.gather import TRIGGER_SCATTER_S
from shockrig.analysis.estimate.model import Point, Structure, common_beside
from shockrig.analysis.estimate.noise import Noise, whiteners
from shockrig.analysis.estimate.problem import Problem, make_problem
from shockrig.analysis.estimate.quantity import HUMIDITY, TEMPERATURE
from shockrig.analysis.physics.air_exchange import Conditions

Array = NDArray[np.float64]
DIE_S = 10.0  # time constant with which a HYT-271's die follows the air, about


def imagined(problem: Problem, noise: Noise, shocks: Sequence[PlannedShock], ambients_c: Array) -> Problem:
    """A problem of one run for each shock, on the ambients `ambients_c` (G,) of the rates that are fitted.

    Readings are place-holders: what such runs would say does not depend on them.
    """
    like = problem.channel
    lasts_s = [shock.dwell_s + (shock.transfer_s or 0.0) for shock in shocks]
    period_s = like.sampling_period_s
    edges = edges_after_transfer(-LEAD_S, max(lasts_s), period_s, like.tempo)
    times = [np.arange(-LEAD_S + 0.5 * period_s, last_s, period_s) for last_s in lasts_s]
    samples = tuple((time, np.zeros(time.size)) for time in times)
    bin_of = place(samples, edges, np.full(len(samples), TRIGGER_SCATTER_S))
    time, value, count = bin_means(times, [y for _, y in samples], bin_of)
    conditions = _conditions(like.conditions, shocks)
    ambient = np.array(
        [0 if like.quantity.pooled else int(np.argmin(np.abs(ambients_c - s.destination_c))) for s in shocks]
    )
    weights = np.zeros((len(shocks), ambients_c.size))
    weights[np.arange(len(shocks)), ambient] = 1.0
    left = np.exp(-np.maximum(time, 0.0) / DIE_S)
    die = conditions.destination_c[:, None] - conditions.thermal_step_k[:, None] * left
    channel = replace(
        like,
        run_ids=tuple(f"imagined {i}" for i in range(len(shocks))),
        time_s=time,
        value=value,
        count=count,
        samples=samples,
        bin_of=bin_of,
        die_c=die if like.quantity is HUMIDITY else np.full_like(die, np.nan),
        die_samples=(),
        air=(None,) * len(shocks),
        conditions=conditions,
        common=common_beside(like),
        ambient=ambient,
        ambients_c=ambients_c,
        interpolation=weights,
        wet_until_s=np.full(len(shocks), np.nan),
    )
    _, first, kind = np.unique(lasts_s, return_index=True, return_inverse=True)  # runs as long have the same bins
    return make_problem(channel, whiteners(channel.select(first), noise)[kind], problem.rate_scatter)


def shown(imaginary: Problem, structure: Structure, theta: Array) -> tuple[Array, Arrow]:
    """What a model shows of imagined runs (M, n), and the normal equations there."""
    return linearise(imaginary, structure, Point(theta, imaginary.channel.at_rest()))


def _conditions(like: Conditions, shocks: Sequence[PlannedShock]) -> Conditions:
    """What each run will be: all of it known, as far as a bench knows it."""
    stated = {field.name for field in fields(Conditions)} & {field.name for field in fields(PlannedShock)}
    many = np.ones(len(shocks))
    slowed = np.array([np.nan if shock.transfer_s is None else shock.transfer_s for shock in shocks])
    return Conditions(
        **{name: np.array([getattr(shock, name) for shock in shocks], dtype=float) for name in stated},
        start_s=np.array([shock.lead_s for shock in shocks]),
        start_scatter_s=TRIGGER_SCATTER_S * many,
        source_c_scatter=TEMPERATURE.air_scatter * many,
        destination_c_scatter=TEMPERATURE.air_scatter * many,
        source_percent_scatter=HUMIDITY.air_scatter * many,
        destination_percent_scatter=HUMIDITY.air_scatter * many,
        airflow_known=many.astype(bool),
        start_known=many.astype(bool),
        airs_known=many.astype(bool),
        humidity_known=many.astype(bool),
        duration_s=slowed,
        ramp_ratio=many,
        ramp_own_s=slowed,
        elsewhere=~many.astype(bool),
        order=(float(like.order.max()) + 1.0) * many,
        hours=float(like.hours.max()) * many,
    )


def rates_known(channel: Channel, shocks: Sequence[PlannedShock]) -> NDArray[np.bool_]:
    """Whether runs (M,) go to where the rates of a channel's fit hold."""
    away = np.abs(np.array([shock.destination_c for shock in shocks])[:, None] - channel.ambients_c)
    return np.asarray((away <= AMBIENT_WIDTH_K).any(axis=1) | channel.quantity.pooled)


def rates_at(known_c: Array, log_rates: Array, wanted_c: Array) -> Array:
    """ln rates at `wanted_c`, straight in 1/T through those known; beyond them with a film's usual slope.

    The slope, 2500 K, is that of a rate that doubles in 25 K; one that is wrong by half of it is wrong by 12 % in 10 K,
    which an expected amount of information does not feel.
    """
    order = np.argsort(known_c)
    inverse, rates = -1.0 / (known_c[order] + 273.15), log_rates[order]
    at = -1.0 / (wanted_c + 273.15)
    inside = np.interp(at, inverse, rates)
    return np.asarray(inside + 2500.0 * (at - np.clip(at, inverse[0], inverse[-1])))


NOT_KNOWN = 0.5  # standard uncertainty of ln rate at an ambient without runs


@dataclass(frozen=True)
class Information:
    """What a fit knows of its ln rates and what each of M runs would add.

    Attributes
    ----------
    ambients_c : ndarray (G,)
        Of the rates, those without runs last; one value where one rate holds at all.
    known : ndarray (P, P)
        Normal matrix of the rates and the effects' parameters so far.
    added : ndarray (M, P, P)
    floor : ndarray (G,)
        Variance of each ln rate that more runs do not lower: what all triggers have in common.
    """

    ambients_c: Array
    known: Array
    added: Array
    floor: Array

    def variances(self, normal: Array) -> Array:
        """Of the ln rates (..., G), at normal matrices (..., P, P)."""
        scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=-2, axis2=-1), 1e-12))
        inverse = np.linalg.pinv(normal / scale[..., :, None] / scale[..., None, :], rcond=1e-11, hermitian=True)
        rates = np.diagonal(inverse, axis1=-2, axis2=-1) / scale**2
        return np.asarray(rates[..., : self.floor.size] + self.floor)


def nats(before: Array, after: Array, places: Sequence[int]) -> float:
    """Information on the parameters `places` by which one normal matrix (P, P) exceeds another."""
    return 0.5 * (_log_precision(after, places) - _log_precision(before, places))


def _log_precision(normal: Array, places: Sequence[int]) -> float:
    """ln det of the normal matrix of some parameters once the others are eliminated."""
    own = np.isin(np.arange(normal.shape[0]), places)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    scaled = normal / scale[:, None] / scale
    within, across, rest = scaled[np.ix_(own, own)], scaled[np.ix_(own, ~own)], scaled[np.ix_(~own, ~own)]
    left = within - across @ np.linalg.pinv(rest, rcond=1e-11, hermitian=True) @ across.T
    left += 1e-9 * np.eye(left.shape[0])  # for parameters that nothing has told of
    return float(np.linalg.slogdet(left)[1] + 2.0 * np.log(scale[own]).sum())


def gained(problem: Problem, found: Fit, runs: NDArray[np.bool_], places: Sequence[int]) -> float:
    """What some recorded runs of a fit brought to the ln rates `places` [nats].

    From their own readings, noise and random effects, as the fit with all runs has them: it does not scatter as an
    estimate does, and a run that is noisier than the others, or that the model does not describe, brought less.

    Parameters
    ----------
    problem : Problem
    found : Fit
        Of the problem.
    runs : ndarray of bool (R,)
    places : sequence of int
    """
    arrow = found.arrow
    bins = (problem.channel.count > 0).sum(axis=1) - arrow.weight.shape[1]
    own_noise = np.sqrt((problem.whiten(found.residual) ** 2).sum(axis=1) / np.maximum(bins, 1))
    scale = 1.0 / np.maximum(own_noise[runs], 1e-3)[:, None, None]
    stated = arrow.of_runs(runs)
    own = replace(stated, jacobian=scale * stated.jacobian, run_jacobian=scale * stated.run_jacobian)
    known = np.zeros(found.theta.size)
    known[found.model.rates] = 1.0 / NOT_KNOWN**2
    before = arrow.normal - stated.told + np.diag(known)
    return nats(before, before + own.told, places)


def information(
    problem: Problem, found: Fit, noise: Noise, shocks: Sequence[PlannedShock], wanted_c: Sequence[float]
) -> Information:
    """What a fit knows, and what each of some runs would add, at its ambients and those wanted besides."""
    channel, rates = problem.channel, found.model.rates
    pooled = channel.quantity.pooled
    elsewhere = [] if pooled else [t for t in wanted_c if (np.abs(channel.ambients_c - t) > AMBIENT_WIDTH_K).all()]
    ambients = np.concatenate([channel.ambients_c, elsewhere])
    more = ambients.size - channel.rates
    place = np.concatenate([np.arange(channel.rates), np.arange(ambients.size, found.theta.size + more)])
    known = np.zeros((found.theta.size + more,) * 2)
    known[np.ix_(place, place)] = found.arrow.normal
    new = np.arange(channel.rates, ambients.size)
    known[new, new] = 1.0 / NOT_KNOWN**2
    theta = np.zeros(found.theta.size + more)
    theta[place] = found.theta
    if more:
        theta[new] = rates_at(channel.ambients_c, found.theta[rates], ambients[new])
    imaginary = imagined(found.on_its_scatters(problem), noise, shocks, ambients)
    _, arrow = shown(imaginary, found.structure, theta)
    added = arrow.told_by_each
    spread = np.diag(found.covariance)[rates] - np.diag(found.arrow.covariance())[rates]
    floor = np.concatenate([np.maximum(spread, 0.0), np.full(more, float(np.median(np.maximum(spread, 0.0))))])
    return Information(ambients, known, added, floor)
