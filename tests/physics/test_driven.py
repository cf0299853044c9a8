"""Bodies driven by measured air: closed forms for known air, invariances, an independent integration, the reference's
own lag."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from shockrig.analysis.physics import driven
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.driven import (
    beside_lagging_reference,
    noise_passed,
    respond,
    undo_lag,
    undone_uncertainty,
)
from shockrig.analysis.physics.modes import film_mean, first_order, in_series, sphere_core, two_lags

AT = np.concatenate([[-3.0, 0.0], np.geomspace(0.01, 40.0, 80)])


def rough_trace(seed, count=60, lasting_s=30.0):
    rng = np.random.default_rng(seed)
    return np.sort(rng.uniform(0.0, lasting_s, count)), 20.0 + rng.normal(size=count).cumsum()


@pytest.mark.parametrize("name", BODIES)
def test_a_step_and_a_ramp_are_the_closed_forms(name):
    modes = BODIES[name].held().scaled(0.2)
    step = respond(modes, np.array([0.0, 0.0, 9.0]), np.array([0.0, 1.0, 1.0]), AT)
    assert step == pytest.approx(modes.step(AT), abs=1e-8)
    ramp = respond(modes, np.array([-5.0, 0.0, 3.0, 3.1]), np.array([10.0, 10.0, 35.0, 35.0]), AT)
    assert ramp == pytest.approx(10.0 + 25.0 * modes.ramp(AT, 3.0), abs=1e-6)
    settled = respond(modes, np.array([0.0, 50.0]), np.array([7.0, 7.0]), AT, settled_to=4.0)
    assert settled == pytest.approx(4.0 + 3.0 * modes.step(AT), abs=1e-7)


@pytest.mark.parametrize("name", ["sphere", "film", "lumped"])
def test_air_that_relaxes_is_the_closed_form_to_second_order_in_the_sampling(name):
    modes, tau = BODIES[name].held().scaled(0.2), 4.0
    errors = []
    for period in (0.2, 0.1):
        time = np.arange(0.0, 60.0, period)
        trace = respond(modes, time, np.exp(-time / tau), AT, settled_to=0.0)
        errors.append(np.abs(trace - modes.exponential(AT, tau)).max())
    assert errors[1] < (0.1 / tau) ** 2 / 8
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def test_air_that_swings_is_passed_by_the_bodys_transfer_function():
    """Core of a sphere: x / sinh x, x = sqrt(i omega R^2 / alpha); straight lines keep sinc^2 of the first harmonic."""
    omega, rate, period = 2.0, 0.5, 0.02
    time = np.arange(0.0, 80.0, period)
    at = np.linspace(60.0, 79.0, 500)
    x = np.sqrt(1j * omega / rate)
    kept = np.sinc(omega * period / (2 * np.pi)) ** 2
    expected = np.imag(kept * x / np.sinh(x) * np.exp(1j * omega * at))
    found = respond(sphere_core().scaled(rate), time, np.sin(omega * time), at)
    assert found == pytest.approx(expected, abs=2e-6)


@pytest.mark.parametrize("seed", range(3))
def test_a_rough_trace_is_the_sum_of_its_ramps(seed):
    time, value = rough_trace(seed)
    modes = film_mean().scaled(0.1)
    expected = value[0] + sum(
        rise * modes.ramp(AT - start, length)
        for start, length, rise in zip(time[:-1], np.diff(time), np.diff(value), strict=True)
    )
    assert respond(modes, time, value, AT) == pytest.approx(expected, abs=1e-6)


@given(seed=st.integers(0, 10_000), added=st.lists(st.floats(-5.0, 35.0), max_size=40), doubled=st.booleans())
@settings(max_examples=40, deadline=None)
def test_more_points_on_the_same_lines_change_nothing(seed, added, doubled):
    time, value = rough_trace(seed)
    more = np.sort(np.concatenate([time, added, time[:20] if doubled else []]))
    modes = in_series(film_mean().scaled(0.1), 0.7)
    once = respond(modes, time, value, AT)
    assert respond(modes, more, np.interp(more, time, value), AT) == pytest.approx(once, abs=1e-9)


@pytest.mark.parametrize("count", [1, 2, 3, 17, 400])
def test_the_blocks_in_which_it_is_computed_leave_no_seams(count, monkeypatch):
    time, value = rough_trace(7, count)
    modes = film_mean().scaled(np.array([[0.5], [0.02]]))
    at = np.concatenate([AT, time])
    monkeypatch.setattr(driven, "_sums", None)
    whole = respond(modes, time, value, at)
    monkeypatch.setattr(driven, "STATES_AT_ONCE", 1)
    monkeypatch.setattr(driven, "READ_AT_ONCE", 1000)
    assert respond(modes, time, value, at) == pytest.approx(whole, abs=1e-12)


@pytest.mark.skipif(driven._sums is None, reason="the kernel was not built")
@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("lead", [(), (1,), (3, 4)])
def test_without_a_compiler_a_response_is_the_same(lead, even, monkeypatch):
    rng = np.random.default_rng([6, even, len(lead)])
    modes = in_series(film_mean().scaled(10.0 ** rng.uniform(-3.0, 0.0, lead)), 10.0 ** rng.uniform(-1.0, 2.0, lead))
    time = 0.1 * np.arange(300.0) if even else np.sort(rng.uniform(0.0, 30.0, 300))
    time[100:103] = time[100]  # two jumps at one time
    value = rng.normal(size=(*lead, 300)).cumsum(axis=-1)
    at = rng.permuted(np.concatenate([AT, time]))  # in no order, samples' own times and others
    start = rng.normal(size=lead)
    found = respond(modes, time, value, at, settled_to=start)
    monkeypatch.setattr(driven, "_sums", None)
    np.testing.assert_allclose(respond(modes, time, value, at, settled_to=start), found, atol=1e-10)


@pytest.mark.skipif(driven._sums is None, reason="the kernel was not built")
def test_arrays_that_do_not_fit_the_kernel_are_refused():
    three, one, places = np.ones((1, 3)), np.ones(1), np.zeros((1, 3), dtype=np.int64)
    right = [3, three, three, three, three, one, three, places, 36.0, 1e-9, 1e-150, np.empty((1, 3))]
    driven._sums.drive(*right)
    for place, wrong in (
        (0, 4),  # fewer modes than are said
        (2, np.ones((1, 2))),  # rates
        (3, np.ones(2)),  # times of the trace
        (4, np.ones((2, 3))),
        (5, np.ones(2)),
        (6, np.ones((1, 4))),
        (7, places + 3),  # an order that leads beyond
        (7, places.astype(np.int32)),
        (11, np.empty((1, 2))),
    ):
        with pytest.raises(ValueError, match="do not fit"):
            driven._sums.drive(*right[:place], wrong, *right[place + 1 :])


def test_two_lags_against_an_integration_of_their_equations():
    time, value = rough_trace(3, 40)
    first, second = 2.0, 0.7

    def slope(t, state):
        return [(np.interp(t, time, value) - state[0]) / first, (state[0] - state[1]) / second]

    at = np.sort(AT[AT > time[0]])
    knots = np.concatenate([time, [at[-1]]])
    state, expected = [value[0], value[0]], []
    for begin, end in zip(knots[:-1], knots[1:], strict=True):  # the slopes jump at the samples
        inside = at[(at > begin) & (at <= end)]
        run = solve_ivp(slope, (begin, end), state, dense_output=True, rtol=1e-10, atol=1e-10)
        expected.extend(run.sol(np.append(inside, end))[1, :-1])
        state = run.y[:, -1]
    assert respond(two_lags(first, second), time, value, at) == pytest.approx(np.array(expected), abs=1e-7)


def test_a_film_against_finite_volumes_driven_by_the_same_trace():
    time, value = rough_trace(5, 40)
    rate, cells = 0.1, 150
    at = np.linspace(time[0] + 0.5, time[-1], 60)
    h = 1.0 / cells
    matrix = np.diag(np.full(cells - 1, 1.0), 1) + np.diag(np.full(cells - 1, 1.0), -1) - 2 * np.eye(cells)
    matrix[0, 0], matrix[-1, -1] = -1.0, -3.0  # sealed below; half a cell from the surface
    matrix *= rate / h**2
    source = np.zeros(cells)
    source[-1] = 2 * rate / h**2
    run = solve_ivp(
        lambda t, c: matrix @ c + source * np.interp(t, time, value),
        (time[0], time[-1]),
        np.full(cells, value[0]),
        method="BDF",
        jac=matrix,
        t_eval=at,
        rtol=1e-7,
        atol=1e-7,
        max_step=0.05,
    )
    assert respond(film_mean().scaled(rate), time, value, at) == pytest.approx(run.y.mean(axis=0), abs=1e-3)


def test_a_body_far_faster_than_the_sampling_follows_the_line_by_its_mean_lag():
    """1 / 6 of R^2 / alpha behind, wherever the corner before is forgotten."""
    time, value = np.arange(0.0, 1000.0, 10.0), np.random.default_rng(1).normal(size=100).cumsum()
    rate = 4.0
    at = time[:-1] + 6.0
    slope = np.diff(value) / 10.0
    found = respond(sphere_core().scaled(rate), time, value, at)
    assert found == pytest.approx(np.interp(at, time, value) - slope / (6 * rate), abs=1e-9)


def test_outside_the_trace_the_air_stands():
    time, value = rough_trace(2)
    modes = first_order(3.0)
    assert list(respond(modes, time, value, np.array([-1e6, time[0] - 1e-9, time[0]]))) == [value[0]] * 3
    end, later = respond(modes, time, value, np.array([time[-1], time[-1] + 6.0]))
    assert later - value[-1] == pytest.approx((end - value[-1]) * np.exp(-2.0), rel=1e-9)
    assert respond(modes, time, value, np.array([1e5]))[0] == pytest.approx(value[-1])
    assert respond(modes, np.array([4.0]), np.array([2.5]), AT) == pytest.approx(np.full(AT.size, 2.5))


def test_leading_axes_are_candidates_and_runs():
    time, value = rough_trace(4)
    rates, offsets, shifts = np.array([0.05, 0.3, 2.0]), np.array([0.0, -0.4]), np.array([0.0, 0.2, 1.1])
    found = respond(sphere_core().scaled(rates[:, None]), time, value + offsets[:, None], AT - shifts[:, None, None])
    assert found.shape == (3, 2, AT.size)
    for i, rate in enumerate(rates):
        for j, offset in enumerate(offsets):
            alone = respond(sphere_core().scaled(rate), time, value + offset, AT - shifts[i])
            assert found[i, j] == pytest.approx(alone, abs=1e-12)
    order = np.random.default_rng(0).permutation(AT.size)
    assert respond(sphere_core(), time, value, AT[order]) == pytest.approx(
        respond(sphere_core(), time, value, AT)[order], abs=1e-12
    )


def test_a_logger_that_averages():
    time, value = rough_trace(6)
    modes = film_mean().scaled(np.array([[0.1], [0.5]]))
    readings = [respond(modes, time, value, AT - 0.3 * j) for j in range(9)]
    found = respond(modes, time, value, AT, samples=9, period_s=0.3)
    assert found == pytest.approx(np.mean(readings, axis=0), abs=1e-12)


def test_a_rate_that_changes_with_time_is_another_time_axis():
    """A lump whose time constant grows as t: y' = (u - y) / t has t (y - y_1) = int (u - y_1) dt."""
    time = np.geomspace(1.0, 20.0, 4001)
    value = (time > 3.0) * np.sin(time - 3.0)
    at = np.linspace(1.5, 19.0, 30)
    found = respond(first_order(1.0), np.log(time), value, np.log(at))
    assert found == pytest.approx(np.where(at > 3.0, (1 - np.cos(at - 3.0)) / at, 0.0), abs=2e-6)


