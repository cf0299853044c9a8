"""What comes out of the correction when damage goes in: sentinels, gaps, bursts, resets, stuck, swapped, coarse.

    python benchmarks/fuzz_flights.py [--rows 1000000] [--first-seed N] [--kinds NAME ...] [--out FILE.jsonl]

Flights of `flight_worlds.py` (a solver of its own) with one to three kinds of damage drawn from the seed, one flight a
seed. Counted: values outside of what can be (humidity of 0 to 100 %RH, and no farther from what the air did within half
a minute, and from the readings that are readings, than half of what these ranged over and `SLACK`), but for rows that
are the reading and say so; rows that bear `not_corrected` and are not the reading; flights whose rms error is more than
2 % above that of their readings, over the rows whose reading is one, however noisy or stuck.
"""

from __future__ import annotations

import argparse
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from flight_harm import CHANNELS, SIGMAS, profile_of
from flight_kinds import convective, door, front, plumes, profile
from flight_worlds import World, changed, fly
from resumed import keep, kept
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from shockrig.analysis.flight.correct import correct
from shockrig.files.flight import Flight

Array = np.ndarray
Rng = np.random.Generator
WORLDS: tuple[Callable[[Rng], World], ...] = (
    convective,
    front,
    lambda r: profile(r, 40.0, 0.04, 0.2, True),
    lambda r: profile(r, 8.0),
    plumes,
    door,
)
AROUND_S = 30.0
SLACK = {"temperature_c": 1.0, "humidity_percent": 5.0}
WORSE = 1.02
NEAR = {"temperature_c": 5.0, "humidity_percent": 15.0}  # of the reading it replaces, a value passes for a reading
CODES = {
    "temperature_c": (-9999.0, -999.9, -999.0, -99.9, 9999.0, 6526.9, -127.0, 85.0, -327.68, -273.15),
    "humidity_percent": (-9999.0, -999.9, -999.0, -99.9, 9999.0, 6526.9, 998.0, 0.0, -6.0),
}


class Log:
    """A log that is damaged: `columns`, which of each channel's rows still hold a reading (`is_reading`), and which of
    these the sensor's own noise alone is in (`is_true`)."""

    def __init__(self, columns: dict[str, Array]) -> None:
        self.columns = columns
        count = columns["time_s"].size
        self.is_reading = {name: np.ones(count, dtype=bool) for name in CHANNELS}
        self.is_true = {name: np.ones(count, dtype=bool) for name in CHANNELS}
        self.swapped = False

    def put(self, name: str, rows: slice | Array, values: Array | float, *, reading: bool = False) -> None:
        """Other values at some rows; `reading`: they are still what the sensor said, if badly."""
        before = self.columns[name].copy()
        self.columns[name][rows] = values
        self.is_true[name][rows] = False
        if not reading:
            near = np.abs(self.columns[name] - before) <= NEAR[name]
            self.is_reading[name][rows] = near[rows] & self.is_reading[name][rows]

    def stretch(self, rng: Rng, least_s: float, most_s: float) -> slice:
        """Some rows in a row."""
        time_s = self.columns["time_s"]
        period = float(np.median(np.abs(np.diff(time_s))))
        size = max(int(rng.uniform(least_s, most_s) / period), 2)
        start = int(rng.integers(0, max(time_s.size - size, 1)))
        return slice(start, start + size)

    def channels(self, rng: Rng) -> list[str]:
        """One of the channels, or both."""
        return [name for name in CHANNELS if rng.random() < 0.7] or [CHANNELS[0]]


def sentinels(log: Log, rng: Rng) -> None:
    for name in log.channels(rng):
        rows = rng.random(log.columns[name].size) < rng.uniform(0.005, 0.05)
        log.put(name, rows, rng.choice(CODES[name]))


def sentinel_block(log: Log, rng: Rng) -> None:
    for name in log.channels(rng):
        log.put(name, log.stretch(rng, 0.5, 40.0), rng.choice(CODES[name]))


def power_on(log: Log, rng: Rng) -> None:
    log.put("temperature_c", slice(0, int(rng.integers(1, 15))), 85.0)


def other_code(log: Log, rng: Rng) -> None:
    for name in log.channels(rng):
        log.put(name, log.stretch(rng, 1.0, 20.0), float(rng.choice([-77.7, 111.1, 33.3, 0.0, 127.99])))


def gaps(log: Log, rng: Rng) -> None:
    for name in log.channels(rng):
        for _ in range(int(rng.integers(1, 5))):
            log.put(name, log.stretch(rng, 0.5, 25.0), np.nan)
        log.put(name, rng.random(log.columns[name].size) < rng.uniform(0.0, 0.4), np.nan)


