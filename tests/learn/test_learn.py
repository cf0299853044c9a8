"""Flights that diagnose themselves: closed forms, slopes, and worlds whose sensor and clock are known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from benchmark_scripts import benchmark
from scipy.signal import lfilter

import shockrig
from shockrig.analysis.flight.comparisons import PARTED
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.learn import learn as race
from shockrig.analysis.learn.bins import SUB_SAMPLES, binned, passes, side_by_side, why_nothing
from shockrig.analysis.learn.density import SensorModel, begun, density, prepared, slopes
from shockrig.analysis.learn.flights_fit import Learned, fitted, known_of
from shockrig.analysis.learn.laws import LAWS, response
from shockrig.analysis.learn.learn import CLOCK, ChannelLearned, FlightCause, FlightsLearned, LearnedNumber, learn
from shockrig.analysis.learn.learned_profile import learned_profile, stated_by
from shockrig.analysis.learn.pair import beside, with_clock
from shockrig.analysis.learn.passes import Disagreement, disagreement
from shockrig.files.flight import Flight
from shockrig.files.learned import read_learned
from shockrig.files.profile import (
    DiffusivityRow,
    HumidityProfile,
    Profile,
    TemperatureProfile,
    Uncertain,
    read_profile,
)
from shockrig.files.profile_data import ResponseTime
from shockrig.protocols.cli import main
from shockrig.protocols.commands.correct import offered
from shockrig.protocols.flight_logs import read_log
from shockrig.protocols.learning import disagree, of_columns, on_clock_of, sentence, shift_by_pressure

WORLDS = benchmark("learn_worlds")
EXAMPLES = Path(__file__).parents[2] / "data" / "examples"


@pytest.fixture(scope="module")
def flight():
    """An ascent and a descent through one inversion and turbulence."""
    return WORLDS.mission(3, WORLDS.Truth(), flights=1)[0]


@pytest.fixture
def coarse(monkeypatch):
    """Flights in 64 bins in place of 128: for whole races, which take half as long then."""
    monkeypatch.setattr(race, "FLIGHT_BINS", 64)


def test_a_track_has_its_passes():
    """Two ways up and one down; a wobble on the way is none."""
    time = np.arange(0.0, 600.0, 2.0)
    altitude = np.interp(time, [0, 200, 220, 240, 300, 600], [0, 500, 490, 500, 100, 900])
    found = passes(altitude, time)
    assert [np.sign(one.climb_m_s) for one in found] == [1, -1, 1]
    assert [round(altitude[one.last]) for one in found] == [500, 100, 895]


def test_shallow_dives_are_passes_and_wandering_altitudes_are_none(flight):
    """Six metres down and up in half a minute pass the same water twice; in ten minutes, it is what satellites'
    altitudes wander by."""
    for seconds, said in ((12.0, ""), (600.0, "no air was passed twice")):
        time = np.arange(0.0, 4.0 * seconds, 1.0)
        depth = 3.0 * (1.0 - np.cos(np.pi * time / seconds))
        dive = flight.at(slice(0, 1))
        columns = {name: np.full(time.size, getattr(dive, name)[0]) for name in ("temperature_c", "humidity_percent")}
        none = np.full(time.size, np.nan)
        dive = Flight(time, *columns.values(), none, none, none, -depth)
        assert said in why_nothing(dive)
        if not said:
            assert len(binned(dive, "dive", 100).passes) == 4


def test_a_lag_follows_a_step_as_its_exponential(flight):
    """Means over bins of 1 - exp(-t/tau) after a step of the air, exactly where the step is at a bin's edge."""
    bins = binned(flight, "one", 100)
    tau, at = 7.0, 40
    air = np.zeros((bins.time_s.size, SUB_SAMPLES, 1))
    air[at:] = 1.0
    tau_of = np.full(bins.time_s.size, tau)
    seen = response(((np.ones_like(tau_of), tau_of),), bins, air)[at:, 0]
    ends = np.r_[0.0, np.cumsum(bins.length_s[at:])]
    mean = 1.0 + tau * np.diff(np.exp(-ends / tau)) / np.diff(ends)
    np.testing.assert_allclose(seen, mean, rtol=1e-9)


def assert_slopes_are_those_of_the_density(unit, laws, values, own, parameters, step_of_own=1e-4):
    """Analytic slopes over parameters (name, step, in its logarithm), sizes and moves, against differences."""
    found, _ = slopes(density(unit, SensorModel(laws, values), own), parameters)
    for i, (name, step, log) in enumerate(parameters):
        near = [
            density(
                unit,
                SensorModel(laws, {**values, name: values[name] * np.exp(s) if log else values[name] + s}),
                own,
            ).value
            for s in (-step, step)
        ]
        assert found[i] == pytest.approx((near[1] - near[0]) / (2 * step), rel=0.02, abs=0.05), name
    for i in range(own.size):
        ahead = [own + s * np.eye(own.size)[i] for s in (-step_of_own, step_of_own)]  # no knot between
        near = [density(unit, SensorModel(laws, values), one).value for one in ahead]
        assert found[len(parameters) + i] == pytest.approx((near[1] - near[0]) / (2 * step_of_own), rel=0.05, abs=0.1)


