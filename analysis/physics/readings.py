"""What the two bodies show at the end of the chain's first three links: the bead's temperature, the film's humidity.

A film takes up vapour and is read at some temperature, or takes up by the relative humidity at its own temperature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from shockrig.analysis.physics import modes
from shockrig.analysis.physics.air_exchange import REFERENCE_C
from shockrig.analysis.physics.chain import Chain, MeasuredAir, RoomAir
from shockrig.analysis.physics.distinct import different, for_different, of_those
from shockrig.analysis.physics.driven import beside_lagging_reference, respond
from shockrig.analysis.physics.humidity import saturation_pressure_hpa

if TYPE_CHECKING:
    from scipy.interpolate import RectBivariateSpline

Array = NDArray[np.float64]

# Film whose diffusivity changes linearly with concentration, as a warp of time of the film with constant diffusivity.
#
# u_t = ((1 + kappa (1 - u)) u_x)_x on 0 < x < 1, sealed at 0, u = 1 at the surface, u = 0 at the start: one family of
# curves in kappa = D(source) / D(destination) - 1 holds every step of such a film (Crank 1975, chapter 9).

GRID_CELLS = 72
POINTS_BETWEEN = 10  # points between two of the table
LOG_RATIO = np.linspace(np.log(0.08), np.log(12.0), 29)
LOG_TIME = np.linspace(np.log(2e-5), np.log(6.0), 120)


def time_warp(fourier: Array, ratio: Array) -> Array:
    """Factor on time that turns the constant film's mean uptake into the concentration-dependent one.

    Parameters
    ----------
    fourier : ndarray
        Dimensionless time D(destination) t / L^2, >= 0.
    ratio : ndarray, broadcast with it
        D(source) / D(destination), within 0.08 to 12 (held at those bounds beyond).
    """
    table = _fine()
    row, right = _between(np.log(ratio), LOG_RATIO, table.shape[0])
    column, late = _between(np.log(np.maximum(fourier, 1e-300)), LOG_TIME, table.shape[1])
    flat, at = table.ravel(), row * table.shape[1] + column
    low, high = flat[at], flat[at + table.shape[1]]
    low += late * (flat[at + 1] - low)
    high += late * (flat[at + table.shape[1] + 1] - high)
    return np.asarray(low + right * (high - low))


def _between(value: Array, grid: Array, size: int) -> tuple[NDArray[np.int64], Array]:
    """Place of values on an even grid of `size` points over the ends of `grid`: the point below, and the rest."""
    place = np.clip((value - grid[0]) * ((size - 1) / (grid[-1] - grid[0])), 0.0, size - 1.0)
    below = np.minimum(place.astype(int), size - 2)
    return below, place - below


@cache
def _fine() -> Array:
    """The factor itself on a grid so fine that straight lines between its points are good to 5e-5."""
    rows, columns = (
        np.linspace(grid[0], grid[-1], POINTS_BETWEEN * (grid.size - 1) + 1) for grid in (LOG_RATIO, LOG_TIME)
    )
    return np.asarray(np.exp(_table()(rows, columns)))


@cache
def _table() -> RectBivariateSpline:
    from scipy.interpolate import RectBivariateSpline

    times = np.geomspace(1e-7, 12.0, 900)
    # The constant film is integrated on the same grid, so that the error of the stepping cancels in the warp.
    uptake = _uptake(np.concatenate([[0.0], np.exp(LOG_RATIO) - 1.0]), times)
    linear, log_time = uptake[0], np.log(times)
    warp = np.empty((LOG_RATIO.size, LOG_TIME.size))
    for i, curve in enumerate(uptake[1:]):
        early = np.interp(curve, linear, log_time)
        # Near the end the remainder is compared, to keep its digits.
        late = np.interp(-np.log(np.maximum(1 - curve, 1e-12)), -np.log(np.maximum(1 - linear, 1e-12)), log_time)
        shift = np.where(curve < 0.5, early, late) - log_time
        settled = (curve > 1 - 1e-7) | (late > log_time[-2])
        last = int(np.argmax(settled)) if settled.any() else times.size
        shift[last:] = shift[last - 1]
        warp[i] = np.interp(LOG_TIME, log_time, shift)
    return RectBivariateSpline(LOG_RATIO, LOG_TIME, warp, kx=3, ky=3)


def _uptake(kappa: Array, times: Array) -> Array:
    """Mean uptake (len(kappa), len(times)) by finite volumes on cells that narrow towards the surface."""
    edge = np.concatenate([[0.0], np.cumsum(np.geomspace(1.0, 3e-3, GRID_CELLS))])
    edge /= edge[-1]
    width = np.diff(edge)
    between = 0.5 * (width[1:] + width[:-1])
    u = np.zeros((kappa.size, GRID_CELLS))
    out = np.empty((kappa.size, times.size))
    now = 0.0
    for j, t in enumerate(times):
        new = u
        for _ in range(2):
            # Flux through a face uses the mean of the diffusivity over the two cells, exact for a linear law.
            d = 1.0 + kappa[:, None] * (1.0 - new)
            face = 0.5 * (d[:, 1:] + d[:, :-1]) / between
            surface = 0.5 * (d[:, -1] + 1.0) / (0.5 * width[-1])
            new = _implicit(u, face, surface, width, t - now)
        u, now = new, t
        out[:, j] = u @ width
    return out


def _implicit(u: Array, face: Array, surface: Array, width: Array, dt: float) -> Array:
    """One backward Euler step, for all kappa at once: their tridiagonal systems in one row, uncoupled."""
    lower, upper = np.zeros_like(u), np.zeros_like(u)
    lower[:, 1:], upper[:, :-1] = -dt * face / width[1:], -dt * face / width[:-1]
    diagonal = 1.0 - lower - upper
    right = u.copy()
    diagonal[:, -1] += dt * surface / width[-1]
    right[:, -1] += dt * surface / width[-1]
    *_, new, failed = lapack.dgtsv(lower.ravel()[1:], diagonal.ravel(), upper.ravel()[:-1], right.ravel())
    if failed:
        raise FloatingPointError("the film's diffusion could not be stepped")
    return new.reshape(u.shape)


DRIVEN_MODES = 20  # a measured trace has no step that would need more
FIRST_KNOT_S, KNOTS_APART = 0.01, 0.02  # of the humidity that a film sees: the first, and shares of the time since
TINY_S = 1e-9
SATURATED_PERCENT = 100.0


def temperature_reading(chain: Chain) -> Array:
    """Temperature that the body shows, before the readout (B, R, n) [degC]."""
    response = _response(chain, chain.rate)
    step = (chain.destination_c - chain.source_c)[..., None]
    reading = chain.source_c[..., None] + step * _driven(chain, response, chain.time_s, chain.ramp_s)
    if chain.drift is not None:
        reading = reading + chain.drift[..., None] * _drifting(chain, response, chain.time_s)
    for room in chain.rooms:
        excess = room.fraction * (room.temperature_c - chain.destination_c)
        reading = reading + excess[..., None] * _let_in(chain, response, room)
    _drive(chain, reading, response, chain.time_s, lambda run, air: _off(chain, run, air.temperature_c))
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
    if chain.vapour_late_s is not None:
        chain = replace(chain, time_s=chain.time_s - chain.vapour_late_s[..., None])
    source_hpa, destination_hpa = _vapour_hpa(chain)
    rate, time, ramp_s = chain.rate, chain.time_s, chain.ramp_s
    if chain.activity_slope is not None:
        rate, time, ramp_s = _concentration_dependent(chain, chain.activity_slope, source_hpa)
    response = _response(chain, rate)
    held = source_hpa[..., None] + (destination_hpa - source_hpa)[..., None] * _driven(chain, response, time, ramp_s)
    if chain.drift is not None:
        saturated = saturation_pressure_hpa(chain.destination_c)
        held = held + (chain.drift * saturated)[..., None] * _drifting(chain, response, time)
    if chain.wet_until_s is not None:
        wet = np.maximum(chain.wet_until_s, 0.0)[..., None]
        excess = 100.0 * saturation_pressure_hpa(chain.destination_c) - destination_hpa
        held = held + excess[..., None] * (response.step(time) - response.step(time - wet))
    for room in chain.rooms:
        excess = room.fraction * (room.humidity_percent * saturation_pressure_hpa(room.temperature_c) - destination_hpa)
        held = held + excess[..., None] * _let_in(chain, response, room)
    _drive(chain, held, response, time, partial(_measured_vapour, chain))
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
    return np.asarray(_off(chain, run, air.humidity_percent) * saturated)


def _off(chain: Chain, run: int, values: Array) -> Array:
    """A measured air (B, m) as it may have been: off by its reference's error, and before its record by more."""
    trace = values + chain.air_offset[:, run, None]
    if chain.before is not None:
        trace[:, 0] += chain.before[:, run]
    return np.asarray(trace)


