"""How reports' figures leave: as PNG files or bytes, the same bytes for the same data. Their look is files.figures'."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from shockrig.files.disk import write_whole
from shockrig.files.figures import (
    BLUE,
    CYCLE,
    GREEN,
    GREY,
    INK,
    LIGHT,
    ORANGE,
    PURPLE,
    RC,
    RED,
    SKY,
    YELLOW,
    figure_bytes,
    house_style,
    literal,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "BLUE",
    "CYCLE",
    "GREEN",
    "GREY",
    "INK",
    "LIGHT",
    "ORANGE",
    "PURPLE",
    "RC",
    "RED",
    "SKY",
    "YELLOW",
    "figure_bytes",
    "house_style",
    "literal",
    "save_figure",
    "styled",
    "write_whole",
]


def save_figure(figure: Figure, directory: str | os.PathLike[str], name: str) -> Path:
    """Write DIRECTORY/NAME.png (whole or not at all) and return its path."""
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    write_whole(path, figure_bytes(figure))
    return path
