"""The smoother's recursions: compiled as written down, and from a flight's first row to its last."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from shockrig.analysis.flight import smoother
from shockrig.analysis.flight.air_prior import Passing, Prior
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.response import LagResponse
from shockrig.analysis.flight.simulated.scenes import to_flight
from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import convective
from shockrig.analysis.flight.smooth_channel import estimate
from shockrig.analysis.flight.smoother import Jumps
from shockrig.analysis.flight.sweep import inflation
from shockrig.files.flight import Flight
from shockrig.files.profile import Profile, TemperatureProfile, Uncertain


@pytest.mark.skipif(smoother._kernel is None, reason="the kernel was not built")
@pytest.mark.parametrize(
    ("modes", "cap", "inside", "passing", "smooth"),
    [(4, (), 0, None, False), (6, (), 0, -1.3, False), (6, (0.7, 0.3), 3, 0.5, True), (5, (1.0,), 3, None, True)],
)
def test_the_compiled_recursion_is_the_one_written_down(modes, cap, inside, passing, smooth):
    rng = np.random.default_rng(1)
    nodes = (3, 120)
    rate = np.sort(rng.uniform(0.05, 3.0, (*nodes, modes)), axis=-1)
    weight = rng.normal(size=rate.shape)
    rate[..., : len(cap)], weight[..., : len(cap)] = (5.0, 9.0)[: len(cap)], 0.0
    response = LagResponse(weight / weight.sum(axis=-1, keepdims=True), rate, np.zeros(nodes), cap=cap, inside=inside)
    step, noise = np.full(nodes, 0.1), np.full(nodes, 0.02**2)
    step[:, 50], noise[:, 20:25] = 1.7, np.inf
    reading = np.cumsum(0.1 * rng.normal(size=nodes), axis=1)
    strengths = (size * rng.uniform(0.5, 2.0, nodes) for size in (0.3, 0.1, 0.02))
    through = None if passing is None else Passing(rng.uniform(0.02, 0.1, nodes), 4.0, passing)
    jumps = Jumps(np.zeros((*nodes, 2)), rng.uniform(0.0, 1.0, nodes))
    jumps.variance[:, 70, 0], jumps.variance[1, 90, 1] = 4.0, 2.0
    size = 6 + modes + 2 * (through is not None)
    mean, p = rng.normal(size=(3, size)), np.eye(size) * np.ones((3, 1, 1))
    given = (step, reading, noise, response, Prior(*strengths, smooth=smooth), through, jumps, mean, p)
    written, built = smoother.plain(*given), smoother.compiled(*given)
    for name in smoother.Smoothed.__annotations__:
        right = getattr(written, name)
        np.testing.assert_allclose(getattr(built, name), right, atol=1e-7 * np.nanmax(np.abs(right)))


@pytest.mark.skipif(smoother._kernel is None, reason="the kernel was not built")
def test_without_a_compiler_a_flight_is_corrected_alike(monkeypatch):
    """The package installs without its kernel, and the recursions written down give the same flight."""
    build = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert all(extension["optional"] for extension in build["ext-modules"])
    profile = typical_profile()
    log = to_flight(fly(convective(np.random.default_rng(3), duration_s=20.0), profile, 3).log)
    built = correct(log, profile)
    monkeypatch.setattr(smoother, "_kernel", None)
    assert np.isfinite(built.temperature_c).all() and np.isfinite(built.humidity_percent).all()
    written = correct(log, profile)
    for name in ("temperature_c", "temperature_uncertainty_k", "humidity_percent", "humidity_uncertainty_percent"):
        np.testing.assert_allclose(getattr(written, name), getattr(built, name), rtol=1e-4)


def test_a_film_slower_than_minutes_is_followed_at_ten_readings_a_second():
    """Twenty minutes through layers with a t63 of 160 s: its memory is longer than any window that one would cut."""
    rng = np.random.default_rng(4)
    time_s = 0.1 * np.arange(12_000)
    levels = rng.uniform(30.0, 80.0, 7)
    air = np.interp(time_s, np.arange(1, 13) * 92.0 + np.tile([0.0, -80.0], 6), np.repeat(levels, 2)[1:-1])
    eigenvalues = (np.arange(6) + 0.5) * np.pi
    rate, weight = eigenvalues**2 * 0.32 / 160.0, 2.0 / eigenvalues**2
    decay, weight = np.exp(-0.1 * rate), weight / weight.sum()
    lags = [lfilter([1 - d], [1.0, -d], air, zi=[d * air[0]])[0] for d in decay]
    reading = weight @ lags + 0.06 * rng.standard_normal(air.size)
    one = np.ones(air.size)
    response = LagResponse(one[:, None] * weight, one[:, None] * rate, 0 * one)
    found = estimate(time_s, reading, one > 0, response, 0.06**2 * one)
    off = found.air - air
    assert np.mean(np.abs(off) < 1.96 * np.sqrt(found.variance)) > 0.9
    assert np.sqrt(np.mean(off**2)) < 0.5


def test_where_readings_surprise_for_seconds_only_their_uncertainty_grows_there():
    """Ten of 2,000 readings, 8 sigmas off: counted over 250 nodes they said little, and over the flight nothing."""
    surprise = np.random.default_rng(0).standard_normal(2000)
    assert np.mean(inflation(surprise) > 1.0) < 0.05
    surprise[1005:1015] = 8.0
    wider = inflation(surprise)
    assert wider[1010] > 20.0 and np.all(wider[:750] == inflation(surprise[:750])) and wider[1200] < 4.5


def test_a_layer_that_varies_more_than_the_rest_of_a_flight_is_corrected_as_well():
    """A dive through a thermocline and on through calm water, in rows 5 and 10 s apart of a sensor that lags by 5 s."""
    step_s, lag_s = 0.5, 5.0
    time_s, rng = np.arange(0.0, 6000.0, step_s), np.random.default_rng(2)
    water = 25.0 - 12.0 * np.clip((time_s - 100.0) / 500.0, 0.0, 1.0) - 2e-3 * time_s
    for at_s in rng.uniform(100.0, 600.0, 6):
        water = water + rng.choice([-0.6, 0.6]) * np.tanh((time_s - at_s) / 3.0)
    keep = np.exp(-step_s / lag_s)
    shown = lfilter([1.0 - keep], [1.0, -keep], water, zi=[keep * water[0]])[0]
    sensor = TemperatureProfile(Uncertain(4e-4**2 / lag_s, 4e-5**2 / lag_s), noise_k=0.003)
    profile = Profile(sensor, sensors={"imet": {"body": "lumped"}})
    for every in (10, 20):
        rows_s, air = time_s[::every], water[::every]
        read, unknown = shown[::every] + 0.003 * rng.standard_normal(rows_s.size), np.full(rows_s.size, np.nan)
        done = correct(Flight(rows_s, read, unknown, unknown, unknown, unknown), profile)
        layer = rows_s < 620.0
        off, before = (np.std((values - air)[layer]) for values in (done.temperature_c, read))
        assert off < 0.45 * before  # 0.61 where the calm water said what is usual
