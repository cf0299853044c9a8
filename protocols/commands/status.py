"""shockrig status: what a campaign holds, what is missing, what was spoilt and why."""

from __future__ import annotations

import argparse
from pathlib import Path

from shockrig.files.numbers import counted


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("campaign", metavar="CAMPAIGN", type=Path, help="campaign folder")


def main(args: argparse.Namespace) -> int:
    from shockrig.protocols.folder import EMULATED
    from shockrig.rig.recorder import read_state

    state = read_state(args.campaign)
    planned = f" of {len(state.planned)} planned" if state.planned else ""
    print(f"{state.name}: {counted(len(state.recorded), 'run')} recorded{planned}")
    if state.emulated:
        print(EMULATED)
    if state.missing:
        print(f"missing: {', '.join(state.missing)}; run the same command again to record them")
    for id_ in state.in_progress:
        print(f"{id_}: being recorded now, or cut off; running the same command again puts it in order")
    for aside in state.set_aside:
        later = "recorded since" if aside.id in state.recorded else "still missing"
        print(f"{aside.id}: {aside.status} ({aside.reason}); kept in {aside.folder}; {later}")
    return 0
