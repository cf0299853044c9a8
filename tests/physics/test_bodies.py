"""The contract of every body: transfer functions in closed form, limits, conservation, landmarks, lags in series."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import iv

from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.modes import first_order, in_series, mix, response_times, two_lags
from shockrig.files.campaign import BODIES as NAMES_IN_CAMPAIGNS

SHAPES = {"sphere": 2, "sphere_mean": 2, "cylinder": 1, "cylinder_mean": 1, "plate": 0, "film": 0}
MEANS = ("film", "sphere_mean", "cylinder_mean")
SERIES = [name for name in BODIES if name != "lumped"]
FREQUENCIES = np.concatenate([np.geomspace(0.01, 60.0, 12), 1j * np.geomspace(0.01, 60.0, 12)])
EARLY_TO_LATE = np.concatenate([np.geomspace(1e-5, 0.02, 300), np.linspace(0.02, 6.0, 600)])

# Share inside (read at the core, or as the mean) of what the surface has, and minus the slope at the surface over it,
# for x = sqrt(s): Carslaw and Jaeger (1959), chapters XII and XIII.
INSIDE = {
    "sphere": lambda x: x / np.sinh(x),
    "sphere_mean": lambda x: 3 * (x / np.tanh(x) - 1) / x**2,
    "cylinder": lambda x: 1 / iv(0, x),
    "cylinder_mean": lambda x: 2 * iv(1, x) / (x * iv(0, x)),
    "plate": lambda x: 1 / np.cosh(x),
    "film": lambda x: np.tanh(x) / x,
    "lumped": lambda x: 1 / (1 + x**2),
}
TAKEN_UP = {
    2: lambda x: x / np.tanh(x) - 1,
    1: lambda x: x * iv(1, x) / iv(0, x),
    0: lambda x: x * np.tanh(x),
}


def transfer(modes, s):
    """Laplace transform of the impulse response: 1 + sum_k a_k s / (s + lambda_k)."""
    return 1 + np.sum(modes.amplitude * s[:, None] / (s[:, None] + modes.rate), axis=-1)


def exact_transfer(name, s, biot=np.inf):
    x = np.sqrt(s.astype(complex))
    if name == "lumped":
        return 1 / (1 + s * (1 + 1 / biot))
    return INSIDE[name](x) / (1 + TAKEN_UP[SHAPES[name]](x) / biot)


def test_campaigns_and_the_table_name_the_same_bodies():
    assert tuple(BODIES) == NAMES_IN_CAMPAIGNS
    assert all(name == body.name for name, body in BODIES.items())
    assert {name: body.symbol for name, body in BODIES.items()} == {
        "sphere": "alpha/R^2",
        "film": "D/L^2",
        "sphere_mean": "alpha/R^2",
        "cylinder": "alpha/R^2",
        "cylinder_mean": "alpha/R^2",
        "plate": "alpha/L^2",
        "lumped": "1/tau",
    }
    assert BODIES["sphere_mean"].symbol_with("D") == "D/R^2"
    assert BODIES["lumped"].symbol_with("D") == "1/tau"


@pytest.mark.parametrize("name", BODIES)
def test_transfer_function_held(name):
    assert transfer(BODIES[name].held(), FREQUENCIES) == pytest.approx(exact_transfer(name, FREQUENCIES), abs=6e-6)


@pytest.mark.parametrize("biot", [1e-4, 0.05, 0.3, 1.0, 4.0, 60.0])
@pytest.mark.parametrize("name", BODIES)
def test_transfer_function_behind_a_resistance(name, biot):
    found = transfer(BODIES[name].behind(np.array(biot)), FREQUENCIES)
    assert found == pytest.approx(exact_transfer(name, FREQUENCIES, biot), abs=6e-6)


@pytest.mark.parametrize("biot", [np.inf, 20.0, 0.7, 0.02])
@pytest.mark.parametrize("name", BODIES)
def test_a_unit_step_starts_at_nothing_rises_and_ends_at_the_air(name, biot):
    body = BODIES[name]
    modes = body.held() if np.isinf(biot) else body.behind(np.array(biot))
    assert modes.amplitude.sum() == pytest.approx(-1.0, abs=1e-12)
    assert np.all(np.diff(modes.rate) > 0)
    response = modes.step(EARLY_TO_LATE)
    # A core's series holds from the first instant, a mean's once its last mode has died out.
    assert np.all(np.diff(response) > -2e-7)
    assert np.all((response > -2e-7) & (response <= 1.0))
    assert list(modes.step(np.array([-1.0, 0.0]))) == [0.0, 0.0]
    assert modes.step(np.array([60.0 / modes.rate[0]]))[0] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("name", ["sphere", "cylinder", "plate"])
def test_a_core_feels_nothing_until_the_change_has_come_through(name):
    """erfc(1 / sqrt(4 t)) of the nearest surface bounds it: 1e-14 at a Fourier number of 0.004 (for a sphere 1e-25)."""
    early = np.linspace(1e-6, 4e-3, 400)
    assert np.abs(BODIES[name].held().step(early)).max() < 1e-7
    assert np.abs(BODIES[name].behind(np.array(5.0)).step(early)).max() < 1e-7


@pytest.mark.parametrize("name", SERIES)
def test_the_steps_do_not_depend_on_the_number_of_modes(name):
    body = BODIES[name]
    few, many = body.held(), body.held(3 * body.held().rate.size)
    beyond = EARLY_TO_LATE > 2e-4
    assert few.step(EARLY_TO_LATE)[beyond] == pytest.approx(many.step(EARLY_TO_LATE)[beyond], abs=1e-7)
    assert few.integral(EARLY_TO_LATE) == pytest.approx(many.integral(EARLY_TO_LATE), abs=1e-7)
    biot = np.array([0.1, 3.0])
    few, many = body.behind(biot), body.behind(biot, 3 * body.held().rate.size)
    assert few.step(EARLY_TO_LATE)[:, beyond] == pytest.approx(many.step(EARLY_TO_LATE)[:, beyond], abs=1e-7)


@pytest.mark.parametrize("name", BODIES)
def test_no_resistance_is_the_body_held_at_the_air(name):
    body = BODIES[name]
    late = EARLY_TO_LATE[EARLY_TO_LATE > 1e-3]
    assert body.behind(np.array(1e8)).step(late) == pytest.approx(body.held().step(late), abs=1e-6)


@pytest.mark.parametrize("name", BODIES)
def test_a_large_resistance_makes_one_lag_of_surface_over_volume_times_biot(name):
    """The slowest rate is (S/V) Bi (1 - c Bi), the rest carries nothing."""
    body = BODIES[name]
    for biot in (1e-5, 1e-4, 1e-3):
        modes = body.behind(np.array(biot))
        assert modes.rate[0] == pytest.approx(body.surface_to_volume * biot, rel=1.1 * biot)
        assert modes.amplitude[0] == pytest.approx(-1.0, abs=biot)
    assert body.behind(np.array([[1e-3, 1.0]])).rate.shape[:2] == (1, 2)


MEAN_LAG = {"sphere": 1 / 6, "sphere_mean": 1 / 15, "cylinder": 1 / 4, "cylinder_mean": 1 / 8, "plate": 1 / 2}


@pytest.mark.parametrize("biot", [np.inf, 0.4])
@pytest.mark.parametrize("name", BODIES)
def test_behind_a_steady_ramp_the_reading_lags_by_what_heat_has_to_travel(name, biot):
    """Steady profile under a linear rise: R^2/6 alpha at a sphere's core, and V/(S Bi) more behind a resistance."""
    lag = MEAN_LAG.get(name, {"film": 1 / 3, "lumped": 1.0}.get(name))
    body = BODIES[name]
    modes = body.held() if np.isinf(biot) else body.behind(np.array(biot))
    t = np.array([200.0])
    assert t - modes.integral(t) == pytest.approx([lag + 1 / (body.surface_to_volume * biot)], abs=1e-7)


