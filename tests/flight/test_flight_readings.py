"""What goes into a flight's correction: codes for no value, bursts, stuck and swapped readings, ceilings, slips."""

import dataclasses
import re

import numpy as np
import pytest
from benchmark_scripts import benchmark

from shockrig.analysis.flight import humidity_channel
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.doubts import doubts, profile_doubts
from shockrig.analysis.flight.flight_channel import reach
from shockrig.analysis.flight.response import film_response
from shockrig.analysis.flight.screen import DEGF, EXCHANGED, resolution_of, screen, without_codes
from shockrig.analysis.flight.simulated.scenes import to_flight
from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import convective, frontal
from shockrig.analysis.flight.stretches import Felt, largest_share, scatter, stuck_rows
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.analysis.physics.humidity import saturation_pressure_hpa
from shockrig.files.flight import Flight
from shockrig.files.flight_figure import changes_of
from shockrig.files.profile import StatedEffect, Uncertain
from shockrig.files.ranges import RANGES
from shockrig.files.sentinels import CODES, coded

PROFILE = typical_profile()
FLOWN = fly(convective(np.random.default_rng(3), duration_s=80.0), PROFILE, 3)
TRUTH = {name: FLOWN.truth[name].to_numpy() for name in ("temperature_c", "humidity_percent")}


def flight(**changed):
    """The flight with other columns, functions of the readings."""
    log = to_flight(FLOWN.log)
    return dataclasses.replace(log, **{name: make(getattr(log, name).copy()) for name, make in changed.items()})


def put(rows, value):
    def make(values):
        values[rows] = value
        return values

    return make


def crossed(period_s, temperature, humidity, there):
    """A log of these columns (n,), each in the other's place in some rows."""
    nothing = np.full(there.size, np.nan)
    return dataclasses.replace(
        flight(), time_s=period_s * np.arange(there.size), temperature_c=np.where(there, humidity, temperature),
        humidity_percent=np.where(there, temperature, humidity), airspeed_m_s=nothing, pressure_hpa=nothing,
        die_temperature_c=nothing, altitude_m=None,
    )  # fmt: skip


def rms(error):
    return float(np.sqrt(np.nanmean(np.square(error))))


def beyond(done):
    """How far values are from what the air did in the whole flight."""
    return max(
        float(np.nanmax(np.maximum(value - truth.max(), truth.min() - value)))
        for value, truth in ((getattr(done, name), TRUTH[name]) for name in TRUTH)
    )


# -- codes ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rows", "code"),
    [(slice(None, None, 50), -9999.0), (slice(300, 360), -99.9), (slice(0, 1), 85.0), (slice(200, 260), 0.0)],
)
def test_a_code_for_no_value_is_missing_and_counted(rows, code):
    done = correct(flight(temperature_c=put(rows, code)), PROFILE)
    count = len(range(*rows.indices(len(FLOWN.log))))
    assert any(note.startswith(f"temperature: {code:g} in {count} row") for note in done.notes)
    assert done.flags["gap"][rows].all() and np.count_nonzero(done.flags["gap"]) == count
    assert not any("clock" in note for note in done.notes)
    away = beyond(done)
    assert away < 1.0  # before: hundreds of kelvins
    assert not done.flags["not_corrected"].any()


def test_a_receiver_without_a_fix_tells_no_height():
    """Its latitude of 0 was taken as missing, its height of 0 from 20 km up was not."""
    lost = np.arange(len(FLOWN.log)) % 50 == 7
    place = np.where(lost, 0.0, 45.1)
    height = np.where(lost, 0.0, np.linspace(0.0, 20e3, lost.size))
    changed, found = without_codes(dataclasses.replace(flight(), latitude_deg=place, altitude_m=height))
    np.testing.assert_array_equal(found["altitude 0"], lost)
    np.testing.assert_array_equal(np.isnan(changed.altitude_m), lost)


@pytest.mark.parametrize(
    ("usual", "said"),
    [(70.0, "in degF, or be the humidity"), (290.0, "in K, or be the pressure"), (994.0, "the pressure")],
)
def test_a_temperature_that_is_none_is_said_to_be_what_it_may_be(usual, said):
    """994 was said to be degF or K, or the humidity: it is a pressure."""
    assert any(f"they may be {said}: " in one for one in doubts(flight(temperature_c=lambda v: 0.01 * v + usual)))
    assert "fahrenheit" not in RANGES["temperature_c"].refusal(994.0)
    assert "fahrenheit" in RANGES["temperature_c"].refusal(290.0)


def test_last_digits_are_no_change():
    """ "humidity: changed by 1.7 × 10⁻¹⁵ %RH rms" was said of readings that were given as they came."""
    done = correct(flight(), PROFILE)
    same = dataclasses.replace(
        flight(), temperature_c=done.temperature_c * (1.0 + 2e-16), humidity_percent=done.humidity_percent
    )
    assert [one.rms for one in changes_of(same, done)] == [0.0, 0.0]


def test_a_code_is_one_where_the_log_jumps_to_it_and_a_reading_where_it_goes_there():
    warming = np.linspace(20.0, 90.0, 701)
    assert not coded("temperature", np.round(warming, 1), -100.0, 150.0)
    oven = np.where(np.arange(200) < 100, 84.9, 85.0)
    assert not coded("temperature", oven, -100.0, 150.0)
    for quantity in CODES:
        values = np.full(100, 20.0) + 0.1 * np.arange(100)
        values[40:45] = -9999.0
        found = coded(quantity, values, -100.0, 150.0)
        assert list(found) == [-9999.0] and found[-9999.0].nonzero()[0].tolist() == [40, 41, 42, 43, 44]
        huge = np.where(np.isin(np.arange(100), (3, 70)), 1e308, values)
        assert coded(quantity, huge, -100.0, 150.0)[1e308].nonzero()[0].tolist() == [3, 70]


def test_columns_that_change_place_are_read_where_they_stand():
    log = flight()
    rows = slice(250, 420)
    humidity, temperature = log.humidity_percent[rows].copy(), log.temperature_c[rows].copy()
    done = correct(flight(temperature_c=put(rows, humidity), humidity_percent=put(rows, temperature)), PROFILE)
    assert any("each in the other's place in 170 rows" in note for note in done.notes)
    plain = correct(log, PROFILE)
    for name in TRUTH:
        assert rms(getattr(done, name) - getattr(plain, name)) < 0.01 and np.isfinite(getattr(done, name)).all()


# -- stretches -----------------------------------------------------------------------------


