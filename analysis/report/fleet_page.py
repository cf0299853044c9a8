"""The page of `shockrig fleet`: who belongs, what a type's sensors are, each sensor beside the others, what drifts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from shockrig.analysis.estimate.quantity import QUANTITIES
from shockrig.analysis.fleet.fleet_prior import WithFleet
from shockrig.analysis.report.html import Block, Cell, Details, Figure, HtmlPage, KeyNumber, Section, Table, Text
from shockrig.files.figures import save_figure
from shockrig.files.fleet_file import (
    BENCH,
    SENSOR,
    TYPE,
    Coordinate,
    Fleet,
    FleetCause,
    FleetFigure,
    FleetSensor,
    FleetTrend,
)
from shockrig.files.fleet_views import nearest_figure, plot_fleet
from shockrig.files.numbers import counted, measured, plain

NOUN: dict[str, str] = {name: quantity.noun for name, quantity in QUANTITIES.items()}
SYMBOL: dict[str, str] = {name: quantity.symbol for name, quantity in QUANTITIES.items()}
NAMES_SHOWN = 5  # names in a sentence
OPEN_ROWS = 30  # of the table of sensors, that are shown without being asked for


def verdict(fleet: Fleet) -> str:
    """The sentence a colleague would say."""
    said = [f"{counted(len(fleet.sensors), 'sensor')} of one type."]
    strangers = {
        name: [NOUN[c] for c in fleet.population.sensors if name in fleet.outsiders(c)]
        for channel in fleet.population.sensors
        for name in fleet.outsiders(channel)
    }
    if strangers:
        names = [f"{name} ({' and '.join(by)})" for name, by in strangers.items()]
        shown = ", ".join(names[:NAMES_SHOWN]) + (
            f" and {len(names) - NAMES_SHOWN} more" if len(names) > NAMES_SHOWN else ""
        )
        does, is_ = ("does", "is") if len(names) == 1 else ("do", "are")
        said.append(f"{shown} {does} not belong and {is_} left as measured.")
    else:
        said.append("All belong together.")
    said += [sentence(trend) for trend in fleet.trends]
    said += [cause_sentence(one) for one in fleet.causes if one.whose == BENCH]
    if fleet.left_out:
        said.append(f"{counted(len(fleet.left_out), 'campaign')} left out.")
    return " ".join(said)


def sentence(trend: FleetTrend) -> str:
    """What differs along the fleet, by how much, and since when."""
    symbol = SYMBOL[trend.channel]
    by = measured(100.0 * trend.change.value, 100.0 * trend.change.standard_uncertainty, "%")
    if trend.per == "year":
        return f"{symbol} changes by {by} in a year."
    return f"{symbol} differs by {by} from serial number {trend.since} on: another batch."


def cause_sentence(one: FleetCause) -> str:
    """Whose a cause is, and why."""
    what = f"{' or '.join((one.effect, *one.look_alikes))} ({NOUN[one.channel]})"
    many = f"{len(one.sensors)} of {one.diagnosed} sensors show it"
    not_ = f", and not {' or '.join(one.ruled_out)}" if one.ruled_out else ""
    if one.whose == SENSOR:
        return f"{what} is {one.sensors[0]}'s own{not_}: none of the other {one.diagnosed - 1} sensors shows it."
    if one.whose == BENCH:
        return f"{what} is the bench's{not_}: {many}, with one value, in {counted(len(one.campaigns), 'campaign')}."
    if one.whose == TYPE:
        scatters = not all(p.common for p in one.parameters.values())
        why = "with values that differ" if scatters else f"with one value in {counted(len(one.campaigns), 'campaign')}"
        return f"{what} is the type's{not_}: {many}, {why}."
    return f"{what}: {many}; whether it is theirs or a bench's is open."


def strange(fleet: Fleet, sensor: FleetSensor, channel: str) -> str:
    """By how much a sensor that does not belong is off, and how sure that is."""
    found = sensor.channels[channel]
    parts = []
    for k, one in enumerate(fleet.population.coordinates):
        nearest = nearest_figure(found.figures, one) if one.channel == channel else None
        if nearest is None or not one.log:
            continue
        middle = float(fleet.population.design([nearest.coordinate])[0] @ fleet.population.mean)
        away = math.log(nearest.own.value) - middle
        spread = math.hypot(
            nearest.own.standard_uncertainty / nearest.own.value, math.sqrt(fleet.population.predictive[k, k])
        )
        parts.append(f"{nearest.coordinate.label} {100.0 * math.expm1(away):+.1f} % ({away / spread:+.1f} sigma)")
    chance = f"one as far off by accident: {plain(found.probability, 2)}, adjusted {plain(found.adjusted, 2)}"
    return f"{sensor.name}: {', '.join(parts).replace('-', '−')} from the others; {chance}."


def write_fleet_page(fleet: Fleet, folder: Path) -> Path:
    """Write FOLDER/fleet.html and fleet.png; returns the page's path."""
    population = fleet.population
    strangers = [(s, channel) for s in fleet.sensors for channel in s.channels if not s.channels[channel].belongs]
    sections = []
    if strangers:
        sentences: list[Block] = [Text(strange(fleet, s, channel), "warning") for s, channel in strangers]
        sections.append(Section("Sensors that do not belong", sentences))
    if fleet.trends:
        trends: list[Block] = [
            Text(f"{sentence(t)} By accident: {plain(t.probability, 2)}.", "warning") for t in fleet.trends
        ]
        sections.append(Section("What differs along the fleet", trends))
    if fleet.causes:
        sections.append(Section("Whose the causes are", _causes(fleet)))
    image = save_figure(plot_fleet(fleet), folder, "fleet")
    caption = (
        "Each sensor against the mean of the type: as its own data have it (grey), with what the others say (blue), "
        "and those that do not belong (red). Bars are two standard uncertainties, the band two spreads of the type."
    )
    sections.append(Section("The sensors", [Figure(image, caption, "Each sensor beside the others"), *_tables(fleet)]))
    sections.append(Section("The type", _type(fleet)))
    if fleet.runs_in_common:
        sections.append(Section("What runs have in common", _in_common(fleet)))
    if fleet.left_out or any(s.missing for s in fleet.sensors):
        rows = [(name, why) for name, why in fleet.left_out.items()]
        rows += [(f"{s.name}, {channel}", why) for s in fleet.sensors for channel, why in s.missing.items()]
        sections.append(Section("Left out", [Table(("campaign", "why"), rows)]))
    sections.append(Section("How it is judged", [Text(HOW)]))
    numbers = [
        KeyNumber(population.label(one), _mean(fleet, k), f"sensors differ by {_spread(fleet, k)}")
        for k, one in enumerate(population.coordinates)
    ]
    page = HtmlPage(
        title="Fleet of sensors",
        verdict=verdict(fleet),
        key_numbers=numbers,
        sections=sections,
        provenance=dict(fleet.provenance),
        tone="warning" if strangers or fleet.trends else "good",
    )
    return page.write(folder / "fleet.html")


