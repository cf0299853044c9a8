"""Look-alikes told apart by runs that the campaign chooses itself, beside random runs of the same menu and repeats.

A poor start, four times the same run (one airflow, one direction, one step), with one of a pair of look-alikes hidden;
then runs one by one until the decision is to stop, 12 at most. Right: that effect alone is named. Wrong: another one
is. The rest is inconclusive. `right_after` is after how many added runs a look names it alone, with nothing tied or
left, and does so from then on: for random runs and repeats too, which may never vary what the decision to stop wants
varied. `open_at_start`: the first look does not. Random runs are those of the menu that move the channel on trial.
Each world is a line of JSON in the results file; what is there is not run again.

    python benchmarks/loop_twins.py --seeds 1 --out benchmarks/results/loop_twins.jsonl
    python benchmarks/loop_twins.py --seeds 1 --how random repeats --open

With --open only worlds of which the adaptive campaign is in the file already and was open at its start.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from loop_bench import FileBench, Waiting, commit
from scipy.stats import spearmanr

from shockrig.analysis.design.goals import parse_goals
from shockrig.analysis.design.menu import PlannedShock, Surroundings, Usual, deciding_menu
from shockrig.analysis.plan.decide import decide
from shockrig.analysis.plan.decision import CONTINUE, log_entry
from shockrig.rig.virtual.hide import draw_effect
from shockrig.rig.virtual.truth import ROUGH, draw_truth

T, RH = "temperature", "humidity"
PAIRS = (
    (T, "self_heating", "calibration_error"),
    (T, "stem_conduction", "air_relaxation"),
    (T, "dead_time", "finite_transfer"),
    (T, "convective_film", "finite_transfer"),
    (T, "convective_film", "dead_time"),
    (T, "radiative_heating", "self_heating"),
    (T, "radiative_heating", "calibration_error"),
    (T, "clock_drift", "dead_time"),
    (RH, "hysteresis", "calibration_error"),
    (RH, "slow_relaxation", "air_relaxation"),
    (RH, "vapour_boundary_layer", "finite_transfer"),
    (RH, "vapour_boundary_layer", "dead_time"),
    (RH, "concentration_dependent_diffusivity", "direction_dependent_diffusivity"),
    (RH, "concentration_dependent_diffusivity", "slow_relaxation"),
    (RH, "clock_drift", "dead_time"),
)
START = {RH: PlannedShock(20.0, 20.0, 20.0, 80.0, why="start"), T: PlannedShock(40.0, 17.0, 20.0, 55.0, why="start")}
RUNS_OF_START = 4
MOST = 12
OTHER = {T: "hyt", RH: "imet"}  # the sensor that is not there
ADAPTIVE, RANDOM, REPEATS = "adaptive", "random", "repeats"
LATER = "later"  # adaptive, its diagnoses made while the next run is recorded, as on benches in real time


def world(pair: int, seed: int, how: str) -> dict:
    """One campaign from its poor start to its end."""
    channel, *both = PAIRS[pair]
    rng = np.random.default_rng([seed, pair])
    hidden = both[seed % 2]
    truth = draw_truth(rng, ROUGH, [draw_effect(rng, hidden, "comfortable", None if hidden in BOTH else channel)])
    goals = parse_goals("ties decided, minutes 200")
    began_s = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        bench = FileBench(truth, Path(folder) / "c", 1000 * seed + pair)
        light = 800.0 if "radiative_heating" in both else 0.0
        start = replace(START[channel], irradiance_w_m2=light)

        def record(shock: PlannedShock) -> None:
            bench.record_run(shock.as_run())
            (bench.folder / "runs" / f"{bench.runs:04d}" / f"{OTHER[channel]}.csv").unlink(missing_ok=True)
            head = json.loads((bench.folder / "campaign.json").read_text())
            head["sensors"].pop(OTHER[channel], None)
            (bench.folder / "campaign.json").write_text(json.dumps(head))

        for _ in range(RUNS_OF_START):
            record(start)
        start_minutes = bench.minutes
        decision, kinds, tied, log, evidence = None, [], False, None, []
        right_after = None
        waiting = Waiting()
        while True:
            if how == LATER:
                decision = waiting.decide(bench, goals, decision)
            else:
                decision = decide(bench.seen(), goals, decision)
            if how in (ADAPTIVE, LATER):
                was_tied, log = bool(log and log["tied"]), log_entry(decision, goals, log, [])
                came = log["realised"]
                if was_tied and came and came["expected_evidence"] is not None:
                    evidence.append([round(came["expected_evidence"], 2), round(came["evidence"], 2)])
            tied = tied or bool(decision.tied)
            now = decision.verdicts[channel]
            if now.named != (hidden,) or now.tied or now.verdict != "explained":
                right_after = None
            elif right_after is None:
                right_after = len(kinds)
            if not kinds:
                open_at_start = right_after is None
            if decision.status != CONTINUE or len(kinds) >= MOST:
                break
            shock = decision.choices[0].shock
            if how == RANDOM:
                menu = deciding_menu([20.0], Usual(other=Surroundings((), (light,) if light else ())))
                menu = [one for one in menu if one.isothermal == (channel == RH)]
                shock = menu[int(rng.integers(len(menu)))]
            elif how == REPEATS:
                shock = start
            kinds.append(shock.why)
            record(shock)
    named = sorted(decision.verdicts[channel].named)
    done = decision.status == "done"
    right, wrong = done and named == [hidden], done and any(e != hidden for e in named)
    return {
        "pair": both, "channel": channel, "hidden": hidden, "seed": seed, "how": how, "added": len(kinds),
        "right_after": right_after, "open_at_start": open_at_start,
        "start_minutes": round(start_minutes, 1), "minutes": round(bench.minutes, 1),
        "waited_s": round(waiting.waited_s, 1), "named": named,
        "tied": list(decision.tied.values()), "was_tied": tied,
        "outcome": "right" if right else "wrong" if wrong else "missed" if done else "inconclusive",
        "status": decision.status, "reason": decision.reason, "kinds": kinds,
        "evidence": evidence,
        "commit": commit(), "cpu_s": round(time.process_time() - began_s, 1),
    }  # fmt: skip


BOTH = ("finite_transfer", "air_relaxation")  # act in both channels


def summary(results: Iterable[dict]) -> str:
    """Outcomes by kind of choice, how many runs were added, and how many fewer than by the baselines."""
    found = list(results)
    lines = []
    for how in (ADAPTIVE, LATER, RANDOM, REPEATS):
        own = [r for r in found if r["how"] == how]
        if not own:
            continue
        counts = {o: sum(r["outcome"] == o for r in own) for o in ("right", "wrong", "missed", "inconclusive")}
        said = ", ".join(f"{n} {o}" for o, n in counts.items())
        opened = sum(r["open_at_start"] for r in own)
        lines.append(f"{how:9} {len(own)} worlds, {opened} of them open at the start: {said}")
        stopped, right = (np.median([count(r) for r in own]) for count in (until_stopped, until_right))
        lines.append(f"  added runs until it stops right, median {stopped:g}; until it is right for good {right:g}")
        if how == LATER:
            shares = [r["waited_s"] / 60.0 / r["minutes"] for r in own]
            lines.append(f"  the bench waited {np.median(shares):.1%} of its time, at most {max(shares):.1%}")
    lines += [line for how in (RANDOM, REPEATS) for line in compared(found, how)]
    told = [pair for r in found for pair in r["evidence"]]
    if len(told) > 2:
        expected, came = np.array(told).T
        slope = float((expected * came).sum() / (expected**2).sum())
        rank = spearmanr(expected, came)[0]
        lines.append(f"ln E of {len(told)} runs between what was tied: rank correlation {rank:.2f}, slope {slope:.2f}")
    return "\n".join(lines)


def until_stopped(r: dict) -> float:
    """Added runs until it ended and was right; one more than are allowed where it never did."""
    return r["added"] if r["outcome"] == "right" else MOST + 1


def until_right(r: dict) -> float:
    """Added runs until it was right for good."""
    return MOST + 1 if r["right_after"] is None else r["right_after"]


def minutes_until_stopped(r: dict) -> float:
    """Bench minutes of the added runs; where it never ended right, of as many as there were: it needs more."""
    return r["minutes"] - r["start_minutes"]


def compared(found: list[dict], how: str) -> list[str]:
    """What the adaptive campaigns need over what others need in the same worlds: ratios of means, 95 % by bootstrap."""
    others = {(*r["pair"], r["channel"], r["seed"]): r for r in found if r["how"] == how}
    own = {(*r["pair"], r["channel"], r["seed"]): r for r in found if r["how"] == ADAPTIVE}
    both = [(own[key], others[key]) for key in others if key in own]
    if not both:
        return []
    never = sum(b["outcome"] != "right" for _, b in both), sum(b["right_after"] is None for _, b in both)
    lines = [f"adaptive over {how}, {len(both)} worlds open at the start (what never came counts as at its end):"]
    for words, count in (
        (f"runs until it stops right ({never[0]} never did)", until_stopped),
        ("minutes until it stops right", minutes_until_stopped),
        (f"runs until it is right for good ({never[1]} never)", until_right),
    ):
        pairs = np.array([(count(a), count(b)) for a, b in both], dtype=float)
        drawn = np.random.default_rng(0).integers(len(both), size=(4000, len(both)))
        ratios = pairs[drawn, 0].sum(axis=1) / np.maximum(pairs[drawn, 1].sum(axis=1), 1e-9)
        low, high = np.quantile(ratios, (0.025, 0.975))
        lines.append(f"  {words}: {pairs[:, 0].sum() / pairs[:, 1].sum():.2f} ({low:.2f} to {high:.2f})")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--pairs", type=int, nargs="*", default=range(len(PAIRS)))
    parser.add_argument("--how", nargs="*", default=[ADAPTIVE])
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results/loop_twins.jsonl"))
    parser.add_argument("--open", action="store_true")
    args = parser.parse_args()
    there = [json.loads(line) for line in args.out.read_text().splitlines()] if args.out.exists() else []
    done = {(tuple(r["pair"]), r["channel"], r["seed"], r["how"]) for r in there}
    opened = {(tuple(r["pair"]), r["channel"], r["seed"]) for r in there if r["how"] == ADAPTIVE and r["open_at_start"]}
    for seed in range(args.first, args.first + args.seeds):
        for pair in args.pairs:
            for how in args.how:
                channel, *both = PAIRS[pair]
                closed = args.open and (tuple(both), channel, seed) not in opened
                if closed or (tuple(both), channel, seed, how) in done:
                    continue
                result = world(pair, seed, how)
                there.append(result)
                with args.out.open("a") as out:
                    out.write(json.dumps(result) + "\n")
                print(result, flush=True)
    print(summary(there))


if __name__ == "__main__":
    main()
