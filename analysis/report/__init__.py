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
from shockrig.files.disk import write_whole
from shockrig.files.figures import save_figure
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
