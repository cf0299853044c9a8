"""Steps of a log's clock: set while readings ran on, or after rows that nobody has."""

import re
from dataclasses import replace

import numpy as np
import pandas
import pytest

from shockrig.analysis.flight.correct import correct, in_order
from shockrig.analysis.flight.doubts import doubts
from shockrig.analysis.flight.inverse import RefusedError
from shockrig.analysis.flight.response import film_response
from shockrig.analysis.flight.screen import clock
from shockrig.analysis.flight.simulated.scenes import to_flight
from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import inversion
from shockrig.analysis.flight.sweep import lags_behind
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.files.flight import Flight
from shockrig.files.numbers import moment

PROFILE = typical_profile()


def rms(error):
    return float(np.sqrt(np.nanmean(np.square(error))))


@pytest.fixture(scope="module")
def flown():
    return fly(inversion(), PROFILE, 4)


@pytest.mark.parametrize("by", [-20.0, 30.0])
def test_a_clock_that_was_set_while_readings_ran_on_costs_nothing(flown, by):
    log, truth = flown.log.copy(), flown.truth["humidity_percent"].to_numpy()
    untouched = correct(to_flight(log), PROFILE).humidity_percent
    log.loc[600:, "time_s"] += by
    found = correct(to_flight(log), PROFILE)
    assert any("clock steps" in note and "run on" in note for note in found.notes)
    assert rms(found.humidity_percent - truth) < 1.02 * rms(untouched - truth)


@pytest.mark.parametrize("known", ["altitude_m", "pressure_hpa"])
def test_rows_that_a_receiver_lost_are_told_by_where_the_balloon_went(known):
    """A slow sensor in a balloon of which packets come every 5 s, or some of 30 s, and none in a minute. Before: "the
    readings run on, it was set", 300 m further up: the minute was taken for one row."""
    rng = np.random.default_rng(3)
    ahead = np.where(rng.random(700) < 0.15, 30.0, 5.0)
    ahead[[300, 400, 500]] = 60.0
    time_s = np.cumsum(ahead)
    rises = 5.0 * time_s
    where = {"altitude_m": rises, "pressure_hpa": 1013.0 * np.exp(-rises / 8000.0)}[known]
    unknown = dict.fromkeys(("airspeed_m_s", "die_temperature_c", "pressure_hpa"), np.full(time_s.size, np.nan))
    temperature = np.round(25.0 - 1e-3 * rises + 5.0 * np.sin(time_s / 2000.0), 1)
    flight = Flight(time_s=time_s, temperature_c=temperature, humidity_percent=np.full(time_s.size, 6.0), **unknown)
    part, _, said = in_order(replace(flight, **{known: where}))
    assert len(said) == 3 and all("a gap" in one for one in said)
    assert np.ptp(part.time_s) > np.ptp(time_s)


def test_rows_that_are_lost_part_the_log_and_the_film_starts_from_rest():
    """A slow film through a steep change while nothing was recorded: afterwards the air before it tells nothing."""
    rng = np.random.default_rng(2)
    count, at = 2400, 1200
    time_s = np.arange(count) * 0.1
    humidity = np.where(np.arange(count) < at, 45.0, 22.0) + 0.06 * rng.standard_normal(count)
    temperature = 20.0 + 0.02 * rng.standard_normal(count)
    time_s[at:] -= 70.0
    seen = clock(time_s, 120.0, (temperature, humidity))
    assert [(step.row, step.runs_on) for step in seen.steps] == [(at, False)]
    log = pandas.DataFrame({"time_s": time_s, "temperature_c": temperature, "humidity_percent": humidity})
    found = correct(to_flight(log), PROFILE)
    assert any("a gap, across which nothing is concluded" in note for note in found.notes)
    truth = np.where(np.arange(count) < at, 45.0, 22.0)
    assert np.nanmax(np.abs(found.humidity_percent - truth)) < 3.0
    assert rms(found.humidity_percent - truth) < 1.02 * rms(humidity - truth)


