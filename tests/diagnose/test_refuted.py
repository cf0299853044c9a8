"""A model that misses runs held out by more than the plain one is not stated, whatever its weight."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from foreign_lab import Arrival, Lab, LabLogger, LabRun, Written, make_body, record

from shockrig.analysis.diagnose import diagnose
from shockrig.analysis.diagnose.diagnose import diagnose_channel, refuted
from shockrig.analysis.diagnose.gain import Gain
from shockrig.analysis.diagnose.pool import Rated, Search
from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import PLAIN
from shockrig.analysis.estimate.predictive import Score, weights
from shockrig.files.campaign import read_campaign


def gain(before, after):
    return Gain(before, after, 0.02, 0.0, (0.0, 0.0), np.array([before**2]), np.array([after**2]))


@pytest.mark.parametrize(
    ("before", "after", "tolerance", "out"),
    [
        (0.2, 0.1, 0.03, False),
        (0.2, 0.2, 0.0, False),
        (0.2, 0.2001, 0.03, False),  # worse by less than matters
        (0.2, 0.2001, 0.0, True),
        (0.2, 0.4, 0.03, True),
    ],
)
def test_a_model_is_refuted_where_it_predicts_worse_by_what_matters(before, after, tolerance, out):
    assert refuted(gain(before, after), tolerance) is out


def test_a_single_run_that_had_to_be_extrapolated_refutes_nothing():
    runs = {"run_before": np.array([0.09, 0.09, 0.25]), "run_after": np.array([0.0009, 0.0009, 1.0])}
    assert not refuted(replace(gain(0.38, 0.58), **runs), 0.03)


@pytest.mark.parametrize("all_but_the_plain", [True, False])
def test_the_likeliest_model_that_is_not_refuted_is_stated(tmp_path, monkeypatch, all_but_the_plain):
    """The heaviest of the others, and the plain one where those are refuted as well."""
    plan = tuple(LabRun(*((60.0, 20.0) if i % 2 else (20.0, 60.0)), start_s=3.0, length_s=9.0) for i in range(2))
    lump = make_body("lumped", 0.6)
    bench = Lab("temperature", lump, Arrival(), LabLogger(0.05, 0.01, 0.03), plan, Written(body="sphere"))
    record(bench, 5, tmp_path / "campaign")
    channel = build_channel(read_campaign(tmp_path / "campaign"), "temperature")
    tried = []

    def measured(channel, parts, model, noise):
        tried.append(model)
        bad = bool(model.ids) if all_but_the_plain else len(tried) == 1
        return gain(0.5, 0.9 if bad else 0.5)

    monkeypatch.setattr(diagnose, "measure_gain", measured)
    found = diagnose_channel(channel, describing=False)
    assert tried[0].ids  # the heaviest model is not the plain one
    assert found.search.best is tried[-1] and found.gain.after == 0.5
    assert any("0.9 K, and the plain one by 0.5 K" in said for said in found.cannot_tell)
    if all_but_the_plain:
        assert found.causes == () and not found.final.structure.effects and found.verdict == "unexplained"
    else:
        assert len(tried) == 2 and found.search.best in found.search.tied()
    assert not any(one is tried[0] for one in found.search.pool) and found.search.weights.sum() == pytest.approx(1.0)


def test_what_stands_in_the_place_of_a_refuted_model_is_as_sure_as_any_other():
    """Before: the next that was tied was stated with the weight that the refuted model had left it."""

    def rated(nats, *effects):
        structure = PLAIN
        for id_ in effects:
            structure = structure.adding(CATALOGUE[id_])
        return Rated(SimpleNamespace(structure=structure), Score(np.full(12, nats / 12), 0.01), 0.0)

    plain, other, right = rated(0.0), rated(0.4, "dead_time"), rated(30.0, "series_lag")
    pool, weight = (right, other, plain), weights([one.score.runs for one in (right, other, plain)], [0.0] * 3)
    found = Search(plain, right, pool, weight, 3, (), right)
    left = found.without_best()
    assert found.weight(other) < 0.01 < left.weight(other) < level("named") and left.best is plain
    sure = replace(found, pool=(right, rated(20.0, "dead_time"), plain)).without_best()
    assert sure.best.ids == {"dead_time"} and sure.probability("dead_time") > level("named")
