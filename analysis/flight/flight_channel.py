"""One channel of a flight: what a method is given, what comes out, and whether the correction is worth giving.

The uncertainty of the sensor's time scale and of its readout is added to the method's own; where nothing is won, or D
is not known, the reading itself is given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from heapq import heapify, heappop, heappush

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

from shockrig.analysis.flight.air_prior import Passing
from shockrig.analysis.flight.response import LagResponse
from shockrig.analysis.flight.screen import Screened
from shockrig.analysis.flight.smooth_channel import Estimate, typical_period
from shockrig.analysis.flight.stretches import largest_share
from shockrig.analysis.flight.sweep import COARSE_IN_NOISE, lags_behind
from shockrig.analysis.flight.undo_readout import Carried, Undone
from shockrig.files.numbers import counted, moment
from shockrig.files.profile import HumidityProfile, TemperatureProfile
from shockrig.files.ranges import RANGES, Range

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]
LONGEST_FILL_S = 5.0  # farther from a usable sample no value is given
LONGEST_REPEAT_S = 30.0  # or so far, where the sensor is read and its reading is repeated
IDLE_LAG_SIGMAS = 0.3  # a lag smaller than this share of the noise is not worth undoing
LEAST_SAMPLES = 16
MOST_MOVES = 3  # that are said one by one: of readings that are not of such a sensor there are dozens
MOST_NOISES_OFF, ROWS_TOGETHER = 6.0, 5  # times the noise, that the median of so many readings may be off


@dataclass(frozen=True)
class FlightReadings:
    """One channel as the methods see it: rows in order.

    Attributes
    ----------
    channel : str
    time_s, reading : ndarray (n,)
    usable : ndarray (n,)
        Which readings count.
    response : Response
        With a row for each reading.
    noise_variance : ndarray (n,)
        Expected of each reading.
    delay_s : float
        How late the readings are.
    passing : Passing or None
        What reaches reading and air alike.
    rounding : ndarray (n,) or None
        Step of each reading, where it is coarser than the noise.
    jumped_s : ndarray (j, 2) or None
        Times between which another sensor saw the air jump.
    loud : ndarray (n,) or None
        Readings in bursts of noise.
    stepped : ndarray (n,) or None
        Rows from which on the sensor is known to read more or less than before.
    told : ndarray (n,) or None
        What the sensor would have read, where that is told by another; NaN elsewhere.
    logged_s : ndarray (n,) or None
        Times as the log has them, where these were put in order.
    """

    channel: str
    time_s: Array
    reading: Array
    usable: Mask
    response: LagResponse
    noise_variance: Array
    delay_s: float = 0.0
    passing: Passing | None = None
    rounding: Array | None = None
    jumped_s: Array | None = None
    loud: Mask | None = None
    stepped: Mask | None = None
    told: Array | None = None
    logged_s: Array | None = None


@dataclass(frozen=True)
class OddMove:
    """A reading that goes up (`way` 1) or down (-1) from a row on, and `why` that is odd; `until` a row the air may be
    as it was before, and `is_undone` where it comes back as oddly."""

    row: int
    until: int
    way: float
    why: str
    is_undone: bool


@dataclass(frozen=True)
class Changed:
    """A sensor that changed: the `steps` (n,) that its readings made by it, at the first row behind each, and their
    `factor` (n,) over what they were at first, of a sensor whose gain it is."""

    steps: Array
    factor: Array

    @property
    def offset(self) -> Array:
        """How far (n,) readings are from what they were at first, if that is the same everywhere."""
        return np.cumsum(self.steps)

    def leaves_open(self, value: Array) -> Array:
        """How far (n,) the air is at most from its `value` (n,), if the sensor was right at any other time."""
        off = [np.abs(self.offset - end) for end in (self.offset.min(), self.offset.max())]
        off += [np.abs(value * (end / self.factor - 1.0)) for end in (self.factor.min(), self.factor.max())]
        return np.max(off, axis=0)


def own_changes(raw: Array, screened: Screened, around: Screened, least: float | None = None) -> Changed | None:
    """How a sensor that read `raw` (n,) changed, None where it did not; if by its gain, what is below `least` says
    nothing of that. A film jumps with the air's temperature, so that has to be known (`around`) where it does; and a
    reading that is repeated catches up in a jump."""
    known = screened.usable & around.usable
    steps = np.where(known & np.roll(known, 1), screened.own_steps, 0.0)
    if not steps.any():
        return None
    factor = np.ones(raw.shape)
    if least is not None:
        jumps = np.flatnonzero(steps)
        factor[jumps] = np.maximum(raw[jumps], least) / np.maximum(raw[jumps] - steps[jumps], least)
    return Changed(steps, np.asarray(np.cumprod(factor)))


def with_own_steps(screened: Screened, found: Estimate, unit: Array) -> Screened | None:
    """The screened readings with the steps of the sensor's own that a method found, in the readings' `unit` (n,); None
    where it found none but those that are known: what is not taken out of the readings is found again."""
    if not found.own_steps.any():  # nor are there any of a method that looks for none
        return None
    more = (found.own_steps != 0.0) & (np.asarray(screened.own_steps) == 0.0)
    if not more.any():
        return None
    return replace(screened, own_steps=screened.own_steps + np.where(more, found.own_steps * unit, 0.0))


@dataclass(frozen=True)
class FlightChannel:
    """One channel corrected, arrays (n,).

    Attributes
    ----------
    name : str
    value, uncertainty : ndarray
        Air, and its standard uncertainty without that of the readout.
    common : ndarray
        The part of it that the sensor's time scale and slow shares leave, common to the flight.
    lag : ndarray
        How far the air is ahead of what the sensor shows.
    readout_uncertainty : ndarray
        What the readout's parameters leave: common to the flight as well.
    screened : Screened
    outside, raw : ndarray
        Rows beyond the profile's table, and rows where the reading itself is given.
    resolved_rate : float
        Angular frequency above which the air is not resolved [1/s].
    cutoff_hz : float or None
        Low-pass of the method, where it has one.
    jumps_s : ndarray (j,) or None
        Times at which the air jumped.
    response : Response or None
        With a row for each of them.
    temperature_alone : ndarray (n,) or None
        How far the temperature has moved by itself, which a film did not see [K].
    most_alone_k : float
        By how much in the largest of these moves.
    carried : Carried or None
        What the carrier adds to the air around the sensor, and is in `value`.
    changed : Changed or None
        How the sensor itself did.
    as_before : ndarray (n,) or None
        What `uncertainty` has in it of air that may be as it was before the readings went where no other sensor did.
    staying : ndarray (n,) or float
        What it has in it of an error that stays for as long as a rounded reading does.
    apart : ndarray (n,) or float
        How far the air is from a reading as a rule, where it varies as about each row.
    odd_moves : tuple of OddMove
        Where readings went as no air makes them, or where no other sensor did.
    """

    name: str
    value: Array
    uncertainty: Array
    common: Array
    lag: Array
    readout_uncertainty: Array
    screened: Screened
    outside: Mask
    raw: Mask
    resolved_rate: float = 30.0
    cutoff_hz: float | None = None
    jumps_s: Array | None = None
    response: LagResponse | None = None
    temperature_alone: Array | None = None
    most_alone_k: float = 0.0
    carried: Carried | None = None
    changed: Changed | None = None
    as_before: Array | None = None
    staying: Array | float = 0.0
    apart: Array | float = 1.0
    odd_moves: tuple[OddMove, ...] = ()

    @property
    def total_uncertainty(self) -> Array:
        """Standard uncertainty with everything in it."""
        return np.hypot(self.uncertainty, self.readout_uncertainty)

    @property
    def common_uncertainty(self) -> Array:
        """The part of it that is common to the flight."""
        return np.hypot(self.common, self.readout_uncertainty)

    def widened(self, relative: float) -> FlightChannel:
        """The same with a time scale that is so much less certain, relative."""
        more = np.where(self.raw, 0.0, relative * np.abs(self.lag))
        return replace(self, uncertainty=np.hypot(self.uncertainty, more), common=np.hypot(self.common, more))

    def doubted(self, by: Array | float) -> FlightChannel:
        """The same with an uncertainty `by` of every value beside what is stated, common to the flight: what is wrong
        with a sensor is so where its reading is given as well."""
        return replace(self, uncertainty=np.hypot(self.uncertainty, by), common=np.hypot(self.common, by))

    def within(self, possible: Range) -> FlightChannel:
        """The same within what air can be, whatever a method made of its readings, but for readings that are given."""
        value = np.where(self.raw, self.value, np.clip(self.value, possible.low, possible.high))
        # nothing that is possible is farther away than the farther end
        most = np.maximum(value - possible.low, possible.high - value)
        return replace(
            self,
            value=value,
            uncertainty=np.minimum(self.uncertainty, most),
            common=np.minimum(self.common, most),
        )

    def given_nowhere(self, rows: Mask) -> FlightChannel:
        """The same without a value in some rows (n,)."""
        of_value = (np.where(rows, np.nan, one) for one in (self.value, self.uncertainty, self.common))
        value, uncertainty, common = of_value
        return replace(self, value=value, uncertainty=uncertainty, common=common)

    def as_it_changed(self, logged_s: Array, notes: list[str]) -> FlightChannel:
        """The same, as unsure as the sensor itself has changed: nothing tells when it was right. When it did, and when
        its readings moved oddly, is said in the times that the log has (n,)."""
        notes.extend(
            f"{self.name}: from {moment(logged_s[one.row])} on the reading goes {'up' if one.way > 0 else 'down'} "
            f"{one.why}; until {moment(logged_s[one.until])} the air may be as it was before"
            + (", and is given as read, since it comes back like that as well" if one.is_undone else "")
            for one in self.odd_moves[:MOST_MOVES]
        )
        if others := self.odd_moves[MOST_MOVES:]:
            notes.append(
                f"{self.name}: {counted(len(others), 'more move')} like that, the last from "
                f"{moment(logged_s[others[-1].row])} on"
            )
        if self.changed is None:
            return self
        jumps, unit = np.flatnonzero(self.changed.steps), "%RH" if self.name == "humidity" else "K"
        at, size = moment(logged_s[jumps[0]]), self.changed.steps[jumps[0]]
        more = f", {counted(jumps.size - 1, 'more jump')} behind it" if jumps.size > 1 else ""
        notes.append(
            f"{self.name}: at {at} the reading jumps by {size:.2g} {unit}"
            f"{more}, which no air makes it do behind its lag: the sensor changed (its supply, a converter's range); "
            "nothing tells on which side it was right, and uncertainties are widened by that"
        )
        return self.doubted(self.changed.leaves_open(np.nan_to_num(self.value)) / np.sqrt(2.0))

    def in_free_air(self, time_s: Array) -> FlightChannel:
        """The same without what the carrier adds. Where that begins and ends, half of it is unsure for as long as the
        sensor lags."""
        if self.carried is None:
            return self
        added = self.carried.value
        lag_s = 0.0 if self.response is None else self.response.slowest_s
        rows = 1 + 2 * int(np.ceil(lag_s / typical_period(time_s)))
        turning = 0.5 * (maximum_filter1d(added, rows) - minimum_filter1d(added, rows))
        free = self.doubted(self.carried.uncertainty)
        value = np.where(self.raw, self.value, self.value - added)
        unsure = np.where(self.raw, np.abs(added), turning)
        return replace(free, value=value, uncertainty=np.hypot(free.uncertainty, unsure), carried=None)


def judged(
    readings: FlightReadings,
    found: Estimate,
    undone: Undone,
    screened: Screened,
    outside: Mask,
    raw: Array,
    unit: Array,
    notes: list[str],
    most: float = np.inf,
) -> FlightChannel:
    """What a method found, or the readings `raw` where that is better; `unit` turns the method's unit into `raw`'s, and
    no air has more than `most`."""
    lag = found.air - found.clean
    # a time constant that is wrong by a share moves the air by at most that share of the lag
    common = (readings.response.relative_uncertainty * lag) ** 2
    if readings.response.slow_uncertainty.any():
        behind = _behind_slow_lags(readings, found.air)
        common = common + ((readings.response.slow_uncertainty * behind) ** 2).sum(axis=1)
    variance = found.variance + common
    noise = readings.noise_variance * found.noise_factor**2
    trusted = screened.usable & ~outside
    contradicted = _contradicted(readings, found, noise, trusted)
    if contradicted.any():
        notes.append(
            f"{readings.channel}: {counted(int(np.count_nonzero(contradicted)), 'row')} given as read: no air would "
            "have made the sensor read that beside the readings around"
        )
    raw_rows = outside | contradicted
    if trusted.any() and (why := _no_gain(found, lag[trusted], noise[trusted], variance[trusted])):
        notes.append(f"{readings.channel}: not corrected: {why}")
        raw_rows[:] = True
    if outside.any():
        notes.append(
            f"{readings.channel}: {counted(int(np.count_nonzero(outside)), 'row')} outside the profile's table, "
            "given as they came"
        )
    value, sigma = found.air * unit, np.sqrt(variance) * unit
    away = np.hypot(sigma, raw - value)
    of_outside = _still_there(readings, outside, np.abs(raw - value))
    sigma, common = np.hypot(sigma, of_outside), common + (of_outside / unit) ** 2
    late = undone.delay_uncertainty_s * slope(readings.time_s, value) if undone.delay_uncertainty_s else 0.0
    shared = np.where(raw_rows, np.hypot(np.sqrt(common) * unit, raw - value), np.sqrt(common) * unit)
    value = np.where(raw_rows, raw, value)
    sigma = np.where(raw_rows, away, sigma)
    empty = _given_nowhere(readings, screened, raw, raw_rows, most, notes)
    value, sigma = np.where(empty, np.nan, value), np.where(empty, np.nan, sigma)
    of_readout = np.hypot(undone.uncertainty, late)
    return FlightChannel(
        readings.channel,
        value,
        sigma,
        np.where(empty, np.nan, shared),
        lag * unit,
        of_readout,
        screened,
        outside,
        raw_rows,
        found.resolved_rate,
        found.cutoff_hz,
        found.jumps_s,
        readings.response,
        staying=np.where(raw_rows, 0.0, np.sqrt(found.staying) * unit),
        apart=found.apart * unit,
    )


def _still_there(readings: FlightReadings, outside: Mask, away: Array) -> Array:
    """What is unsure (n,) behind rows beyond the table, by as much as the correction would change the last of them: how
    fast the sensor was there is not known, and it remembers where it stood."""
    left = np.zeros(away.shape)
    until = remembered(readings)[1]
    for last in np.flatnonzero(outside[:-1] & ~outside[1:]).tolist():
        behind = slice(last + 1, until[last] + 1)
        since = readings.time_s[behind] - readings.time_s[last]
        if np.isfinite(away[last]):
            still = away[last] * np.exp(-since / readings.response.slow_s[behind])
            left[behind] = np.maximum(left[behind], still)
    return np.where(outside, 0.0, left)


def _given_nowhere(
    readings: FlightReadings, screened: Screened, raw: Array, raw_rows: Mask, most: float, notes: list[str]
) -> Mask:
    """Rows (n,) without a value: those far from any reading, and those to be given as read that were not."""
    # a reading that is repeated is one, if an old one; one at the sensor's ceiling is none, unless no air has more
    capped = np.zeros(raw.shape, dtype=bool) if screened.capped is None else screened.capped
    read = screened.repeated & ~capped & ~_far(readings.time_s, screened.usable, LONGEST_REPEAT_S)
    far = _far(readings.time_s, screened.usable, LONGEST_FILL_S)
    if (old := far & read & ~raw_rows).any():
        notes.append(
            f"{readings.channel}: {counted(int(np.count_nonzero(old)), 'row')} where the reading stands: told by "
            "the readings before and after" + ("" if readings.told is None else ", and by the temperature")
        )
    empty = (far & ~read & ~(capped & (raw >= most))) | (raw_rows & ~(screened.usable | screened.repeated))
    still = screened.repeated | capped
    for rows in (still, ~still):
        if (lost := empty & rows & np.isfinite(raw)).any():
            levels, count = np.unique(raw[lost], return_counts=True)
            usual = f"{levels[np.argmax(count)]:.6g}"
            why = "the one before again" if 2 * count.max() < count.sum() else f"held at {usual}"
            notes.append(
                f"{readings.channel}: {counted(int(count.sum()), 'row')} without a value: the reading is "
                f"{why if rows is still else f'implausible, such as {usual}'}, and too far from any that counts"
            )
    return np.asarray(empty)


def _contradicted(readings: FlightReadings, found: Estimate, noise: Array, trusted: Mask) -> Mask:
    """Rows (n,) of the `trusted` ones that the sensor, as the profile has it, cannot have read: there the reading is
    the better explanation. One alone is noise, if it says something by itself."""
    open_to = noise if readings.passing is None else noise + np.minimum(readings.passing.sigma**2, found.variance)
    # a late reading is of the sensor as it was
    shown = np.interp(readings.time_s - readings.delay_s, readings.time_s, found.clean)
    off = (readings.reading - shown)[trusted] / np.sqrt(open_to[trusted])
    together = median_filter(off, ROWS_TOGETHER, mode="nearest")
    off = np.where(readings.usable[trusted], together, off)
    contradicted = trusted.copy()
    contradicted[trusted] = np.abs(off) > MOST_NOISES_OFF
    return contradicted


def _no_gain(found: Estimate, lag: Array, noise: Array, variance: Array) -> str:
    """Why an inverse's correction would win nothing over the readings; empty where it does, or where the method is the
    smoother: that knows its sensor and cannot lose."""
    lag_size, noise_size = (float(np.sqrt(np.mean(square))) for square in (lag**2, noise))
    predicted = float(np.mean(variance))
    # an inverse's noise passes for lag
    lagging = max(lag_size**2 - found.amplified, 0.0)
    if found.cutoff_hz is None or not (predicted > lagging + noise_size**2 or lag_size < IDLE_LAG_SIGMAS * noise_size):
        return ""
    return (
        f"the lag ({lag_size:.2g}) cannot be told from the noise ({noise_size:.2g}), a correction would leave "
        f"{np.sqrt(predicted):.2g}"
    )


def coarse(resolution: float, noise: float, unit: Array) -> Array | None:
    """Steps (n,) of readings that are rounded more coarsely than their noise; `unit` is that of the readings."""
    return resolution * unit if resolution > COARSE_IN_NOISE * noise else None


def too_few(screened: Screened) -> bool:
    """Whether a channel has too few usable samples to be corrected."""
    return int(np.count_nonzero(screened.usable)) < LEAST_SAMPLES


def lacking(part: TemperatureProfile | HumidityProfile | None, name: str, raw: Array, possible: Range) -> str:
    """Why a channel is given as it came."""
    if part is None:
        return f"the profile has no {name} part"
    usual = float(np.nanmedian(raw)) if np.isfinite(raw).any() else float("nan")
    slip = np.isfinite(usual) and not possible.holds(usual)
    return "too few usable samples" + (f": {possible.refusal(usual)}; a map states units (--map)" if slip else "")


def untouched(name: str, raw: Array, screened: Screened, why: str, notes: list[str]) -> FlightChannel:
    """A channel given as it came."""
    if np.isfinite(raw).any():
        notes.append(f"{name}: given as it came: {why}")
    believed = screened.usable | screened.repeated
    everywhere = np.ones(raw.shape, dtype=bool)
    nothing = np.full(raw.shape, np.nan)
    value = np.where(believed, raw, np.nan)
    return FlightChannel(name, value, nothing, nothing, nothing, nothing, screened, ~everywhere, everywhere)


def bridged(time_s: Array, values: Array) -> Array | None:
    """Values with their gaps bridged by straight lines; None where there are none at all."""
    known = np.isfinite(values)
    return np.interp(time_s, time_s[known], values[known]) if known.any() else None


def slope(time_s: Array, values: Array) -> Array:
    """Rate of change (n,), 0 where it is not known."""
    even = bridged(time_s, values)
    different = np.append(True, np.diff(time_s) > 0)
    if even is None or np.count_nonzero(different) < 2:
        return np.zeros(values.shape)
    slope = np.gradient(even[different], time_s[different])
    return np.asarray(slope[np.cumsum(different) - 1])


def _far(time_s: Array, usable: Mask, longest_s: float) -> Mask:
    """Rows farther than that from every usable sample."""
    known = time_s[usable]
    place = np.searchsorted(known, time_s)
    before = time_s - known[np.maximum(place - 1, 0)]
    after = known[np.minimum(place, known.size - 1)] - time_s
    return np.minimum(np.abs(before), np.abs(after)) > longest_s


def _behind_slow_lags(readings: FlightReadings, air: Array) -> Array:
    """How far the air is from each of the sensor's slow shares (n, P), the last of its lags; 0 where not known."""
    count = readings.response.slow_uncertainty.size
    even = bridged(readings.time_s, air)
    if even is None:
        return np.zeros((air.size, count))
    lags, _ = lags_behind(even, readings.response, typical_period(readings.time_s))
    return even[:, None] - lags[:, -count:]