def _taken_up_by_activity(chain: Chain) -> Array:
    """What the film holds where it takes up by the relative humidity at its own temperature (B, R, n) [%RH].

    That drives the film as a measured trace does: straight lines between knots that lie the denser the nearer to the
    transfer, where the air jumps and the sensor's temperature begins to follow.
    """
    response, shape = _response(chain, chain.rate), np.broadcast_shapes(chain.time_s.shape, (*chain.rate.shape, 1))
    since = _knots_s(float(chain.time_s.max()))
    knots = np.concatenate([[-1.0, 0.0, 0.0], since[1:]])
    at_knots = replace(chain, time_s=np.broadcast_to(since, (*chain.time_s.shape[:2], since.size)))
    source_hpa, destination_hpa = _vapour_hpa(chain)
    begun = _begun(at_knots)
    vapour = source_hpa[..., None] + (destination_hpa - source_hpa)[..., None] * begun
    if chain.drift is not None:
        gone = np.maximum(at_knots.time_s, 0.0) / chain.channel.lasts_s[:, None]
        vapour = vapour + (chain.drift * saturation_pressure_hpa(chain.destination_c))[..., None] * gone
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

    def measured_activity(run: int, air: MeasuredAir) -> Array:
        recorded, die = _dies(chain)[run]
        own_c = _known_temperature(chain, air, run) if die is None else np.interp(air.time_s, recorded, die)
        return np.minimum(_measured_vapour(chain, run, air) / saturation_pressure_hpa(own_c), SATURATED_PERCENT)

    _drive(chain, reading, own, chain.time_s, measured_activity)
    return reading


