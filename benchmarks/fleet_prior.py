"""What a fleet saves a new sensor: its numbers from few runs with the fleet as prior, beside all runs alone.

    python benchmarks/fleet_prior.py [--fleet 24] [--new 100] [--seed 1] [--spread 0.01] [--few]

Rough worlds of the virtual bench, all drawn from the seed. A type is drawn, then a fleet of it that is characterized by
33 runs each, then new sensors: with ten runs at 20 degC and the fleet, and with all 33 alone. In every fifth new sensor
the film does not belong (D 12 % larger). Coverage is of two standard uncertainties, over alpha and D at 0, 20 and 40
degC. With `--few` the new sensors have the ten runs only.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from made_fleets import drawn_sensor, record_sensor, type_of_sensors

from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.characterize.result import to_profile
from shockrig.analysis.fleet.fleet import fleet_of
from shockrig.analysis.fleet.prior import with_population
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
    parser.add_argument("--fleet", type=int, default=24, help="sensors of the fleet (24)")
    parser.add_argument("--new", type=int, default=100, help="new sensors (100)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--spread", type=float, default=0.01, help="of ln alpha and ln D from sensor to sensor (0.01)")
    parser.add_argument("--few", action="store_true", help="without the 33 runs of each new sensor")
    args = parser.parse_args(argv)
    base, rng = type_of_sensors(args.seed), np.random.default_rng([args.seed, 1])
    with tempfile.TemporaryDirectory() as folder:
        found = []
        for i in range(args.fleet):
            truth = drawn_sensor(base, rng, args.spread)
            path = record_sensor(truth, wide_plan(), [args.seed, 2, i], Path(folder) / f"f{i}", i)
            campaign = read_campaign(path)
            found.append(statistics_of(characterize(campaign), fingerprint(campaign)))
            print(f"fleet {i + 1}", file=sys.stderr, flush=True)
        population = fleet_of(found).population
        spread = ", ".join(f"{100 * s:.2f}" for s in np.sqrt(np.diag(population.covariance)))
        print(f"fleet of {args.fleet}, sensors differ by {100 * args.spread:g} %, found {spread} % (alpha, D)")
        rows: dict[str, list[Row]] = {"belongs": [], "does not": []}
        few: dict[str, list[Row]] = {"belongs": [], "does not": []}
        alone: list[Row] = []
        said = {"belongs": 0, "does not": 0}
        for i in range(args.new):
            truth, kind = drawn_sensor(base, rng, args.spread), "belongs"
            if i % 5 == 4:
                truth, kind = replace(truth, diffusivity_20c_m2_s=STRANGE * truth.diffusivity_20c_m2_s), "does not"
            plan = [shock for shock in wide_plan() if not args.few or int(shock.id) in FEW]
            path = record_sensor(truth, plan, [args.seed, 3, i], Path(folder) / f"n{i}", 900 + i)
            whole = read_campaign(path)
            short = replace(whole, runs=tuple(run for run in whole.runs if int(run.id) in FEW))
            result = characterize(short)
            prior = with_population(result, population)
            rows[kind].append(errors(prior.profile, truth))
            few[kind].append(errors(to_profile(result), truth))
            alone += [] if args.few else [errors(to_profile(characterize(whole)), truth)]
            said[kind] += not prior.belongs("humidity")
            print(f"new {i + 1}, {kind}, {prior.belongs('humidity')}", file=sys.stderr)
            for name, row in (("few", few[kind][-1]), ("with the fleet", rows[kind][-1])):
                print(f"    {name}: {row}", file=sys.stderr, flush=True)
    print(f"{'':<34}{'sensors':>8}" + "".join(f"{f'u {n}':>9}{'cover':>7}" for n in NAMES) + f"{'all':>7}")
    for name, table in (
        *(() if args.few else (("33 runs alone", alone),)),
        ("10 runs alone", [*few["belongs"], *few["does not"]]),
        ("10 runs with the fleet", rows["belongs"]),
        ("10 runs, film does not belong", rows["does not"]),
    ):
        print(line(name, table))
    print(f"film said not to belong: {said['does not']} of {len(rows['does not'])} that do not", end=", ")
    print(f"{said['belongs']} of {len(rows['belongs'])} that do")


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
