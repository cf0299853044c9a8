"""docs/emulated_bench.md in real time: scan, check, an unattended campaign, watched, characterized.

All as it stands there, with a shorter protocol under the name of `quick`: drivers and bytes are the same ones.
"""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, FLAGS
from processes import ended, heard, wait_for
from test_watch import Terminal

from shockrig.files.profile import read_profile
from shockrig.rig.bench_findings import REMEDIES
from shockrig.rig.recorder import read_state
from shockrig.rig.seams import Outcome
from shockrig.rig.virtual.truth import draw_truth

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "emulated_bench.md"
SHORTER = """# `quick` in half of its time: humidity first, as a soak after the thermal shock waits for the slow die.
format = "shock-protocol/1"
name = "quick"
description = "one ambient, one humidity shock and one thermal shock"
airflow_m_s = 6.0

[steps]
usual = [
  { do = "soak", over_s = 4, at_most_s = 300, reference_within_k = 0.05, reference_within_percent = 0.3, \
probes_within_k = 0.5, probes_within_percent = 0.5 },
  { do = "record", for_s = 2.5 },
  { do = "transfer", at_most_s = 20 },
  { do = "record", for_s = 8 },
]

[[run]]
note = "humidity up"
source = { temperature_c = 20, humidity_percent = 55 }
destination = { temperature_c = 20, humidity_percent = 80 }

[[run]]
note = "temperature up, vapour pressure kept"
source = { temperature_c = 20, humidity_percent = 55 }
destination = { temperature_c = 40, humidity_percent = 17 }
"""
COMMANDS = re.findall(r"^    \$ (.*)$", PAGE.read_text(), re.MULTILINE)
ATTEMPTS = 4  # of recording and looking: a machine that is busy may spoil runs, and the same command goes on
BUSY = REMEDIES[Outcome.STALE]  # what a look says of readings that come too late


class Shell:
    """The page's commands in one folder; those that go on are ended with the test."""

    def __init__(self, folder, stack):
        self.folder, self.stack, self.said = folder, stack, ""
        self.env = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}

    def begin(self, command, stdout=subprocess.PIPE):
        process = subprocess.Popen(
            ["bash", "-c", f"exec {command}"], cwd=self.folder, env=self.env, text=True, stdout=stdout, stderr=stdout
        )
        self.stack.callback(self.end, process)
        return process

    def end(self, process):
        ended(process, signal.SIGINT)

    def run(self, command):
        for _ in range(ATTEMPTS):
            done = subprocess.run(
                ["bash", "-c", command], cwd=self.folder, env=self.env, text=True, capture_output=True, timeout=300
            )
            if done.returncode == 0 or BUSY not in done.stdout:
                break
        self.said += done.stdout + done.stderr
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        return done.stdout


@pytest.mark.waits
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) to build the preload library with")
def test_the_page_as_it_stands(tmp_path):
    (recording,) = [command for command in COMMANDS if "--operator" in command]
    (tmp_path / "quick.toml").write_text(SHORTER)
    with contextlib.ExitStack() as stack:
        shell = Shell(tmp_path, stack)
        terminal = Terminal()
        stack.callback(terminal.close)
        for command in COMMANDS[: COMMANDS.index(recording)]:
            if command.endswith(" &"):
                emulator = shell.begin(command.removesuffix(" &"))
                heard(emulator, emulator.stdout, "export")
            elif command.startswith("export "):
                words = command.replace("$PWD", str(tmp_path)).split()[1:]
                shell.env |= dict(word.split("=", 1) for word in words)
            else:
                shell.run(command)
        assert re.search("^ready.*: shockrig run quick --bench bench.toml", shell.said, re.MULTILINE)
        assert 'limit_pin = "X" # pressed now' in (tmp_path / "bench.toml").read_text()
        assert "emulated" not in shell.said  # they cannot know
        watching = [command for command in COMMANDS if " watch " in command]
        assert len(watching) == 2
        for attempt in range(ATTEMPTS):
            recorder = shell.begin(recording.replace("run quick", "run quick.toml"))
            if not attempt:
                wait_for(lambda: list(tmp_path.glob("campaign/recording/*/journal.log")), recorder)
                seen_by_both(shell, terminal, tmp_path, *watching)
            said, _ = recorder.communicate(timeout=300)
            if recorder.returncode == 0:
                break
        assert recorder.returncode == 0, said
        state = read_state(tmp_path / "campaign")
        assert state.recorded == ("0001", "0002") and not state.emulated
        for run in state.recorded:
            head = json.loads((tmp_path / "campaign/runs" / run / "run.json").read_text())
            assert head["airs_from"] == {"source": "measured", "destination": "measured"}
            for place in ("source", "destination"):
                assert head[place]["temperature_c"] == pytest.approx(head["planned"][place]["temperature_c"], abs=0.1)
        assert "Who records?" not in said
        for command in COMMANDS[COMMANDS.index(watching[1]) + 1 :]:
            shell.run(command)
    found = read_profile(tmp_path / "sensors/profile.json").temperature.thermal_diffusivity_m2_s
    truth = draw_truth(np.random.default_rng(0)).thermal_diffusivity_m2_s  # of `emulate` without --seed
    assert found.value == pytest.approx(truth, rel=0.05)
    assert abs(found.value - truth) < 4 * found.standard_uncertainty
    assert not list((tmp_path / "bus").glob("tty*")) and not (tmp_path / "bus/chambers.toml").exists()


def seen_by_both(shell, terminal, folder, in_terminal, in_browser):
    """The campaign in progress, in a terminal and, where there is a browser, on the page."""
    shell.begin(in_terminal, stdout=terminal.slave)
    page = shell.begin(in_browser)
    url = heard(page, page.stdout, "http://127.0.0.1:").split()[0]
    if CHROMIUM is not None:
        profile = f"--user-data-dir={folder / 'browser'}"
        plain = {key: value for key, value in os.environ.items() if key != "LD_PRELOAD"}
        shown = subprocess.run(
            [CHROMIUM, *FLAGS, profile, "--virtual-time-budget=2000", "--dump-dom", url],
            capture_output=True,
            text=True,
            timeout=300,
            env=plain,
        ).stdout
        assert "campaign - recording</title>" in shown, shown[:3000]
        assert "quick on found by scan" in shown
        assert "hyt" in shown and "imet" in shown
    wait_for(lambda: "recording" in terminal.text() and "good/s" in terminal.text())
