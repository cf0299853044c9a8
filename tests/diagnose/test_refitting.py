"""A model fitted again from where another led."""

import numpy as np
from small_worlds import record

from shockrig.analysis.diagnose.candidates import candidates
from shockrig.analysis.diagnose.prepare import prepare
from shockrig.analysis.diagnose.refitting import plain_fit, refit
from shockrig.analysis.diagnose.search import Race
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.fit import fit
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import PLAIN
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.files.campaign import Campaign, Run, RunAir, Trace
from shockrig.rig.virtual.plans import wide_plan
from shockrig.rig.virtual.truth import Hidden, TrueNoise

PERIOD_S = 10.0


def untriggered(seed):
    """Three runs of two exponentials, 40 s and 400 s, of which nobody recorded start or airs."""
    rng, made = np.random.default_rng(seed), []
    for k in range(3):
        time = PERIOD_S * np.arange(300) + rng.uniform(0.0, PERIOD_S)
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
