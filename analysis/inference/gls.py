"""Generalised least squares of a chain on one channel, with each run's own small deviations as random effects.

minimise  sum_i |W_i (y_i - f_i(theta, u_i))|^2 + u_i' Lambda_i^-1 u_i
by Gauss-Newton steps that eliminate each run's block (arrow matrix), linearised at each run's own estimate u_i.
`theta` are ln rates of the ambients and the effects' parameters; `u_i` are a run's start time, ln rate and airs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects import CATALOGUE, Parameter
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.physics.chain import Chain, at_jump, evaluate

Array = NDArray[np.float64]

# Runs differ a little: relative scatter of the rate from run to run, before the data say otherwise.
RATE_SCATTER = 0.004
RATE_SCATTER_WEIGHT = 2.0  # in runs: how strongly the data must contradict it
RATE_SCATTER_LIMIT = 0.03  # beyond this, runs do not differ a little: the model is wrong

# A trigger is good to 10 ms from run to run; this much of it may be the same in every run, and no fit can see that.
COMMON_START_SCATTER_S = 0.004

# What is known of the air of a room, so that a weak room effect stays physical: (mean, standard deviation).
PRIORS = {"room_temperature_c": (21.0, 8.0), "room_humidity_percent": (45.0, 20.0)}


@dataclass(frozen=True)
class Layout:
    """Which effects a model carries and where their parameters stand in theta (after the G ln rates)."""

    effects: tuple[str, ...]
    fixed: tuple[tuple[str, str, float], ...] = ()  # (effect, parameter, value) held, not fitted

    @property
    def parameters(self) -> tuple[tuple[str, Parameter], ...]:
        held = {(e, p) for e, p, _ in self.fixed}
        return tuple((e, p) for e in self.effects for p in CATALOGUE[e].parameters if (e, p.name) not in held)


@dataclass(frozen=True)
class Problem:
    """Data of one channel, whitened, with what is known of each run's scatter.

    Attributes
    ----------
    channel : Channel
    whitener : ndarray (R, n, n)
    scatter : ndarray (R, U)
        Standard deviations of the runs' deviations: start [s], ln rate, source, destination [channel's unit] and, for
        humidity, destination temperature [K].
    """

    channel: Channel
    whitener: Array
    scatter: Array

    def select(self, keep: Array) -> Problem:
        index = np.flatnonzero(keep) if np.asarray(keep).dtype == bool else keep
        return Problem(self.channel.select(index), self.whitener[index], self.scatter[index])


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    layout : Layout
    theta : ndarray (P,)
        ln rates (G), then effect parameters in their fitting scale.
    covariance : ndarray (P, P)
        Of theta, the runs' deviations integrated out.
    deviations : ndarray (R, U)
    objective : float
        Penalised sum of squares.
    deviance : float
        -2 log marginal likelihood up to a constant that all models of the problem share.
    rate_scatter : float
        Run-to-run scatter of the rate that the fit settled on.
    residual : ndarray (R, n)
        y - f [channel's unit]; zero where a bin is empty.
    jacobian, run_jacobian : ndarray (R, n, P), (R, n, U)
        Whitened sensitivities of the prediction.
    """

    layout: Layout
    theta: Array
    covariance: Array
    deviations: Array
    objective: float
    deviance: float
    rate_scatter: float
    residual: Array
    jacobian: Array
    run_jacobian: Array
    converged: bool

    def values(self, groups: int) -> dict[str, dict[str, tuple[float, float]]]:
        """{effect: {parameter: (value, standard uncertainty)}} in the parameters' own units."""
        found: dict[str, dict[str, tuple[float, float]]] = {effect: {} for effect in self.layout.effects}
        for i, (effect, parameter) in enumerate(self.layout.parameters, start=groups):
            sd = float(np.sqrt(max(self.covariance[i, i], 0.0)))
            if parameter.log:
                value = float(np.exp(self.theta[i]))
                found[effect][parameter.name] = (value, value * sd)
            else:
                found[effect][parameter.name] = (float(self.theta[i]), sd)
        for effect, name, value in self.layout.fixed:
            if effect in found:
                found[effect][name] = (value, 0.0)
        return found


