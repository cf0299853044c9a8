"""Other people's benches, simulated: is t63 within its stated uncertainty, is nothing named that is not there, is no
extension worse on fresh runs?

    python benchmarks/foreign_benches.py --seeds 20 --first-seed 0 --workers 2 --state trials.jsonl

prints a line a trial and tables at the end. `--state` keeps every trial and goes on where a run was broken off;
`--keep DIR` keeps the campaigns.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np

from shockrig.protocols.parallel import mapped

WORSE = 0.02  # an extension may not be worse than this on fresh runs


def trial(name: str, seed: int, keep: str | None = None, limit_s: int = 300) -> dict:
    """One bench of a class: recorded, judged, and judged again on fresh runs of the same bench."""
    from foreign_lab import record
    from foreign_worlds import draw
    from ours import fresh_errors, judge, rate, t63

    world = draw(name, seed)
    channel = world.bench.channel
    with tempfile.TemporaryDirectory() as scratch:
        home = Path(keep) / f"{name}-{seed}" if keep else Path(scratch)
        if not (home / "campaign").exists():
            record(world.bench, seed, home / "campaign")
            record(world.fresh, seed + 1_000_000, home / "fresh")
        outcome = judge(home / "campaign", seed, limit_s)
        truth = world.bench.body
        result: dict = {"class": name, "seed": seed, "channel": channel, "words": world.words, "path": str(home)}
        result["t63_true"] = truth.time_to_s(1.0 - np.exp(-1.0))
        result["rate_true"] = truth.rate_per_s * (4e-4 if channel == "temperature" else 1e-5) ** 2
        for which, profile in (("plain", outcome.plain), ("extended", outcome.extended)):
            result[f"t63_{which}"] = t63(profile, channel)
            result[f"rate_{which}"] = rate(profile, channel)
        told = outcome.tells(channel)
        if told is not None:
            result["verdict"], result["gain"] = told["verdict"], told["gain"]
            result["named"] = [(c["effect"], c["probability"], world.is_false(c)) for c in told["causes"]]
            found = [d["behaves_as"] for d in told.get("discovered") or []]
            result["discovered"] = [(d, not world.deviates) for d in found]
            result["parameters"] = {c["effect"]: c["parameters"] for c in told["causes"]}
            try:
                result["fresh"] = fresh_errors(outcome, home / "fresh", channel)
            except Exception as error:  # a benchmark counts every fault and goes on
                outcome.crashed["fresh"] = repr(error)
        result |= {"refused": outcome.refused, "crashed": outcome.crashed, "seconds": outcome.seconds}
        return result


def deviation(told: list | None, true: float) -> float | None:
    """How many standard uncertainties a stated value is off; None where value or uncertainty is missing."""
    if not told or told[1] is None:
        return None
    return (told[0] - true) / told[1] if told[1] > 0 else float("inf")


def line(r: dict) -> str:
    """A trial in a few words."""
    parts = [f"{r['class']} {r['seed']} {r['channel'][:4]} {r['words']}:"]
    for which in ("plain", "extended"):
        told = r[f"t63_{which}"]
        if told is not None:
            z = deviation(told, r["t63_true"])
            stated = "no uncertainty" if z is None else f"{z:+.1f} sigma"
            parts.append(f"{which} t63 {100 * (told[0] / r['t63_true'] - 1):+.2f} % ({stated})")
    if "verdict" in r:
        names = [f"{effect}{'!' if false else ''}({p:.2f})" for effect, p, false in r["named"]]
        names += [f"discovered {d}{'!' if false else ''}" for d, false in r["discovered"]]
        g = r["gain"]
        parts.append(f"{r['verdict']} {' '.join(names)}".rstrip())
        shown = [g.get(k) for k in ("held_out_rmse_before", "held_out_rmse_after", "noise_floor")]
        parts.append("held {}>{} noise {}".format(*("-" if x is None else f"{x:.3g}" for x in shown)))
    if r.get("fresh"):
        parts.append("fresh {:.3g}>{:.3g}".format(*r["fresh"]))
    parts += [f"REFUSED {command}: {text.rsplit('/', 1)[-1][:110]}" for command, text in r["refused"].items()]
    parts += [f"CRASHED {command}: {text.strip().splitlines()[-1][:110]}" for command, text in r["crashed"].items()]
    return "  ".join(parts) + f"  {sum(r['seconds'].values()):.0f} s"


def growth(r: dict) -> float | None:
    """By how much the extension's error on fresh runs is above the plain model's, as a share of it."""
    return r["fresh"][1] / r["fresh"][0] - 1.0 if r.get("fresh") else None


def table(results: list[dict]) -> str:
    """By class: coverage of t63 by both profiles, false names, worst growth, what failed."""
    groups: dict[str, list[dict]] = defaultdict(list)
    for r in results:
        groups[r["class"]].append(r)
    head = (
        f"{'class':14}{'trials':>7}{'t63 plain: n':>14}{'in 2 s':>8}{'median err':>11}{'t63 ext: n':>12}{'in 2 s':>8}"
        f"{'no unc.':>8}{'false':>7}{'named':>7}{'worst growth':>14}{'refused':>9}{'crashed':>9}{'median s':>10}"
    )
    lines = [head]
    for name, group in [*groups.items(), ("all", results)]:
        cells = f"{name:14}{len(group):7}"
        for which in ("plain", "extended"):
            told = [r[f"t63_{which}"] for r in group]
            z = [deviation(t, r["t63_true"]) for t, r in zip(told, group, strict=True)]
            stated = [abs(x) <= 2.0 for x in z if x is not None]
            share = f"{100 * np.mean(stated):6.0f} %" if stated else f"{'-':>8}"
            if which == "plain":
                off = [abs(t[0] / r["t63_true"] - 1) for t, r in zip(told, group, strict=True) if t]
                cells += f"{len(stated):14}{share}" + (f"{100 * np.median(off):9.2f} %" if off else f"{'-':>11}")
            else:
                cells += f"{len(stated):12}{share}{sum(t is not None for t in told) - len(stated):8}"
        false = sum(
            any(f for *_, f in r.get("named", [])) or any(f for *_, f in r.get("discovered", [])) for r in group
        )
        grown = [g for r in group if (g := growth(r)) is not None]
        worst = f"{100 * max(grown):+.1f} %" if grown else "-"
        cells += f"{false:7}{sum(bool(r.get('named')) for r in group):7}{worst:>14}"
        cells += f"{sum(bool(r['refused']) for r in group):9}{sum(bool(r['crashed']) for r in group):9}"
        lines.append(cells + f"{np.median([sum(r['seconds'].values()) for r in group]):10.0f}")
    names: dict[str, int] = defaultdict(int)
    for r in results:
        for effect, _, false in r.get("named", []):
            names[effect] += bool(false)
    verdicts: dict[str, int] = defaultdict(int)
    for r in results:
        verdicts[r.get("verdict", "none")] += 1
    lines.append("verdicts: " + ", ".join(f"{k} {v}" for k, v in sorted(verdicts.items())))
    lines.append("falsely named: " + (", ".join(f"{k} {v}" for k, v in sorted(names.items()) if v) or "none"))
    worse = [r for r in results if (growth(r) or 0.0) > WORSE]
    lines.append(f"extensions worse on fresh runs by more than {100 * WORSE:.0f} %: {len(worse)}")
    lines += pairs(groups)
    return "\n".join(lines)


def pairs(groups: dict[str, list[dict]]) -> list[str]:
    """Stated relative uncertainty of the rate behind a slow chamber with a measured air, beside that by ideal steps."""
    from foreign_worlds import PAIRED

    lines = []
    for ideal, slow in PAIRED.items():
        stated = [{r["seed"]: r["rate_plain"] for r in groups[name] if r["rate_plain"]} for name in (slow, ideal)]
        relative = [{seed: told[1] / told[0] for seed, told in one.items()} for one in stated]
        ratios = [relative[0][seed] / relative[1][seed] for seed in sorted(set(relative[0]) & set(relative[1]))]
        if ratios:
            middle, most = np.median(ratios), np.max(ratios)
            within = np.mean(np.array(ratios) <= 1.5)
            lines.append(
                f"u(rate) {slow} over {ideal}, the same sensors: median {middle:.2f}, largest {most:.2f}, "
                f"at most 1.5 in {100 * within:.0f} % of {len(ratios)}"
            )
    return lines


def _one(work: tuple) -> dict:
    return trial(*work)


def main(argv: list[str] | None = None) -> int:
    from foreign_worlds import CLASSES

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--classes", nargs="+", default=list(CLASSES), choices=CLASSES, metavar="CLASS")
    parser.add_argument("--seeds", type=int, default=20, help="how many of each class, in a row (20)")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--limit", type=int, default=300, help="seconds of the processor for one command (300)")
    parser.add_argument("--state", type=Path, help="file of the trials done: kept, and gone on with")
    parser.add_argument("--keep", help="folder to keep the campaigns in")
    args = parser.parse_args(argv)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    wanted = [(name, seed) for seed in seeds for name in args.classes]
    known = {}
    if args.state and args.state.exists():
        rows = (json.loads(text) for text in args.state.read_text(encoding="utf-8").splitlines() if text.endswith("}"))
        known = {(r["class"], r["seed"]): r for r in rows}
    missing = [(*w, args.keep, args.limit) for w in wanted if w not in known]
    # No Dask: its workers would not find this folder's modules.
    for place, result in mapped(_one, missing, args.workers, with_dask=False):
        if result is None:
            print(f"{missing[place][:2]}: the process died")
            continue
        print(line(result), flush=True)
        known[result["class"], result["seed"]] = result
        if args.state:
            with args.state.open("a", encoding="utf-8") as file:
                file.write(json.dumps(result) + "\n")
    done = [known[w] for name in args.classes for w in wanted if w[0] == name and w in known]
    print(f"\nseeds {seeds[0]} to {seeds[-1]} of each class")
    print(table(done))
    return 0


if __name__ == "__main__":
    sys.exit(main())
