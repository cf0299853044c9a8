"""The page of `shockrig learn`: what flights say of their sensor, what they leave open, and how far passes disagree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.learn.bins import FlightBins
from shockrig.analysis.learn.density import EDDY_M, EDDY_S, LAYER_SHARE, MOVED_M, MOVED_M_PER_H
from shockrig.analysis.learn.laws import CAUSE_WORDS, LAWS, Law
from shockrig.analysis.learn.learn import (
    NAMED_FROM,
    POSSIBLE_FROM,
    ChannelLearned,
    FlightCause,
    FlightsLearned,
    LearnedNumber,
)
from shockrig.analysis.learn.passes import Disagreement
from shockrig.analysis.report.diagnosis_words import listed
from shockrig.analysis.report.html import Block, Cell, Details, Figure, HtmlPage, KeyNumber, Section, Table, Text
from shockrig.files.figures import BLUE, GREY, ORANGE, literal, notebook_figure, styled
from shockrig.files.numbers import between, counted, measured, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

Array = NDArray[np.float64]

MOST_DRAWN = 4  # flights in a figure
INTERVAL_FROM = 0.5  # relative standard uncertainty from which a positive number is given with the ends of its interval
LEAST_WEIGHT = 1e-3  # of a model that the table shows
UNITS = {"temperature": "K", "humidity": "%RH"}
AXES = {"temperature": "temperature, °C", "humidity": "relative humidity, %"}
SENSOR = {"temperature": "The thermometer", "humidity": "The hygrometer"}

LAW_WORDS = {
    "clock_offset": "a shift in time between altitude and readings",
    "lag": "a lag",
    "lag_in_the_cold": "a lag that grows in the cold",
    "second_path": "a slow second path",
    "offset_in_descent": "an offset in descent",
    "ventilated_warmth": "a warmth that airflow carries off",
    "warm_die": "a chip warmer than the air",
    "late_die": "a chip that follows the air's temperature late",
    "film_unlike_in_descent": "a film that is not as warm as the bead in descent",
}
# What tells causes apart that give the same readings in every flight that is analysed here.
TELLS_APART = {
    "clock_offset": "a barometer beside a satellite altitude: a lagging pressure shows between the two",
    "second_path": "the sensor out of its housing, or a bench",
    "offset_in_descent": "the same sensor under a balloon, far from any rotor",
    "ventilated_warmth": "a flight at night: what remains then is the sensor's own warmth",
    "warm_die": "a flight at night: what remains then is the sensor's own warmth",
    "film_unlike_in_descent": "the same sensor under a balloon, far from any rotor",
}


def write_learned_page(
    learned: FlightsLearned,
    path: Path,
    files: Sequence[str],
    decides: Sequence[str] = (),
    provenance: Mapping[str, Cell] | None = None,
) -> Path:
    """Write the page of flights that were learned from.

    Parameters
    ----------
    learned : FlightsLearned
    path : Path
        Of the page.
    files : sequence of str
        The logs as they were given.
    decides : sequence of str
        Sentences on the flights that would decide what is open; empty: the page says what they have to vary.
    provenance : mapping, optional
        Ends the page, behind the logs.
    """
    sections = [Section("What acts on the readings", _acting(learned))]
    if open_ := _left_open(learned, decides):
        sections.append(Section("What cannot be told apart, and the flight that would", open_))
    sections.append(Section("How far passes disagree", _disagreeing(learned)))
    sections.append(Section("Models and their weights", [_models(learned)]))
    sections.append(Section("The flights", _flights(learned)))
    sections.append(Section("What was assumed", _assumed()))
    worse = [name for name, one in learned.channels.items() if _worse(learned, name, one)]
    one_flight = len(learned.bins) == 1
    settled = all(one.verdict in ("named", "adequate") for one in learned.channels.values())
    page = HtmlPage(
        title=f"What {counted(len(learned.bins), 'flight')} {'says' if one_flight else 'say'} of the sensor",
        verdict=verdict(learned),
        key_numbers=_key_numbers(learned),
        sections=sections,
        provenance={"flights": ", ".join(files), **(provenance or {})},
        tone="bad" if worse else "good" if settled else "warning",
    )
    return page.write(path)


def verdict(learned: FlightsLearned) -> str:
    """A sentence on each channel, on the clock where it may be off, and on a correction that does harm."""
    said = [_channel_sentence(name, one) for name, one in learned.channels.items()]
    for cause in learned.position:
        shift = cause.parameters[0]
        behind = (
            f"{measured(abs(shift.value), shift.standard_uncertainty)} s {'behind' if shift.value > 0 else 'ahead of'}"
        )
        if learned.position_named:
            said.append(f"The altitude is {behind} the readings.")
        else:
            said.append(f"The altitude may be {behind} the readings (probability {_probability(cause.probability)}).")
    said += [
        f"On flights that were not fitted, correcting the {name} makes passes disagree more than the readings do."
        for name, one in learned.channels.items()
        if _worse(learned, name, one)
    ]
    return " ".join(said)


def _channel_sentence(channel: str, one: ChannelLearned) -> str:
    who = SENSOR[channel]
    if one.verdict == "adequate":
        return f"{who} is adequate: these flights need nothing to explain how its passes differ but air that changed."
    if one.verdict == "not identifiable":
        return f"{who}'s lag cannot be identified from these flights: {one.why}."
    certain = [cause for cause in one.causes if cause.probability >= NAMED_FROM]
    unsure = [cause for cause in one.causes if cause.probability < NAMED_FROM]
    has = [f"has {listed([_with_numbers(cause) for cause in certain])}"] if certain else []
    # A model holds one kind of lag at most, so that the probabilities of several add up.
    lags = [cause for cause in unsure if cause.law.lags is not None]
    unsettled = []
    if len(lags) > 1 and sum(cause.probability for cause in lags) >= NAMED_FROM:
        unsettled.append(f"lags by {_likely(lags, one)}")
        unsure = [cause for cause in unsure if cause not in lags]
    if unsure:
        unsettled.append(f"may {'also ' if has or unsettled else ''}have {_likely(unsure, one)}")
    if unsettled:
        return f"{who} {', and '.join([*has, *unsettled])}; these flights do not settle it."
    said = f"{who} {has[0]}"
    if several := [cause for cause in certain if len(cause.law.causes) > 1]:
        return f"{said}, by {listed([_cause(key) for key in several[0].law.causes], 'or')}: flights alone cannot tell."
    return f"{said}."


def _likely(causes: Sequence[FlightCause], one: ChannelLearned) -> str:
    """Those of the likeliest model act together; each of the others may be in place of them."""
    both, others = one.together(causes)
    said = [
        [f"{_law(cause.law)} (probability {_probability(cause.probability)})" for cause in some]
        for some in (both, others)
    ]
    if len(both) > 1 and others:
        return f"{listed(said[0])}, or {listed(said[1], 'or')}"
    return listed(said[0]) if len(both) > 1 else listed([*said[0], *said[1]], "or")


def _law(law: Law) -> str:
    return LAW_WORDS.get(law.key, law.key.replace("_", " "))


def _cause(key: str) -> str:
    return CAUSE_WORDS.get(key, key.replace("_", " "))


def _with_numbers(cause: FlightCause) -> str:
    numbers = ", ".join(" ".join(_number(one)) for one in cause.parameters)
    return f"{_law(cause.law)} ({numbers})" if numbers else _law(cause.law)


def _number(one: LearnedNumber) -> tuple[str, str]:
    """Name and value of a law's number, as a person says them."""
    name = one.parameter.words
    if one.parameter.log and one.standard_uncertainty > INTERVAL_FROM * one.value:
        factor = float(np.exp(one.standard_uncertainty / one.value))
        return name, f"{between(one.value, one.value / factor, one.value * factor)} {one.unit}"
    scale, unit = {"1": (100.0, " %"), "1/K": (100.0, " % per K")}.get(one.unit, (1.0, f" {one.unit}"))
    return name, f"{measured(scale * one.value, scale * one.standard_uncertainty)}{unit}"


