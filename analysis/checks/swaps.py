"""Things in one another's place: source and destination, the two sensors' readings, the columns of hyt.csv."""

from __future__ import annotations

from collections.abc import Iterator

from shockrig.analysis.checks.finding import Channel, InputFinding
from shockrig.analysis.checks.signals import DIE, HUMIDITY, TEMPERATURE, CampaignView, ColumnSeen, stated
from shockrig.analysis.checks.thresholds import limit
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