@pytest.mark.parametrize(
    ("channel", "names"),
    [
        ("temperature", ("temperature.lag",)),
        ("temperature", ("temperature.lag", "temperature.offset_in_descent")),
        ("temperature", ("position.clock_offset", "temperature.lag", "temperature.offset_in_descent")),
        ("temperature", ("position.clock_offset", "temperature.lag", "temperature.ventilated_warmth")),
        ("humidity", ("humidity.film_unlike_in_descent", "humidity.lag")),
        ("humidity", ("position.clock_offset", "humidity.warm_die", "humidity.lag")),
        ("humidity", ("humidity.second_path", "humidity.late_die", "position.clock_offset")),
    ],
)
def test_slopes_are_those_of_the_density(flight, channel, names):
    """Analytic slopes over parameters, sizes and moves, against differences of the density."""
    unit = prepared(binned(flight, "one", 60), channel)
    laws = tuple(LAWS[name] for name in names)
    values = {
        "time_constant_s": 4.0, "offset_in_descent": 0.1, "fraction": 0.2, "second_time_constant_s": 60.0,
        "die_time_constant_s": 10.0, "shift_s": 0.5, "film_behind_bead_s": 2.0, "activity": 0.4,
        "film_over_bead_k": 0.3, "rise_k_at_5_m_s": 0.3,
    }  # fmt: skip
    own = begun(unit) + 0.1
    parameters = tuple((p.name, 1e-4, p.log) for law in laws for p in law.parameters)
    assert_slopes_are_those_of_the_density(unit, laws, values, own, parameters)


def magnus_hpa(temperature_c):
    """Saturation pressure over water by the Magnus formula (WMO-No. 8, annex 4.B)."""
    return 6.112 * np.exp(17.62 * temperature_c / (243.12 + temperature_c))


