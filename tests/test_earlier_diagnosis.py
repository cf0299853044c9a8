"""A search that begins with what an earlier diagnosis named: it ends where one from nothing ends, whatever it is told,
with fewer fits."""

import json
from dataclasses import replace

import numpy as np
import pytest

from shockrig.analysis.diagnosis import refitting
from shockrig.analysis.diagnosis import search as searching
from shockrig.analysis.diagnosis.limits import ended
from shockrig.analysis.diagnosis.prepare import prepare
from shockrig.analysis.inference.gather import build_channel
from shockrig.analysis.inference.work import Work
from shockrig.files.campaign import read_campaign
from shockrig.protocols.cli import main
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import Hidden, draw_truth

STEM = {"fraction": 0.04, "time_constant_s": 11.0}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    rng = np.random.default_rng(71)
    truth = draw_truth(rng, effects=[Hidden("stem_conduction", STEM, ("temperature",))])
    return simulate_campaign(truth, standard_plan(), rng, tmp_path_factory.mktemp("stem") / "campaign")


@pytest.fixture(scope="module")
def ready(campaign):
    return prepare(build_channel(read_campaign(campaign), "temperature"))


@pytest.fixture(scope="module")
def cold(ready):
    return searching.search(ready.problem, ready.structure)


@pytest.mark.parametrize(
    "earlier",
    [
        {"stem_conduction": {"fraction": 0.038, "time_constant_s": 12.0}},
        {"convective_film": {"biot_at_5_m_s": 0.3}},  # not there
        {"stem_conduction": STEM, "finite_transfer": {"duration_s": 0.4}},  # one of two is there
        {"stem_conduction": {"fraction": -7.0}, "no_such_effect": {"size": 1.0}},  # out of range, and not known
    ],
)
def test_the_search_ends_with_the_same_model_wherever_it_begins(ready, cold, earlier):
    warm = searching.search(ready.problem, ready.structure, earlier=earlier)
    assert warm.final.structure.ids == cold.final.structure.ids == ("stem_conduction",)
    assert warm.final.deviance == pytest.approx(cold.final.deviance, abs=0.1)
    assert warm.final.values()["stem_conduction"]["fraction"][0] == pytest.approx(0.04, rel=0.05)


@pytest.mark.parametrize("limit", [1, 20, 60])
def test_a_search_has_an_end(ready, cold, monkeypatch, limit):
    """With fewer fits than it needs it says so, and keeps no effect that was not held against the others."""
    made = []
    counted = searching.fit
    for module in (searching, refitting):
        monkeypatch.setattr(module, "fit", lambda *a, **k: made.append(1) or counted(*a, **k))
    monkeypatch.setattr(searching, "MOST_FITS", limit)
    found = searching.search(ready.problem, ready.structure)
    assert set(found.final.structure.ids) - set(ready.structure.ids) == set(found.standing)
    # One step of the search is made in any case, and one more begins below the limit.
    assert len(made) < searching.IN_ALL * limit + 60
    assert found.at_limit == (limit < 60) and not cold.at_limit
    if limit == 60:
        assert found.final.structure.ids == cold.final.structure.ids


def test_a_diagnosis_says_which_of_its_searches_has_ended_early(cold):
    work = Work(at_most=5)
    assert ended(cold, work) == ()
    (said,) = ended(replace(cold, at_limit=True), work)
    assert f"ended at its limit of work, after {len(cold.moves)} steps ({cold.fits} fits)" in said
    work.count(7)
    (said,) = ended(cold, work)
    assert "for a description ended at its limit of work, after 7 fits" in said


def test_a_search_told_the_answer_fits_less(ready, cold, monkeypatch):
    fits = []
    counted = searching.fit
    for module in (searching, refitting):
        monkeypatch.setattr(module, "fit", lambda *a, **k: fits.append(1) or counted(*a, **k))
    searching.search(ready.problem, ready.structure)
    from_nothing = len(fits)
    fits.clear()
    values = {name: value for name, (value, _) in cold.final.values()["stem_conduction"].items()}
    searching.search(ready.problem, ready.structure, earlier={"stem_conduction": values})
    assert len(fits) < 0.8 * from_nothing


def test_the_command_takes_an_earlier_diagnosis_of_the_same_campaign_alone(campaign, tmp_path, capsys):
    first, second = tmp_path / "first", tmp_path / "second"
    assert main(["diagnose", str(campaign), "--out", str(first)]) == 0
    assert main(["diagnose", str(campaign), "--out", str(second), "--from", str(first)]) == 0
    a, b = (json.loads((d / "diagnosis.json").read_text())["channels"]["temperature"] for d in (first, second))
    assert [c["effect"] for c in a["causes"]] == [c["effect"] for c in b["causes"]] == ["stem_conduction"]
    assert not a["work"]["search"]["ended_early"] and b["work"]["search"]["fits"] < a["work"]["search"]["fits"] < 400
    # Nothing is left to describe; a few plain forms were held against the name.
    assert 0 < a["work"]["description"]["fits"] < 60 and not a["work"]["description"]["ended_early"]
    other = json.loads((first / "diagnosis.json").read_text()) | {"campaign": "another"}
    (tmp_path / "other.json").write_text(json.dumps(other))
    capsys.readouterr()
    asked = ["diagnose", str(campaign), "--out", str(tmp_path / "third"), "--from", str(tmp_path / "other.json")]
    assert main(asked) == 2
    said = capsys.readouterr().err
    assert "another" in said and "--from" in said
    assert not (tmp_path / "third").exists()
