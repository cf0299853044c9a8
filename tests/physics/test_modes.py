"""Closed forms of bead and film: published landmarks, roots, and drives against independent numerics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shockrig.analysis.physics.modes import (
    film_mean,
    film_mean_biot,
    first_order,
    mix,
    response_times,
    sphere_core,
    sphere_core_biot,
)

TIMES = np.concatenate([[-1.0, 0.0], np.geomspace(1e-4, 5.0, 200)])


@pytest.mark.parametrize(
    ("modes", "landmarks"),
    [
        (sphere_core(), {0.5: 0.13879, 1 - np.exp(-1): 0.17091, 0.9: 0.30352, 0.98: 0.46660}),
        (film_mean(), {0.5: 0.19673, 1 - np.exp(-1): 0.32025, 0.9: 0.84809, 0.98: 1.50037}),
        (first_order(1.0), {0.5: np.log(2), 1 - np.exp(-1): 1.0, 0.9: np.log(10), 0.98: np.log(50)}),
    ],
    ids=["sphere", "film", "first order"],
)
def test_dimensionless_landmarks(modes, landmarks):
    times = response_times(modes, tuple(landmarks))
    assert times == pytest.approx(list(landmarks.values()), rel=4e-5)


@given(rate=st.floats(1e-3, 50.0))
@settings(max_examples=20, deadline=None)
def test_response_times_scale_with_the_rate(rate):
    assert np.array(response_times(film_mean().scaled(rate))) * rate == pytest.approx(response_times(film_mean()))


@pytest.mark.parametrize("build", [sphere_core, film_mean, lambda: sphere_core_biot(0.1), lambda: film_mean_biot(8.0)])
def test_a_step_starts_at_nothing_rises_and_settles_at_the_air(build):
    response = build().step(TIMES)
    assert response[0] == response[1] == 0.0
    # The series is cut: within a fiftieth of t50 it may be off by some per cent, after that it must not be.
    assert np.all(np.abs(response[TIMES < 2e-3]) < 0.06)
    later = response[TIMES > 2.5e-3]
    assert np.all(np.diff(later) > -1e-5)
    assert np.all((later > -1e-3) & (later <= 1.0 + 1e-12))
    assert build().step(np.array([1e4]))[0] == pytest.approx(1.0, abs=1e-12)


def test_early_film_uptake_is_that_of_a_half_space():
    """Before the sealed side is felt the mean grows as 2 sqrt(D t / pi) / L (Crank 1975, section 3.3)."""
    t = np.array([1e-3, 5e-3, 2e-2])
    assert film_mean().step(t) == pytest.approx(2 * np.sqrt(t / np.pi), rel=2e-3)


@pytest.mark.parametrize("biot", [0.01, 0.1, 1.0, 7.0, 50.0])
def test_robin_roots_and_amplitudes(biot):
    sphere, film = sphere_core_biot(biot), film_mean_biot(biot)
    b = np.sqrt(sphere.rate)
    assert 1 - b / np.tan(b) == pytest.approx(np.full(b.size, biot), rel=1e-6, abs=1e-7)
    b = np.sqrt(film.rate)
    assert b * np.tan(b) == pytest.approx(np.full(b.size, biot), rel=1e-6)
    # Without heat flowing at the start, a response through a resistance begins at zero with zero slope.
    assert sphere.amplitude.sum() == pytest.approx(-1.0)
    assert film.amplitude.sum() == pytest.approx(-1.0)


def test_a_small_bead_in_a_thin_film_of_air_is_lumped():
    """Bi -> 0: one exponential of rate 3 Bi alpha / R^2; the slowest root is 3 Bi (1 - Bi / 5) to second order."""
    modes = sphere_core_biot(0.01)
    assert modes.rate[0] == pytest.approx(3 * 0.01 * (1 - 0.01 / 5), rel=1e-4)
    assert modes.amplitude[0] == pytest.approx(-1.0, abs=6e-3)


@pytest.mark.parametrize(("with_biot", "without"), [(sphere_core_biot, sphere_core), (film_mean_biot, film_mean)])
def test_no_resistance_is_the_plain_model(with_biot, without):
    t = np.geomspace(0.02, 3.0, 50)
    assert with_biot(1e6).step(t) == pytest.approx(without().step(t), abs=1e-4)


def test_biot_solution_satisfies_the_heat_equation_integrated_independently():
    """Finite volumes of a sphere with surface flux Bi (1 - T_s), fine in space and time, against the core's modes."""
    biot, cells, dt = 0.3, 200, 2e-4
    edge = np.linspace(0.0, 1.0, cells + 1)
    area, volume = edge**2, (edge[1:] ** 3 - edge[:-1] ** 3) / 3
    h = 1.0 / cells
    matrix = np.zeros((cells, cells))
    for i in range(cells - 1):
        g = area[i + 1] / h
        matrix[i, i] -= g / volume[i]
        matrix[i, i + 1] += g / volume[i]
        matrix[i + 1, i + 1] -= g / volume[i + 1]
        matrix[i + 1, i] += g / volume[i + 1]
    surface = 1.0 / (1.0 / biot + h / 2)  # from the air to the middle of the outermost cell
    matrix[-1, -1] -= surface / volume[-1]
    source = np.zeros(cells)
    source[-1] = surface / volume[-1]
    left, right = np.eye(cells) - dt / 2 * matrix, np.eye(cells) + dt / 2 * matrix
    step, push = np.linalg.solve(left, right), np.linalg.solve(left, dt * source)
    state, core = np.zeros(cells), []
    for _ in range(int(3.0 / dt)):
        state = step @ state + push
        core.append(state[0])
    t = dt * np.arange(1, len(core) + 1)
    assert sphere_core_biot(biot).step(t)[50:] == pytest.approx(np.array(core)[50:], abs=2e-4)


