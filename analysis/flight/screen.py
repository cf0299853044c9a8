"""Which samples of a flight to believe: codes for no value, times that run forward, readings that are new and
possible.

A reading is implausible outside what its quantity can be, where it stands alone against the median around it, beside
such ones and far from what is read on either side, or between two jumps that the sensor's lag lets nothing make; it is
repeated where it equals the one before although the noise is wider than the resolution, and readings do not go on by
one step of it at a time, or where it stays about one level although the sensor is noisier; a repeat is used all the
same where the resolution explains it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d
from scipy.special import bdtrc

from shockrig.analysis.estimate.without_model import MAD_TO_SIGMA
from shockrig.analysis.flight.columns import held
from shockrig.analysis.flight.stretches import (
    BY_CHANCE,
    FARTHEST_SWINGS,
    FELT_SHARE,
    PARTED_ROWS,
    Felt,
    judge,
    scatter,
    within,
)
from shockrig.analysis.flight.sweep import COARSE_IN_NOISE
from shockrig.files.flight import Flight
from shockrig.files.numbers import counted
from shockrig.files.ranges import LIKELY_RANGES, RANGES, Range
from shockrig.files.sentinels import coded, without_sign

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# What in a log is no reading of its column: codes for no value, which are missing from here on, and rows whose two
# columns stand in one another's place, which are put back. Both are counted.

PASCAL = "pressure_hpa: pascal"
WITHOUT_SIGN = "below 0 without a sign"
EXCHANGED = "temperature and humidity, each in the other's place"
DEGF = "temperature in degF"
UNSURE = "temperature and humidity, of which nothing tells whether they are in one another's place"
NEITHER = "readings that are neither temperature nor humidity"
# quantity -> field of a flight, and what a reading of it can be
FIELDS = {
    "time": ("time_s", ""),
    "temperature": ("temperature_c", "temperature_c"),
    "humidity": ("humidity_percent", "humidity_reading_percent"),
    "die": ("die_temperature_c", "temperature_c"),
    "airspeed": ("airspeed_m_s", "airflow_m_s"),
    "pressure": ("pressure_hpa", "pressure_hpa"),
    "altitude": ("altitude_m", "altitude_m"),
    "latitude": ("latitude_deg", "latitude_deg"),
    "longitude": ("longitude_deg", "longitude_deg"),
    "vertical_speed": ("vertical_speed_m_s", ""),
}


def without_codes(flight: Flight) -> tuple[Flight, dict[str, Mask]]:
    """The flight with codes for no value missing, exchanged columns put back and degF read as such, and the rows (n,)
    of each, by quantity and code."""
    found: dict[str, Mask] = {}
    changed = {}
    for quantity, (name, possible) in FIELDS.items():
        values = getattr(flight, name)
        if values is None:
            continue
        known = {**RANGES, **LIKELY_RANGES}
        ends = (known[possible].low, known[possible].high) if possible else (-np.inf, np.inf)
        codes = coded(quantity, values, *ends)
        if codes:
            found |= {f"{quantity} {code:.6g}": rows for code, rows in codes.items()}
            values = changed[name] = np.where(np.logical_or.reduce(list(codes.values())), np.nan, values)
        if possible != "temperature_c":
            continue
        span, rows = without_sign(values, RANGES[possible])
        if rows.any():
            found[f"{quantity} {WITHOUT_SIGN} {span:g}"] = rows
            changed[name] = np.where(rows, values - span, values)
    # a receiver without a fix writes 0 for its height as well, which by itself may be one
    no_fix = [found[f"{name} 0"] for name in ("latitude", "longitude") if f"{name} 0" in found]
    if flight.latitude_deg is not None and np.isfinite(flight.latitude_deg).any():
        no_fix.append(np.isnan(flight.latitude_deg))
    if no_fix and flight.altitude_m is not None:
        height = changed.get("altitude_m", flight.altitude_m)
        if (without := np.logical_or.reduce(no_fix) & (height == 0.0)).any():
            found["altitude 0"], changed["altitude_m"] = without, np.where(without, np.nan, height)
    flight = replace(flight, **changed)
    if (pascal := _in_pascal(flight.pressure_hpa)).any():
        found[PASCAL], flight = pascal, replace(flight, pressure_hpa=flight.pressure_hpa / 100.0)
    both = np.stack([flight.temperature_c, flight.humidity_percent])
    steps = [resolution_of(values[np.isfinite(values)]) for values in both]
    told = held(both, steps)
    neither = told.nothing & np.isfinite(both)
    both = np.where(neither, np.nan, both)
    both = np.where(told.unsure, np.nan, np.where(told.exchanged, both[::-1], both))
    degf = told.degf & np.isfinite(both)
    for values, converted, step in zip(both, degf, steps, strict=True):
        # on the log's steps: between them every other reading would be one that stays where it should move
        in_degc = (values[converted] - 32.0) / 1.8
        values[converted] = np.round(in_degc / step) * step if step else in_degc
    some = {EXCHANGED: told.exchanged & ~told.unsure, UNSURE: told.unsure, DEGF: degf[0] | degf[1]}
    some[NEITHER] = neither[0] | neither[1]
    found |= {name: rows for name, rows in some.items() if rows.any()}
    if found.keys() & some.keys():
        flight = replace(flight, temperature_c=both[0], humidity_percent=both[1])
    return flight, found


def _in_pascal(pressure: Array) -> Mask:
    """Rows (n,) with a pressure, where most of them can be none in hPa and all could be in Pa."""
    possible, known = RANGES["pressure_hpa"], np.isfinite(pressure)
    usual = float(np.median(pressure[known])) if known.any() else 0.0
    return known & (usual > possible.high) & possible.holds(usual / 100.0)


def code_notes(codes: Mapping[str, Mask | int]) -> list[str]:
    """A sentence for each quantity: how many rows of it hold which code."""
    of_quantity: dict[str, list[str]] = {}
    sentences = []
    for name, rows in codes.items():
        count = int(np.count_nonzero(rows)) if isinstance(rows, np.ndarray) else rows
        if count and name == EXCHANGED:
            sentences.append(f"{name} in {counted(count, 'row')}: read there")
        elif count and name == DEGF:
            sentences.append(f"{name} in {counted(count, 'row')}: read as that")
        elif count and name in (UNSURE, NEITHER):
            sentences.append(f"{name}, in {counted(count, 'row')}: taken as missing")
        elif count and WITHOUT_SIGN in name:
            what, span = name.rsplit(" ", 1)
            sentences.append(f"{what} in {counted(count, 'row')}: {span} are taken off")
        elif count and name == PASCAL:
            sentences.append("pressure_hpa: no air has so much; taken as Pa, and divided by 100")
        elif count:
            quantity, code = name.split(" ", 1)
            of_quantity.setdefault(quantity, []).append(f"{code} in {counted(count, 'row')}")
    return sentences + [
        f"{quantity}: {', '.join(found)}: what loggers write for no value, taken as missing"
        for quantity, found in of_quantity.items()
    ]


MEDIAN_WIDTH = 11  # a burst of up to 5 absurd samples in a row is seen
LONE_SIGMAS = 10.0  # of what is usual over the flight
FELT_SIGMAS = 3.0  # of the noise that the other sensor shows around
ON_THE_WAY = 0.25  # of the larger step beside a reading, that the smaller one goes on by
WORST_SHARE = 0.5  # of what the farthest reading around is off: those go together
SPIKE_STEPS = 3.0  # of the log: rounding at both ends, and one for the air
STAYED_SHARE = 0.5  # of what a lag leaves when the air goes back to where it was
AROUND_WIDTH = 31
AROUND_SIGMAS = 6.0  # of what is usual in so many rows before, or behind
LONGEST_GAP_S = 10.0  # without any row: more may be a step of the clock
GAP_PERIODS = 10.0  # or so many periods, in a slow log
SIDE_ROWS = 12  # on either side of a step of the clock that lines are laid through
USUAL_SHARE = 0.99  # of other rows, that differ by as much
ALIKE_SHARE, FEWEST_ALIKE = 0.05, 20  # of the other rows, where readings go most nearly as fast
PAUSES_A_SETTING = 10.0  # of loggers, while they log
FEWEST_ROWS = 6  # that go on from a step of the clock; fewer are out of place
FEWEST_CHANGES = 8  # of a reading, to judge the steps of its log by
CAPPED_SHARE = 0.02  # of the rows, that hold the largest reading and the one before it as well
FEWEST_CAPPED = 10
STOOD_SHARE = 1 / 3  # of a step of what lags, over rows in which its readings stand
CEILING_SIGMAS = 5.0  # of chance, that a highest step is held longer
# of the readings; fewer levels tell a log's step no better than those that occur once:
REPEATED_SHARE = 0.5
FEWEST_LEVELS = 20
ENOUGH_SHARE, ON_A_STEP = 0.75, 10.0  # of the readings, on levels that hold so many each: these are steps, however few
OFF_GRID = 0.05  # of a step, that rounded steps add up to
GRID_ROUNDING = 1e-6  # of a step, that a log's digits are off its grid
BY_CHANCE_ON_GRID = 1e-3  # probability that levels of finer steps lie there
BESIDE_ONE_ANOTHER = 0.5  # of the lines between the lowest and the highest of these few are held
LATEST_S = 1e13  # since 1970 it is 2e9 s; beyond this a double's steps are no longer milliseconds


@dataclass(frozen=True)
class Screened:
    """Masks (n,): readings to use, missing ones, repeats, absurd ones; `resolution` of the log in the channel's unit;
    `louder` (n,): noise of each reading over what is stated, more than 1 in a burst; `capped`: readings at the ceiling
    where the sensor stops, which say no more than that it was there or above; `own_steps` (n,): jumps of the
    sensor itself, at the first row behind each."""

    usable: Mask
    missing: Mask
    repeated: Mask
    implausible: Mask
    resolution: float
    louder: Array | float = 1.0
    capped: Mask | None = None
    own_steps: Array | float = 0.0

    @property
    def read(self) -> Mask:
        """Rows (n,) where the sensor was read, if not anew, or at its ceiling."""
        read = self.usable | self.repeated
        return read if self.capped is None else read | self.capped

    @property
    def loud(self) -> Mask:
        """Readings (n,) in bursts of noise."""
        return np.broadcast_to(np.asarray(self.louder) > 1.0, self.usable.shape)


@dataclass(frozen=True)
class OrderedTime:
    """A log's time put in order.

    Attributes
    ----------
    good : ndarray (n,)
        Rows whose time can be believed.
    time_s : ndarray (m,)
        Of those rows, running forward: a step of the clock has become a gap across which nothing is known, or one
        period where the readings run on across it.
    steps : tuple of Step
        Where the clock steps back, or ahead by more than a gap that readings are bridged over.
    """

    good: Mask
    time_s: Array
    steps: tuple[ClockStep, ...]


@dataclass(frozen=True)
class ClockStep:
    """A step of the clock: the first row after it, by how many seconds, and whether the readings run on across it."""

    row: int
    by_s: float
    runs_on: bool


def clock(time_s: Array, part_s: float, readings: Sequence[Array] = ()) -> OrderedTime:
    """Put a log's time (n,) in order; stretches that a step parts are set `part_s` apart, or more in a slow log.

    A few rows out of place (a lone jump and back) are left out; where the clock steps and goes on from there, the rows
    after it are as good as those before, but how much time lies between is not known. Only where all `readings` (n,)
    run on across it, in level and slope, as they do between any two rows, the clock was set and no time lies between.
    """
    good = np.abs(time_s) < LATEST_S
    while True:
        rows = np.flatnonzero(good)
        if rows.size < 2:
            return OrderedTime(good, time_s[rows], ())
        ahead = np.diff(time_s[rows])
        usual, longest = ahead[ahead > 0], _longest_gap(ahead)
        if (stray := _out_of_place(time_s[rows], longest)).size:
            good[rows[stray]] = False
            continue
        parting = (ahead < 0) | (ahead > longest)
        bounds = np.concatenate([[0], np.flatnonzero(parting) + 1, [rows.size]])
        sizes = np.diff(bounds)
        short = np.flatnonzero(sizes < FEWEST_ROWS)
        # rows out of place go one stretch at a time: what is left may then run on
        astray = [i for i in short.tolist() if sizes.size > 1 and not _fits(time_s[rows], bounds, i)]
        if not astray:
            break
        i = min(astray, key=lambda i: sizes[i])
        good[rows[bounds[i] : bounds[i + 1]]] = False
    period = float(np.median(usual)) if usual.size else part_s
    left_out = np.minimum(np.maximum(ahead[bounds[1:-1] - 1], 0.0) / period, rows.size).astype(np.int64)
    as_set = np.cumsum(np.append(0.0, np.where(parting, 1.0, ahead / period)))
    on = _running_on(as_set, [one[rows] for one in readings], bounds[1:-1], left_out)
    # a counter that begins anew was started, and not set: how long it was off nothing tells
    on &= np.abs(time_s[rows] - time_s[rows[0]]) > longest
    steps = tuple(ClockStep(int(rows[k]), float(ahead[k - 1]), bool(on[k])) for k in bounds[1:-1])
    part = np.where(on[1:], period, max(part_s, longest + period))
    even = np.concatenate([[0.0], np.where(parting, part, ahead)])
    return OrderedTime(good, time_s[rows[0]] + np.cumsum(even) if steps else time_s[rows], steps)


def _running_on(time: Array, readings: Sequence[Array], steps: NDArray[np.int64], left_out: NDArray[np.int64]) -> Mask:
    """Rows (n,) of `steps` across which every reading runs on: straight lines through the rows before and after differ
    in level and slope by no more than at nearly all other rows. A sensor that lags shows any time left out, and so does
    where it was carried. `time` (n,) is in periods, one of them across a step.

    A clock that steps ahead by as many rows as are `left_out` (s,) may as well have paused, and mostly has: it was set
    if readings that go as fast would have shown that, anywhere else in the log. Those that stand still would not.
    """
    size = time.size
    on = np.zeros(size, dtype=bool)
    seen = [one for one in readings if np.count_nonzero(np.isfinite(one)) > 0.5 * size]
    if not seen or size < 20 * SIDE_ROWS:
        return on
    inside = steps[(steps >= SIDE_ROWS) & (steps <= size - SIDE_ROWS)]
    parted = np.zeros(size + 1, dtype=int)
    parted[steps] = 1
    parted = np.cumsum(parted)
    ends = np.arange(SIDE_ROWS, size - SIDE_ROWS + 1)  # of the rows before, which those behind begin at

    def unparted(before: NDArray[np.int64], behind: NDArray[np.int64]) -> Mask:
        return np.asarray(parted[behind + SIDE_ROWS - 1] == parted[before - SIDE_ROWS])

    ordinary = ends[unparted(ends, ends)]
    if ordinary.size < 10 * SIDE_ROWS:
        return on
    lines = [_Lines(time, one, ordinary) for one in seen]
    on[inside] = np.logical_and.reduce([one.runs_on(inside) for one in lines])
    for row, rows in zip(steps.tolist(), left_out.tolist(), strict=True):
        if not on[row] or rows <= 0:
            continue
        cut = ends[: max(ends.size - rows, ends.size // 2)]
        behind = cut + min(rows, ends.size - cut.size)
        here, whole = np.array([row]), unparted(cut, behind)
        rate = np.max([one.rate(here, here) for one in lines])
        either = []
        for at in ((ordinary, ordinary), (cut[whole], behind[whole])):
            off = np.abs(np.max([one.rate(*at) for one in lines], axis=0) - rate)
            alike = np.argsort(off, kind="stable")[: max(int(ALIKE_SHARE * off.size), FEWEST_ALIKE)]
            either.append(np.concatenate([one.apart(*(some[alike] for some in at)) for one in lines]))
        usual = np.maximum(np.median(either[0], axis=1), np.finfo(float).tiny)
        here_apart = np.max(np.concatenate([one.apart(here, here) for one in lines])[:, 0] / usual)
        set_apart, paused_apart = (np.max(one / usual[:, None], axis=0) for one in either)
        # half of the clocks that are set leave them as near as that, or nearer, and hardly any leaves them farther
        near = max(here_apart, float(np.median(set_apart)))
        as_set, as_paused = ((np.count_nonzero(one <= near) + 1) / (one.size + 2) for one in (set_apart, paused_apart))
        on[row] = near <= np.quantile(set_apart, USUAL_SHARE) and as_set > PAUSES_A_SETTING * as_paused
    return on


class _Lines:
    """Straight lines through as many rows of a reading (n,) before any row, and from any row on, both where they meet
    if no time lies between; and how far these are apart at most, at nearly all `ordinary` rows."""

    def __init__(self, time: Array, values: Array, ordinary: NDArray[np.int64]) -> None:
        known = np.isfinite(values)
        values = np.interp(np.arange(values.size), np.flatnonzero(known), values[known])
        values = median_filter(values, 3, mode="nearest")  # single absurd readings
        self.half = 0.5 * np.diff(time, prepend=time[0])  # of the time from the row before
        times, rows = (sliding_window_view(one, SIDE_ROWS) for one in (time, values))
        middle = times.mean(axis=1)
        off = times - middle[:, None]
        slope = (off * rows).sum(axis=1) / np.maximum((off**2).sum(axis=1), np.finfo(float).tiny)
        # level and slope (2, n - SIDE_ROWS + 1) of the rows from each on, at the last and at the first of them
        level = rows.mean(axis=1)
        self.before = np.stack([level + slope * (times[:, -1] - middle), slope])
        self.behind = np.stack([level + slope * (times[:, 0] - middle), slope])
        self.most = np.quantile(self.apart(ordinary, ordinary), USUAL_SHARE, axis=1, keepdims=True)

    def apart(self, before: NDArray[np.int64], behind: NDArray[np.int64]) -> Array:
        """Differences (2, m) of the lines up to some rows and from others on, in level and slope."""
        (last, falling), (first, rising) = self.before[:, before - SIDE_ROWS], self.behind[:, behind]
        half = np.where(before == behind, self.half[behind], 0.5)  # of others it is taken that they follow at once
        return np.abs(np.stack([first - last - half * (rising + falling), rising - falling]))

    def runs_on(self, rows: NDArray[np.int64]) -> Mask:
        """Whether (m,) the lines are as near as that."""
        return np.asarray((self.apart(rows, rows) <= self.most).all(axis=0))

    def rate(self, before: NDArray[np.int64], behind: NDArray[np.int64]) -> Array:
        """How fast (m,) a reading goes on both sides, beside what its level may be off by."""
        going = np.abs(self.behind[1, behind] + self.before[1, before - SIDE_ROWS])
        return np.asarray(going / max(float(self.most[0, 0]), np.finfo(float).tiny))


def _out_of_place(time_s: Array, longest: float) -> NDArray[np.int64]:
    """Rows, a few in a row, without which time does not run back: ahead of what follows, or behind what came before."""
    stray: list[int] = []
    for i in (np.flatnonzero(np.diff(time_s) < 0) + 1).tolist():
        if stray and i <= stray[-1] + FEWEST_ROWS:
            continue  # looked at again when those are out
        for m in range(1, FEWEST_ROWS):
            if i + m < time_s.size and 0 <= time_s[i + m] - time_s[i - 1] <= longest:
                stray.extend(range(i, i + m))
                break
            if i - m > 0 and 0 <= time_s[i] - time_s[i - m - 1] <= longest:
                stray.extend(range(i - m, i))
                break
    return np.array(stray, dtype=np.int64)


def _fits(time_s: Array, bounds: NDArray[np.int64], i: int) -> bool:
    """Whether a short stretch lies in time between its neighbours."""
    before = time_s[bounds[i] - 1] if i else -np.inf
    after = time_s[bounds[i + 1]] if bounds[i + 1] < time_s.size else np.inf
    return bool(before <= time_s[bounds[i]] and time_s[bounds[i + 1] - 1] <= after)


def screen(
    time_s: Array,
    reading: Array,
    possible: Range,
    noise: float,
    *,
    limit: float | None = None,
    stale: Mask | None = None,
    share: float = 1.0,
    swing: float = np.inf,
    lagging: Array | None = None,
    known: Mask | None = None,
    unsure: Array | None = None,
    felt: Felt | None = None,
) -> Screened:
    """Judge one channel's readings, rows in order.

    `possible` is what a reading can be; `limit` is a ceiling at which the sensor clips; `stale` marks rows (n,)
    that are known to repeat the one before; `share` is the most of a step of the air that the sensor shows between two
    rows, `swing` the most that the air goes and comes back within two rows, `lagging` (n,) what lags where it is not
    the reading itself, and `known` the rows where that is no guess, `unsure` (n,) its relative standard uncertainty,
    `felt` what another sensor felt of the same air at once.
    """
    missing = ~np.isfinite(reading)
    implausible = ~missing & ((reading < possible.low) | (reading > possible.high))
    believed = ~(missing | implausible)
    rows = np.flatnonzero(believed)
    resolution = resolution_of(reading[rows])
    # of a value that is written again and again the first stands for all, but among steps of the log each row counts
    firsts = [np.flatnonzero(np.diff(reading[rows], prepend=np.inf) != 0)]
    firsts += [np.arange(rows.size)] * stairs(reading[rows], resolution, noise)
    for new in (some for some in firsts if some.size >= 3):
        lasting = np.diff(np.append(new, rows.size))
        of_air = np.zeros(new.shape, dtype=bool)
        if felt is not None:
            of_air = _felt(reading[rows[new]], felt, rows[new], noise, resolution)
            # nor what no air does, if both sensors are absurd at once
            of_air &= ~_spikes(reading[rows], new, FARTHEST_SWINGS * swing * share, noise, resolution)
            of_air &= ~_back_at_once(reading[rows[new]], (1.0 - share) ** np.diff(rows[new]), noise, resolution)
        lone = _lone(reading[rows[new]], lasting > 1, of_air, noise, resolution)
        spiked = _spikes(reading[rows], new, swing * share, noise, resolution)
        if lagging is not None and spiked.any():
            spiked &= _spikes(lagging[rows], new, swing * share, noise, resolution)
        implausible[rows] |= np.repeat(lone | (spiked & ~of_air), lasting)
    # what is left of a burst would be one end of a stretch that the rest of the log is the other of
    implausible |= _in_bursts(reading, believed & ~implausible, implausible, swing)
    believed &= ~implausible
    by_steps = stairs(reading[np.flatnonzero(believed)], resolution, noise)
    spikes = implausible & (reading >= possible.low) & (reading <= possible.high)
    surely = lagging if lagging is None or known is None else np.where(known, lagging, np.nan)
    stretches = judge(reading, _place(time_s), believed, resolution, noise, share, swing, surely, spikes, felt)
    implausible |= stretches.from_elsewhere
    believed &= ~implausible
    if implausible.any() and resolution_of(reading[believed]) > (1.0 + OFF_GRID) * resolution:
        # the log's steps are those of its readings, and a code is on none of them
        rest = screen(
            time_s, np.where(believed, reading, np.nan), possible, noise, limit=limit, stale=stale, share=share,
            swing=swing, lagging=lagging, known=known, unsure=unsure, felt=felt,
        )  # fmt: skip
        return replace(rest, missing=missing, implausible=implausible | rest.implausible)
    repeated = np.zeros(reading.shape, dtype=bool)
    rows = np.flatnonzero(believed)
    same_time = np.diff(time_s[rows], prepend=-np.inf) <= 0
    same_value = np.diff(reading[rows], prepend=np.inf) == 0
    # where the resolution is coarser than the noise, equal neighbours are the rule and each tells something
    coarser = np.full(rows.shape, by_steps or resolution >= 1.5 * noise)
    coarser |= _step_by_step(reading[rows], resolution, noise)
    repeated[rows] = same_time | (same_value & ~coarser)
    usable = believed & ~(repeated & ~_by_chance(reading, rows, same_time, same_value, resolution))
    stuck = stretches.stood if by_steps else stretches.stood | stretches.stuck
    usable &= ~stuck
    repeated |= stuck
    if stale is not None:
        repeated |= stale & believed
        usable &= ~stale
    if limit is None:
        stays = within(0.5 * resolution, noise) if by_steps else None
        if by_steps and lagging is not None and _hides(reading[believed], lagging[believed], resolution):
            stays = 0.0  # it is no steady layer, in which noise has them stay
        limit = _ceiling(reading[believed], stays)
    capped = np.zeros(reading.shape, dtype=bool)
    if limit is not None:
        capped = believed & (reading >= limit - 0.5 * resolution)
        usable &= ~capped
    if surely is not None:
        off = np.zeros(rows.size) if unsure is None else unsure[rows]
        dead = _moved_beside(reading[rows], surely[rows], off, share, resolution) & ~capped[rows]
        repeated[rows[dead]], usable[rows[dead]] = True, False
    # over a step of the clock the air went anywhere
    ahead = np.diff(time_s, prepend=time_s[:1])
    changed = np.where(ahead < LONGEST_GAP_S, stretches.own_steps, 0.0)
    return Screened(usable, missing, repeated, implausible, resolution, stretches.louder, capped, changed)


def _place(time_s: Array) -> NDArray[np.int64]:
    """Where rows (n,) would stand in a log that has lost none, by the usual time between two; far apart where a gap
    parts them."""
    step = np.diff(time_s, prepend=time_s[:1])
    usual = float(np.median(step[step > 0.0])) if (step > 0.0).any() else np.inf
    parted = step > _longest_gap(step)
    return np.cumsum(np.where(parted, PARTED_ROWS, np.maximum(np.round(step / usual), 1.0))).astype(np.int64)


def _longest_gap(ahead: Array) -> float:
    """The longest [s] that does not part a log, by the times (n,) from each row to the next."""
    forward = ahead[ahead > 0.0]
    return max(LONGEST_GAP_S, GAP_PERIODS * float(np.median(forward))) if forward.size else LONGEST_GAP_S


def _lone(values: Array, again: Mask, of_air: Mask, noise: float, resolution: float) -> Mask:
    """Which of the values (n,), some of them held for several rows (`again`), stand alone against the median around;
    none that is known to be `of_air` (n,).

    One that does moves the medians of its neighbours, and is left out before these are judged: on a front that goes one
    way none is off its median.
    """
    # the turning point of a fast change is off the median too, but its neighbours share it
    step = np.diff(values, prepend=values[0], append=values[-1])
    sizes = np.stack([np.abs(step[:-1]), np.abs(step[1:])])
    least, most = sizes.min(axis=0), sizes.max(axis=0)
    jump = np.where(again, least, most)
    lone, suspect = np.zeros(values.size, dtype=bool), ~of_air & _unusual(jump, noise, resolution)
    # nor is one alone that lies on the way from one of its neighbours to the other
    suspect &= (step[:-1] * step[1:] <= 0.0) | (least < ON_THE_WAY * most)
    if not suspect.any():
        return lone
    off = np.abs(values - _around(values, MEDIAN_WIDTH))
    # one that is far nearer to those around than it jumped to has only a jump of the air, or a gap, beside it
    suspect &= (jump > 0.5 * off) & (off > ON_THE_WAY * jump) & _unusual(off, noise, resolution)
    while suspect.any():
        off[~suspect] = 0.0
        worst = suspect & (off >= WORST_SHARE * maximum_filter1d(off, MEDIAN_WIDTH, mode="nearest"))
        lone |= worst
        left = np.flatnonzero(~lone)
        around = values[left]
        off[left] = np.abs(around - _around(around, MEDIAN_WIDTH))
        step = np.diff(around, prepend=around[0], append=around[-1])
        on_the_way = np.ones(values.size, dtype=bool)
        on_the_way[left] = (step[:-1] * step[1:] > 0.0) & (off[left] <= LONE_SIGMAS * np.hypot(noise, resolution))
        suspect &= ~on_the_way
        # one that was on the way to the only one around that is out may stand alone now: readings go to it and all the
        # way back; where more are out it is a burst, of which what is left is noise
        back = np.minimum(np.abs(step[:-1]), np.abs(step[1:])) > (1.0 - ON_THE_WAY) * off[left]
        peak = back & (step[:-1] * step[1:] < 0.0)
        beside = maximum_filter1d(lone, 3) & (uniform_filter1d(1.0 * lone, MEDIAN_WIDTH) < 1.5 / MEDIAN_WIDTH)
        suspect[left] |= peak & (beside & ~of_air & _unusual(off, noise, resolution))[left]
    # one between two of them that is as far off goes with them, but not a level that readings stay on
    between = np.pad(lone, 1)[:-2] & np.pad(lone, 1)[2:] & ~lone & ~again
    return np.asarray(lone | (between & (sizes[0] < WORST_SHARE * off)))


def _felt(values: Array, felt: Felt, rows: NDArray[np.int64], noise: float, resolution: float) -> Mask:
    """Which of the values (n,) at some `rows` another sensor felt as much of, beside the median around: those the air
    made."""
    known = np.flatnonzero(np.isfinite(felt.reading[rows]))
    seen = np.zeros(values.size, dtype=bool)
    if known.size:
        other = felt.reading[rows[known]]
        off, beside = (one - _around(one, MEDIAN_WIDTH) for one in (values[known], other))
        unsure = np.sqrt(noise**2 + resolution**2 + felt.noise**2 + felt.resolution**2)
        share = np.divide(beside, off, out=np.zeros(off.shape), where=np.abs(off) > LONE_SIGMAS * unsure)
        # what a sensor in a burst of its own shows is nothing that it felt
        felt_so = np.abs(beside) > FELT_SIGMAS * scatter(other) if known.size > MEDIAN_WIDTH else np.abs(beside) > 0.0
        seen[known] = felt_so & (share > FELT_SHARE) & (share < 1.0 / FELT_SHARE)
    return seen


def _spikes(values: Array, new: NDArray[np.int64], swing: float, noise: float, resolution: float) -> Mask:
    """Which of the values (n,) at the rows `new` (m,), each up to the next, the readings go to and come back from
    farther than they do when the air goes and comes back by `swing` over the sensor's share; of two that are so far
    apart, the one that is farther from the rows around."""
    step = np.diff(values[new])
    out, back = np.append(0.0, step), np.append(-step, 0.0)
    size = np.where(out * back > 0.0, np.minimum(np.abs(out), np.abs(back)), 0.0)
    usual = max(noise, MAD_TO_SIGMA * float(np.median(np.abs(np.diff(values)))))
    most = swing + float(np.hypot(LONE_SIGMAS * usual, SPIKE_STEPS * resolution))
    spiked = size > most
    if spiked.any():
        spiked &= np.abs(values - _around(values, AROUND_WIDTH))[new] > most
    return np.asarray(spiked)


def _back_at_once(values: Array, left: Array, noise: float, resolution: float) -> Mask:
    """Which of the values (n,) the readings go to and come back from by the next, where a lag leaves at least the share
    `left` (n - 1,) of what it has followed: the air would have gone as far beyond where it was before. A row that was
    corrupted is so in both sensors, and a humidity that is made with the temperature goes as the air's would."""
    gone, stayed = np.diff(values)[:-1], values[2:] - values[:-2]
    beyond = LONE_SIGMAS * np.hypot(noise, resolution)
    return np.pad(np.maximum(np.sign(gone) * stayed, 0.0) + beyond < STAYED_SHARE * left[1:] * np.abs(gone), 1)


