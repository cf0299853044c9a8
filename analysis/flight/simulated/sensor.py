"""A sensor flown through weather, in three parts: element stepped at 0.01 s, sampling at 0.1 s, noise floor.

The truth that corrections are judged by: bodies are finite volumes (element.py), and each effect has its own equation
here, written anew from what its entry in the catalogue says; nothing is shared with the closed forms that correct.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from scipy.linalg import lapack

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.flight.simulated.weather import FINE_STEP_S, Weather
from shockrig.analysis.physics.humidity import humidity_from_ppmv, ppmv_from_humidity
from shockrig.files.errors import InputError
from shockrig.files.profile import HumidityProfile, Profile, StatedEffect, TemperatureProfile
from shockrig.files.profile_data import NOISE_K, NOISE_PERCENT

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

# A sensing body in finite volumes, for flights whose truth shares no code with the closed forms that correct them.
#
# V dx/dt = -K x + g (u(t) - x) in units of the body's length and rate, backward differences of second order;
# conductances are refreshed as the rate follows the air's temperature and the Biot number the airspeed.

VOLUMES = 48
STEPS_AT_ONCE = 4096  # whose modes are kept, which takes memory
SKIN_REFINEMENT = 2.0  # how much finer cells are towards the open face of a body that is read as its mean
# name -> dimension (1 slab, 2 cylinder, 3 sphere), read at the core
SHAPES = {
    "sphere": (3, True),
    "sphere_mean": (3, False),
    "cylinder": (2, True),
    "cylinder_mean": (2, False),
    "plate": (1, True),
    "film": (1, False),
    "lumped": (0, False),
}
Follow = Callable[[int, Array], Array]


@dataclass(frozen=True)
class Cells:
    """N cells from the core (or the sealed face) to the open face.

    Attributes
    ----------
    capacity : ndarray (N,)
    link : ndarray (N - 1,)
        Conductances between neighbours.
    to_surface : float
        Resistance from the last cell's centre to the surface.
    weight : ndarray (N,)
        Of each cell in the reading; sums to 1.
    sheath_s : float
        Time constant with which the last cell follows the air when alone, where it is a sheath; else 0.
    """

    capacity: Array
    link: Array
    to_surface: float
    weight: Array
    sheath_s: float = 0.0


def cells(shape: str) -> Cells:
    """A body of one of SHAPES cut into cells; a lump is one cell with one resistance."""
    dimension, core = SHAPES[shape]
    if dimension == 0:
        return Cells(np.ones(1), np.zeros(0), 1.0, np.ones(1))
    edges = np.linspace(0.0, 1.0, VOLUMES + 1)
    if not core:
        edges = -np.expm1(-SKIN_REFINEMENT * edges) / -np.expm1(-SKIN_REFINEMENT)
    centres = 0.5 * (edges[1:] + edges[:-1])
    capacity = np.diff(edges**dimension) / dimension
    # resistance between two radii: the integral of dr / r^(dimension - 1)
    radii = np.append(centres, 1.0)
    resistance = {1: np.diff(radii), 2: np.diff(np.log(radii)), 3: 1.0 / radii[:-1] - 1.0 / radii[1:]}[dimension]
    weight = capacity / capacity.sum()
    if core:
        # cell means that give the value at the centre exactly for a + b r^2 + c r^4
        powers = [dimension + p for p in (0, 2, 4)]
        moments = np.stack([np.diff(edges[:4] ** p) / (p * capacity[:3]) for p in powers])
        weight = np.concatenate([np.linalg.solve(moments, [1.0, 0.0, 0.0]), np.zeros(VOLUMES - 3)])
    return Cells(capacity, 1.0 / resistance[:-1], float(resistance[-1]), weight)


def sheathed(body: Cells, time_constant_s: float, capacity: float) -> Cells:
    """A body with one more cell around it, which holds `capacity` times what the body holds and is not read."""
    return Cells(
        np.append(body.capacity, capacity * body.capacity.sum()),
        np.append(body.link, 1.0 / body.to_surface),
        body.to_surface,
        np.append(body.weight, 0.0),
        time_constant_s,
    )


def march(body: Cells, rate: Array, biot: Array, drive: Array, follow: Follow | None = None) -> Array:
    """Reading (r, n) of r bodies driven at their surface by `drive` (r, n), from rest.

    Parameters
    ----------
    body : Cells
    rate, biot : ndarray, broadcasting with `drive`
        Rate [1/s] that all conductances are multiplied by, and Biot number of the exchange, infinite where the
        surface is held at the air.
    drive : ndarray (r, n)
        The air, every FINE_STEP_S.
    follow : (step, states (r, N)) -> ndarray (r, N), optional
        A further factor of the rate in each cell.

    Notes
    -----
    Chains of cells lie one after another in one symmetric tridiagonal system. A sheath has no rate of its own: it
    follows the air at its time constant, through the film of `biot` where there is one, and what the body takes from it
    goes at the rate of the body's last cell. Where there is no sheath and the exchange stays as it is, the system is
    solved in its modes, many times as fast.
    """
    runs, count = drive.shape
    size = body.capacity.size
    scale = np.broadcast_to(rate, drive.shape)
    film = np.broadcast_to(1.0 / biot, drive.shape)
    surface = 1.0 / (body.to_surface + film)
    if follow is None and not body.sheath_s and np.all(surface == surface[:, :1]):
        return _by_modes(body, scale, surface[:, 0], drive)
    steady = follow is None and bool(np.all(scale == scale[:, :1]) and np.all(surface == surface[:, :1]))  # in a sheath
    heavy = np.tile(body.capacity, runs) * 1.5 / FINE_STEP_S
    state = np.repeat(drive[:, 0], size)
    before = state.copy()
    ends = np.arange(1, runs + 1) * size - 1
    reading = np.empty(drive.shape)
    reading[:, 0] = drive[:, 0]
    per_step = np.tile(body.capacity, runs) / FINE_STEP_S
    factor, opening = None, np.zeros(runs)
    for k in range(1, count):
        if factor is None or not steady:
            own_factor = np.ones((runs, size))
            if follow is not None:
                own_factor = follow(k, (2 * state - before).reshape(runs, size))
            local = scale[:, k, None] * own_factor
            if body.sheath_s:
                local[:, -1] = local[:, -2]
            between = np.zeros((runs, size + 1))
            between[:, 1:-1] = body.link * 0.5 * (local[:, 1:] + local[:, :-1])
            opening = surface[:, k] * local[:, -1]
            if body.sheath_s:
                opening = 1.0 / (body.sheath_s / body.capacity[-1] + film[:, k] / local[:, -1])
            own = between[:, 1:] + between[:, :-1]
            own[:, -1] += opening
            beside = -between[:, 1:].ravel()[:-1]
            factor = lapack.dpttrf(heavy + own.ravel(), beside if beside.size else np.zeros(1))  # a lump has none
        right = per_step * (2.0 * state - 0.5 * before)
        right[ends] += opening * drive[:, k]
        before = state
        state = lapack.dpttrs(factor[0], factor[1], right)[0]
        reading[:, k] = state.reshape(runs, size) @ body.weight
    return reading


def _by_modes(body: Cells, scale: Array, surface: Array, drive: Array) -> Array:
    """The same (r, n) for bodies whose conductances all go with one factor `scale` (r, n), with `surface` (r,) to the
    air: the modes of their cells then stay the same, and each step is one of numbers and not of a system."""
    root, runs = np.sqrt(body.capacity), surface.size
    decay, shown, taken = np.empty((3, runs, root.size))
    for run in range(runs):
        between = np.concatenate([[0.0], body.link, surface[run : run + 1]])
        decay[run], shapes = linalg.eigh_tridiagonal(
            (between[1:] + between[:-1]) / body.capacity, -body.link / (root[1:] * root[:-1])
        )
        shown[run], taken[run] = (body.weight / root) @ shapes, shapes[-1] * surface[run] / root[-1]
    # Of each mode, in departures from rest: y_k - (4 y_k-1 - y_k-2) / 3 = step (taken u_k - decay y_k) scale_k / 1.5,
    # which over many steps is a triangular system of two bands.
    departure = np.zeros(drive.shape)
    before, state = np.zeros((2, *decay.shape))
    for first in range(1, drive.shape[1], STEPS_AT_ONCE):
        steps = slice(first, first + STEPS_AT_ONCE)
        for run in range(runs):
            scaled = scale[run, steps] * (FINE_STEP_S / 1.5)
            share = 1.0 / (1.0 + decay[run, :, None] * scaled)
            newer, older = share * (4.0 / 3.0), share / 3.0
            come = share * scaled * taken[run, :, None] * (drive[run, steps] - drive[run, 0])
            come[:, 0] += newer[:, 0] * state[run] - older[:, 0] * before[run]
            come[:, 1:2] -= older[:, 1:2] * state[run, :, None]
            band = np.ones((3, scaled.size), order="F")
            for mode in range(root.size):
                band[1, :-1], band[2, :-2] = -newer[mode, 1:], older[mode, 2:]
                come[mode] = lapack.dtbtrs(band, come[mode], uplo="L")[0]
            before[run], state[run] = (come[:, -2] if scaled.size > 1 else state[run]), come[:, -1]
            departure[run, steps] = shown[run] @ come
    return drive[:, :1] + departure


def lag(drive: Array, time_constant_s: float) -> Array:
    """First-order lag behind (r, n), from rest, exact for air that is straight over each step."""
    from scipy.signal import lfilter, lfiltic  # takes longer to import than all the rest

    x = FINE_STEP_S / time_constant_s
    decay = np.exp(-x)
    new = 1.0 - (1.0 - decay) / x
    b, a = [new, 1.0 - decay - new], [1.0, -decay]
    return np.stack([lfilter(b, a, row, zi=lfiltic(b, a, [row[0]], [row[0]]))[0] for row in drive])


def held_back(values: Array, height: float, span: float) -> Array:
    """Play (r, n): low by `height` after a rise, high by it after a fall, setting in over `span` of change."""
    slope = 2.0 * height / span
    offset = np.zeros(values.shape)
    for k in range(1, values.shape[1]):
        offset[:, k] = np.clip(offset[:, k - 1] - slope * (values[:, k] - values[:, k - 1]), -height, height)
    return offset


def since(mask: NDArray[np.bool_]) -> Array:
    """Time [s] since `mask` (r, n) was last true, 0 where it is, infinite where it never was."""
    time = np.arange(float(mask.shape[1])) * FINE_STEP_S
    return time - np.maximum.accumulate(np.where(mask, time, -np.inf), axis=1)


SAMPLING_PERIOD_S = 0.1
AIRSPEED_NOISE_M_S = 0.05  # of the logged airspeed, one sigma
RESOLUTION_K = 0.01
RESOLUTION_PERCENT = 100 / 16383
UNROUNDED_STEP = 1e-7
REFERENCE_AIRSPEED_M_S = 5.0
AIR_VISCOSITY_M2_S = 1.5e-5  # dry air at 20 degC, 1013 hPa
PRANDTL = 0.71
SEA_LEVEL_HPA = 1013.25
DIE_TIME_CONSTANT_S = 17.0  # a humidity chip in flight follows the air so (iMet-XQ2 flights: 17 to 19 s)
HYSTERESIS_SPAN_PERCENT = 5.0  # change of humidity over which hysteresis sets in

_BOTH = "series_lag sheath parallel_lag calibration_error dead_time moving_average stale_samples quantization".split()
_BOTH += [f"body_{name}" for name in SHAPES]
FLOWN_EFFECTS = {
    "temperature": frozenset(
        "convective_film exchange_temperature stem_conduction evaporative_cooling self_heating radiative_heating "
        "wall_radiation".split()
        + _BOTH
    ),
    "humidity": frozenset(
        "vapour_boundary_layer condensation slow_relaxation direction_dependent_diffusivity "
        "concentration_dependent_diffusivity die_thermal_lag uptake_by_activity calibration_temperature hysteresis "
        "saturation_clipping".split()
        + _BOTH
    ),
}


@dataclass(frozen=True)
class Flown:
    """What one sensor pair logged in one weather: `log` as a flight's CSV, `truth` the air at the same instants.

    Both frames have a row each 0.1 s: `time_s`, `temperature_c`, `humidity_percent`, and in the log the airspeed,
    pressure and altitude.
    """

    log: pd.DataFrame
    truth: pd.DataFrame


def ventilation(airspeed_m_s: Array, radius_m: float, pressure_hpa: Array | float = SEA_LEVEL_HPA) -> Array:
    """Nusselt number of a sphere in a stream, 2 + 0.6 Re^(1/2) Pr^(1/3) (Ranz and Marshall 1952), shape kept."""
    viscosity = AIR_VISCOSITY_M2_S * SEA_LEVEL_HPA / pressure_hpa  # thin air is more viscous for its mass
    reynolds = np.maximum(airspeed_m_s, 0.0) * 2 * radius_m / viscosity
    return np.asarray(2.0 + 0.6 * np.sqrt(reynolds) * PRANDTL ** (1 / 3))


def fly(weather: Weather, profile: Profile, seed: int, *, noise: float = 1.0, rounded: bool = True) -> Flown:
    """One flight; `noise` multiplies the profile's noise floors (0 for none), `rounded` is to the sensors' digits."""
    return fly_many([weather], profile, [seed], noise=noise, rounded=rounded)[0]


def fly_many(
    weathers: Sequence[Weather], profile: Profile, seeds: Sequence[int], *, noise: float = 1.0, rounded: bool = True
) -> list[Flown]:
    """Several flights of one length at once (the elements are stepped together); what is the bench's stays there.

    Raises
    ------
    InputError
        The profile carries an effect that is not known here, or the air leaves its table D(T).
    ValueError
        Flights of different lengths.
    """
    sizes = {w.time_s.size for w in weathers}
    if len(sizes) != 1:
        raise ValueError(f"flights of different lengths: {sorted(sizes)}")
    for channel, part in (("temperature", profile.temperature), ("humidity", profile.humidity)):
        unknown = [e.effect for e in part.effects if not flyable(e.effect, channel)] if part else []
        if unknown:
            raise InputError(
                f"profile: effect {unknown[0]} cannot be simulated in flight; take it out of the profile's {channel}"
            )
    columns = ("temperature_c", "humidity_percent", "airspeed_m_s", "pressure_hpa")
    air = {name: np.stack([getattr(w, name) for w in weathers]) for name in columns}
    air["irradiance_w_m2"] = np.array([[w.irradiance_w_m2] for w in weathers])
    fine: dict[str, Array] = {}
    if profile.temperature is not None:
        fine["temperature_c"] = _thermometer(profile.temperature, profile.bodies["imet"], air)
    if profile.humidity is not None:
        fine.update(_hygrometer(profile.humidity, profile.bodies["hyt"], air))
    return [
        _log(weather, profile, {k: v[i] for k, v in fine.items()}, seed, noise, rounded)
        for i, (weather, seed) in enumerate(zip(weathers, seeds, strict=True))
    ]


def flyable(effect: str, channel: str) -> bool:
    """Whether a profile with this effect can be flown: it is simulated here, or belongs to the bench."""
    on_the_bench = effect in CATALOGUE and CATALOGUE[effect].in_flight is None
    return on_the_bench or effect in FLOWN_EFFECTS[channel]


def _effects(part: TemperatureProfile | HumidityProfile) -> dict[str, StatedEffect]:
    return {e.effect: e for e in part.effects}


def _element(body: str, effects: dict[str, StatedEffect]) -> Cells:
    element = cells(next((name for name in SHAPES if f"body_{name}" in effects), body))
    if (e := effects.get("sheath")) is None:
        return element
    return sheathed(element, e.value("time_constant_s"), e.value("capacity"))


def _inside(air: Array, effects: dict[str, StatedEffect]) -> Array:
    """The air that the body sees, behind a sheath or a cap."""
    return lag(air, effects["series_lag"].value("time_constant_s")) if "series_lag" in effects else air


def _with_slow_shares(reading: Array, air: Array, effects: dict[str, StatedEffect]) -> Array:
    for name in ("slow_relaxation", "stem_conduction", "parallel_lag"):
        if (e := effects.get(name)) is not None:
            share = e.value("fraction")
            reading = (1 - share) * reading + share * lag(air, e.value("time_constant_s"))
    return reading


def _thermometer(part: TemperatureProfile, body: str, air: dict[str, Array]) -> Array:
    effects, temperature = _effects(part), air["temperature_c"]
    speed, radius = air["airspeed_m_s"], part.bead_radius_m
    factor = ventilation(speed, radius, air["pressure_hpa"]) / ventilation(np.array(REFERENCE_AIRSPEED_M_S), radius)
    biot = np.full(speed.shape, np.inf)
    if (e := effects.get("convective_film")) is not None:
        biot = e.value("biot_at_5_m_s") * factor
        if "exchange_temperature" in effects:
            biot = biot * _warm_air(temperature, speed, radius, air["pressure_hpa"])
    rate = np.array(part.thermal_diffusivity_m2_s.value / radius**2)
    reading = march(_element(body, effects), rate, biot, _inside(temperature, effects))
    reading = _with_slow_shares(reading, temperature, effects)
    if (e := effects.get("evaporative_cooling")) is not None:
        saturated = ppmv_from_humidity(100.0, reading)
        drying = since(ppmv_from_humidity(air["humidity_percent"], temperature) > saturated)
        depression = e.value("depression_k") * np.clip((100.0 - air["humidity_percent"]) / 50.0, 0.0, 2.0)
        reading = reading - np.where(drying > 0, depression * np.exp(-drying / e.value("time_constant_s")), 0.0)
    if (e := effects.get("self_heating")) is not None:
        reading = reading + e.value("rise_k_at_5_m_s") / factor
    if (e := effects.get("radiative_heating")) is not None:
        reading = reading + e.value("kelvin_per_w_m2_at_5_m_s") * air["irradiance_w_m2"] / factor
    if (e := effects.get("wall_radiation")) is not None:
        wall, bead = e.value("wall_temperature_c") + 273.15, reading + 273.15
        reading = reading + e.value("rise_k_at_10_k") / 10.0 * (wall**4 - bead**4) / (4.0 * 293.15**3) / factor
    return reading


def _warm_air(temperature_c: Array, speed: Array, radius: float, pressure: Array) -> Array:
    """Exchange at the air's temperature over that at 20 degC: conductivity as T^0.86, viscosity (nu) as T^1.76."""
    warmth = (temperature_c + 273.15) / 293.15
    fluent = ventilation(speed / warmth**1.76, radius, pressure) / ventilation(speed, radius, pressure)
    return np.asarray(warmth**0.86 * fluent)


