"""A flight corrected: screening, readout undone, one of three methods, uncertainty, and an honest word where it
cannot help.

Temperature first; humidity then goes from %RH to vapour pressure with the temperature that the film has, through the
method, and back with the air's corrected temperature; D follows that temperature sample by sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from shockrig.analysis.flight.inverse import Readings, mended, paper
from shockrig.analysis.flight.prior import Passing
from shockrig.analysis.flight.response import Response, bead_response, by_id, film_response, not_undone
from shockrig.analysis.flight.screen import Screened, ordered, screen
from shockrig.analysis.flight.sensor import NOISE_K, NOISE_PERCENT, REFERENCE_AIRSPEED_M_S
from shockrig.analysis.flight.smooth_channel import Estimate, estimate, lags_behind, typical_period
from shockrig.analysis.physics.chain import ventilation
from shockrig.analysis.physics.humidity import saturation_pressure_hpa
from shockrig.files.errors import InputError
from shockrig.files.flight import FLAGS, Corrected, Flight
from shockrig.files.profile import HumidityProfile, Profile, TemperatureProfile

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
REFERENCE_C = 20.0  # vapour is carried as relative humidity at this temperature
LONGEST_FILL_S = 5.0  # farther from a usable sample no value is given
MOST_COUPLING = 5.0  # vapour and temperature are not told to go together more steeply than this
IDLE_LAG_SIGMAS = 0.3  # a lag smaller than this share of the noise is not worth undoing


def _smoother(readings: Readings, cutoff_hz: float | None = None) -> Estimate:
    return estimate(
        readings.time_s,
        readings.reading,
        readings.usable,
        readings.response,
        readings.noise_variance,
        readings.delay_s,
        readings.passing,
    )


METHODS: dict[str, Callable[[Readings, float | None], Estimate]] = {
    "smoother": _smoother,
    "mended": mended,
    "paper": paper,
}


@dataclass
class _Channel:
    """One channel's way through the correction."""

    name: str
    value: Array
    uncertainty: Array
    screened: Screened
    outside: Mask
    raw: Mask  # rows where the reading itself is given
    resolved_rate: float = 30.0
    cutoff_hz: float | None = None


def correct(
    flight: Flight,
    profile: Profile,
    method: str = "smoother",
    *,
    cutoff_hz: float | None = None,
    temperature_noise_k: float | None = None,
    humidity_noise_percent: float | None = None,
) -> Corrected:
    """Correct a flight.

    Parameters
    ----------
    flight : Flight
    profile : Profile
        A channel that it lacks is given as it came and flagged `not_corrected`.
    method : one of METHODS
    cutoff_hz : float, optional
        Of the two inverses' low-pass; suggested from the noise floor when left out. The smoother needs none.
    temperature_noise_k, humidity_noise_percent : float, optional
        Noise floors where they differ from the profile's.

    Raises
    ------
    InputError
        Unknown method, no usable row; RefusedError where an inverse is not stable.
    """
    if method not in METHODS:
        raise InputError(f"method {method!r}: expected one of {', '.join(METHODS)}")
    good = ordered(flight.time_s)
    if np.count_nonzero(good) < 2 or np.ptp(flight.time_s[good]) == 0:
        raise InputError("time_s: fewer than two rows with times that run forward; give a log with a clock in seconds")
    rows = np.flatnonzero(good)
    part = Flight(*(getattr(flight, name)[rows] for name in Flight.__dataclass_fields__))
    notes: list[str] = []
    speed = _airspeed(part, profile, notes)
    solve = METHODS[method]
    bead = _temperature(part, profile.temperature, speed, solve, cutoff_hz, temperature_noise_k, notes)
    film = _humidity(part, profile.humidity, speed, bead, solve, cutoff_hz, humidity_noise_percent, notes)
    return _gather(flight.time_s.size, rows, bead, film, notes)


def _airspeed(flight: Flight, profile: Profile, notes: list[str]) -> Array:
    """Airspeed of each row; where it is not known, that of the row before, and 5 m/s where there is none at all."""
    speed = flight.airspeed_m_s
    known = np.isfinite(speed) & (speed >= 0) & (speed < 150)
    needs = {"convective_film", "self_heating", "vapour_boundary_layer"}
    used = {e.effect for p in (profile.temperature, profile.humidity) if p for e in p.effects} & needs
    if not known.any():
        if used:
            notes.append(f"no airspeed in the log: {', '.join(sorted(used))} taken at {REFERENCE_AIRSPEED_M_S:g} m/s")
        return np.full(speed.shape, REFERENCE_AIRSPEED_M_S)
    return np.interp(flight.time_s, flight.time_s[known], speed[known])


