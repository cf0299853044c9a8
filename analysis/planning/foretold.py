"""The evidence that is expected of a run before it is made, as `evidence.against` will count it once it is there.

Were i true, and to first order in what either model may still move by, for rival j and one further run:

    2 E[ln E_ij] = |f_i - f_j|^2 - ln det N_i(with it) / N_i
        + at the first run of a dispute: lam p_j - tr[(N + lam N_old)^-1 (N + lam^2 N_old)]_j + p_j ln(1 - lam)

The distance is what is left of it once j and the run's random effects have moved, the old runs counting lam for j; the
determinant is what i pays for predicting with parameters that are not quite known, the last line what j is allowed.
A run at an ambient of which a film's rate is not known yet says nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.arrow import Arrow
from shockrig.analysis.inference.fit import linearise
from shockrig.analysis.inference.model import Point
from shockrig.analysis.planning.evidence import OLD_RUNS_POWER, REJECTED, student
from shockrig.analysis.planning.hypothetical import imagined
from shockrig.analysis.planning.information import each_run, nats, rates_known
from shockrig.analysis.planning.judged import ChannelLook
from shockrig.analysis.planning.shock import PlannedShock

Array = NDArray[np.float64]


def expected_evidence(looks: Sequence[ChannelLook], shocks: Sequence[PlannedShock]) -> list[float]:
    """ln E (M,) against the explanation that each run, made once, is expected to hurt most; 0 where nothing is tied.

    Averaged over which explanation is true, each as likely as the evidence so far leaves it.
    """
    expected = np.zeros(len(shocks))
    for look in looks:
        if len(look.rivals) > 1 and look.problem is not None and look.verdict.dispute is not None and shocks:
            now = np.array([x for x in look.verdict.against if x < REJECTED])
            likely = np.exp(now.min() - now)
            told = [_if_true(look, i, now, shocks) for i in range(len(look.rivals))]
            known = rates_known(look.problem.channel, shocks)
            expected = np.maximum(expected, known * (likely @ np.array(told) / likely.sum()))
    return [float(x) for x in expected]


def _if_true(look: ChannelLook, i: int, now: Array, shocks: Sequence[PlannedShock]) -> Array:
    """ln E (M,) that runs would add against the most hurt rival of explanation i."""
    assert look.problem is not None and look.noise is not None and look.verdict.dispute is not None
    problem, true = look.problem, look.rivals[i]
    new = imagined(problem.with_rate_scatter(true.rate_scatter), look.noise, shocks, problem.channel.ambients_c)
    at_rest = new.channel.at_rest()
    truth, own = linearise(new, true.structure, Point(true.theta, at_rest))
    every = range(true.theta.size)
    known = true.arrow.normal
    paid = [2.0 * nats(known, known + one.normal - _prior(one), every) for one in each_run(own)]
    old = np.isin(problem.channel.run_ids, look.verdict.dispute.runs)
    degrees = look.verdict.dispute.degrees(problem.channel.rates)
    found = np.full(len(shocks), -np.inf)
    for j, rival in enumerate(look.rivals):
        if j == i:
            continue
        there, arrow = linearise(new, rival.structure, Point(rival.theta, at_rest))
        before = _of_runs(rival.arrow, old)
        moves = rival.arrow.normal - (1.0 - OLD_RUNS_POWER) * (before.normal - _prior(before))
        for m, one in enumerate(each_run(arrow)):
            difference = new.whiten(truth - there)[m : m + 1]
            right, _ = one.right_sides(difference, at_rest[m : m + 1], np.zeros(rival.theta.size))
            added = one.normal - _prior(one)
            absorbed = float(right @ np.linalg.lstsq(moves + added, right, rcond=None)[0])
            twice = max(one.hidden(difference) - absorbed, 0.0) - paid[m]
            if old.all():
                twice += _allowed(added, before.normal - _prior(before), rival.theta.size)
            so_far = _not_student(float(now[j]), degrees)
            told = student(so_far + 0.5 * twice, degrees) - float(now[j])
            found[m] = max(found[m], told)
    return found


def _allowed(added: Array, old: Array, free: int) -> float:
    """What a rival of so many parameters may gain by the old runs, less what the bound takes off for it."""
    scale = np.sqrt(np.maximum(np.diag(old), 1e-12))
    new, then = added / np.outer(scale, scale), old / np.outer(scale, scale)
    inverse = np.linalg.pinv(new + OLD_RUNS_POWER * then, rcond=1e-11, hermitian=True)
    fitted = float(np.trace(inverse @ (new + OLD_RUNS_POWER**2 * then)))
    return OLD_RUNS_POWER * free - fitted + free * float(np.log1p(-OLD_RUNS_POWER))


def _of_runs(arrow: Arrow, runs: NDArray[np.bool_]) -> Arrow:
    return replace(arrow, **{name: getattr(arrow, name)[runs] for name in ("jacobian", "run_jacobian", "weight")})


def _prior(arrow: Arrow) -> Array:
    return np.diag(arrow.prior_weight)


def _not_student(said: float, degrees: int) -> float:
    """The log ratio of which `student` says that."""
    return 0.5 * degrees * float(np.expm1(2.0 * said / (degrees + 1))) if said > 0.0 else said