def _in_bursts(reading: Array, believed: Mask, implausible: Mask, swing: float) -> Mask:
    """Believed readings (n,) beside `implausible` ones, and beside one another from there on, that are farther from
    what was read before and behind than the air goes and comes back: what is left of a burst is none of the air's."""
    found = np.zeros(reading.shape, dtype=bool)
    beside = maximum_filter1d(implausible, 3)
    while True:
        rows = np.flatnonzero(believed & ~found)
        values = reading[rows]
        if rows.size < AROUND_WIDTH or not beside[rows].any():
            return found
        half = AROUND_WIDTH // 2
        sides = np.stack([median_filter(values, AROUND_WIDTH, mode="nearest", origin=end) for end in (half, -half)])
        off = np.maximum(values - sides.max(axis=0), sides.min(axis=0) - values) > swing
        number = np.cumsum(np.diff(off, prepend=False) & off) * off
        more = off & np.isin(number, number[off & beside[rows]])
        if not more.any():
            return found
        found[rows[more]] = True
        beside |= maximum_filter1d(found, 3)


def _around(values: Array, width: int) -> Array:
    """Medians (n,) of so many values about each; at the ends of the log mirrored, or the last value would be its own
    median."""
    return np.asarray(median_filter(values, min(width, values.size), mode="mirror"))


