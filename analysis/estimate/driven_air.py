"""Runs whose air was measured: how slow the sensor is behind it, bins that are narrow where it has far to go, the trace
averaged to match them, and a sensor that had not settled when its record began.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.fit_starts import rough_rates
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.predictive import BUMP_COUNT
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.without_model import MAD_TO_SIGMA
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.chain import MeasuredAir
from shockrig.analysis.physics.driven import beside_lagging_reference, noise_passed
from shockrig.analysis.physics.modes import Modes, slowest

Array = NDArray[np.float64]

# What the noise of a measured air does to the prediction of a sensor that is driven by it.

COSINE_MODES = 12


def trace_noise(trace: Array) -> float:
    """White noise of a trace (m,), from its second differences, which straight lines leave at zero."""
    bends = trace[2:] - 2 * trace[1:-1] + trace[:-2]
    return float(MAD_TO_SIGMA * np.median(np.abs(bends)) / np.sqrt(6.0)) if bends.size > 5 else 0.0


def with_reference_noise(noise: Noise, problem: Problem) -> Noise:
    """The readings' noise, and beside it what the references' noise makes of a prediction by the plain model.

    Through modes of rate lambda a sample's noise becomes that of a first-order process of about their slowest rate
    (`shockrig.analysis.physics.driven.noise_passed`).
    """
    channel = problem.channel
    rate = float(np.exp(np.median(rough_rates(problem))))
    body = slowest(BODIES[channel.body].held().scaled(rate), COSINE_MODES)
    passed = [channel.reference_noise * _passed(air, body) for air in channel.air if air is not None]
    decay = float(np.exp(-float(np.min(body.rate)) * channel.sampling_period_s))
    return replace(noise, passed=float(np.median(passed)), passed_memory=min(decay, 0.999))


def _passed(air: MeasuredAir, body: Modes) -> float:
    period = float(np.median(np.diff(air.time_s)))
    modes = beside_lagging_reference(body, air.lag_s) if air.lag_s > 0 else body
    return float(np.max(noise_passed(modes, period)))


GRID_STEPS = 4000  # steps over a record on which a sensor is followed roughly
LAGS_TRIED, SLOWEST_LAG = 40, 5.0  # time constants; the longest in units of the record
GAIN_SPREAD = 0.03  # of two sensors in one air, relative: a trace that stands still tells nothing of it
MOST_BENDING = 0.5  # of the noise of a bin's mean: how much a bin may bend
FASTER_PART = 3.0  # a response is taken to have a part that is so much faster than the whole
QUIET_SIGMAS = 3.0  # times the noise: less of a departure is none
MOST_BINS = 400
NO_NOISE = 3.0  # standard deviations from which on a difference is none of the noise
TRACE_POINTS = 2  # of a measured air in each bin
EARLY_SHARE = 0.05  # of the time constant: first readings, from which little is forgotten
UNSETTLED_NOISE, UNSETTLED_SHARE = 6.0, 0.02  # times the noise, share of the readings' range: a smaller excess is none
MOVED_SHARE = 0.25  # of the excess: an air that has moved so far no longer stands


@dataclass(frozen=True)
class Followed:
    """A sensor followed through a record by a first-order lag, roughly.

    Attributes
    ----------
    time_s, departure : ndarray (m,)
        An even grid, and how far the air is from what the sensor shows there [the channel's unit].
    time_constant_s : float
    noise : float
        Of single readings and of the trace together [the channel's unit].
    excess : float
        By how much the sensor was off its own settled reading when the record began; 0 where it had settled.
    excess_uncertainty : float
        Its standard uncertainty: a rough one's is all of it, and all that the first readings are off the air may be it.
    """

    time_s: Array
    departure: Array
    time_constant_s: float
    noise: float
    excess: float
    excess_uncertainty: float = 0.0


@dataclass(frozen=True)
class _OnGrid:
    """A run on an even grid of `step` seconds: its air and its readings (m,), how far these are from it at their own
    times (n,), what both are known to, and the least excess that is one."""

    grid: Array
    step: float
    driving: Array
    reading: Array
    time_s: Array
    apart: Array
    noise: float
    least: float


def follow(runs: Sequence[tuple[Array, Array, Array, Array]], resolution: float) -> list[Followed]:
    """Follow a sensor behind measured airs: the first-order lag that leaves least of all runs together.

    A run is its times and readings (n,), and its air's times and values (m,). The lag, an offset and a gain are the
    sensor's, in all runs the same; each run departs from the offset by little, and begins with an excess that decays.
    On a ramp a lag is as good as an offset, and one run alone tells no excess from either: so an offset is about as
    large as what readings are off the air in all, an excess as what they are at most, and other runs tell the rest.
    """
    grids = [_on_grid(*run, resolution) for run in runs]
    step, longest = min(one.step for one in grids), max(float(np.ptp(one.grid)) for one in grids)

    known_to = _known_to(grids)

    def misfit(tau: float) -> float:
        return _behind(grids, known_to, tau)[0]

    taus = np.geomspace(step, SLOWEST_LAG * longest, LAGS_TRIED)
    near = min(taus, key=misfit)
    tau = float(min(near * np.geomspace(taus[0] / taus[1], taus[1] / taus[0], LAGS_TRIED // 2), key=misfit))
    _, shown, settled = _behind(grids, known_to, tau)
    return [_as_followed(one, tau, seen, off) for one, seen, off in zip(grids, shown, settled, strict=True)]


def _on_grid(time_s: Array, value: Array, air_time_s: Array, air: Array, resolution: float) -> _OnGrid:
    step = max((time_s[-1] - time_s[0]) / GRID_STEPS, 1e-3)
    grid = np.arange(time_s[0], time_s[-1] + step, step)
    noise = float(np.hypot(max(trace_noise(value), resolution), trace_noise(air)))
    return _OnGrid(
        grid,
        step,
        np.interp(grid, air_time_s, air),
        np.interp(grid, time_s, value),
        time_s,
        value - np.interp(time_s, air_time_s, air),
        noise,
        max(UNSETTLED_NOISE * noise, UNSETTLED_SHARE * float(np.ptp(value))),
    )


def _lagged(run: _OnGrid, tau: float) -> tuple[Array, Array]:
    """The air behind a lag that had settled to its first value, and how an excess decays; both (m,)."""
    from scipy.signal import lfilter  # takes longer to import than all the rest, and few campaigns measure their airs

    keep = np.exp(-run.step / tau)
    lagged = lfilter([1 - keep], [1, -keep], run.driving, zi=[keep * run.driving[0]])[0]
    return lagged, np.exp((run.grid[0] - run.grid) / tau)


def _known_to(runs: Sequence[_OnGrid]) -> Array:
    """What is known before any fit of an offset, a gain (nothing), and of each run's own offset and excess (2 + 2 R,):
    standard deviations about zero."""
    apart = [one.reading - one.driving for one in runs]
    known_to = np.full(2 + 2 * len(runs), np.inf)
    known_to[0] = np.sqrt(np.mean([np.mean(off**2) + one.noise**2 for one, off in zip(runs, apart, strict=True)]))
    known_to[2::2] = [one.least for one in runs]
    known_to[3::2] = [np.abs(off).max() + one.noise for one, off in zip(runs, apart, strict=True)]
    return known_to


def _behind(runs: Sequence[_OnGrid], known_to: Array, tau: float) -> tuple[float, list[Array], list[float]]:
    """How ill a lag fits [nats], what it shows of each run (m,), and by how much a settled reading is off there at its
    begin. What is left of a run counts as `BUMP_COUNT` errors that know nothing of one another."""
    middle, size = float(np.mean([one.driving[0] for one in runs])), known_to.size
    columns = [[0, 1, 2 + 2 * i, 3 + 2 * i] for i in range(len(runs))]  # as `_known_to` has them
    lags = [_lagged(one, tau) for one in runs]
    rests = [one.reading - lagged for one, (lagged, _) in zip(runs, lags, strict=True)]
    designs = [np.column_stack([held**0, lagged - middle, held**0, held]) for lagged, held in lags]
    normal, right = np.zeros((size, size)), np.zeros(size)
    for at, design, rest in zip(columns, designs, rests, strict=True):
        normal[np.ix_(at, at)] += design.T @ design / rest.size
        right[at] += design.T @ rest / rest.size
    still = np.where(np.arange(size) == 1, GAIN_SPREAD**-2.0 / GRID_STEPS, 0.0)
    square = float(np.mean([np.var(rest) + one.noise**2 for one, rest in zip(runs, rests, strict=True)]))
    prior = square * np.diag(still + known_to**-2.0 / BUMP_COUNT)
    found = np.linalg.lstsq(normal + prior, right, rcond=None)[0]
    left = [rest - design @ found[at] for at, design, rest in zip(columns, designs, rests, strict=True)]
    square = float(np.mean([np.mean(r**2) + one.noise**2 for one, r in zip(runs, left, strict=True)]))
    misfit = 0.5 * (BUMP_COUNT * len(runs) * np.log(square) + float(((found / known_to) ** 2).sum()))
    shown = [lagged + held * found[at[-1]] for at, (lagged, held) in zip(columns, lags, strict=True)]
    begins = found[0] + found[2::2] + found[1] * (np.array([one.driving[0] for one in runs]) - middle)
    return misfit, shown, begins.tolist()


def _as_followed(run: _OnGrid, tau: float, shown: Array, settled: float) -> Followed:
    early = run.time_s <= max(run.time_s[0] + EARLY_SHARE * tau, run.time_s[min(2, run.time_s.size - 1)])
    apart = float(np.mean(run.apart[early]))
    excess = (apart - settled) / float(np.mean(np.exp((run.time_s[0] - run.time_s[early]) / tau)))
    if not _forgets(excess, run.grid - run.grid[0], run.driving, run.reading, tau, run.least):
        excess = 0.0
    known_to = max(abs(excess), abs(apart), run.least)
    return Followed(run.grid, np.abs(run.driving - shown), tau, run.noise, excess, known_to)


def _forgets(excess: float, since_s: Array, air: Array, reading: Array, tau: float, least: float) -> bool:
    """Whether a reading is seen to lose an excess while the air still stands: else two calibrations only differ."""
    moved = np.flatnonzero(np.abs(air - air[0]) > MOVED_SHARE * abs(excess))
    end = int(min(moved[0] if moved.size else since_s.size, np.searchsorted(since_s, tau)))
    part = max(end // 10, 1)
    lost = float(np.mean(reading[:part]) - np.mean(reading[max(end - part, 0) : max(end, part)]))
    due = excess * -float(np.expm1(-since_s[min(end, since_s.size - 1)] / tau))
    return abs(excess) > least and abs(lost) > 0.5 * least and 0.5 < lost / (due or np.inf) < 2.0


def follow_step(time_s: Array, value: Array, resolution: float) -> Followed:
    """The same of a run whose air changed once, at time 0: what the reading is from its end departs."""
    end = float(np.median(value[-max(value.size // 20, 3) :]))
    departure = np.where(time_s > 0, np.abs(value - end), 0.0)
    most = float(np.max(departure, initial=0.0))
    late = time_s[(time_s > 0) & (departure > np.exp(-1.0) * most)]
    tau = float(late[-1]) if late.size else float(np.median(np.diff(time_s)))
    return Followed(time_s, departure, tau, max(trace_noise(value), resolution), 0.0)


def edges_of_driven(first_s: float, last_s: float, period_s: float, runs: Sequence[Followed]) -> Array:
    """Edges of bins over a record that is driven all along, so narrow that no mean bends by more than its noise.

    A first-order lag tau that is d from its air bends by d (w / tau)^2 / 24 over a bin of width w, and the mean of w /
    period readings has their noise over the root of that.
    """
    from scipy.ndimage import maximum_filter1d  # likewise

    grid = np.linspace(first_s - 0.5 * period_s, last_s + period_s, GRID_STEPS)
    density = np.zeros(grid.size)
    for run in runs:
        # Narrow also just before the air moves: the bin that it moves in must not begin long ago.
        reach = run.time_constant_s / FASTER_PART
        beyond = np.interp(grid, run.time_s, run.departure, left=0.0, right=0.0) - QUIET_SIGMAS * run.noise
        beyond = maximum_filter1d(beyond, 2 * int(np.ceil(0.5 * reach / (grid[1] - grid[0]))) + 1)
        bending = 24.0 * MOST_BENDING * run.noise * reach**2 * np.sqrt(period_s) / np.maximum(beyond, 1e-9)
        width = np.clip(bending**0.4, period_s, max(run.time_constant_s, period_s))
        density = np.maximum(density, 1.0 / width)
    passed = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(grid))])
    count = int(min(np.ceil(passed[-1]), MOST_BINS))
    return np.asarray(np.interp(np.linspace(0.0, passed[-1], count + 1), passed, grid))


def averaged_over(air: MeasuredAir, edges: Array) -> tuple[MeasuredAir, Array]:
    """A measured air averaged within the bins, `TRACE_POINTS` in each, and how many readings each mean (m,) is of; each
    stands at the mean of its times.

    What a bin averages, the air averages too: a prediction at its middle would carry all of the trace's noise.
    """
    parts = np.linspace(0.0, 1.0, TRACE_POINTS, endpoint=False)
    finer = (edges[:-1, None] + parts * np.diff(edges)[:, None]).ravel()
    _, group = np.unique(np.searchsorted(finer, air.time_s, side="right"), return_inverse=True)
    count = np.bincount(group).astype(float)

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(group, values) / count)

    time_s, temperature_c = mean(air.time_s), mean(air.temperature_c)
    return replace(air, time_s=time_s, temperature_c=temperature_c, humidity_percent=mean(air.humidity_percent)), count


def without_noise(air: MeasuredAir, count: Array) -> MeasuredAir:
    """An air without its reference's noise, its means being of `count` (m,) readings."""
    return replace(
        air,
        temperature_c=_smooth(air.time_s, air.temperature_c, count),
        humidity_percent=_smooth(air.time_s, air.humidity_percent, count),
    )


def _smooth(time_s: Array, values: Array, count: Array) -> Array:
    """A trace, means of `count` samples each, as smooth as cross validation says that the air was (Wahba 1990, doi
    10.1137/1.9781611970128): a spline of least curvature. Where the air jumped no spline follows it: no further
    from the trace than noise goes.

    A response that is smoother than the sensor's passes less of a reference's noise, predicts better for it, and would
    be taken for the sensor's.
    """
    from scipy.interpolate import make_smoothing_spline  # likewise

    noise = trace_noise(values) * np.sqrt(np.median(count) / count)
    if not (noise > 0.0).all():
        return values
    scale = (time_s[-1] - time_s[0]) / time_s.size
    smooth = np.asarray(make_smoothing_spline(time_s / scale, values, w=count)(time_s / scale))
    return np.clip(smooth, values - NO_NOISE * noise, values + NO_NOISE * noise)


def begun_unsettled(air: MeasuredAir, first_s: float, temperature_k: float, humidity_percent: float) -> MeasuredAir:
    """The air of a sensor that had settled to another one, off by so much, until its record began."""
    begin = min(first_s, float(air.time_s[0]))

    def before(values: Array, excess: float) -> Array:
        return np.concatenate([[values[0] + excess, values[0]], values])

    return replace(
        air,
        time_s=np.concatenate([[begin - 2e-6, begin - 1e-6], air.time_s]),
        temperature_c=before(air.temperature_c, temperature_k),
        humidity_percent=before(air.humidity_percent, humidity_percent),
    )
