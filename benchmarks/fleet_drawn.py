"""Who is said not to belong, and how well the mean is known, in fleets drawn straight from the population's model.

    python benchmarks/fleet_drawn.py [--plain 100] [--one-off 50] [--carriages 100] [--new 100]
                                     [--large 200 1000 5000] [--seed 1]

No campaign is simulated: a sensor is its true numbers with errors of the uncertainty that is stated of them. Plain
fleets have 24 sensors that differ by 2 %. One film of 200 is 2 % off where sensors differ by 0.3 % and are known to
0.15 %. Carriages are eight probes side by side that differ by 0.2 %, whose runs scatter by 4 %, 0 or 90 % of which is
the same in all of them. New sensors come to fleets of 20 that differ by 0.2 to 5 times what each is known to, ten to a
fleet; each knows its alpha and D(20) 1.8 times worse than those of the fleet do, and nothing of D(0) and D(40), as from
ten runs at 20 degC. Large fleets show what the reduce of a fleet takes. Last, what the two stages lose beside one
fit of all readings, in closed form. A row for each fleet goes to standard error.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from made_fleets import drawn_fleet

from shockrig.analysis.fleet.fleet import fleet_of
from shockrig.files.fleet_file import CHANNELS, Fleet

OFF = 0.02
RATIOS = (0.2, 0.4, 0.7, 1.0, 1.5, 2.0, 5.0)
KNOWN_TO, WORSE, NEW = 0.003, 1.8, 10  # what a sensor of a fleet is known to, by how much less new ones, and how many


def main(argv: list[str] | None = None) -> None:
    """Print a line for each kind of fleet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plain", type=int, default=100)
    parser.add_argument("--one-off", type=int, default=50)
    parser.add_argument("--carriages", type=int, default=100)
    parser.add_argument("--new", type=int, default=100)
    parser.add_argument("--large", type=int, nargs="*", default=[200, 1000, 5000])
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(argv)
    began_s = time.process_time()
    if args.plain:
        plain_fleets(args.plain, args.seed)
    if args.one_off:
        one_off(args.one_off, args.seed)
    if args.carriages:
        for share in (0.0, 0.9):
            carriages(args.carriages, args.seed, share)
    for ratio in RATIOS if args.new else ():
        new_sensors(args.new, args.seed, ratio)
    for sensors in args.large:
        large(sensors, args.seed)
    two_stages(args.seed)
    print(f"seed {args.seed}; {time.process_time() - began_s:.0f} s of the processor")


def plain_fleets(count: int, seed: int) -> None:
    """Nothing is to be said of these."""
    outside, fleets, trends = 0, 0, 0
    for i in range(count):
        fleet = fleet_of(drawn_fleet(np.random.default_rng([seed, 1, i]), 24)[0])
        said = sum(len(fleet.outsiders(channel)) for channel in CHANNELS)
        row("plain", i, said, len(fleet.trends))
        outside, fleets, trends = outside + said, fleets + (said > 0), trends + bool(fleet.trends)
    print(
        f"plain: {outside} of {2 * 24 * count} channels of sensors said not to belong, in {fleets} of {count} fleets; "
        f"a drift or a batch said in {trends}"
    )


def one_off(count: int, seed: int) -> None:
    """One film of 200 is 2 % off."""
    found = others = 0
    for i in range(count):
        rng = np.random.default_rng([seed, 2, i])
        place = int(rng.integers(200))
        fleet = fleet_of(drawn_fleet(rng, 200, spread=0.003, uncertainty=0.0015, off={place: OFF})[0])
        names = {one.name for one in fleet.sensors if one.serials["humidity"] == f"H{place + 8}"}
        said = {channel: set(fleet.outsiders(channel)) for channel in CHANNELS}
        here = bool(names & said["humidity"])
        false = sum(map(len, said.values())) - here
        row("one off", i, here, false)
        found, others = found + here, others + false
    print(f"one of 200 off by 2 %: found in {found} of {count} fleets; {others} others said in all of them")


def carriages(count: int, seed: int, share: float) -> None:
    """How often the mean and the sensors lie within two standard uncertainties, with so much in common."""
    mean, sensors = [], []
    for i in range(count):
        drawn, truths = drawn_fleet(
            np.random.default_rng([seed, 3, i]),
            8,
            spread=0.002,
            uncertainty=0.001,
            probes=8,
            run_scatter=0.04,
            run_share=share,
        )
        fleet = fleet_of(drawn)
        u = float(np.sqrt(fleet.population.mean_covariance[0, 0]))
        off = abs(float(fleet.population.mean[0] - np.log(8e-8))) / u
        away = distances(fleet, truths)
        row(f"carriage, {share:g} in common", i, round(off, 3), round(u, 5), int((away < 2.0).sum()), away.size)
        mean.append((off, u))
        sensors += list(away)
    off, u = np.array(mean).T
    print(
        f"carriages of 8, {share:.0%} of the runs' scatter in common: mean alpha known to {100 * np.median(u):.2f} %, "
        f"covered {100 * np.mean(off < 2.0):.1f} %; sensors covered {100 * np.mean(np.array(sensors) < 2.0):.1f} %"
    )


