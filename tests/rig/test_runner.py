"""What must hold of a recorded campaign, whatever happens on the bench."""

import errno
import json
import math
from pathlib import Path

import pytest
from fake_bench import STEPS, TAU_S, between, csv, fake_bench, plan, run, run_json

import shockrig.rig.journal
from shockrig.rig.bench_errors import BenchError, BusError, CampaignPaused, StageError
from shockrig.rig.observer import SilentObserver
from shockrig.rig.planning import check_plan
from shockrig.rig.protocol import Faults, PlannedRun, Protocol, Record, Soak, Transfer
from shockrig.rig.recorder import RecordingError, read_state
from shockrig.rig.seams import Air, Outcome


def test_a_recorded_step_is_the_step_that_the_sensor_saw(tmp_path):
    """First-order sensors: the reading after the transfer is exactly 1 - exp(-t / tau), on the files' own clock."""
    path = tmp_path / "campaign"
    assert run(fake_bench(), path) == ["0001", "0002"]
    head = run_json(path)
    assert head["source"] == {"temperature_c": 20.0, "humidity_percent": 20.0}
    assert head["destination"] == {"temperature_c": 30.0, "humidity_percent": 70.0}
    assert head["airflow_m_s"] == 6.0 and head["pressure_hpa"] == 950.0
    assert head["transfer"]["duration_s"] == pytest.approx(0.35)
    start_s = head["transfer"]["start_s"]
    assert 5.0 <= start_s <= 6.0
    for name, column, low, high in (("imet", "temperature_c", 20, 30), ("hyt", "humidity_percent", 20, 70)):
        table = csv(path / "runs" / "0001" / f"{name}.csv")
        assert 0.0 <= table["time_s"][0] < 0.1 and table["time_s"][-1] > 24.9
        assert all(b > a for a, b in zip(table["time_s"], table["time_s"][1:], strict=False))
        for time_s, value in zip(table["time_s"], table[column], strict=True):
            expected = low + (high - low) * (1 - math.exp(-max(time_s - start_s, 0.0) / TAU_S[name]))
            assert value == pytest.approx(expected, abs=0.12 if time_s < start_s else 2e-2 * (high - low) / 10)
    assert set(csv(path / "runs/0001/hyt.csv")) == {"time_s", "humidity_percent", "temperature_c", "stale"}
    assert set(csv(path / "runs/0001/imet.csv")) == {"time_s", "temperature_c"}


def test_transfers_fall_on_all_phases_of_the_sampling(tmp_path):
    """Ten runs at 10 Hz: each fifth of the sampling period sees a transfer, so that fast transients are covered."""
    path = tmp_path / "campaign"
    run(fake_bench(), path, plan(10, (Soak(over_s=2.0), Record(2.0), Transfer(5.0), Record(2.0))))
    phases = []
    for id_ in read_state(path).recorded:
        times_s = csv(path / "runs" / id_ / "imet.csv")["time_s"]
        start_s = run_json(path, id_)["transfer"]["start_s"]
        phases.append(min(t - start_s for t in times_s if t >= start_s) / 0.1)
    assert {min(int(phase * 5), 4) for phase in phases} == {0, 1, 2, 3, 4}


def test_the_probes_have_settled_before_the_transfer(tmp_path):
    """The soak waits for the slow sensor (tau 4 s, from 50 or 70 %RH to 20 or 70) and not only for the reference."""
    path = tmp_path / "campaign"
    run(fake_bench(), path, plan(4))
    for id_ in ("0001", "0002", "0003", "0004"):
        table = csv(path / "runs" / id_ / "hyt.csv")
        head = run_json(path, id_)
        assert abs(table["humidity_percent"][0] - head["source"]["humidity_percent"]) < 0.15


def test_a_sensor_that_never_settles_spoils_the_run(tmp_path):
    path = tmp_path / "campaign"
    steps = (Soak(over_s=6.0, at_most_s=8.0), *STEPS[1:])
    with pytest.raises(CampaignPaused, match="hyt still moves by .* %RH"):
        run(fake_bench(), path, plan(1, steps, Faults(repeat_at_most=0)))


