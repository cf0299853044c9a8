"""Corrected flights against the truth that flew: error, stated uncertainty, gaps, lies in the log, and no harm."""

import dataclasses
import time

import numpy as np
import pytest

from shockrig.analysis.flight.air_prior import AIR, OU_VARIANCES, Passing, Prior, innovation, spectra, transition
from shockrig.analysis.flight.correct import METHODS, correct
from shockrig.analysis.flight.inverse import RefusedError, low_pass, paper_layers, sampled, suggest_cutoff_hz
from shockrig.analysis.flight.judging import power_spectrum, slope, structure_function
from shockrig.analysis.flight.response import LagResponse, bead_response, film_response, hold
from shockrig.analysis.flight.screen import clock, screen
from shockrig.analysis.flight.simulated.scenes import scores, to_flight, try_scene
from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import SCENES, convective, frontal, inversion
from shockrig.analysis.flight.smoother import smooth
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.analysis.physics.schemes.state_space import is_minimum_phase, zeros
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight
from shockrig.files.profile import DiffusivityRow, Profile, StatedEffect, Uncertain
from shockrig.files.ranges import RANGES

PROFILE = typical_profile()
EXACT = Profile(
    dataclasses.replace(
        PROFILE.temperature, thermal_diffusivity_m2_s=Uncertain(PROFILE.temperature.thermal_diffusivity_m2_s.value)
    ),
    PROFILE.humidity,
)


def rms(error):
    return float(np.sqrt(np.nanmean(np.square(error))))


@pytest.fixture(scope="module")
def trials():
    return {scene: try_scene(scene, PROFILE, [11]) for scene in SCENES}


# -- the smoother's mathematics ------------------------------------------------------------


def test_air_straight_between_samples_moves_a_lag_as_calculus_says():
    rate, step = 0.7, 0.3
    old, new, decay = hold(np.array(rate), np.array(step))
    fine = np.linspace(0, step, 20001)
    air = 2.0 + 3.0 * fine / step
    kernel = rate * np.exp(-rate * (step - fine))
    assert decay * 1.5 + old * 2.0 + new * 5.0 == pytest.approx(
        1.5 * np.exp(-rate * step) + np.trapezoid(kernel * air, fine)
    )


@pytest.mark.parametrize("course_is_smooth", [False, True])
def test_smoother_is_the_conditional_mean_of_the_joint_gaussian(course_is_smooth):
    """Against dense linear algebra: the same model written as one covariance, conditioned on the readings at once."""
    rng = np.random.default_rng(2)
    n, step = 25, np.full(25, 0.1)
    step[10] = 0.35
    response = film_response(PROFILE.humidity, np.linspace(5, 30, n), Stream(np.full(n, 5.0)))
    prior = Prior(*(np.full((1, n), v) for v in (0.4, 0.3, 0.1)), smooth=course_is_smooth)
    noise = np.full(n, 0.01)
    noise[[4, 5, 18]] = np.inf
    reading = rng.standard_normal(n)
    modes = response.rate.shape[1]
    window = dataclasses.replace(response, weight=response.weight[None], rate=response.rate[None])
    lags, spread = np.zeros((1, modes)), np.array([1.5])
    found = smooth(step[None], reading[None], noise[None], window, lags, prior, spread)

    air = AIR.size
    size = air + modes
    start = np.zeros((size, size))
    start[0, 0] = start[1, 1] = 1.5**2
    start[2, 2] = 1.5**2 * course_is_smooth
    start[3:air, 3:air] = np.diag(0.4**2 * OU_VARIANCES)
    start[air:, air:] = 1.5**2 * np.eye(modes)
    mean = np.zeros(size)
    mean[0] = reading[0]
    # x_k = F_k x_0 + sum of noises: build the covariance of all states by stacking
    covariance = np.zeros((n * size, n * size))
    means = np.zeros(n * size)
    covariance[:size, :size], means[:size] = start, mean
    for k in range(1, n):
        a = transition(np.array(step[k]))
        qa = innovation(np.array(step[k]), Prior(*np.array([0.4, 0.3, 0.1]), smooth=course_is_smooth))
        old, new, decay = hold(response.rate[k], np.array(step[k]))
        f = np.zeros((size, size))
        f[:air, :air], f[air:, :air] = a, np.outer(old, AIR) + np.outer(new, AIR @ a)
        f[air:, air:] = np.diag(decay)
        g = np.vstack([np.eye(air), np.outer(new, AIR)])
        before, now = slice(0, k * size), slice(k * size, (k + 1) * size)
        last = slice((k - 1) * size, k * size)
        covariance[now, before] = f @ covariance[last, before]
        covariance[before, now] = covariance[now, before].T
        covariance[now, now] = f @ covariance[last, last] @ f.T + g @ qa @ g.T
        means[now] = f @ means[last]
    pick = np.zeros((n, n * size))
    observe = np.zeros((n, n * size))
    for k in range(n):
        pick[k, k * size : k * size + air] = AIR
        observe[k, k * size + air : (k + 1) * size] = response.weight[k]
    seen = np.isfinite(noise)
    c = observe[seen]
    s = c @ covariance @ c.T + np.diag(noise[seen])
    gain = pick @ covariance @ c.T @ np.linalg.inv(s)
    np.testing.assert_allclose(found.air[0], pick @ means + gain @ (reading[seen] - c @ means), atol=1e-8)
    np.testing.assert_allclose(
        found.variance[0], np.diag(pick @ covariance @ pick.T - gain @ c @ covariance @ pick.T), atol=1e-8
    )


