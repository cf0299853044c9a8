"""What a fit begins from: the ambients' rates by a rough scan and by a global search, and starts that nobody recorded.

Two searches look for the rate with the least RMSE of Eq. (17): one everywhere (differential evolution), one downhill
from where the readings say that it is (SBPLX). The fit begins from whichever left less. RMSE = sqrt(mean over samples
of (reading - model)^2) (Segales et al. 2022, doi 10.5194/amt-15-2607-2022). A generation of candidates is one array
operation over all runs of an ambient; start times and airs are taken as recorded, and where nobody triggered, each run
takes the start that suits the candidate best.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, differential_evolution

from shockrig.analysis.estimate.channel import STARTS_WITHIN, Channel
from shockrig.analysis.estimate.fit import MOST_STEPS, Fit, fit, objective_at, run_misfit, with_airs
from shockrig.analysis.estimate.model import LOG_RATE_BOUNDS, PLAIN, Model, Point, Structure
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.chain import jumps
from shockrig.analysis.physics.modes import response_times

Array = NDArray[np.float64]

RATE_BOUNDS_PER_S = (2e-4, 30.0)  # t63 of a bead from 6 ms to 14 min, of a film from 11 ms to 27 min
RATES_TRIED = 60
ONE_IN = 3  # of these is tried first, then those about the best of them
USUAL_SCATTER_S = 0.5  # of a start that was estimated
LATE_S = np.arange(-0.8, 0.81, 0.04)  # starts that are tried beside it
STUCK_MEAN_SQUARE = 1.7  # mean square of a run's whitened residuals from which its start is looked for anew
NEXT_READINGS = np.setdiff1d(np.arange(-10, 11), 0) / 10.0  # sampling periods from a start to others that are tried
WITHIN_PERIOD = NEXT_READINGS[NEXT_READINGS > 0.0]
STARTS_AGO = 25  # before the first reading of a record that begins in its response
LEAST_GAIN = 1.0  # drop of the deviance for which a start is moved
START_GRID = np.linspace(-STARTS_WITHIN, STARTS_WITHIN, 25)  # in standard deviations of a start
PLAINLY_WRONG = 3.0  # objective per bin from which a fit's deviations mean nothing
MOST_SCANS = 3  # for starts, each from where the fit before ended


def rough_rates(
    problem: Problem,
    structure: Structure = PLAIN,
    deviations: Array | None = None,
    choice: Mapping[str, float] | None = None,
) -> Array:
    """Rough ln rates (G,) from a scan of all ambients at once, first with some of the trial rates, then with those
    about the best of them; `choice` as in `Model.start`."""
    low, high = np.log(RATE_BOUNDS_PER_S)
    trials = np.linspace(max(low, LOG_RATE_BOUNDS[0]), high, RATES_TRIED)
    model = Model(problem.channel, structure)
    begun = problem.channel.at_rest() if deviations is None else deviations
    best = _least(problem, model, begun, choice, trials[ONE_IN // 2 :: ONE_IN, None])
    about = np.searchsorted(trials, best) + np.arange(1 - ONE_IN, ONE_IN)[:, None]
    return _least(problem, model, begun, choice, trials[about.clip(0, RATES_TRIED - 1)])


def _least(
    problem: Problem, model: Model, deviations: Array, choice: Mapping[str, float] | None, trials: Array
) -> Array:
    """The trial rates (G,), among some for each ambient (B, G), that leave least of its runs."""
    channel = problem.channel
    trials = np.broadcast_to(trials, (len(trials), channel.rates))
    theta = np.stack([model.start(trial, choice) for trial in trials])
    squares = _left(problem, model, theta, np.stack([deviations] * len(trials)))
    by_group = np.stack([squares[:, channel.ambient == g].sum(axis=1) for g in range(channel.rates)], axis=1)
    return np.asarray(np.take_along_axis(trials, np.argmin(by_group, axis=0)[None], axis=0)[0])


def _left(problem: Problem, model: Model, theta: Array, deviations: Array) -> Array:
    """What B candidates leave of each run (B, R), airs that nobody recorded where they fit best."""
    channel = problem.channel
    if not channel.conditions.airs_known.all():
        return with_airs(problem, model, Point(theta, deviations))[1]
    return np.asarray((channel.count * (channel.value - model.predict(Point(theta, deviations))) ** 2).sum(axis=-1))


def open_starts(problem: Problem) -> NDArray[np.bool_]:
    """True for the random effects (R, U) that are start times which nobody recorded."""
    mask = ~problem.stated
    mask[:, RunEffect.START + 1 :] = False
    return np.asarray(mask)


def late_starts_s(problem: Problem) -> Array:
    """How much later than estimated starts that nobody recorded are tried (K, R) [s]."""
    conditions = problem.channel.conditions
    late_s = LATE_S * float(conditions.start_scatter_s[~conditions.start_known].max()) / USUAL_SCATTER_S
    return np.concatenate([np.tile(late_s[:, None], conditions.start_known.size), begun_starts_s(problem.channel)])


def begun_starts_s(channel: Channel) -> Array:
    """Starts (K, R) [s] of runs whose record begins in the response, 0 for others; none (0, R) where no run does so.

    How long before, nothing says: just before the first reading or just behind it, and ever longer ago. What is fast
    in a response lets the beginning show only there, in a narrow valley that no even grid meets.
    """
    first_s = channel.begun_s
    if not first_s.any():
        return np.zeros((0, first_s.size))
    ago_s = np.geomspace(0.1, np.maximum(first_s / channel.sampling_period_s, 1.0), STARTS_AGO)
    since = np.concatenate([-ago_s, np.tile(WITHIN_PERIOD[:, None], first_s.size)]) * channel.sampling_period_s
    return np.where(first_s > 0.0, first_s + since, 0.0)


def rough_point(problem: Problem, structure: Structure, choice: Mapping[str, float] | None = None) -> Point:
    """Rough rates, and each unrecorded start where the model at them leaves least; `choice` as in `Model.start`."""
    channel, model = problem.channel, Model(problem.channel, structure)
    deviations = channel.at_rest()
    theta = model.start(rough_rates(problem, structure, choice=choice), choice)
    if channel.conditions.start_known.all():
        return Point(theta, deviations)
    late_s = late_starts_s(problem)
    for _ in range(2):
        tried = np.tile(deviations, (len(late_s), 1, 1))
        tried[..., RunEffect.START] = np.where(channel.conditions.start_known, 0.0, late_s)
        squares = _left(problem, model, np.tile(theta, (len(late_s), 1)), tried)
        best = late_s[np.argmin(squares, axis=0), np.arange(channel.runs)]
        deviations[:, RunEffect.START] = np.where(channel.conditions.start_known, 0.0, best)
        theta[model.rates] = fit(problem, structure, theta, deviations, iterations=10).log_rates
    return Point(theta, deviations)


def scanned_starts(problem: Problem, found: Fit) -> Array | None:
    """Deviations with starts moved to where runs fit better, looked for on a grid; None where none does.

    A film's response begins like sqrt(t): no gradient leads a start across a sample that lies at the very transfer. A
    start that nobody recorded is looked for between the next readings, in a record that begins in the response ever
    longer before that, and in a run that misfits as far as it may be; where the model is plainly wrong, the last alone.
    """
    channel, known = problem.channel, problem.channel.conditions.start_known
    misfits = run_misfit(problem, found) > STUCK_MEAN_SQUARE
    scanned = misfits if plainly_wrong(problem, found) else misfits | ~known
    if channel.jumps_with_air:
        scanned &= ~jumps(channel.conditions)  # elsewhere samples at the jump are muted
    if not scanned.any():
        return None
    index = np.flatnonzero(scanned)
    part, late = problem.select(index), found.deviations[index]
    now = late[:, RunEffect.START]
    starts = [now[None]]
    if not known[index].all():
        starts.append(now + NEXT_READINGS[:, None] * np.where(known[index], 0.0, channel.sampling_period_s))
        begun_s = begun_starts_s(channel)[:, index]
        starts.append(np.where(known[index] | (begun_s == 0.0), now, begun_s))
    if misfits[index].any():
        starts.append(np.where(misfits[index], START_GRID[:, None] * part.scatter[:, RunEffect.START], now))
    starts_s = np.concatenate(starts)
    tried = np.tile(late, (starts_s.shape[0], 1, 1))
    tried[:, :, RunEffect.START] = starts_s
    tried, left = with_airs(part, found.model.on(part.channel), Point(found.theta, tried))
    best = np.argmin(left, axis=0)
    better = left[0] - left.min(axis=0) > LEAST_GAIN
    if not better.any():
        return None
    moved = found.deviations.copy()
    moved[index[better]] = tried[best[better], np.flatnonzero(better)]
    return np.asarray(moved)


def plainly_wrong(problem: Problem, found: Fit) -> bool:
    """Whether a fit is so far off that the runs' deviations, and the last digits of its misfit, mean nothing."""
    return found.objective > PLAINLY_WRONG * problem.channel.count.size


