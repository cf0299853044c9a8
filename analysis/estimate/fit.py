"""Generalised least squares of a model on one channel, with each run's own small deviations as random effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.arrow import Arrow
from shockrig.analysis.estimate.channel import Channel, as_single_samples
from shockrig.analysis.estimate.effect import DIFFERS_BY, TINY_STRENGTH, Effect
from shockrig.analysis.estimate.model import LEAST_TRIGGER_OFFSET_S, TRIGGER, Model, Point, Structure
from shockrig.analysis.estimate.problem import (
    DRIFT_SCATTER_LIMIT,
    UNVENTILATED_LIMIT,
    OwnRates,
    Problem,
    likeliest,
    likeliest_drift,
    likeliest_strength,
    prior_cost,
    restriction,
)
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.physics.chain import at_jump, evaluate

Array = NDArray[np.float64]

# Generalised least squares of a model on one channel, with each run's own small deviations as random effects.
#
# minimise sum_i |W_i (y_i - f_i(theta, u_i))|^2 + u_i' Lambda_i^-1 u_i by damped Gauss-Newton steps over theta and
# all u_i together, linearised at each run's own estimate u_i.

OBJECTIVE_TOLERANCE = 0.02  # drop of the objective at which a fit ends
MOST_STEPS = 80  # of Gauss and Newton, of a fit that does not end before: bent valleys take many short ones
MOST_TRIES = 7  # of a step, each damped more
LEAST_DAMPING = 1e-6  # from which the tries go up
NEAR_FIRST = 0.01  # of a sampling period, that a start stays before its record's first reading
LONGEST_RUN_STEP = 20.0  # of a run's random effects, in standard deviations
LAST_DIGITS, FIRST_DIGITS = 2e-4, 1e-3  # of a misfit, by which a step must lower it where the model is wrong
FAR_OFF = 10.0  # objective per bin from which the first digits do
ADAPTED_FROM = 0.06  # relative change of the rates' scatter from which on it is taken over


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes
    ----------
    model : Model
    theta : ndarray (P,)
    covariance : ndarray (P, P)
        Of theta, the runs' deviations integrated out.
    deviations : ndarray (R, U)
    objective : float
        Penalised sum of squares.
    deviance : float
        -2 log marginal likelihood up to a constant that all models of the problem share.
    rate_scatter : float
        Run-to-run scatter of the rate that the fit settled on.
    strength_scatter : float
        Likewise of the strength of the effect that differs from run to run; 1 where none does.
    drift_scatter : float
        Likewise of the drifts of airs that nobody recorded, in steps of the runs; 1 where all were recorded.
    residual : ndarray (R, n)
        y - f [channel's unit]; zero where a bin is empty.
    arrow : Arrow
        The normal equations at the end, under that scatter.
    converged : bool
    at : Linearised
        Where it ended, to go on from.
    """

    model: Model
    theta: Array
    covariance: Array
    deviations: Array
    objective: float
    deviance: float
    rate_scatter: float
    strength_scatter: float
    drift_scatter: float
    residual: Array
    arrow: Arrow
    converged: bool
    at: Linearised

    @property
    def structure(self) -> Structure:
        """What the model adds to the plain chain."""
        return self.model.structure

    @property
    def point(self) -> Point:
        """Where the fit ended."""
        return Point(self.theta, self.deviations)

    @property
    def log_rates(self) -> Array:
        """ln rates of the ambients (G,)."""
        return self.theta[self.model.rates]

    @property
    def choice(self) -> dict[str, float]:
        """{"effect.parameter": value}."""
        return self.model.choice(self.theta)

    def values(self) -> dict[str, dict[str, tuple[float, float]]]:
        """{effect: {parameter: (value, standard uncertainty)}} in the parameters' own units."""
        return self.model.values(self.theta, self.covariance)

    def values_of(self, effect: Effect) -> dict[str, tuple[float, float]]:
        """One effect's {parameter: (value, standard uncertainty)}, and by how much its strength differs from run to run
        where it does."""
        own = self.values()[effect.id]
        if not effect.scatters:
            return own
        usual, degrees = abs(own.get(effect.differs_in, (1.0, 0.0))[0]), max(self.model.channel.runs - 1, 1)
        scatter = self.strength_scatter / max(usual, TINY_STRENGTH)
        return own | {DIFFERS_BY: (scatter, scatter / float(np.sqrt(2.0 * degrees)))}

    def on_its_scatters(self, problem: Problem) -> Problem:
        """A problem with the scatters that the fit settled on."""
        return (
            problem.with_rate_scatter(self.rate_scatter)
            .with_scatter_of(RunEffect.STRENGTH, self.strength_scatter)
            .with_scatter_of(RunEffect.DRIFT, self.drift_scatter)
        )

    def own_rates(self) -> OwnRates:
        """What each run alone says of its rate."""
        return _own_rates(self.arrow, self.deviations, self.model)

    def scores(self, problem: Problem, columns: Array) -> tuple[Array, Array]:
        """Scores (C,) of whitened columns (R, n, C) and their covariance, see `Arrow.scores`."""
        arrow, pull = self._free(self.arrow)
        return arrow.scores(columns, problem.whiten(self.residual), self.deviations, pull)

    def score_variances(
        self, problem: Problem, columns: Array, beside: Arrow, groups: Array | None = None
    ) -> tuple[Array, Array]:
        """Scores and their variances alone, see `Arrow.score_variances`.

        `beside` replaces the fit's arrow: one with more random effects than its own (behind these), or other weights.
        """
        arrow, pull = self._free(beside)
        more = arrow.weight.shape[1] - self.deviations.shape[1]
        deviations = np.pad(self.deviations, ((0, 0), (0, more)))
        return arrow.score_variances(columns, problem.whiten(self.residual), deviations, pull, groups)

    def _free(self, arrow: Arrow) -> tuple[Arrow, Array]:
        """An arrow of this model, and the prior's pull, without what of theta stands at a bound: it cannot follow, and
        takes nothing from a column."""
        mean, weight = self.model.priors()
        low, high = self.model.bounds()
        free = (self.theta > low) & (self.theta < high)
        pull = weight * (mean - self.theta)
        if free.all():
            return arrow, pull
        return Arrow(arrow.jacobian[..., free], arrow.run_jacobian, arrow.weight, arrow.prior_weight[free]), pull[free]


