"""`shockrig.plan`: the runs that a diagnosis proposes, as a notebook shows them."""

from dataclasses import replace

import shockrig
from shockrig.analysis.diagnose.diagnose import diagnose
from shockrig.analysis.diagnose.diagnosed import to_json
from shockrig.choosing_runs import Planned
from shockrig.diagnosing import Diagnosed
from shockrig.files.campaign import read_campaign

RUN = {
    "source": {"temperature_c": 5.0, "humidity_percent": 40.0},
    "destination": {"temperature_c": 20.0, "humidity_percent": 40.0},
    "airflow_m_s": 2.0,
    "reason": "the slowest airflow",
    "expected_evidence": 14.2,
}


def test_runs_are_shown_as_a_table_a_figure_and_a_card():
    planned = Planned((RUN, RUN), ("Log the airflow.",))
    frame = planned.to_frame()
    assert list(frame["destination.temperature_c"]) == [20.0, 20.0]
    assert list(frame["expected_evidence"]) == [14.2, 14.2]
    assert "Log the airflow." in planned._repr_html_() and "the slowest airflow" in planned._repr_html_()
    bars = planned.plot().axes[0].patches
    assert [bar.get_width() for bar in bars] == [14.2, 14.2]


def test_nothing_tied_is_nothing_to_record():
    planned = Planned((), ())
    assert planned.to_frame().empty
    assert planned.plot().axes[0].get_title(loc="left") == "nothing is tied"


def test_the_proposals_are_those_of_the_diagnosis():
    campaign = read_campaign(shockrig.example("plain-rough"))
    few = diagnose(replace(campaign, runs=campaign.runs[:3]))
    planned = shockrig.plan(Diagnosed(to_json(few), few, campaign))
    assert planned.runs == few.next_experiments
    assert any("at least 6 transfers" in sentence for sentence in planned.advice)
