"""shockrig example: the samples that ship, listed or copied into the folder that one stands in."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.epilog = "Without a name they are listed. In Python: shockrig.example(NAME) is the path of what ships."
    parser.add_argument(
        "name", metavar="NAME", nargs="?", help="such as steps.csv, flight.csv, flight.bin, profile.json"
    )
    parser.add_argument("--out", metavar="PATH", type=Path, help="where it is copied to (default: ./NAME)")


def main(args: argparse.Namespace) -> int:
    """List, or copy one."""
    import shutil

    from shockrig.examples import WHAT, example
    from shockrig.files.disk import is_there, shown
    from shockrig.files.errors import InputError

    if args.name is None:
        if args.out is not None:
            raise InputError("--out: is for one example; name it, such as shockrig example steps.csv")
        width = max(map(len, WHAT))
        print("\n".join(f"{name:<{width}}  {what}" for name, what in WHAT.items()))
        return 0
    source = example(args.name)
    target: Path = args.out or Path(args.name)
    if target.is_dir() and source.is_file():
        target = target / source.name
    if is_there(target):
        raise InputError(f"{shown(target)}: is there already; give another --out")
    if source.is_dir():
        shutil.copytree(source, target)
    else:
        shutil.copyfile(source, target)
    print(target)
    if args.name in NEXT:
        print(f"next: {NEXT[args.name].format(target)}", file=sys.stderr)
    return 0


NEXT = {
    "steps.csv": "shockrig import {} --look",
    "flight.csv": "shockrig example profile.json, then shockrig correct {} --profile profile.json --out corrected.csv",
    "flight.bin": "shockrig example profile.json, then shockrig correct {} --profile profile.json --out corrected.csv",
    "flight.nc": "shockrig example profile.json, then shockrig correct {} --profile profile.json --out corrected.csv",
    "plain-rough": "shockrig characterize {} --out first",
    "ordinary-bench": "shockrig diagnose {} --out diagnosis",
}
