"""The chain and its effects: nothing at zero strength, smooth in every parameter, right on data of another solver."""

import numpy as np
import pytest

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import build_channel
from shockrig.analysis.inference.gls import Layout, bounds, fit, make_problem, predict, rate_start, start_theta
from shockrig.analysis.inference.noise import estimate_noise, whiteners
from shockrig.analysis.physics import concentration
from shockrig.analysis.physics.humidity import (
    dew_point_c,
    humidity_from_ppmv,
    ppmv_from_humidity,
    saturation_pressure_hpa,
)
from shockrig.analysis.physics.modes import film_mean, sphere_core
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import SMOOTH, Hidden, draw_truth, with_effects

PAIRS = [(effect, channel) for effect, entry in CATALOGUE.items() for channel in entry.channels]


@pytest.fixture(scope="module")
def channels(tmp_path_factory):
    rng = np.random.default_rng(5)
    folder = simulate_campaign(draw_truth(rng, SMOOTH), standard_plan(), rng, tmp_path_factory.mktemp("chain") / "c")
    campaign = read_campaign(folder)
    return {name: build_channel(campaign, name) for name in ("temperature", "humidity")}


def rest(channel):
    return np.zeros((channel.runs, 4 if channel.name == "temperature" else 5))


def test_plain_chain_is_the_closed_form(channels):
    channel = channels["temperature"]
    found = predict(channel, Layout(()), np.array([np.log(0.5)]), rest(channel))[0]
    c = channel.conditions
    rise = sphere_core().step(0.5 * channel.time_s)
    expected = c.source_c[:, None] + (c.destination_c - c.source_c)[:, None] * rise
    assert found == pytest.approx(expected, abs=1e-6)

    channel = channels["humidity"]
    rates = np.full(channel.interpolation.shape[1], np.log(0.05))
    found = predict(channel, Layout(()), rates, rest(channel))[0]
    c = channel.conditions
    before, after = (
        ppmv_from_humidity(c.source_percent, c.source_c),
        ppmv_from_humidity(c.destination_percent, c.destination_c),
    )
    held = before[:, None] + (after - before)[:, None] * film_mean().step(0.05 * channel.time_s)
    air = np.where(channel.time_s > 0, c.destination_c[:, None], c.source_c[:, None])
    assert found == pytest.approx(humidity_from_ppmv(held, air), abs=1e-5)


def test_saturation_pressure_known_values():
    """Boiling point by definition; Murphy and Koop (2005) over water at 0, 20 and 40 degC; dew point is its inverse."""
    assert saturation_pressure_hpa(100.0) == pytest.approx(1013.25)
    assert saturation_pressure_hpa([0.0, 20.0, 40.0]) == pytest.approx([6.1115, 23.393, 73.849], rel=2.2e-3)
    assert dew_point_c([100.0, 37.0], [12.0, -5.0])[0] == pytest.approx(12.0)
    dew = dew_point_c(37.0, -5.0)
    assert saturation_pressure_hpa(dew) == pytest.approx(0.37 * saturation_pressure_hpa(-5.0), rel=1e-9)


@pytest.mark.parametrize(("effect", "name"), PAIRS)
def test_an_effect_of_no_strength_is_the_plain_chain(channels, effect, name):
    entry, channel = CATALOGUE[effect], channels[name]
    if not entry.parameters or all(p.none is None for p in entry.parameters):
        pytest.skip("has no strength that could be nought; its limit is tested on its own")
    log_rate = np.full(channel.interpolation.shape[1], np.log(0.2))
    values = tuple((effect, p.name, p.starts[0] if p.none is None else p.none) for p in entry.parameters)
    with_it = predict(channel, Layout((effect,), values), log_rate, rest(channel))
    assert with_it == pytest.approx(predict(channel, Layout(()), log_rate, rest(channel)), abs=2e-3)


def test_effects_without_a_zero_reach_the_plain_chain_at_their_end(channels):
    for effect, name, parameter, end, allowed in (
        ("convective_film", "temperature", "biot_at_5_m_s", 1e6, 2e-3),
        ("vapour_boundary_layer", "humidity", "biot_at_5_m_s", 1e7, 2e-2),
        ("saturation_clipping", "humidity", "limit_percent", 1e3, 1e-6),
    ):
        channel = channels[name]
        log_rate = np.full(channel.interpolation.shape[1], np.log(0.2))
        with_it = predict(channel, Layout((effect,), ((effect, parameter, end),)), log_rate, rest(channel))
        assert with_it == pytest.approx(predict(channel, Layout(()), log_rate, rest(channel)), abs=allowed), effect
    isothermal = channels["humidity"]
    log_rate = np.full(isothermal.interpolation.shape[1], np.log(0.2))
    still = isothermal.select(np.abs(isothermal.conditions.destination_c - isothermal.conditions.source_c) < 1.0)
    lagging = predict(still, Layout(("die_thermal_lag",)), log_rate, rest(still))
    # The die's temperature is measured: 0.05 K are 0.3 % of a humidity.
    assert lagging == pytest.approx(predict(still, Layout(()), log_rate, rest(still)), abs=0.5)


