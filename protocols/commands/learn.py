"""shockrig learn: flights of one sensor in, what they say of it out: its lags, its clock, what cannot be told."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shockrig.analysis.learn.learn import FlightsLearned
    from shockrig.analysis.learn.pair import PairLearned
    from shockrig.files.flight import Flight
    from shockrig.files.profile import Profile


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
    parser.add_argument(
        "--beside",
        nargs="+",
        action="extend",
        default=[],
        metavar="SECOND",
        help="a second sensor in the same air: its logs, one for each flight in order, or temperature=NAME and "
        "humidity=NAME of its columns in the same logs",
    )
    parser.add_argument("--map", type=Path, metavar="MAP.toml", help="read any text log by a map, as in correct")


def main(args: argparse.Namespace) -> int:
    """Learn, write, print."""
    from datetime import UTC, datetime

    from shockrig.files.profile import read_profile
    from shockrig.protocols.commands.correct import chosen_columns
    from shockrig.protocols.folder import software_version, whole_folder
    from shockrig.protocols.learning import beside_flights, learned_from, named_flights, pair_from
    from shockrig.protocols.time_left import LEARNING, LEARNING_BESIDE, Phases

    columns = chosen_columns(args.column)
    bench = None if args.profile is None else read_profile(args.profile)
    flights, said = named_flights(args.flights, columns, args.map)
    beside = beside_flights(args.beside, args.flights, flights, columns, args.map) if args.beside else None
    for note in (*said, *(beside.said if beside is not None else ())):
        print(f"note: {note}", file=sys.stderr)
    say = Phases(LEARNING if beside is None else LEARNING_BESIDE)
    pair = None if beside is None else pair_from(flights, beside, bench, lambda text: say(f"{text} ..."))
    sensors = pair.together if pair else (learned_from(flights, bench, lambda text: say(f"{text} ...")),)
    provenance = {
        "flights": ", ".join(str(path) for path in args.flights),
        "software": f"shockrig {software_version()}",
        "made_at": datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
    }
    if args.profile is not None:
        provenance["bench"] = str(args.profile)
    if beside is not None:
        provenance["beside"] = ", ".join(args.beside)
    with whole_folder(args.out) as folder:
        profiles = [_write(one, folder, i, flights, provenance, bench, pair) for i, one in enumerate(sensors)]
    for i, one in enumerate(sensors):
        _print(one, args.out, i, flights, profiles[i], pair)
    return 0


def _named(stem: str, suffix: str, which: int) -> str:
    """A file's name: of the second sensor with a 2."""
    return f"{stem}_{which + 1}{suffix}" if which else f"{stem}{suffix}"


def _write(
    learned: FlightsLearned,
    folder: Path,
    which: int,
    flights: Mapping[str, Flight],
    provenance: Mapping[str, str],
    bench: Profile | None,
    pair: PairLearned | None,
) -> bool:
    """A sensor's learned.json, profile.json and page; whether there is a profile. `bench` is the first sensor's."""
    from shockrig.analysis.learn.learned_profile import learned_profile
    from shockrig.analysis.report.learned_page import write_learned_page
    from shockrig.files.learned import write_learned
    from shockrig.files.profile import write_profile
    from shockrig.protocols.learning import differ, learned_file

    profile = learned_profile(learned, provenance, None if which else bench)
    write_learned(learned_file(learned, flights, provenance, pair), folder / _named("learned", ".json", which))
    if profile is not None:
        write_profile(profile, folder / _named("profile", ".json", which))
    files, said = provenance["flights"].split(", "), {}
    if pair is not None:
        said = {
            "sensor": f"the {('first', 'second')[which]} of two side by side",
            "how they differ": "; ".join(differ(name, one) for name, one in pair.apart.items()),
        }
    write_learned_page(learned, folder / _named("learned", ".html", which), files, provenance=said)
    return profile is not None


def _print(
    learned: FlightsLearned,
    out: Path,
    which: int,
    flights: Mapping[str, Flight],
    profile: bool,
    pair: PairLearned | None,
) -> None:
    """What was found of a sensor."""
    from shockrig.protocols.learning import differ, disagree, sentence, shift_by_pressure

    if pair is not None:
        print(("the first sensor", "the second sensor")[which])
    for name, one in learned.channels.items():
        print(sentence(one))
        if pair is not None and name in pair.apart:
            print(f"  alone it would be {sentence(pair.alone[which].channels[name]).removeprefix(f'{name}: ')}")
        print(f"  {disagree(one)}")
    for cause in learned.position:
        (shift,) = cause.parameters
        names = " or ".join(cause.law.causes).replace("_", " ")
        print(
            f"position: {'named' if learned.position_named else 'possible'}: {names}, "
            f"{shift.value:.3g} ± {shift.standard_uncertainty:.2g} s (probability {cause.probability:.2f})"
        )
        own = [s for one in flights.values() if (s := shift_by_pressure(one)) is not None]
        if own:
            print(
                f"  by the pressure in the logs the altitude is {min(own):.1f} to {max(own):.1f} s behind it: if the "
                "sensors' logger reads that pressure, no more of it is a clock"
            )
        if learned.position_named:
            print(f"  shockrig correct --clock-s {shift.value:.3g} takes it off")
    for name, why in learned.left_out.items():
        print(f"left out: {name}: {why}")
    print(f"report: {out / _named('learned', '.html', which)}")
    print(
        f"profile: {out / _named('profile', '.json', which)}"
        if profile
        else "no profile: these flights show no lag that they identify and that brings their passes together"
    )
    if pair is not None and which:
        for name, apart in pair.apart.items():
            print(f"side by side: {differ(name, apart)}")
