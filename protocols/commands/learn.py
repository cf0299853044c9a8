"""shockrig learn: flights of one sensor in, what they say of it out: its lags, its clock, what cannot be told."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.epilog = "Each flight must pass the same air twice: an ascent and its descent, spirals, hovers between them."
    parser.add_argument(
        "flights", metavar="FLIGHT", type=Path, nargs="+", help="logs of one sensor, as correct takes them"
    )
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder for the page and the files")
    parser.add_argument(
        "--profile", metavar="P", type=Path, help="a bench's profile.json: what is known before the flights"
    )
    parser.add_argument(
        "--column",
        action="append",
        default=[],
        metavar="QUANTITY=NAME",
        help="a column that is not recognised, as in correct",
    )
    parser.add_argument("--map", type=Path, metavar="MAP.toml", help="read any text log by a map, as in correct")


def main(args: argparse.Namespace) -> int:
    """Learn, write, print."""
    from datetime import UTC, datetime

    from shockrig.analysis.learn.profile import learned_profile
    from shockrig.analysis.report.learned_page import write_learned_page
    from shockrig.files.learned import write_learned
    from shockrig.files.profile import read_profile, write_profile
    from shockrig.protocols.commands.correct import chosen_columns
    from shockrig.protocols.folder import software_version, whole_folder
    from shockrig.protocols.learning import disagree, learned_file, learned_from, named_flights, sentence
    from shockrig.protocols.time_left import LEARNING, Phases

    columns = chosen_columns(args.column)
    bench = None if args.profile is None else read_profile(args.profile)
    flights, said = named_flights(args.flights, columns, args.map)
    for note in said:
        print(f"note: {note}", file=sys.stderr)
    say = Phases(LEARNING)
    learned = learned_from(flights, bench, lambda text: say(f"{text} ..."))
    provenance = {
        "flights": ", ".join(str(path) for path in args.flights),
        "software": f"shockrig {software_version()}",
        "made_at": datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
    }
    if args.profile is not None:
        provenance["bench"] = str(args.profile)
    profile = learned_profile(learned, provenance, bench)
    with whole_folder(args.out) as folder:
        write_learned(learned_file(learned, flights, provenance), folder / "learned.json")
        if profile is not None:
            write_profile(profile, folder / "profile.json")
        write_learned_page(learned, folder / "learned.html", [str(path) for path in args.flights])
    for one in learned.channels.values():
        print(sentence(one))
        print(f"  {disagree(one)}")
    for cause in learned.position:
        (shift,) = cause.parameters
        names = " or ".join(cause.law.causes).replace("_", " ")
        print(
            f"position: {'named' if learned.position_named else 'possible'}: {names}, "
            f"{shift.value:.3g} ± {shift.standard_uncertainty:.2g} s (probability {cause.probability:.2f})"
        )
        if learned.position_named:
            print(f"  shockrig correct --clock-s {shift.value:.3g} takes it off")
    for name, why in learned.left_out.items():
        print(f"left out: {name}: {why}")
    print(f"report: {args.out / 'learned.html'}")
    print(
        f"profile: {args.out / 'profile.json'}"
        if profile is not None
        else "no profile: no lag that these flights show brings their passes together"
    )
    return 0