def new_sensors(count: int, seed: int, ratio: float) -> None:
    """How often a new sensor's numbers lie within two standard uncertainties, before its runs and with them."""
    before, after, spreads = [], [], []
    shown = np.eye(4)[[0, 2]]
    for i in range(count):
        rng = np.random.default_rng([seed, 6, i, int(100 * ratio)])
        drawn, truths = drawn_fleet(rng, 20 + NEW, spread=ratio * KNOWN_TO, uncertainty=KNOWN_TO)
        one = fleet_of(drawn[:20]).population
        prior, error = one.predictive, WORSE * KNOWN_TO
        gain = np.linalg.solve(shown @ prior @ shown.T + error**2 * np.eye(2), shown @ prior).T
        known = prior - gain @ shown @ prior
        for alpha, d in truths[20:]:
            off = np.array([alpha, *d[::2]]) - one.mean
            left = off - gain @ (shown @ off + error * rng.standard_normal(2))
            before.append(np.abs(off) < 2.0 * np.sqrt(np.diag(prior)))
            after.append(np.abs(left) < 2.0 * np.sqrt(np.diag(known)))
        spreads.append(np.sqrt(np.diag(one.covariance))[[0, 2]] / (ratio * KNOWN_TO))
        row(f"new sensors, {ratio:g}", i, *spreads[-1].round(3), np.mean(after[-NEW:]), np.mean(before[-NEW:]))
    each = " ".join(f"{100 * c:.1f}" for c in np.mean(after, axis=0))
    low, high = np.percentile(spreads, [5, 95])
    print(
        f"fleets of 20 that differ by {ratio:g} u, found as {low:.2f} to {high:.2f} of that: new sensors covered "
        f"{100 * np.mean(after):.1f} % (alpha, D: {each}), before their runs {100 * np.mean(before):.1f} %",
        flush=True,
    )


def large(sensors: int, seed: int) -> None:
    """What the population of so many takes, once each is characterized."""
    drawn = drawn_fleet(np.random.default_rng([seed, 5, sensors]), sensors)[0]
    began_s = time.process_time()
    fleet_of(drawn)
    took_s, memory = time.process_time() - began_s, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{sensors} sensors: {took_s:.1f} s of the processor, {memory:.0f} MB at most", flush=True)


def two_stages(seed: int, probes: int = 8, runs: int = 11) -> None:
    """Standard uncertainties of two stages over those of one fit, where runs differ in how much noise leaves of a rate.

    A run's rate is off by s (the share in common, and each probe's own), and its noise by N s with N drawn evenly in
    its logarithm from a range. A probe alone weighs its runs by 1 / (1 + N^2); one fit of all knows what they share.
    """
    print("two stages over one fit: noise of a run / its scatter, share in common, the mean, a difference of sensors")
    rng = np.random.default_rng([seed, 4])
    for low, high in ((0.15, 0.3), (0.15, 0.6), (0.3, 1.0)):
        noise = np.exp(rng.uniform(*np.log([low, high]), (300, runs))) ** 2
        for share in (0.3, 0.9, 0.99):
            alone = 1.0 / (1.0 + noise)
            lost = []
            for variance in (share + (1.0 - share + noise) / probes, 1.0 - share + noise):
                two = (alone**2 * variance).sum(axis=1) / alone.sum(axis=1) ** 2
                lost.append(np.sqrt(np.mean(two * (1.0 / variance).sum(axis=1))))
            print(f"  {low:.2f} to {high:.2f}  {share:.2f}  {lost[0]:.3f}  {lost[1]:.3f}")


def distances(fleet: Fleet, truths: list[tuple[float, np.ndarray]]) -> np.ndarray:
    """How far every number of every sensor is from its truth, in standard uncertainties."""
    found = []
    for sensor in fleet.sensors:
        alpha, d = truths[int(sensor.serials["temperature"][1:]) - 8]
        for channel, true in (("temperature", [alpha]), ("humidity", d)):
            for figure, value in zip(sensor.channels[channel].figures, true, strict=True):
                one = figure.shrunk
                found.append(abs(np.log(one.value) - value) / (one.standard_uncertainty / one.value))
    return np.array(found)


def row(*cells: object) -> None:
    """A fleet's row, so that what was reached can be used."""
    print(*cells, sep="\t", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