def unstuck(problem: Problem, found: Fit, iterations: int = MOST_STEPS) -> Fit:
    """The fit with the runs moved that are stuck on one side of a step: one of them may pass for an effect.

    Where the model is plainly wrong, those alone whose starts nobody recorded: they are all that it has to go by.
    """
    if not found.converged:
        return found
    wrong = plainly_wrong(problem, found)
    known = problem.channel.conditions.start_known
    if wrong and known.all():
        return found
    for _ in range(MOST_SCANS):
        moved = scanned_starts(problem, found)
        if moved is None:
            break
        if wrong:
            moved = np.where(known[:, None], found.deviations, moved)
        again = fit(problem, found.structure, found.theta, moved, iterations)
        if again.deviance > found.deviance - LEAST_GAIN:
            break
        found = again
    across = _across_reading(problem, found)
    if across is not None:
        found = min((found, fit(problem, found.structure, found.theta, across, iterations)), key=lambda f: f.deviance)
    return found


def _across_reading(problem: Problem, found: Fit) -> Array | None:
    """Deviations with all starts beyond the readings next to them, where all are unrecorded and every run misfits: of
    a run alone, or of records that all begin with their response.

    The objective has a valley between each two readings. A scan that holds the rest goes from one to the other where
    other runs, or plateaus, say what the rest is. There starts, shares and rates are found together in each of them:
    two exponentials that begin earlier are two with other shares.
    """
    channel = problem.channel
    if channel.conditions.start_known.any() or (channel.runs > 1 and (channel.begun_s == 0.0).any()):
        return None
    if (run_misfit(problem, found) <= STUCK_MEAN_SQUARE).any():
        return None
    moved = found.deviations.copy()
    for run, start_s in enumerate(found.deviations[:, RunEffect.START]):
        time_s = np.sort(channel.time_s[run, channel.count[run] > 0])
        nearest = int(np.argmin(np.abs(time_s - start_s)))
        beyond = nearest + (1 if start_s < time_s[nearest] else -1)
        if not 0 <= beyond < time_s.size:
            return None
        moved[run, RunEffect.START] = 0.5 * (time_s[nearest] + time_s[beyond])
    return np.asarray(moved)


