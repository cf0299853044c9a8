"""shockrig fleet: what several sensors of one type say together; who does not belong; a prior for the next one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from shockrig.files.fleet_file import Fleet

EVERY_S = 3.0  # a line of progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.epilog = (
        "Each campaign is characterized once and kept in OUT/measured: a command that is started again goes on. "
        "Campaigns with the same serial numbers are one sensor's."
    )
    parser.add_argument(
        "folders", metavar="DIR", type=Path, nargs="+", help="campaigns, or folders that hold campaigns"
    )
    parser.add_argument(
        "--out", metavar="OUT", type=Path, required=True, help="folder for fleet.html, fleet.json and the tables"
    )
    parser.add_argument(
        "--extend", metavar="DIAGNOSIS.json", type=Path, help="fit the model with the causes that this diagnosis names"
    )
    parser.add_argument(
        "--workers", metavar="N", type=int, help="processes on this machine (default: one for each processor)"
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a Dask cluster to work on, such as tcp://host:8786")


def main(args: argparse.Namespace) -> int:
    """Characterize all, estimate, write, print."""
    from datetime import UTC, datetime

    from shockrig.analysis.fleet.fleet import fleet_of
    from shockrig.analysis.report.fleet_page import verdict, write_fleet_page
    from shockrig.files.errors import InputError
    from shockrig.files.fleet_file import write_fleet
    from shockrig.files.fleet_views import write_fleet_tables
    from shockrig.files.numbers import counted
    from shockrig.files.profile import write_profile
    from shockrig.protocols.commands.characterize import say
    from shockrig.protocols.fleet_map import KEPT_IN, measured_fleet, said_now_and_then, tasks_of
    from shockrig.protocols.folder import software_version, whole_folder
    from shockrig.protocols.parallel import processors

    if args.workers is not None and args.workers < 1:
        raise InputError(f"--workers {args.workers}: expected at least 1")
    made_at = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
    tasks, unread = tasks_of(args.folders, args.extend, args.out / KEPT_IN)
    found, failed = measured_fleet(tasks, args.workers or processors(), args.scheduler, said_now_and_then(EVERY_S))
    provenance: dict[str, Any] = {
        "campaigns": ", ".join(str(folder) for folder in args.folders),
        "software": f"shockrig {software_version()}",
        "made_at": made_at,
    }
    if args.extend is not None:
        provenance["extended_by"] = str(args.extend)
    if emulated := sum(one.emulated for one in found):
        provenance["data"] = f"emulated instruments: invented, not measured ({emulated} of {len(found)} probes)"
    say(f"population of {counted(len(found), 'probe')}")
    fleet = fleet_of(found, {**unread, **failed}, provenance)
    with whole_folder(args.out) as folder:
        write_fleet(fleet, folder / "fleet.json")
        write_profile(fleet.population.typical(provenance), folder / "profile.json")
        write_fleet_tables(fleet, folder, f"{made_at} {provenance['software']}")
        write_fleet_page(fleet, folder)
    print(summary(fleet))
    print(verdict(fleet))
    print(f"report: {args.out / 'fleet.html'}")
    print(f"prior: {args.out / 'fleet.json'}")
    return 0


def summary(fleet: Fleet) -> str:
    """A line for each number of the type, and for each campaign that is left out."""
    from shockrig.files.fleet_views import typical_text

    one = fleet.population
    lines = [f"{one.label(c)}: {typical_text(one, k)}" for k, c in enumerate(one.coordinates)]
    lines += [f"left out: {name}: {why}" for name, why in fleet.left_out.items()]
    return "\n".join(lines)
