"""The page of a campaign that chose its own runs: goals against bench minutes, evidence against runs, what came of what
was expected; then every decision.

Drawn from the campaign's log of decisions alone (files/plan_file.py).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.analysis.design.evidence import REJECTED_FROM
from shockrig.analysis.report.html import Details, Figure, HtmlPage, KeyNumber, Section, Table, Text, Tone
from shockrig.analysis.report.panels import panels
from shockrig.files.figures import BLUE, CYCLE, GREY, INK, save_figure, styled
from shockrig.files.numbers import counted, plain
from shockrig.files.plan_file import where_it_stands

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

Entry = Mapping[str, Any]
TONES: dict[str, Tone] = {"done": "good", "inconclusive": "warning", "continue": "neutral"}
MOST_LINEAR = 50.0  # of an axis
GOALS_ACROSS, RIVALS_ACROSS = 4, 2  # names in a row of a legend


def loop_report(name: str, entries: Sequence[Entry], data: str = "") -> HtmlPage:
    """The page of a log of decisions, oldest first; `data` says where they were not measured."""
    last = entries[-1]
    stands = {goal["goal"]: where_it_stands(goal) for goal in last["goals"]}
    wanted = [met for met, _ in stands.values() if met != "budget"]
    numbers = (
        KeyNumber("goals met", f"{wanted.count('met')} of {len(wanted)}"),
        KeyNumber("bench time", f"{plain(last['minutes_spent'], 3)} min", counted(len(last["recorded"]), "run")),
        KeyNumber("decisions", str(len(entries))),
    )
    blocks = [Figure(drawing, caption, alt) for drawing, caption, alt in drawings(entries).values()]
    goals = Table(("goal", "now", ""), [(goal, now, met) for goal, (met, now) in stands.items()])
    verdicts = Table(
        ("channel", "verdict", "named", "tied"),
        [
            (
                n,
                v["verdict"] if v["runs"] else "not judged yet",
                ", ".join(v["causes"]).replace("_", " "),
                " or ".join(_standing(v)),
            )
            for n, v in last["verdicts"].items()
        ],
    )
    return HtmlPage(
        title=f"Decisions of {name}",
        verdict=f"{last['status']}: {last['reason']}",
        tone=TONES.get(last["status"], "neutral"),
        key_numbers=numbers,
        sections=(
            Section("Where it stands", (goals, verdicts)),
            Section("How it came there", blocks),
            Section("Every decision", [_decision(entry) for entry in entries]),
        ),
        provenance={"goals": str(last.get("until", "")), **({"data": data} if data else {})},
    )


def chosen_section(entries: Sequence[Entry], folder: Path) -> list[Section]:
    """A section for the report of a campaign that chose its own runs, its plots written to `folder`; none without."""
    if not entries:
        return []
    last = entries[-1]
    waited_s = sum(float(entry.get("waited_s") or 0.0) for entry in entries)
    waited = f" The bench waited {plain(waited_s, 2)} s for them." if waited_s else ""
    text = Text(
        f"{counted(len(entries), 'decision')} over {plain(last['minutes_spent'], 3)} min of bench time, wanted: "
        f"{last['until']}. The last one: {last['status']}, {last['reason']}.{waited}"
    )
    figures = [
        Figure(save_figure(drawing, folder, f"loop_{name}"), caption, alt)
        for name, (drawing, caption, alt) in drawings(entries).items()
    ]
    return [Section("How its runs were chosen", [text, *figures])]


def drawings(entries: Sequence[Entry]) -> dict[str, tuple[MatplotlibFigure, str, str]]:
    """What a log of decisions has to show, by name: figure, caption, alternative text."""
    drawn = {}
    if any(target["runs"] for e in entries for target in e["targets"]):
        drawn["precision"] = precision_figure(entries), PRECISION, "uncertainty of each goal against bench minutes"
    if any(v.get("dispute") or v["settled"] for e in entries for v in e["verdicts"].values()):
        drawn["evidence"] = (evidence_figure(entries), EVIDENCE, "evidence against each rival against runs")
    if any(e.get("realised") for e in entries):
        drawn["realised"] = (realised_figure(entries), REALISED, "what came against what was expected")
    return drawn


PRECISION = (
    "Relative standard uncertainty of each quantity against bench time, and the goal (dashed). Where it rises, runs "
    "were found to differ by more than before; where something is named (dotted) the model has it from then on, and is "
    "no longer uncertain by what it lacked."
)
EVIDENCE = (
    "Evidence against each explanation of a dispute, from runs recorded after it began: ln of an e-value. Above ln 100 "
    "(dashed) an explanation is out, whenever one looks."
)
REALISED = (
    "Minutes, information on what the goals want (in nats) and evidence (ln E) that the runs of each decision were "
    "expected to take or to bring, and what their records took or brought. Evidence scatters about what is expected of "
    "it by about its root."
)


def _standing(verdict: Mapping[str, Any]) -> list[str]:
    dispute = verdict.get("dispute")
    if dispute is None:
        return []
    left = [label for label, x in zip(dispute["labels"], dispute["against"], strict=True) if x < REJECTED_FROM]
    return left if len(left) > 1 else []


@styled
def precision_figure(entries: Sequence[Entry]) -> MatplotlibFigure:
    """Uncertainty of each goal's quantity, in percent, against bench minutes."""
    from matplotlib.ticker import LogLocator, NullLocator

    curves: dict[str, list[tuple[float, float, float]]] = {}
    for entry in entries:
        for target in entry["targets"]:
            if target["runs"]:
                point = (entry["minutes_spent"], 100 * target["relative"], 100 * target["wanted"])
                curves.setdefault(target["label"], []).append(point)
    figure, ax = _below_its_legend(len(curves), GOALS_ACROSS)
    for at, words in _named(entries):
        ax.axvline(at, color=GREY, linewidth=0.7, linestyle=":")
        ax.annotate(words, (at, 1.0), xycoords=("data", "axes fraction"), xytext=(3, -3), textcoords="offset points",
                    rotation=90, va="top", fontsize="small", color=INK)  # fmt: skip
    for (label, points), colour in zip(curves.items(), CYCLE * 4, strict=False):
        minutes, now, wanted = np.array(points).T
        ax.plot(minutes, now, color=colour, marker="o", markersize=2.5, linewidth=1.1, label=label)
        ax.axhline(wanted[-1], color=colour, linewidth=0.7, linestyle="--")
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_xlabel("bench time, min")
    ax.set_ylabel("standard uncertainty, %")
    _above(ax, GOALS_ACROSS)
    return figure


