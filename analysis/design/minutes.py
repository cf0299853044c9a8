"""How long runs take on this bench, by kind of move, learnt from when its runs began and how long they were recorded.

time between two records = base + per kelvin of chamber travel + per %RH of it + per %RH that the film has to settle

fitted without negative terms, and drawn towards what benches usually need until the campaign says otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from statistics import median_low

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from shockrig.analysis.design.menu import Airs, PlannedShock
from shockrig.files.campaign import Campaign, Run

Array = NDArray[np.float64]

# Between two records, in s: for a stage's way back and a soak's least; for 1 K and 1 %RH of either chamber; for 1 %RH
# between where the probes were and where they start from. Chambers do 1 to 3 K/min and more %RH.
USUAL_BETWEEN_RECORDS = np.array([17.0, 3.0, 0.3, 0.2])
HOW_SURE = 0.7  # of the usual, in pairs of runs
SLOWEST_BETWEEN_RECORDS = USUAL_BETWEEN_RECORDS * (1.0, 20.0, 20.0, 1.0)  # chambers that do 1 K/min
LONGEST_BETWEEN_S = 3 * 3600.0  # more is a pause, not a move, however slow the bench


@dataclass(frozen=True)
class Minutes:
    """Seconds between records for one unit of each feature."""

    coefficients: Array

    def between_s(self, before: Airs, after: Airs) -> float:
        """From the end of one record to the start of the next [s]."""
        return float(_features(before, after) @ self.coefficients)

    def of(self, before: Airs | None, shock: PlannedShock) -> float:
        """Bench minutes of a run with everything that comes before it; `before` None is a bench that stands still."""
        return (self.between_s(shock.airs if before is None else before, shock.airs) + shock.recorded_s) / 60.0


def airs_of_run(run: Run) -> Airs | None:
    """The two airs of a recorded run; None where one is not known."""
    values = [getattr(a, n) for a in (run.source, run.destination) for n in ("temperature_c", "humidity_percent")]
    known = [v for v in values if v is not None]
    return (known[0], known[1], known[2], known[3]) if len(known) == len(values) else None


def _features(before: Airs, after: Airs) -> Array:
    kelvin = max(abs(after[0] - before[0]), abs(after[2] - before[2]))
    percent = max(abs(after[1] - before[1]), abs(after[3] - before[3]))
    return np.array([1.0, kelvin, percent, abs(after[1] - before[3])])


def learn(campaign: Campaign | None) -> Minutes:
    """The bench's minutes from a campaign's own moves; what is usual where it has none."""
    seen = list({} if campaign is None else moves(campaign.runs).values())
    if not seen:
        return Minutes(USUAL_BETWEEN_RECORDS)
    features, between_s = (np.array(each) for each in zip(*seen, strict=True))
    # Each coefficient as a multiple of the usual one, drawn towards 1.
    scaled = features * USUAL_BETWEEN_RECORDS
    # Errors go with the time: a long travel must not drown the rest.
    size = np.maximum(between_s, 1.0)[:, None]
    weights = np.full(USUAL_BETWEEN_RECORDS.size, HOW_SURE / np.sqrt(USUAL_BETWEEN_RECORDS.size))
    design = np.vstack([scaled / size, np.diag(weights)])
    found, _ = nnls(design, np.concatenate([np.ones(len(seen)), weights]))
    return Minutes(found * USUAL_BETWEEN_RECORDS)


def moves(runs: Sequence[Run]) -> dict[str, tuple[Array, float]]:
    """Features of the moves between records and how long each took [s], by the id of the run that it leads to, without
    those in which the bench stood idle.

    It stood idle where another run would have fitted in (lunch, a night): where more than two moves and a record lie
    between two records, a move being what is common in this campaign, and what a slow chamber needs for these airs.
    """
    began_of = [(began, run) for run in runs if (began := _began(run)) is not None]
    timed = sorted(began_of, key=lambda one: _order(one[1]))
    found = dict[str, tuple[Array, float, float]]()
    for (began, run), (next_, later) in zip(timed, timed[1:], strict=False):
        before, after = airs_of_run(run), airs_of_run(later)
        between_s = next_ - began - recorded_s(run)
        same_session = run.extra.get("session") == later.extra.get("session")
        if before is not None and after is not None and same_session and 0.0 < between_s < LONGEST_BETWEEN_S:
            found[later.id] = _features(before, after), between_s, recorded_s(later)
    # The lower median, with what is usual: of two that differ the longer one is taken for idle until a third comes.
    common_s = median_low([USUAL_BETWEEN_RECORDS[0], *(between_s for _, between_s, _ in found.values())])
    return {
        id_: (features, between_s)
        for id_, (features, between_s, record_s) in found.items()
        if between_s <= 2.0 * max(common_s, float(features @ SLOWEST_BETWEEN_RECORDS)) + record_s
    }


def _began(run: Run) -> float | None:
    try:
        return datetime.fromisoformat(run.started_at or "").timestamp()
    except ValueError:
        return None


def _order(run: Run) -> tuple[int, float, str]:
    """Sessions follow one another, whatever the time of day was taken to be in each: a clock that was set back between
    two would mix their runs."""
    session = run.extra.get("session")
    return session if isinstance(session, int) else 0, _began(run) or 0.0, run.id


def recorded_s(run: Run) -> float:
    """Length of a run's record [s]."""
    return max((float(t.time_s[-1]) for t in (run.imet, run.hyt) if t is not None and t.time_s.size), default=0.0)


def spent_minutes(campaign: Campaign) -> dict[str, float]:
    """Bench minutes of each run, by id: from the end of the record before it; as learnt where that is not known, or the
    bench stood idle."""
    learnt, seen = learn(campaign), moves(campaign.runs)
    taken: dict[str, float] = {}
    before: Airs | None = None
    for run in sorted(campaign.runs, key=_order):
        between_s, after = float(learnt.coefficients[0]), airs_of_run(run)
        if run.id in seen:
            _, between_s = seen[run.id]
        elif before is not None and after is not None:
            between_s = learnt.between_s(before, after)
        taken[run.id] = (between_s + recorded_s(run)) / 60.0
        before = after
    return taken