def _probability(value: float) -> str:
    return "above 0.99" if value > 0.99 else "below 0.01" if value < 0.01 else f"{value:.2f}"


def _judges(learned: FlightsLearned, channel: str) -> int:
    """Flights with a channel: with fewer than two, none is left to judge a fit."""
    return sum(one.has(channel) for one in learned.bins)


def _worse(learned: FlightsLearned, channel: str, one: ChannelLearned) -> bool:
    """Whether passes that were not fitted disagree more when corrected, in the digits that the page shows."""
    more = one.model.rms > one.read.rms and plain(one.model.rms, 2) != plain(one.read.rms, 2)
    return more and _judges(learned, channel) > 1


def _key_numbers(learned: FlightsLearned) -> list[KeyNumber]:
    numbers = []
    for channel, one in learned.channels.items():
        note = f"{one.verdict}; with the best single lag {plain(one.single.rms, 2)} {UNITS[channel]}"
        if _judges(learned, channel) > 1:
            value = f"{plain(one.read.rms, 2)} → {plain(one.model.rms, 2)} {UNITS[channel]}"
        else:
            value, note = (
                f"{plain(one.read.rms, 2)} {UNITS[channel]} as read",
                f"{one.verdict}; no flight left to judge",
            )
        numbers.append(KeyNumber(f"{channel}: passes disagree by", value, note))
    used = sum(len(one.passes) for one in learned.bins)
    numbers.append(
        KeyNumber("flights", f"{len(learned.bins)} used", f"{used} passes; {len(learned.left_out)} left out")
    )
    return numbers


