"""The closed loop: `run adaptive` on the virtual bench, killed and gone on with, vetoed, and `plan` file by file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from benchmark_scripts import benchmark
from small_worlds import QUIET

from shockrig.analysis.design.goals import parse_goals
from shockrig.analysis.design.menu import PlannedShock
from shockrig.analysis.plan.decision import remembered
from shockrig.analysis.report.loop_page import chosen_section
from shockrig.files.plan_file import read_decisions
from shockrig.protocols.adaptive import Loop
from shockrig.protocols.cli import main
from shockrig.protocols.decided import as_protocol
from shockrig.rig.bench import virtual_bench
from shockrig.rig.bench_errors import BenchError, RunSkipped
from shockrig.rig.observer import SilentObserver
from shockrig.rig.protocol import Soak, load_protocol
from shockrig.rig.recorder import read_state
from shockrig.rig.runner import record_campaign
from shockrig.rig.virtual.truth import Truth

QUICK_SENSORS = Truth(7.5e-8, 2e-11)
GOALS = "D 0.9 % at 20, minutes 30"


class KilledAt(SilentObserver):
    """Looks on until a run begins, and ends the process there."""

    def __init__(self, id_):
        self.id_ = id_

    def run_began(self, run, number, total, now_s):
        if run.id == self.id_:
            raise KeyboardInterrupt


def go_on(path, observer=None, **settings):
    """One process of the loop; what it said."""
    said = []
    bench = virtual_bench(QUICK_SENSORS, seed=3)
    loop = Loop(path, parse_goals(GOALS), bench, said.append, **settings)
    planned = len(json.loads((path / "campaign.json").read_text())["plan"]) if path.exists() else 0
    with bench:
        record_campaign(
            bench,
            as_protocol([], planned, "adaptive", GOALS),
            path,
            utc=lambda: f"2026-05-01T00:{int(bench.clock.now() // 60):02d}:{bench.clock.now() % 60:06.3f}Z",
            observer=observer,
            sync_every_s=None,
            more=loop,
        )
    return said


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """A campaign whose process was killed as its second run began, and gone on with."""
    path = tmp_path_factory.mktemp("loop") / "c"
    with pytest.raises(KeyboardInterrupt):
        go_on(path, KilledAt("0002"))
    before = read_decisions(path)
    cut = (path / "decisions.jsonl").read_text().splitlines(keepends=True)
    return path, before, cut, go_on(path)


def test_a_killed_campaign_goes_on_with_the_same_decision(killed):
    path, before, _, said = killed
    assert [entry["recorded"] for entry in before] == [[], ["0001"]]
    assert said[0].startswith("going on with the decision before")
    log = read_decisions(path)
    assert log[:2] == before and log[-1]["status"] == "done" and log[-1]["number"] == len(log)
    state = read_state(path)
    assert state.recorded == state.planned == tuple(log[-1]["recorded"])
    run = json.loads((path / "runs" / "0002" / "run.json").read_text())
    assert run["planned"]["source"] == before[1]["runs"][0]["source"]


def test_reports_show_how_runs_were_chosen(killed, tmp_path, capsys):
    """The section's plots lie beside the others; a campaign without decisions has no such section."""
    path, *_ = killed
    assert main(["characterize", str(path), "--out", str(tmp_path / "k")]) == 0
    assert {"loop_precision.png", "loop_realised.png"} <= {file.name for file in (tmp_path / "k").iterdir()}
    page = (tmp_path / "k" / "report.html").read_text()
    assert "How its runs were chosen" in page and f"{len(read_decisions(path))} decisions over" in page
    assert chosen_section([], tmp_path) == []


def test_without_its_log_the_same_files_give_the_same_decision(killed, tmp_path):
    """Killed before the decision was written: it is taken again, and is the same."""
    from shockrig.analysis.plan.decide import decide
    from shockrig.analysis.plan.decision import log_entry, remembered
    from shockrig.files.campaign import read_campaign

    path, before, _, _ = killed
    campaign = read_campaign(path)
    first = [run for run in campaign.runs if run.id == "0001"]
    from dataclasses import replace

    goals = parse_goals(GOALS)
    again = decide([replace(campaign, runs=tuple(first))], goals, remembered(before[0]))
    entry = json.loads(json.dumps(log_entry(again, goals, before[0], [])))
    assert entry == before[1]


