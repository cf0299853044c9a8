"""Runs of which nobody recorded the start and the airs: their noise, how open they are, and the fit from afar."""

from dataclasses import replace

import numpy as np
import pytest

from shockrig.analysis.diagnose.cannot_tell import cannot_tell
from shockrig.analysis.diagnose.held_out import run_errors
from shockrig.analysis.diagnose.prepare import prepare, with_rounding
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.fit import AIRS, fit, objective_at, with_airs
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import PLAIN, Model, Point, Structure
from shockrig.analysis.estimate.noise import estimate_noise, whiteners
from shockrig.analysis.estimate.problem import Problem, make_problem
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.estimate.refitting import as_judged, plain_fit, refit
from shockrig.files.campaign import Campaign, Run, RunAir, Trace

NOISE_K = 0.02
FAST_S, SLOW_S, SHARE = 80.0, 340.0, 0.5
SLOWEST = (0.2, 1500.0)
UNKNOWN = RunAir(None, None)


def channel_of(curves, period_s=1.0, step_k=0.0, noise_k=NOISE_K, seed=1) -> Channel:
    """Logs of curves of time, (curve, seconds) each, of which nothing else was recorded."""
    rng, runs = np.random.default_rng(seed), []
    for k, (curve, lasts_s) in enumerate(curves):
        time = np.arange(0.0, lasts_s, period_s)
        value = curve(time) + noise_k * rng.standard_normal(time.size)
        value = step_k * np.rint(value / step_k) if step_k else value
        trace = Trace(time, {"temperature_c": value})
        runs.append(Run(str(k), UNKNOWN, UNKNOWN, None, 1000.0, None, None, trace, None))
    bodies = {"imet": "lumped", "hyt": "film"}
    found = build_channel(Campaign("open", None, {}, 4e-4, 1e-5, tuple(runs), bodies=bodies), "temperature")
    assert found is not None
    return found


def two_exponentials(source, destination, begun_s=0.0, slow=(SHARE, SLOW_S)):
    """Of both time constants, seen from `begun_s` after the step on; `slow` is that part's share and time constant."""
    share, slow_s = slow
    return lambda t: (
        destination
        + (source - destination)
        * (share * np.exp(-(t + begun_s) / slow_s) + (1.0 - share) * np.exp(-(t + begun_s) / FAST_S))
    )


def problem_of(channel: Channel) -> Problem:
    return make_problem(channel, whiteners(channel, estimate_noise(channel)))


@pytest.mark.parametrize("lasts_s", [250.0, 500.0, 1000.0])
def test_the_bend_of_a_response_that_has_not_settled_is_no_noise(lasts_s):
    channel = channel_of([(two_exponentials(40.0, 10.0), lasts_s), (two_exponentials(10.0, 40.0), lasts_s)] * 2)
    assert estimate_noise(channel).standard_deviation == pytest.approx(NOISE_K, rel=0.15)


def test_airs_nobody_recorded_are_where_no_other_leaves_less():
    problem = problem_of(channel_of([(two_exponentials(40.0, 10.0), 900.0), (two_exponentials(10.0, 40.0), 700.0)]))
    model = Model(problem.channel, PLAIN)
    theta = model.start(np.array([np.log(1.0 / 150.0)]))
    deviations, left = with_airs(problem, model, Point(theta, problem.channel.at_rest()[None]))
    least = objective_at(problem, model, Point(theta, deviations[0]))
    assert left.sum() == pytest.approx(least, rel=1e-9)
    for run in range(2):
        for air in AIRS:
            for off in (-0.01, 0.01):
                moved = deviations[0].copy()
                moved[run, air] += off
                assert objective_at(problem, model, Point(theta, moved)) > least


def test_airs_that_were_recorded_stay_where_they_are():
    channel = channel_of([(two_exponentials(40.0, 10.0), 900.0), (two_exponentials(10.0, 40.0), 700.0)])
    known = replace(channel.conditions, airs_known=np.array([True, False]))
    problem = problem_of(replace(channel, conditions=known))
    model = Model(problem.channel, PLAIN)
    at = problem.channel.at_rest()[None]
    deviations, _ = with_airs(problem, model, Point(model.start(np.array([-5.0])), at))
    assert (deviations[0, 0] == at[0, 0]).all() and (deviations[0, 1, list(AIRS)] != 0.0).all()


