"""Sums of exponentials: compiled, as written down in NumPy, and term by term."""

import math

import numpy as np
import pytest

from shockrig.analysis.physics import exponentials
from shockrig.analysis.physics.exponentials import compiled, plain
from shockrig.analysis.physics.modes import film_mean, first_orders, in_series, mix

built = pytest.mark.skipif(exponentials._sums is None, reason="the kernel was not built")


def a_response(seed, lead):
    """Modes of a film behind a lag and beside two: rates that ascend in pieces, another set in each row."""
    rng = np.random.default_rng(seed)
    film = film_mean().scaled(10.0 ** rng.uniform(-3.0, 0.0, lead))
    behind = in_series(film, 10.0 ** rng.uniform(-1.0, 2.0, lead))
    return mix(behind, first_orders(10.0 ** rng.uniform(-1.0, 2.0, (*lead, 2))), rng.uniform(0.0, 0.5, lead))


def times(seed, lead, count=45):
    """Times since a transfer, infinite before it, in no particular order."""
    rng = np.random.default_rng(seed)
    return np.where(rng.random((*lead, count)) < 0.3, np.inf, 10.0 ** rng.uniform(-4.0, 3.0, (*lead, count)))


@built
@pytest.mark.parametrize("lead", [(), (1,), (5,), (3, 4)])
def test_the_compiled_sums_are_those_of_single_terms(lead):
    modes, at = a_response(1, lead), times(2, lead)
    total = np.empty(at.shape)
    compiled(at, modes.rate, modes.amplitude, total)
    rows = zip(*(np.reshape(x, (-1, x.shape[-1])) for x in (at, modes.rate, modes.amplitude, total)), strict=True)
    for t, rate, amplitude, found in rows:
        for j in range(t.size):
            terms = [a * math.exp(-r * t[j]) for a, r in zip(amplitude, rate, strict=True)]
            assert found[j] == pytest.approx(math.fsum(terms), abs=1e-8)


@built
def test_the_exponential_is_right_to_the_last_places():
    at = np.concatenate([np.linspace(0.0, 20.0, 20001), 10.0 ** np.linspace(-18.0, 0.0, 1001)])
    total = np.empty(at.shape)
    compiled(at, np.ones(1), np.ones(1), total)
    exact = np.array([math.exp(-t) for t in at])
    assert np.abs(total / exact - 1.0).max() < 3 * np.finfo(float).eps


@built
@pytest.mark.parametrize("samples", [1, 24])
def test_without_a_compiler_a_response_is_the_same(samples, monkeypatch):
    modes, at = a_response(3, (3, 4)), times(4, (4,), 60)
    at[np.isinf(at)] = -1.0
    one = modes.step(at, samples=samples, period_s=0.1)
    monkeypatch.setattr(exponentials, "_sums", None)
    np.testing.assert_allclose(modes.step(at, samples=samples, period_s=0.1), one, atol=1e-8)


@built
def test_a_row_does_not_depend_on_what_stands_beside_it():
    modes, at = a_response(5, (6,)), times(6, (6,))
    total, alone = np.empty(at.shape), np.empty(at.shape)
    compiled(at, modes.rate, modes.amplitude, total)
    for i in range(6):
        compiled(at[i], modes.rate[i], modes.amplitude[i], alone[i])
    np.testing.assert_array_equal(total, alone)


@built
@pytest.mark.parametrize("which", ["rate", "amplitude"])
@pytest.mark.parametrize("way", [compiled, plain])
def test_what_is_no_number_stays_none(which, way):
    given = {"rate": np.array([0.1, 2.0]), "amplitude": np.array([-0.7, -0.3])}
    given[which][1] = np.nan
    total = np.empty(3)
    way(np.array([0.0, 0.5, np.inf]), given["rate"], given["amplitude"], total)
    assert np.isnan(total[:2]).all()


@built
def test_arrays_that_do_not_fit_are_refused():
    sums, three, places = exponentials._sums, np.ones(3), np.zeros(3, dtype=np.int64)
    for changed in (
        (4, 3, places, three, three, three, 20.0, np.empty(4)),  # fewer times than are asked for
        (3, 4, places, three, three, three, 20.0, np.empty(3)),  # fewer modes
        (3, 3, places + 1, three, three, three, 20.0, np.empty(3)),  # a row that ends beyond
        (3, 3, places - 1, three, three, three, 20.0, np.empty(3)),
        (3, 3, places, three, three, three, 20.0, np.empty(2)),
        (3, 3, places, three.astype(np.float32), three, three, 20.0, np.empty(3)),
        (3, 3, places.astype(np.int32), three, three, three, 20.0, np.empty(3)),
        (-1, 3, places, three, three, three, 20.0, np.empty(0)),
    ):
        with pytest.raises(ValueError, match="do not fit"):
            sums.add_up(*changed)
