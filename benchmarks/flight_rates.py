"""Rows a second, and memory, of `shockrig correct` on the command line at 1, 10 and 100 Hz.

    python benchmarks/flight_rates.py [--beside FOLDER] [--times N] [--no-report]

CPU time of one thread, the least of N; a row a second is counted beyond what 100 rows take, which is mostly the start.
With --beside the same logs are corrected in turn by another version, whose package `shockrig` is in FOLDER.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from flight_cost import cost

from shockrig.analysis.flight.simulated import sensor
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import convective
from shockrig.files.profile import write_profile

DURATION_S = {1: 12_000.0, 10: 6_000.0, 100: 900.0}
FEW = 100


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--beside", type=Path, help="folder with the package of another version")
    parser.add_argument("--times", type=int, default=2)
    parser.add_argument("--no-report", action="store_true", help="without the page, whose figures hold every row")
    args = parser.parse_args()
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    versions = {"this": os.environ.get("PYTHONPATH", "")}
    if args.beside:
        versions["other"] = str(args.beside.resolve())
    profile = typical_profile()
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        write_profile(profile, home / "profile.json")
        print(f"{'rate':>7}{'rows':>8}{'version':>9}{'CPU s':>8}{'start':>7}{'rows/s':>9}{'peak MB':>9}", flush=True)
        for rate, duration_s in DURATION_S.items():
            sensor.SAMPLING_PERIOD_S = 1.0 / rate
            log = sensor.fly(convective(np.random.default_rng(1), duration_s=duration_s), profile, 1).log
            log.to_csv(home / "flight.csv", index=False)
            log[:FEW].to_csv(home / "few.csv", index=False)
            best: dict[str, list[float]] = {name: [np.inf] * 3 for name in versions}
            for _ in range(args.times):
                for name, where in versions.items():
                    os.environ["PYTHONPATH"] = where
                    command = [sys.executable, "-m", "shockrig", "correct"]
                    rest = ["--profile", str(home / "profile.json"), "--out", str(home / "out.csv")]
                    rest += ["--no-report"] * args.no_report
                    start, _ = cost([*command, str(home / "few.csv"), *rest])
                    whole, peak = cost([*command, str(home / "flight.csv"), *rest])
                    best[name] = [min(a, b) for a, b in zip(best[name], (whole, start, peak), strict=True)]
            for name, (whole, start, peak) in best.items():
                speed = len(log) / (whole - start)
                print(
                    f"{rate:>4} Hz{len(log):>8}{name:>9}{whole:>8.2f}{start:>7.2f}{speed:>9.0f}{peak:>9.0f}", flush=True
                )
            if args.beside:
                (a, b, _), (c, d, _) = best["other"], best["this"]
                print(f"{'':>7}{(a - b) / (c - d):.1f} times as fast", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
