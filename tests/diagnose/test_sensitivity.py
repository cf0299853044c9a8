"""The numbers of the diagnosis that are halved and doubled."""

import pytest
from benchmark_scripts import benchmark

from shockrig.rig.virtual.truth import Hidden


def test_every_number_whose_sensitivity_is_counted_is_there_and_is_itself_again_afterwards():
    sensitivity, rules = benchmark("sensitivity"), benchmark("ablation_rules")
    assert {*sensitivity.NUMBERS_OF, "whole"} == sensitivity.KINDS.keys()
    listed = [name for names in sensitivity.NUMBERS_OF.values() for name in names]
    every = sensitivity.numbers_in("diagnose")
    assert {name for name in listed if name.startswith("diagnose.")} < set(every)
    for name in (*listed, *every):
        own = rules.number_of(name)
        with rules.without(sensitivity.changed(name, 2.0)):
            assert rules.number_of(name) == pytest.approx(sensitivity.scaled(own, 2.0)), name
        assert rules.number_of(name) is own or rules.number_of(name) == own


@pytest.mark.parametrize(
    ("own", "twice"),
    [(3, 6), (0.5, 1.0), ((1, 2.5), (2, 5.0)), ({"a": 0.1}, {"a": 0.2}), (True, None), (("a", 1), None)],
)
def test_a_number_is_doubled_and_so_is_each_of_several(own, twice):
    assert benchmark("sensitivity").scaled(own, 2.0) == twice


def test_a_number_that_is_not_there_is_said_to_be_so():
    with pytest.raises(ValueError, match="no number at diagnose.hums.NOTHING"):
        benchmark("ablation_rules").number_of("diagnose.hums.NOTHING")


def test_a_hum_is_seen_as_it_is_and_not_where_it_takes_more_plateaus_than_there_are(tmp_path, monkeypatch):
    sensitivity, rules = benchmark("sensitivity"), benchmark("ablation_rules")
    monkeypatch.setattr(sensitivity, "_folder", lambda: tmp_path)
    (usual,) = sensitivity.hums(48002)
    with rules.without(sensitivity.changed("diagnose.hums.FEWEST_PLATEAUS", 100.0)):
        (other,) = sensitivity.hums(48002)
    assert usual["right"] and usual["said"][0] and other["said"][0] == [] and not other["right"]


def test_campaigns_of_a_seed_that_hide_an_effect_of_other_sizes_are_two(tmp_path, monkeypatch):
    """Before: what a logger does to one channel was judged on a campaign that hid it in another."""
    sensitivity = benchmark("sensitivity")
    monkeypatch.setattr(sensitivity, "_folder", lambda: tmp_path)
    fine, coarse = (
        sensitivity.campaign(48003, [Hidden("quantization", {"step": step}, ("temperature",))]).path
        for step in (0.05, 0.5)
    )
    assert (fine / "runs/0001/imet.csv").read_text() != (coarse / "runs/0001/imet.csv").read_text()
