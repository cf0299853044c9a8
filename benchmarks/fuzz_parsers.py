"""Mutated lines, frames and files through every parser and reader: only documented errors, nothing forbidden accepted.

    python benchmarks/fuzz_parsers.py [--count 1000000] [--seed 0] [--only TARGET]

Each target takes sound input, damages it (bytes flipped, cut, doubled, spliced; numbers, words and keys replaced by
hostile ones) and holds what is accepted against rules written here from the formats, not taken from the readers.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fuzz_bench import benches, frames, grbl, imet, journals, protocols
from fuzz_damage import Forbidden
from fuzz_files import campaigns, diagnoses, flights, profiles, truths


@dataclass(frozen=True)
class Target:
    """`make(rng)` gives a function that tries one damaged input and returns whether something was accepted."""

    share: float
    documented: tuple[type[Exception], ...]
    make: Callable[[random.Random, Path], Callable[[], bool]]


def targets() -> dict[str, Target]:
    from shockrig.files.errors import InputError
    from shockrig.rig.bench_errors import BenchError, StageError

    return {
        "imet": Target(0.5, (), imet),
        "frames": Target(0.3, (), frames),
        "grbl": Target(0.12, (StageError,), grbl),
        "journals": Target(0.03, (BenchError,), journals),
        "profiles": Target(0.015, (InputError,), profiles),
        "diagnoses": Target(0.005, (InputError,), diagnoses),
        "benches": Target(0.01, (BenchError,), benches),
        "protocols": Target(0.01, (BenchError,), protocols),
        "truths": Target(0.004, (BenchError,), truths),
        "campaigns": Target(0.003, (InputError,), campaigns),
        "flights": Target(0.003, (InputError,), flights),
    }


def fuzz(name: str, count: int, seed: int, folder: Path) -> tuple[Counter, Counter]:
    """Try `count` inputs on one target; (accepted, refused, wrong), and what was wrong."""
    target = targets()[name]
    rng = random.Random(f"{name} {seed}")
    tally, wrong = Counter(), Counter()
    one = target.make(rng, folder)
    for _ in range(count):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                tally["accepted" if one() else "refused"] += 1
        except target.documented as error:
            tally["refused"] += 1
            if not str(error).strip():
                wrong["an error without a word"] += 1
        except Forbidden as error:
            wrong[f"forbidden but accepted: {error}"[:160]] += 1
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            wrong[f"{type(error).__name__} at {Path(where.filename).name}:{where.lineno}: {str(error)[:100]}"] += 1
    tally["wrong"] = sum(wrong.values())
    return tally, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="")
    args = parser.parse_args()
    print(f"{'target':10} {'inputs':>8} {'accepted':>9} {'refused':>8} {'wrong':>6} {'s':>5}")
    total = Counter()
    with tempfile.TemporaryDirectory() as name:
        for target, entry in targets().items():
            if args.only in ("", target):
                count, began_s = round(entry.share * args.count), time.monotonic()
                tally, wrong = fuzz(target, count, args.seed, Path(name))
                total += tally
                cells = f"{count:8} {tally['accepted']:9} {tally['refused']:8} {tally['wrong']:6}"
                print(f"{target:10} {cells} {time.monotonic() - began_s:5.0f}", flush=True)
                for what, times in wrong.most_common(12):
                    print(f"    {times:6} {what!r}")
    inputs = sum(total.values())
    print(f"{inputs} mutated inputs, seed {args.seed}: {total['wrong']} wrong")
    return 1 if total["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
