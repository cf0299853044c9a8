"""When the reading of RH jumps with the air's temperature: where a delay's fit begins, and what it is nudged by.

A delay moves that jump, and no fit finds its way over a jump.
"""

from __future__ import annotations

import numpy as np

from shockrig.analysis.inference.channel import Channel

SPREAD_S = 0.06  # of the jumps' times from run to run, sampling and trigger together
NUDGES_S = tuple(0.002 * k for k in range(-15, 16) if k)  # the objective has steps where a sample crosses the jump
LEAST_CHANGE_K = 3.0  # of the air, for its jump to stand out in the RH read at its temperature
LEAST_JUMPS = 3


def when_it_jumps_s(channel: Channel) -> float | None:
    """Median time of the steepest rise or fall near the transfer; None where no jump shows, or the runs disagree."""
    if not channel.jumps_with_air:
        return None
    air, period = channel.conditions, channel.sampling_period_s
    steepest_s = []
    for run in np.flatnonzero((np.abs(air.destination_c - air.source_c) > LEAST_CHANGE_K) & air.start_known):
        time, value = channel.samples[run]
        near = np.flatnonzero((time[1:] > -3 * period) & (time[:-1] < 2.0) & (np.diff(time) < 1.5 * period))
        if near.size > 3:
            steps = np.abs(np.diff(value))[near]
            steepest_s.append(0.5 * (time[near] + time[near + 1])[np.argmax(steps)])
    if len(steepest_s) < LEAST_JUMPS:
        return None
    middle = float(np.median(steepest_s))
    return middle if np.median(np.abs(np.array(steepest_s) - middle)) < SPREAD_S else None
