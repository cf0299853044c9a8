"""The humidity channel of a flight: from %RH to vapour pressure, through the method, and back at the air's temperature.

What the air's temperature leaves open divides the reading and the result alike, and passes without lag.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, maximum_filter1d, uniform_filter1d

from shockrig.analysis.estimate.without_model import MAD_TO_SIGMA
from shockrig.analysis.flight.air_prior import Passing
from shockrig.analysis.flight.comparisons import Told, height_of
from shockrig.analysis.flight.doubts import airspeed_doubt
from shockrig.analysis.flight.flight_channel import (
    FlightChannel,
    FlightReadings,
    bridged,
    coarse,
    held,
    judged,
    lacking,
    own_changes,
    possible_air,
    remembered,
    slope,
    too_few,
    untouched,
    with_own_steps,
    without_layers,
)
from shockrig.analysis.flight.response import LagResponse, film_response, unsure_of_airspeed
from shockrig.analysis.flight.screen import Screened, resolution_of, screen
from shockrig.analysis.flight.smooth_channel import (
    JUMP_SIGMAS,
    KNOWN_SIGMAS,
    LONGEST_BRIDGE_S,
    Estimate,
    typical_period,
)
from shockrig.analysis.flight.stretches import MOST_SHARE, Felt, fastest, largest_share, scatter, stuck_rows
from shockrig.analysis.flight.sweep import as_lagged, forgotten
from shockrig.analysis.flight.swings import swings
from shockrig.analysis.flight.undo_readout import (
    Acting,
    Stated,
    Undone,
    acting,
    carried,
    ceiling,
    climb_m_s,
    climb_unknown,
    noise_floor,
    not_known,
    not_undone,
    propagated,
    stale,
    undone,
    uptake,
)
from shockrig.analysis.flight.undo_readout import unseen as beyond_discovered
from shockrig.analysis.flight.unread import APART_S, where_unread
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.analysis.physics.humidity import saturation_pressure_hpa, saturation_slope
from shockrig.files.flight import Flight
from shockrig.files.numbers import counted
from shockrig.files.profile import HumidityProfile
from shockrig.files.profile_data import NOISE_PERCENT
from shockrig.files.ranges import LIKELY_RANGES, RANGES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]
FilmTemperature = Callable[[Mapping[str, float], Array, Array], Array]

# Where the film did not see what the thermometer says: a temperature that moved by itself, in the sun or under ice.
#
# A film shows little of what the vapour does at once, while its relative humidity follows the air's temperature
# without lag. Let dx be what the temperature's change, over a time in which the film shows a share of at most
# `SHOWN_SHARES` of a step (or over one row), makes of the humidity, and dr what its reading did beside its drift. If
# the air went as the temperature says, the film's vapour dr + dx is that share of what the air's did, which may be
# anything of dx's size (Cauchy); if the thermometer alone moved, dr is noise (Gauss). Changes that share readings are
# judged together. What is slower than the first of these times is looked for in what the first leaves, over the second.

SHOWN_SHARES = 1 / 3, 2 / 3  # of a step of the vapour: a change that the film did not lag would need so much more of it
MOST_ROWS = 256
FEWEST_WINDOWS = 20
LEAST_TIMES = 2.0  # the usual change: smaller ones matter little, and nobody can tell whose they are
MISSHAPEN_SHARE = 0.1  # of what the corrected temperature moves, that it is off by on the way
BELIEVED_LOG_ODDS = 3.0  # of log-odds: one in twenty
FORGOTTEN_LAGS = 50.0  # of the film
ENDS_NOISE = np.sqrt(5.0)  # of white noise, of a change less half of those before and after
THIRDS_NOISE = 6.0 / np.sqrt(np.pi)  # and what three of them go in all
LEAST_PERCENT = 1.0  # drier air says nothing


def unseen(
    time_s: Array,
    humidity: Array,
    temperature_c: Array,
    sigma_k: Array,
    believed: Mask,
    response: LagResponse,
    noise_percent: float,
    shown: float = SHOWN_SHARES[0],
) -> Array:
    """How far (n,) the temperature has moved by itself since the first row, in K, 0 where the film agrees with it.

    Parameters
    ----------
    humidity, temperature_c : ndarray (n,)
        Readings of the film [%RH] and the corrected temperature of the air.
    sigma_k : ndarray (n,)
        Its standard uncertainty: of a thermometer in a burst of noise a film says nothing.
    believed : ndarray (n,)
        Rows where both were read.
    response : Response
        Of the film, a row for each.
    noise_percent : float
        Of its readings.
    shown : float
        Share of a step that the film shows at most, over the time that is looked at.

    """
    nothing = np.zeros(temperature_c.shape)
    period = typical_period(time_s)
    rows = _rows(response, period, shown)
    first = np.arange(rows, time_s.size - 2 * rows)
    if not rows or first.size < FEWEST_WINDOWS:
        return nothing
    ends = first[:, None] + rows * np.array([-1, 0, 1, 2])
    lasting = time_s[ends[:, -1]] - time_s[ends[:, 0]]
    known = believed[ends].all(axis=1) & (lasting < 1.5 * 3 * rows * period)
    if np.count_nonzero(known) < FEWEST_WINDOWS:
        return nothing
    first, ends = first[known], ends[known]
    level = np.maximum(humidity[first], LEAST_PERCENT)
    log_saturation = np.log(saturation_pressure_hpa(temperature_c))
    size = level * np.abs(np.diff(log_saturation[ends], axis=1)).sum(axis=1)
    thirds_s = np.diff(time_s[ends], axis=1)
    moved, read = level * _beside(log_saturation, ends, thirds_s), _beside(humidity, ends, thirds_s)
    per_k = np.log(saturation_pressure_hpa(temperature_c[first] + 1.0)) - log_saturation[first]
    unsure = level * per_k * np.median(sigma_k[ends], axis=1)
    share = max(shown, largest_share(response, rows * period))
    own = _own(first, moved, read, size, unsure, ENDS_NOISE * noise_percent, rows, share)
    if not own.any():
        return nothing
    within = np.zeros(time_s.shape, dtype=bool)
    within[first[own] + rows // 2] = True
    within = maximum_filter1d(within, rows + 1)  # a window is judged as a whole
    return np.cumsum(np.concatenate([[0.0], np.diff(temperature_c) * within[:-1]]))


def _forgotten(alone_k: Array, response: LagResponse, period: float) -> Array:
    """Moves (n,) of the temperature's own, forgotten so slowly that a film hardly lags behind it.

    They are summed, so a constant is left open behind each, which divides reading and result alike; what many leave
    open would add up.
    """
    return forgotten(np.diff(alone_k, prepend=0.0), FORGOTTEN_LAGS * response.slowest_s, period)


def _lagged_drift(used_c: Array, believed_c: Array, response: LagResponse, period: float) -> Array:
    """What is made (n,) of the vapour, in its logarithm, by a temperature that is `used` (n,) and forgets what the
    `believed` one does not: where the one drifts from the other, the vapour seems to, and its lag is undone too."""
    if np.array_equal(used_c, believed_c):
        return np.zeros(used_c.shape)
    drift = np.log(saturation_pressure_hpa(used_c) / saturation_pressure_hpa(believed_c))
    return drift - as_lagged(drift, response, period)


def _rows(response: LagResponse, period: float, shown: float) -> int:
    """The most rows within which the film shows no more than the share `shown` of a step, or one in which it shows no
    more than a lag does (`MOST_SHARE`); 0 where it shows more."""
    response = fastest(response)
    rows, more = int(largest_share(response, period) <= MOST_SHARE), 1
    while more <= MOST_ROWS and largest_share(response, more * period) <= shown:
        rows, more = more, more + max(more // 4, 1)
    return rows


def _beside(values: Array, ends: NDArray[np.int64], thirds_s: Array) -> Array:
    """Changes over the middle third of each window, beside what the thirds before and after would make of as long a
    time; they last `thirds_s` (w, 3)."""
    before, middle, after = np.diff(values[ends], axis=1).T
    return np.asarray(middle - (before + after) * thirds_s[:, 1] / (thirds_s[:, 0] + thirds_s[:, 2]))


def _own(
    first: NDArray[np.int64],
    moved: Array,
    read: Array,
    size: Array,
    unsure: Array,
    least: float,
    rows: int,
    share: float,
) -> Mask:
    """Changes (w,) of the temperature, in %RH, that are likelier its own than the air's.

    They begin at row `first` and go `size` to and fro, `unsure` by so much; `least` is a reading's noise in one, and
    the film shows `share` of a step within it.
    """
    usual = np.hypot(max(_spread(moved), least), MISSHAPEN_SHARE * size)
    unsure = THIRDS_NOISE * np.maximum(unsure - np.median(unsure), 0.0)  # what is usual is in what is usually moved
    large = np.flatnonzero((np.abs(moved) > LEAST_TIMES * usual) & (size > LEAST_TIMES * unsure))
    own = np.zeros(moved.shape, dtype=bool)
    if not large.size:
        return own
    vapour = read + moved
    by_itself = np.hypot(max(_spread(read), least), MISSHAPEN_SHARE * size)[large]
    of_air = np.hypot(max(_spread(vapour), least), share * size)[large]
    odds = np.log1p((vapour[large] / of_air) ** 2) + np.log(np.pi * of_air)
    odds -= 0.5 * (read[large] / by_itself) ** 2 + np.log(np.sqrt(2.0 * np.pi) * by_itself)
    # windows that share readings say the same thing
    before, after = (np.searchsorted(first[large], first[large] + beside) for beside in (-2 * rows, 2 * rows + 1))
    total = np.concatenate([[0.0], np.cumsum(odds)])
    own[large] = total[after] - total[before] > BELIEVED_LOG_ODDS * rows
    return own


def _spread(values: Array) -> float:
    """Standard deviation of most of the values."""
    return MAD_TO_SIGMA * float(np.median(np.abs(values - np.median(values))))


REFERENCE_C = 20.0  # vapour is carried as relative humidity at this temperature
MOST_COUPLING = 5.0  # vapour and temperature are not told to go together more steeply than this
LEAST_SHARE = 0.2  # of the uncertainty that stays, however vapour and temperature go together
AIR_PERCENT = RANGES["humidity_set_percent"]
SELDOM_FACTOR = 5.0  # times the usual between two readings of temperature
VAGUE_TIMES = 5.0  # times the usual, that the air's temperature leaves open of a reading's vapour
VAGUE_NOISES = 10.0  # and so many times its noise
SMOOTHED_S = 1.0
LEAST_PER_K = 1e-6  # %RH, that a reading goes by with the temperature where there is vapour


def correct_humidity(
    flight: Flight,
    part: HumidityProfile | None,
    body: str,
    stream: Stream,
    bead: FlightChannel,
    solve: Callable[[FlightReadings, float | None], Estimate],
    cutoff_hz: float | None,
    given: float | None,
    notes: list[str],
    told: Told | None = None,
) -> FlightChannel:
    """The humidity channel.

    `bead` is the temperature's, corrected: of the air around both sensors, with what the carrier adds to it. `given` is
    a noise floor other than the part's, `told` what the flight says of the film's time scale.
    """
    raw, time_s = flight.humidity_percent, flight.time_s
    effects = acting(part.effects, "humidity", part.discovered) if part else ()
    noise = _noise(part, effects, given)
    air = bridged(time_s, bead.value)
    if air is not None:
        # an inversion that failed may give any temperature; near absolute zero there is no vapour to divide by
        air = possible_air(air)
    respond = None
    if part is not None and air is not None:
        usual = np.median(air, keepdims=True)
        unsure = unsure_of_airspeed(lambda at: film_response(part, usual, at, body), stream, airspeed_doubt(flight))

        def respond(at_c: Array, part: HumidityProfile = part, unsure: float = unsure) -> LagResponse:
            return film_response(part, at_c, stream, body).slower(0.0, unsure)

    response = None if air is None or respond is None else respond(air)
    screened = _screened(flight, effects, noise, air, response, bead)
    if part is None or too_few(screened):
        why = lacking(part, "humidity", raw, RANGES["humidity_reading_percent"])
        return untouched("humidity", raw, screened, why, notes)
    climb = climb_m_s(flight)
    notes.extend(not_undone(part.effects, "humidity", part.discovered, *[climb_unknown] * (climb is None)))
    if air is None or respond is None or response is None:
        return untouched("humidity", raw, screened, "no temperature of the air in the log", notes)
    film = FilmInAir(part, effects, noise, air, screened, response, respond)
    channel = _through_vapour(flight, film, stream, bead, solve, cutoff_hz, told, notes)
    return replace(channel, carried=carried(effects, climb, flight.airspeed_m_s))


@dataclass(frozen=True)
class FilmInAir:
    """A film in a flight: its part of the profile, its effects, the `noise` of its readings and how they were
    `screened`, its `response` at the temperature `air_c` (n,) that it is in, and how it would `respond` at another."""

    part: HumidityProfile
    effects: Sequence[Acting]
    noise: float
    air_c: Array
    screened: Screened
    response: LagResponse
    respond: Callable[[Array], LagResponse]


def _through_vapour(
    flight: Flight,
    film: FilmInAir,
    stream: Stream,
    bead: FlightChannel,
    solve: Callable[[FlightReadings, float | None], Estimate],
    cutoff_hz: float | None,
    told: Told | None,
    notes: list[str],
) -> FlightChannel:
    """The air's humidity: vapour from the readings, the air's vapour from that, and back at the air's temperature."""
    raw, time_s, air, screened = flight.humidity_percent, flight.time_s, film.air_c, film.screened
    response, said = film.response, len(notes)
    sigma = bridged(time_s, bead.uncertainty)
    sigma = np.zeros(raw.shape) if sigma is None else sigma
    activity, unsure_activity = uptake(film.effects)
    die, unsure_film_k = _own_temperature(flight, film.effects, air, bead, notes)
    alike = die is None and activity == 0.0  # film and air have one temperature, which is in both of its humidities
    own_air = bridged(time_s, flight.die_temperature_c)
    at_sensor = replace(stream, temperature_c=air if own_air is None else own_air)
    plain = undone(film.effects, raw, at_sensor, film.part.film_thickness_m, typical_period(time_s))
    alone, most_k, drift = np.zeros(raw.shape), 0.0, np.zeros(raw.shape)
    if alike:
        alone, most_k = _alone(time_s, plain, sigma, bead, film)
        moved = alone, _forgotten(alone, response, typical_period(time_s))
        believed, air = (possible_air(air - own) for own in moved)
        drift = _lagged_drift(air, believed, response, typical_period(time_s))
    # what a temperature is off by for as long as it stays divides vapour before and behind the lag alike
    moving = np.sqrt(np.maximum(sigma**2 - np.square(bead.staying), 0.0))
    # a late reading is of the air that was; the die's temperature comes from the same chip and is as late
    now, air, error = air, *(_earlier(time_s, values, plain.delay_s) for values in (air, moving))
    if bead.carried is not None:
        now = now - bead.carried.value
    own = air if die is None else die
    # vapour pressure as relative humidity at a fixed temperature: what diffuses, in a unit that reads like %RH; what
    # is taken up by activity is the reading itself
    own_es = saturation_pressure_hpa(own)
    held_es = own_es**activity * saturation_pressure_hpa(REFERENCE_C) ** (1.0 - activity)
    to_vapour, from_vapour = own_es / held_es, held_es / saturation_pressure_hpa(now) * np.exp(-drift)
    # the gain of a film that changed: the air's vapour runs on where its readings jump
    change = own_changes(raw, screened, bead.screened, LEAST_PERCENT)
    if change is not None:
        to_vapour, from_vapour = to_vapour / change.factor, from_vapour * change.factor
    if plain.delay_s:
        response = film.respond(air)
    if told is not None:
        response = response.slower(told.slower, told.error)
    readings = _of_vapour(time_s, film, plain, to_vapour, response, bead)
    doubt = _of_temperature(readings, air, error, bead) if alike else TemperatureDoubt(raw.shape)
    readings = replace(readings, passing=doubt.passing, usable=doubt.usable(screened.usable))
    found = solve(readings, cutoff_hz)
    if (more := with_own_steps(screened, found, from_vapour * plain.gain)) is not None:
        del notes[said:]
        return _through_vapour(flight, replace(film, screened=more), stream, bead, solve, cutoff_hz, told, notes)
    if alike:
        readings, found = where_unread(readings, air, error, found, lambda rest: solve(rest, cutoff_hz))
    found = _as_the_film(found, readings.reading, doubt.vague & screened.usable & ~screened.loud)
    outside = ~film.part.covers(film.air_c) | beyond_discovered(film.part.discovered, stream.airflow_m_s, film.air_c)
    channel = judged(readings, found, plain, screened, outside, raw, from_vapour, notes, AIR_PERCENT.high)
    known = remembered(readings)
    broken = _unseen_breaks(time_s, found, film.air_c, doubt.unsure, bead, known) if alike else np.zeros(raw.shape)
    if (height := height_of(flight)) is not None:
        broken = without_layers(broken, height)
    left_open = doubt.left_open * from_vapour
    channel = held(channel, readings, raw, from_vapour, notes, AIR_PERCENT, left_open, broken)
    channel = _as_read(channel, raw, doubt.unread & (screened.usable | screened.repeated) & ~channel.raw, notes)
    apart = die is not None or found.cutoff_hz is not None
    of_air = _of_the_airs_temperature(channel, time_s, found.air, now, sigma) if apart else channel.uncertainty
    moving_k = response.slow_s * np.abs(slope(time_s, own))
    parts = [unsure_film_k, unsure_activity * moving_k]
    parts += [bead.carried.uncertainty] if bead.carried is not None else []
    channel = _in_all(channel, of_air, not_known(film.effects), now, np.sqrt(sum(np.square(part) for part in parts)))
    return replace(channel, temperature_alone=alone, most_alone_k=most_k, changed=change)


