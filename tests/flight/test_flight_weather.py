"""Simulated weather and sensors: known slopes, known step responses, and the samples that the log should hold."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import detrend, welch

from shockrig.analysis.flight.inverse import power_density
from shockrig.analysis.flight.judging import power_spectrum, slope, structure_function
from shockrig.analysis.flight.simulated.sensor import fly, fly_many
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import (
    FINE_STEP_S,
    SCENES,
    Weather,
    convective,
    frontal,
    inversion,
    shaped_noise,
)
from shockrig.analysis.physics.humidity import ppmv_from_humidity
from shockrig.analysis.physics.modes import film_mean, film_mean_biot, first_order, mix, sphere_core, sphere_core_biot
from shockrig.files.errors import InputError
from shockrig.files.profile import Profile, StatedEffect, Uncertain

PROFILE = typical_profile()


def effects(**named):
    return tuple(StatedEffect(name, {k: Uncertain(v) for k, v in p.items()}) for name, p in named.items())


def with_effects(temperature=(), humidity=()):
    return Profile(
        dataclasses.replace(PROFILE.temperature, effects=temperature),
        dataclasses.replace(PROFILE.humidity, effects=humidity),
    )


def step_weather(*, temperature_k=0.0, humidity_percent=0.0, airspeed_m_s=5.0, duration_s=40.0):
    """Air that jumps after 2 s."""
    time = np.arange(round(duration_s / FINE_STEP_S) + 1) * FINE_STEP_S
    after = time > 2.0 + 1e-9
    still = np.ones(time.size)
    return Weather(
        "step",
        time,
        20.0 + temperature_k * after,
        50.0 + humidity_percent * after,
        airspeed_m_s * still,
        1013.25 * still,
        0 * still,
    )


def share(log, column, start, size):
    return (log[column].to_numpy() - start) / size


@pytest.mark.parametrize("seed", range(3))
def test_turbulence_has_the_slopes_of_the_inertial_range(seed):
    series = shaped_noise(200_000, np.random.default_rng(seed))
    assert series.std() == pytest.approx(1.0)
    assert slope(*power_spectrum(series, 0.01, 100.0), 0.1, 20.0) == pytest.approx(-5 / 3, abs=0.08)
    assert slope(*structure_function(series, 0.01), 0.05, 5.0) == pytest.approx(2 / 3, abs=0.12)


def test_scenes_have_the_strength_that_their_options_set():
    air = convective(np.random.default_rng(1), temperature_std_k=0.7, temperature_c=15.0)
    assert air.temperature_c.std() == pytest.approx(0.7)
    assert air.temperature_c.mean() == pytest.approx(15.0)
    front = frontal(temperature_c=25.0, temperature_change_k=-8.0, width_m=450.0, airspeed_m_s=45.0)
    assert front.temperature_c[[0, -1]] == pytest.approx([25.0, 17.0])
    assert np.gradient(front.temperature_c, FINE_STEP_S).min() == pytest.approx(-8.0 / 10.0, rel=1e-3)
    assert front.humidity_percent[[0, -1]] == pytest.approx([40.0, 85.0])
    profile = inversion(strength_k=5.0, depth_m=40.0, ascent_m_s=5.0)
    lapse = np.gradient(profile.temperature_c, profile.altitude_m)
    assert lapse[1000] == pytest.approx(-9.8e-3, rel=1e-3)
    assert lapse.max() == pytest.approx(5.0 / 40.0, rel=1e-2)


@pytest.mark.parametrize("scene", SCENES)
def test_weather_is_the_same_for_the_same_seed_and_air_that_can_exist(scene):
    one, two = (SCENES[scene](np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(one.temperature_c, two.temperature_c)
    assert np.all((one.humidity_percent >= 0) & (one.humidity_percent <= 100))


def test_sensor_without_noise_follows_the_closed_forms():
    log = fly(step_weather(temperature_k=5.0), PROFILE, 0, noise=0.0).log
    rate = PROFILE.temperature.thermal_diffusivity_m2_s.value / PROFILE.temperature.bead_radius_m**2
    late = log["time_s"].to_numpy() - 2.0 - 0.5 * FINE_STEP_S
    expected = sphere_core().scaled(rate).step(late)
    np.testing.assert_allclose(share(log, "temperature_c", 20.0, 5.0), expected, atol=4e-3)

    log = fly(step_weather(humidity_percent=20.0), PROFILE, 0, noise=0.0).log
    rate = PROFILE.humidity.diffusivity_m2_s(20.0)[0] / PROFILE.humidity.film_thickness_m**2
    expected = film_mean().scaled(rate).step(late)
    np.testing.assert_allclose(share(log, "humidity_percent", 50.0, 20.0), expected, atol=6e-3)


def test_extended_sensors_follow_their_closed_forms():
    bead = effects(convective_film={"biot_at_5_m_s": 0.5}, stem_conduction={"fraction": 0.2, "time_constant_s": 6.0})
    film = effects(
        vapour_boundary_layer={"biot_at_5_m_s": 2.0}, slow_relaxation={"fraction": 0.1, "time_constant_s": 9.0}
    )
    profile = with_effects(bead, film)
    late = np.arange(0, 40.05, 0.1) - 2.0 - 0.5 * FINE_STEP_S
    log = fly(step_weather(temperature_k=5.0), profile, 0, noise=0.0).log
    rate = PROFILE.temperature.thermal_diffusivity_m2_s.value / PROFILE.temperature.bead_radius_m**2
    expected = mix(sphere_core_biot(0.5).scaled(rate), first_order(6.0), 0.2).step(late)
    np.testing.assert_allclose(share(log, "temperature_c", 20.0, 5.0), expected, atol=4e-3)
    log = fly(step_weather(humidity_percent=20.0), profile, 0, noise=0.0).log
    rate = PROFILE.humidity.diffusivity_m2_s(20.0)[0] / PROFILE.humidity.film_thickness_m**2
    expected = mix(film_mean_biot(2.0).scaled(rate), first_order(9.0), 0.1).step(late)
    np.testing.assert_allclose(share(log, "humidity_percent", 50.0, 20.0), expected, atol=4e-3)


def test_at_constant_vapour_the_films_content_does_not_feel_the_temperature():
    weather = step_weather(temperature_k=5.0)
    vapour = ppmv_from_humidity(50.0, 20.0)
    humidity = 50.0 * vapour / ppmv_from_humidity(50.0, weather.temperature_c)
    flown = fly(dataclasses.replace(weather, humidity_percent=humidity), PROFILE, 0, noise=0.0)
    np.testing.assert_allclose(flown.log["humidity_percent"], flown.truth["humidity_percent"], atol=0.01)


def test_readout_and_logger_do_what_their_effects_say():
    extended = with_effects(
        effects(self_heating={"rise_k_at_5_m_s": 0.4}, calibration_error={"gain": 0.01, "offset": 0.3}),
        effects(dead_time={"delay_s": 1.0}, saturation_clipping={"limit_percent": 65.0}),
    )
    weather = step_weather(humidity_percent=30.0)
    log = fly(weather, extended, 0, noise=0.0).log
    plain = fly(weather, PROFILE, 0, noise=0.0).log
    np.testing.assert_allclose(log["temperature_c"], 1.01 * (20.0 + 0.4) + 0.3, atol=0.006)
    late = np.minimum(plain["humidity_percent"].to_numpy()[:-10], 65.0)
    np.testing.assert_allclose(log["humidity_percent"].to_numpy()[10:], late, atol=0.01)


def test_many_flights_are_what_each_would_be_alone():
    weathers = [convective(np.random.default_rng(seed), duration_s=20.0) for seed in range(3)]
    together = fly_many(weathers, PROFILE, [5, 6, 7])
    alone = fly(weathers[1], PROFILE, 6)
    assert alone.log.equals(together[1].log)
    with pytest.raises(ValueError, match="lengths"):
        fly_many([weathers[0], frontal()], PROFILE, [0, 1])


def test_air_beyond_the_table_and_unknown_effects_are_refused():
    with pytest.raises(InputError, match="characterize"):
        fly(convective(np.random.default_rng(0), duration_s=20.0, temperature_c=60.0), PROFILE, 0)
    with pytest.raises(InputError, match="frost"):
        fly(step_weather(), with_effects(effects(frost={})), 0)


@pytest.mark.parametrize(("count", "size"), [(1000, 256), (777, 301), (10, 10)])
def test_power_spectra_are_those_of_scipy(count, size):
    """Here without scipy.signal, whose import takes longer than a flight's correction."""
    values = np.random.default_rng(1).standard_normal(count).cumsum()
    expected = welch(values, 10.0, nperseg=size, detrend=detrend)
    for found, known in zip(power_density(values, 0.1, size), expected, strict=True):
        assert np.allclose(found, known, rtol=1e-9, atol=1e-12 * known.max())
