"""How the formats show themselves in a notebook: a card of HTML, a table, labelled arrays, a figure.

Functions of plain data; the classes' `_repr_html_`, `to_frame`, `to_xarray` and `plot` are one call of them each.
pandas, xarray and matplotlib are imported when they are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

UNITS = {
    "temperature_c": "degC",
    "humidity_percent": "%",
    "airflow_m_s": "m s-1",
    "pressure_hpa": "hPa",
    "time_s": "s",
    "start_s": "s",
    "duration_s": "s",
    "diffusivity_m2_s": "m2 s-1",
}
CARD = "font-family: sans-serif; overflow-x: auto; border-left: 0.25em solid #0072B2; padding-left: 0.8em"


def require_xarray() -> ModuleType:
    """The package xarray. Raises ImportError with the remedy where it is not installed."""
    try:
        import xarray
    except ImportError:
        raise ImportError("xarray is not installed; pip install 'shockrig[notebook]'") from None
    return xarray


def card(title: str, facts: Sequence[tuple[str, str]], frame: pd.DataFrame | None = None, rows: int = 12) -> str:
    """A card of HTML: a title, facts as name and value, and the first `rows` rows of a table. All text is escaped."""
    lines = "".join(f"<li><b>{escape(name)}</b>: {escape(value)}</li>" for name, value in facts)
    table = ""
    if frame is not None:
        table = frame.head(rows).to_html(border=0, na_rep="", float_format=lambda value: f"{value:.4g}")
        if len(frame) > rows:
            table += f"<p>and {len(frame) - rows} more rows: to_frame()</p>"
    return f'<div style="{CARD}"><p><b>{escape(title)}</b></p><ul>{lines}</ul>{table}</div>'