def test_a_burst_of_noise_is_noise_and_not_air():
    rng = np.random.default_rng(1)
    rows = slice(400, 460)
    noisy = flight(
        temperature_c=lambda v: v + np.where(np.arange(v.size) // 60 == 7, 1.5 * rng.standard_normal(v.size), 0.0)
    )
    done = correct(noisy, PROFILE)
    rows = np.arange(TRUTH["temperature_c"].size) // 60 == 7
    error = done.temperature_c - TRUTH["temperature_c"]
    assert rms(error[rows]) < 0.5 and rms(error[~rows]) < 0.1
    assert rms(done.humidity_percent - TRUTH["humidity_percent"]) < 1.02 * rms(
        FLOWN.log["humidity_percent"] - TRUTH["humidity_percent"]
    )
    assert np.mean(np.abs(error) <= 1.96 * done.temperature_uncertainty_k) > 0.9


BURST = [-88.1] + [99.0] * 7 + [-98.98, 99.0] + [-98.98] * 3 + [-87.9, -65.3, -47.8, -38.2, -46.5, -23.0, 1.4]


@pytest.mark.parametrize("share", [0.3, 0.95])
def test_what_a_burst_of_nonsense_leaves_at_its_edge_is_none_of_the_airs(share):
    """A plug that lost contact: full scale up and down, then back row by row, as a lag would. Before: five of these
    rows were readings, and of a fast sensor's log all that came before the burst was none."""
    rows, burst = np.arange(400), slice(200, 200 + len(BURST))
    reading = np.where(rows < 200, 25.3, 29.3) + 0.02 * np.random.default_rng(1).standard_normal(400)
    reading[burst] = BURST
    found = screen(0.04 * rows, reading, RANGES["temperature_c"], 0.02, share=share, swing=15.0)
    assert found.implausible[burst].all()
    assert np.count_nonzero(found.implausible) == len(BURST)


def test_no_air_is_given_that_a_burst_alone_tells_of():
    rows = slice(400, 400 + len(BURST))
    found = correct(flight(temperature_c=put(rows, BURST)), typical_profile(bead_t98_s=0.15))
    assert found.flags["implausible"][rows].all()
    low, high = TRUTH["temperature_c"].min() - 1.0, TRUTH["temperature_c"].max() + 1.0
    assert np.nanmin(found.temperature_c) > low and np.nanmax(found.temperature_c) < high


def test_air_that_is_far_colder_from_an_absurd_reading_on_is_the_airs():
    """Out of a warm hall into frost, one code at the door: no burst."""
    log = flight(temperature_c=lambda values: np.where(np.arange(values.size) < 400, values + 12.0, values - 12.0))
    log.temperature_c[400] = 99.0
    found = screen(log.time_s, log.temperature_c, RANGES["temperature_c"], 0.02, share=0.9, swing=15.0)
    assert np.flatnonzero(found.implausible).tolist() == [400]


def test_a_burst_that_a_fast_sensor_may_have_read_is_told_by_the_film_that_felt_nothing():
    """At 2 Hz the bead follows from row to row, so its own readings cannot tell noise from air; the air's do pass."""
    flown = fly(convective(np.random.default_rng(5), duration_s=240.0), PROFILE, 5)
    rows = slice(None, None, 5)
    log = to_flight(flown.log[rows])
    truth = {name: flown.truth[name].to_numpy()[rows] for name in TRUTH}
    burst = np.arange(log.time_s.size) // 24 == 9
    noise = np.where(burst, 2.0 * np.random.default_rng(6).standard_normal(burst.size), 0.0)
    plain, noisy = (
        correct(dataclasses.replace(log, temperature_c=log.temperature_c + added), PROFILE) for added in (0.0, noise)
    )
    off = noisy.temperature_c - truth["temperature_c"]
    assert rms(off[burst]) < 0.5 * rms(noise[burst])
    assert np.mean(np.abs(off) <= 1.96 * noisy.temperature_uncertainty_k) > 0.9
    of_film = [rms(done.humidity_percent - truth["humidity_percent"]) for done in (plain, noisy)]
    assert of_film[1] < rms(log.humidity_percent - truth["humidity_percent"]) and of_film[1] < 2.0 * of_film[0]


def test_a_part_in_fahrenheit_of_a_coarse_log_lies_on_its_steps():
    """72.0 degF among steps of 0.5 degC. Before: 22.22 beside 22.0 made the log's step 0.02 K, each reading that stood
    one that was stuck, and in a damaged log the humidity 35 times as wrong as it was read."""
    row = np.arange(800)
    temperature = np.where(row < 400, 22.0, 8.0) + 0.5 * (np.random.default_rng(3).random(800) < 0.1)
    log = dataclasses.replace(flight().at(row), temperature_c=temperature)
    log.temperature_c[100:300] = np.round(2.0 * (1.8 * temperature[100:300] + 32.0)) / 2.0
    log, found = without_codes(log)
    assert found[DEGF].sum() == 200
    assert resolution_of(log.temperature_c) == 0.5


def test_plumes_in_a_gap_of_the_film_are_no_burst_of_a_fast_bead():
    """At 1 Hz. Before: readings on both sides of the gap passed for neighbours, what lay between for as loud as these,
    and the temperature came out 3.5 times as wrong as it was read."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(205466, list(fuzz.DAMAGE))["temperature_c"]
    assert found["ours"] < 0.5 * found["reading"]


def test_a_sensor_that_is_stuck_and_dithers_is_not_believed():
    """Beyond 5 s from what is believed the interval is wide, and it holds."""
    log = flight().temperature_c
    rows, dither = slice(300, 420), 0.01 * np.random.default_rng(2).integers(-1, 2, 120)
    drifting = np.round(np.linspace(0.0, 12.0, log.size), 2)
    stuck = flight(temperature_c=lambda v: put(rows, v[300] + drifting[300] + dither)(v + drifting))
    done = correct(stuck, PROFILE)
    assert done.flags["repeated"][rows].mean() > 0.9
    assert np.count_nonzero(done.flags["repeated"]) < 0.25 * log.size
    error = done.temperature_c - TRUTH["temperature_c"] - drifting
    assert np.mean(np.abs(error[rows]) <= 1.96 * done.temperature_uncertainty_k[rows]) > 0.9
    assert rms(error[rows]) < rms((stuck.temperature_c - TRUTH["temperature_c"] - drifting)[rows])


@pytest.mark.parametrize("value", [np.nan, 23.5])
def test_when_the_air_jumped_while_the_bead_was_not_read_is_told_by_the_film(value):
    """Its relative humidity follows the temperature at once. Before: a line from 25 to 12 degC over the gap."""
    rng, row = np.random.default_rng(2), np.arange(800)
    air, vapour = np.where(row > 400, 12.0, 25.0), 7.0
    humidity = 100.0 * vapour / saturation_pressure_hpa(air) + 0.06 * rng.standard_normal(row.size)
    temperature = air + 0.02 * rng.standard_normal(row.size)
    temperature[380:420] = value
    log = dataclasses.replace(flight().at(row), time_s=0.1 * row, temperature_c=temperature, humidity_percent=humidity)
    done = correct(log, PROFILE)
    assert rms(done.temperature_c - air) < 0.3


@pytest.mark.parametrize("warming_k", [3.0, 0.5, 0.0])
def test_a_film_that_stood_while_the_temperature_moved_is_not_believed_up_to_its_jump(warming_k):
    """Its steps are too coarse for noise to tell; calm air in front of a jump of another kind is left alone."""
    rng, row = np.random.default_rng(3), np.arange(900)
    level = np.where(row < 300, 40.0 + 0.035 * row, np.where(row < 600, 50.5, 24.0 + 0.01 * (row - 600)))
    reading = np.round((level + np.where((row < 300) | (row >= 600), 0.3, 0.0) * rng.standard_normal(900)) / 0.5) * 0.5
    vapour = reading * np.exp(0.06 * warming_k * np.clip((row - 400) / 150, 0.0, 1.0))
    found = screen(0.1 * row, reading, RANGES["humidity_reading_percent"], 0.06, share=0.1, swing=30.0, lagging=vapour)
    assert found.usable[:290].all() and found.usable[600:].all()
    assert found.usable[400:600].any() == (warming_k == 0.0) and found.repeated[400:600].all() == (warming_k > 0.0)


@pytest.mark.parametrize("stuck", [True, False])
def test_a_film_that_stands_on_a_step_while_the_temperature_goes_to_and_fro_is_stuck(stuck):
    """No jump ends the stand, and steps are coarser than noise: how often the reading would have crossed one tells."""
    rng, row = np.random.default_rng(4), np.arange(1800)
    warmth = np.cumsum(rng.standard_normal(1800)) * 0.1
    warmth -= np.convolve(np.pad(warmth, 50, mode="edge"), np.ones(101) / 101, mode="valid")
    film = 46.0 * np.exp(-0.06 * warmth)
    film[600:1200] = film[600] if stuck else 46.0 + 0.05 * rng.standard_normal(600)
    if not stuck:
        warmth[600:1200] = 0.0
    reading = np.round(film / 0.5) * 0.5
    vapour = reading * np.exp(0.06 * warmth)
    found = screen(0.1 * row, reading, RANGES["humidity_reading_percent"], 0.06, share=0.1, swing=30.0, lagging=vapour)
    assert found.repeated[610:1190].all() == stuck and found.usable[610:1190].all() != stuck
    assert found.usable[:590].mean() > 0.95 and found.usable[1210:].mean() > 0.95


@pytest.mark.parametrize("noise", [0.01, 0.002])
def test_readings_that_stay_on_one_level_are_stuck_sooner_than_those_that_dither_about_one(noise):
    """Of steps as fine as the noise the next reading seldom is on the same one; of coarser steps nobody knows."""
    row = np.arange(600)
    reading = np.round(20.0 + 0.3 * np.sin(row / 8.0) + noise * np.random.default_rng(5).standard_normal(600), 2)
    reading[300:330] = reading[300]
    stuck = stuck_rows(reading, 0.01, 0.01, scatter(reading))
    assert stuck[300:330].all() == (noise == 0.01) and not stuck[:299].any() and not stuck[331:].any()


@pytest.mark.parametrize("cooling_k", [6.0, 0.0])
def test_a_bead_that_stood_while_the_film_felt_the_air_cool_is_not_believed_up_to_its_jump(cooling_k):
    """It was on that level before as well: until the film felt otherwise, its readings are as good as any."""
    rng, row = np.random.default_rng(3), np.arange(900)
    air = np.where(row < 300, 19.0 + 0.01 * row, 22.0 - cooling_k * np.clip((row - 400) / 150, 0.0, 1.0))
    bead = np.where((row < 400) | (row >= 600), np.where(row < 600, air, 16.0), 22.0)
    reading = np.round(bead / 0.5) * 0.5
    felt = Felt(air + 0.02 * rng.standard_normal(900), 0.02, 0.0)
    found = screen(0.1 * row, reading, RANGES["temperature_c"], 0.02, share=0.27, swing=15.0, felt=felt)
    assert found.usable[:400].all() and found.usable[600:].all()
    assert found.repeated[440:600].all() == (cooling_k > 0.0) and found.usable[440:600].all() == (cooling_k == 0.0)


def test_a_bead_that_dithers_as_it_stands_is_told_wherever_most_of_its_last_readings_lie():
    """Before: only readings within a step and a half of their median stood, here the last three; the humidity that went
    through the door was left out for it (2.7 %RH off, its reading 0.26)."""
    rng, row = np.random.default_rng(3), np.arange(480)
    air = np.where(row < 202, 26.7, 9.3)
    reading = np.round(air + 0.02 * rng.standard_normal(480), 2)
    dither = np.append(np.tile([0, 1, -1, 0], 8), [-1, -1, -1, -1, 1, -1, -1, -1])
    reading[167:207] = np.round(26.72 + 0.01 * dither, 2)
    felt = Felt(air + 0.02 * rng.standard_normal(480), 0.02, 0.0)
    found = screen(0.5 * row, reading, RANGES["temperature_c"], 0.02, share=0.27, swing=30.0, felt=felt)
    assert not found.usable[202:207].any() and found.usable[207:].mean() > 0.8


def test_readings_between_two_jumps_that_no_lag_lets_through_are_implausible():
    done = correct(flight(temperature_c=lambda v: put(slice(500, 540), v[500:540] + 40.0)(v)), PROFILE)
    assert done.flags["implausible"][500:540].all() and np.count_nonzero(done.flags["implausible"]) == 40
    assert beyond(done) < 1.0


def test_readings_beside_what_they_are_that_follow_the_air_are_better_than_none():
    """A converter in another range reads 0.4 K more over a warm layer. Before: half of its rows were interpolated."""
    row = np.arange(2400)
    air = 15.0 + 5.0 * np.exp(-0.5 * ((row - 1200) / 300) ** 2)
    reading = air + np.where(np.abs(row - 1200) < 300, 0.4, 0.0) + 0.02 * np.random.default_rng(3).standard_normal(2400)
    log = dataclasses.replace(
        flight().at(row % 800), time_s=0.1 * row, temperature_c=reading, humidity_percent=np.full(2400, np.nan)
    )
    done = correct(log, PROFILE)
    assert not done.flags["implausible"].any()
    assert rms(done.temperature_c - air) < 1.1 * rms(reading - air)


def test_an_absurd_reading_on_a_front_does_not_condemn_those_beside_it():
    """Of a front that goes 1 K in a row between calm airs; the absurd reading moves the median by one place."""
    rng = np.random.default_rng(1)
    reading = np.clip(22.0 - (np.arange(240) - 120.0), 10.0, 22.0) + 0.02 * rng.standard_normal(240)
    reading[127] = 38.0
    found = screen(np.arange(240.0), reading, RANGES["temperature_c"], 0.02, share=0.98, swing=15.0)
    assert np.flatnonzero(found.implausible).tolist() == [127]


def test_a_plume_beside_missing_rows_that_the_film_felt_is_no_absurd_reading():
    """Two rows of it were left, of which the first stood alone against the median around; one that nothing else felt
    still does."""
    rng, row = np.random.default_rng(3), np.arange(240)
    plume = np.exp(-0.5 * ((row - 99.4) / 1.2) ** 2)
    reading = np.round(20.0 + 1.5 * plume + 0.02 * rng.standard_normal(240), 2)
    reading[[98, 150, 151]] = np.nan, 21.4, 21.3
    reading[149] = np.nan
    humidity = 45.0 * np.exp(-0.06 * 1.2 * plume) + 0.06 * rng.standard_normal(240)
    felt = Felt(-np.log(humidity) / 0.06, 0.02, 0.002)
    found = screen(row.astype(float), reading, RANGES["temperature_c"], 0.02, share=0.98, swing=15.0, felt=felt)
    assert np.flatnonzero(found.implausible).tolist() == [150, 151]


def test_a_film_in_a_burst_of_its_own_felt_nothing():
    """It happens to be off as the absurd reading is, amid readings that are off by as much."""
    rng, row = np.random.default_rng(3), np.arange(240)
    reading = np.round(20.0 + 0.02 * rng.standard_normal(240), 2)
    felt = reading + np.where(abs(row - 120) < 15, 2.0, 0.0) * rng.standard_normal(240)
    reading[120] += 2.0
    felt[120] = 22.0
    beside = Felt(felt, 0.02, 0.002)
    found = screen(row.astype(float), reading, RANGES["temperature_c"], 0.02, share=0.98, swing=15.0, felt=beside)
    assert np.flatnonzero(found.implausible).tolist() == [120]


def test_readings_that_are_absurd_at_once_are_of_no_air_however_alike():
    """61 K and back within a second, and a film that reads four times as much (in a damaged log, where the temperature
    came out 19 times as wrong as it was read)."""
    rng, row = np.random.default_rng(3), np.arange(480)
    reading = np.round(22.7 + 0.02 * rng.standard_normal(480), 2)
    humidity = 17.0 + 0.06 * rng.standard_normal(480)
    reading[46], humidity[46] = -38.0, 66.3
    felt = Felt(-np.log(humidity) / 0.06, 0.06, 0.006)
    found = screen(0.5 * row, reading, RANGES["temperature_c"], 0.02, share=0.82, swing=15.0, felt=felt)
    assert np.flatnonzero(found.implausible).tolist() == [46]


def test_a_reading_that_is_back_at_once_is_none_that_a_lag_follows():
    """A dropsonde's row with a temperature that was corrupted by 9 K, and a humidity that its electronics made of that
    and the film's vapour: the one seemed to have felt the other. Rows beside it came out 14 K off what they read, and
    every temperature of the drop was unsure by 4.3 K."""
    rng, row = np.random.default_rng(3), np.arange(480)
    reading = np.round(-12.0 + 0.06 * row + 0.02 * rng.standard_normal(480), 2)
    reading[150] += 8.8
    humidity = 93.0 * np.exp(-0.07 * (reading + 12.0 - 0.06 * row)) + 0.1 * rng.standard_normal(480)
    felt = Felt(-np.log(humidity) / 0.07, 0.05, 0.005)
    found = screen(0.5 * row, reading, RANGES["temperature_c"], 0.02, share=0.47, swing=15.0, felt=felt)
    assert np.flatnonzero(found.implausible).tolist() == [150]
    # a plume that the air went back from leaves what the sensor has of it
    reading[151] += 0.53 * 8.8
    reading[152] += 0.28 * 8.8
    humidity = 93.0 * np.exp(-0.07 * (reading + 12.0 - 0.06 * row)) + 0.1 * rng.standard_normal(480)
    felt = Felt(-np.log(humidity) / 0.07, 0.05, 0.005)
    found = screen(0.5 * row, reading, RANGES["temperature_c"], 0.02, share=0.47, swing=15.0, felt=felt)
    assert not found.implausible.any()


def test_humidity_that_jumps_with_a_temperature_that_was_not_read_is_believed():
    """A thermometer that is stuck over a front: the vapour beside what it reads goes there and back, and the humidity
    jumps once. (In a damaged log the humidity came out 66 times as wrong as it was read.)"""
    rng, row = np.random.default_rng(3), np.arange(1200)
    humidity = np.where(row < 504, 22.1, 49.7) + 0.06 * rng.standard_normal(1200)
    vapour = humidity * np.where(row < 594, 1.57, 0.7)
    possible, known = RANGES["humidity_reading_percent"], (row < 504) | (row >= 594)
    told = {"share": 0.2, "swing": 50.0, "lagging": vapour}
    assert screen(0.2 * row, humidity, possible, 0.06, **told).implausible.any()
    assert not screen(0.2 * row, humidity, possible, 0.06, **told, known=known).implausible.any()


def test_a_film_that_stands_on_a_coarse_step_feels_no_burst_and_is_alive():
    """At 2 Hz, among steps eight times its noise. Before: it passed for one that is stuck, and the burst for the air
    (in one damaged log humidity came out 8.1 times as wrong as it was read)."""
    rng, row = np.random.default_rng(3), np.arange(480)
    reading = np.full(480, 25.5)
    reading[156:162] = 28.6, 26.6, 26.6, 22.4, 28.6, 28.0
    felt = Felt(np.zeros(480) + 0.16 * (row > 300), 0.02, 0.16)
    reading[rng.integers(200, 480, 60)] += 0.5
    found = screen(0.5 * row, reading, RANGES["temperature_c"], 0.02, share=0.82, swing=15.0, felt=felt)
    assert np.min(found.louder[156:162]) > 10.0


def test_a_plume_that_is_read_every_second_is_not_alone():
    """Its flanks lie on the way from one neighbour to the other. Before: five of its rows were taken for absurd."""
    plume = [21.71, 22.01, 22.22, 22.5, 23.03, 23.94, 24.77, 24.34, 22.94, 21.58, 20.82, 20.13]
    reading = np.round(20.0 + 0.02 * np.random.default_rng(5).standard_normal(240), 2)
    reading[89:101] = plume
    reading[[60, 88]] = 29.0, np.nan
    found = screen(np.arange(240.0), reading, RANGES["temperature_c"], 0.02, share=0.98, swing=15.0)
    assert np.flatnonzero(found.implausible).tolist() == [60]


def test_a_reading_between_two_absurd_ones_that_is_as_far_off_goes_with_them():
    """Three rows in degF before a gap; the middle one jumps from neither. Before: it stayed, and the gap was a line."""
    reading = np.round(14.2 + 0.02 * np.random.default_rng(5).standard_normal(2400), 2)
    reading[1190:1193] = 57.6, 57.5, 57.6
    reading[1193:1460] = np.nan
    found = screen(0.1 * np.arange(2400), reading, RANGES["temperature_c"], 0.02, share=0.27, swing=15.0)
    assert np.flatnonzero(found.implausible).tolist() == [1190, 1191, 1192]


def test_two_absurd_readings_close_together_are_no_burst_of_noise():
    """Before: 20 rows around them were taken for noise, and the air there for the line between those beside."""
    rng, row = np.random.default_rng(3), np.arange(240)
    air = 12.0 + 0.2 * rng.standard_normal(240)
    reading = air.copy()
    reading[[69, 73]] = 80.0, -40.0
    felt = Felt(air + 0.02 * rng.standard_normal(240), 0.02, 0.0)
    found = screen(row.astype(float), reading, RANGES["temperature_c"], 0.02, share=0.98, swing=15.0, felt=felt)
    assert np.flatnonzero(found.implausible).tolist() == [69, 73] and np.max(found.louder[60:69]) == 1.0


def test_a_fast_sensor_that_is_stuck_is_told_by_what_another_felt_meanwhile():
    """At 1 Hz a bead hides no jump of the air, and the film would have felt one. Before: fifteen rows were believed."""
    rng, row = np.random.default_rng(3), np.arange(240)
    air = 22.5 - 5.2 * np.clip((row - 105.0) / 10.0, 0.0, 1.0)
    reading = np.round(air + 0.02 * rng.standard_normal(240), 2)
    reading[107:122] = 21.91 + 0.01 * rng.integers(-1, 2, 15)
    felt = Felt(air + 0.03 * rng.standard_normal(240), 0.03, 0.0)
    found = screen(row.astype(float), reading, RANGES["temperature_c"], 0.02, share=0.98, swing=15.0, felt=felt)
    assert not found.usable[110:122].any() and found.usable[:105].mean() > 0.9 and found.usable[122:].mean() > 0.9
    # a door that both felt is one, and what stood before it was the air
    door = np.where(row < 122, 21.91, 17.3)
    reading = np.round(door + 0.02 * rng.standard_normal(240), 2)
    felt = Felt(door + 0.03 * rng.standard_normal(240), 0.03, 0.0)
    found = screen(row.astype(float), reading, RANGES["temperature_c"], 0.02, share=0.98, swing=15.0, felt=felt)
    assert found.usable.mean() > 0.9 and found.usable[107:122].mean() > 0.8


def test_a_code_that_the_air_came_up_to_is_one_though_nothing_jumps_back():
    """It stands at a ceiling, through a door to just there: what lags jumps at both its ends. Before: 315 rows of it
    were believed, and 100 %RH came out beside them."""
    rng, row = np.random.default_rng(3), np.arange(2400)
    air = np.where(row < 1010, 27.0, 12.0)
    reading = np.round(np.where(row < 1010, 22.4, 56.4) + 0.06 * rng.standard_normal(2400))
    reading[694:1010] = 57.0
    lagging = reading * saturation_pressure_hpa(air) / saturation_pressure_hpa(20.0)
    found = screen(
        0.1 * row, reading, RANGES["humidity_reading_percent"], 0.06, share=0.13, swing=50.0, lagging=lagging
    )
    assert np.flatnonzero(found.implausible).tolist() == list(range(694, 1010))


def test_a_stretch_from_elsewhere_does_not_begin_where_a_stuck_sensor_goes_on():
    """It goes on by a jump up, and 20 s later another quantity stands in its column: the rows between are its own."""
    rng, row = np.random.default_rng(3), np.arange(480)
    reading = np.where(row < 230, 19.0, 47.6) + 0.06 * rng.standard_normal(480)
    reading[180:230] = 19.0
    reading[382:416] = 12.9 + 0.01 * rng.standard_normal(34)
    found = screen(0.5 * row, reading, RANGES["humidity_reading_percent"], 0.06, share=0.29, swing=50.0)
    assert np.flatnonzero(found.implausible).tolist() == list(range(382, 416))


@pytest.mark.parametrize("row", [0, -1])
def test_an_absurd_reading_at_an_end_of_the_log_stands_alone_as_any_other(row):
    reading = np.round(13.0 + 0.05 * np.random.default_rng(2).standard_normal(240), 2)
    reading[row] += 20.0
    found = screen(np.arange(240.0), reading, RANGES["temperature_c"], 0.02, share=0.98, swing=15.0)
    assert np.flatnonzero(found.implausible).tolist() == [row % 240]  # its own median, before
    # a log that begins or ends on a front has no such reading
    front = np.round(13.0 + 0.5 * np.minimum(np.arange(240), 20.0), 2)
    for values in (front, front[::-1]):
        found = screen(np.arange(240.0), values, RANGES["temperature_c"], 0.02, share=0.98, swing=15.0)
        assert not found.implausible.any()


@pytest.mark.parametrize("back", [0, 1])
def test_a_stretch_in_another_unit_at_an_end_of_the_log_is_told_by_a_sensor_that_hides_no_jump(back):
    reading = np.round(17.0 + 0.05 * np.random.default_rng(4).standard_normal(480), 2)
    rows = slice(463, 480 - back)
    reading[rows] = np.round(1.8 * reading[rows] + 32.0, 2)
    found = screen(0.5 * np.arange(480), reading, RANGES["temperature_c"], 0.02, share=0.9, swing=15.0)
    assert found.implausible[rows].all() and not found.implausible[:463].any()


def test_an_ordinary_flight_has_nothing_of_all_that():
    for weather in (frontal(airspeed_m_s=45.0, lead_m=900.0), convective(np.random.default_rng(5), duration_s=60.0)):
        flown = fly(weather, PROFILE, 4)
        done = correct(to_flight(flown.log), PROFILE)
        assert not done.flags["implausible"].any() and not done.flags["gap"].any()
        assert not [note for note in done.notes if "farther" in note or "missing" in note or "stuck" in note]


@pytest.mark.parametrize("noise_k", [0.02, 0.1])
def test_steps_of_a_slow_log_empty_no_row(noise_k):
    air = 15.0 + 0.04 * np.sin(np.arange(600) / 40.0) + 0.02 * np.random.default_rng(1).standard_normal(600)
    nothing = np.full(600, np.nan)
    log = dataclasses.replace(flight(), **{name: nothing for name in ("airspeed_m_s", "pressure_hpa", "altitude_m")})
    log = dataclasses.replace(
        log,
        time_s=np.arange(600.0),
        temperature_c=np.round(air, 1),
        humidity_percent=nothing,
        die_temperature_c=nothing,
    )
    done = correct(log, PROFILE, temperature_noise_k=noise_k)
    assert np.isfinite(done.temperature_c).all() and np.isfinite(done.temperature_uncertainty_k).all()
    assert not done.flags["repeated"].any()


def test_a_code_that_was_rounded_and_comes_again_and_again_is_no_reading():
    """-99.9 in a log of half kelvins is -100, which some air is said to have; calm air writes it as often as itself."""
    calm = 20.0 + 1.2 * np.sin(np.arange(800) / 90.0)
    reading = np.round(np.where(np.arange(800) % 9 == 4, -99.9, calm) / 0.5) * 0.5
    found = screen(0.1 * np.arange(800), reading, RANGES["temperature_c"], 0.02, share=0.2, swing=15.0)
    assert np.array_equal(found.implausible, reading == -100.0)


@pytest.mark.parametrize("missing", [0.0, 0.4])
def test_a_stretch_in_fahrenheit_is_told_though_the_air_moved_in_it(missing):
    behind = np.exp(-np.maximum(np.arange(800) - 400.0, 0.0) / 5.0)
    reading = 10.0 + 17.0 * behind + 0.02 * np.random.default_rng(0).standard_normal(800)
    strange = slice(300, 500)
    reading[strange] = 1.8 * reading[strange] + 32.0
    reading[np.random.default_rng(1).random(800) < missing] = np.nan
    found = screen(0.1 * np.arange(800), reading, RANGES["temperature_c"], 0.02, share=0.2, swing=15.0)
    known = np.isfinite(reading)
    assert found.implausible[strange][known[strange]].all()
    assert found.usable[known].mean() > 0.7


def test_a_stretch_in_other_units_is_told_though_the_air_jumped_in_it():
    """Up by 46 K, up by 43 K, down by 66 K: no jump goes back to where another came from."""
    row = np.arange(1200)
    air = np.where(row < 550, 17.8, 42.0)
    strange = (row >= 450) & (row < 600)
    reading = np.where(strange, 1.8 * air + 32.0, air) + 0.02 * np.random.default_rng(2).standard_normal(row.size)
    found = screen(0.1 * row, reading, RANGES["temperature_c"], 0.02, share=0.27, swing=15.0)
    assert np.array_equal(found.implausible, strange)  # before: the 450 rows ahead of it, and half of it not


def test_columns_that_change_place_in_a_log_partly_in_fahrenheit_are_the_few_ones():
    """Its warm rows were taken for humidities: 2,360 of 2,400 rows were missing, and 40 exchanged ones corrected."""
    row = np.arange(2400)
    rng = np.random.default_rng(4)
    temperature = 16.0 + 0.02 * rng.standard_normal(row.size)
    humidity = 24.0 + 0.05 * rng.standard_normal(row.size)
    there = (row >= 1950) & (row < 1990)
    strange = np.where((row >= 300) & (row < 900), 1.8 * temperature + 32.0, temperature)
    log = crossed(0.1, strange, humidity, there)
    assert np.array_equal(without_codes(log)[1][EXCHANGED], there)


def test_columns_that_change_back_in_a_stretch_in_fahrenheit_are_told_to_its_end():
    """Before: the 200 rows ahead of them were taken for the exchanged ones."""
    row = np.arange(480)
    rng = np.random.default_rng(5)
    temperature = 20.0 + 0.02 * rng.standard_normal(row.size)
    humidity = 45.0 + 0.06 * rng.standard_normal(row.size)
    strange = np.where((row >= 186) & (row < 240), 1.8 * temperature + 32.0, temperature)
    there = (row >= 106) & (row < 214)
    log = crossed(0.5, strange, humidity, there)
    assert np.array_equal(without_codes(log)[1][EXCHANGED], there)


def test_columns_that_change_place_while_a_code_stands_in_one_are_told_by_what_is_behind_it():
    """Before: the 280 rows ahead of them were taken for the exchanged ones, with the code in them."""
    row, rng = np.arange(1200), np.random.default_rng(7)
    temperature = np.round(21.0 + 0.02 * rng.standard_normal(row.size), 2)
    humidity = 45.0 + 0.06 * rng.standard_normal(row.size)
    there = (row >= 281) & (row < 523)
    log = crossed(0.2, temperature, humidity, there)
    log.temperature_c[263:453] = 127.99
    found = without_codes(log)[1][EXCHANGED]
    assert np.array_equal(np.flatnonzero(found), np.flatnonzero(there))


def test_columns_that_change_back_in_a_gap_of_one_of_them_are_told_by_what_it_held_last():
    """Before: the 664 rows ahead of them were taken for the exchanged ones."""
    row, rng = np.arange(2400), np.random.default_rng(7)
    temperature = np.where(row < 1008, 26.4, 11.5) + 0.02 * rng.standard_normal(row.size)  # through a door in that gap
    humidity = np.where(row < 1008, 19.0, 48.0) + 0.06 * rng.standard_normal(row.size)
    there = (row >= 664) & (row < 935)
    log = crossed(0.1, temperature, humidity, there)
    log.humidity_percent[900:1102] = np.nan
    found = without_codes(log)[1][EXCHANGED]
    assert found[664:900].all() and not found[:664].any() and not found[935:].any()


def test_a_level_of_coarse_steps_between_two_absurd_readings_is_the_air():
    """A door that one reading met halfway, and a code: before, the 115 rows between them went with both."""
    reading = np.where(np.arange(240) < 101, 23.0 + 0.5 * (np.arange(240) % 2), 6.0)
    reading[101], reading[217] = 7.5, 111.1
    found = screen(np.arange(240.0), reading, RANGES["temperature_c"], 0.02, share=0.98, swing=15.0)
    assert found.usable[102:217].all() and found.implausible[217]


def test_a_jump_that_a_reading_met_halfway_does_not_stir_the_air_around_it():
    """A door at 1 Hz, before a bead that hides none: before, 2 K off in the row ahead of it."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(191066, list(fuzz.DAMAGE))["temperature_c"]
    assert found["ours"] < 0.3 * found["reading"] and found["covered"] > 0.9


def test_readings_two_kelvin_apart_that_pass_a_code_are_none():
    """A balloon's whole degrees, every second of them, up to -57 degC and back: -49, -45 and -9 were left out."""
    passed = np.concatenate([np.arange(-1.0, -59.0, -2.0), np.arange(-57.0, 1.0, 2.0)])
    assert coded("temperature", np.repeat(passed, 15), -100.0, 60.0) == {}
    held = np.repeat(passed, 15)
    held[200:203] = 85.0
    assert list(coded("temperature", held, -100.0, 100.0)) == [85.0]


def test_a_code_has_no_part_in_the_steps_of_a_log():
    """Before: steps of 0.5 K passed for 0.01 K, and calm air for a sensor that is stuck."""
    reading = np.where(np.arange(2400) < 1008, 27.0, 15.0)
    reading[1008:1015] = 25.0, 21.5, 19.0, 17.5, 16.5, 16.0, 15.5
    reading[2217:2300] = 127.99
    found = screen(0.1 * np.arange(2400), reading, RANGES["temperature_c"], 0.02, share=0.27, swing=15.0)
    assert found.resolution == 0.5 and np.flatnonzero(found.implausible).tolist() == list(range(2217, 2300))
    assert found.usable[~found.implausible].all()


def test_a_stretch_in_another_unit_with_a_door_in_it_is_told_though_both_its_ends_lie_in_gaps():
    """Before: the air was thought to be 75 degC warm, since the jumps do not lead back to where they began."""
    row = np.arange(2400)
    lagging = 6.2 + 17.7 * np.exp(-np.maximum(row - 1008, 0) / 3.2)
    reading = np.round(lagging + 0.02 * np.random.default_rng(3).standard_normal(2400), 2)
    strange = (row >= 925) & (row < 1744)
    reading[strange] = np.round(1.8 * reading[strange] + 32.0, 2)
    reading[922:926] = reading[1742:1746] = np.nan
    found = screen(0.1 * row, reading, RANGES["temperature_c"], 0.02, share=0.27, swing=15.0)
    assert np.array_equal(found.implausible, strange & np.isfinite(reading))


def test_rows_in_fahrenheit_behind_a_gap_in_which_the_air_went_to_such_a_humidity_are_not_exchanged():
    """Before: 1,500 rows of both columns were taken for one another's, and came out 16 K and 15 %RH wrong."""
    row, rng = np.arange(2400), np.random.default_rng(6)
    temperature = 16.0 + 0.02 * rng.standard_normal(row.size)
    humidity = np.where(row < 550, 55.5, 27.3) + 0.06 * rng.standard_normal(row.size)
    strange = np.where((row >= 600) & (row < 900), 1.8 * temperature + 32.0, temperature)
    strange[372:742] = np.nan
    assert EXCHANGED not in without_codes(crossed(0.1, strange, humidity, np.zeros(2400, dtype=bool)))[1]


def test_a_burst_of_half_a_second_is_noise_and_a_jump_over_a_gap_is_none():
    rng = np.random.default_rng(4)
    reading = 20.0 + 0.02 * rng.standard_normal(400)
    reading[200:206] += 2.0 * rng.standard_normal(6)
    reading[300:320] = np.nan
    reading[320:] -= 13.0
    found = screen(0.2 * np.arange(400), reading, RANGES["temperature_c"], 0.02, share=0.2, swing=15.0)
    assert np.all((found.louder[201:205] > 20.0) | found.implausible[201:205])
    assert np.all(found.louder[250:] == 1.0) and found.usable[250:300].all() and found.usable[320:].all()


def test_a_door_beside_a_missing_row_is_no_burst_of_noise():
    """By a bead that shows 0.6 of a step in a row: the door was noise, and the air a ramp of 2 s."""
    rng, row = np.random.default_rng(4), np.arange(600)
    reading = 23.3 - 17.0 * (1.0 - 0.4 ** np.maximum(row - 300.3, 0.0)) + 0.02 * rng.standard_normal(600)
    reading[[297, 301, 310]] = np.nan
    found = screen(0.2 * row, reading, RANGES["temperature_c"], 0.02, share=0.6, swing=15.0)
    assert np.max(found.louder) < 5.0 and found.usable[np.isfinite(reading)].all()  # before: 66


def test_columns_that_change_place_beside_a_jump_keep_the_rows_around():
    """A door in the row before, and one column missing in many rows."""
    temperature, humidity = np.where(np.arange(300) < 100, 26.0, 10.0), np.where(np.arange(300) < 100, 19.0, 52.0)
    rows = slice(101, 146)
    log = dataclasses.replace(flight().at(np.arange(300)), temperature_c=temperature, humidity_percent=humidity)
    crossed = temperature.copy(), humidity.copy()
    crossed[0][rows], crossed[1][rows] = humidity[rows], temperature[rows]
    crossed[1][60:98] = np.nan
    _, codes = without_codes(dataclasses.replace(log, temperature_c=crossed[0], humidity_percent=crossed[1]))
    assert np.flatnonzero(codes[EXCHANGED]).tolist() == list(range(101, 146))


def test_a_jump_in_a_gap_is_one_and_no_strength_of_the_air():
    """Before: 2 K off before the gap, and 4 %RH off throughout."""
    log = flight(temperature_c=lambda v: 25.0 + 0.0 * v, humidity_percent=lambda v: 23.0 + 0.0 * v)
    rng, later = np.random.default_rng(2), np.arange(log.time_s.size) > 400
    temperature = np.where(later, 12.0, 25.0) + 0.02 * rng.standard_normal(later.size)
    humidity = np.where(later, 52.0, 23.0) + 0.06 * rng.standard_normal(later.size)
    for column in (temperature, humidity):
        column[rng.random(later.size) < 0.3] = np.nan
        column[380:420] = np.nan
    done = correct(dataclasses.replace(log, temperature_c=temperature, humidity_percent=humidity), PROFILE)
    known = np.isfinite(temperature) & np.isfinite(humidity)
    assert rms(done.temperature_c[known] - np.where(later, 12.0, 25.0)[known]) < 0.02
    assert rms(done.humidity_percent[known] - np.where(later, 52.0, 23.0)[known]) < 0.1


def test_what_lies_in_a_gap_across_which_the_air_jumped_may_be_on_either_side():
    """Somewhere in ten seconds without a reading: a line between both, as unsure as a jump anywhere leaves it."""
    rng, row = np.random.default_rng(2), np.arange(800)
    temperature = np.where(row > 400, 12.0, 25.0) + 0.02 * rng.standard_normal(row.size)
    temperature[350:450] = np.nan
    log = flight()
    done = correct(dataclasses.replace(log.at(row), time_s=0.1 * row, temperature_c=temperature), PROFILE)
    middle, sigma = done.temperature_c[370:399], done.temperature_uncertainty_k[370:399]
    assert np.all(np.diff(middle) < 0.0) and middle[0] > 20.0 and middle[-1] < 20.0
    # either level lies within the 95 % interval, and that is no wider than it has to be
    assert np.all((middle - 1.96 * sigma < 12.0) & (middle + 1.96 * sigma > 25.0)) and sigma.max() < 7.0


def test_a_lone_reading_that_no_air_makes_a_film_show_is_noise():
    """4 %RH in one row of a log at 2 Hz, which a film shows of 16 %RH there and back: before, 17 %RH off."""
    flown = fly(convective(np.random.default_rng(7), duration_s=200.0), PROFILE, 7)
    log, truth = to_flight(flown.log[::5]), flown.truth["humidity_percent"].to_numpy()[::5]
    humidity = log.humidity_percent.copy()
    humidity[150] -= 4.0
    done = correct(dataclasses.replace(log, humidity_percent=humidity), PROFILE)
    assert np.abs(done.humidity_percent - truth)[145:156].max() < 4.0


# -- what comes out ------------------------------------------------------------------------


def test_the_air_lies_within_the_reach_of_the_readings():
    from shockrig.analysis.flight.flight_channel import FlightReadings
    from shockrig.analysis.flight.response import bead_response
    from shockrig.analysis.physics.air_exchange import Stream

    count = len(FLOWN.log)
    response = bead_response(PROFILE.temperature, Stream(np.full(count, 10.0)))
    reading = FLOWN.log["temperature_c"].to_numpy()
    usable = np.ones(count, dtype=bool)
    usable[200:260] = False
    readings = FlightReadings("temperature", np.arange(count) * 0.1, reading, usable, response, np.full(count, 4e-4))
    low, high = reach(readings, 6.0)
    resolved = np.convolve(np.pad(TRUTH["temperature_c"], 2, mode="edge"), np.full(5, 0.2), mode="valid")
    assert np.all(((resolved > low) & (resolved < high))[usable])
    assert np.median(high - low) < 2.0 * np.ptp(reading)
    shares = [largest_share(response, period) for period in (0.01, 0.1, 1.0, 10.0)]
    assert 0.0 < shares[0] < shares[1] < shares[2] < shares[3] <= 1.0


def test_what_is_not_the_reading_does_not_say_that_it_is():
    """Humidity beyond the profile's table is given as read, temperature is corrected."""
    cold = flight(temperature_c=lambda v: v - 40.0)
    done = correct(cold, PROFILE)
    assert done.flags["humidity_not_corrected"].any() and not done.flags["not_corrected"].any()
    rows = done.flags["humidity_not_corrected"]
    assert np.array_equal(done.humidity_percent[rows], cold.humidity_percent[rows])
    alone = correct(cold, dataclasses.replace(PROFILE, temperature=None))
    assert np.array_equal(alone.temperature_c, cold.temperature_c) and alone.flags["not_corrected"].any()


def test_columns_that_change_back_where_they_meet_are_told_up_to_there():
    """A stretch of exchanged columns of which one end lies where both are alike was taken to last to the log's end."""
    row = np.arange(2000)
    temperature = 19.0 + 0.02 * np.random.default_rng(4).standard_normal(row.size)
    humidity = (
        45.0 - 26.0 * np.clip((row - 500) / 300.0, 0.0, 1.0) + 0.05 * np.random.default_rng(5).standard_normal(2000)
    )
    there = (row >= 300) & (row < 900)
    read, found = without_codes(crossed(0.1, temperature, humidity, there))
    assert found[EXCHANGED][300:700].all() and not found[EXCHANGED][:299].any()
    # from there on nothing tells, and nothing is lost by either
    assert np.allclose(read.temperature_c, temperature, atol=0.3) and np.allclose(
        read.humidity_percent, humidity, atol=0.3
    )


def test_columns_of_which_one_is_stuck_as_they_change_place_are_told_by_the_other_end():
    """The stretch is the longer side of the end that is seen; its other end is where the stuck one goes on."""
    row = np.arange(2400)
    temperature = 22.0 - row / 1200.0 + 0.02 * np.random.default_rng(4).standard_normal(row.size)
    humidity = 24.0 + row / 700.0 + 0.05 * np.random.default_rng(5).standard_normal(row.size)
    there = (row >= 1850) & (row < 2300)
    log = crossed(0.1, temperature, humidity, there)
    log.temperature_c[1700:1900] = 20.6
    found = without_codes(log)[1][EXCHANGED]
    assert found[1900:2300].all() and not found[:1700].any() and not found[2300:].any()


def test_columns_that_change_back_as_one_of_them_becomes_a_code_are_told_up_to_there():
    """The other goes on from where they were exchanged. Before: the 480 rows ahead of them were the exchanged ones."""
    row = np.arange(2400)
    temperature = 13.0 + 0.02 * np.random.default_rng(4).standard_normal(row.size)
    humidity = 45.0 + 0.05 * np.random.default_rng(5).standard_normal(row.size)
    there = (row >= 481) & (row < 837)
    log = crossed(0.1, np.where((row >= 837) & (row < 1024), 33.3, temperature), humidity, there)
    assert np.array_equal(without_codes(log)[1][EXCHANGED], there)


def test_damaged_flights_give_nothing_that_cannot_be():
    """A fixed sample of benchmarks/fuzz_flights.py, which flies a million rows."""
    fuzz = benchmark("fuzz_flights")
    # twenty-three: a door in a slow log, bursts in humidity, in temperature, a ceiling, bursts among steps, in
    # warm air, a code up to a door, a jump in a gap at 2 Hz, a burst at 2 Hz, ceilings in a steady layer, up to a log's
    # end, a burst with a row that is quiet by chance, a restart, absurd readings together, a plume beside missing rows,
    # columns that change back as one becomes a code, after a stuck sensor went on, or with a door in them, a film that
    # is stuck in plumes, a plume every second, gusts that the film felt, rows in degF before a gap; and four: a burst
    # while the air cools, one that begins below a ceiling, a ceiling of 40 s, a code for no value in degF
    first = (3, 64, 108, 129, 280, 20182, 101094, 101182, 101402, 101225)
    more = (151154, 151379, 151040, 153216, 153323, 152458, 152482, 154433, 154205)
    for seed in (*first, *more, 158047, 158059, 159023, 159219, 159266, 160054, 160224, 170223, 170072, 170019,
                 190035, 190105, 190222, 159111, 191039, 191321, 191514, 192374, 195215, 195269, 195394,
                 193346, 198393, 196207, 196322, 196388, 197161):  # fmt: skip
        found = fuzz.judged(seed, list(fuzz.DAMAGE))
        for channel in fuzz.CHANNELS:
            assert found[channel]["outside"] == 0 and found[channel]["no_reading"] == 0, found
            assert found[channel]["ours"] <= fuzz.WORSE * found[channel]["reading"], found


@pytest.mark.parametrize("seed", [190214, 193252, 198434, 198524])
def test_humidity_is_no_worse_than_its_reading_where_nothing_bears_the_correction_out(seed):
    """A film that stands for long: the air's trend went on beyond both sides of that, up to 15 %RH. A temperature in a
    burst or a code: the vapour that it left more unsure than vapour moves was used. Before: up to 3.8 times worse."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(seed, list(fuzz.DAMAGE))["humidity_percent"]
    assert found["outside"] == 0 and found["ours"] <= fuzz.WORSE * found["reading"], found


def test_a_jump_by_nothing_is_none():
    """A logger that started again, in air that the other readings explain. Before: a traceback."""
    fuzz = benchmark("fuzz_flights")
    for seed in (191231, 192097):  # 192097: one that the other sensor saw at an instant, which leaves no other place
        found = fuzz.judged(seed, list(fuzz.DAMAGE))
        assert "raised" not in found and found["temperature_c"]["ours"] < found["temperature_c"]["reading"]


def test_a_step_of_the_sensor_that_stays_in_its_readings_is_looked_for_once():
    """A film's step in a burst of the temperature is not taken out, and so was found for ever. Before: a traceback."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(200165, list(fuzz.DAMAGE))
    assert "raised" not in found and found["humidity_percent"]["ours"] < found["humidity_percent"]["reading"]


def test_no_sensor_steps_at_its_first_reading():
    """Of exchanged columns whose first rows are off. Before: a traceback, since there is no reading before."""
    fuzz = benchmark("fuzz_flights")
    assert "raised" not in fuzz.judged(300436, list(fuzz.DAMAGE))


def test_a_film_back_within_its_table_remembers_where_it_stood_beyond_it():
    """What it was there is not known. Before: 12 %RH from the reading, stated to 0.5, in the first row of the table."""
    fuzz = benchmark("fuzz_flights")
    assert fuzz.judged(190359, list(fuzz.DAMAGE))["humidity_percent"]["outside"] == 0


def test_a_jump_that_neither_air_nor_lag_makes_leaves_open_on_which_side_the_sensor_was_right():
    """A supply that sags: humidity is 5 % less from one row to the next. Before: stated as surely as ever."""
    flown = fly(frontal(airspeed_m_s=45.0, lead_m=900.0), PROFILE, 4)
    log, truth = to_flight(flown.log), flown.truth["humidity_percent"].to_numpy()
    row = np.arange(log.time_s.size)
    sagging = dataclasses.replace(log, humidity_percent=np.where(row < 100, 1.0, 0.95) * log.humidity_percent)
    done = correct(sagging, PROFILE)
    assert [note[:8] for note in done.notes if "the sensor changed" in note] == ["humidity"]
    assert np.mean(np.abs(done.humidity_percent - truth) <= 1.96 * done.humidity_uncertainty_percent) > 0.9
    # Before: 83 % of the air in the intervals beside a gap, and 48 % where the reading fell to 0.3 of itself.
    first_gap, second_gap = (row > 149) & (row < 350), (row > 299) & (row < 500)
    for share, gap in ((0.95, first_gap), (0.9, first_gap), (0.3, row < 0), (0.3, first_gap), (0.3, second_gap)):
        humid = np.where(gap, np.nan, np.where(row < 100, 1.0, share) * log.humidity_percent)
        open_ = correct(dataclasses.replace(log, humidity_percent=humid), PROFILE)
        known = np.isfinite(open_.humidity_uncertainty_percent)
        assert known.mean() > 0.65 and np.array_equal(known, np.isfinite(open_.humidity_percent))
        off = np.abs(open_.humidity_percent - truth)[known]
        assert np.mean(off <= 1.96 * open_.humidity_uncertainty_percent[known]) > 0.95
    # every jump is told, with its unit
    twice = dataclasses.replace(log, humidity_percent=np.where(row < 180, 1.0, 0.9) * sagging.humidity_percent)
    assert sum("%RH, 1 more jump behind it, which no air" in note for note in correct(twice, PROFILE).notes) == 1
    # a gap in the temperature may hide a door, which the film's reading follows at once
    hidden = dataclasses.replace(sagging, temperature_c=np.where(np.abs(row - 100) < 10, np.nan, log.temperature_c))
    for one in (log, hidden):
        assert not any("the sensor changed" in note for note in correct(one, PROFILE).notes)


def test_readings_that_come_by_one_jump_and_go_by_a_far_larger_one_did_not_follow_the_air():
    """A humidity in the temperature's place, while it rose. Before: 24 K above the air, since it went 15 K itself."""
    rng = np.random.default_rng(6)
    row = np.arange(600)
    reading = 21.5 + 0.02 * rng.standard_normal(row.size)
    there = (row >= 300) & (row < 420)
    climbing = np.where(there, 30.0 + 15.0 * (row - 300) / 120.0 + 0.06 * rng.standard_normal(row.size), reading)
    shifted = np.where(there, reading + 8.0, reading)  # a sensor that is 8 K off for a while goes as it came
    for values in (climbing, shifted):
        found = screen(0.1 * row, values, RANGES["temperature_c"], 0.02, share=0.3, swing=15.0)
        assert np.array_equal(found.implausible, there)


def test_what_was_thrown_out_moves_no_value_that_the_readings_around_allow():
    """A door in a burst, a jump in a long stand: the air may have gone at any of the rows that say nothing, and came
    out on the line between those beside them. Before: 1.2 to 5.6 times the error of the readings."""
    fuzz = benchmark("fuzz_flights")
    for seed, channel in ((300182, 0), (198331, 0), (301082, 1), (301393, 1)):
        found = fuzz.judged(seed, list(fuzz.DAMAGE))[fuzz.CHANNELS[channel]]
        assert found["ours"] < 0.9 * found["reading"], found


@pytest.mark.parametrize(("seed", "share"), [(303081, 0.7), (300471, 0.4)])
def test_a_jump_before_a_stand_or_in_it_may_be_anywhere_in_it(seed, share):
    """One at the last reading before it is as likely. Before: at its first row for certain, up to 4 K from the air."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(seed, list(fuzz.DAMAGE))["temperature_c"]
    assert found["outside"] == 0 and found["ours"] < share * found["reading"], found


def test_absurd_readings_among_steps_and_beside_one_another_stand_alone():
    """Of few different values the absurd ones are the usual; and the second of two is on the way back from the first.
    Before: both were believed."""
    rows = np.arange(240)
    noise = 0.02 * np.random.default_rng(5).standard_normal(rows.size)
    for step in (0.01, 0.25):
        reading = np.round((np.where(rows < 100, 26.0, 13.0) + noise) / step) * step
        reading[[40, 72, 151, 152]] = -35.25, 37.5, 51.75, 39.25
        found = screen(1.0 * rows, reading, RANGES["temperature_c"], 0.02, share=0.98, swing=30.0)
        assert np.array_equal(np.flatnonzero(found.implausible), [40, 72, 151, 152])


def test_a_burst_is_not_thrown_out_reading_by_reading():
    """Where more than one is out, those beside it are noise as well, and count as that. Before: all of a burst at 1 Hz
    but one reading was thrown out, and that one was certain."""
    fuzz = benchmark("fuzz_flights")
    found = fuzz.judged(199524, list(fuzz.DAMAGE))["temperature_c"]
    assert found["outside"] == 0 and found["ours"] < 0.5 * found["reading"], found


def test_a_stretch_in_fahrenheit_is_told_by_its_ends_whatever_lies_between():
    """A door and a burst in it go farther than the jumps at its ends. Before: all of it was believed, 36 K off."""
    rng = np.random.default_rng(8)
    rows = np.arange(2400)
    air = np.where(rows < 1000, 23.0, 5.0 + 18.0 * np.exp(-(rows - 1000) / 8.0)) + 0.02 * rng.standard_normal(rows.size)
    air[950:1050] += 2.0 * rng.standard_normal(100)
    there = (rows >= 717) & (rows < 1130)
    reading = np.where(there, 1.8 * air + 32.0, air)
    found = screen(0.1 * rows, reading, RANGES["temperature_c"], 0.02, share=0.3, swing=30.0)
    assert np.array_equal(found.implausible[:940], there[:940]) and found.implausible[1050:1130].all()
    assert not found.implausible[1130:].any()


def test_a_code_that_stands_up_to_a_jump_that_no_air_makes_is_no_sensor_that_is_stuck():
    """111 degC at the log's beginning, behind it 14 degC: a stuck sensor goes on from where it was. Before: a ceiling,
    with readings there or above."""
    rows = np.arange(1200)
    reading = 14.0 - 0.001 * rows + 0.02 * np.random.default_rng(7).standard_normal(rows.size)
    reading = np.where(rows < 160, 111.1, np.round(reading, 2))
    found = screen(0.1 * rows, reading, RANGES["temperature_c"], 0.02, share=0.3, swing=30.0)
    assert np.array_equal(found.implausible, rows < 160)


def test_the_first_and_last_steps_of_a_burst_are_its_own():
    """A window's median may see neither; behind a lag no air makes them. Before: two rows of calm noise beside it."""
    rng = np.random.default_rng(3)
    reading = 45.0 + 0.06 * rng.standard_normal(400)
    reading[200:240] += 6.0 * rng.standard_normal(40)
    reading[200:202] = 43.0, 39.0
    reading[202:206] = 38.0, 38.6, 39.2, 39.9
    found = screen(0.1 * np.arange(400), reading, RANGES["humidity_reading_percent"], 0.06, share=0.12, swing=40.0)
    assert np.all((found.louder[200:240] > 10.0) | found.implausible[200:240])
    assert np.all(found.louder[20:190] == 1.0) and np.all(found.louder[250:] == 1.0)


# -- slips ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "said", "given_as_read"),
    [
        ({"time_s": lambda v: v / 60.0}, "times seem to be in minutes", True),
        ({"time_s": lambda v: 1000.0 * v}, "times seem to be in milliseconds", True),
        ({"airspeed_m_s": lambda v: -v}, "cannot be", False),
        ({"airspeed_m_s": lambda v: 100.0 * v}, "cannot be", False),
        ({"airspeed_m_s": lambda v: np.full(v.size, 12.0)}, "12 m/s in every row", False),
        ({"pressure_hpa": lambda v: 100.0 * v}, "taken as Pa", False),
        ({"humidity_percent": lambda v: put(slice(100, 600), v[100])(v)}, "the reading stands at", False),
        ({"humidity_percent": lambda v: np.minimum(v, np.quantile(v, 0.6))}, "the largest there is", False),
    ],
)
def test_a_slip_of_the_log_is_a_sentence_and_its_uncertainty_holds(changed, said, given_as_read):
    slipped = flight(**changed)
    done = correct(slipped, PROFILE)
    assert sum(said in note for note in done.notes) == (2 if given_as_read else 1)
    assert not any(said in note for note in correct(flight(), PROFILE).notes)
    for name, sigma in (
        ("temperature_c", done.temperature_uncertainty_k),
        ("humidity_percent", done.humidity_uncertainty_percent),
    ):
        value = getattr(done, name)
        if given_as_read:
            assert np.array_equal(value, getattr(slipped, name)) and np.isnan(sigma).all()
        else:
            known = np.isfinite(value)
            assert np.mean(np.abs(value - TRUTH[name])[known] <= 1.96 * sigma[known]) > 0.85


