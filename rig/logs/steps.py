"""Steps of a log: the changes of all its channels put together, each timed, and judged whether it makes a run.

Changes of different channels are one step where the windows that show them overlap: a slow or boxed sensor shows it
late. Changes that follow one another within few readings, with long quiet before and after, are one step in stages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.files.numbers import short
from shockrig.files.sentinels import LEAST_COURSE
from shockrig.rig.logs.changes import CHANGE_SIGMAS, ChangePoint, LogPiece, find_changes
from shockrig.rig.logs.onset import HIDDEN_SHARE, SETTLED_T63, StepOnset, fit_onset, reached, row_between
from shockrig.rig.logs.stages import count_stages, first_stage
from shockrig.rig.logs.turns import on_its_way, own_temperature, turn_s

Array = NDArray[np.float64]

FEW_READINGS = 8  # between two changes cannot be a run
STAGE_READINGS = 50  # between two stages of one step at most ...
STAGE_QUIET = 20.0  # ... and so many times the longest of these pauses is quiet before and after
RESTED_SHARE = 0.1  # of the way: readings within that have settled, to what two times to 63 % and a half leave
UNDER_WAY = 0.25  # of a step's size may have passed in one t63 before it: weather and waves are as fast as that always
AT_ONCE, AT_ONCE_READINGS = 0.25, 25  # of a t63, and readings, within which a turn is seen
RETURNED_SHARE = 0.25  # of the readings after it may lie nearer to the level before: a wave comes back
STAYS_T63, STAYS_READINGS = 10.0, 20  # after it has settled, in which that is judged: what drifts back is slower
RAMP_SHARE = 0.5  # of the stretch to the next step, taken by 63 % of the way: it did not slow down
RAMP_BEGINS, RAMP_ENDS = 0.3, 0.95  # of the way: what is as fast from 63 % to its end as it was before ...
STILL_AS_FAST = 0.75  # ... by so much, is no sensor's: one lag is 0.3 times as fast then, two that are equal 0.4
MANY_STAGES = 3  # that one transfer does not make
READINGS_BEFORE, READINGS_AFTER = LEAST_COURSE, 10  # that a run needs


@dataclass(frozen=True)
class StepInLog:
    """A step of a log: when it was first seen (s on the log's clock, one standard uncertainty) and what moved.

    `why_not` says why it makes no run of its own; empty where it does. `stages` is the number of stages it came in,
    `lasted_s` how long these took. `beside` are the sensors that moved because their reference did, and show no change
    of their own. `next_s` is when the next change of whatever kind was seen, of each sensor that moved and has one.
    """

    piece: int
    at_s: float
    uncertainty_s: float
    moves: tuple[StepOnset, ...]
    stages: int = 1
    lasted_s: float = 0.0
    why_not: str = ""
    beside: tuple[str, ...] = ()
    next_s: Mapping[str, float] = field(default_factory=dict)
    is_ramp: bool = False

    @property
    def is_slow_air(self) -> bool:
        """Whether the air itself is seen to have taken its time: no harm where it was measured."""
        return self.stages > 1 or self.is_ramp


@dataclass
class Cluster:
    """Changes of several channels that may be one; `time_s` and `width_s` are those of the sharpest."""

    time_s: float
    width_s: float
    changes: dict[int, list[ChangePoint]] = field(default_factory=dict)  # channel's place -> its changes


def sensor_of(channel: str) -> str:
    """The sensor whose channel has a name, SENSOR.KEY."""
    return channel.rsplit(".", 1)[0]


def groups_of(channels: Sequence[LogPiece], merge_s: float | None = None) -> list[list[Cluster]]:
    """The changes of one piece of a log in groups that are a step each, or none; in order of time.

    Changes closer than `merge_s` are one group. Found out from the pauses where it is not given.
    """
    clusters = _cluster(channels, [find_changes(channel) for channel in channels])
    return _with_turns(channels, _merged(channels, clusters, merge_s))


def find_steps(
    channels: Sequence[LogPiece], piece: int, groups: Sequence[Sequence[Cluster]] | None = None
) -> tuple[StepInLog, ...]:
    """Steps of one piece of a log, in order of time.

    Parameters
    ----------
    channels : sequence of Channel
    piece : int
        The piece's number, which the steps carry.
    groups : sequence, optional
        The piece's `groups_of`, where they are known.
    """
    groups = groups_of(channels) if groups is None else groups
    steps = []
    for k, group in enumerate(groups):
        # What one sensor did ends no other's way: probes may have been moved one after the other.
        since_s, until_s = _changed_s(channels, groups[:k], max), _changed_s(channels, groups[k + 1 :], min)
        steps += [replace(step, next_s=until_s) for step in _steps(channels, group, piece, since_s, until_s)]
    steps.sort(key=lambda step: step.at_s)  # stages are timed by their first, which others may have followed
    return tuple(_judged(step, steps, k, channels) for k, step in enumerate(steps))


def _cluster(channels: Sequence[LogPiece], changes: Sequence[Sequence[ChangePoint]]) -> list[Cluster]:
    """Changes of different channels that may be one, the sharpest first: they say when."""
    every = sorted((change.width_s, change.time_s, place) for place, those in enumerate(changes) for change in those)
    clusters: list[Cluster] = []
    for width_s, time_s, place in every:
        change = ChangePoint(time_s, width_s)
        near = sorted(clusters, key=lambda cluster: abs(cluster.time_s - time_s))
        fits = [c for c in near if _may_be_one(c, change, changes[place])]
        home = next((c for c in fits if place not in c.changes and _in_order(c, near, place, time_s)), None)
        few_s = FEW_READINGS * channels[place].period_s
        again = next((c for c in near if place in c.changes and abs(c.time_s - time_s) < few_s), None)
        if again is not None and (home is None or abs(again.time_s - time_s) < abs(home.time_s - time_s)):
            again.changes[place].append(change)
        elif home is not None:
            home.changes[place] = [change]
        else:
            clusters.append(Cluster(time_s, width_s, {place: [change]}))
    return sorted(clusters, key=lambda cluster: cluster.time_s)


def _may_be_one(cluster: Cluster, change: ChangePoint, own: Sequence[ChangePoint]) -> bool:
    """Whether the windows of a cluster and of a change overlap; `own` are all the changes of its channel.

    A change is seen late, not early, by a slow sensor: behind, the windows may just touch. How late that can be, the
    sharpest window tells in which the channel changed nearer to the cluster: one that shows it within seconds is not
    slow, and what a wide window shows of it much later is another change.
    """
    apart_s = change.time_s - cluster.time_s
    nearer = (one.width_s for one in own if abs(one.time_s - cluster.time_s) < abs(apart_s))
    late_s = min(change.width_s, min(nearer, default=change.width_s))
    return -cluster.width_s - change.width_s <= apart_s <= cluster.width_s + 2.0 * late_s


def _in_order(cluster: Cluster, others: Sequence[Cluster], place: int, time_s: float) -> bool:
    """Whether a channel's change in that cluster comes before and after its others as the clusters do: one that a wide
    window showed may be near to a cluster that its own earlier change has passed."""
    own = (c for c in others if place in c.changes)
    return all((time_s - c.changes[place][0].time_s) * (cluster.time_s - c.time_s) > 0 for c in own)


def _merged(channels: Sequence[LogPiece], clusters: Sequence[Cluster], merge_s: float | None) -> list[list[Cluster]]:
    """Clusters that follow one another in stages put together."""
    if len(clusters) < 2:
        return [[cluster] for cluster in clusters]
    times = np.array([cluster.time_s for cluster in clusters])
    gaps = np.diff(times)
    period = max(channels[place].period_s for cluster in clusters for place in cluster.changes)
    joined = gaps < FEW_READINGS * period
    if merge_s is not None:
        joined = gaps <= merge_s
    else:
        begins_s = min(float(channel.time_s[0]) for channel in channels)
        ends_s = max(float(channel.time_s[-1]) for channel in channels)
        for pause in np.unique(gaps[gaps <= STAGE_READINGS * period]):
            chain = gaps <= pause
            first = 0
            while first < gaps.size:
                if not chain[first]:
                    first += 1
                    continue
                last = first
                while last + 1 < gaps.size and chain[last + 1]:
                    last += 1
                before = gaps[first - 1] if first else times[0] - begins_s
                after = gaps[last + 1] if last + 1 < gaps.size else ends_s - times[-1]
                if min(before, after) >= STAGE_QUIET * gaps[first : last + 1].max():
                    joined[first : last + 1] = True
                first = last + 1
    groups = [[clusters[0]]]
    for together, cluster in zip(joined, clusters[1:], strict=True):
        if together and (merge_s is not None or not _went_back(channels, groups[-1][-1], cluster)):
            groups[-1].append(cluster)
        else:
            groups.append([cluster])
    return groups


def _went_back(channels: Sequence[LogPiece], one: Cluster, other: Cluster) -> bool:
    """Whether a channel had come to rest after a change for as long as a run takes, and then went back: a step each,
    and no stages of one."""
    for place in one.changes.keys() & other.changes.keys():
        channel, first, last = channels[place], one.changes[place][-1], other.changes[place][0]
        time_s, value = channel.time_s, channel.value
        between = value[(time_s > first.time_s) & (time_s < last.time_s - 0.5 * channel.period_s)]
        if between.size < READINGS_BEFORE + READINGS_AFTER:
            continue
        rest = between[between.size // 2 :]
        before = value[time_s < first.time_s - first.width_s][-READINGS_BEFORE:]
        after = value[time_s > last.time_s + last.width_s][:READINGS_BEFORE]
        if not before.size or not after.size:
            continue
        level = float(np.median(rest))
        went, back = level - float(np.median(before)), float(np.median(after)) - level
        if np.ptp(rest) < RESTED_SHARE * abs(went) and went * back < 0 and abs(back) > 0.5 * abs(went):
            return True
    return False


def _with_turns(channels: Sequence[LogPiece], groups: Sequence[list[Cluster]]) -> list[list[Cluster]]:
    """Groups with what is a turn on the way and no step put to the one before: humidity alone, while the same sensor's
    temperature is under way."""
    kept: list[list[Cluster]] = []
    for group in groups:
        if kept and _turns(channels, group, kept[-1]):
            kept[-1] = [*kept[-1], *group]
        else:
            kept.append(list(group))
    return kept


def _turns(channels: Sequence[LogPiece], group: Sequence[Cluster], before: Sequence[Cluster]) -> bool:
    """Whether all that changes in `group` is humidity whose own temperature still follows a change `before`."""
    places = {place for cluster in group for place in cluster.changes}
    if any(channels[place].quantity != "humidity" for place in places):
        return False
    for place in places:
        own = own_temperature(channels, place)
        moved = [change.time_s for cluster in before for change in cluster.changes.get(-1 if own is None else own, ())]
        if own is None or not moved or not on_its_way(channels[own], min(moved), group[0].time_s):
            return False
    return True


def _changed_s(
    channels: Sequence[LogPiece], groups: Sequence[Sequence[Cluster]], which: Callable[[float, float], float]
) -> dict[str, float]:
    """When each sensor that changes in some groups last (`max`) or first (`min`) does."""
    found: dict[str, float] = {}
    for cluster in (cluster for group in groups for cluster in group):
        for place, changes in cluster.changes.items():
            name = sensor_of(channels[place].name)
            for change in changes:
                found[name] = which(found.get(name, change.time_s), change.time_s)
    return found


def _steps(
    channels: Sequence[LogPiece],
    group: Sequence[Cluster],
    piece: int,
    since: Mapping[str, float],
    until: Mapping[str, float],
    left_out: frozenset[int] = frozenset(),
) -> list[StepInLog]:
    """Time the first change of every channel that moved, from the last one before on until the next one of its sensor,
    on the log's clock; none where none did more than wander.

    What had surely begun before the sharpest move did is a step of its own, however wide the window that showed both,
    and so is what surely began when the first had settled: a sensor that is late is not that late.
    """
    moves: dict[int, StepOnset] = {}
    stages, lasted_s = 1, 0.0
    for place, channel in enumerate(channels):
        mine = sorted((c for cluster in group for c in cluster.changes.get(place, ())), key=lambda c: c.time_s)
        if not mine or place in left_out:
            continue
        since_s = max(since.get(sensor_of(channel.name), -np.inf), float(channel.time_s[0]))
        end_s = min(until.get(sensor_of(channel.name), np.inf), float(channel.time_s[-1]))
        own = own_temperature(channels, place)
        if own is not None and any(own in cluster.changes for cluster in group):
            turned_s = turn_s(channel, channels[own], mine[0], end_s)
            if turned_s is not None:
                # It comes back: only when it began is to be had of it.
                moves[place] = fit_onset(channel, mine[0], since_s, turned_s)
                continue
        # In stages the way goes on: its end is that of the step, the start is that of the first stage.
        move = fit_onset(channel, mine[0], since_s, end_s)
        count, last_s = count_stages(channel, move, end_s)
        if count >= MANY_STAGES:
            move = first_stage(channel, move, mine[0])
        elif not _stands_out(channel, move, mine[0].width_s, since_s, end_s):
            continue
        if count > stages:
            stages, lasted_s = count, last_s - move.at_s
        moves[place] = move
    if not moves:
        return []
    sharp = min(moves.values(), key=lambda move: move.uncertainty_s)
    sharp_s = sharp.at_s - 2.0 * sharp.uncertainty_s
    earlier = {place for place, move in moves.items() if move.at_s + 2.0 * move.uncertainty_s < sharp_s}
    # With its hygrometer a thermometer was carried too, where it may have been as early.
    began_s = {sensor_of(moves[p].channel): moves[p].at_s + 2.0 * moves[p].uncertainty_s for p in sorted(earlier)}
    with_it = [(place, began_s.get(sensor_of(move.channel), -np.inf)) for place, move in moves.items()]
    earlier |= {place for place, late_s in with_it if moves[place].at_s - 2.0 * moves[place].uncertainty_s <= late_s}
    before: list[StepInLog] = []
    if earlier and stages < MANY_STAGES:
        others = frozenset(range(len(channels))) - earlier
        moves = {place: move for place, move in moves.items() if place not in earlier}
        ends = dict.fromkeys((sensor_of(move.channel) for move in moves.values()), sharp_s)
        before = _steps(channels, group, piece, since, {**until, **ends}, left_out | others)
    first = min(moves.values(), key=lambda move: move.at_s + 2.0 * move.uncertainty_s)
    settled_s = first.at_s + SETTLED_T63 * first.t63_s + 2.0 * first.uncertainty_s
    later = {place for place, move in moves.items() if move.at_s - 2.0 * move.uncertainty_s > settled_s}
    after: list[StepInLog] = []
    if later and stages < MANY_STAGES:
        others = frozenset(range(len(channels))) - later
        moves = {place: move for place, move in moves.items() if place not in later}
        begins = dict.fromkeys((sensor_of(move.channel) for move in moves.values()), settled_s)
        after = _steps(channels, group, piece, {**since, **begins}, until, left_out | others)
    first_ = StepInLog(piece, first.at_s, first.uncertainty_s, tuple(moves.values()), stages, lasted_s)
    return [*before, first_, *after]


def _stands_out(channel: LogPiece, move: StepOnset, width_s: float, since_s: float, until_s: float) -> bool:
    """Whether a channel went to another level and no farther, stayed there, and was faster on its way than before."""
    if abs(move.size) < 0.5 * channel.least:
        return False
    time_s, value = channel.time_s, channel.value
    settled_s = move.at_s + SETTLED_T63 * move.t63_s
    if move.beyond > abs(move.size):  # a pulse: what it did between is more than what is left of it
        return False
    judged_s = settled_s + max(STAYS_T63 * move.t63_s, STAYS_READINGS * channel.period_s)
    later = value[(time_s > settled_s) & (time_s <= min(judged_s, until_s))]
    if later.size and (np.abs(later - move.before) < np.abs(later - move.after)).mean() > RETURNED_SHARE:
        return False
    lead_s = max(move.t63_s, 8.0 * channel.period_s)
    last_s = move.at_s - min(2.0 * move.uncertainty_s, width_s)
    rested_s = since_s + 0.5 * (move.at_s - since_s) if since_s > time_s[0] else since_s
    begin_s = max(last_s - lead_s, rested_s)
    before = (time_s >= begin_s) & (time_s < last_s)
    nobody_can_tell = before.sum() < FEW_READINGS
    if nobody_can_tell:  # when it began: then half of what surely lies before it shows whether it only went on
        before = (time_s >= since_s + 0.5 * (last_s - since_s)) & (time_s < last_s)
    if before.sum() < FEW_READINGS:
        return True
    line, covariance = np.polyfit(time_s[before] - move.at_s, value[before], 1, cov=True)
    slope = float(line[0])
    if nobody_can_tell and slope * move.size < 2.0 * np.sqrt(covariance[0, 0]) * abs(move.size):
        return True
    # Turned round at once: carried back before it had settled. Waves turn as slowly as they go.
    if slope * move.size < 0 and width_s <= min(AT_ONCE * move.t63_s, AT_ONCE_READINGS * channel.period_s):
        return True
    return bool(abs(slope) * max(move.t63_s, channel.period_s) <= UNDER_WAY * abs(move.size))


def _judged(step: StepInLog, steps: Sequence[StepInLog], k: int, channels: Sequence[LogPiece]) -> StepInLog:
    """The step with the reason why its course makes no run, where there is one; how many readings it has is told by
    the window that is cut for it."""
    moved = [channel for channel in channels if channel.name in {move.channel for move in step.moves}]
    ends_s = max(float(c.time_s[-1]) for c in moved)
    until_s = dict(step.next_s)  # of each sensor: what others did meanwhile does not end its way
    for later in steps[k + 1 :]:
        for name in {sensor_of(move.channel) for move in later.moves}:
            until_s[name] = min(later.at_s, until_s.get(name, np.inf))
    of_channel = {channel.name: channel for channel in moved}
    holes_s = [_hole_s(of_channel[move.channel], move) for move in step.moves]
    why, is_ramp = "", False
    if min(holes_s) > 0.0:
        why = (
            f"no readings for {short(min(holes_s), 3)} s on its way: neither when it began nor how fast it was is told"
        )
    elif step.stages >= MANY_STAGES:
        why = f"came in {step.stages} stages over {short(step.lasted_s, 3)} s: the air itself took that long"
    elif all(
        move.t63_s > RAMP_SHARE * (min(until_s.get(sensor_of(move.channel), np.inf), ends_s) - move.at_s)
        for move in step.moves
    ):
        why = "did not slow down until the next change or the end: a ramp, or too short a stretch to tell"
    elif ramp_s := min(
        _ramp_s(of_channel[move.channel], move, until_s.get(sensor_of(move.channel), np.inf))
        for move in _fastest(step.moves)
    ):
        why = f"a ramp, as fast until its end after {short(ramp_s, 3)} s: the air itself took that long"
        is_ramp = True
    return replace(step, why_not=why, is_ramp=is_ramp)


def _fastest(moves: Sequence[StepOnset]) -> list[StepOnset]:
    """Of each quantity the move that went its way in the least time: it tells best what the air did."""
    quantities = dict.fromkeys(move.quantity for move in moves)
    return [min((m for m in moves if m.quantity == q), key=lambda move: move.t63_s) for q in quantities]


def _ramp_s(channel: LogPiece, move: StepOnset, until_s: float) -> float:
    """How long a move took that went on as fast until it was there; 0 of one that slowed down, or is too coarse to
    tell."""
    if CHANGE_SIGMAS * channel.noise > (RAMP_ENDS - 0.63) * abs(move.size):
        return 0.0
    inside = (channel.time_s >= move.at_s) & (channel.time_s <= until_s)
    time_s, value = channel.time_s[inside], channel.value[inside]
    begin_s, half_s, end_s = (
        reached(time_s, value, move.before, move.after, share, np.inf) for share in (RAMP_BEGINS, 0.63, RAMP_ENDS)
    )
    if np.isinf(end_s) or half_s - begin_s < FEW_READINGS * channel.period_s:
        return 0.0
    as_fast_s = (half_s - begin_s) * (RAMP_ENDS - 0.63) / (0.63 - RAMP_BEGINS)  # that the rest takes
    return float(end_s - move.at_s) if STILL_AS_FAST * (end_s - half_s) < as_fast_s else 0.0


def _hole_s(channel: LogPiece, move: StepOnset) -> float:
    """How long no reading came while a move went its way to 63 %, where that hides a change of its own; else 0."""
    row_s = row_between(channel, move.at_s + HIDDEN_SHARE * move.t63_s, move.at_s + move.t63_s)
    return row_s if row_s > FEW_READINGS * channel.period_s else 0.0
