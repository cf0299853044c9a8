"""The contract of the catalogue, on every entry: nothing at no strength, smooth, declared rightly, found where it is.

An entry that a table here does not cover fails.
"""

import itertools
import pickle
import string
from dataclasses import replace

import foreign_lab as foreign
import numpy as np
import pytest
from small_worlds import record, small_plan

from shockrig.analysis.diagnose.candidates import Candidate, log_prior
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.diagnose.extended_profile import extended_result
from shockrig.analysis.diagnose.race import Race
from shockrig.analysis.effects import CATALOGUE, structure_of
from shockrig.analysis.effects.described import described
from shockrig.analysis.estimate.effect import SingleReadings, unchanged
from shockrig.analysis.estimate.fit import fit, run_misfit
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import PLAIN, Model, Point, Structure
from shockrig.analysis.estimate.noise import COARSE_IN_NOISE, estimate_noise, whiteners
from shockrig.analysis.estimate.problem import make_problem
from shockrig.analysis.estimate.quantity import QUANTITIES, RunEffect
from shockrig.analysis.estimate.refitting import plain_fit
from shockrig.analysis.estimate.without_model import rounding_step
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.chain import MeasuredAir
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.effects import CATALOGUED, EXTRA, KINDS
from shockrig.rig.virtual.truth import Hidden

PAIRS = [(effect, channel) for effect, entry in CATALOGUE.items() for channel in entry.channels]
LINKS = ("air", "exchange", "body", "readout", "logger")


@pytest.fixture(scope="module")
def channels(tmp_path_factory):
    campaign = record(tmp_path_factory.mktemp("effects") / "c", 5)
    return {name: build_channel(campaign, name) for name in QUANTITIES}


def rates_of(channel):
    return np.full(channel.rates, np.log(0.2))


def plain(channel):
    return Model(channel).predict(Point(rates_of(channel), channel.at_rest()))


def under(channel, effect, values):
    """Readings with an effect at given values, whatever its range."""
    structure = structure_of([effect], [(effect, name, value) for name, value in values.items()])
    return Model(channel, structure).predict(Point(rates_of(channel), channel.at_rest()))


def starts_of(entry):
    return {p.name: p.starts[0] for p in entry.parameters}


# What has no strength that could be nought, and where it ends: values, the runs on which it does, and what is allowed.
def everywhere(channel):
    return np.ones(channel.runs, dtype=bool)


# What acts on another effect alone, and that effect.
BESIDE = {"exchange_temperature": ("convective_film", {"biot_at_5_m_s": 0.12})}
TABULATED = {"concentration_dependent_diffusivity"}  # the film's warped time
ENDS = {
    "slow_air_in_cooling": ({"time_constant_s": 1e-5}, everywhere, 1e-3),
    "slow_air_in_warming": ({"time_constant_s": 1e-5}, everywhere, 1e-3),
    "convective_film": ({"biot_at_5_m_s": 1e6}, everywhere, 1e-4),
    "vapour_boundary_layer": ({"biot_at_5_m_s": 1e7}, everywhere, 1e-4),
    "series_lag": ({"time_constant_s": 1e-5}, everywhere, 1e-3),
    "sheath": ({"time_constant_s": 1e-5, "capacity": 1.0}, everywhere, 1e-3),
    "condensation": ({"drying_time_s": 5.0}, lambda channel: ~np.isfinite(channel.wet_until_s), 1e-9),
    "exchange_temperature": ({}, everywhere, 1e-9),  # without an air film
    # The die's temperature is measured: 0.05 K are 0.3 % of a humidity.
    "die_thermal_lag": ({}, lambda channel: channel.isothermal, 0.5),
    "uptake_by_activity": ({}, lambda channel: channel.isothermal, 0.5),
    "saturation_clipping": ({"limit_percent": 1e3}, everywhere, 1e-9),
}


