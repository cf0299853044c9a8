"""Blind trials of the diagnosis: hide effects in the virtual bench by a seeded draw, diagnose the files, open the
seal, score.

    python benchmarks/diagnosis_trials.py --kind one --trials 40 --tier rough --strength comfortable --first-seed 5000

prints two lines a trial and tables at the end: names, false alarms, parameter errors, calibration of the stated
probabilities, power against strength, and whether the stated gain holds on a fresh campaign of the same world.
`--kind` is none, one, two, four, ordinary, outside, or an effect's id.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from shockrig.protocols.parallel import mapped

ORDINARY = ("convective_film", "finite_transfer", "stem_conduction", "die_thermal_lag")
BINS = (0.0, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0)  # of stated probabilities
FRESH = 1_000_000  # added to a trial's seed for the fresh campaign of its world


def trial(
    kind: str,
    tier: str,
    strength: str | float,
    seed: int,
    plan: str = "standard",
    fresh: bool = False,
    without: str | None = None,
) -> dict:
    """One blind trial through the campaign's files; returns what was hidden, the diagnosis and its score.

    `fresh`: also record the same world again and measure there what each channel's extension gains.
    `without`: the sensor ("imet", "hyt") whose readings are taken away, so that the other alone is diagnosed.
    """
    from shockrig.analysis.diagnose.diagnose import diagnose
    from shockrig.analysis.diagnose.diagnosed import to_json
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.files.campaign import read_campaign
    from shockrig.protocols.reveal import score
    from shockrig.rig.virtual.batch import simulate_campaign
    from shockrig.rig.virtual.hide import draw_effect, draw_hidden, seal
    from shockrig.rig.virtual.plans import extended_plan, standard_plan, wide_plan
    from shockrig.rig.virtual.truth import draw_truth

    rng = np.random.default_rng(seed)
    which = {"none": "none", "one": 1, "two": 2, "four": 4, "outside": "outside", "ordinary": ORDINARY}.get(kind)
    hidden = [draw_effect(rng, kind, strength)] if which is None else draw_hidden(rng, which, strength)
    truth = draw_truth(rng, tier, hidden)
    runs = {"standard": standard_plan, "wide": wide_plan, "extended": extended_plan}[plan]()
    with tempfile.TemporaryDirectory() as folder:
        path = simulate_campaign(truth, runs, rng, Path(folder) / "campaign")
        sealed = seal(Path(folder) / "truth.sealed", truth, seed)
        started = time.perf_counter()
        campaign = read_campaign(path)
        if without is not None:
            campaign = replace(campaign, runs=tuple(replace(run, **{without: None}) for run in campaign.runs))
        diagnosis = diagnose(campaign, tolerance=Tolerance(0.0, 0.0))
        seconds = time.perf_counter() - started
        content = to_json(diagnosis)
        result = {"hidden": truth.effects, "diagnosis": content, "score": score(sealed, content), "seconds": seconds}
        if fresh:
            again = read_campaign(simulate_campaign(truth, runs, seed + FRESH, Path(folder) / "again"))
            result["fresh"] = {c.name: share for c in diagnosis.channels if (share := gain_on(again, c)) is not None}
        return result


def gain_on(campaign, found) -> float | None:
    """Share of the explainable error that a channel's extension, as fitted, removes on another campaign's runs."""
    from shockrig.analysis.diagnose.gain import kinds, summarise
    from shockrig.analysis.diagnose.held_out import plainly, run_errors
    from shockrig.analysis.diagnose.prepare import prepare
    from shockrig.analysis.estimate.gather import build_channel

    channel = build_channel(campaign, found.name)
    if not found.causes or channel is None:
        return None
    if channel.rates != found.problem.channel.rates:
        return None  # an ambient is missing in one of the two
    problem = prepare(channel, found.noise.averaged).problem
    before = run_errors(channel, problem, plainly(found.plain))
    after = run_errors(channel, problem, found.predicting.fit)
    return summarise(before, after, found.noise.standard_deviation, kinds(channel)).explained_fraction


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
        share = result.get("fresh", {}).get(name)
        low, high = gain["interval_95"]
        again = "" if share is None else f" gain {low:.4f} to {high:.4f}, fresh {share:.4f}"
        parts.append(
            f"{mark} {name[:4]} {c.verdict} hidden {list(c.hidden)} named {list(c.named)}{problem} [{errors}]"
            f" rmse {gain['held_out_rmse_before']:.3g}>{gain['held_out_rmse_after']:.3g}"
            f" noise {gain['noise_floor']:.3g}{again}"
        )
    return f"{seed} {result['seconds']:.0f}s\n    " + "\n    ".join(parts)


def tables(results: Iterable[dict]) -> str:
    """What many trials show together."""
    tally: Counter[str] = Counter()
    effects: dict[str, Counter[str]] = defaultdict(Counter)
    sigmas: list[float] = []
    stated: list[tuple[float, bool]] = []
    covered: list[bool] = []
    for result in results:
        tally["trials"] += 1
        tally["trials exact"] += result["score"].exact
        for name, c in result["score"].channels.items():
            tally["channels"] += 1
            tally["channels exact"] += c.exact
            tally["channels with the right verdict"] += c.verdict_right
            tally["channels with a wrong name"] += bool(c.wrong)
            for effect in c.hidden:
                effects[effect]["hidden"] += 1
                effects[effect][next((o for o in ("named", "listed", "missed") if effect in getattr(c, o)), "-")] += 1
                effects[effect]["exact"] += c.exact
            for effect in c.wrong:
                effects[effect]["wrongly named"] += 1
            sigmas += [abs(e.sigmas) for e in c.errors if e.sigmas is not None]
            stated += [(p, right) for _, p, right in c.probabilities]
            share = result.get("fresh", {}).get(name)
            if share is not None and c.exact:
                low, high = result["diagnosis"]["channels"][name]["gain"]["interval_95"]
                covered.append(low <= share <= high)
    lines = [f"  {key:34} {value}" for key, value in tally.items()]
    if sigmas:
        lines.append(f"  parameters within 2 sigma          {np.mean(np.array(sigmas) <= 2):.3f} of {len(sigmas)}")
    if covered:
        lines.append(f"  gain's interval holds the fresh gain {np.mean(covered):.3f} of {len(covered)} exact channels")
    if stated:
        p, right = np.array([s[0] for s in stated]), np.array([s[1] for s in stated], dtype=float)
        lines.append("  stated probability      causes   stated    right")
        for low, high in zip(BINS[:-1], BINS[1:], strict=True):
            inside = (p > low) & (p <= high)
            if inside.any():
                means = f"{inside.sum():10} {p[inside].mean():8.3f} {right[inside].mean():8.3f}"
                lines.append(f"    {low:.2f} to {high:.2f}      {means}")
    columns = ("hidden", "named", "listed", "missed", "exact", "wrongly named")
    lines.append("  " + f"{'by effect and channel':38}" + "".join(f"{c:>14}" for c in columns))
    for effect, counts in sorted(effects.items()):
        lines.append(f"    {effect:36}" + "".join(f"{counts[c]:14}" for c in columns))
    return "\n".join(lines)


def _strength(text: str) -> str | float:
    return text if text in ("comfortable", "limit", "realistic") else float(text)


def _one(arguments: tuple) -> dict:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    return trial(*arguments)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", default="one")
    parser.add_argument("--tier", default="rough", choices=("smooth", "rough", "realistic"))
    parser.add_argument(
        "--strength",
        default="comfortable",
        type=_strength,
        help="comfortable, limit (a tenth to a third of it), realistic, or the share of a comfortable strength",
    )
    parser.add_argument("--plan", default="standard", choices=("standard", "wide", "extended"))
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=5000)
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args(argv)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())  # ends after the trial at hand, with the tables so far
    seeds = range(args.first_seed, args.first_seed + args.trials)
    done, died = [], []
    work = [(args.kind, args.tier, args.strength, seed, args.plan, True) for seed in seeds]
    # No Dask: its workers would not find this folder's modules.
    for place, result in mapped(_one, work, args.workers, with_dask=False):
        if result is None:
            died.append(seeds[place])
            continue
        print(line(seeds[place], result), flush=True)
        done.append(result)
        if stop.is_set():
            break
    print(
        f"\nkind {args.kind}, plan {args.plan}, tier {args.tier}, strength {args.strength}, "
        f"{len(done)} of the seeds {seeds[0]} to {seeds[-1]}" + (f"; the process died of {died}" if died else "")
    )
    print(tables(done))
    return 0


if __name__ == "__main__":
    sys.exit(main())