def _undo_readout(
    reading: Array, part: TemperatureProfile | HumidityProfile, speed: Array, period: float
) -> tuple[Array, float, float]:
    """Reading of the element itself, the gain it was divided by, and how late the logger is [s]."""
    effects = by_id(part.effects)
    gain = delay = 0.0
    if (e := effects.get("calibration_error")) is not None:
        gain = e.value("gain", 0.0)
        reading = (reading - e.value("offset", 0.0)) / (1 + gain)
    if (e := effects.get("self_heating")) is not None:
        radius = part.bead_radius_m
        reading = reading - e.value("rise_k_at_5_m_s") * ventilation(
            np.array(REFERENCE_AIRSPEED_M_S), radius
        ) / ventilation(speed, radius)
    if (e := effects.get("dead_time")) is not None:
        delay += max(e.value("delay_s"), 0.0)
    if (e := effects.get("moving_average")) is not None:
        delay += 0.5 * max(e.value("samples") - 1.0, 0.0) * period
    return reading, 1.0 + gain, delay


def _floor(part: TemperatureProfile | HumidityProfile, given: float | None, own: float | None, default: float) -> float:
    noise = given if given is not None else own if own is not None else default
    effects = by_id(part.effects)
    if (e := effects.get("quantization")) is not None:
        noise = float(np.hypot(noise, e.value("step") / np.sqrt(12)))
    return max(noise, 1e-6)


def _temperature(
    flight: Flight,
    part: TemperatureProfile | None,
    speed: Array,
    solve,
    cutoff_hz: float | None,
    given: float | None,
    notes: list[str],
) -> _Channel:
    raw = flight.temperature_c
    noise = _floor(part, given, part.noise_k, NOISE_K) if part else (given or NOISE_K)
    screened = screen(flight.time_s, raw, "temperature", noise)
    if part is None or np.count_nonzero(screened.usable) < 16:
        return _untouched("temperature", flight.time_s, raw, screened, _lacking(part, "temperature"), notes)
    notes.extend(not_undone(part, "temperature"))
    reading, gain, delay = _undo_readout(raw, part, speed, typical_period(flight.time_s))
    noise = float(np.hypot(noise, screened.resolution / np.sqrt(12))) / gain
    n = raw.size
    readings = Readings(
        "temperature",
        flight.time_s,
        reading,
        screened.usable,
        bead_response(part, speed),
        np.full(n, noise**2),
        delay,
    )
    return _judged(readings, solve(readings, cutoff_hz), screened, np.zeros(n, dtype=bool), raw, np.ones(n), notes)


def _humidity(
    flight: Flight,
    part: HumidityProfile | None,
    speed: Array,
    bead: _Channel,
    solve,
    cutoff_hz: float | None,
    given: float | None,
    notes: list[str],
) -> _Channel:
    raw = flight.humidity_percent
    noise = _floor(part, given, part.noise_percent, NOISE_PERCENT) if part else (given or NOISE_PERCENT)
    effects = by_id(part.effects) if part else {}
    limit = effects["saturation_clipping"].value("limit_percent") if "saturation_clipping" in effects else None
    screened = screen(flight.time_s, raw, "humidity", noise, limit=limit)
    if part is None or np.count_nonzero(screened.usable) < 16:
        return _untouched("humidity", flight.time_s, raw, screened, _lacking(part, "humidity"), notes)
    notes.extend(not_undone(part, "humidity"))
    air, sigma = _bridged(flight.time_s, bead.value), _bridged(flight.time_s, bead.uncertainty)
    if air is None:
        return _untouched("humidity", flight.time_s, raw, screened, "no temperature of the air in the log", notes)
    sigma = np.zeros(raw.shape) if sigma is None else sigma
    own, die = air, _bridged(flight.time_s, flight.die_temperature_c)
    if "die_thermal_lag" in effects:
        if die is not None:
            own = die
        else:
            notes.append(
                "humidity: die_thermal_lag is in the profile and the log has no temperature of the die; "
                "the air's is taken"
            )
    reading, gain, delay = _undo_readout(raw, part, speed, typical_period(flight.time_s))
    noise = float(np.hypot(noise, screened.resolution / np.sqrt(12))) / gain
    # vapour pressure as relative humidity at a fixed temperature: what diffuses, in a unit that reads like %RH
    to_vapour = saturation_pressure_hpa(own) / saturation_pressure_hpa(REFERENCE_C)
    from_vapour = saturation_pressure_hpa(REFERENCE_C) / saturation_pressure_hpa(air)
    steepness = np.log(saturation_pressure_hpa(air + 0.5)) - np.log(saturation_pressure_hpa(air - 0.5))
    response = film_response(part, air, speed)
    level = np.interp(flight.time_s, flight.time_s[screened.usable], (reading * to_vapour)[screened.usable])
    # what the air's temperature leaves open divides the reading and the result alike; a die of its own parts the two
    passing = None
    if own is air:
        coupling = _coupling(flight.time_s, level, air, sigma, level * steepness, response)
        passing = Passing(level * steepness * sigma, bead.resolved_rate, coupling)
    variance = (noise * to_vapour) ** 2
    readings = Readings(
        "humidity", flight.time_s, reading * to_vapour, screened.usable, response, variance, delay, passing
    )
    found = solve(readings, cutoff_hz)
    channel = _judged(readings, found, screened, ~part.covers(air), raw, from_vapour, notes)
    if own is not air or found.cutoff_hz is not None:
        wrong = channel.value * steepness * sigma
        together = _correlation(flight.time_s, found.air, air)
        total = channel.uncertainty**2 + wrong**2 - 2 * together * channel.uncertainty * wrong
        least = (0.2 * channel.uncertainty) ** 2
        channel.uncertainty = np.where(channel.raw, channel.uncertainty, np.sqrt(np.maximum(total, least)))
    hysteresis = effects["hysteresis"].value("rh_percent") if "hysteresis" in effects else 0.0
    channel.uncertainty = np.hypot(channel.uncertainty, hysteresis)
    return channel


