"""Noise from the plateaus: known noises are found, and whitening makes their bins white."""

from dataclasses import replace

import numpy as np
import pytest

from shockrig.analysis.estimate.channel import rebin
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.noise import estimate_noise, holds_burst, plateau_pieces, whiteners
from shockrig.analysis.estimate.problem import make_problem
from shockrig.files.campaign import Campaign, Run, RunAir, Trace

PERIOD = 0.1


def noisy_channel(seed, white, correlated=0.0, memory_s=1.0, averaged=1, runs=24):
    """Runs at rest with AR(1) noise made by its recursion, then averaged as a logger would."""
    rng = np.random.default_rng(seed)
    phi = np.exp(-PERIOD / memory_s)
    made = []
    for k in range(runs):
        n = 800 + averaged
        slow = np.empty(n)
        slow[0] = rng.standard_normal()
        push = np.sqrt(1 - phi**2) * rng.standard_normal(n)
        for i in range(1, n):
            slow[i] = phi * slow[i - 1] + push[i]
        noise = white * rng.standard_normal(n) + correlated * slow
        noise = np.convolve(noise, np.ones(averaged) / averaged, mode="valid")[:800]
        time = 0.02 + PERIOD * np.arange(800)
        trace = Trace(time, {"temperature_c": 20.0 + 10.0 * (time > 30.0) + noise})
        made.append(Run(str(k), RunAir(20.0, 50.0), RunAir(30.0, 50.0), 5.0, 1000.0, 30.0, None, trace, None))
    return build_channel(Campaign("n", None, {}, 4e-4, 1e-5, tuple(made)), "temperature")


@pytest.mark.parametrize(
    ("white", "correlated", "memory_s"), [(0.02, 0.0, 1.0), (0.014, 0.014, 0.8), (0.01, 0.02, 2.0)]
)
def test_known_noise_is_found(white, correlated, memory_s):
    noise = estimate_noise(noisy_channel(3, white, correlated, memory_s))
    assert noise.averaged == 1
    assert noise.standard_deviation == pytest.approx(np.hypot(white, correlated), rel=0.06)
    found = noise.autocovariance(20)
    true = correlated**2 * np.exp(-PERIOD * np.arange(20) / memory_s)
    true[0] += white**2
    assert found == pytest.approx(true, abs=0.12 * true[0])


@pytest.mark.parametrize("seed", range(6))
def test_a_few_plateaus_of_white_noise_show_no_memory(seed):
    """By chance they do: it would pass for the slow end of a response, and has to pay for its two parameters."""
    assert estimate_noise(noisy_channel(seed, 0.02, runs=1)).correlated < 1e-3


def test_an_average_over_readings_is_found():
    assert estimate_noise(noisy_channel(4, 0.03, averaged=5)).averaged == 5


@pytest.mark.parametrize(("averaged", "white", "wandering"), [(5, 0.03, 0.0), (1, 0.001, 0.03)])
def test_an_air_that_wanders_is_no_average_where_nobody_recorded_it(averaged, white, wandering):
    """A lag makes the wandering smooth from reading to reading, as a mean of readings would."""
    channel = noisy_channel(7, white, averaged=averaged)
    random, slow, passed = np.random.default_rng(1), 0.0, 0.0
    samples = []
    for time, value in channel.samples:
        shown = []
        for push in random.normal(0.0, 1.0, time.size):
            slow += -0.02 * slow + 0.2 * push
            passed += 0.3 * (slow - passed)
            shown.append(passed)
        samples.append((time, value + wandering * np.array(shown)))
    shown = rebin(channel, tuple(samples), list(channel.bin_of), (), 1)
    unknown = replace(shown.conditions, airs_known=np.zeros(shown.runs, dtype=bool))
    assert estimate_noise(replace(shown, conditions=unknown), lengths=(5,)).averaged == averaged