def test_a_film_reads_vapour_at_its_own_temperature(flight):
    """Air whose vapour stays, and a film that warms by 5 K within a bin: one that takes up vapour reads less at once;
    one that takes up relative humidity comes to the same by its lag."""
    jump = np.where(np.arange(flight.time_s.size) < flight.time_s.size // 2, 15.0, 20.0)
    unit = prepared(binned(replace(flight, temperature_c=jump), "one", 100), "humidity")
    tau, lag = 20.0, LAWS["humidity.lag"]
    known = {"time_constant_s": tau, "film_behind_bead_s": 0.0}
    read = {}
    for activity in (0.0, 1.0):
        sensor = SensorModel((lag,), {**known, "activity": activity})
        air = sensor.meets(unit).taken_up * (1.0 / saturated_usual(unit))
        read[activity] = sensor.seen(unit, air[..., None])[:, 0]
    at_once = unit.usual_es / magnus_hpa(unit.read_c.mean(axis=1))[unit.rows]
    np.testing.assert_allclose(read[0.0], at_once, rtol=5e-3)
    warm = np.flatnonzero(unit.read_c[unit.rows].min(axis=1) == 20.0)
    since = np.cumsum(unit.bins.length_s[unit.rows][warm]) - 0.5 * unit.bins.length_s[unit.rows][warm]
    left = (read[1.0][warm] - at_once[-1]) / (at_once[0] - at_once[-1])
    early = since < 2.0 * tau
    slope = np.polyfit(since[early], np.log(left[early]), 1)[0]
    assert -1.0 / slope == pytest.approx(tau, rel=0.05)


def saturated_usual(unit):
    """Saturation pressure at the flight's usual temperature within bins, over its unit."""
    return magnus_hpa(unit.usual_c(unit.bins.within_altitudes)) / unit.usual_es


def test_a_lag_is_known_as_well_as_its_likelihood_is_steep(flight):
    """Information of a density against its profile over ln tau, air refitted at each: a line of unknown ends must not
    tell more of a lag than the readings do."""
    unit, lag = prepared(binned(flight, "one", 100), "temperature"), LAWS["temperature.lag"]
    best = fitted((lag,), [unit], np.log([5.0]))
    off = np.linspace(-0.4, 0.4, 7)

    def at(theta):
        return fitted((lag,), [unit], np.array([theta]), best, {"temperature.time_constant_s": (theta, 1e-4)}).total

    curved = -2.0 * np.polyfit(off, [at(best.theta[0] + one) for one in off], 2)[0]
    found = fitted((lag,), [unit], best.theta, best, whole=False).information[0, 0, 0]
    assert 0.5 * curved < found < 2.0 * curved


def test_a_number_at_its_bound_gains_nothing_beyond_it():
    """A share of a second path that wants to be less than nothing: its model is no likelier than its value there."""
    laws = (LAWS["temperature.second_path"],)
    known = known_of(laws)
    theta = np.array([one.mean for one in known])
    slope = np.zeros((2, theta.size))
    slope[:, 1] = -50.0
    information = np.repeat(np.eye(theta.size)[None], 2, axis=0)

    def gained(share):
        at = np.r_[theta[0], share, theta[2]]
        fit = Learned(laws, known, at, (np.array([]),) * 2, np.zeros(2), slope, information)
        return fit.predicted().sum(), fit.without(0)

    assert gained(known[1].low)[0] <= 0.0 < gained(known[1].mean)[0]
    assert gained(known[1].low)[1][1] == known[1].high  # without the half that pulls it down, no further than may be


@pytest.mark.parametrize(
    ("keys", "unseen", "mean", "gains"),
    [
        (("offset_in_descent",), True, -0.2, False),  # the offset of other flights moves the passes apart
        (("offset_in_descent",), True, 0.0, True),
        (("ventilated_warmth",), True, -0.2, False),
        (("lag",), True, -0.2, True),  # what the air did meanwhile
        (("offset_in_descent",), False, -0.2, True),  # of one flight the mean is the fit's own
    ],
)
def test_an_offset_that_parts_unseen_passes_is_no_gain(keys, unseen, mean, gains):
    """As at One Tree Island: layers 0.28 K apart as read and 0.20 K with the model, which moves the mean by 0.2 K."""
    names = ("one", "two" if unseen else "one")
    names = tuple(name for name in names for _ in range(4))
    layers, waves = np.linspace(100.0, 800.0, 8), np.tile([1.0, -1.0], 4)
    read, model = (Disagreement(names, layers, by + size * waves) for by, size in ((0.0, 0.28), (mean, 0.20)))
    laws, nothing = tuple(LAWS[f"temperature.{key}"] for key in keys), np.zeros(0)
    fit = Learned(laws, (), nothing, (), nothing, nothing, nothing, ("temperature",))
    (lag,) = LAWS["temperature.lag"].parameters
    cause = FlightCause(LAWS["temperature.lag"], 0.6, (LearnedNumber(lag, 2.0, 0.5),))
    one = ChannelLearned("temperature", "tied", (cause,), (), (), 3.0, "", fit, fit, read, model, model)
    assert one.gains is gains
    assert (learned_profile(FlightsLearned((), {}, {"temperature": one}), {}) is not None) is gains
    assert ("no gain" in disagree(one)) is not gains


def test_a_number_without_a_unit_keeps_its_last_digit():
    """0.1 of no unit is not said as 0."""
    law = LAWS["humidity.lag"]
    numbers = (LearnedNumber(law.parameters[0], 9.0, 1.0), LearnedNumber(law.parameters[2], 0.31, 0.1))
    one = SimpleNamespace(
        channel="humidity", verdict="named", causes=(FlightCause(law, 0.97, numbers),), together=lambda some: (some, [])
    )
    assert sentence(one).endswith("(9 ± 1 s, uptake by activity, not vapour 0.31 ± 0.1; probability 0.97)")


def test_a_bench_says_how_a_film_slows_in_the_cold():
    """Response times of 8 s at 20 degC that grow by 4 % per kelvin: the prior of both numbers, for the law that has
    them; the plain lag's is that of the row nearest to the flights."""
    rows = []
    for ambient in (0.0, 10.0, 25.0):
        t63 = 8.0 * np.exp(0.04 * (20.0 - ambient))
        rows.append(DiffusivityRow(ambient, 1e-11, 1e-13, response_time_s=ResponseTime(t63, 2.3 * t63, 3.9 * t63)))
    said = stated_by(Profile(humidity=HumidityProfile(tuple(rows))), 2.0)
    assert said["humidity.growth_per_k"][0] == pytest.approx(0.04)
    known = {one.name: one.mean for one in known_of((LAWS["humidity.lag_in_the_cold"],), said)}
    assert np.exp(known["time_constant_s"]) == pytest.approx(8.0)
    assert np.exp(known_of((LAWS["humidity.lag"],), said)[0].mean) == pytest.approx(8.0 * np.exp(0.8))


def test_passes_of_which_a_model_leaves_none_to_compare_are_said_to():
    """Before: "with the model by +nan K on average and nan K about it"."""
    read = Disagreement(("one",) * 3, np.arange(3.0), np.array([1.0, 2.0, 3.0]))
    none = Disagreement((), np.array([]), np.array([]))
    one = SimpleNamespace(channel="temperature", verdict="not identifiable", read=read, single=read, model=none)
    one.gain, one.gains = None, False
    assert "with the model in no layer that can be compared: no gain" in disagree(one)


def test_a_profile_by_hand_has_the_response_times_that_its_rates_make():
    """One lag each of R²/alpha = 8 ± 2 s and L²/D = 5 ± 2 s, as the page on flights states them. Before: refused, with
    the remedy to characterize the sensor anew, where `correct` had named this command."""
    bead = TemperatureProfile(Uncertain(2e-8, 5e-9), bead_radius_m=4e-4)
    film = HumidityProfile(tuple(DiffusivityRow(at, 2e-11, 8e-12) for at in (-30.0, 40.0)), film_thickness_m=1e-5)
    lumped = {sensor: {"body": "lumped"} for sensor in ("imet", "hyt")}
    said = stated_by(Profile(temperature=bead, humidity=film, sensors=lumped), 10.0)
    for channel, seconds, relative in (("temperature", 8.0, 0.25), ("humidity", 5.0, 0.4)):
        mean, sigma = said[f"{channel}.time_constant_s"]
        assert np.exp(mean) == pytest.approx(seconds, rel=0.01) and sigma == pytest.approx(relative)


def test_wash_that_cools_bead_and_film_is_one_offset(coarse):
    """1 K colder in descent: an offset of the bead, its size, and a film that is as cold, so that vapour needs none.

    The profile takes it off a flight that was not used: its ways are nearer, for both sensors.
    """
    *flights, unseen = WORLDS.mission(4, WORLDS.Truth(wash_k=-1.0), flights=3)
    found = learn({str(i): one for i, one in enumerate(flights)})
    bead, film = found.channels["temperature"], found.channels["humidity"]
    (wash,) = [cause for cause in bead.causes if cause.law.key == "offset_in_descent"]
    assert wash.probability > 0.5
    assert wash.parameters[0].value == pytest.approx(-1.0, abs=3.0 * wash.parameters[0].standard_uncertainty)
    assert all(cause.probability < 0.25 for cause in film.causes if cause.law.key.endswith("in_descent"))
    assert all(one.model.rms < 0.8 * one.read.rms for one in (bead, film))
    after = correct(unseen, learned_profile(found, {}))
    air = replace(unseen, temperature_c=after.temperature_c, humidity_percent=after.humidity_percent)
    for channel, share in (("temperature", 0.5), ("humidity", 0.5)):
        before, left = (
            disagreement([prepared(binned(one, "unseen", 100), channel)], None, channel).rms for one in (unseen, air)
        )
        assert left < share * before, channel


def test_warmth_that_the_climb_carries_off_is_told_by_its_turns():
    """0.8 K at 5 m/s, no airspeed in the logs: warmer in the hover and on the way that is slower. Its size comes out
    within three of its uncertainties and a sixth of itself, and the lag within two of its own."""
    flights = WORLDS.mission(5, WORLDS.Truth(warmth_k=0.8), flights=3)
    units = [prepared(binned(one, str(i), 128), "temperature") for i, one in enumerate(flights)]
    laws = LAWS["temperature.lag"], LAWS["temperature.ventilated_warmth"]
    found = fitted(laws, units, np.array([np.log(4.0), 0.5]))
    sigma = np.sqrt(np.diag(found.covariance))
    assert found.theta[1] == pytest.approx(0.8, abs=min(3.0 * sigma[1], 0.8 / 6.0))
    assert found.theta[0] == pytest.approx(np.log(5.0), abs=2.0 * sigma[0])


@pytest.mark.parametrize(("channel", "key"), [("temperature", "ventilated_warmth"), ("humidity", "warm_die")])
def test_no_flight_tells_a_pitot_tubes_scale(flight, channel, key):
    """A pitot tube that reads 1.3 times too much is a warmth that is 1.3^(1/2) times as large: the same likelihood."""
    wrong, law, speed = 1.3, LAWS[f"{channel}.{key}"], np.interp(flight.altitude_m, [0.0, 1200.0], [4.0, 15.0])
    found = []
    for scale in (1.0, wrong):
        log = replace(flight, airspeed_m_s=scale * speed)
        unit = prepared(binned(log, "one", 60), channel)
        rise = {"rise_k_at_5_m_s": 0.8 * np.sqrt(scale)}
        found.append(density(unit, SensorModel((law,), rise), begun(unit)).value)
    none = density(unit, SensorModel((law,), {"rise_k_at_5_m_s": 0.8}), begun(unit)).value
    assert found[1] == pytest.approx(found[0], abs=1e-6)
    assert abs(none - found[0]) > 1e-3


def test_one_flight_and_no_bench_about_halve_the_errors_of_both_sensors():
    """The example flight alone, whose air is known: nothing is refuted by the one flight that is fitted, a lag is among
    the answers, and corrected with the profile learned from itself the thermometer is less than half as far from the
    air, and the hygrometer about half."""
    flight = read_log(EXAMPLES / "flight.csv")[0]
    found = learn({"flight.csv": flight})
    for one in found.channels.values():
        assert one.refuted == ()
        assert any(cause.law.lags is not None for cause in one.causes)
    profile = learned_profile(found, {})
    assert profile is not None
    corrected = correct(flight, profile)
    truth = np.genfromtxt(EXAMPLES / "truth.csv", delimiter=",", skip_header=1, usecols=(1, 2)).T
    for air, name, most in zip(truth, ("temperature_c", "humidity_percent"), (0.5, 0.55), strict=True):
        read, left = (np.sqrt(np.nanmean((getattr(one, name) - air) ** 2)) for one in (flight, corrected))
        assert left < most * read


def test_a_flight_that_says_nothing_is_left_out_with_its_reason(flight):
    """No altitude; a level flight."""
    assert "altitude" in why_nothing(replace(flight, altitude_m=None))
    assert "no air was passed twice" in why_nothing(replace(flight, altitude_m=np.full(flight.time_s.size, 80.0)))


def test_a_clock_and_lags_are_found_from_the_command_line(tmp_path, capsys):
    """A clock that is 18 s off beside lags of 5 and 10 s: named as a clock; the profile has the lags."""
    truth = WORLDS.Truth(clock_s=18.0)
    paths = [str(WORLDS.write(one, tmp_path / f"{i}.csv")) for i, one in enumerate(WORLDS.mission(5, truth, flights=2))]
    assert main(["learn", *paths, "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "clock offset" in said
    document = json.loads((tmp_path / "out" / "learned.json").read_text(encoding="utf-8"))
    (clock,) = document["position"]["causes"]
    shift = clock["parameters"]["shift_s"]
    assert shift["value"] == pytest.approx(truth.clock_s, rel=0.2)
    assert clock["probability"] > 0.8
    profile = read_profile(tmp_path / "out" / "profile.json")
    film = profile.humidity
    tau = film.film_thickness_m**2 / film.diffusivity_table[0].diffusivity_m2_s
    assert tau == pytest.approx(truth.humidity_lag_s, rel=0.35)
    assert set(read_learned(tmp_path / "out" / "learned.json").channels) == {"temperature", "humidity"}
    assert (tmp_path / "out" / "learned.html").exists()


def test_correct_offers_to_learn_where_ascent_and_descent_disagree():
    """Either note on it; no other."""
    said = offered([f"humidity: {PARTED} than as read"], Path("one.csv"), Path("p.json"))
    assert said == ("shockrig learn one.csv --profile p.json --out learned says what the sensor lacks in the air",)
    assert offered(["humidity: repeated values"], Path("one.csv"), Path("p.json")) == ()


def test_a_flight_without_a_descent_is_refused(tmp_path, capsys, flight):
    """One way alone: status 2, a sentence with the mend, nothing written."""
    up = flight.at(slice(0, flight.time_s.size // 3))
    path = WORLDS.write(up, tmp_path / "up.csv")
    assert main(["learn", str(path), "--out", str(tmp_path / "out")]) == 2
    assert "come down again" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_worlds_lag_by_their_own_equation():
    """The benchmark's sensor against SciPy's filter."""
    air = np.random.default_rng(1).normal(size=50)
    kept = np.exp(-WORLDS.STEP_S / 3.0)
    expected = lfilter([1.0 - kept], [1.0, -kept], air, zi=[kept * air[0]])[0]
    np.testing.assert_allclose(WORLDS.lagged(air, 3.0), expected, rtol=1e-12)


def test_learn_in_python_has_a_result_like_the_others(coarse):
    """A DataFrame of a log without altitude but with pressure: tables, arrays, a figure, a card; the sensors corrected;
    a sentence on the altitude; and a log of one way alone refused."""
    log = shockrig.read_flight(EXAMPLES / "flight.csv")
    frame = pd.DataFrame(
        {"time_s": log.time_s, "temperature_c": log.temperature_c, "pressure_hpa": pressure_hpa(log.altitude_m)}
    )
    found = shockrig.learn(frame)
    assert any("standard atmosphere" in note for note in found.notes)
    lags = found.to_frame().loc[["temperature"]].query("parameter == 'time_constant_s'")
    assert set(lags.unit) == {"s"} and (lags.standard_uncertainty > 0).all()
    assert "lag" in found.verdicts["temperature"] and found.verdicts["temperature"] in repr(found)
    apart = found.to_xarray()
    read = apart.passes_apart_mean.sel(channel="temperature", correction="as_read")
    assert float(read) == pytest.approx(found.result.channels["temperature"].read.mean)
    assert len(found.plot().axes) == 1
    assert "standard atmosphere" in found._repr_html_()
    after = found.correct(frame).result.temperature_c
    truth = np.genfromtxt(EXAMPLES / "truth.csv", delimiter=",", skip_header=1, usecols=1)
    assert np.sqrt(np.nanmean((after - truth) ** 2)) < np.sqrt(np.nanmean((log.temperature_c - truth) ** 2))
    with pytest.raises(shockrig.InputError, match="come down again"):
        shockrig.learn(frame[: len(frame) // 4])


def pressure_hpa(altitude_m):
    """The standard atmosphere below 11 km (ICAO 7488)."""
    return 1013.25 * (1.0 - 0.0065 * altitude_m / 288.15) ** 5.25588


def test_a_clock_is_taken_off_by_correct(tmp_path, capsys):
    """A position logged 18 s late: `--clock-s 18` gives the file that a right clock gives, other columns as they came;
    so does Python. A clock of hours, and a log without a position, are refused."""
    late = WORLDS.mission(5, WORLDS.Truth(clock_s=18.0), flights=1)[0]
    right = replace(late, altitude_m=np.interp(late.time_s + 18.0, late.time_s, late.altitude_m, right=np.nan))
    path = WORLDS.write(late, tmp_path / "late.csv")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([f"{lines[0]},note", *(f'{line},"a, b"' for line in lines[1:])]) + "\n")
    out, profile = tmp_path / "out.csv", str(EXAMPLES / "profile.json")
    command = ["correct", str(path), "--profile", profile, "--out", str(out), "--no-report", "--clock-s"]
    assert main([*command, "18"]) == 0
    table = pd.read_csv(out)
    np.testing.assert_allclose(table.altitude_m, right.altitude_m, atol=1e-3)
    assert set(table.note) == {"a, b"}
    np.testing.assert_allclose(table.temperature_c, late.temperature_c, atol=1e-3)
    in_python = shockrig.correct(late, profile, clock_s=18.0)
    np.testing.assert_allclose(in_python.flight.altitude_m, right.altitude_m, atol=1e-9)
    np.testing.assert_allclose(table.temperature_corrected_c, in_python.result.temperature_c, atol=2e-3)
    capsys.readouterr()
    assert main([*command, "7200"]) == 2
    assert "--clock-s 7200" in capsys.readouterr().err
    bare = tmp_path / "bare.csv"
    bare.write_text("time_s,temperature_c\n" + "".join(f"{i},20.0\n" for i in range(40)))
    assert main(["correct", str(bare), "--profile", profile, "--out", str(out), "--clock-s", "1"]) == 2
    assert "--column altitude=NAME" in capsys.readouterr().err


@pytest.fixture(scope="module")
def twins():
    """Two flights of two sensors in the same air: lags of 5 and 2 s, 10 and 25 s; the second 0.3 K and -1.5 %RH off."""
    return WORLDS.side_by_side(500, WORLDS.Truth(), WORLDS.Truth(2.0, 25.0), flights=2)


@pytest.mark.parametrize(
    ("channel", "first", "second"),
    [
        ("temperature", ("lag",), ("second_path",)),
        ("temperature", ("lag", "ventilated_warmth"), ()),
        ("humidity", ("lag", "late_die"), ("lag_in_the_cold",)),
    ],
)
def test_slopes_of_two_sensors_are_those_of_their_density(twins, channel, first, second):
    """Analytic slopes over both sensors' parameters, their clock, sizes and moves, against differences."""
    unit = prepared(side_by_side(*(binned(one.flight, "one", 40) for one in twins[0])), channel)
    law = beside(channel, *(tuple(LAWS[f"{channel}.{key}"] for key in keys) for keys in (first, second)))
    usual = {
        "time_constant_s": 4.0, "fraction": 0.2, "second_time_constant_s": 60.0, "die_time_constant_s": 10.0,
        "film_behind_bead_s": 2.0, "activity": 0.4, "growth_per_k": 0.02, "rise_k_at_5_m_s": 0.3,
        "offset_between": 0.4, "shift_s": 0.5,
    }  # fmt: skip
    laws = (LAWS["position.clock_offset"], law)
    parameters = tuple((p.name, 1e-4, p.log) for one in laws for p in one.parameters)
    values = {name: usual[name.removesuffix("_2")] * (1.5 if name.endswith("_2") else 1.0) for name, *_ in parameters}
    own = begun(unit) + 0.1
    assert_slopes_are_those_of_the_density(unit, laws, values, own, parameters, step_of_own=5e-4)  # less is rounding


def two_columns(twins, folder, quantity="temperature"):
    """Logs of two flights, each with the columns of both thermometers, or of both films beside one."""
    paths = []
    for i, (one, other) in enumerate(twins):
        path = WORLDS.write(one.flight, folder / f"{i}.csv")
        log = pd.read_csv(path)
        if quantity == "temperature":
            log["t_second"] = other.flight.temperature_c
            log = log.drop(columns="humidity_percent")
        else:
            log["rh_second"] = other.flight.humidity_percent
        log.to_csv(path, index=False)
        paths.append(str(path))
    return paths


def test_two_sensors_in_one_log_are_told_better_than_one(twins, tmp_path, capsys):
    """Two thermometers' columns of two flights: both lags right, and known better than alone; the calibrations'
    difference; a page, a profile and a learned.json for each, which `correct` and readers take."""
    paths, out = two_columns(twins, tmp_path), tmp_path / "out"
    assert main(["learn", *paths, "--beside", "temperature=t_second", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "the second sensor" in said and "alone it would be" in said and "times the first's" in said
    for which, lag in (("", 5.0), ("_2", 2.0)):
        document = json.loads((out / f"learned{which}.json").read_text(encoding="utf-8"))
        heat = document["channels"]["temperature"]
        tau = heat["causes"][0]["parameters"]["time_constant_s"]
        assert heat["causes"][0]["law"] == "lag"
        assert tau["value"] == pytest.approx(lag, abs=2.0 * tau["standard_uncertainty"])
        apart = document["beside"]["temperature"]
        by_itself = apart["alone_causes"][0]["parameters"]["time_constant_s"]
        assert tau["standard_uncertainty"] / tau["value"] < by_itself["standard_uncertainty"] / by_itself["value"]
        assert apart["offset"]["value"] == pytest.approx(0.3, abs=0.05)
        ratio = apart["lag_ratio"]
        assert ratio["value"] == pytest.approx(0.4, abs=2.0 * ratio["standard_uncertainty"])
        bead = read_profile(out / f"profile{which}.json").temperature
        assert bead.bead_radius_m**2 / bead.thermal_diffusivity_m2_s.value == pytest.approx(tau["value"])
        assert (out / f"learned{which}.html").exists()


@pytest.mark.trial
def test_two_films_beside_one_thermometer_are_told_apart(twins, tmp_path, capsys):
    """Two films' columns and one thermometer's: each lag within two of its uncertainties, that of the slower film known
    better than alone, 2.5 times the other's; a profile for each, of which `correct` takes the second's to its film."""
    paths, out = two_columns(twins, tmp_path, "humidity"), tmp_path / "out"
    assert main(["learn", *paths, "--beside", "humidity=rh_second", "--out", str(out)]) == 0
    assert "times the first's" in capsys.readouterr().out
    for which, lag in (("", 10.0), ("_2", 25.0)):
        document = json.loads((out / f"learned{which}.json").read_text(encoding="utf-8"))
        assert set(document["beside"]) == {"humidity"}
        (cause,) = [one for one in document["channels"]["humidity"]["causes"] if one["law"] == "lag"]
        tau, ratio = cause["parameters"]["time_constant_s"], document["beside"]["humidity"]["lag_ratio"]
        assert tau["value"] == pytest.approx(lag, abs=2.0 * tau["standard_uncertainty"])
        assert ratio["value"] == pytest.approx(2.5, abs=2.0 * ratio["standard_uncertainty"])
        film = read_profile(out / f"profile{which}.json").humidity
        assert (out / f"learned{which}.html").exists() and film.diffusivity_table
    log = pd.read_csv(paths[0])
    second = tmp_path / "second.csv"
    log.drop(columns="humidity_percent").rename(columns={"rh_second": "humidity_percent"}).to_csv(second, index=False)
    profile, corrected = str(out / "profile_2.json"), str(tmp_path / "c.csv")
    assert main(["correct", str(second), "--profile", profile, "--out", corrected]) == 0


def test_a_second_thermometers_log_has_no_film_of_its_own(twins):
    """A column of temperature alone: the first's film is not said to be beside it. A second film keeps the bead."""
    flights = {"one": twins[0][0].flight}
    assert not np.isfinite(of_columns(flights, ("temperature",)).flights["one"].humidity_percent).any()
    assert of_columns(flights, ("humidity",)).flights["one"] is flights["one"]


def test_a_second_log_is_put_on_the_firsts_clock(twins):
    """Another logger's clock and zero of altitude: moved until both have one track, to a tenth of a second, also from
    minutes on the ground; a log of another flight, and one log too few, are refused."""
    one, other = twins[0][0].flight, twins[0][1].flight
    still = np.arange(1.0, 2000.0)
    waits = other.at(np.r_[np.zeros(still.size, dtype=int), np.arange(other.time_s.size)])
    late = replace(
        waits, time_s=np.r_[other.time_s[0] - still[::-1], other.time_s] + 4711.3, altitude_m=waits.altitude_m + 35.0
    )
    moved = on_clock_of("one", one, "other", late)
    np.testing.assert_allclose(moved.time_s[-other.time_s.size :], other.time_s, atol=0.1)
    with pytest.raises(shockrig.InputError, match="logs of the same flight"):
        on_clock_of("one", one, "other", replace(late, altitude_m=200.0 * np.sin(0.02 * late.time_s)))
    with pytest.raises(shockrig.InputError, match="one for each flight"):
        shockrig.learn([one, twins[1][0].flight], beside=[other])


def test_logs_of_one_clock_stay_on_it():
    """Rows 10 s apart whose depths are taken 3 s apart: what the tracks are apart by is no clock. 25 s are one."""
    ((one, other),) = long_dives(0.0, 0.0, dives=1)
    for late_s, clock in ((3.0, False), (25.0, True)):
        depth = np.interp(other.time_s + late_s, one.time_s, one.altitude_m)
        moved = on_clock_of("one", one, "other", replace(other, altitude_m=depth)).time_s - other.time_s
        np.testing.assert_allclose(moved, late_s if clock else 0.0, atol=0.3 if clock else 0.0)


@pytest.mark.parametrize(("channel", "lags"), [("temperature", (5.0, 2.0)), ("humidity", (10.0, 25.0))])
def test_lags_of_two_sensors_are_within_their_uncertainties(twins, channel, lags):
    """One fit to both, from starts a third off: each lag within two standard uncertainties, each below 0.2 of it; the
    offset between two thermometers, 0.3 K, to 0.02 K."""
    units = [prepared(side_by_side(*(binned(one.flight, "one", 128) for one in pair)), channel) for pair in twins]
    lag = LAWS[f"{channel}.lag"]
    law = beside(channel, (lag,), (lag,))
    film = [0.0, 0.5] if channel == "humidity" else []
    found = fitted((law,), units, np.r_[np.log(0.7 * lags[0]), film, np.log(1.3 * lags[1]), film, 0.0])
    for name, true in zip(("time_constant_s", "time_constant_s_2"), lags, strict=True):
        place = [one.name for one in law.parameters].index(name)
        sigma = float(np.sqrt(found.covariance[place, place]))
        assert sigma < 0.2
        assert found.theta[place] == pytest.approx(np.log(true), abs=2.0 * sigma)
    if channel == "temperature":
        assert found.theta[-1] == pytest.approx(0.3, abs=0.02)


def test_a_housing_of_one_bead_is_no_lag_of_both_films():
    """Films of 10 s, one beside a bead with a slow path: what that bead says wrongly is its sensor's own."""
    flights = WORLDS.side_by_side(91004, WORLDS.Truth(slow_share=0.25), WORLDS.Truth(), flights=2)
    units = [prepared(side_by_side(*(binned(one.flight, "one", 128) for one in pair)), "humidity") for pair in flights]
    lag = LAWS["humidity.lag"]
    law = beside("humidity", (lag,), (lag,))
    found = fitted((law,), units, np.array([np.log(10.0), 0.0, 0.5, np.log(10.0), 0.0, 0.5, 0.0]))
    for name in ("time_constant_s", "time_constant_s_2"):
        place = [one.name for one in law.parameters].index(name)
        sigma = float(np.sqrt(found.covariance[place, place]))
        assert found.theta[place] == pytest.approx(np.log(10.0), abs=2.5 * sigma)
        assert sigma < 0.15


def test_a_clock_is_found_where_nothing_fits_without_it():
    """Two thermometers whose altitude is 18 s late: without a clock no lags of both are right, so that the clock is
    tried beside one lag of each, whatever was left of the race."""
    truth = WORLDS.Truth(clock_s=18.0)
    flights = WORLDS.side_by_side(91003, truth, replace(truth, temperature_lag_s=2.0), flights=2)
    units = [
        prepared(side_by_side(*(binned(one.flight, "one", 128) for one in pair)), "temperature") for pair in flights
    ]
    lag = LAWS["temperature.lag"]
    plain = fitted((beside("temperature", (lag,), (lag,)),), units, np.array([np.log(5.0), np.log(2.0), 0.0]))
    cause = FlightCause(CLOCK, 1.0, (LearnedNumber(CLOCK.parameters[0], 15.0, 1.0),))
    alone = [SimpleNamespace(position=(cause,)), SimpleNamespace(position=())]
    (found,) = with_clock({"temperature": []}, {"temperature": plain}, {"temperature": units}, alone, None)
    assert found.theta[0] == pytest.approx(18.0, abs=2.0)
    assert found.total > plain.total + 100.0


def test_two_logs_of_one_flight_in_python(twins):
    """Thermometers with a log each, the second's clock 100 s off: both lags within two standard uncertainties, a sensor
    and a profile for each, and how they differ in the document."""
    logs = [[pair[which].flight for pair in twins[:1]] for which in (0, 1)]
    dry = [[replace(one, humidity_percent=np.full(one.time_s.size, np.nan)) for one in some] for some in logs]
    late = [replace(one, time_s=one.time_s + 100.0) for one in dry[1]]
    found = shockrig.learn(dry[0], beside=late)
    for one, lag in ((found, 5.0), (found.beside, 2.0)):
        tau = one.result.channels["temperature"].causes[0].parameters[0]
        assert tau.value == pytest.approx(lag, abs=2.0 * tau.standard_uncertainty)
        assert one.profile is not None and one.profile.temperature is not None
    assert set(found.document.beside) == {"temperature"}


def long_dives(*lags_s, seed=1, dives=2):
    """Dives of an hour and a half to 500 m and back through a thermocline of layers that move:
    thermometers of such lags side by side, each read every 10 s to 5 mK, at times of its own."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(dives):
        at = np.arange(0.0, 5400.0, 0.5)
        depth = np.interp(at, [0.0, 2500.0, 2560.0, 5400.0], [0.0, 500.0, 500.0, 0.0])
        moved, water = depth - rng.normal(0.0, 3.0) * at / at[-1], np.full(at.size, 25.0)
        for step in np.r_[np.full(8, -1.5), rng.normal(0.0, 0.3, 8)]:
            water += 0.5 * step * (1.0 + np.tanh((moved - rng.uniform(60.0, 130.0)) / rng.uniform(6.0, 15.0)))
        flights = []
        for lag_s in lags_s:
            kept = np.exp(-0.5 / lag_s) if lag_s else 0.0
            read = lfilter([1.0 - kept], [1.0, -kept], water, zi=[kept * water[0]])[0]
            rows = np.arange(rng.integers(20), at.size, 20)
            none = np.full(rows.size, np.nan)
            value = read[rows] + rng.normal(0.0, 0.005, rows.size)
            flights.append(Flight(at[rows], value, none, none, none, none, -depth[rows]))
        found.append(flights)
    return found


@pytest.mark.parametrize("slow_s", [5.0, 0.0])
def test_lags_far_shorter_than_bins_are_told_beside_another_sensor(slow_s):
    """A lag of 5 s beside none in long dives, and none beside none: by how much they differ, to half a second, and
    neither farther from the truth than twice its uncertainty, though bins are 40 s long."""
    pairs = long_dives(slow_s, 0.0)
    units = [prepared(side_by_side(*(binned(one, "one", 128) for one in pair)), "temperature") for pair in pairs]
    lag = LAWS["temperature.lag"]
    found = fitted((beside("temperature", (lag,), (lag,)),), units, np.array([np.log(5.0), 0.0, 0.0]))
    slow, fast = np.exp(found.theta[:2])
    sigma = np.sqrt(np.diag(found.covariance))[:2] * (slow, fast)
    assert slow - fast == pytest.approx(slow_s, abs=0.5)
    assert abs(slow - slow_s) < 2.0 * sigma[0] and fast < 2.0 * sigma[1]


@pytest.mark.parametrize("late_s", [0.0, 18.0, -7.0])
def test_a_logs_own_pressure_tells_its_altitudes_clock(flight, late_s):
    """An altitude that is so many seconds behind the pressure, by another formula and with a satellite's noise."""
    pressure = pressure_hpa(np.interp(flight.time_s + late_s, flight.time_s, flight.altitude_m))
    noisy = flight.altitude_m + np.random.default_rng(2).normal(0.0, 1.0, flight.time_s.size)
    both = replace(flight, altitude_m=noisy, pressure_hpa=pressure)
    assert shift_by_pressure(both) == pytest.approx(late_s, abs=0.3)
    assert shift_by_pressure(flight) is None
    assert shift_by_pressure(replace(flight, pressure_hpa=pressure_hpa(flight.altitude_m))) is None
