"""What in a profile cannot be, and what in a flight's log looks like a slip of whoever wrote or mapped it.

`doubts` may be right all the same; after `slips` nothing that a correction could say would hold: readings are given.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.response import LagResponse, bead_response, film_response, reference_stream
from shockrig.analysis.flight.screen import resolution_of, stairs
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.flight.stretches import scatter
from shockrig.analysis.physics.air_exchange import REFERENCE_C
from shockrig.analysis.physics.standard_atmosphere import GRAVITY_M_S2, pressure_altitude_m
from shockrig.files.flight import Flight
from shockrig.files.numbers import SINCE_1970_S, counted, short
from shockrig.files.profile import HumidityProfile, Profile, ResponseTime
from shockrig.files.ranges import LIKELY_RANGES, RANGES, Range

Array = NDArray[np.float64]

# What in a profile cannot be, or contradicts itself, said before a flight is corrected with it.
#
# Three questions: does a sensor with these rates take the times that the profile states; does D rise with temperature
# as sorption does (an activation energy within its range); does a row of the table stand out from those beside it.

GAS_CONSTANT = 8.314462618  # J/(mol K)
DOUBT_SIGMAS = 3.0
TIME_RATIO = 2.0  # that a stated time to 63 % may differ from the model's: at what airspeed it holds is not stated
STANDS_OUT = np.log(
    2.0
)  # of a row from the straight line of its neighbours, in ln D over 1/T; IST's film bends by 1.65


def profile_doubts(profile: Profile) -> list[str]:
    """A sentence for each; empty where all may be right."""
    found = []
    bodies = profile.bodies
    if (part := profile.temperature) is not None:
        response = bead_response(part, reference_stream(REFERENCE_C), bodies["imet"])
        found += _time_doubts("temperature", "alpha", response, part.response_time_s)
    if (film := profile.humidity) is not None:
        for row in film.diffusivity_table:
            at_c = row.ambient_temperature_c
            response = film_response(film, np.array([at_c]), reference_stream(at_c), bodies["hyt"])
            found += _time_doubts("humidity", f"D at {at_c:g} degC", response, row.response_time_s)
        found += _table_doubts(film)
    remedy = "; look at the profile before anything that is corrected with it is used"
    return [f"profile: {one}{remedy if one is found[-1] else ''}" for one in found]


def _time_doubts(channel: str, of: str, response: LagResponse, stated: ResponseTime | None) -> list[str]:
    t63_s = response.t63_s
    possible = LIKELY_RANGES["response_s"]
    if not possible.holds(t63_s):
        return [f"{channel}: {of} makes a sensor with 63 % in {t63_s:.2g} s; expected {possible} s"]
    if stated is not None and abs(np.log(t63_s / stated.t63_s)) > np.log(TIME_RATIO):
        return [f"{channel}: {of} means 63 % in {t63_s:.2g} s, and {stated.t63_s:.2g} s is stated beside it"]
    return []


def _table_doubts(film: HumidityProfile) -> list[str]:
    rows = film.diffusivity_table
    at_c = np.array([row.ambient_temperature_c for row in rows])
    x = 1.0 / (at_c + 273.15)
    ln_d = np.log([row.diffusivity_m2_s for row in rows])
    sigma = np.array([row.standard_uncertainty / row.diffusivity_m2_s for row in rows])
    found = []
    for k in range(1, len(rows) - 1):
        share = (x[k] - x[k - 1]) / (x[k + 1] - x[k - 1])
        off = float(ln_d[k] - (1 - share) * ln_d[k - 1] - share * ln_d[k + 1])
        if abs(off) > STANDS_OUT + DOUBT_SIGMAS * sigma[k - 1 : k + 2].max():
            found.append(
                f"humidity: D at {at_c[k]:g} degC is {np.exp(abs(off)):.2g} times {'more' if off > 0 else 'less'} than "
                "the rows beside it let expect"
            )
    possible = LIKELY_RANGES["activation_j_mol"]
    energy = -GAS_CONSTANT * np.diff(ln_d) / np.diff(x)
    unsure = DOUBT_SIGMAS * GAS_CONSTANT * np.hypot(sigma[1:], sigma[:-1]) / np.abs(np.diff(x))
    wrong = (energy + unsure < possible.low) | (energy - unsure > possible.high)
    if wrong.any() and not found:
        k = int(np.argmax(wrong))
        how = "falls" if energy[k] < 0 else "rises"
        found.append(
            f"humidity: D {how} from {at_c[k]:g} to {at_c[k + 1]:g} degC by {np.exp(abs(ln_d[k + 1] - ln_d[k])):.2g} "
            f"times, an activation energy of {energy[k] / 1e3:.0f} kJ/mol; expected {possible.low / 1e3:g} to "
            f"{possible.high / 1e3:g}: is the table reversed, or a row of it wrong?"
        )
    return found


LONGEST_FLIGHT_S = 86400.0
SLOWEST_PERIOD_S = 10.0
FEWEST_READINGS = 100  # readings that a noise is told from
HOTTEST_C = 45.0  # of the air, for half of a flight
# times a sensor's own period on the bench that a log's is, and what its times then are
UNITS = {1 / 60: "minutes", 1 / 3600: "hours", 1 / 86400: "days", 1e3: "milliseconds", 1e6: "microseconds"}
SAME_SPEED, NO_SPEED = 0.2, 0.7  # ln of how far the airspeed may be off where it never changes, and where there is none
CLOSE_PERIOD = 0.05  # relative, that a period is of one of these
FASTEST_S = 0.004  # between rows of a thermometer or a hygrometer
CLIMB_ROWS = 10  # that a climb is taken over: altitudes come in steps
THROWN_PARTS = 20  # of a log, over two of which a change of speed is taken
FASTEST_CLIMB_M_S = 100.0  # of half of a log; what falls from high up comes to 70
BESIDE_AIRSPEED, LEAST_AIRSPEED_M_S = 3.0, 10.0  # times the largest airspeed in the log, or this, that a climb may be
LIKELIER_LN = 1.5  # by so much in ln of the noise, over both columns, where each has the other's noise
HIGHEST_SHARE = 1.2  # of a humidity that is a share of 1
HEIGHT_RATIO = 2.0  # of an altitude to that of the pressure: no air is half as dense as the standard's at its height
LEAST_CLIMB_M = 30.0  # by the pressure, to tell
HALF_STILL = 0.2  # of a flight's rows, that a reading stands for in one stretch
MOST_HPA = 1100.0  # the highest on any land was 1085
LEAST_HPA = 110.0  # of a whole log, where half of it is above freezing: 16 km up, where air is far colder


def slips(flight: Flight, profile: Profile | None = None, named: bool = False) -> list[str]:
    """Sentences on a clock that is not in seconds and, unless a person `named` them, on columns that stand in one
    another's place; `profile` is what is known of the sensors."""
    found = []
    period = typical_period(flight.time_s)
    sensors = () if profile is None else (profile.temperature, profile.humidity)
    stated = [one.sampling_period_s for one in sensors if one is not None]
    usual = min((one for one in stated if one is not None), default=None)
    ratio = next((r for r in UNITS if usual is not None and abs(period / usual / r - 1.0) < CLOSE_PERIOD), None)
    if ratio is not None:
        found.append(
            f"time_s: a row every {period:.3g} s of sensors that the profile reads every {usual:.3g} s: times seem to "
            f"be in {UNITS[ratio]}; convert them to seconds, or read the log by a map with its time_unit"
        )
    elif period < FASTEST_S:
        found.append(f"time_s: a row every {period:.3g} s, faster than such sensors are read; convert times to seconds")
    elif (climb := _climb(flight)) > _fastest_climb(flight) and not _thrown(flight):
        minutes = "minutes" if climb / 60.0 <= FASTEST_CLIMB_M_S else "another unit"
        found.append(
            f"time_s and altitude_m: half of the log climbs or sinks by {short(climb, 3)} m/s or more, as nothing "
            f"flies that does not slow down as it rises: times seem to be in {minutes}; convert them to seconds, or "
            "read the log by a map with its time_unit"
        )
    if not named and _swapped(flight, profile):
        found.append(
            "temperature_c and humidity_percent seem to stand in one another's place, or the temperature is in degF; "
            "name them with --column temperature=NAME --column humidity=NAME, or read the log by a map with "
            "temperature_unit"
        )
    return found


