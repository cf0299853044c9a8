"""Descriptions of effects that nobody listed, against the truth: an entry of the catalogue is taken away and hidden.

    python benchmarks/discovery.py --kind one_out --seeds 2 --first-seed 100 [--effects stem_conduction,...]
    python benchmarks/discovery.py --kind none --seeds 10
    python benchmarks/discovery.py --kind two --seeds 4
    python benchmarks/discovery.py --tables

Each trial appends one line to benchmarks/results/discovery.jsonl (one that is there already is not made again);
`--tables` says what all lines there show. Kinds:
one_out (an entry taken away and hidden, or an effect from outside of the catalogue), none (plain worlds), two (two
catalogued effects, nothing taken away). Tolerances are 0: every significant remainder is material.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from discovery_right import BESIDE, NUMBERS, RH, RIGHT, T, is_right, plan_for, unrecorded_plan

if TYPE_CHECKING:
    from shockrig.analysis.diagnosis.diagnose import ChannelDiagnosis
    from shockrig.analysis.inference.channel import Channel

RESULTS = Path(__file__).parent / "results" / "discovery.jsonl"
FRESH = 1_000_000
# Airflows [m/s] and further ambients [degC] that no standard campaign records: within what it does, and beyond.
BETWEEN, BEYOND = ((4.0, 8.5), (5.0, 25.0)), ((1.5, 18.0), (-8.0, 48.0))


def run(kind: str, effect: str, channel: str, seed: int, tier: str) -> dict:
    """Record a world, diagnose a channel of it without the hidden effect's entry, and score the description."""
    from shockrig.analysis.diagnosis.diagnose import diagnose_channel
    from shockrig.analysis.diagnosis.remainder import Tolerance
    from shockrig.analysis.effects import CATALOGUE
    from shockrig.analysis.inference.gather import build_channel
    from shockrig.files.campaign import read_campaign
    from shockrig.files.discovered import plain
    from shockrig.rig.virtual.batch import simulate_campaign
    from shockrig.rig.virtual.hide import draw_effect, draw_hidden
    from shockrig.rig.virtual.truth import draw_truth

    rng = np.random.default_rng(seed)
    hidden = [draw_effect(rng, effect, "comfortable", channel)] if kind == "one_out" else []
    hidden += [draw_effect(rng, other, "comfortable") for other in BESIDE.get(effect, ())]
    if kind == "two":
        hidden = draw_hidden(rng, 2)
    truth = draw_truth(rng, tier, hidden)
    with tempfile.TemporaryDirectory() as folder:
        plan = plan_for(effect)
        path = simulate_campaign(truth, plan, rng, Path(folder) / "campaign")
        data = build_channel(read_campaign(path), channel)
        taken, order = CATALOGUE.get(effect) if kind == "one_out" else None, dict(CATALOGUE)
        began = time.process_time()
        try:
            if taken is not None:
                del CATALOGUE[effect]
            found = diagnose_channel(data, tolerance=Tolerance(0.0, 0.0))
        finally:
            CATALOGUE.clear()
            CATALOGUE.update(order)
        seconds = time.process_time() - began
        fresh, elsewhere = None, []
        if kind == "one_out" and found.described is not None:

            def recorded(name: str, plan: list, place: int) -> Channel | None:
                at = seed + place * FRESH
                return build_channel(read_campaign(simulate_campaign(truth, plan, at, Path(folder) / name)), channel)

            fresh = fresh_gain(recorded("again", plan, 1), found)
            for place, (airflows, more) in enumerate((BETWEEN, BEYOND), 2):
                # A rate of the film is known at the ambients recorded, that of the bead at all.
                plan = unrecorded_plan(airflows, more if channel == T else ())
                elsewhere.append(errors(recorded(f"elsewhere {place}", plan, place), found))
    return {
        "commit": subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True
        ).stdout.strip(),
        "kind": kind,
        "effect": effect,
        "channel": channel,
        "seed": seed,
        "tier": tier,
        "hidden": {h.effect: h.parameters for h in truth.effects if channel in h.channels},
        "verdict": found.verdict,
        "causes": [cause.effect for cause in found.causes],
        "certainty": {c.effect: [round(c.probability, 3), *c.indistinguishable_from] for c in found.causes},
        "discovered": [plain(one) for one in found.discovered],
        "held_out": [found.gain.before, found.gain.after, found.gain.noise_floor],
        "fresh_share": fresh,
        "elsewhere": elsewhere,
        "seconds": round(seconds, 1),
    }


def fresh_gain(channel: Channel | None, found: ChannelDiagnosis) -> float | None:
    """Share of the explainable error that the description, as fitted, removes on a fresh campaign of the same world."""
    from shockrig.analysis.diagnosis.gain import kinds, plainly, run_errors, summarise
    from shockrig.analysis.diagnosis.prepare import prepare

    if channel is None or channel.rates != found.problem.channel.rates:
        return None
    problem = prepare(channel, found.noise.averaged).problem
    before = run_errors(channel, problem, plainly(found.plain))
    after = run_errors(channel, problem, found.final)
    return summarise(before, after, found.noise.standard_deviation, kinds(channel)).explained_fraction


