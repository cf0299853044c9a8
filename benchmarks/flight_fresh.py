"""Kinds of flights that nothing was tuned to: written after the correction, drawn and counted once (flight_harm.py
--fresh). Whoever mends something by them moves them to flight_kinds.py, and writes others.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from flight_kinds import FINE_S, Rng, lagged, profile, with_rows, with_sensors
from flight_worlds import World, air, changed, clock, driven, saturation_hpa, through

Array = np.ndarray


def _tightening(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """Circles in the sun that become tighter: by the flight's end one takes two thirds of what it took at first."""
    time = np.arange(bead.size) * FINE_S
    turns = np.cumsum(FINE_S / (rng.uniform(15, 30) * np.linspace(1.0, 2.0 / 3.0, time.size)))
    seen = np.cos(2 * np.pi * (turns + rng.random()))
    return bead + rng.uniform(0.2, 0.8) * lagged(np.maximum(seen, 0.0), 0.5), humidity


def _sees_the_motors(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """Weaving against the wind: the hygrometer's own air is warmer in every other leg, and the bead's is not."""
    time = np.arange(bead.size) * FINE_S
    over = rng.uniform(0.2, 0.8) * lagged((time / rng.uniform(8, 20) + rng.random()) % 2.0 < 1.0, 2.0)
    return bead, humidity * saturation_hpa(world.temperature_c) / saturation_hpa(world.temperature_c + over)


def _soaked(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """Taken off out of a warm box: the arm warms the air at both sensors for a minute or so, and less and less."""
    time = np.arange(bead.size) * FINE_S
    warm = rng.uniform(1.0, 4.0) * np.exp(-time / rng.uniform(15, 50))
    scale = saturation_hpa(world.temperature_c)
    return bead + warm, humidity * scale / saturation_hpa(world.temperature_c + warm)


def _wet_bead(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """Drops on the bead: it is a wet bulb for a while, and dries within seconds."""
    time = np.arange(bead.size) * FINE_S
    start = rng.uniform(60, 120)
    wet = (time > start) & (time < start + rng.uniform(20, 60))
    depth = rng.uniform(0.2, 0.5) * (1.0 - np.minimum(humidity, 100.0) / 100.0) * 10.0
    return bead - lagged(np.where(wet, depth, 0.0), 2.0), humidity


def _dust_cap(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """A cap of sintered metal over the film that the profile does not have."""
    scale = saturation_hpa(world.temperature_c)
    return bead, lagged(humidity * scale, rng.uniform(5, 12)) / scale


def hops(rng: Rng) -> World:
    """Up in hops of some thirty metres, hovering between them, through an inversion on the way."""
    time = clock()
    times = np.cumsum(np.ravel([(rng.uniform(12, 22), rng.uniform(4, 8)) for _ in range(14)]))
    levels = np.cumsum(rng.uniform(20, 40, 15))
    height = through(time, list(times), list(np.repeat(levels, 2)[1:-1]), 0.5)
    base = rng.uniform(100, 250)
    warmer = rng.uniform(2, 5) / (1.0 + np.exp(-(height - base) / 10.0))
    share = 1.0 - 0.4 / (1.0 + np.exp(-(height - base) / 10.0))
    return air(rng, 18.0 - 0.0098 * height + warmer, 50.0 * share, at_c=18.0, k=0.05, percent=0.3, altitude_m=height)


def sea_breeze(rng: Rng) -> World:
    """Low over a shore: cool and moist against warm and dry, three times, at any instant."""
    time = clock()
    at = np.sort(rng.uniform(30, 210, 6))
    times = list(np.repeat(at, 2) + np.tile([0.0, rng.uniform(1.0, 4.0)], 6))
    warm, cool = rng.uniform(24, 28), rng.uniform(19, 22)
    temperature = through(time, times, [warm, cool, cool, warm] * 3, 0.3)
    moist = through(time, times, [45.0, 70.0, 70.0, 45.0] * 3, 0.3)
    return air(rng, temperature, moist, k=0.06, percent=0.3)


def snow_hole(rng: Rng) -> World:
    """A cold pool in a valley: 8 K colder within 20 m, passed twice."""
    time = clock()
    height = 1.5 * np.minimum(time, 240.0 - time)
    temperature = -4.0 - 8.0 / (1.0 + np.exp((height - rng.uniform(60, 110)) / 4.0))
    return air(rng, temperature, 80.0, k=0.04, percent=0.2, altitude_m=height)


def _jitter(log: dict[str, Array], rng: Rng) -> None:
    """Rows are written up to 40 ms late by a logger that has other things to do, and some never."""
    log["time_s"] += rng.uniform(0.0, 0.04, log["time_s"].size)
    lost = rng.random(log["time_s"].size) < 0.05
    for name in ("time_s", "temperature_c", "humidity_percent"):
        log[name][lost] = np.nan


def _whole_seconds(log: dict[str, Array], rng: Rng) -> None:
    """A clock that ticks in seconds beside rows that are a little faster."""
    log["time_s"] = np.floor(log["time_s"] * rng.uniform(1.05, 1.25)) / 1.0


def _late_humidity(log: dict[str, Array], rng: Rng) -> None:
    """The hygrometer's last value is written: it is a second old."""
    log["humidity_percent"] = np.interp(log["time_s"] - rng.uniform(0.6, 1.4), log["time_s"], log["humidity_percent"])


def _ranges(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """A converter that changes its range: the temperature is 0.3 K or so higher above a threshold."""
    return bead + rng.uniform(0.2, 0.4) * (bead > np.median(bead)), humidity


def _ages(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """Dust settles on the film: by the flight's end it takes a half longer than at its start."""
    slower = 1.0 + rng.uniform(0.3, 0.7) * np.linspace(0.0, 1.0, bead.size)
    return bead, 100.0 * driven("film", rate / slower, world.vapour_hpa) / saturation_hpa(world.temperature_c)


def _steps_of_height(log: dict[str, Array], rng: Rng) -> None:
    """An altitude of a receiver that writes tens of metres."""
    log["altitude_m"] = 10.0 * np.round(log["altitude_m"] / 10.0)


def _radio(log: dict[str, Array], rng: Rng) -> None:
    """A telemetry log: nothing for some seconds, again and again, both channels at once."""
    time = log["time_s"]
    lost = np.zeros(time.size, dtype=bool)
    for at in rng.uniform(5, 230, 10):
        lost |= (time > at) & (time < at + rng.uniform(1.0, 9.0))
    for name in ("temperature_c", "humidity_percent"):
        log[name][lost] = np.nan


def _late_altitude(log: dict[str, Array], rng: Rng) -> None:
    """A barometer in a tight box: the altitude is seconds late, so that the ways disagree by its lag."""
    log["altitude_m"] = np.interp(log["time_s"] - rng.uniform(1.0, 4.0), log["time_s"], log["altitude_m"])


def _regained(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """The film loses what had settled on it within a minute or so: it reads low at first, and right at last."""
    time = np.arange(bead.size) * FINE_S
    at = rng.uniform(60, 150)
    return bead, humidity * (1.0 - rng.uniform(0.02, 0.06) / (1.0 + np.exp((time - at) / rng.uniform(5, 15))))


def risen(rng: Rng) -> World:
    """The air itself changes: what is passed on the way down lies 10 to 25 m higher than on the way up."""
    world = profile(rng, 40.0, 0.04, 0.2, True)
    down = np.gradient(world.altitude_m) < 0.0
    return changed(world, altitude_m=world.altitude_m + np.where(down, -rng.uniform(10, 25), 0.0))


def doors(rng: Rng) -> World:
    """In and out of a warm hall, four times, vapour with it."""
    time = clock()
    inside = np.zeros(time.size)
    for at in np.sort(rng.uniform(20, 220, 4)):
        inside = np.where(time >= at, 1.0 - inside, inside)
    return air(rng, 8.0 + 12.0 * inside, 60.0 + 15.0 * inside, at_c=8.0, k=0.03, percent=0.2)


FRESH: dict[str, Callable[[Rng], World]] = {
    "sun in a spiral": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _tightening),
    "warm in every other leg": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _sees_the_motors),
    "out of its box": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _soaked),
    "wet bead": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _wet_bead),
    "dust cap": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _dust_cap),
    "hops": hops,
    "sea breeze": sea_breeze,
    "cold pool, twice": snow_hole,
    "jitter": lambda r: with_rows(profile(r, 40.0, 0.04, 0.2), _jitter),
    "clock in seconds": lambda r: changed(with_rows(profile(r, 40.0, 0.04, 0.2), _whole_seconds), period_s=1.0),
    "dust settles": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _ages),
    "tens of metres": lambda r: with_rows(profile(r, 40.0, 0.04, 0.2, True), _steps_of_height),
    "late humidity": lambda r: with_rows(profile(r, 40.0, 0.04, 0.2, True), _late_humidity),
    "converter's ranges": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _ranges),
    "radio that fails": lambda r: with_rows(profile(r, 40.0, 0.04, 0.2), _radio),
    "doors, radio fails": lambda r: with_rows(doors(r), _radio),
    "film regains itself": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _regained),
    "inversion risen": risen,
    "late altitude": lambda r: with_rows(profile(r, 40.0, 0.04, 0.2, True), _late_altitude),
}