@dataclass(frozen=True)
class Linearised:
    """Prediction and whitened sensitivities at a point; `muted` (R,) is how many bins of each run say nothing there."""

    point: Point
    prediction: Array
    jacobian: Array
    run_jacobian: Array
    residual: Array
    muted: NDArray[np.int64]

    def arrow(self, problem: Problem, model: Model) -> Arrow:
        return Arrow(self.jacobian, self.run_jacobian, 1.0 / problem.scatter**2, model.priors()[1])

    def objective(self, problem: Problem, model: Model) -> float:
        """Penalised sum of squares; a muted bin counts as what noise alone would give, so that no model gains by
        muting."""
        return _penalised(problem, model, self.point, self.residual, int(self.muted.sum()))


def _penalised(problem: Problem, model: Model, point: Point, residual: Array, muted: int) -> float:
    penalty = ((point.deviations / problem.scatter) ** 2).sum()
    return float((residual**2).sum() + muted + penalty) + _held_against(model, point.theta)


def _held_against(model: Model, theta: Array) -> float:
    """What is known of theta before any data, as a penalty."""
    mean, weight = model.priors()
    return float((weight * (theta - mean) ** 2).sum())


def _linearise(problem: Problem, model: Model, point: Point, hold_theta: bool = False) -> Linearised:
    """From one batch of perturbed candidates; the sensitivities to a theta that is held are left at zero."""
    channel, theta = problem.channel, point.theta
    rates, step = channel.rates, model.steps()
    run_step = np.array(channel.quantity.run_steps)
    moves = {RunEffect.STRENGTH: model.structure.scattering is not None, RunEffect.DRIFT: channel.may_drift.any()}
    moved = [k for k in range(run_step.size) if moves.get(RunEffect(k), True)]
    free = 0 if hold_theta else model.behind.start - rates
    count = 1 + free + len(moved)
    thetas = np.tile(theta, (count, 1))
    deviations = np.tile(point.deviations, (count, 1, 1))
    for k in range(free):
        thetas[1 + k, rates + k] += step[rates + k]
    for place, k in enumerate(moved, start=1 + free):
        deviations[place, :, k] += run_step[k]
    chain = model.chain(Point(thetas, deviations))
    f = np.broadcast_to(evaluate(chain, channel.quantity.reading), (count, *channel.time_s.shape))
    mute = at_jump(chain)
    if mute.any():
        f = np.where(mute, channel.value, f)
    # One product whitens all candidates and the data; columns that lie together make it twice as fast.
    columns = np.empty((*channel.time_s.shape, count + 1))
    columns[..., :count] = np.moveaxis(f, 0, -1)
    columns[..., count] = channel.value
    whitened = problem.whiten(columns)
    base = whitened[..., 0]
    run_jacobian = np.zeros((*base.shape, run_step.size))
    run_jacobian[..., moved] = (whitened[..., 1 + free : count] - base[..., None]) / run_step[moved]
    jacobian = np.zeros((*base.shape, theta.size))
    if not hold_theta:
        jacobian[..., :rates] = run_jacobian[..., RunEffect.RATE, None] * channel.interpolation[:, None, :]
        jacobian[..., rates : rates + free] = (whitened[..., 1 : 1 + free] - base[..., None]) / step[
            rates : rates + free
        ]
        for k, one in enumerate(model.shared, start=rates + free):
            jacobian[..., k] = sum(run_jacobian[..., effect] * on[:, None] for effect, on in one.moves.items())
    return Linearised(point, f[0], jacobian, run_jacobian, whitened[..., count] - base, mute.sum(axis=1))


