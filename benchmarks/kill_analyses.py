"""Analyses killed with SIGKILL at random moments: no process is left, nothing half-written, and the next one goes on.

    python benchmarks/kill_analyses.py [--count 100] [--seed 0]

Each is one command on a small campaign or log, in a session of its own, killed at a seeded moment within the time that
it takes when nobody kills it. Then, within `WITHIN_S`: no process of it is running, and beside what was there before
stands its whole output or nothing. Every `AGAIN`th is run once more, and must succeed.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CAMPAIGN = ROOT / "data" / "examples" / "plain-rough"
LOG = ROOT / "data" / "real" / "haar" / "Temperature.csv"
RUNS = 4
WITHIN_S = 10.0
AGAIN = 20
MARK = "SHOCKRIG_KILLED"
# command, share of all kills, what it writes
COMMANDS = {
    "diagnose": (("diagnose", "campaign", "--out", "out"), 5, "report.html"),
    "characterize": (("characterize", "campaign", "--out", "out"), 3, "profile.json"),
    "look": (("import", "Temperature.csv", "--look", "--out", "out"), 1, "Temperature.toml"),
    "import": (("import", LOG.name, "--map", "haar", "--sensor", "closed", "--out", "out"), 1, "campaign.json"),
}


def prepared(folder: Path) -> None:
    """A campaign of the bead's first runs, and a log."""
    (folder / "campaign" / "runs").mkdir(parents=True)
    shutil.copy(CAMPAIGN / "campaign.json", folder / "campaign")
    for run in sorted((CAMPAIGN / "runs").iterdir())[:RUNS]:
        shutil.copytree(run, folder / "campaign" / "runs" / run.name, ignore=shutil.ignore_patterns("hyt.csv"))
    shutil.copy(LOG, folder)


def started(folder: Path, name: str, mark: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "shockrig", *COMMANDS[name][0]]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    env = os.environ | {MARK: mark, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(command, cwd=folder, env=env, start_new_session=True, **quiet)


def running(mark: str) -> list[int]:
    """Processes whose environment bears the mark, whoever their parent is by now."""
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdecimal():
            continue
        try:
            marked = f"{MARK}={mark}".encode() in (entry / "environ").read_bytes().split(b"\0")
            state = (entry / "stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            continue
        if marked and state != "Z":
            found.append(int(entry.name))
    return found


def killed(folder: Path, name: str, after_s: float, mark: str) -> str:
    """Kill one command; what was wrong afterwards, empty where nothing was."""
    before = sorted(p.name for p in folder.iterdir())
    with started(folder, name, mark) as process:
        try:
            process.wait(after_s)
        except subprocess.TimeoutExpired:
            os.kill(process.pid, signal.SIGKILL)
    deadline = time.monotonic() + WITHIN_S
    while True:
        left = running(mark)
        more = [p.name for p in folder.iterdir() if p.name not in before]
        wrong = [f"{len(left)} processes left"] if left else []
        wrong += [f"{file} left" for file in more if file != "out"]
        if "out" in more and not (folder / "out" / COMMANDS[name][2]).is_file():
            wrong.append("out is not whole")
        if not wrong or time.monotonic() > deadline:
            for pid in left:
                os.kill(pid, signal.SIGKILL)
            return ", ".join(wrong)
        time.sleep(0.05)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--at-most-s", type=float, default=float("inf"), help="stop early, and say how far it went")
    args = parser.parse_args()
    outcomes: Counter[str] = Counter()
    faults = []
    resumed = again = 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        prepared(folder)
        takes_s = {}
        for name in COMMANDS:
            began_s = time.monotonic()
            with started(folder, name, "whole") as process:
                if process.wait(600) != 0:
                    raise RuntimeError(f"{name} does not succeed when nobody kills it")
            takes_s[name] = time.monotonic() - began_s
            shutil.rmtree(folder / "out")
        began_s = time.monotonic()
        for k in range(args.count):
            if time.monotonic() - began_s > args.at_most_s:
                break
            rng = random.Random(args.seed + k)
            name = rng.choices(list(COMMANDS), [share for _, share, _ in COMMANDS.values()])[0]
            after_s = rng.uniform(0.0, takes_s[name])
            wrong = killed(folder, name, after_s, str(args.seed + k))
            outcomes[f"{name}{', whole' if (folder / 'out').exists() else ''}"] += 1
            if wrong:
                faults.append(f"seed {args.seed + k}: {name} after {after_s:.2f} s: {wrong}")
                print(faults[-1], flush=True)
            if k % AGAIN == 0:
                again += 1
                shutil.rmtree(folder / "out", ignore_errors=True)
                with started(folder, name, "again") as process:
                    resumed += process.wait(600) == 0 and (folder / "out" / COMMANDS[name][2]).is_file()
            for entry in folder.iterdir():
                if entry.name not in ("campaign", "Temperature.csv"):
                    shutil.rmtree(entry)
    done = outcomes.total()
    print(f"{done} of {args.count} analyses killed, seeds {args.seed} to {args.seed + done - 1}")
    print("  whole they take " + ", ".join(f"{name} {s:.0f} s" for name, s in takes_s.items()))
    print("  " + ", ".join(f"{what} {count}" for what, count in sorted(outcomes.items())))
    print(f"  with something left behind {len(faults)}; the same command once more: {resumed} of {again} whole")
    return 1 if faults or resumed < again else 0


if __name__ == "__main__":
    sys.exit(main())
