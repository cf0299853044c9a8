"""How naming, wrong naming and gain go with an effect's size, in sensors and on a bench that are as real ones.

    python benchmarks/realistic_curves.py --seeds 2                         # appends to benchmarks/results
    python benchmarks/realistic_curves.py --draw docs/figures/realistic.png  # prints the table and draws it

Each trial hides one effect at a multiple of a realistic strength (`rig/virtual/realistic.py`) beside what every real
sensor shows (the air film, a film read at its own temperature), records the plan and diagnoses the effect's channel.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

RESULTS = Path(__file__).parent / "results" / "realistic_curves.jsonl"
SIZES = (0.06, 0.25, 1.0, 4.0)
CHANNEL = {
    "self_heating": "temperature",
    "wall_radiation": "temperature",
    "stem_conduction": "temperature",
    "finite_transfer": "temperature",
    "dead_time": "humidity",
    "vapour_boundary_layer": "humidity",
    "series_lag": "humidity",
    "slow_relaxation": "humidity",
    "direction_dependent_diffusivity": "humidity",
    "hysteresis": "humidity",
    "calibration_temperature": "humidity",
}


def trial(effect: str, size: float, seed: int, plan: str) -> dict:
    """One world with one effect hidden at `size` times a realistic strength, and what its channel's diagnosis says."""
    from shockrig.analysis.diagnose.diagnose import diagnose_channel
    from shockrig.analysis.estimate.gather import build_channel
    from shockrig.files.campaign import read_campaign
    from shockrig.rig.virtual.batch import simulate_campaign
    from shockrig.rig.virtual.plans import extended_plan, standard_plan
    from shockrig.rig.virtual.realistic import draw_real
    from shockrig.rig.virtual.truth import REALISTIC, Hidden, draw_truth, with_effects

    rng, name = np.random.default_rng([seed, list(CHANNEL).index(effect)]), CHANNEL[effect]
    truth = draw_truth(rng, REALISTIC)
    hidden = Hidden(effect, draw_real(rng, effect, name, size), (name,) if effect == "dead_time" else ())
    truth = with_effects(truth, [hidden])
    runs = {"standard": standard_plan, "extended": extended_plan}[plan]()
    with tempfile.TemporaryDirectory() as folder:
        campaign = read_campaign(simulate_campaign(truth, runs, rng, Path(folder) / "c"))
    started = time.process_time()
    found = diagnose_channel(build_channel(campaign, name))
    there = {h.effect for h in truth.effects if name in h.channels}
    named = [cause.effect for cause in found.causes]
    return {
        "effect": effect,
        "size": size,
        "seed": seed,
        "plan": plan,
        "parameters": dict(hidden.parameters),
        "verdict": found.verdict,
        "named": effect in named,
        "listed": any(effect in cause.indistinguishable_from for cause in found.causes),
        "wrong": [e for e in named if e not in there],
        "missed": sorted(there - set(named)),
        "gain": found.gain.explained_fraction,
        "after_in_noise": found.gain.after / found.noise.standard_deviation,
        "seconds": round(time.process_time() - started, 2),
    }


def read(path: Path) -> list[dict]:
    """Trials recorded so far."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def table(results: list[dict]) -> str:
    """By effect and size: trials, shares named and wrongly named, gain, what unseen runs are missed by."""
    groups = defaultdict(list)
    for result in results:
        groups[result["effect"], result["plan"], result["size"]].append(result)
    columns = " ".join(f"{word:>6}" for word in ("trials", "named", "listed", "wrong"))
    lines = [f"{'effect':32} {'plan':9} {'size':>5} {columns} {'unexplained':>11} {'gain':>7} {'missed by':>10}"]
    for (effect, plan, size), own in sorted(groups.items()):
        count = [sum(bool(one[key]) for one in own) for key in ("named", "listed", "wrong")]
        unexplained = sum(one["verdict"] == "unexplained" for one in own)
        gain, after = (float(np.median([one[key] for one in own])) for key in ("gain", "after_in_noise"))
        shown = " ".join(f"{n:6}" for n in (len(own), *count))
        lines.append(f"{effect:32} {plan:9} {size:5g} {shown} {unexplained:11} {gain:7.4f} {after:8.3f} x")
    wrong = sum(bool(one["wrong"]) for one in results)
    lines.append(f"{len(results)} trials, a wrong name in {wrong}; missed by: of unseen runs, in units of the noise")
    return "\n".join(lines)


def draw(results: list[dict], path: Path) -> None:
    """Curves against size: share named (and wrongly named), and how far unseen runs are missed."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    effects = [effect for effect in CHANNEL if any(one["effect"] == effect for one in results)]
    every = sorted({one["size"] for one in results})
    figure, axes = plt.subplots(3, 4, figsize=(11, 7), sharex=True, sharey=True, layout="constrained")
    for axis, effect in zip(axes.ravel(), effects, strict=False):
        own = [one for one in results if one["effect"] == effect and one["plan"] == "standard"]
        sizes = sorted({one["size"] for one in own})
        for key, label, style in (("named", "named", "o-"), ("wrong", "a wrong name", "x--")):
            shares = [np.mean([bool(one[key]) for one in own if one["size"] == size]) for size in sizes]
            axis.plot(sizes, shares, style, label=label, color="C0" if key == "named" else "C3")
        gains = [np.median([one["gain"] for one in own if one["size"] == size]) for size in sizes]
        axis.plot(sizes, gains, "s:", label="gain on unseen runs", color="C2", markersize=4)
        axis.set_title(effect.replace("_", " "), fontsize=9)
        axis.set_xscale("log")
        axis.set_xticks(every, [f"{size:g}" for size in every])
        axis.minorticks_off()
        axis.axvspan(0.7, 1.4, color="0.92", zorder=0)
    for axis in axes.ravel()[len(effects) :]:
        axis.set_visible(False)
    axes[0, 0].legend(fontsize=8, loc="center right")
    figure.supxlabel("size, in units of what real sensors show")
    figure.supylabel("share of trials; share of the explainable error")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--effects", default=",".join(CHANNEL), help="ids joined by commas")
    parser.add_argument("--sizes", default=",".join(f"{size:g}" for size in SIZES))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=40000)
    parser.add_argument("--plan", default="standard", choices=("standard", "extended"))
    parser.add_argument("--results", type=Path, default=RESULTS, help="file of trials; those in it are not run again")
    parser.add_argument("--draw", type=Path, help="draw what is recorded to this PNG, and run nothing")
    args = parser.parse_args(argv)
    done = read(args.results)
    if args.draw is None:
        known = {(one["effect"], one["size"], one["seed"], one["plan"]) for one in done}
        for seed in range(args.first_seed, args.first_seed + args.seeds):
            for effect in args.effects.split(","):
                for size in (float(text) for text in args.sizes.split(",")):
                    if (effect, size, seed, args.plan) in known:
                        continue
                    result = trial(effect, size, seed, args.plan)
                    with args.results.open("a") as stream:
                        stream.write(json.dumps(result) + "\n")
                    done.append(result)
                    print(effect, size, seed, result["verdict"], result["named"], result["wrong"], file=sys.stderr)
    print(table(done))
    if args.draw is not None:
        draw(done, args.draw)
    return 0


if __name__ == "__main__":
    sys.exit(main())
