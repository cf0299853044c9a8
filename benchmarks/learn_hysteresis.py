"""Whether flights tell a film's hysteresis: missions of `learn_worlds.py` whose humidity goes through a backlash.

    python benchmarks/learn_hysteresis.py --missions 12 --first-seed 98000 [--out results/learn_hysteresis.txt]

The film reads on only where the humidity has turned by more than the backlash's width (0, 1 and 3 %RH; data sheets
allow 1). Three models of humidity are fitted to each mission: one lag; beside it the catalogue's offset in descent; and
beside it a hysteresis of free width, whose direction is the reading's own. Two of them are told in nats over one lag.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from learn_worlds import KINDS, flown

from shockrig.analysis.learn.bins import FlightBins, binned
from shockrig.analysis.learn.density import prepared
from shockrig.analysis.learn.flights_fit import Learned, fitted
from shockrig.analysis.learn.laws import LAWS, Law, LawParameter
from shockrig.analysis.learn.learn import FLIGHT_BINS

WIDTHS_PERCENT = (0.0, 1.0, 3.0)
TURNED_PERCENT = 1.0  # by which a reading has turned where its direction is told
AT_MOST_FLIGHTS = 4


def backlash(values: np.ndarray, width: float) -> np.ndarray:
    """What follows values that have turned by more than a width."""
    found, held = np.empty_like(values), values[0]
    for i, value in enumerate(values):
        held = min(max(held, value - 0.5 * width), value + 0.5 * width)
        found[i] = held
    return found


def by_direction() -> Law:
    """A hysteresis as a law of flights: the reading is half a width behind, on the side from which it came."""

    def offset(values: Mapping[str, float], bins: FlightBins) -> np.ndarray:
        read = bins.values["humidity"]
        good = np.isfinite(read)
        read = np.interp(bins.time_s, bins.time_s[good], read[good])
        side = (backlash(read, TURNED_PERCENT) - read) / (0.5 * TURNED_PERCENT)
        return 0.5 * values["width_percent"] * side

    width = LawParameter("width_percent", "%RH", 0.0, 1.5, -20.0, 20.0, (1.0,), "width")
    return Law("hysteresis", ("hysteresis",), "humidity", (width,), "", "", "", offset=offset)


def lag_of(fit: Learned) -> tuple[float, float]:
    """Time constant and its standard uncertainty [s]."""
    tau = float(np.exp(fit.theta[0]))
    return tau, tau * float(np.sqrt(fit.covariance[0, 0]))


def rows(first_seed: int, missions: int) -> list[tuple[float, ...]]:
    """Of each mission and width: seed, width, tau, u(tau), nats of an offset, nats and width of a hysteresis."""
    found = []
    lag, down, law = LAWS["humidity.lag"], LAWS["humidity.offset_in_descent"], by_direction()
    at = np.array([np.log(8.0), 0.0, 0.5])
    for seed in range(first_seed, first_seed + missions):
        flights = [one.flight for one in flown(seed, KINDS["lags"])[:AT_MOST_FLIGHTS]]
        for width in WIDTHS_PERCENT:
            read = [replace(one, humidity_percent=backlash(one.humidity_percent, width)) for one in flights]
            units = [prepared(binned(one, str(i), FLIGHT_BINS), "humidity") for i, one in enumerate(read)]
            plain = fitted((lag,), units, at)
            offset, turned = (fitted((lag, one), units, np.r_[at, 1.0], plain) for one in (down, law))
            gains = [float(one.predicted().sum() - plain.predicted().sum()) for one in (offset, turned)]
            found.append((seed, width, *lag_of(plain), *gains, float(turned.theta[3])))
        print(f"learn_hysteresis: seed {seed}", file=sys.stderr, flush=True)
    return found


def table(found: list[tuple[float, ...]]) -> list[str]:
    """Lines: medians of each width, then each mission."""
    lines = ["backlash  lag [s]  longer by [u]  nats of an offset in descent  nats and width of a hysteresis [%RH]"]
    columns = np.array(found)
    without = {row[0]: row for row in found if row[1] == 0.0}
    for width in WIDTHS_PERCENT:
        mine = columns[columns[:, 1] == width]
        longer = [(row[2] - without[row[0]][2]) / row[3] for row in mine]
        tau, offset, turned, of = (np.median(mine[:, i]) for i in (2, 4, 5, 6))
        lines.append(
            f"{width:>4.0f} %RH  {tau:7.1f}  {np.median(longer):13.1f}  {offset:28.1f}  {turned:+9.1f} {of:+6.2f}"
        )
    lines += ["", "seed, backlash, lag, u(lag), nats of an offset, nats of a hysteresis, its width"]
    return [*lines, *(f"{r[0]:.0f} {r[1]:.0f} " + " ".join(f"{x:.2f}" for x in r[2:]) for r in found)]


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--missions", type=int, default=12)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args(argv)
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False)
    said = f"commit {commit.stdout.strip()}, seeds {args.first_seed} to {args.first_seed + args.missions - 1}"
    text = "\n".join([said, *table(rows(args.first_seed, args.missions))]) + "\n"
    if args.out is not None:
        args.out.write_text(text, encoding="utf-8")
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
