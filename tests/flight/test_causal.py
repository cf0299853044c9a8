"""The causal corrector: the smoother's filter row by row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from shockrig.analysis.flight import causal_bank
from shockrig.analysis.flight.air_prior import OU_VARIANCES, RATES_PER_S, UNSEEN_VARIANCE, Prior
from shockrig.analysis.flight.causal_bank import FILTER_COUNT, Bank, half_width
from shockrig.analysis.flight.causal_design import HUMIDITY_LADDER, TEMPERATURE_LADDER, Ladder, design_of
from shockrig.analysis.flight.causal_guard import Guard
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.response import LagResponse, bead_response, film_response, hold
from shockrig.analysis.flight.simulated.scenes import to_flight
from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import inversion
from shockrig.analysis.flight.smoother import smooth
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.files.flight import Flight
from shockrig.files.profile import StatedEffect, Uncertain
from shockrig.protocols.cli import main

START, ROWS = 600, 600  # of the simulated flight: through the inversion


@pytest.fixture(scope="module")
def flown():
    profile = typical_profile()
    one = fly(inversion(np.random.default_rng([3, 1])), profile, 3)
    flight = to_flight(one.log.iloc[START : START + ROWS])
    return flight, profile, one.truth.iloc[START : START + ROWS].reset_index(drop=True)


def test_at_one_strength_the_last_row_is_the_smoother_s(monkeypatch):
    rng = np.random.default_rng(0)
    rate, weight, strength, count = np.array([0.4, 3.0]), np.array([0.8, 0.2]), 0.3, 80
    reading = 20.0 + 0.1 * np.cumsum(rng.standard_normal(count))
    monkeypatch.setattr(Bank, "_strengths", lambda self: np.full(FILTER_COUNT, strength**2))
    monkeypatch.setattr(Bank, "_bends", lambda self: np.full(FILTER_COUNT, strength**2))
    bank = Bank(Ladder(strength, strength, strength), 2, False)
    bank.start(reading[0], 2.0, weight)
    bank.update(reading[0], 0.01)
    for value in reading[1:]:
        bank.predict(0.1, weight, rate)
        bank.update(value, 0.01)
    found = bank.now()
    air, variance = found.value, found.variance
    assert found.stated == pytest.approx(variance, rel=1e-3)  # of filters that are all alike

    one = np.ones((1, count))
    response = LagResponse(one[..., None] * weight, one[..., None] * rate, one)
    prior = Prior(strength * one, strength * one, 0.1 * one)
    lags = np.full((1, 2), reading[0])
    whole = smooth(0.1 * one, reading[None], 0.01 * one, response, lags, prior, np.array([2.0]))
    assert air == pytest.approx(whole.air[0, -1], abs=1e-8)
    seen = variance / bank.unsure - UNSEEN_VARIANCE * strength**2
    assert seen == pytest.approx(whole.variance[0, -1], rel=1e-5)


def turbulent(rng, strength, count, step_s=0.1, tau_s=0.2):
    """Air of turbulence, of one strength or of one for each row, on a straight trend, and what a sensor of one lag
    shows of it."""
    decay, strength = np.exp(-RATES_PER_S * step_s), np.broadcast_to(strength, count)
    state, air = strength[0] * np.sqrt(OU_VARIANCES) * rng.standard_normal(3), np.empty(count)
    for i in range(count):
        air[i] = 20.0 - 0.02 * step_s * i + state.sum()
        state = decay * state + strength[i] * np.sqrt(OU_VARIANCES * (1 - decay**2)) * rng.standard_normal(3)
    shown, old, new, gone = np.empty(count), *hold(np.array([1 / tau_s]), np.array(step_s))
    shown[0] = air[0]
    for i in range(1, count):
        shown[i] = gone[0] * shown[i - 1] + old[0] * air[i - 1] + new[0] * air[i]
    return air, shown


def test_half_of_an_interval_holds_as_much_of_the_filters_together_as_it_says():
    rng = np.random.default_rng(3)
    for _ in range(50):
        likely = rng.dirichlet([1.0, 1.0, 0.3, 0.02]) + 1e-6
        likely, variance = likely / likely.sum(), 10 ** rng.uniform(-6.0, 0.0, FILTER_COUNT)
        off = rng.standard_normal(FILTER_COUNT) * np.sqrt(variance)
        width, sigma = half_width(likely.tolist(), off.tolist(), variance.tolist()), np.sqrt(variance)
        within = likely @ (ndtr((width - off) / sigma) - ndtr((-width - off) / sigma))
        assert within == pytest.approx(0.95, abs=0.001)


def test_a_door_that_nothing_tells_of_widens_no_interval():
    """One row in ten thousand is behind a door: its kelvins are much of calm air's variance, and of no interval."""
    bank, rate, weight, noise = Bank(TEMPERATURE_LADDER, 1, False), np.array([1.0]), np.array([1.0]), 0.02
    rng, covered, ratio = np.random.default_rng(6), [], []
    air, shown = turbulent(rng, 0.01, 1200, tau_s=1.0)
    bank.start(shown[0], 2.0, weight)
    for i, value in enumerate(shown + noise * rng.standard_normal(shown.size)):
        if i:
            bank.predict(0.1, weight, rate)
        bank.update(value, noise**2)
        found = bank.now()
        covered.append(abs(found.value - air[i]) <= 1.96 * np.sqrt(found.stated))
        ratio.append(found.stated / found.variance)
    assert np.median(ratio[300:]) < 0.95
    assert 0.9 < np.mean(covered[300:]) < 0.98


