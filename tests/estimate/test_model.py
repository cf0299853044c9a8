"""A model's space: what stands where in theta, what is held, and predictions that do not hang on how they are asked."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import multivariate_normal, norm
from small_worlds import record

from shockrig.analysis.effects import CATALOGUE, structure_of
from shockrig.analysis.estimate.channel import between_ambients, group_ambients
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import LOG_RATE_BOUNDS, PLAIN, Held, Model, Point
from shockrig.analysis.estimate.problem import (
    RATE_SCATTER,
    OwnRates,
    likeliest,
    make_problem,
    posterior_scatter,
    restriction,
)
from shockrig.analysis.estimate.quantity import QUANTITIES, RunEffect
from shockrig.analysis.physics.humidity import ZERO_CELSIUS_K

EVERY = [(name, [e for e, entry in CATALOGUE.items() if name in entry.channels]) for name in QUANTITIES]


@pytest.fixture(scope="module")
def channels(tmp_path_factory):
    campaign = record(tmp_path_factory.mktemp("model") / "c", 6)
    return {name: build_channel(campaign, name) for name in QUANTITIES}


def some_point(model, seed, batch):
    """Candidates (B, P) within their bounds, near their starts, and random effects (B, R, U) of a bench's size."""
    rng = np.random.default_rng(seed)
    start = model.start(np.full(model.channel.rates, np.log(0.3)))
    low, high = model.bounds()
    theta = np.clip(start + 0.2 * rng.standard_normal((batch, model.size)), low, high)
    steps = np.array([0.01, 0.01, 0.02, 0.02, 0.02, 0.02, 0.02])[: model.channel.quantity.run_effects]
    return Point(theta, steps * rng.standard_normal((batch, model.channel.runs, steps.size)))


@pytest.mark.parametrize(("name", "effects"), EVERY)
def test_names_places_and_values_of_theta(channels, name, effects):
    model = Model(channels[name], structure_of(effects))
    rates, rng = channels[name].rates, np.random.default_rng(3)
    choice = {}
    for effect, parameter in model.structure.parameters:
        share = rng.uniform(0.2, 0.8)
        inside = parameter.low + share * (parameter.high - parameter.low)
        choice[f"{effect.id}.{parameter.name}"] = (
            parameter.low * (parameter.high / parameter.low) ** share if (parameter.log) else inside
        )
    log_rates = np.log(np.linspace(0.1, 0.5, rates))
    theta = model.start(log_rates, choice)
    assert theta.size == model.size == len(model.names) == rates + len(choice)
    assert model.names[:rates] == ("ln rate",) * rates and model.names[rates:] == tuple(choice)
    assert np.array_equal(theta[model.rates], log_rates)
    assert model.choice(theta) == pytest.approx(choice)
    for key, value in choice.items():
        effect, parameter = key.split(".")
        scale = CATALOGUE[effect].parameter(parameter)
        assert theta[model.place(key)] == pytest.approx(np.log(value) if scale.log else value)
    low, high = model.bounds()
    assert np.all(low < theta) and np.all(theta < high)
    assert (low[0], high[0]) == LOG_RATE_BOUNDS
    assert model.reach().shape == model.steps().shape == theta.shape
    assert np.all(model.steps() > 0) and np.all(model.steps() < 1e-3 * model.reach())


def test_uncertainties_come_back_in_the_parameters_own_units(channels):
    model = Model(channels["humidity"], structure_of(["slow_relaxation"]))
    theta = model.start(np.zeros(channels["humidity"].rates), {"slow_relaxation.time_constant_s": 20.0})
    covariance = np.zeros((model.size, model.size))
    for name, sigma in (("slow_relaxation.fraction", 0.01), ("slow_relaxation.time_constant_s", 0.1)):
        covariance[model.place(name), model.place(name)] = sigma**2
    found = model.values(theta, covariance)["slow_relaxation"]
    assert found["fraction"] == pytest.approx((0.05, 0.01))
    assert found["time_constant_s"] == pytest.approx((20.0, 2.0))  # a tenth of ln tau is a tenth of tau


def test_what_is_known_before_any_data_is_a_mean_and_a_weight(channels):
    model = Model(channels["temperature"], structure_of(["air_relaxation"]))
    mean, weight = model.priors()
    known = {p.name: p.prior for p in CATALOGUE["air_relaxation"].parameters}
    for name, prior in known.items():
        at = model.place(f"air_relaxation.{name}")
        expected = (0.0, 0.0) if prior is None else (prior[0], prior[1] ** -2)
        assert (mean[at], weight[at]) == pytest.approx(expected)
    assert weight[0] == 0.0 and any(prior for prior in known.values())


