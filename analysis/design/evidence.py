"""Evidence between tied explanations that holds however often one looks: e-values from runs recorded after the tie.

For a rival j, fitted anew, against explanation i, whose prediction of the new runs rests on earlier runs alone:

    2 ln E_ij = dev_j(new + lam old) - lam dev_j(old) + p_j ln(1 - lam)
                - [dev_i(old + new) - dev_i(old) + ln det N_i(old + new) / N_i(old)]

The bracket is -2 ln of the predictive density of the new runs (Laplace), however these were chosen. The rest bounds
what the rival can reach: its old likelihood ratio, chi-square of p_j degrees of freedom were it true, is raised to a
power lam < 1, whose mean is (1 - lam)^(-p_j / 2). So E_ij has mean at most 1 where j is true, and by Ville's
inequality exceeds 100 at any look with probability at most 1 % (universal inference: Wasserman, Ramdas and Balakrishnan
2020, doi 10.1073/pnas.1922664117). Against j stands the mean of E_ij over all i, which is an e-value too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.design.explanation import Explanation, explained_by, fitted, label_of
from shockrig.analysis.design.information import imagined, nats, rates_known, shown
from shockrig.analysis.design.menu import PlannedShock
from shockrig.analysis.estimate.arrow import Arrow
from shockrig.analysis.estimate.fit import Fit, fit
from shockrig.analysis.estimate.model import Model, Structure
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.problem import Problem, posterior_scatter, prior_cost

Array = NDArray[np.float64]
OLD_RUNS_POWER = 0.5  # power of the old runs' likelihood
FALSE_ALARMS = 0.01  # of campaigns in which a look may choose wrongly
REJECTED_FROM = -float(np.log(FALSE_ALARMS))  # ln E from which an explanation is out
MOST_TOLD = REJECTED_FROM - 0.5  # ln E against a rival, of one that still stands
FEWEST_DEGREES = 4  # of a variance that runs tell: what sensors usually do is known before any


@dataclass(frozen=True)
class Dispute:
    """Explanations that were tied at one look, the likeliest first, the runs that had been recorded by then, and ln E
    against each by now."""

    explanations: tuple[Explanation, ...]
    runs: tuple[str, ...]
    against: tuple[float, ...] = ()

    @property
    def standing(self) -> tuple[Explanation, ...]:
        """Explanations that are not out."""
        return tuple(e for e, x in zip(self.explanations, self.against, strict=True) if x < REJECTED_FROM)

    @property
    def so_far(self) -> tuple[float, ...]:
        """ln E against each of those."""
        return tuple(x for x in self.against if x < REJECTED_FROM)

    def degrees(self, rates: int) -> int:
        """Degrees of freedom with which the scatter of runs was known then."""
        return max(len(self.runs) - rates, FEWEST_DEGREES)

    def labels(self) -> list[str]:
        """What sets each explanation apart from the others."""
        return [label_of(e, self.explanations) for e in self.explanations]


class OpenDispute(NamedTuple):
    """Explanations that stand beside one another: their fits, to which problem, and the dispute that they are of."""

    problem: Problem
    noise: Noise
    fits: tuple[Fit, ...]
    dispute: Dispute

    @classmethod
    def begun(cls, problem: Problem, noise: Noise, fits: Sequence[Fit]) -> OpenDispute:
        """One of fits that are tied by all runs so far."""
        explanations = tuple(explained_by(one) for one in fits)
        dispute = Dispute(explanations, problem.channel.run_ids, (0.0,) * len(fits))
        return cls(problem, noise, tuple(fits), dispute)


def against(problem: Problem, base: Structure, dispute: Dispute) -> list[float]:
    """ln E against each explanation, 0 before any new run; `problem` holds old and new runs.

    Runs at ambients that the old ones did not have say nothing: their rates are known to no explanation.
    """
    channel = problem.channel
    old = np.isin(channel.run_ids, dispute.runs)
    seen = np.isin(channel.ambient, channel.ambient[old])
    count = len(dispute.explanations)
    if not (seen & ~old).any() or not old.any() or count < 2:
        return [0.0] * count
    part = replace(problem.select(seen), channel=problem.channel.select(seen).without_lost_ambients())
    is_old = old[seen]
    told = [_predicted_and_bound(part, is_old, fitted(part.select(is_old), e, base)) for e in dispute.explanations]
    degrees = dispute.degrees(channel.rates)
    out = []
    for j, (_, bound) in enumerate(told):
        others = [student(0.5 * (bound - predicted), degrees) for i, (predicted, _) in enumerate(told) if i != j]
        out.append(float(np.logaddexp.reduce(others) - np.log(len(others))))
    return out


def student(log_ratio: float, degrees: int) -> float:
    """A log-likelihood ratio with the scatter of runs known from so many degrees of freedom."""
    return 0.5 * (degrees + 1) * float(np.log1p(2.0 * log_ratio / degrees)) if log_ratio > 0.0 else log_ratio


# What is expected of a run before it is made, to first order in what models may still move by. Were i true, for
# alternative j:
#
#     2 E[ln E_ij] = |f_i - f_j|^2 - ln det N_i(with it) / N_i
#         + at the first run of a dispute: lam p_j - tr[(N + lam N_old)^-1 (N + lam^2 N_old)]_j + p_j ln(1 - lam)
#
# The distance is what is left of it once j and the run's random effects have moved, the old runs counting lam for j;
# the determinant is what i pays for predicting with parameters that are not quite known, the last line what j is
# allowed.


def expected(tied: OpenDispute, shocks: Sequence[PlannedShock]) -> tuple[Array, Array]:
    """ln E (K, K, M) that each run, made once, is expected to add for explanation i, were it true, against j; and the
    same without what j is allowed once, at the first run of a dispute: what each further run adds.

    A run at an ambient of which a film's rate is not known yet says nothing.
    """
    channel, fits, dispute = tied.problem.channel, tied.fits, tied.dispute
    degrees, so_far = dispute.degrees(channel.rates), dispute.so_far
    old = np.isin(channel.run_ids, dispute.runs)
    found, each_further = np.zeros((2, len(fits), len(fits), len(shocks)))
    white, there = _imagined_under(tied, shocks, [(one.structure, one.theta) for one in fits])
    for i, true in enumerate(fits):
        known = true.arrow.normal
        paid = [2.0 * nats(known, known + told, range(true.theta.size)) for told in there[i][i].told_by_each]
        for j, rival in ((j, one) for j, one in enumerate(fits) if j != i):
            told = rival.arrow.of_runs(old).told
            twice = _apart(white[i] - white[j], there[i][j], rival.arrow.told - (1.0 - OLD_RUNS_POWER) * told) - paid
            once = _allowed(there[i][j].told_by_each, told) if old.all() else np.zeros(len(shocks))
            before = _not_student(so_far[j], degrees)
            for out, adds in ((found, twice + once), (each_further, twice)):
                out[i, j] = [student(before + 0.5 * float(x), degrees) - so_far[j] for x in adds]
    known_there = rates_known(channel, shocks)
    return found * known_there, each_further * known_there


def _imagined_under(
    tied: OpenDispute, shocks: Sequence[PlannedShock], models: Sequence[tuple[Structure, Array]]
) -> tuple[list[Array], list[list[Arrow]]]:
    """What each explanation's model, at its theta, shows of runs, whitened (M, n); and, with the scatter of rates of
    each explanation, the normal equations there of each one's."""
    new = imagined(tied.problem, tied.noise, shocks, tied.problem.channel.ambients_c)
    at = [shown(new, structure, theta) for structure, theta in models]
    weights = [1.0 / new.with_rate_scatter(one.rate_scatter).scatter ** 2 for one in tied.fits]
    white = [new.whiten(readings) for readings, _ in at]
    return white, [[replace(arrow, weight=weight) for _, arrow in at] for weight in weights]