def make_problem(
    channel: Channel, whitener: Array, rate_scatter: float = RATE_SCATTER, rounding: float = 0.0
) -> Problem:
    """Problem with the stated scatter of triggers and airs; `rounding` adds that of plateaus rounded to a coarse
    step."""
    c = channel.conditions
    rate = np.full(channel.runs, rate_scatter)
    extra = rounding / np.sqrt(12.0)
    if channel.name == "temperature":
        columns = [
            c.start_scatter_s,
            rate,
            np.hypot(c.source_c_scatter, extra),
            np.hypot(c.destination_c_scatter, extra),
        ]
    else:
        both = np.hypot(c.source_c_scatter, c.destination_c_scatter)
        # An isothermal run has one temperature; what matters is the difference between the two airs.
        columns = [
            c.start_scatter_s,
            rate,
            np.hypot(c.source_percent_scatter, extra),
            np.hypot(c.destination_percent_scatter, extra),
            both,
        ]
    return Problem(channel, whitener, np.column_stack(columns))


def start_theta(channel: Channel, layout: Layout, log_rate: Array, choice: dict[str, float] | None = None) -> Array:
    """theta from given ln rates (G,) and each parameter's first start, or `choice` by "effect.parameter"."""
    values = list(np.asarray(log_rate, dtype=float))
    for effect, parameter in layout.parameters:
        value = (choice or {}).get(f"{effect}.{parameter.name}", parameter.starts[0])
        values.append(np.log(value) if parameter.log else value)
    return np.array(values)


def build_chain(channel: Channel, layout: Layout, theta: Array, deviations: Array) -> Chain:
    """Chain for candidates theta (B, P) and deviations (B or 1, R, U)."""
    groups = channel.interpolation.shape[1]
    c = channel.conditions
    rate = np.exp(theta[:, :groups] @ channel.interpolation.T + deviations[..., 1])
    if channel.name == "temperature":
        source_c = c.source_c + deviations[..., 2]
        destination_c = c.destination_c + deviations[..., 3]
        source_percent = np.broadcast_to(c.source_percent, source_c.shape)
        destination_percent = np.broadcast_to(c.destination_percent, source_c.shape)
    else:
        source_c = np.broadcast_to(c.source_c, deviations.shape[:-1])
        destination_c = c.destination_c + deviations[..., 4]
        source_percent = c.source_percent + deviations[..., 2]
        destination_percent = c.destination_percent + deviations[..., 3]
    chain = Chain(
        channel=channel,
        time_s=channel.time_s - deviations[..., 0][..., None],
        source_c=source_c,
        destination_c=destination_c,
        source_percent=source_percent,
        destination_percent=destination_percent,
        rate=rate,
    )
    values: dict[str, dict[str, Array]] = {effect: {} for effect in layout.effects}
    for i, (effect, parameter) in enumerate(layout.parameters, start=groups):
        column = theta[:, i : i + 1]
        values[effect][parameter.name] = np.exp(column) if parameter.log else column
    for effect, name, value in layout.fixed:
        if effect in values:
            values[effect][name] = np.full((theta.shape[0], 1), value)
    # The order of the chain is the order of its links, whatever the order in which effects were found.
    for effect in CATALOGUE:
        if effect in values:
            chain = CATALOGUE[effect].apply(chain, values[effect])
    return chain


def predict(channel: Channel, layout: Layout, theta: Array, deviations: Array) -> Array:
    """Predicted readings (B, R, n) for theta (B, P) or (P,) and deviations (R, U) or (B, R, U)."""
    theta = np.atleast_2d(theta)
    deviations = np.asarray(deviations)
    if deviations.ndim == 2:
        deviations = deviations[None]
    shape = (max(theta.shape[0], deviations.shape[0]), channel.runs, channel.time_s.shape[1])
    return np.broadcast_to(evaluate(build_chain(channel, layout, theta, deviations)), shape)


def _steps(problem: Problem, layout: Layout, theta: Array) -> tuple[Array, Array]:
    groups = problem.channel.interpolation.shape[1]
    step = np.full(theta.size, 1e-4)
    for i, (_, parameter) in enumerate(layout.parameters, start=groups):
        if not parameter.log:
            step[i] = 1e-5 * (parameter.high - parameter.low)
    unit = 1e-3 if problem.channel.name == "temperature" else 1e-2
    run_step = np.array([1e-4, 1e-4, unit, unit, 1e-3][: problem.scatter.shape[1]])
    return step, run_step


@dataclass(frozen=True)
class _Point:
    theta: Array
    deviations: Array
    prediction: Array
    jacobian: Array
    run_jacobian: Array
    objective: float
    whitened_residual: Array
    muted: int


