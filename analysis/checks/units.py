"""Wrong units: temperatures in fahrenheit or kelvin, humidity as a fraction of 1; milliseconds or minutes for seconds.

The readings and run.json are held against each other: what agrees only after a conversion is in that unit. Where all
of them agree, what no air can be decides, and the grid of a logger's digits. Times are those of the tables' time_s, of
transfer.start_s, or of both.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from shockrig.analysis.checks.finding import Channel, InputFinding, limit
from shockrig.analysis.checks.signals import (
    CHANNEL_OF,
    CHANNEL_OF_FILE,
    CHANNEL_OF_SENSOR,
    DIE,
    FILES,
    HUMIDITY,
    OTHER_SENSOR,
    TEMPERATURE,
    Array,
    CampaignView,
    ColumnSeen,
    mostly_impossible,
    stated,
)
from shockrig.analysis.physics.humidity import dew_point_c
from shockrig.files.campaign import Run
from shockrig.files.campaign_names import KNOWN_KINDS
from shockrig.files.traces import Trace

RUN_JSON = "run.json"
Plateaus = tuple[float | None, float | None]


@dataclass(frozen=True)
class Unit:
    """A wrong unit: what the values are in, how they become right, and how that is said."""

    kind: str
    quantity: str
    words: str
    convert: Callable[[float], float]
    remedy: str


FAHRENHEIT = Unit("fahrenheit", TEMPERATURE, "fahrenheit", lambda x: (x - 32.0) / 1.8, "convert: (value - 32) / 1.8")
KELVIN = Unit("kelvin", TEMPERATURE, "kelvin", lambda x: x - 273.15, "subtract 273.15")
FRACTION = Unit("fraction_for_percent", HUMIDITY, "fractions of 1", lambda x: 100.0 * x, "multiply by 100")


def mixed_units(view: CampaignView) -> Iterator[InputFinding]:
    """Files of one campaign in different units: one agrees with another only once it is converted."""
    for unit in (FAHRENHEIT, KELVIN, FRACTION):
        wrong: dict[str, list[str]] = {}
        shown: dict[str, str] = {}
        for run in view.campaign.runs:
            places = _places(view, run, unit.quantity)
            for name, values in places.items():
                for other, right in places.items():
                    if other != name and _only_after(unit, values, right):
                        if run.id not in wrong.setdefault(name, []):
                            wrong[name].append(run.id)
                        shown.setdefault(name, _both(values, right, name, other, run))
        for runs in {tuple(runs): None for runs in wrong.values()}:
            names = [name for name in wrong if tuple(wrong[name]) == runs]
            label = "humidities" if unit.quantity == HUMIDITY else "temperatures"
            yield InputFinding(
                unit.kind,
                _channel(unit, names),
                runs,
                "stop",
                f"The {label} in {' and '.join(names)} of {view.words(runs)} seem to be in {unit.words} "
                f"({shown[names[0]]}): {unit.remedy}.",
            )


def everything_in_fahrenheit(view: CampaignView) -> Iterator[InputFinding]:
    """All temperatures in fahrenheit: dew points that no air has, or readings on a grid of °C seen through °F."""
    dew, example, runs = -np.inf, "", []
    for run in view.campaign.runs:
        places = _places(view, run, TEMPERATURE)
        if places:
            runs.append(run.id)
        humid = _places(view, run, HUMIDITY)
        for end, word in enumerate(("source", "destination")):
            warm = [level for p in places.values() if (level := p[end]) is not None]
            moist = [level for p in humid.values() if (level := p[end]) is not None]
            if not warm or not moist or max(warm) - min(warm) > limit("agree_k") or min(moist) < 1.0:
                continue
            here = float(dew_point_c(np.median(moist), np.median(warm)))
            if here > dew:
                dew = here
                example = (
                    f"the {word} of run {run.id} would be {np.median(warm):.1f} °C at {np.median(moist):.0f} %RH, "
                    f"a dew point of {here:.0f} °C"
                )
    columns = [seen for column in (TEMPERATURE, DIE) for seen in view.column(column)]
    if dew <= limit("highest_dew_point_c"):
        printed = [seen for seen in columns if _printed_in_celsius(seen)]
        if not printed or len(printed) < 0.5 * len(columns):
            return
        value = printed[0].value[0]
        example = (
            f"the readings lie on whole steps of a converted scale, such as {value:.3f}, which is "
            f"{FAHRENHEIT.convert(value):.2f} °C"
        )
    yield InputFinding(
        "fahrenheit",
        None,
        tuple(runs),
        "stop",
        f"All temperatures seem to be in fahrenheit ({example}): {FAHRENHEIT.remedy} in every file.",
    )


def everything_in_kelvin(view: CampaignView) -> Iterator[InputFinding]:
    """Temperatures in kelvin, read as in degC; of those that the reader dropped as no readings it keeps the median."""
    for sensor, column in (("imet", TEMPERATURE), ("hyt", DIE)):
        medians = in_kelvin(view, sensor)
        if medians:
            value = float(np.median(list(medians.values())))
            yield InputFinding(
                "kelvin",
                CHANNEL_OF[column],
                tuple(medians),
                "stop",
                f"The temperatures in {FILES[column]} of {view.words(medians)} seem to be in kelvin "
                f"(median {value:.1f}): {KELVIN.remedy}, {value - 273.15:.1f} °C.",
            )


def in_kelvin(view: CampaignView, sensor: str) -> dict[str, float]:
    """Median temperature of each run of a sensor that seems to be in kelvin: no air has it in °C, and it lies nearer
    to what the sensor's other runs read once it is converted."""
    medians = {run.id: _median_c(getattr(run, sensor)) for run in view.campaign.runs}
    # An oven is as warm in degC, and was colder before, or in another run.
    may_be = {
        run.id
        for run in view.campaign.runs
        if _may_be_kelvin(medians[run.id]) and _stays(getattr(run, sensor)) and not _says_its_unit(run, "temperatures")
    }
    usual = np.array([m for run, m in medians.items() if np.isfinite(m) and run not in may_be])
    middle = float(np.median(usual)) if usual.size else -np.inf  # a campaign that is in kelvin throughout
    return {
        run: m for run, m in medians.items() if run in may_be and abs(KELVIN.convert(m) - middle) <= abs(m - middle)
    }


