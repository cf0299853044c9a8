"""How figures look: one style for all, on matplotlib.figure.Figure and never pyplot, so that drawing leaves no state.

Colours: Okabe and Ito's set, told apart by the colour-blind and in grey. matplotlib is imported to draw.
"""

from __future__ import annotations

import contextlib
import functools
import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

from shockrig.files.disk import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")

INK, GREY, LIGHT = "#1f2933", "#7b8794", "#d9dee4"
BLUE, ORANGE, GREEN, PURPLE, RED, SKY, YELLOW = (
    "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#F0E442"
)  # fmt: skip
CYCLE = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY)

RC: Any = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
    "grid.color": LIGHT,
    "grid.linewidth": 0.5,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.0,
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "savefig.facecolor": "white",
}


@contextlib.contextmanager
def house_style() -> Iterator[None]:
    """This house's style whatever the caller's matplotlib settings are, and those again afterwards."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(RC)
        yield


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Decorator of a drawing function: draw in the house's style."""

    @functools.wraps(draw)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with house_style():
            return draw(*args, **kwargs)

    return wrapped


def notebook_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure that a notebook shows by itself where it is a cell's result, whatever its backend."""
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def _repr_png_(self) -> bytes:
            return figure_bytes(self)

    return NotebookFigure(figsize=(width_in, height_in))


def literal(text: str) -> str:
    """Text from a file as matplotlib shall show it: a dollar sign is no formula, and line breaks are blanks."""
    return " ".join(str(text).split()).replace("\\", "\\\\").replace("$", r"\$")


def figure_bytes(figure: Figure, dpi: int = 130) -> bytes:
    """The figure as PNG; the same bytes for the same data."""
    import numpy as np
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    buffer = io.BytesIO()
    before, shown = figure.dpi, figure.canvas
    with house_style():
        # Drawn once: Figure.savefig draws everything twice where there is a layout.
        figure.dpi = dpi
        canvas: Any = FigureCanvasAgg(figure)  # whose methods have no annotations
        canvas.draw()
        figure.dpi = before
        figure.set_canvas(shown)
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    image.save(buffer, format="png", dpi=(dpi, dpi), compress_level=3)
    return buffer.getvalue()


def save_figure(figure: Figure, directory: str | os.PathLike[str], name: str) -> Path:
    """Write DIRECTORY/NAME.png (whole or not at all) and return its path."""
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    write_whole(path, figure_bytes(figure))
    return path
