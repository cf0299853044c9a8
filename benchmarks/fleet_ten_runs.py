"""Whether ten runs of a new sensor cover what is true of it, by which scatter of the runs is taken for the bench's.

    python benchmarks/fleet_ten_runs.py [--sensors 260] [--seed 1] [--rows FILE]

One rough virtual sensor of each of many types has the ten runs at 20 degC of `fleet_prior.py`. Its least squares are
ended with the scatter that these runs and the usual prior make likely, which is what `characterize` does; and with the
true one, which is what a fleet of campaigns on such benches comes close to. Coverage is of two standard uncertainties.
`--rows` keeps what was found, a line for each sensor, so that a run can be stopped and goes on.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from resumed import scored

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from fleet_prior import FEW, errors
from made_fleets import record_sensor, type_of_sensors

from shockrig.analysis.characterize.characterize import characterize, with_run_scatter
from shockrig.analysis.characterize.result import to_profile
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.plans import wide_plan

BY_RUNS, BY_TRUTH = "by the runs themselves", "by the true scatter"
NUMBERS = ("alpha", "D(20)")


def main(argv: list[str] | None = None) -> None:
    """Print coverage of alpha and D by both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sensors", type=int, default=260)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="file of what was found, kept and gone on from")
    args = parser.parse_args(argv)
    seeds = [(seed,) for seed in range(args.seed, args.seed + args.sensors)]
    rows = [row for row in scored(args.rows, seeds, ("seed",), found_of) if (row["seed"],) in seeds]
    for by in (BY_RUNS, BY_TRUTH):
        said = []
        for number in NUMBERS:
            error, u = np.array([row[by][number] for row in rows if number in row[by]]).T
            inside = np.abs(error) < 2.0 * u
            said.append(
                f"{number} {inside.sum()} of {inside.size} ({100 * inside.mean():.1f} %), u {100 * np.median(u):.2f} %"
            )
        print(f"{by}: {'; '.join(said)}")


def found_of(seed: int) -> list[dict[str, Any]]:
    """One sensor's errors and uncertainties by both scatters."""
    truth = type_of_sensors(seed)
    plan = [shock for shock in wide_plan() if int(shock.id) in FEW]
    with tempfile.TemporaryDirectory() as folder:
        by_runs = characterize(
            read_campaign(record_sensor(truth, plan, [seed, 3], Path(folder) / "n", 900)), quickly=True
        )
    by_truth = with_run_scatter(by_runs, truth.rate_scatter)
    found = {by: errors(to_profile(one), truth) for by, one in ((BY_RUNS, by_runs), (BY_TRUTH, by_truth))}
    return [{"seed": seed, **found}]


if __name__ == "__main__":
    main()
