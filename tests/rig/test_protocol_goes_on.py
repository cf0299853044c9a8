"""Protocols that slow a transfer, go on with a campaign, and are written as they are read."""

import json
from dataclasses import replace

import pytest
from fake_bench import STEPS, fake_bench, plan, run, run_json

from shockrig.rig.bench import virtual_bench
from shockrig.rig.bench_errors import BenchError, RunSkipped
from shockrig.rig.clock import VirtualClock
from shockrig.rig.planning import check_plan
from shockrig.rig.protocol import PlannedRun, Protocol, load_protocol, parse_protocol, shipped_protocols
from shockrig.rig.protocol_text import protocol_text
from shockrig.rig.recorder import read_state
from shockrig.rig.runner import record_campaign
from shockrig.rig.seams import Air
from shockrig.rig.stages.manual import ManualSettings, ManualStage
from shockrig.rig.virtual.plans import plan_from_protocol
from shockrig.rig.virtual.truth import Truth

HEAD = 'format = "shock-protocol/1"\nsteps.usual = [{do="soak"}, {do="record", for_s=5}, {do="transfer"}, '
RUN = '{do="record", for_s=9}]\n[[run]]\nsource = {}\ndestination = {}\n'


def slow(duration_s, number=1):
    airs = Air(20.0, 55.0), Air(40.0, 18.0)
    return Protocol("slow", "", (PlannedRun(f"{number:04d}", *airs, 6.0, STEPS, "", duration_s),))


def test_every_shipped_protocol_is_written_as_it_is_read():
    for name in shipped_protocols():
        protocol = load_protocol(name)
        assert parse_protocol(protocol_text(protocol).encode(), "again.toml") == protocol


def test_a_note_with_quotes_and_an_unknown_air_survive():
    steps = load_protocol("quick").runs[0].steps
    odd = PlannedRun("0013", Air(None, None), Air(20.0, None), None, steps, 'said "why"\\\n\tdé', 2.5)
    protocol = Protocol("n", "d", (odd,), by_hand=True, continues=12)
    assert parse_protocol(protocol_text(protocol).encode(), "again.toml") == protocol


def test_a_slowed_transfer_takes_as_long_as_the_protocol_wants(tmp_path):
    """On the emulated stage: the carriage, the air at the probes, and run.json all have 2 s."""
    truth = Truth(7.5e-8, 1e-11)
    with virtual_bench(truth) as bench:
        assert check_plan(slow(2.0), bench) == []
        run(bench, tmp_path / "c", slow(2.0))
    head = run_json(tmp_path / "c")
    assert head["transfer"]["duration_s"] == pytest.approx(2.0, abs=0.03)
    rows = (tmp_path / "c" / "runs" / "0001" / "imet.csv").read_text().splitlines()[1:]
    # half of a linear ramp lies a second after its start; a bead with a lag of 0.2 s follows some tenths behind
    half_s = next(t for t, v in (map(float, row.split(",")) for row in rows) if v > 30.0)
    assert half_s - head["transfer"]["start_s"] == pytest.approx(1.3, abs=0.2)
    entry = json.loads((tmp_path / "c" / "campaign.json").read_text())["plan"][0]
    assert entry["transfer"] == {"duration_s": 2.0}


def test_a_slowed_transfer_reaches_the_simulation_of_a_whole_campaign():
    assert plan_from_protocol(slow(2.0))[0].transfer_duration_s == 2.0


def test_stages_that_cannot_go_so_slowly_or_fast_refuse_in_one_sentence():
    with virtual_bench(Truth(7.5e-8, 1e-11)) as bench:
        with pytest.raises(
            BenchError, match=r"run 0001: transfer.duration_s is 0.001 and the stage takes .* give more"
        ):
            check_plan(slow(0.001), bench)
        clock = VirtualClock()
        hand = ManualStage(ManualSettings(), clock, bench.operator, bench.chambers)
        with pytest.raises(BenchError, match="run 0001: .*motorised stage"):
            check_plan(slow(2.0), replace(bench, stage=hand))


@pytest.mark.parametrize(
    ("added", "said"),
    [
        ("transfer = { duration_s = 30 }", "the step allows 20 s; raise its at_most_s"),
        ("transfer = { duration_s = 0 }", "expected more than 0"),
        ("transfer = { seconds = 2 }", "unknown key 'seconds'"),
        ("transfer = 2", "expected a table"),
    ],
)
def test_what_a_transfer_cannot_be(added, said):
    with pytest.raises(BenchError, match=said):
        parse_protocol((HEAD + RUN + added).encode(), "p.toml")


@pytest.mark.parametrize("wrong", ["-1", "true", '"12"', "1.5"])
def test_what_a_protocol_cannot_continue(wrong):
    with pytest.raises(BenchError, match="continues is .* expected the number of runs"):
        parse_protocol(f"continues = {wrong}\n{HEAD}{RUN}".encode(), "p.toml")


def further(count, continues):
    runs = plan(count).runs[::-1]
    numbered = tuple(replace(r, id=f"{continues + i:04d}") for i, r in enumerate(runs, 1))
    return Protocol("more", "", numbered, continues=continues)


def test_another_protocol_goes_on_with_a_campaign(tmp_path):
    path = tmp_path / "c"
    assert run(fake_bench(), path) == ["0001", "0002"]
    assert run(fake_bench(), path, further(2, 2)) == ["0003", "0004"]
    state = read_state(path)
    assert state.recorded == state.planned == ("0001", "0002", "0003", "0004")
    # Neither protocol has anything left to do, and neither undoes what the other planned.
    assert run(fake_bench(), path, further(2, 2)) == run(fake_bench(), path) == []
    assert read_state(path).planned == state.planned


def test_a_protocol_that_goes_on_needs_the_campaign_that_it_goes_on_with(tmp_path):
    with pytest.raises(BenchError, match="goes on after 2 runs of one; give that campaign's folder"):
        run(fake_bench(), tmp_path / "none", further(1, 2))
    assert not (tmp_path / "none").exists()
    run(fake_bench(), tmp_path / "c")
    with pytest.raises(BenchError, match="another plan of 2 runs; the one given goes on after 3"):
        run(fake_bench(), tmp_path / "c", further(1, 3))
    run(fake_bench(), tmp_path / "c", further(1, 2))
    with pytest.raises(BenchError, match="another plan of 3 runs"):
        run(fake_bench(), tmp_path / "c", replace(further(1, 2), runs=(replace(further(1, 2).runs[0], note="x"),)))


def test_a_plan_can_grow_run_by_run_and_what_is_skipped_is_told(tmp_path):
    """`more` is asked after each run; a run that the operator leaves out is handed to it."""
    asked = []
    whole = plan(4)

    def more(left_out, now_s):
        asked.append((left_out, read_state(tmp_path / "c").recorded))
        return replace(whole, runs=whole.runs[: len(asked)]) if len(asked) < 4 else None

    bench = fake_bench()
    prepare = bench.stage.prepare

    def skip_the_second(*airs):
        prepare(*airs)
        if len(asked) == 2:
            raise RunSkipped("skipped by the operator")

    bench.stage.prepare = skip_the_second
    none = replace(whole, runs=())
    recorded = record_campaign(
        bench, none, tmp_path / "c", utc=lambda: "2026-05-01T00:00:00Z", sync_every_s=None, more=more
    )
    # what was left out is still of the plan, and is recorded with the next that `more` gives
    assert asked[:3] == [(None, ()), (None, ("0001",)), ("0002", ("0001",))]
    assert recorded == ["0001", "0002", "0003"]
    assert read_state(tmp_path / "c").planned == ("0001", "0002", "0003")
