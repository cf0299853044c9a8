"""The kinds of flights of flight_harm.py, by name; strengths are drawn from the seed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from flight_worlds import (
    FILM_RATE,
    FINE_S,
    World,
    air,
    changed,
    clock,
    driven,
    saturation_hpa,
    steep,
    through,
)
from scipy.signal import lfilter

Array = np.ndarray
Rng = np.random.Generator
COARSE = {"period_s": 1.0, "step_k": 0.1, "step_percent": 1.0}
COLD_C = (-40.0, -30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0)
TURN_S = 120.0


def calm(rng: Rng) -> World:
    return air(rng, np.full(clock().size, rng.uniform(8, 25)), rng.uniform(30, 70), k=0.01, percent=0.05)


def convective(rng: Rng, strength: float = 1.0) -> World:
    strength = strength * rng.uniform(0.7, 1.4)
    level = np.full(clock().size, rng.uniform(8, 28))
    return air(rng, level, rng.uniform(35, 65), k=0.4 * strength, percent=2.0 * strength)


def front(rng: Rng, width_s: float = 10.0) -> World:
    start = rng.uniform(90, 130)
    fall, first = -rng.uniform(4, 10), rng.uniform(18, 28)
    temperature = through(clock(), [start, start + width_s], [first, first + fall], 0.4)
    moist = through(clock(), [start, start + width_s], [rng.uniform(35, 45), rng.uniform(45, 60)], 0.4)
    return air(rng, temperature, moist, at_c=first + fall, k=0.03, percent=0.15)


def profile(rng: Rng, depth_m: float = 40.0, k: float = 0.0, percent: float = 0.0, down: bool = False) -> World:
    time = clock()
    speed = 5.0 if down else 2.5
    height = speed * np.minimum(time, 2 * TURN_S - time) if down else speed * time
    base, warmer = rng.uniform(180, 320), rng.uniform(2, 6)
    ground = rng.uniform(12, 25)
    at = [0.0, base, base + depth_m, 650.0]
    lapse = [ground, ground - 0.0098 * base]
    rest = 650.0 - base - depth_m
    values = [*lapse, lapse[1] + warmer, lapse[1] + warmer - 0.0098 * rest]
    smooth = np.interp(height, at, values), np.interp(height, at, [1.0, 1.0, 0.5, 0.5])
    temperature, share = (through(time, list(time), list(v), 0.8) for v in smooth)
    return air(rng, temperature, rng.uniform(40, 55) * share, at_c=ground, k=k, percent=percent, altitude_m=height)


def stairs(rng: Rng) -> World:
    times = np.repeat(np.arange(30.0, 240.0, 30.0), 2) + np.tile([0.0, 4.0], 7)
    levels = np.repeat(rng.uniform(15, 22, 8), 2)[1:-1]
    moist = np.repeat(rng.uniform(35, 65, 8), 2)[1:-1]
    return air(rng, through(clock(), times, levels), through(clock(), times, moist), at_c=20.0, k=0.02, percent=0.1)


def door(rng: Rng, fall_k: float = -15.0, moist: float = 1.0, times: tuple[float, ...] = (100.0,)) -> World:
    """Temperature steps within a sample; vapour stays, or steps by the factor `moist` with it."""
    time = clock()
    steps = sum((-1) ** i * (time >= t + rng.uniform(0, 1)) for i, t in enumerate(times))
    inside = rng.uniform(22, 28) if fall_k < 0 else rng.uniform(2, 8)
    temperature = inside + fall_k * rng.uniform(0.8, 1.2) * steps
    cold = float(temperature.min())
    return air(rng, temperature, rng.uniform(40, 60) * moist**steps, at_c=cold, k=0.02, percent=0.1)


def same_humidity(rng: Rng) -> World:
    time = clock()
    temperature = rng.uniform(22, 26) - 10.0 * (time >= 100.0 + rng.uniform(0, 1))
    return air(rng, temperature, rng.uniform(35, 55), k=0.02, percent=0.1)


def hatch(rng: Rng) -> World:
    """Out of a warm car within a second and not at once, vapour at rest."""
    start = rng.uniform(90, 110)
    first = rng.uniform(24, 32)
    temperature = through(clock(), [start, start + 1.0], [first, first - 14.0], 0.1)
    return air(rng, temperature, rng.uniform(40, 60), at_c=first - 14.0, k=0.02, percent=0.1)


def plumes(rng: Rng) -> World:
    time = clock()
    bumps = sum(np.exp(-0.5 * ((time - at) / rng.uniform(1.0, 4.0)) ** 2) for at in rng.uniform(15, 225, 8))
    return air(rng, 20.0 + 1.5 * bumps, 45.0 + 6.0 * bumps, at_c=20.0, k=0.05, percent=0.3)


def cloud(rng: Rng) -> World:
    start = rng.uniform(90, 120)
    temperature = through(clock(), [0.0, 240.0], [12.0, 7.0])
    moist = through(clock(), [start, start + 5, start + 60, start + 65], [80.0, 100.0, 100.0, 75.0], 0.5)
    return air(rng, temperature, moist, k=0.03, percent=0.1)


def dry_layer(rng: Rng) -> World:
    start = rng.uniform(90, 120)
    moist = through(clock(), [start, start + 6], [rng.uniform(30, 50), rng.uniform(2, 4)], 0.5)
    temperature = through(clock(), [start, start + 6], [15.0, 18.0], 0.5)
    return air(rng, temperature, moist, k=0.05, percent=0.1)


def cold(rng: Rng) -> World:
    level = rng.uniform(-30, -22)
    temperature = through(clock(), [80.0, 120.0], [level, level + 3.0], 1.0)
    moist = through(clock(), [80.0, 120.0], [50.0, 65.0], 1.0)
    return changed(air(rng, temperature, moist, k=0.1, percent=0.5), film_t98_s=steep, ambients_c=COLD_C)


def cold_ascent(rng: Rng) -> World:
    top = rng.uniform(-35, -28)
    temperature = through(clock(), [20.0, 220.0], [8.0, top], 2.0)
    moist = through(clock(), [20.0, 100.0, 110.0, 220.0], [60.0, 75.0, 40.0, 55.0], 1.0)
    return changed(air(rng, temperature, moist, k=0.05, percent=0.3), film_t98_s=steep, ambients_c=COLD_C)


def steep_inversion(rng: Rng) -> World:
    start = rng.uniform(90, 120)
    temperature = through(clock(), [0.0, start, start + 15, 240.0], [-4.0, -12.0, -6.0, -11.0], 1.0)
    moist = through(clock(), [start, start + 15], [75.0, 35.0], 1.0)
    return changed(air(rng, temperature, moist, k=0.03, percent=0.2), film_t98_s=steep, ambients_c=COLD_C)


def hot(rng: Rng) -> World:
    return air(rng, np.full(clock().size, rng.uniform(34, 38)), rng.uniform(75, 85), k=0.3, percent=2.0)


def waves(rng: Rng) -> World:
    time, period = clock(), rng.uniform(15, 40)
    swing = np.sin(2 * np.pi * time / period)
    return air(rng, 15.0 + 1.0 * swing, 55.0 + 5.0 * np.sin(2 * np.pi * time / period + 1.0), k=0.03, percent=0.2)


def _missing(log: dict[str, Array], rng: Rng) -> None:
    for name in ("temperature_c", "humidity_percent"):
        log[name][rng.random(log[name].size) < 0.2] = np.nan
    at = int(rng.integers(500, 1500))
    log["humidity_percent"][at : at + 40] = np.nan


def _noisier(log: dict[str, Array], rng: Rng) -> None:
    """In three stretches of each channel (3 to 60 s) noise is one and a half to six times as much."""
    for name, noise in (("temperature_c", 0.02), ("humidity_percent", 0.06)):
        for _ in range(3):
            size = int(rng.uniform(30, 600))
            at = slice(start := int(rng.integers(0, log[name].size - size)), start + size)
            times = np.exp(rng.uniform(np.log(1.5), np.log(6.0)))
            log[name][at] += noise * np.sqrt(times**2 - 1.0) * rng.standard_normal(size)


def _repeats(log: dict[str, Array], rng: Rng) -> None:
    for name, share in (("temperature_c", 0.1), ("humidity_percent", 0.18)):
        values = log[name]
        for i in np.flatnonzero(rng.random(values.size) < share):
            values[i] = values[max(i - 1, 0)]


def _absurd(log: dict[str, Array], rng: Rng) -> None:
    for name in ("temperature_c", "humidity_percent"):
        log[name][rng.integers(0, log[name].size, 6)] = rng.choice([6526.9, -99.0, 0.0, 95.0], 6)


def _clock_steps(*steps: tuple[float, float]) -> Callable[[dict[str, Array], Rng], None]:
    def damage(log: dict[str, Array], rng: Rng) -> None:
        true = log["time_s"].copy()
        for at, by in steps:
            log["time_s"][true > at + rng.uniform(0, 5)] += by

    return damage


def _restarted(at: float, lost_s: tuple[float, float], by: float) -> Callable[[dict[str, Array], Rng], None]:
    """Rows lost for a while, and another clock after them: what a logger does whose supply fails."""

    def damage(log: dict[str, Array], rng: Rng) -> None:
        first = at + rng.uniform(0, 20)
        true, last = log["time_s"].copy(), first + rng.uniform(*lost_s)
        lost = (true > first) & (true <= last)
        for name in ("time_s", "temperature_c", "humidity_percent"):
            log[name][lost] = np.nan
        log["time_s"][true > last] += by

    return damage


def lagged(values: Array, time_constant_s: float) -> Array:
    """Behind values on the fine clock, from rest."""
    decay = np.exp(-FINE_S / time_constant_s)
    return lfilter([1 - decay], [1.0, -decay], values, zi=[decay * values[0]])[0]


def _second_lag(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    scale = saturation_hpa(world.temperature_c) / 100.0
    slow = lagged(world.vapour_hpa, rng.uniform(40, 80)) / scale
    return bead, 0.8 * humidity + 0.2 * slow


def _by_humidity(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    return bead, driven("film", rate, 100.0 * world.vapour_hpa / saturation_hpa(world.temperature_c))


def _late_die(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    die = lagged(world.temperature_c, rng.uniform(14, 20))
    return bead, humidity * saturation_hpa(world.temperature_c) / saturation_hpa(die)


def _logger_mean(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    width = round(rng.uniform(4.0, 8.0) / FINE_S)

    def mean(values: Array) -> Array:
        total = np.cumsum(np.concatenate([np.full(width, values[0]), values]))
        return (total[width:] - total[:-width]) / width

    return mean(bead), mean(humidity)


def _hysteresis(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """A loop of play: the reading stays behind the humidity by up to `half`, whichever way it went."""
    half, out = rng.uniform(1.0, 2.0), np.empty(humidity.size)
    state = humidity[0]
    for i, value in enumerate(humidity.tolist()):
        state = min(max(state, value - half), value + half)
        out[i] = state
    return bead, out


def _sun(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    time = np.arange(bead.size) * FINE_S
    lit = sum(((time > at) & (time < at + rng.uniform(5, 20))).astype(float) for at in rng.uniform(20, 200, 5))
    return bead + lagged(rng.uniform(0.8, 1.8) * np.minimum(lit, 1.0), 0.5), humidity


def _circling(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """Circles in the sun: the bead is in the arm's shade for a part of each."""
    time = np.arange(bead.size) * FINE_S
    seen = np.cos(2 * np.pi * (time / rng.uniform(12, 30) + rng.random()))
    return bead + rng.uniform(0.2, 0.8) * lagged(np.maximum(seen, 0.0), 0.5), humidity


