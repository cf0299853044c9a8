"""How far passes of one flight disagree, as read and as a model corrects them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from shockrig.analysis.learn.density import LAYER_SHARE, MOVES, FlightChannelData, SensorModel, air_of
from shockrig.analysis.learn.flights_fit import Learned

Array = NDArray[np.float64]

LAYERS = 25  # of a flight, at which passes are held beside one another
LEAST_LAYERS = 3
GAIN_LEVEL = 0.9  # of the interval in which a next flight's gain lies
SCATTER_FLIGHTS = 4.0  # that what is known of gains' scatter counts for


@dataclass(frozen=True)
class Disagreement:
    """Later pass less the earlier one at layers [K or %RH]: all of them, and the flight of each (l,); NaN where a model
    places one of the passes elsewhere."""

    flight: tuple[str, ...]
    altitude_m: Array
    off: Array

    @property
    def layers(self) -> int:
        """How many it is known at."""
        return int(np.isfinite(self.off).sum())

    def where(self, other: Disagreement) -> Disagreement:
        """The same where another one of the same passes is known."""
        return replace(self, off=np.where(np.isfinite(other.off), self.off, np.nan))

    @property
    def rms(self) -> float:
        """Root mean square."""
        return float(np.sqrt(np.nanmean(self.off**2))) if self.layers else float("nan")

    @property
    def mean(self) -> float:
        """Mean, with its sign."""
        return float(np.nanmean(self.off)) if self.layers else float("nan")

    def of(self, name: str) -> Disagreement:
        """That of one flight."""
        mine = np.array([one == name for one in self.flight])
        return Disagreement((name,) * int(mine.sum()), self.altitude_m[mine], self.off[mine])

    @property
    def spread(self) -> float:
        """Standard deviation about each flight's own mean."""
        known = np.isfinite(self.off)
        if not known.any():
            return float("nan")
        names, off = np.array(self.flight)[known], self.off[known]
        left = off - np.array([off[names == name].mean() for name in names])
        return float(np.sqrt(np.mean(left**2)))


@dataclass(frozen=True)
class NearerPasses:
    """How far apart passes of a next flight are, over how far they are as read: median and a 90 % interval."""

    ratio: float
    low: float
    high: float


def refutes(read: Disagreement, corrected: Disagreement) -> bool:
    """Whether the structure of the passes refutes a correction: they are less alike with it than as read.

    A response that is right brings kinks and layers of two passes together. A mean difference may be the air's or an
    offset, and does not count. Flights do, each as much as another, by how far they agree that it got worse (Student's
    of the logarithm of what it got worse by, 95 %). One flight refutes nothing: it cannot be left out of the fit.
    """
    read = read.where(corrected)
    names = [name for name in sorted(set(read.flight)) if read.of(name).spread > 0.0]
    if len(names) < 2:
        return False
    worse = np.log([max(corrected.of(name).spread / read.of(name).spread, 1e-3) for name in names])
    return bool(worse.mean() > stdtrit(worse.size - 1.0, 0.95) * worse.std(ddof=1) / np.sqrt(worse.size))


def gain_of(read: Disagreement, corrected: Disagreement) -> NearerPasses | None:
    """By how much a correction brings passes of a next flight together, from flights that were not fitted: Student's
    interval of the logarithm of one more ratio. None where fewer than two flights say.

    An rms of k independent layers scatters by 1 / sqrt(2 k) of itself, and a ratio of two by twice that variance: so
    much is known before any flight, and counts as `SCATTER_FLIGHTS` more of them (conjugate prior of a variance).
    """
    read = read.where(corrected)
    names = [name for name in sorted(set(read.flight)) if read.of(name).rms > 0.0]
    if len(names) < 2:
        return None
    nearer = np.log([max(corrected.of(name).rms / read.of(name).rms, 1e-3) for name in names])
    freedom = SCATTER_FLIGHTS + nearer.size - 1.0
    scatter = np.sqrt((SCATTER_FLIGHTS * LAYER_SHARE + nearer.size * nearer.var()) / freedom)
    wide = stdtrit(freedom, 0.5 + 0.5 * GAIN_LEVEL) * scatter * np.sqrt(1.0 + 1.0 / nearer.size)
    return NearerPasses(*(float(np.exp(nearer.mean() + by)) for by in (0.0, -wide, wide)))


def disagreement(units: Sequence[FlightChannelData], fit: Learned | None, channel: str) -> Disagreement:
    """How far neighbouring passes disagree: as read where there is no fit, else by a fit without that flight.

    Layers that a pass did not meet as the model places it are left out, since the air beyond is guessed: a clock moves
    the track. Its air has the sizes that are usual in the others. A flight that is the only one cannot be left out:
    what it disagrees by is then of the fit to itself.
    """
    names: list[str] = []
    heights, off = [], []
    for i, unit in enumerate(units):
        if fit is None:
            sensor, own = SensorModel((), {}), None
        else:
            first = fit.channels.index(channel)
            others = [k for k in range(first, first + len(units)) if k != first + i]
            theta = fit.without(first + i) if others else fit.theta
            sensor, own = fit.sensor(theta, channel), np.median([fit.sizes[k] for k in others or [first]], axis=0)
        passed_m = sensor.meets(unit).altitude.mean(axis=1)[unit.rows]
        profiles: list[tuple[float, float, NDArray[np.int64]] | None] = []
        for one in unit.bins.passes:
            rows = np.flatnonzero((unit.rows >= one.first) & (unit.rows <= one.last))
            if rows.size < LEAST_LAYERS:
                profiles.append(None)
                continue
            altitude = unit.bins.altitude_m[unit.rows[rows]]
            profiles.append((float(altitude.min()), float(altitude.max()), rows))
        layers = np.linspace(unit.knots[0], unit.knots[-1], LAYERS + 1)
        middle = 0.5 * (layers[1:] + layers[:-1])
        for before, after in zip(profiles[:-1], profiles[1:], strict=True):
            if before is None or after is None:
                continue
            both = middle[(middle > max(before[0], after[0])) & (middle < min(before[1], after[1]))]
            if both.size < LEAST_LAYERS:
                continue
            values = [_profile(unit, sensor, own, part[2], both) for part in (before, after)]
            met = [(both > passed_m[part[2]].min()) & (both < passed_m[part[2]].max()) for part in (before, after)]
            off.append(np.where(met[0] & met[1], unit.unit * (values[1] - values[0]), np.nan))
            heights.append(both)
            names.extend([unit.bins.name] * both.size)
    none = [np.array([])]
    return Disagreement(tuple(names), np.concatenate(heights or none), np.concatenate(off or none))


def _profile(
    unit: FlightChannelData, sensor: SensorModel, own: Array | None, rows: NDArray[np.int64], at: Array
) -> Array:
    """A pass's profile at altitudes, over the channel's unit: of its readings alone, corrected by a model."""
    if own is None:
        altitude = unit.bins.altitude_m[unit.rows[rows]]
        order = np.argsort(altitude)
        return np.interp(at, altitude[order], unit.reading[rows][order])
    still = own.copy()
    still[-MOVES:] = 0.0
    return air_of(unit, sensor, still, rows, at)