def objective_at(problem: Problem, model: Model, point: Point) -> float:
    """The same penalised sum of squares, without sensitivities: an eighth of the work."""
    channel = problem.channel
    chain = model.chain(Point(point.theta[None], point.deviations[None]))
    predicted = np.broadcast_to(evaluate(chain, channel.quantity.reading), (1, *channel.time_s.shape))[0]
    mute = at_jump(chain)
    residual = problem.whiten(np.where(mute, 0.0, channel.value - predicted))
    return _penalised(problem, model, point, residual, int(mute.sum()))


AIRS = [RunEffect.SOURCE, RunEffect.DESTINATION]


def with_airs(problem: Problem, model: Model, point: Point) -> tuple[Array, Array]:
    """B points' random effects (B, R, U) with the airs that nobody recorded where they fit best beside all else, and
    what each run leaves there (B, R), its own penalty with it.

    Readings are linear in the airs. Eliminated at each step, these leave a fit fewer valleys to end in (variable
    projection; Golub and Pereyra 1973, doi 10.1137/0710036).
    """
    channel, base = problem.channel, point.deviations
    airs = [*AIRS, RunEffect.DRIFT] if channel.may_drift.any() else AIRS
    steps, count = np.array(channel.quantity.run_steps)[airs], len(base)
    moved = np.stack([base] * (1 + len(airs)))
    for k, air in enumerate(airs):
        moved[1 + k, ..., air] += steps[k]
    theta = np.tile(np.broadcast_to(point.theta, (count, point.theta.shape[-1])), (len(moved), 1))
    chain = model.chain(Point(theta, moved.reshape(-1, *base.shape[1:])))
    f = np.broadcast_to(evaluate(chain, channel.quantity.reading), (len(theta), *channel.time_s.shape))
    mute = np.stack([at_jump(chain, candidate) for candidate in range(count)])
    left = np.where(mute, 0.0, channel.value - f.reshape(len(moved), *mute.shape)).reshape(f.shape)
    whitened = problem.whiten(np.moveaxis(left, 0, -1)).reshape(*f.shape[1:], len(moved), count)
    whitened = np.moveaxis(whitened, -1, 1)  # (R, B, n, 1 + airs)
    residual, response = whitened[..., 0], (whitened[..., :1] - whitened[..., 1:]) / steps
    turned, weight = np.swapaxes(response, -1, -2), 1.0 / problem.scatter[:, None, airs] ** 2
    right = (turned @ residual[..., None])[..., 0] - weight * np.swapaxes(base[..., airs], 0, 1)
    step = np.linalg.solve(turned @ response + weight[..., None] * np.eye(len(airs)), right[..., None])
    step[channel.conditions.airs_known] = 0.0
    residual = residual - (response @ step)[..., 0]
    deviations = base.copy()
    deviations[..., airs] += np.swapaxes(step[..., 0], 0, 1)
    penalty = ((deviations / problem.scatter) ** 2).sum(axis=-1)
    return deviations, (residual**2).sum(axis=-1).T + mute.sum(axis=-1) + penalty


def _settled(problem: Problem, model: Model, point: Point) -> tuple[Point, float]:
    """One point with its open airs where they fit best, and the penalised sum of squares there."""
    if problem.channel.conditions.airs_known.all():
        return point, objective_at(problem, model, point)
    deviations, left = with_airs(problem, model, Point(point.theta, point.deviations[None]))
    return Point(point.theta, deviations[0]), float(left.sum()) + _held_against(model, point.theta)