def _unusual(size: Array, noise: float, resolution: float) -> Mask:
    """Which sizes (n,) are beyond what is usual: over the flight, or among the rows before or behind where that is more
    (in a plume, at a cloud's edge)."""
    over_all = LONE_SIGMAS * max(MAD_TO_SIGMA * float(np.median(size)), noise)
    unusual = size > np.hypot(over_all, LONE_SIGMAS * resolution)
    if unusual.any():
        half = (min(AROUND_WIDTH, size.size) - 1) // 2
        beside = [median_filter(size, 2 * half + 1, mode="mirror", origin=side) for side in (half, -half)]
        around = AROUND_SIGMAS * MAD_TO_SIGMA * np.max(beside, axis=0)
        unusual &= size > np.hypot(around, LONE_SIGMAS * resolution)
    return np.asarray(unusual)


def _step_by_step(values: Array, resolution: float, noise: float) -> Mask:
    """Readings (n,) about which more changes in a row are by one step of the log than noise alone makes so: it is less
    there than stated, as a hygrometer's is where the air is dry, and a reading that stays is no repeat."""
    found = np.zeros(values.shape, dtype=bool)
    change = np.diff(values)
    at = np.flatnonzero(change)
    moved, farther = (1.0 - within(steps * resolution, np.sqrt(2.0) * noise) for steps in (0.5, 1.5))
    if not 0.0 < farther < moved:
        return found
    fewest = np.log(BY_CHANCE) / np.log(1.0 - farther / moved)
    single = np.abs(change[at]) < 1.5 * resolution
    bounds = np.concatenate([[0], at + 1, [values.size]])
    for first, behind in np.flatnonzero(np.diff(single, prepend=False, append=False)).reshape(-1, 2).tolist():
        if behind - first >= fewest:
            found[bounds[first] : bounds[behind + 1]] = True
    return found


