"""Time: milliseconds for seconds, starts that no reading agrees with, one sensor's clock apart from the other's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from shockrig.analysis.checks.finding import InputFinding
from shockrig.analysis.checks.response import begins_after
from shockrig.analysis.checks.signals import CHANNEL_OF, DIE, FILES, HUMIDITY, TEMPERATURE, Seen, View
from shockrig.analysis.checks.thresholds import limit
from shockrig.files.campaign import Run

SENSORS = {"imet": (TEMPERATURE,), "hyt": (HUMIDITY, DIE)}
MILLI = 1e-3
CORES = ("sphere", "cylinder", "plate")  # bodies read at their middle


def times_in_milliseconds(view: View) -> Iterator[InputFinding]:
    """`time_s` in milliseconds: against the other sensor, against the stated start, or by how far readings are apart.

    Readings that are 10 s or more apart may be meant so where nothing else tells: that is a warning.
    """
    certain: dict[str, dict[str, str]] = {}
    apart: dict[str, dict[str, float]] = {}
    for run in view.campaign.runs:
        for sensor, columns in SENSORS.items():
            seen = next((s for c in columns if (s := view.get(run, c)) is not None), None)
            if seen is None:
                continue
            other = next((s for c in SENSORS["hyt" if sensor == "imet" else "imet"] if (s := view.get(run, c))), None)
            why = _against_other(seen, other) or _against_start(view, run, columns)
            if why:
                certain.setdefault(sensor, {})[run.id] = why
            elif seen.period_s >= limit("longest_period_s"):
                apart.setdefault(sensor, {})[run.id] = seen.period_s
    for runs in {tuple(runs): None for runs in certain.values()}:
        names = [name for name in certain if tuple(certain[name]) == runs]
        files = " and ".join(f"{name}.csv" for name in names)
        yield InputFinding(
            "milliseconds",
            None if len(names) > 1 else ("temperature" if names[0] == "imet" else "humidity"),
            runs,
            "stop",
            f"time_s in {files} of {view.words(runs)} seems to be in milliseconds "
            f"({certain[names[0]][runs[0]]}): divide it by 1000.",
        )
    for runs in {tuple(runs): None for runs in apart.values()}:
        names = [name for name in apart if tuple(apart[name]) == runs]
        period = float(np.median(list(apart[names[0]].values())))
        if _of_a_slow_logger(period):
            continue
        files = " and ".join(f"{name}.csv" for name in names)
        yield InputFinding(
            "milliseconds",
            None if len(names) > 1 else ("temperature" if names[0] == "imet" else "humidity"),
            runs,
            "stop" if period > 60.0 else "warn",
            f"The readings in {files} of {view.words(runs)} are {period:.4g} s apart: if time_s is in milliseconds, "
            "divide it (and transfer.start_s) by 1000.",
        )


def starts_in_milliseconds(view: View) -> Iterator[InputFinding]:
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


@dataclass(frozen=True)
class Onset:
    """When a column begins to respond, relative to the stated start: "early", "late" or "agrees"."""

    seen: Seen
    offset_s: float
    verdict: str


def starts_and_clocks(view: View) -> Iterator[InputFinding]:
    """Starts that no reading agrees with, and sensors whose clock is apart from the start's or the other sensor's.

    Where one sensor agrees with the stated starts and the other is off in most of its runs, it is that one's clock;
    where all that respond are off, it is the start.
    """
    onsets: dict[str, dict[str, Onset]] = {"imet": {}, "hyt": {}}
    for run in view.campaign.runs:
        if run.start_s is None or run.air is not None:
            continue
        for sensor in SENSORS:
            onset = _onset(view, run, sensor, run.start_s)
            if onset is not None:
                onsets[sensor][run.id] = onset
    off = {s: [o for o in found.values() if o.verdict != "agrees"] for s, found in onsets.items()}
    blamed: set[str] = set()
    for sensor, other in (("imet", "hyt"), ("hyt", "imet")):
        count, agreeing = len(onsets[sensor]), len(onsets[other]) - len(off[other])
        if (
            len(off[sensor]) >= max(2, limit("clock_runs") * count)
            and agreeing >= max(2, limit("clock_runs") * len(onsets[other]))
            and len({o.verdict for o in off[sensor]}) == 1
        ):
            blamed.add(sensor)
            yield _clock(view, sensor, off[sensor], f"{other}.csv agrees with the starts")
    lost = [run for run in view.campaign.runs if _outside(view, run)]
    wrong = {run.id: np.nan for run in lost}
    for run in view.campaign.runs:
        here = {s: found[run.id] for s, found in onsets.items() if s not in blamed and run.id in found}
        if run.id in wrong or not any(o.verdict != "agrees" for o in here.values()):
            continue
        bad = [s for s, o in here.items() if o.verdict != "agrees"]
        if len(bad) == len(here):
            wrong[run.id] = here[bad[0]].offset_s
        elif not blamed:
            yield _clock(view, bad[0], [here[bad[0]]], "the other sensor agrees with the start")
    if wrong:
        yield _wrong_starts(view, wrong)


def clocks_without_starts(view: View) -> Iterator[InputFinding]:
    """One sensor's clock late or early where nobody triggered: both sensors' responses begin at one moment."""
    apart = {}
    for run in view.campaign.runs:
        if run.start_s is not None or run.air is not None:
            continue
        bead, film = (_onset(view, run, sensor, 0.0) for sensor in SENSORS)
        if bead is None or film is None:
            continue
        rises = (_rise_s(bead.seen), _rise_s(film.seen))
        if max(rises) <= limit("slow_rise_s") or film.seen.column == DIE:
            apart[run.id] = (film.offset_s - bead.offset_s, film.seen)
    if len(apart) < 2:
        return
    offsets = np.array([offset for offset, _ in apart.values()])
    middle = float(np.median(offsets))
    most = (np.abs(offsets - middle) < 0.5).mean() >= limit("clock_runs")
    if abs(middle) > limit("onset_late_s") and most:
        sensor, slow = ("hyt", middle) if middle > 0 else ("imet", -middle)
        other = "imet" if sensor == "hyt" else "hyt"
        yield InputFinding(
            "clock_late",
            "humidity" if sensor == "hyt" else "temperature",
            tuple(apart),
            "stop",
            f"{sensor}.csv responds {slow:.1f} s later than {other}.csv in {view.words(apart)}: one sensor's clock is "
            f"off; shift its time_s.",
        )


def _against_other(seen: Seen, other: Seen | None) -> str:
    if other is None:
        return ""
    span, other_span = np.ptp(seen.time_s), np.ptp(other.time_s)
    ratio = limit("unit_of_time_ratio")
    if span > ratio * other_span and seen.period_s > ratio * other.period_s:
        return f"it spans {span:.0f} there and {other_span:.4g} s in {FILES[other.column]}"
    return ""


def _against_start(view: View, run: Run, columns: tuple[str, ...]) -> str:
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


def _rise_s(seen: Seen) -> float:
    return seen.crossing_s(0.632) - seen.crossing_s(0.1)


def _onset(view: View, run: Run, sensor: str, start_s: float) -> Onset | None:
    """When a sensor begins to respond: the bead; the film where the temperature stays; the die where it does not."""
    bead, die = view.get(run, TEMPERATURE), view.get(run, DIE)
    if sensor == "imet":
        seen = bead
    else:
        thermal = any(s is not None and abs(s.step) > limit("isothermal_k") for s in (bead, die))
        seen = die if thermal else view.get(run, HUMIDITY)
    if seen is None or not seen.moves:
        return None
    share = max(limit("onset_share"), limit("onset_sigmas") * seen.noise / abs(seen.step))
    if share > limit("latest_onset_share"):
        return None
    rise = _rise_s(seen)
    offset = seen.crossing_s(share) - start_s
    # films and lags begin at once, a body read at its core after a third of its rise; a slow one may be any of them
    cored = seen.column != DIE and view.campaign.bodies.get(sensor) in CORES
    expected = rise * begins_after("sphere" if cored else "film", share)
    slow = rise > limit("slow_rise_s") or (cored and seen.column == HUMIDITY)
    latest = rise * begins_after("sphere" if cored or slow else "film", share)
    slack = 0.5 * seen.period_s + limit("onset_rise") * rise
    verdict = "agrees"
    if offset < -(limit("onset_early_s") + slack):
        verdict = "early"
    elif offset > latest + limit("onset_late_s") + (2.0 if slow else 1.0) * slack:
        verdict = "late"
    return Onset(seen, offset - (expected if offset > 0 else 0.0), verdict)


def _outside(view: View, run: Run) -> bool:
    """Whether the stated start lies outside of everything that was recorded."""
    columns = [seen for column in FILES if (seen := view.get(run, column)) is not None]
    if run.start_s is None or run.air is not None or not columns:
        return False
    return not min(s.time_s[0] for s in columns) <= run.start_s <= max(s.time_s[-1] for s in columns)


def _clock(view: View, sensor: str, off: list[Onset], agrees: str) -> InputFinding:
    offset = float(np.median([o.offset_s for o in off]))
    runs = [o.seen.run.id for o in off]
    late = offset > 0
    remedy = f"subtract {offset:.1f} s from" if late else f"add {-offset:.1f} s to"
    return InputFinding(
        "clock_late" if late else "clock_early",
        CHANNEL_OF[off[0].seen.column],
        tuple(run.id for run in view.campaign.runs) if len(runs) > 1 else tuple(runs),
        "stop",
        f"The clock of {sensor}.csv seems {abs(offset):.1f} s {'late' if late else 'early'} ({view.words(runs)} "
        f"respond by that much {'after' if late else 'before'} transfer.start_s, and {agrees}): {remedy} its time_s.",
    )


def _wrong_starts(view: View, wrong: dict[str, float]) -> InputFinding:
    offsets = np.array(list(wrong.values()))
    known = offsets[np.isfinite(offsets)]
    if not known.size:
        what = "lies outside of the record"
    elif known.size == offsets.size and np.ptp(known) < 1.0:
        middle = float(np.median(known))
        what = f"is {abs(middle):.1f} s {'before' if middle > 0 else 'after'} the readings begin to move"
    else:
        first = next(run for run, offset in wrong.items() if np.isfinite(offset))
        what = (
            f"is up to {np.abs(known).max():.1f} s off (run {first} begins to move {abs(wrong[first]):.1f} s "
            f"{'after' if wrong[first] > 0 else 'before'} it)"
        )
    return InputFinding(
        "start_disagrees",
        None,
        tuple(wrong),
        "stop",
        f"No reading agrees with transfer.start_s of {view.words(wrong)}: it {what}; correct it, or leave it out "
        "and it is estimated.",
    )