@pytest.mark.parametrize("strength", [0.007, 0.2])
def test_uncertainty_holds_in_weak_and_strong_turbulence_whatever_it_waits_for(strength):
    """The trend is straight: were its bend as strong as the turbulence, weak turbulence would be taken for none."""
    noise, waits = 0.02, (0, 20, 50)
    covered, middle = {wait: [] for wait in waits}, []
    for seed in range(3):
        rng = np.random.default_rng([seed, 5])
        air, shown = turbulent(rng, strength, 1200)
        reading = shown + noise * rng.standard_normal(shown.size)
        bank, rate, weight = Bank(TEMPERATURE_LADDER, 1, False, max(waits)), np.array([5.0]), np.array([1.0])
        bank.start(reading[0], 2.0, weight)
        for i, value in enumerate(reading):
            if i:
                bank.predict(0.1, weight, rate)
            bank.update(value, noise**2)
            bank.keep()
            if i >= 400:
                middle.append(bank.middle)
                for wait in waits:
                    found = bank.ago(wait)
                    covered[wait].append(abs(found.value - air[i - wait]) <= 1.96 * np.sqrt(found.stated))
    for wait in waits:
        assert 0.9 <= np.mean(covered[wait]) <= 0.995, wait
    assert 0.5 * strength < np.median(middle) < 2.0 * strength


def test_a_door_that_nothing_tells_of_makes_no_calm_filter_less_sure(monkeypatch):
    rate, weight, noise = np.array([1.0]), np.array([1.0]), 0.02
    rng, sure = np.random.default_rng(7), []
    reading = turbulent(rng, 0.005, 900, tau_s=1.0)[1] + noise * rng.standard_normal(900)
    for between_s in (causal_bank.BETWEEN_DOORS_S, 1e9):
        monkeypatch.setattr(causal_bank, "BETWEEN_DOORS_S", between_s)
        causal_bank.moves.cache_clear()
        bank, own = Bank(TEMPERATURE_LADDER, 1, False), []
        bank.start(reading[0], 2.0, weight)
        for i, value in enumerate(reading):
            if i:
                bank.predict(0.1, weight, rate)
            bank.update(value, noise**2)
            own.append(bank.now().own[causal_bank.WEAK])
        sure.append(np.sqrt(np.median(own[450:])))
    causal_bank.moves.cache_clear()
    assert sure[0] < 1.1 * sure[1]