def _hygrometer(part: HumidityProfile, body: str, air: dict[str, Array]) -> dict[str, Array]:
    effects, temperature = _effects(part), air["temperature_c"]
    die = lag(temperature, DIE_TIME_CONSTANT_S)
    ppmv = ppmv_from_humidity(air["humidity_percent"], temperature)
    if (e := effects.get("condensation")) is not None:
        wet = since(ppmv > ppmv_from_humidity(100.0, die)) <= e.value("drying_time_s")
        ppmv = np.where(wet, ppmv_from_humidity(100.0, temperature), ppmv)
    by_activity = "uptake_by_activity" in effects
    if by_activity:  # the film is driven by the relative humidity at its own temperature
        ppmv = humidity_from_ppmv(ppmv, die)
    biot = np.full(temperature.shape, np.inf)
    if (e := effects.get("vapour_boundary_layer")) is not None:
        biot = e.value("biot_at_5_m_s") * np.sqrt(air["airspeed_m_s"] / REFERENCE_AIRSPEED_M_S)
        biot = biot * np.sqrt(SEA_LEVEL_HPA / air["pressure_hpa"])  # vapour diffuses faster in thin air
    element, seen = _element(body, effects), _inside(ppmv, effects)
    slope = ratio = None
    if (e := effects.get("concentration_dependent_diffusivity")) is not None:
        slope = e.value("slope_per_unit_activity")
    if (e := effects.get("direction_dependent_diffusivity")) is not None:
        ratio = e.value("ratio_drying_to_wetting")
    full = ppmv_from_humidity(100.0, temperature)

    def follow(k: int, state: Array) -> Array:
        factor = np.ones(state.shape)
        if slope is not None:
            factor = np.maximum(1.0 + slope * (state / full[:, k, None] - 0.5), 0.05)
        if ratio is not None:
            factor = factor * np.where(seen[:, k] < state @ element.weight, ratio, 1.0)[:, None]
        return factor

    rate = part.diffusivity_m2_s(temperature)[0] / part.film_thickness_m**2
    depends = slope is not None or ratio is not None
    reading = _with_slow_shares(march(element, rate, biot, seen, follow if depends else None), ppmv, effects)
    at_c = die if "die_thermal_lag" in effects else temperature
    humidity = reading if by_activity else humidity_from_ppmv(reading, at_c)
    if (e := effects.get("calibration_temperature")) is not None:
        humidity = humidity + e.value("percent_per_k") * (die - 20.0)
    if (e := effects.get("hysteresis")) is not None:
        humidity = humidity + held_back(humidity, e.value("rh_percent"), HYSTERESIS_SPAN_PERCENT)
    fine = {"humidity_percent": humidity}
    if effects.keys() & {"die_thermal_lag", "uptake_by_activity", "calibration_temperature"}:
        fine["humidity_sensor_temperature_c"] = die
    return fine