def _judged(
    readings: Readings, found: Estimate, screened: Screened, outside: Mask, raw: Array, unit: Array, notes: list[str]
) -> _Channel:
    """Uncertainty of the sensor's time scale added; where nothing is won, or D is not known, the reading itself is
    given."""
    lag = found.air - found.clean
    # a time constant that is wrong by a share moves the air by at most that share of the lag
    variance = found.variance + (readings.response.relative_uncertainty * lag) ** 2
    if readings.response.slow_uncertainty:
        variance += (readings.response.slow_uncertainty * _behind_slowest(readings, found.air)) ** 2
    noise = readings.noise_variance * found.noise_factor**2
    trusted = screened.usable & ~outside
    raw_rows = outside.copy()
    if trusted.any():
        lag_size = float(np.sqrt(np.mean(lag[trusted] ** 2)))
        noise_size = float(np.sqrt(np.mean(noise[trusted])))
        predicted = float(np.mean(variance[trusted]))
        # a smoother that knows its sensor cannot lose; an inverse can, and its noise passes for lag
        lagging = max(lag_size**2 - found.amplified, 0.0)
        loses = found.cutoff_hz is not None and predicted > lagging + noise_size**2
        if lag_size < IDLE_LAG_SIGMAS * noise_size or loses:
            notes.append(
                f"{readings.channel}: not corrected: the lag ({lag_size:.2g}) cannot be told from the noise "
                f"({noise_size:.2g}), a correction would leave {np.sqrt(predicted):.2g}"
            )
            raw_rows[:] = True
    if outside.any():
        notes.append(
            f"{readings.channel}: {np.count_nonzero(outside)} rows lie outside the profile's table "
            "and are given as they came"
        )
    value, sigma = found.air * unit, np.sqrt(variance) * unit
    away = np.hypot(sigma, readings.reading * unit - value)
    value = np.where(raw_rows, raw, value)
    sigma = np.where(raw_rows, away, sigma)
    empty = _far(readings.time_s, screened.usable) | (raw_rows & ~(screened.usable | screened.repeated))
    value, sigma = np.where(empty, np.nan, value), np.where(empty, np.nan, sigma)
    return _Channel(readings.channel, value, sigma, screened, outside, raw_rows, found.resolved_rate, found.cutoff_hz)


def _lacking(part: TemperatureProfile | HumidityProfile | None, name: str) -> str:
    return f"the profile has no {name} part" if part is None else "too few usable samples"


def _untouched(name: str, time_s: Array, raw: Array, screened: Screened, why: str, notes: list[str]) -> _Channel:
    if np.isfinite(raw).any():
        notes.append(f"{name}: given as it came: {why}")
    believed = screened.usable | screened.repeated
    everywhere = np.ones(raw.shape, dtype=bool)
    return _Channel(
        name, np.where(believed, raw, np.nan), np.full(raw.shape, np.nan), screened, ~everywhere, everywhere
    )


