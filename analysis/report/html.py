"""One self-contained HTML file: verdict and numbers first, then sections of text, tables and figures.

Data in (frozen dataclasses), one render function out. Nothing is fetched and nothing can run: all text is escaped and
the page's own policy forbids scripts. Figures are embedded as images.
"""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from shockrig.files.disk import write_whole
from shockrig.files.figures import figure_bytes
from shockrig.files.numbers import plain

if TYPE_CHECKING:
    from matplotlib import figure as matplotlib_figure

Cell = str | float | int | None
SENTENCE = 24  # characters of a cell, from which on it is read and not looked up
Tone = Literal["good", "warning", "bad", "neutral"]


@dataclass(frozen=True)
class Text:
    """A paragraph (blank lines part paragraphs). `tone` other than neutral draws a bar beside it."""

    text: str
    tone: Tone = "neutral"


@dataclass(frozen=True)
class Equation:
    """A formula in plain text (Unicode), set apart."""

    text: str


@dataclass(frozen=True)
class Table:
    """Rows of cells under columns; numbers to four digits and to the right, text as it is, None as a dash."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""

    def __post_init__(self) -> None:
        for number, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise ValueError(f"row {number} has {len(row)} cells for {len(self.columns)} columns")


@dataclass(frozen=True)
class Figure:
    """A figure with caption and alternative text: a matplotlib figure, or the path of a PNG file."""

    figure: matplotlib_figure.Figure | Path
    caption: str
    alt: str


@dataclass(frozen=True)
class Details:
    """Blocks behind a line that opens them (printed in full)."""

    summary: str
    blocks: Sequence[Block]


Block = Text | Equation | Table | Figure | Details


@dataclass(frozen=True)
class KeyNumber:
    """A number that the reader came for: label, value with unit, a short note."""

    label: str
    value: str
    note: str = ""


@dataclass(frozen=True)
class Section:
    """A titled part of the page."""

    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class HtmlPage:
    """A whole page. `verdict` is the sentence a colleague would say; `provenance` ends the page as a small table.

    What the provenance says of the "data" (that they were not measured) stands under the title too. `paper` is what it
    is to be printed on ("A4"); empty: whatever the printer holds.
    """

    title: str
    verdict: str
    key_numbers: Sequence[KeyNumber] = ()
    sections: Sequence[Section] = ()
    provenance: Mapping[str, Cell] = field(default_factory=dict)
    tone: Tone = "neutral"
    paper: str = ""

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the page to `path`, whole or not at all, and return the path."""
        target = Path(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, render(self))
        return target