def errors(channel: Channel | None, found: ChannelDiagnosis) -> tuple[float, float] | None:
    """Root-mean-square error on a campaign without and with what was described."""
    from shockrig.analysis.diagnosis.gain import run_errors
    from shockrig.analysis.diagnosis.prepare import prepare

    if channel is None or channel.rates != found.problem.channel.rates:
        return None
    problem = prepare(channel, found.noise.averaged).problem
    without = found.described.discovery.without
    return tuple(float(np.sqrt(run_errors(channel, problem, one).mean())) for one in (without, found.final))


def scored(result: dict) -> dict[str, object]:
    """What one trial of `one_out` shows."""
    effect, channel, told = result["effect"], result["channel"], result["discovered"]
    named = [one for one in told if is_right(one, effect, channel)]
    listed = [one for one in told if any(is_right(other, effect, channel) for other in one.get("alternatives", []))]
    single = len(told) == 1 and not told[0].get("alternatives")
    score: dict[str, object] = {
        "flagged": result["verdict"] != "adequate",
        "catalogued": bool(result["causes"]) and not told,
        "described": bool(told),
        "right": bool(named),
        "in the set": bool(named or listed),
        "single and wrong": single and not named,
        "numbers": [],
    }
    if named and effect in result["hidden"]:
        one, off = named[0], []
        for name, true in result["hidden"][effect].items():
            key = NUMBERS.get((effect, name))
            value = _number(one, key) if key else None
            if value is not None and one["behaves_as"] != "added_rate":
                # A swing of the other sign is the same half a turn on.
                ratio = abs(value / true) if one["behaves_as"] == "periodic" else value / true
                off.append((key, ratio - 1.0))
        score["numbers"] = off
    return score


def _number(one: dict, key: str) -> float | None:
    if key in ("size", "time_constant_s", "period_s"):
        return one[key]["value"] if key in one else None
    return next((on["value"] for on in one["depends_on"] if on["factor"] == key), None)


def tables(lines: list[dict]) -> str:
    """What all trials show together."""
    out = []
    for kind, title in (("none", "plain worlds"), ("two", "two catalogued effects at once")):
        some = [r for r in lines if r["kind"] == kind]
        if some:
            told = sum(bool(r["discovered"]) for r in some)
            verdicts = defaultdict(int)
            for r in some:
                verdicts[r["verdict"]] += 1
            out.append(f"{title}: {len(some)} channels, {told} with anything discovered; {dict(verdicts)}")
    rows = defaultdict(list)
    for r in lines:
        if r["kind"] == "one_out":
            rows[r["effect"], r["channel"]].append(r)
    keys = ("flagged", "catalogued", "described", "right", "in the set", "single and wrong")
    if rows:
        head = "".join(f"{k:>17}" for k in keys)
        out.append(f"  {'hidden and taken away':42}{'trials':>7}{head}{'fresh gain':>12}{'worst number':>14}{'s':>7}")
    total, count = defaultdict(int), 0
    gains: list[float] = []
    for (effect, channel), some in sorted(rows.items()):
        scores = [scored(r) for r in some]
        cells = [sum(bool(s[k]) for s in scores) for k in keys]
        for k, v in zip(keys, cells, strict=True):
            total[k] += v
        count += len(some)
        fresh = [r["fresh_share"] for r in some if r["fresh_share"] is not None]
        gains += fresh
        off = [abs(v) for s in scores for _, v in s["numbers"]]
        numbers = f"{100 * max(off):12.1f} %" if off else f"{'-':>14}"
        shown = f"{np.min(fresh):12.3f}" if fresh else f"{'-':>12}"
        seconds = max(r["seconds"] for r in some)
        columns = "".join(f"{c:17}" for c in cells)
        out.append(f"  {effect + ', ' + channel:42}{len(some):7}{columns}{shown}{numbers}{seconds:7.0f}")
    if count:
        out.append(f"  {'all':42}{count:7}" + "".join(f"{total[k]:17}" for k in keys))
    if gains:
        share = np.mean(np.array(gains) >= 0.9)
        out.append(
            f"  of the explainable error of a fresh campaign at least 0.9 is removed in {share:.2f} of {len(gains)}"
        )
    return "\n".join(out)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", choices=("one_out", "none", "two"), default="one_out")
    parser.add_argument("--effects", default="", help="ids, comma separated; all that can be scored if left out")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--tier", choices=("smooth", "rough"), default="rough")
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--tables", action="store_true", help="only say what is recorded")
    args = parser.parse_args(argv)
    if args.tables:
        lines = [json.loads(line) for line in args.results.read_text(encoding="utf-8").splitlines()]
        print(tables(lines))
        return 0
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    wanted = [e for e in args.effects.split(",") if e]
    pairs = [pair for pair in RIGHT if not wanted or pair[0] in wanted]
    if args.kind != "one_out":
        pairs = [("", T), ("", RH)]
    done = set()
    if args.results.exists():
        told = map(json.loads, args.results.read_text(encoding="utf-8").splitlines())
        done = {tuple(r[k] for k in ("kind", "effect", "channel", "seed", "tier")) for r in told}
    for seed in range(args.first_seed, args.first_seed + args.seeds):
        for effect, channel in pairs:
            if (args.kind, effect, channel, seed, args.tier) in done:
                continue
            result = run(args.kind, effect, channel, seed, args.tier)
            with args.results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(result) + "\n")
            said = [
                (d["behaves_as"], d["driver"], [on["factor"] for on in d["depends_on"]]) for d in result["discovered"]
            ]
            print(
                seed,
                effect,
                channel,
                result["verdict"],
                result["causes"],
                said,
                f"{result['seconds']:.0f} s",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