@pytest.mark.parametrize(("effect", "name"), PAIRS)
def test_an_effect_of_no_strength_is_the_plain_chain(channels, effect, name):
    entry, channel = CATALOGUE[effect], channels[name]
    if effect in {f"body_{shape}" for shape in BODIES}:
        channel = replace(channel, body=effect.removeprefix("body_"))  # the body that it is already
        assert under(channel, effect, {}) == pytest.approx(plain(channel), abs=1e-9)
        return
    if any(p.none is not None for p in entry.parameters):
        values = {p.name: p.starts[0] if p.none is None else p.none for p in entry.parameters}
        runs, allowed = everywhere, 2e-3 if effect in TABULATED else 1e-4
    else:
        values, runs, allowed = ENDS[effect]
    used = runs(channel)
    assert used.any()
    assert under(channel, effect, values)[:, used] == pytest.approx(plain(channel)[:, used], abs=allowed)


@pytest.mark.parametrize(("effect", "name"), PAIRS)
def test_at_its_first_start_it_changes_the_readings(channels, effect, name):
    """Or, for what leaves the mean response alone, nothing at all."""
    entry, channel = CATALOGUE[effect], channels[name]
    if effect == "other_medium":
        channel = with_conditions(channel, elsewhere=two)
    values = entry.starts(channel)[0]
    if effect == "calibration_error":  # begins from nothing
        values = {"gain": 0.01, "offset": 0.1}
    if entry.candidacy.excludes:
        channel = replace(channel, body=next(shape for shape in BODIES if f"body_{shape}" != effect))
    if effect in BESIDE:
        other, strength = BESIDE[effect]
        structure = structure_of([other, effect], [(other, name, value) for name, value in strength.items()])
        both = Model(channel, structure).predict(Point(rates_of(channel), channel.at_rest()))
        moved = np.abs(both - under(channel, other, strength)).max()
    else:
        moved = np.abs(under(channel, effect, values) - plain(channel)).max()
    if entry.apply is unchanged:
        assert not entry.fitted and moved == 0.0
    else:
        assert moved > 5e-3


@pytest.mark.parametrize(("effect", "name"), PAIRS)
def test_readings_move_smoothly_with_every_parameter(channels, effect, name):
    """Central differences of two widths agree: no kinks or jumps that would mislead a Gauss-Newton step."""
    entry, channel = CATALOGUE[effect], channels[name]
    model = Model(channel, structure_of([effect]))
    theta = model.start(rates_of(channel))
    if entry.readout.averages:  # a whole number, taken from the noise: what lies between two numbers is one of them
        lower, higher = (under(channel, effect, {p.name: v for p in entry.parameters}) for v in (4.6, 5.4))
        assert np.array_equal(lower, higher)
        return
    low, high = model.bounds()
    # Where a delay or a ramp moves the air's step across a sample, the reading has its one true corner.
    corners = [0.0, *(p.starts[0] for p in entry.parameters if p.name in ("delay_s", "duration_s"))]
    away = np.all([np.abs(channel.time_s - corner) > 0.02 for corner in corners], axis=0)
    for k in range(channel.rates - 1, theta.size):
        wide = 2e-3 if k < channel.rates else 2e-3 * min(high[k] - low[k], 1.0)
        slopes = []
        for h in (wide, wide / 2):
            pair = np.tile(theta, (2, 1))
            pair[0, k], pair[1, k] = theta[k] + h, theta[k] - h
            up, down = model.predict(Point(pair, channel.at_rest()))
            slopes.append(((up - down) / (2 * h))[away])
        size = np.sqrt(np.mean(slopes[1] ** 2)) + 1e-9
        assert np.sqrt(np.mean((slopes[0] - slopes[1]) ** 2)) < 0.03 * size + 1e-3, (effect, k)


@pytest.mark.parametrize("effect", CATALOGUE)
def test_what_is_declared_of_parameters_holds_together(effect):
    for p in CATALOGUE[effect].parameters:
        assert p.unit and p.low < p.high and p.starts
        assert all(p.low <= start <= p.high for start in p.starts), p.name
        assert len(set(p.starts)) == len(p.starts)
        assert not p.log or p.low > 0
        assert p.weakest is None or p.low <= p.weakest <= p.high
        assert p.none is None or (p.none <= p.low if p.low >= 0 and p.none == 0 else p.low <= p.none <= p.high)
        assert p.prior is None or (p.low < p.prior[0] < p.high and 0 < p.prior[1] < p.high - p.low)
        assert not p.percent or p.unit == "1"
        assert np.exp(p.encoded(p.starts[0])) == pytest.approx(p.starts[0]) if p.log else True


