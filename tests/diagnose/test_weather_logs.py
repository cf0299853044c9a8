"""A weather sensor's log between a room and a cold box, from log to verdict; `benchmarks/weather_logs.py` has many."""

import json

import numpy as np
import pytest
from benchmark_scripts import benchmark

from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.without_model import estimate_start
from shockrig.files.campaign import read_campaign


@pytest.mark.trial
def test_a_weather_sensors_log_gives_its_response_and_no_false_name():
    trials = benchmark("weather_logs")
    one = trials.trial(803)
    assert one["found"] == trials.TRANSFERS and one["others"] <= 1
    assert one["fan"] > 1.5
    t63_s, uncertainty_s = one["t63"]
    assert abs(t63_s - one["t63_s"]) < 2.0 * uncertainty_s < 0.1 * one["t63_s"]
    assert one["wrong"] == [] and set(one["named"]["temperature"]) == {"series_lag", trials.FAN}
    plain, extended = one["fresh"]["temperature"]
    assert extended < 0.5 * plain
    assert one["failed"] == {}


@pytest.mark.trial
def test_a_box_before_a_fan_is_no_air_that_is_late_both_ways():
    """A late air and another rate in one of two places, together, are a lag of the sensor's own by another name."""
    one = benchmark("weather_logs").trial(802)
    t63_s, uncertainty_s = one["t63"]
    assert abs(t63_s - one["t63_s"]) < min(2.0 * uncertainty_s, 0.1 * one["t63_s"])
    assert "series_lag" in one["named"]["temperature"] and one["wrong"] == []


def test_the_truth_is_that_of_two_lags():
    """As one of them vanishes, 63 % are reached after the other's time constant."""
    trials = benchmark("weather_logs")
    assert np.isclose(trials.Sensor(100.0, 1e-3, 10.0, 1.0, 0.1, 1.0).t63_s, 100.0, rtol=1e-4)
    assert 110.0 < trials.Sensor(100.0, 10.0, 10.0, 1.0, 0.1, 1.0).t63_s < 111.0


def test_a_fit_begins_where_the_import_saw_the_step(tmp_path):
    """A boxed thermometer moves slowly at first, and shows its own start late or early by a tenth of its time to 63 %;
    the film beside it shows it at once."""
    trials = benchmark("weather_logs")
    random = np.random.default_rng(803)
    sensor = trials.draw_sensor(random)
    true_s = np.array(trials.write_log(tmp_path / "log.csv", sensor, random))
    campaign = read_campaign(trials.imported(tmp_path / "log.csv", tmp_path))
    channel = build_channel(campaign, "temperature")
    off_s, alone_s = [], []
    for run, at_s, scatter_s in zip(
        channel.run_ids, channel.conditions.start_s, channel.conditions.start_scatter_s, strict=True
    ):
        head = json.loads((campaign.path / "runs" / run / "run.json").read_text())
        begin_s = float(head["imported"]["at"]) - head["step_seen_s"]
        true = true_s[np.abs(true_s - begin_s - at_s).argmin()] - begin_s
        assert scatter_s == head["step_seen_standard_uncertainty_s"] and abs(at_s - true) < 2.0 * scatter_s
        off_s.append(at_s - true)
        (trace,) = (one.imet for one in campaign.runs if one.id == run)
        alone_s.append(estimate_start(trace.time_s, trace.values["temperature_c"]) - true)
    assert len(off_s) == trials.TRANSFERS and not channel.conditions.start_known.any()
    assert np.abs(off_s).max() < 0.01 * sensor.t63_s < np.abs(alone_s).min()
