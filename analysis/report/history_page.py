"""Control charts of a sensor's figures over its campaigns, with the sentence that says what changed and since when."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.characterize.history import CHART_SIGMAS, FALSE_ALARMS, Chart, HistoryStep
from shockrig.analysis.report.html import Block, Cell, Figure, HtmlPage, Section, Table, Text
from shockrig.files.figures import BLUE, GREY, RED, literal, save_figure, styled
from shockrig.files.numbers import measured, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


def sentence(chart: Chart, change: HistoryStep) -> str:
    """What changed, by how much, and since when."""
    after, before = chart.observations[change.first], chart.observations[change.first - 1]
    by = measured(100.0 * change.relative, 100.0 * change.standard_uncertainty, "%")
    since, last = (one.campaign + (f" ({one.began_at[:10]})" if one.began_at else "") for one in (after, before))
    said = f"{chart.figure} of {chart.serial} has changed by {by} since {since}; {last} was the last before."
    if after.bench != before.bench and max(after.common, before.common) > 0.1 * after.random:
        said += " The bench is not the same there (or nobody recorded it): what the bench shares is counted in that."
    return said


def steady(chart: Chart) -> str:
    """What to say where nothing has changed."""
    n = len(chart.observations)
    if n < 2:
        return f"{chart.figure} of {chart.serial}: one campaign, nothing to compare it with."
    level = measured(float(chart.level[-1]), float(chart.high[-1] - chart.level[-1]) / CHART_SIGMAS, chart.unit)
    return f"{chart.figure} of {chart.serial}: {level} in {n} campaigns; nothing has changed beyond its uncertainty."


def sentences(charts: Sequence[Chart]) -> list[str]:
    """What is to be said of all charts."""
    return [text for one in charts for text in ([sentence(one, c) for c in one.changes] or [steady(one)])]


@styled
def draw(chart: Chart) -> Drawing:
    """One control chart: each campaign with two standard uncertainties, levels, and limits of three."""
    from matplotlib.figure import Figure

    first = chart.level[0]
    values = np.array([one.value for one in chart.observations])
    spread = np.array([one.random for one in chart.observations])
    place = np.arange(values.size)
    drawing = Figure(figsize=(7.4, 3.2))
    axes = drawing.subplots()

    def percent(x: np.ndarray) -> np.ndarray:
        return np.asarray(100.0 * (x / first - 1.0))

    edges = np.arange(values.size + 1) - 0.5
    axes.stairs(
        percent(chart.high),
        edges,
        baseline=percent(chart.low),
        fill=True,
        color=GREY,
        alpha=0.22,
        label=f"limits, {CHART_SIGMAS:g} u",
    )
    axes.stairs(percent(chart.level), edges, baseline=None, color=BLUE, label="level")
    outside = (values > chart.high) | (values < chart.low)
    for mask, colour, label in ((~outside, BLUE, "campaign, ± 2 u"), (outside, RED, "outside its limits")):
        if mask.any():
            axes.errorbar(
                place[mask],
                percent(values)[mask],
                yerr=200.0 * spread[mask] * values[mask] / first,
                fmt="o",
                color=colour,
                label=label,
            )
    for change in chart.changes:
        axes.axvline(change.first - 0.5, color=RED, linestyle="--", linewidth=1.0)
    names = [f"{literal(one.campaign)}\n{one.began_at[:10]}".strip() for one in chart.observations]
    axes.set_xticks(place, names, rotation=30 if values.size > 6 else 0, ha="right" if values.size > 6 else "center")
    axes.set_title(f"{literal(chart.figure)} of {literal(chart.serial)} against {plain(float(first))} {chart.unit}")
    axes.set_ylabel("difference, %")
    drawing.legend(loc="outside lower center", ncols=4)
    return drawing


def write_history(charts: Sequence[Chart], folder: Path, provenance: dict[str, Cell]) -> Path:
    """Write FOLDER/chart_N.png and FOLDER/history.html; returns the page's path."""
    changed = [chart for chart in charts if chart.changes]
    sections = []
    for number, one in enumerate(charts, 1):
        image = save_figure(draw(one), folder, f"chart_{number}")
        rows = [
            (
                o.campaign,
                o.began_at[:10] or "not known",
                measured(o.value, o.value * o.random, one.unit),
                plain(100.0 * o.common, 2),
                "outside" if not low <= o.value <= high else "within",
            )
            for o, low, high in zip(one.observations, one.low, one.high, strict=True)
        ]
        heads = ("campaign", "began", "value ± u, campaign to campaign", "shared by the bench, %", "limits")
        said = [sentence(one, c) for c in one.changes] or [steady(one)]
        blocks = [*(Text(text, "warning" if one.changes else "good") for text in said)]
        caption = f"{one.figure} of {one.serial} over its campaigns"
        drawn: list[Block] = [Figure(image, caption, caption), Table(heads, rows)]
        sections.append(Section(f"{one.figure}, {one.serial}", [*blocks, *drawn]))
    how = (
        f"A change is said where a step as large comes by accident in less than {100 * FALSE_ALARMS:g} of 100 "
        "histories that are looked at once, over all campaigns at which it might have come and all figures. What a "
        "bench shares by all of its campaigns (its references, its trigger) is not counted between them, and is "
        "between benches."
    )
    report = HtmlPage(
        title="History of a sensor",
        verdict=" ".join(sentences(changed or charts)[:3]),
        sections=[*sections, Section("How it is judged", [Text(how)])],
        provenance=provenance,
        tone="warning" if changed else "good",
    )
    return report.write(folder / "history.html")
