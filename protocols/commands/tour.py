"""shockrig tour: bench, log and flight, one after the other, in ten minutes: each command is explained, typed and run.

It runs what one would type, in a folder of its own, and stops before each step; --yes goes on by itself.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

WIDTH = 96


@dataclass(frozen=True)
class Stop:
    """One stop of the tour: what it is for, the commands (as typed), and what to look at afterwards."""

    title: str
    why: str
    commands: Sequence[str]
    look: str


STOPS = (
    Stop(
        "The bench: how fast are these sensors?",
        "A bench moves the sensors from one air into another, and records how they follow. This one is emulated, down "
        "to the bytes on the wire; with instruments of your own the same command takes --bench my.toml. `quick` makes "
        "two such transfers.",
        ("shockrig run quick --out bench --seed 5", "shockrig characterize bench --out bench-first"),
        "bench-first/report.html shows each transfer with its fit. alpha and D are how fast heat and vapour get into "
        "the sensors; t63 is how long they take for the first 63 % of a step.",
    ),
    Stop(
        "A log: the same from any logger's file",
        "A thermometer and a hygrometer were carried between rooms, and only the logger was running: nobody wrote down "
        "when. The first look says which columns it recognises and which steps it sees, in a map that you may correct; "
        "the second command makes a campaign of it.",
        (
            "shockrig example steps.csv",
            "shockrig import steps.csv --look",
            "shockrig import steps.csv --map steps.toml --out log",
            "shockrig characterize log --out log-first",
        ),
        "steps.png is the log with the steps that were seen. tau is the time constant of a sensor of which nobody "
        "knows the shape; the log was made with 4 s and 9 s.",
    ),
    Stop(
        "What else is wrong with them?",
        "The diagnosis asks what the simple model gets wrong, which cause explains it best, and by how much unseen "
        "transfers are then predicted better. It may take half a minute.",
        ("shockrig diagnose log --out log-diagnosis",),
        "log-diagnosis/report.html: the verdict in a sentence, residuals before and after, what to do about it.",
    ),
    Stop(
        "A flight: the lag taken out",
        "A drone flew up and down through a warm, dry layer. Its sensors met the layer too high on the way up, and too "
        "low on the way down. The profile says how they lag; the correction undoes it, with an uncertainty for each "
        "value.",
        (
            "shockrig example flight.csv",
            "shockrig example profile.json",
            "shockrig correct flight.csv --profile profile.json --out corrected.csv",
        ),
        "corrected.html shows the profiles as read and corrected: both ways agree afterwards. corrected.csv is the log "
        "with five columns more.",
    ),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.epilog = "Everything it makes stays in --out, to be looked at and tried again."
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("tour"), help="new folder for all of it (default: tour)"
    )
    parser.add_argument("--yes", action="store_true", help="go on by itself, without waiting for Enter")


def main(args: argparse.Namespace) -> int:
    """Go from stop to stop; 0 when all commands came to their end."""
    from shockrig.files.errors import InputError

    if args.out.exists() and (not args.out.is_dir() or any(args.out.iterdir())):
        raise InputError(f"--out {args.out}: is there already; give another name")
    try:
        args.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {args.out}: {error.strerror}; name a folder that can be written") from error
    home = Path.cwd()
    waits = not args.yes and sys.stdin.isatty()
    os.chdir(args.out)
    try:
        for number, stop in enumerate(STOPS, start=1):
            print(f"\n{number} of {len(STOPS)}  {stop.title}\n")
            print(textwrap.fill(stop.why, WIDTH), flush=True)
            for command in stop.commands:
                print(f"\n$ {command}", flush=True)
                if waits and not _goes_on():
                    print("the tour ends here; what it made stays")
                    return 0
                if status := _run(command):
                    return status
            print("\n" + textwrap.fill(f"Look at: {stop.look}", WIDTH), flush=True)
    finally:
        os.chdir(home)
    print(f"\nAll of it is in {args.out}. In a notebook: shockrig.import_log(...).characterize().plot()")
    return 0


def _goes_on() -> bool:
    """Enter goes on; q ends the tour."""
    print("[Enter runs it, q ends] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() not in ("q", "quit", "n", "no")


def _run(command: str) -> int:
    """One command of the tour, in this process."""
    from shockrig.protocols.cli import build_parser

    words = shlex.split(command)[1:]
    parsed = build_parser(words[0]).parse_args(words)
    status: int = parsed.main(parsed) or 0
    return status