@pytest.mark.parametrize("modes", [sphere_core(), film_mean(), first_order(0.4), sphere_core_biot(0.1)])
def test_drives_against_numerical_convolution(modes):
    """y(t) = int S(t - s) u'(s) ds + S(t) u(0), by trapezoids."""
    fine = np.linspace(0.0, 2.0, 40001)
    step = modes.step(fine)
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (step[1:] + step[:-1])) * fine[1]])
    at = np.array([2000, 8000, 20000, 40000])
    assert modes.integral(fine[at]) == pytest.approx(integral[at], abs=2e-5)
    duration = 0.3
    ramp = (integral - np.interp(fine - duration, fine, integral, left=0.0)) / duration
    assert modes.ramp(fine[at], duration) == pytest.approx(ramp[at], abs=5e-5)
    tau = 0.7
    for i in at:
        decay = np.exp(-(fine[i] - fine[: i + 1]) / tau)
        numeric = step[i] - np.trapezoid(step[: i + 1] * decay / tau, fine[: i + 1])
        assert modes.exponential(fine[i : i + 1], tau)[0] == pytest.approx(numeric, abs=5e-5)


def test_a_ramp_of_no_duration_is_a_step_and_mixing_is_linear():
    t = TIMES
    assert film_mean().ramp(t, 0.0)[3:] == pytest.approx(film_mean().step(t)[3:], abs=1e-4)
    mixed = mix(sphere_core(), first_order(np.array([2.0])), np.array([0.25]))
    expected = 0.75 * sphere_core().step(t) + 0.25 * first_order(2.0).step(t)
    assert mixed.step(t)[0] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("duration_s", [0.05, 0.4, 3.0])
def test_air_let_in_by_a_ramp_is_the_convolution(duration_s):
    """Against Duhamel's integral by quadrature: the impulse response of the film with the air that comes in."""
    film = film_mean().scaled(0.05)
    s = np.linspace(0.0, 70.0, 700_001)
    air = np.minimum(s / duration_s, 1.0) * np.exp(-s / 7.0)
    step = film.step(s)
    times = np.array([0.5, 0.9, 2.5, 6.0, 20.0]) * duration_s
    expected = [np.trapezoid(np.gradient(air, s)[s <= t] * np.interp(t - s[s <= t], s, step), s[s <= t]) for t in times]
    assert film.exponential(times, 7.0, duration_s) == pytest.approx(np.array(expected), abs=2e-4)
    assert film.exponential(times, 7.0, 1e-9) == pytest.approx(film.exponential(times, 7.0), abs=1e-4)


