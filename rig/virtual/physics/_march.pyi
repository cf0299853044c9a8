"""march.c: even steps of chains of cells, compiled. See `chains.Stepper.advance` for the arrays."""

import numpy as np
from numpy.typing import NDArray

def advance(steps: int, cells: int, runs: int, arrays: tuple[NDArray[np.float64], ...], /) -> None: ...
