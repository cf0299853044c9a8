"""How much the correction hangs on numbers of its own: each halved and doubled on the same flights.

    python benchmarks/flight_sensitivity.py [--seeds N] [--first-seed N] [--numbers NAME ...] [--kinds NAME ...]
        [--period-s S] [--out FILE.jsonl]

Flights are kinds of flight_harm.py and damaged ones of fuzz_flights.py. Per number: error over the reading's (geometric
mean over flights and channels), share of rows that the 95 % interval covers, channels more than 2 % worse than their
reading, values outside what can be, and of five wrong profiles those whose cause is named. A number at which nothing
changes is one to leave out.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import warnings
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from flight_harm import CHANNELS, SIGMAS, profile_of, rms
from flight_kinds import KINDS
from flight_worlds import changed, fly
from fuzz_flights import WORSE, judged
from resumed import scored

from shockrig.analysis.flight import causal_bank
from shockrig.analysis.flight.correct import correct
from shockrig.files.flight import Flight

SMOOTHER = (
    "humidity_channel.VAGUE_TIMES", "flight_channel.MOST_NOISES_OFF", "flight_channel.ROWS_TOGETHER",
    "comparisons.LEAST_EXPLAINED",
    "comparisons.LEAST_OF_ITS_SIZE", "comparisons.MOST_OF_ITS_SIZE", "comparisons.NOT_AS_STATED",
    "comparisons.MOST_TIMES", "comparisons.COVERED_S", "comparisons.DRIFT_S", "air_prior.BINS_PER_OCTAVE",
    "air_prior.SMOOTH_SHARE", "air_prior.LOUDER_STEP",
    "columns.CHANGE", "columns.NOTHING", "columns.CUT", "columns.ALL_NOTHING", "columns.ALL_WARM", "columns.ALL_ODD",
    "columns.WARM_C", "columns.SURE", "columns.LEVEL_ROWS", "columns.CHAINS",
    "smooth_channel.LEAST_CALM",
    "ramps.PLACES", "ramps.CORNER_SHARE", "ramps.LONGEST_RAMP",
    "smooth_channel.PLACES_IN_GAP", "smooth_channel.COMPARABLE_SHARE", "smooth_channel.MOST_SURPRISE",
    "stretches.LEAST_TURNED",
    "stretches.FELT_SHARE", "sweep.GAP_NODES", "screen.FELT_SIGMAS", "screen.ON_THE_WAY", "screen.STOOD_SHARE",
    "swings.FEWEST_SWINGS", "swings.SHORTEST_S", "swings.OUT_OF_BINS", "swings.LINE_BINS", "swings.TOLD_LOG_ODDS",
    "air_prior.SHORTEST_S", "air_prior.OUT_OF_BINS", "air_prior.LINE_BINS", "air_prior.TOLD_LOG_ODDS",
    "swings.MEANS_IN_SWING", "humidity_channel.SHOWN_SHARES",
    "stretches.LEFT_SHARE", "unread.SLOPE_BLOCKS", "unread.FEWEST_BLOCKS", "unread.MOVED_SIGMAS", "unread.SURE_SIGMAS",
)  # fmt: skip
CAUSAL = (
    "causal_bank.STRENGTH_LASTS_S", "causal_bank.STRENGTHS_WEIGHED", "causal_bank.USUAL_WITHIN",
    "causal_bank.USUAL_ENDS", "causal_bank.BEND_IN_TURBULENCE", "causal_bank.BEND_OVER_DOOR",
    "causal_bank.BETWEEN_BENDS_S", "causal_bank.BEND_LASTS_S", "causal_bank.BETWEEN_DOORS_S",
    "causal_bank.DOOR_LASTS_S", "causal.UNREAD_S", "causal.UNREAD_PERIODS", "causal.VAPOUR_PER_K",
    "causal_bank.LEAST_SHARE",
)  # fmt: skip
CAUSES = {
    "second lag": "a second lag",
    "film in RH": "takes up relative humidity",
    "late die": "a die that is slower",
    "logger mean": "averaged by the logger",
    "hysteresis": "hysteresis",
}
MOVED = ("sun bursts", "icing", "fan failure")
FLOWN = ("convective", "door, in and out", "missing samples", "absurd samples", *MOVED, *CAUSES)
DAMAGED = {name: [name] for name in ("swapped", "fahrenheit", "burst", "coarse", "gaps", "stuck", "clipped")}
DAMAGED["stuck among steps"] = ["stuck", "coarse"]
DAMAGED["columns"] = ["swapped", "fahrenheit", "gaps", "sentinel_block"]
LATE, EVERY, BY_ROWS = "late packets", 9, 4  # of the rows every so many come as many rows late
LAG_S = 2.0


class Changed:
    """A number of the correction, in every module that holds it, times a factor for a while."""

    def __init__(self, name: str, factor: float) -> None:
        where, self.name = name.rsplit(".", 1)
        owner = importlib.import_module(f"shockrig.{where if '.' in where else 'analysis.flight.' + where}")
        self.own = getattr(owner, self.name)
        kind = type(self.own)
        if kind is tuple:
            self.value = tuple(one * factor for one in self.own)
        else:
            value = kind(self.own * factor)
            self.value = value | 1 if kind is int else value  # a median's width is odd
        users = [one for title, one in sys.modules.items() if title.startswith("shockrig.")]
        self.users = [one for one in users if getattr(one, self.name, None) is self.own]

    def _set(self, value: object) -> None:
        for one in self.users:
            setattr(one, self.name, value)
        causal_bank.moves.cache_clear()  # which keeps what the numbers made

    def __enter__(self) -> None:
        self._set(self.value)

    def __exit__(self, *_: object) -> None:
        self._set(self.own)


def flown(kind: str, seed: int, method: str, period_s: float | None = None) -> list[dict]:
    """Both channels of a flight of flight_harm.py, its rows `period_s` apart if that is given."""
    world = KINDS["up and down" if kind == LATE else kind](np.random.default_rng([seed, zlib.crc32(kind.encode())]))
    world = world if period_s is None else changed(world, period_s=period_s)
    flight = fly(world, seed)
    if kind == LATE:
        rows = np.arange(flight.log["time_s"].size)
        order = np.argsort(rows + np.where(rows % EVERY == 0, BY_ROWS + 0.5, 0.0))
        flight = replace(flight, **{
            name: {key: values[order] for key, values in getattr(flight, name).items()} for name in ("log", "truth")
        })  # fmt: skip
    log = flight.log
    unknown = np.full(log["time_s"].size, np.nan)
    columns = (log["time_s"], log["temperature_c"], log["humidity_percent"], unknown, unknown, unknown)
    done = correct(Flight(*columns, log["altitude_m"]), profile_of(world), method, lag_s=LAG_S)
    lines = []
    for channel in CHANNELS:
        off, sigma = getattr(done, channel) - flight.truth[channel], getattr(done, SIGMAS[channel])
        before = log[channel] - flight.truth[channel]
        rows = np.isfinite(off) & np.isfinite(sigma) & (np.abs(before) < 50.0)
        covered = float(np.mean(np.abs(off[rows]) <= 1.96 * sigma[rows]))
        lines.append({"ratio": rms(off[rows]) / rms(before[rows]), "covered": covered, "outside": 0})
    if kind in CAUSES and method == "smoother":
        lines[1]["named"] = any(CAUSES[kind] in note for note in done.notes)
    return lines


def damaged(kind: str, seed: int) -> list[dict]:
    """Both channels of a flight of fuzz_flights.py with one kind of damage, or up to three of a list."""
    found = judged(seed, DAMAGED[kind])
    both = [found[channel] for channel in CHANNELS]
    return [
        {"ratio": one["ours"] / one["reading"] if one.get("reading") else None, "covered": one.get("covered"),
         "outside": one["outside"]}
        for one in both
    ]  # fmt: skip


def row(lines: list[dict]) -> str:
    ratio = [line["ratio"] for line in lines if line["ratio"]]
    covered = [line["covered"] for line in lines if line["covered"] is not None]
    return (
        f"{np.exp(np.mean(np.log(ratio))):>8.4f}{np.mean(covered):>7.3f}{sum(r > WORSE for r in ratio):>4}"
        f"{sum(line['outside'] for line in lines):>5}{sum(line.get('named', False) for line in lines):>4}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--numbers", nargs="+", default=[*SMOOTHER, *CAUSAL])
    parser.add_argument("--kinds", nargs="+", default=[*FLOWN, *DAMAGED], choices=[*KINDS, LATE, *DAMAGED])
    parser.add_argument("--period-s", type=float, help="between rows of the flights that are not damaged")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    warnings.simplefilter("ignore")

    def score(number: str, factor: float, kind: str, seed: int) -> list[dict]:
        method = "causal" if number in CAUSAL or number == "causal as it is" else "smoother"
        named = {"number": number, "factor": factor, "kind": kind, "seed": seed}
        if factor == 1.0:
            lines = damaged(kind, seed) if kind in DAMAGED else flown(kind, seed, method, args.period_s)
        else:
            with Changed(number, factor):
                lines = damaged(kind, seed) if kind in DAMAGED else flown(kind, seed, method, args.period_s)
        return [named | line for line in lines]

    jobs = []
    for number in ("smoother as it is", "causal as it is", *args.numbers):
        causal = number in CAUSAL or number.startswith("causal as")
        kinds = [one for one in args.kinds if not causal or one in FLOWN[:4]]
        for factor in (1.0,) if number.endswith("as it is") else (0.5, 2.0):
            for seed in range(args.first_seed, args.first_seed + args.seeds):
                jobs.extend((number, factor, kind, seed) for kind in kinds)
    lines = scored(args.out, jobs, ("number", "factor", "kind", "seed"), score)
    lines = [line for line in lines if line["kind"] in args.kinds]
    print(f"{'number':<34}{'times':>6}{'error':>8}{'cov':>7}{'>2%':>4}{'out':>5}{'nam':>4}")
    for number, factor in dict.fromkeys((job[0], job[1]) for job in jobs):
        print(f"{number:<34}{factor:>6g}" + row([x for x in lines if (x["number"], x["factor"]) == (number, factor)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