def _stays(trace: Trace) -> bool:
    """Whether a run's temperatures, but for the coldest and the hottest, may all be in kelvin."""
    readings = trace.values["temperature_c"]
    known = readings[np.isfinite(readings)]
    return mostly_impossible(trace) or all(map(_may_be_kelvin, np.quantile(known, [0.05, 0.95])))


def _median_c(trace: Trace | None) -> float:
    """Of the temperatures as the file has them, of those that were dropped where most were; NaN without any."""
    if trace is None:
        return float("nan")
    readings = trace.values.get("temperature_c", np.array([]))
    if mostly_impossible(trace):
        return float(trace.impossible.get("temperature_c", np.nan))
    return float(np.nanmedian(readings)) if np.isfinite(readings).any() else float("nan")


def everything_a_fraction(view: CampaignView) -> Iterator[InputFinding]:
    """All humidities as fractions of 1: nothing in the campaign exceeds 130 % taken so."""
    columns = view.column(HUMIDITY)
    if not columns:
        return
    highest = max(float(np.percentile(seen.value, 99)) for seen in columns)
    airs = [air for run in view.campaign.runs for air in stated(run, HUMIDITY) if air is not None]
    levels = [level for seen in columns for level in (seen.before, seen.after)]
    spread = max(levels) - min(levels)
    if max([highest, *airs]) > limit("highest_fraction") or spread < 0.02 or max(levels) < 0.05:
        return
    yield InputFinding(
        "fraction_for_percent",
        "humidity",
        tuple(seen.run.id for seen in columns),
        "stop",
        f"All humidities lie between {min(levels):.3g} and {max(levels):.3g} and seem to be {FRACTION.words}, "
        f"not percent: {FRACTION.remedy}.",
    )


def _may_be_kelvin(value: float) -> bool:
    """Whether a temperature that no air has in °C may be one in kelvin, from -103 to 127 °C; not where it is NaN."""
    return 170.0 < value < 400.0


def _places(view: CampaignView, run: Run, quantity: str) -> dict[str, Plateaus]:
    """What each file says of a run's two airs, in `quantity`: run.json and the readings before and after."""
    places: dict[str, Plateaus] = {}
    if run.air is None and any(value is not None for value in stated(run, quantity)):
        places[RUN_JSON] = stated(run, quantity)
    for column in (TEMPERATURE, DIE) if quantity == TEMPERATURE else (HUMIDITY,):
        seen = view.get(run, column)
        if seen is not None:
            places[FILES[column]] = (seen.before, seen.after)
    return places


