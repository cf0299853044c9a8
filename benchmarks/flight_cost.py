"""Cost of correcting a flight over its length: CPU time beside that of pandas reading and writing the same file, and
peak memory.

    python benchmarks/flight_cost.py [--hours 0.25 1.5 24]

The log is one simulated quarter of an hour at 10 Hz, flown again and again.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import convective
from shockrig.files.profile import write_profile

PANDAS = "import pandas, sys; pandas.read_csv(sys.argv[1]).to_csv(sys.argv[2], index=False)"
NOTHING = "import analysis.flight.correct, pandas"
# a process that is begun counts the memory of the one that begins it: one that has next to none does
WATCH = """
import os, sys
aside = [(os.POSIX_SPAWN_OPEN, file, os.devnull, os.O_WRONLY, 0) for file in (1, 2)]
_, status, used = os.wait4(os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=aside), 0)
print(status, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
"""


def cost(command: list[str]) -> tuple[float, float]:
    """CPU time [s] and peak memory [MB] of a command."""
    watched = subprocess.run([sys.executable, "-S", "-c", WATCH, *command], capture_output=True, text=True, check=True)
    status, cpu_s, peak = map(float, watched.stdout.split())
    if status:
        raise SystemExit(f"{' '.join(command)} failed")
    return cpu_s, peak


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, nargs="+", default=[0.25, 1.5, 24.0])
    args = parser.parse_args()
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        profile = typical_profile()
        write_profile(profile, home / "profile.json")
        flown = fly(convective(np.random.default_rng(1), duration_s=900.0), profile, 1).log
        rows = flown.to_csv(index=False, header=False).splitlines()
        started, _ = cost([sys.executable, "-c", NOTHING])
        print(
            f"{'hours':>6}{'rows':>9}{'CPU s':>8}{'of it starting':>16}{'s per hour':>12}{'x pandas':>10}{'peak MB':>9}"
        )
        for hours in args.hours:
            log = home / "flight.csv"
            with log.open("w") as file:
                file.write(",".join(flown.columns) + "\n")
                count = 0
                while count < hours * 36_000:
                    for row in rows[: int(hours * 36_000) - count]:
                        file.write(f"{0.1 * count:.1f},{row.split(',', 1)[1]}\n")
                        count += 1
            command = [
                sys.executable,
                "-m",
                "shockrig.protocols.cli",
                "correct",
                str(log),
                "--profile",
                str(home / "profile.json"),
            ]
            own, peak = cost([*command, "--out", str(home / "out.csv")])
            others, _ = cost([sys.executable, "-c", PANDAS, str(log), str(home / "copy.csv")])
            print(
                f"{hours:>6g}{count:>9}{own:>8.1f}{started:>16.1f}{(own - started) / hours:>12.2f}"
                f"{own / others:>10.1f}{peak:>9.0f}",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
