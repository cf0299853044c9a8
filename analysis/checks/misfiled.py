"""What stands where it does not belong: source and destination, the two sensors' readings, the columns of hyt.csv; and
one run filed several times.

Copies are told by the noise that two runs have in common. What a straight line through the readings just before does
not foretell is compared, so that hum and slow drifts, which runs may share, count for nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from shockrig.analysis.checks.finding import Channel, InputFinding, limit
from shockrig.analysis.checks.signals import (
    CHANNEL_OF_FILE,
    COLUMNS,
    DIE,
    FILES,
    HUMIDITY,
    TEMPERATURE,
    Array,
    CampaignView,
    ColumnSeen,
    stated,
)
from shockrig.files.campaign import Run

Levels = tuple[float, float]


def airs_swapped(view: CampaignView) -> Iterator[InputFinding]:
    """`source` and `destination` of run.json in one another's place: the readings go from the one to the other."""
    runs, shown = [], ""
    for run in view.campaign.runs:
        if run.air is not None:
            continue
        votes = [vote for column in (TEMPERATURE, HUMIDITY, DIE) if (vote := _direction(view, run, column)) != 0]
        if votes and max(votes) < 0:
            runs.append(run.id)
            shown = shown or _course(view, run)
    if runs:
        yield InputFinding(
            "airs_swapped",
            None,
            tuple(runs),
            "stop",
            f"source and destination in run.json of {view.words(runs)} seem swapped ({shown}): exchange them.",
        )


def columns_and_sensors_swapped(view: CampaignView) -> Iterator[InputFinding]:
    """Humidity where a temperature should be: the columns of hyt.csv, or the readings of imet.csv and hyt.csv."""
    columns, sensors = [], []
    for run in view.campaign.runs:
        bead, film, die = (view.get(run, column) for column in (TEMPERATURE, HUMIDITY, DIE))
        warm, moist = _known(stated(run, TEMPERATURE)), _known(stated(run, HUMIDITY))
        if run.air is not None or film is None:
            continue
        if die is not None and _exchanged(die, film, warm, moist, bead):
            columns.append(run.id)
        elif bead is not None and _exchanged(bead, film, warm, moist, die):
            sensors.append(run.id)
    yield from _swap(view, columns, "columns_swapped", "humidity", "The columns of hyt.csv", "rename its columns")
    yield from _swap(view, sensors, "sensors_swapped", None, "The readings of imet.csv and hyt.csv", "exchange them")


def _swap(
    view: CampaignView, runs: list[str], kind: str, channel: Channel, what: str, remedy: str
) -> Iterator[InputFinding]:
    """The finding, where these runs state their airs, or where most runs look so."""
    meant = [run for run in view.campaign.runs if run.id in set(runs)]
    certain = all(_known(stated(run, c)) is not None for run in meant for c in (TEMPERATURE, HUMIDITY))
    if not runs or not (certain or len(runs) > 0.5 * len(view.column(HUMIDITY))):
        return
    film = view.seen[runs[0], HUMIDITY]
    if not certain:  # a run in which both happen to agree cannot tell by itself
        runs = [seen.run.id for seen in view.column(HUMIDITY)]
    yield InputFinding(
        kind,
        channel,
        tuple(runs),
        "stop",
        f"{what} seem swapped in {view.words(runs)} (humidity_percent goes from {film.before:.1f} to "
        f"{film.after:.1f} in run {film.run.id}, which is its temperature): {remedy}.",
    )


def _direction(view: CampaignView, run: Run, column: str) -> int:
    """1: the readings go from the stated source to the stated destination; -1: the other way round; 0: not known."""
    seen = view.get(run, column)
    source, destination = stated(run, column)
    if seen is None or not seen.moves or source is None or destination is None:
        return 0
    step = destination - source
    if abs(step) < limit("swap_percent" if column == HUMIDITY else "swap_k"):
        return 0
    if seen.step * step > 0:
        return 1
    near = abs(seen.before - destination) < abs(seen.before - source)
    return -1 if near and abs(seen.step) > 0.2 * abs(step) else 0


def _course(view: CampaignView, run: Run) -> str:
    column = next(c for c in (TEMPERATURE, HUMIDITY, DIE) if _direction(view, run, c) < 0)
    seen, (source, destination) = view.seen[run.id, column], stated(run, column)
    unit = "%RH" if column == HUMIDITY else "°C"
    return (
        f"run {run.id} states {source:.1f} to {destination:.1f} {unit} and its readings go from {seen.before:.1f} to "
        f"{seen.after:.1f}"
    )


