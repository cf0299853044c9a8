"""A slow hum looks like wandering noise: its line in the spectrum tells it."""

import numpy as np
import pytest
from scipy.signal import lfilter

from shockrig.analysis.diagnose import hums
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.diagnose.hums import without_hums
from shockrig.analysis.estimate.channel import rebin
from shockrig.analysis.estimate.gather import build_channel
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import Hidden, draw_truth


def recorded(tmp_path, seed, *hidden):
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng, "rough", hidden)
    return build_channel(
        read_campaign(simulate_campaign(truth, standard_plan(), rng, tmp_path / "campaign")), "temperature"
    )


@pytest.mark.parametrize(
    "frequency_hz, amplitude_k, seed",
    [
        (0.08, 0.1, 1),  # before: no frequency below two turns of a plateau was looked at
        (0.15, 0.05, 1),
        pytest.param(0.3, 0.05, 3, marks=pytest.mark.trial),
        pytest.param(0.5, 0.03, 5, marks=pytest.mark.trial),
    ],
)
def test_a_slow_hum_is_seen_with_its_size(frequency_hz, amplitude_k, seed, tmp_path):
    hum = {"amplitude": amplitude_k, "hum_hz": frequency_hz, "burst_share": 0.0}
    _, (found,) = without_hums(recorded(tmp_path, seed, Hidden("unknown_interference", hum, ("temperature",))))
    assert found.period_s.value == pytest.approx(1.0 / frequency_hz, rel=0.002)
    assert found.size.value == pytest.approx(amplitude_k, rel=0.12)  # a bend that is taken off takes some of it


def test_a_hum_of_some_runs_is_seen(tmp_path):
    """Before: it was left in the readings, since not every condition showed it."""
    channel = recorded(tmp_path, 1)
    early = channel.conditions.order < 9
    samples = [
        (time, value + early[run] * 0.05 * np.sin(2.5 * time + run))
        for run, (time, value) in enumerate(channel.samples)
    ]
    _, (found,) = without_hums(rebin(channel, samples, channel.bin_of, channel.die_samples, 1))
    assert found.period_s.value == pytest.approx(2.0 * np.pi / 2.5, rel=0.002)
    assert found.size.value == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize(
    ("size_k", "per_s"),
    [
        (0.1, 0.3),
        (1.0, 0.49),  # before: the level with fewer readings was left out as bursts, and a mean of 10 was named
    ],
)
def test_a_swing_that_is_no_sine_is_one_hum_and_is_gone(size_k, per_s, tmp_path):
    """A relay beside the sensor: the reading jumps to and fro. Before: a ninth of its power was left as noise."""
    channel = recorded(tmp_path, 2)
    samples = [
        (time, value + size_k * np.sign(np.sin(2.0 * np.pi * per_s * time + run)))
        for run, (time, value) in enumerate(channel.samples)
    ]
    quiet, (found,) = without_hums(rebin(channel, samples, channel.bin_of, channel.die_samples, 1))
    assert found.period_s.value == pytest.approx(1.0 / per_s, rel=0.002)
    assert found.size.value == pytest.approx(size_k * 4.0 / np.pi, rel=0.05)
    left = [np.std(new - old) for (_, new), (_, old) in zip(quiet.samples, channel.samples, strict=True)]
    assert np.median(left) < 0.3 * size_k


@pytest.mark.parametrize("seed", [1, 2])
def test_what_wanders_is_no_hum(seed, tmp_path):
    """A room's air that walks at random swings in every run, and is out of phase from one plateau to the other."""
    channel, rng = recorded(tmp_path, seed), np.random.default_rng(seed)
    walks = [0.01 * np.cumsum(rng.standard_normal(time.size)) for time, _ in channel.samples]
    samples = [(time, value + walk) for (time, value), walk in zip(channel.samples, walks, strict=True)]
    walking = rebin(channel, samples, channel.bin_of, channel.die_samples, 1)
    assert without_hums(walking) == (walking, ())