def test_times_in_minutes_are_told_by_the_climb():
    """At a pace that the profile does not name, no pace is odd: but nothing climbs by 300 m/s."""
    log = flight().at(np.arange(0, 800, 7))
    climbing = dataclasses.replace(log, altitude_m=5.0 * log.time_s)
    minutes = dataclasses.replace(climbing, time_s=log.time_s / 60.0)
    said = [any("seem to be in minutes" in note for note in correct(one, PROFILE).notes) for one in (climbing, minutes)]
    assert said == [False, True]


def test_a_rocket_that_coasts_is_no_log_in_minutes():
    """Before: half of it rises by more than 100 m/s, and none of its rows was corrected."""
    log = flight().at(np.arange(0, 600))
    time_s = 0.04 * np.arange(600.0)
    coasting = 260.0 * time_s - 5.5 * time_s**2 + 0.3 * np.random.default_rng(2).standard_normal(600)
    done = correct(dataclasses.replace(log, time_s=time_s, altitude_m=coasting), PROFILE)
    assert not any("seem to be in minutes" in note for note in done.notes)
    assert np.isfinite(done.temperature_uncertainty_k).all()


def test_long_times_are_said_without_powers_of_ten():
    log = flight().at(np.arange(0, 600))
    leaps = dataclasses.replace(log, time_s=log.time_s + np.where(np.arange(600) < 300, 0.0, 14540.0))
    assert any(note.startswith("the clock steps by +14540 s") for note in correct(leaps, PROFILE).notes)
    stands = dataclasses.replace(log, time_s=20.0 * log.time_s, humidity_percent=np.full(600, 41.0))
    assert any("stands at 41 %RH for 1198 s of 1198 s" in note for note in doubts(stands))


