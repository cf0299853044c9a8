"""Reports and figures: one self-contained HTML page from plain data, and the drawings that go into it."""

from shockrig.analysis.report.html import (
    Details,
    Equation,
    Figure,
    HtmlPage,
    KeyNumber,
    Section,
    Table,
    Text,
    render,
)
from shockrig.analysis.report.style import save_figure, write_whole
from shockrig.files.numbers import measured, plain

__all__ = [
    "Details",
    "Equation",
    "Figure",
    "KeyNumber",
    "HtmlPage",
    "Section",
    "Table",
    "Text",
    "measured",
    "plain",
    "render",
    "save_figure",
    "write_whole",
]
