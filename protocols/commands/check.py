"""shockrig check: all that has to be well before a run, looked at at once: "ready", or what is missing (status 1)."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        "A GRBL stage is reset and homed, as for a run: keep clear, or use --still. Exit status: 0 all is well, "
        "1 something is missing (the tree says what, why and the remedy), 2 bad bench file or arguments."
    )
    parser.add_argument(
        "protocol",
        metavar="PROTOCOL",
        nargs="?",
        default="standard",
        help="what shall be recorded, as in shockrig run (default: standard)",
    )
    parser.add_argument("--bench", metavar="BENCH.toml", type=Path, help="bench file (default: the virtual bench)")
    parser.add_argument("--out", metavar="CAMPAIGN", type=Path, default=Path(), help="where you mean to record to")
    parser.add_argument("--still", action="store_true", help="send nothing to the stage")


def main(args: argparse.Namespace) -> int:
    import time

    from shockrig.rig.bench import default_bench, load_bench, open_bench
    from shockrig.rig.bench_findings import examine, lacking, tree
    from shockrig.rig.protocol import load_protocol

    protocol = load_protocol(args.protocol)
    config = default_bench() if args.bench is None else load_bench(args.bench)
    print("opening every instrument and listening for some seconds ...", file=sys.stderr, flush=True)
    with open_bench(config) as bench:
        findings = examine(bench, protocol, args.out, wall=time.time, may_move=not args.still)
    print(tree(bench.name, findings))
    missing = lacking(findings)
    print(missing or ready(args.protocol, args.bench, args.out))
    return 1 if missing else 0


def ready(protocol: str, bench: Path | None, out: Path, given: Sequence[str] = ()) -> str:
    """The last line where nothing is missing: what to look at once more in the bench file, and what to type next, with
    the further options that were `given`."""
    from shockrig.rig.bench_file import marked_set

    words = ["shockrig", "run", protocol, *(["--bench", str(bench)] if bench is not None else []), "--out"]
    command = shlex.join([*words, "CAMPAIGN" if out == Path() else str(out), *given])
    marked = marked_set(bench) if bench is not None else ()
    doubt = f", if {', '.join(marked)} are right, which {bench} still marks SET" if marked else ""
    return f"ready{doubt}: {command}"
