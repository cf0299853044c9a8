"""The virtual world's equations against closed forms: series of sphere and film, Robin surfaces, ramps, lags,
conservation.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from shockrig.rig.virtual.physics import chains, course, moist
from shockrig.rig.virtual.physics.exposure import Exposure
from shockrig.rig.virtual.truth import Hidden, Truth

RUNS = np.array([0.05, 0.2, 0.9])  # rates alpha / R^2 or D / L^2, 1/s: slow film to fast bead


def sphere_core(fourier):
    n = np.arange(1, 300)
    return 1 + 2 * np.sum((-1.0) ** n * np.exp(-(n**2) * np.pi**2 * fourier[..., None]), axis=-1)


def film_mean(fourier):
    n = 2 * np.arange(1000) + 1
    return 1 - 8 / np.pi**2 * np.sum(np.exp(-(n**2) * np.pi**2 * fourier[..., None] / 4) / n**2, axis=-1)


def answer(block, read, until_s=20.0, drive=lambda t: 1.0, start=0.0, refresh=None):
    """Times (n,) and reading (n, runs) of one block after its drive became `drive` at time 0."""
    runs, cells = block.capacity.shape
    stepper = chains.Stepper(
        [block], lambda t: [np.full(runs, drive(t))], [np.full((runs, cells), start)], 0.0, refresh
    )
    times, readings = [], []
    while stepper.time_s < until_s:
        stepper.step(stepper.longest_step_s())
        times.append(stepper.time_s)
        readings.append(read(stepper.state[0]))
    return np.array(times), np.array(readings)


def bead(biot=np.inf, cells=chains.SPHERE_CELLS, rates=RUNS, **keys):
    edges = chains.sphere_edges(cells)
    block = chains.sphere(rates, np.full(rates.shape, biot), edges)
    return answer(block, lambda x: x[:, :3] @ chains.core_weights(edges), **keys)


def film(biot=np.inf, cells=chains.FILM_CELLS, rates=RUNS, **keys):
    edges = chains.film_edges(cells)
    return answer(chains.film(rates, np.full(rates.shape, biot), edges), lambda x: x @ np.diff(edges), **keys)


def test_sphere_core_follows_the_series():
    times, core = bead()
    late = times > 0.01
    assert np.abs(core[late] - sphere_core(times[late, None] * RUNS)).max() < 1.2e-4


def test_film_mean_follows_the_series():
    times, mean = film()
    late = times > 0.01
    assert np.abs(mean[late] - film_mean(times[late, None] * RUNS)).max() < 1.2e-4


@pytest.mark.parametrize(
    ("make", "landmarks"),
    [
        (bead, {0.5: 0.13879, 0.6321206: 0.17091, 0.9: 0.30352, 0.98: 0.46660}),
        (film, {0.5: 0.19673, 0.6321206: 0.32025, 0.9: 0.84809, 0.98: 1.50037}),
    ],
)
def test_published_landmarks_of_the_unit_step(make, landmarks):
    times, reading = make(rates=np.array([0.5]))
    for level, fourier in landmarks.items():
        assert 0.5 * np.interp(level, reading[:, 0], times) == pytest.approx(fourier, rel=5e-4)


@pytest.mark.parametrize("make, series", [(bead, sphere_core), (film, film_mean)])
def test_error_falls_with_the_square_of_the_cells(make, series):
    errors = []
    for cells in (20, 40, 80):
        times, reading = make(cells=cells, rates=np.array([0.5]), until_s=2.0)
        late = times > 0.1
        errors.append(np.abs(reading[late, 0] - series(0.5 * times[late])).max())
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.35)


@pytest.mark.parametrize("biot", [0.05, 0.12, 1.0, 6.0])
def test_sphere_behind_an_air_film(biot):
    """Carslaw and Jaeger 1959, section 9.4: x cot x = 1 - Bi, T(0) = 1 - sum 2 (sin x - x cos x) / (x - sin x cos x)
    e^(-x^2 Fo).
    """
    rates = np.array([0.9, 3.0])
    times, core = bead(biot=biot, rates=rates, until_s=8.0)
    gap = 1e-9
    roots = [
        brentq(lambda x: x * np.cos(x) - (1 - biot) * np.sin(x), n * np.pi + gap, (n + 1) * np.pi - gap)
        for n in range(40)
    ]
    x = np.array(roots)
    amplitude = 2 * (np.sin(x) - x * np.cos(x)) / (x - np.sin(x) * np.cos(x))
    late = times > 0.02
    fourier = times[late, None] * rates
    exact = 1 - np.sum(amplitude * np.exp(-(x**2) * fourier[..., None]), axis=-1)
    assert np.abs(core[late] - exact).max() < 1.2e-4


@pytest.mark.parametrize("biot", [0.5, 5.0])
def test_film_behind_a_boundary_layer(biot):
    """Crank 1975, section 4.3.6: x tan x = Bi, mean = 1 - sum 2 Bi^2 / (x^2 (x^2 + Bi^2 + Bi)) e^(-x^2 Fo)."""
    times, mean = film(biot=biot, until_s=10.0)
    gap = 1e-9
    x = np.array(
        [brentq(lambda x: x * np.sin(x) - biot * np.cos(x), n * np.pi + gap, (n + 0.5) * np.pi) for n in range(60)]
    )
    exact = 1 - np.sum(
        2 * biot**2 / (x**2 * (x**2 + biot**2 + biot)) * np.exp(-(x**2) * (times[:, None] * RUNS)[..., None]), axis=-1
    )
    assert np.abs(mean - exact).max() < 1.2e-4


def test_ramp_is_the_running_mean_of_the_step():
    ramp_s, rates = 0.5, np.array([0.4])
    times, mean = film(rates=rates, drive=lambda t: min(t / ramp_s, 1.0), until_s=4.0)
    fine = np.linspace(0.0, 4.1, 16401)
    integral = np.concatenate(
        [[0.0], np.cumsum(0.5 * np.diff(fine) * (lambda y: y[1:] + y[:-1])(film_mean(rates * fine)))]
    )
    exact = (np.interp(times, fine, integral) - np.interp(times - ramp_s, fine, integral, left=0.0)) / ramp_s
    assert np.abs(mean[:, 0] - exact).max() < 1.5e-4


def test_lag_is_first_order():
    times, reading = answer(chains.lag(7.0, 2), lambda x: x[:, 0])
    assert np.abs(reading[:, 0] - (1 - np.exp(-times / 7.0))).max() < 2e-5


def test_sealed_film_keeps_its_vapour():
    edges = chains.film_edges()
    block = chains.film(RUNS, np.full(3, np.inf), edges)
    closed = chains.CellChain(block.capacity, block.link, np.zeros(3))
    start = np.random.default_rng(1).random(block.capacity.shape)
    stepper = chains.Stepper([closed], lambda t: [np.full(3, 99.0)], [start])
    for _ in range(2500):
        stepper.step(stepper.longest_step_s())
    state = stepper.state[0]
    assert state @ np.diff(edges) == pytest.approx(start @ np.diff(edges), abs=1e-11)
    assert np.ptp(state[2]) < 1e-2 * np.ptp(start[2])


@pytest.mark.parametrize("slope", [-0.6, 0.6])
@pytest.mark.parametrize("wetting", [True, False])
def test_diffusivity_that_follows_the_water(slope, wetting):
    """Crank 1975, section 10.6: the initial rate shows (5/3) int c^(2/3) D dc when wetting, 1.85 int (1-c)^0.85 D dc
    when drying.
    """
    rate = 0.1
    edges = chains.film_edges(160)

    def refresh(ahead):
        faces = np.append(0.5 * (ahead[0][:, 1:] + ahead[0][:, :-1]), ahead[0][:, -1:], axis=1)
        return [chains.film_links(rate * (1 + slope * (faces - 0.5)), np.array([np.inf]), edges)]

    drive = 1.0 if wetting else 0.0
    block = chains.film(np.array([rate]), np.array([np.inf]), edges)
    times, mean = answer(block, lambda x: x @ np.diff(edges), 0.6, lambda t: drive, 1.0 - drive, refresh)
    change = np.abs(mean[:, 0] - (1.0 - drive))
    c = np.linspace(0.0, 1.0, 20001)
    weight = 5 / 3 * c ** (2 / 3) if wetting else 1.85 * (1 - c) ** 0.85
    shown = np.trapezoid(weight * rate * (1 + slope * (c - 0.5)), c)
    early = (times > 0.2) & (times < 0.6)
    measured = np.pi / 4 * np.polyfit(np.sqrt(times[early]), change[early], 1)[0] ** 2
    assert measured == pytest.approx(shown, rel=0.015)
    assert abs(shown / rate - 1) > 0.05  # the test can fail


TRUTH = Truth(thermal_diffusivity_m2_s=9e-8, diffusivity_20c_m2_s=8e-12)


def shock(duration_s=0.0, **changes):
    """From 10 degC, 6000 ppmv to 20 degC, 9000 ppmv."""
    values = {"source_c": 10.0, "source_ppmv": 6000.0, "destination_c": 20.0, "destination_ppmv": 9000.0}
    values |= {"airflow_m_s": 6.0, "pressure_hpa": 1013.25, "irradiance_w_m2": 0.0, "order": 0.0}
    return Exposure(**values | changes, duration_s=duration_s)


@pytest.mark.parametrize("since_s", [29.3, 0.05, 7.0, 0.3, 1.0])  # in no order: nothing is stepped
def test_a_course_follows_the_series(since_s):
    bodies = course.follow(TRUTH, shock()).bodies(since_s)
    assert (bodies.core_c - 10.0) / 10.0 == pytest.approx(sphere_core(np.array(9e-8 / 1.6e-7 * since_s)), abs=1.2e-4)
    assert (bodies.film_ppmv - 6000) / 3000 == pytest.approx(film_mean(np.array(8e-12 / 1e-10 * since_s)), abs=1.2e-4)
    assert (bodies.die_c - 10) / 10 == pytest.approx(1 - np.exp(-since_s / TRUTH.die_time_constant_s), abs=1e-12)


def test_a_course_along_a_ramp_is_the_running_mean_of_the_step():
    ramp_s, step, ramp = 0.5, course.follow(TRUTH, shock()), course.follow(TRUTH, shock(0.5))
    for since_s in (0.2, 0.5, 3.0):
        seen = np.linspace(max(since_s - ramp_s, 0.0), since_s, 2001)
        bodies = [step.bodies(t) for t in seen]
        for name, low in (("core_c", 10.0), ("film_ppmv", 6000.0), ("die_c", 10.0)):
            rise = np.array([getattr(b, name) - low for b in bodies])
            mean = np.trapezoid(rise, seen) / ramp_s
            assert getattr(ramp.bodies(since_s), name) - low == pytest.approx(mean, rel=1e-5)


def test_the_heat_of_sorption_lags_the_films_mean():
    at = course.follow(TRUTH, shock())
    seen = np.linspace(0.0, 2.0, 4001)
    film_ppmv = np.array([at.bodies(t).film_ppmv for t in seen])
    weight = np.exp(-(2.0 - seen) / 0.5) / 0.5
    exact = np.trapezoid(weight * film_ppmv, seen) + 6000.0 * np.exp(-2.0 / 0.5)
    assert at.bodies(2.0).warming_ppmv == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize(
    "effect",
    [
        None,
        Hidden("concentration_dependent_diffusivity", {"slope_per_unit_activity": 0.5}),
    ],
    ids=["in closed form", "stepped"],
)
def test_a_course_goes_on_from_its_own_state(effect):
    """Cut in two, an exposure to steady air comes to the same."""
    truth = TRUTH if effect is None else Truth(9e-8, 8e-12, effects=(effect,))
    carried = shock(source_c=20.0, source_ppmv=9000.0)
    one = course.follow(truth, shock())
    two = course.follow(truth, carried, state=one.state(0.7))
    for since_s in (0.0, 0.4, 5.0):
        uncut, cut = one.bodies(0.7 + since_s), two.bodies(since_s)
        for name in ("core_c", "film_ppmv", "die_c", "slow_ppmv"):
            assert getattr(cut, name) == pytest.approx(getattr(uncut, name), rel=2e-5)
        assert cut.warming_ppmv == pytest.approx(uncut.warming_ppmv, rel=1e-9 if effect is None else 5e-4)


def test_air_that_cycles_drives_a_lag_as_the_closed_form_says():
    """A sin(w t) behind a first-order lag: A / sqrt(1 + (w tau)^2) (sin(w t - phi) + sin(phi) e^(-t / tau))."""
    truth = Truth(9e-8, 8e-12, effects=(Hidden("unknown_air_cycling", {"amplitude_k": 0.4, "period_s": 6.0}),))
    at = course.follow(truth, shock(source_c=20.0))
    omega, tau_s = 2 * np.pi / 6.0, truth.die_time_constant_s
    phi = np.arctan(omega * tau_s)
    for t in (1.0, 4.4, 31.0, 2.0):
        exact = 0.4 * np.cos(phi) * (np.sin(omega * t - phi) + np.sin(phi) * np.exp(-t / tau_s))
        assert at.bodies(t).die_c - 20.0 == pytest.approx(exact, abs=1e-5)
        assert at.air(t)[0] - 20.0 == pytest.approx(0.4 * np.sin(omega * t), abs=1e-5)


def test_start_between_samples_is_exact():
    """A drive that is a ramp of no length at time 0 gives the step, whatever instants are looked at."""
    times, reading = film(until_s=0.5)
    assert times[0] == chains.FIRST_STEP_S and np.diff(times).max() <= chains.LONGEST_STEP_S
    assert (reading[0] > 0).all()


def test_saturation_pressure_known_values():
    """Murphy and Koop 2005 over water: 611.21 Pa at 0 degC, 2339 Pa at 20 degC, 7384 Pa at 40 degC; McRae is within
    0.22 %.
    """
    assert moist.saturation_pressure_hpa(np.array([0.0, 20.0, 40.0])) == pytest.approx(
        [6.1121, 23.39, 73.84], rel=2.5e-3
    )
    assert moist.saturation_pressure_hpa(100.0) == pytest.approx(1013.25)


def test_humidity_and_ppmv_are_inverse_and_dew_point_is_saturation():
    ppmv = moist.concentration_ppmv(45.0, 31.0, 900.0)
    assert moist.humidity_percent(ppmv, 31.0, 900.0) == pytest.approx(45.0)
    dew = moist.dew_point_c(ppmv, 900.0)
    assert moist.humidity_percent(ppmv, dew, 900.0) == pytest.approx(100.0, abs=0.01)


def test_ventilation_of_a_still_sphere_is_two():
    assert moist.ventilation(0.0, 4e-4) == 2.0
    assert moist.ventilation(5.0, 4e-4) == pytest.approx(2 + 0.6 * (5 * 8e-4 / 1.5e-5) ** 0.5 * 0.71 ** (1 / 3))
