"""Names beside descriptions: forms and entries that are one law by closed form, a delay that is no clock's drift; and
what only single readings show, a mean, a rounding, a hum with a known period."""

from dataclasses import replace

import numpy as np
import pytest
from small_worlds import record, small_plan

from shockrig.analysis.characterize.part_fit import extension_of
from shockrig.analysis.diagnose import grammar
from shockrig.analysis.diagnose.adequacy import judge
from shockrig.analysis.diagnose.candidates import candidates
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.diagnose.grammar import forms
from shockrig.analysis.diagnose.hums import without_hums
from shockrig.analysis.diagnose.pool import Search
from shockrig.analysis.diagnose.prepare import likelier_average, prepare, with_rounding
from shockrig.analysis.diagnose.race import Race
from shockrig.analysis.diagnose.remainder import Tolerance
from shockrig.analysis.diagnose.search import first_look, search
from shockrig.analysis.effects import CATALOGUE, behaviours
from shockrig.analysis.effects.described import as_listed, described, discovered_of, entry_of
from shockrig.analysis.effects.forms import LAWS, MEAN, Form, laws_of
from shockrig.analysis.estimate.channel import rebin
from shockrig.analysis.estimate.effect import SingleReadings
from shockrig.analysis.estimate.fit import fit
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import Held, Model, Point, Structure
from shockrig.analysis.estimate.refitting import plain_fit
from shockrig.analysis.estimate.without_model import mostly_repeats
from shockrig.analysis.flight.undo_readout import not_undone
from shockrig.analysis.report import diagnosis_words
from shockrig.analysis.report.diagnosis_words import behaves, flies, sentence
from shockrig.files import diagnosis_data
from shockrig.rig.seams import Air
from shockrig.rig.virtual.plans import Shock, standard_plan, wide_plan
from shockrig.rig.virtual.truth import ROUGH, Hidden, draw_truth

T = ("temperature",)
HUM_HZ, AMPLITUDE_K = 0.37, 0.05


pytestmark = pytest.mark.usefixtures("catalogue_as_it_was")


def channel_of(folder, seed, hidden, plan=None):
    return build_channel(record(folder / "campaign", seed, hidden, ROUGH, plan or standard_plan()), "temperature")


def ready_of(folder, seed, hidden, plan=None):
    return prepare(channel_of(folder, seed, hidden, plan))


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """A channel that is logged late by 0.5 s, after plateaus that are all alike, and its plain fit."""
    ready = ready_of(tmp_path_factory.mktemp("late"), 5, [Hidden("dead_time", {"delay_s": 0.5}, T)], wide_plan())
    return ready, plain_fit(ready.problem, ready.structure)


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Both channels of a plain world."""
    campaign = record(tmp_path_factory.mktemp("plain") / "campaign", 5, (), ROUGH, standard_plan())
    return {name: build_channel(campaign, name) for name in ("temperature", "humidity")}


@pytest.fixture(scope="module")
def humming(tmp_path_factory):
    """A channel that hums at 0.37 Hz with 0.05 K."""
    numbers = {"amplitude": AMPLITUDE_K, "hum_hz": HUM_HZ, "burst_share": 0.0}
    return channel_of(tmp_path_factory.mktemp("hum"), 6, [Hidden("unknown_interference", numbers, T)])


def with_effects(problem, plain, start, *effects):
    structure = plain.structure
    for effect in effects:
        structure = structure.adding(effect)
    return fit(problem, structure, Model(problem.channel, structure).start(plain.log_rates, start))


@pytest.mark.trial
def test_a_delay_is_named_and_no_clock_beside_it(late):
    """A clock's drift moves the transfer by its share of the plateau before it; here plateaus are all alike."""
    ready, plain = late
    found = search(ready.problem, ready.structure, describing=False)
    assert found.best.ids == {"dead_time"} and found.plain.fit.deviance == pytest.approx(plain.deviance)
    value, uncertainty = found.best.fit.values()["dead_time"]["delay_s"]
    assert abs(value - 0.5) < 4.0 * uncertainty < 0.1


@pytest.mark.parametrize("name", ["temperature", "humidity"])
def test_no_law_stands_in_the_race_twice(both, monkeypatch, name):
    """A form that is an entry's law is that entry; where the catalogue has it not, the form stands in its place."""
    channel = both[name]

    def laws(among):
        return {entry for one in among if one.form is not None for entry, _ in laws_of(one.form)}

    listed = {one.effect.id for one in candidates(channel)}
    assert {"dead_time", "series_lag"} <= listed and not laws(candidates(channel)) & listed
    assert all(one.starts and one.log_prior < 0.0 for one in candidates(channel))
    monkeypatch.delitem(CATALOGUE, "dead_time")
    assert "dead_time" in laws(candidates(channel))