# How far the air can be from the readings around it, whatever a method makes of them.
#
# What the air did for as long as the method resolves shows in the readings by at least the share g of its size that the
# sensor shows in that time. So the air is farther from the reading by no more than (spread of the readings around) / g:
# around is as long as the sensor remembers, and as far as the nearest readings.

REMEMBERED_LAGS = 5.0  # of the slowest time constant: what is left of a step is less than its hundredth
ROUNDED_ROWS = 1e-6  # of a row, that a sum of lags is off by rounding
READING_SIGMAS = 4.0  # of a reading's noise at either end
LEAST_SHARE = 0.05
BY_CHANCE = 0.05  # probability of a coincidence that is not believed to be one
MOST_SHARE = 0.8  # readings are noisy, and a sensor is seldom what its profile says to a fifth
# How long a film is off by itself, as a rule: an electric heater for seconds, a drop of half a millimetre, the largest
# of drizzle, for 95 s at 5 m/s and 20 degC in half-dry air (Ranz and Marshall 1952: Sh = 2 + 0.6 Re^1/2 Sc^1/3).
MADE_BY_ITSELF_S = 100.0
USUAL_TIMES = 2.0  # the median uncertainty, up to which a method is as certain as usual
USUAL_NOISES = 3.0  # and up to so many times the reading's noise