def linearise(problem: Problem, structure: Structure, point: Point) -> tuple[Array, Arrow]:
    """Prediction (R, n) at a point, and the normal equations there: what a design needs of runs not made yet."""
    model = Model(problem.channel, structure)
    at = _linearise(problem, model, point)
    return at.prediction, at.arrow(problem, model)


def fit(
    problem: Problem,
    structure: Structure,
    theta: Array,
    deviations: Array | None = None,
    iterations: int = MOST_STEPS,
    tolerance: float = OBJECTIVE_TOLERANCE,
    adapt_scatter: bool = True,
    hold_theta: bool = False,
) -> Fit:
    """Fit theta and the runs' deviations jointly from one start.

    Parameters
    ----------
    problem, structure : what is fitted
    theta : ndarray (P,)
        Start, on the scale that is fitted.
    deviations : ndarray (R, U), optional
        Start of the runs' deviations; zero if not given.
    iterations : int
        At most so many steps.
    tolerance : float
        Drop of the objective at which a fit ends.
    adapt_scatter : bool
        Whether the scatters of the rate and of a strength are estimated along (as variance components), or held.
    hold_theta : bool
        Only the runs' deviations are fitted: what a run says of its own start and airs under a given model.
    """
    model = Model(problem.channel, structure)
    start = Point(np.clip(theta, *model.bounds()), problem.channel.at_rest() if deviations is None else deviations)
    at = _linearise(problem, model, start, hold_theta)
    return _descend(problem, model, at, iterations, tolerance, adapt_scatter, hold_theta)


def go_on(problem: Problem, found: Fit, iterations: int) -> Fit:
    """A fit that was left early, carried on for so many steps at most."""
    if found.converged:
        return found
    return _descend(found.on_its_scatters(problem), found.model, found.at, iterations)


def _descend(
    problem: Problem,
    model: Model,
    at: Linearised,
    iterations: int,
    tolerance: float = OBJECTIVE_TOLERANCE,
    adapt_scatter: bool = True,
    hold_theta: bool = False,
) -> Fit:
    low, high = model.bounds()
    prior_mean, prior_weight = model.priors()
    reach, furthest = model.reach(), _longest_run_steps(problem)
    size = problem.channel.count.size
    objective, arrow = at.objective(problem, model), at.arrow(problem, model)
    damping, converged, wary = 1e-3, False, False
    airs_open = not problem.channel.conditions.airs_known.all()
    changed: Mapping[RunEffect, ScatterChange] = {}
    for _ in range(iterations):
        pull = prior_weight * (prior_mean - at.point.theta)
        first, last = _starts_on_their_side(problem, at.point)
        held_arrow, own = _with_starts_held(arrow, at, first, last)
        new: Linearised | None = None
        for tried in range(MOST_TRIES):
            damped = held_arrow.damped(damping if tried or wary else 0.0)  # whole steps while they hold
            right, steps = damped.right_sides(at.residual, own, pull)
            # Parameters that stand at a bound and are pushed outwards are held there.
            held = ((at.point.theta <= low) & (right < 0)) | ((at.point.theta >= high) & (right > 0))
            free = ~held & (not hold_theta)
            move = np.zeros(low.size)
            move[free] = np.linalg.lstsq(damped.normal[np.ix_(free, free)], right[free], rcond=None)[0]
            trial = np.clip(at.point.theta + np.clip(move, -reach, reach), low, high)
            shift = damped.run_steps(steps, trial - at.point.theta)
            after = at.point.deviations + np.clip(shift, -furthest, furthest)
            after[:, RunEffect.START] = np.clip(after[:, RunEffect.START], first, last)
            point = Point(trial, after)
            # Where a step has just failed the next may too: its sensitivities wait until it holds. So do those that
            # airs are still to be found for.
            if wary or tried or airs_open:
                new, (point, reached) = None, _settled(problem, model, point)
            else:
                new = _linearise(problem, model, point, hold_theta)
                reached = new.objective(problem, model)
            if np.isfinite(reached) and reached <= objective + 1e-9:
                break
            if tried or wary:
                damping *= 12
        else:
            converged = True
            break
        wary = tried > 0
        at = new or _linearise(problem, model, point, hold_theta)
        gain, objective = objective - reached, reached
        arrow = at.arrow(problem, model)
        damping = max(damping / 8, LEAST_DAMPING)
        if adapt_scatter:
            adapted, changed = _adapted(problem, model, arrow, at.point, changed)
            if adapted is not problem:
                problem, furthest = adapted, _longest_run_steps(adapted)
                objective, arrow = at.objective(problem, model), at.arrow(problem, model)
                continue
        # Where the model is plainly wrong, the last digits of its misfit tell nothing.
        share = LAST_DIGITS if objective < FAR_OFF * size else FIRST_DIGITS
        if gain < max(tolerance, share * (objective - 2 * size)):
            converged = True
            break
    return _finished(problem, model, at, arrow, objective, converged)


