"""Effects that nobody listed: closed forms against closed forms, the null of the maximum against order statistics, a
spectrum with known relaxation times, hidden behaviours found again, and a description carried as data into a flight."""

import json
import pickle
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2
from small_worlds import record

import shockrig.analysis.discovery.discover as searching
from shockrig.analysis.characterization.extension import extension_of
from shockrig.analysis.diagnosis.adequacy import judge
from shockrig.analysis.diagnosis.prepare import prepare
from shockrig.analysis.diagnosis.refitting import plain_fit
from shockrig.analysis.discovery import race
from shockrig.analysis.discovery.conditions import Condition, Judged, held_out, judged_by_condition
from shockrig.analysis.discovery.discover import discover
from shockrig.analysis.discovery.grammar import forms
from shockrig.analysis.discovery.remaining import spectrum
from shockrig.analysis.discovery.scores import null_of_the_maximum
from shockrig.analysis.discovery.stating import nearest_of, stated
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.behaviours import Form, form_of
from shockrig.analysis.effects.described import described, discovered_of, entry_of, stated_values
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.profile_effects import unseen
from shockrig.analysis.inference.gather import build_channel
from shockrig.analysis.inference.model import Model, Point, Structure
from shockrig.analysis.inference.work import Work
from shockrig.files.flight import Flight
from shockrig.files.profile import Profile, TemperatureProfile, Uncertain, profile_document, profile_from_document
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import ROUGH, Hidden

T = ("temperature",)


@pytest.fixture(scope="module")
def warm_rates(tmp_path_factory):
    """A bead whose rate moves with the ambient, which no catalogue has; searched, and what was described."""
    folder = tmp_path_factory.mktemp("world") / "campaign"
    hidden = [Hidden("unknown_rate_with_temperature", {"per_kelvin": 0.008}, T)]
    channel = build_channel(record(folder, 3, hidden, ROUGH, standard_plan()), "temperature")
    ready = prepare(channel)
    near = plain_fit(ready.problem, ready.structure)
    found = discover(ready.problem, near, lambda fit: judge(ready.problem, fit, ready.noise))
    return ready, near, found


def test_the_null_of_the_maximum_is_that_of_order_statistics():
    """Of C independent scores the largest square has the distribution of a chi-square to the power C."""
    for count in (1, 30):
        exact = chi2.ppf(0.95 ** (1.0 / count), 1)
        assert null_of_the_maximum(np.eye(count), 0.05) == pytest.approx(exact, rel=0.12)
    together = np.ones((30, 30)) + 1e-9 * np.eye(30)  # thirty times the same look is one look
    assert null_of_the_maximum(together, 0.05) == pytest.approx(chi2.ppf(0.95, 1), rel=0.12)


def test_a_spectrum_finds_the_relaxation_times_that_are_there():
    """A rise with 0.5 s and a fall with 20 s: 3 and -2 % of the step."""
    time = np.geomspace(0.1, 150.0, 20)
    shares = np.tile(0.03 * np.exp(-time / 0.5) - 0.02 * np.exp(-time / 20.0), (6, 1))
    shares += np.random.default_rng(1).normal(0.0, 2e-4, shares.shape)
    taus, amplitude, uncertainty = spectrum(time, shares, np.ones(shares.shape))
    rise, fall = taus[np.argmax(amplitude)], taus[np.argmin(amplitude)]
    assert 0.3 < rise < 0.9 and 12.0 < fall < 33.0
    assert uncertainty.max() < 0.2 * np.abs(amplitude).max()


def test_forms_do_what_their_closed_forms_say(warm_rates):
    """Each on a plain sphere: an offset by the airflow, a creep, a swing, a lag that moves a response by its own mean
    lag; equations written anew here."""
    channel = warm_rates[0].problem.channel
    c, rate = channel.conditions, np.array([np.log(0.3)])

    def reading(form=None, **values):
        structure = Structure() if form is None else Structure((described(form.key, False),))
        named = {} if form is None else {f"{form.key}.{k}": v for k, v in values.items()}
        model = Model(channel, structure)
        return model.predict(Point(model.start(rate, named), channel.at_rest()))[0]

    plain, time = reading(), channel.time_s
    offset = Form("offset", "none", (("airflow", "power"),))
    expected = plain + 0.2 * (c.airflow_m_s[:, None] / 5.0) ** -0.4
    np.testing.assert_allclose(reading(offset, size=0.2, airflow=-0.4), expected, atol=1e-12)
    creep = Form("added_response", "air_temperature", (("history", "logarithmic"),))
    step = (c.destination_c - c.source_c)[:, None]
    expected = plain + 0.01 * step * np.log1p(np.maximum(time, 0.0) / 2.0)
    np.testing.assert_allclose(reading(creep, size=0.01, time_constant_s=2.0), expected, atol=1e-12)
    swing = Form("periodic", "none")
    expected = plain + 0.3 * np.where(time > 0, np.sin(2 * np.pi * time / 7.0 + 0.4), 0.0)
    np.testing.assert_allclose(reading(swing, size=0.3, period_s=7.0, phase_rad=0.4), expected, atol=1e-12)
    share = reading(Form("parallel_lag", "air_temperature"), size=0.05, time_constant_s=9.0)
    lagged = c.source_c[:, None] + step * np.where(time > 0, -np.expm1(-np.maximum(time, 0.0) / 9.0), 0.0)
    np.testing.assert_allclose(share, 0.95 * plain + 0.05 * lagged, atol=1e-9)