def _of_vapour(
    time_s: Array, film: FilmInAir, plain: Undone, to_vapour: Array, response: LagResponse, bead: FlightChannel
) -> FlightReadings:
    """The film's readings in the unit of vapour, of which each unit of theirs is `to_vapour` (n,)."""
    screened, per_reading = film.screened, to_vapour / plain.gain
    noise = np.hypot(film.noise * screened.louder, screened.resolution / np.sqrt(12))
    return FlightReadings(
        "humidity",
        time_s,
        plain.reading * to_vapour,
        screened.usable,
        response,
        (noise * per_reading) ** 2,
        plain.delay_s,
        rounding=coarse(screened.resolution, film.noise, per_reading),
        jumped_s=None if bead.jumps_s is None else np.stack([bead.jumps_s, bead.jumps_s], axis=1),
        loud=screened.loud,
        stepped=np.broadcast_to(screened.own_steps != 0.0, screened.usable.shape),
    )


def _noise(part: HumidityProfile | None, effects: Sequence[Acting], given: float | None) -> float:
    """Noise of single readings, with what the logger adds: as `given`, else the part's, else a typical film's [%RH]."""
    if part is None:
        return given or NOISE_PERCENT
    own = NOISE_PERCENT if part.noise_percent is None else part.noise_percent
    return noise_floor(effects, own if given is None else given)