@pytest.mark.parametrize(
    ("time", "value", "said"),
    [
        (np.array([0.0, 2.0, 1.0]), np.zeros(3), "must not fall"),
        (np.array([0.0, 1.0]), np.array([0.0, np.nan]), "finite"),
        (np.array([]), np.array([]), "one or more"),
        (np.array([0.0, 1.0]), np.zeros(3), "each of them"),
    ],
)
def test_traces_that_cannot_be(time, value, said):
    with pytest.raises(ValueError, match=said):
        respond(sphere_core(), time, value, AT)


def sigmoid(t):
    return 20.0 + 10.0 * np.tanh((t - 10.0) / 3.0)


def test_undoing_a_references_lag_gives_the_air_to_second_order():
    tau, errors = 1.3, []
    for period in (0.2, 0.1):
        time = np.arange(0.0, 30.0, period)
        fine = np.arange(-20.0, 30.0, 0.005)
        shown = respond(first_order(tau), fine, sigmoid(fine), time)
        air = undo_lag(time, shown, tau)
        errors.append(np.abs(air - sigmoid(time))[1:-1].max())
    assert errors[1] < 5e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def test_undoing_a_lag_keeps_the_integral_and_is_exact_on_a_straight_line():
    time, value = rough_trace(8)
    taus = np.array([0.0, 0.4, 6.0])
    air = undo_lag(time, value, taus)
    gained = np.trapezoid(air - value, time, axis=-1)
    assert gained == pytest.approx(taus * (value[-1] - value[0]))
    assert air[0] == pytest.approx(value)
    assert undo_lag(time, 3.0 - 0.5 * time, 2.0) == pytest.approx(2.0 - 0.5 * time)
    assert undo_lag(time[:1], value[:1], 2.0) == pytest.approx(value[:1])
    with pytest.raises(ValueError, match="must rise"):
        undo_lag(np.array([0.0, 1.0, 1.0]), np.zeros(3), 1.0)


