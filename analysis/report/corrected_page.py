"""The page of `shockrig correct`: profiles as read and corrected, time series, spectra, flags, what was assumed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.comparisons import ways_apart
from shockrig.analysis.flight.doubts import in_air
from shockrig.analysis.flight.flight_channel import bridged
from shockrig.analysis.flight.judging import gathered, power_spectrum
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.report.html import Block, Cell, Figure, HtmlPage, KeyNumber, Section, Table, Text
from shockrig.files.figures import BLUE, GREY, ORANGE, styled
from shockrig.files.flight import FLAGS, Corrected, Flight
from shockrig.files.flight_figure import changes_of, channels_of, plot_flight
from shockrig.files.headline import headlines
from shockrig.files.numbers import counted, plain
from shockrig.files.profile import Profile
from shockrig.files.readings_figure import has_altitude

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

Array = NDArray[np.float64]
MOST_ROWS = 60_000  # that are kept for the figures; of a longer flight every second, fourth, ... row
SPECTRUM_ROWS = 20_000  # of which a spectrum is made, one after the other
LEAST_SPECTRUM_ROWS = 256
LONGEST_GAP = 10.0  # typical steps between rows, that a spectrum is drawn across
SEGMENT_S, SEGMENT_ROWS = 120.0, 64  # of a spectrum: in a log with few rows to the minute as long as so many take

MEANING = {
    "gap": "the reading is missing: an estimate up to 5 s from the nearest sample, else none",
    "repeated": "equal to the reading before, or stuck: an estimate",
    "implausible": "impossible, or alone against its neighbours: an estimate; none where the time is wrong",
    "outside_profile": "the air lies beyond what the profile knows: the reading",
    "not_corrected": "every value of the row is the reading itself",
    "temperature_not_corrected": "the temperature is the reading, the humidity is corrected",
    "humidity_not_corrected": "the humidity is the reading, the temperature is corrected",
}


class FlightGathered:
    """Gathers a flight block by block for its page, thinned where it is long, so that memory does not grow with it."""

    def __init__(self) -> None:
        self.rows = 0
        self.flags = dict.fromkeys(FLAGS, 0)
        self._stride = 1
        self._blocks: list[tuple[Flight, Corrected]] = []
        self._first: list[tuple[Flight, Corrected]] = []

    def add(self, flight: Flight, found: Corrected) -> None:
        """Add a block."""
        if self.rows < SPECTRUM_ROWS:
            self._first.append((flight, found))
        for name, mask in found.flags.items():
            self.flags[name] += int(np.count_nonzero(mask))
        offset = -self.rows % self._stride
        self.rows += flight.time_s.size
        self._blocks.append(_cut(flight, found, slice(offset, None, self._stride)))
        while sum(one.time_s.size for one, _ in self._blocks) > MOST_ROWS:
            self._stride *= 2
            self._blocks = [_cut(one, its, slice(None, None, 2)) for one, its in self._blocks]

    def whole(self) -> tuple[Flight, Corrected]:
        """All rows that were kept."""
        return _joined(self._blocks)

    def beginning(self) -> tuple[Flight, Corrected]:
        """The first rows, one after the other."""
        return _joined(self._first)

    @property
    def thinned(self) -> bool:
        """Whether the figures have fewer rows than the flight."""
        return self._stride > 1


def _cut(flight: Flight, found: Corrected, part: slice) -> tuple[Flight, Corrected]:
    kept: dict[str, Any] = {}
    for one in fields(Corrected):
        value = getattr(found, one.name)
        if isinstance(value, np.ndarray):
            kept[one.name] = value[part]
    kept["flags"] = {name: mask[part] for name, mask in found.flags.items()}
    kept["common"] = {}
    return flight.at(part), replace(found, **kept)


def _joined(blocks: list[tuple[Flight, Corrected]]) -> tuple[Flight, Corrected]:
    flights, found = zip(*blocks, strict=True)
    together: dict[str, Any] = {}
    for one in fields(Flight):
        values = [getattr(flight, one.name) for flight in flights]
        together[one.name] = None if any(value is None for value in values) else np.concatenate(values)
    arrays = {
        one.name: np.concatenate([getattr(its, one.name) for its in found])
        for one in fields(Corrected)
        if isinstance(getattr(found[0], one.name), np.ndarray)
    }
    flags = {name: np.concatenate([its.flags[name] for its in found]) for name in FLAGS}
    return Flight(**together), replace(found[0], flags=flags, common={}, **arrays)


def write_corrected_page(
    path: Path,
    name: str,
    flight: FlightGathered,
    profile: Profile,
    notes: tuple[str, ...],
    provenance: Mapping[str, Cell],
) -> Path:
    """Write the page of a corrected flight; `name` is the log's, `notes` are what the correction had to say."""
    rows, found = flight.whole()
    report = HtmlPage(
        title=f"Flight {name}, corrected",
        verdict=_verdict(rows, found, flight.rows),
        key_numbers=_key_numbers(rows, found, flight),
        sections=[*_drawn_sections(flight), _flags(flight), _assumed(profile, notes)],
        provenance=provenance,
        tone="good" if flight.flags["not_corrected"] < flight.rows else "warning",
    )
    return report.write(path)