def _named(entries: Sequence[Entry]) -> list[tuple[float, str]]:
    """When what is named in a channel became another: bench minutes, and the names."""
    then: dict[str, list[str]] = {}
    found = []
    for entry in entries:
        for place, verdict in entry["verdicts"].items():
            now = sorted(verdict["causes"])
            if now != then.get(place, []):
                found.append((entry["minutes_spent"], f"{place}: {', '.join(now).replace('_', ' ') or 'nothing'}"))
            then[place] = now
    return found


@styled
def evidence_figure(entries: Sequence[Entry]) -> MatplotlibFigure:
    """ln E against each explanation of each dispute, against the number of runs."""
    curves: dict[str, list[tuple[int, float]]] = {}
    for entry in entries:
        for channel, verdict in entry["verdicts"].items():
            under_way = [verdict["dispute"]] if verdict.get("dispute") else []
            for dispute in (*verdict["settled"], *under_way):
                for label, x in zip(dispute["labels"], dispute["against"], strict=True):
                    key = f"{channel}: {label} (since run {dispute['runs'][-1]})"
                    own = curves.setdefault(key, [])
                    if not own or dispute in under_way or own[-1][1] != x:
                        own.append((len(entry["recorded"]), x))
    figure, ax = _below_its_legend(len(curves), RIVALS_ACROSS)
    for (label, points), colour in zip(curves.items(), CYCLE * 8, strict=False):
        runs, against = np.array(points).T
        ax.plot(runs, against, color=colour, marker="o", markersize=3, linewidth=1.1, label=label)
    ax.axhline(REJECTED_FROM, color=INK, linewidth=0.7, linestyle="--")
    ax.annotate("ruled out above", (0.0, REJECTED_FROM), xycoords=("axes fraction", "data"), xytext=(4, 3),
                textcoords="offset points", fontsize="small", color=INK)  # fmt: skip
    ax.set_ylim(bottom=min(-1.0, ax.get_ylim()[0]), top=max(10.0, ax.get_ylim()[1]))
    if np.ptp(ax.get_ylim()) > MOST_LINEAR:
        ax.set_yscale("symlog", linthresh=10.0)
        ax.yaxis.set_major_formatter("{x:g}")
    ax.xaxis.get_major_locator().set_params(integer=True)
    ax.set_xlabel("runs")
    ax.set_ylabel("ln E against it")
    _above(ax, RIVALS_ACROSS)
    return figure