def test_rows_without_vapour_tell_nothing_of_what_goes_with_the_temperature():
    """Warnings are errors here. Before: an overflow, where a hot balloon's sensor read 0 %RH and then more."""
    rng = np.random.default_rng(4)
    temperature = np.cumsum(0.02 * rng.standard_normal(3000))
    vapour = 2e4 - 2e3 * temperature
    air = film_response(PROFILE.humidity, np.full(3000, 20.0), Stream(np.full(3000, 5.0)))
    some = np.where(np.arange(3000) > 2900, 0.0, 2e3)
    found = humidity_channel._coupling(0.1 * np.arange(3000), vapour, temperature, np.zeros(3000), some, air)
    assert found > 0.3


def test_columns_in_one_anothers_place_are_said_and_given_as_read():
    log = flight()
    through_a_door = log.humidity_percent + np.where(np.arange(log.time_s.size) < 500, 0.0, 35.0)
    swapped = dataclasses.replace(log, temperature_c=through_a_door, humidity_percent=log.temperature_c)
    # some rows in degF as well: what a part of the log holds does not hide what it mostly does. Before: corrected
    warm = np.where(np.arange(log.time_s.size) < 60, 1.8 * through_a_door + 32.0, through_a_door)
    for one in (swapped, dataclasses.replace(swapped, temperature_c=warm)):
        done = correct(one, PROFILE)
        assert np.array_equal(done.temperature_c, one.temperature_c)
        assert any("seem to stand in one another's place" in note for note in done.notes)
        assert np.isnan(done.temperature_uncertainty_k).all() and done.flags["not_corrected"].all()


