"""A model fitted again from where another led."""

from dataclasses import replace

import numpy as np
import pytest
from small_worlds import record

from shockrig.analysis.diagnose.candidates import candidates
from shockrig.analysis.diagnose.held_out import run_errors
from shockrig.analysis.diagnose.prepare import prepare
from shockrig.analysis.diagnose.race import Race
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.fit import fit
from shockrig.analysis.estimate.fit_starts import unstuck
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import PLAIN
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.estimate.refitting import as_judged, carried, plain_fit, refit
from shockrig.files.campaign import Campaign, Run, RunAir, Trace
from shockrig.rig.virtual.plans import wide_plan
from shockrig.rig.virtual.truth import Hidden, TrueNoise

PERIOD_S = 10.0


def untriggered(seed, lengths=(300, 300, 300)):
    """Runs of two exponentials, 40 s and 400 s, of which nobody recorded start, airs or airflow."""
    rng, made = np.random.default_rng(seed), []
    for k, length in enumerate(lengths):
        time = PERIOD_S * np.arange(length) + rng.uniform(0.0, PERIOD_S)
        late = np.maximum(time - 100.0 - rng.uniform(0.0, PERIOD_S), 0.0)
        shown = 1.0 - 0.6 * np.exp(-late / 40.0) - 0.4 * np.exp(-late / 400.0)
        value = 20.0 + (10.0 if k % 2 else -10.0) * shown + 0.02 * rng.standard_normal(time.size)
        nobody = RunAir(None, None)
        trace = Trace(time, {"temperature_c": value})
        made.append(Run(str(k), nobody, nobody, None, 1000.0, None, None, trace, None))
    return build_channel(Campaign("n", None, {}, 4e-4, 1e-5, tuple(made)), "temperature")


def test_a_wrong_model_ends_where_no_other_start_leaves_less():
    """Readings are 10 s apart, so that no gradient leads a start across one."""
    problem = prepare(untriggered(1)).problem
    wrong = PLAIN.adding(CATALOGUE["body_sphere_mean"])
    found = refit(problem, wrong, plain_fit(problem))
    for shift_s in np.linspace(-3.0 * PERIOD_S, 3.0 * PERIOD_S, 9):
        begun = found.deviations.copy()
        begun[:, RunEffect.START] += shift_s
        assert fit(problem, wrong, found.theta, begun, 40).objective > 0.99 * found.objective


def test_a_wrong_model_is_fitted_to_what_runs_have_in_common():
    """A lag follows the fast one of two in a short record, and the slow one in a long one: with a rate of its own each
    is left little of, and the mean of these rates is that of no run."""
    problem = prepare(untriggered(2, (40, 300, 300, 40))).problem
    own = plain_fit(problem)
    alike = as_judged(problem, own)
    assert np.abs(own.deviations[:, RunEffect.RATE]).max() > 0.1
    assert alike.deviations[:, RunEffect.RATE] == pytest.approx(0.0, abs=1e-6)

    def left(found, rate=0.0):
        return run_errors(problem.channel, problem, replace(found, theta=found.theta + rate)).sum()

    assert left(alike) < 0.95 * left(own)
    assert left(alike) < 1.02 * min(left(alike, rate) for rate in np.linspace(-0.6, 0.6, 13))


def test_a_right_model_is_fitted_alike_as_it_is_judged():
    problem = prepare(untriggered(1)).problem
    found = refit(problem, PLAIN.adding(CATALOGUE["parallel_lag"]), plain_fit(problem))
    again = as_judged(problem, found)
    sure = np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(again.theta - found.theta) < 5.0 * sure)
    left = [run_errors(problem.channel, problem, one).mean() for one in (found, again)]
    assert left[1] == pytest.approx(left[0], rel=0.02)


def test_what_a_profile_carries_knows_how_far_its_runs_are_apart():
    """Fitted at one rate, its runs' own rates are still those that they have, and its uncertainty counts them."""
    problem = prepare(untriggered(2, (40, 300, 300, 40))).problem
    own = plain_fit(problem)
    found = carried(problem, own, as_judged(problem, own))
    assert found.theta == pytest.approx(as_judged(problem, own).theta)
    assert found.own_rates().own.std() == pytest.approx(own.own_rates().own.std(), rel=0.3)
    assert np.sqrt(found.covariance[0, 0]) > 0.5 * own.own_rates().own.std() / 2.0


def lone_plunge():
    """Three exponentials after a transfer of one second, the last reading before it 0.3 s after its begin."""
    period_s = 1.144
    time = period_s * np.arange(160)
    late = np.maximum(time - 60 * period_s + 0.33, 0.0)
    shown = np.zeros(time.size)
    for share, lag in ((0.5, 2.5), (0.3, 8.0), (0.2, 40.0)):
        moving = late - lag * (1.0 - np.exp(-late / lag))
        moved = 1.0 - lag * (np.exp(-(late - 1.0) / lag) - np.exp(-late / lag))
        shown += share * np.where(late < 1.0, moving, moved)
    value = 24.0 - 20.0 * shown + 0.05 * np.random.default_rng(3).standard_normal(time.size)
    nobody = RunAir(None, None)
    run = Run("1", nobody, nobody, None, 1000.0, None, None, Trace(time, {"temperature_c": value}), None)
    bodies = {"imet": "lumped", "hyt": "film"}
    return build_channel(Campaign("n", None, {}, 4e-4, 1e-5, (run,), bodies), "temperature")


def test_a_lone_run_is_fitted_on_the_better_side_of_the_reading_at_its_transfer():
    """Two valleys of start and rates, one on each side; a scan that holds the rates stays in either."""
    problem = prepare(lone_plunge()).problem
    two = PLAIN.adding(CATALOGUE["parallel_lag"])
    found = refit(problem, two, plain_fit(problem))
    sides = []
    for start_s in (-0.6, 0.4):
        begun = np.full_like(found.deviations, 0.0)
        begun[:, RunEffect.START] = start_s
        sides.append(fit(problem, two, found.theta, begun, 40))
    best = min(one.objective for one in sides)
    assert max(one.objective for one in sides) > 1.05 * best
    assert all(unstuck(problem, one).objective < 1.001 * best for one in [*sides, found])


def test_an_air_film_is_found_where_it_makes_the_bead_many_times_slower(tmp_path):
    """From the plain model's rate, a twentieth of the bead's own, the fit ended at a Biot number of 0.40."""
    film = Hidden("convective_film", {"biot_at_5_m_s": 0.145})
    fast = {"thermal_diffusivity_m2_s": 4.07e-7, "temperature_noise": TrueNoise(0.0108)}
    campaign = record(tmp_path / "film", 5, [film], plan=wide_plan(), **fast)
    problem = prepare(build_channel(campaign, "temperature")).problem
    among = [one for one in candidates(problem.channel) if one.effect.id == "convective_film"]
    race = Race(problem, PLAIN, among)
    found = race.forward(race.keep(race.rated(plain_fit(problem))), among)
    assert found.fit.objective < 1.2 * problem.channel.count.size
    biot, spread = found.fit.values()["convective_film"]["biot_at_5_m_s"]
    assert abs(biot - 0.145) < 4.0 * spread