def _by_chance(reading: Array, rows: NDArray[np.int64], same_time: Mask, same_value: Mask, resolution: float) -> Mask:
    """Single repeats that the resolution explains: two different readings fall on one step as often as there are
    repeats.

    Such a reading tells as much as any other; leaving it out would throw away a tenth of an honest log.
    """
    allowed = np.zeros(reading.shape, dtype=bool)
    changes = np.diff(reading[rows])[~same_value[1:]]
    if changes.size < FEWEST_CHANGES or resolution == 0.0:
        return allowed
    width = MAD_TO_SIGMA * float(np.median(np.abs(changes)))
    expected = min(resolution / (np.sqrt(2 * np.pi) * width), 1.0) if width > 0 else 1.0
    if expected >= 0.5 * np.mean(same_value):
        again = same_value & np.append(False, same_value[:-1])
        allowed[rows[same_value & ~again & ~same_time]] = True
    return allowed


def _ceiling(values: Array, stays: float | None) -> float | None:
    """The largest reading, where more rows hold it than any below it could: the sensor stopped there; else None.

    Among coarse steps a reading `stays` by so much chance at least, and no step holds it as surely as the highest: a
    steady layer is no ceiling, and may be the highest.
    """
    if values.size == 0:
        return None
    level, step = np.unique(values, return_inverse=True)
    held = values[1:] == values[:-1]
    again, rows = (np.bincount(step[:-1], weight, level.size) for weight in (held, None))
    if stays is not None:
        below = rows[:-1] > FEWEST_CHANGES
        chance = max(stays, float(np.max((again[:-1] / np.maximum(rows[:-1], 1.0))[below], initial=0.0)))
        spread = np.sqrt(rows[-1] * chance * max(1.0 - chance, 0.0))
        if again[-1] - rows[-1] * chance <= CEILING_SIGMAS * max(spread, 1.0):
            return None
    enough = again[-1] > max(CAPPED_SHARE * values.size, FEWEST_CAPPED)
    return float(level[-1]) if enough and level.size > 1 else None