def test_readings_on_the_ground_before_a_long_gap_are_the_airs():
    """A slow log of a warm launch site, 27 minutes without a row, and what is far colder up there until it lands."""
    rng = np.random.default_rng(5)
    ground, aloft = 280, 160
    time_s = 12.0 * np.arange(ground + aloft + 150)
    time_s[ground:] += 1600.0
    time_s[ground + aloft :] += 3800.0
    level = np.concatenate([np.linspace(22.0, 13.0, ground), np.linspace(-35.0, -3.0, aloft), np.full(150, 23.7)])
    log = pandas.DataFrame({"time_s": time_s, "temperature_c": level + 0.03 * rng.standard_normal(level.size)})
    found = correct(to_flight(log.assign(humidity_percent=np.nan)), PROFILE)
    assert np.count_nonzero(found.flags["implausible"]) == 0
    assert rms(found.temperature_c - level) < 0.1


def test_a_code_behind_a_restart_tells_nothing_of_the_rows_before_the_gap():
    """The temperature is vague in the row before the gap and in the one behind it: for a second, and not for all of
    the gap."""
    rng = np.random.default_rng(7)
    rows = np.arange(240)
    warm = rows <= 100
    truth = np.where(warm, 17.0, 46.0)
    temperature = np.where(warm, 24.6, 8.9) + 0.02 * rng.standard_normal(240)
    temperature[100] = 85.0
    humidity = truth + 0.06 * rng.standard_normal(240)
    time_s = np.where(rows < 100, rows, rows - 100.0)
    log = pandas.DataFrame({"time_s": time_s, "temperature_c": temperature, "humidity_percent": humidity})
    found = correct(to_flight(log), PROFILE)
    assert any("a gap, across which nothing is concluded" in note for note in found.notes)
    assert rms(found.humidity_percent - truth) < 1.02 * rms(humidity - truth)


def test_a_channel_that_runs_on_does_not_outvote_one_that_does_not():
    rng = np.random.default_rng(5)
    time_s = np.arange(1000) * 0.1
    time_s[500:] += 40.0
    going = 20.0 + 0.02 * np.arange(1000) + 0.02 * rng.standard_normal(1000)
    bent = np.where(np.arange(1000) < 500, 0.0, 0.004 * (np.arange(1000) - 500.0)) + 0.001 * rng.standard_normal(1000)
    assert clock(time_s, 120.0, (going,)).steps[0].runs_on
    assert not clock(time_s, 120.0, (going, bent)).steps[0].runs_on
    assert not clock(time_s, 120.0).steps[0].runs_on


@pytest.mark.parametrize("noise", [0.001, 0.02, 0.3])
def test_a_logger_that_pauses_where_readings_stand_still_was_not_set(noise):
    """A dive to water of one temperature and back, no rows for half a minute at the bottom, and calm air throughout:
    readings run on as they would have with as many rows left out. Before: "it was set", and half a minute was lost."""
    rng = np.random.default_rng(8)
    time_s = 1.5 * np.arange(1200) + np.where(np.arange(1200) < 600, 0.0, 30.0)
    depth_m = 0.3 * np.minimum(np.arange(1200), 1200 - np.arange(1200))
    dive = 10.0 + 15.0 * np.exp(-depth_m / 40.0)
    for still in (dive, np.full(1200, 20.0)):
        (step,) = clock(time_s, 120.0, (still + noise * rng.standard_normal(1200),)).steps
        assert (step.row, step.runs_on) == (600, False)
    # and where they go fast, in the middle of the way down, they would have shown it
    time_s = 1.5 * np.arange(1200) + np.where(np.arange(1200) < 150, 0.0, 30.0)
    assert clock(time_s, 120.0, (dive + 0.001 * rng.standard_normal(1200),)).steps[0].runs_on


@pytest.mark.parametrize("by", [0.0, -75.0])
def test_times_that_are_said_are_the_logs_own(flown, by):
    """Rows lost for 20 s, and a clock that starts anew behind them or not; later the hygrometer jumps and the bead goes
    alone. Before: every time behind the step was said 100 s late, or by whatever a step is parted by."""
    log = flown.log.drop(index=range(100, 300)).reset_index(drop=True)
    log.loc[100:, "time_s"] += by
    log.loc[600:, "humidity_percent"] += 6.0
    log.loc[300:330, "temperature_c"] += 4.0
    notes = correct(to_flight(log), PROFILE).notes
    assert any("a gap, across which nothing is concluded" in note for note in notes)
    jumped = float(log["time_s"][600])
    assert any(note.startswith(f"humidity: at {jumped:.10g} s the reading jumps") for note in notes)
    said = [float(one) for note in notes for one in re.findall(r"(?:at|from|until|between|and|to) (-?[0-9.]+) s", note)]
    assert said and all(np.abs(log["time_s"] - one).min() < 0.05 for one in said)


