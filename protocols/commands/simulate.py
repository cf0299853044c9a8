"""shockrig simulate: weather and a sensor flown through it, to files: the log, and the truth beside it."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

SCENES = ("convective", "frontal", "inversion")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("scene", choices=SCENES, help=f"weather: {', '.join(SCENES)}")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for flight.csv and truth.csv")
    parser.add_argument(
        "--profile", type=Path, metavar="P", help="profile.json of the sensors; a typical pair if left out"
    )
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="which weather and noise (default: 0)")
    parser.add_argument("--noise", type=float, default=1.0, help="multiplies the profile's noise floors (default: 1)")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="OPTION=VALUE",
        dest="options",
        help="option of the scene, e.g. duration_s=900 or strength_k=8; a wrong name lists them all",
    )


def main(args: argparse.Namespace) -> int:
    """Write DIR/flight.csv and DIR/truth.csv."""
    import inspect

    import numpy as np

    from shockrig.analysis.flight.simulated.sensor import fly
    from shockrig.analysis.flight.simulated.typical import typical_profile
    from shockrig.analysis.flight.simulated.weather import SCENES as MAKERS
    from shockrig.files.errors import InputError
    from shockrig.files.profile import read_profile, write_profile
    from shockrig.protocols.folder import whole_folder

    maker = MAKERS[args.scene]
    known = [name for name in inspect.signature(maker).parameters if name != "rng"]
    options = {}
    for choice in args.options:
        name, _, text = choice.partition("=")
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if name not in known or not np.isfinite(value):
            raise InputError(f"--set {choice}: expected OPTION=NUMBER with an option of {', '.join(known)}")
        options[name] = value
    if not 0 <= args.noise < 1e6:
        raise InputError(f"--noise {args.noise:g}: expected 0 to 1e6")
    profile = read_profile(args.profile) if args.profile else typical_profile()
    try:
        with np.errstate(all="ignore"):
            weather = maker(np.random.default_rng([args.seed, 1]), **options)
        if not 10.0 <= weather.time_s[-1] <= 90_000.0 or not np.all(
            np.isfinite(weather.temperature_c + weather.humidity_percent)
        ):
            raise ValueError(
                f"gives a flight of {weather.time_s[-1]:.3g} s or air that is no number; 10 s to 90000 s can be flown"
            )
    except (ValueError, ZeroDivisionError, OverflowError, IndexError, MemoryError) as error:
        raise InputError(f"--set {' '.join(args.options)}: {error}") from error
    with whole_folder(args.out) as folder:
        flown = fly(weather, profile, args.seed, noise=args.noise)
        flown.log.to_csv(folder / "flight.csv", index=False)
        flown.truth.round(5).to_csv(folder / "truth.csv", index=False)
        if not args.profile:
            write_profile(profile, folder / "profile.json")
    print(f"{args.out / 'flight.csv'}: {len(flown.log)} rows of {args.scene} weather, seed {args.seed}")
    print(f"{args.out / 'truth.csv'}: the air at the same instants")
    hint = args.profile or args.out / "profile.json"
    command = ["shockrig", "correct", args.out / "flight.csv", "--profile", hint, "--out", "corrected.csv"]
    print(f"next: {shlex.join(map(str, command))}", file=sys.stderr)
    return 0
