"""cells.c: numbers out of the plain lines of a table."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

def read(
    data: bytes,
    start: int,
    longest: int,
    width: int,
    places: NDArray[np.int64],
    out: NDArray[np.float64],
    strange: NDArray[Any],
    /,
) -> tuple[int, int, int]: ...
