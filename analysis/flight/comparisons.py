"""What a flight says about its own correction: ascent against descent, the slow sensor against the fast one.

Air that was passed upwards and downwards is the same air. A sensor whose time scale is 1 + e of what the profile says
leaves -e times the lag in the corrected value, of opposite sign on the two ways: the difference between them, against
the difference of the lags, is e. An inversion that rose between the two ways looks the same, in temperature as well:
where the fast sensor's difference goes with the lag that the slow one would have behind it, the air moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d

from shockrig.analysis.flight.channel import FlightChannel, bridged
from shockrig.analysis.flight.disagreement import Difference, causes, excess, explained
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.flight.sweep import lags_behind
from shockrig.analysis.physics.humidity import STANDARD_PRESSURE_HPA
from shockrig.files.flight import Flight

Array = NDArray[np.float64]
LEAST_CLIMB_M = 40.0  # that both ways have in common
LEAST_SPEED_M_S = 0.3
SPEED_OVER_S = 5.0
MOST_LAYERS = 60  # at most
FEWEST_LAYERS = 10
ROWS_A_LAYER = 2  # of either way, at least
TELLING_LAYERS = 30  # from which a time scale is told
EDGE_LAYERS = 20  # one in so many layers is left out at either end
JACKKNIFE_BLOCKS = 20  # of layers, left out in turn (jackknife): none holds a whole front
SURE_SIGMAS = 4.0  # standard errors from which a time scale counts as wrong
WHITE_VARIANCE = 0.05  # variance of a layer's mean beside it, in units of turbulence between neighbouring layers
BEYOND_STATED = 3.0  # times what the profile states
EXPLAINED_SHARE = 0.2  # of the difference's variance; less is the air's own, which changes between the two ways
MOST = 1.0
LARGEST_STEP = 0.5
WORSE_RATIO = 1.02  # times what ascent and descent of the readings differ by
SURE_BESIDE_AIR = 3.0  # the same where all that the air may have moved counts as error
PARTED = "the correction makes ascent and descent disagree more"
UNITS = {"temperature": "K", "humidity": "%RH"}


@dataclass(frozen=True)
class UpAndDown:
    """Ascent against descent: layers in common, rms difference as read and as corrected, the relative error of the time
    scale that explains it best, that number's standard error, the share of the difference's variance explained, and the
    rms difference that this time scale would leave."""

    layers: int
    low_m: float
    high_m: float
    read: float
    corrected: float
    slower: float
    slower_error: float
    explained: float
    left: float

    @property
    def agree_better(self) -> bool:
        """Whether the ways come together by the time scale that explains how their difference goes with the lag's.

        Air that changed between the ways is in the lag as it is in the air, since a slow reading shows little of it:
        their difference goes with the lag's as if the sensor were instantaneous, beside a constant that undoes it.
        """
        return self.left < self.corrected


@dataclass(frozen=True)
class Told:
    """How much slower a sensor is than its profile says, relative, and that number's standard error."""

    slower: float
    error: float


def up_and_down(flight: Flight, channel: FlightChannel) -> UpAndDown | None:
    """Compare the longest way up with the longest way down; None where the flight has not both through one layer."""
    if channel.raw.all():
        return None
    found = _layered(flight, (channel.value, channel.value - channel.lag, channel.lag))
    if found is None:
        return None
    low, high, (corrected, read, lag) = found
    slower, error = _slope(lag, corrected) if lag.size >= TELLING_LAYERS else (0.0, np.inf)
    size = [float(np.sqrt(np.mean(v**2))) for v in (read, corrected)]
    explained = float(np.corrcoef(lag, corrected)[0, 1] ** 2) if np.ptp(lag) and np.ptp(corrected) else 0.0
    left = float(np.sqrt(np.mean((corrected - slower * lag) ** 2)))
    return UpAndDown(lag.size, low, high, size[0], size[1], -slower, error, explained, left)


