"""Steps that other people measured: runs predicted that took no part, beside what one would fit without this project.

    python benchmarks/real_data.py --logs /path/to/real [--keep DIR] [--only TEXT]
    python benchmarks/real_data.py --cache DIR [--keep DIR] [--only TEXT] [--draw N [--seed S]] [--with FILE.NAME=VALUE]

Per set: the error on held-out runs of the plain and of the extended model and of each rival (`rivals.py`; the same
runs, the same folds), the ratio to the best rival and to the one that its training runs would have chosen, the verdict,
what is named, t63. Where a diagnosis leaves runs out, or has no prediction of a fold, all are judged on the runs that
it predicts. A set of one run has no held-out error: there the rivals' error is that on the run itself. At the end what
probability effects were given in the folds, and how often the runs held out bear them out: the likeliest model leaves
less of them than the likeliest one without the effect.

`--logs` is a folder with the two sets as they were published; `data/real`, taken otherwise, holds thinned parts.
`--cache` judges other sets in their place, from logs that this project does not hold (`real_cache_sets.py`
and, for the third to the fifteenth group, `real_third_sets.py` to `real_fifteenth_sets.py` say which).
"""

from __future__ import annotations

import argparse
import importlib
import os
import shutil
import sys
import tempfile
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from rivals import CHOSEN

RATIO = 1.05
FOLDS = 3
TENTHS = (*np.arange(0.0, 0.95, 0.1), 1.01)
DEFAULT_LOGS = Path(__file__).parent.parent / "data" / "real"


def folds_of(runs: int) -> int:
    """Three, or each of two runs in turn; 0 where there is nothing to leave out."""
    return 0 if runs < 2 else min(runs, FOLDS)


def part_of(campaign: Path, out: Path, ids: list[str]) -> Path:
    """The campaign with the runs `ids` (names of their folders) alone."""
    (out / "runs").mkdir(parents=True)
    shutil.copy(campaign / "campaign.json", out / "campaign.json")
    for name in ids:
        shutil.copytree(campaign / "runs" / name, out / "runs" / name)
    return out


def our_held_out(
    campaign: Path, channel: str, folds: int, scratch: Path, limit_s: int
) -> tuple[dict[str, tuple[float, float]], list[tuple[float, bool]], str]:
    """Mean square errors of each held-out run, plain and extended, each fold diagnosed without it; how probable effects
    were, and whether those runs bear them out; and the last reason why there are none of a fold. A run that a diagnosis
    leaves out has none either."""
    from ours import borne_out, fresh_run_errors, judge

    names = sorted(p.name for p in (campaign / "runs").iterdir())
    found: dict[str, tuple[float, float]] = {}
    said: list[tuple[float, bool]] = []
    why = "every run is left out"
    for k in range(folds):
        train = [n for i, n in enumerate(names) if i % folds != k]
        test = [n for i, n in enumerate(names) if i % folds == k]
        outcome = judge(part_of(campaign, scratch / f"train{k}", train), 0, limit_s, characterized=False)
        if "diagnose" in outcome.refused or "diagnose" in outcome.crashed:
            why = (outcome.refused | outcome.crashed)["diagnose"].strip().splitlines()[-1].rsplit("/", 1)[-1][:90]
            continue
        fresh = part_of(campaign, scratch / f"test{k}", test)
        both = fresh_run_errors(outcome, fresh, channel)
        if both is None:
            why = "no prediction of other runs"
            continue
        found |= {n: (b, a) for n, b, a in zip(test, *both, strict=True) if np.isfinite(a)}
        said += borne_out(outcome, fresh, channel)
    return found, said, why