def test_structures_are_put_together_and_taken_apart():
    both = structure_of(["stem_conduction", "finite_transfer"], [("stem_conduction", "fraction", 0.1)])
    assert both.ids == ("finite_transfer", "stem_conduction")
    assert both.names == ("finite_transfer.duration_s", "stem_conduction.time_constant_s")
    assert both.held_values("stem_conduction") == {"fraction": 0.1} and both.held_values("finite_transfer") == {}
    assert both.dropping("stem_conduction") == structure_of(["finite_transfer"])
    assert both.of_sensor() == both.keeping({"stem_conduction"}) == both.dropping("finite_transfer")
    three = both.adding(CATALOGUE["convective_film"], Held("convective_film", "biot_at_5_m_s", 1.0))
    assert three.ids == ("finite_transfer", "convective_film", "stem_conduction")
    assert three.names == both.names and len(three.held) == 2
    assert PLAIN.adding(CATALOGUE["dead_time"]).dropping("dead_time") == PLAIN


@pytest.mark.parametrize(("name", "effects"), EVERY)
def test_a_held_parameter_does_what_a_free_one_of_its_value_does(channels, name, effects):
    for effect in effects:
        free = Model(channels[name], structure_of([effect]))
        theta = free.start(np.full(channels[name].rates, np.log(0.3)))
        parameters = CATALOGUE[effect].parameters
        held = Model(channels[name], structure_of([effect], [(effect, p.name, p.starts[0]) for p in parameters]))
        assert held.size == channels[name].rates
        rest = channels[name].at_rest()
        fixed = held.predict(Point(theta[held.rates], rest))
        assert fixed == pytest.approx(free.predict(Point(theta, rest)), abs=1e-9)
        values = held.values(theta[held.rates], np.zeros((held.size, held.size)))
        assert values == {effect: {p.name: (p.starts[0], 0.0) for p in parameters}}


@pytest.mark.parametrize(("name", "effects"), EVERY)
def test_a_batch_predicts_what_its_members_do_one_by_one(channels, name, effects):
    channel = channels[name]
    for effect in [None, *effects]:
        model = Model(channel, structure_of([effect] if effect else []))
        point = some_point(model, 1, 4)
        whole = model.predict(point)
        assert whole.shape == (4, *channel.time_s.shape)
        for b in range(4):
            (one,) = model.predict(Point(point.theta[b], point.deviations[b]))
            assert whole[b] == pytest.approx(one, abs=1e-7), effect
        shared = model.predict(Point(point.theta, point.deviations[0]))
        assert shared[0] == pytest.approx(whole[0], abs=1e-7)
        apart = model.predict(Point(point.theta[0], point.deviations))
        assert apart.shape == whole.shape and apart[0] == pytest.approx(whole[0], abs=1e-7)


@pytest.mark.parametrize(("name", "effects"), EVERY)
def test_members_that_differ_in_one_thing_each_are_predicted_as_they_are_alone(channels, name, effects):
    """What is the same for several is evaluated once: that is not to make anything the same that is not."""
    channel = channels[name]
    for effect in [None, *effects]:
        model = Model(channel, structure_of([effect] if effect else []))
        first, other = some_point(model, 1, 1), some_point(model, 2, 1)
        moved = [Point(first.theta[0], first.deviations[0])]
        for place in range(model.size):
            theta = first.theta[0].copy()
            theta[place] = other.theta[0, place]
            moved.append(Point(theta, first.deviations[0]))
        for place in range(first.deviations.shape[-1]):
            deviations = first.deviations[0].copy()
            deviations[:, place] = other.deviations[0, :, place]
            moved.append(Point(first.theta[0], deviations))
        whole = model.predict(
            Point(np.array([one.theta for one in moved]), np.array([one.deviations for one in moved]))
        )
        for together, one in zip(whole, moved, strict=True):
            assert together == pytest.approx(model.predict(one)[0], abs=1e-7), effect


@pytest.mark.parametrize(("name", "effects"), EVERY)
def test_runs_alone_are_predicted_as_among_others(channels, name, effects):
    channel, index = channels[name], np.array([14, 2, 18])
    for effect in effects:
        model = Model(channel, structure_of([effect]))
        point = some_point(model, 2, 2)
        few = model.on(channel.select(index)).predict(Point(point.theta, point.deviations[:, index]))
        assert few == pytest.approx(model.predict(point)[:, index], abs=1e-7), effect


@pytest.mark.parametrize("name", QUANTITIES)
def test_random_effects_are_what_their_names_say(channels, name):
    """A late start is a shift of time, a rate a factor, and airs are added to those that were recorded."""
    channel = channels[name]
    rates = np.full(channel.rates, np.log(0.3))

    def moved(effect, size):
        deviations = channel.at_rest()
        deviations[:, effect] = size
        return Model(channel).predict(Point(rates, deviations))

    def other(**changes):
        c = replace(channel.conditions, **{k: getattr(channel.conditions, k) + v for k, v in changes.items()})
        return Model(replace(channel, conditions=c)).predict(Point(rates, channel.at_rest()))

    late = Model(replace(channel, time_s=channel.time_s - 0.3)).predict(Point(rates, channel.at_rest()))
    assert moved(RunEffect.START, 0.3) == pytest.approx(late, abs=1e-9)
    faster = Model(channel).predict(Point(rates + 0.1, channel.at_rest()))
    assert moved(RunEffect.RATE, 0.1) == pytest.approx(faster, abs=1e-9)
    source, destination = channel.quantity.air_fields
    assert moved(RunEffect.SOURCE, 0.2) == pytest.approx(other(**{source: 0.2}), abs=1e-9)
    assert moved(RunEffect.DESTINATION, 0.2) == pytest.approx(other(**{destination: 0.2}), abs=1e-9)
    if name == "humidity":
        assert moved(RunEffect.DESTINATION_C, 0.2) == pytest.approx(other(destination_c=0.2), abs=1e-9)