def _acting(learned: FlightsLearned) -> list[Block]:
    rows: list[list[Cell]] = []
    for channel, one in learned.channels.items():
        if not one.causes:
            rows.append([channel, one.verdict, "nothing", "–", "–", "–"])
        rows += [[channel, one.verdict, *row] for cause in one.causes for row in _cause_rows(cause)]
    word = "named" if learned.position_named else "open"
    rows += [["altitude", word, *row] for cause in learned.position for row in _cause_rows(cause)]
    columns = ("of", "verdict", "what acts", "probability", "number", "value ± standard uncertainty")
    text = (
        "A probability is the sum of the weights of all models that contain it. It is named from "
        f"{NAMED_FROM:g} on, and listed from {POSSIBLE_FROM:g} on. Its numbers are those under the likeliest model "
        "that contains it."
    )
    blocks: list[Block] = [Table(columns, rows), Text(text)]
    for channel, one in learned.channels.items():
        if one.verdict == "not identifiable":
            said = f"A single lag of up to {plain(one.limit_s, 2)} s may be hidden (95 %)."
            blocks.append(Text(f"{SENSOR[channel]}: {one.why}. {said}", "warning"))
    return blocks


def _cause_rows(cause: FlightCause) -> list[list[Cell]]:
    """What acts, what it may come from and how probable it is, once for each of its numbers."""
    causes = [_cause(key) for key in cause.law.causes if key != cause.law.key or len(cause.law.causes) > 1]
    what = f"{_law(cause.law)}: {listed(causes, 'or')}" if causes else _law(cause.law)
    numbers = [_number(one) for one in cause.parameters] or [("–", "–")]
    return [[what, _probability(cause.probability), *number] for number in numbers]


def _left_open(learned: FlightsLearned, decides: Sequence[str]) -> list[Block]:
    rows: list[list[Cell]] = []
    for channel, one in (*learned.channels.items(), ("altitude", None)):
        causes = learned.position if one is None else one.causes
        rows += [
            [channel, f"whether there is {_law(cause.law)}", f"fly {cause.law.needs}"]
            for cause in causes
            if cause.probability < NAMED_FROM
        ]
        if one is not None and one.verdict == "not identifiable" and not causes:
            rows.append([channel, "whether it lags", f"fly {one.lag.laws[0].needs}"])
        rows += [
            [channel, f"{_law(cause.law)}: {listed([_cause(key) for key in cause.law.causes], 'or')}", hint]
            for cause in causes
            if len(cause.law.causes) > 1 and (hint := TELLS_APART.get(cause.law.key))
        ]
    if not rows and not decides:
        return []
    blocks: list[Block] = [Text(one[:1].upper() + one[1:].rstrip(".") + ".") for one in decides]
    if rows:
        blocks.append(Table(("of", "what is open", "what would tell"), rows))
    return blocks


