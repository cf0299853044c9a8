"""The page of a flight played through emulated sensors: what each stage lost, what was found on links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.checks.link import LinkFinding
from shockrig.analysis.report.html import Cell, Figure, HtmlPage, KeyNumber, Section, Table, Text
from shockrig.files.figures import BLUE, GREEN, INK, ORANGE, styled
from shockrig.files.numbers import counted, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

Array = NDArray[np.float64]
Courses = tuple[Array, Array]
SETTLED_S = 15.0  # after the start, before which a filter knows little
AS_READ, ON_BOARD, IN_C, AFTER = "as read", "on board", "generated C", "after landing"


@dataclass(frozen=True)
class LossStage:
    """What one stage lost, or a whole chain is off by: rms of temperature [K] and humidity [%RH]; the shares of both
    that intervals of 95 % cover, None where there are none."""

    name: str
    temperature_k: float
    humidity_percent: float
    words: str
    covered: tuple[float, float] | None = None


@dataclass(frozen=True)
class HilResult:
    """A flight that came round: stages, totals, what was found on links and of sensors; temperature and humidity of the
    air, as read, on board, and after landing."""

    folder: Path
    stages: tuple[LossStage, ...]
    totals: tuple[LossStage, ...]
    findings: tuple[LinkFinding, ...]
    sensors: tuple[str, ...]
    time_s: Array
    air: Courses
    read: Courses
    onboard: Courses
    after: Courses

    def total(self, name: str) -> LossStage:
        """One of the totals."""
        return next(one for one in self.totals if one.name == name)


def hil_report(result: HilResult, flight: str, provenance: Mapping[str, Cell]) -> HtmlPage:
    """The page of one flight."""
    read, onboard, after = (result.total(name) for name in (AS_READ, ON_BOARD, AFTER))
    faults = sorted({one.fault for one in result.findings})
    found = f"{counted(len(faults), 'fault')} of the link found" if faults else "no fault of the link found"
    numbers = [
        KeyNumber(total.name, f"{plain(total.temperature_k, 2)} K, {plain(total.humidity_percent, 2)} %RH", "rms error")
        for total in (read, onboard, after)
    ]
    findings: list[Text | Table] = [Text("Told from the logs alone, without what was played.")]
    if result.findings:
        findings.append(
            Table(
                ("link", "from, s", "to, s", "what"),
                [
                    (one.link, round(one.from_s), round(one.to_s), str(one).partition(": ")[2])
                    for one in result.findings
                ],
            )
        )
    else:
        findings.append(Text("Links: nothing was lost, late, or in another unit."))
    findings += [Text(words, "warning") for words in result.sensors]
    return HtmlPage(
        title=f"{flight}: played, flown, and held against the truth",
        verdict=f"On board the error is {plain(onboard.temperature_k, 2)} K and {plain(onboard.humidity_percent, 2)} "
        f"%RH where the readings are off by {plain(read.temperature_k, 2)} K and {plain(read.humidity_percent, 2)} "
        f"%RH; {found}.",
        tone="warning" if result.findings or result.sensors else "good",
        key_numbers=numbers,
        sections=(
            Section("What each stage lost", (Text(STAGES), _table(result.stages))),
            Section("What is left in the end", (Text(TOTALS), _table(result.totals), _figure(result))),
            Section("Faults that were found", findings),
        ),
        provenance=provenance,
    )


STAGES = (
    f"Root of the mean square of what a stage changes, over the rows after the first {SETTLED_S:.0f} s, in which "
    "filters know little. The sensor's own part is what a correction is there for; the others are what the chain adds."
)
TOTALS = (
    "Against the air that was played, over the same rows. Covered: the share of rows whose interval of 95 % holds the "
    "air."
)


def _table(stages: tuple[LossStage, ...]) -> Table:
    def covered(stage: LossStage, place: int) -> Cell:
        return None if stage.covered is None else f"{100 * stage.covered[place]:.0f} %"

    if not any(stage.covered for stage in stages):
        return Table(
            ("stage", "temperature, K", "humidity, %RH", ""),
            [(one.name, _two(one.temperature_k), _two(one.humidity_percent), one.words) for one in stages],
        )
    return Table(
        ("", "temperature, K", "covered", "humidity, %RH", "covered", ""),
        [
            (one.name, _two(one.temperature_k), covered(one, 0), _two(one.humidity_percent), covered(one, 1), one.words)
            for one in stages
        ],
    )


def _two(value: float) -> Cell:
    return None if value != value else plain(value, 2)


def _figure(result: HilResult) -> Figure:
    return Figure(
        course_figure(result),
        "Above: the air (black), as read (orange), corrected on board (blue) and after landing (green). Below: what "
        "each is off by.",
        "temperature and humidity against time, and their errors",
    )


@styled
def course_figure(result: HilResult) -> MatplotlibFigure:
    """Courses and their errors against time."""
    from matplotlib.figure import Figure as MatplotlibFigure

    figure = MatplotlibFigure(figsize=(9.2, 5.4))
    axes = figure.subplots(2, 2, sharex=True, height_ratios=(2, 1))
    drawn = ((result.read, ORANGE, AS_READ), (result.onboard, BLUE, ON_BOARD), (result.after, GREEN, AFTER))
    for place, (label, unit) in enumerate((("Temperature, °C", "K"), ("Relative humidity, %", "%RH"))):
        above, below = axes[:, place]
        air = result.air[place]
        for courses, colour, name in drawn:
            above.plot(result.time_s, courses[place], color=colour, lw=0.9, label=name)
            below.plot(result.time_s, courses[place] - air, color=colour, lw=0.7)
        above.plot(result.time_s, air, color=INK, lw=0.8, label="air (played)")
        errors = np.abs(np.concatenate([courses[place] - air for courses, _, _ in drawn[:2]]))
        known = errors[np.isfinite(errors)]
        if known.size:
            reach = 1.1 * float(np.quantile(known, 0.995))
            below.set_ylim(-reach, reach)
        above.set_ylabel(label)
        below.set_ylabel(f"error, {unit}")
        below.set_xlabel("time, s")
    axes[0, 0].legend(loc="best")
    return figure
