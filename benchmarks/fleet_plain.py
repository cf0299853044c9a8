"""What is said of carriages of which nothing is to be said: rough virtual sensors of one type with nothing hidden.

    python benchmarks/fleet_plain.py [--carriages 100] [--probes 8] [--seed 1] [--rows FILE]

Each carriage is of another type, drawn from its own seed, and has the eleven runs at 20 degC of `fleet_pairs.py`. Both
channels of each probe are diagnosed by themselves, then the fleet says whose each cause is. `--rows` keeps what was
named, a line for each carriage, so that a run can be stopped and goes on.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from fleet_pairs import AT_20_C, RH, Named, T
from resumed import scored

from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.fleet.whose import DiagnosedProbe, judged_causes
from shockrig.files.campaign import read_campaign
from shockrig.files.fleet_file import BENCH, TYPE
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import wide_plan
from shockrig.rig.virtual.truth import Truth, of_probe, of_type


def main(argv: list[str] | None = None) -> None:
    """Print a line for each carriage of which something is said, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--carriages", type=int, default=100)
    parser.add_argument("--probes", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="file of what was named, kept and gone on from")
    args = parser.parse_args(argv)
    jobs = [(seed, args.probes) for seed in range(args.seed, args.seed + args.carriages)]
    rows = [row for row in scored(args.rows, jobs, ("seed", "probes"), said_of) if (row["seed"], row["probes"]) in jobs]
    for row in rows:
        if row["named"]:
            named = "; ".join(f"{channel} {probe}: {effect}" for channel, probe, effect in row["named"])
            judged = ", ".join(f"{effect} {whose}" for _, effect, whose in row["causes"])
            print(f"seed {row['seed']}: {named} -> {judged}")
    last, diagnoses = args.seed + args.carriages - 1, 2 * args.probes * len(rows)
    common = sum(any(whose in (BENCH, TYPE) for *_, whose in row["causes"]) for row in rows)
    naming = sum(len({(channel, probe) for channel, probe, _ in row["named"]}) for row in rows)
    took_s = sum(row["took_s"] for row in rows)
    print(f"{len(rows)} plain carriages of {args.probes}, seeds {args.seed} to {last}; {took_s:.0f} s of the processor")
    some = sum(bool(row["named"]) for row in rows)
    print(f"something is given to bench or type in {common}, to any sensor in {some};")
    print(f"{naming} of their {diagnoses} diagnoses name something")


def said_of(seed: int, probes: int) -> list[dict[str, Any]]:
    """One carriage: what is named, and whose."""
    began_s, usual = time.process_time(), of_type(seed, 0, "rough")
    found = {str(k): diagnosed(usual, str(k), seed) for k in range(1, probes + 1)}
    named, causes = [], []
    for channel in (T, RH):
        seen = [DiagnosedProbe(probe, "carriage", "bench", both[channel]) for probe, both in found.items()]
        named += [(channel, one.sensor, cause.effect) for one in seen for cause in one.causes]
        causes += [(channel, cause.effect, cause.whose) for cause in judged_causes(channel, seen)]
    took_s = round(time.process_time() - began_s, 1)
    return [{"seed": seed, "probes": probes, "named": named, "causes": causes, "took_s": took_s}]


def diagnosed(truth: Truth, probe: str, seed: int) -> dict[str, Named]:
    """What the diagnoses of both channels of a probe name."""
    plan = [shock for shock in wide_plan() if int(shock.id) in AT_20_C]
    with tempfile.TemporaryDirectory() as folder:
        rng = np.random.default_rng([seed, int(probe)])
        campaign = read_campaign(simulate_campaign(of_probe(truth, probe), plan, rng, Path(folder) / "c"))
    said = {channel: diagnose_channel(build_channel(campaign, channel)) for channel in (T, RH)}
    return {name: tuple(cause.as_effect() for cause in one.causes) for name, one in said.items()}


if __name__ == "__main__":
    main()