def held(
    channel: FlightChannel,
    readings: FlightReadings,
    raw: Array,
    unit: Array,
    notes: list[str],
    possible: Range,
    left_open: Array | float = 0.0,
    broken: Array | float = 0.0,
) -> FlightChannel:
    """The channel no farther from its readings than the air can be; by how much it was counts as uncertainty.

    `unit` turns the readings' unit into that of `raw`, the log's; `possible` is what no air is beyond; `left_open` (n,)
    is the uncertainty of what lags, in the log's unit, that reading and result have in common and their difference not;
    `broken` (n,) is 1 or -1 where it goes up or down in a way that another sensor would have shown, and did not.
    """
    low, high = (bound * unit for bound in reach(readings, channel.resolved_rate))
    # where the sensor was read, the air may be as it says
    own = np.where(channel.screened.read, readings.reading * unit, np.nan)
    value = np.clip(channel.value, np.fmin(low, own), np.fmax(high, own))
    # what is out by less than is stated is that, and what is far out was no estimate
    past = np.nan_to_num(channel.value - np.clip(channel.value, possible.low, possible.high))
    nearest = np.clip(value, possible.low, possible.high)
    out = np.abs(nearest - value) > READING_SIGMAS * channel.uncertainty
    value = np.where(out, nearest, value)
    sigma = channel.uncertainty
    impossible = np.abs(past) > READING_SIGMAS * sigma
    odd = np.where(impossible, np.sign(past), broken)
    # of what is never below nothing a sensor's own error is a share
    share = possible.low == 0.0
    as_before, own_way, odd_moves = _as_before(value, own, odd, impossible, readings, in_proportion=share)
    if (capped := _capped(channel, np.full(raw.shape, -np.inf)) & ~channel.raw).any():
        value = _above_ceiling(value, raw, capped, channel, readings, notes)
        beyond = np.where(capped & np.isfinite(value), value - raw, 0.0)
        wider = np.hypot(channel.uncertainty, beyond)
        channel = replace(channel, value=np.where(capped, value, channel.value), uncertainty=wider)
    away = np.where(channel.raw | ~np.isfinite(channel.value), 0.0, np.abs(value - channel.value))
    if (moved := away > 0.0).any():
        notes.append(
            f"{channel.name}: {counted(int(np.count_nonzero(moved)), 'row')} came out farther from the readings around "
            "than the sensor's lag allows: given at the farthest that it does, with as much more uncertainty"
        )
        value = np.where(moved, value, channel.value)
        channel = replace(channel, value=value, uncertainty=np.hypot(channel.uncertainty, away))
    # beyond a ceiling the air may be anywhere from there to where the readings around would have it
    anywhere = np.where(capped, np.abs(value - raw) / np.sqrt(3.0), 0.0)
    unsure = np.hypot(np.hypot(np.where(capped, sigma, channel.uncertainty), anywhere), left_open)
    beyond = np.where(capped, 0.0, _beyond_both_sides(channel, readings, unit))
    wider = np.hypot(channel.uncertainty, np.hypot(beyond, as_before))
    channel = replace(channel, uncertainty=wider, as_before=as_before, odd_moves=odd_moves)
    channel = _nearer(channel, readings, unit, np.hypot(unsure, beyond))
    as_read = own_way & np.isfinite(own) & ~(channel.raw | capped)
    return replace(channel, value=np.where(as_read, own, channel.value))