@pytest.mark.parametrize("count", [1, 2, 12])
def test_uncertainty_of_undone_air_is_that_of_repeated_draws(count):
    rng = np.random.default_rng(4)
    time, value = rough_trace(9, count)
    draws, tau = 20_000, 0.8
    noisy = value + 0.05 * rng.normal(size=(draws, count)) + 0.03 * rng.normal(size=(draws, 1))
    taus = tau + 0.02 * rng.normal(size=draws)
    spread = undo_lag(time, noisy, taus).std(axis=0)
    stated = undone_uncertainty(time, value, tau, noise=0.05, offset=0.03, time_constant_uncertainty_s=0.02)
    assert stated == pytest.approx(spread, rel=0.03)


def test_the_noise_of_undone_air_on_even_samples():
    stated = undone_uncertainty(np.arange(50) * 0.1, np.zeros(50), 1.0, noise=1.0)
    assert stated[1:-1] == pytest.approx(np.full(48, np.sqrt(1 + 0.5 * 10.0**2)))


@pytest.mark.parametrize("name", BODIES)
def test_a_body_beside_a_lagging_reference_sees_the_air_before_that_lag(name):
    """Trace plus lag times slope, piece by piece with a jump at every sample, is what the modes take for the air."""
    time, value = rough_trace(10, 30)
    body, tau = BODIES[name].held().scaled(0.2), 1.5
    ahead = tau * np.diff(value) / np.diff(time)
    both = np.repeat(time, 2)[1:-1]
    air = np.repeat(value, 2)[1:-1] + np.repeat(ahead, 2)
    at = AT[AT < time[-1]]
    plain = respond(body, both, air, at, settled_to=value[0])
    assert respond(beside_lagging_reference(body, tau), time, value, at) == pytest.approx(plain, abs=1e-8)