@pytest.mark.parametrize(("key", "law"), [(key, law) for key, laws in LAWS.items() for law in laws])
def test_a_form_and_the_effect_whose_law_it_is_read_the_same(both, key, law):
    """The same closed form by two doors, in a channel where both act."""
    (behaviour, driver, factors), (name, of) = key, law
    entry = CATALOGUE[name]
    channel = both[entry.channels[-1]]
    own = ("air_humidity" if channel.jumps_with_air else "air_temperature") if driver == "air" else driver
    effect = described(Form(behaviour, own, factors).key, channel.jumps_with_air)
    parts_per_million = [p.unit for p in effect.parameters if p.name == "size"] == ["1e-6"]
    values = {"size": 2e4 if parts_per_million else 0.02, "time_constant_s": 3.0, "humidity": 0.4}
    read = []
    for one, numbers in ((effect, values), (entry, {name: values[its] for name, its in of.items()})):
        model = Model(channel, Structure((one,)))
        named = {f"{one.id}.{p.name}": numbers.get(p.name, p.none or 0.0) for p in one.parameters}
        start = model.start(np.full(channel.rates, np.log(0.1)), named)
        read.append(model.predict(Point(start, channel.at_rest()))[0])
    bare = Model(channel)
    plain = bare.predict(Point(bare.start(np.full(channel.rates, np.log(0.1))), channel.at_rest()))[0]
    assert np.abs(read[0] - plain).max() > 1e-3
    told = np.isfinite(channel.die_c) | (own != "die_temperature")  # elsewhere a form has no driver
    np.testing.assert_allclose(*(np.where(told, one, 0.0) for one in read), atol=1e-9)


def test_a_gain_of_nothing_from_a_level_on_is_a_ceiling(both):
    """With a size of minus one the form reads as the catalogue's hard limit; with half of it the excess is halved."""
    channel, key = both["humidity"], "gain|own_response|humidity:above"
    assert key in {form.key for form in forms(channel)}
    assert not any("above" in form.key for form in forms(both["temperature"]))

    def reading(one, **values):
        model = Model(channel, Structure((one,)))
        start = model.start(np.full(channel.rates, np.log(0.1)), {f"{one.id}.{k}": v for k, v in values.items()})
        return model.predict(Point(start, channel.at_rest()))[0]

    form = described(key, True)
    hard, soft, free = (reading(form, size=size, humidity=60.0) for size in (-1.0, -0.5, 0.0))
    np.testing.assert_allclose(hard, reading(CATALOGUE["saturation_clipping"], limit_percent=60.0), atol=1e-12)
    np.testing.assert_allclose(soft - 60.0, np.where(free > 60.0, 0.5, 1.0) * (free - 60.0), atol=1e-12)


def test_what_dew_brings_goes_with_the_margin_of_the_dew_point(tmp_path):
    """A wet bead in the air that it dries in; where no run is wet there is no such form."""
    key, plan = "added_rate|none|humidity:dew_margin", small_plan()
    dry = build_channel(record(tmp_path / "dry", 4, (), plan=standard_plan()), "temperature")
    assert key not in {form.key for form in forms(dry)}
    wet = [Shock(f"wet {flow:.0f}", Air(2.0, 60.0), Air(20.0, 70.0), flow) for flow in (4.0, 6.0, 8.0)]
    channel = build_channel(record(tmp_path / "wet", 4, (), plan=[*plan, *wet]), "temperature")
    assert key in {form.key for form in forms(channel)}
    effect = described(key, False)
    assert effect.of_sensor and effect.in_flight.left

    def reading(structure, **values):
        model = Model(channel, structure)
        start = model.start(np.array([0.0]), {f"{key}.{name}": value for name, value in values.items()})
        return model.predict(Point(start, channel.at_rest()))[0]

    moved = reading(Structure((effect,)), size=-0.3, time_constant_s=20.0) - reading(Structure())
    ran = np.array([not np.isclose(run, 0.0, atol=1e-12).all() for run in moved])
    c = channel.conditions
    np.testing.assert_array_equal(ran, (c.source_c < 5.0) & (c.destination_c > 15.0))
    # The dew point of 70 % at 20 degC is 14.4 degC (any psychrometric table), 12.4 K above 2 degC.
    time, run = channel.time_s[ran][0], moved[ran][0]
    expected = np.where(time > 0, -0.3 * 1.24 * np.exp(-np.maximum(time, 0.0) / 20.0), 0.0)
    np.testing.assert_allclose(run, expected, atol=6e-3)  # chambers scatter