def _as_before(
    value: Array, own: Array, odd: Array, impossible: Mask, readings: FlightReadings, in_proportion: bool
) -> tuple[Array, Mask, tuple[OddMove, ...]]:
    """Uncertainty (n,) from where the readings go up (`odd` 1) or down (-1) as no air makes them (`impossible`), or
    none that another sensor would not have shown: it may lie anywhere between what it was before and its `value` (n,),
    until this is back there, or had the time for that since it went back as oddly, but not farther off than the sensor
    was as it had gone, or `in_proportion` to what it reads; and for as long as the sensor remembers it between that and
    the sensor's `own` reading. What no air refutes and nothing undoes is the less likely the sensor's own the longer it
    lasts. And where (n,) the sensor is likelier to have done that by itself: it went and came
    back, both as no air would or the other sensor shows; and these moves."""
    found: list[OddMove] = []
    unsure, itself = np.zeros(value.shape), np.zeros(value.shape, dtype=bool)
    since, later = remembered(readings)
    time_s, rows = readings.time_s, np.arange(value.size)
    last = np.searchsorted(time_s, time_s + MADE_BY_ITSELF_S * np.log(1.0 / BY_CHANCE), side="right")
    last[impossible] = value.size
    # a value that was held at 0 has no proportion: so small that the quotient of any two is still a double
    least = float(np.sqrt(np.finfo(float).tiny))
    size = np.maximum(np.abs(value), least) if in_proportion else np.ones(value.shape)
    lagging = np.nan_to_num(np.abs(value - own))
    for gone_at, back_at in there_and_back(odd, later - rows, last - rows):
        first, way = gone_at.start, odd[gone_at.start]
        was = way * value[since[first] : first + 1]
        if np.isnan(was).all():  # nobody knows from where it went
            continue
        before = np.nanmin(was)
        gone = np.nan_to_num(way * value[first:] - before)
        farthest = (
            int(np.argmax(gone[: later[gone_at.stop - 1] + 1 - first])) if back_at is None else back_at.start - first
        )
        home = np.append(np.flatnonzero(gone[farthest:] <= 0.0), gone.size - farthest)[0]
        until = first + farthest + int(home)
        moves = [gone_at]
        if back_at is not None:
            until = min(until, int(later[back_at.stop - 1]) + 1)
            moves.append(back_at)
        until = max(until, moves[-1].stop)
        # what a sensor does by itself is as large beside what it reads as when it came on: the air may have gone on
        most = np.abs(gone[farthest] / size[first + farthest]) * size[first:]
        most[: farthest + 1] = np.inf
        gone = np.clip(gone, 0.0, most)
        if back_at is None and not impossible[gone_at].any():
            still = np.maximum(time_s[first:] - time_s[gone_at.stop - 1], 0.0) / MADE_BY_ITSELF_S
            gone *= np.sqrt(np.exp(-still))
            until = min(until, int(last[gone_at.stop - 1]))
        unsure[first:until] = np.fmax(unsure[first:until], gone[: until - first])
        for move in moves:
            around = slice(move.start, later[move.stop - 1] + 1)
            unsure[around] = np.maximum(unsure[around], lagging[around])
            itself[around] |= back_at is not None
        why = (
            "as behind its lag no air makes it: the sensor was wet, or is faster than the profile says"
            if impossible[gone_at].any()
            else "at once and the temperature shows nothing of it: other air, or the sensor itself (a drop, a heater)"
        )
        found.append(OddMove(first, min(until, value.size - 1), float(way), why, back_at is not None))
    return unsure / np.sqrt(3.0), itself, tuple(found)