def test_an_airspeed_that_is_not_known_widens_what_depends_on_it():
    film = StatedEffect("convective_film", {"biot_at_5_m_s": Uncertain(0.15, 0.001)})
    filmed = dataclasses.replace(PROFILE, temperature=dataclasses.replace(PROFILE.temperature, effects=(film,)))
    flown = fly(convective(np.random.default_rng(3), duration_s=60.0), filmed, 3)
    log = to_flight(flown.log)
    sizes = [
        rms(correct(dataclasses.replace(log, airspeed_m_s=speed), filmed).temperature_uncertainty_k)
        for speed in (log.airspeed_m_s, np.full(log.time_s.size, 10.0), np.full(log.time_s.size, np.nan))
    ]
    assert sizes[0] < sizes[1] < sizes[2]


def test_readings_of_calm_air_on_four_steps_of_the_log_are_alive():
    """A door alone tells how noisy they are, and what is stated may be more: they passed for stuck, all behind it."""
    rng, row = np.random.default_rng(7), np.arange(3000)
    air = np.where(row < 1000, 18.0, 42.28)
    reading = np.minimum(np.round(air + 0.05 * rng.standard_normal(3000), 1), 42.4)
    found = screen(0.1 * row, reading, RANGES["humidity_reading_percent"], 0.066, share=0.12, swing=30.0)
    assert (found.usable | found.capped).all() and not found.repeated.any()