@pytest.mark.trial
def test_a_mean_that_no_entry_accounts_for_is_described(tmp_path, monkeypatch):
    """The noise hangs together over seven readings, and the response is late by half of them; nothing else is said."""
    late = [Hidden("moving_average", {"samples": 7.0}, T)]
    channel = build_channel(record(tmp_path / "c", 8, late, ROUGH, standard_plan()), "temperature")
    monkeypatch.delitem(CATALOGUE, "moving_average")
    found = diagnose_channel(channel, tolerance=Tolerance(0.0, 0.0))
    assert (found.verdict, found.causes) == ("described", ())
    (one,) = found.discovered
    assert (one.behaves_as, one.driver, [on.factor for on in one.depends_on]) == (*MEAN.key.split("|")[:2], ["history"])
    assert one.time_constant_s.value == pytest.approx(0.7, abs=1e-6) and behaves(one).startswith("a mean")
    extended = extension_of((), (one,), "temperature")
    assert extended.structure.held_values(MEAN.key) == {"time_constant_s": one.time_constant_s.value}
    values = {"time_constant_s": one.time_constant_s.value}
    assert described(MEAN.key, False).in_flight.delay_s(values, 0.1) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("name", "step"), [("temperature", 0.1), pytest.param("humidity", 1.0, marks=pytest.mark.trial)]
)
def test_a_rounding_that_no_entry_accounts_for_is_described(tmp_path, monkeypatch, name, step):
    """It is seen in single readings; no part of the response, nor of a flight."""
    coarse = [Hidden("quantization", {"step": step}, (name,))]
    channel = build_channel(record(tmp_path / "c", 8, coarse, ROUGH, small_plan()), name)
    monkeypatch.delitem(CATALOGUE, "quantization")
    found = diagnose_channel(channel, tolerance=Tolerance(0.0, 0.0))
    assert (found.verdict, found.causes) == ("described", ())
    (one,) = found.discovered
    assert one.size.value == pytest.approx(step, rel=1e-6)
    assert behaves(one) == "a rounding of the readings" and "no part in a flight" in flies(one, name)
    assert entry_of(one, name) is None


@pytest.mark.parametrize("seed", [8, pytest.param(9, marks=pytest.mark.trial)])
def test_noise_that_no_plateau_shows_is_told_by_what_crosses_codes(tmp_path, seed):
    """Set points lie on codes of 1 %RH, where noise throws no reading to the next. Before: it was 1e-11 %RH, so that
    independent errors were likelier than rounding's own, and calibrations were named."""
    coarse = [Hidden("quantization", {"step": 1.0}, ("humidity",))]
    true = draw_truth(np.random.default_rng(seed), ROUGH, coarse).humidity_noise
    channel = build_channel(record(tmp_path / "c", seed, coarse, ROUGH, small_plan()), "humidity")
    ready = prepare(channel)
    assert ready.rounds_coarsely and ready.noise.white < 0.1 * true.white
    found = with_rounding(ready, first_look(ready.problem, ready.structure))
    assert found.noise.white == pytest.approx(np.hypot(true.white, true.correlated), rel=0.5)
    assert found.problem is not ready.problem


@pytest.mark.trial
@pytest.mark.parametrize("seed", [8, 9])
def test_a_coarse_rounding_is_no_calibration(tmp_path, seed):
    coarse = [Hidden("quantization", {"step": 1.0}, ("humidity",))]
    found = diagnose_channel(build_channel(record(tmp_path / "c", seed, coarse, ROUGH, standard_plan()), "humidity"))
    assert (found.verdict, [cause.effect for cause in found.causes]) == ("explained", ["quantization"])


@pytest.mark.trial
def test_the_response_says_how_long_a_mean_is_of_which_every_sixth_reading_is_shown(tmp_path):
    """Two such means in a row share four readings of ten; how many of how many the noise hardly tells."""
    late = [Hidden("moving_average", {"samples": 10.0}, T)]
    channel = build_channel(record(tmp_path / "c", 9, late, ROUGH, standard_plan()[:16]), "temperature")
    shown = [(time[::6], value[::6]) for time, value in channel.samples]
    thinned = rebin(channel, shown, [at[::6] for at in channel.bin_of], tuple(d[::6] for d in channel.die_samples), 6)
    ready = prepare(thinned, 13)
    found = search(ready.problem, ready.structure, describing=False)
    assert likelier_average(ready, found, judge(ready.problem, found.best.fit).passed) == 10


