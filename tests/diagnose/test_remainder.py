"""What is left of a fit above its noise, where that hangs together from bin to bin: nothing, of noise alone."""

from types import SimpleNamespace

import numpy as np
import pytest
from small_worlds import logged

from shockrig.analysis.diagnose import remainder
from shockrig.analysis.diagnose.adequacy import in_common, varies_with, when_largest
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.diagnose.prepare import prepare
from shockrig.analysis.diagnose.remainder import Tolerance, measure_remainder
from shockrig.analysis.estimate.fit import fit
from shockrig.analysis.estimate.fit_starts import rough_point
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import PLAIN


@pytest.mark.parametrize("memory", [0.0, 0.97])
def test_noise_alone_leaves_nothing_above_itself(monkeypatch, memory):
    """Bins of twenty readings each, whose mean noise with a memory hardly thins out; the last bin is empty."""
    runs, bins, each = 40, 30, 20
    apart = np.abs(np.subtract.outer(np.arange(bins * each), np.arange(bins * each)))
    covariance = 0.01 * memory**apart if memory else 0.01 * np.eye(bins * each)
    of_means = covariance.reshape(bins, each, bins, each).mean(axis=(1, 3))
    whitener = np.zeros((runs, bins + 1, bins + 1))
    whitener[:, :bins, :bins] = np.linalg.inv(np.linalg.cholesky(of_means))
    residual = np.zeros((runs, bins + 1))
    residual[:, :bins] = np.random.default_rng(1).multivariate_normal(np.zeros(bins), of_means, runs)
    count = np.full((runs, bins + 1), each)
    count[:, bins] = 0
    quantity = SimpleNamespace(unit="K", step=lambda _: np.full(runs, 20.0))
    channel = SimpleNamespace(count=count, conditions=None, quantity=quantity)
    monkeypatch.setattr(remainder, "when_largest", lambda *_: (0.0, 1.0))
    monkeypatch.setattr(remainder, "varies_with", lambda *_: ())
    monkeypatch.setattr(remainder, "left_at_common_rates", lambda *_: residual)
    left = measure_remainder(
        SimpleNamespace(channel=channel, whitener=whitener),
        SimpleNamespace(residual=residual),
        SimpleNamespace(standard_deviation=0.1),
        SimpleNamespace(passed=True),
        SimpleNamespace(measured=False),
        Tolerance(),
    )
    assert left.rms < 0.3 * np.sqrt(of_means[0, 0]) and left.peak < np.sqrt(of_means[0, 0])


def test_runs_that_differ_in_their_rate_are_not_adequate_because_nobody_recorded_the_airflow(tmp_path):
    random, time, runs = np.random.default_rng(8), np.arange(0.0, 120.0), []
    for run, lag_s in enumerate((9.3, 10.7, 10.0, 9.4, 10.8, 9.8), 1):
        began, (before, after) = 30.0 + random.uniform(), ((20.0, 60.0) if run % 2 else (60.0, 20.0))
        left = np.exp(-np.maximum(time - began, 0.0) / lag_s)
        runs.append((time, after + (before - after) * left + random.normal(0.0, 0.3, time.size)))
    found = diagnose_channel(build_channel(logged(tmp_path, runs), "temperature"))
    assert found.verdict == "unexplained" and not found.causes
    assert found.final.rate_scatter == pytest.approx(0.064, abs=0.02) and found.remainder.significant


@pytest.mark.parametrize(("every_s", "largest"), [(0.05, (0.0, 0.3)), (5.0, (0.0, 5.0)), (70.0, (0.0, 99.0))])
def test_when_most_is_left_is_said_no_finer_than_the_readings_come(every_s, largest):
    """Of a chamber that was logged every 10 s most had been left "from 0 to 0.29 s after the transfer"."""
    time_s = np.arange(0.1, 100.0, 0.2)[None, :]
    residual = np.where(time_s < 0.25, 3.0, 0.5)
    channel = SimpleNamespace(time_s=time_s, tempo=2.0, count=np.ones(time_s.shape), sampling_period_s=every_s)
    found, noise = SimpleNamespace(residual=residual), SimpleNamespace(standard_deviation=0.1)
    assert when_largest(channel, found, noise) == pytest.approx(largest, abs=1.0)


def test_how_much_of_what_is_left_runs_have_in_common():
    """One curve in all runs, another in each, and half and half; of a single run nothing is said."""
    time = np.tile(np.geomspace(0.1, 100.0, 40), (4, 1))
    curve = np.exp(-((np.log(time) - 1.0) ** 2))
    noise = SimpleNamespace(standard_deviation=0.001)

    def shared(residual, runs=4):
        channel = SimpleNamespace(runs=runs, time_s=time[:runs], count=np.ones((runs, 40)), tempo=1.0)
        return in_common(channel, SimpleNamespace(residual=residual[:runs]), noise)

    either = np.array([1.0, -1.0, 1.0, -1.0])[:, None] * curve
    assert shared(curve) == pytest.approx(1.0, abs=1e-3) and shared(either) == pytest.approx(0.0, abs=1e-3)
    assert shared(curve + either) == pytest.approx(0.5, abs=1e-3) and shared(curve, 1) is None


@pytest.mark.parametrize(
    ("steps_k", "slow_down", "said"),
    [
        ((20.0, 20.4, 20.2, 19.9, 20.1, 20.3), 0.2, {"nothing: the same in every run"}),
        ((20.0, -20.0, 10.0, -10.0, 30.0, -30.0), 0.2, {"the step"}),
        ((20.0, -20.0, 10.0, -10.0, 30.0, -30.0), 0.0, {"the step", "the size of the step"}),
    ],
    ids=["steps that are as large", "both ways alike", "slow upwards alone"],
)
def test_what_is_left_varies_with_what_tells_more_than_what_is_named_already(tmp_path, steps_k, slow_down, said):
    """Steps of one size tell neither the step nor its size from what is the same in every run."""
    random, time, runs = np.random.default_rng(9), np.arange(-30.0, 120.0, 0.5), []
    late = np.maximum(time, 0.0)
    for step_k in steps_k:
        slow = 0.2 if step_k > 0 else slow_down
        left = (1.0 - slow) * np.exp(-late / 12.0) + slow * np.exp(-late / 36.0)
        runs.append((time + 30.0, 20.0 + step_k * (1.0 - left) + random.normal(0.0, 0.02, time.size)))
    problem = prepare(build_channel(logged(tmp_path, runs), "temperature")).problem
    point = rough_point(problem, PLAIN)
    assert set(varies_with(problem, fit(problem, PLAIN, point.theta, point.deviations))) == said
