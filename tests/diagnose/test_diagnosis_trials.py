"""Blind trials: effects are hidden by a seeded draw, the files are diagnosed, and only then the seal is opened.

A small fixed sample of benchmarks/diagnosis_trials.py, whose full table is kept in benchmarks/results; those that take
long are benchmarks/fixed_trials.py.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from benchmark_scripts import benchmark
from small_worlds import record

from shockrig.analysis.diagnose.adequacy import judge
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.noise import estimate_noise, whiteners
from shockrig.analysis.estimate.problem import make_problem
from shockrig.analysis.estimate.refitting import plain_fit
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import ROUGH, TrueNoise

trials = benchmark("diagnosis_trials")


@pytest.mark.trial
def test_nothing_is_named_where_nothing_is_hidden():
    result = trials.trial("none", "rough", "comfortable", 7010)
    for name, channel in result["diagnosis"]["channels"].items():
        assert channel["verdict"] == "adequate", (name, channel["causes"])
        assert channel["causes"] == []


@pytest.mark.trial
def test_what_no_catalogue_holds_is_described_as_far_as_it_can_be():
    """A hum with bursts: both are said."""
    result = trials.trial("outside", "rough", "comfortable", 7033, without="hyt")
    found = result["diagnosis"]["channels"]["temperature"]
    behaviours = [(one["behaves_as"], [on["factor"] for on in one["depends_on"]]) for one in found["discovered"]]
    assert (found["verdict"], found["causes"], behaviours) == ("described", [], [("bursts", []), ("periodic", [])])
    (scored,) = result["score"].channels.values()
    assert scored.verdict_right and not scored.wrong


def test_a_wrong_noise_model_is_caught(tmp_path):
    """Guards the calibration: were correlated noise taken for white, plain campaigns would raise false alarms."""
    noisy = {"temperature_noise": TrueNoise(0.012, 0.012, 1.0)}
    campaign = record(tmp_path / "campaign", 7040, tier=ROUGH, plan=standard_plan(), **noisy)
    channel = build_channel(campaign, "temperature")
    noise = estimate_noise(channel)
    white = replace(noise, white=noise.standard_deviation, correlated=0.0)
    honest = make_problem(channel, whiteners(channel, noise))
    wrong = make_problem(channel, whiteners(channel, white))
    assert judge(honest, plain_fit(honest)).passed
    assert not judge(wrong, plain_fit(wrong)).passed
