"""What must hold of an effect none of whose numbers is told: it is no finding, however likely one is."""

import numpy as np
import pytest
from small_worlds import logged

from shockrig.analysis.diagnose import diagnose
from shockrig.analysis.diagnose.candidates import says_nothing_at_all
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.gather import build_channel


@pytest.mark.parametrize(
    ("fraction", "time_constant_s", "nothing"),
    [
        ((0.147, 8.6), (3.4e4, 2.4e6), True),  # of two runs in a room that warmed up
        ((0.147, 0.05), (3.4e4, 2.4e6), False),
        ((0.147, 8.6), (3.4e4, 1e4), False),
    ],
)
def test_an_effect_tells_nothing_where_none_of_its_numbers_is_surer_than_its_range(fraction, time_constant_s, nothing):
    effect = CATALOGUE["parallel_lag"]
    assert says_nothing_at_all(effect, {"fraction": fraction, "time_constant_s": time_constant_s}) == nothing


def test_an_effect_without_numbers_tells_what_it_is():
    assert not says_nothing_at_all(CATALOGUE["body_sphere"], {})


def test_an_effect_that_tells_nothing_is_not_stated_and_may_still_predict(tmp_path, monkeypatch):
    """Two runs of a sensor with a share that follows slowly."""
    random, time_s = np.random.default_rng(1), np.arange(-60.0, 600.0, 1.0)
    late_s = np.maximum(time_s, 0.0)
    runs = [
        (
            time_s + 60.0,
            20.0
            - k * (0.8 * np.expm1(-late_s / 40.0) + 0.2 * np.expm1(-late_s / 200.0))
            + random.normal(0.0, 0.02, time_s.size),
        )
        for k in (3.0, -2.0)
    ]
    channel = build_channel(logged(tmp_path, runs), "temperature")
    assert [one.effect for one in diagnose_channel(channel, describing=False).causes] == ["parallel_lag"]
    monkeypatch.setattr(diagnose, "says_nothing_at_all", lambda effect, values: effect.id == "parallel_lag")
    found = diagnose_channel(channel, describing=False)
    assert "parallel_lag" not in {one.effect for one in found.causes} and found.verdict == "unexplained"
    assert "parallel_lag" in found.predicting.model.ids