def _apart(difference: Array, there: Arrow, known: Array) -> Array:
    """How far (M,) imagined runs are from a rival's, squared, in standard deviations: from whitened differences (M, n)
    and the rival's normal equations of these runs.

    Less what a run's random effects could hide, and the rival's parameters as far as their priors and a precision
    `known` (P, P) leave them open.
    """
    left, right = there.beyond_runs(difference)
    told = known + np.diag(there.prior_weight) + there.told_by_each
    move = np.linalg.pinv(told, rcond=len(known) * np.finfo(float).eps, hermitian=True) @ right[..., None]
    return np.maximum(left - (right * move[..., 0]).sum(axis=1), 0.0)


def of_second_probe(tied: OpenDispute, shocks: Sequence[PlannedShock]) -> Array:
    """ln E (M,) that a second probe of the type, recorded beside the first in each run, adds to that, against the
    explanation that it hurts most, whichever is the true one.

    It shows what the air does as the first one does, and none of the faults that are the first one's own. Its rate is
    its own, and so are its runs' random effects: what it says of a start that both share is not counted.
    """
    channel, fits, dispute = tied.problem.channel, tied.fits, tied.dispute
    degrees = dispute.degrees(channel.rates)
    common = frozenset.intersection(*(frozenset(one.structure.ids) for one in fits))
    of_second = [_as_of_second(one, common) for one in fits]
    white, there = _imagined_under(tied, shocks, [(structure, theta) for structure, theta, _ in of_second])
    found = np.zeros((len(fits), len(fits), len(shocks)))
    for i, j in permutations(range(len(fits)), 2):
        twice = _apart(white[i] - white[j], there[i][j], of_second[j][2])
        found[i, j] = [student(0.5 * float(x), degrees) for x in twice]
    return _averaged(found.max(axis=1) * rates_known(channel, shocks), dispute)