def _linearise(problem: Problem, layout: Layout, theta: Array, deviations: Array) -> _Point:
    """Prediction and whitened sensitivities from one batch of perturbed candidates."""
    channel = problem.channel
    groups = channel.interpolation.shape[1]
    step, run_step = _steps(problem, layout, theta)
    free = theta.size - groups
    width = run_step.size
    count = 1 + free + width
    thetas = np.tile(theta, (count, 1))
    all_deviations = np.tile(deviations, (count, 1, 1))
    for k in range(free):
        thetas[1 + k, groups + k] += step[groups + k]
    for k in range(width):
        all_deviations[1 + free + k, :, k] += run_step[k]
    chain = build_chain(channel, layout, thetas, all_deviations)
    f = np.broadcast_to(evaluate(chain), (count, *channel.time_s.shape))
    mute = at_jump(chain)
    if mute.any():
        f = np.where(mute, np.where(mute, channel.value, 0.0), f)
    whitened = np.matmul(problem.whitener, np.moveaxis(f, 0, -1))
    base = whitened[..., 0]
    run_jacobian = (whitened[..., 1 + free :] - base[..., None]) / run_step
    jacobian = np.empty((*base.shape, theta.size))
    jacobian[..., :groups] = run_jacobian[..., 1:2] * channel.interpolation[:, None, :]
    jacobian[..., groups:] = (whitened[..., 1 : 1 + free] - base[..., None]) / step[groups:]
    residual = np.matmul(problem.whitener, (problem.channel.value - f[0])[..., None])[..., 0]
    muted = int(mute.sum())
    objective = _objective(problem, layout, theta, deviations, residual, muted)
    return _Point(theta, deviations, f[0], jacobian, run_jacobian, objective, residual, muted)


def _objective(problem: Problem, layout: Layout, theta: Array, deviations: Array, residual: Array, muted: int) -> float:
    """Penalised sum of squares; a muted bin counts as what noise alone would give, so that no model gains by muting."""
    groups = problem.channel.interpolation.shape[1]
    penalty = ((deviations / problem.scatter) ** 2).sum() + _prior(layout, theta, groups)
    return float((residual**2).sum() + muted + penalty)


def _prior(layout: Layout, theta: Array, groups: int) -> float:
    total = 0.0
    for i, (_, parameter) in enumerate(layout.parameters, start=groups):
        if parameter.name in PRIORS:
            mean, sd = PRIORS[parameter.name]
            total += ((theta[i] - mean) / sd) ** 2
    return total


def _add_diagonal(matrices: Array, weight: Array) -> Array:
    """A stack of square matrices (R, U, U) with `weight` (R, U) added to their diagonals, in place."""
    index = np.arange(matrices.shape[-1])
    matrices[:, index, index] += weight
    return matrices


def _normal_equations(problem: Problem, layout: Layout, point: _Point):
    """Reduced (Schur) normal matrix and right side of theta, and what recovers the runs' deviations."""
    weight = 1.0 / problem.scatter**2
    ju, jt, r = point.run_jacobian, point.jacobian, point.whitened_residual
    turned = ju.transpose(0, 2, 1)
    uu = _add_diagonal(turned @ ju, weight)
    ut = turned @ jt
    ur = (turned @ r[..., None])[..., 0] - weight * point.deviations
    solved = np.linalg.solve(uu, np.concatenate([ut, ur[..., None]], axis=-1))
    tall, flat = jt.reshape(-1, jt.shape[-1]), ut.reshape(-1, jt.shape[-1])
    normal = tall.T @ tall - flat.T @ solved[..., :-1].reshape(flat.shape)
    right = tall.T @ r.ravel() - flat.T @ solved[..., -1].ravel()
    groups = problem.channel.interpolation.shape[1]
    for i, (_, parameter) in enumerate(layout.parameters, start=groups):
        if parameter.name in PRIORS:
            mean, sd = PRIORS[parameter.name]
            normal[i, i] += 1 / sd**2
            right[i] += (mean - point.theta[i]) / sd**2
    return normal, right, solved, uu


def bounds(channel: Channel, layout: Layout) -> tuple[Array, Array]:
    """Lower and upper bounds of theta."""
    groups = channel.interpolation.shape[1]
    low, high = [-18.0] * groups, [8.0] * groups
    for _, parameter in layout.parameters:
        low.append(np.log(parameter.low) if parameter.log else parameter.low)
        high.append(np.log(parameter.high) if parameter.log else parameter.high)
    return np.array(low), np.array(high)


