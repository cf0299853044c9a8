"""Worlds that a random program wrote: what is said of them, and how well a fresh campaign of each is predicted.

    python benchmarks/unforeseen.py --seeds 1000 1049 --label NAME [--exact] [--minutes N] [--table]

Each seed is a sensor with an effect of `unforeseen_worlds.py`, 1 to 20 times the noise in what it changes beyond the
body's rate. A campaign is diagnosed; a fresh one of the same world (other order, airs, airflows and noise) judges what
the diagnosis predicts, its plain model, and the simple models of `unforeseen_candidates.py`. A JSON line per world is
kept under the label with the commit, so that it can be stopped and resumed; `--table` only prints what is there.

Seeds 1000 to 1049 may be looked at. Those from 2000 on are for counting: each is drawn once, and never looked at.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RESULTS = Path(__file__).parent / "results"
WITHIN = 1.05  # of the best candidate's error
LEAST = 1.02  # ratio of errors from which one is better: a hundredth is how runs were placed
CHANCE = 3.3  # Student's t of the runs' relative gains, beyond which a candidate is better: one in 2000, of some 15
LIMIT_S = 300
WORD = {"run order": "run_order", "group": "run_order", "chance": "run_order"}  # of a factor in a description


def commit() -> str:
    """The commit of the code that runs."""
    return subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()


def better(than: Array, one: Array) -> float:
    """Student's t of how much less a candidate leaves of each run (R,): of the squares, or of their shares in what both
    leave where that is surer. What is gained in a few runs shows in the one, a little in every run in the other."""

    def t(gained: Array) -> float:
        spread = float(gained.std(ddof=1)) / np.sqrt(gained.size)
        return float(gained.mean()) / spread if spread > 0 else 0.0

    return max(t(than - one), t((than - one) / np.maximum(than + one, 1e-300)))


def trial(seed: int, limit_s: int = LIMIT_S, exact: bool = False) -> dict[str, Any]:
    """One world: recorded, diagnosed, and judged on a fresh campaign; with `exact` no remainder is immaterial."""
    from ours import fresh_run_errors, judge
    from unforeseen_candidates import judged
    from unforeseen_worlds import draw, record

    world = draw(seed)
    result: dict[str, Any] = {"commit": commit(), "exact": exact, **world.document()}
    with tempfile.TemporaryDirectory() as folder:
        campaign = record(world, Path(folder) / "campaign")
        fresh = record(world, Path(folder) / "fresh", fresh=True)
        outcome = judge(campaign, 0, limit_s, characterized=False, exact=exact)
        result["seconds"] = round(outcome.seconds.get("diagnose", 0.0), 1)
        squares = judged(campaign, fresh, world.channel)
        told = outcome.tells(world.channel)
        if told is None:
            why = next(iter((outcome.refused | outcome.crashed).values()), "nothing was said")
            return result | {"failed": why.strip().splitlines()[-1][-200:]}
        own = fresh_run_errors(outcome, fresh, world.channel)
    result |= said(told) | {"input": outcome.diagnosis.get("input_findings", []) if outcome.diagnosis else []}
    if own is None:
        return result | {"failed": "no prediction of other runs"}
    used = np.isfinite(own[1])  # the candidates are held to the same runs
    plain, ours = (one[used] for one in own)
    squares = {name: one[used] for name, one in squares.items()} | {"its plain model": plain}
    result["errors"] = {name: float(np.sqrt(s.mean())) for name, s in squares.items()} | {
        "diagnosis": float(np.sqrt(ours.mean()))
    }
    result["beaten_by"] = {
        name: round(t, 1)
        for name, s in squares.items()
        if (t := better(ours, s)) > CHANCE and ours.mean() > LEAST**2 * s.mean()
    }
    return result


def said(told: dict[str, Any]) -> dict[str, Any]:
    """What a diagnosis says of a channel."""
    described = told.get("discovered") or []
    return {
        "verdict": told["verdict"],
        "names": {c["effect"]: [c["probability"], c["indistinguishable_from"]] for c in told["causes"]},
        "described": [
            {
                "behaves_as": one["behaves_as"],
                "driver": one.get("driver"),
                "factors": [d["factor"] for d in one.get("depends_on") or []],
                "probability": one.get("probability"),
                "instead": [o["behaves_as"] for o in one.get("alternatives") or []],
            }
            for one in described
        ],
    }


def best(result: dict[str, Any]) -> tuple[str, float]:
    """The candidate that predicts the fresh campaign best, and by what factor the diagnosis is worse."""
    errors = result["errors"]
    name = min(errors, key=errors.__getitem__)
    return name, errors["diagnosis"] / errors[name]


def right(result: dict[str, Any], act: dict[str, Any]) -> str:
    """How an act is spoken of: "right", "in the set" (a look-alike or an alternative), or "" for not at all."""
    from unforeseen_worlds import KINDS

    says = KINDS[act["kind"]].says
    if any(one["behaves_as"] in says for one in result["described"]) or set(result["names"]) & says:
        return "right"
    instead = {o for one in result["described"] for o in one["instead"]}
    instead |= {o for _, others in result["names"].values() for o in others}
    return "in the set" if instead & says else ""


def depends(result: dict[str, Any], act: dict[str, Any]) -> bool:
    """Whether what an act depends on is among the factors of a description of its kind."""
    from unforeseen_worlds import KINDS

    wanted = {WORD.get(name, name) for name, _ in act["depends"]}
    says = KINDS[act["kind"]].says
    told = [one for one in result["described"] if one["behaves_as"] in says]
    return any(wanted <= set(one["factors"]) for one in told)


def line(result: dict[str, Any]) -> str:
    """A world in a few words."""
    head = f"{result['seed']} {result['channel'][:4]} {result['times_noise']:.1f} x noise, {result['words']}: "
    if "errors" not in result:
        return f"{head}{result.get('verdict', '')} FAILED {result['failed']}  {result['seconds']:.0f} s"
    names = [f"{e} ({p:.2f})" for e, (p, _) in result["names"].items()]
    names += [
        f"[{d['behaves_as']} {d['driver']} {'/'.join(d['factors'])} {d['probability']}]" for d in result["described"]
    ]
    name, ratio = best(result)
    spoken = "; ".join(f"{right(result, act) or 'not said'}" for act in result["acts"])
    beaten = f", beaten by {', '.join(result['beaten_by'])}" if result["beaten_by"] else ""
    errors = result["errors"]
    held = f"error {errors['diagnosis']:.3g} (plain {errors['its plain model']:.3g}, noise {result['noise']:.3g})"
    what = f"{result['verdict']}, {', '.join(names) or 'nothing named'} ({spoken})"
    return f"{head}{what}; {held}, {ratio:.2f} of {name}{beaten}  {result['seconds']:.0f} s"


def table(results: list[dict[str, Any]]) -> str:
    """What all worlds show together."""
    told = [r for r in results if "errors" in r]
    out = [f"{len(results)} worlds, {len(results) - len(told)} without a prediction"]
    if not told:
        return out[0]
    ratios = np.array([best(r)[1] for r in told])
    acts = [(r, act) for r in told for act in r["acts"]]
    tally = [right(r, act) for r, act in acts]
    adequate = [r for r in told if r["verdict"] == "adequate"]
    seconds = np.array([r["seconds"] for r in results])
    verdicts = {v: sum(r["verdict"] == v for r in told) for v in sorted({r["verdict"] for r in told})}
    dependent = [(r, act) for r, act in acts if act["depends"]]
    out += [
        f"  verdicts: {', '.join(f'{v} {n}' for v, n in verdicts.items())}",
        f"  described rightly {tally.count('right')}, in the set {tally.count('in the set')}, of {len(tally)} effects"
        f" ({(len(tally) - tally.count('')) / len(tally):.0%})",
        f"  what it depends on: {sum(depends(r, a) for r, a in dependent)} of {len(dependent)}",
        f"  `adequate` beside a simple model that is better on a fresh campaign beyond chance:"
        f" {sum(bool(r['beaten_by']) for r in adequate)} of {len(told)} ({len(adequate)} are called adequate)",
        f"  any verdict beside such a model: {sum(bool(r['beaten_by']) for r in told)}",
        f"  error on the fresh campaign within {WITHIN} of the best: {(ratios <= WITHIN).mean():.1%};"
        f" median {np.median(ratios):.2f}, ninth tenth {np.quantile(ratios, 0.9):.2f}, worst {ratios.max():.2f}",
        f"  processor seconds: median {np.median(seconds):.1f}, longest {seconds.max():.0f}",
        f"  {'kind':36} {'worlds':>6} {'said':>5} {'adequate':>8} {'worse':>6}",
    ]
    for kind in sorted({act["kind"] for _, act in acts}):
        own = [(r, act) for r, act in acts if act["kind"] == kind]
        said_so = sum(bool(right(r, act)) for r, act in own)
        calm = sum(r["verdict"] == "adequate" for r, _ in own)
        worse = sum(best(r)[1] > WITHIN for r, _ in own)
        out.append(f"    {kind:34} {len(own):6} {said_so:5} {calm:8} {worse:6}")
    return "\n".join(out)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1049), metavar=("FIRST", "LAST"))
    parser.add_argument("--label", default="today", help="of the file that results are kept in")
    parser.add_argument("--results", type=Path, default=RESULTS, metavar="DIR")
    parser.add_argument("--minutes", type=float, default=1e9, help="after these nothing further is begun")
    parser.add_argument("--limit", type=int, default=LIMIT_S, help="seconds of the processor for one diagnosis")
    parser.add_argument("--exact", action="store_true", help="tolerances of 0; without: those of the command")
    parser.add_argument("--table", action="store_true", help="only print what is there")
    args = parser.parse_args(argv)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    seeds = range(args.seeds[0], args.seeds[1] + 1)
    file, until = args.results / f"unforeseen_{args.label}.jsonl", time.monotonic() + 60.0 * args.minutes
    args.results.mkdir(parents=True, exist_ok=True)
    kept = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    known = {result["seed"]: result for result in map(json.loads, kept)}
    for seed in seeds if not args.table else ():
        if seed in known:
            continue
        if time.monotonic() > until:
            break
        known[seed] = trial(seed, args.limit, args.exact)
        with file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(known[seed]) + "\n")
        print(line(known[seed]), flush=True)
    chosen = [known[seed] for seed in seeds if seed in known]
    if args.table:
        print("\n".join(line(result) for result in chosen))
    print(table(chosen))
    return 0


if __name__ == "__main__":
    sys.exit(main())