def there_and_back(odd: Array, rows: Index | int, lasting: Index | float = np.inf) -> list[tuple[slice, slice | None]]:
    """Moves that are `odd` (n,), up 1 and down -1, each with the one that undoes it and is `lasting` rows (n,) away at
    most, of neighbours the nearest ones first; those of one way within so many rows (n,) of the one before are one."""
    at = np.flatnonzero(odd)
    apart = np.flatnonzero((np.diff(at) > np.broadcast_to(rows, odd.shape)[at[:-1]]) | (np.diff(odd[at]) != 0.0)) + 1
    moves = [slice(int(one[0]), int(one[-1]) + 1) for one in np.split(at, apart) if one.size]
    found: list[tuple[slice, slice | None]] = []
    count = len(moves)
    before, behind, alone = list(range(-1, count - 1)), list(range(1, count + 1)), [True] * count

    def pair(i: int, j: int) -> list[tuple[int, int, int]]:
        opposite, away = odd[moves[i].start] != odd[moves[j].start], moves[j].start - moves[i].stop
        return [(away, i, j)] if opposite and away <= np.broadcast_to(lasting, odd.shape)[moves[i].stop - 1] else []

    nearest = [one for i in range(count - 1) for one in pair(i, i + 1)]
    heapify(nearest)
    while nearest:
        _, i, j = heappop(nearest)
        if not (alone[i] and alone[j]):
            continue
        found.append((moves[i], moves[j]))
        alone[i] = alone[j] = False
        # those beside the two are neighbours now
        first, last = before[i], behind[j]
        if first >= 0:
            behind[first] = last
        if last < count:
            before[last] = first
        for one in pair(first, last) if first >= 0 and last < count else ():
            heappush(nearest, one)
    lone = ((move, None) for move, one in zip(moves, alone, strict=True) if one)
    return sorted([*found, *lone], key=lambda one: one[0].start)


