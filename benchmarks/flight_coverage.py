"""Honesty of the smoother over many flights: error, stated uncertainty, coverage of the 95 % interval, and harm done.

    python benchmarks/flight_coverage.py [--flights N] [--first-seed N]

Each flight has its own weather, noise and sensor: parameters drawn about the profile's by their stated uncertainties,
an extended pair in half of the flights, and strengths of the weather drawn over a decade.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys

import numpy as np

from shockrig.analysis.flight.simulated.scenes import scores, try_scene
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import SCENES
from shockrig.files.profile import Profile, StatedEffect, Uncertain


def extended(profile: Profile) -> Profile:
    """The pair with an air film and a stem at the bead, a boundary layer and a slow share at the film."""
    film = StatedEffect("convective_film", {"biot_at_5_m_s": Uncertain(0.5, 0.005)})
    stem = StatedEffect("stem_conduction", {"fraction": Uncertain(0.03, 0.001), "time_constant_s": Uncertain(8.0, 0.2)})
    layer = StatedEffect("vapour_boundary_layer", {"biot_at_5_m_s": Uncertain(8.0, 0.1)})
    slow = StatedEffect(
        "slow_relaxation", {"fraction": Uncertain(0.05, 0.002), "time_constant_s": Uncertain(30.0, 1.0)}
    )
    return dataclasses.replace(
        profile,
        temperature=dataclasses.replace(profile.temperature, effects=(film, stem)),
        humidity=dataclasses.replace(profile.humidity, effects=(layer, slow)),
    )


def drawn(profile: Profile, rng: np.random.Generator) -> Profile:
    """A pair whose every parameter lies about the profile's by its standard uncertainty."""

    def moved(u: Uncertain) -> Uncertain:
        return Uncertain(u.value + u.standard_uncertainty * rng.standard_normal())

    def effects(part) -> tuple[StatedEffect, ...]:
        return tuple(StatedEffect(e.effect, {k: moved(v) for k, v in e.parameters.items()}) for e in part.effects)

    rows = tuple(
        dataclasses.replace(r, diffusivity_m2_s=moved(Uncertain(r.diffusivity_m2_s, r.standard_uncertainty)).value)
        for r in profile.humidity.diffusivity_table
    )
    bead, film = profile.temperature, profile.humidity
    return Profile(
        dataclasses.replace(bead, thermal_diffusivity_m2_s=moved(bead.thermal_diffusivity_m2_s), effects=effects(bead)),
        dataclasses.replace(film, diffusivity_table=rows, effects=effects(film)),
    )


def options(scene: str, rng: np.random.Generator) -> dict[str, float]:
    """Strengths drawn over about a decade."""
    factor = 10 ** rng.uniform(-0.5, 0.5)
    if scene == "convective":
        return {
            "temperature_std_k": 0.4 * factor,
            "humidity_std_percent": 2.0 * factor,
            "temperature_c": rng.uniform(5, 30),
        }
    quiet = {"turbulence_k": rng.choice([0.0, 0.05 * factor]), "turbulence_percent": rng.choice([0.0, 0.2 * factor])}
    if scene == "frontal":
        return quiet | {
            "temperature_change_k": -rng.uniform(2, 12),
            "width_m": rng.uniform(150, 1500),
            "lead_m": 2700.0,
        }
    return quiet | {
        "strength_k": rng.uniform(1, 8),
        "depth_m": rng.uniform(15, 80),
        "surface_temperature_c": rng.uniform(10, 25),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=4000)
    args = parser.parse_args()
    table: dict[tuple[str, str, str], list] = {}
    for scene in SCENES:
        for seed in range(args.first_seed, args.first_seed + args.flights):
            rng = np.random.default_rng([seed, 3])
            profile = typical_profile()
            profile = extended(profile) if seed % 2 else profile
            print(f"{scene} {seed}", file=sys.stderr)
            trial = try_scene(scene, profile, [seed], flown_with=drawn(profile, rng), **options(scene, rng))[0]
            for s in scores(trial):
                table.setdefault((scene, s.channel, s.method), []).append((s.raw, s.rmse, s.stated, s.coverage))
    print(f"{args.flights} flights a scene, seeds from {args.first_seed}; errors in K and %RH, medians over flights")
    heads = f"{'reading':>9}{'corrected':>11}{'stated':>9}{'covered':>9}{'5..95 % of flights':>20}"
    heads += f"{'worst ratio':>13}{'flights':>9}"
    print(f"{'scene':<12}{'channel':<13}{'method':<10}{heads}")
    for (scene, channel, method), rows in table.items():
        raw, error, stated, covered = np.array(rows).T
        low, high = np.quantile(covered, [0.05, 0.95])
        print(
            f"{scene:<12}{channel:<13}{method:<10}{np.median(raw):>9.4f}{np.median(error):>11.4f}{np.median(stated):>9.4f}"
            f"{covered.mean():>9.3f}{f'{low:.3f} .. {high:.3f}':>20}{(error / raw).max():>13.3f}{len(rows):>9}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