def _ice(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """Ice on the bead: slower, and near freezing while it melts."""
    time = np.arange(bead.size) * FINE_S
    start = rng.uniform(60, 90)
    iced = (time > start) & (time < start + rng.uniform(50, 80))
    held = np.where(iced, lagged(bead, 12.0) - 1.0, bead)
    return lagged(held, 0.5), humidity


def _no_fan(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """The fan fails: the bead is slower, and warmed by what is around it."""
    time = np.arange(bead.size) * FINE_S
    failed = time > rng.uniform(80, 120)
    warm = lagged(np.where(failed, rng.uniform(0.5, 1.5), 0.0), 8.0)
    return np.where(failed, lagged(bead, 3.0), bead) + warm, humidity


def _fan_now_and_then(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """A loose plug at the fan: off for ten seconds now and then, the bead slower and warmer meanwhile."""
    time = np.arange(bead.size) * FINE_S
    off = np.zeros(bead.size, dtype=bool)
    for at in rng.uniform(20, 220, 5):
        off |= (time > at) & (time < at + rng.uniform(6, 14))
    warm = lagged(np.where(off, rng.uniform(0.4, 1.0), 0.0), 2.0)
    return np.where(off, lagged(bead, 2.0), bead) + warm, humidity


def _warm_logger(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """The hygrometer warms by a kelvin or two within minutes of being switched on, and reads low by that."""
    time = np.arange(bead.size) * FINE_S
    over = rng.uniform(0.5, 2.0) * -np.expm1(-time / rng.uniform(60, 150))
    return bead, humidity * saturation_hpa(world.temperature_c) / saturation_hpa(world.temperature_c + over)


def _supply(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """The supply sags when the motors draw: humidity has a step in its gain, and back."""
    time = np.arange(bead.size) * FINE_S
    start = rng.uniform(50, 100)
    low = (time > start) & (time < start + rng.uniform(30, 90))
    return bead, humidity * np.where(low, 1.0 - rng.uniform(0.01, 0.03), 1.0)


def _own_wash(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """It sinks through the warm air of its own rotors, which both sensors are in."""
    sinks = np.gradient(world.altitude_m) < 0.0
    over = lagged(np.where(sinks, rng.uniform(0.3, 0.8), 0.0), 3.0)
    return bead + over, humidity * saturation_hpa(world.temperature_c) / saturation_hpa(world.temperature_c + over)


def _wet_film(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """Dew on the film behind a cloud: it reads saturation until that is gone, then goes on from there."""
    time = np.arange(bead.size) * FINE_S
    start, lasting = rng.uniform(120, 150), rng.uniform(15, 40)
    wet = np.where((time > start - 8.0) & (time < start + lasting), 100.0, humidity)
    return bead, np.where(time > start - 8.0, np.maximum(lagged(wet, 2.0), humidity), humidity)


def _drops(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """Drizzle: now and then a drop covers a part of the film, and dries within seconds."""
    time = np.arange(bead.size) * FINE_S
    share = np.zeros(bead.size)
    for at in np.sort(rng.uniform(30, 220, 4)):
        share = np.where(time >= at, np.maximum(share, rng.uniform(0.2, 0.6) * (time < at + rng.uniform(2, 8))), share)
    share = lagged(share, 1.5)
    return bead, humidity + share * (100.0 - humidity)


def _heated_film(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """A hygrometer that heats itself for ten seconds once a minute, to stay dry."""
    time = np.arange(bead.size) * FINE_S
    over = lagged(np.where((time + rng.uniform(0, 60)) % 60.0 < 10.0, rng.uniform(2.0, 4.0), 0.0), 3.0)
    scale = saturation_hpa(world.temperature_c)
    return bead, humidity * scale / saturation_hpa(world.temperature_c + over)


def _wake(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    """A motor's warm wake over the bead, for a second or two, again and again while it hovers."""
    time = np.arange(bead.size) * FINE_S
    hit = np.zeros(bead.size)
    for at in np.cumsum(rng.uniform(4.0, 12.0, 40)):
        hit[(time > at) & (time < at + rng.uniform(0.5, 2.0))] = rng.uniform(0.3, 1.2)
    return bead + lagged(hit, 0.3), humidity


def _late_die_at_a_door(world: World, bead: Array, humidity: Array, rate: Array, rng: Rng) -> tuple[Array, Array]:
    die = lagged(world.temperature_c, rng.uniform(8, 15))
    return bead, humidity * saturation_hpa(world.temperature_c) / saturation_hpa(die)


def _half_kelvins(log: dict[str, Array], rng: Rng) -> None:
    """A logger that keeps the temperature in halves of a kelvin, and the humidity as it comes."""
    log["temperature_c"] = np.round(2.0 * log["temperature_c"]) / 2.0


def thermals(rng: Rng) -> World:
    """Circling: in and out of moist thermals, every half minute."""
    time, period = clock(), rng.uniform(20, 40)
    inside = 1.0 / (1.0 + np.exp(-8.0 * np.sin(2 * np.pi * time / period)))
    return air(rng, 18.0 + 1.2 * inside, 50.0 + 10.0 * inside, at_c=18.0, k=0.08, percent=0.4)


def long_layers(rng: Rng) -> World:
    """Twenty minutes through layers, for a film slower than a window."""
    time = clock(1200.0)
    at = np.sort(rng.uniform(60, 1140, 6))
    moist = through(
        time, list(np.repeat(at, 2) + np.tile([0.0, 8.0], 6)), list(np.repeat(rng.uniform(30, 80, 7), 2)[1:-1])
    )
    temperature = through(time, [0.0, 1200.0], [22.0, 15.0], 0.0)
    return air(rng, temperature, moist, at_c=18.0, k=0.05, percent=0.3)


def with_sensors(world: World, sensors: Callable[..., tuple[Array, Array]]) -> World:
    return changed(world, sensors=sensors)


def slow_film(rng: Rng, t63_s: float) -> World:
    return changed(long_layers(rng), film_t98_s=lambda t: np.full(np.shape(t), t63_s / 0.32025 * FILM_RATE))


def with_rows(world: World, rows: Callable[[dict[str, Array], Rng], None]) -> World:
    return changed(world, rows=rows)


KINDS: dict[str, Callable[[Rng], World]] = {
    "calm": calm,
    "convective, weak": lambda r: convective(r, 0.25),
    "convective": convective,
    "convective, strong": lambda r: convective(r, 2.5),
    "front": front,
    "front, narrow": lambda r: front(r, 2.0),
    "inversion": profile,
    "inversion, sharp": lambda r: profile(r, 8.0),
    "inversion, turbulent": lambda r: profile(r, 40.0, 0.08, 0.4),
    "up and down": lambda r: profile(r, 40.0, 0.04, 0.2, True),
    "stairs": stairs,
    "door, out of warmth": door,
    "door, into warmth": lambda r: door(r, 18.0),
    "door, in and out": lambda r: door(r, -12.0, 1.0, (60.0, 110.0, 170.0)),
    "door, vapour too": lambda r: door(r, -12.0, 0.7),
    "step at constant RH": same_humidity,
    "hatch, in a second": hatch,
    "plumes": plumes,
    "cloud": cloud,
    "dry layer": dry_layer,
    "very cold": cold,
    "very cold ascent": cold_ascent,
    "cold inversion": steep_inversion,
    "hot and humid": hot,
    "waves": waves,
    "missing samples": lambda r: with_rows(profile(r, 40.0, 0.04, 0.2), _missing),
    "noisier by stretches": lambda r: with_rows(profile(r, 40.0, 0.04, 0.2), _noisier),
    "repeated samples": lambda r: with_rows(convective(r, 0.6), _repeats),
    "absurd samples": lambda r: with_rows(profile(r, 40.0, 0.04, 0.2), _absurd),
    "clock back": lambda r: with_rows(profile(r, 40.0, 0.04, 0.2), _clock_steps((100.0, -20.0))),
    "clock ahead": lambda r: with_rows(front(r), _clock_steps((115.0, 35.0))),
    "clock back and ahead": lambda r: with_rows(
        convective(r), _clock_steps((60.0, -8.0), (110.0, 12.0), (170.0, -90.0))
    ),
    "restarted, inversion": lambda r: with_rows(profile(r, 40.0, 0.04, 0.2), _restarted(80.0, (5.0, 30.0), -70.0)),
    "restarted, convective": lambda r: with_rows(convective(r), _restarted(80.0, (2.0, 20.0), 40.0)),
    "coarse, calm": lambda r: changed(calm(r), **COARSE),
    "coarse, convective": lambda r: changed(convective(r), **COARSE),
    "coarse, inversion": lambda r: changed(profile(r, 40.0, 0.04, 0.2), **COARSE),
    "half kelvins": lambda r: with_rows(profile(r, 40.0, 0.04, 0.2), _half_kelvins),
    "D stated 20 % high": lambda r: changed(profile(r, 40.0, 0.04, 0.2, True), stated=1.2, stated_relative=0.02),
    "D stated 20 % low": lambda r: changed(front(r), stated=0.8, stated_relative=0.02),
    "noise three times": lambda r: changed(convective(r, 0.6), noise=3.0),
    "every second": lambda r: changed(profile(r, 40.0, 0.04, 0.2), period_s=1.0),
    "slow film": lambda r: changed(profile(r, 40.0, 0.04, 0.2), film_t98_s=lambda t: np.full(np.shape(t), 60.0)),
    "slow film, t63 80 s": lambda r: slow_film(r, 80.0),
    "slow film, t63 160 s": lambda r: slow_film(r, 160.0),
    "sun bursts": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _sun),
    "sun while circling": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _circling),
    "icing": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _ice),
    "fan failure": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _no_fan),
    "fan failure, both ways": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _no_fan),
    "fan now and then": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _fan_now_and_then),
    "its own wash": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _own_wash),
    "hygrometer warms up": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _warm_logger),
    "supply sags": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _supply),
    "wet film": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _wet_film),
    "drops on the film": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _drops),
    "heated film": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _heated_film),
    "a motor's wake": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2), _wake),
    "door, late die": lambda r: with_sensors(
        air(r, 24.0 - 12.0 * (clock() > 100.0), 50.0, at_c=12.0, k=0.02, percent=0.1), _late_die_at_a_door
    ),
    "second lag": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _second_lag),
    "film in RH": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _by_humidity),
    "late die": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _late_die),
    "logger mean": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _logger_mean),
    "hysteresis": lambda r: with_sensors(profile(r, 40.0, 0.04, 0.2, True), _hysteresis),
    "thermals": thermals,
    "saturated fog": lambda r: air(r, through(clock(), [80.0, 100.0], [6.0, 4.0], 1.0), 100.0, k=0.05),
}
assert saturation_hpa(np.array(100.0)).round(2) == 1013.25