def test_readings_over_again_are_no_mean(late):
    """Rows that repeat the one before hang together as a mean's do; rounding makes rows alike, and by one step."""
    channel = late[0].problem.channel

    def logged(of):
        return replace(channel, samples=tuple((time, of(value)) for time, value in channel.samples))

    held = logged(lambda value: np.repeat(value[::4], 4)[: value.size])
    assert mostly_repeats(held, 0.001) and not mostly_repeats(channel, 0.001)
    rounded = logged(lambda value: np.round(value / 0.5) * 0.5)
    assert not mostly_repeats(rounded, 0.5)
    noise = replace(late[0].noise, averaged=4)
    seen = CATALOGUE["moving_average"].readout.in_noise
    assert seen(SingleReadings(channel, 0.001, noise)) is not None and seen(SingleReadings(held, 0.001, noise)) is None


@pytest.mark.trial
def test_a_mean_that_the_noise_denies_is_none_whatever_the_response_says(tmp_path, monkeypatch):
    """A ramp that nothing names leaves a plainly wrong model, which a mean would help by thousands; the noise is of
    single readings."""
    ready = ready_of(tmp_path, 8, [Hidden("finite_transfer", {"duration_s": 0.6}, T)])
    plain = plain_fit(ready.problem, ready.structure)
    delay = with_effects(ready.problem, plain, {"dead_time.delay_s": 0.3}, CATALOGUE["dead_time"])
    entry = CATALOGUE["moving_average"]
    averaged = delay.structure.adding(entry, Held(entry.id, "samples", 4.0))
    better = fit(ready.problem, averaged, Model(ready.problem.channel, averaged).start(delay.log_rates, delay.choice))
    assert better.deviance < delay.deviance - 1000.0
    race = Race(ready.problem, ready.structure, ())
    pool = (race.rated(delay), race.rated(plain))
    found = Search(pool[1], pool[0], pool, np.array([1.0, 0.0]), 2, pool, pool[0])
    assert likelier_average(ready, found, False) is None
    monkeypatch.delitem(CATALOGUE, "moving_average")
    assert likelier_average(ready, found, False) is None


def test_a_hum_is_told_by_its_period_and_its_amplitude(humming):
    """And is no noise: what is left once it is out of the readings is as quiet as the sensor is without it."""
    quiet, (one,) = without_hums(humming)
    assert (one.behaves_as, one.driver, one.phase_rad) == ("periodic", "none", None)
    assert abs(one.period_s.value - 1.0 / HUM_HZ) < 5 * one.period_s.standard_uncertainty < 0.02
    assert one.size.value == pytest.approx(AMPLITUDE_K, rel=0.15)
    true = draw_truth(np.random.default_rng(6), ROUGH, []).temperature_noise
    assert prepare(quiet).noise.standard_deviation == pytest.approx(np.hypot(true.white, true.correlated), rel=0.15)
    assert entry_of(one, "temperature") is None  # it is no part of a response, and none of a flight
    (said,) = not_undone((), "temperature", (one,))
    assert "no part in a flight" in said and flies(one, "temperature").endswith("no part in a flight")
    assert sentence(one, "K").startswith("It behaves as a hum that goes on all along (size 0.0")


def test_where_nothing_hums_the_readings_stay_as_they_are(late, both):
    for channel in (late[0].problem.channel, *both.values()):
        quiet, hums = without_hums(channel)
        assert hums == () and quiet is channel


def test_the_bursts_of_a_hum_are_not_its_amplitude(tmp_path):
    """Eight seconds of a hundred are ten times as strong; the amplitude is that of the others."""
    numbers = {"amplitude": AMPLITUDE_K, "hum_hz": 1.2, "burst_share": 0.08}
    _, (hum,) = without_hums(channel_of(tmp_path, 6, [Hidden("unknown_interference", numbers, T)], small_plan()))
    assert hum.behaves_as == "periodic" and hum.size.value == pytest.approx(AMPLITUDE_K, rel=0.05)