def _starts_on_their_side(problem: Problem, at: Point) -> tuple[Array, Array]:
    """Between what a step leaves each run's start (R,): on its side of the first reading where a record begins in its
    response.

    Just past it that reading would be of the air before, and airs and rates that made it part of a response are far
    from that. On which side it lies the starts decide that fits begin from.
    """
    first_s, now = problem.channel.begun_s, at.deviations[:, RunEffect.START]
    late, near_s = now >= first_s, NEAR_FIRST * problem.channel.sampling_period_s
    shown = first_s == 0.0
    return np.where(shown | ~late, -np.inf, first_s), np.where(shown | late, np.inf, first_s - near_s)


def _with_starts_held(arrow: Arrow, at: Linearised, first: Array, last: Array) -> tuple[Arrow, Array]:
    """An arrow, and its runs' right sides (R, U), by which starts that stand at a bound and are pushed past it stay."""
    own, now = arrow.run_sides(at.residual, at.point.deviations), at.point.deviations[:, RunEffect.START]
    pushed = own[:, RunEffect.START]
    held = ((now <= first) & (pushed < 0)) | ((now >= last) & (pushed > 0))
    if not held.any():
        return arrow, own
    sensitivities = arrow.run_jacobian.copy()
    sensitivities[held, :, RunEffect.START], own[held, RunEffect.START] = 0.0, 0.0
    return replace(arrow, run_jacobian=sensitivities), own


def _longest_run_steps(problem: Problem) -> Array:
    """How far one step may move each run's random effects (R, U): what is known nearly, far; what is not, a little.

    Its rate as far as rates ever scatter, however little these do so far.
    """
    c = problem.channel.conditions
    longest = LONGEST_RUN_STEP * problem.scatter
    longest[:, RunEffect.RATE] = UNVENTILATED_LIMIT
    longest[~c.start_known, RunEffect.START] = problem.scatter[~c.start_known, RunEffect.START]
    longest[:, RunEffect.DRIFT] = DRIFT_SCATTER_LIMIT
    for air in (RunEffect.SOURCE, RunEffect.DESTINATION):
        longest[~c.airs_known, air] = problem.scatter[~c.airs_known, air]
    return longest


@dataclass(frozen=True)
class ScatterChange:
    """By how much a fit last took over another scatter, in its logarithm, and whether it ever turned back."""

    by: float = 0.0
    turned: bool = False


def _adapted(
    problem: Problem, model: Model, arrow: Arrow, at: Point, changed: Mapping[RunEffect, ScatterChange]
) -> tuple[Problem, Mapping[RunEffect, ScatterChange]]:
    """The problem with the scatters that the runs make most likely, and how each was changed; itself where those are
    about what it has.

    Rates are told by how far each run may have one of its own and the other way round. Where what a step says of them
    sends their scatter back from its last change, it goes half of that, and from then on never further than it last
    went: it ends in between, and not to and fro.
    """
    told = {RunEffect.RATE: likeliest(_own_rates(arrow, at.deviations, model), problem.rate_scatter_limit)}
    if (effect := model.structure.scattering) is not None:
        own = _own(arrow, at.deviations, RunEffect.STRENGTH)
        usual = abs(model.choice(at.theta).get(f"{effect.id}.{effect.differs_in}", 1.0))
        of_runs = OwnRates(*own, np.zeros_like(model.channel.ambient))
        told[RunEffect.STRENGTH] = likeliest_strength(of_runs, max(usual, TINY_STRENGTH))
    if (moving := model.channel.may_drift).any():
        own = _own(arrow, at.deviations, RunEffect.DRIFT)
        told[RunEffect.DRIFT] = likeliest_drift(own[0][moving], own[1][moving])
    for which, scatter in told.items():
        now, last = problem.scatter_of(which), changed.get(which, ScatterChange())
        change = float(np.log(scatter / now))
        back = change * last.by < 0.0
        if back or last.turned:
            furthest = abs(last.by) * (0.5 if back else 1.0)
            change = float(np.clip(change, -furthest, furthest))
        if abs(change) >= ADAPTED_FROM:
            problem = problem.with_scatter_of(which, now * float(np.exp(change)))
            changed = {**changed, which: ScatterChange(change, back or last.turned)}
    return problem, changed