@pytest.mark.parametrize("outcome", [Outcome.NOT_ACKNOWLEDGED, Outcome.IMPLAUSIBLE, Outcome.COMMAND_MODE, "silent"])
def test_a_run_spoilt_by_a_fault_is_kept_marked_and_repeated(tmp_path, outcome):
    path, bench = tmp_path / "campaign", fake_bench(hyt_fault=between(60.0, 63.0, outcome))
    assert run(bench, path) == ["0001", "0002"]
    (aside,) = read_state(path).set_aside
    assert aside.status == "spoilt" and "hyt gave no good reading for 3." in aside.reason
    kept = csv(aside.folder / "hyt.csv")
    assert len(kept["time_s"]) > 100  # what was good of it is there
    gaps = [b - a for a, b in zip(kept["time_s"], kept["time_s"][1:], strict=False)]
    assert 3.0 <= max(gaps) < 3.3  # and nothing was invented for the rest
    assert (path / "runs" / aside.id / "run.json").exists()


def test_missing_samples_do_not_spoil_a_run(tmp_path):
    """A lost reading in fifty is an ordinary bench."""
    path = tmp_path / "campaign"
    lost = fake_bench(hyt_fault=lambda now: Outcome.TIMED_OUT if round(now * 10) % 50 == 0 else None)
    run(lost, path)
    assert not read_state(path).set_aside
    assert run_json(path)["outcomes"]["hyt"]["timed_out"] > 5


def test_the_campaign_pauses_where_repeating_does_not_help_and_goes_on_later(tmp_path):
    path = tmp_path / "campaign"
    often = fake_bench(hyt_fault=lambda now: Outcome.STALE if int(now) % 3 == 0 else None)
    with pytest.raises(CampaignPaused, match=r"run 0001 was spoilt 2 times.*run the same command again"):
        run(often, path, plan(faults=Faults(repeat_at_most=1)))
    assert often.stage.log[-1] == "safe"
    assert [aside.id for aside in read_state(path).set_aside] == ["0001", "0001"]
    assert run(fake_bench(), path, plan(faults=Faults(repeat_at_most=1))) == ["0001", "0002"]


def test_stage_alarm_makes_the_bench_safe_and_the_run_is_repeated(tmp_path):
    path = tmp_path / "campaign"
    alarms = [StageError("ALARM:1 hard limit")]
    bench = fake_bench(stage_fault=lambda now: alarms.pop() if alarms else None)
    assert run(bench, path) == ["0001", "0002"]
    log = bench.stage.log
    assert log[log.index("begin") + 1] == "safe"
    (aside,) = read_state(path).set_aside
    assert "ALARM:1" in aside.reason and "transfer" not in json.loads((aside.folder / "run.json").read_text())


