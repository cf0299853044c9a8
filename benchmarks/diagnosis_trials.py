"""Blind trials of the diagnosis: hide effects in the virtual bench by a seeded draw, diagnose the files, open the
seal, score.

    python benchmarks/diagnosis_trials.py --kind one --trials 40 --tier rough --strength comfortable --first-seed 5000

prints one line a trial and a table at the end. `--kind` is none, one, two, four, ordinary, outside, or an effect's id.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np

ORDINARY = ("convective_film", "finite_transfer", "stem_conduction", "die_thermal_lag")


def trial(kind: str, tier: str, strength: str, seed: int, plan: str = "standard") -> dict:
    """One blind trial through the campaign's files; returns what was hidden, the diagnosis and its score."""
    from analysis.campaign import read_campaign
    from analysis.diagnosis.diagnose import diagnose
    from analysis.diagnosis.export import to_json
    from protocols.reveal import score
    from rig.virtual.batch import simulate_campaign
    from rig.virtual.hide import draw_effect, draw_hidden, seal
    from rig.virtual.plans import standard_plan, wide_plan
    from rig.virtual.truth import draw_truth

    rng = np.random.default_rng(seed)
    which = {"none": "none", "one": 1, "two": 2, "four": 4, "outside": "outside", "ordinary": ORDINARY}.get(kind)
    hidden = [draw_effect(rng, kind, strength)] if which is None else draw_hidden(rng, which, strength)
    truth = draw_truth(rng, tier, hidden)
    with tempfile.TemporaryDirectory() as folder:
        path = simulate_campaign(
            truth, {"standard": standard_plan, "wide": wide_plan}[plan](), rng, Path(folder) / "campaign"
        )
        sealed = seal(Path(folder) / "truth.sealed", truth, seed)
        started = time.perf_counter()
        content = to_json(diagnose(read_campaign(path), seed))
        seconds = time.perf_counter() - started
        return {"hidden": truth.effects, "diagnosis": content, "score": score(sealed, content), "seconds": seconds}


def line(seed: int, result: dict) -> str:
    parts = []
    for name, c in result["score"].channels.items():
        channel = result["diagnosis"]["channels"][name]
        mark = "ok" if c.exact else "NO"
        errors = ", ".join(
            f"{e.effect}.{e.parameter} {e.true:.4g}~{e.value:.4g} ({e.sigmas:+.1f})"
            for e in c.errors
            if e.sigmas is not None
        )
        problem = (
            ""
            if c.exact
            else f" expected {c.expected_verdict} missed {list(c.missed)} listed {list(c.listed)} wrong {list(c.wrong)}"
        )
        gain = channel["gain"]
        parts.append(
            f"{mark} {name[:4]} {c.verdict} hidden {list(c.hidden)} named {list(c.named)}{problem} [{errors}]"
            f" rmse {gain['held_out_rmse_before']:.3g}>{gain['held_out_rmse_after']:.3g}"
            f" noise {gain['noise_floor']:.3g}"
        )
    return f"{seed} {result['seconds']:.0f}s\n    " + "\n    ".join(parts)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", default="one")
    parser.add_argument("--tier", default="rough", choices=("smooth", "rough"))
    parser.add_argument("--strength", default="comfortable", choices=("comfortable", "limit"))
    parser.add_argument("--plan", default="standard", choices=("standard", "wide"))
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=5000)
    args = parser.parse_args(argv)
    tally: Counter[str] = Counter()
    sigmas: list[float] = []
    stated: list[tuple[float, bool]] = []
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())  # ends after the trial at hand, with the table so far
    last = args.first_seed - 1
    for seed in range(args.first_seed, args.first_seed + args.trials):
        if stop.is_set():
            break
        last = seed
        result = trial(args.kind, args.tier, args.strength, seed, args.plan)
        print(line(seed, result), flush=True)
        tally["trials exact"] += result["score"].exact
        for c in result["score"].channels.values():
            tally["channels"] += 1
            tally["channels exact"] += c.exact
            tally["verdict right"] += c.verdict_right
            tally["hidden (nameable)"] += len(c.named) + len(c.listed) + len(c.missed)
            tally["named"] += len(c.named)
            tally["listed"] += len(c.listed)
            tally["wrongly named"] += len(c.wrong)
            tally["channels with a wrong name"] += bool(c.wrong)
            sigmas += [abs(e.sigmas) for e in c.errors if e.sigmas is not None]
            stated += [(p, right) for _, p, right in c.probabilities]
    print(
        f"\nkind {args.kind}, plan {args.plan}, tier {args.tier}, strength {args.strength}, "
        f"seeds {args.first_seed} to {last}"
    )
    for key, value in tally.items():
        print(f"  {key:28} {value}")
    if sigmas:
        print(f"  parameters within 2 sigma    {np.mean(np.array(sigmas) <= 2):.3f} of {len(sigmas)}")
    if stated:
        print(
            f"  mean probability stated      {np.mean([p for p, _ in stated]):.3f}, "
            f"right {np.mean([r for _, r in stated]):.3f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
