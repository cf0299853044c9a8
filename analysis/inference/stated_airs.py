"""How good the airs of a campaign really are that somebody wrote down: what readings at rest say of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEWEST_RUNS = 4
APART_K = 5.0  # of the sources: from here on a gain of the sensor's calibration can be told from a scatter
WORSE_FACTOR = (
    5.0  # times what is promised; effects that differ from run to run (warming by airflow or light) reach 3.3
)


def scatter_of_stated(at_rest: Array, stated: Array, promised: float) -> float:
    """Standard uncertainty of stated source airs (R,), from the readings (R,) of a sensor that rested in them.

    A sensor's own offset and gain are taken out; what then scatters from run to run by much more than was promised is
    the airs. Returns `promised` where the readings do not contradict it, or are too few to.
    """
    if stated.size < FEWEST_RUNS:
        return promised
    design = np.ones((stated.size, 1))
    if np.ptp(stated) > APART_K:
        design = np.column_stack([design, stated - stated.mean()])
    off = at_rest - stated
    left = off - design @ np.linalg.lstsq(design, off, rcond=None)[0]
    found = float(np.sqrt((left**2).sum() / (stated.size - design.shape[1])))
    return found if found > WORSE_FACTOR * promised else promised