def render(report: HtmlPage) -> str:
    """The page as text."""
    numbers = "".join(
        f"<div><dt>{escape(n.label)}</dt><dd>{escape(n.value)}<small>{escape(n.note)}</small></dd></div>"
        for n in report.key_numbers
    )
    contents = "".join(f'<li><a href="#s{i}">{escape(s.title)}</a></li>' for i, s in enumerate(report.sections, 1))
    sections = "\n".join(
        f'<section id="s{i}"><h2>{escape(s.title)}</h2>\n{_blocks(s.blocks)}</section>'
        for i, s in enumerate(report.sections, 1)
    )
    provenance = "".join(
        f"<tr><th>{escape(name.replace('_', ' '))}</th><td>{escape(plain(value))}</td></tr>"
        for name, value in report.provenance.items()
    )
    data = report.provenance.get("data")
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(report.title)}</title>
<style>{CSS}{f"@page {{ size: {report.paper}; }}" if report.paper else ""}</style>
</head>
<body>
<main>
<h1>{escape(report.title)}</h1>
{f'<p class="warning"><strong>{escape(plain(data))}</strong></p>' if data else ""}
<p class="verdict {report.tone}">{escape(report.verdict)}</p>
{f'<dl class="key">{numbers}</dl>' if numbers else ""}
{f'<nav aria-label="Contents"><ul>{contents}</ul></nav>' if len(report.sections) > 2 else ""}
{sections}
{f'<footer><h2>Provenance</h2><table class="plain">{provenance}</table></footer>' if provenance else ""}
</main>
</body>
</html>
"""


def _blocks(blocks: Sequence[Block]) -> str:
    return "\n".join(_block(b) for b in blocks) + "\n"


def _block(block: Block) -> str:
    match block:
        case Text():
            paragraphs = [" ".join(p.split()) for p in block.text.split("\n\n")]
            return "".join(f'<p class="{block.tone}">{escape(p)}</p>' for p in paragraphs if p)
        case Equation():
            return f'<p class="equation">{escape(block.text)}</p>'
        case Table():
            return _table(block)
        case Figure():
            content = block.figure.read_bytes() if isinstance(block.figure, Path) else figure_bytes(block.figure)
            data = base64.b64encode(content).decode("ascii")
            image = f'<img src="data:image/png;base64,{data}" alt="{escape(block.alt)}">'
            return f'<figure><div class="scroll">{image}</div><figcaption>{escape(block.caption)}</figcaption></figure>'
        case Details():
            return f"<details><summary>{escape(block.summary)}</summary>\n{_blocks(block.blocks)}</details>"
    raise TypeError(f"a report is made of Text, Equation, Table, Figure and Details, not {type(block).__name__}")


def _table(table: Table) -> str:
    numeric = [
        bool(table.rows) and all(not isinstance(row[i], str) for row in table.rows) for i in range(len(table.columns))
    ]
    # A value with its uncertainty is one word: on a narrow screen the table scrolls.
    whole = [bool(table.rows) and all(" ± " in plain(row[i]) for row in table.rows) for i in range(len(table.columns))]
    # A column of sentences is left wide enough to be read.
    words = [any(len(plain(row[i])) > SENTENCE for row in table.rows) for i in range(len(table.columns))]
    side = [
        ' class="number"' if n else ' class="whole"' if one else ' class="words"' if w else ""
        for n, one, w in zip(numeric, whole, words, strict=True)
    ]
    head = "".join(f"<th{s}>{escape(c)}</th>" for c, s in zip(table.columns, side, strict=True))
    body = "\n".join(
        "<tr>" + "".join(f"<td{s}>{escape(plain(c))}</td>" for c, s in zip(row, side, strict=True)) + "</tr>"
        for row in table.rows
    )
    caption = f"<caption>{escape(table.caption)}</caption>" if table.caption else ""
    return f'<div class="scroll"><table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


CSS = """
:root { color-scheme: light dark; --ink: #1f2933; --quiet: #5f6b7a; --line: #d9dee4; --page: #ffffff; --card: #f5f7f9;
  --link: #0b63a5; --good: #00805c; --warning: #b36b00; --bad: #b3361b; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e8ec; --quiet: #9aa5b1; --line: #39424e; --page: #14181d;
  --card: #1d232a; --link: #7cc0f0; --good: #36c496; --warning: #f0b04a; --bad: #f0826a; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink); line-height: 1.5;
  font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
main { max-width: 70rem; margin: 0 auto; padding: 2rem 1.25rem 4rem; }
h1 { font-size: 1.05rem; font-weight: 600; color: var(--quiet); margin: 0 0 .75rem; }
h2 { font-size: 1.3rem; margin: 3rem 0 .75rem; padding-top: .75rem; border-top: 1px solid var(--line); }
p { max-width: 48rem; margin: .6rem 0; }
.verdict { font-size: 1.45rem; line-height: 1.35; font-weight: 600; max-width: 56rem; margin: 0 0 1.5rem;
  padding-left: 1rem; border-left: .3rem solid var(--quiet); overflow-wrap: anywhere; }
p.good, p.warning, p.bad { padding-left: 1rem; border-left: .3rem solid; }
.good { border-color: var(--good) !important; } .warning { border-color: var(--warning) !important; }
.bad { border-color: var(--bad) !important; }
.key { display: grid; grid-template-columns: repeat(auto-fit, minmax(13rem, 1fr)); gap: .75rem; margin: 0 0 1.5rem; }
.key div { background: var(--card); border-radius: .5rem; padding: .75rem 1rem; }
.key dt { font-size: .85rem; color: var(--quiet); }
.key dd { margin: .15rem 0 0; font-size: 1.2rem; font-weight: 600; font-variant-numeric: tabular-nums;
  overflow-wrap: anywhere; }
.key small:empty { display: none; }
.key small { display: block; font-size: .8rem; font-weight: 400; color: var(--quiet); }
nav ul { display: flex; flex-wrap: wrap; gap: .25rem 1.25rem; list-style: none; padding: 0; margin: 0;
  font-size: .9rem; }
a { color: var(--link); }
.equation { font: 1.05rem/1.6 Cambria, "STIX Two Math", Georgia, serif; padding: .6rem 1rem; background: var(--card);
  border-radius: .5rem; white-space: pre-wrap; }
.scroll { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; min-width: 50%; }
caption { text-align: left; color: var(--quiet); padding-bottom: .4rem; position: sticky; left: 0;
  max-width: min(48rem, calc(100vw - 5rem)); }
th, td { text-align: left; vertical-align: top; padding: .3rem .9rem .3rem 0; border-bottom: 1px solid var(--line);
  overflow-wrap: break-word; }
footer td { overflow-wrap: anywhere; }
thead th { font-weight: 600; border-bottom: 2px solid var(--line); vertical-align: bottom; }
.number { text-align: right; white-space: nowrap; }
th.number { white-space: normal; }
td.whole { white-space: nowrap; } td.words { min-width: 12rem; }
figure { margin: 1.5rem 0; }
figure .scroll { margin: 0; }
figure img { display: block; max-width: max(100%, 48rem); height: auto; background: #fff; border-radius: .4rem;
  padding: .25rem; }
figcaption { font-size: .85rem; color: var(--quiet); max-width: 48rem; margin-top: .4rem; }
details { margin: 1rem 0; border: 1px solid var(--line); border-radius: .5rem; padding: .5rem 1rem; }
summary { cursor: pointer; font-weight: 600; }
footer { font-size: .85rem; } footer table { font-size: .85rem; } footer th { font-weight: 400; color: var(--quiet); }
@media print {
  :root { --ink: #000; --quiet: #444; --line: #bbb; --page: #fff; --card: #f3f3f3; }
  @page { margin: 16mm 14mm; }
  body { font-size: 10pt; } main { max-width: none; padding: 0; } nav { display: none; }
  h2 { break-after: avoid; margin-top: 1.5rem; } figure, tr, .key div, .verdict { break-inside: avoid; }
  .scroll { overflow: visible; } figure img { max-width: 100%; }
  thead { display: table-header-group; } a { color: inherit; text-decoration: none; }
  details { border: 0; padding: 0; } details::details-content { content-visibility: visible; block-size: auto; }
}
"""
