"""shockrig hil: hardware in the loop in one command, from played air to the corrected flight."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.epilog = (
        "Drivers, corrector, messages and logs are those that fly; time is virtual. Faults of instruments and links: "
        "docs/faults.md."
    )
    parser.add_argument(
        "flight", type=Path, metavar="FLIGHT", help="the air that is played: a flight, corrected or not"
    )
    parser.add_argument("--profile", type=Path, metavar="P", help="the sensors that fly (default: a typical pair)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the logs and the page")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="noise of the sensors (default: 0)")
    parser.add_argument("--lag-s", type=float, default=0.0, metavar="S", help="as of shockrig fly (default: 0)")
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND@START[-END]",
        help="of a sensor or a link from START to END s, e.g. loss@60-90; a wrong KIND lists them all",
    )


def main(args: argparse.Namespace) -> int:
    """Play, fly, hear, correct, compare; print what was lost and found."""
    from shockrig.analysis.flight.simulated.typical import typical_profile
    from shockrig.analysis.report.hil_page import hil_report
    from shockrig.files.errors import InputError
    from shockrig.files.profile import read_profile
    from shockrig.protocols.commands.emulate import fault_of
    from shockrig.protocols.flight_world import flight_world, read_flown_air
    from shockrig.protocols.folder import software_version
    from shockrig.protocols.hil import KINDS, fly_emulated, judge
    from shockrig.protocols.time_left import PLAYING, Phases
    from shockrig.rig.bench_errors import BenchError

    if not 0.0 <= args.lag_s <= 60.0:
        raise InputError(f"--lag-s {args.lag_s:g}: expected 0 to 60 s")
    faults = [fault_of(text) for text in args.fault]
    for fault in faults:
        if fault.kind not in KINDS:
            raise BenchError(f"no fault {fault.kind!r} here; there are {', '.join(KINDS)}")
    profile = typical_profile() if args.profile is None else read_profile(args.profile)
    air = read_flown_air(args.flight)
    say = Phases(PLAYING)
    say(f"flying the sensors through {air.time_s[-1]:.0f} s of air ...")
    world = flight_world(air, profile, args.seed)
    folder = fly_emulated(world, profile, args.out, faults, args.seed, args.lag_s)
    say("what was flown is corrected and held against the air ...")
    result = judge(folder, world, profile)
    provenance = {
        "flight": str(args.flight),
        "profile": "a typical pair" if args.profile is None else str(args.profile),
        "faults put in": ", ".join(args.fault) or "none",
        "seed": args.seed,
        "software": f"shockrig {software_version()}",
        "data": "emulated sensors in air that was played; nothing of this was measured",
    }
    say("page ...")
    page = hil_report(result, args.flight.name, provenance).write(folder / "hil.html")
    for stage in (*result.stages, *result.totals):
        print(f"{stage.name:30} {stage.temperature_k:8.2g} K {stage.humidity_percent:8.2g} %RH")
    for words in (*map(str, result.findings), *result.sensors):
        print(f"found: {words}")
    print(f"logs: {folder}\nreport: {page}")
    return 0