@styled
def realised_figure(entries: Sequence[Entry]) -> MatplotlibFigure:
    """Expected against realised: minutes, information, evidence."""
    found = [entry["realised"] for entry in entries if entry.get("realised")]
    every = (("minutes", "minutes"), ("information", "nats"), ("evidence", "ln E"))
    # Without goals of precision, or without a tie, there is nothing to be expected.
    shown = [(key, words) for key, words in every if any(one[f"expected_{key}"] or one[key] for one in found)]
    figure, axes = panels((1, len(shown)), (3.2 * len(shown), 3.2), across_in=0.9)
    for ax, (key, words) in zip(np.ravel(axes), shown, strict=True):
        both = [one for one in found if one[f"expected_{key}"] is not None and one[key] is not None]
        expected = np.array([one[f"expected_{key}"] for one in both])
        came = np.array([one[key] for one in both])
        most = max(float(np.abs(np.concatenate([expected, came])).max(initial=0.0)), 1e-3)
        ax.plot([0, most], [0, most], color=GREY, linewidth=0.8)
        ax.plot(expected, came, color=BLUE, marker="o", markersize=3, linestyle="none")
        if most > MOST_LINEAR:
            ax.set_xscale("symlog")
            ax.set_yscale("symlog")
        ax.set_xlabel(f"expected, {words}")
        ax.set_ylabel(f"came, {words}")
    return figure


def _below_its_legend(curves: int, across: int) -> tuple[MatplotlibFigure, Any]:
    """A figure and its axes, with room above for so many curves' names, so many in a row."""
    above_in = 0.15 + 0.2 * -(-curves // across)
    figure, axes = panels((1, 1), (7.4, 3.2 + above_in), top_in=above_in)
    return figure, np.ravel(axes)[0]


def _above(ax: Any, across: int) -> None:
    """The legend above the axes, so many names in a row."""
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=across, fontsize="small")


def _number(value: float | None) -> str:
    return "what nobody could say" if value is None else plain(value, 2)


def _decision(entry: Entry) -> Details:
    rows = [
        (
            run["why"],
            f"{plain(run['source']['temperature_c'], 3)} °C {plain(run['source']['humidity_percent'], 3)} %",
            f"{plain(run['destination']['temperature_c'], 3)} °C {plain(run['destination']['humidity_percent'], 3)} %",
            run["airflow_m_s"],
            run["dwell_s"],
            run["expected_minutes"],
            run.get("expected_progress"),
            run["expected_information"],
            run["expected_evidence"],
        )
        for run in (entry["considered"] or entry["runs"])
    ]
    columns = ("run", "source", "destination", "m/s", "for, s", "minutes", "of a goal", "nats", "ln E")
    blocks: list[Any] = [Text(f"{entry['status']}: {entry['reason']}")]
    if entry["runs"]:
        blocks.append(Text(f"Chosen: {', '.join(run['why'] for run in entry['runs'])}."))
    if rows:
        blocks.append(Table(columns, rows, "The best of the menu, with what was expected of each"))
    if entry["vetoed"]:
        blocks.append(Text(f"Vetoed: {', '.join(run['why'] for run in entry['vetoed'])}."))
    if came := entry.get("realised"):
        blocks.append(
            Text(
                f"Since the decision before: {plain(came['minutes'], 2)} min for {plain(came['expected_minutes'], 2)} "
                f"expected, {_number(came['information'])} nats for {_number(came['expected_information'])}, "
                f"ln E {plain(came['evidence'], 2)} for {_number(came['expected_evidence'])}."
            )
        )
    after = f"{counted(len(entry['recorded']), 'run')}, {plain(entry['minutes_spent'], 3)} min"
    times = Counter(run["why"] for run in entry["runs"])
    then = ", ".join(why if count == 1 else f"{count} x {why}" for why, count in times.items()) or entry["status"]
    return Details(f"{entry['number']}: after {after}: {then}", blocks)