def test_an_arrhenius_law_is_carried_between_ambients_exactly():
    """ln D = a + b / T at the ambients is a + b / T at every destination within an ambient's width."""
    destinations = np.array([0.2, -0.3, 10.0, 20.4, 19.9, 40.1, 39.8])
    ambient, means = group_ambients(destinations)
    weights = between_ambients(destinations, ambient, means)
    law = -20.0 - 2500.0 / (np.stack([means, means + 5.0]) + ZERO_CELSIUS_K)
    assert weights @ law[0] == pytest.approx(-20.0 - 2500.0 / (destinations + ZERO_CELSIUS_K), abs=1e-12)
    assert weights.sum(axis=1) == pytest.approx(np.ones(7))
    assert np.array_equal(between_ambients(np.array([7.0, 7.2]), np.zeros(2, dtype=int), np.array([7.1])), [[1], [1]])


def test_ambients_without_runs_are_left_out_and_the_rest_stay_what_they_were(channels):
    channel = channels["humidity"]
    keep = channel.ambient != 0
    fewer = channel.select(keep).without_lost_ambients()
    assert fewer.rates == channel.rates - 1 and fewer.ambients_c == pytest.approx(channel.ambients_c[1:])
    assert fewer.ambients_c[fewer.ambient] == pytest.approx(channel.ambients_c[channel.ambient[keep]])
    assert fewer.interpolation.sum(axis=1) == pytest.approx(np.ones(keep.sum()))


def test_a_problem_knows_how_runs_scatter(channels):
    channel = channels["humidity"]
    identity = np.tile(np.eye(channel.time_s.shape[1]), (channel.runs, 1, 1))
    problem = make_problem(channel, identity, rate_scatter=0.01, rounding=0.6)
    c = channel.conditions
    assert problem.rate_scatter == 0.01 and problem.with_rate_scatter(0.02).rate_scatter == 0.02
    assert problem.scatter[:, RunEffect.START] == pytest.approx(c.start_scatter_s)
    rounded = np.hypot(c.source_percent_scatter, 0.6 / np.sqrt(12.0))
    assert problem.scatter[:, RunEffect.SOURCE] == pytest.approx(rounded)
    both = np.hypot(c.source_c_scatter, c.destination_c_scatter)
    assert problem.scatter[:, RunEffect.DESTINATION_C] == pytest.approx(both)
    values = np.random.default_rng(0).standard_normal(channel.time_s.shape)
    assert problem.whiten(values) == pytest.approx(values)
    assert problem.whiten(np.stack([values, 2 * values], axis=-1))[..., 1] == pytest.approx(2 * values)


@pytest.mark.parametrize("true", [0.004, 0.012])
def test_the_scatter_of_many_runs_is_found(true):
    rng = np.random.default_rng(4)
    ambient = np.repeat(np.arange(5), 60)
    spread = np.full(300, 0.003)
    own = 0.1 * ambient + true * rng.standard_normal(300) + spread * rng.standard_normal(300)
    part = OwnRates(own, spread, ambient)
    assert likeliest(part) == pytest.approx(true, rel=0.12)
    assert posterior_scatter([part]) == pytest.approx(true, rel=0.12)


@pytest.mark.parametrize("scatter", [0.001, 0.004, 0.015])
def test_means_that_are_fitted_along_cost_as_much_as_contrasts_do_without_them(scatter):
    """Against the density of each ambient's contrasts, which know no mean (Patterson and Thompson 1971)."""
    rng = np.random.default_rng(5)
    part = OwnRates(0.01 * rng.standard_normal(9), rng.uniform(0.001, 0.01, 9), np.repeat([0, 1, 2], [2, 4, 3]))

    def both(scatter):
        contrasts = fitted = 0.0
        for g in range(3):
            own, variance = (x[part.ambient == g] for x in (part.own, scatter**2 + part.spread**2))
            basis = null_space(np.ones((1, own.size))).T
            contrasts -= 2 * multivariate_normal.logpdf(basis @ own, cov=basis @ np.diag(variance) @ basis.T)
            around = own - np.average(own, weights=1 / variance)
            fitted -= 2 * norm.logpdf(around, scale=np.sqrt(variance)).sum()
        return contrasts, fitted

    (contrasts, fitted), (contrasts_before, fitted_before) = both(scatter), both(RATE_SCATTER)
    lacking = contrasts - contrasts_before - (fitted - fitted_before)
    assert restriction(scatter, part) == pytest.approx(lacking, abs=1e-9)


def test_of_two_runs_that_say_little_the_scatter_stays_what_was_thought():
    part = OwnRates(np.array([0.0, 0.001]), np.array([0.5, 0.5]), np.zeros(2, dtype=int))
    assert likeliest(part) == pytest.approx(RATE_SCATTER, rel=0.15)
