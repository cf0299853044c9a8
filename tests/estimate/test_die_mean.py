"""A logger's mean of RH that is read at the die's temperature: each reading is turned at the die as it was then."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shockrig.analysis.diagnose.adequacy import judge
from shockrig.analysis.diagnose.grammar import forms
from shockrig.analysis.diagnose.prepare import prepare
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import described
from shockrig.analysis.estimate.fit import fit, run_misfit
from shockrig.analysis.estimate.gather import build_channel, smooth_dies
from shockrig.analysis.estimate.model import Held, Model, Point, Structure
from shockrig.analysis.estimate.refitting import plain_fit, refit
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import Hidden, draw_truth

EXAMPLE = Path(__file__).parents[2] / "data" / "examples" / "plain-rough"


@pytest.mark.parametrize("readings", [5, pytest.param(13, marks=pytest.mark.trial)])
def test_the_true_model_leaves_noise_alone(readings, tmp_path):
    rng = np.random.default_rng(90 + readings)
    hidden = [
        Hidden("die_thermal_lag", {}, ("humidity",)),
        Hidden("moving_average", {"samples": float(readings)}, ("humidity",)),
    ]
    campaign = simulate_campaign(draw_truth(rng, "rough", hidden), standard_plan(), rng, tmp_path / "campaign")
    ready = prepare(build_channel(read_campaign(campaign), "humidity"))
    assert ready.structure.held_values("moving_average") == {"samples": readings}
    structure = ready.structure.adding(CATALOGUE["die_thermal_lag"])
    found = refit(ready.problem, structure, plain_fit(ready.problem, ready.structure))
    assert run_misfit(ready.problem, found).mean() < 1.2


@pytest.mark.parametrize(
    ("ramp_s", "late_s", "share"), [(0.0, 0.0, 0.0), (0.0, 0.4, 0.0), (0.7, 0.3, 0.0), (0.0, 0.0, 8e-3)]
)
def test_the_noise_of_a_die_is_taken_off_whenever_it_begins(ramp_s, late_s, share):
    """Known answer: a first-order lag of 11 s behind a ramp, logged late, or by a clock that runs fast."""
    rng, tau = np.random.default_rng(1), 11.0
    times, exact = [], []
    for run in range(10):
        time = np.arange(-10.0 - 20.0 * (run % 2), 90.0, 0.1) + rng.uniform(0.0, 0.1)
        t = np.maximum(time - late_s + share * time[0], 0.0)
        lag = [np.maximum(u, 0.0) - tau * -np.expm1(-np.maximum(u, 0.0) / tau) for u in (t, t - ramp_s)]
        rise = (lag[0] - lag[1]) / ramp_s if ramp_s else -np.expm1(-t / tau)
        times.append(time)
        exact.append(20.0 + (20.0 if run % 3 else -15.0) * rise)
    noisy = [np.round(die + 0.02 * rng.standard_normal(die.size), 2) for die in exact]
    for time, die, smooth in zip(times, exact, smooth_dies(times, noisy, 1.0), strict=True):
        near = np.abs(time) < 3.0
        assert np.abs(smooth - die)[near].max() < 0.03  # a shift of 0.02 s
        assert np.sqrt(np.mean((smooth - die) ** 2)) < 0.006


def test_a_delay_beside_a_die_is_adequate(tmp_path):
    """The die is logged by the same clock as the humidity that is read at its temperature."""
    rng = np.random.default_rng(50003)
    late = [Hidden("die_thermal_lag", {}, ("humidity",)), Hidden("dead_time", {"delay_s": 0.4}, ("humidity",))]
    campaign = simulate_campaign(draw_truth(rng, "rough", late), standard_plan(), rng, tmp_path / "campaign")
    ready = prepare(build_channel(read_campaign(campaign), "humidity"))
    channel, plain = ready.problem.channel, plain_fit(ready.problem, ready.structure)
    structure = ready.structure.adding(CATALOGUE["die_thermal_lag"]).adding(CATALOGUE["dead_time"])
    begun = Model(channel, structure).start(plain.log_rates, {"dead_time.delay_s": 0.4})
    found = refit(ready.problem, structure, fit(ready.problem, structure, begun, channel.at_rest()))
    assert judge(ready.problem, found).passed
    value, spread = found.values()["dead_time"]["delay_s"]
    assert abs(value - 0.4) < 2.5 * spread < 0.02


def test_the_die_is_taken_from_its_own_trace():
    """A die that warms by 1 K in a second stood 0.4 K lower 0.4 s before."""
    times = np.arange(-5.0, 20.0, 0.1)
    die = np.where(times > 0, 20.0 + np.minimum(times, 10.0), 20.0)
    channel = build_channel(read_campaign(EXAMPLE), "humidity").select(np.array([0]))
    channel = replace(channel, samples=((times, np.zeros(times.size)),), die_samples=(die,))
    late = (channel.time_s[0] > 1.0) & (channel.time_s[0] < 9.0)
    earlier = channel.die_earlier_c(0.4)[0, late]
    assert earlier == pytest.approx(20.0 + channel.time_s[0, late] - 0.4, abs=1e-9)


def test_every_form_goes_through_a_mean_of_readings():
    """What a description adds is averaged reading by reading; of a reading at rest the mean is the reading."""
    channel = build_channel(read_campaign(EXAMPLE), "humidity")
    at_rest = np.broadcast_to(channel.time_s < -1.5, channel.time_s.shape)
    average = CATALOGUE["moving_average"]
    every = [form for form in forms(channel) if form.behaves_as != "periodic"]
    assert at_rest.any() and {"die_temperature", "air_temperature"} <= {form.driver for form in every}
    for form in every:
        effect, shown = described(form.key, True), []
        single = Structure((effect,))
        for structure in (single, single.adding(average, Held(average.id, "samples", 11.0))):
            model = Model(channel, structure)
            shown.append(model.predict(Point(model.start(np.zeros(channel.rates)), channel.at_rest()))[0])
        np.testing.assert_allclose(shown[1][at_rest], shown[0][at_rest], atol=1e-6, err_msg=form.key)
        assert np.isfinite(shown[1]).all(), form
