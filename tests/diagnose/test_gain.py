"""A gain is measured on runs that took no part in the fit, in nothing that a model says of them."""

from dataclasses import replace

import numpy as np
import pytest
from small_worlds import record, small_plan

from shockrig.analysis.diagnose.gain import held_out_parts, measure_gain
from shockrig.analysis.diagnose.pool import Rated
from shockrig.analysis.diagnose.prepare import prepare
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import PLAIN
from shockrig.analysis.estimate.predictive import bumps, score
from shockrig.analysis.estimate.refitting import plain_fit, refit
from shockrig.rig.virtual.truth import Hidden


def test_what_one_run_alone_shows_is_no_gain_on_it(tmp_path):
    """Of ten runs one was under light: fitted to the others, no model knows what light does."""
    runs = [one for one in small_plan() if abs(one.source.temperature_c - one.destination.temperature_c) > 5.0]
    plan = [replace(one, extra={"irradiance_w_m2": 800.0} if i == 5 else {}) for i, one in enumerate(runs)]
    light = Hidden("radiative_heating", {"kelvin_per_w_m2_at_5_m_s": 6e-4})
    ready = prepare(build_channel(record(tmp_path / "campaign", 3, (light,), plan=plan), "temperature"))
    problem, plain = ready.problem, plain_fit(ready.problem)
    heated = refit(problem, PLAIN.adding(CATALOGUE["radiative_heating"]), plain)
    without, with_it = (Rated(one, score(problem, one, bumps(problem)), 0.0) for one in (plain, heated))
    found = measure_gain(problem.channel, held_out_parts(problem.channel, problem, without), with_it, ready.noise)
    lit = problem.channel.conditions.irradiance_w_m2 > 0.0
    assert lit.sum() == 1 and found.run_before[lit] > 100.0 * np.median(found.run_before)
    assert found.run_after == pytest.approx(found.run_before) and found.explained_fraction == 0.0
