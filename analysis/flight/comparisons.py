"""What a flight says about its own correction: layers of ascent and descent, the slow sensor against the fast one.

Air that was passed upwards and downwards is the same air. A sensor whose time scale is 1 + e of what the profile says
leaves -e times the lag in the corrected value, of opposite sign on the two ways: the difference between them, against
the difference of the lags, is e. An inversion that rose between the two ways looks the same, in temperature as well:
where the fast sensor's difference goes with the lag that the slow one would have behind it, the air moved.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.special import gamma, gammainc

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.effect import InFlight
from shockrig.analysis.flight.flight_channel import REMEMBERED_LAGS, FlightChannel, bridged, possible_air
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.flight.smoother import followed
from shockrig.analysis.flight.sweep import as_lagged, forgotten
from shockrig.analysis.physics.humidity import saturation_pressure_hpa, saturation_slope
from shockrig.analysis.physics.standard_atmosphere import pressure_altitude_m
from shockrig.files.flight import Corrected, Flight
from shockrig.files.legs import legs, longest_pair, too_far_apart
from shockrig.files.numbers import moment, plain, short

Array = NDArray[np.float64]

# Means over layers of a flight, with what averages out in them and what does not.
#
# Noise and turbulence are independent from one stretch of samples to the next and shrink with their number; an error
# of the profile or of the calibration is common to the flight, and the mean of a layer has all of it.

COLUMNS = (
    "low_m", "high_m", "samples", "temperature_c", "temperature_uncertainty_k", "temperature_uncertainty_independent_k",
    "temperature_uncertainty_common_k", "humidity_percent", "humidity_uncertainty_percent",
    "humidity_uncertainty_independent_percent", "humidity_uncertainty_common_percent",
)  # fmt: skip
CHANNELS = (
    ("temperature", "temperature_c", "temperature_uncertainty_k"),
    ("humidity", "humidity_percent", "humidity_uncertainty_percent"),
)


class Layers:
    """Sums over layers of `height_m`, block after block."""

    def __init__(self, height_m: float) -> None:
        self.height_m = height_m
        self._sums: dict[int, np.ndarray] = {}  # layer -> (channel, [samples, value, independent variance, common])

    def add(self, flight: Flight, found: Corrected) -> None:
        """Add a block; rows without an altitude or a corrected value do not count."""
        if flight.altitude_m is None:
            return
        period = typical_period(flight.time_s)
        layer = np.floor(flight.altitude_m / self.height_m)
        for i, (name, value_of, sigma_of) in enumerate(CHANNELS):
            value, sigma = getattr(found, value_of), getattr(found, sigma_of)
            common = found.common[name]
            known = np.isfinite(layer) & np.isfinite(value) & np.isfinite(sigma) & np.isfinite(common)
            alike = max(found.independent_after_s[name] / period, 1.0)  # samples that share one error
            independent = np.maximum(sigma**2 - common**2, 0.0) * alike
            for number in np.unique(layer[known]).astype(int).tolist():
                rows = known & (layer == number)
                sums = self._sums.setdefault(number, np.zeros((len(CHANNELS), 4)))
                sums[i] += rows.sum(), value[rows].sum(), independent[rows].sum(), common[rows].sum()

    def rows(self) -> Iterator[tuple[float, ...]]:
        """A row of COLUMNS for each layer, from below."""
        for number in sorted(self._sums):
            row = [number * self.height_m, (number + 1) * self.height_m, self._sums[number][:, 0].max()]
            for count, total, variance, common in self._sums[number]:
                if not count:
                    row += 4 * [np.nan]
                    continue
                independent, shared = np.sqrt(variance) / count, common / count
                row += [total / count, float(np.hypot(independent, shared)), independent, shared]
            yield tuple(row)

    def write(self, path: Path) -> int:
        """Write the layers as CSV; how many there are."""
        rows = list(self.rows())
        with path.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(COLUMNS)
            for row in rows:
                writer.writerow(["" if v != v else f"{v:.0f}" if i == 2 else f"{v:.5g}" for i, v in enumerate(row)])
        return len(rows)


# Where ascent and descent disagree by more than the correction states: by how much, and what would explain it.
#
# Turbulence on the two ways is not the same, and what it does from one layer to the next says how far it drives them
# apart in the end (structure function as distance^(2/3)). What lies beyond that and beyond the stated uncertainty is
# the sensor's, or the air's that moved on: it is not known which, and counts as error.

LARGE_SCALES = 3  # degrees of freedom of the mean square difference, above 2: so few large scales a flight has
NOT_AS_STATED = 0.2  # probability before the flight is looked at that its sensor, or its air, is not as it is taken
MOST_TIMES = 100.0  # the variance of what is taken, of such a sensor's or air's, evenly in its logarithm
LIKELIER_THAN_NOT = 0.5
NEIGHBOUR_MEDIAN = 0.455 * 2.0  # median of the squared difference of two layers, over the variance of one
PLAYS_PERCENT = (0.5, 1.0, 2.0)  # to either side, of hysteresis
DRIFT_S = 3.0  # over which a humidity is seen to drift
DIE_S = 17.0  # by which a humidity chip in flight follows the air (iMet-XQ2 flights: 17 to 19 s)
SECOND_LAG_RATIOS = (3.0, 10.0)  # times the sensor's slowest lag, of a second one
LEAST_EXPLAINED = 0.5  # of the difference's mean square, at least
LEAST_OF_ITS_SIZE, MOST_OF_ITS_SIZE = 0.4, 2.0  # of what the cause does where nothing of it has a size of its own
ALIKE_SHARE, MOST_NAMED = 0.85, 3  # causes that explain so much of what the best one does are named beside it


@dataclass(frozen=True)
class Difference:
    """Descent less ascent in each layer (n,): of the corrected values, and the stated variance of that."""

    corrected: Array
    variance: Array


def excess(difference: Difference) -> tuple[float, float]:
    """Mean square by which the two ways are expected to differ beyond turbulence and what is stated, and how likely it
    is that they do: that the difference is as of a variance up to MOST_TIMES larger, and not of chance."""
    d = difference.corrected
    of_turbulence = float(np.median(np.diff(d) ** 2)) / NEIGHBOUR_MEDIAN * d.size ** (2.0 / 3.0)
    # layers in which little is known say little of the others
    known = 1.0 / np.maximum(of_turbulence + difference.variance, np.finfo(float).tiny)
    allowed, seen = float(1.0 / known.mean()), float(np.average(d**2, weights=known))
    if seen <= allowed:
        return 0.0, 0.0
    times, half = seen / allowed, LARGE_SCALES / 2.0
    by_chance = (half * times) ** half * np.exp(-half * times) / gamma(half)  # densities of ln(times)
    otherwise = (gammainc(half, half * times) - gammainc(half, half * times / MOST_TIMES)) / np.log(MOST_TIMES)
    odds = NOT_AS_STATED * otherwise / ((1.0 - NOT_AS_STATED) * by_chance) if by_chance > 0.0 else np.inf
    likely = float(1.0 / (1.0 + 1.0 / odds))
    return likely * (seen - allowed), likely


def of_either(beyond: float) -> float:
    """Mean square expected of either way's own error, of two that differ by `beyond`.

    Half of the difference is each one's, with what both have in common: that is not seen, and may be of any size. By
    so few degrees of freedom its variance is expected to be as many times what the difference has.
    """
    return 0.25 * beyond * (1.0 + LARGE_SCALES / (LARGE_SCALES - 2.0))


@dataclass(frozen=True)
class LikelyCause:
    """What may be wrong: how far it moves a corrected value (n,), the sentence, and whether it comes in any size (and
    then the other way)."""

    moves: Array
    any_size: bool
    sentence: str


def causes(flight: Flight, bead: FlightChannel, channel: FlightChannel) -> list[LikelyCause]:
    """What a channel's profile may lack, and what it would do in this flight."""
    period = typical_period(flight.time_s)
    value, air, response = bridged(flight.time_s, channel.value), bridged(flight.time_s, bead.value), channel.response
    if value is None or air is None or response is None:
        return []

    def behind(values: Array, time_constant_s: float) -> Array:
        return followed(values, float(np.exp(-period / time_constant_s)), float(values[0]))

    reading, slowest = value - np.nan_to_num(channel.lag), response.slowest_s
    shortest_s, longest_s = SECOND_LAG_RATIOS[0] * slowest, SECOND_LAG_RATIOS[1] * slowest
    found = [
        LikelyCause(
            value - behind(value, times * slowest),
            True,
            f"a second lag of some {shortest_s:.2g} to {longest_s:.2g} s beside the profile's: "
            "characterize with a longer dwell and diagnose "
            f"({named_effects(channel.name, lambda flown: flown.lag is not None)})",
        )
        for times in SECOND_LAG_RATIOS
    ]
    found.append(
        LikelyCause(
            np.gradient(value) / period,
            True,
            "readings that are late or averaged by the logger: log single readings, or diagnose "
            f"({named_effects(channel.name, lambda flown: flown.delay_s is not None)})",
        )
    )
    if channel.name == "humidity":
        found.extend(
            LikelyCause(
                reading - _played(reading, half),
                True,
                "hysteresis: shock the film up and down at one temperature and diagnose "
                f"({named_effects(channel.name, lambda flown: flown.uncertainty is not None)})",
            )
            for half in PLAYS_PERCENT
        )
        saturated = saturation_pressure_hpa(air)
        found.append(
            LikelyCause(
                as_lagged(value, response, period) - as_lagged(value * saturated, response, period) / saturated,
                False,
                "a film that takes up relative humidity and not vapour: diagnose the campaign "
                f"({named_effects(channel.name, lambda flown: flown.activity is not None)})",
            )
        )
        die = bridged(flight.time_s, flight.die_temperature_c)
        own = behind(air, DIE_S) if die is None else die
        found.append(
            LikelyCause(
                value * saturation_slope(air) * (air - own),
                False,
                "a die that is slower than the air: "
                + ("log the humidity chip's own temperature, and " if die is None else "")
                + f"diagnose ({late_die()})",
            )
        )
    return found