def fleet_section(found: WithFleet) -> Section:
    """What a fleet makes of one sensor's characterization."""
    blocks: list[Block] = [
        Text(said, "good" if found.belongs(name) else "warning")
        for name, said in zip(found.probability, found.sentences, strict=True)
    ]
    rows = [
        (
            f.coordinate.label,
            "–" if math.isnan(f.own.value) else measured(f.own.value, f.own.standard_uncertainty, f.coordinate.unit),
            measured(f.shrunk.value, f.shrunk.standard_uncertainty, f.coordinate.unit),
            f"{100.0 * f.share:.0f} %",
        )
        for figures in found.figures.values()
        for f in figures
    ]
    if rows:
        blocks.append(Table(("number", "own runs alone", "with the fleet: in the profile", "own data's share"), rows))
    return Section("With the fleet", blocks)


HOW = """Each sensor is characterized alone; the population is what is most likely of the means, the spreads and the
correlations of ln alpha and ln D(T) when each sensor's own uncertainty is counted (restricted likelihood). Errors that
a bench has in all of its runs move all sensors on it alike, and a run that is off in all probes all of these: they are
in the mean's uncertainty, and are no spread.

A sensor does not belong where it is too far from the population of the others, itself left out, at a false discovery
rate of 5 % over all sensors (Benjamini and Hochberg). It takes no part in the population, and nothing of it is changed.
The others are moved towards the population by as much as their own data leave open.

A drift with the date, or a batch that begins at a serial number, is said where one as plain comes by accident in less
than one of 100 fleets."""


