"""The causal corrector: the smoother's filter row by row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shockrig.analysis.flight.causal_bank import UNSURE_OF_STRENGTH, Bank
from shockrig.analysis.flight.causal_design import Ladder, design_of
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.prior import Prior
from shockrig.analysis.flight.response import LagResponse, bead_response, film_response
from shockrig.analysis.flight.simulated.scenes import to_flight
from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import inversion
from shockrig.analysis.flight.smoother import smooth
from shockrig.analysis.physics.exchange import Stream
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
    monkeypatch.setattr(Bank, "_strengths", lambda self: np.full(3, strength**2))
    bank = Bank(Ladder(strength, strength, strength), 2, False)
    bank.start(reading[0], 2.0, weight)
    bank.update(reading[0], 0.01)
    for value in reading[1:]:
        bank.predict(0.1, weight, rate)
        bank.update(value, 0.01)
    air, variance = bank.now()

    one = np.ones((1, count))
    response = LagResponse(one[..., None] * weight, one[..., None] * rate, one)
    prior = Prior(strength * one, strength * one, 0.1 * one)
    lags = np.full((1, 2), reading[0])
    whole = smooth(0.1 * one, reading[None], 0.01 * one, response, lags, prior, np.array([2.0]))
    assert air == pytest.approx(whole.air[0, -1], abs=1e-8)
    assert variance / UNSURE_OF_STRENGTH == pytest.approx(whole.variance[0, -1], rel=1e-5)


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