def _played(values: Array, half: float) -> Array:
    """Values (n,) through a play of `half` to either side: what stays behind wherever they turn."""
    out, state = np.empty(values.size), float(values[0])
    for i, value in enumerate(values.tolist()):
        out[i] = state = min(max(state, value - half), value + half)
    return out


def late_die() -> str:
    """Names of the effects that make the hygrometer's own temperature late."""
    return named_effects("humidity", lambda flown: flown.at_die and flown.activity is None)


def named_effects(channel: str, means: Callable[[InFlight], bool]) -> str:
    """Names of the effects of a channel that mean that in a flight."""
    known = ((e.id, e.in_flight) for e in CATALOGUE.values() if channel in e.channels)
    return ", ".join(name for name, flown in known if flown is not None and means(flown))


def explained(difference: Array, moved: list[Array], found: list[LikelyCause]) -> str:
    """The sentences of the causes that explain most of a difference (n,) with hardly a difference between them, as each
    of them `moved` it; empty where none explains much."""
    total = float(np.sum(difference**2))
    ranked = []
    for by, cause in zip(moved, found, strict=True):
        own = float(by @ by)
        size = float(by @ difference) / own if own > 0 else 0.0
        if size < 0.0 if cause.any_size else LEAST_OF_ITS_SIZE < size < MOST_OF_ITS_SIZE:
            ranked.append((size * float(by @ difference) / total, cause.sentence))
    ranked = [
        one for one in sorted(ranked, reverse=True) if one[0] > max(LEAST_EXPLAINED, ALIKE_SHARE * max(ranked)[0])
    ]
    said = list(dict.fromkeys(sentence for _, sentence in ranked))
    return ", or ".join(said[:MOST_NAMED])


