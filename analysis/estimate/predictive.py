"""How well a fitted model predicts runs that it was not fitted to: their log predictive density, without a refit.

For runs i with whitened sensitivities J_i to theta and U_i to the run's random effects (variances L_i), r_i the
residual at zero random effects:

    C_i = I + U_i L_i U_i',  N = sum_i J_i' C_i^-1 J_i + prior,  g = sum_i J_i' C_i^-1 r_i + prior (mean - theta)
    d_i = (N - N_i)^-1 (g - g_i),  S_i = C_i + J_i (N - N_i)^-1 J_i'
    log p(y_i | all others) = -1/2 [(r_i - J_i d_i)' S_i^-1 (r_i - J_i d_i) + log det S_i]

(Vehtari, Gelman and Gabry 2017, doi 10.1007/s11222-016-9696-4; exact here up to the linearisation.) Every model carries
what it may be wrong by, a discrepancy: bumps in log time after the transfer, each times the run's own step, random from
run to run with a standard deviation that is the model's own, the one under which it predicts best. Where a model is
right that is nought.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.fit import Fit, fit, linearise, rmse_over_samples
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.quantity import RunEffect

Array = NDArray[np.float64]

BUMP_COUNT = 10
# Standard deviations of a bump in units of the run's step that are tried; the first is none.
DISCREPANCIES = np.concatenate([[0.0], np.geomspace(2e-5, 0.3, 14)])
# Times their noise by which readings may scatter about a model that is wrong in no smooth way: without them a run would
# start, and its air be, anywhere before readings that it is far from would. The tails below bridge a factor of two.
MISFITS = 2.0 ** np.arange(1, 11)
NOISE_DEGREES = 8.0  # of freedom, with which the noise of a run is known beside its own readings
USUAL_DEGREES = 3  # of freedom, with which it is known before any run how far runs differ in what they say
FEWEST_RUNS = 3  # that say how far they agree
HOPELESS_NATS = 1e12  # nats a run
RATE_PRIOR = 3.0  # standard deviation of ln rate before any data: a factor of twenty either way
RANGE_PRIOR = 0.5  # that of a parameter, as a share of its range on the scale that is fitted


@dataclass(frozen=True)
class Score:
    """Log predictive density of each run (R,) [nats], up to a constant that all models of a problem share.

    `discrepancy` is the standard deviation of what the model is wrong by, as a share of a run's step, were all that it
    leaves more of than noise as smooth as that.
    """

    runs: Array
    discrepancy: float

    @property
    def total(self) -> float:
        """Of all runs together [nats]."""
        return float(self.runs.sum())


def bumps(problem: Problem) -> Array:
    """What a model may be wrong by, whitened (R, n, K): bumps in log time after the transfer, times the run's step.

    Beside a measured air, which has no transfer, they are bumps in time, times how far that air moves.
    """
    channel = problem.channel
    late, step = channel.time_s, channel.quantity.step(channel.conditions)
    filled = channel.count > 0
    if channel.measured.any():
        first, last = (np.array([f(t[f_]) for t, f_ in zip(late, filled, strict=True)]) for f in (np.min, np.max))
        place = (late - first[:, None]) / np.maximum(last - first, 1e-9)[:, None] * (BUMP_COUNT - 1)
        hats = np.maximum(1.0 - np.abs(place[..., None] - np.arange(BUMP_COUNT)), 0.0) * filled[..., None]
        spread = np.array([0.0 if air is None else _far(channel.trace_of(air)) for air in channel.air])
        spread = np.where(channel.measured, spread, np.abs(step))
        return problem.whiten(hats * np.maximum(spread, channel.quantity.least_step)[:, None, None])
    after = (late > 0) & filled
    if not after.any():
        return np.zeros((*late.shape, BUMP_COUNT))
    soonest = max(float(np.quantile(late[after], 0.01)), 0.5 * channel.sampling_period_s)
    knots = np.linspace(np.log(soonest), np.log(float(late[after].max())), BUMP_COUNT)
    place = np.log(np.maximum(late, soonest))
    # Where nobody recorded the start, what is wrong about it shows before it as well.
    shows = after | (filled & ~channel.conditions.start_known[:, None])
    hats = np.stack([np.where(shows, np.interp(place, knots, row), 0.0) for row in np.eye(BUMP_COUNT)], axis=-1)
    size = np.maximum(np.abs(step), channel.quantity.least_step)
    return problem.whiten(hats * size[:, None, None])


def _far(trace: Array) -> float:
    """How far a sensor has to follow a measured air, the first sample of which is what it had settled to before."""
    return float(np.hypot(trace[1:].std(), trace[1] - trace[0]))


@dataclass(frozen=True)
class Gram:
    """Inner products of a fit's whitened columns in each run: all that its score is made of.

    `jacobian` (R, P, P) and so on are J'J, J'V, J'r, V'V, V'r and r'r, V the random effects with the discrepancy's
    bumps behind them; `own` are the random effects' variances (R, U), `count` the readings of each run (R,).
    """

    jj: Array
    jv: Array
    jr: Array
    vv: Array
    vr: Array
    rr: Array
    own: Array
    prior: Array
    pull: Array
    count: Array


def gram(problem: Problem, found: Fit, bump: Array) -> Gram:
    """Inner products of a fit, parameters at a bound left out."""
    low, high = found.model.bounds()
    free = (found.theta > low) & (found.theta < high)
    jacobian = found.arrow.jacobian[..., free]
    own = found.arrow.run_jacobian
    residual = problem.whiten(found.residual) + (own @ found.deviations[..., None])[..., 0]
    both = np.concatenate([jacobian, own, bump, residual[..., None]], axis=-1)
    products = both.transpose(0, 2, 1) @ both
    p, last = jacobian.shape[-1], both.shape[-1] - 1
    mean, weight = found.model.priors()
    width = np.where(np.arange(free.size) < problem.channel.rates, RATE_PRIOR, RANGE_PRIOR * (high - low))
    # What is known of a parameter before any data keeps the density proper; where nothing is, its range does.
    loose = 1.0 / width**2
    prior = np.where(weight > 0, weight, loose)
    pull = weight * (mean - found.theta)
    return Gram(
        jj=products[:, :p, :p],
        jv=products[:, :p, p:last],
        jr=products[:, :p, last],
        vv=products[:, p:last, p:last],
        vr=products[:, p:last, last],
        # A muted bin counts as what noise alone would give, here as in the fit: no model gains by muting.
        rr=products[:, last, last] + found.at.muted,
        own=1.0 / found.arrow.weight,
        prior=prior[free],
        pull=pull[free],
        count=(problem.channel.count > 0).sum(axis=1).astype(float),
    )


def _reduced(g: Gram, discrepancies: Array) -> tuple[Array, Array, Array, Array]:
    """Under T discrepancies each run's N_i (T, R, P, P), g_i (T, R, P), r_i' C_i^-1 r_i and log det C_i (T, R)."""
    own, root = g.own.shape[-1], np.sqrt(g.own)
    # First what a run does of its own, which no discrepancy changes: with U scaled to unit variance,
    # (I + U U')^-1 = I - U (I + U'U)^-1 U'.
    u = root[..., None] * np.concatenate(
        [np.swapaxes(g.jv, -1, -2)[:, :own], g.vv[:, :own], g.vr[:, :own, None]], axis=-1
    )
    p = g.jj.shape[-1]
    inner = np.eye(own) + u[..., p : p + own] * root[:, None, :]
    solved = np.linalg.solve(inner, u)
    kept = np.concatenate([np.arange(p), np.arange(p + own, u.shape[-1])])  # parameters, bumps, residual
    u, solved = u[..., kept], solved[..., kept]
    left = -np.swapaxes(u, -1, -2) @ solved
    left[:, :p, :p] += g.jj
    left[:, :p, p:-1] += g.jv[..., own:]
    left[:, p:-1, p:-1] += g.vv[:, own:, own:]
    left[:, :p, -1] += g.jr
    left[:, p:-1, -1] += g.vr[:, own:]
    left[:, -1, -1] += g.rr
    # Then the bumps, along their own axes, on which a discrepancy s weighs s^2 / (1 + s^2 value).
    values, axes = np.linalg.eigh(left[:, p:-1, p:-1])
    values = np.maximum(values, 0.0)
    seen, across = left[:, :p, p:-1] @ axes, (np.swapaxes(axes, -1, -2) @ left[:, p:-1, -1:])[..., 0]
    square = (discrepancies**2)[:, None, None]
    weight = square / (1.0 + square * values)
    weighed = seen * weight[:, :, None, :]
    return (
        left[:, :p, :p] - weighed @ np.swapaxes(seen, -1, -2),
        left[:, :p, -1] - (weighed @ across[..., None])[..., 0],
        left[:, -1, -1] - (weight * across**2).sum(axis=-1),
        np.linalg.slogdet(inner)[1] + np.log1p(square * values).sum(axis=-1),
    )


def _scattering(g: Gram, misfit: float) -> Gram:
    """The same where readings scatter by `misfit` times their noise: they say less, of theta and of each run's own
    effects, of which as much is known before as ever."""
    said = {name: getattr(g, name) / misfit**2 for name in ("jj", "jv", "jr", "vv", "vr", "rr")}
    return replace(g, **said)


def densities(g: Gram, discrepancies: Array, blocks: NDArray[np.int64] | None = None, misfit: float = 1.0) -> Array:
    """Log predictive density of each block of runs given all the others (T, B) [nats], under each of T discrepancies;
    single runs by default. Readings scatter about the model by `misfit` times their noise."""
    own, right, square, log_det = _reduced(_scattering(g, misfit), discrepancies)
    count = g.count
    log_det = log_det + 2.0 * count * np.log(misfit)
    if blocks is not None:
        _, place = np.unique(blocks, return_inverse=True)
        size = int(place.max()) + 1
        own, right, square, log_det = (
            np.stack([_summed(one, place, size) for one in x]) for x in (own, right, square, log_det)
        )
        count = _summed(count, place, size)
    scale = 1.0 / np.sqrt(np.diagonal(own.sum(axis=1), axis1=1, axis2=2) + g.prior)[:, None]
    own, right = own * scale[..., None] * scale[..., None, :], right * scale
    whole = own.sum(axis=1) + (g.prior * scale**2) * np.eye(g.prior.size)
    pull = right.sum(axis=1) + g.pull * scale[:, 0]
    rest = whole[:, None] - own
    shift = np.linalg.solve(rest, (pull[:, None] - right)[..., None])
    left = right - (own @ shift)[..., 0]
    off = square - 2.0 * (shift[..., 0] * right).sum(axis=-1) + (np.swapaxes(shift, -1, -2) @ own @ shift)[..., 0, 0]
    off = off - (left * np.swapaxes(np.linalg.solve(whole, np.swapaxes(left, -1, -2)), -1, -2)).sum(axis=-1)
    log_det = log_det + np.linalg.slogdet(whole)[1][:, None] - np.linalg.slogdet(rest)[1]
    # A square below nought is rounding, of a fit so far off that it says nothing.
    off = np.where(off < 0.0, np.nan, off)
    # How large the noise is, is known about as well as from so many readings: Student's tails to Gauss's density, so
    # that a run which no model describes counts by how much less one leaves of it than another, and not for thousands.
    # A run that leaves less than noise, as one that rests at a code does, knows no more of it than the others.
    tail = (NOISE_DEGREES + count) * np.log1p(np.maximum(off - count, 0.0) / (NOISE_DEGREES + count))
    return np.asarray(-0.5 * (np.minimum(off, count) + tail + log_det))


def _summed(values: Array, place: NDArray[np.int64], count: int) -> Array:
    out = np.zeros((count, *values.shape[1:]))
    np.add.at(out, place, values)
    return out


def score(problem: Problem, found: Fit, bump: Array, blocks: NDArray[np.int64] | None = None) -> Score:
    """A fit's score, under the discrepancy, the scatter about it and that of the runs' rates that make it best.

    A fit knows of no discrepancy, and lets rates scatter to do what one does: it is scored by the usual scatter too.
    """
    g = gram(problem, found, bump)
    usual = g.own.copy()
    for effect in (RunEffect.RATE, RunEffect.DRIFT):
        usual[:, effect] = np.minimum(usual[:, effect], problem.scatter[:, effect] ** 2)
    owns = [replace(g, own=own) for own in ((g.own, usual) if (usual < g.own).any() else (g.own,))]

    def best_under(misfit: float) -> tuple[Array, float, float]:
        tried = np.concatenate([densities(one, DISCREPANCIES, blocks, misfit) for one in owns])
        # A fit that led to no number predicts nothing.
        totals = [total if np.isfinite(total := float(one.sum())) else -np.inf for one in tried]
        best = int(np.argmax(totals))
        return tried[best], totals[best], float(DISCREPANCIES[best % DISCREPANCIES.size])

    runs, total, discrepancy = best_under(1.0)
    for misfit in MISFITS:
        more, higher, _ = best_under(misfit)
        if not higher > total:
            break
        runs, total = more, higher
    return Score(runs if np.isfinite(total) else np.full(runs.shape, -HOPELESS_NATS), discrepancy)


def weights(densities_of: Sequence[Array], log_prior: Sequence[float], draws: int = 1000, seed: int = 26) -> Array:
    """Weight of each model (M,): pseudo-BMA+ over a bootstrap of the runs (after Yao and others 2018,
    doi 10.1214/17-BA1091)."""
    each = np.stack(densities_of)  # (M, R)
    runs = each.shape[1]
    rng = np.random.default_rng(seed)
    # Runs drawn with replacement: what a single run says is missing in a third of the draws.
    share = rng.multinomial(runs, np.full(runs, 1.0 / runs), draws) / runs  # (B, R)
    # What a run says, others may say more or less of: by as much as it says, known as from three runs.
    says = np.maximum(1.0 + rng.standard_t(USUAL_DEGREES, share.shape), 0.0)
    share = share * says / says.mean()
    log_weight = runs * share @ each.T + np.asarray(log_prior)  # (B, M)
    log_weight -= log_weight.max(axis=1, keepdims=True)
    weight = np.exp(log_weight)
    return np.asarray((weight / weight.sum(axis=1, keepdims=True)).mean(axis=0))


def no_surer(problem: Problem, found: Fit, bump: Array, discrepancy: float, than_runs: bool) -> Fit:
    """A fit whose parameters are as uncertain as its model's being wrong makes them.

    The fit weighs readings by their noise alone; what the model is wrong by, a discrepancy D_i in each run, moves its
    parameters by N^-1 J_i' C_i^-1 D_i: covariance N^-1 + N^-1 (sum_i J_i' C_i^-1 E[D_i D_i'] C_i^-1 J_i) N^-1. With
    `than_runs`, no parameter is surer than the runs agree on it either: the same with what each run leaves in the place
    of D_i (Huber 1967; White 1982, doi 10.2307/1912526).
    """
    runs = problem.channel.runs
    than_runs &= runs >= FEWEST_RUNS
    if discrepancy == 0.0 and not than_runs:
        return found
    g = gram(problem, found, bump)
    own, right = (x[0] for x in _reduced(g, np.zeros(1))[:2])
    low, high = found.model.bounds()
    free = (found.theta > low) & (found.theta < high)
    scale = 1.0 / np.sqrt(own.sum(axis=0).diagonal() + g.prior)
    inverse = np.linalg.inv(own.sum(axis=0) * scale[:, None] * scale + np.diag(g.prior * scale**2))
    inverse = inverse * scale[:, None] * scale
    moved = inverse @ _seen_by(g)  # (R, P, K): of a bump of one each
    covariance = found.covariance.copy()
    covariance[np.ix_(free, free)] += discrepancy**2 * np.einsum("rpk,rqk->pq", moved, moved)
    if than_runs:
        each = right @ inverse
        each = each - each.mean(axis=0)
        part = np.ix_(free, free)
        covariance[part] = no_less_than_scatter(covariance[part], each.T @ each * runs / (runs - 1.0))
    return replace(found, covariance=covariance)


def no_less_than_scatter(covariance: Array, scatter: Array) -> Array:
    """A covariance (P, P) that is in no direction less than a scatter: along the axes of both, the larger of the two.

    Along any direction its variance is at least that of either.
    """
    root = np.linalg.cholesky(covariance)
    inverse = np.linalg.inv(root)
    values, axes = np.linalg.eigh(inverse @ scatter @ inverse.T)
    wide = root @ axes
    return np.asarray((wide * np.maximum(values, 1.0)) @ wide.T)


def _seen_by(g: Gram) -> Array:
    """J' C^-1 B of each run (R, P, K), B the discrepancy's bumps: what is left of them for the parameters beside the
    run's own random effects."""
    width, root = g.own.shape[-1], np.sqrt(g.own)
    scaled = g.vv[:, :width, :width] * root[:, :, None] * root[:, None, :] + np.eye(width)
    behind = np.linalg.solve(scaled, root[..., None] * g.vv[:, :width, width:])
    return np.asarray(g.jv[..., width:] - (g.jv[..., :width] * root[:, None, :]) @ behind)


def allowing(problem: Problem, bump: Array, discrepancy: float) -> Problem:
    """The problem of a model that may be wrong by so much: its discrepancy is noise to whoever fits its parameters.

    The whitener becomes (I + s^2 B B')^(-1/2) W, by way of B's own few columns.
    """
    if discrepancy == 0.0 or not bump.shape[-1]:
        return problem
    basis, triangle = np.linalg.qr(bump)
    values, vectors = np.linalg.eigh(discrepancy**2 * (triangle @ triangle.transpose(0, 2, 1)))
    turned = basis @ vectors
    shrink = 1.0 / np.sqrt(1.0 + np.maximum(values, 0.0)) - 1.0
    whitener = problem.whitener + (turned * shrink[:, None, :]) @ (turned.transpose(0, 2, 1) @ problem.whitener)
    return replace(problem, whitener=whitener)


def stated_beside(problem: Problem, found: Fit, bump: Array, discrepancy: float) -> Fit:
    """A fit's parameters where its model may be wrong by so much: fitted with that as noise, and as uncertain.

    Residuals, normal equations and deviance are those of the problem as it was.
    """
    if discrepancy == 0.0:
        return found
    part = allowing(problem, bump, discrepancy)
    again = fit(part, found.structure, found.theta, found.deviations)
    prediction, arrow = linearise(problem, found.structure, again.point)
    residual = np.where(problem.channel.count > 0, problem.channel.value - prediction, 0.0)
    return replace(
        found,
        theta=again.theta,
        covariance=again.covariance,
        deviations=again.deviations,
        rate_scatter=again.rate_scatter,
        strength_scatter=again.strength_scatter,
        drift_scatter=again.drift_scatter,
        residual=residual,
        arrow=arrow,
    )


def as_stated(problem: Problem, found: Fit, bump: Array, discrepancy: float, than_runs: bool) -> Fit:
    """A model's parameters as they are stated: those of the fit, as uncertain as what the model is wrong by makes them.

    A single run of a precise sensor weighs a few readings beside the transfer for all of it, where its model is wrong,
    and no other run says otherwise: there they are those of a fit beside the discrepancy, where that leaves less.
    """
    if problem.channel.runs == 1:
        beside = stated_beside(problem, found, bump, discrepancy)
        if rmse_over_samples(problem.channel, beside) < rmse_over_samples(problem.channel, found):
            return beside
    return no_surer(problem, found, bump, discrepancy, than_runs)
