"""Airs that nobody recorded and that move on behind their step: what a body shows of them, and that runs tell them from
a slow part of the sensor."""

from dataclasses import replace

import numpy as np
import pytest

from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.drifting import where_airs_drift
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import Model, Point
from shockrig.analysis.estimate.noise import estimate_noise, whiteners
from shockrig.analysis.estimate.problem import DRIFT_SCATTER, make_problem
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.estimate.refitting import plain_fit
from shockrig.files.campaign import Campaign, Run, RunAir, Trace

TAU_S, LASTS_S, NOISE_K = 100.0, 1200.0, 0.02
UNKNOWN = RunAir(None, None)


def channel_of(*given, **more) -> Channel:
    """The channel of `logs`."""
    found = build_channel(logs(*given, **more), "temperature")
    assert found is not None
    return found


def logs(drifts_k, slow=(0.0, 1.0), tau_s=TAU_S, lasts_s=LASTS_S, seed=1, period_s=5.0) -> Campaign:
    """Logs of a lag between 40 and 10 degC, to and fro, in air that moves by `drifts_k` from the transfer to the end;
    `slow` is the share and the time constant of another part beside it."""
    rng, runs = np.random.default_rng(seed), []
    for k, drift in enumerate(drifts_k):
        source, destination = (40.0, 10.0) if k % 2 else (10.0, 40.0)
        time = np.arange(0.0, 300.0 + lasts_s, period_s)
        late = np.maximum(time - 300.0 - rng.uniform(0.0, period_s), 0.0)

        def part(of_s, late=late, drift=drift, step=destination - source):
            shown = -np.expm1(-late / of_s)
            return step * shown + drift / lasts_s * (late - of_s * shown)  # the response to a step, and to a ramp

        value = source + (1.0 - slow[0]) * part(tau_s) + slow[0] * part(slow[1])
        trace = Trace(time, {"temperature_c": value + NOISE_K * rng.standard_normal(time.size)})
        runs.append(Run(str(k), UNKNOWN, UNKNOWN, None, 1000.0, None, None, trace, None))
    return Campaign("drifting", None, {}, 4e-4, 1e-5, tuple(runs), bodies={"imet": "lumped", "hyt": "film"})


def fitted(channel):
    problem = make_problem(channel, whiteners(channel, estimate_noise(channel)))
    return where_airs_drift(problem, plain_fit(problem))[1]


def test_a_reading_follows_air_that_drifts_as_a_lag_does():
    """Against steps of a second by which the air moves, each followed by itself."""
    channel = replace(channel_of([0.0, 0.0]), drifts=True)
    model, deviations = Model(channel), channel.at_rest()
    theta = model.start(np.array([-np.log(TAU_S)]))
    steady = model.predict(Point(theta, deviations))[0]
    deviations[:, RunEffect.DRIFT] = 0.1
    drifting = model.predict(Point(theta, deviations))[0]
    step_k = np.abs(channel.quantity.step(channel.conditions))
    for run in range(2):
        late = channel.time_s[run][channel.time_s[run] > 0]
        moments = np.arange(0.5, late[-1], 1.0)
        by_k = 0.1 * step_k[run] / channel.lasts_s[run]
        followed = [by_k * -np.expm1(-(t - moments[moments < t]) / TAU_S).sum() for t in late]
        assert (drifting - steady)[run][channel.time_s[run] > 0] == pytest.approx(np.array(followed), abs=2e-3)


def test_nothing_drifts_where_the_airs_were_recorded():
    airs = [(RunAir(10.0, 50.0), RunAir(40.0, 50.0)), (RunAir(40.0, 50.0), RunAir(10.0, 50.0))]
    open_ = channel_of([1.0, -1.0])
    traces = [Trace(t, {"temperature_c": y}) for t, y in open_.samples]
    runs = tuple(
        Run(str(k), *air, 5.0, 1000.0, 0.0, None, trace, None)
        for k, (air, trace) in enumerate(zip(airs, traces, strict=True))
    )
    bodies = {"imet": "lumped", "hyt": "film"}
    channel = build_channel(Campaign("steady", None, {}, 4e-4, 1e-5, runs, bodies=bodies), "temperature")
    channel, open_ = replace(channel, drifts=True), replace(open_, drifts=True)
    assert not channel.may_drift.any() and open_.may_drift.all()
    model, deviations = Model(channel), channel.at_rest()
    theta, before = model.start(np.array([-np.log(TAU_S)])), None
    for drift in (0.0, 0.3):
        deviations[:, RunEffect.DRIFT] = drift
        now = model.predict(Point(theta, deviations))
        assert before is None or (now == before).all()
        before = now


