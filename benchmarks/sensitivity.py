"""How much the diagnosis hangs on each of its numbers: every one halved and doubled, on the same campaigns.

    python benchmarks/sensitivity.py [--seeds 8] [--first 47000] [--work DIR]

Rough campaigns of the standard plan, a third plain, a third with one effect, a third with two. Per number: how many
channels are right (all that is hidden named, nothing else, the right verdict) at half its value, as it is, and doubled.
What is done is kept in the work folder as JSON lines, so that it can be stopped and resumed.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from shockrig.analysis.checks.campaign_checks import checked
from shockrig.analysis.diagnose import thresholds
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.quantity import QUANTITIES
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.hide import draw_hidden
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import draw_truth

KINDS: tuple[str | int, ...] = ("none", 1, 2)
FACTORS = (0.5, 2.0)


def campaign(seed: int, work: Path) -> tuple[Path, dict[str, list[str]]]:
    """A campaign of a seed, recorded where it is not there yet, and what is hidden in each channel."""
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng, "rough", draw_hidden(rng, KINDS[seed % len(KINDS)]))
    path = work / str(seed)
    if not path.exists():
        simulate_campaign(truth, standard_plan(), rng, path)
    return path, {name: sorted(h.effect for h in truth.effects if name in h.channels) for name in QUANTITIES}


def right(seed: int, work: Path) -> tuple[int, int]:
    """How many channels of a campaign are diagnosed rightly, and how many there are."""
    path, hidden = campaign(seed, work)
    input_, good, of = checked(read_campaign(path)), 0, 0
    for name in QUANTITIES:
        channel = build_channel(input_.campaign, name)
        if channel is None:
            continue
        found = diagnose_channel(channel, findings=input_.findings)
        named = sorted(cause.effect for cause in found.causes)
        verdict = "explained" if hidden[name] else "adequate"
        good += named == hidden[name] and found.verdict == verdict and not found.discovered
        of += 1
    return good, of


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first", type=int, default=47000)
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "sensitivity")
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    kept = args.work / "done.jsonl"
    done = {}
    if kept.exists():
        lines = map(json.loads, kept.read_text(encoding="utf-8").splitlines())
        done = {(line["name"], line["factor"], line["seed"]): (line["right"], line["of"]) for line in lines}
    seeds = range(args.first, args.first + args.seeds)
    original = dict(thresholds.THRESHOLDS)

    def counted(name: str, factor: float) -> str:
        own = original.get(name)
        if own is not None:
            thresholds.THRESHOLDS[name] = replace(own, value=own.value * factor)
        for seed in seeds:
            if (name, factor, seed) not in done:
                done[name, factor, seed] = right(seed, args.work)
                good, of = done[name, factor, seed]
                line = {"name": name, "factor": factor, "seed": seed, "right": good, "of": of}
                with kept.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(line) + "\n")
                print(name, factor, seed, f"{good} of {of}", file=sys.stderr, flush=True)
        thresholds.THRESHOLDS.update(original)
        good, of = (sum(done[name, factor, seed][i] for seed in seeds) for i in (0, 1))
        return f"{good}/{of}"

    as_is = counted("as it is", 1.0)
    print(f"seeds {seeds.start} to {seeds.stop - 1}; channels right: halved, as it is, doubled")
    for name, own in original.items():
        half, double = (counted(name, factor) for factor in FACTORS)
        print(f"{name:18} {own.value:10g}  {half:>7} {as_is:>7} {double:>7}  {own.meaning}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