@pytest.mark.parametrize("during_s", [20.0, 36.0, 40.0])
def test_ctrl_c_makes_the_bench_safe_first_and_keeps_the_transient(tmp_path, during_s):
    path = tmp_path / "campaign"
    bench = fake_bench(imet_fault=between(during_s, during_s + 0.09, KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        run(bench, path)
    assert bench.stage.log[-1] == "safe"
    state = read_state(path)
    assert state.recorded == () and state.in_progress == ()
    (aside,) = state.set_aside
    assert aside.status == "interrupted" and aside.reason == "stopped by the operator"
    assert run(fake_bench(), path) == ["0001", "0002"]


def test_an_unplugged_sensor_pauses_before_anything_moves_again(tmp_path):
    path = tmp_path / "campaign"
    bench = fake_bench(hyt_fault=between(60.0, 1e9, Outcome.NOT_ACKNOWLEDGED))
    with pytest.raises(BusError, match="hyt: no good reading in 10 s .100 times not acknowledged"):
        run(bench, path)
    assert bench.stage.log.count("prepare") == len(read_state(path).recorded) + 1


def test_nothing_moves_when_an_instrument_is_missing(tmp_path):
    bench = fake_bench(hyt_fault=lambda now: Outcome.NOT_ACKNOWLEDGED)
    with pytest.raises(BusError, match="hyt"):
        run(bench, tmp_path / "campaign")
    assert "prepare" not in bench.stage.log and "begin" not in bench.stage.log


def test_faults_of_all_instruments_are_said_at_once(tmp_path):
    bench = fake_bench()
    for part, text in ((bench.sensors[0], "no such port"), (bench.stage, "not a GRBL controller")):
        part.open = lambda text=text: (_ for _ in ()).throw(OSError(errno.ENODEV, text))
    with pytest.raises(BusError, match="imet: .*no such port.*stage: .*not a GRBL controller"):
        run(bench, tmp_path / "campaign")


def test_a_full_disk_keeps_what_was_recorded_and_the_campaign_goes_on_later(tmp_path, monkeypatch):
    import os

    path, left, write = tmp_path / "campaign", [40_000], os.write

    def nearly_full(file, data):
        taken = min(len(data), left[0])
        left[0] -= taken
        if not taken:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, data[:taken])

    monkeypatch.setattr(shockrig.rig.journal.os, "write", nearly_full)
    bench = fake_bench()
    with pytest.raises(RecordingError, match="the disk is full.*run the same command again"):
        run(bench, path)
    assert bench.stage.log[-1] == "safe"
    (left_over,) = read_state(path).in_progress
    size = (path / "recording" / left_over / "journal.log").stat().st_size
    assert size == 40_000
    monkeypatch.undo()
    said = []
    observer = SilentObserver()
    observer.say = said.append
    assert run(fake_bench(), path, observer=observer) == ["0001", "0002"]
    assert "run 0001 was interrupted (the recording was cut off)" in said[0]
    (aside,) = read_state(path).set_aside
    assert "torn last record" in json.loads((aside.folder / "run.json").read_text())["damage"]


def test_a_finished_campaign_is_left_alone(tmp_path):
    path = tmp_path / "campaign"
    run(fake_bench(), path)
    bench = fake_bench()
    assert run(bench, path) == []
    assert bench.stage.log == []


def test_a_campaign_is_never_mixed_with_another_plan_or_other_sensors(tmp_path):
    path = tmp_path / "campaign"
    run(fake_bench(), path)
    with pytest.raises(BenchError, match="another plan"):
        run(fake_bench(), path, plan(2, (STEPS[0], Record(6.0), *STEPS[2:])))
    with pytest.raises(BenchError, match="other sensors"):
        run(fake_bench(sensors=("hyt",)), path)
    assert run(fake_bench(), path, plan(3)) == ["0003"]  # a longer plan goes on


@pytest.mark.parametrize("put", [Path.touch, lambda path: path.mkdir() or (path / "hyt.csv").touch()])
def test_what_stands_in_the_place_of_a_planned_run_is_said_before_anything_is_recorded(tmp_path, put):
    campaign = tmp_path / "campaign"
    run(fake_bench(), campaign, plan(1))
    put(campaign / "runs" / "0002")
    with pytest.raises(BenchError, match="runs/0002: is no run, and stands in the place of one of the plan; move it"):
        run(fake_bench(), campaign, plan(2))
    assert not list(campaign.glob("recording/*"))


def test_a_folder_that_is_something_else_is_not_touched(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(BenchError, match="neither empty nor a campaign"):
        run(fake_bench(), tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_two_recordings_cannot_share_a_folder(tmp_path):
    path = tmp_path / "campaign"

    class Second(SilentObserver):
        def run_began(self, *_):
            with pytest.raises(BenchError, match="another recording"):
                run(fake_bench(), path)

    assert run(fake_bench(), path, observer=Second()) == ["0001", "0002"]


def test_one_sensor_alone_can_be_recorded(tmp_path):
    path = tmp_path / "campaign"
    run(fake_bench(sensors=("hyt",)), path)
    assert not (path / "runs/0001/imet.csv").exists() and (path / "runs/0001/hyt.csv").exists()


def test_plan_warns_of_condensation():
    """20 degC at 80 %RH has its dew point at 16.4 degC (Magnus): probes from 10 degC get wet, from 18 degC do not."""
    wet = PlannedRun("0001", Air(10.0, 50.0), Air(20.0, 80.0), 6.0, STEPS)
    dry = PlannedRun("0002", Air(18.0, 50.0), Air(20.0, 80.0), 6.0, STEPS)
    (warning,) = check_plan(Protocol("p", "", (wet, dry)), fake_bench())
    assert "run 0001" in warning and "16.4 degC" in warning


def test_plan_needs_room_on_the_disk():
    with pytest.raises(BenchError, match="the disk has 0 MB free"):
        check_plan(plan(), fake_bench(), free_bytes=100_000)