@pytest.mark.parametrize(("effect", "name"), PAIRS)
def test_the_weakest_start_changes_least(channels, effect, name):
    """First-order scores are taken there."""
    entry, channel = CATALOGUE[effect], channels[name]
    for p in (p for p in entry.parameters if p.weakest is not None):
        sizes = {
            value: np.abs(under(channel, effect, starts_of(entry) | {p.name: value}) - plain(channel)).mean()
            for value in {*p.starts, p.weakest}
        }
        assert min(sizes, key=sizes.__getitem__) == p.weakest


@pytest.mark.parametrize(("effect", "name"), PAIRS)
def test_starts_are_values_of_all_parameters_within_their_ranges(channels, effect, name):
    entry = CATALOGUE[effect]
    starts = entry.starts(channels[name])
    assert starts
    for start in starts:
        assert list(start) == [p.name for p in entry.parameters]
        assert all(entry.parameter(k).low <= v <= entry.parameter(k).high for k, v in start.items())
    for offsets in entry.start.nudges(channels[name]) if entry.start.nudges else []:
        assert all(entry.parameter(parameter).high > offset for parameter, offset in offsets.items())


def with_conditions(channel, **changes):
    """A channel whose conditions are changed: functions of an array (R,)."""
    c = channel.conditions
    return replace(channel, conditions=replace(c, **{k: change(getattr(c, k)) for k, change in changes.items()}))


def never(known):
    return np.zeros_like(known)


def airs_unknown(channel):
    return with_conditions(channel, airs_known=never)


def airflow_unknown(channel):
    return with_conditions(channel, airflow_known=never)


def airflow_known(channel):
    return with_conditions(channel, airflow_known=lambda known: ~never(known))


def two(marks):
    return np.arange(marks.size) < 2


def start_unknown(channel):
    return with_conditions(channel, start_known=never)


def all_measured(channel):
    trace = MeasuredAir(np.array([0.0, 1.0]), np.array([20.0, 20.0]), np.array([50.0, 50.0]))
    return replace(channel, air=(trace,) * channel.runs)


def wetting_alone(channel):
    c = channel.conditions
    return channel.select(c.destination_percent > c.source_percent).select(np.array([0, 1]))


def warming_alone(channel):
    c = channel.conditions
    return channel.select(c.destination_c >= c.source_c)


def one_ambient(channel):
    return channel.select(np.abs(channel.conditions.destination_c - 20.0) < 1.0)


def one_airflow(channel):
    return channel.select(channel.conditions.airflow_m_s == np.median(channel.conditions.airflow_m_s))


def isothermal_alone(channel):
    """All as warm as the walls, or nearly."""
    return one_ambient(channel).select(one_ambient(channel).isothermal)


def stated_so(effect):
    return lambda channel: replace(channel, body=effect.removeprefix("body_"))


def of_another_lab(channel):
    return replace(channel, kind="somebody's")


