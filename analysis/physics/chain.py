"""The measurement chain air -> exchange -> body -> readout -> logger, evaluated in closed form for many candidates at
once.

The plain model (Segales et al. 2022, Eqs. 1 and 8, doi 10.5194/amt-15-2607-2022) is the chain with nothing added; an
effect replaces fields of the chain. Leading axes are always (candidates B, runs R), times add a last axis n.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.physics.air_exchange import Conditions, Stream, ventilation_ratio
from shockrig.analysis.physics.bodies import Body
from shockrig.analysis.physics.distinct import different, of_those

Array = NDArray[np.float64]

SHORT_RAMP_S = 0.2  # a change of the air within a sample or two is a jump to whoever samples it
JUMP_K = 0.3  # change of the air's temperature from which RH jumps with it
GAUSS_NODES = 5  # for the mean of readings that all lie well after the transfer
NODES_FROM = {GAUSS_NODES: 2.0, 3: 2.5, 2: 6.0, 1: 100.0}  # lengths of the averaging after which so many do
WARPED_RAMPS = 3.0  # ramps after which one is over on the time axis of a film whose diffusivity depends on its uptake
JUMP_S = 0.05  # this near a jump, five times the trigger's uncertainty, nobody knows on which side of it a sample is


# Of readings (B, R, n), the times at which they show the air (B, R, n) [s], and the sensor's own temperature (R, n)
# [degC]; the result is the readings as they are then.
ReadingChange = Callable[[Array, Array, Array], Array]


@dataclass(frozen=True)
class MeasuredAir:
    """The air beside the probes as it was measured: (m,) arrays, straight lines between; NaN columns are not known.

    `time_s` counts from the run's nominal start, like the readings; `lag_s` is the time constant of the reference that
    measured the channel's own quantity.
    """

    time_s: Array
    temperature_c: Array
    humidity_percent: Array
    lag_s: float = 0.0


class Recorded(Protocol):
    """What the chain needs of a channel: what its runs were, and what the sensor itself reported."""

    @property
    def conditions(self) -> Conditions: ...
    @property
    def body(self) -> str: ...
    @property
    def time_s(self) -> Array: ...
    @property
    def count(self) -> NDArray[np.int64]: ...
    @property
    def wet_until_s(self) -> Array: ...
    @property
    def air(self) -> tuple[MeasuredAir | None, ...]: ...
    @property
    def lasts_s(self) -> Array: ...
    @property
    def samples(self) -> tuple[tuple[Array, Array], ...]: ...
    @property
    def die_samples(self) -> tuple[Array, ...]: ...
    @property
    def reading_period_s(self) -> float: ...
    @property
    def length_m(self) -> float: ...
    @property
    def jumps_with_air(self) -> bool: ...
    def die_earlier_c(self, shift_s: float) -> Array: ...


@dataclass(frozen=True)
class Airs:
    """The two airs of each run and candidate, (B, R): degC and %RH."""

    source_c: Array
    destination_c: Array
    source_percent: Array
    destination_percent: Array


@dataclass(frozen=True)
class RoomAir:
    """Air let in at the transfer: share `fraction` exp(-t / time_constant) of air at the room's state.

    Each (B, 1), or (B, R) where it differs from run to run.
    """

    fraction: Array
    time_constant_s: Array
    temperature_c: Array
    humidity_percent: Array


@dataclass(frozen=True)
class Chain:
    """One campaign channel, ready to be evaluated.

    Attributes
    ----------
    channel : Recorded
        Conditions, die temperatures, measured airs and the sampling period.
    body : Body
        The shape that takes up heat or vapour; its rates are multiplied by `rate`.
    air_offset : ndarray (B, R)
        What is added to a measured air [the channel's unit]: its reference's own error.
    before : ndarray (B, R) or None
        What is added to the first sample of a measured air, which the sensor had settled to when its record began.
    drift : ndarray (B, R) or None
        What the destination changes by from the transfer to a record's end, evenly [the channel's unit].
    by_chance : ndarray (B, R) or 0
        By how much the effect that differs from run to run is stronger in each run.
    die_c : ndarray (R, n)
        The sensor's own temperature at the readings; NaN where there is none.
    time_s : ndarray (B, R, n)
        Time since the air began to change, later links' delays taken off.
    source_c, destination_c, source_percent, destination_percent : ndarray (B, R)
        The two airs.
    rate : ndarray (B, R)
        alpha / R^2 or D / L^2 [1/s] at the destination.
    ramp_s : ndarray (B, 1 or R) or None
        Duration of the transfer [s]; None is a step.
    rooms : tuple of RoomAir
    biot : ndarray (B, R) or None
        Biot number of the exchange; None holds the surface at the air.
    activity_slope : ndarray (B, 1) or None
        Relative slope of D with water activity.
    lags : tuple of (share (B, 1 or R), time constants (B, 1 or R, J) [s])
        Parts of the body that follow the air as J first-order lags in equal shares.
    series : tuple of time constants [s], each (B, 1 or R)
        First-order lags in series with the body: a housing, a vent, a cap.
    echoes : tuple of (share (B, 1 or R), time constants (B, 1 or R, J) [s])
        Shares of the whole response that pass one more lag, J of them in equal shares; a negative share is a lead.
    loaded : (time constant [s], capacity relative to the body's), each (B, 1), or None
        A sheath: a well-mixed layer around the body that the body loads; `biot` is then the air film's outside of it.
    vapour_late_s : ndarray (B, R) or None
        How long the air's vapour takes to the film [s]: a plug of air before it, in a cap or a tube.
    wet_until_s : ndarray (B, R) or None
        Until when a film with dew on it sees saturated air [s]; 0 or less for runs without dew.
    at_die_temperature : bool
        Whether ppmv is turned into RH at the die's temperature.
    by_activity : bool
        Whether the film takes up by the relative humidity at its own temperature, and not by the vapour in the air.
    percent_per_k : ndarray (B, 1) or None
        By how much the calibration of RH moves with the sensor's temperature, from 20 degC on.
    readouts : tuple of ReadingChange
        What is done to the readings, in order.
    averaged : int
        Each logged value is the mean of this many readings.
    """

    channel: Recorded
    time_s: Array
    source_c: Array
    destination_c: Array
    source_percent: Array
    destination_percent: Array
    rate: Array
    body: Body
    air_offset: Array
    die_c: Array
    before: Array | None = None
    drift: Array | None = None
    by_chance: Array | float = 0.0
    ramp_s: Array | None = None
    rooms: tuple[RoomAir, ...] = ()
    biot: Array | None = None
    activity_slope: Array | None = None
    lags: tuple[tuple[Array, Array], ...] = ()
    series: tuple[Array, ...] = ()
    echoes: tuple[tuple[Array, Array], ...] = ()
    loaded: tuple[Array, Array] | None = None
    vapour_late_s: Array | None = None
    wet_until_s: Array | None = None
    at_die_temperature: bool = False
    by_activity: bool = False
    percent_per_k: Array | None = None
    readouts: tuple[ReadingChange, ...] = ()
    averaged: int = 1

    def with_readout(self, change: ReadingChange) -> Chain:
        """The chain with one change more of its readings, after those that it has."""
        return replace(self, readouts=(*self.readouts, change))


def relative_ventilation(channel: Recorded) -> Array:
    """Heat exchange of each run (R,) relative to that at 5 m/s and 1013.25 hPa."""
    return ventilation_ratio(Stream.of_runs(channel.conditions), channel.length_m)


def evaluate(chain: Chain, reading_of: Callable[[Chain], Array]) -> Array:
    """Readings of the chain, shape (B, R, n) [degC or %RH]; `reading_of` is `temperature_reading` or its like."""
    if chain.averaged > 1 and chain.channel.jumps_with_air and not chain.by_activity:
        return _running_mean(chain, reading_of)
    reading, period = _for_different(chain, reading_of), chain.channel.reading_period_s
    for readout in chain.readouts:
        # Readouts of such a channel are linear in the reading: what they add to each reading is averaged by itself.
        each = [readout(reading, chain.time_s - j * period, chain.die_c) for j in range(chain.averaged)]
        reading = each[0] if len(each) == 1 else np.mean(each, axis=0)
    return reading


# Not different from candidate to candidate, or not seen by the bodies: what readouts do, they have to themselves.
ALIKE_TO_BODIES = frozenset({"channel", "body", "die_c", "by_chance", "readouts"})


def _for_different(chain: Chain, reading_of: Callable[[Chain], Array]) -> Array:
    """What the body shows (B, R, n), evaluated once for all candidates that are as the first one is to it."""
    seen = {name: value for name, value in vars(chain).items() if name not in ALIKE_TO_BODIES}
    count, pick, place = different(list(_arrays(seen.values())))
    if pick.size == count:
        return reading_of(chain)
    return np.asarray(reading_of(replace(chain, **_of_those(seen, count, pick)))[place])


def _arrays(values: Iterable[Any]) -> Iterator[Array]:
    """All arrays in fields of a chain."""
    for value in values:
        if isinstance(value, np.ndarray):
            yield value
        elif isinstance(value, (tuple, RoomAir)):
            yield from _arrays(value if isinstance(value, tuple) else vars(value).values())


def _of_those(value: Any, count: int, pick: NDArray[np.int64]) -> Any:
    """A chain's field for some of its candidates."""
    if isinstance(value, tuple):
        return tuple(_of_those(one, count, pick) for one in value)
    if isinstance(value, RoomAir):
        return RoomAir(**_of_those(vars(value), count, pick))
    if isinstance(value, dict):
        return {name: _of_those(one, count, pick) for name, one in value.items()}
    return of_those(value, count, pick) if isinstance(value, np.ndarray) else value


def _running_mean(chain: Chain, reading_of: Callable[[Chain], Array]) -> Array:
    """Mean of the last n readings, from one evaluation at the nodes of all columns."""
    n, period = chain.averaged, chain.channel.reading_period_s
    taken = _nodes_taken(chain)
    rules = {int(k): _mean_of(n, int(k)) for k in np.unique(taken)}
    columns = np.repeat(np.arange(taken.size), taken)
    earlier = period * np.concatenate([rules[k][0] for k in taken])
    weight = np.concatenate([rules[k][1] for k in taken])
    die = chain.die_c[:, columns]
    if chain.at_die_temperature:
        for shift_s in np.unique(earlier):
            at = earlier == shift_s
            die[:, at] = chain.channel.die_earlier_c(float(shift_s))[:, columns[at]]
    each = replace(chain, averaged=1, time_s=chain.time_s[..., columns] - earlier, die_c=die)
    begins = np.cumsum(taken) - taken
    return np.asarray(np.add.reduceat(weight * evaluate(each, reading_of), begins, axis=-1))


def _mean_of(count: int, nodes: int) -> tuple[Array, Array]:
    """Nodes and weights of a mean over 0, 1, ..., count-1: all of them, or Gauss's."""
    if nodes < count:
        return discrete_gauss(count, nodes)
    return np.arange(count, dtype=float), np.full(count, 1.0 / count)


def _nodes_taken(chain: Chain) -> NDArray[np.int64]:
    """How many nodes the mean at each column takes (n,): all readings where a corner lies among them, the fewer the
    later after it. An exponential that began there is then given to 2e-6 of its size at the corner.
    """
    n, span_s = chain.averaged, chain.averaged * chain.channel.reading_period_s
    taken = np.full(chain.time_s.shape[-1], n)
    if any(air is not None for air in chain.channel.air):
        return taken
    # What is added to the reading may swing at any time, and a die's trace has a corner at each of its samples.
    fewest = GAUSS_NODES if chain.readouts else 2 if chain.at_die_temperature else 1
    for nodes, spans in NODES_FROM.items():
        if fewest <= nodes < n:
            taken[~_near_corners(chain, spans * span_s)] = nodes
    return taken


def _near_corners(chain: Chain, span_s: float) -> NDArray[np.bool_]:
    """Columns (n,) within `span_s` after a corner of the reading: the transfer's two ends, and when a film dries."""
    ends = [np.zeros((1, 1))]
    if chain.ramp_s is not None:
        ends.append(chain.ramp_s if chain.activity_slope is None else WARPED_RAMPS * chain.ramp_s)
    if chain.vapour_late_s is not None:
        ends.append(ends[-1] + chain.vapour_late_s)
    stretches = [(ends[0], ends[-1])]
    if chain.wet_until_s is not None:
        stretches.append((chain.wet_until_s, chain.wet_until_s))
    near = np.zeros(chain.time_s.shape[-1], dtype=bool)
    for begin, end in stretches:
        inside = (chain.time_s > begin[..., None]) & (chain.time_s <= end[..., None] + span_s)
        near |= inside.reshape(-1, near.size).any(axis=0)
    return near


@cache
def discrete_gauss(count: int, nodes: int) -> tuple[Array, Array]:
    """Nodes and weights that give the mean over 0, 1, ..., count-1 of every polynomial of degree < 2 nodes exactly.

    Golub and Welsch (1969, doi 10.1090/S0025-5718-69-99647-1) for the discrete Chebyshev (Gram) polynomials, whose
    recurrence has b_k = k^2 (count^2 - k^2) / (4 (4 k^2 - 1)).
    """
    k = np.arange(1, nodes)
    beside = np.sqrt(k**2 * (count**2 - k**2) / (4.0 * (4.0 * k**2 - 1.0)))
    values, vectors = np.linalg.eigh(np.diag(beside, 1) + np.diag(beside, -1))
    return values + 0.5 * (count - 1), vectors[0] ** 2


def jumps(conditions: Conditions) -> NDArray[np.bool_]:
    """Runs (R,) in which RH that is read at the air's temperature jumps with it: as recorded, since no model may choose
    to be asked nothing."""
    return np.abs(conditions.thermal_step_k) > JUMP_K


def at_jump(chain: Chain, candidate: int = 0) -> NDArray[np.bool_]:
    """Bins (R, n) of one candidate that stand so near a jump of the reading that they say nothing.

    RH read at the air's temperature jumps with it: 10 K are worth as much as the whole transient.
    """
    time = chain.time_s[candidate]
    # What slows all candidates alike stands there once.
    ramp = np.zeros(()) if chain.ramp_s is None else chain.ramp_s[min(candidate, len(chain.ramp_s) - 1)]
    reads_as_air = chain.channel.jumps_with_air and not (chain.at_die_temperature or chain.by_activity)
    if not reads_as_air or np.max(ramp) > SHORT_RAMP_S:
        return np.zeros(time.shape, dtype=bool)
    # A logger that averages spreads the jump over the readings that it averages.
    shifts = chain.channel.reading_period_s * np.arange(chain.averaged)
    until = np.broadcast_to(ramp, (time.shape[0],))[:, None] + JUMP_S
    late = [(time - shift > -JUMP_S) & (time - shift < until) for shift in shifts]
    return jumps(chain.channel.conditions)[:, None] & np.any(late, axis=0) & (chain.channel.count > 0)