def _screened(
    flight: Flight,
    effects: Sequence[Acting],
    noise: float,
    air: Array | None,
    response: LagResponse | None,
    bead: FlightChannel,
) -> Screened:
    """The film's readings judged; what lags is their vapour at the `air`'s temperature, where that was read."""
    raw, time_s = flight.humidity_percent, flight.time_s
    sigma = bridged(time_s, bead.uncertainty)
    period = typical_period(time_s)
    return screen(
        time_s,
        raw,
        RANGES["humidity_reading_percent"],
        noise,
        limit=ceiling(effects),
        stale=stale(effects, time_s, raw, period),
        share=1.0 if response is None else largest_share(response, period),
        swing=LIKELY_RANGES["swing_percent"].high,
        lagging=None if air is None else raw * saturation_pressure_hpa(air) / saturation_pressure_hpa(REFERENCE_C),
        known=~_unread(bead, time_s),
        unsure=None if air is None or sigma is None else saturation_slope(air) * sigma,
    )


def _unread(bead: FlightChannel, time_s: Array) -> Mask:
    """Rows (n,) in which the temperature was not read for long: a thermometer that is read more seldom than the
    hygrometer is one all the same."""
    if not bead.screened.usable.any():
        return np.ones(time_s.shape, dtype=bool)
    longest_s = max(APART_S, SELDOM_FACTOR * typical_period(time_s[bead.screened.usable]))
    return _long(~bead.screened.usable, time_s, longest_s)