@pytest.mark.parametrize("slow_s", [200.0, 700.0])
@pytest.mark.parametrize("fraction", [0.3, 0.7])
@pytest.mark.parametrize("fast_s", [50.0, 150.0])
def test_a_fit_from_afar_ends_where_one_from_nearby_does(slow_s, fraction, fast_s):
    """Starts and airs open, and rates that differ: the valley is long, and bent where the airs go along."""
    curves = [(two_exponentials(40.0, 10.0), 1000.0), (two_exponentials(12.0, 38.0), 1000.0)]
    problem = problem_of(channel_of([*curves, (two_exponentials(35.0, 5.0, 20.0), 1000.0)])).with_rate_scatter(0.004)
    structure = Structure((CATALOGUE["parallel_lag"],))
    model = Model(problem.channel, structure)

    def ended(fast, share, slow):
        choice = {"parallel_lag.fraction": share, "parallel_lag.time_constant_s": slow}
        theta = model.start(np.array([-np.log(fast)]), choice)
        return fit(problem, structure, theta, iterations=60, adapt_scatter=False)

    near, far = ended(FAST_S, SHARE, SLOW_S), ended(fast_s, fraction, slow_s)
    assert near.choice["parallel_lag.time_constant_s"] == pytest.approx(SLOW_S, rel=0.2)
    assert far.objective < near.objective + 2.0


@pytest.mark.parametrize("time_constant_s", [30.0, 105.0, 300.0, 800.0])
@pytest.mark.parametrize("fraction", [0.015, 0.05, 0.3, 0.7])
def test_a_second_part_is_found_from_wherever_a_fit_begins(fraction, time_constant_s):
    """Before: steps that failed were shortened for the runs' own starts and airs and for what runs share each by a way
    of its own. That is no way down: seven tries failed, and a fit ended where the plain one had, as far off."""
    airs = [(40.0, 10.0, 10.0), (12.0, 38.0, 20.0)]
    curves = [(two_exponentials(*air, SLOWEST), 3000.0) for air in airs]
    problem, structure = problem_of(channel_of(curves, 20.0)), Structure((CATALOGUE["parallel_lag"],))
    plain, model = plain_fit(problem), Model(problem.channel, structure)
    choice = {"parallel_lag.fraction": fraction, "parallel_lag.time_constant_s": time_constant_s}
    found = fit(problem, structure, model.start(plain.log_rates, choice), plain.deviations, iterations=60)
    assert found.objective < 2.0 * problem.channel.count.size < 0.01 * plain.objective


@pytest.mark.parametrize(("period_s", "seed"), [(30.0, 1), (30.0, 2), (60.0, 1), (60.0, 2)])
def test_a_fit_ends_where_it_would_not_go_on_if_it_began_there(period_s, seed):
    """Of runs whose rates differ by much: before, one of these gained up to nine tenths of what it had left."""
    factors = np.exp(0.6 * np.random.default_rng(seed).standard_normal(4))
    airs = [(40.0, 10.0, 20.0), (12.0, 38.0, 60.0), (35.0, 5.0, 100.0), (5.0, 30.0, 5.0)]

    def at_rate(factor, source, destination, begun_s):
        response = two_exponentials(source, destination)
        return lambda t: response(factor * (t + begun_s))

    curves = [(at_rate(factor, *air), 2000.0) for factor, air in zip(factors, airs, strict=True)]
    problem = problem_of(channel_of(curves, period_s, seed=seed))
    plain = fit(problem, PLAIN, Model(problem.channel, PLAIN).start(np.array([-np.log(150.0)])))
    structure = Structure((CATALOGUE["parallel_lag"],))
    choice = {"parallel_lag.fraction": 0.3, "parallel_lag.time_constant_s": 800.0}
    start = Model(problem.channel, structure).start(plain.log_rates, choice)
    found = fit(problem, structure, start, plain.deviations)
    again = fit(found.on_its_scatters(problem), structure, found.theta, found.deviations)
    assert again.deviance == pytest.approx(found.deviance, rel=1e-3)


@pytest.mark.parametrize("begun_s", [5.0, 20.0, 300.0])
def test_a_run_that_shows_more_of_its_beginning_is_predicted_by_others_that_begin_late(begun_s):
    """Before: the others' starts were taken to be about the begin of their records, and all of the fast part to have
    passed before: no start was left for a run that shows more of it."""
    ends = [(40.0, 10.0), (12.0, 38.0), (35.0, 5.0)]
    late = [(two_exponentials(*air, after_s), 1000.0) for air, after_s in zip(ends, (60.0, 100.0, 150.0), strict=True)]
    learnt, fresh = problem_of(channel_of(late)), channel_of([(two_exponentials(10.0, 42.0, begun_s), 1000.0)], seed=2)
    structure = Structure((CATALOGUE["parallel_lag"],))
    begin = Model(learnt.channel, structure).start(
        np.array([-np.log(60.0)]), {"parallel_lag.fraction": 0.5, "parallel_lag.time_constant_s": 500.0}
    )
    judged = as_judged(learnt, fit(learnt, structure, begin, iterations=60))
    (square,) = run_errors(fresh, problem_of(fresh), judged)
    assert np.sqrt(square) < 1.5 * NOISE_K


