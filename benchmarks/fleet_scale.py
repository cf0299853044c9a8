"""Whether many sensors take as long as they should, in flat memory, and whether killed workers change a digit.

    OPENBLAS_NUM_THREADS=1 python benchmarks/fleet_scale.py [--sensors 24] [--plunges] [--made 8] [--workers 2]
                                                            [--kills 3] [--stop]

A few virtual sensors are recorded, 36 runs of bead and film each, or with `--plunges` one plunge of a bead. Each is
copied under serial numbers of its own, which makes it another campaign to the map. `shockrig fleet` works on them on a
local Dask cluster while workers are killed. Its document is compared, digit by digit, with that of the few as this
process characterizes them, with one thread of the linear algebra as the command does: two end in other digits. With
`--stop` the command itself is killed half-way and given again.

A line for each quarter of the sensors says what it took. Seconds of the processor are those of all processes of the
command, as far as they were seen to the end; the clock's mean something on an idle machine alone. Memory is the largest
of the command's own process, and the largest of a worker.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from made_fleets import drawn_sensor, record_sensor, type_of_sensors

from shockrig.analysis.fleet.fleet import fleet_of
from shockrig.analysis.fleet.statistics import CampaignStatistics, statistics_from
from shockrig.files.fleet_file import fleet_document
from shockrig.protocols.fleet_map import KEPT_IN, FleetTask, measure
from shockrig.rig.virtual.plans import standard_plan, wide_plan

SENSORS = {"temperature": ("imet", "X"), "humidity": ("hyt", "H")}
PLUNGE = 13  # of the wide plan, from 40 to 20 degC
QUARTERS = 4


@dataclass
class Seen:
    """What was seen of the command until a number of sensors was done."""

    done: int = 0
    clock_s: float = 0.0
    took_s: dict[int, float] = field(default_factory=dict)
    command_mb: float = 0.0
    worker_mb: float = 0.0


def main(argv: list[str] | None = None) -> None:
    """Print a line for each quarter, then whether all is the same."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sensors", type=int, default=24)
    parser.add_argument("--plunges", action="store_true", help="one plunge of a bead each, in place of 36 runs")
    parser.add_argument("--made", type=int, default=8, help="campaigns that are recorded; the others are copies (8)")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kills", type=int, default=3, help="workers that are killed meanwhile (3)")
    parser.add_argument("--stop", action="store_true", help="kill the command half-way, and give it again")
    args = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder).resolve()
        made = [recorded(i, args.plunges, place / f"made{i}") for i in range(args.made)]
        copies = [copied(made[i % args.made], place / "fleet" / f"s{i:04d}", 1000 + i) for i in range(args.sensors)]
        print(f"{args.sensors} sensors, {args.workers} workers, {args.kills} killed", flush=True)
        print(f"{'done':>8}{'clock, s':>10}{'processor, s':>14}{'each, s':>9}{'command, MB':>13}{'worker, MB':>12}")
        out = place / "out"
        command = ["fleet", str(place / "fleet"), "--out", str(out), "--workers", str(args.workers)]
        first = []
        if args.stop:
            run(command, out, args.sensors, args.kills // 2, until=args.sensors // 2)
            first = sorted((out / KEPT_IN).iterdir())
            print(f"killed when {len(first)} were done, and given again", flush=True)
        kept = {path: path.stat().st_mtime_ns for path in first}
        run(command, out, args.sensors, args.kills - args.kills // 2 if args.stop else args.kills)
        if kept:
            again = sum(path.stat().st_mtime_ns != at for path, at in kept.items())
            print(f"of these {again} were done again")
        found = json.loads((out / "fleet.json").read_text())
        found.pop("provenance")
        print(f"the same to the last digit: {found == expected(made, copies)}")


def recorded(number: int, plunges: bool, folder: Path) -> Path:
    """A campaign of one of the sensors of a type."""
    truth = drawn_sensor(type_of_sensors(1), np.random.default_rng([1, number]))
    plan = [replace(wide_plan()[PLUNGE], duration_s=10.0, lead_s=2.0)] if plunges else standard_plan()
    record_sensor(truth, plan, number, folder, number)
    if plunges:
        head = json.loads((folder / "campaign.json").read_text())
        del head["sensors"]["hyt"]
        (folder / "campaign.json").write_text(json.dumps(head))
        for path in folder.glob("runs/*/hyt.csv"):
            path.unlink()
    return folder


def copied(campaign: Path, to: Path, serial: int) -> Path:
    """The same readings as another sensor's."""
    shutil.copytree(campaign, to, copy_function=os.link)
    head = json.loads((campaign / "campaign.json").read_text())
    head["name"] = to.name
    for name, letter in SENSORS.values():
        if name in head["sensors"]:
            head["sensors"][name]["serial"] = f"{letter}{serial}"
    (to / "campaign.json").unlink()  # the copy is a link to what was made
    (to / "campaign.json").write_text(json.dumps(head))
    return to


def expected(made: list[Path], copies: list[Path]) -> dict[str, object]:
    """The fleet's document from the few that were recorded, each characterized once in this process."""
    few = [statistics_from(measure(FleetTask(str(path), str(path), "1", None, None))["found"]) for path in made]
    fleet = fleet_of([as_copy(few[i % len(few)], path, 1000 + i) for i, path in enumerate(copies)])
    document = json.loads(json.dumps(fleet_document(fleet)))
    document.pop("provenance")
    return document


def as_copy(one: CampaignStatistics, path: Path, serial: int) -> CampaignStatistics:
    """What is known of a recorded sensor, of the copy that bears another serial number."""
    serials = {channel: f"{SENSORS[channel][1]}{serial}" for channel in one.channels}
    return replace(one, name=path.name, path=str(path), bench=str(path), fingerprint=path.name, serials=serials)


def run(words: list[str], out: Path, count: int, kills: int, until: int | None = None) -> None:
    """Run the command, kill so many of its workers meanwhile, print a line for each quarter; `until` so many sensors
    are done, then kill it."""
    program = [sys.executable, "-c", "from shockrig.protocols.cli import main; raise SystemExit(main())", *words]
    before, began, chance = done_in(out), time.monotonic(), random.Random(1)
    process = subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    top, now, line = psutil.Process(process.pid), Seen(before), Seen(before)
    ends = [count * (k + 1) // QUARTERS for k in range(QUARTERS - 1)]
    deaths = [before + (k + 1) * ((until or count) - before) // (kills + 1) for k in range(kills)]
    while process.poll() is None:
        time.sleep(0.2)
        workers = look(top, now)
        now.done, now.clock_s = done_in(out), time.monotonic() - began
        if any(line.done < end <= now.done for end in ends):
            line = said(line, now)
        if deaths and workers and now.done >= deaths[0]:
            chance.choice(workers).send_signal(signal.SIGKILL)
            deaths.pop(0)
        if until is not None and now.done >= until:
            family = top.children(recursive=True)
            process.kill()
            for one in psutil.wait_procs(family, timeout=30.0)[1]:
                one.kill()
    if now.clock_s > line.clock_s:
        said(line, now)
    if until is None and (process.returncode or deaths):
        raise SystemExit(f"{' '.join(words)}: status {process.returncode}, {len(deaths)} workers left to kill")


def done_in(out: Path) -> int:
    """Sensors that are done."""
    folder = out / KEPT_IN
    return sum(name.endswith(".json") for name in os.listdir(folder)) if folder.is_dir() else 0


def look(top: psutil.Process, now: Seen) -> list[psutil.Process]:
    """Add what the command's processes have taken to what was seen; the workers that are at work."""
    try:
        children = top.children(recursive=True)
        now.command_mb = max(now.command_mb, top.memory_info().rss / 1e6)
        now.worker_mb = max([now.worker_mb, *(one.memory_info().rss / 1e6 for one in children)])
        now.took_s |= {one.pid: sum(one.cpu_times()[:2]) for one in (top, *children)}
        return [one for one in children if one.cpu_times().user > 3.0]
    except psutil.Error:
        return []


def said(before: Seen, now: Seen) -> Seen:
    """Print what was taken since; memory begins anew."""
    took_s = sum(now.took_s.values()) - sum(before.took_s.values())
    each_s = took_s / max(now.done - before.done, 1)
    print(
        f"{now.done:>8}{now.clock_s - before.clock_s:>10.1f}{took_s:>14.1f}{each_s:>9.3f}{now.command_mb:>13.0f}"
        f"{now.worker_mb:>12.0f}",
        flush=True,
    )
    ended = replace(now, took_s=dict(now.took_s))
    now.command_mb = now.worker_mb = 0.0
    return ended


if __name__ == "__main__":
    main()
