"""shockrig list: the campaigns of a folder, what they gave, and what changed by serial number."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.epilog = "Results are found in the same folder: profile.json by the campaign that its provenance names."
    parser.add_argument(
        "folder", metavar="FOLDER", type=Path, nargs="?", default=Path(), help="where to look (default: .)"
    )


def main(args: argparse.Namespace) -> int:
    """Print the catalogue."""
    from shockrig.files.disk import shown
    from shockrig.files.errors import InputError
    from shockrig.files.headline import headlines
    from shockrig.files.numbers import counted
    from shockrig.protocols.catalogue import catalogue, changes

    if not args.folder.is_dir():
        raise InputError(f"{shown(args.folder)}: is no folder; name the one that your campaigns are in")
    entries, troubles = catalogue(args.folder)
    for trouble in troubles:
        print(f"not read: {trouble}", file=sys.stderr)
    if not entries:
        raise InputError(f"{shown(args.folder)}: holds no campaign (no campaign.json); name another folder")
    for entry in entries:
        state = entry.state
        planned = f" of {len(state.planned)}" if state.planned else ""
        emulated = ", emulated" if state.emulated else ""
        aside = f", {len(state.set_aside)} set aside" if state.set_aside else ""
        began = entry.began_at[:16] or "time not known"
        runs = f"{len(state.recorded)}{planned} runs" if planned else counted(len(state.recorded), "run")
        print(f"{shown(entry.path)}  {began}  {runs}{aside}{emulated}")
        if entry.serials:
            print("  " + ", ".join(f"{sensor} {serial}" for sensor, serial in entry.serials.items()))
        for file, profile in sorted(entry.profiles.items()):
            known = "; ".join(f"{name} {value}" for name, value in headlines(profile))
            print(f"  {shown(file.parent)}: {known or 'no rate'}")
        if entry.verdicts:
            print("  " + ", ".join(f"{channel}: {verdict}" for channel, verdict in entry.verdicts.items()))
    for text in changes(entries):
        print(text)
    return 0