def test_the_step_of_a_log_is_that_of_the_grid_its_readings_lie_on():
    """A stretch that dithers, or the plateaus on either side of a door, are no steps of the log."""
    rng = np.random.default_rng(4)
    coarse = np.round(32.0 + 3.0 * np.sin(np.arange(2400) / 300.0) + 0.06 * rng.standard_normal(2400))
    coarse[800:1300] = 32.0 + 0.01 * rng.integers(-1, 2, 500)
    assert resolution_of(coarse) == 1.0
    door = np.round(np.where(np.arange(1200) < 600, 25.7, 12.5) + 0.01 * rng.standard_normal(1200), 2)
    assert resolution_of(door) == pytest.approx(0.01)
    two_levels = np.where(np.arange(1200) < 600, 23.0, 8.5)  # one a multiple of 0.5 and no more
    assert resolution_of(two_levels) == 0.5
    two_levels[1000:1080] += rng.standard_normal(80)  # a burst in a calm room
    assert resolution_of(two_levels) >= 0.5
    seldom = np.round(24.0 - 14.0 * np.tanh((np.arange(240) - 120.0) / 5.0))  # few rows on a step, then stuck
    seldom[40:64] = 23.0 + 0.0061 * rng.integers(-1, 2, 24)
    assert resolution_of(seldom) == 1.0
    door = np.concatenate([rng.permutation(np.repeat([22.0, 22.25], [46, 97])), [18.25, 6.0, 4.75], np.full(269, 4.5)])
    door[60:75] = 22.0 + 0.01 * rng.integers(-1, 2, 15)  # it dithers between the only two levels that are held beside
    assert resolution_of(door) == 0.25
    ramp = np.concatenate([np.full(109, 25.5), [25.0, 24.5, 24.0, 23.5, 22.5, 22.5, 22.0, 21.5], np.full(122, 21.0)])
    assert resolution_of(ramp) == 0.5  # what occurs again is three steps apart


