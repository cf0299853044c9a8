"""What candidates beside a model promise before any of them is fitted: by how much each would raise the likelihood, to
first order (Rao's score beside the model's own parameters; doi 10.1017/S0305004100023987).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnose.candidates import Candidate, in_group_of
from shockrig.analysis.diagnose.grammar import splits
from shockrig.analysis.diagnose.pool import Rated
from shockrig.analysis.effects.forms import ONLY_BEFORE, ONLY_FROM
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import by_name
from shockrig.analysis.estimate.model import Model, Point
from shockrig.analysis.estimate.predictive import DISCREPANCIES
from shockrig.analysis.estimate.problem import RATE_SCATTER, Problem
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.estimate.refitting import rate_shift

Array = NDArray[np.float64]
Starts = Sequence[Mapping[str, float]]
Screened = tuple[Candidate, Starts, float]  # with what the best start promises [nats]

LEAST_VARIANCE = 1e-9  # of the score of a column that may say something
FAR_DISCREPANCY = 0.005  # discrepancy, as a share of the step, from which the runs' deviations mean little


def promises(problem: Problem, near: Rated, bump: Array, among: Sequence[Candidate]) -> list[Screened]:
    """Candidates beside a model, each with its starts, the best first, and what the best promises."""
    if not among:
        return []
    columns = [_columns(problem, near, one, (*one.starts, *one.weakest)) for one in among]
    right, size = _first_order(problem, near, bump, np.concatenate(columns, axis=-1))
    most = np.concatenate([np.full(c.shape[-1], one.furthest) for one, c in zip(among, columns, strict=True)])
    gains = _promised(right, size, most)
    out: list[Screened] = []
    for one, own in zip(among, np.split(gains, np.cumsum([c.shape[-1] for c in columns])[:-1]), strict=True):
        best = np.maximum(own[: len(one.starts)], own[len(one.starts) :].max(initial=0.0))
        order = np.argsort(-own[: len(one.starts)], kind="stable")
        out.append((one, [one.starts[i] for i in order], float(best.max())))
    return out


def best_group(problem: Problem, near: Rated, bump: Array, one: Candidate) -> Candidate | None:
    """A bare form in that group of runs in which it promises most; None where no other runs tell as much of it as one
    of all runs does: what it does in them would be anything."""
    hows, sides = _sides(problem.channel)
    right, size = _first_order(problem, near, bump, _columns(problem, near, one, one.starts), sides)
    tells = size.sum(axis=1)
    others = np.roll(tells, len(hows) // 2)  # of the runs that are not in a group
    told = np.minimum(tells, others) * problem.channel.runs > tells + others
    promised = np.where(told, _promised(right, size, one.furthest).max(axis=1), -np.inf)
    side = int(np.argmax(promised))
    return in_group_of(one, hows[side], problem.channel) if promised[side] > -np.inf else None


def _sides(channel: Channel) -> tuple[list[str], Array]:
    """The groups of runs, from each run on and before it, as a dependence says them, and 1 for their runs (K, R)."""
    firsts = splits(channel)
    late = channel.conditions.order >= np.array(firsts)[:, None]
    hows = [f"{only}{first}" for only in (ONLY_FROM, ONLY_BEFORE) for first in firsts]
    return hows, np.concatenate([late, ~late]).astype(float)


def _columns(problem: Problem, near: Rated, one: Candidate, starts: Starts) -> Array:
    """What a candidate changes at each of some starts, whitened (R, n, C)."""
    found = near.fit
    model = Model(problem.channel, found.structure.adding(one.effect))
    rates = found.log_rates + rate_shift(one.effect, problem.channel)
    thetas = []
    for start in starts:
        theta = model.start(rates, found.choice | by_name(one.effect, start))
        theta[model.behind] = found.theta[found.model.behind]
        thetas.append(theta)
    predicted = model.predict(Point(np.stack(thetas), found.deviations)) - found.at.prediction
    return problem.whiten(np.moveaxis(predicted, 0, -1))


def _first_order(
    problem: Problem, near: Rated, bump: Array, columns: Array, groups: Array | None = None
) -> tuple[Array, Array]:
    """Scores of columns and their variances, beside the model's parameters, discrepancy and random effects; with groups
    (K, R) those of each column in each group of runs alone."""
    # A candidate may end what the model so far is wrong by: that is not to hide what it promises.
    # Nor is how much runs differ in their rates, where that is more than sensors usually do.
    found, sigma = near.fit, np.clip(near.score.discrepancy, DISCREPANCIES[1], FAR_DISCREPANCY)
    own = found.arrow.weight.copy()
    own[:, RunEffect.RATE] = np.maximum(own[:, RunEffect.RATE], 1.0 / RATE_SCATTER**2)
    own[:, RunEffect.DRIFT] = np.maximum(own[:, RunEffect.DRIFT], 1.0 / problem.scatter[:, RunEffect.DRIFT] ** 2)
    discrepancy = np.full((bump.shape[0], bump.shape[-1]), 1.0 / sigma**2)
    beside = replace(
        found.arrow,
        run_jacobian=np.concatenate([found.arrow.run_jacobian, bump], axis=-1),
        weight=np.concatenate([own, discrepancy], axis=-1),
    )
    return found.score_variances(problem, columns, beside, groups)


def _promised(right: Array, size: Array, furthest: Array | float) -> Array:
    """What columns promise [nats] by their scores and variances, each taken no more than so many times."""
    times = np.clip(right / np.maximum(size, LEAST_VARIANCE), -furthest, furthest)
    return np.asarray(np.where(size > LEAST_VARIANCE, times * right - 0.5 * times**2 * size, 0.0))
