"""kernel.c: the smoother's recursions, compiled. See `smoother.compiled` for the order of the arrays."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

def smooth(
    sizes: Sequence[int],
    passing: tuple[float, float],
    eddies: NDArray[np.float64],
    arrays: tuple[NDArray[np.float64], ...],
    /,
) -> None: ...
def follow(values: NDArray[np.float64], decay: float, start: float, out: NDArray[np.float64], /) -> None: ...