# What takes away each thing that an effect needs.
WITHOUT = {
    "finite_transfer": (start_unknown, all_measured),
    "air_relaxation": (airs_unknown, all_measured),
    "direction_dependent_exchange": (airflow_known, warming_alone, all_measured),
    "slow_air_in_cooling": (airflow_known, warming_alone, all_measured),
    "slow_air_in_warming": (airflow_known, warming_alone, all_measured),
    "other_medium": (lambda channel: with_conditions(channel, elsewhere=never),),
    "convective_film": (airflow_unknown,),
    "exchange_temperature": (airflow_unknown, one_ambient),
    "vapour_boundary_layer": (airflow_unknown,),
    "sheath": (lambda channel: replace(channel, kind="hyt-271"), lambda channel: replace(channel, body="lumped")),
    "condensation": (lambda channel: replace(channel, wet_until_s=np.full(channel.runs, np.nan)),),
    "direction_dependent_diffusivity": (wetting_alone,),
    "concentration_dependent_diffusivity": (lambda channel: channel.select(np.array([0, 0])),),
    "slow_relaxation": (airflow_unknown,),
    "stem_conduction": (airflow_unknown,),
    "parallel_lag": (lambda channel: channel,),  # where the airflow is known, causes have names of their own
    "evaporative_cooling": (airs_unknown, lambda channel: channel.select(channel.conditions.source_c > 15.0)),
    "self_heating": (airs_unknown, airflow_unknown),
    "wall_radiation": (airs_unknown, airflow_unknown, one_airflow, isothermal_alone),
    "calibration_temperature": (airs_unknown, one_ambient),
    "radiative_heating": (lambda channel: with_conditions(channel, irradiance_w_m2=never),),
    "die_thermal_lag": (
        lambda channel: replace(channel, die_c=np.full(channel.die_c.shape, np.nan)),
        lambda channel: channel.select(channel.isothermal),
    ),
    "uptake_by_activity": (
        lambda channel: replace(channel, kind="hyt-271"),
        lambda channel: channel.select(channel.isothermal),
    ),
    "hysteresis": (airs_unknown,),
    "calibration_error": (airs_unknown,),
    "saturation_clipping": (airs_unknown,),
    "dead_time": (start_unknown,),
    "clock_drift": (start_unknown,),
} | {f"body_{shape}": (stated_so(f"body_{shape}"),) for shape in BODIES}
TWO_PLACES = {"direction_dependent_exchange", "slow_air_in_cooling", "slow_air_in_warming"}
ANYWHERE = {"series_lag", "moving_average", "stale_samples", "quantization"}


@pytest.mark.parametrize("effect", CATALOGUE)
def test_it_acts_where_it_can_and_says_what_it_needs_elsewhere(channels, effect):
    entry = CATALOGUE[effect]
    assert (entry.needs is None) == (effect in ANYWHERE) == (effect not in WITHOUT), f"{effect}: in WITHOUT or ANYWHERE"
    for name, channel in channels.items():
        if effect == "parallel_lag" or effect in TWO_PLACES:
            rich = airflow_unknown(channel)
        elif effect == "other_medium":
            rich = with_conditions(channel, elsewhere=two)
        elif effect in {"sheath", "uptake_by_activity"}:
            rich = of_another_lab(channel)
        elif entry.candidacy.excludes:
            rich = replace(channel, body=next(shape for shape in BODIES if f"body_{shape}" != effect))
        else:
            rich = channel
        assert entry.acts_in(rich) == (name in entry.channels)
        for take_away in WITHOUT.get(effect, ()):
            assert not entry.acts_in(take_away(channel if effect == "parallel_lag" else rich))
    assert entry.needs is None or entry.needs.words.startswith(("needs ", "is "))


@pytest.mark.parametrize("effect", CATALOGUE)
def test_its_words_are_whole(effect):
    entry = CATALOGUE[effect]
    names = {p.name for p in entry.parameters}
    places = {place for _, place, _, _ in string.Formatter().parse(entry.words.sentence) if place}
    assert places <= names
    assert "{" not in entry.words.sentence.format(**dict.fromkeys(names, "1"))
    for words in (entry.words.sentence, entry.words.advice):
        assert words.endswith(".") and words[0].isupper() or words.startswith("{")
    assert entry.equation and entry.source and entry.link in LINKS
    assert entry.channels and set(entry.channels) <= set(QUANTITIES)


@pytest.mark.parametrize("effect", CATALOGUE)
def test_it_is_pickled_by_name(effect):
    assert pickle.loads(pickle.dumps(CATALOGUE[effect])) is CATALOGUE[effect]
    structure = structure_of([effect])
    assert pickle.loads(pickle.dumps(structure)) == structure


def test_a_structure_stands_in_the_order_of_the_chain():
    catalogue = list(CATALOGUE)
    assert structure_of(np.random.default_rng(1).permutation(catalogue)).ids == tuple(catalogue)
    places = [LINKS.index(entry.link) for entry in CATALOGUE.values()]
    assert places == sorted(places)
    assert [entry.order for entry in CATALOGUE.values()] == list(range(len(catalogue)))