def _knots_s(until_s: float) -> Array:
    """Times since the transfer [s], up to the first that is not before `until_s`; the same whatever else is asked."""
    last = np.log1p(max(until_s, FIRST_KNOT_S) * KNOTS_APART / FIRST_KNOT_S) / np.log1p(KNOTS_APART)
    since = FIRST_KNOT_S * np.expm1(np.arange(int(np.ceil(last)) + 1) * np.log1p(KNOTS_APART)) / KNOTS_APART
    since[0] = TINY_S  # the transfer has begun
    return np.asarray(since)


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
    count, pick, place = different((rate, *films, *lags, *chain.series))

    def own(x: Array) -> Array:
        return of_those(x, count, pick)

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
    for share, times_s in chain.lags:
        response = modes.mix(response, modes.first_orders(own(times_s)), own(share))
    for share, times_s in chain.echoes:
        response = modes.mix(response, modes.behind_each(response, own(times_s)), own(share))
    each = ((x[place] if x.ndim > 2 and x.shape[0] == pick.size else x) for x in (response.amplitude, response.rate))
    return modes.Modes(*each)


def _measured(chain: Chain) -> list[tuple[int, MeasuredAir]]:
    return [(run, air) for run, air in enumerate(chain.channel.air) if air is not None]


def _known_temperature(chain: Chain, air: MeasuredAir, run: int) -> Array:
    """Temperature of a measured air (m,); the destination's where nobody measured it."""
    return np.where(np.isfinite(air.temperature_c), air.temperature_c, chain.channel.conditions.destination_c[run])


def _drive(
    chain: Chain, out: Array, response: modes.Modes, at_s: Array, trace_of: Callable[[int, MeasuredAir], Array]
) -> None:
    """Put the responses to measured airs in their places in `out` (B, R, n), each to the trace (B, m) of its run."""
    measured, period_s = _measured(chain), chain.channel.reading_period_s
    slow = modes.slowest(response, DRIVEN_MODES) if measured else response
    for run, air in measured:
        own = modes.Modes(
            *(x[..., min(run, x.shape[-2] - 1), :] if x.ndim > 1 else x for x in (slow.amplitude, slow.rate))
        )
        if air.lag_s > 0:
            own = beside_lagging_reference(own, air.lag_s)
        trace = trace_of(run, air)
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
        return rate, chain.time_s * for_different(time_warp, chain.time_s * rate[..., None], ratio[..., None]), None
    # A ramp is a step at its middle; while it lasts the film takes up as fast as it does at first.
    early = time_warp(np.zeros(()), ratio[..., None])
    middle = 0.5 * chain.ramp_s[..., None]
    late = np.maximum(chain.time_s - middle, 0.0)
    warp = for_different(time_warp, late * rate[..., None], ratio[..., None])
    return rate, np.minimum(chain.time_s, middle) * early + late * warp, chain.ramp_s * early[..., 0]


def _driven(chain: Chain, response: modes.Modes, time: Array, ramp_s: Array | None) -> Array:
    """Response to the unit transfer."""
    if ramp_s is None:
        return _shared(_averaged(chain, modes.Modes.step), response, time)
    return _shared(_averaged(chain, modes.Modes.ramp), response, time, ramp_s)


def _drifting(chain: Chain, response: modes.Modes, time: Array) -> Array:
    """Response to air that drifts evenly from the transfer on, by one until the record ends."""
    return _shared(_averaged(chain, modes.Modes.integral), response, time) / chain.channel.lasts_s[:, None]


def _let_in(chain: Chain, response: modes.Modes, room: RoomAir) -> Array:
    """Response to a room's air that comes in with the transfer and decays from its start."""
    let_in = () if chain.ramp_s is None else (chain.ramp_s,)
    return _shared(_averaged(chain, modes.Modes.exponential), response, chain.time_s, room.time_constant_s, *let_in)


def _averaged(chain: Chain, form: Callable[..., Array]) -> Callable[..., Array]:
    """A closed form in the mean of the readings that the logger averages."""
    return partial(form, samples=chain.averaged, period_s=chain.channel.reading_period_s)


def _shared(form: Callable[..., Array], response: modes.Modes, time: Array, *arguments: Array) -> Array:
    """A closed form for all candidates; those that differ only in what it is multiplied with share one evaluation."""

    def of(amplitude: Array, rate: Array, *rest: Array) -> Array:
        return form(modes.Modes(amplitude, rate), *rest)

    return for_different(of, response.amplitude, response.rate, time, *arguments)


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