def _disagreeing(learned: FlightsLearned) -> list[Block]:
    rows: list[list[Cell]] = []
    for channel, one in learned.channels.items():
        lag = one.lag.laws[0].parameters[0].decoded(float(one.lag.theta[0]))
        for what, off in (
            ("as read", one.read),
            (f"best single lag, {plain(lag, 2)} s", one.single),
            ("the likeliest model", one.model),
        ):
            numbers = [plain(value, 2) for value in (off.rms, off.mean, off.spread)]
            rows.append([channel, what, *[f"{number} {UNITS[channel]}" for number in numbers], off.layers])
    columns = ("of", "passes compared", "rms", "mean", "spread", "layers")
    caption = (
        "The later pass less the earlier one, at layers of one altitude. Humidity is vapour over saturation at the "
        "flight's usual temperature of the altitude. The mean has its sign; the spread is the "
        "standard deviation about each flight's own mean. Each flight is corrected by a fit that leaves its readings "
        "of that quantity out."
    )
    blocks: list[Block] = [Table(columns, rows, caption)]
    alone = [name for name in learned.channels if _judges(learned, name) < 2]
    if alone:
        text = (
            f"One flight alone has {listed(alone)}. None is left to judge a correction by: the corrected rows show "
            "what is usual of sensors, not what was found."
        )
        blocks.append(Text(text, "warning"))
    for channel, one in learned.channels.items():
        shown = [flight for flight in learned.bins if flight.has(channel)][:MOST_DRAWN]
        if not shown:
            continue
        caption = (
            "Above: what each pass read, ascents full and descents dashed. Below: the later pass less the earlier one, "
            "as read (orange) and corrected by a fit without the flight (blue). Layers that the sensor met late stand "
            "out on both sides of zero; air that changed remains in both."
        )
        if len(shown) < _judges(learned, channel):
            caption = f"The first {len(shown)} of {_judges(learned, channel)} flights. {caption}"
        drawing = _draw(channel, one, shown)
        blocks.append(Figure(drawing, caption, f"Passes over altitude and their difference, {channel}"))
    return blocks


@styled
def _draw(channel: str, one: ChannelLearned, flights: Sequence[FlightBins]) -> Drawing:
    from matplotlib.figure import Figure as Canvas

    figure = Canvas(figsize=(max(2.4 * len(flights), 5.2), 6.2))
    grid = figure.subplots(2, len(flights), squeeze=False, sharex="row")
    for (above, below), flight in zip(grid.T, flights, strict=True):
        said: set[str] = set()
        for part in flight.passes:
            way, style = ("ascent", "-") if part.climb_m_s > 0 else ("descent", "--")
            label = None if way in said else f"as read, {way}"
            said.add(way)
            value, altitude = flight.values[channel][part.rows], flight.altitude_m[part.rows]
            above.plot(value, altitude, style, color=ORANGE, lw=0.9, label=label)
        below.axvline(0.0, color=GREY, lw=0.6)
        for off, colour, label in ((one.read, ORANGE, "as read"), (one.model, BLUE, "corrected")):
            below.plot(*_curve(off, flight.name), color=colour, lw=1.1, label=label)
        above.set_title(literal(flight.name), fontsize="small")
        above.set_xlabel(AXES[channel])
        below.set_xlabel(f"later − earlier, {UNITS[channel]}")
        below.set_ylim(above.get_ylim())
    for row in grid:
        row[0].set_ylabel("altitude, m")
        row[0].legend(loc="best")
    return figure


@styled
def plot_learned(learned: FlightsLearned) -> Drawing:
    """The later pass less the earlier one over altitude, as read and corrected, a panel for each channel."""
    figure = notebook_figure(4.2 * len(learned.channels), 4.0)
    panels = figure.subplots(1, len(learned.channels), squeeze=False)[0]
    for axes, (channel, one) in zip(panels, learned.channels.items(), strict=True):
        for off, colour, label in ((one.read, ORANGE, "as read"), (one.model, BLUE, "corrected")):
            for i, flight in enumerate(dict.fromkeys(off.flight)):
                axes.plot(*_curve(off, flight), color=colour, lw=0.9, label=None if i else label)
        axes.axvline(0.0, color=GREY, lw=0.6)
        axes.set_xlabel(f"{channel}: later − earlier pass, {UNITS[channel]}")
        axes.set_ylabel("altitude, m")
        axes.legend(loc="best")
    return figure