def without_layers(odd: Array, height: Array) -> Array:
    """Moves that are `odd` (n,), up 1 and down -1, without those that an opposite one answers at the same `height`
    (n,), from which the carrier had gone away: it came through the edge of a layer again. No sensor knows how high it
    is; of its own moves the nearest opposite one would be as near once in twenty times, by chance."""
    rows, found = np.flatnonzero(odd), odd.copy()
    steps = np.abs(np.diff(height))
    known_to = float(np.min(steps[steps > 0.0], initial=np.inf))  # no nearer than the log tells heights apart
    for row in rows.tolist():
        others = rows[odd[rows] == -odd[row]]
        if not others.size:
            continue
        away = np.abs(height[others] - height[row])
        nearest = int(others[np.argmin(away)])
        first, last = sorted((row, nearest))
        gone = float(np.ptp(height[first : last + 1]))
        if max(float(away.min()), known_to) * others.size < BY_CHANCE * gone:
            found[[row, nearest]] = 0.0
    return found


def possible_air(temperature_c: Array) -> Array:
    """Temperatures (n,) as far as any air has them: a reading, or one less moves of the sensor's own, may be any."""
    return np.clip(temperature_c, RANGES["temperature_c"].low, RANGES["temperature_c"].high)


def _beyond_both_sides(channel: FlightChannel, readings: FlightReadings, unit: Array) -> Array:
    """How far (n,), in a stretch that is longer than values are filled in over, of which nothing is read or told, the
    air would have gone beyond what it was on either side: a trend goes on where no reading bears that out."""
    sure = readings.usable if readings.loud is None else readings.usable & ~readings.loud
    rows = np.flatnonzero(sure & np.isfinite(channel.value))
    if not rows.size:
        return np.zeros(sure.shape)
    air = channel.value / unit
    place = np.searchsorted(rows, np.arange(sure.size))
    ends = np.stack([rows[np.maximum(place - 1, 0)], rows[np.minimum(place, rows.size - 1)]])
    low, high = air[ends].min(axis=0), air[ends].max(axis=0)
    unread = ~(readings.usable | channel.raw) & (np.diff(readings.time_s[ends], axis=0)[0] > LONGEST_FILL_S)
    if readings.told is not None:
        unread &= ~np.isfinite(readings.told)
    return np.where(unread & np.isfinite(air), np.maximum(np.maximum(air - high, low - air), 0.0), 0.0) * unit


