"""Blind trials: effects are hidden by a seeded draw, the files are diagnosed, and only then the seal is opened.

A small fixed sample of benchmarks/diagnosis_trials.py; the full table is kept in benchmarks/results.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from benchmark_scripts import benchmark
from small_worlds import record

from shockrig.analysis.diagnosis.adequacy import judge
from shockrig.analysis.diagnosis.refitting import plain_fit
from shockrig.analysis.inference.gather import build_channel
from shockrig.analysis.inference.noise import estimate_noise, whiteners
from shockrig.analysis.inference.problem import make_problem
from shockrig.rig.virtual import plans
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import ROUGH, Noise

trials = benchmark("diagnosis_trials")


@pytest.mark.parametrize("seed", range(7000, 7003))
def test_one_comfortable_effect_is_named_and_nothing_else(seed):
    result = trials.trial("one", "rough", "comfortable", seed)
    assert result["score"].exact, trials.line(seed, result)


@pytest.mark.parametrize("seed", range(7010, 7012))
def test_nothing_is_named_where_nothing_is_hidden(seed):
    result = trials.trial("none", "rough", "comfortable", seed)
    for name, channel in result["diagnosis"]["channels"].items():
        assert channel["verdict"] == "adequate", (seed, name, channel["causes"])
        assert channel["causes"] == []


def test_the_ordinary_bench_is_untangled(monkeypatch):
    """Nor does a lag stand in the place of a slow transfer: the fit without the lag ends at five times the film's Biot
    number, and no transfer leads back from there. The world is that in which it was seen, recorded without the run that
    closes the campaign: with one run more all of its noise is drawn anew."""
    monkeypatch.setattr(plans, "standard_plan", lambda: standard_plan()[:-1])
    result = trials.trial("ordinary", "rough", "comfortable", 47706)
    assert result["score"].exact, trials.line(47706, result)
    for channel in result["diagnosis"]["channels"].values():
        gain = channel["gain"]
        assert gain["held_out_rmse_after"] < 1.3 * gain["noise_floor"] < 0.5 * gain["held_out_rmse_before"]


@pytest.mark.parametrize(
    ("seed", "verdict", "described"),
    [(7033, "unexplained", [("periodic", [])]), (7034, "described", [("rate_change", ["ambient"])])],
)
def test_what_no_catalogue_holds_is_described_as_far_as_it_can_be(seed, verdict, described):
    """A hum whose bursts are left over; a bead whose rate moves with the ambient, which leaves nothing."""
    result = trials.trial("outside", "rough", "comfortable", seed)
    told = result["diagnosis"]["channels"]["temperature"]
    behaviours = [(one["behaves_as"], [on["factor"] for on in one["depends_on"]]) for one in told["discovered"]]
    assert (told["verdict"], told["causes"], behaviours) == (verdict, [], described)
    for name, scored in result["score"].channels.items():
        assert scored.verdict_right, (seed, name)
        assert not scored.wrong, (seed, name, scored.wrong)


def test_runs_that_differ_by_chance_are_no_second_effect():
    """Two or three runs in each ambient and direction say little of how much runs differ in their rate."""
    result = trials.trial("one", "rough", "limit", 47107)
    assert result["score"].exact, trials.line(47107, result)


def test_a_coarse_resolution_is_no_other_effect():
    """Rounded to 0.6 %RH beside 0.07 %RH of noise: a plateau's error is one code's, not white noise."""
    result = trials.trial("quantization", "rough", "comfortable", 7051)
    assert result["score"].exact, trials.line(7051, result)


def test_an_average_that_hides_its_own_noise_is_no_ramp():
    """A mean over eleven readings leaves less noise than the logger's step: only the response can tell."""
    result = trials.trial("moving_average", "rough", "comfortable", 7063)
    assert result["score"].exact, trials.line(7063, result)


def test_a_wrong_noise_model_is_caught(tmp_path):
    """Guards the calibration: were correlated noise taken for white, plain campaigns would raise false alarms."""
    noisy = {"temperature_noise": Noise(0.012, 0.012, 1.0)}
    campaign = record(tmp_path / "campaign", 7040, tier=ROUGH, plan=standard_plan(), **noisy)
    channel = build_channel(campaign, "temperature")
    noise = estimate_noise(channel)
    white = replace(noise, white=noise.standard_deviation, correlated=0.0)
    honest = make_problem(channel, whiteners(channel, noise))
    wrong = make_problem(channel, whiteners(channel, white))
    assert judge(honest, plain_fit(honest), noise).passed
    assert not judge(wrong, plain_fit(wrong), white).passed