def judge_set(real, logs: Path, keep: Path | None, limit_s: int) -> dict:
    """Everything the table says of one set."""
    from ours import judge, judged_from, t63
    from records import read_records
    from rivals import fit_rival, held_out, models

    with tempfile.TemporaryDirectory() as folder:
        home = (keep or Path(folder)) / real.name.replace(" ", "_").replace(",", "")
        campaign = home / "campaign"
        if not campaign.exists():
            home.mkdir(parents=True, exist_ok=True)
            real.make(logs, campaign)
        first = judged_from(campaign, real.channel)  # for rivals as well: errors are of the same readings
        runs = [replace(r, judged_from_s=first.get(r.id, -np.inf)) for r in read_records(campaign, real.channel)]
        folds = folds_of(len(runs))
        squares, said, ours = {}, [], "one run"
        if folds:
            squares, said, ours = our_held_out(campaign, real.channel, folds, Path(folder) / "folds", limit_s)
            by_run = held_out(runs, real.channel, folds)  # of the rivals, on the same runs where there are any
            rivals = {
                name: float(np.sqrt(np.mean([error**2 for run, error in e.items() if run in squares or not squares])))
                for name, e in by_run.items()
            }
        else:
            rivals = {name: fit_rival(m, runs, real.channel).train_rmse for name, m in models(real.channel).items()}
        if squares:
            before, after = np.sqrt(np.mean(list(squares.values()), axis=0))
            ours = float(before), float(after)
        outcome = judge(campaign, 0, limit_s)
        return {
            "runs": len(runs),
            "folds": folds,
            "predicted": len(squares),
            "rivals": rivals,
            "ours": ours,
            "said": said,
            "told": outcome.tells(real.channel),
            "t63": t63(outcome.extended, real.channel) or t63(outcome.plain, real.channel),
            "failed": outcome.refused | outcome.crashed,
            "seconds": outcome.seconds.get("diagnose", 0.0),
            "rival_t63": {name: fit_rival(m, runs, real.channel).t63_s for name, m in models(real.channel).items()},
        }


def report(real, r: dict) -> list[str]:
    """A set's lines in the table."""
    best = min((name for name in r["rivals"] if name != CHOSEN), key=r["rivals"].__getitem__)
    kind = f"held out in {r['folds']} folds" if r["folds"] else "on the run itself"
    lines = [f"{real.name}: {r['runs']} runs, errors {kind}"]
    lines.append("  " + ", ".join(f"{name} {error:.3g}" for name, error in r["rivals"].items()))
    if isinstance(r["ours"], str):
        lines.append(f"  ours: none ({r['ours']})")
    else:
        before, after = r["ours"]
        ratio = after / r["rivals"][best]
        mark = "ok" if ratio <= RATIO else "WORSE"
        chosen = after / r["rivals"][CHOSEN]
        part = "" if r["predicted"] == r["runs"] else f" on {r['predicted']} of them"
        lines.append(f"  ours{part}: plain {before:.3g}, extended {after:.3g}: {ratio:.2f} of the best rival")
        lines[-1] += f" ({best}) {mark}, {chosen:.2f} of that which is best in training"
    told = r["told"]
    if told is None:
        lines.append(
            "  no diagnosis: " + "; ".join(f"{k}: {v.strip().splitlines()[-1][-110:]}" for k, v in r["failed"].items())
        )
    else:
        names = [f"{c['effect']} ({c['probability']:.2f})" for c in told["causes"]]
        names += [f"discovered {d['behaves_as']}" for d in told.get("discovered") or []]
        wrong = [c["effect"] for c in told["causes"] if c["effect"] in real.forbidden]
        marked = f"; FORBIDDEN {wrong}" if wrong else ""
        spent = f"; {r['seconds']:.0f} s of the processor"
        lines.append(f"  {told['verdict']}: {', '.join(names) or 'nothing named'}{marked}{spent}")
    value, spread = r["t63"] or (None, None)
    shown = "-" if value is None else f"{value:.4g}" + ("" if spread is None else f" +- {spread:.2g}")
    known = "" if real.published_t63_s is None else f"; published or true {real.published_t63_s:.4g}"
    rivals = ", ".join(f"{name} {seconds:.4g}" for name, seconds in r["rival_t63"].items())
    lines.append(f"  t63, s: {shown}{known}; rivals, dead time left out: {rivals}")
    return lines