def _alone(time_s: Array, plain: Undone, sigma: Array, bead: FlightChannel, film: FilmInAir) -> tuple[Array, float]:
    """How far (n,) the temperature has moved by itself, in K, and by how much in the largest of these moves; of a burst
    of noise neither sensor says anything, nor does a film in air that is colder than its profile reaches: by how much
    slower it is there nobody knows."""
    screened, response = film.screened, film.response
    believed = screened.usable & bead.screened.usable & ~(screened.loud | bead.screened.loud)
    believed &= film.air_c >= film.part.temperature_range_c[0]
    own_noise = float(np.hypot(film.noise, screened.resolution / np.sqrt(12)) / np.median(plain.gain))
    then = _earlier(time_s, film.air_c, plain.delay_s)
    alone, most_k = np.zeros(then.shape), 0.0
    for shown in SHOWN_SHARES:
        air = possible_air(then - alone)
        found = unseen(time_s, plain.reading, air, sigma, believed, response, own_noise, shown)
        alone, most_k = alone + found, max(most_k, _largest_move(found))
    if believed.any():
        read = np.interp(time_s, time_s[believed], np.maximum(plain.reading[believed], LEAST_PERCENT))
        found = swings(read, possible_air(then - alone), believed, typical_period(time_s), own_noise)
        alone, most_k = alone + found, max(most_k, float(found.max()))
    return _earlier(time_s, alone, -plain.delay_s), most_k