def _known(values: tuple[float | None, float | None]) -> Levels | None:
    source, destination = values
    return None if source is None or destination is None else (source, destination)


def _exchanged(
    t: ColumnSeen, h: ColumnSeen, warm: Levels | None, moist: Levels | None, third: ColumnSeen | None
) -> bool:
    """Whether a temperature column `t` holds the humidity and the humidity column `h` the temperature.

    Told by the stated airs where there are any, else by the third column, which is then a temperature.
    """
    readings = (t.before, t.after), (h.before, h.after)
    if warm is not None and moist is not None:
        as_it_is = _off(readings[0], warm) + _off(readings[1], moist)
        exchanged = _off(readings[0], moist) + _off(readings[1], warm)
        return exchanged < limit("agree_percent") + limit("agree_k") and as_it_is > 3.0 * exchanged + 10.0
    if third is None:
        return False
    course = (third.before, third.after)
    return _off(readings[1], course) < limit("agree_k") < 10.0 < _off(readings[0], course)


def _off(levels: Levels, others: Levels) -> float:
    """How far two plateaus are from two others: the larger of the two distances before, half of that after."""
    return max(abs(levels[0] - others[0]), 0.5 * abs(levels[1] - others[1]))


NO_NOISE = 1e-7  # of a calculated campaign, in shares of the readings' range
MOST_READINGS = 5000  # of a run that are compared
AR_ORDER = 8  # readings that foretell the next one: two tones and a slow noise


def copied_runs(view: CampaignView) -> Iterator[InputFinding]:
    """Runs that are copies of another: equal noise in a sensor's readings."""
    originals: dict[str, str] = {}
    places: dict[str, list[str]] = {}
    for column in (TEMPERATURE, HUMIDITY):
        kept: list[tuple[ColumnSeen, Array]] = []
        for seen in view.column(column):
            noise = _innovations(seen.value[:MOST_READINGS])
            if noise is None:
                continue
            twin = next((s for s, n in kept if _correlation(n, noise) > limit("copy_correlation")), None)
            if twin is None:
                kept.append((seen, noise))
            else:
                originals.setdefault(seen.run.id, originals.get(twin.run.id, twin.run.id))
                places.setdefault(seen.run.id, []).append(FILES[column])
    for original in dict.fromkeys(originals.values()):
        runs = tuple(run for run, first in originals.items() if first == original)
        files = sorted({place for run in runs for place in places[run]}, reverse=True)
        channel: Channel = None if len(files) > 1 else CHANNEL_OF_FILE[files[0]]
        same = all(_equal(view, original, run, column) for run in runs for column in COLUMNS)
        yield InputFinding(
            "run_copied",
            channel,
            runs,
            "stop",
            f"{' and '.join(files)} of {view.words(runs)} {'repeats' if len(runs) == 1 else 'repeat'} the "
            f"{'readings' if same else 'noise'} of run {original}, which no second measurement does: keep run "
            f"{original} and leave the copies out.",
        )


def _equal(view: CampaignView, first: str, second: str, column: str) -> bool:
    a, b = view.seen.get((first, column)), view.seen.get((second, column))
    return a is None or b is None or np.array_equal(a.value, b.value)


def _innovations(value: Array) -> Array | None:
    """What `AR_ORDER` readings do not foretell of the next; None where too few readings change to tell runs apart."""
    changes = np.diff(value)
    if np.count_nonzero(changes) < limit("copy_readings") or value.size < 4 * AR_ORDER:
        return None
    past = np.lib.stride_tricks.sliding_window_view(changes, AR_ORDER)[:-1]
    ahead = changes[AR_ORDER:]
    # the transient would decide the prediction: rows far beyond the usual change are left out
    usual = 6.0 * max(float(np.percentile(np.abs(changes), 75)), 1e-12)
    calm = (np.abs(ahead) < usual) & (np.abs(past) < usual).all(axis=1)
    if calm.sum() < limit("copy_readings"):
        return None
    weights = np.linalg.lstsq(past[calm], ahead[calm], rcond=1e-6)[0]
    rest = ahead - past @ weights
    most = 3.0 * float(np.median(np.abs(rest[calm])))  # alike are also two transients, but those are few readings
    if most < NO_NOISE * np.ptp(value):
        return None
    return np.where(calm, np.clip(rest, -most, most), 0.0)


def _correlation(first: Array, second: Array) -> float:
    if first.size != second.size:
        return 0.0
    both = (first != 0.0) & (second != 0.0)
    if both.sum() < limit("copy_readings"):
        return 0.0
    a, b = first[both], second[both]
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))