def finite_volumes(power, biot, times, cells=400):
    """Core, mean and surface flux of a sphere (power 2), cylinder (1) or plate (0): Crank-Nicolson on graded steps."""
    edge = np.linspace(0.0, 1.0, cells + 1)
    h, area = 1.0 / cells, edge**power
    volume = np.diff(edge ** (power + 1)) / (power + 1)
    surface = 1.0 / (1.0 / biot + h / 2)  # from the air to the middle of the outermost cell
    inner = area[1:-1] / h
    below, above = np.append(inner, 0.0), np.append(0.0, inner)
    matrix = np.diag(-(below + above)) + np.diag(inner, 1) + np.diag(inner, -1)
    matrix[-1, -1] -= surface
    matrix /= volume[:, None]
    source = np.zeros(cells)
    source[-1] = surface / volume[-1]
    rate, vectors = np.linalg.eig(matrix)
    settled = -np.linalg.solve(matrix, source)
    parts = np.linalg.solve(vectors, settled)
    state = settled - (np.exp(np.outer(times, rate.real)) * parts.real) @ vectors.real.T
    core = (9 * state[:, 0] - state[:, 1]) / 8  # even in r: no slope at the middle
    return core, state @ volume * (power + 1), surface * (1 - state[:, -1])


@pytest.mark.parametrize("biot", [1e9, 0.5])
@pytest.mark.parametrize("name", SHAPES)
def test_steps_against_finite_volumes(name, biot):
    times = np.linspace(0.01, 2.0, 60)
    core, mean, _ = finite_volumes(SHAPES[name], biot, times)
    body = BODIES[name]
    modes = body.held() if biot > 1e6 else body.behind(np.array(biot))
    assert modes.step(times) == pytest.approx(mean if name in MEANS else core, abs=3e-5)


