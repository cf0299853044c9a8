"""Which column holds what: exchanged columns that are told by what each quantity was last."""

import importlib
from dataclasses import replace

import numpy as np
import pytest
from benchmark_scripts import benchmark

from shockrig.analysis.flight import screen
from shockrig.analysis.flight.columns import ColumnsHold, held
from shockrig.files.flight import Flight

ROW = np.arange(1200)
RESOLUTIONS = (0.01, 0.006)
RNG = np.random.default_rng(11)
AIR = np.round(18.0 + ROW / 600.0 + 0.02 * RNG.standard_normal(ROW.size), 2)
HUMIDITY = 48.0 - ROW / 400.0 + 0.06 * RNG.standard_normal(ROW.size)


def columns(there, temperature=AIR, humidity=HUMIDITY):
    return np.stack([np.where(there, humidity, temperature), np.where(there, temperature, humidity)])


def test_an_end_in_a_gap_of_one_column_is_told_by_what_both_held_last():
    """The other column is missing where the first end is, and both are where the last one is."""
    there = (ROW >= 500) & (ROW < 640)
    log = columns(there)
    log[1, 450:560] = log[:, 630:660] = np.nan
    told = held(log, RESOLUTIONS)
    known = np.isfinite(log).any(axis=0)
    assert np.array_equal(told.exchanged[known], there[known]) and not told.unsure.any()


@pytest.mark.parametrize("there", [np.zeros(ROW.size, dtype=bool), (ROW >= 500) & (ROW < 800)])
@pytest.mark.parametrize("dense", [0, 700])
@pytest.mark.parametrize("quantity", [0, 1])
def test_a_quantity_that_was_read_in_every_tenth_row_goes_as_far_as_in_any_other(quantity, dense, there):
    """Logs that merge 10 Hz and 1 Hz leave cells empty. Before: half of the rows were exchanged, or missing."""
    read = [AIR + 2.0 * np.sin(ROW / 100.0), HUMIDITY - 5.0 * np.sin(ROW / 80.0)]
    read[quantity] = np.where((ROW < dense) | (ROW % 10 == 0), read[quantity], np.nan)
    told = held(columns(there, *read), RESOLUTIONS)
    assert np.array_equal(told.exchanged, there) and not told.unsure.any() and not told.degf.any()


def test_however_long_a_log_with_dropouts_is_nothing_is_exchanged():
    """A chain that was given up counted 691 nats, fewer than any that went on to the end: 17,954 rows exchanged."""
    rng = np.random.default_rng(1)
    log = np.stack([18.0 + 0.02 * rng.standard_normal(36000), 50.0 + 0.1 * rng.standard_normal(36000)])
    log[1, np.cumsum(rng.random(36000) < 0.067) % 2 == 1] = np.nan
    told = held(log, RESOLUTIONS)
    assert not told.exchanged.any() and not told.unsure.any() and not told.degf.any()


def test_columns_that_change_place_again_before_the_last_row_do():
    """The jump into a log's last row was what is usual around it, since that row stood for those behind it."""
    there = (ROW >= 900) & (ROW < ROW.size - 1)
    told = held(columns(there), RESOLUTIONS)
    assert np.array_equal(told.exchanged, there)


def test_a_column_that_was_converted_to_fahrenheit_as_it_held_the_other_quantity_is_told():
    there, converted = (ROW >= 300) & (ROW < 700), (ROW >= 500) & (ROW < 900)
    log = columns(there)
    log[0, converted] = 1.8 * log[0, converted] + 32.0
    told = held(log, RESOLUTIONS)
    assert np.array_equal(told.exchanged, there)
    assert np.array_equal(told.degf.any(axis=0), converted)


def test_a_part_in_fahrenheit_is_one_however_often_it_drops_out():
    """Before: each of its pieces was less likely than one in degC, and from the first row on it was told by nothing."""
    rng = np.random.default_rng(7)
    for there in (ROW < 400, (ROW >= 500) & (ROW < 900)):
        log = np.stack([np.where(there, 1.8 * AIR + 32.0, AIR), HUMIDITY])
        log[0, np.cumsum(rng.random(ROW.size) < 0.1) % 2 == 1] = np.nan
        log[0, :3] = np.nan
        told = held(log, RESOLUTIONS)
        read = np.isfinite(log[0])
        assert np.array_equal(told.degf[0, read], there[read])
        assert not told.exchanged.any() and not told.unsure.any()