def _curve(off: Disagreement, name: str) -> tuple[Array, Array]:
    """A flight's differences and their altitudes, parted where the next pair of passes begins."""
    mine = np.array([flight == name for flight in off.flight], dtype=bool)
    value, altitude = off.off[mine], off.altitude_m[mine]
    begins = np.flatnonzero(np.diff(altitude) <= 0) + 1
    return np.insert(value, begins, np.nan), np.insert(altitude, begins, np.nan)


def _models(learned: FlightsLearned) -> Table:
    """Models with their weights: what each holds of the altitude and of each channel."""
    parts = [part for part in ("position", *learned.channels) if part in learned.channels or learned.position]
    rows: list[list[Cell]] = []
    for said, weight in learned.weights:
        if weight < LEAST_WEIGHT and rows:
            continue
        laws = [LAWS[key] for key in said.split(" + ") if key in LAWS]
        of = {part: [_law(law) for law in laws if (law.channel or "position") == part] for part in parts}
        rows.append([*[listed(of[part]) if of[part] else "–" for part in parts], f"{100 * weight:.1f} %"])
    columns = ["altitude" if part == "position" else part for part in parts]
    caption = (
        "Every model is fitted to all flights together. Its weight is the probability of each flight's readings given "
        f"the flights before it. Models below {100 * LEAST_WEIGHT:g} % are not shown."
    )
    return Table((*columns, "weight"), rows, caption)


def _flights(learned: FlightsLearned) -> list[Block]:
    rows: list[list[Cell]] = [
        [
            flight.name,
            len(flight.passes),
            _speeds(flight),
            f"{flight.minutes:.1f}",
            f"{plain(float(flight.altitude_m.min()), 3)} to {plain(float(flight.altitude_m.max()), 3)}",
            listed([name for name in learned.channels if flight.has(name)]),
        ]
        for flight in learned.bins
    ]
    columns = ("flight", "passes", "vertical speed, m/s", "minutes", "altitude, m", "read")
    blocks: list[Block] = [Table(columns, rows)]
    if learned.left_out:
        out: list[list[Cell]] = [[name, why] for name, why in learned.left_out.items()]
        blocks.append(Table(("left out", "why"), out))
    return blocks


def _speeds(flight: FlightBins) -> str:
    said = []
    for way, sign in (("up", 1.0), ("down", -1.0)):
        speeds = [sign * part.climb_m_s for part in flight.passes if sign * part.climb_m_s > 0]
        if speeds:
            ends = list(dict.fromkeys([f"{min(speeds):.1f}", f"{max(speeds):.1f}"]))
            said.append(f"{way} {' to '.join(ends)}")
    return "; ".join(said)


def _assumed() -> list[Block]:
    air = (
        "The air is a random function of altitude and time. Passes of one flight share a profile that nobody knows: a "
        "straight line and two random walks along the altitude, a rough one and a smooth one, whose steps are larger "
        "where the readings are steep. What "
        "changed meanwhile has a size that each flight shows for itself: all of the air, growing with the time between "
        f"passes; layers of {100 * LAYER_SHARE:g} % of the altitudes; and eddies of about {EDDY_M:g} m that last about "
        f"{EDDY_S:g} s. Layers also move up and down, usually by {MOVED_M:g} m and {MOVED_M_PER_H:g} m an hour. Where "
        "few metres are flown, eddies and moves are no larger than layers. Air that changed competes with every cause."
    )
    sensor = (
        "The sensor is the same in all flights, but for a small scatter from flight to flight. It has no offset "
        "between one pass and the next beyond those listed here. Horizontal differences of the air count as a "
        "change in time."
    )
    laws: list[list[Cell]] = [
        [law.channel or "altitude", _law(law), law.equation, law.needs, law.source] for law in LAWS.values()
    ]
    columns = ("of", "what may act", "equation", "what shows it", "source")
    return [Text(air), Text(sensor), Details("All that was tried, with equations and sources", [Table(columns, laws)])]