def test_steps_of_a_log_may_be_uneven():
    """A tethersonde writes tenths of a kelvin as the nearest eighth, some of them as they are: steps of 0.025 to 0.125
    K, of which the smallest passed for the log's. Two of three rows were then a sensor that stood."""
    rng = np.random.default_rng(5)
    air = -4.0 + 3.0 * np.sin(np.arange(6000) / 900.0) + np.cumsum(0.004 * rng.standard_normal(6000))
    tenth = np.round(10.0 * air)
    written = np.array([0.0, 0.125, 0.25, 0.375, 0.4, 0.5, 0.625, 0.75, 0.875, 0.9])
    reading = np.floor(tenth / 10.0) + written[(tenth % 10.0).astype(int)]
    assert resolution_of(reading) == pytest.approx(0.125)
    found = screen(1.0 * np.arange(6000), reading, RANGES["temperature_c"], 0.05, share=0.1, swing=15.0)
    assert found.usable.all() and not found.repeated.any()


def test_a_sensor_that_stands_to_the_end_of_the_log_is_said_to():
    """However many of its readings lie on one level: one level is no grid."""
    done = correct(flight(humidity_percent=lambda v: put(slice(170, None), v[170])(v)), PROFILE)
    assert any("humidity_percent: the reading stands at" in note for note in done.notes)