@pytest.mark.parametrize(("effect", "name"), [p for p in PAIRS if not CATALOGUE[p[0]].from_readings])
def test_readings_move_smoothly_with_every_parameter(channels, effect, name):
    """Central differences of two widths agree: no kinks or jumps that would mislead a Gauss-Newton step."""
    channel, layout = channels[name], Layout((effect,))
    theta = start_theta(channel, layout, np.full(channel.interpolation.shape[1], np.log(0.2)))
    groups = channel.interpolation.shape[1]
    low, high = bounds(channel, layout)
    # Where a delay moves the air's step across a sample, the reading has its one true corner.
    delay = next((p.starts[0] for p in CATALOGUE[effect].parameters if p.name == "delay_s"), 0.0)
    away = np.abs(channel.time_s - delay) > 0.02
    for k in range(groups - 1, theta.size):
        wide = 2e-3 if k < groups else 2e-3 * min(high[k] - low[k], 1.0)
        slopes = []
        for h in (wide, wide / 2):
            pair = np.tile(theta, (2, 1))
            pair[0, k], pair[1, k] = theta[k] + h, theta[k] - h
            up, down = predict(channel, layout, pair, rest(channel))
            slopes.append(((up - down) / (2 * h))[away])
        size = np.sqrt(np.mean(slopes[1] ** 2)) + 1e-9
        assert np.sqrt(np.mean((slopes[0] - slopes[1]) ** 2)) < 0.03 * size + 1e-3, (effect, k)


@pytest.mark.parametrize("ratio", [0.3, 3.0])
def test_concentration_warp_against_an_independent_integration(ratio):
    """Method of lines on a uniform grid with scipy's stiff solver; u is 1 at the surface, D falls from `ratio` to 1."""
    from scipy.integrate import solve_ivp

    cells = 300
    h, kappa = 1.0 / cells, ratio - 1.0

    def rhs(_, u):
        d = 1.0 + kappa * (1.0 - u)
        face = 0.5 * (d[1:] + d[:-1]) * np.diff(u) / h
        last = 0.5 * (d[-1] + 1.0) * (1.0 - u[-1]) / (h / 2)
        flux = np.concatenate([[0.0], face, [last]])
        return np.diff(flux) / h

    times = np.array([0.03, 0.1, 0.3, 0.8, 1.6])
    band = solve_ivp(rhs, (0, 1.6), np.zeros(cells), "LSODA", t_eval=times, rtol=1e-7, atol=1e-9, lband=1, uband=1)
    uptake = band.y.mean(axis=0)
    warped = film_mean().step(times * concentration.time_warp(times, np.full(times.size, ratio)))
    assert warped == pytest.approx(uptake, abs=2e-3)


RECOVERED = {
    "finite_transfer": ("temperature", {"duration_s": 0.5}),
    "convective_film": ("temperature", {"biot_at_5_m_s": 0.12}),
    "vapour_boundary_layer": ("humidity", {"biot_at_5_m_s": 6.0}),
    "direction_dependent_diffusivity": ("humidity", {"ratio_drying_to_wetting": 0.8}),
    "concentration_dependent_diffusivity": ("humidity", {"slope_per_unit_activity": 0.4}),
    "slow_relaxation": ("humidity", {"fraction": 0.08, "time_constant_s": 25.0}),
    "stem_conduction": ("temperature", {"fraction": 0.05, "time_constant_s": 9.0}),
    "self_heating": ("temperature", {"rise_k_at_5_m_s": 0.3}),
    "hysteresis": ("humidity", {"rh_percent": 1.0}),
    "calibration_error": ("humidity", {"gain": 0.01, "offset": 0.8}),
    "dead_time": ("humidity", {"delay_s": 0.3}),
    "clock_drift": ("temperature", {"ppm": 10000.0}),
    "air_relaxation": (
        "temperature",
        {"fraction": 0.05, "time_constant_s": 6.0, "room_temperature_c": 24.0, "room_humidity_percent": 45.0},
    ),
}


@pytest.mark.parametrize("effect", RECOVERED)
def test_effects_recover_themselves_on_data_of_another_solver(tmp_path, effect):
    """The virtual bench integrates each effect by its own equations on a grid; the closed forms must find its size."""
    name, true = RECOVERED[effect]
    rng = np.random.default_rng(11)
    truth = with_effects(draw_truth(rng, SMOOTH), [Hidden(effect, true, (name,) if effect in SINGLE else ())])
    channel = build_channel(read_campaign(simulate_campaign(truth, standard_plan(), rng, tmp_path / "c")), name)
    problem = make_problem(channel, whiteners(channel, estimate_noise(channel)))
    if effect == "dead_time":
        # In a thermal shock RH jumps with the air's temperature between two samples: a staircase in the delay, on which
        # no gradient leads from a start far away.
        problem = problem.select(np.abs(channel.conditions.destination_c - channel.conditions.source_c) < 1.0)
    layout = Layout((effect,))
    starts = [start_theta(channel, layout, rate_start(channel), {f"{effect}.{k}": v}) for k, v in _starts(effect)]
    found = min((fit(problem, layout, theta) for theta in starts), key=lambda f: f.objective)
    for parameter, (value, spread) in found.values(channel.interpolation.shape[1])[effect].items():
        if not parameter.startswith("room_"):
            assert abs(value - true[parameter]) < 3.5 * spread + 0.02 * abs(true[parameter]), parameter
            assert spread < 0.5 * abs(true[parameter]), parameter


SINGLE = ("calibration_error", "dead_time", "clock_drift")


def _starts(effect):
    first = CATALOGUE[effect].parameters[0]
    return [(first.name, start) for start in first.starts]
