"""What a report says of a few runs by themselves, and of what to record next time."""

from dataclasses import replace

import numpy as np
import pytest

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.seen import seen
from shockrig.analysis.report.next_time import next_time, seen_sentence
from shockrig.files.campaign import read_campaign

TAU_S = 12.0


@pytest.fixture(scope="module")
def whole():
    return build_channel(read_campaign("data/examples/plain-rough"), "temperature")


def unknown(channel: Channel, **known: bool) -> Channel:
    """The channel as if nobody had recorded what is not `known`."""
    no = {name: np.zeros(channel.runs, dtype=bool) for name in ("start_known", "airs_known", "airflow_known")}
    return replace(channel, conditions=replace(channel.conditions, **{k: v for k, v in no.items() if k not in known}))


def lagging(channel: Channel, runs: int = 2) -> Channel:
    """The first runs of a channel with a lag's readings in place of their own."""
    rng = np.random.default_rng(1)
    part = channel.select(np.arange(runs))
    time = np.arange(-60.0, 120.0, 0.5)
    value = 20.0 + 15.0 * -np.expm1(-np.maximum(time, 0.0) / TAU_S)
    return replace(part, samples=tuple((time, value + rng.normal(0.0, 0.01, time.size)) for _ in range(runs)))


def test_times_to_shares_of_the_way_are_those_of_the_closed_form(whole):
    for one in seen(lagging(whole)):
        t63, t90 = one.times_s
        assert t63 == pytest.approx(-TAU_S * np.log(1.0 - 0.632), rel=0.01)
        assert t90 == pytest.approx(TAU_S * np.log(10.0), rel=0.01)


def test_a_humidity_that_the_temperature_changes_is_no_step_of_the_film():
    """Thermal shocks: readings go from 17 to 55 %RH from one to the next, of which the film takes up 2 to 11."""
    film = build_channel(read_campaign("data/examples/plain-rough"), "humidity")
    shown = {one.run: one.times_s for one in seen(film)}
    taken_up = np.abs(film.quantity.step(film.conditions))
    assert set(shown) == {run for run, size in zip(film.run_ids, taken_up, strict=True) if size > 12.0}
    assert min(times[0] for times in shown.values()) > 1.0
    assert not any(said.startswith("Log every") for said in next_time([film.select(np.flatnonzero(taken_up < 12.0))]))


def test_a_burst_of_noise_is_no_crossing(whole):
    """Two seconds beyond the end before the change has gone far, as where somebody touched the sensor."""
    part = lagging(whole, 1)
    ((time, value),) = part.samples
    value = np.where((time > 2.0) & (time < 4.0), 38.0, value)
    (one,) = seen(replace(part, samples=((time, value),)))
    assert one.times_s[0] == pytest.approx(-TAU_S * np.log(1.0 - 0.632), rel=0.02)
    assert one.times_s[1] == pytest.approx(TAU_S * np.log(10.0), rel=0.02)


def test_a_campaign_of_which_all_is_known_is_left_to_the_model(whole):
    assert seen_sentence(whole) == ""
    assert next_time([whole]) == []


def test_what_was_not_recorded_is_asked_for(whole):
    asked = " ".join(next_time([unknown(lagging(whole))]))
    assert "at least 6 transfers" in asked and "(now 2)" in asked
    assert "Log the air" in asked and "Measure the airflow" in asked
    assert "to 0.36 s or better" in asked  # 3 % of the time to 63 %
    assert "Log every" not in asked and "Begin each record" not in asked  # 24 readings in it; five times it before it


def test_readings_are_not_asked_for_oftener_by_less_than_they_tell(whole):
    """A time to 63 % of 12 s, with a reading each 1.6 s: it is known to these, and eight in it are one each 1.5 s."""
    for period_s, asked in ((1.6, False), (1.8, True)):
        said = next_time([unknown(replace(lagging(whole), sampling_period_s=period_s))])
        assert any(one.startswith("Log every") for one in said) == asked


def test_what_was_recorded_is_not_asked_for_again(whole):
    asked = " ".join(next_time([unknown(lagging(whole), start_known=True, airflow_known=True)]))
    assert "Log the air" in asked
    assert "Mark when" not in asked and "airflow" not in asked


def test_a_step_between_two_readings_has_no_time_but_a_bound(whole):
    """Every fiftieth reading: 25 s apart, with two time constants between them."""
    slow = lagging(whole)
    slow = replace(slow, sampling_period_s=25.0, samples=tuple((t[20::50], y[20::50]) for t, y in slow.samples))
    for one in seen(slow):
        assert one.at_most and one.times_s[0] >= TAU_S
    assert "within" in seen_sentence(unknown(slow))
    assert "Log every" in " ".join(next_time([unknown(slow)]))


def test_a_start_that_nobody_saw_makes_no_time_shorter_than_its_readings_are_apart(whole):
    """A plunge between two readings 2 s apart, whose start is taken to lie 0.1 s before the second."""
    part = lagging(whole, 1)
    time = np.arange(-60.0, 60.0, 2.0) + 0.1
    plunge = np.where(time > 0.0, 35.0, 20.0) + np.random.default_rng(2).normal(0.0, 0.01, time.size)
    part = unknown(replace(part, sampling_period_s=2.0, samples=((time, plunge),)))
    (one,) = seen(part)
    assert one.at_most and one.times_s[0] == pytest.approx(2.0, abs=0.01)
    assert "Log every 0.25 s or faster, not every 2 s: 63 % of the way takes 2 s or less." in next_time([part])


def test_noise_that_takes_a_reading_over_and_back_moves_no_time(whole):
    """The first crossing alone would be early."""
    part, rng = lagging(whole, 24), np.random.default_rng(4)
    noisy = replace(part, samples=tuple((t, v + rng.normal(0.0, 0.5, t.size)) for t, v in part.samples))
    t63 = np.array([one.times_s[0] for one in seen(noisy)])
    assert t63.mean() == pytest.approx(-TAU_S * np.log(1.0 - 0.632), rel=0.02)


def test_a_period_that_reads_the_same_is_not_asked_for(whole):
    """Eight readings in the 12 s to 63 % are asked for, one every 1.5 s; 1.53 s is as good."""
    slow = replace(unknown(lagging(whole)), sampling_period_s=1.53)
    assert not any("Log every" in said for said in next_time([slow]))
    assert any("Log every 1.5 s" in said for said in next_time([replace(slow, sampling_period_s=2.0)]))
