"""Milliseconds or minutes for seconds: in the tables' time_s, in transfer.start_s, or in both."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from shockrig.analysis.checks.finding import Channel, InputFinding
from shockrig.analysis.checks.signals import (
    CHANNEL_OF_SENSOR,
    DIE,
    FILES,
    HUMIDITY,
    OTHER_SENSOR,
    TEMPERATURE,
    CampaignView,
    ColumnSeen,
)
from shockrig.analysis.checks.thresholds import limit
from shockrig.files.campaign import Run

# Milliseconds for seconds: in the tables' time_s, in transfer.start_s, or in both.

SENSORS = {"imet": (TEMPERATURE,), "hyt": (HUMIDITY, DIE)}
MILLI = 1e-3


def times_in_milliseconds(view: CampaignView) -> Iterator[InputFinding]:
    """`time_s` in milliseconds: against the other sensor, against the stated start, or by how far readings are apart.

    Where nothing else tells: readings more than a minute apart that are no whole number of quarter minutes apart, as
    environmental loggers take them, or responses slower than any sensor's.
    """
    certain: dict[str, dict[str, str]] = {}
    apart: dict[str, dict[str, float]] = {}
    for run in view.campaign.runs:
        for sensor, columns in SENSORS.items():
            seen = next((s for c in columns if (s := view.get(run, c)) is not None), None)
            if seen is None or _says_its_unit(run):
                continue
            other = next((s for c in SENSORS[OTHER_SENSOR[sensor]] if (s := view.get(run, c))), None)
            why = _against_other(seen, other) or _against_start(view, run, columns)
            if why:
                certain.setdefault(sensor, {})[run.id] = why
            elif seen.period_s >= limit("shortest_ms_s"):
                apart.setdefault(sensor, {})[run.id] = seen.period_s
    for runs, names in _together(certain):
        yield InputFinding(
            "milliseconds",
            _channel(names),
            runs,
            "stop",
            f"time_s in {_files(names)} of {view.words(runs)} seems to be in milliseconds "
            f"({certain[names[0]][runs[0]]}): divide it by 1000.",
        )
    for runs, names in _together(apart):
        period = float(np.median(list(apart[names[0]].values())))
        odd = period > limit("long_period_s") and not _of_a_slow_logger(period)
        slow = _slowest_s(view, names, runs)
        if not odd and slow < limit("slowest_rise_s"):
            continue
        shown = f" and respond within {slow:.3g} s" if slow else ""
        yield InputFinding(
            "milliseconds",
            _channel(names),
            runs,
            "stop" if odd else "warn",
            f"The readings in {_files(names)} of {view.words(runs)} are {period:.4g} s apart{shown}: "
            + (
                "time_s seems to be in milliseconds, divide it (and transfer.start_s) by 1000."
                if odd
                else "no sensor is so slow. Either what was measured changed so slowly itself: then log the air or the "
                "water beside it, as its reference; or time_s is in milliseconds: then divide it (and "
                "transfer.start_s) by 1000."
            ),
        )


def starts_in_milliseconds(view: CampaignView) -> Iterator[InputFinding]:
    """`transfer.start_s` in milliseconds: far beyond the record, and within it once divided by 1000."""
    runs, shown = [], ""
    for run in view.campaign.runs:
        columns = [seen for column in FILES if (seen := view.get(run, column)) is not None]
        if run.start_s is None or run.air is not None or not columns:
            continue
        first, last = min(s.time_s[0] for s in columns), max(s.time_s[-1] for s in columns)
        if run.start_s > last + 10.0 * (last - first) and first <= MILLI * run.start_s <= last:
            runs.append(run.id)
            shown = shown or f"run {run.id} states {run.start_s:g} s and its readings end at {last:.4g} s"
    if runs:
        yield InputFinding(
            "milliseconds",
            None,
            tuple(runs),
            "stop",
            f"transfer.start_s in run.json of {view.words(runs)} seems to be in milliseconds ({shown}): "
            "divide it by 1000.",
        )


def _says_its_unit(run: Run) -> bool:
    """Whether a run was imported from a log that writes dates, or names the unit of its times."""
    imported = run.extra.get("imported")
    return isinstance(imported, Mapping) and imported.get("times") in ("dates", "named")


def _against_other(seen: ColumnSeen, other: ColumnSeen | None) -> str:
    if other is None:
        return ""
    span, other_span = np.ptp(seen.time_s), np.ptp(other.time_s)
    ratio = limit("unit_of_time_ratio")
    if span > ratio * other_span and seen.period_s > ratio * other.period_s:
        return f"it spans {span:.0f} there and {other_span:.4g} s in {FILES[other.column]}"
    return ""


def _against_start(view: CampaignView, run: Run, columns: tuple[str, ...]) -> str:
    """The readings respond at a thousand times the stated start."""
    if run.start_s is None or run.air is not None or run.start_s <= 0.0:
        return ""
    for column in columns:
        seen = view.get(run, column)
        if seen is not None and seen.moves and seen.period_s >= 1.0:
            at = seen.crossing_s(0.1)
            if at > 100.0 * run.start_s and abs(MILLI * at - run.start_s) < max(2.0, 0.2 * run.start_s):
                return f"run {run.id} responds at {at:.0f}, and its start is stated at {run.start_s:.4g} s"
    return ""


def _of_a_slow_logger(period_s: float) -> bool:
    """Whether readings are a whole number of quarter minutes apart, as environmental loggers take them."""
    return period_s >= 14.0 and abs(period_s / 15.0 - round(period_s / 15.0)) < 0.01


def _slowest_s(view: CampaignView, names: Sequence[str], runs: Collection[str]) -> float:
    """Median rise from 10 to 63 % of the step [s]; 0 where nothing moves."""
    columns = [view.seen.get((run, column)) for run in runs for name in names for column in SENSORS[name]]
    rises = [seen.crossing_s(0.632) - seen.crossing_s(0.1) for seen in columns if seen is not None and seen.moves]
    return float(np.median(rises)) if rises else 0.0


def _together(found: Mapping[str, Mapping[str, object]]) -> list[tuple[tuple[str, ...], list[str]]]:
    """Runs, and the sensors in which just these were found."""
    kinds = dict.fromkeys(tuple(runs) for runs in found.values())
    return [(runs, [name for name in found if tuple(found[name]) == runs]) for runs in kinds]


def _channel(names: Sequence[str]) -> Channel:
    return None if len(names) > 1 else CHANNEL_OF_SENSOR[names[0]]


def _files(names: Sequence[str]) -> str:
    return " and ".join(f"{name}.csv" for name in names)


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