def fit(
    problem: Problem,
    layout: Layout,
    theta: Array,
    deviations: Array | None = None,
    iterations: int = 25,
    tolerance: float = 0.02,
    adapt_scatter: bool = True,
    hold_theta: bool = False,
) -> Fit:
    """Fit theta and the runs' deviations jointly from one start.

    Parameters
    ----------
    problem, layout : what is fitted
    theta : ndarray (P,)
        Start, in the fitting scale.
    deviations : ndarray (R, U), optional
        Start of the runs' deviations; zero if not given.
    adapt_scatter : bool
        Whether the scatter of the rate is estimated along (as a variance component with its prior), or held.
    hold_theta : bool
        Only the runs' deviations are fitted: what a run says of its own start and airs under a given model.
    """
    channel = problem.channel
    low, high = bounds(channel, layout)
    theta = np.clip(theta, low, high)
    deviations = np.zeros(problem.scatter.shape) if deviations is None else deviations
    point = _linearise(problem, layout, theta, deviations)
    damping, converged = 1e-3, False
    for _ in range(iterations):
        normal, right, solved, uu = _normal_equations(problem, layout, point)
        # Parameters that stand at a bound and are pushed outwards are held there.
        held = ((point.theta <= low) & (right < 0)) | ((point.theta >= high) & (right > 0))
        free = ~held & (not hold_theta)
        scale = np.diag(normal).copy()
        accepted = False
        for _ in range(7):
            damped = normal[np.ix_(free, free)] + np.diag(damping * scale[free] + 1e-9)
            move = np.zeros(theta.size)
            move[free] = np.linalg.lstsq(damped, right[free], rcond=None)[0]
            groups = channel.interpolation.shape[1]
            move[:groups] = np.clip(move[:groups], -1.0, 1.0)
            for i, (_, parameter) in enumerate(layout.parameters, start=groups):
                reach = 1.5 if parameter.log else 0.3 * (parameter.high - parameter.low)
                move[i] = np.clip(move[i], -reach, reach)
            trial = np.clip(point.theta + move, low, high)
            move = trial - point.theta
            shift = solved[..., -1] - solved[..., :-1] @ move
            trial_deviations = point.deviations + np.clip(shift, -20 * problem.scatter, 20 * problem.scatter)
            new = _linearise(problem, layout, trial, trial_deviations)
            if np.isfinite(new.objective) and new.objective <= point.objective + 1e-9:
                accepted = True
                break
            damping = min(damping * 12, 1e6)
        if not accepted:
            converged = True
            break
        gain = point.objective - new.objective
        point = new
        damping = max(damping / 8, 1e-9)
        if adapt_scatter:
            problem, changed = _adapt(problem, point)
            if changed:
                point = _rescattered(problem, layout, point)
                continue
        # Where the model is plainly wrong, the last digits of its misfit tell nothing.
        if gain < max(tolerance, 2e-4 * (point.objective - 2 * problem.channel.count.size)):
            converged = True
            break
    return _finish(problem, layout, point, converged)


def _rescattered(problem: Problem, layout: Layout, point: _Point) -> _Point:
    """The same point under another scatter."""
    objective = _objective(problem, layout, point.theta, point.deviations, point.whitened_residual, point.muted)
    return replace(point, objective=objective)


def _adapt(problem: Problem, point: _Point) -> tuple[Problem, bool]:
    """Scatter of the rate by restricted likelihood over the runs' own rates, with its prior; True where it moved by 6
    %."""
    weight = 1.0 / problem.scatter**2
    uu = _add_diagonal(point.run_jacobian.transpose(0, 2, 1) @ point.run_jacobian, weight)
    variance = np.linalg.inv(uu)[:, 1, 1]
    # What each run alone would say of its rate: its information and its estimate, the prior taken off again.
    information = np.maximum(1.0 / variance - weight[:, 1], 1e-6)
    alone = point.deviations[:, 1] * (information + weight[:, 1]) / information
    ambient = problem.channel.ambient
    trials = np.geomspace(0.2 * RATE_SCATTER, RATE_SCATTER_LIMIT, 41)
    w = 1.0 / (trials[:, None] ** 2 + 1.0 / information)
    cost = RATE_SCATTER_WEIGHT * (2 * np.log(trials / RATE_SCATTER) + (RATE_SCATTER / trials) ** 2)
    cost += -np.log(w).sum(axis=1)
    for g in np.unique(ambient):
        own, x = w[:, ambient == g], alone[ambient == g]
        mean = (own * x).sum(axis=1) / own.sum(axis=1)
        cost += np.log(own.sum(axis=1)) + (own * (x - mean[:, None]) ** 2).sum(axis=1)
    new = float(trials[np.argmin(cost)])
    if abs(np.log(new / problem.scatter[0, 1])) < 0.06:
        return problem, False
    scatter = problem.scatter.copy()
    scatter[:, 1] = new
    return replace(problem, scatter=scatter), True


