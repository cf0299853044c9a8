"""How fast a characterization is: the whole standard campaign by this project, and by the obvious script, in one run.

    python benchmarks/characterize_speed.py [--script-runs 6] [--seed 7]

The obvious script (obvious_script.py) fits run by run, with the diffusivity alone (1 unknown) or with the start and the
two airs too (4 unknowns, what the project's fit does). It is timed on some runs and the time is scaled to all fits.
Times are the processor's, so that other work on the machine does not count; neither side uses more than one core.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from shockrig.analysis.characterize.characterize import characterize
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import ROUGH, draw_truth

sys.path.insert(0, str(Path(__file__).parent))
from obvious_script import fit_campaign


def main(argv: list[str] | None = None) -> None:
    """Time both, print the ratio and how right each is."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--script-runs", type=int, default=6, help="runs of 33 that the obvious script is timed on (6)")
    parser.add_argument("--seed", type=int, default=7)
    args = parser.parse_args(argv)
    rng = np.random.default_rng(args.seed)
    truth = draw_truth(rng, ROUGH)
    plan = standard_plan()
    with tempfile.TemporaryDirectory() as temporary:
        folder = simulate_campaign(truth, plan, rng, Path(temporary) / "campaign")
        ours = []
        for _ in range(3):
            begin = time.process_time()
            result = characterize(read_campaign(folder))
            ours.append(time.process_time() - begin)
        rows = [(r.diffusivity_m2_s, float(truth.diffusivity_m2_s(r.ambient_c))) for r in result.humidity.rows]
        rows = [pair for pair, row in zip(rows, result.humidity.rows, strict=True) if len(row.runs) > 1]
        rows.append((result.temperature.rows[0].diffusivity_m2_s, truth.thermal_diffusivity_m2_s))
        worst = max(abs(value / true - 1) for value, true in rows)
        fits = _fits(plan)
        print(f"rough world, seed {args.seed}, {len(plan)} runs; reading the files is counted on both sides")
        print(f"{'':<34}{'whole campaign':>16}{'ratio':>9}{'worst error':>13}")
        print(f"{'this project':<34}{min(ours):>14.2f} s{'':>9}{100 * worst:>11.2f} %")
        for unknowns in (1, 4):
            begin = time.process_time()
            done = fit_campaign(folder, args.script_runs, unknowns)
            seconds = (time.process_time() - begin) / len(done) * fits

            errors = [abs(f.diffusivity_m2_s / _true(truth, f) - 1) for f in done]
            label = f"obvious script, {unknowns} unknown{'s' if unknowns > 1 else ''} a run"
            print(f"{label:<34}{seconds:>14.0f} s{seconds / min(ours):>9.0f}{100 * max(errors):>11.2f} %", flush=True)
        timed = f"{len(done)} of its {fits} fits"
        print(f"the script's time is scaled from {timed}; its errors are those of single runs")


def _fits(plan) -> int:
    """Fits that the script makes: a run and channel with a step of 1 degC or 1 %RH is one."""
    pairs = [(run.source, run.destination) for run in plan]
    warmed = sum(abs(d.temperature_c - s.temperature_c) >= 1.0 for s, d in pairs)
    return warmed + sum(abs(d.humidity_percent - s.humidity_percent) >= 1.0 for s, d in pairs)


def _true(truth, fit) -> float:
    if fit.channel == "temperature":
        return truth.thermal_diffusivity_m2_s
    return float(truth.diffusivity_m2_s(fit.ambient_c))


if __name__ == "__main__":
    main()