def test_the_operator_vetoes_a_choice_and_another_is_made(tmp_path):
    class Person:
        def __init__(self):
            self.asked = []

        def __getattr__(self, name):
            return lambda *a: None

        def ask(self, message, check=None):
            self.asked.append(message)
            if len(self.asked) == 1:
                raise RunSkipped("skipped by the operator")
            return ""

    bench = virtual_bench(QUICK_SENSORS)
    bench.operator = Person()
    path = tmp_path / "c"
    path.mkdir()
    document = {"format": "shock-campaign/1", "name": "c", "sensors": {}, "plan": []}
    (path / "campaign.json").write_text(json.dumps(document))
    protocol = Loop(path, parse_goals(GOALS), bench, lambda line: None, confirm=True)(None, 0.0)
    first, second = read_decisions(path)
    assert second["vetoed"] == [{k: v for k, v in first["runs"][0].items() if not k.startswith("expected")}]
    assert second["runs"][0]["destination"] != first["runs"][0]["destination"]
    assert protocol.runs[0].id == "0001"
    assert protocol.runs[0].destination.humidity_percent == second["runs"][0]["destination"]["humidity_percent"]


def test_runs_of_the_operators_own_come_first(tmp_path):
    path = tmp_path / "c"
    path.mkdir()
    document = {"format": "shock-campaign/1", "name": "c", "sensors": {}, "plan": []}
    (path / "campaign.json").write_text(json.dumps(document))
    own = load_protocol("quick").runs
    loop = Loop(path, parse_goals(GOALS), virtual_bench(QUICK_SENSORS), lambda line: None, added=own)
    assert loop(None, 0.0).runs[0].source == own[0].source
    assert not read_decisions(path)