def _hides(values: Array, lagging: Array, resolution: float) -> bool:
    """Whether mostly, as readings (n,) stood on the largest of them, what is `lagging` (n,) would have had to move for
    that, by more than steps hide: it was beyond, where the sensor does not go."""
    top = values >= np.max(values, initial=-np.inf) - 0.5 * resolution
    number = np.cumsum(np.diff(top, prepend=False) & top)[top] - 1
    if not number.size:
        return False
    low, high = np.full(number[-1] + 1, np.inf), np.full(number[-1] + 1, -np.inf)
    np.minimum.at(low, number, lagging[top])
    np.maximum.at(high, number, lagging[top])
    return float(np.median((high - low)[number])) > SPIKE_STEPS * resolution


def _moved_beside(values: Array, lagging: Array, unsure: Array, share: float, resolution: float) -> Mask:
    """Readings (n,) that stand on a step while what is `lagging` (n,), relative to that `unsure`, would have had to
    move for that so often that they do not by chance.

    A reading crosses as many steps as it goes in all, to and fro. Within as many rows as a sensor shows `STOOD_SHARE`
    of a step in, if it shows `share` in one, what lags goes on as before and behind them.
    """
    rows = max(int(np.log(1.0 - STOOD_SHARE) / np.log(1.0 - share)), 1) if 0.0 < share < 1.0 else 1
    known, begins = np.isfinite(lagging), np.flatnonzero(np.abs(np.diff(values, prepend=np.inf)) > 0.25 * resolution)
    if values.size <= 3 * rows or not resolution or not known.any():
        return np.zeros(values.size, dtype=bool)
    number = np.cumsum(np.bincount(begins, minlength=values.size)) - 1
    tiny = np.finfo(float).tiny
    log = np.interp(np.arange(values.size), np.flatnonzero(known), np.log(np.maximum(lagging[known], tiny)))
    steps, ends = values / resolution, np.arange(values.size - 3 * rows)[:, None] + rows * np.arange(4)
    before, moved, behind = np.diff(log[ends], axis=1).T
    gone, off = moved - 0.5 * (before + behind), np.median(unsure[ends], axis=1)
    gone = steps[ends[:, 1]] * np.sqrt(np.maximum(gone**2 - off**2, 0.0))
    counts = (number[ends[:, 0]] == number[ends[:, 3]]) & known[ends].all(axis=1)
    crossed = np.bincount(number[ends[:, 0]], np.where(counts, np.minimum(gone, 1.0), 0.0) / rows, begins.size)
    most, least = (of.reduceat(log, begins) for of in (np.maximum, np.minimum))
    crossed[steps[begins] * (most - least) < 1.0] = 0.0
    return np.asarray(crossed[number] > -np.log(BY_CHANCE))


