"""Reports and figures: one self-contained HTML page from plain data, and the drawings that go into it."""

from analysis.report.html import (
    Details,
    Equation,
    Figure,
    KeyNumber,
    Report,
    Section,
    Table,
    Text,
    render,
)
from analysis.report.numbers import measured, plain
from analysis.report.style import save_figure, write_whole

__all__ = [
    "Details",
    "Equation",
    "Figure",
    "KeyNumber",
    "Report",
    "Section",
    "Table",
    "Text",
    "measured",
    "plain",
    "render",
    "save_figure",
    "write_whole",
]
