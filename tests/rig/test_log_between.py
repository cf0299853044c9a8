"""What must hold of changes that are no steps: a run ends before one that is large beside its step."""

import json
import re

import numpy as np
import pytest
from made_up_logs import lag, two_lags, written

from shockrig.protocols.cli import main

STEP_S, DOOR_S = 200.0, 700.0
ALONE = '[sensor.probe]\ntemperature = "temp"\n'


def smoker(door_k, stays_open=False):
    """A probe put into a smoker of 150 degC, whose door is opened after 500 s and shut 35 s later, or not."""
    time_s = np.arange(0.0, 1800.0, 2.0)
    air = np.where(time_s < STEP_S, 25.0, 150.0)
    shut_s = np.maximum(time_s - DOOR_S - 35.0, 0.0) * (not stays_open)
    air = air - door_k * lag(time_s - DOOR_S, 15.0) * np.exp(-shut_s / 80.0)
    probe = np.full(time_s.size, 25.0)
    for k in range(1, time_s.size):
        probe[k] = probe[k - 1] + (1.0 - np.exp(-2.0 / 30.0)) * (air[k] - probe[k - 1])
    return time_s, air, probe + np.random.default_rng(1).normal(0.0, 0.1, time_s.size)


def table(header, *columns):
    return "\n".join([header, *(",".join(f"{v:.2f}" for v in row) for row in zip(*columns, strict=True)), ""])


def imported(tmp_path, log, map_text):
    """When each run ends, on the log's clock."""
    map_ = written(tmp_path / "map.toml", map_text)
    assert main(["import", str(log), "--map", str(map_), "--out", str(tmp_path / "c")]) == 0
    ends = []
    for folder in sorted((tmp_path / "c" / "runs").iterdir()):
        head = json.loads((folder / "run.json").read_text())
        last_s = float((folder / "imet.csv").read_text().splitlines()[-1].split(",")[0])
        ends.append(float(head["imported"]["at"]) + last_s - head["step_seen_s"])
    return ends


@pytest.mark.parametrize("stays_open", [False, True])
def test_a_run_ends_before_a_door_that_is_opened(tmp_path, stays_open):
    """One that is shut again comes back and makes no step; one that stays open is a step, which the map does not list.
    Neither is the answer to the first."""
    time_s, _, probe = smoker(60.0, stays_open)
    log = written(tmp_path / "log.csv", table("time_s,temp", time_s, probe))
    listed = f"[[step]]\nat = {STEP_S}\nuncertainty_s = 2.0\n" if stays_open else ""
    (end_s,) = imported(tmp_path, log, ALONE + listed)
    assert DOOR_S - 60.0 < end_s <= DOOR_S + 4.0


def test_a_small_change_stays_in_its_run(tmp_path):
    """A tenth of the step: rooms and boxes do as much by themselves."""
    time_s, _, probe = smoker(12.0)
    log = written(tmp_path / "log.csv", table("time_s,temp", time_s, probe))
    (end_s,) = imported(tmp_path, log, ALONE)
    assert end_s > DOOR_S + 50.0


def test_a_run_beside_a_measured_air_holds_what_the_air_did(tmp_path):
    time_s, air, probe = smoker(60.0)
    log = written(tmp_path / "log.csv", table("time_s,air_temp,probe_temp", time_s, air, probe))
    beside = '[sensor.air]\ntemperature = "air_temp"\n[sensor.probe]\ntemperature = "probe_temp"\nreference = "air"\n'
    (end_s,) = imported(tmp_path, log, beside + f"[[step]]\nat = {STEP_S}\nuncertainty_s = 1.0\n")
    assert end_s > DOOR_S + 50.0


@pytest.mark.parametrize(("pause_s", "t63_s"), [(50.0, 80.0), (60.0, 40.0), (90.0, 80.0)])
def test_the_first_look_says_what_the_import_leaves_out(tmp_path, capsys, pause_s, t63_s):
    """A door that is opened and shut while a fire is lit: what either leaves of the other's run decides in both."""
    time_s = np.arange(0.0, 1500.0, 5.0)
    value = 150.0 - 27.0 * lag(time_s - 600.0, 12.0) + 40.0 * two_lags(time_s - 600.0 - pause_s, t63_s)
    value += np.random.default_rng(0).normal(0.0, 0.1, time_s.size)
    log = written(tmp_path / "log.csv", table("time_s,temp", time_s, value))
    assert main(["import", str(log), "--look", "--out", str(tmp_path)]) == 0
    look = re.findall(r"^ +(\d+)  \d.* s(  not used|)", capsys.readouterr().out, re.MULTILINE)
    made = main(["import", str(log), "--map", str(tmp_path / "log.toml"), "--out", str(tmp_path / "c")]) == 0
    runs = re.findall(r"log.csv step (\d+): [\d.]+ s before", capsys.readouterr().out)
    assert runs == [number for number, out in look if not out] and made == bool(runs)
