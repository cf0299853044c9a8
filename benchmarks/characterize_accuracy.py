"""How right a characterization is: random plain worlds of the virtual bench, recorded, characterized, compared.

    python benchmarks/characterize_accuracy.py [--worlds 24] [--first-seed 1000] [--tiers smooth rough]

Every world draws its own sensors, noise and scatter. Ambients with isothermal shocks and those with thermal shocks
alone are counted apart. No seed is left out.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

from shockrig.analysis.characterize.characterize import characterize
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import draw_truth

QUANTITIES = ("alpha", "D, isothermal shocks", "D, thermal shocks alone")


def main(argv: list[str] | None = None) -> None:
    """Print one line a quantity and tier."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=24, help="of each tier (24)")
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--tiers", nargs="+", default=["smooth", "rough"])
    args = parser.parse_args(argv)
    seeds = range(args.first_seed, args.first_seed + args.worlds)
    print(f"{args.worlds} worlds a tier, seeds {seeds[0]} to {seeds[-1]}")
    print(f"{'tier':<8}{'quantity':<24}{'n':>5}{'median error':>14}{'worst':>9}{'within 2 sigma':>16}{'rms z':>8}")
    everything: dict[str, list[tuple[float, float]]] = {}
    false_hints = 0
    for tier in args.tiers:
        found: dict[str, list[tuple[float, float]]] = {name: [] for name in QUANTITIES}
        for seed in seeds:
            values, explained = errors(tier, seed)
            for name, error, z in values:
                found[name].append((error, z))
            false_hints += not explained
            print(f"{tier} {seed}", file=sys.stderr, flush=True)
        for name, values in found.items():
            if values:
                print(line(tier, name, values), flush=True)
            everything.setdefault(name, []).extend(values)
    for name, values in everything.items():
        if values:
            print(line("all", name, values))
    print(f"worlds wrongly sent to the diagnosis: {false_hints} of {args.worlds * len(args.tiers)}")


def errors(tier: str, seed: int) -> tuple[list[tuple[str, float, float]], bool]:
    """(quantity, relative error, error in standard uncertainties) of everything in one world; whether it fits."""
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng, tier)
    with tempfile.TemporaryDirectory() as folder:
        campaign = read_campaign(simulate_campaign(truth, standard_plan(), rng, Path(folder) / "c"))
    result = characterize(campaign, seed)
    pairs = [("alpha", result.temperature.rows[0], truth.thermal_diffusivity_m2_s)]
    for row in result.humidity.rows:
        name = QUANTITIES[1] if row.basis.startswith("isothermal") else QUANTITIES[2]
        pairs.append((name, row, float(truth.diffusivity_m2_s(row.ambient_c))))
    values = [
        (name, row.diffusivity_m2_s / true - 1, (row.diffusivity_m2_s - true) / row.standard_uncertainty)
        for name, row, true in pairs
    ]
    return values, all(found.explained for found in result.channels().values())


def line(tier: str, name: str, values: list[tuple[float, float]]) -> str:
    """One row of the table."""
    error, z = np.abs(np.array(values)).T
    return (
        f"{tier:<8}{name:<24}{error.size:>5}{100 * np.median(error):>12.2f} %{100 * error.max():>7.2f} %"
        f"{100 * np.mean(z < 2):>14.1f} %{np.sqrt(np.mean(z**2)):>8.2f}"
    )


if __name__ == "__main__":
    main()
