"""A hum slower than a piece of plateau is long looks like wandering noise: its line in the spectrum tells it."""

import numpy as np
import pytest

from shockrig.analysis.diagnose import restless
from shockrig.analysis.diagnose.adequacy import judge
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.diagnose.prepare import prepare
from shockrig.analysis.diagnose.refitting import plain_fit
from shockrig.analysis.estimate.gather import build_channel
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import Hidden, draw_truth

LINE = "a line in the spectrum of the plateaus"


def recorded(tmp_path, seed, *hidden):
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng, "rough", hidden)
    return build_channel(
        read_campaign(simulate_campaign(truth, standard_plan(), rng, tmp_path / "campaign")), "temperature"
    )


def line(channel):
    ready = prepare(channel)
    judged = judge(ready.problem, plain_fit(ready.problem, ready.structure), ready.noise)
    return judged, next(check for check in judged.checks if check.name == LINE)


@pytest.mark.parametrize(
    "frequency_hz, amplitude_k, seed",
    [
        (0.15, 0.05, 1),
        pytest.param(0.3, 0.05, 3, marks=pytest.mark.trial),
        pytest.param(0.5, 0.03, 5, marks=pytest.mark.trial),
    ],
)
def test_a_slow_hum_is_seen_with_its_size(frequency_hz, amplitude_k, seed, tmp_path):
    hum = {"amplitude": amplitude_k, "hum_hz": frequency_hz, "burst_share": 0.0}
    judged, check = line(recorded(tmp_path, seed, Hidden("unknown_interference", hum, ("temperature",))))
    assert not judged.passed and check.p < 1e-20
    # A line between two frequencies of the spectrum loses up to a quarter of its height.
    assert 0.6 * amplitude_k / np.sqrt(2) < judged.hidden_rms < 1.3 * amplitude_k / np.sqrt(2)


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
    judged, check = line(recorded(tmp_path, seed))
    assert judged.passed and check.p > 1e-4


def test_plateaus_that_mostly_repeat_a_value_or_end_at_once_have_no_hum(tmp_path):
    channel = recorded(tmp_path, 3)
    time_s = np.arange(0.0, 40.0, 0.1)
    still = [restless._Plateau(run, time_s, np.where(time_s < 1.0, 0.01, 0.0)) for run in range(8)]
    assert restless._hum(channel, still) is None
    short = [restless._Plateau(run, time_s[:3], np.array([0.0, 0.1, -0.1])) for run in range(8)]
    assert restless._hum(channel, short) is None