def test_turbulence_that_sets_in_is_weighed_and_not_taken_for_bends_and_doors():
    noise, waits, onset, count = 0.02, (0, 20, 50), 600, 1500
    covered, at_first = {wait: [] for wait in waits}, {wait: [] for wait in waits}
    for seed in range(3):
        rng = np.random.default_rng([seed, 11])
        air, shown = turbulent(rng, np.where(np.arange(count) < onset, 0.003, 0.1), count, tau_s=1.0)
        bank, rate, weight = Bank(TEMPERATURE_LADDER, 1, False, max(waits)), np.array([1.0]), np.array([1.0])
        bank.start(shown[0], 2.0, weight)
        for i, value in enumerate(shown + noise * rng.standard_normal(count)):
            if i:
                bank.predict(0.1, weight, rate)
            bank.update(value, noise**2)
            bank.keep()
            for wait in waits:
                if i - wait >= onset + 200 or onset <= i - wait < onset + 50:
                    found, told = bank.ago(wait), covered if i - wait >= onset + 200 else at_first
                    told[wait].append(abs(found.value - air[i - wait]) <= 1.96 * np.sqrt(found.stated))
    for wait in waits:
        assert 0.9 <= np.mean(covered[wait]) <= 0.99, wait
        assert np.mean(at_first[wait]) > 0.6, wait  # in the first five seconds


def test_air_that_falls_calm_is_taken_for_calm_within_twenty_seconds():
    rate, weight, noise, calm, count = np.array([1.0]), np.array([1.0]), 0.02, 0.003, 900
    for seed in range(3):
        rng = np.random.default_rng([seed, 13])
        shown = turbulent(rng, np.where(np.arange(count) < 400, 0.1, calm), count, tau_s=1.0)[1]
        bank, middle = Bank(TEMPERATURE_LADDER, 1, False), []
        bank.start(shown[0], 2.0, weight)
        for i, value in enumerate(shown + noise * rng.standard_normal(count)):
            if i:
                bank.predict(0.1, weight, rate)
            bank.update(value, noise**2)
            middle.append(bank.middle)
        assert np.median(middle[200:400]) > 0.05
        assert np.median(middle[600:]) < 3.0 * calm


def test_filters_that_expect_the_same_tell_nothing_of_the_strength():
    bank = Bank(TEMPERATURE_LADDER, 1, False)
    bank.start(20.0, 2.0, np.array([1.0]))
    before = bank.chances
    bank._weigh(np.full(FILTER_COUNT, 3.0), np.full(FILTER_COUNT, 0.2), 0.01)
    np.testing.assert_allclose(bank.chances, before)
    bank._weigh(np.full(FILTER_COUNT, 0.1), 0.01 * causal_bank.TURBULENCE[[0, 1, 2, 2]] ** 2, 0.01)
    assert bank.middle < TEMPERATURE_LADDER.middle  # nearer than at any of them is likely


def test_where_readings_say_little_the_strength_goes_to_the_usual_one():
    bank, rate, weight = Bank(HUMIDITY_LADDER, 1, False), np.array([0.01]), np.array([1.0])
    bank.start(50.0, 10.0, weight, usual=0.5)
    bank.chances = np.eye(causal_bank.STRENGTHS_WEIGHED)[-1]
    for _ in range(3000):
        bank.predict(0.1, weight, rate, usual=0.5)
        bank.update(50.0, 100.0)
    assert bank.middle == pytest.approx(0.5, rel=0.2)


def test_a_start_takes_the_strength_that_is_usual():
    bank, weight = Bank(HUMIDITY_LADDER, 1, False), np.array([1.0])
    bank.start(50.0, 10.0, weight, usual=0.5)
    assert bank.middle == 0.5
    np.testing.assert_allclose(bank.p[0, 2:5, 2:5].diagonal(), (0.5 * causal_bank.TURBULENCE[0]) ** 2 * OU_VARIANCES)