@pytest.mark.parametrize(("begins_s", "unit"), [(0.0, " s"), (1626887912.0, " UTC")])
def test_times_that_are_said_are_dates_where_the_log_has_dates(flown, begins_s, unit):
    """Before: "the clock steps by +47 s to 1626889716 s", of a log in which that stood nowhere."""
    log = flown.log.drop(index=range(100, 300)).reset_index(drop=True)
    log["time_s"] += begins_s
    log.loc[600:, "humidity_percent"] += 6.0
    notes = correct(to_flight(log), PROFILE).notes
    said = [note for note in notes if "the clock steps" in note or "the reading jumps" in note]
    assert len(said) == 2 and all(unit in note for note in said)
    assert not any(re.search(r"\d{9}", note) for note in notes)
    behind = f"{begins_s + 30.0:.10g} s" if unit == " s" else "2021-07-21 17:19:02 UTC"
    assert any(f"the clock steps by +20.1 s to {behind}" in note for note in notes)


def test_a_time_is_written_as_the_log_has_it():
    assert moment(12.34) == "12.34 s" and moment(-3.0) == "-3 s" and moment(float("nan")) == "nan s"
    assert moment(1626887912.25) == "2021-07-21 17:18:32.25 UTC"
    assert moment(1626887911.9999) == "2021-07-21 17:18:32 UTC"


def test_dates_of_two_days_are_no_milliseconds(flown):
    """Two flights in a log, a day apart. Before: "if these are milliseconds, divide by 1000"."""
    log = flown.log.iloc[::30].reset_index(drop=True)
    time_s = 30.0 * np.arange(len(log)) + np.where(np.arange(len(log)) > 20, 90000.0, 0.0)
    for begins_s, doubted in ((0.0, True), (1626887912.0, False)):
        notes = doubts(to_flight(log.assign(time_s=time_s + begins_s)))
        assert any("if these are milliseconds" in note for note in notes) == doubted


def test_an_inverse_says_where_the_log_leaps_in_its_own_times():
    """A logger that wakes for half a second once a minute. Before: "leaps by 120 s", which it nowhere does."""
    time_s = (60.0 * np.arange(40)[:, None] + 0.1 * np.arange(6)).ravel()
    some = np.random.default_rng(3).standard_normal(time_s.size)
    log = pandas.DataFrame({"time_s": time_s, "temperature_c": 20.0 + 0.02 * some, "humidity_percent": 50.0 + some})
    with pytest.raises(RefusedError, match=r"time_s leaps by 59.5 s at \d+\.5 s"):
        correct(to_flight(log), PROFILE, "inverse")


def test_lags_start_from_rest_where_nothing_before_tells():
    response = film_response(PROFILE.humidity, np.full(100, 20.0), Stream(np.full(100, 5.0)))
    values = np.concatenate([np.full(50, 5.0), np.full(50, 1.0)])
    broken = np.zeros(100, dtype=bool)
    broken[[0, 50]] = True
    lags, apart = lags_behind(values, response, 0.1, broken)
    assert lags[50:] == pytest.approx(np.ones((50, lags.shape[1])))
    assert apart[50:] == pytest.approx(np.zeros((50, lags.shape[1])))
    assert np.abs(lags_behind(values, response, 0.1)[0][50:] - 1.0).max() > 1.0


def test_a_counter_that_begins_anew_was_started_and_not_set():
    """A logger that was switched off and on in still air: that its readings ran on had been concluded, beside a
    sentence that what follows is a piece of its own."""
    time_s = np.concatenate([2.0 + np.arange(300.0), 2.1 + np.arange(300.0)])
    reading = 20.0 + 0.02 * np.random.default_rng(1).standard_normal(time_s.size)
    assert [step.runs_on for step in clock(time_s, 120.0, (reading,)).steps] == [False]
    # of one that counted before the clock of the receiver was known it is not said
    time_s = np.concatenate([500.0 + np.arange(300.0), 200.0 + np.arange(300.0)])
    assert [step.runs_on for step in clock(time_s, 120.0, (reading,)).steps] == [True]
