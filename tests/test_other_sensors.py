"""Sensors of other makes: a second time constant beside the body, responses faster than the bins, long slow ones."""

import numpy as np
import pytest

from shockrig.analysis.diagnosis.diagnose import diagnose_channel
from shockrig.analysis.inference.bins import edges_after_transfer
from shockrig.analysis.inference.gather import build_channel
from shockrig.analysis.physics import concentration
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.foreign import Approach, Bench, Logger, Transfer, Written, make_body, record


@pytest.mark.parametrize(
    "t63_s, fraction, ratio, period_s",
    [(3.0, 0.35, 5.0, 0.3), (25.0, 0.1, 7.0, 0.5)],
)
def test_a_slow_share_beside_a_lump_is_found_whichever_is_called_the_body(t63_s, fraction, ratio, period_s, tmp_path):
    body = make_body("lumped", t63_s, slow=(fraction, ratio))
    tail = 1.5 * body.time_to_s(0.99)
    plan = tuple(
        Transfer(*((30.0, 10.0) if i % 2 else (10.0, 30.0)), start_s=0.2 * tail, length_s=1.2 * tail) for i in range(6)
    )
    bench = Bench("temperature", body, Approach(), Logger(period_s, 0.001, 0.02), plan, Written(body="lumped"))
    record(bench, 5, tmp_path / "campaign")
    found = diagnose_channel(build_channel(read_campaign(tmp_path / "campaign"), "temperature"))
    assert found.verdict == "explained" and [c.effect for c in found.causes] == ["stem_conduction"]
    told, uncertainty = found.causes[0].parameters["fraction"]
    assert told == pytest.approx(fraction, abs=max(3 * uncertainty, 0.003))
    assert found.gain.explained_fraction > 0.99


def test_bins_follow_the_sensors_pace_where_the_logger_does():
    ordinary = edges_after_transfer(-10.0, 60.0, 0.1, 1.0, 0.5)
    assert np.allclose(np.diff(ordinary[ordinary >= 0])[:20], 0.1)
    fast = edges_after_transfer(-10.0, 60.0, 0.01, 1.0, 0.4)
    after = fast[fast >= 0]
    assert np.all(np.diff(after) <= np.maximum(0.081 * (0.4 + after[:-1]), 0.011))
    unknown = edges_after_transfer(-10.0, 60.0, 0.1, 1.0, float("nan"))
    assert np.allclose(unknown, edges_after_transfer(-10.0, 60.0, 0.1, 1.0))


def test_the_even_table_of_the_warp_is_as_good_as_the_spline_that_it_is_made_of():
    rng = np.random.default_rng(1)
    ratio, fourier = np.exp(rng.uniform(-2.4, 2.4, (40, 1))), np.exp(rng.uniform(-10.5, 1.7, (40, 50)))
    spline = concentration._table()(*np.broadcast_arrays(np.log(ratio), np.log(fourier)), grid=False)
    assert concentration.time_warp(fourier, ratio) == pytest.approx(np.exp(spline), rel=5e-5)
