"""What does waiting bring? The causal corrector at lags of 0, 1, 2 and 5 s beside the smoother, kind by kind.

    python benchmarks/flight_causal.py [--kinds NAME ...] [--seeds N] [--first-seed N] [--lags S ...] [--out FILE.jsonl]

The flights are those of flight_harm.py. One line a kind and channel: rms error of the reading, of each lag and of the
smoother, and beside each what its 95 % interval covers. Rows for which a value is given by all of them are compared.
With --out flights are JSON lines of that file, and those that it holds already are not flown again; --table prints
what a file holds, and with --parts what of the errors is constant over a flight: such a flight is covered or not as a
whole, and only many flights tell. --innovations asks instead whether readings themselves tell of a wrong profile: how
far they are from what the filters expected of them, squared, over its variance, and how much one goes with the next.
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
from flight_worlds import Flown, fly
from resumed import kept, scored

from shockrig.analysis.flight.causal import CausalChannel, Corrector, rows_of
from shockrig.analysis.flight.causal_bank import Bank
from shockrig.analysis.flight.causal_design import design_of
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.files.flight import Flight
from shockrig.files.profile import Profile

LAGS_S = (0.0, 1.0, 2.0, 5.0)
SETTLED_ROWS = 50
WRONG = (  # kinds whose profile, or whose sensors, are not as stated
    "D stated 20 % high", "D stated 20 % low", "noise three times", "sun bursts", "icing", "fan failure",
    "second lag", "film in RH", "late die", "logger mean", "hysteresis",
    "fan failure, both ways", "its own wash", "hygrometer warms up", "supply sags",
)  # fmt: skip


def flight_of(name: str, seed: int) -> tuple[Flown, Flight, Profile]:
    """A flight of that kind, its log, and the lab's profile of its sensors."""
    world = KINDS[name](np.random.default_rng([seed, zlib.crc32(name.encode())]))
    flown = fly(world, seed + zlib.crc32(name.encode()))  # other sensors in each kind
    log = flown.log
    unknown = np.full(log["time_s"].size, np.nan)
    readings = (log["time_s"], log["temperature_c"], log["humidity_percent"])
    return flown, Flight(*readings, unknown, unknown, unknown, altitude_m=log["altitude_m"]), profile_of(world)


class WatchedBank(Bank):
    """Filters whose innovations are kept, each over its standard deviation."""

    def __init__(self, channel: CausalChannel, passing: bool) -> None:
        super().__init__(channel.design.ladder, channel.design.modes, passing)
        self.innovations: list[float] = []

    def update(self, reading: float, noise_variance: float) -> None:
        expected, variance = self.expected()
        self.innovations.append((reading - expected) / np.sqrt(variance + noise_variance))
        super().update(reading, noise_variance)


def innovations(name: str, seed: int) -> dict[str, tuple[float, float]]:
    """Mean square of each channel's innovations over their variance, and their correlation with the next."""
    _, flight, profile = flight_of(name, seed)
    corrector = Corrector(design_of(profile, typical_period(flight.time_s[np.isfinite(flight.time_s)])))
    found = {}
    for channel, own in zip(CHANNELS, (corrector.bead, corrector.film), strict=True):
        own.bank = found[channel] = WatchedBank(own, own.bank.passing)
    for row in rows_of(flight):
        corrector.step(row)
    seen = {channel: np.array(bank.innovations[SETTLED_ROWS:]) for channel, bank in found.items()}
    return {channel: (float(np.mean(x**2)), float(np.corrcoef(x[:-1], x[1:])[0, 1])) for channel, x in seen.items()}


def table_of_innovations(kinds: list[str], seeds: range) -> None:
    print(f"{'squares over variance, correlation with the next':<50}" + "".join(f"{name:>20}" for name in CHANNELS))
    for name in kinds:
        flights = [innovations(name, seed) for seed in seeds]
        means = [np.mean([one[channel] for one in flights], axis=0) for channel in CHANNELS]
        said = "profile wrong" if name in WRONG else ""
        print(
            f"{name:<30}{said:<20}" + "".join(f"{square:>13.2f}{next_:>+7.2f}" for square, next_ in means), flush=True
        )


def score(name: str, seed: int, lags: tuple[float, ...]) -> list[dict]:
    """Both channels of one flight."""
    flown, flight, profile = flight_of(name, seed)
    log = flown.log
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
            off, sigma = getattr(one, channel) - truth, getattr(one, SIGMAS[channel])
            line[how] = rms(off[rows])
            known = rows & np.isfinite(sigma)
            off, sigma = off[known], sigma[known]
            line[f"{how} rows"] = int(known.sum())
            line[f"{how} covered"] = float(np.mean(np.abs(off) <= 1.96 * sigma))
            line[f"{how} parts"] = [float(np.mean(off)), float(np.std(off)), float(np.mean(sigma))]
        lines.append(line)
    return lines