@pytest.mark.trial
def test_a_hum_as_large_as_the_tolerance_is_described_and_no_noise(tmp_path):
    hum = {"amplitude": 0.1, "hum_hz": 0.35, "burst_share": 0.0}
    found = diagnose_channel(recorded(tmp_path, 7, Hidden("unknown_interference", hum, ("temperature",))))
    assert found.verdict == "described" and found.causes == ()
    (one,) = found.discovered
    assert one.behaves_as == "periodic"
    assert one.period_s.value == pytest.approx(1.0 / 0.35, rel=0.002)
    assert abs(one.period_s.value - 1.0 / 0.35) < 5.0 * one.period_s.standard_uncertainty
    assert one.size.value == pytest.approx(0.1, rel=0.05)
    # It is out of the readings that are judged: nothing of it is left, nor in the noise.
    assert found.adequacy.passed and found.remainder.rms < 0.1 * found.remainder.tolerance
    true = draw_truth(np.random.default_rng(7), "rough", ()).temperature_noise
    assert found.noise.standard_deviation == pytest.approx(np.hypot(true.white, true.correlated), rel=0.1)


@pytest.mark.parametrize("seed", [20, *(pytest.param(seed, marks=pytest.mark.trial) for seed in (21, 22))])
def test_wandering_noise_is_no_hum(seed, tmp_path):
    channel = recorded(tmp_path, seed)
    assert without_hums(channel) == (channel, ())


def test_what_slow_swings_take_out_is_told_of_all_at_once_as_one_by_one():
    """One by one, twelve runs of four hours took 14 s a look."""
    rng = np.random.default_rng(4)
    time, apart_hz = np.sort(rng.uniform(-60.0, 120.0, 1200)), 1.0 / 600.0
    value = 0.1 * np.sin(2.0 * np.pi * 0.03 * time) + 0.02 * rng.standard_normal(time.size)
    ends = hums._ends_of(time, value, hums.plateaus_of(time, -0.2))
    gained = hums._gained(ends, apart_hz, 40)
    alone = [ends.square - hums._swing(ends, k * apart_hz)[1] for k in range(6, 40)]
    assert np.argmax(gained) == 18 and gained[6:] == pytest.approx(alone, rel=0.1, abs=0.002)


def test_noise_of_a_narrow_band_is_no_more_than_one_hum(tmp_path):
    """Before: 15 to 30 of them, which fit the plateaus alone; the noise was then half of what runs are off by."""
    channel, rng = recorded(tmp_path, 1), np.random.default_rng(1)
    turn = 2.0 * 0.98 * np.cos(2.0 * np.pi * 1.0 * channel.sampling_period_s)
    runs = [lfilter([1.0], [1.0, -turn, 0.98**2], rng.standard_normal(t.size + 999))[999:] for t, _ in channel.samples]
    samples = [(t, value + 0.05 * own / own.std()) for (t, value), own in zip(channel.samples, runs, strict=True)]
    quiet, found = without_hums(rebin(channel, samples, channel.bin_of, channel.die_samples, 1))
    assert len(found) <= 1
    assert np.median([value[time > 0.67 * time[-1]].std() for time, value in quiet.samples]) > 0.035


def test_runs_without_plateaus_say_nothing_of_a_hum_though_they_are_the_most(tmp_path):
    """A traceback before: the noise of a plateau of no readings was asked for."""
    channel = recorded(tmp_path, 1)
    samples = [(time, value + 0.1 * np.sin(2.5 * time)) for time, value in channel.samples]
    few = [slice(None) if run < 8 else (time > -0.35) & (time < 1.05) for run, (time, _) in enumerate(samples)]
    samples = [(time[kept], value[kept]) for (time, value), kept in zip(samples, few, strict=True)]
    bins = [one[kept] for one, kept in zip(channel.bin_of, few, strict=True)]
    _, (found,) = without_hums(rebin(channel, samples, bins, channel.die_samples, 1))
    assert found.period_s.value == pytest.approx(2.0 * np.pi / 2.5, rel=0.002)
    assert found.size.value == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize("step_k", [0.08, pytest.param(0.1, marks=pytest.mark.trial)])
def test_codes_that_hide_the_noise_are_no_hum(step_k, tmp_path):
    """Before: five and three of them, each a few percent of a code."""
    channel = recorded(tmp_path, 5, Hidden("quantization", {"step": step_k}, ("temperature",)))
    assert without_hums(channel) == (channel, ())


def test_plateaus_that_mostly_repeat_a_value_or_end_at_once_have_no_hum(monkeypatch, tmp_path):
    channel = recorded(tmp_path, 3)
    time_s = np.arange(0.0, 40.0, 0.1)
    still, short = np.where(time_s < 1.0, 0.01, 0.0), np.array([0.0, 0.1, -0.1])
    for value in (still, short):
        pieces = [hums._Plateau(time_s[: value.size], value) for _ in range(8)]
        monkeypatch.setattr(hums, "plateaus", lambda _, pieces=pieces: pieces)
        assert without_hums(channel) == (channel, ())