@pytest.mark.parametrize("modes", [sphere_core(), sphere_core_biot(np.array([0.1, 2.0]))])
def test_a_core_s_steady_lag_does_not_depend_on_the_number_of_modes(modes):
    """R^2 / (6 alpha) at the core, 1 / (3 Bi) more behind an air film: minus the sum of a / lambda."""
    lag = -(modes.amplitude / modes.rate).sum(axis=-1)
    expected = 1 / 6 if lag.ndim == 0 else 1 / 6 + 1 / (3 * np.array([0.1, 2.0]))
    assert lag == pytest.approx(expected, rel=1e-9)


DRIVES = {
    "step": lambda modes, t, a, b, **mean: modes.step(t, **mean),
    "integral": lambda modes, t, a, b, **mean: modes.integral(t, **mean),
    "ramp": lambda modes, t, a, b, **mean: modes.ramp(t, a, **mean),
    "exponential": lambda modes, t, a, b, **mean: modes.exponential(t, b, **mean),
    "let in": lambda modes, t, a, b, **mean: modes.exponential(t, b, a, **mean),
}


@pytest.mark.parametrize("drive", DRIVES)
@given(
    samples=st.integers(1, 30),
    period_s=st.floats(0.01, 2.0),
    phase=st.floats(0.0, 1.0),
    ramp_s=st.floats(1e-3, 8.0),
    decay_s=st.floats(0.05, 60.0),
)
@settings(max_examples=25, deadline=None)
def test_a_running_mean_is_the_mean_of_its_readings(drive, samples, period_s, phase, ramp_s, decay_s):
    """Before, while and after the change lies among the readings, for rows of their own start, rate and ramp."""
    modes = mix(film_mean(24).scaled(np.array([[0.03], [0.8]])), first_order(np.array([[0.9, 7.0]])), 0.3)
    t = period_s * (np.arange(-3.0, 60.0) + phase) - np.array([[[0.0], [0.37]], [[-1.9], [5.0 * period_s]]])
    ramp, decay = np.array([[ramp_s], [1.7]]), np.array([[decay_s, 3.0]])
    form = DRIVES[drive]
    readings = [form(modes, t - j * period_s, ramp, decay) for j in range(samples)]
    found = form(modes, t, ramp, decay, samples=samples, period_s=period_s)
    # The plain forms leave out what has died away to 2e-9, mode by mode.
    assert found == pytest.approx(np.mean(readings, axis=0), abs=2e-8 * (1.0 + period_s * (drive == "integral")))


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("samples", [2, 7, 24])
def test_a_running_mean_is_exact_where_nothing_is_left_out(drive, samples, monkeypatch):
    monkeypatch.setattr("shockrig.analysis.physics.exponentials.DIED_OUT", 60.0)
    modes = mix(film_mean(24).scaled(np.array([[0.03], [0.8]])), first_order(np.array([[0.9, 7.0]])), 0.3)
    t = 0.1 * np.arange(-5.0, 400.0) + np.array([[[0.0312], [0.37]], [[-1.9], [0.5]]])
    ramp, decay = np.array([[0.83], [1.7]]), np.array([[40.0, 3.0]])
    form = DRIVES[drive]
    readings = [form(modes, t - 0.1 * j, ramp, decay) for j in range(samples)]
    found = form(modes, t, ramp, decay, samples=samples, period_s=0.1)
    assert found == pytest.approx(np.mean(readings, axis=0), rel=1e-12, abs=1e-12)


def test_a_running_mean_over_a_step_alone_is_a_ramp():
    """A lag that is nothing beside the readings' distance: the mean counts the readings after the step."""
    t = 0.1 * np.arange(-3.0, 12.0) + 0.05
    counted = np.clip(np.arange(-2, 13), 0, 8) / 8
    assert first_order(1e-4).step(t, samples=8, period_s=0.1) == pytest.approx(counted, abs=1e-9)