def test_columns_that_change_place_across_few_coarse_steps_are_told():
    """At 12 degC in degF beside 50.5 %RH each jumps by six steps, to where the other was. Before: no jump, so exchanged
    from another row on, to the end (in a damaged log 726 values outside, and a humidity 19 times as wrong as read)."""
    there, degf = (ROW >= 500) & (ROW < 700), (ROW >= 400) & (ROW < 690)
    log = columns(there, np.where(degf, 53.6, 12.0), 50.5 + 0.5 * (np.random.default_rng(2).random(ROW.size) < 0.05))
    told = held(log, (0.5, 0.5))
    assert np.array_equal(told.exchanged, there) and not told.unsure.any()
    assert np.array_equal(told.degf[0], degf)


def test_a_part_of_a_log_in_fahrenheit_is_read_as_that():
    """Before: it was left out, and the humidity there was given as it was read."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(300604, list(fuzz.DAMAGE))["humidity_percent"]
    assert found["ours"] < 0.1 * found["reading"]  # 0.65 of it before


def test_where_nothing_tells_which_is_which_no_value_that_cannot_be_comes_out():
    """A humidity that reads 15.5 %RH, a door, and a reading of 15.55 degC halfway through it: exchanged up to there?
    Before: 10 values outside, and the humidity 1.75 times as far off as its reading; 129 if one of both is taken."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(303152, list(fuzz.DAMAGE))
    assert not any(found[channel]["outside"] for channel in fuzz.CHANNELS)


def test_of_a_log_that_is_exchanged_throughout_no_part_is_read_as_degf():
    """It was the humidity that stood there, and what came out as it came was another number."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(202301, list(fuzz.DAMAGE))
    assert not any(found[channel]["outside"] or found[channel]["no_reading"] for channel in fuzz.CHANNELS)


def test_a_code_in_an_exchanged_row_is_no_reading_of_a_log_that_is_given_as_it_came(monkeypatch):
    """Before: the code came through, and the reading beside it was lost."""
    nan = np.nan
    temperature_c, humidity_percent = np.array([20.0, 20.1, 50.0, 51.0]), np.array([50.0, 50.5, -99.9, 20.3])
    flight = Flight(np.arange(4.0), temperature_c, humidity_percent, *np.full((3, 4), nan))
    read = replace(
        flight,
        temperature_c=np.array([20.0, 20.1, nan, 20.3]),  # of the last two rows, whose columns were put back
        humidity_percent=np.array([50.0, 50.5, 50.0, 51.0]),
    )
    correct = importlib.import_module("shockrig.analysis.flight.correct")
    monkeypatch.setattr(correct, "without_codes", lambda _: (read, {correct.EXCHANGED: np.arange(4) > 1}))
    monkeypatch.setattr(correct, "slips", lambda *_: ["exchanged throughout"])
    came, codes = correct.of_both_columns(flight, None)
    np.testing.assert_array_equal(came.temperature_c, flight.temperature_c)
    np.testing.assert_array_equal(came.humidity_percent, [50.0, 50.5, nan, 20.3])
    assert codes == {}


@pytest.mark.parametrize("seed", [204514, 204681, 207017, 208012])
def test_a_part_has_one_cause_and_two_ends(seed):
    """Of exchanged columns beside a burst, coarse steps or a door, and of one in degF that ends in a gap. Before: 5 to
    773 values outside, up to 22 K, since either end had to pay, and what a column usually goes had the jumps in it."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(seed, list(fuzz.DAMAGE))
    assert not any(found[channel]["outside"] for channel in fuzz.CHANNELS)
    assert found["temperature_c"]["ours"] < 0.5 * found["temperature_c"]["reading"]


def test_humidity_goes_with_the_temperature_that_a_door_comes_to():
    """Of a log that is exchanged throughout. Before: the temperature of the one row until it jumps on, so it was taken
    to be exchanged from the door on (499 values outside)."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(209411, list(fuzz.DAMAGE))
    assert not any(found[channel]["outside"] for channel in fuzz.CHANNELS)


def test_nothing_is_filled_in_over_rows_of_which_nothing_tells_what_they_hold(monkeypatch):
    """Before: values up to 5 s from the rows that are sure (in a damaged log 17 K from either reading)."""
    fuzz = benchmark("fuzz_flights")
    _, world, log, _ = fuzz.damaged(202515, ["coarse"])
    time_s, unknown = log.columns["time_s"], np.full(log.columns["time_s"].size, np.nan)
    unsure = (np.arange(time_s.size) > 500) & (time_s < time_s[500] + 4.0)
    none = np.zeros((2, time_s.size), dtype=bool)
    monkeypatch.setattr(screen, "held", lambda *_: ColumnsHold(none[0], unsure, none, none))
    both = (log.columns[name] for name in fuzz.CHANNELS)
    found = fuzz.correct(Flight(time_s, *both, *[unknown] * 3, log.columns["altitude_m"]), fuzz.profile_of(world))
    for name in fuzz.CHANNELS:
        assert np.array_equal(np.isnan(getattr(found, name)), unsure)


@pytest.mark.parametrize(("seed", "channel"), [(206003, "temperature_c"), (200344, "humidity_percent")])
def test_what_is_neither_temperature_nor_humidity_is_missing(seed, channel):
    """A humidity that is stuck as its column changes place back, and a code that nobody listed."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(seed, list(fuzz.DAMAGE))[channel]
    assert found["ours"] < 0.1 * found["reading"] and not found["outside"]


