"""Changes between steps: what was seen of a sensor that makes no step, and may still not lie in the run of one.

A door that is opened and shut again comes back to where it was, and what a map does not list is none of its steps; but
the readings behind it are no longer the answer to the step before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from shockrig.rig.logs.changes import BLOCKS_BESIDE, ChangePoint, LogPiece
from shockrig.rig.logs.onset import StepOnset, fit_onset
from shockrig.rig.logs.steps import UNDER_WAY, Cluster, StepInLog

FEWEST_MEAN = 3  # readings whose mean is held for where a channel was, as of a way that is behind for good

Stretch = tuple[float, float]


def quiet_around(
    steps: Sequence[StepInLog], channels: Sequence[LogPiece], groups: Sequence[Sequence[Cluster]]
) -> list[dict[str, Stretch]]:
    """Of each step of one piece of a log: sensor -> from when to when it shows no change but steps, of those that are
    large beside this one. `groups` are the piece's `groups_of`."""
    others = loose(steps, groups)
    places = {channel.name: place for place, channel in enumerate(channels)}
    begun_s: dict[tuple[int, ChangePoint], float] = {}
    found = []
    for step in steps:
        quiet: dict[str, Stretch] = {}
        for move in step.moves:
            place = places[move.channel]
            since_s, until_s = quiet.get(name := move.channel.rsplit(".", 1)[0], (-np.inf, np.inf))
            for change in _large(channels[place], changes_of(others, place), move):
                # Half of the way to it is the step's, whoever cannot tell when it began.
                half_s = 0.5 * (step.at_s + change.time_s)
                if change.time_s > step.at_s:
                    if (place, change) not in begun_s:
                        begun_s[place, change] = _begun_s(channels[place], change, changes_of(groups, place))
                    until_s = min(until_s, max(begun_s[place, change], half_s))
                else:
                    since_s = max(since_s, min(change.time_s + change.width_s, half_s))
            quiet[name] = since_s, until_s
        found.append(quiet)
    return found


def loose(steps: Sequence[StepInLog], groups: Sequence[Sequence[Cluster]]) -> list[Sequence[Cluster]]:
    """Groups of changes that are none of the steps: each step's is the nearest of those whose windows it lies in."""
    taken = set()
    for step in steps:
        near = [k for k, group in enumerate(groups) if _may_be(group, step)]
        taken |= {min(near, key=lambda k: abs(groups[k][0].time_s - step.at_s))} if near else set()
    return [group for k, group in enumerate(groups) if k not in taken]


def _may_be(group: Sequence[Cluster], step: StepInLog) -> bool:
    begin_s = group[0].time_s - 2.0 * group[0].width_s  # as far back as a start is looked for
    end_s = max(change.time_s + change.width_s for one in group for those in one.changes.values() for change in those)
    return begin_s <= step.at_s + 2.0 * step.uncertainty_s and step.at_s - 2.0 * step.uncertainty_s <= end_s


def changes_of(groups: Sequence[Sequence[Cluster]], place: int) -> list[ChangePoint]:
    """The changes of one channel in groups, in order of time."""
    mine = (change for group in groups for cluster in group for change in cluster.changes.get(place, ()))
    return sorted(mine, key=lambda change: change.time_s)


def _large(channel: LogPiece, changes: Sequence[ChangePoint], move: StepOnset) -> Iterator[ChangePoint]:
    """Changes by which a channel went off, in the time that it took for 63 % of its step, by more of that step than may
    be under way before one. The narrowest window tells nothing quicker than itself."""
    took_s = max(move.t63_s, BLOCKS_BESIDE * channel.period_s)
    for change in changes:
        went = _went_off(channel, change, took_s) * min(1.0, took_s / change.width_s)
        if went > UNDER_WAY * abs(move.size):
            yield change


def _went_off(channel: LogPiece, change: ChangePoint, took_s: float) -> float:
    """How far readings after a change lie outside the cone that those before it leave open, from "stay" to "go on"."""
    time_s, value = channel.time_s, channel.value
    begun_s, ends_s = change.time_s - change.width_s, change.time_s + change.width_s + took_s
    before = (time_s >= begun_s - max(change.width_s, took_s)) & (time_s <= begun_s)
    after = (time_s > begun_s) & (time_s <= ends_s)
    if before.sum() < FEWEST_MEAN or after.sum() < FEWEST_MEAN:
        return 0.0
    slope, stay = np.polyfit(time_s[before] - begun_s, value[before], 1)
    go_on = stay + slope * (time_s[after] - begun_s)
    off = value[after] - np.clip(value[after], np.minimum(stay, go_on), np.maximum(stay, go_on))
    return float(np.abs(np.convolve(off, np.full(FEWEST_MEAN, 1.0 / FEWEST_MEAN), "valid")).max())


def _begun_s(channel: LogPiece, change: ChangePoint, every: Sequence[ChangePoint]) -> float:
    """When a change had surely not begun: no earlier than its window tells, which a sharp one needs not all of."""
    others = [one.time_s for one in every if one.time_s != change.time_s]
    since_s = max((s for s in others if s < change.time_s), default=float(channel.time_s[0]))
    next_s = min((s for s in others if s > change.time_s), default=float(channel.time_s[-1]))
    onset = fit_onset(channel, change, since_s, next_s)
    unsure_s = max(2.0 * onset.uncertainty_s, 2.0 * channel.period_s)
    return max(onset.at_s - unsure_s, change.time_s - change.width_s)