@pytest.mark.parametrize("begun_s", [0.2, 0.9, 2.0])
def test_a_fast_part_that_only_the_first_readings_show_is_placed_there(begun_s):
    """Before: starts were tried on an even grid over half of a response, which met no valley as narrow as this one."""

    def jump_and_creep(step, after_s):
        return lambda t: (
            step * (0.06 * -np.expm1(-(t + after_s) / 0.4) + 0.94 * -np.expm1(-np.maximum(t + after_s, 0.0) / 70.0))
        )

    learnt, fresh = (
        problem_of(channel_of([(jump_and_creep(x, begun_s), 60.0) for x in steps], 0.5, seed=seed))
        for seed, steps in enumerate([(60.0, 45.0, 50.0), (40.0, 55.0)])
    )
    structure = Structure((CATALOGUE["parallel_lag"],))
    begin = Model(learnt.channel, structure).start(
        np.array([-np.log(60.0)]), {"parallel_lag.fraction": 0.05, "parallel_lag.time_constant_s": 1.0}
    )
    judged = as_judged(learnt, refit(learnt, structure, fit(learnt, structure, begin)))
    assert np.sqrt(run_errors(fresh.channel, fresh, judged)).max() < 1.5 * NOISE_K


def test_records_that_begin_within_their_response_are_said_to():
    ends = [(40.0, 10.0), (12.0, 38.0), (35.0, 5.0)]
    begins = [(lambda t, air=air: two_exponentials(*air)(np.maximum(t - 300.0, 0.0)), 1300.0) for air in ends[:2]]
    late = (two_exponentials(*ends[2], 100.0), 1000.0)

    def said(*curves):
        return " ".join(cannot_tell(channel_of(curves)))

    assert "begins within it" not in said(*begins)
    assert "In 1 of 3 runs no readings at rest come before the response" in said(*begins, late)
    assert "In 1 of 1 run no readings at rest come before the response" in said(late)


def test_an_air_is_as_open_as_the_time_at_which_its_run_began():
    """A record that begins with the response, or a little before, does not show what was before it."""
    late, early = (
        channel_of([(lambda t, s=s: two_exponentials(40.0, 10.0)(np.maximum(t - s, 0.0)), 1000.0 + s)] * 2)
        for s in (400.0, 3.0)
    )
    moves = abs(float(np.diff(two_exponentials(40.0, 10.0)(np.array([0.0, early.conditions.start_scatter_s[0]])))[0]))
    assert early.conditions.source_c_scatter[0] == pytest.approx(moves, rel=0.15)
    assert late.conditions.source_c_scatter[0] == pytest.approx(late.quantity.unknown_air_scatter)


@pytest.mark.parametrize("tau_s", [300.0, 1000.0, 4000.0])
def test_a_reading_may_have_to_go_as_far_as_it_has(tau_s):
    channel = channel_of([(lambda t: 20.0 + 60.0 * np.exp(-t / tau_s), 2000.0)] * 2, period_s=20.0)
    to_go = 60.0 * np.exp(-2000.0 / tau_s)
    problem = problem_of(channel)
    assert 0.7 * to_go < problem.scatter[0, RunEffect.DESTINATION] < 3.0 * to_go + 4.0


def test_codes_are_known_only_to_whoever_knows_the_signal():
    """Readings of a coarse step under a model that is nothing like them keep independent errors of that step."""

    def right(t):
        return 10.0 + 30.0 * np.exp(-t / 100.0)

    step_k = 0.2
    white_of = {}
    for name, curve in (("right", right), ("wrong", two_exponentials(40.0, 10.0))):
        curves = [(curve, 1500.0), (lambda t, c=curve: 50.0 - c(t), 1500.0)]
        ready = prepare(channel_of(curves, step_k=step_k, noise_k=0.0))
        assert ready.rounds_coarsely
        white_of[name] = with_rounding(ready, plain_fit(ready.problem)).problem is ready.problem
    assert white_of == {"right": False, "wrong": True}


def test_a_change_behind_the_first_reading_of_all_records_is_found_there():
    """Two exponentials that began earlier are two with other shares: only the first reading, which is still of the air
    before, says when they did. All starts, and the shares, have to be found behind it together."""
    late_s = (0.5, 3.0, 2.5, 1.5)
    airs = ((40.0, 10.0), (10.0, 40.0)) * 2

    def changed(late_s, before, after):
        response = two_exponentials(before, after, slow=(0.2, SLOW_S))
        return lambda t: np.where(t < late_s, before, response(t - late_s))

    curves = [(changed(s, *air), 1000.0) for s, air in zip(late_s, airs, strict=True)]
    problem = problem_of(channel_of(curves, 5.0))
    structure, earlier = Structure((CATALOGUE["parallel_lag"],)), problem.channel.at_rest()
    choice = {"parallel_lag.fraction": 0.1, "parallel_lag.time_constant_s": SLOW_S}
    theta = Model(problem.channel, structure).start(np.array([-np.log(FAST_S)]), choice)
    stuck = fit(problem, structure, theta, earlier)
    found = refit(problem, structure, stuck)
    assert stuck.objective > 10.0 * found.objective
    assert found.objective < 1.3 * (problem.channel.count > 0).sum()
    first_s = problem.channel.begun_s
    np.testing.assert_allclose(found.deviations[:, RunEffect.START] - first_s, late_s, atol=0.3)