def test_of_a_log_that_is_exchanged_in_nearly_half_of_it_the_fewer_rows_are():
    """At 28 %RH neither column is too warm for air. Before: nothing was said, since no row is surely in its place."""
    there = ROW >= 720
    told = held(columns(there, humidity=HUMIDITY - 20.0), RESOLUTIONS)
    assert np.array_equal(told.exchanged, there) and not told.unsure.any()


def test_a_burst_and_codes_exchange_nothing():
    """Of twenty logs some have rows that read as well the other way, six at most."""
    wrong = []
    for seed in range(20):
        log, rng = columns(np.zeros(ROW.size, dtype=bool)), np.random.default_rng(seed)
        log[1, 300:400] += 12.0 * rng.standard_normal(100)
        log[0, 350:420] += 3.0 * rng.standard_normal(70)
        log[0, rng.random(ROW.size) < 0.05] = 33.3
        told = held(log, RESOLUTIONS)
        assert not told.degf.any()
        wrong.append(np.count_nonzero(told.exchanged | told.unsure))
    assert np.count_nonzero(wrong) <= 6 and max(wrong) < 40


@pytest.mark.parametrize("degf", [False, True])
def test_a_part_that_ends_in_a_burst_of_noise_is_told(degf):
    """Of 40 logs with exchanged columns ten were not, since no step was five times the noise there."""
    there, burst = (ROW >= 400) & (ROW < 600), (ROW >= 560) & (ROW < 640)
    wrong = []
    for seed in range(40):
        noise = burst * np.random.default_rng(seed).standard_normal((2, ROW.size))
        temperature, humidity = AIR + 2.0 * noise[0], HUMIDITY + 8.0 * noise[1]
        log = np.stack([np.where(there, 1.8 * temperature + 32.0, temperature), humidity])
        told = held(log if degf else columns(there, temperature, humidity), RESOLUTIONS)
        wrong.append(np.count_nonzero(((told.degf[0] if degf else told.exchanged) != there) | told.unsure))
    assert sum(off > 4 for off in wrong) <= 3


@pytest.mark.parametrize("seed", [1, 7])
def test_air_that_passes_the_degree_where_both_scales_meet_stays_in_its_own(seed):
    """Of a sonde whose humidity goes from layer to layer all below -40 degC had become degF, since colder air explained
    one step of the humidity better: at -40 degrees a change of unit makes no jump. 612 and 687 of 2500 rows were."""
    row, rng = np.arange(2500), np.random.default_rng(seed)
    temperature = np.round(-60.0 + 0.03 * row + np.cumsum(0.01 * rng.standard_normal(row.size)), 2)
    layers = np.cumsum(np.where(row % 25 == 12, rng.normal(0.0, 3.0, row.size), 0.0))
    layers -= np.linspace(layers[0], layers[-1], row.size)
    humidity = np.clip(60.0 + layers, 5.0, 100.0) + 0.05 * rng.standard_normal(row.size)
    told = held(np.stack([temperature, np.round(humidity, 2)]), (0.01, 0.01))
    assert not told.degf.any() and not told.exchanged.any()


@pytest.mark.parametrize("seed", [1, 2])
def test_what_no_humidity_can_be_did_not_change_place(seed):
    """A balloon comes into air of -54 degC and 3 %RH from such of 0 degC and none, where both columns meet, and its bus
    hangs now and then. Before: of up to 58 rows nothing told whether -54 was the humidity."""
    row, rng = np.arange(600), np.random.default_rng(seed)
    temperature = np.interp(row, [0, 250, 400, 600], [5.0, 0.0, -54.0, -55.0]) + 0.1 * rng.standard_normal(row.size)
    humidity = np.interp(row, [250, 400, 600], [0.0, 3.0, 3.8]) + 0.03 * rng.standard_normal(row.size)
    hangs = rng.random(row.size) < 0.03
    log = np.round([np.where(hangs, 0.57, temperature), np.where(hangs | (row < 250), 0.0, humidity)], 2)
    told = held(log, (0.01, 0.01))
    assert np.count_nonzero(told.exchanged | told.unsure) < 25
