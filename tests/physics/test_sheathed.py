"""Bodies in a sheath that they load: transfer functions, limits, the mean lag, and a chain of finite volumes."""

import numpy as np
import pytest
from foreign_lab import make_body
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import j0, j1
from test_bodies import FREQUENCIES, INSIDE, SHAPES, TAKEN_UP, transfer

from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.modes import bessel_zeros, in_series

SHEATHS = [(0.02, 0.1), (0.05, 3.0), (0.3, 0.3), (0.3, 1.5), (2.0, 0.5), (2.0, 50.0), (40.0, 0.02)]
SERIES = list(SHAPES)
EXTREME = {"time_constant": st.floats(3e-4, 300.0), "capacity": st.floats(0.01, 50.0)}


def exact_transfer(name, s, time_constant, capacity):
    """The sheath's balance in Laplace's variable: c s Ts = c (Ta - Ts) / tau - (what the body takes up)."""
    x = np.sqrt(s.astype(complex))
    if name == "lumped":
        inside, taken = 1 / (1 + s), s / (1 + s)
    else:
        inside, taken = INSIDE[name](x), BODIES[name].surface_to_volume * TAKEN_UP[SHAPES[name]](x)
    return inside * (capacity / time_constant) / (capacity * s + capacity / time_constant + taken)


def mean_lag(modes):
    return -np.sum(modes.amplitude / modes.rate, axis=-1)


def times(name, time_constant, capacity):
    whole = float(mean_lag(BODIES[name].held())) + time_constant * (1 + 1 / capacity)
    return np.concatenate([np.geomspace(1e-3, 1.0, 300) * whole, np.linspace(1.0, 8.0, 300) * whole])


@pytest.mark.parametrize(("time_constant", "capacity"), SHEATHS)
@pytest.mark.parametrize("name", BODIES)
def test_the_transfer_function_is_that_of_the_two_balances(name, time_constant, capacity):
    found = transfer(BODIES[name].sheathed(time_constant, capacity), FREQUENCIES)
    assert np.abs(found - exact_transfer(name, FREQUENCIES, time_constant, capacity)).max() < 2e-6


@settings(deadline=None, max_examples=60)
@given(name=st.sampled_from(list(BODIES)), **EXTREME)
def test_the_mean_lag_is_the_bodys_own_and_the_filling_of_both(name, time_constant, capacity):
    """What passes the sheath's resistance is its own heat and the body's: (C_sheath + C_body) tau / C_sheath."""
    modes = BODIES[name].sheathed(time_constant, capacity)
    expected = mean_lag(BODIES[name].held()) + time_constant * (1 + 1 / capacity)
    assert mean_lag(modes) == pytest.approx(expected, rel=3e-6)


@settings(deadline=None, max_examples=60)
@given(name=st.sampled_from(list(BODIES)), **EXTREME)
def test_it_starts_at_zero_rises_all_the_way_and_ends_at_one(name, time_constant, capacity):
    modes = BODIES[name].sheathed(time_constant, capacity)
    assert modes.amplitude.sum() == pytest.approx(-1.0)
    assert np.all(np.diff(modes.rate) > 0) and modes.rate[0] > 0
    shown = modes.step(times(name, time_constant, capacity))
    assert np.diff(shown).min() > -1e-4 and shown.min() > -1e-4
    assert modes.step(np.array([60.0 / modes.rate[0]])) == pytest.approx(1.0, abs=1e-12)


@settings(deadline=None, max_examples=60)
@given(name=st.sampled_from(SERIES), **EXTREME)
def test_its_roots_are_one_between_each_two_poles(name, time_constant, capacity):
    b = np.sqrt(BODIES[name].sheathed(time_constant, capacity).rate)
    pi = np.pi * np.arange(1.0, b.size + 1)
    poles = {2: pi, 1: bessel_zeros(0, b.size), 0: pi - 0.5 * np.pi}[SHAPES[name]]
    assert np.all(b < poles) and np.all(b[1:] > poles[:-1])
    g = BODIES[name].surface_to_volume
    rest = capacity / g * (1.0 / time_constant - b**2)  # Bi - chi b^2
    # multiplied through, as Y has poles beside which the roots may stand
    sine, cosine = (j1(b), j0(b)) if SHAPES[name] == 1 else (np.sin(b), np.cos(b))
    left = sine - b * cosine if SHAPES[name] == 2 else b * sine
    right = rest * (sine if SHAPES[name] == 2 else cosine)
    assert np.abs(left - right).max() < 1e-9 * (np.abs(rest).max() + b.max())


@pytest.mark.parametrize("time_constant", [0.05, 0.4, 5.0, 1 / np.pi**2])
@pytest.mark.parametrize("name", BODIES)
def test_a_capacity_far_above_the_bodys_is_a_lag_in_series(name, time_constant):
    modes = BODIES[name].sheathed(time_constant, 1e6)
    time = times(name, time_constant, 1e6)
    series = in_series(BODIES[name].held(), time_constant)
    np.testing.assert_allclose(modes.step(time), series.step(time), atol=2e-6)


@pytest.mark.parametrize("biot", [0.05, 0.7, 4.0, 50.0])
@pytest.mark.parametrize("name", BODIES)
def test_no_capacity_is_a_resistance_alone(name, biot):
    capacity = 1e-7
    time_constant = capacity / (biot * BODIES[name].surface_to_volume)
    modes = BODIES[name].sheathed(time_constant, capacity)
    time = np.geomspace(5e-3, 10.0 + 10.0 / biot, 300)
    np.testing.assert_allclose(modes.step(time), BODIES[name].behind(biot).step(time), atol=2e-6)


@pytest.mark.parametrize(("ratio", "capacity"), [(0.2, 0.2), (0.6, 1.5), (1.0, 0.4), (0.3, 20.0)])
@pytest.mark.parametrize("name", BODIES)
def test_a_chain_of_finite_volumes_in_a_sheath_shows_the_same(name, ratio, capacity):
    bare_63 = BODIES[name].landmarks[0]
    cells = make_body(name, 1.0, sheath=(ratio, capacity))  # its time constant in units of the bare body's t63
    modes = BODIES[name].sheathed(ratio * bare_63, capacity).scaled(cells.rate_per_s)
    time = np.geomspace(0.03, 12.0, 400)
    np.testing.assert_allclose(modes.step(time), cells.step(time), atol=1e-4)


@pytest.mark.parametrize("name", BODIES)
def test_arrays_are_solved_each_by_itself(name):
    time_constant, capacity = np.array([[0.1, 0.4, 0.1], [2.0, 0.4, 3.0]]), np.array([[0.5], [7.0]])
    modes = BODIES[name].sheathed(time_constant, capacity)
    for i, j in np.ndindex(2, 3):
        one = BODIES[name].sheathed(time_constant[i, j], capacity[i, 0])
        np.testing.assert_allclose(modes.amplitude[i, j], one.amplitude, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(modes.rate[i, j], one.rate, rtol=1e-12)
