"""A sensor flown through weather, in three parts: element stepped at 0.01 s, sampling at 0.1 s, noise floor.

Finite volumes: V dx/dt = -K x + g (u(t) - x), backward differences of second order, conductances refreshed as D follows
the air's temperature and the Biot numbers the airspeed. It shares no code with the closed forms that correct flights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.linalg import lapack

from shockrig.analysis.flight.weather import FINE_STEP_S, Weather
from shockrig.analysis.physics.humidity import humidity_from_ppmv, ppmv_from_humidity
from shockrig.files.errors import InputError
from shockrig.files.profile import Effect, HumidityProfile, Profile, TemperatureProfile

Array = NDArray[np.float64]
CELLS = 48
SAMPLING_PERIOD_S = 0.1
NOISE_K = 0.02
NOISE_PERCENT = 0.06
REFERENCE_AIRSPEED_M_S = 5.0
AIR_VISCOSITY_M2_S = 1.5e-5  # dry air at 20 degC, 1013 hPa
PRANDTL = 0.71
DIE_TIME_CONSTANT_S = 17.0  # a humidity chip in flight follows the air so (iMet-XQ2 flights: 17 to 19 s)
HYSTERESIS_SPAN_PERCENT = 5.0  # change of humidity over which hysteresis sets in

FLOWN_EFFECTS = frozenset(
    "convective_film stem_conduction self_heating calibration_error dead_time moving_average quantization "
    "vapour_boundary_layer slow_relaxation die_thermal_lag hysteresis saturation_clipping stale_samples "
    "direction_dependent_diffusivity concentration_dependent_diffusivity".split()
)
BENCH_EFFECTS = frozenset({"finite_transfer", "air_relaxation"})


@dataclass(frozen=True)
class Flown:
    """What one sensor pair logged in one weather: `log` as a flight's CSV, `truth` the air at the same instants.

    Both frames have a row each 0.1 s: `time_s`, `temperature_c`, `humidity_percent`, and in the log the airspeed,
    pressure and altitude.
    """

    log: pd.DataFrame
    truth: pd.DataFrame


def ventilation(airspeed_m_s: Array, radius_m: float) -> Array:
    """Nusselt number of a sphere in a stream, 2 + 0.6 Re^(1/2) Pr^(1/3) (Ranz and Marshall 1952), shape kept.

    Like all equations of this file its own: the truth that corrections are judged by shares none with them.
    """
    reynolds = np.maximum(airspeed_m_s, 0.0) * 2 * radius_m / AIR_VISCOSITY_M2_S
    return 2.0 + 0.6 * np.sqrt(reynolds) * PRANDTL ** (1 / 3)


def fly(weather: Weather, profile: Profile, seed: int, *, noise: float = 1.0) -> Flown:
    """One flight; `noise` multiplies the profile's noise floors (0 for none)."""
    return fly_many([weather], profile, [seed], noise=noise)[0]


def fly_many(weathers: Sequence[Weather], profile: Profile, seeds: Sequence[int], *, noise: float = 1.0) -> list[Flown]:
    """Several flights of one length at once (the elements are stepped together).

    Raises
    ------
    InputError
        The profile carries an effect that cannot be flown, or the air leaves its table D(T).
    ValueError
        Flights of different lengths.
    """
    sizes = {w.time_s.size for w in weathers}
    if len(sizes) != 1:
        raise ValueError(f"flights of different lengths: {sorted(sizes)}")
    parts = {"temperature": profile.temperature, "humidity": profile.humidity}
    for part in parts.values():
        for effect in part.effects if part else ():
            if effect.effect not in FLOWN_EFFECTS | BENCH_EFFECTS:
                raise InputError(
                    f"profile: effect {effect.effect} cannot be simulated in flight; take it out of the profile"
                )
    air = {
        name: np.stack([getattr(w, name) for w in weathers]) for name in Weather.__dataclass_fields__ if name != "name"
    }
    fine: dict[str, Array] = {}
    if profile.temperature is not None:
        fine["temperature_c"] = _bead(profile.temperature, air)
    if profile.humidity is not None:
        fine.update(_film(profile.humidity, air))
    return [
        _log(weather, profile, {k: v[i] for k, v in fine.items()}, seed, noise)
        for i, (weather, seed) in enumerate(zip(weathers, seeds, strict=True))
    ]


def _effects(part: TemperatureProfile | HumidityProfile) -> dict[str, Effect]:
    return {e.effect: e for e in part.effects}


