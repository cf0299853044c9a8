"""What each run shows by itself, before any model: how long its reading took for most of its way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.driven_air import follow
from shockrig.analysis.estimate.without_model import since_seen, white_noise

Array = NDArray[np.float64]

FEW_RUNS = 6
SHARES_OF_STEP = (0.632, 0.90)
STEP_IN_NOISE = 20.0  # a smaller step has no times worth saying
LAG_TO_90 = float(np.log(10.0))  # time constants of a first-order lag
MOST_BETWEEN = 0.3  # of the way between two readings: from here on a line between them is invented


@dataclass(frozen=True)
class RunSeen:
    """One run: readings at rest before and at the end, and seconds to 63 % and 90 % of the way since the change is
    seen to begin.

    Where two readings hold most of the way between them, the times are those of the later, and `at_most` is true;
    where nobody recorded the start either, it may have been as early as the first of the two.
    `behind_s` is the first-order lag behind a measured air that leaves least; the times are then not given.
    """

    run: str
    begin: float
    end: float
    times_s: tuple[float, float] | None
    behind_s: float | None
    at_most: bool = False


def little_known(channel: Channel) -> bool:
    """Whether a campaign is one of a few runs, or of runs whose start, airs or airflow nobody recorded."""
    c = channel.conditions
    known = c.start_known.all() and c.airs_known.all() and c.airflow_known.all()
    return channel.runs <= FEW_RUNS or not bool(known)


def seen(channel: Channel) -> tuple[RunSeen, ...]:
    """What each run shows by itself; runs without a step worth the name are left out.

    So are those of which the sensor has to follow less than what is left at 63 %: a humidity that is another because
    the temperature is makes that way at once, with the air or with the die, and tells nothing of the film.
    """
    found = []
    conditions = channel.conditions
    whole = channel.quantity.air_step(conditions)
    followed = channel.quantity.step(conditions) * np.sign(whole) >= (1.0 - SHARES_OF_STEP[0]) * np.abs(whole)
    of_all = zip(channel.run_ids, channel.samples, channel.air, conditions.start_known, followed, strict=True)
    for run, (time, value), air, triggered, its_own in of_all:
        tail = max(value.size // 20, 3)
        before = value[time < 0] if (time < 0).sum() >= 3 else value[:3]
        begin, end = float(np.median(before)), float(np.median(value[-tail:]))
        noise = white_noise(value)
        small = abs(end - begin) < max(STEP_IN_NOISE * noise, channel.quantity.least_step)
        if small or (air is None and not its_own):
            continue
        if air is None:
            times_s, at_most = crossings(since_seen(time), (value - begin) / (end - begin), bool(triggered))
            found.append(RunSeen(run, begin, end, times_s, None, at_most))
        else:
            (alone,) = follow([(time, value, air.time_s, channel.trace_of(air))], channel.quantity.resolution)
            found.append(RunSeen(run, begin, end, None, alone.time_constant_s))
    return tuple(found)


def by_themselves(channel: Channel) -> dict[str, tuple[float, float, float]]:
    """Times to 63 and 90 % [s] that runs show by no model, or of the lag by which they follow a measured air, and the
    standard uncertainty of their logarithms, by run; without those that show none, or none of what came before it.

    Of a run whose change lies between two readings, and whose start nobody saw, a time is anything up to these: its
    logarithm is that of the bound less 1, give or take 1. Where the start is known, several such runs tell more.
    """
    whole = dict(zip(channel.run_ids, (channel.begun_s == 0.0) | (channel.runs == 1), strict=True))
    started = dict(zip(channel.run_ids, channel.conditions.start_known, strict=True))
    shown: dict[str, tuple[float, float, float]] = {}
    for one in seen(channel):
        t63_s, t90_s = one.times_s or (one.behind_s or 0.0, LAG_TO_90 * (one.behind_s or 0.0))
        if not t63_s or not whole[one.run]:
            continue
        if not one.at_most:
            shown[one.run] = t63_s, t90_s, 0.0
        elif not started[one.run]:
            shown[one.run] = t63_s * float(np.exp(-1.0)), t90_s * float(np.exp(-1.0)), 1.0
    return shown


def crossings(time: Array, share: Array, triggered: bool = True) -> tuple[tuple[float, float], bool]:
    """Times at which a share of the way is passed [s]: straight between the two readings around it, or that of the
    later where the first of them lies too far back. Fewest readings are then on the wrong side of it, so that a burst
    of noise is no crossing; where as few are between two such times, it is midway.
    """
    times, later, earlier, apart = [], [], [], []
    for wanted in SHARES_OF_STEP:
        misplaced = np.concatenate([[0], np.cumsum(np.where(share >= wanted, 1, -1))])
        fewest = np.flatnonzero(misplaced == misplaced.min())
        around = np.clip(fewest[[0, -1]], 1, share.size - 1)
        before = around - 1
        part = np.clip((wanted - share[before]) / (share[around] - share[before]), 0.0, 1.0)
        times.append(float((time[before] + part * (time[around] - time[before])).mean()))
        later.append(float(time[around[-1]]))
        earlier.append(0.0 if triggered else min(float(time[before[0]]), 0.0))
        apart.append(float((share[around] - share[before]).max()))
    at_most = max(apart) > MOST_BETWEEN
    if at_most:
        return (later[0] - min(earlier), later[1] - min(earlier)), True
    return (times[0], times[1]), False