def _layered(flight: Flight, columns: Sequence[Array], sign: float = -1.0) -> tuple[float, float, Array] | None:
    """Means of columns in the layers that the longest way up and the longest way down have in common, from what height
    to what, descent less ascent (c, layers), or with `sign` 1 plus ascent; None where there are no such layers."""
    height = _height(flight)
    if height is None:
        return None
    ways = [_longest(flight.time_s, height, sign) for sign in (1.0, -1.0)]
    count = min(MOST_LAYERS, *((way.stop - way.start) // ROWS_A_LAYER for way in ways))
    if count < FEWEST_LAYERS:
        return None
    low = max(float(height[way].min()) for way in ways)
    high = min(float(height[way].max()) for way in ways)
    if high - low < LEAST_CLIMB_M:
        return None
    edges = np.linspace(low, high, count + 1)
    means = np.array([[_layers(height[way], v[way], edges) for v in (height, *columns)] for way in ways])
    known = np.isfinite(means).all(axis=(0, 1))
    outer = -(-count // EDGE_LAYERS)
    known[:outer] = known[-outer:] = False  # where the flight begins, and where it turns
    if np.count_nonzero(known) < max(count // 2, FEWEST_LAYERS - 2):
        return None
    # samples of the two ways do not lie at the same heights within a layer
    at = means[:, 0, known].mean(axis=0)
    level = [[np.interp(at, way[0, known], values) for values in way[1:, known]] for way in means]
    return low, high, np.array(level[1]) + sign * np.array(level[0])


def compared(
    flight: Flight, bead: FlightChannel, film: FlightChannel, notes: list[str], known: Told | None = None
) -> tuple[FlightChannel, FlightChannel, dict[str, float]]:
    """The channels, their uncertainty widened where the flight contradicts the profile's time scale; what was compared
    goes into `notes`, with what of the film's is `known` and was corrected with."""
    found, widened = [], {}
    if known is not None:
        notes.append(
            f"humidity: ascent and descent agree if the sensor is {_way(known.slower)} than the profile says, to "
            f"within {100 * known.error:.1g} %, and temperature shows that the air stayed as it was: corrected with "
            "that; characterize the sensor again"
        )
    for channel in (bead, film):
        both = up_and_down(flight, channel)
        if both is not None:
            unit = UNITS[channel.name]
            notes.append(
                f"{channel.name}: ascent and descent differ by {both.read:.2g} {unit} rms as read, by "
                f"{both.corrected:.2g} {unit} corrected ({both.low_m:.0f} to {both.high_m:.0f} m)"
            )
            stated = _stated(channel)
            wrong = min(abs(both.slower), MOST)
            sure = wrong > SURE_SIGMAS * both.slower_error and both.explained > EXPLAINED_SHARE
            if sure and wrong > BEYOND_STATED * stated and both.agree_better:
                notes.append(
                    f"{channel.name}: they agree best if the sensor is {_way(both.slower)} than the profile "
                    f"says (which states {100 * stated:.1g} %): uncertainties are widened by as much of the lag; "
                    "characterize the sensor again"
                )
                channel = channel.widened(wrong)
                widened[channel.name] = wrong
            doubted = _owned(flight, bead, channel, notes)
            if both.corrected > WORSE_RATIO * both.read:
                owned = doubted is not channel or channel.name in widened
                notes.insert(
                    0,
                    f"{channel.name}: {PARTED}, {both.corrected:.2g} {unit} instead of the {both.read:.2g} {unit} of "
                    "the readings: use the readings, which stand beside it in what was written, "
                    + ("until the cause is found" if owned else "unless the air itself changed between the two ways"),
                )
            channel = doubted
        found.append(channel)
    return found[0], found[1], widened


def _owned(flight: Flight, bead: FlightChannel, channel: FlightChannel, notes: list[str]) -> FlightChannel:
    """The channel with uncertainties as wide as ascent and descent disagree, and what may be the cause in `notes`."""
    found = causes(flight, bead, channel)
    stated = np.where(np.isfinite(channel.value), channel.total_uncertainty, np.nan) ** 2
    less = _layered(flight, (channel.value, *(cause.moves for cause in found)))
    plus = _layered(flight, (stated,), 1.0)
    if less is None or plus is None or less[2].shape[1] != plus[2].shape[1]:
        return channel
    difference, *moved = less[2]
    beyond = excess(Difference(difference, plus[2][0]))
    if not beyond:
        return channel
    unit, wider = UNITS[channel.name], float(np.sqrt(beyond / 2.0))
    cause = explained(difference, moved, found)
    notes.append(
        f"{channel.name}: ascent and descent disagree by more than turbulence and the stated uncertainty explain: the "
        f"sensor is not as the profile has it, or the air changed; uncertainties are widened by {wider:.2g} {unit}"
        + (f"; likely {cause}" if cause else "")
    )
    return channel.doubted(wider)


def _way(slower: float) -> str:
    return f"{100 * min(abs(slower), MOST):.0f} % {'slower' if slower > 0 else 'faster'}"


def told(flight: Flight, bead: FlightChannel, film: FlightChannel, before: Told | None = None) -> Told | None:
    """What ascent and descent say of the film's time scale, beside what they said `before`; None where nothing.

    Where temperature does not show whether the air stayed as it was between the two ways, nothing is said.
    """
    both, air = up_and_down(flight, film), bridged(flight.time_s, bead.value)
    if both is None or air is None or film.response is None:
        return before
    lags, _ = lags_behind(air, film.response, typical_period(flight.time_s))
    shown = (lags * film.response.weight).sum(axis=1)
    moved = up_and_down(flight, replace(bead, lag=air - shown))
    if moved is None:
        return before
    # as far as the air itself may have moved
    slower, error = both.slower, float(np.linalg.norm([both.slower_error, moved.slower_error, moved.slower]))
    if before is not None:
        whole = (1.0 + before.slower) * (1.0 + slower) - 1.0
        # where it does not come to rest, the time scale is not what is wrong
        return Told(whole, error) if abs(slower) < LARGEST_STEP else None
    sure = abs(slower) > SURE_BESIDE_AIR * error and both.explained > EXPLAINED_SHARE
    # at first order: more than this is left to the next round
    slower = float(np.clip(slower, -LARGEST_STEP, LARGEST_STEP))
    sure = sure and both.agree_better and abs(slower) > BEYOND_STATED * _stated(film)
    return Told(slower, error) if sure else None


def _height(flight: Flight) -> Array | None:
    """Of each row, where the log has no altitude that of its pressure in the standard atmosphere; None without
    either."""
    height = None if flight.altitude_m is None else bridged(flight.time_s, flight.altitude_m)
    pressure = bridged(flight.time_s, flight.pressure_hpa) if height is None else None
    if pressure is None:
        return height
    return np.asarray(44_330.8 * (1.0 - (median_filter(pressure, 3) / STANDARD_PRESSURE_HPA) ** 0.190263))


def _stated(channel: FlightChannel) -> float:
    """Relative uncertainty of the time scale that the channel's own has in it, rms over the flight."""
    known = np.isfinite(channel.common) & np.isfinite(channel.lag) & ~channel.raw
    lag = float(np.sum(channel.lag[known] ** 2))
    return float(np.sqrt(np.sum(channel.common[known] ** 2) / lag)) if lag > 0 else 0.0


def _longest(time_s: Array, height: Array, sign: float) -> slice:
    """The rows of the longest climb (or descent)."""
    width = max(round(SPEED_OVER_S / typical_period(time_s)), 1)
    smooth = uniform_filter1d(height, width, mode="nearest")
    step = np.diff(time_s, prepend=time_s[0] - typical_period(time_s))
    moving = sign * np.diff(smooth, prepend=smooth[0]) > LEAST_SPEED_M_S * np.maximum(step, 1e-9)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], moving.astype(int), [0]])))
    starts, stops = ends[::2], ends[1::2]
    if not starts.size:
        return slice(0, 0)
    longest = int(np.argmax(np.abs(smooth[stops - 1] - smooth[starts])))
    return slice(int(starts[longest]), int(stops[longest]))