def _drawn_sections(flight: FlightGathered) -> list[Section]:
    """Profiles where the log has an altitude, time series, spectra where there are some."""
    rows, found = flight.whole()
    sections = []
    if has_altitude(rows.altitude_m):
        blocks: list[Block] = [
            Figure(
                plot_flight(rows, found, "altitude"),
                "As read and corrected over altitude, with the 95 % band. Ascent full, descent dashed: sensors that "
                "lag read the same layer at two heights, and a correction that is right brings the two together.",
                "Profiles as read and corrected",
            )
        ]
        if compared := _ways(rows, found):
            columns = ("channel", "as read, rms", "corrected, rms", "layers", "m")
            blocks.append(Table(columns, compared, "Ascent against descent: how far the means of layers are apart."))
        sections.append(Section("Profiles", blocks))
    thin = " Drawn are some of its rows, evenly." if flight.thinned else ""
    sections.append(
        Section(
            "Over time",
            [
                Figure(
                    plot_flight(rows, found),
                    f"As read and corrected; below each, the 95 % band on a scale of its own.{thin}",
                    "Time series as read and corrected",
                )
            ],
        )
    )
    if (drawing := _spectra(flight)) is not None:
        caption = (
            "Power spectra: a sensor that lags loses what is fast; the correction gives it back as far as the noise "
            "lets it be seen. Turbulence falls with the power −5/3."
        )
        sections.append(Section("Spectra", [Figure(drawing, caption, "Power spectra as read and corrected")]))
    return sections


def _flags(flight: FlightGathered) -> Section:
    flagged: list[list[Cell]] = [[flag, count, f"{100 * count / max(flight.rows, 1):.2g} %", MEANING[flag]]
               for flag, count in flight.flags.items() if count]  # fmt: skip
    table = Table(("flag", "rows", "share", "what it means, and the value that is given"), flagged)
    return Section("Flags", [table if flagged else Text("None: every row is corrected.")])


def _assumed(profile: Profile, notes: tuple[str, ...]) -> Section:
    """What the profile states, and what the correction had to say."""
    known: list[list[Cell]] = [[what, value] for what, value in headlines(profile)]
    known += [
        [f"effects, {channel}", ", ".join(effect.effect.replace("_", " ") for effect in part.effects)]
        for channel, part in (("temperature", profile.temperature), ("humidity", profile.humidity))
        if part is not None and part.effects
    ]
    said: list[Block] = [Table(("of the sensors", "as the profile states it"), known)]
    said += [Text(note[:1].upper() + note[1:].rstrip(".") + ".") for note in notes]
    return Section("What was assumed and found", said)


