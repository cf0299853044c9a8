"""shockrig bench: a bench file that ships, printed, to be redirected into a file of one's own and edited."""

from __future__ import annotations

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.epilog = (
        "shockrig bench raspberry-pi > my.toml copies one; edit it, then shockrig check --bench my.toml. Without a "
        "name they are listed. shockrig scan writes one of what is connected to this computer."
    )
    parser.add_argument("name", metavar="NAME", nargs="?", help="drone, manual, raspberry-pi or virtual")


def main(args: argparse.Namespace) -> int:
    """List them, or print one."""
    from importlib.resources import files

    from shockrig.files.errors import InputError

    folder = files("shockrig.data") / "benches"
    texts = {
        entry.name.removesuffix(".toml"): entry.read_text(encoding="utf-8")
        for entry in folder.iterdir()
        if entry.name.endswith(".toml")
    }
    if args.name is None:
        for name in sorted(texts):
            first = texts[name].splitlines()[0].removeprefix("#").strip()
            print(f"{name:<14}{first}")
        return 0
    if args.name not in texts:
        raise InputError(f"no bench {args.name!r} ships; give one of {', '.join(sorted(texts))}")
    print(texts[args.name], end="")
    return 0
