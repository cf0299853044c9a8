"""shockrig demo: the whole way on the embedded virtual bench: record, characterize, diagnose, open the sealed truth."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shockrig.rig.virtual.truth import Truth


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("demo"), help="folder for everything (demo)")
    parser.add_argument("--seed", metavar="N", type=int, default=1, help="which sensors and noise (1)")
    parser.add_argument("--hide", metavar="WHAT", help="effects to hide in the sensors, as in shockrig run")


def main(args: argparse.Namespace) -> int:
    """Record the standard campaign, characterize it, diagnose it, print how far all is from the truth."""
    from shockrig.rig.errors import BenchError
    from shockrig.rig.virtual.hide import open_seal

    campaign, sealed = args.out / "campaign", args.out / "campaign.sealed"
    try:
        args.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BenchError(f"--out {args.out}: {error.strerror}; name a folder that can be written") from None
    hidden = [] if args.hide is None else ["--hide", args.hide]
    _shockrig("run", "standard", "--out", str(campaign), "--seed", str(args.seed), *hidden)
    _shockrig("characterize", str(campaign), "--out", str(args.out / "characterization"))
    _shockrig("diagnose", str(campaign), "--out", str(args.out / "diagnosis"))
    profile = args.out / "diagnosis" / "profile.json"
    truth, _ = open_seal(sealed)
    print()
    print(against_truth(profile, truth))
    reports = ", ".join(str(path) for path in sorted(args.out.glob("*/report.html")))
    print(f"reports: {reports}")
    return 0


def against_truth(profile_file: Path, truth: Truth) -> str:
    """alpha and D(T) of a profile beside the sealed truth, and how far they are off."""
    from shockrig.files.profile import read_profile

    profile = read_profile(profile_file)
    rows = []
    if profile.temperature is not None:
        alpha = profile.temperature.thermal_diffusivity_m2_s
        rows.append(("alpha", 1e8, alpha.value, alpha.standard_uncertainty, truth.thermal_diffusivity_m2_s))
    if profile.humidity is not None:
        for row in profile.humidity.diffusivity_table:
            true = float(truth.diffusivity_m2_s(row.ambient_temperature_c))
            label = f"D at {round(row.ambient_temperature_c, 1) + 0.0:.1f} °C"
            rows.append((label, 1e12, row.diffusivity_m2_s, row.standard_uncertainty, true))
    lines = ["against the sealed truth   unit         found              truth      off by"]
    for label, scale, value, spread, true in rows:
        unit = f"{1 / scale:.0e} m²/s"
        found = f"{value * scale:.4f} ± {spread * scale:.4f}"
        off = f"{100 * (value / true - 1):+.2f} %, {(value - true) / spread:+.1f} sigma"
        lines.append(f"  {label:<22}{unit:>13}  {found:<18} {true * scale:.4f}     {off}")
    return "\n".join(lines)


def _shockrig(*arguments: str) -> None:
    """One command of the command line, said before it starts."""
    from shockrig.protocols.cli import build_parser

    print(f"$ shockrig {' '.join(arguments)}", flush=True)
    print(f"shockrig {arguments[0]} ...", file=sys.stderr, flush=True)
    parsed = build_parser(arguments[0]).parse_args(list(arguments))
    parsed.main(parsed)