def test_a_mean_is_as_long_as_it_is_where_two_readings_in_three_are_not_shown():
    """Of white noise averaged over six readings every third keeps half of its variance to the next, and none after."""
    channel = noisy_channel(4, 0.03, averaged=6)
    shown = tuple((time[::3], value[::3]) for time, value in channel.samples)
    thinned = rebin(channel, shown, [at[::3] for at in channel.bin_of], (), 3)
    assert (thinned.sampling_period_s, thinned.reading_period_s) == pytest.approx((0.3, 0.1))
    noise = estimate_noise(thinned)
    assert noise.averaged == 6 and noise.readings_per_sample == 3
    found = noise.autocovariance(4) / noise.autocovariance(1)
    assert found == pytest.approx([1.0, 0.5, 0.0, 0.0], abs=0.1)


@pytest.mark.parametrize("shape", ["a pulse", "a fall from the air before"])
@pytest.mark.parametrize(("correlated", "averaged"), [(0.0, 1), (0.02, 1), (0.0, 4)])
def test_what_happens_once_in_few_plateaus_is_no_noise(shape, correlated, averaged):
    """A door that is opened, or a sensor that was brought just before: the other pieces of plateau know the noise, and
    a single one that is far louder had been most of it."""
    calm = noisy_channel(4, 0.02, correlated, averaged=averaged, runs=1)
    (time, value), *_ = calm.samples
    since = time - time[100]
    once = (since >= 0) & (since < 0.25) if shape == "a pulse" else np.exp(-np.maximum(since, 0.0) / 0.15) * (since < 1)
    loud = rebin(calm, ((time, value + 2.0 * once * (time < -10.0)),), calm.bin_of, (), 1)
    undisturbed, found = estimate_noise(calm), estimate_noise(loud)
    assert found.standard_deviation == pytest.approx(undisturbed.standard_deviation, rel=0.25)
    assert found.averaged == undisturbed.averaged


@pytest.mark.parametrize(
    ("correlated", "averaged", "step"), [(0.0, 1, 0.0), (0.03, 1, 0.0), (0.0, 6, 0.0), (0.0, 1, 0.05)]
)
def test_noise_alone_holds_no_bursts(correlated, averaged, step):
    """However it hangs together, or is rounded."""
    early, late = plateau_pieces(noisy_channel(8, 0.02, correlated, averaged=averaged, runs=30))
    pieces = np.concatenate([early, late])
    assert not holds_burst(np.round(pieces / step) * step if step else pieces, step).any()


def test_plateaus_are_those_before_the_transfer_and_at_the_end():
    early, late = plateau_pieces(noisy_channel(5, 0.01, runs=2))
    assert np.all(np.abs(early - 20.0) < 0.1)
    assert np.all(np.abs(late - 30.0) < 0.1)


def test_whitened_bins_of_correlated_noise_are_white():
    channel = noisy_channel(6, 0.01, 0.02, 1.0)
    whitener = whiteners(channel, estimate_noise(channel))
    truth = 20.0 + 10.0 * (channel.time_s > 0)
    white = np.matmul(whitener, (channel.value - truth)[..., None])[..., 0]
    filled = channel.count > 0
    assert white[filled].std() == pytest.approx(1.0, abs=0.06)
    lag_one = np.mean(white[:, 1:] * white[:, :-1])
    assert abs(lag_one) < 4 / np.sqrt(white.size)


def test_whitening_by_blocks_is_the_whole_product():
    """Of noise that is soon forgotten, of independent noise, and of a matrix that is full."""
    channel = noisy_channel(6, 0.01, 0.02, 1.0)
    columns = np.random.default_rng(1).normal(size=(*channel.time_s.shape, 5))
    soon = whiteners(channel, estimate_noise(channel))
    full = np.random.default_rng(2).normal(size=soon.shape)
    alone = full * np.eye(full.shape[1])
    for whitener in (soon, alone, full):
        problem, whole = make_problem(channel, whitener), np.matmul(whitener, columns)
        assert problem.whiten(columns) == pytest.approx(whole, rel=1e-9, abs=1e-9 * np.abs(whole).max())
        assert problem.with_rate_scatter(0.01).whiten(columns) == pytest.approx(problem.whiten(columns), abs=0.0)
        assert problem.whiten(columns[..., 0]) == pytest.approx(whole[..., 0], rel=1e-9, abs=1e-9 * np.abs(whole).max())