def test_a_drift_by_the_hour_is_told_from_one_by_the_run_where_the_times_part_them(late):
    """Runs of the virtual bench begin an hour apart: there the order stands for both. After a night they part."""
    channel = late[0].problem.channel
    c = channel.conditions
    np.testing.assert_allclose(np.diff(c.hours), np.diff(c.order), atol=1e-6)
    by_hour = Form("offset", "none", (("time_of_campaign", "linear"),))
    assert by_hour not in list(forms(channel))
    night = replace(channel, conditions=replace(c, hours=c.hours + np.where(c.order > 5, 200.0, 0.0)))
    assert by_hour in list(forms(night))
    effect = described(by_hour.key, False)
    assert effect.parameters[0].unit == "K/h" and not effect.of_sensor and effect.in_flight is None

    def reading(structure, **values):
        model = Model(night, structure)
        named = {f"{by_hour.key}.{name}": value for name, value in values.items()}
        return model.predict(Point(model.start(np.array([np.log(0.3)]), named), night.at_rest()))[0]

    moved = reading(Structure((effect,)), size=0.01) - reading(Structure())
    np.testing.assert_allclose(moved, np.broadcast_to(0.01 * night.conditions.hours[:, None], moved.shape), atol=1e-12)


def test_air_that_comes_in_evenly_is_the_ramp_of_a_slow_transfer(late):
    """The same closed form as the catalogue's, by another door: a lag that is over after its time."""
    channel = late[0].problem.channel
    even = described(Form("lag_in_series", "air_temperature", (("history", "linear"),)).key, False)
    entry = CATALOGUE["finite_transfer"]
    both = []
    for effect, name in ((even, "time_constant_s"), (entry, "duration_s")):
        model = Model(channel, Structure((effect,)))
        start = model.start(np.array([np.log(0.3)]), {f"{effect.id}.{name}": 0.6})
        both.append(model.predict(Point(start, channel.at_rest()))[0])
    np.testing.assert_allclose(*both, atol=1e-12)


def test_a_description_without_factors_flies_as_the_catalogued_effect_of_its_closed_form(late):
    """Where a described chain and a catalogued one read the same, a simulation may take the one's equation."""
    channel = late[0].problem.channel
    values = {"size": (0.2, 0.01), "time_constant_s": (3.0, 0.1)}
    for key in ("delay|none", "lag_in_series|air_temperature", "parallel_lag|air_temperature", "offset|none"):
        effect = described(key, False)
        stated = as_listed(discovered_of(effect, {p.name: values[p.name] for p in effect.parameters}))
        entry = CATALOGUE[stated.effect]
        read = []
        for one, numbers in (
            (effect, {p.name: values[p.name][0] for p in effect.parameters}),
            (entry, {name: value.value for name, value in stated.parameters.items()}),
        ):
            model = Model(channel, Structure((one,)))
            named = {f"{one.id}.{name}": value for name, value in numbers.items()}
            read.append(model.predict(Point(model.start(np.array([np.log(0.3)]), named), channel.at_rest()))[0])
        np.testing.assert_allclose(*read, atol=1e-9)
    scaled = described("offset|none|airflow:power", False)
    assert as_listed(discovered_of(scaled, {"size": (0.1, 0.01), "airflow": (-0.5, 0.1)})) is None


@pytest.mark.trial
def test_a_number_that_a_channel_cannot_see_is_not_held_against_an_effect(tmp_path):
    """A room's humidity moves no bead: air that comes in from it is not outdone by a form with one number less."""
    true = {"fraction": 0.05, "time_constant_s": 9.0, "room_temperature_c": 23.0, "room_humidity_percent": 44.0}
    channel = build_channel(
        record(tmp_path / "c", 13, [Hidden("air_relaxation", true, ())], ROUGH, standard_plan()), "temperature"
    )
    found = diagnose_channel(channel, tolerance=Tolerance(0.0, 0.0))
    assert [cause.effect for cause in found.causes] == ["air_relaxation"] and found.causes[0].probability > 0.9


def test_a_gain_about_a_zero_that_depends_on_airflow_is_the_sensors_and_said_to_be_left_in_a_flight():
    zero = described("gain|own_response|airflow:power|ambient:zero_at", False)
    assert zero.of_sensor and zero.in_flight.left


def test_every_behaviour_is_computed_and_looked_for_and_may_stand_in_a_file_and_has_words():
    looked_for = {form.partition("|")[0] for listed in grammar.BASES.values() for form in listed.split()}
    assert looked_for == {*behaviours.BEHAVIOURS}
    assert {*behaviours.BEHAVIOURS, "bursts"} == {*diagnosis_data.BEHAVIOURS} == {*diagnosis_words.BEHAVIOURS}