def test_strength_goes_with_the_usual_one_at_once():
    """The same eddies carry vapour and temperature: what the bead learns of them in seconds holds for the film."""
    bank, rate, weight = Bank(HUMIDITY_LADDER, 1, False), np.array([0.1]), np.array([1.0])
    bank.start(50.0, 10.0, weight, usual=0.1)
    middles = []
    for usual in (0.1, 1.0, 0.2):
        bank.predict(0.1, weight, rate, usual=usual)
        middles.append(bank.middle)
    assert middles == pytest.approx([0.1, 1.0, 0.2])


@pytest.mark.parametrize(("decimals", "step"), [(0, 1.0), (1, 0.1), (2, 0.01), (4, 0.0)])
def test_a_log_that_hardly_changes_tells_its_step_by_its_decimals(decimals, step):
    """In calm air coarse readings stay where they are, and their changes tell nothing of a step."""
    guard = Guard(design_of(typical_profile(), 1.0).humidity, ())
    for value in np.round([47.3123, 47.3123, 47.4321, 47.4321], decimals):
        judged = guard.judge(float(value), float(value), 1.0)
    assert guard.resolution == step
    guard.judge(48.01, 48.01, 1.0)  # near a whole one, and none
    assert guard.resolution == min(step, 0.01)
    assert judged.variance >= step**2 / 12.0


def test_coarse_readings_of_calm_air_are_within_their_rounding():
    time_s, rng, unknown = np.arange(200.0), np.random.default_rng(8), np.full(200, np.nan)
    temperature = np.round(21.43 + 0.02 * rng.standard_normal(200), 1)
    humidity = np.round(47.38 + 0.06 * rng.standard_normal(200))
    done = correct(
        Flight(time_s, temperature, humidity, unknown, unknown, unknown), typical_profile(), "causal", lag_s=5.0
    )
    off = np.abs(done.humidity_percent - 47.38)[5:]
    assert np.mean(off <= 1.96 * done.humidity_uncertainty_percent[5:]) > 0.9


def test_a_repeat_by_chance_is_one_in_single_precision_too():
    """A step of 0.01 K between such numbers is off by 2e-4, and a share of repeats may be as near to what is usual."""
    rng, rows = np.random.default_rng(9), 1700
    reading = np.round(20.0 + np.cumsum(0.01 * rng.standard_normal(2000)) + 0.02 * rng.standard_normal(2000), 2)
    repeats = rng.random(2000) < 0.15
    for row in range(1, rows):
        reading[row] = reading[row - 1] if repeats[row] else reading[row]
    said = []
    for log in (reading[:rows], reading[:rows].astype(np.float32)):
        guard = Guard(design_of(typical_profile(), 0.1).temperature, ())
        said.append([guard.judge(value, value, 0.05).repeated for value in log.tolist()])
    assert sum(said[0]) > 200 and said[0] == said[1]


def test_what_goes_through_readings_with_temperature_is_no_noise_of_theirs():
    design = design_of(typical_profile(), 0.1).humidity
    reading = 50.0 + np.hypot(design.noise, 0.5) * np.random.default_rng(2).standard_normal(400)
    factors = []
    for alike in (0.5, 0.0):
        guard = Guard(design, ())
        for value in reading:
            guard.judge(value, value, 1.0, alike)
        factors.append(guard._usual(guard.usual))
    assert factors[0] == pytest.approx(1.0, abs=0.3) and factors[1] > 4.0


def test_a_start_in_the_cold_is_as_unsure_as_one_in_the_warmth():
    """It says within how many %RH the film is of the air; what little vapour cold air holds changes nothing there."""
    time_s, rng = np.arange(100) * 0.1, np.random.default_rng(4)
    stated = []
    for air_c in (-9.0, 35.0):
        unknown = np.full(time_s.size, np.nan)
        temperature = air_c + 0.02 * rng.standard_normal(time_s.size)
        humidity = 50.0 + 0.06 * rng.standard_normal(time_s.size)
        flight = Flight(time_s, temperature, humidity, unknown, unknown, unknown)
        stated.append(correct(flight, typical_profile(), "causal").humidity_uncertainty_percent[0])
    assert max(stated) < 25.0 and max(stated) < 1.5 * min(stated)