def _climb(flight: Flight) -> float:
    """Median speed up or down [m/s] of the rows that climb or sink at all; 0 without an altitude."""
    if flight.altitude_m is None:
        return 0.0
    rows = np.flatnonzero(np.isfinite(flight.altitude_m))
    height, time_s = flight.altitude_m[rows], flight.time_s[rows]
    went, lasted = (np.abs(v[CLIMB_ROWS:] - v[:-CLIMB_ROWS]) for v in (height, time_s))
    moved = (went > 0.0) & (lasted > 0.0)
    return float(np.median(went[moved] / lasted[moved])) if np.count_nonzero(moved) >= FEWEST_READINGS else 0.0


def _thrown(flight: Flight) -> bool:
    """Whether what climbs or sinks so fast slows down as it rises, as a rocket's coasting does, by half of gravity and
    more: of times in minutes a change of speed is 3600 times what it was, or none."""
    if flight.altitude_m is None:
        return False
    rows = np.flatnonzero(np.isfinite(flight.altitude_m))
    k = max(CLIMB_ROWS, rows.size // THROWN_PARTS)
    columns = (flight.altitude_m[rows], flight.time_s[rows])
    height, time_s = (np.diff([v[: -2 * k], v[k:-k], v[2 * k :]], axis=0) for v in columns)
    speed = height / np.maximum(time_s, FASTEST_S)
    fast = (np.abs(speed) > FASTEST_CLIMB_M_S).all(axis=0)
    gains = np.diff(speed, axis=0)[0] / np.mean(time_s, axis=0)
    return bool(fast.any() and np.median(gains[fast]) < -0.5 * GRAVITY_M_S2)


def _fastest_climb(flight: Flight) -> float:
    """The fastest climb [m/s] that may be, beside the airspeed where one is logged."""
    possible, speed = RANGES["airflow_m_s"], flight.airspeed_m_s
    flown = speed[(speed > possible.low) & (speed <= possible.high)]
    largest = float(np.quantile(flown, 0.95)) if flown.size else np.inf
    return min(FASTEST_CLIMB_M_S, BESIDE_AIRSPEED * max(largest, LEAST_AIRSPEED_M_S))


def _swapped(flight: Flight, profile: Profile | None) -> bool:
    """Whether the columns' values can only be, or their noises are far more likely to be, the other's."""
    temperature, humidity = (v[np.isfinite(v)] for v in (flight.temperature_c, flight.humidity_percent))
    if min(temperature.size, humidity.size) < FEWEST_READINGS:
        return False
    percent = RANGES["humidity_percent"]
    if not all(percent.holds(v) for v in np.quantile(temperature, (0.1, 0.9)).tolist()):
        return False
    if np.median(temperature) > HOTTEST_C and np.median(humidity) < HOTTEST_C:
        return True
    bead, film = (None, None) if profile is None else (profile.temperature, profile.humidity)
    if bead is None or film is None or not bead.noise_k or not film.noise_percent:
        return False
    read = [float(np.log(max(np.median(scatter(v)), 1e-9))) for v in (temperature, humidity)]
    own = [float(np.log(v)) for v in (bead.noise_k, film.noise_percent)]
    straight, crossed = abs(read[0] - own[0]) + abs(read[1] - own[1]), abs(read[0] - own[1]) + abs(read[1] - own[0])
    return straight > crossed + LIKELIER_LN


def doubts(flight: Flight) -> list[str]:
    """Sentences on times that are no seconds, temperatures that are none of air in degC, humidities that are none in
    percent, pressures that are none of air in hPa and altitudes that are none in metres, on readings that stand still
    and airspeeds that cannot be; empty where all may be right. Rows as the log has them, clock and all."""
    found = []
    ahead = np.diff(flight.time_s, prepend=flight.time_s[:1])
    since = np.cumsum(np.maximum(ahead, 0.0))  # a clock that is set back says nothing of how long that took
    lasts, period = float(since[-1]), typical_period(flight.time_s)
    dated = float(np.nanmedian(flight.time_s)) > SINCE_1970_S  # of which nobody has to guess the unit
    if lasts > LONGEST_FLIGHT_S and period > SLOWEST_PERIOD_S and not dated:
        found.append(
            f"time_s: the log lasts {short(lasts / 3600, 3)} h with a row every {short(period, 3)} s: if these are "
            'milliseconds, divide by 1000, or read the log by a map with time_unit = "ms"'
        )
    for name, values, unit in (
        ("temperature_c", flight.temperature_c, "degC"), ("humidity_percent", flight.humidity_percent, "%RH")
    ):  # fmt: skip
        first, rows = _stands(values)
        known = values[np.isfinite(values)]
        if rows > HALF_STILL * values.size and not stairs(known, resolution_of(known)):
            lasting = float(since[first + rows - 1] - since[first])
            found.append(
                f"{name}: the reading stands at {values[first]:.6g} {unit} for {short(lasting, 3)} s of "
                f"{short(lasts, 3)} s: the sensor or the logger was stuck, and what was there is told by the readings "
                "before and after alone"
            )
    speed = flight.airspeed_m_s[np.isfinite(flight.airspeed_m_s)]
    possible = RANGES["airflow_m_s"]
    if wrong := int(np.count_nonzero((speed < possible.low) | (speed > possible.high))):
        found.append(
            f"airspeed_m_s: {counted(wrong, 'row')} of {speed.size} cannot be (median {np.median(speed):.3g}, expected "
            f"{possible}), and are taken as unknown; is it in cm/s, or does a wind from ahead count as negative?"
        )
    known = flight.temperature_c[np.isfinite(flight.temperature_c)]
    if known.size and (usual := float(np.median(known))) > HOTTEST_C:
        found.append(
            f"temperature_c: half of the readings lie above {short(usual, 3)} degC, where hardly any air is flown: "
            f"they may be {_else(usual)}: read the log by a map that names its columns and temperature_unit"
        )
    percent = flight.humidity_percent[np.isfinite(flight.humidity_percent)]
    if percent.size and 0.0 < percent.max() <= HIGHEST_SHARE and percent.min() > -0.1:
        found.append(
            f"humidity_percent: readings lie between {percent.min():.2g} and {percent.max():.2g}: if they are "
            "fractions of 1 and not %RH, multiply by 100, or read the log by a map with "
            'humidity_unit = "fraction"'
        )
    times = _by_pressure(flight)
    if not 1.0 / HEIGHT_RATIO < times < HEIGHT_RATIO:
        found.append(
            f"altitude_m: it goes {short(times, 3)} times as far as the pressure lets expect: it may be in "
            f"{'feet' if HEIGHT_RATIO < times < 2.0 * HEIGHT_RATIO else 'another unit'}: convert it, or read the log "
            "by a map with altitude_unit"
        )
    pressure = flight.pressure_hpa[np.isfinite(flight.pressure_hpa)]
    if (rows := _lowest_stands(flight.pressure_hpa)) > HALF_STILL * flight.time_s.size:
        found.append(
            f"pressure_hpa: the lowest reading, {pressure.min():.6g} hPa, stands in {counted(rows, 'row')} one after "
            "another: the barometer was at the end of what it measures, or stuck, and the air was thinner"
        )
    if in_air(flight) is not flight:
        what = f"no reading is above {LEAST_HPA:.0f} hPa, as in the stratosphere, where no air is as warm"
        if pressure.max() > LEAST_HPA:
            what = f"readings are above {MOST_HPA:.0f} hPa, as no air's that is flown in"
        found.append(
            f"pressure_hpa: {what}: it may be in kPa, or above that of the air, or of water, and is taken as "
            "unknown, for the altitude too: convert it, or leave it out by renaming its column"
        )
    return found


def _else(usual: float) -> str:
    """What readings may be whose median is too warm for the air's temperature in degC: nothing that would be no air's
    either."""
    air = Range(RANGES["temperature_c"].low, HOTTEST_C)
    units = [unit for unit, in_c in (("degF", (usual - 32.0) / 1.8), ("K", usual - 273.15)) if air.holds(in_c)]
    others = {"humidity": RANGES["humidity_percent"], "pressure": Range(LEAST_HPA, MOST_HPA)}
    columns = [name for name, possible in others.items() if possible.holds(usual)]
    said = [f"in {' or '.join(units)}"] * bool(units) + [f"be the {' or the '.join(columns)}"] * bool(columns)
    return ", or ".join(said).removeprefix("be ") or "another quantity"


def in_air(flight: Flight) -> Flight:
    """The flight without a pressure that is none of the air's: neither an altitude nor a density is told by it."""
    pressure = flight.pressure_hpa[np.isfinite(flight.pressure_hpa)]
    known = flight.temperature_c[np.isfinite(flight.temperature_c)]
    low = pressure.size and known.size and pressure.max() < LEAST_HPA and np.median(known) > 0.0
    if not low and not (pressure.size and np.quantile(pressure, 0.95) > MOST_HPA):
        return flight
    return replace(flight, pressure_hpa=np.full(flight.pressure_hpa.shape, np.nan))


def airspeed_notes(flight: Flight) -> list[str]:
    """A sentence where the airspeed never changes."""
    if airspeed_doubt(flight) != SAME_SPEED:
        return []
    speed = flight.airspeed_m_s[np.isfinite(flight.airspeed_m_s)]
    return [
        f"airspeed_m_s: {speed[0]:.4g} m/s in every row: a set point, or a sensor that is stuck; it is taken as "
        f"good to {100 * SAME_SPEED:.0f} %"
    ]


def _by_pressure(flight: Flight) -> float:
    """How many times as far a flight climbs by its altitude as by its pressure; 1 where that cannot be told."""
    if flight.altitude_m is None:
        return 1.0
    metres, by_pressure = flight.altitude_m, pressure_altitude_m(flight.pressure_hpa)
    rows = np.isfinite(metres) & np.isfinite(by_pressure)
    if np.count_nonzero(rows) < FEWEST_READINGS:
        return 1.0
    went, climbed = (float(np.ptp(np.quantile(v[rows], (0.05, 0.95)))) for v in (metres, by_pressure))
    return went / climbed if climbed > LEAST_CLIMB_M else 1.0


def airspeed_doubt(flight: Flight) -> float:
    """Ln of how far the airspeed that is taken may be off, one standard uncertainty; 0 where it was measured."""
    possible, speed = RANGES["airflow_m_s"], flight.airspeed_m_s
    flown = speed[(speed >= possible.low) & (speed <= possible.high)]
    if flown.size == 0:
        return NO_SPEED
    return SAME_SPEED if flown.size >= FEWEST_READINGS and np.ptp(flown) == 0.0 else 0.0


def _lowest_stands(values: Array) -> int:
    """Rows in a row in which a barometer (n,) reads its lowest, and that again and again as it does no other."""
    first, rows = _stands(values)
    above = values[values > np.nanmin(values, initial=np.inf)]
    moves = above.size > 0 and np.unique(above).size > 0.5 * above.size
    return rows if moves and values[first] < above.min() else 0


def _stands(values: np.ndarray) -> tuple[int, int]:
    """First row and length of the longest stretch over which a reading does not change."""
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size == 0:
        return 0, 0
    new = np.flatnonzero(np.diff(values[rows], prepend=np.inf) != 0)
    lasting = np.diff(np.append(new, rows.size))
    longest = int(np.argmax(lasting))
    return int(rows[new[longest]]), int(lasting[longest])