def _capped(channel: FlightChannel, beyond: Array) -> Mask:
    """Rows (n,) at the ceiling where the sensor stops, but where that is what no air is `beyond` (n,)."""
    capped = channel.screened.capped
    return np.zeros(channel.value.shape, dtype=bool) if capped is None else capped & (beyond < 0.0)


def _nearer(channel: FlightChannel, readings: FlightReadings, unit: Array, sigma: Array) -> FlightChannel:
    """The channel nearer to its readings where it is far less certain than elsewhere in the flight, in air that varies
    as strongly.

    That the reading is right is one of the explanations. A value that is off from it by d has s to be unsure by, and
    so has the reading: its weight is the likelihood of that, exp(-d^2 / 4 s^2), so that a correction which the flight
    bears out is kept. s is what exceeds the usual uncertainty; what is stated stays.
    """
    seen = np.isfinite(readings.reading) & channel.screened.read
    if not seen.any():
        return channel
    # in a gap, what lies between the readings on either side; or a reading that was thrown out, if that is nearer
    rows = np.arange(seen.size)
    reading = np.interp(rows, rows[seen], readings.reading[seen]) * unit
    thrown = np.where(channel.screened.implausible, readings.reading * unit, np.nan)
    nearer = np.abs(channel.value - thrown) < np.abs(channel.value - reading)
    reading = np.where(nearer, thrown, reading)
    known = np.isfinite(channel.value) & np.isfinite(sigma) & ~channel.raw
    if not known.any():
        return channel
    # of rows that were read: of a flight that hardly was, a gap's is no usual one
    read = known & readings.usable
    noise = np.interp(rows, rows[seen], np.sqrt(readings.noise_variance)[seen]) * unit
    apart = np.broadcast_to(channel.apart, sigma.shape)
    of_apart = np.median((sigma / apart)[read if read.any() else known])
    usual = np.maximum(USUAL_TIMES * of_apart * apart, USUAL_NOISES * noise)
    off = np.where(known, channel.value - reading, 0.0)
    extra = np.where(known, np.maximum(sigma**2 - usual**2, 0.0), 0.0)
    vague = extra > 0.0
    weight = np.exp(-0.25 * np.divide(off**2, extra, out=np.zeros(off.shape), where=vague))
    return replace(channel, value=np.where(vague, channel.value - weight * off, channel.value))


