"""When the reading of RH jumps with the air's temperature: where the fit of a delay begins, and what it is nudged by.

A delay moves that jump, and no fit finds its way over a jump.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel

SPREAD_S = 0.06  # of the jumps' times from run to run, sampling and trigger together
NUDGES_S = tuple(0.002 * k for k in range(-15, 16) if k)  # the objective has steps where a sample crosses the jump
LEAST_CHANGE_K = 3.0  # of the air, for its jump to stand out in the RH read at its temperature
LEAST_JUMPS = 3


def when_it_jumps_s(channel: Channel, share_of_s: NDArray[np.float64] | None = None) -> float | None:
    """Median time of the steepest rise or fall near the transfer; None where no jump shows, or the runs disagree.

    With `share_of_s`, a time (R,) that each run's delay is proportional to, the share instead.
    """
    if not channel.jumps_with_air:
        return None
    of = np.ones(channel.runs) if share_of_s is None else share_of_s
    air, period = channel.conditions, channel.sampling_period_s
    steepest_s, among = [], []
    for run in np.flatnonzero((np.abs(air.thermal_step_k) > LEAST_CHANGE_K) & air.start_known):
        time, value = channel.samples[run]
        near = np.flatnonzero((time[1:] > -3 * period) & (time[:-1] < 2.0) & (np.diff(time) < 1.5 * period))
        if near.size > 3:
            steps = np.abs(np.diff(value))[near]
            steepest_s.append(0.5 * (time[near] + time[near + 1])[np.argmax(steps)])
            among.append(of[run])
    if len(steepest_s) < LEAST_JUMPS:
        return None
    late_s, per = np.array(steepest_s), np.maximum(among, 1e-9)
    middle = float(np.median(late_s / per))
    return middle if np.median(np.abs(late_s - middle * per)) < SPREAD_S else None
