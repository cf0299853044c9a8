"""A single run of a sensor that nobody knows: the shape of its response is told, and no cause is."""

import numpy as np
import pytest

from shockrig.analysis.characterization.characterize import characterize
from shockrig.analysis.diagnosis.diagnose import diagnose
from shockrig.analysis.diagnosis.extended import extended_result
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.foreign import Approach, Bench, Logger, Transfer, Written, make_body, record

PLAN = (Transfer(20.0, 42.0, 20.0, 80.0),)
LOGGER = Logger(0.1, 0.001, 0.02, 0.01, 0.5, 0.01)


def diagnosed(tmp_path, body, logger=LOGGER, declared=None):
    bench = Bench("temperature", body, Approach(), logger, PLAN, Written(body=declared))
    record(bench, 11, tmp_path / "campaign")
    return diagnose(read_campaign(tmp_path / "campaign")).channels[0]


@pytest.mark.parametrize(
    ("body", "shape"),
    [
        (make_body("plate", 3.0), "body_plate"),
        (make_body("sphere", 3.0, slow=(0.25, 5.0)), "parallel_lag"),
    ],
)
def test_the_shape_of_one_response_is_told_and_nothing_is_explained(tmp_path, body, shape):
    found = diagnosed(tmp_path, body)
    assert [c.effect for c in found.causes] == [shape] and found.causes[0].probability <= 0.8
    assert found.verdict == "unexplained" and not found.gain.measured
    response = extended_result(found).rows[0].response
    true_s = body.time_to_s(1.0 - np.exp(-1.0))
    assert abs(response.t63_s - true_s) < max(2 * response.standard_uncertainties_s[0], 0.005 * true_s)


@pytest.mark.parametrize("rounding", [0.001, 0.1])
def test_of_the_stated_body_nothing_is_told(tmp_path, rounding):
    found = diagnosed(tmp_path, make_body("sphere", 3.0), Logger(0.1, rounding, 0.02, 0.01, 0.5, 0.01))
    assert found.verdict == "adequate" and not [c for c in found.causes if c.effect != "quantization"]
    assert found.gain.noise_floor > 0.08 * rounding


def test_runs_that_disagree_make_no_better_mean(tmp_path):
    """Whatever makes runs of known airflow differ by a sixth: the time is as uncertain as they are apart."""
    plan = tuple(Transfer(20.0, 42.0, 20.0, 80.0) for _ in range(6))
    bench = Bench("temperature", make_body("sphere", 3.0), Approach(), LOGGER, plan, Written(), rate_scatter=0.15)
    record(bench, 12, tmp_path / "campaign")
    row = characterize(read_campaign(tmp_path / "campaign"), 0).temperature.rows[0]
    assert row.response.standard_uncertainties_s[0] > 0.08 * row.response.t63_s
    assert row.standard_uncertainty > 0.08 * row.diffusivity_m2_s


def test_a_run_without_a_step_predicts_no_other(tmp_path):
    """What was fitted to the run that hardly steps knows no rate: its errors on the other are not the model's."""
    plan = (*PLAN, Transfer(42.0, 42.03, 20.0, 80.0))
    record(Bench("temperature", make_body("sphere", 3.0), Approach(), LOGGER, plan, Written()), 11, tmp_path / "c")
    found = diagnose(read_campaign(tmp_path / "c")).channels[0]
    assert found.verdict == "adequate" and found.problem.channel.runs == 2
    assert np.isfinite(found.gain.run_before).sum() == 1 and found.gain.before < 2 * found.gain.noise_floor
