"""A search that begins with what an earlier diagnosis named: it ends where one from nothing ends, whatever it is
told."""

import numpy as np
import pytest
from small_worlds import small_plan

from shockrig.analysis.diagnose import race as racing
from shockrig.analysis.diagnose.candidates import candidates
from shockrig.analysis.diagnose.cannot_tell import left_open
from shockrig.analysis.diagnose.prepare import prepare
from shockrig.analysis.diagnose.race import Race
from shockrig.analysis.diagnose.search import search
from shockrig.analysis.estimate.fit import MOST_STEPS
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.refitting import plain_fit
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.truth import Hidden, draw_truth

STEM = {"fraction": 0.04, "time_constant_s": 11.0}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    rng = np.random.default_rng(71)
    truth = draw_truth(rng, effects=[Hidden("stem_conduction", STEM, ("temperature",))])
    return simulate_campaign(truth, small_plan(), rng, tmp_path_factory.mktemp("stem") / "campaign")


@pytest.fixture(scope="module")
def ready(campaign):
    return prepare(build_channel(read_campaign(campaign), "temperature"))


@pytest.fixture(scope="module")
def cold(ready):
    return search(ready.problem, ready.structure, describing=False)


@pytest.mark.parametrize(
    "earlier",
    [
        {"stem_conduction": {"fraction": 0.038, "time_constant_s": 12.0}},
        pytest.param({"convective_film": {"biot_at_5_m_s": 0.3}}, marks=pytest.mark.trial),  # not there
        pytest.param(
            {"stem_conduction": STEM, "finite_transfer": {"duration_s": 0.4}}, marks=pytest.mark.trial
        ),  # one of two
        {"stem_conduction": {"fraction": -7.0}, "no_such_effect": {"size": 1.0}},  # out of range, and not known
    ],
)
def test_the_search_ends_with_the_same_model_wherever_it_begins(ready, cold, earlier):
    warm = search(ready.problem, ready.structure, earlier, describing=False)
    assert warm.best.ids == cold.best.ids == {"stem_conduction"}
    assert warm.best.value == pytest.approx(cold.best.value, abs=0.1)
    assert warm.best.fit.values()["stem_conduction"]["fraction"][0] == pytest.approx(0.04, rel=0.05)
    assert min(one.probability("stem_conduction") for one in (warm, cold)) > 0.9


@pytest.mark.parametrize("limit", [1, 20])
def test_a_search_has_an_end(ready, cold, monkeypatch, limit):
    """With fewer fits than it needs it says so, and what it has reached by then is weighed."""
    monkeypatch.setattr(racing, "MOST_FITS", limit)
    found = search(ready.problem, ready.structure, describing=False)
    # One step is made in any case, and one more begins below the limit.
    assert limit <= found.fits < min(limit + 120, cold.fits)
    assert found.weights.sum() == pytest.approx(1.0) and found.best is found.pool[0]
    said = left_open(found, found.best.fit)
    assert f"ended at its limit of work, after {found.fits} fits" in said[0]
    assert [one for one in said if "--from" in one] == list(said[1:])
    assert len(said[1:]) == (found.best.ids != found.plain.ids)  # what names nothing leads no further


def test_a_search_that_ends_by_itself_says_nothing_of_its_limit(cold):
    assert 0 < cold.fits < racing.MOST_FITS and left_open(cold, cold.best.fit) == ()


def test_a_search_begun_from_the_end_of_one_at_its_limit_leads_further(tmp_path, monkeypatch):
    """It made the same steps from nothing again, and came to the same end."""
    rng = np.random.default_rng(72)
    hidden = [
        Hidden("stem_conduction", {"fraction": 0.08, "time_constant_s": 11.0}, ("temperature",)),
        Hidden("finite_transfer", {"duration_s": 0.8}, ("temperature",)),
    ]
    campaign = simulate_campaign(draw_truth(rng, effects=hidden), small_plan(), rng, tmp_path / "campaign")
    ready = prepare(build_channel(read_campaign(campaign), "temperature"))
    monkeypatch.setattr(racing, "MOST_FITS", 60)
    first = search(ready.problem, ready.structure, describing=False)
    assert first.ended_early and first.best.ids == {"stem_conduction", "series_lag"}
    named = {id_: {name: value for name, (value, _) in own.items()} for id_, own in first.best.fit.values().items()}
    further = search(ready.problem, ready.structure, named, describing=False)
    assert further.best.ids == {"stem_conduction", "finite_transfer"}
    assert further.best.value > first.best.value + 100.0


def test_beside_a_larger_model_a_candidate_begins_where_it_came_to_beside_a_part_of_it(ready, monkeypatch):
    """All its starts were tried anew beside each model that a search came through. Beside one that is far from the runs
    it takes what others explain: where it came to there is no place to begin from."""
    among = [one for one in candidates(ready.problem.channel) if one.form is None]
    race, begun, fitted = Race(ready.problem, ready.structure, among), list[frozenset[str]](), Race.fitted

    def noted(self, structure, theta, deviations, steps=MOST_STEPS):
        begun.append(frozenset(structure.ids))
        return fitted(self, structure, theta, deviations, steps)

    monkeypatch.setattr(Race, "fitted", noted)
    plain = race.keep(race.rated(plain_fit(ready.problem, ready.structure)))
    stem = race.forward(plain, among)
    race.forward(stem, among)
    assert race.beside(plain).far and not race.beside(stem).far
    beside_stem = {effect: begun.count(stem.ids | {effect}) for effect in race.beside(stem).fits}
    assert len(beside_stem) >= 5 and min(beside_stem.values()) > 1
    larger = race.beside(stem).fits[next(iter(beside_stem))][0]
    race.forward(larger, [one for one in among if one.effect.id in beside_stem])
    beside_larger = [begun.count(larger.ids | {effect}) for effect in race.beside(larger).fits]
    assert len(beside_larger) >= 3 and set(beside_larger) == {1}
