"""A ceiling is named where readings stop below what the air is, and not where plateaus are merely alike."""

import numpy as np
import pytest
from small_worlds import record

from shockrig.analysis.diagnose.candidates import refused
from shockrig.analysis.diagnose.prepare import prepare
from shockrig.analysis.diagnose.search import search
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.fit import fit
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.refitting import plain_fit
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import ROUGH, Hidden

OFF = Hidden("calibration_error", {"gain": -0.0035, "offset": -0.1}, ("humidity",))
CEILING = CATALOGUE["saturation_clipping"]


def wet_world(folder, *effects, plan=None):
    """Chambers that hit their set points, references that scatter by 0.1 %RH: plateaus are more alike than airs."""
    shocks = [
        run
        for run in plan or standard_plan()
        if abs(run.destination.humidity_percent - run.source.humidity_percent) > 20.0
    ]
    campaign = record(folder / "c", 3, effects, tier=ROUGH, plan=shocks, chamber_scatter_percent=0.0)
    return prepare(build_channel(campaign, "humidity")).problem


@pytest.mark.trial
def test_a_limit_amid_the_readings_of_a_plateau_is_no_ceiling(tmp_path):
    """It gains a lot: the runs' stated airs scatter, their plateaus do not."""
    problem = wet_world(tmp_path, OFF)
    plain = plain_fit(problem)
    start = np.append(plain.theta, [0.0, 0.0])
    off = fit(problem, plain.structure.adding(CATALOGUE["calibration_error"]), start, plain.deviations)
    limited = fit(problem, off.structure.adding(CEILING), np.append(off.theta, 79.5), off.deviations)
    (limit, _) = limited.values()["saturation_clipping"]["limit_percent"]
    wet = problem.channel.conditions.destination_percent > 78.0
    plateau = np.concatenate([y[-200:] for (_, y), kept in zip(problem.channel.samples, wet, strict=True) if kept])
    assert off.deviance - limited.deviance > 25.0  # more than its penalty
    assert 0.3 < np.mean(plateau > limit) < 0.7
    assert refused(limited, CEILING)
    assert search(problem).best.fit.structure.ids == ("calibration_error",)


def test_plateaus_that_are_more_alike_than_the_airs_leave_nothing_open(tmp_path):
    """Before: a ceiling amid the readings of a plateau is no finding, but likelier than the plain model, which was then
    `unexplained` though nothing is left of it."""
    found = search(wet_world(tmp_path, plan=standard_plan()[::2]))
    assert any("saturation_clipping" in one.ids and one.value > found.plain.value for one in found.predictors)
    assert found.best is found.plain and not found.leaves_open


def test_a_limit_below_the_air_is_a_ceiling(tmp_path):
    problem = wet_world(tmp_path, Hidden("saturation_clipping", {"limit_percent": 79.0}), plan=standard_plan()[::3])
    found = search(problem).best.fit
    assert found.structure.ids == ("saturation_clipping",)
    (limit, spread) = found.values()["saturation_clipping"]["limit_percent"]
    assert abs(limit - 79.0) < 3.5 * spread + 0.01
    assert not refused(found, CEILING)