def _largest_move(values: Array) -> float:
    """The most that values (n,) go in one stretch between rows in which they stand."""
    stands = np.flatnonzero(np.diff(values) == 0.0)
    at = values[np.concatenate([[0], stands, [values.size - 1]])]
    return float(np.abs(np.diff(at)).max())


class TemperatureDoubt:
    """What the air's temperature leaves open of the vapour, (n,) each: `passing`, which divides the reading and the
    result alike; rows that are `vague` for a while, and those `unread`, where the temperature is not known at all;
    `left_open` where it is vague for long, in the unit of the vapour."""

    def __init__(
        self,
        shape: tuple[int, ...],
        passing: Passing | None = None,
        unread: Mask | None = None,
        vague: Mask | None = None,
        left_open: Array | None = None,
    ) -> None:
        nothing = np.zeros(shape, dtype=bool)
        self.passing = passing
        self.unread = nothing if unread is None else unread
        self.vague = nothing if vague is None else vague
        self.left_open = np.zeros(shape) if left_open is None else left_open

    @property
    def unsure(self) -> Mask:
        """Rows (n,) whose temperature is vague, for a while or for long."""
        return self.vague | (self.left_open > 0.0)

    def usable(self, usable: Mask) -> Mask:
        """Of the rows (n,) that are usable those of which the vapour is known, where these are the most."""
        known = usable & ~self.vague
        return known if np.count_nonzero(known) > 0.5 * np.count_nonzero(usable) else usable


