"""Minutes for seconds in the tables' time_s: readings that come at a logger's usual pace only when counted so, or a
response at a sixtieth of the stated start."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from shockrig.analysis.checks.finding import InputFinding
from shockrig.analysis.checks.milliseconds import SENSORS
from shockrig.analysis.checks.signals import CampaignView, ColumnSeen
from shockrig.analysis.checks.thresholds import limit

MINUTE_S = 60.0
PACES_S = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)  # in minutes none of these is a pace that loggers have in seconds


def times_in_minutes(view: CampaignView) -> Iterator[InputFinding]:
    """`time_s` in minutes, of all that a campaign recorded: a slip of one logger is one of all its runs.

    A diffusivity would be 60 times what it is. Frames of a camera come 30 or 60 a second too: then it may be meant.
    """
    every = [
        next(seen for seen in columns if seen is not None)
        for run in view.campaign.runs
        for sensor in SENSORS
        if any(columns := [view.get(run, column) for column in SENSORS[sensor]])
    ]
    if not every or not all(_at_a_pace_in_minutes(seen) for seen in every):
        return
    period = float(np.median([seen.period_s for seen in every]))
    early = [seen for seen in every if _responds_a_minute_a_second_early(seen)]
    certain = len(early) > 0.5 * len(every)
    where = f", and run {early[0].run.id} ends before its start, stated at {early[0].run.start_s:g} s" if early else ""
    runs = tuple(dict.fromkeys(seen.run.id for seen in every))
    yield InputFinding(
        "minutes",
        None,
        runs,
        "stop" if certain else "warn",
        f"The readings of {view.words(runs)} are {period:.4g} s apart, which no logger's pace is and "
        f"{MINUTE_S * period:.4g} s in minutes would be{where}: time_s seems to be in minutes, multiply it"
        f"{'' if certain else ' (and transfer.start_s)'} by 60.",
    )


def _at_a_pace_in_minutes(seen: ColumnSeen) -> bool:
    ratio = MINUTE_S * seen.period_s / np.array(PACES_S)
    return bool(np.abs(ratio - 1.0).min() < limit("pace_share"))


def _responds_a_minute_a_second_early(seen: ColumnSeen) -> bool:
    start_s = seen.run.start_s
    if start_s is None or not seen.moves or seen.run.air is not None or start_s <= seen.time_s[-1]:
        return False
    return bool(seen.time_s[0] < start_s / MINUTE_S < seen.time_s[-1])