LEAST_CLIMB_M = 40.0  # that both ways have in common
GOING_SHARE = 0.1  # of a way's pace, at which the carrier goes on
WANDERS_M_S, CLEARLY_FARTHER = 0.007, 5.0  # of a height by pressure: 3 hPa/h in a storm; times as far at least
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
MOST_SLOWER = 1.0
LARGEST_STEP = 0.5
WORSE_RATIO = 1.02  # times what ascent and descent of the readings differ by
SURE_BESIDE_AIR = 3.0  # the same where all that the air may have moved counts as error
DISAGREE = "ascent and descent disagree"
PARTED = f"the correction makes {DISAGREE} more"
USE_READINGS = "use the readings, which stand beside it in what was written"
# Times what the readings scatter by, beside their mean over as long as the sensor remembers. Of 65 kinds of simulated
# flights (benchmarks/flight_harm.py) none comes to 1.7 but waves that a film hides nearly whole, which is sure of them.
SCATTERS = 2.0
LIKELY_FAST = "the profile is likely slower than these sensors, or states less noise than their readings have"
UNITS = {"temperature": "K", "humidity": "%RH"}


@dataclass(frozen=True)
class UpAndDown:
    """Ascent against descent: layers in common, rms difference as read and as corrected, the relative error of the time
    scale that explains it best, that number's standard error, the share of the difference's variance explained, the
    rms difference that this time scale would leave, and why the two say nothing of it (empty where they may)."""

    layers: int
    low_m: float
    high_m: float
    read: float
    corrected: float
    slower: float
    slower_error: float
    explained: float
    left: float
    silent: str = ""

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


