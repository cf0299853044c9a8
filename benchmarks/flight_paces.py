"""Flights whose rows are not evenly spaced: packets that were lost, logs of two paces, beside all rows and a third.

    python benchmarks/flight_paces.py [--seeds N] [--first-seed N] [--out FILE.jsonl]

Kinds of flight_harm.py and flight_fresh.py. A line a channel and pattern: error over the reading's (geometric mean over
flights), share of rows that the 95 % interval covers, flights more than 2 % worse than their reading, and flights of
whose sensor a note says that it changed, or that its temperature moved without the humidity; none did.
"""

from __future__ import annotations

import argparse
import sys
import warnings
import zlib
from pathlib import Path

import numpy as np
from flight_fresh import FRESH
from flight_harm import CHANNELS, SIGMAS, profile_of, rms
from flight_kinds import KINDS
from flight_worlds import changed, fly
from fuzz_flights import WORSE
from resumed import scored

from shockrig.analysis.flight.correct import correct
from shockrig.files.flight import Flight

Array = np.ndarray
NAMES = (
    "convective", "front", "inversion", "inversion, turbulent", "inversion, sharp", "stairs", "waves", "plumes", "hops",
    "cold pool, twice", "door, in and out",
)  # fmt: skip
PERIODS_S = (0.2, 0.5)
PATTERNS = ("all", "a third", "30 % lost", "60 % lost", "two paces", "by turns")
UNTRUE = ("the sensor changed", "without the humidity")


def kept(pattern: str, count: int, rng: np.random.Generator) -> Array:
    """Which of so many rows were logged."""
    row = np.arange(count)
    slower = row % int(rng.choice([2, 3, 5])) == 0
    cut = rng.uniform(0.3, 0.7) * count
    return {
        "all": row >= 0,
        "a third": row % 3 == 0,
        "30 % lost": rng.random(count) > 0.3,
        "60 % lost": rng.random(count) > 0.6,
        "two paces": slower | ((row < cut) == (rng.random() < 0.5)),
        "by turns": (row % 5 == 0) | (row // 40 % 2 == 0),
    }[pattern]


def score(name: str, seed: int) -> list[dict]:
    """Both channels of one flight, for each period and pattern."""
    lines = []
    for period_s in PERIODS_S:
        own = zlib.crc32(name.encode())
        world = changed((KINDS | FRESH)[name](np.random.default_rng([seed, own])), period_s=period_s)
        flown = fly(world, seed + own)
        for pattern in PATTERNS:
            rows = kept(pattern, flown.log["time_s"].size, np.random.default_rng([seed, 5]))
            log, truth = ({key: values[rows] for key, values in of.items()} for of in (flown.log, flown.truth))
            unknown = np.full(log["time_s"].size, np.nan)
            readings = (log["time_s"], log["temperature_c"], log["humidity_percent"])
            done = correct(Flight(*readings, unknown, unknown, unknown, log["altitude_m"]), profile_of(world))
            for channel in CHANNELS:
                value, sigma = getattr(done, channel), getattr(done, SIGMAS[channel])
                given = np.isfinite(value)
                off = np.abs(value - truth[channel])[given]
                line: dict = {"kind": name, "seed": seed, "period_s": period_s, "pattern": pattern, "channel": channel}
                line["ours"], line["reading"] = rms(off), rms((log[channel] - truth[channel])[given])
                line["covered"] = float(np.mean(off <= 1.96 * sigma[given]))
                named = [note for note in done.notes if note.startswith(channel.split("_")[0])]
                line["untrue"] = any(said in note for note in named for said in UNTRUE)
                lines.append(line)
    return lines


def table(lines: list[dict]) -> None:
    """A row for each channel and pattern."""
    print(f"{'rows':<12}{'channel':<13}{'flights':>8}{'error':>8}{'covered':>9}{'worse':>7}{'untrue':>8}")
    for channel in CHANNELS:
        for pattern in PATTERNS:
            some = [one for one in lines if (one["channel"], one["pattern"]) == (channel, pattern)]
            ratio = np.array([one["ours"] / one["reading"] for one in some])
            print(
                f"{pattern:<12}{channel.split('_')[0]:<13}{len(some):>8}{np.exp(np.log(ratio).mean()):>8.3f}"
                f"{np.mean([one['covered'] for one in some]):>9.3f}{np.count_nonzero(ratio > WORSE):>7}"
                f"{sum(one['untrue'] for one in some):>8}"
            )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    jobs = [(name, seed) for name in NAMES for seed in range(args.first_seed, args.first_seed + args.seeds)]
    table(scored(args.out, jobs, ("kind", "seed"), score))
    return 0


if __name__ == "__main__":
    sys.exit(main())
