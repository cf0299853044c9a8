"""What is left of a fit above its noise, where that hangs together from bin to bin: nothing, of noise alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from shockrig.analysis.diagnose import remainder
from shockrig.analysis.diagnose.remainder import Tolerance, measure_remainder


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
    left = measure_remainder(
        SimpleNamespace(channel=channel, whitener=whitener),
        SimpleNamespace(residual=residual),
        SimpleNamespace(standard_deviation=0.1),
        SimpleNamespace(passed=True, hidden_rms=0.0),
        SimpleNamespace(measured=False),
        Tolerance(),
    )
    assert left.rms < 0.3 * np.sqrt(of_means[0, 0]) and left.peak < np.sqrt(of_means[0, 0])