def test_runs_of_the_operators_own_are_recorded_once_though_the_process_was_killed(tmp_path):
    path, own = tmp_path / "c", [replace(run, note="mine") for run in load_protocol("quick").runs[:2]]
    for there in ("0002", "0003"):
        with pytest.raises(KeyboardInterrupt):
            go_on(path, KilledAt(there), added=own)
    notes = [entry["note"] for entry in json.loads((path / "campaign.json").read_text())["plan"]]
    assert notes[:2] == ["mine", "mine"] and "mine" not in notes[2:]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "adaptive", "--out", "c"], "--until is missing: what shall be reached?"),
        (["run", "quick", "--out", "c", "--until", "alpha 1 %"], "--until is for shockrig run adaptive"),
        (["run", "quick", "--out", "c", "--probe", "2"], "--probe is for shockrig run adaptive"),
        (["run", "adaptive", "--out", "c", "--until", "beta 1 %"], "'beta 1 %' is no goal"),
        (["run", "adaptive", "--until", "alpha 1 %"], "--out CAMPAIGN is missing"),
        (["plan", "c", "--until", "alpha 1 %", "--out", "next.txt"], "a protocol's name ends in .toml"),
        (["plan", "c", "--until", "alpha 1 %", "--out", "n.toml", "--runs", "0"], "--runs 0: expected 1 to 100"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_file_by_file_from_an_empty_folder_until_it_is_done(tmp_path, monkeypatch, capsys):
    """`plan`, runs recorded by what takes protocols, `plan` again; the same command to the end."""
    monkeypatch.chdir(tmp_path)
    asked = ["plan", "c", "--until", "D 0.9 % at 20", "--out", "next.toml", "--runs", "1"]
    for _ in range(6):
        assert main(asked) == 0
        plan = json.loads(Path("next.json").read_text())
        if plan["status"] != "continue":
            break
        protocol = load_protocol("next.toml")
        assert protocol.continues == (len(read_state(Path("c")).recorded) if Path("c").exists() else 0)
        assert isinstance(protocol.runs[0].steps[0], Soak)
        assert (
            main(
                ["run", "next.toml", "--out", "c", "--seed", "3"]
                if not Path("c").exists()
                else ["run", "next.toml", "--out", "c"]
            )
            == 0
        )
    assert plan["status"] == "done" and not Path("next.toml").exists()
    assert "done: all goals are met" in capsys.readouterr().out
    assert "<svg" in (page := Path("c/decisions.html").read_text()) or "data:image/png" in page
    assert [len(e["recorded"]) for e in read_decisions(Path("c"))] == sorted(
        len(e["recorded"]) for e in read_decisions(Path("c"))
    )


@pytest.fixture
def two_probes(tmp_path, monkeypatch):
    """A campaign of two films, of which only the second one has recorded anything: two runs by which D is known."""
    monkeypatch.chdir(tmp_path)
    bench = benchmark("loop_bench").FileBench(QUIET, tmp_path / "c", 0)
    for shock in (
        PlannedShock(20.0, 20.0, 20.0, 80.0, dwell_s=30.0),
        PlannedShock(20.0, 80.0, 20.0, 20.0, dwell_s=30.0),
    ):
        bench.record_run(shock.as_run())
        run = bench.folder / "runs" / f"{bench.runs:04d}"
        (run / "hyt.csv").rename(run / "hyt-2.csv")
    head = json.loads(Path("c/campaign.json").read_text())
    sensors = head["sensors"] | {"hyt-2": head["sensors"]["hyt"]}
    Path("c/campaign.json").write_text(json.dumps(head | {"sensors": sensors}))
    return ["plan", "c", "--until", "D 0.9 % at 20", "--out", "next.toml"]


def test_several_probes_decide_together(two_probes, capsys):
    """The second one knows D well enough; the first one does not, so it goes on."""
    assert main(two_probes) == 0
    (entry,) = read_decisions(Path("c"))
    assert entry["probes"] == ["1", "2"] and entry["status"] == "continue"
    goals = {goal["goal"]: goal["met"] for goal in entry["goals"]}
    assert goals == {"D at 20 degC 0.9 %": False, "probe 2: D at 20 degC 0.9 %": True}
    assert set(entry["verdicts"]) == {"temperature", "humidity", "humidity-2"}  # the second one has no bead
    assert remembered(entry).verdicts.keys() == entry["verdicts"].keys()


def test_one_of_several_probes_may_decide_and_its_log_stays_its_own(two_probes, capsys):
    assert main([*two_probes, "--probe", "2"]) == 0
    (entry,) = read_decisions(Path("c"))
    assert entry["probes"] == ["2"] and entry["status"] == "done"
    capsys.readouterr()
    assert main(two_probes) == 2
    assert "decisions.jsonl: decides by probe 2, not by probes 1 and 2; give --probe 2, or" in capsys.readouterr().err


@pytest.mark.trial
def test_through_files_alone_with_another_program_as_the_bench(tmp_path, capsys):
    """It begins with a folder that is not there, and ends with what that program made its sensors of."""
    other = benchmark("loop_by_files")

    def plan(words):
        assert main(words) == 0
        return capsys.readouterr().out

    said = other.loop(tmp_path, "alpha 1 %, D 1 % at 20, ties decided", plan, seed=3)
    assert "no run has shown it yet" in said[0] and "done: all goals are met; named: self_heating" in said[-1]
    found = json.loads((tmp_path / "campaign" / "decisions.jsonl").read_text().splitlines()[-1])
    rise = found["verdicts"]["temperature"]["causes"]["self_heating"]["rise_k_at_5_m_s"]
    assert rise == pytest.approx(other.RISE_K * ventilation(6.0) / ventilation(5.0), rel=0.1)
    assert found["verdicts"]["humidity"]["verdict"] == "adequate"
    assert not (tmp_path / "next.toml").exists()


def ventilation(airflow_m_s):
    """Ranz and Marshall 1952, for a bead of 0.8 mm in air."""
    return 2.0 + 0.6 * (airflow_m_s * 8e-4 / 1.5e-5) ** 0.5 * 0.71 ** (1 / 3)


def test_a_plan_keeps_to_what_a_bench_can_do():
    from shockrig.analysis.design.menu import PlannedShock
    from shockrig.protocols.decided import feasible_on

    bench = virtual_bench(QUICK_SENSORS)
    feasible = feasible_on(bench)
    assert feasible(PlannedShock(20.0, 20.0, 20.0, 80.0, transfer_s=2.0))
    assert not feasible(PlannedShock(20.0, 20.0, 20.0, 80.0, irradiance_w_m2=800.0))
    assert not feasible(PlannedShock(20.0, 20.0, 20.0, 80.0, transfer_s=1e-4))

    def refuses(*airs):
        raise BenchError("too cold")

    bench.chambers.demand = refuses
    assert not feasible(PlannedShock(20.0, 20.0, 20.0, 80.0))
