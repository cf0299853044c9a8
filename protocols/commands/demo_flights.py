"""shockrig demo-flights: the paper's flight figures made again on simulated weather, three corrections side by side."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("--out", type=Path, default=Path("demo-flights"), metavar="DIR", help="default: demo-flights")
    parser.add_argument(
        "--profile", type=Path, metavar="P", help="profile.json of the sensors; a typical pair if left out"
    )
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="which weather and noise (default: 0)")


def main(args: argparse.Namespace) -> int:
    """Fly three scenes, correct them with every method, print the table and write the report."""
    from shockrig.analysis.flight.simulated.scenes import CHANNELS, scores, try_scene
    from shockrig.analysis.flight.simulated.typical import typical_profile
    from shockrig.analysis.flight.simulated.weather import SCENES
    from shockrig.analysis.report.flight_page import write_flights_report
    from shockrig.files.errors import InputError
    from shockrig.files.profile import read_profile
    from shockrig.protocols.folder import whole_folder
    from shockrig.protocols.time_left import TimeLeft

    profile = read_profile(args.profile) if args.profile else typical_profile()
    if profile.temperature is None or profile.humidity is None:
        raise InputError(
            f"{args.profile}: the demonstration flies both sensors; give a profile with temperature and humidity"
        )
    provenance = {
        "seed": str(args.seed),
        "profile": str(args.profile or "typical pair"),
        "made by": "shockrig demo-flights",
    }
    trials, clock = {}, TimeLeft()
    each = 1.0 / (3.0 * len(SCENES))  # the figures take two thirds
    with whole_folder(args.out) as folder:
        for number, scene in enumerate(SCENES):
            print(f"flying {scene} ...{clock.after((number + 0.5) * each)}", file=sys.stderr, flush=True)
            trials[scene] = try_scene(scene, profile, [args.seed])[0]
        print(f"figures and page ...{clock.after((len(SCENES) + 0.5) * each)}", file=sys.stderr, flush=True)
        path = args.out / write_flights_report(trials, profile, folder, provenance).name
    print(f"{'scene':<12}{'channel':<13}{'method':<10}{'reading':>9}{'corrected':>11}{'stated':>9}{'95 % holds':>12}")
    for trial in trials.values():
        for s in scores(trial):
            unit = CHANNELS[s.channel][1]
            errors = f"{s.raw:>9.4f}{s.rmse:>11.4f}{s.stated:>9.4f}{100 * s.coverage:>11.1f}%"
            print(f"{s.scene:<12}{s.channel:<13}{s.method:<10}{errors}  {unit}")
        for reason in trial.refused.values():
            print(f"  {reason}")
    print(f"report: {path}")
    return 0
