"""A flight as learning sees it: a few hundred bins in time, its track, and its passes through the same air."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects.of_flight import airflow_m_s
from shockrig.analysis.estimate.without_model import MAD_TO_SIGMA
from shockrig.analysis.flight.undo_readout import coarse_track, vertical_speed
from shockrig.files.flight import Flight
from shockrig.files.legs import least_leg_m, legs
from shockrig.files.ranges import RANGES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REFERENCE_TEMPERATURE_C = 20.0  # of a usual day, and at which laws of temperature are stated
CHANNELS = ("temperature", "humidity")
SUB_SAMPLES = 4  # of the track in a bin, over which what the air adds is averaged
GROUND_SHARE = 0.03  # of the range of altitudes: what is nearer to the ground is not flown, satellite heights wander
LEAST_PASS_M = 20.0  # that a pass covers at least
# Satellites' altitudes wander by as much, slower than this; a track that goes faster is told from them earlier.
WANDER_M_S, LEAST_FAST_PASS_M = 0.3, 2.0
FASTEST_SHARE = 0.1  # of a track's time, by whose speed it counts as fast
FEWEST_BINS = 24
OUTLIER_SIGMAS = 6.0  # of the readings around: a reading further from their median is not one
MEDIAN_READINGS = 7  # readings of which that is the median


@dataclass(frozen=True)
class Pass:
    """One way through the air: rows `first` to `last` of the bins (both in it), and its mean vertical speed [m/s]."""

    first: int
    last: int
    climb_m_s: float

    @property
    def rows(self) -> slice:
        """The bins of the pass."""
        return slice(self.first, self.last + 1)


@dataclass(frozen=True)
class FlightBins:
    """A flight in n bins; NaN where nothing was read.

    Attributes
    ----------
    name : str
    time_s, length_s : ndarray (n,)
        Middle of each bin, and how long it is.
    within_s : ndarray (n, SUB_SAMPLES)
        Times in each bin at which the track is taken.
    track_s, track_m : ndarray (r,)
        Altitude as logged.
    altitude_m : ndarray (n,)
    speed_s, speed_m_s : ndarray (v,)
        Vertical speed of the track.
    airspeed_m_s : ndarray (n,)
        Mean of what was logged.
    values : mapping of channel -> ndarray (n,)
        Means of the readings.
    passes : tuple of Pass
    sensors : tuple of FlightBins
        Of a flight with several sensors side by side: each with bins of its own, which stand here one sensor's behind
        another's. Empty with one.
    """

    name: str
    time_s: Array
    length_s: Array
    within_s: Array
    track_s: Array
    track_m: Array
    altitude_m: Array
    speed_s: Array
    speed_m_s: Array
    airspeed_m_s: Array
    values: Mapping[str, Array]
    passes: tuple[Pass, ...]
    sensors: tuple[FlightBins, ...] = ()

    @cached_property
    def begins(self) -> tuple[int, ...]:
        """The first bin of each sensor."""
        return tuple(np.cumsum([0, *(one.time_s.size for one in self.sensors[:-1])]).tolist())

    def seen(self, channel: str) -> Mask:
        """Bins in which the channel was read (n,)."""
        return np.isfinite(self.values[channel])

    def has(self, channel: str) -> bool:
        """Whether there is enough of a channel to learn from."""
        return int(self.seen(channel).sum()) >= FEWEST_BINS

    @cached_property
    def bead_c(self) -> Array:
        """The bead's reading (n,) with gaps bridged; a usual day where there is none [degC]."""
        if self.sensors:
            return np.concatenate([one.bead_c for one in self.sensors])
        value = self.values["temperature"]
        good = np.isfinite(value)
        if not good.any():
            return np.full(value.size, REFERENCE_TEMPERATURE_C)
        return np.interp(self.time_s, self.time_s[good], value[good])

    @cached_property
    def bead_k_s(self) -> Array:
        """How fast the bead's reading goes (n,) [K/s]."""
        if self.sensors:
            return np.concatenate([one.bead_k_s for one in self.sensors])
        return np.gradient(self.bead_c, self.time_s)

    @property
    def bead_within_c(self) -> Array:
        """The bead's reading at each of `within_s` (n, SUB_SAMPLES) [degC]."""
        if self.sensors:
            return np.concatenate([one.bead_within_c for one in self.sensors])
        return np.interp(self.within_s, self.time_s, self.bead_c)

    @property
    def within_altitudes(self) -> Array:
        """Altitude at each of `within_s` (n, SUB_SAMPLES) [m]."""
        return np.interp(self.within_s, self.track_s, self.track_m)

    def climb_within_m_s(self, shift_s: float = 0.0) -> Array:
        """Vertical speed at each of `within_s` (n, SUB_SAMPLES) [m/s], of a track whose time is behind by `shift_s`."""
        return np.interp(self.within_s + shift_s, self.speed_s, self.speed_m_s)

    def airflow_within_m_s(self, shift_s: float = 0.0) -> Array:
        """Airflow past the sensor at each of `within_s` (n, SUB_SAMPLES) [m/s]."""
        return airflow_m_s(self.airspeed_m_s[:, None], self.climb_within_m_s(shift_s))

    @property
    def minutes(self) -> float:
        """How long was flown."""
        return float(np.ptp(self.time_s)) / 60.0


