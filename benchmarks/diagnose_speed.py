"""How long the whole command `shockrig diagnose` takes, report and plots included, and an older one beside it.

    python benchmarks/diagnose_speed.py --new PATH/shockrig [--old PATH/shockrig] [--repeats 3]

Each campaign is diagnosed by both commands in turn; of the repeats the shortest counts. Campaigns: those of
data/examples, and some of the virtual bench with nothing, one, two and four effects hidden, with a mean over 24
readings, and with what no catalogue holds.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent
ORDINARY = ("convective_film", "finite_transfer", "stem_conduction", "die_thermal_lag")
# (what is hidden, seed); the last ones are those that took longest before
WORLDS = (("none", 51000), ("one", 51001), ("two", 51002), (ORDINARY, 51003), ("mean of 24", 51004), ("outside", 31518))


@dataclass(frozen=True)
class Timing:
    """One campaign: shortest wall time and its processor time [s]."""

    wall_s: float
    processor_s: float


def make(hidden: object, seed: int, folder: Path) -> Path:
    """A rough campaign of the standard plan."""
    from shockrig.rig.virtual.batch import simulate_campaign
    from shockrig.rig.virtual.hide import draw_hidden
    from shockrig.rig.virtual.plans import standard_plan
    from shockrig.rig.virtual.truth import Hidden, draw_truth

    rng = np.random.default_rng(seed)
    if hidden == "mean of 24":
        effects = [Hidden("moving_average", {"samples": 24.0}, ("humidity",))]
    else:
        effects = draw_hidden(rng, {"one": 1, "two": 2}.get(hidden, hidden) if isinstance(hidden, str) else hidden)
    return simulate_campaign(draw_truth(rng, "rough", effects), standard_plan(), rng, folder)


def timed(command: str, campaign: Path, repeats: int) -> Timing:
    """The command on a campaign, as a user runs it."""
    best = Timing(np.inf, np.inf)
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as out:
            used, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            done = subprocess.run(
                [command, "diagnose", str(campaign), "--out", str(Path(out) / "d")], capture_output=True, check=False
            )
            wall = time.perf_counter() - started
            if done.returncode:
                raise SystemExit(done.stderr.decode()[-500:])
            now = resource.getrusage(resource.RUSAGE_CHILDREN)
            processor = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
            best = min(best, Timing(wall, processor), key=lambda t: t.wall_s)
    return best


def main(argv: list[str] | None = None) -> int:
    """Print a line a campaign."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--new", required=True, help="the command")
    parser.add_argument("--old", help="an older one, for the ratio")
    parser.add_argument("--repeats", type=int, default=3)
    args = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as scratch:
        campaigns = {path.name: path for path in sorted((ROOT / "data" / "examples").iterdir()) if path.is_dir()}
        for hidden, seed in WORLDS:
            name = hidden if isinstance(hidden, str) else "four (an ordinary bench)"
            campaigns[f"{name}, seed {seed}"] = make(hidden, seed, Path(scratch) / str(seed))
        print(f"{len(os.sched_getaffinity(0))} cores; whole command, report and plots included")
        print(f"{'campaign':36}{'runs':>5}{'wall s':>9}{'processor s':>13}{'older / this, wall':>20}")
        for name, path in campaigns.items():
            runs = sum(1 for _ in (path / "runs").iterdir())
            new = timed(args.new, path, args.repeats)
            ratio = f"{timed(args.old, path, 1).wall_s / new.wall_s:20.1f}" if args.old else ""
            print(f"{name:36}{runs:5}{new.wall_s:9.1f}{new.processor_s:13.1f}{ratio}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