@pytest.mark.parametrize("effect", CATALOGUE)
def test_what_does_not_fly_is_of_the_air_or_the_logger(effect):
    entry = CATALOGUE[effect]
    assert entry.of_sensor or entry.link in ("air", "logger"), f"{effect}: of the sensor, and so has an InFlight"


@pytest.mark.parametrize("effect", CATALOGUE)
def test_what_excludes_another_is_excluded_by_it(effect):
    for other in CATALOGUE[effect].candidacy.excludes:
        assert effect in CATALOGUE[other].candidacy.excludes and other != effect


# Hidden in the virtual bench, which integrates each by its own equations: channel and parameters.
RECOVERED = {
    "finite_transfer": ("temperature", {"duration_s": 0.5}),
    "air_relaxation": (
        "temperature",
        {"fraction": 0.05, "time_constant_s": 6.0, "room_temperature_c": 24.0, "room_humidity_percent": 45.0},
    ),
    "convective_film": ("temperature", {"biot_at_5_m_s": 0.12}),
    "vapour_boundary_layer": ("humidity", {"biot_at_5_m_s": 6.0}),
    "condensation": ("humidity", {"drying_time_s": 6.0}),
    "direction_dependent_diffusivity": ("humidity", {"ratio_drying_to_wetting": 0.8}),
    "concentration_dependent_diffusivity": ("humidity", {"slope_per_unit_activity": 0.4}),
    "slow_relaxation": ("humidity", {"fraction": 0.08, "time_constant_s": 25.0}),
    "stem_conduction": ("temperature", {"fraction": 0.05, "time_constant_s": 9.0}),
    "evaporative_cooling": ("temperature", {"depression_k": 0.35, "time_constant_s": 20.0}),
    "self_heating": ("temperature", {"rise_k_at_5_m_s": 0.3}),
    "radiative_heating": ("temperature", {"kelvin_per_w_m2_at_5_m_s": 6e-4}),
    "wall_radiation": ("temperature", {"rise_k_at_10_k": 0.25, "wall_temperature_c": 24.0}),
    "calibration_temperature": ("humidity", {"percent_per_k": 0.05}),
    "series_lag": ("humidity", {"time_constant_s": 3.0}),
    "die_thermal_lag": ("humidity", {}),
    "hysteresis": ("humidity", {"rh_percent": 1.0}),
    "calibration_error": ("humidity", {"gain": 0.01, "offset": 0.8}),
    "saturation_clipping": ("humidity", {"limit_percent": 72.0}),
    "dead_time": ("humidity", {"delay_s": 0.3}),
    "clock_drift": ("temperature", {"ppm": 10000.0}),
    "moving_average": ("humidity", {"samples": 6.0}),
    "stale_samples": ("humidity", {"hold_samples": 4.0}),
    "quantization": ("temperature", {"step": 0.1}),
}
# What the air of a room is shows hardly in the bead.
UNSEEN = {"room_temperature_c", "room_humidity_percent"}
FOREIGN = {"sheath", "parallel_lag", "uptake_by_activity", "other_medium", *TWO_PLACES}
FOREIGN |= {f"body_{shape}" for shape in BODIES}


def test_every_entry_is_recovered_from_an_independent_bench():
    assert set(CATALOGUE) == set(RECOVERED) | FOREIGN | set(BESIDE), "each effect has a line in RECOVERED"
    assert set(RECOVERED) | set(BESIDE) == set(CATALOGUED) | set(EXTRA), "and one in KINDS of rig/virtual/effects.py"


@pytest.mark.parametrize("effect", RECOVERED)
def test_it_is_recovered_from_the_virtual_bench(tmp_path, effect):
    name, true = RECOVERED[effect]
    hidden = Hidden(effect, true, (name,) if KINDS[effect].single else ())
    channel = build_channel(record(tmp_path / "c", 11, [hidden], plan=small_plan()[::2]), name)
    entry = CATALOGUE[effect]
    if not entry.fitted:
        found, problem = shown(channel, entry, true)
    else:
        problem = make_problem(channel, whiteners(channel, estimate_noise(channel)))
        found = searched(problem, entry)
        recovered(found.values()[effect], true)
    assert run_misfit(problem, found).mean() < 1.25
    if entry.apply is not unchanged:
        assert found.deviance < plain_fit(problem).deviance - 50.0


