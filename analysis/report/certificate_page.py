"""The printed certificate (one A4 page or more) and its figure: what each uncertainty is made of. And control charts of
a sensor's figures over its campaigns, with the sentence that says what changed and since when.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.characterize.budget import COMMON_LINES
from shockrig.analysis.characterize.history import CHART_SIGMAS, FALSE_ALARMS, Chart, HistoryStep
from shockrig.analysis.report.html import Block, Cell, Figure, HtmlPage, KeyNumber, Section, Table, Text
from shockrig.files.certificate import NOT_ACCREDITED, Certificate, CertifiedFigure
from shockrig.files.figures import BLUE, CYCLE, GREY, RED, literal, save_figure, styled
from shockrig.files.numbers import between, measured, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

LEAST_SHOWN = 0.02  # share of the variance from which on a line has a colour of its own
PERCENT = "95.45 %"
USUAL_C = 20.0
NOT_RECORDED = "not recorded"
LEAST_PRINTED = 0.001  # share of the variance from which on a line is printed; the tables have all


@styled
def shares_figure(certificate: Certificate) -> Drawing:
    """Bars of 100 %, one for each figure: the shares of its variance, the same colour for the same component."""
    from matplotlib.figure import Figure

    figures = [one for one in certificate.figures if one.figure != "t90"]  # whose shares are nearly those of t63
    total: dict[str, float] = {}
    for one in figures:
        for line in one.lines:
            if line.share >= LEAST_SHOWN:
                total[line.component] = total.get(line.component, 0.0) + line.share
    components = sorted(total, key=lambda name: -total[name])
    colours = {name: CYCLE[i % len(CYCLE)] for i, name in enumerate(components)}
    hatches = {name: ("", "///", "...")[i // len(CYCLE) % 3] for i, name in enumerate(components)}
    drawing = Figure(figsize=(7.4, 1.3 + 0.27 * len(figures) + 0.16 * len(components)))
    axes = drawing.subplots()
    for row, one in enumerate(figures):
        left = 0.0
        known = {line.component: 100.0 * line.share for line in one.lines if line.share >= LEAST_SHOWN}
        for name in components:
            if name in known:
                axes.barh(row, known[name], left=left, color=colours[name], hatch=hatches[name], edgecolor="white")
                left += known[name]
        axes.barh(row, max(100.0 - left, 0.0), left=left, color=GREY, edgecolor="white")
    for name in components:
        axes.barh(0, 0, color=colours[name], hatch=hatches[name], edgecolor="white", label=literal(name))
    axes.barh(0, 0, color=GREY, label=f"what is below {100 * LEAST_SHOWN:.0f} %")
    relative = [f"{literal(one.name)}   {100 * one.standard_uncertainty / one.value:.2g} %" for one in figures]
    axes.set(yticks=range(len(figures)), yticklabels=relative, xlim=(0, 100), xlabel="share of the variance, %")
    axes.set_ylim(-0.6, len(figures) - 0.4)
    axes.set_title("What dominates: figure with its relative standard uncertainty")
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    drawing.legend(loc="outside lower left", ncols=2)
    return drawing


def stated(figure: CertifiedFigure) -> str:
    """Value ± expanded uncertainty with the unit; with the ends of its interval where that is not symmetric."""
    if figure.coverage_interval is not None:
        return between(figure.value, *figure.coverage_interval, figure.unit)
    return measured(figure.value, figure.expanded_uncertainty, figure.unit)


def write_certificate_page(certificate: Certificate, folder: Path) -> Path:
    """Write FOLDER/budget.png and FOLDER/certificate.html; returns the page's path."""
    image = save_figure(shares_figure(certificate), folder, "budget")
    wanted = [one for one in certificate.figures if one.figure in ("alpha", "t63")]
    numbers = [KeyNumber(one.name, stated(one), f"{PERCENT}, k = {plain(one.coverage_factor, 3)}") for one in wanted]
    data = certificate.provenance.get("data")
    sections = [
        Section("Figures", [_results(certificate), Text(_conditions(certificate))]),
        Section(
            "What the uncertainties are made of", [Figure(image, "Shares of each variance.", "Shares of variances")]
        ),
        Section("Errors that all runs share", _common(certificate)),
        Section("What this certificate is, and what it is not", _statements(certificate)),
        Section("Budgets", [Text("Lines from 0.1 % on; budget.csv has all."), *map(_budget, certificate.figures)]),
    ]
    report = HtmlPage(
        title=f"Response of a thermo-hygrometer: certificate {certificate.identifier}",
        verdict=_verdict(certificate),
        key_numbers=numbers[:6],
        sections=sections,
        provenance={
            **({"data": data} if data else {}),
            **_sensors(certificate),
            "recorded": f"{certificate.began_on} to {certificate.ended_on}" if certificate.began_on else NOT_RECORDED,
            "issued": certificate.issued_on,
            "laboratory": certificate.laboratory,
            "responsible": certificate.person,
            "customer": certificate.customer,
            **{key: str(value) for key, value in certificate.provenance.items() if key != "data"},
        },
        paper="A4",
    )
    return report.write(folder / "certificate.html")


