"""A campaign that cannot decide lists the look-alikes and asks for the runs that decide; with those runs it is
decided."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shockrig.analysis.diagnose.diagnose import diagnose
from shockrig.analysis.diagnose.diagnosed import to_json
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.hide import draw_effect
from shockrig.rig.virtual.plans import plan_from_runs, single_airflow_plan
from shockrig.rig.virtual.truth import draw_truth


def diagnosed(path):
    """The diagnosis of a campaign's bead."""
    campaign = read_campaign(path)
    return to_json(diagnose(replace(campaign, runs=tuple(replace(run, hyt=None) for run in campaign.runs))))


@pytest.fixture(scope="module")
def undecided(tmp_path_factory):
    rng = np.random.default_rng(3)
    truth = draw_truth(rng, "rough", [draw_effect(rng, "self_heating")])
    plan = single_airflow_plan()[::2]
    path = simulate_campaign(truth, plan, rng, tmp_path_factory.mktemp("one_airflow") / "campaign")
    return truth, plan, diagnosed(path)


def test_one_airflow_cannot_tell_self_heating_from_calibration(undecided):
    _, _, content = undecided
    (cause,) = content["channels"]["temperature"]["causes"]
    assert {cause["effect"], *cause["indistinguishable_from"]} >= {"self_heating", "calibration_error"}
    assert cause["probability"] < 0.9
    assert content["next_experiments"], "a tie asks for the run that decides"


@pytest.mark.trial
def test_the_runs_asked_for_decide(undecided, tmp_path):
    truth, plan, content = undecided
    asked = content["next_experiments"]
    assert any(run["airflow_m_s"] != plan[0].airflow_m_s for run in asked)
    longer = [*plan, *plan_from_runs(asked, first=100)]
    path = simulate_campaign(truth, longer, np.random.default_rng(4), tmp_path / "campaign")
    after = diagnosed(path)["channels"]["temperature"]
    (cause,) = after["causes"]
    assert cause["effect"] == "self_heating"
    # Two runs alone tell the two apart: drawn again, one set of runs in eight has neither, and says so.
    assert cause["probability"] > 0.8 and set(cause["indistinguishable_from"]) <= {"calibration_error"}
    stated = cause["parameters"]["rise_k_at_5_m_s"]
    true = truth.effect("self_heating")["rise_k_at_5_m_s"]
    assert abs(stated["value"] - true) < 4 * stated["standard_uncertainty"]
