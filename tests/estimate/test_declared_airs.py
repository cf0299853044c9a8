"""Airs that a run states are held against its probes: a run whose probes stood elsewhere does not count."""

import pytest
from fake_bench import STEPS, FakeReference, fake_bench, plan, run, run_json

from shockrig.protocols.cli import main
from shockrig.rig.bench_errors import CampaignPaused
from shockrig.rig.chambers.devices import DeviceChambers
from shockrig.rig.observer import SilentObserver
from shockrig.rig.protocol import Faults, Record
from shockrig.rig.recorder import read_state
from shockrig.rig.references import Hyt271Reference, Hyt271ReferenceSettings, OperatorEntry, SetPoints
from shockrig.rig.seams import Air
from shockrig.rig.stages.manual import PromptedChambers


class Claims(FakeReference):
    """A reference that says of the airs what a person typed; the first `wrong` runs it is wrong."""

    origins = ("typed", "set point")

    def __init__(self, world, source=None, destination=None):
        super().__init__(world)
        self._claims = source, destination

    def source(self):
        return self._claims[0] or super().source()

    def destination(self):
        return self._claims[1] or super().destination()


def bench_that_claims(**claims):
    bench = fake_bench()
    bench.reference = Claims(bench.reference._world, **claims)
    return bench


SOURCE, DESTINATION = "in the source air", "in the destination air"
WRONG = {
    "a source that is too warm": ("source", Air(40.0, 20.0), f"imet stood at 20.0 degC {SOURCE}", "40.0 degC (typed)"),
    "a source that is too wet": ("source", Air(20.0, 55.0), f"hyt stood at 20.0 %RH {SOURCE}", "55.0 %RH (typed)"),
    "a destination": (
        "destination",
        Air(60.0, 70.0),
        f"imet stood at 30.0 degC {DESTINATION}",
        "60.0 degC (set point)",
    ),
    "no change": ("destination", Air(20.0, 20.0), f"imet stood at 30.0 degC {DESTINATION}", "20.0 degC (set point)"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_run_in_another_air_than_stated_is_marked_repeated_and_never_complete(tmp_path, case):
    place, air, stood, said = WRONG[case]
    path, told = tmp_path / "c", []
    observer = SilentObserver()
    observer.say = told.append
    with pytest.raises(CampaignPaused) as paused:
        run(bench_that_claims(**{place: air}), path, plan(1, faults=Faults(repeat_at_most=1)), observer)
    state = read_state(path)
    assert state.recorded == () and [aside.status for aside in state.set_aside] == ["spoilt"] * 2
    for text in (str(paused.value), state.set_aside[0].reason):
        assert stood in text and said in text
    assert any("is spoilt" in text and "is repeated (1 of 1)" in text for text in told)


POSSIBLE = {
    "off by a calibration's error": {"source": Air(23.0, 28.0)},
    "not known": {"source": Air(None, None), "destination": Air(None, None)},
    "half of the way not reached yet": {"destination": Air(33.0, 100.0)},
}


@pytest.mark.parametrize("case", POSSIBLE)
def test_airs_that_probes_can_have_stood_in_count(tmp_path, case):
    assert run(bench_that_claims(**POSSIBLE[case]), tmp_path / "c", plan(1)) == ["0001"]
    assert run_json(tmp_path / "c")["status"] == "complete"


def test_a_recording_too_short_to_settle_in_is_not_judged_by_its_end(tmp_path):
    steps = (*STEPS[:3], Record(6.0))
    assert run(bench_that_claims(), tmp_path / "c", plan(1, steps)) == ["0001"]


def test_a_protocol_says_how_far_off_is_too_far(tmp_path):
    strict = plan(1, faults=Faults(repeat_at_most=0, airs_within_k=0.5))
    with pytest.raises(CampaignPaused, match="21.0 degC .typed"):
        run(bench_that_claims(source=Air(21.0, 20.0)), tmp_path / "c", strict)


def test_run_json_says_how_each_air_is_known(tmp_path):
    run(bench_that_claims(), tmp_path / "c", plan(1))
    assert run_json(tmp_path / "c")["airs_from"] == {"source": "typed", "destination": "set point"}
    assert main(["run", "quick", "--out", str(tmp_path / "q"), "--seed", "1"]) == 0
    assert run_json(tmp_path / "q")["airs_from"] == {"source": "set point", "destination": "set point"}


def test_every_reference_knows_where_its_airs_come_from():
    person, device = PromptedChambers(None), DeviceChambers({"destination": None}, None, None)
    assert SetPoints(person).origins == ("set point", "set point")
    assert SetPoints(device).origins == ("set point", "measured")
    assert OperatorEntry(None, None).origins == ("typed", "typed")
    for place, origins in (
        ("probes", ("measured", "measured")),
        ("source", ("measured", "set point")),
        ("destination", ("set point", "measured")),
    ):
        settings = Hyt271ReferenceSettings(bus=1, air=place)
        assert Hyt271Reference(settings, None, person).origins == origins


def test_an_air_that_is_measured_and_not_as_planned_is_said_and_counts(tmp_path):
    path, told = tmp_path / "c", []
    observer = SilentObserver()
    observer.say = told.append
    bench = fake_bench()
    set_airs = bench.stage._world.change
    bench.stage._world.change = lambda airs, here: set_airs((Air(23.0, 20.0), airs[1]), here)
    assert run(bench, path, plan(1), observer) == ["0001"]
    assert told == ["run 0001: the source air has 23.0 degC; 20 degC was planned"]
    assert run_json(path)["source"]["temperature_c"] == 23.0