def _of_temperature(readings: FlightReadings, air: Array, error: Array, bead: FlightChannel) -> TemperatureDoubt:
    """What the `air`'s temperature (n,), unsure by `error`, leaves open of the vapour that was read."""
    time_s, usable = readings.time_s, readings.usable
    level = np.interp(time_s, time_s[usable], readings.reading[usable])
    percent_per_k = level * saturation_slope(air)
    error = np.hypot(error, _misplaced(time_s, air, bead.screened.usable))
    coupling = _coupling(time_s, level, air, error, percent_per_k, readings.response)
    passing = Passing(percent_per_k * error, bead.resolved_rate, coupling)
    # a reading whose temperature is not known is none of vapour
    unread = _unread(bead, time_s)
    noise = np.sqrt(readings.noise_variance)
    most = noise * np.maximum(VAGUE_TIMES * np.median(passing.sigma / noise), VAGUE_NOISES)
    vague = passing.sigma > most
    # over a while, readings of vapour that is known badly say more than none, if it is known better than it moves
    lasting = _long(vague, time_s, APART_S)
    left_open = np.where(lasting, passing.sigma, 0.0)
    moves = float(np.std(readings.reading[usable & ~vague])) if (usable & ~vague).any() else np.inf
    unread = unread | (lasting & (passing.sigma > moves))
    return TemperatureDoubt(air.shape, passing, unread, unread | (vague & ~lasting), left_open)


def _unseen_breaks(
    time_s: Array, found: Estimate, air: Array, unsure: Mask, bead: FlightChannel, known: tuple[Index, Index]
) -> Array:
    """1 or -1 in the rows (n,) at which the vapour jumps or bends up or down and the temperature of the `air`, which
    the same eddies carry, does no more than it mostly does: the film may have done that by itself. Nobody can tell
    where the temperature is `unsure` (n,).

    What comes on and goes off again, while the film remembers it (rows `known` at each, first and last), is one cause:
    as sure as both together, if the other is no chance among so many rows.
    """
    broken = np.zeros(time_s.shape)
    period = typical_period(time_s)
    around, at_once = (max(int(round(lasting / period)), 1) for lasting in (APART_S, SMOOTHED_S))
    rows, sigmas = np.searchsorted(time_s, found.breaks[:, 0]), found.breaks[:, 1]
    told = (rows >= around) & (rows < time_s.size - around)
    rows, sigmas = rows[told], sigmas[told]
    first, last = (one[rows] for one in known)
    told = np.abs(sigmas) > np.sqrt(2.0 * np.log(np.maximum(np.maximum(last - rows, rows - first), 1)))
    rows, sigmas = rows[told], sigmas[told]
    # where the thermometer is not sure, or saw the air jump, the film is no other cause
    told = ~maximum_filter1d(unsure, 2 * around + 1)[rows]
    rows, sigmas = rows[told], sigmas[told]
    if not rows.size or not bead.screened.usable.any():
        return broken
    # a layer that is passed steadily is no jump of its temperature, nor one of its vapour
    bent = _off_a_line(air, around)
    silent = bent[rows] < KNOWN_SIGMAS * np.median(bent[around:-around])
    at_s, size, up = time_s[rows], np.abs(sigmas), sigmas > 0.0
    jumped_s = np.zeros(0) if bead.jumps_s is None else bead.jumps_s
    begin, end = _those_near(jumped_s, at_s, APART_S)
    itself = silent | (begin == end)
    first, last = (one[rows] for one in known)
    ends = np.stack([np.searchsorted(rows, first), np.searchsorted(rows, last, side="right")], axis=1).ravel()

    def opposite(some: Mask) -> Array:
        # the largest of some that go the other way, of those that the film remembers
        of_both = (np.where(some & (up != positive), size, 0.0) for positive in (True, False))
        return np.where(up, *(np.maximum.reduceat(np.append(one, 0.0), ends)[::2] for one in of_both))

    other = np.where(silent, opposite(itself), np.where(itself, opposite(silent), 0.0))
    both = np.where(other > 0.0, np.hypot(size, other), 0.0)
    alone = np.maximum(both, np.where(silent, size, 0.0)) >= JUMP_SIGMAS
    rows, way = rows[alone], np.sign(sigmas[alone])
    # what the film did by itself it shows at once
    broken[rows] = np.where(way * (found.clean[rows + at_once] - found.clean[rows]) > 0.0, way, 0.0)
    return broken