def why_nothing(flight: Flight) -> str:
    """Why nothing can be learned of a flight, in a sentence; empty where something may."""
    if flight.altitude_m is None or np.isfinite(flight.altitude_m).sum() < FEWEST_BINS:
        return "no altitude was found in it (--column altitude=NAME), so nobody knows which air was passed twice"
    at = np.isfinite(flight.altitude_m) & np.isfinite(flight.time_s)
    known = flight.altitude_m[at]
    time_s, first = np.unique(flight.time_s[at], return_index=True)
    if np.ptp(known) < 2.0 * least_pass_m(time_s, known[first]):
        return f"its altitudes are within {np.ptp(known):.0f} m, so no air was passed twice"
    if not any(np.isfinite(x).sum() >= FEWEST_BINS for x in (flight.temperature_c, flight.humidity_percent)):
        return "it has no temperature and no humidity"
    return ""


def binned(flight: Flight, name: str, count: int) -> FlightBins:
    """A flight in at most `count` bins, as many to the time as to the metres that were flown.

    Raises
    ------
    ValueError
        Nothing can be learned of the flight (see `why_nothing`).
    """
    why = why_nothing(flight)
    if why:
        raise ValueError(f"{name}: {why}")
    assert flight.altitude_m is not None
    order = np.argsort(flight.time_s, kind="stable")
    time = flight.time_s[order]
    known = np.isfinite(flight.altitude_m[order]) & np.isfinite(time)
    known[known] = np.diff(time[known], prepend=-np.inf) > 0
    track_s, track_m = time[known], _without_outliers(flight.altitude_m[order][known])
    track_s, track_m = track_s[np.isfinite(track_m)], track_m[np.isfinite(track_m)]
    begins, ends = flown_span(track_s, track_m)
    readings = int(np.count_nonzero((time >= begins) & (time <= ends)))
    inside = (track_s >= begins) & (track_s <= ends)
    edges = _edges(track_s[inside], track_m[inside], max(FEWEST_BINS, min(count, readings // 2)))
    # A bin holds whole readings, each with the time around it: its mean is then that of its time.
    read = np.unique(time[np.isfinite(flight.temperature_c[order]) | np.isfinite(flight.humidity_percent[order])])
    between = np.r_[read[0], 0.5 * (read[1:] + read[:-1]), read[-1]]
    edges = np.unique(between[np.clip(np.searchsorted(between, edges), 0, between.size - 1)])
    middle = 0.5 * (edges[1:] + edges[:-1])
    place = (np.arange(SUB_SAMPLES) + 0.5) / SUB_SAMPLES
    within = edges[:-1, None] + np.diff(edges)[:, None] * place
    bin_of = np.searchsorted(edges, time, side="right") - 1
    used = (bin_of >= 0) & (bin_of < middle.size)

    def mean(values: Array) -> Array:
        good = used & np.isfinite(values)
        number = np.bincount(bin_of[good], minlength=middle.size)
        total = np.bincount(bin_of[good], weights=values[good], minlength=middle.size)
        return np.where(number > 0, total / np.maximum(number, 1), np.nan)

    columns = {"temperature": flight.temperature_c[order], "humidity": flight.humidity_percent[order]}
    values = {key: mean(_plausible(key, column)) for key, column in columns.items()}
    altitude = np.interp(within, track_s, track_m).mean(axis=1)
    speed_s, speed_m_s = vertical_speed(track_s, track_m)
    airspeed = mean(np.where(flight.airspeed_m_s[order] >= 0, flight.airspeed_m_s[order], np.nan))
    return FlightBins(
        name=name,
        time_s=middle,
        length_s=np.diff(edges),
        within_s=within,
        track_s=track_s,
        track_m=track_m,
        altitude_m=altitude,
        speed_s=speed_s,
        speed_m_s=speed_m_s,
        airspeed_m_s=airspeed,
        values=values,
        passes=passes(altitude, middle, least_pass_m(track_s, track_m)),
    )


def _edges(at: Array, metres: Array, bins: int) -> Array:
    """Edges of bins (bins + 1,) along a track: half of their measure is time and half is way, so that neither a hover
    nor a fast descent is left without them."""
    smooth = np.interp(at, *coarse_track(at, metres))
    way = np.r_[0.0, np.cumsum(np.abs(np.diff(smooth)))]
    measure = (at - at[0]) / max(np.ptp(at), 1e-9) + way / max(way[-1], 1e-9)
    return np.interp(np.linspace(0.0, 2.0, bins + 1), measure, at)


def side_by_side(first: FlightBins, second: FlightBins) -> FlightBins:
    """One flight of two sensors in the same air: the second's bins behind the first's, on the first's track."""
    count = first.time_s.size
    behind = [replace(one, first=one.first + count, last=one.last + count) for one in second.passes]
    within = np.concatenate([first.within_s, second.within_s])
    return replace(
        first,
        time_s=np.concatenate([first.time_s, second.time_s]),
        length_s=np.concatenate([first.length_s, second.length_s]),
        within_s=within,
        altitude_m=np.interp(within, first.track_s, first.track_m).mean(axis=1),
        airspeed_m_s=np.concatenate([first.airspeed_m_s, second.airspeed_m_s]),
        values={key: np.concatenate([first.values[key], second.values[key]]) for key in first.values},
        passes=(*first.passes, *behind),
        sensors=(first, second),
    )


def least_pass_m(track_s: Array, track_m: Array) -> float:
    """How many metres a pass has at least, by how fast a track at times that run forward goes up and down."""
    at, metres = coarse_track(track_s, track_m)
    speed = np.abs(np.gradient(metres, at)) if at.size > 1 else np.zeros_like(at)
    fast = np.interp(np.linspace(at[0], at[-1], 1000), at, speed)
    return LEAST_FAST_PASS_M if np.quantile(fast, 1.0 - FASTEST_SHARE) > WANDER_M_S else LEAST_PASS_M


def passes(altitude_m: Array, time_s: Array, least_m: float = LEAST_PASS_M) -> tuple[Pass, ...]:
    """The ways up and down of a track, between turns that are a share of its range of altitudes apart."""
    least, found = least_leg_m(altitude_m, least_m), []
    for first, last in legs(altitude_m, least_m):
        rise = altitude_m[last] - altitude_m[first]
        if abs(rise) >= least and last > first:
            found.append(Pass(first, last, float(rise / (time_s[last] - time_s[first]))))
    return tuple(found)


def flown_span(track_s: Array, track_m: Array) -> tuple[float, float]:
    """From when to when the track is off the ground."""
    low = float(np.quantile(track_m, 0.005))
    over = np.flatnonzero(track_m > low + GROUND_SHARE * float(track_m.max() - low))
    return float(track_s[over[0]]), float(track_s[over[-1]])


def _plausible(channel: str, values: Array) -> Array:
    """Readings within what the quantity can be, without single ones far from those around."""
    bounds = RANGES["temperature_c" if channel == "temperature" else "humidity_reading_percent"]
    good = np.where((values >= bounds.low) & (values <= bounds.high), values, np.nan)
    return _without_outliers(good)


def _without_outliers(values: Array) -> Array:
    from scipy.ndimage import median_filter

    good = np.isfinite(values)
    if good.sum() < MEDIAN_READINGS:
        return values
    kept = values[good]
    off = np.abs(kept - median_filter(kept, MEDIAN_READINGS, mode="nearest"))
    spread = MAD_TO_SIGMA * float(np.median(off[off > 0])) if (off > 0).any() else 0.0
    usual = np.maximum(median_filter(off, 101, mode="nearest"), spread)
    out = values.copy()
    out[np.flatnonzero(good)[off > np.maximum(OUTLIER_SIGMAS * usual, 1e-9)]] = np.nan
    return out
