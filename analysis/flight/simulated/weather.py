"""Weather for a simulated flight: turbulence, a front, an inversion; temperature and humidity of the air along the
path.

Turbulence: white Gaussian noise whose magnitudes are divided by f^(5/6), phases kept, so that power falls as k^(-5/3).
Fronts and profiles are piecewise straight with smoothed corners. Source of the scenes: Segales et al. (2022), section
3.2, doi 10.5194/amt-15-2607-2022, after Houston and Keeler (2018), doi 10.1175/JTECH-D-17-0019.1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.ndimage import gaussian_filter1d

from shockrig.analysis.physics.humidity import STANDARD_PRESSURE_HPA, humidity_from_ppmv, ppmv_from_humidity

Array = NDArray[np.float64]

FINE_STEP_S = 0.01
DRY_ADIABATIC_K_M = 9.8e-3
SCALE_HEIGHT_M = 8400.0


@dataclass(frozen=True)
class Weather:
    """Air along a path, on a fine clock: arrays of one shape (n,), and the sunlight on the sensors, steady."""

    name: str
    time_s: Array
    temperature_c: Array
    humidity_percent: Array
    airspeed_m_s: Array
    pressure_hpa: Array
    altitude_m: Array
    irradiance_w_m2: float = 0.0


def shaped_noise(count: int, rng: np.random.Generator, exponent: float = 5.0 / 3.0) -> Array:
    """Gaussian noise of `count` values whose power falls as f^-exponent, mean 0 and standard deviation 1.

    Twice the length is made and cut, since the shaped series is periodic and weather is not.
    """
    size = next_fast_len(2 * count, real=True)
    spectrum = rfft(rng.standard_normal(size))
    frequency = rfftfreq(size)
    frequency[0] = np.inf
    series = irfft(spectrum / frequency ** (exponent / 2), size)[:count]
    series -= series.mean()
    return series / series.std()


def convective(
    rng: np.random.Generator,
    *,
    duration_s: float = 300.0,
    mean_wind_m_s: float = 10.0,
    temperature_c: float = 20.0,
    humidity_percent: float = 50.0,
    temperature_std_k: float = 0.5,
    humidity_std_percent: float = 2.0,
    correlation: float = -0.5,
    altitude_m: float = 100.0,
    irradiance_w_m2: float = 0.0,
) -> Weather:
    """Convective boundary layer, hovering in the mean wind (Taylor's hypothesis: length = wind x duration).

    `humidity_std_percent` is that of the vapour, as relative humidity at the mean temperature; `correlation` is between
    temperature and vapour.
    """
    time = _clock(duration_s)
    heat = shaped_noise(time.size, rng)
    vapour = correlation * heat + np.sqrt(1 - correlation**2) * shaped_noise(time.size, rng)
    temperature = temperature_c + temperature_std_k * heat
    mixing = np.maximum(humidity_percent + humidity_std_percent * vapour, 1.0)
    return _weather(
        "convective",
        time,
        temperature,
        ppmv_from_humidity(mixing, temperature_c),
        mean_wind_m_s,
        altitude_m,
        irradiance_w_m2,
    )


def frontal(
    rng: np.random.Generator | None = None,
    *,
    airspeed_m_s: float = 45.0,
    lead_m: float = 4500.0,
    width_m: float = 450.0,
    temperature_c: float = 25.0,
    temperature_change_k: float = -8.0,
    humidity_percent: float = 40.0,
    humidity_after_percent: float = 85.0,
    corner_m: float = 20.0,
    turbulence_k: float = 0.0,
    turbulence_percent: float = 0.0,
    altitude_m: float = 100.0,
    irradiance_w_m2: float = 0.0,
) -> Weather:
    """Transect of an airmass boundary by a fixed wing: straight ramp across `width_m`, `lead_m` of steady air either
    side.

    The change has the size of a strong thunderstorm outflow. Vapour is straight across the front as well.
    """
    time = _clock((2 * lead_m + width_m) / airspeed_m_s)
    x = time * airspeed_m_s
    share = np.interp(x, [lead_m, lead_m + width_m], [0.0, 1.0])
    before = ppmv_from_humidity(humidity_percent, temperature_c)
    after = ppmv_from_humidity(humidity_after_percent, temperature_c + temperature_change_k)
    smooth = _corner_filter(corner_m / airspeed_m_s)
    share = smooth(share)
    temperature = temperature_c + temperature_change_k * share + _turbulence(time.size, turbulence_k, rng)
    ppmv = before + (after - before) * share
    ppmv = ppmv * (1 + _turbulence(time.size, turbulence_percent, rng) / humidity_percent)
    return _weather("frontal", time, temperature, ppmv, airspeed_m_s, altitude_m, irradiance_w_m2)


def inversion(
    rng: np.random.Generator | None = None,
    *,
    ascent_m_s: float = 5.0,
    top_m: float = 600.0,
    base_m: float = 280.0,
    depth_m: float = 40.0,
    strength_k: float = 5.0,
    surface_temperature_c: float = 20.0,
    humidity_percent: float = 50.0,
    vapour_above: float = 0.5,
    lapse_k_m: float = DRY_ADIABATIC_K_M,
    corner_m: float = 4.0,
    turbulence_k: float = 0.0,
    turbulence_percent: float = 0.0,
    irradiance_w_m2: float = 0.0,
) -> Weather:
    """Ascent through a well mixed layer capped by an inversion: dry adiabatic, `strength_k` warmer over `depth_m`,
    then on.

    Vapour is constant below, falls to the share `vapour_above` of it across the inversion and stays there.
    """
    time = _clock(top_m / ascent_m_s)
    z = time * ascent_m_s
    heights = [0.0, base_m, base_m + depth_m, top_m]
    at_base = surface_temperature_c - lapse_k_m * base_m
    at_top = at_base + strength_k - lapse_k_m * (top_m - base_m - depth_m)
    smooth = _corner_filter(corner_m / ascent_m_s)
    temperature = smooth(np.interp(z, heights, [surface_temperature_c, at_base, at_base + strength_k, at_top]))
    temperature += _turbulence(time.size, turbulence_k, rng)
    share = smooth(np.interp(z, heights, [1.0, 1.0, vapour_above, vapour_above]))
    ppmv = ppmv_from_humidity(humidity_percent, surface_temperature_c) * share
    ppmv = ppmv * (1 + _turbulence(time.size, turbulence_percent, rng) / humidity_percent)
    return _weather("inversion", time, temperature, ppmv, ascent_m_s, z, irradiance_w_m2)


SCENES: dict[str, Callable[..., Weather]] = {"convective": convective, "frontal": frontal, "inversion": inversion}


def _clock(duration_s: float) -> Array:
    return np.arange(round(duration_s / FINE_STEP_S) + 1.0) * FINE_STEP_S


def _corner_filter(scale_s: float) -> Callable[[Array], Array]:
    """Gaussian low-pass that rounds corners over about `scale_s`; straight parts stay straight but at the very ends."""

    def smooth(values: Array) -> Array:
        width = max(scale_s / FINE_STEP_S / 2, 1e-6)
        pad = int(5 * width) + 2
        ends = np.arange(1, pad + 1)
        first = values[0] - ends[::-1] * (values[1] - values[0])
        last = values[-1] + ends * (values[-1] - values[-2])
        return gaussian_filter1d(np.concatenate([first, values, last]), width)[pad:-pad]

    return smooth


def _turbulence(count: int, std: float, rng: np.random.Generator | None) -> Array:
    if std == 0.0:
        return np.zeros(count)
    if rng is None:
        raise ValueError("turbulence needs a random generator")
    return std * shaped_noise(count, rng)


def _weather(
    name: str,
    time: Array,
    temperature: Array,
    ppmv: ArrayLike,
    airspeed: float,
    altitude: ArrayLike,
    irradiance: float,
) -> Weather:
    """Ppmv is at standard pressure, so that relative humidity and not the barometer's fall is what the options set."""
    altitude = np.broadcast_to(np.asarray(altitude, dtype=float), time.shape)
    humidity = np.clip(humidity_from_ppmv(ppmv, temperature), 0.0, 100.0)
    pressure = STANDARD_PRESSURE_HPA * np.exp(-altitude / SCALE_HEIGHT_M)
    speed = np.full(time.shape, airspeed)
    return Weather(name, time, temperature, humidity, speed, pressure, altitude.copy(), irradiance)
