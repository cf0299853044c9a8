"""shockrig reveal: open a sealed truth beside a diagnosis and print how the diagnosis did."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sealed", metavar="SEALED", type=Path, help="the sealed file that hiding wrote")
    parser.add_argument(
        "--diagnosis", metavar="DIAGNOSIS.json", type=Path, required=True, help="diagnosis.json to judge"
    )
    parser.add_argument(
        "--probe", metavar="NAME", default="1", help="whose diagnosis it is, of several probes (default: 1)"
    )


def main(args: argparse.Namespace) -> int:
    from shockrig.protocols.reveal import score, table

    print(table(score(args.sealed, args.diagnosis, args.probe)))
    return 0