@pytest.mark.parametrize("biot", [0.5, 6.0])
@pytest.mark.parametrize("name", MEANS)
def test_what_a_mean_gains_is_what_comes_through_the_surface(name, biot):
    """d(mean)/dt = (S/V) flux, the flux that of an independent integration."""
    times = np.linspace(0.02, 2.0, 40)
    _, _, flux = finite_volumes(SHAPES[name], biot, times)
    body = BODIES[name]
    modes = body.behind(np.array(biot))
    gained = -np.sum(modes.amplitude * modes.rate * np.exp(-np.outer(times, modes.rate)), axis=-1)
    assert gained == pytest.approx(body.surface_to_volume * flux, rel=2e-4, abs=2e-5)


def test_landmarks():
    """Sphere and film as the paper's model has them (docs), a lump's by definition, the rest from first terms.

    Late: a step is within one exponential of its end, t = ln(A / (1 - share)) / b^2. Early: the mean of a sphere rises
    as 6 sqrt(t / pi) - 3 t (Crank 1975, Eq. 6.23).
    """
    assert BODIES["sphere"].landmarks == pytest.approx((0.17091, 0.30352, 0.46660), rel=4e-5)
    assert BODIES["film"].landmarks == pytest.approx((0.32025, 0.84809, 1.50037), rel=4e-5)
    assert BODIES["lumped"].landmarks == pytest.approx((1.0, np.log(10), np.log(50)), rel=1e-8)
    first_zero, j1_there = 2.404825557695773, 0.5191474972894668
    late = {
        "plate": (4 / np.pi, np.pi**2 / 4),
        "cylinder": (2 / (first_zero * j1_there), first_zero**2),
        "cylinder_mean": (4 / first_zero**2, first_zero**2),
        "sphere_mean": (6 / np.pi**2, np.pi**2),
    }
    for name, (amplitude, rate) in late.items():
        assert BODIES[name].landmarks[2] == pytest.approx(np.log(amplitude / 0.02) / rate, rel=1e-4)
    t63 = BODIES["sphere_mean"].landmarks[0]
    assert 6 * np.sqrt(t63 / np.pi) - 3 * t63 == pytest.approx(1 - np.exp(-1), rel=1e-6)


@pytest.mark.parametrize("name", SHAPES)
def test_landmarks_are_where_finite_volumes_cross(name):
    times = np.linspace(0.02, 2.0, 4000)
    core, mean, _ = finite_volumes(SHAPES[name], 1e9, times, cells=200)
    crossed = np.interp([1 - np.exp(-1), 0.9, 0.98], mean if name in MEANS else core, times)
    assert BODIES[name].landmarks == pytest.approx(tuple(crossed), rel=3e-4)


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("time_constant_s", [1e-3, 0.08, 0.5, 30.0])
def test_a_lag_in_series_multiplies_transfer_functions(name, time_constant_s):
    found = transfer(in_series(BODIES[name].held(), time_constant_s), FREQUENCIES)
    expected = exact_transfer(name, FREQUENCIES) / (1 + FREQUENCIES * time_constant_s)
    assert found == pytest.approx(expected, abs=6e-6)


