"""Bench minutes until alpha and every D are known as well as the standard campaign knows them; and what stops tell.

In each rough world the standard campaign is recorded first; its standard uncertainties are the goals of a campaign that
chooses its own runs on the same bench. Kept: minutes of both, the errors at the stop in standard uncertainties, and
what each run was expected to bring beside what it brought; beside these the standard campaign cut off at the same
minutes.

    python benchmarks/loop_precision.py --seeds 2 --out benchmarks/results/loop_precision.jsonl
    python benchmarks/loop_precision.py --nothing --seeds 5 --out benchmarks/results/loop_nothing.jsonl

With --nothing: plain worlds looked at after every run, to the end of modest goals; does any look name a cause?
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from loop_bench import FileBench, commit
from scipy.stats import spearmanr

from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.design.goals import parse_goals
from shockrig.analysis.design.targets import measured, targets
from shockrig.analysis.plan.decide import decide
from shockrig.analysis.plan.decision import CONTINUE, log_entry
from shockrig.files.campaign import read_campaign
from shockrig.rig.protocol import Soak, load_protocol
from shockrig.rig.virtual.plans import plan_from_protocol
from shockrig.rig.virtual.truth import ROUGH, Truth, draw_truth

AT_ONCE = 3  # runs that are chosen at one look
PLAIN_GOALS = "alpha 0.4 %, D 0.5 % at 20, ties decided, minutes 60"


def standard(truth: Truth, folder: Path, seed: int) -> FileBench:
    """The standard campaign, recorded run by run on a bench of files."""
    bench = FileBench(truth, folder, seed)
    protocol = load_protocol("standard")
    for shock, run in zip(plan_from_protocol(protocol), protocol.runs, strict=True):
        soak = next(step for step in run.steps if isinstance(step, Soak))
        bench.record(shock, 10.0, shock.duration_s - shock.lead_s, soak.over_s)
    return bench


def errors(found, truth: Truth) -> list[float]:
    """Of alpha and each D, in their standard uncertainties."""
    out = []
    for name, result in found.channels().items():
        for row in result.rows:
            if name == "temperature":
                true = truth.thermal_diffusivity_m2_s
            else:
                true = float(truth.diffusivity_m2_s(row.ambient_c))
            out.append((row.diffusivity_m2_s - true) / row.standard_uncertainty)
    return out


def scatter(found) -> float:
    """By how much rates differ from run to run, as the repeats of a campaign show it."""
    return float(next(iter(found.channels().values())).parts[0].fit.rate_scatter)


def precision(seed: int) -> dict:
    """One rough world: the standard campaign, then one that stops when it knows as much."""
    began_s = time.process_time()
    truth = draw_truth(np.random.default_rng([seed, 77]), ROUGH)
    with tempfile.TemporaryDirectory() as folder:
        fixed = standard(truth, Path(folder) / "standard", seed)
        whole = read_campaign(fixed.folder)
        text = "alpha 49 %, D 49 %"
        first = measured(whole)
        known = targets(parse_goals(text), first)
        parts = [
            f"{t.quantity} {100 * t.relative:.4f} %" + ("" if t.ambient_c is None else f" at {t.ambient_c:g}")
            for t in known
        ]
        goals = parse_goals(", ".join(parts))
        bench = FileBench(truth, Path(folder) / "own", seed + 5000)
        decision, log, came, somewhere_new = None, None, [], False
        while bench.minutes < 2.0 * fixed.minutes:
            decision = decide(bench.seen(), goals, decision, count=AT_ONCE)
            entry = log_entry(decision, goals, log, [])
            if entry["realised"]:
                came.append({**entry["realised"], "new_ambient": somewhere_new})
            log, known_at = entry, [t.ambient_c for t in decision.targets if t.runs]
            somewhere_new = any(
                c.shock.isothermal and min(abs(t - c.shock.destination_c) for t in known_at if t is not None) > 1.0
                for c in decision.choices
                if any(t is not None for t in known_at)
            )
            if decision.status != CONTINUE:
                break
            for choice in decision.choices:
                bench.record_run(choice.shock.as_run())
        own = read_campaign(bench.folder)
        final, last = characterize(own), measured(own)
        # The standard campaign cut off where the other one stopped: what does it know of the same goals by then?
        share = bench.minutes / fixed.minutes
        cut = replace(whole, runs=whole.runs[: max(int(share * len(whole.runs)), 2)])
        cut_off = targets(goals, measured(cut))
        return {
            "seed": seed, "rate_scatter": truth.rate_scatter, "scatter_found": [scatter(first), scatter(last)],
            "status": decision.status,
            "standard_minutes": round(fixed.minutes, 1), "minutes": round(bench.minutes, 1), "share": round(share, 3),
            "runs": bench.runs, "errors": [round(e, 2) for e in errors(final, truth)],
            "standard_errors": [round(e, 2) for e in errors(characterize(whole), truth)],
            "met_by_cut_off": sum(t.met for t in cut_off), "wanted": len(cut_off), "realised": came,
            "commit": commit(), "cpu_s": round(time.process_time() - began_s, 1),
        }  # fmt: skip


def nothing(seed: int) -> dict:
    """One plain rough world looked at after every run: what was ever named, and how it ended."""
    began_s = time.process_time()
    truth = draw_truth(np.random.default_rng([seed, 78]), ROUGH)
    goals = parse_goals(PLAIN_GOALS)
    with tempfile.TemporaryDirectory() as folder:
        bench = FileBench(truth, Path(folder) / "own", seed)
        decision, named, tied = None, set(), 0
        while True:
            decision = decide(bench.seen(), goals, decision)
            alone = [v for v in decision.verdicts.values() if v.dispute is None]
            named |= {effect for verdict in alone for effect in verdict.named}
            tied += bool(decision.tied)
            if decision.status != CONTINUE:
                break
            bench.record_run(decision.choices[0].shock.as_run())
        ended = {effect for verdict in decision.verdicts.values() for effect in verdict.named}
        return {
            "seed": seed, "status": decision.status, "reason": decision.reason, "runs": bench.runs,
            "minutes": round(bench.minutes, 1), "ever_named": sorted(named), "named": sorted(ended),
            "looks_with_a_tie": tied, "commit": commit(), "cpu_s": round(time.process_time() - began_s, 1),
        }  # fmt: skip


def summary(found: list[dict]) -> str:
    """What many worlds show together."""
    if "ever_named" in found[0]:
        ever, end = sum(bool(r["ever_named"]) for r in found), sum(bool(r["named"]) for r in found)
        return f"{len(found)} plain worlds: {ever} ever named a cause, {end} at the end"
    met = [r for r in found if r["status"] == "done"]
    shares = [r["share"] for r in met]
    scatters = [(r["share"], *r["scatter_found"]) for r in met if r["scatter_found"]]
    equal = [share * (of_standard / own) ** 2 for share, of_standard, own in scatters] or [np.nan]
    within = np.abs([e for r in met for e in r["errors"]]) <= 2.0
    looks = [c for r in found for c in r["realised"] if c["expected_information"] is not None]
    return "\n".join(
        [
            f"{len(found)} rough worlds, {len(met)} met all goals: share of the standard campaign's minutes at equal "
            f"stated uncertainty median {np.median(shares):.2f}, worst {max(shares):.2f}",
            "the same at equal scatter of rates (share times the square of what the standard campaign found over what "
            f"this one did; {len(scatters)} worlds): median {np.median(equal):.2f}, worst {max(equal):.2f}",
            f"within 2 standard uncertainties after the stop: {within.mean():.3f} of {within.size}",
            "information, nats of the goals' rates, expected before the runs against what their records brought:",
            _agreement("all looks", looks),
            _agreement("at ambients seen before", [c for c in looks if not c["new_ambient"]]),
            _agreement("at a new one", [c for c in looks if c["new_ambient"]]),
            f"the standard campaign cut off at the same minutes meets {sum(r['met_by_cut_off'] for r in met)} of "
            f"{sum(r['wanted'] for r in met)} goals",
        ]
    )


def _agreement(words: str, looks: list[dict]) -> str:
    """Rank correlation and slope through the origin of what came on what was expected."""
    if len(looks) < 3:
        return f"  {words}: {len(looks)} looks"
    expected, came = np.array([(c["expected_information"], c["information"]) for c in looks]).T
    slope = float((expected * came).sum() / (expected**2).sum())
    return f"  {words}: {len(looks)} looks, rank correlation {spearmanr(expected, came)[0]:.2f}, slope {slope:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--nothing", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results/loop_precision.jsonl"))
    args = parser.parse_args()
    there = [json.loads(line) for line in args.out.read_text().splitlines()] if args.out.exists() else []
    for seed in range(args.first, args.first + args.seeds):
        if seed not in {r["seed"] for r in there}:
            there.append(nothing(seed) if args.nothing else precision(seed))
            with args.out.open("a") as out:
                out.write(json.dumps(there[-1]) + "\n")
            print({k: v for k, v in there[-1].items() if k != "realised"}, flush=True)
    print(summary(there))


if __name__ == "__main__":
    main()