def reliability(said: list[tuple[float, bool]]) -> list[str]:
    """What probability effects had, and how often unseen runs bear them out."""
    lines = ["probability    effects     said    borne out"]
    stated, borne = (np.array(one, dtype=float) for one in zip(*said, strict=True))
    for low, high in pairwise(TENTHS):
        here = (stated >= low) & (stated < high)
        if here.any():
            size, mean, share = int(here.sum()), stated[here].mean(), borne[here].mean()
            lines.append(f"{low:.2f} to {min(high, 1.0):.2f}{size:11d}{mean:9.2f}{share:13.2f}")
    return lines


def main(argv: list[str] | None = None) -> int:
    from real_cache_sets import cached_sets
    from real_eighth_sets import eighth_sets
    from real_eleventh_sets import eleventh_sets
    from real_fifteenth_sets import fifteenth_sets
    from real_fifth_sets import fifth_sets
    from real_fourteenth_sets import fourteenth_sets
    from real_fourth_sets import fourth_sets
    from real_ninth_sets import ninth_sets
    from real_sets import real_sets
    from real_seventh_sets import seventh_sets
    from real_sixth_sets import sixth_sets
    from real_tenth_sets import tenth_sets
    from real_third_sets import third_sets
    from real_thirteenth_sets import thirteenth_sets
    from real_twelfth_sets import twelfth_sets

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--logs", type=Path, default=DEFAULT_LOGS, help="folder that holds haar/ and rbr/ as published")
    parser.add_argument("--cache", type=Path, help="folder of logs as published, OWNER/NAME/PATH: judge these sets")
    parser.add_argument("--keep", type=Path, help="folder to keep the campaigns in")
    parser.add_argument("--only", default="", help="sets whose name contains this text")
    parser.add_argument("--draw", type=int, help="so many of the sets, drawn at random")
    parser.add_argument("--seed", type=int, default=0, help="of that draw (0)")
    parser.add_argument("--limit", type=int, default=300, help="seconds of the processor for one command (300)")
    parser.add_argument(
        "--with",
        action="append",
        default=[],
        dest="numbers",
        metavar="FILE.NAME=VALUE",
        help="another value of a named number of analysis/estimate, as noise.BEND_ORDER=2",
    )
    args = parser.parse_args(argv)
    for one in args.numbers:
        (file, name), value = one.split("=")[0].split("."), float(one.split("=")[1])
        module = importlib.import_module(f"shockrig.analysis.estimate.{file}")
        setattr(module, name, type(getattr(module, name))(value))
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    worse = behind = 0
    said: list[tuple[float, bool]] = []
    groups = (
        *(cached_sets, third_sets, fourth_sets, fifth_sets, sixth_sets),
        *(seventh_sets, eighth_sets, ninth_sets, tenth_sets, eleventh_sets, twelfth_sets, thirteenth_sets),
        *(fourteenth_sets, fifteenth_sets),
    )
    cached = [real for group in groups for real in group()]
    sets, logs = (cached, args.cache) if args.cache else (real_sets(), args.logs)
    sets = [one for one in sets if args.only in one.name]
    if args.draw is not None:
        order = np.random.default_rng(args.seed).permutation(len(sets))
        sets = [sets[i] for i in order[: args.draw]]
    for real in sets:
        try:
            found = judge_set(real, logs, args.keep, args.limit)
        except OSError as error:  # scipy says no more than that of a missing file
            print(f"{real.name}: not judged: {error}", flush=True)
            continue
        print("\n".join(report(real, found)), flush=True)
        said += found["said"]
        if not isinstance(found["ours"], str):
            worse += found["ours"][1] > RATIO * min(e for name, e in found["rivals"].items() if name != CHOSEN)
            behind += found["ours"][1] > RATIO * found["rivals"][CHOSEN]
    print(f"\nsets with an error above {RATIO:g} of the best rival's: {worse}; of that best in training: {behind}")
    if said:
        print("\n".join(reliability(said)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