def coverage(flights: list[dict], how: str) -> float:
    """Share of all rows of a kind's flights whose 95 % interval holds the truth."""
    stated = [f for f in flights if f[f"{how} rows"]]
    rows = sum(f[f"{how} rows"] for f in stated)
    return sum(f[f"{how} covered"] * f[f"{how} rows"] for f in stated) / rows if rows else float("nan")


def table_of_parts(lines: list[dict]) -> None:
    """Of each kind and channel: errors that are constant over a flight, errors about that, and what is stated."""
    hows = [key.removesuffix(" covered") for key in lines[0] if key.endswith(" covered")]
    print(f"{'kind':<22}{'channel':<10}" + "".join(f"{how:>17}{'constant':>9}{'stated':>8}{'cov':>5}" for how in hows))
    for (kind, channel), flights in grouped(lines).items():
        text = f"{kind:<22}{channel.split('_')[0][:8]:<10}"
        for how in hows:
            constant, moving, stated = (rms(part) for part in np.array([f[f"{how} parts"] for f in flights]).T)
            text += f"{moving:>17.4f}{constant:>9.4f}{stated:>8.4f}{coverage(flights, how):>5.2f}"
        print(text)


def grouped(lines: list[dict]) -> dict[tuple[str, str], list[dict]]:
    """Flights of each kind and channel."""
    groups: dict[tuple[str, str], list[dict]] = {}
    for line in lines:
        groups.setdefault((line["kind"], line["channel"]), []).append(line)
    return groups


def table(lines: list[dict]) -> None:
    """A row for each kind and channel, and geometric means over all of them."""
    hows = [key.removesuffix(" covered") for key in lines[0] if key.endswith(" covered")]
    print(f"{'kind':<22}{'channel':<10}{'reading':>9}" + "".join(f"{how:>10}{'cov':>6}" for how in hows))
    groups = grouped(lines)
    ratios: dict[str, dict[str, list[float]]] = {channel: {how: [] for how in hows} for channel in CHANNELS}
    held: dict[tuple[str, str], dict[str, float]] = {(channel, how): {} for channel in CHANNELS for how in hows}
    for (kind, channel), flights in groups.items():
        size = {key: rms(np.array([f[key] for f in flights])) for key in ("reading", *hows)}
        text = f"{kind:<22}{channel.split('_')[0][:8]:<10}{size['reading']:>9.4f}"
        for how in hows:
            covered = coverage(flights, how)
            text += f"{size[how]:>10.4f}{covered:>6.2f}"
            ratios[channel][how].append(size[how] / size["reading"])
            held[channel, how][kind] = covered
        print(text)
    for channel in CHANNELS:
        means = "".join(f"{np.exp(np.mean(np.log(ratios[channel][how]))):>10.3f}{'':>6}" for how in hows)
        print(f"{'error over reading':<22}{channel.split('_')[0][:8]:<10}{'':>9}{means}")
    counts = {
        "covered by 90 to 98 %": lambda kind, covered: 0.9 <= covered <= 0.98,
        "by less": lambda kind, covered: covered < 0.9,
        "by less, profile right": lambda kind, covered: covered < 0.9 and kind not in WRONG,
    }
    for what, counted in counts.items():
        for channel in CHANNELS:
            found = "".join(f"{sum(counted(*one) for one in held[channel, how].items()):>10}{'':>6}" for how in hows)
            print(f"{what:<22} {channel.split('_')[0][:8]:<9}{'':>9}{found}")
    kinds = {kind for kind, _ in groups}
    print(f"of {len(kinds)} kinds, the profile of {len(kinds - set(WRONG))} is right")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", default=list(KINDS))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--lags", nargs="+", type=float, default=list(LAGS_S))
    parser.add_argument("--out", type=Path)
    parser.add_argument("--table", type=Path, help="print what this file holds, and fly nothing")
    parser.add_argument("--parts", action="store_true", help="with --table: errors that are constant over a flight")
    parser.add_argument("--innovations", action="store_true", help="what readings tell of a wrong profile")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    if args.innovations:
        table_of_innovations(args.kinds, seeds)
        return 0
    if args.table:
        (table_of_parts if args.parts else table)(kept(args.table))
        return 0
    jobs = [(name, seed) for seed in seeds for name in args.kinds]
    table(scored(args.out, jobs, ("kind", "seed"), lambda name, seed: score(name, seed, tuple(args.lags))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