def _above_ceiling(
    value: Array, raw: Array, capped: Mask, channel: FlightChannel, readings: FlightReadings, notes: list[str]
) -> Array:
    """Values where the sensor stopped: it was there or above."""
    limit = float(np.max(raw[capped]))
    notes.append(
        f"{channel.name}: {counted(int(np.count_nonzero(capped)), 'row')} held at {limit:.6g}, the largest there is: "
        "the sensor was there or above"
    )
    # the sensor, not the air: that lies as far from it as it does without the ceiling
    shown = value - channel.lag
    least = value + np.maximum(limit - shown, 0.0)
    # air that was below, and for longer than the sensor lags, would have shown: so it was not while that stays there
    stays = capped & _stays(capped | ~channel.screened.usable, readings)
    return np.where(capped & np.isfinite(value), np.where(stays, np.maximum(least, limit), least), value)


def _stays(capped: Mask, readings: FlightReadings) -> Mask:
    """Rows (n,) that are `capped`, or not read, and behind which all are for as long as the sensor lags."""
    lag_s = readings.response.slowest_s + readings.delay_s
    ends = np.append(readings.time_s[~capped], np.inf)
    next_s = ends[np.searchsorted(ends, readings.time_s)]
    last_s = float(readings.time_s[-1])
    return np.asarray(np.minimum(next_s, last_s) - readings.time_s >= lag_s)


def remembered(readings: FlightReadings) -> tuple[Index, Index]:
    """The first and the last row (n,) of which the sensor knows, or will know, at each: where its film is in the cold
    it remembers for longer."""
    response, period, rows = readings.response, typical_period(readings.time_s), np.arange(readings.time_s.size)
    passed = np.where(np.abs(response.weight) > LEAST_SHARE, 1.0 / response.rate, 0.0).max(axis=-1)
    lags = 1.0 / np.maximum(np.maximum(passed, response.slow_s) / period, 1e-3 * ROUNDED_ROWS)
    # how many lags pass up to each row, and beyond either end of the flight as many as it has there
    beyond = REMEMBERED_LAGS / lags[[0, -1]]
    ends = np.concatenate([[-beyond[0]], rows, [rows[-1] + beyond[1]]])
    by_then = np.cumsum(0.5 * (lags + np.roll(lags, 1))) - 0.5 * (lags[0] + lags[-1])
    known = np.concatenate([[by_then[0] - REMEMBERED_LAGS], by_then, [by_then[-1] + REMEMBERED_LAGS]])
    late = abs(readings.delay_s) / period
    behind = np.interp(by_then + REMEMBERED_LAGS, known, ends) - rows + late
    before = rows - np.interp(by_then - REMEMBERED_LAGS, known, ends) + late
    whole = (np.ceil(one - ROUNDED_ROWS).astype(np.int64) for one in (before, behind))
    earlier, later = whole
    return np.maximum(rows - earlier, 0), np.minimum(rows + later, rows[-1])


def _farthest(values: Array, first: Index, last: Index) -> tuple[Array, Array]:
    """The least and the largest (n,) of values (n,) from the `first` row to the `last` (n,) of each."""
    power = np.floor(np.log2(last - first + 1)).astype(np.int64)
    low, high = np.empty(values.shape), np.empty(values.shape)
    least = largest = values
    for width in range(int(power.max()) + 1):
        some = power == width
        ends = first[some], last[some] - 2**width + 1
        low[some], high[some] = np.minimum(*(least[one] for one in ends)), np.maximum(*(largest[one] for one in ends))
        half = 2**width
        least, largest = np.minimum(least[:-half], least[half:]), np.maximum(largest[:-half], largest[half:])
    return low, high


def reach(readings: FlightReadings, resolved_rate: float) -> tuple[Array, Array]:
    """Least and largest air (n,) that the readings around each row allow, in the readings' own unit; in a gap those on
    either side."""
    noise = np.sqrt(readings.noise_variance)
    rows = np.arange(readings.reading.size)
    ends = np.flatnonzero(readings.usable if readings.loud is None else readings.usable & ~readings.loud)
    if not ends.size:
        ends = np.flatnonzero(readings.usable)
    # gaps bridged by straight lines, for how far readings go; when they went there nothing tells
    around = np.interp(rows, ends, readings.reading[ends])
    place = np.searchsorted(ends, rows)
    both = readings.reading[np.stack([ends[np.maximum(place - 1, 0)], ends[np.minimum(place, ends.size - 1)]])]
    both[:, ends] = readings.reading[ends]
    if readings.told is not None:
        told = np.isfinite(readings.told)
        around, both = np.where(told, readings.told, around), np.where(told, readings.told, both)
    period = typical_period(readings.time_s)
    response = readings.response
    margin = READING_SIGMAS * float(np.median(noise[ends]))
    low, high = _farthest(around, *remembered(readings))
    low, high = low - margin, high + margin
    resolved = max(np.pi / resolved_rate, period)
    spread = (high - low) / float(np.clip(largest_share(response, resolved), LEAST_SHARE, MOST_SHARE))
    return both.min(axis=0) - spread, both.max(axis=0) + spread