def _finish(problem: Problem, layout: Layout, point: _Point, converged: bool) -> Fit:
    normal, _, _, uu = _normal_equations(problem, layout, point)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    correlation = normal / scale[:, None] / scale
    # A parameter that the data do not see gets a huge variance and leaves the others alone.
    covariance = (
        np.linalg.pinv(correlation + 1e-12 * np.eye(scale.size), rcond=1e-11, hermitian=True) / scale[:, None] / scale
    )
    late = _shifted_by_start(point, uu)
    moved = covariance @ late * COMMON_START_SCATTER_S
    covariance = covariance + np.outer(moved, moved)
    logdet = float(np.linalg.slogdet(uu)[1].sum() + 2 * np.log(problem.scatter).sum())
    rate = float(problem.scatter[0, 1])
    prior = RATE_SCATTER_WEIGHT * (2 * np.log(rate / RATE_SCATTER) + (RATE_SCATTER / rate) ** 2 - 1)
    residual = np.where(problem.channel.count > 0, problem.channel.value - point.prediction, 0.0)
    return Fit(
        layout=layout,
        theta=point.theta,
        covariance=covariance,
        deviations=point.deviations,
        objective=point.objective,
        deviance=point.objective + logdet + prior,
        rate_scatter=rate,
        residual=residual,
        jacobian=point.jacobian,
        run_jacobian=point.run_jacobian,
        converged=converged,
    )


def _shifted_by_start(point: _Point, uu: Array) -> Array:
    """Right side of theta's normal equations for a start that is late by 1 s in every run alike."""
    ju, jt = point.run_jacobian, point.jacobian
    column = ju[..., 0]
    solved = np.linalg.solve(uu, np.einsum("rna,rn->ra", ju, column)[..., None])[..., 0]
    return np.einsum("rnp,rn->p", jt, column) - np.einsum("rna,rnp,ra->p", ju, jt, solved, optimize=True)


def rate_start(channel: Channel, layout: Layout = Layout(())) -> Array:
    """Rough ln rates (G,) from a scan of the plain model, all ambients and all trial rates at once."""
    groups = channel.interpolation.shape[1]
    trials = np.linspace(np.log(2e-4), np.log(30.0), 60)
    theta = np.tile(trials[:, None], (1, groups))
    width = 4 if channel.name == "temperature" else 5
    f = predict(channel, layout, theta, np.zeros((channel.runs, width)))
    squares = (channel.count * (channel.value - f) ** 2).sum(axis=-1)
    by_group = np.stack([squares[:, channel.ambient == g].sum(axis=1) for g in range(groups)], axis=1)
    return trials[np.argmin(by_group, axis=0)]


def run_misfit(problem: Problem, found: Fit) -> Array:
    """Mean square of each run's whitened residuals (R,): about 1 where the model leaves noise alone."""
    whitened = np.matmul(problem.whitener, found.residual[..., None])[..., 0]
    return (whitened**2).sum(axis=1) / np.maximum((problem.channel.count > 0).sum(axis=1), 1)


def project(problem: Problem, found: Fit, columns: Array) -> tuple[Array, Array]:
    """Scores (C,) and their covariance (C, C) for whitened `columns` (R, n, C).

    What the residual says of each direction once the model's parameters and the runs' deviations have had their say.
    """
    residual = np.matmul(problem.whitener, found.residual[..., None])[..., 0]
    ju, jt = found.run_jacobian, found.jacobian
    weight = 1.0 / problem.scatter**2
    weight[:, 1] = 1.0 / found.rate_scatter**2
    turned = ju.transpose(0, 2, 1)
    uu = _add_diagonal(turned @ ju, weight)
    both = np.concatenate([jt, columns], axis=-1)
    ub = turned @ both
    solved = np.linalg.solve(uu, ub)
    tall, flat, reduced = (x.reshape(-1, both.shape[-1]) for x in (both, ub, solved))
    whole = tall.T @ tall - flat.T @ reduced
    # The residual is taken at the runs' estimated deviations; the marginal score wants it at zero deviations.
    at_zero = residual + (ju @ found.deviations[..., None])[..., 0]
    right = tall.T @ at_zero.ravel() - reduced.T @ (turned @ at_zero[..., None]).ravel()
    p = jt.shape[-1]
    scale = np.sqrt(np.maximum(np.diag(whole)[:p], 1e-300))
    inverse = np.linalg.pinv(whole[:p, :p] / np.outer(scale, scale), rcond=1e-10, hermitian=True) / np.outer(
        scale, scale
    )
    normal = whole[p:, p:] - whole[p:, :p] @ inverse @ whole[:p, p:]
    return right[p:] - whole[p:, :p] @ inverse @ right[:p], normal