def test_every_form_of_the_grammar_is_data(warm_rates, tmp_path):
    """Its key makes it again, it is pickled, it goes through a file's words and back, and it changes the reading."""
    channel = warm_rates[0].problem.channel
    model = Model(channel, Structure())
    base = model.predict(Point(model.start(np.array([0.0])), channel.at_rest()))[0]
    every = list(forms(channel))
    assert len({form.key for form in every}) == len(every) > 60
    for form in every:
        assert form_of(form.key) == form
        effect = described(form.key, False)
        assert pickle.loads(pickle.dumps(effect)) is effect
        values = {p.name: (p.starts[0], 0.1) for p in effect.parameters}
        one = discovered_of(effect, values)
        assert entry_of(one, "temperature") is effect
        assert {name: v.value for name, v in stated_values(one).items()} == {k: v for k, (v, _) in values.items()}
        own = Model(channel, Structure((effect,)))
        changed = own.predict(Point(own.start(np.array([0.0])), channel.at_rest()))[0]
        assert np.isfinite(changed).all() and np.abs(changed - base).max() > 1e-9, form


def test_a_rate_that_moves_with_the_ambient_is_described(warm_rates):
    ready, near, found = warm_rates
    assert found is not None and found.passed and len(found.effects) == 1
    (one,) = stated(ready.problem, found, nearest_of(ready.problem, found))
    assert (one.behaves_as, [on.factor for on in one.depends_on]) == ("rate_change", ["ambient"])
    on = one.depends_on[0]
    assert abs(on.value - 0.008) < 4 * on.standard_uncertainty < 0.004
    assert {"airflow", "direction"} <= set(one.does_not_depend_on)
    assert one.nearest_catalogued.effect in CATALOGUE and one.nearest_catalogued.likeness <= 1.0
    assert one.seen_over["airflow_m_s"] == (2.5, 12.0)
    judged = found.effects[0].judged
    assert judged.holds and all(c.saved > -6.0 for c in judged.conditions)


@pytest.mark.parametrize(("after", "looks"), [(600.0, 1), (400.0, 2)])
def test_a_second_form_is_looked_for_only_where_the_first_took_most_of_it(warm_rates, monkeypatch, after, looks):
    """What leaves nearly all that was there is no half of an answer; the forms are not gone through once more."""
    ready, near, whole = warm_rates
    seen, told = [], iter([1000.0])
    best = race.Candidate(whole.effects[0].effect, whole.fit)

    def candidates(problem, current, work, known=()):
        seen.append(current.structure.ids)
        return ([best], 20.0) if len(seen) == 1 else ([], 20.0)

    def left(found):
        return SimpleNamespace(passed=False, inflation=1.0, excess=next(told, after))

    monkeypatch.setattr(searching, "candidates", candidates)
    discover(ready.problem, near, left)
    assert len(seen) == looks


@pytest.mark.parametrize("limit", [1, 12])
def test_a_search_for_a_description_has_an_end(warm_rates, monkeypatch, limit):
    """What it has reached by its limit is judged, and never called certain, since not all others were tried."""
    ready, near, whole = warm_rates
    made: list[int] = []
    for counted in (race.fit, race.go_on):
        again = partial(lambda own, *a: made.append(1) or own(*a), counted)
        monkeypatch.setattr(race, counted.__name__, again)
    work = Work(limit)
    found = discover(ready.problem, near, lambda fit: judge(ready.problem, fit, ready.noise), work)
    assert work.ended and len(made) == work.fits
    # Of what was begun the leader is fitted to its end, without its factor and, at first, from up to three starts.
    assert work.fits <= limit + 8
    assert found is None or all(one.probability <= 0.5 for one in found.effects)
    assert any(one.probability > 0.5 for one in whole.effects)


