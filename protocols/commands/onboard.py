"""shockrig onboard: a profile in, a program for autopilots out."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

ROWS_FILE = "rows.csv"  # a flight as the program reads it


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("profile", type=Path, metavar="PROFILE", help="profile.json of the sensors that fly")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the sources")
    parser.add_argument(
        "--flight",
        type=Path,
        metavar="F",
        help="a log of yours: written as rows that the program reads, and, with a C compiler, compared with the "
        "reference",
    )
    parser.add_argument(
        "--period-s", type=float, metavar="S", help="time between rows (default: the flight's, else the profile's)"
    )


def main(args: argparse.Namespace) -> int:
    """Write DIR, and compare the program with its reference where there is a flight."""
    import numpy as np

    from shockrig.analysis.flight.doubts import profile_doubts
    from shockrig.analysis.flight.smooth_channel import typical_period
    from shockrig.analysis.onboard import c_source, flown, lua_source, page, state_bytes
    from shockrig.files.errors import InputError
    from shockrig.files.profile import read_profile
    from shockrig.protocols.flight_logs import read_flight
    from shockrig.protocols.folder import software_version, whole_folder
    from shockrig.protocols.onboard_check import as_csv, build, compiler, difference, reference, run

    if args.period_s is not None and not 1e-3 <= args.period_s <= 60.0:
        raise InputError(f"--period-s {args.period_s:g}: expected 0.001 to 60 s")
    profile = read_profile(args.profile)
    flight = None if args.flight is None else read_flight(args.flight)
    for name in ("temperature_c", "humidity_percent"):
        if flight is not None and not np.isfinite(getattr(flight, name)).any():
            raise InputError(f"{args.flight}: no {name} in it; a program on board corrects both: give a log with both")
    period = args.period_s or (None if flight is None else typical_period(flight.time_s))
    design = flown(profile, period)
    note = f"shockrig {software_version()}"
    sources = c_source(design, args.profile.name, note) | {"shock_correct.lua": lua_source(design, args.profile.name)}
    why = "no flight was given (--flight)" if flight is None else "this computer has no C compiler"
    measured, cc = None, compiler()
    with whole_folder(args.out) as folder:
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        if flight is not None:
            (folder / ROWS_FILE).write_text(as_csv(flight), encoding="utf-8")
        if flight is not None and cc is not None:
            with tempfile.TemporaryDirectory() as place:
                program = build(folder, cc, Path(place))
                measured = difference(run(program, flight), reference(design, flight))
        text = page(profile, design, args.profile.name, note, args.flight and args.flight.name, measured, why)
        (folder / "README.md").write_text(text, encoding="utf-8")
    print(f"{args.out}: {', '.join([*sources, 'README.md', *([] if flight is None else [ROWS_FILE])])}")
    print(f"  state: {state_bytes(design)} bytes; rows {design.period_s:g} s apart")
    if measured is None:
        print(f"  not compared with the reference: {why}")
    else:
        print(
            f"  against the reference on {measured.rows} rows of {args.flight}: at most {measured.temperature_k:.2g} K "
            f"and {measured.humidity_percent:.2g} %RH apart"
        )
    for doubt in profile_doubts(profile):
        print(f"note: {doubt}")
    return 0