def up_and_down(flight: Flight, channel: FlightChannel, air_c: Array | None = None) -> UpAndDown | None:
    """Compare a way up with a way down (`_ways_beside`); None where the flight has not both through one layer.

    Humidity is compared at the mean of the ways' temperatures where that of each row is given (`_layered`).
    """
    if channel.raw.all():
        return None
    found = _layered(flight, (channel.value, channel.value - channel.lag, channel.lag), air_c=air_c)
    if found is None:
        return None
    corrected, read, lag = found.means
    slower, error = _slope(lag, corrected) if lag.size >= TELLING_LAYERS else (0.0, np.inf)
    size = [float(np.sqrt(np.mean(v**2))) for v in (read, corrected)]
    explained = float(np.corrcoef(lag, corrected)[0, 1] ** 2) if np.ptp(lag) and np.ptp(corrected) else 0.0
    left = float(np.sqrt(np.mean((corrected - slower * lag) ** 2)))
    return UpAndDown(
        lag.size, found.low_m, found.high_m, size[0], size[1], -slower, error, explained, left, found.silent
    )


@dataclass(frozen=True)
class WaysApart:
    """How far a way up and a way down are apart: layers in common, from what height to what, and the rms difference of
    each column."""

    layers: int
    low_m: float
    high_m: float
    rms: tuple[float, ...]


def ways_apart(flight: Flight, columns: Sequence[Array], air_c: Array | None = None) -> WaysApart | None:
    """Compare a way up with a way down (`_ways_beside`); None where the flight has not both through one layer."""
    if (found := _layered(flight, columns, air_c=air_c)) is None:
        return None
    size = tuple(float(np.sqrt(np.mean(v**2))) for v in found.means)
    return WaysApart(found.means.shape[1], found.low_m, found.high_m, size)


@dataclass(frozen=True)
class Layered:
    """Means of columns in layers, descent beside ascent (c, layers), from what height to what, and why the two ways
    tell nothing of a lag (empty where they may)."""

    low_m: float
    high_m: float
    means: Array
    silent: str