POPULATION = 15
GENERATIONS = 60
LAST_STEP_OF_RATE = 1e-6  # in ln rate, at which a descent ends
LAST_STEP_OF_START = 1e-3  # of a parameter as it is fitted, where a fit goes on from there
MOST_EVALUATIONS = 300  # of a descent, for each parameter
FIRST_STEP = 0.3  # of the way between a parameter's bounds


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


def better(both: tuple[Optimum, Optimum]) -> Optimum:
    """Which of two searches left less: a fit begins from it, so that one of them may end far from the best rate."""
    return min(both, key=lambda one: one.rmse)


def descend(misfit: Misfit) -> Optimum:
    """Best rate by nlopt's SBPLX (Rowan 1990), downhill from where the readings are half-way.

    It shares nothing with `evolve`, which looks everywhere and ends within its tolerance of the best rate: this one
    ends at the bottom of the valley in which the readings say that the rate is.
    """
    low, high = np.log(RATE_BOUNDS_PER_S)
    start = np.clip(half_way(misfit.channel), low + 1e-6, high - 1e-6)
    best, rmse, evaluations = _downhill(
        lambda x: float(misfit(x)[0]),
        np.array([start]),
        np.array([low]),
        np.array([high]),
        np.array([0.3]),
        LAST_STEP_OF_RATE,
    )
    return Optimum(float(best[0]), rmse, evaluations)


def descended_point(problem: Problem, structure: Structure) -> Point:
    """Where a fit of a model with effects may begin, whatever values are stated for them.

    SBPLX lowers the penalised sum of squares over all parameters, from the catalogue's starts and rates that a scan
    finds beside them. It takes no derivative, and so crosses flat stretches on which Gauss and Newton stop.
    """
    model, start = Model(problem.channel, structure), rough_point(problem, structure)
    low, high = model.bounds()
    best, _, _ = _downhill(
        lambda theta: objective_at(problem, model, Point(theta, start.deviations)),
        np.clip(start.theta, low, high),
        low,
        high,
        np.minimum(model.reach(), FIRST_STEP * (high - low)),
        LAST_STEP_OF_START,
    )
    return Point(best, start.deviations)


def _downhill(
    function: Callable[[Array], float], start: Array, low: Array, high: Array, step: Array, last_step: float
) -> tuple[Array, float, int]:
    """The minimum that nlopt's SBPLX finds: place, value there, evaluations."""
    import nlopt  # type: ignore[import-untyped]

    optimiser = nlopt.opt(nlopt.LN_SBPLX, start.size)
    optimiser.set_lower_bounds(low)
    optimiser.set_upper_bounds(high)
    optimiser.set_initial_step(step)
    optimiser.set_xtol_abs(last_step)
    optimiser.set_maxeval(MOST_EVALUATIONS * start.size)
    optimiser.set_min_objective(lambda x, _: float(np.nan_to_num(function(x), nan=np.inf)))
    best = optimiser.optimize(start)
    return np.asarray(best), float(optimiser.last_optimum_value()), int(optimiser.get_numevals())


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