def test_rows_that_get_no_value_because_the_reading_is_held_are_counted():
    """A thermometer at the end of its range, for less than a fifth of the log: blank without a word."""
    time_s, unknown = np.arange(1000.0), np.full(1000, np.nan)
    air = -30.0 - 25.0 * np.sin(time_s / 400.0) + 0.02 * np.random.default_rng(2).standard_normal(1000)
    jumping = np.where((time_s >= 400) & (time_s < 560), -90.0, np.maximum(air, -50.0))
    for reading, why in ((np.maximum(air, -50.0), "held at -50"), (jumping, "implausible, such as -90")):
        done = correct(Flight(time_s, reading, *4 * [unknown]), PROFILE)
        said = [note for note in done.notes if "without a value" in note and f"the reading is {why}" in note]
        assert len(said) == 1 and int(re.search(r"\d+ rows", said[0])[0].split()[0]) > 80
    every = sum(int(re.search(r"(\d+) rows without a value", note)[1]) for note in done.notes if "a value" in note)
    assert every == np.isnan(done.temperature_c).sum()


def test_a_jump_of_a_few_coarse_steps_is_seen():
    """27.5 degC, 33.5 for three seconds, 27.5 again, by a bead that shows a third of a step in a row."""
    rng = np.random.default_rng(1)
    reading = np.round((27.5 + 0.3 * np.sin(np.arange(600) / 40.0) + 0.02 * rng.standard_normal(600)) / 0.5) * 0.5
    reading[300:315] = 33.5
    found = screen(0.2 * np.arange(600), reading, RANGES["temperature_c"], 0.02, share=0.33, swing=20.0)
    assert found.implausible[300:315].all() and not found.implausible[:300].any()


def test_a_ceiling_is_where_the_sensor_stopped():
    rng = np.random.default_rng(0)
    reading = np.minimum(90.0 + 15.0 * np.sin(np.arange(600) / 60.0) + 0.06 * rng.standard_normal(600), 100.0)
    found = screen(0.1 * np.arange(600), reading, RANGES["humidity_reading_percent"], 0.06)
    assert np.array_equal(found.capped, reading == 100.0) and not found.usable[reading == 100.0].any()
    assert found.usable[reading < 99.9].mean() > 0.95


@pytest.mark.parametrize(("limit", "given"), [(70.0, False), (100.0, True)])
def test_far_beyond_a_ceiling_a_value_is_given_where_no_air_has_more(limit, given):
    moist = fly(frontal(airspeed_m_s=15.0, lead_m=360.0, width_m=150.0, humidity_percent=60.0), PROFILE, 7)
    log = to_flight(moist.log)
    held = log.time_s > 30.0
    reading = np.where(held, limit, np.minimum(log.humidity_percent, limit - 0.1))
    found = correct(dataclasses.replace(log, humidity_percent=reading), PROFILE)
    far = log.time_s > 36.0
    assert np.isfinite(found.humidity_percent[far]).all() == given
    if given:
        np.testing.assert_allclose(found.humidity_percent[far], limit, atol=0.01)  # what is left of the lag
    else:
        assert np.isnan(found.humidity_percent[far]).all()


# -- profiles ------------------------------------------------------------------------------


def table(change):
    rows = change(list(PROFILE.humidity.diffusivity_table))
    return dataclasses.replace(PROFILE, humidity=dataclasses.replace(PROFILE.humidity, diffusivity_table=tuple(rows)))


def times(row, factor):
    d, u = row.diffusivity_m2_s * factor, row.standard_uncertainty * factor
    return dataclasses.replace(row, diffusivity_m2_s=d, standard_uncertainty=u)


def turned(rows):
    """The rates of the rows in reverse, with the times that are stated beside them."""
    return [
        dataclasses.replace(other, ambient_temperature_c=row.ambient_temperature_c)
        for row, other in zip(rows, rows[::-1], strict=True)
    ]


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("factor", [3.0, 30.0, 1000.0])
@pytest.mark.parametrize("place", [0, 2, 5])
def test_a_row_of_the_table_that_stands_out_is_said(place, factor, stated):
    def change(rows):
        rows[place] = times(rows[place], factor)
        return rows if stated else [dataclasses.replace(row, response_time_s=None) for row in rows]

    assert profile_doubts(table(change))


def test_a_table_reversed_and_an_alpha_beside_its_times_are_said():
    assert profile_doubts(PROFILE) == []
    assert any("reversed" in one for one in profile_doubts(table(turned)))
    alpha = PROFILE.temperature.thermal_diffusivity_m2_s.value
    for factor in (100.0, 0.01):
        wrong = dataclasses.replace(
            PROFILE.temperature, thermal_diffusivity_m2_s=Uncertain(factor * alpha, 0.005 * alpha * factor)
        )
        profile = dataclasses.replace(PROFILE, temperature=wrong)
        assert profile_doubts(profile)
        assert correct(flight(), profile).notes[0].startswith("profile: temperature: alpha")


def test_a_film_that_is_no_arrhenius_law_is_not_doubted():
    """IST's response times to 63 %: 0.6, 5.2 and 11 s at 25, 5 and -10 degC."""
    rate = [0.32025 * PROFILE.humidity.film_thickness_m**2 / t for t in (11.0, 5.2, 0.6)]
    rows = [
        dataclasses.replace(
            row, ambient_temperature_c=at, diffusivity_m2_s=d, standard_uncertainty=0.02 * d, response_time_s=None
        )
        for row, at, d in zip(PROFILE.humidity.diffusivity_table, (-10.0, 5.0, 25.0), rate, strict=False)
    ]
    assert profile_doubts(table(lambda _: rows)) == []


def test_a_reading_that_stays_where_the_noise_is_less_than_stated_is_no_repeat():
    """A radiosonde's hygrometer in the stratosphere: noise of 0.3 %RH is stated, there it is less than a step of the
    log. 1003 of its readings passed for ones of a sensor that stood, and 0.9 %RH was unsure by 99 %RH."""
    rng = np.random.default_rng(7)
    time_s = np.arange(3000.0)
    moist = 40.0 + 20.0 * np.sin(np.arange(1000) / 40.0) + rng.normal(0.0, 0.03, 1000)
    dry = 0.9 + 0.15 * np.sin(np.arange(2000) / 90.0) + rng.normal(0.0, 0.005, 2000)
    reading = np.round(np.concatenate([moist, dry]), 1)
    found = screen(time_s, reading, RANGES["humidity_reading_percent"], 0.3)
    assert found.usable[1000:].all() and not found.repeated[1000:].any()
    # values that are written three times each go on by more than a step of the log
    thrice = screen(time_s, np.repeat(np.round(moist, 1), 3), RANGES["humidity_reading_percent"], 0.3)
    assert thrice.repeated.mean() > 0.6