@pytest.mark.parametrize("lag_s", [0.0, 1.0])
def test_a_row_knows_nothing_of_what_comes_after_its_lag(flown, lag_s):
    flight, profile, _ = flown
    at, wait = 300, round(lag_s / 0.1)
    later = {}
    for name in ("temperature_c", "humidity_percent"):
        values = getattr(flight, name).copy()
        values[at + wait + 1 :] += 3.0
        later[name] = values
    first, other = (correct(f, profile, "causal", lag_s=lag_s) for f in (flight, replace(flight, **later)))
    for name in ("temperature_c", "humidity_percent", "humidity_uncertainty_percent"):
        np.testing.assert_array_equal(getattr(first, name)[: at + 1], getattr(other, name)[: at + 1])
    assert np.any(first.temperature_c[at + 1 + wait :] != other.temperature_c[at + 1 + wait :])


def test_waiting_brings_the_smoother_nearer_and_uncertainties_hold(flown):
    flight, profile, truth = flown

    def error(done):
        off = done.temperature_c - truth["temperature_c"], done.humidity_percent - truth["humidity_percent"]
        return np.array([np.sqrt(np.mean(one[50:] ** 2)) for one in off])

    smoother = error(correct(flight, profile))
    at_once, waited = (correct(flight, profile, "causal", lag_s=lag_s) for lag_s in (0.0, 2.0))
    assert np.all(error(waited) < error(at_once))
    assert np.all(error(waited) < 2.5 * smoother)
    for done in (at_once, waited):
        off = np.abs(done.humidity_percent - truth["humidity_percent"])[50:]
        assert np.mean(off <= 1.96 * done.humidity_uncertainty_percent[50:]) > 0.85


def test_rows_that_an_end_cuts_short_are_their_own():
    """Where a log ends the last rows wait for less. They were given the air of up to half of the wait before them."""
    time_s, rng = 0.1 * np.arange(500), np.random.default_rng(15)
    swing = 10.0 * np.sin(2.0 * np.pi * time_s / 20.0) + 0.05 * rng.standard_normal(500)
    temperature, unknown = 20.0 + 0.01 * rng.standard_normal(500), np.full(500, np.nan)
    log = Flight(time_s, temperature, 50.0 + swing, unknown, unknown, unknown)
    whole, cut = (correct(log.at(slice(end)), typical_profile(), "causal", lag_s=5.0) for end in (500, 420))
    off = np.abs(cut.humidity_percent - whole.humidity_percent[:420])
    assert np.all(off[370:] <= 4.0 * cut.humidity_uncertainty_percent[370:])


def test_what_is_no_reading_is_told_and_bridged(flown):
    flight, profile, truth = flown
    temperature, humidity, time_s = (
        one.copy() for one in (flight.temperature_c, flight.humidity_percent, flight.time_s)
    )
    temperature[[100, 101]] = -99.0
    temperature[150] = 6526.9
    temperature[200:215] = np.nan
    humidity[180] = 0.0
    humidity[400:480] = humidity[400]
    time_s[500] = time_s[400]
    damaged = replace(flight, time_s=time_s, temperature_c=temperature, humidity_percent=humidity)
    done = correct(damaged, profile, "causal")
    flags = done.flags
    assert np.flatnonzero(flags["implausible"]).tolist() == [100, 101, 150, 180, 500]
    assert flags["gap"][200:215].all() and not flags["gap"][215:].any()
    assert flags["repeated"][402:480].all()
    given = np.delete(done.temperature_c, 500)
    assert np.isfinite(given).all()
    assert np.isnan(done.temperature_c[500])
    off = np.abs(done.temperature_c - truth["temperature_c"])[[100, 101, 150]]
    assert np.all(off < 4.0 * done.temperature_uncertainty_k[[100, 101, 150]])


def test_a_clock_that_was_set_back_costs_a_few_rows(flown):
    flight, profile, _ = flown
    time_s = flight.time_s.copy()
    time_s[300:] -= 25.0
    done = correct(replace(flight, time_s=time_s), profile, "causal")
    lost = np.flatnonzero(~np.isfinite(done.temperature_c))
    assert lost.tolist() == list(range(300, 305))