def searched(problem, *effects):
    """The fit with the one of the effects that a search among them finds."""
    starts = {e.id: tuple(e.starts(problem.channel)) for e in effects}
    among = [Candidate(e, starts[e.id], log_prior(e, problem.channel, len(starts[e.id]))) for e in effects]
    race = Race(problem, PLAIN, among)
    found = race.grown(race.keep(race.rated(plain_fit(problem))), among).fit
    assert len(found.structure.ids) == 1
    return found


def recovered(values, true):
    assert set(values) == set(true)
    for parameter, (value, spread) in values.items():
        if parameter not in UNSEEN:
            assert abs(value - true[parameter]) < 3.5 * spread + 0.02 * abs(true[parameter]), parameter
            assert spread < 0.5 * abs(true[parameter]), parameter


def shown(channel, entry, true):
    """What the single readings show, and the fit that has it in."""
    known = SingleReadings(channel, rounding_step(channel))
    if entry.readout.in_readings:
        known, finding = entry.readout.in_readings(known)
    noise = estimate_noise(known.channel, known.step)
    if entry.readout.in_noise:
        finding = entry.readout.in_noise(replace(known, noise=noise))
    assert finding is not None and finding.effect == entry.id and finding.evidence
    recovered(finding.parameters, true)
    coarse = known.step > COARSE_IN_NOISE * noise.standard_deviation
    if coarse:
        noise = estimate_noise(known.channel, known.step, coarse=True)
    rounding = known.step if coarse else 0.0
    problem = make_problem(known.channel, whiteners(known.channel, noise), rounding=rounding)
    structure = structure_of([entry.id], [(entry.id, k, v) for k, (v, _) in finding.parameters.items()])
    return fit(problem, structure, plain_fit(problem).theta), problem


def foreign_channel(folder, body, stated):
    """A thermometer of another lab: 20 K steps both ways, logged every 0.1 s with little noise."""
    plan = tuple(foreign.LabRun(*(ends[::turn]), 10.0 + 0.13 * i, 80.0) for i, (ends, turn) in enumerate(STEPS))
    logger = foreign.LabLogger(period_s=0.1, rounding=0.001, white=0.01)
    bench = foreign.Lab("temperature", body, foreign.Arrival(), logger, plan, foreign.Written(body=stated))
    truth = foreign.record(bench, 7, folder)
    return build_channel(read_campaign(folder), "temperature"), truth


STEPS = tuple(itertools.product(((20.0, 40.0), (15.0, 30.0)), (1, -1)))
SPHERE_63 = 0.17091  # alpha t63 / R^2 of a sphere's core (Carslaw and Jaeger 1959, 9.3)


@pytest.mark.parametrize("shape", BODIES)
def test_a_body_is_recovered_from_another_labs_bench(tmp_path, shape):
    """It leaves the noise alone where no other shape does, and its rate is the true one."""
    stated = "film" if shape == "sphere" else "sphere"
    channel, truth = foreign_channel(tmp_path / "c", foreign.make_body(shape, 5.0), stated)
    problem = make_problem(channel, whiteners(channel, estimate_noise(channel)))
    found = searched(problem, *(CATALOGUE[f"body_{other}"] for other in BODIES if other != stated))
    assert found.structure.ids == (f"body_{shape}",)
    assert run_misfit(problem, found).mean() < 1.25
    spread = np.sqrt(found.covariance[0, 0])
    assert abs(found.log_rates[0] - np.log(truth.rate_per_s)) < 3.5 * spread + 0.002
    assert plain_fit(problem).deviance > found.deviance + 100.0