def stairs(values: Array, resolution: float, noise: float = np.inf) -> bool:
    """Whether readings, where they change, mostly do so by one step of the log: whatever noise is stated, the steps are
    coarser, and a reading that stays is no repeat. Or whether they mostly stay, as the noise has it."""
    change = np.abs(np.diff(values))
    if resolution > COARSE_IN_NOISE * noise and np.mean(change == 0.0) > 0.5:
        return True
    change = change[change > 0.0]
    return change.size >= FEWEST_CHANGES and float(np.median(change)) < 1.5 * resolution


def resolution_of(values: Array) -> float:
    """Smallest step between the values that occur, or the step of the grid that nearly all of them lie on (what was put
    in between is on no step of the log), or the usual one where readings go from one value to the next and the steps
    between are uneven, or of those that occur again where that many do; 0 where there is but one."""
    values = np.round(values[:20000], 9)
    every, counts = np.unique(values, return_counts=True)
    levels, again = every, np.flatnonzero(counts > 1)
    if grid := _grid(values, levels, counts):
        return grid
    if counts[again].sum() > REPEATED_SHARE * counts.sum() and (again.size >= FEWEST_LEVELS or _steps(counts, again)):
        levels = levels[again]
    steps = np.diff(levels)
    if not steps.size:
        return 0.0
    along = np.diff(np.searchsorted(every, values))  # levels that readings go by
    if (
        levels.size >= FEWEST_LEVELS
        and values.size >= ON_A_STEP * every.size
        and np.median(np.abs(along[along != 0])) == 1
    ):
        # from one level to the next there is nothing between, however uneven they are
        return float(np.median(np.abs(np.diff(values))[np.abs(along) == 1]))
    step = float(np.quantile(steps, 0.05, method="lower"))
    taken = np.count_nonzero(np.abs(np.abs(np.diff(values)) / step - 1.0) < OFF_GRID)
    if levels.size < FEWEST_LEVELS and taken < FEWEST_CHANGES:
        # levels that the air went between once are steps apart that nobody saw; all are multiples of the step, those
        # that occurred once as well, unless they are on none
        of_some, of_all = (float(np.gcd.reduce(np.round(v * 1e9).astype(np.int64))) / 1e9 for v in (levels, every))
        step = of_all if of_all > OFF_GRID * of_some else of_some
    return step