def _those_near(times: Array, at: Array, apart: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The first of some times (n,) within so much of each of others (m,), and the first behind: (m,) both."""
    return np.searchsorted(times, at - apart), np.searchsorted(times, at + apart, side="right")


def _off_a_line(values: Array, around: int) -> Array:
    """How far (n,) values are off a straight line through as many on either side, rms."""
    values, width = values - values.mean(), 2 * around + 1
    square, mean = (uniform_filter1d(v, width, mode="nearest") for v in (values**2, values))
    along = np.convolve(np.pad(values, around, mode="edge"), np.arange(around, -around - 1.0, -1.0), mode="valid")
    return np.asarray(np.sqrt(np.maximum(square - mean**2 - 3.0 * (along / width) ** 2 / (around * (around + 1)), 0.0)))


def _as_the_film(found: Estimate, vapour: Array, rows: Mask) -> Estimate:
    """The same where, in some rows, the film's humidity is its reading, however unsure the temperature, and the air's
    vapour differs from the film's by what the readings around say."""
    if not rows.any():
        return found
    ahead = np.divide(found.air, found.clean, out=np.ones(vapour.shape), where=found.clean > 0.0)
    air = np.where(rows, vapour * ahead, found.air)
    return replace(found, air=air, clean=np.where(rows, vapour, found.clean))


def _of_the_airs_temperature(channel: FlightChannel, time_s: Array, vapour: Array, now: Array, sigma: Array) -> Array:
    """Uncertainty (n,) with that of the air's temperature, which went into the vapour by another way or not at all."""
    own, wrong = channel.uncertainty, channel.value * saturation_slope(now) * sigma
    together = _correlation(time_s, vapour, now)
    total = own**2 + wrong**2 - 2 * together * own * wrong
    return np.where(channel.raw, own, np.sqrt(np.maximum(total, (LEAST_SHARE * own) ** 2)))


def _in_all(channel: FlightChannel, uncertainty: Array, left: float, now: Array, unsure_k: Array) -> FlightChannel:
    """The channel within what air can have, with what is `left` in the readings, and what is not known of the two
    temperatures and of what the film holds while its temperature moves (`unsure_k`)."""
    channel = replace(channel, uncertainty=uncertainty).within(AIR_PERCENT)
    of_temperature = np.where(channel.raw, 0.0, channel.value * saturation_slope(now) * unsure_k)
    wider = (np.sqrt(s**2 + left**2 + of_temperature**2) for s in (channel.uncertainty, channel.common))
    uncertainty, common = wider
    return replace(channel, uncertainty=uncertainty, common=common)


def felt_by_film(flight: Flight, part: HumidityProfile | None) -> Felt | None:
    """What the film felt of the air's temperature, in K: its relative humidity follows that at once, and its vapour
    later. None where its own temperature is another, or late."""
    effects = acting(part.effects, "humidity", part.discovered) if part else ()
    apart = any(
        one.meaning.film_c is not None or one.meaning.at_die or one.meaning.delay_s is not None for one in effects
    )
    raw, air = flight.humidity_percent, bridged(flight.time_s, flight.temperature_c)
    if part is None or air is None or apart or uptake(effects)[0] > 0.0:
        return None
    wet = np.where((raw > LEAST_PERCENT) & (raw <= RANGES["humidity_reading_percent"].high), raw, np.nan)
    if not np.isfinite(wet).any():
        return None
    possible = RANGES["temperature_c"]
    usual = float(np.clip(np.median(air), possible.low, possible.high))
    per_k = float(saturation_slope(np.array(usual)))
    noise, resolution = _noise(part, effects, None), resolution_of(wet[np.isfinite(wet)])
    # a film that is stuck feels nothing, and a jump where it goes on is none of the air's
    read = np.flatnonzero(np.isfinite(wet))
    wet[read[stuck_rows(wet[read], resolution, noise, scatter(wet[read]))]] = np.nan
    if not np.isfinite(wet).any():
        return None
    level = float(np.nanmedian(wet)) * per_k
    return Felt(-np.log(wet) / per_k, noise / level, resolution / level)


def _earlier(time_s: Array, values: Array, delay_s: float) -> Array:
    """Values (n,) as they were `delay_s` before each row."""
    return np.interp(time_s - delay_s, time_s, values) if delay_s else values


def _long(mask: NDArray[np.bool_], time_s: Array, longest_s: float) -> NDArray[np.bool_]:
    """Rows (n,) in stretches of `mask` that last longer; a break of the flight is no part of any."""
    broken = np.diff(time_s, prepend=time_s[0]) > LONGEST_BRIDGE_S
    run = np.cumsum(np.diff(mask, prepend=False) | broken)
    starts = np.flatnonzero(np.diff(run, prepend=-1))
    lasting = time_s[np.append(starts[1:], mask.size) - 1] - time_s[starts]
    return np.asarray(mask & (lasting[run - run[0]] > longest_s))


def _as_read(channel: FlightChannel, raw: Array, rows: NDArray[np.bool_], notes: list[str]) -> FlightChannel:
    """The channel with some rows as they were read: what the correction would have changed is uncertainty."""
    rows = rows & np.isfinite(channel.value)
    if not rows.any():
        return channel
    notes.append(
        f"humidity: {counted(int(np.count_nonzero(rows)), 'row')} without a reading of the temperature around, given "
        "as read"
    )
    changed = np.where(rows, raw - channel.value, 0.0)
    wider = (np.hypot(sigma, changed) for sigma in (channel.uncertainty, channel.common))
    uncertainty, common = wider
    value = np.where(rows, raw, channel.value)
    return replace(channel, value=value, uncertainty=uncertainty, common=common, raw=channel.raw | rows)


def _misplaced(time_s: Array, temperature_c: Array, read: NDArray[np.bool_]) -> Array:
    """How far off (n,) a temperature is whose corners and jumps are misplaced by half a sample; 0 on straight lines.

    Where it was not `read` (n,), they may lie anywhere in the gap.
    """
    lasting = np.maximum(np.diff(time_s), np.finfo(float).tiny)
    pace = np.diff(temperature_c) / lasting
    # of the line between the readings before and behind, as far as each is from it
    off = np.zeros(time_s.shape)
    off[1:-1] = np.abs(np.diff(pace)) * lasting[:-1] * lasting[1:] / (lasting[:-1] + lasting[1:])
    off[[0, -1]] = 0.5 * np.abs(np.diff(temperature_c)[[0, -1]])
    gap = binary_dilation(~read)
    if not gap.any():
        return off
    run = np.cumsum(np.diff(gap, prepend=False) & gap)[gap] - 1
    edges = np.flatnonzero(np.diff(gap.astype(int), prepend=0, append=0))
    first, last = edges[::2], edges[1::2] - 1
    # half of what it went over the gap and neither of the slopes beside it explains
    pace = np.pad(pace, 1)
    beside = np.stack([pace[first], pace[last + 1], np.zeros(first.size)]) * (time_s[last] - time_s[first])
    across = temperature_c[last] - temperature_c[first]
    beyond = np.maximum(across - beside.max(axis=0), beside.min(axis=0) - across)
    most = np.maximum(0.5 * beyond, 0.0)
    np.maximum.at(most, run, off[gap])
    off[gap] = most[run]
    return off


def _own_temperature(
    flight: Flight, effects: Sequence[Acting], air: Array, bead: FlightChannel, notes: list[str]
) -> tuple[Array | None, Array]:
    """Temperature that the sensor turns vapour into humidity at, where it is its own and is known, else None; and its
    standard uncertainty."""
    sure = np.zeros(air.shape)
    read = bridged(flight.time_s, np.where(bead.raw, bead.value, bead.value - bead.lag))
    for one in effects:
        if (film_c := one.meaning.film_c) is not None and read is not None:

            def along(values: Stated, film_c: FilmTemperature = film_c, read: Array = read) -> Array:
                return film_c(values, flight.time_s, read)

            return along(one.values), propagated(one, along)
    asking = [one for one in effects if one.meaning.at_die]
    if not asking:
        return None, sure
    die = bridged(flight.time_s, flight.die_temperature_c)
    if die is None:
        notes.append(
            f"humidity: {', '.join(one.values.effect for one in asking)} is in the profile and the log has no "
            "temperature of the die; the air's is taken"
        )
        return None, sure
    shares = [1.0 if one.meaning.die_share is None else one.meaning.die_share(one.values) for one in asking]
    return air + max(shares) * (die - air), sure


def _coupling(
    time_s: Array, vapour: Array, temperature: Array, sigma: Array, percent_per_k: Array, response: LagResponse
) -> float:
    """Vapour that goes with each unit of Passing: minus its slope against temperature over that of the conversion.

    Both over some seconds and as the film sees them, so the temperature is lagged like the vapour was. Slope by signs
    and medians, so that one front does not speak for the whole flight, of vapour in units of the conversion, so that
    neither does what is warm, and less of it where chance or the temperature's error explain it.
    """
    period = typical_period(time_s)
    lag = max(int(round(APART_S / period)), 1)
    if time_s.size < 20 * lag:
        return 0.0
    lagged = as_lagged(temperature, response, period)
    smooth = max(int(round(SMOOTHED_S / period)), 1)
    a, b = (uniform_filter1d(v, smooth) for v in (vapour, lagged))
    told = percent_per_k[lag:] > LEAST_PER_K  # in no vapour nothing does
    if np.count_nonzero(told) < lag:
        return 0.0
    a, b = (a[lag:] - a[:-lag])[told] / percent_per_k[lag:][told], (b[lag:] - b[:-lag])[told]
    a, b = a - np.median(a), b - np.median(b)
    width_a, width_b = float(np.median(np.abs(a))), float(np.median(np.abs(b)))
    if width_a == 0 or width_b == 0:
        return 0.0
    agree = float(np.mean(np.sign(a) * np.sign(b)))
    chance = lag / time_s.size  # variance of the mean sign, one independent pair every `lag` samples
    agree *= max(1.0 - chance / max(agree**2, chance), 0.0)
    error = 0.5 * float(np.median(sigma)) / (MAD_TO_SIGMA * width_b)
    slope = np.sin(0.5 * np.pi * agree) * width_a / width_b * max(1.0 - error**2, 0.0)
    return float(np.clip(-slope, -MOST_COUPLING, MOST_COUPLING))


def _correlation(time_s: Array, vapour: Array, temperature: Array) -> float:
    """Correlation of the air's vapour with its temperature on the shortest scale that both are resolved on."""
    lag = max(int(round(APART_S / typical_period(time_s))), 1)
    if time_s.size < 20 * lag:
        return 0.0
    a, b = vapour[lag:] - vapour[:-lag], temperature[lag:] - temperature[:-lag]
    # by signs (quadrant correlation), so that one front does not speak for the whole flight
    agree = np.mean(np.sign(a - np.median(a)) * np.sign(b - np.median(b)))
    return float(np.sin(0.5 * np.pi * agree))