@pytest.mark.parametrize(("effect", "true"), [("series_lag", 0.8), ("parallel_lag", 6.0)])
def test_a_lag_is_recovered_from_another_labs_bench(tmp_path, effect, true):
    """`true` is its time constant in units of the bare sphere's t63."""
    if effect == "series_lag":  # a sheath of so much capacity that the body does not load it
        body, expected = foreign.make_body("sphere", 5.0, sheath=(true, 500.0)), {}
    else:
        body, expected = foreign.make_body("sphere", 2.0, slow=(0.2, true)), {"fraction": 0.2}
    channel, truth = foreign_channel(tmp_path / "c", body, "sphere")
    problem = make_problem(channel, whiteners(channel, estimate_noise(channel)))
    found = searched(problem, CATALOGUE[effect])
    recovered(found.values()[effect], expected | {"time_constant_s": true * SPHERE_63 / truth.rate_per_s})
    assert run_misfit(problem, found).mean() < 1.25


@pytest.mark.parametrize(("shape", "time_constant", "capacity"), [("sphere", 0.6, 0.5), ("cylinder_mean", 0.3, 1.4)])
def test_a_sheath_that_the_body_loads_is_recovered_from_another_labs_bench(tmp_path, shape, time_constant, capacity):
    """With its time constant (in units of the bare body's t63), its capacity, and the body's own rate."""
    body = foreign.make_body(shape, 5.0, sheath=(time_constant, capacity))
    channel, truth = foreign_channel(tmp_path / "c", body, shape)
    problem = make_problem(channel, whiteners(channel, estimate_noise(channel)))
    found = searched(problem, CATALOGUE["sheath"], CATALOGUE["series_lag"])
    bare_63_s = BODIES[shape].landmarks[0] / truth.rate_per_s
    recovered(found.values()["sheath"], {"time_constant_s": time_constant * bare_63_s, "capacity": capacity})
    assert run_misfit(problem, found).mean() < 1.25
    assert abs(found.log_rates[0] - np.log(truth.rate_per_s)) < 3.5 * np.sqrt(found.covariance[0, 0])


@pytest.mark.parametrize(
    ("shape", "time_constant", "capacity"),
    [("sphere", 0.4, 1.2), pytest.param("film", 0.8, 0.8, marks=pytest.mark.trial)],
)
def test_a_diagnosis_names_a_sheath_and_nothing_beside_it(tmp_path, shape, time_constant, capacity):
    """A lag in series alone would need a slow transfer or an air film beside it, and leave t63 off."""
    body = foreign.make_body(shape, 5.0, sheath=(time_constant, capacity))
    channel, truth = foreign_channel(tmp_path / "c", body, shape)
    found = diagnose_channel(channel)
    assert [cause.effect for cause in found.causes] == ["sheath"]
    assert found.causes[0].parameters["capacity"].value == pytest.approx(capacity, rel=0.05)
    response = extended_result(found).rows[0].response
    assert abs(response.t63_s - 5.0) < 3.5 * response.standard_uncertainties_s[0] + 0.002


def test_vapour_that_comes_late_leaves_the_temperature_where_it_is(channels):
    """At one temperature it is a delay of the reading; where the air's temperature changes, the film still holds the
    old air's vapour and is read at the new air's saturation (Magnus over water, written anew here)."""
    channel, late_s = channels["humidity"], 0.4
    effect = described("delay|air_humidity", True)
    model = Model(channel, Structure((effect,)))
    theta = model.start(rates_of(channel), {f"{effect.id}.size": late_s})
    reading = model.predict(Point(theta, channel.at_rest()))[0]
    shifted = channel.at_rest()
    shifted[:, RunEffect.START] = late_s
    delayed = Model(channel).predict(Point(rates_of(channel), shifted))[0]
    same, c = channel.isothermal, channel.conditions
    assert 0 < same.sum() < channel.runs
    np.testing.assert_allclose(reading[same], delayed[same], rtol=0.005)

    def saturation(celsius):
        return 6.112 * np.exp(17.62 * celsius / (243.12 + celsius))

    for run in np.flatnonzero(~same):
        before = (channel.time_s[run] > 0) & (channel.time_s[run] < late_s)
        held = c.source_percent[run] * saturation(c.source_c[run]) / saturation(c.destination_c[run])
        assert before.any()
        np.testing.assert_allclose(reading[run, before], held, rtol=0.01)