@given(
    first_s=st.floats(0.05, 500.0),
    decade=st.one_of(st.none(), st.floats(-12.0, -0.3)),
    sign=st.sampled_from([-1.0, 1.0]),
)
@settings(max_examples=200, deadline=None)
def test_two_lags_at_any_distance(first_s, decade, sign):
    """1 - (lambda exp(-mu t) - mu exp(-lambda t)) / (lambda - mu), with the quotient written so that it is safe."""
    second_s = first_s * (1.0 if decade is None else 1.0 + sign * 10.0**decade)
    t = first_s * np.linspace(0.0, 12.0, 60)
    a, b = 1 / first_s, 1 / second_s
    gap = (b - a) * t
    quotient = t * np.where(gap == 0, 1.0, -np.expm1(-gap) / np.where(gap == 0, 1.0, gap))
    expected = 1 - np.exp(-a * t) * (1 + a * quotient)
    assert two_lags(first_s, second_s).step(t) == pytest.approx(expected, abs=2e-8)
    assert two_lags(second_s, first_s).step(t) == pytest.approx(expected, abs=2e-8)


def test_lags_of_equal_time_constants():
    """1 - exp(-x) (1 + x + ... + x^(n-1) / (n-1)!), up to three of them; t63 of two is 2.1462 tau."""
    x = np.linspace(0.0, 20.0, 200)
    assert two_lags(1.0, 1.0).step(x) == pytest.approx(1 - (1 + x) * np.exp(-x), abs=1e-8)
    assert in_series(two_lags(1.0, 1.0), 1.0).step(x) == pytest.approx(1 - (1 + x + x**2 / 2) * np.exp(-x), abs=1e-6)
    assert response_times(two_lags(1.0, 1.0))[0] == pytest.approx(2.14619, rel=1e-5)


def test_lags_of_which_some_stand_on_a_rate_are_each_what_they_are_alone():
    """One on a rate of its body, two on none: the one that has to give way moves no other."""
    rates = 1.0 / np.array([[0.5], [1.0], [2.0]])
    body = first_order(np.array([1.0, 1.0, 1.0])).scaled(np.ones(3))
    found = in_series(body, 1.0 / rates[:, 0])
    t = np.linspace(0.01, 8.0, 40)
    for i, second_s in enumerate((0.5, 1.0, 2.0)):
        assert found.step(t)[i] == pytest.approx(two_lags(1.0, second_s).step(t), abs=1e-12)


@pytest.mark.parametrize("name", SERIES)
def test_a_lag_as_fast_as_a_mode_of_the_body_is_nothing_special(name):
    held = BODIES[name].held()
    t = np.linspace(0.01, 4.0, 100)
    for k in (0, 1, 4):
        at = in_series(held, 1.0 / held.rate[k]).step(t)
        around = [in_series(held, (1.0 + off) / held.rate[k]).step(t) for off in (-1e-3, 1e-3)]
        assert at == pytest.approx(np.mean(around, axis=0), abs=2e-6)
        assert np.all(np.isfinite(at))


def test_lags_take_the_leading_axes_and_their_order_does_not_matter():
    body = BODIES["film"].held().scaled(np.array([[0.2], [0.4], [0.9]]))
    sheath, housing = np.array([[1.0], [2.0], [3.0]]), np.array([[0.4, 1.0]])
    t = np.linspace(0.1, 30.0, 50)
    one = in_series(in_series(body, sheath), housing)
    other = in_series(in_series(body, housing), sheath)
    assert one.rate.shape == (3, 2, body.rate.shape[-1] + 4)
    assert np.all(np.diff(one.ascending().rate, axis=-1) >= 0)
    assert one.step(t) == pytest.approx(other.step(t), abs=1e-7)
    assert one.step(t)[1, 0] == pytest.approx(
        in_series(in_series(BODIES["film"].held().scaled(0.4), 2.0), 0.4).step(t), abs=1e-8
    )


def test_a_vent_beside_a_housing_is_a_mixture_of_the_two():
    quick, slow = two_lags(0.3, 1.0), first_order(20.0)
    t = np.linspace(0.0, 60.0, 50)
    both = mix(quick, slow, 0.2)
    assert both.step(t) == pytest.approx(0.8 * quick.step(t) + 0.2 * slow.step(t), abs=1e-8)
