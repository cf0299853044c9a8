"""What response times say of the input: lengths in another unit, rates that no material has, runs of another sensor."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from shockrig.analysis.checks.finding import InputFinding
from shockrig.analysis.checks.groups import Grouping, two_groups
from shockrig.analysis.checks.response import RunResponse, responses, temperature_of
from shockrig.analysis.checks.signals import CHANNEL_OF, FILES, HUMIDITY, TEMPERATURE, Array, CampaignView
from shockrig.analysis.checks.thresholds import limit

# D t63 / L^2 of a film's mean and alpha t63 / R^2 of a sphere's core after a step (analysis/physics/modes.py)
LANDMARKS = {TEMPERATURE: 0.17091, HUMIDITY: 0.32025}
LENGTHS = {
    TEMPERATURE: ("imet", "bead_radius_m", "sphere", "alpha", "smallest_alpha_m2_s", "largest_alpha_m2_s"),
    HUMIDITY: ("hyt", "film_thickness_m", "film", "D", "smallest_d_m2_s", "largest_d_m2_s"),
}


def response_times(view: CampaignView) -> Iterator[InputFinding]:
    """What the response times of each channel say of stated lengths, and of the runs' belonging together."""
    for column in (TEMPERATURE, HUMIDITY):
        found = responses(view, column)
        if found:
            yield from _length_and_rate(view, column, found)
            yield from _another_sensor(view, column, found)


def _length_and_rate(view: CampaignView, column: str, found: list[RunResponse]) -> Iterator[InputFinding]:
    """A stated length in millimetres or micrometres, or a diffusivity that no material has.

    Only where the length is stated and the body is the one that it belongs to: else the rate alone is known.
    """
    sensor, key, body, symbol, smallest, largest = LENGTHS[column]
    length = view.campaign.sensors.get(sensor, {}).get(key)
    if length is None or view.campaign.bodies.get(sensor) != body:
        return
    t63 = float(np.median([r.t63_s for r in found]))
    rate = LANDMARKS[column] * length**2 / t63
    low, high = limit(smallest), limit(largest)
    if low <= rate <= high:
        return
    runs = tuple(r.seen.run.id for r in found)
    shown = f"{key} of {length:g} m and a response time of {t63:.3g} s make {symbol} {rate:.2g} m²/s"
    plausible = f"plausible is {low:g} to {high:g}"
    for factor, unit in ((1e-3, "millimetres"), (1e-6, "micrometres")):
        if low <= rate * factor**2 <= high:
            yield InputFinding(
                f"length_in_{unit}",
                CHANNEL_OF[column],
                runs,
                "stop",
                f"sensors.{sensor}.{key} in campaign.json seems to be in {unit} ({shown}; {plausible}): write "
                f"{length * factor:g}.",
            )
            return
    yield InputFinding(
        "implausible_rate",
        CHANNEL_OF[column],
        runs,
        "warn",
        f"{shown}, and {plausible}: check sensors.{sensor}.{key} and the unit of time_s; leave the length out where it "
        f"is not known, and {symbol} is quoted for the usual one.",
    )


def _another_sensor(view: CampaignView, column: str, found: list[RunResponse]) -> Iterator[InputFinding]:
    """Runs of another sensor among the rest: response times in two groups that no recorded condition explains."""
    found = [r for r in found if temperature_of(view, r.seen) is not None]
    if len(found) < 6:
        return
    conditions, slope = _conditions(view, found)
    airflow_known = all(r.seen.run.airflow_m_s is not None for r in found)
    share = limit("group_share" if airflow_known else "group_share_airflow_unknown")
    grouping = two_groups(np.log([r.t63_s for r in found]), conditions, slope, share)
    if grouping is None or not _certain(grouping, column):
        return
    second = grouping.second if grouping.second.sum() <= 0.5 * len(found) else ~grouping.second
    runs = tuple(r.seen.run.id for r, there in zip(found, second, strict=True) if there)
    yield InputFinding(
        "another_sensor",
        CHANNEL_OF[column],
        runs,
        "warn",
        f"The response times in {FILES[column]} fall into two groups a factor {np.exp(grouping.difference):.2f} apart "
        f"that no recorded condition explains ({len(runs)} and {len(found) - len(runs)} runs, each alike to "
        f"{100 * grouping.scatter:.1f} %): {view.words(runs)} seem to be of another sensor, or of a condition that "
        "run.json does not state; make a campaign of each.",
    )


def _certain(grouping: Grouping, column: str) -> bool:
    least = limit("group_difference_film" if column == HUMIDITY else "group_difference")
    return (
        grouping.difference >= least
        and grouping.difference >= limit("group_over_scatter") * grouping.scatter
        and grouping.chance <= limit("group_chance")
        and grouping.least_alone >= limit("group_alone")
    )


def _conditions(view: CampaignView, found: list[RunResponse]) -> tuple[list[Array], Array | None]:
    """What a response time may depend on, as columns (n,), and along what two sensors may differ otherwise than by a
    factor: the temperature, where it varies (a film's D has its own dependence on it)."""
    seen = [r.seen for r in found]
    kelvin = np.array([temperature_of(view, s) for s in seen], dtype=float) + 273.15
    inverse = 1e4 * (1.0 / kelvin - 1.0 / 293.15)
    columns = [np.ones(len(seen)), inverse]
    airflows = [s.run.airflow_m_s for s in seen if s.run.airflow_m_s]
    if len(airflows) == len(seen):
        columns.append(np.log(airflows))
    if seen[0].column == TEMPERATURE:
        columns.append(np.sign([s.step for s in seen]))
        return columns, None
    columns.append(inverse**2)
    # direction, size and level of a humidity step matter in ways of their own: each kind of step is a condition
    kinds = list(zip(_levels([s.before for s in seen]), _levels([s.after for s in seen]), strict=True))
    columns += [np.array([kind == one for kind in kinds], dtype=float) for one in sorted(set(kinds))]
    return columns, inverse - inverse.mean() if np.ptp(inverse) > 1.0 else None


def _levels(values: list[float]) -> list[int]:
    """Values as numbered levels: a gap of more than 4 %RH begins a new one."""
    order = np.argsort(values)
    number = np.cumsum(np.diff(np.asarray(values)[order], prepend=values[order[0]]) > 4.0)
    return [int(n) for n in number[np.argsort(order)]]
