"""Names beside descriptions: signatures that are alike by closed form, a plain delay that outdoes a clock's drift,
causes that are idle beside a description; and what only single readings show, a hum with a known period."""

from dataclasses import replace

import numpy as np
import pytest
from small_worlds import record

from shockrig.analysis.diagnosis.adequacy import LINE, Check, judge
from shockrig.analysis.diagnosis.beside import alone, without_idle
from shockrig.analysis.diagnosis.prepare import likelier_average, prepare
from shockrig.analysis.diagnosis.restless import nothing_else, restless
from shockrig.analysis.diagnosis.search import Search, plain_fit
from shockrig.analysis.discovery.conditions import Judged
from shockrig.analysis.discovery.discover import Described, Discovery
from shockrig.analysis.discovery.grammar import forms
from shockrig.analysis.discovery.likeness import alike, outdone
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.behaviours import Form
from shockrig.analysis.effects.described import described, discovered_of, entry_of
from shockrig.analysis.effects.described_in_flight import as_listed
from shockrig.analysis.flight.profile_effects import not_undone
from shockrig.analysis.inference.fit import fit
from shockrig.analysis.inference.gather import build_channel
from shockrig.analysis.inference.model import Held, Model, Point, Structure
from shockrig.analysis.inference.work import Work
from shockrig.analysis.report.described_words import flies, sentence
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import ROUGH, Hidden

T = ("temperature",)
HUM_HZ, AMPLITUDE_K = 0.37, 0.05


def ready_of(folder, seed, hidden):
    channel = build_channel(record(folder / "campaign", seed, hidden, ROUGH, standard_plan()), "temperature")
    return prepare(channel)


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """A channel that is logged late by 0.5 s, and its plain fit."""
    ready = ready_of(tmp_path_factory.mktemp("late"), 5, [Hidden("dead_time", {"delay_s": 0.5}, T)])
    return ready, plain_fit(ready.problem, ready.structure)


@pytest.fixture(scope="module")
def humming(tmp_path_factory):
    """A channel that hums at 0.37 Hz with 0.05 K, and its plain fit."""
    numbers = {"amplitude": AMPLITUDE_K, "hum_hz": HUM_HZ, "burst_share": 0.0}
    ready = ready_of(tmp_path_factory.mktemp("hum"), 6, [Hidden("unknown_interference", numbers, T)])
    return ready, plain_fit(ready.problem, ready.structure)


def with_effects(problem, plain, start, *effects):
    structure = plain.structure
    for effect in effects:
        structure = structure.adding(effect)
    return fit(problem, structure, Model(problem.channel, structure).start(plain.log_rates, start))


def test_the_same_signature_by_two_names_is_wholly_alike(late):
    """An offset is a calibration error without its gain; a gain is another; the described size's own freedom is no
    part of the model that it is compared in."""
    ready, plain = late
    final = with_effects(ready.problem, plain, {"offset|none.size": 0.2}, described("offset|none", False))
    entry = CATALOGUE["calibration_error"]
    ((offset),) = alike(ready.problem, final, "offset|none", [(entry, {"gain": 0.0, "offset": 0.1})])
    ((gain),) = alike(ready.problem, final, "offset|none", [(entry, {"gain": 0.01, "offset": 0.0})])
    assert offset.likeness == pytest.approx(1.0, abs=1e-3)
    assert gain.likeness < 0.95


def test_a_delay_outdoes_a_clock_that_runs_fast_and_no_delay(late):
    """A clock's drift moves the transfer by its share of the plateau before it, and is the only entry left that does;
    what it is beside its own entry nothing outdoes."""
    ready, plain = late
    clock = with_effects(ready.problem, plain, {"clock_drift.ppm": 45000.0}, CATALOGUE["clock_drift"])
    work = Work()
    better = outdone(ready.problem, clock, "clock_drift", work)
    assert better is not None and better.effect.id == "delay|none" and 0 < work.fits < 60
    size, uncertainty = better.fit.values()["delay|none"]["size"]
    assert abs(size - 0.5) < 4 * uncertainty < 0.1
    own = with_effects(ready.problem, plain, {"dead_time.delay_s": 0.45}, CATALOGUE["dead_time"])
    assert own.deviance < clock.deviance
    assert outdone(ready.problem, own, "dead_time", Work()) is None


def test_a_cause_that_a_description_makes_idle_is_not_named_beside_it(late):
    """The clock was taken for what a delay does; with the delay there it is worth less than its penalty."""
    ready, plain = late
    delay, clock = described("delay|none", False), CATALOGUE["clock_drift"]
    near = with_effects(ready.problem, plain, {"clock_drift.ppm": 45000.0}, clock)
    both = with_effects(ready.problem, plain, {"delay|none.size": 0.5, "clock_drift.ppm": 10.0}, clock, delay)
    one = Described(delay, both.values()[delay.id], 1e3, 0.9, (), Judged((), 1))
    found = Discovery(both, near, (one,), True, 0.0)
    assert alone(ready.problem, plain, found)
    less = without_idle(ready.problem, plain, found)
    assert less.fit.structure.ids == (*plain.structure.ids, delay.id)
    assert less.effects[0].values == less.fit.values()[delay.id]
    needed = replace(found, fit=near, effects=())
    assert without_idle(ready.problem, plain, needed) is needed


def test_a_mean_that_the_noise_denies_is_none_whatever_the_response_says(tmp_path):
    """A ramp that nothing names leaves a plainly wrong model, which a mean would help by thousands; the noise is of
    single readings."""
    ready = ready_of(tmp_path, 8, [Hidden("finite_transfer", {"duration_s": 0.6}, T)])
    plain = plain_fit(ready.problem, ready.structure)
    delay = with_effects(ready.problem, plain, {"dead_time.delay_s": 0.3}, CATALOGUE["dead_time"])
    entry = CATALOGUE["moving_average"]
    averaged = delay.structure.adding(entry, Held(entry.id, "samples", 4.0))
    better = fit(ready.problem, averaged, Model(ready.problem.channel, averaged).start(delay.log_rates, delay.choice))
    assert better.deviance < delay.deviance - 1000.0
    assert likelier_average(ready, Search(plain, delay, (), {}), False) is None


def test_a_hum_is_told_by_its_period_and_its_amplitude(humming):
    ready, plain = humming
    adequacy = judge(ready.problem, plain, ready.noise)
    found = restless(ready.problem.channel, adequacy)
    (one,) = found
    assert (one.behaves_as, one.driver, one.phase_rad) == ("periodic", "none", None)
    assert abs(one.period_s.value - 1.0 / HUM_HZ) < 5 * one.period_s.standard_uncertainty < 0.02
    assert one.size.value == pytest.approx(AMPLITUDE_K, rel=0.15)
    assert "airflow" in one.does_not_depend_on
    assert nothing_else(adequacy, found) and not nothing_else(adequacy, ())
    assert entry_of(one, "temperature") is None  # it is no part of a response, and none of a flight
    (said,) = not_undone((), "temperature", (one,))
    assert "no part in a flight" in said and flies(one, "temperature").endswith("no part in a flight")
    assert sentence(one, "K").startswith("It behaves as a hum that goes on all along (size 0.0")


def test_a_line_that_no_condition_bears_out_is_no_hum(late):
    """Told that a line is there where none is, the plateaus answer that they have none."""
    ready, plain = late
    adequacy = judge(ready.problem, plain, ready.noise)
    told = replace(adequacy, checks=(*adequacy.checks, Check(LINE, 1.0, 1.0, 0.0)))
    assert restless(ready.problem.channel, told) == ()


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