def test_readings_that_jump_and_stay_are_believed_after_a_second(flown):
    flight, profile, _ = flown
    temperature = flight.temperature_c.copy()
    temperature[300:] += 40.0
    done = correct(replace(flight, temperature_c=temperature), profile, "causal")
    refused = np.flatnonzero(done.flags["implausible"])
    # the vapour that humidity stands for at another temperature jumps with it
    assert refused[:9].tolist() == list(range(300, 309)) and refused[-1] < 320
    assert np.abs(done.temperature_c[320:] - temperature[320:]).max() < 1.0


def test_beyond_the_table_the_reading_is_given(flown):
    flight, profile, _ = flown
    film = replace(profile.humidity, diffusivity_table=profile.humidity.diffusivity_table[:1])
    done = correct(flight, replace(profile, humidity=film), "causal")
    np.testing.assert_array_equal(done.humidity_percent, flight.humidity_percent)
    assert done.flags["outside_profile"].all() and done.flags["humidity_not_corrected"].all()


def test_tables_hold_what_the_physics_says_between_their_nodes():
    number = {"biot_at_5_m_s": Uncertain(3.0, 0.1)}
    profile = typical_profile()
    bead = replace(profile.temperature, effects=(StatedEffect("convective_film", number),))
    design = design_of(replace(profile, temperature=bead))
    rng = np.random.default_rng(1)
    stream = Stream(rng.uniform(0.5, 25.0, 40), rng.uniform(500.0, 1050.0, 40), rng.uniform(-9.0, 39.0, 40))
    for one, response in (
        (design.temperature, bead_response(bead, stream)),
        (design.humidity, film_response(profile.humidity, stream.temperature_c, stream)),
    ):
        mean_lag = (response.weight / response.rate).sum(axis=1)
        for i in range(40):
            values = one.response.at(stream.temperature_c[i], stream.airflow_m_s[i], stream.pressure_hpa[i])
            lag = np.sum(values[: one.modes] / np.exp(values[one.modes : 2 * one.modes]))
            assert lag == pytest.approx(mean_lag[i], rel=0.01)


def test_the_command_corrects_causally_and_refuses_a_lag_of_the_smoother(tmp_path, flown, capsys):
    flight, _, _ = flown
    assert main(["simulate", "inversion", "--out", str(tmp_path)]) == 0
    log, profile = str(tmp_path / "flight.csv"), str(tmp_path / "profile.json")
    lines = (tmp_path / "flight.csv").read_text().splitlines(keepends=True)[:300]
    (tmp_path / "flight.csv").write_text("".join(lines))
    out = str(tmp_path / "corrected.csv")
    assert main(["correct", log, "--profile", profile, "--out", out, "--lag-s", "2"]) == 2
    assert "only --method causal waits" in capsys.readouterr().err
    assert main(["correct", log, "--profile", profile, "--out", out, "--method", "causal", "--lag-s", "2"]) == 0
    assert "299 rows, method causal" in capsys.readouterr().out
    assert main(["correct", log, "--profile", profile, "--out", out, "--method", "causal", "--lag-s", "200"]) == 2
    assert "smoother is for" in capsys.readouterr().err


def test_what_cannot_be_corrected_is_given_as_it_came(flown):
    flight, profile, _ = flown
    nothing = np.full(ROWS, np.nan)
    done = correct(replace(flight, temperature_c=nothing), profile, "causal")
    np.testing.assert_array_equal(done.humidity_percent, flight.humidity_percent)
    assert done.flags["not_corrected"].all() and any("no temperature of the air" in note for note in done.notes)
    for part, other in (("temperature", "humidity_percent"), ("humidity", "temperature_c")):
        done = correct(flight, replace(profile, **{part: None}), "causal")
        assert done.flags[f"{part}_not_corrected"].all() and not done.flags["not_corrected"].any()
        assert np.isfinite(getattr(done, other)).all()