def _causes(fleet: Fleet) -> list[Block]:
    """A sentence for each cause that diagnoses name, and its parameters."""
    rows: list[Sequence[Cell]] = [
        (
            f"{one.effect}.{name}",
            one.whose,
            measured(p.mean.value, p.mean.standard_uncertainty),
            "one value" if p.common else plain(p.spread, 2),
            ", ".join(one.sensors[:NAMES_SHOWN]) + (" ..." if len(one.sensors) > NAMES_SHOWN else ""),
        )
        for one in fleet.causes
        for name, p in one.parameters.items()
    ]
    said: list[Block] = [Text(cause_sentence(one)) for one in fleet.causes]
    heads = ("parameter", "whose", "mean ± u", "spread from sensor to sensor", "sensors")
    return [*said, *([Table(heads, rows)] if rows else []), Text(WHOSE_IT_IS)]


WHOSE_IT_IS = """A cause that most sensors show with one value, all on one bench, is taken for the bench's: a property
that all sensors share to within its uncertainty would look the same, and campaigns on another bench tell. One that most
show with values that differ, or on several benches, is the type's; one that a single sensor shows is its own."""


def _in_common(fleet: Fleet) -> list[Block]:
    """How much of what runs differ by is the bench's, of each campaign with several probes."""
    rows: list[Sequence[Cell]] = [
        (path, SYMBOL[channel], f"{100.0 * share:.0f} %")
        for path, shares in fleet.runs_in_common.items()
        for channel, share in shares.items()
    ]
    why = "What runs differ by in all probes alike is the bench's: another airflow or air than was recorded."
    return [Table(("campaign", "rate", "of what runs differ by, the same in all probes"), rows), Text(why)]


def _mean(fleet: Fleet, k: int) -> str:
    one = fleet.population
    c = one.coordinates[k]
    return one.text(c, c.natural(float(one.mean[k]), math.sqrt(one.mean_covariance[k, k])))


def _spread(fleet: Fleet, k: int) -> str:
    one = fleet.population
    spread = math.sqrt(one.covariance[k, k])
    return f"{plain(100.0 * spread, 2)} %" if one.coordinates[k].log else plain(spread, 2)


def _type(fleet: Fleet) -> list[Block]:
    one = fleet.population
    heads = ("number", "mean ± u", "spread from sensor to sensor", "degrees of freedom", "sensors")
    rows: list[Sequence[Cell]] = [
        (
            one.label(c),
            _mean(fleet, k),
            _spread(fleet, k),
            round(float(one.degrees[k])),
            one.sensors[c.channel],
        )
        for k, c in enumerate(one.coordinates)
    ]
    blocks: list[Block] = [Table(heads, rows)]
    if one.table_scatter > 0:
        blocks.append(
            Text(f"D of one sensor scatters by {plain(100.0 * one.table_scatter, 2)} % from ambient to ambient.")
        )
    if len(one.coordinates) > 1:
        labels = [one.label(c) for c in one.coordinates]
        spread = [math.sqrt(v) for v in one.covariance.diagonal()]
        correlations = [
            (label, *(f"{one.covariance[k, j] / (spread[k] * spread[j]):.2f}" for j in range(len(labels))))
            for k, label in enumerate(labels)
        ]
        blocks.append(Table(("correlation", *labels), correlations))
    return blocks


def _tables(fleet: Fleet) -> list[Block]:
    """The sensors' numbers: those of the first sensors at sight, all behind a line."""
    population = fleet.population
    timed = [c for c in population.coordinates if c.unit]
    heads = (
        "sensor",
        *(population.label(c) for c in population.coordinates),
        *(f"t63 with {population.label(c)}" for c in timed),
        "own data's share",
        "runs",
    )
    rows: list[Sequence[Cell]] = []
    for sensor in fleet.sensors:
        cells: list[Cell] = []
        times: dict[Coordinate, Cell] = dict.fromkeys(timed)
        shares = []
        for c in population.coordinates:
            found = sensor.channels.get(c.channel)
            nearest: FleetFigure | None = None if found is None else nearest_figure(found.figures, c)
            if nearest is None:
                cells.append(None)
                continue
            cells.append(population.text(nearest.coordinate, nearest.shrunk))
            shares.append(nearest.share)
            if (t63 := nearest.t63_s) is not None:
                times[c] = measured(t63.value, t63.standard_uncertainty, "s")
        share = f"{100.0 * min(shares):.0f} to {100.0 * max(shares):.0f} %" if shares else None
        rows.append(
            (sensor.name, *cells, *times.values(), share, sum(found.runs for found in sensor.channels.values()))
        )
    if len(rows) <= OPEN_ROWS:
        return [Table(heads, rows)]
    return [Details(f"All {len(rows)} sensors", [Table(heads, rows)])]