def _grid(values: Array, levels: Array, counts: NDArray[np.int64]) -> float:
    """Step of the coarsest grid that most readings lie on; 0 where there is none.

    At least half of its lines are held, each by many readings, which go from one line to the next often enough; on
    every second line of a grid lies half of what is on it.
    """
    often, again = int(counts.max(initial=0)), counts > 1
    # those that are held most have fewer between them that are on no step
    most_held = counts >= np.median(counts[again]) if again.any() else again
    steps = [np.unique(np.round(np.diff(levels[some]), 9))[::-1] for some in (again, most_held)]
    for step in np.concatenate(steps).tolist():
        line = (levels - levels[np.argmax(counts)]) / step
        on = np.abs(line - np.round(line)) < OFF_GRID
        held, of_level = np.unique(np.round(line[on]), return_inverse=True)
        most = np.zeros(held.size)
        np.maximum.at(most, of_level, counts[on])  # one level a line: calm air lies near a line of any wide grid
        if most.sum() < ENOUGH_SHARE * counts.sum() or held.size < 3:
            continue
        if most.sum() - often < REPEATED_SHARE * (counts.sum() - often):
            continue  # one level, that a stuck sensor stays on, is no grid
        if _beyond_chance(levels, step, counts):
            return float(step)
        if most.sum() < ON_A_STEP * held.size:
            continue
        if held.size < BESIDE_ONE_ANOTHER * (held[-1] - held[0]):
            continue
        if np.count_nonzero(np.abs(np.abs(np.diff(values)) / step - 1.0) < OFF_GRID) >= FEWEST_CHANGES:
            return float(step)
    return 0.0


def _beyond_chance(levels: Array, step: float, counts: NDArray[np.int64]) -> bool:
    """Whether more levels than chance explains lie exactly on the grid through the one with most readings, if the log's
    steps were finer."""
    line = (levels - levels[np.argmax(counts)]) / step
    exact = int(np.count_nonzero(np.abs(line - np.round(line)) < GRID_ROUNDING)) - 1
    share = float(np.quantile(np.diff(levels), 0.05, method="lower")) / step
    if share >= ENOUGH_SHARE:
        return False
    return bool(bdtrc(exact - 1, levels.size - 1, share) < BY_CHANCE_ON_GRID)


def _steps(counts: NDArray[np.int64], some: NDArray[np.int64]) -> bool:
    """Whether some of the levels that occur so often are a log's steps, and hold many readings each."""
    if some.size == 2 and counts.size >= FEWEST_LEVELS:  # a calm room on either side of a door, beside a burst
        return float(counts[some].min()) >= ON_A_STEP
    return some.size >= 3 and float(counts[some].mean()) >= ON_A_STEP
