"""The first demonstration: what the paper's own simulation gets wrong when it meets a bead with a real air film.

    python benchmarks/demonstration_air_film.py --out demonstration

records the standard campaign on the virtual bench with a glass bead (0.4 mm, alpha 5.0e-7 m2/s) behind an air film of
Biot number 0.1 at 5 m/s and nothing else, diagnoses it, and copies the figures that are shown to docs/images.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

IMAGES = Path(__file__).parent.parent / "docs" / "images"
BIOT_AT_5_M_S = 0.1
GLASS_M2_S = 5.0e-7
SHOWN = {
    "temperature_before_after": "air_film_before_after",
    "temperature_residuals": "air_film_residuals",
    "temperature_by_condition": "air_film_alpha_run_by_run",
    "inversion": "air_film_in_flight",
}


def record(campaign: Path, seed: int) -> None:
    """The standard campaign with the air film, into an empty folder."""
    from shockrig.rig.virtual.batch import simulate_campaign
    from shockrig.rig.virtual.plans import standard_plan
    from shockrig.rig.virtual.truth import Hidden, draw_truth

    rng = np.random.default_rng(seed)
    film = Hidden("convective_film", {"biot_at_5_m_s": BIOT_AT_5_M_S}, ("temperature",))
    truth = replace(draw_truth(rng, effects=[film]), thermal_diffusivity_m2_s=GLASS_M2_S)
    simulate_campaign(truth, standard_plan(), rng, campaign)


def main(argv: list[str] | None = None) -> int:
    """Record, diagnose, keep the figures."""
    from shockrig.protocols.cli import main as shockrig

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("demonstration"))
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(argv)
    campaign, diagnosis = args.out / "campaign", args.out / "diagnosis"
    if not campaign.exists():
        record(campaign, args.seed)
    status = shockrig(["diagnose", str(campaign), "--out", str(diagnosis)])
    if status == 0:
        IMAGES.mkdir(parents=True, exist_ok=True)
        for name, kept in SHOWN.items():
            shutil.copyfile(diagnosis / f"{name}.png", IMAGES / f"{kept}.png")
    return status


if __name__ == "__main__":
    sys.exit(main())
