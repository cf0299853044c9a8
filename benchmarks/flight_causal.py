"""What does waiting bring? The causal corrector at lags of 0, 1, 2 and 5 s beside the smoother, kind by kind.

    python benchmarks/flight_causal.py [--kinds NAME ...] [--seeds N] [--first-seed N] [--lags S ...] [--out FILE.jsonl]

The flights are those of flight_harm.py. One line a kind and channel: rms error of the reading, of each lag and of the
smoother, and beside each what its 95 % interval covers. Rows for which a value is given by all of them are compared.
With --out flights are JSON lines of that file, and those that it holds already are not flown again; --table prints
what a file holds.
"""

from __future__ import annotations

import argparse
import sys
import warnings
import zlib
from pathlib import Path

import numpy as np
from flight_harm import ABSURD, CHANNELS, SIGMAS, profile_of, rms
from flight_kinds import KINDS
from flight_worlds import fly
from resumed import kept, scored

from shockrig.analysis.flight.correct import correct
from shockrig.files.flight import Flight

LAGS_S = (0.0, 1.0, 2.0, 5.0)


def score(name: str, seed: int, lags: tuple[float, ...]) -> list[dict]:
    """Both channels of one flight."""
    world = KINDS[name](np.random.default_rng([seed, zlib.crc32(name.encode())]))
    flown = fly(world, seed + zlib.crc32(name.encode()))  # other sensors in each kind
    log = flown.log
    unknown = np.full(log["time_s"].size, np.nan)
    readings = (log["time_s"], log["temperature_c"], log["humidity_percent"])
    flight = Flight(*readings, unknown, unknown, unknown, altitude_m=log["altitude_m"])
    profile = profile_of(world)
    done = {f"{lag:g} s": correct(flight, profile, "causal", lag_s=lag) for lag in lags}
    done["smoother"] = correct(flight, profile)
    lines = []
    for channel in CHANNELS:
        truth, reading = flown.truth[channel], log[channel]
        right = np.isfinite(reading) & ~np.isin(reading, ABSURD)
        rows = right & np.logical_and.reduce([np.isfinite(getattr(one, channel)) for one in done.values()])
        line = {"kind": name, "seed": seed, "channel": channel, "given": float(rows.sum() / right.sum())}
        line["reading"] = rms(reading[rows] - truth[rows])
        for how, one in done.items():
            off = np.abs(getattr(one, channel) - truth)
            line[how] = rms(off[rows])
            sigma = getattr(one, SIGMAS[channel])
            known = rows & np.isfinite(sigma)
            line[f"{how} covered"] = float(np.mean(off[known] <= 1.96 * sigma[known])) if known.any() else float("nan")
        lines.append(line)
    return lines


def table(lines: list[dict]) -> None:
    """A row for each kind and channel, and geometric means over all of them."""
    hows = [key.removesuffix(" covered") for key in lines[0] if key.endswith(" covered")]
    print(f"{'kind':<22}{'channel':<10}{'reading':>9}" + "".join(f"{how:>10}{'cov':>6}" for how in hows))
    groups: dict[tuple[str, str], list[dict]] = {}
    for line in lines:
        groups.setdefault((line["kind"], line["channel"]), []).append(line)
    ratios: dict[str, dict[str, list[float]]] = {channel: {how: [] for how in hows} for channel in CHANNELS}
    held: dict[str, list[float]] = {how: [] for how in hows}
    for (kind, channel), flights in groups.items():
        size = {key: rms(np.array([f[key] for f in flights])) for key in ("reading", *hows)}
        text = f"{kind:<22}{channel.split('_')[0][:8]:<10}{size['reading']:>9.4f}"
        for how in hows:
            stated = [f[f"{how} covered"] for f in flights if np.isfinite(f[f"{how} covered"])]
            covered = float(np.mean(stated)) if stated else float("nan")
            text += f"{size[how]:>10.4f}{covered:>6.2f}"
            ratios[channel][how].append(size[how] / size["reading"])
            held[how].append(covered)
        print(text)
    for channel in CHANNELS:
        means = "".join(f"{np.exp(np.mean(np.log(ratios[channel][how]))):>10.3f}{'':>6}" for how in hows)
        print(f"{'error over reading':<22}{channel.split('_')[0][:8]:<10}{'':>9}{means}")
    inside = "".join(
        f"{np.sum((np.array(held[how]) >= 0.9) & (np.array(held[how]) <= 0.98)):>10}{'':>6}" for how in hows
    )
    low = "".join(f"{np.sum(np.array(held[how]) < 0.9):>10}{'':>6}" for how in hows)
    print(f"{'covered 90 to 98 %':<41}{inside}\n{'covered by less':<41}{low}   of {len(groups)}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", default=list(KINDS))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--lags", nargs="+", type=float, default=list(LAGS_S))
    parser.add_argument("--out", type=Path)
    parser.add_argument("--table", type=Path, help="print what this file holds, and fly nothing")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    if args.table:
        table(kept(args.table))
        return 0
    jobs = [(name, seed) for seed in range(args.first_seed, args.first_seed + args.seeds) for name in args.kinds]
    table(scored(args.out, jobs, ("kind", "seed"), lambda name, seed: score(name, seed, tuple(args.lags))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
