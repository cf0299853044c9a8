"""Whether many sensors take as long as they should, in flat memory, and whether killed workers change a digit.

    python benchmarks/fleet_scale.py [--sensors 24 48] [--kills 3]

Campaigns of 35 runs of a few virtual sensors, each copied under serial numbers of its own, which makes it another
campaign to the map. `shockrig fleet` works on them in one process, then on a local Dask cluster while workers are
killed; both results are compared digit by digit. Memory is the largest that any process of the command took. Seconds of
the processor are those of all its processes, as far as they were seen to the end; the clock's mean something on an idle
machine alone.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from made_fleets import drawn_sensor, record_sensor, type_of_sensors

from shockrig.rig.virtual.plans import standard_plan

MADE = 4  # campaigns that are simulated; the others are copies


def main(argv: list[str] | None = None) -> None:
    """Print a line for each way and number of sensors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sensors", type=int, nargs="+", default=[24, 48])
    parser.add_argument("--kills", type=int, default=3)
    args = parser.parse_args(argv)
    rng, base = np.random.default_rng(1), type_of_sensors(1)
    with tempfile.TemporaryDirectory() as folder:
        made = [
            record_sensor(drawn_sensor(base, rng), standard_plan(), i, Path(folder) / f"made{i}", i)
            for i in range(MADE)
        ]
        print(f"{'sensors':>8}  {'way':<28}{'clock, s':>9}{'processor, s':>14}{'each, s':>9}{'MB':>7}")
        for count in args.sensors:
            fleet = Path(folder) / f"fleet{count}"
            for i in range(count):
                copied(made[i % MADE], fleet / f"s{i:04d}", 1000 + i)
            found = []
            for way, workers, kills in (("one process", 1, 0), (f"Dask, 2, {args.kills} killed", 2, args.kills)):
                out = Path(folder) / f"out{count}-{workers}"
                began = time.monotonic()
                megabytes, worked = run(["fleet", str(fleet), "--out", str(out), "--workers", str(workers)], kills)
                spent = time.monotonic() - began
                document = json.loads((out / "fleet.json").read_text())
                document.pop("provenance")
                found.append(document)
                print(
                    f"{count:>8}  {way:<28}{spent:>9.1f}{worked:>14.1f}{worked / count:>9.2f}{megabytes:>7.0f}",
                    flush=True,
                )
            print(f"{count:>8}  the same to the last digit: {found[0] == found[1]}", flush=True)


def copied(campaign: Path, to: Path, serial: int) -> None:
    """The same readings as another sensor's."""
    shutil.copytree(campaign, to)
    head = json.loads((to / "campaign.json").read_text())
    head["name"] = to.name
    for name, letter in (("imet", "X"), ("hyt", "H")):
        head["sensors"][name]["serial"] = f"{letter}{serial}"
    (to / "campaign.json").write_text(json.dumps(head))


def run(words: list[str], kills: int) -> tuple[float, float]:
    """Run the command, kill so many of its workers meanwhile; the largest memory of a process [MB], and what all of
    them took of the processor [s]."""
    program = [sys.executable, "-c", "from shockrig.protocols.cli import main; raise SystemExit(main())", *words]
    process = subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    top, largest, chance = psutil.Process(process.pid), 0.0, random.Random(1)
    took: dict[int, float] = {}
    last = time.monotonic()
    while process.poll() is None:
        time.sleep(0.2)
        try:
            family = [top, *top.children(recursive=True)]
            largest = max([largest, *(one.memory_info().rss / 1e6 for one in family)])
            took |= {one.pid: sum(one.cpu_times()[:2]) for one in family}
            working = [one for one in family[1:] if one.cpu_times().user > 3.0]
        except psutil.Error:
            continue
        if kills and working and time.monotonic() - last > 8.0:
            chance.choice(working).send_signal(signal.SIGKILL)
            kills, last = kills - 1, time.monotonic()
    if process.returncode or kills:
        raise SystemExit(f"{' '.join(words)}: status {process.returncode}, {kills} workers left to kill")
    return largest, sum(took.values())


if __name__ == "__main__":
    main()