def _far(time_s: Array, usable: Mask) -> Mask:
    """Rows farther than LONGEST_FILL_S from every usable sample."""
    known = time_s[usable]
    place = np.searchsorted(known, time_s)
    before = time_s - known[np.maximum(place - 1, 0)]
    after = known[np.minimum(place, known.size - 1)] - time_s
    return np.minimum(np.abs(before), np.abs(after)) > LONGEST_FILL_S


def _bridged(time_s: Array, values: Array) -> Array | None:
    known = np.isfinite(values)
    return np.interp(time_s, time_s[known], values[known]) if known.any() else None


def _behind_slowest(readings: Readings, air: Array) -> Array:
    """How far the air is from the sensor's slow share, the last of its lags; 0 where it is not known."""
    known = np.isfinite(air)
    if not known.any():
        return np.zeros(air.shape)
    even = np.interp(readings.time_s, readings.time_s[known], air[known])
    return even - lags_behind(even, readings.response, typical_period(readings.time_s))[0][:, -1]


def _coupling(
    time_s: Array, vapour: Array, temperature: Array, sigma: Array, percent_per_k: Array, response: Response
) -> float:
    """Vapour that goes with each unit of Passing: minus the slope of vapour against temperature over some seconds,
    over that of the conversion.

    Both as the film sees them, so the temperature is lagged like the vapour was. Slope by signs and medians, so that
    one front does not speak for the whole flight, and less of it where chance or the temperature's error explain it.
    """
    period = typical_period(time_s)
    lag = max(int(round(3.0 / period)), 1)
    if time_s.size < 20 * lag:
        return 0.0
    lags, _ = lags_behind(temperature, response, period)
    lagged = (lags * response.weight).sum(axis=1)
    smooth = max(int(round(1.0 / period)), 1)
    a, b = (uniform_filter1d(v, smooth) for v in (vapour, lagged))
    a, b = a[lag:] - a[:-lag], b[lag:] - b[:-lag]
    a, b = a - np.median(a), b - np.median(b)
    width_a, width_b = np.median(np.abs(a)), np.median(np.abs(b))
    if width_a == 0 or width_b == 0:
        return 0.0
    agree = float(np.mean(np.sign(a) * np.sign(b)))
    chance = lag / time_s.size  # variance of the mean sign, one independent pair every `lag` samples
    agree *= max(1.0 - chance / max(agree**2, chance), 0.0)
    error = 0.5 * float(np.median(sigma)) / (1.4826 * width_b)
    slope = np.sin(0.5 * np.pi * agree) * width_a / width_b * max(1.0 - error**2, 0.0)
    return float(np.clip(-slope / np.median(percent_per_k), -MOST_COUPLING, MOST_COUPLING))


def _correlation(time_s: Array, vapour: Array, temperature: Array) -> float:
    """Correlation of the air's vapour with its temperature on the shortest scale that both are resolved on (some
    seconds)."""
    lag = max(int(round(3.0 / typical_period(time_s))), 1)
    if time_s.size < 20 * lag:
        return 0.0
    a, b = vapour[lag:] - vapour[:-lag], temperature[lag:] - temperature[:-lag]
    # by signs (quadrant correlation), so that one front does not speak for the whole flight
    agree = np.mean(np.sign(a - np.median(a)) * np.sign(b - np.median(b)))
    return float(np.sin(0.5 * np.pi * agree))


def _gather(count: int, rows: NDArray[np.int64], bead: _Channel, film: _Channel, notes: list[str]) -> Corrected:
    def spread(values: Array) -> Array:
        out = np.full(count, np.nan)
        out[rows] = values
        return out

    flags = {name: np.zeros(count, dtype=bool) for name in FLAGS}
    stray = np.ones(count, dtype=bool)
    stray[rows] = False
    flags["implausible"] |= stray
    flags["not_corrected"] |= stray
    for channel in (bead, film):
        s = channel.screened
        present = not s.missing.all()
        if not present:
            continue
        for name, mask in (
            ("gap", s.missing),
            ("repeated", s.repeated),
            ("implausible", s.implausible),
            ("outside_profile", channel.outside),
            ("not_corrected", channel.raw),
        ):
            flags[name][rows] |= mask
    return Corrected(
        spread(bead.value),
        spread(bead.uncertainty),
        spread(film.value),
        spread(film.uncertainty),
        flags,
        tuple(notes),
        {channel.name: channel.cutoff_hz for channel in (bead, film)},
    )