def _sensors(certificate: Certificate) -> dict[str, str]:
    kinds, serials = certificate.kinds, certificate.serials
    names = dict.fromkeys((*kinds, *serials))
    return {name: f"{kinds.get(name, '–')}, serial number {serials.get(name, 'not stated')}" for name in names}


def _verdict(certificate: Certificate) -> str:
    # the figure that says most of each sensor, nearest to usual air: its rate, of one lag its time constant
    order = ("t63", "D", "alpha")
    telling = [one for one in certificate.figures if one.figure in order]
    telling.sort(key=lambda one: (order.index(one.figure), -abs(one.temperature_c - USUAL_C)))
    first = {one.channel: one for one in telling}
    said = "; ".join(f"{one.name} = {stated(one)}" for _, one in sorted(first.items(), reverse=True))
    wrong = ""
    if certificate.undescribed:
        wrong = (
            f" The model does not describe the readings of the {' and the '.join(certificate.undescribed)}: "
            "effective numbers of this campaign, and no property of the material."
        )
    return f"{said} ({PERCENT} of the distribution lie within).{wrong} Not accredited."


def _results(certificate: Certificate) -> Table:
    figures = certificate.figures
    columns: dict[str, list[Cell]] = {
        "figure": [one.name.replace(" ", "\u00a0") for one in figures],
        "value ± U": [stated(one).replace(" ", "\u00a0") for one in figures],
        "U, %": [plain(100.0 * one.expanded_uncertainty / one.value, 2) for one in figures],
        "k": [f"{one.coverage_factor:.2f}" for one in figures],
        "ν": ["∞" if (nu := one.degrees_of_freedom) is None else f"{nu:.0f}" for one in figures],
        "airflow, m/s": [NOT_RECORDED if one.airflow_m_s is None else f"{one.airflow_m_s:g}" for one in figures],
        "air, °C": [one.air_c for one in figures],
        "pressure, hPa": [f"{one.pressure_hpa:g}" for one in figures],
    }
    caption = f"U = k u: expanded uncertainty that holds {PERCENT}; ν: effective degrees of freedom."
    if any(one.coverage_interval is not None for one in figures):
        caption += (
            " Where two ends are given the figure is no straight function of what is uncertain: the distributions of "
            f"the inputs are propagated (JCGM 101); the ends hold {PERCENT}, as much beyond one as beyond the other, "
            "and U is half of what lies between them."
        )
    for name in ("airflow, m/s", "pressure, hPa"):
        if len(set(columns[name])) == 1:
            quantity, unit = name.split(", ")
            value = columns.pop(name)[0]
            caption += f" {quantity.capitalize()}: {value}{'' if value == NOT_RECORDED else f' {unit}'}."
    return Table(tuple(columns), list(zip(*columns.values(), strict=True)), caption)


def _conditions(certificate: Certificate) -> str:
    bead = any(one.channel == "temperature" for one in certificate.figures)
    said = "t63 and t90 are the times to 1 − 1/e and 90 % of a step of the air."
    return said + (" The thermometer's is a step of 10 K about the temperature named." if bead else "")


def _common(certificate: Certificate) -> list[Text | Table]:
    said = {True: "an ordinary laboratory's: nobody stated it", False: "stated in campaign.json"}
    rows = [
        (COMMON_LINES[key][0], value, COMMON_LINES[key][1], said[key in certificate.common.by_default])
        for key, value in certificate.common.document().items()
    ]
    text = (
        "What is off by the same amount in all runs is seen in no scatter. It is fitted along where the readings can "
        "tell, and counted in every uncertainty. The trigger counts with 4 ms at least."
    )
    return [Text(text), Table(("input", "standard uncertainty", "unit", "from"), rows)]


def _statements(certificate: Certificate) -> list[Text]:
    return [
        Text(NOT_ACCREDITED, "warning"),
        Text(certificate.traceability, "neutral" if certificate.traced else "warning"),
        *(Text(note) for note in certificate.notes),
    ]


def _budget(figure: CertifiedFigure) -> Table:
    rows = [
        (
            line.component,
            line.kind,
            line.distribution,
            f"{plain(line.standard_uncertainty, 3)} {line.unit}".removesuffix(" 1"),
            plain(line.sensitivity, 3),
            plain(100.0 * line.share, 3),
            "∞" if line.degrees_of_freedom is None else plain(line.degrees_of_freedom, 3),
        )
        for line in figure.lines
        if line.share >= LEAST_PRINTED
    ]
    value = (
        f"{figure.name} = {measured(figure.value, figure.standard_uncertainty, figure.unit)} (one standard uncertainty)"
    )
    heads = ("component", "type", "distribution", "u", f"sensitivity, {figure.unit} for one", "share, %", "ν")
    return Table(heads, rows, value)


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
    level = measured(float(chart.level[-1]), float(chart.standard_uncertainty[-1]), chart.unit)
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