def test_what_passes_may_carry_vapour_that_lags():
    """Coupling against the filter's equations: `c` times the passing part is air too, so with a sensor that has no lag
    to speak of and no noise, the reading is air + (1 + c) passing and nothing is left open."""
    rng = np.random.default_rng(5)
    n = 40
    reading = np.cumsum(rng.standard_normal(n))[None]
    quick = LagResponse(np.ones((1, n, 1)), np.full((1, n, 1), 1e4), np.zeros((1, n)))
    prior = Prior(*(np.full((1, n), v) for v in (0.3, 0.2, 1e-4)))

    def found(coupling):
        passing = Passing(np.full((1, n), 0.5), 2.0, coupling)
        return smooth(
            np.full((1, n), 0.1), reading, np.full((1, n), 1e-8), quick, reading[:, :1], prior, np.array([3.0]), passing
        )

    for coupling in (0.0, 0.8, -0.5):
        result = found(coupling)
        np.testing.assert_allclose(result.air[0, 1:], reading[0, 1:], atol=5e-3)
        assert np.sqrt(result.variance[0, 1:]).max() < 5e-3
    slow = LagResponse(np.ones((1, n, 1)), np.full((1, n, 1), 0.5), np.zeros((1, n)))
    spread = []
    for coupling in (-0.8, 0.0, 0.8):
        passing = Passing(np.full((1, n), 0.5), 2.0, coupling)
        noise = np.full((1, n), 4.0)
        result = smooth(np.full((1, n), 0.1), reading, noise, slow, reading[:, :1], prior, np.array([3.0]), passing)
        spread.append(result.variance[0, n // 2])
    assert spread[0] < spread[1] < spread[2]  # what goes with it adds, what goes against it takes away


def test_prior_of_turbulence_falls_as_five_thirds():
    frequency = np.geomspace(0.02, 2.0, 60)
    assert slope(frequency, spectra(frequency, 0.01)[0], 0.02, 2.0) == pytest.approx(-5 / 3, abs=0.12)


@pytest.mark.parametrize(("course_is_smooth", "power"), [(False, 4), (True, 6)])
def test_trend_is_white_noise_integrated(course_is_smooth, power):
    """Its spectrum is 1 / omega^4 or omega^6 folded by the sampling; its steps are those of the integrals."""
    frequency, period = np.array([0.05, 0.4, 1.1, 2.4]), 0.2
    folds = frequency[:, None] + np.arange(-400, 401) / period
    folded = 2 * np.sum((2 * np.pi * folds) ** -float(power), axis=1)
    np.testing.assert_allclose(spectra(frequency, period, course_is_smooth)[1], folded, rtol=1e-6)
    # A step's noise is the white noise's, each instant of it carried to the end by the transition.
    last = power // 2 - 1
    rest = np.linspace(0.0, period, 20001)
    carried = transition(rest)[:, :3, last]
    expected = np.trapezoid(carried[:, :, None] * carried[:, None, :], rest, axis=0)
    prior = Prior(np.array(0.0), np.array(1.0), np.array(1.0), smooth=course_is_smooth)
    np.testing.assert_allclose(innovation(np.array(period), prior)[:3, :3], expected, rtol=1e-6, atol=1e-15)


# -- the figures' findings ------------------------------------------------------------


@pytest.mark.parametrize("scene", SCENES)
def test_every_method_lowers_the_error_and_the_smoother_most(trials, scene):
    for trial in trials[scene]:
        table = {(s.channel, s.method): s for s in scores(trial)}
        for channel in ("temperature", "humidity"):
            smoother = table[channel, "smoother"]
            assert smoother.rmse < 0.65 * smoother.raw
            for method in ("inverse", "paper"):
                assert smoother.rmse <= table[channel, method].rmse < table[channel, method].raw


def drawn(seed):
    """A sensor as uncertain as the profile says: its diffusivities lie about the stated ones."""
    rng = np.random.default_rng([seed, 7])

    def moved(value, sigma):
        return value + sigma * rng.standard_normal()

    alpha = PROFILE.temperature.thermal_diffusivity_m2_s
    rows = tuple(
        dataclasses.replace(r, diffusivity_m2_s=moved(r.diffusivity_m2_s, r.standard_uncertainty))
        for r in PROFILE.humidity.diffusivity_table
    )
    bead = dataclasses.replace(
        PROFILE.temperature, thermal_diffusivity_m2_s=Uncertain(moved(alpha.value, alpha.standard_uncertainty))
    )
    return Profile(bead, dataclasses.replace(PROFILE.humidity, diffusivity_table=rows))


@pytest.mark.parametrize("scene", SCENES)
def test_stated_uncertainty_holds_the_truth(scene):
    table = [
        s for seed in range(3) for t in try_scene(scene, PROFILE, [seed], flown_with=drawn(seed)) for s in scores(t)
    ]
    for channel in ("temperature", "humidity"):
        held = [s.coverage for s in table if (s.channel, s.method) == (channel, "smoother")]
        # air that is perfectly straight between corners is calmer than any prior dares to say: there it covers more
        assert 0.92 <= np.mean(held) <= (0.98 if scene == "convective" else 0.999), held
        own = [s for s in table if (s.channel, s.method) == (channel, "smoother")]
        stated, error = (rms([getattr(s, name) for s in own]) for name in ("stated", "rmse"))
        assert stated < 1.6 * error


def test_lag_steepens_and_correction_restores_the_slopes(trials):
    trial = trials["convective"][0]
    truth, raw = trial.flown.truth["temperature_c"].to_numpy(), trial.flown.log["temperature_c"].to_numpy()
    for method in METHODS:
        corrected = trial.corrected[method].temperature_c
        expected = slope(*power_spectrum(truth, 0.1, 100.0), 0.1, 1.0)
        assert slope(*power_spectrum(raw, 0.1, 100.0), 0.1, 1.0) < expected - 0.2
        assert slope(*power_spectrum(corrected, 0.1, 100.0), 0.1, 1.0) == pytest.approx(expected, abs=0.17)
        lagged, ours, right = (slope(*structure_function(v, 0.1), 1.0, 20.0) for v in (raw, corrected, truth))
        assert abs(ours - right) < 0.7 * abs(lagged - right)


def test_slow_shares_and_biot_numbers_widen_the_uncertainty_by_their_part():
    part = PROFILE.humidity
    n = np.array([20.0]), Stream(np.array([5.0]))

    def with_effect(name, **values):
        effect = StatedEffect(name, {k: Uncertain(*v) for k, v in values.items()})
        return film_response(dataclasses.replace(part, effects=(effect,)), *n)

    # L^2 / D (1/3 + 1 / Bi): at Bi = 3 half of the lag is the layer's
    layer = with_effect("vapour_boundary_layer", biot_at_5_m_s=(3.0, 0.3))
    plain = film_response(part, *n).relative_uncertainty[0]
    assert layer.relative_uncertainty[0] == pytest.approx(np.hypot(plain, 0.05), rel=0.02)
    slow = with_effect("slow_relaxation", fraction=(0.1, 0.003), time_constant_s=(20.0, 0.8))
    assert slow.slow_uncertainty == pytest.approx([0.005])
    assert film_response(part, *n).slow_uncertainty.size == 0


def test_d_is_followed_along_the_flight_and_not_its_mean():
    cold = [DiffusivityRow(t, 6e-12 * np.exp((t - 10) / 12), 1e-14) for t in (-10.0, 0.0, 10.0, 20.0, 30.0)]
    profile = Profile(PROFILE.temperature, dataclasses.replace(PROFILE.humidity, diffusivity_table=tuple(cold)))
    weather = inversion(strength_k=15.0, surface_temperature_c=5.0)
    flown = fly(weather, profile, 1)
    mean_d = profile.humidity.diffusivity_m2_s(float(weather.temperature_c.mean()))[0]
    flat = tuple(dataclasses.replace(r, diffusivity_m2_s=mean_d) for r in cold)
    constant = Profile(PROFILE.temperature, dataclasses.replace(PROFILE.humidity, diffusivity_table=flat))
    truth = flown.truth["humidity_percent"].to_numpy()
    followed, fixed = (rms(correct(to_flight(flown.log), p).humidity_percent - truth) for p in (profile, constant))
    assert followed < 0.5 * fixed


def test_extended_profiles_are_undone():
    bead = (
        StatedEffect("convective_film", {"biot_at_5_m_s": Uncertain(0.3)}),
        StatedEffect("stem_conduction", {"fraction": Uncertain(0.05), "time_constant_s": Uncertain(8.0)}),
        StatedEffect("self_heating", {"rise_k_at_5_m_s": Uncertain(0.3)}),
        StatedEffect("calibration_error", {"gain": Uncertain(0.0), "offset": Uncertain(-0.2)}),
        StatedEffect("finite_transfer", {"duration_s": Uncertain(0.5)}),
    )
    film = (
        StatedEffect("slow_relaxation", {"fraction": Uncertain(0.1), "time_constant_s": Uncertain(20.0)}),
        StatedEffect("vapour_boundary_layer", {"biot_at_5_m_s": Uncertain(5.0)}),
        StatedEffect("dead_time", {"delay_s": Uncertain(0.25)}),
        StatedEffect("die_thermal_lag"),
    )
    extended = Profile(
        dataclasses.replace(EXACT.temperature, effects=bead), dataclasses.replace(PROFILE.humidity, effects=film)
    )
    flown = fly(frontal(airspeed_m_s=20.0, lead_m=1500.0), extended, 3)
    truth = flown.truth
    flight = to_flight(flown.log)
    done, plain = correct(flight, extended), correct(flight, PROFILE)
    assert (
        rms(done.temperature_c - truth["temperature_c"])
        < 0.02
        < 0.1
        < rms(plain.temperature_c - truth["temperature_c"])
    )
    assert rms(done.humidity_percent - truth["humidity_percent"]) < 0.4
    assert rms(plain.humidity_percent - truth["humidity_percent"]) > 2.0
    assert any("finite_transfer" in note and "bench" in note for note in done.notes)


# -- the inverses ------------------------------------------------------------


def test_film_modes_are_minimum_phase_and_the_core_is_not():
    film = sampled(film_response(PROFILE.humidity, np.array([20.0]), Stream(np.array([5.0]))), 0.1, 0)
    bead = sampled(bead_response(PROFILE.temperature, Stream(np.array([5.0]))), 0.1, 0)
    assert is_minimum_phase(film)
    assert np.abs(zeros(bead)).max() > 1


def test_paper_refuses_with_the_reason_where_no_layer_count_is_stable():
    fast = typical_profile(bead_t98_s=0.2)
    with pytest.raises(RefusedError, match=r"temperature.*grows.*use the smoother"):
        paper_layers("temperature", bead_response(fast.temperature, Stream(np.array([5.0]))), 0.1)
    flown = fly(frontal(lead_m=1000.0), fast, 1)
    with pytest.raises(RefusedError):
        correct(to_flight(flown.log), fast, "paper")
    raw, truth = flown.log["temperature_c"], flown.truth["temperature_c"]
    assert rms(correct(to_flight(flown.log), fast).temperature_c - truth) < rms(raw - truth)


def test_low_pass_has_no_phase_and_keeps_straight_lines():
    line = np.linspace(3.0, 9.0, 500)
    np.testing.assert_allclose(low_pass(line, 0.1, 0.5), line, atol=1e-9)
    t = np.arange(2000) * 0.1
    slow, fast = np.sin(2 * np.pi * 0.1 * t), np.sin(2 * np.pi * 2.0 * t)
    middle = slice(200, -200)
    np.testing.assert_allclose(low_pass(slow + fast, 0.1, 0.6)[middle], slow[middle], atol=0.01)


def test_cut_off_is_where_the_spectrum_meets_the_noise_floor():
    rng = np.random.default_rng(0)
    t = np.arange(20000) * 0.1
    signal = sum(np.sin(2 * np.pi * f * t + 6 * rng.random()) for f in np.linspace(0.01, 0.8, 200))
    assert suggest_cutoff_hz(signal + 0.1 * rng.standard_normal(t.size), 0.1, 0.1) == pytest.approx(0.8, rel=0.15)


# -- logs that lie ------------------------------------------------------------


def test_gaps_repeats_and_absurd_samples_are_flagged_and_bridged(trials):
    flown = trials["frontal"][0].flown
    log, truth = flown.log.copy(), flown.truth
    log.loc[300:315, "temperature_c"] = np.nan
    log.loc[500, "humidity_percent"] = 6526.9
    log.loc[700, "temperature_c"] = 20.0
    log.loc[800:803, "humidity_percent"] = log.loc[799, "humidity_percent"]
    log.loc[1200:1400, "humidity_percent"] = np.nan
    keep = np.ones(len(log), dtype=bool)
    keep[900:930] = False
    result = correct(to_flight(log[keep]), PROFILE)
    flags = {name: dict(zip(log.index[keep], mask, strict=True)) for name, mask in result.flags.items()}
    assert all(flags["gap"][row] for row in range(300, 316))
    assert flags["implausible"][500] and flags["implausible"][700]
    assert sum(flags["implausible"].values()) <= 4
    assert all(flags["repeated"][row] for row in range(800, 804))
    where = {row: i for i, row in enumerate(log.index[keep])}
    # values are given across short gaps and not in the middle of a long one
    assert abs(result.temperature_c[where[307]] - truth["temperature_c"][307]) < 0.05
    assert np.isnan(result.humidity_percent[where[1300]])
    assert np.isfinite(result.humidity_percent[where[1220]])
    assert np.isnan(result.humidity_percent).sum() < 140
    assert rms(result.temperature_c - truth["temperature_c"][keep]) < 0.02
    assert rms(result.humidity_percent - truth["humidity_percent"][keep]) < 0.3
    # a bridge is less certain than its banks
    assert result.temperature_uncertainty_k[where[307]] > 1.05 * result.temperature_uncertainty_k[where[250]]


def test_clocks_that_jump_are_sorted_out():
    time_s = np.arange(50) * 0.1
    time_s[10], time_s[20], time_s[30] = 1e9, 0.05, np.nan
    found = clock(time_s, 120.0)
    assert list(np.flatnonzero(~found.good)) == [10, 20, 30]
    assert found.steps == ()


def test_a_clock_that_steps_and_goes_on_from_there_parts_the_log():
    time_s = np.arange(60) * 0.1
    time_s[20:] -= 1.0
    time_s[40:] += 30.0
    found = clock(time_s, 120.0)
    assert found.good.all()
    assert [step.row for step in found.steps] == [20, 40]
    assert [step.by_s for step in found.steps] == pytest.approx([-0.9, 30.1])
    steps = np.diff(found.time_s)
    assert steps[[19, 39]] == pytest.approx(120.0)
    assert np.delete(steps, [19, 39]) == pytest.approx(0.1)


@pytest.mark.parametrize("by", [-20.0, 30.0])
def test_a_step_of_the_clock_is_no_jump_of_the_air(trials, by):
    flown = trials["inversion"][0].flown
    log, truth = flown.log.copy(), flown.truth
    log.loc[600:, "time_s"] += by
    result = correct(to_flight(log), PROFILE)
    for column in ("temperature_c", "humidity_percent"):
        raw, right = log[column].to_numpy(), truth[column].to_numpy()
        assert rms(getattr(result, column) - right) < 0.4 * rms(raw - right)
        assert np.abs(getattr(result, column) - right)[560:640].max() < 1.5 * max(
            np.abs(raw - right)[560:640].max(), 0.1
        )
    assert any("clock steps" in note for note in result.notes)


def test_equal_neighbours_are_no_repeats_where_the_resolution_is_coarse():
    rng = np.random.default_rng(1)
    time_s = np.arange(2000) * 0.1
    coarse = np.round(20 + 0.3 * np.sin(time_s / 5) + 0.02 * rng.standard_normal(2000), 1)
    assert not screen(time_s, coarse, RANGES["temperature_c"], 0.02).repeated.any()


def test_uneven_clock_and_one_hertz_are_corrected_as_well():
    flown = fly(inversion(), PROFILE, 4)
    rng = np.random.default_rng(0)
    rows = np.sort(rng.choice(len(flown.log), 700, replace=False))
    result = correct(to_flight(flown.log.iloc[rows]), PROFILE)
    truth = flown.truth["humidity_percent"].to_numpy()[rows]
    assert rms(result.humidity_percent - truth) < 0.1 * rms(flown.log["humidity_percent"].to_numpy()[rows] - truth)
    slow = correct(to_flight(flown.log.iloc[::10]), PROFILE)
    truth = flown.truth["humidity_percent"].to_numpy()[::10]
    assert rms(slow.humidity_percent - truth) < 0.3 * rms(flown.log["humidity_percent"].to_numpy()[::10] - truth)


# -- do no harm ------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_calm_air_is_averaged_or_left_alone(method):
    flown = fly(convective(np.random.default_rng(1), temperature_std_k=0.002, humidity_std_percent=0.01), PROFILE, 1)
    result = correct(to_flight(flown.log), PROFILE, method)
    most = 0.6 if method == "smoother" else 1.02  # an inverse amplifies the noise, and gives the reading instead
    for column in ("temperature_c", "humidity_percent"):
        raw, truth = flown.log[column].to_numpy(), flown.truth[column].to_numpy()
        assert rms(getattr(result, column) - truth) <= most * rms(raw - truth)
    if method != "smoother":
        assert result.flags["not_corrected"].all()
        assert any("not corrected" in note for note in result.notes)


@pytest.mark.parametrize("method", ["smoother", "inverse", "causal"])
def test_a_corrected_temperature_is_one_that_air_can_have(method):
    """Readings that are no sensor's of such a lag had been undone to -1600 degC, 2100 K unsure."""
    alpha = PROFILE.temperature.thermal_diffusivity_m2_s.value
    slow = dataclasses.replace(
        PROFILE, temperature=dataclasses.replace(PROFILE.temperature, thermal_diffusivity_m2_s=Uncertain(alpha / 50.0))
    )
    time_s, unknown = np.arange(400.0), np.full(400, np.nan)
    reading = np.random.default_rng(0).uniform(-20.0, 50.0, 400)
    done = correct(Flight(time_s, reading, *4 * [unknown]), slow, method)
    possible = RANGES["temperature_c"]
    known = np.isfinite(done.temperature_c)
    assert known.mean() > 0.4
    assert done.temperature_c[known].min() >= possible.low and done.temperature_c[known].max() <= possible.high
    assert np.nanmax(done.temperature_uncertainty_k) <= possible.high - possible.low
    assert len(done.notes) < 12  # each move that no air makes was a sentence of its own


def test_out_of_the_table_the_reading_is_given_and_flagged():
    narrow = Profile(
        PROFILE.temperature,
        dataclasses.replace(PROFILE.humidity, diffusivity_table=PROFILE.humidity.diffusivity_table[:4]),
    )
    flown = fly(frontal(temperature_c=28.0, temperature_change_k=-12.0), PROFILE, 2)
    result = correct(to_flight(flown.log), narrow)
    outside = result.flags["outside_profile"]
    warm = flown.truth["temperature_c"].to_numpy() > 21.1
    assert np.mean(outside == warm) > 0.995
    raw = flown.log["humidity_percent"].to_numpy()
    assert np.array_equal(result.humidity_percent[outside], raw[outside])
    truth = flown.truth["humidity_percent"].to_numpy()
    assert rms(result.humidity_percent - truth) <= 1.02 * rms(raw - truth)
    assert not result.flags["not_corrected"][~outside].any()


@pytest.mark.parametrize("part", ["temperature", "humidity"])
def test_a_profile_with_one_part_corrects_that_part(part):
    flown = fly(inversion(), PROFILE, 1)
    half = Profile(**{part: getattr(PROFILE, part)})
    result = correct(to_flight(flown.log), half)
    column, other = ("temperature_c", "humidity_percent")[:: 1 if part == "temperature" else -1]
    truth = flown.truth[column].to_numpy()
    assert rms(getattr(result, column) - truth) < 0.3 * rms(flown.log[column].to_numpy() - truth)
    np.testing.assert_array_equal(getattr(result, other), flown.log[other])


def test_a_flight_without_temperature_has_its_humidity_given_as_it_came():
    flown = fly(inversion(), PROFILE, 1)
    result = correct(to_flight(flown.log.drop(columns="temperature_c")), PROFILE)
    np.testing.assert_array_equal(result.humidity_percent, flown.log["humidity_percent"])
    assert result.flags["not_corrected"].all()
    assert result.notes == ("humidity: given as it came: no temperature of the air in the log",)


def test_hopeless_input_is_refused_or_returned_empty():
    flown = fly(inversion(), PROFILE, 1)
    with pytest.raises(InputError, match="method"):
        correct(to_flight(flown.log), PROFILE, "magic")
    frozen = flown.log.assign(time_s=5.0)
    with pytest.raises(InputError, match="time_s"):
        correct(to_flight(frozen), PROFILE)
    few = correct(to_flight(flown.log.iloc[:5]), PROFILE)
    assert few.flags["not_corrected"].all()


def test_cost_is_small_and_linear():
    flown = fly(convective(np.random.default_rng(0), duration_s=900.0), PROFILE, 1)
    flight = to_flight(flown.log)
    correct(flight, PROFILE)
    start = time.process_time()
    correct(flight, PROFILE)
    whole = time.process_time() - start
    assert whole < 2.0  # about 0.3 s on an idle core
