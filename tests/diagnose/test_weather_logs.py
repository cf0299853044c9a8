"""A weather sensor's log between a room and a cold box, from log to verdict; `benchmarks/weather_logs.py` has many."""

import numpy as np
import pytest
from benchmark_scripts import benchmark


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