def _log(weather: Weather, profile: Profile, fine: dict[str, Array], seed: int, noise: float, rounded: bool) -> Flown:
    import pandas as pd

    rng = np.random.default_rng(seed)
    rows = slice(0, None, round(SAMPLING_PERIOD_S / (weather.time_s[1] - weather.time_s[0])))
    time = weather.time_s[rows]
    names, around = ("temperature_c", "humidity_percent"), ("airspeed_m_s", "pressure_hpa", "altitude_m")
    truth = pd.DataFrame({"time_s": time} | {name: getattr(weather, name)[rows] for name in (*names, *around)})
    log = pd.DataFrame({"time_s": time})
    channels: list[tuple[str, TemperatureProfile | HumidityProfile, float, float]] = []
    if (t := profile.temperature) is not None:
        channels.append((names[0], t, NOISE_K if t.noise_k is None else t.noise_k, RESOLUTION_K))
    if (h := profile.humidity) is not None:
        floor = NOISE_PERCENT if h.noise_percent is None else h.noise_percent
        channels.append((names[1], h, floor, RESOLUTION_PERCENT))
    for column, part, floor, resolution in channels:
        effects = _effects(part)
        reading = _late(time, weather, fine[column], effects) + noise * floor * rng.standard_normal(time.size)
        log[column] = _read_out(reading, effects, resolution if rounded else UNROUNDED_STEP)
    if (h is not None) and (die := fine.get("humidity_sensor_temperature_c")) is not None:
        # the same chip and the same loop that reads it
        log["humidity_sensor_temperature_c"] = np.round(
            _averaged(_late(time, weather, die, _effects(h)), _effects(h)), 3
        )
    for name in around:
        log[name] = np.round(getattr(weather, name)[rows], 3)
    # no pitot tube reads the same throughout
    pitot = noise * AIRSPEED_NOISE_M_S * np.random.default_rng([seed, 1]).standard_normal(time.size)
    log["airspeed_m_s"] = np.round(np.maximum(log["airspeed_m_s"] + pitot, 0.0), 3)
    return Flown(log, truth)


