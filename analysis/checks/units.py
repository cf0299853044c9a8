"""Wrong units: temperatures in fahrenheit or kelvin, humidity as a fraction of 1.

The readings and run.json are held against each other: what agrees only after a conversion is in that unit. Where all
of them agree, what no air can be decides, and the grid of a logger's digits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from shockrig.analysis.checks.finding import Channel, InputFinding
from shockrig.analysis.checks.signals import (
    CHANNEL_OF,
    CHANNEL_OF_FILE,
    DIE,
    FILES,
    HUMIDITY,
    TEMPERATURE,
    Array,
    CampaignView,
    ColumnSeen,
    stated,
)
from shockrig.analysis.checks.thresholds import limit
from shockrig.analysis.physics.humidity import dew_point_c
from shockrig.files.campaign import Run

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
    """Temperatures in kelvin: the reader drops them as beyond what can be, and keeps their median."""
    for sensor, column in (("imet", TEMPERATURE), ("hyt", DIE)):
        medians = {}
        for run in view.campaign.runs:
            trace = getattr(run, sensor)
            if trace is None:
                continue
            readings = trace.values.get("temperature_c", np.array([]))
            lost = trace.impossible.get("temperature_c", np.nan)
            if trace.dropped.get("implausible", 0) <= trace.time_s.size:
                lost = float(np.nanmedian(readings)) if np.isfinite(readings).any() else np.nan
            if is_kelvin(lost):
                medians[run.id] = lost
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


def is_kelvin(value: float) -> bool:
    """Whether a temperature that no air has in °C is one in kelvin, from -103 to 127 °C; not where it is NaN."""
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
