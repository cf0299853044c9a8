"""march.c: even steps of chains of cells, compiled. See `chains.Stepper.march` for the arrays."""

import numpy as np
from numpy.typing import NDArray

def march(steps: int, cells: int, runs: int, arrays: tuple[NDArray[np.float64], ...], /) -> None: ...