def test_a_lump_as_slow_as_its_reference_reads_what_that_reads():
    time, value = rough_trace(11)
    inside = np.linspace(time[0], time[-1], 200)
    modes = beside_lagging_reference(first_order(np.array([0.9, 2.0])), np.array([0.9, 2.0]))
    for found in respond(modes, time, value, inside):
        assert found == pytest.approx(np.interp(inside, time, value), abs=1e-10)


@pytest.mark.parametrize("reference_s", [0.0, 2.0])
def test_noise_that_a_body_passes_on_is_the_sum_of_its_weights_squared(reference_s):
    modes = beside_lagging_reference(film_mean().scaled(np.array([0.05, 0.6])), reference_s)
    count, period = 1500, 0.1
    time = period * np.arange(count)
    pulse = np.zeros(count)
    pulse[1] = 1.0
    weights = respond(modes, time, pulse, time)
    assert noise_passed(modes, period) == pytest.approx(np.sqrt(np.sum(weights**2, axis=-1)), rel=1e-9)


def test_noise_through_a_slow_lag_is_that_of_a_mean_over_two_time_constants():
    """Samples every D through a lag tau >> D: variance D / (2 tau)."""
    assert noise_passed(first_order(10.0), 0.01) == pytest.approx(np.sqrt(0.01 / 20.0), rel=1e-3)