def _late(time: Array, weather: Weather, fine: Array, effects: dict[str, StatedEffect]) -> Array:
    delay = effects["dead_time"].value("delay_s") if "dead_time" in effects else 0.0
    return np.interp(time - delay, weather.time_s, fine)


def _averaged(reading: Array, effects: dict[str, StatedEffect]) -> Array:
    if (e := effects.get("moving_average")) is None:
        return reading
    width = max(round(e.value("samples")), 1)
    total = np.cumsum(np.concatenate([np.full(width, reading[0]), reading]))
    return np.asarray((total[width:] - total[:-width]) / width)


def _read_out(reading: Array, effects: dict[str, StatedEffect], resolution: float) -> Array:
    if (e := effects.get("calibration_error")) is not None:
        reading = reading * (1 + e.value("gain", 0.0)) + e.value("offset", 0.0)
    if (e := effects.get("saturation_clipping")) is not None:
        reading = np.minimum(reading, e.value("limit_percent"))
    reading = _averaged(reading, effects)
    if (e := effects.get("stale_samples")) is not None:
        hold = max(round(e.value("hold_samples")), 1)
        reading = np.repeat(reading[::hold], hold)[: reading.size]
    step = effects["quantization"].value("step") if "quantization" in effects else resolution
    return np.round(np.round(reading / step) * step, 6)
