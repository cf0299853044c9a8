"""Campaigns of one sensor over time: has a figure changed, by how much, and since which campaign?

ln x of campaign i = level + step after the change + what differs from campaign to campaign + what the bench shares:
    Cov_ij = r_i^2 [i = j] + c_i c_j [same bench],     c from what all runs of a campaign share.
An error that the bench has always had is no change, and a step that comes with another bench may be the bench's. The
step at each place is held against its uncertainty (Student's t, Bonferroni over places and figures); a history that has
one is cut there, and both parts are looked at again (binary segmentation, Scott and Knott 1974, doi 10.2307/2529204).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, stdtr

from shockrig.analysis.characterize.budget import Budget
from shockrig.files.campaign import Campaign
from shockrig.files.campaign_names import dated

Array = NDArray[np.float64]

# Of histories looked at once, in which anything may be said to have changed that has not. One that is looked at after
# each of a dozen campaigns has about five times as many chances, and 1 in 100 of those is what is promised
# (benchmarks/history_rates.py).
FALSE_ALARMS = 0.001
FIGURES_CHARTED = 4  # that are looked at together: alpha, D(20 degC), D over all ambients, t63
CHART_SIGMAS = 3.0  # standard uncertainties of a control chart's limits (Shewhart)
LEAST_DEGREES_OF_FREEDOM = 4.0
ALIKE_P_VALUE = 0.01  # probability below which stated uncertainties are not of one size


@dataclass(frozen=True)
class Observation:
    """A figure of one campaign.

    Attributes
    ----------
    campaign, began_at : str
    value : float
    random, common : float
        Relative standard uncertainties: what differs from campaign to campaign, and what its bench shares.
    degrees : float
        Of freedom, of `random`.
    bench : str
        The same text for campaigns with the same references, settings and calibrations.
    """

    campaign: str
    began_at: str
    value: float
    random: float
    common: float
    degrees: float
    bench: str


@dataclass(frozen=True)
class HistoryStep:
    """A step: the first campaign after it (its index), the relative change with its standard uncertainty, and the
    probability of one as large by accident, at any place and in any figure."""

    first: int
    relative: float
    standard_uncertainty: float
    probability: float


@dataclass(frozen=True)
class Chart:
    """A figure's history: observations, changes, and for each campaign the level before it with its limits.

    `level`, its `standard_uncertainty`, `low`, `high` (n,) are of the part of the history between two changes that a
    campaign belongs to.
    """

    figure: str
    serial: str
    unit: str
    observations: tuple[Observation, ...]
    changes: tuple[HistoryStep, ...]
    level: Array
    standard_uncertainty: Array
    low: Array
    high: Array


def began_at(campaign: Campaign) -> str:
    """When its first run began (ISO 8601); empty where nobody recorded it, or by a clock that was never set."""
    return min((began for run in campaign.runs if (began := dated(run.started_at))), default="")


def bench_of(campaign: Campaign) -> str:
    """What a bench is known by: settings, calibrations, what it states; the campaign itself where it has none."""
    last = campaign.sessions[-1] if campaign.sessions else {}
    known = {key: last[key] for key in ("bench", "calibration", "host") if key in last}
    if not known:
        return str(campaign.path)
    stated = None if campaign.common is None else campaign.common.document()
    return json.dumps([known, stated], sort_keys=True)


def observed(budget: Budget, campaign: str, began_at: str, bench: str) -> Observation:
    """What one campaign says of a figure, from its budget."""
    whole, value = budget.standard_uncertainty, budget.value
    random = budget.random
    below = sum(line.contribution**4 / line.degrees for line in budget.lines if not line.key)
    degrees = random**4 / below if below > 0 else math.inf
    common = math.sqrt(max(whole**2 - random**2, 0.0))
    return Observation(campaign, began_at, value, random / value, common / value, degrees, bench)


def chart(figure: str, serial: str, unit: str, observations: Sequence[Observation]) -> Chart:
    """The control chart of a figure; `observations` in the order of time."""
    n = len(observations)
    found = sorted(_changes(_pooled(observations), 0, n), key=lambda change: change.first)
    level, uncertainty, half = np.zeros(n), np.zeros(n), np.zeros(n)
    ends = [0, *(change.first for change in found), n]
    for first, last in zip(ends, ends[1:], strict=False):
        part = observations[first:last]
        covariance = _covariance(part)
        weight = 1.0 / np.diag(covariance)
        weight = weight / weight.sum()
        level[first:last] = weight @ _logs(part)
        uncertainty[first:last] = math.sqrt(weight @ covariance @ weight)
        # Against the mean of all the others and itself: its own part in it is small, and makes the limits narrower.
        # What the bench shares moves the mean as well, and is in no difference from it.
        apart = np.eye(last - first) - weight
        several = len({one.bench for one in part}) > 1
        own = np.array([math.hypot(one.random, one.common if several else 0.0) for one in part])
        differ = np.diag(apart @ covariance @ apart.T) if last - first > 1 else own**2
        half[first:last] = CHART_SIGMAS * np.sqrt(np.maximum(differ, 0.25 * own**2))
    levels = np.exp(level)
    return Chart(
        figure,
        serial,
        unit,
        tuple(observations),
        tuple(found),
        levels,
        levels * uncertainty,
        levels * np.exp(-half),
        levels * np.exp(half),
    )


def _pooled(observations: Sequence[Observation]) -> list[Observation]:
    """The observations with one standard uncertainty for all, where theirs differ by no more than chance.

    Each is known from the few dozen runs of its campaign alone; together they know it better, and a weight that is
    itself an accident favours the campaigns that happen to look good. ln of an estimate with nu degrees of freedom
    scatters by (2 nu)^-1/2.
    """
    logs = np.log([max(one.random, 1e-12) for one in observations])
    degrees = np.array([min(max(one.degrees, LEAST_DEGREES_OF_FREEDOM), 1e6) for one in observations])
    mean = float((degrees * logs).sum() / degrees.sum())
    apart = float((2.0 * degrees * (logs - mean) ** 2).sum())
    if logs.size < 2 or chdtrc(logs.size - 1, apart) < ALIKE_P_VALUE:
        return list(observations)
    size = float(np.sqrt((degrees * np.exp(2.0 * logs)).sum() / degrees.sum()))
    return [replace(one, random=size, degrees=float(degrees.sum())) for one in observations]


def _changes(observations: Sequence[Observation], first: int, last: int) -> list[HistoryStep]:
    """Steps between `first` and `last`, the plainest first."""
    if last - first < 2:
        return []
    part = observations[first:last]
    logs, covariance = _logs(part), _covariance(part)
    trials = [_step(logs, covariance, part, place) for place in range(1, last - first)]
    place = int(np.argmin([p for _, _, p in trials]))
    relative, uncertainty, p = trials[place]
    anywhere = min(1.0, p * len(trials) * FIGURES_CHARTED)
    if anywhere > FALSE_ALARMS:
        return []
    at = first + place + 1
    own = HistoryStep(at, math.expm1(relative), uncertainty * math.exp(relative), anywhere)
    return [own, *_changes(observations, first, at), *_changes(observations, at, last)]


def _step(logs: Array, covariance: Array, part: Sequence[Observation], place: int) -> tuple[float, float, float]:
    """Step at a place (in the logarithm), its standard uncertainty, and the probability of one as large."""
    design = np.column_stack([np.ones(logs.size), np.arange(logs.size) >= place]).astype(float)
    weighted = np.linalg.solve(covariance, design)
    inverse = np.linalg.inv(design.T @ weighted)
    step = float((inverse @ (weighted.T @ logs))[1])
    uncertainty = float(np.sqrt(inverse[1, 1]))
    # Where uncertainties are not of one size, the degrees of freedom of the difference (Welch and Satterthwaite)
    # promise too much, since weights are estimated as well: the fewest of any campaign are taken.
    nu = max(min(one.degrees for one in part), LEAST_DEGREES_OF_FREEDOM)
    return step, uncertainty, 2.0 * float(stdtr(min(nu, 1e9), -abs(step) / uncertainty))


def _logs(observations: Sequence[Observation]) -> Array:
    return np.log([one.value for one in observations])


def _covariance(observations: Sequence[Observation]) -> Array:
    random = np.array([one.random for one in observations])
    common = np.array([one.common for one in observations])
    same = np.array([[a.bench == b.bench for b in observations] for a in observations])
    return np.asarray(np.diag(random**2) + np.where(same, np.outer(common, common), 0.0))
