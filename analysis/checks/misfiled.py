"""What stands where it does not belong: source and destination, the two sensors' readings, the columns of hyt.csv, airs
that are not those in which the probes stood; and one run filed several times.

Stated airs are held against each end of a run, where a sensor was at rest in it.

Copies are told by the noise that two runs have in common. What a straight line through the readings just before does
not foretell is compared, so that hum and slow drifts, which runs may share, count for nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from shockrig.analysis.checks.finding import Channel, InputFinding, limit
from shockrig.analysis.checks.signals import (
    CHANNEL_OF,
    CHANNEL_OF_FILE,
    COLUMNS,
    DIE,
    FILES,
    HUMIDITY,
    TEMPERATURE,
    UNITS,
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


REST_PARTS = 4  # of a rest, of which the last is what a sensor read there
LEAST_READINGS = 8
LEAST_SHARE_LEFT = 0.75  # share of a sensor's runs with which nothing else is wrong


def airs_disagree(view: CampaignView) -> Iterator[InputFinding]:
    """Runs in which a sensor stood further from its stated air than calibration, heat and water explain.

    Where most runs agree with their airs these are wrong, and stop; where hardly any does it may be the sensor.
    """
    for column in (TEMPERATURE, HUMIDITY):
        off, agree = {}, 0
        recorded = sum(getattr(run, COLUMNS[column][0]) is not None for run in view.campaign.runs)
        if len(view.column(column)) < LEAST_SHARE_LEFT * recorded:
            continue  # what stopped the others is what is wrong with the sensor
        for seen in view.column(column):
            found = [place for place in (_source(seen), _destination(seen)) if place is not None]
            wrong = [said for said, far in found if far]
            if wrong:
                off[seen.run.id] = wrong[0]
            elif found:
                agree += 1
        if off:
            certain = agree >= 2 * len(off)
            first, said = next(iter(off.items()))
            yield InputFinding(
                "airs_disagree",
                CHANNEL_OF[column],
                tuple(off),
                "stop" if certain else "warn",
                f"The airs in run.json of {view.words(off)} are not those in which the probes stood (in run {first} "
                f"{FILES[column]} {said}): correct them, or record these runs again.",
            )


def airs_off_both(view: CampaignView) -> Iterator[InputFinding]:
    """Airs that two thermometers find off by the same amount.

    It is less than a wet or heated thermometer is off by itself. But bead and die are of two makers, so that what both
    read at rest is the air.
    """
    off: dict[str, float] = {}
    compared = 0
    for run in view.campaign.runs:
        both = [seen for column in (TEMPERATURE, DIE) if (seen := view.get(run, column)) is not None]
        start_s, temperatures = run.start_s, stated(run, TEMPERATURE)
        if len(both) < 2 or start_s is None or run.air is not None:
            continue
        alone = [told for told in (_source(both[0]), _destination(both[0])) if told is not None]
        if any(disagrees for _, disagrees in alone):
            continue  # the bead has said so by itself
        for air, late in zip(temperatures, (False, True), strict=True):
            if air is None:
                continue
            half_s = [0.5 * (start_s + float(seen.time_s[-1])) for seen in both]
            there = [s.time_s > h if late else s.time_s < start_s for s, h in zip(both, half_s, strict=True)]
            stood = [_at_rest(seen, inside) for seen, inside in zip(both, there, strict=True)]
            if None in stood:
                continue
            compared += 1
            bead, die = (float(value) - air for value in stood if value is not None)
            mean = 0.5 * (bead + die)
            if abs(mean) >= limit("both_off_k") and abs(bead - die) <= limit("both_alike") * abs(mean):
                off.setdefault(run.id, mean)
    if off and len(off) >= 0.5 * compared / 2:
        typical = float(np.median(list(off.values())))
        yield InputFinding(
            "airs_disagree",
            None,
            tuple(off),
            "warn",
            f"Bead and die at rest read {abs(typical):.2g} K {'more' if typical > 0 else 'less'} than the airs in "
            f"run.json of {view.words(off)}, both of them: the stated temperatures seem to be "
            f"{'too low' if typical > 0 else 'too high'}; check what measured them, D and the response times depend on "
            "it.",
        )


def _source(seen: ColumnSeen) -> tuple[str, bool] | None:
    """What is to be said of the air that a run begins in, and whether it disagrees; None where it tells nothing."""
    source, start_s = stated(seen.run, seen.column)[0], seen.run.start_s
    if source is None or start_s is None or seen.run.air is not None:
        return None
    stood = _at_rest(seen, seen.time_s < start_s)
    return None if stood is None else _judged(seen, "source", stood, source, 0.0)


def _destination(seen: ColumnSeen) -> tuple[str, bool] | None:
    source, destination = stated(seen.run, seen.column)
    if destination is None or seen.run.start_s is None or seen.run.air is not None:
        return None
    half = 0.5 * (seen.run.start_s + float(seen.time_s[-1]))
    stood = _at_rest(seen, seen.time_s > half)
    on_the_way = 0.5 * abs(destination - source) if source is not None else 0.0
    return None if stood is None else _judged(seen, "destination", stood, destination, on_the_way)


def _judged(seen: ColumnSeen, place: str, stood: float, air: float, on_the_way: float) -> tuple[str, bool]:
    unit = UNITS[seen.column]
    far = abs(stood - air) > _allowed(seen) + on_the_way
    return f"stands at {stood:.1f} {unit} in the {place} air, which is said to have {air:.1f} {unit}", far


def _allowed(seen: ColumnSeen) -> float:
    return limit("stood_percent" if seen.column == HUMIDITY else "stood_k")


def _at_rest(seen: ColumnSeen, there: np.ndarray) -> float | None:
    """What a sensor read at the end of a rest; None where it had not come to one, for all that its own pace tells."""
    time, value = seen.time_s[there], seen.value[there]
    if value.size < LEAST_READINGS:
        return None
    parts = [float(np.median(part)) for part in np.array_split(value, REST_PARTS)[-2:]]
    drift = abs(parts[-1] - parts[-2]) / max(float(time[-1] - time[0]) / REST_PARTS, 1e-9)
    rise_s = seen.crossing_s(0.63) - seen.crossing_s(0.1) if seen.moves else 0.0
    window_s = float(time[-1] - time[0])
    # A slow sensor that drifts no faster than noise may still be far from where it goes.
    return parts[-1] if drift * max(3.0 * rise_s, window_s) < 0.25 * _allowed(seen) else None
