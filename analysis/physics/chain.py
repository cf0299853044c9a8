"""The measurement chain air -> exchange -> body -> readout -> logger, evaluated in closed form for many candidates at
once.

The plain model (Segales et al. 2022, Eqs. 1 and 8, doi 10.5194/amt-15-2607-2022) is the chain with nothing added; an
effect replaces fields of the chain. Leading axes are always (candidates B, runs R), times add a last axis n.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.physics import concentration, modes
from shockrig.analysis.physics.bodies import Body
from shockrig.analysis.physics.conditions import Conditions
from shockrig.analysis.physics.driven import beside_lagging_reference, respond
from shockrig.analysis.physics.exchange import REFERENCE_C, Stream, ventilation_ratio
from shockrig.analysis.physics.humidity import saturation_pressure_hpa

Array = NDArray[np.float64]

SHORT_RAMP_S = 0.2  # a change of the air within a sample or two is a jump to whoever samples it
JUMP_K = 0.3  # change of the air's temperature from which RH jumps with it
KNOTS = 256  # of the humidity that a film sees at its own temperature
TINY_S = 1e-9
SATURATED_PERCENT = 100.0
DRIVEN_MODES = 20  # a measured trace has no step that would need more
GAUSS_NODES = 5  # for the mean of readings that all lie well after the transfer
NODES_FROM = 2.0  # lengths of the averaging after which they do
WARPED = 3.0  # ramps after which one is over on the time axis of a film whose diffusivity depends on its uptake
JUMP_S = 0.05  # this near a jump, five times the trigger's uncertainty, nobody knows on which side of it a sample is


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
    """Air let in at the transfer: share `fraction` exp(-t / time_constant) of air at the room's state; each (B, 1)."""

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
    lags : tuple of (share, time constant [s]), each (B, 1 or R)
        Parts of the body that follow the air as a first-order lag.
    series : tuple of time constants [s], each (B, 1 or R)
        First-order lags in series with the body: a housing, a vent, a cap.
    echoes : tuple of (share, time constant [s]), each (B, 1 or R)
        Shares of the whole response that pass one more first-order lag; a negative share is a lead.
    loaded : (time constant [s], capacity relative to the body's), each (B, 1), or None
        A sheath: a well-mixed layer around the body that the body loads; `biot` is then the air film's outside of it.
    wet_until_s : ndarray (B, R) or None
        Until when a film with dew on it sees saturated air [s]; 0 or less for runs without dew.
    at_die_temperature : bool
        Whether ppmv is turned into RH at the die's temperature.
    by_activity : bool
        Whether the film takes up by the relative humidity at its own temperature, and not by the vapour in the air.
    percent_per_k : ndarray (B, 1) or None
        By how much the calibration of RH moves with the sensor's temperature, from 20 degC on.
    readouts : tuple of functions (reading (B, R, n), time_s (B, R, n), die_c (R, n)) -> reading
        Applied in order.
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
    ramp_s: Array | None = None
    rooms: tuple[RoomAir, ...] = ()
    biot: Array | None = None
    activity_slope: Array | None = None
    lags: tuple[tuple[Array, Array], ...] = ()
    series: tuple[Array, ...] = ()
    echoes: tuple[tuple[Array, Array], ...] = ()
    loaded: tuple[Array, Array] | None = None
    wet_until_s: Array | None = None
    at_die_temperature: bool = False
    by_activity: bool = False
    percent_per_k: Array | None = None
    readouts: tuple[Callable[[Array, Array, Array], Array], ...] = ()
    averaged: int = 1


def relative_ventilation(channel: Recorded) -> Array:
    """Heat exchange of each run (R,) relative to that at 5 m/s and 1013.25 hPa."""
    return ventilation_ratio(Stream.of_runs(channel.conditions), channel.length_m)


def evaluate(chain: Chain, reading_of: Callable[[Chain], Array]) -> Array:
    """Readings of the chain, shape (B, R, n) [degC or %RH]; `reading_of` is `temperature_reading` or its like."""
    if chain.averaged > 1 and chain.channel.jumps_with_air and not chain.by_activity:
        return _running_mean(chain, reading_of)
    reading, period = reading_of(chain), chain.channel.reading_period_s
    for readout in chain.readouts:
        # Readouts of such a channel are linear in the reading: what they add to each reading is averaged by itself.
        each = [readout(reading, chain.time_s - j * period, chain.die_c) for j in range(chain.averaged)]
        reading = each[0] if len(each) == 1 else np.mean(each, axis=0)
    return reading


def _running_mean(chain: Chain, reading_of: Callable[[Chain], Array]) -> Array:
    """Mean of the last n readings: all of them where a corner lies among them, Gauss nodes for them elsewhere."""
    n, period = chain.averaged, chain.channel.reading_period_s
    single = replace(chain, averaged=1)

    def at(shift_s: float, columns: NDArray[np.int64]) -> Array:
        die = chain.channel.die_earlier_c(shift_s) if chain.at_die_temperature else chain.die_c
        moved = replace(single, time_s=chain.time_s[..., columns] - shift_s, die_c=die[:, columns])
        return evaluate(moved, reading_of)

    smooth = ~_near_corners(chain, NODES_FROM * n * period)
    smooth &= n > GAUSS_NODES and all(air is None for air in chain.channel.air)
    whole, few = np.flatnonzero(~smooth), np.flatnonzero(smooth)
    out = np.zeros(np.broadcast_shapes(chain.time_s.shape, (*chain.rate.shape, 1)))
    if whole.size:
        out[..., whole] = sum(at(j * period, whole) for j in range(n)) / n
    if few.size:
        nodes, weights = discrete_gauss(n, GAUSS_NODES)
        out[..., few] = sum(w * at(float(j) * period, few) for j, w in zip(nodes, weights, strict=True))
    return out


def _near_corners(chain: Chain, span_s: float) -> NDArray[np.bool_]:
    """Columns (n,) within `span_s` after a corner of the reading: the transfer's two ends, and when a film dries."""
    ends = [np.zeros((1, 1))]
    if chain.ramp_s is not None:
        ends.append(chain.ramp_s if chain.activity_slope is None else WARPED * chain.ramp_s)
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


def at_jump(chain: Chain) -> NDArray[np.bool_]:
    """Bins (R, n) of the first candidate that stand so near a jump of the reading that they say nothing.

    RH read at the air's temperature jumps with it: 10 K are worth as much as the whole transient.
    """
    time = chain.time_s[0]
    stepped = np.abs(chain.destination_c[0] - chain.source_c[0]) > JUMP_K
    ramp = np.zeros(()) if chain.ramp_s is None else chain.ramp_s[0]
    reads_as_air = chain.channel.jumps_with_air and not (chain.at_die_temperature or chain.by_activity)
    if not reads_as_air or np.max(ramp) > SHORT_RAMP_S:
        return np.zeros(time.shape, dtype=bool)
    # A logger that averages spreads the jump over the readings that it averages.
    shifts = chain.channel.reading_period_s * np.arange(chain.averaged)
    until = np.broadcast_to(ramp, (time.shape[0],))[:, None] + JUMP_S
    late = [(time - shift > -JUMP_S) & (time - shift < until) for shift in shifts]
    return stepped[:, None] & np.any(late, axis=0) & (chain.channel.count > 0)


def temperature_reading(chain: Chain) -> Array:
    """Temperature that the body shows, before the readout (B, R, n) [degC]."""
    response = _response(chain, chain.rate)
    step = (chain.destination_c - chain.source_c)[..., None]
    reading = chain.source_c[..., None] + step * _driven(chain, response, chain.time_s, chain.ramp_s)
    for room in chain.rooms:
        excess = room.fraction * (room.temperature_c - chain.destination_c)
        reading = reading + excess[..., None] * _let_in(chain, response, room)
    for run, air in _measured(chain):
        trace = air.temperature_c + chain.air_offset[:, run, None]
        _drive_by(chain, reading, run, response, air, trace, chain.time_s)
    return reading


def humidity_reading(chain: Chain) -> Array:
    """Relative humidity that the film shows, before the readout (B, R, n) [%RH]."""
    reading = _taken_up_by_activity(chain) if chain.by_activity else _taken_up(chain) / _saturation_at_reading(chain)
    if chain.percent_per_k is not None:
        own = np.where(np.isfinite(chain.die_c), chain.die_c, _conversion_temperature(chain))
        reading = reading + chain.percent_per_k[..., None] * (own - REFERENCE_C)
    return reading


def _taken_up(chain: Chain) -> Array:
    """What the film holds of the air's vapour, 100 times its pressure (B, R, n) [hPa]."""
    source_hpa, destination_hpa = _vapour_hpa(chain)
    rate, time, ramp_s = chain.rate, chain.time_s, chain.ramp_s
    if chain.activity_slope is not None:
        rate, time, ramp_s = _concentration_dependent(chain, chain.activity_slope, source_hpa)
    response = _response(chain, rate)
    held = source_hpa[..., None] + (destination_hpa - source_hpa)[..., None] * _driven(chain, response, time, ramp_s)
    if chain.wet_until_s is not None:
        wet = np.maximum(chain.wet_until_s, 0.0)[..., None]
        excess = 100.0 * saturation_pressure_hpa(chain.destination_c) - destination_hpa
        held = held + excess[..., None] * (response.step(time) - response.step(time - wet))
    for room in chain.rooms:
        excess = room.fraction * (room.humidity_percent * saturation_pressure_hpa(room.temperature_c) - destination_hpa)
        held = held + excess[..., None] * _let_in(chain, response, room)
    for run, air in _measured(chain):
        _drive_by(chain, held, run, response, air, _measured_vapour(chain, run, air), time)
    return held


def _vapour_hpa(chain: Chain) -> tuple[Array, Array]:
    """100 times the vapour pressure of the two airs, each (B, R) [hPa]."""
    return (
        chain.source_percent * saturation_pressure_hpa(chain.source_c),
        chain.destination_percent * saturation_pressure_hpa(chain.destination_c),
    )


def _measured_vapour(chain: Chain, run: int, air: MeasuredAir) -> Array:
    """100 times the vapour pressure of a measured air (B, m) [hPa]."""
    saturated = saturation_pressure_hpa(_known_temperature(chain, air, run))
    return np.asarray((air.humidity_percent + chain.air_offset[:, run, None]) * saturated)


def _taken_up_by_activity(chain: Chain) -> Array:
    """What the film holds where it takes up by the relative humidity at its own temperature (B, R, n) [%RH].

    That drives the film as a measured trace does: straight lines between knots that lie the denser the nearer to the
    transfer, where the air jumps and the sensor's temperature begins to follow.
    """
    response, shape = _response(chain, chain.rate), np.broadcast_shapes(chain.time_s.shape, (*chain.rate.shape, 1))
    since = max(float(chain.time_s.max()), JUMP_S) * np.linspace(0.0, 1.0, KNOTS) ** 2
    since[0] = TINY_S  # the transfer has begun
    knots = np.concatenate([[-1.0, 0.0, 0.0], since[1:]])
    at_knots = replace(chain, time_s=np.broadcast_to(since, (*chain.time_s.shape[:2], KNOTS)))
    source_hpa, destination_hpa = _vapour_hpa(chain)
    begun = _begun(at_knots)
    vapour = source_hpa[..., None] + (destination_hpa - source_hpa)[..., None] * begun
    for room in chain.rooms:
        excess = room.humidity_percent * saturation_pressure_hpa(room.temperature_c) - destination_hpa
        vapour = vapour + begun * _left_of(at_knots, room) * excess[..., None]
    # The sensor's own temperature was recorded by the run's clock; the knots count from each candidate's transfer.
    late = (chain.channel.time_s - chain.time_s)[..., :1]
    # What is above saturation condenses, and the film beside it sees saturated air.
    seen = np.minimum(vapour / saturation_pressure_hpa(_own_temperature(at_knots, since + late)), SATURATED_PERCENT)
    if chain.wet_until_s is not None:
        wet = np.clip((chain.wet_until_s[..., None] - since) / np.gradient(since) + 0.5, 0.0, 1.0)
        seen = seen + wet * (SATURATED_PERCENT - seen)
    still = replace(chain, time_s=np.full((*chain.time_s.shape[:2], 1), -1.0))
    before = source_hpa[..., None] / saturation_pressure_hpa(_own_temperature(still, late - TINY_S))
    trace = np.concatenate([np.broadcast_to(before, (*seen.shape[:2], 2)), seen], axis=-1)
    own = modes.slowest(response, DRIVEN_MODES)
    period_s = chain.channel.reading_period_s
    reading = respond(own, knots, trace, chain.time_s, samples=chain.averaged, period_s=period_s)
    reading = np.array(np.broadcast_to(reading, shape))
    for run, air in _measured(chain):
        recorded, die = _dies(chain)[run]
        own_c = _known_temperature(chain, air, run) if die is None else np.interp(air.time_s, recorded, die)
        seen = np.minimum(_measured_vapour(chain, run, air) / saturation_pressure_hpa(own_c), SATURATED_PERCENT)
        _drive_by(chain, reading, run, response, air, seen, chain.time_s)
    return reading


def _own_temperature(chain: Chain, recorded_s: Array) -> Array:
    """The sensor's own temperature at the chain's times (B, R, n) [degC], the air's where it was not recorded;
    `recorded_s` are those times by the clocks of the runs.
    """
    air = _conversion_temperature(chain)
    own = np.array(np.broadcast_to(air, np.broadcast_shapes(air.shape, recorded_s.shape)))
    for run, (recorded, die) in enumerate(_dies(chain)):
        if die is not None:
            own[:, run] = np.interp(recorded_s[:, run], recorded, die)
    return own


def _dies(chain: Chain) -> list[tuple[Array, Array | None]]:
    """Each run's sample times and the sensor's own temperature at them (m,), None where it was not recorded."""
    times, dies = (
        [time for time, _ in chain.channel.samples],
        chain.channel.die_samples or [None] * len(chain.channel.samples),
    )
    return [
        (t, die if die is not None and np.isfinite(die).all() else None) for t, die in zip(times, dies, strict=True)
    ]


def _response(chain: Chain, rate: Array) -> modes.Modes:
    """Response of body, lags in parallel and lags in series to the air."""
    lags = [x for pair in (*chain.lags, *chain.echoes) for x in pair]
    films = [x for x in (chain.biot, *(chain.loaded or ())) if x is not None]
    if not (lags or films or chain.series):
        return chain.body.held().scaled(rate)
    count, pick, place = _different((rate, *films, *lags, *chain.series))

    def own(x: Array) -> Array:
        return x[pick] if x.shape[0] == count else x

    if chain.loaded is not None:
        time_constant_s, capacity = (own(x) for x in chain.loaded)
        biot = None if chain.biot is None else own(chain.biot)
        time_constant = chain.body.sheath_time(time_constant_s * own(rate), capacity, biot)
        body = chain.body.sheathed(time_constant, capacity)
    else:
        body = chain.body.held() if chain.biot is None else chain.body.behind(own(chain.biot))
    response = body.scaled(own(rate))
    for time_constant_s in chain.series:
        response = modes.in_series(response, own(time_constant_s))
    for share, time_constant_s in chain.lags:
        response = modes.mix(response, modes.first_order(own(time_constant_s)), own(share))
    for share, time_constant_s in chain.echoes:
        response = modes.mix(response, modes.in_series(response, own(time_constant_s)), own(share))
    each = ((x[place] if x.ndim > 2 and x.shape[0] == pick.size else x) for x in (response.amplitude, response.rate))
    return modes.Modes(*each)


def _measured(chain: Chain) -> list[tuple[int, MeasuredAir]]:
    return [(run, air) for run, air in enumerate(chain.channel.air) if air is not None]


def _known_temperature(chain: Chain, air: MeasuredAir, run: int) -> Array:
    """Temperature of a measured air (m,); the destination's where nobody measured it."""
    return np.where(np.isfinite(air.temperature_c), air.temperature_c, chain.channel.conditions.destination_c[run])


def _drive_by(
    chain: Chain, out: Array, run: int, response: modes.Modes, air: MeasuredAir, trace: Array, at_s: Array
) -> None:
    """Put a run's response to its measured air (B, m) in its place in `out` (B, R, n)."""
    amplitude, rate = (
        x[..., min(run, x.shape[-2] - 1), :] if x.ndim > 1 else x for x in (response.amplitude, response.rate)
    )
    own = modes.slowest(modes.Modes(amplitude, rate), DRIVEN_MODES)
    if air.lag_s > 0:
        own = beside_lagging_reference(own, air.lag_s)
    period_s = chain.channel.reading_period_s
    out[:, run] = respond(own, air.time_s, trace, at_s[:, run], samples=chain.averaged, period_s=period_s)


def _concentration_dependent(chain: Chain, slope: Array, source_hpa: Array) -> tuple[Array, Array, Array | None]:
    """Rate at the destination's concentration; time, and the ramp's duration, warped so that the linear film gives the
    nonlinear film's mean.
    """
    saturated = saturation_pressure_hpa(chain.destination_c)
    at_source = 1.0 + slope * (source_hpa / saturated / 100.0 - 0.5)
    at_destination = np.maximum(1.0 + slope * (chain.destination_percent / 100.0 - 0.5), 0.05)
    rate = chain.rate * at_destination
    ratio = np.maximum(at_source, 0.05) / at_destination
    if chain.ramp_s is None:
        return rate, chain.time_s * concentration.time_warp(chain.time_s * rate[..., None], ratio[..., None]), None
    # A ramp is a step at its middle; while it lasts the film takes up as fast as it does at first.
    early = concentration.time_warp(np.zeros(()), ratio[..., None])
    middle = 0.5 * chain.ramp_s[..., None]
    late = np.maximum(chain.time_s - middle, 0.0)
    warp = concentration.time_warp(late * rate[..., None], ratio[..., None])
    return rate, np.minimum(chain.time_s, middle) * early + late * warp, chain.ramp_s * early[..., 0]


def _driven(chain: Chain, response: modes.Modes, time: Array, ramp_s: Array | None) -> Array:
    """Response to the unit transfer."""
    if ramp_s is None:
        return _shared(_averaged(chain, modes.Modes.step), response, time)
    return _shared(_averaged(chain, modes.Modes.ramp), response, time, ramp_s)


def _let_in(chain: Chain, response: modes.Modes, room: RoomAir) -> Array:
    """Response to a room's air that comes in with the transfer and decays from its start."""
    let_in = () if chain.ramp_s is None else (chain.ramp_s,)
    return _shared(_averaged(chain, modes.Modes.exponential), response, chain.time_s, room.time_constant_s, *let_in)


def _averaged(chain: Chain, form: Callable[..., Array]) -> Callable[..., Array]:
    """A closed form in the mean of the readings that the logger averages."""
    return partial(form, samples=chain.averaged, period_s=chain.channel.reading_period_s)


def _shared(form: Callable[..., Array], response: modes.Modes, time: Array, *arguments: Array) -> Array:
    """A closed form for all candidates; those that differ only in what it is multiplied with share one evaluation."""
    keys = (response.amplitude, response.rate, time, *arguments)
    count, pick, place = _different(keys)
    if count < 3:
        return form(response, time, *arguments)
    amplitude, rate, *rest = (key[pick] if key.ndim > 1 and key.shape[0] == count else key for key in keys)
    return np.asarray(form(modes.Modes(amplitude, rate), *rest)[place])


def _different(keys: Sequence[Array]) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """How many candidates there are, which of them differ from the first in anything (with the first), and the place of
    each among those."""
    count = max(key.shape[0] if key.ndim > 1 else 1 for key in keys)
    same = np.ones(count, dtype=bool)
    for key in keys:
        if key.ndim > 1 and key.shape[0] == count:
            same &= (key == key[:1]).reshape(count, -1).all(axis=1)
    own = np.flatnonzero(~same)
    place = np.zeros(count, dtype=int)
    place[own] = np.arange(1, own.size + 1)
    return count, np.concatenate([[0], own]), place


def _saturation_at_reading(chain: Chain) -> Array:
    """Saturation pressure [hPa] (B, R, n) at the temperature to which the film's vapour is related."""
    if chain.at_die_temperature and np.isfinite(chain.die_c).all():
        return saturation_pressure_hpa(chain.die_c)
    time, known_air = chain.time_s, any(np.isfinite(air.temperature_c).all() for _, air in _measured(chain))
    if chain.ramp_s is None and not chain.rooms and not known_air and not chain.at_die_temperature:
        # Two temperatures are all that there are.
        before, after = saturation_pressure_hpa(chain.source_c), saturation_pressure_hpa(chain.destination_c)
        return np.where(time > 0, after[..., None], before[..., None])
    return saturation_pressure_hpa(_conversion_temperature(chain))


def _begun(chain: Chain) -> Array:
    """How far the air has come from the source to the destination (B, R, n), 0 to 1."""
    if chain.ramp_s is None:
        return (chain.time_s > 0).astype(float)
    return np.clip(chain.time_s / np.maximum(chain.ramp_s[..., None], 1e-6), 0.0, 1.0)


def _left_of(chain: Chain, room: RoomAir) -> Array:
    """Share of a room's air that is still there (B, R, n)."""
    return np.asarray(room.fraction[..., None] * np.exp(-np.maximum(chain.time_s, 0) / room.time_constant_s[..., None]))


def _conversion_temperature(chain: Chain) -> Array:
    """Temperature of the air (B, R, n) [degC], or of the die where the film is read at that."""
    time, begun = chain.time_s, _begun(chain)
    air = chain.source_c[..., None] + (chain.destination_c - chain.source_c)[..., None] * begun
    for room in chain.rooms:
        air = air + begun * _left_of(chain, room) * (room.temperature_c - chain.destination_c)[..., None]
    for run, measured in _measured(chain):
        if np.isfinite(measured.temperature_c).all():
            air = np.array(np.broadcast_to(air, np.broadcast_shapes(air.shape, time.shape)))
            air[:, run] = np.interp(time[:, run], measured.time_s, measured.temperature_c)
    if chain.at_die_temperature:
        air = np.where(np.isfinite(chain.die_c), chain.die_c, air)
    return air
