"""Diagnoses that are made while the next run is recorded: what they rest on, and that nobody's speed decides."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from benchmark_scripts import benchmark
from small_worlds import QUIET

from shockrig.analysis.design.goals import parse_goals
from shockrig.analysis.design.menu import PlannedShock
from shockrig.analysis.plan.decide import decide, of_decision, with_due
from shockrig.analysis.plan.decision import log_entry, remembered
from shockrig.protocols.adaptive import Loop
from shockrig.protocols.background import Background
from shockrig.rig.bench import virtual_bench
from shockrig.rig.virtual.truth import Hidden, TrueNoise

HEATED = replace(QUIET, temperature_noise=TrueNoise(0.015), effects=(Hidden("self_heating", {"rise_k_at_5_m_s": 0.2}),))
COOL, WARM = PlannedShock(40.0, 17.0, 20.0, 55.0, dwell_s=20.0), PlannedShock(20.0, 55.0, 40.0, 17.0, dwell_s=20.0)
GOALS = parse_goals("alpha 0.01 %, ties decided, minutes 60")


@pytest.fixture(scope="module")
def left(tmp_path_factory):
    """Nine runs of a bead that heats itself; the decision after the eighth, its diagnosis left for later."""
    bench = benchmark("loop_bench").FileBench(HEATED, tmp_path_factory.mktemp("later") / "c", 0)
    decision = None
    for shock in (*(COOL, WARM) * 4, COOL):
        if bench.runs == 8:
            decision = decide(bench.seen(), GOALS, later=True)
        bench.record_run(shock.as_run())
        (bench.folder / "runs" / f"{bench.runs:04d}" / "hyt.csv").unlink()
    return bench, decision


def test_a_diagnosis_that_is_due_is_said_and_not_made(left):
    _, decision = left
    verdict = decision.verdicts["temperature"]
    assert decision.status == "continue" and verdict.due and not verdict.runs and not verdict.causes
    entry = json.loads(json.dumps(log_entry(decision, GOALS, None, [], 1.5)))
    assert entry["waited_s"] == 1.5 and entry["verdicts"]["temperature"]["due"]
    assert remembered(entry).verdicts["temperature"] == verdict


def test_another_process_says_the_same_about_the_runs_of_then(left):
    """Whoever makes it, and however many runs there are by then."""
    bench, decision = left
    then, campaign = decision.recorded, bench.campaign()
    here = with_due([campaign], decision).verdicts["temperature"]
    assert here.runs == 8 and not here.due and "self_heating" in here.causes
    beside = Background()
    beside.begin([of_decision(campaign, decision)], {"temperature": decision.verdicts["temperature"]})
    assert beside("temperature") == here
    assert with_due([campaign], decision, beside).verdicts["temperature"] == here
    beside.close()
    assert beside("temperature") is None  # what is asked then is diagnosed by whoever asks
    assert here.dispute is None or here.dispute.runs == then


def test_a_process_that_comes_to_nothing_is_no_harm(left):
    bench, decision = left
    beside = Background()
    beside.begin([of_decision(bench.campaign(), decision)], {"temperature": decision.verdicts["temperature"]})
    beside._process.kill()
    assert beside("temperature") is None


def test_a_loop_in_real_time_begins_with_what_is_due_and_waits_by_the_benchs_clock(left, tmp_path):
    """Where the clock is virtual nothing is left for later."""
    asked = []

    class Beside:
        def begin(self, campaigns, due):
            asked.append((len(campaigns[0].runs), dict(due)))

        def __call__(self, name):
            bench.clock.sleep_until(bench.clock.now() + 7.0)
            return with_due([left[0].campaign()], left[1]).verdicts[name]

        def close(self):
            pass

    files, decision = left
    path = tmp_path / "c"
    path.mkdir()
    (path / "runs").symlink_to(files.folder / "runs")
    head = json.loads((files.folder / "campaign.json").read_text())
    runs = [f"{i + 1:04d}" for i in range(files.runs)]
    (path / "campaign.json").write_text(json.dumps(head | {"plan": [{"id": id_} for id_ in runs]}))
    entry = log_entry(decision, GOALS, None, [])
    (path / "decisions.jsonl").write_text(json.dumps(entry) + "\n")
    bench = virtual_bench(QUIET)
    loop = Loop(path, GOALS, bench, lambda line: None)
    assert not loop._later
    loop._later, loop._background = True, Beside()
    assert loop(None, 0.0) is not None and loop.waited_s == pytest.approx(7.0)
    assert loop.decision.verdicts["temperature"].runs >= 8
    last = json.loads((path / "decisions.jsonl").read_text().splitlines()[-1])
    assert last["waited_s"] == pytest.approx(7.0)
    assert [count for count, _ in asked] == ([9] if last["verdicts"]["temperature"]["due"] else [])
