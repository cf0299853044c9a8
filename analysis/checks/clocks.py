"""Starts that no reading agrees with, and one sensor's clock apart from the start's or the other sensor's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from shockrig.analysis.checks.finding import InputFinding, limit
from shockrig.analysis.checks.rates import begins_after, isothermal
from shockrig.analysis.checks.signals import (
    CHANNEL_OF,
    CHANNEL_OF_SENSOR,
    DIE,
    FILES,
    HUMIDITY,
    OTHER_SENSOR,
    TEMPERATURE,
    CampaignView,
    ColumnSeen,
)
from shockrig.files.campaign import Run

SENSORS = ("imet", "hyt")
FIRST_COLUMN = {"imet": TEMPERATURE, "hyt": HUMIDITY}  # in which a sensor's response is looked for
CORES = ("sphere", "cylinder", "plate")  # bodies read at their middle


@dataclass(frozen=True)
class Onset:
    """When a column begins to respond, relative to the stated start.

    `verdict` is "early" (the readings move before it), "late" or "agrees"; `tolerance_s` is how late it may be and
    still agree.
    """

    seen: ColumnSeen
    offset_s: float
    tolerance_s: float
    verdict: str


def starts_and_clocks(view: CampaignView) -> Iterator[InputFinding]:
    """Starts that no reading agrees with, and sensors whose clock is apart from the start's or the other sensor's.

    Where one sensor agrees with the stated starts and the other is off in most of its runs, it is that one's clock;
    where all that respond are off, it is the start. A response too slow to notice an offset has no say in it.
    """
    onsets: dict[str, dict[str, Onset]] = {"imet": {}, "hyt": {}}
    for run in view.campaign.runs:
        if run.start_s is None or run.air is not None:
            continue
        for sensor in SENSORS:
            onset = _onset(view, run, sensor, run.start_s)
            if onset is not None:
                onsets[sensor][run.id] = onset
    blamed = {sensor for sensor in SENSORS if _clock_is_off(sensor, onsets)}
    wrong = {run.id: np.nan for run in view.campaign.runs if _outside(view, run)}
    alone: dict[str, list[Onset]] = {}
    for run in view.campaign.runs:
        here = {s: found[run.id] for s, found in onsets.items() if s not in blamed and run.id in found}
        off = [s for s, onset in here.items() if onset.verdict != "agrees"]
        if run.id in wrong or not off:
            continue
        worst = max(abs(here[s].offset_s) for s in off)
        agrees = [s for s, onset in here.items() if s not in off and onset.tolerance_s < worst]
        if agrees:
            alone.setdefault(off[0], []).append(here[off[0]])
        else:
            wrong[run.id] = here[off[0]].offset_s
    for sensor in sorted(blamed):
        off_there = [onset for onset in onsets[sensor].values() if onset.verdict != "agrees"]
        yield _clock(view, sensor, off_there, True)
    for sensor, off_here in alone.items():
        yield _clock(view, sensor, off_here, False)
    if wrong:
        yield _wrong_starts(view, wrong)


def _clock_is_off(sensor: str, onsets: dict[str, dict[str, Onset]]) -> bool:
    """Whether most runs of a sensor that could notice it are off the same way, and most of the other's are not."""
    off = [onset for onset in onsets[sensor].values() if onset.verdict != "agrees"]
    if len(off) < 2 or len({onset.verdict for onset in off}) > 1:
        return False
    by = abs(float(np.median([onset.offset_s for onset in off])))
    able = {s: [o for o in found.values() if o.tolerance_s < by] for s, found in onsets.items()}
    other = able[OTHER_SENSOR[sensor]]
    agreeing = sum(onset.verdict == "agrees" for onset in other)
    share = limit("clock_runs")
    return len(off) >= share * len(able[sensor]) and agreeing >= max(2, share * len(other))


def clocks_without_starts(view: CampaignView) -> Iterator[InputFinding]:
    """One sensor's clock late or early where nobody triggered: both sensors' responses begin at one moment."""
    apart = {}
    for run in view.campaign.runs:
        if run.start_s is not None or run.air is not None:
            continue
        bead, film = (_onset(view, run, sensor, 0.0) for sensor in SENSORS)
        if bead is None or film is None:
            continue
        quick = _rise_s(bead.seen) <= limit("quick_rise_s")  # else the air itself may be slow, and lags add up
        if quick and (_rise_s(film.seen) <= limit("slow_rise_s") or film.seen.column == DIE):
            apart[run.id] = (film.offset_s - bead.offset_s, film.seen)
    if len(apart) < 2:
        return
    offsets = np.array([offset for offset, _ in apart.values()])
    middle = float(np.median(offsets))
    most = (np.abs(offsets - middle) < 0.5).mean() >= limit("clock_runs")
    if abs(middle) > limit("onset_late_s") and most:
        sensor, slow = ("hyt", middle) if middle > 0 else ("imet", -middle)
        other = OTHER_SENSOR[sensor]
        yield InputFinding(
            "clock_late",
            CHANNEL_OF_SENSOR[sensor],
            tuple(apart),
            "stop",
            f"{sensor}.csv responds {slow:.1f} s later than {other}.csv in {view.words(apart)}: the clock of one of "
            f"them is off; subtract {slow:.1f} s from the time_s of {sensor}.csv, or add it to that of {other}.csv.",
        )


