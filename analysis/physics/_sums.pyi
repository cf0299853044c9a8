"""sums.c: sums of exponentials and driven modes, compiled. See the functions `compiled` for the arrays."""

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
def drive(
    modes: int,
    amplitudes: NDArray[np.float64],
    rates: NDArray[np.float64],
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    starts: NDArray[np.float64],
    wanted: NDArray[np.float64],
    order: NDArray[np.int64],
    gone: float,
    even: float,
    jump: float,
    out: NDArray[np.float64],
    /,
) -> None: ...