def test_correlated_noise_is_whitened_where_a_logger_stamps_irregularly():
    """Readings bunched in each second: on the grid they lie further out than the run is long."""
    channel = noisy_channel(6, 0.01, 0.02, 1.0, runs=2)
    bunched = tuple((np.floor(time) + 0.3 * (time % 1.0), value) for time, value in channel.samples)
    whitener = whiteners(replace(channel, samples=bunched), replace(estimate_noise(channel), memory=0.999))
    assert np.isfinite(whitener).all()


@pytest.mark.parametrize("stamped", ["anywhere within a period", "at a 60th of a second, known to 4 digits"])
def test_noise_is_what_it_is_however_readings_are_stamped(stamped):
    """Before: readings were put on an even grid by lines between them, which lack a fifth of the noise."""
    channel, rng = noisy_channel(8, 0.02), np.random.default_rng(0)
    if stamped.startswith("anywhere"):
        samples = tuple((t + rng.uniform(-0.45, 0.45, t.size) * PERIOD, y) for t, y in channel.samples)
        unevenly = replace(channel, samples=samples)
    else:
        samples = tuple((np.round(t * (1 / 60) / PERIOD, 4), y) for t, y in channel.samples)
        unevenly = replace(channel, samples=samples, sampling_period_s=0.0167)
    assert estimate_noise(unevenly).standard_deviation == pytest.approx(0.02, rel=0.06)


def test_no_noise_at_all_is_a_very_small_one():
    noise = estimate_noise(noisy_channel(7, 0.0))
    assert 0 < noise.standard_deviation <= 1e-3


def test_one_run_that_mostly_repeats_its_readings_is_not_without_noise():
    """Steps of 1/16, most readings alike: their median change is none, and no plateau is long enough for more."""
    channel = noisy_channel(3, 0.02, runs=1)
    (time, value), *_ = channel.samples
    few = slice(280, 340)
    coarse = replace(channel, samples=((time[few], np.round(value[few] * 16.0) / 16.0),))
    assert np.median(np.abs(np.diff(coarse.samples[0][1]))) == 0.0
    assert 0.005 < estimate_noise(coarse).standard_deviation < 0.05


@pytest.mark.parametrize("period_s", [0.16, 1.0])
@pytest.mark.parametrize("lag_s", [0.6, 8.0])
def test_a_slow_chamber_is_no_noise_with_a_memory(lag_s, period_s):
    """A lag behind a chamber of 60 s whose air was measured: what bends, and the kink where it begins, are not noise.

    Reading in closed form: 1 - (T exp(-t/T) - tau exp(-t/tau)) / (T - tau).
    """
    rng, chamber, white = np.random.default_rng(8), 60.0, 0.02
    made = []
    for k in range(6):
        time = np.arange(0.0, 600.0, period_s) - 60.0
        since = np.maximum(time, 0.0)
        air = 20.0 + 20.0 * (1.0 - np.exp(-since / chamber))
        shown = 1.0 - (chamber * np.exp(-since / chamber) - lag_s * np.exp(-since / lag_s)) / (chamber - lag_s)
        imet = Trace(time, {"temperature_c": 20.0 + 20.0 * shown + white * rng.standard_normal(time.size)})
        measured = Trace(time, {"temperature_c": air})
        made.append(
            Run(str(k), RunAir(20.0, 50.0), RunAir(40.0, 50.0), None, 1000.0, None, None, imet, None, {}, measured)
        )
    channel = build_channel(Campaign("n", None, {}, 4e-4, 1e-5, tuple(made)), "temperature")
    assert channel.measured.all()
    found = estimate_noise(channel).autocovariance(400)
    assert found[0] == pytest.approx(white**2, rel=0.05)
    # What limits a rate behind a slow chamber is the noise's power at its low end: white noise has none beside its own.
    assert found[0] + 2.0 * found[1:].sum() < 2.0 * white**2