def test_drifts_and_the_rate_beside_them_are_those_that_were_there():
    drifts_k = np.array([1.5, -2.0, 0.6, 2.4, -1.0])
    channel = channel_of(drifts_k)
    found = fitted(channel)
    step_k = np.abs(channel.quantity.step(channel.conditions))
    shown_k = found.deviations[:, RunEffect.DRIFT] * step_k * LASTS_S / channel.lasts_s
    assert shown_k == pytest.approx(drifts_k, abs=0.1)
    assert np.exp(-found.theta[0]) == pytest.approx(TAU_S, rel=0.003)
    assert found.drift_scatter == pytest.approx(np.sqrt(np.mean(drifts_k**2)) / 30.0, rel=0.25)


def test_air_that_does_not_drift_is_fitted_as_steady():
    channel = channel_of([0.0] * 4)
    assert not fitted(channel).model.channel.may_drift.any()
    moving = make_problem(channel, whiteners(channel, estimate_noise(channel))).with_drifting_airs()
    found = plain_fit(moving)
    assert found.drift_scatter < 2.0 * DRIFT_SCATTER
    assert np.exp(-found.theta[0]) == pytest.approx(TAU_S, rel=0.003)


def test_what_a_model_is_wrong_by_is_no_drift():
    """A second part beside which the air drifts: a drift would take up what of it the lag leaves, as far as it can."""
    found = fitted(channel_of([1.0, -2.0, 1.5], slow=(0.4, 350.0)))
    assert not found.model.channel.may_drift.any() and (found.deviations[:, RunEffect.DRIFT] == 0.0).all()


@pytest.mark.parametrize("runs", [2, 3, 6])
def test_air_that_drifts_is_no_part_of_the_sensor(runs):
    """Before: two runs of a plain lag in a room that warms had a second part of 37 % and 861 s at 0.86."""
    drifts_k = 1.5 * np.random.default_rng(runs).standard_normal(runs)
    found = diagnose_channel(channel_of(drifts_k, seed=runs))
    assert (found.verdict, found.causes, found.discovered) == ("adequate", (), ())
    assert np.exp(-found.final.log_rates[0]) == pytest.approx(TAU_S, rel=0.005)
    assert any("air that still moved" in sentence for sentence in found.cannot_tell)


def test_a_single_run_does_not_tell_a_drift_from_a_slow_part():
    """Nothing is adequate beside a part that a drift stands for."""
    found = diagnose_channel(channel_of([0.0], slow=(0.15, 700.0)))
    assert not found.problem.channel.may_drift.any() and found.verdict != "adequate"


@pytest.mark.parametrize("runs", [2, 4])
def test_a_slow_part_of_the_sensor_is_no_drift_of_its_air(runs):
    found = diagnose_channel(channel_of([0.0] * runs, slow=(0.15, 700.0), seed=runs))
    (cause,) = found.causes
    assert cause.effect == "parallel_lag"
    assert cause.parameters["fraction"].value == pytest.approx(0.15, rel=0.1)
    assert not any("air that still moved" in sentence for sentence in found.cannot_tell)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_response_that_begins_amid_a_bin_is_no_lag_before_it(seed):
    """Before: bins of eight seconds held the turn of the readings, in all runs alike, and a lag in series of two
    seconds explained their means at 0.94 to 0.96."""
    found = diagnose_channel(channel_of([0.0] * 4, tau_s=230.0, lasts_s=2900.0, seed=seed, period_s=1.0))
    assert (found.verdict, found.causes) == ("adequate", ())
    channel = found.problem.channel
    begun = np.abs(channel.time_s - found.final.deviations[:, [RunEffect.START]])
    assert (channel.count[begun < 2.0] <= 1).all()


def test_characterize_and_diagnose_state_one_time_constant_of_a_sensor_in_air_that_drifts():
    campaign = logs([1.5, -2.0, 0.6, 2.4, -1.0])
    found, diagnosed = characterize(campaign).temperature, diagnose_channel(build_channel(campaign, "temperature"))
    assert found is not None and found.explained
    assert np.exp(-found.parts[0].fit.log_rates[0]) == pytest.approx(TAU_S, rel=0.003)
    assert found.parts[0].fit.drift_scatter == pytest.approx(diagnosed.final.drift_scatter, rel=0.3)