def _verdict(rows: Flight, found: Corrected, count: int) -> str:
    changes = changes_of(rows, found)
    if not changes:
        return f"Nothing was corrected: the {counted(count, 'row')} are given as they came. What was found says why."
    said = [
        f"{one.name} by up to {plain(one.most, 2)} {one.unit} "
        f"(known to {plain(one.standard_uncertainty, 2)} {one.unit} after it)"
        for one in changes
    ]
    return f"The lag of the sensors is taken out of {counted(count, 'row')}: {' and '.join(said)}."


def _key_numbers(rows: Flight, found: Corrected, flight: FlightGathered) -> list[KeyNumber]:
    numbers = [
        KeyNumber(
            f"{one.name} changed by",
            f"{plain(one.rms, 2)} {one.unit} rms",
            f"standard uncertainty {plain(one.standard_uncertainty, 2)} {one.unit}",
        )
        for one in changes_of(rows, found)
    ]
    flagged = flight.flags["not_corrected"]
    numbers.append(KeyNumber("rows", str(flight.rows), f"{flagged} not corrected" if flagged else "all corrected"))
    return numbers


def _ways(rows: Flight, found: Corrected) -> list[list[Cell]]:
    """RMS difference of ascent and descent in the layers that both passed, as read and corrected."""
    table, flown = list[list[Cell]](), in_air(rows)
    air_c = bridged(rows.time_s, np.where(np.isfinite(found.temperature_c), found.temperature_c, rows.temperature_c))
    for one in channels_of(rows, found):
        of_air = None if one.name == "temperature" else air_c
        if (both := ways_apart(flown, (one.reading, one.value), of_air)) is not None:
            apart = [f"{plain(size, 2)} {one.unit}" for size in both.rms]
            table.append([one.name, *apart, both.layers, f"{both.low_m:.0f} to {both.high_m:.0f}"])
    return table


def _spectra(flight: FlightGathered) -> Drawing | None:
    """Spectra of the channels whose first rows are long enough; None where none is."""
    rows, found = flight.beginning()
    period_s = typical_period(rows.time_s)
    shown = []
    for one in channels_of(rows, found):
        known = np.isfinite(one.reading) & np.isfinite(one.value) & np.isfinite(rows.time_s)
        if np.count_nonzero(known) >= LEAST_SPECTRUM_ROWS and np.isfinite(period_s) and period_s > 0:
            shown.append((one, known))
    return _draw_spectra(shown, rows.time_s, period_s) if shown else None


@styled
def _draw_spectra(shown: list[Any], time_s: Array, period_s: float) -> Drawing:
    from matplotlib.figure import Figure as Canvas

    figure = Canvas(figsize=(4.6 * max(len(shown), 1.4), 3.4))
    for axes, (one, known) in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
        order = np.argsort(time_s[known], kind="stable")
        # a gap, or where a clock was set, would be longer than all readings
        steps_s = np.minimum(np.diff(time_s[known][order], prepend=0.0), LONGEST_GAP * period_s)
        moments_s = np.cumsum(steps_s)
        even_s = np.arange(moments_s[0], moments_s[-1], period_s)
        for values, colour, words in ((one.reading, ORANGE, "as read"), (one.value, BLUE, "corrected")):
            even = np.interp(even_s, moments_s, values[known][order])
            frequency, power = gathered(*power_spectrum(even, period_s, max(SEGMENT_S, SEGMENT_ROWS * period_s)))
            if np.any(power > 0.0):  # of readings that change
                axes.loglog(frequency, power, color=colour, lw=1.0, label=words)
        at = len(frequency) // 3
        if power[at] > 0.0:
            fallen = power[at] * (frequency / frequency[at]) ** (-5 / 3)
            axes.loglog(frequency, fallen, color=GREY, ls="--", label="−5/3")
        axes.set_xlabel("frequency, Hz")
        axes.set_ylabel(f"{one.name} power, {'K' if one.unit == 'K' else '%RH'}²/Hz")
    figure.axes[0].legend(loc="lower left")
    return figure