def test_a_described_effect_is_extended_with_and_flown_within_what_was_seen(warm_rates):
    """As data through profile.json: the bead is corrected as it is at the flight's temperature, and outside of the
    conditions seen it is flagged and left."""
    ready, _, found = warm_rates
    (one,) = stated(ready.problem, found, nearest_of(ready.problem, found))
    extension = extension_of([], [one], "temperature")
    assert [e.id for e in extension.structure.effects] == [found.effects[0].effect.id]
    part = TemperatureProfile(Uncertain(9e-8, 1e-10), 1.6e-3, noise_k=0.01, discovered=(one,))
    document = json.loads(json.dumps(profile_document(Profile(part, None))))
    profile = profile_from_document(document)
    assert profile.temperature.discovered[0].depends_on[0].factor == "ambient"
    # A slow ramp is followed late by R^2 / (6 alpha) at a sphere's core, with alpha at the flight's temperature.
    time = np.arange(0.0, 60.0, 0.1)
    air = 25.0 + 0.2 * time
    late = 1.6e-3**2 / 6.0 / (9e-8 * np.exp(one.depends_on[0].value * (air - 20.0)))
    reading = air - 0.2 * late + np.random.default_rng(0).normal(0.0, 0.005, time.size)
    flight = Flight(*(np.full(time.size, np.nan) for _ in Flight.__dataclass_fields__))
    flight = replace(flight, time_s=time, temperature_c=reading, airspeed_m_s=np.full(time.size, 6.0))
    error = {
        name: np.sqrt(np.mean((correct(flight, p).temperature_c - air)[(time > 10) & (time < 55)] ** 2))
        for name, p in (("with", profile), ("without", Profile(replace(part, discovered=()), None)))
    }
    assert error["with"] < 0.3 * error["without"]
    beyond = correct(replace(flight, airspeed_m_s=np.full(time.size, 20.0)), profile)
    assert beyond.flags["outside_profile"].all()
    np.testing.assert_allclose(beyond.temperature_c, reading)
    inside = unseen([one], np.array([2.4, 12.5, 14.0, 1.0]), np.full(4, 20.0))
    assert inside.tolist() == [False, False, True, True]


def test_conditions_are_held_out_whole(warm_rates):
    channel = warm_rates[0].problem.channel
    named = dict(held_out(channel, set()))
    assert {"steps upwards", "steps downwards"} <= set(named) and any(name.startswith("ambient") for name in named)
    for runs in (runs for name, runs in named.items() if name.startswith("ambient")):
        assert np.ptp(channel.conditions.destination_c[runs]) < 2.0
    assert "steps upwards" not in dict(held_out(channel, {"direction"}))


def test_a_description_that_harms_a_condition_does_not_hold():
    good = [Condition(f"{i}", 100.0, 400.0, 300.0, 300) for i in range(4)]
    assert Judged(tuple(good), 2).holds
    assert not Judged((*good, Condition("bad", -40.0, 300.0, 340.0, 300)), 2).holds
    assert not Judged((good[0],), 2).holds  # one condition is none to judge by
    chance = [Condition(f"{i}", 0.5, 300.5, 300.0, 300) for i in range(4)]
    assert not Judged(tuple(chance), 2).holds


def test_what_is_wrong_with_the_rates_leaves_no_squares_and_is_told_by_the_deviance():
    """The runs' own rates take it up: 30 of deviance on one number, at 300 squares of 300 bins."""
    told = [Condition(f"{i}", 10.0, 300.0, 300.0, 300) for i in range(3)]
    assert Judged(tuple(told), 1).p == pytest.approx(chi2.sf(30.0, 1), rel=0.5)
    assert Judged(tuple(told), 1).holds


def test_a_condition_without_which_a_factor_does_not_vary_is_not_held_out(warm_rates):
    """Airflows differ at 20 degC alone."""
    ready, near, found = warm_rates
    named = {c.name for c in judged_by_condition(ready.problem, near, found.fit, {"airflow"}).conditions}
    assert "ambient 20 degC" not in named and "ambient 30 degC" in named
    free = {c.name for c in judged_by_condition(ready.problem, near, found.fit, set()).conditions}
    assert "ambient 20 degC" in free


@pytest.mark.usefixtures("catalogue_as_it_was")
def test_rates_that_scatter_hide_what_explains_them_from_the_scores(tmp_path, monkeypatch):
    """A film that dries by a tenth more slowly than it wets: where rates may scatter by 3 % its score is chance."""
    hidden = [Hidden("direction_dependent_diffusivity", {"ratio_drying_to_wetting": 0.88}, ("humidity",))]
    channel = build_channel(record(tmp_path / "campaign", 2, hidden, ROUGH, standard_plan()), "humidity")
    monkeypatch.delitem(CATALOGUE, "direction_dependent_diffusivity")
    ready = prepare(channel)
    near = plain_fit(ready.problem, ready.structure)
    found = discover(ready.problem, near, lambda fit: judge(ready.problem, fit, ready.noise))
    (one,) = found.effects
    assert form_of(one.effect.id) == Form("rate_change", "none", (("direction", "ratio"),))
    value, uncertainty = one.values["direction"]
    assert abs(value - 0.88) < 3.5 * uncertainty < 0.07


def test_where_there_is_nothing_no_form_passes(tmp_path):
    channel = build_channel(record(tmp_path / "campaign", 4, (), ROUGH, standard_plan()), "temperature")
    ready = prepare(channel)
    near = plain_fit(ready.problem, ready.structure)

    class Suspicious:
        passed, excess, inflation = False, 0.0, 1.0

    assert discover(ready.problem, near, lambda fit: Suspicious()) is None
