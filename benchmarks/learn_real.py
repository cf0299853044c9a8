"""Real flights of one sensor, up and down: what `shockrig learn` says of them, and how far their passes then disagree.

    python benchmarks/learn_real.py CACHE [--out results/learn_real.txt]

CACHE holds folders of logs that were fetched from public repositories (`real_cache_sets.py` says which); nothing of
them is in this repository. Of a mission that judges, no log is read here: of Lake Michigan the first one alone is.
Each flight's passes are corrected by a fit without the flight. Mean and spread are of the later pass less the earlier.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

from shockrig.analysis.learn.learn import learn
from shockrig.protocols.learning import named_flights, sentence

SETS = {
    "Lake Michigan, first mission (evans36/lakemichigan @11f5ecb, Windsond S1)": "lakemichigan/01-06012023/*.csv",
    "One Tree Island (christian-eckert/meteorology-one_tree_island, iMet-XQ2)": "one_tree/*.csv",
}


def table(cache: Path) -> list[str]:
    """Lines for each set that is in the cache."""
    lines = []
    for name, pattern in SETS.items():
        paths = sorted(cache.glob(pattern))
        if not paths:
            lines += [f"{name}: not in the cache", ""]
            continue
        began = time.process_time()
        found = learn(named_flights(paths)[0], progress=lambda said: print(said, file=sys.stderr, flush=True))
        spent = time.process_time() - began
        lines += [f"{name}: {len(found.bins)} of {len(paths)} flights, {spent:.0f} s of a core"]
        for one in found.channels.values():
            lines.append(f"  {sentence(one)}")
            for said, off in (("as read", one.read), ("best single lag", one.single), ("likeliest model", one.model)):
                lines.append(f"    {said:<16} mean {off.mean:+6.2f}   about it {off.spread:5.2f}   rms {off.rms:5.2f}")
            lines.append(f"    refuted by structure: {', '.join(one.refuted) or 'nothing'}")
        for cause in found.position:
            (shift,) = cause.parameters
            lines.append(
                f"  position: shift {shift.value:.2f} ± {shift.standard_uncertainty:.2f} s "
                f"(probability {cause.probability:.2f})"
            )
        lines += [f"  {weight:.3f}  {said}" for said, weight in found.weights[:5]] + [""]
    return lines


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cache", type=Path)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args(argv)
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False)
    text = "\n".join([f"commit {commit.stdout.strip()}", "", *table(args.cache)])
    print(text)
    if args.out is not None:
        args.out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