def burst(log: Log, rng: Rng) -> None:
    for name in log.channels(rng):
        for _ in range(int(rng.integers(1, 4))):
            rows = log.stretch(rng, 1.0, 15.0)
            size = rng.uniform(0.3, 3.0) * (1.0 if name == "temperature_c" else 4.0)
            values = log.columns[name][rows]
            log.put(name, rows, values + size * rng.standard_normal(values.size), reading=True)


def stuck(log: Log, rng: Rng) -> None:
    for name in log.channels(rng):
        rows = log.stretch(rng, 3.0, 60.0)
        step = 0.01 if name == "temperature_c" else 100 / 16383
        values = log.columns[name][rows]
        dither = step * rng.integers(-1, 2, values.size) * (rng.random() < 0.6)
        known = values[np.isfinite(values)]
        log.put(name, rows, (known[0] if known.size else np.nan) + dither, reading=True)


def resets(log: Log, rng: Rng) -> None:
    """The logger starts again: its clock from another time, the sensor's first readings a code."""
    time_s = log.columns["time_s"]
    at = int(rng.integers(time_s.size // 5, 4 * time_s.size // 5))
    time_s[at:] += rng.choice([-time_s[at], 3600.0, -30.0])
    log.put("temperature_c", slice(at, at + int(rng.integers(1, 4))), 85.0)


def swapped(log: Log, rng: Rng) -> None:
    """The two columns of the whole log, or of a part that was written by other firmware."""
    if rng.random() < 0.5:
        log.columns["temperature_c"], log.columns["humidity_percent"] = (
            log.columns["humidity_percent"],
            log.columns["temperature_c"],
        )
        log.swapped = True
        return
    rows = log.stretch(rng, 2.0, 60.0)
    one, other = log.columns["temperature_c"][rows].copy(), log.columns["humidity_percent"][rows].copy()
    log.put("temperature_c", rows, other)
    log.put("humidity_percent", rows, one)


def fahrenheit(log: Log, rng: Rng) -> None:
    rows = log.stretch(rng, 5.0, 60.0)
    log.put("temperature_c", rows, 1.8 * log.columns["temperature_c"][rows] + 32.0)


def clipped(log: Log, rng: Rng) -> None:
    values = log.columns["humidity_percent"]
    limit = float(np.nanquantile(values, rng.uniform(0.5, 0.95)))
    log.put("humidity_percent", values > limit, limit, reading=True)


def coarse(log: Log, rng: Rng) -> None:
    for name, steps in (("temperature_c", (0.1, 0.25, 0.5)), ("humidity_percent", (0.1, 0.5, 1.0))):
        step = rng.choice(steps)
        log.columns[name] = np.round(log.columns[name] / step) * step


def absurd(log: Log, rng: Rng) -> None:
    for name in log.channels(rng):
        rows = rng.integers(0, log.columns[name].size, 8)
        log.put(name, rows, rng.uniform(-200.0, 200.0, 8))


DAMAGE = {
    one.__name__: one
    for one in (
        sentinels, sentinel_block, power_on, other_code, gaps, burst, stuck, resets, swapped, fahrenheit, clipped,
        coarse, absurd,
    )
}  # fmt: skip


def damaged(seed: int, kinds: list[str]) -> tuple[list[str], World, Log, dict[str, Array]]:
    """A flight: what was done to it, its world, the log, the truth at its rows."""
    rng = np.random.default_rng([seed, 1928])
    world = WORLDS[int(rng.integers(len(WORLDS)))](rng)
    if rng.random() < 0.3:
        world = changed(world, period_s=float(rng.choice([0.2, 0.5, 1.0])))
    flown = fly(world, seed)
    log = Log(flown.log)
    chosen = [str(kind) for kind in rng.choice(kinds, int(rng.integers(1, 4)))]
    for kind in dict.fromkeys(chosen):
        DAMAGE[kind](log, rng)
    return chosen, world, log, flown.truth


def between(values: Array, size: int) -> tuple[Array, Array]:
    """The least and the largest of the known values within `size` rows around each."""
    low, high = (np.where(np.isfinite(values), values, end) for end in (np.inf, -np.inf))
    return minimum_filter1d(low, size, mode="nearest"), maximum_filter1d(high, size, mode="nearest")


def judged(seed: int, kinds: list[str]) -> dict[str, object]:
    """One flight through the correction."""
    chosen, world, log, truth = damaged(seed, kinds)
    rows = log.columns
    unknown = np.full(rows["time_s"].size, np.nan)
    flight = Flight(
        rows["time_s"], rows["temperature_c"], rows["humidity_percent"], unknown, unknown, unknown, rows["altitude_m"]
    )
    line: dict[str, object] = {"seed": seed, "damage": chosen, "rows": int(rows["time_s"].size)}
    began = time.process_time()
    try:
        done = correct(flight, profile_of(world))
    except Exception:  # what a user would see as a traceback
        return line | {"raised": traceback.format_exc(limit=-3)}
    line["seconds"] = time.process_time() - began
    size = 2 * int(AROUND_S / world.period_s) + 1
    for name in CHANNELS:
        value, reading, is_reading = getattr(done, name), rows[name], log.is_reading[name]
        low, high = between(np.where(is_reading, reading, np.nan), size)
        if not log.swapped:
            ends = between(truth[name], size)
            low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
        slack = 0.5 * (high - low) + SLACK[name]
        known = np.isfinite(value)
        beyond = np.maximum(low - slack - value, value - high - slack)
        most = 100.0 if name == "humidity_percent" and not log.swapped else np.inf
        as_read = done.flags["not_corrected"] | done.flags[f"{name.split('_')[0]}_not_corrected"]
        beyond[as_read & (value == reading)] = 0.0  # a reading, and said to be no more
        outside = known & ((beyond > 0) | ((value > most) & ~as_read))
        # where columns stand in one another's place, the reading is in the other
        other = rows[CHANNELS[1 - CHANNELS.index(name)]]
        is_raw = known & as_read & (value != reading) & (value != other)
        found: dict[str, object] = {
            "given": float(known[log.is_true[name]].mean()) if log.is_true[name].any() else None,
            "outside": int(outside.sum()),
            "farthest": float(np.max(beyond[outside], initial=0.0)),
            "first_outside": int(np.argmax(outside)) if outside.any() else None,
            "no_reading": int(is_raw.sum()),
        }
        kept = known & is_reading & np.isfinite(reading)
        if kept.any() and not log.swapped:
            off, before = value[kept] - truth[name][kept], reading[kept] - truth[name][kept]
            found["ours"], found["reading"] = (float(np.sqrt(np.mean(v**2))) for v in (off, before))
            sigma = getattr(done, SIGMAS[name])[kept]
            stated = np.isfinite(sigma)
            found["covered"] = float(np.mean(np.abs(off)[stated] <= 1.96 * sigma[stated])) if stated.any() else None
        line[name] = found
    return line


def table(lines: list[dict]) -> None:
    """What was counted, over all and by kind of damage."""
    print(f"{sum(line['rows'] for line in lines)} rows, {len(lines)} flights")
    print(f"flights that raised: {sum('raised' in line for line in lines)}")
    lines = [line for line in lines if "raised" not in line]
    names = ("flights", "outside", "not read", "worse", "worst", "covered", "given")
    print(f"{'damage':<16}" + "".join(f"{name:>9}" for name in names))

    def row(name: str, some: list[dict]) -> None:
        both = [line[channel] for line in some for channel in CHANNELS]
        compared = [c for c in both if c.get("reading")]
        ratio = [c["ours"] / c["reading"] for c in compared]
        covered = [c["covered"] for c in compared if c["covered"] is not None]
        given = [c["given"] for c in both if c["given"] is not None]
        print(
            f"{name:<16}{len(some):>9}{sum(c['outside'] for c in both):>9}{sum(c['no_reading'] for c in both):>9}"
            f"{sum(r > WORSE for r in ratio):>9}{max(ratio, default=0.0):>9.2f}"
            f"{np.mean(covered) if covered else np.nan:>9.3f}{np.mean(given) if given else np.nan:>9.3f}"
        )

    for kind in DAMAGE:
        row(kind, [line for line in lines if kind in line["damage"]])
    row("all", lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="+", default=list(DAMAGE), choices=list(DAMAGE))
    parser.add_argument("--out", type=Path)
    parser.add_argument("--table", type=Path, help="print what this file holds, and fly nothing")
    args = parser.parse_args()
    if args.table:
        table(kept(args.table))
        return 0
    warnings.simplefilter("ignore")
    lines: list[dict] = []
    seed, rows = args.first_seed, 0
    while rows < args.rows:
        line = judged(seed, args.kinds)
        lines.append(line)
        rows += line["rows"]
        seed += 1
        keep(args.out, [line])
    table(lines)
    return 0


if __name__ == "__main__":
    sys.exit(main())