def _bead(part: TemperatureProfile, air: dict[str, Array]) -> Array:
    effects = _effects(part)
    speed = air["airspeed_m_s"]
    factor = ventilation(speed, part.bead_radius_m) / ventilation(np.array(REFERENCE_AIRSPEED_M_S), part.bead_radius_m)
    biot = np.full(speed.shape, np.inf)
    if (e := effects.get("convective_film")) is not None:
        biot = e.value("biot_at_5_m_s") * factor
    edges = np.linspace(0.0, 1.0, CELLS + 1)
    centres = 0.5 * (edges[1:] + edges[:-1])
    volume = np.diff(edges**3) / 3.0
    rate = part.thermal_diffusivity_m2_s.value / part.bead_radius_m**2
    link = rate / (1.0 / centres[:-1] - 1.0 / centres[1:])
    surface = rate / (1.0 / centres[-1] - 1.0 + 1.0 / biot)
    # cell means that give the value at the centre exactly for a + b r^2 + c r^4
    moments = np.stack([np.diff(edges[:4] ** (3 + p)) / ((3 + p) * volume[:3]) for p in (0, 2, 4)])
    weights = np.concatenate([np.linalg.solve(moments, [1.0, 0.0, 0.0]), np.zeros(CELLS - 3)])
    reading = _march(volume, link, np.ones(1), surface, air["temperature_c"], weights)
    if (e := effects.get("stem_conduction")) is not None:
        stem = _lag(air["temperature_c"], e.value("time_constant_s"))
        reading = (1 - e.value("fraction")) * reading + e.value("fraction") * stem
    if (e := effects.get("self_heating")) is not None:
        reading = reading + e.value("rise_k_at_5_m_s") / factor
    return reading


def _film(part: HumidityProfile, air: dict[str, Array]) -> dict[str, Array]:
    effects = _effects(part)
    temperature = air["temperature_c"]
    ppmv = ppmv_from_humidity(air["humidity_percent"], temperature)
    diffusivity = part.diffusivity_m2_s(temperature)[0] / part.film_thickness_m**2
    biot = np.full(temperature.shape, np.inf)
    if (e := effects.get("vapour_boundary_layer")) is not None:
        biot = e.value("biot_at_5_m_s") * np.sqrt(air["airspeed_m_s"] / REFERENCE_AIRSPEED_M_S)
    edges = -np.expm1(-2.0 * np.linspace(0.0, 1.0, CELLS + 1)) / -np.expm1(-2.0)  # finer towards the open face
    centres = 0.5 * (edges[1:] + edges[:-1])
    widths = np.diff(edges)
    link = 1.0 / np.diff(centres)
    surface = 1.0 / (1.0 - centres[-1] + 1.0 / biot)
    follow = None
    if (e := effects.get("concentration_dependent_diffusivity")) is not None:
        slope, full = e.value("slope_per_unit_activity"), ppmv_from_humidity(100.0, temperature)

        def follow(k: int, state: Array) -> Array:
            return np.maximum(1.0 + slope * (state / full[:, k, None] - 0.5), 0.05)

    elif (e := effects.get("direction_dependent_diffusivity")) is not None:
        ratio = e.value("ratio_drying_to_wetting")

        def follow(k: int, state: Array) -> Array:
            drying = ppmv[:, k] < state @ widths
            return np.broadcast_to(np.where(drying, ratio, 1.0)[:, None], state.shape)

    reading = _march(widths, link, diffusivity, surface, ppmv, widths, follow)
    if (e := effects.get("slow_relaxation")) is not None:
        slow = _lag(ppmv, e.value("time_constant_s"))
        reading = (1 - e.value("fraction")) * reading + e.value("fraction") * slow
    die = _lag(temperature, DIE_TIME_CONSTANT_S)
    own = die if "die_thermal_lag" in effects else temperature
    humidity = humidity_from_ppmv(reading, own)
    if (e := effects.get("hysteresis")) is not None:
        humidity = humidity + _play(humidity, e.value("rh_percent"))
    fine = {"humidity_percent": humidity}
    if "die_thermal_lag" in effects:
        fine["humidity_sensor_temperature_c"] = die
    return fine