def _own_rates(arrow: Arrow, deviations: Array, model: Model) -> OwnRates:
    return OwnRates(*_own(arrow, deviations, RunEffect.RATE), model.channel.ambient)


def _own(arrow: Arrow, deviations: Array, effect: RunEffect) -> tuple[Array, Array]:
    """Each run's estimate of a random effect and its standard uncertainty (R,), the prior taken off again."""
    weight = arrow.weight[:, effect]
    information = np.maximum(1.0 / arrow.run_variances()[:, effect] - weight, 1e-9)
    return deviations[:, effect] * (information + weight) / information, 1.0 / np.sqrt(information)


def _finished(problem: Problem, model: Model, at: Linearised, arrow: Arrow, objective: float, converged: bool) -> Fit:
    covariance = arrow.covariance()
    if TRIGGER not in model.names:
        moved = covariance @ arrow.pull(arrow.run_jacobian[..., RunEffect.START]) * LEAST_TRIGGER_OFFSET_S
        covariance = covariance + np.outer(moved, moved)
    complexity = arrow.log_determinant() + 2 * float(np.log(problem.scatter).sum())
    complexity += restriction(problem.rate_scatter, _own_rates(arrow, at.point.deviations, model))
    return Fit(
        model=model,
        theta=at.point.theta,
        covariance=covariance,
        deviations=at.point.deviations,
        objective=objective,
        deviance=objective + complexity + float(prior_cost(np.array(problem.rate_scatter))),
        rate_scatter=problem.rate_scatter,
        strength_scatter=problem.scatter_of(RunEffect.STRENGTH),
        drift_scatter=problem.scatter_of(RunEffect.DRIFT),
        residual=np.where(problem.channel.count > 0, problem.channel.value - at.prediction, 0.0),
        arrow=arrow,
        converged=converged,
        at=at,
    )


def run_misfit(problem: Problem, found: Fit) -> Array:
    """Mean square of each run's whitened residuals (R,): about 1 where the model leaves noise alone."""
    squares = problem.whiten(found.residual) ** 2
    return np.asarray(squares.sum(axis=1) / np.maximum((problem.channel.count > 0).sum(axis=1), 1))


def left_at_common_rates(channel: Channel, found: Fit) -> Array:
    """Residuals (R, n) [channel's unit] where each run has the rate of its ambient and none of its own; zero where a
    bin is empty."""
    deviations = found.deviations.copy()
    deviations[:, RunEffect.RATE] = 0.0
    left = channel.value - found.model.predict(Point(found.theta, deviations))[0]
    return np.where(channel.count > 0, left, 0.0)


def model_at_samples(channel: Channel, found: Fit) -> tuple[Array, ...]:
    """Model readings [channel's unit] at each run's samples, each run's own deviations included."""
    model = found.model.on(as_single_samples(channel)).predict(found.point)[0]
    return tuple(model[i, : t.size] for i, (t, _) in enumerate(channel.samples))


def model_between_samples(channel: Channel, found: Fit) -> tuple[tuple[Array, Array], ...]:
    """Each run's model as a curve: times [s] at the samples and at quarters of the way to the next, and readings."""
    dated = [[t, *(np.append(t[:-1] + q * np.diff(t), t[-1]) for q in (0.25, 0.5, 0.75))] for t, _ in channel.samples]
    curves = []
    for times in zip(*dated, strict=True):
        model = found.model.on(as_single_samples(channel, times)).predict(found.point)[0]
        curves.append([(t, model[i, : t.size]) for i, t in enumerate(times)])
    joined = []
    for parts in zip(*curves, strict=True):
        time_s, reading = (np.concatenate(side) for side in zip(*parts, strict=True))
        order = np.argsort(time_s, kind="stable")
        joined.append((time_s[order], reading[order]))
    return tuple(joined)


def rmse_over_samples(channel: Channel, found: Fit) -> float:
    """Root mean square of reading - model over the samples that the fit used [channel's unit]."""
    models = model_at_samples(channel, found)
    squares = [
        ((value - model)[place >= 0]) ** 2
        for (_, value), model, place in zip(channel.samples, models, channel.bin_of, strict=True)
    ]
    return float(np.sqrt(np.concatenate(squares).mean()))