def _layered(
    flight: Flight, columns: Sequence[Array], sign: float = -1.0, air_c: Array | None = None
) -> Layered | None:
    """Means of columns in the layers that a way up and a way down (`_ways_beside`) have in common, descent less ascent,
    or with `sign` 1 plus ascent; None where there are no such layers.

    Air keeps its vapour: where one way is warmer, by the sensor or by the air, its relative humidity is lower. With the
    temperature of each row, `air_c`, columns of humidity are those at the mean of both ways' temperatures.
    """
    if air_c is not None:
        columns = (*columns, air_c)
    height = height_of(flight)
    if height is None:
        return None
    ways = _ways_beside(flight.time_s, height)
    count = min(MOST_LAYERS, *(way.size // ROWS_A_LAYER for way in ways))
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
    up, down = np.array(level[0]), np.array(level[1])
    if air_c is not None:
        both = saturation_pressure_hpa(0.5 * (up[-1] + down[-1]))
        up, down = (way[:-1] * saturation_pressure_hpa(way[-1]) / both for way in (up, down))
    middle = [float(np.median(flight.time_s[way])) for way in ways]
    return Layered(low, high, down + sign * up, too_far_apart(middle[1] - middle[0]))


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
    air_c, off_k = _warmth(flight, bead), np.zeros(bead.value.shape)
    scattered = [said for channel in (bead, film) if (said := _scattered(flight, channel))]
    for channel in (bead, film):
        both = up_and_down(flight, channel, None if channel is bead else air_c)
        if both is not None:
            unit = UNITS[channel.name]
            notes.append(
                f"{channel.name}: ascent and descent differ by {both.read:.2g} {unit} rms as read, by "
                f"{both.corrected:.2g} {unit} corrected ({both.low_m:.0f} to {both.high_m:.0f} m)"
                + (f"; they are {both.silent}, and say nothing of the sensor" if both.silent else "")
            )
        if both is not None and not both.silent:
            stated = _stated(channel)
            wrong = min(abs(both.slower), MOST_SLOWER)
            sure = wrong > SURE_SIGMAS * both.slower_error and both.explained > EXPLAINED_SHARE
            if sure and wrong > BEYOND_STATED * stated and both.agree_better:
                notes.append(
                    f"{channel.name}: they agree best if the sensor is {_way(both.slower)} than the profile "
                    f"says (which states {plain(100 * stated, 1)} %): uncertainties are widened by as much of the lag; "
                    "characterize the sensor again"
                )
                channel = channel.widened(wrong)
                widened[channel.name] = wrong
            count = len(notes)
            doubted = _owned(flight, bead, channel, notes)
            if channel.name == bead.name and len(notes) > count:
                off_k = np.sqrt(np.maximum(doubted.uncertainty**2 - channel.uncertainty**2, 0.0))
            if both.corrected > WORSE_RATIO * both.read:
                owned = len(notes) > count or channel.name in widened
                notes.insert(
                    0,
                    f"{channel.name}: {PARTED}, {both.corrected:.2g} {unit} instead of the {both.read:.2g} {unit} of "
                    f"the readings: {USE_READINGS}, "
                    + ("until the cause is found" if owned else "unless the air itself changed between the two ways"),
                )
            channel = doubted
        found.append(channel)
    if scattered:  # behind what is said of the profile, which may be why
        behind = sum(note.startswith("profile:") for note in notes)
        notes.insert(behind, f"{'; '.join(scattered)}: {USE_READINGS}; {LIKELY_FAST}")
    # the hygrometer may stand in what warms the thermometer: its air has the vapour of free air, and not the humidity
    return found[0], found[1].doubted(as_humidity(film.value, air_c, off_k)), widened


def _scattered(flight: Flight, channel: FlightChannel) -> str:
    """A sentence where the corrected course scatters far more than the readings do and is less certain than they vary:
    a lag that is undone and was not there leaves that, and so does noise that passes for air; empty elsewhere."""
    known = np.isfinite(channel.value) & ~channel.raw & channel.screened.usable
    if channel.response is None or not known.any():
        return ""
    lag_rows = REMEMBERED_LAGS * channel.response.slowest_s / typical_period(flight.time_s)
    width = 2 * int(np.ceil(lag_rows)) + 1

    def scatter(values: Array) -> float:
        return float(np.std(values - uniform_filter1d(values, min(width, values.size), mode="nearest")))

    read = flight.temperature_c if channel.name == "temperature" else flight.humidity_percent
    before, behind = scatter(read[known]), scatter(channel.value[known])
    unsure = float(np.median(channel.total_uncertainty[known]))
    if behind <= SCATTERS * before or unsure <= before:
        return ""
    unit = UNITS[channel.name]
    return (
        f"{channel.name}: the corrected course scatters by {short(behind, 2)} {unit} where the readings do by "
        f"{short(before, 2)} {unit}, and is unsure by {short(unsure, 2)} {unit}"
    )


def as_humidity(percent: Array, air_c: Array | None, off_k: Array) -> Array:
    """What a temperature that is `off_k` (n,) makes of a humidity (n,) at the air's temperature."""
    if air_c is None:
        return np.zeros(percent.shape)
    # of nonsense that is near absolute zero neither has any vapour
    own, off = (saturation_pressure_hpa(possible_air(one)) for one in (air_c, air_c + off_k))
    moved = np.log(off / own)
    return np.asarray(np.nan_to_num(percent * moved))


def _owned(flight: Flight, bead: FlightChannel, channel: FlightChannel, notes: list[str]) -> FlightChannel:
    """The channel with uncertainties as wide as ascent and descent disagree, and what may be the cause in `notes`."""
    found = causes(flight, bead, channel)
    shapes = _shapes(channel)
    # that the air may be as it was before is no reason for the two ways to differ: they would tell
    known = channel.total_uncertainty**2 - (0.0 if channel.as_before is None else channel.as_before**2)
    stated = np.where(np.isfinite(channel.value), np.maximum(known, 0.0), np.nan)
    air_c = None if channel.name == bead.name else _warmth(flight, bead)
    less = _layered(flight, (channel.value, *(cause.moves for cause in found)), air_c=air_c)
    plus = _layered(flight, (stated, *(shape**2 for shape in shapes)), 1.0)
    if less is None or plus is None or less.means.shape[1] != plus.means.shape[1]:
        return channel
    difference, *moved = less.means
    seen = Difference(difference, plus.means[0])
    beyond, likely = excess(seen)
    squares = plus.means[1:]
    share, own = shared(seen, beyond, squares), of_either(beyond)
    wide = np.sqrt(
        sum(w * own * shape**2 / (0.5 * square.mean()) for w, shape, square in zip(share, shapes, squares, strict=True))
    )
    if likely < LIKELIER_THAN_NOT:
        return channel.doubted(wide)
    unit, wider = UNITS[channel.name], float(np.sqrt(own))
    cause = explained(difference, moved, found)
    notes.append(
        f"{channel.name}: {DISAGREE} by more than turbulence and the stated uncertainty explain: the sensor is not as "
        f"the profile has it, or the air changed; uncertainties are widened by {wider:.2g} {unit}"
        + (f"; likely {cause}" if cause else "")
    )
    return channel.doubted(wide)


def _shapes(channel: FlightChannel) -> tuple[Array, ...]:
    """How large (n,) a channel's error may be where, beside elsewhere: the same everywhere, as what lags, and in
    humidity as the humidity: what gain or a temperature that is off make of it."""
    lag, level = np.abs(np.nan_to_num(channel.lag)), np.abs(np.nan_to_num(channel.value))
    shapes = [np.ones(lag.shape), lag, *([level] if channel.name == "humidity" else [])]
    return tuple(shape for shape in shapes if shape.any())


def shared(difference: Difference, beyond: float, squares: Array) -> Array:
    """Share (s,) of each shape of an error, of which both ways' `squares` (s, layers) are, in a mean square `beyond`
    what is allowed: as likely as the layers' differences are under it, of which so few are independent."""
    d = difference.corrected
    rest = max(float(np.mean(d**2)) - beyond, 0.0)
    width = rest + beyond * squares / squares.mean(axis=1, keepdims=True)
    width = np.maximum(width, 1e-12 * float(np.mean(d**2)))
    nats = -0.5 * LARGE_SCALES * np.mean(np.log(width) + d**2 / width, axis=1)
    odds = np.exp(nats - nats.max())
    return np.asarray(odds / odds.sum())


def _way(slower: float) -> str:
    return f"{100 * min(abs(slower), MOST_SLOWER):.0f} % {'slower' if slower > 0 else 'faster'}"


def told(flight: Flight, bead: FlightChannel, film: FlightChannel, before: Told | None = None) -> Told | None:
    """What ascent and descent say of the film's time scale, beside what they said `before`; None where nothing.

    Where temperature does not show whether the air stayed as it was between the two ways, nothing is said.
    """
    both, air = up_and_down(flight, film, _warmth(flight, bead)), bridged(flight.time_s, bead.value)
    if both is None or both.silent or air is None or film.response is None:
        return before
    shown = as_lagged(air, film.response, typical_period(flight.time_s))
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


def _warmth(flight: Flight, bead: FlightChannel) -> Array | None:
    """The air's temperature in each row; None where it was not read."""
    read = np.where(bead.screened.implausible, np.nan, flight.temperature_c)
    return bridged(flight.time_s, np.where(np.isfinite(bead.value), bead.value, read))


def height_of(flight: Flight) -> Array | None:
    """Of each row, where the log has no altitude that of its pressure in the standard atmosphere; None without
    either."""
    height = None if flight.altitude_m is None else bridged(flight.time_s, flight.altitude_m)
    pressure = bridged(flight.time_s, flight.pressure_hpa) if height is None else None
    if pressure is None:
        return height
    return pressure_altitude_m(median_filter(pressure, 3))


def _stated(channel: FlightChannel) -> float:
    """Relative uncertainty of the time scale that the channel's own has in it, rms over the flight."""
    known = np.isfinite(channel.common) & np.isfinite(channel.lag) & ~channel.raw
    lag = float(np.sum(channel.lag[known] ** 2))
    return float(np.sqrt(np.sum(channel.common[known] ** 2) / lag)) if lag > 0 else 0.0


def _ways_beside(time_s: Array, height: Array) -> list[NDArray[np.int64]]:
    """The rows of a way up, and of a way down (`longest_pair`), at which the carrier goes on; none where its height may
    have wandered as far in that time, by itself."""
    period = typical_period(time_s)
    width = max(round(SPEED_OVER_S / period), 1)
    smooth = uniform_filter1d(height, width, mode="nearest")
    step = np.maximum(np.diff(time_s, prepend=time_s[0] - period), 1e-9)
    rise = np.diff(smooth, prepend=smooth[0])

    def going(first: int, last: int) -> NDArray[np.int64]:
        sign = np.sign(smooth[last] - smooth[first])
        leg = slice(first, last + 1)
        gone, lasting = np.maximum(sign * rise[leg], 0.0), step[leg]
        if (metres := float(gone.sum())) == 0.0:
            return np.zeros(0, dtype=np.int64)
        # over metres, and not over time: how long it stays anywhere says nothing of its pace
        pace = float(np.sum(gone**2 / lasting)) / metres
        rows = first + np.flatnonzero(gone > GOING_SHARE * pace * lasting)
        clearly = CLEARLY_FARTHER * WANDERS_M_S * float(step[rows].sum())
        return rows if sign * (smooth[last] - smooth[first]) > clearly else rows[:0]

    between = legs(smooth)
    rows = [going(*leg) for leg in between]
    metres = [
        smooth[last] - smooth[first] if way.size else 0.0 for (first, last), way in zip(between, rows, strict=True)
    ]
    middle_s = [np.median(time_s[way]) if way.size else time_s[leg[0]] for leg, way in zip(between, rows, strict=True)]
    pair = longest_pair(np.array(middle_s), np.array(metres))
    return [np.zeros(0, dtype=np.int64)] * 2 if pair is None else [rows[one] for one in pair]


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


# The hygrometer's own thermometer, slow as it is: it follows the air, and tells whose moves were the air's.

SHORTEST_S, LONGEST_S = 0.1, 120.0  # of a lag
SELDOM_SHARE = 0.5  # of the rows from the first to the last of its own moves, in which a thermometer makes any
COVERED_S = 10.0  # by which a thermometer may lag that ice or drops cover, or that stands in still air
SETTLED_LAGS, SETTLED_SHARE = 3.0, 0.3  # that the first rows are left out for: of the lag, and of the flight at most


@dataclass(frozen=True)
class Following:
    """One first-order lag behind the air, and the rms that it leaves beside a constant [K]."""

    lag_s: float
    left_k: float


def following(flight: Flight, air_c: Array) -> Following | None:
    """How the hygrometer's own thermometer follows an air (n,) without gaps; None where it was not logged."""
    die = bridged(flight.time_s, flight.die_temperature_c)
    if die is None or np.ptp(die) == 0.0:
        return None
    from scipy.optimize import minimize_scalar

    period = typical_period(flight.time_s)

    def left(log_s: float) -> float:
        lagged = followed(air_c - air_c[0], float(np.exp(-period / np.exp(log_s))), 0.0)
        off = die - lagged
        lasting = min(SETTLED_LAGS * np.exp(log_s), SETTLED_SHARE * np.ptp(flight.time_s))
        return float(np.std(off[flight.time_s - flight.time_s[0] > lasting]))

    best = minimize_scalar(left, bounds=(np.log(SHORTEST_S), np.log(LONGEST_S)), method="bounded")
    return Following(float(np.exp(best.x)), float(best.fun))


def slow_against_fast(flight: Flight, bead: FlightChannel, notes: list[str]) -> None:
    """The humidity sensor's own thermometer is slow: the corrected air, lagged, should be what it read."""
    air = bridged(flight.time_s, bead.value)
    if air is None or bead.raw.all() or (found := following(flight, air)) is None:
        return
    notes.append(
        f"temperature: the humidity sensor's own thermometer follows the corrected air {short(found.lag_s, 2)} s "
        f"behind, to within {found.left_k:.2g} K rms beside a constant"
    )


def seen_by_film(
    flight: Flight, bead: FlightChannel, film: FlightChannel, notes: list[str], logged_s: Array
) -> tuple[FlightChannel, FlightChannel]:
    """Both channels, as unsure as the temperature moved without the humidity; said in the log's own times (n,).

    Either the thermometer moved by itself, and what moves it (ice, drops, a fan that stands still) may slow it as well;
    or the air did and the hygrometer's own temperature is late: what it then says of the air is off by as much. Its own
    thermometer tells which, where it was logged.
    """
    alone, air = film.temperature_alone, bridged(flight.time_s, bead.value)
    if alone is None or air is None or not alone.any():
        return bead, film
    moved = np.flatnonzero(np.diff(alone))
    first, last = logged_s[moved[[0, -1]]]
    off, open_to = off_by_moves(alone, film.most_alone_k)
    # what is over the whole of a flight, but seldom, is not to be read as if it lasted
    all_rows = int(moved[-1] - moved[0]) + 1
    seldom = f"in {moved.size} of the {all_rows} rows " if moved.size < SELDOM_SHARE * all_rows else ""
    said = (
        f"temperature: {seldom}between {moment(first)} and {moment(last)} it moves by up to {short(off.max(), 2)} K "
        "without the humidity, which follows the air's at once: "
    )
    with_them, without = following(flight, air), following(flight, air - alone)
    # what the humidity is off by if the air did move
    late = forgotten(np.diff(alone, prepend=0.0), DIE_S, typical_period(flight.time_s))
    behind = np.log(saturation_pressure_hpa(possible_air(air)) / saturation_pressure_hpa(possible_air(air - late)))
    of_film = film.value * np.abs(behind)
    of_bead, of_vapour = _slowed(flight.time_s, air, slice(int(moved[0]), int(moved[-1]) + 1), film)
    off = np.hypot(open_to, of_bead)
    if with_them is None or without is None:
        said += (
            f"sun, ice or a wake was at the thermometer, or the hygrometer's own temperature is late ({late_die()}); "
            "a log with the temperature of its own would tell"
        )
        bead = _as_shown(flight.time_s, bead, _none_followed(flight.time_s, alone, behind, film) * alone).doubted(off)
        film = film.doubted(np.hypot(of_film, of_vapour))
    elif with_them.left_k < without.left_k:
        said += (
            f"the hygrometer's own thermometer follows {with_them.lag_s:.2g} s later, so its temperature is late and "
            f"not the air's ({late_die()})"
        )
        film = film.doubted(of_film)
    else:
        said += "the sun, ice or a wake was at the thermometer, since the hygrometer's own does not follow them either"
        bead, film = _as_shown(flight.time_s, bead, alone).doubted(off), film.doubted(of_vapour)
    notes.append(f"{said}; humidity is corrected without these moves, and uncertainties are widened by them")
    return bead, film


def off_by_moves(alone: Array, most_k: float) -> tuple[Array, Array]:
    """How far (n,) a temperature that moved by itself (n,), by up to `most_k` at once, may be off, and one standard
    uncertainty of that.

    It was right before the first of these moves, or is behind the last: the likelier, the longer it was nearer to that.
    What moved it comes and goes, the going maybe too slowly to show: it is no sum of moves that it is
    off by, and what it is off by either way may be any part of that.
    """
    ends = np.abs(alone - alone[[0, -1], None])
    odds = np.mean([ends[0] <= ends[1], ends[1] < ends[0]], axis=1)
    ends = np.minimum(ends, most_k)
    both = ends.min(axis=0)
    return ends.max(axis=0), np.sqrt(both**2 / 3.0 + odds @ (ends**2 - both**2))


def _as_shown(time_s: Array, bead: FlightChannel, alone: Array) -> FlightChannel:
    """The thermometer's own moves `alone` (n,) as it showed them: they are none of the air's that it lagged behind."""
    if bead.response is None:
        return bead
    ahead = np.where(bead.raw, 0.0, alone - as_lagged(alone, bead.response, typical_period(time_s)))
    return replace(bead, value=bead.value - ahead, lag=bead.lag - ahead)


def _none_followed(time_s: Array, alone: Array, behind: Array, film: FlightChannel) -> float:
    """Likelihood that the humidity followed none of what the temperature moved by itself (`alone`, n), over that of the
    share which it shows: of a late hygrometer its logarithm drifts `behind` (n,) each move, and sun leaves nothing."""
    humidity = bridged(time_s, np.where(film.value > 0.0, film.value, np.nan))
    rows = max(int(round(DRIFT_S / typical_period(time_s))), 1)
    moving = np.cumsum(np.diff(alone, prepend=0.0) != 0.0)
    still = moving[rows:] == moving[:-rows]
    if humidity is None or not still.any():
        return 1.0
    drift, read = ((values[rows:] - values[:-rows])[still] for values in (behind, np.log(humidity)))
    read = read - np.median(read)
    if (square := float(drift @ drift)) == 0.0:
        return 1.0
    share = float(drift @ read) / square
    # changes over as long share readings with those before and behind them
    variance = 2.0 * rows * float(np.mean((read - share * drift) ** 2)) / square
    share = float(np.clip(share, 0.0, 1.0))
    return float(np.exp(-0.5 * share**2 / variance)) if variance > 0.0 else float(share == 0.0)


def _slowed(time_s: Array, air: Array, rows: slice, film: FlightChannel) -> tuple[Array, Array]:
    """How far off (n,) the air is if some rows' thermometer lags by `COVERED_S`, and the humidity: of a temperature
    that is as far off all along nothing is left in it, of what changes as much as the film lags."""
    late, around = np.zeros(air.shape), 0.5 * COVERED_S
    late[rows] = (np.interp(time_s + around, time_s, air) - np.interp(time_s - around, time_s, air))[rows]
    if film.response is None:
        return np.abs(late), np.zeros(air.shape)
    keep = float(np.exp(-typical_period(time_s) / film.response.slowest_s))
    where, seen = possible_air(air + late), possible_air(air + followed(late, keep, 0.0))
    wrong = np.log(saturation_pressure_hpa(where) / saturation_pressure_hpa(seen))
    return np.abs(late), film.value * np.abs(wrong)
