"""sums.c: sums of exponentials, compiled. See `exponentials.compiled` for the arrays."""

import numpy as np
from numpy.typing import NDArray

def add_up(
    count: int,
    modes: int,
    places: NDArray[np.int64],
    times: NDArray[np.float64],
    rates: NDArray[np.float64],
    amplitudes: NDArray[np.float64],
    died_out: float,
    out: NDArray[np.float64],
    /,
) -> None: ...