def _as_of_second(found: Fit, common: frozenset[str]) -> tuple[Structure, Array, Array]:
    """An explanation of one probe's runs as a second probe's: effects of the surroundings, those that no rival denies;
    its theta, and what the first one's runs say of the effects (a precision)."""
    model = found.model
    kept = found.structure.keeping(common | {e.id for e in found.structure.effects if e.of_surroundings})
    effects = [model.place(name) for name in kept.names]
    rates = range(model.channel.rates)
    places = [*rates, *effects, *range(model.size - len(model.shared), model.size)]
    known = np.zeros((len(places), len(places)))
    here = slice(len(rates), len(rates) + len(effects))
    known[here, here] = np.linalg.pinv(found.covariance[np.ix_(effects, effects)], hermitian=True)
    return kept, found.theta[places], known


def told_apart(disputes: Iterable[OpenDispute], shocks: Sequence[PlannedShock]) -> tuple[Array, Array, Array]:
    """Of all pairs of tied explanations `pairs`, `needed` and `evidence`, as `Prospects` has them."""
    pairs, needed, evidence = [], [], np.zeros(len(shocks))
    for tied in disputes:
        told, each_further = expected(tied, shocks)
        evidence = np.maximum(evidence, _averaged(told.max(axis=1), tied.dispute))
        for i, j in permutations(range(len(told)), 2):
            pairs.append(np.maximum(each_further[i, j], 0.0))
            needed.append(REJECTED_FROM - float(np.clip(tied.dispute.so_far[j], 0.0, MOST_TOLD)))
    return np.array(pairs).reshape(len(pairs), len(shocks)), np.array(needed), evidence


def _averaged(told: Array, dispute: Dispute) -> Array:
    """Mean (M,) over which explanation is true (K, M), each as likely as the evidence so far leaves it."""
    so_far = np.array(dispute.so_far)
    likely = np.exp(so_far.min() - so_far)
    return np.asarray(likely @ told / likely.sum())


def _allowed(added: Array, old: Array) -> Array:
    """What a rival may gain (M,) by the old runs (P, P), less what the bound takes off for it, where runs add
    (M, P, P)."""
    free, scale = len(old), np.sqrt(np.maximum(np.diag(old), 1e-12))
    new, then = added / np.outer(scale, scale), old / np.outer(scale, scale)
    inverse = np.linalg.pinv(new + OLD_RUNS_POWER * then, rcond=1e-11, hermitian=True)
    fitted = np.trace(inverse @ (new + OLD_RUNS_POWER**2 * then), axis1=1, axis2=2)
    return np.asarray(OLD_RUNS_POWER * free - fitted + free * np.log1p(-OLD_RUNS_POWER))


def _not_student(said: float, degrees: int) -> float:
    """The log ratio of which `student` says that."""
    return 0.5 * degrees * float(np.expm1(2.0 * said / (degrees + 1))) if said > 0.0 else said


def _predicted_and_bound(problem: Problem, old: NDArray[np.bool_], rough: Fit) -> tuple[float, float]:
    """-2 ln of an explanation's predictive density of the new runs, and of the most that it can reach as a rival.

    For the latter the old runs' likelihood, random effects integrated out, is raised to the power `OLD_RUNS_POWER`.
    """
    before, structure = problem.select(old), rough.structure
    scatter = posterior_scatter([rough.own_rates()])
    then = _fit(before.with_rate_scatter(scatter), structure, rough)
    every = problem.with_rate_scatter(scatter)
    now = _fit(every, structure, then)
    weight = np.where(old, np.sqrt(OLD_RUNS_POWER), 1.0)
    less = replace(every, whitener=every.whitener * weight[:, None, None], scatter=every.scatter / weight[:, None])
    tempered = _fit(less, structure, now)
    added = 2.0 * nats(then.arrow.normal, now.arrow.normal, range(now.theta.size))
    predicted = now.deviance - then.deviance + added
    own = then.deviance - then.objective - float(prior_cost(np.array(then.rate_scatter)))
    free = len(structure.parameters) + before.channel.rates
    reached = tempered.deviance - float(prior_cost(np.array(scatter))) - (OLD_RUNS_POWER * then.objective + own)
    return float(predicted), float(reached + free * np.log1p(-OLD_RUNS_POWER))


def _fit(problem: Problem, structure: Structure, near: Fit) -> Fit:
    """A fit at a held scatter of rates, from the parameters of another one."""
    theta = Model(problem.channel, structure).start(near.log_rates, near.choice)
    return fit(problem, structure, theta, adapt_scatter=False)
