"""What a fleet saves a new sensor: its numbers from few runs with the fleet as prior, beside all runs alone.

    python benchmarks/fleet_prior.py [--types 1] [--fleet 24] [--new 100] [--seed 1] [--spread 0.01] [--few]

Rough worlds of the virtual bench, all drawn from the seed. A type is drawn, then a fleet of it that is characterized by
33 runs each, then new sensors: with ten runs at 20 degC and the fleet, and with all 33 alone. In every fifth new sensor
the film does not belong (D 12 % larger). Coverage is of two standard uncertainties, over alpha and D at 0, 20 and 40
degC. With `--few` the new sensors have the ten runs only. What a fleet's mean is off by, all new sensors of a type
share: many types with few new sensors each say more of coverage than many sensors of one. Least squares begin from a
rough scan of the rates, as in the map of `shockrig fleet`.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from made_fleets import drawn_sensor, record_sensor, type_of_sensors

from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.characterize.result import to_profile
from shockrig.analysis.fleet.fleet import fleet_of
from shockrig.analysis.fleet.fleet_prior import with_population
from shockrig.analysis.fleet.statistics import statistics_of
from shockrig.files.campaign import read_campaign
from shockrig.files.fingerprint import fingerprint
from shockrig.files.profile import Profile
from shockrig.rig.virtual.plans import wide_plan
from shockrig.rig.virtual.truth import Truth

FEW = (11, 12, 13, 14, 15, 26, 27, 28, 29, 30)  # of the wide plan: at 20 degC, three airflows, both directions
AT_C = (0.0, 20.0, 40.0)
NAMES = ("alpha", *(f"D({t:g})" for t in AT_C))
STRANGE = 1.12
Row = dict[str, tuple[float, float]]


def main(argv: list[str] | None = None) -> None:
    """Print a line for each number."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--types", type=int, default=1, help="types of sensors, each with a fleet of its own (1)")
    parser.add_argument("--fleet", type=int, default=24, help="sensors of each fleet (24)")
    parser.add_argument("--new", type=int, default=100, help="new sensors of each type (100)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--spread", type=float, default=0.01, help="of ln alpha and ln D from sensor to sensor (0.01)")
    parser.add_argument("--few", action="store_true", help="without the 33 runs of each new sensor")
    args = parser.parse_args(argv)
    rows = Rows()
    for seed in range(args.seed, args.seed + args.types):
        one_type(seed, args, rows)
    print(f"{'':<34}{'sensors':>8}" + "".join(f"{f'u {n}':>9}{'cover':>7}" for n in NAMES) + f"{'all':>7}")
    for name, table in (
        *(() if args.few else (("33 runs alone", rows.whole),)),
        ("10 runs alone", [*rows.few["belongs"], *rows.few["does not"]]),
        ("10 runs with the fleet", rows.with_fleet["belongs"]),
        ("10 runs, film does not belong", rows.with_fleet["does not"]),
    ):
        print(line(name, table))
    print(f"film said not to belong: {rows.said['does not']} of {len(rows.few['does not'])} that do not", end=", ")
    print(f"{rows.said['belongs']} of {len(rows.few['belongs'])} that do")


@dataclass
class Rows:
    """What was found of each new sensor: from all runs; from the ten by whether its film belongs, alone and with the
    fleet; and how many films were said not to belong."""

    whole: list[Row] = field(default_factory=list)
    few: dict[str, list[Row]] = field(default_factory=lambda: {"belongs": [], "does not": []})
    with_fleet: dict[str, list[Row]] = field(default_factory=lambda: {"belongs": [], "does not": []})
    said: dict[str, int] = field(default_factory=lambda: {"belongs": 0, "does not": 0})


def one_type(seed: int, args: argparse.Namespace, rows: Rows) -> None:
    """Draw a type, its fleet and new sensors of it."""
    base, rng = type_of_sensors(seed), np.random.default_rng([seed, 1])
    with tempfile.TemporaryDirectory() as folder:
        found = []
        for i in range(args.fleet):
            truth = drawn_sensor(base, rng, args.spread)
            path = record_sensor(truth, wide_plan(), [seed, 2, i], Path(folder) / f"f{i}", i)
            campaign = read_campaign(path)
            found.append(statistics_of(characterize(campaign, quickly=True), fingerprint(campaign)))
        population = fleet_of(found).population
        spread = ", ".join(f"{100 * s:.2f}" for s in np.sqrt(np.diag(population.covariance)))
        runs = population.run_scatter
        assert runs is not None
        print(
            f"seed {seed}: {args.fleet} sensors differ by {100 * args.spread:g} %, found {spread} % (alpha, D); "
            f"runs by {100 * base.rate_scatter:.2f} %, found {100 * runs.standard_deviation:.2f} % "
            f"({runs.degrees:.0f} degrees)",
            flush=True,
        )
        for i in range(args.new):
            truth, kind = drawn_sensor(base, rng, args.spread), "belongs"
            if i % 5 == 4:
                truth, kind = replace(truth, diffusivity_20c_m2_s=STRANGE * truth.diffusivity_20c_m2_s), "does not"
            plan = [shock for shock in wide_plan() if not args.few or int(shock.id) in FEW]
            path = record_sensor(truth, plan, [seed, 3, i], Path(folder) / f"n{i}", 900 + i)
            whole = read_campaign(path)
            short = replace(whole, runs=tuple(run for run in whole.runs if int(run.id) in FEW))
            result = characterize(short, quickly=True)
            prior = with_population(result, population)
            rows.with_fleet[kind].append(errors(prior.profile, truth))
            rows.few[kind].append(errors(to_profile(result), truth))
            rows.whole += [] if args.few else [errors(to_profile(characterize(whole, quickly=True)), truth)]
            rows.said[kind] += not prior.belongs("humidity")
            print(f"seed {seed}, new {i + 1}, {kind}, {prior.belongs('humidity')}", file=sys.stderr)
            for name, row in (("few", rows.few[kind][-1]), ("with the fleet", rows.with_fleet[kind][-1])):
                print(f"    {name}: {row}", file=sys.stderr, flush=True)


def errors(profile: Profile, truth: Truth) -> Row:
    """(relative error, relative standard uncertainty) of each number that a profile has."""
    found: Row = {}
    if profile.temperature is not None:
        alpha = profile.temperature.thermal_diffusivity_m2_s
        error = np.log(alpha.value / truth.thermal_diffusivity_m2_s)
        found["alpha"] = float(error), alpha.standard_uncertainty / alpha.value
    for row in () if profile.humidity is None else profile.humidity.diffusivity_table:
        for t in AT_C:
            if abs(row.ambient_temperature_c - t) < 1.0:
                error = np.log(row.diffusivity_m2_s / float(truth.diffusivity_m2_s(row.ambient_temperature_c)))
                found[f"D({t:g})"] = float(error), row.standard_uncertainty / row.diffusivity_m2_s
    return found


def line(name: str, rows: list[Row]) -> str:
    """Median uncertainty in percent and coverage of each number."""
    text, inside = f"{name:<34}{len(rows):>8}", []
    for number in NAMES:
        found = np.array([row[number] for row in rows if number in row]).reshape(-1, 2)
        if not found.size:
            text += f"{'-':>9}{'-':>7}"
            continue
        covered = np.abs(found[:, 0]) < 2.0 * found[:, 1]
        inside += list(covered)
        text += f"{100 * np.median(found[:, 1]):>9.3f}{100 * covered.mean():>7.1f}"
    return text + f"{100 * np.mean(inside):>7.1f}"


if __name__ == "__main__":
    main()