def _march(
    capacity: Array, link: Array, scale: Array, surface: Array, drive: Array, weights: Array, follow=None
) -> Array:
    """Reading (r, n) of r chains of cells driven at their open end, from rest.

    `link` (N - 1,) and `surface` (1 or r, n) are conductances, both multiplied by `scale` (1,) or (r, n); `follow`
    gives a further factor for each cell from its state. Chains lie one after another in one symmetric tridiagonal
    system.
    """
    runs, count = drive.shape
    cells = capacity.size
    scale = np.broadcast_to(scale, drive.shape)
    surface = np.broadcast_to(surface, drive.shape)
    steady = follow is None and np.all(scale == scale[:, :1]) and np.all(surface == surface[:, :1])
    heavy = np.tile(capacity, runs) * 1.5 / FINE_STEP_S
    state = np.repeat(drive[:, 0], cells)
    before = state.copy()
    ends = np.arange(1, runs + 1) * cells - 1
    reading = np.empty(drive.shape)
    reading[:, 0] = drive[:, 0]
    per_step = np.tile(capacity, runs) / FINE_STEP_S
    factor = None
    for k in range(1, count):
        if factor is None or not steady:
            local = scale[:, k, None] * (
                np.ones((runs, cells)) if follow is None else follow(k, (2 * state - before).reshape(runs, cells))
            )
            between = link * 0.5 * (local[:, 1:] + local[:, :-1])
            padded = np.zeros((runs, cells + 1))
            padded[:, 1:-1] = between
            opening = surface[:, k] * local[:, -1]
            own = padded[:, 1:] + padded[:, :-1]
            own[:, -1] += opening
            factor = lapack.dpttrf(heavy + own.ravel(), -padded[:, 1:].ravel()[:-1])
        right = per_step * (2.0 * state - 0.5 * before)
        right[ends] += opening * drive[:, k]
        before = state
        state = lapack.dpttrs(factor[0], factor[1], right)[0]
        reading[:, k] = state.reshape(runs, cells) @ weights
    return reading


def _lag(drive: Array, time_constant_s: float) -> Array:
    """First-order lag behind (r, n), from rest, exact for air that is straight over each step."""
    from scipy.signal import lfilter, lfiltic

    x = FINE_STEP_S / time_constant_s
    decay = np.exp(-x)
    new = 1.0 - (1.0 - decay) / x
    b, a = [new, 1.0 - decay - new], [1.0, -decay]
    return np.stack([lfilter(b, a, row, zi=lfiltic(b, a, [row[0]], [row[0]]))[0] for row in drive])


def _play(humidity: Array, height: float) -> Array:
    """Low by `height` after a rise, high by it after a fall, setting in over 5 %RH of change."""
    slope = 2.0 * height / HYSTERESIS_SPAN_PERCENT
    offset = np.zeros(humidity.shape)
    for k in range(1, humidity.shape[1]):
        offset[:, k] = np.clip(offset[:, k - 1] - slope * (humidity[:, k] - humidity[:, k - 1]), -height, height)
    return offset


def _log(weather: Weather, profile: Profile, fine: dict[str, Array], seed: int, noise: float) -> Flown:
    rng = np.random.default_rng(seed)
    step = round(SAMPLING_PERIOD_S / FINE_STEP_S)
    rows = slice(0, None, step)
    time = weather.time_s[rows]
    truth = pd.DataFrame(
        {
            "time_s": time,
            "temperature_c": weather.temperature_c[rows],
            "humidity_percent": weather.humidity_percent[rows],
        }
    )
    log = pd.DataFrame({"time_s": time})
    channels = (
        ("temperature_c", profile.temperature, NOISE_K, 0.01),
        ("humidity_percent", profile.humidity, NOISE_PERCENT, 100 / 16383),
    )
    for column, part, floor, resolution in channels:
        if part is None:
            continue
        given = getattr(part, "noise_k", None) if column == "temperature_c" else part.noise_percent
        effects = _effects(part)
        delay = effects["dead_time"].value("delay_s") if "dead_time" in effects else 0.0
        reading = np.interp(time - delay, weather.time_s, fine[column])
        reading = reading + noise * (floor if given is None else given) * rng.standard_normal(time.size)
        log[column] = _read_out(reading, effects, resolution)
    if "humidity_sensor_temperature_c" in fine:
        log["humidity_sensor_temperature_c"] = np.round(fine["humidity_sensor_temperature_c"][rows], 3)
    for name in ("airspeed_m_s", "pressure_hpa", "altitude_m"):
        log[name] = np.round(getattr(weather, name)[rows], 3)
    return Flown(log, truth)


def _read_out(reading: Array, effects: dict[str, Effect], resolution: float) -> Array:
    if (e := effects.get("calibration_error")) is not None:
        reading = reading * (1 + e.value("gain", 0.0)) + e.value("offset", 0.0)
    if (e := effects.get("saturation_clipping")) is not None:
        reading = np.minimum(reading, e.value("limit_percent"))
    if (e := effects.get("moving_average")) is not None:
        width = max(round(e.value("samples")), 1)
        total = np.cumsum(np.concatenate([np.full(width, reading[0]), reading]))
        reading = (total[width:] - total[:-width]) / width
    if (e := effects.get("stale_samples")) is not None:
        hold = max(round(e.value("hold_samples")), 1)
        reading = np.repeat(reading[::hold], hold)[: reading.size]
    step = effects["quantization"].value("step") if "quantization" in effects else resolution
    return np.round(np.round(reading / step) * step, 6)