def _only_after(unit: Unit, values: Plateaus, right: Plateaus) -> bool:
    """Whether `values` agree with `right` once they are converted, and are far from them before."""
    near = limit("agree_k" if unit.quantity == TEMPERATURE else "agree_percent")
    pairs = [(v, r) for v, r in zip(values, right, strict=True) if v is not None and r is not None]
    if not pairs or (unit is FRACTION and not all(v <= limit("highest_fraction") for v, _ in pairs)):
        return False
    moved = abs(pairs[-1][1] - pairs[0][1])
    allowed = [near, near + limit("unsettled_share") * moved]  # at its end a slow sensor is on its way
    if any(abs(unit.convert(v) - r) > a for (v, r), a in zip(pairs, allowed, strict=False)):
        return False
    apart = limit("apart_factor") * near
    return all(abs(v - r) > apart for v, r in pairs) or (unit is FRACTION and any(abs(v - r) > apart for v, r in pairs))


def _both(values: Plateaus, right: Plateaus, name: str, other: str, run: Run) -> str:
    v, r = next((v, r) for v, r in zip(values, right, strict=True) if v is not None and r is not None)
    return f"in run {run.id} {name} has {v:.4g} where {other} has {r:.4g}"


def _channel(unit: Unit, names: list[str]) -> Channel:
    if unit.quantity == HUMIDITY:
        return "humidity"
    if len(names) > 1 or names[0] == RUN_JSON:
        return None
    return CHANNEL_OF_FILE[names[0]]


def _printed_in_celsius(seen: ColumnSeen) -> bool:
    """Whether readings lie on a decimal grid of °C once converted from °F, and on no decimal grid as they are.

    A logger that rounds to 0.1 or 0.01 °C leaves such a grid in what a program converts to °F afterwards.
    """
    different = np.unique(seen.value)
    if different.size < 8:
        return False
    return any(_on_grid((different - 32.0) / 1.8, step) for step in (0.1, 0.01)) and not _on_grid(different, 0.01)


def _on_grid(values: Array, step: float) -> bool:
    off = np.abs(values / step - np.round(values / step))
    return bool((off < 0.02).mean() >= limit("lattice_share"))


# Milliseconds for seconds: in the tables' time_s, in transfer.start_s, or in both.

SENSORS = {"imet": (TEMPERATURE,), "hyt": (HUMIDITY, DIE)}
MILLI = 1e-3


def times_in_milliseconds(view: CampaignView) -> Iterator[InputFinding]:
    """`time_s` in milliseconds: against the other sensor, against the stated start, or by how far readings are apart.

    Where nothing else tells: readings more than a minute apart that are no whole number of quarter minutes apart, as
    environmental loggers take them (a warning for a kind of sensor that is not known), or responses slower than any
    sensor's.
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
            _channel_of_sensors(names),
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
        # How slow a sensor of another kind may be nobody knows: its own clock is not refused.
        sure = odd and all(_may_be_known(view, n) for n in names)
        shown = f" and respond within {slow:.3g} s" if slow else ""
        yield InputFinding(
            "milliseconds",
            _channel_of_sensors(names),
            runs,
            "stop" if sure else "warn",
            f"The readings in {_files(names)} of {view.words(runs)} are {period:.4g} s apart{shown}: "
            + (
                "time_s seems to be in milliseconds, divide it (and transfer.start_s) by 1000."
                if sure
                else "few sensors are so slow. Either what was measured changed so slowly itself: then log the air or "
                "the water beside it, as its reference; or time_s is in milliseconds: then divide it (and "
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


def _may_be_known(view: CampaignView, sensor: str) -> bool:
    """Whether nothing says that a sensor is of another kind than those whose bodies are known."""
    kind = view.campaign.sensors.get(sensor, {}).get("kind")
    return not kind or kind in KNOWN_KINDS


def _says_its_unit(run: Run, what: str = "times") -> bool:
    """Whether a run was imported from a log that writes dates, or names the unit of its times or temperatures."""
    imported = run.extra.get("imported")
    return isinstance(imported, Mapping) and imported.get(what) in ("dates", "named")


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


def _channel_of_sensors(names: Sequence[str]) -> Channel:
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