def _rise_s(seen: ColumnSeen) -> float:
    return seen.crossing_s(0.632) - seen.crossing_s(0.1)


def _onset(view: CampaignView, run: Run, sensor: str, start_s: float) -> Onset | None:
    """When a sensor begins to respond: the bead; the film where the temperature stays; the die where it does not."""
    seen = view.get(run, FIRST_COLUMN[sensor])
    steady = seen is None or seen.column == TEMPERATURE or isothermal(view, seen)
    if steady is False:
        seen = view.get(run, DIE)
    if seen is None or not seen.moves:
        return None
    share = max(limit("onset_share"), limit("onset_sigmas") * seen.noise / abs(seen.step))
    if share > limit("latest_onset_share"):
        return None
    rise = _rise_s(seen)
    last, first = (time - start_s for time in seen.around_s(share))  # still at rest, and moving
    surely = seen.around_s(max(5.0 * limit("onset_share"), 2.0 * share))[1] - start_s
    # films and lags begin at once, a body read at its core after a third of its rise; a slow one may be any of them
    cored = seen.column != DIE and view.campaign.bodies.get(sensor) in CORES
    expected = rise * begins_after("sphere" if cored else "film", share)
    slow = seen.column != DIE and (rise > limit("slow_rise_s") or (cored and seen.column == HUMIDITY))
    latest = rise * begins_after("sphere" if cored or slow else "lag" if seen.column == DIE else "film", share)
    slack = limit("onset_rise") * rise
    tolerance = latest + limit("onset_late_s") + (2.0 if slow else 1.0) * slack
    tolerance += limit("onset_late_unknown_s") if steady is None else 0.0
    verdict = "agrees"
    if first < -(limit("onset_early_s") + slack) and surely < -0.5 * limit("onset_early_s"):
        verdict = "early"
    elif last > tolerance:
        verdict = "late"
    offset = seen.crossing_s(share) - start_s
    return Onset(seen, offset - (expected if offset > 0 else 0.0), tolerance, verdict)


def _record(view: CampaignView, run: Run) -> tuple[float, float, float] | None:
    """From when to when a run was recorded [s on the clock of its files], and the time between its first two rows."""
    times = [seen.time_s for column in FILES if (seen := view.get(run, column)) is not None]
    if not times:
        return None
    earliest = min(times, key=lambda time: float(time[0]))
    return float(earliest[0]), float(max(time[-1] for time in times)), float(earliest[1] - earliest[0])


def _outside(view: CampaignView, run: Run) -> bool:
    """Whether the stated start lies outside of everything that was recorded, by more than the time to the next row."""
    record = _record(view, run)
    if run.start_s is None or run.air is not None or record is None:
        return False
    first_s, last_s, period_s = record
    return not first_s - period_s <= run.start_s <= last_s


def _clock(view: CampaignView, sensor: str, off: list[Onset], everywhere: bool) -> InputFinding:
    offset = float(np.median([o.offset_s for o in off]))
    runs = [o.seen.run.id for o in off]
    late, other = offset > 0, f"{OTHER_SENSOR[sensor]}.csv"
    remedy = f"subtract {offset:.1f} s from" if late else f"add {-offset:.1f} s to"
    responds = "responds" if len(runs) == 1 else "respond"
    return InputFinding(
        "clock_late" if late else "clock_early",
        CHANNEL_OF[off[0].seen.column],
        tuple(run.id for run in view.campaign.runs) if everywhere else tuple(runs),
        "stop",
        f"The clock of {sensor}.csv seems {abs(offset):.1f} s {'late' if late else 'early'} ({view.words(runs)} "
        f"{responds} by that much {'after' if late else 'before'} transfer.start_s there, and {other} agrees with it): "
        f"{remedy} its time_s.",
    )


def _wrong_starts(view: CampaignView, wrong: dict[str, float]) -> InputFinding:
    offsets = np.array(list(wrong.values()))
    known = offsets[np.isfinite(offsets)]
    if not known.size:
        run = next(run for run in view.campaign.runs if run.id in wrong)
        what = "lies outside of the record"
        if (record := _record(view, run)) is not None:
            what += f" (run {run.id} goes from {record[0]:.6g} to {record[1]:.6g} s, its start is {run.start_s:.6g} s)"
    elif known.size == offsets.size and np.ptp(known) < 1.0:
        middle = float(np.median(known))
        what = f"is {abs(middle):.1f} s {'before' if middle > 0 else 'after'} the readings begin to move"
        what += ", as it would be by a clock that is off" if len(wrong) > 1 else ""
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