def _layers(height: Array, values: Array, edges: Array) -> Array:
    """Mean of the values in each layer, NaN where there is none."""
    place = np.digitize(height, edges) - 1
    inside = (place >= 0) & (place < edges.size - 1) & np.isfinite(values)
    count = np.bincount(place[inside], minlength=edges.size - 1)
    total = np.bincount(place[inside], values[inside], minlength=edges.size - 1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _slope(x: Array, y: Array) -> tuple[float, float]:
    """Slope of y against x beside a constant, and its standard error from leaving out blocks in turn.

    What else is in y is turbulence, whose structure function grows as the distance to 2/3 (generalised least squares).
    """
    place = np.arange(x.size)
    shared = x.size ** (2 / 3) - np.abs(place[:, None] - place) ** (2 / 3) + WHITE_VARIANCE * np.eye(x.size)

    def slope(keep: NDArray[np.bool_]) -> float:
        columns = np.stack([np.ones(x.size), x, y], axis=1)[keep]
        white = np.linalg.solve(np.linalg.cholesky(shared[np.ix_(keep, keep)]), columns)
        return float(np.linalg.lstsq(white[:, :2], white[:, 2], rcond=None)[0][1])

    block = np.arange(x.size) * JACKKNIFE_BLOCKS // x.size
    each = np.array([slope(block != i) for i in range(JACKKNIFE_BLOCKS)])
    error = float(np.sqrt((JACKKNIFE_BLOCKS - 1) / JACKKNIFE_BLOCKS * np.sum((each - each.mean()) ** 2)))
    return slope(np.ones(x.size, dtype=bool)), error
